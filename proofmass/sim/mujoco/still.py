"""Stepping in MuJoCo until nothing moves, and what the engine says when it is lost."""

from collections.abc import Callable

import mujoco
import numpy as np

from proofmass.sim.protocol import Diverged, NotSolved

W = mujoco.mjtWarning
FATAL = (W.mjWARN_BADQPOS, W.mjWARN_BADQVEL, W.mjWARN_BADQACC, W.mjWARN_INERTIA)


def lost(data: mujoco.MjData) -> str:
    """The warning after which MuJoCo went on from a reset pose or with nonsense; empty if none."""
    return next((f"MuJoCo warning {warning.name[7:].lower()}" for warning in FATAL
                 if data.warning[warning].number), "")


def until_still(model: mujoco.MjModel, data: mujoco.MjData, still: float, *, block: int, most: int,
                hold: Callable[[], None] = lambda: None, where: str = "") -> int:
    """Step until all speeds are below `still` at two looks in turn; the number of steps.

    Parameters
    ----------
    model, data
    still : float
        The fastest joint at rest [rad/s or m/s].
    block, most : int
        Steps between two looks, and after which the rest is given up.
    hold : callable
        Called before each block.
    where : str
        What is held, for messages.

    Raises
    ------
    Diverged
        The engine reset itself.
    NotSolved
        It does not come to rest.
    """
    before, steps = np.inf, 0
    for steps in range(block, most, block):
        hold()
        mujoco.mj_step(model, data, block)
        speed = float(np.abs(data.qvel).max())
        if warning := lost(data):
            raise Diverged(f"{warning}; lost on the way to rest{where}")
        if max(speed, before) < still:
            return steps
        before = speed
    joint = model.joint(model.dof_jntid[np.abs(data.qvel).argmax()]).name
    raise NotSolved(f"not at rest after {steps} steps{where}: joint {joint!r} moves at "
                    f"{before:.2g} (rad/s or m/s)")
