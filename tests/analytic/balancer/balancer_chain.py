"""A three-segment balancer by elementary means: meeting circles, virtual work, and secants."""

import numpy as np
from scipy.optimize import newton

PATH_ANGLES = np.radians(np.arange(1, 91))  # 1 to 90 degrees: the thesis's precision points
# Optima of van Nes 2022 by line: r = 1 m and m g r = 1 N m throughout.
ROWS = {
    1743: {"length": (0.4868, 0.4951, 0.4507), "stiffness": (1.3808, 0.4359, 0.0870)},
    1745: {
        "length": (0.4764, 0.4975, 0.4986),
        "stiffness": (0.9341, 0.1211, 0.0927),
        "preload2": 0.3983,
    },
    1766: {
        "length": (0.3394, 0.4573, 0.4752),
        "stiffness": (1.2701, 0.8473, 4.1078),
        "rest_angle": 0.6641,
    },
    1768: {
        "length": (0.3727, 0.4438, 0.3792),
        "stiffness": (0.9668, 0.1762, 2.4054),
        "preload2": 0.5237,
        "rest_angle": 0.3891,
    },
    1789: {"length": (0.7298, 0.6937, 0.5730), "stiffness": (1.1940, 0.4247, 0.1294)},
    1814: {"length": (0.3923, 0.4893, 0.3976), "stiffness": (1.3582, 0.0165, 0.7429)},
    1826: {
        "length": (0.4658, 0.3362, 0.3528),
        "stiffness": (0.0361,) * 3,
        "quadratic": 0.4207,
        "preload2": 0.3642,
    },
    2084: {"length": (0.5000, 0.4999, 0.4927), "stiffness": (1.5, 0.5073, 0.0003)},
    2107: {
        "length": (0.3518, 0.4999, 0.4995),
        "stiffness": (3.3664, 0.5915, 0.9847),
        "rest_angle": 1.3365,
    },
}


def row_parameters(row):
    """Parameters of a row under the names of `proofmass.analytic.balancer.solve`."""
    found = {"pendulum": 1.0, "rest_angle": row.get("rest_angle", 0.0)}
    for name in ("length", "stiffness"):
        found |= {f"{name}{i}": value for i, value in enumerate(row[name], start=1)}
    if "quadratic" in row:
        found |= {f"quadratic{i}": row["quadratic"] for i in (1, 2, 3)}
    return found | ({"preload2": row["preload2"], "low2": 0.0} if "preload2" in row else {})


def segment_angles(row, theta1, alpha):
    """Angles of the three segments (3, ...), elbow up: the knee lies left of P1 -> tip."""
    a, b, c = row["length"]
    theta1, alpha = np.broadcast_arrays(theta1, alpha)
    arm, tip = 1j * a * np.exp(-1j * theta1), 1j * np.exp(-1j * alpha)
    p1_to_tip = tip - arm
    along = (abs(p1_to_tip) ** 2 + b**2 - c**2) / (2.0 * abs(p1_to_tip))
    middle = p1_to_tip / abs(p1_to_tip) * (along + 1j * np.sqrt(b**2 - along**2))
    theta2 = theta1 - np.angle(middle / arm)
    return np.stack([theta1, theta2, theta2 - np.angle((p1_to_tip - middle) / middle)])


def deflections(row, theta1, alpha):
    rest = segment_angles(row, row.get("rest_angle", 0.0), 0.0)
    turned = segment_angles(row, theta1, alpha) - rest.reshape(3, *[1] * np.ndim(alpha))
    return np.diff(turned, axis=0, prepend=0.0)


def spring_moments(row, deflection):
    k = np.reshape(row["stiffness"], (3, *[1] * (np.ndim(deflection) - 1)))
    if "quadratic" not in row:
        moments = k * deflection
        moments[1] += row.get("preload2", 0.0)
        return moments
    a, m0 = row["quadratic"], row.get("preload2", 0.0)
    preload_winding = np.zeros_like(k)
    preload_winding[1] = (np.sqrt(k[1] ** 2 + 4.0 * a * m0) - k[1]) / (2.0 * a)
    return (k + a * (deflection + preload_winding)) * (deflection + preload_winding)


def energy_slope(row, theta1, alpha):
    """dV/dtheta1 [N m] on the constraint; zero at an equilibrium with no stop."""
    t1, t2, t3 = segment_angles(row, theta1, alpha)
    a, b, c = row["length"]
    turn2 = -a * np.sin(t3 - t1) / (b * np.sin(t3 - t2))
    turn3 = a * np.sin(t2 - t1) / (c * np.sin(t3 - t2))
    m1, m2, m3 = spring_moments(row, deflections(row, theta1, alpha))
    return m1 + m2 * (turn2 - 1.0) + m3 * (turn3 - turn2)


def equilibrium(row, alphas=PATH_ANGLES):
    """Angle of segment 1 (n,), followed from rest through rising `alphas`; a preload releases once.

    Spring 2 is wound when segment 1 falls back behind the pendulum: joint 2 presses on its stop
    while virtual work drives segment 1 forward, slope < 0.
    """
    start, last, rate, found = row.get("rest_angle", 0.0), 0.0, 1.0, []
    theta = start
    for alpha in alphas:
        if "preload2" in row and energy_slope(row, start + alpha, alpha) < 0.0:
            following = start + alpha
        else:
            following = newton(
                lambda t, alpha=alpha: energy_slope(row, t, alpha),
                theta + rate * (alpha - last),
                tol=1e-14,
            )
        theta, rate, last = following, (following - theta) / (alpha - last), alpha
        found.append(theta)
    return np.array(found)
