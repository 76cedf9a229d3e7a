"""Bullet by pybullet: trees in reduced coordinates, loops by impulses, semi-implicit Euler.

A free link is the base of a tree of its own; all others are one tree.  Drives are motors without
limit, and dry friction is a motor at rest with one; loops and gears are Bullet's.  Springs, dampers
and loads are applied by hand at the state at the beginning of a step.  In the half-step reading its
rates are half a step old: dampers, and the Coriolis forces of Bullet, are of first order in the
step, and all else is of second order.
"""

from importlib.metadata import version

import numpy as np
import proofmass_host as host
import pybullet as bullet

VERSIONS = {"pybullet": version("pybullet"), "numpy": np.__version__}
ERROR_REDUCTION, NO_LIMIT = 1.0, 1e12  # a step closes all of an opening, unless by default
CONVERGED = 1e-26  # squared residual of velocities [m2/s2 or rad2/s2] at which iterations end:
# those beyond it add what rounding leaves, by which a pin of two parallel slides never rests
SELF = bullet.URDF_USE_SELF_COLLISION | bullet.URDF_USE_SELF_COLLISION_INCLUDE_PARENT
SPACE_REACH = 100.0  # half side of a box for a half space, in sizes: a plane touches by one corner
NEAR_STOP, STOP_WAY = 1e-9, 1e-15  # of a joint on its stop, which acts only on one beyond it


class BulletTrees:
    """A mechanism in Bullet: body and index of its links, `places`, and of its `joints`."""

    def __init__(self, mechanism, settings):
        self.mechanism, self.places, self.joints = mechanism, {}, {}
        bullet.setGravity(*mechanism.gravity)
        bullet.setTimeStep(mechanism.step)
        for root in [0, *(one.child for one in mechanism.joints if one.kind == "free")]:
            self.load_tree(root, settings["defaults"])
        self.places[0] = -1, -1  # not the base, which Bullet does not take in constraints
        if mechanism.contacts:
            self.add_contacts(settings["defaults"])
        if not settings["defaults"]:
            own = {"solverResidualThreshold": CONVERGED, "erp": ERROR_REDUCTION}
            own |= {"numSolverIterations": settings["iterations"], "useSplitImpulse": 0}
            bullet.setPhysicsEngineParameter(**own)
        for loop in mechanism.loops:
            ends = loop.points[:: 1 if loop.a else -1]  # the first is not the ground
            points = [list(self.axes(k).T @ mechanism.arm(k, at)) for k, at in ends]
            links = [one for k, _ in ends for one in self.places[k]]
            made = bullet.createConstraint(*links, bullet.JOINT_POINT2POINT, [0.0] * 3, *points)
            bullet.changeConstraint(made, maxForce=NO_LIMIT)
        for gear in mechanism.gears:
            ends = *self.joints[gear.one], *self.joints[gear.two]
            made = bullet.createConstraint(*ends, bullet.JOINT_GEAR, *[[0.0] * 3] * 3)
            bullet.changeConstraint(made, gearRatio=-gear.ratio, maxForce=NO_LIMIT)
        for j, motion in enumerate(host.start_openings(mechanism, ERROR_REDUCTION)):
            self.start(j, motion)

    def add_contacts(self, defaults):
        """Let the pairs of links and shapes of the ground touch, with the law of each."""
        found = host.contact_surfaces(self.mechanism, host.split_by_product)
        reach = SPACE_REACH * self.mechanism.size
        places = {k: place for k, place in self.places.items() if k}
        for k, one in enumerate(self.mechanism.shapes):
            if not one.link:
                turn = bullet.getQuaternionFromEuler(host.angles_of(one.axes))
                where = {"basePosition": one.place, "baseOrientation": turn}
                body = self.load(f"ground{k}", host.ground_urdf(one, reach), **where)
                places[one.name] = body, -1
        for place in places.values():
            bullet.setCollisionFilterGroupMask(*place, 0, 0)
        for (a, i), (b, j) in ((places[one], places[two]) for one, two in found.pairs):
            bullet.setCollisionFilterPair(a, b, i, j, 1)
        for name, friction in found.frictions.items():
            own = {"lateralFriction": friction, "restitution": found.restitutions[name]}
            own |= {"rollingFriction": 0.0, "spinningFriction": 0.0}
            own |= {} if defaults else {"contactProcessingThreshold": 0.0}
            bullet.changeDynamics(*places[name], **own)
        if not defaults:
            own = {"contactERP": self.mechanism.step / host.OVERLAP_TIME}
            bullet.setPhysicsEngineParameter(restitutionVelocityThreshold=0.0, **own)

    def load(self, name, text, fixed=True, **where):
        """Load a robot from its text."""
        flags = bullet.URDF_USE_INERTIA_FROM_FILE | bullet.URDF_MAINTAIN_LINK_ORDER | SELF
        path = f"{name}.urdf"  # Bullet keeps a file that it has read by its name
        with open(path, "w") as file:
            file.write(text)
        return bullet.loadURDF(path, flags=flags, useFixedBase=fixed, **where)

    def load_tree(self, root, damped):
        """Load the tree on a link."""
        where = {"basePosition": self.mechanism.links[root].centre}
        body = self.load(f"tree{root}", host.tree_urdf(self.mechanism, root), root == 0, **where)
        self.places[root] = body, -1
        own = {} if damped else {"linearDamping": 0.0, "angularDamping": 0.0}
        bullet.changeDynamics(body, -1, maxJointVelocity=NO_LIMIT, **own)
        for i in range(bullet.getNumJoints(body)):
            info = bullet.getJointInfo(body, i)
            self.joints[int(info[1][5:])] = body, i
            if info[12].startswith(b"link"):
                self.places[int(info[12][4:])] = body, i

    def axes(self, k):
        """The principal axes of inertia of a link in the start pose, to which Bullet turns it."""
        return host.matrix_of_xyzw(bullet.getDynamicsInfo(*self.places[k])[4]) if k else np.eye(3)

    def start(self, j, motion):
        """Set the coordinates and rates of a joint; its motor at rest is its dry friction."""
        joint, at, turn = self.mechanism.joints[j], self.joints.get(j), [*motion[0] / 2, 1.0]
        link, base = self.mechanism.links[joint.child], self.mechanism.links[joint.parent]
        if joint.kind == "free":
            k, body = joint.child, self.places[joint.child][0]
            frame, half = np.array(bullet.getBasePositionAndOrientation(body)[1]), motion[0] / 2
            frame += np.append(np.cross(half, frame[:3]) + frame[3] * half, -half @ frame[:3])
            bullet.resetBasePositionAndOrientation(body, link.centre + motion[1], frame)
            bullet.resetBaseVelocity(body, host.start_velocity(self.mechanism, k), link.omega)
        elif joint.kind == "ball":
            bullet.resetJointStateMultiDof(*at, turn, list(link.omega - base.omega))
            bullet.setJointMotorControlMultiDof(*at, bullet.POSITION_CONTROL, turn, force=[0.0] * 3)
        else:
            bullet.resetJointState(*at, motion.sum(axis=0) @ joint.axis, joint.rate)
            bullet.setJointMotorControl2(*at, bullet.VELOCITY_CONTROL, force=joint.friction)

    def step(self, i):
        """Step number i, with the forces on joints and links, and the rates of drives."""
        for j, rate in host.drive_rates(self.mechanism, i, self.joint):
            goal = {"targetVelocity": rate, "force": NO_LIMIT}
            bullet.setJointMotorControl2(*self.joints[j], bullet.VELOCITY_CONTROL, **goal)
        for j, force in host.joint_forces(self.mechanism, i, self.joint):
            bullet.setJointMotorControl2(*self.joints[j], bullet.TORQUE_CONTROL, force=force)
        for j, joint in enumerate(self.mechanism.joints):
            if joint.limits:
                low, high = joint.stops_at(self.joint(j)[0], NEAR_STOP, STOP_WAY)
                bullet.changeDynamics(*self.joints[j], jointLowerLimit=low, jointUpperLimit=high)
        for k, place, force, moment in host.link_forces(self.mechanism, i, self.read):
            bullet.applyExternalForce(*self.places[k], force, place, bullet.WORLD_FRAME)
            bullet.applyExternalTorque(*self.places[k], moment, bullet.WORLD_FRAME)
        bullet.stepSimulation()

    def read(self, k):
        """The motion of a link."""
        body, i = self.places[k]
        if i < 0:
            state, rates = bullet.getBasePositionAndOrientation(body), bullet.getBaseVelocity(body)
        else:
            state = bullet.getLinkState(body, i, 1, 1)
            rates = state[6:8]  # its orientation number 5 is in single precision
        turn = host.matrix_of_xyzw(state[1]) @ self.axes(k).T
        return np.array(state[0]), turn, *map(np.array, rates)

    def joint(self, j):
        """Coordinate and rate of a hinge or slide."""
        return bullet.getJointState(*self.joints[j])[:2]


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Step the trees through the run."""
    host.refuse_armatures(mechanism, "Bullet")
    bullet.connect(bullet.DIRECT)
    try:
        trees = BulletTrees(mechanism, settings)
        return host.record(mechanism, trees.step, trees.read, trees.joint)
    finally:
        bullet.disconnect()
