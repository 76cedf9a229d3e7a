"""The general planar linkage: the reference of any planar MJCF that has no closed form.

    sidecar:  reference = "planar"

The quantities are the model's own sensors, by their channel names.  The geometry is read from the
compiled model and moved by this package's own kinematics.  The comparison therefore tests the
*engine* and not the model: a wrong length in the MJCF is wrong in both.
"""

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.controls import (
    NO_PRESCRIBED_JOINTS,
    ControlsInTime,
    MotionProfile,
    Prescribed,
    controls_at_samples,
    controls_by_place,
)
from proofmass.analytic.equilibrium import ActiveStops, EquilibriumSolver
from proofmass.analytic.mjcf import ActuatorData, ModelData, SensorData, SensorKind, TendonWay
from proofmass.analytic.motion_events import MotionWithEvents
from proofmass.analytic.numerics import (
    CannotAssemble,
    CannotMove,
    NotCovered,
    SingularHere,
    check_finite,
    motion_senses,
)
from proofmass.analytic.planar.branch import STEP_SHARE, Branch, Knots
from proofmass.analytic.planar.dynamics import free_motion
from proofmass.analytic.planar.forces import (
    Forces,
    applied_forces,
    centre_jacobians,
    kinetic_energy,
    loads_on_joints,
    motor_forces,
    potential_energy,
    solve_forces,
    spring_length,
    transmitted_force,
)
from proofmass.analytic.planar.kinematics import (
    BodyMotion,
    Drives,
    condition_numbers,
    count_dof,
    joint_rates,
    linearise_loops,
    move_bodies,
    nearest_pose,
)
from proofmass.analytic.planar.mechanism import (
    Mechanism,
    Mirrored,
    Overconstrained,
    Projection,
    read,
)
from proofmass.analytic.planar.support import SUPPORT
from proofmass.analytic.protocol import Ask, InputMotion, Reference
from proofmass.analytic.stops import Stop, make_stops, refuse_limit
from proofmass.analytic.support import refuse, refuse_contacts, run_kind
from proofmass.base.arrays import Array, Complex, Index
from proofmass.base.read_once import read_once

__all__ = [
    "Branch",
    "CannotAssemble",
    "CannotMove",
    "Mechanism",
    "Mirrored",
    "Overconstrained",
    "SingularHere",
    "properties",
    "read",
    "solve",
]

KNOT_SPACING, KNOT_OFFSET = 0.1, 0.382
"""Knots begin and end at (k + `KNOT_OFFSET`) `KNOT_SPACING` with an integer k [rad, or sizes].
Two motions that begin at the same round number, but for a small difference, then have the same
first knot; likewise at their ends."""
POSITION_SENSORS = {
    SensorKind.FRAMEPOS: 0,
    SensorKind.FRAMELINVEL: 1,
    SensorKind.FRAMELINACC: 2,
}
"""Sensors of positions of frames, with the order of the time derivative."""
ROTATION_SENSORS = {SensorKind.FRAMEANGVEL: 1, SensorKind.FRAMEANGACC: 2}
"""Sensors of rotations of frames, with the order of the time derivative."""
TENDON_SENSORS = (SensorKind.TENDONPOS, SensorKind.TENDONVEL)
"""Sensors of the length of a tendon, and of its rate."""
ACTUATOR_SENSORS = (SensorKind.ACTUATORFRC, SensorKind.JOINTACTFRC)
"""Sensors of the force of an actuator, and of all actuators on a joint."""
INTERACTION_SENSORS = (SensorKind.FORCE, SensorKind.TORQUE)
"""Sensors of the force and the moment between a body and its parent."""
MAX_STEP_SHARE = STEP_SHARE * (1 + 1e-9)
"""Share of the proven step within which a knot is used: the next knot is `STEP_SHARE` of the
proven step ahead, up to rounding."""


def solve(
    value: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    model: Any,
    start: str = "start",
    joints: tuple[str, ...] = (),
    inertia: bool = False,
    controls: Mapping[str, ArrayLike] | None = None,
    control_rates: Mapping[str, ArrayLike] | None = None,
    in_time: tuple[Array, Sequence[MotionProfile]] | None = None,
    control_profiles: Mapping[str, MotionProfile] | None = None,
) -> dict[str, Array]:
    r"""Motion of any planar linkage of hinges, slides, ``connect`` and ``joint`` equalities.

    Fixed tendons may have equalities as well; springs and dampers act in joints and between two
    sites.

    ::

            o-----o          each loop:   P_one(q) - P_two(q) = 0
           /  \    \\         P = w z + t  in the complex plane, along a tree of joints
          /    \    \\
        --o-----o----o--

    Driven joints have given values, and the others follow by Newton's method along one branch
    (`proofmass.analytic.planar.branch`); rates and accelerations are the solutions of the loop
    equations differentiated once and twice.  Moments of drives and forces in joints follow from
    the loop equations' multipliers (`proofmass.analytic.planar.forces`): those of the mechanism at
    rest, or with `inertia` those of the motion.  Dry friction acts against the motion of a joint;
    while a joint is at rest, it keeps its last sense.  Without driven joints the motion is free and
    `value` is time (`proofmass.analytic.planar.dynamics`); joints with dry friction stick and slip
    (`proofmass.analytic.motion_events`).  Degrees of freedom that the drives do
    not determine move freely from the start pose if the drives move in time.  Otherwise springs,
    weights and loads bring them to rest, in the stable equilibrium that the mechanism reaches from
    the start pose (`proofmass.analytic.equilibrium`).

    Parameters
    ----------
    value, rate, acceleration : array_like (n,) or (drives, n)
        Of the driven joints [rad or m, per s, per s^2].  Without driven joints `value` has rising
        times [s].
    model : mujoco.MjModel
        The compiled MJCF; its sensors are the quantities.
    start : str
        Key with the start pose, which chooses the branch.
    joints : tuple of str
        The driven joints.
    inertia : bool
        Whether moments and forces are those at the rates and accelerations of the drives, and not
        those at rest; in a free motion they always are.
    controls : mapping of str to array_like (n,)
        Controls of actuators of joints that are not driven, at the samples [1]; controls that are
        left out are those of the key.
    control_rates : mapping of str to array_like (n,)
        Rates of these controls [1/s]; zero where they are left out.
    in_time : tuple of ndarray (n,) and sequence of callable, optional
        Times [s] of the samples, and the motion profile of each drive: values, rates and
        accelerations as functions of time.  Needed where the drives leave degrees of freedom, whose
        motion depends on the whole way and not on the samples alone.
    control_profiles : mapping of str to callable, optional
        For actuators whose controls change in time: values, rates and accelerations as functions of
        time.  Used where degrees of freedom move freely; `controls` follow from them.

    Returns
    -------
    dict of str to ndarray (n,) [SI]
        Curves by channel name, as in a sidecar: ``rocker``, ``pin.x``, ``coupler.angle``, ...; for
        a driven linkage also ``condition``, the factor by which rounding grows in a pose.
        A path of equilibria has rates but no accelerations: these are NaN.

    Raises
    ------
    CannotAssemble
        The loops do not close at the start pose; the message says which loop, and by how much.
    SingularHere
        A limit position lies on the way, or the drives do not determine the pose.
    Mirrored
        The pose found belongs to another assembly mode.  Proven steps exclude this, so it would be
        a defect of this package.
    Overconstrained
        The equations of a loop depend on those of others.
    Unstable
        A path of equilibria ends on the way, where the mechanism would fall to another equilibrium.
    ValueError
        The model is not a planar linkage, or the samples are not finite, have the wrong shape or
        are times that fall; the message says why.

    Notes
    -----
    Domain: every pose that regular poses or change points connect with the start pose.
    Accuracy: rounding times the condition of the pose, 1e-15 of the mechanism's size where the
    transmission angle is good; free motions 1e-12 per second; equilibria 1e-13, their rates 1e-11.

    Examples
    --------
    >>> import mujoco
    >>> model = mujoco.MjModel.from_xml_path("models/linkages/fourbar.xml")
    >>> motion = solve([0.0, 0.5], model=model, joints=("crank",))
    >>> [round(float(motion[name][0]), 8) for name in ("pin.x", "pin.y", "rocker_rate")]
    [1.4375, 1.95156187, -0.5]
    """
    check_finite(value=value, rate=rate, acceleration=acceleration)
    for curves in (controls or {}, control_rates or {}):
        check_finite(**curves)
    mechanism, plane = _read_cached(model, start)
    data = plane.data
    refuse_shared_ranges(data, {**(controls or {}), **(control_profiles or {})})
    if joints and (shape := np.atleast_2d(np.asarray(value, float)).shape)[:-1] != (len(joints),):
        raise ValueError(
            f"value must have shape (n,) or (drives, n) with {len(joints)} drive(s), got {shape}"
        )
    own, event_forces = dict[str, Array](), np.zeros(1)
    rubbing = mechanism.frictions
    has_dof = not joints or has_free_dof(mechanism, joints)
    is_free = has_dof and (not joints or in_time is not None)
    if has_dof:  # where the drives determine all poses, contacts change none of them
        refuse_contacts(data)
    refuse(data, SUPPORT, run_kind(joints, has_dof, inertia, in_time is not None), joints)
    if has_dof and not is_free:
        if inertia:
            raise NotCovered("a path of equilibria has no inertia: leave out inertia of the sweep")
        values = np.atleast_2d(np.asarray(value, float))
        q, v, event_forces, d = _find_equilibria(
            mechanism,
            joints,
            values.T,
            np.broadcast_to(np.asarray(rate, float), values.shape).T,
            controls_at_samples(data, mechanism.ctrl, controls),
            controls_at_samples(data, np.zeros(mechanism.ctrl.size), control_rates),
        )
        a = np.full_like(q, np.nan)
    elif not is_free:
        values = np.atleast_2d(np.asarray(value, float))
        q, d = _find_poses(mechanism, joints, values.shape, values.tobytes())
        moving = (
            np.broadcast_to(np.asarray(x, float), values.shape).T for x in (rate, acceleration)
        )
        v, a = joint_rates(mechanism, q, d, *moving)
        own["condition"] = condition_numbers(mechanism, q, d)
        refuse_limits(mechanism, q)
    else:
        d = Drives.of(mechanism, joints)
        profiles = ControlsInTime.of(data, mechanism.ctrl, control_profiles)
        free_states = _find_motion(plane, mechanism, joints, value, in_time, profiles)
        q, v, a = free_states.arrays()
        event_forces = np.array(free_states.forces)
        # of joints that drives move; the friction of the others is among the forces of events
        on_drives = [*d.driven.tolist(), *free_states.prescribed]
        rubbing = np.where(np.isin(np.arange(rubbing.size), on_drives), rubbing, 0.0)
    found = own | quantities(plane, mechanism, move_bodies(mechanism, q, v, a), (q, v, a))
    fastest = float(np.abs(v[:, d.driven]).max(initial=0.0))
    friction = rubbing * motion_senses(v.T, fastest).T
    if not is_free and not inertia:  # the sensors of rates have been read; forces are those at rest
        v = a = np.zeros_like(q)
    if control_profiles and controls is None:
        times = np.asarray(in_time[0] if in_time else value, float)
        controls = {name: profile(times)[0] for name, profile in control_profiles.items()}
    ctrl = controls_at_samples(data, mechanism.ctrl, controls)
    found |= force_curves(
        plane,
        mechanism,
        move_bodies(mechanism, q, v, a),
        (q, v, a),
        d,
        friction - event_forces,
        ctrl,
    )
    return {name: np.broadcast_to(curve, (len(q),)) for name, curve in found.items()}


def refuse_limits(m: Mechanism, q: Array) -> None:
    """Raise ValueError if a joint that the drives determine leaves its range."""
    for k, joint in enumerate(m.joints):
        refuse_limit(joint.name, joint.range, q[:, k])


def refuse_shared_ranges(data: ModelData, controls: Mapping[str, Any]) -> None:
    """Raise NotCovered if a changing control acts with others within a joint's range of forces."""
    controls_by_place(data, controls)  # ValueError if there is no such actuator
    for actuator in (one for one in data.actuators if one.name in controls and one.joint >= 0):
        joint = data.joints[actuator.joint]
        shared = [one for one in data.acting if one.joint == actuator.joint]
        if joint.has_force_range and len(shared) > 1:
            raise NotCovered(
                f"the control of actuator {actuator.name!r} changes, and its joint "
                f"{joint.name!r} has a range of forces for several actuators"
            )


def properties(
    *,
    model: Any,
    start: str,
    joints: tuple[str, ...],
    motion: Any,
    control_profiles: Mapping[str, MotionProfile] | None = None,
    **_: float,
) -> dict[str, str]:
    """Describe the events at stops and of friction of a mechanism that moves freely, for a report.

    `motion` has the times of the run [s].
    """
    if joints:
        return {}
    mechanism, plane = _read_cached(model, start)
    profiles = ControlsInTime.of(plane.data, mechanism.ctrl, control_profiles)
    followed = _find_motion(plane, mechanism, (), motion, None, profiles)
    found = {"stops": followed.events(), "friction": followed.friction_events()}
    return {name: events for name, events in found.items() if events}


@lru_cache(maxsize=32)
def has_free_dof(m: Mechanism, joints: tuple[str, ...]) -> bool:
    """Whether the mechanism has more degrees of freedom than driven joints."""
    return count_dof(m, nearest_pose(m, m.start)) > len(joints)


@lru_cache(maxsize=32)
def _find_poses(
    mechanism: Mechanism, joints: tuple[str, ...], shape: tuple[int, int], values: bytes
) -> tuple[Array, Drives]:
    """Closed poses over the drives' values; cached, since a report asks for them again."""
    inputs = np.frombuffer(values).reshape(shape).T
    if len(joints) == 1 and (found := _poses_from_knots(mechanism, joints, inputs)) is not None:
        return found
    branch = Branch(mechanism, joints)
    q, failure = branch.follow(inputs)
    if failure is not None:
        raise failure
    return q, branch.d


def _find_equilibria(
    mechanism: Mechanism,
    joints: tuple[str, ...],
    values: Array,
    rate: Array,
    ctrl: Array | None,
    ctrl_rate: Array | None,
) -> tuple[Array, Array, Array, Drives]:
    """Equilibria and their rates (n, joints) over values of the drives (n, drives) and controls.

    The third array has the forces of stops on the joints there (n, joints).
    """
    at_rest = LinkageAtRest(mechanism, Drives.of(mechanism, joints))
    q, stops = _follow_equilibria(mechanism, joints, pickle.dumps((values, ctrl)))
    v, pushes = EquilibriumSolver(at_rest).beside(q, stops, values, rate, ctrl, ctrl_rate)
    return q, v, pushes, at_rest.drives


@lru_cache(maxsize=32)
def _follow_equilibria(
    mechanism: Mechanism, joints: tuple[str, ...], packed: bytes
) -> tuple[Array, list[ActiveStops]]:
    """Equilibria (n, joints) and their stops; cached, since a report asks for them again."""
    at_rest = LinkageAtRest(mechanism, Drives.of(mechanism, joints))
    return EquilibriumSolver(at_rest).follow(*pickle.loads(packed))


def _poses_from_knots(
    mechanism: Mechanism, joints: tuple[str, ...], inputs: Array
) -> tuple[Array, Drives] | None:
    """Find closed poses from knots that do not depend on the samples; None if they do not reach.

    The motion that an engine's drive really made differs little from the prescribed one and uses
    the same knots, so that they are found only once; and no pose depends on earlier solutions.
    """
    (place,) = Drives.of(mechanism, joints).driven
    begin, part = mechanism.start[place], KNOT_SPACING * mechanism.scale[place]
    # the ends of the knots are rounded outwards, so that a slightly longer motion has the same ones
    low = (np.floor(inputs.min(initial=begin) / part - KNOT_OFFSET) + KNOT_OFFSET) * part
    high = (np.ceil(inputs.max(initial=begin) / part - KNOT_OFFSET) + KNOT_OFFSET) * part
    branch, knots = _find_knots(mechanism, joints, float(low), float(high))
    x, knot_values, start = inputs[:, 0], knots.q[:, place], branch.knot.q[place]
    k = np.where(
        x >= start,
        np.searchsorted(knot_values, x, "right") - 1,
        np.searchsorted(knot_values, x, "left"),
    )
    nearest_knots = knots[k.clip(0, len(knots) - 1)]
    # one Newton correction from a knot stays on its branch only within the step proven there
    _, moves, proven = branch.beside(inputs, nearest_knots)
    return (
        (branch.close(inputs, nearest_knots), branch.d)
        if (moves <= MAX_STEP_SHARE * proven).all()
        else None
    )


@lru_cache(maxsize=8)
def _find_knots(
    mechanism: Mechanism, joints: tuple[str, ...], low: float, high: float
) -> tuple[Branch, Knots]:
    """A branch at its start pose, and its knots between two values of its only drive."""
    downward, upward = (Branch(mechanism, joints).walk(np.array([[end]]))[0] for end in (low, high))
    return Branch(mechanism, joints), Knots.joined([downward[:0:-1], upward])


def _find_motion(
    plane: Projection,
    mechanism: Mechanism,
    joints: tuple[str, ...],
    value: ArrayLike,
    in_time: tuple[Array, Sequence[MotionProfile]] | None,
    controls: ControlsInTime | None = None,
) -> MotionWithEvents:
    """Integrate a motion with degrees of freedom that no drive determines, between stops."""
    stops = tuple(plane.stops(mechanism, joints))
    times = np.atleast_1d(np.asarray(value, float))
    if (not joints or in_time is None) and controls is None:
        if times.ndim != 1:
            raise ValueError(f"the times of a free motion must have shape (n,), got {times.shape}")
        return _integrate_free(mechanism, tuple(times.tolist()), stops)
    if not joints or in_time is None:
        joints, in_time = (), (times, ())
    return _integrate_in_time(mechanism, joints, *in_time, stops, controls)


@lru_cache(maxsize=32)
def _integrate_free(
    mechanism: Mechanism, times: tuple[float, ...], stops: tuple[Stop, ...]
) -> MotionWithEvents:
    """A free motion; cached, since every solver of a case is compared with it."""
    return free_motion(mechanism, np.array(times), stops=stops)


def _integrate_in_time(
    mechanism: Mechanism,
    joints: tuple[str, ...],
    times: Array,
    profiles: Sequence[MotionProfile],
    stops: tuple[Stop, ...],
    controls: ControlsInTime | None,
) -> MotionWithEvents:
    """A motion under motion profiles; cached where possible, since all solvers use it."""
    try:
        pickled = pickle.dumps((times, profiles, controls))
    except (AttributeError, TypeError, pickle.PicklingError):  # a function within a function
        return _integrate(mechanism, joints, times, profiles, stops, controls)
    return _integrate_in_time_cached(mechanism, joints, pickled, stops)


@lru_cache(maxsize=8)
def _integrate_in_time_cached(
    mechanism: Mechanism, joints: tuple[str, ...], packed: bytes, stops: tuple[Stop, ...]
) -> MotionWithEvents:
    """`_integrate_in_time` for pickled times, profiles and controls, cached by these bytes."""
    times, profiles, controls = pickle.loads(packed)
    return _integrate(mechanism, joints, times, profiles, stops, controls)


def _integrate(
    mechanism: Mechanism,
    joints: tuple[str, ...],
    times: Array,
    profiles: Sequence[MotionProfile],
    stops: tuple[Stop, ...],
    controls: ControlsInTime | None,
) -> MotionWithEvents:
    driven = Drives.of(mechanism, joints).driven
    drives = Prescribed.of(driven, driven, profiles) if joints else NO_PRESCRIBED_JOINTS
    return free_motion(mechanism, times, drives, stops, controls)


_read_cached = read_once(None)(read)


def quantities(
    plane: Projection, m: Mechanism, motion: BodyMotion, joint: tuple[Array, Array, Array]
) -> dict[str, Array]:
    """Curves (n,) of the sensors of positions, motions and energies.

    Their names are those of channels: ``sensor``, ``sensor.x``, ``.y``, ``.z``, ``sensor.angle``.

    Parameters
    ----------
    plane : Projection
        The model and its plane.
    m : Mechanism
    motion : BodyMotion
    joint : three ndarray (n, joints)
        Joint values, rates, accelerations [rad or m, per s, per s^2].
    """
    found: dict[str, Array] = {}
    for sensor in plane.data.sensors:
        name, kind = sensor.name, sensor.kind
        value: Array | None = None
        if kind in POSITION_SENSORS or kind in ROTATION_SENSORS or kind == SensorKind.FRAMEXAXIS:
            found |= {
                f"{name}.{part}": curve
                for part, curve in frame_curves(plane, motion, sensor).items()
            }
        elif kind == SensorKind.E_POTENTIAL:
            value = potential_energy(m, motion, joint[0]) + normal_potential(plane)
        elif kind == SensorKind.E_KINETIC:
            value = kinetic_energy(m, motion, joint[1])
        elif kind in TENDON_SENSORS:
            value = tendon_curve(plane, m, motion, joint, sensor)
        elif sensor.on_joint:
            order = {
                SensorKind.JOINTPOS: 0,
                SensorKind.JOINTVEL: 1,
                SensorKind.USER: 2,
            }.get(kind)
            value = None if order is None else joint[order][:, sensor.number]
        if value is not None:
            found[name] = value
    return found


def tendon_curve(
    plane: Projection,
    m: Mechanism,
    motion: BodyMotion,
    joint: tuple[Array, Array, Array],
    sensor: SensorData,
) -> Array:
    """Length of a tendon, or the rate of its length (n,), as a sensor shows."""
    t, order, tendons = sensor.number, TENDON_SENSORS.index(sensor.kind), plane.data.tendons
    if tendons[t].way == TendonWay.SUM:
        return np.asarray(sum(share * joint[order][:, j] for j, share in tendons[t].terms))
    number = sum(tendon.way != TendonWay.SUM for tendon in tendons[:t])
    length = spring_length(m, motion, number)
    return length.value if order == 0 else np.asarray((length.rows * joint[1]).sum(axis=-1))


def normal_potential(plane: Projection) -> float:
    """Potential energy of gravity along the plane's normal [J], which is constant."""
    bodies, normal = plane.data.bodies, plane.normal
    places = plane.at + (plane.turn @ np.array([body.centre for body in bodies])[..., None])[..., 0]
    masses = np.array([body.mass for body in bodies])
    return float(-(plane.data.options.gravity @ normal) * masses @ (places @ normal))


def frame_curves(plane: Projection, motion: BodyMotion, sensor: SensorData) -> dict[str, Array]:
    """Curves of a sensor of a frame by their parts; none if it has a frame of reference."""
    kind = sensor.kind
    if sensor.is_relative:
        return {}
    body, position, axes = plane.sensor_frame(sensor)
    if kind in ROTATION_SENSORS:
        return world_components(plane, np.zeros(1), motion.turn[ROTATION_SENSORS[kind]][body])
    if kind in POSITION_SENSORS:
        order = POSITION_SENSORS[kind]
        flat = motion.point(body, plane.flat(position), order)
        return world_components(
            plane, flat, np.zeros(1) if order else np.array([position @ plane.normal])
        )
    axis = axes[:, 0]
    angle = np.angle(plane.flat(axis)) + motion.turn[0][body]
    angle = angle - 2 * np.pi * np.ceil(angle[0] / (2 * np.pi) - 0.5)
    parts = world_components(
        plane, motion.w[0][body] * plane.flat(axis), np.array([axis @ plane.normal])
    )
    return {**parts, "angle": angle}


def world_components(plane: Projection, flat: Complex | Array, up: Array) -> dict[str, Array]:
    """World components of vectors with the parts `flat` in the plane and `up` along its normal."""
    return {
        part: plane.e1[k] * flat.real + plane.e2[k] * flat.imag + plane.normal[k] * up
        for k, part in enumerate("xyz")
    }


def force_curves(
    plane: Projection,
    m: Mechanism,
    motion: BodyMotion,
    joint: tuple[Array, Array, Array],
    d: Drives,
    friction: Array,
    ctrl: Array | None,
) -> dict[str, Array]:
    """Curves (n,) of the sensors of forces and moments, by channel name as in `quantities`."""
    kinds = ACTUATOR_SENSORS + INTERACTION_SENSORS
    sensors = [sensor for sensor in plane.data.sensors if sensor.kind in kinds]
    if not sensors:
        return {}
    found, solved = dict[str, Array](), solve_forces(m, motion, joint, d, friction, ctrl)
    for sensor in sensors:
        if sensor.kind in ACTUATOR_SENSORS:
            curve = actuator_curve(plane.data, m, motion, joint, sensor, solved.drives, d, ctrl)
            found[sensor.name] = curve
        else:
            parts = interaction_curves(plane, m, motion, sensor, solved, ctrl)
            found |= {f"{sensor.name}.{part}": curve for part, curve in parts.items()}
    return found


def actuator_curve(
    data: ModelData,
    m: Mechanism,
    motion: BodyMotion,
    state: tuple[Array, Array, Array],
    sensor: SensorData,
    drives: Array,
    d: Drives,
    ctrl: Array | None,
) -> Array:
    """Curve (n,) of the sensor of an actuator, or of all actuators on a joint.

    On a driven joint it is the moment or force of the drive.
    """
    of_one = sensor.kind == SensorKind.ACTUATORFRC
    actuator = data.actuators[sensor.number] if of_one else None
    joint = actuator.joint if actuator else sensor.number
    if (place := np.flatnonzero(d.driven == joint)).size:
        moment = drives[:, place[0]]
        return np.asarray(moment / actuator.gear if actuator else moment)
    if actuator:
        return actuator_force(m, state, actuator, ctrl)
    own = motor_forces(m, *state[:2], ctrl)[:, joint]
    return np.asarray(own + loads_on_joints(m, motion, ctrl)[:, joint] if m.point_loads else own)


def actuator_force(
    m: Mechanism, state: tuple[Array, Array, Array], actuator: ActuatorData, ctrl: Array | None
) -> Array:
    """Force of an actuator on a joint or on a site (n,)."""
    if actuator.is_disabled:
        return np.zeros(1)
    control = (m.ctrl[None] if ctrl is None else ctrl)[:, actuator.place]
    if actuator.joint < 0:
        return actuator.force(control)
    own = (actuator.gear * part[:, actuator.joint] for part in state[:2])
    return actuator.force(control, *own)


def interaction_curves(
    plane: Projection,
    m: Mechanism,
    motion: BodyMotion,
    sensor: SensorData,
    solved: Forces,
    ctrl: Array | None,
) -> dict[str, Array]:
    """Force or moment on the body of a site from its parent, by parts in the site's frame."""
    body, position, axes = plane.sensor_frame(sensor)
    place = motion.point(body, plane.flat(position))
    force, moment = transmitted_force(m, motion, solved.loops, body, place, ctrl)
    if sensor.kind == SensorKind.TORQUE:
        return {part: moment * (plane.normal @ axes[:, k]) for k, part in enumerate("xyz")}
    own = force * motion.w[0][body].conj()
    return {
        part: own.real * (plane.e1 @ axes[:, k]) + own.imag * (plane.e2 @ axes[:, k])
        for k, part in enumerate("xyz")
    }


@dataclass(frozen=True)
class LinkageAtRest:
    """A planar linkage whose drives leave degrees of freedom, for `EquilibriumSolver`.

    Raises
    ------
    NotCovered
        A joint without a drive has dry friction: its equilibrium depends on how it was reached.
    """

    m: Mechanism
    drives: Drives

    def __post_init__(self) -> None:
        for joint in (self.m.joints[j] for j in self.drives.following):
            if joint.friction:
                raise NotCovered(
                    f"joint {joint.name!r} has friction, and the drives do not determine it: its "
                    "equilibrium depends on how it was reached"
                )

    @property
    def sizes(self) -> Array:
        """Units of its joint values (joints,): 1 rad, or the size of the mechanism [m]."""
        return self.m.scale

    @property
    def driven(self) -> Index:
        """Indices of the driven joints (drives,)."""
        return self.drives.driven

    @cached_property
    def stops(self) -> tuple[Stop, ...]:
        """Stops of the joints that are not driven."""
        m = self.m
        joints = ((int(j), m.joints[j]) for j in self.drives.following)
        return tuple(
            stop
            for j, joint in joints
            for stop in make_stops(joint.name, joint.range, j, j, float(m.scale[j]))
        )

    def begin(self, values: Array) -> Array:
        """Find the closed pose (joints,) nearest to the start, drives at values (drives,)."""
        return nearest_pose(self.m, self.m.start, self.driven, values)

    def moved(self, q: Array, moves: Array) -> Array:
        """Poses (n, joints) that moves (n, joints) lead to from poses q."""
        return q + moves

    def pushed(self, q: Array, ctrl: Array | None) -> tuple[Array, Array, Array]:
        """Forces on the joints (n, joints) at poses q (n, joints), and the Jacobian of the loops.

        The third array has the violations of the loops (n, rows) [sizes].
        """
        m, motion = self.m, move_bodies(self.m, q)
        force = applied_forces(m, motion, centre_jacobians(m, motion), q, 0.0, ctrl)
        violations, rows = linearise_loops(m, q)
        return force, rows / m.loop_units[:, None], violations / m.loop_units

    def values(self, q: Array) -> Array:
        """Values of the drives (n, drives) [rad or m]."""
        return q[:, self.driven]


class Planar(Reference):
    """The general planar linkage: the reference of any planar MJCF that has no closed form."""

    method = "general solver of planar linkages"
    reads_model = True
    covers_inertia = True
    follows_controls = True

    def solve(self, motion: InputMotion, ask: Ask) -> dict[str, Array]:
        """Curves of all sensors of the model, see the function `solve` of this module."""
        return solve(*motion.arguments, inertia=ask.inertia, **ask.of_model.arguments)

    def properties(self, motion: InputMotion, ask: Ask) -> dict[str, str]:
        """Events at stops and of friction in a free motion, in words."""
        return properties(motion=motion.x, **ask.of_model.arguments)
