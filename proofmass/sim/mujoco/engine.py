"""The MuJoCo engine: all kinds of runs of an MJCF with ``connect`` and ``joint`` equalities."""

from dataclasses import replace
from pathlib import Path

import mujoco

from proofmass.analytic.mjcf import read_compiled
from proofmass.analytic.names import equality_name, radian_hint
from proofmass.analytic.start import MAX_KEY_VIOLATION
from proofmass.analytic.support import left_out
from proofmass.sim.mjcf import (
    collected_warnings,
    compile_model,
    warning_notes,
)
from proofmass.sim.mujoco import flex as mujoco_flex
from proofmass.sim.mujoco.dynamics import dynamics, run_passive
from proofmass.sim.mujoco.model import loop_violations, prepare_model, translate_fatal_errors
from proofmass.sim.mujoco.quasi_static import equilibrium, sweep
from proofmass.sim.mujoco.settings import (
    ACCURACY,
    MujocoSettings,
)
from proofmass.sim.mujoco.support import SUPPORT
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.part import LoadedPart
from proofmass.sim.protocol.run import Run


def simulate(model: Path, run: Run) -> Curves:
    """Run a model in MuJoCo.

    Parameters
    ----------
    model : Path
        The MJCF file.
    run : Run
        See `proofmass.sim.protocol.run.Run`.  Its settings are those of
        `proofmass.sim.mujoco.settings.MujocoSettings`; for ``settled`` in a sweep see
        `proofmass.sim.mujoco.settling`, for ``flex`` in equilibrium `proofmass.sim.mujoco.flex`.

    Returns
    -------
    Curves
        The channels over ``run.x``, the actual drive state, the largest constraint
        violation and the cost.

    Raises
    ------
    BadModel
        The model does not compile, lacks a named element or is not assembled in its start pose, or
        MuJoCo itself refuses it, such as for options that exclude each other.
    Unsupported
        The model contains an element that this kind of run does not cover; the message names it.
    Diverged
        The run failed.
    """
    with translate_fatal_errors():
        if run.settings.get("flex"):
            return mujoco_flex.equilibrium(model, run)
        with collected_warnings() as warned:
            compiled = compile_model(model, run.rods)
            notes = left_out(read_compiled(compiled), SUPPORT)
            curves = run_compiled(*prepare_model(compiled, run), run)
        notes += warning_notes(compiled, warned)
        return replace(curves, notes=(*curves.notes, *notes))


def run_compiled(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Do a run with a compiled model that has the run's settings and is in its start pose."""
    if run.kind == "passive":
        return run_passive(model, data, run)
    check_assembled(model, data, run.start)
    return {"sweep": sweep, "equilibrium": equilibrium, "dynamics": dynamics}[run.kind](
        model, data, run
    )


def check_assembled(model: mujoco.MjModel, data: mujoco.MjData, key: str) -> None:
    """Refuse a start pose whose loops are open by more than the rounding of the key explains."""
    mujoco.mj_kinematics(model, data)
    violations = loop_violations(model, data)
    if violations.size and not violations.max() <= MAX_KEY_VIOLATION * model.stat.extent:
        loops = [i for i in range(model.neq) if model.eq_type[i] == mujoco.mjtEq.mjEQ_CONNECT]
        name = equality_name(model, loops[int(violations.argmax())])
        raise BadModel(
            f"start pose of key {key!r} is not assembled: loop {name!r} is open by "
            f"{violations.max():.3g} m{radian_hint(model, key)}"
        )


class Mujoco(Engine):
    """MuJoCo as an engine of proofmass."""

    title = "MuJoCo"
    packages = ("mujoco",)
    settings = MujocoSettings
    native = True
    accuracy = ACCURACY
    support = SUPPORT
    simulate = staticmethod(simulate)
    tuning = LoadedPart("proofmass.sim.mujoco.tried_settings:MujocoTuning")
    theory = LoadedPart("proofmass.sim.mujoco.theory:MujocoTheory")
    programs = LoadedPart("proofmass.sim.mujoco.program:MujocoPrograms")
    own_equations = LoadedPart("proofmass.sim.mujoco.own_motion:MujocoOwnEquations")

    def at_version(self, number: str) -> Engine:
        """MuJoCo in another version, which compiles the model itself; see `Engine.at_version`."""
        from proofmass.sim.mujoco.hosted import MUJOCO  # what only other versions need

        return MUJOCO.at_version(number)


ENGINE = Mujoco()
