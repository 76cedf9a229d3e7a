"""Pairs of geoms of an MJCF that may touch, their shapes, friction and restitution.

MuJoCo's masks, exclusions and ``<pair>`` decide which geoms touch, and its rules give their
coefficient of friction.  MuJoCo's contacts are soft and those of other engines are rigid, so the
softness `solref` is replaced by the coefficient of restitution that it has in the limit of a short
time constant.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.analytic.contacts import damping_ratio, restitution
from proofmass.base.arrays import Array
from proofmass.sim.interpreter.mechanism import NeutralShape
from proofmass.sim.protocol.failures import Unsupported

GEOM = mujoco.mjtGeom
DISABLE_FLAG = mujoco.mjtDisableBit
SHAPES = {
    GEOM.mjGEOM_PLANE: "plane",
    GEOM.mjGEOM_SPHERE: "sphere",
    GEOM.mjGEOM_CAPSULE: "capsule",
    GEOM.mjGEOM_CYLINDER: "cylinder",
    GEOM.mjGEOM_BOX: "box",
}
"""Geoms that have a shape in other engines."""
TORSION_CONDIM, ROLLING_CONDIM = 4, 6
"""The `condim` of a contact with friction against spin about its normal, and against rolling."""


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


def find_pairs(model: mujoco.MjModel) -> dict[tuple[int, int], int]:
    """Pairs of geoms that may touch, the smaller id first, with the id of their ``<pair>`` or -1.

    The number is -1 for a pair that masks let touch without a ``<pair>``.

    Raises
    ------
    Unsupported
        The flag `override` replaces the numbers of all contacts.
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
    if found and model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
        raise Unsupported("the flag override, which replaces the numbers of all contacts")
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


def read_shape(model: mujoco.MjModel, data: mujoco.MjData, g: int, link: int) -> NeutralShape:
    """The shape of geom g of a link, at its place in the world.

    Raises
    ------
    Unsupported
        It is no plane, sphere, capsule, box or cylinder.
    """
    kind = GEOM(int(model.geom_type[g]))
    name = f"{kind.name[7:].lower()} '{model.geom(g).name or g}'"
    if kind not in SHAPES:
        raise Unsupported(f"contact of {name}, which is no plane, sphere, capsule, box or cylinder")
    axes = data.geom_xmat[g].reshape(3, 3).copy()
    return NeutralShape(
        name, SHAPES[kind], link, data.geom_xpos[g].copy(), axes, model.geom_size[g].copy()
    )


def read_law(
    model: mujoco.MjModel, g: int, h: int, pair: int, in_space: bool = False
) -> ContactLaw:
    """The contact law of geoms g and h, whose numbers are combined by MuJoCo's rules.

    `pair` is the id of their ``<pair>``, or -1, and `in_space` is whether bodies may spin about the
    normal of a contact.

    Raises
    ------
    Unsupported
        The contact has a margin, rolling friction, friction against spin about its normal, a
        friction that differs by direction or a softness without a damping ratio.
    """
    names = " and ".join(f"'{model.geom(k).name or k}'" for k in (g, h))
    if pair >= 0:
        condim, solref = int(model.pair_dim[pair]), model.pair_solref[pair]
        sliding_friction, margin = model.pair_friction[pair, :2], float(model.pair_margin[pair])
        if sliding_friction[0] != sliding_friction[1]:
            raise Unsupported(f"the pair of {names}, whose friction differs by direction")
        friction, torsion = float(sliding_friction[0]), float(model.pair_friction[pair, 2])
    else:
        margin = float(max(model.geom_margin[[g, h]]))
        order = model.geom_priority[[g, h]]
        own = [g, h] if order[0] == order[1] else [(g, h)[int(order.argmax())]]
        condim = int(max(model.geom_condim[own]))
        friction, torsion = (float(max(model.geom_friction[own, k])) for k in (0, 1))
        solref = _mix_solref(model.geom_solmix[own], model.geom_solref[own])
    if margin:
        raise Unsupported(f"the margin of {margin:g} m of the contact of {names}")
    if condim >= ROLLING_CONDIM:
        raise Unsupported(f"rolling friction (condim {condim}) of the contact of {names}")
    if in_space and condim >= TORSION_CONDIM and torsion:
        raise Unsupported(f"torsional friction (condim {condim}) of the contact of {names}")
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
