"""Velocities of links from rates of joints, for engines in coordinates of joints."""

from __future__ import annotations

import numpy as np

from .geometry import turn_about
from .mechanism import LinkStates, NeutralJoint, NeutralMechanism, PlainArray


class RowOfJoints:
    """The motion of a point of a tree along the joints of a link, from the link before them.

    Attributes
    ----------
    at : ndarray (3,)
        The point in the start pose [m].
    turn : ndarray (n, 3, 3)
    velocity, acceleration, omega, alpha : ndarray (n, 3)
    """

    def __init__(self, mechanism: NeutralMechanism, states: LinkStates, link: int) -> None:
        self.at, self.turn = mechanism.links[link].centre, states.turn[:, link]
        self.velocity, self.acceleration = states.velocity[:, link], states.acceleration[:, link]
        self.omega, self.alpha = states.omega[:, link], states.alpha[:, link]

    def go(self, to: PlainArray) -> None:
        """Go to another point of the same link, whose place in the start pose is `to`."""
        self.add_arm(self.turn @ (to - self.at))
        self.at = to

    def add_arm(self, arm: PlainArray) -> None:
        """Add the velocity and the acceleration at the end of an arm (n, 3)."""
        turning = np.cross(self.omega, arm)
        self.velocity = self.velocity + turning
        self.acceleration = (
            self.acceleration + np.cross(self.alpha, arm) + np.cross(self.omega, turning)
        )

    def cross(self, joint: NeutralJoint, coordinates: PlainArray) -> None:
        """Go to the child of a hinge or slide with its coordinates (3, n)."""
        self.go(joint.anchor)
        value, rate, change = coordinates[..., None]
        axis = self.turn @ joint.axis
        turning = np.cross(self.omega, axis)
        if joint.kind == "slide":
            self.add_arm(axis * (value - joint.value))
            self.velocity = self.velocity + axis * rate
            self.acceleration = self.acceleration + axis * change + 2.0 * turning * rate
        else:
            turns = [turn_about(joint.axis, float(q[0]) - joint.value) for q in value]
            self.turn = self.turn @ np.array(turns)
            self.alpha = self.alpha + axis * change + turning * rate
            self.omega = self.omega + axis * rate


def follow_joints(mechanism: NeutralMechanism, states: LinkStates) -> None:
    """Set the velocities and accelerations of links to those of joints at the samples.

    An engine in coordinates of joints has rates in the middle of steps, and gives velocities of
    links with these rates at the poses at the ends of steps.  Their mean is of first order; that of
    the rates, at the pose of the sample, is of second order.  Free links, and those
    whose joints have no coordinates (NaN), keep their velocities, and those on balls their angular
    velocities.
    """
    for k in range(1, len(mechanism.links)):
        own = mechanism.joints_of(k)
        kinds = [mechanism.joints[j].kind for j in own]
        unknown = np.isnan(states.coordinates[0][:, own]).any()
        if unknown or "free" in kinds or ("ball" in kinds and len(kinds) > 1):
            continue
        row = RowOfJoints(mechanism, states, mechanism.joints[own[0]].parent)
        for j in own:
            if kinds == ["ball"]:
                row.go(mechanism.joints[j].anchor)
                row.turn, row.omega = states.turn[:, k], states.omega[:, k]
                row.alpha = states.alpha[:, k]
            else:
                row.cross(mechanism.joints[j], states.coordinates[:, :, j])
        row.go(mechanism.links[k].centre)
        states.velocity[:, k], states.acceleration[:, k] = row.velocity, row.acceleration
        states.omega[:, k], states.alpha[:, k] = row.omega, row.alpha
