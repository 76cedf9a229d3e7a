"""Engines at equal cost: the tables and the picture of docs/other_engines.md.

    python -m docs.make.leaderboard [--quick] [--store FOLDER]

Runs ``proofmass engines CASES --engine … --cost`` with four small cases and the engines below;
FOLDER keeps the finished runs.  Engines that cannot be had here are left out of the tables.  With
--quick the pendulum runs in MuJoCo alone, with few settings, and nothing is written.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks import ROOT, command
from docs.make.engines import PAGE, run
from docs.make.marks import write_between
from docs.make.pictures import CHROMIUM, chromium, few_colours, open_page, picture
from proofmass.base.wording import number
from proofmass.sim.engines import format_solver
from proofmass.studies.engines.cost import RANKED_ERRORS, EngineCosts
from proofmass.studies.engines.cost_page import COST_PAGE, read_costs
from proofmass.studies.engines.cost_words import (
    conclude,
    describe_machine_load,
    describe_noise,
    format_seconds,
    format_span,
    state_word,
)
from proofmass.studies.engines.ranking import CaseStanding, EngineStanding

CASES = (
    *("linkages/pendulum", "linkages/fourbar_released", "linkages/slider_crank"),
    "spatial/euler_top",
)
"""A swing, a closed loop let go, a driven loop, and a motion in space: each engine of the plane
refuses the last one."""
ENGINES = (
    *("mujoco", "pymunk", "pinocchio", "simbody", "exudyn", "drake", "bullet", "dart", "box2d"),
    "rapier",
)
"""All that do not compile for minutes, see `docs.make.engines.SLOW`."""
COST_PICTURE = ROOT / "docs" / "engines_cost.png"
COST_BEGIN = "<!-- python -m docs.make.leaderboard writes from here to the next mark -->"
COST_END = "<!-- to here: leaderboard -->"
KIND = "position"
"""The kind of error of the tables; the page of the command has all."""
PICTURE_PLACE = "#tables svg[role=img]"
"""The figure over all cases, the first of the page."""


def main() -> None:
    """Measure and write, or measure a little and write nothing."""
    parser = command(__doc__)
    parser.add_argument("--store", help="folder of finished runs", type=Path)
    words = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        store = words.store or Path(temporary)
        if words.quick:
            few = ("--engine", "mujoco", "--cost", "--budget", "0.01")
            run("engines", "models/linkages/pendulum.toml", *few, "-o", store)
            print("\n".join(cost_lines(read_costs(store))))
            return
        cases = [f"models/{case}.toml" for case in CASES]
        flags = [word for name in ENGINES for word in ("--engine", name)]
        run("engines", *cases, *flags, "--cost", "-o", store)
        write_leaderboard(store)


def write_leaderboard(store: Path) -> None:
    """Write the tables of the page, and the picture of the figure over all cases."""
    text = PAGE.read_text(encoding="utf-8")
    lines = "\n".join(cost_lines(read_costs(store)))
    PAGE.write_text(write_between(text, COST_BEGIN, COST_END, lines), encoding="utf-8")
    if CHROMIUM:
        with chromium() as browser:
            tab = open_page(browser, store / COST_PAGE)
            tab.locator(PICTURE_PLACE).first.scroll_into_view_if_needed()
            place = tab.locator(PICTURE_PLACE).first.bounding_box()
            corners = [place["x"], place["y"], place["x"] + place["width"]]
            cut = picture(tab).crop((*map(int, corners), int(place["y"] + place["height"])))
            few_colours(cut).save(COST_PICTURE, optimize=True)


def cost_lines(costs: EngineCosts) -> Iterator[str]:
    """Conclusions, how they were measured, the ranks, and the times of each case."""
    there = [
        one.engine
        for one in costs.engines
        if any(r.outcome != "unavailable" for r in costs.rows if r.engine == one.engine)
    ]
    yield " ".join(conclude(costs))
    yield ""
    yield f"{describe_machine_load(costs.machine)} {describe_noise(costs)}"
    for error in RANKED_ERRORS:
        yield ""
        yield (
            f"| rank for {number(error)} | engine | × time of the first | first or tied in | "
            "reached in | error in equal time | not reached |"
        )
        yield "|---|---|---|---|---|---|---|"
        for one in costs.ranked(KIND, error):
            if one.engine in there:
                yield f"| {' | '.join(rank_cells(one))} |"
    yield ""
    yield f"| case | for | {' | '.join(map(format_solver, there))} |"
    yield f"|---|---|{'---|' * len(there)}"
    for case in costs.cases:
        for error in RANKED_ERRORS:
            found = {
                one.engine: one for one in costs.standings(KIND, error) if one.case == case.case
            }
            cells = (case_cell(found[engine]) for engine in there)
            yield f"| {case.case} | {number(error)} | {' | '.join(cells)} |"
    yield ""
    yield "| engine | start | compilation | settings tried | velocities read |"
    yield "|---|---|---|---|---|"
    for engine in costs.engines:
        if engine.engine in there:
            start = "runs here" if engine.start != engine.start else format_seconds(engine.start)
            cells = (
                *(engine.title, start, format_seconds(engine.compile)),
                *(f"{engine.settings} in {engine.series} series", engine.reading or "as given"),
            )
            yield f"| {' | '.join(cells)} |"


def rank_cells(one: EngineStanding) -> list[str]:
    """The cells of an engine in the ranks over all cases."""
    lost = "; ".join(
        f"{state_word(state)} in {', '.join(cases)}" for state, cases in one.lost.items()
    )
    tied = f" ≈ {', '.join(map(format_solver, one.tied))}" if one.tied else ""
    has = 0 < one.in_equal_time < float("inf")
    return [
        f"{one.rank}{tied}" if one.rank else "–",
        format_solver(one.engine),
        format_span(one.ratio) if one.rank else "—",
        str(one.first),
        f"{one.reached} of {one.cases}",
        number(one.in_equal_time, 2) if has else "none as fast",
        lost,
    ]


def case_cell(one: CaseStanding) -> str:
    """The time of an engine in a case, or its word with its smallest error."""
    if one.is_reached:
        return format_seconds(one.time.stated)
    best = f", {number(one.best, 2)}" if one.best == one.best else ""
    return f"{state_word(one.state)}{best}"


if __name__ == "__main__":
    main()
