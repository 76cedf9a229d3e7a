"""Stops of joints at rest: a joint pressed on its stop is held there, and free to leave it.

Chipmunk's stops act only on a joint that is beyond them, and with an error bias of 0 put it back in
one step; to the last digit, where they let go, and it falls in anew.  So a joint meets its stop a
`HAIR` before the limit and is left on the limit, by a bias that may take it no further back.
"""

import numpy as np
import pymunk

from proofmass.analytic.numerics import Array
from proofmass.sim.pymunk.links import HAIR, Joint, Links
from proofmass.sim.pymunk.pose import joint_value
from proofmass.sim.pymunk.space import STOPS

Stops = list[tuple[Joint, pymunk.Constraint]]
STAY = 1e-30
"""Way back in a step [rad or m] of a joint that rests on its stop: with none the stop lets go."""


def way_back(joint: Joint, pose: Array) -> float:
    """Way [rad or m] of a joint from beyond a stop back to it; zero between the stops."""
    value = float(joint_value(joint, pose))
    return float(np.clip(value, *joint.limits)) - value if joint.limits else 0.0


def beyond(stops: Stops, pose: Array) -> list[Joint]:
    """The joints that are beyond a stop, and so held by it in the next step."""
    return [joint for joint, _ in stops if way_back(joint, pose)]


def find_stops(links: Links, space: pymunk.Space) -> Stops:
    """The joints with limits and their stops in a space, made to put a joint back in one step."""
    stops = [constraint for constraint in space.constraints if isinstance(constraint, STOPS)]
    for stop in stops:
        stop.error_bias = 0.0
    return list(zip([joint for joint in links.joints if joint.limits], stops, strict=True))


def ease(stops: Stops, pose: Array, dt: float) -> None:
    """Let the next step put no joint back further than to a hair beyond its stop."""
    for joint, stop in stops:
        stop.max_bias = max(abs(way_back(joint, pose)) - HAIR, STAY) / dt
