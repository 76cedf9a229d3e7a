"""Any spatial mechanism: the reference of an MJCF with bodies that move in space.

    sidecar:  reference = "spatial"

The quantities are the model's own sensors, by their channel names.  The numbers are read from the
compiled model, so it holds the *engine* to account, not the drawing: a wrong length in the MJCF is
wrong in both.
"""

import pickle
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.controls import ControlsInTime, Law, controls_at_samples
from proofmass.analytic.numerics import Array, unwrapped_quaternion
from proofmass.analytic.planar.mechanism import joined, rotation
from proofmass.analytic.spatial.kinematics import TreeMotion, move_tree
from proofmass.analytic.spatial.mechanism import NO_TURN, Tree, product, read_tree
from proofmass.analytic.spatial.motion import HeldMotion, driven_motion, held_motion
from proofmass.analytic.spatial.reactions import Reactions, State, asked, determined
from proofmass.analytic.spatial.terms import (
    NAMES,
    OwnTerms,
    Source,
    lengthened,
    over_slack,
    stretched,
)
from proofmass.analytic.spatial.witness import Witnessed, bear_witness
from proofmass.analytic.stops import Stop, read_stops

__all__ = ["facts", "solve"]

S, OBJ = mujoco.mjtSensor, mujoco.mjtObj
PARTS = {3: "xyz", 4: "wxyz"}
"""Names of the parts of vectors, and of quaternions."""


@dataclass(frozen=True)
class Followed:
    """A motion, its bodies, and what its witness found."""

    held: HeldMotion
    motion: TreeMotion
    witnessed: Witnessed
    tangents: Array | None = None


def solve(
    value: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    model: Any,
    start: str = "start",
    joints: tuple[str, ...] = (),
    inertia: bool = False,
    terms: Source | None = None,
    controls: Mapping[str, ArrayLike] | None = None,
    control_laws: Mapping[str, Law] | None = None,
) -> dict[str, Array]:
    r"""Motion of any tree of hinges, slides, balls and free joints with equalities held exactly.

    ::

            o---o          M(q) v̇ + h(q, v) = Q(q, v) + Jᵀ λ
           /     \\         φ(q) = 0,   J v̇ = γ(q, v)
          o       o
        --+-------+--      φ: connect, weld, joint, tendon

    Springs and dampers of joints and tendons may be polynomials, tendons fixed or straight from
    site to site, actuators affine with the control of the key or one that follows a law.  DOP853
    with a projection of pose and rates after every step (`proofmass.analytic.spatial.motion`),
    begun anew where a law has a break; the terms come from `terms`,
    and at 50 poses of the motion those of this package must agree with them to 1e-12
    (`proofmass.analytic.spatial.witness`).

    Parameters
    ----------
    value, rate, acceleration : array_like (n,) or (drives, n)
        Of the driven joints [rad or m, per s, per s^2]; rising times [s] without any.
    model : mujoco.MjModel
        The compiled MJCF; its sensors are the quantities.
    start : str
        Key with the start pose, the rates there, and the controls.
    joints : tuple of str
        The driven joints, which determine all others.
    inertia : bool
        Whether moments of drives are those of the motion, and not those at rest.
    terms : Source, optional
        Where the terms of the equations of motion come from, by default this package.
    controls : mapping of str to array_like (n,)
        Of actuators at the samples of a driven motion [1]; left out: those of the key.
    control_laws : mapping of str to callable, optional
        Of actuators whose controls change in time, values, rates and accelerations as functions of
        time; of a free motion.

    Returns
    -------
    dict of str to ndarray (n,) [SI]
        By channel name, as in a sidecar: ``top.x``, ``turn.w``, ``spin.z``, ...; quaternions begin
        with their largest part positive and do not jump.

    Raises
    ------
    NotCovered
        The model holds what is not covered; by its name in the MJCF.
    CannotAssemble, SingularHere
        The start pose is open; or the equalities lose rank on the way, and where.
    TermsDiffer
        Two formulations of the equations of motion disagree.

    Notes
    -----
    Domain: regular motions, whose equalities hold the same number of directions throughout.
    Accuracy: the tolerance of a step is 3e-14; what remains grows with the motion's own
    sensitivity, 1e-10 after 20 s of a body that flips over four times.

    Examples
    --------
    >>> import mujoco
    >>> model = mujoco.MjModel.from_xml_path("models/spatial/euler_top.xml")
    >>> motion = solve([0.0, 1.0], model=model)
    >>> [round(float(motion[name][0]), 8) for name in ("turn.w", "spin.y")]
    [1.0, 5.0]
    """
    tree, source = sources(model, start, terms)
    if not joints:
        times = np.atleast_1d(np.asarray(value, float))
        laws = laws_as_bytes(model, tree, control_laws)
        stops = tuple(stops_of(model, tree))
        followed = follow(tree, source, tuple(times.tolist()), stops, laws)
        controls_there = pickle.loads(laws).along(times) if laws else None
        pushes = np.array(followed.held.stopped.forces).reshape(-1, tree.armature.size)
        shown = shown_reactions(model, tree, followed, (), True, controls_there, pushes)
        return quantities(model, tree, followed) | shown
    values = np.atleast_2d(np.asarray(value, float))
    moving = [np.broadcast_to(np.asarray(x, float), values.shape) for x in (rate, acceleration)]
    drives = np.array([values, *moving])
    ctrl = controls_at_samples(model, tree.ctrl, controls)
    packed = None if ctrl is None else ctrl.tobytes()
    followed = follow_driven(tree, source, joints, drives.shape, drives.tobytes(), packed)
    refuse_limits(tree, followed.held.q)
    moments = of_drives(tree, followed, joints, inertia, ctrl)
    shown = shown_reactions(model, tree, followed, joints, inertia, ctrl, np.zeros((1, 1)))
    return quantities(model, tree, followed) | shown_moments(model, joints, moments) | shown


def facts(
    *,
    model: Any,
    start: str,
    terms: Source,
    joints: tuple[str, ...],
    motion: Any,
    control_laws: Mapping[str, Law] | None = None,
    **_: float,
) -> dict[str, str]:
    """What is known of a motion as a whole, in words for a report.

    `motion` are the times of the run [s], or values, rates and accelerations of its drives.
    """
    tree, source = sources(model, start, terms)
    if joints:
        drives = np.array([np.atleast_2d(part) for part in motion])
        followed = follow_driven(tree, source, joints, drives.shape, drives.tobytes())
    else:
        times = tuple(np.asarray(motion, float).tolist())
        laws = laws_as_bytes(model, tree, control_laws)
        followed = follow(tree, source, times, tuple(stops_of(model, tree)), laws)
    seen, held = followed.witnessed, followed.held
    found = {
        "equations of motion": (
            f"terms of {source.name}, "
            + ("at the drives' values" if joints else "integrated with DOP853 at 3e-14")
        ),
        "second formulation": (
            f"proofmass's own terms agree at {seen.states} poses, to {seen.difference:.1g} of the "
            f"largest (worst: {NAMES[seen.term]})"
        ),
    }
    if tree.rows:
        rows = f"all {tree.rows} rows" if joints else f"{held.rank} independent of {tree.rows} rows"
        found["equalities"] = f"held exactly, {rows}; open by {held.open_by:.1g} in the key"
    if events := held.stopped.events():
        found["stops"] = events
    if not joints and not held.stopped.impacts and (energy := conserved(tree, followed)):
        found["energy"] = energy
    return found


def conserved(tree: Tree, followed: Followed) -> str:
    """How well energy is kept, in words; nothing where something takes or gives some."""
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


def sources(model: Any, start: str, terms: Source | None) -> tuple[Tree, Source]:
    """The tree of a model, and where its terms come from."""
    tree = _read(model, start)
    return tree, _own(tree) if terms is None else terms


_read = lru_cache(maxsize=32)(read_tree)
_own = lru_cache(maxsize=32)(OwnTerms)


@lru_cache(maxsize=8)
def follow(
    tree: Tree,
    source: Source,
    times: tuple[float, ...],
    stops: tuple[Stop, ...] = (),
    laws: bytes = b"",
) -> Followed:
    """A motion that every solver of a case is held to; controls that change are given as bytes."""
    controls: ControlsInTime | None = pickle.loads(laws) if laws else None
    held = held_motion(tree, source, np.array(times), stops, controls)
    ctrl = controls.along(np.array(times)) if controls else None
    seen = bear_witness(tree, source, np.array(times), held.q, held.v, ctrl=ctrl)
    return Followed(held, move_tree(tree, held.q, held.v, held.a), seen)


@lru_cache(maxsize=8)
def follow_driven(
    tree: Tree,
    source: Source,
    joints: tuple[str, ...],
    shape: tuple[int, ...],
    drives: bytes,
    controls: bytes | None = None,
) -> Followed:
    """A motion whose drives have given values, rates and accelerations."""
    values, rates, accelerations = np.frombuffer(drives).reshape(shape).transpose(0, 2, 1)
    held, tangents = driven_motion(tree, source, joints, values, rates, accelerations)
    ctrl = None if controls is None else np.frombuffer(controls).reshape(len(values), -1)
    places = np.arange(float(len(values)))
    seen = bear_witness(tree, source, places, held.q, held.v, "sample", ctrl)
    return Followed(held, move_tree(tree, held.q, held.v, held.a), seen, tangents)


def laws_as_bytes(model: Any, tree: Tree, laws: Mapping[str, Law] | None) -> bytes:
    """All controls of a model in time; nothing if they are those of the key."""
    controls = ControlsInTime.of(model, tree.ctrl, laws)
    return pickle.dumps(controls) if controls else b""


def state_of(followed: Followed, inertia: bool) -> State:
    """Poses, rates and accelerations of a motion, or of its poses at rest."""
    held, still = followed.held, np.zeros_like(followed.held.v)
    return (held.q, held.v, held.a) if inertia else (held.q, still, still)


def of_drives(
    tree: Tree,
    followed: Followed,
    joints: tuple[str, ...],
    inertia: bool,
    ctrl: Array | None = None,
) -> Array:
    """What the drives must do (n, drives), by virtual work [N m or N].

    Of the motion with `inertia`, else at rest; without the actuators of the driven joints.
    """
    needed, _ = asked(tree, state_of(followed, inertia), joints, ctrl)
    assert followed.tangents is not None
    return np.asarray(np.einsum("nr,nrd->nd", needed, followed.tangents))


def shown_moments(model: Any, joints: tuple[str, ...], moments: Array) -> dict[str, Array]:
    """The moments of drives by the sensors of their actuators and joints."""
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


def shown_reactions(
    model: Any,
    tree: Tree,
    followed: Followed,
    joints: tuple[str, ...],
    inertia: bool,
    ctrl: Array | None,
    pushes: Array,
) -> dict[str, Array]:
    """Forces and moments between bodies by their sensors; none where nothing determines them.

    Of the motion with `inertia`, else at rest; `pushes` is what stops do to the joints.
    """
    kinds = {s: S(int(model.sensor_type[s])) for s in range(model.nsensor)}
    sensors = [s for s, kind in kinds.items() if kind in (S.mjSENS_FORCE, S.mjSENS_TORQUE)]
    if not sensors or not determined(tree):
        return {}
    state, found = state_of(followed, inertia), dict[str, Array]()
    motion = followed.motion if inertia else move_tree(tree, *state)
    reactions = Reactions(tree, motion, state, joints, pushes, ctrl)
    for s in sensors if reactions.unique else ():
        seat = Seat.of(model, tree, motion, s)
        force, moment = reactions.on(seat.body, seat.at())
        own = seat.inside(force if kinds[s] == S.mjSENS_FORCE else moment)
        found |= {f"{model.sensor(s).name}.{part}": own[:, k] for k, part in enumerate("xyz")}
    return found


def stops_of(model: Any, tree: Tree) -> Iterator[Stop]:
    """The ends of the ranges of the joints."""
    for j, joint in enumerate(tree.joints):
        if joint.kind in ("hinge", "slide"):
            size = 1.0 if joint.kind == "hinge" else max(tree.extent, 1e-300)
            yield from read_stops(model, j, joint.range, joint.pose, joint.rate, size)


def refuse_limits(tree: Tree, q: Array) -> None:
    """Raise ValueError if a joint leaves its range, which drives do not."""
    for joint in tree.joints:
        if joint.kind in ("hinge", "slide"):
            out = (q[:, joint.pose] < joint.range[0]) | (q[:, joint.pose] > joint.range[1])
            if out.any():
                raise ValueError(
                    f"joint {joint.name!r} leaves its range {joint.range} at sample "
                    f"{int(np.argmax(out))}; stops are not covered beside drives"
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
    """What a sensor of a joint, of a tendon or of the whole model shows; None of another."""
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
    """The frame of a sensor: a place and axes of a body."""

    motion: TreeMotion
    body: int
    place: Array
    quaternion: Array
    gravity: Array

    @classmethod
    def of(cls, model: Any, tree: Tree, motion: TreeMotion, s: int) -> "Seat":
        """That of sensor number s."""
        kind, i = OBJ(int(model.sensor_objtype[s])), int(model.sensor_objid[s])
        body, place, quaternion = {
            OBJ.mjOBJ_SITE: lambda: (model.site_bodyid[i], model.site_pos[i], model.site_quat[i]),
            OBJ.mjOBJ_GEOM: lambda: (model.geom_bodyid[i], model.geom_pos[i], model.geom_quat[i]),
            OBJ.mjOBJ_BODY: lambda: (i, model.body_ipos[i], model.body_iquat[i]),
            OBJ.mjOBJ_XBODY: lambda: (i, np.zeros(3), NO_TURN),
        }[kind]()
        return cls(motion, int(body), np.array(place), np.array(quaternion), tree.gravity)

    def at(self) -> Array:
        """Its place (n, 3) [m]."""
        return self.motion.point(self.body, self.place)

    def velocity(self) -> Array:
        """Its velocity (n, 3) [m/s]."""
        return self.motion.point_velocity(self.body, self.place)

    def acceleration(self) -> Array:
        """Its acceleration (n, 3) [m/s^2]."""
        return self.motion.point_acceleration(self.body, self.place)

    def turn(self) -> Array:
        """The quaternion of its axes (n, 4) [1]."""
        return unwrapped_quaternion(product(self.motion.quaternion[:, self.body], self.quaternion))

    def axis(self, k: int) -> Array:
        """One of its axes in the world (n, 3) [1]."""
        return np.asarray(self.motion.turn[:, self.body] @ rotation(self.quaternion)[:, k])

    def inside(self, vectors: Array) -> Array:
        """Vectors (n, 3) in its axes."""
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
"""What sensors of frames show."""


def kinetic(tree: Tree, followed: Followed) -> Array:
    """Kinetic energy (n,), with that of armatures [J]."""
    motion, rates = followed.motion, followed.held.v
    found = 0.5 * rates**2 @ tree.armature
    for b, body in enumerate(tree.bodies):
        speed = motion.point_velocity(b, body.centre)
        spin = np.einsum("nji,nj->ni", motion.turn[:, b], motion.spin[:, b])
        found = found + 0.5 * body.mass * (speed**2).sum(axis=1)
        found = found + 0.5 * (spin * (spin @ body.inertia)).sum(axis=1)
    return np.asarray(found)


def potential(tree: Tree, followed: Followed) -> Array:
    """Potential energy (n,) of weights and springs, as MuJoCo counts it [J]."""
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
