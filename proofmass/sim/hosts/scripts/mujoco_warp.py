"""MuJoCo Warp: MuJoCo's models in Warp, here on the processor and in single precision.

Warp compiles its kernels before the first step of a process, which is told apart from the run.
"""

from importlib.metadata import version

import mujoco_warp as mjw
import numpy as np
import warp
from proofmass_host import LinkStates, NeutralMechanism, Refused, Stopwatch, load_beside

MUJOCO_C = load_beside(__file__, "mujoco_c")
warp.config.quiet = True
VERSIONS = {name: version(name) for name in ("mujoco-warp", "mujoco", "warp-lang", "numpy")}


def simulate(mechanism: NeutralMechanism, settings: dict) -> LinkStates:
    """Step through the run, and read the links at the samples."""
    mjcf = mechanism.mjcf
    model, data = MUJOCO_C.build(mjcf)
    count, n = mechanism.count, mechanism.samples
    rows = [np.zeros((n, size)) for size in (model.nq, model.nv, model.nv)]
    push = np.zeros((1, model.nv), np.float32)
    control = np.array(mjcf.ctrl, np.float32)[None]
    with warp.ScopedDevice("cpu"):
        try:
            own, now = mjw.put_model(model), mjw.put_data(model, data)
        except (NotImplementedError, ValueError) as error:
            raise Refused(f"MuJoCo Warp: {' '.join(str(error).split())}") from None

        def apply(torque, half_step):
            push[0, mjcf.dofs] = torque
            now.qfrc_applied.assign(push)
            if mjcf.changed.size:
                control[0, mjcf.changed] = mjcf.controls[half_step]
                now.ctrl.assign(control)

        with Stopwatch() as compiling:
            apply(mjcf.instant[0], 0)
            mjw.forward(own, now)
            mjw.step(own, mjw.put_data(model, data))
        with Stopwatch() as watch:
            for k in range(n):
                apply(mjcf.instant[k * count], 2 * k * count)
                mjw.forward(own, now)
                for row, one in zip(rows, (now.qpos, now.qvel, now.qacc)):
                    row[k] = one.numpy()[0]
                for i in range(k * count, (k + 1) * count if k < n - 1 else 0):
                    apply(mjcf.torque[i], 2 * i + 1)
                    mjw.step(own, now)
    return MUJOCO_C.states_of(mechanism, model, rows, watch.seconds, "", compiling.seconds)
