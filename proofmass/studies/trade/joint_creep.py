r"""Settings with which joints creep slowly enough that dry friction should keep at rest.

MuJoCo's dry friction of joints is soft: below its limit a joint under a load f creeps with

    v = (1 - d) f T D A / (2 d),

with the impedance d and the largest one D of its ``solimpfriction``, the time constant T of its
``solreffriction`` and the inverse inertia A of the joint; see `proofmass.screen.creep`.  Two kinds
of settings are tried: first a larger impedance, up to MuJoCo's largest, and a shorter T where that
is not enough; then the solver without slip (``noslip_iterations``), which removes the softness.
Where friction holds a mechanism by its loops, as a screw holds its nut, soft loops give way as
well: they are made stiffer if nothing else is slow enough.  All are measured by a run: predictions
only say what to try.
"""

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, inf, log10
from typing import NamedTuple

import mujoco
import numpy as np

from proofmass.base.wording import format_list, number
from proofmass.screen.creep import STIFF_IMPEDANCE, CreepingJoint, creeping_joints
from proofmass.screen.finding import NamedElement
from proofmass.screen.mobility import equality_element
from proofmass.screen.pose import coordinate_unit, named_element
from proofmass.screen.short_run import start_key, start_of, steps_of_run
from proofmass.sim.dense import constraint_rows
from proofmass.sim.mjcf import collected_warnings, failure_warning
from proofmass.sim.model_source import ModelSource
from proofmass.studies.trade.creep import FINAL_SHARE, RATE_MARGIN

HOLDING_ITERATIONS = 5, 10, 20, 50, 100, 200
"""Numbers of iterations that are tried.  Each sweep over the joints of an arm divides the creep by
about two, so that 200 leave rounding."""
LEAST_STEPS_OF_CONSTANT = 2.0
"""Time constant over the time step below which MuJoCo lengthens it (``refsafe``) [1]."""
IMPEDANCE_WIDTH = 0.001
"""Third number of a ``solimpfriction`` [its unit]; it has no effect where the first two agree."""


class HoldingLoop(NamedTuple):
    """An equality by which friction holds joints: its number, its element, and how that is found.

    It is found by its name, or by what it joins.
    """

    equality: int
    element: NamedElement
    attributes: str


class HeldJoint(NamedTuple):
    """A joint without friction that friction holds: its element, unit and speed [its unit/s]."""

    element: NamedElement
    unit: str
    rate: float


@dataclass(frozen=True)
class FrictionSetting:
    """A setting of dry friction that may differ from the model's.

    Attributes
    ----------
    impedance, constant : float
        Of the joints that creep [1, s]; 0 for those of the model.
    iterations : int
        Of the solver without slip; 0 for those of the model.
    loops : tuple of HoldingLoop
        Equalities that get MuJoCo's largest impedance.
    loop_constant : float
        Their time constant [s].
    """

    impedance: float = 0.0
    constant: float = 0.0
    iterations: int = 0
    loops: tuple[HoldingLoop, ...] = ()
    loop_constant: float = 0.0

    @property
    def attributes(self) -> dict[str, str]:
        """The attributes of each joint that creeps."""
        found = dict[str, str]()
        if self.impedance:
            found["solimpfriction"] = f"{self.impedance:g} {self.impedance:g} {IMPEDANCE_WIDTH:g}"
        if self.constant:
            found["solreffriction"] = f"{self.constant:g} 1"
        return found

    @property
    def words(self) -> str:
        """The setting as text."""
        parts = [f"{key} {value}" for key, value in self.attributes.items()]
        if self.iterations:
            parts.append(f"noslip_iterations {self.iterations}")
        if self.loops:
            names = format_list(str(loop.element) for loop in self.loops)
            parts.append(f"solref {self.loop_constant:g} 1 of {names}")
        return ", ".join(parts) or "as in the model"

    def apply(self, model: mujoco.MjModel, joints: Sequence[CreepingJoint]) -> mujoco.MjModel:
        """A copy of a model with this setting."""
        changed = copy.copy(model)
        own = [joint.coordinate for joint in joints]
        if self.impedance:
            changed.dof_solimp[own, :3] = self.impedance, self.impedance, IMPEDANCE_WIDTH
        if self.constant:
            changed.dof_solref[own] = self.constant, 1.0
        if self.iterations:
            changed.opt.noslip_iterations, changed.opt.noslip_tolerance = self.iterations, 0.0
        for loop in self.loops:
            changed.eq_solref[loop.equality] = self.loop_constant, 1.0
            stiff = STIFF_IMPEDANCE, STIFF_IMPEDANCE, IMPEDANCE_WIDTH
            changed.eq_solimp[loop.equality, :3] = stiff
        return changed

    def lines(self, joints: Sequence[CreepingJoint]) -> Iterator[str]:
        """The lines of MJCF; those of joints have the attributes to add to their elements."""
        if self.iterations:
            yield f'<option noslip_iterations="{self.iterations}" noslip_tolerance="0"/>'
        text = " ".join(f'{key}="{value}"' for key, value in self.attributes.items())
        for joint in joints if text else ():
            where = f"<!-- {joint.joint} -->" if joint.joint.body else ""
            name = "" if where else f'name="{joint.joint.name}" '
            yield f"<joint {name}{text}/>{where}"
        for loop in self.loops:
            softness = f"{STIFF_IMPEDANCE:g} {STIFF_IMPEDANCE:g} {IMPEDANCE_WIDTH:g}"
            yield (
                f"<equality><{loop.element.tag} {loop.attributes} "
                f'solref="{self.loop_constant:g} 1" solimp="{softness}"/></equality>'
            )


@dataclass(frozen=True)
class JointCreepRates:
    """How fast joints creep with a setting, in a run.

    Attributes
    ----------
    setting : FrictionSetting
    joints : tuple of CreepingJoint
        As a first screen predicts them with this setting.
    rates : tuple of float
        Their speeds in the last tenth of the run [rad/s or m/s]; infinite if the run fails.
    others : tuple of HeldJoint
        The joints without friction that they hold.
    """

    setting: FrictionSetting
    joints: tuple[CreepingJoint, ...]
    rates: tuple[float, ...]
    others: tuple[HeldJoint, ...] = ()

    @property
    def fastest(self) -> float:
        """The largest of the speeds [rad/s or m/s]."""
        return max((*self.rates, *(one.rate for one in self.others)), default=0.0)

    @property
    def words(self) -> str:
        """The speeds in a sentence, beside those that the formula gives."""
        if self.fastest == inf:
            return "the run fails"
        pairs = zip(self.joints, self.rates, strict=True)
        told = [f"{joint.joint} creeps with {joint.format(rate)}" for joint, rate in pairs]
        if self.others:
            one = max(self.others, key=lambda one: one.rate)
            told.append(
                f"{one.element}, which it holds, moves with {number(one.rate)} {one.unit}/s"
            )
        if not self.setting.iterations:
            predicted = format_list(number(abs(joint.speed)) for joint in self.joints)
            told.append(f"the formula gives {predicted}")
        return f"in a run {', '.join(told)}"


def find_in_model(
    source: ModelSource, start: str, wanted: float
) -> tuple[JointCreepRates, list[JointCreepRates]]:
    """Do what `find_holding_friction` does, with a model that is read here, and a key's name.

    A model without a key of that name starts from its first one, or from its initial pose.
    """
    model = source.read().model
    return find_holding_friction(model, start_key(model, start), wanted)


def find_holding_friction(
    model: mujoco.MjModel, key: int, wanted: float
) -> tuple[JointCreepRates, list[JointCreepRates]]:
    """Measure the creep of joints with the model's settings, then with others that slow it.

    Parameters
    ----------
    model : MjModel
    key : int
        The number of the key from which it starts; -1 for its initial pose.
    wanted : float
        Largest speed that is slow enough [rad/s or m/s].

    Returns
    -------
    own : JointCreepRates
        With the model's settings; without joints if none creeps that its friction would hold.
    tried : list of JointCreepRates
        With other settings: the stiffer friction, and the fewest iterations without slip that were
        slow enough, or else the most.
    """
    with collected_warnings():
        joints = creeping_joints(model, key)
        own = measure_joints(model, key, joints, FrictionSetting())
        if own.fastest <= wanted:
            return own, []
        stiffer = stiffer_friction(model, joints, wanted)
        tried = list[JointCreepRates]()
        for loops in ((), loops_of(model, key, joints)):
            if (loops or not tried) and not any(one.fastest <= wanted for one in tried):
                constant = LEAST_STEPS_OF_CONSTANT * float(model.opt.timestep)
                with_loops = replace(stiffer, loops=loops, loop_constant=constant)
                tried.append(measure_joints(model, key, joints, with_loops))
                tried.append(hold_without_slip(model, key, joints, wanted, with_loops))
        return own, tried


def hold_without_slip(
    model: mujoco.MjModel,
    key: int,
    joints: Sequence[CreepingJoint],
    wanted: float,
    setting: FrictionSetting,
) -> JointCreepRates:
    """The creep with the fewest iterations without slip that are slow enough, or with the most.

    Friction is as soft as in the model; loops are those of `setting`.
    """
    for iterations in HOLDING_ITERATIONS:
        tried = replace(setting, impedance=0.0, constant=0.0, iterations=iterations)
        found = measure_joints(model, key, joints, tried)
        if found.fastest <= wanted:
            break
    return found


def loops_of(
    model: mujoco.MjModel, key: int, joints: Sequence[CreepingJoint]
) -> tuple[HoldingLoop, ...]:
    """The equalities by which friction holds other coordinates."""
    data, own = start_of(model, key), sorted({k for joint in joints for k in joint.coupled})
    rows = constraint_rows(model, data)[: data.ne, own]
    equalities = np.unique(np.array(data.efc_id[: data.ne])[np.abs(rows).any(axis=1)])
    return tuple(
        HoldingLoop(int(e), equality_element(model, int(e)), identify_equality(model, int(e)))
        for e in equalities
    )


def identify_equality(model: mujoco.MjModel, equality: int) -> str:
    """The attributes by which an equality is found: its name, or what it joins."""
    if name := model.equality(equality).name:
        return f'name="{name}"'
    kind = equality_element(model, equality).tag
    if kind in ("connect", "weld"):
        kind = mujoco.mjtObj(int(model.eq_objtype[equality])).name.removeprefix("mjOBJ_").lower()
    ends = (int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality]))
    names = (named_element(model, kind, end).name for end in ends if end >= 0)
    return " ".join(f'{kind}{place}="{name}"' for place, name in enumerate(names, start=1))


def measure_joints(
    model: mujoco.MjModel,
    key: int,
    joints: Sequence[CreepingJoint],
    setting: FrictionSetting,
) -> JointCreepRates:
    """Run a model with a setting, for a second, and measure the creep of joints at its end."""
    changed = setting.apply(model, joints)
    count = steps_of_run(changed.opt.timestep)
    late = floor((1.0 - FINAL_SHARE) * count)
    data, own = start_of(changed, key), [joint.coordinate for joint in joints]
    expected = {joint.coordinate: joint for joint in creeping_joints(changed, key, told=0.0)}
    predicted = tuple(expected.get(joint.coordinate, joint) for joint in joints)
    before, moved = data.qpos.copy(), np.zeros(model.nv)
    for k in range(count):
        if k == late:
            before = data.qpos.copy()
        mujoco.mj_step(changed, data)
        if failure_warning(data):
            return JointCreepRates(setting, predicted, (inf,) * len(joints))
    time = (count - late) * float(changed.opt.timestep)
    mujoco.mj_differentiatePos(model, moved, time, before, data.qpos)
    held = sorted({k for joint in joints for k in joint.coupled} - set(own))
    others = (
        HeldJoint(
            named_element(model, "joint", int(model.dof_jntid[k])),
            coordinate_unit(model, k),
            abs(float(moved[k])),
        )
        for k in held
    )
    return JointCreepRates(setting, predicted, tuple(np.abs(moved[own]).tolist()), tuple(others))


def stiffer_friction(
    model: mujoco.MjModel, joints: Sequence[CreepingJoint], wanted: float
) -> FrictionSetting:
    """The softest friction with which the formula gives the wanted speed [rad/s or m/s].

    The speed is proportional to (1 - d) / d D T, and to (1 - d) T with the same impedance d for all
    velocities.  T stays as it is unless the largest impedance is not enough.
    """
    softness = [softness_of(model, joint) for joint in joints]
    share = min(
        wanted / (RATE_MARGIN * abs(joint.speed)) * own
        for joint, own in zip(joints, softness, strict=True)
    )
    constants = [time_constant(model, joint) for joint in joints]
    left = share / max(constants)
    if left >= 1.0 - STIFF_IMPEDANCE:
        return FrictionSetting(impedance=1.0 - round_down(left))
    least = LEAST_STEPS_OF_CONSTANT * float(model.opt.timestep)
    constant = max(round_down(share / (1.0 - STIFF_IMPEDANCE)), least)
    return FrictionSetting(STIFF_IMPEDANCE, constant)


def softness_of(model: mujoco.MjModel, joint: CreepingJoint) -> float:
    """(1 - d) / d D T of a joint [s], to which its speed of creep is proportional."""
    low, high = (float(share) for share in model.dof_solimp[joint.coordinate][:2])
    low, high = (min(max(d, mujoco.mjMINIMP), mujoco.mjMAXIMP) for d in (low, high))
    return (1.0 - low) / low * high * time_constant(model, joint)


def time_constant(model: mujoco.MjModel, joint: CreepingJoint) -> float:
    """The time constant of a joint's friction [s], as MuJoCo uses it.

    A ``solreffriction`` with a negative damping -b acts as the time constant 2 / b.
    """
    constant, damping = (float(part) for part in model.dof_solref[joint.coordinate])
    if constant <= 0.0:
        return 2.0 / -damping if damping < 0.0 else inf
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE):
        return constant
    return max(constant, LEAST_STEPS_OF_CONSTANT * float(model.opt.timestep))


def round_down(value: float) -> float:
    """A positive value rounded down to two digits.

    >>> round_down(0.01284), round_down(1.99e-5)
    (0.012, 1.9e-05)
    """
    unit = 10.0 ** (ceil(log10(value)) - 2)
    return float(f"{floor(value / unit) * unit:.2g}")
