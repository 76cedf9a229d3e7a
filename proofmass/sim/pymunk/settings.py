"""What can be set in pymunk, and what a run has where its sidecar sets nothing.

`ACCURACY` says how far pymunk may be off a driven linkage, and why, for cases without a tolerance
of their own.  Its shares hold for steps of 1 ms with `error_bias` 0, proofmass's own settings.

What `trade` and `choose` try of these is in `tried_settings.py`.
"""

from typing import Annotated

import mujoco
from pydantic import Field

from proofmass.sim.protocol import AccuracyLimit, Count, EngineSettings, Run, StrictNumber, Switch
from proofmass.sim.pymunk.space import Settings

CHIPMUNK_BIAS = (1.0 - 0.1) ** 60
SLOP = 1e-6
"""Overlap of shapes [m] that is left to them, so that they stay in touch where they rest."""


class PymunkSettings(EngineSettings):
    """What can be set in pymunk; see `simulate`."""

    timestep: StrictNumber = Field(0.002, gt=0)
    iterations: Annotated[Count, Field(lt=2**31 // 10)] = 10  # ten times as many in the first step
    error_bias: StrictNumber = Field(CHIPMUNK_BIAS, ge=0, le=1)
    collision_slop: StrictNumber = Field(0.1, ge=0)
    collision_bias: StrictNumber = Field(CHIPMUNK_BIAS, ge=0, le=1)
    defaults: Switch = False


def settings_of_run(run: Run, model: mujoco.MjModel, touching: bool) -> Settings:
    """What a run sets; else Chipmunk's own with ``defaults``, and proofmass's choice without.

    Only a model in which something may touch has settings of contacts.
    """
    given = PymunkSettings.read(run.settings).model_dump(exclude_unset=True)
    own = given.pop("defaults", False)
    tuned = {
        "timestep": float(model.opt.timestep),
        "iterations": 10 if own else None,
        "error_bias": CHIPMUNK_BIAS if own else 0.0,
    }
    if touching:
        tuned |= {"collision_slop": 0.1 if own else SLOP, "collision_bias": CHIPMUNK_BIAS}
    return tuned | given


ACCURACY = {
    "sweep": AccuracyLimit(
        1e-12,
        "the engine's own steps until nothing moves by 1e-12 of the mechanism; "
        "rounding of its pose and velocity solution",
    ),
    "position": AccuracyLimit(
        1e-5,
        "second order in the step with error_bias = 0: positions advance with "
        "the old velocity; a step half as long gives a quarter",
    ),
    "velocity": AccuracyLimit(
        3e-5, "second order: mean of the velocities before and after the sample"
    ),
    "acceleration": AccuracyLimit(1e-4, "second order: central difference of those velocities"),
    "force": AccuracyLimit(
        3e-4, "second order: what the impulses of a step do to the velocities before and after it"
    ),
}
