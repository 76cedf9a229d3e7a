"""Drake: a tree in reduced coordinates, in discrete steps with the SAP solver, or continuous.

Loops, gears and balls are constraints of SAP; those with the world itself end Drake 1.46 and later
with signal 11, so that the ground is a body welded to it.  A drive is a heavy rotor, which gets in
each step the torque with which it reaches its next value.  Springs with a slack range and loads are
applied by hand, and so are motors and the higher powers of springs.
"""

from dataclasses import replace
from importlib.metadata import version

import numpy as np
import proofmass_host as host
from pydrake.math import RigidTransform
from pydrake.multibody import plant as plants
from pydrake.multibody import tree
from pydrake.multibody.math import SpatialForce
from pydrake.systems.analysis import Simulator

VERSIONS = {"drake": version("drake"), "numpy": np.__version__}
SAP, BOX = plants.DiscreteContactApproximation.kSap, tree.SpatialInertia.SolidBoxWithMass
ROTOR_SHARE = 1e7  # of a drive: inertia in masses of the mechanism times its squared size
ACCURACY = 1e-9  # of the integrator in continuous time
CLOSING_SHARE = 0.5  # of the opening of a loop that a step of SAP closes: it relaxes in one more
SINGLE = {"hinge": tree.RevoluteJoint, "slide": tree.PrismaticJoint}
FLOATING, BALL = tree.QuaternionFloatingJoint, tree.BallRpyJoint


class DrakeRun:
    """A mechanism in Drake, in the course of a run."""

    def __init__(self, mechanism, settings):
        self.mechanism, self.exact = mechanism, settings["scheme"] == "continuous"
        if self.exact and mechanism.rest:
            raise host.Refused("a rest in continuous time")
        slack = tuple(one for one in mechanism.springs if not 0 < one.slack[0] == one.slack[1])
        self.by_hand, self.rows, self.number = replace(mechanism, springs=slack), [], 0
        if self.exact and (mechanism.loops or mechanism.gears or slack):
            raise host.Refused("loops, gears and springs with a slack range in continuous time")
        self.plant = plants.MultibodyPlant(0.0 if self.exact else mechanism.step)
        if not (settings["defaults"] or self.exact):
            self.plant.set_discrete_contact_approximation(SAP)
        self.plant.mutable_gravity_field().set_gravity_vector(mechanism.gravity)
        self.bodies = [self.plant.AddRigidBody("ground", BOX(1.0, 1.0, 1.0, 1.0))]
        self.plant.WeldFrames(self.plant.world_frame(), self.bodies[0].body_frame())
        self.bodies += [self.add_body(one) for one in mechanism.links[1:]]
        self.joints, numbers = [], range(len(mechanism.joints))
        for j in numbers:
            self.joints.append(self.add_joint(j))
        self.rotors = [self.add_rotor(j) for j in numbers]
        self.connect()
        self.plant.Finalize()
        self.drives = [mechanism.drive_of(j) for j in numbers]
        self.single = [j for j in numbers if mechanism.joints[j].kind in SINGLE]
        self.simulator = Simulator(self.plant)
        self.context = self.simulator.get_mutable_context()
        self.start()
        if self.exact:
            self.simulator.get_mutable_integrator().set_target_accuracy(ACCURACY)
        self.simulator.Initialize()

    def add_body(self, link):
        """Add a link, whose frame has its origin at the centre."""
        if not link.mass:
            raise host.Refused(f"link {link.name!r} without mass")
        i = link.inertia / link.mass
        unit = tree.UnitInertia(i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
        inertia = tree.SpatialInertia(link.mass, np.zeros(3), unit, skip_validity_check=True)
        return self.plant.AddRigidBody(f"link {self.plant.num_bodies()}", inertia)

    def add_joint(self, j):
        """Add a joint with its spring; between several joints of a link are bodies without mass."""
        one, links, plant = self.mechanism.joints[j], self.mechanism.links, self.plant
        own, centre = self.mechanism.joints_of(one.child), links[one.child].centre
        base, origin = self.bodies[one.parent], links[one.parent].centre
        child, at, kind = self.bodies[one.child], one.anchor, SINGLE.get(one.kind, FLOATING)
        if kind is FLOATING and (one.damping or len(own) > 1):
            raise host.Refused(f"{one.kind} joint {one.name!r} with damping or with another joint")
        if j != own[0]:
            base, origin = self.joints[j - 1].child_body(), centre
        if j != own[-1]:
            child = plant.AddRigidBody(f"between {j}", tree.SpatialInertia.Zero())
        if one.kind == "ball" and self.exact:
            kind = BALL
        elif one.kind == "ball":
            plant.AddBallConstraint(base, at - origin, child, at - centre)
        if kind is FLOATING:
            base, origin, at = self.bodies[0], np.zeros(3), centre
        near = tree.FixedOffsetFrame(f"near {j}", base.body_frame(), RigidTransform(at - origin))
        far = tree.FixedOffsetFrame(f"far {j}", child.body_frame(), RigidTransform(at - centre))
        frames, axis = [plant.AddFrame(frame) for frame in (near, far)], [one.axis]
        joint = plant.AddJoint(kind(f"joint {j}", *frames, *axis[: one.kind in SINGLE]))
        if one.limits:
            if self.exact:
                raise host.Refused(f"range of joint {one.name!r} in continuous time")
            joint.set_position_limits(*([end - one.value] for end in one.limits))
        joint.set_default_damping_vector(np.full(joint.num_velocities(), one.damping))
        spring = tree.RevoluteSpring if one.kind == "hinge" else tree.PrismaticSpring
        if one.acting[0]:
            plant.AddForceElement(spring(joint, one.rest - one.value, one.acting[0]))
        return joint

    def add_rotor(self, j):
        """Add the armature of a joint, or the rotor of its drive, and return its inertia."""
        one, inertia = self.mechanism.joints[j], self.mechanism.joints[j].armature
        if self.mechanism.drive_of(j):
            length = self.mechanism.size if one.kind == "hinge" else 1.0
            inertia = ROTOR_SHARE * sum(link.mass for link in self.mechanism.links) * length**2
        if inertia:
            rotor = self.plant.AddJointActuator(f"rotor {j}", self.joints[j])
            rotor.set_default_rotor_inertia(inertia)
        return inertia

    def connect(self):
        """Add loops, gears, and springs of Drake between points."""
        loops, centres = self.mechanism.loops, [one.centre for one in self.mechanism.links]
        for one in (*loops, *self.mechanism.springs):
            ends = self.bodies[one.a], one.on_a - centres[one.a]
            ends = *ends, self.bodies[one.b], one.on_b - centres[one.b]
            if isinstance(one, host.NeutralLoop):
                self.plant.AddBallConstraint(*ends)
            elif 0 < one.slack[0] == one.slack[1]:
                spring = tree.LinearSpringDamper(*ends, one.slack[0], one.stiffness, one.damping)
                self.plant.AddForceElement(spring)
        for one in self.mechanism.gears:
            self.plant.AddCouplerConstraint(self.joints[one.one], self.joints[one.two], one.ratio)

    def start(self):
        """Set coordinates and rates of the start; all coordinates are 0 if the loops are closed."""
        plant, links = self.plant, self.mechanism.links
        values, rates = np.zeros(plant.num_positions()), np.zeros(plant.num_velocities())
        openings = host.start_openings(self.mechanism, CLOSING_SHARE)
        for one, joint, (turn, way) in zip(self.mechanism.joints, self.joints, openings):
            link, q, v = links[one.child], joint.position_start(), joint.velocity_start()
            if isinstance(joint, FLOATING):
                way = way if one.kind == "free" else np.cross(turn, link.centre - one.anchor)
                values[q : q + 7] = 1.0, *0.5 * turn, *way
                rates[v : v + 6] = *link.omega, *host.start_velocity(self.mechanism, one.child)
            elif one.kind == "ball":
                rates[v : v + 3] = link.omega - links[one.parent].omega
            else:
                values[q], rates[v] = (turn + way) @ one.axis, one.rate
        plant.SetPositions(self.context, values)
        plant.SetVelocities(self.context, rates)

    def joint(self, j):
        """Coordinate and rate of a hinge or slide."""
        joint = self.joints[j]
        return joint.GetOnePosition(self.context), joint.GetOneVelocity(self.context)

    def apply(self, i, now=False):
        """Apply the forces of step number i, or those of the instant `now` at its beginning."""
        step, forces = self.mechanism.step, np.zeros(self.plant.num_velocities())
        for j in self.single:
            one, drive, (value, rate) = self.mechanism.joints[j], self.drives[j], self.joint(j)
            middle = value + (0.5 * step * rate if self.exact and not now else 0.0)
            x = one.value + middle - one.rest
            force = one.force_in(i) - x**2 * (one.spring[1] + x * one.spring[2])
            if drive:
                wanted = (drive.value[2 * i + 2] - one.value - value) / step
                wanted = drive.rate[2 * i + 2] if self.exact else wanted
                change = drive.acceleration[2 * i] if now else (wanted - rate) / step
                force = self.rotors[j] * change
            forces[self.joints[j].velocity_start()] = force
        pushes = [self.push(*one) for one in host.link_forces(self.by_hand, i, self.read)]
        self.plant.get_applied_generalized_force_input_port().FixValue(self.context, forces)
        self.plant.get_applied_spatial_force_input_port().FixValue(self.context, pushes)

    def push(self, k, place, force, moment):
        """A force at a place in the world and a moment on a link in Drake's words."""
        push, body = plants.ExternallyAppliedSpatialForce(), self.bodies[k]
        at = body.EvalPoseInWorld(self.context).inverse().multiply(place)
        push.body_index, push.p_BoBq_B = body.index(), at
        push.F_Bq_W = SpatialForce(moment, force)
        return push

    def step(self, i):
        """Make step number i."""
        self.apply(i)
        self.number += 1
        self.simulator.AdvanceTo(self.number * self.mechanism.step)

    def read(self, k):
        """The motion of a link."""
        body, pose = self.bodies[k], self.bodies[k].EvalPoseInWorld(self.context)
        rates = [body.EvalSpatialVelocityInWorld(self.context)]
        if self.exact:
            rates.append(body.EvalSpatialAccelerationInWorld(self.context))
        parts = [part for one in rates for part in (one.translational(), one.rotational())]
        return (pose.translation(), pose.rotation().matrix(), *parts)

    def read_at_sample(self, k):
        """The same in continuous time, with the forces of the instant, before that of all links."""
        if k == 1:
            self.apply(self.number, now=True)
            changes = self.plant.get_generalized_acceleration_output_port().Eval(self.context)
            row = [(*self.joint(j), changes[self.joints[j].velocity_start()]) for j in self.single]
            self.rows.append(np.array(row).reshape(-1, 3).T)
        return self.read(k)


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Step through the run, and read the links and the joints."""
    run = DrakeRun(mechanism, settings)
    if not run.exact:
        return host.record(mechanism, run.step, run.read, run.joint)
    states = host.record(mechanism, run.step, run.read_at_sample)
    n = len(states.place)
    states.coordinates = np.full((3, n, len(mechanism.joints)), np.nan)
    states.coordinates[:, :, run.single] = np.array(run.rows[:n]).swapaxes(0, 1)
    states.coordinates[0] += [one.value for one in mechanism.joints]
    return states
