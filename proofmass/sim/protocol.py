"""What the core asks of a simulator and what it gets back; a simulator is one function, `simulate`.

    simulate(model: Path, run: Run) -> Curves

A simulator knows no reference and no tolerance.  It imports nothing of the core.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from proofmass.analytic.numerics import Array

BROKEN = set[str]()
"""Engines that cannot be called in this process any more; whoever keeps it has to start another."""
Law = Callable[[Array], tuple[Array, Array, Array]]


MOST_STEPS = 1e12  # from sample to sample: at 1 us a step, of the smallest models, 12 days


class Limit(NamedTuple):
    """How far an engine may be off, as a share of the reference's range, and why.

    The `ACCURACY` of an engine has one for ``sweep`` (all channels), and for ``position``,
    ``velocity`` and ``acceleration`` (channels of a duration), as far as the engine states them.
    """

    of_range: float
    why: str


class Unsupported(Exception):
    """The simulator cannot express something in the model; the message names it."""


class Diverged(Exception):
    """The run was lost: not finite, reset by the engine, or the loops came open."""


class NotSolved(Diverged):
    """No pose at rest was found in the steps or iterations that this simulator allows itself."""


class BadModel(Exception):
    """The model itself cannot be used: unreadable, not assembled, a missing element."""


class BadRod(BadModel):
    """A rod that cannot be built; the arguments are its name, what of it is wrong, and why."""

    def __str__(self) -> str:
        return "rod {!r}: {}: {}".format(*self.args)


class BadSetting(BadModel):
    """A setting that an engine does not have; the arguments are its name and what is wrong."""

    def __str__(self) -> str:
        return "setting {}: {}".format(*self.args)


def _spelled(value: Any) -> Any:
    """Numbers that MJCF has in one attribute, ``"0.002 1"``, as a tuple."""
    if not isinstance(value, str):
        return value
    try:
        return tuple(map(float, value.split()))
    except ValueError:
        raise ValueError(f"{value!r} is no list of numbers") from None


Number = Annotated[float, Field(strict=True)]
Count = Annotated[int, Field(strict=True, ge=1, lt=2**31)]
Switch = Annotated[bool, Field(strict=True)]
Numbers = Annotated[tuple[Number, ...], BeforeValidator(_spelled)]


class EngineSettings(BaseModel):
    """What can be set in an engine, with types and ranges; each engine states its own."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def read(cls, settings: Mapping[str, Any]) -> Self:
        """Check settings.

        Raises
        ------
        BadSetting
            Unknown, of the wrong type, or out of range.
        """
        for key in settings:
            if key not in cls.model_fields:
                raise BadSetting(key, f"unknown setting {key!r}; known: "
                                 f"{', '.join(cls.model_fields)}")
        try:
            return cls(**settings)
        except ValidationError as error:
            first = error.errors()[0]
            wrong = first["msg"].removeprefix("Value error, ")
            raise BadSetting(first["loc"][0], f"{wrong}, not {first['input']!r}") from None


@dataclass(frozen=True)
class Drive:
    """A prescribed joint motion.

    Attributes
    ----------
    joint : str
        Name of the driven joint in the MJCF.
    law : callable
        ``law(x) -> (value, rate, acceleration)`` for arrays of x, in the joint's SI units.
        In a sweep x is the run's x; in a duration it is time [s].
    """

    joint: str
    law: Law


@dataclass(frozen=True)
class Imposed:
    """How a written program imposes the motion of its drives.

    Attributes
    ----------
    kind : str
        A word of the engine's; see its `write_program`.
    gain : float
        How hard the drive holds its joint, in multiples of what the time step suggests; 0 where
        there is nothing to choose.
    """

    kind: str
    gain: float = 0.0


@dataclass(frozen=True)
class Rod:
    """An elastic rod between two sites of the MJCF: inextensible, bending in the model's plane.

    Attributes
    ----------
    name : str
        Of the rod; its bodies, joints and sites are ``name.1``, ``name.2``, ...
    start : str
        Site where it begins, its tangent along the site's x axis; it bends about the z axis.
    end : str, optional
        Site, of another body or of another rod, that holds its far end.
    length : float
        [m]
    stiffness : float
        EI [N m2]
    segments : int
        n >= 2 pieces of h = length / n.
    ends : tuple of two str
        ``clamped`` or ``pinned`` where it begins; ``pinned``, ``clamped`` or ``free`` at the other.
    scheme : {"half", "double", "naive"}
        Where its springs are; see `proofmass.sim.rods`.
    mass : float, optional
        Of all of it [kg]; without gravity statics does not know it.
    turn : float
        Of its tangent from end to end in the start pose [rad].
    """

    name: str
    start: str
    end: str | None
    length: float
    stiffness: float
    segments: int
    ends: tuple[str, str]
    scheme: str = "half"
    mass: float | None = None
    turn: float = 0.0


@dataclass(frozen=True)
class Run:
    """One thing to do with a model.

    Attributes
    ----------
    kind : {"sweep", "duration", "rest", "passive"}
        Quasi-static poses, time stepping, or one pose at rest with the shapes of its rods.  A
        passive run steps a model that no sidecar speaks of, as the engine does by itself, from
        the key `start` or else its first one, and records all sensors.
    x : ndarray (n,)
        Where to sample; rising.  Time [s] for a duration, arc length [m] of the rods for a rest.
    channels : tuple of str
        Sensors of the MJCF to record.  ``name`` for a scalar sensor, ``name.x``, ``.y``, ``.z``
        for a component of a vector, ``name.angle`` for the direction of a ``framexaxis`` sensor
        in the plane of motion, unwrapped along the run [rad].  In a rest also ``rod.x``, ``.y``,
        ``.z`` [m], ``.angle`` [rad] and ``.moment`` [N m] along a rod.
    drives : tuple of Drive
        Prescribed motions, at the same time; empty for a free motion.
    start : str
        Name of the ``<key>`` that holds the start pose (and the assembly mode).
    settings : mapping
        Engine settings that replace those of the model: ``timestep``, ``iterations``, ...
    rods : tuple of Rod
        What the model is completed with before it is compiled.
    """

    kind: str
    x: Array
    channels: tuple[str, ...]
    drives: tuple[Drive, ...] = ()
    start: str = "start"
    settings: Mapping[str, object] = field(default_factory=dict)
    rods: tuple[Rod, ...] = ()

    def motion(self, x: Array) -> tuple[Array, Array, Array]:
        """Values, rates and accelerations of all drives at x, each (drives, n)."""
        rows = [np.broadcast_arrays(*drive.law(x)) for drive in self.drives]
        value, rate, acceleration = (np.array(part, float).reshape(len(rows), x.size)
                                     for part in (zip(*rows, strict=True) if rows else [()] * 3))
        return value, rate, acceleration

    def steps(self, timestep: float) -> tuple[int, float]:
        """Whole steps from sample to sample, and the step [s] <= `timestep` that fits them.

        Raises
        ------
        Unsupported
            The samples are not evenly spaced.
        BadModel
            There are more steps from sample to sample than anyone waits for.
        """
        spacing = np.diff(self.x)
        if np.ptp(spacing) > 1e-9 * spacing.mean():
            raise Unsupported("samples at uneven times in a duration")
        width = float(self.x[-1] - self.x[0]) / (self.x.size - 1)
        if not (steps := width / float(timestep)) < MOST_STEPS:
            raise BadModel(f"{width:g} s from sample to sample are {steps:.3g} time steps of "
                           f"{timestep:g} s; give a longer step or a shorter run")
        count = max(1, int(np.ceil(steps - 1e-9)))
        return count, width / count


@dataclass(frozen=True)
class Curves:
    """Named curves on one rising parameter, and what they cost.

    Attributes
    ----------
    x : ndarray (n,)
        Time [s], drive value, or arc length [m] of a rest.
    channels : dict of str to ndarray (n,)
        The recorded curves.
    missing : dict of str to str
        Channels that this simulator cannot deliver in this kind of run, with the reason.
    drive : tuple of three ndarray (drives, n), or None
        Value, rate and acceleration of the driven joints *as they actually moved*; rates and
        accelerations of a sweep are those of its law.
    gap : float
        Largest distance between two points that a loop should hold together [m].
    seconds : float
        Wall time of the run without loading the model [s].
    steps : int
        Engine steps (duration) or pose solutions (sweep).
    settings : dict
        Settings as used, for the record: time step, integrator, ...; none that has no effect.
    stopped : str
        Why a sweep ended before its last sample, at a limit position for one; what was solved
        until there is in `x` and `channels`.
    derivatives : {2, 1, 0}
        Highest time derivative of the motion that the run has: accelerations, rates, or poses
        alone, as where the engine comes to rest at every sample.
    """

    x: Array
    channels: dict[str, Array]
    missing: dict[str, str] = field(default_factory=dict)
    drive: tuple[Array, Array, Array] | None = None
    gap: float = 0.0
    seconds: float = 0.0
    steps: int = 0
    settings: dict[str, object] = field(default_factory=dict)
    stopped: str = ""
    derivatives: int = 2
