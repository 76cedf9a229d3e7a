"""Quasi-static sweep in MuJoCo: poses, rates, accelerations and holding moment without a time step.

The loops are closed by Newton's method on the engine's own constraint rows, with the driven joint
held; rates follow from the null space, accelerations from the rows' time derivative:

    J(q) v = 0,   v_drive = rate            J a = -J' v,   a_drive = acceleration

The holding moment is virtual work: the engine's inverse dynamics at rest, projected on the motion
that the drive allows.  The engine's own ``qfrc_inverse`` at the drive is not it: on a closed loop
it leaves out what the loop carries.
"""

import time

import mujoco
import numpy as np

from sim.mujoco_model import Recorder, anchor_bodies, anchors, loop_gap, pose_of
from sim.protocol import Array, BadModel, Curves, Run, Unsupported

SETTLED = 1e-13  # [m or rad] the last Newton step; rounding of the pose is about 1e-15
MOMENTS = (int(mujoco.mjtSensor.mjSENS_ACTUATORFRC), int(mujoco.mjtSensor.mjSENS_JOINTACTFRC))


class Linkage:
    """A model whose loops are kept closed while one joint is driven."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, joint: str):
        self.model, self.data, self.joint = model, data, joint
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
        self.dof, self.adr = int(model.jnt_dofadr[index]), int(model.jnt_qposadr[index])
        self.unit = np.eye(model.nv)[self.dof]
        for i in range(model.neq):
            kind = mujoco.mjtEq(model.eq_type[i])
            if kind not in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_JOINT):
                word = f"{kind.name[5:].lower()} {model.equality(i).name!r}"
                raise Unsupported(f"equality <{word}> in a sweep; connect and joint are covered")

    def rows(self) -> tuple[Array, Array]:
        """Residual and Jacobian of the active equalities at the present pose."""
        mujoco.mj_fwdPosition(self.model, self.data)
        keep = self.data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        jacobian = np.zeros((self.data.nefc, self.model.nv))
        if self.data.nefc:
            jacobian[:] = self.data.efc_J.reshape(self.data.nefc, -1)
        return self.data.efc_pos[keep].copy(), jacobian[keep]

    def place(self, value: float) -> Array:
        """Move the drive to `value`, close the loops, and return the tangent dq/dvalue (nv,)."""
        step = np.inf
        self.data.qpos[self.adr] = value
        for _ in range(50):
            residual, jacobian = self.rows()
            full = np.vstack([jacobian, self.unit])
            previous, move = step, self.solve(full, np.append(-residual, 0.0))
            step = float(np.abs(move).max(initial=0.0))
            mujoco.mj_integratePos(self.model, self.data.qpos, move, 1.0)
            self.data.qpos[self.adr] = value
            if step < SETTLED or not np.isfinite(step) or (step < 1e-9 and step >= previous):
                break
        residual, jacobian = self.rows()
        if not np.abs(residual).max(initial=0.0) < 1e-11 * max(1.0, self.model.stat.extent):
            open_by = loop_gap(self.model, self.data).max(initial=0.0)
            raise BadModel(f"cannot be assembled at {self.joint} = {value:.6g}: "
                           f"the loop stays open by {open_by:.3g} m")
        return self.solve(np.vstack([jacobian, self.unit]), np.append(0 * residual, 1.0))

    def solve(self, matrix: Array, right: Array) -> Array:
        """Least squares, since a planar loop in 3-D carries rows that are always zero."""
        solution, _, rank, values = np.linalg.lstsq(matrix, right, rcond=1e-10)
        if rank < self.model.nv:
            raise Unsupported(f"{self.model.nv - rank} degree(s) of freedom left when joint "
                              f"{self.joint!r} is held (singular values {values[0]:.2g} to "
                              f"{values[-1]:.2g}): free joints or a singular pose")
        return np.asarray(solution, dtype=np.float64)

    def acceleration(self, velocity: Array, value: float) -> Array:
        """Joint accelerations (nv,) that keep the loops closed; needs the pose of `place`."""
        mujoco.mj_fwdVelocity(self.model, self.data)
        _, jacobian = self.rows()
        drift = [part for i in range(self.model.neq) if self.data.eq_active[i]
                 for part in self.row_drift(i, velocity)]
        return self.solve(np.vstack([jacobian, self.unit]), np.append(-np.array(drift), value))

    def row_drift(self, i: int, velocity: Array) -> Array:
        """J' v of equality number i, in the engine's order of rows."""
        if self.model.eq_type[i] == mujoco.mjtEq.mjEQ_CONNECT:
            p1, p2 = anchors(self.model, i, pose_of(self.data))
            b1, b2 = anchor_bodies(self.model, i)
            return (self.jacobian_rate(p1, b1) - self.jacobian_rate(p2, b2)) @ velocity
        second = self.model.eq_obj2id[i]
        if second < 0:
            return np.zeros(1)
        dof, adr = self.model.jnt_dofadr[second], self.model.jnt_qposadr[second]
        poly = np.polynomial.Polynomial(self.model.eq_data[i, :5]).deriv(2)
        return np.array([-poly(self.data.qpos[adr] - self.model.qpos0[adr]) * velocity[dof] ** 2])

    def jacobian_rate(self, point: Array, body: int) -> Array:
        """Time derivative of a point's translational Jacobian (3, nv)."""
        rate = np.zeros((3, self.model.nv))
        mujoco.mj_jacDot(self.model, self.data, rate, None, point, body)
        return rate

    def holding_moment(self, tangent: Array) -> float:
        """Moment (or force) that the drive must apply at rest, by virtual work."""
        self.data.qvel[:] = 0
        self.data.qacc[:] = 0
        mujoco.mj_inverse(self.model, self.data)
        return float(tangent @ self.data.qfrc_inverse)


def sweep(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Follow the drive over ``run.x`` and read every sensor at every pose.

    Raises
    ------
    BadModel
        The loops cannot be closed at some value of the drive, which is named.
    Unsupported
        Freedoms are left when the drive is held, or an equality is of another kind.
    """
    if run.drive is None:
        raise BadModel("a sweep needs a [drive]: the joint that is moved")
    values, rates, accelerations = (np.broadcast_to(a, run.x.shape) for a in run.drive.law(run.x))
    linkage = Linkage(model, data, run.drive.joint)
    record = Recorder(model, data, run.channels, run.x.size)
    moments, tangent = np.empty(run.x.size), None
    began = time.perf_counter()
    for k, value in enumerate(values):
        if tangent is not None:
            mujoco.mj_integratePos(model, data.qpos, tangent, value - data.qpos[linkage.adr])
        tangent = linkage.place(value)
        moments[k] = linkage.holding_moment(tangent)
        data.qvel[:] = tangent * rates[k]
        data.qacc[:] = linkage.acceleration(data.qvel, accelerations[k])
        mujoco.mj_inverse(model, data)
        record.sample(k)
    seconds = time.perf_counter() - began
    channels = record.curves()
    for channel, (index, _) in record.sensors.items():
        if model.sensor_type[index] in MOMENTS:
            gear = model.actuator_gear[model.sensor_objid[index], 0]
            channels[channel] = moments / (gear if model.sensor_type[index] == MOMENTS[0] else 1)
    return Curves(run.x, channels, drive=(values, rates, accelerations),
                  gap=float(record.gaps().max()), seconds=seconds, steps=run.x.size)
