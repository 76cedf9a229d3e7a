"""Newton by its Kamino solver in Warp: bodies in space, in single precision, on the processor.

Joints and loops are Newton's joints, closed by a direct solution of all of them in each step, with
all that is open (the backend DVI); drives are velocity targets with a large gain.  Springs, dampers
and loads are applied by hand; in the half-step reading the rate in a damper is half a step old, and
dampers are of first order in the step.

Warp compiles its kernels before the first step of a process, which is told apart from the run.
"""

from importlib.metadata import version

import newton
import numpy as np
import proofmass_host as host
import warp

warp.config.quiet = True
VERSIONS = {name: version(name) for name in ("newton", "warp-lang", "numpy")}
DRIVE_GAIN = 1e9
"""Gain of the velocity target of a drive [N m s/rad or N s/m], beside which no load counts."""
LEAST_SHARE = 1e-6
"""Least inertia of a link in the largest of the mechanism: of a pendulum on a cart 1e-5 is right,
and 1e-9 is lost in the single precision of the solution for all joints at once."""
KAMINO, ALONG = newton.solvers.SolverKamino, (0.0, 0.0, 1.0)


class NewtonBodies:
    """A mechanism as bodies and joints of Newton; body k - 1 is that of link k."""

    def __init__(self, mechanism, settings):
        self.mechanism, links = mechanism, mechanism.links
        self.builder = newton.ModelBuilder(gravity=tuple(mechanism.gravity.tolist()))
        self.inertias = [host.inertia_in_motion(mechanism, k) for k in range(len(links))]
        self.refuse_lost_inertia()
        places, turns, velocities = zip(*host.start_of_links(mechanism))
        for one, inertia, place, turn in zip(links[1:], self.inertias[1:], places[1:], turns[1:]):
            small = warp.normalize(warp.quat(*(0.5 * turn).tolist(), 1.0))
            pose = warp.transform(warp.vec3(*place.tolist()), small)
            given = {"inertia": warp.mat33(*inertia.ravel().tolist()), "lock_inertia": True}
            self.builder.add_link(xform=pose, mass=one.mass, **given)
        self.drives = dict.fromkeys(one.joint for one in mechanism.drives)
        made, roots = [self.add_joint(j) for j in range(len(mechanism.joints))], []
        for number, one in zip(made, mechanism.joints):
            roots += [[]] if not one.parent or one.kind == "free" else []
            roots[-1].append(number)
        for numbers in roots:
            self.builder.add_articulation(numbers)
        for loop in mechanism.loops:
            ends = loop.points[:: 1 if loop.b else -1]
            self.builder.add_joint_ball(**self.ends(*ends, np.eye(3)))
        model = self.builder.finalize(device="cpu", skip_validation_joints=True)
        own = KAMINO.Config() if settings["defaults"] else KAMINO.Config(dynamics_solver="dvi")
        if not settings["defaults"]:
            own.constraints.alpha = 1.0
            own.dvi.max_alternating_iterations = 1  # there are no bounds to alternate with
        self.solver = KAMINO(model, own)
        self.now, self.later, self.control = model.state(), model.state(), model.control()
        rates = np.column_stack([velocities, [one.omega for one in links]])[1:]
        self.now.body_qd.assign(rates.astype(np.float32))
        self.joint = host.joint_reader(mechanism, self.read)
        self.pull()

    def refuse_lost_inertia(self):
        """Refuse a link whose inertia is lost beside the others in single precision."""
        moments = [np.linalg.eigvalsh(one) for one in self.inertias]
        large = max(one[-1] for one in moments)
        for one in self.mechanism.joints:
            link = self.mechanism.links[one.child]
            large = max(large, link.mass * np.linalg.norm(one.anchor - link.centre) ** 2)
        for link, (size, *_) in zip(self.mechanism.links[1:], moments[1:]):
            if size < LEAST_SHARE * large:
                text = f"with an inertia of {size:.3g} kg m2, that single precision does not carry"
                raise host.Refused(f"link {link.name!r} {text} beside {large:.3g} kg m2")

    def ends(self, near, far, axes):
        """Bodies and frames of a joint between points of two links, the second no ground."""
        given = {"parent": near[0] - 1, "child": far[0] - 1}
        turn = warp.quat_from_matrix(warp.mat33(*axes.ravel().tolist()))
        for name, (k, at) in (("parent_xform", near), ("child_xform", far)):
            place = warp.vec3(*self.mechanism.arm(k, at).tolist())
            given[name] = warp.transform(place, turn)
        return given

    def add_joint(self, j):
        """Add a joint, and return its number."""
        one, build = self.mechanism.joints[j], self.builder
        axes = host.frame_of_axis(one.axis) if one.is_single else np.eye(3)
        ends = self.ends(*one.points, axes)
        if not one.is_single:
            add = build.add_joint_ball if one.kind == "ball" else build.add_joint_free
            return add(**ends)
        if j in self.drives:
            ends |= {"actuator_mode": newton.JointTargetMode.VELOCITY, "target_kd": DRIVE_GAIN}
        add = build.add_joint_revolute if one.kind == "hinge" else build.add_joint_prismatic
        made = add(**ends, axis=ALONG)
        self.drives |= {j: build.joint_qd_start[made]} if j in self.drives else {}
        return made

    def step(self, i):
        """Step number i, with the rates of drives and the forces on links."""
        mechanism, targets = self.mechanism, self.control.joint_target_qd.numpy()
        for j, rate in host.drive_rates(mechanism, i, self.joint):
            targets[self.drives[j]] = rate
        self.control.joint_target_qd.assign(targets)
        push = np.zeros((len(mechanism.links), 6), np.float32)
        for k, force, moment in host.pushes_on_links(mechanism, i, self.read, self.joint):
            push[k] += [*force, *moment]
        self.now.body_f.assign(push[1:])
        self.solver.step(self.now, self.later, self.control, None, mechanism.step)
        self.now, self.later = self.later, self.now
        self.pull()

    def pull(self):
        """Read the states of all bodies."""
        states = self.now.body_q, self.now.body_qd
        self.poses, self.rates = (one.numpy().astype(float) for one in states)

    def read(self, k):
        """The motion of a link."""
        pose, rates = self.poses[k - 1], self.rates[k - 1]
        return pose[:3], host.matrix_of_xyzw(pose[3:]), rates[:3], rates[3:]


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Step the bodies through the run."""
    host.refuse_gears(mechanism, "Kamino")
    host.refuse_rows(mechanism)
    host.refuse_damped_balls(mechanism)
    with host.Stopwatch() as compiling:
        bodies = NewtonBodies(mechanism, settings)
        bodies.solver.step(bodies.now, bodies.later, bodies.control, None, mechanism.step)
    states = host.record(mechanism, bodies.step, bodies.read)
    states.compiled = compiling.seconds
    return states
