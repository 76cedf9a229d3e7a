"""Contacts of a planar MJCF: sections of geoms, and the laws of the pairs that touch.

The section of a geom with the plane of motion is a circle, a segment with a radius or a polygon,
see `proofmass.sim.interpreter.sections`; `proofmass.sim.contact_laws` tells which pairs touch.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.contact_laws import ContactLaw, find_pairs, read_law, read_shape
from proofmass.sim.interpreter.checks import Refused
from proofmass.sim.interpreter.sections import meet_in_plane, section_of
from proofmass.sim.plane import MotionPlane
from proofmass.sim.protocol.failures import Unsupported


@dataclass(frozen=True)
class ContactShape:
    """The section of a geom with the plane of motion.

    Attributes
    ----------
    name : str
        Name of the geom.
    link : int
        Number of the link that the geom belongs to.
    points : ndarray (k, 2)
        Centre of a circle, ends of a segment or corners of a polygon, relative to the link's centre
        in the start pose [m].
    radius : float
        Radius around the points [m]; 0 for a polygon.
    """

    name: str
    link: int
    points: Array
    radius: float


@dataclass(frozen=True)
class Contacts:
    """Sections of geoms, and the laws of the pairs that touch.

    The keys of ``laws`` are pairs of indices of ``shapes``, the smaller index first.
    """

    shapes: tuple[ContactShape, ...]
    laws: Mapping[tuple[int, int], ContactLaw]

    def __bool__(self) -> bool:
        return bool(self.laws)

    def between(self, one: int, two: int) -> ContactLaw | None:
        """The contact law of two shapes, given by their indices; None if they do not touch."""
        return self.laws.get((min(one, two), max(one, two)))


def read_contacts(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    plane: MotionPlane,
    of_body: Array,
    centre: Array,
    extent: float,
) -> Contacts:
    """Find the sections of all geoms that may touch, and the contact law of each pair.

    Parameters
    ----------
    model : mujoco.MjModel
    data : mujoco.MjData
        With the kinematics of the start pose.
    plane : MotionPlane
    of_body : ndarray (bodies,)
        Link of each body [1].
    centre : ndarray (links + 1, 2)
        Centres of the links [m].
    extent : float
        Size of the model [m].

    Raises
    ------
    Unsupported
        A geom or a contact has no counterpart in the plane; the message names it.
    """
    pairs, basis = find_pairs(model), np.stack([plane.e1, plane.e2, plane.normal])
    try:
        sections = {
            g: section_of(
                read_shape(model, data, g, int(of_body[model.geom_bodyid[g]])), basis, extent
            )
            for g in sorted({g for pair in pairs for g in pair})
        }
        touching = {
            (g, h): k
            for (g, h), k in pairs.items()
            if meet_in_plane(sections[g], sections[h], extent)
        }
    except Refused as error:
        raise Unsupported(str(error)) from None
    places = {g: k for k, g in enumerate(sorted({g for pair in touching for g in pair}))}
    shapes = []
    for own in (sections[g] for g in places):
        shapes.append(ContactShape(own.name, own.link, own.points - centre[own.link], own.radius))
    laws = {(places[g], places[h]): read_law(model, g, h, k) for (g, h), k in touching.items()}
    return Contacts(tuple(shapes), laws)
