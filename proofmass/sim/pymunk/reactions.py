"""Forces of loops and drives, and forces between bodies, from the change of velocities in a step.

Chipmunk gives the size of an impulse but not its direction.  The velocities change in a step by
loads and impulses only, so the forces f follow from the engine's own accelerations a,

    M a = loads(pose, v) + J(pose)^T f,        a = (v_after - v_before) / dt,

where J is the Jacobian of constraints, drives and joints that are beyond a stop.  At rest a is
zero.
"""

from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
from numpy.typing import NDArray

from proofmass.base.arrays import Array
from proofmass.sim.contents import active_connects, anchor_bodies
from proofmass.sim.pymunk.kinematics import (
    constraint_values,
    damping,
    derivative_along,
    force_of,
    potential,
    rotate,
    spring_length,
    spring_line,
    values_of,
)
from proofmass.sim.pymunk.links import Links

JACOBIAN_BLOCK_SIZE = 256
"""Number of samples whose Jacobians are computed at once."""
DEPENDENCE_TOLERANCE = 1e-12
"""Singular values of the Jacobian below this share of the largest one count as zero, since their
constraints depend on others."""


@dataclass(frozen=True)
class SampledMotion:
    """Poses (n, links + 1, 3) [m, m, rad] at samples, with their rates and accelerations.

    ``rub`` (n, joints) is the dry friction of the joints, positive against a positive motion [N m
    or N].
    """

    pose: Array
    velocity: Array
    acceleration: Array
    rub: Array | float = 0.0

    @classmethod
    def at_rest(cls, pose: Array, rub: Array | float = 0.0) -> "SampledMotion":
        """Poses with zero rates and accelerations."""
        return cls(pose, np.zeros_like(pose), np.zeros_like(pose), rub)

    def at(self, k: int) -> "SampledMotion":
        """The motion at sample k only."""
        rub = self.rub[[k]] if isinstance(self.rub, np.ndarray) else self.rub
        return SampledMotion(self.pose[[k]], self.velocity[[k]], self.acceleration[[k]], rub)


def solve_forces(links: Links, motion: SampledMotion) -> Array:
    """Forces (n, rows + drives + limited joints) of constraints, gears, drives and stops.

    A constraint applies its force to its second link, and the opposite force to its first link.
    """
    n = len(motion.pose)
    blocks = [
        _solve_block(links, motion, slice(k, k + JACOBIAN_BLOCK_SIZE))
        for k in range(0, n, JACOBIAN_BLOCK_SIZE)
    ]
    return np.concatenate(blocks)


def _solve_block(links: Links, motion: SampledMotion, block: slice) -> Array:
    """The forces of `solve_forces` at the samples of a block."""
    pose, velocity = motion.pose[block, None], motion.velocity[block]
    size = 3 * len(links.mass)
    units = np.zeros((size, *pose.shape[2:]))
    units.reshape(size, -1)[:, :size] = np.eye(size)
    limited = tuple(joint for joint in links.joints if joint.limits)
    place = values_of(limited, pose[:, 0])
    low, high = np.array([joint.limits for joint in limited]).reshape(-1, 2).T
    held = ((place < low) | (place > high))[:, None]  # other joints get rows of zeros: no force
    stops = held * derivative_along(lambda p: values_of(limited, p), pose, units)
    rows = np.concatenate(
        [derivative_along(lambda p: constraint_values(links, p), pose, units), stops], axis=-1
    )  # J^T
    slides = [joint.constraint.axis is not None for joint in limited]
    bounds = np.append(links.bounds, np.where(slides, links.extent, 1.0))
    coefficients, damped = damping(links)
    slopes = derivative_along(damped, pose, units)
    rates = derivative_along(damped, pose[:, 0], velocity)
    inertial = (links.inertia * motion.acceleration[block])[:, :-1].reshape(-1, size)
    load = derivative_along(lambda p: potential(links, p), pose, units)
    rub = np.broadcast_to(motion.rub, (len(motion.pose), len(links.joints)))
    dissipated = coefficients * rates
    dissipated[:, : len(links.joints)] += rub[block]
    needed = inertial + load + (slopes @ dissipated[..., None])[..., 0]
    inverse = np.linalg.pinv(rows * links.sizes[:, None] / bounds, rcond=DEPENDENCE_TOLERANCE)
    return np.asarray((inverse @ (needed * links.sizes)[..., None])[..., 0] / bounds)


@dataclass(frozen=True)
class Interaction:
    """A sensor of the force or moment between a body and its parent in the MJCF.

    Attributes
    ----------
    body : int
        Id of the body.
    link : int
        Number of the link that the body belongs to.
    at : ndarray (2,)
        The sensor's position relative to the link's centre in the start pose [m].
    axis : ndarray (2,)
        Components in the plane of the sensor's axis in the start pose [1], for a force.
    across : float
        Component of that axis along the plane's normal [1], for a moment.
    moment : bool
        Whether the sensor shows a moment; otherwise it shows a force.
    """

    body: int
    link: int
    at: Array
    axis: Array
    across: float
    moment: bool


def transmitted_force(
    links: Links, sensor: Interaction, motion: SampledMotion, forces: Array
) -> Array:
    """Values (n,) [N or N m] of a sensor of the force or moment between two bodies.

    They follow from the Newton-Euler equations of the body together with all its descendants in the
    MJCF.  `forces` are those of `solve_forces`.
    """
    model, data, plane = links.model, links.data, links.plane
    carried = bodies_carried_by(model, sensor.body)
    place = motion.pose[:, sensor.link, :2] + rotate(motion.pose[:, sensor.link, 2], sensor.at)
    force, moment = np.zeros_like(place), np.zeros(len(place))

    def add(link: int, at: Array, pull: Array) -> None:
        nonlocal force, moment
        body = motion.pose[:, link]
        arm = body[:, :2] + rotate(body[:, 2], at) - place
        force = force + pull
        moment = moment + arm[:, 0] * pull[:, 1] - arm[:, 1] * pull[:, 0]

    for b in carried:
        link = int(links.of_body[b])
        at = plane.flat(data.xipos[b]) - links.centre[link]
        spin, bend = motion.velocity[:, link, 2:], motion.acceleration[:, link, 2:]
        arm = rotate(motion.pose[:, link, 2], at)
        quarter = np.stack([-arm[:, 1], arm[:, 0]], axis=-1)
        acceleration = motion.acceleration[:, link, :2] + bend * quarter - spin**2 * arm
        add(link, at, model.body_mass[b] * (acceleration - links.gravity))
        frame = data.ximat[b].reshape(3, 3)
        moment = moment + (plane.normal @ frame) ** 2 @ model.body_inertia[b] * bend[:, 0]
    first = links.joint_rows
    for k, (e, loop) in enumerate(zip(active_connects(model), links.loops, strict=True)):
        pull = forces[:, first + 2 * k : first + 2 * k + 2]
        one, two = anchor_bodies(model, e)
        if one in carried:
            add(loop.a, loop.on_a, pull)
        if two in carried:
            add(loop.b, loop.on_b, -pull)
    for spring in links.springs:
        way, length = spring_line(spring, motion.pose)
        rate = derivative_along(partial(spring_length, spring), motion.pose, motion.velocity)
        pull = (spring.push(length) - spring.damping * rate)[:, None] * way
        if spring.body_a in carried:
            add(spring.a, spring.on_a, pull)
        if spring.body_b in carried:
            add(spring.b, spring.on_b, -pull)
    for load in links.pulls:
        if load.body in carried:
            add(load.link, load.at, np.broadcast_to(-force_of(load, motion.pose), place.shape))
            moment = moment - load.moment
    if sensor.moment:
        return moment * sensor.across
    return np.asarray((force * rotate(motion.pose[:, sensor.link, 2], sensor.axis)).sum(axis=-1))


def bodies_carried_by(model: mujoco.MjModel, body: int) -> NDArray[np.intp]:
    """Ids of a body and of all its descendants in the tree of the MJCF."""
    found = np.zeros(model.nbody, bool)
    found[body] = True
    for b in range(body + 1, model.nbody):
        found[b] = found[model.body_parentid[b]]
    return np.flatnonzero(found)
