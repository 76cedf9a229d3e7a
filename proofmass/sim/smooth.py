"""The smooth terms of the equations of motion of a compiled MJCF, as MuJoCo computes them.

They agree to rounding with an independent formulation, and take 20 to 80 times less time than one
in NumPy.  Contacts, joint limits and dry friction, which MuJoCo makes soft, are left out; of
equalities only the rows are given: constraint violation, Jacobian and J-dot-v.
"""

import copy
from functools import cached_property
from itertools import pairwise

import mujoco
import numpy as np

from proofmass.analytic.numerics import NotCovered
from proofmass.analytic.term_source import Terms
from proofmass.base.arrays import Array, Index
from proofmass.sim.dense import mass_matrix
from proofmass.sim.mjcf import leave_out_disabled

DISABLE_BITS, EQ = mujoco.mjtDisableBit, mujoco.mjtEq
SOFT_FLAGS = (
    DISABLE_BITS.mjDSBL_CONTACT,
    DISABLE_BITS.mjDSBL_LIMIT,
    DISABLE_BITS.mjDSBL_FRICTIONLOSS,
    DISABLE_BITS.mjDSBL_ISLAND,
)
ROWS_PER_EQUALITY = {EQ.mjEQ_CONNECT: 3, EQ.mjEQ_WELD: 6, EQ.mjEQ_JOINT: 1, EQ.mjEQ_TENDON: 1}
"""Rows of the equalities that the solver in space covers."""
LOOP_EQUALITIES = EQ.mjEQ_CONNECT, EQ.mjEQ_WELD


class SmoothTerms:
    """Terms of a compiled model with the controls of a key.

    Parameters
    ----------
    model : MjModel
        The compiled model, of which a copy is made.
    start : str
        Name of the key whose controls act; without meaning in a model without keys.
    """

    name = "MuJoCo"

    def __init__(self, model: mujoco.MjModel, start: str = "start"):
        self.whole = model
        self.model = copy.copy(model)
        leave_out_disabled(self.model)
        for flag in SOFT_FLAGS:
            self.model.opt.disableflags |= int(flag)
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(self.model)
        if self.model.nkey:
            mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key(start).id)
        self.ctrl = self.data.ctrl.copy()
        self.order, self.ties = self.rows()
        self.equality_of_row = np.repeat(
            equalities := np.flatnonzero(self.model.eq_active0),
            [ROWS_PER_EQUALITY[EQ(int(self.model.eq_type[e]))] for e in equalities],
        )
        self.ties_with_drift = [tie for tie in self.ties if self.has_drift(tie[0])]
        self.rows_without_drift = [row for e, row in self.ties if not self.has_drift(e)]

    def rows(self) -> tuple[Index, list[tuple[int, int]]]:
        """Order of MuJoCo's rows with loops first; numbers and rows of joint, tendon equalities."""
        loops, ties, row = list[int](), list[tuple[int, int]](), 0
        for e in np.flatnonzero(self.model.eq_active0).tolist():
            kind = EQ(int(self.model.eq_type[e]))
            if kind not in ROWS_PER_EQUALITY:
                raise NotCovered(f"equality of a flex: {self.model.equality(e).name or e}")
            own = list(range(row, row + ROWS_PER_EQUALITY[kind]))
            row += ROWS_PER_EQUALITY[kind]
            if kind in LOOP_EQUALITIES:
                loops += own
            else:
                ties.append((e, own[0]))
        return np.array([*loops, *(row for _, row in ties)], np.intp), ties

    def place(self, q: Array, v: Array, ctrl: Array | None = None) -> None:
        """Set the state and compute all quantities up to the forces of actuators."""
        self.data.qpos[:], self.data.qvel[:] = q, v
        self.data.ctrl[:] = self.ctrl if ctrl is None else ctrl
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_fwdVelocity(self.model, self.data)
        mujoco.mj_fwdActuation(self.model, self.data)

    def equalities(self, q: Array) -> tuple[Array, Array]:
        """Violation and Jacobian of equalities at a pose (poses,): (rows,), (rows, rates) [SI]."""
        self.data.qpos[:] = q
        mujoco.mj_fwdPosition(self.model, self.data)
        return self.all_rows(self.data.efc_pos)[self.order], self.jacobian()

    def jacobian(self) -> Array:
        """Jacobian of the equalities at the present pose (rows, rates) [SI]."""
        count, rates = self.data.nefc, self.model.nv
        found = self.data.efc_J[: count * rates].reshape(count, rates)
        return self.all_rows(found)[self.order]

    def all_rows(self, values: Array) -> Array:
        """Values of all rows in MuJoCo's order, from those of the rows that MuJoCo has.

        MuJoCo leaves out an equality whose Jacobian is zero: its rows are zero.
        """
        count = self.data.nefc  # arrays keep the rows of the pose before if there are none
        if count == self.order.size:
            return values
        found = np.zeros((self.order.size, *values.shape[1:]))
        found[np.isin(self.equality_of_row, self.data.efc_id[:count])] = values[:count]
        return found

    def acceleration(self, q: Array, v: Array, ctrl: Array | None = None) -> Array:
        """Accelerations (rates,) of a tree without equalities [SI]."""
        self.place(q, v, ctrl)
        mujoco.mj_fwdAcceleration(self.model, self.data)
        return self.data.qacc_smooth.copy()

    @cached_property
    def shapes(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """The model with contacts, and a state of it."""
        model = copy.copy(self.whole)
        return model, mujoco.MjData(model)

    def first_contact(self, times: Array | None, q: Array) -> str:
        """The first contact of poses (n, poses) and, if they have times, between them.

        Between two poses it is looked for as often as the model's steps are long, as the model
        itself does; empty if there is none.
        """
        model, data = self.shapes
        for k, pose in enumerate(q):
            places = np.ones(1)
            if times is not None and k:
                count = max(1, int(np.ceil((times[k] - times[k - 1]) / model.opt.timestep)))
                places = np.arange(1, count + 1) / count
            way, start = np.zeros(model.nv), q[max(k - 1, 0)]
            mujoco.mj_differentiatePos(model, way, 1.0, start, pose)
            for share in places:
                data.qpos[:] = start
                mujoco.mj_integratePos(model, data.qpos, way, share)
                if names := touching_geoms(model, data):
                    where = f"sample {k}"
                    if times is not None:
                        before = times[max(k - 1, 0)]
                        where = f"t = {before + share * (times[k] - before):.4g} s"
                    return f"{names} touch at {where}"
        return ""

    def terms(self, q: Array, v: Array, ctrl: Array | None = None) -> Terms:
        """All terms at a pose (poses,) with rates (rates,), and with controls, if not the key's."""
        self.place(q, v, ctrl)
        model, data = self.model, self.data
        mass = mass_matrix(model, data)
        # MuJoCo's reference acceleration is the sum of damping, stiffness and -J-dot-v
        stiffness, damping, impedance, _ = data.efc_KBIP.T
        gain = stiffness * impedance
        drift = self.all_rows(data.efc_aref + damping * data.efc_vel + gain * data.efc_pos)
        drift[self.rows_without_drift] = 0.0
        for e, row in self.ties_with_drift:
            drift[row] = self.tie_drift(e, v)
        return Terms(
            mass,
            data.qfrc_bias.copy(),
            data.qfrc_passive + data.qfrc_actuator,
            self.all_rows(data.efc_pos)[self.order],
            self.jacobian(),
            drift[self.order],
        )

    def has_drift(self, e: int) -> bool:
        """Whether joint or tendon equality number e may have a drift: of tendons, or nonlinear."""
        model = self.model
        return bool(model.eq_type[e] == EQ.mjEQ_TENDON or model.eq_data[e, 2:5].any())

    def tie_drift(self, e: int, v: Array) -> float:
        """The drift of joint or tendon equality number e, whose J-dot-v MuJoCo 4.0.0 leaves out."""
        model, data = self.model, self.data
        one, two = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        tendons = model.eq_type[e] == EQ.mjEQ_TENDON
        found = -self.tendon_drift(one, v) if tendons else 0.0
        if two < 0:
            return found
        if tendons:
            x, rate = data.ten_length[two] - model.tendon_length0[two], data.ten_velocity[two]
        else:
            at = model.jnt_qposadr[two]
            x, rate = data.qpos[at] - model.qpos0[at], v[model.jnt_dofadr[two]]
        _, *slopes = model.eq_data[e, :5].tolist()
        b, c, d, f = slopes
        found += (2 * c + x * (6 * d + 12 * f * x)) * rate**2
        if tendons:
            found += (b + x * (2 * c + x * (3 * d + 4 * f * x))) * self.tendon_drift(two, v)
        return float(found)

    def tendon_drift(self, t: int, v: Array) -> float:
        """Second time derivative of the length of a tendon from site to site, at v̇ = 0."""
        model, data, found = self.model, self.data, 0.0
        wraps = model.tendon_adr[t] + np.arange(model.tendon_num[t])
        if model.wrap_type[wraps[0]] == mujoco.mjtWrap.mjWRAP_JOINT:
            return 0.0
        ends = list[tuple[Array, Array, Array]]()
        for site in model.wrap_objid[wraps]:
            rows, rates = np.zeros((3, model.nv)), np.zeros((3, model.nv))
            body, place = int(model.site_bodyid[site]), data.site_xpos[site]
            mujoco.mj_jac(model, data, rows, None, place, body)
            mujoco.mj_jacDot(model, data, rates, None, place, body)
            ends.append((place, rows @ v, rates @ v))
        for one, two in pairwise(ends):
            way, speed, change = (b - a for a, b in zip(one, two, strict=True))
            length = float(np.linalg.norm(way))
            along = way / length
            found += float(along @ change + (speed @ speed - (along @ speed) ** 2) / length)
        return found


def touching_geoms(model: mujoco.MjModel, data: mujoco.MjData) -> str:
    """The two geoms of a contact that acts in a pose, such as ``geoms 'foot' and 'floor'``."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    for contact in data.contact[: data.ncon]:
        if contact.exclude:
            continue
        if min(contact.geom) < 0:
            return "bodies"
        one, other = (model.geom(g).name or str(g) for g in contact.geom)
        return f"geoms {one!r} and {other!r}"
    return ""
