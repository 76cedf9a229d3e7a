"""Drives that lead an end point or a platform along a path, by the reference's inverse problem.

The path is solved at its rows and at places between them, until polynomials of fifth degree through
these values, rates and accelerations agree with the solution half way between them.  The drives
follow these polynomials, or the solution itself where each place is solved by itself.  The
reference's direct problem must then give the rows back.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from proofmass.analytic.inverse import COORDINATES, DriveMotion, InverseProblem
from proofmass.analytic.protocol import Ask, InputMotion, Reference
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError, suggest_names
from proofmass.base.files import content_key
from proofmass.base.read_once import read_once
from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.case.drive import DriveState, quintic_spline
from proofmass.case.path import EndPath, read_path
from proofmass.case.profile import SampledProfile
from proofmass.reference.find import (
    NoReference,
    find_reference,
    place_of_error,
    reference_class,
    reference_names,
)
from proofmass.reference.samples import path_row_times, read_profile

PARTS_PER_ROW = 2
"""Intervals between two rows at which the inverse problem is solved at first; the rows alone are
the ends of the pieces of the path's splines."""
MAX_PATH_NODES = 4000
"""Largest number of solutions that the drives' polynomials go through, as of `table_times`."""
SINGULAR_ERROR = 1e-6
"""Share of the range by which the drives' polynomials may be off between solutions.  Regular paths
have 1e-9 and less; a larger error is a rate that grows without bound."""
CLOSURE = 1e-6
"""Largest distance of the direct problem from a row, as a share of the size of the path; solutions
of both problems are accurate to 1e-9, and a pose in another assembly mode is off by 1e-2 or more
within a few rows."""


@dataclass(frozen=True)
class AskedPath:
    """The path of a case, with what makes it different from others.

    Attributes
    ----------
    case, kind
        The case, and the kind of run.
    loads : tuple of callable
        The profiles of its loads.
    identity : str
        All tables of the sidecar and contents of files that the drives depend on.
    """

    case: Case = field(compare=False)
    kind: Kind
    loads: tuple[Any, ...] = field(compare=False)
    identity: tuple[object, ...]

    def loads_matter(self, parameters: Mapping[str, Any]) -> bool:
        """Whether a load multiplies one of these parameters along the path."""
        return any(name in parameters for load in self.case.load for name in load.scales)


def path_profiles(case: Case, kind: Kind, loads: tuple[Any, ...]) -> tuple[SampledProfile, ...]:
    """The motion profiles of all drives of a case whose first drive has a path.

    Parameters
    ----------
    case : Case
    kind : str
        The kind of run.
    loads : tuple of callable
        The profiles of its loads.

    Raises
    ------
    InputError
        The file or a column is wrong, the reference has no inverse problem, or the path leaves the
        workspace or passes a singular pose.
    """
    tables = [one.model_dump_json() for one in (*case.drive, *case.load, case.run[kind])]
    own = [case.file.parent / case.reference] if case.program else []
    identity = (
        case.reference,
        repr(case.parameters),
        *tables,
        *map(content_key, [*case.profile_files, *own]),
    )
    found: tuple[SampledProfile, ...] = solve_path(AskedPath(case, kind, loads, identity))
    return found


@read_once(None)
def solve_path(asked: AskedPath) -> tuple[SampledProfile, ...]:
    """Do what `path_profiles` does, once for each path."""
    led = make_led_path(asked)
    nodes, (value, rate, acceleration), error = led.refine()
    rows = np.searchsorted(nodes, led.path.times)
    closure = led.check_closure((value[:, rows], rate[:, rows], acceleration[:, rows]))
    exact = led.problem.at_each_place and not asked.loads_matter(led.parameters)
    between = (
        "the inverse problem is solved at each time"
        if exact
        else f"a polynomial of fifth degree through {nodes.size} solutions of the inverse problem, "
        f"off by up to {error:.1e} between them"
    )
    words = f"path {led.path.table.file.name}, {led.path.words}; {between}; {closure}"
    found = tuple(
        SampledProfile(nodes, quintic_spline(nodes, *rows).c, led.path.table.file.name, words)
        for rows in zip(value, rate, acceleration, strict=True)
    )
    if not exact:
        return found
    return tuple(
        LedDrive(
            *(one.times, one.pieces, one.file, one.words),
            solve=led.problem.solve,
            path=led.path,
            parameters=dict(led.parameters),
            row=row,
        )
        for row, one in enumerate(found)
    )


@dataclass(frozen=True, kw_only=True)
class LedDrive(SampledProfile):
    """A drive whose inverse problem is solved anew at each time, on the branch of its polynomials.

    Attributes
    ----------
    solve : function
        See `InverseProblem.solve`.
    path : EndPath
        The path.
    parameters : dict
        Its arguments [SI].
    row : int
        Which of its drives this one is.
    """

    solve: Callable[..., DriveMotion]
    path: EndPath
    parameters: dict[str, Any]
    row: int

    @property
    def breaks(self) -> Array:
        """Times of the rows, at which the third derivative of a coordinate jumps [s]."""
        return self.path.times

    def __call__(self, x: Array) -> DriveState:
        """Value, rate and acceleration at samples x of a run; beyond the rows the polynomials'."""
        near, t = super().__call__(x), np.asarray(self.time(x), float)
        inside = np.clip(t, self.times[0], self.times[-1])
        motion = self.path.motion(np.atleast_1d(inside).ravel())
        found = self.solve(motion, **self.parameters)
        parts = [np.reshape(part[self.row], t.shape) for part in found]
        parts[0] = parts[0] + 2.0 * np.pi * np.round((near[0] - parts[0]) / (2.0 * np.pi))
        value, rate, acceleration = (
            np.where(t == inside, exact, rough) for exact, rough in zip(parts, near, strict=True)
        )
        return value, rate, acceleration


def make_led_path(asked: AskedPath) -> "LedPath":
    """Read the path of a case, and find the inverse problem of its reference."""
    case, key = asked.case, asked.case.drive_key(0, "profile")
    reference = reference_class(case)
    if reference is None or reference.inverse is None:
        raise case.error(key, f"path: {describe_missing(case, reference)}")
    table, file = case.path_table, case.profile_files[0]
    assert table is not None
    times = path_row_times(case, asked.kind)
    path = read_profile(case, key, read_path, file, table, tuple(reference.inverse.curves), times)
    given = bind_parameters(case, reference.inverse)
    return LedPath(case, reference, reference.inverse, path, given, asked.loads)


def describe_missing(case: Case, reference: type[Reference] | None) -> str:
    """Say that a reference has no inverse problem, and which have one."""
    have = []
    for name in reference_names():
        try:
            have += [name] if find_reference(name).inverse else []
        except NoReference:  # one that cannot be loaded is no suggestion
            continue
    what = "a recorded curve" if reference is None else f"reference {case.reference!r}"
    return (
        f"{what} has no inverse problem, which would lead a path; these have one: {', '.join(have)}"
    )


def bind_parameters(case: Case, problem: InverseProblem) -> dict[str, Any]:
    """The parameters of an inverse problem: those of the case, then those of the first drive.

    Raises
    ------
    InputError
        The first drive has a parameter that the problem does not take, or one is missing.
    """
    takes = {
        name: one
        for name, one in inspect.signature(problem.solve).parameters.items()
        if one.kind is one.KEYWORD_ONLY
    }
    own = case.drive[0].parameters
    for name in own:
        if name not in takes:
            raise case.error(
                case.drive_key(0, f"parameters.{name}"),
                f"the inverse problem of {case.reference} has no such parameter; "
                f"{suggest_names(name, takes, 'known')}",
            )
    given = {name: value for name, value in {**case.parameters, **own}.items() if name in takes}
    lacking = [
        name for name, one in takes.items() if one.default is one.empty and name not in given
    ]
    if lacking:
        raise case.error(
            case.drive_key(0, "parameters"),
            f"the inverse problem of {case.reference} also needs {', '.join(lacking)}",
        )
    return given


@dataclass(frozen=True)
class LedPath:
    """A path, and the inverse problem that leads drives along it.

    Attributes
    ----------
    case, reference, problem
        The case, the class of its reference, and the inverse problem of that.
    path : EndPath
    parameters : dict
        Arguments of the inverse problem [SI].
    loads : tuple of callable
        The profiles of the loads.
    """

    case: Case
    reference: type[Reference]
    problem: InverseProblem
    path: EndPath
    parameters: Mapping[str, Any]
    loads: tuple[Any, ...]

    def refine(self) -> tuple[Array, DriveMotion, float]:
        """Times (n,) of solutions, the solutions there, and the error between them [rad or m]."""
        parts = PARTS_PER_ROW
        while True:
            fine = divide_rows(self.path.times, 2 * parts)
            every = self.drives(fine)
            nodes, coarse = fine[::2], [part[:, ::2] for part in every]
            error, share = 0.0, 0.0
            for k, exact in enumerate(every[0]):
                spline = quintic_spline(nodes, *(part[k] for part in coarse))
                off = np.abs(spline(fine[1::2]) - exact[1::2])
                error = max(error, float(off.max()))
                share = max(share, error / (float(np.ptp(every[0])) or 1.0))
            if share <= self.problem.accuracy or fine.size > MAX_PATH_NODES:
                break
            parts *= 2
        if share > SINGULAR_ERROR:
            steep = int(np.argmax(np.abs(every[2]).max(axis=0)))
            raise self.error_at(
                float(fine[steep]),
                "the path comes so close to a singular pose that no rate of the drives follows it",
            )
        return nodes, (coarse[0], coarse[1], coarse[2]), error

    def drives(self, times: Array) -> DriveMotion:
        """Values, rates and accelerations (drives, n) of all drives at times (n,).

        Raises
        ------
        InputError
            The path leaves the workspace, or passes a pose that is singular.
        """
        try:
            found = self.call(times)
        except ValueError as error:
            k, why = self.first_failure(times, str(error))
            raise self.error_at(float(times[k]), why) from None
        finite = np.isfinite(found).all(axis=(0, 1))
        if not finite.all():
            raise self.error_at(
                float(times[np.argmin(finite)]),
                "the pose is singular, and no finite rate of the drives leads through it",
            )
        return found[0], found[1], found[2]

    def call(self, times: Array) -> Array:
        """What the inverse problem returns at times (n,): (3, drives, n)."""
        rates, accelerations = {}, {}
        parameters = dict(self.parameters)
        for name, (value, rate, acceleration) in self.scaled(times).items():
            if name in parameters:
                parameters[name], rates[name], accelerations[name] = value, rate, acceleration
        motion = replace(
            self.path.motion(times), load_rates=rates, load_accelerations=accelerations
        )
        try:
            found = np.asarray(self.problem.solve(motion, **parameters), float)
        except (ValueError, MemoryError):
            raise
        except Exception as error:
            place = place_of_error(error, self.reference)
            if not place:
                raise
            words = f"{place}: {type(error).__name__}: {error}"
            raise self.case.error("reference", words) from error
        wanted = (3, len(self.case.drive), times.size)
        if found.shape != wanted:
            raise self.case.error(
                "drive",
                f"the inverse problem of {self.case.reference} moves {found.shape[1:2]} drives, "
                f"and the case has {wanted[1]}: give each a [[drive]] with its joint, in the order "
                f"of the reference (shape {found.shape}, needed {wanted})",
            )
        return found

    def scaled(self, times: Array) -> dict[str, tuple[Array, Array, Array]]:
        """Parameters that loads multiply: values, rates and accelerations (n,) by name."""
        found = {}
        for load, profile in zip(self.case.load, self.loads, strict=True):
            value, rate, acceleration = np.broadcast_arrays(*profile(times))
            for name in load.scales:
                level = float(self.case.parameters.get(name, 0.0))
                found[name] = level * value, level * rate, level * acceleration
        return found

    def first_failure(self, times: Array, why: str) -> tuple[int, str]:
        """Index of the first time at which the inverse problem fails, and what it then says."""
        low, high = 0, times.size
        while high - low > 1:
            middle = (low + high) // 2
            try:
                self.call(times[:middle])
            except ValueError as error:
                high, why = middle, str(error)
            else:
                low = middle
        return high - 1, why

    def check_closure(self, drives: DriveMotion) -> str:
        """Words on how well the direct problem gives the rows back, from the drives (drives, m).

        Raises
        ------
        InputError
            It does not, from some row on.
        """
        if self.reference.reads_model:
            return "its direct problem reads the model, and was not compared"
        off = self.closure_errors(drives)
        allowed = CLOSURE * self.path.size
        wrong = np.flatnonzero(~(off <= allowed))
        if not wrong.size:
            return f"the direct problem gives the rows back within {off.max():.1e} (SI)"
        k = int(wrong[0])
        if k == 0:
            raise self.case.error(
                "parameters",
                "the direct problem is elsewhere than the path at its first row, by "
                f"{off[0]:.3g} (SI): its mode or its first guess, and the modes in the parameters "
                "of the drive, choose different poses; change one of them",
            )
        raise self.error_at(
            float(self.path.times[k]),
            "before it the path passes a singular pose, beyond which the drives no longer "
            f"determine the place: the direct problem is off by {off[k]:.3g} (SI)",
        )

    def closure_errors(self, drives: DriveMotion) -> Array:
        """Largest error (m,) of a coordinate by the direct problem at each row [m or rad]."""
        times = self.path.times
        scaled = self.scaled(times)
        parameters = {**self.case.parameters, **{name: one[0] for name, one in scaled.items()}}
        ask = Ask(
            wanted=frozenset(self.problem.curves.values()),
            load_rates={name: one[1] for name, one in scaled.items()},
        )
        motion = InputMotion(times, drives)
        try:
            curves = self.reference.evaluate(parameters, motion, ask)
        except ValueError as error:
            raise self.case.error("parameters", str(error)) from None
        off = np.zeros(times.size)
        for (name, curve), place in zip(self.problem.curves.items(), self.path.places, strict=True):
            miss = np.broadcast_to(curves[curve], times.shape) - place
            if COORDINATES[name] == "rad":
                miss = np.angle(np.exp(1j * miss))
            off = np.maximum(off, np.abs(miss))
        return off

    def error_at(self, time: float, why: str) -> InputError:
        """Bad input at a time of the path: the row, the place, why, and what can be kept."""
        path = self.path
        first, rows = path.row_before(time), path.times.size
        at = path.motion(np.array([time])).place[:, 0]
        place = ", ".join(
            f"{name} = {value:.6g} {COORDINATES[name]}"
            for name, value in zip(self.problem.curves, at, strict=True)
        )
        between = time > path.times[first]
        where = f"behind row {first + 1} of {rows}" if between else f"row {first + 1} of {rows}"
        return InputError(
            path.table.file,
            path.table.line(first),
            f"{where}, {place}: {why}; {self.describe_kept(first + between)}",
        )

    def describe_kept(self, rows: int) -> str:
        """What can be kept of a path whose first rows are all right."""
        if not rows:
            return "begin the path elsewhere, or choose another mode"
        plural = "s" if rows > 1 else ""
        until = f"{self.path.times[rows - 1]:.6g} s"
        return f"keep the first {rows} row{plural}, up to {until}, or move the path"


def divide_rows(rows: Array, parts: int) -> Array:
    """Times with this number of intervals from each row to the next.

    >>> divide_rows(np.array([0.0, 1.0, 3.0]), 2)
    array([0. , 0.5, 1. , 2. , 3. ])
    """
    places = np.arange(parts * (rows.size - 1) + 1) / parts
    return np.interp(places, np.arange(rows.size), rows)
