"""jansen, dynamics: position within 1e-5 of its range.

MuJoCo RK4, solref 2 steps, timestep 3.49 ms: 2.8e-6 off in 0.064 s, 900 steps
as a program that runs by itself, its drive moved by a flywheel: 2.9e-6 off in 0.07 s;
2.8e-6 from a shifted start
its drive moved by a servo of gain 2 instead: 4.8e-4 off in 0.045 s, not good enough
its drive moved by an equality of gain 0.5 instead: 2.7e-5 off in 0.039 s, not good enough
the engine's defaults are 0.02 off at best, 0.28 s at timestep 0.192 ms

Made by proofmass choose with mujoco 4.0.0.  It writes the curves of all channels, in SI units:

    python jansen_mujoco.py [curves.csv]
"""

import csv
import sys
import time

import mujoco
import numpy as np

MODEL = """
<mujoco model="jansen">
  <compiler angle="radian"/>
  <option timestep="0.003490658503988659" integrator="RK4" gravity="0 -9.81 0" jacobian="dense"
          tolerance="1e-10" solver="Newton" iterations="100">
    <flag contact="disable"/>
  </option>
  <default>
    <equality solref="0.005 1" solimp="0.9999 0.9999 0.001"/>
    <geom type="capsule" size="0.01" mass="0"/>
  </default>
  <worldbody>
    <body name="crank" pos="0 0 0">
      <joint name="crank" armature="64181084.30097745" damping="0 0 0" frictionloss="0"/>
      <inertial pos="0.075 0 0" mass="0.15" diaginertia="2.8125e-05 0.00028125 0.00028125"/>
      <geom fromto="0 0 0 0.15 0 0"/>
      <body name="upper_rod" pos="0.15 0 0">
        <joint name="upper_rod"/>
        <inertial pos="0.25 0 0" mass="0.5"
                  diaginertia="0.00104166666666667 0.0104166666666667 0.0104166666666667"/>
        <geom fromto="0 0 0 0.5 0 0"/>
        <site name="upper_rod_end" pos="0.5 0 0"/>
      </body>
      <body name="lower_rod" pos="0.15 0 0">
        <joint name="lower_rod"/>
        <inertial pos="0.3095 0 0" mass="0.619"
                  diaginertia="0.00197647215833333 0.0197647215833333 0.0197647215833333"/>
        <geom fromto="0 0 0 0.619 0 0"/>
        <site name="lower_rod_end" pos="0.619 0 0"/>
      </body>
    </body>
    <body name="upper" pos="-0.38 -0.078 0">
      <joint name="upper"/>
      <inertial pos="0.156049397590361 0.139644704059793 0" mass="1.374"
                diaginertia="0.0258015086842105 0.0258015086842105 0.0490228665"/>
      <geom fromto="0 0 0 0.415 0 0"/>
      <geom fromto="0 0 0 0.0260987951807 0.400149788067 0"/>
      <geom fromto="0.415 0 0 0.0260987951807 0.400149788067 0"/>
      <site name="upper_end" pos="0.415 0 0"/>
      <body name="rear" pos="0.026098795180722847 0.40014978806706203 0">
        <joint name="rear"/>
        <inertial pos="0.197 0 0" mass="0.394"
                  diaginertia="0.000509691533333333 0.00509691533333333 0.00509691533333333"/>
        <geom fromto="0 0 0 0.394 0 0"/>
        <site name="rear_end" pos="0.394 0 0"/>
      </body>
    </body>
    <body name="lower" pos="-0.38 -0.078 0">
      <joint name="lower"/>
      <inertial pos="0.1965 0 0" mass="0.393"
                diaginertia="0.000505820475 0.00505820475 0.00505820475"/>
      <geom fromto="0 0 0 0.393 0 0"/>
      <site name="lower_end" pos="0.393 0 0"/>
      <body name="shank" pos="0.393 0 0">
        <joint name="shank"/>
        <inertial pos="0.094767029972752 0.183276740468763 0" mass="1.514"
                  diaginertia="0.0353122011403509 0.0353122011403509 0.0670931821666667"/>
        <geom fromto="0 0 0 0.367 0 0"/>
        <geom fromto="0 0 0 -0.0774659400545 0.483837811804 0"/>
        <geom fromto="0.367 0 0 -0.0774659400545 0.483837811804 0"/>
        <site name="shank_end" pos="0.367 0 0"/>
        <site name="foot" pos="-0.07746594005449614 0.4838378118041966 0"/>
      </body>
    </body>
  </worldbody>
  <equality>
    <connect name="hip" site1="upper_rod_end" site2="upper_end" solref="0.006981317007977318 1"
             solimp="0.9999 0.9999 0.001 0.5 2"/>
    <connect name="ankle" site1="lower_rod_end" site2="lower_end" solref="0.006981317007977318 1"
             solimp="0.9999 0.9999 0.001 0.5 2"/>
    <connect name="knee" site1="rear_end" site2="shank_end" solref="0.006981317007977318 1"
             solimp="0.9999 0.9999 0.001 0.5 2"/>
  </equality>
  <actuator>
    <motor name="crank_motor" joint="crank"/>
  </actuator>
  <sensor>
    <framepos name="foot" objtype="site" objname="foot"/>
    <framelinvel name="foot_velocity" objtype="site" objname="foot"/>
    <framelinacc name="foot_acceleration" objtype="site" objname="foot"/>
    <framepos name="knee" objtype="site" objname="rear_end"/>
    <framelinvel name="knee_velocity" objtype="site" objname="rear_end"/>
    <framelinacc name="knee_acceleration" objtype="site" objname="rear_end"/>
    <jointpos name="upper" joint="upper"/>
    <jointvel name="upper_rate" joint="upper"/>
    <user name="upper_acceleration" objtype="joint" objname="upper" datatype="real" needstage="acc"
          dim="1"/>
  </sensor>
</mujoco>
"""
STEP = 0.003490658503988659  # s
STEPS = 5  # from sample to sample
SAMPLES = 181
FIRST = 0.0  # time of the first sample [s]
WARNINGS = [mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL,
            mujoco.mjtWarning.mjWARN_BADQACC]
DRIVES = ["crank"]
FLYWHEELS = np.array([64181084.30097745])  # armature of the driven joints in MODEL


def motion(t):
    """Values, rates and accelerations (drives, n) of the drives at times (n,) [s]."""
    one = np.ones_like(t)
    return (
        np.array([0.0 + 2.0 * t]),
        np.array([2.0 * one]),
        np.array([0.0 * one]))


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
    data.qpos[:] = [
        0.0, 2.465894844308564, -2.3154810446395375, 1.2270429474429436,
        -2.391775555686697, -1.2858386142179512, -2.351639170258643]
    data.qvel[:] = [
        1.9999999999999993, -1.402484097084846, -1.4573558731370206, 0.47823323455764893,
        0.2018287093086724, 0.6548701666884343, -0.21348903596952545]
    data.ctrl[:1] = [0.0]
    sensors, state = [], []
    times = FIRST + STEP * np.arange((SAMPLES - 1) * STEPS + 1)

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
        "foot.x": sensors[:, 0],
        "foot.y": sensors[:, 1],
        "foot_velocity.x": sensors[:, 3],
        "foot_velocity.y": sensors[:, 4],
        "foot_acceleration.x": sensors[:, 6],
        "foot_acceleration.y": sensors[:, 7] - 9.81,
        "knee.x": sensors[:, 9],
        "knee.y": sensors[:, 10],
        "knee_velocity.x": sensors[:, 12],
        "knee_velocity.y": sensors[:, 13],
        "knee_acceleration.x": sensors[:, 15],
        "knee_acceleration.y": sensors[:, 16] - 9.81,
        "upper": sensors[:, 18],
        "upper_rate": sensors[:, 19],
        "upper_acceleration": state[:, 17],
        "crank drive": state[:, 0],
        "crank drive rate": state[:, 7],
        "crank drive acceleration": state[:, 14],
    }
    times = FIRST + STEPS * STEP * np.arange(SAMPLES)
    with open(file, "w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        rows.writerow(["t", *curves])
        rows.writerows(zip(times.tolist(), *[curve.tolist() for curve in curves.values()]))
    print(f"{(SAMPLES - 1) * STEPS} steps in {seconds:.6g} s; curves in {file}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
