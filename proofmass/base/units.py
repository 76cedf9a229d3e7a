"""Units: what a unit such as ``deg/s^2`` means in SI.

pint reads the units.  Importing pint takes longer than importing the rest of the package, so it is
imported only for a unit that is not among `SI_POWERS`.  An angle counts as a quantity of its own,
so that neither ``1/s`` nor ``Hz`` is taken for ``rad/s``.
"""

import re
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pint import Unit, UnitRegistry

SI_POWERS = {  # SI units, with the powers of length, mass, time and angle in them
    "1": (0, 0, 0, 0),
    "m": (1, 0, 0, 0),
    "kg": (0, 1, 0, 0),
    "s": (0, 0, 1, 0),
    "rad": (0, 0, 0, 1),
    "m/s": (1, 0, -1, 0),
    "rad/s": (0, 0, -1, 1),
    "m/s^2": (1, 0, -2, 0),
    "rad/s^2": (0, 0, -2, 1),
    "N": (1, 1, -2, 0),
    "N m": (2, 1, -2, 0),
    "J": (2, 1, -2, 0),
    "m^2": (2, 0, 0, 0),
    "kg m^2": (2, 1, 0, 0),
    "N m^2": (3, 1, -2, 0),
    "N/m": (0, 1, -2, 0),
    "N m/rad": (2, 1, -2, -1),
}
MOTION_UNITS = {
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "acceleration": ("rad/s^2", "m/s^2"),
}
"""SI units of the kinds of motion."""
POSITION_UNITS = (*MOTION_UNITS["position"], "1")
"""SI units of positions, angles and orientations (quaternions, directions of axes)."""
FORCE_UNITS = ("N", "N m")
"""SI units of forces and moments."""
KEPT_SPELLINGS = ("m", "rad", "s", "kg", "N", "J", "W", "Pa", "Hz")
"""SI units that `si_unit` keeps as they are written, instead of composing them of others."""
UNIT_EXAMPLES = "mm, deg, rad/s^2, N m, rev/min; 1 for a number without a unit"


@cache
def si_unit(unit: str) -> tuple[str, float]:
    """Find the SI spelling of a unit, and the factor that converts a number to it.

    Raises
    ------
    ValueError
        The unit is unknown.

    Examples
    --------
    >>> si_unit("deg/s^2")
    ('rad/s^2', 0.017453292519943295)
    >>> si_unit("N mm")
    ('N m', 0.001)
    """
    if unit in SI_POWERS:
        return unit, 1.0
    factor = float(unit_registry().Quantity(1, parse_unit(unit)).to_base_units().magnitude)
    spelled = re.sub(
        r"[^\W\d_]+|°", lambda word: si_spelling(word.group()), unit.replace("²", "^2")
    )
    return spelled, factor


@cache
def same_quantity(one: str, other: str) -> bool:
    """Whether two units measure the same quantity.

    >>> same_quantity("deg", "rad"), same_quantity("J", "kJ"), same_quantity("rad/s", "1/s")
    (True, True, False)
    """
    if one == other:
        return True
    base = [unit_registry().get_base_units(parse_unit(unit))[1] for unit in (one, other)]
    return bool(base[0] == base[1])


@cache
def unit_powers(unit: str) -> tuple[float, float, float, float]:
    """The powers of length, mass, time and angle in a unit.

    >>> unit_powers("N m"), unit_powers("deg/s")
    ((2, 1, -2, 0), (0.0, 0.0, -1.0, 1.0))
    """
    if unit in SI_POWERS:
        return SI_POWERS[unit]
    base = dict(unit_registry().Quantity(1, parse_unit(unit)).to_base_units().unit_items())
    length, mass, time, angle = (
        float(str(base.get(word, 0))) for word in ("meter", "kilogram", "second", "radian")
    )
    return length, mass, time, angle


@cache
def unit_registry() -> "UnitRegistry":
    """Load pint's units, with the angle as a dimension of its own."""
    from pint import UnitRegistry

    # empty at first: a full registry would keep units derived from its dimensionless radian
    units: UnitRegistry = UnitRegistry(None, on_redefinition="ignore")
    units.load_definitions(str(files("pint") / "default_en.txt"))
    units.default_system = "mks"
    units.define("radian = [angle] = rad")
    units.define("@alias turn = rev")
    return units


def parse_unit(unit: str) -> "Unit":
    """Read a unit with pint; ValueError if pint does not know it, or if its zero is shifted."""
    try:
        found = unit_registry().Unit("" if unit == "1" else unit)
        # not 0 of a unit such as degree Celsius, which no factor converts
        offset = unit_registry().Quantity(0, found).to_base_units().magnitude
    except Exception:  # pint's parser raises errors of many kinds
        offset = None
    if offset != 0 or not unit.strip():
        raise ValueError(f"unknown unit {unit!r}; write it as in {UNIT_EXAMPLES}")
    return found


def si_spelling(word: str) -> str:
    """Find the SI unit of the quantity that one word of a unit measures."""
    there = next((si for si in KEPT_SPELLINGS if same_quantity(word, si)), None)
    return there or f"{unit_registry().get_base_units(parse_unit(word))[1]:~C}".replace(
        "**", "^"
    ).replace("*", " ")
