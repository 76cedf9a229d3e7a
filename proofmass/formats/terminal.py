"""What the command line prints: the tables of ``check`` and ``list``, and JSON."""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any

from rich.cells import cell_len
from rich.console import Console, JustifyMethod
from rich.table import Table
from rich.text import Text

from proofmass.base.grouping import group_by
from proofmass.base.json_values import replace_nonfinite
from proofmass.base.wording import format_list, format_range_share, number
from proofmass.batch.check import Result, family_of
from proofmass.case.case import Case
from proofmass.sim.engines import NATIVE_ENGINE
from proofmass.verdict.comparison import UNCHECKED_CASE, Comparison
from proofmass.verdict.grade import grade_of, worst_unchecked
from proofmass.verdict.outcome import (
    CHECKED_OUTCOMES,
    NOT_RUN_OUTCOMES,
    UNCHECKED_OUTCOMES,
    Outcome,
)

if TYPE_CHECKING:
    from proofmass.evidence.diagnosis import Diagnosis, Explanation, Fault, SharedCause

COMPARISON_KEYS = (
    "case",
    "solver",
    "run",
    "channel",
    "unit",
    "error_max",
    "at",
    "error_rms",
    "nrmse",
    "uncertainty",
    "noise",
    "allowed",
    "detectable",
    "outcome",
    "message",
    "seconds",
    "steps",
)
OUTCOME_SIGNS: dict[str, tuple[str, str]] = {
    Outcome.AGREES: ("✓", "green"),
    Outcome.UNCHECKED: ("·", "dim"),
    Outcome.SELF_CONSISTENT: ("≈", "cyan"),
    Outcome.MEASURED: ("·", "cyan"),
    Outcome.UNSUPPORTED: ("–", "dim"),
    Outcome.UNAVAILABLE: ("–", "dim"),
}
FAILURE_SIGN = ("✗", "bold red")


UNLIMITED_WIDTH = 500
"""Width of an output that is no screen [characters], more than any table needs."""


def as_json(result: Result) -> str:
    """Return a result as one JSON object: comparisons, diagnoses, notes, errors, exit code.

    Numbers that are not finite are null.
    """
    rows = [
        {key: asdict(c)[key] for key in COMPARISON_KEYS} | {"grade": grade_label([c])}
        for c in result.comparisons
    ]
    by_case = group_by(result.comparisons, lambda c: c.case)
    return json.dumps(
        replace_nonfinite(
            {
                "comparisons": rows,
                "grades": {case: grade_label(own) for case, own in by_case.items()},
                "causes": [cause_data(cause) for cause in result.causes],
                "diagnoses": [diagnosis_data(found) for found in result.diagnoses.values()],
                "notes": list(note_lines(result)),
                "versions": result.versions,
                "screens": screens_as_data(result),
                "errors": [
                    {"file": str(e.file), "key": e.key, "wrong": e.wrong} for e in result.errors
                ],
                "of_others": [str(file) for file in result.of_others],
                "exit_code": result.exit_code,
            }
        ),
        indent=1,
        allow_nan=False,
    )


def grade_label(rows: Iterable[Comparison]) -> str | None:
    """The name of the grade of some comparisons; None if no curve agrees."""
    grade = grade_of(rows)
    return grade.label if grade else None


def screens_as_data(result: Result) -> dict[str, Any]:
    """The first screens of the models as data, by their names."""
    if not result.screens:
        return {}
    from proofmass.formats.screen import screen_data  # loads MuJoCo

    return {name: screen_data(found) for name, found in result.screens.items()}


def first_screens(result: Result) -> Iterator[Text]:
    """The lines of the first screens."""
    if result.screens:
        from proofmass.formats.screen import screen_lines  # loads MuJoCo

        for name, found in result.screens.items():
            yield from screen_lines(found, name)


def cause_data(cause: "SharedCause") -> dict[str, Any]:
    """A cause as data: its sentence, its faults, what it explains, and its runs."""
    return {
        "sentence": cause.sentence,
        "head": cause.head,
        "complete": cause.complete,
        "faults": [fault_data(fault) for fault in cause.best.faults],
        "explains": sum(len(one.explains) for one in cause.explanations),
        "differing": sum(one.differing for one in cause.explanations),
        "runs": [{"case": d.case, "run": d.run, "solver": d.solver} for d in cause.diagnoses],
    }


def diagnosis_data(found: "Diagnosis") -> dict[str, Any]:
    """A diagnosis as data, with the sentence of each cause."""
    data = {key: value for key, value in vars(found).items() if key != "causes"}
    return data | {"causes": [explanation_data(cause) for cause in found.causes]}


def explanation_data(cause: "Explanation") -> dict[str, Any]:
    """A cause of one run as data."""
    data = {key: value for key, value in vars(cause).items() if key != "edits"}
    faults = [fault_data(fault) for fault in cause.faults]
    return data | {"sentence": cause.sentence, "complete": cause.complete, "faults": faults}


def fault_data(fault: "Fault") -> dict[str, Any]:
    """A fault as data."""
    return vars(fault) | {"file": str(fault.file)}


def make_console(width: int = UNLIMITED_WIDTH) -> Console:
    """Return the console of standard output; `width` is its width where it is not a screen."""
    # without markup and emoji, names are printed as they are
    plain: dict[str, Any] = {"highlight": False, "markup": False, "emoji": False}
    shown = Console(**plain)
    return shown if shown.is_terminal else Console(**plain, width=width)


def hang(line: Text, console: Console) -> Text:
    """Break a line at the words of a screen, with its further lines indented below its first word.

    >>> print(hang(Text("  cause: a long line on it"), Console(width=20)).plain)
      cause: a long
          line on it
    """
    plain = line.plain
    begin = len(plain) - len(plain.lstrip())
    indent = begin + HANGING_INDENT
    if console.width < 2 * indent or cell_len(plain) <= console.width:
        return line
    parts = line[begin:].wrap(console, console.width - indent)
    for part in parts:
        part.rstrip()
    first, *more = parts
    hung = (Text.assemble(" " * indent, part) for part in more)
    return Text("\n").join([Text.assemble(" " * begin, first), *hung])


def three_digits(value: float) -> str:
    """Format a number with three digits; a dash for one that is not finite.

    >>> three_digits(0.000123456), three_digits(float("nan"))
    ('1.23e-04', '–')
    """
    return f"{value:.2e}" if math.isfinite(value) else "–"


def format_outcome(outcome: str) -> Text:
    """Return an outcome with its sign, which is readable without colour."""
    sign, style = OUTCOME_SIGNS.get(outcome, FAILURE_SIGN)
    return Text(f"{sign} {outcome}", style=style)


def worst_comparison(group: list[Comparison]) -> Comparison:
    """Return the comparison that represents a solver: a failure, else the one nearest its limit."""

    def rank(c: Comparison) -> tuple[bool, float]:
        ratio = c.share_of_allowed if c.allowed > 0 else c.nrmse
        return c.outcome not in OUTCOME_SIGNS, ratio if math.isfinite(ratio) else -1.0

    return max(group, key=rank)


COLUMNS = (
    "case",
    "run",
    "solver",
    "outcome",
    "channel",
    "worst error",
    "allowed",
    "of range",
    "of allowed",
    "s",
    "steps",
)
LEFT_ALIGNED = 5
"""Number of the first columns, which are words and are aligned left."""
LAYOUTS: tuple[tuple[str, ...], ...] = (
    COLUMNS,
    COLUMNS[:9],
    (*COLUMNS[:5], "of range", "of allowed"),
    (*COLUMNS[:4], "of range", "of allowed"),
)
"""Columns of a table by layout, the widest first; the first layout that fits a screen is used."""
NARROW_LAYOUT: tuple[tuple[str, ...], ...] = (
    ("run", "solver", "outcome", "of range", "of allowed"),
    ("case",),
)
NARROW_CHANNEL_LAYOUT: tuple[tuple[str, ...], ...] = (
    ("channel", "outcome", "of range", "of allowed"),
    ("case", "run", "solver"),
)
"""Columns on a screen too narrow for all layouts, and columns that the line above them replaces."""
COLUMN_GAP = 2
NAMED_CASES = 3
"""Cases that a line names; of more, the line gives their number."""
INDENT = 2
HANGING_INDENT = 4
"""Indent of the further lines of a line that a screen breaks [characters]."""
Cells = dict[str, str | Text]


def summary_tables(
    result: Result, every_channel: bool = False, width: int = 240
) -> Iterator[Table]:
    """Yield tables with a row for each solver of each run, or for each channel.

    There is one table with as many columns as fit the width [characters].  Where not even the
    layout with the fewest columns fits, each case has a table with a title.
    """
    rows = list(summary_rows(result, every_channel))
    if not rows:
        return
    for columns in LAYOUTS[: 3 if every_channel else 4]:
        if fits_width(rows, columns, width):
            yield make_table(rows, columns)
            return
    columns, title_columns = NARROW_CHANNEL_LAYOUT if every_channel else NARROW_LAYOUT
    min_widths = column_widths(rows, columns)
    min_widths[0] += INDENT
    for k, (title, group) in enumerate(
        groupby(rows, lambda row: " ".join(str(row[name]) for name in title_columns))
    ):
        own = make_table(list(group), columns, min_widths, show_header=not k)
        own.title, own.title_justify, own.title_style = Text(title, no_wrap=True), "left", ""
        yield own


def summary_rows(result: Result, every_channel: bool) -> Iterator[Cells]:
    """Yield the rows of the table: the cells by the names of their columns."""
    for (case, run, solver), comparisons in groupby(
        result.comparisons, lambda c: (c.case, c.run, c.solver)
    ):
        group = list(comparisons)
        for c in group if every_channel else [worst_comparison(group)]:
            yield {
                "case": case,
                "run": run,
                "solver": solver,
                "outcome": outcome_cell(group, c, every_channel),
                "channel": c.channel,
                "worst error": f"{three_digits(c.error_max)} {c.unit}".strip(),
                "allowed": three_digits(c.allowed),
                "of range": three_digits(c.relative_to_range),
                "of allowed": format_ratio(c),
                "s": f"{c.seconds:.2f}" if math.isfinite(c.seconds) else "–",
                "steps": str(c.steps or "–"),
            }


def format_ratio(c: Comparison) -> str:
    """Format the ratio of the error to what is allowed: two digits, or a dash.

    >>> format_ratio(Comparison("a", "b", "c", "d", "m", error_max=1.0, allowed=3.0))
    '0.33'
    """
    if not (math.isfinite(c.error_max) and c.allowed > 0):
        return "–"
    ratio = c.share_of_allowed
    return f"{ratio:.2f}" if 0.01 <= ratio < 1e4 else "0" if not ratio else f"{ratio:.1e}"


def column_widths(rows: list[Cells], columns: Iterable[str]) -> list[int]:
    """Return the widths of columns in which no cell is broken [characters]."""
    return [max([cell_len(name), *(cell_len(str(row[name])) for row in rows)]) for name in columns]


def fits_width(rows: list[Cells], columns: Sequence[str], width: int) -> bool:
    """Whether a table of these columns, with no cell broken, is no wider than a screen."""
    return sum(column_widths(rows, columns)) + COLUMN_GAP * (len(columns) - 1) <= width


def make_table(
    rows: list[Cells],
    columns: Sequence[str],
    min_widths: Sequence[int] = (),
    show_header: bool = True,
) -> Table:
    """Return a table of these columns, with no word broken; a case is named in its first row.

    `min_widths` are the least widths of the columns [characters]; with these the first column is
    indented.
    """
    table = Table(box=None, header_style="bold", pad_edge=False, show_header=show_header)
    for k, name in enumerate(columns):
        side: JustifyMethod = "left" if name in COLUMNS[:LEFT_ALIGNED] else "right"
        table.add_column(
            " " * INDENT * bool(min_widths and not k) + name,
            justify=side,
            no_wrap=True,
            min_width=min_widths[k] if min_widths else None,
        )
    last = ""
    for row in rows:
        cells = [row[name] for name in columns]
        if columns[0] == "case":
            cells[0] = row["case"] if row["case"] != last else ""
        elif min_widths:
            cells[0] = " " * INDENT + str(cells[0])
        table.add_row(*cells)
        last = str(row["case"])
    return table


def outcome_cell(group: list[Comparison], shown: Comparison, single_channel: bool) -> Text:
    """Return the outcome of a row with its grade, and how many channels have the same outcome.

    `group` are the comparisons of the solver, `shown` the one that the row shows.  Where a row
    is a single channel (`single_channel`), there is no count.
    """
    text = format_outcome(shown.outcome)
    same_outcome = [shown] if single_channel else group
    if shown.outcome == Outcome.AGREES and (grade := grade_of(same_outcome)):
        text.append(f" {grade.words}")
    same = sum(c.outcome == shown.outcome for c in group)
    return text if single_channel or len(group) == 1 else text.append(f" {same}/{len(group)}")


def failure_lines(
    result: Result, link: Callable[[Comparison], str] | None = None
) -> Iterator[Text]:
    """Yield the lines below the table.

    These are a line for each run that differs or failed, by its worst channel, with its diagnosis
    and, if `link` is given, its link; for each case in which nothing was checked; notes on curves;
    sensors for which no quantity was found; references that read the model themselves; the largest
    error; and the number of comparisons with each outcome.
    """
    pages = {case.name for case in result.cases}
    causes = result.causes
    yield from first_screens(result)
    for cause in causes:
        yield from cause_lines(cause, result, link)
    explained = {run for cause in causes for run in cause.runs}
    for (case, run, solver), rows in groupby(
        result.comparisons, lambda c: (c.case, c.run, c.solver)
    ):
        if (case, run, solver) in explained:
            continue
        group = list(rows)
        bad = [c for c in group if c.outcome not in OUTCOME_SIGNS]
        if not bad:
            continue
        c = worst_comparison(bad)
        text = (
            c.message
            if c.outcome != Outcome.DIFFERS
            else (
                f"{len(bad)} of {len(group)} curves, {c.channel} by {c.message}: {format_worst(c)}"
            )
        )
        yield Text.assemble((f"{FAILURE_SIGN[0]} {case} {run} {solver} {c.outcome}: ", "red"), text)
        if found := result.diagnoses.get((case, run, solver)):
            elsewhere = [d for d in result.diagnoses.values() if d.case == case and d.found]
            yield from diagnosis_lines(found, elsewhere)
        if link and case in pages:
            yield Text(f"  {link(c)}", style="dim")
    for line in left_out_lines(result):
        yield Text(f"– {line}", style="dim")
    for case in result.unchecked:
        yield Text.assemble((f"{FAILURE_SIGN[0]} {case.name} unchecked: ", "red"), UNCHECKED_CASE)
    for c in result.comparisons:
        if c.outcome in UNCHECKED_OUTCOMES and c.message and not c.channel:
            yield Text.assemble(format_outcome(c.outcome), f" {c.case}: {c.message}")
    for line in note_lines(result):
        yield Text(f"· {line}", style="dim")
    for case in result.cases:
        if case.unmatched:
            yield Text(f"· {case.name}: {describe_unmatched(case)}", style="dim")
        if case.reads_model:
            yield Text(f"· {case.name}: {describe_own_numbers(case)}", style="dim")
    judged = [c for c in result.comparisons if c.outcome in CHECKED_OUTCOMES and c.channel]
    if judged:
        yield Text(format_largest(judged))
    if coarse := worst_unchecked(result.comparisons):
        yield Text(
            f"not checked: errors up to {format_range_share(coarse.relative_to_range)} "
            f"({format_comparison(coarse)})"
        )
    counts = {
        o: sum(c.outcome == o for c in result.comparisons)
        for o in dict.fromkeys(c.outcome for c in result.comparisons)
    }
    words = [f"{n} {o}" for o, n in counts.items()]
    if result.unchecked:
        words.append(f"{len(result.unchecked)} case(s) without any check")
    yield Text(
        ", ".join(words) or "nothing to check",
        style="bold" if result.exit_code == 0 else "bold red",
    )


def cause_lines(
    cause: "SharedCause", result: Result, link: Callable[[Comparison], str] | None = None
) -> Iterator[Text]:
    """Yield the lines of a cause: its sentence, the line to copy, its proof, and its cases.

    A cause is told once for all runs and cases that share it.  A case has one line, with its worst
    curve and, if `link` is given, the address of that curve.
    """
    yield Text.assemble((f"{FAILURE_SIGN[0]} {cause.head}: ", FAILURE_SIGN[1]), cause.sentence)
    for line in (*cause.details, *cause.remarks):
        yield Text(f"    {line}")
    runs = cause.runs
    rows = [c for c in result.comparisons if (c.case, c.run, c.solver) in runs]
    for name, own in group_by(rows, lambda c: c.case).items():
        bad = [c for c in own if c.outcome == Outcome.DIFFERS]
        worst = worst_comparison(bad or own)
        in_runs = format_list(dict.fromkeys(f"{c.run} {c.solver}" for c in own))
        yield Text(
            f"  {name}: {len(bad)} of {len(own)} curves differ, in {in_runs}; "
            f"{worst.channel} by {format_worst(worst)}"
        )
        if link:
            yield Text(f"  {link(worst)}", style="dim")


def format_worst(c: Comparison) -> str:
    """Format the largest error of a comparison, its share of the range, and where it is.

    >>> format_worst(Comparison("a", "b", "sweep", "pin.x", "m", error_max=0.0316, at=6.17847,
    ...     error_rms=0.01, nrmse=0.0075, at_unit="rad"))
    '0.0316 m, 2.4 % of its range, at 6.18 rad'
    """
    at = f"{c.at:.3g} {c.at_unit}".rstrip()
    error = f"{number(c.error_max)} {c.unit.removeprefix('1')}".rstrip()
    return f"{error}, {format_range_share(c.relative_to_range)}, at {at}"


def diagnosis_lines(found: "Diagnosis", elsewhere: "Sequence[Diagnosis]" = ()) -> Iterator[Text]:
    """Yield the lines of the diagnosis of a run that failed, or whose cause was not found.

    Where other runs of the case have a cause, those of `elsewhere`, the line names these runs.
    """
    head, (first, *more) = found.head, found.lines
    if elsewhere and not (found.found or found.failed or found.fault):
        runs = ", ".join(f"{other.run} {other.solver}" for other in elsewhere)
        first, more = f"not found in this run; see {runs}", []
    yield Text.assemble((f"  {head}: ", "bold"), first)
    for line in more:
        yield Text(f"         {line}")


def format_largest(judged: list[Comparison]) -> str:
    """Format the largest error of all comparisons, and the error nearest to its limit."""
    largest = max(judged, key=lambda c: finite_or(c.relative_to_range, -1.0))
    limit = max(judged, key=lambda c: c.share_of_allowed)
    return (
        f"largest error {three_digits(largest.relative_to_range)} of the range "
        f"({format_comparison(largest)}); nearest to its limit {format_ratio(limit)} of what is "
        f"allowed ({format_comparison(limit)})"
    )


def note_lines(result: Result) -> Iterator[str]:
    """Yield the remarks on models and the notes on curves.

    A note on several solvers of a case is given once, and so is one on a solver in several cases.
    """
    for name, remarks in result.remarks.items():
        yield from (f"{name}: {remark}" for remark in remarks)
    by_note = group_by(
        ((key, note) for key, notes in result.notes.items() for note in notes), itemgetter(1)
    )
    for note, places in by_note.items():
        keys = [key for key, _ in places]
        cases, solvers = ({key[k] for key in keys} for k in (0, 2))
        if len(cases) > 1 and len(solvers) == 1:
            yield f"{solvers.pop()} in {len(keys)} runs: {note}"
            continue
        for name, own in group_by(keys, itemgetter(0)).items():
            yield f"{name}: {note}" if own[1:] else f"{' '.join(own[0])}: {note}"


def left_out_lines(result: Result) -> Iterator[str]:
    """Yield what engines that were asked for cannot run, each reason once, with its cases."""
    asked = {case.name for case in result.cases if case.asked}
    runs = {
        (c.case, c.run, c.solver): c.message
        for c in result.comparisons
        if c.case in asked and c.outcome in NOT_RUN_OUTCOMES and not math.isfinite(c.seconds)
    }
    for (solver, why), keys in group_by(runs, lambda key: (key[2], runs[key])).items():
        cases = list(dict.fromkeys(key[0] for key in keys))
        more = f" and {len(cases) - NAMED_CASES} more" if len(cases) > NAMED_CASES else ""
        count = f"{len(keys)} run{'s' * (len(keys) > 1)}"
        yield f"{solver} left out in {count}: {why} ({', '.join(cases[:NAMED_CASES])}{more})"


def finite_or(value: float, otherwise: float) -> float:
    """Return a number if it is finite, otherwise another one."""
    return value if math.isfinite(value) else otherwise


def format_comparison(c: Comparison) -> str:
    """Format the case, run, solver and channel of a comparison."""
    return f"{c.case} {c.run} {c.solver} {c.channel}"


def describe_unmatched(case: Case) -> str:
    """Format the line on the sensors that a case does not check."""
    return (
        f"not checked: sensors {', '.join(case.unmatched)}; no quantity of {case.reference} "
        f"has their names, and the sidecar does not list them"
    )


def describe_own_numbers(case: Case) -> str:
    """Format the line on a case whose reference reads the model itself."""
    constant = ", ".join(case.constant_channels)
    but = f"; only {constant}, which must equal a number, can show it" if constant else ""
    return (
        f"the reference {case.reference} reads the numbers of {case.model}: a wrong one is wrong "
        f"in the engines and in the reference{but}"
    )


def case_table(
    cases: list[Case], bare_models: list[Path], paths: list[Path], width: int = 500
) -> Table:
    """Return the table of `proofmass list`: a row for each case, with its folder below the paths.

    `bare_models` are models without a sidecar.  Where not all columns fit the width
    [characters], the table has only the case, its runs, and the first words of its title.
    """
    columns = ["folder", "case", "model", "reference", "runs", "channels", "title"]
    cells = [
        (
            family_of(case.file, paths),
            case.name,
            case.model,
            case.reference,
            "; ".join(f"{kind}: {', '.join(run.solvers)}" for kind, run in case.run.items()),
            str(len(case.channels)),
            case.title,
        )
        for case in cases
    ]
    own_motion = f"own motion: {NATIVE_ENGINE}"
    cells += [
        (family_of(model, paths), model.stem, model.name, "–", own_motion, "", "")
        for model in bare_models
    ]
    rows: list[Cells] = [dict(zip(columns, each, strict=True)) for each in cells]
    if not fits_width(rows, columns, width):
        columns.remove("model")
        for row in rows:
            parts = str(row["runs"]).split("; ")
            row["runs"] = ", ".join(part.partition(":")[0] for part in parts)
    if not fits_width(rows, columns, width):
        columns = ["case", "runs", "title"]
        room = width - sum(column_widths(rows, columns[:2])) - 2 * COLUMN_GAP
        for row in rows:
            row["title"] = shorten(
                str(row["title"]), max(room, 1), placeholder="…", break_on_hyphens=False
            )
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in columns:
        table.add_column(name, no_wrap=True)
    for row in rows:
        table.add_row(*(row[name] for name in columns))
    return table
