"""Exudyn: hinges and slides in its kinematic tree; loops, drives and gears as constraints.

A link with a ball or a free joint is a rigid body with Euler parameters; no link may hang on it.
The solver leaves out the accelerations of drives at the start, and its undamped rule alternates
about the right accelerations from then on: so a run begins with accelerations from the velocities
of two very short steps.  Where constraints are redundant, the run is repeated with full pivoting.
With defaults neither is done.
"""

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
from exudyn.rigidBodyUtilities import RigidBodyInertia, TreeLink
from proofmass_host import LinkStates, NeutralMechanism, Refused, Stopwatch, in_time, tree_rows

VERSIONS = {"exudyn": exu.__version__, "numpy": np.__version__}
MEASURED = "Position", "RotationMatrix", "Velocity", "AngularVelocity"
MEASURED = *MEASURED, "Acceleration", "AngularAcceleration"
COORDINATES = "Coordinates", "Coordinates_t", "Coordinates_tt"
ROWS = "place", "turn", "velocity", "omega", "acceleration", "alpha"
SHORT_SHARE = 0.01  # length of the steps at the start, in steps


class ExudynSystem:
    """A mechanism in Exudyn; `last` is the number of a link in the tree."""

    def __init__(self, mechanism):
        self.mechanism, links = mechanism, mechanism.links
        self.mbs = exu.SystemContainer().AddSystem()
        self.rows, self.tree, self.node = tree_rows(mechanism), None, None
        self.last = {row.joint.child: k for k, row in enumerate(self.rows)}
        if self.rows:
            self.add_tree([row.joint for row in self.rows])
        self.bodies = {0: self.mbs.CreateGround()}
        for k in set(range(1, len(links))) - set(self.last):
            given = {"initialVelocity": links[k].velocity, "initialAngularVelocity": links[k].omega}
            given |= {"referencePosition": links[k].centre, "gravity": mechanism.gravity}
            given["inertia"] = RigidBodyInertia(links[k].mass, links[k].inertia)
            self.bodies[k] = self.mbs.CreateRigidBody(**given)
        self.connect()
        self.sensors = [self.sensors_of(k) if k or self.rows else [] for k in range(len(links))]
        self.mbs.Assemble()

    def in_time(self, *rows, factor=1.0):
        """A function of the time for Exudyn."""
        value = in_time(self.mechanism.step, *rows, factor=factor)
        return lambda mbs, t, *_: value(t)

    def add_tree(self, joints):
        """Add hinges and slides, whose coordinates are 0 at the start, with drives and gears."""
        rates, rest = np.array([(one.rate, one.rest - one.value) for one in joints]).T
        given = {"referenceCoordinates": 0.0 * rates, "initialCoordinates": 0.0 * rates}
        given |= {"initialCoordinates_t": rates, "jointPositionOffsetVector": rest}
        given |= {"gravity": self.mechanism.gravity}
        links = [tree_link(row) for row in self.rows]
        self.tree = self.mbs.CreateKinematicTree(listOfTreeLinks=links, **given)
        self.node = self.mbs.GetObject(self.tree)["nodeNumber"]
        forces = [in_time(self.mechanism.step, one.force) for one in joints]
        powers = np.array([one.spring[1:] for one in joints]).T

        def force(mbs, t, item, q, q_t):
            x = np.asarray(q) - rest
            return np.array([one(t) for one in forces]) - x**2 * (powers[0] + x * powers[1])

        if powers.any() or any(one.is_forced for one in joints):  # it is no argument of the above
            self.mbs.SetObjectParameter(self.tree, "forceUserFunction", force)
        inertia = {"massMatrix": np.diag([one.armature for one in joints])}
        self.mbs.AddObject(items.ObjectGenericODE2(nodeNumbers=[self.node], **inertia))
        places = {one.name: k for k, one in enumerate(joints)}
        places = [places.get(one.name) for one in self.mechanism.joints]
        for drive in self.mechanism.drives:
            value, rate, second = drive.value - drive.value[0], drive.rate, drive.acceleration
            given = {"offsetUserFunction": self.in_time(value, rate, 0.5 * second)}
            given["offsetUserFunction_t"] = self.in_time(rate, second)
            ends = [None, self.node], [None, places[drive.joint]]
            self.mbs.CreateCoordinateConstraint("", *ends, **given)
        for gear in self.mechanism.gears:
            ends = [self.node, self.node], [places[gear.one], places[gear.two]]
            self.mbs.CreateCoordinateConstraint("", *ends, factor1=gear.ratio)

    def local(self, k, at):
        """A link in Exudyn's words, its axes in the world at the start, and a point in them."""
        if k not in self.last:
            return {"bodyNumber": self.bodies[k]}, np.eye(3), at - self.mechanism.links[k].centre
        link, row = {"objectNumber": self.tree, "linkNumber": self.last[k]}, self.rows[self.last[k]]
        return link, row.frame, row.frame.T @ (at - row.joint.anchor)

    def marker(self, k, at, plane=None):
        """A marker at a point of a link, with the axes of a plane or of the world."""
        link, frame, point = self.local(k, at)
        kind = items.MarkerKinematicTreeRigid if k in self.last else items.MarkerBodyRigid
        turn = frame.T if plane is None else frame.T @ plane.T
        return self.mbs.AddMarker(kind(**link, localHT=exu.HT(rotation=turn, translation=point)))

    def connect(self):
        """Add loops and balls, which in a plane leave its normal out, springs and loads."""
        mbs, mechanism, flat = self.mbs, self.mechanism, self.mechanism.is_planar
        balls = [one for one in mechanism.joints if one.kind in ("ball", "free")]
        if any(one.damping for one in balls):
            raise Refused("damping of a ball or free joint")
        pairs = [(one.a, one.on_a, one.b, one.on_b) for one in mechanism.loops]
        pairs += [(o.parent, o.anchor, o.child, o.anchor) for o in balls if o.kind == "ball"]
        for a, on_a, b, on_b in pairs:
            plane = mechanism.plane if flat else np.eye(3)
            ends = [self.marker(a, on_a, plane), self.marker(b, on_b, plane)]
            mbs.CreateGenericJoint(itemNumbers=ends, constrainedAxes=[1, 1, int(not flat), 0, 0, 0])
        for one in mechanism.springs:
            ends = [self.marker(one.a, one.on_a), self.marker(one.b, one.on_b)]
            given = {"referenceLength": one.slack[0], "springForceUserFunction": pull_of(one)}
            mbs.CreateSpringDamper(itemNumbers=ends, **given)
        for one in mechanism.loads:
            item, share = self.marker(one.link, one.at), one.share
            given = {"itemNumber": item, "bodyFixed": one.follows}
            mbs.CreateForce(loadVectorUserFunction=self.in_time(share, factor=one.force), **given)
            mbs.CreateTorque(loadVectorUserFunction=self.in_time(share, factor=one.moment), **given)

    def sensors_of(self, k):
        """Sensors at the centre of a link; of the ground: those of all coordinates of the tree."""
        given, _, point = self.local(k, self.mechanism.links[k].centre)
        kind = items.SensorKinematicTree if k in self.last else items.SensorBody
        given |= {"localPosition": point}
        if not k:
            kind, given = items.SensorNode, {"nodeNumber": self.node}
        kept = {"storeInternal": True, "writeToFile": False}
        kinds = [getattr(exu.OutputVariableType, name) for name in (MEASURED if k else COORDINATES)]
        return [self.mbs.AddSensor(kind(**given, **kept, outputVariableType=one)) for one in kinds]

    def measured(self, sensor):
        """What a sensor measured, without samples behind the first that the run did not hit."""
        every = self.mechanism.count * self.mechanism.step
        rows = np.atleast_2d(self.mbs.GetSensorStoredData(sensor))[: self.mechanism.samples]
        late = np.abs(rows[:, 0] - every * np.arange(len(rows))) > 0.5 * self.mechanism.step
        return rows[: int(np.argmax([*late, True])), 1:]

    def solve(self, settings, steps, step, full=False, first=False):
        """Solve from the start; the engine sets the accelerations there if it is the `first`."""
        wanted = exu.SimulationSettings()
        time, newton = wanted.timeIntegration, wanted.timeIntegration.newton
        time.numberOfSteps, time.endTime, time.verboseMode = steps, steps * step, 0
        wanted.solution.file.write, rule = False, time.generalizedAlpha
        wanted.solution.sensors.writePeriod = self.mechanism.count * step
        if not settings["defaults"]:
            newton.relativeTolerance = newton.absoluteTolerance = 1e-10
            newton.residualMode, newton.useModifiedNewton = 1, False  # tolerances of increments
            rule.useNewmark = rule.useIndex2Constraints = settings["scheme"] == "trapezoidal"
            rule.computeInitialAccelerations, rule.resetAccelerations = first, False
        if full:
            wanted.linearSolver.solverType = exu.LinearSolverType.EigenDense
            wanted.linearSolver.ignoreSingularJacobian = True
        self.mbs.SolveDynamic(wanted, showCausingItems=False)

    def run(self, settings, full):
        """Solve for all samples, if possible, and return whether it came to the end."""
        system, short = self.mbs.systemData, SHORT_SHARE * self.mechanism.step
        start = exu.ConfigurationType.Initial
        try:
            if not settings["defaults"]:
                rates = [system.GetODE2Coordinates_t(start)]
                for steps in (1, 2):
                    self.solve(settings, steps, short, full, first=True)
                    rates.append(system.GetODE2Coordinates_t())
                change = (4.0 * rates[1] - 3.0 * rates[0] - rates[2]) / (2.0 * short)
                system.SetODE2Coordinates_tt(change, start)
            self.solve(settings, self.mechanism.steps, self.mechanism.step, full)
        except RuntimeError:
            return False
        return True


def tree_link(row):
    """A link of the tree with the spring and the damper of its joint."""
    inertia = RigidBodyInertia(row.mass, row.inertia).Translated(row.centre)
    kind = exu.JointType.RevoluteZ if row.joint.kind == "hinge" else exu.JointType.PrismaticZ
    place = exu.HT(rotation=row.turn, translation=row.place)
    return TreeLink(inertia, kind, place, row.up, (float(row.joint.acting[0]), row.joint.damping))


def pull_of(spring):
    """A function for Exudyn of a spring, which gets the length beyond its lower slack."""
    return lambda mbs, t, item, longer, rate, *_: spring.pull(longer + spring.slack[0], rate)


def simulate(mechanism: NeutralMechanism, settings: dict) -> LinkStates:
    """The states at the samples, as Exudyn's sensors measure them."""
    system, states = ExudynSystem(mechanism), LinkStates.empty(mechanism)
    with Stopwatch() as watch:
        if not system.run(settings, False) and not settings["defaults"]:
            states.notes = ("Solved by full pivoting, as is needed at redundant constraints.",)
            system.run(settings, True)
    states.seconds, n = watch.seconds, mechanism.samples
    for k, own in enumerate(system.sensors[1:], 1):
        for name, sensor in zip(ROWS, own):
            data = system.measured(sensor)
            n = len(data)
            axes = system.local(k, np.zeros(3))[1].T
            getattr(states, name)[:n, k] = data.reshape(-1, 3, 3) @ axes if name == "turn" else data
    single = [one.kind in ("hinge", "slide") for one in mechanism.joints]
    states.coordinates = np.full((3, mechanism.samples, len(single)), np.nan)
    for row, sensor in zip(states.coordinates, system.sensors[0]):
        row[:n, single] = system.measured(sensor)
    states.coordinates[0] += [one.value for one in mechanism.joints]
    return states if n == mechanism.samples else states.first(n, "the solver does not converge")
