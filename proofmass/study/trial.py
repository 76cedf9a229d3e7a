"""Running a compiled model: once for its channels, in rounds for its pace.

These functions are called in worker processes, which `paced` starts itself.
"""

import copy
import time
from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.isolate import Crashed, isolated
from proofmass.study.core import own_core, pinned
from sim.mujoco_model import begin
from sim.protocol import BadModel, Curves, Diverged, Run, Unsupported
from sim.with_mujoco import follow

PASSIVE = "passive"
STEPPED = ("duration", PASSIVE)  # runs that go by time steps
SPAN = 0.5  # s, of rounds at least


@dataclass(frozen=True)
class Cost:
    """Wall time of a step [s], the least of some rounds, and memory of model and data [bytes]."""

    seconds: float
    size: int


def by_steps(run: Run) -> bool:
    """Whether a run goes by time steps."""
    return run.kind in STEPPED or bool(run.settings.get("settled"))


def attempt(model: mujoco.MjModel, run: Run, nudge: float = 0.0) -> Curves:
    """One run of a copy of a model, every joint moved by a `nudge` at first [rad or m].

    What nobody meant to raise is a crash of that run.
    """
    try:
        return driven(model, run, nudge)[0]
    except (BadModel, Unsupported, Diverged):
        raise
    except Exception as error:
        raise Crashed(f"{type(error).__name__}: {error}") from error


def driven(model: mujoco.MjModel, run: Run, nudge: float = 0.0) -> tuple[Curves, mujoco.MjData]:
    """A run, and the engine's state at its end."""
    model, data = begin(copy.copy(model), run)
    mujoco.mj_integratePos(model, data.qpos, np.full(model.nv, nudge), 1.0)
    return follow(model, data, run), data


def paced(models: tuple[mujoco.MjModel, ...], run: Run, rounds: int, timeout: float
          ) -> list[Cost]:
    """`race`, in a process of its own on a processor of its own."""
    with own_core() as core:
        return isolated(race, models, run, rounds, SPAN, core, timeout=timeout)


def race(models: tuple[mujoco.MjModel, ...], run: Run, rounds: int, span: float,
         core: int | None = None) -> list[Cost]:
    """What a step of each model costs; they run in turn, after a round that warms up.

    Short runs get more rounds, a `span` [s] of them.
    """
    best = [float("inf")] * len(models)
    sizes = [0] * len(models)
    turn, began = 0, time.perf_counter()
    with pinned(core):
        while turn <= rounds or time.perf_counter() - began < span:
            for k, model in enumerate(models):
                curves, data = driven(model, run)
                sizes[k] = mujoco.mj_sizeModel(model) + data.nbuffer + data.maxuse_arena
                if turn:
                    best[k] = min(best[k], curves.seconds / curves.steps)
            turn += 1
    return [Cost(seconds, int(size)) for seconds, size in zip(best, sizes, strict=True)]


def most_iterations(model: mujoco.MjModel, run: Run, tolerance: float) -> int:
    """Iterations that the solver takes at most in a step of a run, with a tolerance."""
    model.opt.tolerance, most = tolerance, 0

    def look(_: mujoco.MjModel, data: mujoco.MjData) -> None:
        nonlocal most
        most = max(most, int(data.solver_niter.max()))  # of the step before

    mujoco.set_mjcb_control(look)
    try:
        driven(model, run)
    finally:
        mujoco.set_mjcb_control(None)
    return most
