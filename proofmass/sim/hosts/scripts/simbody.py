"""Simbody through OpenSim: joint coordinates, projected constraints, and steps that it chooses.

All are its own elements: drives are prescribed motions, loads prescribed forces, springs are
expressions, tables in time splines; several joints of a link act through bodies without mass.
"""

import numpy as np
import opensim
from proofmass_host import LinkStates, NeutralMechanism, Refused, Stopwatch, record

opensim.Logger.setLevelString("Off")
VERSIONS = {"opensim": opensim.__version__, "numpy": np.__version__}
KINDS = {"hinge": "PinJoint", "slide": "SliderJoint", "ball": "BallJoint", "free": "FreeJoint"}
AXES = {"hinge": opensim.CoordinateAxis(2), "slide": opensim.CoordinateAxis(0)}
RATES = "LinearVelocity", "AngularVelocity", "LinearAcceleration", "AngularAcceleration"
KNOTS = 20  # entries of the spline of a drive before and behind its table


def function_of(table, half, first=0):
    """The function of a table at half steps from a number on: a constant, a line or a spline."""
    if table.size == 1:
        return opensim.Constant(float(table[0]))
    line, slope = np.linspace(table[0], table[-1], table.size, retstep=True)
    if np.abs(line - table).max() <= 1e-13 * np.abs(table).max():
        return opensim.LinearFunction(float(slope) / half, float(table[0] - slope * first))
    spline = opensim.GCVSpline()
    spline.setDegree(3)
    for i, one in enumerate(table.tolist(), first):
        spline.addPoint(half * i, one)
    return spline


def motion_of(drive, half, start):
    """The motion of a drive from a start on, which goes on smoothly beside its table."""
    beside, parts, a = half * np.arange(1, KNOTS + 1), [], drive.acceleration
    for end, jump, dt in ((0, a[1] - a[0], -beside[::-1]), (-1, a[-1] - a[-2], beside)):
        second = a[end] / 2.0 + dt * jump / half / 6.0
        parts.append(drive.value[end] + dt * (drive.rate[end] + dt * second))
    return function_of(np.concatenate([parts[0], drive.value, parts[1]]) - start, half, -KNOTS)


class OpenSimModel:
    """A mechanism as a model of OpenSim, whose bodies have their origins at the centres of mass."""

    def __init__(self, mechanism, settings):
        self.accuracy = 0.0 if settings["defaults"] else settings["accuracy"]
        self.mechanism, self.model, joints = mechanism, opensim.Model(), mechanism.joints
        self.model.setGravity(opensim.Vec3.createFromMat(mechanism.gravity))
        self.model.set_assembly_accuracy(1e-14)
        self.bodies, self.half = [self.model.getGround()] * len(mechanism.links), mechanism.step / 2
        self.coordinates = [self.add_joint(j, one) for j, one in enumerate(joints)]
        for loop in mechanism.loops:
            ends = (*self.end(loop.a, loop.on_a), *self.end(loop.b, loop.on_b))
            self.model.addConstraint(opensim.PointConstraint(*ends))
        for gear in mechanism.gears:
            level = gear.level + gear.ratio * joints[gear.two].value - joints[gear.one].value
            coupler = opensim.CoordinateCouplerConstraint()
            coupler.setIndependentCoordinateNames(opensim.ArrayStr(f"q{gear.two}_0", 1))
            coupler.setDependentCoordinateName(f"q{gear.one}_0")
            coupler.setFunction(opensim.LinearFunction(float(gear.ratio), float(level)))
            self.model.addConstraint(coupler)
        self.add_springs_and_loads()
        if mechanism.rest:
            shares = [one.share for one in mechanism.loads] + [one.force for one in joints]
            if any(one.size > 1 for one in shares):
                raise Refused("loads that change in a sweep")
            for body, link in zip(self.bodies[1:], mechanism.links[1:]):
                self.add_drag(body, link)
        self.state, self.manager, self.goals = self.model.initSystem(), None, {}

    def end(self, link, at):
        """A body and a point of it, given at the start."""
        arm = at - self.mechanism.links[link].centre
        return self.bodies[link], opensim.Vec3.createFromMat(arm)

    def add_joint(self, j, one):
        """Add a joint and the body that it moves; returns its coordinate."""
        row, links = self.mechanism.joints_of(one.child), self.mechanism.links
        base = self.end(one.parent if j == row[0] else one.child, one.anchor)
        child, share = links[one.child], float(j == row[-1])
        six = (share * child.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]).tolist()
        body = opensim.Body(f"body_{j}", share * child.mass, opensim.Vec3(0), opensim.Inertia(*six))
        self.model.addBody(body)
        self.bodies[one.child], angles = body, opensim.Vec3(0)
        if one.kind in AXES:
            turn = opensim.Rotation(opensim.UnitVec3(*one.axis.tolist()), AXES[one.kind])
            angles = turn.convertRotationToBodyFixedXYZ()
        sides = (*base, angles, *self.end(one.child, one.anchor), angles)
        joint = getattr(opensim, KINDS[one.kind])(f"joint_{j}", *sides)
        rates = np.roll(self.mechanism.start_rates(j), 3 if one.kind == "free" else 0)
        for i, rate in enumerate(rates.tolist()):
            joint.upd_coordinates(i).setName(f"q{j}_{i}")
            joint.upd_coordinates(i).setDefaultSpeedValue(rate)
            self.act_in_joint(j, one, joint.upd_coordinates(i))
        self.model.addJoint(joint)
        return joint.get_coordinates(0)

    def act_in_joint(self, j, one, coordinate):
        """Add the drive of a coordinate, or its spring, damper and motor."""
        drive, name = self.mechanism.drive_of(j), coordinate.getName()
        if drive and self.mechanism.rest:
            return
        if drive:
            coordinate.setPrescribedFunction(motion_of(drive, self.half, one.value))
            coordinate.setDefaultIsPrescribed(True)
            return
        if one.armature:
            raise Refused(f"armature of joint {one.name!r}")
        (k, a, b), x = one.acting.tolist(), f"(q+{one.value - one.rest!r})"
        text = f"-{x}*({k!r}+{x}*({a!r}+{x}*{b!r}))-({one.damping!r})*qdot"
        self.model.addForce(opensim.ExpressionBasedCoordinateForce(name, text))
        if one.is_forced:
            motor, control = opensim.CoordinateActuator(name), opensim.PrescribedController()
            motor.setName(f"motor_{j}")
            self.model.addForce(motor)
            control.addActuator(motor)
            control.prescribeControlForActuator(f"motor_{j}", function_of(one.force, self.half))
            self.model.addController(control)

    def add_springs_and_loads(self):
        """Add springs between points, slack in their ranges, and loads on links."""
        for one in self.mechanism.springs:
            (a, at_a), (b, at_b) = self.end(one.a, one.on_a), self.end(one.b, one.on_b)
            ends = a.getAbsolutePathString(), at_a, b.getAbsolutePathString(), at_b
            low, high = one.slack
            pull = f"{one.stiffness!r}*(d-min(max(d,{low!r}),{high!r}))+{one.damping!r}*ddot"
            self.model.addForce(opensim.ExpressionBasedPointToPointForce(*ends, pull))
        for k, one in enumerate(self.mechanism.loads):
            body, at = self.end(one.link, one.at)
            load = opensim.PrescribedForce(f"load_{k}", body)
            load.setForceIsInGlobalFrame(not one.follows)
            load.setPointFunctions(*map(opensim.Constant, at.to_numpy().tolist()))
            load.setForceFunctions(*(function_of(one.share * x, self.half) for x in one.force))
            load.setTorqueFunctions(*(function_of(one.share * x, self.half) for x in one.moment))
            self.model.addForce(load)

    def add_drag(self, body, link):
        """Add the drag of a link as dampers from the ground, with the normal of the plane as z."""
        plane = self.mechanism.plane if self.mechanism.is_planar else np.eye(3)
        axes = opensim.Rotation(opensim.Mat33(*plane.T.ravel().tolist()))
        frames = [
            opensim.PhysicalOffsetFrame(end, opensim.Transform(axes, opensim.Vec3(0)))
            for end in (self.bodies[0], body)
        ]
        for k, frame in enumerate(frames):
            frame.setName(f"drag_{k}_{body.getName()}")
            self.model.addComponent(frame)
        sizes = (0.0, 0.0, link.mass, link.inertia[0, 0])
        sizes = [opensim.Vec3(float(self.mechanism.rest.drag * one)) for one in sizes]
        self.model.addForce(opensim.BushingForce(f"drag_{body.getName()}", *frames, *sizes))

    def step(self, i):
        """Integrate over a step with the drives locked at their next values."""
        joints, state = self.mechanism.joints, self.state
        goals = {one.joint: float(one.value[2 * i + 2]) for one in self.mechanism.drives}
        if goals != self.goals or not self.manager:
            for j, goal in goals.items():
                self.coordinates[j].setLocked(state, False)
                self.coordinates[j].setValue(state, goal - joints[j].value, False)
                self.coordinates[j].setLocked(state, True)
            self.model.assemble(state)
            self.manager, self.goals = self.manager_from(state), goals
        self.state = self.manager.integrate(self.manager.getState().getTime() + self.mechanism.step)

    def motion(self, k, rates=RATES[:2]):
        """Place, rotation, velocity and angular velocity of a link, and accelerations if asked."""
        self.model.realizeVelocity(self.state)
        frame = self.bodies[k].getTransformInGround(self.state)
        turn = np.array([[frame.R().get(i, j) for j in range(3)] for i in range(3)])
        found = (getattr(self.bodies[k], f"get{of}InGround")(self.state) for of in rates)
        return frame.p().to_numpy(), turn, *(one.to_numpy() for one in found)

    def joint(self, j):
        """Coordinate and rate of a hinge or slide."""
        coordinate = self.coordinates[j]
        return coordinate.getValue(self.state), coordinate.getSpeedValue(self.state)

    def keep(self, states, sample):
        """Keep the states of all links and joints at a sample."""
        self.model.realizeAcceleration(self.state)
        for k in range(1, len(self.bodies)):
            states.set(sample, k, self.motion(k, RATES))
        for j in self.mechanism.singles:
            value, rate = self.joint(j)
            change = self.coordinates[j].getAccelerationValue(self.state)
            states.coordinates[:, sample, j] = self.mechanism.joints[j].value + value, rate, change

    def manager_from(self, state):
        """A new manager of the integration, which has a copy of a state."""
        manager = opensim.Manager(self.model)
        if self.accuracy:
            manager.setIntegratorAccuracy(self.accuracy)
        manager.initialize(state)
        return manager


def simulate(mechanism: NeutralMechanism, settings: dict) -> LinkStates:
    """Integrate from sample to sample."""
    own, states = OpenSimModel(mechanism, settings), LinkStates.empty(mechanism, True)
    if mechanism.rest:
        return record(mechanism, own.step, own.motion, own.joint)
    with Stopwatch() as watch:
        manager = own.manager_from(own.state)
        for sample in range(mechanism.samples):
            time = sample * mechanism.count * mechanism.step
            try:
                own.state = manager.integrate(time) if sample else own.state
                own.keep(states, sample)
            except RuntimeError as error:
                why = " ".join(str(error).split()).rpartition("Error detected by ")[2]
                states = states.first(sample, why)
                break
    states.seconds = watch.seconds
    return states
