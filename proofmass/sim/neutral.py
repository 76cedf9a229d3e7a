"""Read a model and a run as a mechanism of plain data, for engines of any kind.

The result, `proofmass.sim.interpreter.mechanism.Mechanism`, has numbers, texts and arrays only:
links, joints, loops, gears, springs and loads in the start pose, and the motion of the drives at
all steps.  What it does not carry is refused by name, see `SUPPORT`.

MuJoCo compiles the model and gives its pose and rates at the start.  References keep readings of
their own, so that a number that is misread here shows in the curves.
"""

from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Self

import mujoco
import numpy as np

from proofmass.analytic.mjcf import read_compiled
from proofmass.analytic.names import equality_name, radian_hint
from proofmass.analytic.start import MAX_KEY_VIOLATION
from proofmass.analytic.support import (
    ACTS,
    IN_TIME,
    IRRELEVANT,
    PARTLY,
    REFUSED,
    SAID,
    Answers,
    FeatureAnswer,
    RunKind,
    Support,
    answers,
    covers,
    examine,
)
from proofmass.base.arrays import Array
from proofmass.sim.accelerations import accelerations_with_friction, solve_accelerations
from proofmass.sim.contact_laws import find_pairs, read_law, read_shape
from proofmass.sim.contents import (
    active_connects,
    actuators_on,
    anchor_bodies,
    anchors,
    control_indices,
    find_id,
    gear_of,
    is_disabled,
    is_linear_in_joint,
    key_names,
    may_touch,
    pose_of,
    straight_tendon,
)
from proofmass.sim.interpreter.mechanism import (
    DriveRows,
    NeutralContact,
    NeutralGear,
    NeutralJoint,
    NeutralLink,
    NeutralLoad,
    NeutralLoop,
    NeutralMechanism,
    NeutralShape,
    NeutralSpring,
)
from proofmass.sim.mjcf import compile_model
from proofmass.sim.plane import find_plane
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Rod, Run
from proofmass.sim.rods import dead_loads
from proofmass.sim.smooth import SmoothTerms
from proofmass.sim.start import StartOfModel, loop_opening, start_state

EQ, OBJ, JOINT = mujoco.mjtEq, mujoco.mjtObj, mujoco.mjtJoint
JOINT_KINDS = {
    JOINT.mjJNT_HINGE: "hinge",
    JOINT.mjJNT_SLIDE: "slide",
    JOINT.mjJNT_BALL: "ball",
    JOINT.mjJNT_FREE: "free",
}
Shapes = tuple[NeutralShape, ...]
Pairs = tuple[NeutralContact, ...]
COORDINATES = {"hinge": 1, "slide": 1, "ball": 3, "free": 6}
"""Rates of a joint by its kind."""
ACTING = (
    "ball joint",
    "free joint",
    "stiffness of a joint",
    "polynomial stiffness of a joint",
    "actuatorfrcrange of a joint with motors",
    "connect equality",
    "joint equality, of hinges on the ground or of a planet and its arm",
    "joint equality, whose joints are no such hinges",
    "stiffness of a tendon",
    "an actuator, which is a motor on a joint",
    "an actuator, which is a servo on a joint",
    "an actuator, which is a motor on a site whose refsite, if any, is of the ground",
    "ctrlrange of an actuator",
    "forcerange of a motor",
)
"""Features of a model that a neutral mechanism has."""
WITHOUT_EFFECT = (
    "polynomial damping of a driven joint",
    "frictionloss of a driven joint",
    "actuatorfrcrange of a driven joint",
    "armature of an actuator on a driven joint",
    "damping of an actuator on a driven joint",
    "polynomial damping of an actuator on a driven joint",
    "force of an actuator on a driven joint",
    "time of the key",
    "integrator or solver of the options",
    "discrete inverse dynamics",
    "sleep of bodies at rest",
    "magnetic field",
    "noise of a sensor",
)
"""Features that do not change a run, whose drives are ideal."""
RESTS = RunKind.SETTLED_SWEEP, RunKind.EQUILIBRIUM
"""Runs that come to rest."""
KINDS = (*IN_TIME, *RESTS)
IN_MOTION = (
    "damping of a joint",
    "armature of a hinge on the ground",
    "armature of a joint, which is no single hinge on the ground",
    "damping of a tendon",
    "rates of the key",
)
"""Features of a neutral mechanism without effect on a rest."""
EXCEPTIONS: dict[str, Answers | FeatureAnswer] = {
    **dict.fromkeys(ACTING, ACTS),
    **dict.fromkeys(IN_MOTION, answers(KINDS, ACTS, irrelevant=RESTS)),
    **dict.fromkeys(WITHOUT_EFFECT, IRRELEVANT),
    **dict.fromkeys(("cutoff of a sensor", "delay of a sensor", "interval of a sensor"), SAID),
    "range of a joint": PARTLY,
    "contacts": PARTLY,
}
SUPPORT = covers(KINDS, EXCEPTIONS, usual=REFUSED)
"""What becomes of each feature of a model in a neutral mechanism."""


RUBBING = {"frictionloss of a joint": answers(KINDS, ACTS, refused=(RunKind.EQUILIBRIUM,))}
"""Dry friction of joints in an engine that has it: an equilibrium is then not determined."""


def support_without(lacks: tuple[str, ...], friction: bool = False) -> Support:
    """The support of an engine that has all of a neutral mechanism but some features.

    `friction` is whether it has dry friction of joints.
    """
    own = RUBBING if friction else {}
    exceptions = {**EXCEPTIONS, **own, **dict.fromkeys(lacks, REFUSED)}
    return covers(KINDS, exceptions, usual=REFUSED)


def driven_joints(model: mujoco.MjModel, run: Run) -> tuple[int, ...]:
    """Ids of the joints that a run drives, in its order; `BadModel` names one that is not there."""
    return tuple(find_id(model, OBJ.mjOBJ_JOINT, "joint", drive.joint) for drive in run.drives)


class ModelReader:
    """A compiled model in a pose, and the parts of its mechanism.

    Parameters
    ----------
    model : MjModel
        With the rods of the run.
    key : str
        Name of the key with pose, rates and controls; a model without keys starts in its zero pose.
    driven : tuple of int
        Ids of the joints with a prescribed motion.
    rods : sequence of Rod
        The rods that the model has been completed with, for their loads.
    state : tuple of ndarray (nq,), (nv,), optional
        Pose and rates [SI] in place of the key's.

    Raises
    ------
    BadModel
        There is no such key, and no state is given.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        key: str,
        driven: tuple[int, ...],
        rods: Sequence[Rod] = (),
        state: tuple[Array, Array] | None = None,
    ) -> None:
        self.model, self.driven, self.rods = model, driven, rods
        self.data, keys = mujoco.MjData(model), key_names(model)
        if key in keys:
            mujoco.mj_resetDataKeyframe(model, self.data, keys.index(key))
        elif keys and state is None:
            raise BadModel(f"no key '{key}'; the model has {', '.join(keys)}")
        if state is not None:
            self.data.qpos[:], self.data.qvel[:] = state
        mujoco.mj_fwdPosition(model, self.data)
        mujoco.mj_fwdVelocity(model, self.data)
        self.controls = self.data.ctrl[:, None].copy()
        """Controls (controls, 1), or (controls, times) at all half steps of a run in time."""

    def with_controls(self, actuators: Iterable[str], values: Array) -> Self:
        """The model with other controls of some actuators."""
        found = copy(self)
        found.controls = self.controls.copy()
        found.controls[control_indices(self.model, actuators)] = values[:, None]
        return found

    @cached_property
    def heads(self) -> list[int]:
        """Bodies that are links, the world first; the others are welded to one of them."""
        weld = self.model.body_weldid
        return [b for b in range(self.model.nbody) if weld[b] == b]

    @cached_property
    def link_of(self) -> Array:
        """Number of the link of each body (bodies,)."""
        places = {head: k for k, head in enumerate(self.heads)}
        return np.array([places[int(w)] for w in self.model.body_weldid])

    def links(self) -> Iterator[NeutralLink]:
        """The links in their state at the start."""
        model, data, rate = self.model, self.data, np.zeros(6)
        for k, head in enumerate(self.heads):
            parts = np.flatnonzero(self.link_of == k) if k else np.zeros(0, int)
            masses = model.body_mass[parts]
            mass = float(masses.sum())
            centre = masses @ data.xipos[parts] / mass if mass else data.xpos[head].copy()
            axes, off = data.ximat[parts].reshape(-1, 3, 3), data.xipos[parts] - centre
            inertia = np.einsum("bik,bjk,bk->bij", axes, axes, model.body_inertia[parts]).sum(0)
            inertia += masses @ (off**2).sum(1) * np.eye(3) - (masses * off.T) @ off
            mujoco.mj_objectVelocity(model, data, int(OBJ.mjOBJ_XBODY), head, rate, 0)
            omega = rate[:3].copy()
            velocity = rate[3:] + np.cross(omega, centre - data.xpos[head])
            if not k:
                centre = np.zeros(3)
            yield NeutralLink(model.body(head).name, mass, inertia, centre, velocity, omega, head)

    def joints(self, forces: bool = True) -> Iterator[NeutralJoint]:
        """The joints, whose servos are springs and dampers; or without the forces of actuators."""
        model, data = self.model, self.data
        for j in range(model.njnt):
            kind = JOINT_KINDS[JOINT(int(model.jnt_type[j]))]
            adr, dof, body = model.jnt_qposadr[j], model.jnt_dofadr[j], int(model.jnt_bodyid[j])
            one = kind in ("hinge", "slide")
            spring = np.array([model.jnt_stiffness[j], *model.jnt_stiffnesspoly[j]])
            if forces and not one and spring.any():
                raise Unsupported(f"stiffness of {kind} joint {model.joint(j).name!r}")
            if forces and not one and model.dof_armature[dof : dof + COORDINATES[kind]].any():
                raise Unsupported(f"armature of {kind} joint {model.joint(j).name!r}")
            if forces and not one and model.dof_frictionloss[dof : dof + COORDINATES[kind]].any():
                raise Unsupported(f"frictionloss of {kind} joint {model.joint(j).name!r}")
            rest, servo, damping, force = float(model.qpos_spring[adr]), 0.0, 0.0, np.zeros(1)
            if j not in self.driven and one and forces:
                servo, damping, force = self.actuation(j, rest)
            yield NeutralJoint(
                model.joint(j).name,
                kind,
                int(self.link_of[model.body_parentid[self.heads[self.link_of[body]]]]),
                int(self.link_of[body]),
                data.xanchor[j].copy(),
                data.xaxis[j].copy(),
                float(data.qpos[adr]) if one else 0.0,
                float(data.qvel[dof]) if one else 0.0,
                spring,
                rest if one else 0.0,
                float(model.dof_damping[dof]) + damping,
                float(model.dof_armature[dof]) if one else 0.0,
                force,
                self.limits(j) if one else None,
                float(model.dof_frictionloss[dof]) if one else 0.0,
                servo,
            )

    def limits(self, j: int) -> tuple[float, float] | None:
        """The range of the coordinate of a hinge or slide that is not driven, if it has one."""
        without = self.model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
        if without or not self.model.jnt_limited[j] or j in self.driven:
            return None
        low, high = self.model.jnt_range[j].tolist()
        return low, high

    def actuation(self, j: int, rest: float) -> tuple[float, float, Array]:
        """Stiffness and damping of the servos on a joint, and the force of all its actuators.

        The force of servos is that at a coordinate `rest` and at no rate.
        """
        model, stiffness, damping, force = self.model, 0.0, 0.0, np.zeros(1)
        for a in actuators_on(model, j):
            gear = float(gear_of(model, a)[0])
            if is_linear_in_joint(model, a):
                _, per_length, per_rate = model.actuator_biasprm[a, :3].tolist()
                stiffness -= per_length * gear**2
                damping -= per_rate * gear**2
            force = force + gear * self.actuator_force(a, gear * rest)
        if model.jnt_actfrclimited[j]:
            force = np.clip(force, *model.jnt_actfrcrange[j])
        return stiffness, damping, np.asarray(force)

    def actuator_force(self, a: int, length: float = 0.0) -> Array:
        """Force of actuator number a with its controls, at a length [N, or N m and a gear of 1]."""
        model = self.model
        if is_disabled(model, a):
            return np.zeros(1)
        control = self.controls[model.actuator_ctrladr[a]]
        clamps = not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
        if clamps and model.actuator_ctrllimited[a]:
            control = np.clip(control, *model.actuator_ctrlrange[a])
        force = model.actuator_gainprm[a, 0] * control
        if model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_AFFINE:
            force = force + model.actuator_biasprm[a, 0] + model.actuator_biasprm[a, 1] * length
        if model.actuator_forcelimited[a]:
            force = np.clip(force, *model.actuator_forcerange[a])
        return np.asarray(force)

    def loops(self) -> Iterator[NeutralLoop]:
        """The ``connect`` equalities."""
        for i in active_connects(self.model):
            one, two = anchor_bodies(self.model, i)
            p, q = anchors(self.model, i, pose_of(self.data))
            name = equality_name(self.model, i)
            yield NeutralLoop(name, int(self.link_of[one]), int(self.link_of[two]), p + 0, q + 0)

    def gears(self) -> Iterator[NeutralGear]:
        """The linear ``joint`` equalities of two joints."""
        model = self.model
        for e in np.flatnonzero(model.eq_active0 & (model.eq_type == EQ.mjEQ_JOINT)).tolist():
            one, two = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
            zeros = model.qpos0[model.jnt_qposadr[[one, two]]]
            level, ratio = model.eq_data[e, :2].tolist()
            level = float(zeros[0] + level - ratio * zeros[1])
            yield NeutralGear(equality_name(model, e), one, two, ratio, level)

    def springs(self) -> Iterator[NeutralSpring]:
        """The tendons straight from site to site, also those that only measure a length."""
        model, data = self.model, self.data
        for t in range(model.ntendon):
            stiffness, damping = float(model.tendon_stiffness[t]), float(model.tendon_damping[t])
            if (sites := straight_tendon(model, t)) is None:
                continue  # refused before, unless the engine reads the MJCF itself
            one, two = (int(model.site_bodyid[s]) for s in sites)
            a, b = int(self.link_of[one]), int(self.link_of[two])
            on_a, on_b = (data.site_xpos[s].copy() for s in sites)
            slack = (float(model.tendon_lengthspring[t, 0]), float(model.tendon_lengthspring[t, 1]))
            name = model.tendon(t).name
            yield NeutralSpring(name, a, b, on_a, on_b, stiffness, damping, slack, one, two)

    def loads(self) -> Iterator[NeutralLoad]:
        """The loads of actuators on sites."""
        model, data = self.model, self.data
        for a in range(model.nactuator):
            if model.actuator_trntype[a] != mujoco.mjtTrn.mjTRN_SITE or is_disabled(model, a):
                continue
            site, frame = model.actuator_trnid[a].tolist()
            body, at = int(model.site_bodyid[site]), data.site_xpos[site].copy()
            if link := int(self.link_of[body]):
                turn = data.site_xmat[site if frame < 0 else frame].reshape(3, 3)
                force, moment = gear_of(model, a).reshape(2, 3) @ turn.T
                share = self.actuator_force(a)
                yield NeutralLoad(link, at, force, moment, frame < 0, share, body, a)

    def contacts(self, is_planar: bool) -> tuple[Shapes, Pairs]:
        """The shapes that may touch, and the pairs of them; two planes never touch.

        Raises
        ------
        Unsupported
            A shape or a law has no counterpart in other engines, see `proofmass.sim.contact_laws`.
        """
        model = self.model
        planes = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        pairs = {p: k for p, k in find_pairs(model).items() if not planes[list(p)].all()}
        numbers = {g: k for k, g in enumerate(sorted({g for pair in pairs for g in pair}))}
        shapes = tuple(
            read_shape(model, self.data, g, int(self.link_of[model.geom_bodyid[g]]))
            for g in numbers
        )
        contacts = list[NeutralContact]()
        for (g, h), pair in pairs.items():
            law = read_law(model, g, h, pair, in_space=not is_planar)
            ends = numbers[g], numbers[h]
            contacts.append(NeutralContact(*ends, law.friction, law.restitution))
        return shapes, tuple(contacts)

    def rod_loads(self) -> Iterator[NeutralLoad]:
        """The constant loads of rods."""
        for body, force, moment in dead_loads(self.model, self.data, self.rods):
            if link := int(self.link_of[body]):
                at = self.data.xipos[body].copy()
                yield NeutralLoad(link, at, force, moment, False, np.ones(1), body)


class NeutralReader(ModelReader):
    """A compiled model in the start of a run in time, and its mechanism.

    Parameters
    ----------
    model : MjModel
        With the rods of the run.
    run : Run
        A run in time.
    timestep : float
        Longest time step [s].
    state : tuple of ndarray (nq,), (nv,), optional
        Pose and rates of the start [SI]; those of `proofmass.sim.start.start_state`, if not given.

    Raises
    ------
    BadModel
        A loop is open in the start pose, or the run names an element that there is not.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        run: Run,
        timestep: float,
        state: tuple[Array, Array] | None = None,
    ) -> None:
        self.model, self.run = model, run
        self.asked_step, self.samples = timestep, run.x.size
        self.qpos, self.qvel = state or self.start()
        state = self.qpos, self.qvel
        super().__init__(model, run.start, driven_joints(model, run), run.rods, state)
        self.count, self.step = self.steps()
        if run.loads:
            self.controls = np.tile(self.controls, (1, self.path.size))
            places = control_indices(model, (one.actuator for one in run.loads))
            self.controls[places] = run.controls(self.path)[0]

    def start(self) -> tuple[Array, Array]:
        """Pose and rates of the start [SI]."""
        return start_state(self.model, self.run)

    def steps(self) -> tuple[int, float]:
        """The number of steps from sample to sample, and their length [s]."""
        return self.run.steps(self.asked_step)

    @cached_property
    def half_steps(self) -> Array:
        """Times of the beginning and the middle of each step, with one step more than there are."""
        steps = self.count * (self.samples - 1) + 1
        return np.asarray(self.run.x[0] + 0.5 * self.step * np.arange(2 * steps + 1))

    @cached_property
    def path(self) -> Array:
        """The x of the run at the half steps."""
        return np.minimum(self.half_steps, self.run.x[-1])

    def joints(self, forces: bool = True) -> Iterator[NeutralJoint]:
        """See `ModelReader.joints`; the drives are ideal, and no damper acts on them."""
        for j, one in enumerate(super().joints(forces)):
            yield replace(one, damping=0.0) if j in self.driven else one

    def drives(self) -> Iterator[DriveRows]:
        """The motion of each drive at all half steps; it goes on evenly behind the last sample."""
        value, rate, acceleration = self.run.motion(self.path)
        late = self.half_steps - self.path
        value = value + late * (rate + 0.5 * late * acceleration)
        rate = rate + late * acceleration
        for j, *motion in zip(self.driven, value, rate, acceleration, strict=True):
            yield DriveRows(j, *motion)

    def accelerations(self) -> Array:
        """Accelerations of all coordinates at the start (nv,) [SI]; see `accelerations`."""
        own = SmoothTerms(self.model, self.run.start)
        terms = own.terms(self.qpos, self.qvel, self.controls[:, 0])
        drives = np.eye(self.model.nv)[self.model.jnt_dofadr[list(self.driven)]]
        wanted = self.run.motion(self.run.x[:1])[2][:, 0]
        rows = np.vstack([terms.jacobian, drives])
        needed = np.concatenate([terms.drift, wanted])
        parts = terms.mass, terms.force - terms.bias, rows, needed
        if not self.frictions.any():
            return solve_accelerations(*parts)
        sizes = StartOfModel(own, self.qpos).sizes
        return accelerations_with_friction(*parts, self.qvel / sizes, self.frictions)

    @cached_property
    def frictions(self) -> Array:
        """Largest dry friction of all coordinates (nv,) but those of the drives [N m or N]."""
        found = self.model.dof_frictionloss.copy()
        found[self.model.jnt_dofadr[list(self.driven)]] = 0.0
        return found

    def shift_rates(self, back: float) -> None:
        """Replace the rates of the start by those of a time `back` before it [s]."""
        self.data.qvel[:] = self.qvel = self.qvel - back * self.accelerations()
        mujoco.mj_fwdVelocity(self.model, self.data)

    def mechanism(self, rates_at: float = 0.0, forces: bool = True) -> NeutralMechanism:
        """The mechanism of the run.

        Parameters
        ----------
        rates_at : float
            Time of the rates at the start: 0, or some time before it [s].
        forces : bool
            Whether the mechanism has loads and the forces of actuators; an engine that reads the
            MJCF itself needs none.
        """
        if rates_at:
            self.shift_rates(-rates_at)
        try:
            found = find_plane(self.model, self.data)
            plane = np.stack([found.e1, found.e2, found.normal])
        except Unsupported:
            plane = np.zeros((0, 3))
        shapes, contacts = self.contacts(bool(len(plane))) if forces else ((), ())
        return NeutralMechanism(
            tuple(self.links()),
            tuple(self.joints(forces)),
            tuple(self.loops()),
            tuple(self.gears() if forces else ()),
            tuple(one for one in self.springs() if one.stiffness or one.damping),
            (*self.loads(), *self.rod_loads()) if forces else (),
            tuple(self.drives()),
            self.model.opt.gravity.copy(),
            plane,
            float(self.model.stat.extent),
            self.step,
            self.count,
            self.samples,
            rates_at,
            shapes=shapes,
            contacts=contacts,
        )


def read_model(
    path: Path, run: Run, kind: RunKind, support: Support, contacts: bool = False
) -> mujoco.MjModel:
    """Compile the MJCF file of a run, which an engine must cover.

    Parameters
    ----------
    path : Path
    run : Run
    kind : RunKind
    support : mapping
        What the engine has of the features of a model, such as `support_without` some.
    contacts : bool
        Whether the engine has contacts.

    Raises
    ------
    BadModel
        The model does not compile, or is not assembled in its start pose.
    Unsupported
        It has a feature that the engine or a neutral mechanism has not.
    """
    model = compile_model(path, run.rods)
    driven = driven_joints(model, run)
    if refused := examine(read_compiled(model), support, kind, driven)[0]:
        raise Unsupported(f"{'; '.join(refused)} in {kind.in_words}")
    if may_touch(model) and not contacts:
        raise Unsupported("contacts of geoms that may touch")
    if (opening := loop_opening(model, run.start)) > MAX_KEY_VIOLATION * model.stat.extent:
        hint = radian_hint(model, run.start)
        raise BadModel(
            f"start pose of key {run.start!r} is not assembled: a loop is open by "
            f"{opening:.3g} m{hint}"
        )
    return model


def read_mechanism(
    path: Path,
    run: Run,
    support: Support = SUPPORT,
    timestep: float | None = None,
    contacts: bool = False,
) -> NeutralReader:
    """Read the model of an MJCF file for a run in time, in the state of its start.

    `timestep` is the longest time step [s], or None for that of the model; the other parameters
    are those of `read_model`.

    Raises
    ------
    BadModel, Unsupported
        See `read_model`; or the run is not in time.
    """
    if run.kind != "dynamics":
        raise Unsupported(f"{run.kind}: the engine is stepped in time only")
    kind = RunKind.DRIVEN_MOTION if run.drives else RunKind.FREE_MOTION
    model = read_model(path, run, kind, support, contacts)
    return NeutralReader(model, run, timestep or float(model.opt.timestep))
