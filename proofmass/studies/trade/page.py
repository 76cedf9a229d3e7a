"""Write the pages of a trade study: advice, the work-precision diagram, error floors, and tables.

In the diagram each setting is a marker and each convergence series a curve; each kind of error has
a tab.  NaN and infinity are None in the data of a page.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context

from proofmass.engines import NoEngine, engine_of
from proofmass.errors import InputError
from proofmass.front import nondominated
from proofmass.outcome import Outcome
from proofmass.report.case_data import finite
from proofmass.report.figures import save
from proofmass.report.page import slug
from proofmass.report.study import Pages, Written, prepared
from proofmass.report.style import KNOWN, RC, Look
from proofmass.report.svg_markers import MARKS, Tone, tones
from proofmass.sim.protocol import ParameterValue
from proofmass.studies.record import KINDS, NAN, Setting, StudyRow, read_table
from proofmass.studies.trade.choose import MARGIN, beside, enough, floor_at, would_need
from proofmass.studies.trade.figure import (
    TOP,
    Name,
    dressed,
    good,
    letter,
    name_of,
    other_parameters_figure,
    planned,
    trade_figure,
    varied_in,
    work,
)
from proofmass.studies.trade.noise import band, busy, interval, perhaps, ties, usual_spread
from proofmass.studies.trade.orders import off
from proofmass.studies.trade.program import snippet
from proofmass.studies.trade.trade import read_verdicts
from proofmass.studies.trade.verdict import Verdict, able, front
from proofmass.studies.trade.words import format_floor, format_setting, format_setting_briefly
from proofmass.wording import format_solver, number

FILES = ("trade.csv", "trade.columns.md", "floors.csv", "verdicts.json")
SCRIPTS = ("axes.js", "diagram.js", "trade.js")
FIRST = "position"


def write_trade(folder: Path | str, output: Path | str, home: str = "") -> Written:
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
    for name in ("trade.csv", "verdicts.json"):
        if not (folder / name).is_file():
            raise InputError(folder / name, "", "no such file; proofmass trade CASE writes it")
    rows, verdicts = read_table(folder / "trade.csv"), read_verdicts(folder / "verdicts.json")
    files = prepared(output, (folder / name for name in FILES), SCRIPTS)
    pages = Pages(output, home, SCRIPTS)
    parts = []
    for (case, run), own in groupby(sorted(rows, key=place), key=place):
        own_verdicts = [v for v in verdicts if (v.case, v.run) == (case, run)]
        parts.append(write_part(list(own), own_verdicts, pages, files))
    index = pages.write(
        "index.html",
        "trade_index.html",
        parts=parts,
        asked=[number(wanted) for wanted in ASKED],
        margin=MARGIN,
        files=files,
        tones=[],
    )
    return Written(index, {one["case"]: one["page"] for one in parts})


def place(row: StudyRow) -> tuple[str, str]:
    """The case and the kind of run to which a row belongs; each pair has a page."""
    return row.case, row.run


def write_part(
    rows: Sequence[StudyRow], verdicts: Sequence[Verdict], pages: Pages, files: list[str]
) -> dict[str, Any]:
    """Write the page of one run of a case; return the data that the index shows of it."""
    case, run = place(rows[0])
    stem = f"{slug(case)}-{run}-trade"
    looks, usual, there = dressed(rows), usual_spread(rows), kinds(rows)
    colours = tones(look.colour for look in looks.values())
    engines = {engine: colours[main_colour(engine, looks)].css for engine, _ in looks}
    letters = {name: letter(look) for name, look in looks.items()}
    write_figures(rows, verdicts, pages.output / "figures" / stem)
    pages.write(
        f"{stem}.html",
        "trade.html",
        page_data(rows, verdicts, looks, colours, usual),
        case=case,
        run=run,
        tones=colours.values(),
        engines=engines,
        kinds=[(kind, TITLES[kind]) for kind in there],
        advice={kind: advised(rows, verdicts, kind, usual) for kind in there},
        limits={kind: list(limited_by(verdicts, kind, letters)) for kind in there},
        margin=MARGIN,
        busy=busy(rows),
        series=list(series_records(rows, verdicts, looks, colours)),
        floors=list(floor_records(verdicts, letters)),
        reached=list(reached(verdicts, letters)),
        motion=next((v.motion for v in verdicts if v.motion), ""),
        measured=measured(rows),
        figures=[stem, *([f"{stem}-parameters"] if other_parameters(rows) else [])],
        files=files,
    )
    return {
        "case": case,
        "run": run,
        "page": f"{stem}.html",
        "prices": list(prices(rows, verdicts, usual)),
        "kind": next(iter(there), FIRST),
        "busy": bool(busy(rows)),
    }


def main_colour(engine: str, looks: Mapping[Name, Look]) -> str:
    """The colour of an engine: its own if a series has it, else that of its first series."""
    own = [look.colour for name, look in looks.items() if name[0] == engine]
    known = KNOWN.get(engine)
    return known.colour if known and known.colour in own else own[0]


def other_parameters(rows: Sequence[StudyRow]) -> list[StudyRow]:
    """Settings of series that vary another parameter than the step; empty if none can be drawn."""
    varied = varied_in(rows)
    others = [row for row in rows if row.varied != varied]
    return others if any(good(row, kind) for row in others for kind in KINDS) else []


def write_figures(rows: Sequence[StudyRow], verdicts: Sequence[Verdict], stem: Path) -> None:
    """Save the diagram for papers, and the figure of errors over other parameters, if any."""
    looks, varied = dressed(rows), varied_in(rows)
    with rc_context(RC):
        save(trade_figure([row for row in rows if row.varied == varied], verdicts, looks), stem)
        if others := other_parameters(rows):
            save(other_parameters_figure(others, looks), stem.with_name(f"{stem.name}-parameters"))


def prices(
    rows: Sequence[StudyRow], verdicts: Sequence[Verdict], usual: float
) -> Iterator[list[dict[str, str]]]:
    """Rows of the index, one for each engine.

    For each of `ASKED`, of the first kind of error, a row has the setting to use, its
    wall time [s], and how many times as long the engine's defaults take.
    """
    kind = next(iter(kinds(rows)), "")
    for engine in dict.fromkeys(row.engine for row in rows):
        own = [row for row in rows if row.engine == engine]
        cells = [cell(format_solver(engine))]
        for wanted in ASKED:
            if not (able := enough(own, kind, wanted)):
                cells += [cell("not reached"), cell(), cell()]
                continue
            said, ratio = beside(own, able[0], kind, wanted, verdicts)
            same = len(ties(able, able[0], usual))
            cells += [
                cell(format_setting_briefly(able[0]), f"tied with {same} more" if same else ""),
                cell(number(able[0].seconds, 2)),
                cell("never" if "never get there" in said else number(ratio, 2)),
            ]
        yield cells


def cell(text: str = "", note: str = "") -> dict[str, str]:
    """A cell of the index: a text, and a note below it."""
    return {"text": text, "note": note}


def series_records(
    rows: Sequence[StudyRow],
    verdicts: Iterable[Verdict],
    looks: Mapping[Name, Look],
    colours: Mapping[str, Tone],
) -> Iterator[dict[str, Any]]:
    """The table of each series, with all numbers as text."""
    own_verdicts = list(verdicts)
    for name, look in looks.items():
        own = [row for row in rows if name_of(row) == name]
        yield {
            "letter": letter(look),
            "css": colours[look.colour].css,
            "mark": MARKS.get(look.marker, MARKS["o"]),
            "name": name[1],
            "varied": own[0].varied,
            "rows": [cells(row, kinds(rows)) for row in own],
            "orders": {
                v.kind: (number(v.observed), number(v.expected), off(v.observed, v.expected))
                for v in own_verdicts
                if name_of(v) == name
            },
        }


def cells(row: StudyRow, kinds: Iterable[str]) -> dict[str, Any]:
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
    verdicts: Iterable[Verdict], letters: Mapping[Name, str]
) -> Iterator[dict[str, str]]:
    """Error floor of each series that has one, with its cause and the evidence."""
    for v in verdicts:
        if v.floor > 0 and name_of(v) in letters:
            yield {
                "letter": letters[name_of(v)],
                "series": v.series,
                "kind": v.kind,
                "level": number(v.floor, 2),
                "cause": v.cause,
                "evidence": v.evidence,
            }


def reached(verdicts: Iterable[Verdict], letters: Mapping[Name, str]) -> Iterator[dict[str, str]]:
    """For each series without error floor how far it came, and where a finer setting is worse."""
    for v in verdicts:
        if (said := "; ".join(filter(None, (v.reached, v.worse)))) and name_of(v) in letters:
            yield {
                "letter": letters[name_of(v)],
                "series": v.series,
                "kind": v.kind,
                "said": said,
            }


def measured(rows: Sequence[StudyRow]) -> str:
    """Describe how the wall times were measured."""
    ran = [row for row in rows if row.repeats]
    machines = ", ".join(dict.fromkeys(row.machine for row in ran if row.machine))
    pinned = sum(row.pinned for row in ran)
    most_shared = max((row.shared for row in ran if row.shared >= 0), default=0.0)
    loads = [row.load for row in ran if row.load >= 0]
    load = f"; load average {number(min(loads), 2)} to {number(max(loads), 2)}" if loads else ""
    once = sum(len(row.repeats) == 1 for row in ran)
    most = max((len(row.repeats) for row in ran), default=0)
    return (
        f"{len(rows)} settings, {len(rows) - len(ran)} without times. Wall times: least of up "
        f"to {most} in rounds over the settings near the front, {once} of a single run; "
        f"{pinned} of {len(ran)} with a processor of their own, which gave others at most "
        f"{number(100 * most_shared, 2)} % of its time{load}. {machines}"
    )


TITLES = {
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
    looks: Mapping[Name, Look],
    tones: Mapping[str, Tone],
    usual: float,
) -> dict[str, Any]:
    """Data of the diagram of one run of a case.

    Parameters
    ----------
    rows, verdicts : sequence of StudyRow, sequence of Verdict
        The settings of that run, and the verdicts on its series.
    looks : mapping of (str, str) to Look
        The look of each series, from `figure.dressed`.
    tones : mapping of str to Tone
        Tones of the colours of these looks, for light and dark pages.
    usual : float
        Usual ratio of the longest to the shortest wall time of a setting [1], from
        `noise.usual_spread`.
    """
    names = list(looks)
    return {
        "case": rows[0].case,
        "run": rows[0].run,
        "kinds": [kind_data(rows, verdicts, kind, looks, usual) for kind in kinds(rows)],
        "work": "segments" if all(row.varied == "segments" for row in rows) else "time steps",
        "series": [
            series_data(name, look, tones[look.colour], verdicts) for name, look in looks.items()
        ],
        "settings": [setting_data(row, rows, names.index(name_of(row)), usual) for row in rows],
        "top": TOP,
    }


def kinds(rows: Sequence[StudyRow]) -> list[str]:
    """Kinds of errors that some row has."""
    return [kind for kind in KINDS if any(kind in row.errors for row in rows)]


def series_data(name: Name, look: Look, tone: Tone, verdicts: Sequence[Verdict]) -> dict[str, Any]:
    """Names and look of a series, and the order of each kind of error."""
    orders = {
        v.kind: f"order {number(v.observed)}, expected {number(v.expected)}"
        + (" ✗" if off(v.observed, v.expected) else "")
        for v in verdicts
        if name_of(v) == name and isfinite(v.observed)
    }
    return {
        "engine": name[0],
        "title": format_solver(name[0]),
        "name": name[1],
        "letter": letter(look),
        "css": tone.css,
        "mark": MARKS.get(look.marker, MARKS["o"]),
        "dash": list(look.dash[1]),
        "orders": orders,
    }


def setting_data(
    row: StudyRow, rows: Sequence[StudyRow], series: int, usual: float
) -> dict[str, Any]:
    """Data of the marker of one setting."""
    steps = work(row) or planned(row, rows)
    low, at, high = interval(row, usual)
    return {
        "series": series,
        "words": format_setting(row),
        "ran": row.outcome == Outcome.RAN,
        "outcome": f"{row.outcome}: {row.message}" if row.message else str(row.outcome),
        "errors": {
            kind: row.errors[kind] for kind in kinds(rows) if isfinite(row.errors.get(kind, NAN))
        },
        "seconds": [finite(low), finite(at), finite(high)],
        "time": timed(row, usual) if row.seconds > 0 else "",
        "repeats": len(row.repeats),
        "work": finite(steps) or None,
        "step": f"{number(1e3 * row.step)} ms" if row.step > 0 else "",
        "violation": finite(row.invariants.get("violation", NAN)),
        "energy": finite(row.invariants.get("energy", NAN)),
        "load": finite(row.load),
        "text": pasted(row),
    }


def kind_data(
    rows: Sequence[StudyRow],
    verdicts: Sequence[Verdict],
    kind: str,
    looks: Mapping[Name, Look],
    usual: float,
) -> dict[str, Any]:
    """Fronts and error floors of a kind of error, with numbers in place of settings and series.

    "front" is the front of the shortest wall times; "tied" are further settings that may be on it,
    since their times are uncertain; "band" is the band in which the front lies; "fewest" is the
    front over steps.
    """
    shown = [row for row in rows if good(row, kind)]
    numbers = {id(row): k for k, row in enumerate(rows)}
    best = [numbers[id(row)] for row in front(shown, kind)]
    maybe = [numbers[id(row)] for row in perhaps(shown, kind, usual)]
    stepped = [row for row in able(shown, kind) if work(row) > 0]
    aims = np.array([(work(row), row.errors[kind]) for row in stepped]).reshape(-1, 2)
    names = list(looks)
    return {
        "key": kind,
        "title": TITLES[kind],
        "front": best,
        "tied": [k for k in maybe if k not in best],
        "band": band(shown, kind, usual),
        "fewest": [numbers[id(stepped[k])] for k in nondominated(aims)],
        "floors": [
            {
                "series": names.index(name_of(v)),
                "level": v.floor,
                "cause": v.cause,
                "evidence": v.evidence,
            }
            for v in verdicts
            if v.kind == kind and v.floor > 0 and name_of(v) in looks
        ],
    }


ASKED = (1e-3, 1e-5, 1e-7)
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
        The setting, its error, its wall time and its number of steps, in words.
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
class Asked:
    """A wanted error, and the advice for each engine, the cheapest first."""

    wanted: str
    engines: tuple[Advice, ...]
    tied: bool
    """Whether the first two engines are tied."""


def advised(
    rows: Sequence[StudyRow], verdicts: Sequence[Verdict], kind: str, usual: float
) -> list[Asked]:
    """Advice of each engine for each of `ASKED`; `usual` is from `noise.usual_spread`."""
    found = []
    for wanted in ASKED:
        cheapest = dict[str, StudyRow]()
        advice = dict[str, Advice]()
        for engine in dict.fromkeys(row.engine for row in rows):
            own = [row for row in rows if row.engine == engine]
            able = enough(own, kind, wanted)
            if able:
                cheapest[engine] = able[0]
                advice[engine] = use(rows, own, able, kind, wanted, verdicts, usual)
            else:
                advice[engine] = short(rows, own, kind, wanted, verdicts)
        order = sorted(advice, key=lambda name: cheapest[name].seconds if name in cheapest else inf)
        first = [interval(cheapest[name], usual) for name in order[:2] if name in cheapest]
        found.append(
            Asked(
                number(wanted),
                tuple(advice[name] for name in order),
                len(first) == 2 and first[0].overlaps(first[1]),
            )
        )
    return found


def use(
    rows: Sequence[StudyRow],
    own: Sequence[StudyRow],
    able: Sequence[StudyRow],
    kind: str,
    wanted: float,
    verdicts: Iterable[Verdict],
    usual: float,
) -> Advice:
    """Advice to use the cheapest of `able`, settings of one engine with a small enough error."""
    row = able[0]
    same = [format_setting_briefly(one) for one in ties(able, row, usual)]
    words = "; ".join(same[:MOST]) + (f"; and {len(same) - MOST} more" if same[MOST:] else "")
    return Advice(
        format_solver(row.engine),
        row.engine,
        place_of(rows, row),
        True,
        format_setting_briefly(row),
        number(row.reached(kind), 2),
        timed(row, usual),
        f"{row.steps} steps" if row.steps else "",
        (beside(own, row, kind, wanted, verdicts)[0],),
        words,
        pasted(row),
    )


MOST = 4  # tied settings that are listed by name


def short(
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
    floor = floor_at(row, kind, verdicts)
    return Advice(
        format_solver(engine),
        engine,
        place_of(rows, row),
        False,
        format_setting_briefly(row),
        number(row.errors[kind], 2),
        f"{number(row.seconds, 2)} s" if row.seconds > 0 else "",
        f"{row.steps} steps" if row.steps else "",
        (format_floor(floor),) if floor else (would_need(ran, kind, wanted, verdicts),),
        "",
        pasted(row),
    )


def place_of(rows: Sequence[StudyRow], row: StudyRow) -> int:
    """Number of a row among rows, found by identity."""
    return next(k for k, one in enumerate(rows) if one is row)


def timed(row: StudyRow, usual: float) -> str:
    """Wall time of a setting with its interval, in words.

    >>> row = StudyRow("", "", "", "", "", "", 1.0, seconds=0.01, repeats=(0.01, 0.02))
    >>> timed(row, 1.0)
    '10 ms (10 to 20)'
    """
    low, middle, high = interval(row, usual)
    unit, factor = next(((u, f) for u, f in UNITS if middle * f >= 1), UNITS[-1])
    words = f"{number(middle * factor, 2)} {unit}"
    if not high > low:
        return words
    return f"{words} ({number(low * factor, 2)} to {number(high * factor, 2)})"


UNITS = (("s", 1.0), ("ms", 1e3), ("µs", 1e6))


def pasted(row: StudyRow) -> str:
    """Text to paste for a setting: in the engine's own form, or else as a table of the sidecar.

    An engine has no form of its own for a setting that lacks parameters which it chooses in a run.

    >>> print(pasted(StudyRow("", "", "", "mujoco", "", "", 1.0, {"timestep": 0.01})))
    <option timestep="0.01"/>
    >>> print(pasted(StudyRow("", "", "", "pymunk", "", "", 1.0, {"timestep": 0.01})))
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
        return in_sidecar(row.engine, parameters)
    own = {}
    if parameters.get("defaults"):
        fields = engine.settings.model_fields
        own = {name: fields[name].default for name in engine.chooses if name in fields}
    text = snippet(Setting(row.engine, {**own, **parameters}), row.steps)
    return text or in_sidecar(row.engine, parameters)


def in_sidecar(engine: str, parameters: dict[str, ParameterValue]) -> str:
    """Settings as a TOML table of a sidecar."""
    lines = [f"{name} = {toml(value)}" for name, value in parameters.items() if name != "segments"]
    return "\n".join(["# in the sidecar", f"[settings.{engine}]", *lines])


def toml(value: ParameterValue) -> str:
    """A value in TOML.

    >>> toml(True), toml((0.02, 1.0)), toml("RK4")
    ('true', '[0.02, 1.0]', '"RK4"')
    """
    return json.dumps(value)


def limited_by(
    verdicts: Iterable[Verdict], kind: str, letters: dict[tuple[str, str], str]
) -> Iterator[dict[str, str]]:
    """Causes that limit a kind of error, with levels, series, and the evidence of one series."""
    groups = dict[str, list[Verdict]]()
    for verdict in verdicts:
        if (
            verdict.kind == kind
            and verdict.floor > 0
            and (verdict.engine, verdict.series) in letters
        ):
            groups.setdefault(verdict.cause, []).append(verdict)
    for cause, own in sorted(groups.items(), key=lambda group: -max(v.floor for v in group[1])):
        own = sorted(own, key=lambda v: v.floor)
        low, high = number(own[0].floor, 2), number(own[-1].floor, 2)
        names = ", ".join(sorted(letters[v.engine, v.series] for v in own))
        yield {
            "cause": cause,
            "level": low if low == high else f"{low} to {high}",
            "series": f"series {names}",
            "evidence": own[-1].evidence,
            "of": letters[own[-1].engine, own[-1].series],
        }
