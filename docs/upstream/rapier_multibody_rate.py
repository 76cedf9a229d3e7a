"""rapier3d 0.36.1: the velocity of a link of a multibody is that of the step before.

    uv run --isolated --no-project --with rapier3d==0.36.1 python rapier_multibody_rate.py

A rod of 1 kg and 0.1 kg m2 hangs level on a hinge 1 m from its centre and is let go.  Its angular
velocity after n steps of 1 ms is -8.918 n 1e-3 rad/s at first.  With an impulse joint the body has
it, and the multibody has it in generalized_velocity; the body of the multibody has that of n - 1
steps.  set_damping is needed as well: each joint of a multibody has a damping of 0.1 by default.
"""

import rapier3d as rapier


def rod(multibody):
    """A world with the rod, its body, and its multibody joint or None."""
    world = rapier.PhysicsWorld(gravity=(0.0, -9.81, 0.0))
    world.integration_parameters.dt = 1e-3
    world.integration_parameters.num_solver_iterations = 1
    mass = rapier.MassProperties((0.0, 0.0, 0.0), 1.0, (0.1, 0.1, 0.1))
    body = rapier.RigidBodyBuilder(rapier.RigidBodyType.DYNAMIC).translation((1.0, 0.0, 0.0))
    ground = world.add_body(rapier.RigidBody.fixed())
    body = world.add_body(body.additional_mass_properties(mass))
    hinge = rapier.RevoluteJointBuilder((0.0, 0.0, 1.0)).local_anchor2((-1.0, 0.0, 0.0)).build()
    made = (world.multibody_joints if multibody else world.impulse_joints).insert(
        ground, body, hinge
    )
    if multibody:
        tree = world.multibody_joints.multibody(made)
        tree.set_damping([0.0] * tree.ndofs)
    return world, body, made if multibody else None


worlds = [rod(False), rod(True)]
for n in range(1, 4):
    for world, _, _ in worlds:
        world.step()
    alone, linked = (world.rigid_bodies[body].angvel.z for world, body, _ in worlds)
    world, _, joint = worlds[1]
    rate = world.multibody_joints.multibody(joint).generalized_velocity()[0]
    print(
        f"after {n} ms: {alone:.6f} rad/s with an impulse joint; multibody {rate:.6f}, "
        f"its body {linked:.6f}"
    )
