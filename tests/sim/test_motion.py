"""Tests of the drawn motion of a mechanism: poses on both sides of a snap, and engines that snap
at other samples."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from proofmass.reference.evaluate import evaluate
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.motion import Measured, motion
from proofmass.sim.mujoco.engine import ENGINE
from tests.shipped import shipped

SNAP_SAMPLES = (16, 37)  # the first samples beyond each fold
LINK_COUNT = 10  # shapes of so few links are wrong by 1 % of the rod's length
PLACE_CHANNELS = "middle.x", "middle.y", "tip.angle"


@pytest.fixture
def snap(edit: Callable[..., Path]) -> Path:
    """The sidecar of `rod_snap` with a rod of ten links."""
    return edit("rod_snap.toml", "segments = 40", f"segments = {LINK_COUNT}")


@cache
def reference_curves() -> dict[str, np.ndarray]:
    """The reference's curves of `rod_snap`."""
    case = load_case(shipped("rod_snap.toml"))
    run = plan_run(case, "sweep", "mujoco")
    return dict(evaluate(case, "sweep", run.x, run.motion(run.x)).channels)


def link_starts(found, places: np.ndarray) -> np.ndarray:
    """Positions at which the links of the rod begin, (poses, links, 2)."""
    return places[:, list(found.rods["rod"]), :2]


def drawn_motion(file: Path, measured: Measured, count: int = 121):
    case = load_case(file)
    return motion(case.model_path, plan_run(case, "sweep", "mujoco"), measured, count)


def test_a_mechanism_is_drawn_on_both_sides_of_its_snaps(snap: Path) -> None:
    found = drawn_motion(snap, {})
    assert found.picture.stopped == ""
    assert found.jumps == SNAP_SAMPLES
    assert found.index.tolist() == list(range(43))
    starts = link_starts(found, found.places)
    assert (np.sign(starts[:, LINK_COUNT // 2, 1]) == np.sign(reference_curves()["middle.y"])).all()
    mirrored = starts[21::-1] * [1.0, -1.0]  # at the opposite angles of the motor
    for k in range(16, 22):  # beyond the snap the rod is the mirror image of its pose there
        np.testing.assert_allclose(
            starts[k], mirrored[k], atol=1e-8
        )  # square of Newton's last step


def test_a_few_drawn_poses_include_those_next_to_a_snap(snap: Path) -> None:
    found = drawn_motion(snap, {}, count=9)
    assert {15, 16, 36, 37} <= set(found.index.tolist())
    assert [found.index[k] for k in found.jumps] == list(SNAP_SAMPLES)
    assert len(found.index) < 25


def test_the_reference_is_drawn_beyond_the_snap(snap: Path) -> None:
    no_errors = {name: 0.0 * reference_curves()[name] for name in PLACE_CHANNELS}
    found = drawn_motion(
        snap, {"pymunk": ({n: reference_curves()[n] for n in PLACE_CHANNELS}, no_errors)}
    )
    assert found.unfit < 1e-3
    assert np.isfinite(found.away["pymunk"]).all()
    sides = np.sign(link_starts(found, found.places)[:, LINK_COUNT // 2, 1])
    assert (sides == np.sign(reference_curves()["middle.y"])).all()


def test_an_engine_that_snaps_later_is_drawn_on_its_own_side(snap: Path) -> None:
    """An engine snaps one sample late: it is drawn in the shape before the snap, at full length."""
    known = {name: reference_curves()[name] for name in PLACE_CHANNELS}
    late_errors = {name: 0.0 * curve for name, curve in known.items()}
    for name, curve in known.items():
        late_errors[name][16] = curve[15] - curve[16]
    found = drawn_motion(snap, {"pymunk": (known, late_errors)})
    assert found.unfit < 1e-3
    assert found.jumps == SNAP_SAMPLES
    sides = np.sign(link_starts(found, found.places)[:, LINK_COUNT // 2, 1])
    assert (sides == np.sign(reference_curves()["middle.y"])).all()
    engine_starts = link_starts(found, found.places + found.away["pymunk"])
    half = engine_starts[:, LINK_COUNT // 2]
    assert half[16] == pytest.approx(half[15], abs=5e-3)  # the motor has turned by 7 degrees
    assert half[17, 1] == pytest.approx(
        link_starts(found, found.places)[17, LINK_COUNT // 2, 1], abs=1e-9
    )
    lengths = np.linalg.norm(np.diff(engine_starts[16], axis=0), axis=1)
    # displacements by the Jacobian alone would make links up to twice as long
    assert lengths[1:] == pytest.approx(1.0 / LINK_COUNT, rel=1e-6)


def test_a_free_motion_with_a_drive_is_drawn_to_its_end() -> None:
    """The drawn samples are unevenly spaced.

    Drawn angles are off by up to half a step of 1 ms at 6 rad/s, which is 3e-3 rad.
    """
    case = load_case(shipped("driven_cart.toml"))
    run = plan_run(case, "dynamics", "mujoco")
    shown = motion(case.model_path, run, {}, 121)
    spacing = np.diff(shown.index)
    assert spacing.min() < spacing.max()
    assert (shown.picture.stopped, shown.index[-1]) == ("", run.x.size - 1)
    upper = ENGINE.simulate(case.model_path, run).channels["upper"][shown.index]
    turned = shown.places[:, -2, 2] - shown.places[0, -2, 2]
    assert np.ptp(upper) > 0.1
    np.testing.assert_allclose(turned, upper - upper[0], atol=3e-3)
