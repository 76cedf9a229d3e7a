"""Theory of stability limits of mechanisms, and of the errors of integrators over many steps.

The oscillator, a spring and a damper on one coordinate, and z = dt omega are those of
`proofmass.sim.stability`.
"""

import numpy as np

from proofmass.sim.protocol.theory import Scheme
from proofmass.sim.stability import spectral_radius


def chain_frequency(masses: int) -> float:
    """Highest omega, over sqrt(k/m), of n equal masses in a row on springs, grounded at one end.

    2 sin((2 n - 1) pi / (4 n + 2)); H. Goldstein, Classical Mechanics, ch. 6.

    >>> k = np.diag([2.0, 2.0, 1.0]) - np.eye(3, k=1) - np.eye(3, k=-1)
    >>> bool(np.isclose(chain_frequency(3) ** 2, np.linalg.eigvalsh(k)[-1]))
    True
    """
    return float(2.0 * np.sin((2 * masses - 1) * np.pi / (4 * masses + 2)))


def hencky_load(segments: int) -> float:
    """Critical load, over EI/L^2, of a clamped-free column of n segments, half ones at its ends.

    4 n^2 sin^2(pi / 4n), which tends to Euler's (pi / 2)^2; H. Hencky, Der Eisenbau 11 (1920).

    >>> round(hencky_load(1000), 5) == round((np.pi / 2) ** 2, 5)
    True
    """
    return float(4.0 * segments**2 * np.sin(np.pi / (4 * segments)) ** 2)


UNLIMITED_STEPS = 200_000
"""An oscillation whose error is small after so many steps is taken to have no limit."""


def periods_until_error(scheme: Scheme, z: float, share: float = 0.1) -> float:
    """Periods after which the error of an undamped oscillation exceeds a share of its range, 2.

    The error follows from the powers of the step's matrix.  The phase error is z^2 / 24 of the
    phase with semi-implicit steps, and z^4 / 120 of it with RK4.

    >>> from proofmass.sim.engines import engine_of
    >>> lead, (scheme,) = 2 * np.arcsin(0.1), engine_of("pymunk").theory.schemes
    >>> periods = periods_until_error(scheme, 0.05)
    >>> bool(np.isclose(periods, lead * 24 / 0.05**2 / (2 * np.pi), rtol=1e-3))
    True
    """
    values, vectors = np.linalg.eig(scheme.step(z, 0.0))
    start = np.array([1.0, -(z**2) / 2 if scheme.half_kick else 0.0])
    parts = vectors[0] * np.linalg.solve(vectors, start)
    first, end = 0, 1000
    while first < UNLIMITED_STEPS:
        steps = np.arange(first, min(end, UNLIMITED_STEPS))
        position = 2.0 * (parts[0] * np.exp(np.log(values[0]) * steps)).real  # and its conjugate
        is_off = np.abs(position - np.cos(z * steps)) > 2.0 * share
        if is_off.any():
            return float((first + np.argmax(is_off)) * z / (2.0 * np.pi))
        first, end = end, 4 * end
    return float("inf")


def steps_until_energy_share(scheme: Scheme, z: float, share: float = 0.9) -> float:
    """Steps after which the energy of an undamped oscillation has fallen to a share `share`.

    RK4 dissipates z^6 / 72 of the energy per step; the eigenvalues of the other schemes lie on the
    unit circle, so they dissipate none.

    >>> from proofmass.sim.engines import engine_of
    >>> schemes = {one.name: one for one in engine_of("mujoco").theory.schemes}
    >>> steps = steps_until_energy_share(schemes["RK4"], 0.1)
    >>> bool(np.isclose(steps, -np.log(0.9) * 72 / 0.1**6, rtol=2e-3))
    True
    >>> steps_until_energy_share(schemes["Euler"], 0.1)
    inf
    """
    size = spectral_radius(scheme.step(z, 0.0))
    return float(np.log(share) / (2.0 * np.log(size))) if size < 1.0 - 1e-12 else float("inf")


def largest_accurate_z(scheme: Scheme, steps: float, share: float = 0.1) -> float:
    """The largest z = dt omega with which the error after some steps is no more than a share.

    The error is that of `periods_until_error`, over the range of the oscillation.

    >>> from proofmass.sim.engines import engine_of
    >>> scheme, = engine_of("pymunk").theory.schemes
    >>> z = largest_accurate_z(scheme, 1000)
    >>> bool(np.isclose(1000 * z**3 / 24, 2 * np.arcsin(0.1), rtol=0.02))
    True
    """
    low, high = 1e-3, 1.5
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        is_accurate = periods_until_error(scheme, middle, share) * 2.0 * np.pi / middle > steps
        low, high = (middle, high) if is_accurate else (low, middle)
    return high
