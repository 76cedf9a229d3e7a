"""Forces in the pins of a balancer and the moments that its joints have to carry."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def levers(theta: ArrayLike, lengths: ArrayLike) -> tuple[Array, Array]:
    """Vectors T - P_i from the joints to the tip, x and y [m] (..., n), joints 1 .. n from O on.

    `theta` [rad] are the segments' angles, clockwise from +y, and `lengths` [m] theirs, (..., n).
    The first is the tip itself, since P_1 = O; the last is the last segment.

    >>> x, y = levers([0.0, np.pi / 2], [1.0, 2.0])
    >>> x.round(9), y.round(9)
    (array([2., 2.]), array([1., 0.]))
    """
    angle, length = np.asarray(theta, float), np.asarray(lengths, float)

    def to_the_tip(part: Array) -> Array:
        return np.asarray(np.cumsum(part[..., ::-1], axis=-1)[..., ::-1])

    return to_the_tip(length * np.sin(angle)), to_the_tip(length * np.cos(angle))


def pin_force(
    theta: ArrayLike, lengths: ArrayLike, moments: ArrayLike, joint: int | None = None
) -> tuple[Array, Array]:
    r"""Force in the pins of the chain, from the equilibrium of its free segments.

    ::

            P_2 ------ T        T - P_i = (x_i, y_i); the chain presses on the tip with F,
           /          //        the ground on segment 1 with F, each segment on the next
        P_1          //
          \\        //  r       M_1 = x_1 F_y - y_1 F_x       equilibrium about joint i of all
            \\     //           M_k = x_k F_y - y_k F_x       segments from i on
             O ----             F = (M_k T - M_1 (T - P_k))/(x_k y_1 - x_1 y_k)

    The segments are massless, so the same force acts in all pins of the chain: O, P_2 .. P_n
    and the tip, whose pin carries no moment.

    Parameters
    ----------
    theta, lengths : segments' angles, clockwise from +y [rad], and lengths [m], (..., n)
    moments : spring moments of the joints [N m], (..., n)
    joint : k, 2 .. n, of a joint that is not on a stop, so that it carries only the moment of its
        spring; the last joint unless given

    Returns
    -------
    F_x, F_y [N] (...), to the right and upwards, on segment 1 in O and on the pendulum in its tip

    Raises
    ------
    ValueError
        No such joint.

    Notes
    -----
    Singular only where P_k lies on the pendulum's line; for the last joint: where the last segment
    points at O. There the force is not finite, or is only rounding. At equilibrium every free joint
    gives the same force.

    Source: van Nes 2022, appendices B and C. B.3 and B.4 and the program's own forms divide by
    cos(theta_1) and cos(theta_n), so that they fail at poses which are not singular. Appendix C
    draws M_4 in the opposite sense; with M_4 = k_4 e_4 its sign in C.1 and C.2 must be reversed.

    Examples
    --------
    >>> x, y = pin_force([0.0, np.pi / 2], [1.0, 1.0], [3.0, 2.0])
    >>> round(float(x), 9), round(float(y), 9)
    (-1.0, 2.0)
    """
    x, y = levers(theta, lengths)
    count = x.shape[-1]
    k = count if joint is None else joint
    if not 2 <= k <= count:
        raise ValueError(f"joint must be one of 2 to {count}, got {joint}")
    moment = np.asarray(moments, float)
    first, other = moment[..., 0], moment[..., k - 1]
    (x1, y1), (xk, yk) = ((x[..., i], y[..., i]) for i in (0, k - 1))
    with np.errstate(divide="ignore", invalid="ignore"):  # singular: inf or nan, as documented
        area = xk * y1 - x1 * yk
        return (other * x1 - first * xk) / area, (other * y1 - first * yk) / area


def node_loads(
    theta: ArrayLike, lengths: ArrayLike, force_x: ArrayLike, force_y: ArrayLike
) -> Array:
    r"""Moments M_il [N m] (..., n) with which a force at the tip loads joints 1 .. n.

    ::

        M_il = (T - P_i)_x F_y - (T - P_i)_y F_x

    A free joint's spring carries the load: M_il = M_i. A joint on its preloaded stop stays there
    while 0 <= M_il <= preload, and the stop presses with the rest.

    `theta` [rad] and `lengths` [m] (..., n), forces [N] (...) as from `pin_force`. Accuracy:
    rounding. Source: van Nes 2022, appendix D and lines 3912-3914.

    >>> node_loads([0.0, np.pi / 2], [1.0, 1.0], -1.0, 2.0).round(9)
    array([3., 2.])
    """
    x, y = levers(theta, lengths)
    fx, fy = (np.asarray(force, float)[..., None] for force in (force_x, force_y))
    return np.asarray(x * fy - y * fx)


def pivot_force(
    force_x: ArrayLike, force_y: ArrayLike, weight: ArrayLike = 0.0
) -> tuple[Array, Array]:
    """Force [N] of the ground on the pendulum in its own pivot O, by the pendulum's equilibrium.

    ::

        R = -F + (0, weight)

    F is that of `pin_force` [N] and `weight` m g at the tip [N]; the drive is a pure moment.

    >>> x, y = pivot_force(-1.0, 2.0, weight=3.0)
    >>> float(x), float(y)
    (1.0, 1.0)
    """
    return -np.asarray(force_x, float), np.asarray(weight, float) - np.asarray(force_y, float)
