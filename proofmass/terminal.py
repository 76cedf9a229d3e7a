"""What the command line prints: a table a check, and JSON."""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from proofmass.case import Case
from proofmass.check import Result, family_of
from proofmass.compare import UNCHECKED, Comparison
from proofmass.diagnosis import Diagnosis
from proofmass.outcome import Outcome
from proofmass.reference import reads_model

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
    Outcome.UNSUPPORTED: ("–", "dim"),
}
FAILED = ("✗", "bold red")


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


def console(width: int = 240) -> Console:
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


def summary(result: Result, every_channel: bool = False, width: int = 240) -> Iterator[Table]:
    """A table with one row for each solver of each run, or for each channel.

    On a screen of less than 140 columns it leaves out share of range, seconds and steps.
    """
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("case", "run", "solver", "outcome", "channel"):  # only names give way
        table.add_column(name, no_wrap=name not in ("case", "channel"), overflow="fold")
    numbers = ("worst error", "allowed", "of range", "s", "steps")
    kept = len(numbers) if width >= 140 else 2
    for name in numbers[:kept]:
        table.add_column(name, justify="right", no_wrap=True)
    last = ""
    for (case, run, solver), rows in groupby(
        result.comparisons, lambda c: (c.case, c.run, c.solver)
    ):
        group = list(rows)
        for c in group if every_channel else [worst(group)]:
            figures = [
                f"{number(c.error_max)} {c.unit}".strip(),
                number(c.allowed),
                number(c.relative_to_range),
                f"{c.seconds:.2f}" if math.isfinite(c.seconds) else "–",
                str(c.steps or "–"),
            ]
            table.add_row(
                case if case != last else "",
                run,
                solver,
                outcomes(group, c, every_channel),
                c.channel,
                *figures[:kept],
            )
            last = case
    if table.row_count:
        yield table


def outcomes(group: list[Comparison], speaker: Comparison, alone: bool) -> Text:
    """The speaker's outcome, and how many channels of the group share it."""
    text = mark(speaker.outcome)
    same = sum(c.outcome == speaker.outcome for c in group)
    return text if alone or len(group) == 1 else text.append(f" {same}/{len(group)}")


def failures(result: Result) -> Iterator[Text]:
    """A line for each run that failed, by its worst channel, and for each case in which nothing was
    checked; sensors that no quantity is found for; references that read the model themselves; and
    the counts of all outcomes.
    """
    said = set[tuple[str, str]]()
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
                f"{number(c.error_max)} {c.unit} at {c.at:.6g}"
            )
        )
        yield Text.assemble((f"{FAILED[0]} {case} {run} {solver} {c.outcome}: ", "red"), text)
        if found := result.diagnoses.get((case, run, solver)):
            yield from diagnosis(found, said)
    for case in result.unchecked:
        yield Text.assemble((f"{FAILED[0]} {case.name} unchecked: ", "red"), UNCHECKED)
    for case in result.cases:
        if case.unmatched:
            yield Text(f"· {case.name}: {not_checked(case)}", style="dim")
        if reads_model(case):
            yield Text(f"· {case.name}: {own_numbers(case)}", style="dim")
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


def diagnosis(found: Diagnosis, said: set[tuple[str, str]]) -> Iterator[Text]:
    """The lines of a diagnosis; of a cause that a run of the case had before, what it explains."""
    first, *more = found.lines
    if found.causes and (found.case, first) in said:
        more = more[:1]
    said.add((found.case, first))
    yield Text.assemble(("  lost: " if found.lost else "  cause: ", "bold"), first)
    for line in more:
        yield Text(f"         {line}")


def not_checked(case: Case) -> str:
    """What is said of the sensors that a case does not check."""
    return (
        f"not checked: sensors {', '.join(case.unmatched)}; no quantity of {case.reference} "
        f"has their names, and the sidecar does not list them"
    )


def own_numbers(case: Case) -> str:
    """What is said of a case whose reference reads the model itself."""
    laws = [name for name, channel in case.channels.items() if not isinstance(channel.equals, str)]
    but = f"; only {', '.join(laws)}, held to a number, can show it" if laws else ""
    return (
        f"the reference {case.reference} reads the numbers of {case.model}: a wrong one is wrong "
        f"in the engines and in the reference{but}"
    )


def case_table(cases: list[Case], lone: list[Path], paths: list[Path]) -> Table:
    """What `proofmass list` shows: cases by their folders below the given paths."""
    table = Table(
        "folder",
        "case",
        "model",
        "reference",
        "runs",
        "channels",
        "title",
        box=None,
        header_style="bold",
        pad_edge=False,
    )
    for case in cases:
        runs = "; ".join(f"{kind}: {', '.join(run.solvers)}" for kind, run in case.run.items())
        table.add_row(
            family_of(case.file, paths),
            case.name,
            case.model,
            case.reference,
            runs,
            str(len(case.channels)),
            case.title,
        )
    for model in lone:
        table.add_row(
            family_of(model, paths), model.stem, model.name, "–", "unchecked: no sidecar", "", ""
        )
    return table
