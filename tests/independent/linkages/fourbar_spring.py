"""The four-bar with a diagonal spring by the one equation that its source prints for an angle.

F. González, P. Masarati and J. Cuadrado, IDETC 2016-59277: (5/3) m l^2 phi'' + 2 m g l cos phi -
k l sin phi (l - l0/sqrt(2 (1 + cos phi))) = 0. The damper acts along the diagonal 2 l cos(phi/2).
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

MASS, LENGTH, GRAVITY, STIFFNESS, REST, DAMPING = 1.0, 1.0, 9.81, 25.0, np.sqrt(2.0), 1.0
INERTIA = 5 / 3 * MASS * LENGTH**2


def moment(phi: float) -> float:
    """The moment against the angle at rest [N m]."""
    stretch = LENGTH - REST / np.sqrt(2 * (1 + np.cos(phi)))
    return 2 * MASS * GRAVITY * LENGTH * np.cos(phi) - STIFFNESS * LENGTH * np.sin(phi) * stretch


def stiffness(phi: float) -> float:
    """The derivative of the moment as the source prints it, k_e [N m/rad]."""
    c, s = np.cos(phi), np.sin(phi)
    root = np.sqrt(2 * (1 + c))
    spring = STIFFNESS * LENGTH * REST / root * (c + s**2 / (2 * (1 + c)))
    return -2 * MASS * GRAVITY * LENGTH * s - STIFFNESS * LENGTH**2 * c + spring


def equilibrium() -> float:
    """The stable equilibrium above the ground [rad]."""
    return float(brentq(moment, 2.2, 2.3, xtol=1e-15, rtol=1e-15))


def eigenvalue(phi: float, damping: float) -> complex:
    """The eigenvalue s [1/s] with a positive imaginary part, of the motion linearized about phi."""
    drag = damping * LENGTH**2 * np.sin(phi / 2) ** 2
    half = -drag / (2 * INERTIA)
    return complex(half, np.sqrt(stiffness(phi) / INERTIA - half**2))


def move(phi: float, times: np.ndarray, damping: float = DAMPING) -> np.ndarray:
    """Angle and rate (2, n) from rest at phi [rad, rad/s], at times [s]."""

    def rate(_: float, y: np.ndarray) -> tuple[float, float]:
        drag = damping * LENGTH**2 * np.sin(y[0] / 2) ** 2
        return y[1], -(moment(y[0]) + drag * y[1]) / INERTIA

    span = (0.0, times[-1])
    return solve_ivp(rate, span, (phi, 0.0), "DOP853", times, rtol=1e-13, atol=1e-15).y
