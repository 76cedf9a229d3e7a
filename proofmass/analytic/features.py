"""Features of a compiled MJCF: what a model may have that may change its motion or its forces.

A feature is found by the fields of the compiled model that hold it.  Whether a geometry is covered,
such as joints that leave a plane, is no feature: engines and references find that while they read a
model.  What becomes of each feature in a run says `proofmass.analytic.support`.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from proofmass.analytic.names import equality_name
from proofmass.base.arrays import Array

DISABLE, ENABLE = mujoco.mjtDisableBit, mujoco.mjtEnableBit
JOINT, EQUALITY, TRANSMISSION = mujoco.mjtJoint, mujoco.mjtEq, mujoco.mjtTrn
SPRING, DAMPER = (DISABLE.mjDSBL_SPRING,), (DISABLE.mjDSBL_DAMPER,)
FRICTION = DISABLE.mjDSBL_FRICTIONLOSS, DISABLE.mjDSBL_CONSTRAINT
LIMIT = DISABLE.mjDSBL_LIMIT, DISABLE.mjDSBL_CONSTRAINT
"""Flags that disable springs, dampers, dry friction, and ranges of joints and tendons."""


@dataclass(frozen=True)
class Scope:
    """A compiled model, and the numbers of its driven joints."""

    model: Any
    driven: tuple[int, ...] = ()

    def off(self, *flags: int) -> bool:
        """Whether the model sets one of some disable flags."""
        return any(self.model.opt.disableflags & int(flag) for flag in flags)

    def is_scalar(self, j: int) -> bool:
        """Whether joint number j is a hinge or a slide."""
        return JOINT(int(self.model.jnt_type[j])) in (JOINT.mjJNT_HINGE, JOINT.mjJNT_SLIDE)

    def is_hinge_on_ground(self, j: int) -> bool:
        """Whether joint number j is the only one of its body, a hinge on the ground."""
        model, body = self.model, int(self.model.jnt_bodyid[j])
        return bool(
            model.jnt_type[j] == JOINT.mjJNT_HINGE
            and model.body_weldid[model.body_parentid[body]] == 0
            and model.body_jntnum[body] == 1
        )

    def dofs(self, j: int) -> slice:
        """Indices of joint number j in the rates."""
        kind, first = JOINT(int(self.model.jnt_type[j])), int(self.model.jnt_dofadr[j])
        return slice(first, first + {JOINT.mjJNT_FREE: 6, JOINT.mjJNT_BALL: 3}.get(kind, 1))

    def acting(self) -> list[int]:
        """Numbers of the actuators that are not disabled."""
        model = self.model
        off = self.off(DISABLE.mjDSBL_ACTUATION)
        groups = model.actuator_group.tolist()
        return [a for a, g in enumerate(groups) if not (off or model.opt.disableactuator >> g & 1)]

    def joint_of(self, a: int) -> int:
        """The joint that actuator number a acts on, or -1."""
        on_joint = (TRANSMISSION.mjTRN_JOINT, TRANSMISSION.mjTRN_JOINTINPARENT)
        found = int(self.model.actuator_trntype[a]) in on_joint
        return int(self.model.actuator_trnid[a, 0]) if found else -1

    def place(self, a: int) -> str:
        """What actuator number a acts on."""
        model, (what, frame) = self.model, self.model.actuator_trnid[a].tolist()
        kind = TRANSMISSION(int(model.actuator_trntype[a]))
        if self.joint_of(a) >= 0:
            return "hinge or slide" if self.is_scalar(what) else "ball or free joint"
        on_ground = frame < 0 or model.body_weldid[model.site_bodyid[frame]] == 0
        if kind == TRANSMISSION.mjTRN_SITE and on_ground:
            return "site"
        return "tendon" if kind == TRANSMISSION.mjTRN_TENDON else "else"

    def has_state(self, a: int) -> bool:
        """Whether actuator number a has an activation."""
        model = self.model
        dynamic = model.actuator_dyntype[a] != mujoco.mjtDyn.mjDYN_NONE
        return bool(dynamic or model.actuator_actnum[a])

    def follows(self, a: int) -> bool:
        """Whether the force of actuator number a depends on its length or rate: a servo."""
        return bool(self.model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_AFFINE)

    def is_bent(self, a: int) -> bool:
        """Whether the force of actuator number a is not linear in control, length and rate."""
        fixed = self.model.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED
        none = self.model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE
        return not (fixed and (none or self.follows(a)))

    def way(self, t: int) -> str:
        """The way of tendon number t: a sum of joints, straight, by sites, or wrapped."""
        model, first = self.model, int(self.model.tendon_adr[t])
        kinds = model.wrap_type[first : first + int(model.tendon_num[t])]
        if (kinds == mujoco.mjtWrap.mjWRAP_JOINT).all():
            return "sum"
        if (kinds == mujoco.mjtWrap.mjWRAP_SITE).all():
            return "straight" if kinds.size == 2 else "by sites"
        return "wrapped"

    def tie(self, e: int) -> str:
        """The kind of equality number e of joints or tendons; empty for another."""
        model = self.model
        one, two, data = int(model.eq_obj1id[e]), int(model.eq_obj2id[e]), model.eq_data[e]
        if model.eq_type[e] == EQUALITY.mjEQ_TENDON:
            return "sums" if {self.way(t) for t in (one, two) if t >= 0} == {"sum"} else "ways"
        if model.eq_type[e] != EQUALITY.mjEQ_JOINT:
            return ""
        if two < 0 or not data[1:5].any():
            return "lock"
        if data[2:5].any():
            return "polynomial"
        return "gear" if self.is_hinge_on_ground(one) and self.is_hinge_on_ground(two) else "linear"


Find = Callable[[Scope], Iterator[str]]
Has = Callable[[Scope, int], Any]


def named(model: Any, kind: str, numbers: Iterable[int]) -> Iterator[str]:
    """Elements of a kind, such as ``joint 'crank'``."""
    return (f"{kind} {getattr(model, kind)(k).name!r}" for k in numbers)


def elements(kind: str, count: str, has: Has) -> Find:
    """Find the elements of a kind for whose numbers `has` is true; `count` is a field."""
    return lambda s: named(
        s.model, kind, [k for k in range(getattr(s.model, count)) if np.any(has(s, k))]
    )


def joints(has: Has, driven: bool | None = None) -> Find:
    """Find joints for whose numbers `has` is true; driven ones, others, or both."""
    return elements(
        "joint",
        "njnt",
        lambda s, j: (driven is None or (j in s.driven) == driven) and np.any(has(s, j)),
    )


def tendons(has: Has) -> Find:
    """Find tendons for whose numbers `has` is true."""
    return elements("tendon", "ntendon", has)


def sensors(field_name: str) -> Find:
    """Find sensors for which a field is not zero."""
    return elements("sensor", "nsensor", field(field_name))


def actuators(has: Has, driven: bool = False) -> Find:
    """Find actuators that act: those of joints that are not driven, or of driven ones.

    A drive takes the place of the latter.
    """
    return lambda s: named(
        s.model,
        "actuator",
        [a for a in s.acting() if (s.joint_of(a) in s.driven) == driven and np.any(has(s, a))],
    )


def equalities(has: Has) -> Find:
    """Find active equalities for whose numbers `has` is true."""

    def find(s: Scope) -> Iterator[str]:
        if not s.off(DISABLE.mjDSBL_EQUALITY, DISABLE.mjDSBL_CONSTRAINT):
            for e in np.flatnonzero(s.model.eq_active0).tolist():
                if has(s, e):
                    kind = EQUALITY(int(s.model.eq_type[e])).name[5:].lower()
                    yield f"{kind} equality {equality_name(s.model, e)!r}"

    return find


def whole(has: Callable[[Any], Any]) -> Find:
    """Find one element without a name if the model as a whole has a feature."""
    return lambda s: iter([""] if np.any(has(s.model)) else [])


def field(name: str, *flags: int) -> Has:
    """Whether a field of an element is not zero, and none of the flags disables it."""
    return lambda s, k: not s.off(*flags) and getattr(s.model, name)[k]


def dof_field(name: str, *flags: int) -> Has:
    """Whether a field of the rates of a joint is not zero, and none of the flags disables it."""
    return lambda s, j: not s.off(*flags) and getattr(s.model, name)[s.dofs(j)]


def only(kind: Has, has: Has) -> Has:
    """Whether an element is of a kind and has something."""
    return lambda s, k: kind(s, k) and np.any(has(s, k))


def scalar(s: Scope, j: int) -> bool:
    """Whether joint number j is a hinge or a slide."""
    return s.is_scalar(j)


def turning(s: Scope, j: int) -> bool:
    """Whether joint number j is a ball or a free joint."""
    return not s.is_scalar(j)


def with_actuator(has: Has) -> Has:
    """Whether a joint has a range of forces and an acting actuator that has something."""
    return lambda s, j: s.model.jnt_actfrclimited[j] and any(has(s, a) for a in s.acting())


@dataclass(frozen=True)
class ModelFeature:
    """Something that a model may have.

    Attributes
    ----------
    what : str
        The feature, with a place for the element that has it: ``armature of {}``.
    of : str
        The kind of element, as in the table: ``a tendon``; empty for the model as a whole.
    find : callable
        The elements of a `Scope` that have it, by kind and name; one empty name for the model.
    mjcf : str
        How MJCF states it.
    """

    what: str
    of: str
    find: Find
    mjcf: str

    @property
    def name(self) -> str:
        """The feature without an element, which is also its key in a support.

        >>> ModelFeature("armature of {}", "a tendon", iter, "").name
        'armature of a tendon'
        """
        return self.what.format(self.of)


def may_touch(model: Any) -> bool:
    """Whether MuJoCo looks for contacts: of geoms, of a pair, or of a flex."""
    off = model.opt.disableflags & int(DISABLE.mjDSBL_CONTACT | DISABLE.mjDSBL_CONSTRAINT)
    return not off and bool(touching_bodies(model).size or model.npair)


def touching_bodies(model: Any) -> Array:
    """The bodies (n, 2) of all pairs of geoms between which MuJoCo looks for contacts.

    Left out are the pairs that it filters out: by ``contype`` and ``conaffinity``, of one rigid
    group, of a group and its parent other than the ground, and of ``<exclude>``.
    """
    rigid = model.body_weldid
    parent = rigid[model.body_parentid[rigid]]
    matches = model.geom_contype[:, None] & model.geom_conaffinity != 0
    pairs = model.geom_bodyid[np.argwhere(np.triu(matches | matches.T, 1))]
    first, second = np.sort(pairs, axis=1).T
    one, two = rigid[first], rigid[second]
    filtered = (one == two) | np.isin((first << 16) + second, model.exclude_signature)
    if not model.opt.disableflags & int(DISABLE.mjDSBL_FILTERPARENT):
        filtered |= (one > 0) & (two > 0) & ((one == parent[two]) | (two == parent[one]))
    return np.stack([first, second], axis=1)[~filtered]


RIGID_EQUALITIES = (
    EQUALITY.mjEQ_CONNECT,
    EQUALITY.mjEQ_WELD,
    EQUALITY.mjEQ_JOINT,
    EQUALITY.mjEQ_TENDON,
)
ALL_FEATURES = (
    ModelFeature(
        "ball {}",
        "joint",
        joints(lambda s, j: s.model.jnt_type[j] == JOINT.mjJNT_BALL),
        '`<joint type="ball">`',
    ),
    ModelFeature(
        "free {}",
        "joint",
        joints(lambda s, j: s.model.jnt_type[j] == JOINT.mjJNT_FREE),
        "`<freejoint>`",
    ),
    ModelFeature(
        "stiffness of {}",
        "a joint",
        joints(field("jnt_stiffness", *SPRING)),
        "`stiffness`, `springref`",
    ),
    ModelFeature(
        "polynomial stiffness of {}",
        "a joint",
        joints(only(scalar, field("jnt_stiffnesspoly", *SPRING))),
        "`stiffness`, three numbers",
    ),
    ModelFeature(
        "polynomial stiffness of {}",
        "a ball or free joint",
        joints(only(turning, field("jnt_stiffnesspoly", *SPRING))),
        "`stiffness`, three numbers",
    ),
    ModelFeature(
        "spring that yields of {}",
        "a joint",
        joints(field("jnt_springyield", *SPRING)),
        "`springyield`",
    ),
    ModelFeature(
        "damping of {}", "a joint", joints(dof_field("dof_damping", *DAMPER)), "`damping`"
    ),
    ModelFeature(
        "polynomial damping of {}",
        "a joint",
        joints(dof_field("dof_dampingpoly", *DAMPER), False),
        "`damping`, three numbers",
    ),
    ModelFeature(
        "frictionloss of {}",
        "a joint",
        joints(dof_field("dof_frictionloss", *FRICTION), False),
        "`frictionloss`",
    ),
    ModelFeature(
        "polynomial damping of {}",
        "a driven joint",
        joints(dof_field("dof_dampingpoly", *DAMPER), True),
        "`damping`, three numbers",
    ),
    ModelFeature(
        "frictionloss of {}",
        "a driven joint",
        joints(dof_field("dof_frictionloss", *FRICTION), True),
        "`frictionloss`",
    ),
    ModelFeature(
        "armature of {}",
        "a hinge on the ground",
        joints(only(Scope.is_hinge_on_ground, dof_field("dof_armature"))),
        "`armature`",
    ),
    ModelFeature(
        "armature of {}, which is no single hinge on the ground",
        "a joint",
        joints(lambda s, j: not s.is_hinge_on_ground(j) and s.model.dof_armature[s.dofs(j)]),
        "`armature`",
    ),
    ModelFeature(
        "range of {}",
        "a joint",
        joints(only(scalar, field("jnt_limited", *LIMIT)), False),
        "`range`",
    ),
    ModelFeature(
        "range of {}",
        "a ball joint",
        joints(only(turning, field("jnt_limited", *LIMIT))),
        "`range`",
    ),
    ModelFeature(
        "margin of the range of {}",
        "a joint",
        joints(only(field("jnt_limited", *LIMIT), field("jnt_margin")), False),
        "`margin`",
    ),
    ModelFeature(
        "actuatorfrcrange of {}",
        "a joint with motors",
        joints(
            lambda s, j: with_actuator(lambda s, a: s.joint_of(a) == j and not s.follows(a))(s, j),
            False,
        ),
        "`actuatorfrcrange`",
    ),
    ModelFeature(
        "actuatorfrcrange of {}",
        "a joint with a servo",
        joints(
            lambda s, j: with_actuator(lambda s, a: s.joint_of(a) == j and s.follows(a))(s, j),
            False,
        ),
        "`actuatorfrcrange`",
    ),
    ModelFeature(
        "actuatorfrcrange of {}",
        "a joint beside actuators that act elsewhere",
        joints(with_actuator(lambda s, a: s.joint_of(a) < 0)),
        "`actuatorfrcrange`",
    ),
    ModelFeature(
        "actuatorfrcrange of {}",
        "a driven joint",
        joints(field("jnt_actfrclimited"), True),
        "`actuatorfrcrange`",
    ),
    ModelFeature(
        "gravcomp of {}",
        "a body",
        elements("body", "nbody", lambda s, b: s.model.body_gravcomp[b] * s.model.body_mass[b]),
        "`gravcomp`, with or without `actuatorgravcomp`",
    ),
    ModelFeature(
        "mocap {}",
        "body",
        elements("body", "nbody", lambda s, b: s.model.body_mocapid[b] >= 0),
        "`mocap`, `mpos` of a key",
    ),
    ModelFeature(
        "density or viscosity of the options",
        "",
        whole(lambda model: model.opt.density or model.opt.viscosity),
        "`density`, `viscosity`, `wind`, `fluidshape`",
    ),
    ModelFeature("flex", "", whole(lambda model: model.nflex), "`<flex>`, `<flexcomp>`"),
    ModelFeature("plugin", "", whole(lambda model: model.nplugin), "`<plugin>`"),
    ModelFeature(
        "{}",
        "connect equality",
        equalities(lambda s, e: s.model.eq_type[e] == EQUALITY.mjEQ_CONNECT),
        "`<connect>`",
    ),
    ModelFeature(
        "{}",
        "weld equality",
        equalities(lambda s, e: s.model.eq_type[e] == EQUALITY.mjEQ_WELD),
        "`<weld>`",
    ),
    ModelFeature(
        "{}, of two hinges on the ground",
        "joint equality",
        equalities(lambda s, e: s.tie(e) == "gear"),
        "`<equality><joint>`",
    ),
    ModelFeature(
        "{}, whose joints are not both hinges on the ground",
        "joint equality",
        equalities(lambda s, e: s.tie(e) == "linear"),
        "`<equality><joint>`",
    ),
    ModelFeature(
        "{}, whose polycoef is not linear",
        "joint equality",
        equalities(lambda s, e: s.tie(e) == "polynomial"),
        "`<equality><joint>`",
    ),
    ModelFeature(
        "{}, which locks a joint",
        "joint equality",
        equalities(lambda s, e: s.tie(e) == "lock"),
        "`<equality><joint>`",
    ),
    ModelFeature(
        "{}, of sums of joints",
        "tendon equality",
        equalities(lambda s, e: s.tie(e) == "sums"),
        "`<equality><tendon>`",
    ),
    ModelFeature(
        "{}, of ways in space",
        "tendon equality",
        equalities(lambda s, e: s.tie(e) == "ways"),
        "`<equality><tendon>`",
    ),
    ModelFeature(
        "{}",
        "equality of a flex",
        equalities(lambda s, e: EQUALITY(int(s.model.eq_type[e])) not in RIGID_EQUALITIES),
        "`<equality><flex>`, `<flexvert>`, `<flexstrain>`",
    ),
    ModelFeature(
        "{}, which is a sum of joints",
        "a tendon",
        tendons(lambda s, t: s.way(t) == "sum"),
        "`<fixed>`",
    ),
    ModelFeature(
        "{}, which goes by several sites",
        "a tendon",
        tendons(lambda s, t: s.way(t) == "by sites"),
        "`<spatial>`",
    ),
    ModelFeature(
        "{}, which goes around a geom or a pulley",
        "a tendon",
        tendons(lambda s, t: s.way(t) == "wrapped"),
        "`<spatial>`, `<pulley>`",
    ),
    ModelFeature(
        "stiffness of {}",
        "a tendon",
        tendons(field("tendon_stiffness", *SPRING)),
        "`stiffness`, `springlength`",
    ),
    ModelFeature(
        "polynomial stiffness of {}",
        "a tendon",
        tendons(field("tendon_stiffnesspoly", *SPRING)),
        "`stiffness`, three numbers",
    ),
    ModelFeature(
        "damping of {}", "a tendon", tendons(field("tendon_damping", *DAMPER)), "`damping`"
    ),
    ModelFeature(
        "polynomial damping of {}",
        "a tendon",
        tendons(field("tendon_dampingpoly", *DAMPER)),
        "`damping`, three numbers",
    ),
    ModelFeature(
        "frictionloss of {}",
        "a tendon",
        tendons(field("tendon_frictionloss", *FRICTION)),
        "`frictionloss`",
    ),
    ModelFeature("range of {}", "a tendon", tendons(field("tendon_limited", *LIMIT)), "`range`"),
    ModelFeature("armature of {}", "a tendon", tendons(field("tendon_armature")), "`armature`"),
    ModelFeature(
        "spring that yields of {}",
        "a tendon",
        tendons(field("tendon_springyield", *SPRING)),
        "`springyield`",
    ),
    ModelFeature(
        "actuatorfrcrange of {}",
        "a tendon",
        tendons(field("tendon_actfrclimited")),
        "`actuatorfrcrange`",
    ),
    ModelFeature(
        "margin of the range of {}",
        "a tendon",
        tendons(only(field("tendon_limited", *LIMIT), field("tendon_margin"))),
        "`margin`",
    ),
    ModelFeature(
        "{}, which is a motor on a joint",
        "an actuator",
        actuators(lambda s, a: s.place(a) == "hinge or slide" and not s.follows(a)),
        "`<motor>`, `<general>`, `gear`",
    ),
    ModelFeature(
        "{}, which is a servo on a joint",
        "an actuator",
        actuators(lambda s, a: s.place(a) == "hinge or slide" and s.follows(a)),
        "`<position>`, `<velocity>`, `<general>`",
    ),
    ModelFeature(
        "{}, which is a motor on a site whose refsite, if any, is of the ground",
        "an actuator",
        actuators(lambda s, a: s.place(a) == "site" and not s.follows(a)),
        "`site`, `refsite`",
    ),
    ModelFeature(
        "{}, which is a servo on such a site",
        "an actuator",
        actuators(lambda s, a: s.place(a) == "site" and s.follows(a)),
        "`site`, `refsite`",
    ),
    ModelFeature(
        "{}, which acts on a tendon",
        "an actuator",
        actuators(lambda s, a: s.place(a) == "tendon"),
        "`tendon`",
    ),
    ModelFeature(
        "{}, which acts on a ball or a free joint",
        "an actuator",
        actuators(lambda s, a: s.place(a) == "ball or free joint"),
        "`joint`",
    ),
    ModelFeature(
        "{}, which acts at a site whose refsite moves, on a crank or on a body",
        "an actuator",
        actuators(lambda s, a: s.place(a) == "else"),
        "`refsite`, `cranksite`, `<adhesion>`",
    ),
    ModelFeature(
        "activation of {}",
        "an actuator",
        actuators(Scope.has_state),
        "`dyntype`, `<muscle>`, `<cylinder>`, `<intvelocity>`, `<dcmotor>`, `act` of a key",
    ),
    ModelFeature(
        "gain or bias that is not affine of {}",
        "an actuator",
        actuators(lambda s, a: s.is_bent(a) and not s.has_state(a)),
        "`gaintype`, `biastype`, `<damper>`",
    ),
    ModelFeature(
        "ctrlrange of {}",
        "an actuator",
        actuators(field("actuator_ctrllimited", DISABLE.mjDSBL_CLAMPCTRL)),
        "`ctrlrange`",
    ),
    ModelFeature(
        "forcerange of {}",
        "a motor",
        actuators(lambda s, a: s.model.actuator_forcelimited[a] and not s.follows(a)),
        "`forcerange`",
    ),
    ModelFeature(
        "forcerange of {}",
        "a servo",
        actuators(lambda s, a: s.model.actuator_forcelimited[a] and s.follows(a)),
        "`forcerange`",
    ),
    ModelFeature("delay of {}", "an actuator", actuators(field("actuator_delay")), "`delay`"),
    ModelFeature(
        "armature of {}", "an actuator", actuators(field("actuator_armature")), "`armature`"
    ),
    ModelFeature(
        "armature of {}",
        "an actuator on a driven joint",
        actuators(field("actuator_armature"), driven=True),
        "`armature`",
    ),
    ModelFeature("damping of {}", "an actuator", actuators(field("actuator_damping")), "`damping`"),
    ModelFeature(
        "damping of {}",
        "an actuator on a driven joint",
        actuators(field("actuator_damping"), driven=True),
        "`damping`",
    ),
    ModelFeature(
        "polynomial damping of {}",
        "an actuator",
        actuators(field("actuator_dampingpoly")),
        "`damping`, three numbers",
    ),
    ModelFeature(
        "polynomial damping of {}",
        "an actuator on a driven joint",
        actuators(field("actuator_dampingpoly"), driven=True),
        "`damping`, three numbers",
    ),
    ModelFeature(
        "force of {}",
        "an actuator on a driven joint",
        actuators(lambda s, a: True, driven=True),
        "`ctrl`, `act`, `forcerange` and all else of its force",
    ),
    ModelFeature("contacts", "", whole(may_touch), "`<geom>`, `<pair>`"),
    ModelFeature("rates of the key", "", whole(lambda model: model.key_qvel), "`qvel` of a key"),
    ModelFeature("time of the key", "", whole(lambda model: model.key_time), "`time` of a key"),
    ModelFeature(
        "integrator or solver of the options",
        "",
        whole(lambda model: True),
        "`integrator`, `solver`, ...",
    ),
    ModelFeature(
        "discrete inverse dynamics",
        "",
        whole(lambda model: model.opt.enableflags & int(ENABLE.mjENBL_INVDISCRETE)),
        '`<flag invdiscrete="enable">`',
    ),
    ModelFeature(
        "sleep of bodies at rest",
        "",
        whole(lambda model: model.opt.enableflags & int(ENABLE.mjENBL_SLEEP)),
        '`<flag sleep="enable">`',
    ),
    ModelFeature("magnetic field", "", whole(lambda model: model.opt.magnetic), "`magnetic`"),
    ModelFeature("cutoff of {}", "a sensor", sensors("sensor_cutoff"), "`cutoff`"),
    ModelFeature("delay of {}", "a sensor", sensors("sensor_delay"), "`delay`"),
    ModelFeature("interval of {}", "a sensor", sensors("sensor_interval"), "`interval`"),
    ModelFeature("noise of {}", "a sensor", sensors("sensor_noise"), "`noise`"),
)
FEATURES: Mapping[str, ModelFeature] = {feature.name: feature for feature in ALL_FEATURES}
"""All features by name, in the order of the table."""
