"""What a reference is: an object with typed parameters that gives curves along a motion.

A reference of one's own is a class with its parameters as fields, whose types state the unit and
the values that are allowed, and with a method `solve`::

    class Yoke(Reference):
        '''Scotch yoke: a slider that follows the horizontal place of its crank pin.'''

        crank: Length
        phase: Angle = 0.0

        def solve(self, motion, ask):
            angle, rate, _ = motion.drive
            return {
                "slider": self.crank * np.cos(angle + self.phase),
                "slider_v": -self.crank * rate * np.sin(angle + self.phase),
            }

It is found by an entry point of the group ``proofmass.references``, or as a file beside a sidecar,
``reference = "yoke.py"``.
"""

import inspect
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated, Any, ClassVar, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.chart import Chart
from proofmass.analytic.inverse import InverseProblem
from proofmass.analytic.numerics import (
    check_count,
    check_finite,
    check_not_negative,
    check_positive,
)
from proofmass.base.arrays import Array
from proofmass.base.errors import suggest_names

REQUIRED = inspect.Parameter.empty
"""The default of a parameter that must be given."""
Value = float | int | str | Array
"""A value of a parameter; an array (n,) where a load changes it along a run."""


class Domain(Enum):
    """Values that a quantity may have."""

    POSITIVE = "above 0"
    NOT_NEGATIVE = "0 or above"
    POSITIVE_OR_INF = "above 0, or inf"
    FINITE = "any number"
    EXTENDED = "any number, or inf"


@dataclass(frozen=True)
class Quantity:
    """The kind of a parameter that is a quantity.

    Attributes
    ----------
    unit : str
        Its SI unit; "1" for a number without a unit.
    domain : Domain
        The values that it may have.
    may_change : bool
        Whether a load may multiply it along a run, so that it may be an array.
    moves : tuple of str, optional
        Names of the only curves that it changes: none for a first guess, which only chooses among
        solutions. None: it may change all curves.
    """

    unit: str
    domain: Domain = Domain.FINITE
    may_change: bool = False
    moves: tuple[str, ...] | None = None

    def check(self, name: str, value: Value) -> None:
        """Raise a ValueError that names a value outside the domain."""
        if isinstance(value, str):
            raise ValueError(f"{name} must be a number [{self.unit}], got {value!r}")
        infinite = value == np.inf if np.ndim(value) == 0 else False
        if self.may_change or self.domain is Domain.FINITE:
            check_finite(**{name: value})
        elif self.domain is Domain.NOT_NEGATIVE:
            check_not_negative(self.unit, **{name: float(value)})
        elif self.domain is Domain.POSITIVE or (
            self.domain is Domain.POSITIVE_OR_INF and not infinite
        ):
            check_positive(self.unit, **{name: float(value)})


@dataclass(frozen=True)
class OneOf:
    """The kind of a parameter that is one of some whole numbers or words."""

    values: tuple[int | str, ...]
    unit: ClassVar[str] = ""

    def check(self, name: str, value: Value) -> None:
        """Raise a ValueError that names a value that is none of them."""
        if value not in self.values:
            there = ", ".join(map(str, self.values))
            raise ValueError(f"{name} must be one of {there}, got {value}")


@dataclass(frozen=True)
class Whole:
    """The kind of a parameter that is a whole number from 1 on."""

    unit: ClassVar[str] = "1"

    def check(self, name: str, value: Value) -> None:
        """Raise a ValueError that names a value that is none."""
        if isinstance(value, str):
            raise ValueError(f"{name} must be a whole number, got {value!r}")
        check_count(**{name: float(value)})


@dataclass(frozen=True)
class Text:
    """The kind of a parameter that is a text, which the reference reads itself."""

    unit: ClassVar[str] = ""

    def check(self, name: str, value: Value) -> None:
        """Raise a ValueError that names a value that is no text."""
        if not isinstance(value, str):
            raise ValueError(f"{name} must be a text, got {value}")


KINDS = (Quantity, OneOf, Whole, Text)
Length = Annotated[float, Quantity("m", Domain.POSITIVE)]
Position = Annotated[float, Quantity("m")]
Angle = Annotated[float, Quantity("rad")]
Speed = Annotated[float, Quantity("m/s")]
Rate = Annotated[float, Quantity("rad/s")]
Acceleration = Annotated[float, Quantity("m/s^2")]
Mass = Annotated[float, Quantity("kg", Domain.NOT_NEGATIVE)]
MomentOfInertia = Annotated[float, Quantity("kg m^2", Domain.NOT_NEGATIVE)]
Force = Annotated[float, Quantity("N")]
Moment = Annotated[float, Quantity("N m")]
VaryingForce = Annotated[float, Quantity("N", may_change=True)]
VaryingMoment = Annotated[float, Quantity("N m", may_change=True)]
AngularStiffness = Annotated[float, Quantity("N m/rad")]
BendingStiffness = Annotated[float, Quantity("N m^2", Domain.POSITIVE)]
GuessedPosition = Annotated[float, Quantity("m", moves=())]
GuessedForce = Annotated[float, Quantity("N", moves=())]
GuessedMoment = Annotated[float, Quantity("N m", moves=())]
Ratio = Annotated[float, Quantity("1")]
Natural = Annotated[int, Whole()]
Word = Annotated[str, Text()]
Mode = Annotated[int, OneOf((1, -1))]
"""The assembly mode of a mechanism that has two."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of a reference.

    Attributes
    ----------
    name : str
        Its name, as in ``[parameters]`` of a sidecar.
    kind : Quantity, OneOf, Whole or Text
        Its unit, and the values that it may have.
    default : object
        Its value if none is given; `REQUIRED` if it must be given.
    """

    name: str
    kind: Quantity | OneOf | Whole | Text
    default: Any = REQUIRED

    @property
    def is_quantity(self) -> bool:
        """Whether it is a quantity, which a small change changes a little."""
        return isinstance(self.kind, Quantity)

    def moves_any(self, curves: Container[str]) -> bool:
        """Whether a small change of it may change some of these curves.

        >>> guess = Parameter("pin_x", Quantity("m", moves=()))
        >>> guess.moves_any({"pin_vx"}), Parameter("length", Quantity("m")).moves_any({"pin_vx"})
        (False, True)
        """
        if not isinstance(self.kind, Quantity):
            return False
        return self.kind.moves is None or any(name in curves for name in self.kind.moves)

    @property
    def may_change(self) -> bool:
        """Whether a load may multiply it along a run."""
        return isinstance(self.kind, Quantity) and self.kind.may_change

    @property
    def unit(self) -> str:
        """Its SI unit; empty for a choice or a word."""
        return self.kind.unit


@dataclass(frozen=True)
class InputMotion:
    """The places at which curves are wanted, and the motion of the drives there.

    Attributes
    ----------
    x : ndarray (n,)
        Times [s], values of the drive [rad or m], or arc lengths of a rod [m].
    drives : tuple of three ndarray (drives, n), optional
        Values [rad or m] of all drives, their rates and accelerations; None in a free motion and
        in an equilibrium of rods.
    """

    x: Array
    drives: tuple[Array, Array, Array] | None = None

    @property
    def drive(self) -> tuple[Array, ...]:
        """Value, rate and acceleration: (n,) each for one drive, (drives, n) for several."""
        if self.drives is None:
            raise ValueError("this reference needs a [drive], and the case has none")
        return tuple(part[0] if len(part) == 1 else part for part in self.drives)

    @property
    def arguments(self) -> tuple[Array, ...]:
        """What a function ``solve`` of a closed form takes first: x, or the motion of the drives.

        >>> time = np.linspace(0.0, 1.0, 3)
        >>> len(InputMotion(time).arguments), len(InputMotion(time, (time[None],) * 3).arguments)
        (1, 3)
        """
        return (self.x,) if self.drives is None else self.drive


@dataclass(frozen=True)
class ModelRun:
    """The model of a case and what moves it in a run, for references that read the model.

    Attributes
    ----------
    model : MjModel
        The compiled MJCF.
    start : str
        Name of its start key.
    joints : tuple of str
        The driven joints.
    controls, control_rates : dict of str to ndarray (n,)
        Controls of actuators that loads change along the run, and their rates [its unit].
    in_time : tuple, optional
        Times (n,) [s] and the motion profiles of the drives; None outside dynamics.
    control_profiles : dict of str to MotionProfile
        In dynamics, the profiles of the controls.
    terms : function
        Returns the terms of the equations of motion as MuJoCo computes them.
    solve_closely : function
        Returns all sensors of the model at times (n,) [s], solved without a simulator's steps.
    evidence : function
        Returns a sentence on how well the model's own motion is known.
    """

    model: Any
    start: str
    joints: tuple[str, ...]
    controls: Mapping[str, Array]
    control_rates: Mapping[str, Array]
    in_time: tuple[Array, Sequence[Any]] | None
    control_profiles: Mapping[str, Any]
    terms: Callable[[], Any]
    solve_closely: Callable[[Array], dict[str, Array]]
    evidence: Callable[[], str]

    @property
    def arguments(self) -> dict[str, Any]:
        """What both general solvers take by keyword."""
        return {
            "model": self.model,
            "start": self.start,
            "joints": self.joints,
            "controls": self.controls,
            "control_rates": self.control_rates,
            "in_time": self.in_time,
            "control_profiles": self.control_profiles,
        }


@dataclass(frozen=True)
class Ask:
    """What is asked of a reference beside its parameters and the motion.

    Attributes
    ----------
    inertia : bool
        Whether forces and moments include those of the accelerations.
    wanted : frozenset of str, optional
        Names of the curves that are used; others may be left out. None: all are wanted.
    load_rates : dict of str to ndarray (n,)
        Rates of the parameters that loads change along the run [SI].
    run : ModelRun, optional
        The model; only for references with `Reference.reads_model`.
    """

    inertia: bool = False
    wanted: frozenset[str] | None = None
    load_rates: Mapping[str, Array] = field(default_factory=dict)
    run: ModelRun | None = None

    @property
    def of_model(self) -> ModelRun:
        """The model, for a reference that reads it."""
        if self.run is None:
            raise ValueError("it reads no model: a class that does states reads_model = True")
        return self.run


@dataclass(frozen=True)
class OwnError:
    """How accurate a reference is, and how that was found.

    Attributes
    ----------
    error : float
        Largest error of a curve as a share of its range, apart from poses that the documentation
        names [1].
    confirmed_by : str
        What it was compared with, such as a second formulation.
    """

    error: float
    confirmed_by: str


class Reference:
    """A mechanism with known curves; an object has values of its parameters.

    A subclass has its parameters as fields, see the module. Class attributes say what it covers:

    Attributes
    ----------
    parameters : dict of str to Parameter
        Its parameters by name, made from the fields.
    reads_model : bool
        Whether it reads the model, so that it shares its wrong numbers. It gets `Ask.run`.
    covers_inertia : bool
        Whether forces and moments can include those of the accelerations, see `Ask.inertia`.
    follows_controls : bool
        Whether it has controls of actuators that loads change, see `ModelRun.controls`.
    in_space : bool
        Whether the motion leaves a plane, which engines of the plane cannot run.
    charts : tuple of functions
        Functions of parameters that return a `Chart`, which ``[[chart]]`` names in `draw`.
    profiles : tuple of functions
        Motion profiles of its drives, which a ``[drive]`` names in `profile`.
    inverse : InverseProblem, optional
        How its drives lead an end point or a platform along a path of one's own; None if it does
        not solve this problem.
    marks : tuple of functions
        Functions of the parameters that return places of the first drive by words, which a
        ``[[view]]`` names in `marks`.
    own_error : OwnError, optional
        Its own error, and how that was found; None if it is not known.
    method : str
        How its curves are found, as a noun without an article, such as ``closed form``.

    Examples
    --------
    >>> class Yoke(Reference):
    ...     crank: Length
    ...     phase: Angle = 0.0
    ...
    ...     def solve(self, motion, ask):
    ...         return {"slider": self.crank * np.cos(motion.drive[0] + self.phase)}
    >>> [(one.name, one.unit) for one in Yoke.parameters.values()]
    [('crank', 'm'), ('phase', 'rad')]
    >>> motion = InputMotion(np.zeros(1), (np.zeros((1, 1)),) * 3)
    >>> Yoke(crank=2.0).solve(motion, Ask())["slider"].item()
    2.0
    >>> Yoke(crank=-2.0)
    Traceback (most recent call last):
    ValueError: crank must be a positive finite length [m], got -2.0
    """

    parameters: ClassVar[Mapping[str, Parameter]] = {}
    reads_model: ClassVar[bool] = False
    covers_inertia: ClassVar[bool] = False
    follows_controls: ClassVar[bool] = False
    in_space: ClassVar[bool] = False
    charts: ClassVar[tuple[Callable[..., Chart], ...]] = ()
    profiles: ClassVar[tuple[Callable[..., Any], ...]] = ()
    inverse: ClassVar[InverseProblem | None] = None
    marks: ClassVar[tuple[Callable[..., dict[str, float]], ...]] = ()
    own_error: ClassVar[OwnError | None] = None
    method: ClassVar[str] = "reference"

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        cls.parameters = {**cls.parameters, **read_fields(cls)}

    def __init__(self, **values: Value) -> None:
        for name in values:
            if name not in self.parameters:
                hint = suggest_names(name, self.parameters, "known")
                raise ValueError(f"no such parameter {name!r}; {hint}")
        missing = [
            one
            for one in self.parameters.values()
            if one.default is REQUIRED and one.name not in values
        ]
        if missing:
            names = ", ".join(
                f"{one.name} [{one.unit}]" if one.unit else one.name for one in missing
            )
            raise ValueError(f"missing: {names}")
        self.check(values)
        self.values = values
        for name, value in values.items():
            setattr(self, name, value)

    def check(self, values: Mapping[str, Value]) -> None:
        """Raise a ValueError for a value outside the domain of its parameter."""
        for name, value in values.items():
            self.parameters[name].kind.check(name, value)

    def solve(self, motion: InputMotion, ask: Ask) -> Mapping[str, ArrayLike]:
        """Curves by name, (n,) each [SI, rad].

        Raises
        ------
        NotCovered
            The model has something that the reference does not cover.
        ValueError
            The mechanism cannot take the motion, or a parameter is wrong; the message says which.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method solve")

    def properties(self, motion: InputMotion, ask: Ask) -> dict[str, str]:
        """Properties of the mechanism as a whole in words, such as its class, for the report.

        The motion is the prescribed one of the first run of a case.
        """
        return {}

    @classmethod
    def evaluate(
        cls, parameters: Mapping[str, Value], motion: InputMotion, ask: Ask
    ) -> dict[str, Array]:
        """Curves with these parameters, (n,) each or one number [SI, rad], see `solve`.

        Raises
        ------
        BadCurves
            The method `solve` returned something else.
        """
        found = cls(**parameters).solve(motion, ask)
        if not isinstance(found, Mapping):
            raise BadCurves(f"solve must return a dict of curves by name, got {found!r:.60}")
        return {name: read_curve(name, curve, motion.x) for name, curve in found.items()}

    @classmethod
    def leaves_dof(cls, model: Any, start: str, joints: tuple[str, ...]) -> bool | None:
        """Whether driven joints leave degrees of freedom of a compiled model.

        None if it does not know; the joints and loops of the model are then counted in the plane.
        """
        return None

    @classmethod
    def modes(cls) -> tuple[int, ...]:
        """The assembly modes among which its parameter ``mode`` chooses; empty without one."""
        mode = cls.parameters.get("mode")
        return tuple(map(int, mode.kind.values)) if mode and isinstance(mode.kind, OneOf) else ()

    @classmethod
    def describe(cls) -> str:
        """The first paragraph of its docstring, in one line."""
        return (inspect.getdoc(cls) or "").partition("\n\n")[0].replace("\n", " ")


class BadCurves(ValueError):
    """A reference returned no dict of curves (n,) of numbers; the message names the curve."""


def read_curve(name: str, curve: ArrayLike, x: Array) -> Array:
    """A curve that a reference returned, as an array of the shape of x or without axes.

    >>> read_curve("slider", [0.3, 0.1], np.zeros(3))
    Traceback (most recent call last):
    proofmass.analytic.protocol.BadCurves: curve 'slider' has shape (2,), and must have (3,)
    """
    try:
        found = np.asarray(curve)
    except ValueError:  # lists of different lengths
        found = np.asarray(None)
    if found.dtype.kind not in "biuf":
        raise BadCurves(f"curve {name!r} must be an array of real numbers, got {curve!r:.60}")
    wanted = np.shape(x)
    if found.shape not in ((), wanted):
        hint = "; motion.drive has arrays (n,), motion.drives has arrays (drives, n)"
        raise BadCurves(
            f"curve {name!r} has shape {found.shape}, and must have {wanted}"
            f"{hint if found.shape == (1, *wanted) else ''}"
        )
    return found


def read_fields(cls: type[Reference]) -> dict[str, Parameter]:
    """The parameters that the fields of a class state.

    Annotations may be texts, as with ``from __future__ import annotations``.

    Raises
    ------
    TypeError
        A field has no kind or an unknown unit, or its name is one of `Reference`.
    """
    found = {}
    hints = get_type_hints(cls, include_extras=True)
    for name in vars(cls).get("__annotations__", {}):
        if ClassVar in (hints[name], get_origin(hints[name])):
            continue
        kinds = [k for k in getattr(hints[name], "__metadata__", ()) if isinstance(k, KINDS)]
        if len(kinds) != 1:
            raise TypeError(
                f"{cls.__name__}.{name}: state the kind of the parameter by its type, such as "
                "Length, or Annotated[float, Quantity('N/m')]"
            )
        if hasattr(Reference, name):
            raise TypeError(f"{cls.__name__}.{name}: a parameter cannot have this name")
        found[name] = Parameter(name, kinds[0], vars(cls).get(name, REQUIRED))
    return found


class ClosedForm(Reference):
    """A reference whose curves a function computes, which scripts can call without the object.

    The function takes the motion first and the parameters by keyword, and checks their values.
    Where the class says so, it also gets ``inertia``, ``only`` (see `Ask.wanted`) and
    ``load_rates``. The fields of the class state the kinds of the parameters, the function their
    defaults::

        class Yoke(ClosedForm, function=solve):
            crank: Length
            phase: Angle

    Attributes
    ----------
    selects : bool
        Whether the function takes the names of the wanted curves, as ``only``.
    takes_load_rates : bool
        Whether the function takes the rates of the parameters that loads change.
    function : function
        Returns the curves.
    describe_mechanism : function, optional
        Returns properties of the mechanism in words.
    """

    method = "closed form"
    selects: ClassVar[bool] = False
    takes_load_rates: ClassVar[bool] = False
    function: ClassVar[Callable[..., dict[str, Array]]]
    describe_mechanism: ClassVar[Callable[..., dict[str, str]] | None] = None

    def __init_subclass__(
        cls,
        function: Callable[..., dict[str, Array]],
        properties: Callable[..., dict[str, str]] | None = None,
        **more: Any,
    ) -> None:
        super().__init_subclass__(**more)
        cls.function, cls.describe_mechanism = staticmethod(function), properties
        cls.parameters = with_defaults_of(function, cls)

    @classmethod
    def is_driven(cls) -> bool:
        """Whether its function takes the motion of a drive, not the time alone."""
        takes = inspect.signature(cls.function).parameters.values()
        return sum(one.kind is one.POSITIONAL_OR_KEYWORD for one in takes) > 1

    def check(self, values: Mapping[str, Value]) -> None:
        """Leave the check of numbers to the function, and refuse a text in the place of one."""
        for name, value in values.items():
            if isinstance(value, str):
                self.parameters[name].kind.check(name, value)

    def solve(self, motion: InputMotion, ask: Ask) -> dict[str, Array]:
        """Curves by name, (n,) each [SI, rad], see the function."""
        return self.function(*motion.arguments, **self.values, **self.more(ask))

    def more(self, ask: Ask) -> dict[str, Any]:
        """The arguments of the function that are no parameters."""
        more: dict[str, Any] = {"inertia": ask.inertia} if self.covers_inertia else {}
        if self.selects:
            more["only"] = ask.wanted
        if self.takes_load_rates:
            more["load_rates"] = ask.load_rates
        return more

    def properties(self, motion: InputMotion, ask: Ask) -> dict[str, str]:
        """Properties of the mechanism in words, see the function that the class names for them."""
        describe = type(self).describe_mechanism
        return {} if describe is None else describe(**self.values)


def with_defaults_of(function: Callable[..., Any], cls: type[ClosedForm]) -> dict[str, Parameter]:
    """The parameters of a class in the order and with the defaults of its function.

    Raises
    ------
    TypeError
        The function and the class do not have the same parameters.
    """
    takes = {
        p.name: p.default
        for p in inspect.signature(function).parameters.values()
        if p.kind is p.KEYWORD_ONLY
    }
    flags = {
        "inertia": cls.covers_inertia,
        "only": cls.selects,
        "load_rates": cls.takes_load_rates,
    }
    own = {name for name in takes if not flags.get(name)}
    if own != cls.parameters.keys():
        raise TypeError(
            f"{cls.__name__}: the fields and the parameters of {function.__name__}() differ: "
            f"{', '.join(sorted(own ^ cls.parameters.keys()))}"
        )
    return {
        name: Parameter(name, cls.parameters[name].kind, takes[name])
        for name in takes
        if name in own
    }
