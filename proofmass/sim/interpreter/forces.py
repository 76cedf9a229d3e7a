"""Forces on links and joints in a step, and the rates of drives."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from .geometry import LinkMotion
from .mechanism import NeutralMechanism
from .readings import point_motion


def link_forces(
    mechanism: NeutralMechanism,
    step: int,
    read: Callable[[int], LinkMotion],
    joint: Callable[[int], tuple] | None = None,
) -> Iterator[tuple]:
    """The forces of springs between points, loads and drag in a step, and those of joints.

    Parameters
    ----------
    mechanism : NeutralMechanism
    step : int
    read : callable
        ``read(k)`` is the `LinkMotion` of link number k, the ground excluded.
    joint : callable, optional
        ``joint(j)`` are the coordinate, 0 at the start, and the rate of hinge or slide number j; if
        it is given, the forces of joints without a drive are among those on links.

    Yields
    ------
    tuple
        The number of a moving link, a point of it [m], and the force and the moment on it [N, N m],
        in the world.
    """
    known: dict[int, LinkMotion] = {}

    def moves(k: int) -> LinkMotion:
        """The motion of a moving link, which is read once."""
        if k not in known:
            known[k] = read(k)
        return known[k]

    for load in mechanism.loads:
        motion, share = moves(load.link), load.share_in(step)
        axes = share * (motion[1] if load.follows else np.eye(3))
        place = point_motion(mechanism, motion, load.link, load.at)[0]
        yield load.link, place, axes @ load.force, axes @ load.moment
    for spring in mechanism.springs:
        ends = [
            point_motion(mechanism, moves(k) if k else None, k, at)
            for k, at in ((spring.a, spring.on_a), (spring.b, spring.on_b))
        ]
        gap, rate = ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]
        length = float(np.linalg.norm(gap))
        force = spring.pull(length, float(gap @ rate) / length) * gap / length
        for link, (place, _), own in zip((spring.a, spring.b), ends, (force, -force)):
            if link:
                yield link, place, own, np.zeros(3)
    if mechanism.rest:
        for k, link in enumerate(mechanism.links[1:], 1):
            place, _, velocity, omega = moves(k)[:4]
            drag = -mechanism.rest.drag * link.mass * velocity
            yield k, place, drag, -mechanism.rest.drag * link.inertia @ omega
    if joint is not None:
        for j, size in joint_forces(mechanism, step, joint):
            yield from joint_forces_on_links(mechanism, j, size, moves)


def joint_forces(
    mechanism: NeutralMechanism, step: int, joint: Callable[[int], tuple]
) -> Iterator[tuple]:
    """The forces of springs, dampers and motors in the joints without a drive in a step.

    Parameters
    ----------
    mechanism : NeutralMechanism
    step : int
    joint : callable
        As that of `link_forces`.

    Yields
    ------
    tuple
        The number of a hinge or slide, and the force or moment on its child [N or N m].
    """
    for j, one in enumerate(mechanism.joints):
        acts = one.is_sprung or one.damping or one.is_forced
        if acts and not mechanism.drive_of(j):
            value, rate = joint(j)[:2]
            yield j, one.passive_force(one.value + value, rate) + one.force_in(step)


def beside_linear(mechanism: NeutralMechanism) -> NeutralMechanism:
    """The mechanism without what is linear in its springs and dampers, which the engine has."""
    joints = tuple(
        replace(one, spring=np.append(0.0, one.spring[1:]), servo=0.0, damping=0.0)
        for one in mechanism.joints
    )
    springs = tuple(one for one in mechanism.springs if not one.free_length)
    return replace(mechanism, joints=joints, springs=springs)


def drive_rates(
    mechanism: NeutralMechanism, step: int, joint: Callable[[int], tuple]
) -> Iterator[tuple]:
    """The number of each driven joint, and the rate with which it reaches its next value in a step.

    The rate is in rad/s or m/s; the parameters are those of `joint_forces`.
    """
    for drive in mechanism.drives:
        start = mechanism.joints[drive.joint].value
        way = drive.value[2 * (step + 1)] - start - joint(drive.joint)[0]
        yield drive.joint, float(way / mechanism.step)


def joint_forces_on_links(
    mechanism: NeutralMechanism, joint: int, size: float, read: Callable[[int], LinkMotion]
) -> Iterator[tuple]:
    """The forces of a hinge or slide on its links, as `link_forces` gives them."""
    one = mechanism.joints[joint]
    place = point_motion(mechanism, read(one.child), one.child, one.anchor)[0]
    along = (read(one.parent)[1] if one.parent else np.eye(3)) @ one.axis
    force, moment = (size * along * (one.kind == kind) for kind in ("slide", "hinge"))
    yield one.child, place, force, moment
    if one.parent:
        yield one.parent, place, -force, -moment


def pushes_on_links(
    mechanism: NeutralMechanism,
    step: int,
    read: Callable[[int], LinkMotion],
    joint: Callable[[int], tuple] | None = None,
) -> Iterator[tuple]:
    """The forces of `link_forces` at centres: number of a link, force and moment [N, N m]."""
    for k, place, force, moment in link_forces(mechanism, step, read, joint):
        yield k, force, moment + np.cross(place - read(k)[0], force)
