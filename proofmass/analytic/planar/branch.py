r"""Following one assembly mode along the motion of the drives, with proof at every step.

From a closed pose the tangent T predicts the next.  Newton's method from there converges to the
pose on the *same branch* if the step is short: with β the norm of the inverse Jacobian and L a
bound of how fast the Jacobian changes, the Newton-Kantorovich theorem holds all the way along the
step if

    |T Δθ|  <=  1 / (2 β L).

Towards a limit position β grows and the steps shrink in proportion to what is left of the way, so a
branch ends at its limit position, to rounding.  A change point, where two branches cross, is leapt
over along the smooth one.

P. Deuflhard, Newton Methods for Nonlinear Problems, Springer 2011, theorem 2.1 and section 5.1.
"""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.analytic.planar.kinematics import (
    BLOCK,
    Drives,
    freedoms,
    lipschitz,
    nearest,
    newton,
    rates,
    scaled_jacobian,
)
from proofmass.analytic.planar.mechanism import (
    CannotAssemble,
    CannotMove,
    Mechanism,
    Mirrored,
    SingularHere,
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


@dataclass(frozen=True)
class Knot:
    """A closed pose, its tangent (joints, drives) in own units, and how far that is proven.

    `orientation` is the sign of the Jacobian's determinant, which a branch keeps, and `regular` its
    size, which falls to zero in a singular pose.
    """

    q: Array
    tangent: Array
    radius: float
    orientation: float
    regular: float


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
        free = freedoms(m, q)
        if free != len(names):
            raise SingularHere(
                f"the mechanism has {free} degree(s) of freedom, and {len(names)} driven "
                f"joint(s): {', '.join(names)}"
            )
        self.bound = lipschitz(m, q)
        self.scale = m.scale[self.d.driven]
        self.knot = self.last = self.at(q)
        if not self.knot.radius > UNSURE:
            raise SingularHere(
                f"the start pose, {self.spoken(q[self.d.driven])}, is singular and "
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
        knots, failure = self.walk(inputs)
        return self.close(inputs[: len(knots)], knots), failure

    def walk(self, inputs: Array) -> tuple[list[Knot], CannotMove | None]:
        """A knot that reaches it for each of the inputs (n, drives) that the branch goes to."""
        knots, failure, leap_at, room = list[Knot](), None, CREEP, 16
        while (done := len(knots)) < len(inputs):
            window = inputs[done : done + room]
            near = self.far(window) <= SHARE * self.knot.radius
            count = len(near) if near.all() else int(np.argmin(near))
            room = min(max(16, 2 * count), BLOCK)  # one step reaches about as far as the last
            knots += [self.knot] * count
            try:
                leap_at = self.advance(window[count - 1] if count else inputs[done], leap_at)
            except CannotMove as error:
                failure = error
                break
        return knots, failure

    def reach(self, end: float) -> list[Knot]:
        """The knots on the way to a value of the only drive, as far as the branch goes."""
        knots, leap_at, target = [self.knot], CREEP, np.array([end])
        with suppress(CannotMove):
            while self.knot.q[self.d.driven] != target:
                leap_at = self.advance(target, leap_at)
                if self.knot is not knots[-1]:
                    knots.append(self.knot)
        return knots

    def close(self, inputs: Array, knots: list[Knot]) -> Array:
        """Closed poses (n, joints) at inputs (n, drives), each from a knot that reaches it."""
        if not knots:
            return np.empty((0, len(self.m.joints)))
        guess, _, proven = self.beside(inputs, knots)
        q = newton(self.m, guess, self.d)
        moved = np.linalg.norm((q - guess) / self.m.scale, axis=1)
        if not (moved <= NEAR * proven).all():
            bad = int(np.argmax(moved > NEAR * proven))
            raise Mirrored(f"mirrored at {self.spoken(inputs[bad])}")
        return q

    def beside(self, inputs: Array, knots: list[Knot]) -> tuple[Array, Array, Array]:
        """Poses (n, joints) that the knots' tangents predict at inputs (n, drives).

        And the lengths of these moves, in own units (n,), and how far each is proven (n,).
        """
        at, tangent, proven = (
            np.array([getattr(knot, name) for knot in knots]) for name in ("q", "tangent", "radius")
        )
        ahead = (inputs - at[:, self.d.driven]) / self.scale
        move = np.einsum("njd,nd->nj", tangent, ahead)
        guess = at + move * self.m.scale
        guess[:, self.d.driven] = inputs
        return guess, np.linalg.norm(move, axis=1), proven

    def at(self, q: Array) -> Knot:
        """What is known at a closed pose (joints,)."""
        m, d = self.m, self.d
        matrix = scaled_jacobian(m, q[None])[0]
        values = np.linalg.svd(matrix[:, d.following], compute_uv=False)
        least = float(values.min(initial=1.0))
        tangent = np.eye(len(m.joints))[:, d.driven]
        if not least > 1e-14:
            raise SingularHere(f"singular at {self.spoken(q[d.driven])}")
        tangent[d.following] = -np.linalg.solve(matrix[:, d.following], matrix[:, d.driven])
        bound = self.bound if m.hinges.all() else lipschitz(m, q)
        sign, logarithm = np.linalg.slogdet(matrix[:, d.following])
        return Knot(
            q,
            tangent,
            0.5 * least / bound if bound else np.inf,
            float(sign),
            float(np.exp(logarithm)),
        )

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
        part = min(1.0, SHARE * self.knot.radius / float(self.far(inputs[None])[0] or way))
        if part < 1.0 and part * way < leap_at:
            if self.leap(inputs, way):
                return CREEP
            if part * way < STUCK:
                raise SingularHere(
                    f"limit position at {self.spoken(here)}: the branch goes no "
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
                raise Mirrored(f"mirrored at {self.spoken(inputs)}")
            raise SingularHere(f"singular at {self.spoken(inputs)}")
        self.last, self.knot = self.knot, knot

    def leap(self, inputs: Array, way: float) -> bool:
        """Try to pass a change point on the way to inputs; False if the branch ends there.

        The Jacobian's determinant passes zero at an even pace, which tells how far the change point
        is.  A second-order step lands as far behind it; if velocities run on smoothly there, and
        the determinant has changed its sign, it was one.
        """
        here, before = self.knot.q[self.d.driven], self.last.q[self.d.driven]
        lost = self.last.regular - self.knot.regular
        if lost <= 0.0:
            return False
        ahead = 2 * self.knot.regular * float(np.linalg.norm((here - before) / self.scale)) / lost
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

    def spoken(self, inputs: Array) -> str:
        """The driven joints with their values."""
        names = [self.m.joints[j].name for j in self.d.driven]
        return ", ".join(f"{n} = {v:.9g}" for n, v in zip(names, inputs, strict=True))
