"""The sentences of the report."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from proofmass.base.grouping import group_by
from proofmass.base.units import MOTION_UNITS, si_unit
from proofmass.base.wording import format_list, format_range_share, format_share, number
from proofmass.case.case import Case
from proofmass.sim.engines import format_solver
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import (
    CHECKED_OUTCOMES,
    EMPTY_OUTCOMES,
    FAILED_OUTCOMES,
    GOOD_OUTCOMES,
    UNCHECKED_OUTCOMES,
    Outcome,
)


class RunWords(NamedTuple):
    """Names of a kind of run on pages.

    Attributes
    ----------
    label : str
        Name in a list of runs.
    title : str
        Title above a table.
    heading : str
        Heading above its curves.
    where : str
        Phrase in a sentence.
    group : str
        Group of columns of the index that it belongs to.
    """

    label: str
    title: str
    heading: str
    where: str
    group: str


RUNS = {
    "sweep": RunWords(
        "Sweep",
        "Sweep, quasi-static",
        "Sweep: the mechanism pose by pose, no time stepping",
        "in the sweep",
        "quasi-static",
    ),
    "equilibrium": RunWords(
        "Equilibrium",
        "Equilibrium, along the rods",
        "Equilibrium: the shapes of the rods, along their length",
        "at rest",
        "quasi-static",
    ),
    "dynamics": RunWords(
        "Dynamics",
        "Dynamics, stepped in time",
        "Dynamics: the motion over time, as each engine steps it",
        "in dynamics",
        "dynamics",
    ),
}
"""Names by kind of run, in the order of a page.  No case has both a sweep and an equilibrium."""
SYMBOLS: dict[str, str] = {
    Outcome.AGREES: "✓",
    Outcome.DIFFERS: "✗",
    Outcome.UNDECIDED: "?",
    **dict.fromkeys(EMPTY_OUTCOMES, "✗"),
    Outcome.UNCHECKED: "○",
    Outcome.SELF_CONSISTENT: "≈",
    Outcome.MEASURED: "·",
    Outcome.UNSUPPORTED: "–",
    Outcome.UNAVAILABLE: "–",
    **dict.fromkeys(FAILED_OUTCOMES, "⚠"),
}


START_RATIO = 2.0
"""Ratio of the largest error to that after a tenth of the run, from which on it is of the start."""


def group_by_solver(comparisons: Iterable[Comparison], *runs: str) -> dict[str, list[Comparison]]:
    """Group the comparisons of one or several runs by their solver."""
    return group_by((c for c in comparisons if c.run in runs), lambda c: c.solver)


def headline(
    case: Case, comparisons: Iterable[Comparison], steps: Mapping[str, float] | None = None
) -> str:
    """Format the verdict on a case in one line: what agrees, what does not, and why.

    Parameters
    ----------
    case : Case
    comparisons : iterable of Comparison
        Comparisons of this case; those of other cases are ignored.
    steps : mapping of str to float, optional
        Time step of each solver in the dynamics run [s].

    Returns
    -------
    str
    """
    own = [c for c in comparisons if c.case == case.name]
    if not own:
        return "Not judged: no run could be compared; the input is at fault."
    if is_unchecked(own):
        parts = format_unchecked(group_by_solver(own, *case.run))
        words = "; ".join(parts).removeprefix(f"{Outcome.UNCHECKED}: ")
        first = "Unchecked, as the sidecar says" if case.unchecked else "Nothing is checked"
        return f"{first}: {words}."
    quiet = [kind for kind in ("sweep", "equilibrium") if kind in case.run] or ["sweep"]
    sweep, dynamics = group_by_solver(own, *quiet), group_by_solver(own, "dynamics")
    within = " and ".join(quiet)
    true, false = ("The model matches the reference", "The model does not match the reference")
    if case.reads_model:
        true, false = (
            "The model moves as its own numbers say",
            "The model does not move as its own numbers and laws say",
        )
    if any(c.outcome == Outcome.DIFFERS for rows in sweep.values() for c in rows):
        sound = format_list(format_solver(s) for s, rows in sweep.items() if all_agree(rows))
        text = f"{true} in {sound}, not in every solver: " if sound else f"{false}: "
        text += "; ".join(
            describe_solver(s, rows, f" in the {within}")
            for s, rows in sweep.items()
            if not all_agree(rows) and not is_unchecked(rows)
        )
        return text + "; do not look at integrators before this is mended."
    if not sweep:
        first = "No sweep, so model and integrator are judged together"
    elif good := {s: rows for s, rows in sweep.items() if all_agree(rows)}:
        first = f"{true}: {format_agreement(good, within)}"
    else:
        first = f"The {within} was not checked, so model and integrator are judged together"
    parts = [
        describe_solver(s, rows, f" in the {within}")
        for s, rows in sweep.items()
        if any(c.outcome in (*FAILED_OUTCOMES, *EMPTY_OUTCOMES) for c in rows)
    ]
    refined = group_by_solver(own, "refine")
    if sure := [format_solver(s) for s, rows in refined.items() if all_agree(rows)]:
        parts.append(
            f"{format_list(sure)} converge{'s' * (len(sure) == 1)} with the expected order"
        )
    parts += [
        describe_solver(s, rows, " in its order of convergence")
        for s, rows in refined.items()
        if not all_agree(rows) and not is_unchecked(rows)
    ]
    parts += [
        describe_solver(
            s,
            rows,
            f" at dt = {number(1e3 * steps[s])} ms" if steps and s in steps else " in dynamics",
        )
        for s, rows in dynamics.items()
        if not is_unchecked(rows)
    ]
    parts += format_unchecked({s: rows for s, rows in dynamics.items() if is_unchecked(rows)})
    joint = "" if not parts else ". " if first.startswith(true) else ": "
    return first + joint + "; ".join(parts) + "."


def all_agree(rows: list[Comparison]) -> bool:
    """Whether something was checked, and all of it agrees."""
    outcomes = {c.outcome for c in rows}
    return Outcome.AGREES in outcomes and not outcomes & {
        Outcome.DIFFERS,
        Outcome.UNDECIDED,
        *EMPTY_OUTCOMES,
        *FAILED_OUTCOMES,
    }


def is_unchecked(rows: list[Comparison]) -> bool:
    """Whether nothing was checked, and nothing failed."""
    return {c.outcome for c in rows} <= set(UNCHECKED_OUTCOMES)


def format_agreement(good: dict[str, list[Comparison]], run: str) -> str:
    """Format how many channels of a run agree, for the solvers that agree, and why not all."""
    counts = {
        s: (sum(c.outcome == Outcome.AGREES for c in rows), len(rows)) for s, rows in good.items()
    }
    names = format_list(map(format_solver, counts))
    if all(n == total for n, total in counts.values()):
        return f"all {next(iter(counts.values()))[1]} channels of the {run} agree in {names}"
    return f"the {run} agrees on " + format_list(
        f"{'all ' + str(n) if n == total else f'{n} of {total}'} channels in {format_solver(s)}"
        f"{format_unsupported(good[s])}"
        for s, (n, total) in counts.items()
    )


def format_unsupported(rows: list[Comparison]) -> str:
    """Format in brackets why a solver cannot deliver channels; empty if it delivers all."""
    found = dict.fromkeys(c.message for c in rows if c.outcome == Outcome.UNSUPPORTED and c.message)
    return f" ({'; '.join(found)})" if found else ""


def describe_solver(solver: str, rows: list[Comparison], where: str) -> str:
    """Format the outcome of one solver in one run as a clause."""
    bad = [c for c in rows if c.outcome == Outcome.DIFFERS]
    failed = next((c.outcome for c in rows if c.outcome in FAILED_OUTCOMES), "")
    name = format_solver(solver)
    if failed:
        return f"{name} {failed}{where}"
    if bad:
        worst = max(bad, key=lambda c: c.share_of_allowed)
        return (
            f"{name} differs{where} on {format_list(c.channel for c in bad)}"
            f" (worst {worst.channel}: {worst.message})"
        )
    if coarse := [c for c in rows if c.outcome == Outcome.UNDECIDED]:
        return (
            f"{name} is undecided{where} on {format_list(c.channel for c in coarse)} "
            "(known too coarsely to tell)"
        )
    there = {c.outcome for c in rows}
    if empty := next((one for one in EMPTY_OUTCOMES if one in there), None):
        return f"{name} tells nothing{where} ({empty}: {empty.sentence})"
    agreed = sum(c.outcome == Outcome.AGREES for c in rows)
    return f"{name} agrees{where}" + (
        "" if agreed == len(rows) else f" on {agreed} of {len(rows)} channels"
    )


def format_unchecked(rows: dict[str, list[Comparison]]) -> list[str]:
    """Format the solvers that are not judged by the outcomes of their curves, and their errors."""
    found: dict[str, list[str]] = {Outcome.UNCHECKED: [], Outcome.MEASURED: []}
    unsupported = []
    for solver, comparisons in rows.items():
        there, name = {c.outcome for c in comparisons}, format_solver(solver)
        if (outcome := next((one for one in found if one in there), None)) is None:
            unsupported.append(name)
            continue
        away = format_errors(comparisons)
        found[outcome].append(f"{name} (off by {format_list(away)})" if away else name)
    parts = [f"{outcome}: {format_list(own)}" for outcome, own in found.items() if own]
    return parts + ([f"not expressible in {format_list(unsupported)}"] if unsupported else [])


def format_errors(rows: Iterable[Comparison]) -> list[str]:
    """Format the largest errors of positions, velocities, accelerations, and all other channels.

    If an error is at least twice the largest one after the first tenth of dynamics, both are given.
    """
    kinds: dict[str, list[Comparison]] = {kind: [] for kind in (*MOTION_UNITS, "force or energy")}
    for c in rows:
        if math.isfinite(c.relative_to_range):
            kind = quantity_kind(c.unit)
            kinds[kind if kind in MOTION_UNITS else "force or energy"].append(c)
    words = list[str]()
    for kind, own in kinds.items():
        if not own:
            continue
        share, later = (
            max(c.relative_to_range for c in own),
            max(c.relative_to_range_later for c in own),
        )
        text = f"{format_share(share)}{' of the range' * (not words)} in {kind}"
        if share >= START_RATIO * later:
            text += f" at the start, {format_share(later)} after a tenth of the run"
        words.append(text)
    return words


FORCES_AND_ENERGIES = {"moment": ("N m",), "force": ("N",), "energy": ("J",)}


def quantity_kind(unit: str) -> str:
    """Return the kind of a channel by its unit, such as position, moment or energy, or "other".

    >>> quantity_kind("deg/s"), quantity_kind("N mm"), quantity_kind("kg")
    ('velocity', 'moment', 'other')
    """
    own = si_unit(unit)[0]
    kinds = {**MOTION_UNITS, **FORCES_AND_ENERGIES}
    return next((kind for kind, units in kinds.items() if own in units), "other")


def format_closeness(case: Case, comparisons: Iterable[Comparison]) -> str:
    """Format in one sentence how well the engines agree: the worst checked curve of each run.

    It is a position where the run has one, otherwise the next kind that it has.  Curves that no
    tolerance covers are used only where no curve is checked.
    """
    rows = [c for c in comparisons if math.isfinite(c.relative_to_range) and c.run in case.run]
    judged = [c for c in rows if c.outcome in CHECKED_OUTCOMES]
    texts: dict[str, list[str]] = {}
    for run, words_of in RUNS.items():
        own = [c for c in judged or rows if c.run == run]
        for kind in (*MOTION_UNITS, *FORCES_AND_ENERGIES, "other"):
            if here := [c.relative_to_range for c in own if quantity_kind(c.unit) == kind]:
                share = format_range_share(max(here), "{}")
                texts.setdefault(kind, []).append(f"{share} {words_of.where}")
                break
    words = []
    to = "differ by up to" if any(c.outcome == Outcome.DIFFERS for c in rows) else "to"
    for kind, parts in texts.items():
        name = {"velocity": "velocities", "energy": "energies", "other": "curves"}.get(
            kind, f"{kind}s"
        )
        shares = ", ".join(
            part.format("their") if k == 0 else part.replace(" of {} range", "")
            for k, part in enumerate(parts)
        )
        words.append(f"{name} {to} {shares}")
    unjudged = "Not checked: " if words and not judged else ""
    text = "; ".join(words)
    return f"{unjudged}{text[:1].upper()}{text[1:]}." if text else ""


def case_state(case: Case, rows: Sequence[Comparison], faults: Sequence[str]) -> str:
    """Return the state of a case: good (agrees), open (unchecked, as its sidecar says), or bad."""
    outcomes = {c.outcome for c in rows}
    checked = case.unchecked or outcomes - set(UNCHECKED_OUTCOMES)
    if faults or not checked or outcomes - set(GOOD_OUTCOMES):
        return "bad"
    return "good" if Outcome.AGREES in outcomes else "open"
