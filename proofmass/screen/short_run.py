"""Short runs of a model as it is, by which a screen confirms what it claims of the start pose."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.base.arrays import Array

SECONDS = 1.0
"""Duration of a run that confirms a claim [s]."""
STEPS_OF_A_SHORT_RUN = 20_000
"""Largest number of steps of such a run; a finer step confirms a shorter time."""
BAD = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)
DISTANCE_OF_STARTS = 1e-7
"""Distance of the starts of two runs [rad or m]: rounding grows to it in no run of a second."""
GROWTH_RATIO = 100.0
"""Growth of the distance of two runs, over the growth with a step an eighth as long, from which a
step counts as unstable.  With 10, motions that are sensitive by themselves count as well; with
1000, modes that break slowly do not."""
CALM_SHARE = 8
"""Divisor of the step with which the growth of the motion itself is measured."""
STOPS = [
    int(kind)
    for kind in (
        mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT,
        mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON,
    )
]
FIRST_CONTACT = int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS)
"""Kinds of constraints from this one on are contacts."""
STILL = 1e-12
"""Largest motion of a model that stands still [rad or m]."""
FIRST_STEPS = 20
"""Steps in which a model that moves at all has left its start."""


def has_failed(data: mujoco.MjData) -> bool:
    """Whether MuJoCo found a state that is not finite or too large."""
    return any(data.warning[kind].number for kind in BAD)


def start_of(model: mujoco.MjModel, key: int) -> mujoco.MjData:
    """The start state of a model: a key, or the initial pose if its number is negative."""
    data = mujoco.MjData(model)
    if key >= 0:
        mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_forward(model, data)
    return data


def with_step(model: mujoco.MjModel, step: float) -> mujoco.MjModel:
    """A copy of a model with another time step [s]."""
    changed = copy.copy(model)
    changed.opt.timestep = step
    return changed


@dataclass(frozen=True)
class Course:
    """What happens in a run with a stable step.

    Attributes
    ----------
    poses : tuple of tuple
        Times [s] and poses (nq,) that are a quarter of the run apart.
    touches : frozenset of str
        ``contacts``, ``joint limits``: what carried load at any time.
    failed_at : float or None
        When MuJoCo found a bad state [s].
    """

    poses: tuple[tuple[float, Array], ...]
    touches: frozenset[str]
    failed_at: float | None


def follow(model: mujoco.MjModel, key: int, step: float) -> Course:
    """Run a model with a step, for a second or `STEPS_OF_A_SHORT_RUN` steps."""
    data, calm = start_of(model, key), with_step(model, step)
    count = int(min(STEPS_OF_A_SHORT_RUN, max(4, np.ceil(SECONDS / step))))
    poses = list[tuple[float, Array]]()
    touches = set(touched(data))
    for k in range(1, count + 1):
        mujoco.mj_step(calm, data)
        if has_failed(data):
            return Course(tuple(poses), frozenset(touches), data.time)
        if data.ncon or data.nl:
            touches.update(touched(data))
        if k % max(1, count // 4) == 0:
            poses.append((float(data.time), data.qpos.copy()))
    return Course(tuple(poses), frozenset(touches), None)


def touched(data: mujoco.MjData) -> Iterator[str]:
    """What carries load: contacts, joint limits."""
    pushing = np.array(data.efc_force[: data.nefc]) != 0.0
    kinds = np.array(data.efc_type[: data.nefc])[pushing]
    if (kinds >= FIRST_CONTACT).any():
        yield "contacts"
    if np.isin(kinds, STOPS).any():
        yield "joint limits"


def breaks(model: mujoco.MjModel, key: int, step: float) -> bool:
    """Whether a step is unstable: the run fails, or two runs part faster than with finer steps."""
    growth, failed = grown_distance(model, key, step)
    if failed:
        return True
    calm, _ = grown_distance(model, key, step / CALM_SHARE)
    return growth > GROWTH_RATIO * max(calm, 1.0)


def grown_distance(model: mujoco.MjModel, key: int, step: float) -> tuple[float, bool]:
    """The largest growth of the distance of two runs [1], and whether one of them failed."""
    changed = with_step(model, step)
    one, two = start_of(model, key), start_of(model, key)
    disturbance = np.random.default_rng(2).normal(size=model.nv)
    disturbance *= DISTANCE_OF_STARTS / max(np.abs(disturbance).max(initial=0.0), 1e-300)
    mujoco.mj_integratePos(model, two.qpos, disturbance, 1.0)
    largest, apart = 0.0, np.zeros(model.nv)
    for _ in range(int(min(STEPS_OF_A_SHORT_RUN, np.ceil(SECONDS / step)))):
        mujoco.mj_step(changed, one)
        mujoco.mj_step(changed, two)
        if has_failed(one) or has_failed(two):
            return largest, True
        mujoco.mj_differentiatePos(model, apart, 1.0, one.qpos, two.qpos)
        largest = max(largest, float(np.abs(apart).max(initial=0.0)))
    return largest / DISTANCE_OF_STARTS, False


def first_motion(model: mujoco.MjModel, key: int) -> tuple[mujoco.MjData, bool]:
    """The state after the first steps, and whether anything moved."""
    data = start_of(model, key)
    start, moved = data.qpos.copy(), np.zeros(model.nv)
    for _ in range(FIRST_STEPS):
        mujoco.mj_step(model, data)
    mujoco.mj_differentiatePos(model, moved, 1.0, start, data.qpos)
    return data, bool(np.abs(moved).max(initial=0.0) >= STILL)


def drift(model: mujoco.MjModel, key: int) -> tuple[Array, float]:
    """The change (nv,) of the coordinates in a run as the model is, and its duration [s]."""
    data = start_of(model, key)
    start, moved = data.qpos.copy(), np.zeros(model.nv)
    for _ in range(int(min(STEPS_OF_A_SHORT_RUN, np.ceil(SECONDS / model.opt.timestep)))):
        mujoco.mj_step(model, data)
        if has_failed(data):
            break
    mujoco.mj_differentiatePos(model, moved, 1.0, start, data.qpos)
    return moved, float(data.time)
