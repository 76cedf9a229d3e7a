"""The model's own equations, solved closely: the reference of the motion of any MJCF.

    sidecar:  reference = "refined"

The quantities are the model's own sensors, by their channel names.  The equations are those of
MuJoCo, with soft contacts, soft loops, friction and limits as the file has them: the reference
holds an engine's *time stepping* to account, and nothing else.  A wrong length is wrong in both,
and a contact that is too soft is too soft in both.

Joints may be driven.  A prescribed motion is the limit of ever heavier flywheels on the driven
joints, with the torques that give these the accelerations of the laws; the equations here have the
flywheels of the engine's runs, 1e9 times what a drive feels at the start, and are off by a share of
1e-9, as much as the integrator is allowed.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array

__all__ = ["properties", "solve"]


def solve(
    times: ArrayLike,
    rate: ArrayLike = 0.0,
    acceleration: ArrayLike = 0.0,
    *,
    model: Any,
    closely: Callable[[Array], dict[str, Array]],
    in_time: tuple[Array, Sequence[Any]] | None = None,
) -> dict[str, Array]:
    """Motion of a model from its start key, by itself or with drives and controls that change.

    Parameters
    ----------
    times : array_like (n,)
        Rising, from 0 [s]; of a driven model, what the drives did [SI], which is not used.
    rate, acceleration : array_like
        Of drives, which are where their laws have them [SI].
    model : mujoco.MjModel
        The compiled MJCF, whose numbers are read.
    closely : callable
        Gives all sensors at some times (n,) [s]; see `proofmass.reference.solve_closely`.
    in_time : tuple of ndarray (n,) and sequence of callable, optional
        Of a driven model the times [s], and the laws of its drives.

    Returns
    -------
    dict of str to ndarray (n,) [SI]
        By channel name, as in a sidecar: ``box.x``, ``turn.w``, ...

    Raises
    ------
    NotCovered
        The motion is not known until the last time: two ways of solving it part before.

    Notes
    -----
    Domain: motions that are self-consistent until their end, see `proofmass.self_consistency`.
    Accuracy: the allowance of DOP853 is 1e-9; what it leaves grows as a disturbance of the start
    does.

    Examples
    --------
    >>> solve([0.0, 1.0], model=None, closely=lambda t: {"fall": -9.81 * t**2 / 2})["fall"]
    array([-0.   , -4.905])
    """
    return closely(np.atleast_1d(np.asarray(in_time[0] if in_time else times, float)))


def properties(*, evidence: str, **_: float) -> dict[str, str]:
    """What shows that the motion is known, in words for a report."""
    return {
        "equations of motion": "MuJoCo's own, with soft contacts, loops and limits as they are",
        "self-consistent": evidence,
    }
