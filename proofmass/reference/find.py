"""Find the reference of a case: an entry point, a program beside the sidecar, or recorded rows.

An entry point of the group ``proofmass.references`` names a subclass of `Reference`.  A program is
a Python file beside the sidecar, ``reference = "yoke.py"``, in which one such class is defined.  It
is code, and runs when the sidecar is loaded. So a command runs it only if the user names the
sidecar, and not because it lies in a folder that is searched.
"""

import inspect
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

from proofmass.analytic.protocol import Reference
from proofmass.base.entry_points import (
    NotLoaded,
    distribution_of,
    entry_points_of,
    load_entry_point,
)
from proofmass.base.errors import suggest_names
from proofmass.base.files import content_key
from proofmass.base.read_once import read_once
from proofmass.base.recorded import (
    IMPORTED_ENDINGS,
    RecordingTable,
    import_hint,
    read_table,
)
from proofmass.base.recording import Recorded
from proofmass.base.units import si_unit
from proofmass.case.case import Case
from proofmass.case.inputs import is_program

REFERENCE_GROUP = "proofmass.references"


class NoReference(ValueError):
    """No reference has that name, or it cannot be loaded; the message says why."""


def reference_names() -> list[str]:
    """The names of all references that are installed, those of this distribution first."""
    return list(entry_points_of(REFERENCE_GROUP))


@cache
def find_reference(name: str) -> type[Reference]:
    """Load a reference by its name.

    Raises
    ------
    NoReference
        No distribution has it, or two have; it cannot be loaded, or it is no `Reference`.
    """
    there = entry_points_of(REFERENCE_GROUP).get(name, ())
    if not there:
        if Path(name).suffix.lower() in IMPORTED_ENDINGS:
            raise NoReference(f"{name!r} is no CSV; {import_hint(Path(name))}")
        raise NoReference(
            f"no reference {name!r}; {suggest_names(name, sorted(reference_names()))}; or name a "
            "recorded curve NAME.csv or a program NAME.py"
        )
    if len(there) > 1:
        both = " and ".join(f"{one.value} of {distribution_of(one)}" for one in there)
        raise NoReference(f"two references have the name {name!r}: {both}; remove one of them")
    try:
        found = load_entry_point(there[0], "reference")
    except NotLoaded as error:
        raise NoReference(str(error)) from error
    if not (isinstance(found, type) and issubclass(found, Reference)):
        raise NoReference(
            f"reference {name!r}, of {distribution_of(there[0])}: {there[0].value} is no class of "
            "proofmass.analytic.protocol.Reference"
        )
    return checked(found)


def load_reference(case: Case) -> type[Reference] | Recorded:
    """Load the class of a case's reference, or read its recorded rows.

    Raises
    ------
    InputError
        There is no such reference, or it cannot be loaded or read.
    """
    file = case.file.parent / case.reference
    if case.recorded:
        settings = case.recording.model_dump_json() if case.recording else "{}"
        try:
            return read_recorded(file, settings)
        except ValueError as error:
            raise case.error("recording", str(error)) from None
    try:
        return find_class(case.reference, case.file)
    except NoReference as error:
        raise case.error("reference", str(error)) from None


@read_once()
def read_recorded(file: Path, settings: str) -> Recorded:
    """The rows of a recorded reference; `settings` is the table ``recording`` as JSON."""
    return Recorded(read_table(file), RecordingTable.model_validate_json(settings))


def reference_class(case: Case) -> type[Reference] | None:
    """The class of a case's reference; None for recorded rows."""
    found = load_reference(case)
    return None if isinstance(found, Recorded) else found


def covers_inertia(case: Case) -> bool:
    """Whether the reference can include inertia in moments and forces."""
    found = reference_class(case)
    return found is not None and found.covers_inertia


def assembly_modes(case: Case) -> tuple[int, ...]:
    """Assembly modes that the reference offers; empty if it offers no choice."""
    found = reference_class(case)
    return () if found is None else found.modes()


def parameter_unit(case: Case, parameter: str) -> str:
    """The SI unit of a parameter of the reference; empty if it has none."""
    found = reference_class(case)
    if found is None or parameter not in found.parameters:
        return ""
    return found.parameters[parameter].unit


def find_class(name: str, sidecar: Path) -> type[Reference]:
    """The class of the reference that a sidecar names, installed or beside it.

    Raises
    ------
    NoReference
        There is none, or it cannot be loaded.
    """
    if not is_program(name):
        return find_reference(name)
    if Path(name).name != name:
        raise NoReference(f"the program {name} must be in the folder of the sidecar")
    return find_program(sidecar.parent / name)


def find_program(file: Path) -> type[Reference]:
    """The reference that a program beside a sidecar defines.

    Raises
    ------
    NoReference
        It is not there, it fails, or it does not define one reference.
    """
    if not file.is_file():
        raise NoReference(f"no such program {file.name}")
    return run_program(file)


@read_once()
def run_program(file: Path) -> type[Reference]:
    """Do what `find_program` does, once for each content of a file."""
    module = import_program(file, f"proofmass_program_{content_key(file)}_{file.stem}")
    own = [
        one
        for one in vars(module).values()
        if isinstance(one, type)
        and issubclass(one, Reference)
        and one.__module__ == module.__name__
    ]
    if len(own) != 1:
        names = ", ".join(one.__name__ for one in own) or "none"
        raise NoReference(
            f"{file.name} must define one class of proofmass.analytic.protocol.Reference; it "
            f"defines {names}"
        )
    return checked(own[0])


def import_program(file: Path, name: str) -> ModuleType:
    """Run a Python file as a module of that name; nothing is written, and no path is searched."""
    module = ModuleType(name)
    module.__file__ = str(file)
    sys.modules[name] = module  # where pickle and dataclasses find its classes
    try:
        exec(compile(file.read_bytes(), str(file), "exec"), module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        line = last_line(error, file)
        raise NoReference(
            f"{file.name} cannot be loaded{line}: {type(error).__name__}: {error}"
        ) from error
    return module


def last_line(error: BaseException, file: Path) -> str:
    """Where in a file an error was raised: ``, line 3``; empty if it was elsewhere."""
    if isinstance(error, SyntaxError) and error.lineno:
        return f", line {error.lineno}"
    lines = [0]
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(file):
            lines.append(trace.tb_lineno)
        trace = trace.tb_next
    return f", line {lines[-1]}" if lines[-1] else ""


def source_file(reference: type[Reference]) -> Path:
    """The Python file that defines a reference."""
    return Path(inspect.getfile(reference))


def is_shipped(reference: type[Reference]) -> bool:
    """Whether proofmass itself has a reference, so that its errors are no input of the user."""
    return reference.__module__.partition(".")[0] == "proofmass"


def place_of_error(error: BaseException, reference: type[Reference]) -> str:
    """Where in the file of somebody's own reference an error was raised: ``yoke.py, line 3``.

    Empty for a reference of proofmass, and for an error that was raised outside that file.
    """
    if is_shipped(reference):
        return ""
    file = source_file(reference)
    line = last_line(error, file)
    return f"{file.name}{line}" if line else ""


def checked(reference: type[Reference]) -> type[Reference]:
    """The class of a reference if it is complete.

    Raises
    ------
    NoReference
        It has no method `solve`, a method takes other arguments, or the unit of a parameter is
        unknown.
    """
    if reference.solve is Reference.solve:
        raise NoReference(f"{reference.__name__} has no method solve")
    for method in ("solve", "properties"):
        try:
            inspect.signature(getattr(object.__new__(reference), method)).bind("motion", "ask")
        except TypeError:
            here = inspect.signature(getattr(reference, method))
            raise NoReference(
                f"{source_file(reference).name}: {reference.__name__}.{method} takes "
                f"(self, motion, ask); here: {here}"
            ) from None
    for one in reference.parameters.values():
        try:
            si_unit(one.unit or "1")
        except ValueError as error:
            raise NoReference(f"{reference.__name__}.{one.name}: {error}") from None
    return reference
