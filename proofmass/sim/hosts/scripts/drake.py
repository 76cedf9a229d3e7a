"""Drake: a tree in reduced coordinates, in discrete steps with the SAP solver, or continuous.

Loops, gears and balls are constraints of SAP, with a body that is welded to the world: those with
the world itself end Drake 1.46 and later with signal 11.  A drive is a heavy rotor with the torque
for its next value, and dry friction a motor at rest with a limit.  Contacts are those of balls and
half spaces by the approximation kLagged: with kSap what slides lifts off.  Slack springs, loads,
motors and powers of springs are constant in a step.
"""

from importlib.metadata import version

import numpy as np
import proofmass_host as host
from pydrake import geometry
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody import plant, tree
from pydrake.multibody.math import SpatialForce
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

VERSIONS = {"drake": version("drake"), "numpy": np.__version__}
ROTOR_SHARE = 1e7  # of a drive: inertia in masses of the mechanism times its squared size
ACCURACY = 1e-9  # of the integrator in continuous time
CLOSING_SHARE = 0.5  # of the opening of a loop that a step of SAP closes: it relaxes in one more
LEAST_GAIN, FRICTION_GAIN = 1e-6, 1e9  # of the motors at rest with a limit that are dry friction
GIVES_WAY = 1e-6  # of its size: by how much a contact gives way to the weight of the mechanism
DISSIPATION = 1e3  # of contacts: what hits with more than 1 mm/s parts with less than that [s/m]
SINGLE = {"hinge": tree.RevoluteJoint, "slide": tree.PrismaticJoint}
SPRINGS = {"hinge": tree.RevoluteSpring, "slide": tree.PrismaticSpring}
FLOATING, BALL = tree.QuaternionFloatingJoint, tree.BallRpyJoint


class DrakeRun:
    """A mechanism in Drake, in the course of a run; its `tree` has one joint on each link."""

    def __init__(self, mechanism, settings):
        self.mechanism, self.exact, self.number = mechanism, settings["scheme"] == "continuous", 0
        if self.exact:
            host.refuse_other_than_free_trees(mechanism)
        self.tree, self.by_hand = host.one_joint_each(mechanism), host.beside_linear(mechanism)
        builder, step = DiagramBuilder(), 0.0 if self.exact else mechanism.step
        self.plant, self.scene = plant.AddMultibodyPlantSceneGraph(builder, step)
        if not (settings["defaults"] or self.exact):
            rules = plant.DiscreteContactApproximation
            rule = rules.kLagged if mechanism.contacts else rules.kSap
            self.plant.set_discrete_contact_approximation(rule)
        self.plant.mutable_gravity_field().set_gravity_vector(mechanism.gravity)
        self.armatures = host.armatures_with_rotors(mechanism, ROTOR_SHARE)
        self.bodies = [self.add_body(k, one) for k, one in enumerate(self.tree.links)]
        self.plant.WeldFrames(self.plant.world_frame(), self.bodies[0].body_frame())
        self.joints = [self.add_joint(j, one) for j, one in enumerate(self.tree.joints)]
        self.connect()
        if mechanism.contacts:
            self.add_contacts(settings["defaults"])
        self.plant.Finalize()
        self.simulator = Simulator(builder.Build())
        self.context = self.plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        self.start()
        if self.exact:
            self.simulator.get_mutable_integrator().set_target_accuracy(ACCURACY)
            self.apply(0)

    def add_body(self, k, link):
        """Add a link, whose frame has its origin at the centre; between joints it has no mass."""
        inertia = tree.SpatialInertia.Zero()
        if link.mass:
            unit = tree.UnitInertia(*link.six_moments / link.mass)
            inertia = tree.SpatialInertia(link.mass, np.zeros(3), unit, skip_validity_check=True)
        return self.plant.AddRigidBody(f"link {k}", inertia)

    def end(self, k, at):
        """The body of a link and a point of it, given at the start."""
        return self.bodies[k], self.tree.arm(k, at)

    def add_joint(self, j, one):
        """Add a joint with its spring; a ball in discrete time is a free body with a constraint."""
        kind = BALL if one.kind == "ball" and self.exact else SINGLE.get(one.kind, FLOATING)
        ends = self.end(one.parent, one.anchor), self.end(one.child, one.anchor)
        if kind is FLOATING:
            if one.damping or one is not self.mechanism.joints[j]:
                raise host.Refused(f"damping or another joint at {one.kind} joint {one.name!r}")
            ends = self.end(0, self.tree.links[one.child].centre), (ends[1][0], np.zeros(3))
        frames = (tree.FixedOffsetFrame(f"{j} {b.name()}", b, RigidTransform(at)) for b, at in ends)
        axis = [one.axis] if one.kind in SINGLE else []
        joint = self.plant.AddJoint(kind(f"joint {j}", *map(self.plant.AddFrame, frames), *axis))
        if one.limits:
            joint.set_position_limits(*one.ends[:, None])
        joint.set_default_damping_vector(np.full(joint.num_velocities(), one.damping))
        if one.acting[0]:
            spring = SPRINGS[one.kind](joint, one.rest - one.value, one.acting[0])
            self.plant.AddForceElement(spring)
        if one.kind in SINGLE:
            friction = self.mechanism.friction_of(j)
            rotor = self.plant.AddJointActuator(f"rotor {j}", joint, friction or np.inf)
            rotor.set_default_rotor_inertia(self.armatures[j])
            if friction:
                rotor.set_controller_gains(tree.PdControllerGains(p=LEAST_GAIN, d=FRICTION_GAIN))
        return joint

    def connect(self):
        """Add loops, balls, gears, and springs of Drake between points."""
        for (a, on_a), (b, on_b) in [] if self.exact else host.joined_points(self.mechanism):
            self.plant.AddBallConstraint(*self.end(a, on_a), *self.end(b, on_b))
        for one in self.mechanism.springs:
            if one.free_length:
                ends = [part for k, at in one.points for part in self.end(k, at)]
                law = one.free_length, one.stiffness, one.damping
                self.plant.AddForceElement(tree.LinearSpringDamper(*ends, *law))
        for one in self.mechanism.gears:
            self.plant.AddCouplerConstraint(self.joints[one.one], self.joints[one.two], one.ratio)

    def add_contacts(self, defaults):
        """Add half spaces and balls, which touch in one point each, with the friction of pairs."""
        mechanism, filters, parts = self.mechanism, self.scene.collision_filter_manager(), {}
        self.plant.set_adjacent_bodies_collision_filters(False)
        surfaces = host.contact_surfaces(mechanism, host.split_by_harmonic_mean, dict)
        weight = sum(one.mass for one in mechanism.links) * np.linalg.norm(mechanism.gravity)
        stiffness = max(weight, 1.0) / (GIVES_WAY * mechanism.size)
        own = {} if defaults else {"dissipation": DISSIPATION, "point_stiffness": stiffness}
        for n, (k, at, radius) in enumerate(host.contact_parts(mechanism)):
            given, one = geometry.ProximityProperties(), mechanism.shapes[k]
            friction = plant.CoulombFriction(*[surfaces.frictions[host.surface_of(one)]] * 2)
            geometry.AddContactMaterial(properties=given, friction=friction, **own)
            part = geometry.Sphere(radius) if radius else geometry.HalfSpace()
            body, arm = self.end(one.link, at)
            place = RigidTransform(RotationMatrix(one.axes), arm)
            made = self.plant.RegisterCollisionGeometry(body, place, part, f"part {n}", given)
            parts[made] = k
        for one, k in parts.items():
            others = [b for b, j in parts.items() if (j, k) not in mechanism.laws]
            ends = geometry.GeometrySet(one), geometry.GeometrySet(others)
            filters.Apply(geometry.CollisionFilterDeclaration().ExcludeBetween(*ends))
        self.impacts = host.Impacts(mechanism, parts)

    def start(self):
        """Set coordinates and rates of the start; all coordinates are 0 if the loops are closed."""
        values, rates = np.zeros(self.plant.num_positions()), np.zeros(self.plant.num_velocities())
        openings = host.start_openings(self.mechanism, CLOSING_SHARE)
        for j, (joint, (turn, way)) in enumerate(zip(self.joints, openings)):
            one, q, v = self.mechanism.joints[j], joint.position_start(), joint.velocity_start()
            if isinstance(joint, FLOATING):
                link, pivot = self.mechanism.links[one.child], host.pivot_of(self.mechanism, j)
                values[q : q + 7] = 1.0, *0.5 * turn, *way + np.cross(turn, link.centre - pivot)
                rates[v : v + 6] = *link.omega, *host.start_velocity(self.mechanism, one.child)
                continue
            rates[v : v + joint.num_velocities()] = self.mechanism.start_rates(j)
            if one.is_single:
                values[q] = (turn + way) @ one.axis
        self.plant.SetPositions(self.context, values)
        self.plant.SetVelocities(self.context, rates)

    def joint(self, j):
        """Coordinate and rate of a hinge or slide, in continuous time its acceleration too."""
        joint, found = self.joints[j], self.plant.get_generalized_acceleration_output_port()
        known = joint.GetOnePosition(self.context), joint.GetOneVelocity(self.context)
        return (*known, found.Eval(self.context)[joint.velocity_start()]) if self.exact else known

    def apply(self, i):
        """Apply the forces of step number i that are not Drake's own, at its beginning."""
        forces, pushes = np.zeros(self.plant.num_velocities()), []
        places = [one.velocity_start() for one in self.joints]
        for j, force in host.joint_forces(self.by_hand, i, self.joint):
            forces[places[j]] = force
        for j, rate in host.drive_rates(self.mechanism, i, self.joint):
            forces[places[j]] = self.armatures[j] * (rate - self.joint(j)[1]) / self.mechanism.step
        for k, place, force, moment in host.link_forces(self.by_hand, i, self.read):
            push, body = plant.ExternallyAppliedSpatialForce(), self.bodies[k]
            push.body_index, push.F_Bq_W = body.index(), SpatialForce(moment, force)
            push.p_BoBq_B = body.EvalPoseInWorld(self.context).inverse().multiply(place)
            pushes.append(push)
        self.plant.get_applied_generalized_force_input_port().FixValue(self.context, forces)
        if any(map(self.mechanism.friction_of, self.mechanism.singles)):
            now = [self.joint(j)[0] for j in self.mechanism.singles]
            port = self.plant.get_desired_state_input_port(self.bodies[0].model_instance())
            port.FixValue(self.context, np.concatenate([now, np.zeros(len(now))]))
        self.plant.get_applied_spatial_force_input_port().FixValue(self.context, pushes)

    def step(self, i):
        """Make step number i."""
        self.apply(i)
        if self.mechanism.contacts:
            query = self.plant.get_geometry_query_input_port().Eval(self.context)
            pairs = query.ComputePointPairPenetration()
            touches = [((a.id_A, a.id_B), (a.p_WCa, a.p_WCb), a.nhat_BA_W) for a in pairs]
            self.impacts.refuse_bounces(self.read, touches)
        self.number += 1  # at rest a step is repeated
        self.simulator.AdvanceTo(self.number * self.mechanism.step)

    def read(self, k):
        """The motion of a link, in continuous time with its accelerations."""
        body, pose = self.bodies[k], self.bodies[k].EvalPoseInWorld(self.context)
        rates = [body.EvalSpatialVelocityInWorld(self.context)]
        if self.exact:
            rates.append(body.EvalSpatialAccelerationInWorld(self.context))
        parts = [part for one in rates for part in (one.translational(), one.rotational())]
        return (pose.translation(), pose.rotation().matrix(), *parts)


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Step through the run, and read the links and the joints."""
    if mechanism.rest:
        host.refuse_friction(mechanism, "in a sweep: a motor with a limit creeps while it holds")
    run = DrakeRun(mechanism, settings)
    return host.record(mechanism, run.step, run.read, run.joint)
