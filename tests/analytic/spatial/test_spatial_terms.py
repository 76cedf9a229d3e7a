"""Terms of the equations of motion: two formulations, finite differences, and their comparison."""

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass import load_case
from proofmass.analytic import spatial
from proofmass.analytic.numerics import NotCovered
from proofmass.analytic.spatial import terms as own
from proofmass.analytic.spatial.kinematics import advance_pose
from proofmass.analytic.spatial.mechanism import Tree, read_tree
from proofmass.analytic.spatial.terms import (
    OwnTerms,
    own_terms,
)
from proofmass.analytic.spatial.witness import TermsDiffer, compare_terms
from proofmass.analytic.term_source import TERM_NAMES, Terms, TermSource
from proofmass.base.errors import InputError
from proofmass.reference.evaluate import properties
from proofmass.run.solve import solve
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.smooth import SmoothTerms
from tests.shipped import shipped

ALL_FEATURES_MODEL = """
<mujoco><option><flag contact="disable"/></option>
<worldbody>
  <body pos=".1 .2 .3" euler="50 60 70"><site name="wall" pos=".3 .2 .3" euler="10 20 30"/></body>
  <body name="a" pos=".1 .2 1"><joint name="free" type="free" damping=".1" stiffness="2"/>
    <inertial pos=".1 .02 .03" mass="1.5" fullinertia=".1 .2 .25 .01 .02 .03"/>
    <site name="on_a" pos=".1 0 .2" euler="10 20 30"/>
    <body name="b" pos=".5 0 .1" euler="10 20 30">
      <joint name="ball" type="ball" pos=".01 .02 .03" stiffness="3" damping=".2" armature=".01"/>
      <inertial pos=".1 .2 .03" mass=".5" diaginertia=".01 .02 .025"/>
      <site name="on_b" pos=".1 0 .2" euler="40 20 30"/>
      <body name="c" pos=".5 0 .1" euler="10 20 70">
        <joint name="hinge" pos=".01 .02 .03" axis="1 2 3" ref="20" springref="35"
               stiffness="3 4 5" damping=".2 .3 .4" armature=".01"/>
        <joint name="slide" type="slide" axis="1 0 1" ref=".2" springref=".5"
               stiffness="3 -4 5" damping=".2 .3 .4"/>
        <joint name="other" axis="0 1 0"/>
        <inertial pos=".1 .2 .03" mass=".5" diaginertia=".01 .02 .025"/>
        <site name="on_c" pos=".1 .1 .2"/>
      </body>
    </body>
  </body>
  <body name="d" pos="1 1 1"><joint name="alone" axis="0 1 1"/>
    <inertial pos=".1 .2 .03" mass=".7" diaginertia=".01 .02 .025"/>
    <site name="on_d" pos=".1 .3 .2" euler="40 20 30"/>
  </body>
</worldbody>
<tendon>
  <spatial name="spring" stiffness="100 5 7" springlength=".1 .3" damping="1 2 3">
    <site site="on_c"/><site site="on_d"/>
  </spatial>
  <spatial name="three" stiffness="20" springlength="2 3">
    <site site="wall"/><site site="on_a"/><site site="on_b"/>
  </spatial>
  <fixed name="fixed" stiffness="3" damping="1 2">
    <joint joint="hinge" coef="1"/><joint joint="slide" coef="2"/>
  </fixed>
</tendon>
<actuator>
  <motor name="motor" joint="hinge" gear="2" ctrllimited="true" ctrlrange="-.1 .2"/>
  <position name="servo" joint="slide" kp="3" kv="1" forcerange="-1 2" gear="1.5"/>
  <position name="winch" tendon="spring" kp="4" kv=".5" gear="2"/>
  <motor name="dead" site="on_c" refsite="wall" gear="1 2 3 .4 .5 .6"/>
  <motor name="following" site="on_b" gear="1 -2 3 .4 -.5 .6" forcerange="-1 .5"/>
</actuator>
<equality>
  <connect name="c1" body1="c" body2="d" anchor=".1 .2 .3"/>
  <joint name="j1" joint1="hinge" joint2="slide" polycoef=".1 .2 .3 .4 .5"/>
  <weld name="w1" body1="c" body2="d" torquescale=".7" relpose=".1 .2 .3 .5 .5 .5 .5"
        anchor=".1 .2 .1"/>
  <weld name="w2" site1="on_b" site2="on_d"/>
  <connect name="c2" site1="on_a" site2="on_d"/>
  <tendon name="t1" tendon1="spring" tendon2="three" polycoef=".1 1 .3"/>
  <joint name="j2" joint1="hinge" polycoef=".1"/>
  <tendon name="t2" tendon1="three" polycoef=".1"/>
  <tendon name="t3" tendon1="fixed" tendon2="spring" polycoef=".1 .7"/>
</equality>
<keyframe><key name="start" ctrl=".3 .4 .5 .6 .7"/></keyframe>
</mujoco>
"""
SWINGING_MODEL = """
<mujoco><option><flag contact="disable"/></option>
<worldbody><body name="a"><joint name="a" type="ball"/>
  <inertial pos="0 .1 -.5" mass="1" diaginertia=".1 .2 .25"/>
  <body name="b" pos="0 0 -1"><joint name="h" axis="1 0 0"/><joint name="k" axis="0 1 0"/>
    <inertial pos=".1 .2 -.5" mass=".5" diaginertia=".01 .02 .025"/>
  </body>
</body></worldbody>
<equality><joint name="tie" joint1="h" joint2="k" polycoef="0 1 .5"/></equality>
<keyframe><key name="start" qpos="1 0 0 0 0 0" qvel="1 2 3 1 1"/></keyframe>
</mujoco>
"""


@pytest.fixture(scope="module")
def everything() -> tuple[mujoco.MjModel, Tree, np.ndarray, np.ndarray]:
    """A model with every feature that is covered, and twenty random states of it."""
    model, rng = mujoco.MjModel.from_xml_string(ALL_FEATURES_MODEL), np.random.default_rng(1)
    tree = read_tree(model, "start")
    v = rng.normal(size=(20, model.nv))
    q = np.array([advance_pose(tree, model.qpos0, rng.normal(size=model.nv)) for _ in v])
    return model, tree, q, v


def test_all_terms_are_those_of_mujoco(everything):
    """MuJoCo's drift contains violations of up to 2 times its stiffness, which are subtracted.

    So the tolerance of the drift is 1e-12, and that of the other terms 1e-14.
    """
    model, tree, q, v = everything
    source, found = SmoothTerms(model), own_terms(tree, q, v)
    for k, state in enumerate(zip(q, v, strict=True)):
        theirs = source.terms(*state)
        for name in TERM_NAMES:
            one, two = getattr(found, name)[k], getattr(theirs, name)
            atol = (1e-12 if name == "drift" else 1e-14) * max(1.0, np.abs(two).max())
            np.testing.assert_allclose(one, two, rtol=0, atol=atol, err_msg=name)


@pytest.mark.parametrize("part", ["SPRING", "DAMPER", "GRAVITY", "EQUALITY", "ACTUATION"])
def test_disabled_parts_of_a_model_are_in_no_term(everything, part):
    """At one state, with the tolerances of `test_all_terms_are_those_of_mujoco`."""
    model, q, v = (
        mujoco.MjModel.from_xml_string(ALL_FEATURES_MODEL),
        everything[2][:1],
        everything[3][:1],
    )
    model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{part}"))
    found, theirs = own_terms(read_tree(model, "start"), q, v), SmoothTerms(model).terms(q[0], v[0])
    for name in TERM_NAMES:
        one, two = getattr(found, name)[0], getattr(theirs, name)
        atol = (1e-12 if name == "drift" else 1e-14) * max(1.0, np.abs(two).max(initial=0.0))
        np.testing.assert_allclose(one, two, rtol=0, atol=atol, err_msg=name)
    whole = own_terms(everything[1], q, v)
    changed = {"GRAVITY": "bias", "EQUALITY": "gap"}.get(part, "force")
    assert not np.array_equal(getattr(whole, changed), getattr(found, changed))


def test_sensors_at_a_state_are_those_of_mujoco(everything):
    """Equalities are disabled, since MuJoCo's are soft; accelerations are those of the start."""
    spec, kind, obj = mujoco.MjSpec.from_string(ALL_FEATURES_MODEL), mujoco.mjtSensor, mujoco.mjtObj
    for one in spec.equalities:
        one.active = False
    for name in (
        *("FRAMEPOS", "FRAMEQUAT", "FRAMEXAXIS", "FRAMEYAXIS", "FRAMEZAXIS", "FRAMELINVEL"),
        *("FRAMEANGVEL", "FRAMELINACC", "FRAMEANGACC", "ACCELEROMETER", "GYRO", "VELOCIMETER"),
    ):
        given = {"objtype": obj.mjOBJ_SITE, "objname": "on_c"}
        spec.add_sensor(name=name, type=getattr(kind, f"mjSENS_{name}"), **given)
    for name in ("E_KINETIC", "E_POTENTIAL"):
        spec.add_sensor(name=name, type=getattr(kind, f"mjSENS_{name}"))
    for name in ("TENDONPOS", "TENDONVEL"):
        given = {"objtype": obj.mjOBJ_TENDON, "objname": "three"}
        spec.add_sensor(name=name, type=getattr(kind, f"mjSENS_{name}"), **given)
    q, v = everything[2:]
    for k in range(3):
        model = spec.compile()  # a model that was read is not read again
        model.key_qpos[0], model.key_qvel[0] = q[k], v[k]
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_forward(model, data)
        found = spatial.solve([0.0], model=model)
        for s in range(model.nsensor):
            name, begin = model.sensor(s).name, model.sensor_adr[s]
            theirs = data.sensordata[begin : begin + model.sensor_dim[s]]
            parts = [found[one][0] for one in found if one.split(".")[0] == name]
            if name == "FRAMELINACC":  # MuJoCo subtracts gravity, as in an accelerometer
                theirs = theirs + model.opt.gravity
            sign = -1.0 if name == "FRAMEQUAT" and theirs @ parts < 0.0 else 1.0
            # the mass matrix of condition 1e3 affects accelerations; quaternions have either sign
            bound = 1e-11 * max(1.0, np.abs(theirs).max())
            np.testing.assert_allclose(parts, sign * theirs, rtol=0, atol=bound, err_msg=name)


def test_a_sensor_on_a_camera_is_one_on_a_site_in_its_place():
    """A camera that turns towards a target has no fixed place in its body, and is refused."""
    place = 'pos=".1 .2 .3" euler="10 20 30"'
    text = SWINGING_MODEL.replace(
        '<body name="b"', f'<site name="s" {place}/><camera name="c" {place}/><body name="b"'
    )
    kinds = "framepos", "framequat", "framelinvel", "frameangvel", "framelinacc"
    sensors = "".join(
        f'<{kind} name="{kind}_{one}" objtype="{what}" objname="{one}"/>'
        for kind in kinds
        for what, one in (("site", "s"), ("camera", "c"))
    )
    text = text.replace("<keyframe>", f"<sensor>{sensors}</sensor><keyframe>")
    found = spatial.solve([0.0, 0.01], model=mujoco.MjModel.from_xml_string(text))
    assert len(found) == 2 * (4 * 3 + 4)
    for name in (name for name in found if "_s." in name):
        np.testing.assert_array_equal(found[name.replace("_s.", "_c.")], found[name], err_msg=name)
    moving = text.replace('<camera name="c"', '<camera name="c" mode="targetbody" target="b"')
    with pytest.raises(NotCovered, match=r"sensor 'framepos_c' is on camera 'c'.* must be fixed"):
        spatial.solve([0.0, 0.01], model=mujoco.MjModel.from_xml_string(moving))


def test_a_quaternion_and_its_negative_are_one_pose(everything):
    """The same holds for the spring of a ball, whose moment acts along the shorter rotation."""
    _, tree, q, v = everything
    found, other = own_terms(tree, q, v), q.copy()
    (free, _), (ball, _) = tree.quaternions
    for begin in (free, ball):
        other[:, begin : begin + 4] *= -1.0
    # a weld's violation is the vector part of a quaternion, of either sign: it is not compared
    for name in ("mass", "bias", "force"):
        np.testing.assert_array_equal(
            getattr(own_terms(tree, other, v), name), getattr(found, name), err_msg=name
        )


def test_rows_of_equalities_are_the_derivatives_of_their_violations(everything):
    """They agree with central differences of the violation along motions of constant rates."""
    _, tree, q, v = everything
    found, step = own_terms(tree, q, v), 1e-4

    def violations(time: float) -> np.ndarray:
        moved = np.array([advance_pose(tree, *state) for state in zip(q, time * v, strict=True)])
        return own_terms(tree, moved, v).gap

    before, now, after = (violations(time) for time in (-step, 0.0, step))
    rate = np.einsum("nkr,nr->nk", found.jacobian, v)
    np.testing.assert_allclose((after - before) / (2 * step), rate, atol=1e-5, rtol=1e-5)
    bend = (after - 2 * now + before) / step**2
    np.testing.assert_allclose(bend, -found.drift, atol=1e-4, rtol=1e-5)


class ChangedTerms(SmoothTerms):
    """MuJoCo's terms, of which some are replaced."""

    def __init__(self, model: mujoco.MjModel, **changes):
        super().__init__(model)
        self.changes = changes

    def terms(self, q: np.ndarray, v: np.ndarray, ctrl: np.ndarray | None = None) -> Terms:
        """The terms at a state, with the replaced ones."""
        found = super().terms(q, v, ctrl)
        return replace(found, **{name: change(self, q, v) for name, change in self.changes.items()})


def bias_at_zero_rates(source: SmoothTerms, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The bias force at zero rates."""
    return SmoothTerms(source.model).terms(q, 0 * v).bias


def drift_in_mujoco(source: SmoothTerms, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The drift in MuJoCo itself, which is 0 for a joint equality."""
    return np.zeros(1)


def free_motion(
    model: mujoco.MjModel, source: TermSource, times: np.ndarray
) -> spatial.SolvedMotion:
    """The free motion of a model with the terms of a source."""
    tree, _ = spatial.tree_and_terms(model, "start", source)
    return spatial.integrate_in_time(tree, source, (), (), times, (), None)


def test_the_second_formulation_agrees_with_mujoco():
    model = mujoco.MjModel.from_xml_string(SWINGING_MODEL)
    times, source = np.linspace(0.0, 0.2, 5), SmoothTerms(model)
    spatial.solve(times, model=model, terms=source)
    seen = free_motion(model, source, times).comparison
    assert seen.states == 5
    assert seen.difference < 1e-13


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"bias": bias_at_zero_rates}, "bias force"),
        ({"drift": drift_in_mujoco}, "J-dot-v of the equalities"),
    ],
)
def test_the_second_formulation_shows_a_wrong_term(change, words):
    model = mujoco.MjModel.from_xml_string(SWINGING_MODEL)
    with pytest.raises(TermsDiffer, match=f"the {words} of MuJoCo and of proofmass's own"):
        spatial.solve([0.0, 0.01], model=model, terms=ChangedTerms(model, **change))


def test_terms_with_nan_are_refused():
    model = mujoco.MjModel.from_xml_string(SWINGING_MODEL)
    tree, state = read_tree(model, "start"), (model.key_qpos.copy(), model.key_qvel.copy())
    changed = ChangedTerms(model, bias=lambda source, q, v: np.nan * v)
    with pytest.raises(TermsDiffer, match="bias force"):
        compare_terms(tree, changed, np.zeros(1), *state)


def test_the_second_formulation_shows_a_wrong_inertia():
    model = mujoco.MjModel.from_xml_string(SWINGING_MODEL)
    tree = read_tree(model, "start")
    model.body_inertia[1, 0] *= 1 + 1e-10
    state = model.key_qpos.copy(), model.key_qvel.copy()
    with pytest.raises(TermsDiffer, match="mass matrix"):
        compare_terms(tree, SmoothTerms(model), np.zeros(1), *state)


@pytest.mark.parametrize("sign", [0.0, -1.0])
def test_a_missing_or_reversed_gyroscopic_term_is_shown(sign, monkeypatch):
    def changed_forces(tree, motion, inertia):
        still = replace(motion, spin=0 * motion.spin)
        forces, _ = balances(tree, motion, inertia)
        moments = balances(tree, still, inertia)[1]
        return forces, moments + sign * (balances(tree, motion, inertia)[1] - moments)

    balances = own.newton_euler_forces
    monkeypatch.setattr(own, "newton_euler_forces", changed_forces)
    model = mujoco.MjModel.from_xml_string(SWINGING_MODEL)
    with pytest.raises(TermsDiffer, match="bias force"):
        spatial.solve([0.0, 0.01], model=model, terms=SmoothTerms(model))


def test_equalities_stay_closed_and_their_forces_do_no_work():
    """Constraint forces Jᵀλ = M a + h - Q have no power on the motion."""
    model = mujoco.MjModel.from_xml_string(SWINGING_MODEL)
    motion = free_motion(model, SmoothTerms(model), np.linspace(0.0, 0.3, 7)).held
    found = own_terms(read_tree(model, "start"), motion.q, motion.v)
    assert np.abs(found.gap).max() < 1e-13
    assert np.abs(np.einsum("nkr,nr->nk", found.jacobian, motion.v)).max() < 1e-13
    force = np.einsum("nij,nj->ni", found.mass, motion.a) + found.bias - found.force
    assert np.abs(force).max() > 0.1
    assert np.abs((force * motion.v).sum(axis=1)).max() < 1e-12


REFUSED_FEATURES = {
    "frictionloss of joint 'a', which is a ball": (
        'name="a" type="ball"',
        'name="a" type="ball" frictionloss="1"',
    ),
    "range of joint 'a'": (
        'name="a" type="ball"',
        'name="a" type="ball" range="0 1" limited="true"',
    ),
    "spring that yields of joint 'h'": (
        'name="h"',
        'name="h" stiffness="1" springyield="1"',
    ),
    "density or viscosity of the options": ("<option>", '<option density="1">'),
    "activation of actuator 'muscle'": (
        "</worldbody>",
        '</worldbody><actuator><muscle name="muscle" joint="h" lengthrange="0 1"/></actuator>',
    ),
    "actuator 'push', which acts": (
        "</worldbody>",
        '</worldbody><actuator><general name="push" body="b"/></actuator>',
    ),
    "tendon 't', which goes around a geom or a pulley": (
        "</worldbody>",
        '</worldbody><tendon><spatial name="t"><site site="s1"/><geom geom="g"/>'
        '<site site="s2"/></spatial></tendon>',
    ),
}


@pytest.mark.parametrize("words", REFUSED_FEATURES)
def test_features_that_are_not_covered_are_refused(words):
    text = SWINGING_MODEL.replace(
        "<worldbody>",
        '<worldbody><site name="s1"/><site name="s2" pos="0 0 1"/>'
        '<geom name="g" type="sphere" size=".1" pos="0 0 3"/>'
        + ("" if "contacts" not in words else '<geom name="f" type="plane" size="1 1 1"/>'),
    ).replace('<joint name="h"', '<geom size=".1"/><joint name="h"')
    model = mujoco.MjModel.from_xml_string(text.replace(*REFUSED_FEATURES[words]))
    with pytest.raises(NotCovered) as refused:
        read_tree(model, "start")
    assert words in str(refused.value)


def test_an_open_start_pose_is_refused():
    model = mujoco.MjModel.from_xml_string(SWINGING_MODEL)
    model.key_qpos[0, 4] = 0.06
    with pytest.raises(ValueError, match=r"equality 'tie' is open by 0.06 at the start"):
        spatial.solve([0.0, 1.0], model=model)
    model = mujoco.MjModel.from_xml_string(SWINGING_MODEL)
    model.key_qpos[0, 4] = 0.04  # which the engines close as well
    found = spatial.solve([0.0, 1.0], model=model)
    assert all(np.isfinite(curve).all() for curve in found.values())


@pytest.mark.parametrize(
    ("more", "kept"),
    [("", True), ('stiffness="3"', True), ('damping=".1"', False), ('damping="0 .1 0"', False)],
)
def test_properties_state_energy_only_without_dampers(more, kept):
    text = SWINGING_MODEL.replace(
        "<equality>",
        f'<tendon><fixed name="t" {more}><joint joint="h" coef="1"/></fixed></tendon><equality>',
    )
    model, times = mujoco.MjModel.from_xml_string(text), np.array([0.0, 0.05, 0.1])
    arguments = {"model": model, "start": "start", "terms": SmoothTerms(model), "joints": ()}
    found = spatial.properties(**arguments, motion=times)
    assert ("energy" in found) == kept


def test_own_terms_alone_give_the_same_motion():
    model, times = mujoco.MjModel.from_xml_string(SWINGING_MODEL), np.array([0.0, 0.02, 0.04])
    one, two = (
        free_motion(model, source, times).held
        for source in (SmoothTerms(model), OwnTerms(read_tree(model, "start")))
    )
    np.testing.assert_allclose(one.q, two.q, rtol=0, atol=1e-13)
    np.testing.assert_allclose(one.a, two.a, rtol=0, atol=1e-11)


TOP_FILES = ("euler_top.xml", "euler_top.toml")


def copy_top(folder: Path, *change: str) -> Path:
    """Copy the sidecar and the model of the free body, with a change of their text."""
    for name in TOP_FILES:
        text = shipped(name).read_text(encoding="utf-8")
        (folder / name).write_text(text.replace(*change), encoding="utf-8")
    return folder / TOP_FILES[1]


def test_a_feature_that_is_not_covered_is_an_input_error(tmp_path):
    with pytest.raises(InputError) as refused:
        load_case(copy_top(tmp_path, "<option ", '<option density="1.2" '))
    assert refused.value.file == tmp_path / TOP_FILES[0]
    assert refused.value.wrong == (
        "the reference 'spatial' does not cover it: density or viscosity of the options"
    )


def test_pymunk_refuses_a_free_joint(tmp_path):
    case = load_case(copy_top(tmp_path, '"mujoco:default"', '"pymunk"'))
    with pytest.raises(Unsupported, match="free joint 'body'"):
        solve(case, "dynamics", "pymunk")


def test_quaternions_and_vectors_of_a_mechanism_in_space_are_channels():
    case = load_case(shipped("euler_top.toml"))
    parts = {name: [] for name in ("turn", "spin", "tip", "energy")}
    for channel in case.channels:
        name, _, part = channel.partition(".")
        parts[name].append(part)
    assert parts == {
        "turn": ["w", "x", "y", "z"],
        "spin": ["x", "y", "z"],
        "tip": ["x", "y", "z"],
        "energy": [""],
    }


def test_properties_state_how_closely_the_second_formulation_agrees():
    found = properties(load_case(shipped("changing_gear.toml")))
    assert found["equations of motion"] == "terms of MuJoCo, integrated with DOP853 at 3e-14"
    second = found["second formulation"]
    assert re.match(r"proofmass's own terms agree at 50 poses, to \de-1[56] of", second)
    assert found["equalities"] == "closed exactly, 1 independent of 1 rows; open by 0 in the key"
    assert re.match(r"kept to \de-1\d of the largest kinetic energy", found["energy"])
