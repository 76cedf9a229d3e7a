"""Tests of models rebuilt in pymunk: plane, refusals, exact sweeps, second order in time."""

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from proofmass.analytic.linkages import fourbar
from proofmass.sim.plane import find_plane
from proofmass.sim.protocol.failures import BadModel, Diverged, Unsupported
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk.engine import simulate
from proofmass.sim.pymunk.space import empty_buffer
from tests.shipped import shipped

FOUR_BAR_LENGTHS = {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0}
BAR_INERTIA = '<inertial pos=".5 0 0" mass="1" diaginertia=".01 .1 .1"/>'
ARM_BODY = f'<body name="arm"><joint name="arm"/>{BAR_INERTIA}</body>'
NO_CONTACTS = '<flag contact="disable"/>'


def turning_crank(rate: float = 1.0) -> Drive:
    return Drive("crank", lambda t: (rate * t, rate + 0 * t, 0 * t))


def write_model(
    tmp_path: Path, bodies: str, more: str = "", gravity: str = "0 -9.81 0", flag: str = NO_CONTACTS
) -> Path:
    file = tmp_path / "inline.xml"
    file.write_text(
        f'<mujoco><compiler angle="radian"/><option gravity="{gravity}">{flag}</option>'
        f"<worldbody>{bodies}</worldbody>{more}</mujoco>"
    )
    return file


def simulate_briefly(file: Path, **run) -> None:
    simulate(file, Run("dynamics", np.linspace(0, 0.1, 11), (), **run))


def plane_of(file: Path):
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return find_plane(model, data)


@pytest.mark.parametrize(
    ("joint", "e1", "e2", "normal"),
    [
        ('axis="0 0 1"', (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ('axis="0 -1 0"', (1, 0, 0), (0, 0, 1), (0, -1, 0)),
        ('axis="1 0 0"', (0, 1, 0), (0, 0, 1), (1, 0, 0)),
        ('type="slide" axis="0 1 0"', (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ('type="slide" axis="0 0 1"', (1, 0, 0), (0, 0, 1), (0, -1, 0)),
    ],
)
def test_the_plane_of_a_model_is_found(tmp_path, joint, e1, e2, normal):
    plane = plane_of(write_model(tmp_path, f"<body><joint {joint}/>{BAR_INERTIA}</body>"))
    if normal == (0, -1, 0) and "slide" in joint:  # either sign of a slide's normal is right
        e2, normal = np.sign(plane.e2[2]) * np.array(e2), np.sign(plane.e2[2]) * np.array(normal)
    for got, wanted in ((plane.e1, e1), (plane.e2, e2), (plane.normal, normal)):
        np.testing.assert_allclose(got, wanted, atol=1e-15, rtol=0)  # rounding of a cross product


TWO_HINGES = '<body name="a"><joint name="one"/>{0}<body name="b">{1}{0}</body></body>'


@pytest.mark.parametrize(
    ("bodies", "more", "options", "named"),
    [
        (
            f'<body><joint name="ball" type="ball"/>{BAR_INERTIA}</body>',
            "",
            {},
            "ball joint 'ball'",
        ),
        (f'<body><freejoint name="fly"/>{BAR_INERTIA}</body>', "", {}, "free joint 'fly'"),
        (
            TWO_HINGES.format(BAR_INERTIA, '<joint name="askew" axis="1 0 0"/>'),
            "",
            {},
            "'askew' leaves the plane",
        ),
        (
            TWO_HINGES.format(BAR_INERTIA, '<joint name="up" type="slide" axis="0 0 1"/>'),
            "",
            {},
            "joint 'up'",
        ),
        (
            TWO_HINGES.format(BAR_INERTIA, '<joint name="s" type="slide"/><joint name="h"/>'),
            "",
            {"gravity": "0 0 0"},
            "2 joints on body 'b'",
        ),
        (
            ARM_BODY,
            '<tendon><fixed name="rope"><joint joint="arm" coef="1"/></fixed></tendon>',
            {},
            "tendon 'rope'",
        ),
        (ARM_BODY, "", {"gravity": "0 0 -9.81"}, "gravity"),
        (
            ARM_BODY.replace('"arm"/>', '"arm" damping="1 2"/>'),
            "",
            {},
            "polynomial damping of .*'arm'",
        ),
        (
            ARM_BODY,
            '<equality><joint name="lock" joint1="arm"/></equality>',
            {},
            "joint equality 'lock'",
        ),
        (
            ARM_BODY,
            '<actuator><position name="servo" joint="arm" forcerange="0 1"/></actuator>',
            {},
            "actuator 'servo'",
        ),
        (
            ARM_BODY,
            '<actuator><general name="lag" joint="arm" dyntype="filter" dynprm="1"/></actuator>',
            {},
            "actuator 'lag'",
        ),
        (
            ARM_BODY.replace("<body", '<geom name="floor" size=".1" pos="0 -2 0"/><body').replace(
                "</body>", '<geom name="tip" type="ellipsoid" size=".1 .1 .1" pos="0 -1 0"/></body>'
            ),
            "",
            {"flag": ""},
            "contact of ellipsoid 'tip'",
        ),
    ],
)
def test_features_that_pymunk_lacks_are_refused_by_name(tmp_path, bodies, more, options, named):
    with pytest.raises(Unsupported, match=named):
        simulate_briefly(write_model(tmp_path, bodies, more, **options))


def test_geoms_on_one_body_do_not_count_as_contact(tmp_path):
    bodies = ARM_BODY.replace("</body>", '<geom size=".1"/><geom size=".2"/></body>')
    run = Run("dynamics", np.linspace(0, 0.1, 11), ())
    assert simulate(write_model(tmp_path, bodies, flag=""), run).steps == 51


def test_unknown_names_are_refused_with_the_known_ones():
    model, x = shipped("pendulum.xml"), np.linspace(0, 0.1, 11)
    with pytest.raises(BadModel, match=r"'speed'.*angle, rate"):
        simulate(model, Run("dynamics", x, ("speed",)))
    with pytest.raises(BadModel, match=r"'begin'.*start"):
        simulate(model, Run("dynamics", x, (), start="begin"))
    with pytest.raises(BadModel, match=r"'wheel'.*pivot"):
        simulate(model, Run("dynamics", x, (), (Drive("wheel", lambda t: (t, t, t)),)))


def test_an_open_start_pose_is_refused(edit):
    file = edit("fourbar.xml", 'qpos="0  1.35', 'qpos="0  0.35')
    with pytest.raises(BadModel, match=r"start pose of key 'start' .* loop 'pin' is open by"):
        simulate(file, Run("sweep", np.linspace(0, 1, 5), (), (turning_crank(),)))


FOUR_BAR_FILE = shipped("fourbar.xml")
FOUR_BAR_CHANNELS = ("rocker", "rocker_rate", "rocker_acceleration.z", "coupler.angle", "pin.y")


def fourbar_errors(dt: float, model: Path = FOUR_BAR_FILE, kind: str = "dynamics"):
    run = Run(
        kind,
        np.linspace(0, 2 * np.pi, 201),
        FOUR_BAR_CHANNELS,
        (turning_crank(),),
        settings={"timestep": dt},
    )
    curves = simulate(model, run)
    truth = fourbar.solve(*(d[0] for d in curves.drive), **FOUR_BAR_LENGTHS)
    pairs = zip(
        FOUR_BAR_CHANNELS,
        ("rocker_angle", "rocker_rate", "rocker_acceleration", "coupler_angle", "pin_y"),
        strict=True,
    )
    return [
        np.abs(curves.channels[mine] - truth[theirs]).max()
        for mine, theirs in pairs
        if mine in curves.channels
    ]


def test_a_four_bar_is_of_second_order():
    coarse, fine = np.array(fourbar_errors(2e-3)), np.array(fourbar_errors(1e-3))
    # 4 in theory; both steps are rounded to fit the samples, which changes the ratio by up to 20 %
    assert np.all((coarse / fine > 3.3) & (coarse / fine < 4.8)), coarse / fine
    # constraint violation that Chipmunk's first-order correction leaves: 4e-7 rad at 1 ms
    assert fine[0] < 1e-6


def test_a_sweep_of_a_four_bar_is_exact():
    angle, rate, coupler, pin = fourbar_errors(1e-3, kind="sweep")
    # Newton's method with the engine is exact to rounding, which was measured as 4e-15
    assert max(angle, coupler, pin) < 1e-12
    assert rate < 1e-11  # rounding, magnified by the linkage's transmission: 2e-14 measured


def test_a_sweep_has_holding_moments_and_no_accelerations():
    faster = Drive("crank", lambda x: (x, np.sqrt(1 + x), 0.5 + 0 * x))
    run = Run(
        "sweep", np.linspace(0, 2 * np.pi, 37), ("holding_moment", FOUR_BAR_CHANNELS[2]), (faster,)
    )
    curves = simulate(FOUR_BAR_FILE, run)
    np.testing.assert_allclose(np.array(curves.drive), run.motion(run.x), atol=1e-12)  # rest
    truth = fourbar.solve(
        curves.drive[0][0], **FOUR_BAR_LENGTHS, crank_mass=1.0, coupler_mass=2.0, rocker_mass=2.5
    )["holding_moment"]
    # rounding of impulses: 1e-13 N m measured on 20 N m
    np.testing.assert_allclose(curves.channels["holding_moment"], truth, atol=1e-10, rtol=0)
    assert "no accelerations in a sweep" in curves.missing[FOUR_BAR_CHANNELS[2]]
    assert curves.derivatives == 1
    with_inertia = simulate(FOUR_BAR_FILE, replace(run, x=run.x[:2], inertia=True))
    assert "those at rest" in with_inertia.missing["holding_moment"]


def test_a_wrong_length_exceeds_the_tolerance(edit):
    file = edit("fourbar.xml", '"coupler_end" pos="2 0 0"', '"coupler_end" pos="2.001 0 0"')
    # 1 mm in 2 m moves the rocker by 5e-4 rad; the tolerance above is 1e-6
    assert fourbar_errors(2e-3, file)[0] > 1e-4


def write_rotated_model(tmp_path: Path) -> Path:
    """Write the four-bar rotated by 90 degrees about x, into the x-z plane, with axes along -y."""
    text = FOUR_BAR_FILE.read_text()
    text = text.replace('gravity="0 -9.81 0"', 'gravity="0 0 -9.81"')
    text = text.replace("<joint name=", '<joint axis="0 -1 0" name=')
    text = re.sub(r'diaginertia="(\S+) (\S+) (\S+)"', r'diaginertia="\1 \3 \2"', text)
    file = tmp_path / "turned.xml"
    file.write_text(text)
    return file


@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_a_model_in_another_plane_has_the_same_motion(tmp_path, kind):
    channels = ("rocker", "rocker_rate", "coupler.angle", "pin.x")
    run = Run(
        kind, np.linspace(0, 3, 61), (*channels, "pin.y", "coupler_rate.z"), (turning_crank(),)
    )
    there = Run(kind, run.x, (*channels, "pin.z", "coupler_rate.y"), (turning_crank(),))
    flat, upright = simulate(FOUR_BAR_FILE, run), simulate(write_rotated_model(tmp_path), there)
    pairs = [
        *((c, c, 1) for c in channels),
        ("pin.y", "pin.z", 1),
        ("coupler_rate.z", "coupler_rate.y", -1),
    ]
    for mine, theirs, sign in pairs:
        # the same arithmetic up to the rounding of the projection
        np.testing.assert_allclose(
            flat.channels[mine], sign * upright.channels[theirs], atol=1e-9, rtol=0
        )


def test_a_sprung_arm_rests_between_spring_and_weight(tmp_path):
    """A sprung arm is in equilibrium: k (q - q_ref) = -m g r cos(crank + q).

    The crank's moment carries both weights.
    """
    k, ref, weight = 50.0, 0.3, 0.5 * 9.81 * 0.4
    arm = (
        f'<body name="crank"><joint name="crank"/>{BAR_INERTIA}<body pos="1 0 0">'
        f'<joint name="arm" stiffness="{k}" springref="{ref}"/>'
        '<inertial pos=".4 0 0" mass=".5" diaginertia=".01 .02 .02"/></body></body>'
    )
    sensor = (
        '<sensor><jointpos name="arm" joint="arm"/>'
        '<jointactuatorfrc name="moment" joint="crank"/></sensor>'
    )
    x = np.array([0.0, 0.2])
    run = Run("sweep", x, ("arm", "moment"), (Drive("crank", lambda t: (t, 0 * t, 0 * t)),))
    got = simulate(write_model(tmp_path, arm, sensor), run).channels
    q = np.array(got["arm"])
    # rest is called at moves of 1e-12 a step; slow sinking multiplies that by some ten steps
    np.testing.assert_allclose(k * (q - ref), -weight * np.cos(x + q), atol=1e-8, rtol=0)
    carried = 9.81 * (0.5 * np.cos(x) + 0.5 * (np.cos(x) + 0.4 * np.cos(x + q)))
    np.testing.assert_allclose(got["moment"], carried, atol=1e-8, rtol=0)


def test_a_mass_on_a_sprung_slide_oscillates(tmp_path):
    body = (
        '<body><joint name="s" type="slide" axis="1 0 0" stiffness="40" springref=".1"/>'
        '<inertial pos=".2 .3 0" mass=".4" diaginertia=".1 .1 .1"/></body>'
    )
    sensor = '<sensor><jointpos name="s" joint="s"/></sensor>'
    run = Run("dynamics", np.linspace(0, 2, 201), ("s",), settings={"timestep": 1e-3})
    got = simulate(write_model(tmp_path, body, sensor), run)
    # leapfrog's phase lag is (w dt)^2 / 24, times 20 rad: 8e-5 of 0.1 m
    np.testing.assert_allclose(got.channels["s"], 0.1 - 0.1 * np.cos(10 * got.x), atol=2e-5)


def test_a_hinge_rests_on_its_stop(tmp_path):
    arm = ARM_BODY.replace('"arm"/>', '"arm" range="-.2 1"/>')
    sensor = '<sensor><jointpos name="arm" joint="arm"/></sensor>'
    run = Run("dynamics", np.linspace(0, 2, 21), ("arm",))
    got = simulate(write_model(tmp_path, arm, sensor), run).channels["arm"]
    # the joint enters the stop by up to its motion in a step, 3e-3 rad, and leaves it slowly
    assert np.abs(got[5:] + 0.2).max() < 4e-3
    assert abs(got[-1] + 0.2) < 1e-4


@pytest.mark.parametrize("sign", [1, -1])
def test_a_hinge_does_not_bounce_on_its_stop(sign, tmp_path):
    """An arm falls by 0.2 rad onto its stop, about an axis in either direction.

    It then leaves the stop with the rate that corrects its depth there: 0.9 of the depth is left
    after 1/60 s, by Chipmunk's own bias.
    """
    limits = "-.2 1" if sign > 0 else "-1 .2"
    arm = ARM_BODY.replace('"arm"/>', f'"arm" axis="0 0 {sign}" range="{limits}"/>')
    other = f"<body><joint/>{BAR_INERTIA}</body>"  # its axis is the normal of the plane
    sensors = '<sensor><jointpos name="a" joint="arm"/><jointvel name="rate" joint="arm"/></sensor>'
    run = Run("dynamics", np.linspace(0, 0.4, 401), ("a", "rate"), settings={"timestep": 1e-3})
    got = simulate(write_model(tmp_path, other + arm, sensors), run).channels
    depth, rate = -0.2 - sign * got["a"], sign * got["rate"]
    impact = int(np.argmin(rate))
    # from the energy; the last sample before the impact is up to a step before it, 0.6 % of the way
    assert rate[impact] == pytest.approx(-np.sqrt(2 * 9.81 * 0.5 * np.sin(0.2) / 0.35), rel=0.01)
    assert 0 < rate[impact:].max() < 1.01 * 60 * np.log(1 / 0.9) * depth.max()


@pytest.mark.parametrize("kind", ["hinge", "slide"])
def test_a_damper_alone_slows_a_joint_exponentially(kind, tmp_path):
    """A mass or moment of inertia of 0.5 has a rate of exp(-d t / 0.5) under a damper d = 0.4."""
    body = (
        f'<body><joint name="j" type="{kind}" damping=".4"/>'
        '<inertial pos="0 0 0" mass=".5" diaginertia=".5 .5 .5"/></body>'
    )
    more = (
        '<sensor><jointvel name="rate" joint="j"/></sensor>'
        '<keyframe><key name="start" qpos="0" qvel="1"/></keyframe>'
    )
    run = Run("dynamics", np.linspace(0, 1, 11), ("rate",), settings={"timestep": 1e-3})
    file = write_model(tmp_path, body, more, gravity="0 0 0")
    got = simulate(file, replace(run, start="start")).channels["rate"]
    np.testing.assert_allclose(got, np.exp(-0.8 * run.x), rtol=1e-3)  # first order: d dt / m


def pendulum_errors(dt: float):
    channels = ("angle", "rate", "acceleration", "kinetic", "potential")
    run = Run("dynamics", np.linspace(0, 4, 201), channels, settings={"timestep": dt})
    got = simulate(shipped("pendulum.xml"), run).channels
    k, w = np.sin(np.pi / 4), np.sqrt(9.81)
    sn, cn, *_ = ellipj(ellipk(k * k) + w * run.x, k * k)
    angle = -2 * np.arcsin(k * sn)
    errors = [
        got["angle"] - angle,
        got["rate"] + 2 * k * w * cn,
        got["acceleration"] + 9.81 * np.sin(angle),
        got["kinetic"] + got["potential"] - got["kinetic"][0] - got["potential"][0],
    ]
    return np.array([np.abs(e).max() for e in errors])


def test_a_pendulum_is_of_second_order():
    coarse, fine = pendulum_errors(2e-3), pendulum_errors(1e-3)
    # second order: 4 in theory, also for the energy
    assert np.all((coarse / fine > 3.7) & (coarse / fine < 4.3)), coarse / fine
    # at 1 ms the rod is longer by (rate dt)^2 / 2, which gives 3e-5 rad and 1e-4 J
    assert fine[0] < 5e-5
    assert fine[3] < 2e-4


def test_runs_of_one_thread_share_a_buffer_and_no_states():
    """Pymunk never frees a buffer; a run after a longer one gives the same curve as before it."""
    file = shipped("pendulum.xml")

    def swing(n: int) -> dict[str, np.ndarray]:
        return simulate(file, Run("dynamics", np.linspace(0.0, 0.1, n), ("angle",))).channels

    assert empty_buffer() is empty_buffer()
    first = swing(11)["angle"]
    swing(101)
    assert (swing(11)["angle"] == first).all()
    assert len(empty_buffer().float_buf()) == 0


def test_too_few_iterations_diverge():
    run = Run(
        "dynamics",
        np.linspace(0, 7, 71),
        ("rocker",),
        (turning_crank(),),
        settings={"iterations": 3},
    )
    with pytest.raises(Diverged, match="failed at time"):
        simulate(FOUR_BAR_FILE, run)


def test_default_settings_are_softer_and_recorded():
    run = Run(
        "dynamics",
        np.linspace(0, 6, 61),
        ("rocker",),
        (turning_crank(),),
        settings={"defaults": True},
    )
    curves = simulate(FOUR_BAR_FILE, run)
    assert curves.settings["iterations"] == 10
    assert curves.settings["error_bias"] == (1 - 0.1) ** 60
    violation = simulate(FOUR_BAR_FILE, Run("dynamics", run.x, (), (turning_crank(),))).violation
    assert (
        curves.violation > 10 * violation
    )  # violation with Chipmunk's soft correction, dt / (1 - bias), compared with dt^2
