"""Forces of pins, guides and drives in balls, from the balances of force and moment of each body.

It shares no equation with the closed forms, and none with the virtual power of `motion.py`: each
holding moment is found in both ways.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flint import acb, arb, arb_mat

from tests.independent.balls.loops import (
    GROUND,
    IMAGINARY,
    Loops,
    NotProven,
    Reaction,
    column,
    turn,
)


@dataclass(frozen=True)
class Unknown:
    """A force of 1 along a unit vector at a point, or a moment of 1, on one body by another."""

    name: str
    on: str
    by: str
    direction: acb
    moment: arb

    def parts(self, body: str, turns: bool) -> list[arb]:
        """Its parts in the balances of a body: along x and y, and about the origin."""
        sign = int(body == self.on) - int(body == self.by)
        parts = [self.direction.real, self.direction.imag, self.moment]
        return [part * sign for part in parts[: 3 if turns else 2]]


def cross(a: acb, b: acb) -> arb:
    """The moment of a force b at a point a about the origin."""
    return a.real * b.imag - a.imag * b.real


def add_frictions(
    needed: dict[str, list[arb]], moved: Loops, senses: Sequence[int]
) -> list[Reaction]:
    """Add the moments of friction of pins to the balances; return reactions with that of guides."""
    reactions = list(moved.reactions)
    for sense, one in zip(senses, moved.frictions, strict=True):
        against = -sense * one.largest
        if not one.reaction:
            add(needed, one.on, acb(0), -against)
            add(needed, one.by, acb(0), against)
        for k, reaction in enumerate(reactions):
            if reaction.name == one.reaction and reaction.along is not None:
                reactions[k] = replace(reaction, along=reaction.along + against)
    return reactions


def unknowns_of(reaction: Reaction) -> tuple[list[Unknown], acb]:
    """The unknowns of a reaction, and its given force along the frame."""
    point, unit = reaction.point[0], turn(reaction.frame)[0]
    found = []
    for letter, direction in (("x", unit), ("y", unit * IMAGINARY)):
        name = f"{reaction.name}_{letter}"
        unknown = Unknown(name, reaction.on, reaction.by, direction, cross(point, direction))
        if letter == "y" or reaction.along is None:
            found.append(unknown)
    if reaction.moment:
        found.append(Unknown(reaction.moment, reaction.on, reaction.by, acb(0), arb(1)))
    return found, unit * (reaction.along or 0)


def balance_bodies(
    moved: Loops, gravity: arb, inertia: bool, senses: Sequence[int]
) -> dict[str, arb]:
    """All forces and moments between bodies at one sample, as balls.

    Parameters
    ----------
    moved : Loops
        The mechanism as a series in time.
    gravity : arb
        Acceleration of free fall, along -y [m/s^2].
    inertia : bool
        Whether bodies resist accelerations.
    senses : sequence of int
        The senses of the parts with dry friction.

    Returns
    -------
    dict of arb
        By the name of the curve [SI].
    """
    turning = dict.fromkeys(moved.bodies, False)
    turning.update({one.body: True for one in moved.masses if one.turns})
    needed = {body: [arb(0)] * (3 if turns else 2) for body, turns in turning.items()}
    for one in moved.masses:
        pull = one.mass * (IMAGINARY * gravity + (2 * one.centre[2] if inertia else 0))
        spin = one.inertia * 2 * one.angle[2].real if inertia else arb(0)
        add(needed, one.body, pull, cross(one.centre[0], pull) + spin)
    for load in moved.loads:
        if load.is_moment:
            add(needed, load.body, acb(0), -load.value.real)
        else:
            add(needed, load.body, -load.value, -cross(load.along[0], load.value))
    unknowns = [Unknown(name, body, GROUND, acb(0), arb(1)) for name, body in moved.motors.items()]
    found: dict[str, arb] = {}
    for reaction in add_frictions(needed, moved, senses):
        parts, given = unknowns_of(reaction)
        unknowns += parts
        if reaction.along is not None:
            found[f"{reaction.name}_x"] = reaction.along
            moment = cross(reaction.point[0], given)
            add(needed, reaction.on, -given, -moment)
            add(needed, reaction.by, given, moment)
    rows = [
        [part for body, turns in turning.items() for part in one.parts(body, turns)]
        for one in unknowns
    ]
    right = [part for parts in needed.values() for part in parts]
    if any(len(row) != len(unknowns) for row in rows):
        raise NotProven(f"{len(right)} balances for {len(unknowns)} forces and moments")
    solved = arb_mat(rows).transpose().solve(column(right))
    return found | {one.name: solved[k, 0] for k, one in enumerate(unknowns)}


def add(needed: dict[str, list[arb]], body: str, force: acb, moment: arb) -> None:
    """Add a force and its moment about the origin to what a body needs; the ground needs none."""
    if body in needed:
        parts = [force.real, force.imag, moment]
        needed[body] = [a + b for a, b in zip(needed[body], parts, strict=False)]


def check_moments(balances: dict[str, arb], powers: dict[str, arb]) -> None:
    """Raise NotProven if the balances and the virtual power give different moments of a drive."""
    for name in balances.keys() & powers.keys():
        if not balances[name].overlaps(powers[name]):
            raise NotProven(f"{name}: {balances[name]} from balances, {powers[name]} from power")
