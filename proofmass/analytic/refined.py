"""Reference of the motion of any MJCF: the model's own equations, integrated with small errors.

    sidecar:  reference = "refined"

The quantities are the sensors of the model, by their channel names.  The equations are those of
MuJoCo, with soft contacts, soft loops, friction and joint limits as the file has them.  The
reference therefore checks the *time stepping* of an engine and nothing else: a wrong length, or a
contact that is too soft, is the same in the engine and in the reference.

Joints may be driven.  A prescribed motion is the limit of ever heavier flywheels on the driven
joints, with the torques that give the flywheels the accelerations of the motion profiles.  The
equations here have the flywheels of the engine's runs, whose inertia is 1e9 times the inertia that
a drive moves at the start.  Their relative error is therefore 1e-9, as much as the tolerance of the
integrator.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.mjcf import read_compiled
from proofmass.analytic.protocol import Ask, InputMotion, Reference
from proofmass.analytic.support import (
    ACTS,
    IN_TIME,
    IRRELEVANT,
    REFUSED,
    STEPS_AND_SENSORS,
    RunKind,
    answers,
    covers,
    refuse,
)
from proofmass.base.arrays import Array

__all__ = ["SUPPORT", "properties", "solve"]

WITHOUT_DRIVES = answers(IN_TIME, ACTS, refused=(RunKind.DRIVEN_MOTION,))
FALSE_MOMENT = answers(IN_TIME, ACTS, withheld=(RunKind.DRIVEN_MOTION,))
SUPPORT = covers(
    IN_TIME,
    {
        "spring that yields of a joint": REFUSED,
        "polynomial damping of a driven joint": FALSE_MOMENT,
        "frictionloss of a driven joint": FALSE_MOMENT,
        "weld equality": WITHOUT_DRIVES,
        "tendon equality, of sums of joints": WITHOUT_DRIVES,
        "tendon equality, of ways in space": WITHOUT_DRIVES,
        "equality of a flex": REFUSED,
        "armature of a tendon": FALSE_MOMENT,
        "spring that yields of a tendon": REFUSED,
        "delay of an actuator": REFUSED,
        "armature of an actuator": FALSE_MOMENT,
        "armature of an actuator on a driven joint": FALSE_MOMENT,
        "force of an actuator on a driven joint": IRRELEVANT,
        **STEPS_AND_SENSORS,
    },
)
"""The features of MuJoCo's own equations, but for states that only steps in time move."""


def solve(
    times: ArrayLike,
    rate: ArrayLike = 0.0,
    acceleration: ArrayLike = 0.0,
    *,
    model: Any,
    closely: Callable[[Array], dict[str, Array]],
    joints: tuple[str, ...] = (),
    in_time: tuple[Array, Sequence[Any]] | None = None,
) -> dict[str, Array]:
    """Motion of a model from its start key, free or with drives, and with controls that may change.

    Parameters
    ----------
    times : array_like (n,)
        Rising times from 0 [s]; for a driven model the values of its drives [SI], which are not
        used.
    rate, acceleration : array_like
        Rates and accelerations of the drives [SI], which are not used: the drives follow their
        motion profiles.
    model : mujoco.MjModel
        The compiled MJCF, whose numbers are read.
    closely : callable
        Function of times (n,) [s] that returns the curves of all sensors; see
        `proofmass.reference.model_run.solve_closely`.
    joints : tuple of str
        The driven joints.
    in_time : tuple of ndarray (n,) and sequence of callable, optional
        For a driven model the times [s] and the motion profiles of its drives.

    Returns
    -------
    dict of str to ndarray (n,) [SI]
        By channel name, as in a sidecar: ``box.x``, ``turn.w``, ...

    Raises
    ------
    NotCovered
        The motion is not known until the last time: two ways of solving it differ before that.

    Notes
    -----
    Domain: motions that are self-consistent until their end, see
    `proofmass.reference.self_consistency`. Accuracy: the tolerance of DOP853 is 1e-9; errors within
    it grow in time as a disturbance of the initial state grows.

    Examples
    --------
    >>> solve([0.0, 1.0], model=None, closely=lambda t: {"fall": -9.81 * t**2 / 2})["fall"]
    array([-0.   , -4.905])
    """
    if model is not None:
        kind = RunKind.DRIVEN_MOTION if joints else RunKind.FREE_MOTION
        refuse(read_compiled(model), SUPPORT, kind, joints)
    return closely(np.atleast_1d(np.asarray(in_time[0] if in_time else times, float)))


def properties(*, evidence: str, **_: float) -> dict[str, str]:
    """The kind of equations, and the evidence that the motion is known, in words for a report."""
    return {
        "equations of motion": "MuJoCo's own, with soft contacts, loops and limits as they are",
        "self-consistent": evidence,
    }


class Refined(Reference):
    """The motion of any MJCF: the model's own equations, integrated with small errors."""

    method = "model's own equations, solved without time steps"
    reads_model = True
    follows_controls = True
    in_space = True

    def solve(self, motion: InputMotion, ask: Ask) -> dict[str, Array]:
        """Curves of all sensors of the model, see the function `solve` of this module."""
        run = ask.of_model
        return solve(
            motion.x,
            model=run.model,
            closely=run.solve_closely,
            joints=run.joints,
            in_time=run.in_time,
        )

    def properties(self, motion: InputMotion, ask: Ask) -> dict[str, str]:
        """The kind of equations, and the evidence that the motion is known, in words."""
        return properties(evidence=ask.of_model.evidence())
