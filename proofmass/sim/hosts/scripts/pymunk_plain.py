"""Chipmunk by pymunk of any version from 6.4 on, in its plain steps: bodies in the plane.

A hinge is a pivot; a slide is a groove and a gear of ratio 1, with anchors by which the groove does
not couple sliding with rotation.  A drive is a gear or a groove at right angles whose target moves;
dry friction is a motor at rest, or such a groove, with a limited force.

A step of Chipmunk moves the bodies by the velocities that they have, and then changes these.  What
is read between two steps is the state between these two: velocities, and the places to which they
are going to lead.  Springs, dampers and loads are applied by hand there; in the half-step reading
the rate in a damper is half a step old, and dampers are of first order in the step.
"""

import numpy as np
import proofmass_host as host
import pymunk

VERSIONS = {"pymunk": pymunk.version, "numpy": np.__version__}
VERSIONS["chipmunk"] = pymunk.chipmunk_version
CHIPMUNK_ITERATIONS = 10
STOP_LEAD = 1e-12
"""Distance of a stop before the end of the range [rad or m].  A stop of Chipmunk acts only on a
joint beyond it, so that a joint is put back to this distance beyond its stop."""
NO_CORRECTION = 1e-30
"""Way by which a stop puts a joint back that is where it should be [rad or m]; without any way it
would not act."""
OVERLAP_LEFT = 1e-6
"""Overlap of shapes that is not corrected [m], so that what rests stays in contact."""
GROOVE_SIZES = 100.0
"""Half length of the groove of a slide, in sizes of the mechanism."""


class PlainSpace(host.PlanarBodies):
    """A mechanism in a space of Chipmunk; `bodies` are those of the links."""

    def __init__(self, mechanism, settings):
        super().__init__(mechanism)
        self.space, defaults = pymunk.Space(), settings["defaults"]
        self.bodies, self.stops = [self.space.static_body], {}
        self.space.gravity = self.flat(mechanism.gravity)
        self.space.iterations = CHIPMUNK_ITERATIONS if defaults else settings["iterations"]
        for k, start in enumerate(zip(*host.start_of_links(mechanism))):
            if k:
                self.add_link(k, *start)
        held = [j for j in range(len(mechanism.joints)) if j not in host.free_rows(mechanism)]
        made = [one for j in held for one in self.joint_constraints(j)]
        made += [self.pivot(one.a, one.b, one.on_a, one.on_b) for one in mechanism.loops]
        made += [self.gear(one) for one in mechanism.gears]
        self.drives = [self.driver(one.joint) for one in mechanism.drives]
        for one in self.drives if defaults else [*made, *self.drives]:
            one.error_bias = 0.0
        rubbing = [j for j in mechanism.singles if mechanism.friction_of(j)]
        self.space.add(*made, *self.drives, *map(self.friction, rubbing))
        self.add_contacts(defaults)

    def add_link(self, k, place, turn, velocity):
        """Add the body of a link, a step before its start."""
        link, normal, h = self.mechanism.links[k], self.mechanism.plane[2], self.mechanism.step
        moment = float(normal @ host.inertia_with_armature(self.mechanism, k) @ normal)
        body = pymunk.Body(link.mass, moment)
        body.position = self.flat(place - h * velocity)
        body.angle = float((turn - h * link.omega) @ normal)
        body.velocity, body.angular_velocity = self.flat(velocity), float(link.omega @ normal)
        self.space.add(body)
        self.bodies.append(body)

    def pivot(self, a, b, on_a, on_b):
        """Join points of two links."""
        ends = self.local(a, on_a), self.local(b, on_b)
        return pymunk.PivotJoint(self.bodies[a], self.bodies[b], *ends)

    def pair(self, j):
        """The bodies of the parent and the child of a joint."""
        joint = self.mechanism.joints[j]
        return self.bodies[joint.parent], self.bodies[joint.child]

    def groove(self, j, along=True):
        """The groove of a slide in its parent, or one across it."""
        joint, links, size = self.mechanism.joints[j], self.mechanism.links, self.mechanism.size
        centre = links[joint.child].centre
        foot = links[joint.parent].centre if joint.parent else centre
        foot = foot + joint.axis * (joint.axis @ (centre - foot))
        across = size * np.cross(self.mechanism.plane[2], joint.axis)
        way = GROOVE_SIZES * size * joint.axis if along else across
        ends = [self.local(joint.parent, at) for at in (foot - way, foot + way)]
        return pymunk.GrooveJoint(*self.pair(j), *ends, self.local(joint.child, foot))

    def joint_constraints(self, j):
        """The constraints of a joint."""
        joint = self.mechanism.joints[j]
        if joint.kind == "hinge":
            made = [self.pivot(joint.parent, joint.child, joint.anchor, joint.anchor)]
        else:
            made = [pymunk.GearJoint(*self.pair(j), 0.0, 1.0), self.groove(j)]
        if joint.limits:
            self.stops[j] = self.stop(j)
            made.append(self.stops[j])
        return made

    def stop(self, j):
        """The stops of a joint at the ends of its range, a margin before them."""
        joint, size = self.mechanism.joints[j], GROOVE_SIZES * self.mechanism.size
        low, high = joint.ends + STOP_LEAD * np.array([1.0, -1.0])
        if joint.kind == "hinge":
            ends = sorted((self.mechanism.turn_of(j) * low, self.mechanism.turn_of(j) * high))
            return pymunk.RotaryLimitJoint(*self.pair(j), *ends)
        far = self.local(joint.parent, joint.anchor - size * joint.axis)
        near = self.local(joint.child, joint.anchor)
        return pymunk.SlideJoint(*self.pair(j), far, near, size + low, size + high)

    def gear(self, gear):
        """Couple two hinges, if that is a coupling of two links."""
        a, b, ratio = host.coupled_links(self.mechanism, gear)
        return pymunk.GearJoint(self.bodies[a], self.bodies[b], 0.0, ratio)

    def driver(self, j):
        """The constraint of a drive, with its target at the start."""
        if self.mechanism.joints[j].kind == "hinge":
            return pymunk.GearJoint(*self.pair(j), 0.0, 1.0)
        made = self.groove(j, along=False)
        made.start = made.groove_a, made.groove_b
        return made

    def add_contacts(self, defaults):
        """Add the sections of shapes, and a handler that gives each pair its law."""
        (sections, laws), numbers, space = host.planar_contacts(self.mechanism), {}, self.space
        for k, one in sections.items():
            body, points = self.bodies[one.link], one.points.tolist()
            if len(points) > 2:
                shape = pymunk.Poly(body, points)
            elif len(points) == 2:
                shape = pymunk.Segment(body, *points, one.radius)
            else:
                shape = pymunk.Circle(body, one.radius, *points)
            numbers[shape] = k
            space.add(shape)

        def meet(arbiter, *_):
            law = laws.get(tuple(sorted(numbers[one] for one in arbiter.shapes)))
            if law:
                arbiter.friction, arbiter.restitution = law.friction, law.restitution
            arbiter.process_collision = law is not None  # from pymunk 7 on
            return law is not None

        if not defaults:
            space.collision_slop = OVERLAP_LEFT
        if hasattr(space, "on_collision"):
            space.on_collision(pre_solve=meet)
        else:
            space.add_default_collision_handler().pre_solve = meet

    def friction(self, j):
        """The dry friction of a joint, which corrects no deviation."""
        joint = self.mechanism.joints[j]
        hinge = joint.kind == "hinge"
        made = pymunk.SimpleMotor(*self.pair(j), 0.0) if hinge else self.groove(j, along=False)
        made.max_force, made.error_bias = joint.friction, 1.0
        return made

    def step(self, i):
        """Step number i, with the targets of drives and the forces on links."""
        for made, drive in zip(self.drives, self.mechanism.drives):
            joint = self.mechanism.joints[drive.joint]
            value = drive.value[2 * (i + 1)] - joint.value
            if joint.kind == "hinge":
                made.phase = float(self.mechanism.turn_of(drive.joint) * value)
            else:
                way = self.flat(value * joint.axis)
                made.groove_a, made.groove_b = (end + way for end in made.start)
        for j, made in self.stops.items():
            value, (low, high) = self.joint(j)[0], self.mechanism.joints[j].ends
            beyond = max(low - value, value - high)
            made.max_bias = max(beyond, NO_CORRECTION) / self.mechanism.step
        normal = self.mechanism.plane[2]
        for k, place, force, moment in host.link_forces(self.mechanism, i, self.read, self.joint):
            arm = place - self.read(k)[0]
            self.bodies[k].force += self.flat(force)
            self.bodies[k].torque += float((moment + np.cross(arm, force)) @ normal)
        self.space.step(self.mechanism.step)

    def read(self, k):
        """The motion of a link, with the place to which its velocity is going to lead it."""
        body, h = self.bodies[k], self.mechanism.step
        rates = np.array([*body.velocity, body.angular_velocity])
        *place, angle = np.array([*body.position, body.angle]) + h * rates
        return host.in_space(self.mechanism, k, place, angle, rates)

    def joint(self, j):
        """Coordinate and rate of a hinge or slide, at the places of `read`."""
        if self.mechanism.joints[j].kind == "slide":
            return host.slide_motion(self.mechanism, j, self.read)
        a, b = self.pair(j)
        rate = b.angular_velocity - a.angular_velocity
        value = b.angle - a.angle + self.mechanism.step * rate
        return self.mechanism.turn_of(j) * value, self.mechanism.turn_of(j) * rate


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Step the space through the run."""
    host.refuse_rows(mechanism, host.free_rows(mechanism))
    space = PlainSpace(mechanism, settings)
    return host.record(mechanism, space.step, space.read)
