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
from math import ceil, floor, inf, isfinite, isnan, log10, pi
from pathlib import Path

import numpy as np
from mujoco import MjModel

from proofmass.analytic import spatial
from proofmass.analytic.planar import Branch, Mechanism, read, solve
from proofmass.analytic.planar.kinematics import count_dof, nearest
from proofmass.analytic.planar.mechanism import (
    PlanarJoint,
    PointSpring,
    SumSpring,
    refuse_actuators,
    refuse_contacts,
)
from proofmass.check import SAMPLES, run_one
from proofmass.check import read as read_sidecar
from proofmass.compare import Comparison, compare
from proofmass.engines import default_engines, engine_of
from proofmass.errors import InputError
from proofmass.files import read_text, write_whole
from proofmass.outcome import Outcome
from proofmass.reference import smooth_terms
from proofmass.self_consistency import PROCESSOR, Rung, why_failed
from proofmass.sim.contents import joint_of, joints, keys, loose_bodies, place_sensors, sensors
from proofmass.sim.mjcf import NATIVE, compile_model
from proofmass.sim.protocol import BadModel, NotSolved, Unsupported
from proofmass.strict import Kind
from proofmass.worker import Crashed, OutOfMemory, TimedOut, isolated

LOOKING = 240.0
"""Wall time to compile a model, and to drive its joints or to solve its motion closely [s]."""
TURN = 2 * pi
SHARE = 0.9  # share of a joint's distance to its limit position that is driven, to stay before it
LEAST = 0.01  # least distance of a drive, as a share of a turn or of the mechanism's size
SHARES = 1.0, 0.5, 0.25, 0.1, 0.05  # shares of a distance that are tried if springs act
LET_GO = 1.0  # s, duration of a free motion
ROUNDED = 1e-12
"""Least tolerance that is proposed, as a share of a curve's range: the rounding of another machine,
which adds up over the steps."""
SLACK = 3.0  # proposed tolerance over the measured error: other rounding, a slightly longer motion
MEANT = {
    "planar": "reads the numbers of the model: a wrong one is wrong in both",
    "spatial": "reads the numbers of the model: a wrong one is wrong in both",
    "refined": "the model's own equations, solved closely: it judges the time stepping alone",
}
VERDICTS = partial(compare, detectable=False)
FINER = 2, 4  # divisors of the model's step, if the error with that is too large
KNOWN = 0.9  # share of the time until which a motion is known, since other samples may give less
SENSORS = {
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
class Reach:
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
        return self.start, self.start + SHARE * (end - self.start)


@dataclass(frozen=True)
class ModelLook:
    """The properties of a model, and the run and reference that are proposed for it.

    Attributes
    ----------
    start : str
        The key with the start pose; empty if the model has none.
    dof : int
        The number of degrees of freedom.
    reaches : tuple of Reach
        The ranges of all joints that can be driven, the best first.
    sensors : tuple of str
        Names of the model's sensors.
    placed : bool
        Whether a sensor with a name measures a position or an orientation.
    joints, sites, bodies : tuple of str
        Names of elements that can be measured: hinges and slides, sites, and bodies on ball joints
        and free joints.
    timestep : float
        The model's time step [s].
    reference : str
        The reference of the motion.
    until : float
        Duration of a free motion [s].
    why : str
        Why the references before this one do not cover the model; empty for the first reference.
    """

    start: str
    dof: int
    reaches: tuple[Reach, ...]
    sensors: tuple[str, ...]
    placed: bool
    joints: tuple[str, ...]
    sites: tuple[str, ...]
    bodies: tuple[str, ...]
    timestep: float
    reference: str = "planar"
    until: float = LET_GO
    why: str = ""

    @property
    def determined(self) -> bool:
        """Whether a drive determines the motion, so that the engines' own tolerances apply."""
        return self.reference == "planar" and self.dof == 1

    @property
    def driven(self) -> bool:
        """Whether one joint is driven, and the others follow it, or springs determine them."""
        return self.determined or bool(self.reaches)


def look_at(path: Path) -> ModelLook:
    """Find the properties of a model, and a run and a reference for it.

    Raises
    ------
    BadModel
        The model does not compile.
    InputError
        Its motion is not known for any time.
    """
    model = compile_model(path)
    names = keys(model)
    start = "start" if "start" in names else next(iter(names), "")
    try:
        mechanism, _ = read(model, start)
        pose = nearest(mechanism, mechanism.start)
        free = count_dof(mechanism, pose)
        if free > 1:
            refuse_contacts(model)
            refuse_actuators(model, ())
    except ValueError as error:
        return look_in_space(path, model, start, str(error))
    motors = {joint_of(model, a) for a in range(model.nactuator)}
    reaches = []
    held = free > 1 and len(motors - {-1}) == 1 and springs_hold(mechanism)
    for j, joint in enumerate(mechanism.joints):
        if not joint.name or (free > 1 and not (held and j in motors)):
            continue
        at, unit = float(pose[j]), TURN if joint.hinge else mechanism.size
        low, high = joint.range
        try:
            refuse_actuators(model, (joint.name,))
            below, above = (
                rests_until(model, start, joint.name, at, end)
                if held
                else float(Branch(mechanism, (joint.name,)).walk(np.array([[end]]))[0].q[-1, j])
                for end in (max(at - unit, low), min(at + unit, high))
            )
        except ValueError:  # the other joints do not follow, or have servos that are not covered
            continue
        share = max(at - below, above - at) / unit
        if share > LEAST:
            turns = joint.hinge and above - at > TURN * (1 - 1e-9)
            grounded = bool(model.body_parentid[model.jnt_bodyid[j]] == 0)
            reaches.append(Reach(joint.name, at, below, above, share, turns, j in motors, grounded))
    reaches.sort(key=lambda one: one.rank, reverse=True)
    return look_of(model, start, free, tuple(reaches))


def springs_hold(mechanism: Mechanism) -> bool:
    """Whether there are springs, which may determine the joints that a drive leaves free."""
    m = mechanism
    springs: tuple[PlanarJoint | PointSpring | SumSpring, ...]
    springs = (*m.joints, *m.point_springs, *m.sum_springs)
    return any(any((spring.stiffness, *spring.stiffness_poly)) for spring in springs)


def rests_until(model: MjModel, start: str, joint: str, at: float, end: float) -> float:
    """The value to which a joint can be driven towards an end with the others in equilibrium."""
    for share in SHARES:
        last = at + share * (end - at)
        with suppress(ValueError):
            solve(np.linspace(at, last, SAMPLES), model=model, start=start, joints=(joint,))
            return last
    return at


def look_of(model: MjModel, start: str, dof: int, reaches: tuple[Reach, ...] = ()) -> ModelLook:
    """The properties of a model, with the names of its elements."""
    return ModelLook(
        start,
        dof,
        reaches,
        tuple(filter(None, sensors(model))),
        any(place_sensors(model)),
        tuple(name for name, unit in joints(model).items() if name and unit),
        tuple(filter(None, (model.site(s).name for s in range(model.nsite)))),
        tuple(filter(None, loose_bodies(model))),
        float(model.opt.timestep),
    )


def look_in_space(path: Path, model: MjModel, start: str, planar: str) -> ModelLook:
    """Find the properties and a reference of a model that is no planar linkage.

    `planar` says why it is none.

    Raises
    ------
    InputError
        The model's own run fails, or its motion is not known for any time.
    """
    look = look_of(model, start, int(model.nv))
    if not model.nv:
        return look
    why = f"the general planar solver does not cover it: {planar}"
    times = np.linspace(0.0, LET_GO, SAMPLES)
    try:
        spatial.solve(times, model=model, start=start, terms=smooth_terms(model, start))
    except ValueError as error:
        why += f"; nor does that for motions in space: {error}"
    else:
        return replace(look, reference="spatial", why=why)
    try:
        motion = engine_of(NATIVE).own_motion(path, LET_GO, SAMPLES, PROCESSOR, start)
    except (Unsupported, NotSolved) as error:
        raise InputError(path, "", f"{why}; nor can its own equations be solved: {error}") from None
    if failed := why_failed(motion):
        raise InputError(path, "", f"it fails: {failed}")
    rung = Rung(motion)
    if not (until := rung.closely_until):
        raise InputError(path, "", f"{why}; and {rung.words()}")
    until = LET_GO if until == LET_GO else float(f"{KNOWN * until:.2g}")
    return replace(look, reference="refined", why=why, until=until)


@dataclass
class Proposal:
    """A sidecar that is being written: its runs by kind, comments, tolerances and time steps."""

    name: str
    model: str
    look: ModelLook
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
        yield f'reference = "{self.look.reference}"  # {MEANT[self.look.reference]}'
        if self.model != f"{self.name}.xml":
            yield f'model = "{self.model}"'
        if self.look.start not in ("", "start"):
            yield f'start = "{self.look.start}"'
        if self.look.driven:
            begin, end = self.look.reaches[0].way
            yield ""
            yield "[drive]"
            yield f'joint = "{self.look.reaches[0].joint}"'
            yield f"from = {begin!r}"
            yield f"to = {end!r}"
            yield f"rate = {1.0 if end > begin else -1.0}"
        for kind, solvers in self.runs.items():
            yield ""
            yield f"[run.{kind}]"
            if not self.look.driven:
                yield f"until = {self.look.until}"
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
        degree of freedom, or no named element that could be measured; or its motion is not known
        for any time.
    """
    sidecar, own = (model.with_name(f"{name}{ending}") for ending in (".toml", ".xml"))
    if sidecar.exists():
        raise InputError(sidecar, "", "it is there already; give another name")
    try:
        look = isolated(look_at, model, timeout=LOOKING)
    except BadModel as error:
        raise InputError(model, "", str(error).removeprefix(f"{model.name}: ")) from None
    except (TimedOut, OutOfMemory, Crashed) as error:
        raise InputError(model, "", f"its motion could not be looked at: {error}") from None
    if look.driven and not look.reaches:
        raise InputError(model, "", "no joint with a name can be driven from the start pose")
    if look.dof == 0:
        raise InputError(model, "", "it has no degree of freedom: nothing moves")
    written = [sidecar]
    more = [] if look.placed else more_sensors(look)
    if not more and not look.sensors:
        raise InputError(
            model, "", "no joint, site or loose body of it has a name, so none can be measured"
        )
    if more:
        if own.exists():
            raise InputError(own, "", "it is there already; give another name")
        write_whole(own, with_sensors(model, more))
        model, written = own, [sidecar, own]
    try:
        try:
            messages = proposed(name, model, look, sidecar)
        except InputError:
            if not look.driven or look.determined:
                raise
            messages = proposed(name, model, replace(look, reaches=()), sidecar)  # no equilibria
    except BaseException:
        for file in written:
            file.unlink(missing_ok=True)
        raise
    return written, messages


def proposed(name: str, model: Path, look: ModelLook, sidecar: Path) -> list[str]:
    """Write the sidecar for a model, and return the messages."""
    kinds: list[Kind] = ["dynamics"]
    if look.driven:
        kinds = ["sweep", "dynamics"] if look.determined else ["sweep"]
    proposal = Proposal(name, model.name, look, {kind: list(default_engines()) for kind in kinds})
    proposal.messages.append(found_in(look))
    measure(proposal, sidecar)
    return proposal.messages


def found_in(look: ModelLook) -> str:
    """A sentence on the degrees of freedom of a model, and the run that is proposed."""
    if not look.driven:
        why = f"{look.why[0].upper()}{look.why[1:]}. " if look.why else ""
        known = ", as far as its motion is known" if look.until < LET_GO else ""
        return (
            f"{why}It has {look.dof} degrees of freedom and is let go for {look.until:g} s{known}."
        )
    best = look.reaches[0]
    turns = "turns once" if best.turns else f"goes {SHARE:.0%} of its way to a limit"
    if not look.determined:
        return (
            f"It has {look.dof} degrees of freedom; joint {best.joint!r} is driven, as its "
            f"actuator does, and {turns}. Springs hold the others at rest."
        )
    return f"It has one degree of freedom; joint {best.joint!r} drives it and {turns}."


def more_sensors(look: ModelLook) -> list[str]:
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
    every = [SENSORS[kind].format(name=name) for name, kind in asked]
    return [one for one in every if one.split('"')[1] not in look.sensors]


def with_sensors(model: Path, more: list[str]) -> str:
    """The model's text with more sensors."""
    text = read_text(model)
    head, end, tail = text.rpartition("</mujoco>")
    if not end:
        raise InputError(model, "", "no </mujoco> to write sensors before")
    inside = "\n".join(f"    {one}" for one in more)
    return f"{head}\n  <sensor>\n{inside}\n  </sensor>\n{end}{tail}"


def measure(proposal: Proposal, sidecar: Path) -> None:
    """Make the proposed runs, leave out those that an engine does not cover, and write the sidecar.

    If a drive does not determine the motion, tolerances are proposed from the measured errors.
    """
    for kind in list(proposal.runs):
        for solver in list(proposal.runs[kind]):
            try:
                found = closest(proposal, sidecar, kind, solver)
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
            proposal.messages.append(f"{kind}, {solver}: {worst(found)}")
            if not proposal.look.determined:
                proposal.tolerances += measured_tolerance(kind, solver, found)
    write_whole(sidecar, proposal.text())


def closest(proposal: Proposal, sidecar: Path, kind: Kind, solver: str) -> list[Comparison]:
    """Run a solver; in dynamics with finer steps as long as its error exceeds the tolerance."""
    own = proposal.look.timestep
    for step in (own, *(own / n for n in FINER if kind == "dynamics")):
        if step < own:
            proposal.steps[solver] = step
        write_whole(sidecar, proposal.text())
        found, _ = run_one(read_sidecar(sidecar), kind, solver, VERDICTS)
        if all(c.outcome != Outcome.DIFFERS for c in found):
            return found
    proposal.steps.pop(solver, None)
    return found


def worst(found: list[Comparison]) -> str:
    """A phrase on the largest error of a run."""
    errors = [c for c in found if isfinite(c.error_max)]
    if not errors:
        return f"{found[0].outcome}: {found[0].message}"
    far = max(errors, key=lambda c: c.nrmse if isnan(c.allowed) else c.error_max / c.allowed)
    said = f"largest error {far.error_max:.2g} {format_unit(far.unit)}of {far.channel}"
    if far.outcome != Outcome.DIFFERS or far.run == "sweep":
        return said
    return (
        f"{said} at the finest step that was tried, where the engine's tolerance allows "
        f"{far.allowed:.2g} {far.unit}; `proofmass choose` finds a setting that is closer"
    )


def measured_tolerance(kind: Kind, solver: str, found: list[Comparison]) -> Iterator[str]:
    """Lines of the sidecar with a tolerance for each unit of a run, from its errors."""
    errors: dict[str, float] = {}
    least: dict[str, float] = {}
    for c in found:
        if isfinite(c.error_max):
            scale = c.error_rms / c.nrmse if c.nrmse > 0 else 0.0
            errors[c.unit] = max(c.error_max, errors.get(c.unit, 0.0))
            least[c.unit] = max(ROUNDED * scale, least.get(c.unit, 0.0))
    for unit, error in errors.items():
        yield ""
        yield "[[tolerance]]"
        yield f'run = "{kind}"'
        yield f'solver = "{solver}"'
        yield f'unit = "{unit}"'
        yield f"abs = {rounded_up(max(SLACK * error, least[unit]))!r}"
        measured = f"{error:.2g} {format_unit(unit)}".rstrip()
        rounding = f"; at least {ROUNDED:g} of the range, for rounding"
        yield (
            f'why = "proposed: {SLACK:g} times what was measured, {measured}'
            f'{rounding if least[unit] > SLACK * error else ""}"'
        )


def format_unit(unit: str) -> str:
    """A unit and a space; empty for a number without a unit."""
    return "" if unit == "1" else f"{unit} "


def rounded_up(value: float) -> float:
    """A value rounded up to one digit.

    >>> rounded_up(0.0123), rounded_up(3e-7)
    (0.02, 3e-07)
    """
    if not 0 < value < inf:
        return 1e-12
    digits = -floor(log10(value))
    return float(f"{ceil(value * 10**digits - 1e-9)}e{-digits}")
