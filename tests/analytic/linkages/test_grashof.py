"""Grashof classes, limits, dead centres and change points of the four-bar, by independent means."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize_scalar
from test_fourbar import CRANK_PROFILE, DATA, GRID, LINK, MODES, TURN, check_loop_and_derivatives

from proofmass.analytic.linkages import fourbar

BARS = ("crank", "coupler", "rocker", "ground")
CLASSES = ("crank-rocker", "rocker-crank", "double crank", "double rocker", "triple rocker")
TABLE = DATA["grashof"]["rows"]
TRIPLE_ROCKER = {"crank": 2.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0}


def bar_lengths(lengths):
    return dict(zip(BARS, lengths, strict=True))


@st.composite
def linkages(draw, kind):
    """Lengths of one class; a margin of at least 0.03 keeps them away from change points."""
    scale, short, margin = draw(st.floats(1e-3, 1e3)), draw(st.floats(0.1, 0.8)), 0.03
    if kind == "triple rocker":
        total = draw(st.floats(max(2 * short, 1.0 - short) + margin, 1.0 + short - margin))
    else:
        total = draw(st.floats(1.0 + short + margin, 2.0 - margin))
    largest_difference = min(2.0 - total, total - 2.0 * short)
    half_difference = draw(st.floats(0.0, largest_difference)) / 2.0
    others = draw(
        st.permutations([1.0, total / 2.0 + half_difference, total / 2.0 - half_difference])
    )
    place = {"crank-rocker": 0, "double rocker": 1, "rocker-crank": 2, "double crank": 3}
    others.insert(place.get(kind, draw(st.integers(0, 3))), short)
    return bar_lengths([scale * x for x in others])


def turns_fully(crank, coupler, rocker, ground):
    """Whether the loop closes at every angle between the first and the last bar."""
    distance = np.hypot(crank * np.cos(GRID) - ground, crank * np.sin(GRID))
    return bool(np.all((distance <= coupler + rocker) & (distance >= abs(coupler - rocker))))


def crank_profile_in_range(link, share=0.85):
    """Periodic crank profile on GRID within the crank's range; a full turn where possible."""
    low, high = fourbar.crank_range(**link)
    if (low, high) == (0.0, np.pi):
        return CRANK_PROFILE
    if low == 0.0:
        low = -high
    elif high == np.pi:
        high = TURN - low
    half = share * (high - low) / 2.0
    return (low + high) / 2.0 + half * np.sin(GRID), half * np.cos(GRID), -half * np.sin(GRID)


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row["class"])
def test_classes_of_the_thesis_linkage_and_its_inversions(row):
    link = bar_lengths(row["lengths"])
    assert fourbar.classify(**link) == row["class"]
    assert fourbar.grashof_margin(**link) == row["margin"]
    if "high" in row:
        low, high = fourbar.crank_range(**link)
        assert low == 0.0
        assert high == pytest.approx(row["high"], abs=5.1e-10)  # half a unit of the last digit


@pytest.mark.parametrize("kind", CLASSES)
@settings(derandomize=True, max_examples=25, deadline=None)
@given(data=st.data())
def test_a_class_says_which_bars_turn_fully(kind, data):
    link = data.draw(linkages(kind))
    crank, coupler, rocker, ground = link.values()
    assert fourbar.classify(**link) == kind
    # full turns at A, at B, and at P of the coupler against the crank; GRID contains the extreme
    # angles 0 and pi
    turning = (
        turns_fully(crank, coupler, rocker, ground),
        turns_fully(rocker, coupler, crank, ground),
        turns_fully(coupler, rocker, ground, crank),
    )
    assert (
        turning
        == {
            "crank-rocker": (True, False, True),
            "rocker-crank": (False, True, False),
            "double crank": (True, True, False),
            "double rocker": (False, False, True),
            "triple rocker": (False, False, False),
        }[kind]
    )
    assert (fourbar.crank_range(**link) == (0.0, np.pi)) == turning[0]


@pytest.mark.parametrize("kind", CLASSES)
@settings(derandomize=True, max_examples=15, deadline=None)
@given(data=st.data(), mode=st.sampled_from(fourbar.MODES))
def test_loop_closes_and_derivatives_agree_in_every_class(kind, data, mode):
    link = data.draw(linkages(kind))
    profile = crank_profile_in_range(link)
    pose = fourbar.solve(*profile, **link, mode=mode)
    steep = max(np.abs(pose[f"{bar}_rate"]).max() for bar in ("coupler", "rocker"))
    assume(steep < 6.0)  # next to a pose with bars in line 512 samples do not resolve the curve
    pose = check_loop_and_derivatives(link, mode, profile)
    low, high = fourbar.transmission_range(**link)
    assert low <= pose["transmission_angle"].min() + 1e-12  # rounding of an angle
    assert high >= pose["transmission_angle"].max() - 1e-12


@pytest.mark.parametrize("kind", CLASSES)
@settings(derandomize=True, max_examples=15, deadline=None)
@given(data=st.data())
def test_crank_range_ends_where_the_loop_opens(kind, data):
    link = data.draw(linkages(kind))
    low, high = fourbar.crank_range(**link)
    for end, outside in ((low, -1e-6), (high, 1e-6)):
        if end in (0.0, np.pi):
            fourbar.solve(end, **link)
            continue
        for sign in (1.0, -1.0):
            fourbar.solve(sign * (end - outside), **link)
            with pytest.raises(ValueError, match="loop cannot close"):
                fourbar.solve(sign * (end + outside), **link)


@pytest.mark.parametrize("kind", CLASSES)
@settings(derandomize=True, max_examples=15, deadline=None)
@given(data=st.data(), mode=st.sampled_from(fourbar.MODES))
def test_dead_centres_are_where_the_rocker_turns_back(kind, data, mode):
    link = data.draw(linkages(kind))
    turns, ends = fourbar.dead_centres(**link, mode=mode)

    def rocker_rate(x):
        return float(fourbar.solve(x, **link, mode=mode)["rocker_rate"])

    angle, found = crank_profile_in_range(link, 1.0 - 1e-9)[0], set()
    for grid in (angle, -angle):  # -angle: the second interval of a crank that has two
        rate = fourbar.solve(grid, **link, mode=mode)["rocker_rate"]
        for k in np.flatnonzero(np.diff(np.sign(rate))):
            at = brentq(rocker_rate, *sorted(grid[k : k + 2]), xtol=1e-14)
            found.add(round(at % TURN, 6))
    assert found == {round(turn, 6) for turn in turns[~np.isnan(turns)]}
    for turn, end in zip(turns, ends, strict=True):
        if not np.isnan(turn):
            angle = fourbar.solve(turn, **link, mode=mode)["rocker_angle"]
            assert angle == pytest.approx(end, abs=1e-10)


@MODES
def test_swing_and_time_ratio_of_the_thesis(mode):
    printed = DATA["limits"]
    turns, ends = fourbar.dead_centres(**LINK, mode=mode)
    # half a unit of the last digit, here and below
    degrees = np.sort(np.degrees(-mode * ends))
    np.testing.assert_allclose(degrees, printed["rocker_deg"], rtol=0, atol=5.1e-7)
    np.testing.assert_allclose(
        np.sort(-mode * turns % TURN), printed["crank_rad"], rtol=0, atol=5.1e-11
    )
    assert np.degrees(fourbar.swing_angle(**LINK)) == pytest.approx(
        printed["swing_deg"], abs=5.1e-8
    )
    assert fourbar.time_ratio(**LINK) == pytest.approx(printed["time_ratio"], abs=5.1e-11)
    ends = np.degrees(fourbar.transmission_range(**LINK))
    for found, degrees in zip(ends, ("0", "180"), strict=True):
        expected = printed["transmission_deg"][degrees]
        assert found == pytest.approx(expected, abs=5.1e-8)
        pose = fourbar.solve(np.radians(float(degrees)), **LINK, mode=mode)
        assert np.degrees(pose["transmission_angle"]) == pytest.approx(expected, abs=5.1e-8)


@settings(derandomize=True, max_examples=15, deadline=None)
@given(link=linkages("crank-rocker"))
def test_swing_is_the_range_of_the_rocker(link):
    def rocker(x, sign):
        return sign * float(fourbar.solve(x, **link)["rocker_angle"])

    coarse = fourbar.solve(GRID, **link)["rocker_angle"]
    found = {}
    for sign in (1, -1):
        middle, step = GRID[np.argmin(sign * coarse)], GRID[1]
        found[sign] = minimize_scalar(
            rocker, (middle - step, middle, middle + step), args=(sign,), tol=1e-12
        )
    # the height of an extreme is exact to rounding; its position has half as many digits
    assert -found[-1].fun - found[1].fun == pytest.approx(fourbar.swing_angle(**link), abs=1e-13)
    part = abs(found[1].x - found[-1].x) % TURN
    ratio = max(part, TURN - part) / min(part, TURN - part)
    assert ratio == pytest.approx(fourbar.time_ratio(**link), rel=1e-6)


def test_only_a_crank_rocker_has_a_swing_and_a_time_ratio():
    for function in (fourbar.swing_angle, fourbar.time_ratio):
        with pytest.raises(ValueError, match="must make a crank-rocker, these make a triple"):
            function(**TRIPLE_ROCKER)


@pytest.mark.parametrize("longest", BARS)
def test_a_bar_as_long_as_the_others_together_leaves_one_pose(longest):
    """All bars are in line. The lengths are whole numbers, so that nothing is rounded."""
    link = dict.fromkeys(BARS, 1.0) | {longest: 3.0}
    assert fourbar.classify(**link) == "triple rocker"
    low, high = fourbar.crank_range(**link)
    assert (low, high) == ((0.0, 0.0) if longest in ("crank", "ground") else (np.pi, np.pi))
    pose = fourbar.solve(low, **link, only={"pin_x", "pin_y", "transmission_angle"})
    straight = np.pi if longest in ("crank", "ground") else 0.0  # stretched at pi
    assert pose["transmission_angle"] == pytest.approx(straight, abs=1e-15)
    assert abs(pose["pin_y"]) < 1e-15  # sin(pi), rounded
    with pytest.raises(ValueError, match="cannot close"):
        fourbar.solve(low + 1e-3, **link)


def test_bad_lengths_are_named():
    with pytest.raises(ValueError, match=r"^coupler must be a positive"):
        fourbar.classify(**{**LINK, "coupler": -2.0})
    with pytest.raises(ValueError, match=r"^ground must not be longer .* they miss by 44 m"):
        fourbar.crank_range(crank=1.0, coupler=2.0, rocker=3.0, ground=50.0)
    with pytest.raises(ValueError, match="mode must be"):
        fourbar.dead_centres(**LINK, mode=2)


def test_an_unreachable_angle_is_named_with_its_violation():

    limit = np.arccos((13.0 - 20.25) / 12.0)  # crank, ground and coupler + rocker form a triangle
    fourbar.solve([-limit, limit], **TRIPLE_ROCKER)
    violation = np.sqrt(13.0 - 12.0 * np.cos(limit + 0.02)) - 4.5
    with pytest.raises(ValueError, match=rf"angle {limit + 0.02:.9g} rad: .* by {violation:.6g} m"):
        fourbar.solve([0.0, limit, limit + 0.02, 3.0], **TRIPLE_ROCKER)
    with pytest.raises(ValueError, match=r"angle 0 rad: .* miss by 44 m"):
        fourbar.solve([0.0, 1.0], crank=1.0, coupler=2.0, rocker=3.0, ground=50.0)
    with pytest.raises(ValueError, match=r"angle 0 rad: .* miss by 2\.9 m"):  # P too near to B
        fourbar.solve(0.0, crank=2.9, coupler=4.0, rocker=1.0, ground=3.0)
    with pytest.raises(ValueError, match=r"miss by 1\.\d+e-12 m"):
        fourbar.solve(limit + 1e-12, **TRIPLE_ROCKER)


@pytest.mark.parametrize("angle", [-1.0, 1.0])
def test_limit_of_the_crank_is_reached_without_finite_rates(angle):
    link = {"crank": 2.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0}
    pose = fourbar.solve(angle * np.arccos((13.0 - 20.25) / 12.0), **link)
    # coupler and rocker are in line: the square root of the rounding of the limit
    assert pose["transmission_angle"] == pytest.approx(np.pi, abs=1e-7)
    assert not abs(pose["rocker_rate"]) < 1e7
    with pytest.raises(ValueError, match="rocker angle undefined"):
        fourbar.solve(0.0, crank=1.0, coupler=2.0, rocker=2.0, ground=1.0)
