"""Read and write sidecars, and fill in the defaults of what a sidecar leaves out.

`load_case` reads a sidecar.  `fill_defaults` completes its runs, samples, solvers and channels.
`default_tolerances` adds the tolerances of each engine, whose numbers are `ACCURACY` in
`proofmass/sim/ENGINE/settings.py`.  `format_sidecar` writes a case as a sidecar in which nothing is
left to defaults.
"""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, ValidationError

from proofmass.analytic.numerics import LARGEST
from proofmass.base.errors import InputError, suggest_names
from proofmass.base.files import read_text
from proofmass.base.recording import Recorded
from proofmass.base.strict import Kind, Strict
from proofmass.base.units import FORCE_UNITS, MOTION_UNITS, POSITION_UNITS, read_quantity, si_unit
from proofmass.case.case import Case, RangeShare, Tolerance
from proofmass.case.inputs import is_recorded
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import all_quantities
from proofmass.reference.find import (
    NoReference,
    covers_inertia,
    find_class,
    load_reference,
    reference_class,
)
from proofmass.reference.mobility import leaves_dof
from proofmass.reference.profiles import prescribed_quantities
from proofmass.reference.samples import run_samples
from proofmass.run.solve import prescribed_run
from proofmass.run.validate import check_names, delivered_unit, first_samples
from proofmass.sim.contents import channel_names, measures_actuator
from proofmass.sim.engines import NoEngine, default_engines, engine_names, engine_of
from proofmass.sim.protocol.curves import split_channel
from proofmass.sim.protocol.engine import AccuracyLimit
from proofmass.sim.protocol.run import MIN_STEP_SHARE, STEP_ROUNDING, Run, fitting_samples

DEFAULT_SAMPLES = 361
"""Default number of samples of a sweep or dynamics: one turn in steps of a degree; that of dynamics
is changed where whole steps do not lead from sample to sample, see `fit_default_samples`."""
ALL_OTHERS = "*"
"""The key of ``[channels]`` that stands for all sensors that are not listed."""
FIELDS_WITHOUT_KEY = set(Case.fields_without_key)
"""Fields of a `Case` that are no keys of its sidecar."""
TABLES_OF_CHANNELS = (
    "channels",
    "tolerance",
    "view",
    "chart",
    "compare_with",
    "refine",
    "unchecked",
)
TomlTable = dict[str, Any]


class Accuracy(Strict):
    """``accuracy.ENGINE``: tolerances relative to the range that replace the engine's own.

    `sweep` applies to all channels of a sweep.  Where the drives leave degrees of freedom, which
    come to rest, `rest` applies to rates instead.  The other keys apply to channels of dynamics;
    `force` includes moments.
    """

    sweep: RangeShare | None = None
    rest: RangeShare | None = None
    position: RangeShare | None = None
    velocity: RangeShare | None = None
    acceleration: RangeShare | None = None
    force: RangeShare | None = None


class Levels(Strict):
    """The table ``accuracy``."""

    accuracy: dict[str, Accuracy] = Field({})


def fill_defaults(table: TomlTable, file: Path) -> TomlTable:
    """Fill in the runs and channels of a sidecar's table.

    If the table leaves a channel out, the model is compiled and the reference evaluated at two
    samples.  Other faults of the table are left to `Case`.

    Raises
    ------
    InputError
        A channel matches no quantity, or its unit is not known.
    """
    return fill_channels(fill_runs(table, file), file)


def fill_runs(table: TomlTable, file: Path) -> TomlTable:
    """Fill in runs: a sweep and dynamics if a driven case names none, with proofmass's engines.

    Dynamics also gets each engine with its own default settings, which are shown but not checked.
    """
    runs = table.get("run", {"sweep": {}, "dynamics": {}} if "drive" in table else None)
    if not isinstance(runs, dict):
        return table
    recorded = is_recorded(str(table.get("reference", "")))
    own = {} if recorded else {"n": DEFAULT_SAMPLES}
    named = all("solvers" in run for run in runs.values() if isinstance(run, dict))
    there = [] if named else list(default_engines(moves_in_space(table, file)))
    timed = [solver for engine in there for solver in (engine, f"{engine}:default")]
    defaults: TomlTable = {
        "sweep": {**own, "solvers": there},
        "dynamics": {**own, "solvers": timed},
        "equilibrium": {"solvers": there},
    }
    return {
        **table,
        "run": {
            kind: {**defaults.get(kind, {}), **run} if isinstance(run, dict) else run
            for kind, run in runs.items()
        },
    }


def moves_in_space(table: TomlTable, file: Path) -> bool:
    """Whether the reference of a sidecar is of motions in space; an unknown one is not."""
    name = str(table.get("reference", ""))
    try:
        return not is_recorded(name) and find_class(name, file).in_space
    except NoReference:  # `load_reference` reports it
        return False


def fill_channels(table: TomlTable, file: Path) -> TomlTable:
    """Fill in the quantity and the unit of each channel, and channels for sensors not listed.

    Sensors of which no part is listed become channels if ``[channels]`` is left out or has a
    ``"*"``; those that match no quantity are listed in ``unmatched``.
    """
    listed = table.get("channels", {ALL_OTHERS: {}})
    if not isinstance(listed, dict) or not all(isinstance(c, dict) for c in listed.values()):
        return table
    others = listed.get(ALL_OTHERS)
    if others is None and all("equals" in c and "unit" in c for c in listed.values()):
        return table
    if others:
        raise InputError(
            file,
            f'channels."{ALL_OTHERS}"',
            "it stands for all sensors that are not "
            f'listed and has no keys of its own; write "{ALL_OTHERS}" = {{}}',
        )
    bare = Case(
        **{
            **{key: value for key, value in table.items() if key not in TABLES_OF_CHANNELS},
            "channels": {ALL_OTHERS: {"equals": 0.0, "unit": "1"}},
            "file": file,
        }
    )
    bare.require_model()
    check_names(bare, model := compiled_model(bare))
    known = quantity_names(bare)
    found: TomlTable = {}
    for name, channel in listed.items():
        if name == ALL_OTHERS:
            continue
        unit = channel.get("unit") or delivered_unit(bare, model, name)
        if unit is None:
            raise InputError(file, f"channels.{name}.unit", "missing; the model leaves it open")
        equals = channel.get("equals", match_quantity(name, si_or_none(unit), known))
        if equals is None:
            raise InputError(
                file,
                f"channels.{name}.equals",
                f"missing; no quantity of "
                f"{bare.reference} has the name of the sensor; {suggest_names(name, known)}",
            )
        found[name] = {**channel, "equals": equals, "unit": unit}
    unmatched = list[str]()
    sensors = channel_names(model, bare.start) if others is not None else {}
    named = {split_channel(name, sensors)[0] for name in found}
    for sensor in (one for one in sensors if one not in named):
        at_rest = measures_actuator(model, sensor) and not covers_inertia(bare)
        only = {"only": "sweep"} if at_rest else {}
        there = {
            name: {"equals": equals, "unit": unit, **only}
            for name in sensors[sensor]
            if (unit := delivered_unit(bare, model, name))
            and (equals := match_quantity(name, unit, known))
        }
        if not there or (at_rest and "sweep" not in bare.run):
            unmatched.append(sensor)
        else:
            found |= there
    if not found:
        raise InputError(
            file,
            "channels",
            f"no sensor of {bare.model} has the name of a quantity "
            f"of {bare.reference}; {suggest_names('', known)}",
        )
    return {**table, "channels": found, "unmatched": unmatched}


def quantity_names(case: Case) -> list[str]:
    """The names of the reference's quantities."""
    kind = next(iter(case.run))
    few = first_samples(case, prescribed_run(case, kind))
    if isinstance(reference := load_reference(case), Recorded):
        return [*reference.columns, *prescribed_quantities(case, kind, few.x)]
    return list(all_quantities(case, kind, few.x, few.drive, case.parameters))


def si_or_none(unit: str) -> str | None:
    """The SI unit of the same quantity; None for an unknown unit, which `Case` reports."""
    try:
        return si_unit(unit)[0]
    except ValueError:
        return None


def match_quantity(channel: str, unit: str | None, known: list[str]) -> str | None:
    """Find the quantity that has a channel's name, or None.

    The quantity's name may have an underscore instead of the dot, ``_vx`` and ``_ax`` instead of
    ``_velocity.x`` and ``_acceleration.x``, no ``.z`` of an angular rate or acceleration or of a
    moment, and an additional ``_angle`` of an angle.

    >>> match_quantity("pin_velocity.x", "m/s", ["pin_x", "pin_vx"])
    'pin_vx'
    >>> match_quantity("rocker", "rad", ["rocker_rate", "rocker_angle"])
    'rocker_angle'
    """
    name, part = channel.rpartition(".")[::2] if "." in channel else (channel, "")
    names = [channel]
    if part:
        names.append(channel.replace(".", "_"))
    for long, short in ("_velocity", "_v"), ("_acceleration", "_a"):
        if part and name.endswith(long):
            names.append(f"{name.removesuffix(long)}{short}{part}")
    if part == "z" and unit in ("rad/s", "rad/s^2", "N m"):
        names.append(name)
    if not part and unit == "rad":
        names.append(f"{name}_angle")
    return next((each for each in names if each in known), None)


def default_tolerances(case: Case, levels: Mapping[str, Accuracy]) -> list[Tolerance]:
    """The engines' own tolerances for each run of a driven linkage that states none itself.

    Free motions, rods and recorded curves get none, since the engine is not the only cause of their
    errors.

    Raises
    ------
    InputError
        A key of ``accuracy`` applies to no run.
    """
    added, used = list[Tolerance](), set[tuple[str, str]]()
    its_own_alone = case.drive and not (case.rod or case.unchecked or case.recorded)
    for engine in engine_names() if its_own_alone else ():
        for kind, run in case.run.items():
            if engine not in run.solvers or any(t.is_for(kind, engine) for t in case.tolerance):
                continue
            level = levels.get(engine) or Accuracy.model_validate({})
            limits = engine_accuracy(engine)
            for part, units in accuracy_units(case, kind, limits).items():
                if limit := limits.get(part):
                    used.add((engine, part))
                    added.append(
                        Tolerance(
                            run=kind,
                            solver=(engine,),
                            unit=units,
                            abs=None,
                            relative_to_range=getattr(level, part) or limit.relative_to_range,
                            why=limit.why,
                        )
                    )
    for engine, level in levels.items():
        for part in level.model_fields_set:
            if (engine, part) not in used:
                raise case.error(
                    f"accuracy.{engine}.{part}",
                    "it is used by no run: it "
                    "goes with a drive, a closed form or the planar reference, no "
                    "rods, and no [[tolerance]] for the same run and engine",
                )
    return added


def engine_accuracy(engine: str) -> Mapping[str, AccuracyLimit]:
    """The accuracy that an engine states; empty if it cannot be loaded, which its run reports."""
    try:
        return engine_of(engine).accuracy
    except NoEngine:
        return {}


def accuracy_units(
    case: Case, kind: Kind, limits: Mapping[str, AccuracyLimit]
) -> dict[str, tuple[str, ...]]:
    """The keys of an engine's accuracy that apply to a run, and the units that each covers.

    No unit is covered twice.  `limits` are those that the engine states.
    """
    there = [channel.unit for channel in case.channels_of(kind).values()]
    if kind == "equilibrium" or not there:
        return {}
    if kind == "sweep":
        rates = dict.fromkeys(
            unit for unit in there if si_unit(unit)[0] in MOTION_UNITS["velocity"]
        )
        if not (rates and "rest" in limits and leaves_dof(case)):
            return {"sweep": ("*",)}
        others = tuple(unit for unit in dict.fromkeys(there) if unit not in rates)
        return {"rest": tuple(rates), **({"sweep": others} if others else {})}
    units = {
        part: tuple(
            unit
            for unit in dict.fromkeys([*si, *there])
            if unit in there and si_unit(unit)[0] in si
        )
        for part, si in {**MOTION_UNITS, "position": POSITION_UNITS, "force": FORCE_UNITS}.items()
    }
    return {part: of_part for part, of_part in units.items() if of_part}


ONE_LINE_TABLES = ("parameters", "channels", "refine")
"""Tables whose entries are written in one line each; entries of other tables have headings."""
REPEATED_TABLES = ("tolerance", "view", "chart")
"""Tables that a sidecar may have several times."""
ONE_OR_MORE = ("drive", "load")
"""Tables that a sidecar may have several times, but that are written as one table if single."""


def format_sidecar(case: Case, every: bool = True) -> str:
    """Write a case as the text of a sidecar; with the same model it loads to the same case.

    Parameters
    ----------
    case : Case
        From `proofmass.run.sidecar.load_case`.
    every : bool
        Whether to write keys with default values too, such as ``scale = 1.0``.
    """
    import tomlkit  # 0.1 s to load

    table = case.model_dump(
        by_alias=True, exclude_none=True, exclude_defaults=not every, exclude=FIELDS_WITHOUT_KEY
    )
    if case.unmatched:
        table["channels"]["*"] = {}  # lists the unmatched sensors again; no other sensor matches
    for one in table.get("tolerance", ()):
        one |= {k: v[0] for k, v in one.items() if isinstance(v, tuple) and len(v) == 1}
    for key in ONE_OR_MORE:
        if len(table.get(key, ())) == 1:
            (table[key],) = table[key]
    several = {key for key in (*REPEATED_TABLES, *ONE_OR_MORE) if isinstance(table.get(key), tuple)}
    text = tomlkit.document()
    for key, value in table.items():  # keys outside of tables come first in TOML
        if not isinstance(value, Mapping) and key not in several:
            text[key] = write_line(value)
    for key, value in table.items():
        if key in several and value:
            tables = tomlkit.aot()
            tables.extend([write_lines(one) for one in value])
            text[key] = tables
        elif isinstance(value, Mapping) and value:
            single = key in ONE_LINE_TABLES or key in ONE_OR_MORE
            text[key] = (
                write_lines(value) if single else {k: write_lines(v) for k, v in value.items()}
            )
    return tomlkit.dumps(text)


def write_lines(table: Mapping[str, Any]) -> Any:
    """Write a table with a line for each key."""
    import tomlkit

    found = tomlkit.table()
    found.update({key: write_line(value) for key, value in table.items()})
    return found


def write_line(value: Any) -> Any:
    """Write a value in one line, with the tables and lists in it."""
    import tomlkit

    if isinstance(value, Mapping):
        found = tomlkit.inline_table()
        found.update({key: write_line(one) for key, one in value.items()})
        return found
    return [write_line(one) for one in value] if isinstance(value, list | tuple) else value


def load_case(file: Path | str) -> Case:
    """Read a sidecar.

    Parameters
    ----------
    file : path
        ``NAME.toml``; the model is ``NAME.xml`` in its folder unless the sidecar names another.

    Returns
    -------
    Case

    Raises
    ------
    InputError
        The file cannot be read, a key is unknown or missing, a tolerance has no reason, ...
    """
    file = Path(file)
    try:
        given = tomllib.loads(read_text(file))
        if own := FIELDS_WITHOUT_KEY & given.keys():
            raise InputError(file, min(own), "unknown key: no sidecar has it")
        levels = Levels(accuracy=given.get("accuracy", {})).accuracy
        table = {key: value for key, value in given.items() if key != "accuracy"}
        table = convert_parameters(table, file)
        for place, wrong in find_extremes(table):
            raise InputError(file, format_key(place, given), wrong)
        table = {"model": file.stem + ".xml", **table}
        case = Case(**{**fill_defaults(table, file), "file": file})
        if not gives_samples(given):
            case = fit_default_samples(case)
        added = default_tolerances(case, levels)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(file, key_of_error(first, given), describe_invalid(first)) from None
    except RecursionError:
        raise InputError(file, "", "its tables or arrays are nested too deeply") from None
    except (ValueError, OverflowError) as error:
        raise InputError(file, "", f"not TOML: {error}") from None
    case.require_model()
    shared = False
    with suppress(InputError):  # the validation reports a reference that cannot be loaded
        shared = bool((reference := reference_class(case)) and reference.reads_model)
    return case.model_copy(update={"tolerance": (*case.tolerance, *added), "reads_model": shared})


def convert_parameters(table: TomlTable, file: Path) -> TomlTable:
    """The table of a sidecar with the quantities that are written with a unit as numbers in SI.

    They are values of ``parameters``, also of those of ``compare_with`` and of charts, for
    parameters of the reference that are quantities. Other texts stay as they are.

    Raises
    ------
    InputError
        A text is no number with a unit of the parameter's quantity.
    """
    name = table.get("reference")
    if not isinstance(name, str) or is_recorded(name):
        return table
    try:
        known = find_class(name, file).parameters
    except NoReference:  # `load_reference` reports it
        return table

    def convert(part: Any, place: tuple[str | int, ...]) -> Any:
        given = part.get("parameters") if isinstance(part, dict) else None
        if not isinstance(given, dict):
            return part
        found = dict(given)
        for key, text in given.items():
            one = known.get(key)
            if isinstance(text, str) and one and one.is_quantity:
                try:
                    found[key] = read_quantity(text, one.unit)
                except ValueError as error:
                    key = format_key((*place, "parameters", key), table)
                    raise InputError(file, key, f"{one.name} is {error}") from None
        return {**part, "parameters": found}

    table = convert(table, ())
    if isinstance(sets := table.get("compare_with"), dict):
        sets = {key: convert(one, ("compare_with", key)) for key, one in sets.items()}
        table = {**table, "compare_with": sets}
    if isinstance(charts := table.get("chart"), list):
        table = {**table, "chart": [convert(one, ("chart", k)) for k, one in enumerate(charts)]}
    elif charts is not None:
        table = {**table, "chart": convert(charts, ("chart",))}
    return table


LIMITS_OF_RUNS = "timeout", "memory"
"""Keys whose numbers may be of any size, since no run computes with them."""


def find_extremes(
    table: object, place: tuple[str | int, ...] = ()
) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Places of the numbers of a sidecar that no reference computes with, and what is wrong.

    They are larger than `LARGEST`, or smaller than its inverse.  Numbers in lists may be as small
    as they are, since a column may fall to zero.
    """
    if isinstance(table, dict):
        for key, value in table.items():
            if key not in LIMITS_OF_RUNS:
                yield from find_extremes(value, (*place, key))
    elif isinstance(table, list):
        for k, value in enumerate(table):
            if not isinstance(value, float) or abs(value) > LARGEST:
                yield from find_extremes(value, (*place, k))
    elif isinstance(table, (int, float)) and LARGEST < abs(table) < inf:
        number = f"{table:g}" if isinstance(table, float) else f"{str(table)[:9]}..."
        yield place, f"{number} is too large; numbers may be up to {LARGEST:g}"
    elif isinstance(table, float) and 0.0 < abs(table) < 1.0 / LARGEST:
        yield place, f"{table:g} is too small; numbers other than 0 begin at {1.0 / LARGEST:g}"


def gives_samples(table: TomlTable) -> bool:
    """Whether a sidecar's table gives the number of samples of its run in time."""
    runs = table.get("run", {})
    return isinstance(runs, dict) and "n" in runs.get("dynamics", {})


def fit_default_samples(case: Case) -> Case:
    """The case with a number of samples of dynamics that whole steps of the model lead to.

    The default number is kept in a driven run whose step is hardly shorter than the model's, so
    that its samples are at round values of the drive.  The step is that of the first solver.
    """
    if "dynamics" not in case.run or case.recorded or not case.model_path.is_file():
        return case
    try:
        x = run_samples(case, "dynamics")
        step = case.settings.get(case.run["dynamics"].solvers[0], {}).get(
            "timestep", float(compiled_model(case).opt.timestep)
        )
        share = Run("dynamics", x, ()).steps(step)[1] / step
    except Exception:  # the model, the drive or the step is at fault, which the runs report
        return case
    if share >= (MIN_STEP_SHARE if case.drive else 1.0 - STEP_ROUNDING):
        return case
    return case.with_run("dynamics", n=fitting_samples(float(np.ptp(x)), step, x.size))


WRONG_TYPES = {
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "bool_type": "must be true or false",
}
"""What a value must be, by pydantic's types of errors."""


def describe_invalid(error: Mapping[str, Any]) -> str:
    """What is wrong with a value of a sidecar, from an error of pydantic.

    >>> describe_invalid({"type": "float_type", "msg": "", "input": True})
    'must be a number, not true'
    >>> describe_invalid({"type": "float_type", "msg": "", "input": "1.0"})
    'must be a number, not the text "1.0"; leave out the quotation marks'
    """
    if error["type"] == "missing":
        return "missing; it is required"
    wrong, given = WRONG_TYPES.get(error["type"]), error["input"]
    if wrong and isinstance(given, bool | int | float):
        return f"{wrong}, not {str(given).lower()}"
    if wrong and isinstance(given, str):
        hint = "; leave out the quotation marks" if is_number(given) else ""
        return f'{wrong}, not the text "{given}"{hint}'
    text = str(error["msg"])
    if isinstance(given, int | float) and text.startswith("Input "):
        text += f", not {given!r}"
    return text.removeprefix("Value error, ")


def is_number(text: str) -> bool:
    """Whether a text is a number."""
    with suppress(ValueError):
        float(text)
        return True
    return False


def key_of_error(error: Mapping[str, Any], given: TomlTable) -> str:
    """The key of a sidecar at which pydantic found an error.

    Where a value may be of several types, the location of the error has the name of the type too.
    A part of the location is a key if the sidecar has it there, or if it is missing there.

    >>> given = {"drive": {"profile": {"file": "a.csv", "value": {"column": 3}}}}
    >>> place = ("drive", 0, "profile", "ProfileTable", "value", "RecordedColumn", "column")
    >>> key_of_error({"type": "string_type", "loc": place}, given)
    'drive.profile.value.column'
    """
    place = list[str | int]()
    here: Any = given
    for part in error["loc"]:
        if isinstance(part, int):
            here = here[part] if isinstance(here, list) and part < len(here) else here
        elif isinstance(here, dict) and part in here:
            here = here[part]
        else:
            continue
        place.append(part)
    missing = error["loc"][-1:] if error["type"] == "missing" else ()
    return format_key([*place, *missing], given)


UNNUMBERED = "drive", "load", "view", "chart"
"""Lists of tables whose only table has no number in the key of an error."""


def format_key(place: Sequence[str | int], given: Mapping[str, object]) -> str:
    """The key of a place in a sidecar, as in an error.

    A single table has no number; nor has the only one of a list of drives, loads, views or charts,
    which has none in `Case.table_key` either.

    >>> format_key(["drive", 0, "to"], {"drive": {"to": "far"}})
    'drive.to'
    >>> format_key(["drive", 0, "to"], {"drive": [{"to": "far"}]})
    'drive.to'
    >>> format_key(["drive", 0, "to"], {"drive": [{"to": "far"}, {"to": 1.0}]})
    'drive.0.to'
    """
    table = given.get(str(place[0])) if place else None
    is_only = isinstance(table, list) and len(table) == 1 and place[0] in UNNUMBERED
    is_single = isinstance(table, dict) or is_only
    numbered = len(place) > 1 and isinstance(place[1], int)
    parts = [*place[:1], *place[2:]] if is_single and numbered else place
    return ".".join(map(str, parts))
