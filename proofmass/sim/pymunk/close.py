"""Closing the loops of a pose, and saying by how much they miss where that cannot be done."""

import numpy as np
from scipy.optimize import least_squares

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import BadModel
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.pose import bound, gaps, jacobian, least, residual, values

MOVE = 0.05
"""Largest move of a drive [rad, or extents] between two poses, so that a branch is kept."""
CLOSED = 1e-9
"""Gap [extents] and miss of a drive [extents or radians] of a pose that is closed."""


def stages(links: Links, now: Array, then: Array) -> Array:
    """Values of the drives (stages, drives) on the way to new ones, in moves of at most MOVE."""
    scale = [1.0 if joint.hold.axis is None else links.extent for joint in links.drives]
    count = int(np.max(abs(then - now) / scale, initial=0.0) / MOVE) + 1
    return np.linspace(now, then, count + 1)[1:]


def close(links: Links, pose: Array, drives: Array, rest: Array | float = 0.0) -> Array:
    """Move a pose by Newton until all holds are closed and the drives have their values.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3)
    drives : ndarray (drives,)
        Values [rad or m] of the driven joints; approached in moves of at most `MOVE`.
    rest : ndarray (rows + drives,), optional
        What is to remain of each hold and drive.

    Returns
    -------
    ndarray (links + 1, 3)

    Raises
    ------
    BadModel
        The loops cannot be closed here.
    """
    for stage in stages(links, values(links.drives, pose), drives):
        pose = _newton(links, pose, stage, rest)
    return pose


def _newton(links: Links, pose: Array, drives: Array, rest: Array | float) -> Array:
    best, off = pose, np.inf
    for _ in range(40):
        error = missing(links, pose, drives) - rest
        size = np.abs(error / links.bounds).max(initial=0.0)
        if not size < off:
            break
        best, off = pose, size
        step = least(links, jacobian(lambda p: bound(links, p), pose), error)
        pose = pose - np.append(step, np.zeros(3)).reshape(pose.shape)
    if off > CLOSED:
        missed = _missed(links, best, drives)
        raise BadModel(f"the loops cannot be closed at {named(links, drives) or 'the start'}" + (
            f", open by {missed:.2g} m" if missed > CLOSED * links.extent
            else ": a singular pose before it"))
    return best


def named(links: Links, drives: Array) -> str:
    """Values of the drives with their names."""
    return ", ".join(f"{j.name} = {v:.6g}" for j, v in zip(links.drives, drives, strict=True))


def missing(links: Links, pose: Array, drives: Array) -> Array:
    """How far all that is prescribed is from held (..., rows + drives), of some poses."""
    error = bound(links, pose)
    error[..., error.shape[-1] - len(drives):] -= drives
    return error


def _missed(links: Links, pose: Array, drives: Array) -> float:
    """The gap [m] of the loops at their closest, with joints and drives held."""
    if not np.isfinite(pose).all():
        return np.inf
    tree = residual(links, pose).size - 2 * len(links.loops)
    weight = 1e4 / links.bounds
    weight[tree: tree + 2 * len(links.loops)] /= 1e4
    ground = pose[-1:]

    def moved(flat: Array) -> Array:
        return np.vstack([(links.sizes * flat).reshape(-1, 3), ground])

    fit = least_squares(lambda flat: weight * missing(links, moved(flat), drives),
                        pose[:-1].ravel() / links.sizes, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    return float(gaps(links, moved(fit.x)).max())
