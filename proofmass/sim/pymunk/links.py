"""Links in a plane: what the modules of this folder work on."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import Array
from proofmass.sim.plane import MotionPlane
from proofmass.sim.pymunk.contacts import Contacts

HAIR = 1e-13
"""How far before its limit a joint meets its stop [rad or m], to be left on the limit: Chipmunk's
stops hold a joint only beyond them, and let one fall in anew that they put back to the last digit.
"""
QUARTER = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""Turns row vectors by a quarter turn."""


@dataclass(frozen=True)
class Hold:
    """Two links held together at a point, or (with an axis) along a line without turning.

    ``on_a`` and ``on_b`` are seen from the links' centres in the start pose.
    """

    name: str
    a: int
    b: int
    on_a: Array
    on_b: Array
    axis: Array | None = None


@dataclass(frozen=True)
class HoldTable:
    """Holds as arrays, one row each; the axis of a hinge or a loop is zero."""

    a: NDArray[np.intp]
    b: NDArray[np.intp]
    on_a: Array
    on_b: Array
    axis: Array

    @cached_property
    def slides(self) -> NDArray[np.bool_]:
        """Which holds have an axis."""
        return np.asarray(self.axis.any(axis=1))

    @cached_property
    def slide(self) -> bool:
        """Whether any of them has."""
        return bool(self.slides.any())

    @cached_property
    def guides(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], Array]:
        """Which holds have an axis, their links a and b, and a vector across each axis (n, 2)."""
        slides = np.flatnonzero(self.slides)
        return slides, self.a[slides], self.b[slides], self.axis[slides] @ QUARTER

    @cached_property
    def ends(self) -> NDArray[np.intp]:
        """The second links (holds,), then the first ones."""
        return np.concatenate([self.b, self.a])

    @cached_property
    def on_ends(self) -> Array:
        """The anchors on these links (2 holds, 2)."""
        return np.concatenate([self.on_b, self.on_a])


def columns(holds: Sequence[Hold]) -> dict[str, Any]:
    """What a `HoldTable` has of some holds."""
    axes = [np.zeros(2) if hold.axis is None else hold.axis for hold in holds]
    return {
        "a": np.array([hold.a for hold in holds], np.intp),
        "b": np.array([hold.b for hold in holds], np.intp),
        "on_a": np.array([hold.on_a for hold in holds]).reshape(-1, 2),
        "on_b": np.array([hold.on_b for hold in holds]).reshape(-1, 2),
        "axis": np.array(axes).reshape(-1, 2),
    }


@dataclass(frozen=True)
class LinkJoint:
    """A hinge or slide: its hold, value in the start pose, sense about the normal, and its loads.

    ``stiffness`` holds the spring's coefficients (k, a, b) of k x + a x^2 + b x^3, x the value less
    that at ``rest``; ``load`` is a constant moment [N m] or force [N] on the second link against
    the first; ``friction`` is what dry friction may hold [N m or N].  ``servo`` is the stiffness of
    actuators that follow the joint: it acts as that of the spring, and stores no energy.  A joint
    that holds nothing is a coordinate of a body that is free in the plane.
    """

    name: str
    hold: Hold
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
        """Coefficients of the spring and of actuators that follow the joint."""
        k, a, b = self.stiffness
        return k + self.servo, a, b

    def spring_force(self, value: Array | float) -> Any:
        """Moment [N m] or force [N] of spring and servos on the second link against the first."""
        x, (k, a, b) = value - self.rest, self.acting
        return -x * (k + x * (a + x * b))

    def spring_energy(self, value: Array) -> Array:
        """Energy [J] of the spring."""
        x, (k, a, b) = value - self.rest, self.stiffness
        return x**2 * (k / 2 + x * (a / 3 + x * b / 4))


@dataclass(frozen=True)
class JointTable(HoldTable):
    """Joints as arrays, one row each: their holds, and what `LinkJoint` says of them.

    ``acting`` are coefficients (3, joints) of springs and servos.
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
            **columns([joint.hold for joint in joints]),
            value=np.array([joint.value for joint in joints]),
            sign=np.array([joint.sign for joint in joints]),
            rest=np.array([joint.rest for joint in joints]),
            acting=np.array([joint.acting for joint in joints]).reshape(-1, 3).T,
            load=np.array([joint.load for joint in joints]),
        )

    def joint_forces(self, values: Array) -> Array:
        """Moments [N m] or forces [N] of springs, servos and loads at values (..., joints)."""
        x, (k, a, b) = values - self.rest, self.acting
        return np.asarray(self.load - x * (k + x * (a + x * b)))

    def energy(self, values: Array) -> Array:
        """Energy [J] (...) whose derivatives are what `joint_forces` has against it."""
        x, (k, a, b) = values - self.rest, self.acting
        return np.asarray((x**2 * (k / 2 + x * (a / 3 + x * b / 4)) - self.load * values).sum(-1))


@dataclass(frozen=True)
class LinkGear:
    """Two links on hinges of the ground that turn in a ratio.

    The turn of link `a` since the start is `ratio` times that of link `b`, less `phase` [rad].
    """

    name: str
    a: int
    b: int
    ratio: float
    phase: float


@dataclass(frozen=True)
class LinkSpring:
    """A spring and a damper between points of two links, seen from their centres at the start.

    The spring is slack at lengths from `slack[0]` to `slack[1]` [m]; `bodies` are those of the
    MJCF.
    """

    name: str
    a: int
    b: int
    on_a: Array
    on_b: Array
    stiffness: float
    damping: float
    slack: tuple[float, float]
    bodies: tuple[int, int]

    def stretch(self, length: Array) -> Array:
        """How far lengths are from those at which the spring is slack [m]."""
        return np.asarray(length - np.clip(length.real, *self.slack))

    def push(self, length: Array) -> Array:
        """Force [N] with which the spring pushes its ends apart."""
        return np.asarray(-self.stiffness * self.stretch(length))

    def energy(self, length: Array) -> Array:
        """Energy [J] of the spring."""
        return np.asarray(0.5 * self.stiffness * self.stretch(length) ** 2)


@dataclass(frozen=True)
class Pull:
    """A load at a point of a link, seen from its centre at the start: constant in the world.

    ``body`` is that of the MJCF, ``force`` in the plane [N], ``moment`` about its normal [N m].  A
    load that ``follows`` turns with its link from the start on.  ``actuator`` is that of the MJCF,
    -1 of a load of a rod.
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
    model, data : MjModel, MjData
        What it was read from.
    plane : MotionPlane
    of_body : ndarray (bodies,) of int
        Link of each body [1].
    centre : ndarray (links + 1, 2)
        Centres of mass [m]; a pose is (links + 1, 3): centres [m] and turns since the start [rad].
    mass, moment : ndarray (links,)
        [kg], [kg m^2] about the centre, along the normal.
    weight : ndarray (links, 2)
        Forces of gravity in the plane [N].
    joints : tuple of LinkJoint
    driven : tuple of int
        Ids of the joints with a prescribed motion, in the run's order.
    loops : tuple of Hold
        What closes the loops.
    gears : tuple of LinkGear
        Which couple hinges of the ground.
    springs : tuple of LinkSpring
        Between points of links; also those that only measure a length.
    pulls : tuple of Pull
        Forces and moments on links.
    gravity : ndarray (2,)
        In the plane [m/s^2].
    extent : float
        Size of the model [m].
    contacts : Contacts
        What touches what.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    plane: MotionPlane
    of_body: Array
    centre: Array
    mass: Array
    moment: Array
    weight: Array
    joints: tuple[LinkJoint, ...]
    driven: tuple[int, ...]
    loops: tuple[Hold, ...]
    gears: tuple[LinkGear, ...]
    springs: tuple[LinkSpring, ...]
    pulls: tuple[Pull, ...]
    gravity: Array
    extent: float
    contacts: Contacts

    @property
    def rubbing(self) -> tuple[int, ...]:
        """Ids of the joints with dry friction."""
        return tuple(j for j, joint in enumerate(self.joints) if joint.friction)

    @cached_property
    def drives(self) -> tuple[LinkJoint, ...]:
        """The joints with a prescribed motion."""
        return tuple(self.joints[j] for j in self.driven)

    @cached_property
    def holds(self) -> tuple[Hold, ...]:
        """All holds: those of the joints, then the loops."""
        return (*(joint.hold for joint in self.joints if joint.holds), *self.loops)

    @property
    def free(self) -> tuple[LinkJoint, ...]:
        """The joints that hold nothing, three of each body that is free in the plane."""
        return tuple(joint for joint in self.joints if not joint.holds)

    @property
    def joint_rows(self) -> int:
        """How many rows of the residual, its first ones, are of the holds of joints."""
        return 2 * (len(self.holds) - len(self.loops))

    @property
    def rows(self) -> int:
        """How many equations hold the links: two of each hold, one of each gear."""
        return 2 * len(self.holds) + len(self.gears)

    @cached_property
    def table(self) -> HoldTable:
        """All holds as arrays."""
        return HoldTable(**columns(self.holds))

    @cached_property
    def incidence(self) -> tuple[Array, Array]:
        """Which link is the first, and which the second, of each hold (holds, links + 1)."""
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
        """Masses and moments of all coordinates of a pose (links + 1, 3); the ground has none."""
        return np.pad(np.column_stack([self.mass, self.mass, self.moment]), ((0, 1), (0, 0)))

    @cached_property
    def sizes(self) -> Array:
        """What the coordinates of a pose are measured in (3 links,): extents [m], radians."""
        return np.tile(self.scale, len(self.mass))

    @cached_property
    def scale(self) -> Array:
        """The same of one link (3,)."""
        return np.array([self.extent, self.extent, 1.0])

    @cached_property
    def bounds(self) -> Array:
        """What all that is prescribed is measured in (rows + drives,): extents [m], radians."""
        across = np.column_stack([np.ones(len(self.holds)), ~self.table.slides])
        turns = np.zeros(len(self.gears))
        along = [joint.hold.axis is not None for joint in self.drives]
        return np.where(np.concatenate([across.ravel(), turns, along]), self.extent, 1.0)

    @property
    def pose(self) -> Array:
        """The start pose (links + 1, 3)."""
        return np.column_stack([self.centre, np.zeros(len(self.centre))])
