"""Hinges and slides as a tree of links whose frames have the axis of the joint as z."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .checks import Refused
from .geometry import frame_of_axis
from .mechanism import NeutralJoint, NeutralMechanism, PlainArray


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
        if one.kind not in ("hinge", "slide"):
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
    balls = [one for one in mechanism.joints if one.kind == "ball"]
    if any(one.damping for one in mechanism.joints if one.kind in ("ball", "free")):
        raise Refused("damping of a ball or free joint")
    return [(one.a, one.on_a, one.b, one.on_b) for one in mechanism.loops] + [
        (one.parent, one.anchor, one.child, one.anchor) for one in balls
    ]


def in_time(
    step: float, *rows: PlainArray, factor: Any = 1.0, before: int = 0
) -> Callable[..., Any]:
    """A function of the time from values at half steps, or from a single value.

    Parameters
    ----------
    step : float
        Time step [s].
    rows : ndarray (1,) or (2 steps + 1,)
        Value, derivative, second derivative over 2, and so on.
    factor : number or ndarray
        Factor of the value.
    before : int
        Number of arguments of the function before the time; it ignores these and those behind it.

    Returns
    -------
    callable
        ``value(t)``, the Taylor polynomial about the half step that is next to a time.

    Examples
    --------
    >>> square = in_time(0.2, np.array([0.0, 0.01, 0.04]), np.array([0.0, 0.2, 0.4]))
    >>> round(square(0.1), 6), round(square(0.11), 6)
    (0.01, 0.012)
    """
    half, most = 0.5 * step, rows[0].size - 1

    def value(*given: Any) -> Any:
        t = given[before]
        i = min(round(t / half), most)
        return factor * sum(float(row[i]) * (t - half * i) ** n for n, row in enumerate(rows))

    return value
