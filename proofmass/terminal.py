"""What the command line prints: a table a check, and JSON."""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from textwrap import shorten
from typing import Any

from rich.cells import cell_len
from rich.console import Console, JustifyMethod
from rich.table import Table
from rich.text import Text

from proofmass.case import Case
from proofmass.check import Result, family_of
from proofmass.compare import UNCHECKED, Comparison
from proofmass.diagnosis import Diagnosis
from proofmass.outcome import CHECKED, OPEN, Outcome
from proofmass.reference import reads_model
from proofmass.sim.mjcf import NATIVE

KEYS = (
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
    "allowed",
    "detectable",
    "outcome",
    "message",
    "seconds",
    "steps",
)
LOOK: dict[str, tuple[str, str]] = {
    Outcome.AGREES: ("✓", "green"),
    Outcome.UNCHECKED: ("·", "dim"),
    Outcome.SELF_CONSISTENT: ("≈", "cyan"),
    Outcome.UNSUPPORTED: ("–", "dim"),
}
FAILED = ("✗", "bold red")


WIDE = 500
"""Columns of what is no screen: more than any table needs."""


def as_json(result: Result) -> str:
    """One object: comparisons, what would explain differences, errors of the input, the exit code.

    What is not a number is null.
    """
    rows = [{key: asdict(c)[key] for key in KEYS} for c in result.comparisons]
    return json.dumps(
        finite(
            {
                "comparisons": rows,
                "diagnoses": [asdict(found) for found in result.diagnoses.values()],
                "errors": [
                    {"file": str(e.file), "key": e.key, "wrong": e.wrong} for e in result.errors
                ],
                "exit_code": result.exit_code,
            }
        ),
        indent=1,
        allow_nan=False,
    )


def finite(value: Any) -> Any:
    """Nested lists and tables with null for what is not a number.

    >>> finite([{"size": float("nan"), "relative": True}])
    [{'size': None, 'relative': True}]
    """
    if isinstance(value, dict):
        return {key: finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def console(width: int = WIDE) -> Console:
    """Standard output; as wide as the tables need when it is not a screen."""
    plain: dict[str, Any] = {"highlight": False, "markup": False, "emoji": False}  # names stay
    shown = Console(**plain)
    return shown if shown.is_terminal else Console(**plain, width=width)


def number(value: float) -> str:
    """Three digits, or a dash.

    >>> number(0.000123456), number(float("nan"))
    ('1.23e-04', '–')
    """
    return f"{value:.2e}" if math.isfinite(value) else "–"


def mark(outcome: str) -> Text:
    """An outcome with its sign, readable without colour."""
    sign, style = LOOK.get(outcome, FAILED)
    return Text(f"{sign} {outcome}", style=style)


def worst(group: list[Comparison]) -> Comparison:
    """The comparison that speaks for a solver: a failure first, else the one nearest its limit."""

    def rank(c: Comparison) -> tuple[bool, float]:
        ratio = c.error_max / c.allowed if c.allowed > 0 else c.nrmse
        return c.outcome not in LOOK, ratio if math.isfinite(ratio) else -1.0

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
LEFT = 5
"""Columns that are words, and stand on the left."""
LAYOUTS: tuple[tuple[str, ...], ...] = (
    COLUMNS,
    COLUMNS[:9],
    (*COLUMNS[:5], "of range", "of allowed"),
    (*COLUMNS[:4], "of range", "of allowed"),
)
"""The columns of a screen, the widest first; on a narrower one cases have lines of their own."""
NARROW: tuple[tuple[str, ...], ...] = (
    ("run", "solver", "outcome", "of range", "of allowed"),
    ("case",),
)
NARROW_CHANNELS: tuple[tuple[str, ...], ...] = (
    ("channel", "outcome", "of range", "of allowed"),
    ("case", "run", "solver"),
)
"""The columns of a narrow screen, and what the line above them says."""
GAP = 2
INDENT = 2
Cells = dict[str, str | Text]


def summary(result: Result, every_channel: bool = False, width: int = 240) -> Iterator[Table]:
    """A row for each solver of each run, or for each channel; as many columns as fit the width.

    Where not even the fewest fit, each case has a table, whose title it is.
    """
    rows = list(summary_rows(result, every_channel))
    if not rows:
        return
    for columns in LAYOUTS[: 3 if every_channel else 4]:
        if fits(rows, columns, width):
            yield table_of(rows, columns)
            return
    columns, above = NARROW_CHANNELS if every_channel else NARROW
    wide = widths(rows, columns)
    wide[0] += INDENT
    for k, (title, group) in enumerate(
        groupby(rows, lambda row: " ".join(str(row[name]) for name in above))
    ):
        own = table_of(list(group), columns, wide, head=not k)
        own.title, own.title_justify, own.title_style = Text(title, no_wrap=True), "left", ""
        yield own


def summary_rows(result: Result, every_channel: bool) -> Iterator[Cells]:
    """The cells of the rows by the names of their columns."""
    for (case, run, solver), comparisons in groupby(
        result.comparisons, lambda c: (c.case, c.run, c.solver)
    ):
        group = list(comparisons)
        for c in group if every_channel else [worst(group)]:
            yield {
                "case": case,
                "run": run,
                "solver": solver,
                "outcome": outcomes(group, c, every_channel),
                "channel": c.channel,
                "worst error": f"{number(c.error_max)} {c.unit}".strip(),
                "allowed": number(c.allowed),
                "of range": number(c.relative_to_range),
                "of allowed": of_allowed(c),
                "s": f"{c.seconds:.2f}" if math.isfinite(c.seconds) else "–",
                "steps": str(c.steps or "–"),
            }


def of_allowed(c: Comparison) -> str:
    """The error over what is allowed: two digits, or a dash.

    >>> of_allowed(Comparison("a", "b", "c", "d", "m", error_max=1.0, allowed=3.0))
    '0.33'
    """
    if not (math.isfinite(c.error_max) and c.allowed > 0):
        return "–"
    ratio = c.error_max / c.allowed
    return f"{ratio:.2f}" if 0.01 <= ratio < 1e4 else "0" if not ratio else f"{ratio:.1e}"


def widths(rows: list[Cells], columns: Iterable[str]) -> list[int]:
    """How wide the columns are in which nothing is broken."""
    return [max([cell_len(name), *(cell_len(str(row[name])) for row in rows)]) for name in columns]


def fits(rows: list[Cells], columns: Sequence[str], width: int) -> bool:
    """Whether a table of these columns is no wider than a screen, with nothing broken."""
    return sum(widths(rows, columns)) + GAP * (len(columns) - 1) <= width


def table_of(
    rows: list[Cells], columns: Sequence[str], wide: Sequence[int] = (), head: bool = True
) -> Table:
    """A table of these columns, in which no word is broken; a case is named in its first row."""
    table = Table(box=None, header_style="bold", pad_edge=False, show_header=head)
    for k, name in enumerate(columns):
        side: JustifyMethod = "left" if name in COLUMNS[:LEFT] else "right"
        table.add_column(
            " " * INDENT * bool(wide and not k) + name,
            justify=side,
            no_wrap=True,
            min_width=wide[k] if wide else None,
        )
    last = ""
    for row in rows:
        cells = [row[name] for name in columns]
        if columns[0] == "case":
            cells[0] = row["case"] if row["case"] != last else ""
        elif wide:
            cells[0] = " " * INDENT + str(cells[0])
        table.add_row(*cells)
        last = str(row["case"])
    return table


def outcomes(group: list[Comparison], speaker: Comparison, alone: bool) -> Text:
    """The speaker's outcome, and how many channels of the group share it."""
    text = mark(speaker.outcome)
    same = sum(c.outcome == speaker.outcome for c in group)
    return text if alone or len(group) == 1 else text.append(f" {same}/{len(group)}")


def failures(result: Result, link: Callable[[Comparison], str] | None = None) -> Iterator[Text]:
    """A line for each run that failed, by its worst channel, with its `link` if there are any, and
    for each case in which nothing was checked; sensors that no quantity is found for; references
    that read the model themselves; and the counts of all outcomes.
    """
    said, pages = set[tuple[str, str]](), {case.name for case in result.cases}
    for (case, run, solver), rows in groupby(
        result.comparisons, lambda c: (c.case, c.run, c.solver)
    ):
        group = list(rows)
        bad = [c for c in group if c.outcome not in LOOK]
        if not bad:
            continue
        c = worst(bad)
        text = (
            c.message
            if c.outcome != Outcome.DIFFERS
            else (
                f"{len(bad)} of {len(group)} channels, {c.channel} by {c.message}: "
                f"{number(c.error_max)} {c.unit} at {c.at:.6g}, "
                f"{number(c.relative_to_range)} of the range"
            )
        )
        yield Text.assemble((f"{FAILED[0]} {case} {run} {solver} {c.outcome}: ", "red"), text)
        if found := result.diagnoses.get((case, run, solver)):
            elsewhere = [d for d in result.diagnoses.values() if d.case == case and d.found]
            yield from diagnosis(found, said, elsewhere)
        if link and case in pages:
            yield Text(f"  {link(c)}", style="dim")
    for case in result.unchecked:
        yield Text.assemble((f"{FAILED[0]} {case.name} unchecked: ", "red"), UNCHECKED)
    for c in result.comparisons:
        if c.outcome in OPEN and c.message and not c.channel:
            yield Text.assemble(mark(c.outcome), f" {c.case}: {c.message}")
    for line in notes(result):
        yield Text(f"· {line}", style="dim")
    for case in result.cases:
        if case.unmatched:
            yield Text(f"· {case.name}: {not_checked(case)}", style="dim")
        if reads_model(case):
            yield Text(f"· {case.name}: {own_numbers(case)}", style="dim")
    judged = [c for c in result.comparisons if c.outcome in CHECKED]
    if judged:
        yield Text(nearest(judged))
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


def diagnosis(
    found: Diagnosis, said: set[tuple[str, str]], elsewhere: Sequence[Diagnosis] = ()
) -> Iterator[Text]:
    """The lines of a diagnosis; of a cause that a run of the case had before, what it explains.

    Where no cause is found, the runs are named in which there is one.
    """
    first, *more = found.lines
    if elsewhere and not (found.found or found.failed or found.fault):
        runs = ", ".join(f"{other.run} {other.solver}" for other in elsewhere)
        first, more = f"not found in this run; see {runs}", []
    if found.causes and (found.case, first) in said:
        more = more[:1]
    said.add((found.case, first))
    yield Text.assemble(("  failed: " if found.failed else "  cause: ", "bold"), first)
    for line in more:
        yield Text(f"         {line}")


def nearest(judged: list[Comparison]) -> str:
    """How well the engines agree: the largest error of all, and the one nearest to its limit."""
    largest = max(judged, key=lambda c: finite_or(c.relative_to_range, -1.0))
    limit = max(judged, key=lambda c: c.error_max / c.allowed if c.allowed > 0 else -1.0)
    return (
        f"largest error {number(largest.relative_to_range)} of the range ({place(largest)}); "
        f"nearest to its limit {of_allowed(limit)} of what is allowed ({place(limit)})"
    )


def notes(result: Result) -> Iterator[str]:
    """What is said of curves; what is the same for several solvers of a case is said once."""
    runs_by_note: dict[tuple[str, str], list[str]] = {}
    for (name, run, solver), curves in result.curves.items():
        for note in curves.notes:
            runs_by_note.setdefault((name, note), []).append(f"{run} {solver}")
    for (name, note), of in runs_by_note.items():
        yield f"{name} {of[0]}: {note}" if len(of) == 1 else f"{name}: {note}"


def finite_or(value: float, otherwise: float) -> float:
    """A number, or another one where it is none."""
    return value if math.isfinite(value) else otherwise


def place(c: Comparison) -> str:
    """Where a comparison belongs to."""
    return f"{c.case} {c.run} {c.solver} {c.channel}"


def not_checked(case: Case) -> str:
    """What is said of the sensors that a case does not check."""
    return (
        f"not checked: sensors {', '.join(case.unmatched)}; no quantity of {case.reference} "
        f"has their names, and the sidecar does not list them"
    )


def own_numbers(case: Case) -> str:
    """What is said of a case whose reference reads the model itself."""
    laws = ", ".join(case.laws)
    but = f"; only {laws}, held to a number, can show it" if laws else ""
    return (
        f"the reference {case.reference} reads the numbers of {case.model}: a wrong one is wrong "
        f"in the engines and in the reference{but}"
    )


def case_table(cases: list[Case], lone: list[Path], paths: list[Path], width: int = 500) -> Table:
    """What `proofmass list` shows: a line a case, by their folders below the given paths.

    Where not all columns fit there are names, runs, and the first words of the title.
    """
    full = [
        {
            "folder": family_of(case.file, paths),
            "case": case.name,
            "model": case.model,
            "reference": case.reference,
            "runs": "; ".join(f"{k}: {', '.join(run.solvers)}" for k, run in case.run.items()),
            "channels": str(len(case.channels)),
            "title": case.title,
        }
        for case in cases
    ]
    full += [
        {
            "folder": family_of(model, paths),
            "case": model.stem,
            "model": model.name,
            "reference": "–",
            "runs": f"own motion: {NATIVE}",
            "channels": "",
            "title": "",
        }
        for model in lone
    ]
    rows: list[Cells] = [{**row} for row in full]
    brief: list[Cells] = [
        {**row, "runs": ", ".join(part.partition(":")[0] for part in row["runs"].split("; "))}
        for row in full
    ]
    columns = ["folder", "case", "model", "reference", "runs", "channels", "title"]
    if not fits(rows, columns, width):
        rows, columns = brief, ["folder", "case", "reference", "runs", "channels", "title"]
    if not fits(rows, columns, width):
        columns = ["case", "runs", "title"]
        room = width - sum(widths(rows, columns[:2])) - 2 * GAP
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
