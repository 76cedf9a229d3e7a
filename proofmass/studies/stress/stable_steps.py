"""The largest stable time step of a free motion, measured, beside what a first screen predicts.

A run may be a tenth of its range off with steps that are stable, and a mode that grows slowly may
not show in the run of a case.  So here a step fails only if it is unstable, as
`proofmass.screen.short_run.breaks` finds: MuJoCo reports it, two runs from starts that differ by
1e-7 part a hundred times faster than with steps of an eighth, or the motion does not come to rest
though it does with these.
The prediction is that of the linearised motion, see `proofmass.screen.stable_step`; it names the
mode that breaks, and what to write into the model.  Neither needs a reference, so that a model
without a sidecar has these limits as well.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from math import inf
from pathlib import Path

import mujoco

from proofmass.base.errors import InputError
from proofmass.base.read_once import read_once
from proofmass.base.wording import number
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut, call_isolated
from proofmass.reference.case_model import compiled_model
from proofmass.screen import short_run
from proofmass.screen.short_run import breaks, start_key, steps_of_run, with_step
from proofmass.screen.stable_step import LONGEST_RATIO, LONGEST_STEP
from proofmass.screen.steps import INTEGRATOR_NAMES, SAFE_SHARE, cures, find_own_stable_step
from proofmass.sim.engines import NATIVE_ENGINE, engine_of
from proofmass.sim.mjcf import collected_warnings
from proofmass.sim.model_files import model_key
from proofmass.sim.model_source import ModelSource
from proofmass.studies.store import Store, digest, digest_of_sources, package_versions
from proofmass.studies.stress.boundary import BoundaryKind, Failure, PredictedLimit, TrialResult
from proofmass.studies.stress.limit_search import (
    SEARCH_RUN_TIMEOUT,
    LimitSearch,
    NotApplicable,
    StressedCase,
    require,
)

STABLE_STEP_PARAMETER = "stable time step"
KNOWN_SETTINGS = {"timestep", "integrator"}
"""Settings of a case with which its model is screened."""
MAX_COORDINATES = 100
"""Coordinates of a model up to which its steps are predicted and measured: more take minutes."""
LEAST_STEPS, MOST_STEPS = 1000, 4000
"""Steps of a run: in the first number a mode that is 1 % beyond its limit has grown a hundred
times; the second bounds the cost of a second in small steps."""
FINEST_SHARE = 1e-5
"""Least step that is tried, over that of the model [1]."""
INTEGRATORS = {name.lower(): integrator for integrator, name in INTEGRATOR_NAMES.items()}


def search_stable_step(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Increase the time step of a case until it is unstable, with every integrator."""
    require_screened(stressed)
    case, own = stressed.case, stressed.step
    source, store = ModelSource(case.model_path), stressed.study.store
    yield from search_integrators(case.name, source, case.start, own, store)


def with_stable_step(stressed: StressedCase) -> StressedCase:
    """The case, with a stable time step if its first screen says that its own one is unstable.

    A run that fails is no start for the limit of another parameter.
    """
    try:
        require_screened(stressed)
    except NotApplicable:
        return stressed
    case, own = stressed.case, stressed.step
    scheme = stressed.engine.theory.scheme_of(stressed.setting.parameters, compiled_model(case))
    if scheme is None:
        return stressed
    model = SteppedModel(
        ModelSource(case.model_path), case.start, scheme.name, stressed.study.store
    )
    limit = model.predict(own, reach_of(own)).theory
    if not limit < own:  # not with NaN
        return stressed
    step = float(f"{SAFE_SHARE * limit:.2g}")
    return replace(
        stressed,
        setting=stressed.setting.with_parameters(timestep=step),
        note=f"timestep {number(1e3 * step)} ms",
    )


def require_screened(stressed: StressedCase) -> None:
    """Raise `NotApplicable` unless a first screen knows the steps of a case."""
    case = stressed.case
    require(stressed.kind == "dynamics", "stable time step: the run has no time steps")
    require(stressed.engine.native, "stable time step: it is predicted of the MJCF alone")
    require(not (case.drive or case.rod), "stable time step: the motion is driven, or has rods")
    require(
        not stressed.setting.parameters.keys() - KNOWN_SETTINGS,
        "stable time step: it is predicted with the softness of the model alone",
    )
    require(
        0 < compiled_model(case).nv <= MAX_COORDINATES,
        f"stable time step: the model has more than {MAX_COORDINATES} coordinates",
    )


def search_bare_model(source: ModelSource, store: Store) -> list[LimitSearch]:
    """Searches for the largest stable steps of a model without a sidecar.

    Raises
    ------
    InputError
        It has no joints, or too many, or it cannot be read in time.
    BadModel
        It does not compile.
    """
    try:
        own, coordinates = call_isolated(read_sizes, source, timeout=SEARCH_RUN_TIMEOUT)
    except (TimedOut, OutOfMemory, Crashed) as error:
        raise InputError(source.file, "", f"it cannot be read: {error}") from None
    if not 0 < coordinates <= MAX_COORDINATES:
        raise InputError(
            source.file,
            "",
            f"it has {coordinates} coordinates; stable time steps are searched of models with 1 to "
            f"{MAX_COORDINATES}",
        )
    return list(search_integrators(source.file.stem, source, "start", own, store))


def reach_of(own: float) -> float:
    """The longest step that is tried of a model with its own step [s]."""
    return max(own, min(LONGEST_STEP, LONGEST_RATIO * own))


def search_integrators(
    what: str, source: ModelSource, start: str, own: float, store: Store
) -> Iterator[LimitSearch]:
    """A search with each integrator, from the model's own step [s] or below it."""
    reach = reach_of(own)
    for scheme in engine_of(NATIVE_ENGINE).theory.schemes:
        stepped = SteppedModel(source, start, scheme.name, store)
        yield LimitSearch(
            what,
            NATIVE_ENGINE,
            scheme.name,
            STABLE_STEP_PARAMETER,
            "s",
            own,
            reach,
            stepped.try_step,
            least=FINEST_SHARE * own,
            predict=partial(stepped.predict, own, reach),
        )


@dataclass(frozen=True)
class SteppedModel:
    """A model whose steps are tried, in workers.

    Attributes
    ----------
    source : ModelSource
    start : str
        Name of its key; a model without that key starts from its first, or its initial pose.
    integrator : str
    store : Store
        Keeps what was measured.
    """

    source: ModelSource
    start: str
    integrator: str
    store: Store

    def read(self, step: float) -> tuple[mujoco.MjModel, int]:
        """The model with a time step [s] and the integrator, and the number of its key."""
        model = with_step(read_model(self.source), step)
        model.opt.integrator = INTEGRATORS[self.integrator.lower()]
        return model, start_key(model, self.start)

    def try_step(self, step: float) -> TrialResult:
        """Whether bare MuJoCo is stable with a time step [s]; the result is stored."""
        known = self.start, self.integrator, step, package_versions(NATIVE_ENGINE)
        name = repr((*known, model_key(self.source.file), digest_of_sources(), code_of_trials()))
        try:
            unstable = self.store.value(
                f"{digest(name.encode())}.stable.json",
                lambda: call_isolated(self.is_unstable_here, step, timeout=SEARCH_RUN_TIMEOUT),
            )
        except (TimedOut, OutOfMemory, Crashed) as error:
            return TrialResult(Failure(str(error), BoundaryKind.OURS))
        how = Failure("two runs part or come to no rest, or MuJoCo fails", BoundaryKind.UNSTABLE)
        return TrialResult(how if unstable else None, step)

    def is_unstable_here(self, step: float) -> bool:
        """Run the model with a time step [s], in this process."""
        model, key = self.read(step)
        with collected_warnings():
            return breaks(model, key, step, min(max(steps_of_run(step), LEAST_STEPS), MOST_STEPS))

    def predict(self, own: float, reach: float) -> PredictedLimit:
        """What a first screen says, in a worker; nothing if that does not end."""
        try:
            found: PredictedLimit = call_isolated(
                self.predict_here, own, reach, timeout=SEARCH_RUN_TIMEOUT
            )
        except (TimedOut, OutOfMemory, Crashed):
            return PredictedLimit()
        return found

    def predict_here(self, own: float, reach: float) -> PredictedLimit:
        """What a first screen says of the model with its own step [s].

        Limits beyond `reach` [s] count as none.
        """
        model, key = self.read(own)
        with collected_warnings():
            found = find_own_stable_step(model, key)
            about = f", about, with {', '.join(found.about)}" if found.about else ""
            if not found.limit < reach or found.breaking is None:
                return PredictedLimit(inf, f"first screen{about}")
            mode = found.breaking
            remedy = " or ".join(cures(model, key, found)) if found.ratio > 1.0 else ""
        law = f"first screen{about}: {mode.joint} breaks by {mode.cause}, {mode.rates}"
        return PredictedLimit(found.limit, law, remedy)


@cache
def code_of_trials() -> str:
    """A digest of the code that decides whether a step is stable: results depend on it."""
    return digest(b"".join(Path(str(file)).read_bytes() for file in (short_run.__file__, __file__)))


@read_once(lambda source: model_key(source.file))
def read_model(source: ModelSource) -> mujoco.MjModel:
    """The compiled model of a file."""
    return source.read().model


def read_sizes(source: ModelSource) -> tuple[float, int]:
    """The time step of a model [s], and the number of its coordinates."""
    model = read_model(source)
    return float(model.opt.timestep), int(model.nv)
