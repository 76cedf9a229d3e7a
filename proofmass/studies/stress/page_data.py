"""What the chart of a stress page shows, as one dict for its script.

A row is a boundary: from where to where its parameter holds, where it ends, and what theory says.
Numbers that are none are None.
"""

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any, NamedTuple

from proofmass.report.case_data import finite
from proofmass.report.marks import MARKS, Tone
from proofmass.studies.stress.boundary import Boundary, BoundaryKind, exactly
from proofmass.wording import format_solver, number, pretty


class KindLook(NamedTuple):
    """Marker and colour of a kind of limit, and what it means in few words."""

    marker: str
    colour: str
    words: str


KINDS = {
    BoundaryKind.UNSTABLE: KindLook("D", "#D55E00", "unstable: the run is lost"),
    BoundaryKind.INACCURATE: KindLook("o", "#0072B2", "inaccurate"),
    BoundaryKind.REFUSED: KindLook("s", "#7b4ba0", "refused by the engine"),
    BoundaryKind.OURS: KindLook("X", "#555555", "not known beyond"),
    BoundaryKind.HOLDS: KindLook(">", "#00755e", "holds to the end"),
}
"""Told apart by shape where there is no colour."""
DOWNWARDS = "<"
"""Marker of what holds to the end where a parameter was decreased."""


def limits_data(
    parts: Iterable[tuple[str, str, Iterable[Boundary]]], tones: Mapping[str, Tone]
) -> dict[str, Any]:
    """All that the chart shows.

    Parameters
    ----------
    parts : iterable of tuple
        Name, stem, and boundaries in the order of their table, whose row k has the id ``STEM-k``.
    tones : mapping
        Of the colours of `KINDS`.
    """
    parts = [(name, stem, list(found)) for name, stem, found in parts]
    return {
        "parts": [{"name": name, "stem": stem} for name, stem, _ in parts],
        "rows": [
            row(one, stem, f"{stem}-{k}", tones[KINDS[one.limit].colour], name)
            for name, stem, found in parts
            for k, one in enumerate(found)
        ],
    }


def row(one: Boundary, stem: str, key: str, tone: Tone, part: str) -> dict[str, Any]:
    """A row of the chart."""
    look, down = KINDS[one.limit], one.reach < one.start
    held = one.holds == one.holds
    at = end(one) if held else one.start
    return {
        "part": stem,
        "id": key,
        "panel": one.parameter + ("" if one.unit in ("1", "times") else f" [{pretty(one.unit)}]"),
        "label": solver_of(one) if one.what == part else f"{solver_of(one)}: {one.what}",
        "named": one.what != part,
        "value": measured(one),
        "start": one.start if held else None,
        "at": finite(at),
        "down": down,
        "theory": one.theory if isfinite(one.theory) and one.theory > 0 else None,
        "found": one.found or not held,
        "silent": one.silent,
        "css": tone.css,
        "mark": MARKS[DOWNWARDS if down and one.limit == BoundaryKind.HOLDS else look.marker],
        "said": sentence(one),
    }


def end(one: Boundary) -> float:
    """Where a bar ends: the boundary, or the furthest value that held; NaN without any."""
    return one.measured if one.found else one.holds


def solver_of(one: Boundary) -> str:
    """Engine and setting in words, once where they are the same."""
    engine = format_solver(one.engine)
    return engine if one.setting == engine else f"{engine}, {one.setting}"


def with_unit(one: Boundary, value: str) -> str:
    """A value of the parameter in words."""
    if one.unit == "times":
        return f"× {value}"
    return value + ("" if one.unit == "1" else f" {pretty(one.unit)}")


def measured(one: Boundary) -> str:
    """A boundary in words, with its unit."""
    unit = "" if one.unit == "1" else f" {pretty(one.unit)}"
    if one.found:
        return f"{one.format_measured(4)}{unit}"
    if one.unknown:
        known = one.holds == one.holds
        return f"not known beyond {number(one.holds)}{unit}" if known else "not known"
    return f"none to {number(one.reach)}{unit}" if one.holds == one.holds else "nowhere"


def sentence(one: Boundary) -> str:
    """What became of a boundary.

    >>> found = Boundary("fourbar", "mujoco", "Euler", "time step", "s", 1e-3, 1.0, 0.1, 0.101,
    ...     limit=BoundaryKind.INACCURATE, failure="position off by 0.1", silent=True, theory=0.1)
    >>> sentence(found)
    'Holds up to 0.1 s and fails at 0.101 s: inaccurate, in silence: position off by 0.1. Theory: \
0.1 s, of which it is 1.005.'
    """
    way = "down" if one.reach < one.start else "up"
    if one.holds != one.holds:
        words = (
            f"Does not hold at {with_unit(one, number(one.start))}, the first value: {one.ending}."
        )
    elif one.found:
        told = exactly if one.several else number
        words = (
            f"Holds {way} to {with_unit(one, told(one.holds))} and fails at "
            f"{with_unit(one, told(one.breaks))}: {one.ending}."
        )
        if one.several:
            last = with_unit(one, one.last)
            words += f" Beyond, some values hold and others do not, up to {last}."
    elif one.unknown:
        words = f"Held {way} to {with_unit(one, number(one.holds))}; not known beyond: {one.why}."
    else:
        words = (
            f"Holds {way} to {with_unit(one, number(one.reach))}, the last value that was tried."
        )
    return words + theory(one)


def theory(one: Boundary) -> str:
    """What theory says, as one more sentence; nothing where it says nothing."""
    if one.theory != one.theory:
        return ""
    law = f" ({one.law})" if one.law else ""
    if not isfinite(one.theory) or not one.theory:
        return f" Theory: no limit{law}."
    of = f", of which it is {number(one.ratio, 4)}" if one.ratio == one.ratio else ""
    return f" Theory: {with_unit(one, number(one.theory, 4))}{of}{law}."
