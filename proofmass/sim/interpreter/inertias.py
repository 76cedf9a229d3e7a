"""Inertias of links with those that joints add, and those that an engine loses."""

from __future__ import annotations

import numpy as np

from .checks import Refused
from .mechanism import NeutralJoint, NeutralMechanism, PlainArray

SINGLE_ROUNDING = float(np.finfo(np.float32).eps)
"""Rounding of single precision [1]."""


def inertia_with_armature(mechanism: NeutralMechanism, link: int) -> PlainArray:
    """Inertia (3, 3) of a link with the armatures of its hinges on the ground [kg m^2].

    Raises
    ------
    Refused
        Another joint of the link has an armature.
    """
    inertia = mechanism.links[link].inertia
    for joint in (mechanism.joints[j] for j in mechanism.joints_of(link)):
        if joint.armature and (joint.parent or joint.kind != "hinge"):
            raise Refused(f"armature of joint {joint.name!r}, no hinge on the ground")
        inertia = inertia + joint.armature * np.outer(joint.axis, joint.axis)
    return inertia


def inertia_in_motion(mechanism: NeutralMechanism, link: int) -> PlainArray:
    """Inertia (3, 3) of a link with its armatures; in a plane that about the normal for all axes.

    In a plane the other ones have no meaning, and may be too small for an engine [kg m^2].
    """
    if mechanism.is_planar:
        return moment_in_plane(mechanism, link) * np.eye(3)
    return inertia_with_armature(mechanism, link)


def moment_in_plane(mechanism: NeutralMechanism, link: int) -> float:
    """Moment of inertia of a link about the normal, with its armatures [kg m^2]."""
    normal = mechanism.plane[2]
    return float(normal @ inertia_with_armature(mechanism, link) @ normal)


def armatures_with_rotors(mechanism: NeutralMechanism, share: float) -> list:
    """Armatures of all joints; those of drives are rotors that no other link moves [kg m^2 or kg].

    Their inertia is the mass of the mechanism times its squared size, times a `share` above 1.
    """
    mass = share * sum(link.mass for link in mechanism.links)
    heavy = {"hinge": mass * mechanism.size**2, "slide": mass}
    return [
        heavy[one.kind] if mechanism.drive_of(j) else one.armature
        for j, one in enumerate(mechanism.joints)
    ]


def refuse_ratio(mechanism: NeutralMechanism, joint: NeutralJoint, largest: float) -> None:
    """Raise `Refused` at a joint that binds inertias of a larger ratio, for iterations.

    They are the principal ones of both links, without that of the ground.
    """
    links = [k for k in (joint.parent, joint.child) if k]
    sizes = np.linalg.eigvalsh([inertia_with_armature(mechanism, k) for k in links])
    if sizes.max() > largest * sizes.min():
        raise Refused(
            f"joint {joint.name!r}, which binds inertias of {sizes.min():.3g} and "
            f"{sizes.max():.3g} kg m2: the iterations do not converge"
        )


def refuse_lost_inertia(
    mechanism: NeutralMechanism, link: int, least: float, moment: float
) -> None:
    """Refuse a link whose inertia is lost beside its mass at a joint, in single precision.

    A joint adds 1 / mass and arm^2 / inertia, and the first is lost if it is too small.

    Parameters
    ----------
    mechanism : NeutralMechanism
    link : int
    least : float
        Least inertia in masses times squared arms [1].
    moment : float
        The inertia [kg m^2].

    Raises
    ------
    Refused
    """
    one = mechanism.links[link]
    ends = [joint.anchor for joint in mechanism.joints if link in (joint.parent, joint.child)]
    ends += [loop.on_a for loop in mechanism.loops if loop.a == link]
    ends += [loop.on_b for loop in mechanism.loops if loop.b == link]
    large = one.mass * max(float(((end - one.centre) ** 2).sum()) for end in ends)
    if moment < least * large:
        raise Refused(
            f"link {one.name!r} with an inertia of {moment:.3g} kg m2, that single precision does "
            f"not carry beside the {large:.3g} kg m2 of its mass at a joint"
        )
