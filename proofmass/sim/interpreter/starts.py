"""The start of a run, in which loops are as open as in even motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .joint_rates import follow_joints
from .mechanism import LinkStates, NeutralJoint, NeutralMechanism, PlainArray


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


def start_of_links(mechanism: NeutralMechanism) -> list[tuple]:
    """Place, small rotation and velocity (3,) of each link at the start, in coordinates of links.

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
    return list(zip(places, turns, velocities))


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
