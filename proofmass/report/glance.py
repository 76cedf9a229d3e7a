"""Engines at a glance: families of cases beside engines, with errors, times and refusals."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from proofmass.base.grouping import group_by
from proofmass.report.words import RUNS
from proofmass.sim.engines import computes_curves, format_solver
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.grade import Grade
from proofmass.verdict.outcome import FAILED_OUTCOMES, NOT_RUN_OUTCOMES

DEFAULT = "default"
"""The variant of a solver that has the engine's defaults."""


@dataclass(frozen=True)
class GlanceColumn:
    """An engine with the settings of the models or with its defaults, in one group of runs."""

    group: str
    engine: str
    defaults: bool

    @property
    def title(self) -> str:
        """The engine's name as in sentences."""
        return format_solver(self.engine)

    @property
    def setting(self) -> str:
        """The settings in words."""
        return "its defaults" if self.defaults else "as in the model"


@dataclass(frozen=True)
class GlanceCell:
    """Errors and cost of a family in an engine.

    Attributes
    ----------
    median, worst : float
        Of the largest errors of all curves, as shares of their ranges [1]; NaN without any.
    seconds : float
        Median processor time of a run [s].
    cases, failed, refused : int
        Numbers of cases with curves, of cases with a run that failed, and of cases that the
        engine cannot run.
    """

    median: float
    worst: float
    seconds: float
    cases: int
    failed: int
    refused: int

    @property
    def close(self) -> bool:
        """Whether the median error does not show in a plot."""
        return Grade.of(self.median).close


@dataclass(frozen=True)
class GlanceRow:
    """A family of cases: its name, the value by which the index is filtered, and its cells."""

    name: str
    choice: str
    count: int
    cells: tuple[GlanceCell | None, ...]


@dataclass(frozen=True)
class Glance:
    """The table of families beside engines."""

    columns: tuple[GlanceColumn, ...]
    rows: tuple[GlanceRow, ...]

    @property
    def groups(self) -> dict[str, int]:
        """The groups of runs with their numbers of columns."""
        return {name: len(own) for name, own in group_by(self.columns, lambda c: c.group).items()}


def glance_of(
    families: Mapping[str, tuple[str, Sequence[str]]], comparisons: Iterable[Comparison]
) -> Glance:
    """Return the table; recorded curves are no engine, and columns without curves are left out.

    Parameters
    ----------
    families : mapping of str to (str, sequence of str)
        For each family the value of its filter, and the names of its cases.
    comparisons : iterable of Comparison
    """
    rows = [c for c in comparisons if c.channel and c.run in RUNS and computes_curves(c.solver)]
    by_column = group_by(models_settings(rows), column_of)
    order = {words.group: k for k, words in enumerate(RUNS.values())}
    columns = sorted(
        (one for one, own in by_column.items() if any(map(has_share, own))),
        key=lambda one: (order[one.group], one.engine, one.defaults),
    )
    found = []
    for name, (choice, cases) in families.items():
        there = set(cases)
        cells = [glance_cell([c for c in by_column[one] if c.case in there]) for one in columns]
        if any(cells):
            found.append(GlanceRow(name, choice, len(cases), tuple(cells)))
    return Glance(tuple(columns), tuple(found))


def models_settings(rows: Sequence[Comparison]) -> list[Comparison]:
    """The comparisons of each engine as in the model and with its defaults.

    Other variants count where a run of a case has no settings of the model without a name.
    """
    plain = {(c.case, c.run, c.solver) for c in rows if ":" not in c.solver}
    return [
        c
        for c in rows
        if ":" not in c.solver
        or variant_of(c) == DEFAULT
        or (c.case, c.run, c.solver.partition(":")[0]) not in plain
    ]


def variant_of(c: Comparison) -> str:
    """The name of the settings of a comparison's solver; empty for those of the model."""
    return c.solver.partition(":")[2]


def column_of(c: Comparison) -> GlanceColumn:
    """The column of a comparison."""
    return GlanceColumn(RUNS[c.run].group, c.solver.partition(":")[0], variant_of(c) == DEFAULT)


def has_share(c: Comparison) -> bool:
    """Whether the error of a comparison is a share of a range."""
    return math.isfinite(c.relative_to_range)


def glance_cell(rows: Sequence[Comparison]) -> GlanceCell | None:
    """Return the cell of some comparisons; None without any.

    >>> glance_cell([]) is None
    True
    """
    if not rows:
        return None
    shares = [c.relative_to_range for c in rows if has_share(c)]
    seconds = {(c.case, c.run): c.seconds for c in rows if math.isfinite(c.seconds)}
    by_case = group_by(rows, lambda c: c.case)
    return GlanceCell(
        median(shares) if shares else math.nan,
        max(shares, default=math.nan),
        median(seconds.values()) if seconds else math.nan,
        sum(any(map(has_share, own)) for own in by_case.values()),
        sum(any(c.outcome in FAILED_OUTCOMES for c in own) for own in by_case.values()),
        sum(all(c.outcome in NOT_RUN_OUTCOMES for c in own) for own in by_case.values()),
    )
