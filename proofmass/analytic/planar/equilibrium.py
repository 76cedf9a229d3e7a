r"""Rest of a mechanism whose drives leave degrees of freedom to springs, weights and loads.

At rest loops, drives and stops hold what acts on the joints::

    Q(q) + Bᵀ s = 0,    g(q) = 0,    B = dg/dq        g: how far they are open, s: their forces

Newton's method solves both together.  The stiffness, with s fixed so that it has the curvature of
the loops in it, is made of central differences::

    K = -d/dq (Q + Bᵀ s)

A stop, the end of a joint's range, holds its joint while it pushes; one that a joint passes holds
it from then on.  A rest is stable while K, or its symmetric part where loads follow a body, is
positive definite on the null space of B.  The path that the drives lead through rests is followed
in strides, from one rest to the next: a stride is halved until Newton's steps shrink fast, and the
path ends where the rest becomes unstable.  Rates of the path follow from the same equations.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from proofmass.analytic.numerics import Array, NotCovered
from proofmass.analytic.planar.forces import applied, centres
from proofmass.analytic.planar.kinematics import (
    Drives,
    loop_jacobian,
    move,
    nearest,
    residual,
)
from proofmass.analytic.planar.mechanism import CannotMove, Mechanism, SingularHere

NUDGE = 6e-6
"""Step of differences [rad, or sizes]: the cube root of rounding, for an error of 1e-10."""
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
SAME = 1e-5
"""Steps [rad, or sizes] below which the next one needs no new stiffness."""
EXACT = 1e-11
"""Steps [rad, or sizes] below which a rest is found: the next one is rounding."""
MOST = 200
"""Steps from the start pose to the first rest."""
SHORTEST = 1e-7
"""Of the way between two samples: a path that cannot be followed so far has ended."""
LIMIT = 1e-2
"""Least to largest singular value of the rows near a limit position, at the end of a path."""
FLAT = 1e-9
"""Of the largest stiffness: less cannot be told from none by differences."""
TOUCHES = 1e-12
"""Rounding of a joint [rad, or sizes]: beyond its range by more it is past its stop."""
PULLS = 1e-12
"""Of the largest force: rounding of what a stop does."""


class Unstable(CannotMove):
    """A rest that the mechanism leaves by itself."""


@dataclass(frozen=True)
class Equations:
    """The equations of rest at n poses, in `Mechanism.scale` and sizes.

    Attributes
    ----------
    left : ndarray (n, joints)
        Q + Bᵀ s, with the s that leaves least [N m].
    gap : ndarray (n, rows)
        Of loops, drives and stops [1].
    rows : ndarray (n, rows, joints)
        B [1].
    stiffness : ndarray (n, joints, joints)
        K [N m].
    forces : ndarray (n, rows)
        s [N m].
    """

    left: Array
    gap: Array
    rows: Array
    stiffness: Array
    forces: Array

    def solved(self, left: Array, gap: Array) -> Array:
        """Ways (n, joints) that add `left` to the forces and `gap` to the gaps.

        Raises
        ------
        SingularHere
            The equations determine none.
        """
        n, rows, joints = self.rows.shape
        matrix = np.zeros((n, joints + rows, joints + rows))
        matrix[:, :joints, :joints], matrix[:, joints:, :joints] = -self.stiffness, self.rows
        matrix[:, :joints, joints:] = self.rows.swapaxes(1, 2)
        right = np.concatenate([left, gap], axis=1)[..., None]
        try:
            return np.asarray(np.linalg.solve(matrix, right)[:, :joints, 0])
        except np.linalg.LinAlgError:
            raise SingularHere("nothing holds a degree of freedom that the drives leave") from None

    @property
    def null(self) -> Array:
        """Directions (n, joints, freedoms) that loops and drives leave."""
        return np.asarray(np.linalg.svd(self.rows)[2][:, self.rows.shape[1] :].swapaxes(1, 2))

    @property
    def least(self) -> Array:
        """Least stiffness of the degrees of freedom (n,), as a share of the joints' largest."""
        null = self.null
        own = null.swapaxes(1, 2) @ self.stiffness @ null
        size = np.abs(self.stiffness).max(axis=(1, 2))
        values = np.linalg.eigvalsh((own + own.swapaxes(1, 2)) / 2).min(axis=1, initial=np.inf)
        return np.asarray(values / np.where(size > 0, size, 1.0))

    def descent(self) -> Array:
        """Ways (n, joints) that close loops and drives, and go down where the stiffness is less
        than none."""
        close = -(np.linalg.pinv(self.rows) @ self.gap[..., None])
        null = self.null
        own = null.swapaxes(1, 2) @ self.stiffness @ null
        values, vectors = np.linalg.eigh((own + own.swapaxes(1, 2)) / 2)
        floor = FLAT * np.abs(self.stiffness).max(axis=(1, 2), keepdims=True)[..., 0]
        push = vectors.swapaxes(1, 2) @ (null.swapaxes(1, 2) @ self.left[..., None])
        away = push / np.maximum(np.abs(values), np.where(floor > 0, floor, FLAT))[..., None]
        return np.asarray((close + null @ (vectors @ away))[..., 0])


Held = tuple[tuple[int, float], ...]
"""Joints that rest on a stop, and the ends of their ranges there [rad or m]."""


class Resting:
    """A mechanism at rest beside its drives, between the stops of its other joints.

    Raises
    ------
    NotCovered
        A joint that the drives leave has dry friction: its rest depends on how it came there.
    """

    def __init__(self, m: Mechanism, d: Drives):
        self.m, self.d = m, d
        for joint in (m.joints[j] for j in d.following):
            if joint.friction:
                raise NotCovered(
                    f"joint {joint.name!r} has friction, and the drives do not determine it: where "
                    "it rests depends on how it came there"
                )

    def pushed(self, q: Array, ctrl: Array | None, held: Held) -> tuple[Array, Array]:
        """Forces Q (n, joints) and the rows B (n, rows, joints) at poses q (n, joints)."""
        m, motion = self.m, move(self.m, q)
        force = applied(m, motion, centres(m, motion), q, 0.0, ctrl) * m.scale
        loops = loop_jacobian(m, motion, q) * m.scale / m.size
        own = np.eye(len(m.joints))[[*self.d.driven, *(j for j, _ in held)]]
        return force, np.concatenate([loops, np.broadcast_to(own, (len(q), *own.shape))], axis=1)

    def gap(self, q: Array, values: Array, held: Held) -> Array:
        """How far loops, drives and stops are open (n, rows), with drives at values (n, drives)."""
        m, stops = self.m, [j for j, _ in held]
        parts = [
            residual(m, move(m, q), q) / m.size,
            (q[:, self.d.driven] - values) / m.scale[self.d.driven],
            (q[:, stops] - np.array([end for _, end in held])) / m.scale[stops],
        ]
        return np.concatenate(parts, axis=1)

    def equations(
        self,
        q: Array,
        values: Array,
        ctrl: Array | None,
        held: Held,
        stiffness: Array | None = None,
        fine: bool = False,
    ) -> Equations:
        """The equations at poses q (n, joints), with drives at values (n, drives).

        With a stiffness that is known, or that is found here.
        """
        force, rows = self.pushed(q, ctrl, held)
        across = rows.swapaxes(1, 2)
        s = -(np.linalg.pinv(across) @ force[..., None])
        if stiffness is None:
            stiffness = self.stiffness(q, s, ctrl, held, fine)
        left = force + (across @ s)[..., 0]
        return Equations(left, self.gap(q, values, held), rows, stiffness, s[..., 0])

    def stiffness(self, q: Array, s: Array, ctrl: Array | None, held: Held, fine: bool) -> Array:
        """K (n, joints, joints) at poses q (n, joints) with forces s (n, rows, 1)."""

        def slopes(step: float) -> Array:
            n, joints = q.shape
            nudges = step * np.concatenate([np.eye(joints), -np.eye(joints)]) * self.m.scale
            near, many = (q[:, None] + nudges).reshape(-1, joints), 2 * joints
            controls = ctrl
            if controls is not None:
                controls = np.broadcast_to(controls, (n, controls.shape[1]))
                controls = np.repeat(controls, many, axis=0)
            force, rows = self.pushed(near, controls, held)
            own = force + (rows.swapaxes(1, 2) @ np.repeat(s, many, axis=0))[..., 0]
            own = own.reshape(n, 2, joints, joints)  # side, nudged joint, force
            return np.asarray((own[:, 1] - own[:, 0]).swapaxes(1, 2) / (2 * step))

        if not fine:
            return slopes(NUDGE)
        one, two = slopes(WIDER), slopes(2 * WIDER)
        kinked = np.abs(one - two).max(axis=(1, 2)) > KINKED * np.abs(one).max(axis=(1, 2))
        found = np.asarray((4 * one - two) / 3)
        if kinked.any():
            found[kinked] = slopes(NUDGE)[kinked]
        return found

    def steps(
        self, q: Array, values: Array, ctrl: Array | None, held: Held
    ) -> Iterator[tuple[float, Array]]:
        """Newton's steps towards a rest: their lengths, and the poses (1, joints) after them."""
        stiffness = None
        while True:
            found = self.equations(q, values, ctrl, held, stiffness)
            step = found.solved(-found.left, -found.gap)
            q, size = q + step * self.m.scale, float(np.abs(step).max(initial=0.0))
            yield size, q
            stiffness = found.stiffness if size < SAME else None

    def next(
        self, q: Array, values: Array, ctrl: Array | None, held: Held
    ) -> tuple[Array, Held] | None:
        """The rest (1, joints) that a stride from another leads to; None if it is too long.

        Where a joint comes to its stop and nothing is left free, one that was held leaves its own.
        """
        waiting, seen = [held], set[Held]()
        while waiting and len(seen) <= 4 * len(self.m.joints):
            held = waiting.pop(0)
            seen.add(held)
            if (pose := self.approach(q, values, ctrl, held)) is None:
                continue
            found = self.equations(pose, values, ctrl, held)
            others = self.switched(pose[0], found, held)
            if others == held:
                return (pose, held) if found.least[0] > FLAT else None
            many = len(others) + self.m.rows + self.d.driven.size > len(self.m.joints)
            less = [tuple(one for one in others if one != old) for old in held if old in others]
            waiting += [one for one in (less if many else [others]) if one not in seen]
        return None

    def approach(self, q: Array, values: Array, ctrl: Array | None, held: Held) -> Array | None:
        """The pose (1, joints) that Newton's method comes to; None if its steps do not shrink.

        A short way may lead to where a spring goes slack, and the stiffness is another behind it.
        """
        sizes, kinks = list[float](), KINKS
        with suppress(SingularHere):
            for size, pose in self.steps(q, values, ctrl, held):
                if not size <= (max(SHRINKS * sizes[-1], EXACT) if sizes else FAR):
                    kinks -= 1
                    if not (sizes and sizes[0] <= SHORT and size <= LONGER * sizes[0]) or kinks < 0:
                        return None
                if size <= EXACT:
                    return pose
                sizes.append(size)
        return None

    def switched(self, q: Array, found: Equations, held: Held) -> Held:
        """The stops without those that pull, and with those of joints (joints,) beyond them."""
        m = self.m
        pushes = dict(zip((j for j, _ in held), found.forces[0, -len(held) :], strict=False))
        kept = {
            j: end
            for j, end in held
            if (pushes[j] if end == m.joints[j].range[0] else -pushes[j])
            > -PULLS * np.abs(found.forces).max()
        }
        for j in (j for j in self.d.following if j not in pushes):
            low, high = m.joints[j].range
            if q[j] < low - TOUCHES * m.scale[j] or q[j] > high + TOUCHES * m.scale[j]:
                kept[int(j)] = low if q[j] < low else high
        return tuple(sorted(kept.items()))

    def first(self, values: Array, ctrl: Array | None) -> tuple[Array, Held]:
        """The rest (1, joints) that the start pose falls to, with drives at values (1, drives).

        Raises
        ------
        Unstable
            None is found, or it is not stable.
        CannotAssemble
            The loops do not close at the values of the drives.
        """
        m = self.m
        q, held = nearest(m, m.start, self.d.driven, values[0])[None], Held()
        for _ in range(MOST):
            found = self.equations(q, values, ctrl, held)
            step = found.descent()
            size = float(np.abs(step).max(initial=0.0))
            q = q + step * min(1.0, FAR / size if size else 1.0) * m.scale
            others = self.switched(q[0], found, held)
            if size > SAME:  # what stops do is known at rest alone
                others = tuple(sorted({*held, *others}))
            if size <= EXACT and others == held:
                if not self.equations(q, values, ctrl, held).least[0] > FLAT:
                    raise Unstable("the start pose comes to no stable rest")
                return q, held
            held = others
        raise Unstable("nothing brings the start pose to rest")

    def follow(self, values: Array, ctrl: Array | None) -> tuple[Array, list[Held]]:
        """The rests (n, joints) along values of the drives (n, drives) and controls (n, controls).

        And the stops that joints rest on.

        Raises
        ------
        Unstable
            The rest becomes unstable on the way, or there is none from the start on.
        SingularHere
            A limit position lies on the way.
        """

        def between(k: int, share: float) -> tuple[Array, Array | None]:
            own = values[k - 1] + share * (values[k] - values[k - 1])
            if ctrl is None or len(ctrl) == 1:
                return own[None], ctrl
            return own[None], (ctrl[k - 1] + share * (ctrl[k] - ctrl[k - 1]))[None]

        at, held = self.first(values[:1], None if ctrl is None else ctrl[:1])
        poses, stops = [at], [held]
        for k in range(1, len(values)):
            done, stride = 0.0, 1.0
            while done < 1.0:
                share = min(done + stride, 1.0)
                if found := self.next(at, *between(k, share), held):
                    (at, held), done, stride = found, share, 2 * stride
                elif (stride := stride / 2) < SHORTEST:
                    raise self.ending(at, *between(k, done), held, k)
            poses.append(at)
            stops.append(held)
        return np.concatenate(poses), stops

    def ending(self, q: Array, values: Array, ctrl: Array | None, held: Held, k: int) -> CannotMove:
        """Why the path ends at a rest (1, joints) ahead of sample k."""
        place = ", ".join(f"{value:.6g}" for value in values[0])
        where = f"with the drives at {place}, between samples {k - 1} and {k}"
        sizes = np.linalg.svd(self.pushed(q, ctrl, held)[1][0], compute_uv=False)
        if sizes.min() < LIMIT * sizes.max():
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
        """Rates of rests (n, joints), and what stops do to the joints there (n, joints).

        At rates of the drives (n, drives) and of the controls (n, controls).
        """
        m, v, pushes = self.m, np.zeros_like(q), np.zeros_like(q)
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
            gaps = np.zeros_like(found.gap)
            gaps[:, m.rows : m.rows + rate.shape[1]] = rate[own] / m.scale[self.d.driven]
            v[own] = found.solved(-changed, gaps) * m.scale
            for place, (j, _) in enumerate(held, gaps.shape[1] - len(held)):
                pushes[own, j] = found.forces[:, place] / m.scale[j]
        return v, pushes
