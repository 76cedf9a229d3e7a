r"""Following one assembly mode along the motion of the drives, with proof at every step.

From a closed pose the tangent T predicts the next.  Newton's method from there converges to the
pose on the *same branch* if the step is short: with β the norm of the inverse Jacobian and L a
bound of how fast the Jacobian changes, the Newton-Kantorovich theorem holds all the way along the
step if

    |T Δθ|  <=  1 / (2 β L).

Poses of the whole way are guessed first, which proves nothing, and then held against the theorem
all at once: the next pose must be where the tangent of the one before it leads, so that no other
branch is near.  Where steps are too long, poses are put between.

Towards a limit position β grows and the steps shrink in proportion to what is left of the way.
There the branch is followed step by step, and ends at its limit position, to rounding.  A change
point, where two branches cross, is leapt over along the smooth one.

P. Deuflhard, Newton Methods for Nonlinear Problems, Springer 2011, theorem 2.1 and section 5.1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import Array, CannotAssemble, CannotMove, Index, SingularHere
from proofmass.analytic.planar.kinematics import (
    CLOSED,
    Drives,
    approach,
    count_dof,
    lipschitz,
    nearest,
    newton,
    rates,
    scaled_jacobian,
)
from proofmass.analytic.planar.mechanism import (
    Mechanism,
    Mirrored,
)

SHARE = 0.8
"""Share of the proven step that is taken: the poses between then need fewer Newton steps."""
NEAR = 0.4
"""Newton ends within this share of the proven step from where it starts, by the same theorem."""
CREEP = 1e-5
"""Steps along the drives that are shorter [rad, or sizes] make it look for a change point."""
STUCK = 1e-11
"""Steps that are shorter are the end of the branch."""
UNSURE = 1e-5
"""Proven step [rad, or sizes] of a start pose below which its rounding may choose the branch."""
KINK = 0.05
"""Largest relative change of a velocity over a change point that still counts as smooth."""
STRIDE = 0.1
"""Way of the drives [rad, or sizes] between poses that are guessed, before any is proven."""
SHORTEST = 1e-3
"""Way between two of them below which no further pose is guessed."""
STRAY = 0.2
"""Share of a guessed step by which Newton may correct it: more hints at another branch."""
TRIED = 5
"""Newton steps that a guessed pose may take."""
PARTS = 8
"""Most steps that an unproven one is divided into at once."""
ROUNDS = 6
"""Times that steps are divided."""
MOST = 20_000
"""Knots that are found at once; a way that asks for more is followed step by step."""
WINDOW = 64
"""Inputs that are looked at for a step."""


@dataclass(frozen=True)
class Knots:
    """Closed poses, their tangents in own units, and how far these are proven.

    `orientation` is the sign of the Jacobian's determinant, which a branch keeps, and `regular` its
    size, which falls to zero in a singular pose.  A single pose has no first axis.
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
        """All of them one after the other."""
        parts = zip(*(vars(one).values() for one in some), strict=True)
        return cls(*map(np.concatenate, parts))


@dataclass(frozen=True)
class Way:
    """The polygon of the drives' values, by its length in own units.

    Attributes
    ----------
    at : ndarray (n,)
        Where each corner is, in own units (`Mechanism.scale`) [1], from 0 on.
    corners : ndarray (n, drives)
        Values of the drives [rad or m].
    """

    at: Array
    corners: Array

    @classmethod
    def through(cls, corners: Array, scale: Array) -> Self:
        """The way through values of the drives (n, drives)."""
        sides = np.linalg.norm(np.diff(corners, axis=0) / scale, axis=1)
        return cls(np.append(0.0, np.cumsum(sides)), corners)

    def inputs(self, at: Array) -> Array:
        """Values of the drives (k, drives) at places on it (k,)."""
        return np.stack([np.interp(at, self.at, values) for values in self.corners.T], axis=1)


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
        The start pose does not close, holds something twice, or leaves a degree of freedom.
    """

    def __init__(self, m: Mechanism, names: tuple[str, ...]):
        self.m, self.d = m, Drives.of(m, names)
        q = nearest(m, m.start)
        free = count_dof(m, q)
        if free != len(names):
            raise SingularHere(
                f"the mechanism has {free} degree(s) of freedom, and {len(names)} driven "
                f"joint(s): {', '.join(names)}"
            )
        self.bound = lipschitz(m, q[None])
        self.scale = m.scale[self.d.driven]
        self.knot = self.last = self.at(q)
        if not self.knot.radius > UNSURE:
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
        """Knots on the way over inputs (n, drives), the first of them where the branch stands.

        And for each of the inputs that the branch goes to the number of the knot that reaches it,
        and why it ended.  Its knots are found all at once, and behind a change point again; from
        where that cannot be proven on, one after the other.
        """
        found, numbers, count, done = list[Knots](), list[Index](), 0, 0
        leap_at, at_once, failure = CREEP, True, None
        while True:
            rest = inputs[done:]
            knots, by = self.trace(rest) if at_once else self.reached(rest[:WINDOW])
            found.append(knots)
            numbers.append(by + count)
            count, done = count + len(knots), done + len(by)
            if done == len(inputs):
                break
            last_reaches = len(by) and by[-1] == len(knots) - 1
            side = self.knot.orientation
            try:
                leap_at = self.advance(inputs[done - 1 if last_reaches else done], leap_at)
            except CannotMove as error:
                failure = error
                break
            at_once = bool(self.knot.orientation != side)
        return Knots.joined(found), np.concatenate(numbers), failure

    def trace(self, inputs: Array) -> tuple[Knots, Index]:
        """Knots from the present one on, and the number of the one that reaches each of the inputs.

        As far as all of them are proven; the last one is then the present knot.
        """
        try:
            way = Way.through(np.vstack([self.knot.q[self.d.driven], inputs]), self.scale)
            at, q = self.guess(way)
            knots = self.known(q)
            for _ in range(ROUNDS):
                parts, by, near = self.parts(way, at, knots)
                if (parts <= 1).all() or len(at) > MOST:
                    break
                between, q = self.divide(way, at, knots, parts)
                order = np.argsort(np.append(at, between), kind="stable")
                at = np.append(at, between)[order]
                knots = Knots.joined([knots, self.known(q)])[order]
            else:
                parts, by, near = self.parts(way, at, knots)
        except CannotMove:
            return self.reached(inputs)
        last = int(np.argmin(np.append(parts <= 1, False)))
        fits = np.append(near & (by <= last), False)
        self.last, self.knot = knots[max(last - 1, 0)], knots[last]
        return knots[: last + 1], by[: int(np.argmin(fits))]

    def guess(self, way: Way) -> tuple[Array, Array]:
        """Places on the way (k,) and closed poses there (k, joints), as far as Newton finds any.

        In all likelihood they are on the branch: Newton hardly moves what the curvature predicts.
        """
        m, d, q, room = self.m, self.d, self.knot.q[None], 4
        at = np.linspace(0.0, way.at[-1], int(np.ceil(way.at[-1] / STRIDE)) + 1)
        while (done := len(q)) < len(at):
            ahead = self.curved(q[-1], way.inputs(at[done : done + room]))
            there = ahead.copy()
            with np.errstate(all="ignore"):  # of a pose that runs away
                closed = approach(m, there, d, TRIED) < CLOSED
                stray = np.linalg.norm((there - ahead) / m.scale, axis=1)
                fine = closed & (stray <= STRAY * np.linalg.norm((ahead - q[-1]) / m.scale, axis=1))
            count = int(np.argmin(np.append(fine, False)))
            q, room = np.concatenate([q, there[:count]]), 2 * count + 2
            if not count:
                if at[done] - at[done - 1] < SHORTEST:
                    break
                at = np.insert(at, done, at[done - 1 : done + 1].mean())
        return at[: len(q)], q

    def curved(self, q: Array, inputs: Array) -> Array:
        """Poses (n, joints) that tangent and curvature at a closed pose predict at inputs."""
        ahead = inputs - q[self.d.driven]
        v, a = rates(self.m, np.repeat(q[None], len(ahead), axis=0), self.d, ahead, 0.0 * ahead)
        found = q + v + 0.5 * a
        found[:, self.d.driven] = inputs
        return np.asarray(found)

    def parts(self, way: Way, at: Array, knots: Knots) -> tuple[Array, Index, NDArray[np.bool_]]:
        """Into how many steps the one between each knot and the next must be divided; 1: proven.

        And of the corners of the way but the first: the number of the last knot before each, and
        whether that one reaches it.
        """
        by = np.searchsorted(at, way.at[1:], "right") - 1
        _, moves, radius = self.beside(way.corners[1:], knots[by])
        corners = moves / (SHARE * radius)
        ahead, moves, radius = self.beside(way.inputs(at[1:]), knots[:-1])
        parts = np.append(moves / (SHARE * radius), 0.0)
        np.maximum.at(parts, by, corners)
        off = np.linalg.norm((knots.q[1:] - ahead) / self.m.scale, axis=1)
        other = (off > NEAR * radius) | (np.diff(knots.orientation) != 0)
        return np.ceil(np.where(other, np.maximum(parts[:-1], 2.0), parts[:-1])), by, corners <= 1.0

    def divide(self, way: Way, at: Array, knots: Knots, parts: Array) -> tuple[Array, Array]:
        """Places (k,) that divide steps into so many parts, and closed poses there (k, joints)."""
        count = np.minimum(np.maximum(parts, 1.0), PARTS).astype(int) - 1
        step = np.repeat(np.arange(len(count)), count)
        first = np.repeat(np.cumsum(count) - count, count)
        share = ((np.arange(len(step)) - first + 1) / (count[step] + 1))[:, None]
        between = at[step] + share[:, 0] * (at[step + 1] - at[step])
        ends = way.inputs(at)
        ahead = (ends[step + 1] - ends[step]) / self.scale
        begin, end = (
            np.einsum("njd,nd->nj", knots.tangent[k], ahead) * self.m.scale
            for k in (step, step + 1)
        )
        q = cubic(share, knots.q[step], knots.q[step + 1], begin, end)
        q[:, self.d.driven] = way.inputs(between)
        return between, newton(self.m, q, self.d)

    def reached(self, inputs: Array) -> tuple[Knots, Index]:
        """The present knot, and its number 0 for each of the first inputs that it reaches."""
        near = np.append(self.far(inputs) <= SHARE * self.knot.radius, False)
        return self.knot[None], np.zeros(int(np.argmin(near)), np.intp)

    def close(self, inputs: Array, knots: Knots) -> Array:
        """Closed poses (n, joints) at inputs (n, drives), each from a knot that reaches it."""
        guess, _, proven = self.beside(inputs, knots)
        q = newton(self.m, guess, self.d)
        moved = np.linalg.norm((q - guess) / self.m.scale, axis=1)
        if not (moved <= NEAR * proven).all():
            bad = int(np.argmax(moved > NEAR * proven))
            raise Mirrored(f"mirrored at {self.format_drives(inputs[bad])}")
        return q

    def beside(self, inputs: Array, knots: Knots) -> tuple[Array, Array, Array]:
        """Poses (n, joints) that the knots' tangents predict at inputs (n, drives).

        And the lengths of these moves, in own units (n,), and how far each is proven (n,).
        """
        ahead = (inputs - knots.q[:, self.d.driven]) / self.scale
        move = np.einsum("njd,nd->nj", knots.tangent, ahead)
        guess = knots.q + move * self.m.scale
        guess[:, self.d.driven] = inputs
        return guess, np.linalg.norm(move, axis=1), knots.radius

    def at(self, q: Array) -> Knots:
        """What is known at a closed pose (joints,)."""
        return self.known(q[None])[0]

    def known(self, q: Array) -> Knots:
        """What is known at closed poses (n, joints).

        Raises
        ------
        SingularHere
            One of them is singular.
        """
        m, d = self.m, self.d
        matrix = scaled_jacobian(m, q)
        square = matrix[..., d.following]
        least = np.linalg.svd(square, compute_uv=False).min(axis=-1, initial=1.0)
        if not (least > 1e-14).all():
            raise SingularHere(f"singular at {self.format_drives(q[np.argmin(least), d.driven])}")
        tangent = np.zeros((*q.shape, d.driven.size))
        tangent[:, d.driven] = np.eye(d.driven.size)
        tangent[:, d.following] = -np.linalg.solve(square, matrix[..., d.driven])
        bound = self.bound if m.hinges.all() else lipschitz(m, q)
        with np.errstate(divide="ignore"):  # of an open chain, which every step is proven in
            radius = 0.5 * least / bound
        sign, logarithm = np.linalg.slogdet(square)
        return Knots(q, tangent, radius, sign, np.exp(logarithm))

    def predict(self, inputs: Array) -> Array:
        """Poses (n, joints) that the tangent predicts at inputs (n, drives)."""
        ahead = (inputs - self.knot.q[self.d.driven]) / self.scale
        q = self.knot.q + (ahead @ self.knot.tangent.T) * self.m.scale
        q[:, self.d.driven] = inputs
        return np.asarray(q)

    def far(self, inputs: Array) -> Array:
        """Length of the predicted moves to inputs (n, drives), in own units (n,)."""
        return np.linalg.norm((self.predict(inputs) - self.knot.q) / self.m.scale, axis=1)

    def advance(self, inputs: Array, leap_at: float) -> float:
        """Take one proven step towards inputs (drives,); where it is tiny, look for a leap."""
        here = self.knot.q[self.d.driven]
        way = float(np.linalg.norm((inputs - here) / self.scale))
        if way == 0.0:
            return leap_at
        part = min(1.0, SHARE * float(self.knot.radius) / float(self.far(inputs[None])[0] or way))
        if part < 1.0 and part * way < leap_at:
            if self.leap(inputs, way):
                return CREEP
            if part * way < STUCK:
                raise SingularHere(
                    f"limit position at {self.format_drives(here)}: the branch goes no "
                    f"further in this direction"
                )
            leap_at *= 0.1
        self.step(inputs if part == 1.0 else here + part * (inputs - here))
        return leap_at

    def step(self, inputs: Array) -> None:
        """Close the loops at inputs within the radius, and stand there."""
        knot = self.at(newton(self.m, self.predict(inputs[None]), self.d)[0])
        if knot.orientation != self.knot.orientation:
            if self.knot.radius > CREEP:
                raise Mirrored(f"mirrored at {self.format_drives(inputs)}")
            raise SingularHere(f"singular at {self.format_drives(inputs)}")
        self.last, self.knot = self.knot, knot

    def leap(self, inputs: Array, way: float) -> bool:
        """Try to pass a change point on the way to inputs; False if the branch ends there.

        The Jacobian's determinant passes zero at an even pace, which tells how far the change point
        is.  A second-order step lands as far behind it; if velocities run on smoothly there, and
        the determinant has changed its sign, it was one.
        """
        here, before = self.knot.q[self.d.driven], self.last.q[self.d.driven]
        left = float(self.knot.regular)
        lost = float(self.last.regular) - left
        if lost <= 0.0:
            return False
        ahead = 2 * left * float(np.linalg.norm((here - before) / self.scale)) / lost
        along = (inputs - here) / way * min(ahead, way)
        one = self.knot.q[None]
        v, a = rates(self.m, one, self.d, along[None], np.zeros((1, along.size)))
        guess = one + v + 0.5 * a
        guess[:, self.d.driven] = here + along
        try:
            knot = self.at(newton(self.m, guess, self.d)[0])
            after, _ = rates(self.m, knot.q[None], self.d, along[None], 0 * along[None])
        except (CannotAssemble, SingularHere):
            return False
        kink = np.linalg.norm((after - v - a) / self.m.scale)
        if kink > KINK * np.linalg.norm(v / self.m.scale) or (
            knot.orientation == self.knot.orientation
        ):
            return False
        self.last = self.knot = knot
        return True

    def format_drives(self, inputs: Array) -> str:
        """The driven joints with their values."""
        names = [self.m.joints[j].name for j in self.d.driven]
        return ", ".join(f"{n} = {v:.9g}" for n, v in zip(names, inputs, strict=True))


def cubic(share: Array, begin: Array, end: Array, slope: Array, end_slope: Array) -> Array:
    """Hermite's cubic between values, with slopes at both ends over the whole way."""
    s, rest = share, 1.0 - share
    return np.asarray(
        rest**2 * (1 + 2 * s) * begin
        + s**2 * (1 + 2 * rest) * end
        + s * rest * (rest * slope - s * end_slope)
    )
