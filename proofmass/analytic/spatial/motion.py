r"""The motion of a tree with exact equalities.

    M v̇ = Q - h + Jᵀ λ,   J v̇ = γ        with M = L Lᵀ, W = J L⁻ᵀ:
    v̇ = a + L⁻ᵀ W⁺ (γ - J a),   a = M⁻¹ (Q - h)

The pseudo-inverse W⁺ leaves out singular values below `EQUALITY_RANK_TOLERANCE` of the largest, so
that rows may depend on each other. The integrator is DOP853. After every step the pose is projected
on φ(q) = 0 and the rates on J v = 0 by the smallest change in the metric of M, and quaternions are
scaled to length 1.  Joints that rest on stops or stick by dry friction are more rows of J, and Q
has the friction of those that slip (`proofmass.analytic.motion_events`).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np

from proofmass.analytic.controls import (
    NO_PRESCRIBED_JOINTS,
    ControlsInTime,
    Prescribed,
    smooth_pieces,
)
from proofmass.analytic.motion_events import (
    FrictionJoint,
    MotionWithEvents,
    Phase,
    integrate_with_events,
    rest_in_steps,
)
from proofmass.analytic.numerics import CannotAssemble, SingularHere
from proofmass.analytic.spatial.kinematics import advance_pose, pose_difference, pose_rate
from proofmass.analytic.spatial.mechanism import Tree
from proofmass.analytic.start import MAX_KEY_VIOLATION, start_pose, start_rates
from proofmass.analytic.stops import Balance, State, Step, Stop
from proofmass.analytic.term_source import Terms, TermSource
from proofmass.base.arrays import Array, Index

if TYPE_CHECKING:
    from scipy.integrate import DOP853

MOTION_TOLERANCE = 3e-14
"""Relative tolerance of a step, and absolute one in m, rad and per s."""
EQUALITY_RANK_TOLERANCE = 1e-8
"""Singular values of the equalities below this share of the largest count as zero."""
VIOLATION_TOLERANCE = 1e-13
"""Largest violation of closed equalities, as a share of the extent (at least of 1 m or rad)."""
MAX_ASSEMBLY_STEPS = 20
"""Largest number of Newton steps to close the equalities."""
VANISHING_STEP_SHARE, MAX_SHORT_STEPS = 1e-8, 10
"""The integration ends after `MAX_SHORT_STEPS` steps in turn that are shorter than
`VANISHING_STEP_SHARE` times the longest one: near a pose in which the equalities lose rank,
accelerations are rounding."""


@dataclass(frozen=True)
class ConstrainedMotion:
    """Poses, rates and accelerations along a motion with closed equalities.

    Attributes
    ----------
    q, v, a : ndarray (n, poses), (n, rates), (n, rates)
        Poses, rates and accelerations [SI].
    start_violation : float
        Largest constraint violation of the start pose in the MJCF [m or rad].
    rank : int
        Number of independent rows of the equalities.
    evaluations : int
        Number of evaluations of the equations of motion.
    followed : MotionWithEvents
        Events and forces at stops and of dry friction.
    """

    q: Array
    v: Array
    a: Array
    start_violation: float
    rank: int
    evaluations: int
    followed: MotionWithEvents = field(default_factory=MotionWithEvents)


class ConstrainedTree:
    """Motion of a tree in one phase, under equalities and drives, with the terms of a source."""

    def __init__(
        self,
        tree: Tree,
        source: TermSource,
        phase: Phase | None = None,
        controls: ControlsInTime | None = None,
        drives: Prescribed = NO_PRESCRIBED_JOINTS,
    ):
        self.tree, self.source, self.controls = tree, source, controls
        self.phase = phase or Phase()
        self.drives, self.evaluations, self.rank = drives, 0, 0
        self.last = np.inf  # end of the smooth piece of the profiles that is integrated [s]
        self.solved_state: tuple[float, bytes, bytes] | None = None
        held = [one.rate for one in self.phase.held]
        self.joint_rows = np.eye(tree.armature.size)[[*drives.rates.tolist(), *held]]
        self.friction = self.phase.friction(tree.armature.size)

    @property
    def rows(self) -> int:
        """Number of rows of equalities, drives and joints at rest."""
        return self.tree.rows + len(self.joint_rows)

    def ctrl(self, t: float) -> Array | None:
        """All controls at a time; None if they are those of the key."""
        return self.controls.at(t) if self.controls else None

    def terms(self, t: float, q: Array, v: Array) -> Terms:
        """All terms at a time, for a pose with its rates; drives and joints at rest have rows."""
        t = min(t, self.last)
        found = self.source.terms(q, v, self.ctrl(t))
        jacobian = self.tree.without_rounding(found.jacobian)
        found = replace(found, jacobian=jacobian, force=found.force + self.friction)
        if not self.joint_rows.size:
            return found
        value, _, acceleration = self.drives.profile(t)
        gaps = [q[one.pose] - one.value for one in self.phase.held]
        return replace(
            found,
            gap=np.concatenate([found.gap, q[self.drives.poses] - value, gaps]),
            jacobian=np.concatenate([jacobian, self.joint_rows]),
            drift=np.concatenate([found.drift, acceleration, np.zeros(len(gaps))]),
        )

    def row_rates(self, t: float) -> Array:
        """Prescribed rates of all rows (rows,) at a time: zero except for the drives."""
        rate = self.drives.profile(min(t, self.last))[1]
        return np.concatenate([np.zeros(self.tree.rows), rate, np.zeros(len(self.phase.held))])

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Accelerations (rates,) at a time, for a pose with its rates [SI]."""
        if not self.rows:
            self.evaluations += 1
            if not self.friction.any():
                return self.source.acceleration(q, v, self.ctrl(min(t, self.last)))
            terms = self.terms(t, q, v)
            return np.asarray(np.linalg.solve(terms.mass, terms.force - terms.bias))
        terms, root, closing = self.solve(t, q, v)
        free = root.T @ (root @ (terms.force - terms.bias))
        return np.asarray(free + closing @ (terms.drift - terms.jacobian @ free))

    def solve(self, t: float, q: Array, v: Array) -> tuple[Terms, Array, Array]:
        """The terms at a time, for a pose with its rates, and their `factors`.

        They are kept for the next call, since a step ends with the state that is closed next.
        """
        state = min(t, self.last), q.tobytes(), v.tobytes()
        if state != self.solved_state:
            self.evaluations += 1
            terms = self.terms(t, q, v)
            self.solved, self.solved_state = (terms, *self.factors(terms)), state
        return self.solved

    def factors(self, terms: Terms) -> tuple[Array, Array]:
        """L⁻¹ of the mass matrix L Lᵀ, and the matrix that closes the rows by the least change.

        Raises
        ------
        SingularHere
            The rows have another rank than at the start, or the mass matrix is not positive.
        """
        from scipy.linalg.lapack import dgesdd, dpotrf, dtrtri  # slow to load

        lower, failed = dpotrf(terms.mass, lower=1)
        if failed:
            raise SingularHere("the mass matrix is not positive definite")
        root, _ = dtrtri(lower, lower=1)
        left, values, right, _ = dgesdd(root @ terms.jacobian.T, full_matrices=0)
        rank = int((values > EQUALITY_RANK_TOLERANCE * values[0]).sum())
        self.rank = self.rank or rank
        if rank != self.rank:
            raise SingularHere(
                f"the equalities lose rank: {rank} rows hold, {self.rank} at the start"
            )
        closing = (left[:, :rank] / values[:rank]) @ right[:rank]
        return np.asarray(root), np.asarray(root.T @ closing)

    def close(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Find the nearest closed pose at a time, and the nearest rates that keep it closed.

        Distances are in the metric of the mass matrix.

        Raises
        ------
        CannotAssemble
            The equalities stay open.
        """
        if not self.rows:
            return advance_pose(self.tree, q, np.zeros_like(v)), v
        for _ in range(MAX_ASSEMBLY_STEPS):
            terms, _, inverse = self.solve(t, q, v)
            gap = np.abs(terms.gap).max()
            if gap < VIOLATION_TOLERANCE * max(1.0, self.tree.extent):
                v = v - inverse @ (terms.jacobian @ v - self.row_rates(t))
                return self.phase.fix(q, v, np.zeros_like(v))[:2]
            q = advance_pose(self.tree, q, -inverse @ terms.gap)
        raise CannotAssemble(f"the equalities stay open by {gap:.3g}")

    def is_at_rest(self, t: float, q: Array, v: Array) -> bool:
        """Whether joints at rest hold all others, and no drive moves any."""
        if not self.phase.held or self.drives.rates.size:
            return False
        self.solve(t, q, v)
        return self.rank == v.size

    def slope(self, t: float, y: Array) -> Array:
        """Time derivative of the state y = (q, v)."""
        q, v = y[: self.tree.start.size], y[self.tree.start.size :]
        acceleration = self.acceleration(t, q, v)
        return np.concatenate([pose_rate(self.tree, q, v), acceleration])

    def start(self, t: float = 0.0) -> tuple[Array, Array, float]:
        """Find the closed pose and rates at a time that are nearest to those of the start.

        The third value is the constraint violation of the start pose [m or rad].

        Raises
        ------
        CannotAssemble
            This violation is more than `MAX_KEY_VIOLATION`.
        """
        tree = self.tree
        violation = 0.0
        if tree.rows:
            violations = np.abs(self.source.terms(tree.start, tree.start_rate).gap)
            violation = float(violations.max())
            shares = violations / tree.row_sizes
            if not shares.max() <= MAX_KEY_VIOLATION:
                worst = int(shares.argmax())
                raise CannotAssemble(
                    f"the equality {name_of_row(tree, worst)!r} is open by "
                    f"{violations[worst]:.3g} at the start"
                )
        value, rate, _ = self.drives.profile(t)
        begin = StartOfTree(tree, self.source, self.drives.poses, self.drives.rates)
        q = start_pose(begin, value)
        found, rows = begin.prescribed(q)
        gap = np.abs(found[: tree.rows]).max(initial=0.0)
        if not gap < VIOLATION_TOLERANCE * max(1.0, tree.extent):
            raise CannotAssemble(f"the equalities stay open by {gap:.3g}")
        v = start_rates(rows, tree.start_rate, np.concatenate([np.zeros(tree.rows), rate]))
        return q, v, violation


@dataclass(frozen=True)
class StartOfTree:
    """Equalities and driven joints of a tree, for `proofmass.analytic.start`.

    `poses` and `rates` are the indices of the driven joints in a pose and in the rates.
    """

    tree: Tree
    source: TermSource
    poses: Index
    rates: Index

    @cached_property
    def key(self) -> Array:
        """The pose of the key, with quaternions of length one."""
        return advance_pose(self.tree, self.tree.start, np.zeros(self.tree.armature.size))

    @property
    def sizes(self) -> Array:
        """Units of the rates (rates,): 1 rad, or the size of the model [m]."""
        return self.tree.sizes

    def prescribed(self, q: Array) -> tuple[Array, Array]:
        """Violations of the equalities, then values of the drives, and their Jacobian."""
        gaps, rows = self.source.equalities(q)
        units = np.eye(self.tree.armature.size)[self.rates]
        rows = self.tree.without_rounding(rows)
        return np.concatenate([gaps, q[self.poses]]), np.concatenate([rows, units])

    def moved(self, q: Array, move: Array) -> Array:
        """The pose that a move leads to."""
        return advance_pose(self.tree, q, move)

    def way(self, q: Array) -> Array:
        """The move from the key to a pose."""
        return pose_difference(self.tree, self.key, q)


def name_of_row(tree: Tree, row: int) -> str:
    """Name of the equality that a row belongs to."""
    names = [loop.name for loop in tree.loops for _ in range(3 if loop.turns is None else 6)]
    return [*names, *(tie.name for tie in tree.ties)][row]


def count_dof(tree: Tree, source: TermSource) -> int:
    """Degrees of freedom of a tree at its start pose.

    Raises
    ------
    CannotAssemble
        The equalities of the start pose are open.
    """
    q, _, _ = ConstrainedTree(tree, source).start()
    rows = tree.without_rounding(source.equalities(q)[1]) * tree.sizes
    return tree.armature.size - int(np.linalg.matrix_rank(rows, rtol=EQUALITY_RANK_TOLERANCE))


def integrate_motion(
    tree: Tree,
    source: TermSource,
    times: Array,
    stops: tuple[Stop, ...] = (),
    controls: ControlsInTime | None = None,
    drives: Prescribed = NO_PRESCRIBED_JOINTS,
) -> ConstrainedMotion:
    """Integrate the motion from the start at rising times.

    Raises
    ------
    CannotAssemble, SingularHere
        The start pose is open; or the motion comes to a pose in which the equalities lose rank.
    NotCovered
        The start is beyond a stop.
    """
    moving = FreeTree(tree, source, stops, controls, drives)
    free = moving.constrained_tree(Phase())
    q, v, gap = free.start(float(times[0]))
    free.acceleration(float(times[0]), q, v)  # which finds the rank
    found = integrate_with_events(moving, times, q, v)
    evaluations = sum(holder.evaluations for holder in moving.constrained_trees.values())
    rank = free.rank - drives.rates.size
    return ConstrainedMotion(*found.arrays(), gap, rank, evaluations, found)


class FreeTree:
    """A tree that moves freely between its stops, except for its driven joints."""

    def __init__(
        self,
        tree: Tree,
        source: TermSource,
        stops: tuple[Stop, ...],
        controls: ControlsInTime | None = None,
        drives: Prescribed = NO_PRESCRIBED_JOINTS,
    ):
        self.tree, self.source, self.controls, self.drives = tree, source, controls, drives
        self.stops = tuple(stop for stop in stops if stop.rate not in drives.rates)
        own = controls.breaks if controls else ()
        self.breaks = tuple(sorted({*drives.breaks, *own}))
        self.changes_in_time = bool(drives.rates.size or controls)
        self.frictions = tuple(
            FrictionJoint(
                joint.name,
                joint.pose,
                joint.rate,
                float(joint.friction[0]),
                float(tree.sizes[joint.rate]),
            )
            for joint in tree.joints
            if joint.friction.any() and joint.rate not in drives.rates
        )
        self.constrained_trees: dict[Phase, ConstrainedTree] = {}

    def constrained_tree(self, phase: Phase) -> ConstrainedTree:
        """The motion under the equalities and the drives in a phase; cached."""
        if phase not in self.constrained_trees:
            self.constrained_trees[phase] = ConstrainedTree(
                self.tree, self.source, phase, self.controls, self.drives
            )
        return self.constrained_trees[phase]

    def state(self, phase: Phase, t: float, q: Array, v: Array) -> State:
        """Add the accelerations to a pose and its rates."""
        a = self.constrained_tree(phase).acceleration(t, q, v)
        return phase.fix(q, v, a)

    def balance(self, t: float, q: Array, v: Array, a: Array) -> Balance:
        """Constraints of equalities and drives in a state, and the force they and stops exert."""
        terms = self.constrained_tree(Phase()).terms(t, q, v)
        return Balance(terms.jacobian, terms.mass, terms.mass @ a + terms.bias - terms.force)

    def steps(
        self, phase: Phase, t: float, q: Array, v: Array, end: float, longest_step: float
    ) -> Iterator[Step]:
        """Iterate over the motion in a phase from a state on, in steps up to a length."""
        holder, size = self.constrained_tree(phase), q.size
        for start, stop, last in smooth_pieces(t, end, self.breaks) if t < end else ():
            holder.last = last
            if holder.is_at_rest(start, q, v):
                yield from rest_in_steps(start, stop, (q, 0.0 * v, 0.0 * v), longest_step)
                continue
            solver = start_integrator(holder, start, q, v, stop, longest_step)
            longest, short = 0.0, 0
            while solver.status == "running":
                step_start = solver.t
                try:
                    message = solver.step()
                    if solver.status == "failed":
                        raise SingularHere(str(message))
                    longest = max(longest, solver.step_size)
                    short = short + 1 if solver.step_size < VANISHING_STEP_SHARE * longest else 0
                    if short == MAX_SHORT_STEPS:
                        raise SingularHere("steps become too short, as where equalities lose rank")
                    q, v = holder.close(solver.t, solver.y[:size], solver.y[size:])
                    yield Step(step_start, solver.t, states_in_step(holder, solver, size))
                    solver.y = np.concatenate([q, v])
                except (SingularHere, CannotAssemble) as error:
                    raise type(error)(f"the motion ends at t = {solver.t:.6g} s: {error}") from None


def states_in_step(
    holder: ConstrainedTree, solver: "DOP853", size: int
) -> Callable[[float], State]:
    """Make the function that gives the state at a time within the last step of an integrator."""
    # dense output costs evaluations: only where a time inside the step is asked for
    dense_output, last = cache(solver.dense_output), (solver.t, solver.y)

    def at(time: float) -> State:
        y = last[1] if time == last[0] else dense_output()(time)
        q, v = holder.close(time, y[:size], y[size:])
        a = holder.acceleration(time, q, v)
        return holder.phase.fix(q, v, a)

    return at


DRIVE_STRIDE = 0.05
"""Longest move of the drives in one stride [rad, or shares of the extent]."""
MAX_TANGENT_CHANGE = 0.5
"""Largest change of the motion by the tangent over a stride, as a share of the motion; with a
larger change the stride is halved."""
MAX_SINGULAR_RATIO = 1e5
"""Ratio of singular values of A up to which the inverse of A'A is right to 1e-6; one step of
Newton's method squares this error."""
MIN_STRIDE_SHARE = 1e-6
"""Share of `DRIVE_STRIDE` below which a stride is not halved any more."""


class DrivenTree:
    """A tree whose pose is determined by the given values of its driven joints.

    Parameters
    ----------
    tree : Tree
    source : TermSource
    joints : tuple of str
        The driven joints.
    """

    def __init__(self, tree: Tree, source: TermSource, joints: tuple[str, ...]):
        self.tree, self.source, self.evaluations = tree, source, 0
        self.places, self.dofs = tree.places(joints)
        self.sizes = tree.sizes
        self.units = np.eye(tree.armature.size)[self.dofs]
        self.still = np.zeros(tree.armature.size)

    def inverse(self, jacobian: Array) -> Array:
        """Derivatives of the rates by the values of equalities and drives (rates, rows + drives).

        Raises
        ------
        SingularHere
            The drives do not determine the motion there.
        """
        self.evaluations += 1
        rows = np.vstack([jacobian, self.units]) * self.sizes
        if (found := regular_pseudo_inverse(rows)) is None:
            left, values, right = np.linalg.svd(rows, full_matrices=False)
            rank = int((values > EQUALITY_RANK_TOLERANCE * values[0]).sum())
            if rank < self.still.size:
                raise SingularHere(f"the drives leave {self.still.size - rank} degrees of freedom")
            found = (right.T / values) @ left.T
        return np.asarray(self.sizes[:, None] * found)

    def placed(self, q: Array, values: Array) -> tuple[Array, Array]:
        """Find the closed pose near q with the drives at given values, and the inverse there.

        Raises
        ------
        CannotAssemble
            The equalities stay open.
        """
        size = max(1.0, self.tree.extent)
        for _ in range(MAX_ASSEMBLY_STEPS):
            gaps, jacobian = self.source.equalities(q)
            inverse = self.inverse(jacobian)
            gap = np.concatenate([gaps, q[self.places] - values])
            if np.abs(gap).max() < VIOLATION_TOLERANCE * size:
                return q, inverse
            q = advance_pose(self.tree, q, -inverse @ gap)
        raise CannotAssemble(f"the equalities stay open by {np.abs(gap).max():.3g}")

    def tangent(self, inverse: Array) -> Array:
        """Rates of all joints for a unit rate of each drive (rates, drives)."""
        return inverse[:, inverse.shape[1] - self.dofs.size :]

    def moved(self, q: Array, inverse: Array, values: Array) -> tuple[Array, Array]:
        """Follow the branch in strides to new values of the drives: closed pose and inverse."""
        share, done, tangent = 1.0, q[self.places], self.tangent(inverse)
        while (remaining := np.abs((values - done) / self.sizes[self.dofs]).max()) > 0:
            part = min(1.0, share * DRIVE_STRIDE / remaining)
            target = values if part == 1.0 else done + part * (values - done)
            step = tangent @ (target - done)
            try:
                there, found = self.placed(advance_pose(self.tree, q, step), target)
                new_tangent = self.tangent(found)
                tangent_change = ((new_tangent - tangent) @ (target - done)) / self.sizes
                accepted = np.abs(tangent_change).max() <= MAX_TANGENT_CHANGE * max(
                    np.abs(step / self.sizes).max(), 1e-9
                )
            except (CannotAssemble, SingularHere):
                accepted = False
            if accepted:
                q, inverse, tangent, done = there, found, new_tangent, target
                share = min(1.0, 2 * share)
            elif share > MIN_STRIDE_SHARE:
                share /= 2
            else:
                values_text = ", ".join(f"{value:.6g}" for value in done)
                raise SingularHere(f"limit position with the drives at {values_text}")
        return q, inverse

    def rates(
        self, q: Array, inverse: Array, rate: Array, acceleration: Array
    ) -> tuple[Array, Array]:
        """Rates and accelerations of all joints at a closed pose with its inverse."""
        v = self.tangent(inverse) @ rate
        return v, inverse @ np.concatenate([self.source.terms(q, v).drift, acceleration])


def regular_pseudo_inverse(rows: Array) -> Array | None:
    """The pseudo-inverse of a matrix A, or None if A may have small singular values.

    X = (A'A)^-1 A', improved by X <- 2X - XAX.  The product of the Frobenius norms of A'A and its
    inverse is at least the square of the ratio of the singular values of A, and it is large where
    A'A is singular up to rounding, although X need not be large there.  Where the product is below
    `MAX_SINGULAR_RATIO`^2, X is right to 1e-11.

    >>> regular_pseudo_inverse(np.array([[2.0, 0.0], [0.0, 4.0]]))
    array([[0.5 , 0.  ],
           [0.  , 0.25]])
    >>> regular_pseudo_inverse(np.array([[1.0, 1.0], [1.0, 1.0 + 1e-9]]))
    """
    square = rows.T @ rows
    try:
        inverse = np.linalg.inv(square)
    except np.linalg.LinAlgError:
        return None
    if not np.vdot(square, square) * np.vdot(inverse, inverse) < MAX_SINGULAR_RATIO**4:
        return None
    found = inverse @ rows.T
    return np.asarray(2.0 * found - found @ (rows @ found))


def driven_motion(
    tree: Tree,
    source: TermSource,
    joints: tuple[str, ...],
    values: Array,
    rates: Array,
    accelerations: Array,
) -> ConstrainedMotion:
    """Find the motion at given values, rates and accelerations of the drives, (n, drives) each.

    Raises
    ------
    CannotAssemble, SingularHere, NotCovered
        The start pose is open; or the drives do not determine the motion; or a limit position lies
        on the way; or a driven joint is neither a hinge nor a slide.
    """
    q, _, gap = ConstrainedTree(tree, source).start()
    driver, poses, inverses = DrivenTree(tree, source, joints), list[Array](), list[Array]()
    q, inverse = driver.placed(q, q[driver.places])
    for value in values:
        q, inverse = driver.moved(q, inverse, value)
        poses.append(q)
        inverses.append(inverse)
    parts = [driver.rates(*one) for one in zip(poses, inverses, rates, accelerations, strict=True)]
    v, a = (np.array(part) for part in zip(*parts, strict=True))
    return ConstrainedMotion(np.array(poses), v, a, gap, 0, driver.evaluations)


def start_integrator(
    holder: ConstrainedTree, t: float, q: Array, v: Array, end: float, longest: float
) -> "DOP853":
    """Start the integrator of a motion from a pose with its rates."""
    from scipy.integrate import DOP853  # slow to load

    return DOP853(
        holder.slope,
        t,
        np.concatenate([q, v]),
        end,
        rtol=MOTION_TOLERANCE,
        atol=MOTION_TOLERANCE,
        max_step=longest,
    )
