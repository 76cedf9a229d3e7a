"""The page of a case."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, cast

from jinja2 import Environment
from markupsafe import Markup

from proofmass.case import Case
from proofmass.check import Result
from proofmass.compare import Comparison
from proofmass.errors import InputError
from proofmass.mobility import mobility
from proofmass.outcome import CHECKED, LOST
from proofmass.reference import ComparedCurves, properties
from proofmass.report import refinements, tables
from proofmass.report.case_data import PAGE, case_data, embedded, recorded_data, runs_data
from proofmass.report.data import Shown, beyond_limits, drive_units, shown
from proofmass.report.drawing import SECONDS, SHEETS, Charted, Drawings
from proofmass.report.first_screen import (
    advice,
    badge,
    causes,
    looks_of,
    noticed,
    open_lines,
    texts,
)
from proofmass.report.overview import marks, overview
from proofmass.report.page import complaint, faults_of, made_with, slug
from proofmass.report.record import History
from proofmass.report.study import ShownStudy
from proofmass.report.style import Look
from proofmass.report.svg import inline
from proofmass.report.trend import trend_of
from proofmass.report.views import Viewed, all_viewed, caption
from proofmass.report.words import RUNS, closeness, from_model, headline, state_of
from proofmass.wording import format_solver
from proofmass.worker import Crashed, OutOfMemory, TimedOut, isolated


@dataclass(frozen=True)
class Gathered:
    """The runs of a case beside their references, its views, and both as data for the page."""

    runs: list[Shown]
    views: list[Viewed]
    recorded: dict[str, Any]


def render_case(
    env: Environment,
    case: Case,
    result: Result,
    gathered: Gathered,
    drawings: Drawings,
    style: Mapping[str, Look],
    studies: Sequence[ShownStudy] = (),
    history: History | None = None,
) -> str:
    """The text of a case's page; the history ends with this report.

    Where it has more than `PAGE` bytes, more samples of the curves are left out.
    """
    parts = env, case, result, drawings, style, studies, history
    page = rendered(*parts, gathered)
    if (excess := len(page.encode()) - PAGE) > 0:
        runs = gathered.recorded["runs"]
        fewer = runs_data(gathered.runs, max(len(embedded(runs)) - excess, 0))
        page = rendered(*parts, replace(gathered, recorded={**gathered.recorded, "runs": fewer}))
    return page


def rendered(
    env: Environment,
    case: Case,
    result: Result,
    drawings: Drawings,
    style: Mapping[str, Look],
    studies: Sequence[ShownStudy],
    history: History | None,
    gathered: Gathered,
) -> str:
    """The text of a case's page with the curves that were gathered."""
    runs, views = gathered.runs, gathered.views
    faults = faults_of(case, result)
    tell = partial(told, case, beyond_limits(runs))
    rows = [c for run in runs for c in run.rows]
    all_rows = [c for run in runs for c in (*run.rows, *run.verdicts)]
    state = state_of(case, all_rows, faults)
    compared = any(c.outcome in CHECKED for c in rows)
    file = case.file.name if case.file.is_absolute() else case.file
    trend = trend_of(history or History(), case, rows)
    data = case_data(case, gathered.recorded, drawings.motions, style) | {"trend": trend.data}
    return env.get_template("case.html").render(
        case=case,
        state=state,
        headline=headline_of(case, runs, all_rows),
        data=data,
        trend=trend,
        embedded=embedded(data),
        curves=any(run.curves for run in runs),
        badge=badge(case, rows, state, faults),
        closeness=closeness(case, rows),
        overview=overview(data) if rows else [],
        marks=marks(),
        causes=causes(case, result.diagnoses),
        open_lines=open_lines(case, runs),
        advice=advice(case, rows, faults, state),
        command=f"proofmass check {file}",
        explain=f"proofmass explain {file}",
        noticed=tell(noticed, None),
        compared=compared,
        detectable=tables.smallest_changes(case, rows) if compared else [],
        texts=texts(case),
        looks=looks_of(data, style),
        about=made_with(case.file.parent),
        faults=faults,
        parts=[part(run, drawings) for run in runs],
        seen=[
            seen(case, k, view, drawings)
            for k, view in enumerate(views, 1)
            if f"view-{k}" in drawings.figures
        ],
        charts=[charted(case, k, c) for k, c in enumerate(drawings.charts, 1)],
        beside=tell(tables.side_by_side, None) if case.compare_with else None,
        mechanism=mechanism(case, drawings),
        note=drawings.note,
        papers=drawings.papers,
        studied=[(s.title, link) for s in studies if (link := s.of(case))],
        drive_units=tell(drive_units, ["rad or m"] * len(case.drive)),
        parameters=parameters_of(case),
        own_numbers=from_model(case),
        freedoms=tell(mobility, None),
        knowledge=properties_of(case, result, beyond_limits(runs)),
        laws=any(tables.law(case, name) for name in case.channels),
        reasons=tables.reasons(case),
        unnoticed=tables.unnoticed(case, rows) if compared else [],
        not_known=tables.not_known(case, rows) if compared else [],
    )


def gather(result: Result, case: Case) -> Gathered:
    """The runs of a case beside their references, and its views, from a worker.

    Where the references are not there again within the limits of all runs, the runs have no curves.
    """
    own = replace(
        result,
        cases=[case],
        errors=[],
        comparisons=[c for c in result.comparisons if c.case == case.name],
        curves={key: c for key, c in result.curves.items() if key[0] == case.name},
        lost={key: c for key, c in result.lost.items() if key[0] == case.name},
        diagnoses={},
        refined=[row for row in result.refined if row.case == case.name],
    )
    try:
        return cast(
            Gathered,
            isolated(
                gathered_here,
                own,
                timeout=sum(r.timeout * len(r.solvers) for r in case.run.values()),
                memory=max(r.memory for r in case.run.values()),
            ),
        )
    except (InputError, Crashed, TimedOut, OutOfMemory):
        return gathered_here(replace(own, curves={}, lost={}))


def gathered_here(result: Result) -> Gathered:
    """What `gather` does, in this process and of the only case of a result."""
    (case,) = result.cases
    runs = [shown(result, case, kind) for kind in RUNS if kind in case.run]
    return Gathered(runs, all_viewed(case, runs), recorded_data(case, runs))


def told(case: Case, beyond: bool, function: Callable[[Case], Any], otherwise: Any) -> Any:
    """What a function finds out of a case, from a worker.

    Something else where the case is at fault, which the runs have said, or `beyond` its limits.
    """
    if beyond:
        return otherwise
    try:
        return isolated(function, case, timeout=SECONDS)
    except (InputError, Crashed, TimedOut, OutOfMemory):
        return otherwise


def properties_of(case: Case, result: Result, beyond: bool) -> dict[str, str]:
    """What the reference tells of the mechanism: found beside a comparison, or now in a worker."""
    for (name, *_), curves in result.curves.items():
        if (
            name == case.name
            and isinstance(curves, ComparedCurves)
            and curves.properties is not None
        ):
            return curves.properties
    return cast(dict[str, str], told(case, beyond, properties, {}))


def parameters_of(case: Case) -> dict[str, str]:
    """The parameters with their units; nothing when the reference is at fault."""
    try:
        return tables.parameters(case, case.parameters)
    except InputError:
        return {}


def headline_of(case: Case, runs: list[Shown], rows: list[Comparison]) -> str:
    """The verdict on a case in one line, with the time steps of its dynamics."""
    steps = {
        s: float(str(c.settings["timestep"]))
        for run in runs
        if run.kind == "dynamics"
        for s, c in run.curves.items()
        if "timestep" in c.settings
    }
    return headline(case, rows, steps)


def mechanism(case: Case, drawings: Drawings) -> dict[str, Any] | None:
    """The drawing of the mechanism for the page; None if there is none."""
    if "mechanism" not in drawings.figures:
        return None
    stem = f"{slug(case.name)}-mechanism"
    label = f"{case.name}: the mechanism at several poses, its joints and links by name"
    return {"svg": Markup(inline(drawings.figures["mechanism"], stem, label)), "stem": stem}


def seen(case: Case, k: int, view: Viewed, drawings: Drawings) -> dict[str, Any]:
    """Number k of a case's views for its page."""
    stem = f"{slug(case.name)}-view-{k}"
    text = caption(view)
    label = f"{case.name}, {view.view.title}, over {view.over.x_name}: {text}"
    return {
        "svg": Markup(inline(drawings.figures[f"view-{k}"], stem, label)),
        "stem": stem,
        "caption": text,
    }


def charted(case: Case, k: int, chart: Charted) -> dict[str, Any]:
    """Number k of a case's charts for its page, or why it is not drawn."""
    title, stem = case.chart[k - 1].title, f"{slug(case.name)}-chart-{k}"
    if (fault := chart.fault) is not None:
        why = (
            complaint(fault)
            if isinstance(fault, InputError)
            else (f"{type(fault).__name__}: {fault}")
        )
        return {"title": title, "fault": why}
    label = f"{case.name}, {title}, {chart.axes}: {chart.caption}"
    return {
        "svg": Markup(inline(chart.svg, stem, label)),
        "stem": stem,
        "fault": "",
        "caption": chart.caption,
    }


def part(view: Shown, drawings: Drawings) -> dict[str, Any]:
    """All that a page shows of one run."""
    papers = [
        {"what": what, "stem": f"{slug(view.case.name)}-{view.kind}-{what}"}
        for what in SHEETS
        if f"{view.kind}-{what}" in drawings.figures
    ]
    return {
        "kind": view.kind,
        "papers": papers,
        "groups": tables.comparisons(view),
        "extrema": tables.extrema(view.without_lost) if view.without_lost.curves else [],
        "costs": tables.costs(view),
        "missing": tables.missing(view),
        "n": len(view.grid) if view.curves else 0,
        "over": f"{view.x_name} [{view.x_unit}]",
        "stopped": [
            f"{format_solver(s)} ends at {tables.place(view, c.x[-1])}, {len(c.x)} of "
            f"{len(view.grid)} samples, which are kept: "
            f"{c.stopped}"
            for s, c in view.curves.items()
            if c.stopped
        ],
        "lost": [
            f"{format_solver(s)} is {drawn_until(view, s)}: {c.outcome}. {c.message}"
            for s, c in view.lost.items()
        ],
        "what": RUNS[view.kind].heading,
        "refined": refined(view, drawings),
    }


def drawn_until(view: Shown, solver: str) -> str:
    """How far a lost run is drawn."""
    if solver not in view.curves:
        return "not drawn"
    return f"drawn until {tables.place(view, view.curves[solver].x[-1])}"


def refined(view: Shown, drawings: Drawings) -> dict[str, Any] | None:
    """What a page shows of a run's refinement; None if there is none."""
    asked = view.case.refine
    if not view.verdicts or not asked:
        return None
    lost = [
        f"{format_solver(c.solver)} is not refined: {c.outcome}. {c.message}"
        for c in view.verdicts
        if c.outcome in LOST
    ]
    if "refine" not in drawings.figures:
        return {"svg": "", "lost": lost}
    stem, text = f"{slug(view.case.name)}-refine", refinements.caption(asked)
    label = f"{view.case.name}, errors over the number of segments; numbers in the table below"
    return {
        "svg": Markup(inline(drawings.figures["refine"], stem, label)),
        "stem": stem,
        "caption": text,
        "lost": lost,
        "segments": asked.segments,
        "pairs": [f"{a} → {b}" for a, b in pairwise(asked.segments)],
        "table": refinements.table(view, asked),
        "costs": list(refinements.costs(view)),
    }
