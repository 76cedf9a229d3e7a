"""newton 1.8.0: XPBD multiplies the inertia of links on joints by 7 / 4 with its default factors.

    uv run --isolated --no-project --with newton==1.8.0 python newton_xpbd_inertia.py

A rod of 1 kg and 0.1 kg m2 hangs level on a hinge 1 m from its centre and is let go.  It must begin
to turn with 9.81 / (1 + 0.1) = 8.918 rad/s2.  With joint_linear_relaxation 0.7 and
joint_angular_relaxation 0.4, the defaults, a joint gives 0.7 of its force but 0.4 of the moment of
this force, and the rod turns with 9.81 / (1 + 0.1 * 0.7 / 0.4) = 8.349 rad/s2, whatever the step
and the number of iterations are.  With two equal factors it turns as it must.
"""

import newton
import numpy as np
import warp

warp.config.quiet = True
STEP, STEPS = 1e-4, 100
builder = newton.ModelBuilder(gravity=(0.0, -9.81, 0.0))
body = builder.add_link(
    xform=warp.transform(warp.vec3(1.0, 0.0, 0.0), warp.quat_identity()),
    mass=1.0,
    inertia=warp.mat33(*(0.1 * np.eye(3)).ravel().tolist()),
    lock_inertia=True,
)
end = warp.transform(warp.vec3(-1.0, 0.0, 0.0), warp.quat_identity())
hinge = builder.add_joint_revolute(-1, body, child_xform=end, axis=(0.0, 0.0, 1.0))
builder.add_articulation([hinge])
model = builder.finalize(device="cpu")
for linear, angular in ((0.7, 0.4), (0.7, 0.7), (0.4, 0.4)):
    for iterations in (20, 100):
        solver = newton.solvers.SolverXPBD(
            model,
            iterations=iterations,
            joint_linear_relaxation=linear,
            joint_angular_relaxation=angular,
        )
        now, later, control = model.state(), model.state(), model.control()
        for _ in range(STEPS):
            now.clear_forces()
            solver.step(now, later, control, None, STEP)
            now, later = later, now
        rate = -now.body_qd.numpy()[0, 5] / (STEP * STEPS)
        print(f"factors {linear}, {angular}; {iterations:3} iterations: {rate:.3f} rad/s2")
