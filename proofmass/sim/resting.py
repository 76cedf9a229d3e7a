"""A mechanism of plain data for runs that come to rest: sweeps, and static equilibria.

An engine that only steps in time finds a rest by steps with the drives held and with drag on the
links, see `proofmass.sim.interpreter.mechanism.WayToRest`.  Neither inertia nor drag changes a
rest, but both change the way to it.  Every link has therefore the same inertia, so large that the
fastest oscillation of the mechanism on its springs has `FASTEST_PHASE` in a step, and the drag is
critical for the slowest one.  Weights are loads, since masses are not those of the model::

    K v = w^2 M v     K: stiffness of springs, weights and loads in the start pose
                      M: mass matrix of links with I = 1 kg m^2 and m = I / size^2
    I = (w_max h / FASTEST_PHASE)^2,   drag = 2 w_min,   both scaled with M

From sample to sample the drives move smoothly in a period of the slowest oscillation.
"""

import copy
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from proofmass.analytic.support import RunKind, Support
from proofmass.base.arrays import Array
from proofmass.sim.dense import mass_matrix
from proofmass.sim.interpreter.mechanism import (
    DriveRows,
    NeutralJoint,
    NeutralLoad,
    NeutralMechanism,
    WayToRest,
)
from proofmass.sim.neutral import SUPPORT, NeutralReader, read_model
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.sim.smooth import SmoothTerms
from proofmass.sim.start import start_state

FASTEST_PHASE = 0.7
"""Phase of the fastest oscillation in a step [rad].  A semi-implicit step is stable up to 2; the
stiffness grows along a sweep, and loops and loads add to that of the start pose."""
PERIODS_PER_MOVE = 1.0
"""Periods of the slowest oscillation from sample to sample: the mechanism follows its drives."""
PERIODS_WITH_FRICTION = 10.0
"""The same with dry friction.  A pose then depends on the way to it: what inertia and drag of a
move add to the loads of joints that should stick lets them slip too early."""
MIN_STEPS_PER_MOVE = 8
"""Steps from sample to sample if nothing oscillates."""
MAX_FALL = 0.02
"""Way of a joint in a step in which the stop that it is pressed on does not act, or in which its
friction would move it alone [rad or m]: many engines have stops that act only on a joint beyond
them."""
ON_STOP = 1e-9
"""Distance from the end of its range at which a joint lies on its stop [rad or m], and acceleration
that is rounding, as a share of the largest."""
MIN_SQUARE_SHARE = 1e-6
"""Share of the largest stiffness over inertia that counts as the smallest: softer motions settle
more slowly."""
STILL_SHARE, SLOW_SHARE = 1e-11, 1e-4
"""Speeds at rest, and of a mechanism that does not become slower, in sizes over the time of the
slowest oscillation: shares of the size by which the pose may still change."""
CHECKS_PER_PERIOD = 8
"""Checks of the speed in a period of the slowest oscillation."""
MAX_PERIODS = 200
"""Periods of the slowest oscillation after which a sample is given up: at critical drag a motion
decays by 500 in each."""
HALF_STEPS_PER_STEP = 2
"""Half steps of the step in which the drives stand still at a sample."""
MAX_START_PUSH = 1e-6
"""Force at the start of a sweep with dry friction, as a share of the largest friction, below which
the start is a rest without friction: the poses of the sweep are off by such a share."""
SMALL_MOVE = 1e-6
"""Motion of a joint for differences of forces [rad], or in sizes of the mechanism [m]."""
REDUNDANT_SHARE = 1e-10
"""Share of the largest singular value below which rows of constraints are dependent."""


class RestReader(NeutralReader):
    """A compiled model in the start of a sweep or of an equilibrium; see `NeutralReader`."""

    def steps(self) -> tuple[int, float]:
        """The number of steps from sample to sample, and their length [s].

        `inertia` [kg m^2] of the links and the slowest frequency `slow` [rad/s] follow from it.
        """
        if self.run.kind == "equilibrium":
            self.samples = 1
        step, (fastest, slowest) = self.asked_step, self.oscillations()
        stiff = fastest * (step / FASTEST_PHASE) ** 2
        push = max(self.push_on_stops(), float(self.frictions.max(initial=0.0)))
        self.inertia = max(stiff, push * step**2 / MAX_FALL)
        if not self.free_motions.size:  # nothing oscillates, whatever the inertia
            slowest = self.inertia * (FASTEST_PHASE / step) ** 2
        self.slow = float(np.sqrt(slowest / self.inertia))
        self.period = 2.0 * np.pi / (self.slow * step)  # in steps
        periods = PERIODS_WITH_FRICTION if self.frictions.any() else PERIODS_PER_MOVE
        moves = int(np.ceil(periods * self.period)) if self.free_motions.size else 0
        return max(moves, MIN_STEPS_PER_MOVE) + 1, step

    def start(self) -> tuple[Array, Array]:
        """The pose of the start, and rates of 0."""
        pose, rates = start_state(self.model, self.run)
        return pose, np.zeros_like(rates)

    @cached_property
    def path(self) -> Array:
        """The x of the run at the half steps: a step on a sample, then a way to the next one."""
        x, half_moves = self.run.x[: self.samples], 2 * (self.count - 1)
        way = np.linspace(0.0, 1.0, half_moves, endpoint=False)
        share = np.concatenate([[0.0, 0.0], way**3 * (10.0 + way * (6.0 * way - 15.0))])
        moves = x[:-1, None] + np.diff(x)[:, None] * share
        return np.concatenate([moves.ravel(), np.repeat(x[-1], 3)])

    def drives(self) -> Iterator[DriveRows]:
        """The motion of each drive at all half steps."""
        half, value = 0.5 * self.step, self.run.motion(self.path)[0]
        holds = np.arange(value.shape[1]) % (2 * self.count) <= HALF_STEPS_PER_STEP
        rate = np.where(holds, 0.0, np.gradient(value, half, axis=1))
        acceleration = np.where(holds, 0.0, np.gradient(rate, half, axis=1))
        for j, *motion in zip(self.driven, value, rate, acceleration, strict=True):
            yield DriveRows(j, *motion)

    @cached_property
    def free_motions(self) -> Array:
        """Motions (nv, dof) of the joints that loops and drives leave."""
        import scipy.linalg  # slow to load

        terms = self.terms.terms(self.qpos, self.qvel, self.controls[:, 0])
        drives = np.eye(self.model.nv)[self.model.jnt_dofadr[list(self.driven)]]
        rows = np.vstack([terms.jacobian, drives])
        if not rows.size:
            return np.eye(self.model.nv)
        return np.asarray(scipy.linalg.null_space(rows, rcond=REDUNDANT_SHARE))

    @cached_property
    def terms(self) -> SmoothTerms:
        """The forces of springs, weights and loads, by MuJoCo."""
        return SmoothTerms(self.model, self.run.start)

    def force_at(self, move: Array) -> Array:
        """Forces on the joints at rest (nv,) after a small move (nv,) from the start."""
        pose = self.qpos.copy()
        mujoco.mj_integratePos(self.model, pose, move, 1.0)
        found = self.terms.terms(pose, self.qvel, self.controls[:, 0])
        return found.force - found.bias

    @cached_property
    def start_force(self) -> Array:
        """Forces on the joints (nv,) at the start."""
        return self.force_at(np.zeros(self.model.nv))

    @cached_property
    def unit_mass_matrix(self) -> Array:
        """Mass matrix (nv, nv) of links with an inertia of 1 kg m^2."""
        model, data = copy.copy(self.model), copy.copy(self.data)
        model.body_mass[:], model.body_inertia[:], model.dof_armature[:] = 0.0, 0.0, 0.0
        for link in list(self.links())[1:]:
            axes = self.data.xmat[link.body].reshape(3, 3)
            model.body_mass[link.body] = self.unit_mass
            model.body_inertia[link.body] = 1.0
            model.body_ipos[link.body] = axes.T @ (link.centre - self.data.xpos[link.body])
        mujoco.mj_fwdPosition(model, data)
        return mass_matrix(model, data)

    @property
    def unit_mass(self) -> float:
        """Mass of a link with an inertia of 1 kg m^2 [kg]."""
        return 1.0 / float(self.model.stat.extent) ** 2

    def oscillations(self) -> tuple[float, float]:
        """Squares of the fastest and of the slowest frequency with unit inertia [1/s^2]."""
        import scipy.linalg  # slow to load

        free = self.free_motions
        if not free.size:
            return 1.0, 1.0
        columns = [
            (self.force_at(-move) - self.force_at(move)) / (2.0 * SMALL_MOVE)
            for move in SMALL_MOVE * free.T
        ]
        stiffness, mass = free.T @ np.array(columns).T, free.T @ self.unit_mass_matrix @ free
        squares = np.abs(scipy.linalg.eigvalsh(0.5 * (stiffness + stiffness.T), mass))
        if not (fastest := float(squares.max())) > 0.0:
            raise Unsupported("a rest of joints that no spring, weight or load holds")
        return fastest, max(float(squares.min()), MIN_SQUARE_SHARE * fastest)

    def joint_on_stop(self) -> str:
        """The name of a joint that is pressed on the end of its range at the start, or empty."""
        free = self.free_motions
        inertia = free.T @ self.unit_mass_matrix @ free
        accelerations = free @ np.linalg.solve(inertia, free.T @ self.start_force)
        for j, one in enumerate(self.joints()):
            if one.limits:
                change = float(accelerations[self.model.jnt_dofadr[j]])
                low, high = (abs(one.value - end) <= ON_STOP for end in one.limits)
                least = ON_STOP * float(np.abs(accelerations).max(initial=0.0))
                if (low and change < -least) or (high and change > least):
                    return one.name
        return ""

    def refuse_start_off_rest(self) -> None:
        """Raise `Unsupported` if a sweep with dry friction does not begin at rest without it."""
        if not self.frictions.any():
            return
        push = np.abs(self.free_motions.T @ self.start_force).max(initial=0.0)
        if push > MAX_START_PUSH * self.frictions.max():
            names = [one.name for one in self.joints() if one.friction]
            raise Unsupported(
                f"frictionloss of {', '.join(map(repr, names))} in a sweep that does not begin at "
                "rest without friction"
            )

    def push_on_stops(self) -> float:
        """Largest force or moment on a joint with stops in the start pose [N m or N]."""
        ranged = [j for j, one in enumerate(self.joints()) if one.limits]
        return float(np.abs(self.start_force)[self.model.jnt_dofadr[ranged]].max(initial=0.0))

    def mechanism(self, rates_at: float = 0.0, forces: bool = True) -> NeutralMechanism:
        """The mechanism of the run; `rates_at` has no meaning, since nothing moves at first."""
        found = super().mechanism(0.0, forces)
        links = tuple(
            replace(one, mass=self.inertia * self.unit_mass, inertia=self.inertia * np.eye(3))
            for one in found.links[1:]
        )
        weights = tuple(
            NeutralLoad(
                k, one.centre, one.mass * found.gravity, np.zeros(3), False, np.ones(1), one.body
            )
            for k, one in enumerate(found.links)
            if k and (one.mass * found.gravity).any()
        )
        block = int(np.ceil(self.period / CHECKS_PER_PERIOD))
        rest = WayToRest(
            2.0 * self.slow,
            STILL_SHARE * found.size * self.slow,
            SLOW_SHARE * found.size * self.slow,
            block,
            max(block, int(np.ceil(MAX_PERIODS * self.period))),
        )
        return replace(
            found,
            links=(found.links[0], *links),
            joints=tuple(map(without_inertia, found.joints)),
            springs=tuple(replace(one, damping=0.0) for one in found.springs),
            loads=(*found.loads, *weights),
            gravity=np.zeros(3),
            rest=rest,
        )


def without_inertia(joint: NeutralJoint) -> NeutralJoint:
    """A joint without armature and damping."""
    return replace(joint, armature=0.0, damping=0.0)


def read_rest(
    path: Path, run: Run, support: Support = SUPPORT, timestep: float | None = None
) -> RestReader:
    """Read the model of an MJCF file for a sweep or an equilibrium, in the pose of its start.

    `timestep` is the time step [s], or None for that of the model; the other parameters are those
    of `read_model`.

    Raises
    ------
    BadModel, Unsupported
        See `read_model`; or the sweep has inertia, or dry friction and no rest at its start.
    """
    if run.inertia:
        raise Unsupported("a sweep with inertia: the engine comes to rest at every sample")
    kind = RunKind.EQUILIBRIUM if run.kind == "equilibrium" else RunKind.SETTLED_SWEEP
    if run.kind == "sweep" and not run.drives:
        raise BadModel("a sweep needs a [drive]: the joint that is moved")
    model = read_model(path, run, kind, support)
    reader = RestReader(model, run, timestep or float(model.opt.timestep))
    reader.refuse_start_off_rest()
    return reader
