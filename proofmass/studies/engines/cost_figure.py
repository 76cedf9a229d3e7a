"""The figure of engines at equal cost, as SVG in a page: error over time, a line for each engine.

Lines have the colours, dashes and markers of solvers in all figures, and their names at their
ends, so that a print in black and white can be read.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from math import ceil, floor, log10
from typing import NamedTuple

from proofmass.report.figures import SUPERSCRIPTS
from proofmass.report.style import Look, solver_looks
from proofmass.report.svg_markers import MARKER_PATHS, Tone, page_tones
from proofmass.sim.engines import format_solver

SVG_WIDTH, SVG_HEIGHT = 760.0, 440.0
"""Size of a figure [px]: its letters have the size of those around it in a column of a page."""
LEFT, RIGHT, TOP, BOTTOM = 62.0, 122.0, 12.0, 46.0
"""Margins around the panel [px]; the right one has the names of engines."""
LABEL_GAP = 15.0
"""Least distance of two names [px], the height of their letters."""
DRAWN_ERRORS = 1e-17, 10.0
"""Errors that are drawn [ranges]; those beyond are drawn at the edge."""
LABELLED_DECADES = 3.5
"""Decades of times up to which 2 and 5 have numbers as well: there is room for them."""
SHORTEST_DECADES = 1.0
"""Least width of an axis [decades]."""


class DrawnSetting(NamedTuple):
    """A marker: time with its interval [s per simulated s], error [1], and its words."""

    low: float
    time: float
    high: float
    error: float
    words: str


@dataclass(frozen=True)
class LineLook:
    """How an engine looks on a page: CSS class, path of the marker, and dash pattern.

    The page defines the marker once, with the identifier ``mark-`` and the class.
    """

    title: str
    css: str
    mark: str
    dash: str


@dataclass(frozen=True)
class EngineLine:
    """The line of an engine: its front, and its other settings, which have no line."""

    look: LineLook
    front: list[DrawnSetting]
    others: list[DrawnSetting]


def engine_looks(engines: Sequence[str]) -> tuple[dict[str, LineLook], list[Tone]]:
    """The look of each engine, and the tones of a page for their colours."""
    looks: dict[str, Look] = solver_looks(engines)
    tones = page_tones(looks[engine].colour for engine in engines)
    return {
        engine: LineLook(
            format_solver(engine),
            tones[looks[engine].colour].css,
            MARKER_PATHS[looks[engine].marker],
            " ".join(f"{part:g}" for part in looks[engine].dash[1]),
        )
        for engine in engines
    }, list(tones.values())


@dataclass(frozen=True)
class CostAxes:
    """Logarithmic axes: the decades at their ends."""

    left: float
    right: float
    bottom: float
    top: float

    def x(self, time: float) -> float:
        """Place of a time [px]."""
        share = (log10(time) - self.left) / (self.right - self.left)
        return round(LEFT + share * (SVG_WIDTH - LEFT - RIGHT), 1)

    def y(self, error: float) -> float:
        """Place of an error [px], at the edge if it is beyond `DRAWN_ERRORS`."""
        drawn = min(max(error, DRAWN_ERRORS[0]), DRAWN_ERRORS[1])
        share = (log10(drawn) - self.bottom) / (self.top - self.bottom)
        return round(SVG_HEIGHT - BOTTOM - share * (SVG_HEIGHT - TOP - BOTTOM), 1)


def panel_around(settings: Sequence[DrawnSetting], errors: Iterable[float]) -> CostAxes:
    """Axes with room for all settings, and for the errors that are asked for."""
    times = [end for one in settings for end in (one.low, one.high)]
    levels = [one.error for one in settings] + list(errors)
    drawn = [min(max(one, DRAWN_ERRORS[0]), DRAWN_ERRORS[1]) for one in levels]
    left, right = log10(min(times)) - 0.1, log10(max(times)) + 0.1
    middle, half = (left + right) / 2, max(right - left, SHORTEST_DECADES) / 2
    return CostAxes(middle - half, middle + half, log10(min(drawn)) - 0.5, log10(max(drawn)) + 0.3)


def draw_costs(lines: Sequence[EngineLine], errors: Sequence[float], label: str) -> str:
    """The figure as SVG; empty if no engine has a setting.

    Parameters
    ----------
    lines : sequence of EngineLine
    errors : sequence of float
        Errors with a level line, as shares of the range [1].
    label : str
        What a reader who sees no figure is told.
    """
    settings = [one for line in lines for one in (*line.front, *line.others)]
    if not settings:
        return ""
    panel = panel_around(settings, errors)
    parts = [
        f'<svg viewBox="0 0 {SVG_WIDTH:g} {SVG_HEIGHT:g}" role="img" aria-label="{escape(label)}">',
        *draw_axes(panel),
        *draw_levels(panel, errors),
    ]
    for line in lines:
        parts += draw_line(panel, line)
    parts += draw_names(panel, [line for line in lines if line.front])
    return "\n".join([*parts, "</svg>"])


def draw_axes(panel: CostAxes) -> Iterator[str]:
    """Lines at decades with their numbers, and the names of the axes."""
    bottom, right = SVG_HEIGHT - BOTTOM, SVG_WIDTH - RIGHT
    for decade in range(floor(panel.left), floor(panel.right) + 1):
        for digit in (1, 2, 5):
            x = panel.x(digit * 10.0**decade)
            if not LEFT <= x <= right:
                continue
            words = power(decade) if digit == 1 else f"{digit}"
            yield f'<path class="hair" d="M{x} {TOP:g}V{bottom:g}"/>'
            if digit == 1 or panel.right - panel.left < LABELLED_DECADES:
                yield f'<text x="{x}" y="{bottom + 17:g}" text-anchor="middle">{words}</text>'
    decades = range(ceil(panel.bottom), floor(panel.top) + 1)
    for decade in decades:
        y = panel.y(10.0**decade)
        yield f'<path class="hair" d="M{LEFT:g} {y}H{right:g}"/>'
        if decade % (1 if len(decades) < 8 else 2) == 0:
            yield f'<text x="{LEFT - 7:g}" y="{y + 4}" text-anchor="end">{power(decade)}</text>'
    yield f'<path class="frame" d="M{LEFT:g} {TOP:g}V{bottom:g}H{right:g}"/>'
    middle = (LEFT + right) / 2
    yield (
        f'<text x="{middle:g}" y="{SVG_HEIGHT - 8:g}" text-anchor="middle">'
        "processor time of the steps per simulated second [s]</text>"
    )
    yield (
        f'<text transform="translate(14 {(TOP + bottom) / 2:g}) rotate(-90)" '
        'text-anchor="middle">error, share of the range</text>'
    )


def power(decade: int) -> str:
    """A power of ten.

    >>> power(-3)
    '10⁻³'
    """
    return "10" + str(decade).translate(SUPERSCRIPTS)


def draw_levels(panel: CostAxes, errors: Iterable[float]) -> Iterator[str]:
    """Level lines at the errors for which engines are ranked."""
    for error in errors:
        yield f'<path class="level" d="M{LEFT:g} {panel.y(error)}H{SVG_WIDTH - RIGHT:g}"/>'


def draw_line(panel: CostAxes, line: EngineLine) -> Iterator[str]:
    """The front of an engine with its intervals of time, and its other settings as dots."""
    look = line.look
    yield f'<g class="{look.css}">'
    dots = "".join(f"M{panel.x(one.time)} {panel.y(one.error)}h0" for one in line.others)
    if dots:  # one path: there are hundreds
        yield f'<path class="other" d="{dots}"/>'
    points = [(panel.x(one.time), panel.y(one.error)) for one in line.front]
    path = " ".join(f"{x},{y}" for x, y in points)
    dash = f' stroke-dasharray="{look.dash}"' if look.dash else ""
    yield f'<polyline class="line" points="{path}"{dash}/>'
    for one, (x, y) in zip(line.front, points, strict=True):
        if one.high > one.low:
            yield f'<path class="spread" d="M{panel.x(one.low)} {y}H{panel.x(one.high)}"/>'
        yield (
            f'<use class="point" href="#mark-{look.css}" x="{x}" y="{y}">'
            f"<title>{escape(one.words)}</title></use>"
        )
    yield "</g>"


def draw_names(panel: CostAxes, lines: Sequence[EngineLine]) -> Iterator[str]:
    """The names of engines in the margin, each led to the end of its line."""
    lowest_first = sorted(lines, key=lambda line: -panel.y(line.front[-1].error))
    ends = [(panel.x(line.front[-1].time), panel.y(line.front[-1].error)) for line in lowest_first]
    places = spread_names([y for _, y in ends])
    margin = SVG_WIDTH - RIGHT + 14
    for line, (x, y), place in zip(lowest_first, ends, places, strict=True):
        yield f'<g class="{line.look.css}">'
        yield f'<path class="leader" d="M{x + 6} {y}L{margin - 4:g} {place}"/>'
        mark = f'href="#mark-{line.look.css}" x="{margin + 5:g}" y="{place}"'
        yield f'<use class="point" {mark}/>'
        title = escape(line.look.title)
        yield f'<text class="name" x="{margin + 15:g}" y="{place + 4}">{title}</text>'
        yield "</g>"


def spread_names(places: Sequence[float]) -> list[float]:
    """Places of names [px], from the lowest up, moved apart within the panel.

    >>> spread_names([200.0, 195.0, 100.0])
    [200.0, 185.0, 100.0]
    """
    moved: list[float] = []
    for place in places:
        moved.append(min(place, moved[-1] - LABEL_GAP) if moved else place)
    highest = TOP + LABEL_GAP / 2
    for k in reversed(range(len(moved))):
        above = moved[k + 1] + LABEL_GAP if k + 1 < len(moved) else highest
        moved[k] = round(max(moved[k], above), 1)
    return moved
