"""Forces that follow from a motion: moments of drives, and forces between bodies.

An engine in an interpreter of its own returns the motion of its links.  The forces in drives, loops
and stops are those that this motion needs with the masses, springs and loads of the model::

    M a + h = Q - F sign(v) + J^T loops + D^T drives + S^T stops + E^T friction

MuJoCo gives the terms.  Where rows of loops are redundant, the forces with the least squares stand
for all that the motion needs.  The dry friction of a joint whose motion the drives prescribe has
its largest size F against it; that of another joint is what the motion needs, if that is one number
for each joint.
"""

from collections.abc import Sequence
from copy import copy

import mujoco
import numpy as np

from proofmass.analytic.numerics import motion_senses
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
        A driven joint has polynomial damping.
    """

    def __init__(
        self, model: mujoco.MjModel, key: str, driven: Sequence[int], pushed: Sequence[int] = ()
    ) -> None:
        model, self.pushed = copy(model), list(pushed)
        dofs = model.jnt_dofadr[list(driven)]
        if model.dof_dampingpoly[dofs].any():
            raise Unsupported("polynomial damping of a driven joint is left out")
        self.bounds, self.driven = model.dof_frictionloss.copy(), dofs
        for a in range(model.nactuator):
            if joint_of(model, a) in driven:
                model.actuator_gainprm[a] = model.actuator_biasprm[a] = 0.0
        self.terms, self.drives = SmoothTerms(model, key), np.eye(model.nv)[dofs]

    def find_friction(self, q: Array, rates: Array) -> Array:
        """Dry friction (n, nv) of joints whose motion drives prescribe, positive against it.

        It is NaN for joints whose friction has to follow from the motion [N m or N].

        Parameters
        ----------
        q : ndarray (n, nq)
            Coordinates at the samples [SI].
        rates : ndarray (drives, n)
            Of the drives [rad/s or m/s].
        """
        found = np.where(self.bounds != 0.0, np.nan, np.zeros((len(q), self.bounds.size)))
        if not self.bounds.any() or not rates.size:
            return found
        speeds = []
        for pose, rate in zip(q, rates.T, strict=True):
            rows = np.vstack([self.terms.equalities(pose)[1], self.drives])
            wanted = np.append(np.zeros(len(rows) - rate.size), rate)
            speeds.append(np.linalg.lstsq(rows, wanted, rcond=ROW_SHARE)[0])
        determined = np.linalg.matrix_rank(rows, rtol=ROW_SHARE) == self.bounds.size
        given = np.isin(np.arange(self.bounds.size), self.driven) | determined
        senses = motion_senses(np.array(speeds).T, float(np.abs(rates).max())).T
        return np.asarray(np.where(given, self.bounds * senses, found))

    def forces(
        self, q: Array, v: Array, a: Array, controls: Array, friction: Array
    ) -> tuple[Array, Array]:
        """Moments of the drives (drives,) and forces in the rows of the loops (rows,) [N m or N].

        Parameters
        ----------
        q, v, a : ndarray (nq,), (nv,), (nv,)
            Coordinates, rates and accelerations [SI].
        controls : ndarray (controls,)
            Of the actuators [SI].
        friction : ndarray (nv,)
            Of `find_friction` at this sample [N m or N].

        Raises
        ------
        Unsupported
            The dry friction of joints does not follow from the motion.
        """
        own = self.terms.terms(q, v, controls)
        rows = np.vstack([own.jacobian, self.drives, self.stops(q)])
        rows = np.vstack([rows, self.unknown_friction(rows, friction)])
        needed = own.mass @ a + own.bias - own.force + np.nan_to_num(friction)
        found = np.linalg.lstsq(rows.T, needed, rcond=ROW_SHARE)[0]
        loops = len(own.jacobian)
        return found[loops : loops + len(self.drives)], found[:loops]

    def unknown_friction(self, rows: Array, friction: Array) -> Array:
        """Rows (joints, nv) of the joints whose dry friction has to follow from the motion."""
        loose = np.flatnonzero(np.isnan(friction))
        if not loose.size:
            return np.zeros((0, self.bounds.size))
        found, model = np.eye(self.bounds.size)[loose], self.terms.model
        both = np.vstack([rows, found])
        before, behind = (np.linalg.matrix_rank(one, rtol=ROW_SHARE) for one in (rows, both))
        if behind - before < len(found):
            names = [repr(model.joint(int(j)).name) for j in model.dof_jntid[loose]]
            raise Unsupported(
                f"the dry friction of {', '.join(names)} does not follow from the motion"
            )
        return found

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
