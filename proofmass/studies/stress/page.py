"""The page of a stress study: the first boundary of each parameter, and a row for each boundary.

The axis of a row shows by which factor a parameter was increased or decreased from the case's own
value: the range in which it holds, its boundary, and the boundary by theory.  Values that are not
finite numbers are None in the data of the page's script.  `stress_figure` draws the same rows for
papers.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from math import isfinite, log10
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from proofmass.report.style import LABEL_COLOUR, RC, Look, engine_hatches, solver_looks  # isort: skip
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from proofmass.base.wording import format_unit, number
from proofmass.report.case_data import finite_or_none
from proofmass.report.figures import label_row, save
from proofmass.report.page import slug
from proofmass.report.strip import Strip, log_place
from proofmass.report.study import PageWriter, StudyPages, prepare_folder, require_table
from proofmass.report.svg_markers import MARKER_PATHS, Tone, page_tones
from proofmass.sim.engines import format_solver
from proofmass.studies.stress.boundary import (
    Boundary,
    BoundaryKind,
    format_exactly,
    read_boundaries,
)

LIMITS_SCRIPTS = ("axes.js", "rows.js", "limits.js")
"""Scripts of the chart."""
THEORY_SECTION = "Small models whose limits theory knows"


def write_stress(folder: Path | str, output: Path | str, home: str = "") -> StudyPages:
    """Write the page of a study, ``index.html``, and its figures, from its table ``stress.csv``.

    Raises
    ------
    InputError
        There is no ``stress.csv`` in the folder.
    """
    file, output = require_table(folder, "stress.csv", "stress"), Path(output)
    found = read_boundaries(file)
    prepare_folder(output, (file, file.with_name("stress.columns.md")), LIMITS_SCRIPTS)
    engines = list(dict.fromkeys(one.engine for one in found))
    chosen = solver_looks(engines)
    kinds_found = list(dict.fromkeys(one.limit for one in found))
    kind_looks = [look for limit, look in KIND_LOOKS.items() if limit in kinds_found]
    colours = page_tones(
        [look.colour for look in chosen.values()] + [look.colour for look in kind_looks]
    )
    engine_tones = {name: colours[look.colour] for name, look in chosen.items()}
    own = [(name, list(some)) for name, some in groupby(found, lambda one: section_of(one))]
    parts = [section_data(name, some, output / "figures", engine_tones) for name, some in own]
    charted = [
        (one["name"], one["stem"], by_parameter(some))
        for one, (_, some) in zip(parts, own, strict=True)
    ]
    page = PageWriter(output, home, LIMITS_SCRIPTS).write(
        "index.html",
        "stress.html",
        limits_data(charted, colours),
        parts=parts,
        kinds=[
            (MARKER_PATHS[look.marker], colours[look.colour].css, look.words) for look in kind_looks
        ],
        limits=list(BoundaryKind),
        there=kinds_found,
        engines=[(name, format_solver(name), engine_tones[name].css) for name in engines],
        tones=colours.values(),
    )
    return StudyPages(page, {one["name"]: f"{page.name}#{one['stem']}" for one in parts})


def section_of(one: Boundary) -> str:
    """The section of the page that a boundary belongs to: its case, or the small models."""
    return (
        THEORY_SECTION if one.law and " " in one.what else one.what
    )  # words, not a sidecar's name


def section_data(
    name: str, found: Sequence[Boundary], folder: Path, engine_tones: Mapping[str, Tone]
) -> dict[str, Any]:
    """The data of one section of the page, and its figure in a folder."""
    stem = f"{slug(name)}-stress"
    with rc_context(RC):
        save(stress_figure(found), folder / stem)
    known = all(one.theory == one.theory for one in found)
    reach = max((largest_factor(one) for one in found), default=1.0)
    return {
        "name": name,
        "stem": stem,
        "words": list(summary_sentences(found)),
        "first": list(nearest_boundaries(found)),
        "engines": list(dict.fromkeys(format_solver(one.engine) for one in found)),
        "several": len({one.what for one in found}) > 1,
        "known": known,
        "theory": any(one.theory == one.theory for one in found),
        "labels": axis_ticks(reach),
        "ratios": [
            (place_ratio(ratio), number(ratio))
            for ratio in (1 - THEORY_TOLERANCE, 1.0, 1 + THEORY_TOLERANCE)
        ],
        "rows": [table_row(one, engine_tones[one.engine], reach) for one in by_parameter(found)],
    }


def by_parameter(found: Sequence[Boundary]) -> list[Boundary]:
    """Boundaries grouped by parameter, in the order in which the parameters occur first."""
    parameters = list(dict.fromkeys(one.parameter for one in found))
    return sorted(found, key=lambda one: parameters.index(one.parameter))


def largest_factor(one: Boundary) -> float:
    """The largest factor on the axis of a boundary, by measurement or by theory."""
    there = [bar_end(one), one.theory]
    return max((factor_to(one, x) for x in there if isfinite(x) and x > 0), default=1.0)


def axis_ticks(reach: float) -> list[tuple[float, str]]:
    """Places of the ticks on the axis of a section [%], and their labels."""
    decades = int(log10(max(reach, 10.0)) + 1e-9)
    step = max(1, -(-decades // 4))
    return [
        (log_place(10.0**k, 1.0, reach), f"×1e{k}" if k > 3 else f"×{10**k}")
        for k in range(0, decades + 1, step)
    ]


def place_ratio(ratio: float) -> float:
    """Place of measured over theory on its axis [%]; `THEORY_TOLERANCE` is half way to an end."""
    return min(max(50 + 25 * (ratio - 1) / THEORY_TOLERANCE, 0.0), 100.0)


def nearest_boundaries(found: Sequence[Boundary]) -> Iterator[dict[str, Any]]:
    """For each parameter and engine the nearest boundary of all settings."""
    engines = list(dict.fromkeys(one.engine for one in found))
    for parameter in dict.fromkeys(one.parameter for one in found):
        own = [one for one in found if one.parameter == parameter]
        yield {
            "parameter": parameter,
            "cells": [
                nearest_boundary([one for one in own if one.engine == name]) for name in engines
            ],
        }


def nearest_boundary(found: Sequence[Boundary]) -> dict[str, str]:
    """The nearest of some boundaries as text, and its setting and kind of limit."""
    failed = [one for one in found if one.found or (one.holds != one.holds and not one.unknown)]
    if not found:
        return {"value": "—", "more": ""}
    if not failed:
        return {
            "value": format_boundary(min(found, key=lambda one: factor_to(one, one.reach))),
            "more": "",
        }
    one = min(failed, key=lambda one: factor_to(one, bar_end(one)) if one.found else 1.0)
    silence = ", in silence" if one.silent else ""
    return {"value": format_boundary(one), "more": f"{one.setting}: {one.limit}{silence}"}


def summary_sentences(found: Sequence[Boundary]) -> Iterator[str]:
    """Sentences that summarize the boundaries of a section."""
    known = [one for one in found if one.theory == one.theory]
    if known:
        near = sum(abs(one.ratio - 1) <= THEORY_TOLERANCE for one in known)
        yield (
            f"{near} of {len(known)} boundaries that theory knows were measured within "
            f"{THEORY_TOLERANCE:.0%} of it."
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


def boundary_strip(one: Boundary, tone: Tone, reach: float) -> Strip:
    """The strip of a row: how far the parameter holds, and its boundary by theory."""
    at = bar_end(one)
    dot = log_place(factor_to(one, at), 1.0, reach) if isfinite(at) and at > 0 else None
    tick = None
    if isfinite(one.theory) and one.theory > 0:
        tick = log_place(factor_to(one, one.theory), 1.0, reach)
    said = f"{one.parameter}, {format_engine_setting(one)}: {format_boundary(one)}"
    if one.theory == one.theory:
        said += f"; theory {number(one.theory, 4)}"
    mark = "o" if one.found else "X" if one.unknown else ">"
    return Strip(
        said,
        tone.css,
        [x for x, _ in axis_ticks(reach)],
        mark=MARKER_PATHS[mark],
        hollow=one.silent,
        dot=dot,
        bar=None if dot is None else (0.0, dot),
        tick=tick,
    )


def ratio_strip(one: Boundary, tone: Tone) -> Strip:
    """The strip that shows the ratio of a measured boundary to that by theory."""
    return Strip(
        f"measured over theory: {number(one.ratio, 4)}",
        tone.css,
        [place_ratio(1.0)],
        mark=MARKER_PATHS["o"],
        dot=place_ratio(one.ratio),
        band=(
            place_ratio(1 - THEORY_TOLERANCE),
            place_ratio(1 + THEORY_TOLERANCE) - place_ratio(1 - THEORY_TOLERANCE),
        ),
    )


def table_row(one: Boundary, tone: Tone, reach: float) -> dict[str, Any]:
    """A row of the table, with all numbers formatted as text."""
    at = bar_end(one)
    return {
        "what": one.what,
        "engine": one.engine,
        "solver": format_engine_setting(one),
        "css": tone.css,
        "parameter": one.parameter,
        "start": number(one.start),
        "measured": format_boundary(one),
        "value": factor_to(one, at) if isfinite(at) and at > 0 else "",
        "theory": number(one.theory, 4),
        "ratio": number(one.ratio, 4),
        "ratio_value": one.ratio if one.ratio == one.ratio else "",
        "law": one.law + (f"; to do: {one.remedy}" if one.remedy else ""),
        "failure": one.why,
        "silent": "in silence" if one.silent else "",
        "limit": "" if one.limit == BoundaryKind.HOLDS else str(one.limit),
        "groups": f"{one.engine}|{one.limit}",
        "strip": boundary_strip(one, tone, reach),
        "near": ratio_strip(one, tone) if one.ratio == one.ratio else None,
    }


class KindLook(NamedTuple):
    """Marker and colour of a kind of limit, and a short description."""

    marker: str
    colour: str
    words: str


KIND_LOOKS = {
    BoundaryKind.UNSTABLE: KindLook("D", "#D55E00", "unstable: the run fails"),
    BoundaryKind.INACCURATE: KindLook("o", "#0072B2", "inaccurate"),
    BoundaryKind.REFUSED: KindLook("s", "#7b4ba0", "refused by the engine"),
    BoundaryKind.OURS: KindLook("X", "#555555", "not known beyond"),
    BoundaryKind.HOLDS: KindLook(">", "#00755e", "holds to the end"),
}
"""Looks of the kinds of limits; the markers distinguish them without colour."""
DOWNWARD_MARKER = "<"
"""Marker of a parameter that was decreased and holds to its last value."""


def limits_data(
    parts: Iterable[tuple[str, str, Iterable[Boundary]]], tones: Mapping[str, Tone]
) -> dict[str, Any]:
    """The data of the chart.

    Parameters
    ----------
    parts : iterable of tuple
        Name, stem, and boundaries of each section, in the order of its table, whose row k has the
        id ``STEM-k``.
    tones : mapping
        Tones of the colours of `KIND_LOOKS`.
    """
    parts = [(name, stem, list(found)) for name, stem, found in parts]
    return {
        "parts": [{"name": name, "stem": stem} for name, stem, _ in parts],
        "rows": [
            chart_row(one, stem, f"{stem}-{k}", tones[KIND_LOOKS[one.limit].colour], name)
            for name, stem, found in parts
            for k, one in enumerate(found)
        ],
    }


def chart_row(one: Boundary, stem: str, key: str, tone: Tone, part: str) -> dict[str, Any]:
    """A row of the chart."""
    look, down = KIND_LOOKS[one.limit], one.reach < one.start
    start_holds = one.holds == one.holds
    at = bar_end(one) if start_holds else one.start
    return {
        "part": stem,
        "id": key,
        "panel": one.parameter
        + ("" if one.unit in ("1", "times") else f" [{format_unit(one.unit)}]"),
        "label": format_engine_setting(one)
        if one.what == part
        else f"{format_engine_setting(one)}: {one.what}",
        "named": one.what != part,
        "value": format_boundary(one),
        "start": one.start if start_holds else None,
        "at": finite_or_none(at),
        "down": down,
        "theory": one.theory if isfinite(one.theory) and one.theory > 0 else None,
        "found": one.found or not start_holds,
        "silent": one.silent,
        "css": tone.css,
        "mark": MARKER_PATHS[
            DOWNWARD_MARKER if down and one.limit == BoundaryKind.HOLDS else look.marker
        ],
        "said": describe_boundary(one),
    }


def bar_end(one: Boundary) -> float:
    """The end of a bar: the boundary, or the furthest value that holds; NaN if there is neither."""
    return one.measured if one.found else one.holds


def format_engine_setting(one: Boundary) -> str:
    """Engine and setting as text, only once if they are the same."""
    engine = format_solver(one.engine)
    return engine if one.setting == engine else f"{engine}, {one.setting}"


def with_unit(one: Boundary, value: str) -> str:
    """A value of the parameter as text, with its unit."""
    if one.unit == "times":
        return f"× {value}"
    return value + ("" if one.unit == "1" else f" {format_unit(one.unit)}")


def format_boundary(one: Boundary) -> str:
    """The boundary with its unit, as the page shows it."""
    return one.describe(format_unit(one.unit), 4)


def describe_boundary(one: Boundary) -> str:
    """A description of a boundary in one or more sentences.

    >>> found = Boundary("fourbar", "mujoco", "Euler", "time step", "s", 1e-3, 1.0, 0.1, 0.101,
    ...     limit=BoundaryKind.INACCURATE, failure="position off by 0.1", silent=True, theory=0.1)
    >>> describe_boundary(found)
    'Holds up to 0.1 s and fails at 0.101 s: inaccurate, in silence: position off by 0.1. Theory: \
0.1 s, of which it is 1.005.'
    """
    way = "down" if one.reach < one.start else "up"
    if one.holds != one.holds:
        words = (
            f"Does not hold at {with_unit(one, number(one.start))}, the first value: {one.ending}."
        )
    elif one.found:
        format_value = format_exactly if one.several else number
        words = (
            f"Holds {way} to {with_unit(one, format_value(one.holds))} and fails at "
            f"{with_unit(one, format_value(one.breaks))}: {one.ending}."
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
    remedy = f" To do: {one.remedy}." if one.remedy else ""
    return words + describe_theory(one) + remedy


def describe_theory(one: Boundary) -> str:
    """A sentence with the boundary by theory; empty if no theory is known."""
    if one.theory != one.theory:
        return ""
    law = f" ({one.law})" if one.law else ""
    if not isfinite(one.theory) or not one.theory:
        return f" Theory: no limit{law}."
    of = f", of which it is {number(one.ratio, 4)}" if one.ratio == one.ratio else ""
    return f" Theory: {with_unit(one, number(one.theory, 4))}{of}{law}."


LIMITS_ROW_HEIGHT, LIMITS_WIDTH, LIMITS_MARGIN = (0.17, 7.2, 0.75)
"""Height of a row, width of the figure, and upper and lower margin [inch]."""
COLOUR_SHARE = 0.35  # share of an engine's colour in its bars; the rest is white
Style = tuple[Look, str]
"""Look and hatch of an engine."""
THEORY_TOLERANCE = 0.02
"""Relative deviation from theory up to which a measured boundary agrees with it."""


def stress_figure(found: Sequence[Boundary]) -> Figure:
    """A figure with a bar for each boundary, grouped by parameter.

    If theory is known for all, the axis shows values and a second column the ratios to theory;
    otherwise the axis shows factors on the first value.
    """
    known = all(one.theory == one.theory for one in found)
    groups = [
        (parameter, [one for one in found if one.parameter == parameter])
        for parameter in dict.fromkeys(one.parameter for one in found)
    ]
    rows = len(found) + len(groups)
    height = LIMITS_ROW_HEIGHT * rows + 2 * LIMITS_MARGIN
    figure = Figure(figsize=(LIMITS_WIDTH, height))
    axes = figure.subplots(
        1, 2 if known else 1, sharey=True, squeeze=False, width_ratios=[3, 1] if known else None
    )[0]
    y, styles = float(rows), engine_styles(found)
    for parameter, ours in groups:
        unit = "" if ours[0].unit in ("1", "times") or not known else f" [{ours[0].unit}]"
        label_row(axes[0], parameter + unit, y - 0.15, fontweight="bold")
        for one in ours:
            y -= 1
            draw_bar(axes[0], one, y, known, styles[one.engine])
            if known and one.ratio == one.ratio:
                look = styles[one.engine][0]
                axes[1].plot(one.ratio, y, color=look.colour, marker=look.marker, markersize=4)
        y -= 1
    format_axes(axes, found, rows, known)
    figure.subplots_adjust(
        left=0.41, right=0.98, bottom=0.55 / height, top=1 - 0.5 / height, wspace=0.06
    )
    draw_legend(figure, found, height)
    return figure


def engine_styles(found: Sequence[Boundary]) -> dict[str, Style]:
    """The look and the hatch of every engine."""
    engines = list(dict.fromkeys(one.engine for one in found))
    chosen, lines = solver_looks(engines), engine_hatches(engines)
    return {name: (chosen[name], lines[name]) for name in engines}


def draw_bar(ax: Axes, one: Boundary, y: float, known: bool, style: Style) -> None:
    """Draw a boundary: a bar from its first value to its last, and a marker at its end."""
    label = f"{one.what}, {one.setting}" if known else f"{format_solver(one.engine)}, {one.setting}"
    label_row(ax, label, y, fontsize=6.5)
    low, high = bar_ends(one, known)
    colour = style[0].colour
    if one.holds != one.holds:
        ax.annotate(
            "not known" if one.unknown else "failed from the start",
            (0.01, y),
            xycoords=("axes fraction", "data"),
            fontsize=6.5,
            va="center",
        )
        return
    ax.barh(y, high - low, left=low, height=0.6, **bar_fill(style))
    marker = "o" if one.found else "X" if one.unknown else ">"
    ax.plot(
        high,
        y,
        marker=marker,
        color=colour,
        markersize=4.5,
        clip_on=False,
        markerfacecolor="white" if one.silent else colour,
    )
    if np.isfinite(one.theory) and one.theory:
        place = one.theory if known else factor_to(one, one.theory)
        ax.plot([place] * 2, [y - 0.42, y + 0.42], color="black", linewidth=1.3, zorder=4)
    if not known and one.found:
        unit = {"times": "×", "1": ""}.get(one.unit, one.unit)
        ax.annotate(
            f"{one.format_measured()} {unit}",
            (high, y),
            xytext=(6, 0),
            fontsize=6.5,
            textcoords="offset points",
            va="center",
        )


def bar_fill(style: Style) -> dict[str, Any]:
    """The arguments that draw an engine's bars: a pale fill, and a hatch in its colour.

    The fill is an opaque mixture with white.  With a translucent fill an SVG would draw the
    background of the hatch in the same colour as its lines.
    """
    colour = style[0].colour
    return {
        "facecolor": 1 - COLOUR_SHARE * (1 - np.array(to_rgb(colour))),
        "edgecolor": colour,
        "hatch": style[1],
        "linewidth": 0.4,
    }


def bar_ends(one: Boundary, known: bool) -> tuple[float, float]:
    """Both ends of a bar: values if theory is known for all, otherwise factors on the start."""
    end = one.measured if one.found else one.holds if one.unknown else one.reach
    if known:
        return one.start, end
    return 1.0, factor_to(one, end)


def factor_to(one: Boundary, value: float) -> float:
    """The factor by which a parameter was increased or decreased to a value."""
    return max(value / one.start, one.start / value)


def format_axes(axes: Sequence[Axes], found: Sequence[Boundary], rows: int, known: bool) -> None:
    """Set scales and labels of the axes, and draw the band of agreement with theory."""
    axes[0].set_xscale("log")
    axes[0].set_ylim(-0.2, rows + 0.3)
    axes[0].set_yticks([])
    axes[0].set_xlabel(
        "value of the parameter" if known else "factor, up or down, on the case's own value"
    )
    left = min(bar_ends(one, known)[0] for one in found)
    holding = (bar_ends(one, known)[1] for one in found if one.holds == one.holds)
    room = 1.3 if known else 60.0  # factor on the axis for text at the ends of bars
    axes[0].set_xlim(left * 0.9, max(holding, default=left) * room)
    if known:
        axes[1].axvspan(1 - THEORY_TOLERANCE, 1 + THEORY_TOLERANCE, color="#eeeeee", zorder=0)
        axes[1].axvline(1.0, color=LABEL_COLOUR, linewidth=0.8)
        axes[1].set_xlim(1 - 1.6 * THEORY_TOLERANCE, 1 + 1.6 * THEORY_TOLERANCE)
        axes[1].set_xlabel("measured / theory")


def draw_legend(figure: Figure, found: Sequence[Boundary], height: float) -> None:
    """Draw the legend: the engines, and the meaning of the markers at the ends of bars."""
    handles: list[Patch | Line2D] = [
        Patch(label=format_solver(e), **bar_fill(style))
        for e, style in engine_styles(found).items()
    ]
    plain: dict[str, Any] = {"color": LABEL_COLOUR, "linestyle": "", "markersize": 4.5}
    handles += [
        Line2D([], [], marker="o", label="failed, and said so", **plain),
        Line2D([], [], marker="o", markerfacecolor="white", label="failed in silence", **plain),
        Line2D([], [], marker=">", label="holds to the end", **plain),
    ]
    if any(one.unknown for one in found):
        handles.append(Line2D([], [], marker="X", label="not known beyond", **plain))
    if any(np.isfinite(one.theory) and one.theory for one in found):
        handles.append(
            Line2D(
                [],
                [],
                marker="|",
                markeredgewidth=1.3,
                label="theory",
                **{**plain, "color": "black", "markersize": 8},
            )
        )
    figure.legend(
        handles=handles,
        loc="upper left",
        ncols=len(handles),
        fontsize=7,
        bbox_to_anchor=(0.0, 1 - 0.02 / height),
        handletextpad=0.4,
        columnspacing=1.2,
    )
