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
UNITS_WITH_CONTACTS = 100.0
"""Size of a mechanism with contacts in units of the world.  Box2D lets shapes overlap by 5 mm and
bounce from 1 m/s on, constants that a large unit of length makes small."""
PLANE_REACH = 20.0
"""Half length of the box that stands for a half plane, in sizes of the mechanism: more of them cost
digits, and a link that is beyond is lost."""
SHORTENED = 1.0 - 1e-4
"""Share of the longest way in a step at which Box2D has shortened it, in single precision."""
CATCH_UP = 0.1
"""Share of what a drive is behind that it makes up for in a step.  With all of it the motors of two
drives and Box2D's closing of joints drive each other apart near a singular pose."""


class Box2dWorld(host.PlanarBodies):
    """A mechanism in a world of Box2D: `bodies` of the links and `joints`."""

    def __init__(self, mechanism, settings):
        defaults = settings["defaults"]
        tuned = mechanism.contacts and not defaults
        super().__init__(mechanism, UNITS_WITH_CONTACTS / mechanism.size if tuned else 1.0)
        self.iterations = BOX2D_ITERATIONS if defaults else (settings["iterations"],) * 2
        self.world = box2d.b2World(gravity=self.flat(mechanism.gravity), doSleep=defaults)
        self.world.continuousPhysics = defaults
        self.bodies, self.masses = [self.world.CreateStaticBody()], {}
        for k in range(1, len(mechanism.links)):
            self.add_link(k, defaults)
        self.add_contacts(defaults)
        self.joints = {j: self.add_joint(j) for j in self.held}
        for loop in mechanism.loops:
            self.pin(loop)
        for gear in mechanism.gears:
            ratio = -gear.ratio * self.sense(gear.one) * self.sense(gear.two)
            one, two = self.joints[gear.one], self.joints[gear.two]
            ends = {"bodyA": one.bodyB, "bodyB": two.bodyB, "joint1": one, "joint2": two}
            self.world.CreateGearJoint(**ends, ratio=ratio)

    def add_link(self, k, may_sleep):
        """Add the body of a link."""
        link, normal = self.mechanism.links[k], self.mechanism.plane[2]
        moment = host.moment_in_plane(self.mechanism, k)
        host.refuse_lost_inertia(self.mechanism, k, host.SINGLE_ROUNDING, moment)
        given = {"position": self.flat(link.centre), "linearVelocity": self.flat(link.velocity)}
        given |= {"angularVelocity": float(link.omega @ normal), "allowSleep": may_sleep}
        body, inertia = self.world.CreateDynamicBody(**given), self.scale**2 * moment
        self.bodies.append(body)
        self.masses[body] = box2d.b2MassData(mass=link.mass, center=(0.0, 0.0), I=inertia)
        body.massData = self.masses[body]

    def add_contacts(self, defaults):
        """Add the sections of shapes, and a listener that gives each pair its law."""
        sections, laws = host.planar_contacts(self.mechanism)
        for k, one in sections.items():
            body, points = self.bodies[one.link], (self.scale * one.points).tolist()
            if len(points) == 2:
                points = (self.scale * one.surface(PLANE_REACH * self.mechanism.size)).tolist()
            if len(points) == 1:
                shape = box2d.b2CircleShape(radius=self.scale * one.radius, pos=points[0])
            else:
                shape = box2d.b2PolygonShape(vertices=points)
                shape.radius = shape.radius if defaults else 0.0
            body.CreateFixture(shape=shape, density=0.0, userData=k)
            if one.link:
                body.massData = self.masses[body]

        class Laws(box2d.b2ContactListener):
            def PreSolve(self, contact, _):
                law = laws.get((contact.fixtureA.userData, contact.fixtureB.userData))
                contact.enabled = law is not None
                if law:
                    contact.friction, contact.restitution = law.friction, law.restitution

        self.world.contactListener = self.laws = Laws()

    def pin(self, one):
        """Join the points of a hinge or a loop."""
        names = "bodyA", "bodyB", "localAnchorA", "localAnchorB"
        ends = dict(zip(names, self.joined(one)), collideConnected=True)
        return self.world.CreateRevoluteJoint(**ends)

    def add_joint(self, j):
        """Add a hinge or slide, with a motor if it is driven or has dry friction."""
        joint = self.mechanism.joints[j]
        limit = MOTOR_LIMIT if self.mechanism.drive_of(j) else self.mechanism.friction_of(j)
        if joint.kind == "hinge":
            made = self.pin(joint)
            made.maxMotorTorque = self.scale**2 * limit
        else:
            place = {"anchor": self.flat(joint.anchor), "axis": self.flat(joint.axis)}
            ends = dict(zip(("bodyA", "bodyB"), self.pair(joint)), collideConnected=True)
            made = self.world.CreatePrismaticJoint(**ends, **place)
            made.maxMotorForce = self.scale * limit
        made.motorEnabled = limit > 0.0
        if joint.limits:
            made.limits = sorted((self.unit(j) * joint.ends).tolist())
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
            self.joints[j].motorSpeed = float(self.unit(j) * way / mechanism.step)
        for k, place, force, moment in host.link_forces(mechanism, i, self.read, self.joint):
            self.bodies[k].ApplyForce(self.flat(force), self.flat(place), True)
            moment = float(self.scale**2 * moment @ mechanism.plane[2])
            self.bodies[k].ApplyTorque(moment, True)
        self.world.Step(mechanism.step, *self.iterations)
        speed = max(body.linearVelocity.length for body in self.bodies)
        if speed * mechanism.step > SHORTENED * box2d.b2_maxTranslation:
            raise host.Refused("steps in which a link goes by more than Box2D's 2 units of length")

    def pose(self, k):
        """Place, rotation and rates of a link in Box2D; of one beyond the half planes no place."""
        body = self.bodies[k]
        place = np.array(body.worldCenter) / self.scale
        if self.mechanism.contacts and np.abs(place).max() > PLANE_REACH * self.mechanism.size:
            place = place * np.nan
        return [*place, body.angle], [*body.linearVelocity / self.scale, body.angularVelocity]

    def joint(self, j):
        """Coordinate and rate of a hinge or slide."""
        if j not in self.joints:
            return np.nan, np.nan
        made, unit = self.joints[j], self.unit(j)
        hinge = self.mechanism.joints[j].kind == "hinge"
        return (made.angle if hinge else made.translation) / unit, made.speed / unit


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Step the world through the run."""
    world = Box2dWorld(mechanism, settings)
    return host.record(mechanism, world.step, world.read, world.joint)
