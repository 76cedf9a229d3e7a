r"""A model at rest in a pose, without contacts and dry friction: its loops, masses and forces.

All that a first screen computes of a model is computed here from MuJoCo's own terms:

    M(q) a = f(q, v) + J(q)^T l        r(q) = 0        J = dr/dq

with the mass matrix M, the accelerations a, the forces f of springs, dampers, actuators, weight and
inertia, and the residuals r of the equality constraints with their multipliers l.
"""

import copy

import mujoco
import numpy as np

from proofmass.base.arrays import Array, Index
from proofmass.screen.finding import NamedElement
from proofmass.sim.dense import constraint_rows, mass_matrix

RANK_SHARE = 1e-6
"""Least singular value of independent constraints, as a share of the largest.  Shipped and public
models give the same ranks with 1e-3 and with 1e-12."""
CLOSED = 1e-12
"""Largest residual of loops that count as closed [m or rad]."""
MAX_CORRECTIONS = 40
"""Newton steps after which loops count as open; closed ones need up to ten from a tenth of the
size."""
MAX_STEP = 0.3
"""Largest step of Newton's method [rad or m]: beyond it another assembly mode may be reached."""
LEAST_MASS = 1e-12
"""Least mass that scales a step of Newton's method [kg or kg m^2]."""
HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
OFF = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS


class RestPose:
    """A model at rest in a pose, with constant controls; contacts and dry friction are left out.

    Parameters
    ----------
    model : MjModel
    qpos : ndarray (nq,)
        The pose [rad or m].
    ctrl, act : ndarray
        Controls and activations [SI].

    Attributes
    ----------
    model, data : MjModel, MjData
        A copy of the model without contacts and dry friction, and its state.
    qpos : ndarray (nq,)
        The pose [rad or m]; it stays where methods enter other poses.
    """

    def __init__(self, model: mujoco.MjModel, qpos: Array, ctrl: Array, act: Array) -> None:
        self.model = copy.copy(model)
        self.model.opt.disableflags |= int(OFF)
        self.data = mujoco.MjData(self.model)
        self.data.ctrl[:], self.data.act[:] = ctrl, act
        self.qpos = qpos.copy()
        self.enter(self.qpos)

    def elsewhere(self, qpos: Array) -> "RestPose":
        """The same model, with the same controls, in another pose (nq,) [rad or m].

        It shares the model, of which a copy takes 40 ms if it has many meshes.
        """
        other = copy.copy(self)
        other.data, other.qpos = copy.copy(self.data), qpos.copy()
        other.enter(other.qpos)
        return other

    def enter(self, qpos: Array, qvel: Array | None = None) -> None:
        """Evaluate the model's terms in a pose, at rest if no velocities are given."""
        self.data.qpos[:] = qpos
        self.data.qvel[:] = 0.0 if qvel is None else qvel
        mujoco.mj_fwdPosition(self.model, self.data)
        self.evaluate_forces()

    def evaluate_forces(self) -> None:
        """Evaluate the forces for the velocities of the state."""
        mujoco.mj_fwdVelocity(self.model, self.data)
        mujoco.mj_fwdActuation(self.model, self.data)

    def moved(self, change: Array) -> Array:
        """The pose (nq,) after a change (nv,) of the coordinates [rad or m]."""
        qpos = self.qpos.copy()
        mujoco.mj_integratePos(self.model, qpos, change, 1.0)
        return qpos

    def change_to(self, qpos: Array) -> Array:
        """The change (nv,) of the coordinates that leads from the pose to another [rad or m]."""
        change = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, change, 1.0, self.qpos, qpos)
        return change

    @property
    def masses(self) -> Array:
        """The mass matrix (nv, nv) [kg, kg m, kg m^2]."""
        return mass_matrix(self.model, self.data)

    @property
    def forces(self) -> Array:
        """Forces (nv,) of springs, dampers, actuators, weight and inertia [N and N m]."""
        return self.own_forces - self.data.qfrc_bias

    @property
    def own_forces(self) -> Array:
        """Forces (nv,) of springs, dampers and actuators [N and N m]."""
        return np.asarray(self.data.qfrc_passive + self.data.qfrc_actuator)

    @property
    def all_rows(self) -> Array:
        """The Jacobian (rows, nv) of all constraints that MuJoCo found in the pose."""
        return constraint_rows(self.model, self.data).copy()

    @property
    def constraints(self) -> "Constraints":
        """The equality constraints in the pose, which are the first of MuJoCo's rows."""
        count = self.data.ne
        return Constraints(
            self.all_rows[:count],
            np.array(self.data.efc_pos[:count]),
            np.array(self.data.efc_id[:count], dtype=np.intp),
        )

    def close(self) -> float:
        """Close the loops by Newton's method, heavy joints moving less, and stay in that pose.

        Returns
        -------
        float
            The largest residual that is left [m or rad].
        """
        for _ in range(MAX_CORRECTIONS):
            self.enter(self.qpos)
            constraints = self.constraints
            if constraints.violation < CLOSED:
                break
            scale = 1.0 / np.sqrt(np.maximum(np.diag(self.masses), LEAST_MASS))
            inverse = np.linalg.pinv(constraints.rows * scale, rcond=RANK_SHARE)
            step = -scale * (inverse @ constraints.residuals)
            longest = np.abs(step).max(initial=0.0)
            self.qpos = self.moved(step * min(1.0, MAX_STEP / max(longest, 1e-300)))
        self.enter(self.qpos)
        return self.constraints.violation

    def element(self, kind: str, number: int) -> NamedElement:
        """An element of the model by its number."""
        return named_element(self.model, kind, number)

    def joint_of(self, coordinate: int) -> NamedElement:
        """The joint of a coordinate."""
        return self.element("joint", int(self.model.dof_jntid[coordinate]))


class Constraints:
    """The equality constraints of a model in a pose.

    Parameters
    ----------
    rows : ndarray (rows, nv)
        Their Jacobian [SI].
    residuals : ndarray (rows,)
        [m or rad]
    equalities : ndarray of int (rows,)
        The number of the equality of each row.
    """

    def __init__(self, rows: Array, residuals: Array, equalities: Index) -> None:
        self.rows, self.residuals, self.equalities = rows, residuals, equalities

    @property
    def violation(self) -> float:
        """The largest residual [m or rad]."""
        return float(np.abs(self.residuals).max(initial=0.0))

    @property
    def scaled(self) -> Array:
        """The rows (rows, nv), each equality divided by the length of its longest row.

        Scaled one by one, a row that tends to zero where bars are in line would be as long as the
        others, and the rank would not fall there.
        """
        sizes = np.linalg.norm(self.rows, axis=1)
        longest = np.zeros(self.equalities.max(initial=-1) + 1)
        np.maximum.at(longest, self.equalities, sizes)
        return np.asarray(self.rows / np.maximum(longest[self.equalities], 1e-12)[:, None])

    @property
    def singular_values(self) -> Array:
        """Singular values of the scaled rows, from the largest to the least [1]."""
        if not self.rows.size:
            return np.zeros(0)
        return np.asarray(np.linalg.svd(self.scaled, compute_uv=False))

    @property
    def rank(self) -> int:
        """The number of independent constraints."""
        values = self.singular_values
        return int((values > RANK_SHARE * values.max(initial=1e-300)).sum())

    @property
    def motions(self) -> Array:
        """An orthonormal basis (nv, mobility) of the velocities that the constraints allow."""
        nv = self.rows.shape[1]
        if not self.rows.size:
            return np.eye(nv)
        _, _, right = np.linalg.svd(self.scaled, full_matrices=True)
        return np.asarray(right[self.rank :].T)

    def without(self, equality: int) -> "Constraints":
        """The constraints without those of one equality."""
        kept = self.equalities != equality
        return Constraints(self.rows[kept], self.residuals[kept], self.equalities[kept])


def named_element(model: mujoco.MjModel, kind: str, number: int) -> NamedElement:
    """An element of a model by its number: its name; or the number and its body if it has none."""
    object_type = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
    if name := mujoco.mj_id2name(model, object_type, number):
        return NamedElement(kind, name)
    bodies = {"joint": model.jnt_bodyid, "geom": model.geom_bodyid, "site": model.site_bodyid}
    if kind not in bodies:
        return NamedElement(kind, str(number))
    return NamedElement(kind, str(number), named_element(model, "body", bodies[kind][number]).name)


def coordinate_unit(model: mujoco.MjModel, coordinate: int) -> str:
    """The unit of a coordinate: m of a slide and of the place of a free joint, rad of another."""
    joint = model.dof_jntid[coordinate]
    kind, place = model.jnt_type[joint], coordinate - model.jnt_dofadr[joint]
    moves = kind == SLIDE or (kind == mujoco.mjtJoint.mjJNT_FREE and place < 3)
    return "m" if moves else "rad"
