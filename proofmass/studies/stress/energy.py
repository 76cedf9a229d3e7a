"""How long a free motion keeps its energy, which needs no reference: chaos may have it."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import cast
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from proofmass.case import Case
from proofmass.check import FAILURES
from proofmass.isolate import isolated
from proofmass.reference import compiled
from proofmass.sidecar import Channel
from proofmass.studies.bounded import bounded
from proofmass.studies.invariants import conserved, invariants
from proofmass.studies.measure import Found, Task, taken
from proofmass.studies.rescaled import with_model
from proofmass.studies.setting import Knob
from proofmass.studies.store import key_of
from proofmass.studies.stress.boundary import Failure, Limit, Sought, Tried, told
from proofmass.studies.stress.stand import LONG, TIMEOUT, Stand, limit_of, needs, simulated

INTEGRATORS = "Euler", "implicit", "implicitfast", "RK4"  # discrete is a damper
MOST = 2000  # samples
OFF = 0.01
"""Change of energy, over the largest kinetic energy, that is too much."""
SENSORS = {"e_kinetic": "kinetic", "e_potential": "potential"}


def energies(stand: Stand) -> Iterator[Sought]:
    """More and more steps of a free motion, until its energy is off by a hundredth."""
    why = "energy: something drives, loads or brakes it, or nothing is stepped"
    needs(stand.kind == "duration" and not stand.case.drive, why)
    watched = weighed(stand.case, stand.models)
    needs(bounded(watched, stand.kind, conserved, watched), why)
    yield from stand.integrated("steps until the energy is off by 1 %", "1",
                                stand.seconds / stand.step, LONG,
                                partial(drifted, stand, watched), INTEGRATORS)


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
    return changed.model_copy(update={"channels": {
        f"whole_{name}": Channel(equals=0.0, unit="J") for name in SENSORS.values()}})


def drifted(stand: Stand, case: Case, knobs: dict[str, Knob], steps: float) -> Tried:
    """Run for so many steps, and look at the energy."""
    per = int(np.ceil(steps / MOST))
    count = round(steps / per)
    run = case.run["duration"].model_copy(update={"n": count + 1,
                                                  "until": count * per * stand.step})
    own = case.model_copy(update={"run": {"duration": run}})
    task = Task(own, "duration", stand.setting.but(**knobs), "stress")
    found = stand.store.once(f"{key_of(task)}-energy", task, TIMEOUT, partial(weighing, task))
    if found.outcome != "ran":
        limit = limit_of(found)
        return Tried(Failure(f"{found.outcome}: {found.message}", limit,
                             limit != Limit.OURS and not told(found.message)))
    off = found.invariants.get("energy", 0.0)
    lost = Failure(f"energy off by {off:.2g}", Limit.INACCURATE, silent=True)
    return Tried(None if off <= OFF else lost, found.step)


def weighing(task: Task) -> Found:
    """Run a task for its energy alone."""
    try:
        return cast(Found, isolated(weighed_here, task, timeout=TIMEOUT))
    except tuple(FAILURES) as error:
        return Found(outcome=FAILURES[type(error)], message=str(error))


def weighed_here(task: Task) -> Found:
    """The same, in this process."""
    curves = simulated(task)
    return Found(invariants=invariants(task.case, curves), seconds=curves.seconds,
                 steps=curves.steps, step=taken(task.run, curves))
