"""fourbar, dynamics: position within 1e-4 of its range.

MuJoCo implicitfast, solref 2 steps, timestep 3.49 ms: 3e-5 off in 7.3e-3 s, 1800 steps
as a program that runs by itself, its drive moved by a servo of gain 2: 7e-5 off in 0.014 s;
3e-5 from a shifted start
the engine's defaults are 1.3e-4 off at best, 0.012 s at timestep 1.94 ms

Made by proofmass choose with mujoco 4.0.0.  It writes the curves of all channels, in SI units:

    python fourbar_servo_mujoco.py [curves.csv]
"""

import csv
import sys
import time

import mujoco
import numpy as np

MODEL = """
<mujoco model="fourbar">
  <compiler angle="radian"/>
  <option timestep="0.003490658503988659" integrator="implicitfast" gravity="0 -9.81 0"
          jacobian="dense" tolerance="1e-10" solver="Newton" iterations="100">
    <flag contact="disable"/>
  </option>
  <default>
    <equality solref="0.005 1" solimp="0.9999 0.9999 0.001"/>
    <geom type="capsule" size="0.04" mass="0"/>
  </default>
  <worldbody>
    <body name="crank">
      <joint name="crank"/>
      <inertial pos="0.5 0 0" mass="1" diaginertia="0.001 0.0833333333333333 0.0833333333333333"/>
      <geom fromto="0 0 0 1 0 0"/>
      <body name="coupler" pos="1 0 0">
        <joint name="coupler"/>
        <inertial pos="1 0 0" mass="2" diaginertia="0.001 0.666666666666667 0.666666666666667"/>
        <geom fromto="0 0 0 2 0 0"/>
        <geom fromto="0 0 0 1 0.8 0"/>
        <geom fromto="1 0.8 0 2 0 0"/>
        <site name="coupler_end" pos="2 0 0"/>
        <site name="point" pos="1 0.8 0"/>
      </body>
    </body>
    <body name="rocker" pos="3 0 0">
      <joint name="rocker"/>
      <inertial pos="1.25 0 0" mass="2.5" diaginertia="0.001 1.30208333333333 1.30208333333333"/>
      <geom fromto="0 0 0 2.5 0 0"/>
      <site name="rocker_end" pos="2.5 0 0"/>
    </body>
  </worldbody>
  <equality>
    <connect name="pin" site1="coupler_end" site2="rocker_end" solref="0.006981317007977318 1"
             solimp="0.9999 0.9999 0.001 0.5 2"/>
  </equality>
  <actuator>
    <motor name="motor" joint="crank"/>
    <position name="drive of crank" joint="crank" kp="1268667.8706816218" kv="4428.486291531987"/>
  </actuator>
  <sensor>
    <framexaxis name="coupler" objtype="xbody" objname="coupler"/>
    <jointpos name="rocker" joint="rocker"/>
    <framepos name="pin" objtype="site" objname="rocker_end"/>
    <framepos name="point" objtype="site" objname="point"/>
    <frameangvel name="coupler_rate" objtype="xbody" objname="coupler"/>
    <jointvel name="rocker_rate" joint="rocker"/>
    <framelinvel name="pin_velocity" objtype="site" objname="rocker_end"/>
    <framelinvel name="point_velocity" objtype="site" objname="point"/>
    <frameangacc name="coupler_acceleration" objtype="xbody" objname="coupler"/>
    <frameangacc name="rocker_acceleration" objtype="xbody" objname="rocker"/>
    <framelinacc name="point_acceleration" objtype="site" objname="point"/>
    <actuatorfrc name="holding_moment" actuator="motor"/>
  </sensor>
</mujoco>
"""
STEP = 0.003490658503988659  # s
STEPS = 5  # from sample to sample
SAMPLES = 361
FIRST = 0.0  # time of the first sample [s]
WARNINGS = [mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL,
            mujoco.mjtWarning.mjWARN_BADQACC]
DRIVES = ["crank"]
LEAD = np.array([0.003490658503988659])  # kv/kp [s]: how far ahead of the joint a target is led


def motion(t):
    """Values, rates and accelerations (drives, n) of the drives at times (n,) [s]."""
    one = np.ones_like(t)
    return (
        np.array([0.0 + 1.0 * t]),
        np.array([1.0 * one]),
        np.array([0.0 * one]))


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
    data.qpos[:] = [0.0, 1.350263065874063, 2.2459278597319283]
    data.qvel[:] = [0.9999999999999998, -1.4999999999999998, -0.5000000000000002]
    data.ctrl[:1] = [0.0]
    sensors, state = [], []
    times = FIRST + STEP * np.arange((SAMPLES - 1) * STEPS + 1)
    value, rate, _ = motion(times)
    # each servo aims at its joint's value, led by what its own damping would keep it back
    shown = stepped = value.T + LEAD * rate.T

    def moments():
        """What the mechanism asks of its drives [N m or N]."""
        return data.actuator_force[-len(DRIVES):]

    def record():
        """Keep what the sensors show at this time."""
        mujoco.mj_forward(model, data)
        sensors.append(data.sensordata.copy())
        state.append(np.concatenate([data.qpos, data.qvel, data.qacc, moments()]))

    began = time.perf_counter()
    for k in range(SAMPLES):
        data.ctrl[-len(DRIVES):] = shown[k * STEPS]
        record()
        if k == SAMPLES - 1:
            break
        for n in range(k * STEPS, (k + 1) * STEPS):
            data.ctrl[-len(DRIVES):] = stepped[n]
            mujoco.mj_step(model, data)
        if why := failure(data):
            sys.exit(f"{why}, before {FIRST + (k + 1) * STEPS * STEP:.6g} s")
    seconds = time.perf_counter() - began

    sensors, state = np.array(sensors), np.array(state)
    curves = {
        "coupler.angle": angle(sensors[:, 0], sensors[:, 1]),
        "rocker": sensors[:, 3],
        "pin.x": sensors[:, 4],
        "pin.y": sensors[:, 5],
        "point.x": sensors[:, 7],
        "point.y": sensors[:, 8],
        "coupler_rate.z": sensors[:, 12],
        "rocker_rate": sensors[:, 13],
        "pin_velocity.x": sensors[:, 14],
        "pin_velocity.y": sensors[:, 15],
        "point_velocity.x": sensors[:, 17],
        "point_velocity.y": sensors[:, 18],
        "coupler_acceleration.z": sensors[:, 22],
        "rocker_acceleration.z": sensors[:, 25],
        "point_acceleration.x": sensors[:, 26],
        "point_acceleration.y": sensors[:, 27] - 9.81,
        "holding_moment": state[:, 9],
        "crank drive": state[:, 0],
        "crank drive rate": state[:, 3],
        "crank drive acceleration": state[:, 6],
    }
    times = FIRST + STEPS * STEP * np.arange(SAMPLES)
    with open(file, "w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        rows.writerow(["t", *curves])
        rows.writerows(zip(times.tolist(), *[curve.tolist() for curve in curves.values()]))
    print(f"{(SAMPLES - 1) * STEPS} steps in {seconds:.6g} s; curves in {file}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
