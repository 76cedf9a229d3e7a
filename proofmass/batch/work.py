"""What the workers of a check do: read and validate a case, run and compare, check a bare model.

The main process names these functions in its calls of workers and never calls them itself.  Each
loads what it needs when it is called, so that the main process loads no engine and no reference.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from proofmass.base.errors import InputError
from proofmass.base.read_once import serve_model
from proofmass.base.strict import Kind
from proofmass.base.worker import Crashed
from proofmass.case.case import Case
from proofmass.sim.engines import NATIVE_ENGINE, engine_of
from proofmass.sim.model_source import ModelSource
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.comparison import Comparison, Comparisons
from proofmass.verdict.outcome import OUTCOME_OF_EXCEPTION, Outcome

if TYPE_CHECKING:
    from proofmass.screen.screen import Screen

OWN_MODEL_SECONDS, OWN_MODEL_SAMPLES = 1.0, 101
"""Length of the motion of a model without a sidecar [s], and the number of times at which two ways
of solving it are compared."""


def load_here(path: Path) -> Case:
    """Read a sidecar, see `load_case`."""
    from proofmass.run.sidecar import load_case

    return load_case(path)


def validate_here(case: Case) -> None:
    """Raise InputError if a case is wrong, see `validate_case`."""
    from proofmass.run.validate import validate_case

    validate_case(case)


def count_samples(case: Case, kind: Kind) -> int:
    """The number of samples of a run."""
    from proofmass.reference.samples import run_samples

    return run_samples(case, kind).size


def compare_and_share(
    case: Case, kind: Kind, solver: str, curves: Curves, detectable: bool = True
) -> Comparisons:
    """Do what `compare` does, with the reference that the solvers of a run share in a worker."""
    from proofmass.reference.run_reference import shared_reference
    from proofmass.verdict.compare import compare

    shared = shared_reference(case, kind, curves)
    found = compare(case, kind, solver, curves, detectable, shared)
    if any(c.noise is not None for c in found):
        from proofmass.evidence.diagnosis.measured import judge_numbers

        return judge_numbers(case, kind, solver, curves, found)
    return found


def run_and_compare(
    case: Case,
    kind: Kind,
    solver: str,
    compare_curves: Callable[[Case, Kind, str, Curves], Comparisons],
) -> tuple[list[Comparison], Curves]:
    """Run and compare one solver; an unexpected exception becomes a crash."""
    from proofmass.run.solve import solve_here

    serve_model(case.model_path)
    try:
        curves = solve_here(case, kind, solver)
        found = compare_curves(case, kind, solver, curves)
        return list(found), found.join_reference(curves)
    except (InputError, MemoryError):
        raise
    except tuple(OUTCOME_OF_EXCEPTION):
        raise
    except Exception as error:
        raise Crashed(f"{type(error).__name__}: {error}") from error


def read_remarks_here(source: ModelSource) -> tuple[str, ...]:
    """What reading a model left out or assumed."""
    return source.read().remarks


def screen_here(source: ModelSource) -> "Screen":
    """Screen a model, see `proofmass.screen.screen.screen_model`."""
    from proofmass.screen.screen import screen_source

    return screen_source(source)


def check_model_here(source: ModelSource) -> Comparison:
    """Check a model without a sidecar by itself, see `proofmass.reference.self_consistency`.

    The comparison has the error of the model's own run; `at` is the time until which the motion is
    known.
    """
    from proofmass.reference.self_consistency import (
        PROCESSOR_SECONDS,
        Rung,
        choose_cheaper,
        why_failed,
    )

    motion = engine_of(NATIVE_ENGINE).own_equations.solve_motion(
        source.read().model,
        OWN_MODEL_SECONDS,
        OWN_MODEL_SAMPLES,
        PROCESSOR_SECONDS,
        choose=choose_cheaper,
    )
    own = motion.runs[0]
    found = Comparison(
        source.file.stem,
        NATIVE_ENGINE,
        "dynamics",
        "",
        "m",
        seconds=own.seconds,
        steps=round(float(motion.times[len(own.points) - 1]) / own.step),
        violation=float(own.gap.max(initial=0.0)),
    )
    if failed := why_failed(motion):
        return replace(found, outcome=Outcome.DIVERGED, message=" ".join([failed, *motion.notes]))
    rung = Rung(motion)
    found = replace(found, message=" ".join([rung.words(), *motion.notes]))
    if rung.at_rest:
        return replace(found, outcome=Outcome.NOTHING_MOVED)
    if not rung.consistent:
        return replace(found, outcome=Outcome.UNCHECKED)
    return replace(
        found,
        error_max=rung.error(own),
        at=rung.until,
        uncertainty=rung.known,
        outcome=Outcome.SELF_CONSISTENT,
    )
