r"""When an assembly closes and is in balance: equations, exact Jacobian, Newton's method.

For each rod, with e its end behind the rigid prolongation, and for the platform::

    m0 + Im(conj(n) (e - O)) = 0          the pin carries no moment
    e - P - exp(i phi) r     = 0          the end is at its pin
    sum n - F                = 0          the tips carry the dead load
    sum Im(conj(exp(i phi) r) n) - M = 0  about P

Source: Pérez Gámiz 2018, eqs 98 and 109; its eqs 104 and 113 have the wrong sign of F, and its last
moment equation, about the frame's origin, is these rows combined, with the same determinant.
"""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array, Complex
from proofmass.analytic.rods.assembly import Assembly
from proofmass.analytic.rods.flow import flow
from proofmass.analytic.rods.state import Columns, State, clamps, columns

SURE = 1e-8  # relative step after which Newton's method has squared it to rounding
MOST = 60  # trial steps of Newton's method
FAR = 1e3  # way from a first guess, in sizes of the unknowns, beyond which it is given up
SMALLEST = 1e-2  # part of a step that is tried
ROUNDING = 1e-10  # residual over its size below which a step need not lessen it


def closure(s: State) -> tuple[Array, Array]:
    """Residuals (..., 3 k + p) and their derivatives (..., 3 k + p, 4 k + 2 p) by the vector."""
    a, k = s.assembly, s.assembly.rods
    theta, clamp, n = clamps(s)
    end, ends = tips(a, theta, s.moment, n)
    x, y, *turn = np.moveaxis(s.pose, -1, 0)
    arm = a.arm * np.exp(1j * turn[0])[..., None] if turn else np.zeros_like(n)
    gap = clamp + end - (x + 1j * y)[..., None] - arm
    carried = np.stack([s.moment + (n.conj() * end).imag, gap.real, gap.imag], axis=-1)
    f = [carried.reshape(*s.vector.shape[:-1], 3 * k), wrench(n, arm, a.freedoms) - s.load]
    jacobian = np.zeros((*s.vector.shape[:-1], 3 * k + a.freedoms, s.vector.shape[-1]))
    _rods(jacobian, a, n, end, ends)
    _platform(jacobian, a, n, arm)
    return np.concatenate(f, axis=-1), jacobian


def tips(a: Assembly, theta: Array, moment: Array, n: Complex) -> tuple[Complex, Complex]:
    """Ends (..., k) from their clamps, and their derivatives (4, ..., k) by m0, n_x, n_y, theta.

    Turning the clamp and the force together turns the whole rod, which gives the last.
    """
    z, angle = flow(theta, moment, n, a.length, a.stiffness)
    rigid = a.prolongation * np.exp(1j * angle[0])
    end = z[0] + rigid
    by = z[1:] + 1j * rigid * angle[1:]
    turned = 1j * end + n.imag * by[1] - n.real * by[2]
    return end, np.concatenate([by, turned[None]])


def wrench(n: Complex, arm: Complex, freedoms: int) -> Array:
    """Sum of forces (..., k) on the tips, and of their moments about P: (..., p)."""
    rows = [n.real, n.imag, (arm.conj() * n).imag]
    return np.stack([row.sum(axis=-1) for row in rows[:freedoms]], axis=-1)


def _rods(jacobian: Array, a: Assembly, n: Complex, end: Complex, ends: Complex) -> None:
    """Derivatives of the rods' rows by what they carry and by their inputs."""
    direct = np.stack([np.ones_like(end.real), end.imag, -end.real, np.zeros_like(end.real)])
    moment = (n.conj() * ends).imag + direct
    for i in range(a.rods):
        rows = slice(3 * i, 3 * i + 3)
        block = np.stack([moment, ends.real, ends.imag])[..., i]  # (row, column, ...)
        block = np.moveaxis(block, (0, 1), (-2, -1))
        jacobian[..., rows, rows] = block[..., :3]
        q = columns(a, "inputs")[i]
        if a.guide is None:
            jacobian[..., rows, q] = block[..., 3]
        else:
            jacobian[..., rows, q] = [0.0, a.guide[i].real, a.guide[i].imag]


def _platform(jacobian: Array, a: Assembly, n: Complex, arm: Complex) -> None:
    """Derivatives by the pose, and all of the balance of the platform."""
    k, p = a.rods, a.freedoms
    balance = np.arange(3 * k, 3 * k + p)
    x, y, *phi = columns(a, "pose")
    force_x, force_y = np.arange(1, 3 * k, 3), np.arange(2, 3 * k, 3)
    jacobian[..., force_x, x] = jacobian[..., force_y, y] = -1.0
    jacobian[..., balance[0], force_x] = jacobian[..., balance[1], force_y] = 1.0
    jacobian[..., balance, columns(a, "load")] = -1.0
    if phi:
        jacobian[..., force_x, phi[0]], jacobian[..., force_y, phi[0]] = arm.imag, -arm.real
        jacobian[..., balance[2], force_x] = -arm.imag
        jacobian[..., balance[2], force_y] = arm.real
        jacobian[..., balance[2], phi[0]] = -(arm.conj() * n).real.sum(axis=-1)


def sizes(a: Assembly) -> tuple[Array, Array]:
    """Sizes of the residuals (3 k + p,) and of a state's vector (4 k + 2 p,), to compare units."""
    length, force, moment = a.scale
    rods, pose = np.tile([moment, force, force], a.rods), [length, length, 1.0][:a.freedoms]
    load = [force, force, moment][:a.freedoms]
    inputs = np.full(a.rods, 1.0 if a.guide is None else length)
    return (np.concatenate([np.tile([moment, length, length], a.rods), load]),
            np.concatenate([rods, pose, inputs, load]))


def newton(s: State, free: Columns, within: ArrayLike = FAR) -> tuple[State, Array]:
    """Close states (n, ...) by some columns of their vectors; and how far each went.

    Steps are halved while they do not lessen the residual.  States that do not close are NaN.

    Parameters
    ----------
    s : State (n,)
        First guesses.
    free : columns that are found
    within : way (n,) from the guess beyond which a state is given up

    Returns
    -------
    State (n,)
    moved : ndarray (n,)
        Length of the way from the first guess, each column over its size; inf if NaN.
    """
    a, scale = s.assembly, sizes(s.assembly)[1]
    at, left = np.full_like(s.vector, np.nan), np.arange(len(s.vector))
    here, part, within = s.vector, np.ones(len(at)), np.broadcast_to(within, len(at))
    norm, step = _step(a, here, free)
    for _ in range(MOST):
        trial = here + part[:, None] * step
        near = np.linalg.norm((trial - s.vector[left]) / scale, axis=-1) <= within[left]
        keep = near & (part > SMALLEST)
        left, here, part, norm, step, trial = (
            values[keep] for values in (left, here, part, norm, step, trial))
        if not left.size:
            break
        now, onward = _step(a, trial, free)
        good = (now <= norm) | (now < ROUNDING)
        met = good & (np.linalg.norm(step / scale, axis=-1) < SURE)
        at[left[met]] = trial[met]
        here, step = (np.where(good[:, None], *pair) for pair in ((trial, here), (onward, step)))
        norm, part = np.where(good, now, norm), np.where(good, 1.0, part / 2.0)
        left, here, part, norm, step = (values[~met] for values in (left, here, part, norm, step))
    moved = np.linalg.norm((at - s.vector) / scale, axis=-1)
    return State(a, at), np.where(np.isfinite(moved), moved, np.inf)


def _step(a: Assembly, vector: Array, free: Columns) -> tuple[Array, Array]:
    """Norms (n,) of the residuals over their sizes, and Newton's steps (n, columns)."""
    rows, scale = sizes(a)
    f, jacobian = closure(State(a, vector))
    f, jacobian = f / rows, jacobian[..., free] * scale[free] / rows[:, None]
    step = np.zeros_like(vector)
    step[:, free] = solve(jacobian, -f) * scale[free]
    return np.linalg.norm(f, axis=-1), step


def determinant(matrix: Array) -> Array:
    """Determinants (...); NaN of matrices that are."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.linalg.det(matrix))


def solve(matrix: Array, right: Array) -> Array:
    """Solutions (n, m) of n systems; NaN where a matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])
    except np.linalg.LinAlgError:
        if len(matrix) == 1:
            return np.full_like(right, np.nan)
        pairs = zip(matrix, right, strict=True)
        return np.concatenate([solve(m[None], r[None]) for m, r in pairs])
