"""The largest stable time step of a free motion, measured, beside what a first screen predicts.

A run may be a tenth of its range off with steps that are stable, and a mode that grows slowly may
not show in the run of a case.  So here a step fails only if it is unstable, as
`proofmass.screen.short_run.breaks` finds: MuJoCo reports it, two runs from starts that differ by
1e-7 part a hundred times faster than with steps of an eighth, or the motion does not come to rest
though it does with these.
The prediction is that of the linearised motion, see `proofmass.screen.stable_step`; it names the
mode that breaks, and what to write into the model.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from math import inf

import mujoco

from proofmass.reference.case_model import compiled_model
from proofmass.run.fingerprint import bytes_of_case_model
from proofmass.screen.short_run import breaks, steps_of_run, with_step
from proofmass.screen.stable_step import LONGEST_RATIO, LONGEST_STEP
from proofmass.screen.steps import (
    INTEGRATOR_NAMES,
    cures,
    find_own_stable_step,
)
from proofmass.sim.mjcf import collected_warnings
from proofmass.studies.record import ParameterValue
from proofmass.studies.store import digest, digest_of_sources, package_versions
from proofmass.studies.stress.boundary import BoundaryKind, Failure, PredictedLimit, TrialResult
from proofmass.studies.stress.limit_search import LimitSearch, StressedCase, require

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
    """Increase the time step until it is unstable, with every integrator."""
    case, own = stressed.case, stressed.step
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
    for scheme in stressed.engine.theory.schemes:
        reach = max(own, min(LONGEST_STEP, LONGEST_RATIO * own))
        search = stressed.search(
            "stable time step",
            "s",
            own,
            reach,
            partial(try_stability, stressed, scheme.settings),
            scheme.name,
        )
        yield replace(
            search,
            least=FINEST_SHARE * own,
            predict=partial(predict, stressed, scheme.settings, reach),
        )


def stepped_model(
    stressed: StressedCase, settings: dict[str, ParameterValue], step: float
) -> tuple[mujoco.MjModel, int]:
    """A copy of the model with a time step [s] and an integrator, and the number of its key."""
    model = with_step(compiled_model(stressed.case), step)
    model.opt.integrator = INTEGRATORS[str(settings["integrator"]).lower()]
    return model, mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, stressed.case.start)


def try_stability(
    stressed: StressedCase, settings: dict[str, ParameterValue], step: float
) -> TrialResult:
    """Whether bare MuJoCo is stable with a time step; the result is stored."""
    model, key = stepped_model(stressed, settings, step)
    name = repr((stressed.case.start, settings, step, package_versions(stressed.setting.engine)))
    content = bytes_of_case_model(stressed.case) + f"{name}{digest_of_sources()}".encode()

    count = min(max(steps_of_run(step), LEAST_STEPS), MOST_STEPS)

    def is_unstable() -> bool:
        with collected_warnings():
            return breaks(model, key, step, count)

    if not stressed.study.store.value(f"{digest(content)}.stable.json", is_unstable):
        return TrialResult(step=step)
    failed = Failure("two runs part, or MuJoCo reports it", BoundaryKind.UNSTABLE, silent=False)
    return TrialResult(failed, step)


def predict(
    stressed: StressedCase, settings: dict[str, ParameterValue], reach: float
) -> PredictedLimit:
    """What a first screen says of an integrator; limits beyond `reach` [s] count as none."""
    model, key = stepped_model(stressed, settings, stressed.step)
    with collected_warnings():
        found = find_own_stable_step(model, key)
        about = f", about, with {', '.join(found.about)}" if found.about else ""
        if not found.limit < reach or found.breaking is None:
            return PredictedLimit(inf, f"first screen{about}")
        mode = found.breaking
        remedy = " or ".join(cures(model, key, found)) if found.ratio > 1.0 else ""
    law = f"first screen{about}: {mode.joint} breaks by {mode.cause}, {mode.rates}"
    return PredictedLimit(found.limit, law, remedy)
