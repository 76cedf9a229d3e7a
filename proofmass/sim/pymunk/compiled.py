"""A compiled planar MJCF as links."""

from functools import partial

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.mujoco.model import gear_of, joint_of
from proofmass.sim.plane import Plane, find_plane
from proofmass.sim.protocol import BadModel
from proofmass.sim.pymunk.inertia import inertias
from proofmass.sim.pymunk.links import HAIR, Hold, Joint, Links, Pull
from proofmass.sim.pymunk.refuse import dead_load, refuse, refuse_gravity, refuse_wrench

OPEN = 0.05
"""Largest gap of a loop in the start pose, as a share of the mechanism's extent."""


def read_links(model: mujoco.MjModel, key: str, driven: tuple[int, ...]) -> Links:
    """Read the links of a compiled planar model in the pose of a keyframe.

    Parameters
    ----------
    model : mujoco.MjModel
    key : str
        Name of the keyframe.
    driven : tuple of int
        Ids of the joints with a prescribed motion.

    Returns
    -------
    Links

    Raises
    ------
    Unsupported
        Something that pymunk or this rebuild cannot express.
    BadModel
        No such keyframe, or its pose leaves a loop open.
    """
    refuse(model, driven)
    data = _at_key(model, key)
    plane = find_plane(model, data)
    refuse_gravity(model, plane)
    roots = np.flatnonzero((model.body_weldid == np.arange(model.nbody)) & (model.body_jntnum > 0))
    of_body = np.array([len(roots) if w == 0 else int(np.searchsorted(roots, w))
                        for w in model.body_weldid])
    centre, mass, moment = inertias(model, data, plane, of_body, len(roots))
    pulls = _pulls(model, data, plane, of_body, centre)
    joints = tuple(_joint(model, data, plane, of_body, centre, j, j in driven)
                   for j in range(model.njnt))
    loops = _loops(model, data, plane, of_body, centre)
    extent = _extent(joints, loops, centre, model)
    _check_closed(loops, centre, extent, key)
    return Links(model, data, plane, of_body, centre, mass, moment, joints,
                 driven, loops, pulls, plane.flat(model.opt.gravity), extent)


def _at_key(model: mujoco.MjModel, key: str) -> mujoco.MjData:
    """Frames and motor forces at the keyframe; a model without any starts at its zero pose."""
    names = [model.key(k).name for k in range(model.nkey)]
    data = mujoco.MjData(model)
    if names:
        if key not in names:
            raise BadModel(f"no key '{key}'; the model has {', '.join(names)}")
        mujoco.mj_resetDataKeyframe(model, data, names.index(key))
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdActuation(model, data)
    return data


def _joint(model: mujoco.MjModel, data: mujoco.MjData, plane: Plane, of_body: Array,
           centre: Array, j: int, driven: bool) -> Joint:
    body, at, dof = model.jnt_bodyid[j], model.jnt_qposadr[j], model.jnt_dofadr[j]
    a, b = of_body[model.body_parentid[body]], of_body[body]
    point, axis, sign = plane.flat(data.xanchor[j]), None, 1.0
    if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE:
        axis = plane.flat(data.xaxis[j])
        point = centre[b] if a == len(centre) - 1 else centre[a]
        foot = point + axis * (axis @ (centre[b] - point))
        hold = Hold(model.joint(j).name, a, b, foot - centre[a], foot - centre[b], axis)
    else:
        sign = float(np.sign(data.xaxis[j] @ plane.normal))
        hold = Hold(model.joint(j).name, a, b, point - centre[a], point - centre[b])
    limited = model.jnt_limited[j] and not driven
    return Joint(hold.name, hold, float(data.qpos[at]), sign, float(data.qvel[dof]),
                 _stiffness(model, j), float(model.qpos_spring[at]),
                 float(model.dof_damping[dof]),
                 0.0 if driven else _load(model, data, j),
                 tuple(model.jnt_range[j] + [HAIR, -HAIR]) if limited else None)


def _load(model: mujoco.MjModel, data: mujoco.MjData, j: int) -> float:
    """What the motors on a joint do, as far as its range of forces lets them."""
    own = sum(float(data.actuator_force[model.actuator_outadr[a]] * gear_of(model, a)[0])
              for a in range(model.nactuator) if joint_of(model, a) == j)
    return float(np.clip(own, *model.jnt_actfrcrange[j])) if model.jnt_actfrclimited[j] else own


def _pulls(model: mujoco.MjModel, data: mujoco.MjData, plane: Plane, of_body: Array,
           centre: Array) -> tuple[Pull, ...]:
    pulls = []
    for a in filter(partial(dead_load, model), range(model.nactuator)):
        site, frame = model.actuator_trnid[a]
        wrench = data.actuator_force[model.actuator_outadr[a]] * (
            gear_of(model, a).reshape(2, 3) @ data.site_xmat[frame].reshape(3, 3).T)
        refuse_wrench(model, a, wrench, plane)
        link = of_body[model.site_bodyid[site]]
        if link < len(centre) - 1:
            pulls.append(Pull(link, plane.flat(data.site_xpos[site]) - centre[link],
                              plane.flat(wrench[0]), float(plane.normal @ wrench[1])))
    return tuple(pulls)


def _stiffness(model: mujoco.MjModel, j: int) -> tuple[float, float, float]:
    square, cube = model.jnt_stiffnesspoly[j].tolist()
    return float(model.jnt_stiffness[j]), square, cube


def _loops(model: mujoco.MjModel, data: mujoco.MjData, plane: Plane, of_body: Array,
           centre: Array) -> tuple[Hold, ...]:
    loops = []
    for e in np.flatnonzero(model.eq_active0):
        ids = (model.eq_obj1id[e], model.eq_obj2id[e])
        if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
            points, bodies = data.site_xpos[list(ids)], model.site_bodyid[list(ids)]
        else:
            bodies = np.array(ids)
            local = model.eq_data[e, :6].reshape(2, 3)
            points = data.xpos[bodies] + np.einsum(
                "bij,bj->bi", data.xmat[bodies].reshape(-1, 3, 3), local)
        a, b = of_body[bodies]
        flat = plane.flat(points)
        loops.append(Hold(model.equality(e).name, a, b, flat[0] - centre[a], flat[1] - centre[b]))
    return tuple(loops)


def _extent(joints: tuple[Joint, ...], loops: tuple[Hold, ...], centre: Array,
            model: mujoco.MjModel) -> float:
    """Largest distance between two anchors [m]; between any two points if they all coincide."""
    points = np.array([centre[h.a] + h.on_a for h in (*(j.hold for j in joints), *loops)])
    for cloud in (points, np.vstack([points, centre])):
        size = np.linalg.norm(cloud[:, None] - cloud[None], axis=-1).max()
        if size > 0:
            return float(size)
    return float(model.stat.extent)


def _check_closed(loops: tuple[Hold, ...], centre: Array, extent: float, key: str) -> None:
    for h in loops:
        gap = np.linalg.norm(centre[h.a] + h.on_a - centre[h.b] - h.on_b)
        if gap > OPEN * extent:
            raise BadModel(f"start pose of key '{key}' is not assembled: "
                           f"loop '{h.name}' is open by {gap:.2g} m")
