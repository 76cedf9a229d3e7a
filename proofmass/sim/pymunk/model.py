"""What pymunk is given: a planar mechanism read from an MJCF, and channels."""

from pathlib import Path

import mujoco

from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol import BadModel, Run, Unsupported
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.read import Sensor, channel
from proofmass.sim.pymunk.rebuild import read_links
from proofmass.sim.pymunk.settings import settings_of_run
from proofmass.sim.pymunk.space import Settings
from proofmass.sim.rods import of_rods

NO_EFFORT = "Chipmunk gives the size of a drive's impulse without its sign: sweeps only"


def read_model(model: Path, run: Run) -> tuple[Links, Settings]:
    """The links of an MJCF and the settings of a run; raises what `simulate` does."""
    compiled = _compile(model, run)
    links = read_links(compiled, run.start, _driven(compiled, run))
    return links, settings_of_run(run, compiled)


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
