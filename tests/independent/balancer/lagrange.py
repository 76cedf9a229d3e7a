"""Energy of a pendulum with a three-segment balancer, and its two partial derivatives."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.numerics import check_finite, check_one_of, check_positive

Array = NDArray[np.float64]


class Potential(NamedTuple):
    """Potential energy and its slopes; each (...)."""

    energy: Array  # V [J]
    by_angle: Array  # dV/dalpha [N m]: the moment that holds the pendulum
    by_winding1: Array  # dV/dalpha_1 [N m]: zero at equilibrium


def potential(
    angle: ArrayLike,
    deflection1: ArrayLike,
    *,
    pendulum: float,
    length1: float,
    length2: float,
    length3: float,
    stiffness1: float,
    stiffness2: float,
    stiffness3: float,
    rest_angle: float = 0.0,
    weight: float = 0.0,
    mode: int = 1,
) -> Potential:
    r"""Energy as a function of the pendulum angle alpha and the deflection alpha_1 of spring 1.

    ::

            P_2                   delta = alpha - theta_1, theta_1 = alpha_1 + theta_10
           /   \ l_3              q^2 = r^2 + l_1^2 - 2 r l_1 cos delta               (E.8)
      l_2 /phi_3\                 psi = atan2(r sin delta, r cos delta - l_1)
         /phi_2  \                cos phi_2 = (q^2 + l_2^2 - l_3^2)/(2 q l_2)         (E.10)
       P_1 - - - - T              cos phi_3 = (l_2^2 + l_3^2 - q^2)/(2 l_2 l_3)       (E.11)
          \    q  /
        l_1 \    / r              theta_2 - theta_1 = psi - mode phi_2                (E.6)
             \  /                 theta_3 - theta_2 = mode (pi - phi_3)               (E.7)
              O

        V = m g r cos alpha + (k_1 alpha_1^2 + k_2 alpha_2^2 + k_3 alpha_3^2)/2       (E.4)

    alpha_2 and alpha_3 are those differences less their values at rest, alpha = alpha_1 = 0. They
    depend on delta alone: spring 1 is in series with one nonlinear spring. With ' = d/ddelta::

        dV/dalpha   = M_2 alpha_2' + M_3 alpha_3' - m g r sin alpha                   (E.2)
        dV/dalpha_1 = M_1 - M_2 alpha_2' - M_3 alpha_3'                               (E.3)

    Parameters
    ----------
    angle, deflection1 : alpha and alpha_1 [rad], (...) broadcast
    pendulum, length1, length2, length3 : r and l_i [m]
    stiffness1, stiffness2, stiffness3 : k_i [N m/rad], zero or positive
    rest_angle : theta_10 [rad]
    weight : m g at the tip [N]
    mode : +1 elbow up (theta_3 > theta_2), -1 elbow down

    Returns
    -------
    Potential; NaN where the outer segments do not reach the tip

    Raises
    ------
    ValueError
        A length is not positive, length1 is not below the pendulum's, a stiffness is negative, an
        angle or weight is not finite, or the mode is unknown.

    Notes
    -----
    The slopes lose digits like 1/sin(phi_3) near poses with segments 2 and 3 in line.

    Source: van Nes 2022, appendix E, lines 1318-1365, with two corrections. E.8 prints
    cos(alpha - alpha_1 + theta_10), right only for theta_10 = 0. E.6 prints pi - gamma_2 for psi,
    with gamma_2 the angle at P_1 between segment 1 and q: right only while theta_1 <= alpha,
    otherwise psi = gamma_2 - pi; the arc tangent of two arguments covers both.

    Examples
    --------
    >>> sides = dict(pendulum=1.0, length1=0.5, length2=0.5, length3=0.5)
    >>> springs = dict(stiffness1=3.0, stiffness2=0.25, stiffness3=7.0)
    >>> [float(value) for value in potential(1.0, 1.0, **sides, **springs)]  # like one body
    [1.5, 0.0, 3.0]
    """
    lengths = {"pendulum": pendulum, "length1": length1, "length2": length2, "length3": length3}
    _check(lengths, (stiffness1, stiffness2, stiffness3), rest_angle, weight, mode)
    alpha, alpha1 = np.asarray(angle, float), np.asarray(deflection1, float)
    at_rest = _bends(np.asarray(-rest_angle), **lengths, mode=mode)
    bends = _bends(alpha - alpha1 - rest_angle, **lengths, mode=mode)
    moment1, energy = stiffness1 * alpha1, 0.5 * stiffness1 * alpha1**2
    inner = np.zeros_like(energy)
    for k, (bend, slope), (start, _) in zip((stiffness2, stiffness3), bends, at_rest, strict=True):
        energy = energy + 0.5 * k * (bend - start) ** 2
        inner = inner + k * (bend - start) * slope
    mgr = weight * pendulum
    return Potential(energy + mgr * np.cos(alpha), inner - mgr * np.sin(alpha), moment1 - inner)


def _check(
    lengths: dict[str, float],
    stiffness: tuple[float, ...],
    rest_angle: float,
    weight: float,
    mode: int,
) -> None:
    check_positive(**lengths)
    if not lengths["length1"] < lengths["pendulum"]:
        raise ValueError(
            f"length1 must be below pendulum = {lengths['pendulum']} m for angles "
            f"without jumps, got {lengths['length1']}"
        )
    for i, k in enumerate(stiffness, start=1):
        if not 0.0 <= k < np.inf:
            raise ValueError(f"stiffness{i} must be zero or positive [N m/rad], got {k}")
    check_finite(rest_angle=rest_angle, weight=weight)
    check_one_of((1, -1), mode=mode)


def _bends(
    delta: Array, *, pendulum: float, length1: float, length2: float, length3: float, mode: int
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Bends theta_2 - theta_1 and theta_3 - theta_2, each with its slope by delta."""
    r, a, b, c = pendulum, length1, length2, length3
    along, across = r * np.cos(delta) - a, r * np.sin(delta)
    q = np.hypot(along, across)
    with np.errstate(divide="ignore", invalid="ignore"):  # out of reach: nan, as documented
        phi2 = np.arccos((q * q + b * b - c * c) / (2.0 * q * b))
        phi3 = np.arccos((b * b + c * c - q * q) / (2.0 * b * c))
        slope3 = r * a * np.sin(delta) / (b * c * np.sin(phi3))  # q q' over b c sin(phi_3)
        slope2 = -(q * q + c * c - b * b) / (2.0 * q * q) * slope3
        turn = r * (r - a * np.cos(delta)) / (q * q)
    return (
        (np.arctan2(across, along) - mode * phi2, turn - mode * slope2),
        (mode * (np.pi - phi3), -mode * slope3),
    )
