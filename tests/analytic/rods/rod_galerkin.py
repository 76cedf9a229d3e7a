"""Rods on a platform by Galerkin's method, without the closed form of an elastica.

Angles of the tangents are polynomials along the rods, of the least energy that closes; Newton's
matrix of that tells in how many directions the potential falls.  For rods of length 1.
"""

import numpy as np
from numpy.polynomial import legendre

STEPS = 12  # of Newton's method, which squares what e^-K is off
CLOSED = 1e-11  # [N m, N, m] residual at which it ends: rods with loops far apart are soft to
# e^-2K, and further steps would go that way at random


def basis(degree, points):
    """Integrals from 0 of Legendre's polynomials on [0, 1], their slopes, and Gauss's weights."""
    node, weight = legendre.leggauss(points)
    value = legendre.legvander(node, degree + 1)
    k = np.arange(1, degree)
    rising = np.column_stack(
        [node + 1.0, (value[:, 2 : degree + 1] - value[:, : degree - 1]) / (2 * k + 1.0)]
    )
    return 0.5 * rising, value[:, :degree], 0.5 * weight, 0.5 * (node + 1.0)


def start(alpha, q, theta, node):
    """Angles along a rod of the closed form, to begin with: delta of the pendulum of its chart.

    Integrated from the tip by its own formula of loops, K apart, as good as e^-K.
    """
    quarter = np.abs(q) + np.log(2.0)
    u = alpha * (1.0 - np.append(node, 0.0))
    loop = np.floor(u / (2.0 * quarter))
    cosine = -((-1.0) ** loop) * np.tanh(u - (2.0 * loop + 1.0) * quarter)
    delta = 2.0 * np.sign(q) * np.arccos(cosine)
    return theta + delta[:-1] - delta[-1]


def system(x, clamp, theta, arm, stiffness, load, parts):
    """Residual and symmetric matrix by (coefficients of all rods, pose, loads on the tips)."""
    phi, slope, weight, _ = parts
    k, n = len(clamp), phi.shape[1]
    c, pose, force = x[: k * n].reshape(k, n), x[k * n : k * n + 3], x[k * n + 3 :].reshape(k, 2)
    residual, matrix = np.zeros(x.size), np.zeros((x.size, x.size))
    at, tips = k * n, k * n + 3
    for i in range(k):
        own, tied = slice(i * n, i * n + n), slice(tips + 2 * i, tips + 2 * i + 2)
        tangent = np.exp(1j * (theta[i] + phi @ c[i]))
        load_i, pin = force[i] @ [1.0, 1.0j], arm[i] * np.exp(1j * pose[2])
        across = (np.conj(load_i) * 1j * tangent).real
        residual[own] = stiffness * slope.T @ (weight * (slope @ c[i])) - phi.T @ (weight * across)
        gap = clamp[i] + weight @ tangent - pose[0] - 1j * pose[1] - pin
        residual[tied] = -gap.real, -gap.imag
        residual[at : at + 3] += force[i, 0], force[i, 1], (np.conj(pin) * load_i).imag
        along = (np.conj(load_i) * tangent).real
        matrix[own, own] = (stiffness * slope.T * weight) @ slope + (phi.T * (weight * along)) @ phi
        turn = phi.T @ (weight * 1j * tangent)
        matrix[own, tied] = -np.column_stack([turn.real, turn.imag])
        matrix[at : at + 3, tied] = [[1.0, 0.0], [0.0, 1.0], [-pin.imag, pin.real]]
        matrix[at + 2, at + 2] -= (np.conj(pin) * load_i).real
    residual[at : at + 3] -= load
    upper = np.triu(matrix, 1)
    return residual, np.diag(np.diag(matrix)) + upper + upper.T


def solve(found, i, degree):
    """Equilibrium number i again: pose (3,), loads (k, 2), the residual, directions down."""
    s = found.state[i]
    a = s.assembly
    theta, clamp = (
        (a.angle + s.inputs, a.clamp)
        if a.guide is None
        else (a.angle, a.clamp + s.inputs * a.guide)
    )
    parts = basis(degree, int(1.4 * degree))
    side = np.copysign(1.0, -s.moment) * (-1.0) ** (found.modes[i] - 1)
    q = side * np.arccosh(1.0 / found.complement[i])
    angles = [start(*one, parts[3]) - one[2] for one in zip(found.alpha[i], q, theta, strict=True)]
    fit = [np.linalg.lstsq(parts[0], angle, rcond=None)[0] for angle in angles]
    x = np.concatenate([*fit, s.pose, s.force.ravel()])
    given = clamp, theta, a.arm, a.stiffness[0], s.load, parts
    best = np.inf, x, np.empty(0)
    for _ in range(STEPS):
        residual, matrix = system(x, *given)
        size = float(np.abs(residual).max())
        if size < best[0]:
            best = size, x, matrix
        if size < CLOSED:
            break
        x = x - np.linalg.solve(matrix, residual)
    size, x, matrix = best
    closed = 2 * a.rods
    down = int((np.linalg.eigvalsh(matrix) < 0.0).sum()) - closed
    return x[-closed - 3 : -closed], x[-closed:].reshape(-1, 2), size, down
