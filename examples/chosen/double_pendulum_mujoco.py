"""double_pendulum, dynamics: position within 1e-6 of its range.

MuJoCo RK4, timestep 4.44 ms: 3e-7 off in 3.4e-3 s, 450 steps
as a program that runs by itself: 3e-7 off in 0.016 s; 3e-7 from a shifted start
the engine's defaults are 0.027 off at best, 2e-3 s at timestep 1.9 ms; of order 0.97 they
would take 146 s, 43195 times as long

Made by proofmass choose with mujoco 4.0.0.  It writes the curves of all channels, in SI units:

    python double_pendulum_mujoco.py [curves.csv]
"""

import csv
import sys
import time

import mujoco
import numpy as np

MODEL = """
<mujoco model="double_pendulum">
  <option timestep="0.0044444444444444444" integrator="RK4" gravity="0 -9.81 0" jacobian="dense"
          tolerance="1e-10" solver="Newton" iterations="100">
    <flag contact="disable"/>
  </option>
  <default>
    <geom type="capsule" size="0.01" mass="0"/>
  </default>
  <worldbody>
    <body name="upper" pos="0 0 0">
      <joint name="shoulder"/>
      <inertial pos="0 -0.4 0" mass="1"
                diaginertia="0.0533333333333333 0.00533333333333333 0.0533333333333333"/>
      <geom fromto="0 0 0 0 -0.8 0"/>
      <body name="lower" pos="0 -0.8 0">
        <joint name="elbow" range="-170 170"/>
        <inertial pos="0 -0.3 0" mass="0.7" diaginertia="0.021 0.0021 0.021"/>
        <geom fromto="0 0 0 0 -0.6 0"/>
        <site name="tip" pos="0 -0.6 0"/>
      </body>
    </body>
  </worldbody>
  <sensor>
    <jointpos name="shoulder" joint="shoulder"/>
    <jointvel name="shoulder_rate" joint="shoulder"/>
    <user name="shoulder_acceleration" objtype="joint" objname="shoulder" datatype="real"
          needstage="acc" dim="1"/>
    <jointpos name="elbow" joint="elbow"/>
    <jointvel name="elbow_rate" joint="elbow"/>
    <user name="elbow_acceleration" objtype="joint" objname="elbow" datatype="real" needstage="acc"
          dim="1"/>
    <framepos name="tip" objtype="site" objname="tip"/>
    <framelinvel name="tip_velocity" objtype="site" objname="tip"/>
    <framelinacc name="tip_acceleration" objtype="site" objname="tip"/>
  </sensor>
</mujoco>
"""
STEP = 0.0044444444444444444  # s
STEPS = 3  # from sample to sample
SAMPLES = 151
FIRST = 0.0  # time of the first sample [s]
WARNINGS = [mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL,
            mujoco.mjtWarning.mjWARN_BADQACC]


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
    data.qpos[:] = [1.7453292519943295, -1.0471975511965979]
    data.qvel[:] = [0.0, 0.0]
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
        "shoulder": sensors[:, 0],
        "shoulder_rate": sensors[:, 1],
        "shoulder_acceleration": state[:, 4],
        "elbow": sensors[:, 3],
        "elbow_rate": sensors[:, 4],
        "elbow_acceleration": state[:, 5],
        "tip.x": sensors[:, 6],
        "tip.y": sensors[:, 7],
        "tip_velocity.x": sensors[:, 9],
        "tip_velocity.y": sensors[:, 10],
        "tip_acceleration.x": sensors[:, 12],
        "tip_acceleration.y": sensors[:, 13] - 9.81,
    }
    times = FIRST + STEPS * STEP * np.arange(SAMPLES)
    with open(file, "w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        rows.writerow(["t", *curves])
        rows.writerows(zip(times.tolist(), *[curve.tolist() for curve in curves.values()]))
    print(f"{(SAMPLES - 1) * STEPS} steps in {seconds:.6g} s; curves in {file}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
