"""Linkages in natural coordinates by Newton-Raphson, as B. Díaz Lozano teaches it.

The coordinates q are those of the moving points, followed by the driven angles. Every constraint
is a row of Phi(q) = 0. A driven angle adds the rows that give a link this angle, and a unit row
that keeps Newton-Raphson from changing the angle. For each pose, positions are found by
Newton-Raphson (stop at |dq| <= 1e-10, at most 101 iterations), then rates and accelerations by one
linear system each.

Users make their own linkage as a `NaturalLinkage` of such rows: `distance` for a rigid bar,
`collinear` and `constant_angle` for a slider, `ground_angle` for an angle of a link to the ground,
`relative_angle` for an angle between two links.

Source: TFG, Universidad de Almería 2019, text lines 824-1120 (theory: 865-877 for the count of
degrees of freedom, figures 39-43 for the rows),
1122-3758 (four linkages); code lines 1417-1469, 1989-2056.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.newton_raphson import NewtonLog, newton_raphson, solve_linear
from proofmass.base.arrays import Array

ConstraintRow = Callable[[Array, Array], tuple[float, Array, float]]
"""Function of q and rates: value of a constraint, gradient by q, (d gradient/dt) times rates."""
AffinePoint = tuple[Array, Array]
"""Matrix (2, size) and vector (2,) [m] of a point: its position is matrix q + vector."""
DIAGONAL_COSINE = 0.5**0.5
SINGULAR_MARGIN = 1e-6
"""Singular values [SI] up to this count as zero: poses have errors of 1e-10, which the gradients of
links of about a metre have as well; the smallest value of the examples' poses is 0.6."""


@dataclass(frozen=True)
class NaturalLinkage:
    """Constraints on natural coordinates q, of which the last ones are driven angles.

    Attributes
    ----------
    rows : tuple of function
        The constraints.
    names : tuple of str
        Names of the coordinates: X1, Y1, ... of the moving points [m], then the driven angles
        [rad].
    inputs : int
        Number of driven angles.

    Examples
    --------
    A four-bar from the first guess of the document, which takes 14 iterations.

    >>> log = assemble(fourbar(1.0, 2.0, 2.5, 3.0), (0.1, 1.0, 1.0, 0.2, 0.0))
    >>> log.iterations, (log.root.round(6) + 0.0).tolist()
    (14, [1.0, 0.0, 1.4375, -1.951562, 0.0])
    """

    rows: tuple[ConstraintRow, ...]
    names: tuple[str, ...]
    inputs: int = 1

    def evaluate(self, q: Array, rates: Array) -> tuple[Array, Array, Array]:
        """Residual, Jacobian and bias (dJ/dt) rates; the unit rows of driven angles are the last.

        Parameters
        ----------
        q, rates : ndarray (size,)
            Coordinates and their rates [SI].

        Returns
        -------
        residual : ndarray (equations,)
            [SI]
        jacobian : ndarray (equations, size)
            [SI]
        bias : ndarray (equations,)
            [SI]
        """
        values, gradients, bias = zip(*(row(q, rates) for row in self.rows), strict=True)
        driven, none = np.eye(q.size)[-self.inputs :], np.zeros(self.inputs)
        return np.r_[values, none], np.vstack([*gradients, driven]), np.r_[bias, none]


def assemble(linkage: NaturalLinkage, start: ArrayLike, *, max_iterations: int = 101) -> NewtonLog:
    """Position problem: find q that fulfils all constraints, for the driven angles of `start`.

    Parameters
    ----------
    linkage : NaturalLinkage
        The constraints.
    start : array_like (size,)
        First guess, with the driven angles at the end [m, rad]; it determines the assembly mode.
    max_iterations : int
        Number of iterations allowed.

    Returns
    -------
    NewtonLog
        Its `root` is q.

    Raises
    ------
    ValueError
        The start has another length; there is no root (`NotConverged`), or the Jacobian has no
        inverse (`SingularJacobian`). The last two errors have the log of the iterations made.
    """
    first, n = np.asarray(start, float), linkage.inputs
    if first.shape != (len(linkage.names),):
        raise ValueError(
            f"start must be {', '.join(linkage.names)}, got an array of shape {first.shape}"
        )

    def system(q: Array) -> tuple[Array, Array]:
        residual, jacobian, _ = linkage.evaluate(q, np.zeros(q.size))
        residual[-n:] = q[-n:] - first[-n:]  # zero in all iterations, except with least squares
        return residual, jacobian

    return newton_raphson(system, first, max_iterations=max_iterations, names=linkage.names)


def velocities(linkage: NaturalLinkage, q: Array, inputs: Sequence[float]) -> Array:
    """Rates of q (size,) [m/s, rad/s] for given rates of the driven angles [rad/s].

    >>> four = fourbar(1.0, 2.0, 2.5, 3.0)
    >>> rates = velocities(four, assemble(four, (0.1, 1.0, 1.0, 0.2, 0.0)).root, [1.0])
    >>> (rates.round(6) + 0.0).tolist()
    [0.0, 1.0, -0.975781, 0.78125, 1.0]
    """
    jacobian = linkage.evaluate(q, np.zeros(q.size))[1]
    return solve_linear(jacobian, np.r_[np.zeros(len(linkage.rows)), inputs])


def accelerations(
    linkage: NaturalLinkage, q: Array, rates: Array, inputs: Sequence[float]
) -> Array:
    """Accelerations of q (size,) [m/s^2, rad/s^2] for those of the driven angles [rad/s^2].

    The document solves -J a = b with the driven accelerations in b, so that its results for +1
    rad/s^2 are those of -1 rad/s^2 (text line 2039).
    """
    _, jacobian, bias = linkage.evaluate(q, rates)
    return solve_linear(jacobian, np.r_[-bias[: len(linkage.rows)], inputs])


def sweep(
    linkage: NaturalLinkage,
    start: ArrayLike,
    angles: ArrayLike,
    rates: Sequence[float],
    input_accelerations: Sequence[float],
) -> Array:
    """q, rates and accelerations at many driven angles; the first guess of a pose is the last pose.

    Parameters
    ----------
    linkage : NaturalLinkage
        The constraints.
    start : array_like (size,)
        First guess of the first pose [m, rad].
    angles : array_like (n,) or (n, inputs)
        Values of the driven angles [rad].
    rates, input_accelerations : sequence of float
        Their rates [rad/s] and accelerations [rad/s^2], the same at all poses.

    Returns
    -------
    ndarray (3, n, size)
        [m, rad], [m/s, rad/s], [m/s^2, rad/s^2]

    Raises
    ------
    ValueError
        As in `assemble`, at the first pose for which the iteration finds no root.
    """
    q, poses = np.array(start, float), []
    for driven in np.reshape(angles, (-1, linkage.inputs)):
        q = assemble(linkage, np.r_[q[: -linkage.inputs], driven]).root
        v = velocities(linkage, q, rates)
        poses.append((q, v, accelerations(linkage, q, v, input_accelerations)))
    return np.swapaxes(np.reshape(poses, (-1, 3, q.size)), 0, 1)


def degrees_by_count(links: int, joints: int, two_dof_joints: int = 0) -> int:
    """Degrees of freedom of a planar mechanism by Grübler's and Chebyshev's count.

    ::

        3 (links - 1) - 2 joints - two_dof_joints

    Parameters
    ----------
    links : int
        Number of links, with the ground [1].
    joints : int
        Number of joints with one degree of freedom: pins and sliding pairs [1].
    two_dof_joints : int
        Number of joints with two degrees of freedom, such as a pin in a slot [1].

    Returns
    -------
    int
        It is too small where constraints are redundant; see `degrees_by_rank`.

    Examples
    --------
    >>> degrees_by_count(4, 4), degrees_by_count(5, 5)
    (1, 2)
    """
    return 3 * (links - 1) - 2 * joints - two_dof_joints


def degrees_by_rank(rows: Sequence[ConstraintRow], q: Array) -> int:
    """Degrees of freedom in a pose: coordinates less the rank of the Jacobian of the constraints.

    Parameters
    ----------
    rows : sequence of rows
        The constraints.
    q : ndarray (size,)
        Coordinates of a pose that fulfils them [SI].

    Returns
    -------
    int
        In a singular pose it is larger than in the poses beside it.

    Examples
    --------
    >>> four = fourbar(1.0, 2.0, 2.5, 3.0)
    >>> degrees_by_rank(four.rows, assemble(four, (0.1, 1.0, 1.0, 0.2, 0.0)).root)
    1
    """
    jacobian = np.array([row(q, np.zeros(q.size))[1] for row in rows])
    return int(q.size - np.linalg.matrix_rank(jacobian, tol=SINGULAR_MARGIN))


def moving(k: int, size: int) -> AffinePoint:
    """Moving point number k, counted from 0, of a linkage with `size` coordinates."""
    return np.eye(size)[2 * k : 2 * k + 2], np.zeros(2)


def fixed(x: float, y: float, size: int) -> AffinePoint:
    """Point of the ground at x and y [m], for a linkage with `size` coordinates."""
    return np.zeros((2, size)), np.array([x, y])


def distance(start: AffinePoint, end: AffinePoint, length: float) -> ConstraintRow:
    """Row of a rigid bar with a length [m]: |end - start|^2 = length^2 (figure 39)."""
    bar = vector_between(start, end)
    return product_row(bar, bar, SCALAR_PRODUCT, length**2)


def product_row(u: AffinePoint, w: AffinePoint, matrix: Array, value: float) -> ConstraintRow:
    """Row u' S w = value [m^2]; the matrix S is `SCALAR_PRODUCT` or `VECTOR_PRODUCT`."""
    (a, s), (b, t) = u, w

    def row(q: Array, rates: Array) -> tuple[float, Array, float]:
        first, second, speeds = a @ q + s, b @ q + t, (a @ rates, b @ rates)
        gradient = matrix @ second @ a + first @ matrix @ b
        bias = 2.0 * speeds[0] @ matrix @ speeds[1]
        return float(first @ matrix @ second) - value, gradient, float(bias)

    return row


SCALAR_PRODUCT, VECTOR_PRODUCT = np.eye(2), np.array([[0.0, 1.0], [-1.0, 0.0]])
"""Matrices S of `product_row`: for the scalar product and for the vector product."""


def vector_between(start: AffinePoint, end: AffinePoint) -> AffinePoint:
    """Vector from one point to another."""
    return end[0] - start[0], end[1] - start[1]


def collinear(start: AffinePoint, middle: AffinePoint, end: AffinePoint) -> ConstraintRow:
    """Row of a slider on a bar: (middle - start) x (end - start) = 0 (figure 41)."""
    return product_row(
        vector_between(start, middle), vector_between(start, end), VECTOR_PRODUCT, 0.0
    )


def constant_angle(
    start: AffinePoint, end: AffinePoint, base: AffinePoint, tip: AffinePoint, value: float
) -> ConstraintRow:
    """Row of a slider that does not turn on its bar (figure 41).

    ::

        (end - start) . (tip - base) = value

    The angle between both segments is constant if their lengths are: value [m^2] is the product of
    the lengths and the cosine of the angle. It does not determine the sign of the angle; where both
    signs can be assembled the first guess decides.
    """
    return product_row(vector_between(start, end), vector_between(base, tip), SCALAR_PRODUCT, value)


def relative_angle(
    corner: AffinePoint,
    reference: AffinePoint,
    turned_to: AffinePoint,
    lengths: tuple[float, float],
    angle: int,
) -> tuple[ConstraintRow, ConstraintRow]:
    """Rows of the angle between two links at their pin, which is coordinate `angle` (figure 42).

    ::

        12 . 13 = L12 L13 cos(phi),  12 x 13 = L12 L13 sin(phi)

    There are both rows, as the document advises: one row alone is also fulfilled by a mirror image,
    and its derivative by the angle is zero where cos(phi) or sin(phi) is extreme. With both rows
    there are more equations than unknowns, and Newton-Raphson becomes Gauss-Newton.

    Parameters
    ----------
    corner, reference, turned_to : point
        Points 1, 2 and 3.
    lengths : tuple of float
        L12 and L13 [m].
    angle : int
        Index of the coordinate phi.

    Returns
    -------
    tuple of two rows
    """
    u, w = vector_between(corner, reference), vector_between(corner, turned_to)
    scale = lengths[0] * lengths[1]
    along, across = (product_row(u, w, each, 0.0) for each in (SCALAR_PRODUCT, VECTOR_PRODUCT))
    return component_row(along, scale, 0, angle), component_row(across, scale, 1, angle)


def component_row(row: ConstraintRow, scale: float, axis: int, angle: int) -> ConstraintRow:
    """Row less `scale` times the cosine (axis 0) or sine (axis 1) of coordinate number `angle`."""

    def component(q: Array, rates: Array) -> tuple[float, Array, float]:
        value, gradient, bias = row(q, rates)
        c, s = scale * np.cos(q[angle]), scale * np.sin(q[angle])
        gradient[angle] += (s, -c)[axis]
        reach = (c, s)[axis]
        return value - reach, gradient, bias + reach * rates[angle] ** 2

    return component


def ground_angle(
    base: AffinePoint, pin: AffinePoint, length: float, angle: int, threshold: float | None = None
) -> tuple[ConstraintRow, ...]:
    """Rows of a link's angle to the ground, which is coordinate number `angle` (figure 43).

    ::

        pin - base = length (cos(angle), sin(angle))

    Parameters
    ----------
    base, pin : point
        Ends of the link.
    length : float
        Length of the link [m].
    angle : int
        Index of the coordinate.
    threshold : float or None
        None: both rows, which have no mirror image as solution, and Newton-Raphson becomes
        Gauss-Newton. A number [1]: one row as in the document's programs, that of the cosine where
        |cos| < threshold, otherwise that of the sine (text line 2395); the linkage may then be
        assembled with the mirror image of the link.

    Returns
    -------
    tuple of rows
    """
    matrix, shift = vector_between(base, pin)

    def coordinate_row(axis: int) -> ConstraintRow:
        return lambda q, _: (matrix[axis] @ q + shift[axis], matrix[axis].copy(), 0.0)

    along, across = (component_row(coordinate_row(k), length, k, angle) for k in (0, 1))
    if threshold is None:
        return along, across
    return (lambda q, v: (across if abs(np.cos(q[angle])) >= threshold else along)(q, v),)


def fourbar(
    crank: float,
    coupler: float,
    rocker: float,
    ground: float,
    threshold: float | None = DIAGONAL_COSINE,
) -> NaturalLinkage:
    """Four-bar with q = (X1, Y1, X2, Y2, theta): crank pin, and pin of coupler and rocker.

    Parameters
    ----------
    crank, coupler, rocker, ground : float
        Lengths between pins [m].
    threshold : float or None
        Threshold of `ground_angle` [1].
    """
    a, b, one, two = fixed(0, 0, 5), fixed(ground, 0, 5), moving(0, 5), moving(1, 5)
    return NaturalLinkage(
        (
            distance(a, one, crank),
            distance(one, two, coupler),
            distance(two, b, rocker),
            *ground_angle(a, one, crank, 4, threshold),
        ),
        ("X1", "Y1", "X2", "Y2", "theta"),
    )


def fivebar(
    left: float,
    left_coupler: float,
    right_coupler: float,
    right: float,
    ground: float,
    threshold: float | None = 0.5,
) -> NaturalLinkage:
    """Five-bar with q = (X1, Y1, X2, Y2, X3, Y3, theta, beta): left, middle and right pin.

    Parameters
    ----------
    left, left_coupler, right_coupler, right, ground : float
        Lengths between pins [m].
    threshold : float or None
        Threshold of `ground_angle` [1].
    """
    a, b, (one, two, three) = fixed(0, 0, 8), fixed(ground, 0, 8), (moving(k, 8) for k in range(3))
    return NaturalLinkage(
        (
            distance(a, one, left),
            distance(one, two, left_coupler),
            distance(two, three, right_coupler),
            distance(three, b, right),
            *ground_angle(a, one, left, 6, threshold),
            *ground_angle(b, three, right, 7, threshold),
        ),
        ("X1", "Y1", "X2", "Y2", "X3", "Y3", "theta", "beta"),
        2,
    )


def slider_crank(
    crank: float,
    coupler: float,
    guide: Sequence[tuple[float, float]],
    threshold: float | None = DIAGONAL_COSINE,
) -> NaturalLinkage:
    """Slider-crank with q = (X1, Y1, X2, Y2, theta): crank pin, and slider on a fixed line.

    Parameters
    ----------
    crank, coupler : float
        Lengths between pins [m].
    guide : sequence of two pairs
        Two points of the guide's line [m].
    threshold : float or None
        Threshold of `ground_angle` [1].
    """
    a, one, two = fixed(0, 0, 5), moving(0, 5), moving(1, 5)
    b, c = (fixed(*point, 5) for point in guide)
    return NaturalLinkage(
        (
            distance(a, one, crank),
            distance(one, two, coupler),
            collinear(b, two, c),
            *ground_angle(a, one, crank, 4, threshold),
        ),
        ("X1", "Y1", "X2", "Y2", "theta"),
    )


def inverted_slider_crank(
    crank: float, rod: float, bar: float, ground: float, threshold: float | None = 0.95
) -> NaturalLinkage:
    """Inverted slider-crank: q = (X1, Y1, X2, Y2, X3, Y3, theta, beta).

    The points are the crank pin, the end of the rod, and the slider on the rod.

    Parameters
    ----------
    crank, rod, bar, ground : float
        Lengths between pins; for the rod its whole length [m].
    threshold : float or None
        Threshold of `ground_angle` [1].
    """
    a, b, (one, two, three) = fixed(0, 0, 8), fixed(ground, 0, 8), (moving(k, 8) for k in range(3))
    return NaturalLinkage(
        (
            distance(a, one, crank),
            distance(one, two, rod),
            distance(b, three, bar),
            collinear(one, three, two),
            *ground_angle(a, one, crank, 6, threshold),
            *ground_angle(b, three, bar, 7, threshold),
        ),
        ("X1", "Y1", "X2", "Y2", "X3", "Y3", "theta", "beta"),
        2,
    )


EXAMPLES: dict[str, tuple[NaturalLinkage, tuple[float, ...]]] = {
    "four-bar": (fourbar(1.0, 2.0, 2.5, 3.0), (0.1, 1.0, 1.0, 0.2, 0.0)),
    "five-bar": (fivebar(2.0, 3.5, 4.0, 1.0, 2.0), (0.1, 2.0, 1.0, 0.2, 2.02, 0.1, 0.3, 0.9)),
    "slider-crank": (slider_crank(1.0, 2.0, ((2.0, 0.0), (3.0, 0.0))), (0.1, 0.2, 1.0, 0.2, 0.5)),
    "inverted slider-crank": (
        inverted_slider_crank(2.0, 3.0, 1.0, 2.0),
        (0.1, 0.2, 1.0, 0.2, 2.0 + np.cos(0.8), np.sin(0.8), 0.5, 0.8),
    ),
}
"""The document's linkages and their first guesses (text lines 1262, 5898, 7762, 9091)."""
