"""What a run must keep, whatever its reference says: closed loops, energy, the length of rods."""

import mujoco
import numpy as np

from proofmass.case import Case
from proofmass.reference import compiled
from proofmass.sim.protocol import Curves

S = mujoco.mjtSensor


def invariants(case: Case, curves: Curves) -> dict[str, float]:
    """How far a run is off what it must keep.

    Returns
    -------
    dict of str to float
        violation: largest distance between points that a loop should hold together [m].
        energy: largest change of kinetic and potential energy together over the largest kinetic
        energy; of free motions without friction, whose case has a channel for each of the two.
        stretch: 0 in cases with rods that do not stretch, whose links are rigid; where they come
        apart is in violation.
    """
    found = {"violation": curves.violation}
    names = energies(case)
    if conserved(case) and len(names) == 2 and all(name in curves.channels for name in names):
        kinetic, potential = (curves.channels[name] for name in names)
        total = kinetic + potential
        if kinetic.any():
            found["energy"] = float(np.abs(total - total[0]).max() / kinetic.max())
    if case.rod and all(rod.axial is None for rod in case.rods):
        found["stretch"] = 0.0
    return found


def conserved(case: Case) -> bool:
    """Whether nothing in the model drives, loads or brakes it."""
    model = compiled(case)
    return not (case.drive or model.nu or model.dof_damping.any() or model.dof_frictionloss.any())


def energies(case: Case) -> list[str]:
    """The model's sensors of kinetic and of potential energy, as far as there are."""
    model = compiled(case)
    found = {int(model.sensor_type[k]): model.sensor(k).name for k in range(model.nsensor)}
    return [found[kind] for kind in (S.mjSENS_E_KINETIC, S.mjSENS_E_POTENTIAL) if kind in found]
