"""Where bodies and points are, and how they move: the product of the joints' displacements.

A hinge at a turns by w: ``z -> a + w (z - a)``.  A slide along u moves by s: ``z -> z + s u``.  A
body's displacement is its parent's, then its joints' in order; rates and accelerations follow by
differentiating that product once and twice.
"""

from dataclasses import dataclass

import numpy as np

from proofmass.analytic.numerics import Array, Complex
from proofmass.analytic.planar.mechanism import Mechanism


@dataclass(frozen=True)
class Motion:
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


def move(m: Mechanism, q: Array, v: Array | None = None, a: Array | None = None) -> Motion:
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
    return Motion((w[0], w[1], w[2]), (t[0], t[1], t[2]), (turn[0], turn[1], turn[2]), place)


def _hinge(m: Mechanism, j: int, b: int, moved: list[Array], w: list[Complex],
           t: list[Complex], turn: list[Array], place: Complex) -> None:
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


def _slide(m: Mechanism, j: int, b: int, moved: list[Array], w: list[Complex],
           t: list[Complex], turn: list[Array], place: Complex) -> None:
    along = [w[k][b] * m.joints[j].place for k in range(len(moved))]
    place[j] = along[0]
    t[0][b] += along[0] * moved[0]
    if len(moved) > 1:
        t[1][b] += along[1] * moved[0] + along[0] * moved[1]
    if len(moved) > 2:
        t[2][b] += along[2] * moved[0] + 2 * along[1] * moved[1] + along[0] * moved[2]


def jacobian(m: Mechanism, motion: Motion, body: int, point: Complex) -> Complex:
    """Derivatives of a point (n,) of a body, seen where it is, by the joints (n, joints)."""
    hinged = 1j * m.signs[:, None] * (point - motion.place)
    columns = np.where(m.hinges[:, None], hinged, motion.place)
    return np.asarray((m.moved_by[body][:, None] * columns).T)
