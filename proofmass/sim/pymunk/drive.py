"""Ideal drives: constraints between two links whose target is moved before each step.

With an error bias of 0 a step of Chipmunk makes up for all that lacks to the target, so drives do
not drift, even where several of them pull at one link and only the last in order is met exactly.
"""

from collections.abc import Iterable, Sequence

import numpy as np
import pymunk

from proofmass.sim.pymunk.links import Joint, Links
from proofmass.sim.pymunk.space import at


class HingeDrive(pymunk.GearJoint):
    """Holds two links at an angle, as a gear of ratio 1 with a phase."""

    def __init__(self, joint: Joint, bodies: Sequence[pymunk.Body]):
        super().__init__(bodies[joint.hold.a], bodies[joint.hold.b], 0.0, 1.0)
        self.start, self.sign = joint.value, joint.sign
        self.error_bias = 0.0

    def aim(self, value: float) -> None:
        """Set the value [rad] of the joint after the next step."""
        self.phase = self.sign * (value - self.start)


class SlideDrive(pymunk.GrooveJoint):
    """Holds two links at a distance along a slide, by a groove across it on the first of them.

    Chipmunk has no linear motor.  With the anchors of the guide this one carries only the force
    along the slide, and the guide only what is across.
    """

    def __init__(self, joint: Joint, links: Links, bodies: Sequence[pymunk.Body]):
        hold, axis = joint.hold, joint.hold.axis
        assert axis is not None
        across = links.extent * np.array([-axis[1], axis[0]])
        self.left, self.right = at(links, hold.a, hold.on_a + across), at(
            links, hold.a, hold.on_a - across)
        self.start, self.axis = joint.value, tuple(axis.tolist())
        super().__init__(bodies[hold.a], bodies[hold.b], self.left, self.right,
                         at(links, hold.b, hold.on_b))
        self.error_bias = 0.0

    def aim(self, value: float) -> None:
        """Set the value [m] of the joint after the next step."""
        move = value - self.start
        dx, dy = move * self.axis[0], move * self.axis[1]
        self.groove_a = (self.left[0] + dx, self.left[1] + dy)
        self.groove_b = (self.right[0] + dx, self.right[1] + dy)


Motor = HingeDrive | SlideDrive


def add_drives(space: pymunk.Space, links: Links) -> list[Motor]:
    """Add the drives of a mechanism, last in the solver's order, where they are met best."""
    bodies = [*space.bodies, space.static_body]
    drives: list[Motor] = [
        HingeDrive(joint, bodies) if joint.hold.axis is None else SlideDrive(joint, links, bodies)
        for joint in links.drives]
    space.add(*drives)
    return drives


def aim(drives: Iterable[Motor], values: Iterable[float]) -> None:
    """Set the values [rad or m] of all drives after the next step."""
    for drive, value in zip(drives, values, strict=True):
        drive.aim(value)
