"""Reactions between bodies and their parents in space, compared with MuJoCo and Newton's law."""

from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from proofmass.analytic import spatial
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.mujoco.engine import simulate as in_mujoco
from proofmass.sim.protocol.run import Run
from proofmass.sim.smooth import SmoothTerms
from tests.shipped import shipped


def solve(model: mujoco.MjModel, *args: object, **more: object) -> dict[str, np.ndarray]:
    """The spatial reference."""
    return spatial.solve(*args, model=model, terms=SmoothTerms(model), **more)


def with_sensors(file: Path, folder: Path) -> tuple[Path, tuple[str, ...]]:
    """Copy a model with force and torque sensors on each body with joints; give their channels."""
    root = ElementTree.fromstring(file.read_text(encoding="utf-8"))
    sensors, names = root.find("sensor"), []
    for body in root.iter("body"):
        if body.find("joint") is not None:
            own = {"name": f"seat of {body.get('name')}", "pos": ".01 .02 -.01", "euler": "1 2 3"}
            ElementTree.SubElement(body, "site", own)
            for kind in ("force", "torque"):
                names.append(f"{kind} on {body.get('name')}")
                ElementTree.SubElement(sensors, kind, {"name": names[-1], "site": own["name"]})
    copied = folder / file.name
    copied.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
    return copied, tuple(f"{name}.{part}" for name in names for part in "xyz")


@pytest.mark.parametrize(("name", "bodies"), [("delta", 9), ("stewart", 12)])
def test_reactions_of_closed_robots_at_rest_are_those_of_mujoco(name, bodies, tmp_path):
    """MuJoCo's inverse dynamics, with the rigid loop forces that proofmass applies in sweeps."""
    case = load_case(shipped(f"{name}.toml"))
    file, channels = with_sensors(case.model_path, tmp_path)
    assert len(channels) == 6 * bodies
    whole = plan_run(case, "sweep", "mujoco")
    run = Run("sweep", whole.x[::20], channels, whole.drives)
    found = in_mujoco(file, run).channels
    joints = tuple(drive.joint for drive in case.drive)
    model = mujoco.MjModel.from_xml_path(str(file))
    args = (part[0] if len(part) == 1 else part for part in run.motion(run.x))
    known = solve(model, *args, start=case.start, joints=joints)
    assert max(np.abs(known[one]).max() for one in channels) > 10.0
    assert max(np.abs(known[one] - found[one]).max() for one in channels) < 1e-11


def test_a_ball_joint_transmits_a_force_and_no_moment():
    """The force is mass times acceleration less weight, by an acceleration sensor at the centre."""
    spec = mujoco.MjSpec.from_file(str(shipped("heavy_top.xml")))
    model = spec.compile()
    assert model.jnt_type.tolist() == [mujoco.mjtJoint.mjJNT_BALL]
    name, place = model.body(1).name, model.jnt_pos[0]
    spec.body(name).add_site(name="pivot", pos=place)
    for kind in ("force", "torque"):
        type_ = getattr(mujoco.mjtSensor, f"mjSENS_{kind.upper()}")
        spec.add_sensor(name=kind, type=type_, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="pivot")
    body = mujoco.mjtObj.mjOBJ_BODY
    acceleration = mujoco.mjtSensor.mjSENS_FRAMELINACC
    spec.add_sensor(name="middle", type=acceleration, objtype=body, objname=name)
    for k, axis in enumerate("XYZ"):
        kind = getattr(mujoco.mjtSensor, f"mjSENS_FRAME{axis}AXIS")
        xbody = mujoco.mjtObj.mjOBJ_XBODY
        spec.add_sensor(name=f"axis{k}", type=kind, objtype=xbody, objname=name)
    model = spec.compile()
    found = solve(model, np.linspace(0, 0.5, 26), start=model.key(0).name)
    mass, weight = model.body_mass[1], model.opt.gravity
    pull = np.array([mass * (found[f"middle.{p}"] - g) for p, g in zip("xyz", weight, strict=True)])
    for k, part in enumerate("xyz"):
        axis = np.array([found[f"axis{k}.{p}"] for p in "xyz"])
        assert np.abs(found[f"force.{part}"] - (axis * pull).sum(axis=0)).max() < 1e-10
        assert np.abs(found[f"torque.{part}"]).max() < 1e-10
    assert np.ptp(found["force.x"]) > 0.1


WELDED_MODEL = """<mujoco><option gravity="1 2 -9.81"><flag contact="disable"/></option><worldbody>
  <site name="wall" pos=".3 .1 .2"/>
  <body name="arm" pos="0 0 1"><joint name="arm" axis="0 1 1"/>
    <inertial pos=".2 .1 0" mass="2" diaginertia=".1 .2 .25"/><site name="root"/>
    <site name="hook" pos=".5 .1 0" euler="20 30 40"/></body>
  <body name="box" pos=".6 .2 1.3" euler="10 50 20"><freejoint name="free"/>
    <inertial pos=".1 .2 .3" mass="1.5" diaginertia=".1 .2 .25"/>
    <site name="corner" pos=".1 0 -.1" euler="15 25 35"/></body></worldbody>
  <equality><weld name="weld" body1="box" body2="arm" torquescale=".4" anchor=".1 .1 0"/></equality>
  <actuator><motor name="push" site="corner" gear="1 -2 3 .4 .5 .6"/>
    <motor name="pull" site="corner" refsite="wall" gear="1 2 3 .4 -.5 .6"/></actuator>
  <sensor><force name="on box" site="corner"/><torque name="twist of box" site="corner"/>
    <force name="on arm" site="root"/><torque name="twist of arm" site="root"/>
    <framelinacc name="box" objtype="body" objname="box"/>
    <framelinacc name="bar" objtype="body" objname="arm"/>
    <framexaxis name="x" objtype="site" objname="root"/>
    <frameyaxis name="y" objtype="site" objname="root"/>
    <framezaxis name="z" objtype="site" objname="root"/></sensor>
  <keyframe><key name="start" qpos="0 .6 .2 1.3 1 0 0 0" qvel="1.5 0 0 0 0 0 0"
    ctrl="{}"/></keyframe></mujoco>"""


@pytest.fixture
def welded() -> mujoco.MjModel:
    """A box with a free joint that a weld constrains to a swinging arm."""
    model = mujoco.MjModel.from_xml_string(WELDED_MODEL.format("0 0"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    turn = np.zeros(4)
    mujoco.mju_euler2Quat(turn, np.radians([10, 50, 20]), "xyz")
    model.key_qpos[0, 4:8] = turn  # the pose in which the weld closes
    data.qpos[:] = model.key_qpos[0]
    mujoco.mj_forward(model, data)
    rows = np.zeros((6, model.nv))
    rows[:, :] = data.efc_J.reshape(-1, model.nv)[:6]
    spin = model.key_qvel[0, 0]
    model.key_qvel[0, 1:] = -np.linalg.lstsq(rows[:, 1:], rows[:, 0] * spin)[0]
    return model


def test_a_free_joint_transmits_no_force_and_no_moment(welded):
    welded.key_ctrl[0] = [2.0, -1.5]
    found = solve(welded, np.linspace(0, 0.4, 21))
    names = [f"{name}.{part}" for name in ("on box", "twist of box") for part in "xyz"]
    assert max(np.abs(found[name]).max() for name in names) < 1e-10
    assert np.abs(found["twist of arm.x"]).max() > 1.0


def test_the_reaction_of_the_ground_obeys_newtons_law(welded):
    """The reaction obeys Newton's law for both bodies, in components along the axes of the arm."""
    welded.key_ctrl[0] = [0.0, -1.5]
    found = solve(welded, np.linspace(0, 0.4, 21))
    needed = -np.array([[1.0], [2.0], [3.0]]) * -1.5 * np.ones(21)
    for mass, name in ((1.5, "box"), (2.0, "bar")):
        for k, part in enumerate("xyz"):
            needed[k] += mass * (found[f"{name}.{part}"] - welded.opt.gravity[k])
    for axis in "xyz":
        way = np.array([found[f"{axis}.{part}"] for part in "xyz"])
        assert np.abs(found[f"on arm.{axis}"] - (way * needed).sum(axis=0)).max() < 1e-10
    along = sum(found[f"twist of arm.{k}"] * c for k, c in (("y", 1.0), ("z", 1.0)))
    assert np.abs(along).max() < 1e-10  # no moment about the arm's hinge


def test_reactions_on_a_stop_are_those_with_a_drive(welded):
    """The arm rests on its stop, or a drive holds it there: both have equal reactions.

    At rest the drift of the constraint rows is only rounding, so this test does not distinguish
    formulations of the drift.
    """
    welded.key_qvel[0] = 0.0
    driven = solve(welded, [0.0], joints=("arm",))
    resting = mujoco.MjModel.from_xml_string(WELDED_MODEL.format("0 0"))
    resting.key_qpos[:] = welded.key_qpos
    resting.key_qvel[:] = resting.jnt_range[0, 1] = 0.0
    resting.jnt_limited[0], resting.jnt_range[0, 0] = 1, -3.0
    found = solve(resting, [0.0, 0.02])
    names = [f"{name} {body}" for body in ("box", "arm") for name in ("on", "twist of")]
    names = [f"{name}.{part}" for name in names for part in "xyz"]
    assert max(np.abs(found[name]).max() for name in names) > 5.0
    for name in names:
        assert found[name] == pytest.approx(driven[name][0], abs=1e-12), name


def test_undetermined_reactions_are_no_quantities(tmp_path):
    """Redundant loop constraints and a tendon with a spring leave reactions undetermined."""
    file, channels = with_sensors(shipped("bricard.xml"), tmp_path)
    model = mujoco.MjModel.from_xml_path(str(file))
    assert channels[0] not in solve(model, [0.0, 0.01])
    # in space the loop of a planar linkage is redundant normal to its plane
    model = mujoco.MjModel.from_xml_path(str(shipped("fourbar_forces.xml")))
    for joints in ((), ("crank",)):
        found = solve(model, [0.0], joints=joints)
        assert "rocker" in found
        assert not any("force" in name for name in found)
    text = WELDED_MODEL.format("0 0").replace('<weld name="weld" body1="box" body2="arm"', "<!--")
    tendon = (
        '<tendon><spatial name="t" {}><site site="wall"/><site site="root"/></spatial></tendon>'
    )
    bare = text.replace('torquescale=".4" anchor=".1 .1 0"/>', "-->")
    for more, there in (("", True), ('stiffness="3"', False)):
        model = mujoco.MjModel.from_xml_string(
            bare.replace("<sensor>", tendon.format(more) + "<sensor>")
        )
        assert ("on arm.x" in solve(model, [0.0, 0.1])) == there
