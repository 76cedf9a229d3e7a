"""A planar mechanism as numbers: bodies in a tree of joints, and the loops that close it.

The plane is the complex plane.  Everything is written down in the *reference pose*, in which every
joint has its zero value; a pose displaces each body from there by ``z -> w z + t``, |w| = 1.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import Array


class Failure(ValueError):
    """The mechanism cannot do what is asked; the subclass says in which way."""


class CannotAssemble(Failure):
    """No pose closes the loops, or none was found from this start."""


class SingularHere(Failure):
    """The loops' Jacobian loses rank: a limit position, a change point, or a free joint."""


class Mirrored(Failure):
    """A pose that closes the loops, but in another assembly mode than was asked for."""


class Overconstrained(Failure):
    """The loops hold a direction that is held already."""


@dataclass(frozen=True)
class Joint:
    """A hinge about `place`, or a slide along the unit vector `place`, in the reference pose.

    `sign` is +1 when the hinge's axis is the plane's normal, -1 when it is against it.  `load` is a
    constant moment or force that acts on it.
    """

    name: str
    hinge: bool
    place: complex
    sign: float
    zero: float
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    armature: float = 0.0
    load: float = 0.0
    range: tuple[float, float] = (-math.inf, math.inf)


@dataclass(frozen=True)
class Body:
    """A rigid body: its parent, the joints between the two in order, and its inertia."""

    name: str
    parent: int
    joints: tuple[int, ...]
    mass: float
    centre: complex
    moment: float


@dataclass(frozen=True)
class Pin:
    """A loop closed by a point of one body that stays on a point of another."""

    name: str
    one: int
    on_one: complex
    two: int
    on_two: complex


@dataclass(frozen=True)
class Coupling:
    """Joint `one` is a polynomial of joint `two` (none: a constant), both from their zero."""

    name: str
    one: int
    two: int
    polynomial: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Bodies, joints and loops; body 0 is the ground.

    Attributes
    ----------
    gravity : complex
        In the plane [m/s2].
    start, start_rate : ndarray (joints,)
        Joint values [rad or m] and rates of the start pose.
    """

    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    pins: tuple[Pin, ...]
    couplings: tuple[Coupling, ...]
    gravity: complex
    start: Array
    start_rate: Array

    @cached_property
    def moved_by(self) -> NDArray[np.bool_]:
        """Which joints move which body (bodies, joints)."""
        moved = np.zeros((len(self.bodies), len(self.joints)), bool)
        for b, body in enumerate(self.bodies[1:], 1):
            moved[b] = moved[body.parent]
            moved[b, list(body.joints)] = True
        return moved

    @cached_property
    def hinges(self) -> NDArray[np.bool_]:
        """Which joints are hinges (joints,)."""
        return np.array([j.hinge for j in self.joints], bool)

    @cached_property
    def signs(self) -> Array:
        """Sense of each hinge about the plane's normal (joints,)."""
        return np.array([j.sign for j in self.joints])

    @cached_property
    def zeros(self) -> Array:
        """Joint values of the reference pose (joints,)."""
        return np.array([j.zero for j in self.joints])

    @cached_property
    def size(self) -> float:
        """A length of the mechanism [m]: the longest way round a loop, or to a centre."""
        ways = [self.reach(p.one, p.on_one)[0] + self.reach(p.two, p.on_two)[0] for p in self.pins]
        ways += [self.reach(b, body.centre)[0] for b, body in enumerate(self.bodies)]
        return max(ways, default=0.0) or 1.0

    @cached_property
    def scale(self) -> Array:
        """Units in which joint values are of the same order (joints,): 1 rad, or the size [m]."""
        return np.where(self.hinges, 1.0, self.size)

    @property
    def loop_names(self) -> list[str]:
        """Names of the pins, then of the couplings."""
        return [p.name for p in self.pins] + [c.name for c in self.couplings]

    @property
    def rows(self) -> int:
        """Number of loop equations."""
        return 2 * len(self.pins) + len(self.couplings)

    def chain(self, body: int) -> list[int]:
        """Joints from the ground to a body, in order."""
        order: list[int] = []
        while body:
            order = [*self.bodies[body].joints, *order]
            body = self.bodies[body].parent
        return order

    def reach(self, body: int, point: complex, q: Array | None = None) -> Array:
        """Longest distance from each joint of a body's chain to a point on it [m] (chain + 1,).

        The sum of the lengths between, with slides as far out as in q (the start); the last is 0.
        """
        chain, q = self.chain(body), self.start if q is None else q
        hinges = [j for j in chain if self.joints[j].hinge]
        places = np.array([*(self.joints[j].place for j in hinges), point])
        legs = dict(zip(hinges, np.abs(np.diff(places)), strict=True))
        for j in chain:
            if not self.joints[j].hinge:
                legs[j] = abs(q[j] - self.joints[j].zero)
        return np.append(np.cumsum([legs[j] for j in chain][::-1])[::-1], 0.0)
