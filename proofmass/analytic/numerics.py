"""Helpers of all closed forms: checks of parameters, vectors in the plane, angles without jumps."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.base.arrays import Array, Complex

TURN = 2.0 * np.pi


class NotCovered(ValueError):
    """The model has something that its reference does not cover; the message names it."""


class CannotMove(ValueError):
    """The mechanism cannot take the requested pose or motion; subclasses give the reason."""


class CannotAssemble(CannotMove):
    """No pose closes the loops, or none was found from the given start."""


class SingularHere(CannotMove):
    """The loops' Jacobian loses rank: a limit position, a change point, or a free joint."""


LARGEST = 1e40
"""Largest size of a number [SI] that closed forms take, and inverse of the smallest positive one.

Products of six lengths, as of the squared sides of a triangle, then have a floating-point number.
"""


def check_positive(unit: str = "m", /, **values: float) -> None:
    """Raise a ValueError that names the first value that is not positive and finite, and its unit.

    A positive number further from 1 than `LARGEST` or its inverse is refused as well.

    >>> check_positive(crank=1.0, coupler=-2.0)
    Traceback (most recent call last):
    ValueError: coupler must be a positive finite length [m], got -2.0
    >>> check_positive("m/s^2", gravity=0.0)
    Traceback (most recent call last):
    ValueError: gravity must be positive and finite [m/s^2], got 0.0
    """
    kind = "a positive finite length" if unit == "m" else "positive and finite"
    for name, value in values.items():
        if np.ndim(value) or not 0.0 < value < np.inf:
            raise ValueError(f"{name} must be {kind} [{unit}], got {value}")
        if not 1.0 / LARGEST <= value <= LARGEST:
            raise ValueError(
                f"{name} must be from {1.0 / LARGEST:g} to {LARGEST:g} [{unit}], got {value}"
            )


def check_not_negative(unit: str = "kg", /, **values: float) -> None:
    """Raise a ValueError that names the first value that is negative or not finite, and its unit.

    >>> check_not_negative("N m", friction=-0.1)
    Traceback (most recent call last):
    ValueError: friction must be zero or positive [N m], got -0.1
    """
    for name, value in values.items():
        if np.ndim(value) or not 0.0 <= value < np.inf:
            raise ValueError(f"{name} must be zero or positive [{unit}], got {value}")
        check_finite(**{name: value})


def check_number(**values: float) -> None:
    """Raise a ValueError that names the first value that is not one finite number.

    >>> check_number(guide_x=0.0, guide_y=[1.0, 2.0])
    Traceback (most recent call last):
    ValueError: guide_y must be one number, got [1.0, 2.0]
    """
    for name, value in values.items():
        if np.ndim(value):
            raise ValueError(f"{name} must be one number, got {value}")
        check_finite(**{name: value})


def check_count(**values: float) -> None:
    """Raise a ValueError that names the first value that is no whole number from 1 on.

    >>> check_count(balls=2.5)
    Traceback (most recent call last):
    ValueError: balls must be a whole number from 1 on, got 2.5
    """
    for name, value in values.items():
        if np.ndim(value) or not (value >= 1 and value % 1 == 0):
            raise ValueError(f"{name} must be a whole number from 1 on, got {value}")


def check_finite(**values: ArrayLike) -> None:
    """Raise a ValueError that names the first value with an entry that is not finite.

    An entry larger than `LARGEST` is refused as well.

    >>> check_finite(rate=[1.0, float("nan")])
    Traceback (most recent call last):
    ValueError: rate must be finite, got nan
    """
    for name, value in values.items():
        size = np.abs(np.asarray(value, float))
        if not size.max(initial=0.0) <= LARGEST:
            first = np.asarray(value, float)[~(size <= LARGEST)][0]
            limit = f" and at most {LARGEST:g} in size" if np.isfinite(first) else ""
            raise ValueError(f"{name} must be finite{limit}, got {first}")


def check_one_of(modes: tuple[int, ...], **mode: float) -> None:
    """Raise a ValueError for an assembly mode that is not one of `modes`."""
    for name, value in mode.items():
        if np.ndim(value) or value not in modes:
            raise ValueError(f"{name} must be one of {modes}, got {value}")


def broadcast_motion(rows: int = 0, /, **motion: ArrayLike) -> list[Array]:
    """Arrays of one shape from a motion and its time derivatives, or a ValueError that names one.

    Parameters
    ----------
    rows : int
        Number of inputs of the mechanism, which is the length of the first axis; 0 for a single
        input without such an axis.
    **motion
        Finite values and time derivatives [SI]. With rows, axes are aligned from the left, so that
        a derivative of shape (rows,) holds for all samples; without rows, as in NumPy.

    Raises
    ------
    ValueError
        An entry that is not finite, a first value of another number of rows, or shapes that do not
        fit together.

    Examples
    --------
    >>> [one.shape for one in broadcast_motion(2, angle=np.zeros((2, 5)), rate=[1.0, 2.0])]
    [(2, 5), (2, 5)]
    >>> broadcast_motion(2, angle=[0.0, 1.0, 2.0])
    Traceback (most recent call last):
    ValueError: angle must have 2 rows on its first axis, got an array of shape (3,)
    """
    check_finite(**motion)
    arrays = {name: np.asarray(value, float) for name, value in motion.items()}
    if rows:
        name, first = next(iter(arrays.items()))
        if first.shape[:1] != (rows,):
            raise ValueError(
                f"{name} must have {rows} rows on its first axis, got an array of shape "
                f"{first.shape}"
            )
        axes = max(one.ndim for one in arrays.values())
        arrays = {
            name: one.reshape(one.shape + (1,) * (axes - one.ndim)) for name, one in arrays.items()
        }
    try:
        return list(np.broadcast_arrays(*arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {np.shape(one)}" for name, one in motion.items())
        raise ValueError(f"shapes must fit together, got {shapes}") from None


def broadcast_loads(shape: tuple[int, ...], /, **loads: ArrayLike) -> list[Array]:
    """Arrays of a given shape from finite loads [SI], or a ValueError that names one.

    >>> broadcast_loads((2,), load_x=3.0)
    [array([3., 3.])]
    >>> broadcast_loads((2,), load_x=[1.0, 2.0, 3.0])
    Traceback (most recent call last):
    ValueError: load_x must be a number or have the shape (2,) of the motion, got (3,)
    """
    check_finite(**loads)
    found = []
    for name, load in loads.items():
        try:
            found.append(np.broadcast_to(np.asarray(load, float), shape))
        except ValueError:
            raise ValueError(
                f"{name} must be a number or have the shape {shape} of the motion, got "
                f"{np.shape(load)}"
            ) from None
    return found


def rounding_of_sum(*lengths: float) -> float:
    """Bound of the rounding errors of sums and differences of lengths [m]."""
    return 4.0 * float(np.finfo(float).eps) * sum(map(abs, lengths))


def dot(a: Complex | complex, b: Complex | complex) -> Array:
    """Scalar product of vectors as complex numbers."""
    return np.asarray(a.real * b.real + a.imag * b.imag)


def cross(a: Complex | complex, b: Complex | complex) -> Array:
    """a x b of vectors as complex numbers: positive where b lies left of a."""
    return np.asarray(a.real * b.imag - a.imag * b.real)


def smooth_root(margin: float, wave: Array) -> Array:
    """Root of margin + wave^2; for a margin of zero the wave itself, which has either sign.

    A sum that rounding makes negative counts as zero.
    """
    return wave if margin == 0.0 else np.sqrt(np.maximum(margin + wave * wave, 0.0))


def root_derivatives(margin: float, wave: Array, root: Array) -> tuple[Array, Array]:
    """First two derivatives of `smooth_root` by the wave: wave/root and margin/root^3."""
    if margin == 0.0:
        return np.ones_like(wave), np.zeros_like(wave)
    return wave / root, margin / (root * root * root)


def normal_of_slides(slides: Array, parallel: float) -> Array:
    """Unit vector normal to the directions of slides (n, 3), which are unit vectors.

    It is normal to the first slide and to the first one whose sine of the angle to it exceeds
    `parallel`.  If all slides are parallel, it is the part normal to them of the world axis that is
    nearest to being normal to them; of axes that are equally near, z precedes y, and y precedes x.

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


def components_in_frame(
    name: str, force: Complex, direction: Complex | complex
) -> dict[str, Array]:
    """Components of a force [N]: ``name_x`` along a direction, ``name_y`` to the left of it."""
    length = np.abs(direction)
    return {
        f"{name}_x": dot(direction, force) / length,
        f"{name}_y": cross(direction, force) / length,
    }


IDENTITY_QUATERNION = np.array([1.0, 0.0, 0.0, 0.0])
"""Quaternion (w, x, y, z) of no rotation."""


def rotation_matrix(quaternion: Array) -> Array:
    """Rotation matrix (3, 3) [1] of a unit quaternion (w, x, y, z)."""
    w, (x, y, z) = quaternion[0], quaternion[1:]
    product = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + 2 * w * product + 2 * product @ product)


def unwrap_angles(angle: Array) -> Array:
    """Angles [rad] made continuous along the last axis by whole turns; the first angle is kept.

    >>> unwrap_angles(np.array([3.0, -3.0])).round(3)
    array([3.   , 3.283])
    """
    turns = np.rint(np.diff(angle, axis=-1, prepend=angle[..., :1]) / TURN)
    return np.asarray(angle - TURN * np.cumsum(turns, axis=-1) if turns.any() else angle)


def unwrap_quaternions(quaternion: Array) -> Array:
    """Quaternions (n, 4) [1] of the same rotations, with signs chosen so that there are no jumps.

    q and -q describe the same rotation.  The largest component of the first quaternion is positive.

    >>> unwrap_quaternions(np.array([[-0.8, 0.0, 0.6, 0.0], [0.6, 0.0, -0.8, 0.0]])) + 0.0
    array([[ 0.8,  0. , -0.6,  0. ],
           [ 0.6,  0. , -0.8,  0. ]])
    """
    first = quaternion[0, np.abs(quaternion[0]).round(6).argmax()]
    flips = np.where((quaternion[1:] * quaternion[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    signs = np.cumprod([-1.0 if first < 0 else 1.0, *flips])
    return np.asarray(quaternion * signs[:, None])


ROW_ROUNDING = 1e-12
"""Size of a row of the equalities' Jacobian, in units of violations and rates, up to which the row
is rounding."""


def without_rounding(jacobian: Array, units: Array) -> Array:
    """Jacobian (..., rows, rates) of equalities, in which rows that are rounding are zero.

    Rows of a loop that no joint can open, such as a second hinge on the axis of the first, are
    differences of equal numbers.  `units` (rows, rates) are those of the rates over those of the
    violations.

    >>> without_rounding(np.array([[1e-17, 0.0], [0.5, 1e-17]]), np.ones((2, 2))).tolist()
    [[0.0, 0.0], [0.5, 1e-17]]
    """
    largest = np.abs(jacobian * units).max(axis=-1, initial=0.0)
    return np.asarray(jacobian * (largest > ROW_ROUNDING)[..., None])


REST_RATE_SHARE = 1e-9  # share of the fastest drive: a slower joint is at rest, but for rounding


def motion_senses(rate: Array, fastest: float) -> Array:
    """Senses (..., n) in which joints move at samples of a motion: -1, +1, or 0 before they move.

    A joint that is at rest at a sample has the sense of the sample before: its dry friction stays
    as it was when the joint came to rest.

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
    >>> motion_senses(np.array([0.0, 1.0, -1e-17, -2.0, 0.0]), 2.0).tolist()
    [0.0, 1.0, 1.0, -1.0, -1.0]
    """
    is_moving = np.abs(rate) > REST_RATE_SHARE * fastest
    last_moving = np.maximum.accumulate(np.where(is_moving, np.arange(rate.shape[-1]), 0), axis=-1)
    return np.asarray(
        np.take_along_axis(np.where(is_moving, np.sign(rate), 0.0), last_moving, axis=-1)
    )


def interpolate_cubic(
    share: Array, begin: Array, end: Array, slope: Array, end_slope: Array
) -> Array:
    """Cubic Hermite interpolation between values; slopes are derivatives by `share`."""
    s, rest = share, 1.0 - share
    return np.asarray(
        rest**2 * (1 + 2 * s) * begin
        + s**2 * (1 + 2 * rest) * end
        + s * rest * (rest * slope - s * end_slope)
    )
