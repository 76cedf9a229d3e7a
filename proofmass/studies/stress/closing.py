"""A linkage nearer and nearer to where it cannot be closed: a change point, or a stretched arm.

Links of its last loop are shortened as far as the mechanism can still make its whole way.  There
some of its bars come into line, and two assembly modes meet:

    1, 2, r, 3, the crank turning    r -> 2         coupler and rocker in line, one on the other
    1, c, r, 3, the crank turning    c + r -> 4     coupler and rocker in line, stretched
    five-bar                         the last coupler alone, or both, as a four-bar's

With a share g to spare the two modes are apart by an angle of the order sqrt(g).  A loop that an
engine leaves open by a share e of its size turns the bars by e / sqrt(g), and passes into the other
mode from g = e on.
"""

from collections.abc import Iterator
from copy import copy
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
from proofmass.reference import compiled
from proofmass.strict import Kind
from proofmass.studies.rescaled import times, with_model
from proofmass.studies.store import MATTERS, Store, digest, model_bytes, once, sources
from proofmass.studies.stress.boundary import Failure, Limit, bisect
from proofmass.studies.stress.ways import followed

LONGEST, SHORTEST = (1.1, 1.0), 0.2  # times its length: from where and to where it is shortened
PACE = 0.02  # change of the link from one closed start pose to the next: none is leapt over
SHARP = 1e-9  # how sharply the shortest length is found


Links = tuple[str, ...]
"""Sites at the ends of links."""


def ends(case: Case) -> Iterator[Links]:
    """Of each loop, the last first, the ends of the links that it holds together."""
    model = compiled(case)
    for e in reversed(range(model.neq)):
        if int(model.eq_objtype[e]) == mujoco.mjtObj.mjOBJ_SITE:
            pair = int(model.eq_obj2id[e]), int(model.eq_obj1id[e])
            yield tuple(str(model.site(site).name) for site in pair
                        if model.site_bodyid[site] and model.site_pos[site].any())


def last_link(case: Case) -> Links:
    """The end of the last link that a loop holds; none if there is none."""
    return next((links[:1] for links in ends(case) if links), ())


def last_arm(case: Case) -> Links:
    """The ends of both links of the last loop, if nothing else drives or holds them; or none."""
    model, (last, *others) = compiled(case), [*ends(case)] or [()]
    bodies = [int(model.site(link).bodyid[0]) for link in last]
    held = {int(model.site(link).bodyid[0]) for links in others for link in links}
    driven = {int(model.joint(drive.joint).bodyid[0]) for drive in case.drive}
    return last if len(bodies) == 2 and not {*bodies} & (held | driven) else ()


def shortened(case: Case, links: Links, folder: Path, factor: float) -> Case:
    """The case with links so many times as long, and closed in its start pose."""
    pose = closed(case, links, factor)

    def change(root: Element) -> None:
        for site in root.iter("site"):
            if site.get("name") in links:
                times(site, "pos", factor)
        key = next(key for key in root.iter("key") if key.get("name") == case.start)
        key.set("qpos", " ".join(map(repr, pose.tolist())))
    return with_model(case, folder, change)


def closed(case: Case, links: Links, factor: float) -> Array:
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


def least(case: Case, links: Links, kind: Kind, folder: Path) -> float:
    """Length of links, in their own, from which on the mechanism makes its whole way.

    NaN where the reference has no poses with longer ones, or has them all with shorter ones.
    """
    for longest in LONGEST:
        holds, breaks, _ = bisect(partial(unclosed, case, links, kind, folder), longest, SHORTEST,
                                  SHARP)
        if holds == holds:
            return float(np.sqrt(holds * breaks))
    return float("nan")


def least_kept(case: Case, links: Links, kind: Kind, store: Store) -> float:
    """The same, found once for both engines: steps of the reference are short at singular poses."""
    name = repr((case.model_dump_json(include=MATTERS), links, kind, sources()))
    file = store.folder / f"{digest(name.encode() + model_bytes(case))}.least.json"
    return float(once(file, lambda: least(case, links, kind, store.folder / "models")))


def unclosed(case: Case, links: Links, kind: Kind, folder: Path, factor: float
             ) -> Failure | None:
    """Why the mechanism does not make its whole way with links so many times as long."""
    try:
        followed(shortened(case, links, folder, factor), kind)
    except InputError as error:
        return Failure(error.wrong, Limit.UNSTABLE)
    return None
