"""``proofmass new NAME --from MODEL.xml``: a sidecar for a model that has none, found by measuring.

The reference is the general planar solver, if it covers the model.  It tells how many degrees of
freedom that has and how far each joint can be driven; where one is left, the best of them is the
drive.  Where there are more and springs hold what the one joint with an actuator leaves, that joint
is driven in a sweep; else the mechanism is let go.  Another model is let go as well: with the
reference for motions in space if that covers it, and else with the model's own equations, solved
closely, as far as its motion is known.

Then all runs are made in all engines: what an engine does not cover is left out, with the reason as
a comment; comments tell how far each run is off as well, and a run in time that is off by more than
its engine's tolerance gets a finer step.
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
"""Wall time to compile a model, and to follow its joints or to solve its motion closely [s]."""
TURN = 2 * pi
SHARE = 0.9  # of the way that a joint can be driven, so that no limit position is met
LEAST = 0.01  # of a turn, or of the mechanism's size: a drive that goes no further shows nothing
SHARES = 1.0, 0.5, 0.25, 0.1, 0.05  # of a way that are tried where springs hold what a drive leaves
LET_GO = 1.0  # s, of a free motion
ROUNDED = 1e-12
"""Share of a curve's range that its proposed tolerance allows at least: another machine's rounding,
which steps add up."""
SLACK = 3.0  # times the error that was measured: another machine's rounding, a motion a bit longer
MEANT = {
    "planar": "reads the numbers of the model: a wrong one is wrong in both",
    "spatial": "reads the numbers of the model: a wrong one is wrong in both",
    "refined": "the model's own equations, solved closely: it judges the time stepping alone",
}
VERDICTS = partial(compare, detectable=False)
FINER = 2, 4  # times the model's steps, where that is not close enough
KNOWN = 0.9  # of the time until which a motion is known, by one grid of samples, for another grid
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
    """How far a joint can be driven, the others following.

    Attributes
    ----------
    joint : str
    start, low, high : float
        Its value in the start pose, and the ends of its way [rad or m].
    share : float
        The way as a share of a turn, or of the mechanism's size [1].
    turns, motor, grounded : bool
        Whether it makes a whole turn, whether an actuator drives it, and whether it is on a body
        that is fixed.
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
        """A motor first, then a whole turn, then a joint on a fixed body, then the longest way."""
        return self.motor, self.turns, self.grounded, self.share

    @property
    def way(self) -> tuple[float, float]:
        """Where the drive begins and ends: at the start pose, and on the longer side."""
        if self.turns:
            return self.start, self.start + TURN
        end = max(self.low, self.high, key=lambda end: abs(end - self.start))
        return self.start, self.start + SHARE * (end - self.start)


@dataclass(frozen=True)
class ModelLook:
    """What is proposed for a model, before anything ran.

    Attributes
    ----------
    start : str
        Its key with the start pose; empty if it has none.
    dof : int
    reaches : tuple of Reach
        Of all joints that can be driven, the best first.
    sensors : tuple of str
        Names of those it has.
    placed : bool
        Whether one with a name tells where something is, or how it is turned.
    joints, sites, bodies : tuple of str
        Names of what could be measured: hinges and slides, sites, bodies on balls and free joints.
    timestep : float
        The model's [s].
    reference : str
        What its motion is held against.
    until : float
        How long it is let go [s].
    why : str
        Why a reference that comes before is none; empty of the first.
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
        """Whether a drive determines the motion, which engines follow as closely as they say."""
        return self.reference == "planar" and self.dof == 1

    @property
    def driven(self) -> bool:
        """Whether one joint is driven, and the others follow it, or springs hold them."""
        return self.determined or bool(self.reaches)


def look_at(path: Path) -> ModelLook:
    """Look at a model.

    Raises
    ------
    BadModel
        It does not compile.
    InputError
        Nothing of its motion is known.
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
        except ValueError:  # the others do not follow it, or have servos that are not covered
            continue
        share = max(at - below, above - at) / unit
        if share > LEAST:
            turns = joint.hinge and above - at > TURN * (1 - 1e-9)
            grounded = bool(model.body_parentid[model.jnt_bodyid[j]] == 0)
            reaches.append(Reach(joint.name, at, below, above, share, turns, j in motors, grounded))
    reaches.sort(key=lambda one: one.rank, reverse=True)
    return look_of(model, start, free, tuple(reaches))


def springs_hold(mechanism: Mechanism) -> bool:
    """Whether springs act, so that what a drive leaves may rest on them."""
    m = mechanism
    springs: tuple[PlanarJoint | PointSpring | SumSpring, ...]
    springs = (*m.joints, *m.point_springs, *m.sum_springs)
    return any(any((spring.stiffness, *spring.stiffness_poly)) for spring in springs)


def rests_until(model: MjModel, start: str, joint: str, at: float, end: float) -> float:
    """How far a joint can be driven towards an end while springs hold the others at rest."""
    for share in SHARES:
        last = at + share * (end - at)
        with suppress(ValueError):
            solve(np.linspace(at, last, SAMPLES), model=model, start=start, joints=(joint,))
            return last
    return at


def look_of(model: MjModel, start: str, dof: int, reaches: tuple[Reach, ...] = ()) -> ModelLook:
    """A look at a model, with the names that it has."""
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
    """Look at a model that is no planar linkage.

    Raises
    ------
    InputError
        Nothing moves, the model fails, or its motion is not known for any time.
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
    """A sidecar in the making: its runs by kind, and what is said of them."""

    name: str
    model: str
    look: ModelLook
    runs: dict[Kind, list[str]]
    messages: list[str] = field(default_factory=list)
    tolerances: list[str] = field(default_factory=list)
    steps: dict[str, float] = field(default_factory=dict)

    def text(self) -> str:
        """The sidecar's text."""
        return "\n".join(self.lines()) + "\n"

    def lines(self) -> Iterator[str]:
        """Its lines."""
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
    """Write a sidecar for a model, beside it; and a copy of the model with more sensors.

    The copy is written if no sensor of the model tells of a place, as those of forces and rates.

    Parameters
    ----------
    name : str
        Of the case.
    model : Path
        An MJCF file; it is not changed.

    Returns
    -------
    files : list of Path
        What was written.
    messages : list of str
        What was found, and what no engine covers.

    Raises
    ------
    InputError
        A file is there already; the model does not compile, has no joint that can be driven, or
        nothing with a name that could be measured; or nothing of its motion is known.
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
            messages = proposed(name, model, replace(look, reaches=()), sidecar)  # no engine rests
    except BaseException:
        for file in written:
            file.unlink(missing_ok=True)
        raise
    return written, messages


def proposed(name: str, model: Path, look: ModelLook, sidecar: Path) -> list[str]:
    """Write the sidecar that a look at a model leads to, and tell what was found."""
    kinds: list[Kind] = ["dynamics"]
    if look.driven:
        kinds = ["sweep", "dynamics"] if look.determined else ["sweep"]
    proposal = Proposal(name, model.name, look, {kind: list(default_engines()) for kind in kinds})
    proposal.messages.append(found_in(look))
    measure(proposal, sidecar)
    return proposal.messages


def found_in(look: ModelLook) -> str:
    """What a model is, in words."""
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
    """Sensors of all joints, sites and loose bodies that have a name.

    Names that sensors of the model have already are left to these.
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
    """Run what is proposed, leave out what no engine covers, and write the sidecar.

    What a drive does not determine has tolerances only by what was measured.
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
    """Run a solver; in time with finer steps as long as it is farther off than it may be."""
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
    """How far a run is off, in words."""
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
    """A tolerance for each unit of a run, from what it was off by."""
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
    """A unit before the next word; nothing for a number without one."""
    return "" if unit == "1" else f"{unit} "


def rounded_up(value: float) -> float:
    """The next number with one digit.

    >>> rounded_up(0.0123), rounded_up(3e-7)
    (0.02, 3e-07)
    """
    if not 0 < value < inf:
        return 1e-12
    digits = -floor(log10(value))
    return float(f"{ceil(value * 10**digits - 1e-9)}e{-digits}")
