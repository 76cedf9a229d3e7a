"""Rates, accelerations and holding moments of a mechanism in balls, at a proven pose."""

from collections.abc import Sequence

from flint import acb, acb_series, arb, arb_mat, ctx

from tests.independent.balls.loops import (
    IMAGINARY,
    CaseNumbers,
    Form,
    Loops,
    NotProven,
    column,
    constants,
    dot,
    jacobian,
    series,
)
from tests.independent.balls.reactions import balance_bodies, check_moments

FACTORIALS = 1, 1, 2
REST_RATE, MOVING_RATE = 1e-13, 1e-6
"""Rates [rad/s or m/s] below which a part is at rest, and above which it moves: a drive that turns
back has a rate of 1e-16 there by rounding."""


def balls_of_pose(
    form: Form,
    p: CaseNumbers,
    drives: Sequence[tuple[arb, arb, arb]],
    pose: Sequence[arb],
    gravity: arb,
    inertia: bool,
    senses: Sequence[int] = (),
) -> tuple[dict[str, arb], list[int]]:
    """All curves of a mechanism at one sample, as balls.

    Parameters
    ----------
    form : Form
    p : CaseNumbers
    drives : sequence
        Value, rate and acceleration of each drive [SI].
    pose : sequence of arb
        The unknowns [m and rad].
    gravity : arb
        Acceleration of free fall, along -y [m/s^2].
    inertia : bool
        Whether moments include those of accelerations.
    senses : sequence of int
        Senses in which the parts with dry friction moved before: -1, +1, or 0 before they move.

    Returns
    -------
    curves : dict of arb
        By the name of the curve [SI].
    senses : list of int
        The senses after this sample.
    """
    ctx.cap = 3
    slopes = jacobian(form, p, constants(one[0] for one in drives), pose)
    moved = move_loops(form, p, drives, pose, slopes)
    senses = senses_of(moved, senses)
    found = {
        name: getattr(one[order], part) * FACTORIALS[order]
        for name, (one, order, part) in moved.channels.items()
    }
    for name, number in moved.moments.items():
        unit = [acb_series([acb(one[0]), acb(int(i == number))]) for i, one in enumerate(drives)]
        virtual = form(p, unit, series(pose, first_order(form, p, unit, pose, slopes)), True)
        found[name] = virtual_power(moved, virtual, gravity, inertia)
        for sense, one in zip(senses, virtual.frictions, strict=True):
            found[name] += sense * one.largest * one.along[1].real
    if moved.reactions:
        forces = balance_bodies(moved, gravity, inertia, senses)
        check_moments(forces, found)
        found = forces | found
    return found, senses


def senses_of(moved: Loops, before: Sequence[int]) -> list[int]:
    """The sense in which each part with dry friction moves; at rest the one before.

    Raises
    ------
    NotProven
        A rate is too small to be a motion, and too large to be none.
    """
    found = []
    for k, one in enumerate(moved.frictions):
        rate = one.along[1].real
        if abs(rate) < REST_RATE:
            found.append(before[k] if before else 0)
        elif abs(rate) > MOVING_RATE:
            found.append(1 if rate > 0 else -1)
        else:
            raise NotProven(f"a rate of {rate} with dry friction")
    return found


def first_order(
    form: Form,
    p: CaseNumbers,
    drives: Sequence[acb_series],
    pose: Sequence[arb],
    slopes: arb_mat,
    known: Sequence[arb] | None = None,
) -> list[arb]:
    """The next term of the unknowns as series: the first, or the second if the first is known."""
    order = 1 if known is None else 2
    given = [pose] if known is None else [pose, known]
    still = [arb(0)] * len(pose)
    rest = form(p, drives, series(*given, still), False).terms(order)
    return [-one for (one,) in slopes.solve(column(rest)).tolist()]


def move_loops(
    form: Form,
    p: CaseNumbers,
    drives: Sequence[tuple[arb, arb, arb]],
    pose: Sequence[arb],
    slopes: arb_mat,
) -> Loops:
    """The mechanism as a series in time up to the second order."""
    given = [acb_series([acb(a), acb(b), acb(c) / 2]) for a, b, c in drives]
    first = first_order(form, p, given, pose, slopes)
    second = first_order(form, p, given, pose, slopes, first)
    return form(p, given, series(pose, first, second), True)


def virtual_power(moved: Loops, virtual: Loops, gravity: arb, inertia: bool) -> arb:
    """The moment of a drive, from the power at its unit rate: weight and inertia less loads."""
    power = arb(0)
    for load in virtual.loads:
        power -= dot(load.value, load.along[1])
    for body, at in zip(moved.masses, virtual.masses, strict=True):
        pull = IMAGINARY * gravity
        if inertia:
            pull += 2 * body.centre[2]
            power += body.inertia * 2 * body.angle[2].real * at.angle[1].real
        power += body.mass * dot(pull, at.centre[1])
    return power
