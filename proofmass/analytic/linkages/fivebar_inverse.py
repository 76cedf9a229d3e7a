"""Planar five-bar linkage: crank motions for a given motion of its tip, and its Jacobians."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import (
    Array,
    Complex,
    finite,
    not_negative,
    one_of,
    positive,
    unwrapped,
)

MODES = (1, -1)


def solve(
    tip: ArrayLike, velocity: ArrayLike = 0.0, acceleration: ArrayLike = 0.0, *,
    left_crank: float, left_coupler: float, right_coupler: float, right_crank: float,
    left_x: float, right_x: float, left_mode: int = 1, right_mode: int = 1,
) -> dict[str, Array]:
    r"""Crank motions of a five-bar linkage whose tip motion is given (inverse kinematics).

    ::

              pin                 each side by itself: the base A of the left crank, or B of the
        crank .' `.  coupler      right; p = base-pin, length l; a = pin-tip, length c;
            .'  s  `.             s = tip - base, S = |s|
        base ------- tip          +1: pin to the left of s, as drawn; -1: to the right

    The angle at the base, between s and the crank, is psi, in [0, pi]. With K twice the area of
    triangle base-pin-tip::

        angle = arg(s) + mode psi,  tan(psi) = K/((S^2 + l^2 - c^2)/2)
        K = 1/2 sqrt((l + c + S)(l + c - S)(S + |l - c|)(S - |l - c|))
        rate = a . v/(p x a),  p x a = -mode K
        acceleration = (a . v' + rate^2 a . p + |v - J p rate|^2)/(p x a)

    Parameters
    ----------
    tip, velocity, acceleration : (x, y) of the tip [m], its velocity [m/s] and acceleration
        [m/s^2]; tip (2,) or (2, n), the others broadcast to it
    left_crank, left_coupler, right_coupler, right_crank, left_x, right_x : [m], as in
        `fivebar.solve`
    left_mode, right_mode : working modes, +-1 each as above; a mode is one continuous branch,
        which ends where crank and coupler are in line (K = 0, type 1 singularity)

    Returns
    -------
    dict of (n,) arrays, or of scalars: left, right [rad], each with _rate and _acceleration, and
    assembly, the sine of the angle between the couplers: its sign is the mode of `fivebar.solve`
    that leads back here, its zeros are the type 2 singularities. Angles are arg(s) + mode psi with
    arg(s) unwrapped, in (-2 pi, 2 pi) for the first sample.

    Raises
    ------
    ValueError
        A length not positive, a mode unknown, or a tip out of reach: the message gives the first
        such tip and by how much the circles of which crank and coupler miss.

    Notes
    -----
    Residual below 1e-14 of the lengths. Source: five-bar notebook "método geométrico", text lines
    125-254, whose four signs (sigma1, sigma2) are (right_mode, left_mode). It solves a quadratic
    for tan(angle/2), which divides by zero where a root is half a turn; the angles here do not.

    Examples
    --------
    >>> pose = solve([0.0, 8.0], left_crank=4.0, left_coupler=5.0, right_coupler=5.0,
    ...              right_crank=4.0, left_x=-3.0, right_x=3.0)
    >>> [round(float(np.degrees(pose[side])), 6) for side in ("left", "right")]
    [90.0, 131.11209]
    """
    check(left_crank=left_crank, left_coupler=left_coupler, right_coupler=right_coupler,
          right_crank=right_crank, left_x=left_x, right_x=right_x,
          left_mode=left_mode, right_mode=right_mode)
    motion = inputs(tip, velocity, acceleration)
    left, a = _side("left", motion, left_x, left_crank, left_coupler, left_mode)
    right, b = _side("right", motion, right_x, right_crank, right_coupler, right_mode)
    curves = left | right | {"assembly": cross(a, b) / (left_coupler * right_coupler)}
    return {name: np.reshape(curve, motion[0].shape[1:]) for name, curve in curves.items()}


def _side(
    name: str, motion: list[Array], base: float, crank: float, coupler: float, mode: int
) -> tuple[dict[str, Array], Complex]:
    """Angle, rate and acceleration of one crank, and the vector of its coupler."""
    tip, v, dv = (x + 1j * y for x, y in motion)
    s = tip - base
    area = twice_area(np.abs(s), crank, coupler, float(np.abs(base)), motion[0],
                      "tip out of reach at ({:.9g}, {:.9g}) m", f"{name} crank and coupler")
    square = np.abs(s) ** 2
    side = 0.5 * (square + crank**2 - coupler**2)
    p = (side + 1j * mode * area) * s / square
    a = s - p
    with np.errstate(divide="ignore", invalid="ignore"):  # in line: inf or nan, as documented
        lever = -mode * area
        rate = dot(a, v) / lever
        second = (dot(a, dv) + rate**2 * dot(a, p) + np.abs(v - 1j * rate * p) ** 2) / lever
    angle = unwrapped(np.atleast_1d(np.angle(s))) + mode * np.arctan2(area, side)
    return {name: angle, f"{name}_rate": rate, f"{name}_acceleration": second}, a


def jacobians(
    angle: ArrayLike, tip: ArrayLike, *, left_crank: float, right_crank: float,
    left_x: float, right_x: float,
) -> tuple[Array, Array]:
    """Matrices A and B of the velocity equation A v = B w, (..., 2, 2) each.

    v is the tip's velocity, w the (left, right) crank rates. Rows of A are the couplers' vectors a
    and b, B is diag(p x a, q x b): det B = 0 in type 1, det A = a x b = 0 in type 2 singularities.
    Static forces go the other way: the moments M on the cranks that balance a force F on the tip
    solve A^T n = F, M = -B^T n. `angle` [rad] and `tip` [m] are a pose, (2,) or (2, n); lengths
    [m] as in `solve`. Source: derived; the notebook named there stops at positions.

    >>> A, B = jacobians([np.pi / 2, np.pi / 2], [0.0, 8.0], left_crank=4.0, right_crank=4.0,
    ...                  left_x=-3.0, right_x=3.0)
    >>> np.linalg.solve(A, B).round(12).tolist()
    [[-2.0, -2.0], [-1.5, 1.5]]
    """
    check(left_crank=left_crank, right_crank=right_crank, left_x=left_x, right_x=right_x)
    theta, place = inputs(angle, tip)
    p, q = left_crank * np.exp(1j * theta[0]), right_crank * np.exp(1j * theta[1])
    end = place[0] + 1j * place[1]
    a, b, zero = end - left_x - p, end - right_x - q, np.zeros(end.shape)
    A = np.array([[a.real, a.imag], [b.real, b.imag]])
    B = np.array([[cross(p, a), zero], [zero, cross(q, b)]])
    return np.moveaxis(A, (0, 1), (-2, -1)), np.moveaxis(B, (0, 1), (-2, -1))


def twice_area(
    distance: Array, one: float, two: float, size: float, pose: Array,
    open_at: str, whose: str,
) -> Array:
    """Twice the area of triangles with these three sides, or ValueError at the first open one.

    `size` bounds what `distance` was computed from; `pose` (2, ...) goes into the format `open_at`.
    """
    far, near = one + two, abs(one - two)
    gap = np.maximum(distance - far, near - distance)
    slack = 4.0 * np.finfo(float).eps * (far + size)  # rounding of gap at an exact limit pose
    good = (gap <= slack) & (distance > slack)
    if not good.all():
        bad = np.unravel_index(np.argmin(good), good.shape)
        miss = f"miss by {gap[bad]:.6g} m"
        raise ValueError(f"{open_at.format(*(row[bad] for row in pose))}: the circles of {whose} "
                         + ("coincide, so they leave it open" if gap[bad] <= slack else miss))
    heron = (far + distance) * (far - distance) * (distance + near) * (distance - near)
    return np.asarray(0.5 * np.sqrt(np.maximum(heron, 0.0)))


def check(**values: float) -> None:
    """ValueError that names the parameter at fault, if one is; the name's end says what it is."""
    for name, value in values.items():
        if name.endswith("mode"):
            one_of(MODES, **{name: value})
        elif name.endswith("_x"):
            finite(**{name: value})
        elif name.endswith("_mass"):
            not_negative(**{name: value})
        else:
            positive(**{name: value})


def inputs(*values: ArrayLike) -> list[Array]:
    """Arrays of the first one's shape (2, ...); a (2,) among the others holds for all samples."""
    first, *others = (np.asarray(value, float) for value in values)
    if first.shape[:1] != (2,):
        raise ValueError(f"inputs must have two rows on the first axis, got shape {first.shape}")
    padded = (x.reshape(x.shape + (1,) * (first.ndim - x.ndim)) if x.ndim else x for x in others)
    return [first, *(np.broadcast_to(x, first.shape) for x in padded)]


def dot(a: Complex, b: Complex) -> Array:
    """Scalar product of plane vectors written as complex numbers."""
    return np.asarray(a.real * b.real + a.imag * b.imag)


def cross(a: Complex, b: Complex) -> Array:
    """Cross product of plane vectors written as complex numbers: > 0 if b is left of a."""
    return np.asarray(a.real * b.imag - a.imag * b.real)
