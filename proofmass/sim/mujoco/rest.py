"""A MuJoCo model with freedoms beside its drives: springs, weights and stops bring it to rest.

With f(q) the forces that must act on the joints to keep them at rest, A(q) the rows of the loops,
the drives and the stops that hold, and N its null space, the model rests where

    N' f = 0,    f = A' s     (s: forces in the loops, moments of the drives, pushes of the stops)

Newton's step closes the loops and goes along N with the Hessian of the Lagrangian

    H = N' K N,    K = d/dq (f - A' s)  with s fixed,

which has the curvature of the loops in it.  K costs most: it is found where a stride begins and
where it ends, in between only while steps do not shorten fast.  The rest is stable while H is
positive definite.  The path that the drives then follow has the tangent P - N H^-1 N' K P, with P
any motion that moves the drives, closes the loops and keeps the stops.
"""

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.mujoco.balance import DEPENDENT, FLAT, Balance
from proofmass.sim.mujoco.linkage import CLOSED, NEAR, STRIDE, Linkage
from proofmass.sim.mujoco.model import refuse_dry_friction
from proofmass.sim.mujoco.stops import Stops
from proofmass.sim.protocol import BadModel, Run, Unsupported

NUDGE = 6e-6  # [rad, or extents] cube root of rounding: central differences to 1e-10, as rates are
FAR = 0.5  # [rad, or extents] a start pose further from rest than this misses a drive
MOST = {False: 15, True: 200}  # Newton steps to follow a rest, and to descend to one
FAST = 0.1  # a step that shortens to this share of the last one needs no new stiffness
EXACT = 1e-11  # [rad, or extents] what the next step may change where a rest is found
LEVER = 1e3  # [rad or m per m] a joint moves so much for a gap only next to a limit position
SHORTEST = 1e-8  # of a stride: a rest that cannot be followed so far is lost
UNSTABLE = "the equilibrium becomes unstable"
REFUSED = {"tendon_limited": "a limited tendon", "actuator_dyntype": "an actuator with a state"}


def linkage_of(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Linkage:
    """What a run follows: a linkage that its drives determine, or one that comes to rest.

    The start poses of rods are arcs, and as far from rest as it takes.

    Raises
    ------
    Unsupported
        A joint or a tendon has dry friction.
    """
    refuse_dry_friction(model, run.kind)
    joints, far = tuple(drive.joint for drive in run.drives), np.inf if run.rods else FAR
    linkage = Linkage(model, data, joints)
    free = linkage.freedoms()
    return Resting(model, data, joints, free, far) if free else linkage


class Lost(BadModel):
    """No rest close by."""


class Resting(Linkage):
    """A linkage with `free` freedoms beside its drives, in stable equilibrium.

    The start pose is no further from it than `far`.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, joints: tuple[str, ...],
                 free: int, far: float = FAR):
        super().__init__(model, data, joints)
        for field, what in REFUSED.items():
            if getattr(model, field).any():
                raise Unsupported(f"{what} in a sweep with {free} freedom(s) left")
        self.free, self.far = free, far
        slide = model.jnt_type[model.dof_jntid] == mujoco.mjtJoint.mjJNT_SLIDE
        self.reach = np.where(slide, model.stat.extent, 1.0)
        self.stops = Stops(model, self.dofs, self.reach)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT  # soft; rows hold the stops
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE

    def move(self, values: Array, tangent: Array | None = None) -> Array:
        """Follow the rest to new values of the drives; returns the tangent there.

        Strides are halved where no stable rest lies close to the end of the tangent.
        """
        if tangent is None:
            tangent = self.settle()
        begin = self.data.qpos[self.adr]
        way = values - begin
        longest = share = 1.0 / max(1.0, np.ceil((np.abs(way) / self.stride).max(initial=0.0)))
        done = 0.0
        while done < 1.0:
            share = min(share, 1.0 - done)
            pose, side = self.data.qpos.copy(), self.stops.side.copy()
            mujoco.mj_integratePos(self.model, self.data.qpos, tangent @ way * share, 1.0)
            try:
                tangent = self.follow(begin + (done + share) * way)
                done, share = done + share, min(2.0 * share, longest)
            except BadModel as error:
                self.data.qpos[:], self.stops.side = pose, side
                share /= 2.0
                if share < SHORTEST * longest:
                    raise BadModel(self.ending(error)) from None
        return tangent

    def ending(self, error: BadModel) -> str:
        """Why the path of rests ends at the present pose."""
        here = self.data.qpos[self.adr]
        self.step(here, descend=False)
        if np.abs(self.balance.inverse).max() > LEVER:
            error = BadModel("the loops cannot be closed")
        elif isinstance(error, Lost):
            error = BadModel(UNSTABLE)
        return f"{error} beyond {self.spoken(here)}"

    def follow(self, values: Array) -> Array:
        """Go to the stable rest next to the present pose; returns its tangent."""
        tangent = self.rest(values, STRIDE)
        if self.balance.least() <= FLAT:
            raise BadModel(UNSTABLE)
        return tangent

    def settle(self) -> Array:
        """Descend from the start pose to rest, with the drives where they are."""
        here = self.data.qpos[self.adr]
        held = f" when {self.spoken(here)} is held" if self.joints else ""
        left = f"{self.free} degree(s) of freedom left{held}"
        self.stops.begin(self.data.qpos)
        try:
            tangent = self.rest(here, self.far, descend=True)
        except Lost as error:
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
            steady, move = self.step(values, descend, fresh)
            if there and steady:
                mujoco.mj_integratePos(self.model, self.data.qpos, move, 1.0)
                self.step(values, descend, fresh=False)
                return self.check()
            before, size = size, np.abs(move / self.reach).max()
            limit *= 0.5 if move @ last < 0 else 1.0  # to and fro across a rest
            last = move * min(1.0, limit / max(size, NEAR))
            mujoco.mj_integratePos(self.model, self.data.qpos, last, 1.0)
            self.near(begin, far)
        raise Lost("no rest was found")

    def near(self, begin: Array, far: float) -> None:
        """Raise where a joint has left its beginning by more than `far`."""
        moved = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, moved, 1.0, begin, self.data.qpos)
        moved = np.abs(moved / self.reach)
        if not moved.max() <= far:
            joint = self.model.joint(self.model.dof_jntid[moved.argmax()]).name
            raise Lost(f"joint {joint!r} moves by more than {far:g} (rad, or extents)")

    def step(self, values: Array, descend: bool, fresh: bool = True) -> tuple[bool, Array]:
        """Newton's step with the stops that hold after it, and whether they held before it.

        Unless it is to be `fresh`, the stiffness of the step before does.
        """
        gap, jacobian = self.rows()
        pose, force = self.data.qpos.copy(), self.force()
        past, bars = self.stops.held(pose)
        if fresh:
            rows = np.vstack([jacobian, self.units, bars])
            pushes = np.linalg.lstsq(rows.T, force, DEPENDENT)[0]
            self.stiffness = self.lagrangian(pushes[: gap.size])
        for turn in range(self.stops.turns):
            past, bars = self.stops.held(pose)
            self.balance = Balance(np.vstack([jacobian, self.units, bars]),
                                   np.concatenate([gap, pose[self.adr] - values, past]),
                                   force, self.stiffness)
            if past.size and self.balance.left_open() > CLOSED:
                raise BadModel(f"the stops of {self.stops.spoken()} are in the way")
            move = self.balance.step(descend)
            if not self.stops.switch(pose, move, self.balance.pushes(move), np.abs(force).max(),
                                     turn):
                break
        self.driven = slice(gap.size, gap.size + values.size)
        return turn == 0, move

    def force(self) -> Array:
        """What must act on the joints to keep them at rest (nv,); needs the pose of `rows`."""
        self.data.qvel[:] = 0
        mujoco.mj_fwdVelocity(self.model, self.data)
        mujoco.mj_fwdActuation(self.model, self.data)
        return self.data.qfrc_bias - self.data.qfrc_passive - self.data.qfrc_actuator

    def lagrangian(self, pushes: Array) -> Array:
        """K: how the forces change with the joints (nv, nv) while the loops keep their pushes."""
        pose, slopes = self.data.qpos.copy(), []
        for nudge in np.diag(NUDGE * self.reach):
            ends = []
            for way in (nudge, -nudge):
                self.data.qpos[:] = pose
                mujoco.mj_integratePos(self.model, self.data.qpos, way, 1.0)
                jacobian = self.rows()[1]
                ends.append(self.force() - jacobian.T @ pushes)
            slopes.append((ends[0] - ends[1]) / (2 * nudge.sum()))
        self.data.qpos[:] = pose
        return np.array(slopes).T

    def check(self) -> Array:
        """The tangent of a rest whose loops and stops are closed, and which is not singular."""
        gap = np.abs(self.balance.gap).max(initial=0.0)
        if not gap < CLOSED * max(1.0, self.model.stat.extent):
            raise BadModel(f"cannot be assembled: something stays open by {gap:.3g} (m or rad)")
        if self.freedoms() != self.free:
            raise BadModel("the loops are in a singular pose")
        if self.data.ncon:
            raise Unsupported(f"{self.data.ncon} contact(s) in a sweep with freedoms left")
        return self.balance.tangent(self.driven)

    def acceleration(self, velocity: Array, values: Array) -> Array:
        """None: a path of rests has no accelerations, and no channel may show them."""
        return np.zeros(self.model.nv)
