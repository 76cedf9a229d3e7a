"""A linkage nearer and nearer to where it cannot be closed: a change point, or a stretched arm.

The last link of its last loop is shortened as far as the mechanism can still make its whole way.
There some of its bars come into line, and two assembly modes meet:

    1, 2, r, 3, the crank turning      r -> 2        all in line at a crank angle of pi
    five-bar                           r -> r*       both couplers in line: the arm is stretched

With a share g to spare the two modes are apart by an angle of the order sqrt(g).  A loop that an
engine leaves open by a share e of its size turns the bars by e / sqrt(g), and passes into the other
mode from g = e on.
"""

import json
from copy import copy
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from analytic.planar import read
from analytic.planar.closure import Drives, newton
from proofmass.case import Case
from proofmass.errors import InputError
from proofmass.reference import compiled
from proofmass.strict import Kind
from proofmass.study.boundary import Failure, bisect
from proofmass.study.rescaled import times, with_model
from proofmass.study.store import MATTERS, Store, digest, model_bytes, sources, write
from proofmass.study.ways import followed
from sim.protocol import Array

LONGEST, SHORTEST = (1.1, 1.0), 0.2  # times its length: from where and to where it is shortened
PACE = 0.02  # change of the link from one closed start pose to the next: none is leapt over
SHARP = 1e-9  # how sharply the shortest length is found


def last_link(case: Case) -> str:
    """The site at the end of the last link that a loop holds; nothing if there is none."""
    model = compiled(case)
    for e in reversed(range(model.neq)):
        if int(model.eq_objtype[e]) == mujoco.mjtObj.mjOBJ_SITE:
            for site in (int(model.eq_obj2id[e]), int(model.eq_obj1id[e])):
                if model.site_bodyid[site] and model.site_pos[site].any():
                    return str(model.site(site).name)
    return ""


def shortened(case: Case, folder: Path, factor: float) -> Case:
    """The case with its last link so many times as long, and closed in its start pose."""
    link, pose = last_link(case), closed(case, factor)

    def change(root: Element) -> None:
        site = next(site for site in root.iter("site") if site.get("name") == link)
        times(site, "pos", factor)
        key = next(key for key in root.iter("key") if key.get("name") == case.start)
        key.set("qpos", " ".join(map(repr, pose.tolist())))
    return with_model(case, folder, change)


def closed(case: Case, factor: float) -> Array:
    """Joint values of the start pose with the last link so many times as long.

    Raises
    ------
    InputError
        The loops cannot be closed there.
    """
    model = copy(compiled(case))
    link = model.site(last_link(case)).id
    length, joints = model.site_pos[link].copy(), tuple(d.joint for d in case.drive)
    pose = read(model, case.start)[0].start
    for share in np.linspace(1.0, factor, int(abs(factor - 1.0) / PACE) + 2).tolist():
        model.site_pos[link] = share * length
        mechanism, _ = read(model, case.start)
        try:
            pose = newton(mechanism, pose[None], Drives.of(mechanism, joints))[0]
        except ValueError as error:
            raise InputError(case.model_path, "", str(error)) from None
    return pose


def least(case: Case, kind: Kind, folder: Path) -> float:
    """Length of the last link, in its own, from which on the mechanism makes its whole way.

    NaN where the reference has no poses with any longer one, or has them all with any shorter one.
    """
    for longest in LONGEST:
        holds, breaks, _ = bisect(partial(unclosed, case, kind, folder), longest, SHORTEST, SHARP)
        if holds == holds:
            return float(np.sqrt(holds * breaks))
    return float("nan")


def least_kept(case: Case, kind: Kind, store: Store) -> float:
    """The same, found once for both engines: steps of the reference are short at singular poses."""
    name = repr((case.model_dump_json(include=MATTERS), kind, sources()))
    file = store.folder / f"{digest(name.encode() + model_bytes(case))}.least.json"
    if not file.is_file():
        write(file, json.dumps(least(case, kind, store.folder / "models")))
    return float(json.loads(file.read_text(encoding="utf-8")))


def unclosed(case: Case, kind: Kind, folder: Path, factor: float) -> Failure | None:
    """Why the mechanism does not make its whole way with its last link so many times as long."""
    try:
        followed(shortened(case, folder, factor), kind)
    except InputError as error:
        return Failure(error.wrong)
    return None
