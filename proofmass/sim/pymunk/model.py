"""What pymunk is given: settings, a planar mechanism read from an MJCF, and channels."""

from pathlib import Path
from typing import Annotated

import mujoco
from pydantic import Field

from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol import BadModel, Count, EngineSettings, Number, Run, Switch, Unsupported
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.read import Sensor, channel
from proofmass.sim.pymunk.rebuild import read_links
from proofmass.sim.pymunk.space import Settings
from proofmass.sim.rods import of_rods

CHIPMUNK_BIAS = (1.0 - 0.1) ** 60
NO_EFFORT = "Chipmunk gives the size of a drive's impulse without its sign: sweeps only"


class PymunkSettings(EngineSettings):
    """What can be set in pymunk; see `simulate`."""

    timestep: Number = Field(0.002, gt=0)
    iterations: Annotated[Count, Field(lt=2**31 // 10)] = 10  # ten times as many in the first step
    error_bias: Number = Field(CHIPMUNK_BIAS, ge=0, le=1)
    defaults: Switch = False


def read_model(model: Path, run: Run) -> tuple[Links, Settings]:
    """The links of an MJCF and the settings of a run; raises what `simulate` does."""
    compiled = _compile(model, run)
    links = read_links(compiled, run.start, _driven(compiled, run))
    return links, _settings(run, compiled)


def find_channels(links: Links, run: Run) -> tuple[dict[str, Sensor], dict[str, str]]:
    """The channels of a run that pymunk delivers, and why it does not deliver the others."""
    found = {name: channel(links, name) for name in run.channels if name not in of_rods(run)}
    missing = {name: why for name, why in found.items() if isinstance(why, str)}
    wanted = {name: c for name, c in found.items() if isinstance(c, Sensor)}
    if run.kind == "dynamics":
        missing |= {name: NO_EFFORT for name, c in wanted.items() if c.order == -2}
        wanted = {name: c for name, c in wanted.items() if c.order != -2}
    return wanted, missing


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
    tuned = {
        "timestep": float(model.opt.timestep),
        "iterations": 10 if own else None if run.kind == "dynamics" else 500,
        "error_bias": CHIPMUNK_BIAS if own else 0.0,
    }
    return tuned | given
