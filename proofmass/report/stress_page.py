"""The page of a study of extremes: the figure, what it means in words, and the table."""

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from markupsafe import Markup
from matplotlib import rc_context

from proofmass.errors import InputError
from proofmass.files import write_whole
from proofmass.report.figures import save
from proofmass.report.pages import about, environment, slug
from proofmass.report.stress_sheet import NEAR, stress_sheet
from proofmass.report.study import Written, prepared
from proofmass.report.style import RC
from proofmass.report.svg import inline
from proofmass.studies.stress.boundary import Boundary, Limit
from proofmass.studies.stress.stress import read_boundaries
from proofmass.wording import number, pretty, spoken

THEORY = "Small models whose limits theory knows"
CAPTION = ("Bars: as far as each knob was turned until the run was lost; black ticks: where theory "
           "says that it must be. Each boundary is bisected to 1 %. Where nothing is known beyond "
           "a bar, for a reason of our own, it ends in a cross.")


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
    prepared(output, (file, file.with_name("stress.columns.md")))
    parts = [part(name, list(own), output / "figures")
             for name, own in groupby(found, lambda one: subject(one))]
    page = output / "index.html"
    write_whole(page, environment().get_template("stress.html").render(
        parts=parts, limits=list(Limit), about=about(), style={}, home=home))
    return Written(page, {one["name"]: f"{page.name}#{one['stem']}" for one in parts})


def subject(one: Boundary) -> str:
    """What a section of the page is about: a case, or all that theory knows."""
    return THEORY if one.law and " " in one.what else one.what  # words, not a sidecar's name


def part(name: str, found: Sequence[Boundary], folder: Path) -> dict[str, Any]:
    """All that a page shows of one case."""
    stem = f"{slug(name)}-stress"
    with rc_context(RC):
        svg = save(stress_sheet(found), folder / stem)
    return {"name": name, "stem": stem, "caption": CAPTION, "words": list(words(found)),
            "svg": Markup(inline(svg, stem, f"{name}: {CAPTION}")),
            "rows": [cells(one) for one in found]}


def words(found: Sequence[Boundary]) -> Iterator[str]:
    """What to make of it."""
    known = [one for one in found if one.theory == one.theory]
    if known:
        near = sum(abs(one.ratio - 1) <= NEAR for one in known)
        yield (f"{near} of {len(known)} boundaries that theory knows were measured within "
               f"{NEAR:.0%} of it.")
    silent = [one for one in found if one.found and one.silent]
    if silent:
        yield (f"{len(silent)} of {sum(one.found for one in found)} boundaries are passed in "
               f"silence: the engine says nothing.")
    for one in found:
        if one.holds != one.holds:
            yield (f"{spoken(one.engine)}, {one.setting}: nothing to turn at {one.knob}, "
                   f"{one.failure}")


def cells(one: Boundary) -> dict[str, str]:
    """A row of the table, every number already a word."""
    unit = "" if one.unit == "1" else pretty(one.unit)
    none = f"none to {number(one.reach)}"
    if one.unknown:
        none = f"not known beyond {number(one.holds)}" if one.holds == one.holds else "not known"
    elif one.holds != one.holds:
        none = "nowhere"
    return {"what": one.what, "solver": f"{spoken(one.engine)}, {one.setting}", "knob": one.knob,
            "unit": unit, "start": number(one.start),
            "measured": number(one.measured, 4) if one.found else none,
            "theory": number(one.theory, 4), "ratio": number(one.ratio, 4), "law": one.law,
            "failure": one.why, "silent": "in silence" if one.silent else "",
            "limit": "" if one.limit == Limit.HOLDS else str(one.limit)}
