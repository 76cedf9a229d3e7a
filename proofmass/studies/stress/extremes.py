"""What can be varied to an extreme in a case, and how far it goes until a run fails.

Among it are the energy of a free motion, which needs no reference, since the motion may be chaotic;
the size of the whole mechanism, with which the curves must scale; and a spring in the joint that
the drives move last, made stiffer over 12 decades.

See `proofmass.studies.stress.stand` for when a run counts as failed.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from proofmass.case import Case, Channel
from proofmass.outcome import FAILURES, Outcome
from proofmass.reference import compiled
from proofmass.strict import Kind
from proofmass.studies import variants
from proofmass.studies.bounded import bounded
from proofmass.studies.invariants import conserved, invariants
from proofmass.studies.measure import Measurement, StudyRun, taken
from proofmass.studies.record import ParameterValue, Setting, format_kind
from proofmass.studies.store import Store, key_of
from proofmass.studies.stress import theory
from proofmass.studies.stress.boundary import NAN, BoundaryKind, Failure, Sought, Tried, told
from proofmass.studies.stress.near_singular import closings, limits, snaps, stretchings
from proofmass.studies.stress.stand import (
    LONG,
    TIMEOUT,
    NotHere,
    Stand,
    judged,
    known,
    limit_of,
    needs,
    simulated,
)
from proofmass.studies.stress.ways import in_steps, longer
from proofmass.studies.variants import movable, reread, with_model
from proofmass.worker import isolated

MOST = 2000  # samples
OFF = 0.01
"""Change of energy, over the largest kinetic energy, that is too much."""
SENSORS = {"e_kinetic": "kinetic", "e_potential": "potential"}


def energies(stand: Stand) -> Iterator[Sought]:
    """More and more steps of a free motion, until its energy is off by a hundredth."""
    why = "energy: something drives, loads or brakes it, or nothing is stepped"
    needs(stand.kind == "dynamics" and not stand.case.drive, why)
    watched = weighed(stand.case, stand.models)
    needs(bounded(watched, stand.kind, conserved, watched), why)
    yield from stand.integrated(
        "steps until the energy is off by 1 %",
        "1",
        stand.seconds / stand.step,
        LONG,
        partial(drifted, stand, watched),
        [one for one in stand.engine.schemes if one.conserves],
    )


def weighed(case: Case, folder: Path) -> Case:
    """The case with sensors of both energies alone, and without motors that stand idle."""
    idle = not compiled(case).key_ctrl.any()

    def change(root: Element) -> None:
        for old in [one for one in root if one.tag == "sensor" or (one.tag == "actuator" and idle)]:
            root.remove(old)
        for key in root.iter("key") if idle else ():
            key.attrib.pop("ctrl", None)
        sensors = ElementTree.SubElement(root, "sensor")
        for tag, name in SENSORS.items():
            ElementTree.SubElement(sensors, tag, name=f"whole_{name}")

    changed = with_model(case, folder, change)
    return changed.model_copy(
        update={
            "channels": {
                f"whole_{name}": Channel(equals=0.0, unit="J") for name in SENSORS.values()
            }
        }
    )


def drifted(stand: Stand, case: Case, parameters: dict[str, ParameterValue], steps: float) -> Tried:
    """Run for so many steps, and look at the energy."""
    per = int(np.ceil(steps / MOST))
    count = round(steps / per)
    run = case.run["dynamics"].model_copy(
        update={"n": count + 1, "until": count * per * stand.step}
    )
    own = case.model_copy(update={"run": {"dynamics": run}})
    task = StudyRun(own, "dynamics", stand.setting.but(**parameters), "stress")
    found = stand.store.once(f"{key_of(task)}-energy", task, TIMEOUT, partial(weighing, task))
    if found.outcome != Outcome.RAN:
        limit = limit_of(found)
        return Tried(
            Failure(
                f"{found.outcome}: {found.message}",
                limit,
                limit != BoundaryKind.OURS and not told(found.message),
            )
        )
    off = found.invariants.get("energy", 0.0)
    lost = Failure(f"energy off by {off:.2g}", BoundaryKind.INACCURATE, silent=True)
    return Tried(None if off <= OFF else lost, found.step)


def weighing(task: StudyRun) -> Measurement:
    """Run a task for its energy alone."""
    try:
        return cast(Measurement, isolated(weighed_here, task, timeout=TIMEOUT))
    except tuple(FAILURES) as error:
        return Measurement(outcome=FAILURES[type(error)], message=str(error))


def weighed_here(task: StudyRun) -> Measurement:
    """The same, in this process."""
    curves = simulated(task)
    return Measurement(
        invariants=invariants(task.case, curves),
        seconds=curves.seconds,
        steps=curves.steps,
        step=taken(task.run, curves),
    )


ROUNDING = 1e-9  # share of a curve's range that rounding may change, at worst in chaos
NULL = 1e-6  # [m] `kFrameEps` of MuJoCo's src/user/user_model.cc


def sizes(stand: Stand) -> Iterator[Sought]:
    """All lengths longer and shorter, beside what MuJoCo compiles at all."""
    model = compiled(stand.case)
    driven = [int(model.joint(drive.joint).type[0]) for drive in stand.case.drive]
    needs(
        not (stand.case.rod or mujoco.mjtJoint.mjJNT_SLIDE in driven or stand.case.recorded),
        "size: the reference has its own lengths",
    )
    needs(
        len(variants.bodies(stand.case)) >= int((model.body_jntnum > 0).sum()),
        "size: masses of geoms",
    )
    weighs = bool(model.opt.gravity.any()) if stand.kind != "dynamics" else not driven
    least = smallest(model, weighs)
    limit = least if least > 1e-6 else 0.0
    if limit and not stand.engine.native:  # of another engine than the one it is read for
        limit = NAN
    for word, reach, expected in (("larger", 1e6, np.inf), ("smaller", 1e-6, limit)):
        yield stand.sought(
            f"all lengths {word}",
            "times",
            1.0,
            reach,
            partial(resized, stand, least),
            theory=expected,
            law="dimensional analysis, of what MuJoCo compiles",
        )


def resized(stand: Stand, least: float, factor: float) -> Tried:
    """Run at another size, down to the least that MuJoCo compiles for other engines as well."""
    if factor < least and not stand.engine.native:
        return Tried(
            Failure(
                f"MuJoCo, which reads the model for {stand.setting.engine}, compiles "
                f"the same mechanism down to {least:.3g} times its size",
                BoundaryKind.OURS,
            )
        )
    found = stand.run(variants.larger(stand.case, stand.models, factor))
    return Tried(unlike(found, stand.run(stand.case)), found.step)


def unlike(found: Measurement, own: Measurement) -> Failure | None:
    """Why a run at another size is lost: errors must be those at its own, by dimensional analysis.

    What is ten times as large is another curve; rounding is not that of another size.
    """
    if failure := judged(found):
        return failure
    for kind, error in found.errors.items():
        if error > 10.0 * own.errors[kind] + ROUNDING:
            return Failure(
                f"{format_kind(kind)} off by {error:.2g} of its range, "
                f"{own.errors[kind]:.2g} at its size",
                BoundaryKind.INACCURATE,
                silent=True,
            )
    return None


def smallest(model: mujoco.MjModel, weighs: bool) -> float:
    """Size from which on MuJoCo compiles the same mechanism.

    It refuses inertias, s^2 times as large here, up to mjMINVAL, and takes for the origin of its
    body what is less than 1e-6 m from it along each axis: sites, and where bodies weigh anything
    their centres of mass.
    """
    alike = int(mujoco.mjtSameFrame.mjSAMEFRAME_BODYROT)  # turned as their bodies are
    places = model.site_pos[model.site_sameframe == alike]
    centres = model.body_ipos[(model.body_sameframe == alike) & weighs]
    inertia = model.body_inertia[model.body_mass > 0]
    return float(
        np.concatenate(
            [
                NULL / np.abs(places).max(axis=1),
                NULL / np.abs(centres).max(axis=1),
                np.sqrt(mujoco.mjMINVAL / inertia).max(axis=1),
            ]
        ).max()
    )


DECADES = 1e12
BRIEF = 100  # steps of a free motion: the reference has to follow each swing of the spring


def stiffnesses(stand: Stand) -> Iterator[Sought]:
    """A stiffer and stiffer spring in the last hinge, from one that swings once in the run."""
    needs(
        stand.kind == "dynamics" and movable(stand.case) and not stand.case.rod,
        "stiffness in motion: nothing is stepped, or rods bend in it",
    )
    free = not stand.case.drive
    needs(free or known(stand.case), "stiffness in motion: the springs move it as well")
    joint, inertia = last_hinge(stand.case)
    seconds = min(stand.seconds, BRIEF * stand.step) if free else stand.seconds
    case = brief(reread(stand.case), seconds, stand.step) if free else stand.case
    softest = inertia * (2.0 * np.pi / seconds) ** 2
    limit = NAN
    scheme = stand.engine.scheme_of(stand.setting.parameters, compiled(stand.case))
    if free and compiled(case).nv == 1 and scheme:
        z = theory.stiffest(scheme, seconds / stand.step)
        limit = inertia * (z / stand.step) ** 2
    yield stand.sought(
        f"spring in {joint}",
        "N m/rad",
        softest,
        DECADES * softest,
        partial(sprung, stand, case, joint),
        theory=limit,
        law="" if limit != limit else "powers of the step's matrix",
    )


def last_hinge(case: Case) -> tuple[str, float]:
    """The last hinge that is not driven, and the inertia that it moves [kg m^2]."""
    model, driven = compiled(case), [drive.joint for drive in case.drive]
    hinges = [
        j
        for j in range(model.njnt)
        if model.joint(j).name not in driven and model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
    ]
    needs(hinges, "stiffness in motion: no hinge but those that are driven")
    data, inertia = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_resetDataKeyframe(model, data, model.key(case.start).id)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    return str(model.joint(hinges[-1]).name), float(inertia[hinges[-1], hinges[-1]])


def brief(case: Case, seconds: float, step: float) -> Case:
    """The case with a shorter dynamics run, looked at after every step."""
    run = case.run["dynamics"].model_copy(update={"n": round(seconds / step) + 1})
    return in_steps(case.model_copy(update={"run": {"dynamics": run}}), seconds, step)


def sprung(stand: Stand, case: Case, joint: str, stiffness: float) -> Tried:
    """Run with a spring."""
    return stand.tried(with_spring(case, stand.models, joint, stiffness))


def with_spring(case: Case, folder: Path, joint: str, stiffness: float) -> Case:
    """The case with a spring in a joint, in place of what is there."""

    def change(root: Element) -> None:
        hinge = next(one for one in root.iter("joint") if one.get("name") == joint)
        hinge.set("stiffness", repr(stiffness))

    return with_model(case, folder, change)


MANY, PATIENCE = 200, 600.0  # segments, and how long so many may take [s]
FEW = 4  # steps of the shortest runs: a way there and back in two of them would look like none


def extremes(case: Case, store: Store) -> tuple[list[Sought], list[str]]:
    """All extremes that apply to a case, and why others do not."""
    found: list[Sought] = []
    skipped: list[str] = []
    kind: Kind = next(k for k in ("dynamics", "sweep", "equilibrium") if k in case.run)  # type: ignore
    first = dict[str, str]()
    for solver in case.run[kind].solvers:
        first.setdefault(solver.partition(":")[0], solver)
    for engine, solver in first.items():
        parameters = {k: v for k, v in case.settings.get(solver, {}).items() if k != "defaults"}
        stand = Stand(case, kind, Setting(engine, parameters), store)
        for axis in AXES:
            try:
                found += axis(stand)
            except NotHere as why:
                skipped.append(str(why))
    return found, list(dict.fromkeys(skipped))


def steps(stand: Stand) -> Iterator[Sought]:
    """Larger and larger time steps, with every integrator."""
    needs(stand.kind == "dynamics", "time step: nothing is stepped")
    needs(not stand.case.recorded, "time step: a recorded curve has its own samples")
    yield from stand.integrated(
        "time step",
        "s",
        stand.step,
        stand.seconds / FEW,
        partial(stepped, stand),
        stand.engine.schemes,
    )


def stepped(stand: Stand, parameters: dict[str, ParameterValue], step: float) -> Tried:
    """Run with a step, looked at no more often than that."""
    return stand.stepped(stand.case, stand.seconds, timestep=step, **parameters)


def speeds(stand: Stand) -> Iterator[Sought]:
    """Faster and faster drives, until there are but a few steps."""
    needs(stand.kind == "dynamics" and stand.case.drive, "drive speed: nothing drives in time")
    leader = stand.case.drive[0]
    needs(
        leader.to is not None and not stand.case.recorded,
        "drive speed: a law or a recorded drive has its own",
    )
    yield stand.sought(
        "drive speed", "times", 1.0, stand.seconds / (FEW * stand.step), partial(sped, stand)
    )


def sped(stand: Stand, factor: float) -> Tried:
    """Drive so many times as fast."""
    case, leader = stand.case, stand.case.drive[0]
    faster = (
        {"period": leader.period / factor} if leader.period else {"rate": leader.speed * factor}
    )
    case = case.model_copy(update={"drive": (leader.model_copy(update=faster), *case.drive[1:])})
    run = case.run["dynamics"]
    case = case.model_copy(
        update={
            "run": {"dynamics": run.model_copy(update={"until": run.until and run.until / factor})}
        }
    )
    return stand.stepped(case, stand.seconds / factor)


def weights(stand: Stand) -> Iterator[Sought]:
    """More and more gravity."""
    model = compiled(stand.case)
    needs(model.opt.gravity.any(), "gravity: there is none")
    needs(
        known(stand.case) or "gravity" in stand.case.parameters,
        "gravity: the reference has its own",
    )
    yield stand.sought(
        "gravity",
        "times",
        1.0,
        1e6,
        lambda factor: stand.tried(variants.weightier(stand.case, stand.models, factor)),
    )


def masses(stand: Stand) -> Iterator[Sought]:
    """The last body heavier and heavier, and lighter and lighter, than the others."""
    bodies = len(variants.bodies(stand.case))
    needs(bodies > 1, "mass ratio: one body, or masses of geoms")
    needs(
        stand.kind == "dynamics" and known(stand.case),
        "mass ratio: statics knows no inertia, or the reference has its own masses",
    )
    for word, reach in (("heavier", 1e6), ("lighter", 1e-6)):
        yield stand.sought(
            f"last body {word}",
            "times",
            1.0,
            reach,
            lambda factor: stand.tried(variants.heavier(stand.case, stand.models, factor)),
        )


def springs(stand: Stand) -> Iterator[Sought]:
    """All springs, rods and loads stronger and stronger, and weaker and weaker."""
    model = compiled(stand.case)
    needs(model.jnt_stiffness.any(), "stiffness: there is no spring and no rod")
    needs(
        stand.kind != "dynamics" and not model.opt.gravity.any(),
        "stiffness: with weight or inertia its truth is another motion",
    )
    for word, reach in (("stronger", 1e6), ("weaker", 1e-6)):
        yield stand.sought(
            f"springs and loads {word}",
            "times",
            1.0,
            reach,
            lambda factor: stand.tried(variants.stiffer(stand.case, stand.models, factor)),
        )


def segments(stand: Stand) -> Iterator[Sought]:
    """Rods in more and more segments."""
    needs(stand.case.rod, "segments: there is no rod")
    fewest = min(rod.segments for rod in stand.case.rods)
    patient = replace(stand, patience=PATIENCE)
    yield stand.sought(
        "segments of each rod",
        "1",
        fewest,
        MANY,
        lambda n: patient.tried(stand.case, segments=round(n)),
    )


def long(stand: Stand) -> Iterator[Sought]:
    """The same motion on and on, to a million steps."""
    case = stand.case
    needs(
        stand.kind == "dynamics" and not case.recorded,
        "long run: nothing is stepped, or a recorded curve ends",
    )
    needs(not case.drive or case.drive[0].to is not None, "long run: the drive's law ends")
    own = stand.seconds / stand.step
    yield stand.sought(
        "steps",
        "1",
        own,
        LONG,
        lambda count: stand.stepped(longer(case, count / own, stand.seconds), count * stand.step),
    )


AXES: tuple[Callable[[Stand], Iterator[Sought]], ...] = (
    steps,
    speeds,
    weights,
    masses,
    springs,
    stiffnesses,
    sizes,
    segments,
    limits,
    closings,
    stretchings,
    snaps,
    long,
    energies,
)
