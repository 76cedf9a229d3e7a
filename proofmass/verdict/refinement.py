"""`[refine]` of a sidecar: runs with several numbers of segments, their order and their limit."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from proofmass.base.strict import Kind
from proofmass.base.units import si_unit
from proofmass.base.worker import call_isolated
from proofmass.case.case import Case, Refine
from proofmass.sim.engines import computes_curves
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.comparison import Comparison, Comparisons
from proofmass.verdict.outcome import Outcome, judge_error

RunResult = tuple[list[Comparison], Curves | None]
"""The comparisons of a run, and its curves if it did not fail."""


@dataclass(frozen=True)
class RefinedRow:
    """One channel of one solver with one number of segments.

    Attributes
    ----------
    case, solver, segments, channel, unit
        The case, the solver, the number of segments, the channel and its unit.
    error : float
        Largest difference from the reference [its unit].
    end : float
        The difference at the last sample, with its sign [its unit].
    x : float
        The x of the last sample [SI].
    seconds, steps
        Cost of the run: processor time [s], and number of steps.
    """

    case: str
    solver: str
    segments: int
    channel: str
    unit: str
    error: float
    end: float
    x: float
    seconds: float
    steps: int


@dataclass(frozen=True)
class RefinementStudy:
    """The runs of one solver of a case, by numbers of segments."""

    case: Case
    refine: Refine
    solver: str
    runs: dict[int, RunResult] = field(default_factory=dict)

    def add(self, segments: int, found: RunResult) -> tuple[list[RefinedRow], list[Comparison]]:
        """Add a run; with the last run the rows and verdicts of all, before it none."""
        self.runs[segments] = found
        if len(self.runs) < len(self.refine.segments):
            return [], []
        limits = self.case.run[self.refine.run]
        return call_isolated(study_results, self, timeout=limits.timeout, memory=limits.memory)

    def rows(self) -> list[RefinedRow]:
        """The rows of the runs that did not fail, for all channels that the solver delivers."""
        kept = {n: (found, curves) for n, (found, curves) in self.runs.items() if curves}
        if not kept:
            return []
        from proofmass.reference.evaluate import reference_for  # a worker evaluates it

        reference = reference_for(self.case, self.refine.run, max(kept.items())[1][1]).channels
        factors = {name: channel.factor for name, channel in self.case.channels.items()}
        return [
            RefinedRow(
                self.case.name,
                self.solver,
                n,
                c.channel,
                c.unit,
                c.error_max,
                float(curves.channels[c.channel][-1] - reference[c.channel][-1])
                / factors[c.channel],
                float(curves.x[-1]),
                c.seconds,
                c.steps,
            )
            for n, (found, curves) in kept.items()
            for c in found
            if c.channel in curves.channels
        ]


def study_results(study: RefinementStudy) -> tuple[list[RefinedRow], list[Comparison]]:
    """Rows and verdicts of a complete study, for a worker, since the reference is evaluated."""
    rows = study.rows()
    return rows, judge_study(study, rows)


class FinerRun(NamedTuple):
    """A run of a case with a number of segments for all rods, and the study that it belongs to."""

    case: Case
    kind: Kind
    solver: str
    segments: int
    study: RefinementStudy


def refinement_runs(case: Case) -> Iterator[FinerRun]:
    """The runs that ``[refine]`` asks for, solver by solver; none if a case has no such table."""
    if refine := case.refine:
        run = refine.sampled(case.run[refine.run])
        for solver in filter(computes_curves, run.solvers):
            study = RefinementStudy(case, refine, solver)
            for n in refine.segments:
                finer = case.with_segments(dict.fromkeys(case.rod, n))
                finer = finer.model_copy(update={"run": {refine.run: run}})
                yield FinerRun(finer, refine.run, solver, n, study)


def refined_errors(case: Case, run: Kind, solver: str, curves: Curves) -> Comparisons:
    """The comparisons of one run of a study: refined channels only, without detectable changes."""
    from proofmass.reference.evaluate import reference_for
    from proofmass.verdict.compare import compare_channel, mechanism_sizes

    reference = reference_for(case, run, curves).channels
    sizes = mechanism_sizes(case, run, curves)
    return Comparisons(
        compare_channel(case, run, solver, name, curves, reference[name], {}, sizes=sizes)
        for name in case.channels_of(run)
        if case.refine and case.refine.covers(name)
    )


def observed_order(coarse: RefinedRow, fine: RefinedRow, error_floor: float = 0.0) -> float:
    """The order by the errors of two numbers of segments; NaN if one is at the error floor.

    >>> one, two = (RefinedRow("", "", n, "x", "m", 4 / n**2, 0.0, 1.0, 0.0, 0) for n in (2, 4))
    >>> observed_order(one, two), observed_order(one, two, error_floor=0.3)
    (2.0, nan)
    """
    if not np.minimum(coarse.error, fine.error) > error_floor:
        return float("nan")
    return float(np.log(coarse.error / fine.error) / np.log(fine.segments / coarse.segments))


def extrapolated_error(coarse: RefinedRow, fine: RefinedRow, order: float) -> float:
    """The error at the last sample of the limit that is extrapolated from two numbers of segments.

    >>> one, two = (RefinedRow("", "", n, "x", "m", 0.0, 4 / n**2 + 16 / n**4, 1.0, 0.0, 0)
    ...             for n in (2, 4))
    >>> extrapolated_error(one, two, order=2.0)
    -0.25
    """
    ratio = (fine.segments / coarse.segments) ** order
    return fine.end + (fine.end - coarse.end) / (ratio - 1.0)


def judge_study(study: RefinementStudy, rows: list[RefinedRow]) -> list[Comparison]:
    """Verdicts on a complete study, as comparisons of a run called "refine".

    For each channel there is a verdict on its order: the error is the largest deviation of a pair
    of runs, at the finer number of segments of this pair.  If the sidecar bounds the limit of a
    length, there is one on its limit: the error is that of the limit at the last sample.
    """
    cost: dict[str, Any] = {
        "case": study.case.name,
        "solver": study.solver,
        "run": "refine",
        "seconds": sum(f[0].seconds for f, _ in study.runs.values()),
        "steps": sum(f[0].steps for f, _ in study.runs.values()),
    }
    for n, (found, curves) in study.runs.items():
        if curves is None:
            return [
                Comparison(
                    **cost,
                    channel="order",
                    unit="",
                    outcome=found[0].outcome,
                    message=f"with {n} segments: {found[0].message}",
                )
            ]
    verdicts = []
    for channel in dict.fromkeys(row.channel for row in rows):
        own = [row for row in rows if row.channel == channel]
        verdicts.append(judge_order(study.refine, own, cost))
        if study.refine.richardson is not None and si_unit(own[0].unit)[0] == "m":
            verdicts.append(judge_limit(study.refine, own, cost))
    return verdicts


def judge_order(refine: Refine, rows: list[RefinedRow], cost: dict[str, Any]) -> Comparison:
    """The verdict on whether the errors of a channel above the floor fall with the given order."""
    fields = {**cost, "channel": f"order of {rows[0].channel}", "unit": ""}
    floor = f"errors up to {refine.error_floor:g} {rows[0].unit} are left to rounding"
    pairs = [
        pair
        for pair in pairwise(rows)
        if not np.minimum(pair[0].error, pair[1].error) <= refine.error_floor
    ]
    if not pairs:
        return Comparison(**fields, message=f"no order shows: {floor}")
    orders = [observed_order(*pair) for pair in pairs]
    deviations = np.abs(np.subtract(orders, refine.order))
    worst = int(np.argmax(deviations))
    outcome, message = judge_error(float(deviations[worst]), refine.within, "", refine.why)
    coarse, fine = pairs[worst]
    if outcome == Outcome.DIFFERS:
        message += f", order {orders[worst]:.3g} from {coarse.segments} to {fine.segments} segments"
    elif len(pairs) < len(rows) - 1:
        message += f"; {floor}"
    return Comparison(
        **fields,
        error_max=float(deviations[worst]),
        at=fine.segments,
        allowed=refine.within,
        outcome=outcome,
        message=message,
    )


def judge_limit(refine: Refine, rows: list[RefinedRow], cost: dict[str, Any]) -> Comparison:
    """The verdict on whether the limit of two runs is the reference at the last sample."""
    coarse, fine = (row for row in rows if row.segments in refine.last)
    allowed = float(refine.richardson or 0.0) / si_unit(fine.unit)[1]
    error = abs(extrapolated_error(coarse, fine, refine.order))
    outcome, message = judge_error(error, allowed, fine.unit, refine.why)
    return Comparison(
        **cost,
        channel=f"limit of {fine.channel}",
        unit=fine.unit,
        error_max=error,
        at=fine.x,
        allowed=allowed,
        outcome=outcome,
        message=message,
    )
