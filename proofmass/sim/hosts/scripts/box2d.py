"""Box2D by pybox2d: bodies in the plane, in single precision.

Hinges, slides, gears and loops are Box2D's joints, and drives its motors with large limits; a motor
at rest with a small limit is dry friction.
Springs, dampers and loads are applied by hand in each step, at the state at its beginning.

Box2D closes joints by moving bodies behind a step, and leaves the velocities as they are: these
fit the pose before the step.  Read at the pose of the sample, from the rates of joints, they are of
first order in both readings.  In the next step the part that points off the new direction is lost,
so that free motions are damped, also of first order.
"""

from importlib.metadata import version

import Box2D as box2d
import numpy as np
import proofmass_host as host

VERSIONS = {"box2d": version("box2d"), "numpy": np.__version__}
BOX2D_ITERATIONS = 8, 3
"""Iterations for velocities and positions that Box2D's manual names."""
MOTOR_LIMIT = 1e9
"""Largest moment or force of a drive [N m or N]."""
CATCH_UP = 0.1
"""Share of what a drive is behind that it makes up for in a step.  With all of it the motors of two
drives and Box2D's closing of joints drive each other apart near a singular pose."""


class Box2dWorld:
    """A mechanism in a world of Box2D: `bodies` of the links and `joints`."""

    def __init__(self, mechanism, settings):
        self.mechanism, defaults = mechanism, settings["defaults"]
        self.iterations = BOX2D_ITERATIONS if defaults else (settings["iterations"],) * 2
        self.world = box2d.b2World(gravity=self.flat(mechanism.gravity), doSleep=defaults)
        self.bodies = [self.world.CreateStaticBody()]
        for k in range(1, len(mechanism.links)):
            self.add_link(k, defaults)
        self.joints = [self.add_joint(j) for j in range(len(mechanism.joints))]
        for loop in mechanism.loops:
            ends = self.local(loop.a, loop.on_a), self.local(loop.b, loop.on_b)
            self.pin(self.bodies[loop.a], self.bodies[loop.b], *ends)
        for gear in mechanism.gears:
            ratio = -gear.ratio * self.sense(gear.one) * self.sense(gear.two)
            one, two = self.joints[gear.one], self.joints[gear.two]
            ends = {"bodyA": one.bodyB, "bodyB": two.bodyB, "joint1": one, "joint2": two}
            self.world.CreateGearJoint(**ends, ratio=ratio)

    def flat(self, vector):
        """Components of a vector in the plane."""
        x, y = self.mechanism.flat(vector)
        return float(x), float(y)

    def local(self, k, at):
        """A point of a link, given in the start pose, in the coordinates of its body."""
        return self.flat(at - self.mechanism.links[k].centre)

    def sense(self, j):
        """1 if a joint has the sense of Box2D's coordinate, otherwise -1."""
        return self.mechanism.turn_of(j) if self.mechanism.joints[j].kind == "hinge" else 1.0

    def add_link(self, k, may_sleep):
        """Add the body of a link."""
        link, normal = self.mechanism.links[k], self.mechanism.plane[2]
        moment = float(normal @ host.inertia_with_armature(self.mechanism, k) @ normal)
        refuse_lost_inertia(self.mechanism, k, moment)
        body = self.world.CreateDynamicBody(
            position=self.flat(link.centre),
            linearVelocity=self.flat(link.velocity),
            angularVelocity=float(link.omega @ normal),
            allowSleep=may_sleep,
        )
        body.massData = box2d.b2MassData(mass=link.mass, center=(0.0, 0.0), I=moment)
        self.bodies.append(body)

    def pin(self, a, b, on_a, on_b):
        """Join points of two bodies."""
        ends = {"localAnchorA": on_a, "localAnchorB": on_b}
        return self.world.CreateRevoluteJoint(bodyA=a, bodyB=b, **ends)

    def add_joint(self, j):
        """Add a hinge or slide, with a motor if it is driven or has dry friction."""
        joint = self.mechanism.joints[j]
        limit = MOTOR_LIMIT if self.mechanism.drive_of(j) else self.mechanism.friction_of(j)
        pair = self.bodies[joint.parent], self.bodies[joint.child]
        if joint.kind == "hinge":
            ends = (self.local(k, joint.anchor) for k in (joint.parent, joint.child))
            made = self.pin(*pair, *ends)
            made.maxMotorTorque = limit
        else:
            place = {"anchor": self.flat(joint.anchor), "axis": self.flat(joint.axis)}
            made = self.world.CreatePrismaticJoint(bodyA=pair[0], bodyB=pair[1], **place)
            made.maxMotorForce = limit
        made.motorEnabled = limit > 0.0
        if joint.limits:
            made.limits = sorted((self.sense(j) * joint.ends).tolist())
            made.limitEnabled = True
        return made

    def step(self, i):
        """Step number i, with the rates of drives and the forces on links."""
        mechanism = self.mechanism
        for drive in mechanism.drives:
            j = drive.joint
            now, later = drive.value[2 * i], drive.value[2 * (i + 1)]
            behind = now - mechanism.joints[j].value - self.joint(j)[0]
            way = later - now + CATCH_UP * behind
            self.joints[j].motorSpeed = float(self.sense(j) * way / mechanism.step)
        for k, place, force, moment in host.link_forces(mechanism, i, self.read, self.joint):
            self.bodies[k].ApplyForce(self.flat(force), self.flat(place), True)
            self.bodies[k].ApplyTorque(float(moment @ mechanism.plane[2]), True)
        self.world.Step(mechanism.step, *self.iterations)

    def read(self, k):
        """The motion of a link."""
        body = self.bodies[k]
        rates = np.array([*body.linearVelocity, body.angularVelocity])
        return host.in_space(self.mechanism, k, np.array(body.worldCenter), body.angle, rates)

    def joint(self, j):
        """Coordinate and rate of a hinge or slide."""
        made, sense = self.joints[j], self.sense(j)
        hinge = self.mechanism.joints[j].kind == "hinge"
        return sense * (made.angle if hinge else made.translation), sense * made.speed


def refuse_lost_inertia(mechanism, k, moment):
    """Refuse a link whose inertia is lost beside its mass at an anchor, in single precision.

    A joint adds 1 / mass and arm^2 / inertia, and the first is lost if it is too small.
    """
    link = mechanism.links[k]
    ends = [one.anchor for one in mechanism.joints if k in (one.parent, one.child)]
    ends += [one.on_a for one in mechanism.loops if one.a == k]
    ends += [one.on_b for one in mechanism.loops if one.b == k]
    lever = max(np.linalg.norm(mechanism.flat(one - link.centre)) for one in ends)
    if moment < np.finfo(np.float32).eps * link.mass * lever**2:
        raise host.Refused(
            f"link {link.name!r} with an inertia of {moment:.3g} kg m2, that single precision does "
            f"not carry beside the {link.mass * lever**2:.3g} kg m2 of its mass at a joint"
        )


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Step the world through the run."""
    host.refuse_rows(mechanism)
    world = Box2dWorld(mechanism, settings)
    return host.record(mechanism, world.step, world.read, world.joint)
