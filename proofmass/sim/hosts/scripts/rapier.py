"""Rapier by rapier3d: bodies in space, in single precision, with joints as impulses.

Hinges, slides, balls and loops are Rapier's impulse joints, and drives its motors, with a limit for
dry friction.  A step is one substep without the relaxation behind it, so that velocities are those
that move the bodies.  Springs, dampers and loads are applied by hand; in the half-step reading the
rate in a damper is half a step old, and dampers are of first order in the step.

Openings of 6e-8 m by rounding are closed in a step: rates have an error of 6e-8 m divided by the
step, and accelerations one of the same divided by the step once more.
"""

import numpy as np
import proofmass_host as host
import rapier3d as rapier

VERSIONS = {"rapier3d": rapier.__version__, "numpy": np.__version__}
MOTOR_FACTOR = 1e9
"""Damping of the motor of a drive [N m s/rad or N s/m], beside which no load changes its rate."""
LEAST_INERTIA = 1e-13
"""Least inertia of a link in masses times squared arms of its joints: Rapier swings a rod of 1 kg
and 1 m with 1e-12, and lets go of it with 1e-14."""
LARGEST_RATIO = 1e6
"""Largest ratio of the inertias that a joint in space binds: with 2e5 the default iterations leave
1 % of a Hooke's joint open, with 2e7 all of it."""
BUILDERS = {"hinge": rapier.RevoluteJointBuilder, "slide": rapier.PrismaticJointBuilder}
COLLIDERS = {
    "plane": lambda *_: rapier.Collider.halfspace((0.0, 0.0, 1.0)),
    "sphere": lambda radius, *_: rapier.Collider.ball(radius),
    "box": rapier.Collider.cuboid,
    "capsule": lambda radius, half, _: rapier.Collider.capsule_z(half, radius),
    "cylinder": lambda radius, half, _: rapier.Collider.cylinder(half, radius),
}
RIGID_RATIO = 1e5
"""Damping ratio of contacts, with which they give way by no speed but close an overlap slowly."""
AXES = {"hinge": rapier.JointAxis.ANG_X, "slide": rapier.JointAxis.LIN_X}


class RapierWorld:
    """A mechanism in a world of Rapier: handles of the `bodies` of links and of `joints`."""

    def __init__(self, mechanism, settings):
        self.mechanism, self.defaults = mechanism, settings["defaults"]
        self.world = rapier.PhysicsWorld(gravity=tuple(mechanism.gravity))
        self.world.set_num_threads(1)
        own = self.world.integration_parameters
        own.dt = mechanism.step
        if not self.defaults:
            own.num_solver_iterations, own.num_internal_stabilization_iterations = 1, 0
            own.num_internal_pgs_iterations = settings["iterations"]
            own.normalized_allowed_linear_error = own.normalized_prediction_distance = 1e-7
            own.friction_in_bias_pass = True  # there is no other one
            own.contact_recycling = own.contact_clustering = False
            rigid = RIGID_RATIO / (np.pi * host.OVERLAP_TIME), RIGID_RATIO
            own.contact_softness = own.static_contact_softness = rapier.SpringCoefficients(*rigid)
        self.bodies = [self.world.add_body(rapier.RigidBody.fixed())]
        for k, start in enumerate(host.start_of_links(mechanism)[1:], 1):
            self.add_link(k, *start)
        self.joints = {j: self.add_joint(j) for j in host.held_joints(mechanism)}
        for k in {mechanism.joints[j].child for j in host.free_rows(mechanism)}:
            self.keep_in_plane(k)
        if mechanism.contacts:
            self.add_contacts()
        self.joint = host.joint_reader(mechanism, self.read)
        for loop in mechanism.loops:
            self.insert(rapier.SphericalJointBuilder(), *loop.points)

    def add_link(self, k, place, turn, velocity):
        """Add the body of a link."""
        link = self.mechanism.links[k]
        values, axes = np.linalg.eigh(host.inertia_in_motion(self.mechanism, k))
        host.refuse_lost_inertia(self.mechanism, k, LEAST_INERTIA, values[0])
        frame = rapier.Rotation3.face_toward(tuple(axes[:, 2]), tuple(axes[:, 1]))
        mass = rapier.MassProperties((0.0, 0.0, 0.0), link.mass, tuple(values), frame)
        body = rapier.RigidBodyBuilder(rapier.RigidBodyType.DYNAMIC).translation(tuple(place))
        body = body.rotation(tuple(turn)).additional_mass_properties(mass)
        body = body.linvel(tuple(velocity)).angvel(tuple(link.omega))
        body = body.can_sleep(self.defaults).allow_fast_rotation(not self.defaults)
        self.bodies.append(self.world.add_body(body))

    def insert(self, joint, *ends):
        """Insert a joint between points of two links, given in the start pose."""
        (a, one), (b, two) = ((k, tuple(self.mechanism.arm(k, at))) for k, at in ends)
        made = joint.local_anchor1(one).local_anchor2(two).build()
        return self.world.impulse_joints.insert(self.bodies[a], self.bodies[b], made)

    def add_joint(self, j):
        """Add a joint, with a motor if it is driven or rubs."""
        one, drive = self.mechanism.joints[j], self.mechanism.drive_of(j)
        if one.kind == "ball":
            return self.insert(rapier.SphericalJointBuilder(), *one.points)
        if not self.mechanism.is_planar:
            host.refuse_ratio(self.mechanism, one, LARGEST_RATIO)
        made = BUILDERS[one.kind](tuple(one.axis))
        if drive or one.friction:
            made = made.motor_velocity(one.rate if drive else 0.0, MOTOR_FACTOR)
            made = made.motor_model(rapier.MotorModel.FORCE_BASED)
            made = made if drive else made.motor_max_force(one.friction)
        return self.insert(made, *one.points)

    def keep_in_plane(self, k):
        """Keep a link in the plane of motion, in which it is free."""
        axes, normal = rapier.JointAxesMask, tuple(self.mechanism.plane[2])
        made = rapier.GenericJointBuilder(axes.LIN_X | axes.ANG_Y | axes.ANG_Z)
        made = made.local_axis1(normal).local_axis2(normal)
        centre = self.mechanism.links[k].centre
        self.insert(made, (0, centre), (k, centre))

    def add_contacts(self):
        """Add the shapes, with hooks that give each pair its law."""
        hooks = rapier.ActiveHooks.FILTER_CONTACT_PAIRS | rapier.ActiveHooks.MODIFY_SOLVER_CONTACTS
        for k, one in enumerate(self.mechanism.shapes):
            ends = (0, 2) if one.kind == "cylinder" else (2, 1)  # whose axis is y
            turn = rapier.Rotation3.face_toward(*(tuple(one.axes[:, i]) for i in ends))
            arm = rapier.Vec3(*self.mechanism.arm(one.link, one.place))
            made = COLLIDERS[one.kind](*map(float, one.size)).density(0.0).user_data(k)
            made = made.position(rapier.Isometry3(arm, turn)).active_hooks(hooks)
            self.world.add_collider(made, self.bodies[one.link])

        def law_of(context):
            ends = context.collider1, context.collider2
            return self.mechanism.laws.get(tuple(context.colliders[one].user_data for one in ends))

        class Laws:
            def filter_contact_pair(self, context):
                return rapier.SolverFlags.COMPUTE_IMPULSES if law_of(context) else None

            def modify_solver_contacts(self, context):
                law = law_of(context)
                context.friction, context.restitution = law.friction, law.restitution

        self.world.physics_hooks = Laws()

    def step(self, i):
        """Step number i, with the rates of drives and the forces on links."""
        for j, rate in host.drive_rates(self.mechanism, i, self.joint):
            data = self.world.impulse_joints[self.joints[j]].data
            data.set_motor_velocity(AXES[self.mechanism.joints[j].kind], rate, MOTOR_FACTOR)
        bodies = [self.world.rigid_bodies[one] for one in self.bodies]
        for body in bodies[1:]:
            body.reset_forces()
            body.reset_torques()
        for k, force, moment in host.pushes_on_links(self.mechanism, i, self.read, self.joint):
            bodies[k].add_force(tuple(force))
            bodies[k].add_torque(tuple(moment))
        self.world.step()

    def read(self, k):
        """The motion of a link."""
        body = self.world.rigid_bodies[self.bodies[k]]
        place, *rates = (np.array([*one]) for one in (body.translation, body.linvel, body.angvel))
        return place, host.matrix_of_xyzw(body.rotation.quaternion), *rates


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Step the world through the run."""
    host.refuse_gears(mechanism, "Rapier")
    world = RapierWorld(mechanism, settings)
    return host.record(mechanism, world.step, world.read)
