"""Joint ranges as unilateral stops: which of them a joint lies on.

At rest a stop pushes only inwards, and only where its joint lies on it.  The linear problem of each
Newton step is a linear complementarity problem, solved by block pivoting: switch every joint whose
state is wrong; after a few rounds only the first of them, which cannot cycle while the stiffness
is positive definite (K. G. Murty, Note on a Bard-type scheme for solving the complementarity
problem, Opsearch 11 (1974) 123-130).
"""

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import Unsupported

COVERED = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
BLOCKS = 10  # rounds in which all wrong joints switch at once
TOUCHES = 1e-12  # [rad, or extents] rounding of a pose; beyond it a joint is past its stop
PULLS = 1e-12  # of the largest force: rounding of a reaction


class Stops:
    """The limited joints of a model, without the `driven` ones.

    Attributes
    ----------
    dofs, adr : ndarray (stops,) of int
        Where they stand in ``qvel`` and in ``qpos``.
    side : ndarray (stops,) of int
        -1 on the low stop, +1 on the high one, 0 between them.
    turns : int
        How often a step may be asked for.
    """

    def __init__(self, model: mujoco.MjModel, driven: Array, reach: Array):
        joints = np.flatnonzero(model.jnt_limited & ~np.isin(model.jnt_dofadr, driven))
        for j in joints:
            if model.jnt_type[j] not in COVERED:
                raise Unsupported(f"range of joint {model.joint(j).name!r} in a sweep with freedoms"
                                  " left; ranges of hinges and slides are covered")
        self.names = [model.joint(j).name for j in joints]
        self.dofs, self.adr = model.jnt_dofadr[joints], model.jnt_qposadr[joints]
        self.low, self.high = model.jnt_range[joints].T
        self.slack = TOUCHES * reach[self.dofs]
        self.rows = np.eye(model.nv)[self.dofs]
        self.side = np.zeros(joints.size, int)
        self.turns = BLOCKS + 2 * joints.size

    def beyond(self, place: Array) -> Array:
        """Which stop each joint is past: -1, 0 or 1."""
        return (place > self.high + self.slack) * 1 - (place < self.low - self.slack)

    def begin(self, pose: Array) -> None:
        """Hold every joint that is on a stop or past it."""
        place = pose[self.adr]
        self.side = (place >= self.high - self.slack) * 1 - (place <= self.low + self.slack)

    def held(self, pose: Array) -> tuple[Array, Array]:
        """How far the held joints are past their stops, and their rows."""
        on = self.side != 0
        bound = np.where(self.side < 0, self.low, self.high)
        return (pose[self.adr] - bound)[on], self.rows[on]

    def switch(self, pose: Array, move: Array, pushes: Array, scale: float, turn: int) -> bool:
        """Release what is pulled and hold what is past its stop; whether anything was wrong.

        Parameters
        ----------
        pose, move : ndarray
            Where the joints are, and the step that is asked for.
        pushes : ndarray
            What all rows would push with after it; those of the held joints are the last.
        scale : float
            The largest force there is.
        turn : int
            How often this step was asked for before.
        """
        on = self.side != 0
        state = self.beyond(pose[self.adr] + move[self.dofs])
        state[on] = self.side[on]
        pull = self.side[on] * pushes[pushes.size - on.sum():]
        state[np.flatnonzero(on)[pull > PULLS * scale]] = 0
        wrong = np.flatnonzero(state != self.side)[: None if turn < BLOCKS else 1]
        self.side[wrong] = state[wrong]
        return bool(wrong.size)

    def spoken(self) -> str:
        """The joints that are held."""
        return ", ".join(self.names[k] for k in np.flatnonzero(self.side))
