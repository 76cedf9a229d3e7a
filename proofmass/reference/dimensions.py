"""Which powers of length, mass and time a curve of a closed form has, found by scaling.

The equations of mechanics hold in any system of units.  If all lengths are doubled, among them
those in forces and inertias, a curve that is a length doubles and an angle stays: so the powers
follow from three more evaluations, with the unit of length, mass or time changed.  A curve that
does not scale so has a hidden constant with a unit; nothing is said of it, or of one that is zero.
"""

from collections.abc import Mapping

import numpy as np

from proofmass.analytic.protocol import REQUIRED, Ask, InputMotion, Reference, Value
from proofmass.base.arrays import Array
from proofmass.base.units import SI_POWERS, unit_powers

FACTOR = 2.0
"""Factor of a unit, whose powers cause no rounding."""
LARGEST_POWER = 4
"""Largest power that is looked for; N m^2 has 3."""
SCALING_ROUNDING = 1e-6
"""Share of a curve up to which it scales: searches within closed forms end near rounding."""
BASES = "length", "mass", "time"
Powers = tuple[float, float, float]
"""Powers of the `BASES`."""


def curve_powers(
    reference: type[Reference], parameters: Mapping[str, Value], motion: InputMotion, slides: bool
) -> dict[str, Powers]:
    """The powers of length, mass and time of the curves of a reference.

    Parameters
    ----------
    reference : type of Reference
        One that reads no model.
    parameters : mapping
    motion : InputMotion
        Over time.
    slides : bool
        Whether the drives are lengths, not angles.

    Returns
    -------
    dict of str to tuple of float
        Curves that are zero, or do not scale, are left out.

    Examples
    --------
    >>> from proofmass.reference.find import find_reference
    >>> time = np.linspace(0.1, 1.0, 4)
    >>> pendulum = {"length": 1.0, "mass": 2.0, "gravity": 9.81, "amplitude": 0.3}
    >>> found = curve_powers(find_reference("pendulum"), pendulum, InputMotion(time), False)
    >>> found["angle"], found["rate"], found["kinetic"]
    ((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), (2.0, 1.0, -2.0))
    """
    given = {
        name: one.default
        for name, one in reference.parameters.items()
        if one.is_quantity and one.default is not REQUIRED
    } | dict(parameters)
    ask = Ask(inertia=reference.covers_inertia)
    curves = reference.evaluate(given, motion, ask)
    found: dict[str, list[float]] = {name: [] for name in curves}
    for base in range(len(BASES)):
        changed = reference.evaluate(
            {name: scaled(reference, name, value, base) for name, value in given.items()},
            scaled_motion(motion, base, slides),
            ask,
        )
        for name, curve in curves.items():
            found[name] += power_between(curve, changed[name])
    return {
        name: (powers[0], powers[1], powers[2])
        for name, powers in found.items()
        if len(powers) == len(BASES)
    }


def scaled(reference: type[Reference], name: str, value: Value, base: int) -> Value:
    """A parameter after a change of the unit of length, mass or time, number `base` of these."""
    one = reference.parameters.get(name)
    if one is None or not one.is_quantity or isinstance(value, str):
        return value
    factor: float = FACTOR ** unit_powers(one.unit)[base]
    return value * factor


def scaled_motion(motion: InputMotion, base: int, slides: bool) -> InputMotion:
    """A motion over time after a change of a unit."""
    length, time = (FACTOR if base == which else 1.0 for which in (0, 2))
    size = length if slides else 1.0
    if motion.drives is None:
        return InputMotion(motion.x * time)
    value, rate, acceleration = motion.drives
    return InputMotion(
        motion.x * time, (value * size, rate * size / time, acceleration * size / time**2)
    )


def power_between(curve: Array, changed: Array) -> list[float]:
    """The power of `FACTOR` by which a curve has changed; empty if it has not scaled."""
    largest = float(np.abs(curve).max(initial=0.0))
    if not (largest > 0.0 and np.isfinite(curve).all() and np.isfinite(changed).all()):
        return []
    power = round(float(np.log2(np.abs(changed).max(initial=0.0) / largest or 1.0)))
    off = np.abs(changed - FACTOR**power * curve).max()
    good = abs(power) <= LARGEST_POWER and off <= SCALING_ROUNDING * FACTOR**power * largest
    return [float(power)] if good else []


def unit_of_powers(powers: Powers) -> str:
    """The SI unit with these powers; ``1`` for an angle, which cannot be told from a number.

    >>> unit_of_powers((0.0, 0.0, -1.0)), unit_of_powers((1.0, 1.0, -2.0))
    ('rad/s', 'N')
    """
    return next((unit for unit, known in SI_POWERS.items() if known[:3] == powers), "1")
