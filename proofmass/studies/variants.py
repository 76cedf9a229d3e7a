"""Variants: changed copies of cases whose reference is still known.

The reference of a variant follows by dimensional analysis, or is computed from the changed model,
or stays the same function where only the motion of the drives is changed.

The reference of a self-referenced case is computed from its own MJCF, so that the MJCF may be
changed.

In a scaled case times and masses stay.  If all lengths are multiplied by s, gravity is multiplied
by s as well; then forces are multiplied by s, moments, energies and inertias by s^2, and the curves
keep their shape.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from proofmass.base.arrays import Array
from proofmass.base.files import read_bytes, write_atomically
from proofmass.base.recorded import RecordedColumn, decode_csv
from proofmass.base.strict import Kind
from proofmass.case.case import Case, LoadTable
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import evaluate
from proofmass.reference.profiles import drive_profiles
from proofmass.reference.samples import run_samples
from proofmass.sim.mjcf import read_tree
from proofmass.sim.protocol.curves import Curves
from proofmass.studies.bounded import call_bounded
from proofmass.studies.store import digest

PLANAR_REFERENCE = "planar"
"""The reference that is computed from the model itself, for the sensors of any planar model."""


def with_planar_reference(case: Case) -> Case:
    """The case with the planar reference, which is computed from the model, for all its channels.

    Channels that are compared with a number stay as they are.  The motion profile of a drive must
    not come from the old reference: see `has_independent_motion`.
    """
    if case.reference == PLANAR_REFERENCE:
        return case
    channels = {
        name: channel
        if isinstance(channel.equals, float)
        else channel.model_copy(update={"equals": name, "scale": 1.0, "shift": 0.0})
        for name, channel in case.channels.items()
    }
    unscaled_loads = tuple(load.model_copy(update={"scales": ()}) for load in case.load)
    changed = {
        "reference": PLANAR_REFERENCE,
        "parameters": {},
        "channels": channels,
        "load": unscaled_loads,
    }
    return case.model_copy(update=changed)


def has_independent_motion(case: Case) -> bool:
    """Whether the motion does not depend on the reference: no motion profile or curve of it."""
    return not case.recorded and all(d.to is not None for d in case.drive)


LENGTH_POWERS = {"m": 1, "m/s": 1, "m/s^2": 1, "N": 1, "N m": 2, "J": 2}
"""Powers of the length scale by which quantities of a unit are multiplied; other units by none."""
FORCE_POWERS = {"N": 1, "N m": 1, "J": 1}
"""Powers of a factor on all forces, at constant lengths, by unit of the channels."""
LENGTH_ATTRIBUTES = "pos", "size", "fromto", "from", "to", "anchor", "extent"
HINGE_LENGTH_POWERS = {"stiffness": 2, "damping": 2, "armature": 2, "frictionloss": 2}
SLIDE_LENGTH_POWERS = {"range": 1, "ref": 1, "springref": 1, "frictionloss": 1}


def with_model(case: Case, folder: Path, change: Callable[[Element], None]) -> Case:
    """The case with a changed copy of its MJCF, which is written into a folder."""
    root = read_tree(case.model_path)
    change(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return case.model_copy(update={"model": str(write_variant_file(folder, case.model_path, text))})


def with_every_other_row(case: Case, folder: Path) -> Case:
    """The case with every other row of its recorded curve, which are written into a folder."""
    file = case.file.parent / case.reference
    head, *rows = [
        line
        for line in decode_csv(read_bytes(file)).splitlines()
        if line.strip() and not line.lstrip().startswith("#")
    ]
    text = "\n".join([head, *rows[::2]]) + "\n"
    return case.model_copy(update={"reference": str(write_variant_file(folder, file, text))})


KEPT_LETTERS = 40  # of the name of a file; with their digest they fit into the 255 bytes of a name


def write_variant_file(folder: Path, original: Path, text: str) -> Path:
    """Write a text into a folder; the file is named after `original` and the digest of the text."""
    file = (
        folder.absolute()
        / f"{original.stem[:KEPT_LETTERS]}-{digest(text.encode())[:16]}{original.suffix}"
    )
    folder.mkdir(parents=True, exist_ok=True)
    if not file.exists():
        write_atomically(file, text)
    return file


def multiply_attribute(element: Element, key: str, factor: ArrayLike) -> None:
    """Multiply the numbers of an attribute of an element, if it has that attribute."""
    if key in element.attrib:
        values = np.array(element.get(key, "").split(), float) * np.asarray(factor)
        element.set(key, " ".join(repr(float(v)) for v in values))


def with_scaled_channels(case: Case, powers: dict[str, int], factor: float) -> Case:
    """The case with its channels multiplied by a power of a factor, which depends on the unit.

    The planar reference is computed from the changed model and needs no such factor.
    """
    if case.reference == PLANAR_REFERENCE:
        return case
    channels = {}
    for name, channel in case.channels.items():
        scale = factor ** powers.get(channel.si_unit, 0)
        channels[name] = channel.model_copy(
            update={"scale": channel.scale * scale, "shift": channel.shift * scale}
        )
    return case.model_copy(update={"channels": channels})


def with_scaled_last_mass(case: Case, folder: Path, factor: float) -> Case:
    """The case with mass and inertia of its last body multiplied by a factor."""

    def change(root: Element) -> None:
        *_, last = root.iter("inertial")
        for key in ("mass", "diaginertia", "fullinertia"):
            multiply_attribute(last, key, factor)

    return with_model(case, folder, change)


def with_scaled_gravity(case: Case, folder: Path, factor: float) -> Case:
    """The case with gravity multiplied by a factor, in the model and in the parameters."""
    parameters = {
        k: v * factor if k == "gravity" and not isinstance(v, str) else v
        for k, v in case.parameters.items()
    }
    changed = with_model(case, folder, lambda root: set_gravity(root, compiled_model(case), factor))
    return changed.model_copy(update={"parameters": parameters})


def set_gravity(root: Element, model: mujoco.MjModel, factor: float) -> None:
    """Write gravity, that of the compiled model times a factor, into an MJCF."""
    option = root.find("option")
    if option is None:
        option = ElementTree.SubElement(root, "option")
    option.set("gravity", " ".join(repr(float(g)) for g in model.opt.gravity * factor))


def with_scaled_stiffness(case: Case, folder: Path, factor: float) -> Case:
    """The case with stiffness of all springs and rods, and all loads, multiplied by a factor."""

    def change(root: Element) -> None:
        for joint in root.iter("joint"):
            multiply_attribute(joint, "stiffness", factor)
        for key in root.iter("key"):
            multiply_attribute(key, "ctrl", factor)

    rods = {
        name: rod.model_copy(
            update={
                key: value * factor
                for key in ("stiffness", "axial", "shear")
                if (value := getattr(rod, key)) is not None
            }
            | {"load": tuple(factor * value for value in rod.load)}
        )
        for name, rod in case.rod.items()
    }
    changed = with_model(case, folder, change).model_copy(update={"rod": rods})
    return with_scaled_channels(with_scaled_loads(changed, lambda _: factor), FORCE_POWERS, factor)


def with_scaled_loads(case: Case, factor: Callable[[str], float]) -> Case:
    """The case with the controls of its changing loads multiplied by a factor of each actuator."""

    def times(load: LoadTable) -> LoadTable:
        by, changed = factor(load.actuator), dict[str, object]()
        if load.to is not None:
            changed = {"start": by * load.start, "to": by * load.to}
        if load.profile is not None and load.profile.value is not None:
            value = scale_column(load.profile.value, by)
            changed = {"profile": load.profile.model_copy(update={"value": value})}
        return load.model_copy(update=changed)

    return case.model_copy(update={"load": tuple(map(times, case.load))})


def scale_column(column: RecordedColumn | tuple[float, ...], factor: float) -> Any:
    """A column of a profile with all its values multiplied by a factor."""
    if isinstance(column, tuple):
        return tuple(factor * value for value in column)
    return column.model_copy(
        update={"scale": factor * column.scale, "shift": factor * column.shift}
    )


def with_scaled_lengths(case: Case, folder: Path, factor: float) -> Case:
    """The case with all lengths multiplied by a factor, and quantities by powers of it.

    The reference keeps its own lengths, so that it must not be asked for a length: the case may
    have no rod and no driven slide.
    """
    model = compiled_model(case)
    changed = with_model(case, folder, lambda root: scale_mjcf_lengths(root, model, factor))
    powers = control_length_powers(model)

    def as_large(actuator: str) -> float:
        return float(factor ** powers[model.actuator_ctrladr[model.actuator(actuator).id]])

    return with_scaled_channels(with_scaled_loads(changed, as_large), LENGTH_POWERS, factor)


def count_solimp_values(equality: Element) -> int:
    """Number of values in the ``solimp`` of an equality."""
    return len(equality.get("solimp", "").split())


def scale_mjcf_lengths(root: Element, model: mujoco.MjModel, factor: float) -> None:
    """Multiply all numbers of an MJCF that depend on lengths by powers of a factor."""
    for element in root.iter():
        for key in LENGTH_ATTRIBUTES:
            multiply_attribute(element, key, factor)
        for key in ("diaginertia", "fullinertia"):
            multiply_attribute(element, key, factor**2)
        if element.tag in ("connect", "equality"):  # the third value is a width [m]
            multiply_attribute(
                element,
                "solimp",
                np.array([1.0, 1.0, factor, 1.0, 1.0])[: count_solimp_values(element)],
            )
    for joint in root.iter("joint"):
        sliding = joint.get("type") == "slide"
        for key, power in (SLIDE_LENGTH_POWERS if sliding else HINGE_LENGTH_POWERS).items():
            multiply_attribute(joint, key, factor**power)
    for start in root.iter("key"):
        for name in ("qpos", "qvel"):
            multiply_attribute(
                start, name, factor ** joint_length_powers(model, len(start.get(name, "").split()))
            )
        multiply_attribute(start, "ctrl", factor ** control_length_powers(model))
    set_gravity(root, model, factor)


def joint_length_powers(model: mujoco.MjModel, count: int) -> Array:
    """Powers of the length for the values of the first `count` joints: 1 for slides, else 0.

    Joints have one coordinate and one rate each in the models that both engines can run.
    """
    return np.array(model.jnt_type[:count] == mujoco.mjtJoint.mjJNT_SLIDE, float)


def control_length_powers(model: mujoco.MjModel) -> Array:
    """Powers of the length for the controls of all actuators: moments 2, forces 1."""
    powers = [2 if is_on_hinge(model, a) else 1 for a in range(model.nactuator)]
    return np.repeat(powers, model.actuator_ctrlnum)


def is_on_hinge(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator acts on a hinge."""
    joint = int(model.actuator_trnid[actuator, 0])
    on_joint = int(model.actuator_trntype[actuator]) == mujoco.mjtTrn.mjTRN_JOINT
    return bool(on_joint and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE)


def inertial_elements(case: Case) -> list[Element]:
    """The ``inertial`` elements of the MJCF, one for each body whose mass it states."""
    return list(read_tree(case.model_path).iter("inertial"))


STEP_COUNT_ROUNDING = 1e-9  # [steps] by which a number of steps may be below a whole one
MIN_LATER_SAMPLES = 2  # least number of samples after the first one


def with_drive_distance(case: Case, distance: float) -> Case:
    """The case with its first drive moving `distance` at constant speed, others in proportion."""
    old_distance = case.drive[0].way
    factor = distance / abs(old_distance)
    first, *others = (
        drive
        if drive.to is None
        else drive.model_copy(update={"to": drive.start + drive.way * factor})
        for drive in case.drive
    )
    steady = first.model_copy(update={"period": None, "rate": float(np.sign(old_distance))})
    return case.model_copy(update={"drive": (steady, *others)})


def with_drive_swing(case: Case, distance: float, seconds: float) -> Case:
    """The case with its first drive swinging `distance` and back in a period of `seconds`."""
    leader, *others = with_drive_distance(case, distance).drive
    swing = leader.model_copy(update={"rate": None, "period": seconds})
    return case.model_copy(update={"drive": (swing, *others)})


def with_whole_steps(case: Case, seconds: float, step: float) -> Case:
    """The case with its samples moved so that an engine takes exactly the step that is asked for.

    A whole number of steps leads from sample to sample: as many as fit between two samples of the
    case, or one.  The end of the run is moved to the nearest sample.  A motion that may not go on
    past its end (see `can_be_extended`) ends at the last sample that is not past it.

    Parameters
    ----------
    case : Case
        With a dynamics run, and a reference that can be evaluated at any time.
    seconds : float
        Duration that is asked for [s].
    step : float
        Time step [s].

    Returns
    -------
    Case
    """
    run = case.run["dynamics"]
    steps_per_sample = max(1, int(seconds / ((run.n or 2) - 1) / step + STEP_COUNT_ROUNDING))
    samples = seconds / (steps_per_sample * step)
    samples = max(
        MIN_LATER_SAMPLES,
        round(samples) if can_be_extended(case) else int(samples + STEP_COUNT_ROUNDING),
    )
    case = case.with_run("dynamics", n=samples + 1)
    return with_duration(case, samples * steps_per_sample * step)


def with_duration(case: Case, seconds: float) -> Case:
    """The case with a dynamics run of another duration [s]; drives keep their speed or period."""
    if case.drive and case.drive[0].steady:
        leader = case.drive[0]
        extended, *others = with_drive_distance(case, abs(leader.speed) * seconds).drive
        extended = extended.model_copy(update={"rate": leader.rate})
        return case.model_copy(update={"drive": (extended, *others)})
    return case.with_run("dynamics", until=seconds)


def can_be_extended(case: Case) -> bool:
    """Whether a motion may go on past its end: free, to and fro, whole turns; no load profile."""
    if any(load.profile for load in case.load):
        return False
    if not case.drive or case.drive[0].period:
        return True
    leader = case.drive[0]
    return leader.steady and makes_whole_turns(case, abs(leader.way))


def with_longer_run(case: Case, factor: float, seconds: float) -> Case:
    """The case with its dynamics run of `seconds` extended by a factor, with as many samples.

    A drive that makes no whole turns moves to and fro instead.  The profile of a load cannot be
    extended.
    """
    if case.drive and not can_be_extended(case):
        case = with_drive_swing(case, abs(case.drive[0].way), 2.0 * seconds)
    return with_duration(case, seconds * factor)


def evaluate_reference(case: Case, kind: Kind) -> Curves:
    """The reference curves of a run at the prescribed motion of its drives, from a worker."""
    return cast(Curves, call_bounded(case, kind, evaluate_reference_here, case, kind))


def evaluate_reference_here(case: Case, kind: Kind) -> Curves:
    """The reference curves of a run at the prescribed motion of its drives, in this process."""
    x = run_samples(case, kind)
    state = tuple(
        np.array(part)
        for part in zip(*(profile(x) for profile in drive_profiles(case, kind)), strict=True)
    )
    return evaluate(case, kind, x, state)  # type: ignore[arg-type]


def makes_whole_turns(case: Case, distance: float) -> bool:
    """Whether the first drive is a hinge and its way is a whole number of turns."""
    fraction = distance / (2 * np.pi) % 1.0
    return has_hinged_leader(case) and distance > 1.0 and min(fraction, 1.0 - fraction) < 1e-6


def has_hinged_leader(case: Case) -> bool:
    """Whether the joint of the first drive is a hinge."""
    kind = int(compiled_model(case).joint(case.drive[0].joint).type[0])
    return kind == int(mujoco.mjtJoint.mjJNT_HINGE)
