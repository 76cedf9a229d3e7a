"""Loops of a moment over an angle: branches, area and work against closed forms."""

import numpy as np
import pytest

from proofmass.analytic.balancer.measures import work_reduction
from proofmass.analytic.hysteresis import HysteresisLoop, find_ways

END, FRICTION, SIZE = 1.4, 0.05, 2.0
"""Largest angle [rad], moment of friction [N m], and size of the sine [N m]."""


def cycles(count: int, rows: int = 281) -> tuple[np.ndarray, np.ndarray]:
    """Angle and moment of a sine with dry friction, some cycles up and down."""
    up = np.linspace(0.0, END, rows)
    angle = np.concatenate([part for _ in range(count) for part in (up, up[::-1])])
    side = np.tile(np.repeat([1.0, -1.0], rows), count)
    return angle, SIZE * np.sin(angle) + FRICTION * side


@pytest.mark.parametrize("count", [1, 3])
def test_the_area_is_twice_the_friction_times_the_way(count: int) -> None:
    loop = HysteresisLoop(*cycles(count))
    assert [one.rises for one in loop.branches] == [True, False] * count
    assert loop.area == pytest.approx(2.0 * FRICTION * END, rel=1e-12)
    assert loop.half_width == pytest.approx(FRICTION, rel=1e-12)


def test_noise_of_the_angle_makes_no_branch() -> None:
    """Noise of a fifth of a degree, which is 0.7 of the spacing of rows."""
    angle, moment = cycles(2)
    noisy = angle + 3.5e-3 * np.random.default_rng(1).standard_normal(angle.size)
    loop = HysteresisLoop(noisy, moment)
    assert [one.rises for one in loop.branches] == [True, False, True, False]
    assert loop.area == pytest.approx(2.0 * FRICTION * END, rel=0.01)  # the ends are 0.01 rad off


def test_the_first_way_is_left_out_if_it_is_no_whole_one() -> None:
    """A loop that begins in the middle: its first part has another moment, as friction may have."""
    angle, moment = cycles(1)
    half = np.linspace(0.7, 0.0, 100)
    loop = HysteresisLoop(
        np.concatenate([half, angle]), np.concatenate([np.full(100, 9.0), moment])
    )
    assert len(loop.branches) == 3
    assert len(loop.whole) == 2
    assert loop.area == pytest.approx(2.0 * FRICTION * END, rel=1e-12)


def test_works_are_those_of_the_branches_and_of_the_definition() -> None:
    loop = HysteresisLoop(*cycles(1))
    found = loop.errors(dict.fromkeys(("up", "down"), lambda angle: SIZE * np.sin(angle)))
    missing, work = FRICTION * END, SIZE * (1.0 - np.cos(END))
    assert found.rms == pytest.approx(FRICTION, rel=1e-12)
    assert found.largest == pytest.approx(FRICTION, rel=1e-12)
    for name in ("up", "down", "both"):  # trapezoids of the sine: h^2 / 12 = 2e-6
        assert found.reductions[name] == pytest.approx(100.0 * (1.0 - missing / work), rel=1e-5)
    side = loop.sides["up"]
    assert found.reductions["up"] == float(
        work_reduction(side.moment, SIZE * np.sin(side.angle), side.angle)
    )


def test_both_branches_weigh_by_their_work() -> None:
    """Against a reference whose branches differ the reduction is that of the sums of both works."""
    loop = HysteresisLoop(*cycles(1))
    flat = {"up": lambda angle: np.full(angle.size, 3.0), "down": lambda angle: np.ones(angle.size)}
    found = loop.errors(flat)
    parts = {name: 1.0 - found.reductions[name] / 100.0 for name in ("up", "down")}
    assert found.reductions["both"] == pytest.approx(
        100.0 * (1.0 - (3.0 * parts["up"] + parts["down"]) / 4.0), rel=1e-12
    )


def test_fits_give_back_what_was_put_in() -> None:
    loop = HysteresisLoop(*cycles(1))
    assert loop.sine() == pytest.approx(SIZE, rel=1e-12)
    angle, _ = cycles(1)
    curve = 0.1 + 0.3 * angle - 0.2 * angle**3
    found = HysteresisLoop(angle, curve + 0.01 * np.sign(np.arange(angle.size) - 280.5)).fit(3)
    assert found.convert().coef == pytest.approx([0.1, 0.3, 0.0, -0.2], abs=1e-11)


def test_uneven_rows_do_not_weigh_more() -> None:
    """Ten times as many rows in the first half change neither area nor fit."""
    half = np.concatenate([np.linspace(0.0, 0.7, 1001), np.linspace(0.7, END, 101)[1:]])
    angle = np.concatenate([half, half[::-1]])
    moment = SIZE * np.sin(angle) + FRICTION * np.repeat([1.0, -1.0], half.size)
    loop = HysteresisLoop(angle, moment)
    assert loop.area == pytest.approx(2.0 * FRICTION * END, rel=1e-12)
    even = HysteresisLoop(*cycles(1)).fit(2)
    uneven = loop.fit(2)
    at = np.linspace(0.0, END, 7)
    assert uneven(at) == pytest.approx(even(at), abs=1e-5)  # trapezoids of both


@pytest.mark.parametrize("rows", [[1.0, 1.0, 1.0], [0.0, 1.0]])
def test_rows_without_a_branch_are_an_error(rows: list[float]) -> None:
    with pytest.raises(ValueError, match="branch"):
        HysteresisLoop(rows, rows)


def test_a_loop_of_small_pieces_is_an_error() -> None:
    """Each way goes over a half of the range: no branch is whole."""
    ends = np.array([0.0, 0.5, 0.25, 0.75, 0.5, 1.0])
    angle = np.interp(np.linspace(0.0, 5.0, 501), np.arange(6.0), ends)
    with pytest.raises(ValueError, match="no branch covers 80% of the range"):
        HysteresisLoop(angle, angle)


def test_ways_end_at_the_extremes() -> None:
    angle = np.sin(np.linspace(0.0, 4.0 * np.pi, 401))
    assert find_ways(angle, 0.1) == [(0, 50), (50, 150), (150, 250), (250, 350), (350, 400)]
