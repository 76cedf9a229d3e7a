r"""The equations of chains whose tips are pinned to one rigid platform.

Let w_i = Rot(phi) r_i, and let n_i be the force on the tip of rod i, which is the multiplier of its
closure.  The energy of all chains is stationary under their closures if

    dV_i/dtheta = 0,   sum n_i = F,   sum w_i x n_i = M,   tip_i = P + w_i

The unknowns are theta (k n), the pose P, phi (f = 2 or 3) and n (2k); Newton's matrix is symmetric.
"""

import numpy as np

from proofmass.analytic.rods.assembly import Assembly
from proofmass.base.arrays import Array
from tests.independent.rods.chain import (
    Chain,
    carried_forces,
    chain,
    gradient,
    hessian,
    points,
    tip_slopes,
)
from tests.independent.rods.chain_matrix import Bordered

NO_LOAD = np.zeros(2)  # no force, or no line load


def clamps(a: Assembly, inputs: Array) -> Array:
    """Clamps x, y, theta (..., k, 3); the inputs (..., k) turn them or move them along guides."""
    turn, slide = (inputs, 0 * inputs) if a.guide is None else (0 * inputs, inputs * a.guide)
    place = a.clamp + slide
    return np.stack([place.real, place.imag, a.angle + turn], axis=-1)


def chains(a: Assembly, segments: int, scheme: str = "half") -> Chain:
    """Chains of the rods of an assembly, of `segments` cells each."""
    return chain(
        segments,
        length=a.length,
        stiffness=a.stiffness,
        scheme=scheme,
        rigid_extension=a.rigid_extension,
    )


def fit_pose(a: Assembly, tip: Array) -> Array:
    """The pose (..., f) whose pins are nearest to tips (..., k, 2), in least squares.

    >>> from proofmass.analytic.rods.assembly import assembly
    >>> pin = assembly([[-0.3, 0.0], [0.3, 0.0]])
    >>> fit_pose(pin, np.array([[0.0, 0.9], [0.2, 0.9]]))
    array([0.1, 0.9])
    """
    place = tip @ np.array([1.0, 1.0j])
    middle, arm = place.mean(axis=-1), a.arm.mean()
    spin = ((place - middle[..., None]) * (a.arm - arm).conj()).sum(axis=-1)
    phi = np.angle(spin) if a.dof == 3 else np.zeros(middle.shape)
    origin = middle - arm * np.exp(1j * phi)
    return np.stack([origin.real, origin.imag, phi], axis=-1)[..., : a.dof]


def arms(a: Assembly, pose: Array) -> tuple[Array, Array]:
    """w_i and dw_i/dphi (..., k, 2) [m] at a pose (..., f)."""
    w = a.arm * (np.exp(1j * pose[..., 2:]) if a.dof == 3 else np.ones((*pose.shape[:-1], 1)))
    return np.stack([w.real, w.imag], axis=-1), np.stack([-w.imag, w.real], axis=-1)


def matrix(a: Assembly, c: Chain, angle: Array, pose: Array, force: Array) -> Bordered:
    """Newton's matrix: a block of angles for each chain, bordered by pose and tip forces."""
    k, f, batch = a.rods, a.dof, pose.shape[:-1]
    by_force = np.zeros((*batch, k, c.segments, k, 2))
    by_force[..., range(k), :, range(k), :] = np.moveaxis(-tip_slopes(c, angle), (-3, -1), (0, -2))
    border = np.zeros((*batch, k, c.segments, f + 2 * k))
    border[..., f:] = by_force.reshape(*batch, k, c.segments, 2 * k)
    w, turn = arms(a, pose)
    corner = np.zeros((*batch, f + 2 * k, f + 2 * k))
    corner[..., :2, f:] = np.tile(np.eye(2), k)
    if f == 3:
        corner[..., 2, f:] = turn.reshape(*batch, 2 * k)
        corner[..., 2, 2] = -0.5 * (force * w).sum(axis=(-1, -2))
    return Bordered(
        hessian(c, angle, carried_forces(c, force, NO_LOAD)),
        border,
        corner + np.swapaxes(corner, -1, -2),
    )


def split_unknowns(a: Assembly, c: Chain, unknowns: Array) -> tuple[Array, Array, Array]:
    """Angles (..., k, n), pose (..., f) and tip forces (..., k, 2) of a vector of unknowns."""
    end = a.rods * c.segments
    angle, pose, force = np.split(unknowns, [end, end + a.dof], axis=-1)
    batch = unknowns.shape[:-1]
    return angle.reshape(*batch, a.rods, -1), pose, force.reshape(*batch, a.rods, 2)


def system(
    a: Assembly, c: Chain, place: Array, load: Array, unknowns: Array
) -> tuple[Array, Bordered]:
    """Residual (..., N) and Newton's matrix (..., N, N)."""
    angle, pose, force = split_unknowns(a, c, unknowns)
    w, turn = arms(a, pose)
    rods = gradient(c, place, angle, carried_forces(c, force, NO_LOAD), np.zeros(()))
    balance = [force.sum(axis=-2), (force * turn).sum(axis=(-1, -2))[..., None]]
    violation = points(c, place, angle)[..., -1, :] - pose[..., None, :2] - w
    batch = unknowns.shape[:-1]
    residual = np.concatenate(
        [
            rods.reshape(*batch, -1),
            np.concatenate(balance, axis=-1)[..., : a.dof] - load,
            -violation.reshape(*batch, -1),
        ],
        axis=-1,
    )
    return residual, matrix(a, c, angle, pose, force)
