"""Compiling an MJCF file; both simulators start from the compiled numbers.

MuJoCo reads a NaN as a zero and only warns.  Its warnings come here, so that no MUJOCO_LOG.TXT is
written into the user's folder: while a model is compiled they are collected, otherwise they go to
standard error.
"""

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import local
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from proofmass.sim.protocol import BROKEN, BadModel, Rod
from proofmass.sim.rods import compile_with_rods

NATIVE = "mujoco"
"""The engine whose format MJCF is: it runs any model as it is, and poses the drawings."""
OFF = mujoco.mjtDisableBit
CONSTRAINTS = {
    OFF.mjDSBL_EQUALITY: ("eq_active0",),
    OFF.mjDSBL_FRICTIONLOSS: ("dof_frictionloss", "tendon_frictionloss"),
    OFF.mjDSBL_LIMIT: ("jnt_limited", "tendon_limited"),
}
LEFT_OUT = {
    OFF.mjDSBL_CONSTRAINT: tuple(field for own in CONSTRAINTS.values() for field in own),
    **CONSTRAINTS,
    OFF.mjDSBL_SPRING: (
        "jnt_stiffness",
        "jnt_stiffnesspoly",
        "tendon_stiffness",
        "tendon_stiffnesspoly",
    ),
    OFF.mjDSBL_DAMPER: ("dof_damping", "dof_dampingpoly", "tendon_damping", "tendon_dampingpoly"),
}
COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
ELEMENT = re.compile(r"<(\w+)((?:\s+[\w:.-]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*)\s*/?>")
ATTRIBUTE = re.compile(r"([\w:.-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
NOT_FINITE = {
    "NaN": re.compile(r"[+-]?nan(\(\w*\))?", re.IGNORECASE),
    "infinite": re.compile(r"[+-]?inf(inity)?", re.IGNORECASE),
}
NUMBERS = ("body_", "dof_", "eq_", "jnt_", "key_", "qpos", "site_")  # that every run computes with
LIMITS = ("range", "margin")  # numbers that may be infinite: there is no limit

_thread = local()


def _warn(message: str) -> None:
    """Take a warning of MuJoCo."""
    collected = getattr(_thread, "warnings", None)
    if collected is None:
        print(f"MuJoCo: {message}", file=sys.stderr)
    else:
        collected.append(message)


mujoco.set_mju_user_warning(_warn)


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """Collect what MuJoCo warns of meanwhile, in this thread."""
    _thread.warnings = found = list[str]()
    try:
        yield found
    finally:
        _thread.warnings = None


def compile_model(path: Path, rods: Sequence[Rod] = ()) -> mujoco.MjModel:
    """Compile a model, completed with rods, or say in one line why it does not.

    What its flags disable is left out of the compiled numbers; see `leave_out_disabled`.

    Raises
    ------
    BadModel
        Not a file, malformed, or with a number that is NaN or infinite.
    BadRod
        A rod that cannot be built.
    MemoryError
        The model is larger than the memory there is.
    """
    if not path.is_file():
        raise BadModel(f"{path.name}: no such file, or no regular file")
    with collected_warnings() as warnings:
        try:
            if rods:
                model = compile_with_rods(mujoco.MjSpec.from_file(str(path)), rods)
            else:
                model = mujoco.MjModel.from_xml_path(str(path))
        except (ValueError, mujoco.FatalError) as error:
            refuse_numbers(path, warnings)
            raise refusal(error, f"{path.name}: ") from None
        except RuntimeError as error:  # of C++, which MuJoCo passes on without its words
            BROKEN.add("MuJoCo")  # the next model of which it warns would hang, in MuJoCo 4.0.0
            raise BadModel(
                f"{path.name}: MuJoCo cannot compile it and says no more than "
                f'"{error}"; it does so where there is no memory for a model as '
                f"large, such as one with a height field of 1e6 rows"
            ) from None
    refuse_numbers(path, warnings)
    if not model.opt.timestep > 0:
        raise BadModel(f"{path.name}: <option>: timestep {model.opt.timestep:g} is not positive")
    if array := infinite(model):
        raise BadModel(f"{path.name}: {place(path, 'infinite') or array} is not finite")
    try:
        model.names.decode()
    except UnicodeDecodeError as error:
        raise BadModel(
            f"{path.name}: the byte 0x{error.object[error.start]:02x} of a name is not "
            f"UTF-8; save the file as UTF-8"
        ) from None
    leave_out_disabled(model)
    return model


def compiles(path: Path) -> bool:
    """Whether MuJoCo itself takes a file, whatever `compile_model` says of it."""
    try:
        mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError):
        return False
    return True


def refusal(error: Exception, file: str = "") -> BadModel | MemoryError:
    """What MuJoCo says when it takes a model no further, as the error that it is."""
    if "allocate memory" in str(error):
        return MemoryError()
    return BadModel(f"{file}{' '.join(str(error).split())}")


def read_tree(path: Path) -> Element:
    """The elements of an MJCF file, also of one whose comments a strict reader of XML refuses.

    Raises
    ------
    BadModel
        It is no strict XML in another place: MuJoCo takes text and bytes that XML does not.
    """
    try:
        return ElementTree.fromstring(COMMENT.sub(b"", path.read_bytes()))
    except ElementTree.ParseError as error:
        raise BadModel(
            f"{path.name}: to be changed it must be well-formed XML in UTF-8: {error}, "
            f"comments not counted"
        ) from None


def with_attributes(path: Path, changes: Mapping[str, Mapping[str, Any] | None]) -> str:
    """The text of an MJCF file with other attributes of some elements.

    Numbers are written with all their digits, which MuJoCo's own writer rounds to six.

    Parameters
    ----------
    path : Path
    changes : mapping
        By element, such as ``site pin``, ``body crank/inertial`` or ``body crank/geom``: tag and
        name, and tags below it. Its attributes, texts or numbers; None removes all such elements.

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

    MuJoCo keeps these numbers and passes over them when it steps.  Whoever else reads them, the
    gravity that is taken off a sensor or a spring that is rebuilt in another engine, would have to
    ask for the flag each time.  Flags of actuators need nothing: their forces are the engine's own.
    """
    for flag, fields in LEFT_OUT.items():
        if model.opt.disableflags & int(flag):
            for field in fields:
                getattr(model, field)[:] = 0
    if model.opt.disableflags & int(OFF.mjDSBL_GRAVITY):
        model.opt.gravity[:] = 0


def refuse_numbers(path: Path, warnings: Sequence[str]) -> None:
    """Raise `BadModel` if MuJoCo warned of a NaN."""
    if any("NaN" in message for message in warnings):
        where = place(path, "NaN") or "a number in it, or in a file that it includes,"
        raise BadModel(f"{path.name}: {where} is not a number")


def infinite(model: mujoco.MjModel) -> str:
    """The first array of a compiled model with an infinite number that a run computes with."""
    if not np.isfinite([model.opt.timestep, *model.opt.gravity]).all():
        return "option"
    names = (name for name in dir(model) if name.startswith(NUMBERS) and not name.endswith(LIMITS))
    for name in names:
        values = getattr(model, name)
        if values.dtype.kind == "f" and np.isinf(values).any():
            return name
    return ""


def place(path: Path, what: str) -> str:
    """The first attribute of a file with such a number: ``<geom name='rod'>: pos='nan 0 0'``.

    Empty if there is none, as when an included file has it.  The file is read by patterns, since
    MuJoCo takes files that a strict reader of XML does not.
    """
    text = COMMENT.sub(b"", path.read_bytes()).decode(errors="replace")
    for tag, attributes in ELEMENT.findall(text):
        found = {key: one or other for key, one, other in ATTRIBUTE.findall(attributes)}
        for key, value in found.items():
            if key not in ("name", "class") and any(map(NOT_FINITE[what].fullmatch, value.split())):
                named = f" name={found['name']!r}" if "name" in found else ""
                return f"<{tag}{named}>: {key}={value!r}"
    return ""
