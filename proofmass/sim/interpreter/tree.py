"""Hinges and slides as a tree of links whose frames have the axis of the joint as z."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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


def in_time(step: float, *rows: PlainArray, factor: Any = 1.0) -> Callable[..., Any]:
    """A function of the time from values at half steps, or from a single value.

    Parameters
    ----------
    step : float
        Time step [s].
    rows : ndarray (1,) or (2 steps + 1,)
        Value, derivative, second derivative over 2, and so on.
    factor : number or ndarray
        Factor of the value.

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

    def value(t: float) -> Any:
        i = min(round(t / half), most)
        return factor * sum(float(row[i]) * (t - half * i) ** n for n, row in enumerate(rows))

    return value
