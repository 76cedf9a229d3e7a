"""MuJoCo: all runs of any MJCF whose loops are ``connect`` or ``joint`` equalities."""

from collections.abc import Mapping
from pathlib import Path

import mujoco

from proofmass.sim.mjcf import refusal
from proofmass.sim.mujoco import flex as mujoco_flex
from proofmass.sim.mujoco.accuracy import ACCURACY as ACCURACY
from proofmass.sim.mujoco.dynamics import duration, passive
from proofmass.sim.mujoco.model import load, loop_gap
from proofmass.sim.mujoco.program import IMPOSED as IMPOSED
from proofmass.sim.mujoco.program import write_program as write_program
from proofmass.sim.mujoco.quasi_static import rest, sweep
from proofmass.sim.mujoco.settings import MujocoSettings
from proofmass.sim.protocol import BadModel, Curves, Run

NOT_ASSEMBLED = 0.05  # of the model's extent: beyond this, closing a loop would be guessing


def check_settings(settings: Mapping[str, object]) -> None:
    """Raise `proofmass.sim.protocol.BadSetting` if MuJoCo cannot be set so."""
    MujocoSettings.read(settings)


def simulate(model: Path, run: Run) -> Curves:
    """Run a model in MuJoCo.

    Parameters
    ----------
    model : Path
        The MJCF file.
    run : Run
        What to do; see `proofmass.sim.protocol.Run`.  Settings:
        `proofmass.sim.mujoco.settings.MujocoSettings`; ``settled`` in a sweep, see
        `proofmass.sim.mujoco.settling`; ``flex`` in a rest, see `proofmass.sim.mujoco.flex`.

    Returns
    -------
    Curves
        The channels over ``run.x``, the actual drive state, the largest loop gap and the cost.

    Raises
    ------
    BadModel
        The model does not compile, lacks a named element, its start pose is not assembled, or
        MuJoCo itself refuses to go on, such as with options that exclude each other.
    Unsupported
        The model holds something that this kind of run does not cover; it is named.
    Diverged
        The run was lost.
    """
    try:
        if run.settings.get("flex"):
            return mujoco_flex.rest(model, run)
        return follow(*load(model, run), run)
    except mujoco.FatalError as error:
        raise refusal(error) from None


def follow(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Do a run with a compiled model that is in its start pose, with its settings."""
    if run.kind == "passive":
        return passive(model, data, run)
    check_assembled(model, data, run.start)
    return {"sweep": sweep, "rest": rest, "duration": duration}[run.kind](model, data, run)


def check_assembled(model: mujoco.MjModel, data: mujoco.MjData, key: str) -> None:
    """Refuse a start pose whose loops are open by more than rounding of the key can explain."""
    mujoco.mj_kinematics(model, data)
    gaps = loop_gap(model, data)
    if gaps.size and not gaps.max() <= NOT_ASSEMBLED * model.stat.extent:
        loops = [i for i in range(model.neq) if model.eq_type[i] == mujoco.mjtEq.mjEQ_CONNECT]
        name = model.equality(loops[int(gaps.argmax())]).name
        raise BadModel(f"start pose of key {key!r} is not assembled: loop {name!r} is open by "
                       f"{gaps.max():.3g} m")
