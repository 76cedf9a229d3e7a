"""Invariants of a run, which need no reference: closed loops, energy, the length of rods."""

import mujoco
import numpy as np

from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.sim.contents import has_dry_friction
from proofmass.sim.protocol.curves import Curves

SensorType = mujoco.mjtSensor


def invariants(case: Case, curves: Curves) -> dict[str, float]:
    """How far a run violates its invariants.

    Returns
    -------
    dict of str to float
        violation: constraint violation, the largest distance between two points that a loop should
        hold together [m].
        energy: largest change of the sum of kinetic and potential energy, divided by the largest
        kinetic energy [1]; only for free motions without friction or damping, of cases with a
        channel for each of the two energies.
        stretch: 0 for cases whose rods cannot stretch, since their links are rigid; links that come
        apart count in the violation.
    """
    found = {"violation": curves.violation}
    names = energy_sensors(case)
    if (
        conserves_energy(case)
        and len(names) == 2
        and all(name in curves.channels for name in names)
    ):
        kinetic, potential = (curves.channels[name] for name in names)
        total = kinetic + potential
        if kinetic.any():
            found["energy"] = float(np.abs(total - total[0]).max() / kinetic.max())
    if case.rod and all(rod.axial is None for rod in case.rods):
        found["stretch"] = 0.0
    return found


def conserves_energy(case: Case) -> bool:
    """Whether energy is conserved: no drive, actuator, damping or friction acts in the model.

    Damping is that of joints and tendons, and that of a fluid around the bodies.
    """
    model = compiled_model(case)
    damping = (
        *(model.dof_damping, model.dof_dampingpoly, model.tendon_damping, model.tendon_dampingpoly),
        *(model.opt.density, model.opt.viscosity),
    )
    is_damped = any(np.any(one) for one in damping)
    return not (case.drive or model.nu or is_damped or has_dry_friction(model))


def energy_sensors(case: Case) -> list[str]:
    """Names of the model's sensors of kinetic and potential energy, in that order, if present."""
    model = compiled_model(case)
    found = {int(model.sensor_type[k]): model.sensor(k).name for k in range(model.nsensor)}
    return [
        found[kind]
        for kind in (SensorType.mjSENS_E_KINETIC, SensorType.mjSENS_E_POTENTIAL)
        if kind in found
    ]
