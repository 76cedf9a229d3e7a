"""The loop equations of a mechanism: residual, Jacobian, and the acceleration at constant rates."""

import numpy as np

from proofmass.analytic.numerics import Array, Complex
from proofmass.analytic.planar.mechanism import Mechanism
from proofmass.analytic.planar.motion import Motion, jacobian, move


def residual(m: Mechanism, motion: Motion, q: Array) -> Array:
    """How far the loops are open (n, rows): x and y of each pin [m], then the couplings."""
    return _stack(m, [_apart(m, motion, k, 0) for k in range(len(m.pins))],
                  [_coupling(m, q, k) for k in range(len(m.couplings))], len(q))


def loop_jacobian(m: Mechanism, motion: Motion, q: Array) -> Array:
    """Derivatives of the residual by the joints (n, rows, joints)."""
    pins = [jacobian(m, motion, p.one, motion.point(p.one, p.on_one))
            - jacobian(m, motion, p.two, motion.point(p.two, p.on_two)) for p in m.pins]
    couplings = []
    for c in m.couplings:
        row = np.zeros_like(q)
        row[:, c.one] = 1.0
        if c.two >= 0:
            slope = np.polynomial.Polynomial(c.polynomial).deriv()
            row[:, c.two] -= slope(q[:, c.two] - m.joints[c.two].zero)
        couplings.append(row)
    return _stack(m, pins, couplings, *q.shape)


def bias(m: Mechanism, motion: Motion, q: Array, v: Array) -> Array:
    """Second time derivative of the residual when the joints do not accelerate (n, rows)."""
    couplings = []
    for c in m.couplings:
        bend = np.polynomial.Polynomial(c.polynomial).deriv(2)
        couplings.append(-bend(q[:, c.two] - m.joints[c.two].zero) * v[:, c.two] ** 2
                         if c.two >= 0 else np.zeros(len(q)))
    return _stack(m, [_apart(m, motion, k, 2) for k in range(len(m.pins))], couplings, len(q))


def gap(m: Mechanism, q: Array) -> tuple[float, str]:
    """The widest open loop of one pose: by how much [m, or rad of a coupling], and its name."""
    r = residual(m, move(m, q[None]), q[None])[0]
    pins = np.hypot(r[0:2 * len(m.pins):2], r[1:2 * len(m.pins):2])
    open_by = np.append(pins, np.abs(r[2 * len(m.pins):]))
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


def _apart(m: Mechanism, motion: Motion, k: int, order: int) -> Complex:
    p = m.pins[k]
    return motion.point(p.one, p.on_one, order) - motion.point(p.two, p.on_two, order)


def _coupling(m: Mechanism, q: Array, k: int) -> Array:
    c, other = m.couplings[k], np.zeros(len(q))
    if c.two >= 0:
        other = q[:, c.two] - m.joints[c.two].zero
    return np.asarray(q[:, c.one] - m.joints[c.one].zero
                      - np.polynomial.Polynomial(c.polynomial)(other))


def _stack(m: Mechanism, pins: list[Complex], couplings: list[Array], n: int,
           *more: int) -> Array:
    rows = np.empty((n, m.rows, *more))
    for k, apart in enumerate(pins):
        rows[:, 2 * k], rows[:, 2 * k + 1] = apart.real, apart.imag
    for k, value in enumerate(couplings):
        rows[:, 2 * len(pins) + k] = value
    return rows
