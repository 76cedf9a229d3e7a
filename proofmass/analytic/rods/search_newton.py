"""Newton's method for an assembly in the charts of its rods and the pose of its platform."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipkm1

from proofmass.analytic.numerics import Array, Complex
from proofmass.analytic.rods.search_sheet import Rods, rods
from proofmass.analytic.rods.state import State, clamps

MOST = 30  # steps; most starts that arrive take less than ten
LONGEST = 1.0  # step of alpha, of q, of phi and of P [L]
SHARE = 0.3  # of a large alpha that its step may be
STILL = 1e-11  # the last step; what is left is its square
LEAST = 1e-3  # of alpha, below which q says nothing
FURTHEST = 340.0  # alpha and q: k' = sech(q) is 1e-147
SINGULAR = 1e-200  # determinant of a matrix that is not solved with


def turned(s: State, found: Rods) -> tuple[Complex, Complex, Complex, Complex]:
    """Tips from their clamps (k, n), loads on them, and derivatives (k, 2, n) of both by charts."""
    a = s.assembly
    turn = np.exp(1j * clamps(s)[0])[:, None]
    length, unit = a.length[:, None] * turn, (a.stiffness / a.length**2)[:, None] * turn
    return (length * found.tip, unit * found.force,
            np.moveaxis(length * found.tip_slope, 0, 1),
            np.moveaxis(unit * found.force_slope, 0, 1))


def system(s: State, chart: Array, pose: Array) -> tuple[Array, Array]:
    """Residual (n, N) and Newton's matrix (n, N, N), N = 2 k + p: closures, then balance."""
    a, k, p = s.assembly, s.assembly.rods, s.assembly.freedoms
    tip, force, tips, forces = turned(s, rods(chart[:, 0], chart[:, 1]))
    arm = np.exp(1j * pose[2]) * a.arm[:, None]
    gap = clamps(s)[1][:, None] + tip - pose[0] - 1j * pose[1] - arm
    residual = [gap.real, gap.imag, *(wrench(force, arm) - np.append(s.load, 0.0)[:3, None])[:p]]
    matrix = np.zeros((pose.shape[1], 2 * k + p, 2 * k + p))
    for i in range(k):
        own = slice(2 * i, 2 * i + 2)
        matrix[:, i, own], matrix[:, k + i, own] = tips[i].real.T, tips[i].imag.T
        matrix[:, 2 * k:, own] = np.moveaxis(wrench(forces[i][None], arm[i][None, None])[:p], -1, 0)
    matrix[:, :k, 2 * k] = matrix[:, k: 2 * k, 2 * k + 1] = -1.0
    if p == 3:
        matrix[:, :k, -1], matrix[:, k: 2 * k, -1] = arm.imag.T, -arm.real.T
        matrix[:, -1, -1] = -(arm.conj() * force).real.sum(axis=0)
    return np.concatenate([np.atleast_2d(row) for row in residual]).T, matrix


def wrench(force: Complex, arm: Complex) -> Array:
    """Sum of forces (k, ...) and of their moments about P: (3, ...)."""
    return np.stack([force.real.sum(axis=0), force.imag.sum(axis=0),
                     (arm.conj() * force).imag.sum(axis=0)])


def solve(s: State, chart: Array, pose: Array) -> tuple[Array, Array]:
    """Charts (k, 2, m) and poses (3, m) of the starts that arrive."""
    k, p = s.assembly.rods, s.assembly.freedoms
    x = np.concatenate([chart.reshape(2 * k, -1), pose[:p]])
    left, done = np.arange(x.shape[1]), np.zeros(x.shape[1], bool)
    for _ in range(MOST):
        step = solved(*system(s, *split(x[:, left], k))).T
        size = lengths(s, x[:, left], step).max(axis=0)
        x[:, left] -= step / np.maximum(size, 1.0)
        x[: 2 * k: 2] = np.maximum(x[: 2 * k: 2], LEAST)
        done[left] = size < STILL
        left = left[np.isfinite(size) & ~done[left] & inside(x[:, left], k)]
        if not left.size:
            break
    return split(x[:, done], k)


def lengths(s: State, x: Array, step: Array) -> Array:
    """Steps (2 k + p, n) over the longest that are taken.

    Where alpha is large it may change by a share of itself, with q so that loops stay in place:
    alpha - n K does, with n K next to the clamp and K = q + ln 2.
    """
    k = s.assembly.rods
    alpha, q = x[: 2 * k: 2], x[1: 2 * k: 2]
    nearest = 2.0 * np.floor(0.5 * alpha / ellipkm1(1.0 / np.cosh(q) ** 2)) + 1.0
    size = np.abs(step) / LONGEST
    size[2 * k: 2 * k + 2] /= s.assembly.scale[0]
    size[1: 2 * k: 2] = np.abs(step[: 2 * k: 2] - nearest * np.sign(q) * step[1: 2 * k: 2])
    size[: 2 * k: 2] /= np.maximum(1.0, SHARE * alpha)
    return size


def inside(x: Array, k: int) -> NDArray[np.bool_]:
    """Whether alpha and q of all rods are such that their loads can be computed."""
    return np.asarray((np.abs(x[: 2 * k]) < FURTHEST).all(axis=0))


def split(x: Array, k: int) -> tuple[Array, Array]:
    """Charts (k, 2, n) and poses (3, n) from the unknowns; the phi of a pin is zero."""
    pose = np.zeros((3, x.shape[1]))
    pose[: len(x) - 2 * k] = x[2 * k:]
    return x[: 2 * k].reshape(k, 2, -1), pose


def solved(right: Array, matrix: Array) -> Array:
    """matrix^-1 right by the batch; NaN where that is singular."""
    good = np.flatnonzero(np.isfinite(matrix).all(axis=(1, 2)))
    good = good[np.abs(np.linalg.det(matrix[good])) > SINGULAR]
    out = np.full_like(right, np.nan)
    out[good] = np.linalg.solve(matrix[good], right[good][..., None])[..., 0]
    return out


def negative(s: State, chart: Array, pose: Array) -> NDArray[np.int_]:
    r"""Number of negative eigenvalues (n,) of the potential's second variation.

    By Sturm, a rod under its dead load alone has as many as Jacobi's field has zeros: one between
    any two inflections, and one more if the field has changed its sign since the last.  Pinning the
    tip takes away those of its stiffness K_i, the platform brings those of the whole stiffness::

        negative = sum_i [mode_i - 1 + (y_i passed zero) - neg(K_i)] + neg(sum A_i^T K_i A_i + ...)

    since the inertia of a bordered matrix is that of its block and of the Schur complement.
    """
    a, found = s.assembly, rods(chart[:, 0], chart[:, 1])
    _, force, tips, forces = turned(s, found)
    own = np.floor(found.waves)
    own += (-1.0) ** own * found.field < 0.0
    arm = np.exp(1j * pose[2]) * a.arm[:, None]
    whole, pinned = np.zeros((pose.shape[1], a.freedoms, a.freedoms)), 0
    for i in range(a.rods):
        move, pull = (np.stack([slope.real, slope.imag]).T.swapaxes(1, 2)
                      for slope in (tips[i], forces[i]))
        stiff = pull @ np.linalg.inv(move)
        pinned = pinned + (np.linalg.eigvalsh(stiff) < 0.0).sum(axis=-1)
        lever = np.zeros((pose.shape[1], 2, 3))
        lever[:, 0, 0] = lever[:, 1, 1] = 1.0
        lever[:, 0, 2], lever[:, 1, 2] = -arm[i].imag, arm[i].real
        lever = lever[..., : a.freedoms]
        whole += lever.swapaxes(1, 2) @ stiff @ lever
    if a.freedoms == 3:
        whole[:, 2, 2] -= (arm.conj() * force).real.sum(axis=0)
    total = own.sum(axis=0) - pinned + (np.linalg.eigvalsh(whole) < 0.0).sum(axis=-1)
    return np.asarray(total, int)
