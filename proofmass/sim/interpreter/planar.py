"""What scripts of engines of the plane have in common: vectors, senses of joints, lost inertias."""

from __future__ import annotations

import numpy as np

from .checks import Refused
from .mechanism import NeutralGear, NeutralMechanism, PlainArray


class PlanarBodies:
    """A planar mechanism in an engine of the plane, which has `scale` units of length in a metre.

    Parameters
    ----------
    mechanism : NeutralMechanism
    scale : float
        Units of length of the engine in a metre [1/m].
    """

    def __init__(self, mechanism: NeutralMechanism, scale: float = 1.0) -> None:
        self.mechanism, self.scale = mechanism, scale

    def flat(self, vector: PlainArray) -> tuple[float, float]:
        """Components of a vector in the plane, in units of the engine."""
        x, y = self.scale * self.mechanism.flat(vector)
        return float(x), float(y)

    def local(self, k: int, at: PlainArray) -> tuple[float, float]:
        """A point of a link, given in the start pose, in the coordinates of its body."""
        return self.flat(at - self.mechanism.links[k].centre)

    def sense(self, j: int) -> float:
        """1 if a joint has the sense of the coordinate of the engine, otherwise -1."""
        return self.mechanism.turn_of(j) if self.mechanism.joints[j].kind == "hinge" else 1.0

    def unit(self, j: int) -> float:
        """The coordinate of the engine for 1 rad or 1 m of a joint."""
        return self.sense(j) if self.mechanism.joints[j].kind == "hinge" else self.scale


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


def refuse_lost_inertia(
    mechanism: NeutralMechanism, link: int, least: float, moment: float
) -> None:
    """Refuse a link whose inertia is lost beside its mass at a joint, in single precision.

    A joint adds 1 / mass and arm^2 / inertia, and the first is lost if it is too small.

    Parameters
    ----------
    mechanism : NeutralMechanism
    link : int
    least : float
        Least inertia in masses times squared arms [1].
    moment : float
        The inertia [kg m^2].

    Raises
    ------
    Refused
    """
    one = mechanism.links[link]
    ends = [joint.anchor for joint in mechanism.joints if link in (joint.parent, joint.child)]
    ends += [loop.on_a for loop in mechanism.loops if loop.a == link]
    ends += [loop.on_b for loop in mechanism.loops if loop.b == link]
    large = one.mass * max(float(((end - one.centre) ** 2).sum()) for end in ends)
    if moment < least * large:
        raise Refused(
            f"link {one.name!r} with an inertia of {moment:.3g} kg m2, that single precision does "
            f"not carry beside the {large:.3g} kg m2 of its mass at a joint"
        )


SINGLE_ROUNDING = float(np.finfo(np.float32).eps)
"""Rounding of single precision [1]."""
