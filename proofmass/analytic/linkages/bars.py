"""Uniform bars: what their weight and inertia ask of drives and pins, by the motion of the ends.

Every point of a bar moves between its ends P and Q as the share s of its length, so that with mass
m all sums over it are those of two ends::

    sum a . v        =  m (2 aP . vP + aP . vQ + aQ . vP + 2 aQ . vQ) / 6
    sum a            =  m (aP + aQ) / 2
    sum (r - P) x a  =  (Q - P) x m (aP + 2 aQ) / 6

By virtual work, the first one is the moment that inertia asks of a drive, if v are the velocities
for a unit rate of that drive alone, and a the accelerations; of one drive it is Eksergian's
equation, I dw + I' w^2 / 2.  The others are the force that the pins of the bar must give it, and
its moment about P.
"""

from collections.abc import Callable, Collection, Mapping

import numpy as np

from proofmass.analytic.numerics import Array, Complex, cross, dot

NamedCurves = dict[str, Array]
"""Quantities by their names."""
Ends = tuple[Complex | complex, Complex | complex]
"""A vector at each end of a bar, as complex numbers."""


FORCES = "_force_x", "_force_y"
LOADS = "_moment", *FORCES
"""How the names of forces of pins end, and those of all that motion and weight ask for."""


def asks(only: Collection[str] | None, *endings: str) -> bool:
    """Whether quantities whose names end so are asked for: all of them are if `only` is None.

    >>> asks(None, "_moment"), asks({"slide"}, "_moment"), asks({"holding_moment"}, "_moment")
    (True, False, True)
    """
    return only is None or any(name.endswith(endings) for name in only)


def picked(
    only: Collection[str] | None, places: Mapping[str, Callable[[], Array]]
) -> NamedCurves | None:
    """The curves of places and angles that are asked for; None if anything else is asked for.

    >>> list(picked({"y"}, {"x": lambda: np.zeros(1), "y": lambda: np.ones(1)}))
    ['y']
    >>> picked({"y", "y_rate"}, {"y": lambda: np.ones(1)})
    """
    if only is None or not places.keys() >= set(only):
        return None
    return {name: curve() for name, curve in places.items() if name in only}


def asked_of_drive(mass: float, acceleration: Ends, moved: Ends) -> Array:
    """Moment [N m], or force [N], that the inertia of a bar asks of a drive.

    Parameters
    ----------
    mass : float
        [kg]
    acceleration : two complex arrays
        Of the ends [m/s^2].
    moved : two complex arrays
        Velocities of the ends for a unit rate of the drive [m, or 1 of a slide].

    Examples
    --------
    >>> round(float(asked_of_drive(3.0, (0j, 2j), (0j, 2j))), 12)  # m L^2 / 3, about one end
    4.0
    """
    (a, b), (v, w) = acceleration, moved
    return np.asarray(mass / 6.0 * (dot(a, 2.0 * v + w) + dot(b, v + 2.0 * w)))


def asked_of_pins(mass: float, bar: Complex, acceleration: Ends) -> tuple[Complex, Array]:
    """Force [N], and moment about the first end [N m], that move a bar so.

    Parameters
    ----------
    mass : float
        [kg]
    bar : complex array
        From the first end to the second [m].
    acceleration : two complex arrays
        Of the ends, less that of gravity [m/s^2].
    """
    a, b = acceleration
    return np.asarray(mass * (a + b) / 2.0), mass / 6.0 * cross(bar, a + 2.0 * b)
