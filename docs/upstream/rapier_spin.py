"""rapier3d 0.36.1: a body that turns freely gains energy, the more the shorter the step.

    uv run --isolated --no-project --with rapier3d==0.36.1 --with numpy python rapier_spin.py

A body of 0.1, 0.2 and 0.3 kg m2 turns about its middle axis for 5 s, and nothing acts on it, so
that its energy is constant.  Gyroscopic forces are on by default.  From steps of 1 ms on each step
adds about 2e-7 of the energy, 0.5 % in all with 0.2 ms and 1.1 % with 0.1 ms.  That is the size of
the rounding of single precision, but always of one sign.
"""

import numpy as np
import rapier3d as rapier

MOMENTS, START, TIME = np.array([0.1, 0.2, 0.3]), np.array([1.0, 5.0, 0.5]), 5.0

for step in (1e-2, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4):
    world = rapier.PhysicsWorld()
    world.integration_parameters.dt = step
    world.integration_parameters.num_solver_iterations = 1
    mass = rapier.MassProperties((0.0, 0.0, 0.0), 1.0, tuple(MOMENTS))
    body = rapier.RigidBodyBuilder(rapier.RigidBodyType.DYNAMIC).angvel(tuple(START))
    handle = world.add_body(body.additional_mass_properties(mass).can_sleep(False))
    steps = round(TIME / step)
    for _ in range(steps):
        world.step()
    body = world.rigid_bodies[handle]
    rate = body.rotation.inverse().transform_vector(body.angvel)
    rate = np.array([rate.x, rate.y, rate.z])
    gain = rate @ (MOMENTS * rate) / (START @ (MOMENTS * START)) - 1.0
    print(f"step {1e3 * step:4.1f} ms: energy {gain:+.2%}, {gain / steps:+.1e} a step")
