"""A MuJoCo model whose loops are kept closed while some of its joints are driven.

The loops are closed by Newton's method on the engine's own constraint rows, with the driven joints
held; rates follow from the null space, accelerations from the rows' time derivative:

    J(q) v = 0,   v_drive = rate            J a = -J' v,   a_drive = acceleration

A path of many poses is followed in strides, as one pose after the other would be.  The poses
between the ends of strides are guessed from these, by polynomials of third degree, and closed
together.
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from proofmass.analytic.numerics import STANDS, Array
from proofmass.sim.contents import anchor_bodies, anchors, pose_of
from proofmass.sim.mujoco.model import loop_gap
from proofmass.sim.protocol import BadModel, Unsupported

EQ = mujoco.mjtEq
LIMITS = {
    "joint": int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT),
    "tendon": int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON),
}
AT_REST = (
    "mj_kinematics",
    "mj_comPos",
    "mj_camlight",
    "mj_flex",
    "mj_tendon",
    "mj_collision",
    "mj_makeConstraint",
    "mj_transmission",
)
"""Parts of ``mj_fwdPosition``: all but those of inertia."""
SETTLED = 1e-13  # [m or rad] the last Newton step; rounding of the pose is about 1e-15
TOUCHES = 1e-12  # [rad or m] rounding of a pose; beyond it a joint is past its range
NEAR = 1e-8  # [extents or rad] the last Newton step where the drives are held: its square is left
LEFT = 1e-15  # [extents or rad] what such a step leaves: its size times the way from the inverse
CHORD = 1e-3  # [extents or rad] way on which an inverse serves for the next step as well
CLOSED = 1e-11  # [extents or rad] what may stay open of a loop
UNSURE = 1e5  # [extents or rad per extent] a pose that moves so for a gap is singular, to rounding
UNDRIVEN = np.zeros(0)  # values of no drives
NUDGE = 1e-3  # [rad, or extents] a pose that is singular is not so when it is moved by that
STRIDE = 0.1  # [rad, or extents] the drives move no further at once, so that the branch is kept
FAR = 2.0  # [strides] a guess by a polynomial reaches no further
BENDS = 0.3  # of a move, or of a way of the drives, that is off the tangent or the last way
BLOCK = 1000  # poses that are closed together
AHEAD = 1e-2  # [extents or rad] a guess between strides that is further off is none
SHORTENS = 0.1  # of a Newton step: the next one is shorter, or the guess is none
SURE = 1e8  # ratio of singular values below which a pose is not singular
REGULAR = 1e3  # [extents or rad per extent] poses that move so for a gap are followed one by one
THERE = 1e-12  # [extents or rad] the last Newton step of poses together, whose inverse is refined
TURNS = 5  # Newton steps of poses together


class Linkage:
    """The driven joints `dofs` of a model, and its loops.

    Attributes
    ----------
    dofs, adr : ndarray (drives,) of int
        Where the driven joints stand in ``qvel`` and in ``qpos``.
    sizes : ndarray (nv,)
        What moves are measured in: the extent of the model [m], or radians.
    spans : ndarray (rows + drives,)
        The same of the active equalities' rows, then of the drives.
    shares : ndarray (rows + drives, nv)
        Their quotients, that of the rows' Jacobian by one of lengths in extents.
    inverse : ndarray (nv, rows + drives)
        `invert` the Jacobian of the pose last closed.
    stridden : tuple of ndarray
        Pose (nq,) and tangent (nv, drives) at the begin of the last stride, and pose at its end.
    rub : ndarray (nv,)
        What dry friction asks of the joints, in the sense of their motion [N m or N].
    loaded : ndarray of int
        Bodies with forces of their own, the dead loads of rods, which do not change in a run.
    controls : ndarray (loads,) of int
        Where the controls of loads that change stand in ``ctrl``.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        joints: tuple[str, ...],
        loads: tuple[str, ...] = (),
    ):
        self.model, self.data, self.joints = model, data, joints
        actuators = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, one) for one in loads]
        self.controls = model.actuator_ctrladr[actuators]
        index = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, j) for j in joints]
        self.dofs, self.adr = model.jnt_dofadr[index], model.jnt_qposadr[index]
        self.units = np.eye(model.nv)[self.dofs]
        slides = model.jnt_type[model.dof_jntid] == mujoco.mjtJoint.mjJNT_SLIDE
        self.sizes = np.where(slides, model.stat.extent, 1.0)
        self.stride = STRIDE * self.sizes[self.dofs]
        spans = list[float]()
        for i in range(model.neq):
            kind = EQ(model.eq_type[i])
            if joints and kind not in (EQ.mjEQ_CONNECT, EQ.mjEQ_JOINT):
                word = f"{kind.name[5:].lower()} {model.equality(i).name!r}"
                raise Unsupported(
                    f"equality <{word}> with driven joints; connect and joint are covered"
                )
            if data.eq_active[i]:
                spans += self.span(i, kind)
        self.spans = np.array([*spans, *self.sizes[self.dofs]])
        self.shares = self.sizes / self.spans[:, None]
        self.held = (self.units * self.shares[self.spans.size - self.dofs.size :]).copy()
        self.equalities = [
            (i, EQ(model.eq_type[i])) for i in np.flatnonzero(data.eq_active).tolist()
        ]
        self.bodies = {
            i: anchor_bodies(model, i) for i, kind in self.equalities if kind == EQ.mjEQ_CONNECT
        }
        self.hinged = model.nq == model.nv  # joints whose places can be added to
        self.stridden = UNDRIVEN, UNDRIVEN, UNDRIVEN
        self.rub = np.zeros(model.nv)
        self.loaded = np.flatnonzero(data.xfrc_applied.any(axis=1))
        self.limited = bool(model.jnt_limited.any() or model.tendon_limited.any())

    def span(self, i: int, kind: mujoco.mjtEq) -> list[float]:
        """What the rows of equality number i are measured in [m or 1].

        Raises
        ------
        Unsupported
            It is of a kind that is not covered.
        """
        extent = self.model.stat.extent
        if kind == EQ.mjEQ_JOINT:
            return [float(self.sizes[self.model.jnt_dofadr[self.model.eq_obj1id[i]]])]
        rows = {
            EQ.mjEQ_CONNECT: [extent] * 3,
            EQ.mjEQ_WELD: [extent] * 3 + [1.0] * 3,
            EQ.mjEQ_TENDON: [extent],
        }
        if kind not in rows:
            raise Unsupported(f"equality <{kind.name[5:].lower()} {self.model.equality(i).name!r}>")
        return rows[kind]

    def rubs(self, velocity: Array, fastest: float) -> None:
        """Let joints rub against their motion; those that stand, as when they came there."""
        if not self.model.dof_frictionloss.any():
            return
        self.rub = np.where(
            np.abs(velocity) > STANDS * fastest,
            np.sign(velocity) * self.model.dof_frictionloss,
            self.rub,
        )

    def rows(self, inertia: bool = True) -> tuple[Array, Array]:
        """Residual and Jacobian of the active equalities at the present pose.

        Without its `inertia`, on which forces at rest do not depend: of a chain of 80 links in
        space that takes twenty times as long as all the rest.
        """
        if inertia:
            mujoco.mj_fwdPosition(self.model, self.data)
        else:
            for part in AT_REST:
                getattr(mujoco, part)(self.model, self.data)
        data, count = self.data, self.data.ne  # the rows of equalities come first
        if not mujoco.mj_isSparse(self.model):
            rows = data.efc_J.reshape(data.nefc, self.model.nv)
        else:
            rows = np.zeros((data.nefc, self.model.nv))
            mujoco.mju_sparse2dense(
                rows, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
            )
        return data.efc_pos[:count].copy(), rows[:count].copy()

    def move(self, values: Array, tangent: Array | None = None) -> Array:
        """Follow the branch to new values of the drives, in strides; returns the tangent there.

        `values` are those of the drives, then the controls of loads that change, and so are the
        columns of the tangent (nv, drives + loads).  `tangent` is that of the present pose; without
        it the pose is closed first.  A stride that ends in a singular pose, where the tangent is
        not sure, is taken with the next one.
        """
        values, self.data.ctrl[self.controls] = np.split(values, [self.dofs.size])
        if tangent is None:
            tangent = self.place(self.data.qpos[self.adr])
        tangent = tangent[:, : self.dofs.size]
        far = values - self.data.qpos[self.adr]
        strides = int(np.ceil((np.abs(far) / self.stride).max(initial=0.0)))
        for part in range(strides)[::-1]:
            target, before = values - far * part / strides, self.data.qpos.copy()
            ahead = self.ahead(target, tangent)
            mujoco.mj_integratePos(self.model, self.data.qpos, ahead, 1.0)
            try:
                there = self.place(target)
                sure = not part or self.lever() < UNSURE
            except (BadModel, Unsupported):
                if not part:
                    raise
                sure = False
            if part and not sure:
                self.data.qpos[:] = before
            else:
                self.stridden = before, tangent, self.data.qpos.copy()
                tangent = there
        return self.loaded_tangent(tangent)

    def ahead(self, target: Array, tangent: Array) -> Array:
        """The move (nv,) to a guess of the pose at values of the drives, by the present tangent.

        Where the drives go on as in the last stride, by Hermite's polynomial of third degree
        through its ends, unless it bends much.
        """
        pose, (before, rates, end) = self.data.qpos, self.stridden
        way = target - pose[self.adr]
        move = tangent @ way
        if not self.hinged or not np.array_equal(pose, end):
            return move
        line = (pose - before)[self.adr]
        share = (way @ line) / (line @ line or np.nan)
        if not (0 < share <= FAR and np.abs(way - share * line).max() < BENDS * np.abs(way).max()):
            return move
        first, last, chord = rates @ line, tangent @ line, pose - before
        cubic = first + last - 2 * chord
        bend = share**2 * (last - chord + cubic) + share**3 * cubic
        if np.abs(bend).max() < BENDS * np.abs(move).max():
            move += bend
        return move

    def path(self, values: Array) -> Iterator[Array]:
        """The tangents at values (drives + loads, n), each with the model in its pose.

        Raises
        ------
        BadModel, Unsupported
            As `move` does, where the path ends.
        """
        tangent, drives = None, self.dofs.size
        for first in range(0, values.shape[1], BLOCK):
            block = values[:, first : first + BLOCK]
            begin = self.data.qpos.copy(), self.data.ctrl.copy()
            if (found := self.together(block, tangent)) is None:
                self.data.qpos[:], self.data.ctrl[:] = begin
                for one in block.T:
                    tangent = self.move(one, tangent)
                    yield tangent
                continue
            for pose, inverse, controls in zip(*found, block[drives:].T, strict=True):
                self.data.qpos[:], self.data.ctrl[self.controls] = pose, controls
                self.inverse = self.refined(inverse, self.rows()[1])
                tangent = self.loaded_tangent(self.inverse[:, inverse.shape[1] - drives :])
                yield tangent

    def together(self, values: Array, tangent: Array | None) -> tuple[Array, Array] | None:
        """Poses (n, nv) of a path that is regular, and the `inverse` (n, nv, rows + drives) nearby.

        None where poses are as far from each other as strides, where one of them is singular or
        cannot be closed, or where Newton's method does not go from a guess straight to its pose.
        """
        drives = values[: self.dofs.size].T
        far = np.abs(np.diff(drives, axis=0) / self.stride).max(axis=1, initial=0.0)
        far = np.append(0.0, np.cumsum(far))
        knots = [0]
        while knots[-1] < far.size - 1:
            ahead = int(np.searchsorted(far, far[knots[-1]] + 1.0, "right")) - 1
            knots.append(max(ahead, knots[-1] + 1))
        if not self.hinged or not 2 <= len(knots) < far.size / 2:
            return None
        ends, ways = [], []
        try:
            for k in knots:
                tangent = self.move(values[:, k], tangent)
                ends.append(self.data.qpos.copy())
                ways.append(tangent[:, : self.dofs.size])
        except (BadModel, Unsupported):
            return None
        poses = between(drives, np.array(knots), np.array(ends), np.array(ways))
        before = np.full(len(poses), AHEAD / SHORTENS)
        for _ in range(TURNS):
            poses[:, self.dofs] = drives
            gaps, jacobians = self.rows_at(poses)
            if (inverses := self.invert_regular(jacobians)) is None:
                return None
            moves = -(inverses[..., : gaps.shape[1]] @ gaps[..., None])[..., 0]
            size = np.abs(moves / self.sizes).max(axis=1)
            if ((size > NEAR) & ~(size < SHORTENS * before)).any():
                return None
            poses, before = poses + moves, size
            if size.max() <= THERE:
                poses[:, self.dofs] = drives
                left = gaps + (jacobians @ moves[..., None])[..., 0]
                open_by = np.abs(left / self.spans[: gaps.shape[1]]).max(initial=0.0)
                return (poses, inverses) if open_by < CLOSED else None
        return None

    def rows_at(self, poses: Array) -> tuple[Array, Array]:
        """`rows` at poses (n, nv)."""
        found = []
        for pose in poses:
            self.data.qpos[:] = pose
            found.append(self.rows())
        residuals, jacobians = zip(*found, strict=True)
        return np.array(residuals), np.array(jacobians)

    def invert_regular(self, jacobians: Array) -> Array | None:
        """`invert` of many poses (n, nv, rows + drives); None if one of them is near a singular."""
        scaled = self.scaled(jacobians)
        if scaled.shape[1] < self.model.nv or not np.isfinite(scaled).all():
            return None
        if (found := self.eliminated(scaled, REGULAR)) is not None:
            return found
        left, values, right = np.linalg.svd(scaled, full_matrices=False)
        if not (values[:, -1] > values[:, 0] / REGULAR).all():
            return None
        return self.inverted(left, values, right)

    def refined(self, inverse: Array, jacobian: Array) -> Array:
        """`invert` a Jacobian, from that of a pose which is off by the last Newton step.

        Rates would be off by as much, up to `THERE`, and not by the rounding of the pose alone; a
        step of Newton's method on the inverse leaves the square of that.
        """
        rows = np.vstack([jacobian, self.units])
        return np.asarray(2.0 * inverse - inverse @ (rows @ inverse))

    def loaded_tangent(self, tangent: Array) -> Array:
        """The tangent of the drives, and that of loads, which move nothing."""
        if not self.controls.size:
            return tangent
        return np.pad(tangent, ((0, 0), (0, self.controls.size)))

    def place(self, values: Array) -> Array:
        """Put the drives to `values`, close the loops, and return the tangent (nv, drives)."""
        self.data.qpos[self.adr] = values
        inverse, far = np.empty((0, 0)), np.inf  # and the way from the pose that it is of
        for _ in range(50):
            residual, jacobian = self.rows()
            if far > CHORD:
                inverse, far = self.invert(jacobian), 0.0
            move = -inverse[:, : residual.size] @ residual
            mujoco.mj_integratePos(self.model, self.data.qpos, move, 1.0)
            self.data.qpos[self.adr] = values
            size = np.abs(move / self.sizes).max(initial=0.0)
            far += size
            if not size * far > LEFT:
                break
        jacobian, residual = self.closed(values)
        self.inverse = self.invert(jacobian)
        return self.inverse[:, residual.size :]

    def lever(self) -> float:
        """Largest move [extents or rad] for a gap of an extent, in the pose last closed."""
        return float(np.abs(self.inverse / self.shares.T).max())

    def closed(self, values: Array) -> tuple[Array, Array]:
        """Jacobian and residual of the loops with the drives at `values` [rad or m].

        Raises
        ------
        BadModel
            The loops are open.
        """
        residual, jacobian = self.rows()
        gaps = residual / self.spans[: residual.size]
        if not np.abs(gaps).max(initial=0.0) < CLOSED:
            open_by = loop_gap(self.model, self.data).max(initial=0.0)
            raise BadModel(
                f"cannot be assembled at {self.format_drives(values)}: "
                f"the loop stays open by {open_by:.3g} m"
            )
        return jacobian, residual

    def leaves_dof(self) -> bool:
        """Whether the drives leave degrees of freedom, and not in a singular pose alone."""
        pose, free = self.data.qpos.copy(), self.dof()
        if free:
            moves = NUDGE * np.random.default_rng(0).uniform(-1.0, 1.0, self.model.nv) * self.sizes
            mujoco.mj_integratePos(self.model, self.data.qpos, moves, 1.0)
            free = self.dof()
            self.data.qpos[:] = pose
        return bool(free)

    def release(self, values: Array = UNDRIVEN, wanted: Array = UNDRIVEN) -> Array:
        """Close the loops with the least change of the joints, and make the rates fit them.

        Parameters
        ----------
        values, wanted : ndarray (drives,)
            Places [rad or m] and rates [rad/s or m/s] of the driven joints; none, if left out.

        Returns
        -------
        ndarray (nv, drives)
            Least rates of all joints for a unit rate of each drive [SI].

        Raises
        ------
        BadModel
            The loops stay open with the drives at their places.
        """
        self.data.qpos[self.adr] = values
        for _ in range(50):
            residual, jacobian = self.rows()
            rows = np.vstack([jacobian, self.units])
            open_by = np.append(residual, np.zeros(self.dofs.size))
            move = -np.linalg.lstsq(rows, open_by, rcond=1e-10)[0]
            mujoco.mj_integratePos(self.model, self.data.qpos, move, 1.0)
            if np.abs(move).max(initial=0.0) < SETTLED:
                break
        jacobian = self.closed(values)[0] if values.size else self.rows()[1]
        rows, rates = np.vstack([jacobian, self.units]), self.data.qvel
        needed = np.append(np.zeros(len(jacobian)), wanted)
        rates += np.linalg.lstsq(rows, needed - rows @ rates, rcond=1e-10)[0]
        return np.linalg.pinv(rows, rcond=1e-10)[:, len(jacobian) :]

    def check_limits(self) -> None:
        """Raise `BadModel` if a joint or a tendon is beyond its range; needs the pose of `rows`.

        The drives hold every joint, so nothing can give way there; the engine's own limits are
        springs, whose forces would enter the holding moments.
        """
        for word, kind in LIMITS.items() if self.limited else ():
            past = (self.data.efc_type == kind) & (self.data.efc_pos < -TOUCHES)
            if past.any():
                name = getattr(self.model, word)(self.data.efc_id[past.argmax()]).name
                raise BadModel(
                    f"{word} {name!r} is beyond its range at "
                    f"{self.format_drives(self.data.qpos[self.adr])}"
                )

    def dof(self) -> int:
        """Degrees of freedom left at the present pose when the drives are held."""
        rows = self.scaled(self.rows()[1])
        if not len(rows):  # numpy up to 2.4.0 refuses the rank of an empty matrix
            return int(self.model.nv)
        return int(self.model.nv - np.linalg.matrix_rank(rows, rtol=1e-10))

    def scaled(self, jacobian: Array) -> Array:
        """The loops' rows (..., rows, nv) and, below them, the drives', with lengths in extents."""
        rows = jacobian.shape[-2]
        found = np.empty((*jacobian.shape[:-2], *self.shares.shape))
        np.multiply(jacobian, self.shares[:rows], out=found[..., :rows, :])
        found[..., rows:, :] = self.held
        return found

    def eliminated(self, scaled: Array, most: float) -> Array | None:
        """The inverse of what `scaled` gives, in SI, by elimination.

        It takes less time than singular values.  None where there are more rows than joints, zeros
        not counted, and where the ratio of the largest to the least of these may be above a bound.
        """
        rows = scaled.any(axis=(*range(scaled.ndim - 2), -1))
        if np.count_nonzero(rows) != self.model.nv:
            return None
        square = scaled if rows.all() else scaled[..., rows, :]
        try:
            inverse = np.linalg.inv(square)
        except np.linalg.LinAlgError:
            return None
        sizes = np.square(square).sum(axis=(-2, -1)) * np.square(inverse).sum(axis=(-2, -1))
        if not (sizes < most**2).all():
            return None
        found = np.zeros((*scaled.shape[:-2], self.model.nv, scaled.shape[-2]))
        found[..., rows] = inverse
        return found * self.shares.T

    def inverted(self, left: Array, values: Array, right: Array) -> Array:
        """The pseudo-inverse of what `scaled` gives, by its singular values, in SI."""
        turned = np.swapaxes(right, -1, -2) / values[..., None, :]
        return np.asarray(turned @ np.swapaxes(left, -1, -2) * self.shares.T)

    def format_drives(self, values: Array) -> str:
        """The driven joints with their values."""
        return ", ".join(f"{j} = {v:.6g}" for j, v in zip(self.joints, values, strict=True))

    def invert(self, jacobian: Array) -> Array:
        """Pseudo-inverse of the loops' rows and, below them, the drives' (nv, rows + drives).

        Its last columns are the motions that the drives allow.  A planar loop in 3-D carries rows
        that are always zero, hence no plain inverse.
        """
        scaled = self.scaled(jacobian)
        if (found := self.eliminated(scaled, SURE)) is not None:
            return found
        left, values, right = np.linalg.svd(scaled, full_matrices=False)
        rank = int((values > 1e-10 * values[0]).sum())
        if rank < self.model.nv:
            raise Unsupported(
                f"{self.model.nv - rank} degree(s) of freedom left when "
                f"{self.format_drives(self.data.qpos[self.adr])} is held (singular values "
                f"{values[0]:.2g} to {values[-1]:.2g}): free joints or a singular pose"
            )
        return self.inverted(left, values, right)

    def acceleration(self, velocity: Array, values: Array) -> Array:
        """Joint accelerations (nv,) that keep the loops closed; needs the pose of `place`."""
        mujoco.mj_fwdVelocity(self.model, self.data)
        drift = [self.row_drift(i, kind, velocity) for i, kind in self.equalities]
        return np.asarray(self.inverse @ np.concatenate([*drift, values]))

    def row_drift(self, i: int, kind: mujoco.mjtEq, velocity: Array) -> Array:
        """-J' v of equality number i, in the engine's order of rows."""
        model, data = self.model, self.data
        if kind == EQ.mjEQ_CONNECT:
            (one, two), (first, second) = np.zeros((2, 3, model.nv)), self.bodies[i]
            here, there = anchors(model, i, pose_of(data))
            mujoco.mj_jacDot(model, data, one, None, here, first)
            mujoco.mj_jacDot(model, data, two, None, there, second)
            return np.asarray((two - one) @ velocity)
        second = model.eq_obj2id[i]
        if second < 0:
            return np.zeros(1)
        dof, adr = model.jnt_dofadr[second], model.jnt_qposadr[second]
        poly = np.polynomial.Polynomial(model.eq_data[i, :5]).deriv(2)
        return np.array([poly(data.qpos[adr] - model.qpos0[adr]) * velocity[dof] ** 2])

    def needed(self) -> Array:
        """What must act on the joints for the present rates and accelerations, loops open (nv,)."""
        model, data, force = self.model, self.data, np.empty(self.model.nv)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_rne(model, data, 1, force)
        force += model.dof_armature * data.qacc + self.rub
        return force - data.qfrc_passive - data.qfrc_actuator - self.pushed()

    def pushed(self) -> Array:
        """What the forces on bodies, loads of rods, do to the joints (nv,)."""
        model, data, found = self.model, self.data, np.zeros(self.model.nv)
        loads, places = data.xfrc_applied, data.xipos
        for body in self.loaded.tolist():
            push, turn = loads[body, :3], loads[body, 3:]
            mujoco.mj_applyFT(model, data, push, turn, places[body], body, found)
        return found

    def loop_forces(self, needed: Array) -> Array:
        """Forces in the rows of the active equalities [N or N m], of the pose last closed."""
        rows = self.inverse.shape[1] - self.dofs.size
        return np.asarray(self.inverse[:, :rows].T @ needed)

    def balance_forces(self, tangent: Array, sensors: bool) -> Array:
        """Moments (or forces) of the drives for the present rates and accelerations (drives,).

        By virtual work.  The engine's ``qfrc_inverse`` at a drive is not it: on a closed loop that
        leaves out what the loop carries.  `sensors`: the engine's sensors of forces then show what
        rigid loops transmit, and not what its soft ones would.
        """
        model, data, needed = self.model, self.data, self.needed()
        if sensors:
            data.efc_force[:] = 0.0
            data.efc_force[: data.ne] = self.loop_forces(needed)
            mujoco.mj_rnePostConstraint(model, data)
            mujoco.mj_sensorAcc(model, data)
        return needed @ tangent


def between(drives: Array, knots: Array, ends: Array, ways: Array) -> Array:
    """Poses guessed from those at knots, with the values of the drives.

    Parameters
    ----------
    drives : ndarray (n, drives)
        Values of the drives [rad or m].
    knots : ndarray (knots,) of int
        Numbers of the poses that are known, the first and the last among them [1].
    ends : ndarray (knots, nv)
        These poses [rad or m].
    ways : ndarray (knots, nv, drives)
        How they move with the drives, rad or m for each rad or m [1].

    Returns
    -------
    ndarray (n, nv) [rad or m]
        On the line of the drives from a knot to the next Hermite's polynomials of third degree,
        beside it the ways of both knots.
    """
    k = np.clip(np.searchsorted(knots, np.arange(len(drives)), "right") - 1, 0, knots.size - 2)
    start, line = drives[knots[k]], drives[knots[k + 1]] - drives[knots[k]]
    square = (line**2).sum(axis=1)
    share = ((drives - start) * line).sum(axis=1) / np.where(square > 0, square, 1.0)
    aside, u = drives - start - share[:, None] * line, share[:, None]
    along = [(ways[j] @ line[..., None])[..., 0] for j in (k, k + 1)]
    beside = [(ways[j] @ aside[..., None])[..., 0] for j in (k, k + 1)]
    return np.asarray(
        ends[k]
        + u**2 * (3 - 2 * u) * (ends[k + 1] - ends[k])
        + u * (1 - u) * ((1 - u) * along[0] - u * along[1])
        + (1 - u) * beside[0]
        + u * beside[1]
    )
