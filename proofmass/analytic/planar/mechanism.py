"""Data of a planar mechanism: bodies in a tree of joints, and the loops that close it.

The plane is the complex plane.  All points are given in the *reference pose*, in which every joint
has its zero value; a pose displaces each body from there by ``z -> w z + t``, |w| = 1.

`read` makes a `Mechanism` from the numbers of a compiled MJCF; MuJoCo's kinematics is not used.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.controls import UNLIMITED, AffineActuator, SiteLoad
from proofmass.analytic.features import may_touch
from proofmass.analytic.names import equality_name
from proofmass.analytic.numerics import CannotMove, NotCovered, normal_of_slides
from proofmass.analytic.planar.support import SUPPORT
from proofmass.analytic.stops import Stop, read_stops
from proofmass.analytic.support import refuse
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
class Body:
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

    actuator: AffineActuator
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
    actuators : tuple of AffineActuator
        Actuators of the joints.  The forces of those without a range of forces, at the controls of
        the key, are part of `load` and `servo` of the joints.
    ctrl : ndarray (controls,)
        Controls of the key [SI].
    point_loads : tuple of PointLoad
        Loads of the actuators on sites.
    sum_springs : tuple of SumSpring
        Springs and dampers of the fixed tendons that have any.
    """

    bodies: tuple[Body, ...]
    joints: tuple[PlanarJoint, ...]
    pins: tuple[Pin, ...]
    couplings: tuple[Coupling, ...]
    gravity: complex
    start: Array
    start_rate: Array
    point_springs: tuple[PointSpring, ...] = ()
    actuators: tuple[AffineActuator, ...] = ()
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
    def ends(self) -> tuple[Index, Complex]:
        """Bodies (2 pins,) and points (2 pins, 1): the first ends of all pins, then the second."""
        bodies = [getattr(p, k) for k in ("one", "two") for p in self.pins]
        points = [getattr(p, k) for k in ("on_one", "on_two") for p in self.pins]
        return np.array(bodies, np.intp), np.array(points, complex).reshape(-1, 1)

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
DISABLE_FLAG = mujoco.mjtDisableBit


class Reader:
    """The reference pose of a compiled model in space, and its plane of motion.

    Attributes
    ----------
    at, turn : ndarray (bodies, 3), (bodies, 3, 3)
        Origins and axes of the bodies in the reference pose.
    e1, e2, normal : ndarray (3,)
        The plane.  The normal is the first hinge's axis, or without hinges it is perpendicular to
        the slides.  e1 is the world's x axis projected on the plane (the y axis if x is the
        normal).
    """

    def __init__(self, model: Any):
        self.model = model
        self.at, self.turn = np.zeros((model.nbody, 3)), np.tile(np.eye(3), (model.nbody, 1, 1))
        for b in range(1, model.nbody):
            parent = model.body_parentid[b]
            self.turn[b] = self.turn[parent] @ rotation_matrix(model.body_quat[b])
            self.at[b] = self.at[parent] + self.turn[parent] @ model.body_pos[b]
        self.axes = np.einsum("jab,jb->ja", self.turn[model.jnt_bodyid], model.jnt_axis)
        self.normal = self._normal()
        x = np.eye(3)[
            0 if np.linalg.norm(np.cross(self.normal, np.eye(3)[0])) > MAX_PARALLEL_SINE else 1
        ]
        e1 = x - (x @ self.normal) * self.normal
        self.e1 = e1 / np.linalg.norm(e1)
        self.e2 = np.cross(self.normal, self.e1)

    def _normal(self) -> Array:
        hinge = self.model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
        if not len(self.axes):
            raise NotCovered("a mechanism without joints has no plane of motion")
        are_parallel = (
            np.linalg.norm(np.cross(self.axes[0], self.axes), axis=1).max() <= MAX_PARALLEL_SINE
        )
        pinned = mujoco.mjtEq.mjEQ_CONNECT in self.model.eq_type[self.model.eq_active0 > 0]
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
                raise NotCovered(f"joint {self.model.joint(j).name!r} leaves the plane of motion")
        return normal

    def flat(self, vector: Array) -> complex:
        """Part of a vector in the plane, as a complex number."""
        return complex(vector @ self.e1, vector @ self.e2)

    def point(self, body: int, local: Array) -> complex:
        """Position of a point of a body in the reference pose, given in the body's axes."""
        return self.flat(self.at[body] + self.turn[body] @ local)

    def joint(self, j: int, ctrl: Array) -> PlanarJoint:
        """Read joint number j, with the constant load of its motors at controls `ctrl`."""
        model, dof, adr = self.model, self.model.jnt_dofadr[j], self.model.jnt_qposadr[j]
        hinge = model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
        place = (
            self.point(model.jnt_bodyid[j], model.jnt_pos[j]) if hinge else self.flat(self.axes[j])
        )
        return PlanarJoint(
            model.joint(j).name,
            bool(hinge),
            place,
            float(np.sign(self.axes[j] @ self.normal)) if hinge else 1.0,
            float(model.qpos0[adr]),
            self.zero_if_disabled(DISABLE_FLAG.mjDSBL_SPRING, model.jnt_stiffness[j]),
            float(model.qpos_spring[adr]),
            self.zero_if_disabled(DISABLE_FLAG.mjDSBL_DAMPER, model.dof_damping[dof]),
            float(model.dof_armature[dof]),
            self.load(j, ctrl),
            (float(model.jnt_range[j, 0]), float(model.jnt_range[j, 1]))
            if model.jnt_limited[j]
            and not is_disabled(model, DISABLE_FLAG.mjDSBL_LIMIT, DISABLE_FLAG.mjDSBL_CONSTRAINT)
            else (-np.inf, np.inf),
            0.0
            if is_disabled(model, DISABLE_FLAG.mjDSBL_FRICTIONLOSS, DISABLE_FLAG.mjDSBL_CONSTRAINT)
            else float(model.dof_frictionloss[dof]),
            self.servo(j),
            self.growth(DISABLE_FLAG.mjDSBL_SPRING, model.jnt_stiffnesspoly[j]),
            self.growth(DISABLE_FLAG.mjDSBL_DAMPER, model.dof_dampingpoly[dof]),
        )

    def stops(self, m: "Mechanism", driven: tuple[str, ...] = ()) -> Iterator[Stop]:
        """Read the stops of the joints that are not driven.

        Raises
        ------
        NotCovered
            A limit has a margin, or has no damping ratio.
        """
        for j, joint in enumerate(m.joints):
            if joint.name not in driven:
                yield from read_stops(self.model, j, joint.range, j, j, float(m.scale[j]))

    def constant_actuators(self, j: int) -> list[int]:
        """Actuators of joint number j whose forces are part of its `load` and `servo`.

        These are the actuators whose own force has no range.  On a joint with a range of actuator
        forces (on which no servo is allowed) they are all actuators if there are several, and none
        if there is only one.
        """
        there = actuators_of_joint(self.model, j)
        if self.model.jnt_actfrclimited[j]:
            return there if len(there) > 1 else []
        return [a for a in there if not self.model.actuator_forcelimited[a]]

    def actuators(self) -> Iterator[AffineActuator]:
        """Read all actuators of joints; those in the joints' own loads are read without a range."""
        for j in range(self.model.njnt):
            constant = self.constant_actuators(j)
            for a in actuators_of_joint(self.model, j):
                one = read_actuator(self.model, a)
                if a in constant:
                    yield replace(one, range=UNLIMITED)
                elif self.model.jnt_actfrclimited[j] and one.gear:
                    lowest, highest = np.sort(self.model.jnt_actfrcrange[j] / one.gear)
                    low, high = np.clip(one.range, lowest, highest).tolist()
                    yield replace(one, range=(low, high))
                else:
                    yield one

    def point_load(self, a: int) -> PointLoad:
        """Read the load of actuator number a on a site.

        Raises
        ------
        NotCovered
            The load leaves the plane of motion.
        """
        one = read_site_load(self.model, a)
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

    def servo(self, j: int) -> tuple[float, float]:
        """Stiffness and damping of joint number j by actuators without a range of forces."""
        model, found = self.model, np.zeros(2)
        for a in self.constant_actuators(j):
            if is_affine(model, a):
                gear = model.actuator_gear[model.actuator_outadr[a], 0]
                found -= gear**2 * model.actuator_biasprm[a, 1:3]
        return float(found[0]), float(found[1])

    def load(self, j: int, ctrl: Array) -> float:
        """Constant moment or force of the actuators of joint number j, within its range of forces.

        For servos it is that at the rest value of the joint's spring, without a rate.
        """
        model, constant = self.model, self.constant_actuators(j)
        load = sum(self.motor(a, ctrl) for a in constant)
        load -= self.servo(j)[0] * float(model.qpos_spring[model.jnt_qposadr[j]])
        limited = constant and model.jnt_actfrclimited[j]
        return float(np.clip(load, *model.jnt_actfrcrange[j]) if limited else load)

    def motor(self, a: int, ctrl: Array) -> float:
        """Moment or force of motor number a, with control and force clipped to their ranges."""
        model, control = self.model, ctrl[self.model.actuator_ctrladr[a]]
        if model.actuator_ctrllimited[a] and not is_disabled(model, DISABLE_FLAG.mjDSBL_CLAMPCTRL):
            control = np.clip(control, *model.actuator_ctrlrange[a])
        force = model.actuator_gainprm[a, 0] * control
        force += model.actuator_biasprm[a, 0] * is_affine(model, a)
        if model.actuator_forcelimited[a]:
            force = np.clip(force, *model.actuator_forcerange[a])
        return float(model.actuator_gear[model.actuator_outadr[a], 0] * force)

    def zero_if_disabled(self, flag: int, value: float) -> float:
        """The value, or zero if the model sets the disable flag."""
        return 0.0 if is_disabled(self.model, flag) else float(value)

    def growth(self, flag: int, values: Array) -> tuple[float, float]:
        """Polynomial coefficients of a stiffness or a damping; zeros if the model disables it."""
        one, two = (self.zero_if_disabled(flag, value) for value in values)
        return one, two

    def body(self, b: int) -> Body:
        """Read body number b."""
        model = self.model
        frame = self.turn[b] @ rotation_matrix(model.body_iquat[b])
        moment = float((self.normal @ frame) ** 2 @ model.body_inertia[b])
        first = model.body_jntadr[b]
        joints = tuple(range(first, first + model.body_jntnum[b])) if first >= 0 else ()
        return Body(
            model.body(b).name,
            int(model.body_parentid[b]),
            joints,
            float(model.body_mass[b]),
            self.point(b, model.body_ipos[b]),
            moment,
        )

    def pin(self, e: int) -> Pin:
        """Read connect equality number e."""
        model = self.model
        one, two = model.eq_obj1id[e], model.eq_obj2id[e]
        places = model.eq_data[e, :3], model.eq_data[e, 3:6]
        if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
            places = model.site_pos[one], model.site_pos[two]
            one, two = model.site_bodyid[one], model.site_bodyid[two]
        return Pin(
            equality_name(model, e),
            int(one),
            self.point(one, places[0]),
            int(two),
            self.point(two, places[1]),
        )

    def point_spring(self, t: int) -> PointSpring:
        """Read tendon number t, which goes from site to site."""
        model, first = self.model, self.model.tendon_adr[t]
        one, two = model.wrap_objid[first : first + 2]
        bodies = [int(model.site_bodyid[site]) for site in (one, two)]
        places = [
            self.at[body] + self.turn[body] @ model.site_pos[site]
            for body, site in zip(bodies, (one, two), strict=True)
        ]
        return PointSpring(
            model.tendon(t).name,
            bodies[0],
            self.flat(places[0]),
            bodies[1],
            self.flat(places[1]),
            offset=float((places[0] - places[1]) @ self.normal),
            **self.tendon(t),
        )

    def sum_springs(self) -> Iterator[SumSpring]:
        """Read all fixed tendons."""
        for t in range(self.model.ntendon):
            if is_fixed_tendon(self.model, t):
                yield SumSpring(self.model.tendon(t).name, self.fixed(t), **self.tendon(t))

    def tendon(self, t: int) -> dict[str, Any]:
        """Read the spring and the damper of tendon number t."""
        model = self.model
        return {
            "stiffness": self.zero_if_disabled(
                DISABLE_FLAG.mjDSBL_SPRING, model.tendon_stiffness[t]
            ),
            "damping": self.zero_if_disabled(DISABLE_FLAG.mjDSBL_DAMPER, model.tendon_damping[t]),
            "slack": tuple(map(float, model.tendon_lengthspring[t])),
            "stiffness_poly": self.growth(
                DISABLE_FLAG.mjDSBL_SPRING, model.tendon_stiffnesspoly[t]
            ),
            "damping_poly": self.growth(DISABLE_FLAG.mjDSBL_DAMPER, model.tendon_dampingpoly[t]),
        }

    def coupling(self, e: int) -> Coupling:
        """Read equality number e of joints or of fixed tendons."""
        model = self.model
        tendons = model.eq_type[e] == mujoco.mjtEq.mjEQ_TENDON

        def joints(number: int) -> tuple[tuple[int, float], ...]:
            if number < 0:
                return ()
            return self.fixed(number) if tendons else ((number, 1.0),)

        return Coupling(
            equality_name(model, e),
            joints(int(model.eq_obj1id[e])),
            joints(int(model.eq_obj2id[e])),
            tuple(float(c) for c in model.eq_data[e, :5]),
        )

    def fixed(self, t: int) -> tuple[tuple[int, float], ...]:
        """Joints of fixed tendon number t, and their weights."""
        model, first = self.model, int(self.model.tendon_adr[t])
        wraps = range(first, first + int(model.tendon_num[t]))
        return tuple((int(model.wrap_objid[w]), float(model.wrap_prm[w])) for w in wraps)


def read_actuator(model: Any, a: int) -> AffineActuator:
    """Read actuator number a of a compiled model, on a joint or a tendon."""
    target, on_joint = int(model.actuator_trnid[a, 0]), acts_on_joint(model, a)
    bias = model.actuator_biasprm[a, :3] * is_affine(model, a)
    clamped = model.actuator_ctrllimited[a] and not is_disabled(
        model, DISABLE_FLAG.mjDSBL_CLAMPCTRL
    )
    return AffineActuator(
        model.actuator(a).name,
        -1 if on_joint else target,
        int(model.jnt_qposadr[target]) if on_joint else -1,
        int(model.jnt_dofadr[target]) if on_joint else -1,
        float(model.actuator_gear[model.actuator_outadr[a], 0]),
        int(model.actuator_ctrladr[a]),
        float(model.actuator_gainprm[a, 0]),
        float(bias[0]),
        float(bias[1]),
        float(bias[2]),
        limited_range(model.actuator_forcerange[a], bool(model.actuator_forcelimited[a])),
        limited_range(model.actuator_ctrlrange[a], bool(clamped)),
    )


def read_site_load(model: Any, a: int) -> SiteLoad:
    """Read the load of actuator number a of a compiled model, which acts on a site."""
    site, frame = map(int, model.actuator_trnid[a])
    turn = rotation_matrix(model.site_quat[site if frame < 0 else frame])
    carrier = 0 if frame < 0 else int(model.site_bodyid[frame])
    while carrier:
        turn, carrier = (
            rotation_matrix(model.body_quat[carrier]) @ turn,
            int(model.body_parentid[carrier]),
        )
    force, moment = model.actuator_gear[model.actuator_outadr[a]].reshape(2, 3) @ turn.T
    return SiteLoad(
        replace(read_actuator(model, a), tendon=-1, gear=1.0),
        int(model.site_bodyid[site]),
        np.array(model.site_pos[site]),
        force,
        moment,
        frame < 0,
    )


def limited_range(values: Array, limited: bool) -> tuple[float, float]:
    """Ends of a range; infinite if there is none."""
    return (float(values[0]), float(values[1])) if limited else (-np.inf, np.inf)


def is_disabled(model: Any, *flags: int) -> bool:
    """Whether a model sets one of some disable flags."""
    return any(model.opt.disableflags & int(flag) for flag in flags)


def actuators_of_joint(model: Any, j: int) -> list[int]:
    """Numbers of the actuators that act on joint number j."""
    return [
        a
        for a in enabled_actuators(model)
        if model.actuator_trnid[a, 0] == j and acts_on_joint(model, a)
    ]


def enabled_actuators(model: Any) -> list[int]:
    """Numbers of the actuators that a model does not disable."""
    if is_disabled(model, DISABLE_FLAG.mjDSBL_ACTUATION):
        return []
    return [
        a
        for a in range(model.nactuator)
        if not model.opt.disableactuator & 1 << int(model.actuator_group[a])
    ]


def is_site_motor(model: Any, a: int) -> bool:
    """Whether actuator number a is a motor on a site, in directions of its body or the ground."""
    if model.actuator_trntype[a] != mujoco.mjtTrn.mjTRN_SITE or is_affine(model, a):
        return False
    frame = int(model.actuator_trnid[a, 1])
    return frame < 0 or model.body_weldid[model.site_bodyid[frame]] == 0


def acts_on_joint(model: Any, a: int) -> bool:
    """Whether actuator number a acts on a joint."""
    return int(model.actuator_trntype[a]) in (
        mujoco.mjtTrn.mjTRN_JOINT,
        mujoco.mjtTrn.mjTRN_JOINTINPARENT,
    )


def carried_bodies(parents: Sequence[int], body: int) -> set[int]:
    """Numbers of a body and of all bodies that it carries, by the parents of all bodies.

    >>> carried_bodies([0, 0, 1, 0, 2], 1)
    {1, 2, 4}
    """
    found = {body}
    for b, parent in enumerate(parents):
        if b and parent in found:
            found.add(b)
    return found


def rotation_matrix(quaternion: Array) -> Array:
    """Rotation matrix of a unit quaternion (w, x, y, z)."""
    w, (x, y, z) = quaternion[0], quaternion[1:]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


def sensor_place(model: Any, s: int) -> tuple[int, Array, Array]:
    """Body of the object that sensor number s is on; its position and quaternion in that body.

    Raises
    ------
    NotCovered
        The object is a camera that moves relative to its body.
    """
    kind, i = mujoco.mjtObj(int(model.sensor_objtype[s])), int(model.sensor_objid[s])
    if kind == mujoco.mjtObj.mjOBJ_CAMERA and (
        model.cam_mode[i] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    ):
        raise NotCovered(
            f"sensor {model.sensor(s).name!r} is on camera {model.camera(i).name!r}, which is not "
            "fixed to its body: its mode must be fixed"
        )
    body, position, quaternion = {
        mujoco.mjtObj.mjOBJ_SITE: lambda: (
            model.site_bodyid[i],
            model.site_pos[i],
            model.site_quat[i],
        ),
        mujoco.mjtObj.mjOBJ_GEOM: lambda: (
            model.geom_bodyid[i],
            model.geom_pos[i],
            model.geom_quat[i],
        ),
        mujoco.mjtObj.mjOBJ_CAMERA: lambda: (
            model.cam_bodyid[i],
            model.cam_pos[i],
            model.cam_quat[i],
        ),
        mujoco.mjtObj.mjOBJ_BODY: lambda: (i, model.body_ipos[i], model.body_iquat[i]),
        mujoco.mjtObj.mjOBJ_XBODY: lambda: (i, np.zeros(3), np.array([1.0, 0, 0, 0])),
    }[kind]()
    return int(body), np.array(position), np.array(quaternion)


def read(model: Any, start: str) -> tuple[Mechanism, Reader]:
    """Read a planar mechanism.

    Parameters
    ----------
    model : mujoco.MjModel
        Compiled; only its numbers are read.
    start : str
        Name of the key with the start pose; not used in a model without keys.

    Returns
    -------
    Mechanism, Reader

    Raises
    ------
    ValueError
        The model is not a planar mechanism of hinges, slides, equalities of kinds ``connect``,
        ``joint`` and fixed tendons, and springs between two sites; the message names the element.
    """
    every_joint = tuple(model.joint(j).name for j in range(model.njnt))
    refuse(model, SUPPORT, driven=every_joint)  # `solve` examines actuators of free joints
    reader = Reader(model)
    names = [model.key(k).name for k in range(model.nkey)]
    if names and start not in names:
        raise ValueError(f"no key {start!r}; there are: {', '.join(names)}")
    key = names.index(start) if names else -1
    ctrl = model.key_ctrl[key] if names else np.zeros(model.nu)
    active = (
        []
        if is_disabled(model, DISABLE_FLAG.mjDSBL_EQUALITY, DISABLE_FLAG.mjDSBL_CONSTRAINT)
        else [e for e in range(model.neq) if model.eq_active0[e]]
    )
    connects = [e for e in active if model.eq_type[e] == mujoco.mjtEq.mjEQ_CONNECT]
    gravity = reader.zero_if_disabled(DISABLE_FLAG.mjDSBL_GRAVITY, 1.0) * model.opt.gravity
    return Mechanism(
        tuple(reader.body(b) for b in range(model.nbody)),
        tuple(reader.joint(j, ctrl) for j in range(model.njnt)),
        tuple(reader.pin(e) for e in connects),
        tuple(reader.coupling(e) for e in active if e not in connects),
        reader.flat(gravity),
        np.array(model.key_qpos[key] if names else model.qpos0),
        np.array(model.key_qvel[key] if names else np.zeros(model.nv)),
        tuple(
            reader.point_spring(t) for t in range(model.ntendon) if not is_fixed_tendon(model, t)
        ),
        tuple(reader.actuators()),
        np.array(ctrl),
        tuple(reader.point_load(a) for a in enabled_actuators(model) if is_site_motor(model, a)),
        tuple(one for one in reader.sum_springs() if one.has_force),
    ), reader


def is_affine(model: Any, a: int) -> bool:
    """Whether the force of actuator number a depends linearly on its length and rate."""
    return bool(model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_AFFINE)


def is_fixed_tendon(model: Any, t: int) -> bool:
    """Whether tendon number t is fixed: a weighted sum of joint values."""
    return bool(model.wrap_type[model.tendon_adr[t]] == mujoco.mjtWrap.mjWRAP_JOINT)


def refuse_contacts(model: Any) -> None:
    """Raise NotCovered if bodies of the model may touch: contacts are not covered."""
    if may_touch(model):
        raise NotCovered(
            'contacts are not covered by a free motion: give <option> a <flag contact="disable"/>'
        )
