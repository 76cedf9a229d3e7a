"""The interface between the core and an engine.

An engine is one object, an `Engine`, which another distribution can provide as an entry point of
the group ``proofmass.engines``.  Only the method `Engine.simulate` is required:

    simulate(model: Path, run: Run) -> Curves

An engine has no access to references and tolerances.  It imports nothing of the core; `errors`,
`files`, `recorded`, `strict` and `units` are below it and may be imported.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count, takewhile
from math import ceil, isnan, nan
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from proofmass.analytic.controls import MotionProfile
from proofmass.base.arrays import Array
from proofmass.base.strict import Count as Count
from proofmass.base.strict import StrictNumber as StrictNumber
from proofmass.base.strict import Switch as Switch

if TYPE_CHECKING:
    from mujoco import MjModel

    from proofmass.analytic.support import Support

STEP_ROUNDING = 1e-9
"""Deviation from a whole number of steps that is rounding of the times [steps]."""
MIN_STEP_SHARE = 0.9
"""Least share of the time step of a model or of its settings that a run may step with, where its
samples are no whole number of steps apart: an error of second order is then smaller by a fifth at
most, and the least step at which a motion is unstable is exceeded by a tenth at most."""
MAX_STEPS = 1e12  # steps from sample to sample; at 1 us a step, of the smallest models, 12 days


class AccuracyLimit(NamedTuple):
    """Expected largest error of an engine, as a share of the reference's range [1], and its reason.

    The `accuracy` of an engine may have one for ``sweep`` (all channels), for ``rest`` (rates of a
    sweep where drives leave degrees of freedom), and for each of ``position``, ``velocity``,
    ``acceleration`` and ``force`` (channels of dynamics).
    """

    relative_to_range: float
    why: str


class Unsupported(Exception):
    """The simulator cannot express something in the model; the message names it."""


class Diverged(Exception):
    """The run failed: a value is not finite, the engine reset the state, or the loops opened.

    A message that begins with ``NAME warning`` is the engine's own.  `curves` are the curves up to
    the last sample before the failure, if the engine has them.
    """

    def __init__(self, message: str = "", curves: "Curves | None" = None) -> None:
        super().__init__(message)
        self.curves = curves


class NotSolved(Diverged):
    """The engine found no equilibrium or motion within its limits of steps, iterations or time."""


class BadModel(Exception):
    """The model cannot be used: it is unreadable, not assembled, or lacks an element."""


class BadRod(BadModel):
    """A rod cannot be built; the arguments are its name, the key that is wrong, and the reason."""

    def __str__(self) -> str:
        return "rod {!r}: {}: {}".format(*self.args)


class BadSetting(BadModel):
    """An engine does not accept a setting; the arguments are its name and what is wrong."""

    def __str__(self) -> str:
        return "setting {}: {}".format(*self.args)


def _parse_numbers(value: Any) -> Any:
    """A text of several numbers, as in an attribute of MJCF, ``"0.002 1"``, as a tuple."""
    if not isinstance(value, str):
        return value
    try:
        return tuple(map(float, value.split()))
    except ValueError:
        raise ValueError(f"{value!r} is no list of numbers") from None


StrictNumbers = Annotated[tuple[StrictNumber, ...], BeforeValidator(_parse_numbers)]
FILE_MARK, BY_CHANNEL, BY_JOINT = "file", "by channel", "by joint"
"""Marks of settings: names of files; tables by channel; tables by joint."""
FileName = Annotated[str, FILE_MARK]
"""Name of a file, in a sidecar relative to its folder; an engine is given the absolute path."""


class EngineSettings(BaseModel):
    """The settings of an engine, with types and ranges; each engine has its own subclass.

    A setting that is the name of a file is a `FileName`.  A table whose keys are names of channels
    or of driven joints is annotated with `BY_CHANNEL` or `BY_JOINT`, so that the names are checked.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def marked(cls, mark: str) -> list[str]:
        """The settings that are annotated with a mark."""
        return [name for name, field in cls.model_fields.items() if mark in field.metadata]

    @classmethod
    def read(cls, settings: Mapping[str, Any]) -> Self:
        """Check settings.

        Raises
        ------
        BadSetting
            A setting is unknown, of the wrong type, or out of range.
        """
        for key in settings:
            if key not in cls.model_fields:
                raise BadSetting(
                    key, f"unknown setting {key!r}; known: {', '.join(cls.model_fields)}"
                )
        try:
            return cls(**settings)
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(takewhile(lambda part: isinstance(part, str), first["loc"]))  # type: ignore
            if first["type"] == "missing":
                raise BadSetting(key, "missing; it is required") from None
            wrong = first["msg"].removeprefix("Value error, ")
            instead = "" if isinstance(first["input"], dict) else f", not {first['input']!r}"
            raise BadSetting(key, f"{wrong}{instead}") from None


@dataclass(frozen=True)
class Drive:
    """A prescribed joint motion.

    Attributes
    ----------
    joint : str
        Name of the driven joint in the MJCF.
    profile : callable
        The motion profile: ``profile(x) -> (value, rate, acceleration)`` for arrays of x, in the
        joint's SI units.  In a sweep x is the run's x; in dynamics it is time [s].
    """

    joint: str
    profile: MotionProfile


@dataclass(frozen=True)
class ChangingLoad:
    """An actuator whose control changes along a run.

    Attributes
    ----------
    actuator : str
        Its name in the MJCF.  It acts on a joint that is not driven, at a site or on a tendon; in
        a sweep it is a motor.
    profile : callable
        ``profile(x) -> (value, rate, acceleration)`` of its control, see `Drive`.  The force of a
        motor is the control times its gear and its gain.
    """

    actuator: str
    profile: MotionProfile


@dataclass(frozen=True)
class Imposed:
    """How a written program imposes the motion of its drives.

    Attributes
    ----------
    kind : str
        A word that the engine defines; see its `write_program`.
    gain : float
        Stiffness of the drive relative to the value that the time step suggests [1]; 0 if there is
        no choice.
    """

    kind: str
    gain: float = 0.0


@dataclass(frozen=True)
class Rod:
    """An elastic rod on a site of the MJCF, bending in the model's plane, or in space.

    Attributes
    ----------
    name : str
        Name of the rod; its bodies, joints and sites are ``name.1``, ``name.2``, ...
    start : str
        Site where it begins, with its tangent along the site's x axis; it bends about the z axis.
    end : str, optional
        Site, of another body or of another rod, that constrains its far end.
    length : float
        [m]
    stiffness : float
        EI [N m^2]
    segments : int
        Number n >= 2 of segments of h = length / n.
    ends : tuple of two str
        ``clamped`` or ``pinned`` at the start; ``pinned``, ``clamped`` or ``free`` at the far end.
    scheme : {"half", "double", "naive"}
        Positions of its springs; see `proofmass.sim.rods`.
    mass : float, optional
        Mass of the whole rod [kg]; without gravity it has no effect in statics.
    turn : float
        Rotation of its tangent from end to end in the start pose [rad].
    axial, shear : float, optional
        EA and GA [N]; None: the rod does not stretch, and its sections stay normal to it.
    load : tuple of three float
        Dead load per length in the axes of the world [N/m], such as wind.
    torsion : float, optional
        GJ [N m^2]; None: the rod does not leave the plane of its site's x and y axes.
    stiffness_y : float, optional
        In space, EI of bending about the y axes of its sections [N m^2]; None: as about z.
    curvature : tuple of three float
        In space, natural twist, and natural curvatures about the y and z axes of its sections
        [1/m].
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
    axial: float | None = None
    shear: float | None = None
    load: tuple[float, float, float] = (0.0, 0.0, 0.0)
    torsion: float | None = None
    stiffness_y: float | None = None
    curvature: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def spatial(self) -> bool:
        """Whether the rod may leave the plane of its site."""
        return self.torsion is not None


@dataclass(frozen=True)
class Run:
    """A run: what an engine is to do with a model.

    Attributes
    ----------
    kind : {"sweep", "dynamics", "equilibrium", "passive"}
        Quasi-static poses, time stepping, or one static equilibrium with the shapes of its rods.  A
        passive run steps a model without a sidecar, with the engine's own initial state from the
        key `start`, or from the first key if there is none of that name, and records all sensors.
    x : ndarray (n,)
        Samples, in rising order: time [s] in dynamics, arc length [m] of the rods in equilibrium.
    channels : tuple of str
        Sensors of the MJCF to record.  ``name`` for a scalar sensor, ``name.x``, ``.y``, ``.z``
        for a component of a vector, ``name.angle`` for the direction of a ``framexaxis`` sensor
        in the plane of motion, unwrapped along the run [rad].  In equilibrium also ``rod.x``,
        ``.y``, ``.z`` [m], ``.angle`` [rad] and ``.moment`` [N m] along a rod.
    drives : tuple of Drive
        Prescribed motions, all at the same time; empty for a free motion.
    start : str
        Name of the ``<key>`` with the start pose, which determines the assembly mode.
    settings : mapping
        Engine settings that replace those of the model: ``timestep``, ``iterations``, ...
    rods : tuple of Rod
        Rods with which the model is completed before it is compiled.
    inertia : bool
        Whether moments and forces of a sweep include the inertia forces at the rates and
        accelerations of its drives; those of dynamics always do.
    loads : tuple of ChangingLoad
        Actuators whose controls change, in place of the controls of the key; an engine that cannot
        change them raises `Unsupported`.
    """

    kind: str
    x: Array
    channels: tuple[str, ...]
    drives: tuple[Drive, ...] = ()
    start: str = "start"
    settings: Mapping[str, object] = field(default_factory=dict)
    rods: tuple[Rod, ...] = ()
    inertia: bool = False
    loads: tuple[ChangingLoad, ...] = ()

    def controls(self, x: Array) -> tuple[Array, Array]:
        """Controls of all loads that change and their rates at x, each (loads, n)."""
        value, rate, _ = evaluate_profiles(self.loads, x)
        return value, rate

    def motion(self, x: Array) -> tuple[Array, Array, Array]:
        """Values, rates and accelerations of all drives at x, each (drives, n)."""
        return evaluate_profiles(self.drives, x)

    def steps(self, timestep: float) -> tuple[int, float]:
        """Number of steps from sample to sample, and the step [s] <= `timestep` that fits it.

        Raises
        ------
        Unsupported
            The samples are not evenly spaced.
        BadModel
            There are more than `MAX_STEPS` steps from sample to sample.
        """
        spacing = np.diff(self.x)
        if np.ptp(spacing) > 1e-9 * spacing.mean():
            raise Unsupported("samples at uneven times in dynamics")
        width = float(self.x[-1] - self.x[0]) / (self.x.size - 1)
        if not (steps := width / float(timestep)) < MAX_STEPS:
            raise BadModel(
                f"{width:g} s from sample to sample are {steps:.3g} time steps of "
                f"{timestep:g} s; give a longer step or a shorter run"
            )
        count = whole_steps(width, float(timestep))
        return count, width / count


def fitting_samples(duration: float, timestep: float, samples: int) -> int:
    """A number of samples, not less than `samples` if steps allow it, that whole steps lead to.

    The steps are as long as `timestep` if they fit into the duration, and otherwise hardly shorter.

    >>> fitting_samples(1.0, 0.02, 361), fitting_samples(1.0, 0.002, 361)
    (51, 501)
    >>> fitting_samples(1.0, 0.0002, 361), fitting_samples(6.283, 0.001, 361)
    (501, 371)
    """
    steps = whole_steps(duration, timestep)
    most = max(1, steps // (samples - 1))
    per_sample = next((k for k in range(most, most // 2, -1) if steps % k == 0), most)
    return ceil(steps / per_sample) + 1


def evaluate_profiles(
    parts: Sequence[Drive | ChangingLoad], x: Array
) -> tuple[Array, Array, Array]:
    """Values, rates and accelerations of all profiles at x, each (parts, n)."""
    rows = [np.broadcast_arrays(*one.profile(x)) for one in parts]
    value, rate, acceleration = (
        np.array(part, float).reshape(len(rows), x.size)
        for part in (zip(*rows, strict=True) if rows else [()] * 3)
    )
    return value, rate, acceleration


def whole_steps(width: float, longest: float) -> int:
    """The least number of equal steps over a width that are no longer than the longest.

    >>> whole_steps(1.0, 0.3), whole_steps(1.0, 0.1), whole_steps(1.0, 2.0)
    (4, 10, 1)
    """
    return max(1, ceil(width / longest - STEP_ROUNDING))


def split_channel(channel: str, names: Collection[str]) -> tuple[str, str]:
    """Split a channel into a sensor or rod of one of `names`, which may have dots, and its part.

    >>> split_channel("tip.x", ["tip"]), split_channel("tip.pos.x", ["tip", "tip.pos"])
    (('tip', 'x'), ('tip.pos', 'x'))
    >>> split_channel("tip.x", ["tip", "tip.x"])
    ('tip.x', '')
    """
    if channel in names:
        return channel, ""
    name, _, part = channel.rpartition(".")
    if name not in names:
        name, _, part = channel.partition(".")
    return name, part


def drive_columns(joint: str) -> tuple[str, str, str]:
    """Names of table columns with value, rate and acceleration of a joint's drive.

    >>> drive_columns("crank")
    ('crank drive', 'crank drive rate', 'crank drive acceleration')
    """
    return f"{joint} drive", f"{joint} drive rate", f"{joint} drive acceleration"


@dataclass(frozen=True)
class Curves:
    """Named curves over one rising parameter, and the cost of their computation.

    Attributes
    ----------
    x : ndarray (n,)
        Time [s], drive value, or arc length [m] in equilibrium.
    channels : dict of str to ndarray (n,)
        The recorded curves [SI].
    missing : dict of str to str
        Channels that this simulator cannot deliver in this kind of run, with the reason.
    drive : tuple of three ndarray (drives, n), or None
        Value, rate and acceleration [rad or m, per s, per s^2] of the *actual* motion of the driven
        joints; rates and accelerations of a sweep are those of its motion profile.  None in a
        driven run stands for the motion profiles.
    violation : float
        Largest constraint violation: distance between two points that a loop joins [m].
    seconds : float
        Processor time of the run without loading the model [s].
    steps : int
        Engine steps (dynamics) or pose solutions (sweep).
    settings : dict
        Settings that were used and had an effect: time step, integrator, ...
    stopped : str
        Why a sweep ended before its last sample, for example at a limit position; `x` and
        `channels` then have the samples before the end.
    derivatives : {2, 1, 0}
        Highest time derivative of the motion that the run has: 2 accelerations, 1 rates, 0 poses
        alone, as in a sweep in which the engine steps to rest at every sample.
    violations : ndarray (n,), or None
        The constraint violation at each sample [m] of a run in time.
    uncertainty : dict of str to ndarray (n,)
        By channel, the possible error of its curve from a cause that is no fault of the judged
        party, such as the interpolation of rows [SI]; zero for channels that are left out.
    by_profile : bool
        Whether `drive` is that of the motion profiles, since the run has no record of its drives.
    notes : tuple of str
        Remarks on the curves, a sentence each.
    asked_step : float
        Time step that the model or its settings ask for [s]; the step that was made is
        ``settings["timestep"]``.  NaN in runs without time steps.
    work : float
        Processor time that the steps of the run count [s]: their number times a time that the
        engine computes from the sizes of the model and the settings.  It is the same on every
        machine, so that it decides which of two settings is cheaper; NaN if the engine does not
        count it.
    """

    x: Array
    channels: dict[str, Array]
    missing: dict[str, str] = field(default_factory=dict)
    drive: tuple[Array, Array, Array] | None = None
    violation: float = 0.0
    seconds: float = 0.0
    steps: int = 0
    settings: dict[str, object] = field(default_factory=dict)
    stopped: str = ""
    derivatives: int = 2
    violations: Array | None = None
    uncertainty: dict[str, Array] = field(default_factory=dict)
    by_profile: bool = False
    notes: tuple[str, ...] = ()
    asked_step: float = float("nan")
    work: float = nan

    @property
    def made_step(self) -> float:
        """The time step that was made [s]; NaN in runs without time steps."""
        made = self.settings.get("timestep")
        return made if isinstance(made, float) else float("nan")

    @property
    def has_other_step(self) -> bool:
        """Whether the time step was another one than the model or its settings ask for."""
        return self.made_step < MIN_STEP_SHARE * self.asked_step

    @property
    def cost(self) -> float:
        """The counted processor time, or the measured one if none is counted [s]."""
        return self.seconds if isnan(self.work) else self.work

    def first(self, count: int) -> "Curves":
        """The curves at the first `count` samples."""
        value, rate, acceleration = self.drive or 3 * (np.empty((0, 0)),)
        return replace(
            self,
            x=self.x[:count],
            channels={name: curve[:count] for name, curve in self.channels.items()},
            drive=self.drive and (value[:, :count], rate[:, :count], acceleration[:, :count]),
            violations=None if self.violations is None else self.violations[:count],
            uncertainty={name: size[:count] for name, size in self.uncertainty.items()},
        )


@dataclass(frozen=True)
class OwnRun:
    """One way to solve the motion of a model by itself.

    Attributes
    ----------
    name : str
        Such as ``Euler, 2 ms``.
    step : float
        Time step [s]; 0 if the steps are chosen by an error tolerance.
    seconds : float
        Processor time [s].
    points : ndarray (samples, bodies, points, 3)
        Points of each body [m]; fewer samples if the run ended early.
    energy, depth, gap : ndarray (samples,)
        Kinetic energy and potential energy of gravity and springs [J], the deepest penetration of a
        contact [m], and the largest constraint violation of a loop [m or rad].
    stopped, late : str, bool
        Why the run ended early, and whether its processor time was over.
    work : float
        Processor time that the run's steps and evaluations count, the same on every machine [s];
        NaN if the engine does not count it.
    """

    name: str
    step: float
    seconds: float
    points: Array
    energy: Array
    depth: Array
    gap: Array
    stopped: str = ""
    late: bool = False
    work: float = nan

    @property
    def cost(self) -> float:
        """The counted processor time, or the measured one if none is counted [s]."""
        return self.seconds if isnan(self.work) else self.work


@dataclass(frozen=True)
class OwnMotion:
    """The motion of a model without a sidecar, solved in several ways.

    Attributes
    ----------
    times : ndarray (samples,)
        [s]
    extent : float
        Size of the model [m].
    runs : tuple of OwnRun
        Runs with the model's own settings and its step, half of it, a quarter of it, ..; those with
        finer steps may have fewer samples.
    close, rough : OwnRun
        Runs by an integrator that chooses its steps, with a narrow and with a wide tolerance.
    compared : int
        Number of the run in `runs` with which `disturbed` and `stiffer` are compared.
    disturbed : OwnRun
        Run with a start pose that differs by `disturbance`.
    others : tuple of OwnRun
        Runs with other settings and the model's own step.
    stiffer : OwnRun or None
        Run with stiffer contacts, loops and limits; None if there are none.
    dof : int
        Degrees of freedom of the model without its loops.
    disturbance : float
        Change of the start pose, as a share of the size [1] and in rad.
    notes : tuple of str
        Warnings of the engine, a sentence each.
    """

    times: Array
    extent: float
    runs: tuple[OwnRun, ...]
    close: OwnRun
    rough: OwnRun
    compared: int
    disturbed: OwnRun
    others: tuple[OwnRun, ...]
    stiffer: OwnRun | None
    dof: int
    disturbance: float = 1e-9
    notes: tuple[str, ...] = ()


ParameterValue = str | float | int | bool | tuple[float, ...]
"""A value of a setting."""
ParameterValues = Mapping[str, ParameterValue]
StepMap = Callable[[float, float], Array]
"""``map(z, zeta)``: the matrix (2, 2) that a step applies to (q, dt q') of a spring and a damper,
with z = dt omega."""
Stepping = Callable[[float], tuple[str, float, dict[str, ParameterValue], str]]
"""For a value: text of an MJCF, time step [s], settings, and the channel that is watched."""
STEP_CAUSE = "time step"
"""Name of the cause of an error that a shorter step makes smaller."""


def first_number(parameter: ParameterValue) -> float:
    """A value as a number; of several numbers the first."""
    return float(parameter[0] if isinstance(parameter, tuple) else parameter)


@dataclass(frozen=True)
class Studied:
    """A dynamics run whose settings are studied.

    Attributes
    ----------
    model : MjModel
        The compiled MJCF.
    times : ndarray (n,)
        Times of the samples [s].
    work : float
        Largest number of evaluations of forces in a run of a scan [1].
    driven : bool
        Whether joints are driven.
    held_to_drive : bool
        Whether the reference is evaluated at the actual state of the drives.
    jolted : callable
        Whether the motion starts under gravity or with rates other than zero; computed when called.
    controlled : bool
        Whether controls of actuators change in time.
    """

    model: "MjModel"
    times: Array
    work: float
    driven: bool
    held_to_drive: bool
    jolted: Callable[[], bool]
    controlled: bool = False

    @property
    def own_step(self) -> float:
        """Time step of the model [s]."""
        return float(self.model.opt.timestep)

    def timesteps(self, stages: int = 1) -> list[float]:
        """Time steps [s] of which 1, 2, 4, .. lead from sample to sample.

        Each is half of the one before, so that half and a quarter of a step, from which an error
        floor is recognized, are steps of the same scan.  `stages` is the number of evaluations of
        forces in a step.
        """
        most = max(1.0, self.work / stages / (self.times.size - 1))
        numbers = takewhile(lambda number: number <= most, (2**k for k in count()))
        return [float(self.times[1] - self.times[0]) / number for number in numbers]

    def quartered_step(self, stages: int = 1) -> float:
        """The shortest step [s] whose quarter is among `timesteps`, but at least the model's own.

        It is for scans over another setting, whose error floor is recognized from half and a
        quarter of the step.
        """
        return max([self.own_step, *self.timesteps(stages)[-3:][:1]])


@dataclass(frozen=True)
class Scan:
    """Settings that differ in one of them, the `varied` one, from coarse to fine.

    Attributes
    ----------
    name : str
        A name that no other scan of the engine has.
    varied : str
    settings : tuple of dict
    """

    name: str
    varied: str
    settings: tuple[dict[str, ParameterValue], ...]


def scan_over(
    base: ParameterValues, name: str, varied: str, values: Sequence[ParameterValue]
) -> Scan:
    """A scan over one of the settings."""
    return Scan(name, varied, tuple({**base, varied: value} for value in values))


@dataclass(frozen=True)
class Recipe:
    """Settings as a function of the time step, for the search of the longest sufficient step.

    Attributes
    ----------
    name : str
    parameters : callable
        ``parameters(step)`` gives all settings but the step itself [s].
    plain : bool
        Whether these settings are the engine's own defaults.
    """

    name: str
    parameters: Callable[[float], dict[str, ParameterValue]]
    plain: bool = False


@dataclass(frozen=True)
class Perturbation:
    """Settings in which one possible cause of an error is changed, and nothing else.

    Attributes
    ----------
    cause, change : str
        The suspected cause, and how it is changed, in words.
    parameters : dict of str to ParameterValue
    better : bool or None
        Whether a smaller error is expected; False if the cause can only be increased, None if the
        error may change either way.
    whole : bool
        Whether the cause is removed completely, and not only halved.
    """

    cause: str
    change: str
    parameters: dict[str, ParameterValue]
    better: bool | None = True
    whole: bool = False


@dataclass(frozen=True)
class Scheme:
    """A time-stepping scheme of an engine, with the properties that theory gives.

    Attributes
    ----------
    name : str
    step : callable
        Its `StepMap`.
    law : str
        The formula of the largest stable dt omega, in words.
    settings : dict of str to ParameterValue
        Settings that select the scheme.
    conserves : bool
        Whether the energy of a free motion is conserved, except for errors.
    half_kick : bool
        Whether a run from rest begins with the velocity of half a step.
    tried : mapping of str to tuple of float
        Test problems of ``proofmass stress`` for the scheme, and their numbers [1]: damping ratios
        of ``spring`` and ``slide``, numbers of masses of a ``chain``, dt omega of ``swing`` and
        ``fade``; for ``pendulum`` and ``whirl`` the number has no meaning.
    """

    name: str
    step: StepMap
    law: str
    settings: dict[str, ParameterValue] = field(default_factory=dict)
    conserves: bool = True
    half_kick: bool = False
    tried: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class LimitProblem:
    """A test problem of an engine: one parameter is increased until the run fails.

    Attributes
    ----------
    what, setting, parameter, law : str
        The model, the scheme, the parameter that is increased, and the limit of theory, in words.
    stepped : callable
        Its `Stepping`.
    step, zeta : callable, float
        The `StepMap` from which the limit of theory follows, and the damping ratio [1]; if `step`
        is None the limit is `theory`.
    theory : float
        Limit of the parameter [SI].
    start, reach : float
        First and last value of the parameter [SI].
    bound : float, optional
        Largest correct value of the watched channel [SI]; if none is given, a run fails beyond 1.
    """

    what: str
    setting: str
    parameter: str
    law: str
    stepped: Stepping
    step: StepMap | None = None
    zeta: float = 0.0
    theory: float = float("nan")
    start: float = 0.1
    reach: float = 1e3
    bound: float | None = None


def sidecar_instructions(parameters: ParameterValues, but: Sequence[str] = ()) -> Iterator[str]:
    """Settings, except those named in `but`, as sentences that tell what the sidecar must state."""
    for key in sorted(set(parameters) - {*but, "defaults"}):
        place = "every rod" if key == "segments" else "settings"
        yield f"{place} of the sidecar: {key} = {parameters[key]!r}"


class Engine:
    """An engine as the core uses it; attributes and methods that a subclass omits have defaults.

    Settings are given as `ParameterValues`, by their names in `settings`.

    Attributes
    ----------
    title : str
        Name in a sentence; the name of the class, if not given.
    packages : tuple of str
        Distributions that compute its results in addition to NumPy, SciPy and MuJoCo.
    settings : type of EngineSettings
        The settings, with types, ranges and the engine's own defaults.
    chooses : tuple of str
        Settings that the engine itself chooses or fits if they are not given, and reports.
    native : bool
        Whether the engine compiles the MJCF itself and refuses files that do not compile.
    computes : bool
        Whether the engine computes its curves from the model.  An engine that has them from
        elsewhere is a solver only if a sidecar names it, and studies leave it out.
    planar : bool
        Whether the engine moves bodies only in the plane of a mechanism.  It is then a solver of a
        motion in space only if a sidecar names it.
    imposed : sequence of Imposed
        Ways in which its programs can impose a motion, the ideal way first.
    schemes : tuple of Scheme
        Its time-stepping schemes whose stability is known from theory.
    sizes : mapping of str to callable
        By setting, the quantity with which errors should fall, as a function of the setting's
        value: a step or time constant [s], or a share.
    labels : mapping of str to str
        By setting, name of that quantity on the axis of a figure, if it is not the setting.
    accuracy : mapping of str to AccuracyLimit
        Accuracy that is expected for a driven linkage, for cases that state no tolerance.
    support : mapping
        What becomes of each feature of a model in its runs, see `proofmass.analytic.support`;
        empty if the engine does not state it.
    """

    title = ""
    packages: tuple[str, ...] = ()
    settings: type[EngineSettings] = EngineSettings
    chooses: tuple[str, ...] = ("timestep",)
    native = False
    computes = True
    planar = False
    imposed: Sequence[Imposed] = (Imposed("ideal drive"),)
    schemes: tuple[Scheme, ...] = ()
    sizes: Mapping[str, Callable[[ParameterValue], float]] = {"timestep": first_number}
    labels: Mapping[str, str] = {}
    accuracy: Mapping[str, AccuracyLimit] = {}
    support: ClassVar["Support"] = {}

    def __init_subclass__(cls) -> None:
        if "title" not in vars(cls):
            cls.title = cls.__name__

    def simulate(self, model: Path, run: Run) -> Curves:
        """Run the model of an MJCF file.

        Raises
        ------
        BadModel, Unsupported, Diverged
            Any other exception counts as a crash of the run, except
            `proofmass.base.errors.InputError`, which names a faulty file of the engine.
        """
        raise NotImplementedError

    def own_motion(
        self,
        model: Path,
        until: float,
        samples: int,
        seconds: float,
        start: str = "start",
        drives: tuple[Drive, ...] = (),
        loads: tuple[ChangingLoad, ...] = (),
    ) -> OwnMotion:
        """Solve the motion of a model by itself in several ways, from its key `start` or its first.

        The motion lasts about `until` [s], with about `samples` samples, and is solved in about
        `seconds` of counted processor time.  `drives` and `loads` prescribe parts of it, if given.

        Raises
        ------
        BadModel, Unsupported
        """
        raise Unsupported(f"{self.title} solves no model's own equations in several ways")

    def solve_closely(self, model: Path, run: Run) -> Curves:
        """Solve a motion without fixed time steps, as accurately as possible.

        Raises
        ------
        BadModel, Unsupported, NotSolved
        """
        raise Unsupported(f"{self.title} has no motion without time steps")

    def check_settings(self, settings: Mapping[str, object]) -> None:
        """Raise `BadSetting` if the engine does not accept the settings.

        A file that a setting names, here with its absolute path, may be read; an `InputError` then
        says what is wrong in it.
        """
        self.settings.read(settings)

    def is_default(self, parameters: ParameterValues) -> bool:
        """Whether the settings differ from the engine's own defaults in the time step at most."""
        fields = self.settings.model_fields
        return bool(parameters.get("defaults")) and all(
            value == fields[name].default
            for name, value in parameters.items()
            if name in fields and name not in ("timestep", "defaults")
        )

    def size(self, varied: str, value: ParameterValue) -> float:
        """Quantity with which errors should fall along a scan: from `sizes`, or 1 / value."""
        return self.sizes[varied](value) if varied in self.sizes else 1.0 / first_number(value)

    def at_step(self, parameters: ParameterValues, step: float) -> dict[str, ParameterValue]:
        """Settings with another time step [s], and other settings adapted to it."""
        return {**parameters, "timestep": step}

    def scans(self, about: Studied) -> Iterator[Scan]:
        """Scans of settings in dynamics; by default one over the time step, if it can be set."""
        if "timestep" in self.settings.model_fields:
            yield scan_over({}, self.title, "timestep", about.timesteps())

    def orders(self, scan: Scan, derivative: int, about: Studied) -> tuple[float, ...]:
        """Orders of convergence that errors of a scan may show; empty if theory gives none.

        `derivative` is 0 for errors of positions, 1 of rates and energies, 2 of accelerations and
        forces.
        """
        return ()

    def perturbations(
        self, parameters: ParameterValues, about: Studied, scaled: bool
    ) -> Iterator[Perturbation]:
        """Settings in which one possible cause of an error is changed, for each cause.

        `scaled` states whether the settings are of a scan in which loops get harder with the step.
        """
        if "timestep" in self.settings.model_fields:
            step = first_number(parameters.get("timestep", about.own_step))
            yield Perturbation(STEP_CAUSE, "halving the step", {**parameters, "timestep": step / 2})

    def recipes(self, about: Studied) -> Iterator[Recipe]:
        """Recipes among which the cheapest sufficient setting is searched."""
        if "timestep" in self.settings.model_fields:
            plain: dict[str, ParameterValue] = (
                {"defaults": True} if ("defaults" in self.settings.model_fields) else {}
            )
            yield Recipe(
                f"{self.title}, defaults" if plain else self.title, lambda step: plain, bool(plain)
            )

    def snippet(self, parameters: ParameterValues, steps: int, model: Path | None = None) -> str:
        """Text to paste so that the engine runs with these settings, for so many steps."""
        return "\n".join(f"# {line}" for line in sidecar_instructions(parameters))

    def holding(
        self, model: Path, parameters: ParameterValues, slower: float
    ) -> dict[str, ParameterValue] | None:
        """Settings with which creep under friction is `slower` times slower; None if impossible."""
        return None

    def comment(self, text: str) -> str:
        """Text as a comment before a snippet."""
        return indent(text, "# ")

    def pasted(
        self, model: Path, parameters: ParameterValues, steps: int
    ) -> tuple[str, set[str]] | None:
        """The text of an MJCF with a snippet in it, and the names of the settings that it states.

        The result is None if the engine's snippets are no part of an MJCF.
        """
        return None

    def write_program(
        self,
        model: Path,
        run: Run,
        motion: str,
        head: str,
        drive: Imposed,
        controls: str = "",
    ) -> str:
        """A dynamics run as a program that needs the engine only.

        `controls` is the source of ``controls(t)``, the controls of the run's loads, if it has any.

        Raises
        ------
        Unsupported
            The program cannot be written; the message says why.
        """
        raise Unsupported(f"{self.title} has no programs")

    def scheme_of(self, parameters: ParameterValues, model: "MjModel") -> Scheme | None:
        """The scheme with which a single coordinate is stepped; None if none is known."""
        return None

    def limit_problems(self) -> Iterator[LimitProblem]:
        """The engine's own test problems."""
        yield from ()
