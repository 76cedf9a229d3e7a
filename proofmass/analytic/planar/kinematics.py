"""Positions and motions of bodies and points, and closure of the loops of a mechanism.

A hinge at a turns by w: ``z -> a + w (z - a)``.  A slide along u moves by s: ``z -> z + s u``.  The
displacement of a body is the product of its parent's and of its joints' in their order; rates and
accelerations follow by differentiating that product once and twice.

Newton's method closes the loops of one pose, or of many at once.  Joint values have the units
`Mechanism.scale` and the loops the units `Mechanism.loop_units`, so that one tolerance serves for
both.
"""

from contextlib import suppress
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np

from proofmass.analytic.numerics import CannotAssemble, SingularHere, without_rounding
from proofmass.analytic.planar.mechanism import (
    Coupling,
    Mechanism,
    Overconstrained,
)
from proofmass.analytic.start import start_pose, start_rates
from proofmass.base.arrays import Array, Complex, Index


@dataclass(frozen=True)
class BodyMotion:
    """Displacements of all bodies in n poses, with up to two time derivatives.

    Attributes
    ----------
    w, t : tuples of ndarray (bodies, n), complex
        Rotation factor w [1] and shift t [m] of ``z -> w z + t``, and their first and second time
        derivatives as far as rates and accelerations were given.
    turn : tuple of ndarray (bodies, n)
        Angle since the reference pose [rad], angular velocity [rad/s] and acceleration [rad/s^2].
    place : ndarray (joints, n), complex
        Position of each hinge [m], or direction of each slide [1].
    """

    w: tuple[Complex, ...]
    t: tuple[Complex, ...]
    turn: tuple[Array, ...]
    place: Complex

    def point(self, body: int, z: complex, order: int = 0) -> Complex:
        """Position of a point of a body, z in the reference pose; or its derivative of an order."""
        return np.asarray(self.w[order][body] * z + self.t[order][body])

    def points(self, bodies: Index, z: Complex, order: int = 0) -> Complex:
        """Positions (k, n) of points z (k, 1) of bodies (k,), or their derivatives of an order."""
        return np.asarray(self.w[order][bodies] * z + self.t[order][bodies])


def move_bodies(
    m: Mechanism, q: Array, v: Array | None = None, a: Array | None = None
) -> BodyMotion:
    """Find the motion of all bodies from that of the joints.

    Parameters
    ----------
    m : Mechanism
    q, v, a : ndarray (n, joints)
        Joint values, rates and accelerations [rad or m, per s, per s^2]; accelerations, or both
        these and rates, may be left out.

    Returns
    -------
    BodyMotion
    """
    f, joint = m.frames, [part.T for part in (q - m.zeros, v, a) if part is not None]
    turn = [f.turning @ part for part in joint]
    w = [np.exp(1j * turn[0])]
    if len(joint) > 1:
        w.append(1j * turn[1] * w[0])
    if len(joint) > 2:
        w.append((1j * turn[2] - turn[1] ** 2) * w[0])
    t = [f.shift @ part for part in w]
    if f.slides.size:
        s, along = [part[f.slides] for part in joint], [f.directions @ part for part in w]
        for k in range(len(joint)):
            t[k] += f.sliding @ sum(comb(k, i) * along[k - i] * s[i] for i in range(k + 1))
    place = w[0][f.before] * f.places
    place = np.where(m.hinges[:, None], place + t[0][f.before], place)
    return BodyMotion(
        tuple(part[f.body] for part in w),
        tuple(part[f.body] for part in t),
        tuple(part[f.body] for part in turn),
        place,
    )


def jacobian(m: Mechanism, motion: BodyMotion, bodies: Index, points: Complex) -> Complex:
    """Derivatives of points (k, n) of bodies (k,) by the joints (n, k, joints)."""
    place = motion.place.T[:, None]
    columns = np.where(m.hinges, 1j * m.signs * (points.T[..., None] - place), place)
    return np.asarray(columns * m.moved_by[bodies])


def linearise_loops(m: Mechanism, q: Array) -> tuple[Array, Array]:
    """Find the loops' constraint violations, and their derivatives by the joints.

    Parameters
    ----------
    m : Mechanism
    q : ndarray (n, joints)
        Joint values [rad or m].

    Returns
    -------
    violations : ndarray (n, rows)
        x and y of each pin [m], then couplings [rad or m].
    jacobian : ndarray (n, rows, joints)
    """
    n, joints = q.shape
    moved, pins = q - m.zeros, m.pin_equations
    size, angle = _term_sizes(m, moved, 1.0), moved @ pins.turning
    terms = np.concatenate([size * np.cos(angle), size * np.sin(angle)], axis=1)
    rows = (terms @ pins.linear).reshape(n, 2 * len(m.pins), 1 + joints)
    if m.couplings:
        couplings = [_linearise_coupling(c, moved) for c in m.couplings]
        rows = np.concatenate([rows, np.stack(couplings, axis=1)], axis=1)
    return rows[..., 0], rows[..., 1:]


def loop_violations(m: Mechanism, q: Array) -> Array:
    """Constraint violations of the loops (n, rows): x and y of each pin [m], then couplings."""
    return linearise_loops(m, q)[0]


def loop_jacobian(m: Mechanism, q: Array) -> Array:
    """Derivatives of the constraint violations by the joints (n, rows, joints)."""
    return linearise_loops(m, q)[1]


def loop_bias(m: Mechanism, q: Array, v: Array) -> Array:
    """Second time derivative of the violations when the joints do not accelerate (n, rows)."""
    moved, pins = q - m.zeros, m.pin_equations
    angle, rate = moved @ pins.turning, v @ pins.turning
    size, growth = _term_sizes(m, moved, 1.0), _term_sizes(m, v, 0.0)
    terms = (2j * growth * rate - size * rate**2) * np.exp(1j * angle)
    offsets = terms @ pins.offsets
    bias = np.empty((len(q), m.rows))
    last = 2 * len(m.pins)
    bias[:, 0:last:2], bias[:, 1:last:2] = offsets.real, offsets.imag
    for k, c in enumerate(m.couplings, last):
        bend = np.polynomial.Polynomial(c.polynomial).deriv(2)(weighted_sum(c.two, q - m.zeros))
        bias[:, k] = -bend * weighted_sum(c.two, v) ** 2
    return bias


def largest_violation(m: Mechanism, q: Array) -> tuple[float, str]:
    """Largest constraint violation of one pose [m, or rad of a coupling], and a text with its loop.

    It is the largest in `Mechanism.loop_units`.  The text names the loop, and has the violation
    with its unit.
    """
    r = loop_violations(m, q[None])[0]
    last = 2 * len(m.pins)
    violations = np.append(np.hypot(r[0:last:2], r[1:last:2]), np.abs(r[last:]))
    units = np.append(m.loop_units[0:last:2], m.loop_units[last:])
    worst = int(np.argmax(violations / units))
    violation, unit = float(violations[worst]), "m"
    if worst >= len(m.pins):
        coupling = m.couplings[worst - len(m.pins)]
        joint = (*coupling.one, *coupling.two)[0][0]
        unit = "rad" if m.hinges[joint] else "m"
    return violation, f"loop {m.loop_names[worst]!r} stays open by {violation:.3g} {unit}"


def lipschitz(m: Mechanism, q: Array) -> Array:
    """Lipschitz bounds (n,) of the Jacobian by the joints near poses q (n, joints).

    They are in units of `Mechanism.scale`.  The second derivative of a point by two hinges is its
    distance from the outer hinge, by a hinge and a slide further out 1, and by two slides 0.  The
    bounds hold while slides move by at most half the mechanism's size.
    """
    total = np.zeros(len(q))
    extended = q + np.where(m.hinges, 0.0, 0.5 * m.size * np.where(q < m.zeros, -1.0, 1.0))
    for p in m.pins:
        for body, point in ((p.one, p.on_one), (p.two, p.on_two)):
            chain, reach = m.chain(body), m.reach(body, point, extended)[..., :-1] / m.size
            hinge, order = m.hinges[chain], np.arange(len(chain))
            both = np.outer(hinge, hinge) * reach[..., np.maximum.outer(order, order)]
            mixed = hinge[:, None] & ~hinge & (order[:, None] < order)
            total += np.linalg.norm(both + mixed + mixed.T, 2, axis=(1, 2)) if chain else 0.0
    for c, unit in zip(m.couplings, m.loop_units[2 * len(m.pins) :], strict=True):
        curved = float(np.abs(np.polynomial.Polynomial(c.polynomial).deriv(2).coef).sum())
        total += curved * float(sum((share * m.scale[j]) ** 2 for j, share in c.two)) / unit
    return total


def _term_sizes(m: Mechanism, joint: Array, of_frames: float) -> Array:
    """Sizes (n, terms) of the terms of `PinEquations`, or their rates, from those of the joints."""
    frames = np.full((len(joint), len(m.frames.turning)), of_frames)
    return np.concatenate([frames, joint[:, m.frames.slides]], axis=1)


def _linearise_coupling(c: Coupling, moved: Array) -> Array:
    """Violation of a coupling, and its derivatives by the joints (n, 1 + joints)."""
    rows, two = np.zeros((len(moved), 1 + moved.shape[1])), weighted_sum(c.two, moved)
    curve = np.polynomial.Polynomial(c.polynomial)
    rows[:, 0] = weighted_sum(c.one, moved) - curve(two)
    for joint, share in c.one:
        rows[:, 1 + joint] += share
    slope = curve.deriv()(two)
    for joint, share in c.two:
        rows[:, 1 + joint] -= share * slope
    return rows


def weighted_sum(weights: tuple[tuple[int, float], ...], values: Array) -> Array:
    """Weighted sum (n,) of joint values (n, joints); `weights` has joint numbers and weights."""
    return np.asarray(sum((share * values[:, j] for j, share in weights), np.zeros(len(values))))


RANK_TOLERANCE = 1e-9
"""Singular values below this share of the largest count as zero."""
CLOSING_TOLERANCE = 1e-12
"""Constraint violation, in `Mechanism.loop_units`, below which a loop is closed up to rounding."""
BLOCK_SIZE = 4096
"""Number of poses solved at once: their arrays stay in the processor's cache."""


@dataclass(frozen=True)
class Drives:
    """Indices of the joints that are driven, and of those that follow."""

    driven: Index
    following: Index

    @classmethod
    def of(cls, m: Mechanism, names: tuple[str, ...]) -> "Drives":
        """Find the driven joints by name."""
        joint_names = [j.name for j in m.joints]
        for name in names:
            if name not in joint_names:
                raise ValueError(f"no joint {name!r}; there are: {', '.join(joint_names)}")
        driven = np.array([joint_names.index(name) for name in names], np.intp)
        return cls(driven, np.setdiff1d(np.arange(len(joint_names)), driven))


def scaled_jacobian(m: Mechanism, q: Array) -> Array:
    """Jacobian of the loops in `Mechanism.loop_units` and `Mechanism.scale` (n, rows, joints)."""
    return loop_jacobian(m, q) * m.scale / m.loop_units[:, None]


def scaled_violations(m: Mechanism, q: Array) -> Array:
    """Largest constraint violation of each pose (n,), in `Mechanism.loop_units`."""
    found = loop_violations(m, q) / m.loop_units
    return np.asarray(np.abs(found).max(axis=-1, initial=0.0))


def close_loops(m: Mechanism, q: Array, d: Drives, steps: int = 12) -> Array:
    """Close the loops of poses (n, joints) by moving the joints that follow; drives stay fixed.

    The last step is smaller than 1e-8, so by quadratic convergence its error is rounding.

    Raises
    ------
    SingularHere
        The Jacobian is singular.
    CannotAssemble
        Newton's method does not converge; the message has the constraint violation.
    """
    q = q.copy()
    for k in range(0, len(q), BLOCK_SIZE):
        block = q[k : k + BLOCK_SIZE]
        violations = iterate_newton(m, block, d, steps)
        if not violations.max(initial=0.0) < CLOSING_TOLERANCE:
            worst = int(np.argmax(np.where(np.isfinite(violations), violations, np.inf)))
            raise CannotAssemble(largest_violation(m, block[worst])[1])
    return q


def iterate_newton(m: Mechanism, q: Array, d: Drives, steps: int) -> Array:
    """Apply Newton's method to poses (n, joints) in place; return `scaled_violations`."""
    for _ in range(steps):
        violations, matrix = linearise_loops(m, q)
        matrix = matrix[..., d.following] * m.scale[d.following]
        try:
            step = np.linalg.solve(matrix, violations[..., None])[..., 0]
        except np.linalg.LinAlgError:
            raise SingularHere("the loops' Jacobian is singular") from None
        q[:, d.following] -= step * m.scale[d.following]
        if not np.abs(step).max(initial=0.0) > 1e-8:
            break
    return scaled_violations(m, q)


NO_JOINTS, NO_VALUES = np.zeros(0, np.intp), np.zeros(0)
"""Defaults of joints with given values, and of these values."""


@dataclass(frozen=True)
class StartOfLinkage:
    """Loops and driven joints of a linkage, for `proofmass.analytic.start`."""

    m: Mechanism
    key: Array
    joints: Index

    @property
    def sizes(self) -> Array:
        """Units of the joints (joints,): 1 rad, or the size of the mechanism [m]."""
        return self.m.scale

    def prescribed(self, q: Array) -> tuple[Array, Array]:
        """Violations of the loops, then values of the drives, and their Jacobian."""
        units = np.eye(len(q))[self.joints]
        (violations,), (rows,) = linearise_loops(self.m, q[None])
        rows = without_rounding(rows, self.m.scale / self.m.loop_units[:, None])
        found = np.concatenate([violations, q[self.joints]])
        return found, np.concatenate([rows, units])

    def moved(self, q: Array, move: Array) -> Array:
        """The pose that a move leads to."""
        return q + move

    def way(self, q: Array) -> Array:
        """The move from the key to a pose."""
        return q - self.key


def nearest_pose(
    m: Mechanism, q: Array, joints: Index = NO_JOINTS, values: Array = NO_VALUES
) -> Array:
    """Find the closed pose (joints,) nearest to a pose q; see `proofmass.analytic.start`.

    The joints with numbers `joints` get the given `values`.
    """
    with suppress(CannotAssemble):
        found = start_pose(StartOfLinkage(m, q, joints), values)
        if scaled_violations(m, found[None])[0] < CLOSING_TOLERANCE:
            return found
    from scipy.optimize import least_squares  # slow to load

    best = least_squares(lambda q: loop_violations(m, q[None])[0], m.start)
    raise CannotAssemble(
        f"cannot be assembled from the start pose: {largest_violation(m, best.x)[1]} at best"
    )


def nearest_rates(
    m: Mechanism, q: Array, v: Array, joints: Index = NO_JOINTS, rates: Array = NO_VALUES
) -> Array:
    """Find the rates (joints,) nearest to v that keep the loops of a closed pose closed.

    The joints with numbers `joints` get given rates.
    """
    _, rows = StartOfLinkage(m, q, joints).prescribed(q)
    return start_rates(rows, v, np.concatenate([np.zeros(m.rows), rates]))


def count_dof(m: Mechanism, q: Array) -> int:
    """Degrees of freedom at a closed pose (joints,): joints less independent loop equations.

    Since a singular pose has a lower rank too, the rank is then taken at a closed pose near it.

    Raises
    ------
    Overconstrained
        The loop equations are not independent.
    """
    for _ in range(3):
        matrix = scaled_jacobian(m, q[None])[0]
        _, values, directions = np.linalg.svd(matrix)
        rank = int((values > RANK_TOLERANCE * max(values.max(initial=0.0), RANK_TOLERANCE)).sum())
        if rank == m.rows:
            return len(m.joints) - m.rows
        q = nearest_pose(m, q + 0.03 * directions[rank:].sum(axis=0) * m.scale)
    names = ", ".join(map(repr, m.loop_names))
    raise Overconstrained(
        f"over-constrained: the loops {names} give {m.rows} equations, of which "
        f"only {rank} are independent; take a loop or a part out"
    )


def joint_rates(
    m: Mechanism, q: Array, d: Drives, rate: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Rates and accelerations of all joints (n, joints) in closed poses, from those of the drives.

    Raises
    ------
    SingularHere
        The drives do not determine them at one of the poses.
    """
    v, a = np.zeros_like(q), np.zeros_like(q)
    v[:, d.driven], a[:, d.driven] = rate, acceleration
    for k in range(0, len(q), BLOCK_SIZE):
        _fill_joint_rates(m, d, *(x[k : k + BLOCK_SIZE] for x in (q, v, a)))
    return v, a


def _fill_joint_rates(m: Mechanism, d: Drives, q: Array, v: Array, a: Array) -> None:
    """Fill in the rates and accelerations of the joints that follow, (n, joints), in place."""
    matrix = loop_jacobian(m, q)
    try:
        solve = np.linalg.inv(matrix[..., d.following])
    except np.linalg.LinAlgError:
        raise SingularHere("the drives do not determine the rates at one of the poses") from None
    v[:, d.following] = -_matrix_times(solve, _matrix_times(matrix[..., d.driven], v[:, d.driven]))
    drift = loop_bias(m, q, v)
    a[:, d.following] = -_matrix_times(
        solve, _matrix_times(matrix[..., d.driven], a[:, d.driven]) + drift
    )


def condition_numbers(m: Mechanism, q: Array, d: Drives) -> Array:
    """Condition numbers of closed poses (n,), by which rounding grows; infinite where singular."""
    if not d.following.size:
        return np.ones(len(q))
    return np.asarray(np.linalg.cond(scaled_jacobian(m, q)[..., d.following]))


def _matrix_times(matrix: Any, vector: Any) -> Array:
    return np.asarray((matrix @ vector[..., None])[..., 0])
