"""Times of a clock and dates, as cells have them, to all their digits."""

import re
from dataclasses import dataclass
from datetime import date
from decimal import Decimal
from functools import lru_cache

ISO_DATE = r"(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})"
LOCAL_DATE = r"(?P<a>\d{1,2})[-/.](?P<b>\d{1,2})[-/.](?P<c>\d{4})"
MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
NAMED_DATE = rf"(?P<D>\d{{1,2}})[- ](?P<N>{'|'.join(MONTHS)})[a-z]*[- ](?P<Y>\d{{4}})"
CLOCK = r"(?P<H>\d{1,3}):(?P<M>\d{2})(?::(?P<S>\d{2})(?P<f>[.,:]\d+)?)?\s*(?P<p>[AaPp]\.?[Mm]\.?)?"
MINUTES = re.compile(r"(?P<M>\d{1,3}):(?P<S>\d{2})(?P<f>[.,]\d+)")
"""Minutes and seconds with decimals, as a stopwatch shows them."""
ZONE = r"\s*(?P<z>Z|UTC|GMT|[-+]\d{2}:?\d{2})?"
MOMENT = re.compile(
    rf"(?:(?:{ISO_DATE}|{LOCAL_DATE}|{NAMED_DATE})[T ]+)?{CLOCK}{ZONE}", re.IGNORECASE
)
DAYS = re.compile(r"(?P<n>-?\d+) days?,? (?P<clock>.*)")
"""A duration of days and a time, as pandas writes it."""
DAY = 86400  # [s]


@dataclass(frozen=True)
class ClockTime:
    """A time of a clock.

    Attributes
    ----------
    seconds : Decimal
        Seconds since midnight, or since 1970 if there is a date [s].
    dated : bool
    order : str
        Order of the parts of the date, ``ymd``, ``dmy``, ``mdy``, or ``dmy or mdy``.
    """

    seconds: Decimal
    dated: bool = False
    order: str = ""


def is_moment(cell: str) -> bool:
    """Whether a cell is a time of a clock.

    >>> [is_moment(c) for c in ("2024-05-01T10:00:00.5Z", "10:00", "1:02.5", "1:2", "phi")]
    [True, True, True, False, False]
    """
    return ":" in cell and read_moment(cell) is not None


@lru_cache(8192)
def read_moment(cell: str, order: str = "dmy") -> ClockTime | None:
    """Read a time of a clock; None if a cell is none.

    `order` is that of a date such as ``01/05/2024``, if the date itself does not tell.

    >>> read_moment("10:00:00.005").seconds, read_moment("0 days 00:00:01.25").seconds
    (Decimal('36000.005'), Decimal('1.25'))
    >>> read_moment("02-Jan-1970 00:00:01").seconds
    Decimal('86401.0')
    >>> read_moment("1970-01-02 00:00:00,5").seconds, read_moment("31.12.1970 1:00 PM").order
    (Decimal('86400.5'), 'dmy')
    """
    cell = cell.strip()
    if ":" not in cell:
        return None
    if found := DAYS.fullmatch(cell):
        inner = read_moment(found["clock"])
        return ClockTime(int(found["n"]) * DAY + inner.seconds) if inner else None
    if found := MINUTES.fullmatch(cell):
        return ClockTime(clock_seconds("0", found["M"], found["S"], found["f"], None))
    if (found := MOMENT.fullmatch(cell)) is None:
        return None
    if found["f"] and found["f"].startswith(":"):  # hours, minutes, seconds, and frames
        return None
    seconds = clock_seconds(found["H"], found["M"], found["S"], found["f"], found["p"])
    try:
        days, known = date_of(found, order)
    except ValueError:
        return None
    if not known:
        return ClockTime(seconds)
    return ClockTime(days * DAY + seconds - zone_seconds(found["z"]), True, known)


def clock_seconds(
    hours: str, minutes: str, seconds: str | None, fraction: str | None, half: str | None
) -> Decimal:
    """Seconds of a time of a clock with 24 or 12 hours [s]."""
    hour = int(hours)
    if half:
        hour = hour % 12 + 12 * (half[0] in "Pp")
    whole = hour * 3600 + int(minutes) * 60 + int(seconds or 0)
    return whole + Decimal((fraction or ".0").replace(",", ".").replace(".", "0.", 1))


def date_of(found: re.Match[str], order: str) -> tuple[int, str]:
    """Days since 1970 of a date, and the order of its parts, empty without a date."""
    epoch = date(1970, 1, 1)
    if found["y"]:
        return (date(int(found["y"]), int(found["m"]), int(found["d"])) - epoch).days, "ymd"
    if found["N"]:
        month = MONTHS.index(found["N"].lower()) + 1
        return (date(int(found["Y"]), month, int(found["D"])) - epoch).days, "ymd"
    if not found["a"]:
        return 0, ""
    first, second, year = int(found["a"]), int(found["b"]), int(found["c"])
    known = "dmy" if first > 12 else "mdy" if second > 12 else "dmy or mdy"
    as_told = order if known == "dmy or mdy" else known
    day, month = (first, second) if as_told == "dmy" else (second, first)
    return (date(year, month, day) - epoch).days, known


def zone_seconds(zone: str | None) -> int:
    """How much a zone of time is ahead of Greenwich [s]."""
    if not zone or zone[0] not in "+-":
        return 0
    digits = zone[1:].replace(":", "")
    seconds = int(digits[:2]) * 3600 + int(digits[2:]) * 60
    return -seconds if zone[0] == "-" else seconds
