"""Workspace of a 3PRR robot: slices at one angle, their aspects, and all angles at one point."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.linkages.regions import (
    CurvePiece,
    PlaneRegion,
    chord,
    join_regions,
)
from proofmass.analytic.linkages.threeprr.kinematics import (
    UNIT_CORNERS,
    RobotLengths,
    cross,
    signs_of_mode,
)
from proofmass.analytic.numerics import TURN, broadcast_motion, check_finite, check_number
from proofmass.base.arrays import Array, Complex

SLICE_CURVE_SAMPLES = 721
"""Number of samples of a singular curve, which may leave the slice once between two of them."""
SLICE_PARTS = 8
"""Number of parts of a piece of a curve, each with its own Gauss quadrature."""
SLICE_NODES, SLICE_WEIGHTS = np.polynomial.legendre.leggauss(24)
SLICE_BISECTIONS = 60
"""Number of bisections of an interval in which a curve leaves the slice: to the last bit."""
ZERO_VECTOR_SHARE = 1e-9
"""Share of the largest possible |w|; a smaller |w| is zero, but for rounding."""
END_OFFSET = 1e-7
"""Distance of a curve's parameter from its ends, at which w may be zero, without direction."""
INWARD_SHARE = 1e-6
"""Share of the way from an edge to the middle of a slice: at special angles, edges are singular."""


@dataclass(frozen=True)
class WorkspaceSlice:
    """Points that P reaches at one angle of the platform: a rectangle, for sliders without limits.

    Legs 1 and 2 must reach guides on y = 0, leg 3 a guide on x = guide3_x: |y|, |y + side sin(psi)|
    and |x + side cos(psi + 60 deg) - guide3_x| are at most the length of a leg.

    Attributes
    ----------
    robot : RobotLengths
    psi : float
        Angle of the platform [rad].
    """

    robot: RobotLengths
    psi: float

    def __post_init__(self) -> None:
        check_number(psi=self.psi)

    @property
    def arms(self) -> Complex:
        """Vectors from P to the three corners, (3,) [m]."""
        return np.asarray(self.robot.side * UNIT_CORNERS[:, 0] * np.exp(1j * self.psi))

    @property
    def x(self) -> tuple[float, float]:
        """Left and right edge [m]."""
        middle = self.robot.guide3_x - float(self.arms[2].real)
        return middle - self.robot.leg, middle + self.robot.leg

    @property
    def y(self) -> tuple[float, float]:
        """Lower and upper edge [m]; if no point is reached, the lower one is the larger."""
        rise = float(self.arms[1].imag)
        return max(0.0, -rise) - self.robot.leg, min(0.0, -rise) + self.robot.leg

    @property
    def area(self) -> float:
        """Area of the rectangle: 2 L (2 L - side |sin(psi)|), or zero [m^2]."""
        return (self.x[1] - self.x[0]) * max(0.0, self.y[1] - self.y[0])

    def level(self, y: Array, mode: int) -> Complex:
        """Vector w (...) [m^3] at heights y [m]: leg^3 side singularity is w x e3."""
        first, second, _ = signs_of_mode(mode)
        arms, leg = self.arms, self.robot.leg
        other = y + arms[1].imag
        e1 = first * np.sqrt(np.maximum(leg**2 - y**2, 0.0)) + 1j * y
        e2 = -second * np.sqrt(np.maximum(leg**2 - other**2, 0.0)) + 1j * other
        return np.asarray(cross(e1, e2) * arms[2] - cross(arms[1], e2) * e1)

    def third_leg(self, x: Array, mode: int) -> Complex:
        """Vector e3 of leg 3 (...) [m] for P at x [m]."""
        across = x + self.arms[2].real - self.robot.guide3_x
        along = np.sqrt(np.maximum(self.robot.leg**2 - across**2, 0.0))
        return np.asarray(across - 1j * signs_of_mode(mode)[2] * along)

    def singularity(self, x: Array, y: Array, mode: int) -> Array:
        """Singularity measure of `solve_inverse` (...) at points (...) [m]; zero is type 2."""
        return cross(self.level(y, mode), self.third_leg(x, mode)) / (
            self.robot.leg**3 * self.robot.side
        )


def type_2_of_slice(part: WorkspaceSlice, mode: int) -> list[CurvePiece]:
    r"""Curves on which the direct problem is singular, at one angle, in one mode of the legs.

    ::

        singularity leg^3 side = w x e3,   w = (e1 x e2) b3 - (b2 x e2) e1

    e1, e2 and w depend on y only, e3 on x only, and the sign of e3 along its guide is that of the
    mode.  In a singular pose e3 is parallel to w, so that there is one x for each y.  Where w turns
    through the direction of x, the curve leaves the slice at one side and enters it at the other.
    Where w is zero, all x are singular: with legs as long as the platform's side, sliders 1 and 2
    may both be at its third corner.  The parameter u with y = middle - half cos(u) removes the
    square roots at the ends.

    Returns
    -------
    list of CurvePiece
        Pieces with positive `singularity` on their left.
    """
    low, high = part.y
    if high <= low:
        return []
    leg, side = part.robot.leg, signs_of_mode(mode)[2]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    center = part.robot.guide3_x - part.arms[2].real

    def level(u: Array) -> Complex:
        return part.level(middle - half * np.cos(u), mode)

    def x(u: Array) -> Array:
        w = level(u)
        return np.asarray(center - side * np.where(w.imag < 0.0, -leg, leg) * w.real / np.abs(w))

    u = np.linspace(0.0, np.pi, SLICE_CURVE_SAMPLES + 1)[:-1] + 0.5 * np.pi / SLICE_CURVE_SAMPLES
    sign = np.signbit(level(u).imag)
    changes = np.flatnonzero(sign[:-1] != sign[1:])
    first, last, before = u[changes], u[changes + 1], sign[changes]
    for _ in range(SLICE_BISECTIONS):
        middles = 0.5 * (first + last)
        same = np.signbit(level(middles).imag) == before
        first, last = np.where(same, middles, first), np.where(same, last, middles)
    is_zero = np.abs(level(first)) < ZERO_VECTOR_SHARE * leg**2 * part.robot.side
    starts, ends = np.append(0.0, last), np.append(first, np.pi)
    x_at_ends = np.stack([x(starts + END_OFFSET), x(ends - END_OFFSET)])
    common_x = 0.5 * (x_at_ends[0, 1:] + x_at_ends[1, :-1])
    x_at_ends[0, 1:] = np.where(is_zero, common_x, x_at_ends[0, 1:])
    x_at_ends[1, :-1] = np.where(is_zero, common_x, x_at_ends[1, :-1])
    found = []
    for start, end, end_x in zip(starts, ends, x_at_ends.T, strict=True):
        along = np.linspace(start, end, max(25, int(80 * (end - start))))
        across = np.concatenate([end_x[:1], x(along[1:-1]), end_x[1:]])
        points = across + 1j * (middle - half * np.cos(along))
        knots = np.linspace(start, end, SLICE_PARTS + 1)
        step = 0.5 * np.diff(knots)[:, None]
        inner = knots[:-1, None] + step * (1.0 + SLICE_NODES)
        integral = float(np.sum(x(inner) * half * np.sin(inner) * step * SLICE_WEIGHTS))
        end_pair = points[[0, -1]]
        piece = CurvePiece(
            points, integral - 0.5 * float(np.diff(end_pair.real * end_pair.imag)[0])
        )
        here = np.array([0.5 * (start + end)])
        e3 = part.third_leg(x(here), mode)
        rises = cross(level(here), np.asarray(1.0 - 1j * e3.real / e3.imag, complex))
        found.append(piece if rises[0] < 0.0 else piece.back)
    for turn, place in zip(first[is_zero], common_x[is_zero], strict=True):
        height = 1j * (middle - half * np.cos(turn))
        for one, other in pairwise([part.x[0], place, part.x[1]]):
            above = np.array([0.5 * (one + other)]), height.imag + END_OFFSET * np.ones(1)
            piece = chord(one + height, other + height)
            found.append(piece if part.singularity(*above, mode)[0] > 0.0 else piece.back)
    return found


def slice_border(part: WorkspaceSlice, ends: Complex) -> Iterator[CurvePiece]:
    """Edges of a slice, counter-clockwise, divided at the ends of curves on them."""
    (left, right), (low, high) = part.x, part.y
    corners = [left + 1j * low, right + 1j * low, right + 1j * high, left + 1j * high]
    for start, end in pairwise([*corners, corners[0]]):
        edge = end - start
        share = (ends - start) / edge
        on_edge = np.abs(share.imag * np.abs(edge)) < 1e-6 * part.robot.size
        cuts = np.sort(share.real[on_edge & (share.real > 1e-9) & (share.real < 1.0 - 1e-9)])
        for one, other in pairwise([0.0, *cuts.tolist(), 1.0]):
            if other - one > 1e-9:
                yield chord(start + one * edge, start + other * edge)


def aspects_of_slice(part: WorkspaceSlice, mode: int) -> dict[int, list[PlaneRegion]]:
    """Aspects of a slice in one mode of the legs, by the sign of the singularity measure.

    An aspect is a part of the slice without singular poses in its interior.

    Raises
    ------
    ValueError
        Singular curves cross each other, as they may at special angles.
    """
    curves = type_2_of_slice(part, mode)
    if not curves:
        return {1: [], -1: []}
    edges = list(slice_border(part, np.array([one.points[[0, -1]] for one in curves]).ravel()))
    middle = np.array([one.points.mean() for one in edges])
    middle += INWARD_SHARE * (complex(np.mean(part.x), np.mean(part.y)) - middle)
    sign = part.singularity(middle.real, middle.imag, mode)
    return {
        side: join_regions(
            [
                *(one for one, s in zip(edges, sign, strict=True) if s * side > 0.0),
                *(one if side > 0 else one.back for one in curves),
            ],
            part.robot.size,
        )
        for side in (1, -1)
    }


def volume(robot: RobotLengths) -> float:
    """Integral of the area of slices over all angles of the platform [m^2 rad].

    >>> robot = RobotLengths(1.0, 1.0, 3.0, 2.0, 2.0)
    >>> abs(volume(robot) - 8.0 * (np.pi - 1.0)) < 1e-12
    True
    """
    double_leg = 2.0 * robot.leg
    last = float(np.arcsin(min(1.0, double_leg / robot.side)))
    return float(4.0 * double_leg * (double_leg * last - robot.side * (1.0 - np.cos(last))))


def angles_of_place(x: ArrayLike, y: ArrayLike, robot: RobotLengths) -> Array:
    """Measure of the platform's angles [rad] (...) that are possible with P at x, y (...) [m].

    The result is exact: the angles at which a leg is perpendicular to its guide divide the full
    turn, and between two of them either all angles are reached or none.

    >>> angles_of_place([1.5, 9.0], [0.2, 0.2], RobotLengths(0.5, 1.0, 3.0, 1.5, 2.0)).round(6)
    array([6.283185, 0.      ])
    """
    px, py = broadcast_motion(x=x, y=y)
    leg, side, tilt = robot.leg, robot.side, np.pi / 3.0
    with np.errstate(invalid="ignore"):  # arcsin or arccos without a value
        rise = np.arcsin((np.array([-leg, leg]) - py[..., None]) / side)
        lean = np.arccos((robot.guide3_x + np.array([-leg, leg]) - px[..., None]) / side)
    knots = np.concatenate([rise, np.pi - rise, lean - tilt, -lean - tilt], axis=-1) % TURN
    knots = np.where(np.isfinite(knots), knots, 0.0)
    knots = np.sort(np.concatenate([knots, np.zeros((*px.shape, 1))], axis=-1), axis=-1)
    width = np.diff(knots, axis=-1, append=TURN)
    middle = knots + 0.5 * width
    second = np.abs(py[..., None] + side * np.sin(middle)) <= leg
    third = np.abs(px[..., None] + side * np.cos(middle + tilt) - robot.guide3_x) <= leg
    return np.asarray(np.where(np.abs(py) <= leg, np.sum(width * (second & third), axis=-1), 0.0))


def reach_of_place(y: ArrayLike, robot: RobotLengths) -> Array:
    """Two intervals of x [m] that P reaches at some angle, (..., 2, 2), at heights y [m] (...).

    At a given height psi lies in one of two arcs, about 0 and about half a turn.  For each arc, x
    has the range of guide3_x - side cos(psi + 60 deg), extended by the length of a leg on both
    sides.  Intervals that overlap are joined, and the second one is then NaN; both are NaN where no
    point is reached.
    """
    check_finite(y=y)
    height, leg, side = np.asarray(y, float), robot.leg, robot.side
    low, high = (np.arcsin(np.clip((end - height) / side, -1.0, 1.0)) for end in (-leg, leg))
    found = np.empty((*height.shape, 2, 2))
    for k, (first, last, peak) in enumerate(
        ((low, high, -np.pi / 3.0), (np.pi - high, np.pi - low, 2.0 * np.pi / 3.0))
    ):
        ends = np.cos(np.array([first, last]) + np.pi / 3.0)
        within = (first <= peak) & (peak <= last)
        most = np.where(within & (peak < 0.0), 1.0, ends.max(axis=0))
        least = np.where(within & (peak > 0.0), -1.0, ends.min(axis=0))
        found[..., k, :] = np.stack([-side * most - leg, -side * least + leg], axis=-1)
    overlap = found[..., 0].max(axis=-1) <= found[..., 1].min(axis=-1)
    whole = np.stack([found[..., 0].min(axis=-1), found[..., 1].max(axis=-1)], axis=-1)
    found[overlap, 0], found[overlap, 1] = whole[overlap], np.nan
    found[(np.abs(height) > leg) | (height - leg > side) | (height + leg < -side)] = np.nan
    return found + robot.guide3_x


def reach_area_of_place(robot: RobotLengths) -> float:
    """Area [m^2] of the points that P reaches at some angle of the platform.

    It is integrated by Gauss quadrature between the heights at which the form of the intervals
    changes; the relative error is below 1e-8.
    """
    leg, side = robot.leg, robot.side
    kink_sines = np.array([1.0, np.sqrt(0.75), 0.5, 0.0])
    knots = np.concatenate(
        [sign * leg + other * side * kink_sines for sign in (1, -1) for other in (1, -1)]
    )
    knots = np.unique(np.append(knots[np.abs(knots) < leg], [-leg, leg]))
    nodes, weights = np.polynomial.legendre.leggauss(64)
    u = 0.5 * np.pi * (nodes + 1.0)
    half = 0.5 * np.diff(knots)[:, None]
    y = (knots[:-1, None] + half * (1.0 - np.cos(u))).ravel()
    widths = np.nansum(np.diff(reach_of_place(y, robot), axis=-1)[..., 0], axis=-1)
    return float(np.sum(widths.reshape(half.size, -1) * half * np.sin(u) * weights) * 0.5 * np.pi)
