"""pybullet 3.2.7: a joint beyond its limit is not put back, since split impulses leave it out.

    uv run --isolated --no-project --with pybullet==3.2.7 --with numpy python bullet_joint_limit.py

A bar on a hinge begins at rest beyond the lower limit of its range, 0 rad, without any load.  A
limit that is passed by less than ``splitImpulsePenetrationThreshold``, 0.04 rad, pushes the bar
back into its range.  From 0.1 rad beyond it the bar stays where it is, unless ``useSplitImpulse``
is 0: split impulses of a multibody are computed and not applied.
"""

import tempfile
from pathlib import Path

import pybullet as bullet

STEP, STEPS = 0.01, 1000
ROBOT = """<robot name="bar"><link name="base"/><link name="bar"><inertial>
<origin xyz="0.5 0 0"/><mass value="2"/><inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0"
iyz="0"/></inertial></link><joint name="hinge" type="revolute"><parent link="base"/>
<child link="bar"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1e9" velocity="1e9"/>
</joint></robot>"""

file = Path(tempfile.mkdtemp()) / "bar.urdf"
file.write_text(ROBOT)
for split, start in ((1, -0.03), (1, -0.1), (0, -0.1)):
    bullet.connect(bullet.DIRECT)
    bullet.setTimeStep(STEP)
    bullet.setPhysicsEngineParameter(useSplitImpulse=split)
    body = bullet.loadURDF(str(file), useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE)
    bullet.setJointMotorControl2(body, 0, bullet.VELOCITY_CONTROL, force=0)
    bullet.resetJointState(body, 0, start)
    for _ in range(STEPS):
        bullet.stepSimulation()
    value = bullet.getJointState(body, 0)[0]
    after = f"{value:.4f} rad after 10 s; right: 0 rad or more"
    print(f"useSplitImpulse={split}, from {start} rad: {after}")
    bullet.disconnect()
