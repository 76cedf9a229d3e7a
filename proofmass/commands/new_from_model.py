"""``proofmass new NAME --from MODEL.xml``: a sidecar for a model that has none, found by measuring.

The reference is the general planar solver, if it covers the model.  It gives the number of degrees
of freedom, and how far each joint can be driven.  With one degree of freedom the best of the joints
is the drive.  With more of them, and an actuator on one joint only, that joint is driven in a sweep
if springs keep the other joints in equilibrium; otherwise the run is a free motion.  A model that
the planar solver does not cover has a free motion as well: its reference is that for motions in
space if it covers the model, and otherwise the model's own equations, solved closely, as far as the
motion is known.

Then all runs are made in all engines.  Runs that an engine does not cover are left out, with the
reason as a comment.  Comments give the error of each run as well, and a run in time whose error
exceeds its engine's tolerance gets a finer step.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from math import ceil, floor, inf, isfinite, isnan, log10
from pathlib import Path

import numpy as np
from mujoco import MjModel

from proofmass.analytic import spatial
from proofmass.analytic.numerics import TURN
from proofmass.analytic.planar import Branch, Mechanism, read, solve
from proofmass.analytic.planar.kinematics import count_dof, nearest_pose
from proofmass.analytic.planar.mechanism import (
    PlanarJoint,
    PointSpring,
    SumSpring,
)
from proofmass.analytic.planar.support import SUPPORT
from proofmass.analytic.support import RunKind, refuse, refuse_contacts
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.files import read_text, write_atomically
from proofmass.base.strict import Kind
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut, call_isolated
from proofmass.batch.check import read_isolated, run_solver
from proofmass.batch.work import OWN_MODEL_SAMPLES, compare_and_share
from proofmass.reference.model_run import smooth_terms
from proofmass.reference.self_consistency import PROCESSOR_SECONDS, Rung, why_failed
from proofmass.run.sidecar import DEFAULT_SAMPLES
from proofmass.sim.contents import (
    bodies_rotating_in_space,
    joint_of,
    joints,
    key_names,
    mechanism_dof,
    moves_by_itself,
    place_sensors,
    sensor_names,
    sensors_of_drive,
)
from proofmass.sim.engines import NATIVE_ENGINE, default_engines, engine_of
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.failures import BadModel, NotSolved, Unsupported
from proofmass.sim.protocol.run import fitting_samples
from proofmass.verdict.compare import passes_unmoved
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import Outcome

INSPECTION_SECONDS = 240.0
"""Wall time to compile a model, and to drive its joints or to solve its motion closely [s]."""
DRIVEN_SHARE = 0.9
"""Share of a joint's distance to its limit position that is driven, to stay before it."""
MIN_DRIVEN_SHARE = 0.01
"""Least distance of a drive, as a share of a turn or of the mechanism's size."""
TRIED_SHARES = 1.0, 0.5, 0.25, 0.1, 0.05  # shares of a distance that are tried if springs act
FREE_MOTION_SECONDS = 1.0  # s, duration of a free motion
MIN_TOLERANCE_SHARE = 1e-12
"""Least tolerance that is proposed, as a share of a curve's range: the rounding of another machine,
which adds up over the steps."""
TOLERANCE_FACTOR = 3.0
"""Proposed tolerance over the measured error: other rounding, a slightly longer motion."""
REFERENCE_COMMENTS = {
    "planar": "reads the numbers of the model: a wrong one is wrong in both",
    "spatial": "reads the numbers of the model: a wrong one is wrong in both",
    "refined": "the model's own equations, solved closely: it judges the time stepping alone",
}
COMPARE_ERRORS_ONLY = partial(compare_and_share, detectable=False)
NOTHING_MOVES = (
    "nothing moves: it starts at rest, and no force acts on its joints; give its key rates (qvel) "
    "or controls (ctrl), or write a sidecar with a [[drive]] for each degree of freedom"
)
FAR_OFF_TOLERANCE = 0.08
"""Tolerance, as a share of the range, for a channel that is off so far that a curve that does not
move would pass with `TOLERANCE_FACTOR` times its error: less than any such error, which is at least
0.5 / (2 * 3) of the range, as `round_up` doubles a number at most.  So the channel differs."""
START_MARGIN = 1e-9
"""Largest distance of a start pose from a joint's range that is rounding, in turns or sizes."""
STEP_DIVISORS = 2, 4  # divisors of the model's step, if the error with that is too large
KNOWN_SHARE = 0.9
"""Share of the time until which a motion is known, since other samples may give less."""
SENSOR_TEMPLATES = {
    "jointpos": '<jointpos name="{name}" joint="{name}"/>',
    "jointvel": '<jointvel name="{name}_rate" joint="{name}"/>',
    "framepos": '<framepos name="{name}" objtype="site" objname="{name}"/>',
    "framelinvel": '<framelinvel name="{name}_velocity" objtype="site" objname="{name}"/>',
    "body": '<framepos name="{name}_place" objtype="body" objname="{name}"/>',
    "quat": '<framequat name="{name}_turn" objtype="body" objname="{name}"/>',
    "linear": '<framelinvel name="{name}_velocity" objtype="body" objname="{name}"/>',
    "angular": '<frameangvel name="{name}_rate" objtype="body" objname="{name}"/>',
}


@dataclass(frozen=True)
class JointRange:
    """The range in which a joint can be driven while the other joints follow.

    Attributes
    ----------
    joint : str
        The name of the joint.
    start, low, high : float
        Its value in the start pose, and both ends of the range [rad or m].
    share : float
        The longer side of the range as a share of a turn, or of the mechanism's size [1].
    turns, motor, grounded : bool
        Whether it makes a whole turn, whether an actuator drives it, and whether its body is joined
        to the ground.
    """

    joint: str
    start: float
    low: float
    high: float
    share: float
    turns: bool
    motor: bool
    grounded: bool

    @property
    def rank(self) -> tuple[bool, bool, bool, float]:
        """The order of preference: a motor, a whole turn, a joint on the ground, a long range."""
        return self.motor, self.turns, self.grounded, self.share

    @property
    def way(self) -> tuple[float, float]:
        """First and last value of the drive: that of the start pose, and one on the longer side."""
        if self.turns:
            return self.start, self.start + TURN
        end = max(self.low, self.high, key=lambda end: abs(end - self.start))
        return self.start, self.start + DRIVEN_SHARE * (end - self.start)


@dataclass(frozen=True)
class ModelSummary:
    """The properties of a model, and the run and reference that are proposed for it.

    Attributes
    ----------
    start : str
        The key with the start pose; empty if the model has none.
    dof : int
        The number of degrees of freedom.
    drive : JointRange or None
        The range of the best joint to drive; None if none can be driven, and in a free motion.
    sensors : tuple of str
        Names of the model's sensors.
    placed : bool
        Whether a sensor with a name measures a position or an orientation other than that of the
        drive, at which the reference is evaluated, so that nothing is checked by it.
    joints, sites, bodies : tuple of str
        Names of elements that can be measured: hinges and slides, sites, and bodies on ball joints
        and free joints.
    timestep : float
        The model's time step [s].
    moves : bool
        Whether it moves from its start pose without a drive.
    reference : str
        The reference of the motion.
    until : float
        Duration of a free motion [s].
    why : str
        Why the references before this one do not cover the model; empty for the first reference.
    """

    start: str
    dof: int
    drive: JointRange | None
    sensors: tuple[str, ...]
    placed: bool
    joints: tuple[str, ...]
    sites: tuple[str, ...]
    bodies: tuple[str, ...]
    timestep: float
    moves: bool
    reference: str = "planar"
    until: float = FREE_MOTION_SECONDS
    why: str = ""

    @property
    def samples(self) -> int:
        """Number of samples of a free motion that whole steps of the model lead to."""
        return fitting_samples(self.until, self.timestep, DEFAULT_SAMPLES)

    @property
    def is_determined(self) -> bool:
        """Whether a drive determines the motion, so that the engines' own tolerances apply."""
        return self.drive is not None and self.dof == 1


def inspect_model(path: Path) -> ModelSummary:
    """Find the properties of a model, and a run and a reference for it.

    Raises
    ------
    BadModel
        The model does not compile.
    InputError
        Its motion is not known for any time, no joint can be driven, or none of its keys has a
        name.
    """
    model = compile_model(path)
    names = key_names(model)
    start = "start" if "start" in names else next(filter(None, names), "")
    if names and not start:
        raise InputError(path, "", 'its key has no name; write <key name="start" …/>')
    try:
        mechanism, plane = read(model, start)
        pose = nearest_pose(mechanism, mechanism.start)
        dof = count_dof(mechanism, pose)
    except ValueError as error:
        return inspect_in_space(path, model, start, mechanism_dof(model, start), str(error))
    lone = mechanism.joints[0].name if len(mechanism.joints) == 1 else ""
    is_free = dof > 1 or (
        lone and set(sensors_of_drive(model, lone)) >= {*filter(None, sensor_names(model))}
    )
    try:
        if is_free:
            refuse_contacts(plane.data)
            refuse(plane.data, SUPPORT, RunKind.FREE_MOTION)
    except ValueError as error:
        return inspect_in_space(path, model, start, dof, str(error))
    if is_free and dof == 1:
        return summarize_model(model, start, dof)
    if dof == 1:
        refuse_start_out_of_range(path, mechanism, pose)
    motors = {joint_of(model, a) for a in range(model.nactuator)}
    has_equilibria = dof > 1 and len(motors - {-1}) == 1 and has_springs(mechanism)
    best: JointRange | None = None

    def highest_rank(j: int) -> tuple[bool, bool, bool, float]:
        return j in motors, mechanism.joints[j].hinge, is_grounded(model, j), 1.0

    for j in sorted(range(len(mechanism.joints)), key=highest_rank, reverse=True):
        joint = mechanism.joints[j]
        if not joint.name or (dof > 1 and not (has_equilibria and j in motors)):
            continue
        if best and best.rank >= highest_rank(j):
            break
        start_value, unit = float(pose[j]), TURN if joint.hinge else mechanism.size
        low, high = joint.range
        try:
            refuse(plane.data, SUPPORT, RunKind.SWEEP, (joint.name,))
            below, above = (
                equilibrium_end(model, start, joint.name, start_value, end)
                if has_equilibria
                else float(Branch(mechanism, (joint.name,)).walk(np.array([[end]]))[0].q[-1, j])
                for end in (max(start_value - unit, low), min(start_value + unit, high))
            )
        except ValueError:  # the other joints do not follow, or have servos that are not covered
            continue
        share = max(start_value - below, above - start_value) / unit
        if share > MIN_DRIVEN_SHARE:
            turns = joint.hinge and above - start_value > TURN * (1 - 1e-9)
            found = JointRange(
                joint.name,
                start_value,
                below,
                above,
                share,
                turns,
                j in motors,
                is_grounded(model, j),
            )
            best = max(best or found, found, key=lambda one: one.rank)
    if dof == 1 and not best:
        raise InputError(path, "", "no joint with a name can be driven from the start pose")
    return summarize_model(model, start, dof, best)


def refuse_start_out_of_range(path: Path, mechanism: Mechanism, pose: Array) -> None:
    """Raise an `InputError` if a joint starts beyond its range, where no drive can begin."""
    for joint, value in zip(mechanism.joints, pose.tolist(), strict=True):
        low, high = joint.range
        unit = "rad" if joint.hinge else "m"
        margin = START_MARGIN * (TURN if joint.hinge else mechanism.size)
        if not low - margin <= value <= high + margin:
            raise InputError(
                path,
                "",
                f"joint {joint.name!r} starts at {value:.6g} {unit}, beyond its range, "
                f"{low:.6g} to {high:.6g} {unit}; change its key or its range",
            )


def is_grounded(model: MjModel, j: int) -> bool:
    """Whether the body of a joint is joined to the ground."""
    return bool(model.body_parentid[model.jnt_bodyid[j]] == 0)


def has_springs(mechanism: Mechanism) -> bool:
    """Whether there are springs, which may determine the joints that a drive leaves free."""
    m = mechanism
    springs: tuple[PlanarJoint | PointSpring | SumSpring, ...]
    springs = (*m.joints, *m.point_springs, *m.sum_springs)
    return any(any((spring.stiffness, *spring.stiffness_poly)) for spring in springs)


def equilibrium_end(model: MjModel, start: str, joint: str, at: float, end: float) -> float:
    """The value to which a joint can be driven towards an end with the others in equilibrium."""
    for share in TRIED_SHARES:
        last = at + share * (end - at)
        with suppress(ValueError):
            solve(
                np.linspace(at, last, OWN_MODEL_SAMPLES), model=model, start=start, joints=(joint,)
            )
            return last
    return at


def summarize_model(
    model: MjModel, start: str, dof: int, drive: JointRange | None = None
) -> ModelSummary:
    """The properties of a model, with the names of its elements."""
    of_drive = sensors_of_drive(model, drive.joint) if drive else []
    return ModelSummary(
        start,
        dof,
        drive,
        tuple(filter(None, sensor_names(model))),
        any(set(place_sensors(model)) - set(of_drive)),
        tuple(name for name, unit in joints(model).items() if name and unit),
        tuple(filter(None, (model.site(s).name for s in range(model.nsite)))),
        tuple(filter(None, bodies_rotating_in_space(model))),
        float(model.opt.timestep),
        moves_by_itself(model, start),
    )


def inspect_in_space(path: Path, model: MjModel, start: str, dof: int, planar: str) -> ModelSummary:
    """Find the properties and a reference of a model that is no planar linkage.

    `planar` says why it is none.

    Raises
    ------
    InputError
        The model's own run fails, or its motion is not known for any time.
    """
    look = summarize_model(model, start, dof)
    if not model.nv or not look.moves:
        return look
    why = f"the general planar solver does not cover it: {planar}"
    times = np.linspace(0.0, FREE_MOTION_SECONDS, OWN_MODEL_SAMPLES)
    try:
        spatial.solve(times, model=model, start=start, terms=smooth_terms(model, start))
    except ValueError as error:
        why += f"; nor does that for motions in space: {error}"
    else:
        return replace(look, reference="spatial", why=why)
    try:
        motion = engine_of(NATIVE_ENGINE).own_equations.solve_motion(
            path, FREE_MOTION_SECONDS, OWN_MODEL_SAMPLES, PROCESSOR_SECONDS, start
        )
    except (Unsupported, NotSolved) as error:
        raise InputError(path, "", f"{why}; nor can its own equations be solved: {error}") from None
    if failed := why_failed(motion):
        raise InputError(path, "", f"it fails: {failed}")
    rung = Rung(motion)
    if not (until := rung.close_agrees_until):
        raise InputError(path, "", f"{why}; and {rung.words()}")
    until = (
        FREE_MOTION_SECONDS if until == FREE_MOTION_SECONDS else float(f"{KNOWN_SHARE * until:.2g}")
    )
    return replace(look, reference="refined", why=why, until=until)


@dataclass
class Proposal:
    """A sidecar that is being written: its runs by kind, comments, tolerances and time steps."""

    name: str
    model: str
    look: ModelSummary
    runs: dict[Kind, list[str]]
    messages: list[str] = field(default_factory=list)
    tolerances: list[str] = field(default_factory=list)
    steps: dict[str, float] = field(default_factory=dict)

    def text(self) -> str:
        """The text of the sidecar."""
        return "\n".join(self.lines()) + "\n"

    def lines(self) -> Iterator[str]:
        """The lines of the sidecar."""
        yield f"# Proposed for {self.model} by `proofmass new`; docs/sidecar.md has every key."
        yield from (f"# {line}" for line in self.messages)
        yield f'title = "{self.name}"'
        yield 'source = "where the lengths, masses and springs come from"'
        yield f'reference = "{self.look.reference}"  # {REFERENCE_COMMENTS[self.look.reference]}'
        if self.model != f"{self.name}.xml":
            yield f'model = "{self.model}"'
        if self.look.start not in ("", "start"):
            yield f'start = "{self.look.start}"'
        if drive := self.look.drive:
            begin, end = drive.way
            yield ""
            yield "[drive]"
            yield f'joint = "{drive.joint}"'
            yield f"from = {begin!r}"
            yield f"to = {end!r}"
            yield f"rate = {1.0 if end > begin else -1.0}"
        for kind, solvers in self.runs.items():
            yield ""
            yield f"[run.{kind}]"
            if not self.look.drive:
                yield f"until = {self.look.until}"
                yield f"n = {self.look.samples}  # whole time steps of the model lead to each"
            yield f"solvers = {solvers!r}".replace("'", '"')
        for solver, step in self.steps.items():
            yield ""
            yield f"[settings.{solver}]"
            yield f"timestep = {step!r}"
        yield from self.tolerances


def write_proposal(name: str, model: Path) -> tuple[list[Path], list[str]]:
    """Write a sidecar for a model to the same folder; and a copy of the model with more sensors.

    The copy is written if no sensor of the model measures a position or an orientation.

    Parameters
    ----------
    name : str
        Name of the case.
    model : Path
        An MJCF file; it is not changed.

    Returns
    -------
    files : list of Path
        The files that were written.
    messages : list of str
        What was found, the error of each run, and which runs an engine does not cover.

    Raises
    ------
    InputError
        A file exists already; the model does not compile, has no joint that can be driven, no
        degree of freedom, or no named element that could be measured; nothing moves; or its motion
        is not known for any time.
    """
    original = model
    sidecar, model_copy = (model.with_name(f"{name}{ending}") for ending in (".toml", ".xml"))
    if sidecar.exists():
        raise InputError(sidecar, "", "it is there already; give another name")
    try:
        look = call_isolated(inspect_model, model, timeout=INSPECTION_SECONDS)
    except BadModel as error:
        raise InputError(model, "", str(error).removeprefix(f"{model.name}: ")) from None
    except (TimedOut, OutOfMemory, Crashed) as error:
        raise InputError(model, "", f"its motion could not be looked at: {error}") from None
    if look.dof == 0:
        raise InputError(model, "", "it has no degree of freedom: nothing moves")
    if not look.drive and not look.moves:
        raise InputError(model, "", NOTHING_MOVES)
    written = [sidecar]
    new_sensors = [] if look.placed else missing_sensors(look)
    if not new_sensors and not look.sensors:
        raise InputError(
            model, "", "no joint, site or loose body of it has a name, so none can be measured"
        )
    if new_sensors:
        if model_copy.exists():
            raise InputError(model_copy, "", "it is there already; give another name")
        write_atomically(model_copy, with_sensors(model, new_sensors))
        model, written = model_copy, [sidecar, model_copy]
    try:
        try:
            messages = propose_sidecar(name, model, look, sidecar)
        except InputError:
            if not look.drive or look.is_determined or not look.moves:
                raise
            messages = propose_sidecar(
                name, model, replace(look, drive=None), sidecar
            )  # no equilibria
    except BaseException as error:
        for file in written:
            file.unlink(missing_ok=True)
        if isinstance(error, InputError) and error.file in written:  # it is there no more
            raise InputError(original, error.key, error.wrong) from None
        raise
    return written, messages


def propose_sidecar(name: str, model: Path, look: ModelSummary, sidecar: Path) -> list[str]:
    """Write the sidecar for a model, and return the messages."""
    kinds: list[Kind] = ["dynamics"]
    if look.drive:
        kinds = ["sweep", "dynamics"] if look.is_determined else ["sweep"]
    proposal = Proposal(name, model.name, look, {kind: list(default_engines()) for kind in kinds})
    proposal.messages.append(describe_model(look))
    measure_runs(proposal, sidecar)
    return proposal.messages


def describe_model(look: ModelSummary) -> str:
    """A sentence on the degrees of freedom of a model, and the run that is proposed."""
    if not look.drive:
        why = f"{look.why[0].upper()}{look.why[1:]}. " if look.why else ""
        known = ", as far as its motion is known" if look.until < FREE_MOTION_SECONDS else ""
        return (
            f"{why}It has {look.dof} degree{'s' * (look.dof > 1)} of freedom and is let go "
            f"for {look.until:g} s{known}."
        )
    turns = "turns once" if look.drive.turns else f"goes {DRIVEN_SHARE:.0%} of its way to a limit"
    if not look.is_determined:
        return (
            f"It has {look.dof} degrees of freedom; joint {look.drive.joint!r} is driven, as its "
            f"actuator does, and {turns}. Springs hold the others at rest."
        )
    return f"It has one degree of freedom; joint {look.drive.joint!r} drives it and {turns}."


def missing_sensors(look: ModelSummary) -> list[str]:
    """The MJCF of sensors for all joints, sites and loose bodies that have a name.

    Sensors whose name is that of a sensor of the model are left out.
    """
    asked = [
        *product(look.joints, ("jointpos", "jointvel")),
        *product(
            (name for name in look.sites if name not in look.joints), ("framepos", "framelinvel")
        ),
        *product(look.bodies, ("body", "quat", "linear", "angular")),
    ]
    every = [SENSOR_TEMPLATES[kind].format(name=name) for name, kind in asked]
    return [one for one in every if one.split('"')[1] not in look.sensors]


def with_sensors(model: Path, new_sensors: list[str]) -> str:
    """The model's text with more sensors."""
    text = read_text(model)
    head, end, tail = text.rpartition("</mujoco>")
    if not end:
        raise InputError(model, "", "no </mujoco> to write sensors before")
    inside = "\n".join(f"    {one}" for one in new_sensors)
    return f"{head}\n  <sensor>\n{inside}\n  </sensor>\n{end}{tail}"


def measure_runs(proposal: Proposal, sidecar: Path) -> None:
    """Make the proposed runs, leave out those that an engine does not cover, and write the sidecar.

    If a drive does not determine the motion, tolerances are proposed from the measured errors.
    """
    for kind in list(proposal.runs):
        for solver in list(proposal.runs[kind]):
            try:
                found = run_until_close(proposal, sidecar, kind, solver)
            except InputError as error:
                if not error.key.startswith("run."):
                    raise
                proposal.messages.append(f"{kind}: {error.wrong}")
                proposal.runs[kind] = [one for one in proposal.runs[kind] if one != solver]
                if not proposal.runs[kind]:
                    raise InputError(
                        sidecar.with_name(proposal.model), "", f"no engine covers it: {error.wrong}"
                    ) from None
                continue
            proposal.messages.append(f"{kind}, {solver}: {describe_error(found)}")
            if not proposal.look.is_determined:
                proposal.tolerances += measured_tolerance(kind, solver, found)
                if off := far_off(found):
                    proposal.messages.append(describe_far_off(kind, solver, off))
    write_atomically(sidecar, proposal.text())
    if proposal.look.drive and not proposal.look.is_determined:
        refuse_rest(proposal, sidecar)


def refuse_rest(proposal: Proposal, sidecar: Path) -> None:
    """Raise an `InputError` if nothing but the drive moves in a sweep."""
    solver = proposal.runs["sweep"][0]
    found, _ = run_solver(read_isolated(sidecar), "sweep", solver, COMPARE_ERRORS_ONLY)
    for c in found:
        if c.outcome == Outcome.NOTHING_MOVED:
            raise InputError(sidecar.with_name(proposal.model), "", c.message)


def run_until_close(proposal: Proposal, sidecar: Path, kind: Kind, solver: str) -> list[Comparison]:
    """Run a solver; in dynamics with finer steps as long as its error exceeds the tolerance."""
    own = proposal.look.timestep
    for step in (own, *(own / n for n in STEP_DIVISORS if kind == "dynamics")):
        if step < own:
            proposal.steps[solver] = step
        write_atomically(sidecar, proposal.text())
        found, _ = run_solver(read_isolated(sidecar), kind, solver, COMPARE_ERRORS_ONLY)
        if all(c.outcome != Outcome.DIFFERS for c in found):
            return found
    proposal.steps.pop(solver, None)
    return found


def describe_error(found: list[Comparison]) -> str:
    """A phrase on the largest error of a run."""
    errors = [c for c in found if isfinite(c.error_max)]
    if not errors:
        return f"{found[0].outcome}: {found[0].message}"
    largest = max(errors, key=lambda c: c.nrmse if isnan(c.allowed) else c.error_max / c.allowed)
    phrase = (
        f"largest error {largest.error_max:.2g} {format_unit(largest.unit)}of {largest.channel}"
    )
    if largest.outcome != Outcome.DIFFERS or largest.run == "sweep":
        return phrase
    return (
        f"{phrase} at the finest step that was tried, where the engine's tolerance allows "
        f"{largest.allowed:.2g} {largest.unit}; `proofmass choose` finds a setting that is closer"
    )


def describe_far_off(kind: Kind, solver: str, off: list[Comparison]) -> str:
    """A sentence on the channels of a run whose errors are too large for a tolerance."""
    errors = (f"{c.channel} by {c.error_max / curve_scale(c):.2g}" for c in off)
    return (
        f"{kind}, {solver}: off by so much that {TOLERANCE_FACTOR:g} times the error would let a "
        f"curve pass that does not move, so that they differ: {', '.join(errors)} of its range"
    )


def measured_tolerance(kind: Kind, solver: str, found: list[Comparison]) -> Iterator[str]:
    """Lines of the sidecar with a tolerance for each unit of a run, from its errors."""
    checked = [c for c in found if isfinite(c.error_max) and c not in far_off(found)]
    for unit in dict.fromkeys(c.unit for c in checked):
        left = [c for c in checked if c.unit == unit]
        rounding = unit_rounding(left)[unit]
        while left:
            error = max(c.error_max for c in left)
            allowed = round_up(max(TOLERANCE_FACTOR * error, rounding))
            is_rounding = allowed <= round_up(rounding)
            group = [
                c
                for c in left
                if c.error_max == error
                or (is_rounding and c.error_max <= rounding)
                or not passes_unmoved(allowed, curve_scale(c))
            ]
            left = [c for c in left if c not in group]
            yield from tolerance_head(kind, solver, unit, group, found)
            yield f"abs = {allowed!r}"
            measured = f"{error:.2g} {format_unit(unit)}".rstrip()
            at_least = f"; at least {MIN_TOLERANCE_SHARE:g} of the range, for rounding"
            yield (
                f'why = "proposed: {TOLERANCE_FACTOR:g} times what was measured, {measured}'
                f'{at_least if rounding > TOLERANCE_FACTOR * error else ""}"'
            )

    off = far_off(found)
    for unit in dict.fromkeys(c.unit for c in off):
        group = [c for c in off if c.unit == unit]
        least = min(c.error_max / curve_scale(c) for c in group)
        yield from tolerance_head(kind, solver, unit, group, found)
        yield f"relative_to_range = {FAR_OFF_TOLERANCE!r}"
        yield (
            f'why = "proposed: less than what was measured, {least:.2g} of the range or more, '
            f'which is too much for a tolerance"'
        )


def tolerance_head(
    kind: Kind, solver: str, unit: str, group: list[Comparison], found: list[Comparison]
) -> Iterator[str]:
    """The first lines of a tolerance: where it holds; all channels of a unit are not listed."""
    yield ""
    yield "[[tolerance]]"
    yield f'run = "{kind}"'
    yield f'solver = "{solver}"'
    yield f'unit = "{unit}"'
    if len(group) < sum(c.unit == unit for c in found):
        yield f"channels = {[c.channel for c in group]!r}".replace("'", '"')


def far_off(found: list[Comparison]) -> list[Comparison]:
    """The channels of a run for which a tolerance would let a curve pass that does not move."""
    rounding = unit_rounding(found)
    return [
        c
        for c in found
        if isfinite(c.error_max)
        and c.error_max > rounding[c.unit]
        and passes_unmoved(round_up(TOLERANCE_FACTOR * c.error_max), curve_scale(c))
    ]


def unit_rounding(found: list[Comparison]) -> dict[str, float]:
    """The least tolerance for each unit: rounding of the largest range of its curves [the unit].

    The range of a curve without an error is not known, and counts as 1.
    """
    least = dict.fromkeys((c.unit for c in found), 0.0)
    for c in found:
        least[c.unit] = max(least[c.unit], MIN_TOLERANCE_SHARE * (curve_scale(c) or 1.0))
    return least


def curve_scale(c: Comparison) -> float:
    """The range of a reference curve, or its size if it is constant; 0 if the error is 0."""
    return c.error_rms / c.nrmse if c.nrmse > 0 else 0.0


def format_unit(unit: str) -> str:
    """A unit and a space; empty for a number without a unit."""
    return "" if unit == "1" else f"{unit} "


def round_up(value: float) -> float:
    """A value rounded up to one digit.

    >>> round_up(0.0123), round_up(3e-7)
    (0.02, 3e-07)
    """
    if not 0 < value < inf:
        return 1e-12
    digits = -floor(log10(value))
    return float(f"{ceil(value * 10**digits - 1e-9)}e{-digits}")
