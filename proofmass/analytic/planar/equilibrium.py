"""What `proofmass.analytic.equilibrium` asks of a planar linkage whose drives leave freedoms."""

from dataclasses import dataclass
from functools import cached_property

from proofmass.analytic.numerics import Array, Index, NotCovered
from proofmass.analytic.planar.forces import applied, centres
from proofmass.analytic.planar.kinematics import (
    Drives,
    loop_jacobian,
    move,
    nearest,
    residual,
)
from proofmass.analytic.planar.mechanism import Mechanism
from proofmass.analytic.stops import Stop, ends


@dataclass(frozen=True)
class LinkageAtRest:
    """A planar linkage at rest beside its drives.

    Raises
    ------
    NotCovered
        A joint that the drives leave has dry friction: its rest depends on how it came there.
    """

    m: Mechanism
    drives: Drives

    def __post_init__(self) -> None:
        for joint in (self.m.joints[j] for j in self.drives.following):
            if joint.friction:
                raise NotCovered(
                    f"joint {joint.name!r} has friction, and the drives do not determine it: where "
                    "it rests depends on how it came there"
                )

    @property
    def sizes(self) -> Array:
        """What its joints are measured in (joints,): 1 rad, or the size of the mechanism [m]."""
        return self.m.scale

    @property
    def driven(self) -> Index:
        """Where the drives stand among the joints (drives,)."""
        return self.drives.driven

    @cached_property
    def stops(self) -> tuple[Stop, ...]:
        """Of the joints that the drives leave."""
        m = self.m
        joints = ((int(j), m.joints[j]) for j in self.drives.following)
        return tuple(
            stop
            for j, joint in joints
            for stop in ends(joint.name, joint.range, j, j, float(m.scale[j]))
        )

    def begin(self, values: Array) -> Array:
        """The closed pose (joints,) next to the start, with the drives at values (drives,)."""
        return nearest(self.m, self.m.start, self.driven, values)

    def moved(self, q: Array, way: Array) -> Array:
        """The poses (n, joints) at the ends of ways (n, joints)."""
        return q + way

    def pushed(self, q: Array, ctrl: Array | None) -> tuple[Array, Array, Array]:
        """Forces on the joints (n, joints) at poses q (n, joints), and the rows of the loops.

        And how far the loops are open (n, rows) [sizes].
        """
        m, motion = self.m, move(self.m, q)
        force = applied(m, motion, centres(m, motion), q, 0.0, ctrl)
        return force, loop_jacobian(m, motion, q) / m.size, residual(m, motion, q) / m.size

    def values(self, q: Array) -> Array:
        """Values of the drives (n, drives) [rad or m]."""
        return q[:, self.driven]
