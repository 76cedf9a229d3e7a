"""Workspace of the tip of a five-bar linkage: reach, both kinds of singularities, and aspects."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.linkages.fivebar.kinematics import (
    FivebarLengths,
    cross,
    dot,
    solve_inverse,
)
from proofmass.analytic.linkages.regions import (
    CurvePiece,
    PlaneRegion,
    arc,
    join_regions,
    overlap_area,
)
from proofmass.analytic.numerics import TURN
from proofmass.base.arrays import Array, Complex

WORKING_MODE_PAIRS: tuple[tuple[int, int], ...] = ((1, 1), (1, -1), (-1, 1), (-1, -1))
"""The four working modes: left_mode and right_mode of `solve_inverse`."""
CURVE_SAMPLES = 721
"""Number of samples of a singular curve; between two of them the working mode may change once."""
QUADRATURE_PARTS, QUADRATURE_NODES = 8, 24
"""Gauss quadrature along a piece of a curve: number of parts, and of nodes in each part."""
MODE_BISECTIONS = 60
"""Number of bisections of an interval in which the mode changes: to the last bit."""


def reach_area(link: FivebarLengths) -> float:
    """Area [m^2] of the reach, the intersection of two rings, from intersections of two discs.

    The result is exact: the intersection of both outer discs, less those of an inner disc with the
    outer disc of the other side, plus that of both inner discs, which is subtracted twice.

    >>> round(reach_area(FivebarLengths(4.0, 5.0, 5.0, 4.0, -3.0, 3.0)), 9)
    142.220552057
    """
    radii: dict[str, dict[int, float]] = {"left": {}, "right": {}}
    for _, radius, sense, side in link.circles:
        radii[side][sense] = radius
    return sum(
        one * other * overlap_area(abs(link.base), radii["left"][one], radii["right"][other])
        for one in radii["left"]
        for other in radii["right"]
    )


@dataclass(frozen=True)
class SingularPiece:
    """A piece of a type 2 singularity in the plane of the tip, in one working mode.

    Attributes
    ----------
    curve : CurvePiece
        Curve of the tip; on its left `assembly` is positive.
    mode : tuple of int
        left_mode and right_mode.
    stretched : bool
        Whether the couplers are stretched; otherwise they are folded onto each other.
    left, right : ndarray (n,)
        Crank pins x + iy [m] at the points of the curve.
    """

    curve: CurvePiece
    mode: tuple[int, int]
    stretched: bool
    left: Complex
    right: Complex


CurveFunction = Callable[[Array], tuple[Complex, Complex, Complex, Complex]]
"""Function of a parameter: tip, its derivative by the parameter, left and right crank pin."""


def type_2(link: FivebarLengths) -> list[SingularPiece]:
    r"""Type 2 singularities: curves of the tip with couplers in line, divided by working mode.

    ::

        L-----T----------R  stretched, |L - R| = c + r        T = L + (R - L) c/(c + r)
        L----------R-----T  folded,    |L - R| = |c - r|      T = L + (R - L) c/(c - r)

    With the couplers in line the linkage is a four-bar, and T moves on its coupler curve.  At a
    left angle alpha the right angle is one of two.  On an interval of alpha where
    they exist, the parameter u with alpha = middle - half cos(u) removes the square roots at its
    ends.  A piece ends where a crank and its coupler are in line, too: there the tip is on the
    border of the reach, and the working mode changes.  Couplers of equal length can be folded with
    both crank pins at one point, an intersection of the cranks' circles, about which they turn.

    Returns
    -------
    list of SingularPiece
        Pieces whose points are exact but for rounding; areas are computed by Gauss quadrature with
        an error below 1e-9 of the whole.
    """
    found: list[SingularPiece] = []
    for stretched in (True, False):
        for track, first, last in type_2_curves(link, stretched):
            found += divide_by_mode(link, track, first, last, stretched)
    return found


def type_2_curves(
    link: FivebarLengths, stretched: bool
) -> Iterator[tuple[CurveFunction, float, float]]:
    """Curves on which the couplers are stretched, or folded, with the limits of their parameter."""
    c, r = link.left_coupler, link.right_coupler
    pin_distance = c + r if stretched else abs(c - r)
    if pin_distance == 0.0:
        yield from coincident_pin_curves(link)
        return
    share, m = c / (c + r if stretched else c - r), link.right_crank
    end_distances = np.array([m + pin_distance, abs(m - pin_distance)])
    with np.errstate(divide="ignore", invalid="ignore"):  # both fixed pins at one point: no ends
        cosine = (link.base**2 + link.left_crank**2 - end_distances**2) / (
            2.0 * link.base * link.left_crank
        )
    ends = np.arccos(cosine[np.abs(cosine) < 1.0])
    ends = np.sort(np.concatenate([ends, TURN - ends]))
    edges = np.append(ends, ends[0] + TURN) if ends.size else np.array([0.0, TURN])
    for low, high in pairwise(edges):
        s = abs(link.left_crank * np.exp(0.5j * (low + high)) - link.base)
        if not abs(m - pin_distance) < s < m + pin_distance:
            continue
        for branch in (1, -1):

            def track(
                u: Array, low: float = low, high: float = high, branch: int = branch
            ) -> tuple[Complex, Complex, Complex, Complex]:
                half, slope = 0.5 * (high - low), np.sin(u)
                alpha = 0.5 * (low + high) - half * np.cos(u)
                p = link.left_crank * np.exp(1j * alpha)
                s = p - link.base
                cosine = (np.abs(s) ** 2 + m**2 - pin_distance**2) / (2.0 * np.abs(s) * m)
                beta = np.angle(s) + branch * np.arccos(np.clip(cosine, -1.0, 1.0))
                q = m * np.exp(1j * beta)
                across = q - s
                with np.errstate(divide="ignore", invalid="ignore"):  # at the ends of alpha
                    turn = slope * dot(across, 1j * p) / dot(across, 1j * q)
                    speed = half * 1j * (slope * p + share * (turn * q - slope * p))
                left = link.left_x + p
                return left + share * across, speed, left, link.right_x + q

            yield track, 0.0, np.pi


def coincident_pin_curves(link: FivebarLengths) -> Iterator[tuple[CurveFunction, float, float]]:
    """Circles of the tip about crank pins that coincide, which couplers of equal length allow."""
    g, one, other = abs(link.base), link.left_crank, link.right_crank
    if not abs(one - other) < g < one + other:
        return
    x = (link.base**2 + one**2 - other**2) / (2.0 * link.base)
    for up in (1, -1):
        pin = complex(link.left_x + x, up * np.sqrt(one**2 - x**2))

        def track(u: Array, pin: complex = pin) -> tuple[Complex, Complex, Complex, Complex]:
            arm = link.left_coupler * np.exp(1j * u)
            same = np.full(arm.shape, pin)
            return pin + arm, 1j * arm, same, same

        yield track, 0.0, TURN


def divide_by_mode(
    link: FivebarLengths, track: CurveFunction, first: float, last: float, stretched: bool
) -> Iterator[SingularPiece]:
    """Pieces of a curve, which is divided where its working mode changes."""

    def sides(u: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        tip, _, left, right = track(u)
        return (
            cross(left - link.left_x, tip - left) < 0.0,
            cross(right - link.right_x, tip - right) < 0.0,
        )

    u = np.linspace(first, last, CURVE_SAMPLES + 1)[:-1] + 0.5 * (last - first) / CURVE_SAMPLES
    cuts = [first, last]
    for k, sign in enumerate(sides(u)):
        changes = np.flatnonzero(sign[:-1] != sign[1:])
        low, high, before = u[changes], u[changes + 1], sign[changes]
        for _ in range(MODE_BISECTIONS):
            middle = 0.5 * (low + high)
            same = sides(middle)[k] == before
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        cuts += low.tolist()
    cuts.sort()
    for start, end in pairwise(cuts):
        if end - start < 1e-9:
            continue
        here = np.array([0.5 * (start + end)])
        left_mode, right_mode = (1 if sign[0] else -1 for sign in sides(here))
        curve, pins = sample_piece(track, start, end)
        if not is_increasing_to_left(link, track, here):
            curve, pins = curve.back, pins[:, ::-1]
        yield SingularPiece(curve, (left_mode, right_mode), stretched, *pins)


def sample_piece(track: CurveFunction, low: float, high: float) -> tuple[CurvePiece, Complex]:
    """Piece of a curve between two parameters, with its area integral; its crank pins (2, n)."""
    nodes, weights = np.polynomial.legendre.leggauss(QUADRATURE_NODES)
    edges = np.linspace(low, high, QUADRATURE_PARTS + 1)
    half = 0.5 * np.diff(edges)[:, None]
    tip, speed, *_ = track((edges[:-1, None] + half * (1.0 + nodes)).ravel())
    swept = 0.5 * float(
        np.sum(cross(tip, speed).reshape(QUADRATURE_PARTS, QUADRATURE_NODES) * half * weights)
    )
    points, _, left, right = track(np.linspace(low, high, max(25, int(120 * (high - low)))))
    return CurvePiece(points, swept), np.array([left, right])


def is_increasing_to_left(link: FivebarLengths, track: CurveFunction, u: Array) -> bool:
    """Whether a x b increases to the left of a curve on which it is zero.

    The crank angles follow the tip: for its velocity v the crank rates are a.v/(p x a) and
    b.v/(q x b).
    """
    tip, speed, left, right = (value[0] for value in track(u))
    v = 1j * speed / abs(speed)
    p, q, a, b = left - link.left_x, right - link.right_x, tip - left, tip - right
    one, other = dot(a, v) / cross(p, a), dot(b, v) / cross(q, b)
    return bool(cross(v - 1j * one * p, b) + cross(a, v - 1j * other * q) > 0.0)


def reach_border(
    link: FivebarLengths, cuts: Complex | None = None
) -> Iterator[tuple[CurvePiece, str]]:
    """Arcs that bound the reach, which is on their left, each with the side that is in line there.

    The arcs are type 1 singularities: a crank and its coupler are stretched or folded.  Arcs are
    divided at those points `cuts` [m] that are on them.
    """
    for center, radius, sense, side in link.circles:
        others = [one for one in link.circles if one[3] != side]
        angles = [
            angle for x, far, *_ in others for angle in circle_crossings(center, radius, x, far)
        ]
        if cuts is not None:
            on = np.abs(np.abs(cuts - center) - radius) < 1e-7 * link.size
            angles += (np.angle(cuts[on] - center) % TURN).tolist()
        ends = np.sort(angles)
        ends = ends[np.diff(ends, prepend=-1.0) > 1e-9]  # a cut at a corner is the corner
        edges = np.append(ends, ends[0] + TURN) if ends.size else np.array([0.0, TURN])
        for low, high in pairwise(edges):
            middle = center + radius * np.exp(0.5j * (low + high))
            inside = [far * s > s * abs(middle - x) for x, far, s, _ in others]
            if all(inside) and high - low > 1e-9:
                piece = arc(center, radius, low, high)
                yield (piece if sense > 0 else piece.back), side


def circle_crossings(
    center: float, radius: float, other_center: float, other_radius: float
) -> list[float]:
    """Angles [rad] on a circle about (center, 0) where the circle about (x, 0) crosses it."""
    g = other_center - center
    if g == 0.0 or not abs(radius - other_radius) < abs(g) < radius + other_radius:
        return []
    angle = float(np.arccos((g**2 + radius**2 - other_radius**2) / (2.0 * g * radius)))
    return [angle, TURN - angle]


def aspects(
    link: FivebarLengths, mode: tuple[int, int], singular: list[SingularPiece] | None = None
) -> dict[int, list[PlaneRegion]]:
    """Aspects of the reach in one working mode, by their assembly mode.

    Within an aspect the tip can move everywhere in one working mode and one assembly mode.

    Parameters
    ----------
    link : FivebarLengths
    mode : tuple of int
        left_mode and right_mode of `solve_inverse`.
    singular : list of SingularPiece
        Result of `type_2` if it is known; None computes it.

    Raises
    ------
    ValueError
        Singular curves of the mode cross each other, as they may for special lengths.
    """
    pieces = [one for one in (type_2(link) if singular is None else singular) if one.mode == mode]
    ends = np.array([one.curve.points[[0, -1]] for one in pieces], complex).ravel()
    border = [piece for piece, _ in reach_border(link, ends)]
    middles = np.array([one.points[one.points.size // 2] for one in border], complex)
    sign = np.sign(
        solve_inverse(
            [middles.real, middles.imag], **asdict(link), left_mode=mode[0], right_mode=mode[1]
        )["assembly"]
    )
    return {
        assembly: join_regions(
            [
                *(one for one, s in zip(border, sign, strict=True) if s == assembly),
                *(one.curve if assembly > 0 else one.curve.back for one in pieces),
            ],
            link.size,
        )
        for assembly in (1, -1)
    }
