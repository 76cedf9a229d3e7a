"""Forces on the joints of a mechanism, of its drives and loops, and between its bodies.

Generalized forces and the mass matrix are sums over the bodies, projected by their Jacobians.
"""

from dataclasses import dataclass

import numpy as np

from proofmass.analytic.mjcf import carried_bodies
from proofmass.analytic.numerics import cross
from proofmass.analytic.planar.kinematics import (
    BodyMotion,
    Drives,
    jacobian,
    loop_jacobian,
    weighted_sum,
)
from proofmass.analytic.planar.mechanism import Mechanism, PlanarJoint, TendonSpring
from proofmass.base.arrays import Array, Complex


def centre_jacobians(m: Mechanism, motion: BodyMotion) -> Complex:
    """Derivatives of the centres of the bodies that have inertia by the joints (n, k, joints)."""
    own = m.inertia
    return jacobian(m, motion, own.bodies, motion.points(own.bodies, own.centre))


def applied_forces(
    m: Mechanism,
    motion: BodyMotion,
    centre: Complex,
    q: Array,
    v: Array | float = 0.0,
    ctrl: Array | None = None,
) -> Array:
    """Generalized forces of gravity, springs, dampers and actuators (n, joints) [N m, or N].

    The controls are `ctrl` (n, controls), by default those of the key.
    """
    rest, stiffness, damping, _, load = m.springs
    weight = m.inertia.mass @ (centre.real * m.gravity.real + centre.imag * m.gravity.imag)
    found = (
        load - stiffness * (q - rest) - damping * v + weight + actuator_corrections(m, q, v, ctrl)
    )
    if m.polynomials:
        stiffer, damped = m.polynomials
        found = (
            found
            - polynomial_force(stiffer, q - rest, q - rest)
            - polynomial_force(damped, v, np.abs(v))
        )
    for k, spring in enumerate(m.point_springs):
        if spring.has_force:
            length = spring_length(m, motion, k)
            rate = (length.rows * v).sum(axis=-1) if spring.has_damping else 0.0
            found = found + tension(spring, length.value, rate)[:, None] * -length.rows
    for one in m.sum_springs:
        rates = np.broadcast_to(v, q.shape)
        pull = tension(one, weighted_sum(one.joints, q), weighted_sum(one.joints, rates))
        for j, share in one.joints:
            found[:, j] -= share * pull
    return np.asarray(found + loads_on_joints(m, motion, ctrl) if m.point_loads else found)


def polynomial_force(
    poly: tuple[Array, Array] | tuple[float, float], extent: Array | float, variable: Array | float
) -> Array:
    """Force of the linear and quadratic terms of a stiffness or a damping.

    These are polynomials of `variable`, and `extent` is the stretch or the rate that they multiply.
    """
    linear, square = poly
    return np.asarray(extent * variable * (linear + square * variable))


def motor_forces(m: Mechanism, q: Array, v: Array, ctrl: Array | None = None) -> Array:
    """Generalized forces of motors and servos (n, joints) [N m or N]."""
    rest, _, _, _, load = m.springs
    stiffness, damping = np.array([joint.servo for joint in m.joints], float).reshape(-1, 2).T
    return np.asarray(
        load - stiffness * (q - rest) - damping * v + actuator_corrections(m, q, v, ctrl)
    )


def actuator_corrections(
    m: Mechanism, q: Array, v: Array | float, ctrl: Array | None
) -> Array | float:
    """Generalized forces of actuators that are not in the joints' own loads (n, joints) [N m or N].

    These are the forces of actuators that have a range of forces or are not linear, and the change
    of the forces of the others against those with the controls of the key.
    """
    if ctrl is None and all(one.affine for one in m.actuators):
        return 0.0
    found, rates = np.zeros_like(q), np.broadcast_to(v, q.shape)
    for one in m.actuators:
        key = m.ctrl[[one.place]]
        control = key if ctrl is None else ctrl[:, one.place]
        j, gear = one.rate, one.gear
        if one.affine is None:
            found[:, j] += gear * one.force(control, gear * q[:, j], gear * rates[:, j])
        elif ctrl is not None:
            # the joint's load has its force at the key's control, the joint's servo its feedback
            gain, clipped = one.affine.gain, one.clipped(control)
            found[:, j] += gear * (gain * clipped - gain * one.clipped(key))
    return found


def point_load_forces(
    m: Mechanism, motion: BodyMotion, ctrl: Array | None
) -> tuple[Complex, Array]:
    """Forces [N] and moments [N m] of the loads at points, in n poses (loads, n)."""
    force = np.empty((len(m.point_loads), motion.place.shape[1]), complex)
    moment = np.empty(force.shape)
    for k, load in enumerate(m.point_loads):
        place = load.actuator.place
        size = load.actuator.force(m.ctrl[[place]] if ctrl is None else ctrl[:, place])
        force[k] = size * load.force * (motion.w[0][load.body] if load.follows else 1.0)
        moment[k] = size * load.moment
    return force, moment


def loads_on_joints(m: Mechanism, motion: BodyMotion, ctrl: Array | None) -> Array:
    """Generalized forces of the loads at points (n, joints) [N m or N]."""
    bodies, points = m.loaded_points
    moves = jacobian(m, motion, bodies, motion.points(bodies, points))
    force, moment = point_load_forces(m, motion, ctrl)
    pushed = (force.conj().T[..., None] * moves).real.sum(axis=1)
    return np.asarray(pushed + moment.T @ m.frames.turning[m.frames.body[bodies]])


@dataclass(frozen=True)
class SpringLength:
    """Lengths of a spring between points in n poses.

    Attributes
    ----------
    value : ndarray (n,)
        Lengths [m].
    along : ndarray (n,), complex
        In-plane part of the unit vector from its second point to its first [1]; 0 if the length
        is 0.
    rows : ndarray (n, joints)
        Derivatives of the length by the joints [m/rad or 1].
    """

    value: Array
    along: Complex
    rows: Array


def spring_length(m: Mechanism, motion: BodyMotion, k: int) -> SpringLength:
    """Lengths of spring number k between points."""
    spring = m.point_springs[k]
    bodies = np.array([spring.one, spring.two], np.intp)
    points = motion.points(bodies, np.array([[spring.on_one], [spring.on_two]]))
    difference, moves = points[0] - points[1], jacobian(m, motion, bodies, points)
    value = np.hypot(np.abs(difference), spring.offset)
    along = difference / np.where(value > 0, value, 1.0)
    rows = (along.conj()[:, None] * (moves[:, 0] - moves[:, 1])).real
    return SpringLength(value, along, rows)


def tension(spring: TendonSpring, length: Array, rate: Array | float) -> Array:
    """Pull [N or N m] (n,) of a spring and damper at lengths [m or rad] and their rates [1/s]."""
    stretch = spring.stretch(length)
    found = spring.stiffness * stretch + spring.damping * rate
    if any(spring.stiffness_poly):
        found = found + polynomial_force(spring.stiffness_poly, stretch, stretch)
    if any(spring.damping_poly):
        found = found + polynomial_force(spring.damping_poly, rate, np.abs(rate))
    return np.asarray(found)


def mass_matrix(m: Mechanism, centre: Complex) -> Array:
    """Mass matrix of the joints without loop constraints (n, joints, joints)."""
    weighted = np.sqrt(m.inertia.mass)[:, None] * centre
    x, y = weighted.real, weighted.imag
    return np.asarray(m.inertia.fixed + x.swapaxes(1, 2) @ x + y.swapaxes(1, 2) @ y)


def inertial_forces(m: Mechanism, centre: Complex, motion: BodyMotion) -> Array:
    """Generalized inertial forces (n, joints) of the centres' accelerations in a motion.

    With joints that do not accelerate these are the Coriolis and centrifugal terms.
    """
    own = m.inertia
    centre_forces = own.mass * motion.points(own.bodies, own.centre, 2).T
    projected = (
        centre_forces.real[:, None] @ centre.real + centre_forces.imag[:, None] @ centre.imag
    )
    return np.asarray(projected[:, 0])


@dataclass(frozen=True)
class Forces:
    """Forces of drives and loops in n poses of a motion.

    Attributes
    ----------
    drives : ndarray (n, drives)
        Moment [N m] of each drive on its joint, or force [N] on a slide.
    loops : ndarray (n, rows)
        Lagrange multipliers of the loop equations: x and y of the force of each pin on its first
        body [N], then those of the couplings [N m].
    """

    drives: Array
    loops: Array


def solve_forces(
    m: Mechanism,
    motion: BodyMotion,
    joint: tuple[Array, Array, Array],
    d: Drives,
    friction: Array | float = 0.0,
    ctrl: Array | None = None,
) -> Forces:
    r"""Forces of drives and loops that a motion requires, by inverse dynamics.

    ::

        M(q) q'' + h(q, q') - Q(q, q') = A^T lambda + S^T tau

    A is the Jacobian of the loops, and S has the rows of the drives.  The equations of the joints
    that follow give lambda, then those of the driven joints give tau.  At rest this is the
    principle of virtual work: tau balances the applied forces along the motion of the drive.

    Parameters
    ----------
    m : Mechanism
    motion : BodyMotion
        With rates and accelerations.
    joint : three ndarray (n, joints)
        Joint values, rates, accelerations [rad or m, per s, per s^2].
    d : Drives
        In a free motion all joints follow.
    friction : ndarray (n, joints)
        Dry friction of the joints, positive against a positive rate [N m or N].
    ctrl : ndarray (n, controls)
        By default those of the key [SI].
    """
    q, v, a = joint
    centre = centre_jacobians(m, motion)
    needed = inertial_forces(m, centre, motion) + a @ m.inertia.fixed + friction
    needed -= applied_forces(m, motion, centre, q, v, ctrl)
    needed[:, d.driven] += motor_forces(m, q, v, ctrl)[:, d.driven]  # its own motor is the drive
    matrix = loop_jacobian(m, q)
    # the drives' moments are in no equation of the joints that follow, which give the multipliers
    following_rows = matrix[..., d.following].swapaxes(1, 2)
    right = needed[:, d.following, None]
    square = (
        following_rows.shape[1] == following_rows.shape[2]
    )  # in a free motion there are more rows than columns
    solved = (
        np.linalg.solve(following_rows, right) if square else np.linalg.pinv(following_rows) @ right
    )
    loops = np.asarray(solved[..., 0], float)
    drives = needed[:, d.driven] - (loops[:, None] @ matrix[..., d.driven])[:, 0]
    return Forces(drives, loops)


def transmitted_force(
    m: Mechanism,
    motion: BodyMotion,
    loops: Array,
    body: int,
    points: Complex,
    ctrl: Array | None = None,
) -> tuple[Complex, Array]:
    """Force [N] and moment about points `points` (n,) [N m] on a body from its parent (n,).

    By Newton's and Euler's equations for the body and all bodies that it carries: their inertia and
    weight, less the forces of loops, springs between points and loads at points on them.

    Parameters
    ----------
    m : Mechanism
    motion : BodyMotion
        With rates and accelerations.
    loops : ndarray (n, rows)
        See `Forces` [N, N m].
    body : int
    points : ndarray (n,), complex
        Points in the plane [m].
    ctrl : ndarray (n, controls)
        By default those of the key [SI].
    """
    carried = carried_bodies([one.parent for one in m.bodies], body)
    force, moment = np.zeros(points.shape, complex), np.zeros(points.shape)
    for b in carried:
        one = m.bodies[b]
        part = one.mass * (motion.point(b, one.centre, 2) - m.gravity)
        arm = motion.point(b, one.centre) - points
        force, moment = force + part, moment + one.moment * motion.turn[2][b] + cross(arm, part)
    for k, pin in enumerate(m.pins):
        pull = loops[:, 2 * k] + 1j * loops[:, 2 * k + 1]
        for b, on, sign in ((pin.one, pin.on_one, 1.0), (pin.two, pin.on_two, -1.0)):
            if b in carried:
                force = force - sign * pull
                moment = moment - sign * cross(motion.point(b, on) - points, pull)
    for k, spring in enumerate(m.point_springs):
        ends = (spring.one, spring.on_one, -1.0), (spring.two, spring.on_two, 1.0)
        if (spring.one in carried) == (spring.two in carried):
            continue
        length = spring_length(m, motion, k)
        speeds = [motion.point(b, on, 1) for b, on, _ in ends]
        rate = (length.along.conj() * (speeds[0] - speeds[1])).real
        pull = tension(spring, length.value, rate) * length.along
        for b, on, sign in ends:
            if b in carried:
                force = force - sign * pull
                moment = moment - sign * cross(motion.point(b, on) - points, pull)
    for load, push, turn in zip(m.point_loads, *point_load_forces(m, motion, ctrl), strict=True):
        if load.body in carried:
            force = force - push
            moment = moment - turn - cross(motion.point(load.body, load.point) - points, push)
    return force, moment


def potential_energy(m: Mechanism, motion: BodyMotion, q: Array) -> Array:
    """Potential energy of gravity and of springs [J] (n,)."""
    energy = sum(spring_energy(j, q[:, k] - j.rest) for k, j in enumerate(m.joints))
    for k, spring in enumerate(m.point_springs):
        stretch = spring.stretch(spring_length(m, motion, k).value)
        energy = energy + spring_energy(spring, stretch)
    for one in m.sum_springs:
        energy = energy + spring_energy(one, one.stretch(weighted_sum(one.joints, q)))
    for b, body in enumerate(m.bodies):
        energy = energy - body.mass * (motion.point(b, body.centre).conj() * m.gravity).real
    return np.asarray(energy)


def spring_energy(spring: PlanarJoint | TendonSpring, stretch: Array) -> Array:
    """Energy of a spring [J] (n,)."""
    linear, square = spring.stiffness_poly
    return np.asarray(
        stretch**2 * (spring.stiffness / 2 + stretch * (linear / 3 + square / 4 * stretch))
    )


def kinetic_energy(m: Mechanism, motion: BodyMotion, v: Array) -> Array:
    """Kinetic energy [J] (n,)."""
    energy = sum(0.5 * j.armature * v[:, k] ** 2 for k, j in enumerate(m.joints))
    for b, body in enumerate(m.bodies):
        energy = energy + 0.5 * (
            body.mass * np.abs(motion.point(b, body.centre, 1)) ** 2
            + body.moment * motion.turn[1][b] ** 2
        )
    return np.asarray(energy)
