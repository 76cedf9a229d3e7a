"""Rapier by rapier3d: bodies in space, in single precision, with joints as impulses.

Hinges, slides, balls and loops are Rapier's impulse joints, and drives its motors, with a
limit for dry friction.  A step is one
substep without the relaxation behind it, so that velocities are those that move the bodies.
Springs, dampers and loads are applied by hand; in the half-step reading the rate in a damper is
half a step old, and dampers are of first order in the step.

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
        moments = [self.moments(k) for k in range(len(mechanism.links))]
        self.bodies = [self.world.add_body(rapier.RigidBody.fixed())]
        for k, start in enumerate(zip(*host.start_of_links(mechanism))):
            if k:
                self.add_link(k, moments[k], *start)
        free = host.free_rows(mechanism)
        self.joints = [
            None if j in free else self.add_joint(j, moments) for j in range(len(mechanism.joints))
        ]
        for k in {mechanism.joints[j].child for j in free}:
            self.keep_in_plane(k)
        if mechanism.contacts:
            self.add_contacts()
        self.joint = host.joint_reader(mechanism, self.read)
        for loop in mechanism.loops:
            ends = (loop.a, loop.on_a), (loop.b, loop.on_b)
            self.insert(rapier.SphericalJointBuilder(), *ends)

    def moments(self, k):
        """Moments of inertia (3,) of a link, ascending, and their axes in columns (3, 3).

        In a plane all are that about the normal, since no other one has a meaning.
        """
        inertia = host.inertia_with_armature(self.mechanism, k)
        if self.mechanism.is_planar:
            normal = self.mechanism.plane[2]
            return np.full(3, normal @ inertia @ normal), np.eye(3)
        return np.linalg.eigh(inertia)

    def add_link(self, k, moments, place, turn, velocity):
        """Add the body of a link."""
        link, (values, axes) = self.mechanism.links[k], moments
        host.refuse_lost_inertia(self.mechanism, k, LEAST_INERTIA, values[0])
        frame = rapier.Rotation3.face_toward(tuple(axes[:, 2]), tuple(axes[:, 1]))
        mass = rapier.MassProperties((0.0, 0.0, 0.0), link.mass, tuple(values), frame)
        body = rapier.RigidBodyBuilder(rapier.RigidBodyType.DYNAMIC).translation(tuple(place))
        body = body.rotation(tuple(turn)).additional_mass_properties(mass)
        body = body.linvel(tuple(velocity)).angvel(tuple(link.omega))
        if not self.defaults:
            body = body.can_sleep(False).allow_fast_rotation(True)
        self.bodies.append(self.world.add_body(body))

    def insert(self, joint, *ends):
        """Insert a joint between points of two links, given in the start pose."""
        (a, one), (b, two) = ((k, tuple(at - self.mechanism.links[k].centre)) for k, at in ends)
        made = joint.local_anchor1(one).local_anchor2(two).build()
        return self.world.impulse_joints.insert(self.bodies[a], self.bodies[b], made)

    def add_joint(self, j, moments):
        """Add a joint, with a motor if it is driven; a free joint is none."""
        one = self.mechanism.joints[j]
        if one.kind in ("ball", "free"):
            if one.damping:
                raise host.Refused(f"damping of {one.kind} joint {one.name!r}")
            made = rapier.SphericalJointBuilder()
        else:
            sizes = np.concatenate([moments[k][0] for k in (one.parent, one.child) if k])
            if not self.mechanism.is_planar and sizes.max() > LARGEST_RATIO * sizes.min():
                raise host.Refused(
                    f"joint {one.name!r}, which binds inertias of {sizes.min():.3g} and "
                    f"{sizes.max():.3g} kg m2: the iterations do not converge"
                )
            made = BUILDERS[one.kind](tuple(one.axis))
        if self.mechanism.drive_of(j) or one.friction:
            rate = one.rate if self.mechanism.drive_of(j) else 0.0
            made = made.motor_velocity(rate, MOTOR_FACTOR)
            made = made.motor_model(rapier.MotorModel.FORCE_BASED)
            if not self.mechanism.drive_of(j):
                made = made.motor_max_force(one.friction)
        ends = (one.parent, one.anchor), (one.child, one.anchor)
        return None if one.kind == "free" else self.insert(made, *ends)

    def keep_in_plane(self, k):
        """Keep a link in the plane of motion, in which it is free."""
        axes, normal = rapier.JointAxesMask, tuple(self.mechanism.plane[2])
        made = rapier.GenericJointBuilder(axes.LIN_X | axes.ANG_Y | axes.ANG_Z)
        made = made.local_axis1(normal).local_axis2(normal)
        centre = self.mechanism.links[k].centre
        self.insert(made, (0, centre), (k, centre))

    def add_contacts(self):
        """Add the shapes, with hooks that give each pair its law."""
        laws = {(pair.one, pair.two): pair for pair in self.mechanism.contacts}
        hooks = rapier.ActiveHooks.FILTER_CONTACT_PAIRS | rapier.ActiveHooks.MODIFY_SOLVER_CONTACTS
        for k, one in enumerate(self.mechanism.shapes):
            ends = (0, 2) if one.kind == "cylinder" else (2, 1)  # whose axis is y
            turn = rapier.Rotation3.face_toward(*(tuple(one.axes[:, i]) for i in ends))
            arm = rapier.Vec3(*(one.place - self.mechanism.links[one.link].centre))
            made = COLLIDERS[one.kind](*map(float, one.size)).density(0.0).user_data(k)
            made = made.position(rapier.Isometry3(arm, turn)).active_hooks(hooks)
            self.world.add_collider(made, self.bodies[one.link])

        def law_of(context):
            ends = (
                context.colliders[one].user_data for one in (context.collider1, context.collider2)
            )
            return laws.get(tuple(sorted(ends)))

        class Laws:
            def filter_contact_pair(self, context):
                return rapier.SolverFlags.COMPUTE_IMPULSES if law_of(context) else None

            def modify_solver_contacts(self, context):
                law = law_of(context)
                context.friction, context.restitution = law.friction, law.restitution

        self.world.physics_hooks = Laws()
        if self.defaults:
            return
        own, time = self.world.integration_parameters, host.OVERLAP_TIME
        own.normalized_allowed_linear_error = own.normalized_prediction_distance = 1e-7
        own.friction_in_bias_pass = True  # there is no other one
        own.contact_recycling = own.contact_clustering = False
        softness = rapier.SpringCoefficients(RIGID_RATIO / (np.pi * time), RIGID_RATIO)
        own.contact_softness = own.static_contact_softness = softness

    def step(self, i):
        """Step number i, with the rates of drives and the forces on links."""
        mechanism = self.mechanism
        for j, rate in host.drive_rates(mechanism, i, self.joint):
            data = self.world.impulse_joints[self.joints[j]].data
            data.set_motor_velocity(AXES[mechanism.joints[j].kind], rate, MOTOR_FACTOR)
        bodies = [self.world.rigid_bodies[one] for one in self.bodies]
        for body in bodies[1:]:
            body.reset_forces()
            body.reset_torques()
        for k, place, force, moment in host.link_forces(mechanism, i, self.read, self.joint):
            arm = place - self.read(k)[0]
            bodies[k].add_force(tuple(force))
            bodies[k].add_torque(tuple(moment + np.cross(arm, force)))
        self.world.step()

    def read(self, k):
        """The motion of a link."""
        body = self.world.rigid_bodies[self.bodies[k]]
        turn = host.matrix_of(np.roll(body.rotation.quaternion, 1))
        place, *rates = (
            np.array([one.x, one.y, one.z]) for one in (body.translation, body.linvel, body.angvel)
        )
        return place, turn, *rates


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Step the world through the run."""
    host.refuse_gears(mechanism, "Rapier")
    host.refuse_rows(mechanism, host.free_rows(mechanism))
    world = RapierWorld(mechanism, settings)
    return host.record(mechanism, world.step, world.read)
