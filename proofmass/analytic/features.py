"""Features of a compiled MJCF: what a model may have that may change its motion or its forces.

A feature is found in the plain data of the model (`proofmass.analytic.mjcf`).  Whether a geometry
is covered, such as joints that leave a plane, is no feature: engines and references find that while
they read a model.  What becomes of each feature in a run says `proofmass.analytic.support`.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from proofmass.analytic.mjcf import (
    UNLIMITED,
    ActuatorData,
    ActuatorTarget,
    BodyData,
    EqualityData,
    EqualityKind,
    JointData,
    JointKind,
    ModelData,
    SensorData,
    TendonData,
    TendonWay,
    TieData,
)


@dataclass(frozen=True)
class Scope:
    """The data of a model, and the numbers of its driven joints."""

    data: ModelData
    driven: tuple[int, ...] = ()

    def joints(self, driven: bool | None = None) -> list[JointData]:
        """The joints that are driven, those that are not, or all."""
        every = enumerate(self.data.joints)
        return [joint for j, joint in every if driven is None or (j in self.driven) == driven]

    def actuators(self, driven: bool) -> list[ActuatorData]:
        """The actuators that act on joints that are driven, or those that act elsewhere."""
        return [one for one in self.data.acting if (one.joint in self.driven) == driven]

    def tendons_of(self, tie: TieData) -> list[TendonData]:
        """The tendons of an equality of tendons."""
        return [self.data.tendons[t] for t in (tie.one, tie.two) if t >= 0]

    def is_gear(self, tie: TieData) -> bool:
        """Whether an equality of joints is one of two hinges that turn two bodies alone.

        Both are on the ground, or one is on the ground, of an arm, and one on the arm, of a planet.
        """
        one, two = (self.data.joints[j] for j in (tie.one, tie.two))
        if one.is_hinge_on_ground:
            one, two = two, one
        on_arm = one.kind == JointKind.HINGE and one.carrier == two.body
        return two.is_hinge_on_ground and (one.is_hinge_on_ground or on_arm)


Find = Callable[[Scope], Iterator[str]]


class Named(Protocol):
    """An element of a model."""

    @property
    def name(self) -> str:
        """Its name in the MJCF."""


Element = TypeVar("Element", bound=Named)


def named(kind: str, elements: Iterable[Element], has: Callable[[Element], Any]) -> Iterator[str]:
    """Elements of a kind that have something, such as ``joint 'crank'``."""
    return (f"{kind} {one.name!r}" for one in elements if has(one))


def bodies(has: Callable[[BodyData], Any]) -> Find:
    """Find bodies that have something."""
    return lambda s: named("body", s.data.bodies, has)


def joints(has: Callable[[JointData], Any], driven: bool | None = None) -> Find:
    """Find joints that have something; driven ones, others, or both."""
    return lambda s: named("joint", s.joints(driven), has)


def tendons(has: Callable[[TendonData], Any]) -> Find:
    """Find tendons that have something."""
    return lambda s: named("tendon", s.data.tendons, has)


def sensors(has: Callable[[SensorData], Any]) -> Find:
    """Find sensors that have something."""
    return lambda s: named("sensor", s.data.sensors, has)


def actuators(has: Callable[[ActuatorData], Any], driven: bool = False) -> Find:
    """Find actuators that act and have something: of joints that are not driven, or of driven ones.

    A drive takes the place of the latter.
    """
    return lambda s: named("actuator", s.actuators(driven), has)


def joints_with_force_range(
    acts: Callable[[ActuatorData, JointData], Any], driven: bool | None = None
) -> Find:
    """Find joints with a range of forces for which `acts` is true with an acting actuator."""
    return lambda s: named(
        "joint",
        s.joints(driven),
        lambda joint: joint.has_force_range and any(acts(one, joint) for one in s.data.acting),
    )


def equalities(has: Callable[[EqualityData], Any]) -> Find:
    """Find equalities that have something."""
    return lambda s: (f"{one.kind} equality {one.name!r}" for one in s.data.equalities if has(one))


def ties(kind: EqualityKind, has: Callable[[Scope, TieData], Any]) -> Find:
    """Find equalities of joints, or of tendons, that have something."""
    return lambda s: (
        f"{one.kind} equality {one.name!r}"
        for one in s.data.ties
        if one.kind == kind and has(s, one)
    )


def is_linear_tie(tie: TieData) -> bool:
    """Whether an equality of joints is linear, and not constant."""
    return tie.is_linear and not tie.is_constant


def is_sum_of_joints(s: Scope, tie: TieData) -> bool:
    """Whether the lengths of the tendons of an equality are sums of joints."""
    return all(tendon.way == TendonWay.SUM for tendon in s.tendons_of(tie))


def whole(has: Callable[[ModelData], Any]) -> Find:
    """Find one element without a name if the model as a whole has a feature."""
    return lambda s: iter([""] if has(s.data) else [])


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


ALL_FEATURES = (
    ModelFeature(
        "ball {}",
        "joint",
        joints(lambda j: j.kind == JointKind.BALL),
        '`<joint type="ball">`',
    ),
    ModelFeature(
        "free {}",
        "joint",
        joints(lambda j: j.kind == JointKind.FREE),
        "`<freejoint>`",
    ),
    ModelFeature(
        "stiffness of {}",
        "a joint",
        joints(lambda j: j.stiffness[0]),
        "`stiffness`, `springref`",
    ),
    ModelFeature(
        "polynomial stiffness of {}",
        "a joint",
        joints(lambda j: j.is_scalar and any(j.stiffness[1:])),
        "`stiffness`, three numbers",
    ),
    ModelFeature(
        "polynomial stiffness of {}",
        "a ball or free joint",
        joints(lambda j: not j.is_scalar and any(j.stiffness[1:])),
        "`stiffness`, three numbers",
    ),
    ModelFeature(
        "spring that yields of {}",
        "a joint",
        joints(lambda j: j.spring_yields),
        "`springyield`",
    ),
    ModelFeature("damping of {}", "a joint", joints(lambda j: j.damping[:, 0].any()), "`damping`"),
    ModelFeature(
        "polynomial damping of {}",
        "a joint",
        joints(lambda j: j.damping[:, 1:].any(), False),
        "`damping`, three numbers",
    ),
    ModelFeature(
        "frictionloss of {}",
        "a joint",
        joints(lambda j: j.friction.any(), False),
        "`frictionloss`",
    ),
    ModelFeature(
        "polynomial damping of {}",
        "a driven joint",
        joints(lambda j: j.damping[:, 1:].any(), True),
        "`damping`, three numbers",
    ),
    ModelFeature(
        "frictionloss of {}",
        "a driven joint",
        joints(lambda j: j.friction.any(), True),
        "`frictionloss`",
    ),
    ModelFeature(
        "armature of {}",
        "a hinge on the ground",
        joints(lambda j: j.is_hinge_on_ground and j.armature.any()),
        "`armature`",
    ),
    ModelFeature(
        "armature of {}, which is no single hinge on the ground",
        "a joint",
        joints(lambda j: not j.is_hinge_on_ground and j.armature.any()),
        "`armature`",
    ),
    ModelFeature(
        "range of {}",
        "a joint",
        joints(lambda j: j.is_scalar and j.is_limited, False),
        "`range`",
    ),
    ModelFeature(
        "range of {}",
        "a ball joint",
        joints(lambda j: not j.is_scalar and j.is_limited),
        "`range`",
    ),
    ModelFeature(
        "margin of the range of {}",
        "a joint",
        joints(lambda j: j.is_limited and j.margin, False),
        "`margin`",
    ),
    ModelFeature(
        "actuatorfrcrange of {}",
        "a joint with motors",
        joints_with_force_range(lambda a, j: a.pose == j.pose and not a.has_feedback, False),
        "`actuatorfrcrange`",
    ),
    ModelFeature(
        "actuatorfrcrange of {}",
        "a joint with a servo",
        joints_with_force_range(lambda a, j: a.pose == j.pose and a.has_feedback, False),
        "`actuatorfrcrange`",
    ),
    ModelFeature(
        "actuatorfrcrange of {}",
        "a joint beside actuators that act elsewhere",
        joints_with_force_range(lambda a, j: a.joint < 0),
        "`actuatorfrcrange`",
    ),
    ModelFeature(
        "actuatorfrcrange of {}",
        "a driven joint",
        joints(lambda j: j.has_force_range, True),
        "`actuatorfrcrange`",
    ),
    ModelFeature(
        "gravcomp of {}",
        "a body",
        bodies(lambda b: b.weight_share * b.mass),
        "`gravcomp`, with or without `actuatorgravcomp`",
    ),
    ModelFeature(
        "mocap {}",
        "body",
        bodies(lambda b: b.is_mocap),
        "`mocap`, `mpos` of a key",
    ),
    ModelFeature(
        "density or viscosity of the options",
        "",
        whole(lambda data: data.options.density or data.options.viscosity),
        "`density`, `viscosity`, `wind`, `fluidshape`",
    ),
    ModelFeature("flex", "", whole(lambda data: data.flexes), "`<flex>`, `<flexcomp>`"),
    ModelFeature("plugin", "", whole(lambda data: data.plugins), "`<plugin>`"),
    ModelFeature(
        "{}",
        "connect equality",
        equalities(lambda e: e.kind == EqualityKind.CONNECT),
        "`<connect>`",
    ),
    ModelFeature(
        "{}",
        "weld equality",
        equalities(lambda e: e.kind == EqualityKind.WELD),
        "`<weld>`",
    ),
    ModelFeature(
        "{}, of hinges on the ground or of a planet and its arm",
        "joint equality",
        ties(EqualityKind.JOINT, lambda s, e: is_linear_tie(e) and s.is_gear(e)),
        "`<equality><joint>`",
    ),
    ModelFeature(
        "{}, whose joints are no such hinges",
        "joint equality",
        ties(EqualityKind.JOINT, lambda s, e: is_linear_tie(e) and not s.is_gear(e)),
        "`<equality><joint>`",
    ),
    ModelFeature(
        "{}, whose polycoef is not linear",
        "joint equality",
        ties(EqualityKind.JOINT, lambda s, e: not (e.is_constant or e.is_linear)),
        "`<equality><joint>`",
    ),
    ModelFeature(
        "{}, which locks a joint",
        "joint equality",
        ties(EqualityKind.JOINT, lambda s, e: e.is_constant),
        "`<equality><joint>`",
    ),
    ModelFeature(
        "{}, of sums of joints",
        "tendon equality",
        ties(EqualityKind.TENDON, lambda s, e: is_sum_of_joints(s, e)),
        "`<equality><tendon>`",
    ),
    ModelFeature(
        "{}, of ways in space",
        "tendon equality",
        ties(EqualityKind.TENDON, lambda s, e: not is_sum_of_joints(s, e)),
        "`<equality><tendon>`",
    ),
    ModelFeature(
        "{}",
        "equality of a flex",
        equalities(lambda e: not e.is_rigid),
        "`<equality><flex>`, `<flexvert>`, `<flexstrain>`",
    ),
    ModelFeature(
        "{}, which is a sum of joints",
        "a tendon",
        tendons(lambda t: t.way == TendonWay.SUM),
        "`<fixed>`",
    ),
    ModelFeature(
        "{}, which goes by several sites",
        "a tendon",
        tendons(lambda t: t.way == TendonWay.BY_SITES),
        "`<spatial>`",
    ),
    ModelFeature(
        "{}, which goes around a geom or a pulley",
        "a tendon",
        tendons(lambda t: t.way == TendonWay.WRAPPED),
        "`<spatial>`, `<pulley>`",
    ),
    ModelFeature(
        "stiffness of {}",
        "a tendon",
        tendons(lambda t: t.stiffness[0]),
        "`stiffness`, `springlength`",
    ),
    ModelFeature(
        "polynomial stiffness of {}",
        "a tendon",
        tendons(lambda t: any(t.stiffness[1:])),
        "`stiffness`, three numbers",
    ),
    ModelFeature("damping of {}", "a tendon", tendons(lambda t: t.damping[0]), "`damping`"),
    ModelFeature(
        "polynomial damping of {}",
        "a tendon",
        tendons(lambda t: any(t.damping[1:])),
        "`damping`, three numbers",
    ),
    ModelFeature(
        "frictionloss of {}",
        "a tendon",
        tendons(lambda t: t.friction),
        "`frictionloss`",
    ),
    ModelFeature("range of {}", "a tendon", tendons(lambda t: t.is_limited), "`range`"),
    ModelFeature("armature of {}", "a tendon", tendons(lambda t: t.armature), "`armature`"),
    ModelFeature(
        "spring that yields of {}",
        "a tendon",
        tendons(lambda t: t.spring_yields),
        "`springyield`",
    ),
    ModelFeature(
        "actuatorfrcrange of {}",
        "a tendon",
        tendons(lambda t: t.has_force_range),
        "`actuatorfrcrange`",
    ),
    ModelFeature(
        "margin of the range of {}",
        "a tendon",
        tendons(lambda t: t.is_limited and t.margin),
        "`margin`",
    ),
    ModelFeature(
        "{}, which is a motor on a joint",
        "an actuator",
        actuators(lambda a: a.target == ActuatorTarget.SCALAR_JOINT and not a.has_feedback),
        "`<motor>`, `<general>`, `gear`",
    ),
    ModelFeature(
        "{}, which is a servo on a joint",
        "an actuator",
        actuators(lambda a: a.target == ActuatorTarget.SCALAR_JOINT and a.has_feedback),
        "`<position>`, `<velocity>`, `<general>`",
    ),
    ModelFeature(
        "{}, which is a motor on a site whose refsite, if any, is of the ground",
        "an actuator",
        actuators(lambda a: a.target == ActuatorTarget.SITE and not a.has_feedback),
        "`site`, `refsite`",
    ),
    ModelFeature(
        "{}, which is a servo on such a site",
        "an actuator",
        actuators(lambda a: a.target == ActuatorTarget.SITE and a.has_feedback),
        "`site`, `refsite`",
    ),
    ModelFeature(
        "{}, which acts on a tendon",
        "an actuator",
        actuators(lambda a: a.target == ActuatorTarget.TENDON),
        "`tendon`",
    ),
    ModelFeature(
        "{}, which acts on a ball or a free joint",
        "an actuator",
        actuators(lambda a: a.target == ActuatorTarget.TURNING_JOINT),
        "`joint`",
    ),
    ModelFeature(
        "{}, which acts at a site whose refsite moves, on a crank or on a body",
        "an actuator",
        actuators(lambda a: a.target == ActuatorTarget.OTHER),
        "`refsite`, `cranksite`, `<adhesion>`",
    ),
    ModelFeature(
        "activation of {}",
        "an actuator",
        actuators(lambda a: a.has_state),
        "`dyntype`, `<muscle>`, `<cylinder>`, `<intvelocity>`, `<dcmotor>`, `act` of a key",
    ),
    ModelFeature(
        "gain or bias that is not affine of {}",
        "an actuator",
        actuators(lambda a: a.law is None and not a.has_state),
        "`gaintype`, `biastype`, `<damper>`",
    ),
    ModelFeature(
        "ctrlrange of {}",
        "an actuator",
        actuators(lambda a: a.controls != UNLIMITED),
        "`ctrlrange`",
    ),
    ModelFeature(
        "forcerange of {}",
        "a motor",
        actuators(lambda a: a.is_limited and not a.has_feedback),
        "`forcerange`",
    ),
    ModelFeature(
        "forcerange of {}",
        "a servo",
        actuators(lambda a: a.is_limited and a.has_feedback),
        "`forcerange`",
    ),
    ModelFeature("delay of {}", "an actuator", actuators(lambda a: a.delay), "`delay`"),
    ModelFeature("armature of {}", "an actuator", actuators(lambda a: a.armature), "`armature`"),
    ModelFeature(
        "armature of {}",
        "an actuator on a driven joint",
        actuators(lambda a: a.armature, driven=True),
        "`armature`",
    ),
    ModelFeature("damping of {}", "an actuator", actuators(lambda a: a.damping[0]), "`damping`"),
    ModelFeature(
        "damping of {}",
        "an actuator on a driven joint",
        actuators(lambda a: a.damping[0], driven=True),
        "`damping`",
    ),
    ModelFeature(
        "polynomial damping of {}",
        "an actuator",
        actuators(lambda a: any(a.damping[1:])),
        "`damping`, three numbers",
    ),
    ModelFeature(
        "polynomial damping of {}",
        "an actuator on a driven joint",
        actuators(lambda a: any(a.damping[1:]), driven=True),
        "`damping`, three numbers",
    ),
    ModelFeature(
        "force of {}",
        "an actuator on a driven joint",
        actuators(lambda a: True, driven=True),
        "`ctrl`, `act`, `forcerange` and all else of its force",
    ),
    ModelFeature("contacts", "", whole(lambda data: data.may_touch), "`<geom>`, `<pair>`"),
    ModelFeature(
        "rates of the key",
        "",
        whole(lambda data: any(key.rates.any() for key in data.keys)),
        "`qvel` of a key",
    ),
    ModelFeature(
        "time of the key",
        "",
        whole(lambda data: any(key.time for key in data.keys)),
        "`time` of a key",
    ),
    ModelFeature(
        "integrator or solver of the options",
        "",
        whole(lambda data: True),
        "`integrator`, `solver`, ...",
    ),
    ModelFeature(
        "discrete inverse dynamics",
        "",
        whole(lambda data: data.options.inverse_of_steps),
        '`<flag invdiscrete="enable">`',
    ),
    ModelFeature(
        "sleep of bodies at rest",
        "",
        whole(lambda data: data.options.sleep),
        '`<flag sleep="enable">`',
    ),
    ModelFeature(
        "magnetic field", "", whole(lambda data: data.options.magnetic.any()), "`magnetic`"
    ),
    ModelFeature("cutoff of {}", "a sensor", sensors(lambda s: s.cutoff), "`cutoff`"),
    ModelFeature("delay of {}", "a sensor", sensors(lambda s: s.delay), "`delay`"),
    ModelFeature("interval of {}", "a sensor", sensors(lambda s: any(s.interval)), "`interval`"),
    ModelFeature("noise of {}", "a sensor", sensors(lambda s: s.noise), "`noise`"),
)
FEATURES: Mapping[str, ModelFeature] = {feature.name: feature for feature in ALL_FEATURES}
"""All features by name, in the order of the table."""
