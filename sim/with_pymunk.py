"""pymunk (Chipmunk): a planar MJCF rebuilt from its compiled numbers; MuJoCo only compiles it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import mujoco
from pydantic import Field

from sim.mjcf import compile_model
from sim.protocol import (
    BadModel,
    Count,
    Curves,
    EngineSettings,
    Number,
    Run,
    Switch,
    Unsupported,
)
from sim.pymunk_compiled import read_links
from sim.pymunk_duration import duration
from sim.pymunk_read import Channel, channel
from sim.pymunk_shape import rest
from sim.pymunk_space import Settings
from sim.pymunk_sweep import sweep
from sim.rod_shape import of_rods

CHIPMUNK_BIAS = (1.0 - 0.1) ** 60
NO_EFFORT = "Chipmunk gives the size of a drive's impulse without its sign: sweeps only"


class PymunkSettings(EngineSettings):
    """What can be set in pymunk; see `simulate`."""

    timestep: Number = Field(0.002, gt=0)
    iterations: Annotated[Count, Field(lt=2**31 // 10)] = 10  # ten times as many in the first step
    error_bias: Number = Field(CHIPMUNK_BIAS, ge=0, le=1)
    defaults: Switch = False


def check_settings(settings: Mapping[str, object]) -> None:
    """Raise `sim.protocol.BadSetting` if pymunk cannot be set so."""
    PymunkSettings.read(settings)


def simulate(model: Path, run: Run) -> Curves:
    """Run a planar mechanism in pymunk.

    Parameters
    ----------
    model : Path
        The MJCF file.
    run : Run
        What to do; see `sim.protocol.Run`.  Settings: ``timestep`` [s], reduced so that whole
        steps fit between samples (a sweep has no use for it); ``iterations`` of the solver: 100 in
        a duration and 500 in a sweep, and more where it needs them; ``error_bias``, the share of
        a gap left after a second, 0; ``defaults = True`` for Chipmunk's own 10 and 0.9**60.

    Drives are ideal: constraints aimed at the law's next value before each step.  Motors on other
    joints act with the constant force of their ``ctrl`` in the start key.  Joint springs may be
    polynomials.  Joint ranges are stops: exact to 1e-13 rad in a sweep, soft in a duration.

    Loads are motors on sites, constant in the frame of a refsite on the ground.

    In a sweep the coordinates that drives leave free follow them at rest, from the start key on,
    and in a rest they come there with the drives held.  The pose is the engine's: one that its own
    step from standstill gives no velocity.  How far to go along that velocity is chosen by a
    stiffness of ours, since Chipmunk has no means to come to rest faster than it swings.

    Second order in time, but for joint damping: Chipmunk's dampers are first order.

    Returns
    -------
    Curves
        The channels over ``run.x``, the actual drive state, the largest gap and the cost.  A sweep
        stops where the loops cannot be closed any further, or a stop is in the way, and says so.

    Raises
    ------
    BadModel
        The model does not compile, lacks a named element, or its start pose is not assembled.
    Unsupported
        The model holds something that the rebuild does not cover; it is named.
    Diverged
        The run was lost.
    """
    compiled = _compile(model, run)
    links = read_links(compiled, run.start, _driven(compiled, run))
    settings = _settings(run, compiled)
    found = {name: channel(links, name) for name in run.channels if name not in of_rods(run)}
    missing = {name: why for name, why in found.items() if isinstance(why, str)}
    wanted = {name: c for name, c in found.items() if isinstance(c, Channel)}
    if run.kind == "duration":
        missing |= {name: NO_EFFORT for name, c in wanted.items() if c.order == -2}
        wanted = {name: c for name, c in wanted.items() if c.order != -2}
    act = {"sweep": sweep, "rest": rest, "duration": duration}[run.kind]
    curves = act(links, run, wanted, settings)
    curves.missing.update(missing)
    return curves


def _compile(path: Path, run: Run) -> mujoco.MjModel:
    model = compile_model(path, run.rods)
    if model.njnt == 0:
        raise Unsupported(f"{path.name}: a model without joints")
    return model


def _driven(model: mujoco.MjModel, run: Run) -> tuple[int, ...]:
    names = [model.joint(j).name for j in range(model.njnt)]
    for drive in run.drives:
        if drive.joint not in names:
            raise BadModel(f"no joint '{drive.joint}'; the model has {', '.join(names)}")
    return tuple(names.index(drive.joint) for drive in run.drives)


def _settings(run: Run, model: mujoco.MjModel) -> Settings:
    given = PymunkSettings.read(run.settings).model_dump(exclude_unset=True)
    own = given.pop("defaults", False)
    tuned = {"timestep": float(model.opt.timestep),
             "iterations": 10 if own else None if run.kind == "duration" else 500,
             "error_bias": CHIPMUNK_BIAS if own else 0.0}
    return tuned | given
