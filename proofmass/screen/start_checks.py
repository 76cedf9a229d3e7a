"""Faults of a start that need no derivative: ranges, masses, contacts, actuators, sensors."""

from collections.abc import Iterator

import mujoco
import numpy as np

from proofmass.base.wording import format_count, format_list, number
from proofmass.screen.finding import FindingKind, ModelFinding, NamedElement, Severity
from proofmass.screen.mobility import CLOSURES
from proofmass.screen.pose import HINGE, SLIDE, coordinate_unit, named_element
from proofmass.sim.contents import anchor_bodies
from proofmass.sim.dense import moment_arms, outputs_of

OUTSIDE_RANGE = 1e-6
"""Distance of a joint from its range that is told [rad or m]."""
INERTIA_SHARE = 1e-6
"""Share by which two principal moments of inertia may be less than the third."""
MASS_RATIO = 1e4
"""Ratio of the largest to the least mass of a moving body that is told."""
DEEP_SHARE = 0.01
"""Depth of a contact, as a share of the model's extent, that is told as a warning."""
TOUCHING = 1e-9
"""Least depth of a contact that is told [m]."""
NO_ARM = 1e-12
"""Largest moment arm of an actuator that moves nothing [1 or m]."""
MAX_NAMES = 4


def judge_start(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[ModelFinding]:
    """All that is noticed of the start state of a model as it is."""
    yield from judge_ranges(model, data)
    yield from judge_masses(model)
    yield from judge_inertias(model)
    yield from judge_contacts(model, data)
    yield from judge_actuators(model, data)


def judge_ranges(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[ModelFinding]:
    """Joints that start outside their ranges."""
    for j in range(model.njnt):
        if not model.jnt_limited[j] or model.jnt_type[j] not in (HINGE, SLIDE):
            continue
        place, (low, high) = data.qpos[model.jnt_qposadr[j]], model.jnt_range[j]
        if (outside := float(max(low - place, place - high))) > OUTSIDE_RANGE:
            joint = named_element(model, "joint", j)
            unit = coordinate_unit(model, int(model.jnt_dofadr[j]))
            yield ModelFinding(
                FindingKind.RANGE,
                Severity.WARNING,
                f"{joint} starts {number(outside)} {unit} outside its range: its stop pushes it "
                "back",
                "start inside the range",
                joint,
                outside,
            )


def judge_masses(model: mujoco.MjModel) -> Iterator[ModelFinding]:
    """Moving bodies whose masses are far apart; bodies without joints between them are one."""
    group = np.asarray(model.body_weldid)
    masses = np.bincount(group, model.body_mass, minlength=model.nbody)
    moving = [int(b) for b in np.unique(group) if b and masses[b] > 0.0]
    if not moving:
        return
    light, heavy = min(moving, key=lambda b: masses[b]), max(moving, key=lambda b: masses[b])
    if (ratio := float(masses[heavy] / masses[light])) > MASS_RATIO:
        element = named_element(model, "body", light)
        yield ModelFinding(
            FindingKind.MASS,
            Severity.WARNING,
            f"{named_element(model, 'body', heavy)} has {number(ratio, 2)} times the mass of "
            f"{element}: {number(masses[heavy], 2)} and {number(masses[light], 2)} kg",
            "check the units of masses and densities",
            element,
            ratio,
        )


def judge_inertias(model: mujoco.MjModel) -> Iterator[ModelFinding]:
    """Principal moments of inertia that no body can have."""
    for b in range(1, model.nbody):
        small, middle, large = np.sort(model.body_inertia[b])
        if small + middle < large * (1.0 - INERTIA_SHARE):
            body = named_element(model, "body", b)
            yield ModelFinding(
                FindingKind.INERTIA,
                Severity.WARNING,
                f"{body} has principal moments of inertia that no body can have, {number(small)}, "
                f"{number(middle)} and {number(large)} kg m²: the last exceeds the others' sum",
                "check the inertial element",
                body,
                float(large),
            )


def judge_contacts(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[ModelFinding]:
    """Geoms that begin in contact."""
    touching = [contact for contact in data.contact[: data.ncon] if contact.dist < -TOUCHING]
    if not touching:
        return
    deepest = min(touching, key=lambda contact: contact.dist)
    one, other = (named_element(model, "geom", int(g)) for g in deepest.geom)
    depth = -float(deepest.dist)
    deep = depth > DEEP_SHARE * model.stat.extent
    yield ModelFinding(
        FindingKind.CONTACT,
        Severity.WARNING if deep else Severity.NOTE,
        f"{format_count(len(touching), 'contact')} at the start, the deepest by {number(depth)} m, "
        f"of {one} and {other}",
        separate(model, deepest) if deep else "",
        one,
        depth,
    )


def are_joined(model: mujoco.MjModel, first: int, second: int) -> bool:
    """Whether a connect or a weld joins two bodies."""
    loops = np.flatnonzero(np.isin(model.eq_type, CLOSURES))
    return any(set(anchor_bodies(model, int(e))) == {first, second} for e in loops)


def separate(model: mujoco.MjModel, contact: "mujoco._structs.MjContact") -> str:
    """How to keep two geoms apart that begin in contact."""
    first, second = (int(model.geom_bodyid[g]) for g in contact.geom)
    group = model.body_weldid
    parents = {int(group[model.body_parentid[group[body]]]) for body in (first, second)}
    carries = bool({int(group[first]), int(group[second])} & parents)
    joined = are_joined(model, first, second)
    if not (carries or joined) or 0 in (first, second):
        return "start apart, or exclude neighbours from contact"
    names = [model.body(body).name for body in (first, second)]
    if not all(names):
        return "give both bodies names and leave their contacts out by an <exclude> in <contact>"
    exclude = f'<exclude body1="{names[0]}" body2="{names[1]}"/> in <contact>'
    if joined and not carries:
        return f"{exclude}, since a loop joins them"
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT):
        return f'filterparent="enable", or {exclude}, since one carries the other'
    if 0 in (group[first], group[second]):
        why = "MuJoCo leaves out contacts of a body with its parent only if the parent moves"
        return f"{exclude}: {why}"
    return exclude


def judge_actuators(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[ModelFinding]:
    """Actuators that move nothing, those with the same cause together."""
    arms = moment_arms(model, data)
    idle: dict[str, list[NamedElement]] = {}
    for a in range(model.nactuator):
        no_gain = (
            model.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED
            and not model.actuator_gainprm[a][:3].any()
            and not model.actuator_biasprm[a][:3].any()
        )
        no_arm = np.abs(arms[outputs_of(model, a)]).max(initial=0.0) < NO_ARM
        if why := "no arm at the start" if no_arm else "a gain of 0" if no_gain else "":
            idle.setdefault(why, []).append(named_element(model, "actuator", a))
    for why, actuators in idle.items():
        yield ModelFinding(
            FindingKind.ACTUATOR,
            Severity.NOTE,
            f"{format_names('actuator', actuators)} with {why} "
            f"{'moves' if len(actuators) == 1 else 'move'} nothing",
            element=actuators[0],
            value=float(len(actuators)),
        )


def format_names(kind: str, elements: list[NamedElement]) -> str:
    """The kind and the names of elements; of many, their number and the first names.

    >>> format_names("motor", [NamedElement("motor", name) for name in "ab"])
    'motors a and b'
    >>> format_names("motor", [NamedElement("motor", name) for name in "abcdef"])
    '6 motors (a, b, c and d and 2 more)'
    """
    names = format_list(element.name for element in elements[:MAX_NAMES])
    if len(elements) > MAX_NAMES:
        return f"{len(elements)} {kind}s ({names} and {len(elements) - MAX_NAMES} more)"
    return f"{kind if len(elements) == 1 else kind + 's'} {names}"


def judge_sensors(
    model: mujoco.MjModel, start: mujoco.MjData, later: mujoco.MjData
) -> Iterator[ModelFinding]:
    """Sensors whose values are the same in two states of a model that moves."""
    still = [
        named_element(model, "sensor", s)
        for s in range(model.nsensor)
        for part in [slice(model.sensor_adr[s], model.sensor_adr[s] + model.sensor_dim[s])]
        if np.array_equal(start.sensordata[part], later.sensordata[part])
    ]
    if still:
        names = format_list(element.name for element in still[:MAX_NAMES])
        more = f" and {len(still) - MAX_NAMES} more" if len(still) > MAX_NAMES else ""
        yield ModelFinding(
            FindingKind.SENSOR,
            Severity.NOTE,
            f"{len(still)} of {model.nsensor} sensors do not change: {names}{more}",
            element=still[0],
            value=float(len(still)),
        )
