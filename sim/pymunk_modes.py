"""Free motions of a pose with its drives held, on the stops that its joints are pressed on."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from sim.protocol import Array
from sim.pymunk_links import Joint, Links
from sim.pymunk_pose import bound, jacobian, potential, values
from sim.pymunk_slope import slope
from sim.pymunk_stops import way_back

NUDGE = 1e-4
"""Displacement for differences of the energy's slope, in extents or radians."""


@dataclass(frozen=True)
class Modes:
    """Free motions of a pose, uncoupled to second order in the energy.

    Attributes
    ----------
    shapes : ndarray (n, links + 1, 3)
        Moves of unit mass.
    squares : ndarray (n,)
        Curvature of the energy along them: their frequencies squared [1/s2].
    forces : ndarray (n,)
        Fall of the energy along them.
    rows : ndarray (held, 3 links)
        Jacobian of all that is held: holds, drives, then the joints on their stops.
    stops : tuple of Joint
        These joints.
    """

    shapes: Array
    squares: Array
    forces: Array
    rows: Array
    stops: tuple[Joint, ...]


def free_directions(links: Links, rows: Array) -> Array:
    """Moves (n, links + 1, 3) of unit mass that leave what is held as it is, by its Jacobian."""
    root = _root(links)
    long = np.linalg.norm(rows / root, axis=1, keepdims=True)
    _, sizes, modes = np.linalg.svd(rows / root / np.where(long == 0, 1.0, long))
    rank = int((sizes > 1e-9 * sizes.max(initial=0.0)).sum())
    moves = (modes[rank:] / root).reshape(-1, len(links.mass), 3)
    return np.pad(moves, ((0, 0), (0, 1), (0, 0)))


def find_modes(links: Links, pose: Array) -> Modes:
    """The modes of a pose (links + 1, 3).

    The curvature is that of ``V - pull . held``, so that it counts how the paths bend on which
    what is held stays as it is.
    """
    rows, pull, stops = _pressed(links, pose)
    moves = free_directions(links, rows)
    size = sizes(links, moves)
    nudge = moves * (NUDGE / size)[:, None, None]
    rise = slope(links, pose + nudge, pull, stops) - slope(links, pose - nudge, pull, stops)
    bend = np.tensordot(rise, moves, ((1, 2), (1, 2))) * size[:, None]
    squares, modes = np.linalg.eigh((bend + bend.T) / (4 * NUDGE))
    shapes = np.tensordot(modes.T, moves, 1)
    forces = -np.tensordot(shapes, slope(links, pose, pull, stops), 2)
    return Modes(shapes, squares, forces, rows, stops)


def sizes(links: Links, moves: Array) -> Array:
    """Largest part of each of some moves (..., links + 1, 3), in extents or radians."""
    return np.asarray(np.abs(moves / links.sizes[:3]).max(axis=(-2, -1)))


def _pressed(links: Links, pose: Array) -> tuple[Array, Array, tuple[Joint, ...]]:
    """The Jacobian of all that is held, what it takes to hold it, and the stops pressed on."""
    root, beyond = _root(links), [joint for joint in links.joints if way_back(joint, pose)]
    load = jacobian(partial(potential, links), pose) / root
    while True:
        stops = tuple(beyond)
        rows = jacobian(partial(_held, links, stops), pose)
        pull = np.linalg.lstsq((rows / root).T, load, rcond=1e-12)[0]
        pushes = zip(stops, pull[pull.size - len(stops):], strict=True)
        beyond = [joint for joint, push in pushes if push * way_back(joint, pose) > 0]
        if len(beyond) == len(stops):
            return rows, np.asarray(pull, float), stops


def _held(links: Links, stops: tuple[Joint, ...], pose: Array) -> Array:
    return np.concatenate([bound(links, pose), values(stops, pose)], axis=-1)


def _root(links: Links) -> Array:
    """Roots of the masses of all coordinates."""
    return np.sqrt(np.column_stack([links.mass, links.mass, links.moment]).ravel())
