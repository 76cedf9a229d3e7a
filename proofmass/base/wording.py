"""Numbers, units and lists as text for people."""

import math
import re
from collections.abc import Callable, Iterable

MJCF_PARTS = re.compile(r'(<\w[^>]*/>|\w+="[^"]*")')
"""An element or an attribute of MJCF in a sentence."""
PLOTTED_SHARE, PLOTTED_TIMES = 1e-3, 2.0
"""Shares of a range from which on an error is given in per cent, and as a multiple."""


def number(value: float, digits: int = 3) -> str:
    """Format a number with `digits` significant digits; NaN as a dash, infinity as ∞.

    >>> number(1.2345e-05), number(361.0), number(0), number(float("nan"))
    ('1.23e-5', '361', '0', '—')
    """
    if not math.isfinite(value):
        return "—" if math.isnan(value) else ("∞" if value > 0 else "-∞")
    if value and not 1e-2 <= abs(value) < 1e5:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        return f"{mantissa}e{int(exponent)}"
    whole = len(str(int(abs(value))))
    return f"{value:.0f}" if whole >= digits and abs(value) >= 1 else f"{value:.{digits}g}"


def format_share(share: float) -> str:
    """Format a share of a range: in per cent where a plot shows it, as a multiple from two on.

    >>> format_share(0.092), format_share(3.2e-5), format_share(44.4)
    ('9.2 %', '3.2e-5', '44 times')
    """
    if share >= PLOTTED_TIMES:
        return f"{number(share, 2)} times"
    return f"{number(100 * share, 2)} %" if share >= PLOTTED_SHARE else number(share, 2)


def format_range_share(share: float, whose: str = "its") -> str:
    """Format an error as a share of the range of its curve.

    >>> format_range_share(0.0237), format_range_share(3e-7), format_range_share(44.0, "the")
    ('2.4 % of its range', '3e-7 of its range', '44 times the range')
    """
    return f"{format_share(share)} {'' if share >= PLOTTED_TIMES else 'of '}{whose} range"


def format_fitted(value: float, error: float) -> str:
    """Format a fitted number with its standard error, of which two digits are shown.

    >>> format_fitted(2.00203, 0.000123), format_fitted(-0.3, 0.012)
    ('2.00203 ± 0.00012', '-0.300 ± 0.012')
    """
    if not (error > 0 and math.isfinite(error)):
        return f"{number(value)} ± {number(error)}"
    digits = max(1 - math.floor(math.log10(error)), 0)
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def format_unit(unit: str) -> str:
    """Format a unit with superscripts and centred dots.

    >>> format_unit("rad/s^2"), format_unit("N m")
    ('rad/s²', 'N·m')
    """
    return unit.replace("^2", "²").replace("^3", "³").replace(" ", "·")


def format_list(words: Iterable[str]) -> str:
    """Format words as a list for a sentence; of more than four words the first three and a count.

    >>> format_list("abc"), format_list("abcdef")
    ('a, b and c', 'a, b, c and 3 more')
    """
    words = list(words)
    if len(words) > 4:
        words = [*words[:3], f"{len(words) - 3} more"]
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def format_count(count: int, noun: str) -> str:
    """A number with its noun.

    >>> format_count(1, "loop"), format_count(2, "body")
    ('1 loop', '2 bodies')
    """
    plural = f"{noun[:-1]}ies" if noun.endswith("y") else f"{noun}s"
    return f"{count} {noun if count == 1 else plural}"


def format_mjcf_parts(text: str, code: Callable[[str], str], rest: Callable[[str], str]) -> str:
    """Format elements and attributes of MJCF in a text by `code`, and what is between by `rest`.

    >>> format_mjcf_parts('damping="1" on joint j', lambda part: f"`{part}`", str.upper)
    '`damping="1"` ON JOINT J'
    """
    parts = MJCF_PARTS.split(text)
    return "".join((code if k % 2 else rest)(part) for k, part in enumerate(parts))
