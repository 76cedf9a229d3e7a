"""Power hacksaw by Newton-Raphson, as its report solves it: one pose after the other."""

from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tests.independent.newton_raphson import NotConverged, Solution, newton_raphson

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
NAMES = (
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
SWEEP_GUESS = (-0.0997, -0.4684, 2.8737, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # text line 1712


def solve(
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
    angle, rate, acceleration : crank angle [rad] and derivatives [rad/s, rad/s^2], (n,) broadcast
    crank, coupler, offset : lengths [m], see `proofmass.analytic.linkages.hacksaw.solve`
    simultaneous, reduced : see `pose`, `system`
    guess : first guess (9,) of the first pose, in the order of `NAMES` [m, rad, s]; it picks the
        branch, one of four: two assemblies, times the sign of r1
    tolerance : norm of the last step, units mixed

    Returns
    -------
    dict of (n,) arrays: the nine curves of `NAMES`, the number of iterations and the norm of the
    last step (sequential: the most and the largest of the three systems)

    Raises
    ------
    newton_raphson.NotConverged, a ValueError
        No root in 50 iterations: the message gives the first such angle. It says the same of a
        loop that cannot close, a length of zero and a poor guess.

    Notes
    -----
    Agrees with `proofmass.analytic.linkages.hacksaw.solve` within 1e-13 simultaneous, 2e-12
    sequential at the report's tolerance of 1e-6. Source: power hacksaw report, Universidad Nacional
    de Colombia, text lines 340-345, 655-686, 1650-1760.

    Examples
    --------
    >>> link = {"crank": 0.075, "coupler": 0.170, "offset": 0.045}
    >>> sweep = solve([0.0, 0.05], 0.0, 0.0, **link)
    >>> [round(float(r1), 6) for r1 in sweep["r1"]]
    [-0.099672, -0.100635]
    """
    laws = np.stack(np.broadcast_arrays(angle, rate, acceleration), -1, dtype=float)
    x, rows = np.asarray(guess, float), []
    for law in laws:
        try:
            x, log = pose(
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
            raise type(error)(f"at angle {law[0]:.9g} rad: {error}", error.solution) from None
        rows.append([*x, max(s.iterations for s in log), max(s.steps[-1] for s in log)])
    return dict(zip((*NAMES, "iterations", "last_step"), np.array(rows).T, strict=True))


def pose(
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
) -> tuple[Array, list[Solution]]:
    """One pose: the nine unknowns and the log of each system solved.

    `law` is crank angle, rate and acceleration; `guess` (9,) the first iterate. Simultaneous: one
    system of nine; otherwise three of three, position, rates, accelerations, each with the results
    of those before it. The defaults of `tolerance` and `most` are the report's for one pose.
    """
    x = np.array(guess, float)
    size, logs = 9 if simultaneous else 3, []
    for first in range(0, 9, size):
        part = slice(first, first + size)

        def block(unknowns: Array, part: slice = part) -> tuple[Array, Array]:
            x[part] = unknowns
            gap, slope = system(
                x, law, crank=crank, coupler=coupler, offset=offset, reduced=reduced
            )
            return gap[part], slope[part, part]

        logs.append(newton_raphson(block, x[part], tolerance=tolerance, most=most))
        x[part] = logs[-1].root
    return x, logs


def system(
    unknowns: Array,
    law: ArrayLike,
    *,
    crank: float,
    coupler: float,
    offset: float,
    reduced: bool = False,
) -> tuple[Array, Array]:
    r"""The nine loop equations F (9,) and their Jacobian (9, 9).

    With z1 = r1 exp(i theta1), z2, z3 alike, dots for time derivatives and k = 0, 1, 2 dots::

        F_3k   = Im z1 (less the offset for k = 0)        guide
        F_3k+1 = Re(z2 + z3 - z1)                         loop along x
        F_3k+2 = -Im(z2 + z3 - z1)                        loop along y

    J is block triangular. As dz/dt = (dz/dq) dq/dt, the derivative of z with k dots by q with j
    dots is binomial(k, j) times dz/dq with k - j dots.

    `reduced` puts r1 = offset/sin(theta1) into the two loop rows of position, as the report's
    codes for a single pose do (text lines 1296, 1304); its sweep does not. Source: text lines
    300-338, where 300 and 302 print theta2 for theta3; Jacobian text lines 398-456 and 1109, where
    line 1109 prints columns 7, 8 of row 7 as 2 theta1' cos(theta1), cos(theta1). Departure: rows
    of rates stand in the order guide, x, y, as those of position and acceleration do.
    """
    r1, theta1, theta3 = (unknowns[i::3] for i in range(3))  # each with its two derivatives
    along, turned2, turned3 = _spin(theta1), crank * _spin(law), coupler * _spin(theta3)
    z1 = np.array([sum(comb(k, j) * r1[j] * along[k - j] for j in range(k + 1)) for k in range(3)])
    gap = turned2 + turned3 - z1
    residual = np.stack([z1.imag, gap.real, -gap.imag], 1)
    residual[0, 0] -= offset
    blocks = [_slope(along[k], z1[k], turned3[k]) for k in range(3)]
    jacobian = np.block([[comb(k, j) * blocks[max(k - j, 0)] for j in range(3)] for k in range(3)])
    if reduced:
        c, s = along[0].real, along[0].imag
        residual[0, 1:] += [(r1[0] - offset / s) * c, offset - r1[0] * s]
        jacobian[1:3, :2] = [[0.0, offset / s**2], [0.0, 0.0]]
    return residual.ravel(), jacobian


def _spin(motion: ArrayLike) -> Complex:
    """exp(i angle) and its first two time derivatives, from angle, rate and acceleration."""
    angle, rate, acceleration = np.asarray(motion)
    return np.exp(1j * angle) * np.array([1.0, 1j * rate, 1j * acceleration - rate**2])


def _slope(along: complex, z1: complex, z3: complex) -> Array:
    """Derivatives of guide, loop x, loop y by r1, theta1, theta3."""
    by = np.array([[along, 1j * z1, 0.0], [-along, -1j * z1, 1j * z3]])
    return np.stack([by[0].imag, by[1].real, -by[1].imag])
