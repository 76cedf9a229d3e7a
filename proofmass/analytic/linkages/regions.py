"""Plane regions bounded by pieces of curves: pieces are joined to outlines, outlines to regions.

A piece has its region on the left.  Areas follow from Green's theorem: each piece has one number,
its integral, so that an area is as exact as these and does not depend on how densely the outline
is sampled.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.chart import ChartRegion
from proofmass.base.arrays import Complex

JOIN_DISTANCE = 1e-6
"""Ends of pieces at a smaller distance, as a share of the mechanism's size, are one point."""


@dataclass(frozen=True)
class CurvePiece:
    """A piece of a curve with its contribution to the area that it bounds.

    Attributes
    ----------
    points : ndarray (n,)
        Points x + iy along the piece [m], dense enough to be drawn.
    area_integral : float
        Integral of (x dy - y dx)/2 along the piece [m^2].
    """

    points: Complex
    area_integral: float

    @property
    def back(self) -> "CurvePiece":
        """The same piece in the opposite direction."""
        return CurvePiece(self.points[::-1], -self.area_integral)


@dataclass(frozen=True)
class PlaneRegion:
    """A connected region.

    Attributes
    ----------
    outlines : tuple of ndarray (n,)
        Points x + iy [m]: the outer outline counter-clockwise, then those of its holes, clockwise.
    area : float
        Area without the holes [m^2].
    """

    outlines: tuple[Complex, ...]
    area: float


def chart_regions(
    found: Mapping[int, Iterable[PlaneRegion]], labels: Mapping[int, str]
) -> tuple[ChartRegion, ...]:
    """Regions for a chart, from regions by a sign; each gets the label of its sign."""
    return tuple(
        ChartRegion(
            tuple(np.stack([z.real, z.imag], axis=1) for z in one.outlines), labels[sign], one.area
        )
        for sign, some in found.items()
        for one in some
    )


def arc(center: complex, radius: float, first: float, last: float) -> CurvePiece:
    """Arc of a circle with a centre x + iy and a radius [m], from one angle [rad] to another.

    >>> round(arc(1.0, 2.0, 0.0, 2.0 * np.pi).area_integral / np.pi, 12)
    4.0
    """
    angle = np.linspace(first, last, max(9, int(np.abs(last - first) * 90)))
    points = center + radius * np.exp(1j * angle)
    chord_term = np.imag(np.conj(center) * (points[-1] - points[0]))
    return CurvePiece(points, 0.5 * float(radius**2 * (last - first) + chord_term))


def chord(first: complex, last: complex) -> CurvePiece:
    """Straight piece from one point x + iy [m] to another."""
    points = np.array([first, last], complex)
    return CurvePiece(points, 0.5 * float(np.imag(np.conj(first) * last)))


def overlap_area(distance: float, one: float, other: float) -> float:
    """Area [m^2] of the intersection of two discs, by the distance of their centres and radii [m].

    The error is a few roundings of the square of the larger radius.

    >>> bool(abs(overlap_area(1.0, 1.0, 1.0) - 2.0 * np.pi / 3.0 + np.sqrt(3.0) / 2.0) < 1e-15)
    True
    >>> overlap_area(3.0, 1.0, 2.0), overlap_area(0.5, 1.0, 2.0) == np.pi
    (0.0, True)
    """
    if min(one, other) == 0.0 or distance >= one + other:
        return 0.0
    if distance <= abs(one - other):
        return float(np.pi * min(one, other) ** 2)
    total, difference = one + other, one - other
    outer, inner = (total - distance) * (total + distance), (distance - difference)
    kite = np.sqrt(outer * inner * (distance + difference))
    wedges = 0.0
    for near, excess in ((one, difference * total), (other, -difference * total)):
        # not arccos, nor a difference of squares, which lose digits at small distances
        wedges += near**2 * np.arctan2(kite, distance**2 + excess)
    return float(wedges - 0.5 * kite)


def is_inside(points: Complex, outline: Complex) -> NDArray[np.bool_]:
    """Whether points (n,) lie inside a closed outline (m,).

    >>> is_inside(np.array([0.5 + 0.5j, 2.0]), np.array([0.0, 1.0, 1.0 + 1.0j, 1.0j])).tolist()
    [True, False]
    """
    start, end = outline, np.roll(outline, -1)
    z = np.asarray(points, complex)[:, None]
    crosses = (start.imag > z.imag) != (end.imag > z.imag)
    with np.errstate(divide="ignore", invalid="ignore"):  # of horizontal edges, which do not count
        share = (z.imag - start.imag) / (end.imag - start.imag)
        right = z.real < start.real + share * (end.real - start.real)
    return np.asarray((crosses & right).sum(axis=1) % 2 == 1)


def join_regions(pieces: Iterable[CurvePiece], size: float) -> list[PlaneRegion]:
    """Connected regions to the left of pieces of curves, the largest first.

    Parameters
    ----------
    pieces : iterable of CurvePiece
        Each piece begins where another one ends, within `JOIN_DISTANCE` times the size.
    size : float
        Size of the mechanism [m].

    Raises
    ------
    ValueError
        A piece ends where none begins.

    Examples
    --------
    >>> ring = [arc(0.0, 2.0, 0.0, 2.0 * np.pi), arc(0.0, 1.0, 0.0, 2.0 * np.pi).back]
    >>> [round(one.area / np.pi, 12) for one in join_regions(ring, 1.0)]
    [3.0]
    """
    loops = join_loops([one for one in pieces if one.points.size > 1], size)
    outer = sorted(
        (one for one in loops if one.area_integral > 0.0), key=lambda one: -one.area_integral
    )
    holes: list[list[CurvePiece]] = [[] for _ in outer]
    for hole in (one for one in loops if one.area_integral <= 0.0):
        enclosing = [
            k for k, one in enumerate(outer) if np.mean(is_inside(hole.points, one.points)) > 0.5
        ]
        if enclosing:
            holes[enclosing[-1]].append(hole)
    found = [
        PlaneRegion(
            tuple(part.points for part in (one, *inside)),
            one.area_integral + sum(part.area_integral for part in inside),
        )
        for one, inside in zip(outer, holes, strict=True)
    ]
    return sorted(found, key=lambda one: -one.area)


def join_loops(pieces: list[CurvePiece], size: float) -> list[CurvePiece]:
    """Closed outlines, each made of consecutive pieces.

    Where several pieces begin at one point, the next piece is the one that turns furthest to the
    left.  The region is on the left, so that regions which only touch at a point stay separate.
    """
    starts = np.array([one.points[0] for one in pieces], complex)
    directions = np.array([one.points[1] - one.points[0] for one in pieces], complex)
    unused = np.ones(len(pieces), bool)
    loops = []
    while unused.any():
        first = current = int(np.argmax(unused))
        chain = []
        while True:
            unused[current] = False
            chain.append(pieces[current])
            end, before = pieces[current].points[-1], pieces[current].points[-2]
            candidates = np.abs(starts - end) < JOIN_DISTANCE * size
            candidates &= unused | (np.arange(len(pieces)) == first)
            if not candidates.any():
                raise ValueError(f"an outline ends at ({end.real:.6g}, {end.imag:.6g}) m")
            clockwise = -np.angle(directions / (before - end)) % (2.0 * np.pi)
            current = int(np.argmin(np.where(candidates, clockwise, np.inf)))
            if current == first:
                break
        loops.append(
            CurvePiece(
                np.concatenate([one.points[:-1] for one in chain]),
                sum(one.area_integral for one in chain),
            )
        )
    return loops
