"""Matrices of MuJoCo's state as dense arrays, whatever form MuJoCo has them in."""

import mujoco
import numpy as np

from proofmass.base.arrays import Array


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """The mass matrix (nv, nv) of a pose, with armatures [kg, kg m, kg m^2]."""
    found = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, found)
    return found


def constraint_rows(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """The Jacobian (rows, nv) of all constraints of a pose, those of equalities first.

    It may be a view of MuJoCo's own array, which the next pose overwrites.
    """
    if not mujoco.mj_isSparse(model):
        # without rows the array keeps those of the pose before
        rows: Array = data.efc_J[: data.nefc * model.nv].reshape(data.nefc, model.nv)
        return rows
    rows = np.zeros((data.nefc, model.nv))
    mujoco.mju_sparse2dense(
        rows, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
    )
    return rows


def moment_arms(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """The moment arms (outputs, nv) of the actuators in a pose [1 or m]; see `outputs_of`."""
    arms = np.zeros((len(data.moment_rownnz), model.nv))
    if arms.size:
        mujoco.mju_sparse2dense(
            arms, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
        )
    return arms


def outputs_of(model: mujoco.MjModel, actuator: int) -> slice:
    """The outputs of an actuator: one force, or three of an actuator of an orientation."""
    first = int(model.actuator_outadr[actuator])
    return slice(first, first + int(model.actuator_outnum[actuator]))
