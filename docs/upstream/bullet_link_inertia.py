"""pybullet 3.2.7: changeDynamics of a link with a damping changes the base instead of the link.

    uv run --isolated --no-project --with pybullet==3.2.7 --with numpy python bullet_link_inertia.py

A bar of 2 kg on a hinge, its centre at 0.3 m, gets 0.5 kg m2 about its centre: in a call of its
own, and in one that sets linearDamping too.  A moment of 1 N m must turn it with
1 / (0.5 + 2 * 0.3**2) = 1.471 rad/s2.  After the second call the base has the inertia, without a
warning, and the bar turns as a point mass does, with 5.556 rad/s2.  maxJointVelocity does the same.
"""

import pybullet as bullet

MASS, ARM, INERTIA, STEP = 2.0, 0.3, 0.5, 1e-3

bullet.connect(bullet.DIRECT)
bullet.setTimeStep(STEP)
for more in ({}, {"linearDamping": 0.0}):
    body = bullet.createMultiBody(
        baseMass=0.0,
        linkMasses=[MASS],
        linkCollisionShapeIndices=[-1],
        linkVisualShapeIndices=[-1],
        linkPositions=[[0, 0, 0]],
        linkOrientations=[[0, 0, 0, 1]],
        linkInertialFramePositions=[[ARM, 0, 0]],
        linkInertialFrameOrientations=[[0, 0, 0, 1]],
        linkParentIndices=[0],
        linkJointTypes=[bullet.JOINT_REVOLUTE],
        linkJointAxis=[[0, 0, 1]],
    )
    bullet.changeDynamics(body, 0, localInertiaDiagonal=[INERTIA] * 3, **more)
    base, link = (bullet.getDynamicsInfo(body, index)[2] for index in (-1, 0))
    bullet.setJointMotorControl2(body, 0, bullet.VELOCITY_CONTROL, force=0)
    bullet.setJointMotorControl2(body, 0, bullet.TORQUE_CONTROL, force=1.0)
    bullet.stepSimulation()
    found, right = bullet.getJointState(body, 0)[1] / STEP, 1 / (INERTIA + MASS * ARM**2)
    print(f"inertia {'with ' + str(more) if more else 'alone'}: base {base}, link {link};")
    print(f"  1 N m turns the bar with {found:.3f} rad/s2, right: {right:.3f}")
