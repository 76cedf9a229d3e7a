"""Compilation of an MJCF file; both simulators start from the compiled numbers.

MuJoCo reads a NaN as a zero and only warns.  A handler here receives its warnings, so that MuJoCo
writes no MUJOCO_LOG.TXT into the user's folder: within `collected_warnings` they are collected,
otherwise they go to standard error.  `warning_notes` makes remarks of them for those who run the
model.
"""

import os
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import local
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from proofmass.analytic.contacts import is_mixed
from proofmass.analytic.names import equality_name
from proofmass.analytic.numerics import LARGEST
from proofmass.base.files import read_bytes
from proofmass.base.lines import COMMENT
from proofmass.base.worker import BROKEN_ENGINES
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Rod
from proofmass.sim.rods import compile_with_rods

DISABLE_BITS = mujoco.mjtDisableBit
CONSTRAINT_FIELDS = {
    DISABLE_BITS.mjDSBL_EQUALITY: ("eq_active0",),
    DISABLE_BITS.mjDSBL_FRICTIONLOSS: ("dof_frictionloss", "tendon_frictionloss"),
    DISABLE_BITS.mjDSBL_LIMIT: ("jnt_limited", "tendon_limited"),
}
DISABLED_FIELDS = {
    DISABLE_BITS.mjDSBL_CONSTRAINT: tuple(
        field for own in CONSTRAINT_FIELDS.values() for field in own
    ),
    **CONSTRAINT_FIELDS,
    DISABLE_BITS.mjDSBL_SPRING: (
        "jnt_stiffness",
        "jnt_stiffnesspoly",
        "tendon_stiffness",
        "tendon_stiffnesspoly",
    ),
    DISABLE_BITS.mjDSBL_DAMPER: (
        "dof_damping",
        "dof_dampingpoly",
        "tendon_damping",
        "tendon_dampingpoly",
    ),
}
ELEMENT = re.compile(r"<(\w+)((?:\s+[\w:.-]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*)\s*/?>")
ATTRIBUTE = re.compile(r"([\w:.-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
ATTACHED_FILE = re.compile(rb"<(?:model|include)\b[^>]*?\bfile\s*=\s*([\"'])([^\"'\0]+)\1")
NAN = re.compile(r"[+-]?nan(\(\w*\))?", re.IGNORECASE)
# prefixes of fields whose numbers runs use
FATAL_WARNINGS = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
    mujoco.mjtWarning.mjWARN_INERTIA,
)
"""Warnings of MuJoCo after which a run is invalid."""
NUMBER_PREFIXES = (
    *("actuator_", "body_", "dof_", "eq_", "geom_", "jnt_", "key_", "qpos", "site_", "tendon_"),
)
UNLIMITED_SUFFIXES = ("range", "margin")  # suffixes of fields that may be infinite, for no limit

_thread = local()


def _warn(message: str) -> None:
    """Handle a warning of MuJoCo: collect it in this thread, or print it to standard error."""
    collected = getattr(_thread, "warnings", None)
    if collected is None:
        print(f"MuJoCo: {message}", file=sys.stderr)
    else:
        collected[message] = None


mujoco.set_mju_user_warning(_warn)


@contextmanager
def collected_warnings() -> Iterator[dict[str, None]]:
    """Collect MuJoCo's warnings in this thread while the context is open, each once.

    A context around it gets them as well.
    """
    around = getattr(_thread, "warnings", None)
    _thread.warnings = found = dict[str, None]()
    try:
        yield found
    finally:
        _thread.warnings = around
        if around is not None:
            around.update(found)


@contextmanager
def python_warnings_as_mujoco() -> Iterator[None]:
    """Handle Python's warnings as those of MuJoCo: a ``MjSpec`` that is compiled warns by these."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        yield
    for one in found:
        _warn(str(one.message))


def compile_model(path: Path, rods: Sequence[Rod] = ()) -> mujoco.MjModel:
    """Compile a model, completed with rods; an error says in one line why that failed.

    Numbers of what the model's flags disable are zero; see `leave_out_disabled`.

    Raises
    ------
    BadModel
        The path is no file, the file is malformed, or a number is NaN or infinite.
    BadRod
        A rod cannot be built.
    MemoryError
        The model needs more memory than is available.
    """
    if not path.is_file():
        raise BadModel(f"{path.name}: no such file, or no regular file")
    with collected_warnings() as collected:
        refuse_self_attachment(path)
        try:
            if rods:
                with python_warnings_as_mujoco():
                    model = compile_with_rods(read_spec(path), rods)
            else:
                model = mujoco.MjModel.from_xml_path(os.fsencode(path))
        except (ValueError, mujoco.FatalError) as error:
            refuse_nan(path, collected)
            raise refusal(error, f"{path.name}: ") from None
        except RuntimeError as error:  # an exception of C++, whose message MuJoCo drops
            # in MuJoCo 4.0.0 the next model that causes a warning would hang
            BROKEN_ENGINES.add("MuJoCo")
            raise BadModel(
                f"{path.name}: MuJoCo cannot compile it and says no more than "
                f'"{error}"; it does so where there is no memory for a model as '
                f"large, such as one with a height field of 1e6 rows"
            ) from None
    refuse_nan(path, collected)
    return require_usable(model, path.name, path)


def require_usable(model: mujoco.MjModel, name: str, path: Path | None = None) -> mujoco.MjModel:
    """The compiled model itself, without the numbers of what its flags disable.

    Parameters
    ----------
    model : MjModel
        It is changed in place, see `leave_out_disabled`.
    name : str
        What messages call it.
    path : Path, optional
        Its MJCF file, in which a wrong number is looked for.

    Raises
    ------
    BadModel
        A number is not finite or too large, or a name is not in UTF-8.
    """
    if not model.opt.timestep > 0:
        raise BadModel(f"{name}: <option>: timestep {model.opt.timestep:g} is not positive")
    if (oversized := oversized_number(model)) is not None:
        if where := path and locate_number(path, is_infinite):
            raise BadModel(f"{name}: {where} is not finite")
        field, value = oversized
        where = (path and locate_number(path, is_oversized)) or (
            f"{field} has the number {value:g}, which"
        )
        raise BadModel(f"{name}: {where} is too large; numbers may be up to {LARGEST:g}")
    try:
        model.names.decode()
    except UnicodeDecodeError as error:
        raise BadModel(
            f"{name}: the byte 0x{error.object[error.start]:02x} of a name is not "
            f"UTF-8; save the file as UTF-8"
        ) from None
    leave_out_disabled(model)
    return model


def read_spec(path: Path) -> mujoco.MjSpec:
    """Read a model that is not compiled yet; its path may have bytes that are not UTF-8."""
    return mujoco.MjSpec.from_file(os.fsencode(path))


def refuse_self_attachment(path: Path) -> None:
    """Raise `BadModel` if a model attaches itself, by which MuJoCo 4.0.0 overflows its stack."""
    trail, done = [Path(os.path.abspath(path))], set[Path]()

    def visit(file: Path) -> None:
        done.add(file)
        text = COMMENT.sub(b"", read_bytes(file))
        for _, name in ATTACHED_FILE.findall(text):
            places = [folder / os.fsdecode(name) for folder in (file.parent, trail[0].parent)]
            attached = next((Path(os.path.abspath(p)) for p in places if p.is_file()), None)
            if attached and any(map(attached.samefile, trail)):
                chain = [one.name for one in (*trail, attached)]
                raise BadModel(
                    f"{path.name}: <model file={os.fsdecode(name)!r}> attaches a model to itself: "
                    f"{' > '.join(chain)}"
                )
            if attached and attached not in done:
                trail.append(attached)
                visit(attached)
                trail.pop()

    if any(tag in read_bytes(path) for tag in (b"<model", b"<include")):
        visit(trail[0])


def compiles(path: Path) -> bool:
    """Whether MuJoCo itself compiles a file, even if `compile_model` refuses it."""
    try:
        mujoco.MjModel.from_xml_path(os.fsencode(path))
    except (ValueError, mujoco.FatalError):
        return False
    return True


def refusal(error: Exception, file: str = "") -> BadModel | MemoryError:
    """A fatal error of MuJoCo as a `MemoryError`, or else as a `BadModel` with its message."""
    if "allocate memory" in str(error):
        return MemoryError()
    return BadModel(f"{file}{' '.join(str(error).split())}")


def read_tree(path: Path) -> Element:
    """The elements of an MJCF file, without its comments, which need not be well-formed XML.

    Raises
    ------
    BadModel
        The file is not well-formed XML elsewhere; MuJoCo accepts text and bytes that XML forbids.
    """
    try:
        return ElementTree.fromstring(COMMENT.sub(b"", path.read_bytes()))
    except ElementTree.ParseError as error:
        raise BadModel(
            f"{path.name}: to be changed it must be well-formed XML in UTF-8: {error}, "
            f"comments not counted"
        ) from None


def insert_includes(parent: Element, folder: Path) -> None:
    """Replace ``<include>`` elements by the elements of the included files, in place."""
    for place, child in reversed(list(enumerate(parent))):
        if child.tag == "include":
            there = read_tree(folder / child.get("file", ""))
            insert_includes(there, folder)
            parent[place : place + 1] = list(there)
        else:
            insert_includes(child, folder)


def with_attributes(path: Path, changes: Mapping[str, Mapping[str, Any] | None]) -> str:
    """The text of an MJCF file with changed attributes of some elements.

    Numbers are written with all their digits; MuJoCo's own writer would round them to six.

    Parameters
    ----------
    path : Path
    changes : mapping
        Attributes by element.  An element is given by its tag and name, and tags below it, such as
        ``site pin``, ``body crank/inertial`` or ``body crank/geom``.  Values of attributes are
        texts or numbers; None in place of attributes removes all such elements.

    Returns
    -------
    str

    Raises
    ------
    BadModel
        The file cannot be read, or has no such element.
    """
    root = read_tree(path)
    parents = {child: parent for parent in root.iter() for child in parent}
    for place, attributes in changes.items():
        steps = [step.partition(" ") for step in place.split("/")]
        found = root.findall(".//" + "/".join(f"{t}[@name='{n}']" if n else t for t, _, n in steps))
        if not found:
            raise BadModel(f"{path.name}: there is no element {place!r}")
        for element in found:
            if attributes is None:
                parents[element].remove(element)
                continue
            for key, value in attributes.items():
                values = [value] if isinstance(value, str) else np.ravel(value).tolist()
                element.set(key, " ".join(map(str, values)))
    return ElementTree.tostring(root, encoding="unicode")


def leave_out_disabled(model: mujoco.MjModel) -> None:
    """Set to zero, in place, the numbers of what the model's disable flags turn off.

    MuJoCo keeps these numbers and ignores them when it steps.  Other code that reads them, such as
    the correction of a sensor for gravity or the copy of a spring in another engine, would have to
    check the flag each time.  Flags of actuators need no change, since only the engine itself
    computes their forces.
    """
    for flag, fields in DISABLED_FIELDS.items():
        if model.opt.disableflags & int(flag):
            for field in fields:
                getattr(model, field)[:] = 0
    if model.opt.disableflags & int(DISABLE_BITS.mjDSBL_GRAVITY):
        model.opt.gravity[:] = 0


def refuse_nan(path: Path, collected: Iterable[str]) -> None:
    """Raise `BadModel` if MuJoCo warned of a NaN."""
    if any("NaN" in message for message in collected):
        where = locate_number(path, is_nan) or "a number in it, or in a file that it includes,"
        raise BadModel(f"{path.name}: {where} is not a number")


SOLREF_FIELDS = {
    "jnt_solref": "joint",
    "dof_solref": "joint",
    "geom_solref": "geom",
    "pair_solref": "pair",
    "eq_solref": "equality",
    "tendon_solref_lim": "tendon",
    "tendon_solref_fri": "tendon",
}
"""Fields with numbers that MuJoCo replaces if their format is mixed, and the elements they are of.
"""


def warning_notes(model: mujoco.MjModel, collected: Iterable[str]) -> tuple[str, ...]:
    """Warnings of MuJoCo as remarks, a sentence each; with the elements of a mixed `solref`.

    Those that have a time report a state that is not finite, which makes a run fail by itself.
    """
    notes = []
    for message in (one for one in collected if "Time = " not in one):
        names = ", ".join(mixed_solrefs(model)) if "solref" in message else ""
        said = " ".join(message.split()).rstrip(".")
        notes.append(f"MuJoCo warns: {said}{f' ({names})' if names else ''}.")
    return tuple(notes)


def failure_warning(data: mujoco.MjData) -> str:
    """The first warning that makes a run invalid, such as of a reset state; empty if none."""
    return next(
        (
            f"MuJoCo warning {warning.name[7:].lower()}"
            for warning in FATAL_WARNINGS
            if data.warning[warning].number
        ),
        "",
    )


def mixed_solrefs(model: mujoco.MjModel) -> Iterator[str]:
    """The elements with a `solref` of which one number is positive and the other is not."""
    for field, word in SOLREF_FIELDS.items():
        for k, (first, second) in enumerate(getattr(model, field)[:, :2].tolist()):
            if is_mixed(first, second):
                number = int(model.dof_jntid[k]) if field == "dof_solref" else k
                own = equality_name(model, k) if word == "equality" else ""
                yield f"{word} {own or getattr(model, word)(number).name!r}: {first:g} {second:g}"


def oversized_number(model: mujoco.MjModel) -> tuple[str, float] | None:
    """The first field that runs use with a number that is not finite, or larger than `LARGEST`.

    Its name and the number are returned; None if there is no such field.
    """
    numbers = {"option": np.array([model.opt.timestep, *model.opt.gravity])}
    numbers |= {name: getattr(model, name) for name in number_fields()}
    for name, values in numbers.items():
        wrong = values[~(np.abs(values) <= LARGEST)]
        if wrong.size:
            return name, float(wrong[0])
    return None


@cache
def number_fields() -> tuple[str, ...]:
    """The fields of a compiled model that have numbers which runs use; they are those of all."""
    model = mujoco.MjSpec().compile()
    return tuple(
        name
        for name in dir(model)
        if name.startswith(NUMBER_PREFIXES)
        and not name.endswith(UNLIMITED_SUFFIXES)
        and getattr(model, name).dtype == np.float64
    )


def is_nan(word: str) -> bool:
    """Whether a word of an attribute is no number for MuJoCo."""
    return NAN.fullmatch(word) is not None


def is_infinite(word: str) -> bool:
    """Whether a word of an attribute stands for infinity."""
    return word.lower().lstrip("+-") in ("inf", "infinity")


def is_oversized(word: str) -> bool:
    """Whether a word of an attribute is a number that is larger than `LARGEST`."""
    try:
        return abs(float(word)) > LARGEST
    except ValueError:
        return False


def locate_number(path: Path, is_wrong: Callable[[str], bool]) -> str:
    """The first attribute of a file with a number that a predicate finds wrong.

    It is given as ``<geom name='rod'>: pos='nan 0 0'``, or empty if there is none, as when an
    included file has it.  The file is read by patterns, since MuJoCo accepts files that a strict
    reader of XML does not.
    """
    text = COMMENT.sub(b"", path.read_bytes()).decode(errors="replace")
    for tag, attributes in ELEMENT.findall(text):
        found = {key: one or other for key, one, other in ATTRIBUTE.findall(attributes)}
        for key, value in found.items():
            if key not in ("name", "class") and any(map(is_wrong, value.split())):
                named = f" name={found['name']!r}" if "name" in found else ""
                return f"<{tag}{named}>: {key}={value!r}"
    return ""
