"""Rods as one-dimensional flexes of MuJoCo, added to an MJCF before it is compiled.

A flex of dimension 1 is a discrete elastic rod (since MuJoCo 3.17): points that are joined by
edges, with springs between the edges.

      |                         points of a clamped rod at -h/2, h/2, 3h/2, .. L, the first two on
    o-|-o---o---o---o---o       the ground: h = L / (n + 1/2), and springs at h/2, 3h/2, ..
      |                         those of a pinned one at 0, h, 2h, .. L

A bend b costs EI/(2h) (2 tan b/2)^2: an error of second order in h, 0.7 to 2.9 times that of a
chain.  Edges are soft constraints of the engine.

    NAME.0, NAME.1, ...     bodies, one for each point; they do not turn
    NAME.tip                site at the far end
    NAME                    the flex, its edges, and the loop that holds the far end
"""

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import Rod, Unsupported
from proofmass.sim.rod_build import LIGHT, PLAIN, SLIDE, THICK, connect
from proofmass.sim.rod_chain import Chain, check

CALM = 0.3  # of a rod's time: damping in proportion to stiffness, critical for the slowest swing


def points(rod: Rod) -> Chain:
    """Cut a rod into the links between its points.

    Raises
    ------
    BadRod
        Fewer than two segments, a length or stiffness that is not positive.
    Unsupported
        A clamp at the far end.
    """
    check(rod)
    if rod.ends[1] == "clamped":
        raise Unsupported(f"rod {rod.name!r}: a flex is clamped where it begins only")
    n, clamped = rod.segments, rod.ends[0] == "clamped"
    h = rod.length / (n + 0.5 if clamped else n)
    lengths, nodes = np.full(n, h), h * np.arange(0.5, n)
    springs = np.append(0.0, np.full(n - 1, rod.stiffness / h))
    if clamped:
        lengths, nodes = np.append(h / 2, lengths), h * np.arange(n + 1.0)
        springs = np.append(np.inf, np.full(n, rod.stiffness / h))
    return Chain(rod, lengths, springs, nodes)


def stations(one: Chain) -> Array:
    """Arc length [m] of a rod's points; the first of a clamped one lies behind the clamp."""
    behind = 0.0 if one.jointed[0] else one.lengths[0]
    return one.vertices - behind * (one.vertices == 0)


def fixed(one: Chain) -> int:
    """How many points are on the body that the rod begins on."""
    return 1 if one.jointed[0] else 2


def moments(bends: Array) -> Array:
    """Moments of bends [rad], over EI/h."""
    return np.asarray(2.0 * np.tan(bends / 2) / np.cos(bends / 2)**2)


def tempo(rod: Rod) -> float:
    """sqrt(m L^3 / EI) [s]: how slow it is."""
    return float(((rod.mass or LIGHT) * rod.length**3 / rod.stiffness)**0.5)


def add(spec: mujoco.MjSpec, bare: mujoco.MjModel, one: Chain) -> None:
    """Add a flex with its bodies, sites and loops; `bare` is the compiled model without rods."""
    rod, site, parent = one.rod, bare.site(one.rod.start), spec.site(one.rod.start).parent
    if bare.body_weldid[site.bodyid[0]]:
        raise Unsupported(f"rod {rod.name!r}: a flex begins on the ground; {parent.name!r} moves")
    turn, bodies = np.zeros(9), []
    mujoco.mju_quat2Mat(turn, site.quat)
    for k, s in enumerate(stations(one)):
        bodies.append(parent.add_body(name=f"{rod.name}.{k}", quat=site.quat,
                                      pos=site.pos + s * turn[::3]))
        if k >= fixed(one):
            free(bodies[-1], rod, one.lengths[-1])
    tip, radius = bodies[-1].add_site(name=f"{rod.name}.tip"), THICK * rod.length
    spec.add_flex(
        name=rod.name, dim=1, young=4 * rod.stiffness / (np.pi * radius**4), poisson=0.0,
        radius=radius, damping=CALM * tempo(rod), contype=0, conaffinity=0,
        vertbody=[body.name for body in bodies], vert=np.zeros(3 * len(bodies)),
        elem=np.stack([range(len(bodies) - 1), range(1, len(bodies))], axis=1).ravel())
    spec.add_equality(name=f"{rod.name}.edges", type=mujoco.mjtEq.mjEQ_FLEX, name1=rod.name)
    if rod.end is not None:
        connect(spec, rod.name, tip.name, rod.end)


def free(body: mujoco._specs.MjsBody, rod: Rod, length: float) -> None:
    """Let a point move, and give it its share of the rod's mass."""
    body.mass, body.explicitinertial = (rod.mass or LIGHT) * length / rod.length, True
    body.inertia = np.full(3, body.mass * length**2 / 12)
    for name, axis in zip("xyz", np.eye(3), strict=True):
        body.add_joint(name=f"{body.name}.{name}", type=SLIDE, axis=axis, stiffness=[0, 0, 0],
                       **PLAIN)
