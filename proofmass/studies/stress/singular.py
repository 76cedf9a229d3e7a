"""How near a case can come to its singular poses, in each engine and in the reference.

Limit positions, which end a drive's way; poses in which bars come into line and assembly modes
meet, when a link is just long enough; folds, in which a rod snaps to another equilibrium.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.case import Case
from proofmass.errors import InputError
from proofmass.strict import Kind
from proofmass.studies.measure import Task
from proofmass.studies.reread import movable, reread
from proofmass.studies.setting import Setting
from proofmass.studies.store import key_of
from proofmass.studies.stress import closing
from proofmass.studies.stress.boundary import Failure, Limit, Sought, Tried, bisect
from proofmass.studies.stress.stand import LOST, Stand, judged, known, needs, tried
from proofmass.studies.stress.ways import farther, followed, hinged, turning

TURNS = 2.0
NEAREST, SHARP = 1e-9, 1e-12  # [rad] of a limit position; how sharply the reference knows it
SPARE, LEAST = 0.05, 1e-7  # share of a link beyond what just closes: from where, and to where
PIECES = 10, 20, 40  # segments of a rod that is to snap
SAMPLES = 41  # there and back; odd: one at the turn


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
                       lambda far: swept.tried(farther(case, far)), "sweep", theory=limit,
                       law="where the reference has no pose any more")
    if np.isfinite(limit) and stand.kind == "duration":
        yield stand.sought("drive turns back before its limit", "rad", limit - way, NEAREST,
                           lambda gap: stand.tried(turning(case, limit - gap, stand.seconds)))


def between(holds: float, breaks: float) -> float:
    """A boundary from its two sides; infinite where there is none."""
    return float(np.sqrt(holds * breaks)) if np.isfinite(breaks) else np.inf


def unreachable(case: Case, far: float) -> Failure | None:
    """Whether the reference has no pose on the way there."""
    try:
        followed(farther(case, far), "sweep")
    except InputError as error:
        return Failure(str(error), Limit.UNSTABLE)
    return None


def closings(stand: Stand) -> Iterator[Sought]:
    """The last link with less and less to spare, until bars in line are passed the wrong way."""
    yield from spared(stand, "bars in line", "length to spare where bars come in line",
                      closing.last_link(stand.case))


def stretchings(stand: Stand) -> Iterator[Sought]:
    """Both links of the last loop with less and less to spare, until they are stretched."""
    yield from spared(stand, "stretched arm", "length to spare where an arm is stretched",
                      closing.last_arm(stand.case))


def spared(stand: Stand, pose: str, knob: str, links: closing.Links) -> Iterator[Sought]:
    """Links with less and less to spare, in each run."""
    needs(stand.case.drive and movable(stand.case) and known(stand.case) and links,
          f"{pose}: no such links in a driven loop")
    case = reread(stand.case)
    way: Kind = "duration" if "duration" in case.run else "sweep"
    length = closing.least_kept(case, links, way, stand.store)
    needs(np.isfinite(length), f"{pose}: no length of {' and '.join(links)} brings them there")
    for kind in (kind for kind in ("duration", "sweep") if kind in case.run):
        own = replace(stand, case=case, kind=kind)
        yield own.sought(knob, "share", SPARE, LEAST, partial(sparing, own, links, length),
                         own.words if kind == "duration" else kind)


def sparing(stand: Stand, links: closing.Links, length: float, share: float) -> Tried:
    """Run with links so much longer than what just closes.

    The reference has all poses.  A sweep that ends before one of them has not found it, which is a
    limit of our own.
    """
    found = stand.tried(closing.shortened(stand.case, links, stand.models, length * (1.0 + share)))
    if found.failure and found.failure.message.startswith("stopped"):
        return found._replace(failure=found.failure._replace(limit=Limit.OURS))
    return found


def snaps(stand: Stand) -> Iterator[Sought]:
    """The drive further and further, until a rod does not come back the way it went."""
    case = stand.case
    needs(case.rod and "sweep" in case.run and len(case.drive) == 1 and movable(case),
          "fold: no rod that a single drive bends")
    way = abs(float(case.drive[0].to or 0.0) - case.drive[0].start)
    fold = between(*bisect(partial(unreturned, case), way / 16, way, SHARP)[:2])
    unit = "rad" if hinged(case) else "m"
    # an equilibrium that is followed ends at its fold, and need not fall
    knobs = {k: v for k, v in stand.setting.knobs.items() if k != "settled"}
    for pieces in PIECES:
        own = replace(stand, kind="sweep",
                      setting=Setting(stand.setting.engine, {**knobs, "segments": pieces}),
                      patience=max(stand.patience, case.run["sweep"].timeout))
        yield own.sought("drive's way until a rod snaps", unit, way / 16, way,
                         partial(snapped, own), f"{pieces} segments", theory=fold,
                         law="where the reference's rod does not come back the way it went")


def there_and_back(case: Case, far: float) -> Case:
    """The case with a sweep so far, and back, sampled at the same drive values both ways."""
    run = case.run["sweep"].model_copy(update={"n": SAMPLES, "until": None})
    return turning(case, far, 1.0).model_copy(update={"run": {"sweep": run}})


def snapped(stand: Stand, far: float) -> Tried:
    """Whether the engine's rod comes back another way than it went; its error is not asked for."""
    task = Task(there_and_back(stand.case, far), "sweep", stand.setting, "stress")
    found = tried(task, stand.store, stand.patience)
    if found.outcome != "ran":
        return Tried(judged(found))
    curves = stand.store.curves(key_of(task))
    return Tried(parted({name: curves[f"channel.{name}"] for name in places(stand.case)}))


def unreturned(case: Case, far: float) -> Failure | None:
    """Whether the reference's rod comes back another way than it went."""
    wanted = followed(there_and_back(case, far), "sweep").channels
    return parted({name: wanted[name] for name in places(case)})


def places(case: Case) -> list[str]:
    """Channels that are positions."""
    return [name for name, one in case.channels_of("sweep").items() if one.si_unit in ("m", "rad")]


def parted(curves: dict[str, Array]) -> Failure | None:
    """A failure if a curve of a way there and back differs on the way back."""
    for name, values in curves.items():
        apart = float(np.abs(values - values[::-1]).max())
        if apart > LOST * np.ptp(values):
            return Failure(f"{name} comes back {apart:.2g} away from where it went",
                           Limit.UNSTABLE, silent=True)
    return None
