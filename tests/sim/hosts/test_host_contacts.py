"""Contacts in engines of interpreters of their own: shapes, laws of pairs, impacts, refusals.

The engine of the quick tests is pymunk by the script of other interpreters, in this interpreter.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.run.sidecar import load_case
from proofmass.run.solve import prescribed_run
from proofmass.sim.engines import engine_of
from proofmass.sim.interpreter.checks import Refused
from proofmass.sim.interpreter.mechanism import LinkStates
from proofmass.sim.interpreter.pair_values import split_by_minimum, split_by_product
from proofmass.sim.neutral import read_mechanism
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.sim.states import StateCurves
from proofmass.verdict.compare import compare
from tests.engines import PYMUNK_HERE, why_not_there
from tests.shipped import shipped, shipped_case

PLANAR = "here", "pymunk==6.8.1", "box2d"
IN_SPACE = "bullet", "dart", "rapier"
PLASTIC = "drake"
"""The engine whose contacts do not bounce."""
ENGINES = *PLANAR, *IN_SPACE
SLIDING = {
    "block_slides": 1e-5,
    "block_sticks": 1e-4,
    "block_stops": 1e-4,
    "ball_rolls": 1e-4,
}
"""Errors over the range of positions: h^2 of accelerations of up to 10 m/s2 at 0.25 ms are 6e-7 m,
and what is left are single precision and the hops of a block that its contacts lift by rounding."""
IMPACTS = {"ball_bounces": 2e-3, "balls_in_row": 2e-2, "block_rocks": 2e-2}
"""Errors over the range: each impact is up to a step late, and a row of four adds up."""


@cache
def provided(engine: str) -> str:
    """Why an engine cannot be had, asked once."""
    return "" if engine == "here" else why_not_there(engine)


@pytest.fixture
def engine(request: pytest.FixtureRequest) -> Iterator[str]:
    """The engine of a test, which is skipped where uv cannot get it."""
    if why := provided(request.param):
        pytest.skip(why)
    return request.param


def of(*engines: str) -> pytest.MarkDecorator:
    """A test for some engines."""
    return pytest.mark.parametrize("engine", engines, indirect=True)


def simulate(engine: str, file: Path, run: Run):
    """The curves of a run in an engine."""
    return (PYMUNK_HERE if engine == "here" else engine_of(engine)).simulate(file, run)


def errors(engine: str, file: Path, **settings: object) -> dict[str, float]:
    """Errors over the range of the channels of positions of a case."""
    case = load_case(file) if file.parent != shipped(file.name).parent else shipped_case(file)
    run = replace(prescribed_run(case, "dynamics"), settings=settings)
    curves = simulate(engine, case.model_path, run)
    found = compare(case, "dynamics", engine, curves, detectable=False)
    units = case.channels_of("dynamics")
    return {
        c.channel: c.relative_to_range
        for c in found
        if c.channel in curves.channels and units[c.channel].si_unit in ("m", "rad")
    }


def changed(folder: Path, name: str, old: str, new: str) -> Path:
    """The sidecar of a shipped case beside a model with another number."""
    text = shipped(f"{name}.xml").read_text()
    assert old in text
    (folder / f"{name}.xml").write_text(text.replace(old, new))
    (folder / f"{name}.toml").write_text(shipped(f"{name}.toml").read_text())
    return folder / f"{name}.toml"


@of(*ENGINES)
@pytest.mark.parametrize("name", SLIDING)
def test_what_slides_and_rolls_is_the_reference(engine, name):
    worst = max(errors(engine, shipped(f"{name}.toml")).values())
    assert worst < SLIDING[name]


@of(PLASTIC)
@pytest.mark.parametrize("name", SLIDING)
def test_what_slides_in_drake_has_the_normal_force_of_the_step_before(engine, name):
    # the first steps differ by the share in which the engine's tolerance leaves a contact open
    worst = max(errors(engine, shipped(f"{name}.toml")).values())
    assert worst < 5e-3


@of(PLASTIC)
@pytest.mark.parametrize("name", IMPACTS)
def test_a_bounce_that_an_engine_has_not_is_refused_by_name(engine, name):
    with pytest.raises(Unsupported, match=r"an impact of .*'.*' with .* m/s, whose restitution"):
        errors(engine, shipped(f"{name}.toml"))


@of(*ENGINES)
@pytest.mark.parametrize("name", IMPACTS)
def test_impacts_are_those_of_the_reference(engine, name):
    worst = max(errors(engine, shipped(f"{name}.toml")).values())
    assert worst < IMPACTS[name]


@of("here", "dart")
def test_an_error_of_impacts_falls_with_the_step(engine):
    # in the sum over 16 steps: one impact may be late by chance with any step
    coarse, fine = (
        np.mean(
            [
                errors(engine, shipped("block_rocks.toml"), timestep=h * (1 + k / 50))["angle"]
                for k in range(4)
            ]
        )
        for h in (4e-4, 5e-5)
    )
    assert fine < coarse / 3


@of(*ENGINES, PLASTIC)
def test_another_friction_shows(engine, tmp_path):
    # a tenth more of mu g cos(0.5) = 2.58 m/s2 for 1 s, of a way of 1.06 m
    file = changed(tmp_path, "block_slides", 'friction="0.3', 'friction="0.33')
    assert errors(engine, file)["position"] == pytest.approx(0.5 * 0.258 / 1.06, rel=0.02)


@of(*ENGINES)
def test_another_restitution_shows(engine, tmp_path):
    file = changed(tmp_path, "ball_bounces", "-470.2627", "-700")  # 0.8 becomes 0.71
    assert errors(engine, file)["height"] > 0.1


@of(*ENGINES)
def test_another_size_of_a_shape_shows(engine, tmp_path):
    # a block that is wider by a tenth rocks slower: its arm, 0.05 m, turns it back
    file = changed(tmp_path, "block_rocks", 'size="0.05 0.05 0.2"', 'size="0.055 0.05 0.2"')
    assert errors(engine, file)["angle"] > 0.05


FALLS = """<mujoco><compiler angle="radian"/>
  <option timestep="1e-3"/>
  <default><geom solref="0.01 1000" friction="0.5 0 0" {condim}/></default>
  <worldbody>
    <geom name="floor" type="{floor}" size="2 2 0.1" pos="0 0 {level}"/>
    <body name="one" pos="0 0 0.3">
      {joints}<geom name="one" {geom} mass="1"/></body>
  </worldbody>
  <sensor><framepos name="place" objtype="body" objname="one"/></sensor>
  <keyframe><key name="start"/></keyframe></mujoco>"""
PLANE_JOINTS = (
    '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>'
)
SHAPES = {
    "sphere": ('type="sphere" size="0.1"', 0.1),
    "box": ('type="box" size="0.1 0.05 0.06"', 0.06),
    "box on its side": ('type="box" size="0.1 0.05 0.06" euler="0 1.5707963267948966 0"', 0.1),
    "cylinder across": ('type="cylinder" size="0.1 0.05" euler="1.5707963267948966 0 0"', 0.1),
    "capsule along": ('type="capsule" size="0.05 0.1" euler="0 1.5707963267948966 0"', 0.05),
    "capsule upright": ('type="capsule" size="0.05 0.1"', 0.15),
}
REFUSED = {
    ("box2d", "capsule along"): "capsule 'one', a segment with round ends",
    ("box2d", "capsule upright"): "capsule 'one', a segment with round ends",
    ("drake", "cylinder across"): "which touches in one point only",
}
"""What an engine has not."""


@of(*ENGINES, PLASTIC)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("floor", "level"), [("plane", 0.0), ("box", -0.1)])
def test_a_shape_falls_on_its_surface(engine, shape, floor, level, tmp_path):
    geom, height = SHAPES[shape]
    file = tmp_path / "falls.xml"
    text = {"joints": PLANE_JOINTS, "geom": geom, "floor": floor, "level": level, "condim": ""}
    file.write_text(FALLS.format(**text))
    run = Run("dynamics", np.linspace(0.0, 0.4, 21), channels=("place.x", "place.z"))
    boxes = engine == PLASTIC and floor == "box"  # which it has beside half spaces alone
    if why := REFUSED.get((engine, shape)) or ("which touches in one point only" if boxes else ""):
        with pytest.raises(Unsupported, match=re.escape(why)):
            simulate(engine, file, run)
        return
    place = simulate(engine, file, run).channels["place.z"]
    fall = 0.3 - 0.5 * 9.81 * run.x**2
    assert place[:9] == pytest.approx(fall[:9], abs=0.01)
    # it hits the floor with up to 2.2 m/s, and is up to two steps of 1 ms late
    assert place[-1] == pytest.approx(height, abs=5e-3)


@of(*IN_SPACE)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_free_shape_falls_in_space(engine, shape, tmp_path):
    geom, height = SHAPES[shape]
    file = tmp_path / "falls.xml"
    text = {"joints": "<freejoint/>", "geom": geom, "floor": "plane", "level": 0.0}
    file.write_text(FALLS.format(**text, condim='condim="3"'))
    run = Run("dynamics", np.linspace(0.0, 0.3, 16), channels=("place.x", "place.z"))
    place = simulate(engine, file, run).channels
    assert place["place.z"][-1] == pytest.approx(height, abs=5e-3)
    assert np.abs(place["place.x"]).max() < 1e-3


PAIRS = """<mujoco><compiler angle="radian"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 0.1" friction="0.6 0 0" priority="{priority}"/>
    <geom name="wall" type="plane" size="2 2 0.1" euler="0 1.5707963267948966 0"/>
    <body name="a" pos="0 0 1"><freejoint/>
      <geom name="ball" size="0.1" mass="1" friction="0.2 0 0" solref="0.01 0.5"/>
      <geom name="rod" type="capsule" size="0.02 0.3" mass="1" pos="0.1 0 0" euler="0 0.5 0"/>
      <geom name="air" type="box" size="1 1 1" mass="1" contype="0" conaffinity="0"/></body>
    <body name="b" pos="1 0 1"><freejoint/>
      <geom name="brick" type="box" size="0.1 0.2 0.3" mass="1" {brick}/></body>
  </worldbody>
  <contact><pair geom1="ball" geom2="brick" friction="0.9 0.9 0 0 0"/>
    <exclude body1="a" body2="b"/></contact></mujoco>"""


def mechanism_of(folder: Path, text: str):
    """The mechanism of a model for a run in time."""
    file = folder / "model.xml"
    file.write_text(text)
    run = Run("dynamics", np.linspace(0.0, 0.1, 3), ())
    return read_mechanism(file, run, contacts=True).mechanism()


def test_shapes_and_laws_are_those_of_the_model(tmp_path):
    found = mechanism_of(tmp_path, PAIRS.format(priority=1, brick=""))
    names = [one.name for one in found.shapes]
    laws = {frozenset((names[p.one], names[p.two])): p for p in found.contacts}
    sphere, rod, brick = "sphere 'ball'", "capsule 'rod'", "box 'brick'"
    floor, wall = "plane 'floor'", "plane 'wall'"
    assert laws.keys() == {
        frozenset(pair)
        for pair in [
            (floor, sphere),
            (floor, rod),
            (floor, brick),
            (wall, sphere),
            (wall, rod),
            (wall, brick),
            (sphere, brick),
        ]
    }  # not two planes, not those of an exclusion, but its <pair>
    assert laws[frozenset((floor, sphere))].friction == 0.6  # of the higher priority
    assert laws[frozenset((wall, sphere))].friction == 1.0  # the larger one
    assert laws[frozenset((sphere, brick))].friction == 0.9
    bounce = np.exp(-0.5 * np.arccos(0.5) * 2.0 / np.sqrt(1.0 - 0.25))  # damping ratio 0.5
    mixed = laws[frozenset((wall, sphere))].restitution  # of 0.5 and 1, as the mean of both
    assert 0.0 < mixed < bounce
    (one,) = [shape for shape in found.shapes if shape.name == rod]
    assert (one.kind, one.link) == ("capsule", 1)
    assert one.place == pytest.approx([0.1, 0.0, 1.0])
    assert one.axes[:, 2] == pytest.approx([np.sin(0.5), 0.0, np.cos(0.5)])
    assert one.size[:2] == pytest.approx([0.02, 0.3])


@pytest.mark.parametrize(
    ("brick", "named"),
    [
        ('condim="6"', "rolling friction (condim 6)"),
        ('condim="4" friction="1 0.1 0"', "torsional friction (condim 4)"),
        ('margin="0.01"', "margin of 0.01 m"),
    ],
)
def test_what_other_engines_have_not_is_refused_by_name(brick, named, tmp_path):
    with pytest.raises(Unsupported, match=re.escape(named)):
        mechanism_of(tmp_path, PAIRS.format(priority=0, brick=brick))


def test_an_ellipsoid_is_refused_by_its_name(tmp_path):
    text = PAIRS.format(priority=0, brick="").replace(
        'type="box" size="0.1', 'type="ellipsoid" size="0.1'
    )
    with pytest.raises(Unsupported, match="ellipsoid 'brick', which is no plane"):
        mechanism_of(tmp_path, text)


@of("exudyn")
def test_engines_without_contacts_are_named(engine):
    with pytest.raises(Unsupported, match="contacts of geoms that may touch"):
        errors(engine, shipped("ball_bounces.toml"))


def test_forces_beside_contacts_are_missing_with_the_reason(tmp_path):
    text = shipped("ball_bounces.xml").read_text()
    file = tmp_path / "ball.xml"
    file.write_text(
        text.replace("<sensor>", '<sensor><force name="carried" site="seat"/>').replace(
            '<geom name="ball"', '<site name="seat"/><geom name="ball"'
        )
    )
    run = Run("dynamics", np.linspace(0.0, 0.01, 3), channels=("carried.z",))
    assert "forces of contacts" in simulate("here", file, run).missing["carried.z"]


@of("here", "box2d", "rapier")
@pytest.mark.parametrize(
    "own", ['stiffness="3"', 'damping="1"', 'range="-1 1"', 'frictionloss="1"']
)
def test_a_force_in_a_row_of_joints_is_refused_by_its_name(engine, own, tmp_path):
    text = shipped("block_slides.xml").read_text()
    file = tmp_path / "row.xml"
    file.write_text(text.replace('name="along" type="slide"', f'name="along" type="slide" {own}'))
    run = Run("dynamics", np.linspace(0.0, 0.01, 3), channels=("position",))
    with pytest.raises(Unsupported, match="joint 'along' of a link that is free in its plane"):
        simulate(engine, file, run)


@of("box2d")
def test_a_step_that_box2d_would_shorten_is_refused(engine):
    with pytest.raises(Unsupported, match="2 units of length"):
        errors(engine, shipped("ball_bounces.toml"), timestep=0.02)


def test_two_engines_throw_a_box_in_the_same_way():
    """Rigid contacts of a corner with friction, until the second impact: to a step of 0.1 ms."""
    case, found = shipped_case(shipped("tumbling_box.toml")), []
    run = prescribed_run(case, "dynamics")
    for name in ("bullet", "rapier"):
        if why := provided(name):
            pytest.skip(why)
        short = replace(run, x=run.x[:41], settings={"timestep": 1e-4})  # until 0.2 s
        found.append(simulate(name, case.model_path, short).channels)
    for channel in ("centre.x", "centre.y", "centre.z", "corner.x", "corner.z"):
        assert found[0][channel] == pytest.approx(found[1][channel], abs=1e-4)


def test_numbers_of_surfaces_that_do_not_exist_are_refused():
    """Products around a ring of four are bound to each other, and minima in a triangle."""
    ring = {("a", "b"): 0.5, ("b", "c"): 0.5, ("c", "d"): 0.5, ("d", "a"): 0.4}
    with pytest.raises(Refused, match="between"):
        split_by_product(ring)
    with pytest.raises(Refused, match=r"0\.2 between a and c"):
        split_by_minimum({("a", "b"): 0.5, ("b", "c"): 0.5, ("a", "c"): 0.2})
    with pytest.raises(Refused, match="between a and b"):
        split_by_product({("a", "c"): 0.5, ("b", "c"): 0.5, ("a", "b"): 0.0})


ROW = """<mujoco><compiler angle="radian"/><option gravity="0 0 0"/>
  <worldbody><body name="base"><joint name="base" axis="0.6 0 0.8"/>
    <inertial pos="0.3 0.1 0" mass="1" diaginertia="1 1 1"/>
    <body name="end" pos="0.5 0 0.2">
      {joints}
      <inertial pos="0.2 0.3 0.1" mass="1" diaginertia="1 1 1"/></body></body></worldbody>
  <keyframe><key name="start" qpos="{pose}"/></keyframe></mujoco>"""
SLIDES = (
    '<joint name="first" type="slide" axis="1 0.2 0"/>',
    '<joint name="turn" axis="0 0.6 0.8" pos="0.1 0.2 -0.3"/>',
    '<joint name="last" type="slide" axis="0 1 1"/>',
)


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (0, 2, 1), (1, 2), (0, 1), (1,), (0,)])
def test_coordinates_of_a_row_of_joints_follow_from_its_link(order, tmp_path):
    """Slides and a hinge in any order on a moving link: coordinates, rates and accelerations."""
    n = len(order) + 1
    rng, file = np.random.default_rng(7), tmp_path / "row.xml"
    pose = 0.3 * rng.standard_normal(n)
    file.write_text(ROW.format(joints="".join(SLIDES[k] for k in order), pose=str(pose)[1:-1]))
    reader = read_mechanism(file, Run("dynamics", np.linspace(0.0, 0.1, 3), ()))
    mechanism = reader.mechanism()
    states, model = LinkStates.empty(mechanism), reader.model
    data, start = mujoco.MjData(model), mujoco.MjData(model)
    start.qpos[:] = reader.qpos
    mujoco.mj_kinematics(model, start)
    given = rng.standard_normal((3, 3, n))
    for k, (q, v, a) in enumerate(np.swapaxes(given, 0, 1)):
        data.qpos[:], data.qvel[:] = 0.5 * q, v
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        data.qacc[:] = a
        mujoco.mj_rnePostConstraint(model, data)
        for body in (1, 2):
            rate, change = np.zeros(6), np.zeros(6)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, rate, 0)
            mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_BODY, body, change, 0)
            turn = data.xmat[body].reshape(3, 3) @ start.xmat[body].reshape(3, 3).T
            parts = data.xipos[body], turn, rate[3:], rate[:3], change[3:], change[:3]
            states.set(k, body, parts)
    curves = StateCurves(reader, mechanism, states)
    for j in range(n):
        value, rate, acceleration = curves.joint(j)
        assert np.sin(value) == pytest.approx(np.sin(0.5 * given[0, :, j]), abs=1e-9)
        assert rate == pytest.approx(given[1, :, j], abs=1e-9)
        assert acceleration == pytest.approx(given[2, :, j], abs=1e-9)
