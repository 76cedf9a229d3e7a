"""Data of a planar mechanism: bodies in a tree of joints, and the loops that close it.

The plane is the complex plane.  All points are given in the *reference pose*, in which every joint
has its zero value; a pose displaces each body from there by ``z -> w z + t``, |w| = 1.

`read` makes a `Mechanism` from the numbers of a compiled MJCF (`proofmass.analytic.mjcf`), which a
`Projection` puts on the plane of motion; MuJoCo's kinematics is not used.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.mjcf import (
    UNLIMITED,
    ActuatorData,
    BodyData,
    EqualityKind,
    JointData,
    JointKind,
    LoopData,
    ModelData,
    SensorData,
    SiteLoad,
    TendonData,
    TendonWay,
    TieData,
    read_compiled,
)
from proofmass.analytic.numerics import (
    CannotMove,
    NotCovered,
    normal_of_slides,
    rotation_matrix,
)
from proofmass.analytic.planar.support import SUPPORT
from proofmass.analytic.stops import Stop, stops_of_joint
from proofmass.analytic.support import refuse, refuse_placed_bodies
from proofmass.base.arrays import Array, Complex, Index


class Mirrored(CannotMove):
    """A pose that closes the loops, but in another assembly mode than the start pose."""


class Overconstrained(CannotMove):
    """The loop equations are not independent of each other."""


@dataclass(frozen=True)
class PlanarJoint:
    """A hinge about `place`, or a slide along the unit vector `place`, in the reference pose.

    `sign` is +1 when the hinge's axis is the plane's normal, -1 when it is opposite.  `zero` is the
    value in the reference pose, and `rest` the value at which the spring is slack.  `load` is a
    constant moment or force on the joint, `friction` the largest dry friction, and `servo` has the
    stiffness and damping of actuators with feedback, which store no energy.  `stiffness_poly` has
    the coefficients of the stiffness for the stretch and its square, `damping_poly` those of the
    damping for the speed and its square.
    """

    name: str
    hinge: bool
    place: complex
    sign: float
    zero: float
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    armature: float = 0.0
    load: float = 0.0
    range: tuple[float, float] = (-math.inf, math.inf)
    friction: float = 0.0
    servo: tuple[float, float] = (0.0, 0.0)
    stiffness_poly: tuple[float, float] = (0.0, 0.0)
    damping_poly: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class PlanarBody:
    """A rigid body: its parent, the joints between the two in order, and its inertia."""

    name: str
    parent: int
    joints: tuple[int, ...]
    mass: float
    centre: complex
    moment: float


@dataclass(frozen=True)
class Pin:
    """A loop closed by a point of one body that stays on a point of another."""

    name: str
    one: int
    on_one: complex
    two: int
    on_two: complex


@dataclass(frozen=True)
class Coupling:
    """Equation between joints: the sum `one` is a polynomial of the sum `two`.

    A sum consists of numbers of joints and their weights; joint values count from their zeros.  An
    empty sum is 0; if `two` is empty, `one` is constant.
    """

    name: str
    one: tuple[tuple[int, float], ...]
    two: tuple[tuple[int, float], ...]
    polynomial: tuple[float, ...]


class TendonSpring:
    """The spring and the damper of a tendon, which act on its length.

    The spring is slack at lengths from `slack[0]` to `slack[1]`.  `stiffness_poly` and
    `damping_poly` are as in `PlanarJoint`.
    """

    stiffness: float
    damping: float
    slack: tuple[float, float]
    stiffness_poly: tuple[float, float]
    damping_poly: tuple[float, float]

    @property
    def has_damping(self) -> bool:
        """Whether it has any damping."""
        return any((self.damping, *self.damping_poly))

    @property
    def has_force(self) -> bool:
        """Whether it has a spring or a damper, and does not only measure a length."""
        return self.has_damping or any((self.stiffness, *self.stiffness_poly))

    def stretch(self, length: Array) -> Array:
        """Stretch of the spring at lengths [m or rad]: their distance from the slack range."""
        return np.asarray(length - np.clip(length, *self.slack))


@dataclass(frozen=True)
class SumSpring(TendonSpring):
    """A spring and a damper whose length is a weighted sum of joint values (number, weight)."""

    name: str
    joints: tuple[tuple[int, float], ...]
    stiffness: float
    damping: float
    slack: tuple[float, float]
    stiffness_poly: tuple[float, float] = (0.0, 0.0)
    damping_poly: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class PointSpring(TendonSpring):
    """A spring and a damper between a point of one body and a point of another.

    `offset` is the distance of the two points along the plane's normal.
    """

    name: str
    one: int
    on_one: complex
    two: int
    on_two: complex
    stiffness: float
    damping: float
    slack: tuple[float, float]
    offset: float = 0.0
    stiffness_poly: tuple[float, float] = (0.0, 0.0)
    damping_poly: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class PointLoad:
    """A load at a point of a body: force and moment per unit of an actuator's force [1, m].

    If it `follows`, it is fixed to the body and given in the reference pose; otherwise it is a dead
    load, fixed to the ground.
    """

    actuator: ActuatorData
    body: int
    point: complex
    force: complex
    moment: float
    follows: bool


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Bodies, joints, loops and springs between points; body 0 is the ground.

    Attributes
    ----------
    bodies, joints, pins, couplings
        Its bodies, joints and loop equations.
    gravity : complex
        Gravity in the plane [m/s^2].
    start, start_rate : ndarray (joints,)
        Joint values and rates of the start pose [rad or m, per s].
    point_springs : tuple of PointSpring
        All springs between points, with those that only measure a length.
    actuators : tuple of ActuatorData
        Actuators of the joints.  The forces of those without a range of forces, at the controls of
        the key, are part of `load` and `servo` of the joints.
    ctrl : ndarray (controls,)
        Controls of the key [SI].
    point_loads : tuple of PointLoad
        Loads of the actuators on sites.
    sum_springs : tuple of SumSpring
        Springs and dampers of the fixed tendons that have any.
    """

    bodies: tuple[PlanarBody, ...]
    joints: tuple[PlanarJoint, ...]
    pins: tuple[Pin, ...]
    couplings: tuple[Coupling, ...]
    gravity: complex
    start: Array
    start_rate: Array
    point_springs: tuple[PointSpring, ...] = ()
    actuators: tuple[ActuatorData, ...] = ()
    ctrl: Array = field(default_factory=lambda: np.zeros(0))
    point_loads: tuple[PointLoad, ...] = ()
    sum_springs: tuple[SumSpring, ...] = ()

    @cached_property
    def moved_by(self) -> NDArray[np.bool_]:
        """Whether each body is moved by each joint (bodies, joints)."""
        moved = np.zeros((len(self.bodies), len(self.joints)), bool)
        for b, body in enumerate(self.bodies[1:], 1):
            moved[b] = moved[body.parent]
            moved[b, list(body.joints)] = True
        return moved

    @cached_property
    def hinges(self) -> NDArray[np.bool_]:
        """Whether each joint is a hinge (joints,)."""
        return np.array([j.hinge for j in self.joints], bool)

    @cached_property
    def signs(self) -> Array:
        """Sense of each hinge about the plane's normal (joints,)."""
        return np.array([j.sign for j in self.joints])

    @cached_property
    def zeros(self) -> Array:
        """Joint values of the reference pose (joints,)."""
        return np.array([j.zero for j in self.joints])

    @cached_property
    def size(self) -> float:
        """Size of the mechanism [m]: the longest way round a loop, or from ground to a centre."""
        lengths = [
            self.reach(p.one, p.on_one)[0] + self.reach(p.two, p.on_two)[0] for p in self.pins
        ]
        lengths += [self.reach(b, body.centre)[0] for b, body in enumerate(self.bodies)]
        return max(lengths, default=0.0) or 1.0

    @cached_property
    def scale(self) -> Array:
        """Units in which joint values are of the same order (joints,): 1 rad, or the size [m]."""
        return np.where(self.hinges, 1.0, self.size)

    @cached_property
    def loop_units(self) -> Array:
        """Units of the loop equations (rows,): the size [m], or 1 rad of a coupling of hinges."""
        pins = np.full(2 * len(self.pins), self.size)
        firsts = [(*c.one, *c.two)[0][0] for c in self.couplings]
        return np.concatenate([pins, self.scale[np.array(firsts, np.intp)]])

    @cached_property
    def frames(self) -> "Frames":
        """The part of the kinematics that is the same in all poses."""
        return Frames.of(self)

    @cached_property
    def pin_equations(self) -> "PinEquations":
        """The part of the pins' equations that is the same in all poses."""
        return PinEquations.of(self)

    @cached_property
    def loaded_points(self) -> tuple[Index, Complex]:
        """Bodies (loads,) and points (loads, 1) of the loads at points."""
        bodies = np.array([load.body for load in self.point_loads], np.intp)
        points = np.array([load.point for load in self.point_loads], complex)
        return bodies, points.reshape(-1, 1)

    @cached_property
    def springs(self) -> tuple[Array, Array, Array, Array, Array]:
        """Rest value, stiffness, damping, armature and constant load of the joints (joints,).

        Stiffness and damping include those of `servo`.
        """
        rest, stiffness, damping, armature, load = (
            np.array([getattr(j, key) for j in self.joints], float)
            for key in ("rest", "stiffness", "damping", "armature", "load")
        )
        servo = np.array([j.servo for j in self.joints], float).reshape(-1, 2)
        return rest, stiffness + servo[:, 0], damping + servo[:, 1], armature, load

    @cached_property
    def polynomials(self) -> tuple[tuple[Array, Array], tuple[Array, Array]] | None:
        """Polynomial coefficients of the joints' stiffness and damping (joints,), or None."""
        stiffer, damped = (
            np.array([getattr(j, key) for j in self.joints], float).reshape(-1, 2).T
            for key in ("stiffness_poly", "damping_poly")
        )
        if not (stiffer.any() or damped.any()):
            return None
        return (stiffer[0], stiffer[1]), (damped[0], damped[1])

    @cached_property
    def frictions(self) -> Array:
        """Dry friction of the joints (joints,) [N m or N]."""
        return np.array([j.friction for j in self.joints])

    @cached_property
    def inertia(self) -> "Inertia":
        """Inertia of the bodies that have any."""
        return Inertia.of(self)

    @property
    def loop_names(self) -> list[str]:
        """Names of the pins, then of the couplings."""
        return [p.name for p in self.pins] + [c.name for c in self.couplings]

    @property
    def rows(self) -> int:
        """Number of loop equations."""
        return 2 * len(self.pins) + len(self.couplings)

    def chain(self, body: int) -> list[int]:
        """Numbers of the joints from the ground to a body, in order."""
        order: list[int] = []
        while body:
            order = [*self.bodies[body].joints, *order]
            body = self.bodies[body].parent
        return order

    def reach(self, body: int, point: complex, q: Array | None = None) -> Array:
        """Longest distance from each joint of a body's chain to a point on it [m] (..., chain + 1).

        It is the sum of the lengths between them, with slides as far out as in q (..., joints), by
        default as in the start pose; the last value is 0.
        """
        chain, q = np.array(self.chain(body), np.intp), self.start if q is None else q
        hinge = self.hinges[chain]
        places = np.array([*(self.joints[j].place for j in chain[hinge]), point])
        segments = np.abs(q[..., chain] - self.zeros[chain])
        segments[..., hinge] = np.abs(np.diff(places))
        sums = np.cumsum(segments[..., ::-1], axis=-1)[..., ::-1]
        return np.concatenate([sums, np.zeros((*segments.shape[:-1], 1))], axis=-1)


@dataclass(frozen=True, eq=False)
class Frames:
    """The tree of a mechanism as matrices.

    Frame 0 is the ground, and frame 1 + j is moved by joint j.  A frame turns by the sum of the
    hinges on its chain, and its shift is linear in the rotation factors of all frames and in the
    slides: a hinge at the point a leaves a where the frame before the joint has it.

    Attributes
    ----------
    body : ndarray (bodies,)
        The frame that each body is fixed to.
    turning : ndarray (frames, joints)
        Derivative of each frame's angle by each joint: the sign of a hinge, 0 for a slide [1].
    shift : ndarray (frames, frames), complex
        Coefficients of each frame's shift for the rotation factor of each frame [m].
    slides : ndarray (slides,)
        Numbers of the joints that are slides.
    directions : ndarray (slides, frames), complex
        Coefficients of each slide's direction for the rotation factor of each frame [1].
    sliding : ndarray (frames, slides)
        1 where a slide moves a frame, else 0 [1].
    before : ndarray (joints,)
        The frame before each joint.
    places : ndarray (joints, 1), complex
        Position of each hinge [m] and direction of each slide [1], in the reference pose.
    """

    body: Index
    turning: Array
    shift: Complex
    slides: Index
    directions: Complex
    sliding: Array
    before: Index
    places: Complex

    @classmethod
    def of(cls, m: Mechanism) -> Self:
        """Make the matrices of a mechanism."""
        n = len(m.joints)
        body, before = np.zeros(len(m.bodies), np.intp), np.zeros(n, np.intp)
        turning, shift = np.zeros((n + 1, n)), np.zeros((n + 1, n + 1), complex)
        slides = np.flatnonzero(~m.hinges)
        directions = np.zeros((len(slides), n + 1), complex)
        sliding = np.zeros((n + 1, len(slides)))
        for b, body_data in enumerate(m.bodies[1:], 1):
            frame = int(body[body_data.parent])
            for j in body_data.joints:
                before[j], joint = frame, m.joints[j]
                for part in (turning, shift, sliding):
                    part[j + 1] = part[frame]
                if joint.hinge:
                    turning[j + 1, j] = joint.sign
                    shift[j + 1, frame] += joint.place
                    shift[j + 1, j + 1] -= joint.place
                else:
                    k = int(np.searchsorted(slides, j))
                    directions[k, frame] = joint.place
                    sliding[j + 1, k] = 1.0
                frame = j + 1
            body[b] = frame
        places = np.array([joint.place for joint in m.joints], complex).reshape(-1, 1)
        return cls(body, turning, shift, slides, directions, sliding, before, places)


@dataclass(frozen=True, eq=False)
class PinEquations:
    """The equations of the pins, as sums of terms with constant coefficients.

    The terms are s e^(i f).  Each frame has one, with its angle f and s = 1.  Each slide has one,
    with the slide's move s and the angle f of the frame before it.  The derivative of a term is i
    times the term by a hinge that turns it, and e^(i f), the term of the frame before, by its own
    slide; so the derivatives of the equations by the joints are sums of the same terms.

    Attributes
    ----------
    turning : ndarray (joints, terms)
        Derivative of the angle of each term by each joint [1].
    offsets : ndarray (terms, pins), complex
        Coefficients of the vector from the second end of each pin to its first [m; 1 of a slide].
    linear : ndarray (2 terms, 2 pins (1 + joints))
        Coefficients for the real parts of the terms, then for the imaginary parts.  Each x and y of
        the vectors is followed by its derivatives by the joints [m; 1].
    """

    turning: Array
    offsets: Complex
    linear: Array

    @classmethod
    def of(cls, m: Mechanism) -> Self:
        """Collect the coefficients of a mechanism."""
        f = m.frames
        frame_of_term = np.append(np.arange(len(f.turning)), f.before[f.slides])
        one, two = (
            cls.ends(f, [getattr(p, body) for p in m.pins], [getattr(p, on) for p in m.pins])
            for body, on in (("one", "on_one"), ("two", "on_two"))
        )
        offsets, turning = one - two, f.turning[frame_of_term].T
        slopes = 1j * offsets[:, None] * turning
        slopes[:, f.slides, f.before[f.slides]] += offsets[:, len(f.turning) :]
        both = np.concatenate([offsets[:, None], slopes], axis=1)  # (pins, 1 + joints, terms)
        parts = np.array([[both.real, both.imag], [-both.imag, both.real]])
        linear = parts.transpose(0, 4, 2, 1, 3).reshape(2 * len(frame_of_term), -1)
        return cls(turning, offsets.T, linear)

    @staticmethod
    def ends(f: Frames, bodies: list[int], points: list[complex]) -> Complex:
        """Coefficients (k, terms) of the positions of points of bodies."""
        frames = f.body[bodies]
        found = np.hstack([f.shift[frames], f.sliding[frames] * f.places[f.slides, 0]])
        found[np.arange(len(frames)), frames] += points
        return found


@dataclass(frozen=True, eq=False)
class Inertia:
    """Bodies with a mass or a moment of inertia.

    Attributes
    ----------
    bodies : ndarray (k,)
        Numbers of the bodies.
    mass : ndarray (k,)
        Masses [kg].
    centre : ndarray (k, 1), complex
        Centres of mass in the reference pose [m].
    moment : ndarray (k,)
        Moments of inertia about the centres [kg m^2].
    turning : ndarray (k, joints)
        Derivative of each body's angle by each joint [1].
    fixed : ndarray (joints, joints)
        The part of the mass matrix that is the same in all poses, of armatures and moments of
        inertia [kg m^2 or kg].
    """

    bodies: Index
    mass: Array
    centre: Complex
    moment: Array
    turning: Array
    fixed: Array

    @classmethod
    def of(cls, m: Mechanism) -> Self:
        """Collect the inertia of the bodies of a mechanism."""
        bodies = np.array(
            [b for b, body in enumerate(m.bodies) if b and (body.mass or body.moment)], np.intp
        )
        mass, moment = (
            np.array([getattr(m.bodies[b], key) for b in bodies], float)
            for key in ("mass", "moment")
        )
        centre = np.array([m.bodies[b].centre for b in bodies], complex).reshape(-1, 1)
        turning = m.frames.turning[m.frames.body[bodies]]
        fixed = np.diag(m.springs[3]) + turning.T @ (moment[:, None] * turning)
        return cls(bodies, mass, centre, moment, turning, fixed)


MAX_PARALLEL_SINE = 1e-9
"""Largest sine of the angle at which two directions still count as parallel."""


class Projection:
    """The data of a model in its reference pose, projected on the plane of motion.

    Attributes
    ----------
    data : ModelData
    at, turn : ndarray (bodies, 3), (bodies, 3, 3)
        Origins [m] and axes [1] of the bodies in the reference pose.
    axes : ndarray (joints, 3)
        Directions of the joints [1].
    e1, e2, normal : ndarray (3,)
        The plane [1].  The normal is the first hinge's axis, or without hinges it is perpendicular
        to the slides.  e1 is the world's x axis projected on the plane (the y axis if x is the
        normal).
    """

    def __init__(self, data: ModelData):
        self.data, count = data, len(data.bodies)
        self.at, self.turn = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
        for b, body in enumerate(data.bodies[1:], 1):
            self.turn[b] = self.turn[body.parent] @ rotation_matrix(body.turn)
            self.at[b] = self.at[body.parent] + self.turn[body.parent] @ body.place
        carriers = np.array([joint.body for joint in data.joints], np.intp)
        directions = np.array([joint.axis for joint in data.joints]).reshape(-1, 3)
        self.axes = np.einsum("jab,jb->ja", self.turn[carriers], directions)
        self.normal = self._normal()
        x = np.eye(3)[
            0 if np.linalg.norm(np.cross(self.normal, np.eye(3)[0])) > MAX_PARALLEL_SINE else 1
        ]
        e1 = x - (x @ self.normal) * self.normal
        self.e1 = e1 / np.linalg.norm(e1)
        self.e2 = np.cross(self.normal, self.e1)

    def _normal(self) -> Array:
        hinge = np.array([joint.kind == JointKind.HINGE for joint in self.data.joints], bool)
        if not len(self.axes):
            raise NotCovered("a mechanism without joints has no plane of motion")
        are_parallel = (
            np.linalg.norm(np.cross(self.axes[0], self.axes), axis=1).max() <= MAX_PARALLEL_SINE
        )
        pinned = any(loop.kind == EqualityKind.CONNECT for loop in self.data.loops)
        if not hinge.any() and are_parallel and pinned:
            raise NotCovered("a pin between slides along one line constrains nothing across it")
        normal = (
            np.asarray(self.axes[hinge][0])
            if hinge.any()
            else normal_of_slides(self.axes, MAX_PARALLEL_SINE)
        )
        for j, axis in enumerate(self.axes):
            deviation = np.linalg.norm(np.cross(normal, axis)) if hinge[j] else abs(normal @ axis)
            if deviation > MAX_PARALLEL_SINE:
                raise NotCovered(f"joint {self.data.joints[j].name!r} leaves the plane of motion")
        return normal

    def flat(self, vector: Array) -> complex:
        """Part of a vector in the plane, as a complex number."""
        return complex(vector @ self.e1, vector @ self.e2)

    def place(self, body: int, local: Array) -> Array:
        """Position (3,) [m] of a point of a body in the reference pose, given in its axes."""
        return np.asarray(self.at[body] + self.turn[body] @ local)

    def point(self, body: int, local: Array) -> complex:
        """Position in the plane of a point of a body in the reference pose."""
        return self.flat(self.place(body, local))

    def sensor_frame(self, sensor: SensorData) -> tuple[int, Array, Array]:
        """Body, position and axes, in the reference pose, of the frame that a sensor is on."""
        frame = sensor.frame
        axes = self.turn[frame.body] @ rotation_matrix(frame.turn)
        return frame.body, self.place(frame.body, frame.place), axes

    def body(self, body: BodyData, b: int) -> PlanarBody:
        """Project body number b."""
        frame = self.turn[b] @ rotation_matrix(body.inertia_turn)
        return PlanarBody(
            body.name,
            body.parent,
            body.joints,
            body.mass,
            self.point(b, body.centre),
            float((self.normal @ frame) ** 2 @ body.moments),
        )

    def joint(self, joint: JointData, ctrl: Array) -> PlanarJoint:
        """Project a joint, with the constant load of its motors at controls `ctrl`."""
        hinge, axis = joint.kind == JointKind.HINGE, self.axes[joint.pose]
        stiffness, *stiffer = (float(c) for c in joint.stiffness)
        damping, *damped = (float(c) for c in joint.damping[0])
        return PlanarJoint(
            joint.name,
            hinge,
            self.point(joint.body, joint.place) if hinge else self.flat(axis),
            float(np.sign(axis @ self.normal)) if hinge else 1.0,
            joint.zero,
            stiffness,
            float(joint.rest[0]),
            damping,
            float(joint.armature[0]),
            self.load(joint, ctrl),
            joint.stop_range,
            float(joint.friction[0]),
            self.servo(joint),
            (stiffer[0], stiffer[1]),
            (damped[0], damped[1]),
        )

    def stops(self, m: Mechanism, driven: tuple[str, ...] = ()) -> Iterator[Stop]:
        """Make the stops of the joints that are not driven.

        Raises
        ------
        NotCovered
            A limit has no damping ratio.
        """
        for joint in self.data.joints:
            if joint.name not in driven:
                yield from stops_of_joint(joint, float(m.scale[joint.pose]))

    def actuators_of(self, joint: JointData) -> list[ActuatorData]:
        """The actuators that act on a joint.

        Without a law they are on a driven joint, where the drive takes their place.
        """
        return [one for one in self.data.acting if one.pose == joint.pose and one.law]

    def constant_actuators(self, joint: JointData) -> list[ActuatorData]:
        """Actuators of a joint whose forces are part of its `load` and `servo`.

        These are the actuators whose force is linear and has no range of its own.  On a joint with
        a range of actuator forces (on which no servo is allowed) they are all actuators if there
        are several, and none if there is only one.
        """
        there = self.actuators_of(joint)
        if joint.has_force_range:
            return there if len(there) > 1 else []
        return [one for one in there if one.affine]

    def actuators(self) -> Iterator[ActuatorData]:
        """All actuators of joints; those in the joints' own loads have no range."""
        for joint in self.data.joints:
            constant = self.constant_actuators(joint)
            for one in self.actuators_of(joint):
                if one in constant:
                    yield replace(one, range=UNLIMITED)
                elif joint.has_force_range and one.gear:
                    # the range of the joint is one of its only actuator, over its gear
                    lowest, highest = np.sort(np.array(joint.force_range) / one.gear)
                    low, high = np.clip(one.range, lowest, highest).tolist()
                    yield replace(one, range=(low, high))
                else:
                    yield one

    def servo(self, joint: JointData) -> tuple[float, float]:
        """Stiffness and damping of a joint by actuators without a range of forces."""
        found = np.zeros(2)
        for one in self.constant_actuators(joint):
            if one.has_feedback and one.affine:
                found -= one.gear**2 * np.array([one.affine.per_length, one.affine.per_rate])
        return float(found[0]), float(found[1])

    def load(self, joint: JointData, ctrl: Array) -> float:
        """Constant moment or force of the actuators of a joint, within its range of forces.

        For servos it is that at the rest value of the joint's spring, without a rate.
        """
        constant = self.constant_actuators(joint)
        load = sum(float(one.gear * one.force(ctrl[one.place])) for one in constant)
        load -= self.servo(joint)[0] * float(joint.rest[0])
        return float(np.clip(load, *joint.force_range) if constant else load)

    def point_load(self, one: SiteLoad) -> PointLoad:
        """Project the load of an actuator on a site.

        Raises
        ------
        NotCovered
            The load leaves the plane of motion.
        """
        force, moment = one.force, one.moment
        if one.follows:
            force, moment = self.turn[one.body] @ force, self.turn[one.body] @ moment
        across = np.append(force @ self.normal, moment - (moment @ self.normal) * self.normal)
        if np.abs(across).max() > MAX_PARALLEL_SINE * np.abs([force, moment]).max():
            raise NotCovered(
                f"the load of actuator {one.actuator.name!r} leaves the plane of motion"
            )
        return PointLoad(
            one.actuator,
            one.body,
            self.point(one.body, one.at),
            self.flat(force),
            float(moment @ self.normal),
            one.follows,
        )

    def pin(self, loop: LoopData) -> Pin:
        """Project a connect equality."""
        return Pin(
            loop.name,
            loop.one,
            self.point(loop.one, loop.on_one),
            loop.two,
            self.point(loop.two, loop.on_two),
        )

    def coupling(self, tie: TieData) -> Coupling:
        """The equation of an equality of joints or of fixed tendons."""

        def joints(number: int) -> tuple[tuple[int, float], ...]:
            if number < 0:
                return ()
            return self.data.tendons[number].terms if tie.tendons else ((number, 1.0),)

        return Coupling(tie.name, joints(tie.one), joints(tie.two), tuple(tie.polynomial.tolist()))

    def point_spring(self, tendon: TendonData) -> PointSpring:
        """Project a tendon that goes from site to site."""
        (one, on_one), (two, on_two) = tendon.points
        places = self.place(one, on_one), self.place(two, on_two)
        return PointSpring(
            tendon.name,
            one,
            self.flat(places[0]),
            two,
            self.flat(places[1]),
            offset=float((places[0] - places[1]) @ self.normal),
            **spring_of(tendon),
        )


def spring_of(tendon: TendonData) -> dict[str, Any]:
    """The spring and the damper of a tendon, as arguments of a `TendonSpring`."""
    stiffness, *stiffer = map(float, tendon.stiffness)
    damping, *damped = map(float, tendon.damping)
    return {
        "stiffness": stiffness,
        "damping": damping,
        "slack": tendon.slack,
        "stiffness_poly": tuple(stiffer),
        "damping_poly": tuple(damped),
    }


def read(model: Any, start: str) -> tuple[Mechanism, Projection]:
    """Read a planar mechanism.

    Parameters
    ----------
    model : mujoco.MjModel
        Compiled; only its numbers are read.
    start : str
        Name of the key with the start pose; not used in a model without keys.

    Returns
    -------
    Mechanism, Projection

    Raises
    ------
    ValueError
        The model is not a planar mechanism of hinges, slides, equalities of kinds ``connect``,
        ``joint`` and fixed tendons, and springs between two sites; the message names the element.
    """
    return make_mechanism(read_compiled(model), start)


def make_mechanism(data: ModelData, start: str) -> tuple[Mechanism, Projection]:
    """Make the mechanism of a model's data; see `read`."""
    every_joint = tuple(joint.name for joint in data.joints)
    refuse(data, SUPPORT, driven=every_joint)  # `solve` examines actuators of free joints
    refuse_placed_bodies(data)
    plane, key = Projection(data), data.key(start)
    springs = (
        SumSpring(tendon.name, tendon.terms, **spring_of(tendon))
        for tendon in data.tendons
        if tendon.way == TendonWay.SUM
    )
    return Mechanism(
        tuple(plane.body(body, b) for b, body in enumerate(data.bodies)),
        tuple(plane.joint(joint, key.ctrl) for joint in data.joints),
        tuple(map(plane.pin, data.loops)),
        tuple(map(plane.coupling, data.ties)),
        plane.flat(data.options.gravity),
        key.pose,
        key.rates,
        tuple(plane.point_spring(one) for one in data.tendons if one.way != TendonWay.SUM),
        tuple(plane.actuators()),
        key.ctrl,
        tuple(map(plane.point_load, data.site_loads)),
        tuple(one for one in springs if one.has_force),
    ), plane
