"""Cases whose runs are made by engines that a command asks for, in place of their own solvers."""

from collections.abc import Sequence

from proofmass.case.case import Case
from proofmass.sim.engines import VERSION_MARK, engine_of


def with_engines(case: Case, engines: Sequence[str]) -> Case:
    """The case with its runs made by other engines, without a refinement study.

    An engine in another version, such as ``mujoco==3.3.7``, has the settings and, in time, the
    tolerances of the engine without a version, if both have the same settings.  In a sweep it comes
    to rest by its own steps, to which tolerances of poses by Newton's method do not apply.

    Parameters
    ----------
    case : Case
    engines : sequence of str
        Names of engines, or of solvers such as ``mujoco:default``.
    """
    runs = {
        kind: run.model_copy(update={"solvers": tuple(engines)}) for kind, run in case.run.items()
    }
    settings, tolerances = dict(case.settings), list(case.tolerance)
    for engine in engines:
        own = engine_without_version(engine)
        if own == engine or engine_of(own).settings is not engine_of(engine).settings:
            continue
        if own in case.settings:
            settings.setdefault(engine, case.settings[own])
        in_time = {"solver": (engine,), "run": "dynamics"}
        tolerances = [
            found
            for one in tolerances
            for found in (
                *([one.model_copy(update=in_time)] if one.is_for("dynamics", own) else []),
                one,
            )
        ]
    return case.model_copy(
        update={
            "run": runs,
            "settings": settings,
            "tolerance": tuple(tolerances),
            "refine": None,
            "asked": tuple(engines),
        }
    )


def engine_without_version(solver: str) -> str:
    """The name of a solver without the version of its engine.

    >>> engine_without_version("mujoco==3.3.7"), engine_without_version("mujoco==3.3.7:default")
    ('mujoco', 'mujoco:default')
    """
    engine, colon, variant = solver.partition(":")
    return engine.partition(VERSION_MARK)[0] + colon + variant
