"""How fast free coordinates may sink to rest: time step and damping from their frequencies."""

import numpy as np

from sim.protocol import Array
from sim.pymunk_close import close
from sim.pymunk_links import Links
from sim.pymunk_pose import bound, jacobian, potential, values

SIGNS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
NUDGE = 1e-3
"""Displacement for second differences of the energy, in extents or radians."""


def free_directions(links: Links, pose: Array) -> Array:
    """Directions in which a pose can move with the drives held, as columns of unit modal mass."""
    root = np.sqrt(np.column_stack([links.mass, links.mass, links.moment]).ravel())
    _, sizes, modes = np.linalg.svd(jacobian(lambda p: bound(links, p), pose) / root)
    rank = int((sizes > 1e-9 * sizes.max(initial=0.0)).sum())
    return modes[rank:].T / root[:, None]


def pace(links: Links, pose: Array) -> tuple[float, float]:
    """Time step [s] and share of velocity kept in a step that bring a pose to rest soon.

    The step is a third of what the fastest free coordinate allows, the damping critical for the
    slowest; both from second differences of the energy along the closed poses.
    """
    free = free_directions(links, pose)
    drives = values(links.drives, pose)
    count = free.shape[1]

    def energy(part: Array) -> float:
        move = np.append(free @ part, np.zeros(3)).reshape(pose.shape)
        return float(potential(links, close(links, pose + move, drives)))

    sizes = NUDGE / np.abs(free / np.tile([links.extent, links.extent, 1.0], len(pose) - 1)
                           [:, None]).max(axis=0)
    units = np.diag(sizes)
    hessian = np.zeros((count, count))
    for i in range(count):
        for j in range(i + 1):
            corner = [energy(s * units[i] + t * units[j]) for s, t in SIGNS]
            second = (corner[0] - corner[1] - corner[2] + corner[3]) / 4
            hessian[i, j] = hessian[j, i] = second / (sizes[i] * sizes[j])
    omega = np.sqrt(np.abs(np.linalg.eigvalsh(hessian)))
    fast = max(omega.max(), 1e-6)
    slow = max(omega.min(), 0.05 * fast)
    dt = 0.6 / fast
    return dt, float(np.exp(-2.0 * slow * dt))
