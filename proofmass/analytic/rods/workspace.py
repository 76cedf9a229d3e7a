"""Workspaces of flexible mechanisms: an equilibrium manifold over a grid, and its charts.

The charts show the rim of the manifold, its singularities, area, aspect and stiffness, for
mechanisms that have as many rods as degrees of freedom.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from proofmass.analytic.chart import Chart, ChartLine, Field, Panel, line_through
from proofmass.analytic.numerics import Array, Index
from proofmass.analytic.rods.continuation import STRAY, follow
from proofmass.analytic.rods.equilibrium import (
    Columns,
    RodState,
    clamps,
    closed,
    closure,
    columns,
    derivatives,
    determinant,
    ratio,
    sizes,
    square,
    unknowns,
)

ASIDE = np.array([[0, 1], [0, -1], [1, 0], [-1, 0]])
"""Steps from a node of the grid to its four neighbours."""
HALVINGS = 2
"""Default number of times that a stride on an equilibrium manifold may be halved."""
MORE = 4
"""Number of times that a stride from node to node may be halved."""
BISECTIONS = 30
"""Number of times that an edge of the grid is halved towards a singularity on it."""


@dataclass(frozen=True)
class Map:
    """An equilibrium manifold over a grid of poses or inputs.

    Attributes
    ----------
    name : str
        "pose" or "inputs": the part of a state whose values the grid gives.
    axes : tuple of int
        Two coordinates of that part, the axes of the grid; the others are those of the start.
    first, second : ndarray (m,), (n,)
        Values of the two coordinates [m or rad].
    states : RodState (m, n)
        States at the nodes; NaN where the manifold was not reached.
    """

    name: str
    axes: tuple[int, int]
    first: Array
    second: Array
    states: RodState

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Nodes (m, n) that the manifold covers."""
        return np.isfinite(self.states.vector[..., 0])


def spread(
    start: RodState,
    first: ArrayLike,
    second: ArrayLike,
    *,
    name: str = "pose",
    axes: tuple[int, int] = (0, 1),
    most: int = MORE,
) -> Map:
    r"""Continue the equilibrium manifold of one state over a grid, without jumps between its parts.

    ::

        . . o o .      S  start, followed to its nearest node
        . o x x o      x  solved: Newton's method along the tangent from a neighbour, in one batch
        . . o S o      o  next front
                       .  not reached, or beyond a fold

    Parameters
    ----------
    start : RodState
        One closed state.
    first, second : (m,), (n,)
        Increasing values of two coordinates [m or rad].
    name : "pose" (the inverse problem at each node) or "inputs" (the direct problem)
    axes : the two coordinates of that part of the state
    most : number of times that a stride from node to node may be halved

    Raises
    ------
    ValueError
        An unknown name; with "pose", a number of inputs that differs from that of the degrees of
        freedom; or a start that cannot be followed to the grid.

    Notes
    -----
    A node is accepted only if the correction is less than a quarter of the stride from its
    neighbour and the determinant of the problem that is solved keeps its sign.  The map therefore
    ends at the folds of the manifold: the inverse singularities with "pose" and the direct ones
    with "inputs".  It continues across the other singularities; `loci` finds them.
    Where several parts of the manifold lie over the same node, the node has the part that reaches
    it first.  Source of the maps: Pérez Gámiz 2018, text lines 3160-3495, which has figures only.
    """
    if name not in ("pose", "inputs"):
        raise ValueError(f"name must be 'pose' or 'inputs', got {name!r}")
    if name == "pose":
        square(start)
    grid = np.asarray(first, float), np.asarray(second, float)
    shape = grid[0].size, grid[1].size
    at = columns(start.assembly, name)[list(axes)]
    root = tuple(
        int(np.abs(line - start.vector[i]).argmin()) for line, i in zip(grid, at, strict=True)
    )
    goal = start.part(name).copy()
    goal[list(axes)] = grid[0][root[0]], grid[1][root[1]]
    way = goal[None]
    followed = follow(start, pose=way) if name == "pose" else follow(start, inputs=way)
    if followed.why:
        raise ValueError(
            f"the start cannot be followed to the grid's node {goal.tolist()}: {followed.why}"
        )
    vectors = np.full((*shape, start.vector.size), np.nan)
    vectors[root] = followed.last.vector
    m = Map(name, axes, *grid, RodState(start.assembly, vectors))
    for halvings in (HALVINGS, most):  # few first: nodes have several neighbours
        front = np.argwhere(m.reached)
        while front.size:
            front = _advance(m, front, at, halvings)
    return m


def _advance(m: Map, front: Columns, at: Columns, halvings: int) -> Columns:
    """Solve the neighbours of a front of nodes, in place, and return the new front."""
    vectors = m.states.vector
    old = np.repeat(front, len(ASIDE), axis=0)
    new = old + np.tile(ASIDE, (len(front), 1))
    inside = ((new >= 0) & (new < vectors.shape[:2])).all(axis=1)
    old, new = old[inside], new[inside]
    fresh = np.isnan(vectors[new[:, 0], new[:, 1], 0])
    old, new = old[fresh], new[fresh]
    if not len(new):
        return new
    goal = np.stack([m.first[new[:, 0]], m.second[new[:, 1]]], axis=1)
    here = RodState(m.states.assembly, vectors[old[:, 0], old[:, 1]])
    there, good = onward(here, goal, at, m.name, halvings)
    vectors[new[good, 0], new[good, 1]] = there.vector[good]
    return np.unique(new[good], axis=0)


def onward(
    here: RodState, goal: Array, at: Columns, name: str, halvings: int = HALVINGS
) -> tuple[RodState, NDArray[np.bool_]]:
    """States (n,) at other values (n, 2) of two columns, and whether they are on the same manifold.

    A stride that fails is divided into two halves, and those into quarters, `halvings` times.
    """
    there, good = stride(here, goal, at, name)
    if halvings and not good.all():
        bad = np.flatnonzero(~good)
        middle = 0.5 * (here.vector[bad][:, at] + goal[bad])
        first, half = onward(here[bad], middle, at, name, halvings - 1)
        second, whole = onward(first[half], goal[bad[half]], at, name, halvings - 1)
        there.vector[bad[half]], good[bad[half]] = second.vector, whole
    return there, good


def stride(
    here: RodState, goal: Array, at: Columns, name: str
) -> tuple[RodState, NDArray[np.bool_]]:
    """States after a stride along the tangent and its correction, and whether they are accepted."""
    a, scale = here.assembly, sizes(here.assembly)[1]
    free = columns(a, "rods", "inputs" if name == "pose" else "pose")
    change = np.zeros_like(here.vector)
    change[:, at] = goal - here.vector[:, at]
    jacobian = closure(here)[1]
    change[:, free] = np.einsum("nij,nj->ni", ratio(jacobian, free, at), change[:, at])
    way = np.linalg.norm(change / scale, axis=1)
    guess = here.vector + change
    guess[:, at] = goal
    found = closed(RodState(a, guess), free, STRAY * way)
    return found.states, found.side * np.sign(determinant(jacobian[..., free])) > 0.0


def loci(m: Map, which: str, rims: tuple[RodState, Columns] | None = None) -> RodState:
    """Direct or inverse singularities of an equilibrium manifold on the lines of its grid.

    Parameters
    ----------
    m : Map
    which : "direct" or "inverse", the singularity: see `proofmass.analytic.rods.equilibrium`
    rims : result of `rim`, to find singularities between the last nodes and the rim as well

    Returns
    -------
    RodState (points,)
        States between two neighbours where the determinant changes its sign, bisected to 1e-9 of an
        edge.
    """
    if which not in ("direct", "inverse"):
        raise ValueError(f"which must be 'direct' or 'inverse', got {which!r}")

    found = unknowns(m.states.assembly, which)

    def sign(s: RodState) -> Array:
        return np.asarray(np.sign(determinant(closure(s)[1][..., found])))

    low, high = _edges(m)
    if rims is not None:
        beside = m.states.vector[tuple(outward(m)[0].T)]
        low, high = (
            RodState(low.assembly, np.concatenate([one.vector, more]))
            for one, more in ((low, beside), (high, rims[0].vector))
        )
    at = columns(low.assembly, m.name)[list(m.axes)]
    side = sign(low)
    change = side != sign(high)
    low, high, side = low[change], high[change], side[change]
    for _ in range(BISECTIONS):
        between, good = onward(low, 0.5 * (low.vector + high.vector)[:, at], at, m.name)
        before = good & (sign(between) == side)
        low.vector[before] = between.vector[before]
        high.vector[~before] = between.vector[~before]
    return low


def _edges(m: Map) -> tuple[RodState, RodState]:
    """States at both ends of the edges of a grid whose ends follow from each other."""
    v = m.states.vector
    pairs = (v[:-1], v[1:]), (v[:, :-1], v[:, 1:])
    low, high = (
        RodState(
            m.states.assembly,
            np.concatenate([pair[end].reshape(-1, v.shape[-1]) for pair in pairs]),
        )
        for end in (0, 1)
    )
    there = np.isfinite(low.vector[:, 0]) & np.isfinite(high.vector[:, 0])
    low, high = low[there], high[there]
    at = columns(m.states.assembly, m.name)[list(m.axes)]
    met, good = onward(low, high.vector[:, at], at, m.name, MORE)
    good[good] = (np.abs(met.vector - high.vector)[good] < 1e-6).all(axis=1)
    return low[good], high[good]


FITS, LOOSE, MARGIN = 5, 0.5, 2
"""Windows that are tried for a map; the least ratio of areas of a fitted window to the one before,
with which that one fits; edges of the grid that are left free around the manifold."""
SAME = 1e-6
"""Largest difference [SI] between the vectors of states that are one state."""
TRIES = 16
"""Strides towards the rim of a manifold, halved where they fail."""
ON_LINE = 1e-6
"""Distance from a line of the grid, over an edge, within which points are on the line."""
COMMON = 0.8
"""Share of the nodes whose determinants the colours distinguish, since these have no bound at a
singularity."""


def sheet(start: RodState, nodes: int) -> Map:
    """Map of the poses that are reached from a state, over a window that is fitted to them."""
    several(nodes)
    a = start.assembly
    reach = a.length + a.rigid_extension + np.abs(a.arm)
    clamp = a.clamp if a.guide is None else np.full(a.rods, a.clamp.mean())
    at = np.stack([clamp.real, clamp.imag])
    widest = np.stack([(at - reach).max(axis=1), (at + reach).min(axis=1)])
    window = widest
    for count, most in ((max(5, nodes // 2), MORE - 1), (nodes, MORE)):
        for _ in range(FITS):
            sides = zip(start.pose, window.T.tolist(), strict=False)
            grid = [through(x, low, high, count) for x, (low, high) in sides]
            m = spread(start, *grid, most=most)
            step = (window[1] - window[0]) / (count - 1)
            seen = m.states.pose[m.reached][:, :2]
            low, high = seen.min(axis=0) - MARGIN * step, seen.max(axis=0) + MARGIN * step
            fitted = np.stack([np.maximum(widest[0], low), np.minimum(widest[1], high)])
            spare = np.stack([fitted[0] - window[0], window[1] - fitted[1]])
            share = np.prod((fitted[1] - fitted[0]) / (window[1] - window[0]))
            if (spare >= -ON_LINE * step).all() and share >= LOOSE:
                break
            window = fitted
    return m


def through(x: float, low: float, high: float, nodes: int) -> Array:
    """About `nodes` evenly spaced values from `low` to `high` of which x is one."""
    step = (high - low) / (nodes - 1)
    first, last = np.ceil((low - x) / step - ON_LINE), np.floor((high - x) / step + ON_LINE)
    return np.asarray(x + step * np.arange(first, last + 1.0))


def several(nodes: int) -> None:
    """ValueError for a number of nodes along an axis that is not within [5, 201]."""
    if not 5 <= nodes <= 201:
        raise ValueError(f"nodes must lie within [5, 201], got {nodes}")


@dataclass(frozen=True)
class MapMesh:
    """An equilibrium manifold over triangles: whole cells of its grid, and parts of border cells.

    Border cells are those at the rim, and those at tears between neighbours that do not follow from
    each other.

    Attributes
    ----------
    map : Map
    ends, loci : RodState (e,), (l,)
        States at the rim (`rim`) and half way to tears; singularities (`loci`).
    nodes, ways : ndarray (e, 2)
        The node beside each end, and the direction from the node to the end.
    right, up : ndarray (m - 1, n), (m, n - 1)
        Whether neighbours follow from each other.  A manifold that lies over itself is torn where
        they do not.
    """

    map: Map
    ends: RodState
    loci: RodState
    nodes: Columns
    ways: Columns
    right: NDArray[np.bool_]
    up: NDArray[np.bool_]

    @property
    def xy(self) -> Array:
        """Positions (k, 2) [m or rad] of all nodes, the ends and the loci, in this order."""
        grid = np.stack(np.meshgrid(self.map.first, self.map.second, indexing="ij"), axis=-1)
        at = columns(self.ends.assembly, self.map.name)[list(self.map.axes)]
        return np.concatenate(
            [grid.reshape(-1, 2), self.ends.vector[:, at], self.loci.vector[:, at]]
        )

    def values(self, nodes: Array, ends: Array, loci: Array) -> Array:
        """One array (k,) of values at all nodes, ends and loci [as given]."""
        return np.concatenate([np.ravel(nodes), ends, np.broadcast_to(loci, len(self.loci.vector))])

    def triangles(
        self, inside: NDArray[np.bool_], *, within: bool = False, beyond: bool = False
    ) -> Index:
        """Triangles (t, 3) over the nodes (m, n) that are `inside`, out to the rim and to tears.

        With `within` the triangles end at the loci; with `beyond` they also cover the area between
        loci and rim.  In a border cell, the corners that follow from each other and the ends beside
        them form a polygon.
        """
        m, n = inside.shape
        number = np.arange(m * n).reshape(m, n)
        there = np.array([inside[dx : m - 1 + dx, dy : n - 1 + dy] for dx, dy in CORNERS])
        follows = np.array([self.right[:, :-1], self.up[1:], self.right[:, 1:], self.up[:-1]])
        follows &= there & np.roll(there, -1, axis=0)
        i, j = np.nonzero(follows.all(axis=0))
        a, b, c, d = (number[i + dx, j + dy] for dx, dy in CORNERS)
        found = [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
        rims, passed = self.rims, self.crossings if within else {}

        def end(corner: tuple[int, int], other: tuple[int, int]) -> tuple[int | None, int | None]:
            """Numbers of the point at the singularity, or else the rim, and of that at the rim."""
            key = (*corner, other[0] - corner[0], other[1] - corner[1])
            return passed.get(key, rims.get(key)), rims.get(key)

        for x, y in np.argwhere(there.any(axis=0) & ~follows.all(axis=0)).tolist():
            corners = [(x + dx, y + dy) for dx, dy in CORNERS]
            on = follows[:, x, y]
            for k in np.flatnonzero(there[:, x, y] & ~np.roll(on, 1)).tolist():
                ring = [end(corners[k], corners[k - 1]), (int(number[corners[k]]), None)]
                while on[k]:
                    k = (k + 1) % 4
                    ring.append((int(number[corners[k]]), None))
                ring.append(end(corners[k], corners[(k + 1) % 4]))
                if None in (ring[0][0], ring[-1][0]):
                    continue
                found.append(fan([inner for inner, _ in ring]))
                (one, rim_one), (other, rim_other) = ring[-1], ring[0]
                if beyond and None not in (rim_one, rim_other):
                    last = [one, rim_one, rim_other, other]
                    last = list(dict.fromkeys(last))  # without a locus, the rim is in it twice
                    found += [fan(last)] if len(last) > 2 else []
        return np.concatenate(found).astype(np.intp)

    @property
    def rims(self) -> dict[tuple[int, ...], int]:
        """Numbers of the ends, by node and direction along a line of the grid."""
        pairs = zip(self.nodes.tolist(), self.ways.tolist(), strict=True)
        return {(*node, *way): self.map.reached.size + k for k, (node, way) in enumerate(pairs)}

    @property
    def crossings(self) -> dict[tuple[int, ...], int]:
        """Numbers of the loci, by node and direction along a line of the grid, from both sides."""
        if not len(self.loci.vector):
            return {}
        before = self.map.reached.size + len(self.ends.vector)
        grid = self.map.first, self.map.second
        place = np.stack(
            [
                np.interp(x, values, np.arange(values.size))
                for x, values in zip(self.xy[before:].T, grid, strict=True)
            ],
            axis=1,
        )
        on = np.abs(place - place.round()) < ON_LINE
        low = np.where(on, place.round(), np.floor(place)).astype(int)
        found: dict[tuple[int, ...], int] = {}
        for k, (node, level) in enumerate(zip(low.tolist(), on.tolist(), strict=True), before):
            x, y = int(level[1]), int(level[0])
            found[(*node, x, y)] = found[(node[0] + x, node[1] + y, -x, -y)] = k
        return found


def fan(ring: list[int | None]) -> Columns:
    """Triangles (t, 3) into which the diagonals from its first corner divide a polygon.

    >>> fan([4, 7, 1, 2]).tolist()
    [[4, 7, 1], [4, 1, 2]]
    """
    return np.array([(ring[0], ring[k], ring[k + 1]) for k in range(1, len(ring) - 1)], int)


CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))
"""Corners of a cell from its first node, counter-clockwise."""


def meshed(m: Map, edges: Columns, ends: RodState, loci: RodState) -> MapMesh:
    """Triangles of a map, from its loci and the edges of neighbours that follow from each other.

    The manifold is cut half way between neighbours that do not follow from each other.
    """
    rows, columns_ = m.reached.shape
    right = np.zeros((rows - 1, columns_), bool)
    up = np.zeros((rows, columns_ - 1), bool)
    low, high = edges.min(axis=1), edges.max(axis=1)
    level = high - low == 1
    up[low[level] // columns_, low[level] % columns_] = True
    right[low[~level] // columns_, low[~level] % columns_] = True
    nodes, ways = outward(m)
    beside, over = torn(m, right, up)
    cut = marched(m, beside, over, np.full(len(beside), 0.5))
    states = RodState(ends.assembly, np.concatenate([ends.vector, cut.vector]))
    nodes, ways = np.concatenate([nodes, beside]), np.concatenate([ways, over])
    return MapMesh(m, states, loci, nodes, ways, right, up)


def torn(m: Map, right: NDArray[np.bool_], up: NDArray[np.bool_]) -> tuple[Columns, Columns]:
    """Nodes (e, 2) and directions (e, 2) to neighbours that are reached and do not follow."""
    found = []
    for follows, way in ((right, (1, 0)), (up, (0, 1))):
        dx, dy = way
        low = np.argwhere(
            m.reached[: m.first.size - dx, : m.second.size - dy] & ~follows & m.reached[dx:, dy:]
        )
        found += [(low, np.tile(way, (len(low), 1))), (low + way, -np.tile(way, (len(low), 1)))]
    nodes, ways = (np.concatenate(part) for part in zip(*found, strict=True))
    return nodes, ways


def over_poses(start: RodState, m: Map, unit: str) -> Chart:
    """Chart of a map of poses: its singularities, its stiffness, and the inputs of each pose."""
    (edges, _), (ends, ways) = joined(m), rim(m)
    own = aspect(m, edges, start)
    singular = loci(m, "direct", (ends, ways))
    mesh = meshed(m, edges, ends, singular)
    lines = (
        *line(m, singular, "direct singularity"),
        *line(m, ends, "inverse singularity"),
        *posture(start),
    )
    nodes, last = derivatives(m.states), derivatives(mesh.ends)
    at = tuple(mesh.nodes.T)
    beside = own[at] & (nodes.direct_determinant[at] * last.direct_determinant > 0.0)
    panels = [
        Panel(
            lines,
            determinants(mesh, nodes.inverse, last.inverse, "det(dq/dP)", unit),
            "Singularities",
        ),
        Panel(
            lines,
            over_mesh(
                mesh,
                mesh.values(
                    stiffness_of(m.states, own), stiffness_of(mesh.ends, beside), np.zeros(1)
                ),
                "least stiffness",
                "N/m",
                mesh.triangles(own, within=True),
            ),
            "Stiffness, to the first singularity",
        ),
    ]
    whole = mesh.triangles(m.reached)
    for k in range(m.states.inputs.shape[-1]):
        name, own_unit = (
            (f"motor angle {k + 1}", "rad")
            if start.assembly.guide is None
            else (f"slide {k + 1}", "m")
        )
        values = mesh.values(m.states.inputs[..., k], mesh.ends.inputs[:, k], singular.inputs[:, k])
        panels.append(
            Panel(lines, over_mesh(mesh, values, name, own_unit, whole), name.capitalize())
        )
    return Chart(
        ("x", "m"),
        ("y", "m"),
        tuple(panels),
        f"Poses that are reached from here: {area(m, ends, ways):.3g} m², of which "
        f"{own.sum() / m.reached.sum():.0%} without a singularity on the way. In an "
        "inverse singularity some motion of the platform needs infinite rates of the "
        "motors; in a direct one the platform can move although the motors are at rest. "
        "Where contours break off inside, the equilibrium manifold lies over itself: the "
        "inputs of a pose depend on the path to it.",
        alike=True,
    )


def over_mesh(
    mesh: MapMesh, values: Array, name: str, unit: str, triangles: Index, *, signed: bool = False
) -> Field:
    """A field over the triangles at whose corners it is finite."""
    x, y = mesh.xy.T
    whole = np.isfinite(values[triangles]).all(axis=1)
    return Field(x, y, values, name, unit, signed, triangles[whole])


def determinants(mesh: MapMesh, nodes: Array, ends: Array, name: str, unit: str) -> Field:
    """Determinants over a map, clipped to the range of most of them, since they have no bound.

    They are zero on the mesh's loci.  Where the sign at the rim differs from that of the last node
    and no locus was found between them, there is no value at the rim.
    """
    inner, outer = determinant(nodes), determinant(ends)
    most = np.nanquantile(np.abs(inner), COMMON)
    beside = inner[tuple(mesh.nodes.T)]
    crossings = mesh.crossings
    known = np.array([key in crossings for key in mesh.rims], bool)
    outer = np.where((outer * beside > 0.0) | known, outer, np.nan)
    values = np.clip(mesh.values(inner, outer, np.zeros(1)), -most, most)
    parts = [
        mesh.triangles(mesh.map.reached & (sign * inner > 0.0), within=True, beyond=True)
        for sign in (1, -1)
    ]
    return over_mesh(mesh, values, name, unit, np.concatenate(parts), signed=True)


def stiffness_of(states: RodState, own: NDArray[np.bool_]) -> Array:
    """Least stiffness [N/m] (...) to a force on a platform that may rotate; NaN off `own`."""
    values = np.full(own.shape, np.nan)
    compliance = np.linalg.inv(derivatives(states[own]).stiffness)[:, :2, :2]
    values[own] = 1.0 / np.linalg.eigvalsh(compliance)[:, -1]
    return values


def aspect(m: Map, edges: Columns, start: RodState) -> NDArray[np.bool_]:
    """Nodes of a map that are connected to its first node without a singularity on the way."""
    sign = np.sign(derivatives(m.states).direct_determinant).ravel()
    at = start.vector[columns(start.assembly, m.name)[list(m.axes)]]
    root = np.ravel_multi_index(
        [
            int(np.abs(values - x).argmin())
            for values, x in zip((m.first, m.second), at, strict=True)
        ],
        m.reached.shape,
    )
    low, high = edges[sign[edges[:, 0]] == sign[edges[:, 1]]].T
    graph = coo_array((np.ones(low.size), (low, high)), (sign.size, sign.size))
    parts = connected_components(graph, directed=False)[1]
    return np.asarray(parts == parts[root]).reshape(m.reached.shape)


def joined(m: Map) -> tuple[Columns, NDArray[np.bool_]]:
    """Edges (e, 2) whose ends follow from each other, and whether nodes (m, n) are beside tears.

    The edges are pairs of flat numbers of nodes.  Where a manifold lies over itself, neighbours may
    belong to two parts of it; between such nodes the map is torn.
    """
    number = np.arange(m.reached.size).reshape(m.reached.shape)
    ends = np.concatenate(
        [
            np.stack([number[:-1], number[1:]], axis=-1).reshape(-1, 2),
            np.stack([number[:, :-1], number[:, 1:]], axis=-1).reshape(-1, 2),
        ]
    )
    ends = ends[m.reached.ravel()[ends].all(axis=1)]
    at = columns(m.states.assembly, m.name)[list(m.axes)]
    flat, good = m.states.vector.reshape(m.reached.size, -1), np.zeros(len(ends), bool)
    for way in (1, -1):
        left = np.flatnonzero(~good)
        here, there = flat[ends[left, ::way]].swapaxes(0, 1)
        moved, met = onward(RodState(m.states.assembly, here), there[:, at], at, m.name, MORE)
        good[left[met]] = (np.abs(moved.vector - there)[met] < SAME).all(axis=1)
    torn = np.zeros(m.reached.size, bool)
    torn[ends[~good]] = True
    return ends[good], torn.reshape(m.reached.shape)


def rim(m: Map) -> tuple[RodState, Columns]:
    """Last states (e,) of a manifold on the lines of its grid, and the directions (e, 2) outwards.

    They are found by strides that are halved where they fail.  Most are within 1e-3 of an edge of
    the rim; some are further away, where a rod is nearly straight and Newton's method fails first.
    """
    nodes, ways = outward(m)
    border = ((nodes + ways < 0) | (nodes + ways >= m.reached.shape)).any(axis=1)
    return marched(m, nodes, ways, np.where(border, 0.0, np.inf)), ways


def marched(m: Map, nodes: Columns, ways: Columns, room: Array) -> RodState:
    """Last states (e,) from nodes along lines of the grid, no further than `room` edges."""
    edge = ways * [np.mean(np.diff(m.first)), np.mean(np.diff(m.second))]
    at = columns(m.states.assembly, m.name)[list(m.axes)]
    last = RodState(m.states.assembly, m.states.vector[tuple(nodes.T)])
    share = np.minimum(room, 0.5)
    for _ in range(TRIES):
        goal = last.vector[:, at] + share[:, None] * edge
        there, good = onward(last, goal, at, m.name, 0)
        last.vector[good] = there.vector[good]
        room = room - share * good
        share = np.minimum(np.where(good, share, share / 2.0), room)
    return last


def outward(m: Map) -> tuple[Columns, Columns]:
    """Nodes (e, 2) of a map and the directions (e, 2) in which the next node is not reached."""
    nodes = np.argwhere(m.reached)
    ways = np.tile(ASIDE, (len(nodes), 1))
    nodes = np.repeat(nodes, len(ASIDE), axis=0)
    out = ~np.pad(m.reached, 1)[tuple((nodes + ways + 1).T)]
    return nodes[out], ways[out]


def area(m: Map, ends: RodState, ways: Columns) -> float:
    """Area of a map [m^2]: its extent along the second axis, summed over the first.

    The error is of about second order in the step, that of counting nodes of first order.  It is
    1.5 % with 17 nodes and 0.1 % with 35 for the lowest equilibrium at the inputs of Table 7.
    """
    second = ends.vector[:, columns(ends.assembly, m.name)[m.axes[1]]]
    return float(np.mean(np.diff(m.first)) * (second @ ways[:, 1]))


def line(m: Map, points: RodState, text: str) -> tuple[ChartLine, ...]:
    """Chart line of points on lines of a grid, joined in pairs across its cells, or no line."""
    at = columns(points.assembly, m.name)[list(m.axes)]
    place = np.stack(
        [
            np.interp(points.vector[:, i], values, np.arange(values.size))
            for i, values in zip(at, (m.first, m.second), strict=True)
        ],
        axis=1,
    )
    on = np.abs(place - place.round()) < ON_LINE
    low = np.where(on, place.round() - 1.0, np.floor(place)).astype(int)
    cells: dict[tuple[int, ...], list[int]] = {}
    for i in np.flatnonzero(on.sum(axis=1) == 1):
        for cell in (low[i], low[i] + on[i]):
            cells.setdefault(tuple(cell.tolist()), []).append(int(i))
    pairs = np.array([pair for pair in cells.values() if len(pair) == 2], int).reshape(-1, 2)
    xy = np.pad(
        points.vector[:, at][pairs], ((0, 0), (0, 1), (0, 0)), constant_values=np.nan
    ).reshape(-1, 2)
    return (ChartLine(xy[:, 0], xy[:, 1], text),) if len(xy) else ()


def posture(s: RodState) -> tuple[ChartLine, ChartLine]:
    """Chart lines of one state: rods and platform, and clamps."""
    x, y, *_ = s.shape(np.linspace(0.0, 1.0, 61))
    pins = s.pose @ [1.0, 1.0j, 0.0][: s.pose.size] + np.exp(1j * s.pose[-1]) * s.assembly.arm
    z = np.concatenate([x + 1j * y, pins[:, None], np.full((len(x), 1), np.nan)], axis=1).ravel()
    z, clamp = np.concatenate([z, pins, pins[:1]]), clamps(s)[1]
    return line_through(z, "here"), line_through(clamp, "clamps", points=True)
