"""All poses of a 3PRR robot: the document's polynomial and tables, parallel legs, folds."""

import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from proofmass.analytic.linkages import threeprr
from proofmass.analytic.linkages.threeprr import poses
from tests.analytic.linkages.threeprr_tables import (
    DATA,
    LENGTHS,
    POSE_NAMES,
    SIX_POSES,
    SLIDERS,
    TABLE3,
    TABLE4,
    TABLE5,
    TABLE6,
    corners,
    leg_errors,
    nearest_distance,
    pose_rows,
    slider_triples,
)

RANDOM_SETTINGS = settings(derandomize=True, max_examples=60, deadline=None)


def document_polynomial(sliders, where):
    """Polynomial of degree 8 in t = tan(psi/2) of eqs 146-148, and their denominator `den`.

    Its coefficients begin with the lowest power and are divided by those of the largest term.
    """
    l1, l2, l3 = sliders
    a, b2, b3, h3 = (where[k] for k in ("side", "guide2_x", "guide3_x", "guide3_y"))

    def linear(cosine, sine, constant):  # times 1 + t^2
        return np.array([cosine + constant, 2.0 * sine, constant - cosine])

    def times(*factors):
        result = np.ones(1)
        for factor in factors:
            result = np.convolve(result, factor)
        return result

    r = np.sqrt(3.0)
    f1 = linear(2 * a, 0, 2 * l1 + 2 * (l2 - b2))
    f2 = linear(0, 2 * a, 0)
    f3 = linear(2 * a * (l2 - b2), 0, -(l1**2) + a**2 + (l2 - b2) ** 2)
    g1 = linear(a, -a * r, 2 * (l1 - b3))
    g2 = linear(a * r, a, 2 * (l3 - h3))
    g3 = linear(
        a * r * (l3 - h3) - a * b3,
        a * (l3 - h3) + a * r * b3,
        -(l1**2) + b3**2 + a**2 + (l3 - h3) ** 2,
    )
    den = times(f2, g1) - times(f1, g2)
    x, y = times(f3, g2) - times(f2, g3), times(f1, g3) - times(f3, g1)
    x = x - l1 * den
    terms = times(x, x), times(y, y), -(where["leg"] ** 2) * times(den, den)
    return sum(terms) / max(np.abs(term).max() for term in terms), den


@st.composite
def mechanisms(draw):
    """A mechanism, and a pose that all its legs reach with a margin."""
    leg, ratio = draw(st.floats(0.1, 10.0)), draw(st.floats(0.2, 1.8))
    where = {"side": ratio * leg, "leg": leg, "guide2_x": leg * draw(st.floats(-3.0, 5.0))}
    psi = draw(st.floats(-3.0, 3.0))
    rise = ratio * np.sin(psi)
    low, high = max(-1.0, -1.0 - rise) + 0.01, min(1.0, 1.0 - rise) - 0.01
    assume(low < high)
    y = leg * (low + (high - low) * draw(st.floats(0.0, 1.0)))
    x = leg * draw(st.floats(-2.0, 4.0))
    third = corners(x, y, psi, where["side"])[2]
    where |= {
        "guide3_x": third.real + 0.99 * leg * draw(st.floats(-1.0, 1.0)),
        "guide3_y": leg * draw(st.floats(-3.0, 5.0)),
    }
    return where, np.array([x, y, psi])


@pytest.mark.parametrize("table", [TABLE5, TABLE6, SIX_POSES], ids=("table 5", "table 6", "six"))
def test_direct_poses_are_those_of_the_tables(table):
    found = pose_rows(poses(table["sliders"], **table["where"]))
    expected = np.array(table["poses"]) * [1, 1, np.pi / 180]
    assert len(found) == len(expected)
    # Tables 5 and 6 print 4 to 5 decimals and degrees to 1e-4; six poses have 6 decimals
    close = 1e-6 if table is SIX_POSES else 5.1e-5
    assert max(nearest_distance(found, pose) for pose in expected) <= close
    for mode in threeprr.MODES[: len(expected)]:
        pose = threeprr.solve(table["sliders"], **table["where"], mode=mode)
        assert nearest_distance(found, [pose[n] for n in POSE_NAMES]) == 0.0
        assert np.sign(pose["singularity"]) == np.sign(mode)


def test_slider_triples_of_both_tables_lead_back_to_their_pose():
    for table in (TABLE3, TABLE4):
        where, (x, y, degrees) = table["where"], table["pose"].values()
        pose = [x, y, np.radians(degrees)]
        for triple in slider_triples(pose, where):
            found = pose_rows(poses(triple, **where))
            assert nearest_distance(found, pose) <= 1e-12  # rounding over a determinant of 1e-3
            assert len(found) in (2, 4, 6)


def test_four_triples_of_table_3_have_parallel_legs():
    """Then eqs 146 and 147 are 0/0: the document's program can print only a singular position."""
    where, pose = TABLE3["where"], [0.6, 0.4, 0.0]
    for signs, triple in zip(threeprr.SIGNS, slider_triples(pose, where), strict=True):
        found = poses(triple, **where)
        parallel, (p, den) = signs[0] != signs[1], document_polynomial(triple, where)
        assert found["parallel"].sum() == 2 * parallel
        # rounding of terms of up to 10 m^2; two poses at psi = 0 are a double root at t = 0
        assert (abs(den[0]) <= 1e-14) == (np.abs(p[:2]).max() <= 1e-14) == parallel
        np.testing.assert_allclose(found["psi"][found["parallel"]], 0.0, atol=1e-14)  # rounding
        if np.allclose(triple, [row[0] for row in TABLE3["sliders"]], atol=1e-4):
            expected = [[*xy, 0.0] for xy in DATA["parallel"]["poses"]]
            # last printed digit
            assert max(nearest_distance(pose_rows(found), e) for e in expected) <= 5.1e-7


@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (1, 2)])
@pytest.mark.parametrize("off", [0.0, 1e-15, 1e-12, -1e-9, 1e-8, -1e-6, 1e-4])
def test_poses_are_found_with_any_two_legs_parallel(pair, off):
    """Two poses with almost the same psi are found, also on both sides of the double root."""
    leg, lean = 1.1, np.array([1.9, 2.6, 0.4])
    lean[pair[1]] = lean[pair[0]] + off
    c = np.array(corners(0.0, 0.0, 0.7, 1.0)) - leg * np.exp(1j * lean)
    axis = np.angle(c[1] - c[0])
    c, start = (c - c[0]) * np.exp(-1j * axis), -c[0] * np.exp(-1j * axis)  # C1 and C2 on y = 0
    where = {
        "side": 1.0,
        "leg": leg,
        "guide2_x": c[1].real,
        "guide3_x": c[2].real,
        "guide3_y": c[2].imag,
    }
    found, sliders = poses(np.zeros(3), **where), np.zeros(3)
    rows = pose_rows(found)
    # rounding over 1e-3
    assert nearest_distance(rows, [start.real, start.imag, 0.7 - axis]) <= 1e-12
    assert len(rows) == 2 * np.sum(found["singularity"] > 0)
    assert found["parallel"].sum() == 2 * (abs(off) < 1e-7)
    assert np.abs(leg_errors(rows.T, sliders, where)).max() <= 1e-14  # rounding


@pytest.mark.parametrize("count", [20, pytest.param(60, marks=pytest.mark.slow)])
def test_round_trip_of_random_mechanisms(count):
    @settings(RANDOM_SETTINGS, max_examples=count)
    @given(mechanisms())
    def run(mechanism):
        where, pose = mechanism
        size = where["leg"] + where["side"] + np.abs([*pose[:2], *list(where.values())[2:]]).max()
        for triple in slider_triples(pose, where):
            assert np.abs(leg_errors(pose, triple, where)).max() <= 1e-15 * size  # rounding
            found = poses(triple, **where)
            rows = pose_rows(found)
            assert np.abs(leg_errors(rows.T, triple, where)).max() <= 3e-14 * size  # rounding
            near = np.argmin(np.abs(rows - pose).max(axis=1))
            if abs(found["singularity"][near]) > 1e-3:  # rounding over the determinant
                assert nearest_distance(rows, pose) <= 1e-11 * max(1.0, size)

    run()


@RANDOM_SETTINGS
@given(st.floats(0.2, 3.0), st.tuples(*[st.floats(-1.0, 3.0)] * 6))
def test_poses_are_the_roots_of_the_document_polynomial(side, numbers):
    """Errata: the polynomial of degree 8 has the factor 1 + t^2, so there are at most 6 poses."""
    where = dict(
        zip(
            ("side", "leg", "guide2_x", "guide3_x", "guide3_y"),
            (side, 1.0, *numbers[:3]),
            strict=True,
        )
    )
    sliders = np.array(numbers[3:])
    p, _ = document_polynomial(sliders, where)
    assert abs(np.polynomial.polynomial.polyval(1j, p)) <= 1e-12  # rounding of nine terms
    assert abs(np.polynomial.polynomial.polyval(-1j, p)) <= 1e-12
    sextic = np.polynomial.polynomial.polydiv(p, [1.0, 0.0, 1.0])[0]
    # polydiv trims leading zeros; these exclude psi = pi (next test) and a free platform
    assume(sextic.size == 7 and abs(sextic[-1]) > 1e-6)
    t = np.roots(sextic[::-1])
    psi = np.sort(2.0 * np.arctan(t[t.imag == 0.0].real))
    # where poses are about to meet, roots of the unpolished sextic may be on either side
    assume(np.all(np.abs(t.imag[t.imag != 0.0]) > 1e-4))
    assume(np.all(np.diff(psi) > 1e-4))
    found = poses(sliders, **where)
    rows = pose_rows(found)
    assert len(rows) <= 6
    assert np.sum(np.sign(found["singularity"][: len(rows)])) == 0
    assert len(rows) == len(psi)
    np.testing.assert_allclose(rows[:, 2], psi, rtol=0, atol=1e-6)  # rounding over 1e-4, and 1e-6


def test_a_pose_at_half_a_turn_is_found():
    """At psi = pi, t = tan(psi/2) is infinite, and the polynomial's leading coefficient is zero."""
    pose, where = [1.0, 0.5, np.pi], {**LENGTHS, "guide3_x": 0.8}
    for triple in slider_triples(pose, where):
        assert abs(document_polynomial(triple, where)[0][-1]) <= 1e-14  # rounding
        rows = pose_rows(poses(triple, **where))
        assert nearest_distance(rows, pose) <= 1e-13  # rounding


def test_poses_are_found_with_lengths_that_differ_by_a_factor_of_100():
    rng = np.random.default_rng(7)
    for side, leg in ((0.01, 1.0), (1.0, 100.0)):
        where = {
            "side": side,
            "leg": leg,
            "guide2_x": leg,
            "guide3_x": 0.6 * leg,
            "guide3_y": 0.4 * leg,
        }
        pose = np.array([[0.5 * leg], [0.5 * leg], [0.0]]) + rng.uniform(-0.1, 0.1, (3, 200))
        found = threeprr.solve_inverse(pose, **where)
        back = poses([found[f"slider_{k}"] for k in (1, 2, 3)], **where)
        error = np.hypot(back["x"] - pose[0], back["y"] - pose[1]) + np.abs(back["psi"] - pose[2])
        # rounding of a leg, 1e-16, over the determinant, down to 2e-4, and the ratio of 100
        assert np.nanmin(error, axis=0).max() <= 1e-8


def third_slider_at_fold():
    """Third slider [m] at which the two poses of table 5 meet, by bisection to rounding."""
    exists, not_there = 0.2, -0.2
    for _ in range(60):
        middle = 0.5 * (exists + not_there)
        alive = len(pose_rows(poses([2.0, 0.5, middle], **LENGTHS)))
        exists, not_there = (middle, not_there) if alive else (exists, middle)
    return exists


def test_two_poses_meet_in_a_singular_pose():
    third = third_slider_at_fold()
    for before in (1e-4, 1e-6, 1e-8):
        found = poses([2.0, 0.5, third + before], **LENGTHS)
        assert np.isfinite(found["psi"]).sum() == 2
        ratio = found["singularity"][:2] / np.sqrt(before)  # opposite signs, and like a square root
        assert abs(ratio[0] + ratio[1]) <= 0.05 * abs(ratio[0])
    pose = [threeprr.solve([2.0, 0.5, third], **LENGTHS, mode=m) for m in (1, -1)]
    for p in pose:
        assert abs(p["singularity"]) <= 1e-7  # square root of rounding
    assert abs(pose[0]["psi"] - pose[1]["psi"]) <= 1e-7


def test_a_missing_mode_is_named_with_the_existing_poses():
    for third, kind in ((-0.2, "short"), (2.5, "long")):
        path = np.array([[2.0] * 3, [0.5] * 3, [0.2, third, -9.0]])
        message = (
            rf"\+1 does not exist .*\(2, 0.5, {third}\) m; "
            rf"the legs are too {kind} by ([\d.]+) m"
        )
        with pytest.raises(ValueError, match=message) as caught:
            threeprr.solve(path, **LENGTHS)
        by = float(re.search(message, str(caught.value))[1]) * (1 if kind == "short" else -1)
        for share, alive in ((0.999, False), (1.001, True)):
            found = poses(path[:, 1], **{**LENGTHS, "leg": LENGTHS["leg"] + share * by})
            assert np.isfinite(found["psi"]).any() == alive
    message = (
        r"mode -2 does not exist .* there are: "
        r"\+1 at psi -0.250967 rad, -1 at psi 0.125104 rad"
    )
    with pytest.raises(ValueError, match=message):
        threeprr.solve(SLIDERS, **LENGTHS, mode=-2)


def test_a_platform_that_is_free_to_move_is_refused():
    parallel = [0.0, LENGTHS["guide2_x"] - 1.0, LENGTHS["guide3_y"] - np.sqrt(0.75)]
    with pytest.raises(ValueError, match="free to move"):  # sliders form the platform's triangle
        poses(parallel, **{**LENGTHS, "guide3_x": 0.5})
    one = {"side": np.sqrt(3.0), "leg": 1.0, "guide2_x": 1.0, "guide3_x": 0.0, "guide3_y": 2.0}
    with pytest.raises(ValueError, match=r"free to move at sliders \(0, 1, 2\) m"):
        poses(np.transpose([(0.3, 0.2, 0.1), (0.0, 1.0, 2.0)]), **one)  # all legs meet in one point


def test_of_two_starts_that_meet_the_better_pose_is_kept():
    """Around slider 1 at 2.46 m a start from the wrong circle ends within 4e-14 m of a pose."""
    sliders = SLIDERS[:, None] + np.array([[0.6], [0.6], [0.4]]) * np.linspace(0.0, 1.0, 361)
    found = poses(sliders, **LENGTHS)
    error = leg_errors([found[name][:2] for name in POSE_NAMES], sliders[:, None], LENGTHS)
    assert np.abs(error).max() <= 2e-15  # rounding of a leg's length
