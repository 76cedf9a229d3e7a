"""All figures of a case, drawn in another process, so that several cases are drawn in parallel."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib import rc_context

from proofmass.analytic.numerics import Array
from proofmass.case import Case, ChartTable
from proofmass.chart import chart_of
from proofmass.report.charts import chart_figure
from proofmass.report.data import PlottedRun, beyond_limits
from proofmass.report.figures import every, run_figure, save, thumbnail
from proofmass.report.mechanism import (
    distinct,
    jumps_on,
    mechanism,
    path,
    path_figure,
    paths,
)
from proofmass.report.refinements import refine_figure
from proofmass.report.style import RC, Look
from proofmass.report.thumbnail import Thumbnail, reduced
from proofmass.report.views import Viewed, view_figure
from proofmass.sim.mjcf import NATIVE
from proofmass.sim.motion import Measured, Motion, motion
from proofmass.sim.picture import Picture
from proofmass.solve import plan
from proofmass.strict import Kind
from proofmass.worker import isolated

SECONDS = 300.0  # [s] time limit for each drawing of a case
FIGURES = ("overlay", "paths", "difference")
# poses of the first run, and of another; the page interpolates between them
POSES, OTHER_POSES = 121, 73
TRACK = 200  # number of points of a path


@dataclass(frozen=True)
class Charted:
    """The figure of a chart (SVG), its axes in words and its caption; or why there is none."""

    svg: str = ""
    axes: str = ""
    caption: str = ""
    fault: Exception | None = None


@dataclass(frozen=True)
class Drawings:
    """The figures of a case (SVG) by name.

    The note tells why the mechanism is not drawn, or not over the whole run.  The motions are the
    mechanism at many poses, by run; a thumbnail of the first one moves on the index.  `papers` is
    true if the figures were written as PNG too.
    """

    figures: dict[str, str]
    note: str = ""
    charts: tuple[Charted, ...] = ()
    motions: dict[str, Motion] = field(default_factory=dict)
    moving: Thumbnail | None = None
    papers: bool = False


def drawn(
    case: Case,
    runs: list[PlottedRun],
    views: list[Viewed],
    style: dict[str, Look],
    folder: Path,
    slug: str,
    papers: bool = False,
) -> Drawings:
    """Draw all figures of a case and save them as ``folder/slug-….svg``.

    The names of the figures are "mechanism", or "thumbnail" where there is no mechanism, "refine",
    "view-1" and so on, and "chart-1" and so on.  With `papers` they are saved as ``.png`` too, and
    there are also "RUN-overlay", "RUN-paths" and "RUN-difference" of each run with curves, which
    the script of the page draws itself.
    """
    if beyond_limits(runs):
        return Drawings({}, "its runs reached their limits")
    motions, note = moving(case, runs)
    shape = shape_of(case, motions)
    try:
        figures = isolated(
            draw, case, runs, views, style, folder, slug, shape, papers, timeout=SECONDS
        )
    except OSError:  # such as a full disk, on which the other cases would fail as well
        raise
    except Exception as error:
        figures, note = {}, str(error)
    charts = tuple(
        charted(case, table, folder / f"{slug}-chart-{k}", papers)
        for k, table in enumerate(case.chart, 1)
    )
    first = motions.get(next(iter(case.run)))
    moved = reduced(first.picture) if first else None
    return Drawings(figures, note, charts, motions, moved, papers)


def charted(case: Case, table: ChartTable, stem: Path, papers: bool) -> Charted:
    """Compute and draw a chart in another process; an error affects this figure only."""
    try:
        return isolated(draw_chart, case, table, stem, papers, timeout=SECONDS)
    except Exception as error:
        return Charted(fault=error)


def draw_chart(case: Case, table: ChartTable, stem: Path, papers: bool) -> Charted:
    """Compute and draw a chart, and save its figure; called in another process."""
    chart = chart_of(case, table)
    with rc_context(RC):
        svg = save(chart_figure(table.title, chart), stem, papers)
    return Charted(svg, f"{chart.y[0]} over {chart.x[0]}", chart.caption)


def moving(case: Case, runs: list[PlottedRun]) -> tuple[dict[str, Motion], str]:
    """Find the motion of the mechanism in each run.

    The text tells why the first run has no motion, or why its motion ends early.
    """
    found, note, shown = dict[str, Motion](), "", {run.kind: run for run in runs}
    for number, kind in enumerate(case.run):
        try:
            found[kind] = isolated(
                moved_here,
                case,
                kind,
                measured(shown[kind]) if kind in shown else {},
                OTHER_POSES if number else POSES,
                jumps_of_mechanism(shown[kind]) if kind in shown else [],
                timeout=SECONDS,
            )
        except Exception as error:  # an error of a model affects its drawing only
            note = note or ("" if number else str(error))
        else:
            note = note or ("" if number else found[kind].picture.stopped)
    return found, note


def shape_of(case: Case, motions: Mapping[str, Motion]) -> Picture | None:
    """Return the mechanism at some distinct poses of its first run; None without a motion."""
    first = motions.get(next(iter(case.run)))
    return distinct(first.picture) if first else None


def moved_here(
    case: Case, kind: Kind, curves: Measured, count: int, keep: list[int] | None = None
) -> Motion:
    """Find the motion of the mechanism in one run; called in another process.

    `count` is the number of poses; samples before jumps (`keep`) have poses on both sides.
    """
    return motion(case.model_path, plan(case, kind, NATIVE), curves, count, keep or [])


def jumps_of_mechanism(run: PlottedRun) -> list[int]:
    """Return the samples before jumps of the mechanism, of the reference or of any solver."""
    every_one = (run.jumps, *run.jumps_of.values())
    return sorted({k for jumps in every_one for k in jumps.mechanism})


def measured(run: PlottedRun) -> Measured:
    """Return the curves that determine the positions of bodies: compared places and angles.

    By solver, these are the curves of the reference, and the differences of the solver to them.
    """
    names = [n for n in run.channels if run.case.channels[n].si_unit in ("m", "rad")]
    found = {}
    for solver, curves in run.curves.items():
        reference = (run.whole or run.reference[solver]).channels
        own = run.reference[solver].channels
        there = [name for name in names if name in curves.channels]
        found[solver] = (
            {name: reference[name] for name in names},
            {name: curves.channels[name] - own[name] for name in there},
        )
    return found


def draw(
    case: Case,
    runs: list[PlottedRun],
    views: list[Viewed],
    style: dict[str, Look],
    folder: Path,
    slug: str,
    shape: Picture | None,
    papers: bool,
) -> dict[str, str]:
    """Draw and save all figures of a case but its charts; called in another process."""
    found, asked = {}, runs
    runs = [run for run in (one.without_failed for one in runs) if run.curves]
    with rc_context(RC):
        if shape:
            along = tracks(runs, shape)
            stem = folder / f"{slug}-mechanism"
            found["mechanism"] = save(mechanism(case, shape, along), stem, papers)
        elif runs:
            found["thumbnail"] = save(
                thumbnail(runs[0], style), folder / f"{slug}-thumbnail", png=False
            )
        for run in runs if papers else ():
            for what in figures_of(run, shape):
                name = f"{run.kind}-{what}"
                figure = (
                    path_figure(run, shape, style)
                    if shape and what == "paths"
                    else run_figure(run, style, what)
                )
                found[name] = save(figure, folder / f"{slug}-{name}")
        for run in asked:
            if run.refined and (refine := run.case.refine):
                stem = folder / f"{slug}-refine"
                found["refine"] = save(refine_figure(run, refine, style), stem, papers)
        for k, view in enumerate(views, 1):
            stem = folder / f"{slug}-view-{k}"
            found[f"view-{k}"] = save(view_figure(view, style), stem, papers)
    return found


def figures_of(view: PlottedRun, shape: Picture | None) -> Iterator[str]:
    """Return the names of the figures of a run; paths are left out where there are none."""
    return (what for what in FIGURES if what != "paths" or paths(view, shape))


def tracks(views: list[PlottedRun], shape: Picture) -> dict[str, Array]:
    """Return the paths of measured points, by the reference of the first run with curves."""
    return {
        name: every(path(view.longest, name, shape), TRACK, jumps_on(view, name, shape))
        for view in views[:1]
        for name in paths(view, shape)
        if name in shape.tracks
    }
