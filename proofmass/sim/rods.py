"""Rods in an MJCF: chains of links that are added to it before it is compiled.

A rod hangs on the body of its first site; its links follow each other along their x axes.  Sensors,
actuators and loops of the MJCF may name what is added:

    NAME.1, NAME.2, ...     bodies, joints, and sites in the links' middles
    NAME.middle, NAME.tip   sites half way and at the far end, their x axes along the rod; they keep
                            their places when the rod is cut into other segments
    NAME                    the loop that holds the far end
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import BadRod, Rod
from proofmass.sim.rod_build import add, joints_of
from proofmass.sim.rod_chain import Chain, chain
from proofmass.sim.rod_start import start_pose, tip

Frame = tuple[Array, Array]


def compile_with_rods(spec: mujoco.MjSpec, rods: Sequence[Rod]) -> mujoco.MjModel:
    """Add rods to a model and compile it; its keys get their start poses.

    Raises
    ------
    BadRod
        A rod that is too short, of unknown make, or on a site that is not there.
    ValueError
        The model does not compile.
    """
    chains, bare = [chain(rod) for rod in rods], without_links_to_rods(spec)
    check(bare, rods)
    if not spec.keys:
        spec.add_key(name="start")
    own = [(np.array(key.qpos), np.array(key.qvel)) for key in spec.keys]
    for key in spec.keys:
        key.qpos, key.qvel = [], []
    for one in chains:
        add(spec, bare, one)
    model = spec.compile()
    fill_keys(model, bare, own, chains)
    return model


def without_links_to_rods(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The model as it is without rods, and without what may name something of them.

    From then on ``fusestatic`` is off in the spec: rods stand in frames of bodies as they are in
    the file, and their links, also one that is clamped, are asked for by name.
    """
    spec.compiler.fusestatic = False
    bare = spec.copy()
    for element in (*bare.sensors, *bare.actuators, *bare.equalities, *bare.keys):
        bare.delete(element)
    return bare.compile()


def check(bare: mujoco.MjModel, rods: Sequence[Rod]) -> None:
    """Raise `BadRod` where a rod has no site to be held by, or no mass where it has weight."""
    there = [bare.site(i).name for i in range(bare.nsite)]
    for rod in rods:
        tips = [f"{other.name}.tip" for other in rods if other is not rod]
        for key, site, known in (("from", rod.start, there), ("to", rod.end, [*there, *tips])):
            if site is not None and site not in known:
                raise BadRod(rod.name, key, f"no site {site!r}; there are: {', '.join(known)}")
        heavy = not bare.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
        if rod.mass is None and heavy and bare.opt.gravity.any():
            raise BadRod(rod.name, "mass", "missing: gravity acts on it [kg]")


def fill_keys(model: mujoco.MjModel, bare: mujoco.MjModel, own: list[Frame],
              chains: list[Chain]) -> None:
    """Write every key: the model's own joints as they stood in it, and the rods' start poses."""
    added = {model.joint(name).id for one in chains for name in joints_of(one)}
    mine = np.array([j not in added for j in range(model.njnt)], bool)
    places, rates = (np.repeat(mine, np.diff(np.append(adr, size))) for adr, size in (
        (model.jnt_qposadr, model.nq), (model.jnt_dofadr, model.nv)))
    for k, (pose, rate) in enumerate(own):
        if pose.size not in (0, bare.nq):
            raise ValueError(f"key {model.key(k).name!r}: qpos has {pose.size} numbers; the joints "
                             f"without those of the rods have {bare.nq}")
        data = mujoco.MjData(bare)
        data.qpos[:] = pose if pose.size else bare.qpos0
        mujoco.mj_kinematics(bare, data)
        model.key_qpos[k, places] = data.qpos
        model.key_qvel[k, rates] = rate if rate.size else 0.0
        for name, value in start_poses(bare, data, chains).items():
            model.key_qpos[k, model.joint(name).qposadr[0]] = value


def start_poses(bare: mujoco.MjModel, data: mujoco.MjData, chains: list[Chain]) -> dict[str, float]:
    """Values of the rods' joints, one rod after the other: each may end at one before it."""
    frames: dict[str, Frame] = {
        bare.site(i).name: (data.site_xpos[i], data.site_xmat[i].reshape(3, 3))
        for i in range(bare.nsite)}
    found: dict[str, float] = {}
    for one in chains:
        place, turn = frames[one.rod.start]
        target = None
        if one.rod.end is not None:
            if one.rod.end not in frames:
                raise BadRod(one.rod.name, "to", f"rod {one.rod.end.removesuffix('.tip')!r} must "
                             f"stand before it")
            far, other = frames[one.rod.end]
            x, y, _ = (far - place) @ turn
            cos, sin, _ = other[:, 0] @ turn
            target = np.array([x, y, np.arctan2(sin, cos)])
        bends = start_pose(one, target)
        frames[f"{one.rod.name}.tip"] = placed(one, bends, place, turn)
        found |= {n: float(b) for n, b, j in zip(one.names, bends, one.jointed, strict=True) if j}
    return found


def placed(chain: Chain, bends: Array, place: Array, turn: Array) -> Frame:
    """Place and orientation of a rod's tip; `place` and `turn` are those of its beginning."""
    (x, y, angle), _ = tip(chain, bends)
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return place + turn @ [x, y, 0.0], turn @ rotation
