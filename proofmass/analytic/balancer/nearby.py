"""Equilibria of a balancer from those of another one, whose parameters differ little from its own.

Sensitivities need the paths of many balancers whose parameters differ in the sixth digit.  Newton's
method gets from the known equilibrium at an angle to that of the changed balancer in two steps, so
that no path is followed again::

    g(x, p) = 0,    x(p + dp) = x(p) - (dg/dx)^-1 (dg/dp) dp + ...

The result is used where it is certainly the one that following the path gives: all equilibria are
stable, none is far from the known one, and no stop switches elsewhere.
"""

from dataclasses import fields

import numpy as np

from proofmass.analytic.balancer.model import Balancer
from proofmass.analytic.balancer.path import (
    SWITCH_TOLERANCE,
    BalancerPaths,
    Path,
    PathEquilibria,
    along,
    as_path,
    equilibria_along,
    follow,
    switching_margins,
)
from proofmass.analytic.remember import reuse_nearby
from proofmass.base.arrays import Array

MAX_NEARBY_CORRECTION = 1e-3
"""Largest correction of a known equilibrium [rad]: parameters that differ by 1e-6 move it by some
1e-6, unless a fold is near."""
BalancerNumbers = tuple[tuple[float, ...], ...]
"""The arrays of one balancer as tuples, and the numbers of its joints with stops."""


def numbers_of(b: Balancer) -> BalancerNumbers:
    """The numbers of a batch of one, which `balancer_of` makes the balancer from."""
    arrays = (getattr(b, field.name) for field in fields(b)[:-1])
    return *(tuple(np.ravel(one).tolist()) for one in arrays), b.stopped


def balancer_of(numbers: BalancerNumbers) -> Balancer:
    """The batch of one with these numbers.

    >>> from proofmass.analytic.balancer.model import balancer
    >>> lengths, springs = {"length1": 0.5, "length2": 0.5, "length3": 0.5}, {"stiffness1": 1.0}
    >>> one = balancer(**lengths, **springs, stiffness2=0.5, stiffness3=0.25)
    >>> numbers_of(balancer_of(numbers_of(one))) == numbers_of(one)
    True
    """
    names = [field.name for field in fields(Balancer)[:-1]]
    arrays = {
        name: np.array(values if name in SINGLE_NUMBERS else [values])
        for name, values in zip(names, numbers[:-1], strict=True)
    }
    return Balancer(**arrays, stopped=tuple(map(int, numbers[-1])))


SINGLE_NUMBERS = ("pendulum", "extension1", "extension2", "weight")
"""The arrays of a balancer that have one number for each of the batch."""


@reuse_nearby
def known_paths(numbers: BalancerNumbers, to: float) -> tuple[BalancerNumbers, BalancerPaths]:
    """The paths of a balancer, or of one nearby whose paths are known, and its numbers."""
    return numbers, follow(balancer_of(numbers), to)


def path_to(chain: Balancer, to: float, alpha: Array) -> Path:
    """Find the equilibria of a batch of one at angles.

    Parameters
    ----------
    chain : Balancer
    to : float
        Last pendulum angle of the path [rad], of either sign.
    alpha : ndarray (A,)
        Pendulum angles of that sign, up to `to` [rad].

    Raises
    ------
    ValueError
        The path ends before one of the angles.
    """
    numbers = numbers_of(chain)
    known, paths = known_paths(numbers, to)
    goes_there = abs(paths.reach[0]) >= abs(to)
    if goes_there and known != numbers:
        found = equilibria_along(chain, paths, alpha)
        if is_followed(found):
            return as_path(found)
    if known != numbers or not (goes_there or paths.why[0]):
        paths = follow(chain, to)
    last = alpha[np.abs(alpha).argmax()]
    if paths.why[0] and np.abs(paths.reach[0]) <= np.abs(last):
        raise ValueError(f"{paths.why[0]}; angles up to {np.degrees(last):g} deg are asked for")
    return along(chain, paths, alpha)


def is_followed(found: PathEquilibria) -> bool:
    """Whether equilibria from the paths of a balancer nearby are those of the balancer's own."""
    margins = switching_margins(found.each, found.point)
    return bool(
        found.reached.all()
        and found.stable.all()
        and (found.moved < MAX_NEARBY_CORRECTION).all()
        and (margins >= -SWITCH_TOLERANCE).all()
    )
