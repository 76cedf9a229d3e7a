"""Loads of motors on sites: the planar solver, virtual work, Newton's law, and both engines."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.analytic import planar
from proofmass.analytic.numerics import NotCovered
from proofmass.sim.mujoco.engine import simulate as in_mujoco
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk.engine import simulate as in_pymunk
from tests.shipped import shipped

DEAD_LOAD = '<motor name="pull" site="point" refsite="ground" gear="3 -7 0 0 0 0.4"/>'
FOLLOWER_LOAD = '<motor name="pull" site="point" gear="3 -7 0 0 0 0.4"/>'
ANGLES = np.linspace(0.2, 2 * np.pi, 7)


def write_four_bar(folder: Path, actuators: str = "", ctrl: str = "", turned: str = "") -> Path:
    """Write the four-bar with more actuators, and a site on the ground that they may refer to."""
    file = folder / f"four{len(list(folder.iterdir()))}.xml"
    text = shipped("fourbar.xml").read_text(encoding="utf-8")
    for old, new in (
        ("<worldbody>", f'<worldbody><site name="ground" {turned}/>'),
        ("</actuator>", f"{actuators}</actuator>"),
        ('<key name="start"', f'<key name="start" ctrl="0 {ctrl}"'),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    file.write_text(text, encoding="utf-8")
    return file


def holding_moments(file: Path, **arguments: object) -> np.ndarray:
    """Holding moments of the crank in a sweep."""
    model = mujoco.MjModel.from_xml_path(str(file))
    return planar.solve(ANGLES, model=model, joints=("crank",), **arguments)["holding_moment"]


@pytest.mark.parametrize("actuator", [DEAD_LOAD, FOLLOWER_LOAD], ids=["dead", "following"])
def test_the_drive_balances_the_virtual_work_of_a_load(tmp_path, actuator):
    """The virtual work of the load is that of a small rotation of the crank to both sides.

    It is force times displacement of the point, plus moment times rotation of the coupler.
    """
    file, bare = write_four_bar(tmp_path, actuator, "2"), write_four_bar(tmp_path)
    model = mujoco.MjModel.from_xml_path(str(bare))

    def placed(crank: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = planar.solve(crank, model=model, joints=("crank",))
        return np.array([found["point.x"], found["point.y"]]), found["coupler.angle"]

    step = 1e-5
    (ahead, turned), (behind, before) = placed(ANGLES + step), placed(ANGLES - step)
    force = 2 * np.array([[3.0], [-7.0]]) * np.ones(ANGLES.size)
    if actuator == FOLLOWER_LOAD:
        angle = placed(ANGLES)[1]
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        force = np.einsum("ijn,jn->in", turn, force)
    work = (force * (ahead - behind)).sum(axis=0) + 2 * 0.4 * (turned - before)
    found = holding_moments(file) - holding_moments(bare)
    assert np.abs(found + work / (2 * step)).max() < 1e-8 * np.abs(found).max()


def test_a_dead_load_is_the_weight_of_a_mass_at_rest(tmp_path):
    """The mass is 1.5 kg, a small body at the point of the coupler."""
    text = write_four_bar(tmp_path).read_text(encoding="utf-8")
    inertial = '<inertial pos="0 0 0" mass="1.5" diaginertia="1e-12 1e-12 1e-12"/>'
    site = '<site name="point" pos="1 0.8 0"/>'
    assert site in text
    heavy = tmp_path / "heavy.xml"
    heavy.write_text(text.replace(site, f'{site}<body pos="1 0.8 0">{inertial}</body>'))
    pull = '<motor name="pull" site="point" refsite="ground" gear="0 -1 0 0 0 0"/>'
    loaded = write_four_bar(tmp_path, pull, str(1.5 * 9.81))
    assert (
        np.abs(holding_moments(loaded) - holding_moments(heavy)).max()
        < 1e-12 * np.abs(holding_moments(heavy)).max()
    )


def test_the_site_on_the_ground_may_be_rotated(tmp_path):
    """If the site on the ground is rotated by a quarter turn, x of the load is y of the world."""
    turned = DEAD_LOAD.replace("3 -7 0", "-7 -3 0")
    one = write_four_bar(tmp_path, DEAD_LOAD, "2")
    two = write_four_bar(tmp_path, turned, "2", turned='euler="0 0 1.5707963267948966"')
    three = write_four_bar(tmp_path, turned, "2")
    assert (
        np.abs(holding_moments(one) - holding_moments(two)).max()
        < 1e-13 * np.abs(holding_moments(one)).max()
    )
    assert np.abs(holding_moments(one) - holding_moments(three)).max() > 1.0


PENDULUM_MODEL = """<mujoco><compiler angle="radian"/><option gravity="0 -9.81 0" timestep="1e-3"
  integrator="RK4"><flag contact="disable"/></option><worldbody><site name="ground"/>
  <body name="bar"><joint name="bar"/><inertial pos=".5 0 0" mass="2" diaginertia=".1 .1 .2"/>
    <site name="root"/><site name="tip" pos="1 0 0"/>
    <body name="two" pos="1 0 0"><joint name="two" stiffness="3" damping=".1"/>
      <inertial pos=".2 0 0" mass="1" diaginertia=".1 .1 .2"/><site name="end" pos=".4 0 0"/></body>
  </body></worldbody><actuator>{}</actuator>
  <sensor><jointpos name="bar" joint="bar"/><jointpos name="two" joint="two"/>
    <framelinacc name="first" objtype="body" objname="bar"/>
    <framelinacc name="second" objtype="body" objname="two"/>
    <framexaxis name="way" objtype="xbody" objname="bar"/>
    <framepos name="end" objtype="site" objname="end"/>
    <force name="force" site="root"/><torque name="torque" site="root"/>
    <jointactuatorfrc name="on_bar" joint="bar"/>{}</sensor>
  <keyframe><key name="start" qpos=".3 .2" ctrl="{}"/></keyframe></mujoco>"""
LOADS = """<motor name="pull" site="end" refsite="ground" gear="3 2 0 0 0 0"/>
  <motor name="push" site="tip" gear="0 5 0 0 0 .7"/>"""
TIMES = np.linspace(0.0, 1.0, 101)


def write_double_pendulum(folder: Path, actuators: str, ctrl: str, sensors: str = "") -> Path:
    """Write a double pendulum with actuators."""
    file = folder / f"double{len(list(folder.iterdir()))}.xml"
    file.write_text(PENDULUM_MODEL.format(actuators, sensors, ctrl))
    return file


def free_motion(file: Path, **arguments: object) -> dict[str, np.ndarray]:
    """The free motion of a model."""
    return planar.solve(TIMES, model=mujoco.MjModel.from_xml_path(str(file)), **arguments)


def test_the_reaction_of_the_ground_obeys_newtons_law(tmp_path):
    """It is masses times accelerations, less weights and loads.

    The sensor `jointactuatorfrc` has the moments of both loads about the joint.
    """
    found = free_motion(write_double_pendulum(tmp_path, LOADS, "1 1"))
    along = np.array([np.cos(found["bar"]), np.sin(found["bar"])])
    across = np.array([-along[1], along[0]])
    pull = np.array([[3.0], [2.0]]) * np.ones(TIMES.size)
    needed = -pull - 5.0 * across + np.array([[0.0], [3 * 9.81]])
    for mass, name in ((2.0, "first"), (1.0, "second")):
        needed = needed + mass * np.array([found[f"{name}.x"], found[f"{name}.y"]])
    for part, way in (("x", along), ("y", across)):
        assert np.abs(found[f"force.{part}"] - (needed * way).sum(axis=0)).max() < 1e-10
    end = np.array([found["end.x"], found["end.y"]])
    moment = 5.0 * 1.0 + 0.7 + end[0] * pull[1] - end[1] * pull[0]
    assert np.abs(found["on_bar"] - moment).max() < 1e-12


def test_a_load_across_a_bar_is_a_moment(tmp_path):
    """The force follows the bar, 1 m from the joint; the load's own moment is added."""
    site = free_motion(
        write_double_pendulum(tmp_path, '<motor name="push" site="tip" gear="0 5 0 0 0 .7"/>', "2")
    )
    motor = free_motion(
        write_double_pendulum(tmp_path, '<motor name="push" joint="bar" gear="11.4"/>', "1")
    )
    assert np.ptp(site["bar"]) > 1.0
    for name in ("bar", "two", "end.x", "end.y", "on_bar"):
        assert np.abs(site[name] - motor[name]).max() < 1e-11


def test_the_work_of_dead_loads_becomes_energy(tmp_path):
    """Energy less force times displacement is constant; the joint has no damper here."""
    text = write_double_pendulum(
        tmp_path, LOADS.split("\n")[0], "1.5", '<e_kinetic name="kinetic"/>'
    ).read_text()
    file = tmp_path / "undamped.xml"
    file.write_text(
        text.replace('damping=".1"', "").replace(
            "</sensor>", '<e_potential name="level"/></sensor>'
        )
    )
    found = free_motion(file)
    energy = found["kinetic"] + found["level"] - 4.5 * found["end.x"] - 3.0 * found["end.y"]
    assert np.ptp(found["kinetic"]) > 1.0
    assert np.ptp(energy) < 1e-11


def test_both_engines_converge_to_the_motion(tmp_path):
    """In spite of the damper MuJoCo's RK4 is of fourth order, and pymunk of second."""
    file = write_double_pendulum(tmp_path, LOADS, "1 1")
    known = free_motion(file)
    names = ("bar", "two", "end.x", "end.y")
    exact = in_mujoco(file, Run("dynamics", TIMES, names, settings={"timestep": 2e-3})).channels
    assert max(np.abs(exact[name] - known[name]).max() for name in names) < 1e-8
    errors = []
    for step in (1e-3, 5e-4):
        run = Run("dynamics", TIMES, (*names, "force.x", "force.y", "torque.z"))
        found = in_pymunk(file, Run(**{**vars(run), "settings": {"timestep": step}})).channels
        errors.append([np.abs(found[name] - known[name]).max() for name in run.channels])
    assert max(errors[1][:4]) < 1e-4
    assert max(errors[1][4:]) < 1e-2  # N, N m
    assert np.max(errors[0]) / np.max(errors[1]) == pytest.approx(4.0, rel=0.1)


def test_both_engines_have_the_holding_moments_of_a_loaded_four_bar(tmp_path):
    file = write_four_bar(tmp_path, DEAD_LOAD + FOLLOWER_LOAD.replace("pull", "push"), "2 -1.3")
    drive = Drive("crank", lambda t: (t, np.ones_like(t), np.zeros_like(t)))
    run = Run("sweep", ANGLES, ("holding_moment",), (drive,))
    wanted = holding_moments(file)
    assert np.abs(wanted - holding_moments(write_four_bar(tmp_path))).max() > 10.0
    for engine, error in ((in_mujoco, 1e-11), (in_pymunk, 1e-7)):
        found = engine(file, run).channels["holding_moment"]
        assert np.abs(found - wanted).max() < error * np.ptp(wanted)


def test_a_changing_load_is_evaluated_at_each_sample(tmp_path):
    file, size = write_four_bar(tmp_path, DEAD_LOAD, "2"), np.linspace(-1.0, 3.0, ANGLES.size)
    bare, whole = holding_moments(write_four_bar(tmp_path)), holding_moments(file)
    found = holding_moments(file, controls={"pull": size})
    assert np.abs(found - (bare + size / 2 * (whole - bare))).max() < 1e-12


def test_a_load_that_changes_in_time_acts_as_a_changing_moment(tmp_path):
    def profile(t):
        return np.sin(3 * t), 3 * np.cos(3 * t), -9 * np.sin(3 * t)

    one = write_double_pendulum(tmp_path, '<motor name="push" site="tip" gear="0 5 0 0 0 0"/>', "0")
    two = write_double_pendulum(tmp_path, '<motor name="push" joint="bar" gear="5"/>', "0")
    profiles = {"push": profile}
    site, motor = (
        free_motion(one, control_profiles=profiles),
        free_motion(two, control_profiles=profiles),
    )
    assert max(np.abs(site[name] - motor[name]).max() for name in ("bar", "two", "on_bar")) < 1e-11


def test_the_sensor_of_an_actuator_has_its_own_force(tmp_path):
    """Two actuators on one joint and one on a site, with ranges of control and of force."""
    actuators = """<motor name="a" joint="two" gear="2"/>
      <motor name="b" joint="two" gear="3" ctrlrange="-1 .5" ctrllimited="true"/>
      <motor name="c" site="tip" gear="0 4 0 0 0 0" forcerange="-1 .3" forcelimited="true"/>
      <position name="d" joint="bar" kp="5" kv=".2"/><motor name="e" joint="two" group="1"/>"""
    names = "abcde"
    sensors = "".join(f'<actuatorfrc name="f{name}" actuator="{name}"/>' for name in names)
    file = write_double_pendulum(tmp_path, actuators, "1 2 3 0.4 1", sensors)
    file.write_text(file.read_text().replace('"RK4"', '"RK4" actuatorgroupdisable="1"'))
    model = mujoco.MjModel.from_xml_path(str(file))
    found, data = planar.solve(TIMES[:2], model=model), mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    for name, force in zip(names, [1.0, 0.5, 0.3, 0.5, 0.0], strict=True):
        assert data.sensor(f"f{name}").data[0] == pytest.approx(force, abs=1e-12)
        assert found[f"f{name}"][0] == pytest.approx(force, abs=1e-12)
    assert data.sensor("on_bar").data[0] == pytest.approx(found["on_bar"][0], abs=1e-12)


@pytest.mark.parametrize(
    ("actuator", "why"),
    [
        ('site="tip" refsite="ground" gear="1 0 1e-3 0 0 0"', "'pull' leaves the plane of motion"),
        ('site="tip" gear="1 0 0 .1 0 0"', "'pull' leaves the plane of motion"),
        (
            'site="tip" refsite="root" gear="1 0 0 0 0 0"',
            "'pull', which acts at a site",
        ),
    ],
)
def test_loads_that_are_not_covered_are_refused(tmp_path, actuator, why):
    file = write_double_pendulum(tmp_path, f'<motor name="pull" {actuator}/>', "1")
    with pytest.raises(NotCovered, match=why):
        free_motion(file)


def test_a_servo_on_a_site_is_refused(tmp_path):
    servo = '<position name="pull" site="tip" refsite="ground" gear="1 0 0 0 0 0" kp="3"/>'
    with pytest.raises(NotCovered, match="'pull', which is a servo on such a site"):
        free_motion(write_double_pendulum(tmp_path, servo, "1"))


def test_sensors_that_an_engine_cannot_show_with_a_load_are_missing(tmp_path):
    file = write_double_pendulum(tmp_path, LOADS, "1 1")
    run = Run("dynamics", TIMES[:3], ("bar", "on_bar", "force.x"))
    assert "leave out actuator 'pull'" in in_mujoco(file, run).missing["force.x"]
    assert in_pymunk(file, run).missing["on_bar"].startswith("what loads on sites do to a joint")
