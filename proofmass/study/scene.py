"""What a scene is for: the runs that it must still do, and how far each channel may move in them.

With sidecars these are their runs in MuJoCo; a channel may move by a tenth of what its error leaves
of its tolerance.  Without, the model is let go from its key, and a channel may move as much as by a
nudge of that pose.
"""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import mujoco
import numpy as np

from proofmass.case import Case
from proofmass.check import FAILURES, load
from proofmass.compare import reference_for
from proofmass.errors import InputError
from proofmass.isolate import isolated
from proofmass.solve import plan
from proofmass.strict import Kind
from proofmass.study.bounded import bounded
from proofmass.study.draft import Draft, read
from proofmass.study.trial import PASSIVE, attempt, by_steps
from sim.mjcf import compile_model
from sim.protocol import Array, BadModel, Curves, Run

ROUNDING = 1e-9  # of a channel's largest value; 1e7 times that of one number
NUDGE = 1e-12  # [rad or m] what a start pose so near changes is no change
LOST = 0.1  # of a channel's largest value: a motion that the nudge changes by more is chaos
FEWEST = 10  # samples before that
SAMPLES = 501
SHARE = 0.1  # of what an error leaves of its tolerance: a change that uses it up would be a loss
LATEST = 600.0  # s
COMPILING = 120.0  # s, as a run has that states no limit
FEW = 500  # steps that are timed, and whose iterations are counted


@dataclass(frozen=True)
class Watch:
    """A run that must come out the same.

    Attributes
    ----------
    name : str
        Case, kind of run, and setting if it has a name.
    run : Run
    allowed : dict of str to ndarray
        How far each channel may move at each sample, in its unit.
    before : Curves
        Of the model as it is.
    """

    name: str
    run: Run
    allowed: dict[str, Array]
    before: Curves

    @property
    def brief(self) -> Run:
        """As few samples of the run as have `FEW` steps, but two at least."""
        stride = max(1, self.before.steps // self.run.x.size)
        return replace(self.run, x=self.run.x[:max(2, FEW // stride)])


@dataclass(frozen=True)
class Scene:
    """A model and what it is for.

    Attributes
    ----------
    draft : Draft
        The model as it is.
    watches : tuple of Watch
    read : set of str, or None
        Sensors that the sidecars read; None: without them, all.
    keys : set of str
        Keys that runs start from.
    """

    draft: Draft
    watches: tuple[Watch, ...]
    read: set[str] | None
    keys: set[str]

    @property
    def longest(self) -> Watch:
        """The run that takes longest, of those that go by time steps if there are any."""
        return max(self.watches, key=lambda w: (by_steps(w.run), w.before.seconds))


def scene_of(file: Path, seconds: float) -> Scene:
    """A model with the sidecars beside it that speak of it; `seconds` to follow it without any.

    Raises
    ------
    InputError
        The model or a sidecar cannot be used, or the model as it is does not run.
    """
    cases = list(sidecars(file)) if file.is_file() else []
    if not cases:
        compile_elsewhere(file)
    runs = [(case, kind, solver) for case in cases for kind in case.run
            for solver in solvers_of(case, kind)]
    draft = read(file, next((case.rods for case in cases), ()), probing=not runs)
    if not runs:
        watch = let_go(file, draft, seconds)
        keys = {watch.run.start, *(case.start for case in cases)} - {""}
        return Scene(draft, (watch,), None, keys)
    watches = [watched(case, plan(case, kind, solver), solver, draft)
               for case, kind, solver in runs]
    sensors = {name.partition(".")[0] for case in cases for name in case.channels}
    return Scene(draft, tuple(watches), sensors, {case.start for case in cases})


def solvers_of(case: Case, kind: Kind) -> list[str]:
    """The settings in which a case runs in MuJoCo, but for the engine's defaults and its flexes."""
    return [s for s in case.run[kind].solvers if s.partition(":")[0] == "mujoco"
            and s != "mujoco:default" and not case.settings.get(s, {}).get("flex")]


def sidecars(file: Path) -> Iterator[Case]:
    """The cases beside a model that are about it."""
    for path in sorted(file.parent.glob("*.toml")):
        try:
            named = tomllib.loads(path.read_text(encoding="utf-8")).get("model", path.stem + ".xml")
        except (tomllib.TOMLDecodeError, UnicodeDecodeError):
            named = path.stem + ".xml"
        if named == file.name:
            yield load(path, strict=True)


def compile_elsewhere(file: Path) -> None:
    """Compile a model that no sidecar speaks of in a worker, before it is compiled here.

    Raises
    ------
    InputError
        It takes too long or too much memory.
    """
    try:
        isolated(compiles, file, timeout=COMPILING)
    except tuple(FAILURES) as error:
        raise InputError(file, "", f"cannot be compiled: {error}") from None


def compiles(file: Path) -> bool:
    """Whether MuJoCo takes a model; who reads it says why it does not."""
    try:
        return compile_model(file) is not None
    except BadModel:
        return False


def watched(case: Case, run: Run, solver: str, draft: Draft) -> Watch:
    """A run of a case; a channel may move by a share of what its error leaves of its tolerance.

    One without a tolerance, or beyond it already, may move by rounding.
    """
    before = done(case.model_path, draft.compiled(run.rods), run)
    truth = bounded(case, cast(Kind, run.kind), reference_for, case, before).channels
    allowed = dict[str, Array]()
    for name, curve in before.channels.items():
        tolerance = case.tolerance_for(run.kind, solver, name)
        most = tolerance.allowed(float(np.ptp(truth[name]))) if tolerance else 0.0
        left = SHARE * (most - float(np.abs(curve - truth[name]).max()))
        allowed[name] = np.full(curve.size, max(left, ROUNDING * scale(before, name)))
    setting = f", {solver.partition(':')[2]}" if ":" in solver else ""
    return Watch(f"{case.name} {run.kind}{setting}", run, allowed, before)


def let_go(file: Path, draft: Draft, seconds: float) -> Watch:
    """The model as it is for some seconds, or until a nudge of the start pose has grown too much.

    A channel may move by what the nudge moves it, and by rounding.
    """
    model = draft.compiled()
    names = [model.key(k).name for k in range(model.nkey)]
    start = "start" if "start" in names else next(iter(names), "")
    steps = max(1, round(seconds / model.opt.timestep))
    stride = max(1, steps // (SAMPLES - 1))
    x = model.opt.timestep * stride * np.arange(max(2, steps // stride + 1))
    run = Run(PASSIVE, x, (), start=start)
    before = done(file, model, run)
    if not before.channels:
        raise InputError(file, "", "nothing in it moves and nothing is measured; give it a <joint>")
    beside = done(file, model, run, NUDGE)
    grown = {name: np.abs(curve - beside.channels[name]) / scale(before, name)
             for name, curve in before.channels.items()}
    lost = np.max(list(grown.values()), axis=0) > LOST
    n = int(np.argmax(lost)) if lost.any() else x.size
    if n < min(FEWEST, x.size):
        name = max(grown, key=lambda name: float(grown[name][n]))
        raise InputError(file, "", f"cannot be followed: {name} is lost in rounding after "
                         f"{x[n]:.3g} s; give a key that starts further from a collision")
    allowed = {name: np.maximum(ROUNDING, np.maximum.accumulate(part[:n])) * scale(before, name)
               for name, part in grown.items()}
    return Watch("let go", replace(run, x=x[:n]), allowed, before)


def scale(curves: Curves, name: str) -> float:
    """Largest value of all the numbers of a channel's sensor; 1 where all of them are rounding."""
    sensor = name.partition("[")[0]
    largest = max(float(np.abs(v).max()) for n, v in curves.channels.items()
                  if n.partition("[")[0] == sensor)
    return largest if largest > ROUNDING else 1.0


def done(file: Path, model: mujoco.MjModel, run: Run, nudge: float = 0.0) -> Curves:
    """A run of the model as it is, or bad input."""
    try:
        return isolated(attempt, model, run, nudge, timeout=LATEST)
    except BadModel as error:
        raise InputError(file, "", str(error)) from None
    except tuple(FAILURES) as error:
        raise InputError(file, "", f"as it is, its run {FAILURES[type(error)]}: {error}; give a "
                         "model that runs") from None


def moved(watch: Watch, curves: Curves, optional: set[str]) -> dict[str, float]:
    """How far each channel moved, over what it may: up to 1 is no change.

    What is gone has moved without bound, unless it is an `optional` one that never moved.
    """
    found = {}
    for name, before in watch.before.channels.items():
        allowed, after = watch.allowed[name], curves.channels.get(name)
        if after is None and name.partition("[")[0] in optional:
            after = np.full(allowed.size, before[0])
        found[name] = np.inf if after is None or after.size != allowed.size else float(
            (np.abs(after - before[:allowed.size]) / allowed).max())
    return found
