"""``proofmass new NAME --from MODEL.xml``: a sidecar for a model that has none, found by measuring.

The reference is the general planar solver.  It tells how many degrees of freedom the model has and
how far each joint can be driven; where one is left, the best of them is the drive, where there are
more the mechanism is let go.  Then all runs are made in all engines: what an engine does not cover
is left out, with the reason as a comment; comments tell how far each run is off as well, and a run
in time that is off by more than its engine's tolerance gets a finer step.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from math import ceil, floor, inf, isfinite, isnan, log10, pi
from pathlib import Path

import numpy as np

from proofmass.analytic.planar import Branch, read
from proofmass.analytic.planar.kinematics import freedoms, nearest
from proofmass.check import read as read_sidecar
from proofmass.check import run_one
from proofmass.compare import Comparison, compare
from proofmass.engines import default_engines
from proofmass.errors import InputError
from proofmass.files import read_text, write_whole
from proofmass.outcome import Outcome
from proofmass.sim.contents import joint_of, keys, sensors
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol import BadModel
from proofmass.strict import Kind
from proofmass.worker import isolated

LOOKING = 60.0  # s, to compile a model and to follow each of its joints
TURN = 2 * pi
SHARE = 0.9  # of the way that a joint can be driven, so that no limit position is met
LEAST = 0.01  # of a turn, or of the mechanism's size: a drive that goes no further shows nothing
LET_GO = 1.0  # s, of a free motion
SLACK = 3.0  # times the error that was measured: another machine's rounding, a motion a bit longer
VERDICTS = partial(compare, detectable=False)
FINER = 2, 4  # times the model's steps, where that is not close enough
SENSORS = {
    "jointpos": '<jointpos name="{name}" joint="{name}"/>',
    "jointvel": '<jointvel name="{name}_rate" joint="{name}"/>',
    "framepos": '<framepos name="{name}" objtype="site" objname="{name}"/>',
    "framelinvel": '<framelinvel name="{name}_velocity" objtype="site" objname="{name}"/>',
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
class Look:
    """What is proposed for a model, before anything ran.

    Attributes
    ----------
    start : str
        Its key with the start pose; empty if it has none.
    freedoms : int
    reaches : tuple of Reach
        Of all joints that can be driven, the best first.
    sensors : tuple of str
        Names of those it has.
    joints, sites : tuple of str
        Names of what could be measured.
    timestep : float
        The model's [s].
    """

    start: str
    freedoms: int
    reaches: tuple[Reach, ...]
    sensors: tuple[str, ...]
    joints: tuple[str, ...]
    sites: tuple[str, ...]
    timestep: float


def look_at(path: Path) -> Look:
    """Look at a model.

    Raises
    ------
    BadModel
        It does not compile.
    InputError
        It is no planar linkage, or nothing of it can be named.
    """
    model = compile_model(path)
    names = keys(model)
    start = "start" if "start" in names else next(iter(names), "")
    try:
        mechanism, _ = read(model, start)
        pose = nearest(mechanism, mechanism.start)
        free = freedoms(mechanism, pose)
    except ValueError as error:
        raise InputError(
            path,
            "",
            f"the general planar solver does not cover it: {error}. `proofmass check {path.name}` "
            "loads and steps it, and checks nothing",
        ) from None
    motors = {joint_of(model, a) for a in range(model.nactuator)}
    reaches = []
    for j, joint in enumerate(mechanism.joints if free == 1 else ()):
        at, unit = float(pose[j]), TURN if joint.hinge else mechanism.size
        low, high = joint.range
        try:
            below, above = (
                float(Branch(mechanism, (joint.name,)).walk(np.array([[end]]))[0].q[-1, j])
                for end in (max(at - unit, low), min(at + unit, high))
            )
        except ValueError:  # the others do not follow it
            continue
        share = max(at - below, above - at) / unit
        if joint.name and share > LEAST:
            turns = joint.hinge and above - at > TURN * (1 - 1e-9)
            grounded = bool(model.body_parentid[model.jnt_bodyid[j]] == 0)
            reaches.append(Reach(joint.name, at, below, above, share, turns, j in motors, grounded))
    return Look(
        start,
        free,
        tuple(sorted(reaches, key=lambda one: one.rank, reverse=True)),
        tuple(filter(None, sensors(model))),
        tuple(filter(None, (model.joint(j).name for j in range(model.njnt)))),
        tuple(filter(None, (model.site(s).name for s in range(model.nsite)))),
        float(model.opt.timestep),
    )


@dataclass
class Proposal:
    """A sidecar in the making: its runs by kind, and what is told of them."""

    name: str
    model: str
    look: Look
    runs: dict[Kind, list[str]]
    told: list[str] = field(default_factory=list)
    tolerances: list[str] = field(default_factory=list)
    steps: dict[str, float] = field(default_factory=dict)

    def text(self) -> str:
        """The sidecar's text."""
        return "\n".join(self.lines()) + "\n"

    def lines(self) -> Iterator[str]:
        """Its lines."""
        yield f"# Proposed for {self.model} by `proofmass new`; docs/sidecar.md has every key."
        yield from (f"# {line}" for line in self.told)
        yield f'title = "{self.name}"'
        yield 'source = "where the lengths, masses and springs come from"'
        yield 'reference = "planar"  # reads the numbers of the model: a wrong one is wrong in both'
        if self.model != f"{self.name}.xml":
            yield f'model = "{self.model}"'
        if self.look.start not in ("", "start"):
            yield f'start = "{self.look.start}"'
        if self.look.freedoms == 1:
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
            if self.look.freedoms != 1:
                yield f"until = {LET_GO}"
            yield f"solvers = {solvers!r}".replace("'", '"')
        for solver, step in self.steps.items():
            yield ""
            yield f"[settings.{solver}]"
            yield f"timestep = {step!r}"
        yield from self.tolerances


def write_proposal(name: str, model: Path) -> tuple[list[Path], list[str]]:
    """Write a sidecar for a model, beside it; and a copy of the model if that has no sensor.

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
    told : list of str
        What was found, and what no engine covers.

    Raises
    ------
    InputError
        A file is there already; the model does not compile, is no planar linkage, has no joint that
        can be driven, or nothing with a name that could be measured.
    """
    sidecar, own = (model.with_name(f"{name}{ending}") for ending in (".toml", ".xml"))
    if sidecar.exists():
        raise InputError(sidecar, "", "it is there already; give another name")
    try:
        look = isolated(look_at, model, timeout=LOOKING)
    except BadModel as error:
        raise InputError(model, "", str(error).removeprefix(f"{model.name}: ")) from None
    if look.freedoms == 1 and not look.reaches:
        raise InputError(model, "", "no joint with a name can be driven from the start pose")
    if look.freedoms == 0:
        raise InputError(model, "", "it has no degree of freedom: nothing moves")
    written = [sidecar]
    if not look.sensors:
        if own.exists():
            raise InputError(own, "", "it is there already; give another name")
        write_whole(own, with_sensors(model, look))
        model, written = own, [sidecar, own]
    driven = look.freedoms == 1
    there = list(default_engines())
    kinds: list[Kind] = ["sweep", "dynamics"] if driven else ["dynamics"]
    proposal = Proposal(name, model.name, look, dict.fromkeys(kinds, there))
    proposal.told.append(found_in(look))
    try:
        measure(proposal, sidecar)
    except BaseException:
        for file in written:
            file.unlink(missing_ok=True)
        raise
    return written, proposal.told


def found_in(look: Look) -> str:
    """What a model is, in words."""
    if look.freedoms != 1:
        return f"It has {look.freedoms} degrees of freedom and is let go for {LET_GO:g} s."
    best = look.reaches[0]
    turns = "turns once" if best.turns else f"goes {SHARE:.0%} of its way to a limit"
    return f"It has one degree of freedom; joint {best.joint!r} drives it and {turns}."


def with_sensors(model: Path, look: Look) -> str:
    """The model's text with sensors of all joints and sites that have a name."""
    wanted = [
        *(
            SENSORS[kind].format(name=name)
            for name in look.joints
            for kind in ("jointpos", "jointvel")
        ),
        *(
            SENSORS[kind].format(name=name)
            for name in look.sites
            for kind in ("framepos", "framelinvel")
            if name not in look.joints
        ),
    ]
    if not wanted:
        raise InputError(
            model, "", "no joint and no site of it has a name, so none can be measured"
        )
    text = read_text(model)
    head, end, tail = text.rpartition("</mujoco>")
    if not end:
        raise InputError(model, "", "no </mujoco> to write sensors before")
    inside = "\n".join(f"    {one}" for one in wanted)
    return f"{head}\n  <sensor>\n{inside}\n  </sensor>\n{end}{tail}"


def measure(proposal: Proposal, sidecar: Path) -> None:
    """Run what is proposed, leave out what no engine covers, and write the sidecar.

    A free motion has tolerances only by what was measured.
    """
    for kind in list(proposal.runs):
        for solver in list(proposal.runs[kind]):
            try:
                found = closest(proposal, sidecar, kind, solver)
            except InputError as error:
                if not error.key.startswith("run."):
                    raise
                proposal.told.append(f"{kind}: {error.wrong}")
                proposal.runs[kind] = [one for one in proposal.runs[kind] if one != solver]
                if not proposal.runs[kind]:
                    raise InputError(
                        sidecar.with_name(proposal.model), "", f"no engine covers it: {error.wrong}"
                    ) from None
                continue
            proposal.told.append(f"{kind}, {solver}: {worst(found)}")
            if proposal.look.freedoms != 1:
                proposal.tolerances += measured_tolerance(solver, found)
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
    said = f"largest error {far.error_max:.2g} {far.unit} of {far.channel}"
    if far.outcome != Outcome.DIFFERS:
        return said
    return (
        f"{said} at the finest step that was tried, where the engine's tolerance allows "
        f"{far.allowed:.2g} {far.unit}; `proofmass choose` finds a setting that is closer"
    )


def measured_tolerance(solver: str, found: list[Comparison]) -> Iterator[str]:
    """A tolerance for each unit of a free motion, from what a run was off by."""
    errors: dict[str, float] = {}
    for c in found:
        if isfinite(c.error_max):
            errors[c.unit] = max(c.error_max, errors.get(c.unit, 0.0))
    for unit, error in errors.items():
        yield ""
        yield "[[tolerance]]"
        yield 'run = "dynamics"'
        yield f'solver = "{solver}"'
        yield f'unit = "{unit}"'
        yield f"abs = {rounded_up(SLACK * error)!r}"
        yield f'why = "proposed: {SLACK:g} times what was measured, {error:.2g} {unit}"'


def rounded_up(value: float) -> float:
    """The next number with one digit.

    >>> rounded_up(0.0123), rounded_up(3e-7)
    (0.02, 3e-07)
    """
    if not 0 < value < inf:
        return 1e-12
    digits = -floor(log10(value))
    return float(f"{ceil(value * 10**digits - 1e-9)}e{-digits}")
