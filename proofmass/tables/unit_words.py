"""Units as programs write them: ``grd``, ``sec``, ``U/min``, ``NEWTON-METER``, ``m/s²``.

`read_unit` translates a spelling to the one that `proofmass.base.units` reads.  Words that mean one
thing in one language and another in a second one, such as ``grad``, are in `DOUBTFUL_UNITS`.
"""

import re
import unicodedata
from functools import lru_cache

SPELLINGS = {
    "s": "s sec secs second seconds sek sekunde sekunden segundo segundos seg seconde secondes "
    "secondi sekund с сек 秒",
    "ms": "ms msec msecs millisecond milliseconds millisec millis millisekunden milisegundos мс",
    "us": "us µs μs usec usecs microsecond microseconds micros мкс",
    "ns": "ns nsec nsecs nanosec nanosecs nanosecond nanoseconds nanos",
    "min": "min mins minute minutes minuten minuto minutos мин 分",
    "h": "h hr hrs hour hours std stunde stunden",
    "deg": "deg degs degree degrees ° grd grado grados gradi degré degrés degre degres graus "
    "dgr dg град 度",
    "rad": "rad rads radian radians radianes radiant radianti radiants radián рад",
    "mrad": "mrad mrads milliradian milliradians",
    "rev": "rev revs revolution revolutions turn turns u umdr umdrehung umdrehungen tr tour tours "
    "vuelta vueltas giri об",
    "m": "m meter meters metre metres metro metros mètre mètres м",
    "mm": "mm millimeter millimeters millimetre millimetres milímetro milímetros мм",
    "cm": "cm centimeter centimeters centimetre centimetres см",
    "um": "um µm μm micron microns micrometer micrometers",
    "km": "km kilometer kilometers kilometre kilometres",
    "in": "in inch inches zoll",
    "ft": "ft foot feet",
    "N": "n newton newtons н",
    "kN": "kn kilonewton kilonewtons",
    "mN": "mn millinewton",
    "lbf": "lbf pound_force poundforce",
    "kgf": "kgf kilogram_force",
    "kg": "kg kilogram kilograms kilogramme kilogrammes кг",
    "g": "g gram grams gramm",
    "lb": "lb lbm pound_mass",
    "J": "j joule joules",
    "kJ": "kj",
    "mJ": "mj",
    "W": "w watt watts",
    "kW": "kw",
    "Hz": "hz hertz",
    "Pa": "pa pascal",
    "kPa": "kpa",
    "MPa": "mpa",
    "V": "v volt volts",
    "mV": "mv",
    "A": "a amp amps ampere amperes",
    "K": "k kelvin",
    "%": "% percent",
}
"""Spellings in lower case by the unit's own."""
UNIT_OF = {word: unit for unit, words in SPELLINGS.items() for word in words.split()}
WHOLE_UNITS = {
    "rpm": "rev/min",
    "rps": "rev/s",
    "dps": "deg/s",
    "mps": "m/s",
    "fps": "ft/s",
    "nm": "N m",
    "nmm": "N mm",
    "ncm": "N cm",
    "knm": "kN m",
    "mnm": "mN m",
    "kmh": "km/h",
    "kph": "km/h",
}
"""Units of several words in one, in lower case."""
EXACT_UNITS = {"Mm": "", "nm": "", "MS": "", "Ms": "", "U": "rev", "G": ""}
"""Words whose capitals matter: an empty unit is no unit of a table of this kind."""
DOUBTFUL_UNITS = {"grad": ("deg", "gon"), "grade": ("deg", "gon"), "grads": ("deg", "gon")}
"""Words for a degree in one language and for a gon, a hundredth of a right angle, in another."""
TIME_UNITS = ("s", "ms", "us", "ns", "min", "h")
"""Units of time of columns."""
SHORT_WORDS = frozenset("s h m n g j w v a k u с м".split())
"""Units of one letter, which may also be names or indices."""
NO_UNIT = frozenset(("-", "--", "1", "none", "unitless", "dimensionless", "n/a", "-none-", "[-]"))
"""Texts in a place for units that say that there is none."""
RAISED = {
    "⁻": "-",
    **{raised: str(k) for k, raised in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹")},
}
FACTOR = re.compile(r"(%|°|1|[^\W\d_]+(?:_[^\W\d_]+)*)(?:\^\(?([-+]?\d)\)?|([-+]?\d))?")
"""A word of a unit, or the 1 of ``1/s``, with its power."""
MAX_LETTERS = 40
"""A longer text is a sentence, and no unit."""


@lru_cache(4096)
def read_unit(text: str) -> str | None:
    """Translate a unit of any spelling; None if it is none that is known.

    A unit of one that is doubtful is not known either; see `doubtful_unit`.

    >>> [read_unit(text) for text in ("deg/sec", "NEWTON-mm", "U/min", "rad·s⁻¹", "m/s²")]
    ['deg/s', 'N mm', 'rev/min', 'rad/s', 'm/s^2']
    >>> [read_unit(text) for text in ("mm/sec**2", "°/s^2", "grd", "grad", "4.1", "x", "kg*m^2")]
    ['mm/s^2', 'deg/s^2', 'deg', None, None, None, 'kg m^2']
    """
    text = text.strip()
    if not text or len(text) > MAX_LETTERS:
        return None
    if text in EXACT_UNITS:
        return EXACT_UNITS[text] or None
    if whole := WHOLE_UNITS.get(text.lower()):
        return whole
    powers = unit_factors(typed(text))
    return spell(powers) if powers else None


def doubtful_unit(text: str) -> tuple[str, ...]:
    """The units that a word may mean, if there are several; empty otherwise.

    >>> doubtful_unit("Grad"), doubtful_unit("deg"), doubtful_unit("grad/s")
    (('deg', 'gon'), (), ('deg/s', 'gon/s'))
    """
    word, *rest = re.split(r"(?=[/*·])", text.strip(), maxsplit=1)
    found = DOUBTFUL_UNITS.get(word.strip().lower(), ())
    if not rest:
        return found
    units = [read_unit(f"{one}{rest[0]}") for one in found]
    if None not in units:
        return tuple(str(one) for one in units)
    powers = unit_factors(typed(f"deg{rest[0]}"))
    return tuple(spell({one if k == "deg" else k: p for k, p in powers.items()}) for one in found)


def typed(text: str) -> str:
    """A unit with the signs of a keyboard.

    >>> typed("kg·m²"), typed("rad s⁻¹")
    ('kg m^2', 'rad s^-1')
    """
    text = text.replace("º", "°").replace("−", "-").replace("**", "^")
    text = re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda m: "^" + "".join(RAISED[c] for c in m[0]), text)
    text = unicodedata.normalize("NFKC", text)
    text = re.sub(r"\bper\b", "/", text, flags=re.IGNORECASE)
    return re.sub(r"[·⋅*∙•×]|(?<=[^\W\d_])[-.](?=[^\W\d_])", " ", text)


def unit_factors(text: str) -> dict[str, int]:
    """The powers of the words of a unit; empty if a word is not known.

    >>> unit_factors("deg/s/s"), unit_factors("kg m^2"), unit_factors("blue")
    ({'deg': 1, 's': -2}, {'kg': 1, 'm': 2}, {})
    """
    powers: dict[str, int] = {}
    sign = 1
    for part in re.split(r"(/)|\s+", text.replace("(", " ").replace(")", " ")):
        if not part:
            continue
        if part == "/":
            sign = -1
            continue
        found = FACTOR.fullmatch(part)
        units = unit_words(found[1]) if found else None
        if found is None or units is None:
            return {}
        for unit in units:
            powers[unit] = powers.get(unit, 0) + sign * int(found[2] or found[3] or 1)
    return {unit: power for unit, power in powers.items() if power}


def unit_words(word: str) -> list[str] | None:
    """The units of a word, such as two of ``Nm``; none of ``1``, None of a word that is no unit."""
    if word == "1":
        return []
    if word in EXACT_UNITS:
        return [EXACT_UNITS[word]] if EXACT_UNITS[word] else None
    if unit := UNIT_OF.get(word) or UNIT_OF.get(word.lower()):
        return [unit]
    whole = WHOLE_UNITS.get(word.lower(), "")
    return whole.split() if whole and "/" not in whole else None


def spell(powers: dict[str, int]) -> str:
    """A unit from the powers of its words.

    >>> spell({"deg": 1, "s": -2}), spell({"s": -1})
    ('deg/s^2', '1/s')
    """
    above = [power_of(unit, power) for unit, power in powers.items() if power > 0]
    below = [power_of(unit, -power) for unit, power in powers.items() if power < 0]
    return "/".join([" ".join(above) or "1", *below])


def power_of(unit: str, power: int) -> str:
    """A word of a unit with its power."""
    return unit if power == 1 else f"{unit}^{power}"


def dimension(unit: str) -> str:
    """The quantity that a unit measures, by the SI unit of it: ``s``, ``rad``, ``rad/s``, ...

    >>> dimension("deg/s"), dimension("mm"), dimension("N mm"), dimension("")
    ('rad/s', 'm', 'N m', '')
    """
    from proofmass.base.units import SI_POWERS, same_quantity

    if not unit:
        return ""
    try:
        return next((si for si in SI_POWERS if same_quantity(si, unit)), unit)
    except ValueError:
        return unit
