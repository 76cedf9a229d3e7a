"""Actuators whose force is linear in control, length and rate, and controls that change in time.

The laws of controls, and of drives, may have ``breaks``: times at which a derivative of theirs
jumps, such as the rows of a table.  A motion is integrated from break to break, where it is smooth.
A law may also make a function of one time, by ``scalar()``, that is faster than the law itself.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array, Index

Law = Callable[[Array], tuple[Array, Array, Array]]
"""Value, rate and acceleration of a drive or of a control as functions of time."""
UNLIMITED = (-np.inf, np.inf)
TOGETHER = 1e-13
"""Times that differ by less [s, or a share of them] count as one."""


@dataclass(frozen=True)
class AffineActuator:
    """An actuator whose force is linear in control, length and rate of what it acts on.

    Attributes
    ----------
    name : str
    tendon : int
        Number of its tendon; -1 if it acts on a joint.
    pose, rate : int
        Where its joint stands in a pose and in the rates.
    gear : float
        Length of the actuator for a unit of what it acts on [SI].
    place : int
        Where its control stands among all controls.
    gain : float
        Force for a unit of the control [SI].
    offset : float
        Part of the force that never changes [N or N m].
    by_length, by_rate : float
        Force for a unit of length, and of its rate [SI].
    range : tuple of float
        Smallest and largest force [N or N m].
    controls : tuple of float
        Smallest and largest control [its unit].
    """

    name: str
    tendon: int
    pose: int
    rate: int
    gear: float
    place: int
    gain: float
    offset: float
    by_length: float
    by_rate: float
    range: tuple[float, float]
    controls: tuple[float, float] = UNLIMITED

    @property
    def limited(self) -> bool:
        """Whether its force has a range."""
        return bool(np.isfinite(self.range).any())

    def asked(self, control: Array) -> Array:
        """The part of the force that controls (n,) ask for [N or N m]."""
        if self.controls != UNLIMITED:
            control = np.clip(control, *self.controls)
        return np.asarray(self.gain * control)

    def force(
        self, control: Array, length: Array | float = 0.0, rate: Array | float = 0.0
    ) -> Array:
        """Forces (n,) with some controls at some lengths and rates [N or N m]."""
        own = self.asked(control) + self.offset + self.by_length * length + self.by_rate * rate
        return np.asarray(np.clip(own, *self.range))


@dataclass(frozen=True, eq=False)
class SiteLoad:
    """A force and a moment that an actuator on a site gives its body, however the body moves.

    Attributes
    ----------
    actuator : AffineActuator
        Its force depends on its control alone.
    body : int
    at : ndarray (3,)
        The site, in the frame of the body [m].
    force, moment : ndarray (3,)
        Of a unit of the actuator's force [1, m], in the frame of the body, or of the ground.
    follows : bool
        Whether the load turns with the body; otherwise it is a dead load.
    """

    actuator: AffineActuator
    body: int
    at: Array
    force: Array
    moment: Array
    follows: bool


@dataclass(frozen=True, eq=False)
class ControlsInTime:
    """All controls of a model, of which some follow laws.

    Attributes
    ----------
    fixed : ndarray (controls,)
        Those of the key [SI].
    laws : mapping of int to callable
        By the place among all controls.
    """

    fixed: Array
    laws: Mapping[int, Law]

    @classmethod
    def of(
        cls, model: Any, fixed: Array, named: Mapping[str, Law] | None
    ) -> "ControlsInTime | None":
        """Those of a compiled MJCF, by actuators' names; None if all are those of the key."""
        return cls(fixed, controls_by_place(model, named)) if named else None

    def at(self, time: float) -> Array:
        """All controls (controls,) at a time [s]."""
        found = np.array(self.fixed, float)
        for place, value in self.scalars:
            found[place] = value(time)
        return found

    @cached_property
    def scalars(self) -> tuple[tuple[int, Callable[[float], float]], ...]:
        """Places of the controls that follow laws, and these as functions of one time [s]."""

        def plain(law: Law) -> Callable[[float], float]:
            return lambda time: float(law(np.array([time]))[0][0])

        return tuple(
            (place, law.scalar() if hasattr(law, "scalar") else plain(law))
            for place, law in self.laws.items()
        )

    def along(self, times: Array) -> Array:
        """All controls (n, controls) at times (n,) [s]."""
        return with_controls(self.fixed, {k: law(times)[0] for k, law in self.laws.items()})

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times at which a derivative of a control jumps [s]."""
        return breaks_of(self.laws.values())


def controls_at_samples(
    model: Any, fixed: Array, named: Mapping[str, ArrayLike] | None
) -> Array | None:
    """All controls (n, controls) of a compiled MJCF, some of them curves (n,), by actuators' names.

    None if all are those of the key.
    """
    return with_controls(fixed, controls_by_place(model, named)) if named else None


def with_controls(fixed: Array, changed: Mapping[int, Array]) -> Array:
    """All controls (n, controls), some of them curves (n,), by their places."""
    n = max((np.size(curve) for curve in changed.values()), default=1)
    found = np.tile(np.asarray(fixed, float), (n, 1))
    for place, curve in changed.items():
        found[:, place] = curve
    return found


def controls_by_place(model: Any, named: Mapping[str, Any]) -> dict[int, Any]:
    """What is given by the names of actuators of a compiled MJCF, by the places of their controls.

    Raises
    ------
    ValueError
        There is no such actuator.
    """
    places = {
        model.actuator(a).name: int(model.actuator_ctrladr[a]) for a in range(model.nactuator)
    }
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
        Where they stand in a pose and in the rates.
    law : callable
        Values, rates and accelerations as a function of one time [SI].
    breaks : tuple of float
        Times at which a derivative of these jumps [s].
    """

    poses: Index
    rates: Index
    law: Callable[[float], tuple[Array, Array, Array]]
    breaks: tuple[float, ...] = ()

    @classmethod
    def of(cls, poses: Index, rates: Index, laws: Sequence[Law]) -> "Prescribed":
        """Joints that follow laws."""

        def law(t: float) -> tuple[Array, Array, Array]:
            parts = [[float(part) for part in one(np.asarray(t, float))] for one in laws]
            value, rate, acceleration = np.array(parts).T
            return value, rate, acceleration

        return cls(poses, rates, law, breaks_of(laws))


NONE, NOTHING = np.zeros(0, np.intp), np.zeros(0)
UNDRIVEN = Prescribed(NONE, NONE, lambda t: (NOTHING, NOTHING, NOTHING))
"""No joints."""


def breaks_of(laws: Any) -> tuple[float, ...]:
    """Times at which a derivative of one of some laws jumps [s], rising."""
    times = [np.asarray(getattr(law, "breaks", ()), float) for law in laws]
    return tuple(np.unique(np.concatenate([np.zeros(0), *times])).tolist())


def smooth_pieces(
    start: float, end: float, breaks: tuple[float, ...]
) -> Iterator[tuple[float, float, float]]:
    """The parts of a motion between breaks: start, end, and the last time that is of the part.

    A law whose derivative jumps at a break has that of the next part there, so that within a part
    it is asked no later than just before its end.

    >>> [(a, b) for a, b, _ in smooth_pieces(0.0, 2.0, (0.0, 0.5, 3.0))]
    [(0.0, 0.5), (0.5, 2.0)]
    """
    near = TOGETHER * max(1.0, abs(start), abs(end))
    inside = [time for time in breaks if start + near < time < end - near]
    last = any(abs(time - end) <= near for time in breaks)
    for one, two in pairwise([start, *inside, end]):
        ends_at_break = two < end or last
        yield one, two, float(np.nextafter(two, -np.inf)) if ends_at_break else np.inf
