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
from proofmass.analytic.rods.continuation import MAX_STRIDE_CORRECTION, follow
from proofmass.analytic.rods.equilibrium import (
    Columns,
    RodState,
    check_square,
    clamps_and_forces,
    close_states,
    closure,
    columns,
    derivatives,
    determinant,
    implicit_derivatives,
    residual_and_state_sizes,
    singularity_columns,
)
from proofmass.base.arrays import Array, Index

NEIGHBOUR_STEPS = np.array([[0, 1], [0, -1], [1, 0], [-1, 0]])
"""Steps from a node of the grid to its four neighbours."""
DEFAULT_HALVINGS = 2
"""Default number of times that a stride on an equilibrium manifold may be halved."""
MAX_NODE_HALVINGS = 4
"""Number of times that a stride from node to node may be halved."""
EDGE_HALVINGS = 30
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


def map_equilibria(
    start: RodState,
    first: ArrayLike,
    second: ArrayLike,
    *,
    name: str = "pose",
    axes: tuple[int, int] = (0, 1),
    max_halvings: int = MAX_NODE_HALVINGS,
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
    max_halvings : number of times that a stride from node to node may be halved

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
    with "inputs".  It continues across the other singularities; `find_singularities` finds them.
    Where several parts of the manifold lie over the same node, the node has the part that reaches
    it first.  Source of the maps: Pérez Gámiz 2018, text lines 3160-3495, which has figures only.
    """
    if name not in ("pose", "inputs"):
        raise ValueError(f"name must be 'pose' or 'inputs', got {name!r}")
    if name == "pose":
        check_square(start)
    grid = np.asarray(first, float), np.asarray(second, float)
    shape = grid[0].size, grid[1].size
    axis_columns = columns(start.assembly, name)[list(axes)]
    root = tuple(
        int(np.abs(line - start.vector[i]).argmin())
        for line, i in zip(grid, axis_columns, strict=True)
    )
    goal = start.part(name).copy()
    goal[list(axes)] = grid[0][root[0]], grid[1][root[1]]
    way_point = goal[None]
    followed = follow(start, pose=way_point) if name == "pose" else follow(start, inputs=way_point)
    if followed.why:
        raise ValueError(
            f"the start cannot be followed to the grid's node {goal.tolist()}: {followed.why}"
        )
    vectors = np.full((*shape, start.vector.size), np.nan)
    vectors[root] = followed.last.vector
    m = Map(name, axes, *grid, RodState(start.assembly, vectors))
    for halvings in (DEFAULT_HALVINGS, max_halvings):  # few first: nodes have several neighbours
        front = np.argwhere(m.reached)
        while front.size:
            front = _advance_front(m, front, axis_columns, halvings)
    return m


def _advance_front(m: Map, front: Columns, axis_columns: Columns, halvings: int) -> Columns:
    """Solve the neighbours of a front of nodes, in place, and return the new front."""
    vectors = m.states.vector
    old = np.repeat(front, len(NEIGHBOUR_STEPS), axis=0)
    new = old + np.tile(NEIGHBOUR_STEPS, (len(front), 1))
    inside = ((new >= 0) & (new < vectors.shape[:2])).all(axis=1)
    old, new = old[inside], new[inside]
    fresh = np.isnan(vectors[new[:, 0], new[:, 1], 0])
    old, new = old[fresh], new[fresh]
    if not len(new):
        return new
    goal = np.stack([m.first[new[:, 0]], m.second[new[:, 1]]], axis=1)
    here = RodState(m.states.assembly, vectors[old[:, 0], old[:, 1]])
    there, good = move_states(here, goal, axis_columns, m.name, halvings)
    vectors[new[good, 0], new[good, 1]] = there.vector[good]
    return np.unique(new[good], axis=0)


def move_states(
    here: RodState, goal: Array, axis_columns: Columns, name: str, halvings: int = DEFAULT_HALVINGS
) -> tuple[RodState, NDArray[np.bool_]]:
    """States (n,) at other values (n, 2) of two columns, and whether they are on the same manifold.

    A stride that fails is divided into two halves, and those into quarters, `halvings` times.
    """
    there, good = take_stride(here, goal, axis_columns, name)
    if halvings and not good.all():
        bad = np.flatnonzero(~good)
        middle = 0.5 * (here.vector[bad][:, axis_columns] + goal[bad])
        first, half = move_states(here[bad], middle, axis_columns, name, halvings - 1)
        second, whole = move_states(first[half], goal[bad[half]], axis_columns, name, halvings - 1)
        there.vector[bad[half]], good[bad[half]] = second.vector, whole
    return there, good


def take_stride(
    here: RodState, goal: Array, axis_columns: Columns, name: str
) -> tuple[RodState, NDArray[np.bool_]]:
    """States after a stride along the tangent and its correction, and whether they are accepted."""
    a, scale = here.assembly, residual_and_state_sizes(here.assembly)[1]
    free = columns(a, "rods", "inputs" if name == "pose" else "pose")
    change = np.zeros_like(here.vector)
    change[:, axis_columns] = goal - here.vector[:, axis_columns]
    jacobian = closure(here)[1]
    change[:, free] = np.einsum(
        "nij,nj->ni", implicit_derivatives(jacobian, free, axis_columns), change[:, axis_columns]
    )
    way = np.linalg.norm(change / scale, axis=1)
    guess = here.vector + change
    guess[:, axis_columns] = goal
    found = close_states(RodState(a, guess), free, MAX_STRIDE_CORRECTION * way)
    return found.states, found.side * np.sign(determinant(jacobian[..., free])) > 0.0


def find_singularities(
    m: Map, which: str, rims: tuple[RodState, Columns] | None = None
) -> RodState:
    """Direct or inverse singularities of an equilibrium manifold on the lines of its grid.

    Parameters
    ----------
    m : Map
    which : "direct" or "inverse", the singularity: see `proofmass.analytic.rods.equilibrium`
    rims : result of `find_rim`, to find singularities between the last nodes and the rim as well

    Returns
    -------
    RodState (points,)
        States between two neighbours where the determinant changes its sign, bisected to 1e-9 of an
        edge.
    """
    if which not in ("direct", "inverse"):
        raise ValueError(f"which must be 'direct' or 'inverse', got {which!r}")

    found = singularity_columns(m.states.assembly, which)

    def sign(s: RodState) -> Array:
        return np.asarray(np.sign(determinant(closure(s)[1][..., found])))

    low, high = _edge_states(m)
    if rims is not None:
        border_vectors = m.states.vector[tuple(border_directions(m)[0].T)]
        low, high = (
            RodState(low.assembly, np.concatenate([one.vector, more]))
            for one, more in ((low, border_vectors), (high, rims[0].vector))
        )
    axis_columns = columns(low.assembly, m.name)[list(m.axes)]
    side = sign(low)
    change = side != sign(high)
    low, high, side = low[change], high[change], side[change]
    for _ in range(EDGE_HALVINGS):
        between, good = move_states(
            low, 0.5 * (low.vector + high.vector)[:, axis_columns], axis_columns, m.name
        )
        before = good & (sign(between) == side)
        low.vector[before] = between.vector[before]
        high.vector[~before] = between.vector[~before]
    return low


def _edge_states(m: Map) -> tuple[RodState, RodState]:
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
    axis_columns = columns(m.states.assembly, m.name)[list(m.axes)]
    met, good = move_states(
        low, high.vector[:, axis_columns], axis_columns, m.name, MAX_NODE_HALVINGS
    )
    good[good] = (np.abs(met.vector - high.vector)[good] < 1e-6).all(axis=1)
    return low[good], high[good]


MAX_WINDOWS, MIN_WINDOW_RATIO, MARGIN_EDGES = 5, 0.5, 2
"""Windows that are tried for a map; the least ratio of areas of a fitted window to the one before,
with which that one fits; edges of the grid that are left free around the manifold."""
STATE_TOLERANCE = 1e-6
"""Largest difference [SI] between the vectors of states that are one state."""
MAX_RIM_STRIDES = 16
"""Strides towards the rim of a manifold, halved where they fail."""
LINE_TOLERANCE = 1e-6
"""Distance from a line of the grid, over an edge, within which points are on the line."""
COLOURED_NODES_SHARE = 0.8
"""Share of the nodes whose determinants the colours distinguish, since these have no bound at a
singularity."""


def fit_pose_map(start: RodState, nodes: int) -> Map:
    """Map of the poses that are reached from a state, over a window that is fitted to them."""
    check_nodes(nodes)
    a = start.assembly
    reach = a.length + a.rigid_extension + np.abs(a.arm)
    clamp = a.clamp if a.guide is None else np.full(a.rods, a.clamp.mean())
    clamps_xy = np.stack([clamp.real, clamp.imag])
    widest = np.stack([(clamps_xy - reach).max(axis=1), (clamps_xy + reach).min(axis=1)])
    window = widest
    for count, max_halvings in (
        (max(5, nodes // 2), MAX_NODE_HALVINGS - 1),
        (nodes, MAX_NODE_HALVINGS),
    ):
        for _ in range(MAX_WINDOWS):
            sides = zip(start.pose, window.T.tolist(), strict=False)
            grid = [values_through(x, low, high, count) for x, (low, high) in sides]
            m = map_equilibria(start, *grid, max_halvings=max_halvings)
            step = (window[1] - window[0]) / (count - 1)
            seen = m.states.pose[m.reached][:, :2]
            low, high = (
                seen.min(axis=0) - MARGIN_EDGES * step,
                seen.max(axis=0) + MARGIN_EDGES * step,
            )
            fitted = np.stack([np.maximum(widest[0], low), np.minimum(widest[1], high)])
            spare = np.stack([fitted[0] - window[0], window[1] - fitted[1]])
            share = np.prod((fitted[1] - fitted[0]) / (window[1] - window[0]))
            if (spare >= -LINE_TOLERANCE * step).all() and share >= MIN_WINDOW_RATIO:
                break
            window = fitted
    return m


def values_through(x: float, low: float, high: float, nodes: int) -> Array:
    """About `nodes` evenly spaced values from `low` to `high` of which x is one."""
    step = (high - low) / (nodes - 1)
    first, last = (
        np.ceil((low - x) / step - LINE_TOLERANCE),
        np.floor((high - x) / step + LINE_TOLERANCE),
    )
    return np.asarray(x + step * np.arange(first, last + 1.0))


def check_nodes(nodes: int) -> None:
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
        States at the rim (`find_rim`) and half way to tears; singularities (`find_singularities`).
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
        there = np.array([inside[dx : m - 1 + dx, dy : n - 1 + dy] for dx, dy in CELL_CORNERS])
        follows = np.array([self.right[:, :-1], self.up[1:], self.right[:, 1:], self.up[:-1]])
        follows &= there & np.roll(there, -1, axis=0)
        i, j = np.nonzero(follows.all(axis=0))
        a, b, c, d = (number[i + dx, j + dy] for dx, dy in CELL_CORNERS)
        found = [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
        rims, passed = self.rims, self.crossings if within else {}

        def end(corner: tuple[int, int], other: tuple[int, int]) -> tuple[int | None, int | None]:
            """Numbers of the point at the singularity, or else the rim, and of that at the rim."""
            key = (*corner, other[0] - corner[0], other[1] - corner[1])
            return passed.get(key, rims.get(key)), rims.get(key)

        for x, y in np.argwhere(there.any(axis=0) & ~follows.all(axis=0)).tolist():
            corners = [(x + dx, y + dy) for dx, dy in CELL_CORNERS]
            on = follows[:, x, y]
            for k in np.flatnonzero(there[:, x, y] & ~np.roll(on, 1)).tolist():
                ring = [end(corners[k], corners[k - 1]), (int(number[corners[k]]), None)]
                while on[k]:
                    k = (k + 1) % 4
                    ring.append((int(number[corners[k]]), None))
                ring.append(end(corners[k], corners[(k + 1) % 4]))
                if None in (ring[0][0], ring[-1][0]):
                    continue
                found.append(triangulate_polygon([inner for inner, _ in ring]))
                (one, rim_one), (other, rim_other) = ring[-1], ring[0]
                if beyond and None not in (rim_one, rim_other):
                    last = [one, rim_one, rim_other, other]
                    last = list(dict.fromkeys(last))  # without a locus, the rim is in it twice
                    found += [triangulate_polygon(last)] if len(last) > 2 else []
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
        on = np.abs(place - place.round()) < LINE_TOLERANCE
        low = np.where(on, place.round(), np.floor(place)).astype(int)
        found: dict[tuple[int, ...], int] = {}
        for k, (node, level) in enumerate(zip(low.tolist(), on.tolist(), strict=True), before):
            x, y = int(level[1]), int(level[0])
            found[(*node, x, y)] = found[(node[0] + x, node[1] + y, -x, -y)] = k
        return found


def triangulate_polygon(ring: list[int | None]) -> Columns:
    """Triangles (t, 3) into which the diagonals from its first corner divide a polygon.

    >>> triangulate_polygon([4, 7, 1, 2]).tolist()
    [[4, 7, 1], [4, 1, 2]]
    """
    return np.array([(ring[0], ring[k], ring[k + 1]) for k in range(1, len(ring) - 1)], int)


CELL_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))
"""Corners of a cell from its first node, counter-clockwise."""


def mesh_map(m: Map, edges: Columns, ends: RodState, loci: RodState) -> MapMesh:
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
    nodes, directions = border_directions(m)
    tear_nodes, tear_directions = find_tears(m, right, up)
    cut = march_from_nodes(m, tear_nodes, tear_directions, np.full(len(tear_nodes), 0.5))
    states = RodState(ends.assembly, np.concatenate([ends.vector, cut.vector]))
    nodes, directions = (
        np.concatenate([nodes, tear_nodes]),
        np.concatenate([directions, tear_directions]),
    )
    return MapMesh(m, states, loci, nodes, directions, right, up)


def find_tears(m: Map, right: NDArray[np.bool_], up: NDArray[np.bool_]) -> tuple[Columns, Columns]:
    """Nodes (e, 2) and directions (e, 2) to neighbours that are reached and do not follow."""
    found = []
    for follows, way in ((right, (1, 0)), (up, (0, 1))):
        dx, dy = way
        low = np.argwhere(
            m.reached[: m.first.size - dx, : m.second.size - dy] & ~follows & m.reached[dx:, dy:]
        )
        found += [(low, np.tile(way, (len(low), 1))), (low + way, -np.tile(way, (len(low), 1)))]
    nodes, directions = (np.concatenate(part) for part in zip(*found, strict=True))
    return nodes, directions


def pose_chart(start: RodState, m: Map, unit: str) -> Chart:
    """Chart of a map of poses: its singularities, its stiffness, and the inputs of each pose."""
    (edges, _), (ends, directions) = connected_edges(m), find_rim(m)
    in_aspect = aspect_nodes(m, edges, start)
    singular = find_singularities(m, "direct", (ends, directions))
    mesh = mesh_map(m, edges, ends, singular)
    lines = (
        *locus_lines(m, singular, "direct singularity"),
        *locus_lines(m, ends, "inverse singularity"),
        *posture_lines(start),
    )
    nodes, last = derivatives(m.states), derivatives(mesh.ends)
    border_nodes = tuple(mesh.nodes.T)
    beside = in_aspect[border_nodes] & (
        nodes.direct_determinant[border_nodes] * last.direct_determinant > 0.0
    )
    panels = [
        Panel(
            lines,
            determinant_field(mesh, nodes.inverse, last.inverse, "det(dq/dP)", unit),
            "Singularities",
        ),
        Panel(
            lines,
            mesh_field(
                mesh,
                mesh.values(
                    least_stiffness(m.states, in_aspect),
                    least_stiffness(mesh.ends, beside),
                    np.zeros(1),
                ),
                "least stiffness",
                "N/m",
                mesh.triangles(in_aspect, within=True),
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
            Panel(lines, mesh_field(mesh, values, name, own_unit, whole), name.capitalize())
        )
    return Chart(
        ("x", "m"),
        ("y", "m"),
        tuple(panels),
        f"Poses that are reached from here: {map_area(m, ends, directions):.3g} m², of which "
        f"{in_aspect.sum() / m.reached.sum():.0%} without a singularity on the way. In an "
        "inverse singularity some motion of the platform needs infinite rates of the "
        "motors; in a direct one the platform can move although the motors are at rest. "
        "Where contours break off inside, the equilibrium manifold lies over itself: the "
        "inputs of a pose depend on the path to it.",
        equal_scales=True,
    )


def mesh_field(
    mesh: MapMesh, values: Array, name: str, unit: str, triangles: Index, *, signed: bool = False
) -> Field:
    """A field over the triangles at whose corners it is finite."""
    x, y = mesh.xy.T
    whole = np.isfinite(values[triangles]).all(axis=1)
    return Field(x, y, values, name, unit, signed, triangles[whole])


def determinant_field(mesh: MapMesh, nodes: Array, ends: Array, name: str, unit: str) -> Field:
    """Determinants over a map, clipped to the range of most of them, since they have no bound.

    They are zero on the mesh's loci.  Where the sign at the rim differs from that of the last node
    and no locus was found between them, there is no value at the rim.
    """
    inner, outer = determinant(nodes), determinant(ends)
    most = np.nanquantile(np.abs(inner), COLOURED_NODES_SHARE)
    beside = inner[tuple(mesh.nodes.T)]
    crossings = mesh.crossings
    known = np.array([key in crossings for key in mesh.rims], bool)
    outer = np.where((outer * beside > 0.0) | known, outer, np.nan)
    values = np.clip(mesh.values(inner, outer, np.zeros(1)), -most, most)
    parts = [
        mesh.triangles(mesh.map.reached & (sign * inner > 0.0), within=True, beyond=True)
        for sign in (1, -1)
    ]
    return mesh_field(mesh, values, name, unit, np.concatenate(parts), signed=True)


def least_stiffness(states: RodState, in_aspect: NDArray[np.bool_]) -> Array:
    """Least stiffness [N/m] (...) to a force on a platform that may rotate; NaN off `in_aspect`."""
    values = np.full(in_aspect.shape, np.nan)
    compliance = derivatives(states[in_aspect]).compliance[:, :2, :2]
    values[in_aspect] = 1.0 / np.linalg.eigvalsh(compliance)[:, -1]
    return values


def aspect_nodes(m: Map, edges: Columns, start: RodState) -> NDArray[np.bool_]:
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


def connected_edges(m: Map) -> tuple[Columns, NDArray[np.bool_]]:
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
    axis_columns = columns(m.states.assembly, m.name)[list(m.axes)]
    flat, good = m.states.vector.reshape(m.reached.size, -1), np.zeros(len(ends), bool)
    for way in (1, -1):
        left = np.flatnonzero(~good)
        here, there = flat[ends[left, ::way]].swapaxes(0, 1)
        moved, met = move_states(
            RodState(m.states.assembly, here),
            there[:, axis_columns],
            axis_columns,
            m.name,
            MAX_NODE_HALVINGS,
        )
        good[left[met]] = (np.abs(moved.vector - there)[met] < STATE_TOLERANCE).all(axis=1)
    torn = np.zeros(m.reached.size, bool)
    torn[ends[~good]] = True
    return ends[good], torn.reshape(m.reached.shape)


def find_rim(m: Map) -> tuple[RodState, Columns]:
    """Last states (e,) of a manifold on the lines of its grid, and the directions (e, 2) outwards.

    They are found by strides that are halved where they fail.  Most are within 1e-3 of an edge of
    the rim; some are further away, where a rod is nearly straight and Newton's method fails first.
    """
    nodes, directions = border_directions(m)
    border = ((nodes + directions < 0) | (nodes + directions >= m.reached.shape)).any(axis=1)
    return march_from_nodes(m, nodes, directions, np.where(border, 0.0, np.inf)), directions


def march_from_nodes(m: Map, nodes: Columns, directions: Columns, room: Array) -> RodState:
    """Last states (e,) from nodes along lines of the grid, no further than `room` edges."""
    edge = directions * [np.mean(np.diff(m.first)), np.mean(np.diff(m.second))]
    axis_columns = columns(m.states.assembly, m.name)[list(m.axes)]
    last = RodState(m.states.assembly, m.states.vector[tuple(nodes.T)])
    share = np.minimum(room, 0.5)
    for _ in range(MAX_RIM_STRIDES):
        goal = last.vector[:, axis_columns] + share[:, None] * edge
        there, good = move_states(last, goal, axis_columns, m.name, 0)
        last.vector[good] = there.vector[good]
        room = room - share * good
        share = np.minimum(np.where(good, share, share / 2.0), room)
    return last


def border_directions(m: Map) -> tuple[Columns, Columns]:
    """Nodes (e, 2) of a map and the directions (e, 2) in which the next node is not reached."""
    nodes = np.argwhere(m.reached)
    directions = np.tile(NEIGHBOUR_STEPS, (len(nodes), 1))
    nodes = np.repeat(nodes, len(NEIGHBOUR_STEPS), axis=0)
    out = ~np.pad(m.reached, 1)[tuple((nodes + directions + 1).T)]
    return nodes[out], directions[out]


def map_area(m: Map, ends: RodState, directions: Columns) -> float:
    """Area of a map [m^2]: its extent along the second axis, summed over the first.

    The error is of about second order in the step, that of counting nodes of first order.  It is
    1.5 % with 17 nodes and 0.1 % with 35 for the lowest equilibrium at the inputs of Table 7.
    """
    second = ends.vector[:, columns(ends.assembly, m.name)[m.axes[1]]]
    return float(np.mean(np.diff(m.first)) * (second @ directions[:, 1]))


def locus_lines(m: Map, points: RodState, text: str) -> tuple[ChartLine, ...]:
    """Chart line of points on lines of a grid, joined in pairs across its cells, or no line."""
    axis_columns = columns(points.assembly, m.name)[list(m.axes)]
    place = np.stack(
        [
            np.interp(points.vector[:, i], values, np.arange(values.size))
            for i, values in zip(axis_columns, (m.first, m.second), strict=True)
        ],
        axis=1,
    )
    on = np.abs(place - place.round()) < LINE_TOLERANCE
    low = np.where(on, place.round() - 1.0, np.floor(place)).astype(int)
    cells: dict[tuple[int, ...], list[int]] = {}
    for i in np.flatnonzero(on.sum(axis=1) == 1):
        for cell in (low[i], low[i] + on[i]):
            cells.setdefault(tuple(cell.tolist()), []).append(int(i))
    pairs = np.array([pair for pair in cells.values() if len(pair) == 2], int).reshape(-1, 2)
    xy = np.pad(
        points.vector[:, axis_columns][pairs], ((0, 0), (0, 1), (0, 0)), constant_values=np.nan
    ).reshape(-1, 2)
    return (ChartLine(xy[:, 0], xy[:, 1], text),) if len(xy) else ()


def posture_lines(s: RodState) -> tuple[ChartLine, ChartLine]:
    """Chart lines of one state: rods and platform, and clamps."""
    x, y, *_ = s.shape(np.linspace(0.0, 1.0, 61))
    pins = s.pose @ [1.0, 1.0j, 0.0][: s.pose.size] + np.exp(1j * s.pose[-1]) * s.assembly.arm
    z = np.concatenate([x + 1j * y, pins[:, None], np.full((len(x), 1), np.nan)], axis=1).ravel()
    z, clamp = np.concatenate([z, pins, pins[:1]]), clamps_and_forces(s)[1]
    return line_through(z, "here"), line_through(clamp, "clamps", points=True)
