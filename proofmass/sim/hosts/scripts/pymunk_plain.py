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

VERSIONS = {"pymunk": pymunk.version, "numpy": np.__version__, "chipmunk": pymunk.chipmunk_version}
CHIPMUNK_ITERATIONS = 10
STOP_LEADS = np.array([1e-12, -1e-12])
"""Distances of stops before the ends of the range [rad or m].  A stop of Chipmunk acts only on a
joint beyond it, so that a joint is put back to this distance beyond its stop."""
NO_CORRECTION = 1e-30
"""Way by which a stop puts a joint back that is on it [rad or m]; with 0 it would not act."""
OVERLAP_LEFT = 1e-6
"""Overlap of shapes that is not corrected [m], so that what rests stays in contact."""
GROOVE_SIZES = 100.0
"""Half length of the groove of a slide, in sizes of the mechanism."""


class PlainSpace(host.PlanarBodies):
    """A mechanism in a space of Chipmunk."""

    def __init__(self, mechanism, settings):
        super().__init__(mechanism, ahead=mechanism.step)
        self.space, defaults = pymunk.Space(), settings["defaults"]
        self.space.gravity = self.flat(mechanism.gravity)
        self.space.iterations = CHIPMUNK_ITERATIONS if defaults else settings["iterations"]
        self.bodies, self.stops = [self.space.static_body], {}
        for k, start in enumerate(host.start_of_links(mechanism)[1:], 1):
            self.add_link(k, *start)
        made = [one for j in self.held for one in self.joint_constraints(j)]
        made += [pymunk.PivotJoint(*self.joined(one)) for one in mechanism.loops]
        for one in mechanism.gears:
            a, b, ratio = host.coupled_links(mechanism, one)
            made.append(pymunk.GearJoint(self.bodies[a], self.bodies[b], 0.0, ratio))
        self.drives = [self.holder(mechanism.joints[one.joint]) for one in mechanism.drives]
        for one in self.drives if defaults else [*made, *self.drives]:
            one.error_bias = 0.0
        self.space.add(*made, *self.drives)
        for joint in (mechanism.joints[j] for j in mechanism.singles if mechanism.friction_of(j)):
            rubs = self.holder(joint)
            rubs.max_force, rubs.error_bias = joint.friction, 1.0  # it corrects no deviation
            self.space.add(rubs)
        self.add_contacts(defaults)

    def add_link(self, k, place, turn, velocity):
        """Add the body of a link, a step before its start."""
        link, normal, h = self.mechanism.links[k], self.mechanism.plane[2], self.mechanism.step
        body = pymunk.Body(link.mass, host.moment_in_plane(self.mechanism, k))
        body.position = self.flat(place - h * velocity)
        body.angle = float((turn - h * link.omega) @ normal)
        body.velocity, body.angular_velocity = self.flat(velocity), float(link.omega @ normal)
        self.space.add(body)
        self.bodies.append(body)

    def groove(self, joint, along=True):
        """The groove of a slide in its parent, or one across it."""
        links, size = self.mechanism.links, self.mechanism.size
        base, centre = (links[k].centre for k in (joint.parent, joint.child))
        foot = base + joint.axis * (joint.axis @ (centre - base)) if joint.parent else centre
        across = size * np.cross(self.mechanism.plane[2], joint.axis)
        way = GROOVE_SIZES * size * joint.axis if along else across
        ends = [self.local(joint.parent, at) for at in (foot - way, foot + way)]
        return pymunk.GrooveJoint(*self.pair(joint), *ends, self.local(joint.child, foot))

    def joint_constraints(self, j):
        """The constraints of a joint."""
        joint = self.mechanism.joints[j]
        if joint.kind == "hinge":
            made = [pymunk.PivotJoint(*self.joined(joint))]
        else:
            made = [pymunk.GearJoint(*self.pair(joint), 0.0, 1.0), self.groove(joint)]
        if joint.limits:
            self.stops[j] = self.stop(joint, self.sense(j))
            made.append(self.stops[j])
        return made

    def stop(self, joint, sense):
        """The stops of a joint at the ends of its range, a margin before them."""
        size, ends = GROOVE_SIZES * self.mechanism.size, joint.ends + STOP_LEADS
        if joint.kind == "hinge":
            return pymunk.RotaryLimitJoint(*self.pair(joint), *sorted(sense * ends))
        far = self.local(joint.parent, joint.anchor - size * joint.axis)
        near = self.local(joint.child, joint.anchor)
        return pymunk.SlideJoint(*self.pair(joint), far, near, *(size + ends))

    def holder(self, joint):
        """What holds a joint at a target, in a drive, or where it is, by dry friction."""
        if joint.kind == "hinge":
            return pymunk.GearJoint(*self.pair(joint), 0.0, 1.0)
        made = self.groove(joint, along=False)
        made.start = made.groove_a, made.groove_b
        return made

    def add_contacts(self, defaults):
        """Add the sections of shapes, and a handler that gives each pair its law."""
        (sections, laws), numbers, space = host.planar_contacts(self.mechanism), {}, self.space
        for k, one in sections.items():
            body, points = self.bodies[one.link], one.points.tolist()
            if len(points) == 1:
                shape = pymunk.Circle(body, one.radius, *points)
            elif len(points) == 2:
                shape = pymunk.Segment(body, *points, one.radius)
            else:
                shape = pymunk.Poly(body, points)
            numbers[shape] = k
            space.add(shape)

        def meet(arbiter, *_):
            law = laws.get(tuple(numbers[one] for one in arbiter.shapes))
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

    def step(self, i):
        """Step number i, with the targets of drives and the forces on links."""
        for made, drive in zip(self.drives, self.mechanism.drives):
            joint = self.mechanism.joints[drive.joint]
            value = drive.value[2 * (i + 1)] - joint.value
            if joint.kind == "hinge":
                made.phase = float(self.sense(drive.joint) * value)
            else:
                way = self.flat(value * joint.axis)
                made.groove_a, made.groove_b = (end + way for end in made.start)
        for j, made in self.stops.items():
            beyond = self.mechanism.joints[j].way_beyond_stop(self.joint(j)[0])
            made.max_bias = max(beyond, NO_CORRECTION) / self.mechanism.step
        for k, force, moment in host.pushes_on_links(self.mechanism, i, self.read, self.joint):
            self.bodies[k].force += self.flat(force)
            self.bodies[k].torque += float(moment @ self.mechanism.plane[2])
        self.space.step(self.mechanism.step)

    def pose(self, k):
        """Place, rotation and rates of a link in Chipmunk."""
        body = self.bodies[k]
        return [*body.position, body.angle], [*body.velocity, body.angular_velocity]


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Step the space through the run."""
    space = PlainSpace(mechanism, settings)
    return host.record(mechanism, space.step, space.read)
