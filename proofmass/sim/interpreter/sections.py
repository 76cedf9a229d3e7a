"""Sections of shapes with the plane of motion: circles, segments with a radius, polygons.

    circle      a sphere, or a capsule or cylinder at right angles to the plane
    segment     a capsule in the plane, or deep below the surface of a half space
    polygon     a box with two axes in the plane

A shape that has another section is refused by name, and so are two that may touch beside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .checks import Refused
from .mechanism import NeutralMechanism, NeutralShape, PlainArray

HALF_PLANE_LENGTH, HALF_PLANE_DEPTH = 1000.0, 10.0
"""Half length and depth below the surface of the segment that stands for a half space [sizes]."""
PARALLEL_SINE = 1e-9
"""Largest sine [1] of an angle at which two directions still count as parallel."""
CORNER_SIGNS = ((1, 1), (-1, 1), (-1, -1), (1, -1))
"""Signs of the half axes at the corners of a rectangle, counter-clockwise."""


@dataclass(frozen=True)
class PlaneSection:
    """The section of a shape, and its extension along the normal of the plane.

    Attributes
    ----------
    name : str
    link : int
    points : ndarray (k, 2)
        Centre of a circle, ends of a segment or corners of a polygon in the plane, in the start
        pose [m].
    radius : float
        Radius around the points [m]; 0 for a polygon.
    height : float
        Position of the middle of the shape along the normal [m].
    flat, whole : float
        Half the length along the normal over which its sections are equal, and of the shape [m].
    """

    name: str
    link: int
    points: PlainArray
    radius: float
    height: float
    flat: float
    whole: float

    def surface(self, reach: float) -> PlainArray:
        """Corners (4, 2) of a box of a half length [m] that stands for a half plane.

        Raises
        ------
        Refused
            The section is that of a capsule.
        """
        if np.isfinite(self.whole):
            raise Refused(f"contact of {self.name}, a segment with round ends in the plane")
        along = self.points[1] - self.points[0]
        along = along / np.linalg.norm(along)
        up, middle = np.array([-along[1], along[0]]), self.points.mean(axis=0)
        return np.array(
            [middle + a * reach * along + b * self.radius * up for a, b in CORNER_SIGNS]
        )


def section_of(shape: NeutralShape, plane: PlainArray, size: float) -> PlaneSection:
    """The section of a shape with a plane (3, 3), in a mechanism of a size [m].

    Raises
    ------
    Refused
        The shape is oblique to the plane.
    """
    flat, normal, half = plane[:2], plane[2], shape.size
    middle, height = flat @ shape.place, float(shape.place @ normal)
    across = np.abs(shape.axes.T @ normal)  # components of its unit axes along the normal
    upright = across[2] > 1.0 - PARALLEL_SINE
    lying = across[2] < PARALLEL_SINE

    def made(points: PlainArray, radius: float, equal: float, whole: float) -> PlaneSection:
        return PlaneSection(shape.name, shape.link, points, radius, height, equal, whole)

    if shape.kind == "plane" and lying:
        up = flat @ shape.axes[:, 2]
        along = HALF_PLANE_LENGTH * size * np.array([up[1], -up[0]])
        foot = middle - HALF_PLANE_DEPTH * size * up
        return made(np.stack([foot - along, foot + along]), HALF_PLANE_DEPTH * size, np.inf, np.inf)
    if shape.kind == "sphere":
        return made(middle[None], float(half[0]), 0.0, float(half[0]))
    if shape.kind == "capsule" and lying:
        way = half[1] * (flat @ shape.axes[:, 2])
        return made(np.stack([middle - way, middle + way]), float(half[0]), 0.0, float(half[0]))
    if shape.kind in ("capsule", "cylinder") and upright:
        whole = float(half[1] + (half[0] if shape.kind == "capsule" else 0.0))
        return made(middle[None], float(half[0]), float(half[1]), whole)
    if shape.kind == "box" and across.max() > 1.0 - PARALLEL_SINE:
        k = int(across.argmax())
        one, two = (half[j] * (flat @ shape.axes[:, j]) for j in range(3) if j != k)
        corners = np.stack([middle + a * one + b * two for a, b in CORNER_SIGNS])
        return made(corners, 0.0, float(half[k]), float(half[k]))
    where = "is neither along the plane of motion nor at right angles to it"
    if shape.kind == "cylinder":
        where = "is not at right angles to the plane of motion"
    raise Refused(f"contact of {shape.name}, which {where}")


def meet_in_plane(one: PlaneSection, two: PlaneSection, size: float) -> bool:
    """Whether two shapes may touch in the plane of motion; False if they pass above each other.

    Raises
    ------
    Refused
        They may touch, but not at their largest sections: round shapes whose middles are at
        different heights over the plane.
    """
    apart = abs(one.height - two.height) if np.isfinite(one.whole + two.whole) else 0.0
    if apart >= one.whole + two.whole:
        return False
    # The ranges of equal sections overlap, or the middle of a round shape lies within such a range.
    if apart <= one.flat + two.flat + PARALLEL_SINE * size:
        return True
    raise Refused(
        f"contact of {one.name} and {two.name}, whose middles are {apart:.3g} m apart across the "
        f"plane of motion"
    )


def planar_contacts(mechanism: NeutralMechanism) -> tuple:
    """Sections of all shapes of a planar mechanism that touch, and the laws of their pairs.

    Returns
    -------
    sections : dict of int to PlaneSection
        By the number of the shape, with points relative to the centres of the links.
    laws : dict of (int, int) to NeutralContact
        By the numbers of two shapes, in both orders.
    """
    needed = sorted({k for pair in mechanism.contacts for k in (pair.one, pair.two)})
    found = {k: section_of(mechanism.shapes[k], mechanism.plane, mechanism.size) for k in needed}
    laws = {
        (one, two): pair
        for (one, two), pair in mechanism.laws.items()
        if meet_in_plane(found[pair.one], found[pair.two], mechanism.size)
    }
    local = {}
    for k in sorted({k for pair in laws for k in pair}):
        centre = mechanism.flat(mechanism.links[found[k].link].centre)
        local[k] = replace(found[k], points=found[k].points - centre)
    return local, laws
