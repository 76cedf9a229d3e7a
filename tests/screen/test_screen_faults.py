"""Each fault that a first screen names, planted in a model that has no finding without it."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.screen.finding import FindingKind, Severity
from proofmass.screen.pose import coordinate_unit
from proofmass.screen.screen import screen_model
from proofmass.screen.soft_loops import impedance

CASES = Path(__file__).parents[1] / "data" / "screen"
# a four-bar that is closed in its key, with a servo, and a slide beside it
GOOD = """
<mujoco><option timestep="1e-3"/>
<default><geom type="capsule" size=".02" mass="1"/><joint axis="0 1 0" damping=".01"/></default>
<worldbody>
<body name="crank"><joint name="h1"/><geom fromto="0 0 0 0 0 1"/>
<body name="coupler" pos="0 0 1"><joint name="h2"/><geom name="bar" fromto="0 0 0 1.5 0 .3"/></body>
</body>
<body name="rocker" pos="1.5 0 0"><joint name="h3"/><geom fromto="0 0 0 0 0 1.3"/></body>
<body name="block" pos="0 2 0"><joint name="s" type="slide" axis="1 0 0" range="-1 1"/>
<geom name="cube" type="box" size=".1 .1 .1"/></body>
</worldbody>
<equality><connect name="pin" body1="coupler" body2="rocker" anchor="1.5 0 .3"/></equality>
<actuator><position name="servo" joint="s" kp="10" kv="5"/></actuator>
<sensor><jointpos name="turn" joint="h1"/></sensor>
<contact><exclude body1="crank" body2="rocker"/><exclude body1="coupler" body2="rocker"/></contact>
<keyframe><key name="start" qpos="0 0 0 0" ctrl="0.5"/></keyframe></mujoco>
"""
PIN = '<connect name="pin" body1="coupler" body2="rocker" anchor="1.5 0 .3"/>'
PLANTED = [
    # what is replaced by what, the kind of the finding, its element, and its value
    ('pos="1.5 0 0"', 'pos="2.5 0 0"', FindingKind.PIN, "pin", 0.98),
    ('qpos="0 0 0 0"', 'qpos="0 0 0.1 0"', FindingKind.OPEN_LOOP, "pin", None),
    ('fromto="0 0 0 0 0 1.3"', 'fromto="0 0 0 0 0 .3"', FindingKind.PIN, "pin", 0.98),
    ('qpos="0 0 0 0"', 'qpos="0 0 0 1.2"', FindingKind.RANGE, "s", 0.2),
    ('size=".1 .1 .1"', 'size=".1 .1 .1" mass="2e-5"', FindingKind.MASS, "block", 5e4),
    ('joint="s" kp', 'joint="s" gear="0" kp', FindingKind.ACTUATOR, "servo", None),
    ('ctrl="0.5"', 'ctrl="3"', FindingKind.STOP, "servo", 2.0),
    ('name="cube"', 'name="cube" pos="0 -2 0"', FindingKind.CONTACT, None, None),
]


def finding_of(model, kind):
    """The findings of a kind."""
    return [finding for finding in screen_model(model).findings if finding.kind is kind]


def test_the_model_without_a_fault_has_no_finding():
    found = screen_model(mujoco.MjModel.from_xml_string(GOOD))
    assert [str(finding) for finding in found.findings] == []
    assert (found.mobility.dof, found.mobility.redundant) == (2, 1)


@pytest.mark.parametrize(
    ("old", "new", "kind", "element", "value"),
    PLANTED,
)
def test_a_planted_fault_is_named(old, new, kind, element, value):
    assert GOOD.count(old) == 1
    found = finding_of(mujoco.MjModel.from_xml_string(GOOD.replace(old, new)), kind)
    assert found
    assert all(finding.text for finding in found)
    if element is not None:
        assert element in {finding.element.name for finding in found}
    if value is not None:
        assert found[0].value == pytest.approx(value, rel=1e-3)


def test_the_opening_of_a_loop_is_the_distance_of_its_two_points():
    moved = GOOD.replace('qpos="0 0 0 0"', 'qpos="0 0 0.1 0"')
    [found, *_] = finding_of(mujoco.MjModel.from_xml_string(moved), FindingKind.OPEN_LOOP)
    assert found.severity is Severity.FAULT
    assert found.value == pytest.approx(2 * 1.3 * np.sin(0.05), rel=1e-9)


def test_loops_that_cannot_be_closed_are_told():
    # the coupler's site is 1.83 m from the crank's hinge at most, the rocker's 1.3 m from its own
    sites = GOOD.replace('<geom name="bar"', '<site name="end" pos="1.5 0 .3"/><geom name="bar"')
    sites = sites.replace(
        '<joint name="h3"/>', '<joint name="h3"/><site name="top" pos="0 0 1.3"/>'
    )
    sites = sites.replace(PIN, '<connect name="pin" site1="end" site2="top"/>')
    assert not finding_of(mujoco.MjModel.from_xml_string(sites), FindingKind.OPEN_LOOP)
    far = sites.replace('pos="1.5 0 0"', 'pos="4.5 0 0"')
    texts = [str(f) for f in finding_of(mujoco.MjModel.from_xml_string(far), FindingKind.OPEN_LOOP)]
    assert any("no pose near the start closes them" in text for text in texts)


def test_free_ends_that_coincide_are_told_and_joined_ones_are_not():
    open_end = GOOD.replace(PIN, "")
    [found] = finding_of(mujoco.MjModel.from_xml_string(open_end), FindingKind.FREE_ENDS)
    assert "coupler" in found.text
    assert "rocker" in found.text


def test_moments_of_inertia_that_no_body_can_have_are_told():
    # MuJoCo refuses them unless it is told not to look
    body = '<body><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 {}"/></body>'
    xml = '<mujoco><compiler balanceinertia="false"/><worldbody>{}</worldbody></mujoco>'
    good = mujoco.MjModel.from_xml_string(xml.format(body.format(1.9)))
    assert not finding_of(good, FindingKind.INERTIA)
    good.body_inertia[1] = [1.0, 1.0, 2.5]
    assert finding_of(good, FindingKind.INERTIA)


HINGES = '<joint axis="1 0 0"/><joint axis="0 1 0"/><joint axis="0 0 1"/>'
GIMBALS = (
    f'<mujoco><option gravity="0 0 0"/><worldbody><body>{HINGES}<geom size=".1"/></body>'
    '</worldbody><keyframe><key qpos="0 {} 0" qvel="0 {} 0"/></keyframe></mujoco>'
)


def test_three_hinges_near_gimbal_lock_are_told():
    def found(angle, rate=0.0):
        model = mujoco.MjModel.from_xml_string(GIMBALS.format(angle, rate))
        return finding_of(model, FindingKind.GIMBAL)

    assert not found(0.5)
    [lock] = found(1.57)
    assert lock.value == pytest.approx(np.cos(1.57), rel=1e-6)
    assert "near gimbal lock: the box" in lock.text
    # the middle hinge of a ball turns freely, so that it is at pi / 2 after 0.5354 s
    [passed] = found(0.5, 2.0)
    assert "near gimbal lock 0.51 s after the start" in passed.text  # |cos b| is 0.05 there
    assert passed.value == pytest.approx(0.05, abs=5e-3)
    assert not found(0.5, 0.5)  # it comes to 1 rad


def test_hinges_that_pass_gimbal_lock_within_a_step_are_told():
    model = mujoco.MjModel.from_xml_string(GIMBALS.format(0.5, 80.0))  # 0.16 rad a step
    [passed] = finding_of(model, FindingKind.GIMBAL)
    assert passed.value < 0.05


def test_an_upright_pendulum_at_rest_is_an_unstable_equilibrium():
    xml = (
        '<mujoco><worldbody><body><joint axis="0 1 0"/>'
        '<geom type="sphere" size=".001" pos="0 0 {}" mass="1"/></body></worldbody></mujoco>'
    )
    hanging = mujoco.MjModel.from_xml_string(xml.format(-1))
    upright = mujoco.MjModel.from_xml_string(xml.format(1))
    assert not finding_of(hanging, FindingKind.UNSTABLE_REST)
    [found] = finding_of(upright, FindingKind.UNSTABLE_REST)
    # a point mass at the distance l: sqrt(l / g); the sphere's own inertia is 4e-7 of it
    assert found.value == pytest.approx(np.sqrt(1 / 9.81), rel=1e-5)


def test_a_model_in_which_nothing_moves_and_one_without_joints_are_told():
    xml = '<mujoco><worldbody><body>{}<geom size=".1"/></body></worldbody></mujoco>'
    slide = mujoco.MjModel.from_xml_string(xml.format('<joint type="slide" axis="1 0 0"/>'))
    assert finding_of(slide, FindingKind.NOTHING_MOVES)
    fixed = mujoco.MjModel.from_xml_string(xml.format(""))
    assert [finding.severity for finding in screen_model(fixed).findings] == [Severity.FAULT]


def test_a_start_that_is_not_finite_is_told():
    model = mujoco.MjModel.from_xml_string(GOOD)
    model.key_qpos[0, 0] = np.nan
    assert [finding.kind for finding in screen_model(model).findings] == [FindingKind.NOT_FINITE]


def test_a_sensor_that_does_not_change_is_told():
    still = GOOD.replace(
        '<jointpos name="turn" joint="h1"/>',
        '<jointpos name="turn" joint="h1"/>'
        '<framepos name="ground" objtype="body" objname="world"/>',
    )
    [found] = finding_of(mujoco.MjModel.from_xml_string(still), FindingKind.SENSOR)
    assert "ground" in found.text
    assert "turn" not in found.text


def test_a_servo_beyond_a_soft_stop_comes_to_rest_where_it_is_told():
    beyond = mujoco.MjModel.from_xml_string(GOOD.replace('ctrl="0.5"', 'ctrl="3"'))
    [found] = finding_of(beyond, FindingKind.STOP)
    told = float(found.text.rsplit("about ", 1)[1].split()[0])
    data = mujoco.MjData(beyond)
    mujoco.mj_resetDataKeyframe(beyond, data, 0)
    for _ in range(20_000):
        mujoco.mj_step(beyond, data)
    assert data.joint("s").qpos[0] - 1 == pytest.approx(told, rel=0.05)


def test_joints_that_creep_are_told_with_their_speed():
    # an arm that dry friction should hold: MuJoCo's issue 565
    path = CASES / "hold565.xml"
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    while data.time < 0.3:  # after the transient of the start
        mujoco.mj_step(model, data)
    measured = data.qvel
    found = [f for f in screen_model(path).findings if f.kind is FindingKind.CREEP]
    assert {finding.element.name for finding in found} == {"shoulder", "elbow"}
    for finding in found:
        address = model.joint(finding.element.name).dofadr[0]
        assert finding.value == pytest.approx(measured[address], rel=5e-3)


BRAKE = """
<mujoco><worldbody><body><joint name="j" axis="0 1 0" frictionloss="{friction}" {more}/>
<geom type="sphere" size=".001" pos="1 0 0" mass="1"/></body></worldbody></mujoco>
"""


def test_the_unit_of_a_coordinate_is_that_of_its_motion():
    free = '<body><freejoint/><geom size=".1"/></body>'
    ball = '<body><joint type="ball"/><geom size=".1"/></body>'
    slide = '<body><joint type="slide"/><geom size=".1"/></body>'
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{free}{ball}{slide}</worldbody></mujoco>"
    )
    units = [coordinate_unit(model, k) for k in range(model.nv)]
    assert units == [*3 * ["m"], *3 * ["rad"], *3 * ["rad"], "m"]


def test_a_ball_joint_that_creeps_is_told_in_radians():
    text = BRAKE.format(friction=20, more="").replace('axis="0 1 0"', 'type="ball"')
    text = text.replace('size=".001"', 'size=".5"')  # a point would turn freely about its arm
    [found] = finding_of(mujoco.MjModel.from_xml_string(text), FindingKind.CREEP)
    words = "rad/s (2.34°/s), though its friction of 20 N m would hold its load of 9.81 N m"
    assert words in found.text


def test_the_creep_of_one_joint_is_that_of_the_formula_and_of_bare_mujoco():
    # (1 - d) f T dmax / (2 d I): the load is m g l, the inertia m l^2, d and dmax are 0.9, and the
    # time constant of 0.02 s has the critical damping 1
    model = mujoco.MjModel.from_xml_string(
        BRAKE.format(friction=20, more='solimpfriction="0.9 0.9 0.001" solreffriction="0.02 1"')
    )
    [found] = finding_of(model, FindingKind.CREEP)
    formula = (1 - 0.9) * 9.81 * 0.02 * 0.9 / (2 * 0.9)
    assert found.value == pytest.approx(formula, rel=1e-4)
    data = mujoco.MjData(model)
    for _ in range(100):
        mujoco.mj_step(model, data)
    assert found.value == pytest.approx(data.qvel[0], rel=2e-3)


def test_a_joint_that_slips_does_not_creep():
    # its friction cannot hold the load, so that it should move
    model = mujoco.MjModel.from_xml_string(BRAKE.format(friction=5, more=""))
    assert not finding_of(model, FindingKind.CREEP)


def test_a_stiffer_friction_is_proposed_and_is_as_much_slower_as_told():
    more = 'solimpfriction="{0} {0} 0.001"'
    soft = mujoco.MjModel.from_xml_string(BRAKE.format(friction=20, more=more.format(0.9)))
    stiff = mujoco.MjModel.from_xml_string(BRAKE.format(friction=20, more=more.format(0.9999)))
    [found] = finding_of(soft, FindingKind.CREEP)
    [slower] = finding_of(stiff, FindingKind.CREEP)
    assert slower.severity is Severity.NOTE
    told = float(found.remedy.split("makes it ")[1].split(" times")[0])
    assert found.value / slower.value == pytest.approx(told, rel=0.01)
    assert not slower.remedy


def test_a_soft_loop_gives_way_as_told():
    heavy = GOOD.replace('fromto="0 0 0 0 0 1.3"', 'fromto="0 0 0 0 0 1.3" mass="500"')
    soft = heavy.replace('anchor="1.5 0 .3"', 'anchor="1.5 0 .3" solref="0.5 1"')
    model = mujoco.MjModel.from_xml_string(soft)
    assert finding_of(model, FindingKind.SOFT_LOOP)
    assert not finding_of(mujoco.MjModel.from_xml_string(GOOD), FindingKind.SOFT_LOOP)


def test_an_actuator_with_several_controls_is_read_as_one():
    # an orientation of a ball joint has three controls and forces, beside a motor that is idle
    text = """
    <mujoco><option gravity="0 0 0"/><worldbody>
    <body name="b"><joint name="ball" type="ball" damping=".1"/><geom size=".1" mass="1"/></body>
    <body name="c" pos="1 0 0"><joint name="hinge" axis="0 0 1" damping=".1"/>
    <geom size=".1" mass="1" pos=".2 0 0"/></body></worldbody>
    <actuator><orientation name="turn" joint="ball" kp="5" dampratio="1"/>
    <motor name="idle" joint="hinge" gear="0"/></actuator>
    <keyframe><key name="start" qpos="0.9 0.3 0.3 0 0" qvel="0 0 1 1"/></keyframe></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    assert (model.nactuator, model.nu) == (2, 4)
    [found] = finding_of(model, FindingKind.ACTUATOR)
    assert found.text == "actuator idle with no arm at the start moves nothing"


def test_idle_actuators_are_told_together():
    motors = "".join(f'<motor name="m{k}" joint="s" gear="0"/>' for k in range(6))
    many = mujoco.MjModel.from_xml_string(GOOD.replace("<actuator>", f"<actuator>{motors}"))
    many_found = finding_of(many, FindingKind.ACTUATOR)
    assert [f.value for f in many_found] == [6.0]
    assert "6 actuators (m0, m1, m2 and m3 and 2 more)" in many_found[0].text


def test_a_step_near_its_limit_is_a_warning_with_a_step():
    text = """
    <mujoco><option timestep="{}" gravity="0 0 0"/><worldbody><body><joint name="j"/>
    <inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/></body></worldbody>
    <actuator><velocity joint="j" kv="2"/></actuator>
    <keyframe><key ctrl="1"/></keyframe></mujoco>"""
    # Euler bears 2 I / kv = 10 ms
    severities = {
        step: [f.severity for f in finding_of(loaded, FindingKind.STABLE_STEP)]
        for step in (0.004, 0.006, 0.0095, 0.011)
        for loaded in [mujoco.MjModel.from_xml_string(text.format(step))]
    }
    assert list(severities.values()) == [[], [Severity.NOTE], [Severity.WARNING], [Severity.FAULT]]


def test_bodies_that_a_loop_joins_are_left_out_by_a_line_to_paste(tmp_path):
    file = tmp_path / "model.xml"
    text = """<mujoco><worldbody>
      <body name="a"><joint axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 1 0 0" size=".1"/></body>
      <body name="b" pos="2 0 0"><joint axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 -1 0 0" size=".1"/></body></worldbody>
      <equality><connect body1="a" body2="b" anchor="1 0 0"/></equality></mujoco>"""
    file.write_text(text)
    (found,) = (one for one in screen_model(file).findings if one.kind is FindingKind.CONTACT)
    assert "of geom 0 of body a and geom 1 of body b" in found.text
    assert found.remedy == ('<exclude body1="a" body2="b"/> in <contact>, since a loop joins them')
    file.write_text(
        text.replace("</mujoco>", f"<contact>{found.remedy.split(' in <')[0]}</contact></mujoco>")
    )
    assert not [one for one in screen_model(file).findings if one.kind is FindingKind.CONTACT]


def test_an_equality_of_joints_is_not_taken_for_a_joint(tmp_path):
    file = tmp_path / "model.xml"
    file.write_text("""<mujoco><worldbody><body>
      <joint name="turn" axis="0 0 1" frictionloss="0.05"/>
      <joint name="rise" type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body></worldbody>
      <equality><joint joint1="rise" joint2="turn" polycoef="0 .002 0 0 0"/></equality></mujoco>""")
    screen = screen_model(file)
    assert [str(element) for element in screen.mobility.needed] == ["equality joint 0"]
    (found,) = (one for one in screen.findings if one.kind is FindingKind.SOFT_LOOP)
    assert found.element.tag == "joint"
    assert found.text.startswith("equality joint 0 gives way by ")


@pytest.mark.parametrize(
    "solimp",
    ["0.9 0.95 0.001 0.5 2", "0.9 0.95 0", "0.9 0.95 0.001 0 2", "1 1 0.001", "0 0.9 0.1 1 6"],
)
@pytest.mark.parametrize("depth", [1e-4, 6e-4, 0.02])
def test_the_impedance_is_that_of_mujoco(solimp, depth):
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody><body><joint name="a"
      type="slide"/><geom size=".1"/></body></worldbody><equality><joint joint1="a"
      polycoef="{depth} 0 0 0 0" solimp="{solimp}"/></equality></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert impedance(model.eq_solimp[0], depth) == pytest.approx(
        np.ravel(data.efc_KBIP)[2], abs=1e-12
    )


def test_an_equality_of_hinges_opens_by_an_angle(tmp_path):
    file = tmp_path / "model.xml"
    file.write_text("""<mujoco><worldbody><body><joint name="a"/><geom size=".1"/></body>
      <body pos="1 0 0"><joint name="b"/><geom size=".1"/></body></worldbody><equality>
      <joint joint1="a" joint2="b" polycoef="0.3 1 0 0 0"/></equality></mujoco>""")
    (found,) = (
        one
        for one in screen_model(file).findings
        if one.kind is FindingKind.OPEN_LOOP and one.value == pytest.approx(0.3)
    )
    assert "is open by 0.3 rad at the start" in found.text
