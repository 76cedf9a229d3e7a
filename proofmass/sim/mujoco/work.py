"""The processor time of MuJoCo's steps, counted instead of measured.

What decides how far a motion is followed, or which of two settings is cheaper, must not depend on
the machine and on its other work.  So the time of a step is computed from the sizes of the model
and from the constraints and iterations of the step itself.  The coefficients of `EVALUATION` are a
non-negative least-squares fit to measured times of 172 runs: the models of this project, chains of
up to 300 bodies, and piles of up to 150 spheres, boxes, cylinders and meshes, from 1 µs to 13 ms a
step.  The fit is within a factor of 0.65 to 1.3 of nine tenths of the measured times, and of 0.35
to 1.65 of all, on the processor on which they were measured.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

from proofmass.base.arrays import Array
from proofmass.sim.mujoco.settings import STAGES

EVALUATION = {
    "evaluation": 1.07e-6,
    "body or degree of freedom": 1.3e-7,
    "product of the factorization": 1.3e-10,
    "row of a constraint": 1.8e-7,
    "product of an iteration": 4e-10,
    "element of a flex": 3.5e-7,
}
"""Processor time of one evaluation of the forces, by what it has [s]."""
PYTHON_STEP = 2e-6
"""Processor time of a call of MuJoCo from Python for one step, with the inputs of that step [s]."""
POINT_OF_A_DISTANCE_FIELD = 1e-6
"""Processor time of an iteration of a point that seeks a contact of a signed distance field [s].

With it the counted time of eight models of MuJoCo's plugin ``sdf`` is 0.4 to 9 times the measured
one; without it it is 1/5 to 1/156."""
POSE_EVALUATIONS = 30
"""Evaluations of the forces that cost as much as the solution of a pose, with its iterations."""
IMPLICIT_PRODUCT = 5.3e-10
"""Processor time of a product of the factorization that the integrator ``implicit`` adds [s]."""


class StepWork:
    """Counts the processor time of the steps of a model.

    Attributes
    ----------
    fixed, added : float
        Processor time of an evaluation of the forces without constraints, and what the integrator
        adds to a step [s].
    stages : int
        Evaluations of the forces in a step.
    pairs : ndarray (pairs, 2)
        Pairs of geoms that may touch, of which one is a signed distance field.
    reach : ndarray (pairs,)
        Distance of their centres up to which their contacts are sought [m].
    search : float
        Processor time in which those of a pair are sought [s].
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        integrator = mujoco.mjtIntegrator(model.opt.integrator)
        products = float((model.M_rownnz.astype(float) ** 2).sum())
        self.fixed = (
            EVALUATION["evaluation"]
            + EVALUATION["body or degree of freedom"] * (model.nbody + model.nv)
            + EVALUATION["product of the factorization"] * products
            + EVALUATION["element of a flex"] * model.nflexelem
        )
        self.pairs = pairs_with_a_distance_field(model)
        self.reach = self.reach_of(model)
        self.search = (
            POINT_OF_A_DISTANCE_FIELD * model.opt.sdf_initpoints * model.opt.sdf_iterations
        )
        self.stages = STAGES.get(integrator.name.removeprefix("mjINT_"), 1)
        self.added = 0.0
        if integrator == mujoco.mjtIntegrator.mjINT_IMPLICIT:
            self.added = IMPLICIT_PRODUCT * float((model.D_rownnz.astype(float) ** 2).sum())

    def reach_of(self, model: mujoco.MjModel) -> Array:
        """The distance of the centres of each pair up to which its contacts are sought [m]."""
        return np.asarray(model.geom_rbound[self.pairs].sum(axis=1))

    @property
    def evaluations(self) -> float:
        """Evaluations of the dynamics that a step costs [1]: 1, 4 in RK4, and more in ``implicit``.

        The derivatives of ``implicit`` count as the share of an evaluation that they take.
        """
        return self.stages + self.added / self.fixed

    def evaluation(self, data: mujoco.MjData) -> float:
        """Processor time of an evaluation with as many constraints as the last one [s]."""
        fixed = self.fixed
        if self.pairs.size:
            one, other = data.geom_xpos[self.pairs].swapaxes(0, 1)
            near = np.linalg.norm(one - other, axis=1) < self.reach
            fixed += self.search * int(near.sum())
        if not data.nefc:
            return fixed
        iterations = int(data.solver_niter[: max(1, data.nisland)].sum())
        return (
            fixed
            + EVALUATION["row of a constraint"] * data.nefc
            + EVALUATION["product of an iteration"] * data.nJ * max(1, iterations)
        )

    def pose(self) -> float:
        """Processor time of the solution of a pose [s]."""
        return POSE_EVALUATIONS * (self.fixed + PYTHON_STEP)

    def step(self, data: mujoco.MjData) -> float:
        """Processor time of a step like the last one [s]."""
        return self.stages * self.evaluation(data) + self.added


def pairs_with_a_distance_field(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Pairs of geoms (pairs, 2) that may touch, of which one is a signed distance field.

    Contacts with a plane cost little.
    """
    fields = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_SDF)
    if not fields.size:
        return np.zeros((0, 2), np.intp)
    one, other = (grid.ravel() for grid in np.meshgrid(fields, np.arange(model.ngeom)))
    body = model.body_weldid[model.geom_bodyid]
    kinds, partners = model.geom_contype, model.geom_conaffinity
    touch = (kinds[one] & partners[other]) | (kinds[other] & partners[one])
    twice = np.isin(other, fields) & (other <= one)
    plane = model.geom_type[other] == mujoco.mjtGeom.mjGEOM_PLANE
    kept = ~plane & (touch != 0) & (body[one] != body[other]) & ~twice
    return np.stack([one[kept], other[kept]], axis=1)
