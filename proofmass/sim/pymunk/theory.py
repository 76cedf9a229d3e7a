"""What theory states of pymunk: orders of convergence and limits of stability.

The errors fall with the step h as follows:

    no bias                         h^2: positions advance with the old velocity, as in a leapfrog
    a bias of time constant T       h T.  Constraint violations are corrected with a delay of T,
                                    which damps a free motion: energy falls by h T^2 t.
                                    Accelerations are differences of rates; few iterations leave an
                                    error of h in rates, and may leave h^0 in accelerations
    contacts                        h at an impact, which is a step late; h^2 while a contact lasts
    dampers, servos with a rate     h^2 by the midpoint rule, h as Chipmunk has them: with the rate
                                    after the forces of the step
    dry friction of joints          h at a halt, late by a part of a step; h^2 between halts

Chipmunk's step of a spring and a damper is stable for z^2 up to 2 (1 + exp(2 zeta z)), with
z = h omega and the damping ratio zeta; with the midpoint rule for z up to 2.
"""

from collections.abc import Iterator

import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.contents import has_dry_friction, is_damped, may_touch
from proofmass.sim.problem_models import wheel_model
from proofmass.sim.protocol.theory import LimitProblem, Scheme, Stepping, Theory
from proofmass.sim.protocol.tuning import Scan, Studied


def chipmunk_step(z: float, zeta: float) -> Array:
    """Matrix of a step of Chipmunk for a spring and a damper, a `StepMap`.

    The position moves with the old velocity.  Then the spring acts with its force at the new
    position, and the damper with its exact solution.
    """
    damped_share = np.exp(-2.0 * zeta * z)
    return np.array([[1.0, 1.0], [-damped_share * z**2, damped_share * (1.0 - z**2)]])


def midpoint_damped_step(z: float, zeta: float) -> Array:
    """Matrix of a step with `proofmass.sim.pymunk.dampers` for a spring and a damper, a `StepMap`.

    The damper has the mean of the velocities before and after the step.

    >>> midpoint_damped_step(1.0, 0.5).round(3).tolist()
    [[1.0, 1.0], [-0.667, -0.333]]
    """
    share = 1.0 / (1.0 + zeta * z)
    return np.array([[1.0, 1.0], [-share * z**2, share * (1.0 - zeta * z - z**2)]])


ANY_VALUE = (0.0,)
SCHEMES = (
    Scheme(
        "pymunk",
        midpoint_damped_step,
        "z = 2",
        half_kick=True,
        tried={
            "spring": (0.0, 0.1, 0.3),
            "slide": ANY_VALUE,
            "chain": (5,),
            "pendulum": ANY_VALUE,
            "whirl": ANY_VALUE,
            "swing": (0.05,),
            "fade": (0.05,),
        },
    ),
)


class PymunkTheory(Theory):
    """Orders and stability limits of pymunk."""

    schemes = SCHEMES

    def limit_problems(self) -> Iterator[LimitProblem]:
        """Springs with Chipmunk's own dampers."""
        for zeta in (0.1, 0.3):
            yield LimitProblem(
                f"spring on a hinge, ζ = {zeta:g}, Chipmunk's dampers",
                "pymunk",
                "dt ω",
                "z² = 2 (1 + exp 2ζz)",
                chipmunk_stepping(wheel_model(1.0, 2.0 * zeta)),
                chipmunk_step,
                zeta,
                reach=100.0,
            )

    def orders(self, scan: Scan, derivative: int, about: Studied) -> tuple[float, ...]:
        """Orders that the errors of a scan may show; j as `derivative` in `Engine.orders`."""
        if scan.varied == "error_bias":
            braked = () if about.driven else (2.0,)
            return (1.0, *braked) if derivative < 2 else (1.0, *braked, 0.0)
        if scan.varied != "timestep":
            return ()
        own = scan.settings[0].get("defaults")
        own_dampers = not scan.settings[0].get("midpoint_damping", not own)
        if (
            may_touch(about.model)
            or (own_dampers and is_damped(about.model))
            or has_dry_friction(about.model)
        ):
            return (1.0, 2.0)
        if not own:
            return (2.0,)
        return (1.0,) if derivative < 2 else (1.0, 0.0)


def chipmunk_stepping(text: str) -> Stepping:
    """A model with Chipmunk's own dampers and a step that is varied; its value is watched."""
    return lambda step: (text, step, {"midpoint_damping": False}, "place")
