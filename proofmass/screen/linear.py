r"""The motion of a model about its start pose, linearised, with soft and with exact loops.

About a pose at rest with accelerations a and multipliers l of the loops, small motions x obey

    M x'' + C x' + K x = J^T dl,     J x'' = 0 for exact loops,

with K = d/dq [M(q) a - f(q) - J(q)^T l] at fixed a and l, so that the stiffness that loads give to
loops and weight is part of it, and C = -df/dv.  MuJoCo's loops are soft: with the rows J of
equalities and of joint limits that carry load, their weights D = 1/R, stiffnesses k (times the
impedance) and dampings b,

    (M + J^T D J) x'' = -(K + J^T D k J) x - (C + J^T D b J) x'.

`MuJoCo, Computation, Constraint model`_ defines R, k, b.  The derivatives are central differences;
against ``mjd_transitionFD`` the matrix of a step differs by 1e-11 of its largest entry in trees.

.. _MuJoCo, Computation, Constraint model: https://mujoco.readthedocs.io/en/stable/computation/
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.screen.finding import NamedElement
from proofmass.screen.pose import RestPose

POSE_STEP, VELOCITY_STEP = 1e-6, 1e-5
"""Steps of central differences [rad or m, and per s]; half and twice as long change limits of steps
by less than 1e-4 of themselves."""
MULTIPLIER_SHARE = 1e-10
"""Least singular value for the multipliers of loops, as a share of the largest."""
LEAST_MODE_RATE = 1e-3
"""Modes whose eigenvalue is smaller are free motions [1/s]."""
ROUNDED_DAMPING = 1e-9
"""Damping ratio that counts as zero: what central differences and eigenvalues leave of it [1]."""
DISCRETE = mujoco.mjtIntegrator.mjINT_DISCRETE
LINEAR = mujoco.mjtConstraintState.mjCNSTRSTATE_QUADRATIC


@dataclass(frozen=True)
class VibrationMode:
    """A mode of the linearised motion with exact loops.

    Attributes
    ----------
    rate : complex
        Its eigenvalue [1/s]; of a pair the one with the positive imaginary part.
    joint : NamedElement
        The joint with the largest share of its kinetic energy.
    """

    rate: complex
    joint: NamedElement

    @property
    def frequency(self) -> float:
        """[Hz]"""
        return abs(self.rate) / (2.0 * np.pi)

    @property
    def damping(self) -> float:
        """The damping ratio [1]: 1 for a mode that does not oscillate and decays."""
        ratio = -self.rate.real / abs(self.rate)
        return ratio if abs(ratio) > ROUNDED_DAMPING else 0.0

    @property
    def oscillates(self) -> bool:
        """Whether it belongs to a pair of complex eigenvalues."""
        return self.rate.imag > 0.0


class LinearMotion:
    """The linearised motion about a pose at rest.

    Parameters
    ----------
    pose : RestPose
        With closed loops.

    Attributes
    ----------
    masses, stiffness, damping : ndarray (nv, nv)
        M, K and C.
    own_stiffness, own_damping : ndarray (nv, nv)
        The parts of K and C that springs, dampers and actuators cause, without inertia and weight.
    rows, multipliers : ndarray (equations, nv), (equations,)
        J and l of the loops.
    soft_rows : ndarray (rows, nv)
        The rows of loops and of joint limits that carry load.
    accelerations : ndarray (nv,)
        Of the start.
    """

    def __init__(self, pose: RestPose) -> None:
        self.pose = pose
        pose.enter(pose.qpos)
        self.masses, self.rows = pose.masses, pose.constraints.rows
        self.accelerations, self.multipliers = self.solve_start()
        self.stiffness, self.own_stiffness = self.differentiate_pose()
        self.damping, self.own_damping = self.differentiate_velocity()
        pose.enter(pose.qpos)
        mujoco.mj_forward(pose.model, pose.data)  # which rows carry load
        loops, states = pose.data.ne, pose.data.efc_state[: pose.data.nefc]
        self.carrying = (np.arange(pose.data.nefc) < loops) | (states == LINEAR)
        self.soft_rows = pose.all_rows[self.carrying]

    def solve_start(self) -> tuple[Array, Array]:
        """Accelerations, and the least multipliers of the loops, of the start."""
        free = np.linalg.solve(self.masses, self.pose.forces)
        answers = np.linalg.solve(self.masses, self.rows.T)
        inverse = np.linalg.pinv(self.rows @ answers, rcond=MULTIPLIER_SHARE, hermitian=True)
        multipliers = -inverse @ (self.rows @ free)
        return free + answers @ multipliers, multipliers

    def differentiate_pose(self) -> tuple[Array, Array]:
        """The stiffness K (nv, nv), and its part without inertia and weight."""
        changes = POSE_STEP * np.eye(self.pose.model.nv)
        sides = [np.array(self.residuals(dq)) - self.residuals(-dq) for dq in changes]
        whole, own = np.transpose(sides, (1, 2, 0)) / (2.0 * POSE_STEP)
        return whole, own

    def residuals(self, change: Array) -> tuple[Array, Array]:
        """M a - f - J^T l (nv,) in another pose, with a and l of the start, and its own part."""
        pose = self.pose
        pose.enter(pose.moved(change))
        force, loop_force = np.zeros((2, pose.model.nv))
        mujoco.mj_mulM(pose.model, pose.data, force, self.accelerations)
        if self.multipliers.size == pose.data.ne > 0:
            multipliers = np.zeros(pose.data.nefc)
            multipliers[: self.multipliers.size] = self.multipliers
            mujoco.mj_mulJacTVec(pose.model, pose.data, loop_force, multipliers)
        return np.asarray(force - pose.forces - loop_force), -pose.own_forces

    def differentiate_velocity(self) -> tuple[Array, Array]:
        """The damping C (nv, nv), and its part without inertia."""
        pose, all_forces, own_forces = self.pose, [], []
        pose.enter(pose.qpos)
        for velocity in VELOCITY_STEP * np.eye(pose.model.nv):
            sides = []
            for pose.data.qvel[:] in (velocity, -velocity):
                pose.evaluate_forces()
                sides.append((pose.forces, pose.own_forces))
            (ahead, own_ahead), (back, own_back) = sides
            all_forces.append(back - ahead)
            own_forces.append(own_back - own_ahead)
        size = 2 * (pose.model.nv,)
        return (
            np.transpose(all_forces).reshape(size) / (2.0 * VELOCITY_STEP),
            np.transpose(own_forces).reshape(size) / (2.0 * VELOCITY_STEP),
        )

    def softness(
        self, step: float, integrator: mujoco.mjtIntegrator | None = None
    ) -> tuple[Array, Array, Array]:
        """Stiffness k, damping b and weight D (rows,) of the soft rows with a time step [SI].

        MuJoCo makes a `solref` at least twice the step (`refsafe`), so that they depend on it.  The
        integrator ``discrete`` evaluates them at the end of the step.
        """
        pose, count = self.pose, self.pose.data.nefc
        if not self.soft_rows.size:
            return np.zeros(0), np.zeros(0), np.zeros(0)
        own, discrete = (pose.model.opt.timestep, pose.model.opt.integrator), integrator == DISCRETE
        pose.model.opt.timestep = step
        pose.model.opt.integrator = own[1] if integrator is None else integrator
        pose.enter(pose.qpos)
        if discrete:  # it finds its weights with the forces
            mujoco.mj_forward(pose.model, pose.data)
        pose.model.opt.timestep, pose.model.opt.integrator = own
        table = np.array(pose.data.efc_KBIP[: 4 * count]).reshape(-1, 4)[self.carrying]
        weights = np.array(pose.data.efc_D[:count])[self.carrying]
        stiffness, damping = table[:, 0] * table[:, 2], table[:, 1]
        if discrete:
            # the row's acceleration is -b (v + h a) - k (x + h v + h^2 a), solved for a
            damping = damping + step * stiffness
            shared = 1.0 + step * damping
            return stiffness / shared, damping / shared, weights
        return stiffness, damping, weights

    def modes(self) -> list[VibrationMode]:
        """The modes with exact loops, the fastest first; one for each pair of eigenvalues."""
        motions = self.pose.constraints.motions
        count = motions.shape[1]
        if not count:
            return []
        masses = motions.T @ self.masses @ motions
        forces = motions.T @ np.hstack([self.stiffness @ motions, self.damping @ motions])
        system = np.vstack([np.eye(count, 2 * count, count), -np.linalg.solve(masses, forces)])
        rates, shapes = np.linalg.eig(system)
        moving = motions @ shapes[:count]
        energies = np.abs(moving.conj() * (self.masses @ moving))
        return [
            VibrationMode(complex(rates[k]), self.pose.joint_of(int(np.argmax(energies[:, k]))))
            for k in np.argsort(-np.abs(rates))
            if rates[k].imag >= 0.0 and abs(rates[k]) > LEAST_MODE_RATE
        ]
