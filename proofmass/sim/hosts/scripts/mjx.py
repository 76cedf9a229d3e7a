"""MJX: MuJoCo's models in JAX, on the processor and in double precision.

JAX compiles all steps of a run into one program, which takes tens of seconds and is told apart.
Accelerations are left out: a forward pass at each sample would double that time.
"""

import os

os.environ["JAX_PLATFORMS"] = "cpu"

from importlib.metadata import version

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402
import proofmass_host as host  # noqa: E402
from jax import numpy as jnp  # noqa: E402
from mujoco import mjx  # noqa: E402

MUJOCO_C = host.load_beside(__file__, "mujoco_c")
VERSIONS = {name: version(name) for name in ("mujoco-mjx", "mujoco", "jax", "numpy")}


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Compile the whole run, step through it, and read the links at the samples."""
    mjcf = mechanism.mjcf
    model, data = MUJOCO_C.build(mjcf)
    try:
        own, start = mjx.put_model(model), mjx.put_data(model, data)
    except NotImplementedError as error:
        raise host.Refused(f"MJX: {' '.join(str(error).split())}") from None
    intervals, count = mechanism.samples - 1, mechanism.count
    dofs, changed = np.asarray(mjcf.dofs), np.asarray(mjcf.changed)
    pushes = jnp.array(mjcf.torque.reshape(intervals, count, dofs.size))
    controls = jnp.array(mjcf.controls[1 : 2 * mechanism.steps : 2])
    controls = controls.reshape(intervals, count, changed.size)

    def step(now, inputs):
        push, control = inputs
        now = now.replace(qfrc_applied=now.qfrc_applied.at[dofs].set(push))
        return mjx.step(own, now.replace(ctrl=now.ctrl.at[changed].set(control))), None

    def interval(now, inputs):
        return jax.lax.scan(step, now, inputs)[0], (now.qpos, now.qvel)

    def whole(now):
        now, rows = jax.lax.scan(interval, now, (pushes, controls))
        return [jnp.concatenate([one, last[None]]) for one, last in zip(rows, (now.qpos, now.qvel))]

    with host.Stopwatch() as compiling:
        program = jax.jit(whole).lower(start).compile()
    with host.Stopwatch() as watch:
        qpos, qvel = (np.asarray(one, float) for one in program(start))
    rows = [qpos, qvel, np.full(qvel.shape, np.nan)]
    return MUJOCO_C.states_of(mechanism, model, rows, watch.seconds, "", compiling.seconds)
