"""The drawing of a mechanism to scale: bodies, joints, guides, springs and rods, at several poses.

One of the poses has the names of the MJCF, each beside its part, without overlaps.  Figures of the
paths of measured points, to scale, are made here as well.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.textpath import TextToPath

from proofmass.base.arrays import Array
from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.report.data import PlottedRun, drive_units
from proofmass.report.figures import draw_legend, thin_path
from proofmass.report.style import FONT_FAMILY, INK, REFERENCE_STYLE, Look
from proofmass.sim.picture import Mark, Picture
from proofmass.sim.protocol.curves import Curves

LABEL_PAD = 0.6
"""Space of a label between its text and the edge of its white ground [pt]."""
LINE_HEIGHT = 1.25  # of a line of text, as a share of the size of the font
LABEL_DIRECTIONS = np.exp(1j * np.pi * np.array([0.25, 0.75, -0.25, -0.75, 0, 1, 0.5, -0.5]))
LABEL_SIDES = np.stack([LABEL_DIRECTIONS.real, LABEL_DIRECTIONS.imag], axis=1)


@dataclass(frozen=True)
class Label:
    """A text that is to be placed near one of `spots` (k, 2), best first; all lengths in points."""

    text: str
    spots: Array
    size: float = 8.0
    kind: str = "joint"

    @property
    def half(self) -> Array:
        """Half of the width and height of the text in the font of figures, with `LABEL_PAD`."""
        lines = self.text.split("\n")
        wide = max(line_width(line, self.size) for line in lines)
        high = LINE_HEIGHT * self.size * len(lines)
        return 0.5 * np.array([wide, high]) + LABEL_PAD

    def centres(self) -> Array:
        """Return places for the middle of the text (k, 2) around each spot, near ones first."""
        rings = [self.spots[:, None] + LABEL_SIDES * (self.half + gap) for gap in (5.0, 11.0, 19.0)]
        return np.concatenate([ring.reshape(-1, 2) for ring in rings])


@cache
def line_width(line: str, size: float) -> float:
    """Return the width of a line of text in the font of figures [pt].

    The font is DejaVu Sans, which comes with matplotlib.  Where it is missing, a browser draws the
    figure in Verdana, which is as wide, or in another font, which is narrower.

    >>> line_width("ii", 8.0) < line_width("mm", 8.0)
    True
    """
    font = FontProperties(family=FONT_FAMILY, size=size)
    wide, _, _ = TextToPath().get_text_width_height_descent(line, font, ismath=False)
    return float(wide)


def place_labels(labels: Iterable[Label], points: Array, weights: Array, box: Array) -> list[Array]:
    """Choose a place for each label, one after the other.

    Parameters
    ----------
    labels : iterable of Label
    points, weights : ndarray (n, 2), (n,)
        Points that labels should not hide [pt], and their importance [1].
    box : ndarray (2, 2)
        Lower left and upper right corner of the drawing [pt].

    Returns
    -------
    list of ndarray (2,)
        The middle of each text [pt].

    Examples
    --------
    >>> spot = np.array([[50.0, 50.0]])
    >>> paper = np.array([[0.0, 0.0], [99.0, 99.0]])
    >>> a, b = place_labels([Label("a", spot), Label("b", spot)], spot, np.ones(1), paper)
    >>> bool(np.abs(a - b).max() > 8)
    True
    """
    taken: list[tuple[Array, Array]] = []
    order = np.argsort(points[:, 0])
    (x, y), weights = np.ascontiguousarray(points[order].T), weights[order]
    for label in labels:
        centres, half = label.centres(), label.half
        costs = 0.05 * np.arange(len(centres), dtype=float)
        first = np.searchsorted(x, centres[:, 0] - half[0] - 1, "right").tolist()
        last = np.searchsorted(x, centres[:, 0] + half[0] + 1).tolist()
        for k, (a, b) in enumerate(zip(first, last, strict=True)):
            costs[k] += weights[a:b][np.abs(y[a:b] - centres[k, 1]) < half[1] + 1].sum()
        outside = np.maximum(box[0] - (centres - half), 0) + np.maximum(centres + half - box[1], 0)
        costs += 5 * outside.sum(axis=1)
        for middle, size in taken:
            shared = np.maximum(half + size - np.abs(centres - middle), 0)
            costs += np.where(shared.min(axis=1) > 0, 100 + shared.prod(axis=1), 0)
        taken.append((centres[int(costs.argmin())], half))
    return [middle for middle, _ in taken]


SAME_POSE_SHARE = 0.03  # of the mechanism's size: poses with a smaller distance count as the same


def distinct_poses(picture: Picture, count: int = 6) -> Picture:
    """Choose up to `count` poses, evenly over the part of the run that does not repeat itself.

    Of a swing that returns the way there is drawn, of a full turn all but the last pose, which is
    the same as the first.
    """
    n = len(picture.x)
    if n > 2 and np.allclose(picture.inputs, picture.inputs[:, ::-1]) and picture.inputs.size:
        n = n // 2 + 1
    places = np.concatenate(
        [m.at[:n, None] for m in picture.marks]
        + [o[:n] for k in picture.links for o in k.outlines],
        axis=1,
    )
    size = float(np.ptp(places, axis=(0, 1)).max()) or 1.0
    apart = np.abs(places[:, None] - places[None]).max(axis=(2, 3)) / size
    last = max(k for k in range(n) if not has_returned(apart[: k + 1, k]))
    after = apart[last + 1 : last + 1 + n // 10, 0]  # small if the first pose returns soon after
    closed = bool(after.size and after.min() <= SAME_POSE_SHARE)
    end = last + 1 + int(after.argmin()) if closed else last
    way = np.cumsum(np.abs(np.diff(picture.inputs, prepend=picture.inputs[:, :1])).sum(axis=0))
    way = way if way[end] else np.arange(len(picture.x))  # without drives evenly in time
    wanted = np.linspace(0, way[end], count + closed)[:count]
    spread = np.abs(way[: end + 1, None] - wanted).argmin(axis=0)
    chosen: list[int] = []
    for k in spread.tolist():
        if all(apart[k, j] > SAME_POSE_SHARE for j in chosen):
            chosen.append(k)
    return picture.at(chosen)


def has_returned(apart: Array) -> bool:
    """Whether a pose occurred before and was left since.

    `apart` are the distances of the pose to all poses up to it, as shares of the size.
    """
    left_since = np.maximum.accumulate(apart[::-1])[::-1]
    return bool(((apart <= SAME_POSE_SHARE) & (left_since > 2 * SAME_POSE_SHARE)).any())


def clearest_pose(picture: Picture) -> int:
    """Choose the pose for the names: its joints are far from each other and not in one line.

    Where the joints do not distinguish the poses, it is the one whose links are farthest from one
    line.
    """
    if not picture.marks:
        return len(picture.x) - 1
    at = np.stack([m.at for m in picture.marks], axis=1)
    apart = np.linalg.norm(at[:, :, None] - at[:, None], axis=3)
    always = apart.max(axis=0) < 1e-6 * (np.ptp(at) or 1.0)
    nearest = np.where(always, np.inf, apart).min(axis=(1, 2))
    clear = np.minimum(nearest, np.ptp(at)) * distance_from_line(at)
    outlines = [outline for link in picture.links for outline in link.outlines]
    if not clear.any() and outlines:
        clear = distance_from_line(np.concatenate(outlines, axis=1))
    return int(clear.argmax())


def distance_from_line(points: Array) -> Array:
    """Return how far the points (poses, n, 2) of each pose are from one line."""
    centred = points - points.mean(axis=1, keepdims=True)
    found: Array = np.linalg.svd(np.nan_to_num(centred), compute_uv=False)[:, -1]
    return found


GROUND_COLOUR, LINK_COLOUR, PATH_COLOUR, SPRING_COLOUR = "#8a929c", "#0b57a4", "#7b4ba0", "#00755e"
PATH_STYLE: dict[str, Any] = {"color": PATH_COLOUR, "linewidth": 0.9, "linestyle": (0, (4, 2))}
DRAWING_WIDTH, DRAWING_HEIGHT = 430.0, 300.0  # [pt] room for the drawing itself
MARGIN = 46.0  # [pt] left and below it, for the axes' names
LABEL_COLOURS = {"joint": INK, "link": LINK_COLOUR, "path": PATH_COLOUR}
JOINT_MARKERS = {"hinge": "o", "ball": "o", "slide": "s", "pin": "o"}
JOINT_WORDS = {
    "hinge": "hinge",
    "ball": "ball joint",
    "slide": "slide, dashed: its guide",
    "pin": "loop (connect)",
}
SPRING_WORDS = "spiral: torsion spring", "zigzag: spring or damper between points"
SPIRAL_ANGLES = np.linspace(0.0, 5 * np.pi, 60)
FOOT_POINTS = np.linspace([-10.0, -13.0], [10.0, -13.0], 40)  # [pt] ground below a pivot, as points
Tracks = Mapping[str, Array]


@dataclass(frozen=True)
class Scale:
    """The range of a drawing, from `low` to `high` [m], and its scale, `points` per metre."""

    low: Array
    high: Array
    points: float

    def on_paper(self, places: Array) -> Array:
        """Convert places in the drawing [m] to points on the paper [pt]."""
        return (places - self.low) * self.points


def scale_for(picture: Picture, tracks: Tracks, wide: float, high: float, pad: float) -> Scale:
    """Return a scale at which all poses and paths fit, with `pad` points around them."""
    outlines = [o for link in picture.links for o in link.outlines]
    everything = [
        *outlines,
        *(m.at for m in picture.marks),
        *tracks.values(),
        *(m.guide for m in picture.marks if m.guide is not None),
        *(coil.ends for coil in picture.coils),
    ]
    cloud = np.concatenate([e.reshape(-1, 2) for e in everything])
    low, high_end = np.nanmin(cloud, axis=0), np.nanmax(cloud, axis=0)
    span = np.maximum(high_end - low, 1e-3 * (high_end - low).max() or 1.0)
    points = float(min((wide - 2 * pad) / span[0], (high - 2 * pad) / span[1]))
    middle, half = 0.5 * (low + high_end), 0.5 * span + pad / points
    half[1] = max(half[1], 60.0 / points)  # room for the support of a mechanism that lies flat
    return Scale(middle - half, middle + half, points)


def mechanism_figure(case: Case, picture: Picture, tracks: Tracks) -> Figure:
    """Draw poses from light to dark, one with names in black, paths dashed, and a legend.

    Parameters
    ----------
    case : Case
        Names the drives.
    picture : Picture
        Of a `proofmass.sim.motion.Motion`.
    tracks : mapping of str to ndarray (n, 2)
        Paths of measured points [m], by name.
    """
    scale = scale_for(picture, tracks, DRAWING_WIDTH, DRAWING_HEIGHT, 34.0)
    wide, high = (scale.high - scale.low) * scale.points
    main = clearest_pose(picture)
    coils = [
        mark.at[main] + spiral() / scale.points
        for mark in picture.marks
        if mark.kind == "hinge" and mark.name in joints_with_springs(case)
    ]
    springs = [zigzag(coil.ends[main], scale.points) for coil in picture.coils]
    signs = [word for word, there in zip(SPRING_WORDS, (coils, springs), strict=True) if there]
    labels, handles = zip(*legend_rows(case, picture, main, tracks, signs), strict=True)
    full = max(high, LEGEND_PAD + sum(map(legend_height, labels)))
    size = np.array([MARGIN + wide + 210, MARGIN + full])
    figure = Figure(figsize=tuple(size / 72))
    ax = figure.add_axes(
        (MARGIN / size[0], (size[1] - high - 6) / size[1], wide / size[0], high / size[1])
    )
    set_plane(ax, picture, scale)
    for path in tracks.values():
        ax.plot(*path.T, **PATH_STYLE, zorder=3)
    draw_poses(ax, picture, main, scale)
    for coil in (*coils, *springs):
        ax.plot(*coil.T, color=SPRING_COLOUR, linewidth=1.0, zorder=7)
    draw_names(ax, picture, main, tracks, [*coils, *springs], scale)
    figure.legend(
        handles,
        labels,
        loc="upper left",
        bbox_to_anchor=((MARGIN + wide + 12) / size[0], 1.0),
        fontsize=LEGEND_FONT,
        handlelength=2.2,
        labelspacing=LEGEND_GAP,
    )
    return figure


def set_plane(ax: Axes, picture: Picture, scale: Scale) -> None:
    """Set the limits and the labels of axes in which a mechanism is drawn."""
    ax.set(
        xlim=(scale.low[0], scale.high[0]),
        ylim=(scale.low[1], scale.high[1]),
        xlabel=f"{picture.axes[0] or 'in the plane, across'} [m]",
        ylabel=f"{picture.axes[1] or 'in the plane, up'} [m]",
    )


def small_figure(picture: Picture, tracks: Tracks) -> Figure:
    """Draw the mechanism as a thumbnail, without axes and names."""
    scale = scale_for(picture, tracks, 130.0, 96.0, 8.0)
    wide, high = (scale.high - scale.low) * scale.points
    figure = Figure(figsize=(wide / 72, high / 72))
    ax = figure.add_axes((0, 0, 1, 1))
    set_plane(ax, picture, scale)
    ax.axis("off")
    for path in tracks.values():
        ax.plot(*path.T, color=PATH_COLOUR, linewidth=0.8, zorder=3)
    draw_poses(ax, picture, clearest_pose(picture), scale, 0.55)
    return figure


def pose_grey(picture: Picture, k: int) -> str:
    """Return the grey of pose number k; later poses are darker."""
    level = 0.87 - 0.27 * k / max(len(picture.x) - 1, 1)
    return f"{level:.2f}"


def draw_poses(ax: Axes, picture: Picture, main: int, scale: Scale, size: float = 1.0) -> None:
    """Draw the bodies at all poses, and joints, guides and supports at the pose `main`."""
    draw_ground(ax, picture)
    for k in sorted(range(len(picture.x)), key=lambda k: (k == main, k)):
        named = k == main
        colour, width = (INK, 2.2 * size) if named else (pose_grey(picture, k), 1.3 * size)
        for outline in (o[k] for link in picture.links for o in link.outlines):
            ax.plot(
                *np.vstack([outline, outline[:1]]).T,
                color=colour,
                linewidth=width,
                solid_capstyle="round",
                zorder=6 if named else 4 + k / 100,
            )
            if len(outline) > 2:
                ax.fill(*outline.T, color=colour, alpha=0.12, linewidth=0, zorder=3.5)
    draw_supports(ax, picture.marks, main, scale, size)
    order = {"slide": 0, "pin": 1, "ball": 2, "hinge": 2}
    joints = [m for m in picture.marks if m.kind in order]
    for mark in sorted(joints, key=lambda m: (m.driven, order[m.kind])):
        draw_joint(ax, mark.kind, mark.driven, mark.at[main], size)


def draw_ground(ax: Axes, picture: Picture) -> None:
    """Draw the outlines of what does not move."""
    for outline in picture.ground.outlines:
        ax.fill(
            *outline[0].T, facecolor="#d5d9de", edgecolor=GROUND_COLOUR, linewidth=1.0, zorder=1
        )


def draw_supports(
    ax: Axes, marks: Iterable[Mark], pose: int, scale: Scale, size: float = 1.0
) -> None:
    """Draw clamps, guides, and supports of pivots on the ground at a pose."""
    for mark in marks:
        if mark.kind == "clamp" and mark.guide is not None:
            draw_clamp(ax, mark.guide[pose], scale, size)
        elif mark.guide is not None:
            draw_guide(ax, mark.guide[pose], mark.ground, scale, size)
        elif mark.ground:
            draw_support(ax, mark.at[pose], scale, size)


def spiral(inner: float = 0.0, outer: float = 0.0) -> Array:
    """Return the spiral of a torsion spring (k, 2) [pt], with ends at given angles [rad].

    >>> ends = spiral(0.0, np.pi / 2)[[0, -1]]
    >>> bool(np.allclose(ends, [[4.0, 0.0], [0.0, -10.6]], atol=0.01))
    True
    """
    turn = inner + SPIRAL_ANGLES * (1.0 + (outer - inner) / SPIRAL_ANGLES[-1])
    return (4.0 + 0.42 * SPIRAL_ANGLES)[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def zigzag(ends: Array, points: float) -> Array:
    """Return the zigzag (k, 2) of a spring between two places (2, 2) [m], at `points` per metre.

    >>> zigzag(np.array([[0.0, 0.0], [1.0, 0.0]]), 100.0)[[0, 1, 2, 3, -1]].round(3).tolist()
    [[0.0, 0.0], [0.15, 0.0], [0.185, 0.05], [0.255, -0.05], [1.0, 0.0]]
    """
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along)) or 1.0
    across = np.array([-along[1], along[0]]) / length * min(5.0 / points, 0.25 * length)
    shares = np.array([0.0, 0.15, *(0.15 + 0.07 * (np.arange(10) + 0.5)), 0.85, 1.0])
    sides = np.array([0.0, 0.0, *np.tile([1.0, -1.0], 5), 0.0, 0.0])
    return np.asarray(ends[0] + shares[:, None] * along + sides[:, None] * across)


def draw_joint(ax: Axes, kind: str, driven: bool, at: Array, size: float) -> list[Line2D]:
    """Draw the sign of a joint: filled if it is driven, with a dot if it closes a loop."""
    found = ax.plot(
        *at,
        JOINT_MARKERS[kind],
        markersize=(7.5 if kind == "slide" else 5.5) * size,
        color=INK,
        markerfacecolor=INK if driven else "white",
        markeredgewidth=1.2 * size,
        zorder=8 + driven,
    )
    if kind == "pin":
        found += ax.plot(*at, "o", markersize=1.6 * size, color=INK, zorder=9.5)
    return found


def draw_support(ax: Axes, at: Array, scale: Scale, size: float) -> None:
    """Draw a fixed pivot: a triangle on hatched ground."""
    unit = 9.5 * size / scale.points
    foot = at + unit * np.array([[-0.8, -1.3], [0.8, -1.3]])
    ax.fill(
        *np.vstack([at[None], foot]).T,
        facecolor="white",
        edgecolor=GROUND_COLOUR,
        linewidth=1.0 * size,
        zorder=5,
    )
    draw_hatch(ax, foot[0] - [0.4 * unit, 0], foot[1] + [0.4 * unit, 0], scale, size)


def draw_guide(ax: Axes, ends: Array, ground: bool, scale: Scale, size: float) -> None:
    """Draw the guide of a slide: hatched on the ground, dashed on a moving body."""
    along = ends[1] - ends[0]
    length = np.linalg.norm(along)
    along = along / length if length else np.array([1.0, 0.0])
    reach = 12.0 * size / scale.points * ground
    one, two = ends[0] - reach * along, ends[1] + reach * along
    ax.plot(
        *np.stack([one, two]).T,
        color=GROUND_COLOUR,
        linewidth=1.0 * size,
        zorder=2.5,
        linestyle=(0, (6, 2)),
    )
    if ground:
        below = np.array([along[1], -along[0]])
        if below[1] > 1e-9 or (abs(below[1]) <= 1e-9 and below[0] > 0):
            one, two, below = two, one, -below
        shift = 7.0 * size / scale.points * below
        draw_hatch(ax, one + shift, two + shift, scale, size)


def draw_clamp(ax: Axes, ends: Array, scale: Scale, size: float) -> None:
    """Draw the clamp of a rod that begins at the first of two points and leads to the other."""
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    across = 11.0 * size / scale.points * np.array([along[1], -along[0]])
    draw_hatch(ax, ends[0] - across, ends[0] + across, scale, size)


def draw_hatch(ax: Axes, one: Array, two: Array, scale: Scale, size: float) -> None:
    """Draw the sign of fixed ground: a line with short strokes at its right."""
    length = float(np.linalg.norm(two - one))
    along = (two - one) / length
    step, below = 3.6 * max(size, 0.7) / scale.points, np.array([along[1], -along[0]])
    tops = one + along * np.arange(0.5 * step, length, step)[:, None]
    strokes = np.stack([tops, tops + 0.9 * step * (below - along), np.full_like(tops, np.nan)], 1)
    ax.plot(*np.stack([one, two]).T, color=GROUND_COLOUR, linewidth=1.2 * size, zorder=2.6)
    ax.plot(*strokes.reshape(-1, 2).T, color=GROUND_COLOUR, linewidth=0.7 * size, zorder=2.6)


def joints_with_springs(case: Case) -> set[str]:
    """Return the names of the joints with a spring of their own."""
    model = compiled_model(case)
    curved = np.any(getattr(model, "jnt_stiffnesspoly", np.zeros((model.njnt, 1))), axis=1)
    return {model.joint(j).name for j in np.flatnonzero((model.jnt_stiffness != 0) | curved)}


def draw_names(
    ax: Axes, picture: Picture, main: int, tracks: Tracks, coils: list[Array], scale: Scale
) -> None:
    """Draw the names of joints, loops, links and paths, each once, at the pose `main`."""
    labels = joint_labels(picture, main, scale) + link_labels(picture, main, scale)
    for name, path in tracks.items():
        there = scale.on_paper(path[np.isfinite(path).all(axis=1)])
        labels.append(Label(name, there[:: max(len(there) // 12, 1)], 7.5, "path"))
    feet = [m.at[main] + FOOT_POINTS / scale.points for m in picture.marks if m.ground]
    points, weights = points_in_sight(picture, main, [*tracks.values(), *coils, *feet], scale)
    box = np.stack([np.zeros(2), scale.on_paper(scale.high)])
    for label, middle in zip(labels, place_labels(labels, points, weights, box), strict=True):
        x, y = middle / scale.points + scale.low
        ax.text(
            x,
            y,
            label.text,
            ha="center",
            va="center",
            fontsize=label.size,
            color=LABEL_COLOURS[label.kind],
            zorder=12,
            linespacing=1.2,
            style="italic" if label.kind == "link" else "normal",
            bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": LABEL_PAD},
        )


def joint_labels(picture: Picture, main: int, scale: Scale) -> list[Label]:
    """Return labels of joints and loops, one for all that are at the same place at all poses."""
    groups: list[tuple[Array, list[str]]] = []
    for mark in picture.marks:
        if mark.name:
            for at, found in groups:
                if np.abs(at - mark.at).max() * scale.points < 1.0:
                    found += [mark.name] * (mark.name not in found)
                    break
            else:
                groups.append((mark.at, [mark.name]))
    return [Label(",\n".join(found), scale.on_paper(at[main : main + 1])) for at, found in groups]


def link_labels(picture: Picture, main: int, scale: Scale) -> list[Label]:
    """Return a label for each body, along its longest edge."""
    found = []
    for link in picture.links:
        edges = [
            edge
            for o in link.outlines
            for edge in zip(o[main], np.roll(o[main], -1, axis=0), strict=True)
        ]
        if edges and link.name:
            one, two = max(edges, key=lambda edge: float(np.linalg.norm(edge[1] - edge[0])))
            shares = np.array([0.5, 0.38, 0.62, 0.25, 0.75])[:, None]
            found.append(Label(link.name, scale.on_paper(one + shares * (two - one)), 7.5, "link"))
    return found


def points_in_sight(
    picture: Picture, main: int, lines: list[Array], scale: Scale
) -> tuple[Array, Array]:
    """Return points (n, 2) on the paper that names should not hide, and their importance."""
    points, weights = [scale.on_paper(m.at[main : main + 1]) for m in picture.marks], []
    weights += [np.full(1, 8.0)] * len(points)
    for k in range(len(picture.x)):
        for outline in (scale.on_paper(o[k]) for link in picture.links for o in link.outlines):
            for one, two in zip(outline, np.roll(outline, -1, axis=0), strict=True):
                count = int(np.linalg.norm(two - one) / 4) + 1
                points.append(one + np.linspace(0, 1, count)[:, None] * (two - one))
                weights.append(np.full(count, 1.0 if k == main else 0.08))
    for path in lines:
        points.append(scale.on_paper(path[np.isfinite(path).all(axis=1)]))
        weights.append(np.full(len(points[-1]), 0.1))
    return np.concatenate(points), np.concatenate(weights)


LEGEND_FONT, LEGEND_GAP = 7.5, 0.45
"""Size of the legend's font [pt], and gap between its rows as a share of it."""
LEGEND_PAD = 8.0  # [pt] space above and below the rows


def legend_height(label: str) -> float:
    """Height of a row of the legend [pt]."""
    return LEGEND_FONT * (LINE_HEIGHT * (label.count("\n") + 1) + LEGEND_GAP)


def legend_rows(
    case: Case, picture: Picture, main: int, tracks: Tracks, springs: Iterable[str]
) -> list[tuple[str, Any]]:
    """Labels of the legend with what they explain: poses with their drives' values, and signs."""
    count = len(picture.x)
    rows: list[tuple[str, Any]] = [
        (
            format_pose(case, float(picture.x[k]), picture.inputs[:, k])
            + " (named)" * (k == main and count > 1),
            Line2D(
                [],
                [],
                color=INK if k == main else pose_grey(picture, k),
                linewidth=2.2 if k == main else 1.3,
            ),
        )
        for k in range(count)
    ]
    dot = Line2D([], [], linestyle="", marker="o", color=INK, markersize=1.6)
    for kind in JOINT_WORDS:
        if any(mark.kind == kind for mark in picture.marks):
            sign = Line2D(
                [],
                [],
                linestyle="",
                marker=JOINT_MARKERS[kind],
                color=INK,
                markerfacecolor="white",
                markersize=5.5,
            )
            rows.append((JOINT_WORDS[kind], (sign, dot) if kind == "pin" else sign))
    if any(mark.driven for mark in picture.marks):
        rows.append(("filled: driven", Line2D([], [], linestyle="", marker="o", color=INK)))
    rows += [(word, Line2D([], [], color=SPRING_COLOUR, linewidth=1.0)) for word in springs]
    rows.append(("hatched: ground", Line2D([], [], color=GROUND_COLOUR, linewidth=1.2)))
    return rows + [(f"path of {name}", Line2D([], [], **PATH_STYLE)) for name in tracks]


def format_pose(case: Case, x: float, inputs: Array) -> str:
    """Format the values of the drives at a pose, with the time unless drives are steady.

    A case with an equilibrium run and without drives is "at rest".
    """
    words = []
    for drive, unit, value in zip(case.drive, drive_units(case), inputs, strict=True):
        words.append(
            f"{drive.joint} "
            + (
                f"{number(value)} m"
                if unit == "m"
                else f"{np.degrees(value):.0f}°".replace("-0°", "0°")
            )
        )
    if case.leader is None and "equilibrium" in case.run:
        return "at rest"
    if case.leader is None or not case.leader.steady:
        words.insert(0, f"t {number(x)} s")
    return ",\n".join(", ".join(words[k : k + 2]) for k in range(0, len(words), 2))


PANEL_SIDE = 2.45  # [inch] side of a panel


def path_names(view: PlottedRun, picture: Picture | None) -> list[str]:
    """Return the points whose coordinates in the plane are channels in metres and not constant."""
    across, up = picture.axes if picture else ("", "")
    return [
        name
        for name in dict.fromkeys(c.rpartition(".")[0] for c in view.channels)
        if across
        and all(
            f"{name}.{a}" in view.channels and view.case.channels[f"{name}.{a}"].si_unit == "m"
            for a in (across, up)
        )
        and np.ptp(point_path(view.longest, name, picture), axis=0).max() > 1e-9
    ]


def point_path(curves: Curves, name: str, picture: Picture | None) -> Array:
    """Return the path of a point (n, 2) [m]; NaN where curves do not have it."""
    missing = np.full(curves.x.shape, np.nan)
    return np.stack(
        [curves.channels.get(f"{name}.{a}", missing) for a in (picture.axes if picture else "xy")],
        axis=1,
    )


def path_jumps(view: PlottedRun, name: str, picture: Picture, solver: str = "") -> set[int]:
    """Return the jumps of a point's path, by a solver or without one by the reference."""
    jumps = view.jumps_of[solver] if solver else view.jumps
    return {k for a in picture.axes for k in jumps.of(f"{name}.{a}")}


def path_figure(view: PlottedRun, picture: Picture, style: Mapping[str, Look]) -> Figure:
    """Draw all paths of a run side by side."""
    names = path_names(view, picture)
    width = min(len(names), 4)
    rows = -(-len(names) // width)
    height, head = (PANEL_SIDE + 0.75) * rows, 0.5 if view.failed else 0.3
    size = np.array([max((PANEL_SIDE + 0.75) * width, 6.5), height + head])
    figure = Figure(figsize=tuple(size))
    for k, name in enumerate(names):
        corner = (
            0.65 + (PANEL_SIDE + 0.75) * (k % width),
            0.45 + (PANEL_SIDE + 0.75) * (rows - 1 - k // width),
        )
        ax = figure.add_axes((*(corner / size), *(PANEL_SIDE / size)))
        draw_path(ax, view, name, picture, style)
    draw_legend(figure, view, style, "overlay", float(size[1]))
    return figure


def draw_path(
    ax: Axes, view: PlottedRun, name: str, picture: Picture, style: Mapping[str, Look]
) -> None:
    """Draw a path: the reference thick and pale, the solvers on top, with equal scales."""
    reference = point_path(view.longest, name, picture)
    ax.plot(*thin_path(reference, 400, path_jumps(view, name, picture)).T, **REFERENCE_STYLE)
    for solver, curves in view.curves.items():
        there = point_path(curves, name, picture)
        found = thin_path(there, 400, path_jumps(view, name, picture, solver))
        look, step = style[solver], max(len(found) // 9, 1)
        ax.plot(
            *found.T,
            **look.line,
            markevery=(min(look.number * step // 6, len(found) - 1), step),
            markerfacecolor="white",
            markeredgewidth=0.8,
            zorder=3 + look.number / 10,
        )
    low, high = np.nanmin(reference, axis=0), np.nanmax(reference, axis=0)
    middle, half = 0.5 * (low + high), 0.56 * float((high - low).max())
    ax.set(
        xlim=(middle[0] - half, middle[0] + half),
        ylim=(middle[1] - half, middle[1] + half),
        xlabel=f"{name}.{picture.axes[0]} [m]",
        ylabel=f"{name}.{picture.axes[1]} [m]",
    )
    ax.locator_params(nbins=5)
    ax.set_title(f"{name}: its {'shape' if view.kind == 'equilibrium' else 'path'}")
