"""Cases whose drives go elsewhere: further, to and fro, on and on; looked at less often."""

from typing import cast

import mujoco
import numpy as np

from proofmass.case import Case
from proofmass.reference import compiled, evaluate, grid, laws
from proofmass.strict import Kind
from proofmass.study.bounded import bounded
from sim.protocol import Curves


def farther(case: Case, far: float) -> Case:
    """The case with its first drive so far, at constant speed, and the others in proportion."""
    leader = case.drive[0]
    way = float(leader.to or 0.0) - leader.start
    times = far / abs(way)
    first, *others = (drive if drive.to is None else drive.model_copy(
        update={"to": drive.start + (drive.to - drive.start) * times}) for drive in case.drive)
    steady = first.model_copy(update={"period": None, "rate": float(np.sign(way))})
    return case.model_copy(update={"drive": (steady, *others)})


def turning(case: Case, far: float, seconds: float) -> Case:
    """The case with its duration a swing so far, and back."""
    leader, *others = farther(case, far).drive
    swing = leader.model_copy(update={"rate": None, "period": seconds})
    return case.model_copy(update={"drive": (swing, *others)})


def sampled(case: Case, steps: float) -> Case:
    """The case with no more samples of its duration than steps."""
    run = case.run["duration"]
    fewer = run.model_copy(update={"n": min(run.n or 2, max(3, int(steps + 1e-9) + 1))})
    return case.model_copy(update={"run": {"duration": fewer}})


def longer(case: Case, factor: float, seconds: float) -> Case:
    """The case with its duration so many times as long, with as many samples.

    A drive that makes no whole turns goes to and fro instead.
    """
    run = case.run["duration"]
    if case.drive and case.drive[0].steady:
        leader = case.drive[0]
        way = abs(float(leader.to or 0.0) - leader.start)
        if turns(case, way):
            moved, *others = farther(case, factor * way).drive
            moved = moved.model_copy(update={"rate": leader.rate})
            return case.model_copy(update={"drive": (moved, *others)})
        case = turning(case, way, 2.0 * seconds)
    return case.model_copy(update={"run": {"duration": run.model_copy(
        update={"until": seconds * factor})}})


def followed(case: Case, kind: Kind) -> Curves:
    """The reference's curves of a run whose drives go just as they should; in a worker."""
    return cast(Curves, bounded(case, kind, followed_here, case, kind))


def followed_here(case: Case, kind: Kind) -> Curves:
    """The same, in this process."""
    x = grid(case, kind)
    state = tuple(np.array(part) for part in zip(*(law(x) for law in laws(case, kind)),
                                                 strict=True))
    return evaluate(case, x, state)  # type: ignore[arg-type]


def turns(case: Case, way: float) -> bool:
    """Whether the leader makes whole turns, and may go on."""
    rest = way / (2 * np.pi) % 1.0
    return hinged(case) and way > 1.0 and min(rest, 1.0 - rest) < 1e-6


def hinged(case: Case) -> bool:
    """Whether the leader is a hinge."""
    kind = int(compiled(case).joint(case.drive[0].joint).type[0])
    return kind == int(mujoco.mjtJoint.mjJNT_HINGE)
