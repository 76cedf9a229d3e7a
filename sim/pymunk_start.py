"""State of a duration's start: consistent rates and accelerations, and one step back in time."""

import numpy as np

from sim.protocol import Array
from sim.pymunk_close import along, close, jacobian, joint_value, potential, residual
from sim.pymunk_links import Joint, Links


def start_motion(links: Links, pose: Array, drive: tuple[Joint, float, float] | None
                 ) -> tuple[Array, Array]:
    """Velocity and acceleration (links + 1, 3) of a closed pose under loads, springs and drive.

    Joints without drive start with the keyframe's rates as far as the loops allow.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3)
    drive : (Joint, rate [rad/s], acceleration [rad/s2]) or None
    """
    def held(p: Array) -> Array:
        rows = residual(links, p)
        return rows if drive is None else np.append(rows, joint_value(drive[0], p)[..., None], -1)

    def values(p: Array) -> Array:
        return np.stack([joint_value(joint, p) for joint in links.joints], axis=-1)

    rows, rates = jacobian(held, pose), jacobian(values, pose)
    tree = jacobian(lambda p: np.append(residual(links, p), values(p), -1), pose)
    wanted = np.append(np.zeros(tree.shape[0] - len(rates)), [j.rate for j in links.joints])
    velocity = np.linalg.lstsq(tree, wanted, rcond=1e-12)[0]
    moving = np.zeros(len(rows))
    if drive is not None:
        moving[-1] = drive[1]
    mass = np.diag(np.column_stack([links.mass, links.mass, links.moment]).ravel())
    velocity = velocity + _held(mass, rows, np.zeros(len(mass)), moving - rows @ velocity)
    full = _padded(velocity)
    h = 1e-5 / (1e-5 + np.abs(velocity).max())
    turning = (jacobian(held, pose + h * full) - jacobian(held, pose - h * full)) / (2 * h)
    needed = -turning @ velocity
    if drive is not None:
        needed[-1] += drive[2]
    damping = np.array([joint.damping for joint in links.joints])
    force = -jacobian(lambda p: potential(links, p), pose)
    force = force - rates.T @ (damping * (rates @ velocity))
    return full, _padded(_held(mass, rows, force, needed))


def _held(mass: Array, rows: Array, force: Array, needed: Array) -> Array:
    """Solve ``M a + J^T f = force`` with ``J a = needed``, redundant rows allowed."""
    zero = np.zeros((len(rows), len(rows)))
    matrix = np.block([[mass, rows.T], [rows, zero]])
    return np.linalg.lstsq(matrix, np.append(force, needed), rcond=1e-14)[0][: len(mass)]


def _padded(links_only: Array) -> Array:
    return np.append(links_only, np.zeros(3)).reshape(-1, 3)


def step_back(links: Links, pose: Array, motion: tuple[Array, Array], dt: float,
              drive: tuple[Joint, float, float] | None) -> tuple[Array, Array]:
    """The state one step before the start, as if the engine had been running all along.

    Chipmunk closes the holds to first order, ``C(x) + dt J(x) v = 0``, so that a moving hold
    stays open by the rest, a constant times dt^2.  A start without this gap would jump by it.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3)
        Closed pose of the start.
    motion : (velocity, acceleration)
    dt : float
        Time step [s].
    drive : (Joint, value at -dt, value at 0) or None

    Returns
    -------
    pose, velocity : ndarray (links + 1, 3)
        At -dt and over [-dt, 0].
    """
    velocity, acceleration = motion
    poses = []
    held = (drive and (drive[0], drive[1]), drive and (drive[0], drive[2]))
    for k, time in enumerate((-dt, 0.0)):
        near = pose + time * velocity + 0.5 * time**2 * acceleration
        before = pose + (time - dt) * velocity + 0.5 * (time - dt) ** 2 * acceleration
        move = dt * (velocity + (time - 0.5 * dt) * acceleration)
        rest = (residual(links, before + move) - residual(links, before)
                - along(lambda p: residual(links, p), before, move))
        poses.append(close(links, near, held[k], rest))
    return poses[0], (poses[1] - poses[0]) / dt
