r"""The largest stable time step of each integrator of MuJoCo, about the start pose.

One step of size h takes (x, v) of the linearised motion to

    v' = v + h (M + h D)^-1 M a,     x' = x + h v',     a = A_x x + A_v v,

with D = the joints' damping in Euler (0 if eulerdamp is off), the symmetric part of the damping of
all passive and actuator forces in implicitfast, and the whole damping in implicit.  RK4 takes it to
the exponential series of h times the system's matrix up to the fourth power.

The integrator ``discrete`` is implicit in the stiffness K_o of springs, tendons and actuators as
well, and solves its constraints in the same metric.  With the force -D_i ((b_i + h k_i) v + k_i x +
(1 + h b_i + h^2 k_i) a) of each soft row at the end of the step, J its rows and W, k', b' their
weights, stiffnesses and dampings then (`LinearMotion.softness`), it takes (x, v) to

    v' = v - h (M + h D + h^2 K_o + J^T W J)^-1 [(K + J^T W k' J) x + (C + h K_o + J^T W b' J) v].

The limit is the least h with more eigenvalues outside the unit circle than the motion itself has
growing modes, or with one that grows faster than these.  For one coordinate that gives the limits
on the page docs/stress.md: 2 (zeta + sqrt(1 + zeta^2)) / omega in Euler, 2 I / kv and 2.785 I / kv
of a velocity servo in Euler and RK4.

`tests/screen/test_stable_step.py` compares limits with the steps at which bare MuJoCo breaks.
"""

from dataclasses import dataclass, replace
from math import inf

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.screen.linear import DISCRETE, LinearMotion

INTEGRATORS = ("Euler", "implicitfast", "implicit", "discrete", "RK4")
"""The integrators whose limits are computed."""
OUTSIDE_CIRCLE = 1.001
"""Length of an eigenvalue [1] that counts as outside the unit circle; with 1.0001 limits are lower
by 0.1 %."""
GROWING = 1e-5
"""Growth in one step [1] from which a mode of the motion itself counts as growing."""
FASTER = 1.05
"""Factor by which a step may exaggerate the fastest growth of the motion itself."""
LIMIT_SHARE = 1e-3
"""Width of the bracket of a limit, as a share of it."""
SCAN_FACTOR, COARSE_SCAN_FACTOR, FINE_SCAN_UP_TO = 1.3, 2.0, 40
"""Factors between the steps that are tried until one is unstable: with more coordinates than the
third number, each try takes long, and the second factor is taken."""
LONGEST_STEP, LONGEST_RATIO = 1.0, 50.0
"""Limits beyond 1 s, or 50 of the model's own steps, count as none."""
FIRST_PHASE, LEAST_RATE = 0.5, 1e-3
"""The first step that is tried times the largest rate [1], and the least such rate [1/s]."""
SAME_DAMPING = 1e-9
"""Difference of two dampings, as a share of the largest, that is an error of differences."""
BEYOND = 1.01
"""The mode that breaks is that of a step this much beyond the limit [1]."""


@dataclass(frozen=True)
class StepLimit:
    """The largest stable step of an integrator.

    Attributes
    ----------
    integrator : str
    step : float
        [s]; infinite if no step up to a second is unstable.
    shape : ndarray (nv,) or None
        The mode that breaks, complex [1].
    """

    integrator: str
    step: float
    shape: Array | None = None


class Flow:
    """The linearised motion (x, v)' = A (x, v) with soft rows of some stiffness.

    Parameters
    ----------
    motion : LinearMotion
    stiffness, damping, weights : ndarray (rows,)
        Of the soft rows [SI].

    Attributes
    ----------
    matrix : ndarray (2 nv, 2 nv)
        A [SI].
    rates : ndarray (2 nv,)
        Its eigenvalues [1/s].
    """

    def __init__(
        self, motion: LinearMotion, stiffness: Array, damping: Array, weights: Array
    ) -> None:
        soft, nv = motion.soft_rows, motion.masses.shape[0]
        weighted = soft.T * weights
        added = [weighted * stiffness @ soft, weighted * damping @ soft]
        forces = np.hstack([motion.stiffness, motion.damping]) + np.hstack(added)
        answers = np.linalg.solve(motion.masses + weighted @ soft, forces)
        self.matrix = np.vstack([np.eye(nv, 2 * nv, nv), -answers])
        self.rates = np.linalg.eigvals(self.matrix)


def positive_part(matrix: Array) -> Array:
    """The symmetric part of a matrix (n, n) without its negative eigenvalues.

    >>> positive_part(np.array([[2.0, 0.0], [0.0, -1.0]])).tolist()
    [[2.0, 0.0], [0.0, 0.0]]
    """
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2.0)
    return np.asarray(vectors * np.maximum(values, 0.0) @ vectors.T)


class StepMatrices:
    """The matrices by which steps change the state of a linearised motion.

    Parameters
    ----------
    motion : LinearMotion
    """

    def __init__(self, motion: LinearMotion) -> None:
        self.motion = motion
        model = motion.pose.model
        disabled = mujoco.mjtDisableBit.mjDSBL_EULERDAMP | mujoco.mjtDisableBit.mjDSBL_DAMPER
        implicit = not model.opt.disableflags & int(disabled)
        self.implicit_dampings = {
            "Euler": np.diag(model.dof_damping * implicit),
            "implicitfast": (motion.own_damping + motion.own_damping.T) / 2.0,
            "implicit": motion.damping,
        }
        self.implicit_stiffness = positive_part(motion.own_stiffness)
        self.flows: dict[bytes, Flow] = {}
        self.limits: dict[str, StepLimit] = {}

    def flow(self, step: float) -> "Flow":
        """The motion with soft rows as they are with a time step; it is kept while they are."""
        softness = self.motion.softness(step)
        key = np.concatenate(softness).tobytes()
        if key not in self.flows:
            self.flows[key] = Flow(self.motion, *softness)
        return self.flows[key]

    def step(self, integrator: str, step: float) -> Array:
        """The matrix (2 nv, 2 nv) that one step applies to (x, v)."""
        if integrator == "discrete":
            return self.discrete_step(step)
        flow = self.flow(step).matrix
        nv = flow.shape[0] // 2
        if integrator == "RK4":
            matrix = np.eye(2 * nv)
            for k in (4, 3, 2, 1):  # Horner's form of the exponential series
                matrix = np.eye(2 * nv) + step * flow @ matrix / k
            return matrix
        masses, implicit = self.motion.masses, self.implicit_dampings[integrator]
        kick = step * np.linalg.solve(masses + step * implicit, masses @ flow[nv:])
        kick[:, nv:] += np.eye(nv)
        return np.vstack([np.eye(nv, 2 * nv) + step * kick, kick])

    def discrete_step(self, step: float) -> Array:
        """The matrix (2 nv, 2 nv) of a step of ``discrete``; its limits of forces are left out."""
        motion, implicit = self.motion, self.implicit_stiffness
        stiffness, damping, weights = motion.softness(step, DISCRETE)
        soft, nv = motion.soft_rows, motion.masses.shape[0]
        weighted = soft.T * weights
        metric = motion.masses + step * self.implicit_dampings["implicitfast"]
        metric += step**2 * implicit + weighted @ soft
        placed = motion.stiffness + weighted * stiffness @ soft
        moving = motion.damping + step * implicit + weighted * damping @ soft
        kick = -step * np.linalg.solve(metric, np.hstack([placed, moving]))
        kick[:, nv:] += np.eye(nv)
        return np.vstack([np.eye(nv, 2 * nv) + step * kick, kick])

    def is_unstable(self, integrator: str, step: float) -> bool:
        """Whether a step grows in more ways, or faster, than the motion itself."""
        exponents = step * self.flow(step).rates
        growth = np.exp(np.clip(exponents.real, -50.0, 50.0))
        stepped = np.abs(
            1 + exponents * (1 + exponents / 2 * (1 + exponents / 3 * (1 + exponents / 4)))
            if integrator == "RK4"
            else np.linalg.eigvals(self.step(integrator, step))
        )
        more = int((stepped > OUTSIDE_CIRCLE).sum()) > int((growth > 1.0 + GROWING).sum())
        return more or bool(stepped.max() > FASTER * max(growth.max(), 1.0))

    def limit(self, integrator: str, own: float) -> StepLimit:
        """The largest stable step; `own` is the model's step [s].

        Integrators that are implicit in the same damping share it: at rest inertia damps nothing,
        so that implicit and implicitfast do.
        """
        for name, known in self.limits.items():
            if self.is_same_step(name, integrator):
                return replace(known, integrator=integrator)
        self.limits[integrator] = self.find_limit(integrator, own)
        return self.limits[integrator]

    def is_same_step(self, one: str, other: str) -> bool:
        """Whether two integrators are implicit in the same damping, and in nothing else."""
        if not {one, other} <= self.implicit_dampings.keys():
            return False
        dampings = self.implicit_dampings[one], self.implicit_dampings[other]
        largest = max(float(np.abs(damping).max(initial=0.0)) for damping in dampings)
        apart = np.abs(dampings[0] - dampings[1]).max(initial=0.0)
        return bool(apart <= SAME_DAMPING * largest)

    def find_limit(self, integrator: str, own: float) -> StepLimit:
        """The largest stable step, searched from far below."""
        fastest = float(np.abs(self.flow(own).rates).max(initial=0.0))
        count = self.motion.masses.shape[0]
        factor = SCAN_FACTOR if count <= FINE_SCAN_UP_TO else COARSE_SCAN_FACTOR
        holds, breaks = 0.0, min(FIRST_PHASE / max(fastest, LEAST_RATE), own)
        while not self.is_unstable(integrator, breaks):
            holds, breaks = breaks, factor * breaks
            if breaks > max(LONGEST_STEP, LONGEST_RATIO * own):
                return StepLimit(integrator, inf)
        while breaks - holds > LIMIT_SHARE * breaks:
            middle = 0.5 * (holds + breaks)
            unstable = self.is_unstable(integrator, middle)
            holds, breaks = (holds, middle) if unstable else (middle, breaks)
        values, vectors = np.linalg.eig(self.step(integrator, BEYOND * breaks))
        worst = vectors[: self.motion.masses.shape[0], int(np.argmax(np.abs(values)))]
        return StepLimit(integrator, breaks, worst)
