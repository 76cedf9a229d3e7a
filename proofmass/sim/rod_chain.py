"""An elastic rod as a chain of rigid links with torsion springs in its joints.

A rod of n segments of h = L / n:

    half      |-o--o--o--o-     springs EI/h at h/2, 3h/2, ..., half links at both ends: order 2
    double    @--o--o--o--      springs EI/h at h, 2h, ..., 2 EI/h at the clamp: order 2
    naive     o--o--o--o--      EI/h at the clamp as well: a clamp too soft by half, order 1

The links' angles are the rod's tangent at `nodes`: at 0, h, 2h, ..., L of the first scheme, in the
middle of the links of the others.  A pinned end has no spring.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import BadRod, Rod

SCHEMES = "half", "double", "naive"


@dataclass(frozen=True)
class Chain:
    """The links of a rod.

    Attributes
    ----------
    lengths, springs : ndarray (links,)
        Length [m] of each link and stiffness [N m/rad] of the joint it begins with: zero where the
        rod is pinned, infinite where it is clamped without a spring.
    nodes : ndarray (links,)
        Arc length [m] where the rod has the direction of that link.
    """

    rod: Rod
    lengths: Array
    springs: Array
    nodes: Array

    @property
    def names(self) -> list[str]:
        """Of the links' bodies and joints; number 0 has no spring."""
        first = 0 if self.rod.scheme == "half" else 1
        return [f"{self.rod.name}.{k + first}" for k in range(self.lengths.size)]

    @cached_property
    def vertices(self) -> Array:
        """Arc length [m] of the links' ends (links + 1,)."""
        return np.append(0.0, np.cumsum(self.lengths))

    @property
    def jointed(self) -> NDArray[np.bool_]:
        """Which links begin with a joint."""
        return np.isfinite(self.springs)

    def arc(self, turn: float) -> Array:
        """Joint values (links,) of a circular arc over the whole length."""
        return np.diff(turn * self.nodes / self.rod.length, prepend=0.0)


def chain(rod: Rod) -> Chain:
    """Cut a rod into links.

    Raises
    ------
    BadRod
        Fewer than two segments, an unknown scheme, a length or stiffness that is not positive.
    """
    check(rod)
    n, h = rod.segments, rod.length / rod.segments
    lengths, springs = np.full(n, h), np.full(n, rod.stiffness / h)
    if rod.scheme == "half":
        lengths = np.concatenate([[h / 2], lengths[1:], [h / 2]])
        springs = np.append(np.inf, springs)
        nodes = h * np.arange(n + 1.0)
    else:
        springs[0] *= 2.0 if rod.scheme == "double" else 1.0
        nodes = h * np.arange(0.5, n)
    if rod.ends[0] == "pinned":
        springs[0] = 0.0
    return Chain(rod, lengths, springs, nodes)


def check(rod: Rod) -> None:
    """Raise `BadRod` if there is no such rod."""
    for key in ("length", "stiffness", "mass"):
        value = getattr(rod, key)
        if value is not None and not value > 0:
            raise BadRod(rod.name, key, f"{value:g} must be positive")
    if rod.segments < 2:
        raise BadRod(rod.name, "segments", f"{rod.segments}; a rod has two or more")
    if rod.scheme not in SCHEMES:
        raise BadRod(rod.name, "scheme", f"{rod.scheme!r}; known: {', '.join(SCHEMES)}")
    if rod.ends[1] == "clamped" and rod.scheme != "half":
        raise BadRod(rod.name, "scheme", f"{rod.scheme!r} knows no clamp at the far end; use half")
