"""Static equilibria of a MuJoCo model whose drives leave degrees of freedom.

Springs and weights determine the pose, and so do the joint limits.

**Joint limits** ("stops" in the code) are unilateral constraints.  In equilibrium a stop pushes
only inwards, and only if its joint lies on it.  Each Newton step is a linear complementarity
problem.  It is solved by block pivoting: every joint whose state is wrong is switched; after a few
rounds only the first of these, which cannot cycle while the stiffness is positive definite
(K. G. Murty, Note on a Bard-type scheme for solving the complementarity problem, Opsearch 11 (1974)
123-130).

**Equilibrium.** Let f(q) be the forces that must act on the joints to keep them at rest, A(q) the
rows of the loops, the drives and the active stops, and N the null space of A.  The model is in
equilibrium where

    N' f = 0,    f = A' s     (s: forces in the loops, moments of the drives, pushes of the stops)

Newton's step closes the loops and moves along N with the Hessian of the Lagrangian

    H = N' K N,    K = d/dq (f - A' s)  with s fixed,

which includes the curvature of the loops.  K costs most of the time: it is computed where a stride
begins and where it ends, and in between only while the steps do not shorten fast.  The equilibrium
is stable while H is positive definite.  Along the path of the drives its tangent is
P - N H^-1 N' K P, where P is any motion that moves the drives, keeps the loops closed and the
active stops in place.  A unit increase of a load that exerts the generalized force Q on the joints
moves them by N H^-1 N' Q.
"""

import mujoco
import numpy as np

from proofmass.analytic.friction import (
    MAX_FRICTION_JOINTS,
    NOTHING_SLIPS,
    PathEnds,
    SlipProblem,
    follow_stick_slip,
)
from proofmass.analytic.support import RunKind
from proofmass.base.arrays import Array
from proofmass.sim.mujoco.linkage import LOOP_TOLERANCE, MAX_DRIVE_STRIDE, NEWTON_TOLERANCE, Linkage
from proofmass.sim.mujoco.model import refuse_uncovered
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Run

# share of the largest singular value below which rows are linearly dependent
LOOP_RANK_TOLERANCE = 1e-10
# share of the largest stiffness below which differences cannot tell it from zero
MIN_STIFFNESS_RATIO = 1e-9


class RestEquations:
    """Equations of a step x: ``rows x = -gap``, and ``N' (f + K x) = 0`` with N the null space.

    Parameters
    ----------
    rows, gap : ndarray (rows, nv), (rows,)
        Jacobian of the constraints on the joints [SI], and constraint violation [m or rad].  The
        rows may be linearly dependent.
    force, stiffness : ndarray (nv,), (nv, nv)
        f and K: forces that must act on the joints to keep them at rest [N m or N], and their
        derivative by the joints [SI].

    Attributes
    ----------
    inverse, null : ndarray (nv, rows), (nv, dof)
        Pseudo-inverse of the rows, and N.
    hessian : ndarray (dof, dof)
        N' K N; the equilibrium is stable where it is positive definite.
    """

    def __init__(self, rows: Array, gap: Array, force: Array, stiffness: Array):
        self.rows, self.gap, self.force, self.stiffness = rows, gap, force, stiffness
        left, values, right = np.linalg.svd(rows)
        rank = int((values > LOOP_RANK_TOLERANCE * values.max(initial=0.0)).sum())
        self.inverse = (right[:rank].T / values[:rank]) @ left[:, :rank].T
        self.null = right[rank:].T
        self.hessian = self.null.T @ stiffness @ self.null

    def step(self, descend: bool = False) -> Array:
        """The step x; with `descend` it is reversed along motions of negative stiffness."""
        close = -self.inverse @ self.gap
        return close - self.displacement_under(self.force + self.stiffness @ close, descend)

    def displacement_under(self, force: Array, descend: bool = False) -> Array:
        """Motion N H^-1 N' `force` of the degrees of freedom; with `descend` |H| replaces H."""
        push = self.null.T @ force
        if not descend:
            return np.asarray(self.null @ np.linalg.lstsq(self.hessian, push)[0])
        values, vectors = np.linalg.eigh((self.hessian + self.hessian.T) / 2)
        floor = MIN_STIFFNESS_RATIO * np.abs(self.stiffness).max() or MIN_STIFFNESS_RATIO
        away = vectors.T @ push / np.maximum(np.abs(values), floor)
        return np.asarray(self.null @ vectors @ away)

    def pushes(self, move: Array) -> Array:
        """Forces of the rows after a step."""
        return self.inverse.T @ (self.force + self.stiffness @ move)

    def remaining_violation(self) -> float:
        """Largest constraint violation after a step; not zero where rows contradict each other."""
        return float(np.abs(self.gap - self.rows @ self.inverse @ self.gap).max())

    def least(self) -> float:
        """The least eigenvalue of `hessian` over the largest number in the stiffness matrix [1]."""
        values = np.linalg.eigvalsh((self.hessian + self.hessian.T) / 2)
        return float(values.min(initial=np.inf) / (np.abs(self.stiffness).max() or 1.0))

    def tangent(self, columns: slice) -> Array:
        """Motion of the equilibrium for unit displacements of the rows `columns` (nv, columns)."""
        motions = self.inverse[:, columns]
        return motions - self.displacement_under(self.stiffness @ motions)


BLOCK_ROUNDS = 10  # rounds in which all joints in a wrong state are switched at once
# [rad or extents] rounding of a pose; a joint further beyond a stop has passed it
STOP_TOLERANCE = 1e-12
PULL_TOLERANCE = 1e-12  # share of the largest force: rounding of the reaction of a stop


class LimitedJoints:
    """The joints of a model that have a range and are not `driven`.

    Attributes
    ----------
    dofs, adr : ndarray (stops,) of int
        Indices of the joints in ``qvel`` and in ``qpos``.
    side : ndarray (stops,) of int
        State of each joint: -1 on the low stop, +1 on the high one, 0 between them.
    turns : int
        Largest number of rounds of pivoting in a Newton step.
    """

    def __init__(self, model: mujoco.MjModel, driven: Array, reach: Array):
        joints = np.flatnonzero(model.jnt_limited & ~np.isin(model.jnt_dofadr, driven))
        self.names = [model.joint(j).name for j in joints]
        self.dofs, self.adr = model.jnt_dofadr[joints], model.jnt_qposadr[joints]
        self.low, self.high = model.jnt_range[joints].T
        self.slack = STOP_TOLERANCE * reach[self.dofs]
        self.rows = np.eye(model.nv)[self.dofs]
        self.side = np.zeros(joints.size, int)
        self.turns = BLOCK_ROUNDS + 2 * joints.size

    def beyond(self, place: Array) -> Array:
        """Which stop each joint has passed: -1 the low one, 1 the high one, 0 neither."""
        return (place > self.high + self.slack) * 1 - (place < self.low - self.slack)

    def begin(self, pose: Array) -> None:
        """Constrain every joint that is on a stop or past it."""
        place = pose[self.adr]
        self.side = (place >= self.high - self.slack) * 1 - (place <= self.low + self.slack)

    def held(self, pose: Array) -> tuple[Array, Array]:
        """How far the constrained joints are past their stops [rad or m], and their rows."""
        on = self.side != 0
        bound = np.where(self.side < 0, self.low, self.high)
        return (pose[self.adr] - bound)[on], self.rows[on]

    def switch(self, pose: Array, move: Array, pushes: Array, scale: float, turn: int) -> bool:
        """Release joints that their stops pull, constrain those past a stop; whether any changed.

        Parameters
        ----------
        pose, move : ndarray
            Present values of the joints, and the Newton step [rad or m].
        pushes : ndarray
            Forces of all rows after the step [N or N m]; those of the constrained joints come last.
        scale : float
            The largest force on a joint [N].
        turn : int
            Number of rounds of this step before this one.
        """
        on = self.side != 0
        state = self.beyond(pose[self.adr] + move[self.dofs])
        state[on] = self.side[on]
        pull = self.side[on] * pushes[pushes.size - on.sum() :]
        state[np.flatnonzero(on)[pull > PULL_TOLERANCE * scale]] = 0
        wrong = np.flatnonzero(state != self.side)[: None if turn < BLOCK_ROUNDS else 1]
        self.side[wrong] = state[wrong]
        return bool(wrong.size)

    def format_held(self) -> str:
        """Names of the joints that are constrained to a stop."""
        return ", ".join(self.names[k] for k in np.flatnonzero(self.side))


# step [rad or extents] of central differences, the cube root of rounding: errors of 1e-10
FORCE_DIFFERENCE_STEP = 6e-6
# step [rad or extents] of differences of fourth order, which rates need: errors of 1e-12
FINE_DIFFERENCE_STEP = 5e-4
# share of the largest stiffness: if differences with one and with two step widths differ by more, a
# force has a kink in between
KINK_TOLERANCE = 1e-5
# [rad or extents] a start pose further from equilibrium is refused, since it probably lacks a drive
MAX_START_DISTANCE = 0.5
# Newton steps, by whether the method descends or follows a path
NEWTON_STEP_LIMITS = {False: 15, True: 200}
# ratio of a Newton step to the one before, below which the old stiffness is good enough
FAST_CONVERGENCE_RATIO = 0.1
# [rad or extents] size of the next Newton step at which an equilibrium is found
NEXT_STEP_TOLERANCE = 1e-11
# [rad or m per m] larger ratios of joint motion to loop opening mark a limit position
LIMIT_POSITION_LEVER = 1e3
# error of a tangent's prediction beyond which the pose has jumped: share of the motion, plus an
# amount [rad or extents]
PREDICTION_ERROR_RATIO, SMALL_MOTION = 0.3, 1e-3
# share of the longer of two predictions, by the tangents of both ends of a stride: if they differ
# by more, the pose has snapped through
TANGENT_CHANGE_RATIO = 0.5
MIN_STRIDE_PART = 1e-8  # smallest part of a stride in which a path is followed
FRICTION_ROW = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
UNSTABLE_MESSAGE = "the equilibrium becomes unstable"


def quasi_static_kind(run: Run, free: bool) -> RunKind:
    """The kind of a run without time; `free` is whether drives leave degrees of freedom."""
    if run.kind == "equilibrium":
        return RunKind.EQUILIBRIUM
    if free:
        return RunKind.FREE_SWEEP
    return RunKind.MOVING_SWEEP if run.inertia else RunKind.SWEEP


def linkage_of(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Linkage:
    """The linkage of a run: one that its drives determine, or one in equilibrium.

    With rods the distance of the start pose from equilibrium is not limited, since rods start as
    arcs.

    Raises
    ------
    Unsupported
        The model has a feature that the kind of run does not cover, see
        `proofmass.sim.mujoco.support`; or a joint has dry friction in a sweep with changing loads
        and degrees of freedom left.
    """
    joints, far = (
        tuple(drive.joint for drive in run.drives),
        np.inf if run.rods else MAX_START_DISTANCE,
    )
    loads = tuple(load.actuator for load in run.loads)
    linkage = Linkage(model, data, joints, loads)
    free = linkage.dof()
    refuse_uncovered(model, quasi_static_kind(run, bool(free)), joints)
    if not free:
        return linkage
    if loads and model.dof_frictionloss.any():
        joint = model.joint(model.dof_jntid[int(np.argmax(model.dof_frictionloss > 0))]).name
        raise Unsupported(
            f"the load of actuator {loads[0]!r}, which changes, and frictionloss of joint "
            f"{joint!r} in one sweep with {free} degree(s) of freedom left"
        )
    undriven_friction = model.dof_frictionloss.copy()  # without that of the driven joints
    undriven_friction[linkage.dofs] = 0.0
    rest = (
        RubbingLinkage(model, data, joints, free, far)
        if undriven_friction.any()
        else RestingLinkage(model, data, joints, free, far, loads)
    )
    rest.needs_rates = run.kind == "sweep"
    return rest


class RestNotFound(BadModel):
    """No equilibrium was found near the pose."""


class UnstableRest(BadModel):
    """The path of stable equilibria ends; from there the model falls to another equilibrium."""


class RestingLinkage(Linkage):
    """A linkage in stable equilibrium, with `free` degrees of freedom that its drives leave.

    The start pose is no further from equilibrium than `far` [rad or extents].

    Attributes
    ----------
    shortest : float
        Smallest part of a stride [1]; a path that cannot be followed so far has ended.
    needs_rates : bool
        Whether rates along the path are needed, for which the stiffness is computed more exactly.
    """

    shortest = MIN_STRIDE_PART
    needs_rates = False

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        joints: tuple[str, ...],
        free: int,
        far: float = MAX_START_DISTANCE,
        loads: tuple[str, ...] = (),
    ):
        super().__init__(model, data, joints, loads)
        self.free, self.far = free, far
        slide = model.jnt_type[model.dof_jntid] == mujoco.mjtJoint.mjJNT_SLIDE
        self.reach = np.where(slide, model.stat.extent, 1.0)
        self.adr_of = model.jnt_qposadr[model.dof_jntid]
        self.stops = LimitedJoints(model, self.dofs, self.reach)
        self.stuck, self.stuck_at = np.zeros(0, int), np.zeros(0)  # joints that stick
        # the engine's own limits are soft; rows of the equations constrain the joints instead
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE

    def move(self, values: Array, tangent: Array | None = None) -> Array:
        """Follow the equilibrium to new values of the drives and loads; returns the tangent there.

        Strides are halved where no stable equilibrium lies near the end of the tangent.
        """
        if tangent is None:
            tangent = self.settle()
        begin = np.append(self.data.qpos[self.adr], self.data.ctrl[self.controls])
        way = values - begin
        moved = np.abs(way[: self.dofs.size]) / self.stride
        longest = share = 1.0 / max(1.0, np.ceil(moved.max(initial=0.0)))
        done = 0.0
        while done < 1.0:
            share = min(share, 1.0 - done)
            pose, side = self.data.qpos.copy(), self.stops.side.copy()
            control = self.data.ctrl.copy()
            predicted = tangent @ way * share
            mujoco.mj_integratePos(self.model, self.data.qpos, predicted, 1.0)
            try:
                found = self.follow(begin + (done + share) * way)
                same = np.array_equal(side, self.stops.side)
                if self.has_jumped(pose, predicted, found @ way * share if same else predicted):
                    raise RestNotFound("the pose moved otherwise than its tangent predicts")
                tangent = found
                done, share = done + share, min(2.0 * share, longest)
            except BadModel as error:
                self.data.qpos[:], self.stops.side = pose, side
                self.data.ctrl[:] = control
                share /= 2.0
                if share < self.shortest * longest:
                    raise self.ending(error) from None
        return tangent

    def has_jumped(self, pose: Array, predicted: Array, predicted_back: Array) -> bool:
        """Whether the joints snapped from `pose` to another path of equilibria.

        They did if their motion differs from that `predicted` by the tangent at `pose`, or if the
        tangent at the new pose predicts another motion, `predicted_back`, for the same stride.
        """
        moved = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, moved, 1.0, pose, self.data.qpos)
        error, size = (np.abs(way / self.reach).max() for way in (moved - predicted, predicted))
        predictions = np.array([predicted, predicted_back]) / self.reach
        predictions[:, self.dofs] = 0.0
        difference, longer = (
            np.abs(predictions[1] - predictions[0]).max(),
            np.abs(predictions).max(),
        )
        return bool(
            error > PREDICTION_ERROR_RATIO * size + SMALL_MOTION
            or (difference > TANGENT_CHANGE_RATIO * longer and longer > SMALL_MOTION)
        )

    def together(self, values: Array, tangent: Array | None) -> None:
        """None, since a path of equilibria may end and is followed one pose after the other."""

    def ending(self, error: BadModel) -> BadModel:
        """The error that says why the path of equilibria ends at the present pose."""
        here = self.data.qpos[self.adr]
        self.step(here, descend=False)
        if np.abs(self.balance.inverse).max() > LIMIT_POSITION_LEVER:
            error = BadModel("the loops cannot be closed")
        elif isinstance(error, RestNotFound):
            error = UnstableRest(UNSTABLE_MESSAGE)
        kind = UnstableRest if isinstance(error, UnstableRest) else BadModel
        return kind(f"{error} beyond {self.format_drives(here)}")

    def fall(self, values: Array) -> Array:
        """Descend from the present pose to another equilibrium, with drives and loads at `values`.

        Returns the tangent there.  This finds the equilibrium that the model falls to where its
        path ends, without the overshoot due to inertia, which may lead to another equilibrium if
        there are several.
        """
        return self.follow(values, np.inf, descend=True)

    def follow(self, values: Array, far: float = MAX_DRIVE_STRIDE, descend: bool = False) -> Array:
        """Go to a stable equilibrium no further than `far`; returns its tangent; see `rest`."""
        values, self.data.ctrl[self.controls] = np.split(values, [self.dofs.size])
        tangent = self.rest(values, far, descend)
        if self.balance.least() <= MIN_STIFFNESS_RATIO:
            raise UnstableRest(UNSTABLE_MESSAGE)
        return tangent

    def settle(self) -> Array:
        """Descend from the start pose to equilibrium, with the drives at their present values."""
        here = self.data.qpos[self.adr]
        held = f" when {self.format_drives(here)} is held" if self.joints else ""
        left = f"{self.free} degree(s) of freedom left{held}"
        self.stops.begin(self.data.qpos)
        try:
            tangent = self.rest(here, self.far, descend=True)
        except RestNotFound as error:
            raise Unsupported(f"{left}, and the start pose is not near rest: {error}") from None
        if self.balance.least() < -MIN_STIFFNESS_RATIO:
            raise BadModel(f"the start pose is an unstable equilibrium{held}")
        if self.balance.least() <= MIN_STIFFNESS_RATIO:
            raise Unsupported(f"{left}, and nothing brings them to rest")
        return tangent

    def rest(self, values: Array, far: float, descend: bool = False) -> Array:
        """Find an equilibrium by Newton's method, no further than `far`; returns the tangent.

        With `descend`, steps are reversed along motions of negative stiffness.
        """
        begin, limit, before, size = self.data.qpos.copy(), MAX_DRIVE_STRIDE, 0.0, np.inf
        last, fresh = np.zeros(self.model.nv), True
        for _ in range(NEWTON_STEP_LIMITS[descend]):
            has_converged = size <= NEWTON_TOLERANCE and (
                fresh or size**2 <= NEXT_STEP_TOLERANCE * before
            )
            fresh = has_converged or size > FAST_CONVERGENCE_RATIO * before
            steady, move = self.step(
                values, descend, fresh, fine=has_converged and self.needs_rates
            )
            if has_converged and steady:
                mujoco.mj_integratePos(self.model, self.data.qpos, move, 1.0)
                self.step(values, descend, fresh=False)
                return self.check()
            before, size = size, np.abs(move / self.reach).max()
            limit *= 0.5 if move @ last < 0 else 1.0  # steps alternate across an equilibrium
            last = move * min(1.0, limit / max(size, NEWTON_TOLERANCE))
            mujoco.mj_integratePos(self.model, self.data.qpos, last, 1.0)
            self.near(begin, far)
        raise RestNotFound("no equilibrium was found")

    def near(self, begin: Array, far: float) -> None:
        """Raise `RestNotFound` if a joint has moved from the pose `begin` by more than `far`."""
        moved = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, moved, 1.0, begin, self.data.qpos)
        moved = np.abs(moved / self.reach)
        if not moved.max() <= far:
            joint = self.model.joint(self.model.dof_jntid[moved.argmax()]).name
            raise RestNotFound(f"joint {joint!r} moves by more than {far:g} (rad, or extents)")

    def step(
        self, values: Array, descend: bool, fresh: bool = True, fine: bool = False
    ) -> tuple[bool, Array]:
        """Newton's step with the stops that are active after it, and whether these were before.

        Returns whether the active stops stayed the same, and the step.  Without `fresh` the
        stiffness of the step before is used.
        """
        gap, jacobian = self.rows()
        pose, force = self.data.qpos.copy(), self.force()
        held = np.vstack([jacobian, self.units, np.eye(self.model.nv)[self.stuck]])
        violations = [gap, pose[self.adr] - values, pose[self.adr_of[self.stuck]] - self.stuck_at]
        past, stop_rows = self.stops.held(pose)
        if fresh:
            rows = np.vstack([held, stop_rows])
            pushes = np.linalg.lstsq(rows.T, force, LOOP_RANK_TOLERANCE)[0]
            self.stiffness = self.lagrangian(pushes[: gap.size], fine)
        older = np.flatnonzero(self.stops.side)
        for turn in range(self.stops.turns):
            past, stop_rows = self.stops.held(pose)
            self.balance = RestEquations(
                np.vstack([held, stop_rows]),
                np.concatenate([*violations, past]),
                force,
                self.stiffness,
            )
            if past.size and self.balance.remaining_violation() > LOOP_TOLERANCE:
                if not older.size:
                    raise BadModel(
                        f"the joint limits of {self.stops.format_held()} block the motion"
                    )
                self.stops.side[older[0]], older = 0, older[1:]  # another joint reached its stop
                continue
            move = self.balance.step(descend)
            if not self.stops.switch(
                pose, move, self.balance.pushes(move), np.abs(force).max(), turn
            ):
                break
        self.driven = slice(gap.size, gap.size + values.size)
        return turn == 0, move

    def force(self) -> Array:
        """Forces that keep the joints at rest (nv,) [N m or N]; `rows` must have set the pose."""
        self.data.qvel[:] = 0.0
        return self.held_force()

    def lagrangian(self, pushes: Array, fine: bool = False) -> Array:
        """K: derivative of the forces by the joints (nv, nv) for constant forces in the loops."""
        pose = self.data.qpos.copy()

        def slopes(step: float) -> Array:
            found = []
            for nudge in np.diag(step * self.reach):
                ends = []
                for way in (nudge, -nudge):
                    self.data.qpos[:] = pose
                    mujoco.mj_integratePos(self.model, self.data.qpos, way, 1.0)
                    jacobian = self.present_rows(inertia=False)[1]
                    ends.append(self.force() - jacobian.T @ pushes)
                found.append((ends[0] - ends[1]) / (2 * nudge.sum()))
            return np.array(found).T

        if fine:
            one, two = slopes(FINE_DIFFERENCE_STEP), slopes(2 * FINE_DIFFERENCE_STEP)
            found = (4 * one - two) / 3
            fine = bool(np.abs(one - two).max() <= KINK_TOLERANCE * np.abs(one).max())
        if not fine:
            found = slopes(FORCE_DIFFERENCE_STEP)
        self.data.qpos[:] = pose
        return found

    def check(self) -> Array:
        """The tangent of an equilibrium; raises if loops or stops are open or it is singular."""
        gap = np.abs(self.balance.gap).max(initial=0.0)
        if not gap < LOOP_TOLERANCE * max(1.0, self.model.stat.extent):
            raise BadModel(f"cannot be assembled: a constraint is violated by {gap:.3g} (m or rad)")
        if self.dof() != self.free:
            raise BadModel("the loops are in a singular pose")
        if self.data.ncon:
            raise Unsupported(
                f"{self.data.ncon} contact(s) in a sweep with degrees of freedom left"
            )
        tangent = self.balance.tangent(self.driven)
        if not self.controls.size:
            return tangent
        return np.hstack([tangent, self.balance.displacement_under(self.pushes())])

    def pushes(self) -> Array:
        """Generalized forces of a unit control of each changing load (nv, loads)."""
        model, data, found = self.model, self.data, np.zeros((self.model.nv, self.controls.size))
        control, flags = data.ctrl.copy(), model.opt.disableflags
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
        for k, adr in enumerate(self.controls):
            data.ctrl[:] = 0.0
            data.ctrl[adr] = 1.0
            mujoco.mj_fwdActuation(model, data)
            found[:, k] = data.qfrc_actuator
        model.opt.disableflags = flags
        data.ctrl[:] = control
        mujoco.mj_fwdActuation(model, data)
        return found

    def acceleration(self, velocity: Array, values: Array) -> Array:
        """Zeros (nv,): no channel shows accelerations along a path of equilibria."""
        return np.zeros(self.model.nv)

    def loop_forces(self, needed: Array) -> Array:
        """Forces in the rows of the active equalities at rest, without those of drives or stops."""
        rows = self.driven.start
        return np.asarray((self.balance.inverse.T @ needed)[:rows])


class RubbingLinkage(RestingLinkage):
    """A linkage at rest whose undriven joints have dry friction; its pose depends on its path.

    The bounds of friction are those of the engine's own rows, ``efc_frictionloss``.  These rows are
    soft, so that in the engine a sticking joint creeps; here a joint either sticks or slips, see
    `proofmass.analytic.friction`.  A sweep begins in the equilibrium without friction.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        joints: tuple[str, ...],
        free: int,
        far: float = MAX_START_DISTANCE,
    ):
        super().__init__(model, data, joints, free, far)
        self.rows()
        own = data.efc_type == FRICTION_ROW
        dofs, bounds = data.efc_id[own], data.efc_frictionloss[own].copy()
        left = ~np.isin(dofs, self.dofs)
        self.rubbing, self.bounds = dofs[left], bounds[left]
        if self.rubbing.size > MAX_FRICTION_JOINTS:
            raise Unsupported(
                f"frictionloss of {self.rubbing.size} joints in a sweep with {free} degree(s) of "
                f"freedom left; up to {MAX_FRICTION_JOINTS} are covered"
            )
        self.senses, self.is_at_start = np.zeros(self.rubbing.size), True
        self.slipped = np.zeros(self.rubbing.size, bool)

    def check_slipped(self) -> None:
        """Raise `BadModel` if none of the joints with dry friction slipped in the whole sweep."""
        if not self.slipped.any():
            names = [repr(self.model.joint(self.model.dof_jntid[d]).name) for d in self.rubbing]
            raise BadModel(NOTHING_SLIPS.format(", ".join(names)))

    def move(self, values: Array, tangent: Array | None = None) -> Array:
        """Follow the pose to new values of the drives, with stick and slip; returns the tangent."""
        if tangent is None:
            return super().move(values)
        way = values - self.at()
        parts = max(1, int(np.ceil((np.abs(way) / self.stride).max())))
        for share in np.arange(parts)[::-1]:
            try:
                follow_stick_slip(self, values - way * share / parts)
            except PathEnds as error:
                raise BadModel(str(error)) from None
        return self.balance.tangent(self.driven)

    def rubs(self, velocity: Array, fastest: float) -> None:
        """Set the friction: of driven joints against their motion, of others by stick and slip."""
        super().rubs(velocity, fastest)
        self.rub[self.rubbing] = 0.0
        if not self.is_at_start:
            found = self.problem(self.way).solve_state(self.senses)
            assert found is not None
            self.rub[self.rubbing] = found.friction

    def at(self) -> Array:
        """Values of the drives."""
        return self.data.qpos[self.adr]

    def kept(self) -> tuple[Array, Array]:
        """The present pose and its active stops, for `back`."""
        return self.data.qpos.copy(), self.stops.side.copy()

    def back(self, kept: tuple[Array, Array]) -> None:
        """Return to a pose that `kept` gave."""
        self.data.qpos[:], self.stops.side = kept[0], kept[1].copy()
        self.step(self.at(), descend=False)

    def go(self, values: Array) -> None:
        """Follow the path to values of the drives without a change of stick and slip."""
        try:
            super().move(values, self.balance.tangent(self.driven))
        except BadModel as error:
            raise PathEnds(str(error)) from None

    def problem(self, way: Array) -> SlipProblem:
        """The present equilibrium in coordinates of its free motions, without friction."""
        self.way = way
        jacobian = self.rows()[1]
        _, bars = self.stops.held(self.data.qpos)
        force = self.force() - self.rub
        self.loose = free = RestEquations(
            np.vstack([jacobian, self.units, bars]), np.zeros(0), force, self.stiffness
        )
        first = jacobian.shape[0]
        lead = free.inverse[:, first : first + way.size] @ way
        own = self.rubbing
        return SlipProblem(
            free.null.T @ force,
            free.hessian,
            free.null.T @ (self.stiffness @ lead),
            free.null[own],
            lead[own],
            self.bounds,
        )

    def enter(self, senses: Array) -> None:
        """Let joints of sense 0 stick in their present place, and the others slip."""
        self.senses, self.is_at_start = senses, False
        self.slipped |= senses != 0
        self.stuck = self.rubbing[senses == 0]
        self.stuck_at = self.data.qpos[self.adr_of[self.stuck]]
        self.rub[self.rubbing] = senses * self.bounds
        self.step(self.at(), descend=False)

    def loop_forces(self, needed: Array) -> Array:
        """Forces in the rows of the active equalities, without those of sticking joints."""
        if self.is_at_start:
            return super().loop_forces(needed)
        return np.asarray((self.loose.inverse.T @ needed)[: self.driven.start])
