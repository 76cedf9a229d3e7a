"""The page of a stress study: what breaks first, and every boundary as a row on one axis.

The axis tells by which factor each parameter was increased or decreased from the case's own value.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from math import isfinite, log10
from pathlib import Path
from typing import Any

from matplotlib import rc_context

from proofmass.errors import InputError
from proofmass.report.figures import save
from proofmass.report.marks import MARKS, Tone, tones
from proofmass.report.page import slug
from proofmass.report.strip import Strip, place
from proofmass.report.study import Pages, Written, prepared
from proofmass.report.style import RC, looks
from proofmass.studies.stress.boundary import Boundary, BoundaryKind
from proofmass.studies.stress.figure import NEAR, factor_to, stress_sheet
from proofmass.studies.stress.page_data import KINDS, end, limits_data, measured, solver_of
from proofmass.studies.stress.stress import read_boundaries
from proofmass.wording import format_solver, number

SCRIPTS = ("axes.js", "rows.js", "limits.js")
"""Of the chart."""
THEORY = "Small models whose limits theory knows"


def write_stress(folder: Path | str, output: Path | str, home: str = "") -> Written:
    """Write the page of a study, ``index.html``, and its figures, from its table alone.

    Raises
    ------
    InputError
        There is no ``stress.csv`` in the folder.
    """
    file, output = Path(folder) / "stress.csv", Path(output)
    if not file.is_file():
        raise InputError(file, "", "no such file; proofmass stress writes it")
    found = read_boundaries(file)
    prepared(output, (file, file.with_name("stress.columns.md")), SCRIPTS)
    engines = list(dict.fromkeys(one.engine for one in found))
    chosen = looks(engines)
    there = list(dict.fromkeys(one.limit for one in found))
    looked = [look for limit, look in KINDS.items() if limit in there]
    colours = tones([look.colour for look in chosen.values()] + [look.colour for look in looked])
    dressed = {name: colours[look.colour] for name, look in chosen.items()}
    own = [(name, list(some)) for name, some in groupby(found, lambda one: subject(one))]
    parts = [part(name, some, output / "figures", dressed) for name, some in own]
    charted = [
        (one["name"], one["stem"], by_parameter(some))
        for one, (_, some) in zip(parts, own, strict=True)
    ]
    page = Pages(output, home, SCRIPTS).write(
        "index.html",
        "stress.html",
        limits_data(charted, colours),
        parts=parts,
        kinds=[(MARKS[look.marker], colours[look.colour].css, look.words) for look in looked],
        limits=list(BoundaryKind),
        there=there,
        engines=[(name, format_solver(name), dressed[name].css) for name in engines],
        tones=colours.values(),
    )
    return Written(page, {one["name"]: f"{page.name}#{one['stem']}" for one in parts})


def subject(one: Boundary) -> str:
    """What a section of the page is about: a case, or all that theory knows."""
    return THEORY if one.law and " " in one.what else one.what  # words, not a sidecar's name


def part(
    name: str, found: Sequence[Boundary], folder: Path, dressed: Mapping[str, Tone]
) -> dict[str, Any]:
    """All that a page shows of one case."""
    stem = f"{slug(name)}-stress"
    with rc_context(RC):
        save(stress_sheet(found), folder / stem)
    known = all(one.theory == one.theory for one in found)
    reach = max((far(one) for one in found), default=1.0)
    return {
        "name": name,
        "stem": stem,
        "words": list(words(found)),
        "first": list(breaks_first(found)),
        "engines": list(dict.fromkeys(format_solver(one.engine) for one in found)),
        "several": len({one.what for one in found}) > 1,
        "known": known,
        "theory": any(one.theory == one.theory for one in found),
        "labels": labels(reach),
        "ratios": [(place_ratio(ratio), number(ratio)) for ratio in (1 - NEAR, 1.0, 1 + NEAR)],
        "rows": [cells(one, dressed[one.engine], reach) for one in by_parameter(found)],
    }


def by_parameter(found: Sequence[Boundary]) -> list[Boundary]:
    """Boundaries of a parameter side by side, parameters in the order in which they come first."""
    parameters = list(dict.fromkeys(one.parameter for one in found))
    return sorted(found, key=lambda one: parameters.index(one.parameter))


def far(one: Boundary) -> float:
    """The furthest place of a boundary on its axis: what was measured, or where theory has it."""
    there = [end(one), one.theory]
    return max((factor_to(one, x) for x in there if isfinite(x) and x > 0), default=1.0)


def labels(reach: float) -> list[tuple[float, str]]:
    """Places on the axis of a part [%], and what stands there."""
    decades = int(log10(max(reach, 10.0)) + 1e-9)
    step = max(1, -(-decades // 4))
    return [
        (place(10.0**k, 1.0, reach), f"×1e{k}" if k > 3 else f"×{10**k}")
        for k in range(0, decades + 1, step)
    ]


def place_ratio(ratio: float) -> float:
    """Place of measured over theory on its axis [%], on which `NEAR` is half of the way."""
    return min(max(50 + 25 * (ratio - 1) / NEAR, 0.0), 100.0)


def breaks_first(found: Sequence[Boundary]) -> Iterator[dict[str, Any]]:
    """For each parameter and engine the boundary that is met first, of all settings."""
    engines = list(dict.fromkeys(one.engine for one in found))
    for parameter in dict.fromkeys(one.parameter for one in found):
        own = [one for one in found if one.parameter == parameter]
        yield {
            "parameter": parameter,
            "cells": [first([one for one in own if one.engine == name]) for name in engines],
        }


def first(found: Sequence[Boundary]) -> dict[str, str]:
    """The boundary that is met first, in words."""
    lost = [one for one in found if one.found or (one.holds != one.holds and not one.unknown)]
    if not found:
        return {"value": "—", "more": ""}
    if not lost:
        return {
            "value": measured(min(found, key=lambda one: factor_to(one, one.reach))),
            "more": "",
        }
    one = min(lost, key=lambda one: factor_to(one, end(one)) if one.found else 1.0)
    silence = ", in silence" if one.silent else ""
    return {"value": measured(one), "more": f"{one.setting}: {one.limit}{silence}"}


def words(found: Sequence[Boundary]) -> Iterator[str]:
    """What to make of it."""
    known = [one for one in found if one.theory == one.theory]
    if known:
        near = sum(abs(one.ratio - 1) <= NEAR for one in known)
        yield (
            f"{near} of {len(known)} boundaries that theory knows were measured within "
            f"{NEAR:.0%} of it."
        )
    silent = [one for one in found if one.found and one.silent]
    if silent:
        yield (
            f"{len(silent)} of {sum(one.found for one in found)} boundaries are passed in "
            f"silence: the engine says nothing."
        )
    for one in found:
        if one.holds != one.holds:
            yield (
                f"{format_solver(one.engine)}, {one.setting}: {one.parameter} cannot be varied, "
                f"{one.failure}"
            )


def strip_of(one: Boundary, tone: Tone, reach: float) -> Strip:
    """How far a parameter was varied, and where theory ends it."""
    at = end(one)
    dot = place(factor_to(one, at), 1.0, reach) if isfinite(at) and at > 0 else None
    tick = None
    if isfinite(one.theory) and one.theory > 0:
        tick = place(factor_to(one, one.theory), 1.0, reach)
    said = f"{one.parameter}, {solver_of(one)}: {measured(one)}"
    if one.theory == one.theory:
        said += f"; theory {number(one.theory, 4)}"
    mark = "o" if one.found else "X" if one.unknown else ">"
    return Strip(
        said,
        tone.css,
        [x for x, _ in labels(reach)],
        mark=MARKS[mark],
        hollow=one.silent,
        dot=dot,
        bar=None if dot is None else (0.0, dot),
        tick=tick,
    )


def ratio_of(one: Boundary, tone: Tone) -> Strip:
    """How near to theory a boundary is that theory knows."""
    return Strip(
        f"measured over theory: {number(one.ratio, 4)}",
        tone.css,
        [place_ratio(1.0)],
        mark=MARKS["o"],
        dot=place_ratio(one.ratio),
        band=(place_ratio(1 - NEAR), place_ratio(1 + NEAR) - place_ratio(1 - NEAR)),
    )


def cells(one: Boundary, tone: Tone, reach: float) -> dict[str, Any]:
    """A row of the table, every number already a word."""
    at = end(one)
    return {
        "what": one.what,
        "engine": one.engine,
        "solver": solver_of(one),
        "css": tone.css,
        "parameter": one.parameter,
        "start": number(one.start),
        "measured": measured(one),
        "value": factor_to(one, at) if isfinite(at) and at > 0 else "",
        "theory": number(one.theory, 4),
        "ratio": number(one.ratio, 4),
        "ratio_value": one.ratio if one.ratio == one.ratio else "",
        "law": one.law,
        "failure": one.why,
        "silent": "in silence" if one.silent else "",
        "limit": "" if one.limit == BoundaryKind.HOLDS else str(one.limit),
        "groups": f"{one.engine}|{one.limit}",
        "strip": strip_of(one, tone, reach),
        "near": ratio_of(one, tone) if one.ratio == one.ratio else None,
    }
