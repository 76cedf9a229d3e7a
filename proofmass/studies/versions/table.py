"""The table of a comparison of versions, for the terminal, for JSON and for a page."""

from collections.abc import Iterator, Sequence
from math import isfinite
from typing import Any

from rich.table import Table

from proofmass.base.grouping import group_by
from proofmass.base.json_values import replace_nonfinite
from proofmass.base.wording import format_count, number
from proofmass.studies.cells import CellResult, format_motion_errors
from proofmass.studies.versions.bisect import VersionSeries
from proofmass.studies.versions.changes import VersionChange
from proofmass.verdict.outcome import Outcome


def change_table(changes: Sequence[VersionChange]) -> Table:
    """A row for each change: the case, where it changed, and its errors before and after."""
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("case", "changed in", "after", "channel", "before", "now", "factor", "moved"):
        right = name in ("before", "now", "factor", "moved")
        table.add_column(name, justify="right" if right else "left", no_wrap=True)
    for one in changes:
        table.add_row(*change_cells(one))
    return table


def change_cells(one: VersionChange) -> tuple[str, ...]:
    """The words of a change, by the columns of its table."""
    changed_in = one.after if one.adjacent else f"{one.after} or between"
    if not one.channel:
        return (
            one.case,
            changed_in,
            one.before,
            "the run",
            outcome_word(one.outcome_before),
            outcome_word(one.outcome_after),
            "",
            "",
        )
    more = f" (and {one.count - 1} of {one.of})" if one.count > 1 else ""
    return (
        one.case,
        changed_in,
        one.before,
        one.channel + more,
        number(one.error_before),
        number(one.error_after),
        "" if one.is_other else format_factor(one.ratio),
        number(one.moved),
    )


def outcome_word(outcome: str) -> str:
    """The word for an outcome of a run in one version."""
    return "refused" if outcome == Outcome.UNSUPPORTED else str(outcome)


def format_factor(ratio: float) -> str:
    """A ratio of errors as a factor.

    >>> format_factor(1 / 22000), format_factor(3.0)
    ('22000 x smaller', '3 x larger')
    """
    if not isfinite(ratio):
        return ""
    size = f"{max(ratio, 1 / ratio):.2g}"
    return f"{float(size):g} x {'larger' if ratio > 1 else 'smaller'}"


def date_lines(changes: Sequence[VersionChange]) -> Iterator[str]:
    """A line for each version in which something changed, the oldest first."""
    for version, own in group_by(changes, lambda one: one.after).items():
        channels = [one for one in own if one.channel and not one.is_other]
        others = [one.moved for one in own if one.is_other]
        runs = [one for one in own if not one.channel]
        parts = []
        for worse in (False, True):
            ratios = [max(o.ratio, 1 / o.ratio) for o in channels if o.is_worse == worse]
            if ratios:
                words = "larger" if worse else "smaller"
                span = (
                    f"{min(ratios):.2g} to {max(ratios):.2g}" if ratios[1:] else f"{ratios[0]:.2g}"
                )
                parts.append(f"errors of {format_count(len(ratios), 'case')} {words}, {span} x")
        if others:
            moved = f"motions of {format_count(len(others), 'model')} moved"
            parts.append(f"{moved}, by {number(max(others))} of the range at most")
        if runs:
            now = sorted(
                {
                    f"{outcome_word(o.outcome_before)}, now {outcome_word(o.outcome_after)}"
                    for o in runs
                }
            )
            parts.append(f"{format_count(len(runs), 'case')} {' or '.join(now)}")
        yield f"changed in {version}: {'; '.join(parts)}"


def result_cell(result: CellResult | None) -> str:
    """What a table of versions shows of a result: its errors, or why there are none."""
    if result is None:
        return ""
    if not result.is_filled:
        return outcome_word(result.outcome)
    return format_motion_errors(result)


def as_data(
    series: Sequence[VersionSeries], changes: Sequence[VersionChange], engine: str
) -> dict[str, Any]:
    """The results as values of JSON."""
    return {
        "engine": engine,
        "versions": list(series[0].versions) if series else [],
        "changes": [replace_nonfinite(vars(one) | {"factor": one.ratio}) for one in changes],
        "results": [result.record() for one in series for _, result in sorted(one.results.items())],
    }
