"""Mechanisms in space with loops: the spatial reference compared with an equation of motion each.

Each has one degree of freedom s, so that the energies T = I(s) s'^2 / 2 and V(s) give its motion.
The functions I and V follow from the points and axes of its bodies by geometry.
"""

import re
from collections.abc import Callable
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from numpy.polynomial import Chebyshev
from scipy.integrate import solve_ivp

from proofmass import load_case
from proofmass.analytic import spatial
from proofmass.analytic.spatial import motion
from proofmass.analytic.spatial.motion import regular_pseudo_inverse
from proofmass.reference.evaluate import reference_for
from proofmass.run.solve import solve
from proofmass.sim.mujoco.engine import simulate as in_mujoco
from proofmass.sim.protocol.run import Run
from proofmass.sim.smooth import SmoothTerms
from tests.shipped import shipped

Curve = Callable[[np.ndarray], np.ndarray]
GRAVITY = 9.81


def compile_shipped(name: str) -> mujoco.MjModel:
    """A shipped model."""
    return mujoco.MjModel.from_xml_path(str(shipped(f"{name}.xml")))


def reference_motion(name: str, times: np.ndarray) -> dict[str, np.ndarray]:
    """The curves of the spatial reference for the free motion of a shipped model."""
    model = compile_shipped(name)
    return spatial.solve(times, model=model, terms=SmoothTerms(model))


def motion_from_rest(
    inertia: Curve, height: Curve, span: tuple[float, float], times: np.ndarray, start: float
):
    """The motion s(t) from rest: I s'' + I' s'^2 / 2 + V' = 0, by polynomials on a span of s."""
    mass, potential = (Chebyshev.interpolate(f, 80, domain=span) for f in (inertia, height))
    slope, push = mass.deriv(), potential.deriv()

    def rate(_: float, y: np.ndarray) -> tuple[float, float]:
        s, v = y
        return v, -(0.5 * slope(s) * v * v + push(s)) / mass(s)

    way = solve_ivp(rate, (0.0, times[-1]), (start, 0.0), "DOP853", times, rtol=1e-13, atol=1e-14)
    return way.y


def slider_crank_ends(s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Crank end of the slider-crank's rod, its derivative by s, and slider position with slope."""
    zero = np.zeros_like(s)
    ball = np.stack([zero, 0.1 - 0.08 * np.sin(s), 0.12 + 0.08 * np.cos(s)], axis=-1)
    moves = np.stack([zero, -0.08 * np.cos(s), -0.08 * np.sin(s)], axis=-1)
    x = np.sqrt(0.09 - ball[..., 1] ** 2 - ball[..., 2] ** 2)
    slope = -(ball[..., 1] * moves[..., 1] + ball[..., 2] * moves[..., 2]) / x
    return ball, moves, np.stack([x, slope], axis=-1)


def inertia_of_slider_crank(s: np.ndarray) -> np.ndarray:
    """I(s) [kg m^2]; the universal joint rotates the rod by yaw about z, then by pitch."""
    ball, moves, slider = slider_crank_ends(s)
    x, slope = slider[..., 0], slider[..., 1]
    way = np.stack([x, 0 * x, 0 * x], axis=-1) - ball  # from the crank to the slider: R(1, 0, 0)
    rate = np.stack([slope, 0 * x, 0 * x], axis=-1) - moves
    level = way[..., 0] ** 2 + way[..., 1] ** 2
    yaw = (way[..., 0] * rate[..., 1] - way[..., 1] * rate[..., 0]) / level
    pitch = -rate[..., 2] / np.sqrt(level)  # sin(pitch) = -way_z / 0.3
    sine, cosine = -way[..., 2] / 0.3, np.sqrt(level) / 0.3
    middle = 0.5 * (moves + np.stack([slope, 0 * x, 0 * x], axis=-1))
    crank = 1e-4 + 0.12 * 0.04**2
    rod = 4e-4 * (yaw * sine) ** 2 + 4e-3 * (pitch**2 + (yaw * cosine) ** 2)
    return crank + 2.0 * slope**2 + 0.5 * (middle**2).sum(axis=-1) + rod


def potential_of_slider_crank(s: np.ndarray) -> np.ndarray:
    """V(s) [J] of the slider-crank."""
    return GRAVITY * (0.12 * 0.04 * np.cos(s) + 0.5 * 0.04 * np.cos(s))


@pytest.mark.parametrize("end", [0.5, 5.0])
def test_a_spatial_slider_crank_agrees_with_a_quadrature(end):
    """Time is an integral over the crank angle: t = int sqrt(I / 2 / (E - V)) ds."""
    times = np.linspace(0.0, end, 51)
    curves = reference_motion("slider_crank_spatial", times)
    s = curves["crank"]
    zero = np.zeros(1)
    energy = 0.5 * inertia_of_slider_crank(zero) * 36.0 + potential_of_slider_crank(zero)
    points, weights = np.polynomial.legendre.leggauss(40)
    pieces = np.concatenate([np.linspace(a, b, 9)[:-1] for a, b in pairwise(s)])
    pieces = np.append(pieces, s[-1])
    middles, halves = 0.5 * (pieces[1:] + pieces[:-1]), 0.5 * np.diff(pieces)
    inner = middles[:, None] + halves[:, None] * points
    rate = np.sqrt(2 * (energy - potential_of_slider_crank(inner)) / inertia_of_slider_crank(inner))
    taken = np.append(0.0, np.cumsum((1 / rate) @ weights * halves))[::8]
    here = np.sqrt(2 * (energy - potential_of_slider_crank(s)) / inertia_of_slider_crank(s))
    assert s[-1] > (50.0 if end > 1 else 4.0)
    assert np.abs((taken - times) * here).max() < 1e-9  # error of the crank angle
    assert np.abs(curves["slider"] - slider_crank_ends(s)[2][..., 0]).max() < 1e-12
    assert np.abs(curves["crank_rate"] - here).max() < 1e-8


def rotation_about(axis: int, angle: np.ndarray) -> np.ndarray:
    """Rotation matrices about an axis of the world."""
    c, s, zero, one = np.cos(angle), np.sin(angle), 0 * angle, 0 * angle + 1
    rows = {
        0: ((one, zero, zero), (zero, c, -s), (zero, s, c)),
        1: ((c, zero, s), (zero, one, zero), (-s, zero, c)),
        2: ((c, -s, zero), (s, c, zero), (zero, zero, one)),
    }[axis]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


BRICARD_BARS = (
    (1, (1, 0, 0)),
    (2, (0, -1, 0)),
    (0, (0, 0, 1)),
    (1, (-1, 0, 0)),
    (2, (0, 1, 0)),
)
"""For each of Bricard's bars: axis of its rotation relative to the bar before, and direction."""


def bar_ends(odd: np.ndarray, even: np.ndarray) -> np.ndarray:
    """Ends (n, 6, 3) of the bars, whose hinges alternate between two angles."""
    at = np.zeros((*odd.shape, 3), dtype=np.result_type(odd, even))
    axes, places = np.eye(3), [at]
    for k, (axis, way) in enumerate(BRICARD_BARS):
        axes = axes @ rotation_about(axis, odd if k % 2 == 0 else even)
        places.append(places[-1] + axes @ np.array(way, float))
    return np.stack(places, axis=-2)


def bricard_ends(s: np.ndarray) -> np.ndarray:
    """Ends of Bricard's bars for the angle s of its hinges 1, 3 and 5.

    The loop is closed if the angle b of hinges 2 and 4 satisfies sin s + sin b + sin s sin b = 0.
    """
    return bar_ends(s, -np.arcsin(np.sin(s) / (1.0 + np.sin(s))))


def inertia_of_bricard(s: np.ndarray) -> np.ndarray:
    """I(s) [kg m^2] of slender bars, from the velocities of their ends."""
    rates = bricard_ends(s + 1e-30j).imag / 1e-30
    one, two = rates[..., :-1, :], rates[..., 1:, :]
    return ((one**2 + one * two + two**2) / 3.0).sum(axis=(-1, -2))


def potential_of_bricard(s: np.ndarray) -> np.ndarray:
    """V(s) [J] of Bricard's linkage."""
    places = bricard_ends(s)
    return GRAVITY * 0.5 * (places[..., :-1, 1] + places[..., 1:, 1]).sum(axis=-1)


@pytest.mark.parametrize("end", [2.0, 10.0])
def test_bricards_linkage_agrees_with_its_equation_of_motion(end):
    times = np.linspace(0.0, end, 41)
    curves = reference_motion("bricard", times)
    angle, rate = motion_from_rest(
        inertia_of_bricard, potential_of_bricard, (-0.1, 3.3), times, 0.0
    )
    places = bricard_ends(angle)
    assert np.abs(places[:, 5] - [0, 0, 1]).max() < 1e-14  # the formula of the angles closes it
    assert angle.max() > 2.8
    np.testing.assert_allclose(curves["h1"], angle, rtol=0, atol=1e-9)
    knee = np.column_stack([curves[f"knee.{part}"] for part in "xyz"])
    np.testing.assert_allclose(knee, places[:, 2], rtol=0, atol=1e-9)
    energy = 0.5 * inertia_of_bricard(angle) * rate**2
    np.testing.assert_allclose(curves["kinetic"], energy, rtol=0, atol=1e-8)


def gear_motion(times: np.ndarray) -> np.ndarray:
    """The second angle of the gear of changing ratio, and its rate."""

    def inertia(q: np.ndarray) -> np.ndarray:
        return (1.0 + q) ** 2 / 3.0 + 2.0 / 3.0

    def weight(q: np.ndarray) -> np.ndarray:
        return -GRAVITY * (0.5 * np.cos(q + 0.5 * q**2) + np.cos(q))

    return motion_from_rest(inertia, weight, (-2.5, 1.1), times, 1.0)


def test_a_gear_of_changing_ratio_agrees_with_its_equation_of_motion():
    times = np.linspace(0.0, 1.0, 41)
    curves, (angle, rate) = reference_motion("changing_gear", times), gear_motion(times)
    np.testing.assert_allclose(curves["second"], angle, rtol=0, atol=1e-10)
    np.testing.assert_allclose(curves["first"], angle + 0.5 * angle**2, rtol=0, atol=1e-10)
    np.testing.assert_allclose(curves["second_rate"], rate, rtol=0, atol=1e-9)


def test_mujocos_error_of_a_changing_gear_does_not_fall_with_the_step():
    """Compared with the equation of motion, MuJoCo 4.0.0 has the same error with an eighth step."""
    case = load_case(shipped("changing_gear.toml"))
    errors = []
    for solver in ("mujoco", "mujoco:fine"):
        curves = solve(case, "dynamics", solver)
        assert reference_for(case, "dynamics", curves).channels
        errors.append(np.abs(curves.channels["second"] - gear_motion(curves.x)[0]).max())
    assert errors[0] > 1e-4
    assert errors[1] == pytest.approx(errors[0], rel=0.05)


def test_a_universal_joint_agrees_with_its_closed_form():
    """tan b = tan a / cos 30 deg; the moment follows from the flywheel by virtual work."""
    model, rate, tilt = compile_shipped("universal_joint"), 10.0, np.pi / 6
    turn_of_input = np.linspace(0.0, 2 * np.pi, 37)
    curves = spatial.solve(
        turn_of_input,
        rate,
        model=model,
        joints=("input",),
        inertia=True,
        terms=SmoothTerms(model),
    )
    sine, cosine = np.sin(turn_of_input), np.cos(turn_of_input)
    pace = np.cos(tilt) / ((cosine * np.cos(tilt)) ** 2 + sine**2)
    np.testing.assert_allclose(curves["output_spin.x"], rate * pace, rtol=1e-13)
    for part in "yz":
        np.testing.assert_allclose(curves[f"output_spin.{part}"], 0.0, atol=1e-12)
    out = np.unwrap(np.arctan2(sine, cosine * np.cos(tilt)))
    rim = np.column_stack([curves[f"rim.{part}"] for part in "xyz"])
    shaft = np.array([np.cos(tilt), np.sin(tilt), 0.0])
    up, side = np.array([0.0, 0.0, 1.0]), np.cross(shaft, [0.0, 0.0, 1.0])
    wanted = 0.4 * shaft + 0.12 * (np.cos(out)[:, None] * up + np.sin(out)[:, None] * side)
    np.testing.assert_allclose(rim, wanted, rtol=0, atol=1e-13)
    change = -(rate**2) * np.sin(tilt) ** 2 * np.sin(2 * turn_of_input) * pace**2 / np.cos(tilt)
    np.testing.assert_allclose(curves["moment"], 0.02 * change * pace, rtol=0, atol=1e-7)


def test_a_driven_spatial_slider_crank_keeps_its_geometry():
    model = compile_shipped("slider_crank_spatial")
    crank = 2 * np.pi * np.arange(128) / 128
    curves = spatial.solve(
        crank, 3.0, model=model, joints=("crank",), inertia=True, terms=SmoothTerms(model)
    )
    place = slider_crank_ends(crank)[2]
    np.testing.assert_allclose(curves["slider"], place[:, 0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(curves["slider_speed"], 3.0 * place[:, 1], rtol=0, atol=1e-12)


def test_a_drive_beyond_a_limit_position_is_refused():
    model = compile_shipped("slider_crank_spatial")
    with pytest.raises(ValueError, match="limit position"):
        spatial.solve([0.2, 0.4], model=model, joints=("slider",), terms=SmoothTerms(model))


def test_a_stride_that_departs_from_its_tangent_is_refused(monkeypatch):
    """The limit is half of the stride's length; here it is 0, so that no stride is accepted."""
    model = compile_shipped("slider_crank_spatial")
    arguments = {"model": model, "joints": ("crank",), "terms": SmoothTerms(model)}
    assert np.isfinite(spatial.solve([0.1], **arguments)["slider"]).all()
    monkeypatch.setattr(motion, "MAX_TANGENT_CHANGE", 0.0)
    with pytest.raises(ValueError, match="limit position with the drives at 0"):
        spatial.solve([0.2], **arguments)


def parallelogram(key: str) -> mujoco.MjModel:
    """A parallelogram with cranks of 0.2 m and a coupler of 0.5 m, which keeps its direction."""
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option gravity="0 0 0"><flag contact="disable"/></option>
      <worldbody><body><joint axis="0 -1 0"/><geom size=".05" pos=".1 0 0"/>
        <body pos=".2 0 0"><joint axis="0 -1 0"/><geom size=".05" pos=".25 0 0"/>
          <site name="one" pos=".5 0 0"/></body></body>
      <body pos=".5 0 0"><joint axis="0 -1 0"/><geom size=".05" pos=".1 0 0"/>
        <site name="two" pos=".2 0 0"/></body></worldbody>
      <equality><connect site1="one" site2="two"/></equality>
      <keyframe><key name="start" {key}/></keyframe></mujoco>""")


def test_a_start_in_a_flat_pose_is_refused():
    """In the flat pose of a parallelogram its loop has one independent row less than elsewhere."""
    with pytest.raises(ValueError, match="the equalities lose rank: 2 rows hold, 1 at the start"):
        spatial.solve([0.0, 0.1], model=parallelogram('qvel="1 -1 1"'))


def test_a_motion_ends_near_a_pose_where_a_loop_loses_rank():
    """Without weight the cranks turn at a constant rate; every half turn the linkage is flat."""
    turn, rate = 0.5, -2.0
    model = parallelogram(f'qpos="{turn} {-turn} {turn}" qvel="{rate} {-rate} {rate}"')
    with pytest.raises(ValueError, match="steps become too short, as where equalities") as error:
        spatial.solve([0.0, 20.0], model=model)
    end = float(re.search(r"t = ([\d.]+) s", str(error.value))[1])
    halves = (turn + rate * end) / np.pi
    assert halves == pytest.approx(round(halves), abs=1e-5)  # times have six digits


@pytest.mark.parametrize(("rows", "least"), [(6, 1.0), (6, 1e-4), (9, 1e-3), (9, 1e-4)])
def test_the_inverse_of_drives_and_equalities_is_the_pseudo_inverse(rows: int, least: float):
    rng = np.random.default_rng(5)
    left, right = (np.linalg.qr(rng.normal(size=(n, 6)))[0] for n in (rows, 6))
    values = np.geomspace(1.0, least, 6)
    found = regular_pseudo_inverse((left * values) @ right.T)
    assert found is not None
    # rounding changes an inverse by eps times the ratio of the singular values of the matrix
    np.testing.assert_allclose(
        found, (right / values) @ left.T, rtol=0, atol=1e-14 / least**2 / np.sqrt(rows)
    )


@pytest.mark.parametrize("least", [0.0, 1e-16, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6])
def test_a_nearly_singular_matrix_has_no_regular_pseudo_inverse(least: float):
    """The smallest singular value is 1e-6 of the largest or less; it may consist of rounding."""
    rng = np.random.default_rng(7)
    for columns in range(3, 20):
        rows = columns + columns % 3
        left, right = (np.linalg.qr(rng.normal(size=(n, columns)))[0] for n in (rows, columns))
        values = np.array([*np.geomspace(1.0, 0.05, columns - 1), least])
        assert regular_pseudo_inverse((left * values) @ right.T) is None


def test_nearly_dependent_rows_have_no_regular_pseudo_inverse():
    rows = np.eye(6)
    rows[5] = rows[4] + 1e-6 * rows[5]
    assert regular_pseudo_inverse(rows) is None
    assert regular_pseudo_inverse(rows[:5]) is None


DOOR_MODEL = """
<mujoco><option><flag contact="disable"/></option>
<worldbody>
  <body name="door" pos=".3 .2 .1"><joint name="hinge" pos=".1 .2 .3" axis="{axis}"/>
    <geom type="box" size=".4 .05 1" pos=".5 .1 .2" density="300"/>
    <body name="plate"><geom size=".1" pos=".2 .1 .3"/></body>
  </body>
</worldbody>
<equality>{equality}</equality>
<sensor><jointpos name="angle" joint="hinge"/></sensor>
<keyframe><key name="start" qpos=".3" qvel="1"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize("axis", [(0, 0, 1), (1, 0, 0), (1, 2, 3)])
@pytest.mark.parametrize("loop", ["second hinge", "plate"])
def test_a_loop_that_no_joint_can_open_does_not_act(axis, loop, tmp_path):
    """A second hinge on the axis of a door, and a plate welded to the door, change no motion.

    Rows of these loops are zero up to rounding, and MuJoCo leaves them out where they are zero.
    """
    place = np.array([0.1, 0.2, 0.3]) + 0.4 * np.array(axis) / np.linalg.norm(axis)
    equality = {
        "second hinge": f'<connect body1="door" anchor="{" ".join(map(repr, place.tolist()))}"/>',
        "plate": '<weld body1="door" body2="plate"/>',
    }[loop]
    times = np.linspace(0.0, 1.0, 3)
    texts = [
        DOOR_MODEL.format(axis=" ".join(map(str, axis)), equality=one) for one in ("", equality)
    ]
    free, looped = map(mujoco.MjModel.from_xml_string, texts)
    wanted = spatial.solve(times, model=free)["angle"]
    for source in (None, SmoothTerms(looped)):
        found = spatial.solve(times, model=looped, terms=source)["angle"]
        # the error of 3e-14 in each of some hundred steps
        np.testing.assert_allclose(found, wanted, atol=1e-11)
    file = tmp_path / "door.xml"
    file.write_text(texts[1])
    run = Run("dynamics", times, ("angle",), (), settings={"timestep": 1e-3, "integrator": "RK4"})
    # errors of fourth order in the step, with rates of up to 3 rad/s
    np.testing.assert_allclose(in_mujoco(file, run).channels["angle"], wanted, atol=1e-9)


def test_forces_that_cancel_are_compared_with_weights_and_gyroscopic_moments():
    """The bias force of a wheel on a vertical axis is rounding in both formulations."""
    text = DOOR_MODEL.format(axis="0 0 1", equality="")
    model, times = mujoco.MjModel.from_xml_string(text), np.linspace(0.0, 1.0, 3)
    found = spatial.solve(times, model=model, terms=SmoothTerms(model))["angle"]
    # nothing turns the door, whose rate of 1 rad/s stays; 3e-14 in each of a few steps
    np.testing.assert_allclose(found, 0.3 + times, atol=1e-12)


def test_the_state_at_the_end_of_a_step_is_evaluated_once(monkeypatch):
    """The terms of the last stage of a step serve to close the loops, too."""
    model, states, terms = compile_shipped("slider_crank_spatial"), [], SmoothTerms.terms

    def record(self, q, v, ctrl=None):
        states.append((q.tobytes(), v.tobytes()))
        return terms(self, q, v, ctrl)

    tree, source = spatial.tree_and_terms(model, "start", SmoothTerms(model))
    monkeypatch.setattr(SmoothTerms, "terms", record)
    motion.integrate_motion(tree, source, np.array([0.0, 0.05]))
    assert len(states) > 100
    assert len(states) - len(set(states)) <= 1  # the start is closed before anything is known
