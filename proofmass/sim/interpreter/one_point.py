"""Contacts of an engine in which two shapes touch in one point, and in which nothing bounces.

On a half space a box touches with its corners and a capsule with its ends: balls there stand for
them.  Two other shapes touch in one point if both are balls; what else may touch is refused by
name, and so is an impact after which shapes should part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from .checks import Refused
from .geometry import LinkMotion
from .mechanism import NeutralContact, NeutralMechanism, PlainArray

CORNER_SHARE = 1e-3
"""Radius of a ball in the corner of a box, in its least half side."""
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
"""Signs of the half sides of a box at its corners."""
LOST_STEPS = 10.0
"""Steps in which gravity gives the speed of a bounce that may be lost: an error of the step."""


def balls_of(mechanism: NeutralMechanism, shape: int) -> list[tuple[PlainArray, float]]:
    """Places of balls in the axes of a shape, and their radii [m]; a half space has none.

    Raises
    ------
    Refused
        The shape is no ball and touches others than half spaces, or is a cylinder.
    """
    one = mechanism.shapes[shape]
    pairs = [pair for pair in mechanism.contacts if shape in (pair.one, pair.two)]
    others = {mechanism.shapes[pair.one + pair.two - shape].kind for pair in pairs}
    if one.kind == "cylinder" or (one.kind in ("box", "capsule") and others != {"plane"}):
        raise Refused(f"contact of {one.name}, which touches in one point only")
    if one.kind == "plane":
        return []
    if one.kind == "box":
        radius = CORNER_SHARE * float(one.size.min())
        return [(corner * (one.size - radius), radius) for corner in CORNERS]
    ends = (-1.0, 1.0) if one.kind == "capsule" else (0.0,)
    return [(np.array([0.0, 0.0, end * one.size[1]]), float(one.size[0])) for end in ends]


def contact_parts(mechanism: NeutralMechanism) -> Iterator[tuple]:
    """Balls and half spaces that stand for the shapes of a mechanism.

    Yields
    ------
    tuple
        The number of the shape, the place of the part in the start pose (3,) [m], and its radius
        [m]; 0 for a half space, whose outer side is that of the third axis of the shape.
    """
    for k, one in enumerate(mechanism.shapes):
        for at, radius in balls_of(mechanism, k) or [(np.zeros(3), 0.0)]:
            yield k, one.place + one.axes @ at, radius


class Impacts:
    """The impacts of a run, of which those are refused that should bounce.

    Parameters
    ----------
    mechanism : NeutralMechanism
    shapes : dict
        The number of the shape of each part.
    """

    def __init__(self, mechanism: NeutralMechanism, shapes: dict) -> None:
        self.mechanism, self.shapes, self.touching = mechanism, shapes, set[tuple]()

    def refuse_bounces(self, read: Callable[[int], LinkMotion], touches: Iterable[tuple]) -> None:
        """Refuse an impact since the last call after which shapes should part.

        Parameters
        ----------
        read : callable
            ``read(k)`` is the motion of link number k, the ground excluded.
        touches : iterable of tuple
            Of two parts that touch their keys, the point (3,) of each [m], and the normal (3,) from
            the second to the first.
        """
        now = set()
        for parts, points, normal in touches:
            now.add(parts)
            if parts not in self.touching:
                ends = tuple(self.shapes[one] for one in parts)
                if ends[0] > ends[1]:
                    ends, points, normal = ends[::-1], points[::-1], -normal
                refuse_bounce(self.mechanism, read, self.mechanism.laws[ends], points, normal)
        self.touching = now


def refuse_bounce(
    mechanism: NeutralMechanism,
    read: Callable[[int], LinkMotion],
    pair: NeutralContact,
    points: tuple[PlainArray, PlainArray],
    normal: PlainArray,
) -> None:
    """Refuse an impact of two shapes after which they should part.

    Parameters
    ----------
    mechanism : NeutralMechanism
    read : callable
        ``read(k)`` is the motion of link number k, the ground excluded.
    pair : NeutralContact
    points : tuple of ndarray (3,)
        The point in which each touches the other [m].
    normal : ndarray (3,)
        From the second to the first [1].

    Raises
    ------
    Refused
        The bounce is faster than gravity makes it in `LOST_STEPS`.
    """
    shapes, speeds = [mechanism.shapes[k] for k in (pair.one, pair.two)], []
    for one, at in zip(shapes, points):
        place, _, velocity, omega = read(one.link)[:4] if one.link else np.zeros((4, 3))
        speeds.append(velocity + np.cross(omega, at - place))
    hit = float((speeds[1] - speeds[0]) @ normal)
    lost = LOST_STEPS * float(np.linalg.norm(mechanism.gravity)) * mechanism.step
    if pair.restitution * hit > lost:
        raise Refused(
            f"an impact of {shapes[0].name} and {shapes[1].name} with {hit:.2g} m/s, whose "
            f"restitution of {pair.restitution:.3g} the engine has not"
        )
