"""The pages of a trade study: what to do, the work-precision diagram, limits, tables."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from matplotlib import rc_context

from proofmass.errors import InputError
from proofmass.report.figures import save
from proofmass.report.marks import MARKS, Tone, tones
from proofmass.report.page import slug
from proofmass.report.study import Pages, Written, prepared
from proofmass.report.style import KNOWN, RC, Look
from proofmass.studies.record import KINDS, StudyRow, read_table
from proofmass.studies.trade.advice import ASKED, advised, limited_by
from proofmass.studies.trade.choose import MARGIN, beside, enough
from proofmass.studies.trade.figure import (
    Name,
    dressed,
    good,
    letter,
    name_of,
    other_parameters_sheet,
    trade_sheet,
    varied_in,
)
from proofmass.studies.trade.noise import busy, ties, usual_spread
from proofmass.studies.trade.orders import off
from proofmass.studies.trade.page_data import TITLES, kinds, page_data
from proofmass.studies.trade.trade import read_verdicts
from proofmass.studies.trade.verdict import Verdict
from proofmass.studies.trade.words import format_setting_briefly
from proofmass.wording import format_solver, number

FILES = ("trade.csv", "trade.columns.md", "floors.csv", "verdicts.json")
SCRIPTS = ("axes.js", "diagram.js", "trade.js")
FIRST = "position"


def write_trade(folder: Path | str, output: Path | str, home: str = "") -> Written:
    """Write a page for each case of a study, and an index; from the study's tables alone.

    Parameters
    ----------
    folder : path
        Holds ``trade.csv`` and ``verdicts.json``; see `proofmass.studies.trade.trade.write_study`.
    output : path
        Made when it is not there; gets copies of the tables.
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
        told = [v for v in verdicts if (v.case, v.run) == (case, run)]
        parts.append(write_part(list(own), told, pages, files))
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
    """What a page is about."""
    return row.case, row.run


def write_part(
    rows: Sequence[StudyRow], verdicts: Sequence[Verdict], pages: Pages, files: list[str]
) -> dict[str, Any]:
    """Write the page of one run of a case; what the index shows of it."""
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
    """The colour of an engine that is not that of its defaults, if there is a series of it."""
    own = [look.colour for name, look in looks.items() if name[0] == engine]
    known = KNOWN.get(engine)
    return known.colour if known and known.colour in own else own[0]


def other_parameters(rows: Sequence[StudyRow]) -> list[StudyRow]:
    """Settings of series that vary another parameter than the step, if any is drawn."""
    varied = varied_in(rows)
    others = [row for row in rows if row.varied != varied]
    return others if any(good(row, kind) for row in others for kind in KINDS) else []


def write_figures(rows: Sequence[StudyRow], verdicts: Sequence[Verdict], stem: Path) -> None:
    """The diagram for papers, and the errors over other parameters, if any was varied."""
    looks, varied = dressed(rows), varied_in(rows)
    with rc_context(RC):
        save(trade_sheet([row for row in rows if row.varied == varied], verdicts, looks), stem)
        if others := other_parameters(rows):
            save(other_parameters_sheet(others, looks), stem.with_name(f"{stem.name}-parameters"))


def prices(
    rows: Sequence[StudyRow], verdicts: Sequence[Verdict], usual: float
) -> Iterator[list[dict[str, str]]]:
    """For each engine, and each error of the first kind that is asked: what to use, its wall time
    [s], and how many times as long the engine's defaults take."""
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
    """A cell of the index, with what stands below its text."""
    return {"text": text, "note": note}


def series_records(
    rows: Sequence[StudyRow],
    verdicts: Iterable[Verdict],
    looks: Mapping[Name, Look],
    colours: Mapping[str, Tone],
) -> Iterator[dict[str, Any]]:
    """The table, series by series, every number already a word."""
    told = list(verdicts)
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
                for v in told
                if name_of(v) == name
            },
        }


def cells(row: StudyRow, kinds: Iterable[str]) -> dict[str, Any]:
    """One run."""
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
    """What keeps each series from falling further, and the evidence."""
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
    """How far each series without an error floor came, and where a finer setting is worse."""
    for v in verdicts:
        if (said := "; ".join(filter(None, (v.reached, v.worse)))) and name_of(v) in letters:
            yield {
                "letter": letters[name_of(v)],
                "series": v.series,
                "kind": v.kind,
                "said": said,
            }


def measured(rows: Sequence[StudyRow]) -> str:
    """How the times were taken."""
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
