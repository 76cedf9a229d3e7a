"""spring_slider, dynamics: position within 1e-5 of its range.

MuJoCo RK4, solref 4 steps, timestep 4.44 ms: 3.5e-6 off in 6.9e-3 s, 450 steps
as a program that runs by itself: 3.5e-6 off in 0.011 s; 3.5e-6 from a shifted start
the engine's defaults are 9.8e-3 off at best, 1.9e-3 s at timestep 4.44 ms; of order 1.2
they would take 1.1 s, 153 times as long

Made by proofmass choose with mujoco 4.0.0.  It writes the curves of all channels, in SI units:

    python spring_slider_mujoco.py [curves.csv]
"""

import csv
import sys
import time

import mujoco
import numpy as np

MODEL = """
<mujoco model="spring_slider">
  <compiler angle="radian"/>
  <option timestep="0.0044444444444444444" integrator="RK4" gravity="0 -9.81 0" jacobian="dense"
          tolerance="1e-10" solver="Newton" iterations="100">
    <flag contact="disable"/>
  </option>
  <default>
    <equality solref="0.005 1" solimp="0.9999 0.9999 0.001"/>
    <geom type="capsule" size="0.01" mass="0"/>
    <default class="sprung">
      <joint stiffness="60" springref="0.1" damping="2"/>
    </default>
    <default class="flywheel">
      <joint armature="0.02"/>
    </default>
  </default>
  <worldbody>
    <body name="crank" pos="0 0 0">
      <joint name="crank" class="flywheel"/>
      <inertial pos="0.15 0 0" mass="0.6" diaginertia="0.00045 0.0045 0.0045"/>
      <geom fromto="0 0 0 0.3 0 0"/>
      <body name="coupler" pos="0.3 0 0">
        <joint name="coupler"/>
        <inertial pos="0.35 0 0" mass="0.9" diaginertia="0.003675 0.03675 0.03675"/>
        <geom fromto="0 0 0 0.7 0 0"/>
        <site name="coupler_end" pos="0.7 0 0"/>
      </body>
    </body>
    <body name="slider" pos="0.8 0 0">
      <joint name="slider" class="sprung" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="1.5" diaginertia="0.01 0.01 0.01"/>
      <geom type="box" size="0.06 0.04 0.04"/>
      <site name="slider_pin"/>
    </body>
  </worldbody>
  <equality>
    <connect name="pin" site1="coupler_end" site2="slider_pin" solref="0.017777777777777778 1"
             solimp="0.9999 0.9999 0.001 0.5 2"/>
  </equality>
  <sensor>
    <jointpos name="crank" joint="crank"/>
    <jointvel name="crank_rate" joint="crank"/>
    <user name="crank_acceleration" objtype="joint" objname="crank" datatype="real" needstage="acc"
          dim="1"/>
    <jointpos name="slide" joint="slider"/>
    <jointvel name="slide_rate" joint="slider"/>
    <user name="slide_acceleration" objtype="joint" objname="slider" datatype="real" needstage="acc"
          dim="1"/>
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
    data.qpos[:] = [1.0471975511965976, -1.4274487578895312, 8.478288049308015e-18]
    data.qvel[:] = [0.0, 0.0, 0.0]
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
        "crank": sensors[:, 0],
        "crank_rate": sensors[:, 1],
        "crank_acceleration": state[:, 6],
        "slide": sensors[:, 3],
        "slide_rate": sensors[:, 4],
        "slide_acceleration": state[:, 8],
    }
    times = FIRST + STEPS * STEP * np.arange(SAMPLES)
    with open(file, "w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        rows.writerow(["t", *curves])
        rows.writerows(zip(times.tolist(), *[curve.tolist() for curve in curves.values()]))
    print(f"{(SAMPLES - 1) * STEPS} steps in {seconds:.6g} s; curves in {file}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
