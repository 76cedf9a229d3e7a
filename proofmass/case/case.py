"""A case and all tables of its sidecar.

The sidecar has what MJCF cannot state: the reference, the quantity that each sensor must equal, the
tolerance and its reason.  Unknown keys are errors.

A view is a figure of curves over any channel or quantity.  The x of a run must rise, that of a view
need not: it may show a closed loop over a channel.  A chart is a figure that the reference computes
apart from the runs, such as all equilibria.

``[refine]`` repeats a run with its rods in more and more segments.  An error e of order p falls by
r^p when a rod is divided into r times as many segments, n2 = r n1.  Then two runs give the limit of
many segments (Richardson), except for terms of higher order:

    p = log(e1 / e2) / log r          v = v2 + (v2 - v1) / (r^p - 1)
"""

import atexit
import shutil
from collections.abc import Mapping
from fnmatch import fnmatchcase
from functools import cache
from hashlib import sha256
from itertools import pairwise
from math import gcd
from pathlib import Path
from tempfile import mkdtemp
from typing import Annotated, Any, Literal, cast, get_args

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    field_validator,
    model_validator,
)

from proofmass.base.display import ShownAsHtml
from proofmass.base.errors import InputError, model_error, suggest_names
from proofmass.base.files import readable
from proofmass.base.recorded import RecordedColumn, RecordingTable
from proofmass.base.strict import Kind, Strict, StrictNumber, Switch, WholeNumber
from proofmass.base.units import si_unit
from proofmass.base.worker import DEFAULT_MEMORY
from proofmass.case.inputs import is_program, is_recorded
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Rod


@cache
def made_models_folder() -> Path:
    """A folder for models that this process makes; it is removed when the process ends."""
    folder = mkdtemp(prefix="proofmass-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def require_unit(unit: str) -> str:
    """The unit itself; ValueError if there is no such unit."""
    si_unit(unit)
    return unit


def one_or_more(kind: Any) -> BeforeValidator:
    """Validator of a key that may have a single entry instead of a list."""
    return BeforeValidator(
        lambda value: (value,) if isinstance(value, str | dict) else value,
        json_schema_input_type=kind | tuple[kind, ...],
    )


Names = Annotated[tuple[str, ...], one_or_more(str)]


Rows = Annotated[tuple[StrictNumber, ...], Field(min_length=2)]
"""Numbers in a sidecar instead of a column of a file [SI]."""


def column_type(column: Any) -> str:
    """The tag of the type in which a column is given."""
    return "rows" if isinstance(column, list | tuple) else RecordedColumn.__name__


Column = Annotated[
    Annotated[Rows, Tag("rows")] | Annotated[RecordedColumn, Tag(RecordedColumn.__name__)],
    Discriminator(column_type),
]


class ProfileTable(Strict):
    """``profile = { file = .. }``: a drive that follows the rows of a CSV file.

    Given is either its `value`, or its `rate`, which is integrated from the drive's ``from`` on.
    `time` is the first column if it is left out.  A column is a name, or a table, see
    `proofmass.base.recorded.RecordedColumn`.  Without a `file` the columns are lists of numbers
    [SI]. The path of the file is relative to the sidecar.
    """

    file: str | None = None
    time: Column | None = None
    value: Column | None = None
    rate: Column | None = None
    interpolation: Literal["spline", "linear", "held"] = "spline"

    @model_validator(mode="after")
    def _one_of_two(self) -> "ProfileTable":
        if (self.value is None) == (self.rate is None):
            raise ValueError("give either value or rate: the column that the drive follows")
        kind, column = self.given
        if self.file is not None:
            for key, one in (("time", self.time), (kind, column)):
                if isinstance(one, tuple):
                    raise ValueError(f"{key} is a list, which goes without a file; name a column")
            return self
        if not isinstance(column, tuple):
            raise ValueError(f"file is missing, that has the column; or give {kind} as a list")
        if not isinstance(self.time, tuple):
            raise ValueError(f"time is missing: a list of as many times [s] as {kind} has numbers")
        if len(self.time) != len(column):
            raise ValueError(
                f"time has {len(self.time)} numbers, and {kind} has {len(column)}; give a {kind} "
                f"for each time"
            )
        for k, (before, after) in enumerate(pairwise(self.time), 1):
            if not after > before:
                raise ValueError(
                    f"time does not rise ({before:.6g} then {after:.6g}, numbers {k} and {k + 1})"
                )
        return self

    @property
    def given(self) -> tuple[str, RecordedColumn | tuple[float, ...]]:
        """The quantity that is given, ``value`` or ``rate``, and its column."""
        if self.value is not None:
            return "value", self.value
        return "rate", cast(RecordedColumn | tuple[float, ...], self.rate)

    @property
    def words(self) -> str:
        """A description of the column that the profile follows."""
        kind, column = self.given
        if isinstance(column, tuple):
            return f"{kind} in a table of {len(column)} rows"
        return f"{kind} {column.column} of {self.file}"

    def with_file(self, file: str) -> "ProfileTable":
        """The same table with another file."""
        return self.model_copy(update={"file": file})


def coordinate_type(coordinate: Any) -> str:
    """The tag of the type in which a coordinate of a path is given."""
    return RecordedColumn.__name__ if isinstance(coordinate, str | dict | Strict) else "number"


Coordinate = Annotated[
    Annotated[StrictNumber, Tag("number")]
    | Annotated[RecordedColumn, Tag(RecordedColumn.__name__)],
    Discriminator(coordinate_type),
]
"""A column of a path's file, or a number that the coordinate has throughout [m or rad]."""


class PathTable(Strict):
    """``profile = { path = .. }``: all drives lead an end point or a platform along rows of a CSV.

    The reference solves the inverse problem, see `proofmass.analytic.inverse`. `time` is the first
    column if that is a time; without it the rows are at even times up to the drive's ``until``.
    `x`, `y` and `phi` are columns, by default those with these names, or numbers [m, rad].  The
    path of the file is relative to the sidecar.
    """

    path: str
    time: RecordedColumn | None = None
    x: Coordinate | None = None
    y: Coordinate | None = None
    phi: Coordinate | None = None

    @property
    def file(self) -> str:
        """The name of the file."""
        return self.path

    def with_file(self, file: str) -> "PathTable":
        """The same table with another file."""
        return self.model_copy(update={"path": file})


def profile_type(profile: Any) -> str:
    """The tag of the type in which a profile is given."""
    if isinstance(profile, PathTable) or (isinstance(profile, dict) and "path" in profile):
        return PathTable.__name__
    if isinstance(profile, dict | ProfileTable):
        return ProfileTable.__name__
    return "str" if isinstance(profile, str) else "tuple"


Profile = Annotated[
    Annotated[str, Tag("str")]
    | Annotated[tuple[str, str, str], Tag("tuple")]
    | Annotated[ProfileTable, Tag(ProfileTable.__name__)]
    | Annotated[PathTable, Tag(PathTable.__name__)],
    Discriminator(profile_type),
]


class DriveTable(Strict):
    """``[drive]``, or one of several ``[[drive]]``: a joint that is moved, and how.

    The first drive has one of: ``from``, ``to`` and ``rate`` (constant speed); ``from``, ``to`` and
    ``period`` (a swing to and fro); ``profile`` with ``until``, a function of the reference's
    module; ``profile`` as three columns of a recorded reference (value, rate, acceleration), or as
    a table that names a file, see `ProfileTable`, or a path of all drives, see `PathTable`.
    Another drive with ``from`` and ``to`` moves in proportion to the first drive's progress (`to`
    may equal `from`: it does not move); one with only a joint takes its row of the first drive's
    profile.
    """

    joint: str
    start: StrictNumber = Field(0.0, alias="from")
    to: StrictNumber | None = None
    rate: StrictNumber | None = None
    period: StrictNumber | None = Field(None, gt=0)
    profile: Profile | None = None
    until: StrictNumber | None = Field(None, gt=0)
    parameters: dict[str, StrictNumber] = Field({})

    @field_validator("profile", mode="before")
    @classmethod
    def _named(cls, profile: Any) -> Any:
        columns = isinstance(profile, list | tuple) and [type(c) for c in profile] == [str] * 3
        tables = str | dict | ProfileTable | PathTable
        known = profile is None or columns or isinstance(profile, tables)
        if not known:
            raise ValueError(
                f"{profile!r} is neither the name of a function of the reference's module "
                f"nor three columns of a recorded curve, [value, rate, acceleration], nor a table "
                f'with a file, {{ file = "motor.csv", rate = "omega2" }}, or with a path, '
                f'{{ path = "line.csv" }}'
            )
        return profile

    @field_validator("profile")
    @classmethod
    def _moves(cls, profile: Any) -> Any:
        if not isinstance(profile, ProfileTable):
            return profile
        if profile.interpolation == "held":
            raise ValueError(
                "interpolation = 'held' goes with the value of a load: no drive jumps from row to "
                "row; leave it out"
            )
        if profile.value is not None and profile.interpolation == "linear":
            raise ValueError(
                "interpolation = 'linear' goes with rate: a value that is straight between rows "
                "has a rate that jumps at each of them; leave it out"
            )
        return profile

    @property
    def steady(self) -> bool:
        """Whether the drive has constant speed, so that a sweep can be sampled by its value."""
        return self.to is not None and self.period is None

    @property
    def way(self) -> float:
        """Distance from `start` to `to`, with its sign [rad or m]; 0 for a profile."""
        return 0.0 if self.to is None else self.to - self.start

    def check_leader(self) -> None:
        """Raise ValueError unless this table fully defines the motion of its joint."""
        if (self.to is None) == (self.profile is None):
            raise ValueError("give either from, to and rate, or from, to and period, or profile")
        if self.rate is not None and not self.steady:
            raise ValueError("rate goes with from and to alone")
        if isinstance(self.profile, str) and self.until is None:
            raise ValueError("a profile needs until = the last time [s]")
        if self.to == self.start:
            raise ValueError("to must differ from 'from'")
        if isinstance(self.profile, PathTable) and self.start:
            raise ValueError("from goes with to or with a rate; a path has a start")
        followed = isinstance(self.profile, ProfileTable) and self.profile.given[0]
        if followed == "value" and self.start:
            raise ValueError("from goes with the rate of a profile; its value has a start")
        if self.steady and not self.way * self.speed > 0:
            raise ValueError("rate must be non-zero and lead from 'from' to 'to'")

    def check_follower(self) -> None:
        """Raise ValueError if this table has a key that only the first drive may have."""
        for key in ("rate", "period", "until"):
            if getattr(self, key) is not None:
                raise ValueError(f"{key} belongs to the first drive, which leads")
        if isinstance(self.profile, PathTable):
            raise ValueError(
                "path belongs to the first drive, and moves all drives; leave out this profile"
            )

    @property
    def speed(self) -> float:
        """Rate of a steady drive [rad/s or m/s]; 1 if the sidecar gives none."""
        return 1.0 if self.rate is None else self.rate


class LoadTable(Strict):
    """``[load]``, or one of several ``[[load]]``: an actuator whose control changes along a run.

    Either the control goes from ``from`` to `to`, in proportion to the first drive's progress or,
    if that drive follows a `profile`, in proportion to time.  Or the control is the value of a
    `profile` of rows over time.  `scales` are parameters of the reference that are multiplied by
    the control.
    """

    actuator: str
    start: StrictNumber = Field(0.0, alias="from")
    to: StrictNumber | None = None
    profile: ProfileTable | None = None
    scales: Names = ()

    @model_validator(mode="after")
    def _one_of_two(self) -> "LoadTable":
        if (self.to is None) == (self.profile is None):
            raise ValueError("give either from and to, or profile")
        if self.profile is not None and self.profile.given[0] == "rate":
            raise ValueError("the profile of a load has a value, its control, and no rate")
        if self.profile is not None and self.start:
            raise ValueError("from goes with to; a profile has a start")
        return self


MOST_SAMPLES = 10**8
"""Largest number of samples of a run: one curve then takes 0.8 GB, and a run has dozens."""


class RunTable(Strict):
    """``[run.sweep]``, ``[run.dynamics]`` or ``[run.equilibrium]``: samples and solvers.

    `until` is the last time [s], or in equilibrium the last arc length [m], by default that of the
    shortest rod.  `timeout` [s of processor time] and `memory` [GiB] are the limits of the run, its
    model and its reference.  With `inertia`, moments and forces of a sweep include those of the
    rates and accelerations of its drives; without, they are those at rest.
    `proofmass.run.sidecar.fill_defaults` fills in the samples and solvers that a sidecar leaves
    out.
    """

    n: WholeNumber | None = Field(None, ge=2, le=MOST_SAMPLES)
    until: StrictNumber | None = Field(None, gt=0)
    solvers: tuple[str, ...] = Field(min_length=1)
    timeout: StrictNumber = Field(120.0, gt=0)
    memory: StrictNumber = Field(DEFAULT_MEMORY, gt=0)
    inertia: Switch = False

    @property
    def engines(self) -> tuple[str, ...]:
        """Names of the engines of its solvers, each once."""
        return tuple(dict.fromkeys(solver.partition(":")[0] for solver in self.solvers))


class Channel(Strict):
    """``[channels]``: sensor = scale * quantity + shift, in `unit`.

    `equals` names a quantity of the reference, or is a number that the curve must have throughout.
    `unit` is any unit of the sensor's quantity; sensor and reference are converted from SI to it.
    `shift`, and `equals` if it is a number, are in that unit; `scale` has no unit.
    """

    equals: str | StrictNumber
    unit: str
    scale: StrictNumber = 1.0
    shift: StrictNumber = 0.0
    only: Kind | None = None

    @field_validator("unit")
    @classmethod
    def _known_unit(cls, unit: str) -> str:
        return require_unit(unit)

    @property
    def si_unit(self) -> str:
        """The SI unit of the same quantity, in which simulators and references deliver it."""
        return si_unit(self.unit)[0]

    @property
    def factor(self) -> float:
        """The factor that converts a number in `unit` to SI."""
        return si_unit(self.unit)[1]


MAX_TOLERANCE_SHARE = 0.5
"""Largest tolerance, as a share of a curve's range: the error of a curve that stays in the middle
of the range."""


def refuse_loose_share(share: float) -> float:
    """The share itself; ValueError if a curve that does not move would pass."""
    if share > MAX_TOLERANCE_SHARE:
        raise ValueError(
            f"{share:g} of the range lets a curve pass that does not move; allow at most "
            f"{MAX_TOLERANCE_SHARE:g}"
        )
    return share


RangeShare = Annotated[StrictNumber, Field(gt=0), AfterValidator(refuse_loose_share)]
"""A tolerance as a share of the range of a curve."""


Fitted = Literal["zero", "lag"]
"""What may be fitted to a measured curve: its zero, and the time by which it begins late."""


def sigma_type(sigma: Any) -> str:
    """The tag of the type in which the noise is given."""
    return "str" if isinstance(sigma, str) else "number"


Sigma = Annotated[
    Annotated[Literal["estimated"], Tag("str")]
    | Annotated[StrictNumber, Field(gt=0), Tag("number")],
    Discriminator(sigma_type),
]


class Tolerance(Strict):
    """``[[tolerance]]``: a number, where it holds, and the reason for it.

    `run`, `solver`, `unit` and `channels` select where it holds; a missing key selects all.
    The number is `abs`, in the channel's unit; or `relative_to_range`, a share of the reference
    curve's range, or of its size if the curve is constant, see
    `proofmass.verdict.compare.MechanismSizes`; or `sigma`, the standard deviation of the noise of a
    measured curve, in the channel's unit, see `proofmass.verdict.noise`, with what is fitted to it.
    """

    run: Kind | None = None
    solver: Names = ("*",)
    unit: Names = ("*",)
    channels: Names = ("*",)
    abs: StrictNumber | None = Field(None, gt=0)
    relative_to_range: RangeShare | None = None
    sigma: Sigma | None = None
    fit: Annotated[tuple[Fitted, ...], one_or_more(Fitted)] = ()
    why: str

    @model_validator(mode="after")
    def _complete(self) -> "Tolerance":
        if sum(one is not None for one in (self.abs, self.relative_to_range, self.sigma)) != 1:
            raise ValueError(
                "give one of abs (in the channel's unit), relative_to_range, and sigma (the noise "
                "of a measured curve, in the channel's unit)"
            )
        if self.fit and self.sigma is None:
            raise ValueError("fit goes with sigma, the noise of a measured curve; leave it out")
        if len(set(self.fit)) < len(self.fit):
            raise ValueError("fit has a name twice")
        if not self.why.strip():
            raise ValueError("why is empty; a tolerance needs its reason")
        return self

    def is_for(self, run: str, solver: str) -> bool:
        """Whether this tolerance may cover channels of a solver in a run."""
        return self.run in (None, run) and any(fnmatchcase(solver, s) for s in self.solver)

    def covers(self, run: str, solver: str, name: str, unit: str) -> bool:
        """Whether this tolerance covers a channel of a solver in a run."""
        return (
            self.is_for(run, solver)
            and ("*" in self.unit or unit in self.unit)
            and any(fnmatchcase(name, c) for c in self.channels)
        )

    @property
    def noise(self) -> float | None:
        """The stated standard deviation of noise [unit of the curve]; None if it is estimated."""
        return None if isinstance(self.sigma, str) else self.sigma

    def allowed(self, scale: float) -> float:
        """The largest allowed error of a curve of range or size `scale`, in the curve's unit.

        That of a curve with noise also depends on the number of its rows, see
        `proofmass.verdict.measured.allowed_noise`.
        """
        return self.abs if self.abs is not None else float(self.relative_to_range or 0) * scale


class View(Strict):
    """``[[view]]``: a figure of the report.

    Names are channels, driven joints, or quantities of the reference.  Each name in `y` has a panel
    with the reference and every solver.  `stack` adds quantities of the reference up as areas, with
    their sum as a line.  `dashed` are drawn together with `y`, such as a target.  `marks` are
    values of x by what happens there, or a function of the reference's module that computes them
    from its parameters.  `unit` and `x_unit` are those of names that are not channels; without
    them such names, and marks, are in SI.
    """

    title: str = Field(min_length=1)
    x: str
    y: Names = ()
    stack: Names = ()
    dashed: Names = ()
    marks: str | dict[str, StrictNumber] = Field({})
    unit: str | None = None
    x_unit: str | None = None
    run: Kind | None = None

    @field_validator("unit", "x_unit")
    @classmethod
    def _known_unit(cls, unit: str | None) -> str | None:
        return None if unit is None else require_unit(unit)

    @model_validator(mode="after")
    def _one_kind(self) -> "View":
        if bool(self.y) == bool(self.stack):
            raise ValueError("give either y or stack")
        if self.dashed and len(self.y) != 1:
            raise ValueError("dashed goes with one y")
        return self


class ChartTable(Strict):
    """``[[chart]]``: a figure of the report that the reference's module computes.

    `draw` is a function of the module that returns a `proofmass.analytic.chart.Chart`.  It gets
    those of the case's parameters that it takes by name; `parameters` are added or replace them.
    """

    title: str = Field(min_length=1)
    draw: str
    parameters: dict[str, StrictNumber | WholeNumber | str | tuple[StrictNumber, ...]] = Field({})


class Beside(Strict):
    """``[compare_with.NAME]``: another set of parameters, drawn as a thin line in every view."""

    parameters: dict[str, StrictNumber | str]


MOST_SEGMENTS = 10**5
"""Largest number of segments of a rod: an engine's square matrix of that size takes 80 GB."""
Segments = Annotated[WholeNumber, Field(le=MOST_SEGMENTS)]
MOST_SHAPE_ANGLES = 1000
"""Largest number of angles of a rod's shape: a spline through more takes longer than the run."""


class RodTable(Strict):
    """``[rod.NAME]``: the supports of a rod, its stiffnesses, and its division into links.

    The rod begins at the site `from`, its tangent along that site's x axis, and bends about the
    z axis.  The site `to` of another body, or ``OTHER.tip`` of a rod before it, supports its far
    end; without `to` the far end is free.  `turn` is the angle by which the tangent turns from end
    to end in the start pose, an arc [rad]: it chooses one of several equilibria.  `shape` does so
    in its place, with the angles from the beginning to the ends of as many equal parts.  Sensors on
    the sites ``NAME.middle`` and ``NAME.tip`` stay in place for any number of `segments`.  `mass`
    is needed where gravity acts.  Without `axial`, EA [N], the rod does not stretch; without
    `shear`, GA [N], its sections stay normal to its axis.  `load` is a dead load per length in the
    axes of the world [N/m], and `couple` a dead moment per length about the z axis of the site
    where it begins [N].  The third number of `curvature` is the curvature without loads [1/m].

    With `torsion`, GJ [N m2], the rod leaves the plane: it also bends about the y axes of its
    sections, against `stiffness_y`, and twists.  The first two numbers of `curvature` are then its
    twist and its curvature about y without loads [1/m].
    """

    start: str = Field(alias="from")
    to: str | None = None
    length: StrictNumber = Field(gt=0)
    stiffness: StrictNumber = Field(gt=0)
    segments: Segments = Field(20, ge=2)
    ends: tuple[Literal["clamped", "pinned"], Literal["clamped", "pinned", "free"]] = (
        "clamped",
        "pinned",
    )
    scheme: Literal["half", "double", "naive"] = "half"
    mass: StrictNumber | None = Field(None, gt=0)
    turn: StrictNumber = 0.0
    shape: Annotated[tuple[StrictNumber, ...], Field(max_length=MOST_SHAPE_ANGLES)] = ()
    axial: StrictNumber | None = Field(None, gt=0)
    shear: StrictNumber | None = Field(None, gt=0)
    load: tuple[StrictNumber, StrictNumber, StrictNumber] = (0.0, 0.0, 0.0)
    couple: StrictNumber = 0.0
    torsion: StrictNumber | None = Field(None, gt=0)
    stiffness_y: StrictNumber | None = Field(None, gt=0)
    curvature: tuple[StrictNumber, StrictNumber, StrictNumber] = (0.0, 0.0, 0.0)

    @model_validator(mode="before")
    @classmethod
    def _loose(cls, table: Any) -> Any:
        if isinstance(table, dict) and "to" not in table:
            return {"ends": ("clamped", "free"), **table}
        return table

    @model_validator(mode="after")
    def _held(self) -> "RodTable":
        if (self.to is None) != (self.ends[1] == "free"):
            raise ValueError(
                f"its far end is {self.ends[1]}: "
                + ("give to = the site that holds it" if self.to is None else "leave out to")
            )
        if self.ends[1] == "clamped" and self.scheme != "half":
            raise ValueError(f"scheme {self.scheme!r} has no clamp at the far end; use half")
        if self.ends == ("pinned", "free"):
            raise ValueError("a rod that is pinned here and free there swings; clamp it")
        return self

    @model_validator(mode="after")
    def _spatial(self) -> "RodTable":
        if self.torsion is None:
            for key, said in (
                ("stiffness_y", self.stiffness_y is not None),
                ("curvature[0] or [1]", any(self.curvature[:2])),
            ):
                if said:
                    raise ValueError(f"{key} is of a rod in space: give torsion = GJ [N m2] too")
        elif self.ends != ("clamped", "free") or self.scheme != "half":
            raise ValueError(
                "torsion is of a rod in space, which is clamped here and free there, with the "
                "scheme half"
            )
        elif self.couple or self.shape:
            key = "couple" if self.couple else "shape"
            raise ValueError(f"{key} is of a rod in the plane, without torsion")
        if self.turn and self.shape:
            raise ValueError("turn and shape are both given; the shape includes the turn")
        return self

    def built(self, name: str) -> Rod:
        """The rod that a simulator is asked to build."""
        values = dict(self)
        return Rod(name, end=values.pop("to"), **values)


class Refine(Strict):
    """``[refine]``: one `run` repeated with every rod in each number of `segments` in turn.

    The largest error of each of the `channels` must fall with `order`, from each number of segments
    to the next, up to a deviation `within`. An equilibrium is sampled at points that are ends of
    links for every number of segments, since the error between the ends of a link varies. Errors up
    to `error_floor`, in the channel's unit, are due to rounding and to the reference, and show no
    order. `richardson` is the allowed error of the limits of positions at the last sample [m];
    `between` are the two numbers of segments that the limits are computed from, by default the last
    two.
    """

    segments: tuple[Segments, ...] = Field(min_length=2)
    run: Kind = "equilibrium"
    channels: Names = ("*",)
    order: StrictNumber = Field(gt=0)
    within: StrictNumber = Field(gt=0)
    error_floor: StrictNumber = Field(1e-9, gt=0)
    richardson: StrictNumber | None = Field(None, gt=0)
    between: tuple[WholeNumber, WholeNumber] | None = None
    why: str

    @model_validator(mode="after")
    def _rising(self) -> "Refine":
        if self.segments[0] < 2 or any(a >= b for a, b in pairwise(self.segments)):
            raise ValueError(f"segments = {list(self.segments)} must rise, from 2 or more")
        if self.between not in (None, *pairwise(self.segments)):
            raise ValueError(f"between = {list(self.between or ())} must be neighbours in segments")
        if self.between and self.richardson is None:
            raise ValueError("between goes with richardson = what the limit may be off by")
        if not self.why.strip():
            raise ValueError("why is empty; an order needs its reason")
        return self

    def covers(self, channel: str) -> bool:
        """Whether the order of a channel's error is checked."""
        return any(fnmatchcase(channel, pattern) for pattern in self.channels)

    def sampled(self, run: RunTable) -> RunTable:
        """The run with samples at points that are ends of links for all numbers of segments."""
        if self.run != "equilibrium":
            return run
        return run.model_copy(update={"n": gcd(*self.segments) + 1, "until": None})

    @property
    def last(self) -> tuple[int, int]:
        """The two numbers of segments from which the limit is computed."""
        return self.between or (self.segments[-2], self.segments[-1])


class Case(Strict, ShownAsHtml):
    """One sidecar.  `file` is its path; the other fields are its tables, but for the last four.

    `unchecked` says that on purpose nothing of the case is checked.  `unmatched` are sensors that
    are not listed and match no quantity.  `called` is the name of the case if other cases have the
    name of its file.  `reads_model` says that the reference reads its numbers from the MJCF, whose
    errors it then shares.  `asked` are engines that a command asks for, in place of the solvers of
    the sidecar: what they cannot run is no fault of the sidecar.
    """

    fields_without_key = frozenset({"file", "unmatched", "called", "reads_model", "asked"})

    file: Path
    title: str
    source: str
    model: str
    start: str = "start"
    reference: str
    parameters: dict[str, StrictNumber | str] = Field({})
    recording: RecordingTable | None = None
    drive: Annotated[tuple[DriveTable, ...], one_or_more(DriveTable)] = ()
    load: Annotated[tuple[LoadTable, ...], one_or_more(LoadTable)] = ()
    rod: dict[str, RodTable] = Field({})
    run: dict[Kind, RunTable] = Field(min_length=1)
    settings: dict[str, dict[str, Any]] = Field({})
    channels: dict[str, Channel] = Field(min_length=1)
    tolerance: tuple[Tolerance, ...] = ()
    view: Annotated[tuple[View, ...], one_or_more(View)] = ()
    chart: Annotated[tuple[ChartTable, ...], one_or_more(ChartTable)] = ()
    compare_with: dict[str, Beside] = Field({})
    refine: Refine | None = None
    unchecked: Switch = False
    unmatched: tuple[str, ...] = ()
    called: str = ""
    reads_model: bool = False
    asked: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The sidecar's file name without its ending, unless `called` replaces it."""
        return self.called or readable(self.file.stem)

    @property
    def model_path(self) -> Path:
        """The MJCF file."""
        return self.file.parent / self.model

    @property
    def program(self) -> bool:
        """Whether the reference is a program beside the sidecar."""
        return is_program(self.reference)

    @property
    def recorded(self) -> bool:
        """Whether the reference is a recorded curve."""
        return is_recorded(self.reference)

    @property
    def sampled_profiles(self) -> tuple[tuple[str, ProfileTable | PathTable], ...]:
        """The profiles of drives and loads that are given by rows, with their keys."""
        drives = [(self.drive_key(k, "profile"), one.profile) for k, one in enumerate(self.drive)]
        loads = [(self.load_key(k, "profile"), one.profile) for k, one in enumerate(self.load)]
        tables = ProfileTable | PathTable
        return tuple((key, one) for key, one in (*drives, *loads) if isinstance(one, tables))

    @property
    def path_table(self) -> PathTable | None:
        """The path along which the drives lead an end point or a platform; None without one."""
        leader = self.leader
        return leader.profile if leader and isinstance(leader.profile, PathTable) else None

    @property
    def profile_files(self) -> tuple[Path, ...]:
        """The files of the profiles of drives and loads."""
        files = [profile.file for _, profile in self.sampled_profiles]
        return tuple(self.file.parent / file for file in files if file is not None)

    def error(self, key: str, wrong: str) -> InputError:
        """Return the error that says what is wrong at a key of the sidecar."""
        return InputError(self.file, key, wrong)

    def require_model(self) -> None:
        """Raise InputError if the MJCF file does not exist."""
        if not self.model_path.is_file():
            raise self.error("model", f"no file {self.model!r} beside the sidecar")

    @property
    def rods(self) -> tuple[Rod, ...]:
        """The rods that are added to the model."""
        return tuple(table.built(name) for name, table in self.rod.items())

    @property
    def constant_channels(self) -> tuple[str, ...]:
        """The channels that must equal a number, independently of the reference."""
        return tuple(n for n, c in self.channels.items() if not isinstance(c.equals, str))

    @property
    def leader(self) -> DriveTable | None:
        """The first drive; None for a free motion."""
        return self.drive[0] if self.drive else None

    def drive_key(self, k: int, *keys: str) -> str:
        """The key of the sidecar for drive number k, or for a key of that drive."""
        return self.table_key("drive", k, *keys)

    def load_key(self, k: int, *keys: str) -> str:
        """The key of the sidecar for load number k, or for a key of that load."""
        return self.table_key("load", k, *keys)

    def table_key(self, name: str, k: int, *keys: str) -> str:
        """The key for table number k of a list, which has no number if it is the only one."""
        return ".".join([name, *[str(k)] * (len(getattr(self, name)) > 1), *keys])

    @field_validator("run", mode="before")
    @classmethod
    def _kinds(cls, runs: Any) -> Any:
        for kind in runs if isinstance(runs, dict) else ():
            if kind not in get_args(Kind):
                raise ValueError(
                    f"unknown run {kind!r}; {suggest_names(str(kind), get_args(Kind))}"
                )
        return runs

    @field_validator("drive")
    @classmethod
    def _led(cls, drives: tuple[DriveTable, ...]) -> tuple[DriveTable, ...]:
        for k, drive in enumerate(drives):
            drive.check_follower() if k else drive.check_leader()
            if drive.joint in [d.joint for d in drives[:k]]:
                raise ValueError(f"joint {drive.joint!r} is driven twice")
            if k and drive.to is not None and drives[0].to is None:
                raise ValueError(
                    f"joint {drive.joint!r} has from and to, but the first drive has "
                    f"none to be in proportion with; leave them out or give a profile"
                )
            alone = k and drive.to is None and drive.profile is None
            if alone and drives[0].to is not None:
                raise ValueError(f"joint {drive.joint!r} needs from and to")
            if alone and not isinstance(drives[0].profile, str | PathTable):
                raise ValueError(
                    f"joint {drive.joint!r} needs profile = [value, rate, acceleration], "
                    f"three columns of its own"
                )
        return drives

    @model_validator(mode="after")
    def _carrying(self) -> "Case":
        for k, load in enumerate(self.load):
            if load.actuator in [one.actuator for one in self.load[:k]]:
                raise ValueError(f"load: actuator {load.actuator!r} stands there twice")
            for name in load.scales:
                if name in [n for one in self.load[:k] for n in one.scales]:
                    raise ValueError(f"load: two loads scale the parameter {name!r}")
            if load.scales and self.recorded:
                raise ValueError(
                    f"{self.load_key(k, 'scales')}: leave it out; a recorded curve has no "
                    f"parameters"
                )
            if load.to is not None and not self.drive:
                raise ValueError(
                    f"{self.load_key(k, 'to')}: from and to follow the first drive, and there is "
                    f"none; give a profile over time"
                )
        if self.load and "equilibrium" in self.run:
            raise ValueError(
                "run.equilibrium: nothing changes in an equilibrium, and so no load; leave out "
                "this run, or make it a case of its own with a constant ctrl in the key of the "
                "model and no [load]"
            )
        return self

    @model_validator(mode="after")
    def _consistent(self) -> "Case":
        if "sweep" in self.run and not self.drive:
            raise ValueError("run.sweep needs a [drive]: the joint that is moved")
        if "equilibrium" in self.run:
            self._restful()
        if self.recorded and not (self.file.parent / self.reference).is_file():
            raise ValueError(
                f"reference: no such recorded curve: there is no file "
                f"{self.reference!r} beside the sidecar"
            )
        if self.recording and not self.recorded:
            raise ValueError(
                "recording says how a recorded reference is read, and the reference is "
                f"{self.reference!r}; leave it out"
            )
        for kind, run in self.run.items():
            if (run.n is None) != self.recorded:
                raise ValueError(
                    f"run.{kind}.n "
                    + (
                        "is given by the recorded curve; leave it out"
                        if self.recorded
                        else "is missing: samples"
                    )
                )
            if run.inertia and kind != "sweep":
                raise ValueError(
                    f"run.{kind}.inertia: leave it out; inertia acts in dynamics always, and in "
                    f"equilibrium never"
                )
            for name, rod in self.rod.items():
                if kind == "dynamics" and rod.torsion is not None:
                    raise ValueError(
                        f"run.dynamics: rod {name!r} twists, but nothing says what its inertia "
                        "about its own axis is; a rod in space is for run.equilibrium and run.sweep"
                    )
            if kind == "dynamics" and not (self.drive or run.until or self.recorded):
                raise ValueError(f"run.{kind}.until is missing: the last time [s]")
            for solver in run.solvers:
                self._overlap(kind, solver)
        return self

    @model_validator(mode="after")
    def _drawable(self) -> "Case":
        for view in self.view:
            self.run_of(view)
        if self.compare_with and not self.view:
            raise ValueError("compare_with is drawn in views; give a [[view]]")
        return self

    @model_validator(mode="after")
    def _refinable(self) -> "Case":
        if self.refine is None:
            return self
        if not self.rod:
            raise ValueError("refine needs a [rod.NAME]: it is cut into more and more segments")
        self._has_run("refine.run", self.refine.run)
        there = self.channels_of(self.refine.run)
        for pattern in self.refine.channels:
            if not any(fnmatchcase(name, pattern) for name in there):
                raise ValueError(
                    f"refine.channels: {pattern!r} matches nothing; {suggest_names(pattern, there)}"
                )
        return self

    @model_validator(mode="after")
    def _matching(self) -> "Case":
        solvers = [solver for run in self.run.values() for solver in run.solvers]
        for name in self.settings:
            if name not in solvers:
                raise ValueError(
                    f'settings."{name}": no run has this solver; {suggest_names(name, solvers)}'
                )
        for name, channel in self.channels.items():
            self._has_run(f"channels.{name}.only", channel.only)
        if self.unchecked and (self.tolerance or self.refine):
            raise ValueError(
                "unchecked = true says that nothing is checked: leave it out, or the "
                "tolerances and refine"
            )
        for k, tolerance in enumerate(self.tolerance):
            self._has_run(f"tolerance.{k}.run", tolerance.run)
            self._match(f"tolerance.{k}", tolerance)
        return self

    def run_of(self, view: View) -> Kind:
        """The run that a view shows: the one it names, or the first that records its channels."""
        runs = self.run if view.run is None else [view.run]
        names = [n for n in (view.x, *view.y) if n in self.channels]
        for kind in (k for k in runs if k in self.run):
            if all(self.channels[n].only in (None, kind) for n in names):
                return kind
        raise ValueError(
            f"view {view.title!r}: no run.{view.run or '*'} records its channels "
            f"{', '.join(names) or '(it names none)'}"
        )

    def _restful(self) -> None:
        if self.path_table:
            raise ValueError(
                "run.equilibrium: its drives stand still, and a path moves them; leave out this run"
            )
        if moved := next((one.joint for one in self.drive if one.profile is not None), None):
            raise ValueError(
                f"run.equilibrium: its drives stand still, and the profile of {moved!r} moves "
                "it; leave out this run, or give the drive's place as 'from' without a profile"
            )
        shortest = min((rod.length for rod in self.rod.values()), default=None)
        if shortest is None:
            raise ValueError("run.equilibrium needs a [rod.NAME]: it is sampled along its length")
        if (self.run["equilibrium"].until or shortest) > shortest:
            raise ValueError(f"run.equilibrium.until goes beyond the shortest rod, {shortest:g} m")

    def _has_run(self, key: str, kind: Kind | None) -> None:
        if kind is not None and kind not in self.run:
            raise ValueError(f"{key}: there is no run.{kind}; there are: {', '.join(self.run)}")

    def _match(self, place: str, tolerance: Tolerance) -> None:
        """Raise ValueError if a pattern matches no name, or if the tolerance covers no channel."""
        there = {
            "solver": [s for run in self.run.values() for s in run.solvers],
            "unit": [channel.unit for channel in self.channels.values()],
            "channels": list(self.channels),
        }
        for key, names in there.items():
            for pattern in getattr(tolerance, key):
                literal = key == "unit" and pattern != "*"
                if not any(
                    name == pattern if literal else fnmatchcase(name, pattern) for name in names
                ):
                    raise ValueError(
                        f"{place}.{key}: {pattern!r} matches nothing; "
                        f"{suggest_names(pattern, names)}"
                    )
        if not any(
            tolerance.covers(kind, solver, name, channel.unit)
            for kind, run in self.run.items()
            for solver in run.solvers
            for name, channel in self.channels_of(kind).items()
        ):
            raise ValueError(
                f"{place}: it covers nothing: no channel of its run and its solvers "
                f"has both one of its names and one of its units"
            )

    def _overlap(self, kind: Kind, solver: str) -> None:
        for name, channel in self.channels.items():
            hits = [t for t in self.tolerance if t.covers(kind, solver, name, channel.unit)]
            if len(hits) > 1:
                raise ValueError(
                    f"{len(hits)} tolerances cover channel {name!r} of {solver} in "
                    f"{kind}; exactly one may"
                )

    def with_model(
        self, changes: Mapping[str, Mapping[str, Any] | None], **parameters: float | str
    ) -> "Case":
        """Make a case with a changed model, and with changed parameters of its reference.

        The changed model is stored in a temporary folder until Python ends.

        Parameters
        ----------
        changes : mapping
            The attributes that an element of the MJCF gets, texts or numbers [SI]; None removes the
            element. Elements are named by tag and name, and by tags below it, such as ``site pin``,
            ``body crank/inertial`` or ``body crank/geom``.
        **parameters : float
            Changed parameters [its unit]; the others are those of the case.

        Returns
        -------
        Case

        Raises
        ------
        InputError
            The model has no such element.

        Examples
        --------
        >>> from proofmass import load_case
        >>> case = load_case("models/linkages/fourbar.toml")
        >>> longer = case.with_model({"site rocker_end": {"pos": (2.525, 0, 0)}}, rocker=2.525)
        >>> longer.parameters["rocker"], longer.name
        (2.525, 'fourbar')
        """
        from proofmass.sim.mjcf import with_attributes  # loads an engine

        try:
            mjcf = with_attributes(self.model_path, changes)
        except BadModel as error:
            raise model_error(self.model_path, error) from None
        digest = sha256(mjcf.encode()).hexdigest()[:16]
        file = made_models_folder() / digest / Path(self.model).name
        file.parent.mkdir(exist_ok=True)
        file.write_text(mjcf, encoding="utf-8")
        return self.model_copy(
            update={"model": str(file), "parameters": {**self.parameters, **parameters}}
        )

    def with_run(self, kind: Kind, **changes: Any) -> "Case":
        """Return the case with other values of keys of one run."""
        return self.model_copy(
            update={"run": {**self.run, kind: self.run[kind].model_copy(update=changes)}}
        )

    def with_segments(self, numbers: Mapping[str, int]) -> "Case":
        """Return the case with other numbers of segments of its rods, by name."""
        rods = {
            name: rod.model_copy(update={"segments": numbers[name]})
            for name, rod in self.rod.items()
        }
        return self.model_copy(update={"rod": rods})

    def has_inertia(self, kind: str) -> bool:
        """Whether moments and forces of a run include inertia."""
        return kind == "dynamics" or self.run[kind].inertia  # type: ignore[index]

    def channels_of(self, kind: str) -> dict[str, Channel]:
        """The channels that a run records."""
        return {n: c for n, c in self.channels.items() if c.only in (None, kind)}

    def tolerance_for(self, kind: str, solver: str, name: str) -> Tolerance | None:
        """The tolerance of a channel; None if the channel is shown but not checked."""
        unit = self.channels[name].unit
        return next((t for t in self.tolerance if t.covers(kind, solver, name, unit)), None)
