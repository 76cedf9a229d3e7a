"""Simple pendulum with any amplitude below half a turn, by Jacobi elliptic functions."""

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ellipkm1

from proofmass.analytic.numerics import check_finite, check_number, check_positive
from proofmass.analytic.protocol import Angle, ClosedForm, Domain, Length, Quantity
from proofmass.base.arrays import Array


def solve(
    time: ArrayLike, *, length: float, mass: float, gravity: float, amplitude: float
) -> dict[str, Array]:
    r"""Motion of a point mass on a massless rod, released at rest.

    ::

        O fixed        x = length sin(angle), y = -length cos(angle)
        |\
        | \  length    released at rest from angle = amplitude at time 0
        |  \
        |   o mass
        angle, counter-clockwise from straight down

    With w = sqrt(gravity/length), k = sin(amplitude/2), k' = cos(amplitude/2) and the Jacobi
    functions sn, cn, dn of u = w time and modulus k::

        tan(angle/2) = (k/k') cn           rate = -2 w k k' sn/dn
        sin(angle/2) = k cn/dn             acceleration = -w^2 sin(angle) = -2 w^2 k k' cn/dn^2

    Parameters
    ----------
    time : [s], (...), of either sign
    length, mass, gravity : [m], [kg], [m/s^2]
    amplitude : angle at release [rad], |amplitude| < pi

    Returns
    -------
    dict of (...) arrays: angle [rad], rate [rad/s], acceleration [rad/s^2]; kinetic, potential
    (zero at the bottom) and energy, their sum [J]; tension of the rod [N], negative in compression.

    Raises
    ------
    ValueError
        A length, mass or gravity not positive, a time not finite, or an amplitude of half a turn or
        more.

    Notes
    -----
    The only error that grows with time is the rounding of w time: angle errors are about
    1e-16 |rate time|. The functions are computed here from k' because scipy.special.ellipj takes
    1 - k'^2, which near half a turn no longer has the digits of k' that determine the period.
    Source: textbook solution, DLMF 22.19(i); IFToMM benchmark A01 is the case amplitude = -pi/2.

    Examples
    --------
    >>> at = solve(0.5, length=1.0, mass=1.0, gravity=9.81, amplitude=-np.pi / 2)
    >>> round(float(np.sin(at["angle"])), 12), round(float(-np.cos(at["angle"])), 12)
    (-0.391048791551, -0.920369948785)
    """
    w = _frequency(length, gravity, amplitude)
    check_positive("kg", mass=mass)
    check_finite(time=time)
    k, k_prime = np.sin(0.5 * amplitude), np.cos(0.5 * amplitude)
    sn, cn, dn = jacobi_functions(w * np.asarray(time, float), k, k_prime)
    half_sine = k * cn / dn
    rate = -2.0 * w * k * k_prime * sn / dn
    kinetic = 0.5 * mass * (length * rate) ** 2
    potential = 2.0 * mass * gravity * length * half_sine**2
    return {
        "angle": 2.0 * np.arctan2(k * cn, k_prime),
        "rate": rate,
        "acceleration": -2.0 * w**2 * k_prime * half_sine / dn,
        "energy": kinetic + potential,
        "kinetic": kinetic,
        "potential": potential,
        "tension": mass * gravity * (1.0 - 2.0 * half_sine**2) + mass * length * rate**2,
    }


def period(*, length: float, gravity: float, amplitude: float) -> float:
    """Duration of one full swing [s], 4 K(k) sqrt(length/gravity), for the inputs of `solve`.

    >>> round(period(length=0.5, gravity=9.81, amplitude=np.pi / 2), 9)
    1.674317098
    """
    w = _frequency(length, gravity, amplitude)
    return float(4.0 * ellipkm1(np.cos(0.5 * amplitude) ** 2) / w)


def _frequency(length: float, gravity: float, amplitude: float) -> float:
    """Angular frequency of small swings [rad/s], after a check of the inputs."""
    check_positive(length=length)
    check_positive("m/s^2", gravity=gravity)
    check_number(amplitude=amplitude)
    if not abs(amplitude) < np.pi:
        raise ValueError(f"amplitude must lie within half a turn [rad], got {amplitude}")
    return float(np.sqrt(gravity / length))


def jacobi_functions(u: Array, k: float, k_prime: float) -> tuple[Array, Array, Array]:
    """Jacobi sn, cn, dn [1] of u (...) and modulus k, with `k_prime` sqrt(1 - k^2), by the AGM.

    >>> sn, cn, dn = jacobi_functions(np.array(0.5), 0.6, 0.8)
    >>> round(float(sn**2 + cn**2), 12), round(float(dn**2 + 0.36 * sn**2), 12)
    (1.0, 1.0)

    Gauss's transformation (DLMF 22.7(i)) leads from a modulus to a smaller one. 1 - k1 sn^2 is
    computed as (1 - k1) + k1 cn^2, without a difference of nearly equal numbers for k1 near 1.
    """
    a, b, c = 1.0, k_prime, k
    moduli = []  # smaller ones, k1 and 1 - k1
    while abs(c) > np.finfo(float).eps * a:
        mean = 0.5 * (a + b)
        a, b, c, rest = mean, np.sqrt(a * b), 0.25 * c * c / mean, b / mean
        moduli.append((c / a, rest))
    quarter = 0.5 * np.pi / a
    count = np.rint(u / quarter)
    phase = a * (u - count * quarter)
    sn, cn, dn = np.sin(phase), np.cos(phase), np.ones_like(phase)
    for k1, rest in reversed(moduli):
        whole = 1.0 + k1 * sn * sn
        sn, cn, dn = (1.0 + k1) * sn / whole, cn * dn / whole, (rest + k1 * cn * cn) / whole
    size = np.hypot(sn, cn)
    sn, cn = sn / size, cn / size  # 1 but for rounding, which the energy would show
    dn = np.hypot(k_prime, k * cn)
    odd, sign = count % 2 == 1, 1.0 - 2.0 * (count // 2 % 2)
    # Shift by quarter periods (DLMF 22.4(iii)): cn and dn near their zero keep their digits.
    shifted = np.where(odd, cn / dn, sn), np.where(odd, -k_prime * sn / dn, cn)
    return sign * shifted[0], sign * shifted[1], np.where(odd, k_prime / dn, dn)


class Pendulum(ClosedForm, function=solve):
    """Simple pendulum with any amplitude below half a turn, by Jacobi elliptic functions."""

    length: Length
    mass: Annotated[float, Quantity("kg", Domain.POSITIVE)]
    gravity: Annotated[float, Quantity("m/s^2", Domain.POSITIVE)]
    amplitude: Angle
