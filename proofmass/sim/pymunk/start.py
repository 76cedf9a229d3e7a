"""State of a duration's start: consistent rates and accelerations, and one step back in time."""

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.pymunk.close import close
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.modes import sizes
from proofmass.sim.pymunk.pose import (
    alike,
    along,
    bound,
    jacobian,
    least,
    potential,
    residual,
    values,
)


def start_motion(links: Links, pose: Array, rate: Array, acceleration: Array
                 ) -> tuple[Array, Array]:
    """Velocity and acceleration (links + 1, 3) of a closed pose under loads, springs and drives.

    Joints without drive start with the keyframe's rates as far as the loops allow.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3)
    rate, acceleration : ndarray (drives,)
        Of the drives [rad/s or m/s], [rad/s2 or m/s2].
    """
    def held(p: Array) -> Array:
        return bound(links, p)

    rows, rates = jacobian(held, pose), jacobian(lambda p: values(links.joints, p), pose)
    closed = np.zeros(len(rows) - len(rate))
    tree = np.vstack([jacobian(lambda p: residual(links, p), pose), rates])
    wanted = np.append(closed, [joint.rate for joint in links.joints])
    velocity = least(links, tree, wanted)
    lacking = np.append(closed, rate) - rows @ velocity
    velocity = velocity + _held(links, rows, np.zeros(len(velocity)), lacking)
    full = _padded(velocity)
    h = 1e-5 / (1e-5 + sizes(links, full))
    turning = (jacobian(held, pose + h * full) - jacobian(held, pose - h * full)) / (2 * h)
    damping = np.array([joint.damping for joint in links.joints])
    force = -jacobian(lambda p: potential(links, p), pose)
    force = force - rates.T @ (damping * (rates @ velocity))
    needed = np.append(closed, acceleration) - turning @ velocity
    return full, _padded(_held(links, rows, force, needed))


def _held(links: Links, rows: Array, force: Array, needed: Array) -> Array:
    """Solve ``M a + J^T f = force`` with ``J a = needed``, redundant rows allowed."""
    rows, needed = alike(links, rows, needed)
    inertia = np.column_stack([links.mass, links.mass, links.moment]).ravel() * links.sizes**2
    most = inertia.max()
    matrix = np.block([[np.diag(inertia / most), rows.T], [rows, np.zeros((len(rows), len(rows)))]])
    right = np.append(force * links.sizes / most, needed)
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=1e-14)[0][: len(force)] * links.sizes)


def _padded(links_only: Array) -> Array:
    return np.append(links_only, np.zeros(3)).reshape(-1, 3)


def step_back(links: Links, pose: Array, motion: tuple[Array, Array], dt: float,
              drives: Array) -> tuple[Array, Array]:
    """The state one step before the start, as if the engine had been running all along.

    Chipmunk meets holds and drives to first order, ``C(x) + dt J(x) v = 0``, so that a moving one
    stays open by the rest, a constant times dt^2.  A start without this gap would jump by it.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3)
        Closed pose of the start.
    motion : (velocity, acceleration)
    dt : float
        Time step [s].
    drives : ndarray (2, drives)
        Values of the drives at -dt and at 0.

    Returns
    -------
    pose, velocity : ndarray (links + 1, 3)
        At -dt and over [-dt, 0].
    """
    velocity, acceleration = motion
    poses = []
    for time, value in zip((-dt, 0.0), drives, strict=True):
        near = pose + time * velocity + 0.5 * time**2 * acceleration
        before = pose + (time - dt) * velocity + 0.5 * (time - dt) ** 2 * acceleration
        move = dt * (velocity + (time - 0.5 * dt) * acceleration)
        rest = (bound(links, before + move) - bound(links, before)
                - along(lambda p: bound(links, p), before, move))
        poses.append(close(links, near, value, rest))
    return poses[0], (poses[1] - poses[0]) / dt
