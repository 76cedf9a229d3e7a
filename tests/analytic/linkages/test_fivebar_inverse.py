"""Five-bar inverse kinematics, singularities and workspace against the direct kinematics."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from proofmass.analytic.linkages import fivebar
from proofmass.analytic.linkages.fivebar import FivebarLengths, unassembled_share
from proofmass.analytic.linkages.fivebar.maps import reach_border
from tests.independent.linkages.reach import fivebar_margin

SYMMETRIC = {
    "left_crank": 4.0,
    "left_coupler": 5.0,
    "right_coupler": 5.0,
    "right_crank": 4.0,
    "left_x": -3.0,
    "right_x": 3.0,
}
THESIS = {
    "left_crank": 2.0,
    "left_coupler": 3.5,
    "right_coupler": 4.0,
    "right_crank": 1.0,
    "left_x": 0.0,
    "right_x": 2.0,
}
SIGNS, SIDES = fivebar.WORKING_MODES, ("left", "right")
TURN = 2.0 * np.pi
lengths = st.floats(0.2, 3.0)
angles = st.tuples(st.floats(-3.1, 3.1), st.floats(-3.1, 3.1)).map(np.array)
linkages = st.fixed_dictionaries(
    {
        "left_crank": lengths,
        "left_coupler": lengths,
        "right_coupler": lengths,
        "right_crank": lengths,
        "left_x": st.floats(-3.0, 3.0),
        "right_x": st.floats(-3.0, 3.0),
    }
)


def pose_or_reject(link, angle, mode):
    """Pose at the crank angles; rejects an example without a pose or near a singular pose."""
    try:
        pose = fivebar.solve(angle, [0.7, -0.4], [0.3, 0.2], **link, mode=mode)
    except ValueError:
        assume(False)
    sines = [pose[name] for name in ("assembly", "left_working", "right_working")]
    assume(np.abs(sines).min() > 0.05 and pose["pin_distance"] > 0.05)
    return pose


def tip_motion(pose):
    return [[pose[f"tip_{part}{axis}"] for axis in "xy"] for part in ("", "v", "a")]


def crank_motions(found):
    return [[found[f"{side}{part}"] for side in SIDES] for part in ("", "_rate", "_acceleration")]


@settings(derandomize=True, max_examples=60, deadline=None)
@given(linkages, angles, st.sampled_from(SIGNS))
def test_direct_kinematics_invert_the_inverse_in_all_modes(link, angle, mode):
    pose = pose_or_reject(link, angle, mode)
    here = tuple(np.sign([pose[f"{side}_working"] for side in SIDES]))
    for modes in itertools.product(SIGNS, repeat=2):
        found = fivebar.solve_inverse(
            *tip_motion(pose), **link, left_mode=modes[0], right_mode=modes[1]
        )
        sines = [found["assembly"], *(pose[f"{side}_working"] for side in SIDES)]
        if np.abs(sines).min() < 0.01:
            continue
        cranks = crank_motions(found)
        back = fivebar.solve(*cranks, **link, mode=int(np.sign(found["assembly"])))
        # rounding times the longest bar over the shortest, divided by the sines, in the
        # accelerations by their cubes
        bars = [length for name, length in link.items() if not name.endswith("_x")]
        loss = (
            1e-13
            * (max(bars) / min(bars))
            / np.abs(sines).min() ** 3
            * max(1.0, *np.abs(cranks[2]), pose["tip_vx"] ** 2, pose["tip_vy"] ** 2)
        )
        np.testing.assert_allclose(tip_motion(back), tip_motion(pose), rtol=0, atol=loss)
        if modes == here:
            assert np.abs(np.sin((cranks[0] - angle) / 2.0)).max() <= loss
            np.testing.assert_allclose(cranks[1:], [[0.7, -0.4], [0.3, 0.2]], rtol=0, atol=loss)
            assert found["assembly"] == pytest.approx(pose["assembly"], abs=loss)


@pytest.mark.parametrize("left_mode", SIGNS)
@pytest.mark.parametrize("right_mode", SIGNS)
def test_the_tip_follows_a_circle_at_constant_speed(left_mode, right_mode):
    time = np.linspace(0.0, TURN / 0.5, 512, endpoint=False)
    profiles = fivebar.circle(
        time,
        center_x=-0.6,
        center_y=5.0,
        radius=1.2,
        rate=0.5,
        **SYMMETRIC,
        left_mode=left_mode,
        right_mode=right_mode,
    )
    wave = 0.5j * np.fft.fftfreq(512, 1.0 / 512)
    wave[256] = 0.0
    for curve, slope in itertools.pairwise(profiles):
        spectral = np.fft.ifft(wave * np.fft.fft(curve)).real
        assert np.abs(spectral - slope).max() <= 1e-12  # 256 eps times the size of the curves
    late = fivebar.circle(
        time[300:],
        center_x=-0.6,
        center_y=5.0,
        radius=1.2,
        rate=0.5,
        **SYMMETRIC,
        left_mode=left_mode,
        right_mode=right_mode,
    )
    np.testing.assert_allclose(late[0], profiles[0][:, 300:], rtol=0, atol=2e-15)  # rounding
    there = fivebar.solve_inverse(
        [-0.6, 5.0], **SYMMETRIC, left_mode=left_mode, right_mode=right_mode
    )
    pose = fivebar.solve(*profiles, **SYMMETRIC, mode=int(np.sign(there["assembly"])))
    radial = np.hypot(pose["tip_x"] + 0.6, pose["tip_y"] - 5.0)
    np.testing.assert_allclose(radial, 1.2, rtol=1e-13)  # rounding
    np.testing.assert_allclose(np.hypot(pose["tip_vx"], pose["tip_vy"]), 0.6, rtol=1e-12)
    np.testing.assert_allclose(np.hypot(pose["tip_ax"], pose["tip_ay"]), 0.3, rtol=1e-11)


def test_inverse_angles_are_continuous_around_a_base():
    round_about = SYMMETRIC["left_x"] + 2.0 * np.exp(1j * np.linspace(0.0, 2.0 * TURN, 801))
    pose = fivebar.solve_inverse(
        [round_about.real, round_about.imag], **{**SYMMETRIC, "right_coupler": 6.5}
    )
    assert np.abs(np.diff(pose["left"])).max() < 0.02
    assert pose["left"][-1] - pose["left"][0] == pytest.approx(2.0 * TURN, abs=1e-14)  # rounding


@settings(derandomize=True, max_examples=100, deadline=None)
@given(linkages, st.tuples(st.floats(-6.0, 6.0), st.floats(-6.0, 6.0)))
def test_the_inverse_exists_where_the_margin_is_positive(link, tip):
    inside = fivebar_margin(tip, **link)
    assume(abs(inside) > 1e-9)
    if inside > 0:
        assert np.isfinite(fivebar.solve_inverse(tip, **link)["left"])
    else:
        with pytest.raises(ValueError, match="tip out of reach at"):
            fivebar.solve_inverse(tip, **link)


def test_an_unreachable_tip_is_named_with_its_violation():
    tips = np.array([[0.0, 0.0, 0.0], [8.0, 8.6, 9.0]])
    violation = np.hypot(3.0, 8.6) - 9.0
    with pytest.raises(
        ValueError,
        match=rf"tip out of reach at \(0, 8\.6\) m: the circles of left "
        rf"crank and coupler miss by {violation:.6g} m",
    ):
        fivebar.solve_inverse(tips, **SYMMETRIC)
    with pytest.raises(ValueError, match=r"of right crank and coupler miss by 1 m"):
        fivebar.solve_inverse([3.0, 0.0], **{**SYMMETRIC, "left_coupler": 4.0})
    with pytest.raises(ValueError, match=r"reach at \(3, 0\) m: .* coincide"):
        fivebar.solve_inverse([3.0, 0.0], **{**SYMMETRIC, "right_coupler": 4.0})
    with pytest.raises(ValueError, match=r"^right_mode must be"):
        fivebar.solve_inverse([0.0, 8.0], **SYMMETRIC, right_mode=0)
    with pytest.raises(ValueError, match=r"^left_crank must be"):
        fivebar.solve_inverse([0.0, 8.0], **{**SYMMETRIC, "left_crank": 0.0})


@pytest.mark.parametrize("side", SIDES)
def test_type_1_singularities_are_the_border_of_the_reach(side):
    border = [
        piece.points for piece, name in reach_border(FivebarLengths(**SYMMETRIC)) if name == side
    ]
    assert border
    for z in border:
        here = np.array([z.real, z.imag])
        inside = fivebar_margin(here, **SYMMETRIC)
        np.testing.assert_allclose(inside, 0.0, rtol=0, atol=1e-14)  # rounding of 9 m
        pose = fivebar.solve_inverse(here, **SYMMETRIC)
        crank = here - [[SYMMETRIC[f"{side}_x"]], [0.0]]
        turned = 4.0 * np.stack([np.cos(pose[side]), np.sin(pose[side])])
        straight = np.abs(crank[0] * turned[1] - crank[1] * turned[0])
        assert straight.max() <= 1e-6  # sqrt(eps) times 9 m times 4 m: the root of a zero area


def test_unassembled_share_is_that_of_counting_and_of_known_cases():
    """Against counting, the mirrored linkage (another integral), and known shares."""
    share = unassembled_share(FivebarLengths(**THESIS))
    turn = (np.arange(2003) + 0.5) * TURN / 2003
    pins = 2.0 * np.exp(1j * turn[:, None]), 2.0 + np.exp(1j * turn)
    counted = np.mean(np.abs(pins[1] - pins[0]) < 0.5)
    assert share == pytest.approx(counted, abs=5e-6)  # border of the counted region: h^1.5
    mirrored = {
        "left_crank": 1.0,
        "left_coupler": 4.0,
        "right_coupler": 3.5,
        "right_crank": 2.0,
        "left_x": 0.0,
        "right_x": 2.0,
    }
    assert share == pytest.approx(unassembled_share(FivebarLengths(**mirrored)), abs=1e-13)
    coaxial = {**THESIS, "right_x": 0.0, "left_crank": 1.0}  # too near: 2 sin(half angle) < 1/2
    known = 2.0 * np.arcsin(0.25) / np.pi
    assert unassembled_share(FivebarLengths(**coaxial)) == pytest.approx(known, abs=1e-14)
    always = {
        "left_crank": 1.2,
        "left_coupler": 2.6,
        "right_coupler": 2.4,
        "right_crank": 1.0,
        "left_x": -1.25,
        "right_x": 1.25,
    }
    assert unassembled_share(FivebarLengths(**always)) == pytest.approx(0.0, abs=1e-14)
    never = {**always, "left_coupler": 9.0}
    assert unassembled_share(FivebarLengths(**never)) == 1.0
    equal = dict.fromkeys(THESIS, 1.0)  # coaxial cranks, with 0/0 where the clipping would begin
    assert unassembled_share(FivebarLengths(**equal)) == pytest.approx(0.0, abs=1e-14)


def test_the_tip_rests_in_the_corners_of_a_rectangle() -> None:
    path = {"corner_x": -0.9, "corner_y": 4.6, "width": 0.8, "height": -0.5, "period": 8.0}
    modes = {"left_mode": 1, "right_mode": -1}
    time = np.linspace(0.0, 16.0, 4001)
    angle, rate, change = fivebar.rectangle(time, **path, **SYMMETRIC, **modes)
    step = time[1]
    # central differences: h^2/6 times the third derivative, below 20; h/2 at kinks of the third
    assert np.abs((angle[:, 2:] - angle[:, :-2]) / (2 * step) - rate[:, 1:-1]).max() < 1e-4
    assert np.abs((rate[:, 2:] - rate[:, :-2]) / (2 * step) - change[:, 1:-1]).max() < 1e-2
    assert np.abs(change).max() > 0.1
    corners = [[-0.9, 4.6], [-0.1, 4.6], [-0.1, 4.1], [-0.9, 4.1]]
    at = fivebar.rectangle(2.0 * np.arange(8), **path, **SYMMETRIC, **modes)
    sign = int(np.sign(fivebar.solve_inverse(corners[0], **SYMMETRIC, **modes)["assembly"]))
    pose = fivebar.solve(*at, **SYMMETRIC, mode=sign)
    # rounding divided by the sines of the modes
    assert np.abs(np.transpose([pose["tip_x"], pose["tip_y"]]) - corners * 2).max() < 1e-12
    for name in ("tip_vx", "tip_vy", "tip_ax", "tip_ay"):
        assert np.abs(pose[name]).max() < 1e-11, name
    pose = fivebar.solve(angle, rate, change, **SYMMETRIC, mode=sign)
    off = np.minimum.reduce(
        [
            *(np.abs(pose["tip_x"] - x) for x in (-0.9, -0.1)),
            *(np.abs(pose["tip_y"] - y) for y in (4.1, 4.6)),
        ]
    )
    assert off.max() < 1e-12  # every point is on the line of a side
    assert np.ptp(pose["tip_x"]) == pytest.approx(0.8)
    speed = np.hypot(pose["tip_vx"], pose["tip_vy"])
    assert speed.max() == pytest.approx(2.0 * 0.8 / 2.0)  # a cycloid has twice its mean speed
    with pytest.raises(ValueError, match="period must be positive"):
        fivebar.rectangle(0.0, **path | {"period": 0.0}, **SYMMETRIC, **modes)
