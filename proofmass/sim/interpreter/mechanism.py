"""A mechanism as plain data: numbers, texts and arrays, without an object of any engine.

All points and directions are those of the world in the start pose.  The frame of a link is at its
centre of mass and has the axes of the world in the start pose, so that at the start every rotation
is the identity, that of a joint included, whose coordinate is then `NeutralJoint.value`::

       y            anchor o---- axis            centre c,  place = c(t)
       |   link  .-''                            point p:   place + turn @ (p - centre)
       0---- x  c
    link 0 is the ground: centre 0, no mass

This file is imported by proofmass and by the interpreters of engines; it needs NumPy alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

PlainArray = np.ndarray


def cubic_force(x: Any, coefficients: Any) -> Any:
    """Force ``-(k x + a x^2 + b x^3)`` of a spring with coefficients k, a, b at extensions x."""
    k, a, b = coefficients
    return -x * (k + x * (a + x * b))


def cubic_energy(x: Any, coefficients: Any) -> Any:
    """Energy of the spring of `cubic_force`."""
    k, a, b = coefficients
    return x**2 * (k / 2 + x * (a / 3 + x * b / 4))


@dataclass(frozen=True)
class NeutralLink:
    """A rigid body in its state at the start.

    Attributes
    ----------
    name : str
    mass : float
        [kg]; 0 for the ground.
    inertia : ndarray (3, 3)
        About the centre of mass, in the axes of the world at the start [kg m^2].
    centre : ndarray (3,)
        Centre of mass [m].
    velocity, omega : ndarray (3,)
        Velocity of the centre [m/s] and angular velocity [rad/s], at the time
        `NeutralMechanism.rates_at`.
    body : int
        Its number in the MJCF.
    """

    name: str
    mass: float
    inertia: PlainArray
    centre: PlainArray
    velocity: PlainArray
    omega: PlainArray
    body: int

    @property
    def six_moments(self) -> PlainArray:
        """Moments and products (6,) of inertia: xx, yy, zz, xy, xz, yz [kg m^2]."""
        return self.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


@dataclass(frozen=True)
class NeutralJoint:
    """A joint of two links.

    The spring has the force or moment ``-(k x + a x^2 + b x^3)`` on the child, with the reaction on
    the parent, for ``x = value - rest``; servos, actuators that follow the joint, add their
    stiffness to k.

    Attributes
    ----------
    name : str
    kind : {"hinge", "slide", "ball", "free"}
        A free joint connects its child with nothing.
    parent, child : int
        Numbers of the links.
    anchor, axis : ndarray (3,)
        A point of the joint [m], and its direction [1], which both links have at the start.
    value, rate : float
        Coordinate and rate at the start [rad or m, per s]; 0 for balls and free joints.  The rate
        is that at the time `NeutralMechanism.rates_at`.
    spring : ndarray (3,)
        k, a, b [N m/rad or N/m, and per further rad or m].
    rest : float
        Coordinate at which the spring is slack [rad or m].
    damping : float
        [N m s/rad or N s/m]
    armature : float
        Inertia that is added to that of the coordinate [kg m^2 or kg].
    force : ndarray (1,) or (2 steps + 1,)
        Moment or force on the child, with the reaction on the parent [N m or N]: constant, or at
        the beginning and in the middle of each step and at the end of the last.
    limits : tuple of float, or None
        Least and largest coordinate, where the joint has stops [rad or m]; None without a range,
        and for a driven joint, whose motion is given.
    friction : float
        Largest dry friction, of a driven joint too [N m or N].
    servo : float
        Stiffness of the servos, which stores no energy [N m/rad or N/m].
    """

    name: str
    kind: str
    parent: int
    child: int
    anchor: PlainArray
    axis: PlainArray
    value: float
    rate: float
    spring: PlainArray
    rest: float
    damping: float
    armature: float
    force: PlainArray
    limits: Any = None
    friction: float = 0.0
    servo: float = 0.0

    @cached_property
    def acting(self) -> PlainArray:
        """Coefficients (3,) of spring and servos together."""
        return np.asarray(self.spring + np.array([self.servo, 0.0, 0.0]))

    @cached_property
    def is_sprung(self) -> bool:
        """Whether the joint has a spring or servos."""
        return bool(np.any(self.acting))

    @property
    def is_single(self) -> bool:
        """Whether it is a hinge or slide, whose coordinate is a number."""
        return self.kind in ("hinge", "slide")

    @property
    def points(self) -> tuple:
        """What it joins: a link and its point at the start, twice."""
        return (self.parent, self.anchor), (self.child, self.anchor)

    @property
    def ends(self) -> PlainArray:
        """Ends (2,) of its range `limits` since the start [rad or m]."""
        return np.array(self.limits) - self.value

    def way_beyond_stop(self, way: float) -> float:
        """How far a coordinate since the start is beyond its range, negative within it."""
        low, high = self.ends
        return float(max(low - way, way - high))

    def stops_at(self, way: float, near: float, lead: float) -> PlainArray:
        """Ends of its range, for stops that act only on a joint beyond them.

        An end that is less than `near` from a coordinate since the start is `lead` within it, so
        that it acts in the next step [rad or m].
        """
        inwards = way - self.ends + (lead, -lead)
        return np.asarray(self.ends + (np.abs(way - self.ends) < near) * inwards)

    @property
    def is_forced(self) -> bool:
        """Whether a force or moment acts in the joint."""
        return bool(np.any(self.force))

    def force_in(self, step: int) -> float:
        """The force or moment in the middle of a step [N m or N]."""
        return float(self.force[0] if self.force.size == 1 else self.force[2 * step + 1])

    def force_of_powers(self, value: float) -> float:
        """Force or moment of the powers of the spring above the first on the child [N m or N]."""
        x, (_, a, b) = value - self.rest, self.spring
        return float(-(x**2) * (a + x * b))

    def passive_force(self, value: float, rate: float) -> float:
        """Force or moment of spring, servos and damper on the child [N m or N]."""
        return float(cubic_force(value - self.rest, self.acting) - self.damping * rate)


@dataclass(frozen=True)
class NeutralLoop:
    """A loop that joins a point of link `a` with a point of link `b`, `on_a` and `on_b` [m]."""

    name: str
    a: int
    b: int
    on_a: PlainArray
    on_b: PlainArray

    @property
    def points(self) -> tuple:
        """What it joins: a link and its point at the start, twice."""
        return (self.a, self.on_a), (self.b, self.on_b)


@dataclass(frozen=True)
class NeutralGear:
    """A gear: the coordinate of joint `one` is ``level + ratio`` times that of joint `two`."""

    name: str
    one: int
    two: int
    ratio: float
    level: float


@dataclass(frozen=True)
class NeutralSpring:
    """A spring and a damper between points of two links.

    It pulls with ``stiffness (length - free)`` where it is longer than `slack` [1], pushes where it
    is shorter than `slack` [0], and is slack between them [m].  `body_a` and `body_b` are the
    numbers of the bodies in the MJCF.
    """

    name: str
    a: int
    b: int
    on_a: PlainArray
    on_b: PlainArray
    stiffness: float
    damping: float
    slack: tuple
    body_a: int
    body_b: int

    @property
    def points(self) -> tuple:
        """Its ends: a link and its point at the start, twice."""
        return (self.a, self.on_a), (self.b, self.on_b)

    @property
    def free_length(self) -> float:
        """The length at which alone it is slack [m]; 0 if there is another one, or none."""
        low, high = self.slack
        return float(low) if low == high else 0.0

    def stretch(self, length: PlainArray) -> PlainArray:
        """Extension [m] at given lengths: 0 where slack, negative where shorter."""
        return np.asarray(length - np.clip(length.real, *self.slack))

    def energy(self, length: PlainArray) -> PlainArray:
        """Energy [J] at given lengths [m]."""
        return np.asarray(0.5 * self.stiffness * self.stretch(length) ** 2)

    def pull(self, length: float, rate: float) -> float:
        """Force with which it pulls its ends together [N]."""
        low, high = self.slack
        return float(self.stiffness * (length - min(max(length, low), high)) + self.damping * rate)


@dataclass(frozen=True)
class NeutralLoad:
    """A force and a moment on a link.

    Attributes
    ----------
    link : int
    at : ndarray (3,)
        Point of the link on which the force acts [m].
    force, moment : ndarray (3,)
        In the axes of the world at the start [N, N m].
    follows : bool
        Whether both turn with the link.
    share : ndarray (1,) or (2 steps + 1,)
        Factor of both, as `NeutralJoint.force`.
    body : int
        Number of its body in the MJCF.
    actuator : int
        Number of its actuator in the MJCF; -1 for a load of a rod.
    """

    link: int
    at: PlainArray
    force: PlainArray
    moment: PlainArray
    follows: bool
    share: PlainArray
    body: int
    actuator: int = -1

    def share_in(self, step: int) -> float:
        """The factor in the middle of a step [1]."""
        return float(self.share[0] if self.share.size == 1 else self.share[2 * step + 1])


@dataclass(frozen=True)
class NeutralShape:
    """A shape of a link that may touch others.

    Attributes
    ----------
    name : str
        Its kind and its name in the MJCF.
    kind : {"sphere", "box", "capsule", "cylinder", "plane"}
        A plane is the surface of a half space, whose outer side is that of the third axis.
    link : int
    place : ndarray (3,)
        Its middle [m]; a point of the surface of a half space.
    axes : ndarray (3, 3)
        Its axes in columns; that of a capsule or cylinder is the third one.
    size : ndarray (3,)
        Radius of a sphere, half sides of a box, radius and half length of a capsule, without its
        ends, or cylinder [m]; the rest has no meaning.
    """

    name: str
    kind: str
    link: int
    place: PlainArray
    axes: PlainArray
    size: PlainArray


@dataclass(frozen=True)
class NeutralContact:
    """Two shapes that may touch, by their numbers, the smaller first.

    `friction` is Coulomb's coefficient, `restitution` the normal speed after an impact over that
    before it [1].
    """

    one: int
    two: int
    friction: float
    restitution: float


@dataclass(frozen=True)
class DriveRows:
    """The prescribed motion of a joint: at the beginning and in the middle of each step.

    `value`, `rate` and `acceleration` are arrays (2 steps + 1,) [rad or m, per s, per s^2]; those
    of step ``i`` begin at index ``2 i``.  There is one step more than the run has, so that
    accelerations can be taken from differences at the last sample.
    """

    joint: int
    value: PlainArray
    rate: PlainArray
    acceleration: PlainArray


@dataclass(frozen=True)
class WayToRest:
    """How a run comes to rest at each of its samples.

    The drives and the loads of the step that begins at a sample are constant.  This step is
    repeated until the links are at rest; the other steps up to the next sample lead to it.  The
    inertia of the links has no effect on a rest: it is chosen for the way to it, and weights are
    loads.

    Attributes
    ----------
    drag : float
        Every link has the force ``-drag m v`` at its centre and the moment ``-drag I omega``, with
        its inertia I as in the start pose, a multiple of the unit matrix [1/s].
    speed : float
        Speed of the fastest link below which the mechanism is at rest [m/s]; that of a link is that
        of its centre and its angular velocity times the size of the mechanism.
    slow : float
        Speed below which a mechanism that does not become slower counts as at rest [m/s].
    block : int
        Number of steps between two checks.
    most : int
        Number of steps after which a sample is given up.
    """

    drag: float
    speed: float
    slow: float
    block: int
    most: int


@dataclass(frozen=True)
class Mjcf:
    """The model in MuJoCo's own language, for hosts that read it.

    Attributes
    ----------
    text : str
        The model with all that it includes, without sensors and keys.
    folder : str
        The folder in which meshes and other files are looked for.
    sizes : tuple of int
        nq, nv, neq and nbody of the compiled model.
    arrays : dict of str to ndarray
        Fields of the compiled model that settings may have changed, by name.
    options : dict of str to number
        Options of the compiled model, by name.
    words : dict of str to str
        Options with words: ``integrator``, ``solver`` and ``cone``, as in ``mjINT_EULER``.
    qpos, qvel, ctrl : ndarray
        The state at the start.
    pushes : ndarray (nbody, 6)
        Forces and moments on bodies, ``xfrc_applied``.
    dofs : ndarray (drives,)
        Indices of the driven joints in ``qvel``.
    torque : ndarray (steps, drives)
        Torque on the flywheel of each drive in each step.
    instant : ndarray (steps + 1, drives)
        Torque on the flywheel at the beginning of each step.
    controls : ndarray (2 steps + 1, loads)
        Controls that change, as `NeutralJoint.force`.
    changed : ndarray (loads,)
        Their indices in ``ctrl``.
    """

    text: str
    folder: str
    sizes: tuple
    arrays: dict
    options: dict
    words: dict
    qpos: PlainArray
    qvel: PlainArray
    ctrl: PlainArray
    pushes: PlainArray
    dofs: PlainArray
    torque: PlainArray
    instant: PlainArray
    controls: PlainArray
    changed: PlainArray


@dataclass(frozen=True)
class NeutralMechanism:
    """A mechanism, its state at the start, and the steps of a run.

    Attributes
    ----------
    links : tuple of NeutralLink
        The first one is the ground.
    joints : tuple of NeutralJoint
        A link has at most one joint, or several in a row that act one after the other.  The joints
        are in the order of the tree: the parent of a joint comes before its child.
    loops : tuple of NeutralLoop
    gears : tuple of NeutralGear
    springs : tuple of NeutralSpring
    loads : tuple of NeutralLoad
    drives : tuple of DriveRows
    gravity : ndarray (3,)
        [m/s^2]
    plane : ndarray (3, 3)
        Rows e1, e2 and normal of the plane in which a planar mechanism moves; shape (0, 3) for a
        mechanism in space.
    size : float
        [m]
    step : float
        Time step [s].
    count : int
        Number of steps from each sample to the next.
    samples : int
    rates_at : float
        Time of the rates of links and joints at the start: 0, or -step / 2 for a reading of
        velocities in the middle of steps [s].
    mjcf : Mjcf, optional
        Only for hosts that ask for it.
    rest : WayToRest, optional
        Of runs that come to rest at each sample; None for runs in time.
    shapes : tuple of NeutralShape
        Those that touch others.
    contacts : tuple of NeutralContact
        All pairs of shapes that may touch; others pass through each other.
    """

    links: tuple
    joints: tuple
    loops: tuple
    gears: tuple
    springs: tuple
    loads: tuple
    drives: tuple
    gravity: PlainArray
    plane: PlainArray
    size: float
    step: float
    count: int
    samples: int
    rates_at: float = 0.0
    mjcf: Any = None
    rest: Any = None
    shapes: tuple = ()
    contacts: tuple = ()

    @property
    def is_planar(self) -> bool:
        """Whether the mechanism moves in a plane."""
        return bool(len(self.plane))

    @property
    def steps(self) -> int:
        """Number of steps of the run."""
        return self.count * (self.samples - 1)

    @property
    def singles(self) -> list:
        """Numbers of the hinges and slides, whose coordinate is a number."""
        return [j for j, one in enumerate(self.joints) if one.is_single]

    @cached_property
    def laws(self) -> dict:
        """The contact of two shapes by their numbers, in both orders."""
        orders = [((one.one, one.two), (one.two, one.one)) for one in self.contacts]
        return {ends: one for both, one in zip(orders, self.contacts) for ends in both}

    def arm(self, link: int, at: PlainArray) -> PlainArray:
        """A point of a link, given at the start, from its centre [m]."""
        return np.asarray(at - self.links[link].centre)

    def joints_of(self, link: int) -> list:
        """Numbers of the joints whose child is a link, in the order in which they act."""
        return [j for j, one in enumerate(self.joints) if one.child == link]

    def start_rates(self, joint: int) -> PlainArray:
        """Rates of a joint at the start, in the axes of the world.

        Returns
        -------
        ndarray (1,), (3,) or (6,)
            The rate of a hinge or slide [rad/s or m/s]; the angular velocity of a ball [rad/s]; the
            velocity of the anchor of a free joint [m/s] and its angular velocity.
        """
        one = self.joints[joint]
        child, parent = self.links[one.child], self.links[one.parent]
        if one.kind == "free":
            arm = one.anchor - child.centre
            return np.concatenate([child.velocity + np.cross(child.omega, arm), child.omega])
        if one.kind == "ball":
            hinges = [self.joints[j] for j in self.joints_of(one.child)]
            turning = [other.axis * other.rate for other in hinges if other.kind == "hinge"]
            return np.asarray(child.omega - parent.omega - sum(turning, np.zeros(3)))
        return np.array([one.rate])

    def drive_of(self, joint: int) -> Any:
        """The drive of a joint, or None."""
        return next((one for one in self.drives if one.joint == joint), None)

    def friction_of(self, joint: int) -> float:
        """Largest dry friction of a joint, 0 of a driven one, whose motion is given [N m or N]."""
        return 0.0 if self.drive_of(joint) else float(self.joints[joint].friction)

    def flat(self, vector: PlainArray) -> PlainArray:
        """Components of vectors (..., 3) in the plane (..., 2)."""
        return vector @ self.plane[:2].T

    def turn_of(self, joint: int) -> float:
        """1 if a hinge turns about the normal of the plane, -1 if against it."""
        return float(np.sign(self.joints[joint].axis @ self.plane[2]))


MOTION_ROWS = "place", "turn", "velocity", "omega", "acceleration", "alpha"
"""The arrays of `LinkStates` that have the motions of links."""


@dataclass
class LinkStates:
    """States of all links at the samples, and what the run took.

    Attributes
    ----------
    place, velocity, omega : ndarray (n, links, 3)
        Centres [m], their velocities [m/s] and angular velocities [rad/s].
    turn : ndarray (n, links, 3, 3)
        Rotations since the start.
    acceleration, alpha : ndarray (n, links, 3)
        Accelerations of the centres [m/s^2], and angular accelerations [rad/s^2]; NaN where the
        engine has none.
    seconds : float
        Processor time of the steps [s].
    compiled : float
        Processor time of compilation before the steps [s].
    failed : str
        Why the run ended early; the states end with the last good sample.
    coordinates : ndarray (3, n, joints) or (0,)
        Coordinates of hinges and slides, their rates and accelerations, from engines that have
        them; empty: they follow from the states of the links.
    notes : tuple of str
        Remarks on the run, a sentence each.
    steps : int
        Number of steps of a run that comes to rest at its samples.
    """

    place: PlainArray
    velocity: PlainArray
    omega: PlainArray
    turn: PlainArray
    acceleration: PlainArray
    alpha: PlainArray
    seconds: float = 0.0
    compiled: float = 0.0
    failed: str = ""
    coordinates: PlainArray = field(default_factory=lambda: np.zeros(0))
    notes: tuple = ()
    steps: int = 0

    @classmethod
    def empty(cls, mechanism: NeutralMechanism, joints: bool = False) -> LinkStates:
        """States of all links at the start pose, at rest; with coordinates of `joints`, NaN."""
        n, links = mechanism.samples, mechanism.links
        place = np.tile(np.array([one.centre for one in links]), (n, 1, 1))
        none = np.zeros_like(place)
        turn = np.tile(np.eye(3), (n, len(links), 1, 1))
        states = cls(place, none.copy(), none.copy(), turn, none.copy(), none.copy())
        if joints:
            states.coordinates = np.full((3, n, len(mechanism.joints)), np.nan)
        return states

    def set(self, samples: Any, link: int, motion: tuple) -> None:
        """Set the motion of a link, as `record` gets it, at a sample or at several."""
        for name, part in zip(MOTION_ROWS, motion):
            getattr(self, name)[samples, link] = part

    def first(self, count: int, failed: str) -> LinkStates:
        """The states at the first `count` samples, with the reason why there are no more."""
        rows = {name: getattr(self, name)[:count] for name in MOTION_ROWS}
        coordinates = self.coordinates[:, :count] if self.coordinates.size else self.coordinates
        return LinkStates(
            **rows,
            seconds=self.seconds,
            compiled=self.compiled,
            failed=failed,
            coordinates=coordinates,
            notes=self.notes,
            steps=self.steps,
        )
