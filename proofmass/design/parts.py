"""What must be built for a balancer: its segments, springs, preloads, and stops that it meets."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from proofmass.analytic.balancer.measures import (
    chain_of,
    joints_without_springs,
    precision_points,
)
from proofmass.analytic.balancer.path import along, follow
from proofmass.analytic.balancer.synthesis import LAST_PATH_ANGLE

TOUCH_POINTS = 90
"""Number of angles at which a design's joints are looked at for stops that they rest on."""


@dataclass(frozen=True)
class PartList:
    """Parts of a balancer; joints are counted from 1.

    Attributes
    ----------
    segments : int
        Number of segments.
    springs, no_springs : tuple of int
        Joints with a spring, and joints whose spring has no moment at any angle.
    nonlinear, preloads, stops : tuple of int
        Joints with a spring that is not linear, with a preload, and with a stop that the joint
        rests on at some angle.
    """

    segments: int
    springs: tuple[int, ...]
    no_springs: tuple[int, ...]
    nonlinear: tuple[int, ...]
    preloads: tuple[int, ...]
    stops: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of segments, springs and stops, with one more for each preload and nonlinearity.

        >>> PartList(3, (1, 3), (2,), (1,), (), ()).count
        6
        """
        parts = (self.springs, self.nonlinear, self.preloads, self.stops)
        return self.segments + sum(map(len, parts))

    @property
    def words(self) -> str:
        """The parts in words.

        >>> PartList(3, (1, 3), (2,), (), (), (2,)).words
        '3 segments, springs in joints 1 and 3 (none in joint 2), stop in joint 2'
        """
        found = [f"{self.segments} segments", *name_joints("spring", self.springs)]
        if self.no_springs:
            found[-1] += f" (none in {' and '.join(f'joint {i}' for i in self.no_springs)})"
        found += name_joints("nonlinear spring", self.nonlinear)
        found += name_joints("preload", self.preloads)
        return ", ".join([*found, *name_joints("stop", self.stops)])


def name_joints(part: str, joints: tuple[int, ...]) -> list[str]:
    """A part and its joints in words; nothing without joints."""
    if not joints:
        return []
    many = "s" * (len(joints) > 1)
    *most, last = map(str, joints)
    return [f"{part}{many} in joint{many} {', '.join(most)}{' and ' * bool(most)}{last}"]


def leave_out_stops(parameters: Mapping[str, float]) -> dict[str, float]:
    """The parameters of a design without the stops that no joint rests on, and without zeros.

    A joint rests on a stop if it does so at one of `TOUCH_POINTS` angles up to 90 degrees, at rest
    not counted.  A stop that holds a preload at rest is kept.

    Examples
    --------
    >>> chain = {"length1": 0.4, "length2": 0.45, "length3": 0.45, "high2": 3.0}
    >>> chain |= {"stiffness1": 1.0, "stiffness2": 0.0, "stiffness3": 2.0, "quadratic1": 0.0}
    >>> sorted(chain.keys() - leave_out_stops(chain).keys())
    ['high2', 'quadratic1']
    """
    chain = chain_of(dict(parameters))
    path = along(chain, follow(chain, LAST_PATH_ANGLE), precision_points(TOUCH_POINTS))
    on_stop = {"low": (path.side[0] < 0).any(axis=0), "high": (path.side[0] > 0).any(axis=0)}

    def is_needed(name: str, value: float) -> bool:
        kind, joint = name[:-1], name[-1]
        if kind in ("quadratic", "preload"):
            return value != 0.0
        if kind not in on_stop:
            return True
        holds = value == 0.0 and parameters.get(f"preload{joint}", 0.0) != 0.0
        return np.isfinite(value) and (holds or bool(on_stop[kind][int(joint) - 1]))

    return {name: value for name, value in parameters.items() if is_needed(name, value)}


def list_parts(parameters: Mapping[str, float]) -> PartList:
    """The parts of a design from its parameters, of which `leave_out_stops` left those needed."""
    chain = chain_of(dict(parameters))
    free = set(joints_without_springs(chain))
    joints = range(1, chain.segments + 1)

    def having(*names: str) -> tuple[int, ...]:
        found = [i for i in joints if any(f"{n}{i}" in parameters for n in names)]
        return tuple(i for i in found if i not in free or names != ("quadratic",))

    return PartList(
        chain.segments,
        tuple(i for i in joints if i not in free),
        tuple(sorted(free)),
        having("quadratic"),
        having("preload"),
        having("low", "high"),
    )
