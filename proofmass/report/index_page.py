"""The index: a table with a row for each case, failures first.

A cell shows the largest errors of a case in an engine, on an axis that is the same in all cells.

The page has the first rows as HTML, and of all rows the facts by which its script filters and
sorts them.  The other rows are in files of `ROWS_PER_FILE` rows, which the script loads; it keeps
elements only of the rows near the screen.
"""

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from jinja2 import Environment
from markupsafe import Markup

from proofmass.base.files import OUTPUT_MARK, make_folder, remove_output, write_output
from proofmass.base.grouping import group_by
from proofmass.base.wording import format_list, format_range_share, number
from proofmass.batch.check import Result, family_of
from proofmass.case.case import Case
from proofmass.evidence.diagnosis import Fault, SharedCause
from proofmass.report.changes import CHANGE_FACTOR, Change, changes_of_case, find_changes
from proofmass.report.families import group_cards, reference_name
from proofmass.report.glance import glance_of
from proofmass.report.model_page import page_name
from proofmass.report.overview import bar_width
from proofmass.report.page import case_faults, error_message, report_facts, slug
from proofmass.report.record import History, Last, Record
from proofmass.report.study import ShownStudy
from proofmass.report.style import Look
from proofmass.report.svg_markers import MARKER_PATHS
from proofmass.report.thumbnail import Thumbnail
from proofmass.report.trend import MIN_REPORTS
from proofmass.report.words import RUNS, SYMBOLS, case_state, group_by_solver, quantity_kind
from proofmass.sim.engines import computes_curves, format_solver, is_variant
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.grade import Grade, grade_of, worst_unchecked
from proofmass.verdict.outcome import (
    CHECKED_OUTCOMES,
    EMPTY_OUTCOMES,
    FAILED_OUTCOMES,
    GOOD_OUTCOMES,
    UNCHECKED_OUTCOMES,
    Outcome,
)

STATIC = ("common.css", "common.js", "index.css", "index.js")
MAX_SENTENCES = 2
"""Number of sentences on failed runs that a row shows before it only counts them."""


ROWS_FOLDER, ROWS_PER_FILE = "rows", 40
"""Folder of the files of rows, and the number of rows of a file and of those on the page itself."""
MAX_NAMED_CASES = 10
"""Number of cases that are gone or missing, and of errors of inputs, that are visible at once."""
FAILED_SORT_VALUE = 1e308
"""Key of the order for a cell without a number whose run failed: more than any error."""
NO_MARKUP = Markup()
MIN_TREND_REPORTS = 3
"""Least number of reports for the trend of a row."""


@dataclass(frozen=True)
class ErrorMark:
    """The bar of a solver in a cell: its error over what is allowed.

    `width` is that of the bar, see `proofmass.report.overview.bar_width`; None where nothing is
    allowed.  `hollow` is true for other settings of an engine, `over` for a failure.
    """

    solver: str
    hollow: bool
    over: bool
    width: float | None
    words: str


@dataclass(frozen=True)
class IndexCell:
    """Errors of a case in the runs of one group in one engine; `sort` is the key of the order."""

    lanes: list[ErrorMark]
    error: str
    kind: str
    bad: bool
    sort: float

    @property
    def words(self) -> str:
        """All marks in words."""
        return "; ".join(lane.words for lane in self.lanes)


@dataclass(frozen=True)
class IndexColumn:
    """A column of cells: a group of runs in an engine."""

    run: str
    engine: str

    @property
    def key(self) -> str:
        """The name of the column for the script."""
        return f"{self.run}/{self.engine}"

    @property
    def title(self) -> str:
        """The heading of the column."""
        return f"{self.run.capitalize()} · {format_solver(self.engine)}"


@dataclass(frozen=True)
class EngineLook:
    """Colour and marker of an engine's dots."""

    name: str
    colour: str
    path: str

    @property
    def title(self) -> str:
        """The engine's name as in sentences."""
        return format_solver(self.name)


@dataclass(frozen=True)
class CaseRow:
    """A case on the index.

    Attributes
    ----------
    name, title : str
        The case's name, which no other case has, and its title.
    page : str
        Link to the page of the case, from the index.
    family, reference : str
        The folder that the case is in, and its reference; the index can be filtered by both.
    state : str
        good, open or bad; `symbol` and `word` express it.
    symbol, word : str
        The sign and the name of the case's worst outcome.
    remarks : list of str
        Sentences on the failures of the case; none for a good case.
    cells : dict of str to IndexCell
        The worst errors of the case, by the `key` of the column.
    engines, bad_engines : list of str
        The engines that the case ran in, and those of them with a failure.
    margin : float
        Largest ratio of an error to its tolerance [1], over the channels that have one; infinite
        where a run failed.
    checked, channels : int
        Number of curves that were compared with a tolerance, and of all curves of the case.
    seconds : float
        Processor time of all runs of the case [s].
    search : str
        What the search field searches apart from name and title, in small letters.
    changes : list of Change
        Changes of the case since the last report.
    worse : int
        Number of changes to the worse.
    picture : Markup
        The drawing of the mechanism as SVG; empty if there is none.
    files : list of (str, str)
        Label and link of each file with curves of the case.
    trend : Markup
        A line, as SVG, of the error nearest to its tolerance over the last reports; empty if there
        are too few reports or the error did not change.
    grade : Grade, optional
        How closely its curves agree; None if the case does not.
    """

    name: str
    title: str
    page: str
    family: str
    reference: str
    state: str
    symbol: str
    word: str
    remarks: list[str]
    cells: dict[str, IndexCell]
    engines: list[str]
    bad_engines: list[str]
    margin: float
    checked: int
    channels: int
    seconds: float
    search: str
    changes: list[Change] = field(default_factory=list)
    worse: int = 0
    picture: Markup = NO_MARKUP
    files: list[tuple[str, str]] = field(default_factory=list)
    trend: Markup = NO_MARKUP
    grade: Grade | None = None

    @property
    def order(self) -> tuple[bool, bool, float, str]:
        """Sort key: failures first, then cases worse than in the last report, then by margin."""
        return self.state != "bad", not self.worse, -self.margin, self.name

    @property
    def change(self) -> str:
        """The changes since the last report in few words."""
        if not self.changes:
            return ""
        if not self.changes[0].run:
            return "new"
        better = sum(change.growth < 1 for change in self.changes)
        counts = {
            "worse": self.worse,
            "better": better,
            "other": len(self.changes) - self.worse - better,
        }
        return ", ".join(f"{n} {word}" for word, n in counts.items() if n)


@dataclass(frozen=True)
class IndexFiles:
    """The index: its page, and the files of the rows after the first `ROWS_PER_FILE`."""

    page: str
    row_files: list[str]


def render_index(
    env: Environment,
    result: Result,
    style: Mapping[str, Look],
    pictures: Mapping[str, Thumbnail | Markup | None],
    record: Record,
    last: Last,
    history: History,
    studies: Sequence[ShownStudy] = (),
    files: Mapping[str, list[tuple[str, str]]] | None = None,
    note: str = "",
    missing: Sequence[str] = (),
) -> IndexFiles:
    """Render the index.

    Parameters
    ----------
    env : Environment
        From `proofmass.report.page.environment`; it finds the template.
    result : Result
        All cases with their comparisons, from `proofmass.batch.check.check`.
    style : mapping of str to Look
        The look of each solver, from `proofmass.report.style.solver_looks`.
    pictures : mapping of str to Thumbnail or Markup or None
        The drawing of each case, by its name: a `Thumbnail` is animated, a `Markup` is not.
    record, last : Record, Last
        The record of this report, and that of the report that it is compared with.
    history : History
        The errors of the last reports, this one included.
    studies : sequence of ShownStudy
        Studies that the index links to.
    files : mapping of str to list of (str, str), optional
        Label and link of each file with curves, by the name of the case.
    note : str
        Why there are no files with curves; empty if they are written.
    missing : sequence of str
        Cases without results, where the report is not finished.
    """
    found = find_changes(last.record, record) if last.record else []
    found = [c for c in found if c.case not in set(missing)]
    changed = group_by(found, lambda change: change.case)
    comparisons = group_by(result.comparisons, lambda c: c.case)
    columns = columns_of(result)
    shapes = engine_looks(columns, style)
    found_causes = result.causes
    causes_of = {
        name: [cause for _, cause in own]
        for name, own in group_by(
            ((name, cause) for cause in found_causes for name in cause.cases), lambda pair: pair[0]
        ).items()
    }
    rows = [
        case_row(
            case,
            replace(result, comparisons=comparisons.get(case.name, [])),
            columns,
            changed.get(case.name, []),
            pictures.get(case.name),
            history,
            files or {},
            causes_of.get(case.name, ()),
        )
        for case in result.cases
    ]
    rows.sort(key=lambda row: row.order)
    by_name = {row.name: row for row in rows}
    grouped = group_cards(
        result.cases,
        [{"name": case.name, "state": by_name[case.name].state} for case in result.cases],
        result.paths,
    )
    gone = [c for c in found if not c.run and not c.now]
    shown = {
        "columns": columns,
        "engines": shapes,
        "compared": bool(last.record),
        "trended": len(history.reports) >= MIN_REPORTS,
    }
    causes = [index_cause(cause, by_name) for cause in found_causes]
    page = env.get_template("index.html").render(
        **shown,
        rows=rows,
        count=len(rows),
        first_rows=rows[:ROWS_PER_FILE],
        other_rows=rows[ROWS_PER_FILE:],
        facts=row_facts(rows, columns),
        poses={row.name: poses_of(pictures.get(row.name)) for row in rows[:ROWS_PER_FILE]},
        most=MAX_NAMED_CASES,
        missing=missing,
        groups=grouped,
        states=Counter(row.state for row in rows),
        checked=sum(row.checked for row in rows),
        channels=sum(row.channels for row in rows),
        changed=sum(bool(row.changes) for row in rows) + len(gone),
        gone=[change.case for change in gone],
        last=last,
        record=record,
        headline=headline_of(rows, found_causes),
        causes=[cause for cause in causes if cause.pages],
        basis=format_basis(result.cases),
        cost=format_cost(result.comparisons, record),
        graded=format_grades(rows),
        unjudged=format_unjudged(result.comparisons),
        glance=glance_of(family_choices(grouped), result.comparisons),
        about=report_facts(),
        studies=studies,
        errors=[error_message(e) for e in result.errors],
        loose=[c for c in result.comparisons if not c.channel],
        screens=described_screens(result),
        remarks=result.remarks,
        note=note,
    )
    parts = (rows[k : k + ROWS_PER_FILE] for k in range(ROWS_PER_FILE, len(rows), ROWS_PER_FILE))
    write = env.get_template("index_row.html").render
    return IndexFiles(
        page,
        [
            rows_script(
                k,
                [write(**shown, row=row) for row in part],
                [poses_of(pictures.get(row.name)) for row in part],
            )
            for k, part in enumerate(parts, 1)
        ],
    )


@dataclass(frozen=True)
class IndexCause:
    """A cause on the index: its sentence, its wrong values, what it leaves, and its cases."""

    title: str
    faults: tuple[Fault, ...]
    proof: str
    pages: tuple[tuple[str, str], ...]


def index_cause(cause: SharedCause, rows: Mapping[str, CaseRow]) -> IndexCause:
    """Return a cause with the pages of its cases."""
    return IndexCause(
        cause.title,
        cause.written_faults,
        f"{cause.proof[:1].upper()}{cause.proof[1:]}.",
        tuple((name, rows[name].page) for name in cause.cases if name in rows),
    )


def headline_of(rows: Sequence[CaseRow], causes: Sequence[SharedCause]) -> str:
    """Return the verdict on all cases in one line."""
    bad, count = [row.name for row in rows if row.state == "bad"], len(rows)
    cases = f"{count} case{'s' * (count != 1)}"
    if not bad:
        agree = sum(row.state == "good" for row in rows)
        if agree < count:
            rest = count - agree
            return f"{agree} of {cases} agree, {rest} {'is' if rest == 1 else 'are'} not checked"
        return f"All {cases} agree" if count > 1 else f"{cases} agrees"
    alone = causes[0] if len(causes) == 1 else None
    if alone and alone.complete and alone.best.fault and set(bad) <= set(alone.cases):
        return f"One wrong value fails {len(bad)} of {cases}"
    return f"{len(bad)} of {cases} differ{'s' * (len(bad) == 1)} or failed"


def format_basis(cases: Sequence[Case]) -> str:
    """Return what the cases are compared with, by number of cases."""
    kinds = Counter(
        "recorded curves"
        if case.recorded
        else "general solvers that read the model itself"
        if case.reads_model
        else "references that are independent of the model (closed forms, solvers of rods and "
        "balancers)"
        for case in cases
    )
    parts = [f"{words}: {count} case{'s' * (count != 1)}" for words, count in kinds.most_common()]
    return f"{'; '.join(parts)}." if parts else ""


def format_cost(comparisons: Sequence[Comparison], record: Record) -> str:
    """Return the processor time of all runs by engine, and the load of the machine."""
    runs = {(c.case, c.run, c.solver): c.seconds for c in comparisons}
    known = [key for key, seconds in runs.items() if math.isfinite(seconds)]
    by_engine = group_by(known, lambda key: key[2].partition(":")[0])
    parts = [
        f"{format_solver(engine)} {number(sum(runs[key] for key in keys), 2)} s"
        for engine, keys in by_engine.items()
        if computes_curves(engine)
    ]
    made, load = record.made, ""
    if made.load_start is not None:
        load = f", {made.processors} processors at a load of {number(made.load_start, 2)}"
        if made.load_start > made.processors:
            load += ", which makes times longer"
    return f"processor time {format_list(parts)}{load}" if parts else "nothing was run"


def format_grades(rows: Sequence[CaseRow]) -> str:
    """Return how many cases have each grade."""
    counts = Counter(row.grade for row in rows if row.grade)
    return ", ".join(f"{counts[one]} {one.words}" for one in Grade if counts[one])


def format_unjudged(comparisons: Sequence[Comparison]) -> str:
    """Return the largest error of a curve that is not checked, if a plot shows it."""
    c = worst_unchecked(comparisons)
    if c is None:
        return ""
    return f"errors up to {format_range_share(c.relative_to_range, 'the')} ({c.case})"


def family_choices(groups: Iterable[Mapping[str, Any]]) -> dict[str, tuple[str, list[str]]]:
    """Return for each family the value of its filter, and the names of its cases."""
    return {
        group["name"]: (
            f"{group['name']}/"
            if len(group["parts"]) > 1
            else f"{group['name']}/{group['parts'][0]['name']}",
            [card["name"] for part in group["parts"] for card in part["cards"]],
        )
        for group in groups
    }


def described_screens(result: Result) -> dict[str, dict[str, Any]]:
    """The first screens of the models without a sidecar as data, by their names."""
    if not result.screens:
        return {}
    from proofmass.formats.screen import screen_data  # loads MuJoCo

    return {
        name: screen_data(found) | {"page": page_name(name) if found.file else ""}
        for name, found in result.screens.items()
    }


def poses_of(picture: Thumbnail | Markup | None) -> dict[str, object] | None:
    """Return the data of a moving drawing; None for another one."""
    return picture.data if isinstance(picture, Thumbnail) else None


def rows_script(number: int, rows: list[str], poses: list[dict[str, object] | None]) -> str:
    """Return the script of a file of rows: a call with their HTML and the poses of their drawings.

    A page that was opened from disk may load a script, but may not read another kind of file.
    """
    text = json.dumps([number, rows, poses], ensure_ascii=False, separators=(",", ":"))
    return f"// {OUTPUT_MARK}\ntakeRows(...{text});\n"


def row_facts(rows: Sequence[CaseRow], columns: Sequence[IndexColumn]) -> dict[str, Any]:
    """Return the facts by which the script filters and sorts the rows, as lists over the rows.

    Words that many rows share are numbers of entries in `shared`.
    """
    shared = dict[str, int]()

    def entry(text: str) -> int:
        return shared.setdefault(text, len(shared))

    facts: dict[str, Any] = {
        "name": [row.name for row in rows],
        "page": [row.page for row in rows],
        "title": [entry(row.title) for row in rows],
        "symbol": [entry(row.symbol) for row in rows],
        "word": [entry(row.word) for row in rows],
        "state": [entry(row.state) for row in rows],
        "family": [entry(f"{row.family}/{row.reference}") for row in rows],
        "search": [entry(row.search) for row in rows],
        "engines": [entry(" ".join(row.engines)) for row in rows],
        "failing": [entry(" ".join(row.bad_engines)) for row in rows],
        "checked": [row.checked for row in rows],
        "channels": [row.channels for row in rows],
        "seconds": [float(f"{row.seconds:.3g}") for row in rows],
        "changes": [len(row.changes) for row in rows],
        "worse": [row.worse for row in rows],
        "values": {column.key: [sort_value(row, column) for row in rows] for column in columns},
    }
    return {"per_file": ROWS_PER_FILE, "shared": list(shared), "rows": facts}


def sort_value(row: CaseRow, column: IndexColumn) -> float | None:
    """Return the key of the order of a row by a column; None where the row has no such cell."""
    cell = row.cells.get(column.key)
    return None if cell is None else float(f"{min(cell.sort, FAILED_SORT_VALUE):.4g}")


def write_index_files(folder: Path, files: IndexFiles) -> Path:
    """Write an index and its files of rows, and remove those of a longer index before it."""
    place = folder / ROWS_FOLDER
    names = {f"{k}.js" for k in range(1, len(files.row_files) + 1)}
    if names:
        make_folder(place)
    for k, text in enumerate(files.row_files, 1):
        write_output(place / f"{k}.js", text)
    index = folder / "index.html"
    write_output(index, files.page)
    for old in place.glob("*.js"):
        if old.stem.isdecimal() and old.name not in names:
            remove_output(old)
    return index


def columns_of(result: Result) -> list[IndexColumn]:
    """Return the columns that are not empty; engines in the order in which they occur.

    Recorded curves are no engine: the page of their case has them.
    """
    there = {
        (run_group(c.run), engine_name(c))
        for c in result.comparisons
        if c.channel and computes_curves(c.solver)
    }
    engines = dict.fromkeys(engine_name(c) for c in result.comparisons)
    groups = dict.fromkeys(words.group for words in RUNS.values())
    return [IndexColumn(run, name) for run in groups for name in engines if (run, name) in there]


def run_group(run: str) -> str:
    """Return the group of columns that a run belongs to; empty for a refinement."""
    return RUNS[run].group if run in RUNS else ""


def engine_name(c: Comparison) -> str:
    """Return the engine of a comparison's solver."""
    return c.solver.partition(":")[0]


def engine_looks(
    columns: Iterable[IndexColumn], style: Mapping[str, Look]
) -> dict[str, EngineLook]:
    """Return colour and marker of each engine, which are those of its first solver.

    A solver without a variant comes before all others.
    """
    found = dict[str, EngineLook]()
    for name in dict.fromkeys(column.engine for column in columns):
        mine = next((look for solver, look in style.items() if solver == name), None)
        first = next(look for solver, look in style.items() if solver.partition(":")[0] == name)
        look = mine or first
        found[name] = EngineLook(name, look.colour, MARKER_PATHS[look.marker])
    return found


def case_row(
    case: Case,
    result: Result,
    columns: Sequence[IndexColumn],
    found: Sequence[Change],
    picture: Thumbnail | Markup | None,
    history: History,
    files: Mapping[str, list[tuple[str, str]]],
    causes: Sequence[SharedCause] = (),
) -> CaseRow:
    """Return the row of a case; `found` are the changes of all cases, `causes` its own ones."""
    rows = [c for c in result.comparisons if c.case == case.name]
    faults = case_faults(case, result)
    state = case_state(case, rows, faults)
    own = changes_of_case(found, case.name)
    curves = [c for c in rows if c.run in case.run and not is_only_shown(c, rows)]
    symbol, word = worst_outcome(state, rows, faults)
    cells = {c.key: cell for c in columns if (cell := index_cell(select_column(rows, c)))}
    family, reference = family_of(case.file, result.paths), reference_name(case)
    return CaseRow(
        name=case.name,
        title=case.title,
        page=f"{slug(case.name)}.html",
        family=family,
        reference=reference,
        state=state,
        symbol=symbol,
        word=word,
        remarks=[*faults, *shorten_sentences(failure_remarks(case, rows, causes))],
        cells=cells,
        engines=list(dict.fromkeys(map(engine_name, rows))),
        bad_engines=list(
            dict.fromkeys(engine_name(c) for c in rows if c.outcome not in GOOD_OUTCOMES)
        ),
        margin=max(
            (c.share_of_allowed for c in rows if c.outcome not in UNCHECKED_OUTCOMES), default=0.0
        ),
        checked=sum(c.outcome in CHECKED_OUTCOMES for c in curves),
        channels=len(curves),
        seconds=total_seconds(rows),
        search=" ".join([family, reference, *case.channels]).lower(),
        changes=own,
        worse=sum(change.growth > 1 for change in own),
        picture=picture.svg(case.name) if isinstance(picture, Thumbnail) else picture or NO_MARKUP,
        files=files.get(case.name, []),
        trend=trend_line(history, rows),
        grade=grade_of(rows) if state == "good" else None,
    )


def failure_remarks(
    case: Case, rows: Sequence[Comparison], causes: Iterable[SharedCause] = ()
) -> Iterator[str]:
    """Yield what is wrong with a case: a sentence for each cause, and for each run without one."""
    explained = set[tuple[str, str, str]]()
    for cause in causes:
        runs = cause.runs
        explained |= runs
        own = [c for c in rows if (c.case, c.run, c.solver) in runs]
        if own:
            differ = sum(c.outcome == Outcome.DIFFERS for c in own)
            by = cause.best.fault.place if cause.best.fault else cause.best.words
            yield f"{differ} of {len(own)} curves differ: {by}."
    for run in dict.fromkeys(c.run for c in rows):
        for solver, group in group_by_solver(rows, run).items():
            bad = [c for c in group if c.outcome not in GOOD_OUTCOMES]
            if bad and (case.name, run, solver) not in explained:
                yield f"{format_solver(solver)}, {run}: {format_failure(bad, len(group))}."
    if not case.unchecked and not {c.outcome for c in rows} - set(UNCHECKED_OUTCOMES):
        yield "Nothing of it was checked."


def format_failure(bad: Sequence[Comparison], channel_count: int) -> str:
    """Format what is wrong in a run of a solver by its worst channel.

    `channel_count` is the number of all channels.
    """
    c = max(bad, key=lambda c: c.share_of_allowed)
    if c.outcome != Outcome.DIFFERS:
        return f"{c.outcome}: {c.message}"
    return f"{len(bad)} of {channel_count} differ, {c.channel} by {c.message}"


def shorten_sentences(sentences: Iterable[str]) -> list[str]:
    """Return the first sentences, and a last one with the number of the others."""
    whole = list(sentences)
    more = len(whole) - MAX_SENTENCES
    return whole if more < 2 else [*whole[:MAX_SENTENCES], f"And {more} more runs."]


def worst_outcome(state: str, rows: Sequence[Comparison], faults: Sequence[str]) -> tuple[str, str]:
    """Return the sign and the word of a case's state: those of its worst outcome."""
    order = (
        Outcome.DIFFERS,
        Outcome.UNDECIDED,
        *FAILED_OUTCOMES,
        *EMPTY_OUTCOMES,
        *((Outcome.AGREES,) if state == "good" else ()),
    )
    there = {c.outcome for c in rows}
    for outcome in order:
        if outcome in there:
            return SYMBOLS[outcome], str(outcome)
    if faults:
        return SYMBOLS[Outcome.DIFFERS], "at fault"
    sign = SYMBOLS[Outcome.UNCHECKED]
    return (SYMBOLS[Outcome.DIFFERS] if state == "bad" else sign), str(Outcome.UNCHECKED)


def is_only_shown(c: Comparison, rows: Sequence[Comparison]) -> bool:
    """Whether a solver is a variant of an engine, and no tolerance covers any of its curves."""
    return is_variant(c.solver) and all(
        math.isnan(other.allowed) and other.outcome in UNCHECKED_OUTCOMES
        for other in rows
        if (other.solver, other.run) == (c.solver, c.run)
    )


def select_column(rows: Iterable[Comparison], column: IndexColumn) -> list[Comparison]:
    """Return the comparisons of a column."""
    return [c for c in rows if run_group(c.run) == column.run and engine_name(c) == column.engine]


def total_seconds(rows: Iterable[Comparison]) -> float:
    """Return the processor time of all runs of a case [s]."""
    runs = {(c.run, c.solver): c.seconds for c in rows}
    return sum(s for s in runs.values() if math.isfinite(s))


def index_cell(rows: Sequence[Comparison]) -> IndexCell | None:
    """Return the cell of these comparisons: a bar for each solver, the engine itself first."""
    solvers = sorted(dict.fromkeys(c.solver for c in rows), key=is_variant)
    groups = [[c for c in rows if c.solver == solver] for solver in solvers]
    if not groups:
        return None
    allowed = {(c.run, c.channel): c.allowed_of_range for c in rows if not is_variant(c.solver)}
    speakers = [representative(group, allowed) for group in groups]
    first = next((c for c in speakers if c.outcome not in GOOD_OUTCOMES), speakers[0])
    share, ratio = first.relative_to_range, ratio_of(first, {})
    known = math.isfinite(share)
    kind = quantity_kind(first.unit) if known else "other"
    bad = first.outcome not in GOOD_OUTCOMES
    return IndexCell(
        lanes=[error_mark(c, allowed) for c in speakers],
        error=number(share, 2) if known else str(first.outcome),
        kind="" if kind == "other" else kind,
        bad=bad,
        sort=math.inf if bad and ratio is None else -1.0 if ratio is None else ratio,
    )


def ratio_of(c: Comparison, allowed: Mapping[tuple[str, str], float]) -> float | None:
    """Return an error over what is allowed; None if nothing is.

    What no tolerance covers is measured by `allowed`, what the engine's own setting is allowed in
    the same run and channel, as a share of the range.
    """
    if math.isfinite(c.allowed) and c.outcome in CHECKED_OUTCOMES:
        return c.share_of_allowed
    own = allowed.get((c.run, c.channel), math.nan)
    return c.relative_to_range / own if own > 0 and math.isfinite(c.relative_to_range) else None


def representative(
    group: Sequence[Comparison], allowed: Mapping[tuple[str, str], float]
) -> Comparison:
    """Return the comparison that represents a solver: the largest error over what is allowed.

    A failure comes first; of curves for which nothing is allowed that with the largest share.
    """

    def rank(c: Comparison) -> tuple[bool, float, float]:
        ratio, share = ratio_of(c, allowed), c.relative_to_range
        known = share if math.isfinite(share) else -1.0
        return c.outcome not in GOOD_OUTCOMES, -1.0 if ratio is None else ratio, known

    return max(group, key=rank)


def error_mark(c: Comparison, allowed: Mapping[tuple[str, str], float]) -> ErrorMark:
    """Return the bar of a solver, by the comparison that represents it."""
    share, ratio, words = c.relative_to_range, ratio_of(c, allowed), str(c.outcome)
    if math.isfinite(share):
        words = f"{c.channel} {format_range_share(share, 'the')}"
        if ratio is not None:
            of = "allowed" if math.isfinite(c.allowed) else "allowed as in the model"
            words += f", {number(ratio, 2)} of what is {of}"
    return ErrorMark(
        c.solver,
        is_variant(c.solver),
        c.outcome not in GOOD_OUTCOMES,
        None if ratio is None else bar_width(ratio),
        f"{format_solver(c.solver)}: {words}",
    )


def trend_line(history: History, rows: Sequence[Comparison]) -> Markup:
    """Draw the error of the channel nearest to its tolerance over the last reports, as a line."""
    judged = [c for c in rows if c.outcome in CHECKED_OUTCOMES]
    if len(history.reports) < MIN_TREND_REPORTS or not judged:
        return NO_MARKUP
    c = max(judged, key=lambda c: c.share_of_allowed)
    values = history.trend(c.case, c.run, c.solver, c.channel)
    powers = [math.log10(v) if v else None for v in values]
    known = [p for p in powers if p is not None]
    if len(known) < MIN_TREND_REPORTS or max(known) - min(known) < math.log10(CHANGE_FACTOR):
        return NO_MARKUP
    low, high = min(known), max(known)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    step = 56 / (len(powers) - 1)
    points = [
        f"{2 + k * step:.1f},{9 - 7 * (power - middle) / half:.1f}"
        for k, power in enumerate(powers)
        if power is not None
    ]
    first, *_, last = (value for value in values if value)
    where = f"{c.run} {format_solver(c.solver)}, {c.channel}"
    return Markup(
        '<svg class="trend" viewBox="0 0 60 18" role="img" aria-label="{}"><polyline '
        'points="{}"/></svg>'
    ).format(
        f"{where}: {len(known)} reports, {number(first, 2)} to {number(last, 2)} of the range",
        " ".join(points),
    )
