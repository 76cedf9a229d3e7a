"""Choose the cheapest measured setting with a small enough error, and verify it.

Errors are shares of the reference's range.  A setting is good enough if its measured error times
`ERROR_MARGIN` is no larger than the error that is asked for, and further runs confirm it: as a
program without proofmass, and from a shifted start, where these are possible.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from textwrap import fill

from proofmass.base.strict import Kind
from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.sim.engines import engine_of
from proofmass.studies.record import NAN, StudyRow, format_kind
from proofmass.studies.trade.program import snippet
from proofmass.studies.trade.series import (
    MIN_FALLING_ORDER,
    MIN_ORDER_POINTS,
    MIN_STEP_RATIO,
    Limits,
    convergence_order,
    predict_steps,
)
from proofmass.studies.trade.verdict import Verdict
from proofmass.studies.trade.verify import Check, verify
from proofmass.studies.trade.words import (
    format_cost,
    format_error,
    format_floor,
    format_setting,
    is_error_of_drives,
)
from proofmass.verdict.outcome import Outcome

ERROR_MARGIN = 2.0
"""Least ratio of the wanted error to the measured one, which may be larger from another start."""
SAME_FLOOR_RATIO = 1.5
"""Ratio up to which an error is taken to be at the error floor of another series."""


class NoGoodSetting(Exception):
    """No measured setting is good enough; the message names the best one and its error floor."""


@dataclass(frozen=True)
class Choice:
    """The chosen setting, with the evidence for it.

    Attributes
    ----------
    row : StudyRow
        The measurement of the setting.
    of, wanted : str, float
        Kind of error, and the largest that is good enough, as a share of the reference's range [1].
    check : Check
        The result of running the setting again.
    defaults : str
        A sentence on what the engine's defaults would cost for the same error.
    ratio : float
        Counted time of the defaults over that of the setting [1].  If no measured step of the
        defaults is good enough, it is extrapolated by their order; NaN if that is not possible, and
        infinity if their error floor is above the error.
    refused : tuple of str
        Cheaper settings whose second run was not good enough, a sentence for each.
    motion : str
        A sentence that a free motion is chaotic or sensitive to its start, and until when errors
        are judged; empty for other motions.
    """

    row: StudyRow
    of: str
    wanted: float
    check: Check
    defaults: str
    ratio: float
    refused: tuple[str, ...] = ()
    motion: str = ""


VerifySetting = Callable[[Case, Kind, StudyRow, str, float], Check]


def choose(
    case: Case,
    kind: Kind,
    rows: Iterable[StudyRow],
    wanted: float,
    error_kind: str = "position",
    engine: str = "",
    verdicts: Iterable[Verdict] = (),
    verify: VerifySetting = verify,
    limits: Limits | None = None,
) -> Choice:
    """Choose the cheapest setting that meets an error with margin, and run it again to verify it.

    Parameters
    ----------
    case, kind : Case, {"sweep", "dynamics", "equilibrium"}
        The case, and which of its runs.
    rows : iterable of StudyRow
        Measured settings of that run.
    wanted : float
        Largest error that is good enough, as a share of the reference's range [1]; the measured
        error must be at most half of it.
    error_kind : str
        Kind of error: position, velocity, acceleration, ...
    engine : str, optional
        The only engine to choose from.
    verdicts : iterable of Verdict
        Orders and error floors of the series that the settings belong to.
    verify : callable, optional
        Function that runs a setting again, as a program and from a shifted start; the errors of
        both runs must be no larger than `wanted`.
    limits : Limits, optional
        Counted time that the search for finer steps may take and did take, for the message.

    Raises
    ------
    NoGoodSetting
        No measured setting is good enough.
    """
    rows = [row for row in rows if row.engine in (engine or row.engine)]
    verdicts, refused = list(verdicts), list[str]()
    for row in good_settings(rows, error_kind, wanted):
        check = verify(case, kind, row, error_kind, wanted)
        if check.holds(wanted):
            return Choice(
                row,
                error_kind,
                wanted,
                check,
                *compare_with_defaults(rows, row, error_kind, wanted, verdicts),
                tuple(refused),
            )
        rows.remove(row)
        refused.append(
            f"{format_setting(row)} is {format_error(row, error_kind)}, but {check.words}"
        )
    rods = filter(None, [format_rods(case, kind)])
    raise NoGoodSetting(
        "; ".join([*refused, *explain_no_choice(rows, error_kind, wanted, verdicts, limits), *rods])
    )


def good_settings(rows: Iterable[StudyRow], error_kind: str, wanted: float) -> list[StudyRow]:
    """Settings that meet an error with margin, cheapest first.

    Settings that differ only in the number of iterations are sorted by that number, since fewer
    iterations never cost more.
    """
    good = [
        row
        for row in rows
        if row.outcome == Outcome.RAN
        and row.cost > 0
        and ERROR_MARGIN * row.reached(error_kind) <= wanted
    ]
    least_times = dict[str, float]()
    for row in good:
        least_times[key_without_iterations(row)] = min(
            row.cost, least_times.get(key_without_iterations(row), inf)
        )
    return sorted(
        good,
        key=lambda row: (
            least_times[key_without_iterations(row)],
            float(str(row.parameters.get("iterations", 0))),
            row.cost,
        ),
    )


def key_without_iterations(row: StudyRow) -> str:
    """Key that is equal for rows whose settings differ only in the number of iterations."""
    parameters = {name: value for name, value in row.parameters.items() if name != "iterations"}
    return repr((row.engine, "iterations" in row.parameters, sorted(parameters.items())))


def explain_no_choice(
    rows: Sequence[StudyRow],
    error_kind: str,
    wanted: float,
    verdicts: Iterable[Verdict],
    limits: Limits | None = None,
) -> tuple[str, ...]:
    """Sentences on why no setting is good enough.

    They name the best setting, its error floor with the evidence if there is one, and what a series
    whose error still falls would need.
    """
    usable = [
        row for row in rows if row.outcome == Outcome.RAN and isfinite(row.reached(error_kind))
    ]
    if not usable:
        return explain_no_errors(rows, error_kind)
    verdicts = list(verdicts)
    row = min(usable, key=lambda row: row.reached(error_kind))
    shortfall = (
        f"no measured setting has {format_kind(error_kind)} within {number(wanted, 2)} of its "
        f"range with a margin of {number(ERROR_MARGIN)}; the best, {format_setting(row)}, is "
        f"{format_error(row, error_kind)}"
    )
    needed_refinement = format_needed_refinement(usable, error_kind, wanted, verdicts, limits)
    if not (floor := find_floor(row, error_kind, verdicts)):
        return shortfall, needed_refinement
    return f"{shortfall}: {format_floor(floor)}", floor.evidence, needed_refinement


def format_needed_refinement(
    rows: Iterable[StudyRow],
    error_kind: str,
    wanted: float,
    verdicts: Iterable[Verdict],
    limits: Limits | None = None,
) -> str:
    """Step and cost with which the cheapest series that still falls should be good enough.

    With `limits` the sentence also says why that step was not measured: it takes longer than a run
    may, or than what is left of the budget.
    """
    predictions = predict_steps(rows, verdicts, error_kind, wanted / ERROR_MARGIN)
    if not predictions and limits and limits.short:
        return (
            f"--budget {number(limits.budget)} s ended the search before the errors of a series "
            f"showed an order in {MIN_ORDER_POINTS} steps; {number(limits.spent, 2)} s were spent, "
            "and the next run would take more than the rest"
        )
    if not predictions:
        return "no convergence series still falls at its finest step, so none promises to get there"
    first = predictions[0]
    said = (
        f"{first.row.series} would need a step of about {number(first.step, 2)} s and about "
        f"{number(first.seconds, 2)} s a run, if its order {number(first.falls, 2)} holds"
    )
    if limits is None:
        return f"{said}; proofmass choose measures finer steps"
    if first.seconds > limits.longest_expected:
        return f"{said}; --longest is {number(limits.longest)} s"
    if limits.short:
        return (
            f"{said}; of --budget {number(limits.budget)} s, {number(limits.spent, 2)} s are spent"
        )
    return f"{said}; {limits.settings} settings were measured"


def explain_no_errors(rows: Sequence[StudyRow], error_kind: str) -> tuple[str, ...]:
    """Sentences on settings none of which has such an error: counts of outcomes, and the first one.

    The first setting is that of the model itself, if it was measured.
    """
    if not rows:
        return ("no setting was measured",)
    outcomes = Counter(row.outcome for row in rows if row.outcome != Outcome.RAN)
    if len(rows) > outcomes.total():
        outcomes[f"ran without {format_kind(error_kind)} errors"] = len(rows) - outcomes.total()
    counts = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common())
    first = rows[0]
    why = ": ".join(filter(None, (first.outcome, first.message)))
    return (
        f"no setting ran, of {len(rows)}: {counts}",
        f"the first, {format_setting(first)}: {why}",
    )


def compare_with_defaults(
    rows: Iterable[StudyRow],
    chosen: StudyRow,
    error_kind: str,
    wanted: float,
    verdicts: Iterable[Verdict],
) -> tuple[str, float]:
    """Cost of the engine's defaults refined to the same error: a sentence, and `Choice.ratio`."""
    default_rows = [
        row
        for row in rows
        if row.engine == chosen.engine
        and is_default(row)
        and isfinite(row.reached(error_kind))
        and row.outcome == Outcome.RAN
    ]
    if not default_rows:
        return "the defaults were not measured, or did not run", NAN
    if is_default(chosen):
        return "these are the engine's defaults, refined", 1.0
    if good := good_settings(default_rows, error_kind, wanted):
        ratio = good[0].cost / chosen.cost
        return (
            f"{number(ratio, 2)} times cheaper than the engine's defaults refined to the same "
            f"error, {format_cost(good[0])}"
        ), ratio
    row = min(default_rows, key=lambda row: row.reached(error_kind))
    series_verdicts = [verdict for verdict in verdicts if verdict.series == row.series]
    if (
        floor := find_floor(row, error_kind, series_verdicts)
    ) and floor.floor > wanted / ERROR_MARGIN:
        return f"the engine's defaults never get there: {format_floor(floor)}", inf
    shortfall = (
        f"the engine's defaults are {format_error(row, error_kind)} at best, {format_cost(row)}"
    )
    coarser = min(
        (one for one in default_rows if one.value > MIN_STEP_RATIO * row.value),
        key=lambda one: one.value,
        default=None,
    )
    falls = (
        convergence_order(*((one.value, one.reached(error_kind)) for one in (coarser, row)))
        if coarser and len(default_rows) >= MIN_ORDER_POINTS
        else NAN
    )
    if not falls > MIN_FALLING_ORDER:
        return shortfall, NAN
    step_factor = (ERROR_MARGIN * row.reached(error_kind) / wanted) ** (
        1 / falls
    )  # times as many steps
    ratio = step_factor * row.cost / chosen.cost
    return (
        f"{shortfall}; of order {number(falls, 2)} they would take "
        f"{number(step_factor * row.cost, 2)} s, {number(ratio, 2)} times as long"
    ), ratio


def is_default(row: StudyRow) -> bool:
    """Whether a setting differs from the defaults of its engine in the time step only."""
    return engine_of(row.engine).settings.is_default(row.parameters)


def find_floor(row: StudyRow, error_kind: str, verdicts: Iterable[Verdict]) -> Verdict | None:
    """The error floor at which a row is: that of its own series, or of another of its engine.

    None where most of the error is that of the drives, since floors are stated at the motion that
    the drives really had.
    """
    if is_error_of_drives(row, error_kind):
        return None
    near = [
        v
        for v in verdicts
        if (v.engine, v.kind) == (row.engine, error_kind)
        and v.floor > row.errors[error_kind] / SAME_FLOOR_RATIO
        and (v.series == row.series or v.floor < SAME_FLOOR_RATIO * row.errors[error_kind])
    ]
    return min(
        near,
        key=lambda v: (v.series != row.series, abs(v.floor - row.errors[error_kind])),
        default=None,
    )


def describe_choice(choice: Choice, case: Case) -> list[str]:
    """Describe a choice in sentences, the evidence for it included."""
    row, check = choice.row, choice.check
    return [
        f"{case.name}, {row.run}: {format_kind(choice.of)} within "
        f"{number(choice.wanted, 2)} of its range",
        f"{format_setting(row)}: {format_error(row, choice.of)} in {number(row.seconds, 2)} s, "
        f"{row.steps} steps",
        *filter(None, [format_rods(case, row.run)]),
        check.words,
        *check.describe_other_drives(choice.of, choice.wanted),
        choice.defaults,
        *choice.refused,
        *filter(None, [choice.motion]),
    ]


def format_rods(case: Case, kind: str) -> str:
    """A sentence on the number of segments of each rod in dynamics, which no setting changes."""
    if not case.rod or kind != "dynamics":
        return ""
    numbers = ", ".join(f"{name} {rod.segments}" for name, rod in case.rod.items())
    return f"rods have the segments of the sidecar: {numbers}"


def format_snippet(choice: Choice, case: Case) -> str:
    """Text to paste for the chosen setting, with the evidence as comments in it."""
    lines = snippet(choice.check.used, choice.row.steps, case.model_path)
    comments = [fill(line, 92, subsequent_indent="  ") for line in describe_choice(choice, case)]
    if choice.check.ran:
        comments.append("The start state and the drives are in the program that -o run.py writes.")
    text = "\n".join(comments).replace("--", "-")
    return f"{engine_of(choice.row.engine).programs.write_comment(text)}\n{lines}"
