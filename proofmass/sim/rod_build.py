"""Adding the links of a rod to an `MjSpec`.

A pinned far end is a ``connect``.  A clamped one is two, the second on a slider of the far body, so
that nothing is held twice:

    o==o==o==.----------+       the last link, prolonged by the rod's length
           tip       slider     runs on the x axis of the far site
"""

import mujoco
import numpy as np

from proofmass.sim.protocol import Rod
from proofmass.sim.rod_chain import Chain

CONNECT, SITE = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE
HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
LIGHT = 0.01  # [kg] a rod whose mass is not told
THICK = 0.004  # of the length: radius of the capsules that are drawn
PLAIN = {"damping": [0.0] * 3, "frictionloss": 0.0, "armature": 0.0, "ref": 0.0, "springref": 0.0,
         "limited": mujoco.mjtLimited.mjLIMITED_FALSE}  # whatever <default> says


def joints_of(chain: Chain) -> list[str]:
    """The joints that a rod adds."""
    joints = [name for name, jointed in zip(chain.names, chain.jointed, strict=True) if jointed]
    return [*joints, f"{chain.rod.name}.slider"] if chain.rod.ends[1] == "clamped" else joints


def add(spec: mujoco.MjSpec, bare: mujoco.MjModel, chain: Chain) -> None:
    """Add a rod's links, sites and loops; `bare` is the compiled model without rods."""
    rod, site = chain.rod, bare.site(chain.rod.start)
    body, place, turn = spec.site(rod.start).parent, site.pos, site.quat
    half = rod.length / 2
    starts, ends = chain.vertices[:-1], chain.vertices[1:]
    for name, length, spring, first, last in zip(chain.names, chain.lengths, chain.springs, starts,
                                                 ends, strict=True):
        body = body.add_body(name=name, pos=place, quat=turn)
        if np.isfinite(spring):
            body.add_joint(name=name, type=HINGE, axis=[0, 0, 1], pos=[0, 0, 0],
                           stiffness=[spring, 0, 0], **PLAIN)
        weigh(body, rod, length)
        body.add_site(name=name, pos=[length / 2, 0, 0])
        if first < half <= last:
            body.add_site(name=f"{rod.name}.middle", pos=[half - first, 0, 0])
        place, turn = [length, 0, 0], [1, 0, 0, 0]
    tip = body.add_site(name=f"{rod.name}.tip", pos=place)
    if rod.end is not None:
        connect(spec, rod.name, tip.name, rod.end)
    if rod.ends[1] == "clamped":
        guide(spec, bare, rod, body, place[0])


def weigh(body: mujoco._specs.MjsBody, rod: Rod, length: float) -> None:
    """Give a link its share of the rod's mass, as a slender bar, and its looks."""
    mass = (rod.mass or LIGHT) * length / rod.length
    across = mass * length**2 / 12
    body.mass, body.ipos, body.explicitinertial = mass, [length / 2, 0, 0], True
    body.inertia = [across / 2, across, across]
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0, 0, 0, length, 0, 0], mass=0,
                  size=[THICK * rod.length, 0, 0], contype=0, conaffinity=0)


def connect(spec: mujoco.MjSpec, name: str, one: str, two: str) -> None:
    """Hold two sites together."""
    spec.add_equality(name=name, type=CONNECT, objtype=SITE, name1=one, name2=two)


def guide(spec: mujoco.MjSpec, bare: mujoco.MjModel, rod: Rod, last: mujoco._specs.MjsBody,
          length: float) -> None:
    """Keep the last link on the x axis of the far site."""
    name, ahead = f"{rod.name}.slider", rod.length
    site = bare.site(rod.end)
    carrier = spec.site(rod.end).parent.add_body(name=f"{name}.0", pos=site.pos, quat=site.quat)
    slider = carrier.add_body(name=name, pos=[ahead, 0, 0])
    slider.add_joint(name=name, type=SLIDE, axis=[1, 0, 0], stiffness=[0, 0, 0], **PLAIN)
    weigh(slider, rod, length)
    slider.add_site(name=name)
    last.add_site(name=f"{name}.end", pos=[length + ahead, 0, 0])
    connect(spec, name, f"{name}.end", name)
