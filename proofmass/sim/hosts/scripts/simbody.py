"""Simbody through OpenSim: joint coordinates, projected constraints, and steps that it chooses.

All are its own elements: drives are prescribed motions, loads prescribed forces, springs are
expressions, tables in time splines; several joints of a link act through bodies without mass.
"""

import numpy as np
import opensim
import proofmass_host as host

opensim.Logger.setLevelString("Off")
VERSIONS = {"opensim": opensim.__version__, "numpy": np.__version__}
KINDS = {"hinge": "PinJoint", "slide": "SliderJoint", "ball": "BallJoint", "free": "FreeJoint"}
AXES = {"hinge": opensim.CoordinateAxis(2), "slide": opensim.CoordinateAxis(0)}
RATES = "LinearVelocity", "AngularVelocity", "LinearAcceleration", "AngularAcceleration"
KNOTS = 20  # entries of the spline of a drive before and behind its table


def function_of(table, half, first=0):
    """The function of a table at half steps from a number on: a line or a spline."""
    if line := host.line_of(table):
        return opensim.LinearFunction(line[1] / half, line[0] - line[1] * first)
    spline = opensim.GCVSpline()
    spline.setDegree(3)
    for i, one in enumerate(table.tolist(), first):
        spline.addPoint(half * i, one)
    return spline


class OpenSimModel:
    """A mechanism as a model of OpenSim, whose bodies have their origins at the centres of mass.

    Its `tree` has one joint on each link.
    """

    def __init__(self, mechanism, settings):
        self.accuracy = 0.0 if settings["defaults"] else settings["accuracy"]
        self.mechanism, self.model, joints = mechanism, opensim.Model(), mechanism.joints
        self.model.setGravity(opensim.Vec3.createFromMat(mechanism.gravity))
        self.model.set_assembly_accuracy(1e-14)
        self.tree, self.half = host.one_joint_each(mechanism), mechanism.step / 2
        self.bodies = [self.model.getGround()] * len(self.tree.links)
        self.coordinates = [self.add_joint(j, one) for j, one in enumerate(self.tree.joints)]
        for loop in mechanism.loops:
            ends = [part for point in loop.points for part in self.end(*point)]
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
            host.refuse_changing_loads(mechanism)
            for body, link in zip(self.bodies[1:], mechanism.links[1:]):
                self.add_drag(body, link)
        self.state, self.goals = self.model.initSystem(), None

    def end(self, link, at):
        """A body and a point of it, given at the start."""
        return self.bodies[link], opensim.Vec3.createFromMat(self.tree.arm(link, at))

    def add_joint(self, j, one):
        """Add a joint and the body that it moves; returns its coordinate."""
        child, angles = self.tree.links[one.child], opensim.Vec3(0)
        inertia = opensim.Inertia(*child.six_moments.tolist())
        body = opensim.Body(f"body_{j}", child.mass, opensim.Vec3(0), inertia)
        self.model.addBody(body)
        self.bodies[one.child] = body
        if one.kind in AXES:
            turn = opensim.Rotation(opensim.UnitVec3(*one.axis.tolist()), AXES[one.kind])
            angles = turn.convertRotationToBodyFixedXYZ()
        sides = [part for point in one.points for part in (*self.end(*point), angles)]
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
        if drive and not self.mechanism.rest:
            table = host.values_beyond(drive, self.half, KNOTS) - one.value
            coordinate.setPrescribedFunction(function_of(table, self.half, -KNOTS))
            coordinate.setDefaultIsPrescribed(True)
        if drive:
            return
        if one.armature:
            raise host.Refused(f"armature of joint {one.name!r}")
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
            (a, at_a), (b, at_b) = (self.end(*point) for point in one.points)
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
        plane, name = (
            self.mechanism.plane if self.mechanism.is_planar else np.eye(3),
            body.getName(),
        )
        axes = opensim.Rotation(opensim.Mat33(*plane.T.ravel().tolist()))
        place, frames = opensim.Transform(axes, opensim.Vec3(0)), []
        for k, end in enumerate((self.bodies[0], body)):
            frames.append(opensim.PhysicalOffsetFrame(f"drag_{k}_{name}", end, place))
            self.model.addComponent(frames[-1])
        sizes = (0.0, 0.0, link.mass, link.inertia[0, 0])
        sizes = [opensim.Vec3(float(self.mechanism.rest.drag * one)) for one in sizes]
        self.model.addForce(opensim.BushingForce(f"drag_{name}", *frames, *sizes))

    def restart(self, goals):
        """Begin an integration from the state, with the drives locked at goals toward a rest."""
        joints, state = self.mechanism.joints, self.state
        for j, goal in goals.items():
            self.coordinates[j].setLocked(state, False)
            self.coordinates[j].setValue(state, goal - joints[j].value, False)
            self.coordinates[j].setLocked(state, True)
        if self.mechanism.rest:
            self.model.assemble(state)
        manager = opensim.Manager(self.model)
        if self.accuracy:
            manager.setIntegratorAccuracy(self.accuracy)
        manager.initialize(state)
        self.manager, self.goals = manager, goals  # the one before had the state

    def step(self, i):
        """Integrate up to the next sample, or toward a rest over a step."""
        end, goals = (i + 1) * self.mechanism.count * self.mechanism.step, {}
        if self.mechanism.rest:
            goals = {one.joint: float(one.value[2 * i + 2]) for one in self.mechanism.drives}
        try:
            if goals != self.goals:
                self.restart(goals)
            if self.mechanism.rest:
                end = self.manager.getState().getTime() + self.mechanism.step
            self.state = self.manager.integrate(end)
        except RuntimeError as error:
            why = " ".join(str(error).split()).rpartition("Error detected by ")[2]
            raise host.RunEnded(why) from None

    def read(self, k):
        """Place, rotation, velocities and accelerations of a link."""
        self.model.realizeAcceleration(self.state)
        frame = self.bodies[k].getTransformInGround(self.state)
        turn = np.array([[frame.R().get(i, j) for j in range(3)] for i in range(3)])
        found = (getattr(self.bodies[k], f"get{of}InGround")(self.state) for of in RATES)
        return frame.p().to_numpy(), turn, *(one.to_numpy() for one in found)

    def joint(self, j):
        """Coordinate, rate and acceleration of a hinge or slide."""
        one = self.coordinates[j]
        values = one.getValue, one.getSpeedValue, one.getAccelerationValue
        return [value(self.state) for value in values]


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """Integrate from sample to sample."""
    own = OpenSimModel(mechanism, settings)
    return host.record(host.without_steps(mechanism), own.step, own.read, own.joint)
