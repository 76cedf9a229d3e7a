"""Forces of a mechanism on its joints, and its mass: sums over bodies of force times Jacobian."""

import numpy as np

from proofmass.analytic.numerics import Array, Complex
from proofmass.analytic.planar.closure import Drives
from proofmass.analytic.planar.loops import loop_jacobian
from proofmass.analytic.planar.mechanism import Mechanism
from proofmass.analytic.planar.motion import Motion, jacobian, move

Carried = list[tuple[int, Complex, Array]]


def carriers(m: Mechanism, motion: Motion) -> Carried:
    """Bodies with inertia: number, Jacobian of the centre (n, joints), of the turn (joints,)."""
    turning = m.moved_by * m.hinges * m.signs
    return [(b, jacobian(m, motion, b, motion.point(b, body.centre)), turning[b])
            for b, body in enumerate(m.bodies) if b and (body.mass or body.moment)]


def applied(m: Mechanism, carried: Carried, q: Array, v: Array | float = 0.0) -> Array:
    """Gravity, springs, dampers and constant loads on the joints (n, joints) [N m, or N]."""
    rest, stiffness, damping, load = (
        np.array([getattr(j, key) for j in m.joints])
        for key in ("rest", "stiffness", "damping", "load"))
    force = load - stiffness * (q - rest) - damping * v
    for b, centre, _ in carried:
        force = force + m.bodies[b].mass * (centre.conj() * m.gravity).real
    return np.asarray(force)


def mass(m: Mechanism, carried: Carried) -> Array:
    """Mass matrix of the joints, loops open (n, joints, joints)."""
    total = np.diag([j.armature for j in m.joints])[None]
    for b, centre, turn in carried:
        body = m.bodies[b]
        total = total + body.mass * (centre.conj()[:, :, None] * centre[:, None, :]).real
        total = total + body.moment * np.outer(turn, turn)
    return np.asarray(total)


def inertial(m: Mechanism, carried: Carried, motion: Motion, a: Array) -> Array:
    """What accelerates the bodies of a motion, as forces on the joints (n, joints)."""
    force = np.array([j.armature for j in m.joints]) * a
    for b, centre, turn in carried:
        body = m.bodies[b]
        pull = motion.point(b, body.centre, 2)[:, None]
        force = force + body.mass * (centre.conj() * pull).real
        force = force + body.moment * motion.turn[2][b][:, None] * turn
    return np.asarray(force)


def holding(m: Mechanism, q: Array, d: Drives) -> Array:
    """Moments (or forces) that hold the drives at rest in closed poses (n, drives).

    Virtual work: for each drive, what the applied forces do along the motion that it allows.
    """
    motion = move(m, q)
    force = applied(m, carriers(m, motion), q)
    force[:, d.driven] -= [m.joints[j].load for j in d.driven]  # its own motor is the drive
    matrix = loop_jacobian(m, motion, q)
    tangent = -np.linalg.solve(matrix[..., d.following], matrix[..., d.driven])
    return np.asarray(-force[:, d.driven]
                      - np.einsum("nfd,nf->nd", tangent, force[:, d.following]))


def potential(m: Mechanism, motion: Motion, q: Array) -> Array:
    """Energy of gravity and joint springs [J] (n,)."""
    energy = sum(0.5 * j.stiffness * (q[:, k] - j.rest) ** 2 for k, j in enumerate(m.joints))
    for b, body in enumerate(m.bodies):
        energy = energy - body.mass * (motion.point(b, body.centre).conj() * m.gravity).real
    return np.asarray(energy)


def kinetic(m: Mechanism, motion: Motion, v: Array) -> Array:
    """Energy of motion [J] (n,)."""
    energy = sum(0.5 * j.armature * v[:, k] ** 2 for k, j in enumerate(m.joints))
    for b, body in enumerate(m.bodies):
        energy = energy + 0.5 * (body.mass * np.abs(motion.point(b, body.centre, 1)) ** 2
                                 + body.moment * motion.turn[1][b] ** 2)
    return np.asarray(energy)
