"""What scripts of engines of the plane have in common: vectors, bodies, and senses of joints."""

from __future__ import annotations

from typing import Any

import numpy as np

from .checks import Refused, held_joints
from .geometry import LinkMotion, in_space
from .mechanism import NeutralGear, NeutralMechanism, PlainArray
from .readings import slide_motion


class PlanarBodies:
    """A planar mechanism in an engine of the plane, which has `scale` units of length in a metre.

    `bodies` are those of the links, which the script adds, and `held` is that of `held_joints`.

    Parameters
    ----------
    mechanism : NeutralMechanism
    scale : float
        Units of length of the engine in a metre [1/m].
    ahead : float
        Time by which what is read is ahead of the poses of the engine [s].
    """

    def __init__(self, mechanism: NeutralMechanism, scale: float = 1.0, ahead: float = 0.0) -> None:
        self.mechanism, self.scale, self.ahead = mechanism, scale, ahead
        self.bodies = list[Any]()
        self.held = held_joints(mechanism)

    def flat(self, vector: PlainArray) -> tuple[float, float]:
        """Components of a vector in the plane, in units of the engine."""
        x, y = self.scale * self.mechanism.flat(vector)
        return float(x), float(y)

    def local(self, k: int, at: PlainArray) -> tuple[float, float]:
        """A point of a link, given in the start pose, in the coordinates of its body."""
        return self.flat(at - self.mechanism.links[k].centre)

    def pair(self, one: Any) -> list[Any]:
        """The bodies that a joint or a loop joins."""
        return [self.bodies[k] for k, _ in one.points]

    def joined(self, one: Any) -> list[Any]:
        """The same bodies, and the points that are joined in their coordinates."""
        return [*self.pair(one), *(self.local(k, at) for k, at in one.points)]

    def sense(self, j: int) -> float:
        """1 if a joint has the sense of the coordinate of the engine, otherwise -1."""
        return self.mechanism.turn_of(j) if self.mechanism.joints[j].kind == "hinge" else 1.0

    def unit(self, j: int) -> float:
        """The coordinate of the engine for 1 rad or 1 m of a joint."""
        return self.sense(j) if self.mechanism.joints[j].kind == "hinge" else self.scale

    def pose(self, k: int) -> tuple[list[float], list[float]]:
        """Centre and rotation since the start (3,), and rates (3,), of a link or the ground."""
        raise NotImplementedError

    def read(self, k: int) -> LinkMotion:
        """The motion of a link, see `record`."""
        pose, rates = map(np.array, self.pose(k))
        *place, angle = pose + self.ahead * rates
        return in_space(self.mechanism, k, np.array(place), angle, rates)

    def joint(self, j: int) -> tuple[float, float]:
        """Coordinate and rate of a hinge or slide, from the poses of its links."""
        one = self.mechanism.joints[j]
        if one.kind == "slide":
            return slide_motion(self.mechanism, j, self.read)
        (base, before), (moving, rates) = (self.pose(k) for k, _ in one.points)
        turn, rate = self.sense(j), rates[2] - before[2]
        return turn * (moving[2] - base[2] + self.ahead * rate), turn * rate


def coupled_links(mechanism: NeutralMechanism, gear: NeutralGear) -> tuple[int, int, float]:
    """Two links that a gear couples, and the rate of the second in that of the first [1].

    Raises
    ------
    Refused
        The gear couples other than the rotations of two links.
    """
    joints, shares = mechanism.joints, np.zeros(len(mechanism.links))
    for j, share in ((gear.one, 1.0), (gear.two, -gear.ratio)):
        if joints[j].kind == "slide":
            raise Refused(f"gear {gear.name!r}, which couples a slide")
        shares[joints[j].child] += share * mechanism.turn_of(j)
        shares[joints[j].parent] -= share * mechanism.turn_of(j)
    pair = (np.flatnonzero(shares[1:]) + 1).tolist()
    if len(pair) != 2:
        raise Refused(f"gear {gear.name!r}, which couples other than two links")
    return pair[0], pair[1], float(-shares[pair[1]] / shares[pair[0]])
