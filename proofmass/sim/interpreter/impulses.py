"""What scripts of engines with impulses and semi-implicit steps need: forces, starts, readings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from .checks import Refused
from .geometry import LinkMotion
from .joint_rates import follow_joints
from .mechanism import LinkStates, NeutralJoint, NeutralMechanism, PlainArray


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


def inertia_with_armature(mechanism: NeutralMechanism, link: int) -> PlainArray:
    """Inertia (3, 3) of a link with the armatures of its hinges on the ground [kg m^2].

    Raises
    ------
    Refused
        Another joint of the link has an armature.
    """
    inertia = mechanism.links[link].inertia
    for joint in (mechanism.joints[j] for j in mechanism.joints_of(link)):
        if joint.armature and (joint.parent or joint.kind != "hinge"):
            raise Refused(f"armature of joint {joint.name!r}, no hinge on the ground")
        inertia = inertia + joint.armature * np.outer(joint.axis, joint.axis)
    return inertia


def armatures_with_rotors(mechanism: NeutralMechanism, share: float) -> list:
    """Armatures of all joints; those of drives are rotors that no other link moves [kg m^2 or kg].

    Their inertia is the mass of the mechanism times its squared size, times a `share` above 1.
    """
    mass = share * sum(link.mass for link in mechanism.links)
    heavy = {"hinge": mass * mechanism.size**2, "slide": mass}
    return [
        heavy[one.kind] if mechanism.drive_of(j) else one.armature
        for j, one in enumerate(mechanism.joints)
    ]


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


def joint_motion(
    mechanism: NeutralMechanism, joint: int, read: Callable[[int], LinkMotion], near: float = 0.0
) -> tuple[float, float]:
    """Coordinate, 0 at the start, and rate of a hinge or slide from the motions of its links.

    The coordinate of a hinge is, of those that differ by full turns, the one next to `near` [rad].
    """
    one, ground = mechanism.joints[joint], (np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))
    if one.kind == "slide":
        return slide_motion(mechanism, joint, read)
    base, moving = (read(k) if k else ground for k in (one.parent, one.child))
    turn = base[1].T @ moving[1]
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    angle = float(np.arctan2(one.axis @ skew, np.trace(turn) - 1.0))
    rate = float((moving[3] - base[3]) @ base[1] @ one.axis)
    return angle + 2.0 * np.pi * round((near - angle) / (2.0 * np.pi)), rate


def joint_reader(
    mechanism: NeutralMechanism, read: Callable[[int], LinkMotion]
) -> Callable[[int], tuple]:
    """The function `joint_motion` of each joint, whose hinges go on from where they were read."""
    values = dict.fromkeys(range(len(mechanism.joints)), 0.0)

    def joint(j: int) -> tuple[float, float]:
        motion = joint_motion(mechanism, j, read, values[j])
        values[j] = motion[0]
        return motion

    return joint


def slide_motion(
    mechanism: NeutralMechanism, joint: int, read: Callable[[int], LinkMotion]
) -> tuple[float, float]:
    """Coordinate, 0 at the start, and rate of a slide from the motions of its links."""
    one = mechanism.joints[joint]
    base, moving = (read(k) if k else None for k in (one.parent, one.child))
    near = point_motion(mechanism, base, one.parent, one.anchor)
    far = point_motion(mechanism, moving, one.child, one.anchor)
    gap, rate, axis = far[0] - near[0], far[1] - near[1], one.axis
    if base:
        axis = base[1] @ axis
        return float(gap @ axis), float(rate @ axis + gap @ np.cross(base[3], axis))
    return float(gap @ axis), float(rate @ axis)


def point_motion(
    mechanism: NeutralMechanism, motion: LinkMotion | None, link: int, at: PlainArray
) -> tuple:
    """Place and velocity of a point of a link, whose place in the start pose is `at`."""
    if motion is None:  # the ground
        return at, np.zeros(3)
    place, turn, velocity, omega = motion[:4]
    arm = turn @ (at - mechanism.links[link].centre)
    return place + arm, velocity + np.cross(omega, arm)


def start_openings(mechanism: NeutralMechanism, share: float) -> PlainArray:
    """Small motions in the joints that open loops at the start as they are open in motion.

    The velocity v behind a step closes a loop to first order at the pose before the step, together
    with a share of its opening C:

        J v = - share C / h,         C after the step = C + h J v + h^2 (v C'' v) / 2

    In even motion the opening is therefore ``h^2 (v C'' v) / (2 share)``.  A run with closed loops
    at the start needs some steps until they have it, and its first accelerations lack the term that
    it stands for.  With the rates of half a step before the start the loops open at a rate of
    ``h (v C'' v) / 2``.  With those of the start, in the plain reading, the motions are 0.

    Parameters
    ----------
    mechanism : NeutralMechanism
    share : float
        Share of an opening that a step closes [1].

    Returns
    -------
    ndarray (joints, 2, 3)
        Rotation and translation of the child against the parent [rad, m], of free links about their
        centres; 0 for drives.
    """
    motions = np.zeros((len(mechanism.joints), 2, 3))
    free = [j for j in range(len(motions)) if not mechanism.drive_of(j)]
    if not (free and mechanism.loops and mechanism.rates_at < 0):
        return motions

    def speed(link: int, at: PlainArray) -> PlainArray:
        one = mechanism.links[link]
        velocity = start_velocity(mechanism, link)
        return np.asarray(velocity + np.cross(one.omega, at - one.centre))

    rates = [speed(one.b, one.on_b) - speed(one.a, one.on_a) for one in mechanism.loops]
    units = [(j, unit) for j in free for unit in unit_motions(mechanism.joints[j])]
    columns = np.column_stack([opened_by(mechanism, j, unit) for j, unit in units])
    wanted = mechanism.step / share * np.concatenate(rates)
    sizes = np.linalg.lstsq(columns, wanted, rcond=1e-9)[0]
    for (j, unit), size in zip(units, sizes):
        motions[j] += size * unit
    return motions


def start_velocity(mechanism: NeutralMechanism, link: int) -> PlainArray:
    """Velocity (3,) of the centre of a link at the start.

    That of a free link whose joint is not at its centre has the acceleration toward the joint too,
    if it is that of half a step before: a free body goes straight on.
    """
    one, own = mechanism.links[link], mechanism.joints_of(link)
    if own and mechanism.joints[own[0]].kind == "free":
        arm = one.centre - mechanism.joints[own[0]].anchor
        drawn = np.cross(one.omega, np.cross(one.omega, arm))
        return np.asarray(one.velocity + mechanism.rates_at * drawn)
    return one.velocity


def unit_motions(joint: NeutralJoint) -> list:
    """The motions (2, 3) that a joint allows, rotation and translation."""
    none = np.zeros(3)
    if joint.kind == "hinge":
        return [np.array([joint.axis, none])]
    if joint.kind == "slide":
        return [np.array([none, joint.axis])]
    turns = [np.array([axis, none]) for axis in np.eye(3)]
    return turns + [one[::-1] for one in turns if joint.kind == "free"]


def pivot_of(mechanism: NeutralMechanism, joint: int) -> PlainArray:
    """The point about which a joint turns its child in the start pose: of free links the centre."""
    one = mechanism.joints[joint]
    return mechanism.links[one.child].centre if one.kind == "free" else one.anchor


def opened_by(mechanism: NeutralMechanism, joint: int, motion: PlainArray) -> PlainArray:
    """Openings of all loops (3 loops,) by a motion (2, 3) in a joint in the start pose."""
    one, anchor = mechanism.joints[joint], pivot_of(mechanism, joint)
    moved = {one.child}
    for other in mechanism.joints:
        if other.parent in moved:
            moved.add(other.child)

    def shift(link: int, at: PlainArray) -> PlainArray:
        turn, way = motion if link in moved else np.zeros((2, 3))
        return np.asarray(way + np.cross(turn, at - anchor))

    pairs = [shift(loop.b, loop.on_b) - shift(loop.a, loop.on_a) for loop in mechanism.loops]
    return np.concatenate(pairs)


def start_of_links(mechanism: NeutralMechanism) -> tuple:
    """Places, small rotations and velocities (links, 3) at the start, in coordinates of links.

    They are for an engine whose joints are constraints as loops are, and which closes an opening in
    one step.  In the half-step reading joints are open too as they are in even motion: by
    ``-h^2 a / 2`` for the acceleration ``a`` that a centre has at constant rates of the joints; and
    velocities of half a step before lack ``h a / 2``.
    """
    places = np.array([one.centre for one in mechanism.links])
    turns = np.zeros_like(places)
    velocities = np.array([one.velocity for one in mechanism.links])
    if mechanism.rates_at < 0:
        shifts, turns = move_links(mechanism, start_openings(mechanism, 1.0))
        drawn = accelerations_at_constant_rates(mechanism)
        places = places + shifts - 0.5 * mechanism.step**2 * drawn
        velocities = velocities - 0.5 * mechanism.step * drawn
    return places, turns, velocities


def move_links(mechanism: NeutralMechanism, motions: PlainArray) -> tuple:
    """Shifts of centres and rotations (links, 3) by small motions (joints, 2, 3) in joints."""
    shifts, turns = (np.zeros((len(mechanism.links), 3)) for _ in range(2))
    for j, (one, (turn, way)) in enumerate(zip(mechanism.joints, motions)):
        k, before = one.child, one.parent if j == mechanism.joints_of(one.child)[0] else one.child
        shifts[k] = shifts[before] + way - np.cross(turn, pivot_of(mechanism, j))  # of the origin
        turns[k] = turns[before] + turn
    centres = np.array([one.centre for one in mechanism.links])
    return shifts + np.cross(turns, centres), turns


def accelerations_at_constant_rates(mechanism: NeutralMechanism) -> PlainArray:
    """Accelerations of the centres (links, 3) at the start if no rate of a joint changed."""
    states = LinkStates.empty(replace(mechanism, samples=1))
    rows = [(one.value, one.rate, 0.0) for one in mechanism.joints]
    states.coordinates = np.array(rows).T[:, None]
    follow_joints(mechanism, states)
    return states.acceleration[0]
