"""Pendulum on a driven shaft with dry friction, which sticks to the shaft or slips."""

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import (
    broadcast_motion,
    check_not_negative,
    check_number,
    check_positive,
    motion_senses,
)
from proofmass.analytic.protocol import ClosedForm, Domain, Length, Quantity
from proofmass.base.arrays import Array


def solve(
    angle: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    length: float,
    mass: float,
    friction: float,
    bearing_friction: float = 0.0,
    gravity: float = 9.81,
) -> dict[str, Array]:
    r"""Quasi-static motion of a pendulum on a shaft that turns slowly, with dry friction.

    ::

         shaft, driven          M
          ( O )             s   |      ___________   +friction
             \              l   |    /          /
              \  length     i   |   /          /     one cycle of the shaft
               \            p   |  /          /
                o mass          | /__________/       -friction
        phi from straight down  +---------------- angle of the shaft

    The pendulum sticks to the shaft as long as friction can balance its weight, |phi| < p, and
    slips at phi = +-p::

        m g l sin(p) = friction,      phi' = clip(phi + change of the shaft's angle, -p, p)

    for every change in one sense. This is the play operator with the weight as its spring (a
    Jenkins element). The moment on the shaft is m g l sin(phi) plus the friction
    +-bearing_friction of the shaft's own bearing. A cycle of the shaft between two angles whose
    difference is a dissipates 2 friction (a - 2 p) and 2 bearing_friction a.

    Parameters
    ----------
    angle : angles of the shaft [rad], (n,), in the order in which they are reached
    rate, acceleration : time derivatives of `angle` [rad/s, rad/s^2]; `rate` gives the sense of the
        bearing's friction, `acceleration` is not used in statics
    length, mass : distance of the pendulum's point mass from the shaft [m], and that mass [kg]
    friction, bearing_friction : largest moments of dry friction between shaft and pendulum, and
        between ground and shaft [N m]
    gravity : along -y [m/s^2]

    Returns
    -------
    dict of (n,) arrays: swing, the angle phi from straight down, and slip = phi - angle [rad];
    swing_rate, slip_rate [rad/s] of the motion that ends at each sample; bob_x, bob_y [m], position
    of the mass; holding_moment [N m] of the shaft; hinge_moment [N m] of the shaft on the pendulum;
    lost [J], work that both frictions have dissipated until then.

    Raises
    ------
    ValueError
        A parameter out of its domain; friction that can balance the weight at every angle, so that
        the pendulum never slips; or a pendulum that does not slip at any of the given angles.

    Notes
    -----
    Accuracy: rounding. The pendulum hangs straight down at the first sample. The shaft does not
    reverse between two samples. Source: textbook statics; the play operator is that of A. Visintin,
    Differential Models of Hysteresis, Springer 1994, section III.2.

    Examples
    --------
    >>> turn = solve([0.0, 0.5, 0.0, -1.0], length=0.2, mass=0.5, friction=0.3)
    >>> turn["swing"].round(6).tolist()
    [0.0, 0.310789, -0.189211, -0.310789]
    """
    limit = slip_angle(length=length, mass=mass, friction=friction, gravity=gravity)
    check_not_negative("N m", bearing_friction=bearing_friction)
    shaft, shaft_rate, _ = broadcast_motion(angle=angle, rate=rate, acceleration=acceleration)
    if shaft.ndim != 1:
        raise ValueError(f"angle must be one row of angles in their order, got {shaft.shape}")
    swing, slips = apply_play(shaft, limit)
    if shaft.size > 2 and not slips[1:].any():
        raise ValueError(
            f"friction holds the pendulum at all given angles: it slips at {limit:.6g} rad from "
            f"straight down, and only reaches {np.abs(swing).max():.6g} rad"
        )
    moment = mass * gravity * length * np.sin(swing)
    bearing = bearing_friction * motion_senses(
        shaft_rate, float(np.abs(shaft_rate).max(initial=0.0))
    )
    slip = swing - shaft
    losses = friction * np.abs(np.diff(slip)) + bearing_friction * np.abs(np.diff(shaft))
    return {
        "swing": swing,
        "slip": slip,
        "swing_rate": np.where(slips, 0.0, shaft_rate),
        "slip_rate": np.where(slips, -shaft_rate, 0.0),
        "bob_x": length * np.sin(swing),
        "bob_y": -length * np.cos(swing),
        "holding_moment": moment + bearing,
        "hinge_moment": moment,
        "lost": np.concatenate([np.zeros(min(1, shaft.size)), np.cumsum(losses)]),
    }


def apply_play(shaft: Array, limit: float) -> tuple[Array, Array]:
    """Swings (n,) by the play operator with half width `limit` [rad], and whether there is slip.

    At the first sample the pendulum hangs straight down, without a moment of friction.
    """
    swing, slips = np.zeros(shaft.shape), np.ones(shaft.shape, bool)
    signs = np.sign(np.diff(shaft))
    reversals = np.flatnonzero(np.diff(signs) != 0) + 1
    for first, last in zip([0, *reversals], [*reversals, max(shaft.size - 1, 0)], strict=True):
        part = slice(first + 1, last + 1)
        free = swing[first] + shaft[part] - shaft[first]
        swing[part] = np.clip(free, -limit, limit)
        slips[part] = np.abs(free) >= limit
    slips[:1] = True
    return swing, slips


def slip_angle(*, length: float, mass: float, friction: float, gravity: float = 9.81) -> float:
    """Angle p from straight down [rad] at which the pendulum slips, m g l sin(p) = friction.

    >>> round(slip_angle(length=0.2, mass=0.5, friction=0.3), 6)
    0.310789
    """
    check_positive(length=length)
    check_positive("kg", mass=mass)
    check_positive("m/s^2", gravity=gravity)
    check_number(friction=friction)
    weight = mass * gravity * length
    if not 0.0 < friction < weight:
        raise ValueError(
            f"friction must be positive and less than {weight:.6g} N m, the largest moment of "
            f"the weight, so that the pendulum slips; got {friction}"
        )
    return float(np.arcsin(friction / weight))


def events(
    *, length: float, mass: float, friction: float, gravity: float = 9.81, **_: float
) -> dict[str, float]:
    """Angle of the shaft [rad] at which the pendulum slips for the first time, as an event."""
    return {"first slip": slip_angle(length=length, mass=mass, friction=friction, gravity=gravity)}


def properties(
    *, length: float, mass: float, friction: float, gravity: float = 9.81, **_: float
) -> dict[str, str]:
    """Angle at which the pendulum slips, and its loss per cycle, in words for a report.

    >>> properties(length=0.2, mass=0.5, friction=0.3)["slips at"]
    '17.81° from straight down'
    """
    limit = slip_angle(length=length, mass=mass, friction=friction, gravity=gravity)
    return {
        "slips at": f"{np.degrees(limit):.2f}° from straight down",
        "lost in a cycle": f"2 friction (way - {np.degrees(2 * limit):.2f}°) between the pendulum "
        "and the shaft",
    }


class ShaftPendulum(ClosedForm, function=solve, properties=properties):
    """Pendulum on a driven shaft with dry friction, which sticks to the shaft or slips."""

    marks = (events,)

    length: Length
    mass: Annotated[float, Quantity("kg", Domain.POSITIVE)]
    friction: Annotated[float, Quantity("N m", Domain.POSITIVE)]
    bearing_friction: Annotated[float, Quantity("N m", Domain.NOT_NEGATIVE)]
    gravity: Annotated[float, Quantity("m/s^2", Domain.POSITIVE)]
