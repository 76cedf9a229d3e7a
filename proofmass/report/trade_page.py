"""Pages of a study of work and precision: the diagram, what to do, in words, and the table."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from math import inf
from pathlib import Path
from typing import Any

from markupsafe import Markup
from matplotlib import rc_context

from proofmass.errors import InputError
from proofmass.files import write_whole
from proofmass.report.figures import save
from proofmass.report.pages import about, environment, slug
from proofmass.report.study import Written, prepared
from proofmass.report.style import RC
from proofmass.report.svg import inline
from proofmass.report.trade_marks import letter, name_of
from proofmass.report.trade_sheet import axis_of, dressed, good, trade_sheet, turn_sheet
from proofmass.studies.row import KINDS, Row
from proofmass.studies.table import read_table
from proofmass.studies.trade.choose import MARGIN, beside, best, enough
from proofmass.studies.trade.orders import off
from proofmass.studies.trade.trade import read_verdicts
from proofmass.studies.trade.verdict import Verdict
from proofmass.studies.trade.words import brief, told
from proofmass.wording import number, spoken

ASKED = (1e-4, 1e-6)  # of the range: errors that the words speak of
FILES = ("trade.csv", "trade.columns.md", "floors.csv", "verdicts.json")
WORK = ("Largest error over a run against its cost. Filled markers and the pale stairs: the front, "
        "of which no other setting is both cheaper and closer. Triangles fall with the order that "
        "theory expects. Short level ticks: error floors, with their lines and what they are. "
        "Crosses: runs that failed; the table has their messages.")
TURNED = "The same for what else can be turned, at a fixed step."


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
    files = prepared(output, (folder / name for name in FILES))
    parts = [part(list(own), verdicts, output) for _, own in groupby(
        sorted(rows, key=place), key=place)]
    env = environment()
    shared = {"about": about(), "asked": [number(wanted) for wanted in ASKED], "files": files,
              "margin": MARGIN, "style": {}, "home": home}
    for one in parts:
        text = env.get_template("trade.html").render(parts=[one], index=False, **shared)
        write_whole(output / one["page"], text)
    index = output / "index.html"
    write_whole(index, env.get_template("trade.html").render(parts=parts, index=True, **shared))
    return Written(index, {one["case"]: one["page"] for one in parts})


def place(row: Row) -> tuple[str, str]:
    """What a page is about."""
    return row.case, row.run


def part(rows: Sequence[Row], verdicts: Iterable[Verdict], output: Path) -> dict[str, Any]:
    """All that a page shows of one run of a case."""
    case, run = place(rows[0])
    own = [v for v in verdicts if (v.case, v.run) == (case, run)]
    stem = f"{slug(case)}-{run}-trade"
    return {"case": case, "run": run, "page": f"{stem}.html", "advice": advice(rows, own),
            "prices": list(prices(rows, own)),
            "figures": list(figures(rows, own, output / "figures" / stem)),
            "lines": list(lines(rows, own)), "floors": list(floors(rows, own)),
            "motion": next((v.motion for v in own if v.motion), ""),
            "reached": list(reached(rows, own)), "kinds": kinds(rows), "measured": measured(rows)}


def kinds(rows: Iterable[Row]) -> list[str]:
    """Kinds of errors that there are."""
    return [kind for kind in KINDS if any(kind in row.errors for row in rows)]


def figures(rows: Sequence[Row], verdicts: Sequence[Verdict], stem: Path
            ) -> Iterator[dict[str, Any]]:
    """The diagram, and the errors over what else was turned, if anything was."""
    looks, axis = dressed(rows), axis_of(rows)
    along, others = ([row for row in rows if (row.axis == axis) is same] for same in (True, False))
    with rc_context(RC):
        drawn = [("", WORK, trade_sheet(along, verdicts, looks))]
        if any(good(row, kind) for row in others for kind in KINDS):
            drawn.append(("-turned", TURNED, turn_sheet(others, looks)))
        for ending, caption, figure in drawn:
            name = stem.name + ending
            svg = inline(save(figure, stem.with_name(name)), name, caption)
            yield {"svg": Markup(svg), "stem": name, "caption": caption}


def advice(rows: Sequence[Row], verdicts: Sequence[Verdict]) -> list[tuple[str, list[str]]]:
    """What to use for an error of each kind, in words: engine after engine, the cheapest first."""
    found = []
    engines = dict.fromkeys(row.engine for row in rows)
    for kind in kinds(rows):
        for wanted in ASKED:
            said = sorted(use([row for row in rows if row.engine == engine], engine, kind, wanted,
                              verdicts) for engine in engines)
            found.append((f"{kind} within {number(wanted)} of its range",
                          [text for _, text in said]))
    return found


def use(rows: Sequence[Row], engine: str, kind: str, wanted: float, verdicts: Sequence[Verdict]
        ) -> tuple[float, str]:
    """What to use of one engine, after its wall time [s]; or why there is nothing."""
    able = enough(rows, kind, wanted)
    if not able:
        return inf, f"{spoken(engine)} cannot: {best(rows, kind, wanted, verdicts)[0]}"
    row = able[0]
    return row.seconds, (f"{told(row)}: {number(row.errors[kind], 2)} off in "
                         f"{number(row.seconds, 2)} s; "
                         f"{beside(rows, row, kind, wanted, verdicts)[0]}")


def prices(rows: Sequence[Row], verdicts: Sequence[Verdict]) -> Iterator[list[str]]:
    """For each engine, and each error of the first kind that is asked: what to use, its wall time
    [s], and how many times as long the engine's defaults take."""
    kind = next(iter(kinds(rows)), "")
    for engine in dict.fromkeys(row.engine for row in rows):
        own = [row for row in rows if row.engine == engine]
        cells = [spoken(engine)]
        for wanted in ASKED:
            if not (able := enough(own, kind, wanted)):
                cells += ["cannot", "", ""]
                continue
            said, ratio = beside(own, able[0], kind, wanted, verdicts)
            never = "never get there" in said
            cells += [brief(able[0]), number(able[0].seconds, 2),
                      "never" if never else number(ratio, 2)]
        yield cells


def lines(rows: Sequence[Row], verdicts: Iterable[Verdict]) -> Iterator[dict[str, Any]]:
    """The table, line by line, every number already a word."""
    looks, told = dressed(rows), list(verdicts)
    for name, look in looks.items():
        own = [row for row in rows if name_of(row) == name]
        yield {"letter": letter(look), "colour": look.colour, "name": name[1], "axis": own[0].axis,
               "rows": [cells(row, kinds(rows)) for row in own],
               "orders": {v.kind: (number(v.observed), number(v.expected),
                                   off(v.observed, v.expected))
                          for v in told if name_of(v) == name}}


def cells(row: Row, kinds: Iterable[str]) -> dict[str, Any]:
    """One run."""
    return {"value": number(row.value), "errors": [number(row.errors.get(k, float("nan")))
                                                   for k in kinds],
            "gap": number(row.invariants.get("gap", float("nan"))),
            "energy": number(row.invariants.get("energy", float("nan"))),
            "seconds": number(row.seconds), "steps": row.steps or "—",
            "repeats": len(row.repeats), "outcome": row.outcome, "message": row.message}


def floors(rows: Sequence[Row], verdicts: Iterable[Verdict]) -> Iterator[dict[str, str]]:
    """What keeps each line from falling further, and the evidence."""
    looks = dressed(rows)
    for v in verdicts:
        if v.floor > 0 and name_of(v) in looks:
            yield {"letter": letter(looks[name_of(v)]), "line": v.line,
                   "kind": v.kind, "level": number(v.floor, 2), "cause": v.cause,
                   "evidence": v.evidence}


def reached(rows: Sequence[Row], verdicts: Iterable[Verdict]) -> Iterator[dict[str, str]]:
    """How far each line came that shows no floor, and where a finer setting is worse."""
    looks = dressed(rows)
    for v in verdicts:
        if (said := "; ".join(filter(None, (v.reached, v.worse)))) and name_of(v) in looks:
            yield {"letter": letter(looks[name_of(v)]), "line": v.line, "kind": v.kind,
                   "said": said}


def measured(rows: Sequence[Row]) -> str:
    """How the times were taken."""
    ran = [row for row in rows if row.repeats]
    machines = ", ".join(dict.fromkeys(row.machine for row in ran if row.machine))
    pinned = sum(row.pinned for row in ran)
    busy = max((row.shared for row in ran if row.shared >= 0), default=0.0)
    once = sum(len(row.repeats) == 1 for row in ran)
    most = max((len(row.repeats) for row in ran), default=0)
    return (f"{len(rows)} settings, {len(rows) - len(ran)} without times. Wall times: least of up "
            f"to {most} in rounds over all settings, warm-up apart, {once} of a single run; "
            f"{pinned} of {len(ran)} with a processor of their own, which gave others at most "
            f"{number(100 * busy, 2)} % of its time. {machines}")
