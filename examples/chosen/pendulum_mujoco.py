"""pendulum, dynamics: position within 1e-6 of its range.

MuJoCo RK4, timestep 10 ms: 4e-8 off in 0.011 s, 1000 steps
as a program that runs by itself: 4e-8 off in 0.062 s; 3.9e-8 from a shifted start
the engine's defaults are 2.3e-3 off at best, 6.6e-3 s at timestep 3.33 ms; of order 1 they
would take 31 s, 2918 times as long

Made by proofmass choose with mujoco 4.0.0.  It writes the curves of all channels, in SI units:

    python pendulum_mujoco.py [curves.csv]
"""

import csv
import sys
import time

import mujoco
import numpy as np

MODEL = """
<mujoco model="pendulum">
  <compiler angle="radian"/>
  <option timestep="0.01" integrator="RK4" gravity="0 -9.81 0" jacobian="dense" solver="Newton"
          iterations="100" tolerance="1e-08">
    <flag contact="disable"/>
  </option>
  <worldbody>
    <body name="bob" pos="0 1 0">
      <joint name="pivot"/>
      <inertial pos="0 -1 0" mass="1" diaginertia="1e-14 1e-14 1e-14"/>
      <geom type="capsule" size="0.01" mass="0" fromto="0 0 0 0 -1 0"/>
      <geom type="sphere" size="0.05" mass="0" pos="0 -1 0"/>
    </body>
  </worldbody>
  <sensor>
    <jointpos name="angle" joint="pivot"/>
    <jointvel name="rate" joint="pivot"/>
    <user name="acceleration" objtype="joint" objname="pivot" datatype="real" needstage="acc"
          dim="1"/>
    <e_kinetic name="kinetic"/>
    <e_potential name="potential"/>
  </sensor>
</mujoco>
"""
STEP = 0.01  # s
STEPS = 1  # from sample to sample
SAMPLES = 1001
FIRST = 0.0  # time of the first sample [s]
WARNINGS = [mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL,
            mujoco.mjtWarning.mjWARN_BADQACC]


def angle(x, y):
    """Direction of a vector, without jumps [rad]."""
    return np.unwrap(np.arctan2(y, x))


def failure(data):
    """Why the run failed; nothing if it did not."""
    for warning in WARNINGS:
        if data.warning[warning].number:
            return f"MuJoCo warns: {warning.name}"
    if not np.isfinite(data.qpos).all():
        return "not finite"
    return ""


def main(file="curves.csv"):
    """Run the motion, and write the curves of all channels to a CSV file."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    assert model.opt.timestep == STEP
    data.time = FIRST
    data.qpos[:] = [-1.5707963267948966]
    data.qvel[:] = [0.0]
    sensors, state = [], []

    def record():
        """Keep what the sensors show at this time."""
        mujoco.mj_forward(model, data)
        sensors.append(data.sensordata.copy())
        state.append(np.concatenate([data.qpos, data.qvel, data.qacc]))

    began = time.perf_counter()
    for k in range(SAMPLES):
        record()
        if k == SAMPLES - 1:
            break
        mujoco.mj_step(model, data, STEPS)
        if why := failure(data):
            sys.exit(f"{why}, before {FIRST + (k + 1) * STEPS * STEP:.6g} s")
    seconds = time.perf_counter() - began

    sensors, state = np.array(sensors), np.array(state)
    curves = {
        "angle": sensors[:, 0],
        "rate": sensors[:, 1],
        "acceleration": state[:, 2],
        "kinetic": sensors[:, 3],
        "potential": sensors[:, 4],
    }
    times = FIRST + STEPS * STEP * np.arange(SAMPLES)
    with open(file, "w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        rows.writerow(["t", *curves])
        rows.writerows(zip(times.tolist(), *[curve.tolist() for curve in curves.values()]))
    print(f"{(SAMPLES - 1) * STEPS} steps in {seconds:.6g} s; curves in {file}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
