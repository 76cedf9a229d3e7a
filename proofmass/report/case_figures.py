"""All figures of a case, drawn in another process, so that several cases are drawn in parallel."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib import rc_context

from proofmass.base.arrays import Array
from proofmass.base.strict import Kind
from proofmass.base.worker import call_isolated
from proofmass.case.case import Case, ChartTable
from proofmass.reference.charts import compute_chart
from proofmass.report.charts import chart_figure
from proofmass.report.data import PlottedRun, all_reached_limits
from proofmass.report.figures import curve_thumbnail, run_figure, save, thin_path
from proofmass.report.mechanism import (
    distinct_poses,
    mechanism_figure,
    path_figure,
    path_jumps,
    path_names,
    point_path,
)
from proofmass.report.refinements import refine_figure
from proofmass.report.style import RC, Look
from proofmass.report.thumbnail import Thumbnail, reduce_picture
from proofmass.report.views import Viewed, view_figure
from proofmass.run.solve import plan_run
from proofmass.sim.engines import NATIVE_ENGINE
from proofmass.sim.motion import Measured, Motion, motion
from proofmass.sim.picture import Picture

FIGURE_SECONDS = 300.0  # [s] time limit for each drawing of a case
RUN_FIGURES = ("overlay", "paths", "difference")
# poses of the first run, and of another; the page interpolates between them
FIRST_RUN_POSES, OTHER_RUN_POSES = 121, 73
PATH_POINTS = 200  # number of points of a path


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


def draw_case(
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
    if all_reached_limits(runs):
        return Drawings({}, "its runs reached their limits")
    motions, note = find_motions(case, runs)
    shape = mechanism_poses(case, motions)
    try:
        figures = call_isolated(
            draw_figures,
            case,
            runs,
            views,
            style,
            folder,
            slug,
            shape,
            papers,
            timeout=FIGURE_SECONDS,
        )
    except OSError:  # such as a full disk, on which the other cases would fail as well
        raise
    except Exception as error:
        figures, note = {}, str(error)
    charts = tuple(
        draw_chart_isolated(case, table, folder / f"{slug}-chart-{k}", papers)
        for k, table in enumerate(case.chart, 1)
    )
    first = motions.get(next(iter(case.run)))
    moved = reduce_picture(first.picture) if first else None
    return Drawings(figures, note, charts, motions, moved, papers)


def draw_chart_isolated(case: Case, table: ChartTable, stem: Path, papers: bool) -> Charted:
    """Compute and draw a chart in another process; an error affects this figure only."""
    try:
        return call_isolated(draw_chart, case, table, stem, papers, timeout=FIGURE_SECONDS)
    except Exception as error:
        return Charted(fault=error)


def draw_chart(case: Case, table: ChartTable, stem: Path, papers: bool) -> Charted:
    """Compute and draw a chart, and save its figure; called in another process."""
    chart = compute_chart(case, table)
    with rc_context(RC):
        svg = save(chart_figure(table.title, chart), stem, papers)
    return Charted(svg, f"{chart.y[0]} over {chart.x[0]}", chart.caption)


def find_motions(case: Case, runs: list[PlottedRun]) -> tuple[dict[str, Motion], str]:
    """Find the motion of the mechanism in each run.

    The text tells why the first run has no motion, or why its motion ends early.
    """
    found, note, shown = dict[str, Motion](), "", {run.kind: run for run in runs}
    for number, kind in enumerate(case.run):
        try:
            found[kind] = call_isolated(
                compute_motion,
                case,
                kind,
                measured_curves(shown[kind]) if kind in shown else {},
                OTHER_RUN_POSES if number else FIRST_RUN_POSES,
                mechanism_jumps(shown[kind]) if kind in shown else [],
                timeout=FIGURE_SECONDS,
            )
        except Exception as error:  # an error of a model affects its drawing only
            note = note or ("" if number else str(error))
        else:
            note = note or ("" if number else found[kind].picture.stopped)
    return found, note


def mechanism_poses(case: Case, motions: Mapping[str, Motion]) -> Picture | None:
    """Return the mechanism at some distinct poses of its first run; None without a motion."""
    first = motions.get(next(iter(case.run)))
    return distinct_poses(first.picture) if first else None


def compute_motion(
    case: Case, kind: Kind, curves: Measured, count: int, keep: list[int] | None = None
) -> Motion:
    """Find the motion of the mechanism in one run; called in another process.

    `count` is the number of poses; samples before jumps (`keep`) have poses on both sides.
    """
    return motion(case.model_path, plan_run(case, kind, NATIVE_ENGINE), curves, count, keep or [])


def mechanism_jumps(run: PlottedRun) -> list[int]:
    """Return the samples before jumps of the mechanism, of the reference or of any solver."""
    every_one = (run.jumps, *run.jumps_of.values())
    return sorted({k for jumps in every_one for k in jumps.mechanism})


def measured_curves(run: PlottedRun) -> Measured:
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


def draw_figures(
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
    found, all_runs = {}, runs
    runs = [run for run in (one.without_failed for one in runs) if run.curves]
    with rc_context(RC):
        if shape:
            along = measured_paths(runs, shape)
            stem = folder / f"{slug}-mechanism"
            found["mechanism"] = save(mechanism_figure(case, shape, along), stem, papers)
        elif runs:
            found["thumbnail"] = save(
                curve_thumbnail(runs[0], style), folder / f"{slug}-thumbnail", png=False
            )
        for run in runs if papers else ():
            for what in RUN_FIGURES:
                if what == "paths" and not path_names(run, shape):
                    continue
                name = f"{run.kind}-{what}"
                figure = (
                    path_figure(run, shape, style)
                    if shape and what == "paths"
                    else run_figure(run, style, what)
                )
                found[name] = save(figure, folder / f"{slug}-{name}")
        for run in all_runs:
            if run.refined and (refine := run.case.refine):
                stem = folder / f"{slug}-refine"
                found["refine"] = save(refine_figure(run, refine, style), stem, papers)
        for k, view in enumerate(views, 1):
            stem = folder / f"{slug}-view-{k}"
            found[f"view-{k}"] = save(view_figure(view, style), stem, papers)
    return found


def measured_paths(views: list[PlottedRun], shape: Picture) -> dict[str, Array]:
    """Return the paths of measured points, by the reference of the first run with curves."""
    return {
        name: thin_path(
            point_path(view.longest, name, shape), PATH_POINTS, path_jumps(view, name, shape)
        )
        for view in views[:1]
        for name in path_names(view, shape)
        if name in shape.tracks
    }
