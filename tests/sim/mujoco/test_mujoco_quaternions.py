"""Test of quaternions in curves and programs, where q and -q are the same rotation."""

from dataclasses import replace

import numpy as np

from proofmass.run.sidecar import load_case
from proofmass.run.solve import call_engine, prescribed_run
from proofmass.sim.mujoco.engine import ENGINE
from proofmass.sim.protocol.programs import Imposed
from tests.programs import program_curves
from tests.shipped import shipped


def test_curves_and_programs_have_the_same_signs_of_quaternions(tmp_path):
    model = tmp_path / "euler_top.xml"
    text = shipped("euler_top.xml").read_text()
    model.write_text(text.replace('qpos="0 0 0 1 0 0 0"', 'qpos="0 0 0 -1 0 0 0"'))
    run = prescribed_run(load_case(shipped("euler_top.toml")), "dynamics")
    run = replace(run, x=run.x[:60], settings={"timestep": 0.01, "integrator": "RK4"})
    curves = call_engine("mujoco", model, run)
    assert curves.channels["turn.w"][0] == 1.0
    quaternion = np.array([curves.channels[f"turn.{part}"] for part in "wxyz"])
    assert np.abs(np.diff(quaternion)).max() < 0.5, "no jump"
    program = ENGINE.programs.write_program(model, run, "", "", Imposed("free", 0.0))
    found = program_curves(program, tmp_path)
    columns = [name for name in found if name.startswith("turn")]
    np.testing.assert_allclose([found[name] for name in columns], quaternion, atol=1e-12, rtol=0)
