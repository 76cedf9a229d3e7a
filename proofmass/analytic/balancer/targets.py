"""Target moment-angle characteristics of a balancer and the energies that they balance."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from proofmass.analytic.numerics import Array

Curve = Callable[[Array], Array]
LAEVO = (-0.2511, 1.343, -2.91, 2.824, -0.006501)  # of the program, line 4067; eq. 28 is rounded
STEEP = np.tan(3.0 * np.pi / 8.0)  # 1 + sqrt(2)


@dataclass(frozen=True)
class Target:
    """A wanted balancing moment M(angle) and the height energy V(angle), dV/dangle = -M.

    A balancer that meets it keeps its spring energy plus V constant. Call it for M. Both are for
    m g r = 1 N m; V is up to a constant.
    """

    name: str
    moment: Curve
    height_energy: Curve

    def __call__(self, angle: ArrayLike) -> Array:
        return self.moment(np.asarray(angle, float))


def target(name: str, angle: ArrayLike) -> Array:
    r"""Moment [N m] of a named target at a pendulum angle [rad] (...), for m g r = 1 N m.

    ::

        sine                    sin a                                        eq. 24
        progressive             1 - cos a                                        25
        progressive-degressive  1/2 + 4/(3 pi) atan(tan(3 pi/8) (4 a/pi - 1))    26
        degressive-progressive  1/2 + 1/2 tan(3/2 (a - pi/4))/tan(3 pi/8)        27
        laevo                   -0.2511 a^4 + 1.343 a^3 - 2.91 a^2 + 2.824 a - 0.006501    28
        sine180                 sin 2a, 180 degrees of a sine in 90 of the pendulum        29

    All are meant for 0 to pi/2, where they lie within [-0.0065, 1]; the fourth has poles at -pi/12
    and 7 pi/12, and laevo, a fit to an exoskeleton's spring, is not zero at zero.

    ValueError for a name that is not in `TARGETS`. Accuracy: rounding. Source: van Nes 2022 (S. van
    Nes, The use of a rigid linkage balancer with torsion springs to realize nonlinear moment-angle
    characteristics, MSc thesis TU Delft 2022.074), eqs 24-29, lines 794-806. Eq. 28 prints two
    decimals; its tables were made with the coefficients of the program, line 4067, used here.

    >>> [round(float(target(name, np.pi / 4)), 4) for name in TARGETS]
    [0.7071, 0.2929, 0.5, 0.5, 0.9715, 1.0]
    """
    if name not in TARGETS:
        raise ValueError(f"target must be one of {', '.join(TARGETS)}, got {name!r}")
    return TARGETS[name](angle)


def tabulated(angles: ArrayLike, moments: ArrayLike, name: str = "table") -> Target:
    """Target through a table, by a cubic that keeps its shape: monotone wherever the table is.

    Parameters
    ----------
    angles : pendulum angles [rad] (n,), rising strictly, n >= 2
    moments : wanted moments over m g r at them (n,)
    name : what messages call it

    Returns
    -------
    Target : continuous in its slope; its energy is zero at the first angle

    Raises
    ------
    ValueError
        Columns of different or too small size, a value not finite, an angle that does not rise;
        on a call outside the table.

    Notes
    -----
    Piecewise cubic Hermite interpolation (Fritsch and Carlson, SIAM J. Numer. Anal. 17, 1980).
    Error O(h^3) in the distance of the samples, O(h^2) next to an extreme.

    Examples
    --------
    >>> wanted = tabulated([0.0, 0.5, 1.5], [0.0, 1.0, 1.0])
    >>> float(wanted(1.2))
    1.0
    """
    x, y = (np.asarray(column, float) for column in (angles, moments))
    _check_table(name, x, y)
    cubic = PchipInterpolator(x, y, extrapolate=False)
    integral = cubic.antiderivative()

    def inside(curve: Curve) -> Curve:
        def within(angle: Array) -> Array:
            bad = ~((angle >= x[0]) & (angle <= x[-1]))
            if bad.any():
                raise ValueError(f"{name}: angle {angle[bad].flat[0]:.6g} rad is outside its range "
                                 f"{x[0]:.6g} to {x[-1]:.6g} rad")
            return curve(angle)

        return within

    return Target(name, inside(cubic), inside(lambda angle: -integral(angle)))


def _check_table(name: str, x: Array, y: Array) -> None:
    if x.ndim != 1 or x.shape != y.shape or x.size < 2:
        raise ValueError(f"{name}: angles and moments must be two columns of one size, at least 2, "
                         f"got {x.shape} and {y.shape}")
    for column, values in (("angles", x), ("moments", y)):
        for row in np.flatnonzero(~np.isfinite(values)):
            raise ValueError(f"{name}: {column} must be finite, row {row} is {values[row]}")
    for row in np.flatnonzero(np.diff(x) <= 0.0):
        raise ValueError(f"{name}: angles must rise strictly, row {row + 1} is {x[row + 1]:.6g} rad"
                         f" after {x[row]:.6g} rad")


def _progressive_degressive(angle: Array) -> Array:
    return 0.5 + 4.0 / (3.0 * np.pi) * np.arctan(STEEP * (4.0 * angle / np.pi - 1.0))


def _progressive_degressive_energy(angle: Array) -> Array:
    u = STEEP * (4.0 * angle / np.pi - 1.0)
    return -0.5 * angle - (u * np.arctan(u) - 0.5 * np.log1p(u * u)) / (3.0 * STEEP)


def _degressive_progressive(angle: Array) -> Array:
    return 0.5 + 0.5 * np.tan(1.5 * (angle - np.pi / 4.0)) / STEEP


def _degressive_progressive_energy(angle: Array) -> Array:
    return -0.5 * angle + np.log(np.cos(1.5 * (angle - np.pi / 4.0))) / (3.0 * STEEP)


TARGETS = {each.name: each for each in (
    Target("sine", np.sin, np.cos),
    Target("progressive", lambda a: 1.0 - np.cos(a), lambda a: np.sin(a) - a),
    Target("progressive-degressive", _progressive_degressive, _progressive_degressive_energy),
    Target("degressive-progressive", _degressive_progressive, _degressive_progressive_energy),
    Target("laevo", np.poly1d(LAEVO), lambda a: 1.0 - np.polyint(np.poly1d(LAEVO))(a)),
    Target("sine180", lambda a: np.sin(2.0 * a), lambda a: 0.5 * np.cos(2.0 * a)),
)}
