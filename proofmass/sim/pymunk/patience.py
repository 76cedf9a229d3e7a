"""How many iterations Chipmunk's solver needs in a step, from how fast it converges."""

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.pose import bound, jacobian

CLEAR = 1e-9
"""How far below one the share must be of what a constraint holds."""


def contraction(links: Links, pose: Array) -> float:
    """Share of an error that one iteration of the solver leaves, where it converges slowest.

    In an iteration each constraint in turn takes its own part out of the velocity error: with the
    coordinates scaled by the roots of the masses, an orthogonal projection.  The share is the
    spectral radius of their product,

        (I - B_n^+ B_n) ... (I - B_1^+ B_1),

    without the ones of the free coordinates, which no constraint holds.
    """
    root = np.sqrt(np.column_stack([links.mass, links.mass, links.moment]).ravel())
    rows = jacobian(lambda p: bound(links, p), pose) / root
    product = np.eye(len(root))
    for block in np.split(rows, _starts(links)):
        product = product - np.linalg.pinv(block) @ (block @ product)
    sizes = np.abs(np.linalg.eigvals(product))
    return float(sizes[sizes < 1 - CLEAR].max(initial=0.0))


def _starts(links: Links) -> list[int]:
    """First rows of the constraints but the first: a pin has two rows, a slide two of one."""
    starts: list[int] = []
    for k, hold in enumerate(links.holds):
        starts += [2 * k] if hold.axis is None else [2 * k, 2 * k + 1]
    count = 2 * len(links.holds)
    return [*starts[1:], *range(count, count + len(links.drives))]


def enough(links: Links, poses: Array, left: float) -> int:
    """Iterations that leave no more than a share of an error in any of the poses.

    Parameters
    ----------
    links : Links
    poses : ndarray (poses, links + 1, 3)
    left : float
        The share.
    """
    share = max(contraction(links, pose) for pose in poses)
    return int(np.ceil(np.log(left) / np.log(share))) if share > 0 else 1
