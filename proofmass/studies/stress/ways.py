"""Cases whose drives go elsewhere: further, to and fro, on and on; looked at less often."""

from typing import cast

import mujoco
import numpy as np

from proofmass.case import Case
from proofmass.reference import compiled, evaluate, grid, laws
from proofmass.sim.protocol import Curves
from proofmass.strict import Kind
from proofmass.studies.bounded import bounded

ROUNDING = 1e-9  # of a number of steps
FEWEST = 2  # samples of a run after its first


def farther(case: Case, far: float) -> Case:
    """The case with its first drive so far, at constant speed, and the others in proportion."""
    leader = case.drive[0]
    way = float(leader.to or 0.0) - leader.start
    times = far / abs(way)
    first, *others = (
        drive
        if drive.to is None
        else drive.model_copy(update={"to": drive.start + (drive.to - drive.start) * times})
        for drive in case.drive
    )
    steady = first.model_copy(update={"period": None, "rate": float(np.sign(way))})
    return case.model_copy(update={"drive": (steady, *others)})


def turning(case: Case, far: float, seconds: float) -> Case:
    """The case with its dynamics run a swing so far, and back."""
    leader, *others = farther(case, far).drive
    swing = leader.model_copy(update={"rate": None, "period": seconds})
    return case.model_copy(update={"drive": (swing, *others)})


def in_steps(case: Case, seconds: float, step: float) -> Case:
    """The case with a dynamics run in which an engine takes just the step that is asked for.

    There are whole steps from sample to sample: as many as fit between two samples of the case, or
    one.  The end is moved to the nearest sample; a drive that may go no further than it does, at
    constant speed with no whole turns or by a law, ends at the last one before its end.

    Parameters
    ----------
    case : Case
        With a dynamics run, of a reference that can be evaluated anywhere.
    seconds : float
        Duration that is asked for [s].
    step : float
        Time step [s].

    Returns
    -------
    Case
    """
    run = case.run["dynamics"]
    per = max(1, int(seconds / ((run.n or 2) - 1) / step + ROUNDING))
    samples = seconds / (per * step)
    samples = max(FEWEST, round(samples) if endless(case) else int(samples + ROUNDING))
    case = case.model_copy(update={"run": {"dynamics": run.model_copy(update={"n": samples + 1})}})
    return lasting(case, samples * per * step)


def lasting(case: Case, seconds: float) -> Case:
    """The case with a dynamics run of another length [s], and drives that go on as they do."""
    if case.drive and case.drive[0].steady:
        leader = case.drive[0]
        moved, *others = farther(case, abs(leader.speed) * seconds).drive
        moved = moved.model_copy(update={"rate": leader.rate})
        return case.model_copy(update={"drive": (moved, *others)})
    run = case.run["dynamics"].model_copy(update={"until": seconds})
    return case.model_copy(update={"run": {"dynamics": run}})


def endless(case: Case) -> bool:
    """Whether a motion may go on: free, to and fro, or in whole turns."""
    if not case.drive or case.drive[0].period:
        return True
    leader = case.drive[0]
    return leader.steady and turns(case, abs(float(leader.to or 0.0) - leader.start))


def longer(case: Case, factor: float, seconds: float) -> Case:
    """The case with its dynamics run so many times as long, with as many samples.

    A drive that makes no whole turns goes to and fro instead.
    """
    if not endless(case):
        leader = case.drive[0]
        case = turning(case, abs(float(leader.to or 0.0) - leader.start), 2.0 * seconds)
    return lasting(case, seconds * factor)


def followed(case: Case, kind: Kind) -> Curves:
    """The reference's curves of a run whose drives go just as they should; in a worker."""
    return cast(Curves, bounded(case, kind, followed_here, case, kind))


def followed_here(case: Case, kind: Kind) -> Curves:
    """The same, in this process."""
    x = grid(case, kind)
    state = tuple(
        np.array(part) for part in zip(*(law(x) for law in laws(case, kind)), strict=True)
    )
    return evaluate(case, x, state)  # type: ignore[arg-type]


def turns(case: Case, way: float) -> bool:
    """Whether the leader makes whole turns, and may go on."""
    rest = way / (2 * np.pi) % 1.0
    return hinged(case) and way > 1.0 and min(rest, 1.0 - rest) < 1e-6


def hinged(case: Case) -> bool:
    """Whether the leader is a hinge."""
    kind = int(compiled(case).joint(case.drive[0].joint).type[0])
    return kind == int(mujoco.mjtJoint.mjJNT_HINGE)
