"""Slope of the energy with respect to the links' coordinates, with forces in what is held.

Chains of many links are nudged in each of their free motions, all at once: the slope is written
out, which spares a differentiation for every coordinate.
"""

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.pymunk.links import Joint, Links
from proofmass.sim.pymunk.pose import QUARTER, apart, joint_value, turned


def slope(links: Links, pose: Array, pull: Array, stops: tuple[Joint, ...]) -> Array:
    """Derivatives of ``V - pull . held`` by the coordinates of poses (..., links + 1, 3).

    Each hold has a force u between its anchors and a moment t between its links:

        d/dp_b = u                              d/dp_a = -u
        d/da_b = t + u . R'(a_b) on_b           d/da_a = -t - u . R'(a_a) on_a + u' . apart

    with u' where u turns with the first link, along a slide and across it.

    Parameters
    ----------
    links : Links
    pose : ndarray (..., links + 1, 3)
    pull : ndarray (rows,)
        Forces in the holds, the drives and the joints on their stops, in this order.
    stops : tuple of Joint
        These joints.
    """
    table = links.table
    force, moment = _between(links, pose, pull, stops)
    arms = [turned(pose[..., link, 2], on) @ QUARTER
            for link, on in ((table.a, table.on_a), (table.b, table.on_b))]
    on_a, on_b = (moment + (force * arm).sum(-1) for arm in arms)
    with_a = (force @ QUARTER * apart(table, pose)).sum(-1) * table.slides
    units = np.eye(pose.shape[-2])
    found = np.zeros_like(pose)
    found[..., :2] = (units[table.b] - units[table.a]).T @ force
    found[..., 2] = on_b @ units[table.b] - (on_a - with_a) @ units[table.a]
    found[..., :-1, :2] -= links.mass[:, None] * links.gravity
    for load in links.pulls:
        arm = turned(pose[..., load.link, 2], load.at) @ QUARTER
        found[..., load.link, :2] -= load.force
        found[..., load.link, 2] -= arm @ load.force + load.moment
    return found


def _between(links: Links, pose: Array, pull: Array, stops: tuple[Joint, ...]
             ) -> tuple[Array, Array]:
    """Force (..., holds, 2) and moment (..., holds) of each hold, on its second link."""
    table, slides, rows = links.table, links.table.slides, 2 * len(links.holds)
    efforts = np.zeros((*pose.shape[:-2], len(links.holds)))
    pushes = list(zip([*links.drives, *stops], pull[rows:].tolist(), strict=True))
    for k, joint in enumerate(links.joints):
        push = sum(push for pushed, push in pushes if pushed is joint)
        efforts[..., k] = -joint.spring_force(joint_value(joint, pose)) - joint.load - push
    held = -pull[:rows].reshape(-1, 2)
    signs = np.append([joint.sign for joint in links.joints], np.zeros(len(links.loops)))
    axis = turned(pose[..., table.a, 2], table.axis)
    sliding = held[:, :1] * (axis @ QUARTER) + efforts[..., None] * axis
    return (np.where(slides[:, None], sliding, held),
            np.where(slides, held[:, 1], signs * efforts))
