"""How far equality constraints are open in a state of MuJoCo: one measure for all that tell it."""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from proofmass.base.arrays import Array, Index

CONNECT, WELD = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
TORQUE_SCALE = 10
"""Place of a weld's torque scale among the numbers of an equality."""


class Opening(NamedTuple):
    """How far an equality is open: its number, a distance [m] or an angle [rad], and the unit."""

    equality: int
    size: float
    unit: str


def find_openings(model: mujoco.MjModel, residuals: Array, equalities: Index) -> Iterator[Opening]:
    """The openings of equalities, of the residuals (rows,) of their rows [m or rad].

    The place of a connect or weld is open by a distance, the length of three residuals.  A weld is
    also open by an angle, which is 2 asin(r / s) for the length r of its last three residuals and
    its torque scale s.

    Parameters
    ----------
    model : MjModel
    residuals : ndarray (rows,)
        Of the equalities, which come first in ``efc_pos`` [m or rad].
    equalities : ndarray of int (rows,)
        The number of the equality of each row.
    """
    for e in np.unique(equalities).tolist():
        rows = np.abs(residuals[equalities == e])
        if int(model.eq_type[e]) not in (CONNECT, WELD):
            yield Opening(e, float(rows.max()), unit_of_coupling(model, e))
            continue
        yield Opening(e, float(np.linalg.norm(rows[:3])), "m")
        if rows.size > 3:
            share = np.linalg.norm(rows[3:]) / max(model.eq_data[e][TORQUE_SCALE], 1e-9)
            yield Opening(e, float(2.0 * np.arcsin(min(1.0, share))), "rad")


def largest_opening_of(model: mujoco.MjModel, data: mujoco.MjData) -> Opening:
    """The largest opening of a state whose constraints are known; 0 m if there are no loops."""
    if not data.ne:
        return Opening(-1, 0.0, "m")
    rows = np.array(data.efc_pos[: data.ne]), np.array(data.efc_id[: data.ne], dtype=np.intp)
    return max(find_openings(model, *rows), key=lambda opening: opening.size)


def unit_of_coupling(model: mujoco.MjModel, equality: int) -> str:
    """The unit of the residual of an equality between joints or tendons, m or rad."""
    on_joint = model.eq_type[equality] == mujoco.mjtEq.mjEQ_JOINT
    joint = model.eq_obj1id[equality]
    hinge = on_joint and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
    return "rad" if hinge else "m"
