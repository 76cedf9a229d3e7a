"""Mass, centre and moment in the plane of every link of a compiled MJCF."""

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.plane import Plane
from proofmass.sim.protocol import BadModel

MOST = 1e300  # [kg, kg m2] of a link; what is computed with it stays finite


def inertias(model: mujoco.MjModel, data: mujoco.MjData, plane: Plane, of_body: Array,
              count: int) -> tuple[Array, Array, Array]:
    """Centre, mass and moment of every link; bodies without joints belong to their parent's.

    Parameters
    ----------
    model : mujoco.MjModel
    data : mujoco.MjData
        With the kinematics of the start pose.
    plane : Plane
    of_body : ndarray (bodies,)
        Link of each body; `count` is the ground.
    count : int
        Number of moving links.

    Returns
    -------
    centre (count + 1, 2) [m], mass (count,) [kg], moment (count,) [kg m2]

    Raises
    ------
    BadModel
        A mass or a moment that is not positive or too large, at which Chipmunk would abort.
    """
    frames = data.ximat.reshape(-1, 3, 3)
    about = np.einsum("bij,i->bj", frames, plane.normal) ** 2
    own = np.einsum("bj,bj->b", about, model.body_inertia)
    points = plane.flat(data.xipos)
    centre, mass, moment = np.zeros((count + 1, 2)), np.zeros(count), np.zeros(count)
    for k in range(count):
        of = of_body == k
        m, p = model.body_mass[of], points[of]
        mass[k], centre[k] = m.sum(), m @ p / m.sum()
        moment[k] = own[of].sum() + m @ ((p - centre[k]) ** 2).sum(axis=1)
    pins = dict[int, Array]()
    for j in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE):
        k, body = int(of_body[model.jnt_bodyid[j]]), model.jnt_bodyid[j]
        if of_body[model.body_parentid[body]] == count:
            moment[k] += model.dof_armature[model.jnt_dofadr[j]]
            pins[k] = plane.flat(data.xanchor[j])
    for k in range(count):
        if not (0 < mass[k] < MOST and 0 < moment[k] < MOST):
            name = model.body(int(np.flatnonzero(of_body == k)[0])).name
            raise BadModel(f"body {name!r}: mass {mass[k]:g} kg, moment of inertia with armature "
                           f"{moment[k]:g} kg m2; both must be positive and less than {MOST:g}")
    for k, pin in pins.items():
        _swing(centre, mass, moment, k, pin)
    return centre, mass, moment


def _swing(centre: Array, mass: Array, moment: Array, k: int, pin: Array) -> None:
    """Replace a link that is nearly a point mass on a ground hinge by its dynamic equal.

    Such a link only knows its moment about the pin and mass times arm.  Chipmunk divides by the
    moment about the centre, so 1e-12 kg m2 there would multiply rounding by 1e12.
    """
    arm = centre[k] - pin
    if moment[k] < 0.1 * mass[k] * (arm @ arm):
        moment[k] += 0.5 * mass[k] * (arm @ arm)
        mass[k] *= 2.0
        centre[k] = pin + 0.5 * arm
