"""Read a planar MJCF as links for pymunk, with its channels.

The links are the projection of a neutral mechanism (`proofmass.sim.neutral`) on the plane of
motion.  Elements that pymunk cannot represent raise `Unsupported` with their names.  What a run
covers is found in the plain data of the references (`proofmass.analytic.mjcf`), but no number of a
link is taken from there: the reading of engines is another one on purpose, so that their curves
show a number that the references misread.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter
from pathlib import Path

import mujoco
import numpy as np

from proofmass.analytic.mjcf import read_compiled
from proofmass.analytic.names import radian_hint
from proofmass.analytic.start import MAX_KEY_VIOLATION
from proofmass.analytic.support import RunKind, examine
from proofmass.base.arrays import Array
from proofmass.sim.contents import joint_of
from proofmass.sim.interpreter.mechanism import (
    NeutralGear,
    NeutralJoint,
    NeutralLink,
    NeutralLoad,
    NeutralLoop,
    NeutralSpring,
)
from proofmass.sim.mjcf import compile_model
from proofmass.sim.neutral import ModelReader, driven_joints
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
from proofmass.sim.rods import rod_channels
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
    driven, kind = driven_joints(compiled, run), kind_of(run)
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


def link_inertias(
    links: Sequence[NeutralLink], joints: Sequence[NeutralJoint], plane: MotionPlane
) -> tuple[Array, Array, Array]:
    """Centre, mass and moment of every link in the plane, with the armature of ground hinges.

    Parameters
    ----------
    links : sequence of NeutralLink
        The first one is the ground.
    joints : sequence of NeutralJoint
    plane : MotionPlane

    Returns
    -------
    centre (links, 2) [m], of which the last is the ground, mass (links - 1,) [kg],
    moment (links - 1,) [kg m^2]

    Raises
    ------
    BadModel
        A mass or a moment is not positive or too large; Chipmunk would abort.
    """
    ground, *moving = links
    centre = plane.flat(np.array([one.centre for one in (*moving, ground)]))
    mass = np.array([one.mass for one in moving])
    moment = np.array([plane.normal @ one.inertia @ plane.normal for one in moving])
    pins, counts = dict[int, Array](), Counter(one.child for one in joints)
    for one in joints:
        if one.kind == "hinge" and not one.parent and counts[one.child] == 1:
            moment[one.child - 1] += one.armature
            pins[one.child - 1] = plane.flat(one.anchor)
    for link, own, about in zip(moving, mass, moment, strict=True):
        if not (0 < own < MAX_INERTIA and 0 < about < MAX_INERTIA):
            raise BadModel(
                f"body {link.name!r}: mass {own:g} kg, moment of inertia with armature "
                f"{about:g} kg m2; both must be positive and less than {MAX_INERTIA:g}"
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


JOINT = mujoco.mjtJoint


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


@dataclass(frozen=True)
class LinkProjection:
    """Links in space, of which the ground is the first, as links in a plane, where it is the last.

    Attributes
    ----------
    plane : MotionPlane
    centre : ndarray (links, 2)
        Centres of the links in the plane [m].
    """

    plane: MotionPlane
    centre: Array

    def place(self, link: int, at: Array) -> tuple[int, Array]:
        """The number of a link in the plane, and a point relative to its centre [m]."""
        k = (link - 1) % len(self.centre)
        return k, self.plane.flat(at) - self.centre[k]

    def joint(self, one: NeutralJoint, of_child: Sequence[NeutralJoint]) -> LinkJoint:
        """A hinge or slide, one of the joints of its child.

        The anchors of a slide are chosen so that Chipmunk's groove does not couple sliding with
        rotation.  The coordinates of a free body are those of the anchor of its hinge, which is the
        last of its joints, and the rotation about it.
        """
        at, free = of_child[-1].anchor, len(of_child) > 1
        (a, on_a), (b, on_b) = self.place(one.parent, at), self.place(one.child, at)
        axis, sign = None, 1.0
        if one.kind == "slide":
            axis = self.plane.flat(one.axis)
        else:
            sign = float(np.sign(one.axis @ self.plane.normal))
        if axis is not None and not free:
            near, far = self.centre[a], self.centre[b]
            foot = near + axis * (axis @ (far - near)) if one.parent else far
            on_a, on_b = foot - near, foot - far
        limits = one.limits and (one.limits[0] + STOP_MARGIN, one.limits[1] - STOP_MARGIN)
        k, square, cube = one.spring.tolist()
        return LinkJoint(
            one.name,
            LinkConstraint(one.name, a, b, on_a, on_b, axis),
            one.value,
            sign,
            one.rate,
            (k, square, cube),
            one.rest,
            one.damping,
            float(one.force[0]),
            limits,
            one.friction,
            not free,
            one.servo,
        )

    def loop(self, one: NeutralLoop) -> LinkConstraint:
        """A loop as a pin that closes it."""
        (a, on_a), (b, on_b) = self.place(one.a, one.on_a), self.place(one.b, one.on_b)
        return LinkConstraint(one.name, a, b, on_a, on_b)

    def spring(self, one: NeutralSpring, extent: float) -> LinkSpring:
        """A spring; raises `Unsupported` if its points are not in one parallel plane."""
        if abs((one.on_a - one.on_b) @ self.plane.normal) > PARALLEL_TOLERANCE * extent:
            raise Unsupported(f"tendon '{one.name}', whose sites differ in height over the plane")
        (a, on_a), (b, on_b) = self.place(one.a, one.on_a), self.place(one.b, one.on_b)
        return LinkSpring(**vars(one) | {"a": a, "b": b, "on_a": on_a, "on_b": on_b})

    def load(self, one: NeutralLoad, share: float, model: mujoco.MjModel) -> LinkLoad:
        """A load times `share`; raises `Unsupported` if it leaves the plane."""
        force, moment = share * one.force, share * one.moment
        across = np.append(force @ self.plane.normal, self.plane.flat(moment))
        if np.abs(across).max() > PARALLEL_TOLERANCE * np.abs([force, moment]).max():
            of = f"actuator '{model.actuator(one.actuator).name}'" if one.actuator >= 0 else ""
            of = of or f"body '{model.body(one.body).name}'"
            raise Unsupported(f"the load of {of} leaves the plane of motion")
        link, at = self.place(one.link, one.at)
        flat, about = self.plane.flat(force), float(self.plane.normal @ moment)
        return LinkLoad(one.body, link, at, flat, about, one.follows, one.actuator)


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
    reader = ModelReader(model, key, driven, rods, state)
    plane = find_plane(model, reader.data)
    refuse_gravity(model, plane)
    neutral, gravity = tuple(reader.joints()), plane.flat(model.opt.gravity)
    centre, mass, moment = link_inertias(tuple(reader.links()), neutral, plane)
    project, of_body = LinkProjection(plane, centre), (reader.link_of - 1) % len(centre)
    rows = [tuple(rows) for _, rows in groupby(neutral, attrgetter("child"))]
    joints = tuple(project.joint(one, own) for own in rows for one in own)
    loops = tuple(map(project.loop, reader.loops()))
    extent = _find_extent(joints, loops, centre, model)
    _check_closed(loops, centre, extent, model, key)
    return Links(
        reader,
        plane,
        of_body,
        centre,
        mass,
        moment,
        mass[:, None] * gravity,
        joints,
        driven,
        loops,
        tuple(flat_gear(one, joints) for one in reader.gears()),
        tuple(project.spring(one, extent) for one in reader.springs()),
        tuple(
            project.load(one, float(one.share[0]), model)
            for one in (*reader.loads(), *reader.rod_loads())
        ),
        gravity,
        extent,
        read_contacts(model, reader.data, plane, of_body, centre, extent),
    )


def with_controls(links: Links, loads: Sequence[str], controls: Array) -> Links:
    """The links with other controls of the actuators `loads`."""
    reader = links.reader.with_controls(loads, controls)
    project = LinkProjection(links.plane, links.centre)
    pulls = (project.load(one, float(one.share[0]), links.model) for one in reader.loads())
    joints = tuple(
        joint
        if j in links.driven
        else replace(joint, load=float(reader.actuation(j, joint.rest)[2][0]))
        for j, joint in enumerate(links.joints)
    )
    dead = (pull for pull in links.pulls if pull.actuator < 0)
    return replace(links, reader=reader, joints=joints, pulls=(*pulls, *dead))


STILL_RATIO = 1e-12
"""Ratio of a gear below which it is rounding of 0: Chipmunk divides by the ratio."""


def flat_gear(gear: NeutralGear, joints: Sequence[LinkJoint]) -> LinkGear:
    """A gear of two joints as one of their links.

    With the turns A and B of both joints' links since the start, an equality of two joints on the
    ground is A = r B - phase.  A planet on an arm B turns by A - B relative to it, so that
    A = (1 + r) B - phase; with r = -1 it keeps its direction, and is geared to the ground.
    """
    one, two = joints[gear.one], joints[gear.two]
    lacks = one.value - gear.level - gear.ratio * two.value
    ratio, phase = gear.ratio * one.sign * two.sign, float(one.sign * lacks)
    (ground, a), (other, b) = ((one.constraint.a, one.constraint.b) for one in (one, two))
    if ground == b:  # `one` is the planet's joint
        ground, ratio = other, 1.0 + ratio
    elif other == a:  # `two` is: (1 + r) A = r B - phase
        a, b = b, a
        ratio, phase = (1.0 + ratio) / ratio, -phase / ratio
    if abs(ratio) < STILL_RATIO:
        b, ratio = ground, 1.0
    return LinkGear(gear.name, a, b, ratio, phase)


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
