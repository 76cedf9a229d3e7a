"""The page of engines at equal cost, from ``cost.json`` and ``cost.csv``: ranks, lines, machine."""

from collections.abc import Sequence
from math import inf, isnan
from pathlib import Path
from typing import Any, NamedTuple

from proofmass.base.json_values import restore_nan
from proofmass.base.wording import format_count, number
from proofmass.report.page import slug
from proofmass.report.study import PageWriter, prepare_folder, read_results
from proofmass.sim.engines import format_solver
from proofmass.studies.engines.cost import (
    COST_ROWS,
    COST_TABLE,
    RANKED_ERRORS,
    ComparedEngine,
    EngineCosts,
    MachineLoad,
)
from proofmass.studies.engines.cost_figure import (
    DrawnSetting,
    EngineLine,
    LineLook,
    draw_costs,
    engine_looks,
)
from proofmass.studies.engines.cost_words import (
    conclude,
    describe_machine_load,
    describe_noise,
    format_seconds,
    format_span,
    state_word,
)
from proofmass.studies.engines.ranking import (
    CaseStanding,
    ComparedCase,
    EngineStanding,
    log_median,
    points_by_series,
    time_for_error,
    widened_time,
)
from proofmass.studies.record import format_kind, read_table
from proofmass.studies.trade.noise import Interval
from proofmass.studies.trade.verdict import comparable_settings, pareto_front
from proofmass.studies.trade.words import format_setting_briefly

COST_PAGE = "cost.html"
DECADES = range(-1, -16, -1)
"""Decades of the errors of the figure over all cases, from a tenth of the range to roundings."""
NONE_AS_FAST = "none as fast"


class StandingCell(NamedTuple):
    """Cells on an engine in a case for an error: rank, time, ratio, error in equal time.

    `state` is ``good``, ``lost`` or ``none``; `why` says what limits an engine that does not
    reach the error.
    """

    rank: str
    time: str
    ratio: str
    in_equal_time: str
    title: str
    state: str
    why: str


class RankRow(NamedTuple):
    """A row of the ranks over all cases, as text."""

    rank: str
    title: str
    css: str
    ratio: str
    tied: str
    first: str
    reached: str
    in_equal_time: str
    lost: str


def write_cost_page(folder: Path, output: Path, home: str = "") -> Path:
    """Write the page ``cost.html`` from the files that `proofmass.studies.engines.cost` wrote.

    Raises
    ------
    InputError
        Something else wrote these files.
    """
    costs = read_costs(folder)
    prepare_folder(output, (folder / COST_TABLE, folder / COST_ROWS))
    looks, tones = engine_looks([one.engine for one in costs.engines])
    return PageWriter(output, home).write(
        COST_PAGE,
        "cost.html",
        tones=tones,
        costs=costs,
        looks=[looks[one.engine] for one in costs.engines],
        conclusions=list(conclude(costs)),
        machine=describe_machine_load(costs.machine),
        noise=describe_noise(costs),
        errors=[number(error) for error in RANKED_ERRORS],
        kinds=[(format_kind(kind), kind_parts(costs, kind, looks)) for kind in costs.kinds],
        engines=[
            (looks[one.engine], one, format_seconds(one.start), format_seconds(one.compile))
            for one in costs.engines
        ],
        tables=(COST_TABLE, COST_ROWS),
    )


class CasePart(NamedTuple):
    """The figure and the table of a case for a kind of error."""

    case: str
    stem: str
    about: str
    figure: str
    absent: str
    rows: list[tuple[LineLook, list[StandingCell], str]]


class KindParts(NamedTuple):
    """What a page shows for a kind of error."""

    figure: str
    ranks: list[tuple[str, list[RankRow]]]
    cases: list[CasePart]


def read_costs(folder: Path) -> EngineCosts:
    """The comparison that `write_costs` wrote into a folder.

    Raises
    ------
    InputError
        Something else wrote the files, or one of them is missing.
    """

    def read(data: dict[str, Any]) -> EngineCosts:
        rows = read_table(folder / COST_ROWS)
        return EngineCosts(
            [
                ComparedCase(
                    one["case"],
                    float(one["duration"]),
                    tuple(row for row in rows if row.case == one["case"]),
                    str(one["motion"]),
                )
                for one in data["cases"]
            ],
            [ComparedEngine(**restore_nan(one)) for one in data["engines"]],
            MachineLoad(**restore_nan(data["machine"])),
            float(data["budget"]),
        )

    return read_results(folder / COST_TABLE, "engines --cost", read)


def kind_parts(costs: EngineCosts, kind: str, looks: dict[str, LineLook]) -> KindParts:
    """Figures and tables for a kind of error."""
    lines = [median_line(costs, engine, kind, look) for engine, look in looks.items()]
    label = f"Error of {kind} over time, median of {format_count(len(costs.cases), 'case')}"
    ranks = [
        (number(error), [rank_row(one, looks) for one in costs.ranked(kind, error)])
        for error in RANKED_ERRORS
    ]
    cases = [case_part(costs, case, kind, looks) for case in costs.cases]
    return KindParts(draw_costs(lines, RANKED_ERRORS, label), ranks, cases)


def median_line(costs: EngineCosts, engine: str, kind: str, look: LineLook) -> EngineLine:
    """The line of an engine over all cases: the median of its times for each decade of the error.

    An error that it does not reach in a case counts as infinite time.
    """
    front = []
    every = [points_by_series(case, engine, kind, costs.spread) for case in costs.cases]
    for decade in DECADES:
        found = [time_for_error(lines, 10.0**decade) for lines in every]
        times = [one[0] if one else Interval(inf, inf, inf) for one in found]
        low, time, high = (log_median(one) for one in zip(*times, strict=True))
        if time < inf:
            reached = sum(one is not None for one in found)
            words = (
                f"{look.title}, 1e{decade}: {format_seconds(time)}, reached in {reached} of "
                f"{format_count(len(found), 'case')}"
            )
            front.append(DrawnSetting(low, time, min(high, 10 * time), 10.0**decade, words))
    return EngineLine(look, front, [])


def case_part(
    costs: EngineCosts, case: ComparedCase, kind: str, looks: dict[str, LineLook]
) -> CasePart:
    """The figure and the table of a case."""
    lines = [case_line(costs, case, engine, kind, look) for engine, look in looks.items()]
    by_error = [
        {one.engine: one for one in costs.standings(kind, error) if one.case == case.case}
        for error in RANKED_ERRORS
    ]
    rows, absent = [], list[str]()
    for engine in sorted_engines(by_error):
        own = [standings[engine] for standings in by_error]
        best = (
            f"{number(own[0].best, 2)} in {format_seconds(own[0].best_time)}"
            if own[0].best == own[0].best
            else "—"
        )
        rows.append((looks[engine], [standing_cell(one) for one in own], best))
        if not own[0].best < inf:
            absent.append(f"{looks[engine].title} ({state_word(own[0].state)})")
    about = f"{number(case.duration)} s of motion"
    return CasePart(
        case.case,
        f"{slug(case.case)}-{kind}",
        f"{about}; {case.motion}" if case.motion else about,
        draw_costs(lines, RANKED_ERRORS, f"Error of {kind} over time in {case.case}"),
        ", ".join(absent),
        rows,
    )


def sorted_engines(by_error: Sequence[dict[str, CaseStanding]]) -> list[str]:
    """The engines of a case: those first that are fast for the first errors, lost ones last."""
    return sorted(
        by_error[0],
        key=lambda one: (
            *(standings[one].time.stated for standings in by_error),
            by_error[0][one].best if by_error[0][one].best < inf else inf,
        ),
    )


def case_line(
    costs: EngineCosts, case: ComparedCase, engine: str, kind: str, look: LineLook
) -> EngineLine:
    """The line of an engine in a case: the front of its settings."""
    settings = comparable_settings(case.of(engine), kind)
    best = pareto_front(settings, kind)
    drawn = {
        id(row): DrawnSetting(
            *widened_time(row, costs.spread, case.duration),
            row.errors[kind],
            f"{look.title}, {format_setting_briefly(row)}: {number(row.errors[kind], 2)} in "
            f"{format_seconds(row.seconds / case.duration)}",
        )
        for row in settings
    }
    return EngineLine(
        look,
        [drawn[id(row)] for row in best],
        [drawn[id(row)] for row in settings if all(row is not one for one in best)],
    )


def standing_cell(one: CaseStanding) -> StandingCell:
    """The cells of an engine in a case for an error."""
    in_equal_time = (
        format_span(one.in_equal_time)
        if one.in_equal_time.stated == one.in_equal_time.stated
        else (NONE_AS_FAST if one.equal_time < inf and one.best < inf else "—")
    )
    if not one.is_reached:
        word = state_word(one.state)
        state = "none" if word in ("refused", "unavailable", "no such channel") else "lost"
        return StandingCell("–", word, "", in_equal_time, one.words, state, one.words)
    tie = f" ≈ {', '.join(map(format_solver, one.tied))}" if one.tied else ""
    return StandingCell(
        f"{one.rank}",
        format_seconds(one.time.stated),
        number(one.ratio.stated, 2),
        in_equal_time,
        f"{one.words}; {format_seconds(one.time.low)} to {format_seconds(one.time.high)}{tie}",
        "good",
        tie.strip(),
    )


def rank_row(one: EngineStanding, looks: dict[str, LineLook]) -> RankRow:
    """The row of an engine in the ranks over all cases."""
    lost = [f"{state_word(state)} in {', '.join(cases)}" for state, cases in one.lost.items()]
    return RankRow(
        f"{one.rank}" if one.rank else "–",
        looks[one.engine].title,
        looks[one.engine].css,
        format_span(one.ratio) if one.rank else "—",
        ", ".join(map(format_solver, one.tied)),
        f"{one.first}",
        f"{one.reached} of {one.cases}",
        "—"
        if isnan(one.in_equal_time)
        else (number(one.in_equal_time, 2) if one.in_equal_time < inf else NONE_AS_FAST),
        "; ".join(lost),
    )
