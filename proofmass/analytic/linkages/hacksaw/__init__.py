"""Power hacksaw: motion in closed form, by Newton-Raphson as its report solves it, and charts."""

from proofmass.analytic.linkages.hacksaw.charts import (
    newton_convergence,
    newton_course,
    newton_errors,
    newton_steps,
)
from proofmass.analytic.linkages.hacksaw.kinematics import MODES, motor, solve, turn_time
from proofmass.analytic.linkages.hacksaw.newton import newton_pose, newton_sweep

__all__ = [
    "MODES",
    "motor",
    "newton_convergence",
    "newton_course",
    "newton_errors",
    "newton_pose",
    "newton_steps",
    "newton_sweep",
    "solve",
    "turn_time",
]
