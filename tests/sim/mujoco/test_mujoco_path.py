"""Tests that poses of a sweep closed together equal poses that are closed one after the other."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from proofmass.run.solve import plan_run
from proofmass.sim.mujoco import linkage
from proofmass.sim.mujoco.engine import simulate
from proofmass.sim.mujoco.equilibrium import linkage_of
from proofmass.sim.mujoco.linkage import Linkage, interpolate_poses
from proofmass.sim.mujoco.model import load
from proofmass.sim.protocol.curves import Curves
from tests.shipped import shipped, shipped_case

CLOSED_TOGETHER = {  # cases, and whether all poses of their sweeps are closed together
    "fourbar": True,
    "fivebar_circle": True,
    "threeprr_circle": True,
    "hacksaw": True,
    "peaucellier": True,
    "universal_joint": True,
    "spherical_fourbar": True,
    "delta": False,  # the rotation of its platform is a quaternion
    "gear_pair": False,  # the spacing of its samples is that of strides
    "change_point": False,  # it is singular in the middle
}


def swept_curves(name: str) -> Curves:
    """Curves of a shipped sweep, of its first 240 poses at most."""
    case = shipped_case(shipped(f"{name}.toml"))
    run = plan_run(case, "sweep", "mujoco")
    return simulate(case.model_path, replace(run, x=run.x[:240]))


@cache
def curves_one_by_one(name: str) -> Curves:
    """The same curves, with poses that are closed one after the other."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Linkage, "together", lambda *given: None)
        return swept_curves(name)


def largest_difference(one: Curves, two: Curves) -> float:
    """The largest difference of two runs, as a share of the range or of 1 if that is more."""
    return max(
        float(np.abs(one.channels[name] - two.channels[name]).max())
        / max(1.0, float(np.ptp(two.channels[name])))
        for name in two.channels
    )


@pytest.fixture
def blocks(monkeypatch) -> list[bool]:
    """Filled in a sweep: whether the poses of each block were closed together."""
    found, whole = list[bool](), Linkage.together

    def noted(self, *given):
        result = whole(self, *given)
        found.append(result is not None)
        return result

    monkeypatch.setattr(Linkage, "together", noted)
    return found


@pytest.mark.parametrize("name", CLOSED_TOGETHER)
def test_poses_closed_together_equal_those_closed_one_by_one(name, blocks):
    found = swept_curves(name)
    assert all(blocks) == CLOSED_TOGETHER[name]
    assert found.stopped == curves_one_by_one(name).stopped
    # rounding, magnified by the transmission: the largest is 70 eps, where the spherical four-bar
    # has its largest accelerations; it would be 530 eps in the universal joint with the inverse of
    # another pose
    assert largest_difference(found, curves_one_by_one(name)) < 5e-14


SLOWER_METHODS = {
    "an inverse in every step": ("MAX_CHORD_DISTANCE", 0.0),
    "singular values": ("MAX_CONDITION", 0.0),
    "guesses by tangents": ("MAX_BEND_RATIO", 0.0),
}


@pytest.mark.parametrize("how", SLOWER_METHODS)
@pytest.mark.parametrize("name", ["delta", "gear_pair", "change_point", "fivebar"])
def test_poses_closed_one_by_one_equal_those_of_slower_methods(name, how, monkeypatch):
    found = curves_one_by_one(name)
    monkeypatch.setattr(Linkage, "together", lambda *given: None)
    monkeypatch.setattr(linkage, *SLOWER_METHODS[how])
    slower = swept_curves(name)
    assert found.stopped == slower.stopped
    assert largest_difference(found, slower) < 1e-11


def fourbar_linkage() -> Linkage:
    case = shipped_case(shipped("fourbar.toml"))
    run = plan_run(case, "sweep", "mujoco")
    return linkage_of(*load(case.model_path, run), run)


def test_a_guess_by_the_last_stride_is_of_fourth_order():
    """A guess by the last stride has an error of order 4, a guess by the tangent one of order 2."""
    errors = []
    for stride in (0.08, 0.04, 0.02):
        four = fourbar_linkage()
        tangent = four.move(np.array([1.0]))
        tangent = four.move(np.array([1.0 + stride]), tangent)
        here, target = four.data.qpos.copy(), np.array([1.0 + 2 * stride])
        guesses = here + np.array([four.ahead(target, tangent), tangent @ [stride]])
        four.place(target)
        errors.append(np.abs(guesses - four.data.qpos).max(axis=1))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders[-1], [4.0, 2.0], atol=0.2)


def test_elimination_refuses_matrices_that_may_be_singular():
    four = fourbar_linkage()
    scaled = four.scaled(four.rows()[1])
    inverse = four.invert_by_elimination(scaled, linkage.MAX_CONDITION)
    np.testing.assert_allclose(inverse / four.shares.T @ scaled, np.eye(3), atol=1e-14, rtol=0)
    assert four.invert_by_elimination(scaled, np.linalg.cond(scaled)) is None
    assert four.invert_by_elimination(scaled[[0, 0, 2, 3]], linkage.MAX_CONDITION) is None
    assert (
        four.invert_by_elimination(np.vstack([scaled, scaled[:1]]), linkage.MAX_CONDITION) is None
    )


@pytest.mark.parametrize(
    "spoil", [lambda poses: poses + 0.05, lambda poses: poses * np.nan], ids=["far", "no number"]
)
def test_wrong_guesses_of_poses_are_not_taken(
    spoil: Callable[[np.ndarray], np.ndarray], blocks, monkeypatch
):
    wanted = swept_curves("fourbar")
    monkeypatch.setattr(
        linkage, "interpolate_poses", lambda *given: spoil(interpolate_poses(*given))
    )
    found = swept_curves("fourbar")
    assert blocks == [True, False]
    assert largest_difference(found, wanted) < 1e-11


def test_blocks_of_poses_begin_where_the_last_one_ended(blocks, monkeypatch):
    wanted = swept_curves("fourbar")
    monkeypatch.setattr(linkage, "POSES_PER_BLOCK", 60)
    found = swept_curves("fourbar")
    assert blocks == [True] * 5
    assert largest_difference(found, wanted) < 1e-11


def test_a_sweep_to_a_limit_position_ends_as_one_by_one(blocks, monkeypatch):
    """The drive of a linkage that can only oscillate is made to turn on."""
    case = shipped_case(shipped("double_rocker.toml"))
    run = plan_run(case, "sweep", "mujoco")
    (drive,) = run.drives
    begin = float(drive.profile(run.x)[0][0])

    def further(x: np.ndarray) -> tuple[np.ndarray, ...]:
        value, rate, acceleration = drive.profile(x)
        return begin + 3.0 * (value - begin), 3.0 * rate, 3.0 * acceleration

    run = replace(run, drives=(replace(drive, profile=further),))
    found = simulate(case.model_path, run)
    assert found.stopped
    assert blocks == [False]
    monkeypatch.setattr(Linkage, "together", lambda *given: None)
    followed = simulate(case.model_path, run)
    assert (found.stopped, found.x.size) == (followed.stopped, followed.x.size)


def test_guesses_are_exact_for_polynomials_of_third_degree():
    """On the straight line of the drives, guesses are exact; off it they add linear terms."""
    x = np.linspace(0.0, 1.0, 13)
    drives = np.column_stack([x, 2.0 * x])
    knots = np.array([0, 6, 12])

    def pose(d: np.ndarray) -> np.ndarray:
        return np.column_stack([d[:, 0] ** 3 - d[:, 1], d[:, 1] ** 2])

    tangents = np.array([[[3 * a**2, -1.0], [0.0, 2 * b]] for a, b in drives[knots]])
    guess = interpolate_poses(drives, knots, pose(drives[knots]), tangents)
    assert np.abs(guess - pose(drives)).max() < 1e-15
    aside = drives.copy()
    aside[3] += [-0.002, 0.001]  # across the line
    error = interpolate_poses(aside, knots, pose(drives[knots]), tangents)[3] - pose(aside)[3]
    assert np.abs(error).max() < 1e-3  # tangents of the knots instead of those of the pose
    assert np.abs(pose(drives)[3] - pose(aside)[3]).max() > 1.3e-3
