"""A model that is edited: an `MjSpec`, the rods that complete it, and the edits themselves.

Every element without a name gets one for the study, such as ``geom 3 of crank``, which is removed
when the model is written.  A model without sensors gets sensors at every joint, or at the elements
that are to be monitored.

The edits are functions of an edited model and of names; they change the model in place.  An edit of
an element that another edit has removed does nothing.  A model is written with all digits of its
numbers, and without the names and sensors that were added for the study.
"""

import ctypes
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError, model_error, suggest_names
from proofmass.base.files import write_atomically
from proofmass.run.sidecar import load_case
from proofmass.sim.mjcf import compile_model, read_spec
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Rod
from proofmass.sim.rods import compile_with_rods

Cut = Callable[["EditedModel"], None]
NAMED_LISTS = (
    "bodies",
    "joints",
    "geoms",
    "sites",
    "cameras",
    "lights",
    "sensors",
    "actuators",
    "equalities",
    "tendons",
    "pairs",
    "excludes",
    "skins",
    "textures",
    "keys",
)
JointType, SensorType, ObjectType = mujoco.mjtJoint, mujoco.mjtSensor, mujoco.mjtObj
JOINT_SENSORS = {  # sensors that are added for each kind of joint, at the joint or at its body
    JointType.mjJNT_HINGE: (SensorType.mjSENS_JOINTPOS, SensorType.mjSENS_JOINTVEL),
    JointType.mjJNT_SLIDE: (SensorType.mjSENS_JOINTPOS, SensorType.mjSENS_JOINTVEL),
    JointType.mjJNT_BALL: (SensorType.mjSENS_FRAMEQUAT, SensorType.mjSENS_FRAMEANGVEL),
    JointType.mjJNT_FREE: (
        SensorType.mjSENS_FRAMEPOS,
        SensorType.mjSENS_FRAMEQUAT,
        SensorType.mjSENS_FRAMELINVEL,
        SensorType.mjSENS_FRAMEANGVEL,
    ),
}


FRAME_SENSORS = JOINT_SENSORS[JointType.mjJNT_FREE]
MONITORED_LISTS = {"joints": "joint", "bodies": "body", "sites": "site", "sensors": "sensor"}
"""Lists of the spec whose elements can be monitored by name, and the word for one element."""
SENSOR_OBJECT_TYPES = {
    "joints": ObjectType.mjOBJ_JOINT,
    "bodies": ObjectType.mjOBJ_XBODY,
    "sites": ObjectType.mjOBJ_SITE,
}


class EditedModel:
    """The model of an MJCF file, and the edits that were made to it.

    Parameters
    ----------
    file : Path
        The MJCF file.
    rods : tuple of Rod
        The rods of a sidecar, which complete the model; other sidecars may give the same rods
        other shapes.
    probing : bool
        Whether a model without sensors gets sensors for everything that moves.
    cuts : tuple of callable
        Functions that change the edited model in place; they are called one after the other.
    monitored : tuple of str
        Names of joints, bodies, sites and sensors; only these are monitored if there are any.

    Attributes
    ----------
    spec : MjSpec
        The model without the rods.
    share : int
        The number by which the numbers of segments of all rods are divided.
    given : set of (str, str)
        Elements that had no name: the list of the spec that each is in, and the name it was given.
    added_sensors : set of str
        Names of the sensors that were added.
    cuts : tuple of callable
        Functions that have changed the edited model so far.
    """

    def __init__(
        self,
        file: Path,
        rods: tuple[Rod, ...] = (),
        probing: bool = False,
        cuts: tuple[Cut, ...] = (),
        monitored: tuple[str, ...] = (),
    ):
        self.file, self.rods, self.share = file, rods, 1
        self.source, self.monitored = (file, rods, probing), monitored
        self.alone = Lock()  # MuJoCo crashes if two threads compile the same spec
        self.spec = read_spec(file)
        self.given = {
            (kind, name) for kind in NAMED_LISTS for name in name_unnamed(self.spec, kind)
        }
        self.added_sensors = set[str]()
        if monitored:
            self.added_sensors = (
                set(add_monitored_sensors(self.spec, monitored)) if probing else set()
            )
        elif probing and not self.spec.sensors:
            self.added_sensors = set(add_joint_sensors(self.spec))
        if not rods:
            self.spec.compile()  # so that MuJoCo removes the values of deleted joints from the keys
        self.cuts: tuple[Cut, ...] = ()
        for cut in cuts:
            cut(self)
            self.cuts += (cut,)

    def without(self, cut: Cut) -> "EditedModel":
        """The edited model with one more cut.

        It is made anew from the file, since a spec that lacks its rods cannot be copied.

        Raises
        ------
        ValueError
            The cut cannot be made.
        """
        return EditedModel(*self.source, (*self.cuts, cut), self.monitored)

    def again(self) -> "EditedModel":
        """A new copy of the edited model, whose spec may be changed."""
        return EditedModel(*self.source, self.cuts, self.monitored)

    def compiled(self, rods: tuple[Rod, ...] = ()) -> mujoco.MjModel:
        """The compiled model, with these rods or its own.

        Raises
        ------
        ValueError
            The model does not compile, since an element refers to one that was removed.
        """
        try:
            if self.rods:
                return compile_with_rods(self.again().spec, self.segmented(rods or self.rods))
            with self.alone:
                return self.spec.compile()
        except (mujoco.FatalError, BadModel) as error:
            raise ValueError(str(error)) from None

    def segmented(self, rods: tuple[Rod, ...]) -> tuple[Rod, ...]:
        """Rods in as many segments as the edits have left them."""
        return tuple(replace(rod, segments=rod.segments // self.share) for rod in rods)

    def find(self, kind: str, name: str) -> Any:
        """An element of one of the spec's lists; None if it was removed."""
        return next((e for e in getattr(self.spec, kind) if e.name == name), None)

    def drop(self, kind: str, name: str) -> None:
        """Delete an element, and the added sensors that read it, unless it was removed before."""
        if element := self.find(kind, name):
            word = SENSOR_OBJECT_TYPES.get(kind)
            for sensor in list(self.spec.sensors):
                if sensor.name in self.added_sensors and (sensor.objtype, sensor.objname) == (
                    word,
                    name,
                ):
                    self.spec.delete(sensor)
            self.spec.delete(element)


def read_model(
    file: Path, rods: tuple[Rod, ...] = (), probing: bool = False, monitored: tuple[str, ...] = ()
) -> EditedModel:
    """Read a model from a file, without edits.

    Raises
    ------
    InputError
        There is no such file, it does not compile, or it has no element of a name that is to be
        monitored.
    """
    if file.suffix == ".toml" and file.is_file():
        raise InputError(file, "", f"is a sidecar; give its model, {load_case(file).model_path}")
    if not file.is_file() or file.suffix != ".xml":
        raise InputError(file, "", "no such model; give an MJCF file, NAME.xml")
    try:
        compile_model(file, rods)
        edited = EditedModel(file, rods, probing, (), monitored)
    except BadModel as error:
        raise model_error(file, error) from None
    known_names = monitorable_names(edited.spec)
    for name in monitored:
        if name not in known_names:
            raise InputError(
                file,
                "--watch",
                f"no joint, body, site or sensor is called {name!r}; "
                f"{suggest_names(name, known_names)}",
            )
    return edited


def monitorable_names(spec: mujoco.MjSpec) -> list[str]:
    """The names of all elements that can be monitored."""
    return list(
        dict.fromkeys(
            e.name
            for kind in MONITORED_LISTS
            for e in getattr(spec, kind)
            if (kind, e.name) != ("bodies", "world")
        )
    )


def name_unnamed(spec: mujoco.MjSpec, kind: str) -> Iterator[str]:
    """Give names to the elements of a list that have none, and yield these names."""
    taken = {element.name for element in getattr(spec, kind)}
    for k, element in enumerate(getattr(spec, kind)):
        if not element.name:
            body = getattr(getattr(element, "parent", None), "name", "")
            name = f"{type(element).__name__[3:].lower()} {k}" + (f" of {body}" if body else "")
            while name in taken:
                name += "'"
            element.name = name
            taken.add(name)
            yield name


def add_joint_sensors(spec: mujoco.MjSpec) -> Iterator[str]:
    """Add sensors at every joint, and yield their names."""
    for joint in spec.joints:
        scalar = joint.type in (JointType.mjJNT_HINGE, JointType.mjJNT_SLIDE)
        for kind in JOINT_SENSORS[joint.type]:
            name = f"{joint.name} {kind.name[7:].lower()}"
            spec.add_sensor(
                name=name,
                type=kind,
                objtype=ObjectType.mjOBJ_JOINT if scalar else ObjectType.mjOBJ_XBODY,
                objname=joint.name if scalar else joint.parent.name,
            )
            yield name


def add_monitored_sensors(spec: mujoco.MjSpec, monitored: tuple[str, ...]) -> Iterator[str]:
    """Add sensors at the joints, bodies and sites with these names, and yield the sensors' names.

    The sensors of a joint read its value and its rate, those of a body or a site its position, its
    orientation and both velocities.
    """
    for kind, word in MONITORED_LISTS.items():
        for element in [
            e for e in getattr(spec, kind) if e.name in monitored and kind in SENSOR_OBJECT_TYPES
        ]:
            read, what, name = SENSOR_OBJECT_TYPES[kind], FRAME_SENSORS, element.name
            if kind == "joints":
                what = JOINT_SENSORS[element.type]
                if element.type in (JointType.mjJNT_BALL, JointType.mjJNT_FREE):
                    read, name = ObjectType.mjOBJ_XBODY, element.parent.name
            for sensor in what:
                added = f"{word} {element.name} {sensor.name[7:].lower()}"
                spec.add_sensor(name=added, type=sensor, objtype=read, objname=name)
                yield added


GeomType = mujoco.mjtGeom
INERTIA_AUTO = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
"""Only for bodies without a given inertia."""
PLANE_ROUNDING = 1e-9  # deviation of a key from a plane that is only rounding


def switch_off(edited: EditedModel, bit: int) -> None:
    """Set a disable flag."""
    edited.spec.option.disableflags |= bit


def set_option(edited: EditedModel, name: str, value: float) -> None:
    """Set one of the engine's options."""
    setattr(edited.spec.option, name, value)


def disable_contacts(edited: EditedModel, name: str) -> None:
    """Set the masks of a geom so that it collides with nothing."""
    if geom := edited.find("geoms", name):
        geom.contype = geom.conaffinity = 0


def remove_limits(edited: EditedModel, name: str) -> None:
    """Remove the limits of a joint."""
    if joint := edited.find("joints", name):
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE


def remove_material(edited: EditedModel, name: str) -> None:
    """Delete a material; geoms and sites that are made of it keep its colour.

    Raises
    ------
    ValueError
        A tendon is made of it: MuJoCo does not allow the removal of a tendon's material.
    """
    material = edited.find("materials", name)
    if material is None:
        return
    for tendon in edited.spec.tendons:
        if tendon.material == name:
            raise ValueError(f"tendon {tendon.name!r} is made of it, which cannot be undone")
    for kind in ("geom", "site"):
        for element in getattr(edited.spec, f"{kind}s"):
            if element.material == name:
                element.material, element.rgba = "", material.rgba
            usual = getattr(element.classname, kind)
            if usual.material == name:
                usual.material = ""
    edited.spec.delete(material)


def remove_drawn_geom(edited: EditedModel, name: str) -> None:
    """Delete a geom that collides with nothing; its body keeps the inertia of the geom."""
    if geom := edited.find("geoms", name):
        fix_inertia(edited, geom.parent)
        edited.spec.delete(geom)


def replace_mesh_by_box(edited: EditedModel, name: str) -> None:
    """Replace a mesh by the box with the same inertia, which the compiler fits to the mesh."""
    geom = edited.find("geoms", name)
    if geom is None or geom.type != GeomType.mjGEOM_MESH:
        return
    fix_inertia(edited, geom.parent)
    geom.type = GeomType.mjGEOM_BOX
    fitted = edited.compiled().geom(name)
    geom.meshname, geom.fromto = "", [np.nan] * 6
    geom.size, geom.pos, geom.quat = fitted.size, fitted.pos, fitted.quat
    geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def fix_inertia(edited: EditedModel, body: mujoco._specs.MjsBody) -> None:
    """Give a body explicitly the inertia that the compiler computes from its geoms.

    If the compiler does so even for bodies whose inertia is given, all bodies get theirs.
    """
    compiler, model = edited.spec.compiler, edited.compiled()
    by_rule = compiler.inertiafromgeom != INERTIA_AUTO or compiler.settotalmass > 0
    for one in edited.spec.bodies[1:] if by_rule else [body]:
        if one.name == "world" or (one.explicitinertial and not by_rule):
            continue
        found = model.body(one.name)
        one.explicitinertial, one.mass = True, found.mass[0]
        one.ipos, one.iquat, one.inertia = found.ipos, found.iquat, found.inertia
    compiler.inertiafromgeom, compiler.settotalmass = INERTIA_AUTO, -1


def divide_segments(edited: EditedModel, share: int) -> None:
    """Divide the number of segments of every rod by a factor."""
    edited.share = share


def make_planar(edited: EditedModel, name: str, normal: Array) -> None:
    """Replace a free joint by two slides and a hinge, or a ball joint by a hinge, in a plane.

    The hinge turns about `normal`, which is given in the frame of the world.

    Raises
    ------
    ValueError
        The pose or the velocity of the joint in a key is not in that plane.
    """
    joint = edited.find("joints", name)
    if joint is None:
        return
    before, body, free = edited.compiled(), joint.parent, joint.type == JointType.mjJNT_FREE
    data = mujoco.MjData(before)
    mujoco.mj_kinematics(before, data)
    rotation = data.body(body.name).xmat.reshape(3, 3)
    axis = rotation.T @ normal
    one = rotation.T @ np.roll(normal, 1)
    across = [one, np.cross(axis, one)] if free else []
    poses = [
        planar_pose(before, key, joint, np.array([*across, axis])) for key in range(before.nkey)
    ]
    edited.drop("joints", name)
    added = []
    for k, direction in enumerate(across):
        body.add_joint(name=f"{name} {k + 1}", type=JointType.mjJNT_SLIDE, axis=direction)
        added.append(f"{name} {k + 1}")
    body.add_joint(name=f"{name} 0", type=JointType.mjJNT_HINGE, axis=axis)
    added.append(f"{name} 0")
    set_key_values(edited, added, poses)


def planar_pose(model: mujoco.MjModel, key: int, joint: object, axes: Array) -> tuple[Array, Array]:
    """Values and rates of slides and hinge that replace a free joint or a ball joint in a key."""
    joint_data = model.joint(joint.name)  # type: ignore[attr-defined]
    pose = model.key_qpos[key, joint_data.qposadr[0] :]
    speed = model.key_qvel[key, joint_data.dofadr[0] :]
    zero, spin = model.qpos0[joint_data.qposadr[0] :], speed[:3]
    place, velocity, shift = np.zeros(3), np.zeros(3), 0
    rotation = np.zeros(9)
    if len(axes) == 3:
        mujoco.mju_quat2Mat(rotation, zero[3:7])
        place, velocity = (rotation.reshape(3, 3).T @ v for v in (pose[:3] - zero[:3], speed[:3]))
        spin, shift = speed[3:6], 3
    inverse, relative = np.zeros(4), np.zeros(4)
    mujoco.mju_negQuat(inverse, zero[shift : shift + 4])
    mujoco.mju_mulQuat(relative, inverse, pose[shift : shift + 4])
    axis, directions = axes[-1], axes[:-1]
    angle = 2 * np.arctan2(relative[1:] @ axis, relative[0])
    deviations = [relative[1:] - (relative[1:] @ axis) * axis, spin - (spin @ axis) * axis]
    deviations += (
        [
            place - directions.T @ (directions @ place),
            velocity - directions.T @ (directions @ velocity),
        ]
        if len(directions)
        else []
    )
    if np.abs(deviations).max() > PLANE_ROUNDING:
        raise ValueError(f"key {model.key(key).name!r} leaves the plane")
    return np.array([*(directions @ place), angle]), np.array(
        [*(directions @ velocity), spin @ axis]
    )


def set_key_values(
    edited: EditedModel, joints: list[str], poses: list[tuple[Array, Array]]
) -> None:
    """Set values and rates of new joints in all keys."""
    model = edited.compiled()
    for key, (values, rates) in zip(edited.spec.keys, poses, strict=True):
        pose, speed = model.key(key.name).qpos.copy(), model.key(key.name).qvel.copy()
        for joint, value, rate in zip(joints, values, rates, strict=True):
            pose[model.joint(joint).qposadr[0]] = value
            speed[model.joint(joint).dofadr[0]] = rate
        key.qpos, key.qvel = pose, speed


DOUBLE_DIGITS = 17  # of a number in double precision
FLOAT_ATTRIBUTES = ("rgba",)  # attributes in single precision
NUMBER_PATTERN = re.compile(r"-?\d[\d.]*(?:e[-+]?\d+)?")


def write_model(edited: EditedModel, file: Path, with_additions: bool = False) -> None:
    """Write a model; see `model_text`."""
    write_atomically(file, model_text(edited, file.parent, with_additions))


def model_text(edited: EditedModel, folder: Path, with_additions: bool = False) -> str:
    """The MJCF of a model, with paths of its meshes and textures relative to a folder.

    A text `with_additions` has the sensors and names that were added to the model.
    """
    spec = edited.again().spec
    keys = {key.name: (list(key.qpos), list(key.qvel)) for key in spec.keys}
    if not with_additions:
        remove_additions(edited, spec)
    compile_with_rods(spec, edited.rods) if edited.rods else spec.compile()
    for kind in ("meshdir", "texturedir") if spec.meshes or spec.textures else ():
        place = os.path.relpath(edited.file.parent / getattr(spec, kind), folder)
        setattr(spec, kind, place)
    with write_all_digits():
        text = shorten(spec.to_xml())
    return without_rods(text, edited.rods, keys) if edited.rods else text


def remove_additions(edited: EditedModel, spec: mujoco.MjSpec) -> None:
    """Remove the sensors and names that were added to a spec."""
    for sensor in list(spec.sensors):
        if sensor.name in edited.added_sensors:
            spec.delete(sensor)
    for kind, name in edited.given:
        for element in getattr(spec, kind):
            if element.name == name:
                element.name = ""


@contextmanager
def write_all_digits() -> Iterator[None]:
    """Make the engine write numbers with all their digits instead of six, if it can.

    The function that sets the digits is private to the engine's library: the Python bindings do
    not have it.
    """
    folder = Path(mujoco.__file__).parent
    libraries = [
        ctypes.CDLL(str(f))
        for f in folder.iterdir()
        if re.fullmatch(r"(lib)?mujoco[\d.]*\.(so|dylib|dll)[\d.]*", f.name)
    ]
    switch = next(
        (
            lib._mjPRIVATE__set_xml_precision
            for lib in libraries
            if hasattr(lib, "_mjPRIVATE__set_xml_precision")
        ),
        lambda digits: None,
    )
    switch(DOUBLE_DIGITS)
    try:
        yield
    finally:
        switch(6)


def shorten(text: str) -> str:
    """XML with every number written in as few digits as it needs.

    >>> shorten('<geom rgba="0.40000000596046448 1 1 1" size="0.10000000000000001 1e-05 3"/>')
    '<geom rgba="0.4 1 1 1" size="0.1 1e-05 3"/>'
    """

    def short(match: re.Match[str]) -> str:
        name, values = match.groups()
        if not all(NUMBER_PATTERN.fullmatch(value) for value in values.split()):
            return match[0]
        words = [
            f"{float(v):.7g}"
            if name in FLOAT_ATTRIBUTES
            else repr(float(v)).removesuffix(".0")
            if "." in v
            else v
            for v in values.split()
        ]
        return f'{name}="{" ".join(words)}"'

    return re.sub(r'(\w+)="([^"]*)"', short, text)


def without_rods(
    text: str, rods: tuple[Rod, ...], keys: dict[str, tuple[list[float], list[float]]]
) -> str:
    """The MJCF text of a model that rods complete, without these rods, and with its own keys."""
    root = ElementTree.fromstring(
        text, ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    )
    roots = {f"{rod.name}.{k}" for rod in rods for k in (0, 1)}
    loops = {rod.name for rod in rods} | {f"{rod.name}.slider" for rod in rods}
    for parent in list(root.iter()):
        for child in list(parent):
            if (
                (child.tag == "body" and child.get("name") in roots)
                or (child.tag == "connect" and child.get("name") in loops)
                or (child.tag == "key" and child.get("name") not in keys)
            ):
                parent.remove(child)
    for key in root.iter("key"):
        for name, values in zip(("qpos", "qvel"), keys[key.get("name", "")], strict=True):
            key.attrib.pop(name, None)
            if values:
                key.set(name, " ".join(f"{v:.17g}" for v in values))
    return ElementTree.tostring(root, encoding="unicode") + "\n"
