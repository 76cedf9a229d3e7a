"""MuJoCo in other versions, MJX and MuJoCo Warp: the same model, stepped in other interpreters.

The interpreter compiles the text of the model with its own version.  Options, start state and the
torques on the flywheels of drives are those of a run in this interpreter, see
`proofmass.sim.mujoco.dynamics`, so that what differs is the version alone.
"""

import os
from collections.abc import Mapping
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from proofmass.sim.contents import control_indices
from proofmass.sim.hosts.engine import SCRIPTS, About, HostedEngine
from proofmass.sim.interpreter.mechanism import LinkStates, Mjcf, NeutralMechanism
from proofmass.sim.mjcf import insert_includes, read_tree
from proofmass.sim.mujoco.dynamics import initialize_dynamics
from proofmass.sim.mujoco.linkage import Linkage
from proofmass.sim.mujoco.model import load
from proofmass.sim.mujoco.settings import MujocoSettings
from proofmass.sim.mujoco.settling import set_inertia_and_damping
from proofmass.sim.mujoco.support import SUPPORT
from proofmass.sim.neutral import NeutralReader, read_mechanism
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Diverged, Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.sim.protocol.settings import EngineSettings
from proofmass.sim.resting import RestReader, read_rest

WRITTEN_ARRAYS = (
    *("eq_solref", "eq_solimp", "eq_active0", "jnt_solref", "jnt_solimp", "jnt_limited"),
    *("dof_solref", "dof_solimp", "dof_armature", "dof_damping", "dof_frictionloss"),
    *("jnt_stiffness", "tendon_stiffness", "tendon_damping", "tendon_frictionloss"),
    *("tendon_limited", "actuator_gainprm", "actuator_biasprm"),
)
"""Fields of a compiled model that settings, flags or drives change."""
OPTIONS = (
    *("timestep", "gravity", "impratio", "tolerance", "iterations", "noslip_iterations"),
    *("ls_iterations",),
)
WORDS: Mapping[str, Any] = {
    "integrator": mujoco.mjtIntegrator,
    "solver": mujoco.mjtSolver,
    "cone": mujoco.mjtCone,
}
"""Options with words, and their kinds: the numbers of words may differ between versions."""


class HostedMujoco(HostedEngine):
    """MuJoCo in another version, or another program that reads its models."""

    def __init__(
        self,
        script: str,
        requires: tuple[str, ...],
        *,
        title: str,
        about: About,
        rests: bool = False,
        oldest: str = "",
    ) -> None:
        super().__init__(
            script,
            requires,
            title=title,
            about=about,
            settings=MujocoSettings,
            stops=True,
            rests=rests,
            oldest=oldest,
        )
        self.support = SUPPORT  # type: ignore[misc]

    def versions(self) -> dict[str, str]:
        """See `Engine.versions`; all these scripts use that of MuJoCo."""
        shared = sha256((SCRIPTS / "mujoco_c.py").read_bytes()).hexdigest()
        return super().versions() | {"mujoco_c": shared}

    def read(
        self, model: Path, run: Run, own: EngineSettings
    ) -> tuple[NeutralReader, NeutralMechanism]:
        """See `HostedEngine.read`; the mechanism has the text of the model."""
        if run.rods:
            raise Unsupported("rods of the sidecar, which are no part of the MJCF")
        compiled, data = load(model, run)
        step = float(compiled.opt.timestep)
        if run.kind == "passive":
            state = data.qpos.copy(), data.qvel.copy()
            reader = NeutralReader(compiled, replace(run, settings={}), step, state)
            mjcf = read_mjcf(model, compiled, data, reader)
            return reader, replace(reader.mechanism(forces=False), mjcf=mjcf)
        if run.kind in ("sweep", "equilibrium") and self.rests:
            rest = read_rest(model, replace(run, settings={}), self.support, step)
            mjcf = read_mjcf(model, compiled, data, rest)
            return rest, replace(rest.mechanism(forces=False), mjcf=mjcf)
        reader = read_mechanism(model, replace(run, settings={}), self.support, step, contacts=True)
        mjcf = read_mjcf(model, compiled, data, reader)
        return reader, replace(reader.mechanism(forces=False), mjcf=mjcf)

    def curves(
        self,
        reader: NeutralReader,
        mechanism: NeutralMechanism,
        states: LinkStates,
        settings: dict[str, object],
        versions: dict[str, str],
    ) -> Curves:
        """See `HostedEngine.curves`; those of a passive run are the centres of all links."""
        if reader.run.kind != "passive":
            return super().curves(reader, mechanism, states, settings, versions)
        places = {
            f"{link.name or k}.{part}": states.place[:, k, i]
            for k, link in enumerate(mechanism.links)
            for i, part in enumerate("xyz")
            if k
        }
        count = len(states.place)
        curves = Curves(
            reader.run.x[:count],
            places,
            seconds=states.seconds,
            steps=mechanism.steps,
            settings={"timestep": mechanism.step, **settings},
            asked_step=reader.asked_step,
            versions=versions,
            compile_seconds=states.compiled,
        )
        if states.failed or count < reader.run.x.size:
            raise Diverged(states.failed or "the run ended early", curves if count else None)
        return curves


def read_mjcf(
    path: Path, model: mujoco.MjModel, data: mujoco.MjData, reader: NeutralReader
) -> Mjcf:
    """The text of a model and its state at the start of a run, with flywheels.

    For a run that comes to rest it has the inertia and the damping of a settled sweep.

    `model` and `data` have the settings of the run, and are changed.
    """
    run, model.opt.timestep = reader.run, reader.step
    steps = reader.count * (run.x.size - 1)
    dofs, torque = np.zeros(0, np.intp), np.zeros((steps, 0))
    instant = np.zeros((steps + 1, 0))
    if isinstance(reader, RestReader):
        linkage = Linkage(model, data, tuple(drive.joint for drive in run.drives))
        set_inertia_and_damping(linkage)
        dofs = linkage.dofs.copy()
    elif run.kind != "passive":
        linkage = Linkage(model, data, tuple(drive.joint for drive in run.drives))
        times = run.x[0] + reader.step * np.arange(steps + 1)
        torque, instant = initialize_dynamics(linkage, run, times)
        dofs = linkage.dofs.copy()
    changed = control_indices(model, (one.actuator for one in run.loads))
    flags = mujoco.mjtDisableBit.__members__.items()
    disabled = [
        name
        for name, bit in flags
        if name.startswith("mjDSBL_") and model.opt.disableflags & int(bit)
    ]
    return Mjcf(
        model_text(path),
        os.path.abspath(path.parent),
        (model.nq, model.nv, model.neq, model.nbody),
        {name: np.array(getattr(model, name)) for name in WRITTEN_ARRAYS},
        {name: np.array(getattr(model.opt, name)) for name in OPTIONS},
        {key: kinds(getattr(model.opt, key)).name for key, kinds in WORDS.items()}
        | {"disabled": " ".join(disabled)},
        data.qpos.copy(),
        data.qvel.copy(),
        data.ctrl.copy(),
        data.xfrc_applied.copy(),
        dofs,
        torque,
        instant,
        reader.controls[changed].T,
        np.array(changed, np.intp),
    )


def model_text(path: Path) -> str:
    """The text of an MJCF file with what it includes, without sensors and keys.

    Channels come from the states of the links, and older versions lack some sensors.
    """
    root = read_tree(path)
    insert_includes(root, path.parent)
    for tag in ("sensor", "keyframe"):
        for section in root.findall(tag):
            root.remove(section)
    return ElementTree.tostring(root, encoding="unicode")


MUJOCO = HostedMujoco(
    "mujoco_c.py",
    ("mujoco==4.0.0",),
    title="MuJoCo",
    about=About(
        "soft constraints with a convex solver; Euler, implicit or RK4 steps",
        "Apache-2.0",
        "the settings of the model",
    ),
    rests=True,
    oldest="3.1.0",
)
MJX = HostedMujoco(
    "mjx.py",
    ("mujoco-mjx==3.17.0", "mujoco==3.17.0", "jax==0.10.2"),
    title="MJX",
    about=About(
        "soft constraints as MuJoCo, in JAX and double precision; compiles each model",
        "Apache-2.0",
        "the settings of the model",
    ),
)
WARP = HostedMujoco(
    "mujoco_warp.py",
    ("mujoco-warp==4.0.0", "mujoco==4.0.0", "warp-lang==1.19.0"),
    title="MuJoCo Warp",
    about=About(
        "soft constraints as MuJoCo, in Warp and single precision; compiles its kernels",
        "Apache-2.0",
        "the settings of the model",
    ),
)
