"""Stability limits of time steps, from the step maps of the integrators.

A spring and a damper on one coordinate, I q'' = -k q - c q', have

    omega^2 = k / I        zeta = c / (2 I omega)        z = dt omega

and a step takes (q, dt q') to A (q, dt q').  It is stable while no eigenvalue of A lies outside the
unit circle.  With trace t and determinant d that is |d| <= 1 and |t| <= 1 + d (Jury).  The step
maps are in the folders of the engines, such as in `proofmass.sim.mujoco.theory`.
"""

from functools import cache

import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.protocol.theory import StepMap

MAX_STEP_PHASE = 1e6
"""Largest dt omega [1] up to which a stability limit is searched."""


def spectral_radius(matrix: Array) -> float:
    """Spectral radius of a matrix [1]."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


@cache
def stability_limit(step: StepMap, zeta: float = 0.0) -> float:
    """The least z = dt omega [1] at which a step becomes unstable; infinite if there is none.

    Examples
    --------
    >>> from proofmass.sim.engines import engine_of
    >>> maps = {one.name: one.step for name in ("mujoco", "pymunk")
    ...         for one in engine_of(name).theory.schemes}
    >>> [round(stability_limit(maps[name]), 4) for name in ("Euler", "RK4", "pymunk", "discrete")]
    [2.0, 2.8284, 2.0, inf]
    >>> bool(np.isclose(stability_limit(maps["Euler"], 0.3), 2 * (0.3 + np.sqrt(1.09)), rtol=1e-7))
    True
    >>> round(stability_limit(maps["pymunk"], 0.25), 4), stability_limit(maps["discrete"], 0.25)
    (2.0, inf)
    """

    def over(z: float) -> bool:
        # rounding of eigenvalues on the unit circle
        return spectral_radius(step(z, zeta)) > 1.0 + 1e-9

    grid = np.geomspace(1e-2, MAX_STEP_PHASE, 1000)
    first = next((k for k, z in enumerate(grid) if over(z)), 0)
    if not first:
        return float("inf")
    low, high = grid[first - 1], grid[first]
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if over(middle) else (middle, high)
    return float(high)
