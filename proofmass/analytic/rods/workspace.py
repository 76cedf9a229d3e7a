"""Workspaces of flexible mechanisms: one sheet of equilibria spread over a grid."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.numerics import Array
from proofmass.analytic.rods.closure import closure, determinant, newton, sizes
from proofmass.analytic.rods.continuation import follow
from proofmass.analytic.rods.derivatives import derivatives, ratio
from proofmass.analytic.rods.inverse import square
from proofmass.analytic.rods.state import Columns, State, columns
from proofmass.analytic.rods.walk import STRAY

ASIDE = np.array([[0, 1], [0, -1], [1, 0], [-1, 0]])
"""Neighbours of a node."""
HALVINGS = 2
"""How often a stride from node to node may be halved."""
BISECTIONS = 30
"""Halvings of an edge of the grid towards a singularity on it."""


@dataclass(frozen=True)
class Map:
    """One sheet of equilibria over a grid of poses or inputs.

    Attributes
    ----------
    name : str
        "pose" or "inputs": what the grid gives.
    axes : tuple of int
        Which two coordinates of it; the others are those of the start.
    first, second : ndarray (m,), (n,)
        Their values.
    states : State (m, n)
        NaN where the sheet does not get.
    """

    name: str
    axes: tuple[int, int]
    first: Array
    second: Array
    states: State

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Nodes (m, n) that the sheet covers."""
        return np.isfinite(self.states.vector[..., 0])


def spread(start: State, first: ArrayLike, second: ArrayLike, *, name: str = "pose",
           axes: tuple[int, int] = (0, 1)) -> Map:
    r"""Spread a sheet of equilibria from one state over a grid, without jumping.

    ::

        . . o o .      S  start, followed to its nearest node
        . o x x o      x  solved: Newton's method along the tangent from a neighbour, in one batch
        . . o S o      o  next front
                       .  not reached, or behind a fold

    Parameters
    ----------
    start : State
        One closed state.
    first, second : (m,), (n,)
        Increasing values of two coordinates.
    name : "pose" (the inverse problem at each node) or "inputs" (the direct problem)
    axes : which two coordinates

    Raises
    ------
    ValueError
        An unknown name; inputs unequal in number to the freedoms with "pose"; or the start cannot
        be followed to the grid.

    Notes
    -----
    A node counts only if the correction is less than a quarter of the way from its neighbour and
    the determinant of the problem that is solved keeps its sign: the sheet ends at its folds, the
    inverse singularities with "pose" and the direct ones with "inputs".  Across the others it goes
    on, and `loci` finds them.  Around a point where sheets meet, the node is of the sheet that
    comes first.  Source of the maps: Pérez Gámiz 2018, text lines 3160-3495, which has figures
    only.
    """
    if name not in ("pose", "inputs"):
        raise ValueError(f"name must be 'pose' or 'inputs', got {name!r}")
    if name == "pose":
        square(start)
    grid = np.asarray(first, float), np.asarray(second, float)
    shape = grid[0].size, grid[1].size
    at = columns(start.assembly, name)[list(axes)]
    root = tuple(int(np.abs(line - start.vector[i]).argmin()) for line, i in
                 zip(grid, at, strict=True))
    goal = start.part(name).copy()
    goal[list(axes)] = grid[0][root[0]], grid[1][root[1]]
    way = goal[None]
    trail = follow(start, pose=way) if name == "pose" else follow(start, inputs=way)
    if trail.why:
        raise ValueError(f"the start cannot be followed to the grid's node {goal.tolist()}: "
                         f"{trail.why}")
    vectors = np.full((*shape, start.vector.size), np.nan)
    vectors[root] = trail.last.vector
    front = np.array([root])
    while front.size:
        front = _advance(start, vectors, front, grid, at, name)
    return Map(name, axes, *grid, State(start.assembly, vectors))


def _advance(start: State, vectors: Array, front: Columns, grid: tuple[Array, Array],
             at: Columns, name: str) -> Columns:
    """Solve the neighbours of a front of nodes; the new front."""
    old = np.repeat(front, len(ASIDE), axis=0)
    new = old + np.tile(ASIDE, (len(front), 1))
    inside = ((new >= 0) & (new < vectors.shape[:2])).all(axis=1)
    old, new = old[inside], new[inside]
    fresh = np.isnan(vectors[new[:, 0], new[:, 1], 0])
    old, new = old[fresh], new[fresh]
    if not len(new):
        return new
    goal = np.stack([line[i] for line, i in zip(grid, new.T, strict=True)], axis=1)
    here = State(start.assembly, vectors[old[:, 0], old[:, 1]])
    there, good = onward(here, goal, at, name)
    vectors[new[good, 0], new[good, 1]] = there.vector[good]
    return np.unique(new[good], axis=0)


def onward(here: State, goal: Array, at: Columns, name: str, halvings: int = HALVINGS
           ) -> tuple[State, NDArray[np.bool_]]:
    """States (n,) moved to other values (n, 2) of two columns; and whether on the same sheet.

    Where one stride does not do, two halves are tried, and four quarters.
    """
    there, good = stride(here, goal, at, name)
    if halvings and not good.all():
        bad = np.flatnonzero(~good)
        middle = 0.5 * (here.vector[bad][:, at] + goal[bad])
        first, half = onward(here[bad], middle, at, name, halvings - 1)
        second, whole = onward(first[half], goal[bad[half]], at, name, halvings - 1)
        there.vector[bad[half]], good[bad[half]] = second.vector, whole
    return there, good


def stride(here: State, goal: Array, at: Columns, name: str) -> tuple[State, NDArray[np.bool_]]:
    """One stride along the tangent and one correction; and whether it can be trusted."""
    a, scale = here.assembly, sizes(here.assembly)[1]
    free = columns(a, "rods", "inputs" if name == "pose" else "pose")
    change = np.zeros_like(here.vector)
    change[:, at] = goal - here.vector[:, at]
    jacobian = closure(here)[1]
    change[:, free] = np.einsum("nij,nj->ni", ratio(jacobian, free, at), change[:, at])
    way = np.linalg.norm(change / scale, axis=1)
    guess = here.vector + change
    guess[:, at] = goal
    there, _ = newton(State(a, guess), free, STRAY * way)
    good = np.isfinite(there.vector[:, 0])
    before, after = (determinant(matrix[..., free]) for matrix in (
        jacobian[good], closure(there[good])[1]))
    good[good] = before * after > 0.0
    return there, good


def loci(m: Map, which: str) -> State:
    """Direct or inverse singularities where a sheet crosses them on the lines of its grid.

    Parameters
    ----------
    m : Map
    which : "direct" or "inverse", the singularity: see `proofmass.analytic.rods.derivatives`

    Returns
    -------
    State (points,)
        Where the determinant changes its sign between two neighbours, bisected to 1e-9 of an edge.
    """
    if which not in ("direct", "inverse"):
        raise ValueError(f"which must be 'direct' or 'inverse', got {which!r}")

    def sign(s: State) -> Array:
        return np.asarray(np.sign(getattr(derivatives(s), f"{which}_determinant")))

    low, high = _edges(m)
    at = columns(low.assembly, m.name)[list(m.axes)]
    side, change = sign(low), sign(low) != sign(high)
    low, high, side = low[change], high[change], side[change]
    for _ in range(BISECTIONS):
        between, good = onward(low, 0.5 * (low.vector + high.vector)[:, at], at, m.name)
        before = good & (sign(between) == side)
        low.vector[before] = between.vector[before]
        high.vector[~before] = between.vector[~before]
    return low


def _edges(m: Map) -> tuple[State, State]:
    """Both ends of the edges of a grid within the sheet."""
    v = m.states.vector
    pairs = (v[:-1], v[1:]), (v[:, :-1], v[:, 1:])
    low, high = (State(m.states.assembly, np.concatenate(
        [pair[end].reshape(-1, v.shape[-1]) for pair in pairs])) for end in (0, 1))
    there = np.isfinite(low.vector[:, 0]) & np.isfinite(high.vector[:, 0])
    low, high = low[there], high[there]
    at = columns(m.states.assembly, m.name)[list(m.axes)]
    met, good = onward(low, high.vector[:, at], at, m.name)
    good[good] = (np.abs(met.vector - high.vector)[good] < 1e-6).all(axis=1)
    return low[good], high[good]
