"""Hinges and slides as a tree of links whose frames have the axis of the joint as z."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .checks import Refused, refuse_damped_balls
from .geometry import frame_of_axis
from .mechanism import NeutralJoint, NeutralMechanism, PlainArray
from .tables import in_time


@dataclass(frozen=True)
class TreeRow:
    """A joint and the link behind it, which has no mass if another joint acts on the same child.

    Attributes
    ----------
    joint : NeutralJoint
    up : int
        Number of the row before it; -1 for the ground.
    frame : ndarray (3, 3)
        Axes of the link in the world at the start, in columns; its origin is the anchor.
    turn : ndarray (3, 3)
        The same axes in those of the row before it.
    place : ndarray (3,)
        Its origin from that of the row before it, in the axes of that row [m].
    mass : float
        [kg]
    inertia : ndarray (3, 3)
        About the centre of mass, in the axes of the link [kg m^2].
    centre : ndarray (3,)
        Centre of mass in the frame of the link [m].
    """

    joint: NeutralJoint
    up: int
    frame: PlainArray
    turn: PlainArray
    place: PlainArray
    mass: float
    inertia: PlainArray
    centre: PlainArray


def tree_rows(mechanism: NeutralMechanism) -> list[TreeRow]:
    """The hinges and slides of a mechanism as a tree.

    Raises
    ------
    Refused
        A hinge or slide is on a link that has a ball or a free joint.
    """
    rows, behind = list[TreeRow](), dict[int, int]()
    for j, one in enumerate(mechanism.joints):
        if not one.is_single:
            continue
        up = behind.get(one.child, behind.get(one.parent, -1))
        if up < 0 and one.parent:
            raise Refused(f"joint {one.name!r} on a link with a ball or free joint")
        turn, base = (rows[up].frame.T, rows[up].joint.anchor) if up >= 0 else (np.eye(3), 0.0)
        frame, link = frame_of_axis(one.axis), mechanism.links[one.child]
        share = float(mechanism.joints_of(one.child)[-1] == j)
        place, centre = turn @ (one.anchor - base), frame.T @ (link.centre - one.anchor)
        inertia = share * frame.T @ link.inertia @ frame
        behind[one.child] = len(rows)
        rows.append(
            TreeRow(one, up, frame, turn @ frame, place, share * link.mass, inertia, centre)
        )
    return rows


def tree_forces(step: float, rows: list[TreeRow]) -> Callable[..., PlainArray] | None:
    """The forces in the joints of a tree that are not those of linear springs and dampers.

    Parameters
    ----------
    step : float
        Time step [s].
    rows : list of TreeRow

    Returns
    -------
    callable, optional
        ``forces(t, q)`` of motors and of the higher powers of springs, at the time t [s] and the
        coordinates q since the start; None if there are no such forces.
    """
    joints = [row.joint for row in rows]
    if not any(one.is_forced or one.spring[1:].any() for one in joints):
        return None
    motors = [in_time(step, one.force) for one in joints]

    def forces(t: float, q: PlainArray) -> PlainArray:
        powers = [one.force_of_powers(one.value + x) for one, x in zip(joints, q)]
        return np.array([motor(t) for motor in motors]) + powers

    return forces


def one_joint_each(mechanism: NeutralMechanism) -> NeutralMechanism:
    """The mechanism with a link without mass between any two joints of a link.

    Each link then has one joint.  The new links come last, so that all others and all joints keep
    their numbers; they have the centre of the link.
    """
    links, joints = list(mechanism.links), list(mechanism.joints)
    for k, link in enumerate(mechanism.links):
        own = mechanism.joints_of(k)
        for before, behind in zip(own, own[1:]):
            joints[before] = replace(joints[before], child=len(links))
            joints[behind] = replace(joints[behind], parent=len(links))
            links.append(replace(link, mass=0.0, inertia=0.0 * link.inertia))
    return replace(mechanism, links=tuple(links), joints=tuple(joints))


def joined_points(mechanism: NeutralMechanism) -> list:
    """What loops and balls join: a link and its point at the start, twice.

    Raises
    ------
    Refused
        A ball or a free joint is damped.
    """
    refuse_damped_balls(mechanism)
    balls = [one for one in mechanism.joints if one.kind == "ball"]
    return [one.points for one in (*mechanism.loops, *balls)]
