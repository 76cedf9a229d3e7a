"""A linkage nearer and nearer to where it cannot be closed: a change point, or a stretched arm.

Links of its last loop are shortened as far as the mechanism can still make its whole way.  There
some of its bars come into line, and two assembly modes meet:

    1, 2, r, 3, the crank turning    r -> 2         coupler and rocker in line, one on the other
    1, c, r, 3, the crank turning    c + r -> 4     coupler and rocker in line, stretched
    five-bar                         the last coupler alone, or both, as a four-bar's

With a share g to spare the two modes are apart by an angle of the order sqrt(g).  A loop that an
engine leaves open by a share e of its size turns the bars by e / sqrt(g), and passes into the other
mode from g = e on.

Other singular poses are limit positions, which end a drive's way, and folds, in which a rod snaps
to another equilibrium.
"""

from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.analytic.planar import read
from proofmass.analytic.planar.kinematics import Drives, newton
from proofmass.case import Case
from proofmass.errors import InputError
from proofmass.outcome import Outcome
from proofmass.reference import compiled
from proofmass.strict import Kind
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import Setting
from proofmass.studies.store import MATTERS, Store, digest, key_of, model_bytes, once, sources
from proofmass.studies.stress.boundary import BoundaryKind, Failure, TrialResult
from proofmass.studies.stress.limit_search import (
    LOST,
    LimitSearch,
    StressedCase,
    bisect,
    find_failure,
    measure_once,
    reference_follows_masses,
    require,
)
from proofmass.studies.variants import (
    evaluate_run,
    has_hinged_leader,
    movable,
    self_referenced,
    times,
    with_model,
    with_swing,
    with_way,
)

LONGEST, SHORTEST = (1.1, 1.0), 0.2  # times its length: from where and to where it is shortened
PACE = 0.02  # change of the link from one closed start pose to the next: none is leapt over
LENGTH_WITHIN = 1e-9  # how sharply the shortest length is found


BodyNames = tuple[str, ...]
"""Sites at the ends of links."""


def ends(case: Case) -> Iterator[BodyNames]:
    """Of each loop, the last first, the ends of the links that it holds together."""
    model = compiled(case)
    for e in reversed(range(model.neq)):
        if int(model.eq_objtype[e]) == mujoco.mjtObj.mjOBJ_SITE:
            pair = int(model.eq_obj2id[e]), int(model.eq_obj1id[e])
            yield tuple(
                str(model.site(site).name)
                for site in pair
                if model.site_bodyid[site] and model.site_pos[site].any()
            )


def last_link(case: Case) -> BodyNames:
    """The end of the last link that a loop holds; none if there is none."""
    return next((links[:1] for links in ends(case) if links), ())


def last_arm(case: Case) -> BodyNames:
    """The ends of both links of the last loop, if nothing else drives or holds them; or none."""
    model, (last, *others) = compiled(case), [*ends(case)] or [()]
    bodies = [int(model.site(link).bodyid[0]) for link in last]
    held = {int(model.site(link).bodyid[0]) for links in others for link in links}
    driven = {int(model.joint(drive.joint).bodyid[0]) for drive in case.drive}
    return last if len(bodies) == 2 and not {*bodies} & (held | driven) else ()


def shortened(case: Case, links: BodyNames, folder: Path, factor: float) -> Case:
    """The case with links so many times as long, and closed in its start pose."""
    pose = closed(case, links, factor)

    def change(root: Element) -> None:
        for site in root.iter("site"):
            if site.get("name") in links:
                times(site, "pos", factor)
        key = next(key for key in root.iter("key") if key.get("name") == case.start)
        key.set("qpos", " ".join(map(repr, pose.tolist())))

    return with_model(case, folder, change)


def closed(case: Case, links: BodyNames, factor: float) -> Array:
    """Joint values of the start pose with links so many times as long.

    Raises
    ------
    InputError
        The loops cannot be closed there.
    """
    model = copy(compiled(case))
    sites = [model.site(link).id for link in links]
    lengths, joints = model.site_pos[sites].copy(), tuple(d.joint for d in case.drive)
    pose = read(model, case.start)[0].start
    for share in np.linspace(1.0, factor, int(abs(factor - 1.0) / PACE) + 2).tolist():
        model.site_pos[sites] = share * lengths
        mechanism, _ = read(model, case.start)
        try:
            pose = newton(mechanism, pose[None], Drives.of(mechanism, joints))[0]
        except ValueError as error:
            raise InputError(case.model_path, "", str(error)) from None
    return pose


def find_shortest_length(case: Case, links: BodyNames, kind: Kind, folder: Path) -> float:
    """Length of links, in their own, from which on the mechanism makes its whole way.

    NaN where the reference has no poses with longer ones, or has them all with shorter ones.
    """
    for longest in LONGEST:
        holds, breaks, _ = bisect(
            partial(unclosed, case, links, kind, folder), longest, SHORTEST, LENGTH_WITHIN
        )
        if holds == holds:
            return float(np.sqrt(holds * breaks))
    return float("nan")


def cached_shortest_length(case: Case, links: BodyNames, kind: Kind, store: Store) -> float:
    """The same, found once for both engines: steps of the reference are short at singular poses."""
    name = repr((case.model_dump_json(include=MATTERS), links, kind, sources()))
    file = store.folder / f"{digest(name.encode() + model_bytes(case))}.least.json"
    return float(
        once(file, lambda: find_shortest_length(case, links, kind, store.folder / "models"))
    )


def unclosed(
    case: Case, links: BodyNames, kind: Kind, folder: Path, factor: float
) -> Failure | None:
    """Why the mechanism does not make its whole way with links so many times as long."""
    try:
        evaluate_run(shortened(case, links, folder, factor), kind)
    except InputError as error:
        return Failure(error.wrong, BoundaryKind.UNSTABLE)
    return None


TURNS = 2.0
NEAREST, LIMIT_WITHIN = 1e-9, 1e-12  # [rad] of a limit position; how sharply the reference knows it
SPARE, LEAST = 0.05, 1e-7  # share of a link beyond what just closes: from where, and to where
PIECES = 10, 20, 40  # segments of a rod that is to snap
SAMPLES = 41  # there and back; odd: one at the turn


def limits(stressed: StressedCase) -> Iterator[LimitSearch]:
    """The drive further and further, until a limit position, in a sweep."""
    case = stressed.case
    require(
        "sweep" in case.run
        and case.leader
        and case.leader.to is not None
        and len(case.drive) == 1
        and reference_follows_masses(case)
        and has_hinged_leader(case),
        "limit position: no single crank to turn on",
    )
    way = abs(float(case.drive[0].to or 0.0) - case.drive[0].start)
    swept = replace(stressed, kind="sweep", setting=Setting(stressed.setting.engine))
    reach = max(TURNS * 2 * np.pi, 2 * way)
    limit = between(*bisect(partial(unreachable, case), way, reach, LIMIT_WITHIN)[:2])
    yield swept.search(
        "drive's way",
        "rad",
        way,
        reach,
        lambda far: swept.try_case(with_way(case, far)),
        "sweep",
        theory=limit,
        law="where the reference has no pose any more",
    )
    if np.isfinite(limit) and stressed.kind == "dynamics":
        yield stressed.search(
            "drive turns back before its limit",
            "rad",
            limit - way,
            NEAREST,
            lambda gap: stressed.try_case(with_swing(case, limit - gap, stressed.seconds)),
        )


def between(holds: float, breaks: float) -> float:
    """A boundary from its two sides; infinite where there is none."""
    return float(np.sqrt(holds * breaks)) if np.isfinite(breaks) else np.inf


def unreachable(case: Case, far: float) -> Failure | None:
    """Whether the reference has no pose on the way there."""
    try:
        evaluate_run(with_way(case, far), "sweep")
    except InputError as error:
        return Failure(str(error), BoundaryKind.UNSTABLE)
    return None


def closings(stressed: StressedCase) -> Iterator[LimitSearch]:
    """The last link with less and less to spare, until bars in line are passed the wrong way."""
    yield from spared(
        stressed,
        "bars in line",
        "length to spare where bars come in line",
        last_link(stressed.case),
    )


def stretchings(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Both links of the last loop with less and less to spare, until they are stretched."""
    yield from spared(
        stressed,
        "stretched arm",
        "length to spare where an arm is stretched",
        last_arm(stressed.case),
    )


def spared(
    stressed: StressedCase, pose: str, parameter: str, links: BodyNames
) -> Iterator[LimitSearch]:
    """Links with less and less to spare, in each run."""
    require(
        stressed.case.drive
        and movable(stressed.case)
        and reference_follows_masses(stressed.case)
        and links,
        f"{pose}: no such links in a driven loop",
    )
    case = self_referenced(stressed.case)
    way: Kind = "dynamics" if "dynamics" in case.run else "sweep"
    length = cached_shortest_length(case, links, way, stressed.store)
    require(np.isfinite(length), f"{pose}: no length of {' and '.join(links)} brings them there")
    for kind in (kind for kind in ("dynamics", "sweep") if kind in case.run):
        own = replace(stressed, case=case, kind=kind)
        yield own.search(
            parameter,
            "share",
            SPARE,
            LEAST,
            partial(sparing, own, links, length),
            own.integrator if kind == "dynamics" else kind,
        )


def sparing(stressed: StressedCase, links: BodyNames, length: float, share: float) -> TrialResult:
    """Run with links so much longer than what just closes.

    The reference has all poses.  A sweep that ends before one of them has not found it, which is a
    limit of our own.
    """
    found = stressed.try_case(
        shortened(stressed.case, links, stressed.models, length * (1.0 + share))
    )
    if found.failure and found.failure.message.startswith("stopped"):
        return found._replace(failure=found.failure._replace(limit=BoundaryKind.OURS))
    return found


def snaps(stressed: StressedCase) -> Iterator[LimitSearch]:
    """The drive further and further, until a rod does not come back the way it went."""
    case = stressed.case
    require(
        case.rod and "sweep" in case.run and len(case.drive) == 1 and movable(case),
        "fold: no rod that a single drive bends",
    )
    way = abs(float(case.drive[0].to or 0.0) - case.drive[0].start)
    fold = between(*bisect(partial(unreturned, case), way / 16, way, LIMIT_WITHIN)[:2])
    unit = "rad" if has_hinged_leader(case) else "m"
    # an equilibrium that is followed ends at its fold, and need not fall
    parameters = {k: v for k, v in stressed.setting.parameters.items() if k != "settled"}
    for pieces in PIECES:
        own = replace(
            stressed,
            kind="sweep",
            setting=Setting(stressed.setting.engine, {**parameters, "segments": pieces}),
            timeout=max(stressed.timeout, case.run["sweep"].timeout),
        )
        yield own.search(
            "drive's way until a rod snaps",
            unit,
            way / 16,
            way,
            partial(snapped, own),
            f"{pieces} segments",
            theory=fold,
            law="where the reference's rod does not come back the way it went",
        )


def there_and_back(case: Case, far: float) -> Case:
    """The case with a sweep so far, and back, sampled at the same drive values both ways."""
    run = case.run["sweep"].model_copy(update={"n": SAMPLES, "until": None})
    return with_swing(case, far, 1.0).model_copy(update={"run": {"sweep": run}})


def snapped(stressed: StressedCase, far: float) -> TrialResult:
    """Whether the engine's rod comes back another way than it went; its error is not asked for."""
    task = StudyRun(
        there_and_back(stressed.case, far), "sweep", stressed.setting, "stress", timed=False
    )
    found = measure_once(task, stressed.store, stressed.timeout)
    if found.outcome != Outcome.RAN:
        return TrialResult(find_failure(found, "sweep"))
    curves = stressed.store.curves(key_of(task))
    return TrialResult(parted({name: curves[f"channel.{name}"] for name in places(stressed.case)}))


def unreturned(case: Case, far: float) -> Failure | None:
    """Whether the reference's rod comes back another way than it went."""
    wanted = evaluate_run(there_and_back(case, far), "sweep").channels
    return parted({name: wanted[name] for name in places(case)})


def places(case: Case) -> list[str]:
    """Channels that are positions."""
    return [name for name, one in case.channels_of("sweep").items() if one.si_unit in ("m", "rad")]


def parted(curves: dict[str, Array]) -> Failure | None:
    """A failure if a curve of a way there and back differs on the way back."""
    for name, values in curves.items():
        apart = float(np.abs(values - values[::-1]).max())
        if apart > LOST * np.ptp(values):
            return Failure(
                f"{name} comes back {apart:.2g} away from where it went",
                BoundaryKind.UNSTABLE,
                silent=True,
            )
    return None
