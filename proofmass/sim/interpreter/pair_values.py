"""Values of shapes that an engine combines to the friction and restitution of each pair.

An engine has a number for each of its surfaces and combines those of two that touch by a rule of
its own.  Here are numbers with which each pair gets its own law; where there are none, the run is
refused by the name of a pair.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .checks import Refused
from .mechanism import NeutralMechanism, NeutralShape

EQUAL_SHARE = 1e-6
"""Largest deviation of a pair from its law, as a share of it: rounding of single precision."""
OVERLAP_TIME = 0.1
"""Time in which an overlap of shapes goes [s], where an engine lets it choose: less adds speed to a
bounce, and what many impacts leave would add up with more."""
PairValues = dict
"""Numbers by the names of two surfaces."""
Split = Callable[[dict], dict]
"""Numbers of surfaces from those of pairs."""


@dataclass(frozen=True)
class ContactSurfaces:
    """The surfaces of an engine that has one for each moving link and each shape of the ground.

    Attributes
    ----------
    pairs : dict of (name, name) to NeutralContact
        Those that touch; the name of a surface is that of `surface_of`.
    frictions, restitutions : dict of name to float
        Numbers of each surface, which the engine combines [1].
    """

    pairs: dict
    frictions: dict
    restitutions: dict

    def touch(self, one: Any, two: Any) -> bool:
        """Whether two surfaces touch."""
        return (one, two) in self.pairs or (two, one) in self.pairs


def surface_of(shape: NeutralShape) -> Any:
    """The number of the link of a shape; of one of the ground its own name."""
    return shape.link or shape.name


def split_by_product(wanted: PairValues) -> dict:
    """Numbers of surfaces whose products are those that are wanted of pairs.

    Raises
    ------
    Refused
        There are none.

    Examples
    --------
    >>> found = split_by_product({("floor", "box"): 0.5, ("floor", "ball"): 0.0})
    >>> found["ball"], round(found["floor"] * found["box"], 12)
    (0.0, 0.5)
    """
    logs = split_by_sum({pair: np.log(value) for pair, value in wanted.items() if value})
    found = dict.fromkeys((name for pair in wanted for name in pair), 0.0)
    found |= {name: float(np.exp(one)) for name, one in logs.items()}
    check_values(wanted, {pair: found[pair[0]] * found[pair[1]] for pair in wanted})
    return found


def split_by_minimum(wanted: PairValues) -> dict:
    """Numbers of surfaces whose smaller one is that which is wanted of each pair.

    Raises
    ------
    Refused
        There are none.

    Examples
    --------
    >>> split_by_minimum({("floor", "box"): 0.5, ("floor", "ball"): 0.2})
    {'floor': 0.5, 'box': 0.5, 'ball': 0.2}
    """
    found: dict = {}
    for pair, value in wanted.items():
        for name in pair:
            found[name] = max(value, found.get(name, 0.0))
    check_values(wanted, {pair: min(found[pair[0]], found[pair[1]]) for pair in wanted})
    return found


def split_by_harmonic_mean(wanted: PairValues) -> dict:
    """Numbers of surfaces whose harmonic means are those that are wanted of pairs.

    Raises
    ------
    Refused
        There are none.

    Examples
    --------
    >>> found = split_by_harmonic_mean({("floor", "box"): 0.5, ("floor", "ball"): 0.0})
    >>> found["ball"], round(2.0 / (1.0 / found["floor"] + 1.0 / found["box"]), 12)
    (0.0, 0.5)
    """
    inverses = split_by_sum({pair: 2.0 / value for pair, value in wanted.items() if value})
    found = dict.fromkeys((name for pair in wanted for name in pair), 0.0)
    found |= {name: 1.0 / one if one > 0.0 else 0.0 for name, one in inverses.items()}
    sums = {(a, b): found[a] + found[b] for a, b in wanted}
    check_values(
        wanted,
        {(a, b): 2.0 * found[a] * found[b] / (sums[a, b] or 1.0) for a, b in wanted},
    )
    return {name: float(one) for name, one in found.items()}


def split_by_sum(wanted: PairValues) -> dict:
    """Numbers of surfaces whose sums are nearest to those that are wanted of pairs.

    Examples
    --------
    >>> found = split_by_sum({("a", "b"): 3.0, ("b", "c"): 4.0, ("a", "c"): 5.0})
    >>> [round(found[name], 12) for name in "abc"]
    [2.0, 1.0, 3.0]
    """
    if not wanted:
        return {}
    names = sorted({name for pair in wanted for name in pair}, key=str)
    rows = np.array([[float(name in pair) for name in names] for pair in wanted])
    found = np.linalg.lstsq(rows, np.array(list(wanted.values())), rcond=None)[0]
    return dict(zip(names, found.tolist()))


def check_values(wanted: PairValues, made: PairValues) -> None:
    """Raise `Refused` at a pair that does not get the number that is wanted."""
    for (one, two), value in wanted.items():
        if abs(made[one, two] - value) > EQUAL_SHARE * value:
            raise Refused(
                f"a friction or restitution of {value:g} between {one} and {two} beside those of "
                "other pairs: the engine combines numbers of each"
            )


def contact_surfaces(
    mechanism: NeutralMechanism, friction: Split, restitution: Split = split_by_product
) -> ContactSurfaces:
    """The surfaces of a mechanism, whose numbers an engine combines by its rules.

    Parameters
    ----------
    mechanism : NeutralMechanism
    friction, restitution : callable
        `split_by_product`, or another one: numbers of surfaces from those of pairs.

    Raises
    ------
    Refused
        Two shapes of two links touch and two others do not, or in another way; or there are no
        such numbers.
    """
    parts: dict = {}
    for one in mechanism.shapes:
        parts.setdefault(surface_of(one), []).append(one)
    found: dict = {}
    for pair in mechanism.contacts:
        ends = tuple(surface_of(mechanism.shapes[k]) for k in (pair.one, pair.two))
        found.setdefault(ends if ends[::-1] not in found else ends[::-1], []).append(pair)
    for (a, b), pairs in found.items():
        numbers = {(one.friction, one.restitution) for one in pairs}
        if len(pairs) != len(parts[a]) * len(parts[b]) or len(numbers) > 1:
            one, two = (mechanism.shapes[k].name for k in (pairs[0].one, pairs[0].two))
            raise Refused(f"contact of {one} and {two}, which differs from others of their links")
    laws = {ends: pairs[0] for ends, pairs in found.items()}
    return ContactSurfaces(
        laws,
        friction({ends: one.friction for ends, one in laws.items()}),
        restitution({ends: one.restitution for ends, one in laws.items()}),
    )
