"""What the core asks of an engine, and what it gets back.

An engine is one object, an `Engine`, which another distribution can bring as an entry point of the
group ``proofmass.engines``.  `Engine.simulate` is all that it must have:

    simulate(model: Path, run: Run) -> Curves

An engine knows no reference and no tolerance.  It imports nothing of the core; `errors`, `files`,
`recorded`, `strict` and `units` lie below it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count, takewhile
from math import ceil
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from proofmass.analytic.controls import Law
from proofmass.analytic.numerics import Array

if TYPE_CHECKING:
    from mujoco import MjModel

BROKEN = set[str]()
"""Engines that cannot be called in this process any more; whoever keeps it has to start another."""

MOST_STEPS = 1e12  # from sample to sample: at 1 us a step, of the smallest models, 12 days


class AccuracyLimit(NamedTuple):
    """How far an engine may be off, as a share of the reference's range, and why.

    The `accuracy` of an engine has one for ``sweep`` (all channels), for ``rest`` (rates of a sweep
    where drives leave degrees of freedom), and for ``position``, ``velocity``, ``acceleration`` and
    ``force`` (channels of dynamics), as far as the engine states them.
    """

    relative_to_range: float
    why: str


class Unsupported(Exception):
    """The simulator cannot express something in the model; the message names it."""


class Diverged(Exception):
    """The run failed: not finite, reset by the engine, or the loops came open.

    A message that begins with ``NAME warning`` is what the engine itself said.  `curves` are those
    up to the last sample before the loss, where the engine has them.
    """

    def __init__(self, message: str = "", curves: "Curves | None" = None) -> None:
        super().__init__(message)
        self.curves = curves


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


StrictNumber = Annotated[float, Field(strict=True)]
Count = Annotated[int, Field(strict=True, ge=1, lt=2**31)]
Switch = Annotated[bool, Field(strict=True)]
StrictNumbers = Annotated[tuple[StrictNumber, ...], BeforeValidator(_spelled)]
FILE, BY_CHANNEL, BY_JOINT = "file", "by channel", "by joint"
"""Marks of settings: names of files from the sidecar's folder; tables by channel, by joint."""
FileName = Annotated[str, FILE]
"""A file.  A sidecar names it from its own folder; an engine is given the whole path."""


class EngineSettings(BaseModel):
    """What can be set in an engine, with types and ranges; each engine states its own.

    A setting that is the name of a file is a `FileName`.  A table whose keys are names of channels
    or of driven joints is annotated with `BY_CHANNEL` or `BY_JOINT`: the names are then checked.
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
            Unknown, of the wrong type, or out of range.
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
    law : callable
        ``law(x) -> (value, rate, acceleration)`` for arrays of x, in the joint's SI units.
        In a sweep x is the run's x; in dynamics it is time [s].
    """

    joint: str
    law: Law


@dataclass(frozen=True)
class ChangingLoad:
    """An actuator whose control changes along a run.

    Attributes
    ----------
    actuator : str
        Name in the MJCF, of a joint that is not driven, of a site or of a tendon; in a sweep that
        of a motor.
    law : callable
        ``law(x) -> (value, rate, acceleration)`` of its control, see `Drive`; the force of a motor
        is that times its gear and its gain.
    """

    actuator: str
    law: Law


@dataclass(frozen=True)
class Imposed:
    """How a written program imposes the motion of its drives.

    Attributes
    ----------
    kind : str
        A word of the engine's; see its `write_program`.
    gain : float
        How hard the drive holds its joint, in multiples of what the time step suggests [1]; 0
        where there is nothing to choose.
    """

    kind: str
    gain: float = 0.0


@dataclass(frozen=True)
class Rod:
    """An elastic rod on a site of the MJCF, bending in the model's plane, or in space.

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
        EI [N m^2]
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
    axial, shear : float, optional
        EA and GA [N]; None: it does not stretch, and its sections stay normal to it.
    load : tuple of three float
        Dead load per length in the axes of the world [N/m], such as wind.
    torsion : float, optional
        GJ [N m^2]; None: the rod does not leave the plane of its site's x and y axes.
    stiffness_y : float, optional
        EI of bending about the y axes of its sections [N m^2], in space; None: as about z.
    curvature : tuple of three float
        Twist, and curvatures about the y and z axes of its sections, without loads [1/m], in space.
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
        """Whether it may leave the plane of its site."""
        return self.torsion is not None


@dataclass(frozen=True)
class Run:
    """One thing to do with a model.

    Attributes
    ----------
    kind : {"sweep", "dynamics", "equilibrium", "passive"}
        Quasi-static poses, time stepping, or one pose at rest with the shapes of its rods.  A
        passive run steps a model that no sidecar speaks of, as the engine does by itself, from
        the key `start` or else its first one, and records all sensors.
    x : ndarray (n,)
        Where to sample; rising.  Time [s] in dynamics, arc length [m] of the rods in equilibrium.
    channels : tuple of str
        Sensors of the MJCF to record.  ``name`` for a scalar sensor, ``name.x``, ``.y``, ``.z``
        for a component of a vector, ``name.angle`` for the direction of a ``framexaxis`` sensor
        in the plane of motion, unwrapped along the run [rad].  In equilibrium also ``rod.x``,
        ``.y``, ``.z`` [m], ``.angle`` [rad] and ``.moment`` [N m] along a rod.
    drives : tuple of Drive
        Prescribed motions, at the same time; empty for a free motion.
    start : str
        Name of the ``<key>`` that holds the start pose (and the assembly mode).
    settings : mapping
        Engine settings that replace those of the model: ``timestep``, ``iterations``, ...
    rods : tuple of Rod
        What the model is completed with before it is compiled.
    inertia : bool
        Whether moments and forces of a sweep are those at the rates and accelerations of its
        drives, and not those at rest; those of dynamics are always.
    loads : tuple of ChangingLoad
        Actuators whose controls are not those of the key; an engine that cannot change them says
        so.
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
        rows = [np.broadcast_arrays(*load.law(x))[:2] for load in self.loads]
        value, rate = (
            np.array(part, float).reshape(len(rows), x.size)
            for part in (zip(*rows, strict=True) if rows else [()] * 2)
        )
        return value, rate

    def motion(self, x: Array) -> tuple[Array, Array, Array]:
        """Values, rates and accelerations of all drives at x, each (drives, n)."""
        rows = [np.broadcast_arrays(*drive.law(x)) for drive in self.drives]
        value, rate, acceleration = (
            np.array(part, float).reshape(len(rows), x.size)
            for part in (zip(*rows, strict=True) if rows else [()] * 3)
        )
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
            raise Unsupported("samples at uneven times in dynamics")
        width = float(self.x[-1] - self.x[0]) / (self.x.size - 1)
        if not (steps := width / float(timestep)) < MOST_STEPS:
            raise BadModel(
                f"{width:g} s from sample to sample are {steps:.3g} time steps of "
                f"{timestep:g} s; give a longer step or a shorter run"
            )
        count = whole_steps(width, float(timestep))
        return count, width / count


def whole_steps(width: float, longest: float) -> int:
    """The least number of equal steps over a width that are no longer than the longest.

    >>> whole_steps(1.0, 0.3), whole_steps(1.0, 0.1), whole_steps(1.0, 2.0)
    (4, 10, 1)
    """
    return max(1, ceil(width / longest - 1e-9))


def drive_columns(joint: str) -> tuple[str, str, str]:
    """Names in tables of what the drive of a joint did: value, rate and acceleration.

    >>> drive_columns("crank")
    ('crank drive', 'crank drive rate', 'crank drive acceleration')
    """
    return f"{joint} drive", f"{joint} drive rate", f"{joint} drive acceleration"


@dataclass(frozen=True)
class Curves:
    """Named curves on one rising parameter, and what they cost.

    Attributes
    ----------
    x : ndarray (n,)
        Time [s], drive value, or arc length [m] in equilibrium.
    channels : dict of str to ndarray (n,)
        The recorded curves [SI].
    missing : dict of str to str
        Channels that this simulator cannot deliver in this kind of run, with the reason.
    drive : tuple of three ndarray (drives, n), or None
        Value, rate and acceleration [rad or m, per s, per s^2] of the driven joints *as they
        actually moved*; rates and accelerations of a sweep are those of its law.  None of a driven
        run stands for what the laws ask for.
    violation : float
        Largest distance between two points that a loop should hold together [m].
    seconds : float
        Wall time of the run without loading the model [s].
    steps : int
        Engine steps (dynamics) or pose solutions (sweep).
    settings : dict
        Settings as used, for the record: time step, integrator, ...; none that has no effect.
    stopped : str
        Why a sweep ended before its last sample, at a limit position for one; what was solved
        until there is in `x` and `channels`.
    derivatives : {2, 1, 0}
        Highest time derivative of the motion that the run has: accelerations, rates, or poses
        alone, as where the engine comes to rest at every sample.
    violations : ndarray (n,), or None
        The constraint violation at each sample [m], of a run in time.
    uncertainty : dict of str to ndarray (n,)
        By channel, what its curve may be off by for a reason that is no error of what is judged,
        such as the interpolation of rows [SI]; nothing where it is left out.
    by_law : bool
        Whether `drive` is what the laws ask for, since the run tells of no drive of its own.
    notes : tuple of str
        What is to be said of the curves, a sentence each.
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
    by_law: bool = False
    notes: tuple[str, ...] = ()

    def first(self, count: int) -> "Curves":
        """The same up to a number of samples."""
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
        Its time step [s]; 0 of a way that chooses its steps by itself.
    seconds : float
        Processor time [s].
    points : ndarray (samples, bodies, points, 3)
        Of each body [m]; fewer samples where it ended early.
    energy, depth, gap : ndarray (samples,)
        Energy of the motion and of gravity and springs [J], the deepest penetration of a contact
        [m], and the largest opening of a loop [m, or rad of some].
    stopped, late : str, bool
        Why it ended early, and whether because its processor time was over.
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


@dataclass(frozen=True)
class OwnMotion:
    """The motion of a model that no sidecar speaks of, solved in several ways.

    Attributes
    ----------
    times : ndarray (samples,)
        [s]
    extent : float
        Size of the model [m].
    runs : tuple of OwnRun
        With the model's own settings: its step, half of it, a quarter of it, ..; the finer ones may
        have fewer samples.
    close, rough : OwnRun
        By an integrator that chooses its steps, with a narrow and with a wide allowance.
    compared : int
        Number of the run that the following one differs from by its start pose.
    disturbed : OwnRun
        With a start pose that differs by `disturbance`.
    others : tuple of OwnRun
        With other settings and the model's own step.
    stiffer : OwnRun or None
        As the run `compared`, with stiffer contacts, loops and limits; None where there are none.
    dof : int
        Degrees of freedom, without those that loops take away.
    disturbance : float
        Of the start pose, as a share of the size [1] and in rad.
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


ParameterValue = str | float | int | bool | tuple[float, ...]
"""A value of a setting."""
ParameterValues = Mapping[str, ParameterValue]
StepMap = Callable[[float, float], Array]
"""``map(z, zeta)``: the matrix (2, 2) that a step applies to (q, dt q') of a spring and a damper,
with z = dt omega."""
Stepping = Callable[[float], tuple[str, float, dict[str, ParameterValue], str]]
"""Of a value the text of an MJCF, the time step [s], settings, and the channel that is watched."""
STEP = "time step"
"""The cause of an error that a shorter step makes smaller."""


def leading(parameter: ParameterValue) -> float:
    """A value as a number, the first of several."""
    return float(parameter[0] if isinstance(parameter, tuple) else parameter)


@dataclass(frozen=True)
class Studied:
    """A dynamics run whose settings are studied.

    Attributes
    ----------
    model : MjModel
        The compiled MJCF.
    times : ndarray (n,)
        Where it is sampled [s].
    work : float
        Evaluations of forces [1] that the longest run of a scan may take.
    driven : bool
        Whether joints are driven.
    held_to_drive : bool
        Whether the reference is asked at the state that the drives really had.
    jolted : callable
        Tells whether the motion starts under gravity or in motion.
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
        """Steps [s] of which 1, 2, 4, .. lead from sample to sample.

        Each is half of the one before, so that a step's half and quarter, which tell an error
        floor, are steps of the same scan.  A step has so many `stages`, evaluations of forces.
        """
        most = max(1.0, self.work / stages / (self.times.size - 1))
        numbers = takewhile(lambda number: number <= most, (2**k for k in count()))
        return [float(self.times[1] - self.times[0]) / number for number in numbers]

    def quartered_step(self, stages: int = 1) -> float:
        """The shortest step, the model's own at least, whose quarter is among the `timesteps` [s].

        For a scan over something else, whose error floor half and a quarter of its step tell.
        """
        return max([self.own_step, *self.timesteps(stages)[-3:][:1]])


@dataclass(frozen=True)
class Scan:
    """Settings that differ in one of them, the `varied` one, from coarse to fine.

    Attributes
    ----------
    name : str
        Unlike that of any other scan of the engine.
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
    """Settings by their time step, for a search of the step that is just short enough.

    Attributes
    ----------
    name : str
    parameters : callable
        ``parameters(step)``: all settings but the step [s].
    plain : bool
        Whether these are the engine's own defaults.
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
        What is suspected, and how it is changed, in words.
    parameters : dict of str to ParameterValue
    better : bool or None
        Whether less error is expected; False where the cause can only be made worse, None if the
        error may go either way.
    whole : bool
        Whether the cause is taken away, and not only halved.
    """

    cause: str
    change: str
    parameters: dict[str, ParameterValue]
    better: bool | None = True
    whole: bool = False


@dataclass(frozen=True)
class Scheme:
    """One way in which an engine steps, and what theory says of it.

    Attributes
    ----------
    name : str
    step : callable
        Its `StepMap`.
    law : str
        What the largest stable dt omega follows from, in words.
    settings : dict of str to ParameterValue
        That select it.
    conserves : bool
        Whether the energy of a free motion stays, but for errors.
    half_kick : bool
        Whether a run from rest begins with the velocity of half a step.
    tried : mapping of str to tuple of float
        Test problems of ``proofmass stress`` that it is tried with, and their numbers [1]: damping
        ratios of ``spring`` and ``slide``, masses of a ``chain``, dt omega of ``swing`` and
        ``fade``, and for ``pendulum`` and ``whirl`` any one.
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
    """A test problem of an engine's own: one number is increased until its run fails.

    Attributes
    ----------
    what, setting, parameter, law : str
        The model, the scheme, what is increased, and what theory says, in words.
    stepped : callable
        Its `Stepping`.
    step, zeta : callable, float
        Whose limit theory gives, and its damping ratio [1]; or None, with the limit itself in
        `theory`.
    theory : float
        [SI]
    start, reach : float
        From where to where it is increased [SI].
    bound : float, optional
        Largest value of what is watched that is right [SI]; a run fails beyond 1, if none is
        given.
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


def left_to_sidecar(parameters: ParameterValues, but: Sequence[str] = ()) -> Iterator[str]:
    """What an engine has no words for, as what the sidecar must say."""
    for key in sorted(set(parameters) - {*but, "defaults"}):
        place = "every rod" if key == "segments" else "settings"
        yield f"{place} of the sidecar: {key} = {parameters[key]!r}"


class Engine:
    """All that the core asks of an engine; what a subclass leaves out has a default.

    Settings are given as `ParameterValues`, by their names in `settings`.

    Attributes
    ----------
    title : str
        Name in a sentence; that of the class, if not given.
    packages : tuple of str
        Distributions that compute its results beside NumPy, SciPy and MuJoCo.
    settings : type of EngineSettings
        What can be set, with types, ranges and the engine's own defaults.
    chooses : tuple of str
        Settings that it chooses or fits itself where they are not given, and reports.
    native : bool
        Whether it compiles the MJCF itself: what cannot be compiled is then refused by it.
    computes : bool
        Whether it computes its curves from the model.  An engine that does not, but has them from
        elsewhere, is no solver unless a sidecar names it, and studies leave it out.
    planar : bool
        Whether it moves bodies in the plane of a mechanism only.  It is then no solver of a motion
        in space, unless a sidecar names it.
    imposed : sequence of Imposed
        How its programs can move drives, the ideal way first.
    schemes : tuple of Scheme
        Ways in which it steps, whose stability theory knows.
    sizes : mapping of str to callable
        What errors should fall with, by setting, as a function of its value: a step or time
        constant [s], or a share.
    labels : mapping of str to str
        What `size` is called on the axis of a figure, by setting, where it is not the setting.
    accuracy : mapping of str to AccuracyLimit
        How far it may be off a driven linkage, of a case that states no tolerance.
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
    sizes: Mapping[str, Callable[[ParameterValue], float]] = {"timestep": leading}
    labels: Mapping[str, str] = {}
    accuracy: Mapping[str, AccuracyLimit] = {}

    def __init_subclass__(cls) -> None:
        if "title" not in vars(cls):
            cls.title = cls.__name__

    def simulate(self, model: Path, run: Run) -> Curves:
        """Run the model of an MJCF file.

        Raises
        ------
        BadModel, Unsupported, Diverged
            Whatever else it raises counts as a crash of that run, but for an
            `proofmass.errors.InputError`, which names a file of its own that is at fault.
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

        For about so long [s], with so many samples, in about so many `seconds` of processor time.
        With `drives` and `loads` it is the motion that these prescribe.

        Raises
        ------
        BadModel, Unsupported
        """
        raise Unsupported(f"{self.title} solves no model's own equations in several ways")

    def solve_closely(self, model: Path, run: Run) -> Curves:
        """Do a motion without time steps, as closely as can be.

        Raises
        ------
        BadModel, Unsupported, NotSolved
        """
        raise Unsupported(f"{self.title} has no motion without time steps")

    def check_settings(self, settings: Mapping[str, object]) -> None:
        """Raise `BadSetting` if the engine cannot be set so.

        A file that a setting names, whose path is whole here, may be read; `InputError` says what
        is wrong in it.
        """
        self.settings.read(settings)

    def is_default(self, parameters: ParameterValues) -> bool:
        """Whether nothing but the time step differs from what the engine has by itself."""
        fields = self.settings.model_fields
        return bool(parameters.get("defaults")) and all(
            value == fields[name].default
            for name, value in parameters.items()
            if name in fields and name not in ("timestep", "defaults")
        )

    def size(self, varied: str, value: ParameterValue) -> float:
        """What errors should fall with along a scan: as in `sizes`, or one over the value."""
        return self.sizes[varied](value) if varied in self.sizes else 1.0 / leading(value)

    def at_step(self, parameters: ParameterValues, step: float) -> dict[str, ParameterValue]:
        """Settings with another time step [s], and with what is to go with it."""
        return {**parameters, "timestep": step}

    def scans(self, about: Studied) -> Iterator[Scan]:
        """The settings worth scanning in dynamics; the time step, if it can be set."""
        if "timestep" in self.settings.model_fields:
            yield scan_over({}, self.title, "timestep", about.timesteps())

    def orders(self, scan: Scan, derivative: int, about: Studied) -> tuple[float, ...]:
        """Orders that the errors of a scan may show; nothing where theory promises none.

        `derivative` is 0 for errors of positions, 1 of rates and energies, 2 of accelerations and
        forces.
        """
        return ()

    def perturbations(
        self, parameters: ParameterValues, about: Studied, scaled: bool
    ) -> Iterator[Perturbation]:
        """Settings in which one possible cause of an error is changed, for each cause.

        `scaled` tells whether loops get harder with the step in the scan that the settings are of.
        """
        if "timestep" in self.settings.model_fields:
            step = leading(parameters.get("timestep", about.own_step))
            yield Perturbation(STEP, "halving the step", {**parameters, "timestep": step / 2})

    def recipes(self, about: Studied) -> Iterator[Recipe]:
        """What is searched for the cheapest setting that is good enough."""
        if "timestep" in self.settings.model_fields:
            plain: dict[str, ParameterValue] = (
                {"defaults": True} if ("defaults" in self.settings.model_fields) else {}
            )
            yield Recipe(
                f"{self.title}, defaults" if plain else self.title, lambda step: plain, bool(plain)
            )

    def snippet(self, parameters: ParameterValues, steps: int, model: Path | None = None) -> str:
        """What to paste so that the engine runs with settings, for so many steps."""
        return "\n".join(f"# {line}" for line in left_to_sidecar(parameters))

    def holding(
        self, model: Path, parameters: ParameterValues, slower: float
    ) -> dict[str, ParameterValue] | None:
        """Settings with which what friction holds creeps so many times slower; None if none do."""
        return None

    def comment(self, text: str) -> str:
        """Text as a comment before a snippet."""
        return indent(text, "# ")

    def pasted(
        self, model: Path, parameters: ParameterValues, steps: int
    ) -> tuple[str, set[str]] | None:
        """The text of an MJCF with a snippet in it, and the settings that it says.

        None where a snippet is no part of an MJCF.
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

        `controls` is the source of ``controls(t)``, those of the run's loads, and given if there
        are any.

        Raises
        ------
        Unsupported
            It cannot be written; says why.
        """
        raise Unsupported(f"{self.title} has no programs")

    def scheme_of(self, parameters: ParameterValues, model: "MjModel") -> Scheme | None:
        """The scheme that a single coordinate is stepped with; None where none is known."""
        return None

    def limit_problems(self) -> Iterator[LimitProblem]:
        """Test problems of the engine's own."""
        yield from ()
