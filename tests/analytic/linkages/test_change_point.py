"""Motion of the four-bar through change points: all bars are in line, both assembly modes meet."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from test_fourbar import GRID, MODES, TURN, assert_close, check_loop_and_derivatives
from test_grashof import bar_lengths

from proofmass.analytic.linkages import fourbar
from tests.analytic.linkages.spectral import derivative

OUTER = bar_lengths([1.0, 2.0, 2.0, 3.0])  # bars in line at pi: crank + ground = coupler + rocker
INNER = bar_lengths([1.0, 1.5, 2.5, 2.0])  # bars in line at 0: ground - crank = rocker - coupler
BUTTERFLY = bar_lengths([1.0, 2.0, 1.0, 2.0])  # in line at 0 and pi; mode +1 is the parallelogram
TWO_TURNS = 2.0 * GRID, np.full(GRID.size, 2.0), np.zeros(GRID.size)  # with samples at 0 and pi
LEAST_SINE = 0.2
"""Sine by whose square rounding is divided: the bars pass through a line, where the rates solve a
quadratic instead of a division by the sine of the transmission angle."""


@MODES
@pytest.mark.parametrize("link", [OUTER, INNER], ids=["outer", "inner"])
def test_motion_is_smooth_over_two_turns_through_a_change_point(link, mode):
    check_loop_and_derivatives(link, mode, TWO_TURNS, LEAST_SINE)


def test_butterfly_four_bar_moves_smoothly():
    pose = check_loop_and_derivatives(BUTTERFLY, -1, TWO_TURNS, LEAST_SINE)
    motion = [curve for name, curve in pose.items() if "_force_" not in name]
    assert not np.isnan(motion).any()


@settings(derandomize=True, max_examples=40, deadline=None)
@given(
    st.lists(st.floats(0.2, 1.0), min_size=3, max_size=3),
    st.floats(1e-3, 1e3),
    st.permutations(range(4)),
    st.sampled_from(fourbar.MODES),
)
def test_random_linkages_are_smooth_through_their_change_points(three, scale, order, mode):
    p, q, shortest = sorted(three, reverse=True)
    assume(min(p - q, q - shortest) > 0.05)  # a parallelogram or a kite has constant curves, and
    # `assert_close` divides by the range of a curve
    lengths = np.array([shortest, p, q, p + q - shortest])[order] * scale
    link = bar_lengths(lengths.tolist())
    assert fourbar.classify(**link) == "change point"
    low, high = fourbar.crank_range(**link)
    assert (low == 0.0) or (high == np.pi)
    # the crank swings through one change point and back
    half = 0.8 * (np.pi - low if high == np.pi else high)
    middle = np.pi if high == np.pi else 0.0
    profile = middle + half * np.sin(GRID), half * np.cos(GRID), -half * np.sin(GRID)
    reach = np.hypot(
        link["crank"] * np.cos(profile[0]) - link["ground"], link["crank"] * np.sin(profile[0])
    )
    assume(reach.min() > 0.2 * scale)  # closer to B the rates are too steep for 512 samples
    check_loop_and_derivatives(link, mode, profile, LEAST_SINE)


def test_rates_at_the_change_point_solve_the_quadratic():
    """All bars lie along x, and the signed lengths of the bars enter both derivatives of the loop.

    The first derivative is sum(rate * bar) = 0, the second is sum(rate^2 * bar) = 0.
    """
    found = sorted(
        float(fourbar.solve(np.pi, **OUTER, mode=mode)["rocker_rate"]) for mode in fourbar.MODES
    )
    # -1 + 2 coupler' = -2 rocker' and -1 + 2 coupler'^2 = -2 rocker'^2, coupler' eliminated
    roots = np.roots([4.0, -2.0, -0.5])
    np.testing.assert_allclose(found, np.sort(roots), rtol=1e-15)  # rounding
    pose = fourbar.solve(np.pi, **OUTER)
    assert pose["pin_x"] == pytest.approx(1.0, abs=1e-15)  # exact value
    assert pose["transmission_angle"] == pytest.approx(np.pi, abs=1e-15)


@MODES
def test_beyond_a_change_point_a_linkage_without_one_has_the_other_mode(mode):
    angle = np.linspace(np.pi + 0.5, 3.0 * np.pi - 0.5, 101)
    pose = fourbar.solve(angle, **OUTER, mode=mode)
    shorter = {**OUTER, "ground": 3.0 - 1e-12}  # no change point: nearly in line at pi
    other = fourbar.solve(angle, **shorter, mode=-mode)
    for name, curve in pose.items():
        finite = np.abs(curve) < 1e2 if name == "mechanical_advantage" else np.isfinite(curve)
        # the change of length, 1e-12, times slopes of up to 1e4 where the advantage is up to 1e2
        np.testing.assert_allclose(
            curve[finite] % TURN,
            other[name][finite] % TURN,
            rtol=0,
            atol=1e-10 if "angle" in name else 1e-7,
            err_msg=name,
        )


def test_mode_is_the_side_of_the_pin_between_0_and_pi():
    angle = np.array([-7.0, -4.0, -1.0, 1.0, 4.0, 7.0])
    for link, wave in (
        (OUTER, np.cos(angle / 2)),
        (INNER, np.sin(angle / 2)),
        (BUTTERFLY, np.sin(angle)),
    ):
        for mode in fourbar.MODES:
            pose = fourbar.solve(angle, **link, mode=mode)
            crank_pin = link["crank"] * np.exp(1j * angle)
            over = pose["pin_x"] + 1j * pose["pin_y"] - crank_pin
            cross = ((link["ground"] - crank_pin).conj() * over).imag
            np.testing.assert_array_equal(np.sign(cross), mode * np.sign(wave))


def test_parallelogram_and_kite_have_their_known_motions():
    pose = fourbar.solve(2.0 * GRID, **BUTTERFLY, mode=1)
    # rounding of angles of up to two turns
    np.testing.assert_allclose(pose["rocker_angle"], 2.0 * GRID, rtol=0, atol=1e-14)
    np.testing.assert_allclose(pose["coupler_angle"], 0.0, rtol=0, atol=1e-15)
    np.testing.assert_allclose(pose["rocker_rate"], 1.0, rtol=0, atol=1e-14)
    folded = fourbar.solve(2.0 * GRID, **bar_lengths([1.0, 1.0, 2.0, 2.0]), mode=-1)
    assert np.hypot(folded["pin_x"], folded["pin_y"]).max() <= 1e-14  # the pin stays in A; rounding
    assert np.abs(folded["rocker_rate"]).max() <= 1e-14


@MODES
def test_a_kite_whose_crank_pin_meets_the_fixed_pin_moves_smoothly(mode):
    link, half_step = bar_lengths([2.0, 1.0, 1.0, 2.0]), GRID[1] / 2.0
    profile = 0.5 * np.sin(GRID + half_step), 0.5 * np.cos(GRID + half_step), np.zeros(GRID.size)
    pose = fourbar.solve(*profile, **link, mode=mode)
    slope = derivative(pose["pin_y"])
    assert_close(pose["pin_vy"], slope, 1e-10)  # as in check_loop_and_derivatives
    with pytest.raises(ValueError, match="rocker angle undefined"):
        fourbar.solve(0.0, **link, mode=mode)


def test_dead_centres_leave_out_the_change_point():
    turns, ends = fourbar.dead_centres(**OUTER)
    np.testing.assert_array_equal(np.isnan(turns), [False, True])
    pose = fourbar.solve(turns[0], **OUTER)
    assert pose["rocker_rate"] == pytest.approx(0.0, abs=1e-15)  # rounding
    assert pose["rocker_angle"] == pytest.approx(ends[0], abs=1e-15)


@pytest.mark.parametrize("gap", [1e-3, 1e-7, 1e-12])
@pytest.mark.parametrize("link", [OUTER, INNER], ids=["outer", "inner"])
def test_margins_have_all_digits_next_to_a_change_point(link, gap):
    """Sums of lengths that were rounded before their difference left 2e-3 of the pin's height."""
    near = {**link, "rocker": link["rocker"] + (gap if link is OUTER else -gap)}
    crank, coupler, rocker, ground = map(Fraction, near.values())
    exact = (
        (coupler + rocker) ** 2 - (crank + ground) ** 2,
        (crank - ground) ** 2 - (coupler - rocker) ** 2,
    )
    found = fourbar.assembly_margins(**near)
    # rounding of two sums and of a product
    np.testing.assert_allclose(found, [float(one) for one in exact], rtol=4e-16)
