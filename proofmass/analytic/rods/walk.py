"""Pseudo-arclength continuation, stride by stride, with the folds and branch points on the way."""

import numpy as np
from scipy.optimize import brentq

from proofmass.analytic.numerics import Array
from proofmass.analytic.rods.closure import ROUNDING, SURE, closure, newton, sizes, solve
from proofmass.analytic.rods.state import Columns, State

STRIDE = 0.5  # first and largest stride, in sizes of the unknowns
NARROW = 1e-8  # a stride so short that does not get on is the end of a path
LONGER = 0.1  # stride of the whole state that may be taken if that is more
ENDLESS = 1e3  # size of a state whose forces grow without bound
BESIDE = 1e-4  # share of a stride that a branch point is looked at from
TURN = 0.95  # cosine of the angle that a tangent may turn by in a stride: 18 degrees
STRAY = 0.25  # share of a stride that the correction may take


class Walk:
    """One step after the other along a line in the parameters; `part` is how much of it is behind.

    Coordinates are the free unknowns over their sizes and, last, the way along the line.
    """

    def __init__(self, start: State, free: Columns, line: Array, stride: float,
                 sense: float = 1.0):
        self.a, self.free, self.start = start.assembly, free, start.vector
        self.rows, self.scale = sizes(self.a)
        line = np.where(np.isin(np.arange(line.size), free), 0.0, line)
        self.length = float(np.linalg.norm(line / self.scale))
        self.basis = np.zeros((line.size, free.size + 1))
        self.basis[free, np.arange(free.size)] = self.scale[free]
        self.here, self.part, self.why = start.vector, 0.0, ""
        self.folds: list[tuple[float, Array]] = []
        self.crossed: list[float] = []
        self.longest = self.stride = stride
        if self.length == 0.0:
            self.part = 1.0
            return
        self.basis[:, -1] = line / self.length
        last = np.zeros(free.size + 1)
        last[-1] = sense
        self.tangent, self.regular = self.along(self.here, last)

    def along(self, vector: Array, before: Array) -> tuple[Array, float]:
        """Unit tangent, to the side of another one, and the determinant of what is found."""
        _, jacobian = closure(State(self.a, vector))
        matrix = np.vstack([jacobian @ self.basis / self.rows[:, None], before])
        right = np.zeros(before.size)
        right[-1] = 1.0
        tangent = solve(matrix[None], right[None])[0]
        return tangent / np.linalg.norm(tangent), float(np.linalg.det(matrix[:-1, :-1]))

    def ahead(self, stride: float) -> Array | None:
        """The path's point at a stride along the tangent from here; None where there is none."""
        vector, moved = self.here + self.basis @ self.tangent * stride, 0.0
        for _ in range(8):
            f, jacobian = closure(State(self.a, vector))
            matrix = np.vstack([jacobian @ self.basis / self.rows[:, None], self.tangent])
            step = solve(matrix[None], np.append(-f / self.rows, 0.0)[None])[0]
            vector, size = vector + self.basis @ step, float(np.linalg.norm(step))
            moved += size
            if not moved <= STRAY * stride + ROUNDING:
                return None
            if size < SURE:
                return np.asarray(vector)
        return None

    def place(self, vector: Array) -> float:
        """Share of the line that is behind a point."""
        line = self.basis[:, -1]
        return float((vector - self.start) @ line / (line @ line) / self.length)

    def step(self, top: float, bottom: float = -np.inf) -> None:
        """One stride, no further than the ends of the line."""
        there = self.ahead(self.stride)
        if there is not None:
            tangent, regular = self.along(there, self.tangent)
        if there is None or not tangent @ self.tangent > TURN:
            self.stride /= 2.0
            if self.stride < NARROW:
                self.why = "the path is lost: strides vanish"
            return
        if regular * self.regular < 0.0:
            there = self.singular(there, tangent[-1] * self.tangent[-1] < 0.0, top, bottom)
        part = self.place(there)
        if part > top or part < bottom:
            goal = min(max(part, bottom), top)
            there, part = self.land(there, part, goal), goal
            if np.isnan(there).any():
                self.why = "the end of the line is singular"
                return
        self.here, self.part, self.tangent, self.regular = there, part, tangent, regular
        size = float(np.linalg.norm(self.here / self.scale))
        self.stride = min(1.5 * self.stride, self.longest * max(1.0, LONGER * size))
        if size > ENDLESS:
            self.why = "the forces grow without bound: a rod is stretched"

    def singular(self, there: Array, back: bool, top: float, bottom: float) -> Array:
        """Note the fold or branch point within a stride, unless the line ends before it."""
        def regular(stride: float) -> float:
            vector = self.ahead(stride)  # none in a branch point, where the corrector is singular
            return 0.0 if vector is None else self.along(vector, self.tangent)[1]

        root = float(brentq(regular, 0.0, self.stride, xtol=1e-12))
        if not back:
            part = self.branch_point(root, there)
            self.crossed += [part] if bottom <= part <= top else []
            return there
        vector = self.ahead(root)
        if vector is None:
            self.why = "the path turns back, and its fold is not found"
            return there
        if not bottom <= self.place(vector) <= top:
            return vector
        self.folds.append((self.place(vector), vector))
        return there

    def branch_point(self, root: float, there: Array) -> float:
        """Where on the line a branch point is: by the secant through points on both sides of it,
        or, where they are singular still, by its share of the stride.
        """
        beside = [self.ahead(root + side * BESIDE * self.stride) for side in (-1.0, 1.0)]
        known = [(self.place(v), self.along(v, self.tangent)[1]) for v in beside if v is not None]
        if len(known) < 2:
            return self.part + root / self.stride * (self.place(there) - self.part)
        (before, falling), (after, fallen) = known
        return (before * fallen - after * falling) / (fallen - falling)

    def land(self, there: Array, part: float, goal: float) -> Array:
        """The point at an end of the line, between here and there."""
        guess = self.here + (goal - self.part) / (part - self.part) * (there - self.here)
        guess += self.basis[:, -1] * self.length * (goal - self.place(guess))
        found, _ = newton(State(self.a, guess[None]), self.free)
        return np.asarray(found.vector[0])
