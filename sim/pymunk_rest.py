"""How free coordinates come to rest: how long to step, and where to begin if steps do not do."""

import numpy as np

from sim.protocol import Array
from sim.pymunk_links import HAIR, Links
from sim.pymunk_modes import Modes, find_modes, sizes
from sim.pymunk_pose import along, bound, least, values
from sim.pymunk_stops import way_back

SOFT = 1e-8
"""Least stiffness that a mode is taken to have, as a share of what makes the usual step."""
SLIP = 0.1
"""How far a joint may pass a stop, as a share of its way there: to be pressed on it thereafter."""
MOVE = 0.1
"""Largest move in a step, in extents or radians: stiffnesses are those of the pose it begins in."""
TRIES = 200
"""Newton steps to a rest at most."""


def stride(links: Links, pose: Array, usual: float) -> float:
    """Time step [s] from rest that brings a pose nearest to its equilibrium.

    A step moves each mode of unit mass by dt^2 times its force; what it lacks is that force over
    w^2, so that a share 1 - dt^2 w^2 is left.  A step of 1/w takes a mode out: that one of which
    it leaves least of all modes.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3)
    usual : float
        The step [s] for a pose without free coordinates.
    """
    modes = find_modes(links, pose)
    if not modes.squares.size:
        return usual
    squares = _stiff(modes, usual)
    left = np.abs((1 - squares / squares[:, None]) * modes.forces / squares).max(axis=1)
    downhill = np.tensordot(modes.forces, modes.shapes, 1)
    return float(1 / np.sqrt(max(squares[left.argmin()], _excess(links, pose, downhill))))


def rest(links: Links, pose: Array, drives: Array, usual: float) -> Array:
    """The pose in which Newton's method finds the energy lowest, with the drives at their values.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3)
    drives : ndarray (drives,)
        Values [rad or m].
    usual : float
        The step [s] for a pose without free coordinates.
    """
    for _ in range(TRIES):
        modes = find_modes(links, pose)
        amiss = bound(links, pose)
        amiss[amiss.size - drives.size:] -= drives
        back = np.array([way_back(joint, pose) for joint in modes.stops])
        amiss = np.append(amiss, np.copysign(HAIR, back) - back)  # on the limit: a hair beyond
        closing = least(links, modes.rows, -amiss)
        fall = np.tensordot(modes.forces / _stiff(modes, usual), modes.shapes, 1)
        move = (np.append(closing, np.zeros(3)).reshape(pose.shape)
                + fall / max(1.0, _excess(links, pose, fall)))
        pose = pose + move
        if sizes(links, move) < HAIR:
            break
    return pose


def _stiff(modes: Modes, usual: float) -> Array:
    """The modes' squares, with the sign that makes a step go downhill."""
    return np.maximum(np.abs(modes.squares), SOFT / usual**2)


def _excess(links: Links, pose: Array, move: Array) -> float:
    """How many times too long a move is: it is to be small and to end at the first stop."""
    joints = tuple(j for j in links.joints if j.limits and not way_back(j, pose))
    value, rate = values(joints, pose), along(lambda p: values(joints, p), pose, move)
    low, high = np.array([joint.limits for joint in joints]).reshape(-1, 2).T
    room = np.where(rate < 0, value - low, high - value)
    beyond = np.abs(rate) / ((1 + SLIP) * room + HAIR)
    return float(max(beyond.max(initial=0.0), sizes(links, move) / MOVE))
