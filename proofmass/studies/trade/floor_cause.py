"""Find the cause of an error floor: change each possible cause separately and compare the errors.

`proofmass.studies.trade.series` finds whether a series ends in a floor.

If a cause has a share s of the error, and the error is of first order in it, halving the cause
divides the error by 1 / (1 - s/2).  The time step is no cause of a floor, since halving it leaves
the error.  Rounding is a cause if a disturbance of the size of rounding moves the result by enough
(`proofmass.studies.trade.disturbed`).
"""

from collections.abc import Iterator, Sequence
from math import log
from pathlib import Path

from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.run.solve import describe_dynamics
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.tuning import STEP_CAUSE, Perturbation
from proofmass.studies.record import NAN, Setting, StudyRow
from proofmass.studies.trade.varied import ConvergenceSeries, with_step
from proofmass.studies.variants import (
    PLANAR_REFERENCE,
    has_independent_motion,
    with_every_other_row,
    with_planar_reference,
)
from proofmass.verdict.outcome import Outcome

SIGNIFICANT_FACTOR = 1.1
"""Factor on the error from which a change counts as the cause: a fifth of a first-order error."""
MIN_SEGMENTS = 2
"""Least number of segments of a rod."""
UNKNOWN_CAUSE = "unknown"
ROUNDING_CAUSE = "rounding"


PerturbedCase = tuple[Case, Perturbation]
"""A case and the settings to run it with, in which one possible cause of its error is changed."""


def halved_settings(
    run: Kind, series: ConvergenceSeries, setting: Setting, model_step: float
) -> list[Setting]:
    """The setting with half and a quarter of its step, or with two and four times the segments.

    Parameters
    ----------
    run, series, setting
        Kind of run, series, and a setting of it.  If the stiffness of loops changes with the step
        along the series (`ConvergenceSeries.scaled`), it does so here as well.
    model_step : float
        Time step of the model [s], used if the setting has none.
    """
    if run != "dynamics":
        n = int(str(setting.parameters["segments"]))
        return [setting.with_parameters(segments=2 * n), setting.with_parameters(segments=4 * n)]
    step = float(str(setting.parameters.get("timestep", model_step)))
    return [
        with_step(setting, step / by)
        if series.scaled
        else setting.with_parameters(timestep=step / by)
        for by in (2, 4)
    ]


def list_perturbations(
    case: Case, run: Kind, setting: Setting, folder: Path, scaled: bool = False
) -> list[PerturbedCase]:
    """List the run with each possible cause of its error changed, one at a time.

    Parameters
    ----------
    case, run, setting
        The run whose error is examined.
    folder : Path
        Folder into which changed models and curves are written.
    scaled : bool
        Whether the stiffness of loops changes with the step along the setting's series.  If so, a
        change of the step alone changes the ratio of time constants to the step.
    """
    if run == "dynamics":
        found = engine_of(setting.engine).tuning.perturbations(
            setting.parameters, describe_dynamics(case), scaled
        )
        changes = [(case, one) for one in found]
        changes += halve_segments(case, setting)
    else:
        changes = [(case, finer)] if (finer := double_segments(case, setting)) else []
    return [
        *changes,
        *perturb_reference(case, setting, folder),
        *perturb_samples(case, run, setting),
    ]


def double_segments(case: Case, setting: Setting) -> Perturbation | None:
    """The change to twice as many segments of all rods; None without rods."""
    if not case.rod:
        return None
    finer = setting.with_parameters(segments=2 * int(str(setting.parameters["segments"])))
    return Perturbation("segments", "twice as many segments", finer.parameters)


def halve_segments(case: Case, setting: Setting) -> Iterator[PerturbedCase]:
    """The change to half as many segments of each rod, for dynamics; nothing without rods.

    The number is halved, not doubled, because the highest frequency of a chain grows with the
    square of it: few settings are stable with twice as many segments at the same step.
    """
    numbers = {
        name: int(str(setting.parameters.get("segments", rod.segments)))
        for name, rod in case.rod.items()
    }
    half = {name: max(MIN_SEGMENTS, n // 2) for name, n in numbers.items()}
    if half == numbers:
        return
    other_parameters = {
        name: value for name, value in setting.parameters.items() if name != "segments"
    }
    words = (
        "half as many segments" if all(n % 2 == 0 for n in numbers.values()) else "fewer segments"
    )
    yield (
        case.with_segments(half),
        Perturbation("segments", words, other_parameters, better=False),
    )


def perturb_reference(case: Case, setting: Setting, folder: Path) -> Iterator[PerturbedCase]:
    """The change to every other row of a recorded curve, or to the planar solver as reference.

    The general planar solver knows only the model, so it is left out if a drive has its motion
    profile from the case's reference (see `has_independent_motion`).
    """
    if case.recorded:
        words = "every other row of the recorded curve"
        yield (
            with_every_other_row(case, folder),
            Perturbation("the reference", words, setting.parameters, better=False),
        )
    elif case.reference != PLANAR_REFERENCE and has_independent_motion(case) and not case.rod:
        yield (
            with_planar_reference(case),
            Perturbation("the reference", "a second reference", setting.parameters, better=None),
        )


def perturb_samples(case: Case, run: Kind, setting: Setting) -> Iterator[PerturbedCase]:
    """The change of samples: to the ends of segments in equilibrium, to every other one in time."""
    table = case.run[run]
    if table.n is None:
        return
    if run == "equilibrium":
        segments = int(str(setting.parameters["segments"]))
        if table.n - 1 != segments:
            words = "samples at the ends of links"
            yield (
                case.with_run(run, n=segments + 1),
                Perturbation("sampling", words, setting.parameters),
            )
    elif run == "dynamics" and table.n % 2:
        yield (
            case.with_run(run, n=table.n // 2 + 1),
            Perturbation("sampling", "every other sample", setting.parameters, better=None),
        )


def find_cause(
    error: float, found: Sequence[tuple[Perturbation, StudyRow]], kind: str, at_floor: bool = False
) -> tuple[str, str]:
    """Find the change that moves an error most, and describe the factors of all changes.

    Parameters
    ----------
    error : float
        The error before any cause was changed, as a share of the reference's range [1].
    found : sequence of (Perturbation, StudyRow)
        All changes, each with the row of its run.
    kind : str
        Kind of error, such as position.
    at_floor : bool
        Whether halving the step is known to leave the error, so that the step is no cause.

    Returns
    -------
    cause, evidence : str
        The cause that moves the error most, or `UNKNOWN_CAUSE`; the factor of each change, in
        words.
    """
    improvements: dict[str, float] = {}
    words = []
    for one, row in found:
        new_error = row.errors.get(kind, NAN)
        if row.outcome != Outcome.RAN or not new_error > 0:
            words.append(f"{one.change}: {row.outcome}")
            continue
        if not (at_floor and one.cause == STEP_CAUSE):
            improvements[one.cause] = max(
                improvement(one, error / new_error), improvements.get(one.cause, 0.0)
            )
        words.append(f"{one.change} {format_factor(error / new_error)}")
    cause = max(improvements, key=lambda name: improvements[name], default=UNKNOWN_CAUSE)
    return cause if improvements.get(
        cause, 1.0
    ) >= SIGNIFICANT_FACTOR else UNKNOWN_CAUSE, "; ".join(words)


def improvement(perturbation: Perturbation, ratio: float) -> float:
    """Factor by which a change moves an error as expected; `ratio` is the error before over after.

    It is the reciprocal of the ratio if the cause could only be made worse, and the larger of both
    if the error may go either way.  A cause that is removed entirely is rated as if it were halved.
    """
    if perturbation.better is None:
        return max(ratio, 1 / ratio)
    if perturbation.whole:  # the cause had a share 1 - 1/ratio; half of it would give this
        return 2 / (1 + 1 / ratio)
    return ratio if perturbation.better else 1 / ratio


def format_factor(ratio: float) -> str:
    """Describe the change of an error; `ratio` is the error before over the error after.

    >>> format_factor(4.0), format_factor(0.5), format_factor(1.0)
    ('divides the error by 4.00', 'multiplies the error by 2.00', 'leaves the error')
    """
    if abs(log(ratio)) < 0.005:
        return "leaves the error"
    return (
        f"divides the error by {ratio:.2f}"
        if ratio > 1
        else (f"multiplies the error by {1 / ratio:.2f}")
    )
