r"""The terms of the equations of motion of a tree:

    M(q) v̇ + h(q, v) = Q(q, v) + Jᵀ λ,      φ(q) = 0,   J v̇ = γ(q, v)

M and h are sums over the bodies of Newton's equations for the centre of mass and Euler's equations
about it, projected on the directions in which the joints move the body (Kane's equations):

    M = Σ m J_cᵀ J_c + J_ωᵀ I J_ω        h = Σ J_cᵀ m (a_c - g) + J_ωᵀ (I α + ω × I ω)

with the accelerations a_c and α at v̇ = 0.  γ is the negative of φ's second time derivative at
v̇ = 0.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from proofmass.analytic.mjcf import (
    ActuatorData,
    JointData,
    JointKind,
    LoopData,
    SiteLoad,
    TendonData,
    TieData,
)
from proofmass.analytic.spatial.kinematics import (
    TreeMotion,
    cross3,
    move_tree,
    normalize_quaternions,
    rotation_vector,
)
from proofmass.analytic.spatial.mechanism import (
    Tree,
    quaternion_conjugate,
    quaternion_product,
)
from proofmass.analytic.support import refuse_contacts
from proofmass.analytic.term_source import Terms
from proofmass.base.arrays import Array


@dataclass(frozen=True)
class OwnTerms:
    """This package's own formulation as the source of the terms."""

    tree: Tree
    name: str = "proofmass"

    def terms(self, q: Array, v: Array, ctrl: Array | None = None) -> Terms:
        """All terms at a pose (poses,) with rates (rates,) and controls, by default the key's."""
        found = own_terms(self.tree, q[None], v[None], None if ctrl is None else ctrl[None])
        return Terms(**{k: x[0] for k, x in vars(found).items()})

    def equalities(self, q: Array) -> tuple[Array, Array]:
        """Violations (rows,) and Jacobian (rows, rates) of equalities at a pose (poses,) [SI]."""
        found = self.terms(q, np.zeros(self.tree.armature.size))
        return found.gap, found.jacobian

    def acceleration(self, q: Array, v: Array, ctrl: Array | None = None) -> Array:
        """Accelerations (rates,) of a tree without equalities [SI]."""
        found = self.terms(q, v, ctrl)
        return np.asarray(np.linalg.solve(found.mass, found.force - found.bias))

    def first_contact(self, times: Array | None, q: Array) -> str:
        """Raise NotCovered: the terms have masses, and no shapes."""
        refuse_contacts(self.tree.data)
        return ""


def own_terms(tree: Tree, q: Array, v: Array, ctrl: Array | None = None) -> Terms:
    """Compute all terms at poses q (n, poses) with rates v (n, rates).

    The controls are `ctrl` (n, controls), by default those of the key.
    """
    motion = move_tree(tree, q, v, np.zeros_like(v))
    mass, bias = inertial_terms(tree, motion)
    lengths = [tendon_length(tree, motion, q, v, tendon) for tendon in tree.tendons]
    gaps, rows, drifts = equality_terms(tree, motion, lengths, q, v)
    force = spring_forces(tree, lengths, q, v) + actuators_on_joints(
        tree, motion, lengths, q, v, ctrl
    )
    if tree.reliefs.any():
        force = force + np.einsum("nbkr,bk->nr", centre_rows(tree, motion)[0], tree.reliefs)
    return Terms(mass, bias, force, gaps, tree.without_rounding(rows), drifts)


def centre_rows(tree: Tree, motion: TreeMotion) -> tuple[Array, Array]:
    """Jacobians of centres of mass and of the bodies' rotations (n, bodies, 3, rates) each."""
    centres = motion.at + (motion.turn @ tree.masses[1][..., None])[..., 0]
    axes, turning = motion.axes[:, None], tree.turns[:, None]
    moves = turning * cross3(axes, centres[:, :, None] - motion.anchors[:, None])
    moved = tree.moved[..., None]
    moves = moved * (moves + (1.0 - turning) * axes)
    return np.swapaxes(moves, 2, 3), np.swapaxes(moved * turning * axes, 2, 3)


def point_rows(tree: Tree, motion: TreeMotion, body: int, place: Array) -> Array:
    """Jacobian (n, 3, rates) of a point of a body at positions `place` (n, 3)."""
    arms = np.asarray(place)[:, None] - motion.anchors
    turning = tree.turns[:, None]
    rows = turning * cross3(motion.axes, arms) + (1.0 - turning) * motion.axes
    return np.swapaxes(rows * tree.moved[body][:, None], 1, 2)


def turn_rows(tree: Tree, motion: TreeMotion, body: int) -> Array:
    """Jacobian (n, 3, rates) of a body's rotation."""
    return np.swapaxes(motion.axes * (tree.turns * tree.moved[body])[:, None], 1, 2)


def inertial_terms(tree: Tree, motion: TreeMotion) -> tuple[Array, Array]:
    """Mass matrix and bias force of the bodies and of the armatures of the joints."""
    moves, spins = centre_rows(tree, motion)
    mass = tree.masses[0]
    inertia = motion.turn @ tree.masses[2] @ np.swapaxes(motion.turn, -1, -2)
    forces, moments = newton_euler_forces(tree, motion, inertia)
    n, rates = len(moves), moves.shape[-1]
    rows = np.concatenate([moves, spins], axis=2).reshape(n, -1, rates)
    loads = np.concatenate([mass[:, None, None] * moves, inertia @ spins], axis=2)
    matrix = np.swapaxes(rows, 1, 2) @ loads.reshape(n, -1, rates) + np.diag(tree.armature)
    balance = np.concatenate([forces, moments], axis=2).reshape(n, -1, 1)
    return matrix, (np.swapaxes(rows, 1, 2) @ balance)[..., 0]


def newton_euler_forces(tree: Tree, motion: TreeMotion, inertia: Array) -> tuple[Array, Array]:
    """Forces at the centres and moments about them that the motion of the bodies requires.

    Both are (n, bodies, 3); weights are subtracted from the forces.
    """
    arms = (motion.turn @ tree.masses[1][..., None])[..., 0]
    acceleration = motion.acceleration + cross3(motion.spin_rate, arms)
    acceleration = acceleration + cross3(motion.spin, cross3(motion.spin, arms))
    momentum = (inertia @ motion.spin[..., None])[..., 0]
    moments = (inertia @ motion.spin_rate[..., None])[..., 0] + cross3(motion.spin, momentum)
    return tree.masses[0][:, None] * (acceleration - tree.gravity), moments


@dataclass(frozen=True)
class TendonLength:
    """Lengths of a tendon, or values of a joint, at n poses.

    Attributes
    ----------
    value, rate : ndarray (n,)
        Lengths and their rates [m or rad, m/s or rad/s].
    rows : ndarray (n, rates)
        Jacobian of the lengths [SI].
    drift : ndarray (n,)
        Second time derivative at zero accelerations of the joints [m/s^2 or rad/s^2].
    """

    value: Array
    rate: Array
    rows: Array
    drift: Array


def tendon_length(
    tree: Tree, motion: TreeMotion, q: Array, v: Array, tendon: TendonData
) -> TendonLength:
    """Lengths of a tendon with their derivatives."""
    n = len(q)
    value, rate, drift, rows = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros_like(v)
    for j, share in tendon.terms:
        joint = tree.joints[j]
        value, rate = value + share * q[:, joint.pose], rate + share * v[:, joint.rate]
        rows[:, joint.rate] += share
    for (one, on_one), (two, on_two) in zip(tendon.points[:-1], tendon.points[1:], strict=True):
        if one == two:
            value = value + np.linalg.norm(on_two - on_one)
            continue
        difference = motion.point(two, on_two) - motion.point(one, on_one)
        speed = motion.point_velocity(two, on_two) - motion.point_velocity(one, on_one)
        change = motion.point_acceleration(two, on_two) - motion.point_acceleration(one, on_one)
        length = np.linalg.norm(difference, axis=1)
        along = difference / length[:, None]
        difference_rows = point_rows(tree, motion, two, motion.point(two, on_two))
        difference_rows = difference_rows - point_rows(tree, motion, one, motion.point(one, on_one))
        segment_rate = (along * speed).sum(axis=1)
        value, rate = value + length, rate + segment_rate
        rows = rows + np.einsum("nk,nkr->nr", along, difference_rows)
        drift = drift + (along * change).sum(axis=1)
        drift = drift + ((speed**2).sum(axis=1) - segment_rate**2) / length
    return TendonLength(value, rate, rows, drift)


def polynomial_values(coefficients: tuple[float, ...], x: Array) -> Array:
    """Values (n,) of a polynomial of x (n,), coefficient of the lowest power first."""
    return np.asarray(np.polynomial.polynomial.polyval(x, coefficients))


def spring_forces(tree: Tree, lengths: list[TendonLength], q: Array, v: Array) -> Array:
    """Generalized forces of springs and dampers (n, rates)."""
    speed = np.abs(v)
    force = -v * (tree.damping[:, 0] + speed * (tree.damping[:, 1] + speed * tree.damping[:, 2]))
    for joint in tree.joints:
        if any(joint.stiffness):
            stretch = joint_spring_stretch(joint, q[:, joint.pose :])
            stiffness = (
                polynomial_values(joint.stiffness, stretch)
                if stretch.shape[1] == 1
                else (joint.stiffness[0])
            )
            force[:, joint.rate : joint.rate + stretch.shape[1]] -= stiffness * stretch
    for tendon, length in zip(tree.tendons, lengths, strict=True):
        stretch, rate = tendon_stretch(tendon, length.value), length.rate
        pull = -stretch * polynomial_values(tendon.stiffness, stretch)
        pull = pull - rate * polynomial_values(tendon.damping, np.abs(rate))
        force = force + pull[:, None] * length.rows
    return np.asarray(force)


def actuator_forces(
    tree: Tree, lengths: list[TendonLength], q: Array, v: Array, ctrl: Array | None
) -> Iterator[tuple[ActuatorData, Array]]:
    """Iterate over the actuators on joints and tendons with their forces (n,) [N or N m]."""
    controls = tree.ctrl[None] if ctrl is None else ctrl
    for one in tree.actuators:
        if one.tendon < 0:
            value, rate = q[:, one.pose], v[:, one.rate]
        else:
            value, rate = lengths[one.tendon].value, lengths[one.tendon].rate
        yield one, one.force(controls[:, one.place], one.gear * value, one.gear * rate)


def actuators_on_joints(
    tree: Tree,
    motion: TreeMotion,
    lengths: list[TendonLength],
    q: Array,
    v: Array,
    ctrl: Array | None = None,
) -> Array:
    """Generalized forces of all actuators (n, rates), those on sites too, within their ranges."""
    found = loads_on_joints(tree, motion, ctrl)
    for one, force in actuator_forces(tree, lengths, q, v, ctrl):
        if one.tendon < 0:
            found[:, one.rate] += one.gear * force
        else:
            found += (one.gear * force)[:, None] * lengths[one.tendon].rows
    for joint in tree.joints:
        if joint.has_force_range:
            found[:, joint.rate] = np.clip(found[:, joint.rate], *joint.force_range)
    return found


def site_load_forces(
    tree: Tree, motion: TreeMotion, ctrl: Array | None
) -> Iterator[tuple[SiteLoad, Array, Array]]:
    """Iterate over loads on sites with forces [N] and moments [N m] (n, 3), in world axes."""
    controls = tree.ctrl[None] if ctrl is None else ctrl
    for load in tree.site_loads:
        size = load.actuator.force(controls[:, load.actuator.place])[:, None]
        push, twist = (
            np.broadcast_to(size * part, (len(motion.at), 3)) for part in (load.force, load.moment)
        )
        if load.follows:
            turn = motion.turn[:, load.body]
            push, twist = (np.einsum("nij,nj->ni", turn, part) for part in (push, twist))
        yield load, push, twist


def loads_on_joints(tree: Tree, motion: TreeMotion, ctrl: Array | None) -> Array:
    """Generalized forces of the loads on sites (n, rates)."""
    found = np.zeros(motion.axes.shape[:2])
    for load, push, twist in site_load_forces(tree, motion, ctrl):
        rows = point_rows(tree, motion, load.body, motion.point(load.body, load.at))
        found = found + np.einsum("ni,nir->nr", push, rows)
        found = found + np.einsum("ni,nir->nr", twist, turn_rows(tree, motion, load.body))
    return found


def joint_spring_stretch(joint: JointData, own: Array) -> Array:
    """Stretch of a joint's spring (n, rates of the joint) [m, rad], by poses from it on."""
    rest = joint.rest
    if joint.is_scalar:
        return np.asarray(own[:, :1] - rest)
    turn = rotation_vector(
        quaternion_product(
            quaternion_conjugate(rest[-4:]),
            normalize_quaternions(own[:, rest.size - 4 : rest.size]),
        )
    )
    if joint.kind == JointKind.BALL:
        return turn
    return np.concatenate([own[:, :3] - rest[:3], turn], axis=1)


def tendon_stretch(tendon: TendonData, length: Array) -> Array:
    """Stretch of a tendon's spring (n,): distance of lengths from the slack range [m or rad]."""
    low, high = tendon.slack
    return np.asarray(np.where(length > high, length - high, np.minimum(length - low, 0.0)))


def equality_terms(
    tree: Tree, motion: TreeMotion, lengths: list[TendonLength], q: Array, v: Array
) -> tuple[Array, Array, Array]:
    """Violations, Jacobian and drifts of all equalities: loops first, then ties."""
    found = [loop_terms(tree, motion, loop) for loop in tree.loops]
    found += [tie_terms(tree, lengths, tie, q, v) for tie in tree.ties]
    n, rates = v.shape
    if not found:
        return np.zeros((n, 0)), np.zeros((n, 0, rates)), np.zeros((n, 0))
    gaps, rows, drifts = (np.concatenate(parts, axis=1) for parts in zip(*found, strict=True))
    return gaps, rows, drifts


def loop_terms(tree: Tree, motion: TreeMotion, loop: LoopData) -> tuple[Array, Array, Array]:
    """Violations (n, k), Jacobian (n, k, rates) and drifts (n, k) of a connect or a weld."""
    one, two = loop.one, loop.two
    places = motion.point(one, loop.on_one), motion.point(two, loop.on_two)
    rows = point_rows(tree, motion, one, places[0]) - point_rows(tree, motion, two, places[1])
    drift = motion.point_acceleration(two, loop.on_two)
    drift = drift - motion.point_acceleration(one, loop.on_one)
    if loop.turns is None:
        return places[0] - places[1], rows, drift
    first, second = weld_turns(motion, loop)
    spin = motion.spin[:, one] - motion.spin[:, two]

    def vector_part(left: Array, right: Array) -> Array:
        """Vector part of second * left * right * first; left and right are pure quaternions."""
        return quaternion_product(
            quaternion_product(second, left), quaternion_product(right, first)
        )[:, 1:]

    gap, slope = quaternion_product(second, first)[:, 1:], weld_slope(motion, loop)
    rotation_rows = slope @ (turn_rows(tree, motion, one) - turn_rows(tree, motion, two))
    rate = motion.spin_rate[:, one] - motion.spin_rate[:, two]
    change = (slope @ rate[..., None])[..., 0]
    change = change + 0.25 * vector_part(as_quaternions(spin), as_quaternions(motion.spin[:, one]))
    change = change - 0.25 * vector_part(as_quaternions(motion.spin[:, two]), as_quaternions(spin))
    return (
        np.concatenate([places[0] - places[1], loop.scale * gap], axis=1),
        np.concatenate([rows, loop.scale * rotation_rows], axis=1),
        np.concatenate([drift, -loop.scale * change], axis=1),
    )


def weld_turns(motion: TreeMotion, loop: LoopData) -> tuple[Array, Array]:
    """Quaternions (n, 4) of a weld's axes: on the first body, and conjugate on the second."""
    assert loop.turns is not None
    first = quaternion_product(motion.quaternion[:, loop.one], loop.turns[0])
    return first, quaternion_conjugate(
        quaternion_product(motion.quaternion[:, loop.two], loop.turns[1])
    )


def weld_slope(motion: TreeMotion, loop: LoopData) -> Array:
    """Derivatives (n, 3, 3) of a weld's violation of axes by rotations of its first body."""
    first, second = weld_turns(motion, loop)
    columns = [
        quaternion_product(
            second, quaternion_product(as_quaternions(np.tile(axis, (len(first), 1))), first)
        )[:, 1:]
        for axis in np.eye(3)
    ]
    return np.asarray(0.5 * np.stack(columns, axis=-1))


def as_quaternions(vectors: Array) -> Array:
    """Vectors (n, 3) as quaternions (n, 4) with scalar part 0."""
    return np.concatenate([np.zeros((len(vectors), 1)), vectors], axis=1)


def tie_terms(
    tree: Tree, lengths: list[TendonLength], tie: TieData, q: Array, v: Array
) -> tuple[Array, Array, Array]:
    """Violation (n, 1), Jacobian (n, 1, rates) and drift (n, 1) of a joint or tendon equality."""

    def value(number: int) -> tuple[TendonLength, float]:
        if tie.tendons:
            return lengths[number], tree.tendons[number].zero
        joint, rows = tree.joints[number], np.zeros_like(v)
        rows[:, joint.rate] = 1.0
        one = TendonLength(q[:, joint.pose], v[:, joint.rate], rows, np.zeros(len(q)))
        return one, joint.zero

    one, zero = value(tie.one)
    if tie.two < 0:
        gap = one.value - zero - tie.polynomial[0]
        return gap[:, None], one.rows[:, None], -one.drift[:, None]
    two, rest = value(tie.two)
    curve = np.polynomial.Polynomial(tie.polynomial)
    x = two.value - rest
    slope, curvature = curve.deriv()(x), curve.deriv(2)(x)
    return (
        (one.value - zero - curve(x))[:, None],
        (one.rows - slope[:, None] * two.rows)[:, None],
        (curvature * two.rate**2 + slope * two.drift - one.drift)[:, None],
    )
