"""Run a case in a simulator: ``solve(case, kind, solver) -> Curves``."""

import importlib
import pkgutil
from pathlib import Path

import sim
from proofmass.case import Case
from proofmass.drive import check_driven
from proofmass.errors import InputError
from proofmass.isolate import Crashed, isolated
from proofmass.reference import grid, laws
from proofmass.strict import Kind
from sim.protocol import BadModel, Curves, Diverged, Drive, Run, Unsupported


def engines() -> list[str]:
    """The simulators there are: one for each ``sim/with_NAME.py``."""
    names = [m.name for m in pkgutil.iter_modules(sim.__path__)]
    return [n.removeprefix("with_") for n in names if n.startswith("with_")]


def plan(case: Case, kind: Kind, solver: str) -> Run:
    """What a simulator is asked to do for one run of a case.

    A solver is an engine, or ``engine:variant``.  The variant ``default`` stands for the engine's
    own default settings; any other is a table ``[settings."engine:variant"]`` of the sidecar.
    """
    engine, _, variant = solver.partition(":")
    if engine not in engines():
        raise InputError(case.file, f"run.{kind}.solvers", f"no simulator {engine!r}; there are: "
                         f"{', '.join(engines())}")
    settings = dict(case.settings.get(solver, {}))
    if variant == "default":
        settings["defaults"] = True
    elif variant and not settings:
        raise InputError(case.file, f"run.{kind}.solvers", f'{solver!r} needs a table '
                         f'[settings."{solver}"]')
    drives = tuple(Drive(d.joint, law) for d, law in zip(case.drive, laws(case, kind), strict=True))
    channels = tuple(case.channels_of(kind))
    return Run(kind, grid(case, kind), channels, drives, case.start, settings, case.rods)


def solve(case: Case, kind: Kind, solver: str) -> Curves:
    """Run a case in a simulator, in a process of its own.

    Parameters
    ----------
    case : Case
        The sidecar.
    kind : {"sweep", "duration", "rest"}
        Which of its runs.
    solver : str
        Engine, or ``engine:variant``.

    Returns
    -------
    Curves

    Raises
    ------
    InputError
        The sidecar or the model is at fault.
    Unsupported, Diverged, Crashed, TimedOut
        The run is at fault.

    Examples
    --------
    >>> from proofmass import load_case, solve
    >>> curves = solve(load_case("models/fourbar.toml"), "sweep", "mujoco")
    >>> round(float(curves.channels["rocker"][0]), 6)
    2.245928
    """
    run = plan(case, kind, solver)
    engine = solver.partition(":")[0]
    try:
        curves = isolated(simulate, engine, case.model_path, run, timeout=case.run[kind].timeout)
    except BadModel as error:
        raise InputError(case.model_path, "", str(error)) from None
    check_driven(run, curves)
    return curves


def simulate(engine: str, model: Path, run: Run) -> Curves:
    """Call ``sim.with_ENGINE.simulate``; what it did not mean to raise is a crash of that run."""
    try:
        return importlib.import_module(f"sim.with_{engine}").simulate(model, run)
    except (BadModel, Unsupported, Diverged):
        raise
    except Exception as error:
        raise Crashed(f"{type(error).__name__}: {error}") from error
