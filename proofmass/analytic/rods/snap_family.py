r"""All shapes of a rod between a clamp that turns and a pin at a distance, as one curve.

A rod with a pinned tip is a place (alpha, q) of the sheet of
`proofmass.analytic.rods.search_sheet`, its tip at z(alpha, q) in the clamp's frame.  With the clamp
turned by a from the line to the pin, d away::

    log z = log(d) - i a                        two equations for alpha and q at a given a

The real part alone is a level line of the sheet.  On q > 0 the rod is bent to the left of the line
to the pin; q < 0 is the mirror image.  The line passes the arch between two pins, where alpha = 2 K
and 2 E/K - 1 = d.  From there a falls to the first fold, -a*, where the rod snaps, and the line
goes on through all higher modes, with one negative direction more beyond each fold.  The other way
a grows, and the rod is wound.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from proofmass.analytic.numerics import TURN, Array, Complex, positive
from proofmass.analytic.rods.column import whole
from proofmass.analytic.rods.elliptic import from_inflection
from proofmass.analytic.rods.search_sheet import rods

NEAREST, FURTHEST = 0.32, 0.99  # of the length: distances that have been tried
STRIDE = 0.01  # of (log alpha, log q)
WAVES = 3.5  # half waves, beyond the second fold
STEPS = 4  # of Newton's method, from a guess within STRIDE^2


@dataclass(frozen=True)
class Family:
    """Shapes of rods of unit length, bent to the left, from the most wound one on.

    Attributes
    ----------
    distance : float
        d, from the clamp to the pin.
    place : ndarray (n, 2)
        log(alpha), log(q).
    angle : ndarray (n,)
        a, of the clamp's tangent from the line to the pin [rad].
    folds : ndarray of int (2,)
        Which of them are folds; those before the first one are stable.
    """

    distance: float
    place: Array
    angle: Array
    folds: NDArray[np.intp]

    @property
    def fold(self) -> float:
        """a* [rad]: bent to the left the rod stands above -a*, bent to the right below a*."""
        return -float(self.angle[self.folds[0]])

    def at(self, angle: Array) -> tuple[Array, Array]:
        """alpha and q (n,) of the stable shapes at angles (n,) of the clamp, not below -a*."""
        table = slice(self.folds[0], None, -1)
        above = np.sqrt(self.angle[table] + self.fold)  # the line is smooth in it, up to the fold
        u = np.stack([np.interp(np.sqrt(angle + self.fold), above, column[table])
                      for column in self.place.T])
        for _ in range(STEPS):
            value, slope = log_tip(u)
            step = _solved(slope, np.log(self.distance * np.exp(-1j * angle - value)))
            u += np.where(np.abs(step).max(axis=0) < STRIDE, step, 0.0)  # else on the fold itself
        return np.exp(u[0]), np.exp(u[1])


@lru_cache(maxsize=32)
def family(length: float, distance: float) -> Family:
    """The shapes, from half a turn of the clamp to beyond the second fold.

    ValueError for a length that is not positive, or a distance that is not 0.32 to 0.99 of it.

    >>> round(float(np.degrees(family(1.0, 0.8).fold)), 6)
    54.337195
    """
    positive(length=length, distance=distance)
    if not NEAREST * length <= distance <= FURTHEST * length:
        raise ValueError(f"distance must be from {NEAREST:g} to {FURTHEST:g} of the length, "
                         f"{length:g} m, got {distance:g}")
    start = arch(distance / length)
    sense = float(np.sign(turning(start)))
    wound = walk(start, -sense, lambda u: float(-log_tip(u)[0].imag) % TURN > np.pi)
    onward = walk(start, sense, lambda u: float(rods(*np.exp(u)).waves) > WAVES)
    place = np.array(wound[:0:-1] + onward)
    turns = np.array([turning(u) for u in place])
    before = np.flatnonzero(turns[1:] * turns[:-1] < 0.0)
    for i in before[::-1]:
        place = np.insert(place, i + 1, fold(place[i], sense), axis=0)
    angle = np.unwrap(-log_tip(place[::-1].T)[0].imag)[::-1]  # the last ones are not wound
    return Family(distance / length, place, angle, before + 1 + np.arange(before.size))


def shape(alpha: Array, q: Array, distance: Array | float, fraction: Array
          ) -> tuple[Complex, Array, Complex]:
    """Shapes of unit rods (n,) with the clamp at 0 and the pin at `distance`, on the x axis.

    Returns places x + iy at fractions (m,) of the length from the clamp and tangents [rad] from the
    load's direction, (m, n), and that direction e^(i psi), (n,).
    """
    def seen(arc: Array) -> tuple[Complex, Array]:
        x, y, turn, _ = from_inflection(np.zeros(()), -np.tanh(q), 1.0 / np.cosh(q), arc)
        return np.asarray((x + 1j * y) / alpha), turn

    place, turn = seen(alpha * (1.0 - fraction[:, None]))
    load = distance / seen(alpha)[0]
    return distance - load * place, turn, load


def arch(distance: float) -> Array:
    """log(alpha), log(q) of the rod between two pins, 2 E/K - 1 = d."""
    def integrals(log_q: float) -> tuple[Array, Array]:
        return whole(1.0 / np.cosh(np.exp(np.array(log_q))))

    def gap(log_q: float) -> float:
        quarter, second = integrals(log_q)
        return float(2.0 * second / quarter - 1.0 - distance)

    log_q = brentq(gap, -15.0, 2.0, xtol=1e-15)
    return np.array([np.log(2.0 * integrals(log_q)[0]), log_q])


def log_tip(u: Array) -> tuple[Complex, Complex]:
    """log(z) (...) at log(alpha), log(q), (2, ...), and its derivatives by them (2, ...)."""
    alpha, q = np.exp(u)
    rod = rods(alpha, q)
    return np.log(rod.tip), rod.tip_slope / rod.tip * np.stack([alpha, q])


def turning(u: Array) -> float:
    """Fall of the angle along the level line, in the direction of `ahead`; zero in a fold."""
    slope = log_tip(u)[1]
    return float((slope[0].conj() * slope[1]).imag / np.hypot(*slope.real))


def ahead(u: Array, stride: float) -> Array:
    """The level line's point at a stride along its tangent from another one of it."""
    value, slope = log_tip(u)
    level, (x, y) = value.real, slope.real
    v = u + stride * np.array([-y, x]) / np.hypot(x, y)
    for _ in range(STEPS):
        value, slope = log_tip(v)
        v = v - slope.real * (value.real - level) / (slope.real @ slope.real)
    return np.asarray(v)


def walk(u: Array, sense: float, ends: Callable[[Array], bool]) -> list[Array]:
    """Points of the level line from `u` on, to the first one that ends it."""
    points = [u]
    while not ends(points[-1]):
        points.append(ahead(points[-1], sense * STRIDE))
    return points


def fold(u: Array, sense: float) -> Array:
    """The fold within a stride, to rounding."""
    share = brentq(lambda part: turning(ahead(u, sense * part)), 0.0, STRIDE, xtol=1e-15)
    return ahead(u, sense * share)


def _solved(slope: Complex, gap: Complex) -> Array:
    """Real x, y (2, n) with slope[0] x + slope[1] y = gap, complex."""
    cross = (slope[0].conj() * slope[1]).imag
    x, y = (gap.conj() * slope[1]).imag, (slope[0].conj() * gap).imag
    with np.errstate(divide="ignore", invalid="ignore"):  # on a fold
        return np.asarray(np.stack([x, y]) / cross)
