"""The page of a case.

Its first screen has panels: the verdict, what to do, why runs differ, and which changes of the
model the runs notice.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

from jinja2 import Environment
from markupsafe import Markup

from proofmass.base.errors import InputError
from proofmass.base.files import encode_text
from proofmass.base.grouping import group_by
from proofmass.base.wording import format_list, format_range_share, number
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut, call_isolated
from proofmass.batch.check import Result
from proofmass.case.case import Case
from proofmass.evidence.coverage import Coverage, stored_coverage
from proofmass.evidence.coverage_search import Finding
from proofmass.evidence.diagnosis import (
    Diagnosis,
    Explanation,
    Fault,
    SharedCause,
    shared_causes,
)
from proofmass.formats.explain import (
    TRIED_SENTENCE,
    format_not_noticed,
    format_not_tried,
    format_reference_coverage,
    format_refusals,
    table_cells,
)
from proofmass.reference.compared_with import compared_with
from proofmass.reference.evaluate import properties
from proofmass.reference.mobility import mobility
from proofmass.reference.reference_curves import ComparedCurves
from proofmass.report import refinements, tables
from proofmass.report.case_data import (
    MAX_PAGE_BYTES,
    case_data,
    recorded_data,
    runs_data,
    script_json,
)
from proofmass.report.case_figures import FIGURE_SECONDS, RUN_FIGURES, Charted, Drawings
from proofmass.report.data import PlottedRun, all_reached_limits, drive_units, plotted_run
from proofmass.report.overview import axis_labels, axis_place, overview_table
from proofmass.report.page import case_facts, case_faults, error_message, slug
from proofmass.report.record import History
from proofmass.report.study import ShownStudy
from proofmass.report.style import BACKGROUNDS, Look, make_legible
from proofmass.report.svg import inline_svg
from proofmass.report.trend import trend_of
from proofmass.report.views import Viewed, apply_views, view_caption
from proofmass.report.words import (
    RUNS,
    START_RATIO,
    case_state,
    format_closeness,
    quantity_kind,
)
from proofmass.sim.engines import format_solver
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.grade import grade_of, worst_unchecked
from proofmass.verdict.outcome import (
    CHECKED_OUTCOMES,
    EMPTY_OUTCOMES,
    FAILED_OUTCOMES,
    GOOD_OUTCOMES,
    UNCHECKED_OUTCOMES,
    Outcome,
)

MAX_SOURCE_CHARACTERS = 200_000  # [characters] of a sidecar or model that a page shows
SHOWN_CAUSES = 3  # number of causes that a panel shows
NOTABLE_RATIO = 2.0
"""Ratio of two errors from which on it is told."""
VISIBLE_GROUPS = 4
"""Number of groups that are visible at once; the others are in a list that opens."""


@dataclass(frozen=True)
class Gathered:
    """The runs of a case with their references, its views, and data of both for the page."""

    runs: list[PlottedRun]
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
    """Render the page of a case; the last report of the history is the present one.

    Where the page has more than `MAX_PAGE_BYTES` bytes, more samples of the curves are left out.
    """
    parts = env, case, result, drawings, style, studies, history
    page = render_page(*parts, gathered)
    if (excess := len(encode_text(page)) - MAX_PAGE_BYTES) > 0:
        runs = gathered.recorded["runs"]
        fewer = runs_data(gathered.runs, max(len(script_json(runs)) - excess, 0))
        page = render_page(*parts, replace(gathered, recorded={**gathered.recorded, "runs": fewer}))
    return page


def render_page(
    env: Environment,
    case: Case,
    result: Result,
    drawings: Drawings,
    style: Mapping[str, Look],
    studies: Sequence[ShownStudy],
    history: History | None,
    gathered: Gathered,
) -> str:
    """Render the page of a case with all data that were gathered, whatever its size."""
    runs, views = gathered.runs, gathered.views
    faults = case_faults(case, result)
    tell = partial(evaluate_in_worker, case, all_reached_limits(runs))
    rows = [c for run in runs for c in run.rows]
    all_rows = [c for run in runs for c in (*run.rows, *run.verdicts)]
    state = case_state(case, all_rows, faults)
    compared = any(c.outcome in CHECKED_OUTCOMES for c in rows)
    file = case.file.name if case.file.is_absolute() else case.file
    trend = trend_of(history or History(), case, rows)
    knowledge = properties_of(case, result, all_reached_limits(runs))
    data = case_data(case, gathered.recorded, drawings.motions, style) | {"trend": trend.data}
    return env.get_template("case.html").render(
        case=case,
        state=state,
        grade=grade_of(rows) if state == "good" else None,
        compared_with=tell(partial(compared_with, properties=knowledge), None),
        data=data,
        trend=trend,
        embedded=script_json(data),
        curves=any(run.curves for run in runs),
        badge=format_badge(case, rows, state, faults, [c for run in runs for c in run.verdicts]),
        closeness=" ".join(filter(None, [format_closeness(case, rows), format_open(rows)])),
        overview=overview_table(data) if rows else [],
        marks=axis_labels(),
        causes=cause_panels(case, result.diagnoses),
        open_lines=list_unchecked(case, runs),
        advice=advice(
            case, rows, faults, state, [d for d in result.diagnoses.values() if d.case == case.name]
        ),
        defaults=compare_defaults(rows),
        command=f"proofmass check {file}",
        explain=f"proofmass explain {file}",
        noticed=tell(load_noticed_panel, None),
        compared=compared,
        detectable=tables.smallest_changes(case, rows) if compared else [],
        texts=source_texts(case),
        looks=looks_of(data, style),
        about=case_facts(case.file.parent),
        faults=faults,
        parts=[run_entry(run, drawings) for run in runs],
        seen=[
            view_entry(case, k, view, drawings)
            for k, view in enumerate(views, 1)
            if f"view-{k}" in drawings.figures
        ],
        charts=[chart_entry(case, k, c) for k, c in enumerate(drawings.charts, 1)],
        beside=tell(tables.compare_parameter_sets, None) if case.compare_with else None,
        mechanism=mechanism_entry(case, drawings),
        note=drawings.note,
        papers=drawings.papers,
        studied=[(s.title, link) for s in studies if (link := s.of(case))],
        drive_units=tell(drive_units, ["rad or m"] * len(case.drive)),
        parameters=parameters_of(case),
        own_numbers=case.reads_model,
        dof=tell(mobility, None),
        knowledge=knowledge,
        reasons=tables.tolerance_rows(case),
        unnoticed=tables.unnoticed_parameters(case, rows) if compared else [],
        not_known=tables.unknown_parameters(case, rows) if compared else [],
    )


def gather_runs(result: Result, case: Case) -> Gathered:
    """Gather the runs of a case with their references, and its views, in a worker.

    Where the worker fails or reaches the limits of the runs, the runs have no curves.
    """
    own = replace(
        result,
        cases=[case],
        errors=[],
        comparisons=[c for c in result.comparisons if c.case == case.name],
        curves={key: c for key, c in result.curves.items() if key[0] == case.name},
        failed={key: c for key, c in result.failed.items() if key[0] == case.name},
        diagnoses={},
        refined=[row for row in result.refined if row.case == case.name],
    )
    try:
        return cast(
            Gathered,
            call_isolated(
                gather_here,
                own,
                timeout=sum(r.timeout * len(r.solvers) for r in case.run.values()),
                memory=max(r.memory for r in case.run.values()),
            ),
        )
    except (InputError, Crashed, TimedOut, OutOfMemory):
        return gather_here(replace(own, curves={}, failed={}))


def gather_here(result: Result) -> Gathered:
    """Gather the runs and views of the only case of a result, in this process."""
    (case,) = result.cases
    runs = [plotted_run(result, case, kind) for kind in RUNS if kind in case.run]
    return Gathered(runs, apply_views(case, runs), recorded_data(case, runs))


def evaluate_in_worker(
    case: Case, beyond: bool, function: Callable[[Case], Any], otherwise: Any
) -> Any:
    """Return the value of a function of a case, evaluated in a worker.

    The value is `otherwise` where the worker fails, because the case is at fault, and where all
    runs reached their limits (`beyond`).
    """
    if beyond:
        return otherwise
    try:
        return call_isolated(function, case, timeout=FIGURE_SECONDS)
    except (InputError, Crashed, TimedOut, OutOfMemory):
        return otherwise


def properties_of(case: Case, result: Result, beyond: bool) -> dict[str, str]:
    """Return the properties of the mechanism by the reference: stored with curves, or computed."""
    for (name, *_), curves in result.curves.items():
        if (
            name == case.name
            and isinstance(curves, ComparedCurves)
            and curves.properties is not None
        ):
            return curves.properties
    return cast(dict[str, str], evaluate_in_worker(case, beyond, properties, {}))


def parameters_of(case: Case) -> dict[str, str]:
    """Return the parameters with their units; none if the reference is at fault."""
    try:
        return tables.format_parameters(case, case.parameters)
    except InputError:
        return {}


def format_open(rows: Sequence[Comparison]) -> str:
    """Format the largest error of the curves that are not checked, if a plot shows it."""
    c = worst_unchecked(rows)
    if c is None:
        return ""
    early = c.relative_to_range >= START_RATIO * c.relative_to_range_later
    return (
        f"Not checked: up to {format_range_share(c.relative_to_range)} ({c.channel}, "
        f"{format_solver(c.solver)} {RUNS[c.run].where}{', at the start' if early else ''})."
    )


def mechanism_entry(case: Case, drawings: Drawings) -> dict[str, Any] | None:
    """Return the drawing of the mechanism for the page; None if there is none."""
    if "mechanism" not in drawings.figures:
        return None
    stem = f"{slug(case.name)}-mechanism"
    label = f"{case.name}: the mechanism at several poses, its joints and links by name"
    return {"svg": Markup(inline_svg(drawings.figures["mechanism"], stem, label)), "stem": stem}


def view_entry(case: Case, k: int, view: Viewed, drawings: Drawings) -> dict[str, Any]:
    """Return view number k of a case for its page: figure, file stem and caption."""
    stem = f"{slug(case.name)}-view-{k}"
    text = view_caption(view)
    label = f"{case.name}, {view.view.title}, over {view.over.x_name}: {text}"
    return {
        "svg": Markup(inline_svg(drawings.figures[f"view-{k}"], stem, label)),
        "stem": stem,
        "caption": text,
    }


def chart_entry(case: Case, k: int, chart: Charted) -> dict[str, Any]:
    """Return chart number k of a case for its page, or why it is not drawn."""
    title, stem = case.chart[k - 1].title, f"{slug(case.name)}-chart-{k}"
    if (fault := chart.fault) is not None:
        why = (
            error_message(fault)
            if isinstance(fault, InputError)
            else (f"{type(fault).__name__}: {fault}")
        )
        return {"title": title, "fault": why}
    label = f"{case.name}, {title}, {chart.axes}: {chart.caption}"
    return {
        "svg": Markup(inline_svg(chart.svg, stem, label)),
        "stem": stem,
        "fault": "",
        "caption": chart.caption,
    }


def run_entry(view: PlottedRun, drawings: Drawings) -> dict[str, Any]:
    """Return all that the page shows of one run."""
    papers = [
        {"what": what, "stem": f"{slug(view.case.name)}-{view.kind}-{what}"}
        for what in RUN_FIGURES
        if f"{view.kind}-{what}" in drawings.figures
    ]
    return {
        "kind": view.kind,
        "papers": papers,
        "groups": tables.comparison_groups(view),
        "extrema": tables.extrema_groups(view.without_failed) if view.without_failed.curves else [],
        "costs": tables.cost_rows(view),
        "missing": tables.missing_channels(view),
        "n": len(view.grid) if view.curves else 0,
        "over": f"{view.x_name} [{view.x_unit}]",
        "stopped": [
            f"{format_solver(s)} ends at {tables.format_place(view, c.x[-1])}, {len(c.x)} of "
            f"{len(view.grid)} samples, which are kept: "
            f"{c.stopped}"
            for s, c in view.curves.items()
            if c.stopped
        ],
        "failed": [
            f"{format_solver(s)} is {format_end(view, s)}: {c.outcome}. {c.message}"
            for s, c in view.failed.items()
        ],
        "what": RUNS[view.kind].heading,
        "refined": refinement_entry(view, drawings),
    }


def format_end(view: PlottedRun, solver: str) -> str:
    """Format how far a failed run is drawn."""
    if solver not in view.curves:
        return "not drawn"
    return f"drawn until {tables.format_place(view, view.curves[solver].x[-1])}"


def refinement_entry(view: PlottedRun, drawings: Drawings) -> dict[str, Any] | None:
    """Return what the page shows of a run's refinement; None if there is none."""
    asked = view.case.refine
    if not view.verdicts or not asked:
        return None
    failed = [
        f"{format_solver(c.solver)} is not refined: {c.outcome}. {c.message}"
        for c in view.verdicts
        if c.outcome in FAILED_OUTCOMES
    ]
    if "refine" not in drawings.figures:
        return {"svg": "", "failed": failed}
    stem, text = f"{slug(view.case.name)}-refine", refinements.caption(asked)
    label = f"{view.case.name}, errors over the number of segments; numbers in the table below"
    return {
        "svg": Markup(inline_svg(drawings.figures["refine"], stem, label)),
        "stem": stem,
        "caption": text,
        "failed": failed,
        "segments": asked.segments,
        "pairs": [f"{a} → {b}" for a, b in pairwise(asked.segments)],
        "table": refinements.table(view, asked),
        "costs": list(refinements.costs(view)),
    }


def looks_of(data: Mapping[str, Any], style: Mapping[str, Look]) -> dict[str, dict[str, Any]]:
    """Return the solvers of a case, from its dict of `case_data`, with their looks on its page."""
    found = {}
    for k, (name, one) in enumerate(data["solvers"].items()):
        engine, _, variant = name.partition(":")
        found[name] = {
            **one,
            "css": f"s{k}",
            "title": format_solver(engine),
            "setting": {"default": "its defaults", "": "as in the model"}.get(variant, variant),
            "light": make_legible(style[name].colour, BACKGROUNDS["light"]),
            "dark": make_legible(style[name].colour, BACKGROUNDS["dark"]),
        }
    return found


def format_badge(
    case: Case,
    rows: list[Comparison],
    state: str,
    faults: list[str],
    orders: Sequence[Comparison] = (),
) -> str:
    """Return the verdict on a case in few words, with its grade where it agrees.

    `orders` are the verdicts on its orders of convergence.
    """
    judged = [c for c in rows if c.outcome in CHECKED_OUTCOMES]
    differs = [c for c in rows if c.outcome == Outcome.DIFFERS]
    coarse = sum(c.outcome == Outcome.UNDECIDED for c in rows)
    failed = dict.fromkeys(c.outcome for c in rows if c.outcome in FAILED_OUTCOMES)
    words = []
    if differs:
        worst = max(finite_share(c) for c in differs)
        by = f", up to {format_range_share(worst, 'the')}" if worst > 0 else ""
        words.append(f"Differs: {len(differs)} of {len(judged)} checked curves{by}")
    if wrong := sum(c.outcome not in GOOD_OUTCOMES for c in orders):
        words.append(f"{wrong} of {len(orders)} orders of convergence not as expected")
    if coarse:
        words.append(f"Undecided: {coarse} of {len(judged)} checked curves")
    words += [
        f"{outcome.capitalize()}: {count} of {len(judged)} checked curves"
        for outcome in EMPTY_OUTCOMES
        if (count := sum(c.outcome == outcome for c in rows))
    ]
    if failed:
        solvers = {(c.run, c.solver) for c in rows if c.outcome in FAILED_OUTCOMES}
        words.append(
            f"{len(solvers)} run{'s' * (len(solvers) > 1)} {format_list(map(str, failed))}"
        )
    if faults:
        words.append("input at fault")
    if words:
        return "✗ " + "; ".join(words)
    if judged:
        grade = grade_of(judged)
        closely = f" {grade.words}" if grade else ""
        return f"✓ Agrees{closely}: all {len(judged)} checked curves"
    return "✗ Nothing is checked" if state == "bad" else "○ Not checked, as the sidecar says"


def finite_share(c: Comparison) -> float:
    """Return an error as a share of its range, 0 where it has none."""
    return c.relative_to_range if math.isfinite(c.relative_to_range) else 0.0


def list_unchecked(case: Case, runs: Iterable[PlottedRun]) -> list[str]:
    """List the channels that no tolerance covers and those that solvers do not deliver."""
    lines = []
    for run in runs:
        where = RUNS[run.kind].where
        lines += [f"{format_line(line)} ({where})" for line in tables.missing_channels(run)]
        for solver in run.solvers:
            own = [c for c in run.rows if c.solver == solver]
            bare = [c.channel for c in own if c.outcome == Outcome.UNCHECKED]
            if not bare:
                continue
            what = "all channels" if len(bare) == len(own) else format_list(bare)
            lines.append(f"{format_solver(solver)} {where}, {what}: shown and not checked.")
    return lines


def format_line(line: str) -> str:
    """Format a line of `tables.missing` with the solver's name as in sentences."""
    solver, comma, rest = line.partition(",")
    return f"{format_solver(solver)}{comma}{rest}"


def advice(
    case: Case,
    rows: list[Comparison],
    faults: list[str],
    state: str,
    diagnoses: Sequence[Diagnosis] = (),
) -> list[str]:
    """List what there is to do beside the corrections that the causes show; empty for nothing.

    What differs is mended by its causes, what failed by its remedies; only other runs get general
    advice.
    """
    causes = shared_causes(diagnoses)
    known = {(d.case, d.run, d.solver) for d in diagnoses if d.found or d.remedies}
    words = [sentence for cause in causes for sentence in cause.further_remedies]
    words += dict.fromkeys(remedy for d in diagnoses for remedy in d.remedies)
    if {c.outcome for c in rows} <= set(UNCHECKED_OUTCOMES) and rows and state == "bad":
        words.append(
            "Give the case a [[tolerance]] that covers a channel, or say unchecked = true."
        )
    if faults or not rows:
        words.append("Mend the input: the message above names the file and the key.")
    return [*words, *general_advice(case, [c for c in rows if key_of(c) not in known])]


def key_of(c: Comparison) -> tuple[str, str, str]:
    """Return the case, run and solver of a comparison."""
    return c.case, c.run, c.solver


def general_advice(case: Case, rows: list[Comparison]) -> list[str]:
    """List what there is to do about runs whose cause is not known."""
    outcomes = {c.outcome for c in rows}
    words = list(
        dict.fromkeys(
            f"{c.message[:1].upper()}{c.message[1:]}." for c in rows if c.outcome in EMPTY_OUTCOMES
        )
    )
    if Outcome.UNDECIDED in outcomes:
        words.append(
            "Record more rows of a curve that is undecided, or rows at the samples of the run: "
            "what lies between its rows is not known as closely as its tolerance asks for."
        )
    if any(c.outcome == Outcome.DIFFERS and c.run != "dynamics" for c in rows):
        words.append(
            "Compare the lengths, masses and signs of the model with the parameters of the case: "
            "without time steps only these, or the meaning of a channel, can differ."
        )
    elif Outcome.DIFFERS in outcomes:
        words.append(
            "Halve the time step and look whether the error falls with the order of the "
            "integrator; proofmass trade does so for all settings."
        )
    for c in {(c.run, c.outcome): c for c in rows}.values():
        words += limit_advice(case, c)
    if outcomes & {Outcome.DIVERGED, Outcome.CRASHED}:
        words.append(
            "Begin with the start pose of a run that fails, then halve its time step; its curves "
            "are drawn until the failure where the engine had any, and the message of the engine "
            "is with the solver below."
        )
    return words


def limit_advice(case: Case, c: Comparison) -> Iterator[str]:
    """Yield what to do about a run that reached its limit of time or of memory."""
    if c.run not in case.run:
        return
    limits = case.run[c.run]
    if c.outcome == Outcome.TIMED_OUT:
        yield (
            f"Give the run more processor time: timeout of [run.{c.run}] is {limits.timeout:g} s; "
            "or make it cheaper, by a longer time step or fewer samples."
        )
    if c.outcome == Outcome.OUT_OF_MEMORY:
        yield (
            f"Give the run more memory: memory of [run.{c.run}] is {limits.memory:g} GiB; or make "
            "the model smaller."
        )


def compare_defaults(rows: list[Comparison]) -> list[str]:
    """List how much larger errors with an engine's defaults are, where a case has both."""
    words = []
    for c in {(c.run, c.solver): c for c in rows}.values():
        engine, _, variant = c.solver.partition(":")
        if variant != "default":
            continue
        own = [r for r in rows if r.run == c.run and quantity_kind(r.unit) == "position"]
        mine, default = (
            max((finite_share(r) for r in own if r.solver == name), default=0.0)
            for name in (engine, c.solver)
        )
        seconds = next((r.seconds for r in own if r.solver == engine), math.nan)
        if not (mine and default > NOTABLE_RATIO * mine):
            continue
        cost = f", in {number(c.seconds / seconds, 2)} of the time" if seconds > 0 else ""
        words.append(
            f"With the defaults of {format_solver(engine)} a position is off by "
            f"{format_range_share(default)}, {float(f'{default / mine:.2g}'):g} times as "
            f"much{cost}."
        )
    return words


def source_texts(case: Case) -> dict[str, str]:
    """Return the text of the sidecar and of the MJCF, by the names of the files."""
    found = {}
    for file in (case.file, case.model_path):
        try:
            found[file.name] = Path(file).read_text(encoding="utf-8-sig")[:MAX_SOURCE_CHARACTERS]
        except (OSError, UnicodeDecodeError):  # reported by the runs already
            continue
    return found


@dataclass(frozen=True)
class CauseRow:
    """One change that was tried as a cause; its place is that of the remaining error [%]."""

    words: str
    fitted: str
    explains: str
    left: str
    place: float


@dataclass(frozen=True)
class CausePanel:
    """What explains the differences of runs, best first, or what happened until a failure.

    Attributes
    ----------
    title : str
    lines : tuple of str
        Sentences below the title.
    where : str
        The runs that the panel is about, as a sentence.
    faults : tuple of Fault
        The wrong values that its file writes, whose lines are shown as they are and as they should
        be.
    rows : tuple of CauseRow
        Causes that were tried, in the first of these runs.
    tried : str
        Kinds of causes that were tried, as a list in words.
    why : str
        The heading above the rows; empty without any.
    """

    title: str
    lines: tuple[str, ...]
    where: str
    faults: tuple[Fault, ...] = ()
    rows: tuple[CauseRow, ...] = ()
    tried: str = ""
    why: str = ""


def cause_panels(
    case: Case, diagnoses: Mapping[tuple[str, str, str], Diagnosis]
) -> list[CausePanel]:
    """Return the panels of causes of a case, for runs that failed and for runs that differ.

    Failed runs with the same diagnosis share a panel, and so do runs with the same first cause.
    """
    own = [found for (name, *_), found in diagnoses.items() if name == case.name]
    failed = [found for found in own if found.failed]
    unknown = [found for found in own if not found.failed and not found.found]
    return [
        *map(cause_panel, own_causes(case, diagnoses)),
        *(
            CausePanel("What happened", lines, format_runs(some))
            for lines, some in group_by(failed, lambda d: d.remarks or (*d.lines,)).items()
        ),
        *(unknown_panel(some) for some in group_by(unknown, lambda d: d.lines[0]).values()),
    ]


def own_causes(
    case: Case, diagnoses: Mapping[tuple[str, str, str], Diagnosis]
) -> list[SharedCause]:
    """Return the causes of a case, with what they explain in all cases that share them."""
    return [one for one in shared_causes(diagnoses.values()) if case.name in one.cases]


def unknown_panel(found: list[Diagnosis]) -> CausePanel:
    """Return the panel of runs whose cause was not found."""
    first, where = found[0], format_runs(found)
    if first.fault:
        return CausePanel("Why it differs was not found out", (first.fault,), where)
    lines = (*first.limits, *first.remarks)
    title = "Cause: none of those that were tried"
    rows, tried = cause_rows(first), format_list(first.tried)
    return CausePanel(title, lines, where, (), rows, tried, f"What was tried: {tried}")


def cause_panel(cause: SharedCause) -> CausePanel:
    """Return the panel of runs with the same first cause; its rows are those of the first run."""
    first = cause.diagnoses[0]
    shown = {line for fault in cause.written_faults for line in fault.diff}
    details = (
        line
        for line in cause.details
        if line not in shown and not line.startswith("next best: ")  # which is in the rows
    )
    others = len(first.causes) - 1
    why = "Why this and nothing else"
    if others > 0:
        why += f": the {'next best explanation' if others == 1 else 'next best explanations'}"
    return CausePanel(
        cause.title,
        (*details, *cause.remarks),
        format_runs([*cause.diagnoses]),
        cause.written_faults,
        cause_rows(first),
        format_list(first.tried),
        why,
    )


def cause_rows(found: Diagnosis) -> tuple[CauseRow, ...]:
    """Return the rows of the causes of a run, and of no change."""
    rows = tuple(cause_row(found, cause) for cause in found.causes[:SHOWN_CAUSES])
    unchanged = CauseRow("nothing changed", "", "", "1", axis_place(1.0))
    return (*rows, unchanged) if rows else ()


def cause_row(diagnosis: Diagnosis, cause: Explanation) -> CauseRow:
    """Return a row of the table of causes."""
    wrong = f", {len(cause.breaks)} wrong" if cause.breaks else ""
    changes = (fault.change for fault in cause.faults)
    return CauseRow(
        ", ".join(changes) or cause.words,
        str(cause.fitted),
        f"{len(cause.explains)} of {len(diagnosis.differing)}{wrong}",
        number(cause.left, 2),
        axis_place(cause.left),
    )


def format_runs(found: list[Diagnosis]) -> str:
    """Format the runs of a panel, with what their first cause explains in each."""
    many = f"The same in {len(found)} runs: " if len(found) > 1 else "In one run: "
    return many + format_list(map(format_run, found)) + "."


def format_run(found: Diagnosis) -> str:
    """Format a run, and how many of its channels its first cause explains."""
    words = f"{format_solver(found.solver)} {RUNS[found.run].where}"
    if not found.causes or found.causes[0].score <= 0:
        return words
    explained, there = len(found.causes[0].explains), len(found.differing)
    return f"{words} ({explained} of {there} curves)"


@dataclass(frozen=True)
class NoticedRow:
    """A number or parameter, and the smallest change of it that a run notices, as text."""

    name: str
    change: str
    share: str
    by: str


@dataclass(frozen=True)
class NoticedPanel:
    """The panel on the coverage of a case.

    Attributes
    ----------
    unnoticed, more : tuple of str
        Groups of numbers of the model that no run notices, with the reason where one is known.
    not_tried : str
        Why no number of the model was tried; empty if they were.
    reads, tried : str
        What the reference reads, and what was tried of the model.
    parameters, numbers : tuple of NoticedRow
        Parameters of the reference and numbers of the model that are noticed, the most sensitive
        first.
    refused : tuple of str
        Numbers whose change makes runs fail or be refused.
    """

    unnoticed: tuple[str, ...]
    more: tuple[str, ...]
    not_tried: str
    reads: str
    tried: str
    parameters: tuple[NoticedRow, ...]
    numbers: tuple[NoticedRow, ...]
    refused: tuple[str, ...]


def load_noticed_panel(case: Case) -> NoticedPanel | None:
    """Return the coverage of a case in its present state; None if it was not computed yet.

    `proofmass explain` computes and stores it.
    """
    with suppress(InputError, OSError):  # `proofmass explain` reports these errors
        found = stored_coverage(case)
        return None if found is None else noticed_panel(case, found)
    return None


def noticed_panel(case: Case, found: Coverage) -> NoticedPanel:
    """Return the panel of a coverage."""
    lines = tuple(format_not_noticed(case, found))
    known = sorted(
        (one for one in found.parameters if one.noticed and not one.refused),
        key=lambda one: one.measure,
    )
    changed = [one for one in found.noticed if not one.refused]
    return NoticedPanel(
        lines[:VISIBLE_GROUPS],
        lines[VISIBLE_GROUPS:],
        format_not_tried(case, found) if found.left_out or not found.numbers else "",
        format_reference_coverage(case, found),
        TRIED_SENTENCE,
        tuple(map(noticed_row, known)),
        tuple(map(noticed_row, changed)),
        tuple(sorted(format_refusals([one for one in found.noticed if one.refused]))),
    )


def noticed_row(one: Finding) -> NoticedRow:
    """Return the row of a number that is noticed."""
    return NoticedRow(*table_cells(one), f"{one.channel}, {one.run}, {format_solver(one.solver)}")
