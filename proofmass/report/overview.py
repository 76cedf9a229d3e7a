"""The first table of a case's page: the largest error of each solver, and the allowed error.

A row is a kind of quantity of a run, a column a solver.  A cell shows one channel: the one whose
error over what is allowed is largest, of channels that are not checked the one with the largest
error as a share of the range of its reference.  A bar shows the error over what is allowed, on a
linear axis that is the same on all pages.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from proofmass.base.wording import number
from proofmass.report.page import slug
from proofmass.report.words import RUNS, START_RATIO
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import CHECKED_OUTCOMES, EMPTY_OUTCOMES, Outcome

FIRST_DECADE, LAST_DECADE = -16.4, 0.6  # decades at the ends of the axis
AXIS_DECADES = (-15, -10, -5, 0)
ALLOWED_PLACE = 75.0
"""Place of an error that is just allowed on a bar [%]; what is beyond is drawn red."""
QUANTITY_ORDER = ("position", "velocity", "acceleration", "moment", "force", "energy", "other")


@dataclass(frozen=True)
class ErrorCell:
    """One kind of quantity of one solver in one run.

    Attributes
    ----------
    solver, text, note : str
        The solver, its error, and a note: the allowed error, or why there is none.
    bad : bool
        Whether it differs, is undecided or failed.
    link, title : str
        Address of the curve on the page, and the hint on the link.
    width : float, optional
        Width of the bar of the error over what is allowed, see `bar_width` [%]; None if the channel
        is not checked.
    """

    solver: str
    text: str = ""
    note: str = ""
    bad: bool = False
    link: str = ""
    title: str = ""
    width: float | None = None


@dataclass(frozen=True)
class OverviewRow:
    """A kind of quantity, and a cell for each solver; None where a solver has no such run."""

    kind: str
    cells: tuple[ErrorCell | None, ...]

    @property
    def lanes(self) -> list[ErrorCell]:
        """The cells that have a bar."""
        return [cell for cell in self.cells if cell and cell.width is not None]

    @property
    def description(self) -> str:
        """The drawing in words."""
        parts = [f"{cell.solver} {cell.text}, {cell.note}" for cell in self.lanes]
        return f"{self.kind}: {'; '.join(parts)}"


@dataclass(frozen=True)
class OverviewRun:
    """The rows of one run in the table."""

    kind: str
    title: str
    rows: tuple[OverviewRow, ...]


def bar_width(ratio: float) -> float:
    """Return the width of the bar of an error over what is allowed [%], linear up to its end.

    >>> bar_width(0.0), bar_width(1.0), bar_width(1.2), bar_width(2.4e10)
    (0.0, 75.0, 90.0, 100.0)
    """
    return round(min(ALLOWED_PLACE * ratio, 100.0), 2)


def axis_place(share: float) -> float:
    """Return the place of a share of the range on the axis [%].

    >>> axis_place(10**FIRST_DECADE), axis_place(0.0), axis_place(1e9)
    (0.0, 0.0, 100.0)
    """
    decade = math.log10(share) if share > 0 else FIRST_DECADE
    inside = min(max(decade, FIRST_DECADE), LAST_DECADE)
    return round(100 * (inside - FIRST_DECADE) / (LAST_DECADE - FIRST_DECADE), 2)


def axis_labels() -> list[tuple[str, float]]:
    """Return the labels of the axis and their places [%]."""
    return [("1" if d == 0 else f"1e{d}", axis_place(10.0**d)) for d in AXIS_DECADES]


def overview_table(data: Mapping[str, Any]) -> list[OverviewRun]:
    """Return the table of a case, from its dict of `proofmass.report.case_data.case_data`."""
    solvers = list(data["solvers"])
    found = []
    for kind, run in data["runs"].items():
        rows = []
        kinds = {name: channel["kind"] for name, channel in run["channels"].items()}
        for quantity in QUANTITY_ORDER:
            names = [name for name, own in kinds.items() if own == quantity]
            if names:
                cells = [error_cell(data, kind, solver, names) for solver in solvers]
                rows.append(OverviewRow(quantity, tuple(cells)))
        if not rows and run["failed"]:
            rows.append(
                OverviewRow("curves", tuple(error_cell(data, kind, s, ()) for s in solvers))
            )
        if rows:
            found.append(OverviewRun(kind, RUNS[kind].title, tuple(rows)))
    return found


def error_cell(
    data: Mapping[str, Any], kind: str, solver: str, names: Iterable[str]
) -> ErrorCell | None:
    """Return the cell of a solver for some channels of a run; None if it has no such run."""
    run = data["runs"][kind]
    if solver not in run["solvers"]:
        return None
    own = run["solvers"][solver]["comparisons"]
    there = {name: own[name] for name in names if name in own}
    known = {name: c for name, c in there.items() if c["share"] is not None}
    if solver in run["failed"]:
        return ErrorCell(solver, "", run["failed"][solver]["outcome"], bad=True)
    broken = [n for n, c in there.items() if c["share"] is None and c["outcome"] == "differs"]
    if broken:
        link = curve_address(kind, solver, broken[0], there[broken[0]]["at"] or 0.0)
        return ErrorCell(solver, "no number", f"in {broken[0]}", True, link, f"{broken[0]}: show")
    if not known:
        return ErrorCell(solver, "", "not available")
    wrong = (Outcome.DIFFERS, Outcome.UNDECIDED, *EMPTY_OUTCOMES)
    bad = {name: c for name, c in known.items() if c["outcome"] in wrong}
    bad = {name: c for name, c in bad.items() if c["outcome"] == Outcome.DIFFERS} or bad
    judged = {name: c for name, c in known.items() if c["outcome"] in CHECKED_OUTCOMES}
    if bad:
        name = max(bad, key=lambda n: bad[n]["ratio"] or math.inf)
    elif judged:
        name = max(judged, key=lambda n: (judged[n]["ratio"] or 0.0, judged[n]["share"]))
    else:
        name = max(known, key=lambda n: known[n]["share"])
    c = known[name]
    if c["outcome"] in (Outcome.UNDECIDED, *EMPTY_OUTCOMES):
        note = c["outcome"]
    elif name in judged:
        note = f"allowed {number(c['allowed_share'], 2)}"
    elif c["later"] is not None and c["share"] > START_RATIO * c["later"]:
        note = "at the start"
    else:
        note = "not checked"
    return ErrorCell(
        solver,
        number(c["share"], 2),
        note,
        name in bad,
        curve_address(kind, solver, name, c["at"]),
        f"{name}: show the curve",
        None if name not in judged else 100.0 if c["ratio"] is None else bar_width(c["ratio"]),
    )


def curve_address(run: str, solver: str, channel: str, x: float) -> str:
    """Return the address of a sample of a curve on the page of its case; x is in SI.

    >>> curve_address("sweep", "mujoco:default", "pin.x", 0.5)
    '#sweep/mujoco:default/pin.x@0.5'
    """
    at = f"@{x:.6g}" if math.isfinite(x) else ""
    return f"#{run}/{quote(solver, safe=':')}/{quote(channel)}{at}"


def link(folder: Path, c: Comparison) -> str:
    """Return the link to a comparison in a report: its curve at the largest error.

    >>> link(Path("reports"), Comparison("fourbar", "mujoco", "sweep", "pin.x", "m", at=6.17847))
    'reports/fourbar.html#sweep/mujoco/pin.x@6.17847'
    """
    page = (folder / f"{slug(c.case)}.html").as_posix()
    return page + (curve_address(c.run, c.solver, c.channel, c.at) if c.run in RUNS else "")
