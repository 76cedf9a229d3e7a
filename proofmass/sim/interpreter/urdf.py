"""URDF of a tree of links, for engines that read it.

The frame of a link is at its joint and has the axes of the world in the start pose, so that all
coordinates are 0 there.  Several joints of a link in a row have links without mass between them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .geometry import angles_of
from .mechanism import NeutralMechanism, NeutralShape, PlainArray

JOINT_TYPES = {"hinge": "continuous", "slide": "prismatic", "ball": "spherical"}
LINK_TEXT = """<link name="{name}"><inertial><origin xyz="{at[0]} {at[1]} {at[2]}"/>
<mass value="{mass}"/><inertia ixx="{0[0]}" ixy="{0[1]}" ixz="{0[2]}" iyy="{1[1]}" iyz="{1[2]}"
izz="{2[2]}"/></inertial>{shapes}</link>"""
JOINT_TEXT = """<joint name="joint{j}" type="{kind}">
<parent link="{parent}"/><child link="{child}"/><origin xyz="{at[0]} {at[1]} {at[2]}"/>
<axis xyz="{axis[0]} {axis[1]} {axis[2]}"/>
<limit lower="{ends[0]}" upper="{ends[1]}" effort="0" velocity="0"/></joint>"""
SHAPE_TEXT = """<collision><origin xyz="{at[0]} {at[1]} {at[2]}" rpy="{rpy[0]} {rpy[1]} {rpy[2]}"/>
<geometry>{geometry}</geometry></collision>"""
GEOMETRIES = {
    "sphere": '<sphere radius="{0}"/>',
    "box": '<box size="{3} {4} {5}"/>',
    "capsule": '<capsule radius="{0}" length="{4}"/>',
    "cylinder": '<cylinder radius="{0}" length="{4}"/>',
}
"""Elements of shapes, of their half sizes and sizes."""
WITHOUT_RANGE = 1.0, -1.0
"""Bullet's words for a joint without a range."""


def shape_urdf(shape: NeutralShape, origin: PlainArray, turn: PlainArray | None = None) -> str:
    """URDF of a shape from a point of its link in the start pose; `turn` replaces its axes."""
    return SHAPE_TEXT.format(
        at=shape.place - origin,
        rpy=angles_of(shape.axes if turn is None else turn),
        geometry=GEOMETRIES[shape.kind].format(*shape.size, *2.0 * shape.size),
    )


def ground_urdf(shape: NeutralShape, reach: float) -> str:
    """URDF of a shape of the ground as a robot of its own, whose frame is that of the shape.

    A half space is a box of half sides `reach` [m].
    """
    origin = shape.place
    if shape.kind == "plane":
        shape = replace(shape, kind="box", size=np.full(3, reach))
        origin = origin + np.array([0.0, 0.0, reach])
    text = shape_urdf(shape, origin, np.eye(3))
    none = {"name": "ground", "at": np.zeros(3), "mass": 0.0, "shapes": text}
    return f'<robot name="ground">{LINK_TEXT.format(*np.zeros((3, 3)), **none)}</robot>'


def tree_urdf(mechanism: NeutralMechanism, root: int) -> str:
    """URDF of the tree on a link, whose frame is at its centre.

    Link number k has the name ``linkk``, and joint number j ``jointj``.
    """
    ends = {root: (f"link{root}", mechanism.links[root].centre)}
    lines = [link_urdf(mechanism, root, *ends[root], root > 0)]
    for j, one in enumerate(mechanism.joints):
        if one.kind == "free" or one.parent not in ends:
            continue
        k, own = one.child, mechanism.joints_of(one.child)
        last = j == own[-1]  # the others of a row have links without mass
        parent, origin = ends[one.parent if j == own[0] else k]
        child = f"link{k}" if last else f"row{j}"
        kind = "revolute" if one.limits and one.kind == "hinge" else JOINT_TYPES[one.kind]
        what = {"kind": kind, "ends": one.ends if one.limits else WITHOUT_RANGE, "axis": one.axis}
        what |= {"parent": parent, "child": child}
        lines.append(JOINT_TEXT.format(j=j, at=one.anchor - origin, **what))
        lines.append(link_urdf(mechanism, k, child, one.anchor, last))
        ends[k] = child, one.anchor
    return "\n".join(['<robot name="tree">', *lines, "</robot>"])


def link_urdf(
    mechanism: NeutralMechanism, k: int, name: str, origin: PlainArray, whole: bool
) -> str:
    """URDF of a link, or of one without mass and shapes, unless it is the `whole` one."""
    link, share = mechanism.links[k], float(whole)
    own = [shape_urdf(one, origin) for one in mechanism.shapes if whole and one.link == k]
    what = {"name": name, "at": link.centre - origin, "mass": share * link.mass}
    return LINK_TEXT.format(*share * link.inertia, shapes="".join(own), **what)
