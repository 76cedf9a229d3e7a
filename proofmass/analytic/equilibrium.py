r"""Static equilibria of a mechanism whose drives leave degrees of freedom to springs and loads.

At an equilibrium the constraint forces of loops, drives and joint limits balance the forces Q that
springs, weights and loads exert on the joints::

    Q(q) + Bᵀ s = 0,    g(q) = 0,    B = dg/dq    g: constraint violations, s: constraint forces

Newton's method solves both equations together.  Rows of B may depend on each other.  The stiffness
K is found by central differences; s is fixed, so that K contains the curvature of the loops::

    K = -d/dq (Q + Bᵀ s)

A joint limit (stop) constrains its joint as long as it pushes, and a limit that a joint passes
constrains the joint from then on.  An equilibrium is stable while K is positive definite on the
null space of B; where loads follow a body, the symmetric part of K is meant.  The path of
equilibria that belongs to the values of the drives is followed in steps of the drives, called
strides.  A stride is halved until Newton's steps shrink fast, and the path ends where the
equilibrium becomes unstable.  The rates along the path follow from the same equations.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from proofmass.analytic.numerics import CannotMove, SingularHere
from proofmass.analytic.stops import Stop
from proofmass.base.arrays import Array, Index

DIFFERENCE_STEP = 6e-6
"""Step of central differences [rad, or sizes]: cube root of rounding; the error is about 1e-10."""
MIN_DIFFERENCE_STEP = 1e-8
"""Smallest step of differences [rad, or sizes].  The step shrinks with Newton's steps, so that an
equilibrium near a pose in which a spring becomes slack is still right to 1e-8."""
FOURTH_ORDER_STEP = 5e-4
"""Step of differences of fourth order [rad, or sizes]; the error is about 1e-12."""
KINK_MISMATCH = 1e-5
"""Share of the largest stiffness: where a spring becomes slack or a force is clipped, differences
with steps of once and twice `FOURTH_ORDER_STEP` disagree by more than this."""
MAX_JOINT_MOVE = 0.3
"""Longest move of a joint in one step [rad, or sizes]."""
MAX_STEP_RATIO = 0.25
"""Largest ratio of a step of Newton's method to the step before it, within one stride."""
SHORT_FIRST_STEP, MAX_STEP_GROWTH, MAX_GROWING_STEPS = 1e-3, 30.0, 3
"""Exception to `MAX_STEP_RATIO`: if the first step is not longer than `SHORT_FIRST_STEP`
[rad, or sizes], steps may grow to `MAX_STEP_GROWTH` times the first one, at most
`MAX_GROWING_STEPS` times."""
SNAP_MISMATCH = 0.5
"""Share of the longer step: if the step ahead from an equilibrium and the step back to it differ by
more than this, the mechanism has snapped to another branch between the two."""
SAME_STIFFNESS_STEP = 1e-5
"""Length of a step [rad, or sizes] below which the next step uses the same stiffness."""
STEP_TOLERANCE = 1e-11
"""Length of a step [rad, or sizes] below which an equilibrium is found: the next step would be
rounding."""
MAX_STEPS_TO_EQUILIBRIUM = 200
"""Largest number of steps from the start pose to the first equilibrium."""
MAX_SAMPLES_TOGETHER = 32
"""Largest number of samples whose equilibria are found together."""
MIN_STRIDE = 1e-7
"""Smallest stride, as a share of the way between two samples: a path that cannot be followed by
this share has ended."""
LIMIT_POSITION_RATIO = 1e-2
"""Ratio of the smallest to the largest singular value of the rows: a path that ends with a smaller
ratio ends near a limit position."""
MIN_RELATIVE_STIFFNESS = 1e-9
"""Share of the largest stiffness: differences cannot distinguish a smaller stiffness from zero."""
STOP_ROUNDING = 1e-12
"""Rounding of a joint's value [rad, or sizes]: a joint that is further beyond its range has passed
its stop."""
STOP_FORCE_ROUNDING = 1e-12
"""Rounding of the force of a stop, as a share of the largest constraint force."""
EQUILIBRIUM_RANK_TOLERANCE = 1e-8
"""Share of the largest singular value: rows with smaller singular values depend on other rows."""


class Unstable(CannotMove):
    """The equilibrium is unstable, or none is found."""


class Statics(Protocol):
    """A mechanism with the forces that act on it at rest, and with its loops and drives."""

    @property
    def sizes(self) -> Array:
        """Units of its rates (rates,): 1 rad, or the size of the mechanism [m]."""

    @property
    def driven(self) -> Index:
        """Indices of the drives in the rates (drives,)."""

    @property
    def stops(self) -> Sequence[Stop]:
        """Stops of the joints that are not driven."""

    def begin(self, values: Array) -> Array:
        """Find the closed pose (poses,) nearest to the start, with the drives at values (drives,).

        Raises
        ------
        CannotAssemble
            There is no such pose.
        """

    def moved(self, q: Array, moves: Array) -> Array:
        """Poses (n, poses) that moves (n, rates) [rad or m] lead to from poses q (n, poses)."""

    def pushed(self, q: Array, ctrl: Array | None) -> tuple[Array, Array, Array]:
        """Forces Q (n, rates) [N m or N] at poses q (n, poses), with controls (n, controls).

        Also returned are the rows B of the loops (n, rows, rates), divided by the units of the
        loops [per rad or m], and the violations of the loops (n, rows).
        """

    def values(self, q: Array) -> Array:
        """Values of the drives (n, drives) [rad or m]."""


@dataclass(frozen=True)
class Equations:
    """The equilibrium equations at n poses, in the units `Statics.sizes` of the rates.

    Attributes
    ----------
    left : ndarray (n, rates)
        Residual Q + Bᵀ s, with the s that makes it smallest [N m].
    gap : ndarray (n, rows)
        Constraint violations of loops, drives and stops [1].
    inverse, null : ndarray (n, rates, rows), (n, rates, dof)
        Pseudo-inverse of B, and a basis of its null space: the motions that loops, drives and
        stops leave free [1].
    stiffness : ndarray (n, rates, rates)
        K [N m].
    forces : ndarray (n, rows)
        Constraint forces s [N m].
    independent : bool
        Whether the rows of drives and stops are independent of each other and of the loops.
    """

    left: Array
    gap: Array
    inverse: Array
    null: Array
    stiffness: Array
    forces: Array
    independent: bool

    def solve_linear(self, left: Array, gap: Array) -> Array:
        """Find moves (n, rates) that add `left` to the residual and `gap` to the violations.

        Raises
        ------
        SingularHere
            The equations do not determine the moves.
        """
        if not self.independent:
            raise SingularHere("a stop or a drive constrains what others constrain already")
        projection = self.null.swapaxes(1, 2)
        closing_move = self.inverse @ gap[..., None]
        needed = projection @ (left[..., None] + self.stiffness @ closing_move)
        try:
            free = np.linalg.solve(self.own, needed)
        except np.linalg.LinAlgError:
            raise SingularHere("a degree of freedom without a drive has no stiffness") from None
        return np.asarray((closing_move - self.null @ free)[..., 0])

    @cached_property
    def own(self) -> Array:
        """Stiffness K projected on the degrees of freedom (n, dof, dof)."""
        return np.asarray(self.null.swapaxes(1, 2) @ self.stiffness @ self.null)

    @property
    def least(self) -> Array:
        """Smallest stiffness of the degrees of freedom (n,) over the largest entry of K."""
        size = np.abs(self.stiffness).max(axis=(1, 2))
        values = np.linalg.eigvalsh((self.own + self.own.swapaxes(1, 2)) / 2)
        return np.asarray(values.min(axis=1, initial=np.inf) / np.where(size > 0, size, 1.0))

    def descent_moves(self) -> Array:
        """Find moves (n, rates) that close the constraints and lower the energy.

        The energy falls also along degrees of freedom of negative stiffness.
        """
        closing_move = -(self.inverse @ self.gap[..., None])
        values, vectors = np.linalg.eigh((self.own + self.own.swapaxes(1, 2)) / 2)
        floor = (
            MIN_RELATIVE_STIFFNESS * np.abs(self.stiffness).max(axis=(1, 2), keepdims=True)[..., 0]
        )
        push = vectors.swapaxes(1, 2) @ (self.null.swapaxes(1, 2) @ self.left[..., None])
        free_move = (
            push
            / np.maximum(np.abs(values), np.where(floor > 0, floor, MIN_RELATIVE_STIFFNESS))[
                ..., None
            ]
        )
        return np.asarray((closing_move + self.null @ (vectors @ free_move))[..., 0])


ActiveStops = tuple[Stop, ...]
"""Stops that joints rest on."""
DriveInputs = tuple[Array, Array | None]
"""Values of the drives (n, drives) and all controls (n, controls); None: controls of the key."""


class EquilibriumSolver:
    """Finds equilibria of a mechanism with given values of its drives and stops of other joints.

    Parameters
    ----------
    statics : Statics
    """

    def __init__(self, statics: Statics):
        self.statics, self.sizes = statics, statics.sizes
        self.rank = 0  # number of independent rows of loops and drives

    def pushed(self, q: Array, ctrl: Array | None, held: ActiveStops) -> tuple[Array, Array, Array]:
        """Forces Q (n, rates) and the rows B (n, rows, rates) at poses q, in sizes.

        The third array has the violations of the loops (n, loops).
        """
        force, loops, gap = self.statics.pushed(q, ctrl)
        own = np.eye(self.sizes.size)[[*self.statics.driven, *(stop.rate for stop in held)]]
        rows = [loops * self.sizes, np.broadcast_to(own, (len(q), *own.shape))]
        return force * self.sizes, np.concatenate(rows, axis=1), gap

    def gap(self, q: Array, loops: Array, values: Array, held: ActiveStops) -> Array:
        """Violations of loops, drives and stops (n, rows), with drives at values (n, drives)."""
        ends = np.array([stop.value for stop in held])
        drive_violations = (self.statics.values(q) - values) / self.sizes[self.statics.driven]
        stop_violations = (q[:, [stop.pose for stop in held]] - ends) / [stop.size for stop in held]
        return np.concatenate([loops, drive_violations, stop_violations], axis=1)

    def moved(self, q: Array, moves: Array) -> Array:
        """Poses that moves (n, rates) in sizes lead to from poses q."""
        return self.statics.moved(q, moves * self.sizes)

    def equations(
        self,
        q: Array,
        values: Array,
        ctrl: Array | None,
        held: ActiveStops,
        stiffness: Array | None = None,
        nudge: float = DIFFERENCE_STEP,
        fine: bool = False,
    ) -> Equations:
        """Set up the equations at poses q (n, poses), with drives at values (n, drives).

        The stiffness is found by differences unless it is given.

        Raises
        ------
        SingularHere
            The rows have different ranks at two of the poses.
        """
        force, rows, loops = self.pushed(q, ctrl, held)
        inverse, null = inverses_and_null_spaces(rows)
        s = -(inverse.swapaxes(1, 2) @ force[..., None])
        if stiffness is None:
            stiffness = self.stiffness(q, s, ctrl, held, nudge, fine)
        left = force + (rows.swapaxes(1, 2) @ s)[..., 0]
        independent = self.sizes.size - null.shape[2] == self.rank + len(held)
        gap = self.gap(q, loops, values, held)
        return Equations(left, gap, inverse, null, stiffness, s[..., 0], independent)

    def stiffness(
        self, q: Array, s: Array, ctrl: Array | None, held: ActiveStops, nudge: float, fine: bool
    ) -> Array:
        """Stiffness K (n, rates, rates) at poses q (n, poses) with forces s (n, rows, 1)."""

        def slopes(step: float) -> Array:
            (n, _), rates = q.shape, self.sizes.size
            nudges, many = step * np.concatenate([np.eye(rates), -np.eye(rates)]), 2 * rates
            near = self.moved(np.repeat(q, many, axis=0), np.tile(nudges, (n, 1)))
            controls = ctrl
            if controls is not None:
                controls = np.broadcast_to(controls, (n, controls.shape[1]))
                controls = np.repeat(controls, many, axis=0)
            force, rows, _ = self.pushed(near, controls, held)
            own = force + (rows.swapaxes(1, 2) @ np.repeat(s, many, axis=0))[..., 0]
            own = own.reshape(n, 2, rates, rates)  # side, nudged joint, force
            return np.asarray((own[:, 1] - own[:, 0]).swapaxes(1, 2) / (2 * step))

        if not fine:
            return slopes(nudge)
        fine_slopes, coarse_slopes = slopes(FOURTH_ORDER_STEP), slopes(2 * FOURTH_ORDER_STEP)
        kinked = np.abs(fine_slopes - coarse_slopes).max(axis=(1, 2)) > KINK_MISMATCH * np.abs(
            fine_slopes
        ).max(axis=(1, 2))
        found = np.asarray((4 * fine_slopes - coarse_slopes) / 3)
        if kinked.any():
            found[kinked] = slopes(nudge)[kinked]
        return found

    def steps(
        self, q: Array, inputs: DriveInputs, held: ActiveStops
    ) -> Iterator[tuple[Array, Array]]:
        """Iterate Newton's steps (n, rates) to equilibria, and the poses (n, poses) after them."""
        stiffness, nudge, last = None, DIFFERENCE_STEP, np.inf
        while True:
            found = self.equations(q, *inputs, held, stiffness, nudge)
            step = found.solve_linear(-found.left, -found.gap)
            q = self.moved(q, step)
            yield step, q
            size = float(np.abs(step).max(initial=0.0))
            stiffness = (
                found.stiffness
                if size < SAME_STIFFNESS_STEP and size < MAX_STEP_RATIO * last
                else None
            )
            nudge, last = min(DIFFERENCE_STEP, max(size, MIN_DIFFERENCE_STEP)), size

    def next(
        self, q: Array, before: DriveInputs, inputs: DriveInputs, held: ActiveStops
    ) -> tuple[Array, ActiveStops] | None:
        """Find the equilibrium (1, poses) at the end of a stride; None if the stride is too long.

        Where a joint comes to its stop and no degree of freedom is left, one of the joints that
        rested on a stop leaves it.
        """
        first, queue, seen = held, [held], set[ActiveStops]()
        while queue and len(seen) <= 4 * self.sizes.size:
            held = queue.pop(0)
            seen.add(held)
            if (approached := self.iterate_newton(q, inputs, held)) is None:
                continue
            pose, ahead = approached
            found = self.equations(pose, *inputs, held)
            new_stops = self.switched(pose[0], found.forces[0], held)
            if new_stops == held:
                has_snapped = held == first and self.turned(pose, ahead, found, before, held)
                return (
                    (pose, held)
                    if found.least[0] > MIN_RELATIVE_STIFFNESS and not has_snapped
                    else None
                )
            too_many = len(new_stops) + self.rank > self.sizes.size
            reduced = [
                tuple(one for one in new_stops if one != old) for old in held if old in new_stops
            ]
            queue += [one for one in (reduced if too_many else [new_stops]) if one not in seen]
        return None

    def iterate_newton(
        self, q: Array, inputs: DriveInputs, held: ActiveStops
    ) -> tuple[Array, Array] | None:
        """Poses (n, poses) that Newton's method converges to, and its first steps (n, rates).

        None if the steps do not shrink.  After a short first step they may grow a few times, since
        the stiffness changes where a spring becomes slack.
        """
        ahead, first, last = np.zeros((len(q), self.sizes.size)), np.zeros(len(q)), np.inf
        growing_steps_left = np.full(len(q), MAX_GROWING_STEPS)
        with suppress(SingularHere):
            for k, (steps, poses) in enumerate(self.steps(q, inputs, held)):
                sizes = np.abs(steps).max(axis=1, initial=0.0)
                too_long = ~(
                    sizes
                    <= (np.maximum(MAX_STEP_RATIO * last, STEP_TOLERANCE) if k else MAX_JOINT_MOVE)
                )
                growing_steps_left[too_long] -= 1
                allowed = (first <= SHORT_FIRST_STEP) & (sizes <= MAX_STEP_GROWTH * first)
                if (too_long & ~(allowed & (growing_steps_left >= 0))).any():
                    return None
                ahead, first, last = (ahead, first, sizes) if k else (steps, sizes, sizes)
                if (sizes <= STEP_TOLERANCE).all():
                    return poses, ahead
        return None

    def together(
        self, q: Array, before: DriveInputs, inputs: DriveInputs, held: ActiveStops
    ) -> Array | None:
        """Find the equilibria (n, poses) of the next samples, each one from q (1, poses).

        None if one of them is too far from q, or if a joint meets or leaves a stop before it.
        """
        if (way := self.iterate_newton(np.repeat(q, len(inputs[0]), axis=0), inputs, held)) is None:
            return None
        poses, ahead = way
        found = self.equations(poses, *inputs, held)
        each = zip(poses, found.forces, strict=True)
        if not all(self.switched(pose, forces, held) == held for pose, forces in each):
            return None
        accepted = (found.least > MIN_RELATIVE_STIFFNESS).all() and not self.turned(
            poses, ahead, found, before, held
        )
        return poses if accepted else None

    def turned(
        self, poses: Array, ahead: Array, found: Equations, before: DriveInputs, held: ActiveStops
    ) -> bool:
        """Whether one of the equilibria lies beyond a snap.

        Then the step back from it is not the opposite of the step `ahead` (n, rates).
        """
        back = self.equations(poses, *before, held, found.stiffness)
        steps = np.array([ahead, back.solve_linear(-back.left, -back.gap)])
        steps[..., self.statics.driven] = 0.0
        mismatch, longest = np.abs(steps.sum(axis=0)).max(axis=1), np.abs(steps).max(axis=(0, 2))
        return bool(((mismatch > SNAP_MISMATCH * longest) & (longest > SHORT_FIRST_STEP)).any())

    def switched(self, q: Array, forces: Array, held: ActiveStops) -> ActiveStops:
        """Update the stops that joints rest on, by the forces s (rows,) at a pose (poses,).

        Stops that would pull are left out, and stops that the pose is beyond are added.
        """
        pushes, largest = forces[forces.size - len(held) :], np.abs(forces).max()
        kept = [
            stop
            for stop, push in zip(held, pushes, strict=True)
            if -stop.side * push > -STOP_FORCE_ROUNDING * largest
        ]
        kept += [
            stop for stop in self.statics.stops if stop not in held and stop.gap(q) < -STOP_ROUNDING
        ]
        return sort_stops(kept)

    def first(self, values: Array, ctrl: Array | None) -> tuple[Array, ActiveStops]:
        """Find the equilibrium (1, poses) that the mechanism falls to from its start pose.

        The drives are at values (1, drives).

        Raises
        ------
        Unstable
            None is found, or it is not stable.
        CannotAssemble
            The loops do not close at the values of the drives.
        """
        q, held = self.statics.begin(values[0])[None], ActiveStops()
        self.count(q)
        for _ in range(MAX_STEPS_TO_EQUILIBRIUM):
            found = self.equations(q, values, ctrl, held)
            step = found.descent_moves()
            size = float(np.abs(step).max(initial=0.0))
            q = self.moved(q, step * min(1.0, MAX_JOINT_MOVE / size if size else 1.0))
            new_stops = self.switched(q[0], found.forces[0], held)
            if size > SAME_STIFFNESS_STEP:  # forces of stops are known at an equilibrium only
                new_stops = sort_stops({*held, *new_stops})
            if size <= STEP_TOLERANCE and new_stops == held:
                if not self.equations(q, values, ctrl, held).least[0] > MIN_RELATIVE_STIFFNESS:
                    raise Unstable("the start pose leads to no stable equilibrium")
                return q, held
            held = new_stops
        raise Unstable("no equilibrium is found from the start pose")

    def count(self, q: Array) -> None:
        """Count the independent rows of loops and drives at the first of poses q."""
        self.rank = (
            self.sizes.size - inverses_and_null_spaces(self.pushed(q[:1], None, ())[1])[1].shape[2]
        )

    def follow(self, values: Array, ctrl: Array | None) -> tuple[Array, list[ActiveStops]]:
        """Follow equilibria (n, poses) along values (n, drives) and controls (n, controls).

        The list has the stops that joints rest on at each of them.

        Raises
        ------
        Unstable
            The equilibrium becomes unstable on the way, or none is found from the start pose.
        SingularHere
            A limit position lies on the way.
        """

        def inputs_between(k: int, share: float) -> DriveInputs:
            own = values[k - 1] + share * (values[k] - values[k - 1])
            if ctrl is None or len(ctrl) == 1:
                return own[None], ctrl
            return own[None], (ctrl[k - 1] + share * (ctrl[k] - ctrl[k - 1]))[None]

        begin = values[:1], None if ctrl is None else ctrl[:1]
        current, held = self.first(*begin)
        poses, stops, k, block_size = [current], [held], 1, 1
        while k < len(values):
            numbers, before = slice(k, min(k + block_size, len(values))), inputs_between(k, 0.0)
            controls = ctrl if ctrl is None or len(ctrl) == 1 else ctrl[numbers]
            block = (
                self.together(current, before, (values[numbers], controls), held)
                if block_size > 1
                else None
            )
            if block is not None:
                current, block_size = block[-1:], min(2 * block_size, MAX_SAMPLES_TOGETHER)
            elif block_size > 1:
                block_size //= 2
                continue
            else:
                done, stride = 0.0, 1.0
                while done < 1.0:
                    share = min(done + stride, 1.0)
                    inputs = inputs_between(k, share)
                    if found := self.next(current, before, inputs, held):
                        (current, held), before, done, stride = found, inputs, share, 2 * stride
                    elif (stride := stride / 2) < MIN_STRIDE:
                        raise self.ending(current, *before, held, k)
                block, block_size = current, 2 if stride >= 1.0 else 1
            poses.append(block)
            stops += [held] * len(block)
            k += len(block)
        return np.concatenate(poses), stops

    def ending(
        self, q: Array, values: Array, ctrl: Array | None, held: ActiveStops, k: int
    ) -> CannotMove:
        """Make the error that says why the path ends at a pose (1, poses) before sample k."""
        place = ", ".join(f"{value:.6g}" for value in values[0])
        where = f"with the drives at {place}, between samples {k - 1} and {k}"
        sizes = np.linalg.svd(self.pushed(q, ctrl, held)[1][0], compute_uv=False)
        if sizes[self.rank + len(held) - 1] < LIMIT_POSITION_RATIO * sizes[0]:
            return SingularHere(f"a limit position lies on the way: {where}")
        return Unstable(f"the equilibrium becomes unstable {where}")

    def beside(
        self,
        q: Array,
        stops: Sequence[ActiveStops],
        values: Array,
        rate: Array,
        ctrl: Array | None,
        ctrl_rate: Array | None,
    ) -> tuple[Array, Array]:
        """Rates along the path (n, rates), and forces of stops on the joints (n, rates).

        They belong to equilibria q, rates of the drives (n, drives) and rates of the controls
        (n, controls).
        """
        v, pushes = np.zeros((2, len(q), self.sizes.size))
        self.count(q)
        for held in dict.fromkeys(stops):
            own = np.array([k for k, one in enumerate(stops) if one == held])
            now, ctrl_rates = (
                None if c is None else np.broadcast_to(c, (len(q), c.shape[1]))[own]
                for c in (ctrl, ctrl_rate)
            )
            found = self.equations(q[own], values[own], now, held, fine=True)
            force_rates = np.zeros_like(found.left)
            if now is not None and ctrl_rates is not None and ctrl_rates.any():
                ends = [
                    self.pushed(q[own], now + side * ctrl_rates, held)[0] for side in (0.5, -0.5)
                ]
                force_rates = ends[0] - ends[1]
            gaps, first = np.zeros_like(found.gap), found.gap.shape[1] - len(held)
            driven = slice(first - rate.shape[1], first)
            gaps[:, driven] = rate[own] / self.sizes[self.statics.driven]
            v[own] = found.solve_linear(-force_rates, gaps) * self.sizes
            for place, stop in enumerate(held, first):
                pushes[own, stop.rate] = found.forces[:, place] / stop.size
        return v, pushes


def inverses_and_null_spaces(rows: Array) -> tuple[Array, Array]:
    """Pseudo-inverses (n, rates, rows) of rows (n, rows, rates), and bases of their null spaces.

    Raises
    ------
    SingularHere
        The matrices have different ranks.
    """
    left, values, right = np.linalg.svd(rows)
    ranks = (
        values > EQUILIBRIUM_RANK_TOLERANCE * values.max(axis=1, keepdims=True, initial=0.0)
    ).sum(axis=1)
    if np.ptp(ranks):
        raise SingularHere("the rows of loops and drives lose rank on the way")
    rank, right = int(ranks[0]), right.swapaxes(1, 2)
    inverse = (right[..., :rank] / values[:, None, :rank]) @ left[..., :rank].swapaxes(1, 2)
    return np.asarray(inverse), np.asarray(right[..., rank:])


def sort_stops(stops: Iterable[Stop]) -> ActiveStops:
    """Sort stops by their joints, so that equal sets of stops are equal tuples."""
    return tuple(sorted(stops, key=lambda stop: (stop.rate, stop.side)))
