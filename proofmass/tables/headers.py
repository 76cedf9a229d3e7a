"""Cells of headers: the name of a column, its unit, and what its name says about it."""

import re
from collections import Counter
from dataclasses import dataclass, replace
from functools import lru_cache

from proofmass.tables.unit_words import (
    NO_UNIT,
    SHORT_WORDS,
    TIME_UNITS,
    UNIT_OF,
    WHOLE_UNITS,
    doubtful_unit,
    read_unit,
)

TIME_WORDS = frozenset(
    "t time times tout zeit tiempo temps tempo czas время tijd tid aika 時間 时间 時刻 clock "
    "timestamp stamp elapsed seconds secs sec x_value xvalue zeitstempel uhrzeit reloj millis "
    "micros nanoseconds milliseconds zaman idő čas".split()
)
"""Words of the names of columns of times."""
FRAME_WORDS = frozenset(
    "frame frames framenumber frameno bild bildnr image sample samples index idx seq step row "
    "record punkt cuadro nr no num n number id".split()
)
"""Words of the names of columns that count rows."""
ANGLE_WORDS = frozenset(
    "theta phi psi alpha beta gamma angle angles angular ang winkel angulo ángulo angolo angle1 "
    "kat hoek vinkel rotation rot yaw pitch roll azimuth elevation heading θ φ ψ α β γ ϕ ϑ 角 角度 "
    "угол drehwinkel kurbelwinkel".split()
)
"""Words of the names of columns of angles."""
RATE_WORDS = frozenset(
    "omega w velocity vel rate speed v angvel angularvelocity drehzahl geschwindigkeit velocidad "
    "winkelgeschwindigkeit acceleration acc accel beschleunigung alpha_acc torque moment force "
    "power energy ω rps rpm velocidade vitesse count error status".split()
)
"""Words of the names of other quantities, which a name may have beside that of an angle."""
ACCELERATION_WORDS = frozenset("acc accel acceleration beschleunigung a ax ay az accx accy".split())
"""Words of the names of accelerations, of which a unit ``g`` is the one of gravity."""
CLOCKWISE_WORDS = frozenset(
    "cw clockwise uhrzeigersinn horario horaire orario rechtsdrehend".split()
)
"""Words for the direction of the hands of a clock."""
COUNTER_WORDS = frozenset("counter anti gegen contra counterclock against not no".split())
"""Words before those that turn their meaning round."""
SUFFIX_UNITS = {
    **{word: word for word in ("rad_s", "deg_s", "mm_s", "cm_s", "deg_per_s", "rad_per_s")},
    **{word: word for word in ("m_per_s", "mm_per_s", "rad_s2", "deg_s2", "mm_s2", "rad_per_s2")},
    **{word: word for word in ("deg_per_s2", "m_per_s2", "mm_per_s2", "deg_sec", "rad_sec")},
    **{word: word for word in ("rad_s_2", "m_s2", "rev_min", "rev_per_min", "m_s", "n_m", "n_mm")},
}
"""Units of several words at the end of a name."""
NUMBER_OF_NAME = re.compile(r" \(\d+\)'*$")
"""What a second column of a name has behind it."""
CAMEL_UNIT = re.compile(r"(?<=[a-z])(Deg|Rad|Mm|Ms|Sec|Rpm|Us|Ns)$")
"""A unit at the end of a name of words that begin with a capital."""
LAST_BRACKET = re.compile(r"(.*?)[\s_]*([\[({<])\s*([^\[\](){}<>]*?)\s*[\])}>]", re.DOTALL)
"""A name that ends with a bracket."""
NESTED_BRACKET = re.compile(r"(.*?)\s*[\[(]\s*((?:[^\[\]()]|\([^()]*\))*?)\s*[\])]", re.DOTALL)
"""A name that ends with a bracket that has another one in it, such as ``N/(m/s)``."""


@dataclass(frozen=True)
class ColumnHead:
    """What the header of a column says.

    Attributes
    ----------
    name : str
    unit : str
        Its unit as `proofmass.base.units` reads it; empty without one that is known.
    written_unit : str
        Its unit as it is written; empty without one.
    clockwise : bool
    """

    name: str
    unit: str = ""
    written_unit: str = ""
    clockwise: bool = False


@lru_cache(4096)
def read_head(cell: str) -> ColumnHead:
    """Split the header of a column into its name and its unit.

    >>> [(h.name, h.unit) for h in map(read_head, ("P[4.1] ( grd )", "Angle(4)", "t / s"))]
    [('P[4.1]', 'deg'), ('Angle(4)', ''), ('t', 's')]
    >>> [(h.name, h.unit) for h in map(read_head, ("omega_rad_s", "Time, sec", "v_{x}", "x_mm"))]
    [('omega', 'rad/s'), ('Time', 's'), ('v_{x}', ''), ('x', 'mm')]
    """
    cell = " ".join(cell.split())
    for split in (bracket_unit, separated_unit, suffix_unit):
        if (found := split(cell)) is not None:
            break
    else:
        found = ColumnHead(cell)
    clockwise = found.clockwise or says_clockwise(found.name)
    name = without_clockwise(found.name) if says_clockwise(found.name) else found.name
    unit = found.unit
    if unit == "g" and words_of(name) & ACCELERATION_WORDS:
        unit = "g_0"
    return ColumnHead(name, unit, found.written_unit, clockwise)


def bracket_unit(cell: str) -> ColumnHead | None:
    """The name and the unit of a header such as ``phi [deg]``; None if it has none in brackets."""
    for pattern, inner in ((LAST_BRACKET, 3), (NESTED_BRACKET, 2)):
        found = pattern.fullmatch(cell)
        if found is None:
            continue
        name, text = found[1].strip(" _/"), found[inner].strip()
        clockwise = says_clockwise(text)
        text = without_direction(text) if clockwise else text
        if clockwise and not text:
            before = read_head(name)
            return replace(before, clockwise=True)
        if (head := head_of_unit(name, text, cell.endswith("]"))) is not None:
            return replace(head, clockwise=clockwise)
    return None


def head_of_unit(name: str, text: str, square: bool) -> ColumnHead | None:
    """The head of a column with a text in brackets behind its name; None if it is no unit."""
    if text.lower() in NO_UNIT and text and (square or text != "1") and name:
        return ColumnHead(name, "1", text)
    unit = read_unit(text)
    short = text.lower() in SHORT_WORDS or text.lower() == "min"
    if unit and (not short or may_have(name, unit, square)):
        return ColumnHead(name, unit, text)
    if doubtful_unit(text):
        return ColumnHead(name, "", text)
    if square and name and is_unknown_unit(text):
        return ColumnHead(name, text if is_known_to_pint(text) else "", text)
    return None


def is_known_to_pint(text: str) -> bool:
    """Whether a unit is known to the library of units, though no table of spellings has it."""
    from proofmass.base.units import si_unit

    try:
        si_unit(text)
    except ValueError:
        return False
    return True


def is_unknown_unit(text: str) -> bool:
    """Whether a text in square brackets is a unit that is not known, and no index.

    >>> is_unknown_unit("counts"), is_unknown_unit("4.1"), is_unknown_unit("X")
    (True, False, False)
    """
    return len(text) > 1 and not any(sign.isdigit() for sign in text) and " " not in text


def may_have(name: str, unit: str, square: bool) -> bool:
    """Whether a column of a name may be in a unit that may be a word of the name instead.

    >>> may_have("Time", "min", False), may_have("Force", "min", False), may_have("phi", "s", True)
    (True, False, False)
    """
    if unit in TIME_UNITS and words_of(name) & ANGLE_WORDS:
        return False
    if unit == "min" and not words_of(name) & TIME_WORDS:
        return False  # the smallest value
    return square or unit not in ("A", "K", "V")


def separated_unit(cell: str) -> ColumnHead | None:
    """The name and the unit of a header such as ``t / s``, ``Time, s`` or ``Winkel in deg``."""
    for mark in (" / ", ", ", " in ", "/", ","):
        name, found, text = cell.partition(mark)
        text = text.strip()
        if mark == "/" and text.startswith("(") and text.endswith(")"):
            text = text[1:-1]
        name = name.strip()
        if not found or not name or read_unit(name):
            continue
        if (unit := read_unit(text)) or doubtful_unit(text):
            return ColumnHead(name, unit or "", text)
    return None


def suffix_unit(cell: str) -> ColumnHead | None:
    """The name and the unit of a header such as ``time_ms``, ``angleDeg`` or ``Time s``."""
    if camel := CAMEL_UNIT.search(cell):
        return ColumnHead(cell[: camel.start()], UNIT_OF.get(camel[1].lower(), "rev/min"), camel[1])
    parts = re.split(r"([_\s.])", cell)
    for count in (4, 3, 2, 1):
        words = parts[-(2 * count - 1) :]
        name = "".join(parts[: -2 * count]) if len(parts) > 2 * count else ""
        if not name or (unit := suffix_of(name, words[::2])) is None:
            continue
        return ColumnHead(name.rstrip(" :,_"), unit, "".join(words))
    return None


def suffix_of(name: str, words: list[str]) -> str | None:
    """The unit that the last words of a name are; None if they are none."""
    if len(words) > 1:
        joined = "_".join(words).lower()
        if joined not in SUFFIX_UNITS:
            return None
        if joined.startswith("n_"):
            return f"N {joined[2:]}"
        return read_unit(joined.replace("_per_", "/").replace("_2", "2").replace("_", "/"))
    word = words[0]
    if word.lower() in ("s", "h", "min") and words_of(name) & TIME_WORDS:
        return word.lower()
    known = UNIT_OF.get(word.lower()) or WHOLE_UNITS.get(word.lower())
    if known is None or word in ("nm", "u", "U", "in", "tr", "gr", "min", "turn", "turns"):
        return None
    if word.lower() not in SHORT_WORDS:
        return known
    if word == "m" and name.lower() in ("x", "y", "z", "r", "pos", "position", "length"):
        return "m"
    return None


@lru_cache(4096)
def words_of(name: str) -> frozenset[str]:
    """The words of a name, in lower case; also the name as a whole.

    >>> sorted(words_of("Angular Velocity2")), sorted(words_of("header.stamp"))
    (['angular', 'angular velocity2', 'velocity'], ['header', 'header.stamp', 'stamp'])
    """
    name = NUMBER_OF_NAME.sub("", name)
    spaced = re.sub(r"(?<=[a-zß-ÿ])(?=[A-Z])", " ", name)
    words = re.findall(r"[^\W\d_]+", spaced.lower())
    return frozenset((*words, name.lower().strip()))


def is_time_name(name: str) -> bool:
    """Whether a column of this name has times.

    >>> [is_time_name(name) for name in ("Tiempo", "X_Value", "__time", "%time", "theta")]
    [True, True, True, True, False]
    """
    words = words_of(name)
    return bool(words & TIME_WORDS) and not words & (ANGLE_WORDS | RATE_WORDS)


def is_frame_name(name: str) -> bool:
    """Whether a column of this name counts rows."""
    return bool(words_of(name) & FRAME_WORDS) or name.strip() == "#"


def is_angle_name(name: str) -> bool:
    """Whether a column of this name has an angle.

    >>> [is_angle_name(name) for name in ("theta2", "Angular Velocity2", "crank angle", "x")]
    [True, False, True, False]
    """
    words = words_of(name)
    return bool(words & ANGLE_WORDS) and not words & RATE_WORDS


def says_clockwise(text: str) -> bool:
    """Whether a text says that something counts in the direction of the hands of a clock.

    >>> [says_clockwise(t) for t in ("theta_cw", "angle (CCW)", "counter-clockwise", "clockwise")]
    [True, False, False, True]
    """
    words = re.findall(r"[^\W\d_]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text).lower())
    for k, word in enumerate(words):
        if word in CLOCKWISE_WORDS and not COUNTER_WORDS & set(words[max(k - 2, 0) : k]):
            return True
    return False


def without_clockwise(text: str) -> str:
    """A name without the words for the direction, or the name if it has no others.

    >>> without_clockwise("theta_cw"), without_clockwise("CW")
    ('theta', 'CW')
    """
    return without_direction(text) or text


def without_direction(text: str) -> str:
    """A text without the words for the direction of the hands of a clock.

    >>> without_direction("deg, positive clockwise"), without_direction("cw")
    ('deg', '')
    """
    words = "|".join(CLOCKWISE_WORDS)
    pattern = rf"(?:[\s_,;.-]|\bim\b|\bpositive\b)*(?<![^\W\d_])({words})(?![^\W\d_])"
    left = re.sub(pattern, "", text, flags=re.IGNORECASE)
    return re.sub(r",?\s*\bpositive$", "", left.strip(" _,;.-()[]"), flags=re.IGNORECASE)


def unique(names: list[str]) -> list[str]:
    """Names, each once: a second one gets a number, and one without letters is that of its place.

    >>> unique(["t", "x", "x", ""])
    ['t', 'x', 'x (2)', 'column 4']
    """
    seen: Counter[str] = Counter()
    found: list[str] = []
    for k, name in enumerate(names):
        name = name or f"column {k + 1}"
        seen[name] += 1
        full = f"{name} ({seen[name]})" if seen[name] > 1 else name
        while full in found:
            full += "'"
        found.append(full)
    return found
