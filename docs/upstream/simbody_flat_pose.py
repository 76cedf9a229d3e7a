"""Simbody gains or loses energy where parallelograms are flat: opensim 4.6 alone.

Three bars of 1 m and 1 kg hang from O, Q and R, two more join their ends; let go at rest, 2 rad
from straight down, where it has 49 J less.  Where all are in line, after 0.28, 0.95 and 1.52 s,
the constraints are dependent and motions may branch, but none changes the energy.

    uv run --isolated --no-project --with opensim==4.6 python simbody_flat_pose.py
"""

import opensim

ACCURACIES = (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
opensim.Logger.setLevelString("Off")


def at(x: float, y: float = 0.0) -> opensim.Vec3:
    """A point of the plane [m]."""
    return opensim.Vec3(x, y, 0.0)


def build(angle: float) -> opensim.Model:
    """The mechanism, turned by an angle from straight down [rad]."""
    model = opensim.Model()
    model.setGravity(at(0.0, -9.81))
    bodies = {"ground": model.getGround()}
    for name, parent, there, own, turn in (
        ("first", "ground", at(0), at(0, 0.5), angle),
        ("second", "ground", at(1), at(0, 0.5), angle),
        ("third", "ground", at(2), at(0, 0.5), angle),
        ("left", "first", at(0, -0.5), at(-0.5), -angle),
        ("right", "left", at(0.5), at(-0.5), 0.0),
    ):
        bodies[name] = opensim.Body(name, 1.0, at(0), opensim.Inertia(1 / 12, 1 / 12, 1 / 12))
        model.addBody(bodies[name])
        ends = (bodies[parent], there, at(0), bodies[name], own, at(0))
        joint = opensim.PinJoint(f"pin_{name}", *ends)
        joint.updCoordinate().setDefaultValue(turn)
        model.addJoint(joint)
    for one, two in (("second", "left"), ("third", "right")):
        ends = (bodies[one], at(0, -0.5), bodies[two], at(0.5))
        model.addConstraint(opensim.PointConstraint(*ends))
    return model


for accuracy in ACCURACIES:
    model = build(2.0)
    state, manager, energies, end = model.initSystem(), opensim.Manager(model), [], "ran to 2.5 s"
    manager.setIntegratorAccuracy(accuracy)
    manager.initialize(state)
    try:
        for k in range(251):
            state = manager.integrate(0.01 * k) if k else state
            model.realizeVelocity(state)
            energies.append(model.calcKineticEnergy(state) + model.calcPotentialEnergy(state))
    except RuntimeError:
        end = f"stopped behind {0.01 * (len(energies) - 1):.2f} s"
    worst = max(abs(one - energies[0]) for one in energies)
    print(f"accuracy {accuracy:.0e}: energy off by {worst:.2g} J, {end}")
