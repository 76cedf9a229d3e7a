"""What every closed form needs: parameters within their domain, and angles without jumps."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.intp]
TURN = 2.0 * np.pi


class NotCovered(ValueError):
    """A model holds what a reference that reads it does not cover; the message names it."""


class CannotMove(ValueError):
    """The mechanism cannot do what is asked; the subclass says in which way."""


class CannotAssemble(CannotMove):
    """No pose closes the loops, or none was found from this start."""


class SingularHere(CannotMove):
    """The loops' Jacobian loses rank: a limit position, a change point, or a free joint."""


def positive(unit: str = "m", /, **values: float) -> None:
    """ValueError that names the first value that is not positive and finite, with its unit.

    >>> positive(crank=1.0, coupler=-2.0)
    Traceback (most recent call last):
    ValueError: coupler must be a positive finite length [m], got -2.0
    >>> positive("m/s^2", gravity=0.0)
    Traceback (most recent call last):
    ValueError: gravity must be positive and finite [m/s^2], got 0.0
    """
    kind = "a positive finite length" if unit == "m" else "positive and finite"
    for name, value in values.items():
        if not 0.0 < value < np.inf:
            raise ValueError(f"{name} must be {kind} [{unit}], got {value}")


def not_negative(unit: str = "kg", /, **values: float) -> None:
    """ValueError that names the first value that is negative or not finite, with its unit.

    >>> not_negative("N m", friction=-0.1)
    Traceback (most recent call last):
    ValueError: friction must be zero or positive [N m], got -0.1
    """
    for name, value in values.items():
        if not 0.0 <= value < np.inf:
            raise ValueError(f"{name} must be zero or positive [{unit}], got {value}")


def finite(**values: ArrayLike) -> None:
    """ValueError that names the first value that is not finite, or not all of it."""
    for name, value in values.items():
        if not np.all(np.isfinite(np.asarray(value, float))):
            raise ValueError(f"{name} must be finite, got {value!s}")


def one_of(modes: tuple[int, ...], **mode: float) -> None:
    """ValueError for an assembly mode that there is not."""
    for name, value in mode.items():
        if value not in modes:
            raise ValueError(f"{name} must be one of {modes}, got {value}")


def rounding_of_sum(*lengths: float) -> float:
    """Rounding of sums and differences of lengths [m]."""
    return 4.0 * float(np.finfo(float).eps) * sum(map(abs, lengths))


def dot(a: Complex | complex, b: Complex | complex) -> Array:
    """Scalar product of vectors as complex numbers."""
    return np.asarray(a.real * b.real + a.imag * b.imag)


def cross(a: Complex | complex, b: Complex | complex) -> Array:
    """a x b of vectors as complex numbers: positive where b lies left of a."""
    return np.asarray(a.real * b.imag - a.imag * b.real)


def normal_of_slides(slides: Array, parallel: float) -> Array:
    """A unit vector normal to slides (n, 3): of two that differ, else near a world axis, z first.

    >>> normal_of_slides(np.array([[1.0, 0.0, 0.0]]), 1e-9)
    array([0., 0., 1.])
    >>> normal_of_slides(np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.6, 0.8]]), 1e-9)
    array([ 0. , -0.8,  0.6])
    """
    for other in slides[1:]:
        normal = np.cross(slides[0], other)
        if np.linalg.norm(normal) > parallel:
            return np.asarray(normal / np.linalg.norm(normal))
    axis = np.eye(3)[min((2, 1, 0), key=lambda k: round(abs(slides[0][k]), 9))]
    normal = axis - (axis @ slides[0]) * slides[0]
    return np.asarray(normal / np.linalg.norm(normal))


def in_frame(name: str, force: Complex, direction: Complex | complex) -> dict[str, Array]:
    """A force as ``name_x`` along a direction, and ``name_y`` across it, to the left [N]."""
    own = np.asarray(force * np.conj(direction) / np.abs(direction))
    return {f"{name}_x": own.real, f"{name}_y": own.imag}


def unwrapped(angle: Array) -> Array:
    """Angles [rad] made continuous along the last axis by whole turns; the first stays.

    >>> unwrapped(np.array([3.0, -3.0])).round(3)
    array([3.   , 3.283])
    """
    turns = np.rint(np.diff(angle, axis=-1, prepend=angle[..., :1]) / TURN)
    return np.asarray(angle - TURN * np.cumsum(turns, axis=-1))


def unwrapped_quaternion(quaternion: Array) -> Array:
    """Quaternions (n, 4) [1], of which q and -q are the same turn, with signs that do not jump.

    The largest part of the first is positive.

    >>> unwrapped_quaternion(np.array([[-0.8, 0.0, 0.6, 0.0], [0.6, 0.0, -0.8, 0.0]])) + 0.0
    array([[ 0.8,  0. , -0.6,  0. ],
           [ 0.6,  0. , -0.8,  0. ]])
    """
    first = quaternion[0, np.abs(quaternion[0]).round(6).argmax()]
    flips = np.where((quaternion[1:] * quaternion[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    signs = np.cumprod([-1.0 if first < 0 else 1.0, *flips])
    return np.asarray(quaternion * signs[:, None])


STANDS = 1e-9  # of the fastest drive: a joint that is slower stands, to rounding


def senses(rate: Array, fastest: float) -> Array:
    """Senses (..., n) in which joints move at the samples of a motion: -1, +1, or 0 before any.

    A joint that stands at a sample has the sense of the sample before: dry friction is what it was
    when the joint came there.

    Parameters
    ----------
    rate : ndarray (..., n)
        Rates of the joints [rad/s or m/s].
    fastest : float
        Largest rate of a drive [rad/s or m/s].

    Returns
    -------
    ndarray (..., n) [1]

    Examples
    --------
    >>> senses(np.array([0.0, 1.0, 1e-17, -2.0, 0.0]), 2.0).tolist()
    [0.0, 1.0, 1.0, -1.0, -1.0]
    """
    moves = np.abs(rate) > STANDS * fastest
    last = np.maximum.accumulate(np.where(moves, np.arange(rate.shape[-1]), 0), axis=-1)
    return np.asarray(np.take_along_axis(np.where(moves, np.sign(rate), 0.0), last, axis=-1))
