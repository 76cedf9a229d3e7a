"""Where the tip of a five-bar linkage gets: its reach, both kinds of singularities, the aspects."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.linkages.fivebar.kinematics import (
    check,
    cross,
    dot,
    solve_inverse,
)
from proofmass.analytic.linkages.regions import (
    CurvePiece,
    PlaneRegion,
    arc,
    joined_regions,
    overlap,
)
from proofmass.analytic.numerics import TURN, Array, Complex

WORKING: tuple[tuple[int, int], ...] = ((1, 1), (1, -1), (-1, 1), (-1, -1))
"""The four working modes: left_mode and right_mode of `solve_inverse`."""
SAMPLES = 721
"""Of a curve of singularities, between which its working mode may change once."""
PARTS, NODES = 8, 24
"""Gauss quadrature along a piece of a curve: parts, and nodes in each."""
HALVINGS = 60
"""Of an interval about a change of mode: to the last bit."""


@dataclass(frozen=True)
class FivebarLengths:
    """What the reach of a five-bar linkage depends on.

    Attributes
    ----------
    left_crank, left_coupler, right_coupler, right_crank : float
        Lengths between pins [m].
    left_x, right_x : float
        Places of the fixed pins on the x axis [m].
    """

    left_crank: float
    left_coupler: float
    right_coupler: float
    right_crank: float
    left_x: float
    right_x: float

    def __post_init__(self) -> None:
        check(**asdict(self))

    @property
    def base(self) -> float:
        """From the left to the right fixed pin [m]."""
        return self.right_x - self.left_x

    @property
    def size(self) -> float:
        """Sum of all lengths [m]."""
        return (
            abs(self.base)
            + self.left_crank
            + self.left_coupler
            + self.right_coupler
            + self.right_crank
        )

    @property
    def circles(self) -> tuple[tuple[float, float, int, str], ...]:
        """Centre, radius [m], +1 outer or -1 inner, and side of the circles that bound the reach.

        One of radius zero, of a crank as long as its coupler, is none.
        """
        found = []
        for side, x, crank, coupler in (
            ("left", self.left_x, self.left_crank, self.left_coupler),
            ("right", self.right_x, self.right_crank, self.right_coupler),
        ):
            found.append((x, crank + coupler, 1, side))
            if crank != coupler:
                found.append((x, abs(crank - coupler), -1, side))
        return tuple(found)


def reach_area(link: FivebarLengths) -> float:
    """Area [m^2] that two rings have in common, by the area that two discs have in common.

    Exact: the lens of both outer discs, less those with an inner one, and what that takes twice.

    >>> round(reach_area(FivebarLengths(4.0, 5.0, 5.0, 4.0, -3.0, 3.0)), 9)
    142.220552057
    """
    radii: dict[str, dict[int, float]] = {"left": {}, "right": {}}
    for _, radius, sense, side in link.circles:
        radii[side][sense] = radius
    return sum(
        one * other * overlap(abs(link.base), radii["left"][one], radii["right"][other])
        for one in radii["left"]
        for other in radii["right"]
    )


@dataclass(frozen=True)
class SingularPiece:
    """A piece of a type 2 singularity in the plane of the tip, in one working mode.

    Attributes
    ----------
    curve : CurvePiece
        Run so that the couplers turn left, `assembly` positive, on its left.
    mode : tuple of int
        left_mode and right_mode.
    stretched : bool
        The couplers are stretched, else folded upon each other.
    left, right : ndarray (n,)
        Crank pins x + iy [m] at the points of the curve.
    """

    curve: CurvePiece
    mode: tuple[int, int]
    stretched: bool
    left: Complex
    right: Complex


Track = Callable[[Array], tuple[Complex, Complex, Complex, Complex]]
"""Tip, its derivative, and both crank pins at values of a parameter."""


def type_2(link: FivebarLengths) -> list[SingularPiece]:
    r"""Where the couplers are in line: all pieces of the curves, each in one working mode.

    ::

        L-----T----------R  stretched, |L - R| = c + r        T = L + (R - L) c/(c + r)
        L----------R-----T  folded,    |L - R| = |c - r|      T = L + (R - L) c/(c - r)

    With the couplers in line the linkage is a four-bar, so T runs along its coupler curve.  At a
    left angle alpha the right one is arg(s) -+ open, as in `in_line`; on an interval of alpha
    where there is one, alpha = middle - half cos(u) takes the square roots out of its ends.  A
    piece ends where a crank and its coupler get in line too: there the tip is on the border of the
    reach and the working mode changes.  For couplers of one length the folded ones turn about a
    crossing of the cranks' circles.

    Returns
    -------
    list of SingularPiece
        Points within rounding of the curve; areas by Gauss quadrature, error below 1e-9 of all.
    """
    found: list[SingularPiece] = []
    for stretched in (True, False):
        for track, first, last in tracks(link, stretched):
            found += parted_by_mode(link, track, first, last, stretched)
    return found


def tracks(link: FivebarLengths, stretched: bool) -> Iterator[tuple[Track, float, float]]:
    """The curves on which the couplers are stretched, or folded, and their parameter's ends."""
    c, r = link.left_coupler, link.right_coupler
    apart = c + r if stretched else abs(c - r)
    if apart == 0.0:
        yield from coinciding(link)
        return
    share, m = c / (c + r if stretched else c - r), link.right_crank
    reached = np.array([m + apart, abs(m - apart)])
    with np.errstate(divide="ignore", invalid="ignore"):  # both fixed pins in one place: no ends
        cosine = (link.base**2 + link.left_crank**2 - reached**2) / (
            2.0 * link.base * link.left_crank
        )
    ends = np.arccos(cosine[np.abs(cosine) < 1.0])
    ends = np.sort(np.concatenate([ends, TURN - ends]))
    edges = np.append(ends, ends[0] + TURN) if ends.size else np.array([0.0, TURN])
    for low, high in pairwise(edges):
        s = abs(link.left_crank * np.exp(0.5j * (low + high)) - link.base)
        if not abs(m - apart) < s < m + apart:
            continue
        for branch in (1, -1):

            def track(
                u: Array, low: float = low, high: float = high, branch: int = branch
            ) -> tuple[Complex, Complex, Complex, Complex]:
                half, slope = 0.5 * (high - low), np.sin(u)
                alpha = 0.5 * (low + high) - half * np.cos(u)
                p = link.left_crank * np.exp(1j * alpha)
                s = p - link.base
                cosine = (np.abs(s) ** 2 + m**2 - apart**2) / (2.0 * np.abs(s) * m)
                beta = np.angle(s) + branch * np.arccos(np.clip(cosine, -1.0, 1.0))
                q = m * np.exp(1j * beta)
                across = q - s
                with np.errstate(divide="ignore", invalid="ignore"):  # at the ends of alpha
                    turn = slope * dot(across, 1j * p) / dot(across, 1j * q)
                    speed = half * 1j * (slope * p + share * (turn * q - slope * p))
                left = link.left_x + p
                return left + share * across, speed, left, link.right_x + q

            yield track, 0.0, np.pi


def coinciding(link: FivebarLengths) -> Iterator[tuple[Track, float, float]]:
    """Circles of the tip about crank pins in one place, which couplers of one length allow."""
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


def parted_by_mode(
    link: FivebarLengths, track: Track, first: float, last: float, stretched: bool
) -> Iterator[SingularPiece]:
    """A curve cut where its working mode changes."""

    def sides(u: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        tip, _, left, right = track(u)
        return (
            cross(left - link.left_x, tip - left) < 0.0,
            cross(right - link.right_x, tip - right) < 0.0,
        )

    u = np.linspace(first, last, SAMPLES + 1)[:-1] + 0.5 * (last - first) / SAMPLES
    cuts = [first, last]
    for k, sign in enumerate(sides(u)):
        at = np.flatnonzero(sign[:-1] != sign[1:])
        low, high, before = u[at], u[at + 1], sign[at]
        for _ in range(HALVINGS):
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
        curve, pins = sampled(track, start, end)
        if not rises_to_the_left(link, track, here):
            curve, pins = curve.back, pins[:, ::-1]
        yield SingularPiece(curve, (left_mode, right_mode), stretched, *pins)


def sampled(track: Track, low: float, high: float) -> tuple[CurvePiece, Complex]:
    """A piece of a curve with what it sweeps, and the crank pins (2, n) along it."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    edges = np.linspace(low, high, PARTS + 1)
    half = 0.5 * np.diff(edges)[:, None]
    tip, speed, *_ = track((edges[:-1, None] + half * (1.0 + nodes)).ravel())
    swept = 0.5 * float(np.sum(cross(tip, speed).reshape(PARTS, NODES) * half * weights))
    points, _, left, right = track(np.linspace(low, high, max(25, int(120 * (high - low)))))
    return CurvePiece(points, swept), np.array([left, right])


def rises_to_the_left(link: FivebarLengths, track: Track, u: Array) -> bool:
    """Whether a x b grows to the left of a curve of its zeros, both crank angles following.

    For a velocity v of the tip the cranks have the rates a.v/(p x a) and b.v/(q x b).
    """
    tip, speed, left, right = (value[0] for value in track(u))
    v = 1j * speed / abs(speed)
    p, q, a, b = left - link.left_x, right - link.right_x, tip - left, tip - right
    one, other = dot(a, v) / cross(p, a), dot(b, v) / cross(q, b)
    return bool(cross(v - 1j * one * p, b) + cross(a, v - 1j * other * q) > 0.0)


def reach_border(
    link: FivebarLengths, cuts: Complex | None = None
) -> Iterator[tuple[CurvePiece, str]]:
    """Arcs that bound the reach, which is on their left, and the side that is in line there.

    They are type 1 singularities: a crank and its coupler are stretched or folded.  `cuts` are
    more places [m] where an arc ends, as far as they are on it.
    """
    for center, radius, sense, side in link.circles:
        others = [one for one in link.circles if one[3] != side]
        angles = [angle for x, far, *_ in others for angle in crossings(center, radius, x, far)]
        if cuts is not None:
            on = np.abs(np.abs(cuts - center) - radius) < 1e-7 * link.size
            angles += (np.angle(cuts[on] - center) % TURN).tolist()
        ends = np.sort(angles)
        ends = ends[np.diff(ends, prepend=-1.0) > 1e-9]  # a cut in a corner is the corner
        edges = np.append(ends, ends[0] + TURN) if ends.size else np.array([0.0, TURN])
        for low, high in pairwise(edges):
            middle = center + radius * np.exp(0.5j * (low + high))
            inside = [far * s > s * abs(middle - x) for x, far, s, _ in others]
            if all(inside) and high - low > 1e-9:
                piece = arc(center, radius, low, high)
                yield (piece if sense > 0 else piece.back), side


def crossings(center: float, radius: float, x: float, far: float) -> list[float]:
    """Angles [rad] on a circle about (center, 0) where one about (x, 0) crosses it."""
    g = x - center
    if g == 0.0 or not abs(radius - far) < abs(g) < radius + far:
        return []
    angle = float(np.arccos((g**2 + radius**2 - far**2) / (2.0 * g * radius)))
    return [angle, TURN - angle]


def reach(link: FivebarLengths) -> list[PlaneRegion]:
    """The connected parts of what the tip can reach, the largest first."""
    return joined_regions((piece for piece, _ in reach_border(link)), link.size)


def aspects(
    link: FivebarLengths, mode: tuple[int, int], singular: list[SingularPiece] | None = None
) -> dict[int, list[PlaneRegion]]:
    """Parts of the reach that no singularity parts, in one working mode, by their assembly mode.

    Within one of them the tip can go everywhere in one working and one assembly mode.

    Parameters
    ----------
    link : FivebarLengths
    mode : tuple of int
        left_mode and right_mode of `solve_inverse`.
    singular : list of SingularPiece
        Of `type_2`, if they are there already.

    Raises
    ------
    ValueError
        Singularities cross each other within the mode, as they may for special lengths.
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
        assembly: joined_regions(
            [
                *(one for one, s in zip(border, sign, strict=True) if s == assembly),
                *(one.curve if assembly > 0 else one.curve.back for one in pieces),
            ],
            link.size,
        )
        for assembly in (1, -1)
    }
