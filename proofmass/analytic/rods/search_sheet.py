r"""All rods with a clamp and a pinned tip: one smooth sheet, without cracks between the modes.

Seen from its tip, where it has no curvature, the rod is a pendulum let go at rest.  With
delta the angle of the tangent over the load, gamma its value at the tip, u = alpha (1 - s/L)::

            clamp      u = alpha         delta'' = sin(delta),  delta(0) = gamma, delta'(0) = 0
              \                          alpha = L sqrt(R/EI)
               `--._                     cos(delta/2) = k cd(u),  sin(delta/2) = k' nd(u)
                    `---o--> R           k = cos(gamma/2) = tanh(q),  k' = sech(q)
                  tip, u = 0
                    Z = int_0^alpha e^(i delta) du = alpha - 2 E(alpha) + 2 k^2 sn cd + 2i k k' sd

alpha > 0 and q in R, the chart, say everything: load and tip in the clamp's frame are

    n = EI/L^2 alpha^2 e^(-i delta(alpha)),    tip = L/alpha e^(-i delta(alpha)) Z

and the mode is the whole part of alpha/(2 K) plus 1: nothing happens where it changes.  The Jacobi
field of the pendulum, y = d delta/d gamma = cn + sd (E(u) - k'^2 u), gives all derivatives.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ellipkm1

from proofmass.analytic.numerics import Array, Complex
from proofmass.analytic.rods.integrals import jacobi


@dataclass(frozen=True)
class Rods:
    """Rods of unit length and stiffness in the frame of their clamps, arrays of one shape.

    Attributes
    ----------
    tip, force : ndarray of complex
        x + iy of the tip [L], of the load on it [EI/L^2].
    tip_slope, force_slope : ndarray of complex (2, ...)
        Their derivatives with alpha and with q.
    moment, energy : ndarray
        At the clamp [EI/L]; of bending [EI/L].
    delta : ndarray of complex
        e^(i delta) of the tangent at the clamp over the load.
    waves : ndarray
        alpha/(2 K): half waves between the clamp and the tip.
    field : ndarray
        y at the clamp.
    """

    tip: Complex
    force: Complex
    tip_slope: Complex
    force_slope: Complex
    moment: Array
    energy: Array
    delta: Complex
    waves: Array
    field: Array


def rods(alpha: Array, q: Array) -> Rods:
    """Rods of unit length and stiffness at places of the chart, with their derivatives."""
    k, rest = np.tanh(q), 1.0 / np.cosh(q)
    sn, cn, dn, second = jacobi(alpha, rest)
    delta: Complex = (k * cn / dn + 1j * rest / dn) ** 2
    drift = second - rest**2 * alpha
    field = cn + sn / dn * drift
    rise = 2.0 * k * rest * sn / dn
    turn = -2.0 * rest * field  # d delta/dq
    z = alpha - 2.0 * second + 2.0 * k**2 * sn * cn / dn + 1j * rise
    z_slope = (2.0 * alpha * k * rest**2 - 0.5 * rise * turn
               - 2j * rest * (cn / dn**2 * drift - rest**2 * sn / dn))
    back = delta.conj()
    tip, force = back * z / alpha, alpha**2 * back
    spin = np.stack([rise, turn])
    return Rods(
        tip, force,
        np.stack([(1.0 - tip) / alpha, back * z_slope / alpha]) - 1j * spin * tip,
        np.stack([2.0 * force / alpha, 0.0 * force]) - 1j * spin * force,
        -alpha * rise, alpha**2 * (k**2 - rest**2) - (tip * force.conj()).real,
        delta, 0.5 * alpha / ellipkm1(rest**2), field)
