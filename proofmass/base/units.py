"""Units: what a unit such as ``deg/s^2`` means in SI.

pint reads the units.  Importing pint takes longer than importing the rest of the package, so it is
imported only for a unit that is not among `SI_POWERS`.  An angle counts as a quantity of its own,
so that neither ``1/s`` nor ``Hz`` is taken for ``rad/s``.
"""

import re
from functools import cache
from importlib.resources import files
from math import isfinite
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
QUANTITY_WORDS = {
    "1": "a number without a unit",
    "m": "a length",
    "rad": "an angle",
    "s": "a time",
    "kg": "a mass",
    "m/s": "a speed",
    "rad/s": "an angular speed",
    "m/s^2": "an acceleration",
    "rad/s^2": "an angular acceleration",
    "N": "a force",
    "N m": "a moment",
    "kg m^2": "a moment of inertia",
    "N m^2": "a bending stiffness",
    "N/m": "a stiffness",
    "N m/rad": "an angular stiffness",
}
"""What a quantity with an SI unit is called."""
QUANTITY_PATTERN = re.compile(r"\s*([-+]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
"""A number and a unit."""
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


def split_quantity(text: str) -> tuple[float, str] | None:
    """The number and the unit of a text; None if it does not begin with a finite number.

    >>> split_quantity("250 mm"), split_quantity("-1e3N m"), split_quantity("nan m")
    ((250.0, 'mm'), (-1000.0, 'N m'), None)
    """
    found = QUANTITY_PATTERN.fullmatch(text)
    if found is None or not isfinite(number := float(found[1])):
        return None
    return number, found[2]


def read_quantity(text: str, unit: str) -> float:
    """Read a number with a unit, and convert it to the SI unit of its quantity.

    Parameters
    ----------
    text : str
        Such as ``250 mm``.
    unit : str
        The SI unit of the quantity that it must be.

    Returns
    -------
    float
        The number [`unit`].

    Raises
    ------
    ValueError
        It is no finite number with a unit, or that of another quantity; the message says what is
        needed, and what the text is.

    Examples
    --------
    >>> read_quantity("250 mm", "m"), round(read_quantity("30 deg", "rad"), 6)
    (0.25, 0.523599)
    >>> read_quantity("250 deg", "m")
    Traceback (most recent call last):
    ValueError: a length [m]; '250 deg' is an angle
    """
    needed = f"{describe_quantity(unit)} [{unit}]" if unit in QUANTITY_WORDS else f"in {unit}"
    hint = "" if unit == "1" else f', or a text such as "1.5 {unit}"'
    hint = f"write a number without quotation marks{hint}"
    if (parts := split_quantity(text)) is None:
        raise ValueError(f"{needed}; {text!r} is no finite number with a unit; {hint}")
    number, own = parts
    if not own:
        raise ValueError(f"{needed}; {text!r} has no unit; {hint}")
    try:
        same = same_quantity(own, unit)
    except ValueError as error:
        raise ValueError(f"{needed}; {error}") from None
    if not same:
        raise ValueError(f"{needed}; {text!r} is {describe_quantity(own)}")
    return to_si(number, own)


def to_si(number: float, unit: str) -> float:
    """Convert a number to SI; by a division where that rounds less, as of millimetres.

    >>> to_si(9.0, "mm"), 9.0 * 0.001
    (0.009, 0.009000000000000001)
    """
    factor = si_unit(unit)[1]
    inverse = round(1.0 / factor) if factor < 1.0 else 0
    return number / inverse if inverse and 1.0 / inverse == factor else number * factor


def describe_quantity(unit: str) -> str:
    """What a number in a unit is: ``a length``, or ``in`` its SI unit.

    >>> describe_quantity("mm"), describe_quantity("J"), describe_quantity("Pa")
    ('a length', 'a moment', 'in Pa')
    """
    alike = (words for si, words in QUANTITY_WORDS.items() if same_quantity(unit, si))
    return next(alike, f"in {si_unit(unit)[0]}")


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
