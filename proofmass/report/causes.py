"""The panels of a case's first screen that tell why runs differ, and what happened to lost ones."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from proofmass.case import Case
from proofmass.diagnosis import Diagnosis, Explanation
from proofmass.report.overview import place
from proofmass.report.words import RUNS
from proofmass.wording import listed, number, spoken

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
    tried = listed(first.tried)
    rows = tuple(cause_row(first, cause) for cause in first.causes[:ROWS])
    unchanged = CauseRow("nothing changed", "", "", "1", place(1.0))
    if not rows or first.causes[0].score <= 0:
        title = "Cause: none of those that were tried"
        return CausePanel(
            title, first.remarks, together(found), (*rows, unchanged) if rows else (), tried
        )
    best = first.causes[0]
    words = [f"as good: {listed(best.same)}"] * bool(best.same)
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
    return many + listed(map(run_words, found)) + "."


def run_words(found: Diagnosis) -> str:
    """A run, and how many of its channels its first cause explains."""
    words = f"{spoken(found.solver)} {RUNS[found.run].where}"
    if not found.causes or found.causes[0].score <= 0:
        return words
    explained, there = len(found.causes[0].explains), len(found.differing)
    return f"{words} ({explained} of {there} curves)"
