"""The time steps that a model bears, how sure that is, and what to do if its own is too long."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf, isinf

import mujoco

from proofmass.base.wording import format_list, number
from proofmass.screen.breaking_mode import BreakingMode, find_breaking_mode
from proofmass.screen.finding import FindingKind, ModelFinding, NamedElement, Severity
from proofmass.screen.linear import LinearMotion
from proofmass.screen.pose import RestPose
from proofmass.screen.short_run import Course, breaks, follow, start_of
from proofmass.screen.stable_step import INTEGRATORS, LONGEST_STEP, StepMatrices

INTEGRATOR_NAMES = {
    mujoco.mjtIntegrator.mjINT_EULER: "Euler",
    mujoco.mjtIntegrator.mjINT_RK4: "RK4",
    mujoco.mjtIntegrator.mjINT_IMPLICIT: "implicit",
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST: "implicitfast",
    mujoco.mjtIntegrator.mjINT_DISCRETE: "discrete",
}
ALL_INTEGRATORS_UP_TO = 40
"""Coordinates up to which the limits of all integrators are computed, not only the model's, and
those of poses on the way, not only those of the start."""
SAFE_SHARE = 0.8
"""Proposed step over the largest stable one [1]."""
ARMATURE_MARGIN = 1.3
"""Proposed armature over what the linear count gives [1]."""
CLOSE_RATIO, NEAR_RATIO = 0.5, 0.9
"""Shares of the largest stable step from which the model's own is told, and is a warning."""
LOWER_SHARE = 0.95
"""Share of the limit of the start pose below which a limit on the way is told."""
ARMATURE_FACTORS = 1.0, 2.0, 4.0, 8.0
"""Multiples of the armature of the linear count that are tried."""
WORTHWHILE_STEP = 1.25
"""Limit of another integrator over the model's own step [1] from which it is proposed."""


@dataclass(frozen=True)
class StableSteps:
    """The largest stable steps of a model about its start pose.

    Attributes
    ----------
    own : float
        The model's time step [s].
    integrator : str
        The model's; empty if its limits are not known.
    limits : dict of str to float
        Largest stable step of each integrator [s]; infinite if there is none.
    breaking : BreakingMode or None
        The mode that sets the limit of the model's integrator.
    way_limit, way_time : float
        The least limit of the model's integrator on the way of a short run [s], and when [s].
    about : tuple of str
        What makes the limits approximate: contacts, joint limits, dry friction, force ranges, ...
    """

    own: float
    integrator: str
    limits: dict[str, float] = field(default_factory=dict)
    breaking: BreakingMode | None = None
    way_limit: float = inf
    way_time: float = 0.0
    about: tuple[str, ...] = ()

    @property
    def limit(self) -> float:
        """The largest stable step of the model's integrator, at the start and on the way [s]."""
        return min(self.limits.get(self.integrator, inf), self.way_limit)

    @property
    def ratio(self) -> float:
        """The model's step over the largest stable one [1]."""
        return self.own / self.limit


def find_own_stable_step(model: mujoco.MjModel, key: int) -> StableSteps:
    """The limit of the model's own integrator alone, at the start and on the way of a run."""
    start = start_of(model, key)
    pose = RestPose(model, start.qpos, start.ctrl, start.act)
    pose.close()
    return find_stable_steps(model, key, pose, LinearMotion(pose), every=False)


def find_stable_steps(
    model: mujoco.MjModel, key: int, pose: RestPose, motion: LinearMotion, every: bool = True
) -> StableSteps:
    """The limits of steps at the start, and on the way of a run with a stable step.

    Without `every` only that of the model's own integrator is computed.
    """
    own = float(model.opt.timestep)
    integrator = INTEGRATOR_NAMES.get(mujoco.mjtIntegrator(int(model.opt.integrator)), "")
    matrices, few = StepMatrices(motion), model.nv <= ALL_INTEGRATORS_UP_TO
    wanted = INTEGRATORS if few and every else (integrator,)
    limits = {name: matrices.limit(name, own) for name in wanted if name}
    mine = limits.get(integrator)
    course = follow(model, key, min(own, 0.5 * mine.step) if mine else own)
    way = list(limits_on_the_way(pose, course, integrator)) if mine and few else []
    way_limit, way_time = min(way, default=(inf, 0.0))
    breaking = find_breaking_mode(matrices, mine) if mine and mine.shape is not None else None
    return StableSteps(
        own,
        integrator,
        {name: limit.step for name, limit in limits.items()},
        breaking,
        way_limit,
        way_time,
        tuple(why_about(model, course)),
    )


def limits_on_the_way(
    pose: RestPose, course: Course, integrator: str
) -> Iterator[tuple[float, float]]:
    """The limit of an integrator in poses of a run, and when [s]; at rest and with closed loops."""
    for time, qpos in course.poses:
        there = pose.elsewhere(qpos)
        there.close()
        limit = StepMatrices(LinearMotion(there)).limit(integrator, pose.model.opt.timestep)
        yield limit.step, time


def why_about(model: mujoco.MjModel, course: Course) -> Iterator[str]:
    """What a motion that is linear about its start pose does not have."""
    yield from sorted(course.touches)
    if model.dof_frictionloss.any() or model.tendon_frictionloss.any():
        yield "dry friction"
    if model.actuator_forcelimited.any() or model.jnt_actfrclimited.any():
        yield "limited forces of actuators"
    if model.opt.density or model.opt.viscosity:
        yield "fluid forces"
    if model.na:
        yield "activations"
    if model.nplugin or model.nflex:
        yield "plugins or flexes"


def judge_steps(model: mujoco.MjModel, key: int, found: StableSteps) -> Iterator[ModelFinding]:
    """What is noticed of the model's own step."""
    if isinf(found.limit):
        return
    if found.ratio > 1.0:
        if breaks(model, key, found.own):
            yield too_long(model, key, found)
        else:
            yield not_confirmed(found)
    elif found.ratio > CLOSE_RATIO:
        yield ModelFinding(
            FindingKind.STABLE_STEP,
            Severity.WARNING if found.ratio > NEAR_RATIO else Severity.NOTE,
            f"{describe_ratio(found)}, which is set{describe_cause(found)}",
            next(cures(model, key, found)) if found.ratio > NEAR_RATIO else "",
            element=found.breaking.joint if found.breaking else None,
            value=found.ratio,
        )


def too_long(model: mujoco.MjModel, key: int, found: StableSteps) -> ModelFinding:
    """The finding of a step that is unstable, in theory and in a run."""
    return ModelFinding(
        FindingKind.STABLE_STEP,
        Severity.FAULT,
        f"{describe_ratio(found)}: the model blows up{describe_cause(found)}",
        " or ".join(cures(model, key, found)),
        found.breaking.joint if found.breaking else None,
        found.ratio,
    )


def not_confirmed(found: StableSteps) -> ModelFinding:
    """The finding of a step that is unstable in theory, but not in a run of a second."""
    why = format_list(found.about) or "a limit that is reached later"
    return ModelFinding(
        FindingKind.STABLE_STEP,
        Severity.NOTE,
        f"{describe_ratio(found)} of the motion about the start pose; a run of a second does not "
        f"blow up ({why})",
        element=found.breaking.joint if found.breaking else None,
        value=found.ratio,
    )


def cures(model: mujoco.MjModel, key: int, found: StableSteps) -> Iterator[str]:
    """What makes the model stable: a step, an integrator, an armature."""
    yield f'timestep="{SAFE_SHARE * found.limit:.2g}"'
    best = WORTHWHILE_STEP * found.own
    for name, limit in found.limits.items():
        if name != found.integrator and min(limit, LONGEST_STEP) > best:
            yield f'integrator="{name}" (stable up to {format_seconds(min(limit, LONGEST_STEP))})'
            best = WORTHWHILE_STEP * min(limit, LONGEST_STEP)  # the next has to be better
    if found.breaking and (armature := curing_armature(model, key, found)):
        yield f'armature="{armature:.2g}" on {found.breaking.joint}'
    if found.breaking and (gain := curing_gain(model, key, found)):
        yield f"{gain} on {found.breaking.cause.actuator}"


def curing_armature(model: mujoco.MjModel, key: int, found: StableSteps) -> float | None:
    """The armature with which the model runs with its own step; None if none was found.

    The inertia of a mode has to grow with the step if a damping breaks it, and with its square if a
    stiffness does.  What that gives is tried, and twice, four and eight times as much.
    """
    assert found.breaking is not None
    needed = found.ratio if found.breaking.cause.is_damping else found.ratio**2
    extra = ARMATURE_MARGIN * found.breaking.mass * (needed - 1.0)
    for factor in ARMATURE_FACTORS:
        cured = copy.copy(model)
        armature = cured.dof_armature[found.breaking.coordinate] + factor * extra
        cured.dof_armature[found.breaking.coordinate] = float(f"{armature:.2g}")
        mujoco.mj_setConst(cured, mujoco.MjData(cured))
        if not breaks(cured, key, found.own):
            return float(armature)
    return None


def curing_gain(model: mujoco.MjModel, key: int, found: StableSteps) -> str:
    """The gain, as an attribute, with which the model runs with its own step; empty if none is.

    Only that of an actuator which sets the limit, and which an attribute of MJCF states.  The
    largest gain falls with the step if a damping sets the limit, and with its square if a stiffness
    does; a `SAFE_SHARE` of it is tried.
    """
    assert found.breaking is not None
    cause = found.breaking.cause
    if cause.actuator is None:
        return ""
    a = actuator_number(model, cause.actuator)
    least = SAFE_SHARE / (found.ratio if cause.is_damping else found.ratio**2)
    cured = copy.copy(model)
    place = 2 if cause.is_damping else 1
    gain = float(f"{-least * model.actuator_biasprm[a][place]:.2g}")
    is_velocity = cause.is_damping and model.actuator_biasprm[a][1] == 0.0
    if gain <= 0.0 or model.actuator_biastype[a] != mujoco.mjtBias.mjBIAS_AFFINE:
        return ""
    cured.actuator_biasprm[a][place] = -gain
    if not cause.is_damping or is_velocity:  # the gain of the control is the same attribute
        cured.actuator_gainprm[a][0] = gain
    if breaks(cured, key, found.own):
        return ""
    return f'{"kv" if cause.is_damping else "kp"}="{gain:g}"'


def actuator_number(model: mujoco.MjModel, actuator: NamedElement) -> int:
    """The number of an actuator that a finding names; without a name that is its name."""
    named = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, actuator.name)
    return named if named >= 0 else int(actuator.name)


def describe_ratio(found: StableSteps) -> str:
    """The model's step beside the largest stable one, as the beginning of a sentence."""
    about = "about " if found.about else ""
    return (
        f"the step of {format_seconds(found.own)} is {number(found.ratio)} times the largest "
        f"stable one, {about}{format_seconds(found.limit)} ({found.integrator})"
    )


def describe_cause(found: StableSteps) -> str:
    """The joint that breaks and why, as the end of a sentence."""
    if found.breaking is None:
        return ""
    way = f", {number(found.way_time, 2)} s after the start" if is_lower_on_the_way(found) else ""
    return f" at {found.breaking.joint}, by {found.breaking.cause}{way}"


def is_lower_on_the_way(found: StableSteps) -> bool:
    """Whether the limit falls on the way by more than the two are known."""
    return found.way_limit < LOWER_SHARE * found.limits.get(found.integrator, inf)


def format_seconds(seconds: float) -> str:
    """A time step as text.

    >>> format_seconds(0.0036378), format_seconds(1.231e-05), format_seconds(0.02)
    ('3.64 ms', '12.3 µs', '20 ms')
    """
    if seconds >= 1.0:
        return f"{number(seconds)} s"
    return f"{number(1e3 * seconds)} ms" if seconds >= 1e-4 else f"{number(1e6 * seconds)} µs"
