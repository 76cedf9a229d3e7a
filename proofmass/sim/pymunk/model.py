"""Read a planar MJCF as links for pymunk, with its channels.

Elements that pymunk cannot represent raise `Unsupported` with their names.  What a run covers is
found in the plain data of the references (`proofmass.analytic.mjcf`), but no number of a link is
taken from there: pymunk has a reading of its own on purpose, so that its curves show a number that
the references misread.
"""

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from proofmass.analytic.mjcf import read_compiled
from proofmass.analytic.names import equality_name, radian_hint
from proofmass.analytic.start import MAX_KEY_VIOLATION
from proofmass.analytic.support import RunKind, examine
from proofmass.base.arrays import Array
from proofmass.sim.contents import (
    active_connects,
    actuators_on,
    gear_of,
    is_linear_in_joint,
    joint_of,
    straight_tendon,
)
from proofmass.sim.mjcf import compile_model
from proofmass.sim.plane import PARALLEL_TOLERANCE, MotionPlane, find_plane
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Rod, Run
from proofmass.sim.pymunk.contacts import read_contacts
from proofmass.sim.pymunk.kinematics import is_determined
from proofmass.sim.pymunk.links import (
    STOP_MARGIN,
    LinkConstraint,
    LinkGear,
    LinkJoint,
    LinkLoad,
    Links,
    LinkSpring,
)
from proofmass.sim.pymunk.read import Sensor, read_channel
from proofmass.sim.pymunk.settings import settings_of_run
from proofmass.sim.pymunk.space import Settings
from proofmass.sim.pymunk.support import SUPPORT
from proofmass.sim.rods import dead_loads, rod_channels
from proofmass.sim.start import start_state

MAX_INERTIA = 1e300  # [kg, kg m^2] largest mass and moment of a link; results of them stay finite


def read_model(model: Path, run: Run) -> tuple[Links, Settings]:
    """The links of an MJCF and the settings of a run.

    Raises
    ------
    BadModel, Unsupported
        See `proofmass.sim.pymunk.engine.simulate`.
    """
    compiled = _compile(model, run)
    driven, kind = _driven_joints(compiled, run), kind_of(run)
    links = read_links(compiled, run.start, driven, run.rods)
    if refused := examine(read_compiled(compiled), SUPPORT, kind, driven)[0]:
        raise Unsupported(f"{'; '.join(refused)} in {kind.in_words}")
    if run.kind == "dynamics":
        state = start_state(compiled, run)
        links = read_links(compiled, run.start, driven, run.rods, state)
    only = f", in {run.kind}; it is covered in dynamics"
    for j in links.rubbing if run.kind != "dynamics" else ():
        friction = f"frictionloss of joint '{links.joints[j].name}'"
        if run.loads:
            load = f"the load of actuator '{run.loads[0].actuator}', which changes"
            raise Unsupported(f"{load}, and {friction} in one sweep")
    if run.kind != "dynamics":
        for joint in links.free[:1]:
            raise Unsupported(f"joint '{joint.name}' of a body that is free in the plane{only}")
        if links.contacts:
            touching = ", ".join(shape.name for shape in links.contacts.shapes[:6])
            raise Unsupported(f"contact of {touching}{only} (contact is not disabled)")
    return links, settings_of_run(run, compiled, bool(links.contacts))


def find_channels(links: Links, run: Run) -> tuple[dict[str, Sensor], dict[str, str]]:
    """The channels of a run that pymunk delivers, and the reasons why others are missing."""
    of_rods = rod_channels(run) if run.rods else {}
    found = {name: read_channel(links, name) for name in run.channels if name not in of_rods}
    if inseparable := forces_beside(links, run):
        found |= {
            name: "pymunk does not separate forces of constraints and drives from those of "
            f"{inseparable}"
            for name, c in found.items()
            if isinstance(c, Sensor) and c.order <= -2
        }
    missing = {name: why for name, why in found.items() if isinstance(why, str)}
    wanted = {name: c for name, c in found.items() if isinstance(c, Sensor)}
    return wanted, missing


def forces_beside(links: Links, run: Run) -> str:
    """What exerts forces beside constraints and drives of a size that is not known, or nothing.

    Dry friction has its largest size where drives prescribe the motion of all joints.
    """
    if links.contacts:
        return "contacts"
    if run.kind == "dynamics" and links.rubbing_loose and not is_determined(links):
        return "dry friction"
    return ""


def _compile(path: Path, run: Run) -> mujoco.MjModel:
    """The compiled model of a file, completed with the rods of a run."""
    for rod in run.rods:
        if rod.spatial:
            raise Unsupported(f"rod '{rod.name}', which twists and leaves the plane")
    model = compile_model(path, run.rods)
    if model.njnt == 0:
        raise Unsupported(f"{path.name}: a model without joints")
    return model


def _driven_joints(model: mujoco.MjModel, run: Run) -> tuple[int, ...]:
    """Ids of the joints that a run drives, in its order."""
    names = [model.joint(j).name for j in range(model.njnt)]
    for drive in run.drives:
        if drive.joint not in names:
            raise BadModel(f"no joint '{drive.joint}'; the model has {', '.join(names)}")
    return tuple(names.index(drive.joint) for drive in run.drives)


def link_inertias(
    model: mujoco.MjModel, data: mujoco.MjData, plane: MotionPlane, of_body: Array, count: int
) -> tuple[Array, Array, Array]:
    """Centre, mass and moment of every link; a body without joints belongs to its parent's link.

    Parameters
    ----------
    model : mujoco.MjModel
    data : mujoco.MjData
        With the kinematics of the start pose.
    plane : MotionPlane
    of_body : ndarray (bodies,)
        Link of each body [1]; `count` is the ground.
    count : int
        Number of moving links.

    Returns
    -------
    centre (count + 1, 2) [m], mass (count,) [kg], moment (count,) [kg m^2]

    Raises
    ------
    BadModel
        A mass or a moment is not positive or too large; Chipmunk would abort.
    """
    frames = data.ximat.reshape(-1, 3, 3)
    about = np.einsum("bij,i->bj", frames, plane.normal) ** 2
    own = np.einsum("bj,bj->b", about, model.body_inertia)
    points = plane.flat(data.xipos)
    centre, mass, moment = np.zeros((count + 1, 2)), np.zeros(count), np.zeros(count)
    for k in range(count):
        bodies = of_body == k
        m, p = model.body_mass[bodies], points[bodies]
        mass[k], centre[k] = m.sum(), m @ p / m.sum()
        moment[k] = own[bodies].sum() + m @ ((p - centre[k]) ** 2).sum(axis=1)
    pins = dict[int, Array]()
    for j in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE):
        k, body = int(of_body[model.jnt_bodyid[j]]), model.jnt_bodyid[j]
        if of_body[model.body_parentid[body]] == count and model.body_jntnum[body] == 1:
            moment[k] += model.dof_armature[model.jnt_dofadr[j]]
            pins[k] = plane.flat(data.xanchor[j])
    for k in range(count):
        if not (0 < mass[k] < MAX_INERTIA and 0 < moment[k] < MAX_INERTIA):
            name = model.body(int(np.flatnonzero(of_body == k)[0])).name
            raise BadModel(
                f"body {name!r}: mass {mass[k]:g} kg, moment of inertia with armature "
                f"{moment[k]:g} kg m2; both must be positive and less than {MAX_INERTIA:g}"
            )
    for k, pin in pins.items():
        _replace_point_mass(centre, mass, moment, k, pin)
    return centre, mass, moment


def _replace_point_mass(centre: Array, mass: Array, moment: Array, k: int, pin: Array) -> None:
    """Replace a link that is nearly a point mass on a ground hinge by a dynamically equal one.

    Only the moment of inertia about the pin and the product of mass and arm matter for such a link;
    the replacement has twice the mass on half the arm.  Chipmunk divides by the moment about the
    centre, so that a moment of 1e-12 kg m2 would multiply rounding errors by 1e12.
    """
    arm = centre[k] - pin
    if moment[k] < 0.1 * mass[k] * (arm @ arm):
        moment[k] += 0.5 * mass[k] * (arm @ arm)
        mass[k] *= 2.0
        centre[k] = pin + 0.5 * arm


JOINT, EQ = mujoco.mjtJoint, mujoco.mjtEq


def refuse_uncovered(model: mujoco.MjModel, driven: tuple[int, ...]) -> None:
    """Raise `Unsupported` if the model contains an element that pymunk cannot represent.

    Parameters
    ----------
    model : mujoco.MjModel
    driven : tuple of int
        Ids of the joints with a prescribed motion.

    Raises
    ------
    Unsupported
        The message lists all such elements by name.
    """
    refused, _ = examine(read_compiled(model), SUPPORT, None, driven)
    if reasons := [*refused, *_uncovered_bodies(model, driven)]:
        raise Unsupported("; ".join(reasons))


def kind_of(run: Run) -> RunKind:
    """The kind of a run; a sweep that leaves degrees of freedom is covered as any other."""
    if run.kind == "dynamics":
        return RunKind.DRIVEN_MOTION if run.drives else RunKind.FREE_MOTION
    if run.kind == "equilibrium":
        return RunKind.EQUILIBRIUM
    return RunKind.MOVING_SWEEP if run.inertia else RunKind.SWEEP


def refuse_gravity(model: mujoco.MjModel, plane: MotionPlane) -> None:
    """Raise `Unsupported` if gravity does not lie in the plane of motion."""
    gravity = model.opt.gravity
    if abs(gravity @ plane.normal) > PARALLEL_TOLERANCE * np.linalg.norm(gravity):
        raise Unsupported(f"option gravity {gravity.tolist()} does not lie in the plane of motion")


def refuse_wrench(model: mujoco.MjModel, actuator: int, wrench: Array, plane: MotionPlane) -> None:
    """Raise `Unsupported` if a load (force and moment, (2, 3)) leaves the plane of motion."""
    across = np.append(wrench[0] @ plane.normal, plane.flat(wrench[1]))
    if np.abs(across).max() > PARALLEL_TOLERANCE * np.abs(wrench).max():
        name = model.actuator(actuator).name
        raise Unsupported(f"the load of actuator '{name}' leaves the plane of motion")


def _uncovered_bodies(model: mujoco.MjModel, driven: tuple[int, ...]) -> Iterator[str]:
    """Bodies with several joints that are not free in the plane, or whose joints have more."""
    for b in np.flatnonzero(model.body_jntnum > 1).tolist():
        name = f"body '{model.body(b).name}'"
        yield from (
            f"{model.body_jntnum[b]} joints on {name}{why}" for why in _why_not_free(model, b)
        )
        yield from _uncovered_on_free(model, b, driven)


def _why_not_free(model: mujoco.MjModel, body: int) -> tuple[str, ...]:
    """The reason why a body with several joints is not free in the plane; empty if it is."""
    joints = model.body_jntadr[body] + np.arange(model.body_jntnum[body])
    if model.jnt_type[joints].tolist() != [JOINT.mjJNT_SLIDE, JOINT.mjJNT_SLIDE, JOINT.mjJNT_HINGE]:
        return ("",)
    if model.body_weldid[model.body_parentid[body]] != 0:
        return (", which is not on the ground",)
    one, two, _ = model.jnt_axis[joints]
    return (
        (", whose slides are not at right angles",) if abs(one @ two) > PARALLEL_TOLERANCE else ()
    )


def _uncovered_on_free(model: mujoco.MjModel, body: int, driven: tuple[int, ...]) -> Iterator[str]:
    """Features of the joints of a free body that are not covered.

    Such a joint is no constraint of Chipmunk that a drive, a load or a limit could belong to.
    """
    motors = {joint_of(model, a) for a in range(model.nactuator)}
    for j in model.body_jntadr[body] + np.arange(model.body_jntnum[body]):
        dof = model.jnt_dofadr[j]
        for what, there in {
            "a drive": j in driven,
            "a motor": j in motors and j not in driven,
            "a spring": model.jnt_stiffness[j] or model.jnt_stiffnesspoly[j].any(),
            "damping": model.dof_damping[dof],
            "frictionloss": model.dof_frictionloss[dof],
            "armature": model.dof_armature[dof],
            "a range": model.jnt_limited[j],
        }.items():
            if there:
                name = f"joint '{model.joint(j).name}' of body '{model.body(body).name}'"
                yield f"{what} of {name}, which is free in the plane"


def servo_gains(model: mujoco.MjModel, j: int) -> tuple[float, float]:
    """Stiffness and damping that servos, the actuators which follow joint j, give to it."""
    gains = [
        -(gear_of(model, a)[0] ** 2) * model.actuator_biasprm[a, 1:3]
        for a in actuators_on(model, j)
        if is_linear_in_joint(model, a)
    ]
    stiffness, damping = np.sum(gains, axis=0) if gains else (0.0, 0.0)
    return float(stiffness), float(damping)


def is_site_load(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator is a load on a site, in a frame of the ground or of the site itself."""
    if int(model.actuator_trntype[actuator]) != mujoco.mjtTrn.mjTRN_SITE:
        return False
    frame = model.actuator_trnid[actuator, 1]
    return bool(frame < 0 or model.body_weldid[model.site_bodyid[frame]] == 0)


COINCIDENT_SHARE = 1e-6
"""Distance, as a share of the model's size, below which points count as one: their distance is
rounding, or an offset that is no measure of the mechanism."""


def read_links(
    model: mujoco.MjModel,
    key: str,
    driven: tuple[int, ...],
    rods: Sequence[Rod] = (),
    state: tuple[Array, Array] | None = None,
) -> Links:
    """Read the links of a compiled planar model in the pose of a keyframe, or in a given state.

    Parameters
    ----------
    model : mujoco.MjModel
    key : str
        Name of the keyframe.
    driven : tuple of int
        Ids of the joints with a prescribed motion.
    rods : sequence of Rod
        The rods that the model has been completed with, for their loads.
    state : tuple of ndarray (nq,), (nv,), optional
        Pose and rates [SI] in place of the keyframe's.

    Returns
    -------
    Links

    Raises
    ------
    Unsupported
        The model contains something that pymunk or this module cannot represent.
    BadModel
        There is no such keyframe, or its pose leaves a loop open.
    """
    refuse_uncovered(model, driven)
    data = _data_at_key(model, key)
    if state:
        data.qpos[:], data.qvel[:] = state
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdActuation(model, data)
    plane = find_plane(model, data)
    refuse_gravity(model, plane)
    roots = np.flatnonzero((model.body_weldid == np.arange(model.nbody)) & (model.body_jntnum > 0))
    of_body = np.array(
        [len(roots) if w == 0 else int(np.searchsorted(roots, w)) for w in model.body_weldid]
    )
    gravity = plane.flat(model.opt.gravity)
    centre, mass, moment = link_inertias(model, data, plane, of_body, len(roots))
    pulls = (
        *_site_loads(model, data, plane, of_body, centre),
        *_rod_loads(model, data, plane, of_body, centre, rods),
    )
    joints = tuple(
        _read_joint(model, data, plane, of_body, centre, j, j in driven) for j in range(model.njnt)
    )
    loops = _read_loops(model, data, plane, of_body, centre)
    extent = _find_extent(joints, loops, centre, model)
    _check_closed(loops, centre, extent, model, key)
    return Links(
        model,
        data,
        plane,
        of_body,
        centre,
        mass,
        moment,
        mass[:, None] * gravity,
        joints,
        driven,
        loops,
        tuple(_read_gears(model, joints)),
        _read_springs(model, data, plane, of_body, centre, extent),
        pulls,
        gravity,
        extent,
        read_contacts(model, data, plane, of_body, centre, extent),
    )


def _data_at_key(model: mujoco.MjModel, key: str) -> mujoco.MjData:
    """Frames and motor forces at a keyframe; a model without keyframes starts at its zero pose."""
    names = [model.key(k).name for k in range(model.nkey)]
    data = mujoco.MjData(model)
    if names:
        if key not in names:
            raise BadModel(f"no key '{key}'; the model has {', '.join(names)}")
        mujoco.mj_resetDataKeyframe(model, data, names.index(key))
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdActuation(model, data)
    return data


def _read_joint(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    plane: MotionPlane,
    of_body: Array,
    centre: Array,
    j: int,
    driven: bool,
) -> LinkJoint:
    """Joint j as a `LinkJoint`.

    The anchors of a slide are chosen so that Chipmunk's groove does not couple sliding with
    rotation.
    """
    body, qpos_index, dof = model.jnt_bodyid[j], model.jnt_qposadr[j], model.jnt_dofadr[j]
    a, b = of_body[model.body_parentid[body]], of_body[body]
    point, axis, sign = plane.flat(data.xanchor[j]), None, 1.0
    free = bool(model.body_jntnum[body] > 1)
    if free:  # the three coordinates are those of the hinge's anchor and the rotation about it
        last = model.body_jntadr[body] + model.body_jntnum[body] - 1
        point = plane.flat(data.xanchor[last])
    if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE and free:
        axis = plane.flat(data.xaxis[j])
        constraint = LinkConstraint(
            model.joint(j).name, a, b, point - centre[a], point - centre[b], axis
        )
    elif model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE:
        axis = plane.flat(data.xaxis[j])
        point = centre[b] if a == len(centre) - 1 else centre[a]
        foot = point + axis * (axis @ (centre[b] - point))
        constraint = LinkConstraint(
            model.joint(j).name, a, b, foot - centre[a], foot - centre[b], axis
        )
    else:
        sign = float(np.sign(data.xaxis[j] @ plane.normal))
        constraint = LinkConstraint(model.joint(j).name, a, b, point - centre[a], point - centre[b])
    limited = model.jnt_limited[j] and not driven
    stiffness, damping = (0.0, 0.0) if driven else servo_gains(model, j)
    return LinkJoint(
        constraint.name,
        constraint,
        float(data.qpos[qpos_index]),
        sign,
        float(data.qvel[dof]),
        _spring_coefficients(model, j),
        float(model.qpos_spring[qpos_index]),
        float(model.dof_damping[dof]) + damping,
        0.0 if driven else _constant_load(model, data, j),
        tuple(model.jnt_range[j] + [STOP_MARGIN, -STOP_MARGIN]) if limited else None,
        float(model.dof_frictionloss[dof]),
        not free,
        stiffness,
    )


def _constant_load(model: mujoco.MjModel, data: mujoco.MjData, j: int) -> float:
    """Constant moment or force of the actuators on joint j, clipped to its range of forces.

    The part of servos is their force at zero rate and at the value where the joint's spring is
    slack.
    """
    own = -servo_gains(model, j)[0] * float(model.qpos_spring[model.jnt_qposadr[j]])
    for a in actuators_on(model, j):
        out = model.actuator_outadr[a]
        force = data.actuator_force[out]
        if is_linear_in_joint(model, a):
            state = data.actuator_length[out], data.actuator_velocity[out]
            force = force - model.actuator_biasprm[a, 1:3] @ state
        own += float(force * gear_of(model, a)[0])
    return float(np.clip(own, *model.jnt_actfrcrange[j])) if model.jnt_actfrclimited[j] else own


def link_load_of(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    a: int,
    force: float,
    plane: MotionPlane,
    of_body: Array,
    centre: Array,
) -> LinkLoad | None:
    """The load of actuator a on a site, for a given force [N]; None for a site of the ground."""
    site, frame = model.actuator_trnid[a]
    follows, frame = frame < 0, site if frame < 0 else frame
    turn = data.site_xmat[frame].reshape(3, 3).T
    wrench = force * (gear_of(model, a).reshape(2, 3) @ turn)
    refuse_wrench(model, a, wrench, plane)
    link = of_body[model.site_bodyid[site]]
    if link == len(centre) - 1:
        return None
    return LinkLoad(
        int(model.site_bodyid[site]),
        link,
        plane.flat(data.site_xpos[site]) - centre[link],
        plane.flat(wrench[0]),
        float(plane.normal @ wrench[1]),
        bool(follows),
        a,
    )


def _site_loads(
    model: mujoco.MjModel, data: mujoco.MjData, plane: MotionPlane, of_body: Array, centre: Array
) -> tuple[LinkLoad, ...]:
    """The loads of all actuators on sites, with their present forces."""
    pulls = []
    for a in filter(partial(is_site_load, model), range(model.nactuator)):
        force = float(data.actuator_force[model.actuator_outadr[a]])
        if pull := link_load_of(model, data, a, force, plane, of_body, centre):
            pulls.append(pull)
    return tuple(pulls)


def _rod_loads(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    plane: MotionPlane,
    of_body: Array,
    centre: Array,
    rods: Sequence[Rod],
) -> Iterator[LinkLoad]:
    """The constant loads of rods; raises `Unsupported` if one leaves the plane."""
    for body, force in dead_loads(model, rods):
        link = of_body[body]
        if abs(force @ plane.normal) > PARALLEL_TOLERANCE * np.linalg.norm(force):
            raise Unsupported(
                f"the load of body '{model.body(body).name}' leaves the plane of motion"
            )
        if link < len(centre) - 1:
            point = plane.flat(data.xipos[body]) - centre[link]
            yield LinkLoad(body, link, point, plane.flat(force), 0.0)


def _read_springs(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    plane: MotionPlane,
    of_body: Array,
    centre: Array,
    extent: float,
) -> tuple[LinkSpring, ...]:
    """The tendons as springs; raises `Unsupported` if the sites are not in one parallel plane."""
    found = []
    for t in range(model.ntendon):
        sites, name = straight_tendon(model, t), model.tendon(t).name
        assert sites is not None
        points, bodies = data.site_xpos[list(sites)], model.site_bodyid[list(sites)]
        if abs((points[0] - points[1]) @ plane.normal) > PARALLEL_TOLERANCE * extent:
            raise Unsupported(f"tendon '{name}', whose sites differ in height over the plane")
        a, b = of_body[bodies]
        flat = plane.flat(points)
        found.append(
            LinkSpring(
                name,
                int(a),
                int(b),
                flat[0] - centre[a],
                flat[1] - centre[b],
                float(model.tendon_stiffness[t]),
                float(model.tendon_damping[t]),
                (float(model.tendon_lengthspring[t, 0]), float(model.tendon_lengthspring[t, 1])),
                (int(bodies[0]), int(bodies[1])),
            )
        )
    return tuple(found)


def with_controls(links: Links, loads: Sequence[str], controls: Array) -> Links:
    """The links with other controls of the actuators `loads`."""
    model, data = links.model, copy(links.data)
    for name, control in zip(loads, controls.tolist(), strict=True):
        data.ctrl[model.actuator_ctrladr[model.actuator(name).id]] = control
    mujoco.mj_fwdActuation(model, data)
    pulls = _site_loads(model, data, links.plane, links.of_body, links.centre)
    joints = tuple(
        joint if j in links.driven else replace(joint, load=_constant_load(model, data, j))
        for j, joint in enumerate(links.joints)
    )
    dead = tuple(pull for pull in links.pulls if pull.actuator < 0)
    return replace(links, data=data, joints=joints, pulls=(*pulls, *dead))


def _spring_coefficients(model: mujoco.MjModel, j: int) -> tuple[float, float, float]:
    """Coefficients (k, a, b) of the spring of joint j, as in `LinkJoint`."""
    square, cube = model.jnt_stiffnesspoly[j].tolist()
    return float(model.jnt_stiffness[j]), square, cube


def _read_loops(
    model: mujoco.MjModel, data: mujoco.MjData, plane: MotionPlane, of_body: Array, centre: Array
) -> tuple[LinkConstraint, ...]:
    """The ``<connect>`` equalities as pins that close loops."""
    loops = []
    for e in active_connects(model):
        ids = (model.eq_obj1id[e], model.eq_obj2id[e])
        if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
            points, bodies = data.site_xpos[list(ids)], model.site_bodyid[list(ids)]
        else:
            bodies = np.array(ids)
            local = model.eq_data[e, :6].reshape(2, 3)
            points = data.xpos[bodies] + np.einsum(
                "bij,bj->bi", data.xmat[bodies].reshape(-1, 3, 3), local
            )
        a, b = of_body[bodies]
        flat = plane.flat(points)
        loops.append(
            LinkConstraint(equality_name(model, e), a, b, flat[0] - centre[a], flat[1] - centre[b])
        )
    return tuple(loops)


STILL_RATIO = 1e-12
"""Ratio of a gear below which it is rounding of 0: Chipmunk divides by the ratio."""


def _read_gears(model: mujoco.MjModel, joints: tuple[LinkJoint, ...]) -> Iterator[LinkGear]:
    """The joint equalities as gears.

    With the turns A and B of both joints' links since the start, an equality of two joints on the
    ground is A = r B - phase.  A planet on an arm B turns by A - B relative to it, so that
    A = (1 + r) B - phase; with r = -1 it keeps its direction, and is geared to the ground.
    """
    for e in np.flatnonzero(model.eq_active0 & (model.eq_type == EQ.mjEQ_JOINT)):
        one, two = (joints[j] for j in (model.eq_obj1id[e], model.eq_obj2id[e]))
        zeros = model.qpos0[model.jnt_qposadr[[model.eq_obj1id[e], model.eq_obj2id[e]]]]
        level, slope = model.eq_data[e, :2].tolist()
        lacks = one.value - zeros[0] - level - slope * (two.value - zeros[1])
        ratio, phase = slope * one.sign * two.sign, float(one.sign * lacks)
        (ground, a), (other, b) = ((one.constraint.a, one.constraint.b) for one in (one, two))
        if ground == b:  # `one` is the planet's joint
            ground, ratio = other, 1.0 + ratio
        elif other == a:  # `two` is: (1 + r) A = r B - phase
            a, b = b, a
            ratio, phase = (1.0 + ratio) / ratio, -phase / ratio
        if abs(ratio) < STILL_RATIO:
            b, ratio = ground, 1.0
        yield LinkGear(equality_name(model, e), a, b, ratio, phase)


def _find_extent(
    joints: tuple[LinkJoint, ...],
    loops: tuple[LinkConstraint, ...],
    centre: Array,
    model: mujoco.MjModel,
) -> float:
    """Largest distance [m] between two anchors, or among anchors and centres if anchors coincide.

    If these coincide too, it is MuJoCo's extent of the model.
    """
    points = np.array([centre[h.a] + h.on_a for h in (*(j.constraint for j in joints), *loops)])
    among_anchors, among_all = (
        float(np.linalg.norm(cloud[:, None] - cloud[None], axis=-1).max())
        for cloud in (points, np.vstack([points, centre]))
    )
    if not among_all > COINCIDENT_SHARE * model.stat.extent:
        return float(model.stat.extent)
    return among_anchors if among_anchors > COINCIDENT_SHARE * among_all else among_all


def _check_closed(
    loops: tuple[LinkConstraint, ...],
    centre: Array,
    extent: float,
    model: mujoco.MjModel,
    key: str,
) -> None:
    """Raise `BadModel` if a loop is open by more than `MAX_KEY_VIOLATION` in the start pose."""
    for h in loops:
        violation = np.linalg.norm(centre[h.a] + h.on_a - centre[h.b] - h.on_b)
        if violation > MAX_KEY_VIOLATION * extent:
            raise BadModel(
                f"start pose of key '{key}' is not assembled: "
                f"loop '{h.name}' is open by {violation:.2g} m{radian_hint(model, key)}"
            )
