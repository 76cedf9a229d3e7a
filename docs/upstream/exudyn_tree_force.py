"""Exudyn's CreateKinematicTree leaves out its argument ``forceUserFunction`` (1.13.6).

A wheel of 1 kg m^2 gets a torque of 1 N m for 1 s and turns by 0.5 rad: with ``jointForceVector``,
and with the same function set behind, but not with the argument of this name.

    uv run --no-project --with exudyn==1.13.6 python exudyn_tree_force.py
"""

import exudyn as exu
import numpy as np
from exudyn.rigidBodyUtilities import RigidBodyInertia, TreeLink


def torque(mbs, t, item, q, q_t):
    """The torque on the wheel [N m]."""
    return [1.0]


def turn(behind: bool = False, **given: object) -> float:
    """Angle of the wheel after 1 s [rad]."""
    mbs = exu.SystemContainer().AddSystem()
    wheel = TreeLink(RigidBodyInertia(1.0, np.eye(3)), exu.JointType.RevoluteZ, exu.HT(), -1)
    tree = mbs.CreateKinematicTree(listOfTreeLinks=[wheel], **given)
    if behind:
        mbs.SetObjectParameter(tree, "forceUserFunction", torque)
    mbs.Assemble()
    wanted = exu.SimulationSettings()
    wanted.timeIntegration.numberOfSteps = 100
    wanted.timeIntegration.endTime = 1.0
    wanted.timeIntegration.verboseMode = 0
    wanted.solution.file.write = False
    mbs.SolveDynamic(wanted)
    return float(mbs.systemData.GetODE2Coordinates()[0])


print("jointForceVector         ", turn(jointForceVector=[1.0]), "rad")
print("forceUserFunction        ", turn(forceUserFunction=torque), "rad")
print("forceUserFunction, behind", turn(behind=True), "rad")
