"""A result with everything that an index can show, made without running an engine."""

from functools import cache
from pathlib import Path

import numpy as np

from proofmass.base.errors import InputError
from proofmass.batch.check import Result
from proofmass.case.case import Case
from proofmass.report.index_page import STATIC, IndexFiles, render_index, write_index_files
from proofmass.report.page import environment, write_static
from proofmass.report.record import History, Last, Record, extend_history, make_record, record_start
from proofmass.report.style import solver_looks
from proofmass.report.thumbnail import Thumbnail
from proofmass.run.sidecar import load_case
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import Outcome
from tests.shipped import MODELS, shipped

CASE_NAMES = ("pendulum", "fourbar", "slider_crank", "rod_cantilever", "hacksaw_recorded")
MADE = record_start(["proofmass", "report", "models"])


def comparison_of(
    case: str,
    run: str,
    solver: str,
    channel: str,
    share: float,
    allowed: float | None = 1e-6,
    outcome: str = Outcome.AGREES,
    unit: str = "m",
    message: str = "",
) -> Comparison:
    """A comparison whose error and tolerance are these shares of a range of 2."""
    return Comparison(
        case,
        solver,
        run,
        channel,
        unit,
        error_max=2 * share,
        error_rms=2.0,
        nrmse=1.0,
        allowed=float("nan") if allowed is None else 2 * allowed,
        outcome=outcome,
        message=message,
        seconds=0.5,
    )


def failed_comparison(case: str, run: str, solver: str, channel: str, outcome: str) -> Comparison:
    """A comparison with an outcome, and without an error."""
    return Comparison(case, solver, run, channel, "m", outcome=outcome, message="why not")


COMPARISONS = [
    comparison_of("pendulum", "dynamics", "mujoco", "angle", 9e-7, unit="rad"),
    comparison_of("pendulum", "dynamics", "mujoco", "rate", 1e-8, unit="rad/s"),
    comparison_of("pendulum", "dynamics", "mujoco:default", "angle", 1e-3, None, Outcome.UNCHECKED),
    comparison_of(
        "pendulum", "dynamics", "mujoco:default", "rate", 1e-2, None, Outcome.UNCHECKED, "rad/s"
    ),
    comparison_of("pendulum", "dynamics", "adams", "angle", 1e-9, unit="rad"),
    failed_comparison("pendulum", "dynamics", "adams", "rate", Outcome.UNSUPPORTED),
    comparison_of("fourbar", "sweep", "mujoco", "pin.x", 1e-14),
    comparison_of(
        "fourbar", "sweep", "mujoco", "pin.y", 3e-2, 1e-3, Outcome.DIFFERS, message="30 x"
    ),
    comparison_of("fourbar", "sweep", "mujoco", "rocker", 9e-1, 1e0, unit="rad"),
    comparison_of("fourbar", "dynamics", "pymunk", "pin.x", 1e-8),
    comparison_of("slider_crank", "sweep", "mujoco", "slider", 1e-7),
    failed_comparison("slider_crank", "dynamics", "pymunk", "slider", Outcome.DIVERGED),
    comparison_of("rod_cantilever", "equilibrium", "mujoco", "x", 5e-7),
    comparison_of("rod_cantilever", "refine", "mujoco", "x", 1.0, 1e-1, Outcome.AGREES),
    comparison_of("hacksaw_recorded", "sweep", "mujoco", "r1", 1e-12),
    Comparison("loose", "mujoco", "dynamics", "", "", message="no sidecar; it loads and steps"),
]


@cache
def load_cases() -> list[Case]:
    """The cases of `CASE_NAMES`; tests share them and must not change them."""
    return [load_case(shipped(f"{name}.toml")) for name in CASE_NAMES]


def result_for_index() -> Result:
    """The result of five cases, a model without a sidecar, and an input with an error."""
    return Result(
        cases=load_cases(),
        comparisons=list(COMPARISONS),
        errors=[InputError(Path("/home/me/bad.toml"), "drive.joint", "no joint <q>")],
        paths=(MODELS,),
    )


def last_record(result: Result) -> Record:
    """The record of an earlier report.

    In it one error was smaller, one was larger, and there was a case that is not in `result`.
    """
    rows = [
        comparison_of("pendulum", "dynamics", "mujoco", "angle", 1e-9, unit="rad")
        if (c.case, c.solver, c.channel) == ("pendulum", "mujoco", "angle")
        else comparison_of("hacksaw_recorded", "sweep", "mujoco", "r1", 1e-9)
        if c.case == "hacksaw_recorded"
        else c
        for c in result.comparisons
    ]
    rows.append(comparison_of("gone_by_now", "sweep", "mujoco", "x", 1e-9))
    return make_record(Result(result.cases, rows, paths=result.paths), MADE)


def small_thumbnail() -> Thumbnail:
    """The drawing of a bar that turns about a pivot on the ground and has a slide at its end."""
    angles = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    end = np.stack([124 + 60 * np.cos(angles), 84 - 60 * np.sin(angles)], axis=1).round()
    pivot = np.broadcast_to([124.0, 84.0], end.shape)
    points = np.stack([pivot, end, pivot, end], axis=1).astype(np.uint8)
    return Thumbnail([2], points, [("hinge", False, True), ("slide", True, False)], [], [], 3)


def index_text(result: Result, *how, **more) -> str:
    """The HTML of the index of a result, see `index_files`."""
    return index_files(result, *how, **more).page


def index_files(
    result: Result, before: Record | None = None, history: History | None = None, **more
) -> IndexFiles:
    """The index of a result; `before` is the record of the last report."""
    now = make_record(result, MADE)
    return render_index(
        environment(),
        result,
        solver_looks(c.solver for c in result.comparisons),
        {case.name: small_thumbnail() for case in result.cases},
        now,
        Last(before),
        extend_history(history or History(), now),
        **more,
    )


def write_index(folder: Path, result: Result, before: Record | None = None) -> Path:
    """Write the index with its styles and script, and an empty page for each link to a case.

    Return the file of the index.
    """
    folder.mkdir(exist_ok=True)
    write_static(folder, STATIC)
    for case in result.cases:
        (folder / f"{case.name}.html").write_text(f"<!doctype html><title>{case.name}</title>")
    return write_index_files(folder, index_files(result, before))
