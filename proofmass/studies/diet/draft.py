"""A model in the making: an `MjSpec`, the rods that complete it, and what it was given to be told.

Whatever has no name gets one while it is studied, ``geom 3 of crank``, and loses it when it is
written.  A model without sensors gets probes, which read every joint; one of which it is said what
to watch gets probes of that.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import Any

import mujoco

from proofmass.errors import InputError, suggest
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol import BadModel, Rod
from proofmass.sim.rods import compile_with_rods

Cut = Callable[["Draft"], None]
NAMED = ("bodies", "joints", "geoms", "sites", "cameras", "lights", "sensors", "actuators",
         "equalities", "tendons", "pairs", "excludes", "skins", "textures", "keys")
JOINT, S, OBJ = mujoco.mjtJoint, mujoco.mjtSensor, mujoco.mjtObj
PROBES = {  # of each kind of joint: what is read, of the joint or of its body
    JOINT.mjJNT_HINGE: (S.mjSENS_JOINTPOS, S.mjSENS_JOINTVEL),
    JOINT.mjJNT_SLIDE: (S.mjSENS_JOINTPOS, S.mjSENS_JOINTVEL),
    JOINT.mjJNT_BALL: (S.mjSENS_FRAMEQUAT, S.mjSENS_FRAMEANGVEL),
    JOINT.mjJNT_FREE: (S.mjSENS_FRAMEPOS, S.mjSENS_FRAMEQUAT, S.mjSENS_FRAMELINVEL,
                       S.mjSENS_FRAMEANGVEL)}


FRAME = PROBES[JOINT.mjJNT_FREE]
WATCHED = {"joints": "joint", "bodies": "body", "sites": "site", "sensors": "sensor"}
"""Lists of what can be watched by name, and what one of them is called."""
READ_AS = {"joints": OBJ.mjOBJ_JOINT, "bodies": OBJ.mjOBJ_XBODY, "sites": OBJ.mjOBJ_SITE}


class Draft:
    """An MJCF file, and what was cut from it.

    Parameters
    ----------
    file : Path
    rods : tuple of Rod
        What a sidecar completes it with.  Several may complete it with other shapes of them.
    probing : bool
        Whether a model without sensors gets one for everything that moves.
    cuts : tuple of callable
        What was done to it, one after the other; each is given the draft.
    watch : tuple of str
        Names of joints, bodies, sites and sensors: these alone are read, and nothing else is
        probed.

    Attributes
    ----------
    spec : MjSpec
        Without the rods.
    share : int
        Of the segments that the rods have, so many times fewer are taken.
    given : set of (str, str)
        Names given to what had none, after the list of the spec that it is in.
    probes : set of str
        Sensors that were added.
    """

    def __init__(self, file: Path, rods: tuple[Rod, ...] = (), probing: bool = False,
                 cuts: tuple[Cut, ...] = (), watch: tuple[str, ...] = ()):
        self.file, self.rods, self.share = file, rods, 1
        self.source, self.watch = (file, rods, probing), watch
        self.alone = Lock()  # two threads that compile one spec crash
        self.spec = mujoco.MjSpec.from_file(str(file))
        self.given = {(kind, name) for kind in NAMED for name in unnamed(self.spec, kind)}
        self.probes = set[str]()
        if watch:
            self.probes = set(probes_of(self.spec, watch)) if probing else set()
        elif probing and not self.spec.sensors:
            self.probes = set(probes(self.spec))
        if not rods:
            self.spec.compile()  # so that what is cut goes from its keys as well
        self.cuts: tuple[Cut, ...] = ()
        for cut in cuts:
            cut(self)
            self.cuts += (cut,)

    def without(self, cut: Cut) -> "Draft":
        """The same with one more cut; made anew, since a spec that waits for rods cannot be copied.

        Raises
        ------
        ValueError
            It cannot be made.
        """
        return Draft(*self.source, (*self.cuts, cut), self.watch)

    def again(self) -> "Draft":
        """The same, to be used up."""
        return Draft(*self.source, self.cuts, self.watch)

    def compiled(self, rods: tuple[Rod, ...] = ()) -> mujoco.MjModel:
        """The model, with these rods or its own.

        Raises
        ------
        ValueError
            Something names what is no longer there.
        """
        try:
            if self.rods:
                return compile_with_rods(self.again().spec, self.segmented(rods or self.rods))
            with self.alone:
                return self.spec.compile()
        except (mujoco.FatalError, BadModel) as error:
            raise ValueError(str(error)) from None

    def segmented(self, rods: tuple[Rod, ...]) -> tuple[Rod, ...]:
        """Rods in as few segments as they have by now."""
        return tuple(replace(rod, segments=rod.segments // self.share) for rod in rods)

    def find(self, kind: str, name: str) -> Any:
        """An element of one of the spec's lists; None where it is gone."""
        return next((e for e in getattr(self.spec, kind) if e.name == name), None)

    def drop(self, kind: str, name: str) -> None:
        """Delete an element, and the probes that read it; what is gone stays gone."""
        if element := self.find(kind, name):
            word = READ_AS.get(kind)
            for sensor in list(self.spec.sensors):
                if sensor.name in self.probes and (sensor.objtype, sensor.objname) == (word, name):
                    self.spec.delete(sensor)
            self.spec.delete(element)


def read(file: Path, rods: tuple[Rod, ...] = (), probing: bool = False,
         watch: tuple[str, ...] = ()) -> Draft:
    """A draft of a file as it is.

    Raises
    ------
    InputError
        No such file, it does not compile, or nothing in it has a name that is to be watched.
    """
    if not file.is_file() or file.suffix != ".xml":
        raise InputError(file, "", "no such model; give an MJCF file, NAME.xml")
    try:
        compile_model(file, rods)
        draft = Draft(file, rods, probing, (), watch)
    except BadModel as error:
        raise InputError(file, "", str(error).removeprefix(f"{file.name}: ")) from None
    there = names(draft.spec)
    for name in watch:
        if name not in there:
            raise InputError(file, "--watch", f"no joint, body, site or sensor is called {name!r}; "
                             f"{suggest(name, there)}")
    return draft


def names(spec: mujoco.MjSpec) -> list[str]:
    """The names of all that can be watched."""
    return list(dict.fromkeys(e.name for kind in WATCHED for e in getattr(spec, kind)
                              if (kind, e.name) != ("bodies", "world")))


def unnamed(spec: mujoco.MjSpec, kind: str) -> Iterator[str]:
    """Give names to the elements of a list that have none, and tell them."""
    taken = {element.name for element in getattr(spec, kind)}
    for k, element in enumerate(getattr(spec, kind)):
        if not element.name:
            body = getattr(getattr(element, "parent", None), "name", "")
            name = f"{type(element).__name__[3:].lower()} {k}" + (f" of {body}" if body else "")
            while name in taken:
                name += "'"
            element.name = name
            taken.add(name)
            yield name


def probes(spec: mujoco.MjSpec) -> Iterator[str]:
    """Add a sensor for everything that moves, and tell their names."""
    for joint in spec.joints:
        scalar = joint.type in (JOINT.mjJNT_HINGE, JOINT.mjJNT_SLIDE)
        for kind in PROBES[joint.type]:
            name = f"{joint.name} {kind.name[7:].lower()}"
            spec.add_sensor(name=name, type=kind,
                            objtype=OBJ.mjOBJ_JOINT if scalar else OBJ.mjOBJ_XBODY,
                            objname=joint.name if scalar else joint.parent.name)
            yield name


def probes_of(spec: mujoco.MjSpec, watch: tuple[str, ...]) -> Iterator[str]:
    """Add sensors for the joints, bodies and sites that are called so, and tell their names.

    What is watched of a joint is its value and its rate, of a body or a site its place, its
    attitude and both velocities.
    """
    for kind, word in WATCHED.items():
        for element in [e for e in getattr(spec, kind) if e.name in watch and kind in READ_AS]:
            read, what, name = READ_AS[kind], FRAME, element.name
            if kind == "joints":
                what = PROBES[element.type]
                if element.type in (JOINT.mjJNT_BALL, JOINT.mjJNT_FREE):
                    read, name = OBJ.mjOBJ_XBODY, element.parent.name
            for sensor in what:
                probe = f"{word} {element.name} {sensor.name[7:].lower()}"
                spec.add_sensor(name=probe, type=sensor, objtype=read, objname=name)
                yield probe
