"""Energy that an integrator adds to a motion that keeps it, or takes from it."""

import copy
from collections.abc import Iterator

import mujoco
import numpy as np

from proofmass.base.wording import number
from proofmass.screen.finding import FindingKind, ModelFinding, Severity
from proofmass.screen.short_run import start_of, steps_of_run
from proofmass.sim.mjcf import failure_warning
from proofmass.sim.mujoco.settings import mjcf_text

TOLD_CHANGE = 0.01
"""Change of the energy within a second, as a share of the largest kinetic energy, that is told."""
CURES = ("RK4", "implicit", "implicitfast")
"""Integrators that are tried; the first that changes the energy far less is proposed."""
WORTHWHILE_SHARE = 0.1
"""How much less of the energy a proposed integrator may change."""


def judge_energy(model: mujoco.MjModel, key: int) -> Iterator[ModelFinding]:
    """A change of the energy of a model without dampers, friction, actuators and constraints."""
    change = energy_change(model, key) if keeps_energy(model) else None
    if change is None or abs(change) < TOLD_CHANGE:
        return
    own = mjcf_text(mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_"))
    step = number(1e3 * float(model.opt.timestep))
    gains = "gains" if change > 0 else "loses"
    yield ModelFinding(
        FindingKind.ENERGY,
        Severity.WARNING,
        f"the motion {gains} {number(100.0 * abs(change), 2)} % of its kinetic energy within a "
        f"second, though nothing adds or takes any: steps of {step} ms with {own} do",
        propose_integrator(model, key, abs(change)),
        value=change,
    )


def keeps_energy(model: mujoco.MjModel) -> bool:
    """Whether nothing in a model but constraints that may act later changes its energy."""
    passive = (model.dof_damping, model.dof_frictionloss, model.tendon_damping)
    return not (
        any(np.any(values) for values in passive)
        or np.any(model.dof_dampingpoly)
        or model.nu
        or model.neq
        or model.nflex
        or model.nplugin
        or model.opt.density
        or model.opt.viscosity
    )


def energy_change(model: mujoco.MjModel, key: int) -> float | None:
    """The change of the energy in a run of a second, as a share of the largest kinetic energy.

    None if the run fails, if the model does not move, or if contacts or joint limits act.
    """
    counted = copy.copy(model)
    counted.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = start_of(counted, key)
    start, kinetic = float(data.energy.sum()), float(data.energy[1])
    for _ in range(steps_of_run(model.opt.timestep)):
        mujoco.mj_step(counted, data)
        if data.nefc or failure_warning(data):
            return None
        kinetic = max(kinetic, float(data.energy[1]))
    mujoco.mj_forward(counted, data)
    return (float(data.energy.sum()) - start) / kinetic if kinetic > 0.0 else None


def propose_integrator(model: mujoco.MjModel, key: int, change: float) -> str:
    """The integrator that changes the energy far less in a run; a finer step if none does."""
    for name in CURES:
        tried = copy.copy(model)
        tried.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}")
        left = energy_change(tried, key)
        if left is not None and abs(left) < WORTHWHILE_SHARE * change:
            return f'integrator="{name}" changes it by {number(100.0 * abs(left), 2)} %'
    return "a shorter step"
