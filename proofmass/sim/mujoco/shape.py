"""One pose at rest in MuJoCo, and the shapes that its rods have in it.

The start shapes are far from rest: Newton's method descends in strides, however far; see
`proofmass.sim.mujoco.rest`.
"""

import time

import mujoco
import numpy as np

from proofmass.sim.mujoco.model import Recorder
from proofmass.sim.mujoco.reading import drive_moments, withhold
from proofmass.sim.mujoco.rest import linkage_of
from proofmass.sim.mujoco.sweep import NO_ACC
from proofmass.sim.plane import find_plane
from proofmass.sim.protocol import Curves, Run
from proofmass.sim.rod_chain import Chain
from proofmass.sim.rod_shape import Pose, of_rods, shapes

VELOCITY = int(mujoco.mjtStage.mjSTAGE_VEL)


def rest(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Let the model come to rest with its drives held at their first values.

    Rods are read at the arc lengths ``run.x``; sensors have the same value everywhere.

    Raises
    ------
    BadModel
        The loops cannot be closed, or the rest that is found is not stable.
    Unsupported
        Nothing brings the freedoms to rest, or an equality is of another kind.
    """
    began = time.perf_counter()
    linkage = linkage_of(model, data, run)
    tangent = linkage.move(run.motion(run.x[:1])[0][:, 0])
    linkage.check_limits()
    sensors = tuple(c for c in run.channels if c not in of_rods(run))
    record = Recorder(model, data, sensors, 1)
    missing = withhold(record, VELOCITY, NO_ACC)
    mujoco.mj_forward(model, data)
    record.sample(0)
    curves = record.curves() | drive_moments(
        model, linkage, record, linkage.holding_moments(tangent)[None])
    curves = {name: np.repeat(values, run.x.size) for name, values in curves.items()}
    curves |= shapes(run, lambda one: pose(model, data, one))
    return Curves(run.x, curves, missing, gap=float(record.gaps().max()),
                  seconds=time.perf_counter() - began, steps=1)


def pose(model: mujoco.MjModel, data: mujoco.MjData, one: Chain) -> Pose:
    """Vertices, angles and bends of a rod's links."""
    links = [model.body(name).id for name in one.names]
    ahead = data.xmat[links].reshape(-1, 3, 3)[:, :, 0]
    places = np.vstack([data.xpos[links], data.site(f"{one.rod.name}.tip").xpos])
    x, y = find_plane(model, data).flat(ahead).T
    bends = np.array([data.joint(name).qpos[0] if jointed else 0.0
                      for name, jointed in zip(one.names, one.jointed, strict=True)])
    return places, np.arctan2(y, x), bends
