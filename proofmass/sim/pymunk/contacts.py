"""Contacts of a planar MJCF: pairs of geoms, their sections, friction and restitution.

The section of a geom with the plane of motion is a circle, a segment with a radius or a polygon.
MuJoCo's masks, exclusions and ``<pair>`` decide which geoms touch, and its rules give their
coefficient of friction.  MuJoCo's contacts are soft and Chipmunk's are rigid, so the softness
`solref` is replaced by the coefficient of restitution that it has in the limit of a short time
constant.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.analytic.contacts import damping_ratio, restitution
from proofmass.base.arrays import Array
from proofmass.sim.plane import PARALLEL_TOLERANCE, MotionPlane
from proofmass.sim.protocol.failures import Unsupported

GEOM = mujoco.mjtGeom
DISABLE_FLAG = mujoco.mjtDisableBit
PLANE_HALF_LENGTH, PLANE_DEPTH = 1000.0, 10.0
"""Half length and depth below the surface of the segment that stands for a plane [extents]."""
ROLLING_CONDIM = 6
"""The `condim` of a contact with rolling friction."""


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
class ContactLaw:
    """Friction and restitution of a pair of geoms.

    Attributes
    ----------
    friction : float
        Coulomb's coefficient of friction [1].
    restitution : float
        Normal speed after an impact over the normal speed before it [1].
    """

    friction: float
    restitution: float


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


def find_pairs(model: mujoco.MjModel) -> dict[tuple[int, int], int]:
    """Pairs of geoms that may touch, the smaller id first, with the id of their ``<pair>`` or -1.

    The number is -1 for a pair that masks let touch without a ``<pair>``.
    """
    if any(
        model.opt.disableflags & int(b)
        for b in (DISABLE_FLAG.mjDSBL_CONTACT, DISABLE_FLAG.mjDSBL_CONSTRAINT)
    ):
        return {}
    found = dict.fromkeys(_find_colliding(model), -1)
    for p in range(model.npair):
        one, two = sorted((int(model.pair_geom1[p]), int(model.pair_geom2[p])))
        if model.body_weldid[model.geom_bodyid[one]] != model.body_weldid[model.geom_bodyid[two]]:
            found[one, two] = p
    return found


def _find_colliding(model: mujoco.MjModel) -> Iterator[tuple[int, int]]:
    """Pairs of geoms that masks, parent bodies and exclusions let touch, the smaller id first."""
    weld = model.body_weldid
    parents = not model.opt.disableflags & int(DISABLE_FLAG.mjDSBL_FILTERPARENT)
    for g in range(model.ngeom):
        for h in range(g):
            a, b = sorted((model.geom_bodyid[g], model.geom_bodyid[h]))
            up = (weld[model.body_parentid[weld[a]]], weld[model.body_parentid[weld[b]]])
            family = parents and ((weld[a] and up[1] == weld[a]) or (weld[b] and up[0] == weld[b]))
            mask = (
                model.geom_contype[g] & model.geom_conaffinity[h]
                | model.geom_contype[h] & model.geom_conaffinity[g]
            )
            if (
                mask
                and weld[a] != weld[b]
                and not family
                and ((a << 16) + b not in model.exclude_signature)
            ):
                yield h, g


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
    pairs = find_pairs(model)
    if pairs and model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
        raise Unsupported("the flag override, which replaces the numbers of all contacts")
    sections = dict[int, _Section]()
    for g in sorted({g for pair in pairs for g in pair}):
        sections[g] = _find_section(model, data, plane, g, extent)
    touching = {
        p: k for p, k in pairs.items() if _is_in_one_plane(sections[p[0]], sections[p[1]], extent)
    }
    places = {g: k for k, g in enumerate(sorted({g for pair in touching for g in pair}))}
    shapes = []
    for g in places:
        link = int(of_body[model.geom_bodyid[g]])
        own = sections[g]
        shapes.append(ContactShape(own.name, link, own.points - centre[link], own.radius))
    laws = {(places[g], places[h]): _contact_law(model, g, h, k) for (g, h), k in touching.items()}
    return Contacts(tuple(shapes), laws)


@dataclass(frozen=True)
class _Section:
    """A section in coordinates of the plane, and the geom's extension along the plane's normal.

    ``height`` is the position of the geom's middle along the normal [m], ``whole`` half the length
    of the geom along the normal [m], and ``flat`` half the length over which its sections are equal
    [m].
    """

    name: str
    points: Array
    radius: float
    height: float
    flat: float
    whole: float


def _find_section(
    model: mujoco.MjModel, data: mujoco.MjData, plane: MotionPlane, g: int, extent: float
) -> _Section:
    """The section of geom g; raises `Unsupported` if that is no circle, segment or rectangle."""
    kind, size = GEOM(int(model.geom_type[g])), model.geom_size[g]
    name = f"{kind.name[7:].lower()} '{model.geom(g).name or g}'"
    position, axes = data.geom_xpos[g], data.geom_xmat[g].reshape(3, 3).T
    middle, height = plane.flat(position), float(position @ plane.normal)
    across = np.abs(axes @ plane.normal)  # components of the geom's unit axes along the normal
    upright = across[2] > 1.0 - PARALLEL_TOLERANCE
    lying = across[2] < PARALLEL_TOLERANCE
    if kind == GEOM.mjGEOM_PLANE and lying:
        up = plane.flat(axes[2])
        along = PLANE_HALF_LENGTH * extent * np.array([up[1], -up[0]])
        foot = middle - PLANE_DEPTH * extent * up
        ends = np.stack([foot - along, foot + along])
        return _Section(name, ends, PLANE_DEPTH * extent, height, np.inf, np.inf)
    if kind == GEOM.mjGEOM_SPHERE:
        return _Section(name, middle[None], float(size[0]), height, 0.0, float(size[0]))
    if kind == GEOM.mjGEOM_CAPSULE and lying:
        half = size[1] * plane.flat(axes[2])
        ends = np.stack([middle - half, middle + half])
        return _Section(name, ends, float(size[0]), height, 0.0, float(size[0]))
    if kind in (GEOM.mjGEOM_CAPSULE, GEOM.mjGEOM_CYLINDER) and upright:
        whole = float(size[1] + (size[0] if kind == GEOM.mjGEOM_CAPSULE else 0.0))
        return _Section(name, middle[None], float(size[0]), height, float(size[1]), whole)
    if kind == GEOM.mjGEOM_BOX and across.max() > 1.0 - PARALLEL_TOLERANCE:
        k = int(across.argmax())
        one, two = (size[j] * plane.flat(axes[j]) for j in range(3) if j != k)
        corners = np.stack([middle + a * one + b * two for a, b in CORNER_SIGNS])
        return _Section(name, corners, 0.0, height, float(size[k]), float(size[k]))
    raise Unsupported(f"contact of {name}, which {_explain_no_section(kind)}")


CORNER_SIGNS = ((1, 1), (-1, 1), (-1, -1), (1, -1))


def _explain_no_section(kind: mujoco.mjtGeom) -> str:
    """The reason why a geom of some type has no section, as the end of a sentence."""
    if kind == GEOM.mjGEOM_CYLINDER:
        return "is not at right angles to the plane of motion"
    if kind in (GEOM.mjGEOM_PLANE, GEOM.mjGEOM_CAPSULE, GEOM.mjGEOM_BOX):
        return "is neither along the plane of motion nor at right angles to it"
    return "is no plane, sphere, capsule, box or cylinder"


def _is_in_one_plane(one: _Section, two: _Section, extent: float) -> bool:
    """Whether two geoms may touch in the plane of motion; False if they pass above each other.

    Raises
    ------
    Unsupported
        The geoms may touch, but not at their largest sections: round geoms whose middles are at
        different heights over the plane.
    """
    apart = abs(one.height - two.height) if np.isfinite(one.whole + two.whole) else 0.0
    if apart >= one.whole + two.whole:
        return False
    # The ranges of equal sections overlap, or the middle of a round geom lies within such a range.
    if apart <= one.flat + two.flat + PARALLEL_TOLERANCE * extent:
        return True
    raise Unsupported(
        f"contact of {one.name} and {two.name}, whose middles are {apart:.3g} m apart across the "
        f"plane of motion"
    )


def _contact_law(model: mujoco.MjModel, g: int, h: int, pair: int) -> ContactLaw:
    """The contact law of geoms g and h, whose numbers are combined by MuJoCo's rules.

    `pair` is the id of their ``<pair>``, or -1.
    """
    names = " and ".join(f"'{model.geom(k).name or k}'" for k in (g, h))
    if pair >= 0:
        condim, solref = int(model.pair_dim[pair]), model.pair_solref[pair]
        sliding_friction, margin = model.pair_friction[pair, :2], float(model.pair_margin[pair])
        if sliding_friction[0] != sliding_friction[1]:
            raise Unsupported(f"the pair of {names}, whose friction differs by direction")
        friction = float(sliding_friction[0])
    else:
        margin = float(max(model.geom_margin[[g, h]]))
        order = model.geom_priority[[g, h]]
        own = [g, h] if order[0] == order[1] else [(g, h)[int(order.argmax())]]
        condim = int(max(model.geom_condim[own]))
        friction = float(max(model.geom_friction[own, 0]))
        solref = _mix_solref(model.geom_solmix[own], model.geom_solref[own])
    if margin:
        raise Unsupported(f"the margin of {margin:g} m of the contact of {names}")
    if condim >= ROLLING_CONDIM:
        raise Unsupported(f"rolling friction (condim {condim}) of the contact of {names}")
    if not (ratio := damping_ratio(solref)) >= 0:
        first, second = solref.tolist()
        raise Unsupported(
            f"solref '{first:g} {second:g}' of the contact of {names}, which has no damping ratio"
        )
    return ContactLaw(friction if condim > 1 else 0.0, restitution(ratio))


def _mix_solref(weights: Array, solref: Array) -> Array:
    """The `solref` of a contact, mixed from two geoms by MuJoCo's rule, or that of one geom."""
    if len(solref) == 1:
        return np.asarray(solref[0])
    if not (solref[:, 0] > 0).all():
        return np.asarray(solref.min(axis=0))
    least = float(mujoco.mjMINVAL)
    share = 0.5 if (weights < least).all() else float(weights[0] / weights.sum())
    return np.asarray(share * solref[0] + (1.0 - share) * solref[1])
