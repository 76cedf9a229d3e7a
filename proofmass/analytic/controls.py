"""Controls of actuators and motions of drives that change in time.

The profiles of controls and of drives (`MotionProfile`) are functions of time.  A profile may have
``breaks``: times at which one of its derivatives jumps, such as the rows of a table.  A motion is
integrated from break to break, since it is smooth in between.  A profile may also have a method
``scalar()``, which returns a function of one time that is faster than the profile itself.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from proofmass.base.arrays import Array, Index

if TYPE_CHECKING:
    from proofmass.analytic.mjcf import ModelData

MotionProfile = Callable[[Array], tuple[Array, Array, Array]]
"""Value, rate and acceleration of a drive or of a control as functions of time."""
TIME_TOLERANCE = 1e-13
"""Times count as equal if they differ by less: in s, or relative to times longer than 1 s."""


@dataclass(frozen=True, eq=False)
class ControlsInTime:
    """All controls of a model, of which some change in time.

    Attributes
    ----------
    fixed : ndarray (controls,)
        Controls of the start key [SI].
    profiles : mapping of int to callable
        Profiles of the controls that change, by their indices among all controls.
    """

    fixed: Array
    profiles: Mapping[int, MotionProfile]

    @classmethod
    def of(
        cls, data: "ModelData", fixed: Array, named: Mapping[str, MotionProfile] | None
    ) -> "ControlsInTime | None":
        """Controls of a model, profiles by actuators' names; None if no control changes."""
        return cls(fixed, controls_by_place(data, named)) if named else None

    def at(self, time: float) -> Array:
        """All controls (controls,) at a time [s]."""
        found = np.array(self.fixed, float)
        for place, value in self.scalars:
            found[place] = value(time)
        return found

    @cached_property
    def scalars(self) -> tuple[tuple[int, Callable[[float], float]], ...]:
        """Indices of the controls that change, with their profiles as functions of one time [s]."""

        def scalar_function(profile: MotionProfile) -> Callable[[float], float]:
            return lambda time: float(profile(np.array([time]))[0][0])

        return tuple(
            (place, profile.scalar() if hasattr(profile, "scalar") else scalar_function(profile))
            for place, profile in self.profiles.items()
        )

    def along(self, times: Array) -> Array:
        """All controls (n, controls) at times (n,) [s]."""
        return insert_controls(
            self.fixed, {k: profile(times)[0] for k, profile in self.profiles.items()}
        )

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times at which a derivative of a control jumps [s]."""
        return break_times(self.profiles.values())


def controls_at_samples(
    data: "ModelData", fixed: Array, named: Mapping[str, ArrayLike] | None
) -> Array | None:
    """All controls (n, controls) of a model at n samples; None if no control changes.

    `named` has curves (n,) by the names of actuators; `fixed` (controls,) are the controls of the
    start key.
    """
    return insert_controls(fixed, controls_by_place(data, named)) if named else None


def insert_controls(fixed: Array, changed: Mapping[int, Array]) -> Array:
    """All controls (n, controls): `fixed`, except the curves (n,) in `changed`, by index."""
    n = max((np.size(curve) for curve in changed.values()), default=1)
    found = np.tile(np.asarray(fixed, float), (n, 1))
    for place, curve in changed.items():
        found[:, place] = curve
    return found


def controls_by_place(data: "ModelData", named: Mapping[str, Any]) -> dict[int, Any]:
    """Entries given by names of actuators of a model, by the indices of their controls.

    Raises
    ------
    ValueError
        There is no such actuator.
    """
    places = data.control_places
    for name in named:
        if name not in places:
            raise ValueError(f"no actuator {name!r}; there are: {', '.join(places) or 'none'}")
    return {places[name]: one for name, one in named.items()}


@dataclass(frozen=True)
class Prescribed:
    """Joints whose values, rates and accelerations (drives,) are known at each time.

    Attributes
    ----------
    poses, rates : ndarray (drives,) of int
        Indices of the joints in a pose and in the rates.
    profile : callable
        Function of one time that returns values, rates and accelerations [SI].
    breaks : tuple of float
        Times at which a derivative of the motion jumps [s].
    """

    poses: Index
    rates: Index
    profile: Callable[[float], tuple[Array, Array, Array]]
    breaks: tuple[float, ...] = ()

    @classmethod
    def of(cls, poses: Index, rates: Index, profiles: Sequence[MotionProfile]) -> "Prescribed":
        """Joints with a motion profile each."""

        def profile(t: float) -> tuple[Array, Array, Array]:
            parts = [[float(part) for part in one(np.asarray(t, float))] for one in profiles]
            value, rate, acceleration = np.array(parts).T
            return value, rate, acceleration

        return cls(poses, rates, profile, break_times(profiles))


NO_INDICES, NO_CONTROL_VALUES = np.zeros(0, np.intp), np.zeros(0)
NO_PRESCRIBED_JOINTS = Prescribed(
    NO_INDICES, NO_INDICES, lambda t: (NO_CONTROL_VALUES, NO_CONTROL_VALUES, NO_CONTROL_VALUES)
)
"""A prescribed motion of no joints."""


def break_times(profiles: Any) -> tuple[float, ...]:
    """Times at which a derivative of any of the profiles jumps [s], in rising order."""
    times = [np.asarray(getattr(profile, "breaks", ()), float) for profile in profiles]
    return tuple(np.unique(np.concatenate([np.zeros(0), *times])).tolist())


def smooth_pieces(
    start: float, end: float, breaks: tuple[float, ...]
) -> Iterator[tuple[float, float, float]]:
    """Parts of a motion between breaks: start, end, and last time at which profiles are evaluated.

    At a break a profile has the derivatives of the next part.  Within a part that ends at a break,
    profiles are therefore evaluated no later than one rounding step before its end.  For a part
    that does not end at a break the last time is infinite.

    >>> [(a, b) for a, b, _ in smooth_pieces(0.0, 2.0, (0.0, 0.5, 3.0))]
    [(0.0, 0.5), (0.5, 2.0)]
    """
    tolerance = TIME_TOLERANCE * max(1.0, abs(start), abs(end))
    inside = [time for time in breaks if start + tolerance < time < end - tolerance]
    break_at_end = any(abs(time - end) <= tolerance for time in breaks)
    for one, two in pairwise([start, *inside, end]):
        ends_at_break = two < end or break_at_end
        yield one, two, float(np.nextafter(two, -np.inf)) if ends_at_break else np.inf
