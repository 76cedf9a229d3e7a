r"""Slider-crank whose coupler is an elastic rod with mass, its crank driven at a constant rate.

::

           crank end
            o-.._             coupler: pinned at both ends; at the start it is straight and moves
           /      ``--.._     like a rigid one
    crank /              ``-o slider, on the x axis
         O fixed
"""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import (
    broadcast_motion,
    check_not_negative,
    check_number,
    check_positive,
)
from proofmass.analytic.protocol import Acceleration, BendingStiffness, ClosedForm, Length, Mass
from proofmass.analytic.rods.rod_motion import MovingRod, RodStart, resolved_motion
from proofmass.base.arrays import Array, Complex

RATE_TOLERANCE = 1e-6  # largest change of a rate that counts as constant, over the rate
RATE_DIGITS, TIME_SHARE = 10, 1e-9
"""Digits to which the rate is rounded, and share of the duration to which times are rounded.

Drives that differ by less have the same motion, which is integrated once.  Positions change by as
much of the crank's displacement, and are accurate to 1e-6.
"""


def round_digits(value: float) -> float:
    """A number rounded to `RATE_DIGITS` digits."""
    return float(f"{value:.{RATE_DIGITS}g}")


def solve(
    angle: ArrayLike,
    rate: ArrayLike,
    acceleration: ArrayLike,
    *,
    crank: float,
    coupler: float,
    stiffness: float,
    coupler_mass: float,
    slider_mass: float = 0.0,
    crank_mass: float = 0.0,
    gravity: float = 0.0,
) -> dict[str, Array]:
    """Motion of an in-line slider-crank with an elastic coupler, from the first angle of the crank.

    Parameters
    ----------
    angle : array_like (n,)
        Angles of the crank from +x in the order of time [rad]; at the first one the coupler is
        straight.
    rate : array_like (n,)
        Rate of the crank, the same at all angles [rad/s].
    acceleration : array_like (n,)
        Not used, since it is zero [rad/s^2].
    crank, coupler : float
        Lengths [m], the coupler the longer one.
    stiffness, coupler_mass : float
        EI [N m^2] and mass of the coupler [kg].
    slider_mass, crank_mass : float
        Masses of the slider and of the crank, a uniform bar [kg].
    gravity : float
        Acceleration of gravity along -y [m/s^2].

    Returns
    -------
    dict of ndarray (n,)
        ``slider`` [m] and ``slider_velocity`` [m/s] along x; all quantities that `rod_released` has
        of middle and tip, for the coupler's middle and its end on the slider, such as ``middle_x``
        [m] and ``tip_angle`` [rad]; ``deflection`` of the middle from the line between the pins,
        positive to the left as seen from the crank [m]; ``crank_angle`` of the coupler at the crank
        [rad]; ``force_x``, ``force_y`` of the crank on the coupler and ``guide_force`` on the
        slider along y [N]; ``drive_moment`` on the crank [N m]; ``kinetic``, ``strain``,
        ``potential`` and ``energy``, the sum of kinetic and potential, of coupler and slider [J].

    Raises
    ------
    ValueError
        A length, stiffness or mass out of its range, a coupler that is not longer than the crank, a
        rate that is zero or changes, angles that go against it, or a motion that the polynomials do
        not resolve.

    Notes
    -----
    Positions are accurate to 2e-5 of the coupler's length or better, and to 1e-6 of it if no load
    bends the coupler at the start: without gravity, from the crank in line with the guide.
    The equations are in `proofmass.analytic.rods.rod_motion`.

    Examples
    --------
    A stiff coupler stays straight: a quarter turn takes the slider to sqrt(L^2 - r^2).

    >>> links = dict(crank=0.6, coupler=1.0, stiffness=10.0, coupler_mass=1.0)
    >>> angle = np.linspace(0.0, np.pi / 2.0, 5)
    >>> at = solve(angle, 6.0 + 0.0 * angle, 0.0 * angle, **links)
    >>> round(float(at["slider"][-1]), 4)
    0.8
    """
    check_positive(coupler=coupler, crank=crank)
    check_positive("N m^2", stiffness=stiffness)
    check_positive("kg", coupler_mass=coupler_mass)
    check_not_negative(slider_mass=slider_mass, crank_mass=crank_mass)
    check_number(gravity=gravity)
    if crank >= coupler:
        raise ValueError(f"coupler must be longer than the crank, {crank:g} m, got {coupler:g} m")
    motion = broadcast_motion(angle=angle, rate=rate, acceleration=acceleration)
    phi, speeds, _ = (np.atleast_1d(part) for part in motion)
    if phi.ndim != 1 or not phi.size:
        raise ValueError(f"angle must be one row of angles (n,), got an array {np.shape(angle)}")
    speed = float(np.median(speeds))
    if not np.abs(speeds - speed).max() <= RATE_TOLERANCE * abs(speed) or not speed:
        raise ValueError(
            "rate must be constant and not zero, since the elastic coupler moves in time"
        )
    speed, first = round_digits(speed), round(float(phi[0]), RATE_DIGITS - 1)
    t = (phi - phi[0]) / speed
    if unit := TIME_SHARE * round_digits(float(t[-1])):
        t = unit * np.round(t / unit)
    if (back := np.diff(t) < 0.0).any():
        before = int(np.argmax(back))
        raise ValueError(
            f"angle must follow the rate of {speed:g} rad/s in the order of time, got "
            f"{phi[before + 1]:g} rad after {phi[before]:g} rad"
        )
    links = crank, coupler, stiffness, coupler_mass, slider_mass, gravity
    found = resolved_motion(start_straight, (*links, first, speed), tuple(t.tolist()))
    end = crank * np.exp(1j * (first + speed * t))
    middle = found["middle_x"] + 1j * found["middle_y"]
    chord = found["tip_x"] + 1j * found["tip_y"] - end
    force = found["force_x"] + 1j * found["force_y"]
    weight = 0.5 * crank_mass * gravity * end.real
    found |= {
        "slider": found["tip_x"],
        "slider_velocity": found["tip_vx"],
        "deflection": ((middle - end) * chord.conj()).imag / np.abs(chord),
        "crank_angle": found.pop("begin_angle"),
        "drive_moment": (end.conj() * force).imag + weight,
    }
    return {
        name: curve.reshape(np.shape(angle)) for name, curve in found.items() if name != "moment"
    }


def start_straight(
    crank: float,
    coupler: float,
    stiffness: float,
    coupler_mass: float,
    slider_mass: float,
    gravity: float,
    first: float,
    speed: float,
) -> RodStart:
    """The coupler, and a function that returns its start: straight and moving like a rigid one."""

    def begin(t: ArrayLike) -> tuple[Complex, Complex, Complex]:
        place = crank * np.exp(1j * (first + speed * np.asarray(t)))
        return place, 1j * speed * place, -(speed**2) * place

    line = -float(np.arcsin(crank * np.sin(first) / coupler))
    turning = -speed * crank * np.cos(first) / (coupler * np.cos(line))
    rod = MovingRod(
        coupler, stiffness, coupler_mass, False, -1j * gravity, line, begin, slider_mass
    )
    return rod, lambda count: (np.zeros(count), turning * np.eye(1, count)[0])


class ElasticSliderCrank(ClosedForm, function=solve):
    """Slider-crank with an elastic coupler with mass, its crank driven at a constant rate."""

    method = "integration of the equations of motion of a rod"
    crank: Length
    coupler: Length
    stiffness: BendingStiffness
    coupler_mass: Mass
    slider_mass: Mass
    crank_mass: Mass
    gravity: Acceleration
