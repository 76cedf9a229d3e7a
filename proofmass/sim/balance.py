"""Forces that follow from a motion: moments of drives, and forces between bodies.

An engine in an interpreter of its own returns the motion of its links.  The forces in drives, loops
and stops are those that this motion needs with the masses, springs and loads of the model::

    M a + h = Q + J^T loops + D^T drives + S^T stops

MuJoCo gives the terms.  Where rows of loops are redundant, the forces with the least squares stand
for all that the motion needs.
"""

from collections.abc import Sequence
from copy import copy

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.contents import joint_of
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.smooth import SmoothTerms

ROW_SHARE = 1e-10
"""Singular value, as a share of the largest, below which rows of constraints are redundant: those
of loops that are planar in the coordinates themselves, to rounding."""
STOP_NEARNESS = 1e-3
"""Distance from the end of its range within which a joint may rest on its stop [rad or m]: more
than soft stops give way."""


class ForceBalance:
    """Forces in a model along a motion.

    Parameters
    ----------
    model : MjModel
    key : str
        Name of the key whose controls act, but for those that are given.
    driven : sequence of int
        Numbers of the driven joints.
    pushed : sequence of int
        Numbers of joints that may rest on a stop.

    Raises
    ------
    Unsupported
        A driven joint has dry friction or polynomial damping.
    """

    def __init__(
        self, model: mujoco.MjModel, key: str, driven: Sequence[int], pushed: Sequence[int] = ()
    ) -> None:
        model, self.pushed = copy(model), list(pushed)
        dofs = model.jnt_dofadr[list(driven)]
        if model.dof_frictionloss[dofs].any() or model.dof_dampingpoly[dofs].any():
            raise Unsupported("dry friction and polynomial damping of a driven joint are left out")
        for a in range(model.nactuator):
            if joint_of(model, a) in driven:
                model.actuator_gainprm[a] = model.actuator_biasprm[a] = 0.0
        self.terms, self.drives = SmoothTerms(model, key), np.eye(model.nv)[dofs]

    def forces(self, q: Array, v: Array, a: Array, controls: Array) -> tuple[Array, Array]:
        """Moments of the drives (drives,) and forces in the rows of the loops (rows,) [N m or N].

        Parameters
        ----------
        q, v, a : ndarray (nq,), (nv,), (nv,)
            Coordinates, rates and accelerations [SI].
        controls : ndarray (controls,)
            Of the actuators [SI].
        """
        own = self.terms.terms(q, v, controls)
        rows = np.vstack([own.jacobian, self.drives, self.stops(q)])
        needed = own.mass @ a + own.bias - own.force
        found = np.linalg.lstsq(rows.T, needed, rcond=ROW_SHARE)[0]
        loops = len(own.jacobian)
        return found[loops : loops + len(self.drives)], found[:loops]

    def stops(self, q: Array) -> Array:
        """Rows of the joints that rest on a stop (rows, nv)."""
        model, rows = self.terms.model, np.eye(self.terms.model.nv)
        values = q[model.jnt_qposadr[self.pushed]]
        gaps = np.abs(values[:, None] - model.jnt_range[self.pushed]).min(axis=1, initial=np.inf)
        return rows[model.jnt_dofadr[self.pushed]][gaps < STOP_NEARNESS]

    def sensors(self, a: Array, loops: Array) -> Array:
        """Values of all sensors of forces, after `forces` with these accelerations."""
        model, data = self.terms.model, self.terms.data
        data.qacc[:], data.efc_force[:] = a, 0.0
        data.efc_force[self.terms.order] = loops
        mujoco.mj_rnePostConstraint(model, data)
        mujoco.mj_sensorAcc(model, data)
        return np.array(data.sensordata)
