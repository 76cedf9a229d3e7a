"""Any spatial mechanism: the reference of an MJCF with bodies that move in space.

    sidecar:  reference = "spatial"

The quantities are the model's own sensors, by their channel names.  The numbers are read from the
compiled model.  The comparison therefore tests the *engine* and not the model: a wrong length in
the MJCF is wrong in both.
"""

import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.controls import (
    UNDRIVEN,
    ControlsInTime,
    Law,
    Prescribed,
    controls_at_samples,
)
from proofmass.analytic.equilibrium import Resting
from proofmass.analytic.numerics import Array, NotCovered, unwrapped_quaternion
from proofmass.analytic.planar.mechanism import joined, rotation
from proofmass.analytic.spatial.equilibrium import TreeAtRest
from proofmass.analytic.spatial.kinematics import TreeMotion, move_tree
from proofmass.analytic.spatial.mechanism import NO_TURN, Tree, product, read_tree
from proofmass.analytic.spatial.motion import (
    HeldMotion,
    count_dof,
    driven_motion,
    held_motion,
)
from proofmass.analytic.spatial.reactions import PoseStates, Reactions
from proofmass.analytic.spatial.terms import (
    NAMES,
    OwnTerms,
    TermSource,
    actuated,
    actuator_forces,
    lengthened,
    over_slack,
    stretched,
)
from proofmass.analytic.spatial.witness import Witnessed, bear_witness
from proofmass.analytic.stops import Stop, StoppedMotion, read_stops

__all__ = ["properties", "solve"]

S, OBJ = mujoco.mjtSensor, mujoco.mjtObj
PARTS = {3: "xyz", 4: "wxyz"}
"""Names of the components of vectors and of quaternions, by their number."""
IN_TIME, DRIVEN, AT_REST = "in time", "driven", "at rest"
HOW = {
    IN_TIME: "integrated with DOP853 at 3e-14",
    DRIVEN: "at the drives' values",
    AT_REST: "at equilibria for the drives' values",
}
"""Descriptions of how the equations are solved, by the way of motion."""
ACTUATORS = {S.mjSENS_ACTUATORFRC, S.mjSENS_JOINTACTFRC, S.mjSENS_TENDONACTFRC}
"""Sensors of the forces of actuators."""


@dataclass(frozen=True)
class Followed:
    """A solved motion with that of its bodies, the check of its terms, and changing controls."""

    way: str
    held: HeldMotion
    motion: TreeMotion
    witnessed: Witnessed
    ctrl: Array | None


def solve(
    value: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    model: Any,
    start: str = "start",
    joints: tuple[str, ...] = (),
    inertia: bool = False,
    terms: TermSource | None = None,
    controls: Mapping[str, ArrayLike] | None = None,
    control_rates: Mapping[str, ArrayLike] | None = None,
    in_time: tuple[Array, Sequence[Law]] | None = None,
    control_laws: Mapping[str, Law] | None = None,
) -> dict[str, Array]:
    r"""Motion of any tree of hinges, slides, balls and free joints with exact equalities.

    ::

            o---o          M(q) v̇ + h(q, v) = Q(q, v) + Jᵀ λ
           /     \\         φ(q) = 0,   J v̇ = γ(q, v)
          o       o
        --+-------+--      φ: connect, weld, joint, tendon

    Springs and dampers of joints and tendons may be polynomials, tendons fixed or straight from
    site to site, and actuators affine, with the control of the key or one that follows a profile.
    The motion is integrated by DOP853 with a projection of pose and rates after every step
    (`proofmass.analytic.spatial.motion`), begun anew where a profile has a break.  The terms come
    from `terms`, and at 50 poses of the motion those of this package must agree with them to 1e-12
    (`proofmass.analytic.spatial.witness`).  Driven joints have given values.  Degrees of freedom
    that the drives do not determine move freely from the start pose if the drives move in time.
    Otherwise springs, weights and loads bring them to rest, in the stable equilibrium that the
    mechanism reaches from the start pose (`proofmass.analytic.equilibrium`).

    Parameters
    ----------
    value, rate, acceleration : array_like (n,) or (drives, n)
        Of the driven joints [rad or m, per s, per s^2].  Without driven joints `value` has rising
        times [s].
    model : mujoco.MjModel
        The compiled MJCF; its sensors are the quantities.
    start : str
        Key with the start pose, the rates there, and the controls.
    joints : tuple of str
        The driven joints.
    inertia : bool
        Whether moments of drives are those of the motion, and not those at rest.
    terms : TermSource, optional
        Source of the terms of the equations of motion, by default this package.
    controls : mapping of str to array_like (n,)
        Controls of actuators at the samples [1]; controls that are left out are those of the key.
    control_rates : mapping of str to array_like (n,)
        Rates of these controls [1/s]; zero where they are left out.
    in_time : tuple of ndarray (n,) and sequence of callable, optional
        Times [s] of the samples, and the motion profile of each drive: values, rates and
        accelerations as functions of time.  Needed where the drives leave degrees of freedom, whose
        motion depends on the whole way and not on the samples alone.
    control_laws : mapping of str to callable, optional
        For actuators whose controls change in time: values, rates and accelerations as functions of
        time.  Used where degrees of freedom move freely.

    Returns
    -------
    dict of str to ndarray (n,) [SI]
        Curves by channel name, as in a sidecar: ``top.x``, ``turn.w``, ``spin.z``, ...; quaternions
        begin with their largest part positive and do not jump.  A path of equilibria has rates but
        no accelerations: these are NaN.

    Raises
    ------
    NotCovered
        The model has an element that is not covered; the message has its name in the MJCF.
    CannotAssemble, SingularHere
        The equalities are open at the start pose; or they lose rank on the way, the message says
        where.
    Unstable
        A path of equilibria ends on the way, where the mechanism would fall to another equilibrium.
    TermsDiffer
        Two formulations of the equations of motion disagree.

    Notes
    -----
    Domain: regular motions, whose equalities have the same rank throughout.
    Accuracy: the tolerance of a step is 3e-14; the error grows with the motion's own sensitivity,
    to 1e-10 after 20 s of a body that flips over four times; equilibria 1e-13, their rates 1e-11.

    Examples
    --------
    >>> import mujoco
    >>> model = mujoco.MjModel.from_xml_path("models/spatial/euler_top.xml")
    >>> motion = solve([0.0, 1.0], model=model)
    >>> [round(float(motion[name][0]), 8) for name in ("turn.w", "spin.y")]
    [1.0, 5.0]
    """
    tree, source = sources(model, start, terms)
    motion = (value,) if not joints else (value, rate, acceleration)
    changing = Changing(controls, control_rates, control_laws)
    followed = follow(model, tree, source, joints, motion, in_time, changing)
    if followed.way == AT_REST and inertia:
        raise NotCovered("a path of equilibria has no inertia: leave out inertia of the sweep")
    if followed.way == DRIVEN:
        refuse_limits(tree, followed.held.q)
    inertia = inertia or followed.way == IN_TIME
    return quantities(model, tree, followed) | forces(model, tree, followed, joints, inertia)


def properties(
    *,
    model: Any,
    start: str,
    terms: TermSource,
    joints: tuple[str, ...],
    motion: Any,
    in_time: tuple[Array, Sequence[Law]] | None = None,
    controls: Mapping[str, ArrayLike] | None = None,
    control_rates: Mapping[str, ArrayLike] | None = None,
    control_laws: Mapping[str, Law] | None = None,
    **_: float,
) -> dict[str, str]:
    """Describe properties of a motion as a whole, in words for a report.

    `motion` has the times of the run [s], or values, rates and accelerations of its drives; the
    other parameters are those of `solve`.
    """
    tree, source = sources(model, start, terms)
    changing = Changing(controls, control_rates, control_laws)
    given = motion if joints else (motion,)
    followed = follow(model, tree, source, joints, given, in_time, changing)
    seen, held = followed.witnessed, followed.held
    found = {
        "equations of motion": f"terms of {source.name}, {HOW[followed.way]}",
        "second formulation": (
            f"proofmass's own terms agree at {seen.states} poses, to {seen.difference:.1g} of the "
            f"largest (worst: {NAMES[seen.term]})"
        ),
    }
    if tree.rows:
        rows = f"{held.rank} independent of" if followed.way == IN_TIME else "all"
        rows = f"{rows} {tree.rows} rows"
        found["equalities"] = f"closed exactly, {rows}; open by {held.open_by:.1g} in the key"
    if events := held.stopped.events():
        found["stops"] = events
    if not joints and not held.stopped.impacts and (energy := conserved(tree, followed)):
        found["energy"] = energy
    return found


def conserved(tree: Tree, followed: Followed) -> str:
    """Describe how well energy is conserved; empty where actuators or dampers change it."""
    if (
        tree.actuators
        or tree.site_loads
        or tree.damping.any()
        or any(any(tendon.damping) for tendon in tree.tendons)
        or len(followed.held.q) < 2
    ):
        return ""
    own = kinetic(tree, followed), potential(tree, followed)
    swing = max(float(np.ptp(part)) for part in own) or float(np.abs(own[0]).max()) or 1.0
    swing = max(swing, float(own[0].max()))
    return f"kept to {float(np.ptp(own[0] + own[1])) / swing:.1g} of the largest kinetic energy"


def sources(model: Any, start: str, terms: TermSource | None) -> tuple[Tree, TermSource]:
    """The tree of a model, and the source of its terms."""
    tree = _read(model, start)
    return tree, _own(tree) if terms is None else terms


_read = lru_cache(maxsize=32)(read_tree)
_own = lru_cache(maxsize=32)(OwnTerms)


@dataclass(frozen=True)
class Changing:
    """Controls that change, by the names of actuators: at the samples, or as functions of time."""

    controls: Mapping[str, ArrayLike] | None
    rates: Mapping[str, ArrayLike] | None
    laws: Mapping[str, Law] | None


def follow(
    model: Any,
    tree: Tree,
    source: TermSource,
    joints: tuple[str, ...],
    motion: Sequence[ArrayLike],
    in_time: tuple[Array, Sequence[Law]] | None,
    changing: Changing,
) -> Followed:
    """Find the motion by the way that its drives allow; results are cached.

    `motion` has times, or values, rates and accelerations of the drives.
    """
    loose = not joints or leaves_dof(tree, joints)
    if loose and (not joints or in_time is not None):
        times, laws = in_time if joints and in_time else (np.atleast_1d(motion[0]), ())
        times = np.asarray(times, float)
        ctrl_laws = ControlsInTime.of(model, tree.ctrl, changing.laws)
        stops = tuple(stops_of(model, tree))
        try:
            packed = pickle.dumps((times, tuple(laws), ctrl_laws))
        except (AttributeError, TypeError, pickle.PicklingError):  # a function within a function
            return moved_in_time(tree, source, joints, stops, times, laws, ctrl_laws)
        return in_time_once(tree, source, joints, stops, packed)
    values = np.atleast_2d(np.asarray(motion[0], float))
    state = [np.broadcast_to(np.asarray(x, float), values.shape).T for x in motion]
    ctrl = controls_at_samples(model, tree.ctrl, changing.controls)
    if not loose:
        return driven_once(tree, source, joints, pickle.dumps((state, ctrl)))
    rates = controls_at_samples(model, np.zeros(tree.ctrl.size), changing.rates)
    return rests_once(tree, source, joints, pickle.dumps((state, ctrl, rates)))


@lru_cache(maxsize=32)
def leaves_dof(tree: Tree, joints: tuple[str, ...]) -> bool:
    """Whether the tree has more degrees of freedom than driven joints at the start pose."""
    return count_dof(tree, _own(tree)) > len(joints)


def moved_in_time(
    tree: Tree,
    source: TermSource,
    joints: tuple[str, ...],
    stops: tuple[Stop, ...],
    times: Array,
    laws: Sequence[Law],
    changing: ControlsInTime | None,
) -> Followed:
    """Integrate a motion in time, free or with drives that follow motion profiles."""
    drives = UNDRIVEN
    if joints:
        drives = Prescribed.of(*tree.places(joints), laws)
    held = held_motion(tree, source, times, stops, changing, drives)
    ctrl = changing.along(times) if changing else None
    return witnessed(tree, source, IN_TIME, held, times, ctrl)


@lru_cache(maxsize=8)
def in_time_once(
    tree: Tree, source: TermSource, joints: tuple[str, ...], stops: tuple[Stop, ...], packed: bytes
) -> Followed:
    """`moved_in_time` for pickled times, motion profiles and controls, cached by these bytes."""
    return moved_in_time(tree, source, joints, stops, *pickle.loads(packed))


@lru_cache(maxsize=8)
def driven_once(tree: Tree, source: TermSource, joints: tuple[str, ...], packed: bytes) -> Followed:
    """Find a motion that its drives determine; states and controls are pickled, for the cache."""
    state, ctrl = pickle.loads(packed)
    return witnessed(tree, source, DRIVEN, driven_motion(tree, source, joints, *state), None, ctrl)


@lru_cache(maxsize=8)
def rests_once(tree: Tree, source: TermSource, joints: tuple[str, ...], packed: bytes) -> Followed:
    """Follow equilibria over values of the drives; the arguments are pickled, for the cache."""
    (values, rates, _), ctrl, ctrl_rates = pickle.loads(packed)
    at_rest = TreeAtRest(tree, joints)
    resting = Resting(at_rest)
    q, stops = resting.follow(values, ctrl)
    v, pushes = resting.beside(q, stops, values, rates, ctrl, ctrl_rates)
    stopped = StoppedMotion(forces=list(pushes))
    held = HeldMotion(q, v, np.full_like(v, np.nan), at_rest.closed[1], 0, 0, stopped)
    return witnessed(tree, source, AT_REST, held, None, ctrl)


def witnessed(
    tree: Tree,
    source: TermSource,
    way: str,
    held: HeldMotion,
    times: Array | None,
    ctrl: Array | None,
) -> Followed:
    """Check the terms of a motion and move its bodies; without times the samples are counted."""
    at, unit = (np.arange(float(len(held.q))), "sample") if times is None else (times, "t")
    seen = bear_witness(tree, source, at, held.q, held.v, unit, ctrl)
    return Followed(way, held, move_tree(tree, held.q, held.v, held.a), seen, ctrl)


def forces(
    model: Any, tree: Tree, followed: Followed, joints: tuple[str, ...], inertia: bool
) -> dict[str, Array]:
    """Curves of sensors of actuators and drives, and of forces and moments between bodies.

    They are those of the motion with `inertia`, otherwise those at rest.  Forces between bodies are
    left out where the motion does not determine them.
    """
    kinds = {s: S(int(model.sensor_type[s])) for s in range(model.nsensor)}
    sensors = [s for s, kind in kinds.items() if kind in (S.mjSENS_FORCE, S.mjSENS_TORQUE)]
    held, motion = followed.held, followed.motion
    state, still = (held.q, held.v, held.a), np.zeros_like(held.v)
    if not inertia:
        state = (held.q, still, still)
        motion = move_tree(tree, *state)
    found = shown_forces(model, tree, motion, state, followed.ctrl)
    if not sensors and not joints:
        return found
    pushes = np.array(held.stopped.forces or still[:1])
    reactions = Reactions(tree, motion, state, joints, pushes, followed.ctrl)
    found |= shown_moments(model, joints, reactions.drives)
    for s in sensors if reactions.unique else ():
        seat = Seat.of(model, tree, motion, s)
        force, moment = reactions.on(seat.body, seat.at())
        own = seat.inside(force if kinds[s] == S.mjSENS_FORCE else moment)
        found |= {f"{model.sensor(s).name}.{part}": own[:, k] for k, part in enumerate("xyz")}
    return found


def shown_forces(
    model: Any, tree: Tree, motion: TreeMotion, state: PoseStates, ctrl: Array | None
) -> dict[str, Array]:
    """Curves of the sensors of actuators, and of all actuators on a joint or a tendon."""
    kinds = {s: S(int(model.sensor_type[s])) for s in range(model.nsensor)}
    if not ACTUATORS & set(kinds.values()):
        return {}
    (q, v, _), found = state, dict[str, Array]()
    lengths = [lengthened(tree, motion, q, v, tendon) for tendon in tree.tendons]
    controls = tree.ctrl[None] if ctrl is None else ctrl
    own = {one.place: force for one, force in actuator_forces(tree, lengths, q, v, ctrl)}
    for load in tree.site_loads:
        own[load.actuator.place] = load.actuator.force(controls[:, load.actuator.place])
    on_joints = actuated(tree, motion, lengths, q, v, ctrl)
    for s, kind in kinds.items():
        number, value = int(model.sensor_objid[s]), np.zeros(len(q))
        if kind == S.mjSENS_ACTUATORFRC:
            value = value + own.get(int(model.actuator_ctrladr[number]), 0.0)
        elif kind == S.mjSENS_JOINTACTFRC:
            value = on_joints[:, int(model.jnt_dofadr[number])]
        elif kind == S.mjSENS_TENDONACTFRC:
            pulls = (own[one.place] for one in tree.actuators if one.tendon == number)
            value = sum(pulls, value)
        else:
            continue
        found[model.sensor(s).name] = value
    return found


def shown_moments(model: Any, joints: tuple[str, ...], moments: Array) -> dict[str, Array]:
    """Curves of the sensors of driven joints and their actuators, from the drives' moments."""
    found: dict[str, Array] = {}
    for s in range(model.nsensor):
        kind, number = S(int(model.sensor_type[s])), int(model.sensor_objid[s])
        gear = 1.0
        if kind == S.mjSENS_ACTUATORFRC and joined(model, number):
            gear = float(model.actuator_gear[model.actuator_outadr[number], 0])
            number = int(model.actuator_trnid[number, 0])
        elif kind != S.mjSENS_JOINTACTFRC:
            continue
        name = model.joint(number).name
        if name in joints and gear:
            found[model.sensor(s).name] = moments[:, joints.index(name)] / gear
    return found


def stops_of(model: Any, tree: Tree) -> Iterator[Stop]:
    """Read the stops of all joints."""
    for j, joint in enumerate(tree.joints):
        if joint.kind in ("hinge", "slide"):
            size = float(tree.sizes[joint.rate])
            yield from read_stops(model, j, joint.range, joint.pose, joint.rate, size)


def refuse_limits(tree: Tree, q: Array) -> None:
    """Raise ValueError if a joint of a driven motion leaves its range."""
    for joint in tree.joints:
        if joint.kind in ("hinge", "slide"):
            out = (q[:, joint.pose] < joint.range[0]) | (q[:, joint.pose] > joint.range[1])
            if out.any():
                raise ValueError(
                    f"joint {joint.name!r} leaves its range {joint.range} at sample "
                    f"{int(np.argmax(out))}; joint limits are not covered in driven motions"
                )


def quantities(model: Any, tree: Tree, followed: Followed) -> dict[str, Array]:
    """Curves (n,) of all sensors that are covered, by channel name."""
    found: dict[str, Array] = {}
    for s in range(model.nsensor):
        name, kind = model.sensor(s).name, S(int(model.sensor_type[s]))
        value = of_whole(model, tree, followed, kind, s)
        if value is None and kind in FRAMES and int(model.sensor_reftype[s]) == OBJ.mjOBJ_UNKNOWN:
            value = FRAMES[kind](Seat.of(model, tree, followed.motion, s))
        if value is None:
            continue
        if value.ndim == 1:
            found[name] = value
        else:
            parts = PARTS[value.shape[1]]
            found |= {f"{name}.{part}": value[:, k] for k, part in enumerate(parts)}
    return found


def of_whole(
    model: Any, tree: Tree, followed: Followed, kind: mujoco.mjtSensor, s: int
) -> Array | None:
    """Curve of a sensor of a joint, a tendon or the whole model; None for another sensor."""
    held, number = followed.held, int(model.sensor_objid[s])
    if kind == S.mjSENS_E_POTENTIAL:
        return potential(tree, followed)
    if kind == S.mjSENS_E_KINETIC:
        return kinetic(tree, followed)
    if kind in (S.mjSENS_TENDONPOS, S.mjSENS_TENDONVEL):
        length = lengthened(tree, followed.motion, held.q, held.v, tree.tendons[number])
        return length.value if kind == S.mjSENS_TENDONPOS else length.rate
    if int(model.sensor_objtype[s]) != OBJ.mjOBJ_JOINT:
        return None
    joint = tree.joints[number]
    if kind == S.mjSENS_BALLQUAT:
        own = held.q[:, joint.pose : joint.pose + 4]
        return unwrapped_quaternion(own / np.linalg.norm(own, axis=1, keepdims=True))
    if kind == S.mjSENS_BALLANGVEL:
        return held.v[:, joint.rate : joint.rate + 3]
    if kind == S.mjSENS_JOINTPOS:
        return held.q[:, joint.pose]
    if kind == S.mjSENS_JOINTVEL:
        return held.v[:, joint.rate]
    if kind == S.mjSENS_USER and joint.kind in ("hinge", "slide"):
        return held.a[:, joint.rate]
    return None


@dataclass(frozen=True)
class Seat:
    """The frame of a sensor: a point and axes that are fixed to a body."""

    motion: TreeMotion
    body: int
    place: Array
    quaternion: Array
    gravity: Array

    @classmethod
    def of(cls, model: Any, tree: Tree, motion: TreeMotion, s: int) -> "Seat":
        """Read the frame of sensor number s."""
        kind, i = OBJ(int(model.sensor_objtype[s])), int(model.sensor_objid[s])
        body, place, quaternion = {
            OBJ.mjOBJ_SITE: lambda: (model.site_bodyid[i], model.site_pos[i], model.site_quat[i]),
            OBJ.mjOBJ_GEOM: lambda: (model.geom_bodyid[i], model.geom_pos[i], model.geom_quat[i]),
            OBJ.mjOBJ_BODY: lambda: (i, model.body_ipos[i], model.body_iquat[i]),
            OBJ.mjOBJ_XBODY: lambda: (i, np.zeros(3), NO_TURN),
        }[kind]()
        return cls(motion, int(body), np.array(place), np.array(quaternion), tree.gravity)

    def at(self) -> Array:
        """Position of the frame (n, 3) [m]."""
        return self.motion.point(self.body, self.place)

    def velocity(self) -> Array:
        """Velocity of the frame (n, 3) [m/s]."""
        return self.motion.point_velocity(self.body, self.place)

    def acceleration(self) -> Array:
        """Acceleration of the frame (n, 3) [m/s^2]."""
        return self.motion.point_acceleration(self.body, self.place)

    def turn(self) -> Array:
        """Quaternion of the frame's axes (n, 4) [1]."""
        return unwrapped_quaternion(product(self.motion.quaternion[:, self.body], self.quaternion))

    def axis(self, k: int) -> Array:
        """Axis number k in the world (n, 3) [1]."""
        return np.asarray(self.motion.turn[:, self.body] @ rotation(self.quaternion)[:, k])

    def inside(self, vectors: Array) -> Array:
        """Components (n, 3) of vectors of the world in the frame's axes."""
        axes = self.motion.turn[:, self.body] @ rotation(self.quaternion)
        return np.asarray(np.einsum("nji,nj->ni", axes, vectors))


FRAMES: Mapping[mujoco.mjtSensor, Callable[[Seat], Array]] = {
    S.mjSENS_FRAMEPOS: Seat.at,
    S.mjSENS_FRAMELINVEL: Seat.velocity,
    S.mjSENS_FRAMELINACC: Seat.acceleration,
    S.mjSENS_FRAMEANGVEL: lambda seat: seat.motion.spin[:, seat.body],
    S.mjSENS_FRAMEANGACC: lambda seat: seat.motion.spin_rate[:, seat.body],
    S.mjSENS_FRAMEQUAT: Seat.turn,
    S.mjSENS_FRAMEXAXIS: lambda seat: seat.axis(0),
    S.mjSENS_FRAMEYAXIS: lambda seat: seat.axis(1),
    S.mjSENS_FRAMEZAXIS: lambda seat: seat.axis(2),
    S.mjSENS_GYRO: lambda seat: seat.inside(seat.motion.spin[:, seat.body]),
    S.mjSENS_VELOCIMETER: lambda seat: seat.inside(seat.velocity()),
    S.mjSENS_ACCELEROMETER: lambda seat: seat.inside(seat.acceleration() - seat.gravity),
}
"""Curves of the sensors of frames, by kind of sensor."""


def kinetic(tree: Tree, followed: Followed) -> Array:
    """Kinetic energy (n,), including that of armatures [J]."""
    motion, rates = followed.motion, followed.held.v
    found = 0.5 * rates**2 @ tree.armature
    for b, body in enumerate(tree.bodies):
        speed = motion.point_velocity(b, body.centre)
        spin = np.einsum("nji,nj->ni", motion.turn[:, b], motion.spin[:, b])
        found = found + 0.5 * body.mass * (speed**2).sum(axis=1)
        found = found + 0.5 * (spin * (spin @ body.inertia)).sum(axis=1)
    return np.asarray(found)


def potential(tree: Tree, followed: Followed) -> Array:
    """Potential energy (n,) of weights and springs, with the same zero as in MuJoCo [J]."""
    motion, held = followed.motion, followed.held
    found = np.zeros(len(held.q))
    for b, body in enumerate(tree.bodies):
        found = found - body.mass * motion.point(b, body.centre) @ tree.gravity
    for joint in tree.joints:
        if any(joint.stiffness):
            x = stretched(joint.kind, joint.rest, held.q[:, joint.pose :])
            if x.shape[1] == 1:
                found = found + stored(joint.stiffness, x[:, 0])
            else:
                found = found + 0.5 * joint.stiffness[0] * (x**2).sum(axis=1)
    for tendon in tree.tendons:
        length = lengthened(tree, motion, held.q, held.v, tendon).value
        found = found + stored(tendon.stiffness, over_slack(tendon, length))
    return found


def stored(stiffness: tuple[float, ...], x: Array) -> Array:
    """Energy (n,) of a spring of polynomial stiffness at a stretch (n,) [J]."""
    shares = [c / (k + 2) for k, c in enumerate(stiffness)]
    return np.asarray(x**2 * np.polynomial.polynomial.polyval(x, shares))
