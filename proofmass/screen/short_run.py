"""Short runs of a model as it is, by which a screen confirms what it claims of the start pose."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.mjcf import failure_warning

SECONDS = 1.0
"""Duration of a run that confirms a claim [s]."""
STEPS_OF_A_SHORT_RUN = 20_000
"""Largest number of steps of such a run; a finer step confirms a shorter time."""
DISTANCE_OF_STARTS = 1e-7
"""Distance of the starts of two runs [rad or m, and per s]: rounding does not grow to it in a
second."""
GROWTH_RATIO = 100.0
"""Growth of the distance of two runs, over the growth with a step an eighth as long, from which a
step counts as unstable.  With 10, motions that are sensitive by themselves count as well; with
1000, modes that break slowly do not."""
RESTLESS = 0.01
"""Speed at the end of a run, over its largest, of a motion that does not come to rest [1]."""
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


def start_of(model: mujoco.MjModel, key: int) -> mujoco.MjData:
    """The start state of a model: a key, or the initial pose if its number is negative."""
    data = mujoco.MjData(model)
    if key >= 0:
        mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_forward(model, data)
    return data


def start_key(model: mujoco.MjModel, name: str = "start") -> int:
    """The number of the key from which a model starts: that of a name, else the first, or -1."""
    named = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, name)
    return named if named >= 0 else min(0, model.nkey - 1)


def with_step(model: mujoco.MjModel, step: float) -> mujoco.MjModel:
    """A copy of a model with another time step [s]."""
    changed = copy.copy(model)
    changed.opt.timestep = step
    return changed


def steps_of_run(step: float) -> int:
    """The number of steps [s] of a run that confirms a claim."""
    return int(min(STEPS_OF_A_SHORT_RUN, np.ceil(SECONDS / step)))


@dataclass(frozen=True)
class Course:
    """What happens in a run with a stable step.

    Attributes
    ----------
    poses : tuple of tuple
        Times [s] and poses (nq,) that are a quarter of the run apart.
    touches : frozenset of str
        ``contacts``, ``joint limits``: what carried load at any time.
    """

    poses: tuple[tuple[float, Array], ...]
    touches: frozenset[str]


def follow(model: mujoco.MjModel, key: int, step: float) -> Course:
    """Run a model with a step, for a second or `STEPS_OF_A_SHORT_RUN` steps."""
    data, calm = start_of(model, key), with_step(model, step)
    count = max(4, steps_of_run(step))
    poses = list[tuple[float, Array]]()
    touches = set(touched(data))
    for k in range(1, count + 1):
        mujoco.mj_step(calm, data)
        if failure_warning(data):
            break
        if data.ncon or data.nl:
            touches.update(touched(data))
        if k % (count // 4) == 0:
            poses.append((float(data.time), data.qpos.copy()))
    return Course(tuple(poses), frozenset(touches))


def touched(data: mujoco.MjData) -> Iterator[str]:
    """What carries load: contacts, joint limits."""
    pushing = np.array(data.efc_force[: data.nefc]) != 0.0
    kinds = np.array(data.efc_type[: data.nefc])[pushing]
    if (kinds >= FIRST_CONTACT).any():
        yield "contacts"
    if np.isin(kinds, STOPS).any():
        yield "joint limits"


class Parting(NamedTuple):
    """What two runs from near starts show.

    Attributes
    ----------
    failed : bool
        Whether MuJoCo reports a failure of one of them.
    growth : float
        The largest growth of their distance [1].
    unrest : float
        The largest speed in the last tenth of the first run over its largest speed [1].
    """

    failed: bool
    growth: float = 0.0
    unrest: float = 0.0


def breaks(model: mujoco.MjModel, key: int, step: float, count: int = 0) -> bool:
    """Whether a step is unstable: the run fails, or differs from one with finer steps.

    Two runs part `GROWTH_RATIO` times faster than with steps of an eighth, or a run keeps moving
    that comes to rest with finer steps: beyond its limit RK4 may end in a bounded wrong motion.
    The runs have `count` steps, or as many as a second has.
    """
    count = count or steps_of_run(step)
    coarse = part(model, key, step, count)
    if coarse.failed:
        return True
    if coarse.growth <= GROWTH_RATIO and coarse.unrest <= RESTLESS:
        return False
    finer = min(CALM_SHARE * count, STEPS_OF_A_SHORT_RUN)
    fine = part(model, key, step / CALM_SHARE, finer)
    if fine.failed:
        return True
    keeps_moving = coarse.unrest > RESTLESS > GROWTH_RATIO * fine.unrest
    return keeps_moving or coarse.growth > GROWTH_RATIO * max(fine.growth, 1.0)


def part(model: mujoco.MjModel, key: int, step: float, count: int) -> Parting:
    """Run a model `count` steps [s] from two starts that are `DISTANCE_OF_STARTS` apart."""
    changed = with_step(model, step)
    one, two = start_of(model, key), start_of(model, key)
    disturbance = np.random.default_rng(2).normal(size=model.nv)
    disturbance *= DISTANCE_OF_STARTS / max(np.abs(disturbance).max(initial=0.0), 1e-300)
    mujoco.mj_integratePos(model, two.qpos, disturbance, 1.0)
    two.qvel += disturbance  # a motor's speed is unstable by itself: no position changes it
    farthest, fastest, late, apart = 0.0, 0.0, 0.0, np.zeros(model.nv)
    for k in range(count):
        mujoco.mj_step(changed, one)
        mujoco.mj_step(changed, two)
        if failure_warning(one) or failure_warning(two):
            return Parting(failed=True)
        mujoco.mj_differentiatePos(model, apart, 1.0, one.qpos, two.qpos)
        farthest = max(farthest, float(np.abs(apart).max(initial=0.0)))
        speed = float(np.abs(one.qvel).max(initial=0.0))
        fastest = max(fastest, speed)
        late = max(late, speed) if 10 * k >= 9 * count else 0.0
    return Parting(False, farthest / DISTANCE_OF_STARTS, late / max(fastest, 1e-300))


def run_as_it_is(model: mujoco.MjModel, key: int, steps: int) -> tuple[mujoco.MjData, Array]:
    """The state after some steps, or after a failure, and the change (nv,) of the coordinates."""
    return run_from(model, start_of(model, key), steps)


def run_from(model: mujoco.MjModel, data: mujoco.MjData, steps: int) -> tuple[mujoco.MjData, Array]:
    """Do what `run_as_it_is` does from any start state, which it changes."""
    start, moved = data.qpos.copy(), np.zeros(model.nv)
    for _ in range(steps):
        mujoco.mj_step(model, data)
        if failure_warning(data):
            break
    mujoco.mj_differentiatePos(model, moved, 1.0, start, data.qpos)
    return data, moved
