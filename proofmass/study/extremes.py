"""What can be turned to an extreme in a case: how far it goes until a run is lost.

See `proofmass.study.stand` for when that is.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np

from proofmass.case import Case
from proofmass.errors import InputError
from proofmass.mobility import mobility
from proofmass.reference import compiled, evaluate, grid, laws
from proofmass.strict import Kind
from proofmass.study import rescaled
from proofmass.study.boundary import Failure, Sought, bisect
from proofmass.study.setting import Knob, Setting
from proofmass.study.stand import Stand
from proofmass.study.store import Store

INTEGRATORS = "Euler", "implicit", "implicitfast", "RK4", "discrete"
TURNS = 2.0
NEAREST, SHARP = 1e-9, 1e-12  # [rad] of a limit position; how sharply the reference knows it
MANY = 200  # segments
LONG = 1_000_000  # steps


def extremes(case: Case, store: Store) -> tuple[list[Sought], list[str]]:
    """All extremes that apply to a case, and why others do not."""
    found: list[Sought] = []
    skipped: list[str] = []
    kind: Kind = next(k for k in ("duration", "sweep", "rest") if k in case.run)  # type: ignore
    engines = dict.fromkeys(s.partition(":")[0] for s in case.run[kind].solvers)
    for engine in engines:
        knobs = {k: v for k, v in case.settings.get(engine, {}).items() if k != "defaults"}
        stand = Stand(case, kind, Setting(engine, knobs), store)
        for axis in AXES:
            try:
                found += axis(stand)
            except NotHere as why:
                skipped.append(str(why))
    return found, list(dict.fromkeys(skipped))


class NotHere(Exception):
    """An extreme that a case does not have; says why."""


def needs(there: object, why: str) -> None:
    """Raise `NotHere` where something is missing."""
    if not there:
        raise NotHere(why)


def steps(stand: Stand) -> Iterator[Sought]:
    """Larger and larger time steps, with every integrator."""
    needs(stand.kind == "duration", "time step: nothing is stepped")
    for words in INTEGRATORS if stand.setting.engine == "mujoco" else ("as in the model",):
        knobs: dict[str, Knob] = {"integrator": words} if stand.setting.engine == "mujoco" else {}
        yield stand.sought("time step", "s", stand.step, stand.seconds / 4,
                           partial(stepped, stand, knobs), words)


def stepped(stand: Stand, knobs: dict[str, Knob], step: float) -> Failure | None:
    """Run with a step, looked at no more often than that."""
    return stand.lost(sampled(stand.case, stand.seconds / step), timestep=step, **knobs)


def sampled(case: Case, steps: float) -> Case:
    """The case with no more samples of its duration than steps."""
    run = case.run["duration"]
    fewer = run.model_copy(update={"n": min(run.n or 2, max(3, int(steps + 1e-9) + 1))})
    return case.model_copy(update={"run": {"duration": fewer}})


def speeds(stand: Stand) -> Iterator[Sought]:
    """Faster and faster drives."""
    needs(stand.kind == "duration" and stand.case.drive, "drive speed: nothing drives in time")
    leader = stand.case.drive[0]
    needs(leader.to is not None, "drive speed: a law or a recorded drive has its own")
    yield stand.sought("drive speed", "times", 1.0, 1e6, partial(sped, stand))


def sped(stand: Stand, factor: float) -> Failure | None:
    """Drive so many times as fast."""
    case, leader = stand.case, stand.case.drive[0]
    faster = {"period": leader.period / factor} if leader.period else {
        "rate": leader.speed * factor}
    case = case.model_copy(update={"drive": (leader.model_copy(update=faster), *case.drive[1:])})
    run = case.run["duration"]
    case = case.model_copy(update={"run": {"duration": run.model_copy(
        update={"until": run.until and run.until / factor})}})
    return stand.lost(sampled(case, stand.seconds / factor / stand.step))


def weights(stand: Stand) -> Iterator[Sought]:
    """More and more gravity."""
    model = compiled(stand.case)
    needs(model.opt.gravity.any(), "gravity: there is none")
    needs(known(stand.case) or "gravity" in stand.case.parameters,
          "gravity: the reference has its own")
    yield stand.sought("gravity", "times", 1.0, 1e6, lambda factor: stand.lost(
        rescaled.weightier(stand.case, stand.models, factor)))


def known(case: Case) -> bool:
    """Whether the reference follows changes of the masses: by itself, or since it needs none."""
    return case.reference == "planar" or (
        bool(case.drive) and mobility(case) == len(case.drive))


def masses(stand: Stand) -> Iterator[Sought]:
    """The last body heavier and heavier, and lighter and lighter, than the others."""
    bodies = len(rescaled.bodies(stand.case))
    needs(bodies > 1, "mass ratio: one body, or masses of geoms")
    needs(stand.kind == "duration" and known(stand.case),
          "mass ratio: statics knows no inertia, or the reference has its own masses")
    for word, reach in (("heavier", 1e6), ("lighter", 1e-6)):
        yield stand.sought(f"last body {word}", "times", 1.0, reach, lambda factor: stand.lost(
            rescaled.heavier(stand.case, stand.models, factor)))


def springs(stand: Stand) -> Iterator[Sought]:
    """All springs, rods and loads stronger and stronger, and weaker and weaker."""
    model = compiled(stand.case)
    needs(model.jnt_stiffness.any(), "stiffness: there is no spring and no rod")
    needs(stand.kind != "duration" and not model.opt.gravity.any(),
          "stiffness: with weight or inertia its truth is another motion")
    for word, reach in (("stronger", 1e6), ("weaker", 1e-6)):
        yield stand.sought(f"springs and loads {word}", "times", 1.0, reach,
                           lambda factor: stand.lost(
                               rescaled.stiffer(stand.case, stand.models, factor)))


def sizes(stand: Stand) -> Iterator[Sought]:
    """The whole mechanism larger and larger, and smaller and smaller: the curves must scale."""
    model = compiled(stand.case)
    driven = [int(model.joint(drive.joint).type[0]) for drive in stand.case.drive]
    needs(not (stand.case.rod or mujoco.mjtJoint.mjJNT_SLIDE in driven
               or stand.case.reference.endswith(".csv")), "size: the reference has its own lengths")
    needs(len(rescaled.bodies(stand.case)) >= int((model.body_jntnum > 0).sum()),
          "size: masses of geoms")
    for word, reach in (("larger", 1e6), ("smaller", 1e-6)):
        yield stand.sought(f"all lengths {word}", "times", 1.0, reach, lambda factor: stand.lost(
            rescaled.larger(stand.case, stand.models, factor)), theory=refused(model, reach))


def refused(model: mujoco.MjModel, reach: float) -> float:
    """Size at which the least inertia, that of s^2 times the length, is no more than MuJoCo takes.

    The masses are kept; the curves are the same up to there, by dimensional analysis.
    """
    least = model.body_inertia[1:][model.body_mass[1:] > 0].min()
    size = float(np.sqrt(mujoco.mjMINVAL / least))
    return np.inf if reach > 1 else size if size > reach else 0.0


def segments(stand: Stand) -> Iterator[Sought]:
    """Rods in more and more segments."""
    needs(stand.case.rod, "segments: there is no rod")
    fewest = min(rod.segments for rod in stand.case.rods)
    yield stand.sought("segments of each rod", "1", fewest, MANY,
                       lambda n: stand.lost(stand.case, segments=round(n)))


def limits(stand: Stand) -> Iterator[Sought]:
    """The drive further and further, until a limit position, in a sweep."""
    case = stand.case
    needs("sweep" in case.run and case.leader and case.leader.to is not None
          and len(case.drive) == 1 and known(case) and hinged(case),
          "limit position: no single crank to turn on")
    way = abs(float(case.drive[0].to or 0.0) - case.drive[0].start)
    swept = replace(stand, kind="sweep", setting=Setting(stand.setting.engine))
    reach = max(TURNS * 2 * np.pi, 2 * way)
    limit = between(*bisect(partial(unreachable, case), way, reach, SHARP)[:2])
    yield swept.sought("drive's way", "rad", way, reach,
                       lambda far: swept.lost(farther(case, far)), "sweep", theory=limit,
                       law="where the reference has no pose any more")
    if np.isfinite(limit) and stand.kind == "duration":
        yield stand.sought("drive turns back before its limit", "rad", limit - way, NEAREST,
                           lambda gap: stand.lost(turning(case, limit - gap, stand.seconds)))


def between(holds: float, breaks: float) -> float:
    """A boundary from its two sides; infinite where there is none."""
    return float(np.sqrt(holds * breaks)) if np.isfinite(breaks) else np.inf


def farther(case: Case, far: float) -> Case:
    """The case with its sweep so far, at constant speed."""
    leader = case.drive[0]
    way = float(leader.to or 0.0) - leader.start
    to = leader.start + np.sign(way) * far
    steady = leader.model_copy(update={"to": to, "period": None, "rate": float(np.sign(way))})
    return case.model_copy(update={"drive": (steady, *case.drive[1:])})


def turning(case: Case, far: float, seconds: float) -> Case:
    """The case with its duration a swing so far, and back."""
    swing = farther(case, far).drive[0].model_copy(update={"rate": None, "period": seconds})
    return case.model_copy(update={"drive": (swing, *case.drive[1:])})


def unreachable(case: Case, far: float) -> Failure | None:
    """Whether the reference has no pose on the way there."""
    there = farther(case, far)
    x = grid(there, "sweep")
    state = tuple(np.array([part]) for part in laws(there, "sweep")[0](x))
    try:
        evaluate(there, x, state)  # type: ignore[arg-type]
    except InputError as error:
        return Failure(str(error))
    return None


def long(stand: Stand) -> Iterator[Sought]:
    """The same motion on and on, to a million steps."""
    case = stand.case
    needs(stand.kind == "duration" and not case.reference.endswith(".csv"),
          "long run: nothing is stepped, or a recorded curve ends")
    needs(not case.drive or case.drive[0].to is not None, "long run: the drive's law ends")
    own = stand.seconds / stand.step
    yield stand.sought("steps", "1", own, LONG, lambda count: stand.lost(
        longer(case, count / own, stand.seconds)))


def longer(case: Case, factor: float, seconds: float) -> Case:
    """The case with its duration so many times as long, with as many samples.

    A drive that makes no whole turns goes to and fro instead.
    """
    run = case.run["duration"]
    if case.drive and case.drive[0].steady:
        leader = case.drive[0]
        way = abs(float(leader.to or 0.0) - leader.start)
        if turns(case, way):
            moved = farther(case, factor * way).drive[0].model_copy(update={"rate": leader.rate})
            return case.model_copy(update={"drive": (moved, *case.drive[1:])})
        case = turning(case, way, 2.0 * seconds)
    return case.model_copy(update={"run": {"duration": run.model_copy(
        update={"until": seconds * factor})}})


def turns(case: Case, way: float) -> bool:
    """Whether the leader makes whole turns, and may go on."""
    rest = way / (2 * np.pi) % 1.0
    return hinged(case) and way > 1.0 and min(rest, 1.0 - rest) < 1e-6


def hinged(case: Case) -> bool:
    """Whether the leader is a hinge."""
    kind = int(compiled(case).joint(case.drive[0].joint).type[0])
    return kind == int(mujoco.mjtJoint.mjJNT_HINGE)


AXES: tuple[Callable[[Stand], Iterator[Sought]], ...] = (
    steps, speeds, weights, masses, springs, sizes, segments, limits, long)
