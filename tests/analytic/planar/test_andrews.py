"""Andrews' squeezing mechanism: the printed solution, and the source's own equations.

The test set prints sixteen digits, and calls the rates and the values that follow from them less
certain, since its equations have index 3.  By two independent integrations, which agree to 1e-12,
the relative errors of the printed values are 3e-10 for angles, 6e-8 for rates and 2e-6 for
accelerations.
"""

import json
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.analytic.planar import read, solve
from proofmass.analytic.planar.forces import centre_jacobians, mass_matrix
from proofmass.analytic.planar.kinematics import loop_violations, move_bodies
from tests.independent.linkages import andrews
from tests.shipped import shipped

PRINTED = json.loads((Path(__file__).parents[2] / "data" / "andrews.json").read_text())
ANGLES, START, END = PRINTED["angles"], PRINTED["start"], PRINTED["end"]
MODEL_TEXT = shipped("andrews.xml").read_text()


def compile_model(text: str = MODEL_TEXT) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(text)


@cache
def reference_motion(text: str = MODEL_TEXT) -> dict[str, np.ndarray]:
    return solve([0.0, 0.01, 0.02, END["time"]], model=compile_model(text))


@cache
def source_motion() -> np.ndarray:
    """Angles and rates (14, 4) by the source's equations, at the times of `reference_motion`."""
    start = np.append(START["angles"], np.zeros(7))
    times = [0.0, 0.01, 0.02, END["time"]]
    return solve_ivp(
        andrews.state_rate, (0, END["time"]), start, "DOP853", times, rtol=1e-13, atol=1e-15
    ).y


def test_the_sources_equations_begin_and_end_as_printed():
    start = np.array(START["angles"])
    assert np.abs(andrews.constraints(start)).max() < 3e-17  # rounding of 0.1 m
    bend, multipliers = andrews.accelerations(start, np.zeros(7))
    np.testing.assert_allclose(bend, START["accelerations"], rtol=1e-12, atol=1e-10)
    np.testing.assert_allclose(multipliers, START["multipliers"], rtol=1e-12, atol=1e-12)
    angles, rates = np.split(source_motion()[:, -1], 2)
    np.testing.assert_allclose(angles, END["angles"], rtol=5e-10)
    np.testing.assert_allclose(rates, END["rates"], rtol=1e-7)
    bend, multipliers = andrews.accelerations(angles, rates)
    np.testing.assert_allclose(bend, END["accelerations"], rtol=3e-6)
    np.testing.assert_allclose(multipliers, END["multipliers"], rtol=3e-6)


def test_the_reference_ends_as_printed():
    found = reference_motion()
    ends = [found[name][-1] for name in ANGLES]
    np.testing.assert_allclose(ends, END["angles"], rtol=1e-9)
    rates = [found[f"{name}_rate"][-1] for name in ANGLES]
    np.testing.assert_allclose(rates, END["rates"], rtol=1e-7)


def test_the_reference_moves_as_the_sources_equations():
    found, truth = reference_motion(), source_motion()
    for k, name in enumerate(ANGLES):
        # 2.5 turns at up to 1500 rad/s; both integrators have a tolerance of 1e-13 per step
        assert np.abs(found[name] - truth[k]).max() < 3e-12, name
        assert np.abs(found[f"{name}_rate"] - truth[7 + k]).max() < 3e-9, name
    bend = np.array([andrews.accelerations(*np.split(state, 2))[0] for state in truth.T]).T
    accelerations = {n: k for k, n in enumerate(ANGLES) if f"{n}_acceleration" in found}
    assert len(accelerations) == 4  # beta, gamma, delta and epsilon have such sensors
    for name, k in accelerations.items():
        wrong = np.abs(found[f"{name}_acceleration"] - bend[k]).max()
        assert wrong < 1e-10 * np.abs(bend).max(), name


def joint_order(mechanism) -> list[int]:
    """The indices of the model's joints in the order of the source."""
    names = [joint.name for joint in mechanism.joints]
    return [names.index(name) for name in ANGLES]


def test_the_model_has_the_sources_mass_matrix_and_constraints():
    """They agree at random poses, in which the loops are open."""
    mechanism, _ = read(compile_model(), "start")
    poses = np.random.default_rng(5).uniform(-np.pi, np.pi, (20, 7))
    q = np.empty_like(poses)
    q[:, joint_order(mechanism)] = poses
    motion = move_bodies(mechanism, q)
    matrices = mass_matrix(mechanism, centre_jacobians(mechanism, motion))
    violations = loop_violations(mechanism, q)
    for p, matrix, gap in zip(poses, matrices, violations, strict=True):
        own = matrix[np.ix_(joint_order(mechanism), joint_order(mechanism))]
        np.testing.assert_allclose(own, andrews.mass_matrix(p), rtol=1e-13, atol=1e-19)
        np.testing.assert_allclose(gap, andrews.constraints(p), atol=1e-16, rtol=0)


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ('mass="0.02373"', 'mass="0.0237301"'),
        ("1.169e-5", "1.1691e-5"),
        ('stiffness="4530"', 'stiffness="4530.01"'),
        ('springlength="0.07785"', 'springlength="0.0778501"'),
        ('ctrl="0.033"', 'ctrl="0.0330001"'),
        ('pos="0.014 0.072 0"', 'pos="0.0140001 0.072 0"'),
    ],
)
def test_an_error_in_the_fifth_digit_changes_the_motion(wrong, right):
    """A mutation: after 0.01 s each error changes an angle by 1000 times the tolerance above."""
    assert wrong in MODEL_TEXT
    found = solve([0.0, 0.01], model=compile_model(MODEL_TEXT.replace(wrong, right)))
    there = np.array([found[name][-1] for name in ANGLES])
    assert np.abs(there - source_motion()[:7, 1]).max() > 3e-9
