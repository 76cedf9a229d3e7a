"""Sweeps and equilibria of engines that only step in time: they come to rest at each sample.

The engine of the quick tests is pymunk by the script of other interpreters, in this interpreter.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.case.case import Case
from proofmass.run.sidecar import load_case
from proofmass.run.solve import prescribed_run
from proofmass.sim.balance import ForceBalance
from proofmass.sim.engines import engine_of
from proofmass.sim.hosts.engine import HostedEngine
from proofmass.sim.interpreter.mechanism import WayToRest
from proofmass.sim.interpreter.rests import CALM_CHECKS, NoRest, come_to_rest
from proofmass.sim.protocol.failures import Diverged, Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.sim.resting import FASTEST_PHASE, MAX_FALL, RestReader, read_rest
from proofmass.verdict.compare import compare
from tests.engines import PYMUNK_HERE as HERE
from tests.engines import why_not_there
from tests.shipped import shipped, shipped_case

AT_REST = 1e-9
"""Error over the range of a rest: the speed at which the engine counts as at rest lets the pose
change by 1e-11 of the size; the slowest of these mechanisms turn such a way into ten times as much,
and pins near a dead centre into ten times that."""


def few(name: str, kind: str, samples: int) -> tuple[Case, Run]:
    """A shipped case, and its run with few samples."""
    case = shipped_case(shipped(f"{name}.toml"))
    run = case.run[kind].model_copy(update={"n": samples})
    case = case.model_copy(update={"run": {kind: run}, "refine": None})
    return case, prescribed_run(case, kind)


def errors(case: Case, run: Run, engine: HostedEngine = HERE) -> dict[str, float]:
    """By channel the error over the range; channels that the engine has not are left out."""
    curves = engine.simulate(case.model_path, run)
    found = compare(case, run.kind, "pymunk", curves, detectable=False)
    return {c.channel: c.relative_to_range for c in found if c.channel in curves.channels}


@pytest.mark.parametrize(
    ("name", "samples", "channels"),
    [
        ("balancer_sine", 5, {"deflection3", "segment2.angle", "holding_moment", "node2_force.y"}),
        ("springs_series", 5, {"gap", "stretch2", "force", "energy"}),
        ("balancer_progressive_contact", 5, {"deflection2", "holding_moment", "node2_load.z"}),
        ("fourbar", 5, {"rocker", "holding_moment"}),
    ],
    ids=["springs", "stop that opens", "stop that is met", "drives alone"],
)
def test_rest_is_that_of_the_reference(name: str, samples: int, channels: set[str]) -> None:
    """Poses, moments of drives and forces between bodies, of springs, stops and drives alone."""
    found = errors(*few(name, "sweep", samples))
    assert channels <= found.keys()
    assert {channel: share for channel, share in found.items() if share > AT_REST} == {}


@pytest.mark.parametrize("name", ["rod_cantilever", "rod_into_circle"])
def test_rest_of_a_rod_is_that_of_its_chain(name: str) -> None:
    """A rod of six links falls to the rest that Newton's method finds in MuJoCo, sensors too."""
    case, run = few(name, "equilibrium", 41)
    case = case.with_segments({"rod": 6})
    run = replace(run, rods=case.rods)
    found, same = (
        engine.simulate(case.model_path, run).channels for engine in (HERE, engine_of("mujoco"))
    )
    assert found.keys() == same.keys() == case.channels.keys()
    for channel, curve in found.items():
        size = max(np.ptp(same[channel]), np.abs(same[channel]).max())
        assert np.abs(curve - same[channel]).max() < AT_REST * size + 1e-14  # rounding of zeros
    assert max(errors(case, run).values()) > 1e-3  # of six links


def test_another_stiffness_shows(tmp_path: Path) -> None:
    """A rest is that of the engine's own springs: one that is stiffer by 1e-4 shows by as much."""
    text = shipped("balancer_sine.xml").read_text().replace("0.4359", "0.43594359")
    (tmp_path / "balancer_sine.xml").write_text(text)
    (tmp_path / "balancer_sine.toml").write_text(shipped("balancer_sine.toml").read_text())
    case = load_case(tmp_path / "balancer_sine.toml")
    _, run = few("balancer_sine", "sweep", 5)
    found = errors(case, run)
    assert found["deflection2"] > 1e-5
    assert found["deflection2"] < 1e-3


def test_a_joint_sticks_and_slips_on_its_way() -> None:
    """A pendulum on a shaft that turns to and fro, where one rest has two moments by its way.

    A move takes ten periods, in which the motion toward the slipping rest decays by e^-60; what is
    left is what the engine counts as at rest, in a pose whose height changes with its square.
    """
    case, run = few("shaft_pendulum", "sweep", 13)
    found = errors(case, run)
    assert {"slip", "bob.x", "hinge_moment.z", "holding_moment"} <= found.keys()
    assert {channel: share for channel, share in found.items() if share > 1e-7} == {}


def test_friction_of_a_joint_shows_in_its_rest(tmp_path: Path) -> None:
    """Friction that is larger by a tenth lets the pendulum slip later, by 0.3 of its weight."""
    for name in ("shaft_pendulum.xml", "shaft_pendulum.toml"):
        text = shipped(name).read_text()
        (tmp_path / name).write_text(text.replace('frictionloss="0.3"', 'frictionloss="0.33"'))
    case = load_case(tmp_path / "shaft_pendulum.toml")
    _, run = few("shaft_pendulum", "sweep", 13)
    found = errors(case, run)
    assert found["hinge_moment.z"] == pytest.approx(0.05, rel=0.1)  # 0.03 N m of a range of 0.6


def test_friction_that_drives_move_loads_the_drive() -> None:
    """The moment of a drive has the friction of all joints of a driven slider-crank, both ways."""
    found = errors(*few("slider_crank_friction", "sweep", 9))
    assert found["holding_moment"] < 1e-6  # 2000 iterations leave 1e-7 of the pose
    assert found["guide_force.y"] < 1e-6


def test_friction_that_a_rest_does_not_tell_has_no_moment() -> None:
    """Two joints share the friction of one motion: forces are missing by name, the pose is not."""
    case, run = few("balancer_prototype", "sweep", 181)
    curves = HERE.simulate(case.model_path, replace(run, x=run.x[:12]))
    assert "friction of 'joint2', 'joint3' does not follow" in curves.missing["holding_moment"]
    found = compare(case, "sweep", "pymunk", curves, detectable=False)
    shares = {c.channel: c.relative_to_range for c in found if c.channel in curves.channels}
    # drag of a move shifts where the joints begin to slip: by 1e-5 rad of the 0.03 rad until here
    assert shares["deflection2"] < 1e-3


def test_friction_in_a_sweep_that_begins_off_its_rest_is_refused(tmp_path: Path) -> None:
    """Where friction holds a joint at the start, its force there is not determined."""
    text = shipped("shaft_pendulum.xml").read_text().replace('qpos="0 0"', 'qpos="0 0.1"')
    (tmp_path / "off.xml").write_text(text)
    _, run = few("shaft_pendulum", "sweep", 5)
    with pytest.raises(Unsupported, match="'pendulum' in a sweep that does not begin at rest"):
        HERE.simulate(tmp_path / "off.xml", run)


def test_friction_in_an_equilibrium_is_refused() -> None:
    """Friction leaves a range of equilibria."""
    case, run = few("shaft_pendulum", "sweep", 5)
    with pytest.raises(Unsupported, match="frictionloss of joint 'pendulum' in equilibrium"):
        HERE.simulate(case.model_path, replace(run, kind="equilibrium"))


def test_rates_are_missing_with_the_reason() -> None:
    """At rest there are no rates: their channels say so, and none is zero."""
    case, run = few("fourbar", "sweep", 3)
    curves = HERE.simulate(case.model_path, run)
    assert "no rates" in curves.missing["rocker_rate"]
    assert curves.derivatives == 0
    assert curves.steps > 0


def test_a_sweep_with_inertia_is_refused() -> None:
    """A sweep with inertia has rates, which a rest has not."""
    case, run = few("fourbar", "sweep", 3)
    with pytest.raises(Unsupported, match="a sweep with inertia"):
        HERE.simulate(case.model_path, replace(run, inertia=True))


def test_an_engine_without_rests_is_named() -> None:
    """A script that does not come to rest is stepped in time only."""
    case, run = few("fourbar", "sweep", 3)
    engine = engine_of("mjx")
    assert isinstance(engine, HostedEngine)
    assert not engine.rests
    with pytest.raises(Unsupported, match="stepped in time only"):
        engine.simulate(case.model_path, run)


def test_joints_that_nothing_holds_are_refused(tmp_path: Path) -> None:
    """A joint without spring, weight or load has no rest."""
    file = tmp_path / "free.xml"
    file.write_text(
        '<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="drive"/>'
        '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><body><joint name="idle"/>'
        '<inertial pos="1 0 0" mass="1" diaginertia="1 1 1"/></body></body></worldbody>'
        '<keyframe><key name="start"/></keyframe></mujoco>'
    )
    run = replace(few("fourbar", "sweep", 3)[1], channels=())
    drive = replace(run.drives[0], joint="drive")
    with pytest.raises(Unsupported, match="no spring, weight or load holds"):
        read_rest(file, replace(run, drives=(drive,)))


def reader_of(name: str, samples: int = 9) -> RestReader:
    """The reader of a sweep with few samples."""
    case, run = few(name, "sweep", samples)
    return read_rest(case.model_path, run)


def test_inertia_and_drag_fit_the_step() -> None:
    """Two springs of 100 and 300 N/m hold a body: its phase in a step and its drag are as meant."""
    reader = reader_of("springs_series")
    mechanism = reader.mechanism()
    middle = next(link for link in mechanism.links if link.name == "middle")
    frequency = np.sqrt((100.0 + 300.0) / middle.mass)
    assert frequency * mechanism.step <= FASTEST_PHASE * (1 + 1e-6)
    assert mechanism.rest.drag == pytest.approx(2.0 * frequency, rel=1e-6)


def test_path_holds_at_samples_and_moves_between() -> None:
    """Drives stand still in the step at each sample, and their rates are those of their values."""
    reader = reader_of("balancer_sine")
    mechanism, x = reader.mechanism(), reader.run.x
    (drive,) = mechanism.drives
    wanted = reader.run.motion(x)[0][0]
    first = 2 * mechanism.count * np.arange(x.size)
    for k in range(3):
        assert drive.value[first + k] == pytest.approx(wanted, abs=1e-15)
        assert not drive.rate[first + k].any()
    moves = np.add.outer(first[:-1], np.arange(3, 2 * mechanism.count)).ravel()
    slopes = np.diff(drive.value)[moves] / (0.5 * mechanism.step)
    middles = 0.5 * (drive.rate[moves] + drive.rate[moves + 1])
    assert np.abs(slopes - middles).max() < 0.2 * np.abs(slopes).max()


def test_weights_become_loads() -> None:
    """Links have other masses, and the weights of the model: their sum and moment are the same."""
    reader = reader_of("fourbar", 3)
    mechanism, model, data = reader.mechanism(), reader.model, reader.data
    assert not mechanism.gravity.any()
    total = sum(load.share[0] * load.force for load in mechanism.loads)
    assert total == pytest.approx(model.body_mass.sum() * model.opt.gravity)
    moment = sum(np.cross(load.at, load.force) for load in mechanism.loads)
    weights = model.body_mass[:, None] * model.opt.gravity
    assert moment == pytest.approx(np.cross(data.xipos, weights).sum(axis=0))


FALLING = """<mujoco><compiler angle="radian"/>
  <option gravity="0 -9.81 0" timestep="1e-3"><flag contact="disable"/></option>
  <worldbody><body name="rod"><joint name="hinge" range="-1 2"/>
    <inertial pos="1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body>
    <body name="cart" pos="0 2 0"><joint name="slide" type="slide" axis="0 1 0" range="-0.5 1"/>
    <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body></worldbody>
  <sensor><jointpos name="angle" joint="hinge"/><jointpos name="way" joint="slide"/></sensor>
  <keyframe><key name="start" qpos="0 0"/></keyframe></mujoco>"""


@pytest.mark.parametrize(
    ("name", "slop"),
    [("here", 1e-9), ("bullet", 1e-6), ("dart", 1e-6), ("drake", 1e-6), ("box2d", 0.035)],
)
def test_what_falls_ends_on_its_stop(name: str, slop: float, tmp_path: Path) -> None:
    """In time a hinge and a slide end at the ends of their ranges; Box2D's slop is 2 degrees."""
    if name != "here" and (why := why_not_there(name)):
        pytest.skip(why)
    engine = HERE if name == "here" else engine_of(name)
    file = tmp_path / "falling.xml"
    file.write_text(FALLING)
    run = Run("dynamics", np.linspace(0.0, 3.0, 31), channels=("angle", "way"))
    found = engine.simulate(file, run).channels
    assert found["way"][2] == pytest.approx(-0.5 * 9.81 * run.x[2] ** 2, rel=0.02)
    assert found["angle"][-1] == pytest.approx(-1.0, abs=slop)
    assert found["way"][-1] == pytest.approx(-0.5, abs=slop)


REST = WayToRest(1.0, 1e-6, 1e-2, 1, 500)


def resting(speeds: Iterator[float]) -> int:
    """Steps until links with these speeds are at rest."""
    now = [0.0]

    def step() -> None:
        now[0] = next(speeds)

    return come_to_rest(REST, step, lambda: now[0])


def test_a_decaying_motion_comes_to_rest() -> None:
    """The steps end with a period of slow checks."""
    decay = (0.5**k for k in range(10_000))
    assert resting(decay) == 20 + CALM_CHECKS  # 2^-20 is the first speed below 1e-6


def test_rounding_is_a_rest_if_it_is_slow() -> None:
    """A speed that stays at 1e-3 is accepted, one at 1 is not."""
    assert resting(iter([1e-3] * 1000)) < REST.most
    with pytest.raises(NoRest, match=r"not at rest after \d+ steps.*at 1 m/s"):
        resting(iter([1.0] * 1000))


def test_a_turning_point_is_no_rest() -> None:
    """An oscillation whose speed is zero at many checks does not count as at rest."""
    with pytest.raises(NoRest, match="not at rest"):
        resting(abs(np.sin(0.5 * np.pi * k)) for k in range(10_000))


def test_a_lost_link_is_no_rest() -> None:
    """Speeds that are not finite end the run."""
    with pytest.raises(NoRest, match="not finite or lost"):
        resting(iter([1.0, np.nan]))


def test_a_chain_that_falls_apart_is_diverged(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that is given too few steps ends with the sample that has no rest."""
    monkeypatch.setattr("proofmass.sim.resting.MAX_PERIODS", 0.1)
    case, run = few("balancer_sine", "sweep", 5)
    with pytest.raises(Diverged, match=r"not at rest after \d+ steps.*at sample \d \(x = "):
        HERE.simulate(case.model_path, run)


def test_mujoco_of_another_version_comes_to_rest() -> None:
    """Its loops and stops are soft, as in a settled sweep of the version here: 1e-6 of a range."""
    if why := why_not_there("mujoco==3.6.0"):
        pytest.skip(why)
    engine = engine_of("mujoco==3.6.0")
    assert isinstance(engine, HostedEngine)
    for name in ("balancer_sine_preload", "fourbar"):
        case, run = few(name, "sweep", 5)
        assert max(errors(case, run, engine).values()) < 1e-5
        assert engine.simulate(case.model_path, run).steps > 1000


def test_a_preload_falls_slowly_off_its_stop() -> None:
    """A joint that nothing holds for a step moves by less than MAX_FALL, whatever presses on it."""
    mechanism = reader_of("balancer_sine_preload", 3).mechanism()
    joint = next(one for one in mechanism.joints if one.name == "joint2")
    moment = abs(joint.passive_force(joint.value, 0.0))
    inertia = float(mechanism.links[joint.child].inertia[0, 0])
    assert moment / inertia * mechanism.step**2 <= MAX_FALL * (1 + 1e-9)


ENGINES = {
    "exudyn": 1e-9,
    "bullet": 1e-9,
    "dart": 1e-8,
    "simbody": 1e-8,
    "pinocchio": 1e-9,
    "drake": 3e-3,
}
"""Errors over the range, by the way an engine closes loops: Drake's are stiff springs; Simbody's
accuracy and DART's speeds at rest leave ten times as much as the others."""


@pytest.mark.parametrize("name", ENGINES)
def test_engines_come_to_rest(name: str) -> None:
    """Engines of their own interpreters find the rest of a balancer, with a preload on its stop."""
    if why := why_not_there(name):
        pytest.skip(why)
    engine = engine_of(name)
    assert isinstance(engine, HostedEngine)
    assert max(errors(*few("balancer_sine", "sweep", 5), engine).values()) < ENGINES[name]
    preloaded = few("balancer_sine_preload", "sweep", 5)
    if engine.stops:
        assert max(errors(*preloaded, engine).values()) < ENGINES[name]
    else:
        with pytest.raises(Unsupported, match="'joint2' rests on the end of its range"):
            errors(*preloaded, engine)


@pytest.mark.parametrize("name", ["springs_series", "springs_parallel"])
def test_bullet_rests_where_a_driven_slide_is_pinned(name: str) -> None:
    """Its iterations end when they have converged: those beyond it do not let the pin rest."""
    if why := why_not_there("bullet"):
        pytest.skip(why)
    case, run = few(name, "sweep", 61)
    assert max(errors(case, replace(run, x=run.x[:12]), engine_of("bullet")).values()) < AT_REST


def test_simbody_refuses_loads_that_change_in_a_sweep() -> None:
    """Its loads are functions of the time, which goes on while the drives stand still."""
    if why := why_not_there("simbody"):
        pytest.skip(why)
    case, run = few("rfr2_load_path", "sweep", 5)
    with pytest.raises(Unsupported, match="loads that change in a sweep"):
        engine_of("simbody").simulate(case.model_path, run)


def test_pins_on_the_ground_carry_the_weight() -> None:
    """At rest the forces in the two pins of a four-bar on the ground add up to its weight."""
    model = mujoco.MjModel.from_xml_path(str(shipped("fourbar_forces.xml")))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    mujoco.mj_kinematics(model, data)
    still = np.zeros(model.nv)
    balance = ForceBalance(model, "start", [model.joint("crank").id])
    _, loops = balance.forces(data.qpos, still, still, data.ctrl, still)
    values = balance.sensors(still, loops)
    total = np.zeros(3)
    for name in ("crank_force", "rocker_force"):
        sensor = model.sensor(name)
        turn = data.site_xmat[sensor.objid[0]].reshape(3, 3)
        total += turn @ values[sensor.adr[0] : sensor.adr[0] + 3]
    weight = model.body_mass.sum() * model.opt.gravity
    assert np.abs(total) == pytest.approx(np.abs(weight), abs=1e-9 * np.abs(weight).max())
