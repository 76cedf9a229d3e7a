"""One pose at rest in pymunk, and the shapes that its rods have in it."""

import time

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import Curves, Run
from proofmass.sim.pymunk.held import hold
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.pose import gaps, joint_value, turned
from proofmass.sim.pymunk.read import Channel, unwrapped
from proofmass.sim.pymunk.space import Settings
from proofmass.sim.rod_chain import Chain
from proofmass.sim.rod_shape import Pose, shapes

NO_MOTION = "nothing moves: no rates, no accelerations"


def rest(links: Links, run: Run, channels: dict[str, Channel], settings: Settings) -> Curves:
    """Let a mechanism come to rest with its drives held at their first values.

    Rods are read at the arc lengths ``run.x``; sensors have the same value everywhere.
    """
    began, start = time.perf_counter(), run.motion(run.x[:1])[0][:, 0]
    held = hold(links, settings)
    held.settle(start)
    pose = held.pose
    efforts = held.efforts() if any(c.order == -2 for c in channels.values()) else np.empty(0)
    curves = {name: np.full(run.x.size, efforts[c.drive] * c.factor if c.order == -2
                            else c.function(pose))
              for name, c in channels.items() if c.order in (0, -2)}
    curves = {name: unwrapped(name, curve) for name, curve in curves.items()}
    curves |= shapes(run, lambda one: shape(links, pose, one))
    missing = {name: NO_MOTION for name in channels if name not in curves}
    return Curves(run.x, curves, missing, gap=float(gaps(links, pose).max()),
                  seconds=time.perf_counter() - began, steps=1,
                  settings={"iterations": held.most, "error_bias": settings["error_bias"]})


def shape(links: Links, pose: Array, one: Chain) -> Pose:
    """Vertices, angles and bends of a rod's links."""
    bodies = [links.model.body(name).id for name in one.names]
    tip = links.model.site(f"{one.rod.name}.tip").id
    places = [place(links, pose, b, links.data.xpos[b]) for b in bodies]
    places.append(place(links, pose, bodies[-1], links.data.site_xpos[tip]))
    ahead = links.plane.flat(links.data.xmat[bodies].reshape(-1, 3, 3)[:, :, 0])
    angles = np.arctan2(ahead[:, 1], ahead[:, 0]) + pose[links.of_body[bodies], 2]
    bends = [joint_value(links.joints[links.model.joint(name).id], pose) if jointed else 0.0
             for name, jointed in zip(one.names, one.jointed, strict=True)]
    return np.array(places), angles, np.array(bends, float)


def place(links: Links, pose: Array, body: int, start: Array) -> Array:
    """Where a point of a body (3,), given in the start pose, is in another pose."""
    link, plane = links.of_body[body], links.plane
    local = plane.flat(start) - links.centre[link]
    return plane.world(pose[link, :2] + turned(pose[link, 2], local), float(start @ plane.normal))
