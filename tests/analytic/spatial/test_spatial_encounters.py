"""What a motion does not meet changes nothing: contacts, tendons' ranges; what it meets is refused.

Weight that is taken away, mocap bodies and margins of ranges are compared with bare MuJoCo and with
formulas.
"""

import mujoco
import numpy as np
import pytest

from proofmass.analytic import planar, spatial
from proofmass.analytic.numerics import NotCovered
from proofmass.analytic.spatial.encounters import between_samples
from proofmass.sim.smooth import SmoothTerms

TIMES = np.linspace(0.0, 0.5, 51)
# a ball on a rod, whose lowest place is 0.5 m below its hinge, above a floor
PENDULUM = """
<mujoco><option timestep="1e-3">{flag}</option><worldbody>
<geom name="floor" type="plane" size="2 2 .1" pos="0 0 {floor}"/>
<body name="rod"><joint name="hinge" axis="0 1 0"/>
<geom name="bob" size=".05" pos="0 0 -.5" mass="1"/>
<site name="end" pos="0 0 -.5"/></body><site name="post" pos="0 0 -1"/></worldbody>
<tendon><spatial name="rope" limited="{limited}" range="0 {length}">
<site site="end"/><site site="post"/></spatial></tendon>
<sensor><jointpos name="hinge" joint="hinge"/></sensor>
<keyframe><key name="start" qpos="1.2"/></keyframe></mujoco>"""
FREE = {"flag": '<flag contact="disable"/>', "floor": "-9", "limited": "false", "length": "9"}


def motion_of(text, times=TIMES, own=False):
    model = mujoco.MjModel.from_xml_string(text)
    terms = None if own else SmoothTerms(model, "start" if model.nkey else "")
    return spatial.solve(times, model=model, start="start" if model.nkey else "", terms=terms)


def pendulum(**changes):
    return PENDULUM.format(**FREE | changes)


def bare(text, times=TIMES, step=2e-5):
    """The coordinates of bare MuJoCo with short RK4 steps (times, nq)."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    found = []
    for time in times:
        while data.time < time - step / 2:
            mujoco.mj_step(model, data)
        found.append(data.qpos.copy())
    return np.array(found)


def test_a_floor_that_is_not_touched_changes_nothing():
    free = motion_of(pendulum())["hinge"]
    above = motion_of(pendulum(flag="", floor="-.551"))["hinge"]
    assert np.array_equal(above, free)
    assert free.min() < 0.0  # it passes its lowest place


def test_a_floor_that_is_touched_is_refused_with_the_geoms_and_the_time():
    text = pendulum(flag="", floor="-.549")
    with pytest.raises(NotCovered, match="geoms 'floor' and 'bob' touch at t = ") as caught:
        motion_of(text)
    said = float(str(caught.value).split("t = ")[1].split(" s")[0])
    angles = motion_of(pendulum(), times := np.linspace(0.0, 0.5, 5001))["hinge"]
    touches = times[np.argmax(0.5 * np.cos(angles) + 0.05 > 0.549)]
    assert said == pytest.approx(touches, abs=1.1e-3)  # the model looks each millisecond
    with pytest.raises(NotCovered, match="contacts are not covered"):
        motion_of(text, own=True)  # terms without shapes cannot tell


def test_a_contact_between_two_samples_is_found():
    text = pendulum(flag="", floor="-.549")
    with pytest.raises(NotCovered, match="touch"):
        motion_of(text, np.array([0.0, 0.5, 1.0]))


def test_the_range_of_a_tendon_acts_only_if_it_is_reached():
    # the rope is longest at the start, by the law of cosines, and 0.5 m at the lowest place
    start = np.sqrt(0.25 + 1.0 - np.cos(1.2))
    free = motion_of(pendulum())["hinge"]
    slack = motion_of(pendulum(limited="true", length=f"{start + 1e-3}"))["hinge"]
    assert np.array_equal(slack, free)
    shortest = 'range="0.51 9"'
    text = pendulum(limited="true").replace('range="0 9"', shortest)
    with pytest.raises(
        NotCovered, match="range of tendon 'rope', an end of which it reaches at t ="
    ):
        motion_of(text)


def test_a_cubic_between_samples_is_found_exactly():
    times = np.array([0.0, 0.3, 1.0])
    values, at = between_samples(times, times**3 - times, 3 * times**2 - 1)
    assert values == pytest.approx(at**3 - at, abs=1e-15)
    assert len(at) == 17


@pytest.mark.parametrize("share", [0.6, 1.0, 1.3])
def test_weight_that_is_taken_away_is_that_of_bare_mujoco(share):
    text = f"""
    <mujoco><worldbody><body name="one" gravcomp="{share}"><joint name="a" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 .4 0 .1" size=".03" mass="2"/>
    <body name="two" pos=".4 0 .1" gravcomp="{share / 2}"><joint name="b" type="ball"/>
    <geom type="capsule" fromto="0 0 0 .1 .3 0" size=".02" mass="1"/></body></body></worldbody>
    <sensor><jointpos name="a" joint="a"/><ballquat name="b" joint="b"/></sensor></mujoco>"""
    text = text.replace("<mujoco>", '<mujoco><option><flag contact="disable"/></option>')
    found, known = motion_of(text), bare(text)
    assert found["a"] == pytest.approx(known[:, 0], abs=1e-9)
    assert np.abs(motion_of(text.replace("gravcomp", "user"))["a"] - found["a"]).max() > 0.1


def test_actuators_that_take_weight_are_refused():
    text = """<mujoco><option><flag contact="disable"/></option><worldbody>
    <body gravcomp="1"><joint name="a" axis="0 1 0" actuatorgravcomp="true"/>
    <geom size=".1" pos=".4 0 0"/></body></worldbody></mujoco>"""
    with pytest.raises(NotCovered, match="actuatorgravcomp of joint 'a'"):
        motion_of(text)


MOCAP = """
<mujoco><option><flag contact="disable"/></option><worldbody>
<body name="hand" mocap="true" pos=".3 0 0"/>
<body name="rod"><joint name="a" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>
<body name="link" pos=".3 0 0"><joint name="b" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .2 0 .1" size=".02"/></body></body></worldbody>
<tendon><spatial stiffness="30" springlength="0">
<site site="grip"/><site site="tip"/></spatial></tendon>
<sensor><jointpos name="a" joint="a"/></sensor>
<keyframe><key name="start" qpos=".3 .2"{}/></keyframe></mujoco>""".replace(
    'pos=".3 0 0"/>', 'pos=".3 0 0"><site name="grip"/></body>', 1
).replace('.2 0 .1" size=".02"/>', '.2 0 .1" size=".02"/><site name="tip" pos=".2 0 .1"/>')


@pytest.mark.parametrize("solve", [planar.solve, spatial.solve])
def test_a_mocap_body_stands_where_the_model_has_it(solve):
    text = MOCAP.format("")
    found = solve(TIMES, model=mujoco.MjModel.from_xml_string(text))["a"]
    assert found == pytest.approx(bare(text)[:, 0], abs=1e-8)
    moved = MOCAP.format(' mpos=".3 0 .1"')
    with pytest.raises(NotCovered, match="mocap body 'hand', which a key places"):
        solve(TIMES, model=mujoco.MjModel.from_xml_string(moved))


@pytest.mark.parametrize("solve", [planar.solve, spatial.solve])
def test_a_driven_motion_ends_at_the_margin_of_a_range(solve):
    model = mujoco.MjModel.from_xml_string("""
    <mujoco><option><flag contact="disable"/></option><worldbody>
    <body><joint name="a" axis="0 1 0"/><geom size=".05" mass="1"/></body>
    <body><joint name="b" axis="0 1 0" limited="true" range="-57.3 57.3" margin="0.3"/>
    <geom size=".05" mass="1"/></body></worldbody>
    <equality><joint joint1="b" joint2="a"/></equality>
    <sensor><jointpos name="b" joint="b"/></sensor>
    <keyframe><key name="start" qpos="0 0"/></keyframe></mujoco>""")
    times = np.linspace(0.0, 1.0, 11)
    one = np.ones(11)
    followed = solve(0.6 * times, 0.6 * one, 0.0 * one, model=model, joints=("a",))["b"]
    assert followed == pytest.approx(0.6 * times, abs=1e-12)
    with pytest.raises(ValueError, match="'b' leaves its range"):
        solve(0.9 * times, 0.9 * one, 0.0 * one, model=model, joints=("a",))


@pytest.mark.parametrize("solve", [planar.solve, spatial.solve])
def test_a_limit_with_a_margin_acts_at_the_margin(solve):
    text = """
    <mujoco><option timestep="1e-3"><flag contact="disable"/></option><worldbody><body>
    <joint name="a" axis="0 1 0" limited="true" range="-90 {}" margin="{}" solreflimit=".02 1"/>
    <geom size=".05" pos="0 0 .5" mass="1"/></body></worldbody>
    <sensor><jointpos name="a" joint="a"/></sensor>
    <keyframe><key name="start" qpos="0.2"/></keyframe></mujoco>"""
    with_margin = mujoco.MjModel.from_xml_string(text.format(np.degrees(1.0), 0.3))
    without = mujoco.MjModel.from_xml_string(text.format(np.degrees(0.7), 0.0))
    times = np.linspace(0.0, 1.5, 31)
    found = solve(times, model=with_margin)["a"]
    assert found == pytest.approx(solve(times, model=without)["a"], abs=1e-12)
    assert found[-1] == pytest.approx(0.7, abs=1e-12)
    # MuJoCo's soft limit holds it at the margin as well, up to its softness
    resting = [
        bare(text.format(np.degrees(1.0), 0.3).replace(".02 1", f"{t} 1"), [0.0, 1.5], 1e-3)
        for t in (0.01, 0.005)
    ]
    off = [abs(one[-1, 0] - 0.7) for one in resting]
    assert off[1] < 0.3 * off[0] < 0.003
