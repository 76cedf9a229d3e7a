"""The pose that a rod starts in: an arc, closed with the least change of its bends."""

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import BadRod
from proofmass.sim.rod_chain import Chain

MOVE = 0.1  # [rad] a joint turns no further in a Newton step, so that the arc's side is kept
CLOSED = 1e-12  # of the length: rounding of the links' sum
MOST = 1000  # Newton steps; 2 pi / MOVE of them turn every joint once around


def tip(chain: Chain, bends: Array) -> tuple[Array, Array]:
    """Place and direction (x, y, angle) of a chain's tip, and their derivatives (3, links)."""
    angles = np.cumsum(bends)
    links = chain.lengths * np.stack([np.cos(angles), np.sin(angles)])
    ahead = np.cumsum(links[:, ::-1], axis=1)[:, ::-1]  # from each joint to the tip
    return (np.append(links.sum(axis=1), angles[-1]),
            np.stack([-ahead[1], ahead[0], np.ones_like(bends)]))


def start_pose(chain: Chain, target: Array | None) -> Array:
    """Joint values (links,) of a rod between its ends; zero where a link has no joint.

    Parameters
    ----------
    chain : Chain
    target : ndarray (3,), optional
        Where its tip is held, x, y [m] and angle [rad] seen from its beginning; None: free.

    Raises
    ------
    BadRod
        Shorter than its supports are apart, or no way to bend is told.
    """
    rod, bends = chain.rod, chain.arc(chain.rod.turn)
    if target is None:
        return bends
    apart = float(np.hypot(*target[:2]))
    if rod.length < apart:
        raise BadRod(rod.name, "length", f"{rod.length:g} m, but its supports are {apart:.6g} m "
                     f"apart; it must be longer")
    if not chain.springs[0]:
        bends[0] += np.arctan2(target[1], target[0]) - np.arctan2(*tip(chain, bends)[0][1::-1])
    held = slice(3 if rod.ends[1] == "clamped" else 2)
    for _ in range(MOST):
        place, slopes = tip(chain, bends)
        if np.abs(target - place)[held].max() < CLOSED * max(1.0, rod.length):
            return bends
        move = np.linalg.lstsq((slopes * chain.jointed)[held], (target - place)[held], 1e-6)[0]
        bends += move * min(1.0, MOVE / (np.abs(move).max() or 1.0))
    raise BadRod(rod.name, "turn", f"an arc that turns by {rod.turn:g} rad cannot be bent so that "
                 f"it ends at its support; give another")
