"""A model's own motion, solved in several ways: with finer and finer steps, and without steps.

A model without a sidecar starts from its key, or from its initial pose, with the controls of the
key.  Its equations of motion are those of MuJoCo, with the soft contacts, loops and limits of the
model.  They are solved

* with the model's integrator and step, and with 1/2, 1/4, 1/8, .. of that step;
* by DOP853, which integrates the accelerations of ``mj_forward`` and chooses its steps by an error
  tolerance, with two tolerances;
* once more with a start pose that differs by 1e-9 of the model's size, with a step that converges;
  and with the model's own step from such a pose and speeds: in a start in balance, such as that of
  servos at their targets, a step that is too long is not noticed otherwise;
* with other settings that a user might try: Euler, implicitfast and RK4 with the model's step and
  finer ones, of which the caller chooses, and contacts and loops with time constants that are four
  times as short.

Joints may be driven.  As in a run (`proofmass.sim.mujoco.dynamics`) they have flywheels, which are
part of the equations: 1e9 times the load inertia of the drive in the start pose, so that the motion
differs from an exactly prescribed one by a share of 1e-9.  Without steps the driven joints follow
their motion profiles exactly; with steps each gets the mean acceleration of its profile over the
step.

`proofmass.reference.self_consistency` judges the results.
"""

import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from math import nan
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.controls import break_times, smooth_pieces
from proofmass.base.arrays import Array
from proofmass.base.clock import processor_time
from proofmass.base.wording import number
from proofmass.sim.contents import control_indices
from proofmass.sim.mjcf import (
    collected_warnings,
    compile_model,
    failure_warning,
    warning_notes,
)
from proofmass.sim.mujoco.dynamics import FLYWHEEL_RATIO, initialize_dynamics, moments_of_drives
from proofmass.sim.mujoco.linkage import Linkage
from proofmass.sim.mujoco.model import Recorder, load, prepare_model, translate_fatal_errors
from proofmass.sim.mujoco.sensors import (
    drive_moment_curves,
    drive_sensors,
    withhold_drives,
    withhold_interactions,
)
from proofmass.sim.mujoco.settings import mjcf_text
from proofmass.sim.mujoco.work import StepWork
from proofmass.sim.openings import largest_opening_of
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import NotSolved
from proofmass.sim.protocol.own_equations import (
    STIFFENING_FACTOR,
    ChooseWays,
    OwnEquations,
    OwnMotion,
    OwnRun,
    UntriedWay,
    choose_none,
)
from proofmass.sim.protocol.run import ChangingLoad, Drive, Run
from proofmass.sim.start import start_state

MAX_HALVINGS, MIN_HALVINGS = 6, 3
"""Largest and smallest number of halvings of the step."""
MAX_RESCUES = 8
"""Halvings of the step after which a model that fails is not tried with a finer one."""
MAX_WORK = 300.0
"""Largest counted processor time of a motion without steps that serves as a reference [s]."""
SLOWNESS = 20.0
"""Ratio of the processor time to the counted one beyond which a way to solve a motion is ended: the
machine is far slower than that of `proofmass.sim.mujoco.work`, or steps cost far more than
counted."""
MIN_SLOW_SECONDS = 60.0
"""Processor time [s] before which no way is ended for that: the first one loads SciPy."""
PYTHON_SECONDS = 4e-5
"""Counted processor time that DOP853 needs for each evaluation besides that of MuJoCo [s]."""
NARROW_TOLERANCE, WIDE_TOLERANCE = 1e-9, 1e-6
"""Narrow and wide error tolerance of DOP853, relative and in SI units."""
POSE_DISTURBANCE = 1e-9
"""Change of the start pose, as a share of the model's size and in rad."""
TRIED_INTEGRATORS = (
    mujoco.mjtIntegrator.mjINT_EULER,
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    mujoco.mjtIntegrator.mjINT_RK4,
)
"""Integrators that are tried beside the model's own."""
SOFTENED = (
    "geom_solref",
    "pair_solref",
    "eq_solref",
    "jnt_solref",
    "tendon_solref_lim",
    "dof_solref",
    "tendon_solref_fri",
)
"""Arrays of the time constants of contacts, loops, limits and dry friction."""
RUBBING = "dof_solimp", "tendon_solimp_fri"
"""Arrays of the impedances of dry friction, whose share that gives way is divided as well: creep is
proportional to it, and ``refsafe`` may leave the time constant as it is."""
MAX_BODIES_OF_THREE_POINTS = 60
"""Largest number of bodies of which three points each are recorded; of more, one point each."""
TIME_SHARES = {"steps": 0.4, "close": 0.25, "rough": 0.1, "disturbed": 0.1, "others": 0.15}
"""Shares of the counted processor time for the ways to solve a motion."""


class OutOfTime(Exception):
    """The processor time for one way to solve a motion is over."""


class Budget:
    """The processor time of one way to solve a motion, counted as in `proofmass.sim.mujoco.work`.

    Parameters
    ----------
    limit : float
        Largest counted processor time [s]; the real one may be `SLOWNESS` times as long.
    """

    def __init__(self, limit: float) -> None:
        self.limit, self.work, self.began = limit, 0.0, processor_time()

    @property
    def seconds(self) -> float:
        """The processor time since the beginning [s]."""
        return processor_time() - self.began

    def spend(self, work: float) -> None:
        """Count work [s].

        Raises
        ------
        OutOfTime
            A limit is reached.
        """
        self.work += work
        if self.work > self.limit:
            raise OutOfTime(f"its steps reached {self.limit:.3g} s of counted processor time")
        if (used := self.seconds) > max(MIN_SLOW_SECONDS, SLOWNESS * self.limit):
            raise OutOfTime(
                f"it used {used:.3g} s of processor time for steps that count {self.work:.3g} s"
            )


@dataclass
class MotionRecord:
    """Record of a run: points, energy, penetration and constraint violation at each sample."""

    points: Callable[[mujoco.MjData], Array]
    inputs: "InputsInTime"
    rows: list[Array] = field(default_factory=list)
    energy: list[float] = field(default_factory=list)
    depth: list[float] = field(default_factory=list)
    gap: list[float] = field(default_factory=list)
    opening_unit: str = ""

    def sample(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Record the present state, with the contacts and the loops of the last forward pass.

        Raises
        ------
        FloatingPointError
            The state is not finite.
        """
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)  # a step leaves the inertia matrix of its beginning
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        row = self.points(data)
        if not np.isfinite(row).all():
            raise FloatingPointError("not finite")
        opening = largest_opening_of(model, data)
        self.opening_unit = self.opening_unit or opening.unit
        self.rows.append(row)
        self.energy.append(float(data.energy.sum()) - self.inputs.energy(data))
        self.depth.append(max(0.0, -float(data.contact.dist.min(initial=0.0))))
        self.gap.append(opening.size)

    def run(
        self,
        name: str,
        step: float,
        budget: Budget,
        stopped: Exception | None = None,
        evaluations: float = nan,
    ) -> OwnRun:
        """The record as an `OwnRun`; `stopped` is the exception that ended it early."""
        return OwnRun(
            name,
            step,
            budget.seconds,
            np.array(self.rows),
            np.array(self.energy),
            np.array(self.depth),
            np.array(self.gap),
            str(stopped or ""),
            isinstance(stopped, OutOfTime),
            budget.work,
            evaluations,
            self.opening_unit,
        )


@dataclass(frozen=True)
class InputsInTime:
    """Inputs of a model in time: driven joints, and controls that change.

    Attributes
    ----------
    run : Run
        The run with the drives and loads.
    adr, dofs : ndarray (drives,)
        Indices of the driven joints in ``qpos`` and in ``qvel``.
    flywheels : ndarray (drives,)
        Inertias of the flywheels, which were added to the armatures [kg m^2 or kg].
    places : ndarray (loads,)
        Indices of the controls that change in ``ctrl``.
    """

    run: Run
    adr: NDArray[np.int32]
    dofs: NDArray[np.int32]
    flywheels: Array
    places: NDArray[np.int32]

    @classmethod
    def begin_run(cls, model: mujoco.MjModel, run: Run, linkage: Linkage | None) -> "InputsInTime":
        """The inputs of a run; the model gets the first pose of its drives, and the flywheels.

        Without drives `linkage` is None and the model stays as it is.
        """
        places = control_indices(model, (one.actuator for one in run.loads))
        loads = np.array(places, np.int32)
        if linkage is None:
            none = np.zeros(0, np.int32)
            return cls(run, none, none, np.zeros(0), loads)
        before = model.dof_armature[linkage.dofs].copy()
        initialize_dynamics(linkage, run, run.x)
        wheels = model.dof_armature[linkage.dofs] - before
        return cls(run, linkage.adr, linkage.dofs, wheels, loads)

    @property
    def any(self) -> bool:
        """Whether there are driven joints or changing controls."""
        return bool(self.dofs.size or self.places.size)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times at which a derivative of a motion profile or of a control jumps [s]."""
        drives, loads = self.run.drives, self.run.loads
        return break_times([*(one.profile for one in drives), *(one.profile for one in loads)])

    def energy(self, data: mujoco.MjData) -> float:
        """Kinetic energy of the flywheels [J]."""
        return float(0.5 * self.flywheels @ data.qvel[self.dofs] ** 2)

    def apply(self, data: mujoco.MjData, t: float) -> None:
        """Set the driven joints by their motion profiles at time `t` [s], and set the controls."""
        if self.dofs.size:
            value, rate, acceleration = (p[:, 0] for p in self.run.motion(np.array([t])))
            data.qpos[self.adr], data.qvel[self.dofs] = value, rate
            data.qfrc_applied[self.dofs] = self.flywheels * acceleration
        if self.places.size:
            data.ctrl[self.places] = self.run.controls(np.array([t]))[0][:, 0]

    def step(self, model: mujoco.MjModel, data: mujoco.MjData, count: int) -> None:
        """Take `count` steps, each with its own torques and controls."""
        h = float(model.opt.timestep)
        times = data.time + h * np.arange(count + 1)
        torque = self.flywheels * np.diff(self.run.motion(times)[1].T, axis=0) / h
        for push, control in zip(torque, self.run.controls(times[:-1] + h / 2)[0].T, strict=True):
            data.qfrc_applied[self.dofs], data.ctrl[self.places] = push, control
            mujoco.mj_step(model, data)


class MujocoOwnEquations(OwnEquations):
    """Solutions of the equations of motion of MuJoCo; see the module."""

    def solve_motion(
        self,
        model: Path | mujoco.MjModel,
        until: float,
        samples: int,
        seconds: float,
        start: str = "start",
        drives: tuple[Drive, ...] = (),
        loads: tuple[ChangingLoad, ...] = (),
        choose: ChooseWays = choose_none,
    ) -> OwnMotion:
        """See `OwnEquations.solve_motion`; `proofmass.sim.mujoco.work` counts the time."""
        run = Run("passive", np.array([0.0, until]), (), drives, start, loads=loads)
        with translate_fatal_errors(), collected_warnings() as warned:
            compiled = compile_model(model) if isinstance(model, Path) else copy.copy(model)
            found = solve_in_several_ways(compiled, run, samples, seconds, choose)
        return replace(found, notes=warning_notes(compiled, warned) if warned else ())

    def solve_closely(self, path: Path, run: Run) -> Curves:
        """Solve a motion by DOP853 with a tolerance of 1e-9, and read all sensors at all samples.

        Loops are closed at the start as in a run with steps, see `proofmass.sim.mujoco.dynamics`.

        Raises
        ------
        BadModel
            The model does not compile, or lacks a named element.
        Unsupported
            A model with drives has an equality other than connect and joint.
        NotSolved
            A value is not finite, or the processor time is over.
        """
        with translate_fatal_errors():
            return solve_without_fixed_steps(path, run)


def solve_in_several_ways(
    model: mujoco.MjModel,
    run: Run,
    samples: int,
    seconds: float,
    choose: ChooseWays = choose_none,
) -> OwnMotion:
    """Solve a passive run with finer and finer steps, without steps, and with changes.

    The samples are whole steps apart.  The model is prepared in place.  `choose` chooses and solves
    ways with other integrators.
    """
    until = float(run.x[-1])
    model, data = prepare_model(model, run)
    linkage = Linkage(model, data, tuple(one.joint for one in run.drives)) if run.drives else None
    inputs = InputsInTime.begin_run(model, run, linkage)
    step, own = float(model.opt.timestep), mujoco.mjtIntegrator(model.opt.integrator)
    count = max(1, round(until / (samples - 1) / step))
    intervals = max(1, round(until / (count * step)))
    times = np.linspace(0.0, intervals * count * step, intervals + 1)
    points = point_reader(model)

    def stepped(
        name: str,
        parts: int,
        limit: float,
        n: int,
        begin: mujoco.MjData = data,
        **changed: Any,
    ) -> OwnRun:
        return solve_by_steps(
            copy_with_changes(model, step / parts, **changed),
            copy.copy(begin),
            MotionRecord(points, inputs),
            n,
            count * parts,
            name,
            limit,
        )

    limit = {way: share * seconds for way, share in TIME_SHARES.items()}

    beside = disturb_start(model, data, inputs.dofs)
    moving = disturb_start(model, data, inputs.dofs, rates=True)

    def halved(k: int, n: int) -> OwnRun:
        return stepped(format_integrator(own, step / 2**k), 2**k, limit["steps"], n)

    def tried(k: int) -> OwnRun:
        """A run; or one from a start beside it that fails, which a start in balance hides."""
        run = halved(k, times.size)
        if run.is_failure:
            return run
        other = stepped(run.name, 2**k, limit["disturbed"], times.size, moving)
        if other.is_failure and not other.late:
            words = f"from a start that differs by {number(POSE_DISTURBANCE)}: {other.stopped}"
            return replace(other, stopped=words)
        return run

    as_given = tried(0)
    begin, first = 0, as_given
    if as_given.is_failure and not as_given.late:  # a stiff model may run with finer steps
        finer = ((k, tried(k)) for k in range(1, MAX_RESCUES + 1))
        begin, first = next(((k, one) for k, one in finer if not one.is_failure), (0, as_given))
    runs = [first]
    halvings, n = affordable_halvings(first, limit["steps"])
    runs += [halved(begin + k, n) for k in range(1, halvings + 1)]
    close, rough = (
        solve_without_steps(
            model, data, MotionRecord(points, inputs), times[:n], allowed, limit[way]
        )
        for way, allowed in (("close", NARROW_TOLERANCE), ("rough", WIDE_TOLERANCE))
    )
    k = max((k for k, one in enumerate(runs) if one.work < limit["disturbed"]), default=0)
    parts = 2 ** (begin + k)
    other = stepped("disturbed", parts, limit["disturbed"], n, beside)
    stiffer = None
    rubs = model.dof_frictionloss.any() or model.tendon_frictionloss.any()
    if runs[k].depth.any() or model.neq or model.jnt_limited.any() or rubs:
        stiffer = stepped("stiffer", parts, limit["others"], n, stiffer=STIFFENING_FACTOR)
    motion = OwnMotion(
        times,
        float(model.stat.extent),
        tuple(runs),
        close,
        rough,
        k,
        other,
        (),
        stiffer,
        int(model.nv),
        failed=as_given if begin else None,
    )

    evaluations = {
        integrator: StepWork(copy_with_changes(model, step, integrator)).evaluations
        for integrator in TRIED_INTEGRATORS
        if integrator != own
    }

    def way(integrator: mujoco.mjtIntegrator, finer: int) -> UntriedWay:
        parts = 2 ** (begin + finer)

        def solve(seconds: float) -> OwnRun:
            name = format_integrator(integrator, step / parts)
            return stepped(name, parts, seconds, n, integrator=integrator)

        return UntriedWay(evaluations[integrator] * parts / step, solve, limit["others"])

    untried = [
        way(integrator, finer) for finer in range(MAX_HALVINGS + 1) for integrator in evaluations
    ]
    return replace(motion, others=choose(motion, untried))


def affordable_halvings(own: OwnRun, limit: float) -> tuple[int, int]:
    """Number of halvings of the step that fit into a counted time [s], and number of samples.

    If not even `MIN_HALVINGS` halvings of the whole run fit, fewer samples are computed.

    >>> none = np.zeros((101, 1, 1, 3))
    >>> run = OwnRun("Euler, 2 ms", 2e-3, 0.1, none, *3 * (np.zeros(101),), work=0.1)
    >>> affordable_halvings(run, 10.0), affordable_halvings(run, 4.0), affordable_halvings(run, 0.5)
    ((5, 101), (4, 101), (3, 36))
    """
    samples = len(own.points)
    for halvings in range(MAX_HALVINGS, MIN_HALVINGS - 1, -1):
        if own.work * (2 ** (halvings + 1) - 2) <= limit:
            return halvings, samples
    return MIN_HALVINGS, max(2, int(samples * limit / (own.work * (2 ** (MIN_HALVINGS + 1) - 2))))


def format_integrator(integrator: mujoco.mjtIntegrator, step: float) -> str:
    """Name of an integrator with its step.

    >>> format_integrator(mujoco.mjtIntegrator.mjINT_EULER, 0.002)
    'Euler, 2 ms'
    """
    return f"{mjcf_text(integrator.name.removeprefix('mjINT_'))}, {1e3 * step:.4g} ms"


def copy_with_changes(
    model: mujoco.MjModel,
    step: float,
    integrator: mujoco.mjtIntegrator | None = None,
    stiffer: float = 1.0,
) -> mujoco.MjModel:
    """A copy with another step [s], another integrator, and constraints that are stiffer.

    Their time constants are divided by `stiffer`, and the share of dry friction that gives way.
    """
    changed = copy.copy(model)
    if step != model.opt.timestep:
        disable_sleep(changed)
    changed.opt.timestep = step
    if integrator is not None:
        changed.opt.integrator = integrator
    if stiffer != 1.0:
        for name in SOFTENED:
            soft = getattr(changed, name)
            soft[:, 0] = np.where(soft[:, 0] > 0, soft[:, 0] / stiffer, soft[:, 0] * stiffer**2)
            soft[:, 1] = np.where(soft[:, 0] > 0, soft[:, 1], soft[:, 1] * stiffer)
        for name in RUBBING:
            impedance = getattr(changed, name)[:, :2]
            impedance[:] = 1.0 - (1.0 - impedance) / stiffer
    return changed


def disturb_start(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    driven: NDArray[np.int32],
    rates: bool = False,
) -> mujoco.MjData:
    """A copy of the start with each undriven coordinate moved by a random share of 1e-9.

    With `rates` each speed differs by the same number, per second.
    """
    start = copy.copy(data)
    if model.nv:
        shares = np.random.default_rng(20).uniform(-1.0, 1.0, model.nv)
        slides = np.isin(model.jnt_type, (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_FREE))
        for joint in np.flatnonzero(slides):
            first = model.jnt_dofadr[joint]
            last = first + (3 if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE else 1)
            shares[first:last] *= model.stat.extent
        shares[driven] = 0.0
        mujoco.mj_integratePos(model, start.qpos, shares, POSE_DISTURBANCE)
        if rates:
            start.qvel[:] += POSE_DISTURBANCE * shares
    return start


def point_reader(model: mujoco.MjModel) -> Callable[[mujoco.MjData], Array]:
    """A function that gives three points of each movable body in a state (bodies, 3 points, 3) [m].

    The points are the centre of mass and two points at a radius of gyration from it.  With more
    than `MAX_BODIES_OF_THREE_POINTS` bodies it gives the centre alone (bodies, 1, 3).
    """
    moving = np.flatnonzero(model.body_weldid[: model.nbody] > 0)
    inertia, mass = model.body_inertia[moving], model.body_mass[moving]
    radius = np.sqrt(inertia.sum(axis=1) / np.maximum(2.0 * mass, 1e-300))
    radius = np.where(mass > 0, np.minimum(radius, model.stat.extent), 0.0)

    def centres(data: mujoco.MjData) -> Array:
        return data.xipos[moving][:, None, :].copy()

    def three(data: mujoco.MjData) -> Array:
        centre = data.xipos[moving]
        axes = data.ximat[moving].reshape(-1, 3, 3)
        return np.stack(
            [centre, *(centre + radius[:, None] * axes[:, :, k] for k in (0, 1))], axis=1
        )

    return three if moving.size <= MAX_BODIES_OF_THREE_POINTS else centres


def solve_by_steps(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    record: MotionRecord,
    samples: int,
    count: int,
    name: str,
    limit: float,
) -> OwnRun:
    """Step through all samples, `count` steps apart, for at most `limit` of counted time [s]."""
    budget, work, step = Budget(limit), StepWork(model), float(model.opt.timestep)
    stopped: Exception | None = None
    stride = max(1, min(count, 100))
    with collected_warnings():
        record.inputs.apply(data, float(data.time))
        mujoco.mj_forward(model, data)
        try:
            record.sample(model, data)
            for _ in range(samples - 1):
                left = count
                while left:
                    if record.inputs.any:
                        record.inputs.step(model, data, min(left, stride))
                    else:
                        mujoco.mj_step(model, data, min(left, stride))
                    budget.spend(min(left, stride) * work.step(data))
                    left -= min(left, stride)
                if words := failure_warning(data):
                    raise FloatingPointError(words)
                record.sample(model, data)
        except (OutOfTime, FloatingPointError) as error:
            stopped = error
    return record.run(name, step, budget, stopped, work.evaluations / step)


def solve_without_steps(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    record: MotionRecord,
    times: Array,
    tolerance: float,
    limit: float,
) -> OwnRun:
    """Integrate the accelerations of ``mj_forward`` by DOP853, in a counted time `limit` [s]."""
    model, data, inputs = copy.copy(model), copy.copy(data), record.inputs
    make_step_independent(model, inputs)
    budget = Budget(limit)
    stopped: Exception | None = None
    with collected_warnings(), np.errstate(all="ignore"):  # values that are not finite are reported
        mujoco.mj_forward(model, data)
        try:
            for t, state in integrate_states(model, data, times, tolerance, budget, inputs):
                set_state(model, data, t, state)
                inputs.apply(data, t)
                mujoco.mj_forward(model, data)
                record.sample(model, data)
        except (OutOfTime, FloatingPointError) as error:
            stopped = error
    return record.run(f"DOP853 at {tolerance:.0e}".replace("e-0", "e-"), 0.0, budget, stopped)


def disable_sleep(model: mujoco.MjModel) -> None:
    """Switch sleeping off, since it depends on a number of steps at rest, whatever their size."""
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)


def make_step_independent(model: mujoco.MjModel, inputs: "InputsInTime | None" = None) -> None:
    """Make accelerations depend on the state alone, and have them solved to rounding.

    MuJoCo scales the tolerance of its solver by the mean inertia, to which flywheels contribute
    most.
    """
    disable_sleep(model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_REFSAFE  # it depends on the step
    model.opt.tolerance = 1e-14 / (FLYWHEEL_RATIO if inputs and inputs.dofs.size else 1.0)


def solve_without_fixed_steps(path: Path, run: Run) -> Curves:
    """The curves of `MujocoOwnEquations.solve_closely`."""
    model, data = load(path, run)
    linkage = Linkage(model, data, tuple(one.joint for one in run.drives))
    record = Recorder(model, data, run.channels, run.x.size)
    missing = withhold_interactions(record) | withhold_drives(model, linkage, record)
    if drive_sensors(model, linkage, record):
        record.record_forces()
    own = model.dof_armature[linkage.dofs].copy(), model.dof_damping[linkage.dofs].copy()
    if not run.drives:
        linkage.release(*start_state(model, run))
    inputs = InputsInTime.begin_run(model, run, linkage if run.drives else None)
    make_step_independent(model, inputs)
    budget = Budget(MAX_WORK)
    with collected_warnings(), np.errstate(all="ignore"):
        try:
            for k, (t, state) in enumerate(
                integrate_states(model, data, run.x, NARROW_TOLERANCE, budget, inputs)
            ):
                set_state(model, data, t, state)
                inputs.apply(data, t)
                mujoco.mj_forward(model, data)
                record.sample(k)
        except (OutOfTime, FloatingPointError) as error:
            raise NotSolved(str(error)) from None
    curves = record.curves()
    if "qfrc_inverse" in record.rows:
        moments = moments_of_drives(record.rows, linkage.dofs, *own)
        curves |= drive_moment_curves(model, linkage, record, moments)
    return Curves(run.x, curves, missing, seconds=budget.seconds)


def integrate_states(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    times: Array,
    tolerance: float,
    budget: Budget,
    inputs: InputsInTime,
) -> Iterator[tuple[float, Array]]:
    """Time and state (poses, rates, activations) at each sample; DOP853 restarts at each break."""
    from scipy.integrate import DOP853  # slow to load

    turn, last, work = CoordinateRates(model), np.inf, StepWork(model)

    def slope(t: float, state: Array) -> Array:
        set_state(model, data, t, state)
        inputs.apply(data, min(t, last))
        mujoco.mj_forward(model, data)
        return np.concatenate([turn.rates(data.qpos, data.qvel), data.qacc, data.act_dot])

    state = np.concatenate([data.qpos, data.qvel, data.act])
    if not state.size:
        yield from ((float(t), state) for t in times)
        return
    yield float(times[0]), state
    k = 1
    for start, end, before in smooth_pieces(float(times[0]), float(times[-1]), inputs.breaks):
        last = before
        solver, evaluations = DOP853(slope, start, state, end, rtol=tolerance, atol=tolerance), 0
        while solver.status == "running":
            words = solver.step()
            budget.spend((solver.nfev - evaluations) * (work.evaluation(data) + PYTHON_SECONDS))
            evaluations = solver.nfev
            if solver.status == "failed":
                raise FloatingPointError(str(words))
            if k < times.size and times[k] <= solver.t:
                inside = solver.dense_output()
                while k < times.size and times[k] <= solver.t:
                    yield float(times[k]), inside(times[k])
                    k += 1
        state = solver.y


def set_state(model: mujoco.MjModel, data: mujoco.MjData, t: float, state: Array) -> None:
    """Set time and state of a model, with quaternions normalized."""
    data.time = t
    data.qpos[:], data.qvel[:] = state[: model.nq], state[model.nq : model.nq + model.nv]
    data.act[:] = state[model.nq + model.nv :]
    mujoco.mj_normalizeQuat(model, data.qpos)


class CoordinateRates:
    """Time derivatives of coordinates: for quaternions half their product with the rates."""

    def __init__(self, model: mujoco.MjModel) -> None:
        quaternions, scalars, rates, turns = list[int](), list[int](), list[int](), list[int]()
        for kind, pose, dof in zip(
            model.jnt_type, model.jnt_qposadr, model.jnt_dofadr, strict=True
        ):
            ball = kind == mujoco.mjtJoint.mjJNT_BALL
            free = kind == mujoco.mjtJoint.mjJNT_FREE
            plain = 0 if ball else 3 if free else 1
            scalars += range(pose, pose + plain)
            rates += range(dof, dof + plain)
            if ball or free:
                quaternions.append(pose + plain)
                turns.append(dof + plain)
        self.scalars, self.rates_of = np.array(scalars, int), np.array(rates, int)
        self.quaternions, self.turns = quaternions, turns

    def rates(self, pose: Array, speed: Array) -> Array:
        """Time derivatives (poses,) of the coordinates for the rates `speed` of a model."""
        found = np.empty_like(pose)
        found[self.scalars] = speed[self.rates_of]
        for q, v in zip(self.quaternions, self.turns, strict=True):
            w, x, y, z = pose[q : q + 4].tolist()  # few numbers are faster than arrays
            a, b, c = speed[v : v + 3].tolist()
            found[q : q + 4] = (
                0.5 * (-x * a - y * b - z * c),
                0.5 * (w * a + y * c - z * b),
                0.5 * (w * b + z * a - x * c),
                0.5 * (w * c + x * b - y * a),
            )
        return found
