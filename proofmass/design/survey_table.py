"""The table of a survey as CSV and JSON, and its figure: error against what must be built."""

import csv
import json
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

from proofmass.report.style import RC  # isort: skip
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from proofmass.analytic.balancer.synthesis import Variant
from proofmass.base.files import write_output
from proofmass.base.wording import format_count
from proofmass.design.survey import EXACT_ERROR, KindResult, Survey

SEGMENT_COLOURS = {2: "#666666", 3: "#0072B2", 4: "#D55E00"}
"""Colours of Okabe and Ito by the number of segments, and grey."""
SPRING_MARKERS = {"linear": "o", "nonlinear": "s", "each": "^"}
"""Markers by the kind of springs."""
DOT_SHIFT = 0.12
"""Shift of the dots of a number of segments beside the number of parts, to keep them apart [1]."""


def record_survey(survey: Survey, name: str) -> dict[str, Any]:
    """The survey as JSON has it."""
    return {
        "target": name,
        "claim": survey.claim,
        "evaluations": survey.evaluations,
        "descents": survey.descents,
        "searches": survey.passes,
        "kinds": [record_kind(kind) for kind in survey.kinds],
        "without_design": [describe_variant(variant) for variant in survey.impossible],
    }


def describe_variant(variant: Variant) -> dict[str, Any]:
    """What is free in a kind."""
    return {
        "segments": variant.segments,
        "kind_of_springs": variant.springs,
        "free_preloads": list(variant.preload),
        "contact": variant.contact,
        "free_angle": variant.free_angle,
        "relaxed": variant.relaxed,
        "elbow": "up" if variant.mode == 1 else "down",
    }


def record_kind(kind: KindResult) -> dict[str, Any]:
    """A kind with its best design as JSON has it; errors over m g r [1], other numbers in SI."""
    parts = kind.parts
    return {
        "kind": kind.words,
        "optimal": kind.optimal,
        "rmse": kind.rmse,
        "largest_error": kind.worst,
        "largest_error_at": kind.worst_angle,
        "work_reduction": kind.work_reduction,
        "parts": parts.count,
        "springs": list(parts.springs),
        "no_springs": list(parts.no_springs),
        "nonlinear_springs": list(parts.nonlinear),
        "preloads": list(parts.preloads),
        "stops": list(parts.stops),
        "confirmed": kind.confirmed,
        "searches_that_agree": kind.agreeing,
        "errors_of_searches": list(kind.searches),
        "at_bounds": list(kind.at_bounds),
        **describe_variant(kind.variant),
        "parameters": kind.parameters,
    }


def write_table(survey: Survey, name: str, stem: Path) -> list[Path]:
    """Write the survey to CSV, JSON, SVG and PNG files, and return their paths."""
    record = record_survey(survey, name)
    write_output(stem.with_suffix(".csv"), table_text(record["kinds"]))
    write_output(stem.with_suffix(".json"), json.dumps(record, indent=1))
    with rc_context(RC):
        figure = draw_survey(survey, name)
        for ending in ("svg", "png"):
            drawn = BytesIO()
            figure.savefig(drawn, format=ending, dpi=150)
            write_output(stem.with_suffix(f".{ending}"), drawn.getvalue())
    return [stem.with_suffix(ending) for ending in (".csv", ".json", ".svg", ".png")]


def table_text(rows: list[dict[str, Any]]) -> str:
    """The rows as CSV: joints separated by blanks, and a column for each parameter."""
    names = sorted({name for row in rows for name in row["parameters"]})
    plain = [key for key in rows[0] if key != "parameters"]
    table = StringIO(newline="")
    writer = csv.writer(table)
    writer.writerow([*plain, *names])
    for row in rows:
        cells = [" ".join(map(str, v)) if isinstance(v := row[key], list) else v for key in plain]
        writer.writerow([*cells, *(row["parameters"].get(name, "") for name in names)])
    return table.getvalue()


def draw_survey(survey: Survey, name: str) -> Figure:
    """A dot for each kind: its error over its number of parts, with the Pareto-optimal ones."""
    figure = Figure((7.0, 4.6), layout="constrained")
    axes = figure.subplots()
    for kind in survey.kinds:
        draw_kind(axes, kind)
    front = survey.front
    axes.step(
        [kind.parts.count for kind in front],
        [kind.rmse for kind in front],
        where="post",
        color="#888888",
        zorder=1,
    )
    for kind in front:
        axes.annotate(
            short_words(kind),
            (kind.parts.count, kind.rmse),
            xytext=(0, -9),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=6.5,
        )
    least, most = (f([kind.rmse for kind in survey.kinds]) for f in (min, max))
    axes.set(
        xlabel="parts: segments + springs + stops, and one for each preload and nonlinear spring",
        ylabel="root mean square error / m g r",
        yscale="log",
        ylim=(least / 4, most * 2),
        title=f"The best design of each of {len(survey.kinds)} kinds for {name}",
    )
    counts = [kind.parts.count for kind in survey.kinds]
    axes.set_xticks(range(min(counts), max(counts) + 1))
    axes.set_xlim(min(counts) - 1.0, max(counts) + 0.7)
    if least < EXACT_ERROR:
        axes.axhline(EXACT_ERROR, color="#bbbbbb", linestyle=":", zorder=0)
        axes.text(
            max(counts) + 0.6,
            EXACT_ERROR,
            "below this all count as equal",
            ha="right",
            va="bottom",
            fontsize=6.5,
        )
    axes.legend(handles=legend_handles(survey), loc="upper right", ncols=2)
    return figure


def draw_kind(axes: Axes, kind: KindResult) -> None:
    """A dot: filled if the kind is Pareto-optimal, pale otherwise."""
    n = kind.variant.segments
    axes.plot(
        kind.parts.count + (n - 3) * DOT_SHIFT * (not kind.optimal),
        kind.rmse,
        SPRING_MARKERS[kind.variant.springs],
        color=SEGMENT_COLOURS[n],
        markersize=6.5 if kind.optimal else 3.5,
        markeredgecolor="black" if kind.optimal else SEGMENT_COLOURS[n],
        markeredgewidth=0.8 if kind.optimal else 0.0,
        alpha=1.0 if kind.optimal else 0.45,
        zorder=3 if kind.optimal else 2,
    )


def legend_handles(survey: Survey) -> list[Any]:
    """Handles of the legend for the numbers of segments and the springs that occur."""
    segments = sorted({kind.variant.segments for kind in survey.kinds})
    springs = [s for s in SPRING_MARKERS if any(k.variant.springs == s for k in survey.kinds)]
    words = {"linear": "linear springs", "nonlinear": "equal nonlinear", "each": "nonlinear"}
    found = [
        Line2D([], [], color=SEGMENT_COLOURS[n], marker="o", linestyle="", label=f"{n} segments")
        for n in segments
    ]
    found += [
        Line2D([], [], color="#444444", marker=SPRING_MARKERS[s], linestyle="", label=words[s])
        for s in springs
    ]
    return [
        *found,
        Line2D(
            [], [], color="#888888", marker="o", markeredgecolor="black", label="Pareto-optimal"
        ),
    ]


def short_words(kind: KindResult) -> str:
    """The parts of a design in a few words, for the figure."""
    parts = kind.parts
    words = [format_count(parts.segments, "segment"), format_count(len(parts.springs), "spring")]
    words += [f"{len(parts.nonlinear)} nonlinear"] * bool(parts.nonlinear)
    words += [format_count(len(parts.preloads), "preload")] * bool(parts.preloads)
    words += [format_count(len(parts.stops), "stop")] * bool(parts.stops)
    return "\n".join(words)
