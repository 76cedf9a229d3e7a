r"""Rest of a mechanism whose drives leave degrees of freedom to springs, weights and loads.

At rest loops, drives and stops hold what acts on the joints::

    Q(q) + Bᵀ s = 0,    g(q) = 0,    B = dg/dq        g: how far they are open, s: their forces

Newton's method solves both together.  Rows of B may repeat what others hold.  The stiffness, with s
fixed so that it has the curvature of the loops in it, is made of central differences::

    K = -d/dq (Q + Bᵀ s)

A stop, the end of a joint's range, holds its joint while it pushes; one that a joint passes holds
it from then on.  A rest is stable while K, or its symmetric part where loads follow a body, is
positive definite on the null space of B.  The path that the drives lead through rests is followed
in strides, from one rest to the next: a stride is halved until Newton's steps shrink fast, and the
path ends where the rest becomes unstable.  Rates of the path follow from the same equations.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from proofmass.analytic.numerics import Array, CannotMove, Index, SingularHere
from proofmass.analytic.stops import Stop

NUDGE = 6e-6
"""Step of differences [rad, or sizes]: the cube root of rounding, for an error of 1e-10."""
FINEST = 1e-8
"""That where a rest lies so near to where a spring goes slack: still right to 1e-8."""
WIDER = 5e-4
"""Step of differences of fourth order [rad, or sizes], for an error of 1e-12."""
KINKED = 1e-5
"""Of the largest stiffness: differences over once and twice `WIDER` differ by more where a spring
goes slack or a force is clipped."""
FAR = 0.3
"""Longest stride of a joint [rad, or sizes]."""
SHRINKS = 0.25
"""A step of Newton's method to the one before at most, on the way to the next rest."""
SHORT, LONGER, KINKS = 1e-3, 30.0, 3
"""From where the first step is as short [rad, or sizes], steps may grow to so many times that, and
as often."""
TURNED = 0.5
"""Of the longer one: steps ahead from a rest and back to it differ by more across a snap."""
SAME = 1e-5
"""Steps [rad, or sizes] below which the next one needs no new stiffness."""
EXACT = 1e-11
"""Steps [rad, or sizes] below which a rest is found: the next one is rounding."""
MOST = 200
"""Steps from the start pose to the first rest."""
MANY = 32
"""Samples whose rests are found together at most."""
SHORTEST = 1e-7
"""Of the way between two samples: a path that cannot be followed so far has ended."""
LIMIT = 1e-2
"""Least to largest singular value of the rows near a limit position, at the end of a path."""
FLAT = 1e-9
"""Of the largest stiffness: less cannot be distinguished from none by differences."""
TOUCHES = 1e-12
"""Rounding of a joint [rad, or sizes]: beyond its range by more it is past its stop."""
PULLS = 1e-12
"""Of the largest force: rounding of what a stop does."""
RANK = 1e-8
"""Of the largest singular value: rows below it repeat what others hold."""


class Unstable(CannotMove):
    """A rest that the mechanism leaves by itself."""


class Statics(Protocol):
    """A mechanism, what acts on it at rest, and what its loops and drives hold."""

    @property
    def sizes(self) -> Array:
        """What its rates are measured in (rates,): 1 rad, or the size of the mechanism [m]."""

    @property
    def driven(self) -> Index:
        """Where the drives stand in the rates (drives,)."""

    @property
    def stops(self) -> Sequence[Stop]:
        """Of the joints that the drives leave."""

    def begin(self, values: Array) -> Array:
        """The closed pose (poses,) next to the start, with the drives at values (drives,).

        Raises
        ------
        CannotAssemble
            There is none.
        """

    def moved(self, q: Array, way: Array) -> Array:
        """The poses (n, poses) that ways (n, rates) [rad or m] lead to from poses q (n, poses)."""

    def pushed(self, q: Array, ctrl: Array | None) -> tuple[Array, Array, Array]:
        """Forces Q (n, rates) [N m or N] at poses q (n, poses), with controls (n, controls).

        The rows B of loops (n, rows, rates), made free of units [per rad or m], and how far loops
        are open (n, rows).
        """

    def values(self, q: Array) -> Array:
        """Values of the drives (n, drives) [rad or m]."""


@dataclass(frozen=True)
class Equations:
    """The equations of rest at n poses, in the sizes of the rates.

    Attributes
    ----------
    left : ndarray (n, rates)
        Q + Bᵀ s, with the s that leaves least [N m].
    gap : ndarray (n, rows)
        Of loops, drives and stops [1].
    inverse, null : ndarray (n, rates, rows), (n, rates, dof)
        Pseudo-inverse of B, and directions that loops, drives and stops leave [1].
    stiffness : ndarray (n, rates, rates)
        K [N m].
    forces : ndarray (n, rows)
        s [N m].
    independent : bool
        Whether drives and stops repeat nothing.
    """

    left: Array
    gap: Array
    inverse: Array
    null: Array
    stiffness: Array
    forces: Array
    independent: bool

    def solved(self, left: Array, gap: Array) -> Array:
        """Ways (n, rates) that add `left` to the forces and `gap` to the gaps.

        Raises
        ------
        SingularHere
            The equations determine none.
        """
        if not self.independent:
            raise SingularHere("a stop or a drive holds what others hold")
        across = self.null.swapaxes(1, 2)
        close = self.inverse @ gap[..., None]
        needed = across @ (left[..., None] + self.stiffness @ close)
        try:
            free = np.linalg.solve(self.own, needed)
        except np.linalg.LinAlgError:
            raise SingularHere("nothing holds a degree of freedom that the drives leave") from None
        return np.asarray((close - self.null @ free)[..., 0])

    @cached_property
    def own(self) -> Array:
        """K on the degrees of freedom (n, dof, dof)."""
        return np.asarray(self.null.swapaxes(1, 2) @ self.stiffness @ self.null)

    @property
    def least(self) -> Array:
        """Least stiffness of the degrees of freedom (n,), as a share of the joints' largest."""
        size = np.abs(self.stiffness).max(axis=(1, 2))
        values = np.linalg.eigvalsh((self.own + self.own.swapaxes(1, 2)) / 2)
        return np.asarray(values.min(axis=1, initial=np.inf) / np.where(size > 0, size, 1.0))

    def descent(self) -> Array:
        """Ways (n, rates) that close loops and drives, and go down where the stiffness is less
        than none."""
        close = -(self.inverse @ self.gap[..., None])
        values, vectors = np.linalg.eigh((self.own + self.own.swapaxes(1, 2)) / 2)
        floor = FLAT * np.abs(self.stiffness).max(axis=(1, 2), keepdims=True)[..., 0]
        push = vectors.swapaxes(1, 2) @ (self.null.swapaxes(1, 2) @ self.left[..., None])
        away = push / np.maximum(np.abs(values), np.where(floor > 0, floor, FLAT))[..., None]
        return np.asarray((close + self.null @ (vectors @ away))[..., 0])


Held = tuple[Stop, ...]
"""Stops that joints rest on."""
Inputs = tuple[Array, Array | None]
"""Values of the drives (n, drives) and all controls (n, controls), or those of the key."""


class Resting:
    """A mechanism at rest beside its drives, between the stops of its other joints.

    Parameters
    ----------
    statics : Statics
    """

    def __init__(self, statics: Statics):
        self.statics, self.sizes = statics, statics.sizes
        self.rank = 0  # of loops and drives

    def pushed(self, q: Array, ctrl: Array | None, held: Held) -> tuple[Array, Array, Array]:
        """Forces Q (n, rates) and the rows B (n, rows, rates) at poses q, in sizes.

        And how far the loops are open (n, loops).
        """
        force, loops, gap = self.statics.pushed(q, ctrl)
        own = np.eye(self.sizes.size)[[*self.statics.driven, *(stop.rate for stop in held)]]
        rows = [loops * self.sizes, np.broadcast_to(own, (len(q), *own.shape))]
        return force * self.sizes, np.concatenate(rows, axis=1), gap

    def gap(self, q: Array, loops: Array, values: Array, held: Held) -> Array:
        """How far loops, drives and stops are open (n, rows), with drives at values (n, drives)."""
        ends = np.array([stop.value for stop in held])
        missed = (self.statics.values(q) - values) / self.sizes[self.statics.driven]
        beyond = (q[:, [stop.pose for stop in held]] - ends) / [stop.size for stop in held]
        return np.concatenate([loops, missed, beyond], axis=1)

    def moved(self, q: Array, way: Array) -> Array:
        """Poses at the ends of ways (n, rates) in sizes."""
        return self.statics.moved(q, way * self.sizes)

    def equations(
        self,
        q: Array,
        values: Array,
        ctrl: Array | None,
        held: Held,
        stiffness: Array | None = None,
        nudge: float = NUDGE,
        fine: bool = False,
    ) -> Equations:
        """The equations at poses q (n, poses), with drives at values (n, drives).

        With a stiffness that is known, or that is found here.

        Raises
        ------
        SingularHere
            Other rows hold at one of the poses than at another.
        """
        force, rows, loops = self.pushed(q, ctrl, held)
        inverse, null = factors(rows)
        s = -(inverse.swapaxes(1, 2) @ force[..., None])
        if stiffness is None:
            stiffness = self.stiffness(q, s, ctrl, held, nudge, fine)
        left = force + (rows.swapaxes(1, 2) @ s)[..., 0]
        independent = self.sizes.size - null.shape[2] == self.rank + len(held)
        gap = self.gap(q, loops, values, held)
        return Equations(left, gap, inverse, null, stiffness, s[..., 0], independent)

    def stiffness(
        self, q: Array, s: Array, ctrl: Array | None, held: Held, nudge: float, fine: bool
    ) -> Array:
        """K (n, rates, rates) at poses q (n, poses) with forces s (n, rows, 1)."""

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
        one, two = slopes(WIDER), slopes(2 * WIDER)
        kinked = np.abs(one - two).max(axis=(1, 2)) > KINKED * np.abs(one).max(axis=(1, 2))
        found = np.asarray((4 * one - two) / 3)
        if kinked.any():
            found[kinked] = slopes(nudge)[kinked]
        return found

    def steps(self, q: Array, inputs: Inputs, held: Held) -> Iterator[tuple[Array, Array]]:
        """Newton's steps (n, rates) towards rests, and the poses (n, poses) after them."""
        stiffness, nudge, last = None, NUDGE, np.inf
        while True:
            found = self.equations(q, *inputs, held, stiffness, nudge)
            step = found.solved(-found.left, -found.gap)
            q = self.moved(q, step)
            yield step, q
            size = float(np.abs(step).max(initial=0.0))
            stiffness = found.stiffness if size < SAME and size < SHRINKS * last else None
            nudge, last = min(NUDGE, max(size, FINEST)), size

    def next(
        self, q: Array, before: Inputs, inputs: Inputs, held: Held
    ) -> tuple[Array, Held] | None:
        """The rest (1, poses) that a stride from another leads to; None if it is too long.

        Where a joint comes to its stop and nothing is left free, one that was held leaves its own.
        """
        first, waiting, seen = held, [held], set[Held]()
        while waiting and len(seen) <= 4 * self.sizes.size:
            held = waiting.pop(0)
            seen.add(held)
            if (way := self.approach(q, inputs, held)) is None:
                continue
            pose, ahead = way
            found = self.equations(pose, *inputs, held)
            others = self.switched(pose[0], found.forces[0], held)
            if others == held:
                snapped = held == first and self.turned(pose, ahead, found, before, held)
                return (pose, held) if found.least[0] > FLAT and not snapped else None
            many = len(others) + self.rank > self.sizes.size
            less = [tuple(one for one in others if one != old) for old in held if old in others]
            waiting += [one for one in (less if many else [others]) if one not in seen]
        return None

    def approach(self, q: Array, inputs: Inputs, held: Held) -> tuple[Array, Array] | None:
        """The poses (n, poses) that Newton's method comes to, and its first steps (n, rates).

        None if its steps do not shrink.  A short way may lead to where a spring goes slack, and the
        stiffness is another behind it.
        """
        ahead, first, last = np.zeros((len(q), self.sizes.size)), np.zeros(len(q)), np.inf
        kinks = np.full(len(q), KINKS)
        with suppress(SingularHere):
            for k, (steps, poses) in enumerate(self.steps(q, inputs, held)):
                sizes = np.abs(steps).max(axis=1, initial=0.0)
                far = ~(sizes <= (np.maximum(SHRINKS * last, EXACT) if k else FAR))
                kinks[far] -= 1
                near = (first <= SHORT) & (sizes <= LONGER * first)
                if (far & ~(near & (kinks >= 0))).any():
                    return None
                ahead, first, last = (ahead, first, sizes) if k else (steps, sizes, sizes)
                if (sizes <= EXACT).all():
                    return poses, ahead
        return None

    def together(self, q: Array, before: Inputs, inputs: Inputs, held: Held) -> Array | None:
        """The rests (n, poses) of samples that follow a rest q (1, poses), each found from there.

        None if one is too far, or a stop is met or left before it.
        """
        if (way := self.approach(np.repeat(q, len(inputs[0]), axis=0), inputs, held)) is None:
            return None
        poses, ahead = way
        found = self.equations(poses, *inputs, held)
        each = zip(poses, found.forces, strict=True)
        if not all(self.switched(pose, forces, held) == held for pose, forces in each):
            return None
        sure = (found.least > FLAT).all() and not self.turned(poses, ahead, found, before, held)
        return poses if sure else None

    def turned(
        self, poses: Array, ahead: Array, found: Equations, before: Inputs, held: Held
    ) -> bool:
        """Whether a step back from rests is another than the one ahead (n, rates): over a snap."""
        back = self.equations(poses, *before, held, found.stiffness)
        steps = np.array([ahead, back.solved(-back.left, -back.gap)])
        steps[..., self.statics.driven] = 0.0
        apart, long = np.abs(steps.sum(axis=0)).max(axis=1), np.abs(steps).max(axis=(0, 2))
        return bool(((apart > TURNED * long) & (long > SHORT)).any())

    def switched(self, q: Array, forces: Array, held: Held) -> Held:
        """The stops without those that pull, and with those that a pose (poses,) is beyond.

        From the forces s (rows,) there.
        """
        pushes, largest = forces[forces.size - len(held) :], np.abs(forces).max()
        kept = [
            stop
            for stop, push in zip(held, pushes, strict=True)
            if -stop.side * push > -PULLS * largest
        ]
        kept += [stop for stop in self.statics.stops if stop not in held and stop.gap(q) < -TOUCHES]
        return in_order(kept)

    def first(self, values: Array, ctrl: Array | None) -> tuple[Array, Held]:
        """The rest (1, poses) that the start pose falls to, with drives at values (1, drives).

        Raises
        ------
        Unstable
            None is found, or it is not stable.
        CannotAssemble
            The loops do not close at the values of the drives.
        """
        q, held = self.statics.begin(values[0])[None], Held()
        self.count(q)
        for _ in range(MOST):
            found = self.equations(q, values, ctrl, held)
            step = found.descent()
            size = float(np.abs(step).max(initial=0.0))
            q = self.moved(q, step * min(1.0, FAR / size if size else 1.0))
            others = self.switched(q[0], found.forces[0], held)
            if size > SAME:  # what stops do is known at rest alone
                others = in_order({*held, *others})
            if size <= EXACT and others == held:
                if not self.equations(q, values, ctrl, held).least[0] > FLAT:
                    raise Unstable("the start pose comes to no stable rest")
                return q, held
            held = others
        raise Unstable("nothing brings the start pose to rest")

    def count(self, q: Array) -> None:
        """Count the rows of loops and drives that hold something by themselves."""
        self.rank = self.sizes.size - factors(self.pushed(q[:1], None, ())[1])[1].shape[2]

    def follow(self, values: Array, ctrl: Array | None) -> tuple[Array, list[Held]]:
        """The rests (n, poses) along values of the drives (n, drives) and controls (n, controls).

        And the stops that joints rest on.

        Raises
        ------
        Unstable
            The rest becomes unstable on the way, or there is none from the start on.
        SingularHere
            A limit position lies on the way.
        """

        def between(k: int, share: float) -> Inputs:
            own = values[k - 1] + share * (values[k] - values[k - 1])
            if ctrl is None or len(ctrl) == 1:
                return own[None], ctrl
            return own[None], (ctrl[k - 1] + share * (ctrl[k] - ctrl[k - 1]))[None]

        begin = values[:1], None if ctrl is None else ctrl[:1]
        at, held = self.first(*begin)
        poses, stops, k, many = [at], [held], 1, 1
        while k < len(values):
            own, before = slice(k, min(k + many, len(values))), between(k, 0.0)
            controls = ctrl if ctrl is None or len(ctrl) == 1 else ctrl[own]
            block = self.together(at, before, (values[own], controls), held) if many > 1 else None
            if block is not None:
                at, many = block[-1:], min(2 * many, MANY)
            elif many > 1:
                many //= 2
                continue
            else:
                done, stride = 0.0, 1.0
                while done < 1.0:
                    share = min(done + stride, 1.0)
                    inputs = between(k, share)
                    if found := self.next(at, before, inputs, held):
                        (at, held), before, done, stride = found, inputs, share, 2 * stride
                    elif (stride := stride / 2) < SHORTEST:
                        raise self.ending(at, *before, held, k)
                block, many = at, 2 if stride >= 1.0 else 1
            poses.append(block)
            stops += [held] * len(block)
            k += len(block)
        return np.concatenate(poses), stops

    def ending(self, q: Array, values: Array, ctrl: Array | None, held: Held, k: int) -> CannotMove:
        """Why the path ends at a rest (1, poses) ahead of sample k."""
        place = ", ".join(f"{value:.6g}" for value in values[0])
        where = f"with the drives at {place}, between samples {k - 1} and {k}"
        sizes = np.linalg.svd(self.pushed(q, ctrl, held)[1][0], compute_uv=False)
        if sizes[self.rank + len(held) - 1] < LIMIT * sizes[0]:
            return SingularHere(f"a limit position lies on the way: {where}")
        return Unstable(f"what the drives leave becomes unstable {where}")

    def beside(
        self,
        q: Array,
        stops: Sequence[Held],
        values: Array,
        rate: Array,
        ctrl: Array | None,
        ctrl_rate: Array | None,
    ) -> tuple[Array, Array]:
        """Rates of rests (n, rates), and what stops do to the joints there (n, rates).

        At rates of the drives (n, drives) and of the controls (n, controls).
        """
        v, pushes = np.zeros((2, len(q), self.sizes.size))
        self.count(q)
        for held in dict.fromkeys(stops):
            own = np.array([k for k, one in enumerate(stops) if one == held])
            now, more = (
                None if c is None else np.broadcast_to(c, (len(q), c.shape[1]))[own]
                for c in (ctrl, ctrl_rate)
            )
            found = self.equations(q[own], values[own], now, held, fine=True)
            changed = np.zeros_like(found.left)
            if now is not None and more is not None and more.any():
                ends = [self.pushed(q[own], now + side * more, held)[0] for side in (0.5, -0.5)]
                changed = ends[0] - ends[1]
            gaps, first = np.zeros_like(found.gap), found.gap.shape[1] - len(held)
            driven = slice(first - rate.shape[1], first)
            gaps[:, driven] = rate[own] / self.sizes[self.statics.driven]
            v[own] = found.solved(-changed, gaps) * self.sizes
            for place, stop in enumerate(held, first):
                pushes[own, stop.rate] = found.forces[:, place] / stop.size
        return v, pushes


def factors(rows: Array) -> tuple[Array, Array]:
    """Pseudo-inverses (n, rates, rows) of rows (n, rows, rates), and what they leave.

    Raises
    ------
    SingularHere
        One leaves more than another.
    """
    left, values, right = np.linalg.svd(rows)
    ranks = (values > RANK * values.max(axis=1, keepdims=True, initial=0.0)).sum(axis=1)
    if np.ptp(ranks):
        raise SingularHere("the rows of loops and drives lose rank on the way")
    rank, right = int(ranks[0]), right.swapaxes(1, 2)
    inverse = (right[..., :rank] / values[:, None, :rank]) @ left[..., :rank].swapaxes(1, 2)
    return np.asarray(inverse), np.asarray(right[..., rank:])


def in_order(stops: Iterable[Stop]) -> Held:
    """Stops in the order of their joints, so that the same ones are equal."""
    return tuple(sorted(stops, key=lambda stop: (stop.rate, stop.side)))
