"""``proofmass design linkage``: linkages for a path, the best of them as a case that is checked."""

import json
from pathlib import Path

import numpy as np
import typer

from proofmass.base.files import make_folder, protect, write_output
from proofmass.commands.command import error_console, exit_on_error, progress_bar
from proofmass.commands.design_common import check_cases, parse_bounds
from proofmass.design.linkage_case import write_linkage_case
from proofmass.design.linkage_designs import (
    ASSEMBLIES,
    LINKAGE_KINDS,
    FoundDesigns,
    LinkageDesign,
    make_tasks,
    search_designs_of_path,
)
from proofmass.design.linkage_path import PATH_EFFORT, PathTask
from proofmass.design.linkage_record import (
    as_csv,
    describe_search,
    design_lines,
    kind_words,
    points_as_csv,
    shortfall,
)
from proofmass.design.path_points import read_points
from proofmass.design.search import Effort

BOUND_UNITS = " in m, or deg for an angle, such as crank=0.02:0.05 or ground_angle=0:0"
"""How a message on a wrong --bound ends."""
LEAST_DESCENTS = 16  # of a search with the least effort


def design_linkage(
    points: Path,
    kind: str,
    mode: str,
    angles_from: str,
    closed: bool,
    transmission: float,
    bound: list[str] | None,
    seed: int,
    effort: float,
    output: Path,
) -> None:
    """Run ``proofmass design linkage``; `proofmass.commands.cli` describes the parameters."""
    with exit_on_error(f"{output} keeps the state"):
        path = read_points(points, angles_from, closed)
        tasks = make_tasks(
            path,
            LINKAGE_KINDS if kind == "both" else (kind,),
            ASSEMBLIES[mode],
            parse_bounds(bound or [], BOUND_UNITS, bound_unit),
            np.radians(transmission),
        )
        protect([points])
        make_folder(output)
        found = search_with_progress(tasks, path_effort(effort, seed), output)
        if not found.designs:
            error_console.print(shortfall(found), style="yellow")
            raise typer.Exit(1)
        write_designs(found, tasks, seed, output)
        code = check_linkage(found.designs[0], points, seed, output)
        if why := shortfall(found):
            error_console.print(why, style="yellow")
        raise typer.Exit(max(code, int(bool(why))))


def bound_unit(name: str) -> float:
    """The SI value of the unit in which bounds of a parameter are given: degrees of angles."""
    return np.pi / 180 if name.endswith("angle") else 1.0


def path_effort(effort: float, seed: int) -> Effort:
    """The usual effort of a search with `effort` times as many descents."""
    return PATH_EFFORT.scaled(effort, seed, LEAST_DESCENTS)


def search_with_progress(tasks: dict[str, PathTask], effort: Effort, folder: Path) -> FoundDesigns:
    """Search with a progress bar on standard error."""
    with progress_bar() as advance:

        def tell(name: str, step: int, steps: int, value: float) -> None:
            size = next(iter(tasks.values())).path.size
            advance(f"{name} error {value * size:.3g}", step, steps)

        return search_designs_of_path(tasks, effort, folder, tell)


def write_designs(found: FoundDesigns, tasks: dict[str, PathTask], seed: int, folder: Path) -> None:
    """Write and print the designs, and draw them."""
    from proofmass.design.linkage_figure import write_figure  # matplotlib is slow to load

    record = {"seed": seed, **describe_search(tasks, found)}
    write_output(folder / "design.json", json.dumps(record, indent=1))
    write_output(folder / "designs.csv", as_csv(found.designs))
    write_output(folder / "passed.csv", points_as_csv(found.designs[0]))
    for line in design_lines(found):
        print(line)
    for file in write_figure(found.designs, folder / "designs"):
        print(file)


def check_linkage(design: LinkageDesign, points: Path, seed: int, folder: Path) -> int:
    """Write the case, check it in the engines, write a report, and return the exit code."""
    sidecar = write_linkage_case(
        folder,
        "linkage",
        design,
        title=f"{kind_words(design).capitalize()} through the points of {points.name}",
        source=f"proofmass design linkage {points.name}, seed {seed}: error {design.rms:.6g} m rms",
    )
    return check_cases([sidecar], folder)
