"""The numbers of an MJCF that a run uses.

`numbers_of` lists the numbers that can affect a motion in the plane of a planar mechanism: masses,
inertias, positions, directions, springs, dampers, friction, ranges, gravity, loads, and the
softness of loops and joint limits.  It leaves out numbers that only affect drawings, positions
normal to the plane, and settings of the engine: time step, integrator, iterations.
`proofmass.sim.elements` changes these numbers.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.contents import SCALAR_JOINT_UNITS, joint_of, straight_tendon
from proofmass.sim.elements import (
    COMPILED_FIELDS,
    DOF_FIELDS,
    ModelElements,
    Number,
    Place,
    Source,
    own_key_values,
)
from proofmass.sim.mjcf import DISABLE_BITS, DISABLED_FIELDS

CHANGE_SHARE = 0.1
"""The change that is tried, as a share of a number, or of its natural size if it is 0."""
ZERO_TOLERANCE = 1e-12
"""Share of its natural size below which a number counts as 0."""
S, OBJ = mujoco.mjtSensor, mujoco.mjtObj
DIRECTION_SENSORS = (
    S.mjSENS_FRAMEXAXIS,
    S.mjSENS_FRAMEYAXIS,
    S.mjSENS_FRAMEZAXIS,
    S.mjSENS_FRAMEQUAT,
)
OWN_FRAME_SENSORS = (
    S.mjSENS_ACCELEROMETER,
    S.mjSENS_VELOCIMETER,
    S.mjSENS_GYRO,
    S.mjSENS_FORCE,
    S.mjSENS_TORQUE,
    S.mjSENS_MAGNETOMETER,
)
LIMIT_ATTRIBUTES = "solreflimit", "solimplimit"


@dataclass(frozen=True)
class Sizes:
    """Natural sizes of a model, which scale the changes of numbers that are 0.

    They are a length [m], a mass [kg] and a time [s].
    """

    length: float
    mass: float
    time: float

    def of(self, hinge: bool, mass: int, time: int) -> float:
        """Natural size of mass^`mass` time^`time`, times length^2 for a quantity of a hinge."""
        return self.mass**mass * self.time**time * (self.length**2 if hinge else 1.0)


def numbers_of(
    source: Source, sizes: Sizes, driven: Sequence[str] = (), loads: Sequence[str] = ()
) -> list[Number]:
    """The numbers of a model, kind by kind.

    Parameters
    ----------
    source : Source
    sizes : Sizes
        Natural sizes, for the changes of numbers that are 0.
    driven : sequence of str
        Joints that are driven; without any, the start values are among the numbers.
    loads : sequence of str
        Actuators whose controls change along the run, so that those of the key have no effect.

    Raises
    ------
    NotWritten
        See `written`.
    """
    ModelElements(source)  # raises if the file cannot be changed
    found = [
        *numbers_of_bodies(source, sizes),
        *numbers_of_joints(source, sizes),
        *numbers_of_sites(source, sizes),
        *numbers_of_gravity(source, sizes),
        *numbers_of_equalities(source, sizes),
        *numbers_of_tendons(source, sizes),
        *numbers_of_actuators(source, sizes, driven, loads),
        *(() if driven else numbers_of_start(source, sizes)),
        *numbers_of_rods(source),
    ]
    return sorted(found, key=lambda number: list(NUMBER_KINDS).index(number.kind))


NUMBER_KINDS = {
    "length": "m",
    "stiffness of a rod": "N m^2",
    "axial stiffness of a rod": "N",
    "shear stiffness of a rod": "N",
    "torsion stiffness of a rod": "N m^2",
    "stiffness of a rod about y": "N m^2",
    "natural curvature of a rod": "1/m",
    "mass of a rod": "kg",
    "load of a rod": "N/m",
    "couple along a rod": "N",
    "place": "m",
    "anchor": "m",
    "site": "m",
    "direction": "rad",
    "axis": "1",
    "zero": "rad",
    "coupling": "1",
    "start value": "rad",
    "start rate": "rad/s",
    "mass": "kg",
    "centre of mass": "m",
    "inertia": "1",
    "gravity": "m/s^2",
    "load": "1",
    "gear": "1",
    "gain": "1",
    "stiffness": "N m",
    "rest angle": "rad",
    "spring length": "m",
    "range": "rad",
    "damping": "N m s",
    "armature": "kg m^2",
    "friction": "N m",
    "softness of the loop": "1",
    "softness of the stop": "1",
}
"""Kinds of numbers in the order of the list, each with the unit of most numbers of its kind."""


def make_number(
    kind: str, of: str, value: float, place: Place, natural: float, unit: str = ""
) -> Number:
    """A number with the change that is tried, a share of it or of its natural size."""
    value = value if abs(value) > ZERO_TOLERANCE * natural else 0.0
    return Number(
        kind, of, value, unit or NUMBER_KINDS[kind], CHANGE_SHARE * (abs(value) or natural), place
    )


def make_components(
    kind: str, of: str, values: Array, axes: Iterable[int], place: Place, natural: float
) -> Iterator[Number]:
    """Numbers of the components of a vector along some axes; see `make_number`."""
    for k in axes:
        name = f"{of} {'xyz'[k]}".lstrip()
        yield make_number(kind, name, float(values[k]), replace(place, part=k), natural)


def element_name(model: mujoco.MjModel, what: str, index: int) -> str:
    """The name of an element, or its number if it has no name."""
    return getattr(model, what)(index).name or f"number {index + 1}"


def moving_bodies(model: mujoco.MjModel) -> list[int]:
    """The bodies that joints move."""
    return [b for b in range(1, model.nbody) if model.body_weldid[b] != 0]


def numbers_of_bodies(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Positions, orientations, masses, centres of mass and inertias of bodies."""
    model = source.bare
    for b in range(1, model.nbody):
        name, parent = element_name(model, "body", b), int(model.body_parentid[b])
        axes = source.parts(source.frame(parent))
        place = Place("body", b, "pos")
        yield from make_components("place", name, model.body_pos[b], axes, place, sizes.length)
        yield make_number("direction", f"body {name}", 0.0, Place("body", b, "turn"), 1.0)
    for b in moving_bodies(model):
        name = element_name(model, "body", b)
        yield make_number(
            "mass", name, float(model.body_mass[b]), Place("inertial", b, "mass"), sizes.mass
        )
        yield make_number("inertia", name, 1.0, Place("inertial", b, "inertia"), 1.0)
        centre = model.body_ipos[b] if model.body_mass[b] else np.zeros(3)
        axes, place = source.parts(source.frame(b)), Place("inertial", b, "pos")
        yield from make_components("centre of mass", name, centre, axes, place, sizes.length)


def is_enabled(model: mujoco.MjModel, field: str) -> bool:
    """Whether no flag of the model disables a field of the compiled model."""
    return not any(
        field in fields and model.opt.disableflags & int(flag)
        for flag, fields in DISABLED_FIELDS.items()
    )


def numbers_of_joints(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Anchors, directions, zeros, springs, damping, friction and ranges of hinges and slides."""
    model = source.bare
    for j in range(model.njnt):
        if (unit := SCALAR_JOINT_UNITS.get(mujoco.mjtJoint(int(model.jnt_type[j])))) is None:
            continue
        hinge, name, body = unit == "rad", element_name(model, "joint", j), int(model.jnt_bodyid[j])
        own, dof, adr = 1.0 if hinge else sizes.length, model.jnt_dofadr[j], model.jnt_qposadr[j]
        if hinge:
            at, axes = model.jnt_pos[j], source.parts(source.frame(body))
            place = Place("joint", j, "pos")
            yield from make_components("anchor", f"joint {name}", at, axes, place, sizes.length)
        else:
            yield make_number("direction", f"joint {name}", 0.0, Place("joint", j, "turn"), 1.0)
        yield make_number(
            "zero", name, float(model.qpos0[adr]), Place("joint", j, "ref"), own, unit
        )
        yield from numbers_of_springs(source, sizes, j, name, hinge)
        for attribute, kind, mass, time, of_it in (
            ("damping", "damping", 1, -1, "N m s" if hinge else "N s/m"),
            ("armature", "armature", 1, 0, "kg m^2" if hinge else "kg"),
            ("frictionloss", "friction", 1, -2, "N m" if hinge else "N"),
        ):
            natural = sizes.of(hinge, mass, time) * (own if attribute == "frictionloss" else 1.0)
            if is_enabled(model, DOF_FIELDS[attribute]):
                value = float(getattr(model, DOF_FIELDS[attribute])[dof])
                yield make_number(kind, name, value, Place("joint", j, attribute), natural, of_it)
        if model.jnt_limited[j]:
            for k, end in enumerate(("low", "high")):
                yield make_number(
                    "range",
                    f"{name} {end}",
                    float(model.jnt_range[j, k]),
                    Place("joint", j, "range", k),
                    own,
                    unit,
                )
            for attribute in LIMIT_ATTRIBUTES:
                yield from numbers_of_softness(
                    "softness of the stop",
                    name,
                    Place("joint", j, attribute),
                    getattr(model, COMPILED_FIELDS["joint", attribute])[j],
                )


def joint_axes(source: Source) -> list[list[Number]]:
    """The components of the axis of each hinge and slide that are not 0."""
    model, found = source.bare, list[list[Number]]()
    for j in range(model.njnt):
        if mujoco.mjtJoint(int(model.jnt_type[j])) not in SCALAR_JOINT_UNITS:
            continue
        name, place = f"joint {element_name(model, 'joint', j)}", Place("joint", j, "axis")
        parts = [k for k in range(3) if model.jnt_axis[j, k]]
        found.append([*make_components("axis", name, model.jnt_axis[j], parts, place, 1.0)])
    return found


def numbers_of_springs(
    source: Source, sizes: Sizes, j: int, name: str, hinge: bool
) -> Iterator[Number]:
    """Coefficients of the stiffness polynomial of a joint, and the rest position of its spring."""
    model = source.bare
    if not is_enabled(model, "jnt_stiffness"):
        return
    values = [float(model.jnt_stiffness[j]), *map(float, model.jnt_stiffnesspoly[j])]
    for k, value in enumerate(values):
        if value or not k:
            power = f" {k + 1}" if k else ""
            unit = ("N m/rad" if hinge else "N/m") + (f"^{k + 1}" if k else "")
            place = Place("joint", j, "stiffness", k)
            yield make_number("stiffness", name + power, value, place, sizes.of(hinge, 1, -2), unit)
    if any(values):
        value = float(model.qpos_spring[model.jnt_qposadr[j]])
        place = Place("joint", j, "springref")
        own = 1.0 if hinge else sizes.length
        yield make_number("rest angle", name, value, place, own, "rad" if hinge else "m")


def numbers_of_softness(
    kind: str, name: str, place: Place, values: Iterable[float]
) -> Iterator[Number]:
    """Numbers of a `solref` or `solimp`; those that are 0 are left out as not continuous."""
    for k, value in enumerate(values):
        if value:
            of = f"{name}, {place.attribute.removesuffix('limit')} {k + 1}"
            yield make_number(kind, of, float(value), replace(place, part=k), 1.0)


def used_sites(source: Source) -> dict[int, bool]:
    """Numbers of the sites that the model or a rod refers to, and whether orientation matters."""
    full, bare, found = source.full, source.bare, dict[int, bool]()
    names = {bare.site(s).name: s for s in range(bare.nsite)}

    def use(site: int, directed: bool) -> None:
        if (s := names.get(full.site(site).name)) is not None:
            found[s] = found.get(s, False) or directed

    for i in range(full.nsensor):
        kind = S(int(full.sensor_type[i]))
        if full.sensor_objtype[i] == OBJ.mjOBJ_SITE:
            use(int(full.sensor_objid[i]), kind in DIRECTION_SENSORS or kind in OWN_FRAME_SENSORS)
        if full.sensor_reftype[i] == OBJ.mjOBJ_SITE:
            use(int(full.sensor_refid[i]), True)
    for e in range(full.neq):
        if full.eq_objtype[e] == OBJ.mjOBJ_SITE:
            for site in (full.eq_obj1id[e], full.eq_obj2id[e]):
                use(int(site), full.eq_type[e] != mujoco.mjtEq.mjEQ_CONNECT)
    for a in range(full.nactuator):
        if full.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_SITE:
            for site in full.actuator_trnid[a]:
                if site >= 0:
                    use(int(site), True)
    for t in range(full.ntendon):
        for site in straight_tendon(full, t) or ():
            use(site, False)
    for rod in source.rods:
        for site, end in zip((rod.start, rod.end), rod.ends, strict=True):
            if site in names:
                found[names[site]] = found.get(names[site], False) or end == "clamped"
    return found


def numbers_of_sites(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Positions, and orientations where they matter, of the sites of `used_sites`."""
    model = source.bare
    for s, directed in sorted(used_sites(source).items()):
        name = element_name(model, "site", s)
        axes, place = source.parts(source.frame(int(model.site_bodyid[s]))), Place("site", s, "pos")
        yield from make_components("site", name, model.site_pos[s], axes, place, sizes.length)
        if directed:
            yield make_number("direction", f"site {name}", 0.0, Place("site", s, "turn"), 1.0)


def numbers_of_gravity(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Components of gravity in the plane."""
    gravity = source.full.opt.gravity
    if source.full.opt.disableflags & int(DISABLE_BITS.mjDSBL_GRAVITY):
        return
    natural = float(np.linalg.norm(gravity)) or sizes.length * sizes.time**-2
    axes = source.parts(np.eye(3))
    yield from make_components("gravity", "", gravity, axes, Place("option", 0, "gravity"), natural)


def numbers_of_equalities(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Anchors of loops without sites, polynomials of coupled joints, and softness of loops."""
    model = source.full
    own = len(ModelElements(source).found["equality"])
    for e in range(own):
        if not model.eq_active0[e] or not is_enabled(model, "eq_active0"):
            continue
        name, kind = element_name(model, "equality", e), model.eq_type[e]
        if kind == mujoco.mjtEq.mjEQ_CONNECT and model.eq_objtype[e] == OBJ.mjOBJ_BODY:
            at, axes = model.eq_data[e], source.parts(source.frame(int(model.eq_obj1id[e])))
            place = Place("equality", e, "anchor")
            yield from make_components("anchor", f"loop {name}", at, axes, place, sizes.length)
        if kind == mujoco.mjtEq.mjEQ_JOINT:
            for k in range(5):
                value = float(model.eq_data[e, k])
                if value or not k:
                    place = Place("equality", e, "polycoef", k)
                    yield make_number("coupling", f"{name} {k}", value, place, 1.0)
        for attribute in ("solref", "solimp"):
            yield from numbers_of_softness(
                "softness of the loop",
                name,
                Place("equality", e, attribute),
                getattr(model, f"eq_{attribute}")[e],
            )


def numbers_of_tendons(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Stiffness, damping and free lengths of springs between two sites."""
    model = source.full
    for t in range(model.ntendon):
        if straight_tendon(model, t) is None:
            continue
        name = f"tendon {element_name(model, 'tendon', t)}"
        for attribute, mass, time, unit in (
            ("stiffness", 1, -2, "N/m"),
            ("damping", 1, -1, "N s/m"),
        ):
            if is_enabled(model, COMPILED_FIELDS["tendon", attribute]):
                value = float(getattr(model, COMPILED_FIELDS["tendon", attribute])[t])
                place, natural = Place("tendon", t, attribute), sizes.of(False, mass, time)
                yield make_number(attribute, name, value, place, natural, unit)
        if model.tendon_stiffness[t] and is_enabled(model, "tendon_stiffness"):
            low, high = map(float, model.tendon_lengthspring[t])
            ends = {" low": low, " high": high} if high > low else {"": low}
            for k, (end, value) in enumerate(ends.items()):
                place = Place("tendon", t, "springlength", k)
                yield make_number("spring length", name + end, value, place, sizes.length)


def numbers_of_actuators(
    source: Source, sizes: Sizes, driven: Sequence[str], loads: Sequence[str]
) -> Iterator[Number]:
    """Gears and gains of actuators, and constant loads of those that move no driven joint."""
    model = source.full
    elements = ModelElements(source).found["actuator"]
    for a in range(model.nactuator):
        name, joint = element_name(model, "actuator", a), joint_of(model, a)
        for k, value in enumerate(model.actuator_gear[model.actuator_outadr[a]]):
            if value and (joint < 0 or not k):
                of = name if joint >= 0 else f"{name} {k + 1}"
                place = Place("actuator", a, "gear", k)
                yield make_number("gear", of, float(value), place, 1.0)
        for attribute in ("gainprm", "biasprm", "kp", "kv"):
            element = elements[a]
            words = [] if element is None else element.get(attribute, "").split()
            for k, value in enumerate(map(float, words)):
                if value:
                    place = Place("actuator", a, attribute, k)
                    yield make_number("gain", f"{name}, {attribute} {k + 1}", value, place, 1.0)
        constant = name not in loads and (joint < 0 or model.joint(joint).name not in driven)
        if source.start >= 0 and constant:
            adr = int(model.actuator_ctrladr[a])
            hinge = (
                joint >= 0
                and SCALAR_JOINT_UNITS.get(mujoco.mjtJoint(int(model.jnt_type[joint]))) == "rad"
            )
            natural = sizes.of(hinge, 1, -2) * (1.0 if hinge else sizes.length)
            place = Place("key", source.start, "ctrl", adr)
            yield make_number(
                "load", name, float(model.key_ctrl[source.start, adr]), place, natural
            )


def numbers_of_start(source: Source, sizes: Sizes) -> Iterator[Number]:
    """Values and rates of the joints in the start key, with which a free motion begins."""
    model, key = source.bare, source.start
    if key < 0:
        return
    poses, rates = (own_key_values(source, key, name) for name in ("qpos", "qvel"))
    for j in range(model.njnt):
        unit = SCALAR_JOINT_UNITS.get(mujoco.mjtJoint(int(model.jnt_type[j])))
        if unit is None:
            continue
        name, own = element_name(model, "joint", j), 1.0 if unit == "rad" else sizes.length
        q, v = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        place = Place("key", key, "qpos", q)
        yield make_number("start value", name, float(poses[q]), place, own, unit)
        place, natural = Place("key", key, "qvel", v), own / sizes.time
        value = float(rates[v])
        yield make_number("start rate", name, value, place, natural, f"{unit}/s")


def numbers_of_rods(source: Source) -> Iterator[Number]:
    """Numbers of the rods in the sidecar."""
    for k, rod in enumerate(source.rods):
        for kind, attribute in (
            ("length", "length"),
            ("stiffness of a rod", "stiffness"),
            ("axial stiffness of a rod", "axial"),
            ("shear stiffness of a rod", "shear"),
            ("torsion stiffness of a rod", "torsion"),
            ("stiffness of a rod about y", "stiffness_y"),
            ("mass of a rod", "mass"),
        ):
            if (value := getattr(rod, attribute)) is not None:
                place = Place("rod", k, attribute, rod=rod.name)
                yield make_number(kind, rod.name, float(value), place, 1.0)
        for part, value in enumerate(rod.curvature):
            if not rod.spatial and not value:
                continue
            place = Place("rod", k, "curvature", part, rod.name)
            what = f"{rod.name} about {'xyz'[part]}"
            yield make_number("natural curvature of a rod", what, value, place, 1.0 / rod.length)
        for part, value in enumerate(rod.load):
            if value:
                place = Place("rod", k, "load", part, rod.name)
                yield make_number("load of a rod", f"{rod.name} {'xyz'[part]}", value, place, 1.0)
        if rod.couple:
            place = Place("rod", k, "couple", rod=rod.name)
            yield make_number("couple along a rod", rod.name, rod.couple, place, 1.0)
