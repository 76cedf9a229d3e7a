"""Paths of equilibria by pseudo-arclength continuation: along trajectories and load ramps.

`PathStep` takes the strides, passes folds, and records the folds and branch points on the way.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from proofmass.analytic.rods.equilibrium import (
    RESIDUAL_ROUNDING,
    ROD_STEP_TOLERANCE,
    Columns,
    RodState,
    check_square,
    closure,
    columns,
    newton,
    residual_and_state_sizes,
    solve_linear,
)
from proofmass.base.arrays import Array

MAX_ARC_STRIDE = 0.5  # first and largest stride, in sizes of the unknowns
MIN_ARC_STRIDE = 1e-8  # stride below which a path ends that cannot be continued
STRIDE_PER_NORM = 0.1  # times the state's norm, if above 1: factor on the largest stride
MAX_STATE_NORM = 1e3  # norm of a state whose forces grow without bound
BRANCH_POINT_OFFSET = 1e-4  # from a branch point to its neighbours, over the stride
MIN_TANGENT_COSINE = 0.95  # of the angle between the tangents of a stride: 18 degrees
MAX_STRIDE_CORRECTION = 0.25  # largest correction of a stride, over the stride


class PathStep:
    """Strides along a path of equilibria whose given values run along a straight line.

    The share of the line that has been passed is `part`.  The coordinates of the path are the free
    unknowns over their sizes and, as the last one, the distance along the line.
    """

    def __init__(
        self, start: RodState, free: Columns, line: Array, stride: float, sense: float = 1.0
    ):
        self.a, self.free, self.start = start.assembly, free, start.vector
        self.rows, self.scale = residual_and_state_sizes(self.a)
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
        """Unit tangent on the side of another one, and the determinant by the free unknowns."""
        _, jacobian = closure(RodState(self.a, vector))
        matrix = np.vstack([jacobian @ self.basis / self.rows[:, None], before])
        right = np.zeros(before.size)
        right[-1] = 1.0
        tangent = solve_linear(matrix[None], right[None])[0]
        return tangent / np.linalg.norm(tangent), float(np.linalg.det(matrix[:-1, :-1]))

    def ahead(self, stride: float) -> Array | None:
        """Point of the path a stride along the tangent from here; None if Newton's method fails."""
        vector, moved = self.here + self.basis @ self.tangent * stride, 0.0
        for _ in range(8):
            f, jacobian = closure(RodState(self.a, vector))
            matrix = np.vstack([jacobian @ self.basis / self.rows[:, None], self.tangent])
            step = solve_linear(matrix[None], np.append(-f / self.rows, 0.0)[None])[0]
            vector, size = vector + self.basis @ step, float(np.linalg.norm(step))
            moved += size
            if not moved <= MAX_STRIDE_CORRECTION * stride + RESIDUAL_ROUNDING:
                return None
            if size < ROD_STEP_TOLERANCE:
                return np.asarray(vector)
        return None

    def place(self, vector: Array) -> float:
        """Share of the line that has been passed at a point."""
        line = self.basis[:, -1]
        return float((vector - self.start) @ line / (line @ line) / self.length)

    def step(self, top: float, bottom: float = -np.inf) -> None:
        """Take one stride, no further than to the ends of the line."""
        found = self.ahead(self.stride)
        if found is not None:
            tangent, regular = self.along(found, self.tangent)
        if found is None or not tangent @ self.tangent > MIN_TANGENT_COSINE:
            self.stride /= 2.0
            if self.stride < MIN_ARC_STRIDE:
                self.why = "the path cannot be continued: strides vanish"
            return
        if regular * self.regular < 0.0:
            found = self.record_singularity(
                found, tangent[-1] * self.tangent[-1] < 0.0, top, bottom
            )
        part = self.place(found)
        if part > top or part < bottom:
            goal = min(max(part, bottom), top)
            found, part = self.point_at_end(found, part, goal), goal
            if np.isnan(found).any():
                self.why = "the end of the line is singular"
                return
        self.here, self.part, self.tangent, self.regular = found, part, tangent, regular
        size = float(np.linalg.norm(self.here / self.scale))
        self.stride = min(1.5 * self.stride, self.longest * max(1.0, STRIDE_PER_NORM * size))
        if size > MAX_STATE_NORM:
            self.why = "the forces grow without bound: a rod is stretched"

    def record_singularity(
        self, found: Array, turns_back: bool, top: float, bottom: float
    ) -> Array:
        """Record the fold or branch point within a stride, unless the line ends before it."""

        def regular(stride: float) -> float:
            vector = self.ahead(stride)  # None at a branch point, where the corrector is singular
            return 0.0 if vector is None else self.along(vector, self.tangent)[1]

        root = float(brentq(regular, 0.0, self.stride, xtol=1e-12))
        if not turns_back:
            part = self.branch_point(root, found)
            self.crossed += [part] if bottom <= part <= top else []
            return found
        vector = self.ahead(root)
        if vector is None:
            self.why = "the path turns back, and its fold is not found"
            return found
        if not bottom <= self.place(vector) <= top:
            return vector
        self.folds.append((self.place(vector), vector))
        return found

    def branch_point(self, root: float, found: Array) -> float:
        """Share of the line at a branch point, by the secant through points on both sides of it.

        If one of these points is singular as well, the share is interpolated over the stride.
        """
        neighbours = [
            self.ahead(root + side * BRANCH_POINT_OFFSET * self.stride) for side in (-1.0, 1.0)
        ]
        known = [
            (self.place(v), self.along(v, self.tangent)[1]) for v in neighbours if v is not None
        ]
        if len(known) < 2:
            return self.part + root / self.stride * (self.place(found) - self.part)
        (before, determinant_before), (after, determinant_after) = known
        return (before * determinant_after - after * determinant_before) / (
            determinant_after - determinant_before
        )

    def point_at_end(self, passed: Array, part: float, goal: float) -> Array:
        """Point at an end of the line, by Newton's method from an interpolated guess."""
        guess = self.here + (goal - self.part) / (part - self.part) * (passed - self.here)
        guess += self.basis[:, -1] * self.length * (goal - self.place(guess))
        found, _ = newton(RodState(self.a, guess[None]), self.free)
        return np.asarray(found.vector[0])


@dataclass(frozen=True)
class WaypointPath:
    """A path of equilibria through way points, as far as it could be followed.

    Attributes
    ----------
    states : RodState (t,)
        States at the way points, NaN from the first one that was not reached.
    reached : float
        Number of way points reached, plus the share of the line to the next one [1]: t if all.
    last : RodState
        The last state; the fold if the path ended in one.
    why : str
        Why the path ended early; "" where it did not.
    crossed : ndarray (c,)
        Branch points that the path passed, counted as `reached` [1]: the determinant changes its
        sign there and the path does not turn back.  Beyond them a symmetric pose may be unstable.
    """

    states: RodState
    reached: float
    last: RodState
    why: str
    crossed: Array


@dataclass(frozen=True)
class EquilibriumPath:
    """One-parameter family of equilibria, beyond its folds.

    Attributes
    ----------
    states, parameter : RodState (t,), ndarray (t,)
        States from the start on, in the order of arc length, and their parameters [1].
    folds, at : RodState (f,), ndarray (f,)
        Folds, where the parameter turns back, and their parameters [1].
    why : str
        Why the path ended before `to`; "" where it did not.
    crossed : ndarray (c,)
        Parameters [1] of branch points that it passed.
    """

    states: RodState
    parameter: Array
    folds: RodState
    at: Array
    why: str
    crossed: Array


def follow(
    start: RodState,
    *,
    inputs: ArrayLike | None = None,
    pose: ArrayLike | None = None,
    load: ArrayLike | None = None,
    stride: float = MAX_ARC_STRIDE,
) -> WaypointPath:
    r"""Follow an equilibrium along straight lines between way points; a fold ends it.

    Parameters
    ----------
    start : RodState
        One closed state.
    inputs, pose, load : (t, k), (t, p), (t, p)
        Way points of given values [SI].  With `pose` the inputs are found.  Without it the pose is
        found, and inputs without way points stay as at the start, as does a load without them.
    stride : largest stride along the path [1], in sizes L, EI/L, EI/L^2, rad

    Raises
    ------
    ValueError
        Way points of the wrong shape, or of both inputs and pose; with `pose`, a number of inputs
        that differs from that of the degrees of freedom.

    Notes
    -----
    A stride goes along the tangent and is corrected across it.  It is halved if the tangent turns
    by more than 18 degrees or if the correction is more than a quarter of the stride.  Source of
    trajectories: Pérez Gámiz 2018, text lines 2924-4013.  Its program takes the last point as the
    guess for the next one; where Newton's method fails it writes NaN and goes on from an old state.

    Examples
    --------
    A symmetric pair of rods pushed down beyond the load under which it buckles sideways:

    >>> from proofmass.analytic.rods.assembly import assembly
    >>> from proofmass.analytic.rods.equilibrium import solve_direct
    >>> from proofmass.analytic.rods.equilibrium import state
    >>> a = assembly([[-0.3, 0.0], [0.3, 0.0]])
    >>> start = solve_direct(state(a, inputs=np.radians([60.0, 120.0]), pose=[0.0, 0.9],
    ...                      moment=[0.5, -0.5], force=[[-0.5, 0.0], [0.5, 0.0]]))
    >>> found = follow(start, load=[[0.0, -1.0], [0.0, -50.0]])
    >>> found.reached, found.states.pose[:, 1].round(6).tolist(), found.crossed.round(3).tolist()
    (2.0, [0.948785, 0.511166], [1.426])
    """
    free, way_points = _unknowns_and_way_points(start, inputs, pose, load)
    name = "inverse" if pose is not None else "direct"
    found, vector = np.full((len(way_points), start.vector.size), np.nan), start.vector
    branch_points: list[float] = []
    for j, goal in enumerate(way_points):
        path = PathStep(RodState(start.assembly, vector), free, goal - vector, stride)
        while path.part < 1.0 and not path.why and not path.folds:
            path.step(1.0)
        vector = path.here
        branch_points += [j + part for part in path.crossed]
        if path.part < 1.0:
            why = path.why or f"fold: {name} singularity"
            last = RodState(start.assembly, path.folds[-1][1] if path.folds else vector)
            part = path.folds[-1][0] if path.folds else path.part
            return WaypointPath(
                RodState(start.assembly, found), j + part, last, why, np.array(branch_points)
            )
        found[j] = vector
    return WaypointPath(
        RodState(start.assembly, found),
        float(len(way_points)),
        RodState(start.assembly, vector),
        "",
        np.array(branch_points),
    )


def loads_and_rates(
    shape: tuple[int, ...], rates: Mapping[str, Array] | None, **parts: ArrayLike
) -> tuple[Array, Array]:
    """Loads (n, parts) along a path of this shape, and their rates, from the parts by name.

    Parameters
    ----------
    shape : shape of a path of n points
    rates : rates of the parts that change, by name [SI]; None: all parts are constant
    **parts : parts of the load [N, N m], each one number for all points or along the path

    Examples
    --------
    >>> loads_and_rates((3,), {"force_y": [2.0, 2.0, 2.0]}, force_x=1.0, force_y=[0.0, 1.0, 2.0])[0]
    array([[1., 0.],
           [1., 1.],
           [1., 2.]])
    """
    growth = [(rates or {}).get(name, 0.0) for name in parts]
    load, rate = (
        np.reshape(
            [np.broadcast_to(np.asarray(one, float), shape) for one in each], (len(each), -1)
        )
        for each in ([*parts.values()], growth)
    )
    return load.T, rate.T


def trace(
    start: RodState,
    *,
    inputs: ArrayLike | None = None,
    pose: ArrayLike | None = None,
    load: ArrayLike | None = None,
    to: tuple[float, float],
    max_points: int = 400,
    stride: float = MAX_ARC_STRIDE,
) -> EquilibriumPath:
    r"""Follow the equilibria over one parameter, beyond their folds.

    Parameters
    ----------
    start : RodState
        One closed state, of parameter 0.
    inputs, pose, load : (k,), (p,), (p,)
        Derivatives of the given values by the parameter [SI]; see `follow`.
    to : least and greatest parameter [1], at which the path ends; the parameter rises at first if
        the second one is positive
    max_points : largest number of points
    stride : see `follow` [1]

    Returns
    -------
    EquilibriumPath
        Folds are found to rounding, as zeros of the parameter's component of the tangent.
    """
    free, way_points = _unknowns_and_way_points(
        start,
        *(
            None if rate is None else np.asarray(rate, float)[None] + base
            for rate, base in ((inputs, start.inputs), (pose, start.pose), (load, start.load))
        ),
    )
    path = PathStep(start, free, way_points[0] - start.vector, stride, 1.0 if to[1] > 0 else -1.0)
    points = [(0.0, start.vector)]
    while to[0] <= path.part <= to[1] and not path.why and len(points) < max_points:
        path.step(to[1], to[0])
        points.append((path.part, path.here))
        if path.part in to:
            break
    else:
        path.why = path.why or f"{max_points} points did not reach the end"
    a, (parameters, vectors) = start.assembly, zip(*points, strict=True)
    folds = np.array([vector for _, vector in path.folds]).reshape(-1, start.vector.size)
    return EquilibriumPath(
        RodState(a, np.array(vectors)),
        np.array(parameters),
        RodState(a, folds),
        np.array([part for part, _ in path.folds]),
        path.why,
        np.array(path.crossed),
    )


def _unknowns_and_way_points(
    start: RodState, inputs: ArrayLike | None, pose: ArrayLike | None, load: ArrayLike | None
) -> tuple[Columns, Array]:
    """Unknown columns, and vectors (t, columns) whose other columns are the way points."""
    if start.vector.ndim != 1:
        raise ValueError(f"start must be one state, got a batch {start.vector.shape[:-1]}")
    if (inputs is not None) == (pose is not None) and (load is None or inputs is not None):
        raise ValueError(
            "give way points of inputs, of pose or of load, not of both inputs and pose"
        )
    if pose is not None:
        check_square(start)
    parts = {
        name: np.atleast_2d(np.asarray(value, float))
        for name, value in (("inputs", inputs), ("pose", pose), ("load", load))
        if value is not None
    }
    way_points = start.with_parts(**parts).vector
    free = columns(start.assembly, "rods", "inputs" if pose is not None else "pose")
    return free, np.atleast_2d(way_points)
