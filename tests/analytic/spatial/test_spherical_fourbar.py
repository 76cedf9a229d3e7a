"""The spherical four-bar: its closed form, the spatial reference, and outcomes of wrong arcs."""

import mujoco
import numpy as np
import pytest

from proofmass import load_case
from proofmass.analytic import spatial
from proofmass.analytic.linkages import fourbar
from proofmass.run.solve import solve
from proofmass.sim.smooth import SmoothTerms
from proofmass.verdict.compare import compare
from tests.shipped import shipped

ARCS = np.radians([30.0, 60.0, 75.0, 70.0])
"""Arcs of crank, coupler, rocker and ground [rad]."""
RADIUS, RATE, GRAVITY = 0.2, 10.0, 9.81
COUPLER_END = 'site name="coupler_end" pos="0.17320508075688773 0 0.1"'
ROCKER_END = 'site name="rocker_end" pos="0.19318516525781368 0 0.051763809020504148"'
CRANK_ANGLES = 2 * np.pi * np.arange(256) / 256
DOWN = np.array([0.0, -1.0, 0.0])


def rotation_about_y(angle: float) -> np.ndarray:
    """Rotation matrix about y (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def rotations_about_z(angle: np.ndarray) -> np.ndarray:
    """Rotation matrices about z (n, 3, 3)."""
    c, s, zero = np.cos(angle), np.sin(angle), 0 * angle
    rows = (c, -s, zero), (s, c, zero), (zero, zero, zero + 1)
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def on_cone(angle: np.ndarray, arc: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A direction (n, 3) at an arc from z, rotated about z, and two derivatives by the angle."""
    c, s, zero = np.sin(arc) * np.cos(angle), np.sin(arc) * np.sin(angle), 0 * angle
    return (
        np.stack([c, s, zero + np.cos(arc)], axis=-1),
        np.stack([-s, c, zero], axis=-1),
        np.stack([-c, -s, zero], axis=-1),
    )


def closed_form(theta: np.ndarray, arcs: np.ndarray, mode: int = -1) -> dict[str, np.ndarray]:
    """Angles of rocker, coupler and transmission for crank angles, and directions of both ends.

    The rocker's angle has its two derivatives by the crank angle (3, n).  The ends of crank and
    rocker are the coupler's arc apart, u(theta) . w(psi) = cos(coupler), which is
    A cos(psi) + B sin(psi) = C; the derivatives are those of this equation.
    """
    crank, coupler, rocker, ground = arcs
    a = np.sin(rocker) * (
        np.sin(crank) * np.cos(ground) * np.cos(theta) - np.cos(crank) * np.sin(ground)
    )
    b = np.sin(crank) * np.sin(rocker) * np.sin(theta)
    c = np.cos(coupler) - np.cos(rocker) * (
        np.sin(crank) * np.sin(ground) * np.cos(theta) + np.cos(crank) * np.cos(ground)
    )
    psi = np.unwrap(np.arctan2(b, a) + mode * np.arccos(c / np.hypot(a, b)))
    u = on_cone(theta, crank)
    w = [one @ rotation_about_y(ground).T for one in on_cone(psi, rocker)]

    def dot(one: np.ndarray, two: np.ndarray) -> np.ndarray:
        return (one * two).sum(axis=-1)

    first = -dot(u[1], w[0]) / dot(u[0], w[1])
    second = -(dot(u[2], w[0]) + 2 * dot(u[1], w[1]) * first + dot(u[0], w[2]) * first**2) / dot(
        u[0], w[1]
    )
    seen = np.einsum(
        "ji,njk,nk->ni", rotation_about_y(crank), rotations_about_z(theta).transpose(0, 2, 1), w[0]
    )
    diagonal = dot(u[0], np.array([np.sin(ground), 0.0, np.cos(ground)]))
    inside = (diagonal - np.cos(coupler) * np.cos(rocker)) / (np.sin(coupler) * np.sin(rocker))
    return {
        "rocker": np.array([psi, first, second]),
        "coupler": np.unwrap(np.arctan2(seen[:, 1], seen[:, 0])),
        "transmission": np.arccos(inside),
        "crank_end": u[0],
        "rocker_end": w[0],
    }


def spectral_derivative(curve: np.ndarray) -> np.ndarray:
    """The derivative of a periodic curve over `CRANK_ANGLES`."""
    waves = np.fft.rfft(curve, axis=0)
    return np.fft.irfft((1j * np.arange(len(waves)) * waves.T).T, n=len(curve), axis=0)


def coupler_rate_ratio(form: dict[str, np.ndarray]) -> np.ndarray:
    """The rate of the coupler's hinge at a unit rate of the crank: one turn back per turn."""
    return spectral_derivative(form["coupler"] + CRANK_ANGLES) - 1.0


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    """The shipped model."""
    return mujoco.MjModel.from_xml_path(str(shipped("spherical_fourbar.xml")))


def reference_over_a_turn(model: mujoco.MjModel, inertia: bool) -> dict[str, np.ndarray]:
    """The curves of the spatial reference over a turn."""
    terms = SmoothTerms(model)
    return spatial.solve(
        CRANK_ANGLES, RATE, model=model, joints=("crank",), inertia=inertia, terms=terms
    )


def vector_components(curves: dict[str, np.ndarray], name: str) -> np.ndarray:
    """The three components of a vector (n, 3)."""
    return np.column_stack([curves[f"{name}.{part}"] for part in "xyz"])


def test_the_closed_form_closes_and_has_spectral_derivatives():
    form = closed_form(CRANK_ANGLES, ARCS)
    apart = (form["crank_end"] * form["rocker_end"]).sum(axis=1)
    np.testing.assert_allclose(apart, np.cos(ARCS[1]), rtol=0, atol=1e-15)
    assert np.ptp(form["rocker"][0]) > 0.8  # a rocker that swings
    for k in (1, 2):
        slope = spectral_derivative(form["rocker"][k - 1])
        np.testing.assert_allclose(form["rocker"][k], slope, rtol=0, atol=1e-11)


def test_the_transmission_angle_is_between_coupler_and_rocker_planes():
    form = closed_form(CRANK_ANGLES, ARCS)
    axis = np.array([np.sin(ARCS[3]), 0.0, np.cos(ARCS[3])])
    planes = [np.cross(form["rocker_end"], other) for other in (form["crank_end"], axis)]
    one, two = (plane / np.linalg.norm(plane, axis=1, keepdims=True) for plane in planes)
    angle = np.arccos((one * two).sum(axis=1))
    np.testing.assert_allclose(form["transmission"], angle, rtol=0, atol=1e-13)


def test_small_arcs_approach_the_planar_four_bar_in_second_order():
    """The sine of an arc e is e (1 - e^2 / 6 ..), so half the arcs have a quarter of the error."""
    lengths = np.array([1.0, 2.0, 2.5, 3.0])
    named = dict(zip(("crank", "coupler", "rocker", "ground"), lengths, strict=True))
    plane = fourbar.solve(CRANK_ANGLES, **named)
    names = ("rocker_angle", "rocker_rate", "rocker_acceleration")
    differences = []
    for size in (2e-3, 1e-3):
        form = closed_form(CRANK_ANGLES, size * lengths)
        apart = form["rocker"] - np.array([plane[name] for name in names])
        apart[0] -= 2 * np.pi * np.round(apart[0] / (2 * np.pi))
        differences.append(np.abs(apart).max(axis=1))
        coupler = form["coupler"] + CRANK_ANGLES - plane["coupler_angle"]
        assert np.abs(coupler - 2 * np.pi * np.round(coupler / (2 * np.pi))).max() < 10 * size**2
        turned = form["transmission"] - plane["transmission_angle"]
        assert np.abs(turned).max() < 10 * size**2
    assert (differences[1] < 2e-5).all()
    np.testing.assert_allclose(differences[0] / differences[1], 4.0, rtol=1e-2)


def test_the_reference_agrees_with_the_closed_form(model):
    form, curves = closed_form(CRANK_ANGLES, ARCS), reference_over_a_turn(model, True)
    rocker = form["rocker"]
    np.testing.assert_allclose(curves["rocker"], rocker[0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(curves["rocker_rate"], RATE * rocker[1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        curves["rocker_acceleration"], RATE**2 * rocker[2], rtol=0, atol=1e-10
    )
    np.testing.assert_allclose(curves["coupler"], form["coupler"], rtol=0, atol=1e-13)
    np.testing.assert_allclose(
        curves["coupler_rate"], RATE * coupler_rate_ratio(form), rtol=0, atol=1e-10
    )
    np.testing.assert_allclose(
        vector_components(curves, "pin"), RADIUS * form["rocker_end"], rtol=0, atol=1e-14
    )
    turn = (
        rotations_about_z(CRANK_ANGLES)
        @ rotation_about_y(ARCS[0])
        @ rotations_about_z(form["coupler"])
    )
    tip = turn @ np.array([0.12, 0.06, 0.15])
    np.testing.assert_allclose(vector_components(curves, "tip"), tip, rtol=0, atol=1e-13)
    np.testing.assert_allclose(
        vector_components(curves, "tip_acceleration"),
        RATE**2 * spectral_derivative(spectral_derivative(tip)),
        rtol=0,
        atol=1e-9,
    )


def energies(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Twice the kinetic energy at a unit rate of the crank, and the potential energy, over a turn.

    All bodies rotate about the origin: T = w . I w / 2 with the sums of the hinges' rates.
    """
    form, ground = closed_form(CRANK_ANGLES, ARCS), rotation_about_y(ARCS[3])
    z, one = np.array([0.0, 0.0, 1.0]), np.ones_like(CRANK_ANGLES)
    pace = coupler_rate_ratio(form)
    turns = {
        "crank": rotations_about_z(CRANK_ANGLES),
        "coupler": rotations_about_z(CRANK_ANGLES)
        @ rotation_about_y(ARCS[0])
        @ rotations_about_z(form["coupler"]),
        "rocker": ground @ rotations_about_z(form["rocker"][0]),
    }
    spins = {
        "crank": one[:, None] * z,
        "coupler": one[:, None] * z + pace[:, None] * form["crank_end"],
        "rocker": form["rocker"][1][:, None] * (ground @ z),
    }
    twice, height = 0 * CRANK_ANGLES, 0 * CRANK_ANGLES
    for name, turn in turns.items():
        body = model.body(name)
        mass, centre = float(body.mass[0]), turn @ body.ipos
        spin = np.einsum("nji,nj->ni", turn, spins[name])
        twice += (spin**2 * body.inertia).sum(axis=1)
        twice += mass * (np.cross(spins[name], centre) ** 2).sum(axis=1)
        height -= mass * GRAVITY * centre @ DOWN
    return twice, height


@pytest.mark.parametrize("inertia", [False, True])
def test_the_moment_is_that_of_the_energies(model, inertia):
    """At a constant rate s' it is I' s'^2 / 2 + V', with spectral derivatives of I and V."""
    twice, height = energies(model)
    moment = spectral_derivative(height) + (
        0.5 * RATE**2 * spectral_derivative(twice) if inertia else 0.0
    )
    curve = reference_over_a_turn(model, inertia)["moment"]
    assert np.ptp(curve) > 1.0
    np.testing.assert_allclose(curve, moment, rtol=0, atol=1e-11)


ARC_ERROR = 1e-9
"""Error of an arc in a wrong model [rad]: 1000 times the error of a chord in a sweep."""


def site_on_arc(angle: float) -> str:
    """The position of a site at the end of an arc, as MJCF."""
    return f'pos="{RADIUS * float(np.sin(angle))!r} 0 {RADIUS * float(np.cos(angle))!r}"'


@pytest.mark.parametrize(
    ("old", "new", "channel"),
    [
        (f"0 {ARCS[0]!s} 0", f"0 {ARCS[0] + ARC_ERROR!s} 0", "coupler_chord"),
        (
            COUPLER_END,
            f'site name="coupler_end" {site_on_arc(ARCS[1] + ARC_ERROR)}',
            "coupler_chord",
        ),
        (ROCKER_END, f'site name="rocker_end" {site_on_arc(ARCS[2] + ARC_ERROR)}', "rocker_chord"),
        (f"0 {ARCS[3]!s} 0", f"0 {ARCS[3] + ARC_ERROR!s} 0", "rocker_chord"),
    ],
    ids=["crank", "coupler", "rocker", "ground"],
)
def test_a_wrong_arc_is_shown_by_a_chord(old, new, channel, edit, models):
    """The reference reads the model, so a wrong arc is wrong in both; only the chords show it."""
    edit("spherical_fourbar.xml", old, new, 1)
    case = load_case(models / "spherical_fourbar.toml")
    outcomes = compare(case, "sweep", "mujoco", solve(case, "sweep", "mujoco"), detectable=False)
    assert {c.channel for c in outcomes if c.outcome == "differs"} == {channel}
