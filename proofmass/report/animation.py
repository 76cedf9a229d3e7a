"""A mechanism in motion as an animated picture: the reference is pale, the solvers are lines.

The poses are those of the report's page, see `proofmass.sim.motion`, with bending rods and winding
torsion springs. Where a run has fewer samples than the animation has pictures, poses between the
samples are interpolated, but not across a jump to another equilibrium.
"""

import io
from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError, suggest_names
from proofmass.base.files import OUTPUT_MARK, require_replaceable, write_output
from proofmass.base.strict import Kind
from proofmass.base.wording import number
from proofmass.base.worker import call_isolated
from proofmass.batch.check import CheckTask, Result, collect_outcomes, run_solver
from proofmass.batch.work import compare_and_share
from proofmass.case.case import Case, RunTable
from proofmass.report.case_data import rod_vertices
from proofmass.report.case_figures import (
    FIGURE_SECONDS,
    compute_motion,
    measured_curves,
    measured_paths,
    mechanism_jumps,
)
from proofmass.report.data import PlottedRun, plotted_run
from proofmass.report.mechanism import (
    GROUND_COLOUR,
    MARGIN,
    PATH_COLOUR,
    PATH_STYLE,
    SPRING_COLOUR,
    Tracks,
    draw_ground,
    draw_joint,
    draw_supports,
    format_pose,
    scale_for,
    set_plane,
    spiral,
    zigzag,
)
from proofmass.report.style import INK, RC, REFERENCE_STYLE, solver_looks
from proofmass.sim.engines import computes_curves, format_solver
from proofmass.sim.motion import Motion
from proofmass.sim.picture import Picture
from proofmass.verdict.outcome import FAILED_OUTCOMES

DEFAULT_FRAMES, MAX_FRAMES = 60, 600
DEFAULT_SECONDS = 4.0  # [s] playing time of an animation by default
FORMATS = {".gif": "GIF", ".webp": "WEBP"}
WEBP_QUALITY = 50  # quality of WebP pictures, from 0 to 100
GIF_COLOURS = 64  # number of colours in a GIF's palette
# [pt] room for the mechanism, and dots per inch
MECHANISM_WIDTH, MECHANISM_HEIGHT, DOTS_PER_INCH = 350.0, 300.0, 80
# [pt] margins above, below the axis (with the legend), and at the right
CURVES_TOP_MARGIN, CURVES_BOTTOM_MARGIN, CURVES_RIGHT_MARGIN = 16.0, 40.0, 8.0
PADDING = 26.0  # [pt] around the mechanism
MIN_MOTION = 1e-9  # of the mechanism's size: a smaller displacement counts as none
CLOSED_SHARE = 1e-3  # of a curve's range: a motion with a smaller distance of its ends is closed
Places = Array


@dataclass(frozen=True)
class Animation:
    """A mechanism in motion.

    Attributes
    ----------
    title : str
        Case, run, and the parties that are drawn.
    frames : ndarray (pictures, height, width, 3) of uint8
        The pictures, red, green, blue [1].
    seconds : float
        Playing time [s].
    failed : dict of str to str
        Solvers that failed, and why; they are drawn until the failure.
    stopped : str
        Why the motion ends before the end of the run; empty if it does not.
    """

    title: str
    frames: Array
    seconds: float
    failed: dict[str, str]
    stopped: str = ""

    def save(self, file: Path | str) -> None:
        """Write the animation as a GIF or WebP file, by its ending, that repeats without end.

        Raises
        ------
        InputError
            The file has another ending.
        OSError
            The file cannot be written.
        """
        file = Path(file)
        write_output(file, self.encoded(file_format(file)))

    def encoded(self, form: str = "WEBP") -> bytes:
        """Encode the animation as the content of a file; `form` is GIF or WEBP."""
        images = [Image.fromarray(frame) for frame in self.frames]
        how: dict[str, Any]
        pause = 1000 * self.seconds / len(images)
        if form == "GIF":  # its unit of time is 10 ms
            middle = images[len(images) // 2]
            palette = middle.quantize(GIF_COLOURS, method=Image.Quantize.MAXCOVERAGE, kmeans=2)
            images = [i.quantize(palette=palette, dither=Image.Dither.NONE) for i in images]
            how = {"duration": max(round(pause / 10) * 10, 20), "optimize": False}
            how |= {"comment": OUTPUT_MARK}
        else:
            how = {"duration": max(round(pause), 1), "quality": WEBP_QUALITY, "method": 4}
            how |= {"xmp": OUTPUT_MARK.encode()}
        stream = io.BytesIO()
        images[0].save(stream, form, save_all=True, append_images=images[1:], loop=0, **how)
        return stream.getvalue()

    def __repr__(self) -> str:
        return f"Animation({self.title!r}, {len(self.frames)} pictures, {self.seconds:g} s)"

    def _repr_html_(self) -> str:
        """Return the animation as HTML for a notebook."""
        data = b64encode(self.encoded()).decode()
        return f'<div><img src="data:image/webp;base64,{data}" alt="{escape(self.title)}"></div>'


def animate(
    case: Case,
    run: Kind | None = None,
    solvers: Iterable[str] | None = None,
    *,
    frames: int = DEFAULT_FRAMES,
    seconds: float = DEFAULT_SECONDS,
    magnify: float = 1.0,
    samples: int | None = None,
) -> Animation:
    """Run a case and draw its mechanism in motion, the solvers over the reference.

    Parameters
    ----------
    case : Case
        The sidecar.
    run : "sweep" or "dynamics", optional
        Run of the case; the first that is no equilibrium, if not given.
    solvers : iterable of str, optional
        Engines or ``engine:variant``; the run's first solver of each engine, if not given.
    frames : int
        Number of pictures, 2 to 600 [1], evenly over the run; a closed motion has no picture of its
        end, which is the same as its start.
    seconds : float
        Playing time [s].
    magnify : float
        Factor by which differences to the reference are enlarged [1].
    samples : int, optional
        Number of samples of the run, instead of the sidecar's; pictures between samples are
        interpolated.

    Returns
    -------
    Animation
        Its method `save` writes a GIF or a WebP file; a notebook plays it.

    Raises
    ------
    InputError
        The case has no such run or no motion, does not move in a plane, or cannot be run.
    ValueError
        A number is out of its range.

    Examples
    --------
    >>> from proofmass import animate, load_case
    >>> animate(load_case("models/linkages/fourbar.toml"), solvers=["mujoco"], frames=8)
    Animation('fourbar, sweep: reference and MuJoCo', 8 pictures, 4 s)
    """
    require_numbers(frames, seconds, magnify)
    kind = choose_run(case, run)
    table = case.run[kind]
    if samples is not None:
        table = with_samples(case, kind, samples)
    chosen = tuple(dict.fromkeys(first_of_engines(table.solvers) if solvers is None else solvers))
    case = case.model_copy(
        update={"run": {kind: table.model_copy(update={"solvers": chosen})}, "tolerance": ()}
    )
    result, compare_curves = Result(cases=[case]), partial(compare_and_share, detectable=False)
    tasks: list[CheckTask] = [(case, kind, solver) for solver in chosen]
    collect_outcomes(
        tasks, {k: run_solver(case, kind, s, compare_curves) for k, s in enumerate(chosen)}, result
    )
    failed = {
        c.solver: f"{c.outcome}: {c.message}"
        for c in result.comparisons
        if c.outcome in FAILED_OUTCOMES
    }
    names = [format_solver(solver) for solver in chosen]
    title = f"{case.name}, {kind}: reference and {' and '.join(names)}"
    if magnify != 1:
        title += f", differences {number(magnify)} times as large"
    try:
        pictures, stopped = call_isolated(
            draw_frames, case, kind, result, frames, magnify, timeout=FIGURE_SECONDS
        )
    except InputError:
        raise
    except Exception as error:
        raise InputError(case.model_path, "", f"it cannot be drawn: {error}") from None
    return Animation(title, pictures, seconds, failed, stopped)


def with_samples(case: Case, kind: Kind, samples: int) -> RunTable:
    """Return a run with another number of samples.

    Raises
    ------
    InputError
        The reference is a recorded curve, which determines the samples.
    ValueError
        Fewer than two samples.
    """
    if case.recorded:
        raise case.error(f"run.{kind}.n", "is given by the recorded curve")
    if samples < 2:
        raise ValueError(f"samples = {samples}: a motion has 2 at least")
    return case.run[kind].model_copy(update={"n": samples})


def first_of_engines(solvers: Iterable[str]) -> list[str]:
    """Return the first solver of each engine, and all recorded parties.

    >>> first_of_engines(["mujoco:settled", "pymunk", "pymunk:default"])
    ['mujoco:settled', 'pymunk']
    """
    first: dict[str, str] = {}
    for solver in solvers:
        first.setdefault(solver.partition(":")[0] if computes_curves(solver) else solver, solver)
    return list(first.values())


def require_numbers(frames: int, seconds: float, magnify: float) -> None:
    """Raise ValueError where a number is out of its range."""
    if not 2 <= frames <= MAX_FRAMES:
        raise ValueError(f"frames = {frames}: a motion has 2 to {MAX_FRAMES} pictures")
    if not 0 < seconds < np.inf:
        raise ValueError(f"seconds = {seconds:g}: give a time above 0")
    if not 0 <= magnify < np.inf:
        raise ValueError(f"magnify = {magnify:g}: give 1, or how many times as large, such as 10")


def file_format(file: Path) -> str:
    """Return GIF or WEBP, by the ending of a file.

    Raises
    ------
    InputError
        The file has another ending.
    """
    try:
        return FORMATS[file.suffix.lower()]
    except KeyError:
        ending = f"ends in {file.suffix!r}" if file.suffix else "has no ending"
        raise InputError(
            file, "", f"{ending}; {suggest_names(file.suffix, FORMATS, 'known')}"
        ) from None


def require_writable(file: Path) -> None:
    """Raise InputError if a file ends in neither .gif nor .webp, or its folder does not exist."""
    file_format(file)
    require_replaceable(file)
    if not file.parent.is_dir():
        raise InputError(file, "", f"there is no folder {str(file.parent)!r} to write it to")


def choose_run(case: Case, run: Kind | None = None) -> Kind:
    """Return the run to animate: the given one, or the first that is no equilibrium.

    Raises
    ------
    InputError
        The case has no such run, or the given one is an equilibrium.
    """
    moving = [kind for kind in case.run if kind != "equilibrium"]
    if run is None and not moving:
        raise case.error("run", "nothing moves: it has run.equilibrium alone; give it a sweep")
    if run == "equilibrium":
        raise case.error("run.equilibrium", "nothing moves in it; take another run")
    if run is not None and run not in moving:
        raise case.error(f"run.{run}", f"no such run; {suggest_names(run, moving)}")
    return run or moving[0]


def draw_frames(
    case: Case, kind: Kind, result: Result, frames: int, magnify: float
) -> tuple[Array, str]:
    """Draw the pictures (n, height, width, 3), and tell why the motion ends early, if it does.

    `animate` calls this in another process.
    """
    view = plotted_run(result, case, kind)
    again = is_closed(view)
    jumps = mechanism_jumps(view)
    moved = compute_motion(case, kind, measured_curves(view), frames + again, jumps)
    if moved.along:
        raise InputError(
            case.model_path, "", "it leaves every plane: the page of a report plays it from a side"
        )
    if not is_moving(moved.picture):
        raise case.error(f"run.{kind}", moved.picture.stopped or "nothing moves in this run")
    with rc_context(RC):
        stage = AnimationFigure(
            case,
            view.solvers,
            moved,
            measured_paths([view] if view.curves else [], moved.picture),
            magnify,
        )
        share = np.arange(frames) / (frames if again else frames - 1)
        return stage.frames(share), moved.picture.stopped


def is_moving(picture: Picture) -> bool:
    """Whether any point of a picture moves between its poses."""
    lines = [outline for link in picture.links for outline in link.outlines]
    points = np.concatenate([*lines, *(mark.at[:, None] for mark in picture.marks)], axis=1)
    return bool(np.ptp(points, axis=0).max() > MIN_MOTION * np.ptp(points, axis=(0, 1)).max())


def is_closed(view: PlottedRun) -> bool:
    """Whether the motion is closed: places and angles of the reference end as they began.

    Angles may differ by whole turns.
    """
    units = {name: view.case.channels[name].si_unit for name in view.channels if view.curves}
    ends = [
        (view.longest.channels[name], 2 * np.pi if unit == "rad" else np.inf)
        for name, unit in units.items()
        if unit in ("m", "rad")
    ]
    distances = [
        abs(np.remainder(y[-1] - y[0] + turn / 2, turn) - turn / 2) / (np.ptp(y) or 1.0)
        if np.isfinite(turn)
        else abs(y[-1] - y[0]) / (np.ptp(y) or 1.0)
        for y, turn in ends
    ]
    return bool(distances) and max(distances) < CLOSED_SHARE


def move_points(points: Array, places: Array) -> Array:
    """Move points (k, 2) of a body's frame to its places x, y, angle (poses, 3): (poses, k, 2)."""
    cos, sin = np.cos(places[:, 2]), np.sin(places[:, 2])
    turn = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], 1)
    return np.asarray(points @ turn.transpose(0, 2, 1) + places[:, None, :2])


def interpolate_poses(rows: Array, numbers: Array, jumps: Sequence[int]) -> Array:
    """Interpolate rows of poses at fractional numbers of poses; at a jump the nearest row is taken.

    `jumps` are the numbers of the poses after a jump.

    >>> interpolate_poses(np.array([0.0, 1.0, 5.0]), np.array([0.5, 1.2, 2.0]), [2])
    array([0.5, 1. , 5. ])
    """
    first = np.clip(np.floor(numbers).astype(int), 0, max(len(rows) - 2, 0))
    second = np.minimum(first + 1, len(rows) - 1)
    share = numbers - first
    share = np.where(np.isin(second, list(jumps)), np.round(share), share)
    share = share.reshape(-1, *[1] * (rows.ndim - 1))
    with np.errstate(invalid="ignore"):
        mixed = rows[first] + share * (rows[second] - rows[first])
    return np.where(share == 0, rows[first], np.where(share == 1, rows[second], mixed))


class AnimationFigure:
    """The figure of an animation: fixed parts are drawn once, moving parts for each picture."""

    def __init__(
        self, case: Case, solvers: Sequence[str], moved: Motion, paths: Tracks, magnify: float
    ) -> None:
        self.case, self.motion, self.magnify = case, moved, magnify
        picture = moved.picture
        self.scale = scale_for(picture, paths, MECHANISM_WIDTH, MECHANISM_HEIGHT, PADDING)
        wide, high = (self.scale.high - self.scale.low) * self.scale.points
        size = np.array(
            [
                max(MARGIN + wide + CURVES_RIGHT_MARGIN, 300.0),
                CURVES_TOP_MARGIN + high + CURVES_BOTTOM_MARGIN + MARGIN / 2,
            ]
        )
        self.figure = Figure(figsize=tuple(size / 72), dpi=DOTS_PER_INCH, facecolor="white")
        self.canvas = FigureCanvasAgg(self.figure)
        self.axes = self.figure.add_axes(
            (
                MARGIN / size[0],
                (CURVES_BOTTOM_MARGIN + MARGIN / 2) / size[1],
                wide / size[0],
                high / size[1],
            )
        )
        set_plane(self.axes, picture, self.scale)
        self.words = self.axes.text(
            0.0, 1.0 + 4.0 / high, "", transform=self.axes.transAxes, fontsize=8.5, weight="bold"
        )
        draw_ground(self.axes, picture)
        for path in paths.values():
            self.axes.plot(*path.T, **PATH_STYLE, zorder=3)
        still = (mark for mark in picture.marks if mark.ground or mark.kind == "clamp")
        draw_supports(self.axes, still, 0, self.scale)
        style = solver_looks(solvers)
        present = [solver for solver in solvers if solver in moved.away]
        self.first = present[0] if present else ""
        self.keys = list[Line2D]()
        self.parties = {
            "": self.add_party("reference", REFERENCE_STYLE["color"], 6.0, 0)
            if present
            else self.add_party("model", INK, 2.2, 0)
        }
        for k, solver in enumerate(present):
            self.parties[solver] = self.add_party(
                format_solver(solver), style[solver].colour, 2.0, k
            )
        self.guides = self.lines(GROUND_COLOUR, 1.0, 1, zorder=2.5)
        self.coils = self.lines(SPRING_COLOUR, 1.1, 0, zorder=7)
        self.signs = [
            (number, draw_joint(self.axes, spot.kind, spot.driven, np.zeros(2), 1.0))
            for number, spot in enumerate(moved.spots)
            if spot.kind in ("hinge", "slide", "pin")
        ]
        self.legend(bool(paths))

    def lines(self, colour: str, width: float, gaps: int, zorder: float = 5) -> LineCollection:
        """Add an empty collection of lines, dashed with gaps so that lines below show through."""
        found = LineCollection(
            [],
            colors=colour,
            linewidths=width,
            linestyles=(0, (3.0, 3.0 * gaps)) if gaps else "solid",
            capstyle="butt" if gaps else "round",
            zorder=zorder + gaps / 10,
        )
        self.axes.add_collection(found, autolim=False)
        return found

    def add_party(self, name: str, colour: str, width: float, gaps: int) -> LineCollection:
        """Add the empty lines of the reference or of a solver, and its entry of the legend."""
        dash: Any = (0, (1.5, 1.5 * gaps)) if gaps else "-"
        self.keys.append(Line2D([], [], color=colour, linewidth=width, linestyle=dash, label=name))
        return self.lines(colour, width, gaps)

    def legend(self, paths: bool) -> None:
        """Draw the legend below the axes."""
        rows = self.keys
        if paths:
            rows.append(
                Line2D([], [], color=PATH_COLOUR, linewidth=0.9, linestyle="--", label="path")
            )
        if self.magnify != 1:
            label = f"differences × {number(self.magnify)}"
            rows.append(Line2D([], [], linestyle="", label=label))
        self.figure.legend(
            handles=rows,
            loc="lower center",
            ncols=len(rows),
            fontsize=8,
            handlelength=2.4,
            columnspacing=1.4,
        )

    def frames(self, share: Array) -> Array:
        """Draw the pictures at shares of the run, from 0 at its start to 1 at its end."""
        moved, picture = self.motion, self.motion.picture
        first, last = picture.x[[0, -1]]
        at = np.interp(share, (picture.x - first) / (last - first), np.arange(len(picture.x)))
        drawn = {party: self.places_of(party, at) for party in self.parties}
        strokes = {party: self.strokes(places) for party, places in drawn.items()}
        lead = drawn[self.first]
        moving = [*self.parties.values(), self.guides, self.coils, self.words]
        moving += [line for _, signs in self.signs for line in signs]
        for artist in moving:
            artist.set_animated(True)
        self.canvas.draw()
        still = self.canvas.copy_from_bbox(self.figure.bbox)
        inputs = interpolate_poses(picture.inputs.T, at, moved.jumps).T
        spots = self.spots(lead)
        found = []
        for k in range(len(share)):
            self.canvas.restore_region(still)
            for party, lines in self.parties.items():
                lines.set_segments([stroke[k] for stroke in strokes[party]])
            self.guides.set_segments([spots[i][k] for i in self.numbers("guide")])
            spirals = [self.coil(i, lead[k], spots[i][k, 0]) for i in self.springs()]
            self.coils.set_segments([*spirals, *self.zigzags(lead[k])])
            for i, signs in self.signs:
                for line in signs:
                    line.set_data(*spots[i][k, :1].T)
            self.words.set_text(
                format_pose(self.case, first + share[k] * (last - first), inputs[:, k]).replace(
                    "\n", " "
                )
            )
            for artist in sorted(moving, key=lambda artist: artist.get_zorder()):
                self.axes.draw_artist(artist)
            found.append(np.asarray(self.canvas.buffer_rgba())[..., :3].copy())
        return np.array(found)

    def places_of(self, party: str, at: Array) -> Places:
        """Return the places of the bodies at fractional numbers of poses, by a party.

        The party is a solver, whose difference to the reference is magnified, or the empty string
        for the reference.
        """
        moved = self.motion
        places = interpolate_poses(moved.places, at, moved.jumps)
        if party:
            places = places + self.magnify * interpolate_poses(moved.away[party], at, moved.jumps)
        return places

    def strokes(self, places: Places) -> list[Array]:
        """Return all lines of the mechanism (poses, points, 2): outlines of bodies, and rods."""
        in_rods = {k for links in self.motion.rods.values() for k in links}
        found = []
        for k, body in enumerate(self.motion.bodies):
            for outline in body.outlines if k not in in_rods else ():
                closed = np.vstack([outline, outline[:1]]) if len(outline) > 2 else outline
                found.append(move_points(closed, places[:, k]))
        for links in self.motion.rods.values():
            ends = rod_vertices(self.motion, links)
            points = [move_points(at[None], places[:, k]) for k, at in ends]
            found.append(np.concatenate(points, axis=1))
        return found

    def spots(self, places: Places) -> list[Array]:
        """Return the place of each spot, for a guide its two ends: (poses, 1 or 2, 2)."""
        found = []
        for spot in self.motion.spots:
            points = np.stack([spot.at] if spot.to is None else [spot.at, spot.to])
            grounded = np.broadcast_to(points, (len(places), *points.shape))
            found.append(move_points(points, places[:, spot.body]) if spot.body >= 0 else grounded)
        return found

    def numbers(self, kind: str) -> list[int]:
        """Return the indices of the spots of a kind that are on moving bodies."""
        return [i for i, s in enumerate(self.motion.spots) if s.kind == kind and s.body >= 0]

    def springs(self) -> list[int]:
        """Return the indices of the spots that are hinges with a spring."""
        return [i for i, s in enumerate(self.motion.spots) if s.spring and s.kind == "hinge"]

    def zigzags(self, places: Array) -> list[Array]:
        """Return the lines of the springs between points, at one pose."""
        found = []
        for coil in self.motion.coils:
            ends = [
                move_points(at[None], places[None, body])[0, 0] if body >= 0 else at
                for body, at in zip(coil.body, coil.at, strict=True)
            ]
            found.append(zigzag(np.array(ends), self.scale.points))
        return found

    def coil(self, number: int, places: Array, at: Array) -> Array:
        """Return the spiral of a torsion spring, whose ends turn with the bodies of its joint."""
        spot = self.motion.spots[number]
        inner, outer = (places[b, 2] if b >= 0 else 0.0 for b in (spot.body, spot.parent))
        return np.asarray(at + spiral(inner, outer) / self.scale.points)
