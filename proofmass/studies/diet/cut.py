"""What features do to a draft: functions of a draft and of names, in place.

Whatever is gone already, with another feature, stays gone.
"""

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.studies.diet.draft import Draft

JOINT, GEOM = mujoco.mjtJoint, mujoco.mjtGeom
AUTO = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO  # where a body has none of its own
ROUNDING = 1e-9


def switch_off(draft: Draft, bit: int) -> None:
    """Set a disable flag."""
    draft.spec.option.disableflags |= bit


def set_option(draft: Draft, name: str, value: float) -> None:
    """Set one of the engine's options."""
    setattr(draft.spec.option, name, value)


def masks_off(draft: Draft, name: str) -> None:
    """Let a geom collide with nothing."""
    if geom := draft.find("geoms", name):
        geom.contype = geom.conaffinity = 0


def unlimit(draft: Draft, name: str) -> None:
    """Take the limits off a joint."""
    if joint := draft.find("joints", name):
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE


def flatten(draft: Draft, name: str) -> None:
    """Delete a material; what is made of it keeps its colour.

    Raises
    ------
    ValueError
        A tendon is made of it: MuJoCo does not let a tendon's material be taken off.
    """
    material = draft.find("materials", name)
    if material is None:
        return
    for tendon in draft.spec.tendons:
        if tendon.material == name:
            raise ValueError(f"tendon {tendon.name!r} is made of it, which cannot be undone")
    for kind in ("geom", "site"):
        for element in getattr(draft.spec, f"{kind}s"):
            if element.material == name:
                element.material, element.rgba = "", material.rgba
            usual = getattr(element.classname, kind)
            if usual.material == name:
                usual.material = ""
    draft.spec.delete(material)


def undraw(draft: Draft, name: str) -> None:
    """Delete a geom that collides with nothing; its body keeps the inertia that it gave."""
    if geom := draft.find("geoms", name):
        weigh(draft, geom.parent)
        draft.spec.delete(geom)


def enclose(draft: Draft, name: str) -> None:
    """Replace a mesh by the box of the same inertia, which the compiler fits to it."""
    geom = draft.find("geoms", name)
    if geom is None or geom.type != GEOM.mjGEOM_MESH:
        return
    weigh(draft, geom.parent)
    geom.type = GEOM.mjGEOM_BOX
    fitted = draft.compiled().geom(name)
    geom.meshname, geom.fromto = "", [np.nan] * 6
    geom.size, geom.pos, geom.quat = fitted.size, fitted.pos, fitted.quat
    geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def weigh(draft: Draft, body: mujoco._specs.MjsBody) -> None:
    """Write down the inertia that the compiler finds for a body in its geoms.

    Where it finds it in spite of an inertia that is given, all bodies get what it finds.
    """
    compiler, model = draft.spec.compiler, draft.compiled()
    by_rule = compiler.inertiafromgeom != AUTO or compiler.settotalmass > 0
    for one in draft.spec.bodies[1:] if by_rule else [body]:
        if one.name == "world" or (one.explicitinertial and not by_rule):
            continue
        found = model.body(one.name)
        one.explicitinertial, one.mass = True, found.mass[0]
        one.ipos, one.iquat, one.inertia = found.ipos, found.iquat, found.inertia
    compiler.inertiafromgeom, compiler.settotalmass = AUTO, -1


def coarser(draft: Draft, share: int) -> None:
    """Cut every rod into so many times fewer segments."""
    draft.share = share


def planar(draft: Draft, name: str, normal: Array) -> None:
    """Replace a free joint by two slides and a hinge, or a ball by a hinge, about `normal`.

    The normal is that of the world.  In every key the joint must be in that plane.

    Raises
    ------
    ValueError
        A key leaves the plane.
    """
    joint = draft.find("joints", name)
    if joint is None:
        return
    before, body, free = draft.compiled(), joint.parent, joint.type == JOINT.mjJNT_FREE
    data = mujoco.MjData(before)
    mujoco.mj_kinematics(before, data)
    turn = data.body(body.name).xmat.reshape(3, 3)
    axis = turn.T @ normal
    one = turn.T @ np.roll(normal, 1)
    across = [one, np.cross(axis, one)] if free else []
    poses = [flat_pose(before, key, joint, np.array([*across, axis]))
             for key in range(before.nkey)]
    draft.drop("joints", name)
    added = []
    for k, way in enumerate(across):
        body.add_joint(name=f"{name} {k + 1}", type=JOINT.mjJNT_SLIDE, axis=way)
        added.append(f"{name} {k + 1}")
    body.add_joint(name=f"{name} 0", type=JOINT.mjJNT_HINGE, axis=axis)
    added.append(f"{name} 0")
    fill(draft, added, poses)


def flat_pose(model: mujoco.MjModel, key: int, joint: object, axes: Array) -> tuple[Array, Array]:
    """Values and rates of slides and hinge that stand for a free joint or a ball in a key."""
    there = model.joint(joint.name)  # type: ignore[attr-defined]
    pose = model.key_qpos[key, there.qposadr[0] :]
    speed = model.key_qvel[key, there.dofadr[0] :]
    zero, spin = model.qpos0[there.qposadr[0] :], speed[:3]
    place, pace, shift = np.zeros(3), np.zeros(3), 0
    turn = np.zeros(9)
    if len(axes) == 3:
        mujoco.mju_quat2Mat(turn, zero[3:7])
        place, pace = (turn.reshape(3, 3).T @ v for v in (pose[:3] - zero[:3], speed[:3]))
        spin, shift = speed[3:6], 3
    back, rest = np.zeros(4), np.zeros(4)
    mujoco.mju_negQuat(back, zero[shift : shift + 4])
    mujoco.mju_mulQuat(rest, back, pose[shift : shift + 4])
    axis, ways = axes[-1], axes[:-1]
    angle = 2 * np.arctan2(rest[1:] @ axis, rest[0])
    off = [rest[1:] - (rest[1:] @ axis) * axis, spin - (spin @ axis) * axis]
    off += [place - ways.T @ (ways @ place), pace - ways.T @ (ways @ pace)] if len(ways) else []
    if np.abs(off).max() > ROUNDING:
        raise ValueError(f"key {model.key(key).name!r} leaves the plane")
    return np.array([*(ways @ place), angle]), np.array([*(ways @ pace), spin @ axis])


def fill(draft: Draft, joints: list[str], poses: list[tuple[Array, Array]]) -> None:
    """Put values and rates of new joints into all keys."""
    model = draft.compiled()
    for key, (values, rates) in zip(draft.spec.keys, poses, strict=True):
        pose, speed = model.key(key.name).qpos.copy(), model.key(key.name).qvel.copy()
        for joint, value, rate in zip(joints, values, rates, strict=True):
            pose[model.joint(joint).qposadr[0]] = value
            speed[model.joint(joint).dofadr[0]] = rate
        key.qpos, key.qvel = pose, speed
