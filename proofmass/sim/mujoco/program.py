"""Writing of a dynamics run of MuJoCo as a Python program that needs only MuJoCo and NumPy.

The links of rods are written as elements of an MJCF with all digits of their numbers, since
MuJoCo's own writer rounds numbers to six digits.
"""

import base64
import json
import re
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import indent, wrap
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.contents import control_indices, joint_of
from proofmass.sim.mjcf import collected_warnings, insert_includes, read_spec, read_tree
from proofmass.sim.mujoco.dynamics import FLYWHEEL_RATIO, initialize_dynamics
from proofmass.sim.mujoco.linkage import Linkage
from proofmass.sim.mujoco.model import Recorder, is_acceleration, load
from proofmass.sim.mujoco.sensors import drive_sensors, withhold_drives
from proofmass.sim.mujoco.settings import (
    SETTING_PLACES,
    SOFTNESS_SETTINGS,
    last_section,
    limit_softness,
    mjcf_text,
    read_options,
    write_limits,
    write_options,
)
from proofmass.sim.mujoco.snippet import insert_snippet, write_snippet
from proofmass.sim.program_text import escape_text, load_template
from proofmass.sim.protocol.curves import drive_columns
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.programs import Imposed, Programs
from proofmass.sim.protocol.run import Rod, Run
from proofmass.sim.protocol.settings import ParameterValues
from proofmass.sim.rods import chain, compile_with_rods

IMPOSED = (
    Imposed("flywheel"),
    *(Imposed("servo", gain) for gain in (2.0, 1.0, 0.5, 0.2)),
    *(Imposed("equality", gain) for gain in (0.5, 0.25, 0.1)),
)
"""How a program may impose a motion: by a flywheel on the joint, so heavy that no force in the
model disturbs it, with the torque that moves the flywheel; by a position servo with the natural
frequency gain / step and critical damping; or by an equality that constrains the joint to its
target, with the time constant step / gain."""
DISABLING_FLAGS = {"servo": ("actuation",), "equality": ("equality", "constraint")}
"""Flags of a model that disable a drive of this kind."""
CLEARED_ATTRIBUTES = {"option/flag": ("energy",), "sensor/*": ("cutoff", "delay", "interval")}
"""Attributes that programs leave out, by the path of their elements."""
EXTRA_STATE = "act", "mocap_pos", "mocap_quat", "xfrc_applied"
"""Arrays of the initial state that a program sets in addition to positions, rates and controls: the
others that a key may set, and the dead loads of rods."""
DRIVE_SOLIMP = (0.9999, 0.9999, 0.001)  # solimp of an equality that imposes a motion
FILE_FOLDERS = {
    "mesh": "meshdir",
    "hfield": "assetdir",
    "texture": "texturedir",
    "skin": "assetdir",
}
MAX_EMBEDDED_BYTES = 1_000_000
"""Bytes of meshes and other files that a program contains; larger ones it reads by their paths."""
MAX_INDENT = 24
"""Largest indentation of a line of a model, in columns."""
MAX_COLUMNS = 100
"""Width of a program in columns; only lines that cannot be broken are wider."""
ACTUATOR_TAGS = (
    "general",
    "motor",
    "position",
    "velocity",
    "intvelocity",
    "damper",
    "cylinder",
    "muscle",
    "adhesion",
    "dcmotor",
    "plugin",
)


class MujocoPrograms(Programs):
    """Settings as MJCF, and programs that need only MuJoCo and NumPy."""

    imposed = IMPOSED

    def write_snippet(
        self, parameters: ParameterValues, steps: int, model: Path | None = None
    ) -> str:
        """Settings as MJCF; see `proofmass.sim.mujoco.snippet.write_snippet`."""
        return write_snippet(parameters, model)

    def write_comment(self, text: str) -> str:
        """Text as a comment of MJCF."""
        return f"<!--\n{indent(text, '  ')}\n-->"

    def insert_snippet(
        self, model: Path, parameters: ParameterValues, steps: int
    ) -> tuple[str, set[str]]:
        """The model with the snippet in it, which states all settings but `settled` and `flex`."""
        text = insert_snippet(model, write_snippet(parameters, model))
        return text, {*SETTING_PLACES, "defaults"}

    def write_program(
        self,
        path: Path,
        run: Run,
        motion: str,
        head: str,
        drive: Imposed = IMPOSED[0],
        controls: str = "",
    ) -> str:
        """See `Programs.write_program`.

        A servo has kp = I (gain/step)^2 and kv = 2 I gain/step, where I is the load inertia of the
        drive in the start pose.

        Raises
        ------
        BadModel, Unsupported
            See `proofmass.sim.mujoco.engine.simulate`.  Also raised if a driven joint, or a site
            with a rod, is not an element of the file, as with a replicated body.
        """
        model, data = load(path, run)
        ctrl, default_data = data.ctrl.copy(), mujoco.MjData(model)
        count, step = run.steps(model.opt.timestep)
        times = run.x[0] + step * np.arange((run.x.size - 1) * count + 1)
        linkage = Linkage(model, data, tuple(each.joint for each in run.drives))
        armature, damping = model.dof_armature[linkage.dofs], model.dof_damping[linkage.dofs]
        tolerance = model.opt.tolerance
        initialize_dynamics(linkage, run, times)
        if drive.kind != "flywheel":
            model.opt.tolerance = tolerance
        flywheels = model.dof_armature[linkage.dofs] - armature
        root = expand_model(path)
        if run.rods:
            write_rods(root, path, run.rods)
        files = embed_files(root)
        apply_settings(root, model, step)
        values: dict[str, Any] = {}
        if run.drives:
            values = impose_motion(root, linkage, flywheels, step, drive)
        recorder = Recorder(model, data, run.channels, 1)
        withhold_drives(model, linkage, recorder)
        curves = dict(curve_expressions(recorder, linkage))
        rate = run.motion(times)[1] if run.drives else np.zeros((0, 1))
        moves = bool(np.ptp(rate, axis=1).any())
        by_stage = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        return load_template("mujoco.py.jinja").render(
            head=escape_text(head.strip()),
            model=escape_text(model_text(root).strip()),
            files=files,
            step=repr(step),
            per=count,
            samples=run.x.size,
            first=repr(float(run.x[0])),
            target=drive_target(drive.kind, moves, by_stage) if run.drives else "",
            motion=motion.strip() if run.drives else "",
            joints=json.dumps(list(linkage.joints), ensure_ascii=False),
            drive=drive.kind if run.drives else "",
            steady=not moves,
            middle=by_stage,
            parts={name.rpartition(".")[2] for name in recorder.sensors},
            qpos=format_numbers(data.qpos),
            qvel=format_numbers(data.qvel),
            ctrl=ctrl.tolist(),
            controls=controls.strip(),
            loads=control_indices(model, (one.actuator for one in run.loads)),
            more={
                name: format_numbers(getattr(data, name).ravel())
                for name in EXTRA_STATE
                if (getattr(data, name) != getattr(default_data, name)).any()
            },
            moments=bool(drive_sensors(model, linkage, recorder)),
            armature=armature.tolist(),
            damping=damping.tolist(),
            curves={json.dumps(name, ensure_ascii=False): line for name, line in curves.items()},
            **values,
        )


def drive_target(kind: str, moves: bool, by_stage: bool) -> str:
    """The array that a program sets before each step to move its drives; empty if it sets none."""
    return {
        "flywheel": "data.qfrc_applied[dofs]" if moves else "",
        "servo": "" if by_stage else "data.ctrl[-len(DRIVES):]",
        "equality": "model.eq_data[holds, 0]",
    }[kind]


def format_numbers(values: Array) -> str:
    """Numbers with all their digits, four in a line."""
    numbers = [repr(value) for value in values.tolist()]
    if len(numbers) <= 4:
        return f"[{', '.join(numbers)}]"
    rows = [", ".join(numbers[k : k + 4]) for k in range(0, len(numbers), 4)]
    return "[\n        " + ",\n        ".join(rows) + "]"


def expand_model(path: Path) -> Element:
    """The elements of an MJCF and its included files, without keys, with absolute file names."""
    root = read_tree(path)
    insert_includes(root, path.parent)
    folders = {
        key: value
        for compiler in root.iter("compiler")
        for key, value in compiler.attrib.items()
        if key.endswith("dir")
    }
    for element in root.iter():
        if (file := element.get("file")) is not None:
            own = FILE_FOLDERS.get(element.tag, "assetdir")
            folder = folders.get(own, folders.get("assetdir", ""))
            element.set("file", str((path.parent / folder / file).resolve()))
    for keyframe in root.findall("keyframe"):
        root.remove(keyframe)
    return root


def embed_files(root: Element) -> dict[str, list[str]]:
    """The files of an expanded model by name, compressed, as lines of base64 for its program.

    The elements then refer to these names.  The result is empty if the files are larger than
    `MAX_EMBEDDED_BYTES` together, or of kinds that refer to other files.
    """
    readers = [element for element in root.iter() if element.get("file") is not None]
    paths = {str(element.get("file")): Path(str(element.get("file"))) for element in readers}
    if (
        not paths
        or any(element.tag not in FILE_FOLDERS for element in readers)
        or sum(path.stat().st_size for path in paths.values()) > MAX_EMBEDDED_BYTES
    ):
        return {}
    for compiler in root.iter("compiler"):
        for key in [key for key in compiler.attrib if key.endswith("dir")]:
            del compiler.attrib[key]
    found, names = dict[str, list[str]](), dict[str, str]()
    for file, path in paths.items():
        name = path.name if path.name not in found else f"{len(found)}_{path.name}"
        packed = base64.b64encode(zlib.compress(path.read_bytes(), 9)).decode()
        found[name], names[file] = wrap(packed, MAX_COLUMNS - 8), name
    for element in readers:
        file = str(element.get("file"))
        if element.get("name") is None:
            element.set("name", Path(file).stem)
        element.set("file", names[file])
    return {json.dumps(name, ensure_ascii=False): lines for name, lines in found.items()}


def model_text(root: Element) -> str:
    """The text of a model with one element per line; long lines are broken between attributes."""
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode").replace(" />", "/>")
    lines = (reduce_indent(line) for line in text.splitlines())
    return "\n".join(broken for line in lines for broken in break_line(line))


def reduce_indent(line: str) -> str:
    """A line of MJCF with its indentation reduced to `MAX_INDENT`, for the deep links of rods."""
    return line[max(0, len(line) - len(line.lstrip()) - MAX_INDENT) :]


def break_line(line: str) -> list[str]:
    """A line of MJCF broken between attributes where it is too long.

    >>> break_line(f'  <joint name="{"a" * 40}" armature="{"1" * 40}"/>')[1]
    '         armature="1111111111111111111111111111111111111111"/>'
    """
    if len(line) <= MAX_COLUMNS:
        return [line]
    indent = len(line) - len(line.lstrip())
    head, *parts = re.split(r'(?<=") (?=[^\s"=]+=")', line)
    first = line.index(" ", indent) + 1 if " " in line[indent:] else indent
    lines = [head]
    for part in parts:
        if len(lines[-1]) + 1 + len(part) <= MAX_COLUMNS:
            lines[-1] += " " + part
        else:
            lines.append(" " * first + part)
    return lines


def apply_settings(root: Element, model: mujoco.MjModel, step: float) -> None:
    """Write the options and the softness of a compiled model into its elements.

    What `prepare_model` clears is left out: the flag ``energy``, and what changes the quantities
    that sensors show.
    """
    for path, names in CLEARED_ATTRIBUTES.items():
        for element in root.iterfind(path):
            for name in names:
                element.attrib.pop(name, None)
    written = {
        key
        for path in ("option", "option/flag")
        for element in root.iterfind(path)
        for key in element.attrib
    }
    write_options(root, {**read_options(model, written), "timestep": step})
    loops = root.findall("./equality/*")
    if len(loops) != model.neq:
        raise Unsupported(
            f"a program for a model with {model.neq} equalities, of which "
            f"{len(loops)} are elements of its file"
        )
    for i, loop in enumerate(loops):
        for key in SOFTNESS_SETTINGS:
            loop.set(key, mjcf_text(getattr(model, f"eq_{key}")[i].tolist()))
    write_limits(root, limit_softness(model, SOFTNESS_SETTINGS))


def impose_motion(
    root: Element, linkage: Linkage, flywheels: Array, step: float, drive: Imposed
) -> dict[str, Any]:
    """Write into the elements of a model what moves its driven joints.

    Returns numbers that the program needs, by their names in its template.
    """
    joints = [joint_element(root, name) for name in linkage.joints]
    refuse_disabled(linkage.model, drive)
    if drive.kind == "flywheel":
        for joint, armature in zip(joints, linkage.model.dof_armature[linkage.dofs], strict=True):
            joint.set("armature", mjcf_text(float(armature)))
            # damping and friction do not change the motion of an ideal drive
            joint.set("damping", "0 0 0")  # coefficients of velocity, its square and its cube
            joint.set("frictionloss", "0")
        return {"flywheels": flywheels.tolist()}
    if drive.kind == "servo":
        refuse_other_servos(linkage)
        rate = drive.gain / step  # natural frequency [rad/s]
        place = last_section(root, "actuator")
        for name, inertia in zip(linkage.joints, flywheels / FLYWHEEL_RATIO, strict=True):
            place.append(
                servo_element(root, name, float(inertia * rate**2), float(2.0 * inertia * rate))
            )
        return {"lead": [2.0 / rate] * len(joints)}
    if drive.kind == "equality":
        constant = step / drive.gain
        place = last_section(root, "equality")
        for name in linkage.joints:
            ElementTree.SubElement(
                place,
                "joint",
                {
                    "name": f"drive of {name}",
                    "joint1": name,
                    "active": "true",
                    "solref": mjcf_text((constant, 1.0)),
                    "solimp": mjcf_text(DRIVE_SOLIMP),
                },
            )
        return {"lead": repr(2.0 * constant * DRIVE_SOLIMP[1])}
    raise ValueError(
        f"a drive by {drive.kind!r}; known: {', '.join(dict.fromkeys(one.kind for one in IMPOSED))}"
    )


def refuse_disabled(model: mujoco.MjModel, drive: Imposed) -> None:
    """Raise `Unsupported` if the model's options disable the drive."""
    for name in DISABLING_FLAGS.get(drive.kind, ()):
        if model.opt.disableflags & int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name.upper()}")):
            raise Unsupported(
                f'the drive, {drive.kind}, is off: the model has <flag {name}="disable"/>'
            )
    if drive.kind == "servo" and model.opt.disableactuator & 1:
        raise Unsupported("the drive, servo, is off: the model disables the actuators of group 0")


def refuse_other_servos(linkage: Linkage) -> None:
    """Raise `Unsupported` if an actuator exerts a force on a driven joint at zero control.

    A servo gives way to such a force; a flywheel or an equality does not.  A motor exerts none.
    """
    model, data = linkage.model, linkage.data
    for a in range(model.nactuator):
        joint, first = joint_of(model, a), model.actuator_actadr[a]
        if joint < 0 or model.jnt_dofadr[joint] not in linkage.dofs:
            continue
        state = data.act[first : first + model.actuator_actnum[a]] if first >= 0 else np.zeros(0)
        if (
            model.actuator_biastype[a] != mujoco.mjtBias.mjBIAS_NONE
            or model.actuator_plugin[a] >= 0
            or state.any()
        ):
            raise Unsupported(
                f"a servo on joint {model.joint(joint).name!r}, which the model's "
                f"actuator {model.actuator(a).name!r} pushes as well"
            )


def servo_element(root: Element, joint: str, kp: float, kv: float) -> Element:
    """A position servo; it states all attributes that default classes of the model could change."""
    names = {"name": f"drive of {joint}", "joint": joint}
    if not any(root.find(f".//default/{tag}") is not None for tag in ACTUATOR_TAGS):
        return Element("position", {**names, "kp": mjcf_text(kp), "kv": mjcf_text(kv)})
    return Element(
        "general",
        {
            **names,
            "gear": "1 0 0 0 0 0",
            "ctrllimited": "false",
            "forcelimited": "false",
            "actlimited": "false",
            "dyntype": "none",
            "gaintype": "fixed",
            "biastype": "affine",
            "gainprm": mjcf_text((kp, 0, 0)),
            "biasprm": mjcf_text((0, -kp, -kv)),
        },
    )


def joint_element(root: Element, name: str) -> Element:
    """The element of a joint.

    Raises
    ------
    Unsupported
        The file has no such element, as with a body that is replicated or attached.
    """
    for joint in root.iterfind(".//worldbody//joint"):
        if joint.get("name") == name:
            return joint
    raise Unsupported(
        f"a program whose drive moves joint {name!r}, which is no element of the file"
    )


def curve_expressions(recorder: Recorder, linkage: Linkage) -> Iterator[tuple[str, str]]:
    """Columns of a program, each with a line of Python that extracts it from the recorded arrays.

    The columns are the channels and the motion of the drives.  A row of the array ``state`` has
    positions, rates and accelerations of all joints, and the moments of the drives.
    """
    model = linkage.model
    moments = drive_sensors(model, linkage, recorder)
    for name in recorder.sensors:
        if name in moments:
            drive, gear = moments[name]
            over = "" if gear == 1.0 else f" / {gear!r}"
            yield name, f"state[:, {model.nq + 2 * model.nv + drive}]{over}"
        else:
            yield name, curve_expression(recorder, name)
    for joint, adr, dof in zip(linkage.joints, linkage.adr, linkage.dofs, strict=True):
        places = adr, model.nq + dof, model.nq + model.nv + dof
        for name, place in zip(drive_columns(joint), places, strict=True):
            yield name, f"state[:, {place}]"


QUATERNIONS = mujoco.mjtSensor.mjSENS_FRAMEQUAT, mujoco.mjtSensor.mjSENS_BALLQUAT


def curve_expression(recorder: Recorder, name: str) -> str:
    """A line of Python that extracts a channel from the recorded sensors and states."""
    index, part = recorder.sensors[name]
    model = recorder.model
    first = int(model.sensor_adr[index])
    if is_acceleration(model, index):
        dof = int(model.jnt_dofadr[model.sensor_objid[index]])
        return f"state[:, {model.nq + model.nv + dof}]"
    gravity = np.zeros(3)
    if model.sensor_type[index] == mujoco.mjtSensor.mjSENS_FRAMELINACC:
        gravity = model.opt.gravity
    if part == "angle":
        plane = recorder.plane
        if plane is None:
            raise BadModel(f"channel {name!r}: no plane of motion")
        x, y = (component_expression(axis, first) for axis in (plane.e1, plane.e2))
        return f"angle({x}, {y})"
    if mujoco.mjtSensor(int(model.sensor_type[index])) in QUATERNIONS:
        return f"turn(sensors[:, {first} : {first + 4}])[:, {'wxyz'.index(part)}]"
    k = "xyz".index(part) if part else 0
    offset = float(gravity[k])
    # MuJoCo subtracts gravity
    suffix = f" {'-' if offset < 0 else '+'} {abs(offset)!r}" if offset else ""
    return f"sensors[:, {first + k}]{suffix}"


def component_expression(axis: Array, first: int) -> str:
    """Python text for the component of recorded vectors along an axis."""
    parts = [
        f"{'' if value == 1 else f'{value!r} * '}sensors[:, {first + k}]"
        for k, value in enumerate(axis.tolist())
        if value
    ]
    return " + ".join(parts)


MAX_DEPTH = 490
"""Largest depth of nested bodies that is written; MuJoCo reads no element inside 500 others."""
NO_ROTATION = [1.0, 0.0, 0.0, 0.0]
DEFAULT_JOINT = {
    "pos": "0 0 0",
    "damping": "0 0 0",
    "frictionloss": "0",
    "armature": "0",
    "ref": "0",
    "springref": "0",
    "limited": "false",
}
"""Attributes of a rod's joint, which are MJCF's defaults where no default class changes them."""
HINGE = mujoco.mjtJoint.mjJNT_HINGE
NAMED_KINDS = {
    "nbody": mujoco.mjtObj.mjOBJ_BODY,
    "njnt": mujoco.mjtObj.mjOBJ_JOINT,
    "nsite": mujoco.mjtObj.mjOBJ_SITE,
    "nsensor": mujoco.mjtObj.mjOBJ_SENSOR,
    "nactuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
    "neq": mujoco.mjtObj.mjOBJ_EQUALITY,
}
"""Kinds of elements that a program refers to by name, by the field that counts them in a model."""
UNCOMPARED_PREFIXES = "_", "key_", "name", "path"
"""Prefixes of arrays that are not compared: a program sets the state of its key, and may contain
the files of meshes.  Sizes are compared with the arrays."""


def write_rods(root: Element, path: Path, rods: Sequence[Rod]) -> None:
    """Write the links, sites and loops of rods into the elements of a model, in place.

    Parameters
    ----------
    root : Element
        The elements of the model with what it includes, without keys.
    path : Path
        The MJCF file.
    rods : sequence of Rod
        The rods with which the model is completed before it is compiled.

    Raises
    ------
    Unsupported
        A rod is on a site that is no element of the file, or has too many links; or the elements do
        not compile to exactly the numbers of the model.
    """
    spec = read_spec(path)
    loops = len(spec.equalities)
    with collected_warnings():  # its warnings were reported when the model was loaded
        exact = compile_with_rods(spec, rods)
    plain = root.find("default") is None
    for rod in rods:
        write_body(body_of_site(root, rod.start), spec.body(chain(rod).names[0]), plain)
        if rod.ends[1] == "clamped" and rod.end is not None:
            write_body(body_of_site(root, rod.end), spec.body(f"{rod.name}.slider.0"), plain)
    for loop in spec.equalities[loops:]:
        names = {"name": loop.name, "site1": loop.name1, "site2": loop.name2}
        ElementTree.SubElement(last_section(root, "equality"), "connect", names)
    ElementTree.SubElement(root, "compiler", {"fusestatic": "false"})
    refuse_different_model(root, exact)


def body_of_site(root: Element, site: str) -> Element:
    """The element of the body, or of the world, to which a site belongs."""
    parents = {child: parent for parent in root.iter() for child in parent}
    for element in root.iterfind(".//worldbody//site"):
        if element.get("name") == site:
            while element.tag not in ("body", "worldbody"):
                element = parents[element]
            return element
    raise Unsupported(f"a program with a rod on site {site!r}, which is no element of the file")


def write_body(parent: Element, body: mujoco._specs.MjsBody, plain: bool) -> None:
    """Write a body of a rod and those that follow it; `plain`: the model has no default classes."""
    depth = 0
    while body is not None:  # a rod does not branch
        depth += 1
        if depth > MAX_DEPTH:
            raise Unsupported(
                f"a program with a rod of more than {MAX_DEPTH} links and slides: MuJoCo reads no "
                "deeper elements"
            )
        parent = ElementTree.SubElement(
            parent, "body", {"name": body.name, **placement_attributes(body)}
        )
        parent.extend(body_parts(body, plain))
        body = body.first_body()


def body_parts(body: mujoco._specs.MjsBody, plain: bool) -> Iterator[Element]:
    """The elements in a body of a rod; they correspond to `proofmass.sim.rods.add_rod`."""
    if body.explicitinertial:
        inertia = {"mass": body.mass, "pos": body.ipos, "diaginertia": body.inertia}
        yield Element("inertial", {key: mjcf_numbers(value) for key, value in inertia.items()})
    for joint in body.joints:
        said = {
            "name": joint.name,
            "type": "hinge" if joint.type == HINGE else "slide",
            "axis": mjcf_numbers(joint.axis),
            "stiffness": mjcf_numbers(joint.stiffness[0] if plain else joint.stiffness),
            **DEFAULT_JOINT,
            "springref": mjcf_numbers(joint.springref)
            if joint.springref
            else DEFAULT_JOINT["springref"],
        }
        yield Element(
            "joint", {k: v for k, v in said.items() if not plain or v != DEFAULT_JOINT.get(k)}
        )
    for geom in body.geoms:
        yield Element(
            "geom",
            {
                "type": "capsule",
                "fromto": mjcf_numbers(geom.fromto),
                "size": mjcf_numbers(geom.size[0]),
                "mass": "0",
                "contype": "0",
                "conaffinity": "0",
            },
        )
    for site in body.sites:
        yield Element("site", {"name": site.name, **placement_attributes(site)})


def placement_attributes(element: mujoco._specs.MjsBody | mujoco._specs.MjsSite) -> dict[str, str]:
    """Attributes for the position and orientation of a body or a site in its parent."""
    is_rotated = element.quat.tolist() != NO_ROTATION
    said = {"pos": mjcf_numbers(element.pos)}
    return {**said, "quat": mjcf_numbers(element.quat)} if is_rotated else said


def mjcf_numbers(value: Array | float) -> str:
    """Numbers as MJCF text with all their digits."""
    return mjcf_text(np.asarray(value, float).tolist())


def refuse_different_model(root: Element, exact: mujoco.MjModel) -> None:
    """Raise `Unsupported` unless the elements compile to the numbers of `exact`, keys excepted."""
    text = ElementTree.tostring(root, encoding="unicode")
    try:
        with collected_warnings():
            model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise Unsupported(f"a program for this model with rods: {error}") from None
    if (other := first_difference(model, exact)) is not None:
        raise Unsupported(
            f"a program for this model with rods: its elements compile to another {other}"
        )


def first_difference(one: mujoco.MjModel, two: mujoco.MjModel) -> str | None:
    """Name of the first array, or kind of names, in which two models differ; None if they agree.

    Keys and names of files are not compared.
    """
    for count, kind in NAMED_KINDS.items():
        first, second = (
            [mujoco.mj_id2name(model, kind, k) for k in range(getattr(model, count))]
            for model in (one, two)
        )
        if first != second:
            return f"order of names, {count}"
    for name in dir(two):
        values = getattr(two, name)
        compared = isinstance(values, np.ndarray) and not name.startswith(UNCOMPARED_PREFIXES)
        if compared and not np.array_equal(getattr(one, name), values):
            return name
    return None
