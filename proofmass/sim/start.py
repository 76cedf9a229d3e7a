"""The start of a run in time: pose and rates of all joints at its first sample, for every engine.

They are those of the references, `proofmass.analytic.start`, with MuJoCo's rows of the equalities
and with its coordinates.
"""

from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np

from proofmass.analytic.controls import NO_INDICES
from proofmass.analytic.numerics import CannotAssemble, without_rounding
from proofmass.analytic.start import start_pose, start_rates
from proofmass.base.arrays import Array, Index
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Run
from proofmass.sim.smooth import EQ, LOOP_EQUALITIES, ROWS_PER_EQUALITY, SmoothTerms


@dataclass(frozen=True)
class StartOfModel:
    """Equalities and driven joints of a compiled model, for `proofmass.analytic.start`.

    The start is sought near the pose `begin` (nq,); `poses` and `rates` are the indices of the
    driven joints in ``qpos`` and ``qvel``.
    """

    source: SmoothTerms
    begin: Array
    poses: Index = field(default_factory=NO_INDICES.copy)
    rates: Index = field(default_factory=NO_INDICES.copy)

    @cached_property
    def key(self) -> Array:
        """The pose `begin` with quaternions of length one."""
        pose = self.begin.copy()
        mujoco.mj_normalizeQuat(self.source.model, pose)
        return pose

    @cached_property
    def sizes(self) -> Array:
        """Units of the rates (nv,): 1 rad, or the extent of the model [m]."""
        model = self.source.model
        kind = model.jnt_type[model.dof_jntid]
        slides = kind == mujoco.mjtJoint.mjJNT_SLIDE
        first = np.arange(model.nv) - model.jnt_dofadr[model.dof_jntid] < 3
        slides |= (kind == mujoco.mjtJoint.mjJNT_FREE) & first
        return np.where(slides, model.stat.extent, 1.0)

    @cached_property
    def row_units(self) -> Array:
        """Units of the violations of the equalities (rows,) [rad or m]."""
        model, units = self.source.model, list[float]()
        for e in self.source.equality_of_row[self.source.order].tolist():
            kind = EQ(int(model.eq_type[e]))
            joint = model.jnt_dofadr[model.eq_obj1id[e]] if kind == EQ.mjEQ_JOINT else -1
            units.append(float(self.sizes[joint]) if joint >= 0 else model.stat.extent)
        return np.array(units)

    def prescribed(self, q: Array) -> tuple[Array, Array]:
        """Violations of the equalities, then values of the drives, and their Jacobian."""
        gaps, rows = self.source.equalities(q)
        rows = without_rounding(rows, self.sizes / self.row_units[:, None])
        units = np.eye(self.source.model.nv)[self.rates]
        return np.concatenate([gaps, q[self.poses]]), np.concatenate([rows, units])

    def moved(self, q: Array, move: Array) -> Array:
        """The pose that a move leads to."""
        pose = q.copy()
        mujoco.mj_integratePos(self.source.model, pose, move, 1.0)
        return pose

    def way(self, q: Array) -> Array:
        """The move from the key to a pose."""
        move = np.empty(self.source.model.nv)
        mujoco.mj_differentiatePos(self.source.model, move, 1.0, self.key, q)
        return move


def start_state(model: mujoco.MjModel, run: Run) -> tuple[Array, Array]:
    """Pose (nq,) and rates (nv,) of a compiled model at the first sample of a run in time.

    They are the closed pose nearest to that of the run's key and the rates nearest to the key's,
    with the drives at their own first values and rates; see `proofmass.analytic.start`.

    Parameters
    ----------
    model : mujoco.MjModel
        Has the key and the driven joints of the run; equalities are connect, weld, joint, tendon.
    run : Run

    Raises
    ------
    BadModel
        The loops cannot be closed with the drives at their first values.
    """
    joints = [model.joint(drive.joint) for drive in run.drives]
    poses, rates = (
        np.array([int(getattr(one, part)[0]) for one in joints], np.intp)
        for part in ("qposadr", "dofadr")
    )
    source = SmoothTerms(model, run.start)
    pose, speed = source.data.qpos.copy(), source.data.qvel.copy()
    begin = StartOfModel(source, pose, poses, rates)
    value, rate, _ = (part[:, 0] for part in run.motion(run.x[:1]))
    try:
        q = start_pose(begin, value)
    except CannotAssemble as error:
        drives = zip(run.drives, value, strict=True)
        where = ", ".join(f"{drive.joint} = {x:.6g}" for drive, x in drives)
        raise BadModel(f"{error}{where and f', with {where}'}") from None
    found, rows = begin.prescribed(q)
    return q, start_rates(rows, speed, np.append(np.zeros(len(found) - len(rate)), rate))


def loop_opening(model: mujoco.MjModel, key: str) -> float:
    """The largest distance of two points that a loop joins, in the pose of a key [m]."""
    return opening_at(SmoothTerms(model, key), key_pose(model, key)) if model.neq else 0.0


def key_pose(model: mujoco.MjModel, key: str) -> Array:
    """The pose of a key (nq,), or the initial pose of a model without keys."""
    return np.array(model.key_qpos[model.key(key).id] if model.nkey else model.qpos0)


def opening_at(terms: SmoothTerms, pose: Array) -> float:
    """The largest opening of a loop in a pose [m]."""
    gaps, first, largest = terms.equalities(pose)[0], 0, 0.0
    for e in np.flatnonzero(terms.model.eq_active0):
        kind = EQ(int(terms.model.eq_type[e]))
        if kind in LOOP_EQUALITIES:  # whose rows come first, three of them a distance
            largest = max(largest, float(np.linalg.norm(gaps[first : first + 3])))
            first += ROWS_PER_EQUALITY[kind]
    return largest
