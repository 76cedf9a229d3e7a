"""What can be turned to an extreme in a case: how far it goes until a run is lost.

See `proofmass.studies.stress.stand` for when that is.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from proofmass.case import Case
from proofmass.reference import compiled
from proofmass.strict import Kind
from proofmass.studies import rescaled
from proofmass.studies.setting import Knob, Setting
from proofmass.studies.store import Store
from proofmass.studies.stress.boundary import Sought, Tried
from proofmass.studies.stress.energy import energies
from proofmass.studies.stress.singular import closings, limits, snaps, stretchings
from proofmass.studies.stress.size import sizes
from proofmass.studies.stress.stand import LONG, NotHere, Stand, known, needs
from proofmass.studies.stress.stiffness import stiffnesses
from proofmass.studies.stress.ways import longer

INTEGRATORS = "Euler", "implicit", "implicitfast", "RK4", "discrete"
MANY, PATIENCE = 200, 600.0  # segments, and how long so many may take [s]
FEW = 4  # steps of the shortest runs: a way there and back in two of them would look like none


def extremes(case: Case, store: Store) -> tuple[list[Sought], list[str]]:
    """All extremes that apply to a case, and why others do not."""
    found: list[Sought] = []
    skipped: list[str] = []
    kind: Kind = next(k for k in ("duration", "sweep", "rest") if k in case.run)  # type: ignore
    first = dict[str, str]()
    for solver in case.run[kind].solvers:
        first.setdefault(solver.partition(":")[0], solver)
    for engine, solver in first.items():
        knobs = {k: v for k, v in case.settings.get(solver, {}).items() if k != "defaults"}
        stand = Stand(case, kind, Setting(engine, knobs), store)
        for axis in AXES:
            try:
                found += axis(stand)
            except NotHere as why:
                skipped.append(str(why))
    return found, list(dict.fromkeys(skipped))


def steps(stand: Stand) -> Iterator[Sought]:
    """Larger and larger time steps, with every integrator."""
    needs(stand.kind == "duration", "time step: nothing is stepped")
    needs(not recorded(stand.case), "time step: a recorded curve has its own samples")
    yield from stand.integrated("time step", "s", stand.step, stand.seconds / FEW,
                                partial(stepped, stand), INTEGRATORS)


def recorded(case: Case) -> bool:
    """Whether the reference is a curve that is known at its samples alone."""
    return case.reference.endswith(".csv")


def stepped(stand: Stand, knobs: dict[str, Knob], step: float) -> Tried:
    """Run with a step, looked at no more often than that."""
    return stand.stepped(stand.case, stand.seconds, timestep=step, **knobs)


def speeds(stand: Stand) -> Iterator[Sought]:
    """Faster and faster drives, until there are but a few steps."""
    needs(stand.kind == "duration" and stand.case.drive, "drive speed: nothing drives in time")
    leader = stand.case.drive[0]
    needs(leader.to is not None and not recorded(stand.case),
          "drive speed: a law or a recorded drive has its own")
    yield stand.sought("drive speed", "times", 1.0, stand.seconds / (FEW * stand.step),
                       partial(sped, stand))


def sped(stand: Stand, factor: float) -> Tried:
    """Drive so many times as fast."""
    case, leader = stand.case, stand.case.drive[0]
    faster = {"period": leader.period / factor} if leader.period else {
        "rate": leader.speed * factor}
    case = case.model_copy(update={"drive": (leader.model_copy(update=faster), *case.drive[1:])})
    run = case.run["duration"]
    case = case.model_copy(update={"run": {"duration": run.model_copy(
        update={"until": run.until and run.until / factor})}})
    return stand.stepped(case, stand.seconds / factor)


def weights(stand: Stand) -> Iterator[Sought]:
    """More and more gravity."""
    model = compiled(stand.case)
    needs(model.opt.gravity.any(), "gravity: there is none")
    needs(known(stand.case) or "gravity" in stand.case.parameters,
          "gravity: the reference has its own")
    yield stand.sought("gravity", "times", 1.0, 1e6, lambda factor: stand.tried(
        rescaled.weightier(stand.case, stand.models, factor)))


def masses(stand: Stand) -> Iterator[Sought]:
    """The last body heavier and heavier, and lighter and lighter, than the others."""
    bodies = len(rescaled.bodies(stand.case))
    needs(bodies > 1, "mass ratio: one body, or masses of geoms")
    needs(stand.kind == "duration" and known(stand.case),
          "mass ratio: statics knows no inertia, or the reference has its own masses")
    for word, reach in (("heavier", 1e6), ("lighter", 1e-6)):
        yield stand.sought(f"last body {word}", "times", 1.0, reach, lambda factor: stand.tried(
            rescaled.heavier(stand.case, stand.models, factor)))


def springs(stand: Stand) -> Iterator[Sought]:
    """All springs, rods and loads stronger and stronger, and weaker and weaker."""
    model = compiled(stand.case)
    needs(model.jnt_stiffness.any(), "stiffness: there is no spring and no rod")
    needs(stand.kind != "duration" and not model.opt.gravity.any(),
          "stiffness: with weight or inertia its truth is another motion")
    for word, reach in (("stronger", 1e6), ("weaker", 1e-6)):
        yield stand.sought(f"springs and loads {word}", "times", 1.0, reach,
                           lambda factor: stand.tried(
                               rescaled.stiffer(stand.case, stand.models, factor)))


def segments(stand: Stand) -> Iterator[Sought]:
    """Rods in more and more segments."""
    needs(stand.case.rod, "segments: there is no rod")
    fewest = min(rod.segments for rod in stand.case.rods)
    patient = replace(stand, patience=PATIENCE)
    yield stand.sought("segments of each rod", "1", fewest, MANY,
                       lambda n: patient.tried(stand.case, segments=round(n)))


def long(stand: Stand) -> Iterator[Sought]:
    """The same motion on and on, to a million steps."""
    case = stand.case
    needs(stand.kind == "duration" and not recorded(case),
          "long run: nothing is stepped, or a recorded curve ends")
    needs(not case.drive or case.drive[0].to is not None, "long run: the drive's law ends")
    own = stand.seconds / stand.step
    yield stand.sought("steps", "1", own, LONG, lambda count: stand.stepped(
        longer(case, count / own, stand.seconds), count * stand.step))


AXES: tuple[Callable[[Stand], Iterator[Sought]], ...] = (
    steps, speeds, weights, masses, springs, stiffnesses, sizes, segments, limits, closings,
    stretchings, snaps, long, energies)
