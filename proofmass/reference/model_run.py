"""What a reference that reads the model of a case gets: the model, its run, and its own motion."""

import pickle
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from proofmass.analytic.numerics import NotCovered
from proofmass.analytic.protocol import ModelRun
from proofmass.base.arrays import Array
from proofmass.base.read_once import read_once
from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.reference.case_model import compile_once, compiled_model
from proofmass.reference.profiles import control_profiles, control_values, drive_profiles
from proofmass.reference.self_consistency import (
    PROCESSOR_SECONDS,
    Rung,
    choose_cheaper,
    why_failed,
)
from proofmass.sim.contents import channel_names
from proofmass.sim.engines import NATIVE_ENGINE, engine_of
from proofmass.sim.model_files import model_key
from proofmass.sim.protocol.failures import NotSolved, Unsupported
from proofmass.sim.protocol.run import ChangingLoad, Drive, Run

if TYPE_CHECKING:
    from mujoco import MjModel

    from proofmass.sim.smooth import SmoothTerms


def model_run(case: Case, kind: Kind, x: Array) -> ModelRun:
    """The model of a case and what moves it in a run, for references that read the model."""
    in_time = kind == "dynamics"
    times = np.asarray(x, float)
    return ModelRun(
        model=compiled_model(case),
        start=case.start,
        joints=tuple(drive.joint for drive in case.drive),
        controls=control_values(case, kind, x, 0),
        control_rates=control_values(case, kind, x, 1),
        in_time=(times, drive_profiles(case, kind)) if in_time and case.drive else None,
        control_profiles=control_profiles(case, kind) if in_time else {},
        terms=lambda: smooth_terms(compiled_model(case), case.start),
        solve_closely=partial(solve_closely, case, kind),
        evidence=lambda: solve_closely_with_evidence(case, times)[1],
    )


@read_once(None)
def smooth_terms(model: "MjModel", start: str = "start") -> "SmoothTerms":
    """MuJoCo's terms of the equations of motion of a model, for the spatial solver."""
    from proofmass.sim.smooth import SmoothTerms  # it loads that solver, which few cases need

    return SmoothTerms(model, start)


def solve_closely(case: Case, kind: Kind, x: Array) -> dict[str, Array]:
    """Find all sensors of a model at times x [s], solved without a simulator's time steps.

    Raises
    ------
    NotCovered
        The motion cannot be solved this way, or is not known until the last time.
    """
    if case.rod:
        raise NotCovered("rods")
    if kind != "dynamics":
        raise NotCovered(f"a run of {kind}; it is a motion in time")
    if x.size < 2:
        raise NotCovered("a single moment; give a run of some length")
    return solve_closely_with_evidence(case, x)[0]


def solve_closely_with_evidence(case: Case, x: Array) -> tuple[dict[str, Array], str]:
    """All sensors at times x [s], and the evidence that the motion is known."""
    file = case.model_path
    led = zip(case.drive, drive_profiles(case, "dynamics"), strict=True)
    drives = tuple(Drive(drive.joint, profile) for drive, profile in led)
    loads = tuple(ChangingLoad(*one) for one in control_profiles(case, "dynamics").items())
    inputs = pickle.dumps((drives, loads))
    return solve_closely_once(file, case.start, x.tobytes(), inputs)


@read_once(model_key)
def solve_closely_once(
    file: Path, start: str, x: bytes, inputs: bytes
) -> tuple[dict[str, Array], str]:
    """Do what `solve_closely_with_evidence` does, with times, drives and loads as bytes."""
    equations, times = engine_of(NATIVE_ENGINE).own_equations, np.frombuffer(x)
    drives, loads = pickle.loads(inputs)
    end = float(times[-1])
    motion = equations.solve_motion(
        file, end, times.size, PROCESSOR_SECONDS, start, drives, loads, choose_cheaper
    )
    if motion.runs[0].is_failure:
        raise NotCovered(f"the model itself fails: {why_failed(motion)}")
    rung = Rung(motion)
    if not rung.is_sure:
        raise NotCovered(f"its motion is not known until {times[-1]:.3g} s: {rung.words()}")
    names = channel_names(compile_once(file, ()), start).values()
    run = Run("dynamics", times, tuple(chain(*names)), drives, start, loads=loads)
    try:
        return equations.solve_closely(file, run).channels, rung.words()
    except (Unsupported, NotSolved) as error:
        raise NotCovered(str(error)) from None
