"""A fault: the place of a wrong value in a file, that value, and the right one.

All that is said about a cause, in the terminal, on pages, in JUnit, SARIF and pytest, comes from
here, so that no surface can read it the other way round.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path

from proofmass.base.lines import LineIndex, WrittenValue, key_value
from proofmass.base.units import si_unit, split_quantity
from proofmass.base.wording import format_fitted, format_unit, number
from proofmass.case.case import Case
from proofmass.sim.elements import Number, Source, degrees_of, written_number

FaultValue = float | str
SHOWN_DIGITS = 6
"""Digits of a value in a sentence, unless the wrong and the right one differ in later ones."""
MAX_DIGITS = 17
"""Digits that tell any two floating-point numbers apart."""
FIT_ROUNDING_SHARE = 1e-9
"""Share of a fitted value below which its digits are rounding of the fit."""


@dataclass(frozen=True)
class Fault:
    """A wrong value in a file, and the right one.

    Attributes
    ----------
    file : Path
        The sidecar or the model that has the wrong value.
    line : int or None
        Its line; None if the value is not written there, because it is a default.
    name : str
        What it is, such as ``rocker_end x``.
    unit : str
        Unit of both values; empty for texts and pure numbers.
    wrong, right : float or str
        The value in the file, and the value with which the curves agree [`unit`].
    within : float
        How exactly the curves tell the right value [`unit`]: a value farther away would be noticed;
        0 if it was not fitted.
    instead : str
        The line with the right value, to copy; empty if the file does not write the value.
    note : str
        What the change means, such as ``in degrees, not in radians``.
    error : float
        Standard error of the right value, where curves have noise [`unit`].
    written : str
        The line as it is; empty where `instead` is.
    """

    file: Path
    line: int | None
    name: str
    unit: str
    wrong: FaultValue
    right: FaultValue
    within: float = 0.0
    instead: str = ""
    note: str = ""
    error: float = 0.0
    written: str = ""

    @property
    def diff(self) -> list[str]:
        """The line as it is and as it should be, with its number; empty without such a line.

        >>> lines = {"instead": "pos=2.5", "written": "pos=2.525"}
        >>> Fault(Path("a.xml"), 33, "x", "m", 2.525, 2.5, **lines).diff
        ['33 - pos=2.525', '33 + pos=2.5']
        """
        return [f"{self.line} - {self.written}", f"{self.line} + {self.instead}"] * bool(
            self.instead
        )

    @property
    def known(self) -> str:
        """How exactly the curves tell the right value: ``± 1e-12 m``; empty if it was not fitted.

        A value farther away would be noticed.
        """
        if not self.within or self.error:
            return ""
        return f"± {number(self.within, 1)} {format_unit(self.unit.removeprefix('1'))}".rstrip()

    @property
    def place(self) -> str:
        """File and line."""
        return self.file.name + (f", line {self.line}" if self.line else "")

    @property
    def values(self) -> tuple[str, str]:
        """The wrong value and the right one with their unit, in digits that tell them apart."""
        wrong, right = format_values(self.wrong, self.right, self.unit)
        if self.error and isinstance(self.right, float):
            unit = format_unit(self.unit.removeprefix("1"))
            right = f"{format_fitted(self.right, self.error)} {unit}".rstrip()
        return wrong, right

    @property
    def change(self) -> str:
        """The change as a row of a table: ``rocker_end x 2.525 m → 2.5 m``."""
        note = f" ({self.note})" if self.note else ""
        return f"{self.name} {' → '.join(self.values)}{note}"

    @property
    def key(self) -> tuple[str, int | None, str, str, str]:
        """What makes two faults the same: place, name and values, to the digits that are shown."""
        return (str(self.file.absolute()), self.line, self.name, *self.values)

    @property
    def remedy(self) -> str:
        """What to do: a sentence with the place, both values, and the line to copy."""
        wrong, right = self.values
        line = f": {self.instead}" if self.instead else ""
        return f"In {self.place}, change {self.name} from {wrong} to {right}{line}"

    def sentence(self, effect: str) -> str:
        """One sentence: the place, the wrong value, the right one, and what it does.

        >>> one = Fault(Path("fourbar.xml"), 33, "rocker_end x", "m", 2.525, 2.5)
        >>> one.sentence("all 64 curves agree")
        'fourbar.xml, line 33: rocker_end x is 2.525 m; with 2.5 m all 64 curves agree'
        """
        note = f" ({self.note})" if self.note else ""
        wrong, right = self.values
        return f"{self.place}: {self.name} is {wrong}; with {right}{note} {effect}"


def format_values(wrong: FaultValue, right: FaultValue, unit: str = "") -> tuple[str, str]:
    """Two values with their unit, in as few digits as tell them apart, but six at least.

    >>> format_values(2.525, 2.5, "m"), format_values(0.0750001, 0.075, "m")
    (('2.525 m', '2.5 m'), ('0.0750001 m', '0.075 m'))
    """
    texts = "", ""
    for digits in range(SHOWN_DIGITS, MAX_DIGITS + 1):
        texts = format_value(wrong, digits), format_value(right, digits)
        if texts[0] != texts[1]:
            break
    shown = format_unit(unit.removeprefix("1"))
    return f"{texts[0]} {shown}".rstrip(), f"{texts[1]} {shown}".rstrip()


def format_value(value: FaultValue, digits: int) -> str:
    """A value with a number of significant digits; a text as it is."""
    return value if isinstance(value, str) else f"{value:.{digits}g}"


def shortest_within(value: float, within: float) -> float:
    """The number with the fewest digits that is no farther from a value than `within`.

    People write numbers with few digits; a fit gives one with sixteen.

    >>> shortest_within(2.5000000003, 1e-9), shortest_within(2.43749, 2e-5)
    (2.5, 2.4375)
    >>> shortest_within(-5e-14, 1e-11)
    0.0
    """
    if abs(value) <= within:
        return 0.0
    for digits in range(1, MAX_DIGITS):
        found = float(f"{value:.{digits}g}")
        if abs(found - value) <= within:
            return found
    return value


def count_digits(value: float) -> int:
    """The number of significant digits of a value, of those that are shown.

    >>> count_digits(2.5), count_digits(-2.525), count_digits(100.0)
    (2, 4, 1)
    """
    return (
        len(
            f"{value:.{SHOWN_DIGITS - 1}e}".lstrip("-")
            .partition("e")[0]
            .rstrip("0.")
            .replace(".", "")
        )
        or 1
    )


def sidecar_fault(
    case: Case,
    keys: list[str],
    name: str,
    wrong: FaultValue,
    right: FaultValue,
    unit: str = "",
    within: float = 0.0,
    note: str = "",
) -> Fault:
    """The fault of a key of the sidecar."""
    written = key_value(LineIndex(), case.file, keys)
    text = json.dumps(right) if isinstance(right, str) else repr(right)
    if isinstance(right, float) and right == int(right) and written and "." not in written.literal:
        text = f"{int(right)}"
    if written and unit and written.literal[:1] in ('"', "'"):  # a number with its unit
        text = json.dumps(f"{text} {unit}", ensure_ascii=False)
    return Fault(
        case.file,
        written.line if written else None,
        name,
        unit,
        wrong,
        right,
        within,
        written.instead(text) if written else "",
        note,
        written=written.line_text if written else "",
    )


def parameter_fault(
    case: Case, key: str, unit: str, wrong: float, right: float, within: float = 0.0
) -> Fault:
    """The fault of a parameter of the reference in the sidecar; `right` is a fitted value.

    Of a quantity that the sidecar writes with a unit all numbers are in that unit.
    """
    keys = ["parameters", key]
    written = key_value(LineIndex(), case.file, keys)
    if written and (parts := split_quantity(written.literal.strip("\"'"))) and parts[1]:
        wrong, unit = parts
        factor = si_unit(unit)[1]
        right, within = right / factor, within / factor
    right = rounded_fit(right, max(within, FIT_ROUNDING_SHARE * abs(wrong)))
    return sidecar_fault(case, keys, key, wrong, right, unit, within)


def model_fault(
    case: Case, source: Source, number: Number, right: float, within: float = 0.0
) -> Fault:
    """The fault of a number of the model, or of a rod in the sidecar; `right` is fitted [SI]."""
    names = {"site": number.of, "gravity": f"gravity {number.of}"}
    name = names.get(number.kind, number.name)
    known = max(within, FIT_ROUNDING_SHARE * abs(number.value))
    right, unit = rounded_fit(right, known), number.unit.removeprefix("1")
    if number.place.tag == "rod":
        keys = ["rod", number.place.rod, number.place.attribute]
        return sidecar_fault(case, keys, name, number.value, right, unit, within)
    written = written_number(source, number.place)
    wrong = number.value
    if degrees_of(source, number.place):
        wrong, right, within = math.degrees(wrong), math.degrees(right), math.degrees(within)
        wrong, right, unit = rounded_fit(wrong, 0.0), rounded_fit(right, within), "deg"
    line, instead = (written.line, instead_of(written, right)) if written else (None, "")
    own = written.line_text if written else ""
    return Fault(case.model_path, line, name, unit, wrong, right, within, instead, written=own)


def instead_of(written: WrittenValue, right: float) -> str:
    """The line of a model with the right value."""
    return written.instead(repr(int(right)) if right == int(right) else repr(right))


def rounded_fit(value: float, within: float) -> float:
    """A fitted value in the digits that the fit knows."""
    return shortest_within(value, max(within, FIT_ROUNDING_SHARE * abs(value)))
