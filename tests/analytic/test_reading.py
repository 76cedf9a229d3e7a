"""The reading that both general solvers share: a misread number makes terms that are not MuJoCo's.

The two solvers cannot show such a number to each other.  The terms of each are compared with those
that MuJoCo computes from its own arrays, and every number of the data, changed by itself, changes
them.
"""

import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass import analytic
from proofmass.analytic.mjcf import ActuatorTarget, ModelData, read_compiled
from proofmass.analytic.numerics import NotCovered
from proofmass.analytic.planar.forces import (
    applied_forces,
    centre_jacobians,
    inertial_forces,
    mass_matrix,
)
from proofmass.analytic.planar.kinematics import linearise_loops, move_bodies
from proofmass.analytic.planar.mechanism import make_mechanism
from proofmass.analytic.spatial.kinematics import advance_pose
from proofmass.analytic.spatial.mechanism import make_tree
from proofmass.analytic.spatial.terms import own_terms
from proofmass.sim.smooth import SmoothTerms
from tests.analytic.spatial.test_spatial_terms import ALL_FEATURES_MODEL

PLANAR_MODEL = """
<mujoco><compiler angle="radian"/><option gravity="1 -9.81 0"><flag contact="disable"/></option>
<worldbody>
  <body pos=".1 .2 0" euler="0 0 .6"><site name="wall" pos=".3 1.2 0" euler="0 0 .4"/></body>
  <body name="arm" pos=".2 .1 0" euler="0 0 .3">
    <joint name="a" axis="0 0 1" pos=".01 .02 0" ref=".3" springref=".7" stiffness="3 4 5"
           damping=".2 .3 .4" armature=".01"/>
    <inertial pos=".4 .05 0" mass="1.1" diaginertia=".02 .1 .11"/>
    <site name="on_arm" pos=".5 .1 .2" euler="0 0 .8"/>
    <body name="fore" pos="1 .1 0" euler="0 0 -.4">
      <joint name="b" axis="0 0 -1" stiffness="2" damping=".5" springref=".1"/>
      <inertial pos=".3 .02 0" mass=".7" diaginertia=".01 .05 .055"/>
      <site name="tip" pos=".6 .1 0" euler="0 0 .2"/>
    </body>
  </body>
  <body name="cart" pos="1 1 0">
    <joint name="c" type="slide" axis="3 4 0" ref=".1" springref=".3" stiffness="30 -4 5"
           damping=".3 .1 .2" armature=".2"/>
    <inertial pos=".1 -.4 0" mass=".8" diaginertia=".01 .06 .065"/>
    <site name="on_cart" pos=".2 .3 0"/>
  </body>
</worldbody>
<tendon>
  <spatial name="cable" stiffness="50 5 7" springlength=".2 .3" damping="1 .2 .3">
    <site site="on_arm"/><site site="on_cart"/></spatial>
  <fixed name="sum" stiffness="3 1 2" damping="1 .2 .1" springlength=".1 .2">
    <joint joint="a" coef=".8"/><joint joint="c" coef="2"/></fixed>
</tendon>
<actuator>
  <motor name="motor" joint="a" gear="2" ctrllimited="true" ctrlrange="-.1 .2"/>
  <position name="servo" joint="b" kp="3" kv="1" gear="1.5"/>
  <general name="weak" joint="c" biastype="affine" gainprm="2" biasprm=".5 -3 -.4"
           forcelimited="true" forcerange="-1 2" gear=".7"/>
  <motor name="dead" site="tip" refsite="wall" gear="1 2 0 0 0 .6"/>
  <motor name="following" site="on_arm" gear="1 -2 0 0 0 -.6" forcelimited="true"
         forcerange="-.6 .5"/>
</actuator>
<equality>
  <connect name="pin" body1="fore" body2="cart" anchor=".1 .2 0"/>
  <joint name="gear" joint1="a" joint2="b" polycoef=".1 .2 .3 .4 .5"/>
  <tendon name="tie" tendon1="sum" polycoef=".1"/>
</equality>
<keyframe><key name="start" qpos=".3 .4 .5" ctrl=".1 .4 .5 .6 .2"/></keyframe>
</mujoco>
"""
"""Everything that the planar solver covers."""
KINDS_OF_ELEMENTS = "bodies", "joints", "tendons", "actuators", "equalities", "site_loads"


def changed_numbers(value: object) -> Iterator[tuple[str, object]]:
    """All copies of data in which one finite number is another, and what number that is."""
    if isinstance(value, float):
        if np.isfinite(value):
            yield "", value + 0.01 * (1.0 + abs(value))
    elif isinstance(value, np.ndarray):
        for k in np.ndindex(value.shape):
            other = value.copy()
            other[k] += 0.01 * (1.0 + abs(value[k]))
            yield f"{list(k)}", other
    elif isinstance(value, tuple):
        for k, part in enumerate(value):
            for where, other in changed_numbers(part):
                yield f"[{k}]{where}", (*value[:k], other, *value[k + 1 :])
    elif is_dataclass(value):
        for field in fields(value):
            for where, other in changed_numbers(getattr(value, field.name)):
                yield f".{field.name}{where}", replace(value, **{field.name: other})


def misread(data: ModelData) -> Iterator[tuple[str, ModelData]]:
    """All copies of a model's data in which one number that acts is another."""
    for kind in KINDS_OF_ELEMENTS:
        elements = getattr(data, kind)
        for k, element in enumerate(elements):
            if kind == "bodies" and k == 0:
                continue  # the ground
            if kind == "actuators" and element.target == ActuatorTarget.SITE:
                continue  # it acts as one of the loads
            for where, other in changed_numbers(element):
                changed = (*elements[:k], other, *elements[k + 1 :])
                yield f"{kind}[{k}]{where}", replace(data, **{kind: changed})
    for where, options in changed_numbers(data.options):
        yield f"options{where}", replace(data, options=options)


@pytest.fixture(scope="module")
def in_plane() -> tuple[mujoco.MjModel, tuple[np.ndarray, ...]]:
    """The planar model, and states with controls."""
    model, rng = mujoco.MjModel.from_xml_string(PLANAR_MODEL), np.random.default_rng(0)
    sizes = model.nq, model.nv, model.nu
    return model, tuple(rng.normal(size=(30, size)) for size in sizes)


@pytest.fixture(scope="module")
def in_space() -> tuple[mujoco.MjModel, tuple[np.ndarray, ...]]:
    """The model of the spatial solver's tests, and states with controls."""
    model, rng = mujoco.MjModel.from_xml_string(ALL_FEATURES_MODEL), np.random.default_rng(1)
    tree = make_tree(read_compiled(model), "start")
    v, ctrl = (rng.normal(size=(30, size)) for size in (model.nv, model.nu))
    q = [advance_pose(tree, model.qpos0, rng.normal(size=model.nv)) for _ in v]
    return model, (np.array(q), v, ctrl)


def planar_terms(data, states):
    """Mass matrix, forces less inertial forces, and violations of the loops with their rows."""
    m, _ = make_mechanism(data, "start")
    q, v, ctrl = states
    motion = move_bodies(m, q, v, np.zeros_like(v))
    centre = centre_jacobians(m, motion)
    force = applied_forces(m, motion, centre, q, v, ctrl) - inertial_forces(m, centre, motion)
    loops = linearise_loops(m, q)
    return mass_matrix(m, centre), force, *loops


def spatial_terms(data, states):
    """The same in space."""
    q, v, ctrl = states
    found = own_terms(make_tree(data, "start"), q, v, ctrl)
    return found.mass, found.force - found.bias, found.gap, found.jacobian


IN_PLANE, IN_SPACE = "in_plane", "in_space"
TERMS = {IN_PLANE: planar_terms, IN_SPACE: spatial_terms}
NOT_IN_TERMS = {
    "joints.margin": "acts at ends of ranges only, see test_stops.py",
    "joints.limit_solref": "acts at ends of ranges only, see test_stops.py",
    "tendons.margin": "no tendon has a range",
    "options.magnetic": "acts on sensors that no reference has",
    "site_loads.actuator.gear": "is in the force and the moment of the load",
    "site_loads.actuator.law.per_length": "a site has no length",
    "site_loads.actuator.law.per_rate": "a site has no length",
    "site_loads.actuator.armature": "is refused for the actuator",
    "site_loads.actuator.damping": "is refused for the actuator",
    "site_loads.actuator.delay": "is refused for the actuator",
}
NOT_IN_PLANAR_TERMS = NOT_IN_TERMS | {
    "joints.friction": "depends on the sense of motion, see test_friction.py",
    "actuators.armature": "is refused in a run that does not drive the joint",
    "actuators.damping": "is refused in a run that does not drive the joint",
    "actuators.delay": "is refused in a run that does not drive the joint",
    "equalities.scale": "is one of welds, which are refused",
    "tendons.zero": "follows from the zeros of the joints",
}
"""Numbers that change no term here, and why."""


@pytest.mark.parametrize("where", TERMS)
def test_terms_from_the_data_are_those_that_mujoco_computes(where, request):
    """MuJoCo closes loops in three directions, of which that along the normal is left out here."""
    model, states = request.getfixturevalue(where)
    source, found = SmoothTerms(model), TERMS[where](read_compiled(model), states)
    for k, state in enumerate(zip(*states, strict=True)):
        theirs = source.terms(*state)
        rows = [0, 1, 3, 4] if where == IN_PLANE else slice(None)
        known = theirs.mass, theirs.force - theirs.bias, theirs.gap[rows], theirs.jacobian[rows]
        for own, one in zip((part[k] for part in found), known, strict=True):
            np.testing.assert_allclose(own, one, rtol=0, atol=1e-13 * max(1.0, np.abs(one).max()))


@pytest.mark.parametrize("where", TERMS)
def test_every_number_of_the_data_changes_a_term_or_is_refused(where, request):
    """So no solver agrees with MuJoCo if the reading takes a number from the wrong place."""
    model, states = request.getfixturevalue(where)
    data = read_compiled(model)
    terms, seen = TERMS[where](data, states), dict[str, bool]()
    for place, other in misread(data):
        field = re.sub(r"\[.*?\]", "", place)
        if seen.get(field):
            continue
        try:
            changed = TERMS[where](other, states)
        except NotCovered:
            seen[field] = True
        else:
            pairs = zip(terms, changed, strict=True)
            seen[field] = any(np.abs(one - two).max(initial=0.0) > 1e-6 for one, two in pairs)
    assert len(seen) > 50
    exceptions = NOT_IN_PLANAR_TERMS if where == IN_PLANE else NOT_IN_TERMS
    assert {field for field, is_seen in seen.items() if not is_seen} == exceptions.keys()


def test_no_other_file_of_the_references_looks_into_a_compiled_model():
    """`names.py` writes names of elements for engines too."""
    folder = Path(analytic.__file__).parent
    looking = {
        str(file.relative_to(folder))
        for file in folder.rglob("*.py")
        if re.search(r"^(?:import|from) mujoco", file.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert {file for file in looking if not file.startswith("mjcf/")} == {"names.py"}
