"""A MuJoCo model with degrees of freedom beside its drives: springs, weights and stops at rest.

**Stops** are joint ranges, unilateral. At rest a stop pushes only inwards, and only where its joint
lies on it.  The linear problem of each Newton step is a linear complementarity problem, solved by
block pivoting: switch every joint whose state is wrong; after a few rounds only the first of them,
which cannot cycle while the stiffness is positive definite (K. G. Murty, Note on a Bard-type scheme
for solving the complementarity problem, Opsearch 11 (1974) 123-130).

**Equilibrium.** With f(q) the forces that must act on the joints to keep them at rest, A(q) the
rows of the loops, the drives and the stops that hold, and N its null space, the model rests where

    N' f = 0,    f = A' s     (s: forces in the loops, moments of the drives, pushes of the stops)

Newton's step closes the loops and goes along N with the Hessian of the Lagrangian

    H = N' K N,    K = d/dq (f - A' s)  with s fixed,

which has the curvature of the loops in it.  K costs most: it is found where a stride begins and
where it ends, in between only while steps do not shorten fast.  The rest is stable while H is
positive definite.  The path that the drives then follow has the tangent P - N H^-1 N' K P, with P
any motion that moves the drives, closes the loops and keeps the stops.  A load that grows by one
and does Q to the joints moves them by N H^-1 N' Q.
"""

import mujoco
import numpy as np

from proofmass.analytic.friction import HOLDS_ALL, MOST_JOINTS, PathEnds, SlipProblem, advance
from proofmass.analytic.numerics import Array
from proofmass.sim.mujoco.linkage import CLOSED, NEAR, STRIDE, Linkage
from proofmass.sim.mujoco.model import refuse_dry_friction
from proofmass.sim.protocol import BadModel, Run, Unsupported

DEPENDENT = 1e-10  # of the largest singular value: rows that say nothing new, to rounding
FLAT = 1e-9  # of the largest stiffness: less cannot be distinguished from none by differences


class RestEquations:
    """Ways x with ``rows x = -gap`` and, along the null space N of the rows, ``N' (f + K x) = 0``.

    Parameters
    ----------
    rows, gap : ndarray (rows, nv), (rows,)
        What holds the joints [SI], and how far it is open [m or rad]; rows may depend on each
        other.
    force, stiffness : ndarray (nv,), (nv, nv)
        f and K: what must act on the joints to keep them at rest [N m or N], and how it changes
        with them [SI].

    Attributes
    ----------
    inverse, null : ndarray (nv, rows), (nv, dof)
        Pseudo-inverse of the rows, and N.
    hessian : ndarray (dof, dof)
        N' K N: what their rest is stable by, when it is positive definite.
    """

    def __init__(self, rows: Array, gap: Array, force: Array, stiffness: Array):
        self.rows, self.gap, self.force, self.stiffness = rows, gap, force, stiffness
        left, values, right = np.linalg.svd(rows)
        rank = int((values > DEPENDENT * values.max(initial=0.0)).sum())
        self.inverse = (right[:rank].T / values[:rank]) @ left[:, :rank].T
        self.null = right[rank:].T
        self.hessian = self.null.T @ stiffness @ self.null

    def step(self, descend: bool = False) -> Array:
        """The joints' way x; to `descend` it turns back where the stiffness is negative."""
        close = -self.inverse @ self.gap
        return close - self.yielding(self.force + self.stiffness @ close, descend)

    def yielding(self, force: Array, descend: bool = False) -> Array:
        """How the degrees of freedom yield to forces on the joints."""
        push = self.null.T @ force
        if not descend:
            return np.asarray(self.null @ np.linalg.lstsq(self.hessian, push)[0])
        values, vectors = np.linalg.eigh((self.hessian + self.hessian.T) / 2)
        floor = FLAT * np.abs(self.stiffness).max() or FLAT
        away = vectors.T @ push / np.maximum(np.abs(values), floor)
        return np.asarray(self.null @ vectors @ away)

    def pushes(self, move: Array) -> Array:
        """What the rows push with after a step."""
        return self.inverse.T @ (self.force + self.stiffness @ move)

    def left_open(self) -> float:
        """How far a step leaves the rows open: rows that contradict each other."""
        return float(np.abs(self.gap - self.rows @ self.inverse @ self.gap).max())

    def least(self) -> float:
        """The least stiffness of the degrees of freedom, as a share of the joints' largest."""
        values = np.linalg.eigvalsh((self.hessian + self.hessian.T) / 2)
        return float(values.min(initial=np.inf) / (np.abs(self.stiffness).max() or 1.0))

    def tangent(self, columns: slice) -> Array:
        """How the rest moves when the rows of those numbers do (nv, columns)."""
        motions = self.inverse[:, columns]
        return motions - self.yielding(self.stiffness @ motions)


COVERED = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
BLOCKS = 10  # rounds in which all wrong joints switch at once
TOUCHES = 1e-12  # [rad, or extents] rounding of a pose; beyond it a joint is past its stop
PULLS = 1e-12  # of the largest force: rounding of a reaction


class LimitedJoints:
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
                raise Unsupported(
                    f"range of joint {model.joint(j).name!r} in a sweep with degrees of freedom"
                    " left; ranges of hinges and slides are covered"
                )
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
            Where the joints are, and the step that is asked for [rad or m].
        pushes : ndarray
            What all rows would push with after it [N or N m]; those of the held joints are the
            last.
        scale : float
            The largest force there is [N].
        turn : int
            How often this step was asked for before.
        """
        on = self.side != 0
        state = self.beyond(pose[self.adr] + move[self.dofs])
        state[on] = self.side[on]
        pull = self.side[on] * pushes[pushes.size - on.sum() :]
        state[np.flatnonzero(on)[pull > PULLS * scale]] = 0
        wrong = np.flatnonzero(state != self.side)[: None if turn < BLOCKS else 1]
        self.side[wrong] = state[wrong]
        return bool(wrong.size)

    def format_held(self) -> str:
        """The joints that are held."""
        return ", ".join(self.names[k] for k in np.flatnonzero(self.side))


NUDGE = 6e-6  # [rad, or extents] cube root of rounding: central differences to 1e-10
WIDER = 5e-4  # [rad, or extents] of differences of fourth order, to 1e-12, as rates are
KINKED = 1e-5  # of the largest stiffness: over twice that it differs by more where a force kinks
FAR = 0.5  # [rad, or extents] a start pose further from rest than this misses a drive
MOST = {False: 15, True: 200}  # Newton steps to follow a rest, and to descend to one
FAST = 0.1  # a step that shortens to this share of the last one needs no new stiffness
EXACT = 1e-11  # [rad, or extents] what the next step may change where a rest is found
LEVER = 1e3  # [rad or m per m] a joint moves so much for a gap only next to a limit position
OFF, BRIEF = 0.3, 1e-3  # of what a tangent promises, and [rad, or extents] beside that
TURNED = 0.5  # of the longer one: promises ahead and back differ by more across a snap
SHORTEST = 1e-8  # of a stride, for `Resting.shortest`
FRICTION = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
UNSTABLE = "the equilibrium becomes unstable"
REFUSED = {"tendon_limited": "a limited tendon", "actuator_dyntype": "an actuator with a state"}


def linkage_of(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Linkage:
    """What a run follows: a linkage that its drives determine, or one that comes to rest.

    The start poses of rods are arcs, and as far from rest as it takes.

    Raises
    ------
    Unsupported
        A tendon has dry friction, or a joint in equilibrium.
    """
    refuse_dry_friction(model, run.kind)
    joints, far = tuple(drive.joint for drive in run.drives), np.inf if run.rods else FAR
    loads = tuple(load.actuator for load in run.loads)
    linkage = Linkage(model, data, joints, loads)
    free = linkage.dof()
    if not free:
        return linkage
    if loads and model.dof_frictionloss.any():
        joint = model.joint(model.dof_jntid[int(np.argmax(model.dof_frictionloss > 0))]).name
        raise Unsupported(
            f"the load of actuator {loads[0]!r}, which changes, and frictionloss of joint "
            f"{joint!r} in one sweep with {free} degree(s) of freedom left"
        )
    loose = model.dof_frictionloss.copy()  # of joints that the drives leave
    loose[linkage.dofs] = 0.0
    rest = (
        RubbingLinkage(model, data, joints, free, far)
        if loose.any()
        else RestingLinkage(model, data, joints, free, far, loads)
    )
    rest.rated = run.kind == "sweep"
    return rest


class RestNotFound(BadModel):
    """No rest close by."""


class UnstableRest(BadModel):
    """The path of stable rests ends: from there the model falls to another one."""


class RestingLinkage(Linkage):
    """A linkage with `free` degrees of freedom beside its drives, in stable equilibrium.

    The start pose is no further from it than `far`.

    Attributes
    ----------
    shortest : float
        Share of a stride [1]: a rest that cannot be followed so far fails.
    rated : bool
        Whether rates of the path are asked for, which takes a finer stiffness.
    """

    shortest = SHORTEST
    rated = False

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        joints: tuple[str, ...],
        free: int,
        far: float = FAR,
        loads: tuple[str, ...] = (),
    ):
        super().__init__(model, data, joints, loads)
        for field, what in REFUSED.items():
            if getattr(model, field).any():
                raise Unsupported(f"{what} in a sweep with {free} degree(s) of freedom left")
        self.free, self.far = free, far
        slide = model.jnt_type[model.dof_jntid] == mujoco.mjtJoint.mjJNT_SLIDE
        self.reach = np.where(slide, model.stat.extent, 1.0)
        self.adr_of = model.jnt_qposadr[model.dof_jntid]
        self.stops = LimitedJoints(model, self.dofs, self.reach)
        self.stuck, self.stuck_at = np.zeros(0, int), np.zeros(0)  # joints held by dry friction
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT  # soft; rows hold the stops
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE

    def move(self, values: Array, tangent: Array | None = None) -> Array:
        """Follow the rest to new values of the drives and loads; returns the tangent there.

        Strides are halved where no stable rest lies close to the end of the tangent.
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
            promised = tangent @ way * share
            mujoco.mj_integratePos(self.model, self.data.qpos, promised, 1.0)
            try:
                found = self.follow(begin + (done + share) * way)
                same = np.array_equal(side, self.stops.side)
                if self.jumped(pose, promised, found @ way * share if same else promised):
                    raise RestNotFound("it moved as its tangent did not promise")
                tangent = found
                done, share = done + share, min(2.0 * share, longest)
            except BadModel as error:
                self.data.qpos[:], self.stops.side = pose, side
                self.data.ctrl[:] = control
                share /= 2.0
                if share < self.shortest * longest:
                    raise self.ending(error) from None
        return tangent

    def jumped(self, pose: Array, promised: Array, behind: Array) -> bool:
        """Whether joints moved from a pose over a snap to another path.

        They moved as was not promised, or the tangent here promises another way, `behind`, from
        there.
        """
        moved = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, moved, 1.0, pose, self.data.qpos)
        off, size = (np.abs(way / self.reach).max() for way in (moved - promised, promised))
        ways = np.array([promised, behind]) / self.reach
        ways[:, self.dofs] = 0.0
        apart, longer = np.abs(ways[1] - ways[0]).max(), np.abs(ways).max()
        return bool(off > OFF * size + BRIEF or (apart > TURNED * longer and longer > BRIEF))

    def together(self, values: Array, tangent: Array | None) -> None:
        """None: a rest is followed one pose after the other, since it may end."""

    def ending(self, error: BadModel) -> BadModel:
        """Why the path of rests ends at the present pose."""
        here = self.data.qpos[self.adr]
        self.step(here, descend=False)
        if np.abs(self.balance.inverse).max() > LEVER:
            error = BadModel("the loops cannot be closed")
        elif isinstance(error, RestNotFound):
            error = UnstableRest(UNSTABLE)
        kind = UnstableRest if isinstance(error, UnstableRest) else BadModel
        return kind(f"{error} beyond {self.format_drives(here)}")

    def fall(self, values: Array) -> Array:
        """Descend from the present pose to another rest, with drives and loads at `values`.

        Returns the tangent there.  The model falls so from where its path of rests ends, without
        the swing that inertia would give it: of several rests below, that may choose another one.
        """
        values, self.data.ctrl[self.controls] = np.split(values, [self.dofs.size])
        tangent = self.rest(values, np.inf, descend=True)
        if self.balance.least() <= FLAT:
            raise UnstableRest(UNSTABLE)
        return tangent

    def follow(self, values: Array) -> Array:
        """Go to the stable rest next to the present pose; returns its tangent."""
        values, self.data.ctrl[self.controls] = np.split(values, [self.dofs.size])
        tangent = self.rest(values, STRIDE)
        if self.balance.least() <= FLAT:
            raise UnstableRest(UNSTABLE)
        return tangent

    def settle(self) -> Array:
        """Descend from the start pose to rest, with the drives where they are."""
        here = self.data.qpos[self.adr]
        held = f" when {self.format_drives(here)} is held" if self.joints else ""
        left = f"{self.free} degree(s) of freedom left{held}"
        self.stops.begin(self.data.qpos)
        try:
            tangent = self.rest(here, self.far, descend=True)
        except RestNotFound as error:
            raise Unsupported(f"{left}, and the start pose is not near rest: {error}") from None
        if self.balance.least() < -FLAT:
            raise BadModel(f"the start pose is an unstable equilibrium{held}")
        if self.balance.least() <= FLAT:
            raise Unsupported(f"{left}, and nothing brings them to rest")
        return tangent

    def rest(self, values: Array, far: float, descend: bool = False) -> Array:
        """Newton's method from the present pose, no further than `far`; returns the tangent.

        To `descend`, it turns back where the stiffness is negative.
        """
        begin, limit, before, size = self.data.qpos.copy(), STRIDE, 0.0, np.inf
        last, fresh = np.zeros(self.model.nv), True
        for _ in range(MOST[descend]):
            there = size <= NEAR and (fresh or size**2 <= EXACT * before)
            fresh = there or size > FAST * before
            steady, move = self.step(values, descend, fresh, fine=there and self.rated)
            if there and steady:
                mujoco.mj_integratePos(self.model, self.data.qpos, move, 1.0)
                self.step(values, descend, fresh=False)
                return self.check()
            before, size = size, np.abs(move / self.reach).max()
            limit *= 0.5 if move @ last < 0 else 1.0  # to and fro across a rest
            last = move * min(1.0, limit / max(size, NEAR))
            mujoco.mj_integratePos(self.model, self.data.qpos, last, 1.0)
            self.near(begin, far)
        raise RestNotFound("no rest was found")

    def near(self, begin: Array, far: float) -> None:
        """Raise where a joint has left its beginning by more than `far`."""
        moved = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, moved, 1.0, begin, self.data.qpos)
        moved = np.abs(moved / self.reach)
        if not moved.max() <= far:
            joint = self.model.joint(self.model.dof_jntid[moved.argmax()]).name
            raise RestNotFound(f"joint {joint!r} moves by more than {far:g} (rad, or extents)")

    def step(
        self, values: Array, descend: bool, fresh: bool = True, fine: bool = False
    ) -> tuple[bool, Array]:
        """Newton's step with the stops that hold after it, and whether they held before it.

        Unless it is to be `fresh`, the stiffness of the step before does.
        """
        gap, jacobian = self.rows()
        pose, force = self.data.qpos.copy(), self.force()
        held = np.vstack([jacobian, self.units, np.eye(self.model.nv)[self.stuck]])
        off = [gap, pose[self.adr] - values, pose[self.adr_of[self.stuck]] - self.stuck_at]
        past, bars = self.stops.held(pose)
        if fresh:
            rows = np.vstack([held, bars])
            pushes = np.linalg.lstsq(rows.T, force, DEPENDENT)[0]
            self.stiffness = self.lagrangian(pushes[: gap.size], fine)
        older = np.flatnonzero(self.stops.side)
        for turn in range(self.stops.turns):
            past, bars = self.stops.held(pose)
            self.balance = RestEquations(
                np.vstack([held, bars]),
                np.concatenate([*off, past]),
                force,
                self.stiffness,
            )
            if past.size and self.balance.left_open() > CLOSED:
                if not older.size:
                    raise BadModel(f"the stops of {self.stops.format_held()} are in the way")
                self.stops.side[older[0]], older = 0, older[1:]  # another joint came to its stop
                continue
            move = self.balance.step(descend)
            if not self.stops.switch(
                pose, move, self.balance.pushes(move), np.abs(force).max(), turn
            ):
                break
        self.driven = slice(gap.size, gap.size + values.size)
        return turn == 0, move

    def force(self) -> Array:
        """What must act on the joints to keep them at rest (nv,); needs the pose of `rows`."""
        self.data.qvel[:] = 0
        mujoco.mj_fwdVelocity(self.model, self.data)
        mujoco.mj_fwdActuation(self.model, self.data)
        data = self.data
        held = data.qfrc_bias + self.rub - data.qfrc_passive - data.qfrc_actuator
        return np.asarray(held - self.pushed())

    def lagrangian(self, pushes: Array, fine: bool = False) -> Array:
        """K: how the forces change with the joints (nv, nv) while the loops keep their pushes."""
        pose = self.data.qpos.copy()

        def slopes(step: float) -> Array:
            found = []
            for nudge in np.diag(step * self.reach):
                ends = []
                for way in (nudge, -nudge):
                    self.data.qpos[:] = pose
                    mujoco.mj_integratePos(self.model, self.data.qpos, way, 1.0)
                    jacobian = self.rows(inertia=False)[1]
                    ends.append(self.force() - jacobian.T @ pushes)
                found.append((ends[0] - ends[1]) / (2 * nudge.sum()))
            return np.array(found).T

        if fine:
            one, two = slopes(WIDER), slopes(2 * WIDER)
            found = (4 * one - two) / 3
            fine = bool(np.abs(one - two).max() <= KINKED * np.abs(one).max())
        if not fine:
            found = slopes(NUDGE)
        self.data.qpos[:] = pose
        return found

    def check(self) -> Array:
        """The tangent of a rest whose loops and stops are closed, and which is not singular."""
        gap = np.abs(self.balance.gap).max(initial=0.0)
        if not gap < CLOSED * max(1.0, self.model.stat.extent):
            raise BadModel(f"cannot be assembled: something stays open by {gap:.3g} (m or rad)")
        if self.dof() != self.free:
            raise BadModel("the loops are in a singular pose")
        if self.data.ncon:
            raise Unsupported(
                f"{self.data.ncon} contact(s) in a sweep with degrees of freedom left"
            )
        yields = self.balance.yielding(self.pushes())
        return np.hstack([self.balance.tangent(self.driven), yields])

    def pushes(self) -> Array:
        """What a unit of the control of each load that changes does to the joints (nv, loads)."""
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
        """None: a path of rests has no accelerations, and no channel may show them."""
        return np.zeros(self.model.nv)

    def loop_forces(self, needed: Array) -> Array:
        """Forces in the rows of the active equalities at rest, beside drives and stops."""
        rows = self.driven.start
        return np.asarray((self.balance.inverse.T @ needed)[:rows])


class RubbingLinkage(RestingLinkage):
    """A linkage at rest whose free joints have dry friction: it depends on how it came there.

    The bounds are those of the engine's own rows of friction, ``efc_frictionloss``.  The engine
    lets a joint creep that it holds, since these rows are soft; here a joint sticks or slips, see
    `proofmass.analytic.friction`.  A sweep begins at rest without friction.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        joints: tuple[str, ...],
        free: int,
        far: float = FAR,
    ):
        super().__init__(model, data, joints, free, far)
        self.rows()
        own = data.efc_type == FRICTION
        dofs, bounds = data.efc_id[own], data.efc_frictionloss[own].copy()
        left = ~np.isin(dofs, self.dofs)
        self.rubbing, self.bounds = dofs[left], bounds[left]
        if self.rubbing.size > MOST_JOINTS:
            raise Unsupported(
                f"frictionloss of {self.rubbing.size} joints in a sweep with {free} degree(s) of "
                f"freedom left; up to {MOST_JOINTS} are covered"
            )
        self.senses, self.begins = np.zeros(self.rubbing.size), True
        self.slipped = np.zeros(self.rubbing.size, bool)

    def check_slipped(self) -> None:
        """Raise `BadModel` if dry friction held all joints that the drives leave."""
        if not self.slipped.any():
            names = [repr(self.model.joint(self.model.dof_jntid[d]).name) for d in self.rubbing]
            raise BadModel(HOLDS_ALL.format(", ".join(names)))

    def move(self, values: Array, tangent: Array | None = None) -> Array:
        """Follow the rest to new values of the drives, sticking and slipping; its tangent there."""
        if tangent is None:
            return super().move(values)
        way = values - self.at()
        parts = max(1, int(np.ceil((np.abs(way) / self.stride).max())))
        for share in np.arange(parts)[::-1]:
            try:
                advance(self, values - way * share / parts)
            except PathEnds as error:
                raise BadModel(str(error)) from None
        return self.balance.tangent(self.driven)

    def rubs(self, velocity: Array, fastest: float) -> None:
        """Let driven joints rub against their motion, and the others as they stick or slip."""
        super().rubs(velocity, fastest)
        if not self.begins:
            found = self.problem(self.way).goes(self.senses)
            assert found is not None
            self.rub[self.rubbing] = found.friction

    def at(self) -> Array:
        """Values of the drives."""
        return self.data.qpos[self.adr]

    def kept(self) -> tuple[Array, Array]:
        """The pose, and what stops it is on."""
        return self.data.qpos.copy(), self.stops.side.copy()

    def back(self, kept: tuple[Array, Array]) -> None:
        """Come back to a pose."""
        self.data.qpos[:], self.stops.side = kept[0], kept[1].copy()
        self.step(self.at(), descend=False)

    def go(self, values: Array) -> None:
        """Follow the rest to values of the drives in the present state."""
        try:
            super().move(values, self.balance.tangent(self.driven))
        except BadModel as error:
            raise PathEnds(str(error)) from None

    def problem(self, way: Array) -> SlipProblem:
        """The present rest in coordinates of its free motions, without its friction."""
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
        """Let joints stick where they are, or slip."""
        self.senses, self.begins = senses, False
        self.slipped |= senses != 0
        self.stuck = self.rubbing[senses == 0]
        self.stuck_at = self.data.qpos[self.adr_of[self.stuck]]
        self.rub[self.rubbing] = senses * self.bounds
        self.step(self.at(), descend=False)

    def loop_forces(self, needed: Array) -> Array:
        """Forces in the rows of the active equalities, beside what friction holds."""
        if self.begins:
            return super().loop_forces(needed)
        return np.asarray((self.loose.inverse.T @ needed)[: self.driven.start])
