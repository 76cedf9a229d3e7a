"""Five-bar closed form against loop closure, derivatives, virtual work and mirror images."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from proofmass.analytic.linkages import fivebar, fourbar
from tests.analytic.linkages.spectral import assert_close, derivative

LINK = {
    "left_crank": 2.0,
    "left_coupler": 3.5,
    "right_coupler": 4.0,
    "right_crank": 1.0,
    "left_x": 0.0,
    "right_x": 2.0,
}
REGULAR = {
    "left_crank": 1.2,
    "left_coupler": 2.6,
    "right_coupler": 2.4,
    "right_crank": 1.0,
    "left_x": -1.25,
    "right_x": 1.25,
}  # every pair of crank angles can be assembled
MASSES = {
    "left_crank_mass": 1.3,
    "left_coupler_mass": 2.1,
    "right_coupler_mass": 0.7,
    "right_crank_mass": 0.4,
}
MODES = pytest.mark.parametrize("mode", fivebar.MODES)
TURN = 2.0 * np.pi
GRID = np.arange(512) * TURN / 512
# Periodic crank profiles whose derivatives are not zero, for spectral derivatives of the curves.
CRANK_PROFILES = (
    np.stack([GRID + 0.3 * np.sin(GRID), 0.4 - 2.0 * GRID + 0.2 * np.cos(GRID)]),
    np.stack([1.0 + 0.3 * np.cos(GRID), -2.0 - 0.2 * np.sin(GRID)]),
    np.stack([-0.3 * np.sin(GRID), -0.2 * np.cos(GRID)]),
)
SIDES = ("left", "right")


@st.composite
def always_assembled(draw):
    """Lengths that close at all crank angles; margins keep the couplers out of line."""
    left, right = draw(st.floats(0.1, 0.4)), draw(st.floats(0.1, 0.4))
    total = (1.0 + left + right) * draw(st.floats(1.1, 2.0))
    difference = (1.0 - left - right) * draw(st.floats(-0.8, 0.8))
    scale, place = draw(st.floats(1e-3, 1e3)), draw(st.floats(-2.0, 2.0))
    lengths = {
        "left_crank": left,
        "right_crank": right,
        "left_x": place,
        "right_x": place + 1.0,
        "left_coupler": (total + difference) / 2.0,
        "right_coupler": (total - difference) / 2.0,
    }
    return {name: scale * length for name, length in lengths.items()}


def pins_and_tip(angle, pose, link):
    """Crank pins (2, n), and the tip (2, n) by each side, as complex numbers, from angles alone."""
    bases = np.array([link["left_x"], link["right_x"]])[:, None]
    arms = np.array([[link[f"{side}_crank"]] for side in SIDES])
    pins = bases + arms * np.exp(1j * angle)
    reach = [link[f"{side}_coupler"] * np.exp(1j * pose[f"{side}_coupler_angle"]) for side in SIDES]
    return pins, pins + np.stack(reach)


def check_loop_and_derivatives(link, mode):
    pose = fivebar.solve(*CRANK_PROFILES, **link, mode=mode)
    pins, tips = pins_and_tip(CRANK_PROFILES[0], pose, link)
    tip, size = pose["tip_x"] + 1j * pose["tip_y"], sum(map(abs, link.values()))
    assert np.abs(tips - tip).max() <= 1e-14 * size  # rounding: about ten operations
    side = np.imag(np.conj(pins[1] - pins[0]) * (tip - pins[0]))
    assert np.all(mode * side > 0)
    np.testing.assert_array_equal(np.sign(pose["assembly"]), mode)
    np.testing.assert_allclose(pose["pin_distance"], np.abs(pins[1] - pins[0]), rtol=1e-13)  # eps/d
    # 1e-9: rounding times the highest wave number, 256 eps = 6e-14, times the ratio of the size of
    # a curve to that of its derivative, which grows near in-line poses
    for bar in SIDES:
        for first, second in (("angle", "rate"), ("rate", "acceleration")):
            assert_close(
                derivative(pose[f"{bar}_coupler_{first}"]), pose[f"{bar}_coupler_{second}"], 1e-9
            )
    for axis in "xy":
        assert_close(derivative(pose[f"tip_{axis}"]), pose[f"tip_v{axis}"], 1e-9)
        assert_close(derivative(pose[f"tip_v{axis}"]), pose[f"tip_a{axis}"], 1e-9)


@MODES
def test_loop_and_derivatives_of_the_regular_linkage(mode):
    check_loop_and_derivatives(REGULAR, mode)


@settings(derandomize=True, max_examples=60, deadline=None)
@given(always_assembled(), st.sampled_from(fivebar.MODES))
def test_loop_and_derivatives_of_random_linkages(link, mode):
    check_loop_and_derivatives(link, mode)


@MODES
def test_holding_moments_do_the_virtual_work(mode):
    """Their power is the rate of the potential energy less the power of the force on the tip."""
    force = {"force_x": 3.0, "force_y": -5.0}
    pose = fivebar.solve(*CRANK_PROFILES, **REGULAR, **MASSES, **force, gravity=3.7, mode=mode)
    (left, right), (tip, _) = pins_and_tip(CRANK_PROFILES[0], pose, REGULAR)
    heights = np.imag([left / 2.0, (left + tip) / 2.0, (right + tip) / 2.0, right / 2.0])
    energy = 3.7 * np.array(list(MASSES.values())) @ heights
    gained = derivative(energy) - 3.0 * pose["tip_vx"] + 5.0 * pose["tip_vy"]
    spent = pose["left_moment"] * CRANK_PROFILES[1][0] + pose["right_moment"] * CRANK_PROFILES[1][1]
    assert_close(spent, gained, 1e-11)  # spectral rounding of the energy, as above


@MODES
def test_jacobians_carry_rates_forward_and_forces_back(mode):
    pose = fivebar.solve(
        *CRANK_PROFILES, **REGULAR, force_x=3.0, force_y=-5.0, gravity=0.0, mode=mode
    )
    tip = np.stack([pose["tip_x"], pose["tip_y"]])
    places = {name: REGULAR[name] for name in ("left_crank", "right_crank", "left_x", "right_x")}
    A, B = fivebar.jacobians(CRANK_PROFILES[0], tip, **places)
    velocity = np.linalg.solve(A, (B @ CRANK_PROFILES[1].T[..., None]))[..., 0]
    assert_close(velocity.T, np.stack([pose["tip_vx"], pose["tip_vy"]]), 1e-13)  # rounding x cond A
    onto_pins = np.linalg.solve(np.swapaxes(A, -1, -2), np.full((512, 2, 1), [[3.0], [-5.0]]))
    moments = -(np.swapaxes(B, -1, -2) @ onto_pins)[..., 0]
    assert_close(moments.T, np.stack([pose["left_moment"], pose["right_moment"]]), 1e-13)
    # the sines are the determinants divided by bar lengths; rounding of coordinates
    bars = REGULAR["left_coupler"] * REGULAR["right_coupler"]
    assert_close(np.linalg.det(A), bars * pose["assembly"], 1e-14)
    for k, side in enumerate(SIDES):
        bars = REGULAR[f"{side}_crank"] * REGULAR[f"{side}_coupler"]
        assert_close(B[:, k, k], -bars * pose[f"{side}_working"], 1e-14)


@MODES
def test_mirror_image_in_the_ground_line(mode):
    angle, rate, acceleration = CRANK_PROFILES
    pose = fivebar.solve(*CRANK_PROFILES, **REGULAR, mode=mode)
    image = fivebar.solve(-angle, -rate, -acceleration, **REGULAR, mode=-mode)
    for name in ("tip_x", "tip_vx", "tip_ax", "pin_distance"):
        np.testing.assert_allclose(image[name], pose[name], rtol=0, atol=2e-14)  # rounding
    for name in (
        "tip_y",
        "tip_vy",
        "tip_ay",
        "assembly",
        "left_coupler_rate",
        "right_coupler_acceleration",
        "left_working",
    ):
        np.testing.assert_allclose(image[name], -pose[name], rtol=0, atol=2e-14)


@MODES
def test_mirror_image_that_swaps_the_sides(mode):
    swapped = {
        "left_crank": 1.0,
        "left_coupler": 2.4,
        "right_coupler": 2.6,
        "right_crank": 1.2,
        "left_x": -1.25,
        "right_x": 1.25,
    }
    loads = {
        name.replace("left", "L").replace("right", "left").replace("L", "right"): mass
        for name, mass in MASSES.items()
    }
    pose = fivebar.solve(*CRANK_PROFILES, **REGULAR, **MASSES, force_x=2.0, mode=mode)
    image = fivebar.solve(
        np.pi - CRANK_PROFILES[0][::-1],
        -CRANK_PROFILES[1][::-1],
        -CRANK_PROFILES[2][::-1],
        **swapped,
        **loads,
        force_x=-2.0,
        mode=mode,
    )
    for name, other, sign in (
        ("tip_x", "tip_x", -1),
        ("tip_ay", "tip_ay", 1),
        ("left_coupler_rate", "right_coupler_rate", -1),
        ("left_moment", "right_moment", -1),
        ("assembly", "assembly", 1),
        ("left_working", "right_working", -1),
    ):
        # rounding of pi - angle through the slopes of the moments, up to 1e2
        np.testing.assert_allclose(image[other], sign * pose[name], rtol=0, atol=1e-13)


def test_a_five_bar_with_one_crank_at_rest_is_a_four_bar():
    pose = fivebar.solve(np.stack([GRID, np.zeros(512)]), [[1.0], [0.0]], **LINK, mode=-1)
    four_bar = fourbar.solve(GRID, crank=2.0, coupler=3.5, rocker=4.0, ground=3.0, mode=-1)
    for name, other in (
        ("tip_x", "pin_x"),
        ("tip_vy", "pin_vy"),
        ("tip_ax", "pin_ax"),
        ("left_coupler_angle", "coupler_angle"),
        ("right_coupler_rate", "rocker_rate"),
        ("right_coupler_acceleration", "rocker_acceleration"),
    ):
        assert_close(pose[name], four_bar[other], 1e-13)  # rounding of two formulas


def test_angles_follow_the_couplers_through_whole_turns():
    double_crank = {
        "left_crank": 2.0,
        "left_coupler": 2.5,
        "right_coupler": 3.0,
        "right_crank": 0.5,
        "left_x": 0.0,
        "right_x": 1.5,
    }
    angle = np.stack([np.linspace(0.0, 3.0 * TURN, 601), np.full(601, np.pi)])
    pose = fivebar.solve(angle, **double_crank)
    for side in SIDES:
        curve = pose[f"{side}_coupler_angle"]
        assert np.abs(np.diff(curve)).max() < 0.1
        assert curve[-1] - curve[0] == pytest.approx(3.0 * TURN, abs=1e-14)  # rounding


def test_shapes_broadcast():
    assert fivebar.solve([0.3, 0.9], **LINK)["tip_x"].shape == ()
    pose = fivebar.solve(np.full((2, 3), 0.5), [1.0, 2.0], [0.1, 0.2], **LINK)
    assert {curve.shape for curve in pose.values()} == {(3,)}
    column = fivebar.solve([0.5, 0.5], [1.0, 2.0], [0.1, 0.2], **LINK)
    for name, curve in pose.items():  # rounding: exp of one number and of several differ
        np.testing.assert_allclose(curve, column[name], rtol=1e-14)
    assert fivebar.solve(np.empty((2, 0)), **LINK)["tip_x"].shape == (0,)
    with pytest.raises(ValueError, match=r"angle must have 2 rows on its first axis, .* \(3, 2\)"):
        fivebar.solve(np.zeros((3, 2)), **LINK)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(
            (name, value)
            for name in LINK
            if "_x" not in name
            for value in (0.0, -1.0, np.nan, np.inf)
        ),
        ("left_x", np.nan),
        ("right_x", np.inf),
        ("mode", 0),
        ("left_coupler_mass", -1.0),
    ],
)
def test_bad_value_is_named(name, value):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        fivebar.solve([0.3, 0.9], **{**LINK, name: value})


def test_poses_that_cannot_be_assembled_are_named_with_their_violation():
    short = {**LINK, "left_coupler": 1.0, "right_coupler": 1.5}
    limit = np.arccos((13.0 - 2.5**2) / 12.0)  # A, left pin and right pin at (3, 0), 2.5 m apart
    angles = np.array([[0.0, limit, limit + 0.02, 3.0], [0.0, 0.0, 0.0, 0.0]])
    fivebar.solve(angles[:, :2], **short)
    violation = np.sqrt(13.0 - 12.0 * np.cos(limit + 0.02)) - 2.5
    where = rf"\({limit + 0.02:.9g}, 0\) rad: the circles of the couplers miss by {violation:.6g} m"
    with pytest.raises(ValueError, match=where):
        fivebar.solve(angles, **short)
    with pytest.raises(ValueError, match=r"miss by 3\.9\d+e-12 m"):
        fivebar.solve([limit + 2e-12, 0.0], **short)
    with pytest.raises(ValueError, match=r"angles \(0, 0\) rad: .* miss by 1 m"):  # one in other
        fivebar.solve([0.0, 0.0], **{**short, "right_coupler": 3.0})
    coaxial = {
        "left_crank": 1.0,
        "left_coupler": 2.0,
        "right_coupler": 2.0,
        "right_crank": 1.0,
        "left_x": 0.0,
        "right_x": 0.0,
    }
    assert fivebar.solve([0.1, 0.2], **coaxial)["tip_x"].shape == ()
    with pytest.raises(ValueError, match=r"angles \(0\.1, 0\.1\) .* coincide"):
        fivebar.solve([0.1, 0.1], **coaxial)


def test_couplers_in_line_are_reached_without_finite_rates():
    line = {**LINK, "left_coupler": 2.0, "right_coupler": 3.0}
    pose = fivebar.solve([np.pi, 0.0], [1.0, 0.0], **line)
    assert pose["tip_x"] == pytest.approx(0.0, abs=1e-15)  # exact value
    assert pose["assembly"] == 0.0
    assert not np.isfinite(pose["left_coupler_rate"])
