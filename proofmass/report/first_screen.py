"""The panels of a case's first screen: badge, what is not checked, what to do."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from proofmass.case import Case
from proofmass.compare import Comparison
from proofmass.outcome import CHECKED, LOST, Outcome
from proofmass.report import tables
from proofmass.report.data import Shown
from proofmass.report.style import PAPERS, Look, legible
from proofmass.report.words import RUNS, kind_of
from proofmass.wording import listed, number, spoken

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
            spoken(engine),
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
    lost = dict.fromkeys(c.outcome for c in rows if c.outcome in LOST)
    words = []
    if differs:
        words.append(f"Differs: {differs} of {len(judged)} checked curves")
    if lost:
        solvers = {(c.run, c.solver) for c in rows if c.outcome in LOST}
        words.append(f"{len(solvers)} run{'s' * (len(solvers) > 1)} {listed(map(str, lost))}")
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
        lines += [f"{spoken_line(line)} ({where})" for line in tables.missing(run)]
        for solver in run.solvers:
            own = [c for c in run.rows if c.solver == solver]
            bare = [c.channel for c in own if c.outcome == Outcome.UNCHECKED]
            if not bare:
                continue
            what = "all channels" if len(bare) == len(own) else listed(bare)
            lines.append(f"{spoken(solver)} {where}, {what}: shown and not judged.")
    return lines


def spoken_line(line: str) -> str:
    """A line of `tables.missing` with the engine as it is called in sentences."""
    solver, comma, rest = line.partition(",")
    return f"{spoken(solver)}{comma}{rest}"


def advice(case: Case, rows: list[Comparison], faults: list[str], state: str) -> list[str]:
    """What there is to do, in sentences."""
    outcomes = {c.outcome for c in rows}
    if faults or not rows:
        return ["Mend the input: the message above names the file and the key."]
    if Outcome.DIFFERS not in outcomes and not outcomes & set(LOST):
        if state == "bad":
            return ["Give the case a [[tolerance]] that covers a channel, or say unchecked = true."]
        if Outcome.AGREES not in outcomes:
            return ["Nothing: the sidecar says that nothing is checked."]
        return [
            "Nothing: every checked curve is inside its allowance.",
            *defaults(rows),
        ]
    words = []
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
                f"{spoken(engine)} with its defaults reaches {number(shares[1], 2)} in position "
                f"instead of {number(shares[0], 2)}; the settings are in the tables below."
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
