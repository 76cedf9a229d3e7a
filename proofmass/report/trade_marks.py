"""What stands beside the lines of a work-precision diagram: letters, failures, orders, floors."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from string import ascii_lowercase
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes

from proofmass.report.style import Look
from proofmass.studies.row import Row
from proofmass.studies.trade.verdict import Verdict
from proofmass.wording import number

INK, PALE = "#333333", "#888888"
NEAR = 9.0  # [pt] ends of lines that are no further apart have their letters in one place
LEVEL = 3.0  # error floors of one cause that differ by no more are one
NARROW = 26  # letters of the margin in a row
ROW = 0.06  # of a panel's height: one row of the margin
SHOWN = 0.5  # off the expected order: what has no part that is nearer gets no triangle
BELOW = 0.4  # of the errors: where a triangle stands
Name = tuple[str, str]
"""Engine and line, which together name a line."""
Ends = Mapping[Name, tuple[float, float]]


def name_of(of: Row | Verdict) -> Name:
    """The line that a run or a verdict belongs to."""
    return of.engine, of.line


def letter(look: Look) -> str:
    """Of a line, as in the legend.

    >>> letter(Look("", (0, ()), "", 1)), letter(Look("", (0, ()), "", 27))
    ('b', 'b1')
    """
    turn, place = divmod(look.number, 26)
    return ascii_lowercase[place] + (str(turn) if turn else "")


def letters(ax: Axes, ends: Ends, looks: Mapping[Name, Look]) -> None:
    """The letter of each line at its finest setting; of lines that end together side by side."""
    groups: list[tuple[float, float, list[Name]]] = []
    points = 72 / ax.figure.dpi
    for line, end in ends.items():
        x, y = ax.transData.transform(end) * points
        near = next((g for g in groups if max(abs(x - g[0]), abs(y - g[1])) < NEAR), None)
        if near:
            near[2].append(line)
        else:
            groups.append((x, y, [line]))
    for _, _, lines in groups:
        ax.annotate(" ".join(letter(looks[line]) for line in lines), ends[lines[0]], xytext=(0, 7),
                    textcoords="offset points", fontsize=7, weight="bold", ha="center",
                    va="center", color=looks[lines[0]].colour, zorder=9, annotation_clip=False)


def work(row: Row) -> float:
    """Steps in time, or segments of rods where nothing is stepped."""
    return row.value if row.axis == "segments" else float(row.steps)


def failures(ax: Axes, rows: Sequence[Row], timed: bool, looks: Mapping[Name, Look]) -> None:
    """Crosses at the upper edge, where their cost is known."""
    for row in rows:
        x = row.seconds if timed else work(row) or planned(row, rows)
        if row.outcome != "ran" and x > 0:
            ax.plot(x, 0.97, transform=ax.get_xaxis_transform(), marker="x", markersize=5,
                    markeredgewidth=1.2, color=looks[name_of(row)].colour, clip_on=False, zorder=8)


def planned(row: Row, rows: Iterable[Row]) -> float:
    """Steps that a run without any would have made, by one that ran; 0 where nothing tells."""
    spans = (r.steps * step(r) for r in rows if r.steps)
    steps = next((s for s in spans if s > 0), np.nan) / step(row)
    return steps if steps > 0 else 0.0


def step(row: Row) -> float:
    """Time step that was asked for [s]; NaN if none was."""
    return float(str(row.knobs.get("timestep", np.nan)))


def triangles(ax: Axes, rows: Sequence[Row], kind: str, verdicts: Iterable[Verdict]) -> None:
    """One for each expected order, below the part of a line that is nearest to it."""
    orders: dict[float, list[Name]] = {}
    for verdict in verdicts:
        if verdict.expected > 0:
            orders.setdefault(verdict.expected, []).append(name_of(verdict))
    taken: list[float] = []
    for order, lines in sorted(orders.items(), reverse=True):  # steep parts are few
        pairs = [pair for line in lines for pair in pairwise(r for r in rows if name_of(r) == line)
                 if 0 < work(pair[0]) < work(pair[1]) and work(pair[0]) not in taken
                 and abs(slope(kind, *pair) - order) < SHOWN]
        if pairs:
            a, b = min(pairs, key=lambda pair: abs(slope(kind, *pair) - order))
            taken.append(work(a))
            triangle(ax, (work(a), work(b)), BELOW * a.errors[kind], order)


def slope(kind: str, a: Row, b: Row) -> float:
    """Order from one number of steps to the next."""
    return float(np.log(a.errors[kind] / b.errors[kind]) / np.log(work(b) / work(a)))


def triangle(ax: Axes, steps: tuple[float, float], top: float, order: float) -> None:
    """Falls from `top` as errors of that order."""
    foot = top * (steps[0] / steps[1]) ** order
    ax.fill([steps[0], steps[0], steps[1]], [top, foot, foot], facecolor="#eeeeee", edgecolor=INK,
            linewidth=0.8, zorder=2)
    ax.annotate(number(order), (steps[0], np.sqrt(top * foot)), xytext=(-3, 0), fontsize=7,
                textcoords="offset points", ha="right", va="center", color=INK)


def floors(ax: Axes, ends: Ends, looks: Mapping[Name, Look], verdicts: Iterable[Verdict],
          named: bool) -> None:
    """A short level tick where a line stays; `named`: what keeps it there, in the margin."""
    groups: list[list[Verdict]] = []
    for verdict in sorted((v for v in verdicts if v.floor > 0 and name_of(v) in ends),
                          key=lambda v: v.floor):
        ax.plot(ends[name_of(verdict)][0], verdict.floor, marker="_", markersize=18, zorder=2.5,
                markeredgewidth=1.8, color=looks[name_of(verdict)].colour)
        alike = next((g for g in groups if g[0].cause == verdict.cause
                      and verdict.floor < LEVEL * g[0].floor), None)
        if alike:
            alike.append(verdict)
        else:
            groups.append([verdict])
    if named:
        margin(ax, groups, looks)


def margin(ax: Axes, groups: Sequence[Sequence[Verdict]], looks: Mapping[Name, Look]) -> None:
    """Level, lines and cause of each error floor at the right of a panel, apart from each other."""
    low, high = np.log(ax.get_ylim())
    texts = [fill(f"{number(group[0].floor, 2)} {group[0].cause} ("
                  f"{' '.join(sorted(letter(looks[name_of(v)]) for v in group))})", NARROW)
             for group in groups]
    places = [float((np.log(group[0].floor) - low) / (high - low)) for group in groups]
    heights = [ROW * (text.count("\n") + 1) for text in texts]
    for at, y, text in zip(places, spread(places, heights), texts, strict=True):
        ax.annotate(text, (1.0, at), xytext=(1.06, y), xycoords="axes fraction", fontsize=6.5,
                    textcoords="axes fraction", va="center", color=INK,
                    arrowprops={"arrowstyle": "-", "linewidth": 0.6, "color": PALE,
                                "relpos": (0.0, 0.5)})


def spread(places: Sequence[float], heights: Sequence[float]) -> list[float]:
    """Rising places of texts moved up so far that texts of such heights do not touch.

    >>> spread([0.1, 0.15, 0.9], [0.1, 0.1, 0.1])
    [0.1, 0.2, 0.9]
    """
    moved: list[float] = []
    for k, place in enumerate(places):
        least = moved[-1] + 0.5 * (heights[k - 1] + heights[k]) if moved else place
        moved.append(max(place, least))
    return moved
