"""``proofmass design balancer --all``: all kinds of balancers for one wanted curve."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import typer
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from proofmass.analytic.balancer.measures import TARGETS, Target
from proofmass.analytic.balancer.synthesis import LENGTH_BOUNDS, SPRING_KINDS
from proofmass.commands.command import error_console
from proofmass.commands.design_common import check_cases
from proofmass.commands.tolerances import ToleranceCheck
from proofmass.design.kinds import all_kinds
from proofmass.design.survey import KindResult, Survey, SurveySearch
from proofmass.design.template import write_case
from proofmass.formats.terminal import make_console

SHOWN_DESIGNS = 12
"""Number of designs in the table of the terminal beside the Pareto-optimal ones."""


def survey_balancers(
    wanted: Target,
    segments: int | None,
    springs: str | None,
    extension: tuple[float, float],
    bounds: dict[str, tuple[float, float]],
    seed: int,
    effort: float,
    within: float,
    others: dict[str, dict[str, Any]],
    check_tolerances: ToleranceCheck,
    output: Path,
) -> NoReturn:
    """Search all kinds, write the table, the figure and the cases, and end with an exit code."""
    from proofmass.design.survey_table import write_table  # matplotlib is slow to load

    kinds = all_kinds(
        [segments] if segments else tuple(LENGTH_BOUNDS),
        [springs] if springs else SPRING_KINDS,
        extension,
        bounds,
    )
    found = search_kinds(SurveySearch(kinds, wanted, seed, effort, output))
    make_console().print(kinds_table(found))
    for line in tell_best(found, wanted, within):
        print(line)
    best = found.kinds[0].parameters
    for line in check_tolerances.run(best, wanted, 1.0, output / "tolerances"):
        print(line)
    for file in write_table(found, wanted.name, output / "kinds"):
        print(file)
    code = check_front(found, wanted, others, output)
    raise typer.Exit(code or int(found.kinds[0].rmse > within * largest_moment(wanted)))


def search_kinds(search: SurveySearch) -> Survey:
    """Search all kinds with a progress bar on standard error."""
    columns = (
        TextColumn("{task.description:<34}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[best]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=error_console, transient=True) as bar:
        line = bar.add_task("searching all kinds", total=1, best="")

        def advance(words: str, step: int, steps: int, value: float) -> None:
            best = f"step {step} of {steps}, least error {value:.5f}"
            bar.update(line, description=words, completed=step, total=steps, best=best)

        return search.run(advance)


def kinds_table(found: Survey) -> Table:
    """The best designs and all Pareto-optimal ones, best first, each with its first kind."""
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("", no_wrap=True)
    for name in ("rms error", "largest", "at", "work less"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("parts", justify="right")
    table.add_column("what must be built")
    table.add_column("kind")
    table.add_column("agree", no_wrap=True)
    different = [
        kind
        for k, kind in enumerate(found.kinds)
        if kind.optimal or all(kind.parameters != one.parameters for one in found.kinds[:k])
    ]
    shown = [kind for k, kind in enumerate(different) if k < SHOWN_DESIGNS or kind.optimal]
    for kind in shown:
        table.add_row(
            "*" if kind.optimal else "",
            f"{kind.rmse:.6f}",
            f"{kind.worst:+.5f}",
            f"{np.degrees(kind.worst_angle):.0f}°",
            f"{kind.work_reduction:.2f} %",
            str(kind.parts.count),
            escape(kind.parts.words),
            kind.words,
            f"{kind.agreeing} of {len(kind.searches)}",
        )
    left = len(found.kinds) - len(shown)
    table.caption = (
        "* Pareto-optimal: no kind has both a smaller error and no more parts. Errors over m g r. "
        "agree: searches that ended within a factor 1.2 of the best"
        + (f". {left} more kinds, many with one of these designs, are in kinds.csv" if left else "")
    )
    table.caption_justify = "left"
    return table


def largest_moment(wanted: Target) -> float:
    """Largest size of the wanted moment from 1 to 90 degrees, over m g r [1]."""
    return float(np.abs(wanted(np.radians(np.arange(1.0, 91.0)))).max())


def tell_best(found: Survey, wanted: Target, within: float) -> list[str]:
    """Sentences about the best design, and what would help if it does not reach the curve."""
    best = found.kinds[0]
    share = best.rmse / largest_moment(wanted)
    words = [
        f"best: {best.words}, elbow {'up' if best.variant.mode == 1 else 'down'}; rms error "
        f"{best.rmse:.6f} m g r, {100 * share:.3g} % of the largest wanted moment; largest error "
        f"{best.worst:+.5f} at {np.degrees(best.worst_angle):.0f} degrees",
        f"to be built: {best.parts.words}",
        found.claim,
    ]
    if share <= within:
        return words
    return [
        *words,
        f"No balancer reaches the curve within {100 * within:g} % of its largest moment.",
        *advise(found, wanted),
    ]


def advise(found: Survey, wanted: Target) -> list[str]:
    """What would bring the best design nearer to the curve."""
    best, start = found.kinds[0], float(wanted(np.array([np.pi / 180]))[0])
    advice = []
    if best.at_bounds:
        names = ", ".join(f"{name} = {best.parameters[name]:g}" for name in best.at_bounds)
        advice.append(
            f"It lies on bounds of the search: {names}; --bound NAME=LOW:HIGH widens one."
        )
    if abs(start) > MAX_START_SHARE * largest_moment(wanted):
        advice.append(
            f"The curve wants {start:+.3g} m g r at 1 degree: the moment of a balancer starts from "
            f"0 at rest, and rises no faster than its spring 1."
        )
    if (least := float(wanted(np.radians(np.arange(1.0, 91.0))).min())) < 0.0:
        advice.append(
            f"The curve goes down to {least:+.3g} m g r: springs that are relaxed at rest resist "
            f"the pendulum's motion at first, and a moment below zero needs a chain that snaps."
        )
    advice += [
        f"{word}: the best error is {error:.5f} without and {with_it:.5f} with."
        for word, error, with_it in compare_freedoms(found.kinds)
    ]
    return advice


MAX_START_SHARE = 0.05
"""Share of the largest moment above which a curve does not start from zero [1]."""


def compare_freedoms(kinds: Sequence[KindResult]) -> list[tuple[str, float, float]]:
    """Least errors without and with each freedom that halves the error, if both occur."""
    freedoms = {
        "four segments": lambda v: v.segments == 4,
        "nonlinear springs": lambda v: v.springs != "linear",
        "preload": lambda v: bool(v.preload),
        "contact": lambda v: v.contact,
        "free rest angle": lambda v: v.free_angle,
        "relaxed lengths": lambda v: v.relaxed,
    }
    found = []
    for word, has in freedoms.items():
        least = [
            min((k.rmse for k in kinds if has(k.variant) == given), default=np.inf)
            for given in (False, True)
        ]
        if np.isfinite(least).all() and least[1] < 0.5 * least[0]:
            found.append((word, least[0], least[1]))
    return found


def check_front(
    found: Survey, wanted: Target, others: dict[str, dict[str, Any]], folder: Path
) -> int:
    """Write the Pareto-optimal designs as cases, check them in the engines, and write a report."""
    known = {*TARGETS, "weight"}
    sidecars = [
        write_case(
            folder,
            f"balancer_{wanted.name}_{kind.parts.count}",
            parameters=kind.parameters,
            title=f"Balancer of {kind.parts.count} parts for {wanted.name}: {kind.parts.words}",
            source=f"proofmass design balancer --all: rmse {kind.rmse:.6f}, work reduction "
            f"{kind.work_reduction:.3f} %. {found.claim}",
            target=wanted.name if wanted.name in known else None,
            beside=others,
        )
        for kind in found.front
    ]
    return check_cases(sidecars, folder, named=True)
