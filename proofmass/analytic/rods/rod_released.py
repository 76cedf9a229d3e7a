r"""Straight clamped rod released under its own weight: a motion of any amplitude in a plane.

::

    clamp |================ tip       theta(s, 0) = theta0,   theta_t(s, 0) = 0
          |                           gravity along -y
"""

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import check_number, check_positive
from proofmass.analytic.protocol import (
    Acceleration,
    Angle,
    BendingStiffness,
    ClosedForm,
    Domain,
    Length,
    Quantity,
)
from proofmass.analytic.rods.rod_motion import MovingRod, RodStart, resolved_motion
from proofmass.base.arrays import Array


def solve(
    time: ArrayLike,
    *,
    length: float,
    stiffness: float,
    mass: float,
    gravity: float = 9.81,
    theta0: float = 0.0,
) -> dict[str, Array]:
    """Motion of a clamped rod with mass along it that is released at rest at time 0.

    Parameters
    ----------
    time : array_like (n,)
        Times [s], not negative, in any order.
    length, stiffness, mass : float
        Length [m], EI [N m^2], and mass of the whole rod [kg]; all positive.
    gravity : float
        Acceleration of gravity along -y [m/s^2].
    theta0 : float
        Angle of the clamp, which is at the origin, and of the rod at time 0 from +x [rad].

    Returns
    -------
    dict of ndarray (n,)
        ``middle_x``, ``middle_y``, ``tip_x``, ``tip_y`` [m], ``middle_angle``, ``tip_angle``
        [rad], ``middle_vx``, ``middle_vy``, ``tip_vx``, ``tip_vy`` [m/s], ``middle_rate``,
        ``tip_rate`` [rad/s]; ``kinetic``, ``strain``, ``potential``, the sum of the strain energy
        and that of weight, zero at y = 0, and ``energy``, the sum of kinetic and potential [J];
        ``force_x``, ``force_y`` [N] and ``moment`` [N m] of the clamp on the rod.

    Raises
    ------
    ValueError
        A length, stiffness or mass that is not positive, a time that is negative, or a motion that
        the polynomials do not resolve.

    Notes
    -----
    Positions are accurate to 2e-5 of the length or better, energy to 2e-8 of its change.  The
    weight acts on the straight rod at once and excites all modes; those above the sixth lose their
    phase.  Over their ranges, velocities are accurate to 5e-3, angles and the moment to 5e-4 and
    3e-3, and rates and forces to 6e-2.  Sections have no rotary inertia of their own, which is also
    the limit of a chain of slender links.  The equations are in
    `proofmass.analytic.rods.rod_motion`.

    Examples
    --------
    A rod that is stiff for its weight falls by twice its deflection at rest, w L^4 / 8 EI:

    >>> at = solve([0.0, 0.0894], length=1.0, stiffness=1.0, mass=1e-2, gravity=0.1)
    >>> print(f"{at['tip_y'][1] / (1e-2 * 0.1 / 8.0):.1f}")
    -2.0
    """
    check_positive(length=length)
    check_positive("N m^2", stiffness=stiffness)
    check_positive("kg", mass=mass)
    check_number(gravity=gravity, theta0=theta0)
    t = np.asarray(time, float)
    if not (t >= 0.0).all():
        raise ValueError(f"time must not be negative: the rod is let go at 0, got {t.min():g} s")
    moments, where = np.unique(np.append(0.0, t), return_inverse=True)
    problem = length, stiffness, mass, gravity, theta0
    found = resolved_motion(start_at_rest, problem, tuple(moments.tolist()))
    return {
        name: curve[where[1:]].reshape(t.shape)
        for name, curve in found.items()
        if name not in ("guide_force", "begin_angle")
    }


def start_at_rest(
    length: float, stiffness: float, mass: float, gravity: float, theta0: float
) -> RodStart:
    """The rod, and a function that returns its start at rest.

    >>> start_at_rest(1.0, 1.0, 1.0, 0.0, 0.0)[1](2)
    (array([0., 0.]), array([0., 0.]))
    """
    rod = MovingRod(length, stiffness, mass, gravity=-1j * gravity, theta0=theta0)
    return rod, lambda count: (np.zeros(count), np.zeros(count))


class ReleasedRod(ClosedForm, function=solve):
    """Straight clamped rod released under its own weight: a motion of any amplitude in a plane."""

    method = "integration of the equations of motion of a rod"
    length: Length
    stiffness: BendingStiffness
    mass: Annotated[float, Quantity("kg", Domain.POSITIVE)]
    gravity: Acceleration
    theta0: Angle
