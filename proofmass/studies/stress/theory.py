"""Where steps become unstable, from the integrators' own maps, and where mechanisms give way.

A spring and a damper on one coordinate, I q'' = -k q - c q', have

    omega^2 = k / I        zeta = c / (2 I omega)        z = dt omega

and a step takes (q, dt q') to A (q, dt q').  It is stable while no eigenvalue of A lies outside the
unit circle.  With trace t and determinant d that is |d| <= 1 and |t| <= 1 + d (Jury), from which

    MuJoCo Euler, implicit, implicitfast         z = 2 (zeta + sqrt(1 + zeta^2))
    the same without implicit damping            z = 2 (sqrt(1 + zeta^2) - zeta)
    MuJoCo discrete, implicit in the spring too  none
    Chipmunk                                     z^2 = 2 (1 + exp(2 zeta z))
    RK4                                          |1 + w + w^2/2 + w^3/6 + w^4/24| = 1,
                                                 w = z (-zeta + i sqrt(1 - zeta^2))

E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration, 2nd ed., ch. I; E. Hairer,
G. Wanner, Solving Ordinary Differential Equations II, sec. IV.2, for RK4.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from proofmass.analytic.numerics import Array

Map = Callable[[float, float], Array]
"""``map(z, zeta)``: the matrix A (2, 2) of a step."""
FAR = 1e6
"""dt omega up to which a limit is looked for."""


def euler(z: float, zeta: float) -> Array:
    """The new velocity, with the damper's force at its end, moves the position."""
    held = 1.0 + 2.0 * zeta * z
    return np.array([[1.0 - z**2 / held, 1.0 / held], [-z**2 / held, 1.0 / held]])


def euler_explicit(z: float, zeta: float) -> Array:
    """The new velocity, with the damper's force at its beginning, moves the position."""
    left = 1.0 - 2.0 * zeta * z
    return np.array([[1.0 - z**2, left], [-z**2, left]])


def discrete(z: float, zeta: float) -> Array:
    """Spring and damper both with their forces at the end of the step."""
    held = 1.0 + 2.0 * zeta * z + z**2
    return np.array([[1.0 - z**2 / held, 1.0 / held], [-z**2 / held, 1.0 / held]])


def chipmunk(z: float, zeta: float) -> Array:
    """The old velocity moves the position; then the spring acts, and the damper, exactly."""
    left = np.exp(-2.0 * zeta * z)
    return np.array([[1.0, 1.0], [-left * z**2, left * (1.0 - z**2)]])


def rk4(z: float, zeta: float) -> Array:
    """The exponential of the system's matrix to the fourth power."""
    step = np.array([[0.0, 1.0], [-z**2, -2.0 * zeta * z]])
    a, power = np.eye(2), np.eye(2)
    for k in (1, 2, 3, 4):
        power = power @ step / k
        a = a + power
    return a


MAPS: dict[str, Map] = {"Euler": euler, "implicit": euler, "implicitfast": euler, "RK4": rk4,
                        "discrete": discrete, "pymunk": chipmunk}
"""By MuJoCo's integrators and pymunk."""


def radius(matrix: Array) -> float:
    """Spectral radius."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


@cache
def limit(step: Map, zeta: float = 0.0) -> float:
    """The least z = dt omega at which a step becomes unstable; infinite if none does.

    Examples
    --------
    >>> [round(limit(step), 4) for step in (euler, rk4, chipmunk, discrete)]
    [2.0, 2.8284, 2.0, inf]
    >>> bool(np.isclose(limit(euler, 0.3), 2 * (0.3 + np.sqrt(1.09)), rtol=1e-7))
    True
    >>> limit(chipmunk, 0.25)
    inf
    """
    def over(z: float) -> bool:
        return radius(step(z, zeta)) > 1.0 + 1e-9  # rounding of eigenvalues on the unit circle

    grid = np.geomspace(1e-2, FAR, 1000)
    first = next((k for k, z in enumerate(grid) if over(z)), 0)
    if not first:
        return float("inf")
    low, high = grid[first - 1], grid[first]
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if over(middle) else (middle, high)
    return float(high)


def chain_frequency(masses: int) -> float:
    """Highest omega of n equal masses in a row, held by a spring at one end, over sqrt(k/m).

    2 sin((2 n - 1) pi / (4 n + 2)); H. Goldstein, Classical Mechanics, ch. 6.

    >>> k = np.diag([2.0, 2.0, 1.0]) - np.eye(3, k=1) - np.eye(3, k=-1)
    >>> bool(np.isclose(chain_frequency(3) ** 2, np.linalg.eigvalsh(k)[-1]))
    True
    """
    return float(2.0 * np.sin((2 * masses - 1) * np.pi / (4 * masses + 2)))


def hencky(segments: int) -> float:
    """Critical load of a clamped-free column in n segments, half ones at its ends, over EI/L^2.

    4 n^2 sin^2(pi / 4n), which tends to Euler's (pi / 2)^2; H. Hencky, Der Eisenbau 11 (1920).

    >>> round(hencky(1000), 5) == round((np.pi / 2) ** 2, 5)
    True
    """
    return float(4.0 * segments**2 * np.sin(np.pi / (4 * segments)) ** 2)


def off_after(integrator: str, z: float, share: float = 0.1) -> float:
    """Periods after which an undamped oscillation is off by a share of its range, 2.

    From the powers of the map.  Its phase is off by z^2 / 24 of the way with semi-implicit steps,
    by z^4 / 120 with RK4.

    >>> lead = 2 * np.arcsin(0.1)
    >>> bool(np.isclose(off_after("pymunk", 0.05), lead * 24 / 0.05**2 / (2 * np.pi), rtol=1e-3))
    True
    """
    values, vectors = np.linalg.eig(MAPS[integrator](z, 0.0))
    start = np.array([1.0, -z**2 / 2 if integrator == "pymunk" else 0.0])
    parts = vectors[0] * np.linalg.solve(vectors, start)
    steps = np.arange(200_000)
    place = 2.0 * (parts[0] * np.exp(np.log(values[0]) * steps)).real  # the other is its conjugate
    off = np.abs(place - np.cos(z * steps)) > 2.0 * share
    return float(np.argmax(off) * z / (2.0 * np.pi)) if off.any() else float("inf")


def faded_after(integrator: str, z: float, left: float = 0.9) -> float:
    """Steps after which an undamped oscillation has so much of its energy left.

    RK4 takes z^6 / 72 of it in a step; the eigenvalues of the others lie on the unit circle.

    >>> bool(np.isclose(faded_after("RK4", 0.1), -np.log(0.9) * 72 / 0.1**6, rtol=2e-3))
    True
    >>> faded_after("Euler", 0.1)
    inf
    """
    size = radius(MAPS[integrator](z, 0.0))
    return float(np.log(left) / (2.0 * np.log(size))) if size < 1.0 - 1e-12 else float("inf")


def stiffest(integrator: str, steps: float, share: float = 0.1) -> float:
    """The largest z = dt omega whose oscillation is off by no more than a share after some steps.

    >>> z = stiffest("pymunk", 1000)
    >>> bool(np.isclose(1000 * z**3 / 24, 2 * np.arcsin(0.1), rtol=0.02))
    True
    """
    low, high = 1e-3, 1.5
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        held = off_after(integrator, middle, share) * 2.0 * np.pi / middle > steps
        low, high = (middle, high) if held else (low, middle)
    return high
