r"""Following one assembly mode along the motion of the drives, with every step proven.

From a closed pose the tangent T predicts the next one.  Newton's method from the prediction
converges to the pose on the *same branch* if the step is short.  With β the norm of the inverse
Jacobian and L a Lipschitz bound of the Jacobian, the Newton-Kantorovich theorem holds all along the
step if

    |T Δθ|  <=  1 / (2 β L).

Poses of the whole way are guessed first, without proof, and then checked by the theorem all at
once: each pose must be where the tangent of the pose before it leads, so that no other branch is
near.  Where steps are too long, poses are inserted.

Towards a limit position β grows, and the steps shrink in proportion to the way that remains.  There
the branch is followed step by step and ends at its limit position, to rounding.  Over a change
point, where two branches cross, one long step goes along the smooth branch.

P. Deuflhard, Newton Methods for Nonlinear Problems, Springer 2011, theorem 2.1 and section 5.1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import (
    CannotAssemble,
    CannotMove,
    SingularHere,
    interpolate_cubic,
)
from proofmass.analytic.planar.kinematics import (
    CLOSING_TOLERANCE,
    Drives,
    close_loops,
    count_dof,
    iterate_newton,
    joint_rates,
    lipschitz,
    nearest_pose,
    scaled_jacobian,
)
from proofmass.analytic.planar.mechanism import (
    Mechanism,
    Mirrored,
)
from proofmass.base.arrays import Array, Index

STEP_SHARE = 0.8
"""Share of the proven step that is taken, so that poses between need fewer Newton steps."""
NEWTON_SHARE = 0.4
"""Largest distance from the prediction to the pose that Newton's method finds, as a share of the
proven step; a bound from the same theorem."""
LEAP_STEP = 1e-5
"""Length of a step of the drives [rad, or sizes] below which a change point is looked for."""
MIN_STEP = 1e-11
"""Length of a step of the drives [rad, or sizes] below which the branch has ended."""
MIN_START_STEP = 1e-5
"""Proven step [rad, or sizes] below which the rounding of a start pose may decide its branch."""
MAX_KINK = 0.05
"""Largest relative change of the velocity over a change point that still counts as smooth."""
GUESS_STEP = 0.1
"""Way of the drives [rad, or sizes] between two poses that are guessed."""
MIN_GUESS_STEP = 1e-3
"""Smallest way between two poses that are guessed [rad, or sizes]."""
MAX_CORRECTION_SHARE = 0.2
"""Largest correction of a guessed pose by Newton's method, as a share of the step to it: a larger
one suggests another branch."""
MAX_GUESS_ITERATIONS = 5
"""Largest number of Newton steps for a guessed pose."""
MAX_PARTS = 8
"""Largest number of steps into which an unproven step is divided at once."""
MAX_DIVISIONS = 6
"""Largest number of times that unproven steps are divided."""
MAX_KNOTS = 20_000
"""Largest number of knots that are found at once; a way that needs more is followed step by
step."""
INPUT_WINDOW = 64
"""Number of inputs ahead that a single step is tested to reach."""


@dataclass(frozen=True)
class Knots:
    """Closed poses of a branch with tangents, in units `Mechanism.scale`, and proven steps.

    `radius` is the length of the proven step.  `orientation` is the sign of the determinant of the
    Jacobian, which is constant on a branch, and `regular` its absolute value, which falls to zero
    in a singular pose.  A single pose has no first axis.
    """

    q: Array
    tangent: Array
    radius: Array
    orientation: Array
    regular: Array

    def __getitem__(self, which: int | slice | Index | None) -> Self:
        return type(self)(*(part[which] for part in vars(self).values()))

    def __len__(self) -> int:
        return len(self.q)

    @classmethod
    def joined(cls, some: Sequence[Self]) -> Self:
        """Concatenate several sets of knots."""
        parts = zip(*(vars(one).values() for one in some), strict=True)
        return cls(*map(np.concatenate, parts))


@dataclass(frozen=True)
class DrivePath:
    """The polygon through values of the drives, with its arc length as parameter.

    Attributes
    ----------
    at : ndarray (n,)
        Arc length at each corner, in units of `Mechanism.scale`, from 0 on [1].
    corners : ndarray (n, drives)
        Values of the drives [rad or m].
    """

    at: Array
    corners: Array

    @classmethod
    def through(cls, corners: Array, scale: Array) -> Self:
        """Make the polygon through values of the drives (n, drives)."""
        sides = np.linalg.norm(np.diff(corners, axis=0) / scale, axis=1)
        return cls(np.append(0.0, np.cumsum(sides)), corners)

    def inputs(self, lengths: Array) -> Array:
        """Values of the drives (k, drives) at arc lengths (k,)."""
        return np.stack([np.interp(lengths, self.at, values) for values in self.corners.T], axis=1)


class Branch:
    """One branch of a mechanism, from its start pose on.

    Parameters
    ----------
    m : Mechanism
    names : tuple of str
        The driven joints, as many as the mechanism has degrees of freedom.

    Raises
    ------
    CannotAssemble, Overconstrained, SingularHere
        The start pose does not close, its loops are not independent, or the drives do not
        determine it.
    """

    def __init__(self, m: Mechanism, names: tuple[str, ...]):
        self.m, self.d = m, Drives.of(m, names)
        q = nearest_pose(m, m.start)
        free = count_dof(m, q)
        if free != len(names):
            raise SingularHere(
                f"the mechanism has {free} degree(s) of freedom, and {len(names)} driven "
                f"joint(s): {', '.join(names)}"
            )
        self.bound = lipschitz(m, q[None])
        self.scale = m.scale[self.d.driven]
        self.knot = self.last = self.at(q)
        if not self.knot.radius > MIN_START_STEP:
            raise SingularHere(
                f"the start pose, {self.format_drives(q[self.d.driven])}, is singular and "
                f"chooses no branch: start elsewhere"
            )

    def follow(self, inputs: Array) -> tuple[Array, CannotMove | None]:
        """Follow the branch over inputs (n, drives).

        Returns
        -------
        q : ndarray (k, joints)
            Closed poses [rad or m], k = n unless the branch ends before.
        failure : CannotMove or None
            Why it ended.
        """
        knots, reached_by, failure = self.walk(inputs)
        return self.close(inputs[: len(reached_by)], knots[reached_by]), failure

    def walk(self, inputs: Array) -> tuple[Knots, Index, CannotMove | None]:
        """Find the knots on the way over inputs (n, drives), the present knot being the first.

        For each input that the branch reaches, the index array has the number of the knot whose
        proven step reaches it; the last value says why the branch ended, if it did.  Knots are
        found all at once, and once more after a change point; where they cannot be proven, the
        branch is followed knot by knot.
        """
        found, numbers, count, done = list[Knots](), list[Index](), 0, 0
        leap_at, at_once, failure = LEAP_STEP, True, None
        while True:
            remaining = inputs[done:]
            knots, reached_by = (
                self.find_knots(remaining) if at_once else self.reached(remaining[:INPUT_WINDOW])
            )
            found.append(knots)
            numbers.append(reached_by + count)
            count, done = count + len(knots), done + len(reached_by)
            if done == len(inputs):
                break
            last_reaches = len(reached_by) and reached_by[-1] == len(knots) - 1
            side = self.knot.orientation
            try:
                leap_at = self.advance(inputs[done - 1 if last_reaches else done], leap_at)
            except CannotMove as error:
                failure = error
                break
            at_once = bool(self.knot.orientation != side)
        return Knots.joined(found), np.concatenate(numbers), failure

    def find_knots(self, inputs: Array) -> tuple[Knots, Index]:
        """Find knots all at once from the present one on, as far as they are proven.

        The index array has the number of the knot that reaches each input, as far as one does.  The
        last proven knot becomes the present one.
        """
        try:
            way = DrivePath.through(np.vstack([self.knot.q[self.d.driven], inputs]), self.scale)
            lengths, q = self.guess(way)
            knots = self.known(q)
            for _ in range(MAX_DIVISIONS):
                parts, by, reaches = self.parts(way, lengths, knots)
                if (parts <= 1).all() or len(lengths) > MAX_KNOTS:
                    break
                between, q = self.divide(way, lengths, knots, parts)
                order = np.argsort(np.append(lengths, between), kind="stable")
                lengths = np.append(lengths, between)[order]
                knots = Knots.joined([knots, self.known(q)])[order]
            else:
                parts, by, reaches = self.parts(way, lengths, knots)
        except CannotMove:
            return self.reached(inputs)
        last = int(np.argmin(np.append(parts <= 1, False)))
        is_reached = np.append(reaches & (by <= last), False)
        self.last, self.knot = knots[max(last - 1, 0)], knots[last]
        return knots[: last + 1], by[: int(np.argmin(is_reached))]

    def guess(self, way: DrivePath) -> tuple[Array, Array]:
        """Guess arc lengths on the way (k,) and closed poses there (k, joints).

        They go as far as Newton's method finds poses near the prediction by tangent and curvature,
        which makes it likely, but does not prove, that they are on the branch.
        """
        m, d, q, block_size = self.m, self.d, self.knot.q[None], 4
        lengths = np.linspace(0.0, way.at[-1], int(np.ceil(way.at[-1] / GUESS_STEP)) + 1)
        while (done := len(q)) < len(lengths):
            ahead = self.predict_by_curvature(q[-1], way.inputs(lengths[done : done + block_size]))
            closed_poses = ahead.copy()
            with np.errstate(all="ignore"):  # Newton's method may diverge
                closed = (
                    iterate_newton(m, closed_poses, d, MAX_GUESS_ITERATIONS) < CLOSING_TOLERANCE
                )
                correction = np.linalg.norm((closed_poses - ahead) / m.scale, axis=1)
                accepted = closed & (
                    correction
                    <= MAX_CORRECTION_SHARE * np.linalg.norm((ahead - q[-1]) / m.scale, axis=1)
                )
            count = int(np.argmin(np.append(accepted, False)))
            q, block_size = np.concatenate([q, closed_poses[:count]]), 2 * count + 2
            if not count:
                if lengths[done] - lengths[done - 1] < MIN_GUESS_STEP:
                    break
                lengths = np.insert(lengths, done, lengths[done - 1 : done + 1].mean())
        return lengths[: len(q)], q

    def predict_by_curvature(self, q: Array, inputs: Array) -> Array:
        """Predict poses (n, joints) at inputs by tangent and curvature at a closed pose."""
        ahead = inputs - q[self.d.driven]
        v, a = joint_rates(
            self.m, np.repeat(q[None], len(ahead), axis=0), self.d, ahead, 0.0 * ahead
        )
        found = q + v + 0.5 * a
        found[:, self.d.driven] = inputs
        return np.asarray(found)

    def parts(
        self, way: DrivePath, lengths: Array, knots: Knots
    ) -> tuple[Array, Index, NDArray[np.bool_]]:
        """Number of steps into which the step from each knot to the next must be divided.

        The number is 1 (or 0) where the step is proven.  For each corner of the way but the first,
        the other two arrays have the number of the last knot before it, and whether the proven step
        of that knot reaches it.
        """
        by = np.searchsorted(lengths, way.at[1:], "right") - 1
        _, moves, radius = self.beside(way.corners[1:], knots[by])
        corners = moves / (STEP_SHARE * radius)
        ahead, moves, radius = self.beside(way.inputs(lengths[1:]), knots[:-1])
        parts = np.append(moves / (STEP_SHARE * radius), 0.0)
        np.maximum.at(parts, by, corners)
        distance = np.linalg.norm((knots.q[1:] - ahead) / self.m.scale, axis=1)
        unproven = (distance > NEWTON_SHARE * radius) | (np.diff(knots.orientation) != 0)
        return (
            np.ceil(np.where(unproven, np.maximum(parts[:-1], 2.0), parts[:-1])),
            by,
            corners <= 1.0,
        )

    def divide(
        self, way: DrivePath, lengths: Array, knots: Knots, parts: Array
    ) -> tuple[Array, Array]:
        """Arc lengths (k,) that divide steps into `parts`, and closed poses there (k, joints)."""
        count = np.minimum(np.maximum(parts, 1.0), MAX_PARTS).astype(int) - 1
        step = np.repeat(np.arange(len(count)), count)
        first_parts = np.repeat(np.cumsum(count) - count, count)
        share = ((np.arange(len(step)) - first_parts + 1) / (count[step] + 1))[:, None]
        between = lengths[step] + share[:, 0] * (lengths[step + 1] - lengths[step])
        ends = way.inputs(lengths)
        ahead = (ends[step + 1] - ends[step]) / self.scale
        begin, end = (
            np.einsum("njd,nd->nj", knots.tangent[k], ahead) * self.m.scale
            for k in (step, step + 1)
        )
        q = interpolate_cubic(share, knots.q[step], knots.q[step + 1], begin, end)
        q[:, self.d.driven] = way.inputs(between)
        return between, close_loops(self.m, q, self.d)

    def reached(self, inputs: Array) -> tuple[Knots, Index]:
        """The present knot, and its number 0 for each of the first inputs that it reaches."""
        is_reached = np.append(self.far(inputs) <= STEP_SHARE * self.knot.radius, False)
        return self.knot[None], np.zeros(int(np.argmin(is_reached)), np.intp)

    def close(self, inputs: Array, knots: Knots) -> Array:
        """Find closed poses (n, joints) at inputs (n, drives), each from a knot that reaches it."""
        guess, _, proven = self.beside(inputs, knots)
        q = close_loops(self.m, guess, self.d)
        moved = np.linalg.norm((q - guess) / self.m.scale, axis=1)
        if not (moved <= NEWTON_SHARE * proven).all():
            worst = int(np.argmax(moved > NEWTON_SHARE * proven))
            raise Mirrored(f"another assembly mode at {self.format_drives(inputs[worst])}")
        return q

    def beside(self, inputs: Array, knots: Knots) -> tuple[Array, Array, Array]:
        """Predict poses (n, joints) at inputs (n, drives) by the tangents of their knots.

        The other two arrays have the lengths of these moves (n,) and of the proven steps (n,), in
        units of `Mechanism.scale`.
        """
        ahead = (inputs - knots.q[:, self.d.driven]) / self.scale
        move = np.einsum("njd,nd->nj", knots.tangent, ahead)
        guess = knots.q + move * self.m.scale
        guess[:, self.d.driven] = inputs
        return guess, np.linalg.norm(move, axis=1), knots.radius

    def at(self, q: Array) -> Knots:
        """Make the knot of a closed pose (joints,)."""
        return self.known(q[None])[0]

    def known(self, q: Array) -> Knots:
        """Make the knots of closed poses (n, joints).

        Raises
        ------
        SingularHere
            One of them is singular.
        """
        m, d = self.m, self.d
        matrix = scaled_jacobian(m, q)
        square = matrix[..., d.following]
        least = np.linalg.svd(square, compute_uv=False).min(axis=-1, initial=np.inf)
        if not (least > 1e-14).all():
            raise SingularHere(f"singular at {self.format_drives(q[np.argmin(least), d.driven])}")
        tangent = np.zeros((*q.shape, d.driven.size))
        tangent[:, d.driven] = np.eye(d.driven.size)
        tangent[:, d.following] = -np.linalg.solve(square, matrix[..., d.driven])
        bound = self.bound if m.hinges.all() else lipschitz(m, q)
        with np.errstate(divide="ignore"):  # in an open chain the bound is 0: any step is proven
            radius = 0.5 * least / bound
        sign, logarithm = np.linalg.slogdet(square)
        return Knots(q, tangent, radius, sign, np.exp(logarithm))

    def predict(self, inputs: Array) -> Array:
        """Predict poses (n, joints) at inputs (n, drives) by the tangent of the present knot."""
        ahead = (inputs - self.knot.q[self.d.driven]) / self.scale
        q = self.knot.q + (ahead @ self.knot.tangent.T) * self.m.scale
        q[:, self.d.driven] = inputs
        return np.asarray(q)

    def far(self, inputs: Array) -> Array:
        """Lengths (n,) of the predicted moves to inputs (n, drives), in units `Mechanism.scale`."""
        return np.linalg.norm((self.predict(inputs) - self.knot.q) / self.m.scale, axis=1)

    def advance(self, inputs: Array, leap_at: float) -> float:
        """Take one proven step towards inputs (drives,), or leap if it is shorter than `leap_at`.

        The step length at which the next leap is tried is returned.
        """
        here = self.knot.q[self.d.driven]
        distance = float(np.linalg.norm((inputs - here) / self.scale))
        if distance == 0.0:
            return leap_at
        part = min(
            1.0, STEP_SHARE * float(self.knot.radius) / float(self.far(inputs[None])[0] or distance)
        )
        if part < 1.0 and part * distance < leap_at:
            if self.leap(inputs, distance):
                return LEAP_STEP
            if part * distance < MIN_STEP:
                raise SingularHere(
                    f"limit position at {self.format_drives(here)}: the branch goes no "
                    f"further in this direction"
                )
            leap_at *= 0.1
        self.step(inputs if part == 1.0 else here + part * (inputs - here))
        return leap_at

    def step(self, inputs: Array) -> None:
        """Close the loops at inputs within the proven step, and make this the present knot."""
        knot = self.at(close_loops(self.m, self.predict(inputs[None]), self.d)[0])
        if knot.orientation != self.knot.orientation:
            if self.knot.radius > LEAP_STEP:
                raise Mirrored(f"another assembly mode at {self.format_drives(inputs)}")
            raise SingularHere(f"singular at {self.format_drives(inputs)}")
        self.last, self.knot = self.knot, knot

    def leap(self, inputs: Array, distance: float) -> bool:
        """Try to pass a change point on the way to inputs; False if there is none.

        Near a change point the determinant of the Jacobian is linear in the way, so that the
        distance to its zero is known.  A step of second order goes as far behind the zero.  If the
        velocity is smooth and the determinant has changed its sign there, it was a change point.
        """
        here, before = self.knot.q[self.d.driven], self.last.q[self.d.driven]
        determinant = float(self.knot.regular)
        decrease = float(self.last.regular) - determinant
        if decrease <= 0.0:
            return False
        leap_length = (
            2 * determinant * float(np.linalg.norm((here - before) / self.scale)) / decrease
        )
        drive_step = (inputs - here) / distance * min(leap_length, distance)
        pose = self.knot.q[None]
        v, a = joint_rates(self.m, pose, self.d, drive_step[None], np.zeros((1, drive_step.size)))
        guess = pose + v + 0.5 * a
        guess[:, self.d.driven] = here + drive_step
        try:
            knot = self.at(close_loops(self.m, guess, self.d)[0])
            after, _ = joint_rates(
                self.m, knot.q[None], self.d, drive_step[None], 0 * drive_step[None]
            )
        except (CannotAssemble, SingularHere):
            return False
        kink = np.linalg.norm((after - v - a) / self.m.scale)
        if kink > MAX_KINK * np.linalg.norm(v / self.m.scale) or (
            knot.orientation == self.knot.orientation
        ):
            return False
        self.last = self.knot = knot
        return True

    def format_drives(self, inputs: Array) -> str:
        """Format the names of the driven joints with their values."""
        names = [self.m.joints[j].name for j in self.d.driven]
        return ", ".join(f"{n} = {v:.9g}" for n, v in zip(names, inputs, strict=True))
