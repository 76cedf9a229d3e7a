"""The data of a planar mechanism: links, joints, loops, gears, springs and loads."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from proofmass.base.arrays import Array
from proofmass.sim.interpreter.mechanism import (
    NeutralSpring,
    cubic_energy,
    cubic_force,
)
from proofmass.sim.neutral import ModelReader
from proofmass.sim.plane import MotionPlane
from proofmass.sim.pymunk.contacts import Contacts

STOP_MARGIN = 1e-13
"""Distance [rad or m] of a stop before the limit of its joint.  Chipmunk's stops act only on joints
that are beyond them: a joint that is put back exactly to its stop is free and falls in again.  So a
joint is put back to this distance beyond its stop, which is on the limit."""
QUARTER_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""Matrix that rotates row vectors counter-clockwise by a quarter turn."""


@dataclass(frozen=True)
class LinkConstraint:
    """A constraint of two links: a pin, or with an axis a slide without relative rotation.

    ``a`` and ``b`` are the numbers of the links.  The anchors ``on_a`` and ``on_b`` are given
    relative to the links' centres in the start pose [m]; ``axis`` is the slide's direction on
    link a.
    """

    name: str
    a: int
    b: int
    on_a: Array
    on_b: Array
    axis: Array | None = None


@dataclass(frozen=True)
class ConstraintTable:
    """Constraints as arrays with one row for each `LinkConstraint`; the axis of a pin is zero."""

    a: NDArray[np.intp]
    b: NDArray[np.intp]
    on_a: Array
    on_b: Array
    axis: Array

    @cached_property
    def slides(self) -> NDArray[np.bool_]:
        """Which constraints are slides, (holds,)."""
        return np.asarray(self.axis.any(axis=1))

    @cached_property
    def has_slides(self) -> bool:
        """Whether any constraint is a slide."""
        return bool(self.slides.any())

    @cached_property
    def guides(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], Array]:
        """Indices of the slides, their links a and b, and a vector across each axis (n, 2)."""
        slides = np.flatnonzero(self.slides)
        return slides, self.a[slides], self.b[slides], self.axis[slides] @ QUARTER_TURN

    @cached_property
    def ends(self) -> NDArray[np.intp]:
        """The links b (holds,) of all constraints, then their links a."""
        return np.concatenate([self.b, self.a])

    @cached_property
    def on_ends(self) -> Array:
        """The anchors (2 holds, 2) on the links `ends` [m]."""
        return np.concatenate([self.on_b, self.on_a])


def constraint_columns(constraints: Sequence[LinkConstraint]) -> dict[str, Any]:
    """The fields of the `ConstraintTable` of some constraints."""
    axes = [np.zeros(2) if hold.axis is None else hold.axis for hold in constraints]
    return {
        "a": np.array([hold.a for hold in constraints], np.intp),
        "b": np.array([hold.b for hold in constraints], np.intp),
        "on_a": np.array([hold.on_a for hold in constraints]).reshape(-1, 2),
        "on_b": np.array([hold.on_b for hold in constraints]).reshape(-1, 2),
        "axis": np.array(axes).reshape(-1, 2),
    }


@dataclass(frozen=True)
class LinkJoint:
    """A hinge or slide with its constraint, coordinate, spring, damper, load and limits.

    ``constraint`` is its constraint; ``holds`` is False for a coordinate of a free body in the
    plane, which has no constraint.  ``value`` and ``rate`` are those of the start pose [rad or m,
    per s]; ``sign`` is 1 for slides and for hinges that are positive about the plane's normal, and
    -1 for others.  ``stiffness`` are the coefficients (k, a, b) of the spring, whose moment or
    force is k x + a x^2 + b x^3 for the value less ``rest``, x.  ``servo`` is the stiffness of
    actuators that follow the joint: it acts as that of the spring, but stores no energy.
    ``load`` is a constant moment [N m] or force [N] on the second link, with its reaction on the
    first.  ``friction`` is the largest dry friction [N m or N].
    """

    name: str
    constraint: LinkConstraint
    value: float
    sign: float
    rate: float
    stiffness: tuple[float, float, float]
    rest: float
    damping: float
    load: float
    limits: tuple[float, float] | None
    friction: float = 0.0
    holds: bool = True
    servo: float = 0.0

    @property
    def acting(self) -> tuple[float, float, float]:
        """Coefficients (k, a, b) of the spring together with actuators that follow the joint."""
        k, a, b = self.stiffness
        return k + self.servo, a, b

    def spring_force(self, value: Array | float) -> Any:
        """Moment [N m] or force [N] of spring and servos on the second link, at a joint value."""
        return cubic_force(value - self.rest, self.acting)

    def spring_energy(self, value: Array) -> Array:
        """Energy [J] of the spring at joint values."""
        return np.asarray(cubic_energy(value - self.rest, self.stiffness))


@dataclass(frozen=True)
class JointTable(ConstraintTable):
    """Joints as arrays with one row for each: their constraints and fields of `LinkJoint`.

    ``acting`` are the coefficients (3, joints) of springs and servos.
    """

    value: Array
    sign: Array
    rest: Array
    acting: Array
    load: Array

    @classmethod
    def of(cls, joints: Sequence[LinkJoint]) -> "JointTable":
        """The table of some joints."""
        return cls(
            **constraint_columns([joint.constraint for joint in joints]),
            value=np.array([joint.value for joint in joints]),
            sign=np.array([joint.sign for joint in joints]),
            rest=np.array([joint.rest for joint in joints]),
            acting=np.array([joint.acting for joint in joints]).reshape(-1, 3).T,
            load=np.array([joint.load for joint in joints]),
        )

    def joint_forces(self, values: Array) -> Array:
        """Moments [N m] or forces [N] of springs, servos and loads at values (..., joints)."""
        return np.asarray(self.load + cubic_force(values - self.rest, self.acting))

    def energy(self, values: Array) -> Array:
        """Energy [J] (...) whose derivatives are the negative `joint_forces`."""
        own = cubic_energy(values - self.rest, self.acting)
        return np.asarray((own - self.load * values).sum(-1))


@dataclass(frozen=True)
class LinkGear:
    """A gear: two links whose rotations since the start have a constant ratio.

    Both are on hinges of the ground, or one is an arm and one is its planet.  The rotation of link
    `a` is `ratio` times that of link `b`, less `phase` [rad].
    """

    name: str
    a: int
    b: int
    ratio: float
    phase: float


@dataclass(frozen=True)
class LinkSpring(NeutralSpring):
    """A spring and a damper between points of two links.

    The points `on_a` and `on_b` are given relative to the links' centres in the start pose [m].
    """

    def push(self, length: Array) -> Array:
        """Force [N] with which the spring pushes its ends apart, at given lengths [m]."""
        return np.asarray(-self.stiffness * self.stretch(length))


@dataclass(frozen=True)
class LinkLoad:
    """A force and a moment on a point of a link, constant in the world or following the link.

    ``body`` is the id of the body in the MJCF.  The point ``at`` is given relative to the link's
    centre in the start pose [m]; ``force`` lies in the plane [N], ``moment`` acts about its normal
    [N m].  A load with ``follows`` rotates with its link from the start pose on.  ``actuator`` is
    the id of the actuator in the MJCF, or -1 for a load of a rod.
    """

    body: int
    link: int
    at: Array
    force: Array
    moment: float
    follows: bool = False
    actuator: int = -1


@dataclass(frozen=True)
class Links:
    """A planar mechanism in its start pose; the last link is the ground.

    Attributes
    ----------
    reader : ModelReader
        The compiled MJCF, and its state in the start pose.
    plane : MotionPlane
    of_body : ndarray (bodies,) of int
        Link of each body [1].
    centre : ndarray (links + 1, 2)
        Centres of mass in the start pose [m].  A pose (links + 1, 3) has the centres [m] and the
        rotations since the start [rad].
    mass, moment : ndarray (links,)
        Masses [kg], and moments of inertia about the centres along the normal [kg m^2].
    weight : ndarray (links, 2)
        Forces of gravity in the plane [N].
    joints : tuple of LinkJoint
    driven : tuple of int
        Ids of the joints with a prescribed motion, in the run's order.
    loops : tuple of LinkConstraint
        Constraints that close the loops.
    gears : tuple of LinkGear
        Gears between hinges of the ground.
    springs : tuple of LinkSpring
        Springs between points of links; also tendons that only measure a length.
    pulls : tuple of LinkLoad
        Forces and moments on links.
    gravity : ndarray (2,)
        Acceleration of gravity in the plane [m/s^2].
    extent : float
        Size of the model [m].
    contacts : Contacts
        Sections of geoms that may touch, and their laws.
    """

    reader: ModelReader
    plane: MotionPlane
    of_body: Array
    centre: Array
    mass: Array
    moment: Array
    weight: Array
    joints: tuple[LinkJoint, ...]
    driven: tuple[int, ...]
    loops: tuple[LinkConstraint, ...]
    gears: tuple[LinkGear, ...]
    springs: tuple[LinkSpring, ...]
    pulls: tuple[LinkLoad, ...]
    gravity: Array
    extent: float
    contacts: Contacts

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled MJCF."""
        return self.reader.model

    @property
    def data(self) -> mujoco.MjData:
        """The state of the model in the start pose."""
        return self.reader.data

    @property
    def rubbing(self) -> tuple[int, ...]:
        """Ids of the joints with dry friction."""
        return tuple(j for j, joint in enumerate(self.joints) if joint.friction)

    @property
    def rubbing_loose(self) -> tuple[int, ...]:
        """Ids of the joints with dry friction that are not driven."""
        return tuple(j for j in self.rubbing if j not in self.driven)

    @property
    def frictions(self) -> Array:
        """Largest dry friction of all joints (joints,) [N m or N]."""
        return np.array([joint.friction for joint in self.joints])

    @cached_property
    def drives(self) -> tuple[LinkJoint, ...]:
        """The joints with a prescribed motion."""
        return tuple(self.joints[j] for j in self.driven)

    @cached_property
    def holds(self) -> tuple[LinkConstraint, ...]:
        """All constraints of two links: those of the joints, then those of the loops."""
        return (*(joint.constraint for joint in self.joints if joint.holds), *self.loops)

    @property
    def free(self) -> tuple[LinkJoint, ...]:
        """The joints without constraint, three for each body that is free in the plane."""
        return tuple(joint for joint in self.joints if not joint.holds)

    @property
    def joint_rows(self) -> int:
        """Number of rows of the residual that belong to joints; these are the first ones."""
        return 2 * (len(self.holds) - len(self.loops))

    @property
    def rows(self) -> int:
        """Number of constraint equations: two for each constraint of links, one for each gear."""
        return 2 * len(self.holds) + len(self.gears)

    @cached_property
    def table(self) -> ConstraintTable:
        """All constraints as arrays."""
        return ConstraintTable(**constraint_columns(self.holds))

    @cached_property
    def incidence(self) -> tuple[Array, Array]:
        """Matrices (holds, links + 1) with ones at link a and at link b of each constraint."""
        units = np.eye(len(self.centre))
        return units[self.table.a], units[self.table.b]

    @cached_property
    def joint_table(self) -> JointTable:
        """All joints as arrays."""
        return JointTable.of(self.joints)

    @cached_property
    def drive_table(self) -> JointTable:
        """The joints with a prescribed motion as arrays."""
        return JointTable.of(self.drives)

    @cached_property
    def inertia(self) -> Array:
        """Masses and moments of all coordinates of a pose (links + 1, 3), 0 for the ground."""
        return np.pad(np.column_stack([self.mass, self.mass, self.moment]), ((0, 1), (0, 0)))

    @cached_property
    def sizes(self) -> Array:
        """Characteristic sizes (3 links,) of the coordinates of a pose: the extent [m], 1 rad."""
        return np.tile(self.scale, len(self.mass))

    @cached_property
    def scale(self) -> Array:
        """Characteristic sizes (3,) of the coordinates of one link: the extent [m], 1 rad."""
        return np.array([self.extent, self.extent, 1.0])

    @cached_property
    def bounds(self) -> Array:
        """Characteristic sizes (rows + drives,) of constraints and drives: extent [m], 1 rad."""
        across = np.column_stack([np.ones(len(self.holds)), ~self.table.slides])
        turns = np.zeros(len(self.gears))
        along = [joint.constraint.axis is not None for joint in self.drives]
        return np.where(np.concatenate([across.ravel(), turns, along]), self.extent, 1.0)

    @property
    def pose(self) -> Array:
        """The start pose (links + 1, 3)."""
        return np.column_stack([self.centre, np.zeros(len(self.centre))])
