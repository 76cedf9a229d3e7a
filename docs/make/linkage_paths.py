"""Published problems of path synthesis, searched again by ``proofmass design linkage``'s search.

    python -m docs.make.linkage_paths [PROBLEM ...] [--effort 1]
    python -m docs.make.linkage_paths --quick

A PROBLEM is a number in tests/data/linkage_paths.json, from 1; without one all are searched.
Writes docs/linkage_paths.json, and from it the page and the figure of the same name.  The errors of
printed linkages are recomputed by `proofmass.analytic.linkages.fourbar`, not by the search's
curves.
"""

import json
import time
from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from scipy.optimize import minimize_scalar

from benchmarks import ROOT, command, folders
from proofmass.analytic.linkages import fourbar
from proofmass.base.arrays import Array, Complex
from proofmass.design.linkage_designs import (
    LinkageDesign,
    distances_from_line,
    make_tasks,
    search_designs_of_path,
)
from proofmass.design.linkage_figure import draw_design
from proofmass.design.linkage_path import PATH_EFFORT
from proofmass.design.path_points import PathPoints
from proofmass.report.style import RC

DATA = ROOT / "tests" / "data" / "linkage_paths.json"
PAGE = ROOT / "docs" / "linkage_paths.json"
LENGTHS = ("crank", "coupler", "rocker", "ground")
CURVE_GRID = 720  # crank angles of a turn from which those nearest to the points are chosen
TARGET_POINTS = 24  # points of a curve that is given by the linkage that draws it
CLASSICAL_POINTS = 12
EXACT_SHARE = 1e-8  # error over the size of the path [1] below which a design passes exactly
CLASSICAL = "drawn by a classical linkage"
"""What is known of paths that were not published as problems."""
Problem = dict[str, Any]
HEAD = """# Published paths designed again

`python -m docs.make.linkage_paths` made this page, with the search of `proofmass design linkage`
at its usual effort, seed 1, four-bars in both assembly modes, without a limit of the transmission
angle, and within the bounds of the problem where a source states them. All problems with their
sources are in `tests/data/linkage_paths.json`.

The papers themselves could not be opened for this page. The points, bounds and lengths are those of
public programs that list them for these papers, which the file names; no error is quoted from a
paper. The number "printed" is the sum of the squared distances between the points and the coupler
point of the printed *linkage*, recomputed by the closed form `fourbar` from its printed lengths, in
the better assembly mode. Where the problem has no crank angles, they are those of least error that
pass the points in order, or the printed ones if these are better: a printed linkage is never judged
below its worth, except that its printed digits limit it. Of several printed linkages the best
counts.

All our designs have a crank that turns fully and pass the points in their order within one turn.
Their errors are recomputed by the closed form too. A ratio of 1 is 1 to four digits, and not below.
"Descents near" is how many of the refined descents ended within a factor 1.2 of the best error, of
all descents: no search proves that nothing better exists.

"""
EXACT_HEAD = """
## Paths that a linkage passes exactly

For these points curves through all of them are known, from polynomial homotopy, or because a
classical linkage draws them. A curve of the first kind need not be drawn by a crank that turns
fully, nor in the order of the points, as ours must; where none of ours is exact, none was found
with such a crank. The number is our largest distance from a point over the size of the path.
Published problems of slider-cranks with printed points were not found.

"""


def linkage_curve(linkage: Problem, mode: int, angles: Array) -> Complex:
    """Places of the coupler point of a printed four-bar at crank angles from the x axis [rad]."""
    along, across = linkage.get("point_along"), linkage.get("point_across")
    if "polar" in linkage:
        length, angle = linkage["polar"]
        along, across = length * np.cos(angle), length * np.sin(angle)
    curves = fourbar.solve(
        angles,
        **{name: linkage[name] for name in LENGTHS},
        ground_angle=linkage["ground_angle"],
        mode=mode,
        point_along=along,
        point_across=across,
        only={"point_x", "point_y"},
    )
    place = curves["point_x"] + 1j * curves["point_y"]
    return np.asarray(place + complex(linkage["pivot_x"], linkage["pivot_y"]))


def path_of(problem: Problem) -> PathPoints:
    """The path of a problem."""
    if "target" in problem:
        angles = np.arange(TARGET_POINTS) * 2.0 * np.pi / TARGET_POINTS
        target = problem["target"]
        points = linkage_curve(target, target.get("mode", 1), angles)
    else:
        points = np.array([complex(*pair) for pair in problem["points"]])
    angles = problem.get("angles")
    return PathPoints(
        points,
        None if angles is None else np.radians(angles),
        None,
        problem.get("angles_from", "first"),
        problem.get("closed", False),
    )


def printed_error(linkage: Problem, path: PathPoints) -> float:
    """The least sum of squared distances of a printed linkage from the points [m^2]."""
    return min((mode_error(linkage, mode, path) for mode in fourbar.MODES), default=float("inf"))


def mode_error(linkage: Problem, mode: int, path: PathPoints) -> float:
    """The sum of squared distances of a printed linkage in one assembly mode [m^2]."""
    turn = linkage["ground_angle"]
    if path.angles is not None:
        first = linkage.get("first_crank_angle", 0.0)
        return squares(linkage, mode, path, turn + first + path.angles)
    found = least_error(linkage, mode, path)
    if "crank_angles" in linkage:
        printed = squares(linkage, mode, path, turn + np.array(linkage["crank_angles"]))
        return min(found, printed)
    return found


def squares(linkage: Problem, mode: int, path: PathPoints, angles: Array) -> float:
    """Sum of squared distances from the points at given crank angles [m^2]; inf if not reached."""
    try:
        return float(np.sum(np.abs(linkage_curve(linkage, mode, angles) - path.points) ** 2))
    except ValueError:  # the loop cannot be closed there
        return float("inf")


def least_error(linkage: Problem, mode: int, path: PathPoints) -> float:
    """The least sum of squares over all crank angles that pass the points in order [m^2].

    Angles of a grid are chosen by dynamic programming, for each first angle and each sense; those
    of the best choice are then refined one by one within a step of the grid.
    """
    grid = np.arange(CURVE_GRID) * 2.0 * np.pi / CURVE_GRID
    try:
        curve = linkage_curve(linkage, mode, grid)
    except ValueError:  # the crank does not turn fully
        return float("inf")
    best, angles = float("inf"), grid[:0]
    for sense in (1, -1):
        value, chosen = ordered_choice(np.abs(curve[::sense] - path.points[:, None]) ** 2)
        if value < best:
            best, angles = value, sense * (chosen + (sense < 0)) * 2.0 * np.pi / CURVE_GRID
    step = 2.0 * np.pi / CURVE_GRID
    return sum(
        float(
            minimize_scalar(
                lambda angle, k=k: float(
                    np.abs(linkage_curve(linkage, mode, np.array([angle]))[0] - path.points[k]) ** 2
                ),
                bounds=(start - step, start + step),
                method="bounded",
                options={"xatol": 1e-12},
            ).fun
        )
        for k, start in enumerate(angles)
    )


def ordered_choice(costs: Array) -> tuple[float, Array]:
    """The least sum of costs (N, M) of cyclic columns that do not fall from row to row.

    Returns the sum and the columns (N,), which cover at most one round of M.
    """
    n, m = costs.shape
    best, first = float("inf"), 0
    turned = np.concatenate([costs, costs], axis=1)
    starts = np.arange(m)
    windows = starts[:, None] + np.arange(m + 1)
    total = np.full((m, m + 1), np.inf)
    total[:, 0] = costs[0]
    for k in range(1, n):
        total = np.minimum.accumulate(total, axis=1) + turned[k][windows % m]
    ends = total.min(axis=1)
    first, best = int(ends.argmin()), float(ends.min())
    row = turned[:, first : first + m]
    row = np.concatenate([row, row[:, :1]], axis=1)
    sums = [np.where(np.arange(m + 1) == 0, row[0], np.inf)]
    for k in range(1, n):
        sums.append(np.minimum.accumulate(sums[-1]) + row[k])
    chosen = [int(sums[-1].argmin())]
    for k in range(n - 2, -1, -1):
        chosen.append(int(sums[k][: chosen[-1] + 1].argmin()))
    return best, np.array(chosen[::-1]) + first


def our_squares(design: LinkageDesign) -> float:
    """The sum of squared distances of a design, by the closed form `fourbar` [m^2]."""
    p = design.parameters
    found = linkage_curve(p, design.task.kind.mode, design.angles)
    return float(np.sum(np.abs(found - design.path.points) ** 2))


def search_problem(problem: Problem, effort: float) -> Problem:
    """The record of a problem: the best printed linkage and our best design."""
    began, path = time.process_time(), path_of(problem)
    bounds = {name: tuple(pair) for name, pair in problem.get("bounds", {}).items()}
    tasks = make_tasks(path, ("fourbar",), bounds=bounds)
    heats = tuple((max(16, round(count * effort)), steps) for count, steps in PATH_EFFORT.heats)
    found = search_designs_of_path(tasks, replace(PATH_EFFORT, heats=heats))
    record = {
        "name": problem["name"],
        "points": path.points.size,
        "size": path.size,
        "angles": path.angles is not None,
        "descents": found.descents,
        "near": found.reached,
        "cpu_seconds": round(time.process_time() - began, 1),
    }
    if printed := problem.get("linkages"):
        errors = [printed_error(one, path) for one in printed]
        k = int(np.argmin(errors))
        record |= {"printed": errors[k], "who": printed[k]["who"]}
    best = found.designs[0]
    return record | {
        "ours": our_squares(best),
        "largest": float(best.errors.max()),
        "mode": best.task.kind.mode,
        "sense": best.task.sense,
        "grashof": best.grashof,
        "transmission": [float(angle) for angle in np.degrees(best.transmission)],
        "parameters": best.parameters,
        "crank_angles": best.angles.tolist(),
    }


def classical_problems() -> list[Problem]:
    """Paths that classical linkages of the data draw."""
    found = []
    for linkage in json.loads(DATA.read_text(encoding="utf-8"))["classical"]:
        first, last = np.radians(linkage["from_to"])
        angles = np.linspace(first, last, CLASSICAL_POINTS)
        points = linkage_curve(linkage, linkage["mode"], angles)
        found.append(
            {
                "name": linkage["who"],
                "points": [[z.real, z.imag] for z in points],
                "exact": CLASSICAL,
            }
        )
    return found


def is_exact(record: Problem) -> bool:
    """Whether our design passes all points exactly."""
    return bool(record["largest"] <= EXACT_SHARE * record["size"])


def is_as_good(record: Problem) -> bool:
    """Whether our design is at least as good as the printed one."""
    return bool(record["ours"] <= record["printed"])


def page(records: list[Problem]) -> str:
    """The text of docs/linkage_paths.md."""
    compared = [one for one in records if "printed" in one]
    exact = [one for one in records if one.get("exact")]
    alone = [one for one in records if "printed" not in one and not one.get("exact")]
    good = sum(map(is_as_good, compared))
    published = sum(is_exact(one) for one in exact if one["exact"] != CLASSICAL)
    lines = [
        HEAD,
        f"Of {len(compared)} problems with a printed linkage our design is at least as good in "
        f"{good}.\n\n",
        "| problem | points | crank angles | printed [m²] | by | ours [m²] | printed / ours | "
        "Grashof class | descents near | s |\n|---|---|---|---|---|---|---|---|---|---|\n",
        *map(compared_row, compared),
        EXACT_HEAD,
        f"{sum(map(is_exact, exact))} of {len(exact)} are passed exactly. With the {published} "
        f"among them that were published, our designs\nare at least as good as printed in "
        f"{good + published} published problems. Three of these are one semicircle with three\n"
        f'sets of bounds. The points of the paths with "{CLASSICAL}" are ours.\n\n',
        "| path | points | known | ours, largest distance / size | exact | Grashof class | s |\n"
        "|---|---|---|---|---|---|---|\n",
        *(
            f"| {one['name']} | {one['points']} | {one['exact']} | "
            f"{one['largest'] / one['size']:.1e} | {'yes' if is_exact(one) else 'no'} | "
            f"{one['grashof']} | {one['cpu_seconds']:.0f} |\n"
            for one in exact
        ),
        "\n## A problem whose result was not seen\n\n",
        *(
            f"{one['name']}: our sum of squares is {one['ours']:.4g} m² within the bounds of its "
            f"program.\n"
            for one in alone
        ),
        "\n![Some of our designs, with the curves of the best printed linkages dashed]"
        "(linkage_paths.png)\n",
    ]
    return "".join(lines)


def compared_row(one: Problem) -> str:
    """The row of a problem with a printed linkage."""
    return (
        f"| {one['name']} | {one['points']} | {'given' if one['angles'] else 'free'} | "
        f"{one['printed']:.7g} | {one['who']} | {one['ours']:.7g} | "
        f"{one['printed'] / one['ours']:.4g} | "
        f"{one['grashof']} | {one['near']} of {one['descents']} | {one['cpu_seconds']:.0f} |\n"
    )


def design_of(problem: Problem, record: Problem) -> LinkageDesign:
    """Our design of a record, for a figure."""
    path = path_of(problem)
    tasks = make_tasks(path, ("fourbar",), (record["mode"],))
    task = next(one for one in tasks.values() if one.sense == record["sense"])
    angles = record["crank_angles"][: task.angle_count]
    return LinkageDesign(task, np.array([*record["parameters"].values(), *angles]))


def draw(problems: list[Problem], records: list[Problem]) -> Figure:
    """The figure of some problems with our design, and the printed curve dashed."""
    drawn = [
        (problem, record)
        for problem, record in zip(problems, records, strict=True)
        if "printed" in record and record["points"] >= 10
    ][:6]
    with rc_context(RC):
        figure = Figure((11.0, 7.2), layout="constrained")
        panels = figure.subplots(2, 3, squeeze=False).flat
        for axes, (problem, record) in zip(panels, drawn, strict=False):
            draw_design(axes, design_of(problem, record), 1)
            axes.set_title(record["name"])
            (printed,) = [one for one in problem["linkages"] if one["who"] == record["who"]]
            draw_printed(axes, printed, path_of(problem))
        return figure


def draw_printed(axes: Any, linkage: Problem, path: PathPoints) -> None:
    """Draw the whole curve of a printed linkage, in the mode that is nearer to the points."""
    grid = np.linspace(0.0, 2.0 * np.pi, CURVE_GRID)
    curves = [linkage_curve(linkage, mode, grid) for mode in fourbar.MODES]
    near = min(curves, key=lambda one: float(distances_from_line(path.points, one).sum()))
    axes.plot(near.real, near.imag, "--", color="#CC79A7", lw=1.0, zorder=2)


def main(argv: Sequence[str] | None = None) -> None:
    """Search the problems that are named, or all, and write the page of all known records."""
    parser = command(__doc__)
    parser.add_argument("problems", nargs="*", type=int)
    parser.add_argument("--effort", type=float, default=1.0)
    given = parser.parse_args(argv)
    problems = [*json.loads(DATA.read_text(encoding="utf-8"))["problems"], *classical_problems()]
    numbers = given.problems or ([2, 9] if given.quick else range(1, len(problems) + 1))
    known = {}
    if PAGE.exists():
        known = {record["name"]: record for record in json.loads(PAGE.read_text())}
    for number in numbers:
        problem = problems[number - 1]
        record = search_problem(problem, 0.03 if given.quick else given.effort)
        if "exact" in problem:
            record["exact"] = problem["exact"]
        known[problem["name"]] = record
        print(
            f"{number} {record['name']}: printed {record.get('printed')}, ours {record['ours']}, "
            f"{record['cpu_seconds']} s",
            flush=True,
        )
        if not given.quick:  # a long run that is stopped keeps what it has
            write_page(problems, known, ROOT / "docs")
    with folders(given.quick, ROOT) as (_, docs):
        write_page(problems, known, docs)


def write_page(problems: list[Problem], known: dict[str, Problem], docs: Path) -> None:
    """Write the records, the page and the figure into a folder."""
    there = [one for one in problems if one["name"] in known]
    records = [known[one["name"]] for one in there]
    (docs / PAGE.name).write_text(json.dumps(records, indent=1) + "\n")
    (docs / PAGE.name).with_suffix(".md").write_text(page(records))
    data = BytesIO()
    draw(there, records).savefig(data, dpi=110)
    (docs / PAGE.name).with_suffix(".png").write_bytes(data.getvalue())


if __name__ == "__main__":
    main()
