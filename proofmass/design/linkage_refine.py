"""Refine linkages found by a search, with the order of the crank angles as a bound.

The unknowns are the parameters that are not fixed, the crank angle at the first point, and unless
the table gives the angles the steps from point to point, which are not negative and cover at most
one turn.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from proofmass.analytic.numerics import TURN
from proofmass.base.arrays import Array
from proofmass.design.linkage_path import FEWEST_STEPS, REFINED_STEPS, SHARPNESS, PathTask


@dataclass(frozen=True)
class Refinement:
    """The least-squares problem of a linkage with ordered crank angles.

    Attributes
    ----------
    task : PathTask
    sharpness : float
        Weight of penalties over the size of the path [1].
    """

    task: PathTask
    sharpness: float = SHARPNESS[1]

    @property
    def shared(self) -> int:
        """Number of unknowns before the steps between crank angles."""
        return self.task.shape_count + min(self.task.angle_count, 1)

    @property
    def steps(self) -> int:
        """Number of steps between crank angles that are unknown."""
        return max(self.task.angle_count - 1, 0)

    def vector(self, unknowns: Array) -> Array:
        """The vector (d,) of the task for unknowns."""
        k = self.shared
        later = unknowns[k - 1] + self.task.sense * np.cumsum(unknowns[k:])
        return np.concatenate([unknowns[:k], later])

    def unknowns(self, vector: Array) -> Array:
        """The unknowns of a vector (d,) of the task; steps back become zero."""
        k = self.shared
        steps = self.task.sense * np.diff(vector[k - 1 :]) if self.steps else np.empty(0)
        return np.concatenate([vector[:k], np.maximum(steps, 0.0)])

    def terms(self, unknowns: Array) -> Array:
        """Terms of the sum of squares (m,)."""
        vector = self.vector(unknowns)[None]
        off = self.task.deviations(vector)[0]
        barred = self.task.penalties(vector[:, : self.task.shape_count], self.sharpness)[0]
        turned = max(unknowns[self.shared :].sum() - TURN, 0.0)
        return np.concatenate([off.real, off.imag, barred, [self.sharpness * turned]])

    def slopes(self, unknowns: Array) -> Array:
        """Derivatives of the terms by the unknowns (m, u)."""
        task, k = self.task, self.shared
        vector = self.vector(unknowns)[None]
        shared, own = task.slopes(vector)
        scale = task.path.weights / task.path.size
        slopes = np.zeros((scale.size, unknowns.size), complex)
        slopes[:, : shared.shape[-1]] = shared[0]
        if self.steps:
            slopes[:, k - 1] = own[0]
            slopes[:, k:] = task.sense * np.tri(scale.size, self.steps, -1) * own[0][:, None]
        slopes *= scale[:, None]
        barred = task.penalty_slopes(vector[:, : task.shape_count], self.sharpness)[0]
        below = np.zeros((len(barred) + 1, unknowns.size))
        below[:-1, : task.shape_count] = barred
        below[-1, k:] = self.sharpness * (unknowns[k:].sum() > TURN)
        return np.concatenate([slopes.real, slopes.imag, below])


def refine(task: PathTask, vector: Array, steps: int = REFINED_STEPS[1]) -> Array:
    """The vector (d,) of least squares that a descent from a vector reaches, in order.

    It ends when its evaluations times its unknowns exceed `steps`, after `FEWEST_STEPS` at least.
    """
    problem = Refinement(task)
    k = problem.shared
    start = problem.unknowns(vector)
    free = np.concatenate([task.free[:k], np.ones(problem.steps, bool)])
    low = np.concatenate([task.low[:k], np.zeros(problem.steps)])[free]
    high = np.concatenate([task.high[:k], np.full(problem.steps, TURN)])[free]

    def whole(part: Array) -> Array:
        unknowns = start.copy()
        unknowns[free] = part
        return unknowns

    found = least_squares(
        lambda part: problem.terms(whole(part)),
        np.clip(start[free], low, high),
        jac=lambda part: problem.slopes(whole(part))[:, free],
        bounds=(low, high),
        x_scale="jac",
        ftol=1e-15,
        xtol=1e-15,
        gtol=1e-15,
        max_nfev=max(FEWEST_STEPS, steps // int(free.sum())),
    )
    return problem.vector(whole(found.x))
