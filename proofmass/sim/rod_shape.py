"""What a rod at rest shows along its arc length: place, direction and moment.

Places lie on the links.  Directions and moments are drawn through those that the links and their
springs have, in straight lines, prolonged at the ends: of second order in the length of a link.
"""

from collections.abc import Callable, Mapping

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import BadModel, Rod, Run
from proofmass.sim.rod_chain import Chain, chain

PARTS = "x", "y", "z", "angle", "moment"
Pose = tuple[Array, Array, Array]


def of_rods(run: Run) -> dict[str, tuple[Rod, str]]:
    """The channels of a run that are shapes of its rods, with the rod and the part.

    Raises
    ------
    BadModel
        A rod has no such part.
    """
    rods, found = {rod.name: rod for rod in run.rods}, {}
    for channel in run.channels:
        name, _, part = channel.partition(".")
        if name in rods:
            if part not in PARTS:
                raise BadModel(f"channel {channel!r}: a rod has {name}.x, .y, .z, .angle and "
                               f".moment, along its length")
            found[channel] = rods[name], part
    return found


def shapes(run: Run, pose: Callable[[Chain], Pose]) -> dict[str, Array]:
    """The curves of all rods of a run over its arc lengths.

    Parameters
    ----------
    run : Run
    pose : callable
        Places (links + 1, 3) of a chain's vertices [m], angles [rad] of its links, and values [rad]
        of their joints.
    """
    curves: dict[str, Array] = {}
    poses: Mapping[str, Pose] = {rod.name: pose(chain(rod)) for rod in run.rods}
    for channel, (rod, part) in of_rods(run).items():
        curves[channel] = curve(chain(rod), part, poses[rod.name], run.x)
    return curves


def curve(one: Chain, part: str, pose: Pose, s: Array) -> Array:
    """One part of a rod's shape at arc lengths s [m]."""
    places, angles, bends = pose
    if part == "angle":
        return along(one.nodes, np.unwrap(angles), s)
    if part == "moment":
        sprung = one.jointed & (one.springs > 0)
        return along(one.vertices[:-1][sprung], one.springs[sprung] * bends[sprung], s)
    return along(one.vertices, places[:, "xyz".index(part)], s)


def along(nodes: Array, values: Array, s: Array) -> Array:
    """Straight lines through values at nodes, the first and the last prolonged."""
    k = np.clip(np.searchsorted(nodes, s) - 1, 0, nodes.size - 2)
    share = (s - nodes[k]) / (nodes[k + 1] - nodes[k])
    return (1 - share) * values[k] + share * values[k + 1]
