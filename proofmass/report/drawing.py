"""All figures of a case, drawn in another process: several cases are drawn side by side."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from matplotlib import rc_context

from proofmass.case import Case
from proofmass.isolate import isolated
from proofmass.report.data import Shown
from proofmass.report.figures import save, sheet, thumbnail
from proofmass.report.mechanism import mechanism, small
from proofmass.report.paths import path, path_sheet, paths
from proofmass.report.poses import distinct
from proofmass.report.style import RC, Look
from proofmass.solve import plan
from sim.picture import Picture
from sim.picture_poses import picture
from sim.protocol import Array

SECONDS = 300.0  # until the drawings of a case are given up
SHEETS = ("overlay", "paths", "difference")


@dataclass(frozen=True)
class Drawings:
    """The figures of a case by name (SVG), and why the mechanism is not drawn, or not all of it."""

    figures: dict[str, str]
    note: str = ""


def drawn(case: Case, views: list[Shown], style: dict[str, Look], folder: Path,
          slug: str) -> Drawings:
    """Draw everything of a case and save it as ``folder/slug-….svg`` and ``.png``.

    Names are ``mechanism``, ``thumbnail`` and, for each run with curves, ``RUN-overlay``,
    ``RUN-paths``, ``RUN-difference``.
    """
    shape, note = pictured(case)
    return Drawings(isolated(draw, case, views, style, folder, slug, shape, timeout=SECONDS), note)


def pictured(case: Case) -> tuple[Picture | None, str]:
    """The mechanism at some poses; otherwise, or if these are not all, the reason."""
    try:
        run = plan(case, next(iter(case.run)), "mujoco")
        whole = isolated(picture, case.model_path, run, timeout=SECONDS)
        return distinct(whole), whole.stopped
    except Exception as error:  # whatever is wrong with a model costs its drawing, not the report
        return None, str(error)


def draw(case: Case, views: list[Shown], style: dict[str, Look], folder: Path, slug: str,
         shape: Picture | None) -> dict[str, str]:
    """What `drawn` does in the other process."""
    found, views = {}, [v for v in views if v.curves]
    with rc_context(RC):
        if shape:
            along = tracks(views, shape)
            stem = folder / f"{slug}-mechanism"
            found["mechanism"] = save(mechanism(case, shape, along), stem)
            found["thumbnail"] = save(small(shape, along), stem.with_name(f"{slug}-thumbnail"),
                                      png=False)
        elif views:
            found["thumbnail"] = save(thumbnail(views[0], style), folder / f"{slug}-thumbnail",
                                      png=False)
        for view in views:
            for what in sheets(view, shape):
                name = f"{view.kind}-{what}"
                figure = (path_sheet(view, shape, style) if shape and what == "paths" else
                          sheet(view, style, what))
                found[name] = save(figure, folder / f"{slug}-{name}")
    return found


def sheets(view: Shown, shape: Picture | None) -> Iterator[str]:
    """The figures of a run: paths only where there are any."""
    return (what for what in SHEETS if what != "paths" or paths(view, shape))


def tracks(views: list[Shown], shape: Picture) -> dict[str, Array]:
    """Paths of the points that sensors follow, by the reference of the first run with curves."""
    return {name: path(view.longest, name, shape)[:: max(len(view.longest.x) // 200, 1)]
            for view in views[:1] for name in paths(view, shape) if name in shape.tracks}
