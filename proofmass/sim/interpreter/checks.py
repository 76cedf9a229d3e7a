"""What runs of all kinds need: a refusal, a watch, and checks of what an engine returns."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from .geometry import LinkMotion
from .mechanism import NeutralMechanism

LEAST_SINE = 1e-6
"""Least sine of the angle between two slides that leave a link free in a plane."""
LOST_SIZES = 1e3
"""Distance from the start, in sizes of the mechanism, beyond which a run is lost."""


class Refused(Exception):
    """The engine cannot express something of the mechanism; the message names it."""


class RunEnded(Exception):
    """The engine cannot make the next step; the message says why."""


class Stopwatch:
    """Processor time in a ``with`` block [s]."""

    def __enter__(self) -> Stopwatch:
        self.began, self.seconds = time.process_time(), 0.0
        return self

    def __exit__(self, *_: Any) -> None:
        self.seconds = time.process_time() - self.began


def refuse_gears(mechanism: NeutralMechanism, engine: str) -> None:
    """Raise `Refused` at a gear, for an engine without couplings of joints."""
    for gear in mechanism.gears:
        raise Refused(f"{engine} has no coupling of joints, such as gear {gear.name!r}")


def refuse_armatures(mechanism: NeutralMechanism, engine: str) -> None:
    """Raise `Refused` at an armature, for an engine without inertias of coordinates."""
    for one in mechanism.joints:
        if one.armature:
            raise Refused(f"{engine} has no armature, such as that of joint {one.name!r}")


def refuse_damped_balls(mechanism: NeutralMechanism) -> None:
    """Raise `Refused` at a damped ball or free joint."""
    for one in mechanism.joints:
        if one.damping and not one.is_single:
            raise Refused(f"damping of {one.kind} joint {one.name!r}")


def refuse_friction(mechanism: NeutralMechanism, words: str) -> None:
    """Raise `Refused` at a joint with dry friction and without a drive; `words` go on."""
    for j, one in enumerate(mechanism.joints):
        if mechanism.friction_of(j):
            raise Refused(f"dry friction of joint {one.name!r} {words}")


def refuse_other_than_free_trees(mechanism: NeutralMechanism) -> None:
    """Raise `Refused` unless nothing but constant loads and linear springs acts on a tree."""
    held = mechanism.loops or mechanism.gears or mechanism.drives or mechanism.rest
    slack = any(not one.free_length for one in mechanism.springs)
    acts = any(
        one.limits or one.friction or one.is_forced or one.spring[1:].any()
        for one in mechanism.joints
    )
    changes = any(one.share.size > 1 for one in mechanism.loads)
    if held or slack or acts or changes or mechanism.contacts:
        raise Refused("other than free trees with linear springs in continuous time")


def refuse_changing_loads(mechanism: NeutralMechanism) -> None:
    """Raise `Refused` at a load that changes in a sweep, for an engine whose loads follow time."""
    shares = [one.share for one in mechanism.loads] + [one.force for one in mechanism.joints]
    if any(one.size > 1 for one in shares):
        raise Refused("loads that change in a sweep")


def refuse_rows(mechanism: NeutralMechanism, free: set | None = None) -> None:
    """Raise `Refused` at a link that has not one joint but several, unless all are `free`."""
    for k in range(1, len(mechanism.links)):
        own = mechanism.joints_of(k)
        if len(own) != 1 and not set(own) <= (free or set()):
            raise Refused(f"link {mechanism.links[k].name!r} with several joints")


def held_joints(mechanism: NeutralMechanism) -> list:
    """Numbers of the joints for which an engine of bodies needs constraints.

    It needs none for free joints, nor for those of `free_rows`.

    Raises
    ------
    Refused
        A link has several joints that are no row of `free_rows`, or a ball or free joint is damped.
    """
    free = free_rows(mechanism)
    refuse_rows(mechanism, free)
    refuse_damped_balls(mechanism)
    joints = enumerate(mechanism.joints)
    return [j for j, one in joints if j not in free and one.kind != "free"]


def free_rows(mechanism: NeutralMechanism) -> set:
    """Numbers of the joints in rows that leave a link free in its plane: two slides and a hinge.

    An engine of bodies needs no constraint for them: the link is a free body in the plane.

    Raises
    ------
    Refused
        One of these joints has a drive or a force of its own.
    """
    found = set()
    for k in range(1, len(mechanism.links)):
        own = mechanism.joints_of(k)
        row = [mechanism.joints[j] for j in own]
        slides = [one.axis for one in row if one.kind == "slide"]
        if sorted(one.kind for one in row) != ["hinge", "slide", "slide"]:
            continue
        if not (mechanism.is_planar and np.linalg.norm(np.cross(*slides)) > LEAST_SINE):
            continue
        for j, one in zip(own, row):
            moved = one.is_sprung or one.damping or one.is_forced or one.friction or one.limits
            if moved or mechanism.drive_of(j) or (one.armature and one.kind == "slide"):
                raise Refused(
                    f"joint {one.name!r} of a link that is free in its plane, which has a drive, a "
                    "force, friction, a stop or an armature"
                )
        found |= set(own)
    return found


def check_motions(motions: list[LinkMotion]) -> None:
    """Raise ValueError if a motion is no `LinkMotion`."""
    for k, one in enumerate(motions, 1):
        if len(one) not in (4, 6):
            raise ValueError(
                f"read({k}) returned {len(one)} things, not 4, or 6 with accelerations"
            )
        shapes = [np.shape(part) for part in one]
        if shapes != [(3,), (3, 3), *[(3,)] * (len(one) - 2)]:
            raise ValueError(
                f"read({k}) returned arrays of the shapes {shapes}; expected place (3,), rotation "
                "(3, 3), velocity (3,) and angular velocity (3,)"
            )
