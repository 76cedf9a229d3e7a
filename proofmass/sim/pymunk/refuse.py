"""What the pymunk rebuild of a compiled MJCF does not cover, refused by name."""

from collections.abc import Iterator

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.mujoco.model import joint_of
from proofmass.sim.plane import PARALLEL, Plane
from proofmass.sim.protocol import Unsupported

JOINT, EQ = mujoco.mjtJoint, mujoco.mjtEq
OFF = mujoco.mjtDisableBit


def refuse(model: mujoco.MjModel, driven: tuple[int, ...]) -> None:
    """Raise `Unsupported` if the model holds something that the rebuild would drop silently.

    Parameters
    ----------
    model : mujoco.MjModel
    driven : tuple of int
        Ids of the joints with a prescribed motion.

    Raises
    ------
    Unsupported
        With every reason, each naming its element.
    """
    reasons = [*_joints(model), *_bodies(model), *_equalities(model),
               *_actuators(model, driven), *_contacts(model), *_others(model)]
    if reasons:
        raise Unsupported("; ".join(reasons))


def refuse_gravity(model: mujoco.MjModel, plane: Plane) -> None:
    """Raise `Unsupported` if gravity does not lie in the plane of motion."""
    gravity = model.opt.gravity
    if abs(gravity @ plane.normal) > PARALLEL * np.linalg.norm(gravity):
        raise Unsupported(f"option gravity {gravity.tolist()} does not lie in the plane of motion")


def refuse_wrench(model: mujoco.MjModel, actuator: int, wrench: Array, plane: Plane) -> None:
    """Raise `Unsupported` if a load (force and moment, (2, 3)) leaves the plane of motion."""
    across = np.append(wrench[0] @ plane.normal, plane.flat(wrench[1]))
    if np.abs(across).max() > PARALLEL * np.abs(wrench).max():
        name = model.actuator(actuator).name
        raise Unsupported(f"the load of actuator '{name}' leaves the plane of motion")


def off(model: mujoco.MjModel, bit: mujoco.mjtDisableBit) -> bool:
    """Whether a disable flag is set."""
    return bool(model.opt.disableflags & int(bit))


def _joints(model: mujoco.MjModel) -> Iterator[str]:
    for j in range(model.njnt):
        name, dof = f"joint '{model.joint(j).name}'", model.jnt_dofadr[j]
        if int(model.jnt_type[j]) not in (JOINT.mjJNT_HINGE, JOINT.mjJNT_SLIDE):
            yield f"{JOINT(int(model.jnt_type[j])).name[6:].lower()} {name}"
            continue
        grounded = model.body_weldid[model.body_parentid[model.jnt_bodyid[j]]] == 0
        if model.dof_frictionloss[dof] > 0:
            yield f"frictionloss of {name}"
        if model.dof_dampingpoly[dof].any():
            yield f"polynomial damping of {name}"
        if model.dof_armature[dof] > 0 and not (
                grounded and model.jnt_type[j] == JOINT.mjJNT_HINGE):
            yield f"armature of {name}, which is not a hinge on the ground"


def _bodies(model: mujoco.MjModel) -> Iterator[str]:
    for b in range(1, model.nbody):
        name = f"body '{model.body(b).name}'"
        if model.body_jntnum[b] > 1:
            yield f"{model.body_jntnum[b]} joints on {name}"
        if model.body_gravcomp[b]:
            yield f"gravcomp of {name}"
        if model.body_mocapid[b] >= 0:
            yield f"mocap {name}"


def _equalities(model: mujoco.MjModel) -> Iterator[str]:
    for e in range(model.neq):
        if model.eq_active0[e] and model.eq_type[e] != EQ.mjEQ_CONNECT:
            kind = EQ(int(model.eq_type[e])).name[5:].lower()
            yield f"{kind} equality '{model.equality(e).name}'"


def _actuators(model: mujoco.MjModel, driven: tuple[int, ...]) -> Iterator[str]:
    for a in range(model.nactuator):
        joint = joint_of(model, a)
        if joint in driven:
            continue
        plain = (model.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED
                 and model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE
                 and model.actuator_dyntype[a] == mujoco.mjtDyn.mjDYN_NONE
                 and not model.actuator_damping[a].any() and not model.actuator_armature[a])
        if not plain or (joint < 0 and not dead_load(model, a)):
            yield (f"actuator '{model.actuator(a).name}', which is no motor on a joint, nor on a "
                   f"site with a refsite of the ground")


def dead_load(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator pulls at a site in a direction of the ground."""
    if int(model.actuator_trntype[actuator]) != mujoco.mjtTrn.mjTRN_SITE:
        return False
    frame = model.actuator_trnid[actuator, 1]
    return bool(frame >= 0 and model.body_weldid[model.site_bodyid[frame]] == 0)


def _contacts(model: mujoco.MjModel) -> Iterator[str]:
    if off(model, OFF.mjDSBL_CONTACT) or off(model, OFF.mjDSBL_CONSTRAINT):
        return
    pairs = list(_colliding(model))
    if model.npair or pairs:
        names = [f"'{model.geom(g).name or g}'" for g in sorted({g for p in pairs for g in p})[:6]]
        yield f"contact of geoms {', '.join(names) or 'in <pair>'} (contact is not disabled)"


def _colliding(model: mujoco.MjModel) -> Iterator[tuple[int, int]]:
    weld, parents = model.body_weldid, not off(model, OFF.mjDSBL_FILTERPARENT)
    for g in range(model.ngeom):
        for h in range(g):
            a, b = sorted((model.geom_bodyid[g], model.geom_bodyid[h]))
            up = (weld[model.body_parentid[weld[a]]], weld[model.body_parentid[weld[b]]])
            family = parents and ((weld[a] and up[1] == weld[a]) or (weld[b] and up[0] == weld[b]))
            mask = (model.geom_contype[g] & model.geom_conaffinity[h]
                    | model.geom_contype[h] & model.geom_conaffinity[g])
            if mask and weld[a] != weld[b] and not family and (
                    (a << 16) + b not in model.exclude_signature):
                yield h, g


def _others(model: mujoco.MjModel) -> Iterator[str]:
    yield from (f"tendon '{model.tendon(t).name}'" for t in range(model.ntendon))
    yield from (what for what, there in {
        "flex": model.nflex, "plugin": model.nplugin, "plastic joint springs": model.nplastic,
        "option density": model.opt.density, "option viscosity": model.opt.viscosity}.items()
        if there)
