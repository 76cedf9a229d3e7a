"""The settings of MuJoCo, and where each of them is in a compiled model and in MJCF.

`ACCURACY` has the accuracy that is expected of MuJoCo for a driven linkage, with reasons; it is the
tolerance of cases that state none.  Its shares hold for RK4 at 1 ms with `solref` 0.005 and
`solimp` 0.9999, which the shipped models have.

The settings that `trade` and `choose` try are in `tried_settings.py`.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator

from proofmass.base.arrays import Array
from proofmass.base.strict import Count, StrictNumber, Switch
from proofmass.sim.protocol.engine import AccuracyLimit
from proofmass.sim.protocol.settings import EngineSettings, StrictNumbers

DISABLE_BITS = mujoco.mjtDisableBit
HARD_SOLIMP = (0.9999, 0.9999, 0.001)  # the hardest solimp that MuJoCo accepts


@dataclass(frozen=True)
class SettingPlace:
    """The place of a setting in MJCF and in a compiled model.

    Attributes
    ----------
    tag : str
        The element of MJCF that has the setting as an attribute: ``option``, ``flag`` in an
        ``option``, or each element of ``equality`` and then also each joint with a range.
    kinds : enumeration of MuJoCo, optional
        The values of an option that has words for them.
    bit : int
        Bit of ``disableflags`` that is set if the flag is disabled.
    omitted_if_default : bool
        Whether the setting is reported and written only if it differs from MuJoCo's default.
    """

    tag: str
    kinds: Any = None
    bit: int = 0
    omitted_if_default: bool = False


SETTING_PLACES = {
    "timestep": SettingPlace("option"),
    "integrator": SettingPlace("option", mujoco.mjtIntegrator),
    "solver": SettingPlace("option", mujoco.mjtSolver),
    "iterations": SettingPlace("option"),
    "tolerance": SettingPlace("option"),
    "cone": SettingPlace("option", mujoco.mjtCone, omitted_if_default=True),
    "impratio": SettingPlace("option", omitted_if_default=True),
    "noslip_iterations": SettingPlace("option", omitted_if_default=True),
    "refsafe": SettingPlace("flag", bit=int(DISABLE_BITS.mjDSBL_REFSAFE), omitted_if_default=True),
    "warmstart": SettingPlace(
        "flag", bit=int(DISABLE_BITS.mjDSBL_WARMSTART), omitted_if_default=True
    ),
    "solref": SettingPlace("equality"),
    "solimp": SettingPlace("equality"),
}
"""Places of all settings that exist in MJCF, by their names there, which are also used here."""
STAGES = {"RK4": 4}  # evaluations of forces in a step; 1 for the other integrators
SOFTNESS_SETTINGS = tuple(key for key, place in SETTING_PLACES.items() if place.tag == "equality")
CAPITALIZED_WORDS = {name.lower(): name for name in ("Euler", "RK4", "PGS", "CG", "Newton")}
"""Words of MJCF with capital letters, by the words in small letters."""


class MujocoSettings(EngineSettings):
    """Settings of MuJoCo; the values of the fields here are MuJoCo's own defaults.

    `timestep` [s], `integrator`, `solver`, `iterations` and `tolerance` replace the options of
    these names.  `solref` and `solimp` replace the first numbers of these attributes in every
    equality, and may be written as in MJCF.  They also apply to the limits of joints, which keep
    their damping ratios.  ``defaults = True`` first restores MuJoCo's defaults.  `settled` chooses
    the kind of a sweep, `flex` that of an equilibrium run.

    `cone`, `impratio` and `noslip_iterations` are the options of these names and act on contacts
    and dry friction.  ``refsafe = False`` allows a `solref` shorter than two time steps, and
    ``warmstart = False`` starts the solver of each step anew; both are flags of MJCF.
    """

    timestep: StrictNumber = Field(0.002, gt=0)
    integrator: str = "Euler"
    solver: str = "Newton"
    iterations: Count = 100
    tolerance: StrictNumber = Field(1e-8, ge=0)
    cone: str = "pyramidal"
    impratio: StrictNumber = Field(1.0, gt=0)
    noslip_iterations: Annotated[int, Field(strict=True, ge=0, lt=2**31)] = 0
    refsafe: Switch = True
    warmstart: Switch = True
    solref: StrictNumbers = (0.02, 1.0)
    solimp: StrictNumbers = (0.9, 0.95, 0.001, 0.5, 2.0)
    settled: Switch = False
    flex: Switch = False
    defaults: Switch = False

    @field_validator("integrator", "solver", "cone")
    @classmethod
    def _named(cls, value: str, info: ValidationInfo) -> str:
        names = option_values(str(info.field_name))
        if value.lower() not in names:
            raise ValueError(f"known: {', '.join(names)}")
        return value.lower()

    @field_validator("solref")
    @classmethod
    def _reference(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not (1 <= len(value) <= 2 and (min(value) > 0 or (len(value) == 2 and max(value) <= 0))):
            raise ValueError(
                "give a time constant [s] and a damping ratio, both positive, or "
                "stiffness and damping, both negative"
            )
        return value

    @field_validator("solimp")
    @classmethod
    def _impedance(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        most = (1.0, 1.0, np.inf, 1.0, np.inf)
        least = (0.0, 0.0, 0.0, 0.0, 1.0)
        if not 1 <= len(value) <= 5 or any(
            not low <= v <= high for low, v, high in zip(least, value, most, strict=False)
        ):
            raise ValueError(
                "give up to five numbers: dmin and dmax in [0, 1], width >= 0, "
                "midpoint in [0, 1], power >= 1"
            )
        return value


ENGINE_DEFAULTS = {
    key: MujocoSettings.model_fields[key].default
    for key in ("timestep", "integrator", "solref", "solimp")
}
"""The settings that ``defaults = True`` restores, with MuJoCo's defaults."""


def option_values(option: str) -> dict[str, int]:
    """The numerical values of an option that has words for them, by the words in small letters."""
    return {
        name.partition("_")[2].lower(): value
        for name, value in SETTING_PLACES[option].kinds.__members__.items()
    }


def configure(model: mujoco.MjModel, settings: Mapping[str, object]) -> None:
    """Write engine settings into a compiled model, in place; see `MujocoSettings`."""
    given = MujocoSettings.read(settings).model_dump(exclude_unset=True)
    merged = {**(ENGINE_DEFAULTS if given.get("defaults") else {}), **given}
    for key in merged.keys() & SETTING_PLACES.keys():
        place, value = SETTING_PLACES[key], merged[key]
        if place.tag == "equality":
            row = np.asarray(value, dtype=float)
            getattr(model, f"eq_{key}")[:, : row.size] = row
            soften_limits(model, key, row)
        elif place.tag == "flag":
            flags = int(model.opt.disableflags)
            model.opt.disableflags = flags & ~place.bit if value else flags | place.bit
        else:
            setattr(model.opt, key, option_values(key)[value.lower()] if place.kinds else value)


def limited_joints(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Numbers of the joints with a range whose `solref` has a time constant, not a stiffness."""
    return np.flatnonzero(model.jnt_limited.astype(bool) & (model.jnt_solref[:, 0] > 0))


def soften_limits(model: mujoco.MjModel, key: str, row: Array) -> None:
    """Write `solref` or `solimp` of a setting into the limits of joints, in place.

    The damping ratio of a limit, on which the rebound from an impact depends, is kept.  A setting
    with a stiffness in place of a time constant changes no limit.
    """
    joints = limited_joints(model)
    if key == "solimp":
        model.jnt_solimp[joints, : row.size] = row
    elif row[0] > 0:
        model.jnt_solref[joints, 0] = row[0]


def limit_softness(model: mujoco.MjModel, keys: Iterable[str]) -> dict[str, dict[str, str]]:
    """Attributes that state the softness of joint limits in MJCF, by the name of the joint."""
    return {
        name: {f"{key}limit": mjcf_text(getattr(model, f"jnt_{key}")[j].tolist()) for key in keys}
        for j in limited_joints(model).tolist()
        if (name := model.joint(j).name)
    }


def write_limits(root: Element, limits: Mapping[str, Mapping[str, str]]) -> None:
    """Write attributes of joints, as `limit_softness` gives them, into their elements, in place."""
    for joint in root.iterfind(".//worldbody//joint"):
        joint.attrib.update(limits.get(joint.get("name", ""), {}))


def read_options(model: mujoco.MjModel, always: Collection[str] = ()) -> dict[str, object]:
    """Options and flags of a compiled model; those in `always` even if they are quiet defaults."""
    options = dict[str, object]()
    for key, place in SETTING_PLACES.items():
        if place.tag == "equality":
            continue
        value = (
            not model.opt.disableflags & place.bit
            if place.tag == "flag"
            else getattr(model.opt, key)
        )
        if place.kinds:
            value = place.kinds(value).name.partition("_")[2]
        own = mjcf_text(value) == mjcf_text(MujocoSettings.model_fields[key].default)
        if key in always or not (place.omitted_if_default and own):
            options[key] = value
    return options


def stepping_settings(model: mujoco.MjModel) -> dict[str, object]:
    """Settings with which MuJoCo steps a model: options, and the softness of active equalities.

    A sweep that closes its loops by Newton's method uses none of them.
    """
    settings = read_options(model)
    for key in SOFTNESS_SETTINGS:
        rows = np.unique(getattr(model, f"eq_{key}")[model.eq_active0.astype(bool)], axis=0)
        if len(rows):
            settings[key] = tuple(rows[0].tolist()) if len(rows) == 1 else "several"
    return settings


def mjcf_text(value: object) -> str:
    """A value as text of MJCF, with all its digits.

    >>> mjcf_text((0.02, 1.0)), mjcf_text(1 / 3), mjcf_text("EULER")
    ('0.02 1', '0.3333333333333333', 'Euler')
    >>> mjcf_text(100), mjcf_text(False)
    ('100', 'disable')
    """
    if isinstance(value, (tuple, list)):
        return " ".join(map(mjcf_text, value))
    if isinstance(value, bool):
        return "enable" if value else "disable"
    if isinstance(value, str):
        return CAPITALIZED_WORDS.get(value.lower(), value.lower())
    return str(value).removesuffix(".0")


def write_options(root: Element, options: Mapping[str, object]) -> None:
    """Write options and flags into the last ``option`` of a model, in place.

    >>> root = Element("mujoco")
    >>> write_options(root, {"cone": "elliptic", "refsafe": False})
    >>> ElementTree.tostring(root, encoding="unicode")
    '<mujoco><option cone="elliptic"><flag refsafe="disable" /></option></mujoco>'
    """
    for key, value in options.items():
        if (tag := SETTING_PLACES[key].tag) != "equality":
            option = last_section(root, "option")
            (option if tag == "option" else last_section(option, tag)).set(key, mjcf_text(value))


def last_section(parent: Element, tag: str) -> Element:
    """The last child element of that name; added if there is none."""
    found = parent.findall(tag)
    return found[-1] if found else ElementTree.SubElement(parent, tag)


ACCURACY = {
    "sweep": AccuracyLimit(
        1e-12, "loops closed by Newton on the engine's constraint rows: rounding only"
    ),
    "rest": AccuracyLimit(
        1e-10,
        "stiffness by differences of the engine's forces: 1e-12 of it, over the least stiffness of "
        "what the drives leave",
    ),
    "position": AccuracyLimit(
        1e-6,
        "RK4: what is left is the softness of the loops, a floor of solref and "
        "solimp that no smaller step lowers",
    ),
    "velocity": AccuracyLimit(5e-6, "softness of the loops, differentiated once"),
    "acceleration": AccuracyLimit(
        1e-3,
        "solimp is capped at 0.9999, so 1e-4 of the acceleration that "
        "gravity would give the open loops remains; and RK4's own error in the "
        "spring and damper that holds a loop, 4th order in step over solref",
    ),
    "force": AccuracyLimit(
        1e-3, "forces go with accelerations, of which the softness of the loops leaves a part"
    ),
}
