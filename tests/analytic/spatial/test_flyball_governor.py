"""The stiff flyball governor: its printed curve, and the equations of its height and one angle.

Programs that name problem A05 of the IFToMM library differ in its numbers. Those of the model are
the ones that lead to the printed curve.
"""

import json
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.analytic import spatial
from proofmass.sim.smooth import SmoothTerms
from tests.independent.spatial import governor
from tests.shipped import shipped

DATA = Path(__file__).parents[2] / "data" / "flyball_governor.json"
PRINTED = np.array(json.loads(DATA.read_text())["height"])
MODEL_TEXT = shipped("flyball_governor.xml").read_text()
TIMES = np.arange(PRINTED.size) / 10  # s


@cache
def truth() -> dict[str, np.ndarray]:
    return governor.move(TIMES)


def reference_motion(times: np.ndarray, text: str = MODEL_TEXT) -> dict[str, np.ndarray]:
    model = mujoco.MjModel.from_xml_string(text)
    return spatial.solve(times, model=model, terms=SmoothTerms(model))


def test_the_equations_lead_to_the_printed_curve():
    """Six decimals are printed; the largest difference is 1.2e-6 m at 2.3 s."""
    assert np.abs(truth()["height"] - PRINTED).max() < 1.5e-6
    assert np.ptp(PRINTED) > 0.24


@pytest.mark.parametrize("end", [0.2, 3.0])
def test_the_reference_moves_as_the_equations(end):
    times = TIMES[: round(10 * end) + 1]
    found, wanted = reference_motion(times), {k: v[: times.size] for k, v in truth().items()}
    for name in ("height", "height_rate", "spin", "spin_rate"):
        assert np.abs(found[name] - wanted[name]).max() < 2e-8, name
    for side in ("right", "left"):
        assert np.abs(found[side] - wanted["angle"]).max() < 1e-9
    assert np.abs(found["right_rate"] - wanted["angle_rate"]).max() < 2e-8
    assert np.abs(found["height"] - wanted["height"]).max() < 1e-9


def test_the_model_in_mujoco_moves_as_the_equations():
    """RK4 at 0.2 ms, without the reference between both."""
    model = mujoco.MjModel.from_xml_string(MODEL_TEXT)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    poses = [data.qpos.copy()]
    for _ in TIMES[1:]:
        mujoco.mj_step(model, data, round(0.1 / model.opt.timestep))
        poses.append(data.qpos.copy())
    spin, height, right, left = np.array(poses).T
    assert np.abs(spin - truth()["spin"]).max() < 1e-9
    assert np.abs(height - truth()["height"]).max() < 1e-9
    assert np.abs([right - truth()["angle"], left - truth()["angle"]]).max() < 1e-9


@pytest.mark.parametrize(
    ("changes", "off"),
    [
        ({"stiffness": 4e3, "damping": 2e2}, 0.025),  # 0.005 times those of A05, as in Exudyn
        ({"spin": 0.16 * 2 * np.pi}, 0.7),
        ({"stiffness": 4e3, "damping": 2e2, "spin": 0.16 * 2 * np.pi}, 0.7),
        ({"density": 2700.0}, 0.001),
        ({"ball": 4.9}, 0.001),
        ({"stiffness": 8e4}, 0.001),
        ({"damping": 4e3}, 1e-5),
    ],
)
def test_other_numbers_do_not_lead_to_the_printed_curve(changes, off):
    assert np.abs(governor.move(TIMES, **changes)["height"] - PRINTED).max() > off


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ('mass="5"', 'mass="5.0001"'),
        ('stiffness="8e5"', 'stiffness="8.01e5"'),
        ('damping="4e4"', 'damping="4.01e4"'),
        ('springlength="0.5"', 'springlength="0.50001"'),
        ('size="0.05 0.05 0.05"', 'size="0.0501 0.05 0.05"'),
        ('qvel="6.283185307179586', 'qvel="6.28319'),
        ('pos="0.05 0 1"', 'pos="0.05001 0 1"'),
    ],
)
def test_a_small_error_in_the_model_changes_the_motion(wrong, right):
    """A mutation: within 0.2 s each error changes a curve by ten times the tolerance above."""
    assert wrong in MODEL_TEXT
    found = reference_motion(TIMES[:3], MODEL_TEXT.replace(wrong, right))
    assert np.abs(found["height"] - truth()["height"][:3]).max() > 1e-8


def tendon_rows(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Jacobian of the lengths of tendons (tendons, rates), which MuJoCo stores without zeros."""
    rows = np.zeros((model.ntendon, model.nv))
    for row, start, count in zip(rows, model.ten_J_rowadr, model.ten_J_rownnz, strict=True):
        at = slice(start, start + count)
        row[model.ten_J_colind[at]] = data.ten_J[at]
    return rows


def implicit_error(step: float, until: float, ties: bool) -> float:
    """Error of the height [m] of MuJoCo's implicit integrator; with `ties` of the full matrix.

    `ties` solves the same step in NumPy: M + h c J^T J with all terms of the tendons.
    """
    model = mujoco.MjModel.from_xml_string(MODEL_TEXT)
    model.opt.timestep = step
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    heights = [data.qpos[1]]
    for _ in TIMES[1 : round(until * 10) + 1]:
        for _ in range(round(0.1 / step)):
            if not ties:
                mujoco.mj_step(model, data)
                continue
            mujoco.mj_forward(model, data)
            mass = np.zeros((model.nv, model.nv))
            mujoco.mj_fullM(model, data, mass)
            rows = tendon_rows(model, data)
            whole = mass + step * rows.T @ np.diag(model.tendon_damping) @ rows
            push = data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
            data.qvel[:] += step * np.linalg.solve(whole, push)
            data.qpos[:] += step * data.qvel
        heights.append(data.qpos[1])
    return float(np.abs(np.array(heights) - truth()["height"][: len(heights)]).max())


def test_implicit_steps_of_mujoco_leave_out_what_a_tendon_ties_between_branches():
    """Without these terms each damper brakes slider and rods against the ground.

    The step is stable, and the height is off by half of its range; with them by a 300th.
    """
    assert implicit_error(1e-3, 0.6, ties=False) > 0.1
    assert implicit_error(1e-3, 0.6, ties=True) < 1e-3
