"""Power hacksaw by Newton-Raphson, as its report solves it: one pose after the other."""

from math import comb

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.newton_raphson import NewtonLog, NotConverged, newton_raphson
from proofmass.analytic.numerics import Array, Complex

NAMES: tuple[str, ...] = (
    "r1",
    "theta1",
    "theta3",
    "r1_rate",
    "theta1_rate",
    "theta3_rate",
    "r1_acceleration",
    "theta1_acceleration",
    "theta3_acceleration",
)
FIRST_GUESS = (-0.1, -0.5, 3.0, 0.5, 0.0, -0.5, 0.5, 0.0, -0.5)  # text line 357
SWEEP_GUESS = (-0.0997, -0.4684, 2.8737, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # text line 1712


def newton_sweep(
    angle: ArrayLike,
    rate: ArrayLike,
    acceleration: ArrayLike,
    *,
    crank: float,
    coupler: float,
    offset: float,
    simultaneous: bool = True,
    reduced: bool = False,
    guess: ArrayLike = SWEEP_GUESS,
    tolerance: float = 1e-6,
) -> dict[str, Array]:
    """Sweep with continuation: the solution of a pose is the first guess of the next.

    Parameters
    ----------
    angle, rate, acceleration : array_like (n,)
        Crank angle [rad] and its derivatives [rad/s, rad/s^2], broadcast together.
    crank, coupler, offset : float
        Lengths [m], see `proofmass.analytic.linkages.hacksaw.solve`.
    simultaneous, reduced : bool
        See `newton_pose`, `system`.
    guess : array_like (9,)
        First guess of the first pose, in the order of `NAMES` [SI]; it picks the branch, one of
        four: two assemblies, times the sign of r1.
    tolerance : float
        Norm of the last step [SI], units mixed.

    Returns
    -------
    dict of ndarray (n,)
        The nine curves of `NAMES` [SI], the number of iterations [1] and the norm of the last step
        [SI]; sequential: the sum and the largest of the three systems.

    Raises
    ------
    NotConverged
        A ValueError: no root in 50 iterations. The message gives the first such angle. It says the
        same of a loop that cannot close, a length of zero and a poor guess.

    Notes
    -----
    Agrees with `proofmass.analytic.linkages.hacksaw.solve` within 1e-13 simultaneous, 2e-12
    sequential at the report's tolerance of 1e-6. Source: power hacksaw report, Universidad Nacional
    de Colombia, text lines 340-345, 655-686, 1650-1760.

    Examples
    --------
    >>> link = {"crank": 0.075, "coupler": 0.170, "offset": 0.045}
    >>> sweep = newton_sweep([0.0, 0.05], 0.0, 0.0, **link)
    >>> [round(float(r1), 6) for r1 in sweep["r1"]]
    [-0.099672, -0.100635]
    """
    laws = np.stack(np.broadcast_arrays(angle, rate, acceleration), -1, dtype=float)
    x, rows = np.asarray(guess, float), []
    for law in laws:
        try:
            x, logs = newton_pose(
                law,
                x,
                crank=crank,
                coupler=coupler,
                offset=offset,
                simultaneous=simultaneous,
                reduced=reduced,
                tolerance=tolerance,
                most=50,
            )
        except NotConverged as error:
            raise type(error)(f"at angle {law[0]:.9g} rad: {error}", error.log) from None
        last = max(float(np.linalg.norm(np.diff(log.iterates[-2:], axis=0))) for log in logs)
        rows.append([*x, sum(log.iterations for log in logs), last])
    return dict(zip((*NAMES, "iterations", "last_step"), np.array(rows).T, strict=True))


def newton_pose(
    law: ArrayLike,
    guess: ArrayLike,
    *,
    crank: float,
    coupler: float,
    offset: float,
    simultaneous: bool = True,
    reduced: bool = False,
    tolerance: float = 1e-6,
    most: int = 15,
) -> tuple[Array, list[NewtonLog]]:
    """One pose: the nine unknowns and the log of each system solved.

    Parameters
    ----------
    law : array_like (3,)
        Crank angle, rate and acceleration [SI].
    guess : array_like (9,)
        First iterate, in the order of `NAMES` [SI].
    crank, coupler, offset : float
        Lengths [m].
    simultaneous : bool
        One system of nine; otherwise three of three, position, rates, accelerations, each with the
        results of those before it.
    reduced : bool
        See `system`.
    tolerance : float
        Norm of the last step [SI], units mixed; the report's for one pose, as is `most`.
    most : int
        Iterations allowed for a system.

    Returns
    -------
    unknowns : ndarray (9,)
        [SI]
    logs : list of NewtonLog
        One, or three.
    """
    x, lengths = np.array(guess, float), (crank, coupler, offset)
    if simultaneous:
        log = newton_raphson(
            lambda q: system(q, law, *lengths, reduced=reduced),
            x,
            tolerance=tolerance,
            most=most,
            names=NAMES,
        )
        return np.array(log.root), [log]
    logs = []
    for order in range(3):
        part = slice(3 * order, 3 * order + 3)

        def block(q: Array, order: int = order, part: slice = part) -> tuple[Array, Array]:
            x[part] = q
            return block_of(x[: part.stop], law, *lengths, order, reduced=reduced)

        logs.append(
            newton_raphson(block, x[part], tolerance=tolerance, most=most, names=NAMES[part])
        )
        x[part] = logs[-1].root
    return x, logs


def system(
    unknowns: Array,
    law: ArrayLike,
    crank: float,
    coupler: float,
    offset: float,
    *,
    reduced: bool = False,
) -> tuple[Array, Array]:
    r"""The nine loop equations F (9,) and their Jacobian (9, 9).

    With z1 = r1 exp(i theta1), z2, z3 alike, dots for time derivatives and k = 0, 1, 2 dots::

        F_3k   = Im z1 (less the offset for k = 0)        guide
        F_3k+1 = Re(z2 + z3 - z1)                         loop along x
        F_3k+2 = -Im(z2 + z3 - z1)                        loop along y

    J is block triangular. As dz/dt = (dz/dq) dq/dt, the derivative of z with k dots by q with j
    dots is binomial(k, j) times dz/dq with k - j dots: each block on the diagonal is that of the
    positions.

    Parameters
    ----------
    unknowns : ndarray (9,)
        In the order of `NAMES` [SI].
    law : array_like (3,)
        Crank angle, rate and acceleration [SI].
    crank, coupler, offset : float
        Lengths [m].
    reduced : bool
        Puts r1 = offset/sin(theta1) into the two loop rows of position, as the report's codes for a
        single pose do (text lines 1296, 1304); its sweep does not.

    Returns
    -------
    residual : ndarray (9,)
        [SI]
    jacobian : ndarray (9, 9)
        [SI]

    Notes
    -----
    Source: text lines 300-338, where 300 and 302 print theta2 for theta3; Jacobian text lines
    398-456 and 1109, where line 1109 prints columns 7, 8 of row 7 as 2 theta1' cos(theta1),
    cos(theta1). Departure: rows of rates stand in the order guide, x, y, as those of position and
    acceleration do.
    """
    along, z1, turned3, residual = _loop(unknowns, law, crank, coupler, offset)
    blocks = [_slope(along[k], z1[k], turned3[k]) for k in range(3)]
    jacobian = np.block([[comb(k, j) * blocks[max(k - j, 0)] for j in range(3)] for k in range(3)])
    if reduced:
        residual[0], jacobian[:3, :3] = _reduced(residual[0], jacobian[:3, :3], unknowns, offset)
    return residual.ravel(), jacobian


def block_of(
    unknowns: Array,
    law: ArrayLike,
    crank: float,
    coupler: float,
    offset: float,
    order: int,
    *,
    reduced: bool = False,
) -> tuple[Array, Array]:
    """The three equations of positions, rates or accelerations, and their Jacobian (3, 3).

    Parameters
    ----------
    unknowns : ndarray (3 order + 3,)
        Those of this order and of those below it [SI].
    law : array_like (3,)
        Crank angle, rate and acceleration [SI].
    crank, coupler, offset : float
        Lengths [m].
    order : int
        Number of dots: 0, 1, 2.
    reduced : bool
        See `system`.

    Returns
    -------
    residual : ndarray (3,)
        [SI]
    jacobian : ndarray (3, 3)
        [SI]
    """
    along, z1, turned3, residual = _loop(
        np.append(unknowns, np.zeros(9 - unknowns.size)), law, crank, coupler, offset
    )
    slope = _slope(along[0], z1[0], turned3[0])
    if reduced and not order:
        return _reduced(residual[0], slope, unknowns, offset)
    return residual[order], slope


def _loop(
    unknowns: Array, law: ArrayLike, crank: float, coupler: float, offset: float
) -> tuple[Complex, Complex, Complex, Array]:
    """Direction of r1, its vector and that of the coupler, with 0 to 2 dots; F (3, 3)."""
    r1, theta1, theta3 = (unknowns[i::3] for i in range(3))  # each with its two derivatives
    along, turned2, turned3 = _spin(theta1), crank * _spin(law), coupler * _spin(theta3)
    z1 = np.array([sum(comb(k, j) * r1[j] * along[k - j] for j in range(k + 1)) for k in range(3)])
    gap = turned2 + turned3 - z1
    residual = np.stack([z1.imag, gap.real, -gap.imag], 1)
    residual[0, 0] -= offset
    return along, z1, turned3, residual


def _reduced(
    residual: Array, jacobian: Array, unknowns: Array, offset: float
) -> tuple[Array, Array]:
    """The rows of position with r1 = offset/sin(theta1) in those of the loop."""
    r1, c, s = unknowns[0], np.cos(unknowns[1]), np.sin(unknowns[1])
    changed = np.array(jacobian)
    changed[1:, :2] = [[0.0, offset / s**2], [0.0, 0.0]]
    return residual + np.array([0.0, (r1 - offset / s) * c, offset - r1 * s]), changed


def _spin(motion: ArrayLike) -> Complex:
    """exp(i angle) and its first two time derivatives, from angle, rate and acceleration."""
    angle, rate, acceleration = np.asarray(motion)
    return np.exp(1j * angle) * np.array([1.0, 1j * rate, 1j * acceleration - rate**2])


def _slope(along: complex, z1: complex, z3: complex) -> Array:
    """Derivatives of guide, loop x, loop y by r1, theta1, theta3."""
    by = np.array([[along, 1j * z1, 0.0], [-along, -1j * z1, 1j * z3]])
    return np.stack([by[0].imag, by[1].real, -by[1].imag])
