"""Write the pages of a trade study: advice, the work-precision diagram, error floors, and tables.

In the diagram each setting is a marker and each convergence series a curve; each kind of error has
a tab.  NaN and infinity are None in the data of a page.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from proofmass.report.style import FIXED_LOOKS, RC, Look  # isort: skip
from matplotlib import rc_context

from proofmass.base.front import nondominated_points
from proofmass.base.grouping import group_by
from proofmass.base.wording import number
from proofmass.report.case_data import finite_or_none
from proofmass.report.figures import save
from proofmass.report.page import slug
from proofmass.report.study import PageWriter, StudyPages, prepare_folder, require_table
from proofmass.report.svg_markers import MARKER_PATHS, Tone, page_tones
from proofmass.sim.engines import NoEngine, engine_of, format_solver
from proofmass.sim.protocol.programs import sidecar_table
from proofmass.studies.record import KIND_UNITS, NAN, StudyRow, read_table
from proofmass.studies.trade.choose import (
    ERROR_MARGIN,
    compare_with_defaults,
    find_floor,
    format_needed_refinement,
    good_settings,
)
from proofmass.studies.trade.figure import (
    LARGEST_DRAWN_ERROR,
    SeriesName,
    has_drawable_error,
    main_parameter,
    other_parameters_figure,
    planned_steps,
    series_letter,
    series_looks,
    series_name,
    step_count,
    trade_figure,
)
from proofmass.studies.trade.noise import (
    explain_busy_machine,
    front_band,
    possible_front,
    tied_settings,
    time_interval,
    usual_spread,
)
from proofmass.studies.trade.orders import is_unexpected
from proofmass.studies.trade.trade import read_verdicts
from proofmass.studies.trade.verdict import Verdict, comparable_settings, pareto_front
from proofmass.studies.trade.words import (
    TIME_UNITS,
    format_floor,
    format_setting,
    format_setting_briefly,
)
from proofmass.verdict.outcome import Outcome

COPIED_FILES = ("trade.csv", "trade.columns.md", "floors.csv", "verdicts.json")
SCRIPTS = ("axes.js", "diagram.js", "trade.js")
DEFAULT_KIND = "position"


def write_trade(folder: Path | str, output: Path | str, home: str = "") -> StudyPages:
    """Write a page for each case of a study, and an index, from the tables of the study alone.

    Parameters
    ----------
    folder : path
        Folder with ``trade.csv`` and ``verdicts.json``, from
        `proofmass.studies.trade.trade.write_study`.
    output : path
        Folder for the pages and copies of the tables; made if it does not exist.
    home : str
        Link to the report that the pages are part of.

    Raises
    ------
    InputError
        There is no study in the folder.
    """
    folder, output = Path(folder), Path(output)
    rows = read_table(require_table(folder, "trade.csv", "trade CASE"))
    verdicts = read_verdicts(require_table(folder, "verdicts.json", "trade CASE"))
    files = prepare_folder(output, (folder / name for name in COPIED_FILES), SCRIPTS)
    pages = PageWriter(output, home, SCRIPTS)
    parts = []
    for (case, run), own in groupby(sorted(rows, key=page_key), key=page_key):
        own_verdicts = [v for v in verdicts if (v.case, v.run) == (case, run)]
        parts.append(write_run_page(list(own), own_verdicts, pages, files))
    index = pages.write(
        "index.html",
        "trade_index.html",
        parts=parts,
        asked=[number(wanted) for wanted in ADVISED_ERRORS],
        margin=ERROR_MARGIN,
        files=files,
        tones=[],
    )
    return StudyPages(index, {one["case"]: one["page"] for one in parts})


def page_key(row: StudyRow) -> tuple[str, str]:
    """The case and the kind of run to which a row belongs; each pair has a page."""
    return row.case, row.run


def write_run_page(
    rows: Sequence[StudyRow], verdicts: Sequence[Verdict], pages: PageWriter, files: list[str]
) -> dict[str, Any]:
    """Write the page of one run of a case; return the data that the index shows of it."""
    case, run = page_key(rows[0])
    stem = f"{slug(case)}-{slug(run)}-trade"
    looks, spread, present_kinds = series_looks(rows), usual_spread(rows), error_kinds(rows)
    colours = page_tones(look.colour for look in looks.values())
    engines = {engine: colours[engine_colour(engine, looks)].css for engine, _ in looks}
    letters = {name: series_letter(look) for name, look in looks.items()}
    write_figures(rows, verdicts, pages.output / "figures" / stem)
    pages.write(
        f"{stem}.html",
        "trade.html",
        page_data(rows, verdicts, looks, colours, spread),
        case=case,
        run=run,
        tones=colours.values(),
        engines=engines,
        kinds=[(kind, KIND_TITLES[kind]) for kind in present_kinds],
        advice={kind: list_advice(rows, verdicts, kind, spread) for kind in present_kinds},
        limits={kind: list(limit_records(verdicts, kind, letters)) for kind in present_kinds},
        margin=ERROR_MARGIN,
        busy=explain_busy_machine(rows),
        series=list(series_records(rows, verdicts, looks, colours)),
        floors=list(floor_records(verdicts, letters)),
        reached=list(reached_records(verdicts, letters)),
        motion=next((v.motion for v in verdicts if v.motion), ""),
        measured=describe_timing(rows),
        figures=[stem, *([f"{stem}-parameters"] if rows_of_other_parameters(rows) else [])],
        files=files,
    )
    return {
        "case": case,
        "run": run,
        "page": f"{stem}.html",
        "prices": list(index_rows(rows, verdicts, spread)),
        "kind": next(iter(present_kinds), DEFAULT_KIND),
        "busy": bool(explain_busy_machine(rows)),
    }


def engine_colour(engine: str, looks: Mapping[SeriesName, Look]) -> str:
    """The colour of an engine: its own if a series has it, else that of its first series."""
    own = [look.colour for name, look in looks.items() if name[0] == engine]
    known = FIXED_LOOKS.get(engine)
    return known.colour if known and known.colour in own else own[0]


def rows_of_other_parameters(rows: Sequence[StudyRow]) -> list[StudyRow]:
    """Settings of series that vary another parameter than the step; empty if none can be drawn."""
    varied = main_parameter(rows)
    others = [row for row in rows if row.varied != varied]
    return (
        others
        if any(has_drawable_error(row, kind) for row in others for kind in KIND_UNITS)
        else []
    )


def write_figures(rows: Sequence[StudyRow], verdicts: Sequence[Verdict], stem: Path) -> None:
    """Save the diagram for papers, and the figure of errors over other parameters, if any."""
    looks, varied = series_looks(rows), main_parameter(rows)
    with rc_context(RC):
        save(trade_figure([row for row in rows if row.varied == varied], verdicts, looks), stem)
        if others := rows_of_other_parameters(rows):
            save(other_parameters_figure(others, looks), stem.with_name(f"{stem.name}-parameters"))


def index_rows(
    rows: Sequence[StudyRow], verdicts: Sequence[Verdict], spread: float
) -> Iterator[list[dict[str, str]]]:
    """Rows of the index, one for each engine.

    For each of `ADVISED_ERRORS`, of the first kind of error, a row has the setting to use, its
    processor time [s], and how many times as long the engine's defaults take.
    """
    kind = next(iter(error_kinds(rows)), "")
    for engine in dict.fromkeys(row.engine for row in rows):
        own = [row for row in rows if row.engine == engine]
        cells = [index_cell(format_solver(engine))]
        for wanted in ADVISED_ERRORS:
            if not (able := good_settings(own, kind, wanted)):
                cells += [index_cell("not reached"), index_cell(), index_cell()]
                continue
            _, ratio = compare_with_defaults(own, able[0], kind, wanted, verdicts)
            tie_count = len(tied_settings(able, able[0], spread))
            cells += [
                index_cell(
                    format_setting_briefly(able[0]),
                    f"tied with {tie_count} more" if tie_count else "",
                ),
                index_cell(number(able[0].seconds, 2)),
                index_cell("never" if ratio == inf else number(ratio, 2)),
            ]
        yield cells


def index_cell(text: str = "", note: str = "") -> dict[str, str]:
    """A cell of the index: a text, and a note below it."""
    return {"text": text, "note": note}


def series_records(
    rows: Sequence[StudyRow],
    verdicts: Iterable[Verdict],
    looks: Mapping[SeriesName, Look],
    colours: Mapping[str, Tone],
) -> Iterator[dict[str, Any]]:
    """The table of each series, with all numbers as text."""
    own_verdicts = list(verdicts)
    for name, look in looks.items():
        own = [row for row in rows if series_name(row) == name]
        yield {
            "letter": series_letter(look),
            "css": colours[look.colour].css,
            "mark": MARKER_PATHS[look.marker],
            "name": name[1],
            "varied": own[0].varied,
            "rows": [table_cells(row, error_kinds(rows)) for row in own],
            "orders": {
                v.kind: (
                    number(v.observed),
                    number(v.expected),
                    is_unexpected(v.observed, v.expected),
                )
                for v in own_verdicts
                if series_name(v) == name
            },
        }


def table_cells(row: StudyRow, kinds: Iterable[str]) -> dict[str, Any]:
    """Cells of the table for one run."""
    return {
        "value": number(row.value),
        "errors": [number(row.errors.get(k, float("nan"))) for k in kinds],
        "violation": number(row.invariants.get("violation", float("nan"))),
        "energy": number(row.invariants.get("energy", float("nan"))),
        "seconds": number(row.seconds),
        "steps": row.steps or "—",
        "repeats": len(row.repeats),
        "outcome": row.outcome,
        "message": row.message,
    }


def floor_records(
    verdicts: Iterable[Verdict], letters: Mapping[SeriesName, str]
) -> Iterator[dict[str, str]]:
    """Error floor of each series that has one, with its cause and the evidence."""
    for v in verdicts:
        if v.floor > 0 and series_name(v) in letters:
            yield {
                "letter": letters[series_name(v)],
                "series": v.series,
                "kind": v.kind,
                "level": number(v.floor, 2),
                "cause": v.cause,
                "evidence": v.evidence,
            }


def reached_records(
    verdicts: Iterable[Verdict], letters: Mapping[SeriesName, str]
) -> Iterator[dict[str, str]]:
    """For each series without error floor how far it came, and where a finer setting is worse."""
    for v in verdicts:
        if (sentence := "; ".join(filter(None, (v.reached, v.worse)))) and series_name(
            v
        ) in letters:
            yield {
                "letter": letters[series_name(v)],
                "series": v.series,
                "kind": v.kind,
                "said": sentence,
            }


def describe_timing(rows: Sequence[StudyRow]) -> str:
    """Describe how the processor times were measured."""
    ran = [row for row in rows if row.repeats]
    machines = ", ".join(dict.fromkeys(row.machine for row in ran if row.machine))
    pinned = sum(row.pinned for row in ran)
    shares = [row.shared for row in ran if row.shared >= 0]
    shared = (
        f", which gave others at most {number(100 * max(shares), 2)} % of its time"
        if shares
        else ""
    )
    loads = [row.load for row in ran if row.load >= 0]
    load = f"; load average {number(min(loads), 2)} to {number(max(loads), 2)}" if loads else ""
    single_runs = sum(len(row.repeats) == 1 for row in ran)
    most = max((len(row.repeats) for row in ran), default=0)
    return (
        f"{len(rows)} settings, {len(rows) - len(ran)} without times. Processor times: least of up "
        f"to {most} in rounds over the settings near the front, {single_runs} of a single run; "
        f"{pinned} of {len(ran)} with a processor of their own{shared}"
        f"{load}. {machines}"
    )


KIND_TITLES = {
    "position": "Position",
    "velocity": "Velocity",
    "acceleration": "Acceleration",
    "force": "Force or torque",
    "energy": "Energy",
}
"""Titles of the tabs by kind of error."""


def page_data(
    rows: Sequence[StudyRow],
    verdicts: Sequence[Verdict],
    looks: Mapping[SeriesName, Look],
    tones: Mapping[str, Tone],
    spread: float,
) -> dict[str, Any]:
    """Data of the diagram of one run of a case.

    Parameters
    ----------
    rows, verdicts : sequence of StudyRow, sequence of Verdict
        The settings of that run, and the verdicts on its series.
    looks : mapping of (str, str) to Look
        The look of each series, from `figure.series_looks`.
    tones : mapping of str to Tone
        Tones of the colours of these looks, for light and dark pages.
    spread : float
        Usual ratio of the longest to the shortest processor time of a setting [1], from
        `noise.usual_spread`.
    """
    names = list(looks)
    return {
        "case": rows[0].case,
        "run": rows[0].run,
        "kinds": [kind_data(rows, verdicts, kind, looks, spread) for kind in error_kinds(rows)],
        "work": "segments" if all(row.varied == "segments" for row in rows) else "time steps",
        "series": [
            series_data(name, look, tones[look.colour], verdicts) for name, look in looks.items()
        ],
        "settings": [
            setting_data(row, rows, names.index(series_name(row)), spread) for row in rows
        ],
        "top": LARGEST_DRAWN_ERROR,
    }


def error_kinds(rows: Sequence[StudyRow]) -> list[str]:
    """Kinds of errors that some row has."""
    return [kind for kind in KIND_UNITS if any(kind in row.errors for row in rows)]


def series_data(
    name: SeriesName, look: Look, tone: Tone, verdicts: Sequence[Verdict]
) -> dict[str, Any]:
    """Names and look of a series, and the order of each kind of error."""
    orders = {
        v.kind: f"order {number(v.observed)}, expected {number(v.expected)}"
        + (" ✗" if is_unexpected(v.observed, v.expected) else "")
        for v in verdicts
        if series_name(v) == name and isfinite(v.observed)
    }
    return {
        "engine": name[0],
        "title": format_solver(name[0]),
        "name": name[1],
        "letter": series_letter(look),
        "css": tone.css,
        "mark": MARKER_PATHS[look.marker],
        "dash": list(look.dash[1]),
        "orders": orders,
    }


def setting_data(
    row: StudyRow, rows: Sequence[StudyRow], series: int, spread: float
) -> dict[str, Any]:
    """Data of the marker of one setting."""
    steps = step_count(row) or planned_steps(row, rows)
    low, stated, high = time_interval(row, spread)
    return {
        "series": series,
        "words": format_setting(row),
        "ran": row.outcome == Outcome.RAN,
        "outcome": f"{row.outcome}: {row.message}" if row.message else str(row.outcome),
        "errors": {
            kind: row.errors[kind]
            for kind in error_kinds(rows)
            if isfinite(row.errors.get(kind, NAN))
        },
        "seconds": [finite_or_none(low), finite_or_none(stated), finite_or_none(high)],
        "time": format_interval(row, spread) if row.seconds > 0 else "",
        "repeats": len(row.repeats),
        "work": finite_or_none(steps) or None,
        "step": f"{number(1e3 * row.step)} ms" if row.step > 0 else "",
        "violation": finite_or_none(row.invariants.get("violation", NAN)),
        "energy": finite_or_none(row.invariants.get("energy", NAN)),
        "load": finite_or_none(row.load),
        "text": text_to_paste(row),
    }


def kind_data(
    rows: Sequence[StudyRow],
    verdicts: Sequence[Verdict],
    kind: str,
    looks: Mapping[SeriesName, Look],
    spread: float,
) -> dict[str, Any]:
    """Fronts and error floors of a kind of error, with numbers in place of settings and series.

    "front" is the front of the shortest processor times; "tied" are further settings that may be on
    it, since their times are uncertain; "band" is the band in which the front lies; "fewest" is the
    front over steps.
    """
    shown = [row for row in rows if has_drawable_error(row, kind)]
    numbers = {id(row): k for k, row in enumerate(rows)}
    best = [numbers[id(row)] for row in pareto_front(shown, kind)]
    possible = [numbers[id(row)] for row in possible_front(shown, kind, spread)]
    stepped = [row for row in comparable_settings(shown, kind) if step_count(row) > 0]
    costs_and_errors = np.array([(step_count(row), row.errors[kind]) for row in stepped]).reshape(
        -1, 2
    )
    names = list(looks)
    return {
        "key": kind,
        "title": KIND_TITLES[kind],
        "front": best,
        "tied": [k for k in possible if k not in best],
        "band": front_band(shown, kind, spread),
        "fewest": [numbers[id(stepped[k])] for k in nondominated_points(costs_and_errors)],
        "floors": [
            {
                "series": names.index(series_name(v)),
                "level": v.floor,
                "cause": v.cause,
                "evidence": v.evidence,
            }
            for v in verdicts
            if v.kind == kind and v.floor > 0 and series_name(v) in looks
        ],
    }


ADVISED_ERRORS = (1e-3, 1e-5, 1e-7)
"""Errors for which the pages recommend settings, as shares of the range [1]."""


@dataclass(frozen=True)
class Advice:
    """The cheapest setting of one engine for an error, or else its best setting.

    Attributes
    ----------
    engine, tone : str
        Title of the engine, and the CSS class of its colour.
    place : int
        Number of the setting among the rows of the page; -1 if no setting ran.
    reached : bool
        Whether the error is as small as is asked for, with margin.
    setting, error, cost, steps : str
        The setting, its error, its processor time and its number of steps, in words.
    more : tuple of str
        Sentences that compare its cost with the defaults, or say what limits its error.
    tied : str
        Further settings that are good enough and tied with it.
    text : str
        Text to paste.
    """

    engine: str
    tone: str
    place: int
    reached: bool
    setting: str = ""
    error: str = ""
    cost: str = ""
    steps: str = ""
    more: tuple[str, ...] = ()
    tied: str = ""
    text: str = ""


@dataclass(frozen=True)
class AdvisedError:
    """A wanted error, and the advice for each engine, the cheapest first."""

    wanted: str
    engines: tuple[Advice, ...]
    tied: bool
    """Whether the first two engines are tied."""


def list_advice(
    rows: Sequence[StudyRow], verdicts: Sequence[Verdict], kind: str, spread: float
) -> list[AdvisedError]:
    """Advice of each engine for each of `ADVISED_ERRORS`; `spread` is from `noise.usual_spread`."""
    found = []
    for wanted in ADVISED_ERRORS:
        cheapest = dict[str, StudyRow]()
        advice = dict[str, Advice]()
        for engine in dict.fromkeys(row.engine for row in rows):
            own = [row for row in rows if row.engine == engine]
            able = good_settings(own, kind, wanted)
            if able:
                cheapest[engine] = able[0]
                advice[engine] = advise_setting(rows, own, able, kind, wanted, verdicts, spread)
            else:
                advice[engine] = advise_best(rows, own, kind, wanted, verdicts)
        order = sorted(advice, key=lambda name: cheapest[name].cost if name in cheapest else inf)
        first = [time_interval(cheapest[name], spread) for name in order[:2] if name in cheapest]
        found.append(
            AdvisedError(
                number(wanted),
                tuple(advice[name] for name in order),
                len(first) == 2 and first[0].overlaps(first[1]),
            )
        )
    return found


def advise_setting(
    rows: Sequence[StudyRow],
    own: Sequence[StudyRow],
    good: Sequence[StudyRow],
    kind: str,
    wanted: float,
    verdicts: Iterable[Verdict],
    spread: float,
) -> Advice:
    """Advice to use the cheapest of `good`, settings of one engine with a small enough error."""
    row = good[0]
    tied = [format_setting_briefly(one) for one in tied_settings(good, row, spread)]
    words = "; ".join(tied[:MAX_LISTED_TIES]) + (
        f"; and {len(tied) - MAX_LISTED_TIES} more" if tied[MAX_LISTED_TIES:] else ""
    )
    return Advice(
        format_solver(row.engine),
        row.engine,
        row_number(rows, row),
        True,
        format_setting_briefly(row),
        number(row.reached(kind), 2),
        format_interval(row, spread),
        f"{row.steps} steps" if row.steps else "",
        (compare_with_defaults(own, row, kind, wanted, verdicts)[0],),
        words,
        text_to_paste(row),
    )


MAX_LISTED_TIES = 4  # tied settings that are listed by name


def advise_best(
    rows: Sequence[StudyRow],
    own: Sequence[StudyRow],
    kind: str,
    wanted: float,
    verdicts: Sequence[Verdict],
) -> Advice:
    """Advice for an engine without a good enough setting: its best one, and what limits it."""
    ran = [r for r in own if r.outcome == Outcome.RAN and isfinite(r.errors.get(kind, NAN))]
    engine = own[0].engine
    if not ran:
        return Advice(format_solver(engine), engine, -1, False, "no setting ran")
    row = min(ran, key=lambda one: one.errors[kind])
    floor = find_floor(row, kind, verdicts)
    return Advice(
        format_solver(engine),
        engine,
        row_number(rows, row),
        False,
        format_setting_briefly(row),
        number(row.errors[kind], 2),
        f"{number(row.seconds, 2)} s" if row.seconds > 0 else "",
        f"{row.steps} steps" if row.steps else "",
        (format_floor(floor),)
        if floor
        else (format_needed_refinement(ran, kind, wanted, verdicts),),
        "",
        text_to_paste(row),
    )


def row_number(rows: Sequence[StudyRow], row: StudyRow) -> int:
    """Number of a row among rows, found by identity."""
    return next(k for k, one in enumerate(rows) if one is row)


def format_interval(row: StudyRow, spread: float) -> str:
    """Processor time of a setting with its interval, in words.

    >>> row = StudyRow("", "", "", "", "", "", 1.0, seconds=0.01, repeats=(0.01, 0.02))
    >>> format_interval(row, 1.0)
    '10 ms (10 to 20)'
    """
    low, middle, high = time_interval(row, spread)
    unit, factor = next(((u, f) for u, f in TIME_UNITS if middle * f >= 1), TIME_UNITS[-1])
    words = f"{number(middle * factor, 2)} {unit}"
    if not high > low:
        return words
    return f"{words} ({number(low * factor, 2)} to {number(high * factor, 2)})"


def text_to_paste(row: StudyRow) -> str:
    """Text to paste for a setting: in the engine's own form, or else as a table of the sidecar.

    An engine has no form of its own for a setting that lacks parameters which it chooses in a run.

    >>> print(text_to_paste(StudyRow("", "", "", "mujoco", "", "", 1.0, {"timestep": 0.01})))
    <option timestep="0.01"/>
    >>> print(text_to_paste(StudyRow("", "", "", "pymunk", "", "", 1.0, {"timestep": 0.01})))
    # in the sidecar
    [settings.pymunk]
    timestep = 0.01
    """
    parameters = dict(row.parameters)
    if row.step > 0 and "timestep" in parameters:
        parameters["timestep"] = row.step  # the step taken: whole steps from sample to sample
    try:
        engine = engine_of(row.engine)
    except NoEngine:  # the table may come from a machine with other engines
        return sidecar_table(row.engine, parameters)
    own = {}
    if parameters.get("defaults"):
        fields = engine.settings.model_fields
        own = {name: fields[name].default for name in engine.chooses if name in fields}
    text = engine.programs.write_snippet({**own, **parameters}, row.steps)
    return text or sidecar_table(row.engine, parameters)


def limit_records(
    verdicts: Iterable[Verdict], kind: str, letters: dict[tuple[str, str], str]
) -> Iterator[dict[str, str]]:
    """Causes that limit a kind of error, with levels, series, and the evidence of one series."""
    shown = (v for v in verdicts if v.kind == kind and v.floor > 0 and series_name(v) in letters)
    groups = group_by(shown, lambda v: v.cause)
    for cause, own in sorted(groups.items(), key=lambda group: -max(v.floor for v in group[1])):
        own = sorted(own, key=lambda v: v.floor)
        low, high = number(own[0].floor, 2), number(own[-1].floor, 2)
        names = ", ".join(sorted(letters[series_name(v)] for v in own))
        yield {
            "cause": cause,
            "level": low if low == high else f"{low} to {high}",
            "series": f"series {names}",
            "evidence": own[-1].evidence,
            "of": letters[series_name(own[-1])],
        }
