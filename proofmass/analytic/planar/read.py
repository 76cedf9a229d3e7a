"""A `Mechanism` from the numbers of a compiled MJCF; none of MuJoCo's own kinematics is used."""

from typing import Any

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array, NotCovered
from proofmass.analytic.planar.mechanism import Body, Coupling, Joint, Mechanism, Pin

PARALLEL = 1e-9
"""Largest sine of the angle at which two directions still count as parallel."""
OFF = mujoco.mjtDisableBit


class Reader:
    """The reference pose of a compiled model in space, and its plane of motion.

    Attributes
    ----------
    at, turn : ndarray (bodies, 3), (bodies, 3, 3)
        Body frames of the reference pose.
    e1, e2, normal : ndarray (3,)
        The plane: e1 is the world's x (its y if x is the normal), the normal the first hinge's
        axis.
    """

    def __init__(self, model: Any):
        self.model = model
        self.at, self.turn = np.zeros((model.nbody, 3)), np.tile(np.eye(3), (model.nbody, 1, 1))
        for b in range(1, model.nbody):
            parent = model.body_parentid[b]
            self.turn[b] = self.turn[parent] @ rotation(model.body_quat[b])
            self.at[b] = self.at[parent] + self.turn[parent] @ model.body_pos[b]
        self.axes = np.einsum("jab,jb->ja", self.turn[model.jnt_bodyid], model.jnt_axis)
        self.normal = self._normal()
        x = np.eye(3)[0 if np.linalg.norm(np.cross(self.normal, np.eye(3)[0])) > PARALLEL else 1]
        e1 = x - (x @ self.normal) * self.normal
        self.e1 = e1 / np.linalg.norm(e1)
        self.e2 = np.cross(self.normal, self.e1)

    def _normal(self) -> Array:
        hinge = self.model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
        if not hinge.any():
            raise NotCovered("a mechanism without hinges has no plane of motion")
        normal = np.asarray(self.axes[hinge][0])
        for j, axis in enumerate(self.axes):
            out = np.linalg.norm(np.cross(normal, axis)) if hinge[j] else abs(normal @ axis)
            if out > PARALLEL:
                raise NotCovered(f"joint {self.model.joint(j).name!r} leaves the plane of motion")
        return normal

    def flat(self, vector: Array) -> complex:
        """A vector's part in the plane, as a complex number."""
        return complex(vector @ self.e1, vector @ self.e2)

    def point(self, body: int, local: Array) -> complex:
        """A point of a body, in the reference pose."""
        return self.flat(self.at[body] + self.turn[body] @ local)

    def joint(self, j: int, ctrl: Array) -> Joint:
        """Joint number j, with the constant loads that motors give it."""
        model, dof, adr = self.model, self.model.jnt_dofadr[j], self.model.jnt_qposadr[j]
        hinge = model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
        place = (self.point(model.jnt_bodyid[j], model.jnt_pos[j]) if hinge
                 else self.flat(self.axes[j]))
        return Joint(
            model.joint(j).name, bool(hinge), place,
            float(np.sign(self.axes[j] @ self.normal)) if hinge else 1.0,
            float(model.qpos0[adr]), self.unless(OFF.mjDSBL_SPRING, model.jnt_stiffness[j]),
            float(model.qpos_spring[adr]), self.unless(OFF.mjDSBL_DAMPER, model.dof_damping[dof]),
            float(model.dof_armature[dof]), self.load(j, ctrl),
            (float(model.jnt_range[j, 0]), float(model.jnt_range[j, 1])) if model.jnt_limited[j]
            and not disabled(model, OFF.mjDSBL_LIMIT, OFF.mjDSBL_CONSTRAINT)
            else (-np.inf, np.inf))

    def load(self, j: int, ctrl: Array) -> float:
        """What the motors on joint number j do, as far as its range of forces lets them."""
        model, load = self.model, 0.0
        if not disabled(model, OFF.mjDSBL_ACTUATION):
            load = sum(self.motor(a, ctrl) for a in range(model.nactuator)
                       if model.actuator_trnid[a, 0] == j and joined(model, a))
        limited = model.jnt_actfrclimited[j]
        return float(np.clip(load, *model.jnt_actfrcrange[j]) if limited else load)

    def motor(self, a: int, ctrl: Array) -> float:
        """Moment or force of motor number a, with its control and its force in their ranges."""
        model, control = self.model, ctrl[self.model.actuator_ctrladr[a]]
        if model.opt.disableactuator & 1 << int(model.actuator_group[a]):
            return 0.0
        if model.actuator_ctrllimited[a] and not disabled(model, OFF.mjDSBL_CLAMPCTRL):
            control = np.clip(control, *model.actuator_ctrlrange[a])
        force = model.actuator_gainprm[a, 0] * control
        if model.actuator_forcelimited[a]:
            force = np.clip(force, *model.actuator_forcerange[a])
        return float(model.actuator_gear[model.actuator_outadr[a], 0] * force)

    def unless(self, flag: int, value: float) -> float:
        """A number, or zero if the model disables what it stands for."""
        return 0.0 if disabled(self.model, flag) else float(value)

    def body(self, b: int) -> Body:
        """Body number b."""
        model = self.model
        frame = self.turn[b] @ rotation(model.body_iquat[b])
        moment = float((self.normal @ frame) ** 2 @ model.body_inertia[b])
        first = model.body_jntadr[b]
        joints = tuple(range(first, first + model.body_jntnum[b])) if first >= 0 else ()
        return Body(model.body(b).name, int(model.body_parentid[b]), joints,
                    float(model.body_mass[b]), self.point(b, model.body_ipos[b]), moment)

    def pin(self, e: int) -> Pin:
        """Connect equality number e."""
        model = self.model
        one, two = model.eq_obj1id[e], model.eq_obj2id[e]
        places = model.eq_data[e, :3], model.eq_data[e, 3:6]
        if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
            places = model.site_pos[one], model.site_pos[two]
            one, two = model.site_bodyid[one], model.site_bodyid[two]
        return Pin(model.equality(e).name, int(one), self.point(one, places[0]),
                   int(two), self.point(two, places[1]))

    def coupling(self, e: int) -> Coupling:
        """Joint equality number e."""
        model = self.model
        return Coupling(model.equality(e).name, int(model.eq_obj1id[e]), int(model.eq_obj2id[e]),
                        tuple(float(c) for c in model.eq_data[e, :5]))


def disabled(model: Any, *flags: int) -> bool:
    """Whether a model sets one of these disable flags."""
    return any(model.opt.disableflags & int(flag) for flag in flags)


def joined(model: Any, a: int) -> bool:
    """Whether actuator number a acts on a joint."""
    return int(model.actuator_trntype[a]) in (mujoco.mjtTrn.mjTRN_JOINT,
                                              mujoco.mjtTrn.mjTRN_JOINTINPARENT)


def rotation(quaternion: Array) -> Array:
    """Rotation matrix of a unit quaternion (w, x, y, z)."""
    w, (x, y, z) = quaternion[0], quaternion[1:]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


def read(model: Any, start: str) -> tuple[Mechanism, Reader]:
    """Read a planar mechanism.

    Parameters
    ----------
    model : mujoco.MjModel
        Compiled; only its numbers are read.
    start : str
        Name of the key with the start pose; of no meaning in a model without keys.

    Returns
    -------
    Mechanism, Reader

    Raises
    ------
    ValueError
        What is not a planar mechanism of hinges, slides, connects and joint equalities; by name.
    """
    refuse(model)
    reader = Reader(model)
    names = [model.key(k).name for k in range(model.nkey)]
    if names and start not in names:
        raise ValueError(f"no key {start!r}; there are: {', '.join(names)}")
    key = names.index(start) if names else -1
    ctrl = model.key_ctrl[key] if names else np.zeros(model.nu)
    active = [] if disabled(model, OFF.mjDSBL_EQUALITY, OFF.mjDSBL_CONSTRAINT) else [
        e for e in range(model.neq) if model.eq_active0[e]]
    connects = [e for e in active if model.eq_type[e] == mujoco.mjtEq.mjEQ_CONNECT]
    gravity = reader.unless(OFF.mjDSBL_GRAVITY, 1.0) * model.opt.gravity
    return Mechanism(
        tuple(reader.body(b) for b in range(model.nbody)),
        tuple(reader.joint(j, ctrl) for j in range(model.njnt)),
        tuple(reader.pin(e) for e in connects),
        tuple(reader.coupling(e) for e in active if e not in connects),
        reader.flat(gravity),
        np.array(model.key_qpos[key] if names else model.qpos0),
        np.array(model.key_qvel[key] if names else np.zeros(model.nv))), reader


def refuse(model: Any) -> None:
    """Raise NotCovered, by name, for what a planar mechanism here does not have."""
    for j in range(model.njnt):
        if mujoco.mjtJoint(model.jnt_type[j]) not in (mujoco.mjtJoint.mjJNT_HINGE,
                                                      mujoco.mjtJoint.mjJNT_SLIDE):
            raise NotCovered(f"joint {model.joint(j).name!r} is neither a hinge nor a slide")
        if model.jnt_stiffnesspoly[j].any() or model.dof_dampingpoly[j].any():
            raise NotCovered(f"joint {model.joint(j).name!r} has a polynomial spring or damper")
        if model.dof_frictionloss[j] > 0 and not disabled(model, OFF.mjDSBL_FRICTIONLOSS,
                                                          OFF.mjDSBL_CONSTRAINT):
            raise NotCovered(f"joint {model.joint(j).name!r} has friction")
    for e in np.flatnonzero(model.eq_active0):
        kind = mujoco.mjtEq(model.eq_type[e])
        if kind not in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_JOINT):
            raise NotCovered(f"equality {model.equality(e).name!r} is neither connect nor joint")
    for a in range(model.nactuator):
        motor = (model.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED
                 and model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE
                 and model.actuator_dyntype[a] == mujoco.mjtDyn.mjDYN_NONE)
        if not (motor and joined(model, a)):
            raise NotCovered(f"actuator {model.actuator(a).name!r} is no motor on a joint")
    for what, there in {"a tendon": model.ntendon, "a flex": model.nflex, "a mocap body":
                        model.nmocap, "a fluid": model.opt.density + model.opt.viscosity}.items():
        if there:
            raise NotCovered(f"it has {what}")


def refuse_contacts(model: Any) -> None:
    """Raise NotCovered if bodies of the model may touch, which a free motion does not cover."""
    touchable = model.geom_bodyid[(model.geom_contype | model.geom_conaffinity) > 0]
    if not disabled(model, OFF.mjDSBL_CONTACT, OFF.mjDSBL_CONSTRAINT) and (
            np.unique(touchable).size > 1 or model.npair):
        raise NotCovered('contacts are not covered by a free motion: give <option> a '
                         '<flag contact="disable"/>')
