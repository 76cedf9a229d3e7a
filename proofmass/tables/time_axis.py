"""The x of a table: which column it is, and its times as seconds of one clock.

Times are converted with `decimal`, so that nanoseconds since 1970 keep all their digits.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from itertools import pairwise

from proofmass.tables.cells import is_plain, shown
from proofmass.tables.decisions import Decisions, ImportQuestion
from proofmass.tables.foreign import ForeignColumn, ForeignTable, ImportRule, be, listed
from proofmass.tables.headers import NUMBER_OF_NAME, is_frame_name, is_time_name, words_of
from proofmass.tables.moments import DAY, is_moment, read_moment
from proofmass.tables.unit_words import TIME_UNITS, dimension, read_unit

EPOCH_UNITS = {"s": 0, "ms": 3, "us": 6, "ns": 9}
"""Units of clocks that count since 1970, and the power of ten of their number in a second."""
EARLIEST, LATEST = Decimal(1_000_000_000), Decimal(4_102_444_800)
"""2001-09-09 and 2100-01-01 as seconds since 1970 [s]: a time between them is a date, since no
record of a mechanism lasts for thirty years."""
SAME_CLOCK = Decimal("1e-3")
"""Share of the mean spacing by which two columns of times may differ and show the same clock:
their last digits are rounded."""
RISING_SHARE = 0.9
"""Share of steps of a column of times that do not fall: a table may begin again, or its order may
be mended later."""
TWO_PARTS = re.compile(r"\d+:\d\d")
"""A time of a clock that does not say which of its two parts are seconds."""
LONGEST_ROW_STEP = 1
"""Mean step below which a time with decimals and without a unit is in seconds: in milliseconds or
finer units there would be more than 1000 rows per second, with decimals of these units."""
LONG_RECORD = 1000
"""Whole numbers over which a time without a unit goes, from which on milliseconds are the default:
few records of a mechanism last for 1000 s."""


def find_time(table: ForeignTable, decisions: Decisions) -> ForeignTable:
    """The table with its x first, a time in one clock if it is a time.

    Raises
    ------
    InputError
        No column can be the x, or several can, or its unit is not known.
    """
    table = join_seconds(table)
    if decisions.time:
        x = table.find(decisions.time, "--time")
        table = own_block(table, [c for c in time_candidates(table) if c is not x] + [x], x)
    elif decisions.fps is not None:
        return time_of_rows(table, decisions, decisions.fps)
    else:
        candidates = time_candidates(table)
        if not candidates:
            return without_time(table, decisions)
        table, x = choose_time(table, candidates, decisions)
    return first(as_clock(table, x, decisions), x.name)


def first(table: ForeignTable, name: str) -> ForeignTable:
    """The table with a column in front of all others."""
    x = next(column for column in table.columns if column.name == name)
    rest = tuple(column for column in table.columns if column.name != name)
    if table.columns[0].name != name:
        table = table.corrected(ImportRule.TIME, f"{name} became the first column, the x")
    return replace(table, columns=(x, *rest))


def join_seconds(table: ForeignTable) -> ForeignTable:
    """The table with whole seconds and nanoseconds of a clock in one column, as ROS 2 has them."""
    for seconds, rest in pairwise(table.columns):
        units = seconds.unit or read_unit(seconds.name), rest.unit or read_unit(rest.name)
        if units != ("s", "ns") or not is_split(seconds.cells, rest.cells):
            continue
        joined = tuple(
            f"{whole}.{nano.zfill(9)}" if whole and nano else ""
            for whole, nano in zip(seconds.cells, rest.cells, strict=True)
        )
        name = "time" if read_unit(seconds.name) else seconds.name
        column = replace(seconds, name=name, cells=joined, unit="s")
        columns = tuple(column if c is seconds else c for c in table.columns if c is not rest)
        words = f"seconds and nanoseconds of {seconds.name} are one time"
        return replace(table, columns=columns).corrected(ImportRule.TIME, words)
    return table


def is_split(seconds: Sequence[str], nanoseconds: Sequence[str]) -> bool:
    """Whether cells are whole seconds, and others nanoseconds of less than one.

    >>> is_split(("7", "8"), ("999999999", "4")), is_split(("7", "8"), ("7000000000", "8000000000"))
    (True, False)
    """
    return all(cell.isdigit() or not cell for cell in seconds) and all(
        (cell.isdigit() and len(cell) <= 9) or not cell for cell in nanoseconds
    )


def time_candidates(table: ForeignTable) -> list[ForeignColumn]:
    """The columns that may be the time: by their unit, by their name, or by their cells."""
    found = []
    for column in table.columns:
        clock = any(map(is_moment, column.cells))
        by_name = is_time_name(column.name) and (
            column.unit in ("", "1") or dimension(column.unit) == "s"
        )
        if (clock or by_name or column.unit in TIME_UNITS) and rises(numbers(column)):
            found.append(column)
    named = [column for column in found if is_time_name(column.name)]
    return named or found


def numbers(column: ForeignColumn) -> list[Decimal]:
    """The numbers of a column, of moments the seconds."""
    return [
        moment.seconds if (moment := read_moment(cell)) else Decimal(cell)
        for cell in column.cells
        if cell and (is_plain(cell) or is_moment(cell))
    ]


def rises(values: Sequence[Decimal]) -> bool:
    """Whether values rise or fall from the first to the last, but for a few steps."""
    pairs = list(pairwise(values))
    if not pairs:
        return False
    up = sum(a <= b for a, b in pairs)
    down = sum(a >= b for a, b in pairs)
    return max(up, down) >= RISING_SHARE * len(pairs) and values[0] != values[-1]


def choose_time(
    table: ForeignTable, candidates: list[ForeignColumn], decisions: Decisions
) -> tuple[ForeignTable, ForeignColumn]:
    """Choose one of several columns of times: the first if all show the same clock.

    Raises
    ------
    InputError
        They show different times.
    """
    x, *others = candidates
    if not others:
        return table, x
    different = [c for c in others if not same_clock(x, c)]
    if not different:
        names = [c.name for c in others]
        words = f"{listed(names)} {be(names)} left out: the clock of {x.name}, but for its start"
        return table.corrected(ImportRule.TIME, words).without_columns(names), x
    candidates = sorted(candidates, key=lambda c: not {"header", "stamp"} <= words_of(c.name))
    names = [column.name for column in candidates]
    spans = ", ".join(f"{c.label} from {c.cells[0]} to {c.cells[-1]}" for c in candidates)
    question = ImportQuestion(
        "",
        f"{len(names)} columns may be the time: {spans}",
        "--time {}",
        tuple(names),
        "{} is the time",
    )
    x = table.find(decisions.decide(table.file, question), "--time")
    return own_block(table, candidates, x), x


def own_block(
    table: ForeignTable, candidates: list[ForeignColumn], x: ForeignColumn
) -> ForeignTable:
    """The table with the columns that belong to a time, if each time has its own behind it.

    That is so if the columns of times have one name, as in exports of several clocks.
    """
    others = [c for c in candidates if c.name != x.name]
    if not others or len({NUMBER_OF_NAME.sub("", c.name) for c in candidates}) > 1:
        return table
    names, inside = [], False
    for column in table.columns:
        inside = column.name != x.name and (inside or column in others)
        if inside:
            names.append(column.name)
    words = f"{listed(names)} {be(names)} left out: they have another clock than {x.name}"
    return table.corrected(ImportRule.TIME, words).without_columns(names)


def same_clock(one: ForeignColumn, other: ForeignColumn) -> bool:
    """Whether two columns of times differ by their unit and by a constant only."""
    a, b = numbers(one), numbers(other)
    if len(a) != len(b) or a[0] == a[-1] or b[0] == b[-1]:
        return False
    factor = (a[-1] - a[0]) / (b[-1] - b[0])
    near = SAME_CLOCK * abs(a[-1] - a[0]) / (len(a) - 1)
    return all(
        abs((p - a[0]) - (q - b[0]) * factor) <= near for p, q in zip(a, b, strict=True)
    ) and nice_factor(factor)


def nice_factor(factor: Decimal) -> bool:
    """Whether a ratio is one of two units of time."""
    units = [Decimal(10) ** k for k in (-9, -6, -3, 0, 3, 6, 9)] + [Decimal(60), Decimal(1) / 60]
    return any(abs(factor / unit - 1) < Decimal("1e-6") for unit in units)


def without_time(table: ForeignTable, decisions: Decisions) -> ForeignTable:
    """The table whose times follow from its rows, or whose x is no time.

    Raises
    ------
    InputError
        No column can be the x, and rows per second are not stated.
    """
    frames = [c for c in table.columns if is_frame_name(c.name) and rises(numbers(c))]
    rate = table.rate
    if rate and Decimal(rate) > 0:
        words = f"a line above the table states {rate} rows per second"
        return time_of_rows(table.corrected(ImportRule.FRAMES, words), decisions, Decimal(rate))
    if frames:
        question = ImportQuestion(
            frames[0].name,
            "no column has a time, and this one counts frames; the frames per second are needed",
            "--fps {}",
            (),
            "{} frames per second",
        )
        answer = decisions.decide(table.file, question)
        return time_of_rows(table, decisions, positive(table, answer))
    x = table.columns[0]
    values = numbers(x)
    steps = [b - a for a, b in pairwise(values)]
    if steps and (all(s > 0 for s in steps) or all(s < 0 for s in steps)):
        words = f"no column is a time; {x.label} is the x, which goes from row to row"
        return table.corrected(ImportRule.TIME, words)
    raise table.error(
        "",
        f"no column is a time, and the first one, {x.name}, turns back; name the column of the x, "
        f"--time COLUMN, or give the rows per second, --fps 100; there are: "
        f"{', '.join(table.names)}",
    )


def positive(table: ForeignTable, text: str) -> Decimal:
    """A number of frames per second.

    Raises
    ------
    InputError
        It is no number above 0.
    """
    text = text.strip().replace(",", ".")
    if not is_plain(text) or not Decimal(text) > 0:
        raise table.error("--fps", f"{text!r} is no number above 0")
    return Decimal(text)


def time_of_rows(table: ForeignTable, decisions: Decisions, fps: Decimal) -> ForeignTable:
    """The table with times that follow from numbers of frames, or from its rows.

    Raises
    ------
    InputError
        A number of a frame is missing or not whole.
    """
    frames = next((c for c in table.columns if is_frame_name(c.name) and rises(numbers(c))), None)
    counts = numbers(frames) if frames else [Decimal(k) for k in range(len(table.places))]
    if len(counts) != len(table.places):
        assert frames is not None
        row = next(k for k, cell in enumerate(frames.cells) if not cell)
        raise table.error(f"{table.line(row)}, {frames.name}", "the number of the frame is missing")
    start = counts[0]
    cells = tuple(plain_text((count - start) / fps) for count in counts)
    of = f"the frame numbers {frames.name}" if frames else "the rows"
    words = f"times follow from {of} and {fps} per second"
    if frames and start:
        words += f"; frame {start} is at 0 s"
    names = {*table.names} - {frames.name if frames else ""}
    name = next(n for n in ("t", "time", "t of rows", "time of rows") if n not in names)
    time = ForeignColumn(name, cells, "s", "s")
    rest = tuple(c for c in table.columns if c is not frames)
    return replace(table, columns=(time, *rest)).corrected(ImportRule.FRAMES, words)


def plain_text(value: Decimal) -> str:
    """A number as a text without an exponent, with at most 15 decimals.

    >>> plain_text(Decimal(1) / Decimal(30)), plain_text(Decimal("0.50")), plain_text(Decimal(2))
    ('0.033333333333333', '0.5', '2')
    """
    text = format(round(value, 15), "f")
    return (text.rstrip("0").rstrip(".") if "." in text else text) or "0"


def as_clock(table: ForeignTable, x: ForeignColumn, decisions: Decisions) -> ForeignTable:
    """The table whose x is in a unit, from 0 on if it counts since 1970 or is a time of day."""
    if any(map(is_moment, x.cells)):
        return from_moments(table, x, decisions)
    if x.unit == "1" and is_time_name(x.name):
        x = replace(x, unit="")
    if x.unit and dimension(x.unit) != "s":
        return table
    values = numbers(x)
    unit = stated_unit(x, decisions)
    if since := epoch_unit(values, unit):
        return from_epoch(table, x, since)
    if unit:
        return table.with_column(replace(x, unit=unit))
    step = abs(values[-1] - values[0]) / (len(values) - 1)
    if any(value % 1 for value in values) and step < LONGEST_ROW_STEP:
        words = f"{x.name} has no unit; its decimals show that it is in s"
        return table.with_column(replace(x, unit="s")).corrected(ImportRule.TIME, words)
    span = abs(values[-1] - values[0])
    answers = ("ms", "s", "us", "ns") if span >= LONG_RECORD else ("s", "ms", "us", "ns")
    question = ImportQuestion(
        x.name,
        f"a time without a unit, from {x.cells[0]} to {x.cells[-1]} in steps of {step:.6g}",
        f"--unit {x.name}={{}}",
        answers,
        f"{x.name} is in {{}}",
    )
    return table.with_column(replace(x, unit=decisions.decide(table.file, question)))


def stated_unit(x: ForeignColumn, decisions: Decisions) -> str:
    """The unit of a time by its head or its name, or empty."""
    names = {"millis": "ms", "milliseconds": "ms", "micros": "us", "nanoseconds": "ns"}
    named = [unit for word, unit in names.items() if word in words_of(x.name)]
    seconds = words_of(x.name) & {"seconds", "secs", "sec"}
    return x.unit or (named[0] if named else "s" if seconds else "")


def epoch_unit(values: Sequence[Decimal], unit: str) -> str:
    """The unit of times that count since 1970; empty if they do not.

    >>> epoch_unit([Decimal(1714557600000), Decimal(1714557600005)], "")
    'ms'
    >>> epoch_unit([Decimal(0), Decimal(5)], "ms")
    ''
    """
    for one, power in EPOCH_UNITS.items():
        seconds = values[0] / Decimal(10) ** power
        if unit in ("", one) and EARLIEST <= seconds <= LATEST:
            return one
    return ""


def from_epoch(table: ForeignTable, x: ForeignColumn, unit: str) -> ForeignTable:
    """The table with times since its first row in place of those since 1970."""
    start = next(Decimal(cell) for cell in x.cells if cell)
    power = EPOCH_UNITS[unit]
    cells = tuple(
        format((Decimal(cell) - start).scaleb(-power), "f") if cell else "" for cell in x.cells
    )
    words = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
    return table.with_column(replace(x, cells=cells, unit="s")).corrected(
        ImportRule.EPOCH,
        f"{x.name} counts {words[unit]} since 1970; 0 s is {date_text(start.scaleb(-power))}",
    )


def date_text(seconds: Decimal) -> str:
    """A time since 1970 as a date, to all digits.

    >>> date_text(Decimal("1714557600.125"))
    '2024-05-01T10:00:00.125Z'
    """
    whole = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=int(seconds))
    fraction = format(seconds % 1, "f").partition(".")[2].rstrip("0")
    return f"{whole:%Y-%m-%dT%H:%M:%S}{'.' + fraction if fraction else ''}Z"


def from_moments(table: ForeignTable, x: ForeignColumn, decisions: Decisions) -> ForeignTable:
    """The table with seconds since its first row in place of times of a clock.

    Raises
    ------
    InputError
        A cell is no such time, or dates can be read in two ways that differ.
    """
    read = [read_moment(cell) if cell else None for cell in x.cells]
    for row, (cell, moment) in enumerate(zip(x.cells, read, strict=True)):
        if cell and moment is None:
            raise table.error(
                f"{table.line(row)}, {x.name}", f"{shown(cell)} is no time of a clock"
            )
    if all(TWO_PARTS.fullmatch(cell.strip()) for cell in x.cells if cell):
        raise table.error(
            x.name,
            f"times such as {x.cells[0]!r} may be hours and minutes, or minutes and seconds; write "
            "them with seconds, 0:00:05, or give the rows per second, --fps 100",
        )
    there = [moment for moment in read if moment]
    days = {moment.seconds // DAY for moment in there}
    if len(days) > 1 and any(moment.order == "dmy or mdy" for moment in there):
        raise table.error(
            x.name,
            "the dates may begin with the day or with the month; write them as 2024-05-01",
        )
    start, ahead, last = there[0].seconds, Decimal(0), there[0].seconds
    cells = []
    for moment in read:
        if moment is None:
            cells.append("")
            continue
        if not moment.dated and moment.seconds < last - DAY // 2:
            ahead += DAY
        last = moment.seconds
        cells.append(format(moment.seconds + ahead - start, "f"))
    from_zero = not there[0].dated and start == 0
    words = f"{x.name} has times of a clock"
    words += "" if from_zero else f"; 0 s is {x.cells[0]}"
    words += f"; it passes midnight {ahead // DAY} times" if ahead > DAY else ""
    words += "; it passes midnight" if ahead == DAY else ""
    return table.with_column(replace(x, cells=tuple(cells), unit="s")).corrected(
        ImportRule.EPOCH, words
    )
