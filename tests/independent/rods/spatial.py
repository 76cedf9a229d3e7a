"""A rod in space, formulated by strains: moments follow from the loads beyond, not by integration.

The unknowns u are the twist and the two curvatures at Gauss points of the rod's centre line, which
is r(t) without load.  They determine the rotations R and the positions p of the sections, and must
be equal to those that the loads beyond each section cause::

    R' = J R u^,   p' = J R v,   J = |r'(t)|,   v = e1 + S R^T F
    u(t) = u0(t) + B R^T (M + (p(1) - p(t)) x F)        at each Gauss point

The curvature of the line may vary, unlike in `proofmass.analytic.rods.spatial_rod`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.interpolate import BarycentricInterpolator

Line = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
STEPS = 200  # steps of RK4, with an error of (1 rad / 200)^4 / 120 = 5e-12 of the length


@dataclass(frozen=True)
class Sections:
    """GJ, EI_y, EI_z [N m^2]; EA, GA, GA [N]."""

    bending: tuple[float, float, float]
    strains: tuple[float, float, float] = (np.inf, np.inf, np.inf)


def arc(length: float, natural: tuple[float, float, float]) -> Line:
    """A line of constant twist and curvatures: a function that returns |r'(t)| and u0 (3, n)."""
    return lambda t: (np.full_like(t, length), np.outer(natural, np.ones_like(t)))


def quadratic(points: np.ndarray, at: np.ndarray) -> Line:
    """The plane curve through three points (3, 2), quadratic in a parameter with the values `at`.

    Its twist is zero.
    """
    curve = np.polynomial.Polynomial.fit
    x, y = (curve(at, points[:, k], 2, domain=[0, 1], window=[0, 1]) for k in range(2))

    def of(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        dx, dy, ddx, ddy = x.deriv()(t), y.deriv()(t), x.deriv(2)(t), y.deriv(2)(t)
        size = np.hypot(dx, dy)
        bend = (dx * ddy - dy * ddx) / size**3
        return size, np.stack([0 * t, 0 * t, bend])

    return of


def integrate_sections(
    line: Line,
    sections: Sections,
    strain: np.ndarray,
    gauss: np.ndarray,
    force: np.ndarray,
    begin: np.ndarray,
    steps: int = STEPS,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and rotations (steps + 1, columns, ...) from strains (columns, points, 3)."""
    h = 1.0 / steps
    t = np.linspace(0.0, 1.0, 2 * steps + 1)
    size, _ = line(t)
    u = BarycentricInterpolator(gauss, np.moveaxis(strain, 1, 0))(t)  # (2 steps + 1, columns, 3)
    soft = 1.0 / np.array(sections.strains)
    columns = strain.shape[0]
    turn, place = np.tile(begin, (columns, 1, 1)), np.zeros((columns, 3))
    turns, places = [turn], [place]

    def rates(turn: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        a, b, c = u[k].T
        zero = np.zeros_like(a)
        hat = np.array([[zero, -c, b], [c, zero, -a], [-b, a, zero]]).transpose(2, 0, 1)
        ahead = soft * (force @ turn) + np.array([1.0, 0.0, 0.0])
        return size[k] * turn @ hat, size[k] * np.einsum("cij,cj->ci", turn, ahead)

    for k in range(0, 2 * steps, 2):
        a, pa = rates(turn, k)
        b, pb = rates(turn + h / 2 * a, k + 1)
        c, pc = rates(turn + h / 2 * b, k + 1)
        d, pd = rates(turn + h * c, k + 2)
        turn = turn + h / 6 * (a + 2 * b + 2 * c + d)
        place = place + h / 6 * (pa + 2 * pb + 2 * pc + pd)
        turns.append(turn)
        places.append(place)
    return np.array(places), np.array(turns)


def tip(
    line: Line,
    sections: Sections,
    force: tuple[float, float, float],
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0),
    begin: np.ndarray | None = None,
    points: int = 12,
    parts: int = 1,
    steps: int = STEPS,
) -> np.ndarray:
    """Position of the tip (3,); the loads grow in `parts` equal steps."""
    begin = np.eye(3) if begin is None else begin
    gauss = (leggauss(points)[0] + 1) / 2
    natural = line(gauss)[1].T
    soft = 1.0 / np.array(sections.bending)

    def gaps(unknown: np.ndarray, share: float) -> np.ndarray:
        strain = unknown.reshape(-1, points, 3)
        pull = share * np.array(force)
        places, turns = integrate_sections(line, sections, strain, gauss, pull, begin, steps)
        t = np.linspace(0.0, 1.0, steps + 1)
        near = np.clip(np.searchsorted(t, gauss) - 4, 0, steps - 7)
        found = np.empty_like(strain)
        for g, first in enumerate(near):  # interpolation of degree 7 between steps
            some = slice(first, first + 8)
            place = BarycentricInterpolator(t[some], places[some])(gauss[g])
            turn = BarycentricInterpolator(t[some], turns[some])(gauss[g])
            beyond = share * np.array(moment) + np.cross(places[-1] - place, pull)
            found[:, g] = natural[g] + soft * np.einsum("cij,ci->cj", turn, beyond)
        return (strain - found).reshape(unknown.shape)

    strain = natural.ravel()
    for part in range(1, parts + 1):
        share = part / parts
        width = 1e-6 * (np.abs(strain).max() + 1.0 / float(line(gauss)[0].max()))
        for _ in range(20):
            stack = np.vstack([strain, strain + width * np.eye(strain.size)])
            ends = gaps(stack, share)
            move = np.linalg.solve((ends[1:] - ends[0]).T / width, -ends[0])
            strain = strain + move
            if np.abs(move).max() < 1e-12 * np.abs(strain).max():
                break
    last = strain.reshape(1, points, 3)
    return integrate_sections(line, sections, last, gauss, np.array(force), begin, steps)[0][-1, 0]


def extrapolated_tip(*args, **named) -> np.ndarray:
    """Position of the tip from 100 and 200 steps, extrapolated to remove the error of order 4."""
    one, two = (tip(*args, **named, steps=steps) for steps in (STEPS // 2, STEPS))
    return two + (two - one) / 15.0
