"""Rods on a platform by Galerkin's method, without the closed form of an elastica.

The tangent angles are polynomials along the rods, with the least energy under the closures.  The
eigenvalues of Newton's matrix give the number of directions in which the potential falls.  All
rods have the length 1.
"""

import numpy as np
from numpy.polynomial import legendre

MAX_ITERATIONS = (
    12  # steps of Newton's method, from a first error of order e^-K that each step squares
)
RESIDUAL_TOLERANCE = (
    1e-11  # [N m, N, m] residual at which the iteration ends: rods with loops far apart have
)
# a direction with a stiffness of order e^-2K, in which further steps would be random


def basis(degree, points):
    """Integrals from 0 of Legendre polynomials on [0, 1], their slopes, Gauss weights and nodes."""
    node, weight = legendre.leggauss(points)
    value = legendre.legvander(node, degree + 1)
    k = np.arange(1, degree)
    rising = np.column_stack(
        [node + 1.0, (value[:, 2 : degree + 1] - value[:, : degree - 1]) / (2 * k + 1.0)]
    )
    return 0.5 * rising, value[:, :degree], 0.5 * weight, 0.5 * (node + 1.0)


def starting_angles(alpha, q, theta, node):
    """Tangent angles along a rod, to start Newton's method from: delta of the chart's pendulum.

    A formula gives delta from the tip on, with an error of order e^-K: the first loop is at K from
    the tip and each further one 2 K from the one before.
    """
    quarter = np.abs(q) + np.log(2.0)
    u = alpha * (1.0 - np.append(node, 0.0))
    loop = np.floor(u / (2.0 * quarter))
    cosine = -((-1.0) ** loop) * np.tanh(u - (2.0 * loop + 1.0) * quarter)
    delta = 2.0 * np.sign(q) * np.arccos(cosine)
    return theta + delta[:-1] - delta[-1]


def system(x, clamp, theta, arm, stiffness, load, parts):
    """Residual and symmetric matrix; x has coefficients of all rods, pose and loads on the tips."""
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
        violation = clamp[i] + weight @ tangent - pose[0] - 1j * pose[1] - pin
        residual[tied] = -violation.real, -violation.imag
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
    """Equilibrium i by this method: pose (3,), loads (k, 2), residual, and its stability.

    The latter is the number of directions in which the potential falls, 0 if it is stable.
    `found` are the equilibria of `proofmass.analytic.rods.all_equilibria.solutions`.
    """
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
    angles = [
        starting_angles(*one, parts[3]) - one[2]
        for one in zip(found.alpha[i], q, theta, strict=True)
    ]
    fit = [np.linalg.lstsq(parts[0], angle, rcond=None)[0] for angle in angles]
    x = np.concatenate([*fit, s.pose, s.force.ravel()])
    problem = clamp, theta, a.arm, a.stiffness[0], s.load, parts
    best = np.inf, x, np.empty(0)
    for _ in range(MAX_ITERATIONS):
        residual, matrix = system(x, *problem)
        size = float(np.abs(residual).max())
        if size < best[0]:
            best = size, x, matrix
        if size < RESIDUAL_TOLERANCE:
            break
        x = x - np.linalg.solve(matrix, residual)
    size, x, matrix = best
    closed = 2 * a.rods
    negative = int((np.linalg.eigvalsh(matrix) < 0.0).sum()) - closed
    return x[-closed - 3 : -closed], x[-closed:].reshape(-1, 2), size, negative
