"""Four linkages in natural coordinates by Newton-Raphson, as B. Díaz Lozano solves them.

    python -m benchmarks.document_scheme [--quick]

The coordinates q are those of the moving points, then the driven angles. Every constraint is a
row; a driven angle adds one *switched* row, cosine or sine, and a unit row that keeps Newton from
changing it. Positions by Newton-Raphson (stop at |dq| <= 1e-10, at most 101 iterations), then one
linear solve each for rates and accelerations, a pose at a time. Source: TFG, Universidad de Almería
2019, text lines 824-1120 (theory), 1122-3758 (four linkages); code lines 1417-1469, 1989-2056.

Printed, with poses per second: the iterations of the four examples from their printed guesses.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks import command
from tests.independent.newton_raphson import Solution, newton_raphson

Array = NDArray[np.float64]
Row = Callable[[Array, Array], tuple[float, Array, float]]  # q, rates: value, gradient, bias
Point = tuple[Array, Array]  # q -> selector q + fixed place


@dataclass(frozen=True)
class Linkage:
    """Constraint rows on q; the last `inputs` of its coordinates are driven angles."""

    rows: tuple[Row, ...]
    inputs: int

    def evaluate(self, q: Array, rates: Array) -> tuple[Array, Array, Array]:
        """Residual, Jacobian and bias (dJ/dt) rates; the driven rows last, with zeros."""
        values, gradients, bias = zip(*(row(q, rates) for row in self.rows), strict=True)
        driven, none = np.eye(q.size)[-self.inputs :], np.zeros(self.inputs)
        return np.r_[values, none], np.vstack([*gradients, driven]), np.r_[bias, none]


def position(linkage: Linkage, start: ArrayLike) -> Solution:
    """Newton-Raphson from `start`, whose driven angles are kept."""
    first, n = np.asarray(start, float), linkage.inputs

    def system(q: Array) -> tuple[Array, Array]:
        residual, jacobian, _ = linkage.evaluate(q, np.zeros(q.size))
        residual[-n:] = q[-n:] - first[-n:]  # zero all along, but for least squares
        return residual, jacobian

    return newton_raphson(system, first)


def velocity(linkage: Linkage, q: Array, inputs: Sequence[float]) -> Array:
    """Rates of q for the rates of the driven angles [rad/s]."""
    jacobian = linkage.evaluate(q, np.zeros(q.size))[1]
    right = np.r_[np.zeros(q.size - linkage.inputs), inputs]
    return np.asarray(np.linalg.solve(jacobian, right))


def acceleration(
    linkage: Linkage,
    q: Array,
    rates: Array,
    inputs: Sequence[float],
    mistake: Callable[[Array], dict[int, float]] | None = None,
) -> Array:
    """Accelerations of q for those of the driven angles [rad/s^2].

    The document solves -J a = b with the driven accelerations in b, so +1 gives -1 (text line
    2039): pass -1 to get what it prints for +1. `mistake` gives rows of the bias as it has them.
    """
    _, jacobian, bias = linkage.evaluate(q, rates)
    for row, wrong in (mistake(rates) if mistake else {}).items():
        bias[row] = wrong
    bias[-linkage.inputs :] = np.negative(inputs)
    return np.asarray(np.linalg.solve(-jacobian, bias))


def sweep(
    linkage: Linkage,
    start: ArrayLike,
    angles: ArrayLike,
    rates: Sequence[float],
    accelerations: Sequence[float],
) -> Array:
    """q, rates and accelerations (3, n, size) at angles (n, inputs), each pose from the last."""
    q, poses = np.array(start, float), []
    for driven in np.reshape(angles, (-1, linkage.inputs)):
        q[-linkage.inputs :] = driven
        q = position(linkage, q).root
        v = velocity(linkage, q, rates)
        poses.append((q, v, acceleration(linkage, q, v, accelerations)))
    return np.swapaxes(poses, 0, 1)


def moving(k: int, size: int) -> Point:
    """Point number k of a mechanism with `size` coordinates."""
    return np.eye(size)[2 * k : 2 * k + 2], np.zeros(2)


def fixed(x: float, y: float, size: int) -> Point:
    return np.zeros((2, size)), np.array([x, y])


def distance(start: Point, end: Point, length: float) -> Row:
    """|end - start|^2 = length^2."""
    matrix, shift = end[0] - start[0], end[1] - start[1]

    def row(q: Array, rates: Array) -> tuple[float, Array, float]:
        along, speed = matrix @ q + shift, matrix @ rates
        return float(along @ along) - length**2, 2.0 * along @ matrix, float(2.0 * speed @ speed)

    return row


def collinear(start: Point, middle: Point, end: Point) -> Row:
    """(middle - start) x (end - start) = 0."""
    (a, s), (b, t) = ((p[0] - start[0], p[1] - start[1]) for p in (middle, end))

    def row(q: Array, rates: Array) -> tuple[float, Array, float]:
        u, w, du, dw = a @ q + s, b @ q + t, a @ rates, b @ rates
        gradient = w[1] * a[0] - w[0] * a[1] + u[0] * b[1] - u[1] * b[0]
        return u[0] * w[1] - u[1] * w[0], gradient, 2.0 * (du[0] * dw[1] - du[1] * dw[0])

    return row


def turned(
    base: Point, pin: Point, length: float, angle: int, threshold: float | None, slope: float = 1.0
) -> tuple[Row, ...]:
    """pin - base = length (cos, sin) of coordinate number `angle`, one of its rows or both.

    The cosine row where |cos| < threshold, else the sine row (text line 2395); None: both, which
    leaves no mirror image, and Newton-Raphson becomes Gauss-Newton. The slider-crank's velocity
    notebook has the row's derivative by the angle with a wrong sign (8356, 8363): slope = -1.
    """
    matrix, shift = pin[0] - base[0], pin[1] - base[1]

    def along(axis: int, q: Array, rates: Array) -> tuple[float, Array, float]:
        c, s = length * np.cos(q[angle]), length * np.sin(q[angle])
        gradient, reach = matrix[axis].copy(), (c, s)[axis]
        gradient[angle] += slope * (s, -c)[axis]
        return matrix[axis] @ q + shift[axis] - reach, gradient, reach * rates[angle] ** 2

    if threshold is None:
        return tuple(lambda q, rates, axis=axis: along(axis, q, rates) for axis in (0, 1))
    return (lambda q, rates: along(int(abs(np.cos(q[angle])) >= threshold), q, rates),)


def fourbar(
    crank: float, coupler: float, rocker: float, ground: float, threshold: float | None = 0.5**0.5
) -> Linkage:
    """q = (X1, Y1, X2, Y2, theta): crank pin and pin of coupler and rocker."""
    a, b, one, two = fixed(0, 0, 5), fixed(ground, 0, 5), moving(0, 5), moving(1, 5)
    return Linkage(
        (
            distance(a, one, crank),
            distance(one, two, coupler),
            distance(two, b, rocker),
            *turned(a, one, crank, 4, threshold),
        ),
        1,
    )


def fivebar(
    left: float,
    left_coupler: float,
    right_coupler: float,
    right: float,
    ground: float,
    threshold: float | None = 0.5,
) -> Linkage:
    """q = (X1, Y1, X2, Y2, X3, Y3, theta, beta): left pin, middle pin, right pin."""
    a, b, (one, two, three) = fixed(0, 0, 8), fixed(ground, 0, 8), (moving(k, 8) for k in range(3))
    return Linkage(
        (
            distance(a, one, left),
            distance(one, two, left_coupler),
            distance(two, three, right_coupler),
            distance(three, b, right),
            *turned(a, one, left, 6, threshold),
            *turned(b, three, right, 7, threshold),
        ),
        2,
    )


def slider_crank(
    crank: float,
    coupler: float,
    guide: Sequence[tuple[float, float]],
    threshold: float | None = 0.5**0.5,
    slope: float = 1.0,
) -> Linkage:
    """q = (X1, Y1, X2, Y2, theta): crank pin and slider on the line through two fixed points."""
    a, one, two = fixed(0, 0, 5), moving(0, 5), moving(1, 5)
    b, c = (fixed(*point, 5) for point in guide)
    return Linkage(
        (
            distance(a, one, crank),
            distance(one, two, coupler),
            collinear(b, two, c),
            *turned(a, one, crank, 4, threshold, slope),
        ),
        1,
    )


def inverted_slider_crank(
    crank: float, rod: float, bar: float, ground: float, threshold: float | None = 0.95
) -> Linkage:
    """q = (X1, Y1, X2, Y2, X3, Y3, theta, beta): crank pin, end of the rod, slider on the rod."""
    a, b, (one, two, three) = fixed(0, 0, 8), fixed(ground, 0, 8), (moving(k, 8) for k in range(3))
    return Linkage(
        (
            distance(a, one, crank),
            distance(one, two, rod),
            distance(b, three, bar),
            collinear(one, three, two),
            *turned(a, one, crank, 6, threshold),
            *turned(b, three, bar, 7, threshold),
        ),
        2,
    )


def inverted_mistake(rates: Array) -> dict[int, float]:
    """Bias of rod (a product for a difference, line 3704) and slider (3706), as printed."""
    one, two, three = rates[:6].reshape(3, 2)
    u, w = two - one, three - one
    return {
        1: -2.0 * one @ u + 2.0 * (two**2) @ one,
        3: (
            -2.0 * one[0] * (u[1] + w[1])
            + one[1] * (u[0] - w[0])
            - two[0] * (three[1] + one[1])
            + two[1] * w[0]
            + three[0] * u[1]
            - three[1] * u[0]
        ),
    }


EXAMPLES = {  # linkage, printed first guess (text lines 1262, 5898, 7762, 9091)
    "four-bar": (fourbar(1.0, 2.0, 2.5, 3.0), (0.1, 1.0, 1.0, 0.2, 0.0)),
    "five-bar": (fivebar(2.0, 3.5, 4.0, 1.0, 2.0), (0.1, 2.0, 1.0, 0.2, 2.02, 0.1, 0.3, 0.9)),
    "slider-crank": (slider_crank(1.0, 2.0, ((2.0, 0.0), (3.0, 0.0))), (0.1, 0.2, 1.0, 0.2, 0.5)),
    "inverted slider-crank": (
        inverted_slider_crank(2.0, 3.0, 1.0, 2.0),
        (0.1, 0.2, 1.0, 0.2, 2.0 + np.cos(0.8), np.sin(0.8), 0.5, 0.8),
    ),
}


def main(argv: Sequence[str] | None = None) -> None:
    poses = 20 if command(__doc__).parse_args(argv).quick else 500
    print(f"{'linkage':24}{'iterations':>11}{'poses/s':>10}")
    for name, (linkage, start) in EXAMPLES.items():
        found = position(linkage, start)
        angles = found.root[-linkage.inputs :] + np.linspace(0.0, 0.1, poses)[:, None]
        began = time.perf_counter()
        sweep(linkage, found.root, angles, (1.0,) * linkage.inputs, (0.0,) * linkage.inputs)
        print(f"{name:24}{found.iterations:11}{poses / (time.perf_counter() - began):10,.0f}")


if __name__ == "__main__":
    main()
