"""Parallel robots: closed forms of kinematics and balances, compared with the spatial reference."""

import mujoco
import numpy as np
import pytest

from proofmass import load_case
from proofmass.analytic import spatial
from proofmass.analytic.spatial.kinematics import rotation_matrices
from proofmass.run.solve import plan_run, solve
from proofmass.sim.smooth import SmoothTerms
from proofmass.verdict.compare import compare
from tests.shipped import shipped, shipped_case

WEIGHT = np.array([0.0, 0.0, -9.81])
"""Gravity [m/s^2]."""
CLOSURE_TOLERANCE = 2e-12
"""Tolerance of positions [m] and quaternions [1]: loops are closed to 1e-13 of the size."""


def bar_drive_forces(
    mass: float, displacements: tuple[np.ndarray, ...], accelerations: tuple[np.ndarray, ...]
) -> np.ndarray:
    """Forces (n, drives) that a uniform slender bar requires of the drives, by virtual work.

    Both `displacements` and `accelerations` are given for its two ends, and linear between them.
    The former are displacements (n, 3, drives) for a unit of each drive, the latter accelerations
    (n, 3).
    """
    (p, q), (one, two) = (each - WEIGHT for each in accelerations), displacements
    work = (
        2 * _virtual_work(one, p)
        + _virtual_work(one, q)
        + _virtual_work(two, p)
        + 2 * _virtual_work(two, q)
    )
    return mass / 6 * work


def _virtual_work(moves: np.ndarray, force: np.ndarray) -> np.ndarray:
    return np.einsum("nid,ni->nd", moves, force)


def spectral_derivative(curve: np.ndarray) -> np.ndarray:
    """The derivative of a periodic curve whose samples (n, ...) cover a turn of 2 pi."""
    waves = np.fft.rfft(curve, axis=0)
    order = 1j * np.arange(len(waves)).reshape(-1, *[1] * (curve.ndim - 1))
    return np.fft.irfft(order * waves, n=len(curve), axis=0)


def driven_reference(name: str, inertia: bool) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Values, rates and accelerations (3, drives, n) of a case's drives, and reference curves."""
    case = shipped_case(shipped(f"{name}.toml"))
    run = plan_run(case, "sweep", "mujoco")
    state = np.array(run.motion(run.x[::6]))
    model = mujoco.MjModel.from_xml_path(str(case.model_path))
    joints = tuple(drive.joint for drive in run.drives)
    terms = SmoothTerms(model)
    return state, spatial.solve(*state, model=model, joints=joints, inertia=inertia, terms=terms)


def component_columns(curves: dict[str, np.ndarray], name: str, parts: str = "xyz") -> np.ndarray:
    """The components of a vector or a quaternion (n, 3 or 4)."""
    return np.column_stack([curves[f"{name}.{part}"] for part in parts])


def differing_channels(name: str, models) -> set[str]:
    """The channels of a sweep of the copied case with the outcome "differs"."""
    case = load_case(models / f"{name}.toml")
    run = case.run["sweep"].model_copy(update={"n": 21})
    case = case.model_copy(update={"run": {"sweep": run}})
    found = compare(case, "sweep", "mujoco", solve(case, "sweep", "mujoco"), detectable=False)
    return {c.channel for c in found if c.outcome == "differs"}


# Clavel's delta robot

BASE, ARM, ROD, PLATE = 0.567 * 3**0.5 / 6, 0.524, 1.244, 0.076 * 3**0.5 / 3
"""Distance of hips from the axis, lengths of arm and rod, distance of rod ends on platform [m]."""
AZIMUTH = np.radians([-90.0, 30.0, 150.0])
OUT = np.stack([np.cos(AZIMUTH), np.sin(AZIMUTH), 0 * AZIMUTH], axis=-1)
ACROSS = np.stack([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0 * AZIMUTH], axis=-1)
UP = np.array([0.0, 0.0, 1.0])


def hip_angles(place: np.ndarray) -> np.ndarray:
    """Angles (n, 3) of the arms, elbows outside, for positions (n, 3) of the platform."""
    along, across, z = place @ OUT.T + PLATE - BASE, place @ ACROSS.T, place[:, 2:]
    a, b = 2 * ARM * along, -2 * ARM * z
    c = along**2 + across**2 + z**2 + ARM**2 - ROD**2
    return np.arctan2(b, a) - np.arccos(c / np.hypot(a, b))


def elbow_positions(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (n, 3 legs, 3) of the elbows, and two derivatives by the angles of their arms."""
    c, s = ARM * np.cos(angle)[..., None], ARM * np.sin(angle)[..., None]
    return (BASE + c) * OUT - s * UP, -s * OUT - c * UP, -c * OUT + s * UP


def platform_position(angle: np.ndarray) -> np.ndarray:
    """The platform's position (n, 3): the lower point at a rod's length from three centres.

    The centres are the elbows, moved inwards by the distance of the rod ends from the platform's
    centre.
    """
    centres = elbow_positions(angle)[0] - PLATE * OUT
    one, two, three = centres.transpose(1, 0, 2)

    def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return (a * b).sum(axis=-1, keepdims=True)

    x = (two - one) / np.sqrt(dot(two - one, two - one))
    y = three - one - dot(x, three - one) * x
    y = y / np.sqrt(dot(y, y))
    across = 0.5 * dot(x, two - one)
    up = (0.5 * dot(three - one, three - one) - dot(x, three - one) * across) / dot(y, three - one)
    height = np.sqrt(ROD**2 - across**2 - up**2)
    return one + across * x + up * y - height * np.cross(x, y)


def circle_path(turn: np.ndarray) -> np.ndarray:
    """Circle (n, 3) of radius 0.3 m about a centre 1 m below the base, tilted by 20 deg about y."""
    tilt = np.radians(20.0)
    x, z = 0.3 * np.cos(tilt) * np.cos(turn), 0.3 * np.sin(tilt) * np.cos(turn) - 1.0
    return np.stack([x, 0.3 * np.sin(turn), z], axis=-1)


TURN = 2 * np.pi * np.arange(128) / 128


def test_inverse_kinematics_of_the_delta_robot_has_the_printed_angles():
    """Examples of R. L. Williams II for these lengths, printed to a tenth of a degree."""
    found = np.degrees(hip_angles(np.array([[0.0, 0.0, -0.9], [0.3, 0.5, -1.1]])))
    np.testing.assert_allclose(found, [[-20.5] * 3, [47.5, -11.6, 21.4]], rtol=0, atol=0.05)
    place = platform_position(np.radians([[10.0, 20.0, 30.0]]))
    np.testing.assert_allclose(place, [[0.108, -0.180, -1.244]], rtol=0, atol=5e-4)


def test_forward_kinematics_of_the_delta_robot_undoes_the_inverse():
    place = circle_path(TURN)
    np.testing.assert_allclose(platform_position(hip_angles(place)), place, rtol=0, atol=1e-14)


def delta_displacements(
    angle: np.ndarray, rate: np.ndarray, acceleration: np.ndarray
) -> dict[str, np.ndarray]:
    """Displacements (.., 3, 3 drives) of elbows and platform per unit of drive, and accelerations.

    With d from the elbow to the rod end on the platform, d . d is the square of the rod's length,
    so d . d' = 0 and d . d'' + d' . d' = 0 give the platform's velocity and acceleration.
    """
    place, first, second = elbow_positions(angle)
    rods = platform_position(angle)[:, None] + PLATE * OUT - place
    drives = first[..., None] * np.eye(3)[:, None, :]  # (n, legs, 3, drives)
    moves = np.linalg.solve(rods, np.einsum("nli,nlid->nld", rods, drives))
    elbow = first * acceleration[..., None] + second * (rate**2)[..., None]
    apart = np.einsum("nid,nd->ni", moves, rate)[:, None] - first * rate[..., None]
    known = np.einsum("nli,nli->nl", rods, elbow) - (apart**2).sum(axis=-1)
    return {
        "elbow_moves": drives,
        "moves": moves,
        "elbow": elbow,
        "acceleration": np.linalg.solve(rods, known[..., None])[..., 0],
    }


def delta_moments(angle: np.ndarray, rate: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Moments (n, 3) of the drives: arms of 1.2 kg, six rods of 0.15 kg, a platform of 1 kg."""
    found = delta_displacements(angle, rate, acceleration)
    total = _virtual_work(found["moves"], found["acceleration"] - WEIGHT)
    still = np.zeros_like(found["moves"])
    for leg in range(3):
        moves, at = found["elbow_moves"][:, leg], found["elbow"][:, leg]
        total += bar_drive_forces(1.2, (still, moves), (np.zeros_like(at), at))
        total += bar_drive_forces(0.3, (moves, found["moves"]), (at, found["acceleration"]))
    return total


def test_delta_velocities_and_accelerations_are_spectral_derivatives():
    angle = hip_angles(circle_path(TURN))
    rate = spectral_derivative(angle)
    acceleration = spectral_derivative(rate)
    found = delta_displacements(angle, rate, acceleration)
    velocity = np.einsum("nid,nd->ni", found["moves"], rate)
    np.testing.assert_allclose(velocity, spectral_derivative(circle_path(TURN)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        found["acceleration"], circle_path(TURN).mean(0) - circle_path(TURN), rtol=0, atol=1e-11
    )


def test_the_drives_of_the_delta_robot_are_its_inverse_kinematics():
    rows = np.loadtxt(shipped("delta_circle.csv"), delimiter=",", skiprows=3)
    np.testing.assert_allclose(
        rows[:, 1:], hip_angles(circle_path(2 * np.pi * rows[:, 0])), rtol=0, atol=1e-13
    )


@pytest.mark.parametrize("inertia", [False, True])
def test_the_reference_of_the_delta_robot_has_its_closed_forms(inertia):
    state, curves = driven_reference("delta", inertia)
    angle, rate, acceleration = state.transpose(0, 2, 1)
    np.testing.assert_allclose(
        component_columns(curves, "platform"),
        platform_position(angle),
        rtol=0,
        atol=CLOSURE_TOLERANCE,
    )
    turn = component_columns(curves, "turn", "wxyz")
    np.testing.assert_allclose(
        turn, np.tile([1.0, 0, 0, 0], (len(turn), 1)), rtol=0, atol=CLOSURE_TOLERANCE
    )
    found = delta_displacements(angle, rate, acceleration)
    velocity = np.einsum("nid,nd->ni", found["moves"], rate)
    np.testing.assert_allclose(component_columns(curves, "velocity"), velocity, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        component_columns(curves, "acceleration"), found["acceleration"], rtol=0, atol=1e-10
    )
    still = np.zeros_like(rate)
    moments = (
        delta_moments(angle, rate, acceleration) if inertia else delta_moments(angle, still, still)
    )
    curve = np.column_stack([curves[f"moment_{k}"] for k in (1, 2, 3)])
    assert np.ptp(curve) > 4.0
    np.testing.assert_allclose(curve, moments, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "channels"),
    [
        ('pos="0 0 -1.244"', 'pos="0 0 -1.244001"', {"radius", "from_apex"}),
        ('="left_1_end" pos="0 0 -1.244"', '="left_1_end" pos="0 0 -1.244001"', None),
        ('pos="0.524 (.0.0655|0.0655) 0"', r'pos="0.524001 \1 0"', {"radius", "from_apex"}),
        ('name="arm_1" pos="0 ', 'name="arm_1" pos="1e-6 ', {"radius", "from_apex"}),
    ],
    ids=["all rods", "one rod", "arms", "a hip"],
)
def test_a_wrong_length_leaves_the_circle_or_turns_the_platform(old, new, channels, edit, models):
    """The drives are those of the right lengths, so a robot with a wrong length moves elsewhere."""
    edit("delta.xml", old, new)
    found = differing_channels("delta", models)
    if channels is None:
        assert {"turn.x", "turn.y", "turn.z"} <= found
    else:
        assert found == channels


# The Stewart platform

LEG = np.arange(6)
BASE_ENDS, PLATFORM_ENDS = (
    radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    for radius, angle in (
        (0.5, np.radians(120.0 * (LEG // 2) - 15.0 * (-1.0) ** LEG)),
        (0.3, np.radians(120.0 * (LEG // 2) - 45.0 * (-1.0) ** LEG)),
    )
)
"""Ends of the legs on the base and, in its own axes, on the platform [m]."""
TUBE_LENGTH, ROD_LENGTH = 0.35, 0.4
"""Length of a tube, from the base, and of a rod, from the platform [m]."""


def rotations_about(axis: int, angle: np.ndarray) -> np.ndarray:
    """Rotation matrices (n, 3, 3) about an axis of the world."""
    c, s = np.cos(angle), np.sin(angle)
    found = np.zeros((*np.shape(angle), 3, 3))
    one, two = (axis + 1) % 3, (axis + 2) % 3
    found[..., axis, axis] = 1.0
    found[..., one, one] = found[..., two, two] = c
    found[..., one, two], found[..., two, one] = -s, s
    return found


def wobble_poses(turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) on a tilted circle, and axes (n, 3, 3) rotated about a horizontal axis."""
    tilt = np.radians(30.0)
    x, z = np.cos(tilt) * np.cos(turn), np.sin(tilt) * np.cos(turn)
    place = 0.08 * np.stack([x, np.sin(turn), z], axis=-1) + [0.0, 0.0, 0.6]
    return place, rotations_about(2, turn) @ rotations_about(1, np.radians(15.0)) @ rotations_about(
        2, -turn
    )


def leg_vectors(turn: np.ndarray) -> np.ndarray:
    """The legs (n, 6, 3) from the base to the platform: the inverse kinematics."""
    place, axes = wobble_poses(turn)
    return place[:, None] + np.einsum("nij,lj->nli", axes, PLATFORM_ENDS) - BASE_ENDS


def wobble_derivatives(turn: np.ndarray, rate: float) -> dict[str, np.ndarray]:
    """The motion of platform and legs at a constant rate, by spectral derivatives over a turn."""
    place, axes = wobble_poses(turn)
    rates = rate * spectral_derivative(axes)
    skew = rates @ axes.transpose(0, 2, 1)
    spin = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
    lengths = np.linalg.norm(leg_vectors(turn), axis=-1)
    return {
        "acceleration": rate**2 * spectral_derivative(spectral_derivative(place)),
        "axes": axes,
        "spin": spin,
        "spin_rate": rate * spectral_derivative(spin),
        "state": np.array(
            [
                lengths,
                rate * spectral_derivative(lengths),
                rate**2 * spectral_derivative(spectral_derivative(lengths)),
            ]
        ),
    }


def leg_forces(turn: np.ndarray, rate: float) -> np.ndarray:
    """Forces (n, 6) of the legs by virtual work of the bodies in six motions of the platform.

    The motions are a unit velocity and a unit angular velocity along each axis of the world.  With
    the Jacobian J of the legs' lengths and the wrench W that the bodies require, J' f = W.  The
    platform has Newton's and Euler's equations about its centre of mass; tubes of 0.6 kg and rods
    of 0.4 kg are slender bars along their legs.
    """
    motion, ways = wobble_derivatives(turn, rate), leg_vectors(turn)
    axes, spin, twist = motion["axes"], motion["spin"], np.eye(3)

    def moved(arm: np.ndarray) -> np.ndarray:
        """Displacements (n, 3, 6) of a point at an arm (n, 3) from the platform's origin."""
        turning = np.stack([np.cross(axis, arm) for axis in twist], axis=-1)
        return np.concatenate([np.broadcast_to(twist, turning.shape), turning], axis=-1)

    def accelerated(arm: np.ndarray) -> np.ndarray:
        """Acceleration (n, 3) of the same point."""
        turning = np.cross(motion["spin_rate"], arm) + np.cross(spin, np.cross(spin, arm))
        return motion["acceleration"] + turning

    centre = axes @ np.array([0.02, 0.01, 0.03])
    inertia = axes * np.array([0.1, 0.12, 0.2]) @ axes.transpose(0, 2, 1)
    moment = np.einsum("nij,nj->ni", inertia, motion["spin_rate"])
    moment += np.cross(spin, np.einsum("nij,nj->ni", inertia, spin))
    wrench = 5.0 * _virtual_work(moved(centre), accelerated(centre) - WEIGHT)
    wrench[:, 3:] += moment
    rows = []
    for k in LEG:
        arm = axes @ PLATFORM_ENDS[k]
        length = np.linalg.norm(ways[:, k], axis=-1)[:, None]
        way, moves = ways[:, k] / length, moved(arm)
        row = _virtual_work(moves, way)
        rows.append(row)
        swing = (moves - way[..., None] * row[:, None]) / length[..., None]  # of the direction
        bend = rate**2 * spectral_derivative(spectral_derivative(way))
        still = np.zeros_like(way)
        wrench += bar_drive_forces(
            0.6, (0 * moves, TUBE_LENGTH * swing), (still, TUBE_LENGTH * bend)
        )
        at = accelerated(arm)
        wrench += bar_drive_forces(
            0.4, (moves, moves - ROD_LENGTH * swing), (at, at - ROD_LENGTH * bend)
        )
    return np.linalg.solve(np.stack(rows, axis=-1), wrench[..., None])[..., 0]


def test_the_drives_of_the_stewart_platform_are_its_inverse_kinematics():
    rows = np.loadtxt(shipped("stewart_wobble.csv"), delimiter=",", skiprows=3)
    lengths = np.linalg.norm(leg_vectors(2 * np.pi * rows[:, 0]), axis=-1)
    np.testing.assert_allclose(rows[:, 1:], lengths, rtol=0, atol=1e-13)


def test_the_drives_lead_the_stewart_platform_along_its_motion():
    """With the case's own drives, whose splines between the rows have an error of 1e-8 m."""
    state, curves = driven_reference("stewart", True)
    turn = 2 * np.pi * np.arange(state.shape[-1]) / (state.shape[-1] - 1)
    place, axes = wobble_poses(turn)
    np.testing.assert_allclose(component_columns(curves, "platform"), place, rtol=0, atol=2e-8)
    found = rotation_matrices(component_columns(curves, "turn", "wxyz"))
    np.testing.assert_allclose(found, axes, rtol=0, atol=1e-7)


@pytest.mark.parametrize("rate", [0.0, 2 * np.pi])
def test_leg_forces_obey_the_balances_of_the_bodies(rate):
    """With the exact lengths, rates and accelerations of the legs, at rest and in motion."""
    model = mujoco.MjModel.from_xml_path(str(shipped("stewart.xml")))
    joints = tuple(f"leg_{k + 1}" for k in LEG)
    state = wobble_derivatives(TURN, rate)["state"].transpose(0, 2, 1)
    terms = SmoothTerms(model)
    curves = spatial.solve(*state, model=model, joints=joints, inertia=True, terms=terms)
    place = wobble_poses(TURN)[0]
    np.testing.assert_allclose(
        component_columns(curves, "platform"), place, rtol=0, atol=CLOSURE_TOLERANCE
    )
    forces = np.column_stack([curves[f"force_{k + 1}"] for k in LEG])
    assert np.ptp(forces) > 10.0
    np.testing.assert_allclose(forces, leg_forces(TURN, rate), rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    "place", ['name="ball_1" pos="0.21213', 'name="tube_3" pos="-0.12940'], ids=["ball", "base"]
)
def test_a_wrong_position_of_a_joint_differs(place, edit, models):
    """One of twelve joints, on the platform or on the base, is displaced by 1e-5 m."""
    edit("stewart.xml", place, f"{place[:-1]}{int(place[-1]) + 1}")
    assert differing_channels("stewart", models) == {"turn.w", "turn.z", "radius", "from_apex"}
