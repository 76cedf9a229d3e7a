"""Cells of a table: which are empty, and which are numbers, in whatever way they are written."""

import re
from dataclasses import dataclass
from functools import lru_cache

SIGNS = str.maketrans(
    {
        "−": "-",
        "–": "-",
        "\N{NO-BREAK SPACE}": " ",
        "\N{NARROW NO-BREAK SPACE}": " ",
        "\N{THIN SPACE}": " ",
        "\N{FIGURE SPACE}": " ",
        "’": "'",
        "\N{LEFT-TO-RIGHT MARK}": "",
        "\N{ZERO WIDTH NO-BREAK SPACE}": "",
    }
)
"""Signs of typesetting, and those that numbers are written with."""
EMPTY_WORDS = frozenset(
    "nan -nan nan(ind) -nan(ind) na n/a #n/a #na null none - -- --- inf -inf +inf infinity #div/0! "
    "#value! #num! missing 1.#qnan -1.#ind 1.#inf undefined <na> nat ?".split()
) | {""}
"""Words for a value that is not there or not finite, as programs write them."""
ANY_NUMBER = re.compile(r"([-+]?(?:\d[\d.,' _]*|[.,]\d+)(?:[eEdD][-+]?\d{1,3})?)\s*(.*)", re.DOTALL)
"""The beginning of a cell that may be a number, with any signs for decimals and groups, and the
rest, which may be a unit."""
SHOWN_CELL = 40  # letters of a cell that a message shows
PLAIN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?")


@dataclass(frozen=True)
class NumberStyle:
    """How numbers are written.

    Attributes
    ----------
    decimal : str
        The decimal sign.
    group : str
        The sign between groups of three digits; empty if digits are not grouped.
    """

    decimal: str
    group: str = ""

    def plain(self, number: str) -> str | None:
        """A number with a decimal point and without groups; None if it is not in this style.

        >>> NumberStyle(",", ".").plain("1.234,50"), NumberStyle(".").plain("1.234,50")
        ('1234.50', None)
        >>> NumberStyle(",", ".").plain("0.005"), NumberStyle(".").plain("+1.5D-03")
        (None, '1.5E-03')
        """
        if not style_pattern(self).fullmatch(number):
            return None
        text = number.lstrip("+")
        if self.group:
            text = text.replace(self.group, "")
        return text.replace(self.decimal, ".").replace("D", "E").replace("d", "e")

    def grouped(self, number: str) -> bool:
        """Whether the digits of a number in this style are grouped."""
        return bool(self.group) and self.group in number


STYLES = tuple(
    NumberStyle(*signs) for signs in (".", ",", ".,", ",.", ", ", ". ", ".'", ",'", "._")
)
"""Ways to write numbers, the more common ones first."""


@lru_cache
def style_pattern(style: NumberStyle) -> re.Pattern[str]:
    """What a number in a style looks like; a group does not follow a leading zero."""
    d, g = re.escape(style.decimal), re.escape(style.group)
    whole = rf"(?:[1-9]\d{{0,2}}(?:{g}\d{{3}})+|\d{{1,3}})" if style.group else r"\d+"
    return re.compile(rf"[-+]?(?:{whole}{d}?\d*|{d}\d+)(?:[eEdD][-+]?\d{{1,3}})?")


def tidy(cell: str) -> str:
    """A cell without blanks around it, and with the signs of a keyboard."""
    return cell.translate(SIGNS).strip()


def is_empty(cell: str) -> bool:
    """Whether a cell has no value, or none that is finite.

    >>> is_empty(" NaN "), is_empty("0")
    (True, False)
    """
    return cell.strip().lower() in EMPTY_WORDS


def split_number(cell: str) -> tuple[str, str] | None:
    """The number of a cell, in whatever style, and the text behind it; None without a number.

    >>> split_number("0.005 sec"), split_number("-1 234,5"), split_number("Theta2")
    (('0.005', 'sec'), ('-1 234,5', ''), None)
    """
    found = ANY_NUMBER.fullmatch(tidy(cell))
    if found is None:
        return None
    return found[1].strip(), found[2].strip()


def is_plain(cell: str) -> bool:
    """Whether a cell is a number with a decimal point, or a whole one."""
    return PLAIN.fullmatch(cell) is not None


def shown(cell: str) -> str:
    """A cell in a message, cut if it is long.

    >>> shown("0.5"), len(shown("x" * 500)) < 50
    ("'0.5'", True)
    """
    text = " ".join(cell.split())
    return repr(text if len(text) <= SHOWN_CELL else f"{text[:SHOWN_CELL]}..")
