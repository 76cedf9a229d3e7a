"""Where bodies and points are, how they move, and how the loops of a mechanism are closed.

A hinge at a turns by w: ``z -> a + w (z - a)``.  A slide along u moves by s: ``z -> z + s u``.  A
body's displacement is its parent's, then its joints' in order; rates and accelerations follow by
differentiating that product once and twice.

Newton's method closes the loops of one pose, or of many at once.  Joint values are measured in
`Mechanism.scale` and the loops in `Mechanism.size`, so that one number is small or large for both.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from proofmass.analytic.numerics import Array, Complex, Index
from proofmass.analytic.planar.mechanism import (
    CannotAssemble,
    Mechanism,
    Overconstrained,
    SingularHere,
)


@dataclass(frozen=True)
class BodyMotion:
    """Displacements of all bodies in n poses, with their first two time derivatives.

    Attributes
    ----------
    w, t : tuples of ndarray (bodies, n), complex
        Turn and shift; rate and acceleration of them.
    turn : ndarray (bodies, n)
        Angle since the reference pose [rad]; the same for `spin` [rad/s], `spin_rate` [rad/s2].
    place : ndarray (joints, n), complex
        Where each hinge is, or the direction of each slide.
    """

    w: tuple[Complex, Complex, Complex]
    t: tuple[Complex, Complex, Complex]
    turn: tuple[Array, Array, Array]
    place: Complex

    def point(self, body: int, z: complex, order: int = 0) -> Complex:
        """A point of a body, z in the reference pose; its velocity or its acceleration."""
        return np.asarray(self.w[order][body] * z + self.t[order][body])


def move(m: Mechanism, q: Array, v: Array | None = None, a: Array | None = None) -> BodyMotion:
    """Move a mechanism.

    Parameters
    ----------
    m : Mechanism
    q, v, a : ndarray (n, joints)
        Joint values, rates and accelerations; zero rates and accelerations when left out.

    Returns
    -------
    Motion
    """
    n, orders = len(q), 1 + (v is not None) + (a is not None)
    shape = len(m.bodies), n
    w = [np.ones(shape, complex), np.zeros(shape, complex), np.zeros(shape, complex)]
    t = [np.zeros(shape, complex) for _ in range(3)]
    turn = [np.zeros(shape) for _ in range(3)]
    place = np.empty((len(m.joints), n), complex)
    joint = [part.T for part in (q - m.zeros, v, a) if part is not None]
    for b, body in enumerate(m.bodies[1:], 1):
        for part in (w, t, turn):
            for x in part[:orders]:
                x[b] = x[body.parent]
        for j in body.joints:
            moved = [x[j] for x in joint]
            (_hinge if m.joints[j].hinge else _slide)(m, j, b, moved, w, t, turn, place)
    return BodyMotion((w[0], w[1], w[2]), (t[0], t[1], t[2]), (turn[0], turn[1], turn[2]), place)


def _hinge(
    m: Mechanism,
    j: int,
    b: int,
    moved: list[Array],
    w: list[Complex],
    t: list[Complex],
    turn: list[Array],
    place: Complex,
) -> None:
    at, sign, orders = m.joints[j].place, m.joints[j].sign, len(moved)
    before = [w[k][b] * at + t[k][b] for k in range(orders)]
    for k in range(orders):
        turn[k][b] += sign * moved[k]
    place[j] = before[0]
    w[0][b] *= np.exp(1j * sign * moved[0])
    if orders > 1:
        w[1][b] = 1j * turn[1][b] * w[0][b]
    if orders > 2:
        w[2][b] = (1j * turn[2][b] - turn[1][b] ** 2) * w[0][b]
    for k in range(orders):  # the hinge itself does not move with the child's turning
        t[k][b] = before[k] - w[k][b] * at


def _slide(
    m: Mechanism,
    j: int,
    b: int,
    moved: list[Array],
    w: list[Complex],
    t: list[Complex],
    turn: list[Array],
    place: Complex,
) -> None:
    along = [w[k][b] * m.joints[j].place for k in range(len(moved))]
    place[j] = along[0]
    t[0][b] += along[0] * moved[0]
    if len(moved) > 1:
        t[1][b] += along[1] * moved[0] + along[0] * moved[1]
    if len(moved) > 2:
        t[2][b] += along[2] * moved[0] + 2 * along[1] * moved[1] + along[0] * moved[2]


def jacobian(m: Mechanism, motion: BodyMotion, body: int, point: Complex) -> Complex:
    """Derivatives of a point (n,) of a body, seen where it is, by the joints (n, joints)."""
    hinged = 1j * m.signs[:, None] * (point - motion.place)
    columns = np.where(m.hinges[:, None], hinged, motion.place)
    return np.asarray((m.moved_by[body][:, None] * columns).T)


def residual(m: Mechanism, motion: BodyMotion, q: Array) -> Array:
    """How far the loops are open (n, rows): x and y of each pin [m], then the couplings."""
    return _stack(
        m,
        [_apart(m, motion, k, 0) for k in range(len(m.pins))],
        [_coupling(m, q, k) for k in range(len(m.couplings))],
        len(q),
    )


def loop_jacobian(m: Mechanism, motion: BodyMotion, q: Array) -> Array:
    """Derivatives of the residual by the joints (n, rows, joints)."""
    pins = [
        jacobian(m, motion, p.one, motion.point(p.one, p.on_one))
        - jacobian(m, motion, p.two, motion.point(p.two, p.on_two))
        for p in m.pins
    ]
    couplings = []
    for c in m.couplings:
        row = np.zeros_like(q)
        row[:, c.one] = 1.0
        if c.two >= 0:
            slope = np.polynomial.Polynomial(c.polynomial).deriv()
            row[:, c.two] -= slope(q[:, c.two] - m.joints[c.two].zero)
        couplings.append(row)
    return _stack(m, pins, couplings, *q.shape)


def bias(m: Mechanism, motion: BodyMotion, q: Array, v: Array) -> Array:
    """Second time derivative of the residual when the joints do not accelerate (n, rows)."""
    couplings = []
    for c in m.couplings:
        bend = np.polynomial.Polynomial(c.polynomial).deriv(2)
        couplings.append(
            -bend(q[:, c.two] - m.joints[c.two].zero) * v[:, c.two] ** 2
            if c.two >= 0
            else np.zeros(len(q))
        )
    return _stack(m, [_apart(m, motion, k, 2) for k in range(len(m.pins))], couplings, len(q))


def gap(m: Mechanism, q: Array) -> tuple[float, str]:
    """The widest open loop of one pose: by how much [m, or rad of a coupling], and its name."""
    r = residual(m, move(m, q[None]), q[None])[0]
    pins = np.hypot(r[0 : 2 * len(m.pins) : 2], r[1 : 2 * len(m.pins) : 2])
    open_by = np.append(pins, np.abs(r[2 * len(m.pins) :]))
    worst = int(np.argmax(open_by))
    return float(open_by[worst]), m.loop_names[worst]


def lipschitz(m: Mechanism, q: Array) -> float:
    """A bound of the change of the Jacobian with the joints near q, in units of `Mechanism.scale`.

    The second derivative of a point by two hinges is its distance from the outer one, by a hinge
    and a slide further out 1, by two slides 0; slides may move by half the mechanism's size.
    """
    total = 0.0
    out = q + np.where(m.hinges, 0.0, 0.5 * m.size * np.where(q < m.zeros, -1.0, 1.0))
    for p in m.pins:
        for body, point in ((p.one, p.on_one), (p.two, p.on_two)):
            chain, reach = m.chain(body), m.reach(body, point, out)[:-1] / m.size
            hinge, order = m.hinges[chain], np.arange(len(chain))
            both = np.outer(hinge, hinge) * reach[np.maximum.outer(order, order)]
            mixed = hinge[:, None] & ~hinge & (order[:, None] < order)
            total += float(np.linalg.norm(both + mixed + mixed.T, 2)) if chain else 0.0
    for c in m.couplings:
        total += float(np.abs(np.polynomial.Polynomial(c.polynomial).deriv(2).coef).sum())
    return total


def _apart(m: Mechanism, motion: BodyMotion, k: int, order: int) -> Complex:
    p = m.pins[k]
    return motion.point(p.one, p.on_one, order) - motion.point(p.two, p.on_two, order)


def _coupling(m: Mechanism, q: Array, k: int) -> Array:
    c, other = m.couplings[k], np.zeros(len(q))
    if c.two >= 0:
        other = q[:, c.two] - m.joints[c.two].zero
    return np.asarray(
        q[:, c.one] - m.joints[c.one].zero - np.polynomial.Polynomial(c.polynomial)(other)
    )


def _stack(m: Mechanism, pins: list[Complex], couplings: list[Array], n: int, *more: int) -> Array:
    rows = np.empty((n, m.rows, *more))
    for k, apart in enumerate(pins):
        rows[:, 2 * k], rows[:, 2 * k + 1] = apart.real, apart.imag
    for k, value in enumerate(couplings):
        rows[:, 2 * len(pins) + k] = value
    return rows


RANK = 1e-9
"""Singular values below this share of the largest count as zero."""
CLOSED = 1e-12
"""Loops that are open by less, in sizes of the mechanism, are closed: rounding of their sums."""
BLOCK = 4096
"""Poses solved at once: their arrays stay in the processor's cache."""


@dataclass(frozen=True)
class Drives:
    """Which joints are driven and which follow."""

    driven: Index
    following: Index

    @classmethod
    def of(cls, m: Mechanism, names: tuple[str, ...]) -> "Drives":
        """Find the driven joints by name."""
        there = [j.name for j in m.joints]
        for name in names:
            if name not in there:
                raise ValueError(f"no joint {name!r}; there are: {', '.join(there)}")
        driven = np.array([there.index(name) for name in names], np.intp)
        return cls(driven, np.setdiff1d(np.arange(len(there)), driven))


def scaled_jacobian(m: Mechanism, q: Array) -> Array:
    """Jacobian of the loops in their own units (n, rows, joints)."""
    return loop_jacobian(m, move(m, q), q) * m.scale / m.size


def newton(m: Mechanism, q: Array, d: Drives, steps: int = 12) -> Array:
    """Close the loops of poses (n, joints) by moving the joints that follow; drives stay.

    The last step is smaller than 1e-8, so by quadratic convergence its error is rounding.

    Raises
    ------
    SingularHere
        The Jacobian has lost its rank.
    CannotAssemble
        No convergence; says how far the loops stay open.
    """
    q = q.copy()
    for k in range(0, len(q), BLOCK):
        _close(m, q[k : k + BLOCK], d, steps)
    return q


def _close(m: Mechanism, q: Array, d: Drives, steps: int) -> None:
    """Newton's method on poses (n, joints), in place."""
    for _ in range(steps):
        motion = move(m, q)
        matrix = (loop_jacobian(m, motion, q) * m.scale)[..., d.following]
        try:
            step = np.linalg.solve(matrix, residual(m, motion, q)[..., None])[..., 0]
        except np.linalg.LinAlgError:
            raise SingularHere("the loops' Jacobian is singular") from None
        q[:, d.following] -= step * m.scale[d.following]
        if not np.abs(step).max(initial=0.0) > 1e-8:
            break
    left = np.abs(residual(m, move(m, q), q)).max(axis=-1, initial=0.0) / m.size
    if not left.max(initial=0.0) < CLOSED:
        open_by, name = gap(m, q[int(np.argmax(np.where(np.isfinite(left), left, np.inf)))])
        raise CannotAssemble(f"loop {name!r} stays open by {open_by:.3g} m")


def nearest(m: Mechanism, q: Array) -> Array:
    """Close the loops of one pose (joints,) with the least change of all its joints [rad, m]."""
    for _ in range(50):
        motion = move(m, q[None])
        open_by = residual(m, motion, q[None])[0]
        step = np.linalg.lstsq(loop_jacobian(m, motion, q[None])[0], open_by, rcond=RANK)[0]
        q = q - step
        if not np.abs(step).max(initial=0.0) > 1e-14:
            break
    if m.rows and not gap(m, q)[0] < CLOSED * m.size:
        from scipy.optimize import least_squares  # slow to load

        best = least_squares(lambda q: residual(m, move(m, q[None]), q[None])[0], m.start)
        open_by, name = gap(m, best.x)
        raise CannotAssemble(
            f"cannot be assembled from the start pose: loop {name!r} stays open "
            f"by {open_by:.3g} m at best"
        )
    return q


def fitting(m: Mechanism, q: Array, v: Array) -> Array:
    """Rates (joints,) that keep the loops of a closed pose closed, with the least change of v."""
    matrix = loop_jacobian(m, move(m, q[None]), q[None])[0]
    return np.asarray(v - np.linalg.lstsq(matrix, matrix @ v, rcond=RANK)[0])


def freedoms(m: Mechanism, q: Array) -> int:
    """Mobility of a closed pose (joints,): joints less independent loop equations.

    The rank is low at a singular pose too, so a neighbour that the mechanism can reach decides.

    Raises
    ------
    Overconstrained
        The loops hold a direction twice.
    """
    for _ in range(3):
        matrix = scaled_jacobian(m, q[None])[0]
        _, values, directions = np.linalg.svd(matrix)
        rank = int((values > RANK * max(values.max(initial=0.0), RANK)).sum())
        if rank == m.rows:
            return len(m.joints) - m.rows
        q = nearest(m, q + 0.03 * directions[rank:].sum(axis=0) * m.scale)
    names = ", ".join(map(repr, m.loop_names))
    raise Overconstrained(
        f"over-constrained: the loops {names} give {m.rows} equations, of which "
        f"only {rank} are independent; take a loop or a part out"
    )


def rates(
    m: Mechanism, q: Array, d: Drives, rate: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Rates and accelerations of all joints (n, joints) in closed poses, from the drives' own.

    Raises
    ------
    SingularHere
        At one of the poses the drives do not determine them.
    """
    v, a = np.zeros_like(q), np.zeros_like(q)
    v[:, d.driven], a[:, d.driven] = rate, acceleration
    for k in range(0, len(q), BLOCK):
        _rates(m, d, *(x[k : k + BLOCK] for x in (q, v, a)))
    return v, a


def _rates(m: Mechanism, d: Drives, q: Array, v: Array, a: Array) -> None:
    """Fill in the rates and accelerations of the joints that follow, (n, joints), in place."""
    matrix = loop_jacobian(m, move(m, q), q)
    try:
        solve = np.linalg.inv(matrix[..., d.following])
    except np.linalg.LinAlgError:
        raise SingularHere("the drives do not determine the rates at one of the poses") from None
    v[:, d.following] = -_times(solve, _times(matrix[..., d.driven], v[:, d.driven]))
    drift = bias(m, move(m, q, v, np.zeros_like(q)), q, v)
    a[:, d.following] = -_times(solve, _times(matrix[..., d.driven], a[:, d.driven]) + drift)


def condition(m: Mechanism, q: Array, d: Drives) -> Array:
    """Condition of closed poses (n,): how much rounding grows in them; infinite where singular."""
    if not d.following.size:
        return np.ones(len(q))
    return np.asarray(np.linalg.cond(scaled_jacobian(m, q)[..., d.following]))


def _times(matrix: Any, vector: Any) -> Array:
    return np.asarray((matrix @ vector[..., None])[..., 0])
