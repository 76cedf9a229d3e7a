"""A MuJoCo model whose loops are kept closed while some of its joints are driven.

Newton's method on the engine's own constraint rows closes the loops, with the driven joints at
prescribed values.  Rates follow from the null space of the rows, accelerations from their time
derivative:

    J(q) v = 0,   v_drive = rate            J a = -J' v,   a_drive = acceleration

A path of many poses is followed in strides.  The poses between the ends of strides are interpolated
by polynomials of third degree, and their loops are closed for all of them together.
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from proofmass.analytic.names import equality_name
from proofmass.analytic.numerics import REST_RATE_SHARE, without_rounding
from proofmass.base.arrays import Array
from proofmass.sim.contents import anchor_bodies
from proofmass.sim.dense import constraint_rows
from proofmass.sim.mujoco.model import loop_violations
from proofmass.sim.protocol.failures import BadModel, Unsupported

EQ = mujoco.mjtEq
LIMIT_ROW_TYPES = {
    "joint": int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT),
    "tendon": int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON),
}
STATIC_STAGES = (
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
# [rad or m] rounding of a pose; a joint further beyond its range has left it
RANGE_TOLERANCE = 1e-12
# [extents or rad] size of a Newton step after which an error of its square remains
NEWTON_TOLERANCE = 1e-8
# [extents or rad] error at which `place` stops: Newton step times distance from the inverse's pose
PLACE_TOLERANCE = 1e-15
# [extents or rad] distance from its pose up to which an inverse is used again
MAX_CHORD_DISTANCE = 1e-3
LOOP_TOLERANCE = 1e-11  # [extents or rad] largest constraint violation of a closed loop
# [extents or rad per extent] ratio of motion to constraint violation above which a pose counts as
# singular, because of rounding
SINGULAR_LEVER = 1e5
NO_DRIVE_VALUES = np.zeros(0)  # values or rates of no drives
# [rad or extents] offset at which a pose next to a singular one is not singular
SINGULAR_POSE_OFFSET = 1e-3
MAX_DRIVE_STRIDE = (
    0.1  # [rad or extents] largest motion of drives in a stride: keeps the assembly mode
)
MAX_EXTRAPOLATION = 2.0  # [strides] largest extrapolation by a polynomial
# largest share by which a polynomial leaves its tangent, or drives their last line
MAX_BEND_RATIO = 0.3
POSES_PER_BLOCK = 1000  # poses whose loops are closed together
# [extents or rad] largest error of an interpolated pose; else poses follow singly
MAX_GUESS_ERROR = 1e-2
MAX_CORRECTION_RATIO = (
    0.1  # largest ratio of a Newton step to the one before it, of interpolated poses
)
# ratio of singular values up to which a matrix is regular and inverted by elimination
MAX_CONDITION = 1e8
# the same ratio for poses that are closed together; else poses follow singly
MAX_BATCH_CONDITION = 1e3
# [extents or rad] size of the last Newton step of poses that are closed together
BATCH_TOLERANCE = 1e-12
MAX_BATCH_STEPS = 5  # largest number of Newton steps of poses that are closed together


class Linkage:
    """A model whose joints `dofs` are driven, with its loops.

    Attributes
    ----------
    dofs, adr : ndarray (drives,) of int
        Indices of the driven joints in ``qvel`` and in ``qpos``.
    sizes : ndarray (nv,)
        Units in which motions of the joints are measured: the extent of the model [m], or 1 rad.
    spans : ndarray (rows + drives,)
        The same for the rows of the active equalities, then for the drives.
    shares : ndarray (rows + drives, nv)
        Quotients `sizes` / `spans`, which scale the Jacobian to lengths in extents.
    inverse : ndarray (nv, rows + drives)
        Result of `invert` for the Jacobian of the last pose that was closed.
    last_stride : tuple of ndarray
        Pose (nq,) and tangent (nv, drives) at the begin of the last stride, and pose at its end.
    rub : ndarray (nv,)
        Forces needed against dry friction, in the direction of the motion [N m or N].
    loaded_bodies : ndarray of int
        Bodies with applied forces, the dead loads of rods, which are constant in a run.
    controls : ndarray (loads,) of int
        Indices of the controls of changing loads in ``ctrl``.
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
        self.stride = MAX_DRIVE_STRIDE * self.sizes[self.dofs]
        spans = list[float]()
        for i in range(model.neq):
            kind = EQ(model.eq_type[i])
            if joints and kind not in (EQ.mjEQ_CONNECT, EQ.mjEQ_JOINT):
                word = f"{kind.name[5:].lower()} {equality_name(model, i)!r}"
                raise Unsupported(
                    f"equality <{word}> with driven joints; connect and joint are covered"
                )
            if data.eq_active[i]:
                spans += self.span(i, kind)
        self.spans = np.array([*spans, *self.sizes[self.dofs]])
        self.shares = self.sizes / self.spans[:, None]
        self.inverse_shares = self.shares.T.copy()
        self.held = (self.units * self.shares[self.spans.size - self.dofs.size :]).copy()
        self.equalities = [
            (i, EQ(model.eq_type[i])) for i in np.flatnonzero(data.eq_active).tolist()
        ]
        self.connects = {
            i: ConnectedPoints(model, data, i)
            for i, kind in self.equalities
            if kind == EQ.mjEQ_CONNECT
        }
        self.has_scalar_joints = (
            model.nq == model.nv
        )  # only hinges and slides, whose values can be added to
        self.last_stride = NO_DRIVE_VALUES, NO_DRIVE_VALUES, NO_DRIVE_VALUES
        self.rub, self.inertia_force = np.zeros(model.nv), np.zeros(model.nv)
        self.loaded_bodies = np.flatnonzero(data.xfrc_applied.any(axis=1))
        self.limited = bool(model.jnt_limited.any() or model.tendon_limited.any())
        self.static_stages = [getattr(mujoco, part) for part in STATIC_STAGES]
        self.has_friction = bool(model.dof_frictionloss.any())

    def span(self, i: int, kind: mujoco.mjtEq) -> list[float]:
        """Units in which the rows of equality number i are measured [m or 1].

        Raises
        ------
        Unsupported
            The equality is of a kind that is not covered.
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
            raise Unsupported(
                f"equality <{kind.name[5:].lower()} {equality_name(self.model, i)!r}>"
            )
        return rows[kind]

    def rubs(self, velocity: Array, fastest: float) -> None:
        """Set dry friction against the motion; joints at rest keep the friction that they had."""
        if not self.has_friction:
            return
        self.rub = np.where(
            np.abs(velocity) > REST_RATE_SHARE * fastest,
            np.sign(velocity) * self.model.dof_frictionloss,
            self.rub,
        )

    def rows(self, inertia: bool = True) -> tuple[Array, Array]:
        """Residual and Jacobian of the active equalities at the present pose.

        With `inertia` False the inertia matrix, on which forces at rest do not depend, is not
        computed: for a chain of 80 links in space it takes twenty times as long as all the rest.
        """
        residual, jacobian = self.present_rows(inertia)
        return residual.copy(), jacobian.copy()

    def present_rows(self, inertia: bool = True) -> tuple[Array, Array]:
        """`rows` as views of MuJoCo's own arrays, which the next pose overwrites."""
        if inertia:
            mujoco.mj_fwdPosition(self.model, self.data)
        else:
            for part in self.static_stages:
                part(self.model, self.data)
        data, count = self.data, self.data.ne  # the rows of equalities come first
        return data.efc_pos[:count], constraint_rows(self.model, data)[:count]

    def move(self, values: Array, tangent: Array | None = None) -> Array:
        """Follow the branch to new values of the drives, in strides; returns the tangent there.

        `values` has the values of the drives, then the controls of changing loads; the columns of
        the tangent (nv, drives + loads) have the same order.  `tangent` is that of the present
        pose; without it the loops are closed first.  A stride that would end in a singular pose,
        where the tangent is uncertain, is joined with the next one.
        """
        drives = self.dofs.size
        values, self.data.ctrl[self.controls] = values[:drives], values[drives:]
        if tangent is None:
            tangent = self.place(self.data.qpos[self.adr])
        tangent = tangent[:, :drives]
        far = values - self.data.qpos[self.adr]
        strides = int(np.ceil(largest(far / self.stride)))
        for part in range(strides)[::-1]:
            target, before = values - far * part / strides, self.data.qpos.copy()
            ahead = self.ahead(target, tangent)
            mujoco.mj_integratePos(self.model, self.data.qpos, ahead, 1.0)
            try:
                there = self.place(target)
                sure = not part or self.max_lever() < SINGULAR_LEVER
            except (BadModel, Unsupported):
                if not part:
                    raise
                sure = False
            if part and not sure:
                self.data.qpos[:] = before
            else:
                self.last_stride = before, tangent, self.data.qpos.copy()
                tangent = there
        return self.tangent_with_loads(tangent)

    def ahead(self, target: Array, tangent: Array) -> Array:
        """Predicted motion (nv,) from the present pose to values of the drives.

        It follows the present tangent.  If the drives move on in the direction of the last stride,
        it follows Hermite's polynomial of third degree through the ends of that stride, unless this
        deviates much from the tangent.
        """
        pose, (before, rates, end) = self.data.qpos, self.last_stride
        way = target - pose[self.adr]
        move = tangent @ way
        if not self.has_scalar_joints or not np.array_equal(pose, end):
            return move
        line = (pose - before)[self.adr]
        share = (way @ line) / (line @ line or np.nan)
        if not (
            0 < share <= MAX_EXTRAPOLATION
            and largest(way - share * line) < MAX_BEND_RATIO * largest(way)
        ):
            return move
        first, last, chord = rates @ line, tangent @ line, pose - before
        cubic = first + last - 2 * chord
        bend = share**2 * (last - chord + cubic) + share**3 * cubic
        if largest(bend) < MAX_BEND_RATIO * largest(move):
            move += bend
        return move

    def path(self, values: Array) -> Iterator[Array]:
        """Yield the tangent at each column of `values` (drives + loads, n), with the model there.

        Raises
        ------
        BadModel, Unsupported
            The path ends; see `move`.
        """
        tangent, drives = None, self.dofs.size
        for first in range(0, values.shape[1], POSES_PER_BLOCK):
            block = values[:, first : first + POSES_PER_BLOCK]
            begin = self.data.qpos.copy(), self.data.ctrl.copy()
            if (found := self.together(block, tangent)) is None:
                self.data.qpos[:], self.data.ctrl[:] = begin
                for one in block.T:
                    tangent = self.move(one, tangent)
                    yield tangent
                continue
            for pose, inverse, controls in zip(*found, block[drives:].T, strict=True):
                self.data.qpos[:], self.data.ctrl[self.controls] = pose, controls
                self.inverse = self.refined(inverse, self.present_rows()[1])
                tangent = self.tangent_with_loads(self.inverse[:, inverse.shape[1] - drives :])
                yield tangent

    def together(self, values: Array, tangent: Array | None) -> tuple[Array, Array] | None:
        """Poses (n, nv) of a regular path, closed together, and an `inverse` near each of them.

        The inverses have shape (n, nv, rows + drives).  The result is None if the poses are as far
        from each other as strides, if one of them is singular or cannot be closed, or if Newton's
        method does not converge at once from an interpolated pose.
        """
        drives = values[: self.dofs.size].T
        distance = np.abs(np.diff(drives, axis=0) / self.stride).max(axis=1, initial=0.0)
        distance = np.append(0.0, np.cumsum(distance))
        knots = [0]
        while knots[-1] < distance.size - 1:
            ahead = int(np.searchsorted(distance, distance[knots[-1]] + 1.0, "right")) - 1
            knots.append(max(ahead, knots[-1] + 1))
        if not self.has_scalar_joints or not 2 <= len(knots) < distance.size / 2:
            return None
        ends, ways = [], []
        try:
            for k in knots:
                tangent = self.move(values[:, k], tangent)
                ends.append(self.data.qpos.copy())
                ways.append(tangent[:, : self.dofs.size])
        except (BadModel, Unsupported):
            return None
        poses = interpolate_poses(drives, np.array(knots), np.array(ends), np.array(ways))
        before = np.full(len(poses), MAX_GUESS_ERROR / MAX_CORRECTION_RATIO)
        for _ in range(MAX_BATCH_STEPS):
            poses[:, self.dofs] = drives
            gaps, jacobians = self.rows_at(poses)
            if (inverses := self.invert_regular(jacobians)) is None:
                return None
            moves = -(inverses[..., : gaps.shape[1]] @ gaps[..., None])[..., 0]
            size = np.abs(moves / self.sizes).max(axis=1)
            if ((size > NEWTON_TOLERANCE) & ~(size < MAX_CORRECTION_RATIO * before)).any():
                return None
            poses, before = poses + moves, size
            if size.max() <= BATCH_TOLERANCE:
                poses[:, self.dofs] = drives
                left = gaps + (jacobians @ moves[..., None])[..., 0]
                open_by = largest(left / self.spans[: gaps.shape[1]])
                return (poses, inverses) if open_by < LOOP_TOLERANCE else None
        return None

    def rows_at(self, poses: Array) -> tuple[Array, Array]:
        """`rows` at poses (n, nv)."""
        count = self.spans.size - self.dofs.size
        residuals = np.empty((len(poses), count))
        jacobians = np.empty((len(poses), count, self.model.nv))
        qpos = self.data.qpos
        for k, pose in enumerate(poses):
            qpos[:] = pose
            residuals[k], jacobians[k] = self.present_rows()
        return residuals, jacobians

    def invert_regular(self, jacobians: Array) -> Array | None:
        """`invert` for many poses (n, nv, rows + drives); None if one is nearly singular."""
        scaled = self.scaled(jacobians)
        if scaled.shape[1] < self.model.nv or not np.isfinite(scaled).all():
            return None
        if (found := self.invert_by_elimination(scaled, MAX_BATCH_CONDITION)) is not None:
            return found
        left, values, right = np.linalg.svd(scaled, full_matrices=False)
        if not (values[:, -1] > values[:, 0] / MAX_BATCH_CONDITION).all():
            return None
        return self.invert_by_svd(left, values, right)

    def refined(self, inverse: Array, jacobian: Array) -> Array:
        """The inverse of a Jacobian, from the inverse at a pose that differs by a Newton step.

        Rates by the old inverse would have an error of that step, up to `BATCH_TOLERANCE`, which is
        larger than the rounding of the pose.  One step of Newton's method on the inverse squares
        the error.
        """
        rows = np.concatenate([jacobian, self.units])
        found: Array = 2.0 * inverse - inverse @ (rows @ inverse)
        return found

    def tangent_with_loads(self, tangent: Array) -> Array:
        """The tangent (nv, drives + loads), with zeros for loads, which do not move a linkage."""
        if not self.controls.size:
            return tangent
        return np.pad(tangent, ((0, 0), (0, self.controls.size)))

    def place(self, values: Array) -> Array:
        """Set the drives to `values`, close the loops, and return the tangent (nv, drives)."""
        self.data.qpos[self.adr] = values
        inverse, far = np.empty((0, 0)), np.inf  # the latter: distance from the inverse's pose
        for _ in range(50):
            residual, jacobian = self.rows()
            if far > MAX_CHORD_DISTANCE:
                inverse, far = self.invert(jacobian), 0.0
            move = inverse[:, : residual.size] @ -residual
            mujoco.mj_integratePos(self.model, self.data.qpos, move, 1.0)
            self.data.qpos[self.adr] = values
            size = largest(move / self.sizes)
            far += size
            if not size * far > PLACE_TOLERANCE:
                break
        jacobian, residual = self.closed(values)
        self.inverse = self.invert(jacobian)
        return self.inverse[:, residual.size :]

    def max_lever(self) -> float:
        """Largest motion [extents or rad] for a constraint violation of an extent, at last pose."""
        return largest(self.inverse / self.inverse_shares)

    def closed(self, values: Array) -> tuple[Array, Array]:
        """Jacobian and residual of the loops with the drives at `values` [rad or m].

        Raises
        ------
        BadModel
            The loops are not closed.
        """
        residual, jacobian = self.rows()
        gaps = residual / self.spans[: residual.size]
        if not largest(gaps) < LOOP_TOLERANCE:
            open_by = loop_violations(self.model, self.data).max(initial=0.0)
            worst = int(np.argmax(np.abs(gaps)))
            raise BadModel(
                f"cannot be assembled at {self.format_drives(values)}: "
                + (
                    f"the loop stays open by {open_by:.3g} m"
                    if open_by > LOOP_TOLERANCE * self.model.stat.extent
                    else "an equality of joints stays violated by "
                    f"{abs(residual[worst]):.3g} rad, or m of slides"
                )
            )
        return jacobian, residual

    def leaves_dof(self) -> bool:
        """Whether the drives leave degrees of freedom in general, not only in a singular pose."""
        pose, free = self.data.qpos.copy(), self.dof()
        if free:
            moves = (
                SINGULAR_POSE_OFFSET
                * np.random.default_rng(0).uniform(-1.0, 1.0, self.model.nv)
                * self.sizes
            )
            mujoco.mj_integratePos(self.model, self.data.qpos, moves, 1.0)
            free = self.dof()
            self.data.qpos[:] = pose
        return bool(free)

    def release(self, pose: Array, rates: Array) -> Array:
        """Take a start with degrees of freedom, of `proofmass.sim.start`; returns a tangent.

        Parameters
        ----------
        pose, rates : ndarray (nq,), (nv,)
            Pose and rates of all joints [SI].

        Returns
        -------
        ndarray (nv, drives)
            Rates of all joints, of least norm, for a unit rate of each drive [SI].

        Raises
        ------
        BadModel
            The loops are open, with driven joints.
        """
        self.data.qpos[:], self.data.qvel[:] = pose, rates
        jacobian = self.closed(pose[self.adr])[0] if self.joints else self.rows()[1]
        rows = np.vstack([self.without_rounding(jacobian), self.units])
        return np.linalg.pinv(rows, rcond=1e-10)[:, len(jacobian) :]

    def check_limits(self) -> None:
        """Raise `BadModel` if a joint or a tendon is beyond its range; needs the pose of `rows`.

        The drives determine every joint, so that no joint can give way at a limit.  The engine's
        own limits are springs, whose forces would enter the holding moments.
        """
        for word, kind in LIMIT_ROW_TYPES.items() if self.limited else ():
            past = (self.data.efc_type == kind) & (self.data.efc_pos < -RANGE_TOLERANCE)
            if past.any():
                name = getattr(self.model, word)(self.data.efc_id[past.argmax()]).name
                raise BadModel(
                    f"{word} {name!r} is beyond its range at "
                    f"{self.format_drives(self.data.qpos[self.adr])}"
                )

    def dof(self) -> int:
        """Degrees of freedom that the drives leave at the present pose."""
        rows = self.scaled(self.rows()[1])
        if not len(rows):  # numpy up to 2.4.0 refuses the rank of an empty matrix
            return int(self.model.nv)
        return int(self.model.nv - np.linalg.matrix_rank(rows, rtol=1e-10))

    def without_rounding(self, jacobian: Array) -> Array:
        """The rows of the loops (rows, nv), zero where they are only rounding."""
        return without_rounding(jacobian, self.shares[: len(jacobian)])

    def scaled(self, jacobian: Array) -> Array:
        """Rows of the loops and, below them, of the drives (..., rows + drives, nv), in extents."""
        rows = jacobian.shape[-2]
        found = np.empty((*jacobian.shape[:-2], *self.shares.shape))
        np.multiply(jacobian, self.shares[:rows], out=found[..., :rows, :])
        found[..., rows:, :] = self.held
        return found

    def invert_by_elimination(self, scaled: Array, max_condition: float) -> Array | None:
        """The inverse in SI of the matrix from `scaled`, by elimination.

        Elimination takes less time than singular values.  The result is None unless the matrix has
        as many rows that are not zero as columns, and if the ratio of its largest to its least
        singular value may exceed `max_condition`.
        """
        rows = np.flatnonzero(scaled.any(axis=(*range(scaled.ndim - 2), -1)))
        if rows.size != self.model.nv:
            return None
        square = scaled if rows.size == scaled.shape[-2] else scaled[..., rows, :]
        try:
            inverse = np.linalg.inv(square)
        except np.linalg.LinAlgError:
            return None
        size, inverse_size = sum_of_squares(square), sum_of_squares(inverse)
        if not largest(size * inverse_size) < max_condition**2:
            return None
        if rows.size == scaled.shape[-2]:
            return np.asarray(inverse * self.inverse_shares)
        found = np.zeros((*scaled.shape[:-2], self.model.nv, scaled.shape[-2]))
        found[..., rows] = inverse * self.inverse_shares[:, rows]
        return found

    def invert_by_svd(self, left: Array, values: Array, right: Array) -> Array:
        """The pseudo-inverse in SI of the matrix from `scaled`, by its singular values."""
        scaled_right = np.swapaxes(right, -1, -2) / values[..., None, :]
        return np.asarray(scaled_right @ np.swapaxes(left, -1, -2) * self.inverse_shares)

    def format_drives(self, values: Array) -> str:
        """The driven joints with their values."""
        return ", ".join(f"{j} = {v:.6g}" for j, v in zip(self.joints, values, strict=True))

    def invert(self, jacobian: Array) -> Array:
        """Pseudo-inverse of the rows of the loops and the drives (nv, rows + drives).

        Its last columns are the motions of all joints for unit motions of the drives.  A planar
        loop has rows that are always zero, so that there is no inverse in the strict sense.
        """
        scaled = self.scaled(jacobian)
        if (found := self.invert_by_elimination(scaled, MAX_CONDITION)) is not None:
            return found
        left, values, right = np.linalg.svd(scaled, full_matrices=False)
        rank = int((values > 1e-10 * values[0]).sum())
        if rank < self.model.nv:
            raise Unsupported(
                f"{self.model.nv - rank} degree(s) of freedom left when "
                f"{self.format_drives(self.data.qpos[self.adr])} is held (singular values "
                f"{values[0]:.2g} to {values[-1]:.2g}): free joints or a singular pose"
            )
        return self.invert_by_svd(left, values, right)

    def acceleration(self, velocity: Array, values: Array) -> Array:
        """Joint accelerations (nv,) that keep the loops closed; needs the pose of `place`."""
        mujoco.mj_fwdVelocity(self.model, self.data)
        drift = [self.row_drift(i, velocity) for i, _ in self.equalities]
        return np.asarray(self.inverse @ np.concatenate([*drift, values]))

    def row_drift(self, i: int, velocity: Array) -> Array:
        """-J' v of equality number i, in the engine's order of rows."""
        if i in self.connects:
            return self.connects[i].drift(velocity)
        model, data = self.model, self.data
        second = model.eq_obj2id[i]
        if second < 0:
            return np.zeros(1)
        dof, adr = model.jnt_dofadr[second], model.jnt_qposadr[second]
        poly = np.polynomial.Polynomial(model.eq_data[i, :5]).deriv(2)
        return np.array([poly(data.qpos[adr] - model.qpos0[adr]) * velocity[dof] ** 2])

    def needed(self) -> Array:
        """Forces (nv,) that the open tree needs on its joints for its rates and accelerations."""
        force = self.held_force()
        # mj_rne would leave out the armatures of joints, tendons and actuators
        mujoco.mj_mulM(self.model, self.data, self.inertia_force, self.data.qacc)
        force += self.inertia_force
        return force

    def held_force(self) -> Array:
        """`needed` without the forces of inertia that are proportional to accelerations."""
        data = self.data
        mujoco.mj_fwdVelocity(self.model, data)
        mujoco.mj_fwdActuation(self.model, data)
        force: Array = data.qfrc_bias - data.qfrc_passive
        force -= data.qfrc_actuator
        if self.has_friction:
            force += self.rub
        if self.loaded_bodies.size:
            force -= self.pushed()
        return force

    def pushed(self) -> Array:
        """Generalized forces (nv,) of the forces on bodies, which are the dead loads of rods."""
        model, data, found = self.model, self.data, np.zeros(self.model.nv)
        loads, places = data.xfrc_applied, data.xipos
        for body in self.loaded_bodies.tolist():
            push, turn = loads[body, :3], loads[body, 3:]
            mujoco.mj_applyFT(model, data, push, turn, places[body], body, found)
        return found

    def loop_forces(self, needed: Array) -> Array:
        """Forces in the rows of the active equalities [N or N m], of the pose last closed."""
        rows = self.inverse.shape[1] - self.dofs.size
        return np.asarray(self.inverse[:, :rows].T @ needed)

    def balance_forces(self, tangent: Array, sensors: bool) -> Array:
        """Moments (or forces) of the drives for the present rates and accelerations (drives,).

        They follow from virtual work.  The engine's ``qfrc_inverse`` at a drive is not the moment
        of the drive, since it leaves out what a closed loop transmits.  With `sensors` the engine's
        force sensors are set to the forces that rigid loops transmit, not its own soft ones.
        """
        model, data, needed = self.model, self.data, self.needed()
        if sensors:
            data.efc_force[:] = 0.0
            data.efc_force[: data.ne] = self.loop_forces(needed)
            mujoco.mj_rnePostConstraint(model, data)
            mujoco.mj_sensorAcc(model, data)
        return needed @ tangent


class ConnectedPoints:
    """Number i of the ``connect`` equalities of a model: two points that coincide.

    Attributes
    ----------
    ends : list of tuple
        For each point the number of its body, live views of the place (3,) and the axes (3, 3) of
        this body [m, 1], the point in it (3,) [m], and an array (3, nv) for the rates of its
        Jacobian [SI].
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, i: int):
        self.model, self.data = model, data
        points = model.eq_data[i, :6].reshape(2, 3)
        if model.eq_objtype[i] == mujoco.mjtObj.mjOBJ_SITE:
            points = model.site_pos[[model.eq_obj1id[i], model.eq_obj2id[i]]]
        self.ends = [
            (b, data.xpos[b], data.xmat[b].reshape(3, 3), point, np.empty((3, model.nv)))
            for b, point in zip(anchor_bodies(model, i), points, strict=True)
        ]

    def drift(self, velocity: Array) -> Array:
        """-J' v of the present pose and rates (3,) [m/s^2]; needs ``mj_fwdVelocity``."""
        for body, place, axes, point, rates in self.ends:
            mujoco.mj_jacDot(self.model, self.data, rates, None, place + axes @ point, body)
        first, second = (rates for *_, rates in self.ends)
        return np.asarray((second - first) @ velocity)


def largest(values: Array) -> float:
    """The largest absolute value, 0 of none; for a few numbers twice as fast as ``max``."""
    found: float = np.maximum.reduce(np.abs(values), axis=None, initial=0.0)
    return found


def sum_of_squares(matrices: np.ndarray) -> Array:
    """The sum of the squares of the numbers of each matrix (..., rows, columns)."""
    numbers = matrices.reshape(*matrices.shape[:-2], -1)
    found: Array = np.vecdot(numbers, numbers)
    return found


def interpolate_poses(drives: Array, knots: Array, poses: Array, tangents: Array) -> Array:
    """Interpolate poses between the known poses at knots, for given values of the drives.

    Parameters
    ----------
    drives : ndarray (n, drives)
        Values of the drives [rad or m].
    knots : ndarray (knots,) of int
        Numbers of the poses that are known, the first and the last among them [1].
    poses : ndarray (knots, nv)
        The known poses [rad or m].
    tangents : ndarray (knots, nv, drives)
        Tangents at the known poses, rad or m for each rad or m [1].

    Returns
    -------
    ndarray (n, nv) [rad or m]
        Hermite's polynomials of third degree on the straight line of the drives from one knot to
        the next.  If the drives leave that line, the tangents of both knots, weighted by the
        distance along the line, give the motion that is added.
    """
    k = np.clip(np.searchsorted(knots, np.arange(len(drives)), "right") - 1, 0, knots.size - 2)
    start, line = drives[knots[k]], drives[knots[k + 1]] - drives[knots[k]]
    square = (line**2).sum(axis=1)
    share = ((drives - start) * line).sum(axis=1) / np.where(square > 0, square, 1.0)
    aside, u = drives - start - share[:, None] * line, share[:, None]
    along = [(tangents[j] @ line[..., None])[..., 0] for j in (k, k + 1)]
    beside = [(tangents[j] @ aside[..., None])[..., 0] for j in (k, k + 1)]
    return np.asarray(
        poses[k]
        + u**2 * (3 - 2 * u) * (poses[k + 1] - poses[k])
        + u * (1 - u) * ((1 - u) * along[0] - u * along[1])
        + (1 - u) * beside[0]
        + u * beside[1]
    )
