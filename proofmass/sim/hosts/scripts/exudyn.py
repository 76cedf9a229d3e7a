"""Exudyn: hinges and slides in its kinematic tree; loops, drives and gears as constraints.

A link with a ball or a free joint is a rigid body with Euler parameters; no link may hang on it.
The solver leaves out the accelerations of drives at the start, about which its undamped rule then
alternates: a run begins with accelerations from the velocities of two very short steps.  Where
constraints are redundant, it is repeated with full pivoting.  With defaults neither is done.
"""

import exudyn as exu
import exudyn.utilities as items
import numpy as np
import proofmass_host as host

VERSIONS = {"exudyn": exu.__version__, "numpy": np.__version__}
MEASURED = "Position RotationMatrix Velocity AngularVelocity Acceleration AngularAcceleration"
COORDINATES = "Coordinates Coordinates_t Coordinates_tt"
KINDS = {"hinge": exu.JointType.RevoluteZ, "slide": exu.JointType.PrismaticZ}
STATIC_STEPS = 2  # static solutions from sample to sample
SHORT_SHARE = 0.01  # length of the steps at the start, in steps
START = exu.ConfigurationType.Initial


class ExudynSystem:
    """A mechanism in Exudyn; `last` is the number of a link in the tree."""

    def __init__(self, mechanism, settings):
        self.mechanism, self.settings, links = mechanism, settings, mechanism.links
        self.mbs, self.rows = exu.SystemContainer().AddSystem(), host.tree_rows(mechanism)
        self.last = {row.joint.child: k for k, row in enumerate(self.rows)}
        self.tree, self.node = self.add_tree() if self.rows else (None, None)
        self.bodies, self.full = {0: self.mbs.CreateGround()}, False
        for k in set(range(1, len(links))) - set(self.last):
            given = {"initialVelocity": links[k].velocity, "initialAngularVelocity": links[k].omega}
            given |= {"referencePosition": links[k].centre, "gravity": mechanism.gravity}
            given["inertia"] = items.RigidBodyInertia(links[k].mass, links[k].inertia)
            self.bodies[k] = self.mbs.CreateRigidBody(**given)
        self.connect()
        self.sensors = [self.sensors_of(k) if k or self.rows else [] for k in range(len(links))]
        self.mbs.Assemble()

    def add_tree(self):
        """Add hinges and slides, whose coordinates are 0 at the start; returns tree and node."""
        joints, links = [row.joint for row in self.rows], []
        for row, one in zip(self.rows, joints):
            inertia = items.RigidBodyInertia(row.mass, row.inertia).Translated(row.centre)
            place, spring = exu.HT(row.turn, row.place), (float(one.acting[0]), one.damping)
            links.append(items.TreeLink(inertia, KINDS[one.kind], place, row.up, spring))
        rates, rest = np.array([(one.rate, one.rest - one.value) for one in joints]).T
        given = {"initialCoordinates_t": rates, "jointPositionOffsetVector": rest}
        tree = self.mbs.CreateKinematicTree("", links, gravity=self.mechanism.gravity, **given)
        if forces := host.tree_forces(self.mechanism.step, self.rows):  # no argument of the above
            self.mbs.SetObjectParameter(
                tree, "forceUserFunction", lambda m, t, n, q, v: forces(t, q)
            )
        node = self.mbs.GetObject(tree)["nodeNumber"]
        armatures = np.diag([one.armature for one in joints])
        self.mbs.AddObject(items.ObjectGenericODE2(nodeNumbers=[node], massMatrix=armatures))
        return tree, node

    def local(self, k, at):
        """A link in Exudyn's words, its axes in the world at the start, and a point in them."""
        if k not in self.last:
            return {"bodyNumber": self.bodies[k]}, np.eye(3), self.mechanism.arm(k, at)
        link, row = {"objectNumber": self.tree, "linkNumber": self.last[k]}, self.rows[self.last[k]]
        return link, row.frame, row.frame.T @ (at - row.joint.anchor)

    def marker(self, k, at, axes):
        """A marker at a point of a link, with axes as rows."""
        link, frame, point = self.local(k, at)
        kind = items.MarkerKinematicTreeRigid if k in self.last else items.MarkerBodyRigid
        return self.mbs.AddMarker(kind(**link, localHT=exu.HT(frame.T @ axes.T, point)))

    def connect(self):
        """Add drives, gears, loops and balls, which in a plane leave its normal out, and forces."""
        mbs, mechanism, node, flat = self.mbs, self.mechanism, self.node, self.mechanism.is_planar
        places, step = {j: k for k, j in enumerate(mechanism.singles)}, mechanism.step
        for one in mechanism.drives:
            value, rate, second = one.value - one.value[0], one.rate, one.acceleration
            given = {"offsetUserFunction": host.in_time(step, value, rate, 0.5 * second, before=1)}
            given["offsetUserFunction_t"] = host.in_time(step, rate, second, before=1)
            mbs.CreateCoordinateConstraint("", [None, node], [None, places[one.joint]], **given)
        for one in mechanism.gears:
            pair = [places[one.one], places[one.two]]
            mbs.CreateCoordinateConstraint("", [node, node], pair, factor1=one.ratio)
        world, fixed = np.eye(3), [1, 1, int(not flat), 0, 0, 0]
        for points in host.joined_points(mechanism):
            ends = [self.marker(*point, mechanism.plane if flat else world) for point in points]
            mbs.CreateGenericJoint(itemNumbers=ends, constrainedAxes=fixed)
        for one in mechanism.springs:
            ends = [self.marker(*point, world) for point in one.points]
            given = {"springForceUserFunction": lambda m, t, n, x, v, *_, one=one: one.pull(x, v)}
            mbs.CreateSpringDamper(itemNumbers=ends, referenceLength=0.0, **given)
        for one in mechanism.loads:
            given = {"itemNumber": self.marker(one.link, one.at, world), "bodyFixed": one.follows}
            for create, most in (mbs.CreateForce, one.force), (mbs.CreateTorque, one.moment):
                share = host.in_time(step, one.share, factor=most, before=1)
                create(loadVectorUserFunction=share, **given)

    def sensors_of(self, k):
        """Sensors at the centre of a link; of the ground: those of all coordinates of the tree."""
        given, _, point = self.local(k, self.mechanism.links[k].centre)
        kind = items.SensorKinematicTree if k in self.last else items.SensorBody
        given |= {"localPosition": point}
        if not k:
            kind, given = items.SensorNode, {"nodeNumber": self.node}
        given |= {"storeInternal": True, "writeToFile": False}
        names = (MEASURED if k else COORDINATES).split()
        kinds = [getattr(exu.OutputVariableType, name) for name in names]
        return [self.mbs.AddSensor(kind(**given, outputVariableType=one)) for one in kinds]

    def wanted(self):
        """Settings of a solver, with full pivoting if it is asked for."""
        wanted = exu.SimulationSettings()
        wanted.solution.file.write = False
        wanted.solution.sensors.writePeriod = self.mechanism.count * self.mechanism.step
        if self.full:
            wanted.linearSolver.solverType = exu.LinearSolverType.EigenDense
            wanted.linearSolver.ignoreSingularJacobian = True
        return wanted

    def solve(self, steps, step, first=False):
        """Solve from the start; the engine sets the accelerations there if it is the `first`."""
        wanted = self.wanted()
        time, newton = wanted.timeIntegration, wanted.timeIntegration.newton
        time.numberOfSteps, time.endTime, time.verboseMode = steps, steps * step, 0
        rule = time.generalizedAlpha
        if not self.settings["defaults"]:
            newton.relativeTolerance = newton.absoluteTolerance = 1e-10
            newton.residualMode, newton.useModifiedNewton = 1, False  # tolerances of increments
            rule.useNewmark = rule.useIndex2Constraints = self.settings["scheme"] == "trapezoidal"
            rule.computeInitialAccelerations, rule.resetAccelerations = first, False
        self.mbs.SolveDynamic(wanted, showCausingItems=False)

    def solve_rests(self, duration, steps):
        """Solve equilibria over a duration from the start, which is then that of its end."""
        wanted, system = self.wanted(), self.mbs.systemData
        static = wanted.staticSolver
        static.numberOfLoadSteps, static.loadStepDuration, static.verboseMode = steps, duration, 0
        static.newton.relativeTolerance = static.newton.absoluteTolerance = 1e-10
        static.useLoadFactor = False
        self.mbs.SolveStatic(wanted, showCausingItems=False)
        system.SetSystemState(system.GetSystemState(), START)

    def run(self):
        """Solve for all samples, if possible, and return whether it came to the end."""
        system, short = self.mbs.systemData, SHORT_SHARE * self.mechanism.step
        try:
            if self.mechanism.rest:
                length = self.mechanism.steps * self.mechanism.step or short
                self.solve_rests(short, 1)
                self.solve_rests(length, static_steps(self.mechanism))
                return True
            if not self.settings["defaults"]:
                rates = [system.GetODE2Coordinates_t(START)]
                for steps in (1, 2):
                    self.solve(steps, short, first=True)
                    rates.append(system.GetODE2Coordinates_t())
                change = (4.0 * rates[1] - 3.0 * rates[0] - rates[2]) / (2.0 * short)
                system.SetODE2Coordinates_tt(change, START)
            self.solve(self.mechanism.steps, self.mechanism.step)
        except RuntimeError:
            return False
        return True


def static_steps(mechanism):
    """Number of static solutions from the first sample to the last, at least one."""
    return STATIC_STEPS * (mechanism.samples - 1) or 1


def simulate(mechanism: host.NeutralMechanism, settings: dict) -> host.LinkStates:
    """The states at the samples, as Exudyn's sensors measure them."""
    system, states = ExudynSystem(mechanism, settings), host.LinkStates.empty(mechanism, True)
    with host.Stopwatch() as watch:
        if not system.run() and not settings["defaults"]:
            system.full = True
            if system.run():
                states.notes = ("Solved by full pivoting, as is needed at redundant constraints.",)
    states.steps = static_steps(mechanism) + 1 if mechanism.rest else 0
    states.seconds, read = watch.seconds, system.mbs.GetSensorStoredData
    moves, *links = (host.rows_at_samples(mechanism, map(read, own)) for own in system.sensors)
    for k, (place, turn, *rates) in enumerate(links, 1):
        n, axes = len(place), system.local(k, np.zeros(3))[1].T
        states.set(slice(n), k, (place, turn.reshape(-1, 3, 3) @ axes, *rates))
    for row, data in zip(states.coordinates, moves):
        row[:n, mechanism.singles] = data
    states.coordinates[0] += [one.value for one in mechanism.joints]
    return states if n == mechanism.samples else states.first(n, "the solver does not converge")
