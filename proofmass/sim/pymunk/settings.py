"""Settings of pymunk, their values where a sidecar gives none, and pymunk's accuracy.

`ACCURACY` has the largest errors of pymunk in driven linkages, with reasons, for cases without a
tolerance of their own.  Its shares apply to steps of 1 ms with `error_bias` 0, which is proofmass's
choice.

`tried_settings.py` has the settings that `trade` and `choose` try.
"""

from typing import Annotated

import mujoco
from pydantic import Field

from proofmass.base.strict import Count, StrictNumber, Switch
from proofmass.sim.contents import is_damped
from proofmass.sim.protocol.engine import AccuracyLimit
from proofmass.sim.protocol.run import Run
from proofmass.sim.protocol.settings import EngineSettings
from proofmass.sim.pymunk.space import Settings

SPACE_SETTINGS = ("timestep", "iterations", "error_bias")
CONTACT_SETTINGS = ("collision_slop", "collision_bias")
"""Settings that a space and its constraints have in all runs in time, and with contacts."""
CHIPMUNK_BIAS = (1.0 - 0.1) ** 60
"""Chipmunk's default share of a constraint violation that is left after a second."""
CONTACT_SLOP = 1e-6
"""Overlap of shapes [m] that is not corrected, so that shapes at rest stay in contact."""


class PymunkSettings(EngineSettings):
    """Settings of pymunk with Chipmunk's default values.

    See `proofmass.sim.pymunk.engine.simulate`.
    """

    timestep: StrictNumber = Field(0.002, gt=0)
    iterations: Annotated[Count, Field(lt=2**31 // 10)] = 10  # the first step takes ten times
    error_bias: StrictNumber = Field(CHIPMUNK_BIAS, ge=0, le=1)
    collision_slop: StrictNumber = Field(0.1, ge=0)
    collision_bias: StrictNumber = Field(CHIPMUNK_BIAS, ge=0, le=1)
    midpoint_damping: Switch = False
    defaults: Switch = False


def settings_of_run(run: Run, model: mujoco.MjModel, touching: bool) -> Settings:
    """All settings of a run: those given, completed by Chipmunk's defaults or proofmass's choice.

    Chipmunk's defaults are taken with the setting ``defaults``.  Settings of contacts are included
    only if geoms of the model may touch, which `touching` tells, that of dampers only in a model
    with dampers and in a run in time.
    """
    given = PymunkSettings.read(run.settings).model_dump(exclude_unset=True)
    own = given.pop("defaults", False)
    tuned = {
        "timestep": float(model.opt.timestep),
        "iterations": 10 if own else None,
        "error_bias": CHIPMUNK_BIAS if own else 0.0,
    }
    if touching:
        tuned |= {"collision_slop": 0.1 if own else CONTACT_SLOP, "collision_bias": CHIPMUNK_BIAS}
    if run.kind == "dynamics" and is_damped(model):
        tuned["midpoint_damping"] = not own
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
        3e-4, "second order: from the change of velocities by the impulses of a step"
    ),
}
