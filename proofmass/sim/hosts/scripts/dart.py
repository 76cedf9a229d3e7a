"""DART: a tree in reduced coordinates, loops by impulses, semi-implicit Euler.

Hinges, slides, balls and free links are DART's joints; several joints of a link in a row have
massless links between them.  Loops are its ball joint constraints, and drives its velocity
actuators; dry friction is DART's.  Springs, dampers and loads are applied by hand in each step, at
the coordinates and the rates at its beginning: DART's own are implicit, of first order.

In the half-step reading these rates are half a step old.  Dampers and Coriolis forces, which DART
takes at them too, are then of first order in the step, and all else is of second order.
"""

import itertools

import dartpy as dart
import numpy as np
import proofmass_host as host

VERSIONS = {"dartpy": dart.__version__, "numpy": np.__version__}
LOOP = dart.constraint.BallJointConstraint
ERROR_REDUCTIONS = {True: LOOP.getErrorReductionParameter(), False: 1.0}
"""Share of the opening of a loop that a step closes: by the engine's defaults, or else."""
VELOCITY = dart.dynamics.ActuatorType.VELOCITY
MAKERS = {"hinge": "Revolute", "slide": "Prismatic", "ball": "Ball", "free": "Free"}
SHAPES = {
    "plane": lambda _: dart.dynamics.PlaneShape(np.array([0.0, 0.0, 1.0]), 0.0),
    "sphere": lambda size: dart.dynamics.SphereShape(size[0]),
    "box": lambda size: dart.dynamics.BoxShape(2.0 * size),
    "capsule": lambda size: dart.dynamics.CapsuleShape(size[0], 2.0 * size[1]),
    "cylinder": lambda size: dart.dynamics.CylinderShape(size[0], 2.0 * size[1]),
}


class DartTree:
    """A mechanism as a skeleton of DART.

    `nodes` are those of the links, None for the ground; the frame of each is at its place in
    `origins` in the start pose [m].
    """

    def __init__(self, mechanism, defaults):
        self.mechanism, self.origins, self.nodes = mechanism, [np.zeros(3)], [None]
        self.world, self.skeleton = dart.simulation.World(), dart.dynamics.Skeleton("mechanism")
        self.joints = [None] * len(mechanism.joints)
        self.world.setTimeStep(mechanism.step)
        self.world.setGravity(mechanism.gravity)
        for k in range(1, len(mechanism.links)):
            self.add_link(k)
        self.world.addSkeleton(self.skeleton)
        if mechanism.contacts:
            self.add_contacts(defaults)
        if hasattr(self.world, "getDeactivationOptions"):  # from 6.19 on slow skeletons sleep
            options = self.world.getDeactivationOptions()
            options.mEnabled = defaults
            self.world.setDeactivationOptions(options)
        LOOP.setErrorReductionParameter(ERROR_REDUCTIONS[defaults])
        for loop in mechanism.loops:
            nodes = [self.nodes[k] for k in (loop.a, loop.b) if k]
            self.world.getConstraintSolver().addConstraint(LOOP(*nodes, loop.on_a))
        openings = host.start_openings(mechanism, ERROR_REDUCTIONS[defaults])
        for made, joint, motion in zip(self.joints, mechanism.joints, openings):
            one = [motion.sum(axis=0) @ joint.axis]
            made.setPositions(one if joint.is_single else motion.ravel()[: made.getNumDofs()])

    def add_contacts(self, defaults):
        """Add the shapes, let their pairs alone touch, and give each its law."""
        found, bodies = host.contact_surfaces(self.mechanism, host.split_by_minimum), {}
        self.skeleton.enableSelfCollisionCheck()
        self.skeleton.enableAdjacentBodyCheck()
        for one in self.mechanism.shapes:
            node, name, place = self.nodes[one.link], host.surface_of(one), dart.math.Isometry3()
            if not one.link:
                ground = dart.dynamics.Skeleton(one.name)
                node = ground.createWeldJointAndBodyNodePair()[1]
                self.world.addSkeleton(ground)
            place.set_translation(one.place - self.origins[one.link])
            place.set_rotation(one.axes)
            made, bodies[name] = node.createShapeNode(SHAPES[one.kind](one.size)), node
            made.setRelativeTransform(place)
            made.createCollisionAspect()
            law = made.createDynamicsAspect()
            law.setFrictionCoeff(found.frictions[name])
            law.setRestitutionCoeff(found.restitutions[name])
        self.filter = dart.collision.BodyNodeCollisionFilter()
        for a, b in itertools.combinations(bodies, 2):
            if not found.touch(a, b):
                self.filter.addBodyNodePairToBlackList(bodies[a], bodies[b])
        solver = self.world.getConstraintSolver()
        if not defaults:
            solver.setCollisionDetector(dart.collision.OdeCollisionDetector())
        solver.getCollisionOption().collisionFilter = self.filter

    def add_link(self, k):
        """Add a link with its joints."""
        link, own = self.mechanism.links[k], self.mechanism.joints_of(k)
        base = self.mechanism.joints[own[0]].parent
        node, origin = self.nodes[base], self.origins[base]
        for j in own:
            joint = self.mechanism.joints[j]
            anchor = link.centre if joint.kind == "free" else joint.anchor
            node = self.add_joint(j, node, anchor - origin)
            origin = anchor
            node.setInertia(dart.dynamics.Inertia(0.0, np.zeros(3), np.zeros((3, 3))))
        node.setInertia(dart.dynamics.Inertia(link.mass, link.centre - origin, link.inertia))
        self.nodes.append(node)
        self.origins.append(origin)

    def add_joint(self, j, parent, offset):
        """Add a joint at an offset from the frame of its parent; returns its child."""
        joint, place = self.mechanism.joints[j], dart.math.Isometry3()
        make = getattr(self.skeleton, f"create{MAKERS[joint.kind]}JointAndBodyNodePair")
        made, node = make() if parent is None else make(parent)
        place.set_translation(offset)
        made.setTransformFromParentBodyNode(place)
        rates = self.mechanism.start_rates(j)
        if joint.is_single:
            made.setAxis(joint.axis)
        elif joint.kind == "free":  # whose frame is at the centre
            velocity = host.start_velocity(self.mechanism, joint.child)
            rates = np.concatenate([rates[3:], velocity])
        made.setVelocities(rates)
        if self.mechanism.drive_of(j):
            made.setActuatorType(VELOCITY)
        if joint.is_single:
            made.setCoulombFriction(0, self.mechanism.friction_of(j))
        if joint.limits:
            made.setPositionLowerLimit(0, joint.ends[0])
            made.setPositionUpperLimit(0, joint.ends[1])
            made.setLimitEnforcement(True)
        self.joints[j] = made
        return node

    def step(self, i):
        """Step number i, with the forces on joints and links, and the rates of drives."""
        for j, rate in host.drive_rates(self.mechanism, i, self.joint):
            self.joints[j].setCommand(0, rate)
        for j, force in host.joint_forces(self.mechanism, i, self.joint):
            self.joints[j].setForce(0, force)
        for k, place, force, moment in host.link_forces(self.mechanism, i, self.read):
            self.nodes[k].addExtForce(force, place, False, False)
            self.nodes[k].addExtTorque(moment, False)
        self.world.step()

    def read(self, k):
        """The motion of a link."""
        node, arm = self.nodes[k], self.mechanism.links[k].centre - self.origins[k]
        place, velocity = node.getWorldTransform(), node.getLinearVelocity(arm)
        return place.multiply(arm), place.rotation(), velocity, node.getAngularVelocity()

    def joint(self, j):
        """Coordinate and rate of a hinge or slide."""
        return self.joints[j].getPosition(0), self.joints[j].getVelocity(0)


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Step the skeleton through the run."""
    host.refuse_gears(mechanism, "dartpy")
    host.refuse_armatures(mechanism, "DART")
    tree = DartTree(mechanism, settings["defaults"])
    return host.record(mechanism, tree.step, tree.read, tree.joint)
