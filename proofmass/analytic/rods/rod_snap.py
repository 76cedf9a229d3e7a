r"""Rod between a motor and a pin that is nearer than its length: it snaps from side to side.

All its shapes form one curve.  A rod with a pinned tip is a point (alpha, q) of the equilibrium
manifold of `proofmass.analytic.rods.elastica`, with its tip at z(alpha, q) in the clamp's frame.
With the clamp rotated by a from the line to the pin, and the pin at the distance d::

    log z = log(d) - i a                        two equations for alpha and q at a given a

The real part alone describes a level line on the manifold.  For q > 0 the rod is bent to the left
of the line to the pin; q < 0 is the mirror image.  The level line passes the arch between two pins,
where alpha = 2 K and 2 E/K - 1 = d.  In one direction from the arch a falls to the first fold, -a*,
where the rod snaps; the line continues through all higher modes, with one more negative direction
beyond each fold.  In the other direction a grows, and the rod is wound.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import ellipkm1

from proofmass.analytic.chart import Chart, ChartLine, Panel, line_through
from proofmass.analytic.numerics import TURN, check_positive
from proofmass.analytic.protocol import BendingStiffness, ClosedForm, Length, OneOf
from proofmass.analytic.rods.column import complete_integrals
from proofmass.analytic.rods.elastica import check_stiffness, from_inflection, rods_of_chart
from proofmass.base.arrays import Array, Complex

__all__ = ["branches", "events", "properties", "shapes", "solve"]

MIN_END_DISTANCE, MAX_DISTANCE = 0.32, 0.99  # distances that are tested, over the length
STRIDE = 0.01  # stride along the level line, in (log alpha, log q)
MAX_HALF_WAVES = 3.5  # half waves at the end of the level line, beyond the second fold
SNAP_NEWTON_STEPS = 4  # steps of Newton's method, from a guess with an error of about `STRIDE`^2


@dataclass(frozen=True)
class SnapFamily:
    """Shapes of a rod of unit length, bent to the left, in the order of the level line.

    The first one is the most wound one.

    Attributes
    ----------
    distance : float
        d, from the clamp to the pin [L].
    place : ndarray (n, 2)
        log(alpha), log(q) [1].
    angle : ndarray (n,)
        a, of the clamp's tangent from the line to the pin [rad].
    folds : ndarray of int (2,)
        Indices of the shapes that are folds; shapes before the first fold are stable.
    """

    distance: float
    place: Array
    angle: Array
    folds: NDArray[np.intp]

    @property
    def fold(self) -> float:
        """a* [rad]: to the left the rod is stable for a > -a*, to the right for a < a*."""
        return -float(self.angle[self.folds[0]])

    def at(self, angle: Array) -> tuple[Array, Array]:
        """alpha and q (n,) of the stable shapes at angles (n,) of the clamp, not below -a*."""
        table = slice(self.folds[0], None, -1)
        above = np.sqrt(self.angle[table] + self.fold)  # the line is smooth in this up to the fold
        root = np.sqrt(np.maximum(angle + self.fold, 0.0))  # it is negative by rounding at the fold
        u = np.stack([np.interp(root, above, column[table]) for column in self.place.T])
        for _ in range(SNAP_NEWTON_STEPS):
            value, slope = log_tip(u)
            step = _solve_real(slope, np.log(self.distance * np.exp(-1j * angle - value)))
            u += np.where(np.abs(step).max(axis=0) < STRIDE, step, 0.0)  # longer only at the fold
        return np.exp(u[0]), np.exp(u[1])


@lru_cache(maxsize=32)
def family(length: float, distance: float) -> SnapFamily:
    """Shapes of a rod from half a turn of the clamp to beyond the second fold.

    ValueError for a length that is not positive, or a distance that is not 0.32 to 0.99 of it.

    >>> round(float(np.degrees(family(1.0, 0.8).fold)), 6)
    54.337195
    """
    check_positive(length=length, distance=distance)
    if not MIN_END_DISTANCE * length <= distance <= MAX_DISTANCE * length:
        raise ValueError(
            f"distance must be from {MIN_END_DISTANCE:g} to {MAX_DISTANCE:g} of the length, "
            f"{length:g} m, got {distance:g}"
        )
    start = arch(distance / length)
    sense = float(np.sign(angle_decrease(start)))
    wound = follow_level_line(start, -sense, lambda _, value: float(-value.imag) % TURN > np.pi)
    onward = follow_level_line(start, sense, lambda u, _: half_waves(u) > MAX_HALF_WAVES)
    place = np.array(wound[:0:-1] + onward)
    turns = angle_decrease(place.T)
    before = np.flatnonzero(turns[1:] * turns[:-1] < 0.0)
    for i in before[::-1]:
        place = np.insert(place, i + 1, locate_fold(place[i], sense), axis=0)
    angle = np.unwrap(-log_tip(place[::-1].T)[0].imag)[::-1]  # from the end, which is not wound
    return SnapFamily(distance / length, place, angle, before + 1 + np.arange(before.size))


def sample_shapes(
    alpha: Array, q: Array, distance: Array | float, fraction: Array
) -> tuple[Complex, Array, Complex]:
    """Shapes of unit rods (n,) with the clamp at 0 and the pin at `distance`, on the x axis.

    Returns positions x + iy (m, n) at fractions (m,) of the length from the clamp, tangents (m, n)
    [rad] from the direction of the load, and that direction e^(i psi) (n,).
    """

    def from_tip(arc: Array) -> tuple[Complex, Array]:
        x, y, turn, _ = from_inflection(np.zeros(()), -np.tanh(q), 1.0 / np.cosh(q), arc)
        return np.asarray((x + 1j * y) / alpha), turn

    place, turn = from_tip(alpha * (1.0 - fraction[:, None]))
    load = distance / from_tip(alpha)[0]
    return distance - load * place, turn, load


def arch(distance: float) -> Array:
    """log(alpha), log(q) of the arch between two pins, 2 E/K - 1 = d."""

    def integrals(log_q: float) -> tuple[Array, Array]:
        return complete_integrals(1.0 / np.cosh(np.exp(np.array(log_q))))

    def distance_error(log_q: float) -> float:
        quarter, second = integrals(log_q)
        return float(2.0 * second / quarter - 1.0 - distance)

    log_q = brentq(distance_error, -15.0, 2.0, xtol=1e-15)
    return np.array([np.log(2.0 * integrals(log_q)[0]), log_q])


def log_tip(u: Array) -> tuple[Complex, Complex]:
    """log(z) (...) at log(alpha), log(q), (2, ...), and its derivatives by them (2, ...)."""
    alpha, q = np.exp(u)
    rod = rods_of_chart(alpha, q)
    return np.log(rod.tip), rod.tip_slope / rod.tip * np.stack([alpha, q])


def half_waves(u: Array) -> float:
    """Number of half waves between the clamp and the tip, as in `ElasticaRods`."""
    alpha, q = np.exp(u)
    return float(0.5 * alpha / ellipkm1((1.0 / np.cosh(q)) ** 2))


def angle_decrease(u: Array) -> Array:
    """Fall of the angle (...) per stride along the level line by `point_ahead`; zero at a fold."""
    slope = log_tip(u)[1]
    return np.asarray((slope[0].conj() * slope[1]).imag / np.hypot(*slope.real))


def point_ahead(u: Array, known: tuple[Complex, Complex], stride: float) -> Array:
    """Point of the level line a stride along the tangent from u, where `log_tip` is known."""
    value, slope = known
    level, (x, y) = value.real, slope.real
    v = u + stride * np.array([-y, x]) / np.hypot(x, y)
    for _ in range(SNAP_NEWTON_STEPS):
        value, slope = log_tip(v)
        v = v - slope.real * (value.real - level) / (slope.real @ slope.real)
    return np.asarray(v)


def follow_level_line(
    u: Array, sense: float, ends: Callable[[Array, Complex], bool]
) -> list[Array]:
    """Points of the level line from `u` to the first one for which `ends(point, log z)` is true."""
    points, known = [u], log_tip(u)
    while not ends(points[-1], known[0]):
        points.append(point_ahead(points[-1], known, sense * STRIDE))
        known = log_tip(points[-1])
    return points


def locate_fold(u: Array, sense: float) -> Array:
    """Fold within a stride of the level line from `u`, to rounding."""
    known = log_tip(u)
    share = brentq(
        lambda part: float(angle_decrease(point_ahead(u, known, sense * part))),
        0.0,
        STRIDE,
        xtol=1e-15,
    )
    return point_ahead(u, known, sense * share)


def _solve_real(slope: Complex, right: Complex) -> Array:
    """Real x, y (2, n) of the complex equations slope[0] x + slope[1] y = `right`."""
    cross = (slope[0].conj() * slope[1]).imag
    x, y = (right.conj() * slope[1]).imag, (slope[0].conj() * right).imag
    with np.errstate(divide="ignore", invalid="ignore"):  # cross is zero at a fold
        return np.asarray(np.stack([x, y]) / cross)


SHAPE_POINTS = 81  # points of a drawn rod
COUNT_WORDS = "no", "one", "two"  # negative directions of the pieces of a branch


def branches(*, length: float = 1.0, stiffness: float = 1.0, distance: float) -> Chart:
    """Holding moment over the motor's angle, of all equilibria with up to 3.5 half waves.

    Parameters
    ----------
    length, stiffness : L [m], EI [N m^2]
    distance : d, from the clamp to the pin [m]

    Returns
    -------
    Chart
        The branches of both sides, in pieces between their folds, and the two snaps.

    Examples
    --------
    >>> chart = branches(distance=0.8)
    >>> [line.label for line in chart.lines if line.stable and not line.points]
    ['stable, bent to the left', 'stable, bent to the right']
    """
    snap_rods, unit = family(length, distance), stiffness / length
    alpha, q = np.exp(snap_rods.place.T)
    moment = -unit * rods_of_chart(alpha, q).moment
    near = np.abs(snap_rods.angle) < 2.0 * snap_rods.fold
    lines = [
        line
        for side, word in ((1, "left"), (-1, "right"))
        for line in branch_pieces(snap_rods, side * snap_rods.angle, side * moment, near, word)
    ]
    after = float(-unit * rods_of_chart(*snap_rods.at(np.array([snap_rods.fold]))).moment[0])
    for side in (1, -1):
        lines.append(
            ChartLine(
                -side * np.full(2, snap_rods.fold),
                side * np.array([moment[snap_rods.folds[0]], -after]),
                "before and after a snap",
                points=True,
            )
        )
    return Chart(
        ("motor", "rad"),
        ("holding moment", "N m"),
        (Panel(tuple(lines)),),
        f"Each side's stable branch ends in a fold, at ∓{np.degrees(snap_rods.fold):.2f}°, "
        f"where the rod snaps to the other side. Beyond the fold the energy falls in one direction "
        f"from each equilibrium of the branch, and beyond the next fold in two.",
    )


def branch_pieces(
    snap_rods: SnapFamily, angle: Array, moment: Array, near: NDArray[np.bool_], word: str
) -> Iterator[ChartLine]:
    """Lines of a branch between its folds, of the shapes whose angles are `near`."""
    ends = [0, *snap_rods.folds[:2], angle.size - 1]
    for count, first, last in zip(COUNT_WORDS, ends[:-1], ends[1:], strict=True):
        part = np.arange(first, last + 1)[near[first : last + 1]]
        label = f"{count} direction{'s' * (count == 'two')} to fall in"
        yield ChartLine(
            angle[part],
            moment[part],
            f"stable, bent to the {word}" if count == "no" else label,
            stable=count == "no",
        )


def shapes(*, length: float = 1.0, distance: float) -> Chart:
    """Stable shapes up to a snap, and the shapes before and after it.

    Parameters
    ----------
    length : L [m]
    distance : d, from the clamp to the pin [m]

    Returns
    -------
    Chart
        Left panel: stable shapes as the motor turns down from 80 degrees; right panel: the shapes
        before and after the snap.
    """
    snap_rods = family(length, distance)
    a = np.radians(np.linspace(80.0, -np.degrees(snap_rods.fold), 6))
    before = drawn_points(snap_rods, a, length)
    landed = drawn_points(snap_rods, np.array([snap_rods.fold]), length)[0].conj()
    way = tuple(
        line_through(p, f"{angle:.1f}°") for p, angle in zip(before, np.degrees(a), strict=True)
    )
    snap = (
        line_through(before[-1], "before the snap", stable=False),
        line_through(landed, "after it"),
    )
    return Chart(
        ("x", "m"),
        ("y", "m"),
        (Panel(way, title="the motor turns down"), Panel(snap, title="it snaps")),
        "As the motor turns down, a dip at the clamp grows and the arch becomes shorter, until the "
        "equilibrium ends in a fold; the rod then jumps to the mirrored side.",
        equal_scales=True,
    )


def drawn_points(snap_rods: SnapFamily, angle: Array, length: float) -> Complex:
    """Points x + iy [m] of stable rods that are bent to the left, (n, points)."""
    alpha, q = snap_rods.at(angle)
    return np.asarray(
        length
        * sample_shapes(alpha, q, snap_rods.distance, np.linspace(0.0, 1.0, SHAPE_POINTS))[0].T
    )


SIDES = {"left": 1, "right": -1}


def solve(
    angle: ArrayLike,
    rate: ArrayLike = 0.0,
    acceleration: ArrayLike = 0.0,
    *,
    length: float = 1.0,
    stiffness: float = 1.0,
    distance: float,
    side: str = "left",
) -> dict[str, Array]:
    r"""Equilibrium of a buckled rod that a motor turns at its clamp, followed through its snaps.

    ::

                  .--._
               _.'     `.            EI theta' = m,   theta(0) = a,   m(L) = 0
             _/ )a       `.          (x, y)(L) = (d, 0),   d < L
            @---- d ------ o
          motor           pin        left: bent to the left of the line to the pin, as here

    Bent to the left the rod is stable for a > -a*, bent to the right for a < a*.  If the motor
    passes such a fold the rod jumps to the other side, and the difference in energy is lost.
    Between -a* and a* the side depends on the angles before: samples are taken in their order.

    Parameters
    ----------
    angle : a, of the motor from the line to the pin [rad], within +-pi, in the order of motion (n,)
    rate, acceleration : of the motor [rad/s, rad/s^2]; equilibria do not depend on them
    length, stiffness : L [m], EI [N m^2]
    distance : d, from the clamp to the pin [m], from 0.32 to 0.99 L
    side : "left" or "right", to which it is bent before the first sample

    Returns
    -------
    dict of (n,) arrays: mid_x, mid_y [m], half-way along the rod; tip_angle [rad], its tangent at
    the pin, unwrapped from a; holding_moment [N m] of the motor; force_x, force_y [N] of the pin
    on the rod; energy [J] of bending, lost [J] in all snaps so far, and work [J] that the motor has
    done since the first sample, energy + lost less what they were there; side, 1 left and -1 right.

    Raises
    ------
    ValueError
        A pin that is too near or too far, an angle beyond +-pi, angles that are not one row, an
        unknown side.

    Notes
    -----
    The error is below 1e-12 L; at a fold half of the digits are lost.  After a snap the rod comes
    to rest on the other side: no other stable equilibrium at that angle has less energy than the
    rod has at the fold (by a search at d = 0.8 L), so with damping it is the only possible one.
    The shapes are those of Pérez Gámiz 2018, eq. 33-46, on a level line of their chart
    (`proofmass.analytic.rods.rod_snap`); the single rod of the source (annex II lines 1616-1957) is
    not moved.

    Examples
    --------
    The motor turns to -80 degrees and back; the rod is then on the other side:

    >>> swing = solve(np.radians([80.0, 0.0, -80.0, 0.0]), distance=0.8)
    >>> swing["mid_y"].round(6).tolist()
    [0.249259, 0.240182, -0.249259, -0.240182]
    """
    check_positive(length=length, distance=distance)
    snap_rods, a = family(length, distance), np.atleast_1d(np.asarray(angle, float))
    check_stiffness(stiffness)
    if a.ndim != 1 or not a.size:
        raise ValueError(f"angle must be one row of angles (n,), got an array {np.shape(angle)}")
    if side not in tuple(SIDES):
        raise ValueError(f"side must be one of {', '.join(SIDES)}, got {side!r}")
    if not np.all(np.abs(a) <= np.pi):
        raise ValueError(f"angle must be within +-pi [rad], got {a[~(np.abs(a) <= np.pi)][0]}")
    now = follow_sides(a, snap_rods.fold, SIDES[side])
    alpha, q = snap_rods.at(now * a)
    rod, unit = rods_of_chart(alpha, q), stiffness / length
    place, turn, load = sample_shapes(alpha, q, snap_rods.distance, np.array([0.0, 0.5, 1.0]))
    push = unit / length * alpha**2 * load
    snaps = np.cumsum(now != np.append(SIDES[side], now[:-1]))
    energy, lost = unit * rod.energy, unit * energy_drop(snap_rods) * snaps
    return {
        "mid_x": length * place[1].real,
        "mid_y": now * length * place[1].imag,
        "tip_angle": a + now * (turn[2] - turn[0]),
        "holding_moment": -now * unit * rod.moment,
        "force_x": push.real,
        "force_y": now * push.imag,
        "energy": energy,
        "lost": lost,
        "work": energy + lost - energy[0] - lost[0],
        "side": now,
    }


def follow_sides(angle: Array, fold: float, side: int) -> Array:
    """Sides of the rod, 1 (left) or -1 (right), at angles in the order of motion."""
    sides = np.empty(angle.size)
    for i, a in enumerate(angle):
        side = -side if side * a < -fold else side
        sides[i] = side
    return sides


def energy_drop(snap_rods: SnapFamily) -> float:
    """Energy that a rod of unit length and stiffness loses in a snap [EI/L]."""
    before, after = rods_of_chart(*snap_rods.at(snap_rods.fold * np.array([-1.0, 1.0]))).energy
    return float(before - after)


def events(*, length: float = 1.0, distance: float, **_: object) -> dict[str, float]:
    """Angles of the motor [rad] at which the rod snaps.

    >>> {name: round(float(np.degrees(a)), 3) for name, a in events(distance=0.8).items()}
    {'snaps to the right': -54.337, 'snaps to the left': 54.337}
    """
    fold = family(length, distance).fold
    return {"snaps to the right": -fold, "snaps to the left": fold}


def properties(
    *, length: float = 1.0, stiffness: float = 1.0, distance: float, **_: object
) -> dict[str, str]:
    """Angle, holding moment and energy of a snap as texts, for the report's page.

    >>> properties(distance=0.8)["lost in a snap"]
    '6.257 J of 8.341 J'
    """
    check_stiffness(stiffness)
    snap_rods, unit = family(length, distance), stiffness / length
    ends = rods_of_chart(*snap_rods.at(snap_rods.fold * np.array([-1.0, 1.0])))
    before, after = unit * np.abs(ends.moment)
    return {
        "snaps at": f"±{np.degrees(snap_rods.fold):.3f}°",
        "holding moment": f"{before:.4g} N m before a snap, {after:.4g} N m after it",
        "lost in a snap": f"{unit * energy_drop(snap_rods):.4g} J of {unit * ends.energy[0]:.4g} J",
    }


class SnappingRod(ClosedForm, function=solve, properties=properties):
    """Rod between a motor and a pin that is nearer than its length: it snaps from side to side."""

    method = "solver of the elastica between a motor and a pin"
    charts = (
        branches,
        shapes,
    )
    marks = (events,)

    length: Length
    stiffness: BendingStiffness
    distance: Length
    side: Annotated[str, OneOf(("left", "right"))]
