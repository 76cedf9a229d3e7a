"""MJX 3.17 opens a loop by `connect` 14,000 times as far as MuJoCo 3.17 (float64, the same model).

A four-bar swings for one second from rest.  MuJoCo has had the term J-dot-v of `connect` since 3.7,
MJX has not: its loop opens as that of MuJoCo 3.6.

    uv run --no-project --with mujoco-mjx==3.17.0 --with mujoco==3.17.0 --with jax==0.10.2 \
        python mjx_connect.py
"""

import os

os.environ["JAX_PLATFORMS"] = "cpu"

import jax

jax.config.update("jax_enable_x64", True)

import mujoco  # noqa: E402
import numpy as np  # noqa: E402
from mujoco import mjx  # noqa: E402

MODEL = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="RK4" tolerance="1e-12" gravity="0 -9.81 0">
    <flag contact="disable"/>
  </option>
  <worldbody>
    <body name="crank">
      <joint name="crank" axis="0 0 1"/>
      <geom type="capsule" fromto="0 0 0 1 0 0" size="0.02"/>
      <body name="coupler" pos="1 0 0">
        <joint name="coupler" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 1 2 0" size="0.02"/>
        <site name="one" pos="1 2 0"/>
      </body>
    </body>
    <body name="rocker" pos="3 0 0">
      <joint name="rocker" axis="0 0 1"/>
      <geom type="capsule" fromto="0 0 0 -1 2 0" size="0.02"/>
      <site name="two" pos="-1 2 0"/>
    </body>
  </worldbody>
  <equality>
    <connect site1="one" site2="two" solref="0.005 1" solimp="0.9999 0.9999 0.001"/>
  </equality>
</mujoco>
"""
STEPS = 1000
model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)


def largest_gap(poses: np.ndarray) -> float:
    """Largest distance of the two sites [m] in some poses."""
    found = 0.0
    for pose in poses:
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        found = max(found, float(np.linalg.norm(data.site_xpos[0] - data.site_xpos[1])))
    return found


own = mjx.put_model(model)
state = mjx.put_data(model, mujoco.MjData(model))


def step(now, _):
    """One step of MJX."""
    now = mjx.step(own, now)
    return now, now.qpos


rows = np.asarray(jax.jit(lambda now: jax.lax.scan(step, now, None, STEPS)[1])(state))
swing, poses = mujoco.MjData(model), np.empty((STEPS, model.nq))
for k in range(STEPS):
    mujoco.mj_step(model, swing)
    poses[k] = swing.qpos
print(f"MuJoCo {mujoco.__version__}: the loop opens by {largest_gap(poses):.2e} m")
print(f"MJX {mujoco.__version__}: the loop opens by {largest_gap(rows):.2e} m")
print(f"crank after {STEPS / 1000:g} s: {poses[-1][0]:.6f} and {rows[-1][0]:.6f} rad")
