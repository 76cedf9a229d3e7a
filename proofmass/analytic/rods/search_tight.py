r"""Starts of a search among rods under large loads, where the lattice's first steps are too long.

A rod whose alpha is large and whose inflections are few is straight in tension, but for loops of a
size of 1/alpha, K apart from tip to tip, the last of them cut off by the clamp.  With delta the
angle of the clamp over the load, j = 0, 1 .. whole loops, on either side (q > 0, q < 0)::

    alpha = (2 j + 1) K + y,    tanh(y) = -(-1)^j cos(delta/2),    |q| = K - ln 2 + O(e^-2K)

so a direction and a size of the load leave 2 modes of such rods.  Starts are drawn at random: a
pose that may hold such loads, by `search_boxes.tight`; loads along the straight rods, in the ratio
that balances best or in any; one of the 2 modes for each rod, or any rod at all for light loads.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import TURN, Array
from proofmass.analytic.rods.search_boxes import tight
from proofmass.analytic.rods.state import State, clamps

EDGE = 0.05  # of the boxes [L]
EACH = 80  # starts for each choice of loops
FEWEST = 2000
SEED = 1
SWAY = 0.1  # of a load from its straight rod [rad]
LIGHT = 8.0  # alpha below which half of the rods are drawn from the whole chart
LEAST_SHARE = 1e-3  # of the largest load
ENDS = 1e-12  # 1 - |tanh(y)| of a rod that lies along its load


def drawn(s: State, modes: Sequence[int], least: float, most: float) -> tuple[Array, Array]:
    """Charts (k, 2, n) and poses (3, n) with some alpha within about [least, most]."""
    a, (theta, clamp, _) = s.assembly, clamps(s)
    boxes, random = tight(s, modes, least, EDGE), np.random.default_rng(SEED)
    n = max(FEWEST, EACH * int(np.prod(2 * np.array(modes)))) if boxes.phi.size else 0
    box, part = random.integers(max(1, boxes.phi.size), size=n), random.uniform(-1.0, 1.0, (3, n))
    where = boxes.where[box] + boxes.half * (part[0] + 1j * part[1])
    phi = boxes.phi[box] + boxes.turn * part[2]
    arm = np.exp(1j * phi) * a.arm[:, None]
    along = where + arm - clamp[:, None]
    along /= np.abs(along)
    load = ratios(along, arm / a.length.mean(), random)
    unit = (a.stiffness / a.length**2)[:, None]
    size = np.sqrt(load / unit / (load / unit).max(axis=0, initial=0.0))
    alpha = size * np.exp(random.uniform(np.log(least), np.log(most), n))
    delta = theta[:, None] - np.angle(along) + random.normal(0.0, SWAY, alpha.shape)
    return charts(alpha, delta, np.array(modes)[:, None], random), np.stack(
        [where.real, where.imag, phi])


def ratios(along: Array, arm: Array, random: np.random.Generator) -> Array:
    """Loads (k, n) on straight rods: half of them balance as well as any, half are random."""
    balance = np.moveaxis(np.stack([along.real, along.imag, (arm.conj() * along).imag]), -1, 0)
    best = np.abs(np.linalg.svd(balance)[2][:, -1]).T if balance.size else np.ones(along.shape)
    any_other = random.uniform(0.0, 1.0, along.shape)
    return np.maximum(np.where(random.random(along.shape[1]) < 0.5, best, any_other), LEAST_SHARE)


def charts(alpha: Array, delta: Array, modes: NDArray[np.int_],
           random: np.random.Generator) -> Array:
    """Charts (k, 2, n) of rods with random loops; of light ones half anywhere in the chart."""
    side, loops = random.choice([-1.0, 1.0], alpha.shape), random.integers(0, modes, alpha.shape)
    cosine = -((-1.0) ** loops) * np.cos((side * delta) % TURN / 2.0)
    y = np.arctanh(np.clip(cosine, ENDS - 1.0, 1.0 - ENDS))
    q = side * np.maximum((alpha - y) / (2 * loops + 1) - np.log(2.0), 0.05)
    any_other = random.uniform(-1.0, 1.0, alpha.shape) * (alpha + 3.0)
    light = (alpha < LIGHT) & (random.random(alpha.shape) < 0.5)
    return np.stack([alpha, np.where(light, any_other, q)], axis=1)
