"""Uniform bars: moments of drives and forces of pins due to weight and inertia.

Position, velocity and acceleration of a point of a bar are linear between those of its ends P and
Q.  With the mass m, all sums over the bar therefore follow from the motion of the ends::

    sum a . v        =  m (2 aP . vP + aP . vQ + aQ . vP + 2 aQ . vQ) / 6
    sum a            =  m (aP + aQ) / 2
    sum (r - P) x a  =  (Q - P) x m (aP + 2 aQ) / 6

By virtual work, the first sum is the moment that a drive needs for the inertia of the bar, if v
are the velocities for a unit rate of that drive alone, and a the accelerations.  For one drive it
is Eksergian's equation, I dw + I' w^2 / 2.  The other two sums are the force that the pins of the
bar apply to it, and the moment of that force about P.
"""

from collections.abc import Callable, Collection, Mapping

import numpy as np

from proofmass.analytic.numerics import cross, dot
from proofmass.base.arrays import Array, Complex

NamedCurves = dict[str, Array]
"""Curves of quantities by their names."""
Ends = tuple[Complex | complex, Complex | complex]
"""A vector at each of the two ends of a bar, as complex numbers."""


FORCE_ENDINGS = "_force_x", "_force_y"
LOAD_ENDINGS = "_moment", *FORCE_ENDINGS
"""Endings of the names of pin forces, and of all quantities due to weight, inertia and loads."""


def is_requested(only: Collection[str] | None, *endings: str) -> bool:
    """Whether a quantity is requested whose name has one of the endings; None requests all.

    >>> is_requested(None, "_moment"), is_requested({"slide"}, "_moment")
    (True, False)
    >>> is_requested({"holding_moment"}, "_moment")
    True
    """
    return only is None or any(name.endswith(endings) for name in only)


def select_positions(
    only: Collection[str] | None, places: Mapping[str, Callable[[], Array]]
) -> NamedCurves | None:
    """The requested curves of places and angles; None if any other quantity is requested.

    >>> list(select_positions({"y"}, {"x": lambda: np.zeros(1), "y": lambda: np.ones(1)}))
    ['y']
    >>> select_positions({"y", "y_rate"}, {"y": lambda: np.ones(1)})
    """
    if only is None or not places.keys() >= set(only):
        return None
    return {name: curve() for name, curve in places.items() if name in only}


def drive_moment(mass: float, acceleration: Ends, unit_velocities: Ends) -> Array:
    """Moment [N m], or force [N], that a drive needs for the inertia of a bar.

    Parameters
    ----------
    mass : float
        Mass of the bar [kg].
    acceleration : two complex arrays
        Accelerations of the ends [m/s^2].
    unit_velocities : two complex arrays
        Velocities of the ends for a unit rate of the drive [m, or 1 for a slide].

    Examples
    --------
    >>> round(float(drive_moment(3.0, (0j, 2j), (0j, 2j))), 12)  # m L^2 / 3, about one end
    4.0
    """
    (a, b), (v, w) = acceleration, unit_velocities
    return np.asarray(mass / 6.0 * (dot(a, 2.0 * v + w) + dot(b, v + 2.0 * w)))


def pin_load(mass: float, bar: Complex, acceleration: Ends) -> tuple[Complex, Array]:
    """Force [N], and moment about the first end [N m], that give a bar its accelerations.

    Parameters
    ----------
    mass : float
        Mass of the bar [kg].
    bar : complex array
        Vector from the first end to the second [m].
    acceleration : two complex arrays
        Accelerations of the ends, less that of gravity [m/s^2].
    """
    a, b = acceleration
    return np.asarray(mass * (a + b) / 2.0), mass / 6.0 * cross(bar, a + 2.0 * b)
