"""How Chipmunk steps a spring and a damper: stable for z^2 up to 2 (1 + exp(2 zeta z)).

z is dt omega, zeta the damping ratio.
"""

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import Scheme


def chipmunk(z: float, zeta: float) -> Array:
    """The old velocity moves the position; then the spring acts, and the damper, exactly."""
    left = np.exp(-2.0 * zeta * z)
    return np.array([[1.0, 1.0], [-left * z**2, left * (1.0 - z**2)]])


ONE = (0.0,)
SCHEMES = (
    Scheme(
        "pymunk",
        chipmunk,
        "z² = 2 (1 + exp 2ζz)",
        half_kick=True,
        tried={
            "spring": (0.0, 0.1, 0.3),
            "slide": ONE,
            "chain": (5,),
            "pendulum": ONE,
            "whirl": ONE,
            "swing": (0.05,),
            "fade": (0.05,),
        },
    ),
)
