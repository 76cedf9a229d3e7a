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

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.controls import (
    NO_PRESCRIBED_JOINTS,
    ControlsInTime,
    MotionProfile,
    Prescribed,
    controls_at_samples,
)
from proofmass.analytic.equilibrium import EquilibriumSolver
from proofmass.analytic.mjcf import SensorData, SensorFrame, SensorKind
from proofmass.analytic.motion_events import MotionWithEvents
from proofmass.analytic.numerics import (
    NotCovered,
    motion_senses,
    rotation_matrix,
    unwrap_quaternions,
)
from proofmass.analytic.protocol import Ask, InputMotion, Reference
from proofmass.analytic.spatial.encounters import refuse_encounters
from proofmass.analytic.spatial.equilibrium import TreeAtRest
from proofmass.analytic.spatial.kinematics import TreeMotion, move_tree
from proofmass.analytic.spatial.mechanism import (
    Tree,
    quaternion_product,
    read_tree,
)
from proofmass.analytic.spatial.motion import (
    ConstrainedMotion,
    count_dof,
    driven_motion,
    integrate_motion,
)
from proofmass.analytic.spatial.reactions import PoseStates, Reactions
from proofmass.analytic.spatial.support import SUPPORT
from proofmass.analytic.spatial.terms import (
    OwnTerms,
    actuator_forces,
    actuators_on_joints,
    joint_spring_stretch,
    tendon_length,
    tendon_stretch,
)
from proofmass.analytic.spatial.witness import TermComparison, compare_terms
from proofmass.analytic.stops import Stop, refuse_limit, stops_of_joint
from proofmass.analytic.support import refuse, run_kind
from proofmass.analytic.term_source import TERM_NAMES, TermSource
from proofmass.base.arrays import Array
from proofmass.base.read_once import read_once

__all__ = ["properties", "solve"]

COMPONENT_NAMES = {3: "xyz", 4: "wxyz"}
"""Names of the components of vectors and of quaternions, by their number."""
IN_TIME, DRIVEN, AT_REST = "in time", "driven", "at rest"
METHOD_TEXTS = {
    IN_TIME: "integrated with DOP853 at 3e-14",
    DRIVEN: "at the drives' values",
    AT_REST: "at equilibria for the drives' values",
}
"""Descriptions of how the equations are solved, by the way of motion."""
ACTUATOR_SENSORS = {
    SensorKind.ACTUATORFRC,
    SensorKind.JOINTACTFRC,
    SensorKind.TENDONACTFRC,
}
"""Sensors of the forces of actuators."""


@dataclass(frozen=True)
class SolvedMotion:
    """A solved motion with that of its bodies, the check of its terms, and changing controls."""

    way: str
    held: ConstrainedMotion
    motion: TreeMotion
    comparison: TermComparison
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
    in_time: tuple[Array, Sequence[MotionProfile]] | None = None,
    control_profiles: Mapping[str, MotionProfile] | None = None,
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
    mechanism reaches from the start pose (`proofmass.analytic.equilibrium`).  Joints with dry
    friction stick and slip in time (`proofmass.analytic.motion_events`); that of joints that drives
    prescribe loads the drives.

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
    control_profiles : mapping of str to callable, optional
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
    tree, source = tree_and_terms(model, start, terms)
    motion = (value,) if not joints else (value, rate, acceleration)
    changing = ChangingControls(controls, control_rates, control_profiles)
    has_dof = not joints or has_free_dof(tree, joints)
    refuse(tree.data, SUPPORT, run_kind(joints, has_dof, inertia, in_time is not None), joints)
    followed = find_motion(tree, source, joints, motion, in_time, changing)
    if followed.way == AT_REST and inertia:
        raise NotCovered("a path of equilibria has no inertia: leave out inertia of the sweep")
    if followed.way == DRIVEN:
        refuse_limits(tree, followed.held.q)
    inertia = inertia or followed.way == IN_TIME
    return quantities(tree, followed) | force_curves(tree, followed, joints, inertia)


def properties(
    *,
    model: Any,
    start: str,
    terms: TermSource,
    joints: tuple[str, ...],
    motion: Any,
    in_time: tuple[Array, Sequence[MotionProfile]] | None = None,
    controls: Mapping[str, ArrayLike] | None = None,
    control_rates: Mapping[str, ArrayLike] | None = None,
    control_profiles: Mapping[str, MotionProfile] | None = None,
    **_: float,
) -> dict[str, str]:
    """Describe properties of a motion as a whole, in words for a report.

    `motion` has the times of the run [s], or values, rates and accelerations of its drives; the
    other parameters are those of `solve`.
    """
    tree, source = tree_and_terms(model, start, terms)
    changing = ChangingControls(controls, control_rates, control_profiles)
    given = motion if joints else (motion,)
    followed = find_motion(tree, source, joints, given, in_time, changing)
    comparison, held = followed.comparison, followed.held
    found = {
        "equations of motion": f"terms of {source.name}, {METHOD_TEXTS[followed.way]}",
        "second formulation": (
            f"proofmass's own terms agree at {comparison.states} poses, to "
            f"{comparison.difference:.1g} of the largest (worst: {TERM_NAMES[comparison.term]})"
        ),
    }
    if tree.rows:
        rows = f"{held.rank} independent of" if followed.way == IN_TIME else "all"
        rows = f"{rows} {tree.rows} rows"
        found["equalities"] = (
            f"closed exactly, {rows}; open by {held.start_violation:.1g} in the key"
        )
    if events := held.followed.events():
        found["stops"] = events
    if events := held.followed.friction_events():
        found["friction"] = events
    if (
        not joints
        and not held.followed.impacts
        and (energy := describe_conservation(tree, followed))
    ):
        found["energy"] = energy
    return found


def describe_conservation(tree: Tree, followed: SolvedMotion) -> str:
    """Describe how well energy is conserved; empty where actuators or dampers change it.

    The work of dry friction counts as energy that is left.
    """
    if (
        tree.actuators
        or tree.site_loads
        or tree.reliefs.any()
        or tree.damping.any()
        or any(any(tendon.damping) for tendon in tree.tendons)
        or len(followed.held.q) < 2
    ):
        return ""
    own = kinetic_energy(tree, followed), potential_energy(tree, followed)
    swing = max(float(np.ptp(part)) for part in own) or float(np.abs(own[0]).max()) or 1.0
    swing = max(swing, float(own[0].max()))
    work = np.array(followed.held.followed.friction_work)
    lost = ", with the work of friction" if work.any() else ""
    share = float(np.ptp(own[0] + own[1] - work)) / swing
    return f"kept to {share:.1g} of the largest kinetic energy{lost}"


def tree_and_terms(model: Any, start: str, terms: TermSource | None) -> tuple[Tree, TermSource]:
    """The tree of a model, and the source of its terms."""
    tree = _read_cached(model, start)
    return tree, _own_terms_cached(tree) if terms is None else terms


_read_cached = read_once(None)(read_tree)
_own_terms_cached = lru_cache(maxsize=32)(OwnTerms)


@dataclass(frozen=True)
class ChangingControls:
    """Controls that change, by the names of actuators: at the samples, or as functions of time."""

    controls: Mapping[str, ArrayLike] | None
    rates: Mapping[str, ArrayLike] | None
    profiles: Mapping[str, MotionProfile] | None


def find_motion(
    tree: Tree,
    source: TermSource,
    joints: tuple[str, ...],
    motion: Sequence[ArrayLike],
    in_time: tuple[Array, Sequence[MotionProfile]] | None,
    changing: ChangingControls,
) -> SolvedMotion:
    """Find the motion by the way that its drives allow; results are cached.

    `motion` has times, or values, rates and accelerations of the drives.
    """
    has_dof = not joints or has_free_dof(tree, joints)
    if has_dof and (not joints or in_time is not None):
        times, profiles = in_time if joints and in_time else (np.atleast_1d(motion[0]), ())
        times = np.asarray(times, float)
        control_profiles_by_place = ControlsInTime.of(tree.data, tree.ctrl, changing.profiles)
        stops = tuple(stops_of_tree(tree))
        # profiles have no hash: the cache compares their bytes
        try:
            packed = pickle.dumps((times, tuple(profiles), control_profiles_by_place))
        except (AttributeError, TypeError, pickle.PicklingError):  # a function within a function
            return integrate_in_time(
                tree, source, joints, stops, times, profiles, control_profiles_by_place
            )
        return integrate_in_time_cached(tree, source, joints, stops, packed)
    values = np.atleast_2d(np.asarray(motion[0], float))
    state = [np.broadcast_to(np.asarray(x, float), values.shape).T for x in motion]
    ctrl = controls_at_samples(tree.data, tree.ctrl, changing.controls)
    if not has_dof:
        return find_driven_cached(tree, source, joints, pickle.dumps((state, ctrl)))
    rates = controls_at_samples(tree.data, np.zeros(tree.ctrl.size), changing.rates)
    return follow_equilibria_cached(tree, source, joints, pickle.dumps((state, ctrl, rates)))


@lru_cache(maxsize=32)
def has_free_dof(tree: Tree, joints: tuple[str, ...]) -> bool:
    """Whether the tree has more degrees of freedom than driven joints at the start pose."""
    return count_dof(tree, _own_terms_cached(tree)) > len(joints)


def integrate_in_time(
    tree: Tree,
    source: TermSource,
    joints: tuple[str, ...],
    stops: tuple[Stop, ...],
    times: Array,
    profiles: Sequence[MotionProfile],
    changing: ControlsInTime | None,
) -> SolvedMotion:
    """Integrate a motion in time, free or with drives that follow motion profiles."""
    drives = NO_PRESCRIBED_JOINTS
    if joints:
        drives = Prescribed.of(*tree.places(joints), profiles)
    held = integrate_motion(tree, source, times, stops, changing, drives)
    ctrl = changing.along(times) if changing else None
    return compare_and_move(tree, source, IN_TIME, held, times, ctrl)


@lru_cache(maxsize=8)
def integrate_in_time_cached(
    tree: Tree, source: TermSource, joints: tuple[str, ...], stops: tuple[Stop, ...], packed: bytes
) -> SolvedMotion:
    """`integrate_in_time` for pickled times, profiles and controls, cached by these bytes."""
    return integrate_in_time(tree, source, joints, stops, *pickle.loads(packed))


@lru_cache(maxsize=8)
def find_driven_cached(
    tree: Tree, source: TermSource, joints: tuple[str, ...], packed: bytes
) -> SolvedMotion:
    """Find a motion that its drives determine; states and controls are pickled, for the cache."""
    state, ctrl = pickle.loads(packed)
    return compare_and_move(
        tree, source, DRIVEN, driven_motion(tree, source, joints, *state), None, ctrl
    )


@lru_cache(maxsize=8)
def follow_equilibria_cached(
    tree: Tree, source: TermSource, joints: tuple[str, ...], packed: bytes
) -> SolvedMotion:
    """Follow equilibria over values of the drives; the arguments are pickled, for the cache."""
    (values, rates, _), ctrl, ctrl_rates = pickle.loads(packed)
    at_rest = TreeAtRest(tree, joints)
    resting = EquilibriumSolver(at_rest)
    q, stops = resting.follow(values, ctrl)
    v, pushes = resting.beside(q, stops, values, rates, ctrl, ctrl_rates)
    events = MotionWithEvents(forces=list(pushes))
    held = ConstrainedMotion(q, v, np.full_like(v, np.nan), at_rest.closed[1], 0, 0, events)
    return compare_and_move(tree, source, AT_REST, held, None, ctrl)


def compare_and_move(
    tree: Tree,
    source: TermSource,
    way: str,
    held: ConstrainedMotion,
    times: Array | None,
    ctrl: Array | None,
) -> SolvedMotion:
    """Check the terms of a motion and move its bodies; without times the samples are counted."""
    instants, instant_name = (
        (np.arange(float(len(held.q))), "sample") if times is None else (times, "t")
    )
    comparison = compare_terms(tree, source, instants, held.q, held.v, instant_name, ctrl)
    motion = move_tree(tree, held.q, held.v, held.a)
    refuse_encounters(tree, source, motion, held.q, held.v, times)
    return SolvedMotion(way, held, motion, comparison, ctrl)


def force_curves(
    tree: Tree, followed: SolvedMotion, joints: tuple[str, ...], inertia: bool
) -> dict[str, Array]:
    """Curves of sensors of actuators and drives, and of forces and moments between bodies.

    They are those of the motion with `inertia`, otherwise those at rest.  Forces between bodies are
    left out where the motion does not determine them.
    """
    sensors = [
        one for one in tree.data.sensors if one.kind in (SensorKind.FORCE, SensorKind.TORQUE)
    ]
    held, motion = followed.held, followed.motion
    state, zero_rates = (held.q, held.v, held.a), np.zeros_like(held.v)
    if not inertia:
        state = (held.q, zero_rates, zero_rates)
        motion = move_tree(tree, *state)
    found = actuator_curves(tree, motion, state, followed.ctrl)
    if not sensors and not joints:
        return found
    pushes = np.array(held.followed.forces or zero_rates[:1])
    pushes = pushes + friction_on_drives(tree, followed, joints)
    reactions = Reactions(tree, motion, state, joints, pushes, followed.ctrl)
    found |= drive_curves(tree, joints, reactions.drives)
    for one in sensors if reactions.unique else ():
        seat = MovingFrame.of(tree, motion, one)
        force, moment = reactions.on(seat.body, seat.at())
        own = seat.inside(force if one.kind == SensorKind.FORCE else moment)
        found |= {f"{one.name}.{part}": own[:, k] for k, part in enumerate("xyz")}
    return found


def friction_on_drives(tree: Tree, followed: SolvedMotion, joints: tuple[str, ...]) -> Array:
    """Dry friction (n, rates) of the joints whose motion drives prescribe [N m or N].

    It loads the drives alone.  A joint that is at rest has the friction with which it came to rest.
    """
    rates, driven = followed.held.v, tree.places(joints)[1]
    prescribed = [*driven.tolist(), *followed.held.followed.prescribed]
    is_driven = np.isin(np.arange(rates.shape[1]), prescribed) | (followed.way == DRIVEN)
    fastest = float(np.abs(rates[:, driven]).max(initial=0.0))
    senses = motion_senses(rates.T, fastest).T
    return np.asarray(-np.where(is_driven, tree.frictions, 0.0) * senses)


def actuator_curves(
    tree: Tree, motion: TreeMotion, state: PoseStates, ctrl: Array | None
) -> dict[str, Array]:
    """Curves of the sensors of actuators, and of all actuators on a joint or a tendon."""
    sensors = [one for one in tree.data.sensors if one.kind in ACTUATOR_SENSORS]
    if not sensors:
        return {}
    (q, v, _), found = state, dict[str, Array]()
    lengths = [tendon_length(tree, motion, q, v, tendon) for tendon in tree.tendons]
    controls = tree.ctrl[None] if ctrl is None else ctrl
    by_control = {one.place: force for one, force in actuator_forces(tree, lengths, q, v, ctrl)}
    for load in tree.site_loads:
        by_control[load.actuator.place] = load.actuator.force(controls[:, load.actuator.place])
    on_joints = actuators_on_joints(tree, motion, lengths, q, v, ctrl)
    for sensor in sensors:
        number, value = sensor.number, np.zeros(len(q))
        if sensor.kind == SensorKind.ACTUATORFRC:
            value = value + by_control.get(tree.data.actuators[number].place, 0.0)
        elif sensor.kind == SensorKind.JOINTACTFRC:
            value = on_joints[:, tree.joints[number].rate]
        else:
            pulls = (by_control[one.place] for one in tree.actuators if one.tendon == number)
            value = sum(pulls, value)
        found[sensor.name] = value
    return found


def drive_curves(tree: Tree, joints: tuple[str, ...], moments: Array) -> dict[str, Array]:
    """Curves of the sensors of driven joints and their actuators, from the drives' moments."""
    found: dict[str, Array] = {}
    for sensor in tree.data.sensors:
        number, gear = sensor.number, 1.0
        if sensor.kind == SensorKind.ACTUATORFRC:
            actuator = tree.data.actuators[number]
            number, gear = actuator.joint, actuator.gear
        elif sensor.kind != SensorKind.JOINTACTFRC:
            continue
        name = tree.joints[number].name if number >= 0 else ""
        if name in joints and gear:
            found[sensor.name] = moments[:, joints.index(name)] / gear
    return found


def stops_of_tree(tree: Tree) -> Iterator[Stop]:
    """The stops of all joints."""
    for joint in tree.joints:
        if joint.is_scalar:
            yield from stops_of_joint(joint, float(tree.sizes[joint.rate]))


def refuse_limits(tree: Tree, q: Array) -> None:
    """Raise ValueError if a joint of a driven motion leaves its range."""
    for joint in tree.joints:
        if joint.is_scalar:
            refuse_limit(joint.name, joint.stop_range, q[:, joint.pose])


def quantities(tree: Tree, followed: SolvedMotion) -> dict[str, Array]:
    """Curves (n,) of all sensors that are covered, by channel name."""
    found: dict[str, Array] = {}
    for sensor in tree.data.sensors:
        value = joint_or_model_curve(tree, followed, sensor)
        if value is None and sensor.kind in FRAME_CURVES and not sensor.is_relative:
            seat = MovingFrame.of(tree, followed.motion, sensor)
            value = FRAME_CURVES[sensor.kind](seat)
        if value is None:
            continue
        if value.ndim == 1:
            found[sensor.name] = value
        else:
            parts = COMPONENT_NAMES[value.shape[1]]
            found |= {f"{sensor.name}.{part}": value[:, k] for k, part in enumerate(parts)}
    return found


def joint_or_model_curve(tree: Tree, followed: SolvedMotion, sensor: SensorData) -> Array | None:
    """Curve of a sensor of a joint, a tendon or the whole model; None for another sensor."""
    held, kind = followed.held, sensor.kind
    if kind == SensorKind.E_POTENTIAL:
        return potential_energy(tree, followed)
    if kind == SensorKind.E_KINETIC:
        return kinetic_energy(tree, followed)
    if kind in (SensorKind.TENDONPOS, SensorKind.TENDONVEL):
        length = tendon_length(tree, followed.motion, held.q, held.v, tree.tendons[sensor.number])
        return length.value if kind == SensorKind.TENDONPOS else length.rate
    if not sensor.on_joint:
        return None
    joint = tree.joints[sensor.number]
    if kind == SensorKind.BALLQUAT:
        own = held.q[:, joint.pose : joint.pose + 4]
        return unwrap_quaternions(own / np.linalg.norm(own, axis=1, keepdims=True))
    if kind == SensorKind.BALLANGVEL:
        return held.v[:, joint.rate : joint.rate + 3]
    if kind == SensorKind.JOINTPOS:
        return held.q[:, joint.pose]
    if kind == SensorKind.JOINTVEL:
        return held.v[:, joint.rate]
    if kind == SensorKind.USER and joint.is_scalar:
        return held.a[:, joint.rate]
    return None


@dataclass(frozen=True)
class MovingFrame:
    """The frame of a sensor in a motion: a point and axes that are fixed to a body."""

    motion: TreeMotion
    own: SensorFrame
    gravity: Array

    @classmethod
    def of(cls, tree: Tree, motion: TreeMotion, sensor: SensorData) -> "MovingFrame":
        """The frame of a sensor.

        Raises
        ------
        NotCovered
            It moves relative to its body.
        """
        return cls(motion, sensor.frame, tree.gravity)

    @property
    def body(self) -> int:
        """The body that carries it."""
        return self.own.body

    def at(self) -> Array:
        """Position of the frame (n, 3) [m]."""
        return self.motion.point(self.body, self.own.place)

    def velocity(self) -> Array:
        """Velocity of the frame (n, 3) [m/s]."""
        return self.motion.point_velocity(self.body, self.own.place)

    def acceleration(self) -> Array:
        """Acceleration of the frame (n, 3) [m/s^2]."""
        return self.motion.point_acceleration(self.body, self.own.place)

    def turn(self) -> Array:
        """Quaternion of the frame's axes (n, 4) [1]."""
        return unwrap_quaternions(
            quaternion_product(self.motion.quaternion[:, self.body], self.own.turn)
        )

    def axis(self, k: int) -> Array:
        """Axis number k in the world (n, 3) [1]."""
        return np.asarray(self.motion.turn[:, self.body] @ rotation_matrix(self.own.turn)[:, k])

    def inside(self, vectors: Array) -> Array:
        """Components (n, 3) of vectors of the world in the frame's axes."""
        axes = self.motion.turn[:, self.body] @ rotation_matrix(self.own.turn)
        return np.asarray(np.einsum("nji,nj->ni", axes, vectors))


FRAME_CURVES: Mapping[SensorKind, Callable[[MovingFrame], Array]] = {
    SensorKind.FRAMEPOS: MovingFrame.at,
    SensorKind.FRAMELINVEL: MovingFrame.velocity,
    SensorKind.FRAMELINACC: MovingFrame.acceleration,
    SensorKind.FRAMEANGVEL: lambda seat: seat.motion.spin[:, seat.body],
    SensorKind.FRAMEANGACC: lambda seat: seat.motion.spin_rate[:, seat.body],
    SensorKind.FRAMEQUAT: MovingFrame.turn,
    SensorKind.FRAMEXAXIS: lambda seat: seat.axis(0),
    SensorKind.FRAMEYAXIS: lambda seat: seat.axis(1),
    SensorKind.FRAMEZAXIS: lambda seat: seat.axis(2),
    SensorKind.GYRO: lambda seat: seat.inside(seat.motion.spin[:, seat.body]),
    SensorKind.VELOCIMETER: lambda seat: seat.inside(seat.velocity()),
    SensorKind.ACCELEROMETER: lambda seat: seat.inside(seat.acceleration() - seat.gravity),
}
"""Curves of the sensors of frames, by kind of sensor."""


def kinetic_energy(tree: Tree, followed: SolvedMotion) -> Array:
    """Kinetic energy (n,), including that of armatures [J]."""
    motion, rates = followed.motion, followed.held.v
    found = 0.5 * rates**2 @ tree.armature
    for b, body in enumerate(tree.bodies):
        speed = motion.point_velocity(b, body.centre)
        spin = np.einsum("nji,nj->ni", motion.turn[:, b], motion.spin[:, b])
        found = found + 0.5 * body.mass * (speed**2).sum(axis=1)
        found = found + 0.5 * (spin * (spin @ body.inertia)).sum(axis=1)
    return np.asarray(found)


def potential_energy(tree: Tree, followed: SolvedMotion) -> Array:
    """Potential energy (n,) of weights and springs, with the same zero as in MuJoCo [J]."""
    motion, held = followed.motion, followed.held
    found = np.zeros(len(held.q))
    for b, body in enumerate(tree.bodies):
        found = found - body.mass * motion.point(b, body.centre) @ tree.gravity
    for joint in tree.joints:
        if any(joint.stiffness):
            x = joint_spring_stretch(joint, held.q[:, joint.pose :])
            if x.shape[1] == 1:
                found = found + spring_energy(joint.stiffness, x[:, 0])
            else:
                found = found + 0.5 * joint.stiffness[0] * (x**2).sum(axis=1)
    for tendon in tree.tendons:
        length = tendon_length(tree, motion, held.q, held.v, tendon).value
        found = found + spring_energy(tendon.stiffness, tendon_stretch(tendon, length))
    return found


def spring_energy(stiffness: tuple[float, ...], x: Array) -> Array:
    """Energy (n,) of a spring of polynomial stiffness at a stretch (n,) [J]."""
    shares = [c / (k + 2) for k, c in enumerate(stiffness)]
    return np.asarray(x**2 * np.polynomial.polynomial.polyval(x, shares))


class Spatial(Reference):
    """Any spatial mechanism: the reference of an MJCF with bodies that move in space."""

    method = "general solver of mechanisms in space"
    reads_model = True
    covers_inertia = True
    follows_controls = True
    in_space = True

    def solve(self, motion: InputMotion, ask: Ask) -> dict[str, Array]:
        """Curves of all sensors of the model, see the function `solve` of this module."""
        run = ask.of_model
        return solve(*motion.arguments, inertia=ask.inertia, terms=run.terms(), **run.arguments)

    @classmethod
    def leaves_dof(cls, model: Any, start: str, joints: tuple[str, ...]) -> bool:
        """Whether the drives leave degrees of freedom, which a sweep has in equilibrium."""
        tree, _ = tree_and_terms(model, start, None)
        return has_free_dof(tree, joints)

    def properties(self, motion: InputMotion, ask: Ask) -> dict[str, str]:
        """The equations of motion, how well they are confirmed, and events at stops, in words."""
        run = ask.of_model
        drives = motion.x if motion.drives is None else np.stack(motion.drives)
        return properties(motion=drives, terms=run.terms(), **run.arguments)
