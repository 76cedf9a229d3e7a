"""The panels of a case's first screen: badge, what to do, why runs differ, what runs notice."""

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from proofmass.case import Case
from proofmass.compare import Comparison
from proofmass.coverage import Coverage, stored_coverage
from proofmass.coverage_search import Finding
from proofmass.diagnosis import Diagnosis, Explanation
from proofmass.errors import InputError
from proofmass.explain import (
    TRIED,
    cells_of,
    not_noticed,
    not_tried,
    refusals,
    told_of_reference,
)
from proofmass.outcome import CHECKED, LOST, Outcome
from proofmass.report import tables
from proofmass.report.data import Shown
from proofmass.report.overview import place
from proofmass.report.style import PAPERS, Look, legible
from proofmass.report.words import RUNS, kind_of
from proofmass.wording import format_list, format_solver, number

LONGEST = 200_000  # bytes of a text that a page shows


@dataclass(frozen=True)
class PageLook:
    """How a solver looks on a page: its names, its class, its colours on light and dark paper."""

    css: str
    label: str
    title: str
    variant: str
    is_variant: bool
    marker: str
    dash: list[float]
    light: str
    dark: str


def looks_of(data: Mapping[str, Any], style: Mapping[str, Look]) -> dict[str, PageLook]:
    """The looks of the solvers of a case, from its dict of `case_data`."""
    found = {}
    for k, (name, one) in enumerate(data["solvers"].items()):
        engine, _, variant = name.partition(":")
        said = {"default": "its defaults", "": "as in the model"}.get(variant, variant)
        colour = style[name].colour
        found[name] = PageLook(
            f"s{k}",
            one["label"],
            format_solver(engine),
            said,
            one["variant"],
            one["marker"],
            one["dash"],
            legible(colour, PAPERS["light"]),
            legible(colour, PAPERS["dark"]),
        )
    return found


def badge(case: Case, rows: list[Comparison], state: str, faults: list[str]) -> str:
    """The verdict in few words."""
    judged = [c for c in rows if c.outcome in CHECKED]
    differs = sum(c.outcome == Outcome.DIFFERS for c in rows)
    coarse = sum(c.outcome == Outcome.UNDECIDED for c in rows)
    lost = dict.fromkeys(c.outcome for c in rows if c.outcome in LOST)
    words = []
    if differs:
        words.append(f"Differs: {differs} of {len(judged)} checked curves")
    if coarse:
        words.append(f"Undecided: {coarse} of {len(judged)} checked curves")
    if lost:
        solvers = {(c.run, c.solver) for c in rows if c.outcome in LOST}
        words.append(f"{len(solvers)} run{'s' * (len(solvers) > 1)} {format_list(map(str, lost))}")
    if faults:
        words.append("input at fault")
    if words:
        return "✗ " + "; ".join(words)
    if judged:
        return f"✓ Agrees: all {len(judged)} checked curves"
    return "✗ Nothing is checked" if state == "bad" else "○ Not checked, as the sidecar says"


def open_lines(case: Case, runs: Iterable[Shown]) -> list[str]:
    """What no tolerance covers and what solvers do not deliver, a line each."""
    lines = []
    for run in runs:
        where = RUNS[run.kind].where
        lines += [f"{format_line(line)} ({where})" for line in tables.missing(run)]
        for solver in run.solvers:
            own = [c for c in run.rows if c.solver == solver]
            bare = [c.channel for c in own if c.outcome == Outcome.UNCHECKED]
            if not bare:
                continue
            what = "all channels" if len(bare) == len(own) else format_list(bare)
            lines.append(f"{format_solver(solver)} {where}, {what}: shown and not judged.")
    return lines


def format_line(line: str) -> str:
    """A line of `tables.missing` with the engine as it is called in sentences."""
    solver, comma, rest = line.partition(",")
    return f"{format_solver(solver)}{comma}{rest}"


def advice(case: Case, rows: list[Comparison], faults: list[str], state: str) -> list[str]:
    """What there is to do, in sentences."""
    outcomes = {c.outcome for c in rows}
    if faults or not rows:
        return ["Mend the input: the message above names the file and the key."]
    if not outcomes & {Outcome.DIFFERS, Outcome.UNDECIDED, *LOST}:
        if state == "bad":
            return ["Give the case a [[tolerance]] that covers a channel, or say unchecked = true."]
        if Outcome.AGREES not in outcomes:
            return ["Nothing: the sidecar says that nothing is checked."]
        return [
            "Nothing: every checked curve is inside its allowance.",
            *defaults(rows),
        ]
    words = []
    if Outcome.UNDECIDED in outcomes:
        words.append(
            "Record more rows of a curve that is undecided, or rows at the samples of the run: "
            "what lies between its rows is not known as closely as its tolerance asks for."
        )
    if any(c.outcome == Outcome.DIFFERS and c.run != "dynamics" for c in rows):
        words.append(
            "Hold the lengths, masses and signs of the model against the parameters of the case: "
            "without time steps only these, or the meaning of a channel, can differ."
        )
    elif Outcome.DIFFERS in outcomes:
        words.append(
            "Halve the time step and look whether the error follows its order; proofmass trade "
            "does so for all settings."
        )
    if outcomes & {Outcome.TIMED_OUT, Outcome.OUT_OF_MEMORY}:
        words.append(
            "Find what keeps the run busy, or give it more: timeout and memory of its table [run]."
        )
    if outcomes & {Outcome.DIVERGED, Outcome.CRASHED}:
        words.append(
            "Begin with the start pose of a run that is lost, then halve its time step; its curves "
            "are drawn until its loss where the engine had any, and what the engine said stands "
            "with the solver below."
        )
    return words


def defaults(rows: list[Comparison]) -> list[str]:
    """How much worse engines are by themselves, where a case shows that."""
    words = []
    for c in {c.solver: c for c in rows}.values():
        engine, _, variant = c.solver.partition(":")
        if variant != "default":
            continue
        own = [r for r in rows if r.run == c.run and kind_of(r.unit) == "position"]
        shares = [
            max(
                (r.relative_to_range for r in own if r.solver == name and r.error_max >= 0),
                default=0.0,
            )
            for name in (engine, c.solver)
        ]
        if all(shares) and shares[1] > shares[0]:
            words.append(
                f"{format_solver(engine)} with its defaults reaches {number(shares[1], 2)} in "
                f"position instead of {number(shares[0], 2)}; the settings are in the tables below."
            )
    return words


def texts(case: Case) -> dict[str, str]:
    """The sidecar and the MJCF as they stand in their files."""
    found = {}
    for file in (case.file, case.model_path):
        try:
            found[file.name] = Path(file).read_text(encoding="utf-8-sig")[:LONGEST]
        except (OSError, UnicodeDecodeError):  # the runs have said so
            continue
    return found


ROWS = 3  # causes that are shown


@dataclass(frozen=True)
class CauseRow:
    """One thing that was changed to explain what differs; its place is that of the error left."""

    words: str
    fitted: str
    explains: str
    left: str
    place: float


@dataclass(frozen=True)
class CausePanel:
    """What explains the differences of runs, best first, or what happened until a loss.

    Attributes
    ----------
    title : str
    lines : tuple of str
        Sentences below the title.
    where : str
        Which runs it tells of.
    rows : tuple of CauseRow
        Of the first of these runs.
    tried : str
    """

    title: str
    lines: tuple[str, ...]
    where: str
    rows: tuple[CauseRow, ...] = ()
    tried: str = ""


def causes(case: Case, diagnoses: Mapping[tuple[str, str, str], Diagnosis]) -> list[CausePanel]:
    """What there is to tell of a case: a panel for lost runs, and for each different first cause.

    Runs of which the same is told share a panel.
    """
    own = [found for (name, *_), found in diagnoses.items() if name == case.name]
    lost = [found for found in own if found.lost]
    differing = [found for found in own if not found.lost]
    return [
        *(lost_panel(some) for some in alike(lost, lambda d: tuple(d.lines))),
        *(cause_panel(some) for some in alike(differing, lambda d: (d.lines[0],))),
    ]


def alike(
    found: Iterable[Diagnosis], key: Callable[[Diagnosis], tuple[str, ...]]
) -> list[list[Diagnosis]]:
    """Those with the same key together, in the order of the first of them."""
    groups: dict[tuple[str, ...], list[Diagnosis]] = {}
    for one in found:
        groups.setdefault(key(one), []).append(one)
    return list(groups.values())


def lost_panel(found: list[Diagnosis]) -> CausePanel:
    """The panel of lost runs of which the same is told."""
    return CausePanel("What happened", tuple(found[0].lines), together(found))


def cause_panel(found: list[Diagnosis]) -> CausePanel:
    """The panel of runs with the same first cause; its rows are those of the first run."""
    first = found[0]
    if first.fault:
        return CausePanel("Why it differs was not found out", (first.fault,), together(found))
    tried = format_list(first.tried)
    rows = tuple(cause_row(first, cause) for cause in first.causes[:ROWS])
    unchanged = CauseRow("nothing changed", "", "", "1", place(1.0))
    if not rows or first.causes[0].score <= 0:
        title = "Cause: none of those that were tried"
        return CausePanel(
            title, first.remarks, together(found), (*rows, unchanged) if rows else (), tried
        )
    best = first.causes[0]
    words = [f"as good: {format_list(best.same)}"] * bool(best.same)
    # the first line is the title, and the rows tell the next best
    effect, *rest = (line for line in first.lines[1:] if not line.startswith("next best: "))
    lines = (effect, *(line for line in rest if line not in words), *words)
    return CausePanel(f"Cause: {best.words}", lines, together(found), (*rows, unchanged), tried)


def cause_row(diagnosis: Diagnosis, cause: Explanation) -> CauseRow:
    """A row of the table of causes."""
    wrong = f", {len(cause.breaks)} wrong" if cause.breaks else ""
    changes = (f"{n} {number(a, 6)} → {number(b, 6)}" for n, (a, b) in cause.changes.items())
    return CauseRow(
        ", ".join(changes) or cause.words,
        str(cause.fitted),
        f"{len(cause.explains)} of {len(diagnosis.differing)}{wrong}",
        number(cause.left, 2),
        place(cause.left),
    )


def together(found: list[Diagnosis]) -> str:
    """Which runs a panel tells of, with what their first cause explains of each."""
    many = f"The same in {len(found)} runs: " if len(found) > 1 else "In one run: "
    return many + format_list(map(run_words, found)) + "."


def run_words(found: Diagnosis) -> str:
    """A run, and how many of its channels its first cause explains."""
    words = f"{format_solver(found.solver)} {RUNS[found.run].where}"
    if not found.causes or found.causes[0].score <= 0:
        return words
    explained, there = len(found.causes[0].explains), len(found.differing)
    return f"{words} ({explained} of {there} curves)"


FIRST = 4  # groups of numbers that the first screen shows; the others open below them


@dataclass(frozen=True)
class NoticedRow:
    """A number, and the smallest change of it that a run notices, in words."""

    name: str
    change: str
    share: str
    by: str


@dataclass(frozen=True)
class NoticedPanel:
    """What is told of the coverage of a case.

    Attributes
    ----------
    unnoticed, more : tuple of str
        Groups of numbers of the model that no run notices, with the reason where one can be told.
    not_tried : str
        Why no number of the model was tried; empty if they were.
    reads, tried : str
        What the reference reads, and what was tried of the model.
    parameters, numbers : tuple of NoticedRow
        Of the reference and of the model, the most sensitive first.
    refused : tuple of str
        Numbers with which runs are refused or lost.
    """

    unnoticed: tuple[str, ...]
    more: tuple[str, ...]
    not_tried: str
    reads: str
    tried: str
    parameters: tuple[NoticedRow, ...]
    numbers: tuple[NoticedRow, ...]
    refused: tuple[str, ...]


def noticed(case: Case) -> NoticedPanel | None:
    """What was found of a case as it is now; None if `proofmass explain` was not asked of it."""
    with suppress(InputError, OSError):  # which the command says as soon as it is asked
        found = stored_coverage(case)
        return None if found is None else panel_of(case, found)
    return None


def panel_of(case: Case, found: Coverage) -> NoticedPanel:
    """The panel of a coverage."""
    lines = tuple(not_noticed(case, found))
    known = sorted(
        (one for one in found.parameters if one.noticed and not one.refused),
        key=lambda one: one.measure,
    )
    told = [one for one in found.noticed if not one.refused]
    return NoticedPanel(
        lines[:FIRST],
        lines[FIRST:],
        not_tried(case, found) if found.left_out or not found.numbers else "",
        told_of_reference(case, found),
        TRIED,
        tuple(map(row_of, known)),
        tuple(map(row_of, told)),
        tuple(sorted(refusals([one for one in found.noticed if one.refused]))),
    )


def row_of(one: Finding) -> NoticedRow:
    """The row of a number that is noticed."""
    return NoticedRow(*cells_of(one), f"{one.channel}, {one.run}, {format_solver(one.solver)}")
