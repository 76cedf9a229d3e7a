"""Numbers in README.md and docs/ agree with the data of the benchmarks and with the sources."""

import json
import re
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import pytest
from typer.main import get_command

from docs.make import balancer_fronts, design_table
from docs.make.design_balancer import TABLE, exact
from docs.make.rod_solutions import PRINTED, TAIL
from docs.make.rod_table2 import PRINTED as TABLE2
from proofmass.analytic.balancer import solve
from proofmass.analytic.balancer.measures import precision_points
from proofmass.commands.cli import app
from proofmass.run.sidecar import load_case
from tests.analytic.balancer.balancer_cases import EXTENDING
from tests.analytic.balancer.balancer_table import rows
from tests.shipped import shipped

ROOT = Path(__file__).parent.parent
DESIGNS = json.loads(TABLE.read_text())
THESIS = [row for row in DESIGNS if row["line"]]


def document_text(file: str) -> str:
    """The text of a document with single spaces instead of line breaks."""
    return " ".join((ROOT / file).read_text(encoding="utf-8").split())


def compare_designs(row, theirs, digits):
    """Whether our design is better in error and work reduction, and whether it is at least as good.

    Both designs are rounded to the given digits.
    """
    (error, reduction), (fine, coarse) = (theirs["rmse"], theirs["work_reduction"]), digits
    own = round(row["ours"]["rmse"], fine), round(row["ours"]["work_reduction"], coarse)
    error, reduction = round(error, fine), round(reduction, coarse)
    return (own[0] < error and own[1] > reduction), (own[0] <= error and own[1] >= reduction)


def test_pages_count_the_designs_that_are_better_than_the_thesis():
    better = same = up = down = 0
    for row in THESIS:
        found = [compare_designs(row, row["printed"], (4, 2))]  # the digits of the print
        if "why" not in row["recomputed"]:
            found.append(
                compare_designs(row, row["recomputed"], (15, 13))
            )  # nearly all digits of a float
        strict, good = (all(part) for part in zip(*found, strict=True))
        elbow_down = row["parameters"].get("mode", 1.0) < 0.0
        better, same, down = better + strict, same + (good and not strict), down + elbow_down
        up += good and not elbow_down
    short = (
        f"Of {len(THESIS)} kinds of balancers {better} come out better here in every printed number"
    )
    assert short in document_text("README.md")
    text = document_text("docs/balancer.md")
    assert f"Of the thesis's {len(THESIS)} kinds of balancers, the search finds designs for" in text
    assert f"[{better} that are better in every figure]" in text
    assert f"and for {same} that are better or equal at the printed digits in every figure" in text
    assert f"{down} of the {len(THESIS)} designs have their elbow down" in text
    assert f"{up} are as good or better with the elbow up" in text


def test_the_page_states_the_errors_for_a_pendulum_that_extends():
    angle = precision_points(90)
    ours = next(row["parameters"] for row in THESIS if row["line"] == 1766)
    chains = (EXTENDING, ours, rows()["1766"]["parameters"])
    errors = [
        np.sqrt(
            np.mean(solve(angle, target="weight", **{**chain, "extension2": 0.04})["residual"] ** 2)
        )
        for chain in chains
    ]
    assert (
        f"with an error of {errors[0]:.4f}; the best one for a pendulum that keeps its length has "
        f"{errors[1]:.3f} there, and the thesis's own (line 1766) {errors[2]:.3f}"
    ) in document_text("docs/balancer.md")


def test_page_of_fronts_is_the_one_that_its_command_writes():
    records = json.loads(balancer_fronts.PAGE.read_text())
    page = balancer_fronts.PAGE.with_suffix(".md").read_text(encoding="utf-8")
    assert page == balancer_fronts.page(records)


def test_page_of_designs_is_the_one_that_its_command_writes():
    assert TABLE.with_suffix(".md").read_text(encoding="utf-8") == design_table.page(DESIGNS)


def test_errata_count_the_rows_whose_exact_error_is_larger():
    text = document_text("docs/errata.md")
    three, four = (
        np.array([exact(row)[0] / row["printed"]["rmse"] for row in rows(n).values()])
        for n in (3, 4)
    )  # NaN where the printed parameters have no path to 90 degrees
    paths = [part[np.isfinite(part)] for part in (three, four)]
    larger = [np.sort(part[part > 1.0]) - 1.0 for part in paths]
    assert (
        f"of three segments, {paths[0].size} of {three.size} rows have a path, and the exact "
        f"RMSE is larger in {larger[0].size}, by up to {100 * larger[0][-1]:.0f} %"
    ) in text
    assert (
        f"of four, {paths[1].size} of {four.size} have a path, and it is larger in "
        f"{larger[1].size}, by up to {100 * larger[1][-2]:.0f} % in {larger[1].size - 1} and "
        f"{1 + larger[1][-1]:.1f} times the print in row 1800"
    ) in text


def test_pages_state_the_times_of_the_thesis_for_three_rods():
    """Table 2 of the thesis, lines 1152-1155, prints times from 985 s to 17,241 s."""
    least, most = 985, max(seconds for _, seconds in PRINTED.values())
    assert f"thesis took {least} to {most:,} s for three to six" in document_text("docs/rods.md")
    page = (ROOT / "docs" / "rod_solutions.md").read_text(encoding="utf-8")
    assert page.endswith(TAIL)
    assert f"takes {least} s (n = 15, three solutions) to {most:,} s" in " ".join(TAIL.split())
    seconds = [seconds for _, seconds in TABLE2.values()]
    assert (min(seconds), max(seconds), len(seconds)) == (least, most, 17)
    assert PRINTED.items() <= TABLE2.items()


def test_each_cell_of_table_2_of_the_thesis_has_a_row():
    """Each printed cell has a row; the six solutions are of two orientations of the platform."""
    page = (ROOT / "docs" / "rod_table2.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1:-1] for line in page.splitlines() if re.match(r"\| \d", line)]
    cells = [(int(row[0]), float(row[1]), float(row[2])) for row in rows]
    assert cells == list(TABLE2)
    for row, (solutions, seconds) in zip(rows, TABLE2.values(), strict=True):
        assert (int(row[8]), int(row[9].replace(",", ""))) == (solutions, seconds)
        assert int(row[3].replace(",", "")) == 42 * int(row[0]) ** 3  # nodes
        found, mirrored = int(row[5]), int(row[6])
        assert found <= 3 >= mirrored  # there are three of each orientation with alpha to 20
        assert float(row[1]) < 0.5 or found + mirrored == 6  # wide tolerances find all six


ITEMS_PAGE = (ROOT / "docs" / "documents.md").read_text(encoding="utf-8")
NAMED_PLACES = sorted(
    {
        name
        for line in ITEMS_PAGE.splitlines()
        if line.startswith(("| ", "Beyond"))
        for name in re.findall(r"`([^`]+)`", line)
    }
)
"""Names in backticks in the tables of the page on the documents' items."""


def exists(name: str) -> bool:
    """Whether a name is of an existing command, chart of a case, test, file or Python object."""
    words = name.split()
    if name.startswith("--"):
        return name in (ROOT / "docs" / "balancer.md").read_text(encoding="utf-8")
    if words[0] == "proofmass":
        return words[1] in get_command(app).commands and all(
            (ROOT / path).is_file() for path in words[2:]
        )
    if name.startswith("python -m "):
        return (ROOT / f"{words[2].replace('.', '/')}.py").is_file()
    if ": " in name:
        case, chart = name.split(": ")
        return chart in {one.draw for one in load_case(shipped(f"{case}.toml")).chart}
    if "::" in name:
        file, function = name.split("::")
        (found,) = (ROOT / "tests").rglob(f"{file}.py")
        return f"def {function}(" in found.read_text(encoding="utf-8")
    if "/" in name:
        return (ROOT / name).is_file()
    try:
        resolve_name(name)
    except (AttributeError, ImportError, ValueError):
        return False
    return True


@pytest.mark.parametrize("name", NAMED_PLACES)
def test_places_that_the_page_names_for_items_exist(name):
    assert exists(name)


@pytest.mark.parametrize(
    "name",
    [
        "proofmass fly",
        "proofmass animate models/none.toml",
        "python -m benchmarks.none",
        "fivebar: none",
        "test_hacksaw::none",
        "models/none.toml",
        "proofmass.analytic.none",
    ],
)
def test_places_that_do_not_exist_are_recognized(name):
    assert not exists(name)


def test_every_item_says_where_it_is_or_that_it_is_missing():
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in ITEMS_PAGE.splitlines()
        if line.startswith("| ") and not line.startswith("| item")
    ]
    assert len(rows) > 70
    for item, place, missing in rows:
        assert place or missing, item
        assert "TODO" not in place + missing, item
