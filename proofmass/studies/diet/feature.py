"""Features of a scene: whatever can be taken out of an `MjSpec`, or be said more simply.

A feature may have parts: what to try where it cannot go as a whole, for one half of the geoms.  So
what nobody needs goes at once, and what matters is found in a few runs.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np

from proofmass.studies.diet.cut import (
    coarser,
    enclose,
    flatten,
    masks_off,
    planar,
    set_option,
    switch_off,
    undraw,
    unlimit,
)
from proofmass.studies.diet.draft import Cut, Draft
from proofmass.studies.diet.scene import Scene, Watch
from proofmass.studies.diet.trial import by_steps

CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
JOINT, MESH = mujoco.mjtJoint, mujoco.mjtGeom.mjGEOM_MESH
DRAWN = "drawn geom"
WHOLE = {  # lists of elements that are deleted as they are, and what one of them is called
    "joints": "joint", "equalities": "equality", "actuators": "actuator", "tendons": "tendon",
    "pairs": "contact pair", "excludes": "exclude", "lights": "light", "cameras": "camera",
    "skins": "skin", "sites": "site", "textures": "texture", "meshes": "mesh",
    "hfields": "height field", "texts": "text", "numerics": "number", "tuples": "tuple"}


@dataclass(frozen=True)
class Feature:
    """Something that a scene may not need.

    Attributes
    ----------
    kind, name : str
        What it is, and which.
    cut : callable
        Takes it out of a draft, in place; may raise ValueError.
    parts : tuple of Feature
        To try if it cannot go as a whole.
    """

    kind: str
    name: str
    cut: Cut
    parts: tuple["Feature", ...] = ()


def bundle(kind: str, names: list[str], cut: Callable[[Draft, str], None]) -> Iterator[Feature]:
    """A feature of many, whose parts are its halves; none of none."""
    if not names:
        return

    def all_of(draft: Draft) -> None:
        for name in names:
            cut(draft, name)

    half = len(names) // 2
    halves = [*bundle(kind, names[:half], cut), *bundle(kind, names[half:], cut)] if half else []
    yield Feature(kind, names[0] if len(names) == 1 else f"{len(names)}: {', '.join(names)}",
                  all_of, tuple(halves))


def ladder(kind: str, rungs: Iterable[tuple[str, Cut]]) -> Iterator[Feature]:
    """The first rung that holds: each is tried where the one before does not."""
    below: tuple[Feature, ...] = ()
    for name, cut in reversed(list(rungs)):
        below = (Feature(kind, name, cut, below),)
    yield from below


def features(draft: Draft, scene: Scene) -> Iterator[Feature]:
    """All that may go from a draft of a scene, in the order in which it is tried."""
    read, keys = scene.read, scene.keys
    spec = draft.spec
    sensors = [s.name for s in spec.sensors if read is not None and s.name not in read]
    yield from bundle("sensor nobody reads", sensors, dropper("sensors"))
    yield from bundle("key", [k.name for k in spec.keys if k.name not in keys], dropper("keys"))
    yield from contacts(draft)
    yield from solver(draft, scene.longest)
    yield from (subtree(body) for body in spec.worldbody.bodies)
    yield from flat(draft)
    for kind, word in WHOLE.items():
        yield from bundle(word, [e.name for e in getattr(spec, kind)], dropper(kind))
    limited = [j.name for j in spec.joints if limits(j)]
    yield from bundle("limit", limited, unlimit)
    yield from bundle("material", [m.name for m in spec.materials], flatten)
    meshes = [g.name for g in spec.geoms if g.type == MESH]
    yield from bundle("mesh, as a box", meshes, enclose)
    bare = [g.name for g in spec.geoms if g.type != MESH and not collides(draft, g)]
    yield from bundle(DRAWN, bare, undraw)
    yield from ladder("segments of rods", [(f"{k} times fewer", partial(coarser, share=k))
                                           for k in (8, 4, 2) if fit(draft, k)])


def dropper(kind: str) -> Callable[[Draft, str], None]:
    """Deletes an element of one of the spec's lists."""
    return lambda draft, name: draft.drop(kind, name)


def collides(draft: Draft, geom: object) -> bool:
    """Whether a geom can touch anything."""
    off = draft.spec.option.disableflags & CONTACT
    return not off and bool(geom.contype or geom.conaffinity)  # type: ignore[attr-defined]


def contacts(draft: Draft) -> Iterator[Feature]:
    """All contacts at once, by the flag; else geoms that touch nothing."""
    masked = [g.name for g in draft.spec.geoms if collides(draft, g)]
    if masked or (draft.spec.pairs and not draft.spec.option.disableflags & CONTACT):
        yield Feature("contact", "all", partial(switch_off, bit=CONTACT),
                      tuple(bundle("contact of geom", masked, masks_off)))


def solver(draft: Draft, watch: Watch) -> Iterator[Feature]:
    """What the solver does beside its task; its options are in `proofmass.studies.diet.options`."""
    if not by_steps(watch.run):
        return
    option = draft.spec.option
    if option.noslip_iterations:
        yield Feature("solver", "noslip iterations",
                      partial(set_option, name="noslip_iterations", value=0))
    if option.enableflags & ~int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
        yield Feature("flag", "what is enabled beside the defaults",
                      partial(set_option, name="enableflags", value=0))


def subtree(body: mujoco._specs.MjsBody) -> Feature:
    """A body with all that hangs on it; its parts are the bodies that do."""
    name = body.name
    return Feature("body", name, lambda draft: draft.drop("bodies", name),
                   tuple(subtree(child) for child in body.bodies))


def flat(draft: Draft) -> Iterator[Feature]:
    """Free joints and balls of bodies that stay in a plane across one of the world's axes."""
    for joint in draft.spec.joints:
        if joint.type in (JOINT.mjJNT_FREE, JOINT.mjJNT_BALL):
            kind = "free joint" if joint.type == JOINT.mjJNT_FREE else "ball"
            yield from ladder(f"{kind} in a plane", [
                (f"{joint.name} across {axis}", partial(planar, name=joint.name, normal=normal))
                for axis, normal in zip("zyx", np.eye(3)[::-1], strict=True)])


def limits(joint: mujoco._specs.MjsJoint) -> bool:
    """Whether a joint has limits."""
    given = bool(np.ptp(joint.range))
    return bool(joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE
                or (joint.limited == mujoco.mjtLimited.mjLIMITED_AUTO and given))


def fit(draft: Draft, share: int) -> bool:
    """Whether all rods can be cut into so many times fewer segments."""
    return bool(draft.rods) and all(rod.segments // share >= 2 and rod.segments % share == 0
                                    for rod in draft.rods)
