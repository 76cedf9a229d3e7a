"""A constraint with the world ends Drake with signal 11 (1.46.0 to 1.51.1; 1.45.0 is right).

A free body is pinned to the ground at a point 0.1 m beside its centre, and falls for 0.1 s as a
pendulum.  Pinned to a body that is welded to the world, the same runs.

    uv run --no-project --with drake==1.51.1 python drake_ground_constraint.py
"""

import subprocess
import sys

from pydrake.math import RigidTransform
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, WeldJoint
from pydrake.systems.analysis import Simulator

WAYS = "the world", "a body that is welded to the world"


def fall(way: str) -> float:
    """Height of the centre after 0.1 s [m]."""
    plant, box = MultibodyPlant(1e-3), SpatialInertia.SolidBoxWithMass(1.0, 0.2, 0.3, 0.1)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
    body, ground = plant.AddRigidBody("body", box), plant.world_body()
    if way != WAYS[0]:
        ground, world = plant.AddRigidBody("ground", box), plant.world_frame()
        plant.AddJoint(WeldJoint("weld", world, ground.body_frame(), RigidTransform()))
    plant.AddBallConstraint(body, [0.1, 0.0, 0.0], ground, [0.1, 0.0, 0.0])
    plant.Finalize()
    simulator = Simulator(plant)
    simulator.AdvanceTo(0.1)
    return float(plant.EvalBodyPoseInWorld(simulator.get_context(), body).translation()[2])


if len(sys.argv) > 1:
    print(f"{fall(sys.argv[1]):.5f} m")
else:
    for way in WAYS:
        made = subprocess.run([sys.executable, __file__, way], capture_output=True, text=True)
        print(f"pinned to {way}: {made.stdout.strip() or f'return code {made.returncode}'}")
