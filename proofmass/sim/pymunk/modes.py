"""Free motions of a pose with its drives held, on the stops that its joints are pressed on."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.pymunk.links import Joint, Links
from proofmass.sim.pymunk.pose import bound, jacobian, potential, values
from proofmass.sim.pymunk.slope import slope

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
    pull : ndarray (held,)
        What it takes to hold what is held: holds, drives, then the joints on their stops.
    stops : tuple of Joint
        These joints.
    """

    shapes: Array
    squares: Array
    pull: Array
    stops: tuple[Joint, ...]

    def rise(self, links: Links, pose: Array, move: Array) -> Array:
        """By how much a move from the pose makes the energy's slope along each mode larger."""
        there, here = (slope(links, p, self.pull, self.stops) for p in (pose + move, pose))
        return np.tensordot(self.shapes, there - here, 2)


def free_directions(links: Links, rows: Array) -> Array:
    """Moves (n, links + 1, 3) of unit mass that leave what is held as it is, by its Jacobian."""
    root = _root(links)
    long = np.linalg.norm(rows / root, axis=1, keepdims=True)
    _, sizes, modes = np.linalg.svd(rows / root / np.where(long == 0, 1.0, long))
    rank = int((sizes > 1e-9 * sizes.max(initial=0.0)).sum())
    moves = (modes[rank:] / root).reshape(-1, len(links.mass), 3)
    return np.pad(moves, ((0, 0), (0, 1), (0, 0)))


def find_modes(links: Links, pose: Array, stops: tuple[Joint, ...]) -> Modes:
    """The modes of a pose (links + 1, 3) whose joints `stops` stay on their stops.

    The curvature is that of ``V - pull . held``, so that it counts how the paths bend on which
    what is held stays as it is.
    """
    rows = jacobian(partial(_held, links, stops), pose)
    load, root = jacobian(partial(potential, links), pose), _root(links)
    pull = np.asarray(np.linalg.lstsq((rows / root).T, load / root, rcond=1e-12)[0], float)
    moves = free_directions(links, rows)
    size = sizes(links, moves)
    nudge = moves * (NUDGE / size)[:, None, None]
    rise = slope(links, pose + nudge, pull, stops) - slope(links, pose - nudge, pull, stops)
    bend = np.tensordot(rise, moves, ((1, 2), (1, 2))) * size[:, None]
    squares, modes = np.linalg.eigh((bend + bend.T) / (4 * NUDGE))
    return Modes(np.tensordot(modes.T, moves, 1), squares, pull, stops)


def sizes(links: Links, moves: Array) -> Array:
    """Largest part of each of some moves (..., links + 1, 3), in extents or radians."""
    return np.asarray(np.abs(moves / links.sizes[:3]).max(axis=(-2, -1)))


def _held(links: Links, stops: tuple[Joint, ...], pose: Array) -> Array:
    return np.concatenate([bound(links, pose), values(stops, pose)], axis=-1)


def _root(links: Links) -> Array:
    """Roots of the masses of all coordinates."""
    return np.asarray(np.sqrt(links.weights[:-1]).ravel())
