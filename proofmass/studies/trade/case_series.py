"""A convergence series of a case, and its settings whose errors are examined in further runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isclose, nan

from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.sim.protocol.settings import first_number
from proofmass.sim.protocol.tuning import Perturbation
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import NAN, Setting, StudyRow
from proofmass.studies.trade.disturbed import DisturbedMotion
from proofmass.studies.trade.floor_cause import find_cause
from proofmass.studies.trade.orders import expected_orders, is_unexpected, nearest_order
from proofmass.studies.trade.series import (
    MeasuredSeries,
    find_flat_point,
    find_least_error,
    is_floor,
    observed_order,
    points_before_slowdown,
)
from proofmass.studies.trade.varied import ConvergenceSeries
from proofmass.verdict.outcome import Outcome

SAME_FLOOR_TOLERANCE = 0.01
"""Relative difference of errors of two settings of a case and engine that are at one floor."""


@dataclass
class CaseSeries:
    """A convergence series of one run of a case, with the rows measured so far.

    `examined` has the settings whose errors were examined in further runs, by their numbers.
    """

    case: Case
    run: Kind
    measured: MeasuredSeries
    motion: DisturbedMotion | None = None
    examined: dict[int, "MeasuredSetting"] = field(default_factory=dict)

    @property
    def series(self) -> ConvergenceSeries:
        """The convergence series that is measured."""
        return self.measured.series

    def orders(self, kind: str) -> tuple[float, float]:
        """The observed and the expected order of a kind of error; NaN where none is expected."""
        if not (expected_ones := expected_orders(self.case, self.run, self.series, kind)):
            return nan, nan
        observed_one = observed_order(self.measured.points(kind))
        return observed_one, nearest_order(expected_ones, observed_one)

    def floors(self) -> dict[str, int]:
        """For each kind of error that may be at a floor the number of the setting to examine.

        One setting is examined for all these kinds: the finest one that any of them needs.
        """
        found = {
            kind: self.measured.place(points[k][0])
            for kind in self.measured.kinds
            for points in (self.measured.points(kind),)
            if (k := find_flat_point(points)) is not None
        }
        # At a coarser setting another kind may still fall, so that halvings there would not show
        # its floor.
        last = max(found.values(), default=0)
        return dict.fromkeys(found, last)

    def rising_kinds(self) -> dict[str, int]:
        """Number of the finest setting, for each kind of error that grows at the series' end."""
        return {
            kind: self.measured.place(points[-1][0])
            for kind in self.measured.kinds
            for points in (self.measured.points(kind),)
            if find_least_error(points) is not None
        }

    def unexpected_order_setting(self, kind: str) -> int | None:
        """Number of the finest setting before a floor if the order is not as expected, or None."""
        return (
            self.measured.place(points_before_slowdown(self.measured.points(kind))[-1][0])
            if is_unexpected(*self.orders(kind))
            else None
        )

    def task(self, k: int) -> StudyRun:
        """The run of setting number k."""
        setting = self.series.settings[k]
        return StudyRun(
            self.case,
            self.run,
            setting,
            "trade",
            self.series.name,
            self.series.varied,
            first_number(setting.parameters[self.series.varied]),
            key=self.measured.rows[k].key if k < len(self.measured.rows) else "",
        )

    def row(self, size: float) -> StudyRow:
        """The row of the setting with a size."""
        return self.measured.rows[self.measured.place(size)]

    def setting(self, k: int) -> "MeasuredSetting":
        """Setting number k, with the further runs that examine its errors."""
        return self.examined.setdefault(k, MeasuredSetting(self, k))

    def at_floors(self) -> list["MeasuredSetting"]:
        """The settings that may be at a floor."""
        return [self.setting(k) for k in dict.fromkeys(self.floors().values())]


@dataclass(eq=False)
class MeasuredSetting:
    """A setting of a series, and the further runs that examine its errors.

    Attributes
    ----------
    of : CaseSeries
        The series of the setting.
    k : int
        The number of the setting in its series.
    halved : list of StudyRow
        Rows with half and a quarter of its step, or two and four times its segments.
    perturbed : list of (Perturbation, StudyRow)
        Changes of one possible cause each, with their rows.
    disturbed : mapping of str to float
        How far roundings move its result, by kind of error, as a share of the range [1].
    leader : MeasuredSetting, optional
        The first setting at the same floor, in which causes are changed; the setting itself if
        there is none before it.  None for a setting that is at no floor.
    """

    of: CaseSeries
    k: int
    halved: list[StudyRow] = field(default_factory=list)
    perturbed: list[tuple[Perturbation, StudyRow]] = field(default_factory=list)
    disturbed: Mapping[str, float] = field(default_factory=dict)
    leader: "MeasuredSetting | None" = None

    @property
    def row(self) -> StudyRow:
        """The row of the setting itself."""
        return self.of.measured.rows[self.k]

    @property
    def setting(self) -> Setting:
        """The engine and its parameters."""
        return self.of.series.settings[self.k]

    def is_left_by_halvings(self, kind: str) -> bool:
        """Whether two halvings of the step leave an error, and it is asymptotic."""
        rows = [self.row, *self.halved]
        return is_floor([row.errors.get(kind, NAN) for row in rows if row.outcome == Outcome.RAN])

    @property
    def kinds_at_floor(self) -> set[str]:
        """The kinds of errors that are unchanged by two halvings of the step."""
        return {
            kind
            for kind, at in self.of.floors().items()
            if at == self.k and self.is_left_by_halvings(kind)
        }

    def leads(self, other: "MeasuredSetting") -> bool:
        """Whether another setting of the case and engine is at the floor of this one.

        All kinds of errors that are at a floor in the other one are so in this one too, and are
        equal up to `SAME_FLOOR_TOLERANCE`.
        """
        kinds = other.kinds_at_floor
        return (
            self.of.case is other.of.case
            and self.of.series.engine == other.of.series.engine
            and kinds <= self.kinds_at_floor
            and all(
                isclose(self.row.errors[kind], other.row.errors[kind], rel_tol=SAME_FLOOR_TOLERANCE)
                for kind in kinds
            )
        )

    def cause_of(self, kind: str, at_floor: bool = False) -> tuple[str, str]:
        """The cause of an error among the changed ones, and the evidence; see `find_cause`."""
        return find_cause(self.row.errors[kind], self.perturbed, kind, at_floor)
