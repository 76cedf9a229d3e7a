"""Tests of contacts in pymunk: pairs of geoms, friction and impacts as in MuJoCo, refusals."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.analytic.contacts import bouncing_ball, restitution, rolling_ball, sliding_block
from proofmass.sim.contact_laws import find_pairs
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk.engine import ENGINE as PYMUNK
from proofmass.sim.pymunk.engine import simulate
from proofmass.sim.pymunk.model import read_links
from tests.programs import program_curves
from tests.shipped import shipped

JOINTS = (
    '<joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>'
    '<joint name="turn" axis="0 1 0"/>'
)
BALL = f'<body name="ball" pos="0 0 .1">{JOINTS}<geom name="ball" size=".1" mass="1" {{0}}/></body>'
FLOOR = '<geom name="floor" type="plane" size="2 2 1" {0}/>'
PLASTIC_CONTACT = 'solref=".01 1000"'
SENSORS = "".join(
    f'<jointpos name="{j}" joint="{j}"/><jointvel name="{j}_rate" joint="{j}"/>'
    for j in ("x", "z", "turn")
)


def write_model(tmp_path, bodies, velocity="0 0 0", more="", options="", pose="0 0 0"):
    file = tmp_path / "contacts.xml"
    file.write_text(
        f'<mujoco><compiler angle="radian"/><option timestep="1e-3" {options}/>'
        f"<worldbody>{bodies}</worldbody>{more}<sensor>{SENSORS}</sensor>"
        f'<keyframe><key name="start" qpos="{pose}" qvel="{velocity}"/></keyframe></mujoco>'
    )
    return file


def simulated_channels(file, until=1.0, samples=101, **settings):
    names = [f"{j}{part}" for j in ("x", "z", "turn") for part in ("", "_rate")]
    run = Run("dynamics", np.linspace(0.0, until, samples), tuple(names), settings=settings)
    return simulate(file, run).channels


# ---- the restitution of a damped spring that only pushes ----------------------------------------


@pytest.mark.parametrize("z", [0.01, 0.1, 0.5, 0.999, 1.0, 1.001, 2.0, 10.0])
def test_restitution_is_that_of_a_damped_spring_that_only_pushes(z):
    def let_go(t, y):
        return y[0] + 2.0 * z * y[1] if t > 0 else -1.0

    let_go.terminal = True
    done = solve_ivp(
        lambda t, y: [y[1], -y[0] - 2.0 * z * y[1]],
        (0.0, 1000.0),
        [0.0, -1.0],
        "DOP853",
        events=let_go,
        rtol=1e-12,
        atol=1e-14,
    )
    assert done.y[1, -1] == pytest.approx(restitution(z), rel=1e-6)
    # the restitution of a spring that may also pull, the formula of textbooks, is smaller
    if 0.05 < z < 1.0:
        assert restitution(z) > np.exp(-np.pi * z / np.sqrt(1.0 - z * z)) * 1.001


def restitution_in_mujoco(z, stiffness, mass=1.0):
    """Restitution in bare MuJoCo: ratio of speeds after and before an impact of 10,000 steps."""
    step = np.pi / np.sqrt(stiffness) / 10000
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{step}" gravity="0 0 0"/><worldbody>
      <geom type="plane" size="1 1 1" priority="1"
      solref="{-stiffness} {-2 * z * stiffness**0.5}"/>
      <body pos="0 0 .1"><joint type="slide" axis="0 0 1"/><geom size=".1" mass="{mass}"/></body>
      </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[0] = -1.0
    mujoco.mj_step(model, data, 40000)
    return float(data.qvel[0])


@pytest.mark.parametrize("z", [0.07, 0.4, 1.0])
def test_restitution_is_the_limit_of_mujocos_contact(z):
    """The difference to MuJoCo falls with the stiffness: its impedance grows with the depth."""
    errors = [
        abs(restitution_in_mujoco(z, stiffness) - restitution(z)) for stiffness in (1e4, 1e6, 1e8)
    ]
    assert errors[2] < 5e-4  # first order, with steps of 1e-4 of the contact's duration
    assert errors[2] < errors[0]


# ---- bodies that are free in the plane -----------------------------------------------------------


def test_a_free_body_flies_and_turns(tmp_path):
    body = BALL.replace("{0}", 'pos=".03 0 .01"').replace(
        'axis="0 1 0"', 'axis="0 1 0" pos=".2 0 .1"'
    )
    flying = simulated_channels(write_model(tmp_path, body, "1 2 3", pose=".1 .2 .3"), until=0.5)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "contacts.xml"))
    model.opt.timestep, model.opt.integrator = 1e-3, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 500)
    for k, name in enumerate(("x", "z", "turn")):
        # the pose is of second order; the hinge's anchor turns about the centre at 3 rad/s
        assert flying[name][-1] == pytest.approx(data.qpos[k], abs=1e-6)
        assert flying[f"{name}_rate"][-1] == pytest.approx(data.qvel[k], abs=1e-5)


@pytest.mark.parametrize(
    ("joints", "named"),
    [
        (JOINTS.replace('name="turn"', 'name="turn" damping="1"'), "damping of joint 'turn'"),
        (JOINTS.replace('name="x"', 'name="x" stiffness="1"'), "a spring of joint 'x'"),
        (JOINTS.replace('name="z"', 'name="z" range="-1 1"'), "a range of joint 'z'"),
        (JOINTS.replace('name="z"', 'name="z" armature="1"'), "armature of joint 'z'"),
        (JOINTS.replace('axis="0 0 1"', 'axis="1 0 1"'), "slides are not at right angles"),
        (
            JOINTS[JOINTS.index('<joint name="turn"') :]
            + JOINTS[: JOINTS.index('<joint name="turn"')],
            "3 joints on body 'ball'",
        ),
        (JOINTS[: JOINTS.index('<joint name="turn"')], "2 joints on body 'ball'"),
    ],
)
def test_features_that_a_free_body_may_not_have_are_refused(tmp_path, joints, named):
    body = BALL.replace(JOINTS, joints)
    file = tmp_path / "free.xml"
    file.write_text(f"<mujoco><worldbody>{body.format('')}</worldbody></mujoco>")
    with pytest.raises(Unsupported, match=named):
        simulate(file, Run("dynamics", np.linspace(0.0, 0.1, 3), ()))


def test_a_free_body_in_an_equilibrium_run_is_refused(tmp_path):
    file = write_model(tmp_path, BALL.format(""))
    with pytest.raises(Unsupported, match="free in the plane, in equilibrium"):
        simulate(file, Run("equilibrium", np.zeros(1), ()))


# ---- motions with closed forms -------------------------------------------------------------------


def test_a_block_slides_and_stops(tmp_path):
    block = BALL.format('type="box"').replace('size=".1"', 'size=".2 .1 .1"')
    file = write_model(
        tmp_path,
        FLOOR.format(PLASTIC_CONTACT + ' friction=".4 0 0"') + block.format(""),
        "2 0 0",
        options='integrator="Euler"',
    )
    file.write_text(
        file.read_text().replace('mass="1"', 'mass="1" friction=".4 0 0" solref=".01 1000"')
    )
    found = simulated_channels(file)
    truth = sliding_block.solve(np.linspace(0, 1, 101), friction=0.4, speed=2.0)
    assert np.abs(found["x"] - truth["position"]).max() < 2e-3  # v dt at the beginning of contact
    assert abs(found["x_rate"][-1]) < 1e-12  # it sticks, to rounding
    assert np.abs(found["turn"]).max() < 1e-3


@pytest.mark.parametrize("geom", ["sphere", "cylinder", "capsule"])
def test_a_ball_slides_until_it_rolls(tmp_path, geom):
    """The moments of inertia over m r^2 are those of textbooks.

    A capsule of radius r with a cylinder of length 4 r has 3/4 of its mass in the cylinder.
    """
    size, turn, ratio = {
        "sphere": (".1", "", 2 / 5),
        "cylinder": (".1 .2", 'euler="1.5707963267948966 0 0"', 1 / 2),
        "capsule": (".1 .2", 'euler="1.5707963267948966 0 0"', 3 / 4 * 1 / 2 + 1 / 4 * 2 / 5),
    }[geom]
    ball = BALL.format(f'type="{geom}" {turn} friction=".3 0 0" {PLASTIC_CONTACT}').replace(
        'size=".1"', f'size="{size}"'
    )
    file = write_model(
        tmp_path, FLOOR.format(f'friction=".2 0 0" {PLASTIC_CONTACT}') + ball, "2 0 -20"
    )
    found = simulated_channels(file)
    truth = rolling_ball.solve(
        np.linspace(0, 1, 101), radius=0.1, friction=0.3, speed=2.0, spin=-20.0, inertia_ratio=ratio
    )
    assert np.abs(found["x"] - truth["position"]).max() < 4e-3  # v dt
    assert found["x_rate"][-1] == pytest.approx(truth["velocity"][-1], abs=1e-9)
    assert found["turn_rate"][-1] == pytest.approx(truth["spin"][-1], abs=1e-8)


@pytest.mark.parametrize("z", [0.02, 0.1])
def test_a_ball_bounces_with_the_restitution_of_its_contact(tmp_path, z):
    law = f'solref="{-1e5} {-2 * z * 1e5**0.5}" priority="1"'
    found = simulated_channels(
        write_model(tmp_path, FLOOR.format(law) + BALL.format(""), pose="0 .5 0"),
        until=0.9,
        timestep=1e-4,
    )
    e = restitution(z)
    truth = bouncing_ball.solve(np.linspace(0, 0.9, 101), height=0.5, restitution=e)
    assert np.abs(found["z"] - truth["height"]).max() < 2e-3  # v dt at each of few impacts
    wrong = bouncing_ball.solve(np.linspace(0, 0.9, 101), height=0.5, restitution=e - 0.02)
    assert np.abs(found["z"] - wrong["height"]).max() > 4e-3


# ---- which geoms touch, and how ------------------------------------------------------------------

TWO_SPHERES = (
    '<body name="a" pos="0 0 .1"><joint name="x" type="slide" axis="1 0 0"/>'
    '<geom name="a" size=".1" mass="1" {0}/></body>'
    '<body name="b" pos=".3 0 .1"><joint name="z" type="slide" axis="1 0 0"/>'
    '<joint name="turn"/><geom name="b" size=".1" mass="1" {1}/></body>'
)


def contact_law(tmp_path, one="", two="", more=""):
    bodies = TWO_SPHERES.replace('<joint name="turn"/>', "").format(one, two)
    file = tmp_path / "two.xml"
    file.write_text(
        f'<mujoco><option gravity="0 0 0"/><worldbody>{bodies}</worldbody>{more}</mujoco>'
    )
    links = read_links(compile_model(file), "start", ())
    return links.contacts.laws.get((0, 1))


def contact_law_of_mujoco(tmp_path):
    """Friction and restitution of the contact that MuJoCo finds where the two spheres overlap."""
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "two.xml"))
    data = mujoco.MjData(model)
    data.qpos[0] = 0.15
    mujoco.mj_forward(model, data)
    if not data.ncon:
        return None
    contact = data.contact[0]
    stiffness, damping = contact.solref
    z = damping if stiffness > 0 else -damping / (2 * np.sqrt(-stiffness))
    return (contact.friction[0] if contact.dim > 1 else 0.0), restitution(z)


@pytest.mark.parametrize(
    ("one", "two", "more"),
    [
        ("", "", ""),
        ('friction=".3 0 0"', 'friction=".7 0 0"', ""),
        ('friction=".3 0 0" priority="1"', 'friction=".7 0 0"', ""),
        ('condim="1"', 'condim="1"', ""),
        ('condim="1"', 'condim="3"', ""),
        ('condim="1" priority="2"', 'condim="3"', ""),
        ('condim="4"', "", ""),
        ('solref=".01 .2"', 'solref=".02 .8"', ""),
        ('solref=".01 .2" solmix="3"', 'solref=".02 .8"', ""),
        ('solref=".01 .2" solmix="0"', 'solref=".02 .8"', ""),
        ('solref=".01 .2" solmix="0"', 'solref=".02 .8" solmix="0"', ""),
        ('solref="-1000 -5"', 'solref=".02 .8"', ""),
        ('solref="-1000 -5"', 'solref="-2000 -1"', ""),
        ('contype="2" conaffinity="4"', "", ""),
        ('contype="2" conaffinity="0"', 'contype="0" conaffinity="2"', ""),
        ("", "", '<contact><exclude body1="a" body2="b"/></contact>'),
        ("", "", '<contact><pair geom1="a" geom2="b" friction=".2 .2 0 0 0"/></contact>'),
        (
            'contype="0"',
            'contype="0" conaffinity="0"',
            '<contact><pair geom1="b" geom2="a" solref=".02 .3" condim="1"/></contact>',
        ),
        (
            'condim="1"',
            "",
            '<contact><exclude body1="a" body2="b"/><pair geom1="b" geom2="a"/></contact>',
        ),
    ],
)
def test_masks_friction_and_softness_are_combined_as_in_mujoco(tmp_path, one, two, more):
    law, bare = contact_law(tmp_path, one, two, more), contact_law_of_mujoco(tmp_path)
    if bare is None:
        assert law is None
    else:
        assert (law.friction, law.restitution) == pytest.approx(bare, rel=1e-12, abs=0)


def test_pairs_of_geoms_are_those_that_mujoco_finds(tmp_path):
    """In a chain of links on a floor, pairs with parents and of two static geoms are left out."""
    geom = '<geom size=".3"/>'
    body = f'<body pos=".1 0 0"><joint axis="0 1 0"/>{geom}{{0}}</body>'
    inner = body.format(body.format(body.format("")))
    file = tmp_path / "chain.xml"
    for flag in ("", '<flag filterparent="disable"/>', '<flag contact="disable"/>'):
        file.write_text(
            f'<mujoco><option>{flag}</option><worldbody><geom type="box" size="9 9 .3"/>'
            f"<body>{geom}</body>{inner}</worldbody></mujoco>"
        )
        model = mujoco.MjModel.from_xml_path(str(file))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        met = {tuple(sorted(map(int, c.geom))) for c in data.contact}
        assert set(find_pairs(model)) == met


@pytest.mark.parametrize(
    ("one", "two", "more", "named"),
    [
        ('type="ellipsoid" size=".1 .1 .1"', "", "", "ellipsoid 'a', which is no plane"),
        ('type="box" size=".1 .1 .1" euler="0.3 0 0.4"', "", "", "box 'a', which is neither"),
        ('type="cylinder" size=".1 .1"', "", "", "cylinder 'a', which is not at right angles"),
        ('type="capsule" size=".1 .1" euler=".3 0 0"', "", "", "capsule 'a', which is neither"),
        ('condim="6"', "", "", "rolling friction"),
        ('margin=".01"', "", "", "margin of 0.01 m"),
        ('pos="0 .05 0"', "", "", "0.05 m apart across"),
        ("", "", '<contact><pair geom1="a" geom2="b" friction=".2 .3"/></contact>', "by direction"),
        ("", "", '<option><flag override="enable"/></option>', "override"),
    ],
)
def test_contacts_without_counterpart_in_the_plane_are_refused(tmp_path, one, two, more, named):
    bodies = TWO_SPHERES.format(one, two).replace('<joint name="turn"/>', "")
    for geom, own in (("a", one), ("b", two)):
        if "size" in own:
            bodies = bodies.replace(f'name="{geom}" size=".1"', f'name="{geom}"')
    file = tmp_path / "two.xml"
    file.write_text(
        f'<mujoco><compiler angle="radian"/><worldbody>{bodies}'
        f'<body><joint axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
        f"</worldbody>{more}</mujoco>"
    )
    with pytest.raises(Unsupported, match=named):
        read_links(compile_model(file), "start", ())


def test_bodies_that_pass_each_other_do_not_touch(tmp_path):
    assert contact_law(tmp_path, 'pos="0 0 .3"') is None


def test_a_ball_passes_another_that_its_mask_leaves_out(tmp_path):
    """Both balls may touch the floor, and not each other; without weight the first moves evenly."""
    masks = 'contype="2" conaffinity="4"'
    bodies = (
        FLOOR.format('pos="0 0 -1" contype="4" conaffinity="2"')
        + BALL.format(masks)
        + f'<body pos=".5 0 .1"><joint type="slide" axis="0 0 1"/><geom size=".1" {masks}/></body>'
    )
    file = write_model(tmp_path, bodies, "1 0 0 0", options='gravity="0 0 0"', pose="0 0 0 0")
    found = simulated_channels(file)
    np.testing.assert_allclose(found["x"], np.linspace(0.0, 1.0, 101), atol=1e-12, rtol=0)
    np.testing.assert_allclose(found["turn"], 0.0, atol=1e-12)


def test_settings_of_contacts_act(tmp_path):
    """They determine how deep a ball at rest is in the floor, and how fast it comes out of it."""
    law = f'friction="0 0 0" {PLASTIC_CONTACT}'
    file = write_model(tmp_path, FLOOR.format(law) + BALL.format(law), pose="0 -.01 0")
    default = simulated_channels(file)["z"]
    slow = simulated_channels(file, collision_bias=0.5)["z"]
    deep = simulated_channels(file, collision_slop=5e-3)["z"]
    assert -1e-4 < default[-1] <= 0.0
    assert slow[10] < default[10] - 1e-4
    assert deep[-1] == pytest.approx(-5e-3, abs=1e-4)
    run = Run("dynamics", np.linspace(0, 0.1, 3), ())
    assert {"collision_slop", "collision_bias"} <= set(simulate(file, run).settings)


def test_forces_are_missing_in_models_with_contacts(tmp_path):
    file = write_model(
        tmp_path,
        FLOOR.format("") + BALL.format("") + '<body><joint name="arm" axis="0 1 0"/>'
        '<inertial pos="0 0 1" mass="1" diaginertia="1 1 1"/></body>',
        "0 0 0 0",
        pose="0 0 0 0",
        more='<actuator><motor name="arm" joint="arm"/></actuator>',
    )
    file.write_text(
        file.read_text().replace("<sensor>", '<sensor><jointactuatorfrc name="f" joint="arm"/>')
    )
    drive = Drive("arm", lambda t: (t, 1 + 0 * t, 0 * t))
    curves = simulate(file, Run("dynamics", np.linspace(0, 0.1, 3), ("f", "x"), (drive,)))
    assert "contacts" in curves.missing["f"]
    assert "x" in curves.channels


@pytest.mark.parametrize("name", ["block_slides", "ball_rolls", "balls_in_row"])
def test_a_pymunk_program_has_the_same_contacts(name, tmp_path):
    file = shipped(f"{name}.xml")
    channels = {"balls_in_row": ("x1.x", "x5.x")}.get(name, ("position", "velocity"))
    settings = {"iterations": 100, "error_bias": 0.0, "timestep": 1e-3}
    run = Run("dynamics", np.linspace(0.0, 0.1, 11), channels, settings=settings)
    wanted = simulate(file, run).channels
    found = program_curves(PYMUNK.programs.write_program(file, run, "", ""), tmp_path)
    for channel in channels:
        assert np.abs(found[channel] - wanted[channel]).max() < 1e-12, channel
