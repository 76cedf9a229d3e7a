"""A model in the making: an `MjSpec`, the rods that complete it, and what it was given to be told.

Whatever has no name gets one while it is studied, ``geom 3 of crank``, and loses it when it is
written.  A model without sensors gets probes, which read every joint.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import Any

import mujoco

from proofmass.errors import InputError
from sim.mjcf import compile_model
from sim.protocol import BadModel, Rod
from sim.rods import compile_with_rods

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
                 cuts: tuple[Cut, ...] = ()):
        self.file, self.rods, self.share = file, rods, 1
        self.source = file, rods, probing
        self.alone = Lock()  # two threads that compile one spec crash
        self.spec = mujoco.MjSpec.from_file(str(file))
        self.given = {(kind, name) for kind in NAMED for name in unnamed(self.spec, kind)}
        self.probes = set(probes(self.spec)) if probing and not self.spec.sensors else set()
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
        return Draft(*self.source, (*self.cuts, cut))

    def again(self) -> "Draft":
        """The same, to be used up."""
        return Draft(*self.source, self.cuts)

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
            word = {"joints": OBJ.mjOBJ_JOINT, "bodies": OBJ.mjOBJ_XBODY}.get(kind)
            for sensor in list(self.spec.sensors):
                if sensor.name in self.probes and (sensor.objtype, sensor.objname) == (word, name):
                    self.spec.delete(sensor)
            self.spec.delete(element)


def read(file: Path, rods: tuple[Rod, ...] = (), probing: bool = False) -> Draft:
    """A draft of a file as it is.

    Raises
    ------
    InputError
        No such file, or it does not compile.
    """
    if not file.is_file() or file.suffix != ".xml":
        raise InputError(file, "", "no such model; give an MJCF file, NAME.xml")
    try:
        compile_model(file, rods)
        return Draft(file, rods, probing)
    except BadModel as error:
        raise InputError(file, "", str(error).removeprefix(f"{file.name}: ")) from None


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
