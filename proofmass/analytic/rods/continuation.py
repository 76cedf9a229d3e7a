"""Paths of equilibria by pseudo-arclength: along trajectories and load ramps, and round folds."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array
from proofmass.analytic.rods.inverse import square
from proofmass.analytic.rods.state import Columns, State, columns
from proofmass.analytic.rods.walk import STRIDE, Walk


@dataclass(frozen=True)
class Trail:
    """A path through way points, as far as it could be followed.

    Attributes
    ----------
    states : State (t,)
        At the way points, NaN from the first that was not reached.
    reached : float
        Way points reached, and the share of the way to the next: t if all.
    last : State
        Where it ended: in a fold, that fold.
    why : str
        Why it ended early; "" where it did not.
    crossed : ndarray (c,)
        Where, counted as `reached`, it passed a branch point: the determinant changes its sign and
        the path does not turn back.  Behind it a symmetric posture may be unstable.
    """

    states: State
    reached: float
    last: State
    why: str
    crossed: Array


@dataclass(frozen=True)
class Branch:
    """One-parameter family of equilibria, folds passed.

    Attributes
    ----------
    states, parameter : State (t,), ndarray (t,)
        From the start on, in order of arc length.
    folds, at : State (f,), ndarray (f,)
        Where the parameter turns back.
    why : str
        Why it ended before `to`; "" where it did not.
    crossed : ndarray (c,)
        Parameters of branch points that it passed.
    """

    states: State
    parameter: Array
    folds: State
    at: Array
    why: str
    crossed: Array


def follow(start: State, *, inputs: ArrayLike | None = None, pose: ArrayLike | None = None,
           load: ArrayLike | None = None, stride: float = STRIDE) -> Trail:
    r"""Follow an equilibrium along straight lines between way points; a fold ends it.

    Parameters
    ----------
    start : State
        One closed state.
    inputs, pose, load : (t, k), (t, p), (t, p)
        Way points of what is given.  With `pose` the inputs are found, otherwise the pose; what is
        not given, of the load and of the pose or the inputs, stays as it is at the start.
    stride : largest stride along the path, in sizes L, EI/L, EI/L^2, rad

    Raises
    ------
    ValueError
        Way points of the wrong shape, or both inputs and pose; inputs unequal in number to the
        freedoms where `pose` is given.

    Notes
    -----
    Strides go along the tangent and are corrected across it; they are halved where the tangent
    turns by more than 18 degrees or the correction is more than a quarter of the stride.  Source of
    trajectories: Pérez Gámiz 2018, text lines 2924-4013, whose program takes the last point as the
    guess for the next, fills NaN where Newton fails and goes on from a stale state.

    Examples
    --------
    A symmetric pair of rods pushed down beyond the load under which it gives way sideways:

    >>> from proofmass.analytic.rods.assembly import assembly
    >>> from proofmass.analytic.rods.direct import direct
    >>> from proofmass.analytic.rods.state import state
    >>> a = assembly([[-0.3, 0.0], [0.3, 0.0]])
    >>> start = direct(state(a, inputs=np.radians([60.0, 120.0]), pose=[0.0, 0.9],
    ...                      moment=[0.5, -0.5], force=[[-0.5, 0.0], [0.5, 0.0]]))
    >>> trail = follow(start, load=[[0.0, -1.0], [0.0, -50.0]])
    >>> trail.reached, trail.states.pose[:, 1].round(6).tolist(), trail.crossed.round(3).tolist()
    (2.0, [0.948785, 0.511166], [1.426])
    """
    free, way = _given(start, inputs, pose, load)
    name = "inverse" if pose is not None else "direct"
    found, here = np.full((len(way), start.vector.size), np.nan), start.vector
    crossed: list[float] = []
    for j, goal in enumerate(way):
        walk = Walk(State(start.assembly, here), free, goal - here, stride)
        while walk.part < 1.0 and not walk.why and not walk.folds:
            walk.step(1.0)
        here = walk.here
        crossed += [j + part for part in walk.crossed]
        if walk.part < 1.0:
            why = walk.why or f"fold: {name} singularity"
            last = State(start.assembly, walk.folds[-1][1] if walk.folds else here)
            part = walk.folds[-1][0] if walk.folds else walk.part
            return Trail(State(start.assembly, found), j + part, last, why,
                         np.array(crossed))
        found[j] = here
    return Trail(State(start.assembly, found), float(len(way)), State(start.assembly, here), "",
                 np.array(crossed))


def trace(start: State, *, inputs: ArrayLike | None = None, pose: ArrayLike | None = None,
          load: ArrayLike | None = None, to: tuple[float, float], most: int = 400,
          stride: float = STRIDE) -> Branch:
    r"""Trace the equilibria over one parameter, round its folds.

    Parameters
    ----------
    start : State
        One closed state, parameter 0.
    inputs, pose, load : (k,), (p,), (p,)
        Change of what is given with the parameter; see `follow`.
    to : least and greatest parameter, which end the branch; it begins upwards if the second is
        positive
    most : points
    stride : see `follow`

    Returns
    -------
    Branch
        Folds are found to rounding: zeros of the parameter's part of the tangent over arc length.
    """
    free, way = _given(start, *(None if rate is None else np.asarray(rate, float)[None] + base
                                for rate, base in ((inputs, start.inputs), (pose, start.pose),
                                                   (load, start.load))))
    walk = Walk(start, free, way[0] - start.vector, stride, 1.0 if to[1] > 0 else -1.0)
    points = [(0.0, start.vector)]
    while to[0] <= walk.part <= to[1] and not walk.why and len(points) < most:
        walk.step(to[1], to[0])
        points.append((walk.part, walk.here))
        if walk.part in to:
            break
    else:
        walk.why = walk.why or f"{most} points did not reach the end"
    a, (at, vectors) = start.assembly, zip(*points, strict=True)
    turns = np.array([vector for _, vector in walk.folds]).reshape(-1, start.vector.size)
    return Branch(State(a, np.array(vectors)), np.array(at), State(a, turns),
                  np.array([part for part, _ in walk.folds]), walk.why, np.array(walk.crossed))


def _given(start: State, inputs: ArrayLike | None, pose: ArrayLike | None, load: ArrayLike | None
           ) -> tuple[Columns, Array]:
    """Columns that are found, and vectors (t, columns) whose others are the way points."""
    if start.vector.ndim != 1:
        raise ValueError(f"start must be one state, got a batch {start.vector.shape[:-1]}")
    if (inputs is not None) == (pose is not None) and (load is None or inputs is not None):
        raise ValueError("give way points of inputs, of pose or of load, not of both inputs and "
                         "pose")
    if pose is not None:
        square(start)
    parts = {name: np.atleast_2d(np.asarray(value, float)) for name, value in
             (("inputs", inputs), ("pose", pose), ("load", load)) if value is not None}
    way = start.replaced(**parts).vector
    free = columns(start.assembly, "rods", "inputs" if pose is not None else "pose")
    return free, np.atleast_2d(way)
