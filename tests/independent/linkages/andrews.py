"""Andrews' squeezing mechanism by the equations of a test set, without bodies, joints or a model.

F. Mazzia and C. Magherini, Test Set for Initial Value Problem Solvers, release 2.4, 2008, problem
`andrews`: M(p) p'' = f(p, p') - G(p)' lambda, 0 = g(p), with p = (beta, theta, gamma, phi, delta,
omega, epsilon). Here the constraints are differentiated twice, which gives p'' and lambda together.
"""

import numpy as np

D, DA, E, EA = 28e-3, 115e-4, 2e-2, 1421e-5
RR, RA = 7e-3, 92e-5
SS, SA, SB, SC, SD = 35e-3, 1874e-5, 1043e-5, 18e-3, 2e-2
TA, TB, U, UA, UB = 2308e-5, 916e-5, 4e-2, 1228e-5, 449e-5
ZF, ZT, FA = 2e-2, 4e-2, 1421e-5
A, B, C = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)
MASS = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
INERTIA = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
MOMENT, STIFFNESS, LENGTH = 0.033, 4530.0, 0.07785


def mass_matrix(p: np.ndarray) -> np.ndarray:
    """Mass matrix M(p) [kg m^2]."""
    _, theta, _, phi, _, omega, _ = p
    m1, m2, m3, m4, m5, m6, m7 = MASS
    i1, i2, i3, i4, i5, i6, i7 = INERTIA
    found, e, z = np.zeros((7, 7)), E - EA, ZF - FA
    found[0, 0] = m1 * RA**2 + m2 * (RR**2 - 2 * DA * RR * np.cos(theta) + DA**2) + i1 + i2
    found[0, 1] = found[1, 0] = m2 * (DA**2 - DA * RR * np.cos(theta)) + i2
    found[1, 1] = m2 * DA**2 + i2
    found[2, 2] = m3 * (SA**2 + SB**2) + i3
    found[3, 3] = m4 * e**2 + i4
    found[3, 4] = found[4, 3] = m4 * (e**2 + ZT * e * np.sin(phi)) + i4
    found[4, 4] = m4 * (ZT**2 + 2 * ZT * e * np.sin(phi) + e**2) + m5 * (TA**2 + TB**2) + i4 + i5
    found[5, 5] = m6 * z**2 + i6
    found[5, 6] = found[6, 5] = m6 * (z**2 - U * z * np.sin(omega)) + i6
    found[6, 6] = m6 * (z**2 - 2 * U * z * np.sin(omega) + U**2) + m7 * (UA**2 + UB**2) + i6 + i7
    return found


def force(p: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Generalized force f(p, p') [N m]."""
    _, theta, gamma, phi, _, omega, _ = p
    u_beta, u_theta, _, u_phi, u_delta, u_omega, u_epsilon = v
    _, m2, _, m4, _, m6, _ = MASS
    x = SD * np.cos(gamma) + SC * np.sin(gamma) + B[0]
    y = SD * np.sin(gamma) - SC * np.cos(gamma) + B[1]
    length = np.hypot(x - C[0], y - C[1])
    pull = -STIFFNESS * (length - LENGTH) / length
    fx, fy = pull * (x - C[0]), pull * (y - C[1])
    return np.array(
        [
            MOMENT - m2 * DA * RR * u_theta * (u_theta + 2 * u_beta) * np.sin(theta),
            m2 * DA * RR * u_beta**2 * np.sin(theta),
            fx * (SC * np.cos(gamma) - SD * np.sin(gamma))
            + fy * (SD * np.cos(gamma) + SC * np.sin(gamma)),
            m4 * ZT * (E - EA) * u_delta**2 * np.cos(phi),
            -m4 * ZT * (E - EA) * u_phi * (u_phi + 2 * u_delta) * np.cos(phi),
            -m6 * U * (ZF - FA) * u_epsilon**2 * np.cos(omega),
            m6 * U * (ZF - FA) * u_omega * (u_omega + 2 * u_epsilon) * np.cos(omega),
        ]
    )


def constraints(p: np.ndarray) -> np.ndarray:
    """Constraints g(p) [m], also for complex p."""
    beta, theta, gamma, phi, delta, omega, epsilon = p
    x = RR * np.cos(beta) - D * np.cos(beta + theta)
    y = RR * np.sin(beta) - D * np.sin(beta + theta)
    return np.array(
        [
            x - SS * np.sin(gamma) - B[0],
            y + SS * np.cos(gamma) - B[1],
            x - E * np.sin(phi + delta) - ZT * np.cos(delta) - A[0],
            y + E * np.cos(phi + delta) - ZT * np.sin(delta) - A[1],
            x - ZF * np.cos(omega + epsilon) - U * np.sin(epsilon) - A[0],
            y - ZF * np.sin(omega + epsilon) + U * np.cos(epsilon) - A[1],
        ]
    )


def gradient(p: np.ndarray) -> np.ndarray:
    """G(p) = dg/dp, by complex steps."""
    return np.array([constraints(p + 1e-30j * unit).imag / 1e-30 for unit in np.eye(7)]).T


def accelerations(p: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """p'' and lambda, from the constraints differentiated twice."""
    rows = gradient(p)
    matrix = np.block([[mass_matrix(p), rows.T], [rows, np.zeros((6, 6))]])
    found = np.linalg.solve(matrix, np.append(force(p, v), -second_derivative_along(p, v)))
    return found[:7], found[7:]


def second_derivative_along(p: np.ndarray, v: np.ndarray) -> np.ndarray:
    """d^2 g(p + s v)/ds^2 at s = 0: each sine and cosine times minus the square of its rate."""
    beta, theta, gamma, phi, delta, omega, epsilon = p
    w_beta, w_theta, w_gamma, w_phi, w_delta, w_omega, w_epsilon = v
    two, four, six = w_beta + w_theta, w_phi + w_delta, w_omega + w_epsilon
    x = -RR * np.cos(beta) * w_beta**2 + D * np.cos(beta + theta) * two**2
    y = -RR * np.sin(beta) * w_beta**2 + D * np.sin(beta + theta) * two**2
    return np.array(
        [
            x + SS * np.sin(gamma) * w_gamma**2,
            y - SS * np.cos(gamma) * w_gamma**2,
            x + E * np.sin(phi + delta) * four**2 + ZT * np.cos(delta) * w_delta**2,
            y - E * np.cos(phi + delta) * four**2 + ZT * np.sin(delta) * w_delta**2,
            x + ZF * np.cos(omega + epsilon) * six**2 + U * np.sin(epsilon) * w_epsilon**2,
            y + ZF * np.sin(omega + epsilon) * six**2 - U * np.cos(epsilon) * w_epsilon**2,
        ]
    )


def state_rate(_: float, state: np.ndarray) -> np.ndarray:
    """Time derivative of the state (p, p')."""
    return np.append(state[7:], accelerations(state[:7], state[7:])[0])
