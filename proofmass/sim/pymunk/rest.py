"""The next pose on the way to rest, from what a step of Chipmunk gives to a pose that stands still.

The engine alone says where the rest is: its velocity is zero there and nowhere else.  The energy of
`proofmass.sim.pymunk.modes` says how far to go: by how much the velocity of each free motion would
fall.
"""

from itertools import compress

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import Array
from proofmass.sim.pymunk.links import HAIR, Joint, Links
from proofmass.sim.pymunk.modes import find_modes, sizes
from proofmass.sim.pymunk.pose import along, values
from proofmass.sim.pymunk.stops import way_back

SOFT = 1e-8
"""Least stiffness that a mode is taken to have, as a share of what makes the usual step."""
SLIP = 0.1
"""How far a joint may pass a stop, as a share of its way there: to be pressed on it thereafter."""
PAST = 10 * HAIR
"""The least that it may: to be put back to the limit, where a joint within a hair would stay."""
MOVE = 0.1
"""Largest move of a mode, in extents or radians: its stiffness is that of the pose it begins in."""
CLOSE = 0.3
"""Largest move of all that is held, in extents or radians: light links turn far to close a gap."""
LEAVES = 1e-5
"""Share of the fastest velocity with which a joint leaves its stop: less may be the solver's."""


def toward_rest(links: Links, pose: Array, velocity: Array, dt: float) -> Array:
    """The move (links + 1, 3) that the engine's velocity asks for.

    From standstill a step gives each free motion of unit mass a velocity of dt times its force; a
    move of that velocity over dt w^2 takes the force away.  All other velocity closes the holds,
    brings the drives to their values or leaves a stop, in one step of dt.

    Parameters
    ----------
    links : Links
    pose : ndarray (links + 1, 3)
    velocity : ndarray (links + 1, 3)
        What a step of the engine gives to the pose.
    dt : float
        That step [s].
    """
    beyond = tuple(joint for joint in links.joints if way_back(joint, pose))
    kept = ~_leaving(links, beyond, pose, velocity, dt,
                     LEAVES * float(sizes(links, velocity)))
    while True:
        move = _move(links, tuple(compress(beyond, kept)), pose, velocity, dt)
        pressed = kept | ~_leaving(links, beyond, pose, move / dt, dt)
        if (pressed == kept).all():
            return move
        kept = pressed  # what the engine lets go in its step falls back in a longer one


def _move(links: Links, stops: tuple[Joint, ...], pose: Array, velocity: Array, dt: float
          ) -> Array:
    """The move if those joints stay on their stops."""
    modes = find_modes(links, pose, stops)
    parts = np.tensordot(modes.shapes, links.weights * velocity, 2)
    stiff = np.maximum(np.abs(modes.squares), SOFT / dt**2)  # positive: it goes downhill
    closing = dt * (velocity - np.tensordot(parts, modes.shapes, 1))
    closing /= max(1.0, float(sizes(links, closing)) / CLOSE)
    ways = (parts / dt - modes.rise(links, pose, closing)) / stiff
    most = MOVE / sizes(links, modes.shapes)  # of each: soft ones wait, stiff ones do not
    fall = np.tensordot(np.clip(ways, -most, most), modes.shapes, 1)
    return closing + fall / max(1.0, _excess(links, pose, fall))


def _leaving(links: Links, beyond: tuple[Joint, ...], pose: Array, velocity: Array, dt: float,
             least: float = 0.0) -> NDArray[np.bool_]:
    """Which joints beyond their stops move back faster than `sim.pymunk.stops.ease` asks."""
    back = np.array([way_back(joint, pose) for joint in beyond])
    rates = along(lambda p: values(beyond, p), pose, velocity)
    due = np.maximum(np.abs(back) - HAIR, 0.0) / dt
    return np.sign(back) * rates - due > least


def _excess(links: Links, pose: Array, move: Array) -> float:
    """How many times too long a move is: it is to end at the first stop."""
    joints = tuple(j for j in links.joints if j.limits and not way_back(j, pose))
    value, rate = values(joints, pose), along(lambda p: values(joints, p), pose, move)
    low, high = np.array([joint.limits for joint in joints]).reshape(-1, 2).T
    room = np.where(rate < 0, value - low, high - value)
    beyond = np.abs(rate) / ((1 + SLIP) * room + PAST)
    return float(beyond.max(initial=0.0))
