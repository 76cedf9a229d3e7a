"""The trend of a case: the errors of its channels over the reports of the history."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.report.case_data import encode_numbers
from proofmass.report.changes import CHANGE_FACTOR, ERROR_ROUNDING_SHARE
from proofmass.report.record import History
from proofmass.sim.engines import format_solver
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import CHECKED_OUTCOMES

MIN_REPORTS = 2
"""Least number of reports for a trend."""
NO_ERROR, ZERO_ERROR, STEPS_PER_DECADE = -(2**15), -(2**15) + 1, 1000
"""Whole numbers for no error and for an error of exactly zero, and steps per decade of others."""


@dataclass(frozen=True)
class TrendRow:
    """A channel of a solver in a run: its errors as shares of the range, as text.

    Attributes
    ----------
    run, channel, solver : str
        Run, channel, and the solver's name as in sentences.
    first, before, now, largest, allowed : str
        The errors in the first report, the last one and this one, the largest of all, and the error
        that is allowed now; a dash where there is none.
    growth : str
        Factor by which the error is above or below that of the last report, if more than two.
    """

    run: str
    channel: str
    solver: str
    first: str
    before: str
    now: str
    largest: str
    allowed: str
    growth: str


@dataclass(frozen=True)
class Trend:
    """The part of the history that a page shows.

    Attributes
    ----------
    data : dict
        Data for the script: reports, versions, and channels with their solvers, worst first; empty
        where there are too few reports.
    rows : list of TrendRow
        Worst first, in the order of `trend_order`.
    count : int
        Number of reports of the history, with this one.
    damage : str
        Parts of the history that could not be read.
    """

    data: dict[str, Any]
    rows: list[TrendRow]
    count: int
    damage: str = ""


def trend_of(history: History, case: Case, rows: Iterable[Comparison]) -> Trend:
    """Return the trend of a case; `rows` are the comparisons of the history's last report."""
    there = [
        c
        for c in rows
        if c.channel
        and c.run in case.run
        and sum(value is not None for value in channel_errors(history, c)) >= MIN_REPORTS
    ]
    if len(history.reports) < MIN_REPORTS or not there:
        return Trend({}, [], len(history.reports), history.damage)
    there.sort(key=trend_order, reverse=True)
    curves = dict[tuple[str, str], dict[str, dict[str, str]]]()
    for c in there:
        errors = channel_errors(history, c)
        curves.setdefault((c.run, c.channel), {})[c.solver] = {
            "errors": encode_numbers(encode_errors(errors), "<i2"),
            "growth": format_growth(previous_error(errors), errors[-1]),
        }
    makes = list(dict.fromkeys(tuple(past.versions.items()) for past in history.reports))
    data = {
        "reports": [
            {
                "day": past.day,
                "commit": past.commit[:7],
                "made": makes.index(tuple(past.versions.items())),
            }
            for past in history.reports
        ],
        "versions": [dict(make) for make in makes],
        "channels": [
            {"run": run, "channel": channel, "solvers": solvers}
            for (run, channel), solvers in curves.items()
        ],
        "step": STEPS_PER_DECADE,
    }
    found = [trend_row(c, channel_errors(history, c)) for c in there]
    return Trend(data, found, len(history.reports), history.damage)


def channel_errors(history: History, c: Comparison) -> list[float | None]:
    """Return the errors of a channel in the reports of the history."""
    return history.trend(c.case, c.run, c.solver, c.channel)


def previous_error(errors: list[float | None]) -> float | None:
    """Return the error in the last report before this one that has one."""
    return next((error for error in reversed(errors[:-1]) if error is not None), None)


def trend_order(c: Comparison) -> tuple[bool, float]:
    """Return the sort key of a channel: judged channels by the error over what is allowed."""
    judged = c.outcome in CHECKED_OUTCOMES and c.allowed > 0
    share = c.share_of_allowed if judged else c.relative_to_range
    return judged, share if math.isfinite(share) else math.inf


def encode_errors(errors: Iterable[float | None]) -> np.ndarray:
    """Encode errors as whole numbers of 16 bits, which keep three digits.

    >>> encode_errors([None, 0.0, 1.0, 1e-9]).tolist()
    [-32768, -32767, 0, -9000]
    """
    found = [
        NO_ERROR
        if error is None
        else round(STEPS_PER_DECADE * math.log10(error))
        if error
        else ZERO_ERROR
        for error in errors
    ]
    return np.clip(np.array(found), NO_ERROR, -NO_ERROR - 1).astype("<i2")


def trend_row(c: Comparison, errors: list[float | None]) -> TrendRow:
    """Return a row of the table."""
    known = [error for error in errors if error is not None]
    last = previous_error(errors)
    return TrendRow(
        c.run,
        c.channel,
        format_solver(c.solver),
        number(known[0], 2),
        number(math.nan if last is None else last, 2),
        number(math.nan if errors[-1] is None else errors[-1], 2),
        number(max(known), 2),
        number(c.allowed_of_range, 2),
        format_growth(last, errors[-1]),
    )


def format_growth(last: float | None, now: float | None) -> str:
    """Format the factor between an error and the one before; empty where it is at most two.

    >>> format_growth(1e-6, 1.2e-5), format_growth(1e-6, 1e-7), format_growth(1e-15, 1e-14)
    ('× 12', '÷ 10', '')
    """
    if last is None or now is None or max(last, now) <= ERROR_ROUNDING_SHARE:
        return ""
    if min(last, now) == 0.0:
        return "from 0" if now else "to 0"
    factor = now / last
    if 1 / CHANGE_FACTOR <= factor <= CHANGE_FACTOR:
        return ""
    return f"× {number(factor, 2)}" if factor > 1 else f"÷ {number(1 / factor, 2)}"
