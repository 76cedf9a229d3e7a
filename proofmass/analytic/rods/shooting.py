"""Rods integrated from their clamps by the classical Runge-Kutta method or one of order 8.

The integration uses no elliptic integrals.  The variational equations give its derivatives, and
with them the index of an equilibrium: the number of negative directions of its energy.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import DOP853

from proofmass.analytic.numerics import check_positive
from proofmass.analytic.rods.elastica import check_section_stiffnesses, check_stiffness
from proofmass.base.arrays import Array, Complex

RK4 = (
    np.array([[0, 0, 0, 0], [0.5, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 1, 0]], float),
    np.array([1, 2, 2, 1]) / 6.0,
)
SCHEMES = {"rk4": RK4, "dop853": (DOP853.A[:12, :12], DOP853.B)}


@dataclass(frozen=True)
class ShotRods:
    """Rods at their nodes, with derivatives by the load and by the values at the clamp.

    Attributes
    ----------
    s : (nodes,) arc length [m]
    theta, m, x, y : (nodes, ...) [rad], [N m], [m], [m]
    slope : (nodes, 4, 4, ...) derivatives of (theta, m, x, y) by (n_x, n_y, m0, theta0) [SI]; empty
        if they were not asked for
    """

    s: Array
    theta: Array
    m: Array
    x: Array
    y: Array
    slope: Array


def integrate(
    n_x: ArrayLike,
    n_y: ArrayLike,
    m0: ArrayLike,
    *,
    theta0: ArrayLike = 0.0,
    x0: float = 0.0,
    y0: float = 0.0,
    weight_x: float = 0.0,
    weight_y: float = 0.0,
    length: float = 1.0,
    stiffness: float = 1.0,
    axial: float = np.inf,
    shear: float = np.inf,
    nodes: ArrayLike = 41,
    scheme: str = "dop853",
    slopes: bool = False,
) -> ShotRods:
    r"""Rods from clamp to tip with load n on the tip and moment m0 at the clamp.

    ::

        theta' = m/EI,   m' = N_x y' - N_y x',   N(s) = n + w (L - s)
        x' + i y' = (1 + A/EA + i S/GA) exp(i theta),   A + i S = (N_x + i N_y) exp(-i theta)

    A is the force along the section's normal, whose angle is theta, and S the one across it.
    Without an EA and a GA the normal is the tangent of an inextensible rod.  n and m0 are the
    unknowns of shooting; there is no condition at the tip.

    Parameters
    ----------
    n_x, n_y : force on the tip [N] (...)
    m0, theta0 : moment [N m] and tangent's angle [rad] at the clamp (...)
    x0, y0 : clamp [m]
    weight_x, weight_y : w, dead load per length [N/m]
    length, stiffness : L [m], EI [N m^2]
    axial, shear : EA and GA, the section's area of shear included [N]
    nodes : number of nodes, 2 or more, evenly spaced; or their arc lengths [m]
        (nodes,) from 0 to L, of the rod without load
    scheme : "rk4", or "dop853" of order 8
    slopes : whether to integrate the variational equations too

    Raises
    ------
    ValueError
        Fewer than two nodes, or nodes that do not rise from 0 to L; an unknown scheme; a length or
        stiffness that is not positive.

    Notes
    -----
    The schemes are of order 4 and 8 in the step.  The error of "dop853" with 41 nodes is that of
    rounding for a rod of a few half waves.
    Source: Pérez Gámiz 2018, eq. 24-26, 30, 78 and annex II line 1616: RK4 with 61 and 41 nodes;
    eq. 29 for a rod that stretches and shears has two misprints (docs/errata.md).  Order 8:
    scipy's coefficients of Dormand and Prince, with constant steps.

    Examples
    --------
    >>> rod = integrate(0.0, 0.0, np.pi)      # an end moment: half a circle
    >>> round(float(rod.y[-1]), 12), round(float(rod.theta[-1]), 12)
    (0.636619772368, 3.14159265359)
    """
    check_positive(length=length)
    check_stiffness(stiffness)
    check_section_stiffnesses(axial, shear)
    if scheme not in SCHEMES:
        raise ValueError(f"scheme must be one of {', '.join(SCHEMES)}, got {scheme!r}")
    s = _node_places(nodes, length)
    fx, fy, m, turn = np.broadcast_arrays(*(np.asarray(v, float) for v in (n_x, n_y, m0, theta0)))
    width = 5 if slopes else 1
    state = np.zeros((4, width, *fx.shape))
    load: Complex = np.zeros((width, *fx.shape), complex)
    state[0, 0], state[1, 0], state[2, 0], state[3, 0] = turn, m, x0, y0
    load[0] = fx + 1j * fy
    if slopes:
        load[1], load[2], state[1, 3], state[0, 4] = 1.0, 1.0j, 1.0, 1.0
    weight: Complex = np.zeros((width,) + (1,) * fx.ndim, complex)
    weight[0] = weight_x + 1j * weight_y
    weighs = bool(weight[0].any())
    tip, strained = load + 0.0 * weight, bool(np.isfinite(axial) or np.isfinite(shear))

    def rate(at: float, z: Array, slope: Array) -> None:
        beyond = load + complex(length - at) * weight if weighs else tip
        _derivative(z, beyond, stiffness, (axial, shear) if strained else None, slope)

    path = runge_kutta(rate, state, s, scheme)
    theta, moment, x, y = np.moveaxis(path[:, :, 0], 1, 0)
    return ShotRods(s, theta, moment, x, y, path[:, :, 1:])


def _node_places(nodes: ArrayLike, length: float) -> Array:
    """Arc lengths [m] of nodes that are given by their number or by these arc lengths."""
    given = np.asarray(nodes, float)
    if given.ndim == 0:
        if not (given >= 2 and given == np.rint(given)):
            raise ValueError(f"nodes must be a whole number of 2 or more, got {given}")
        return np.linspace(0.0, length, int(given))
    if given.ndim != 1 or given.size < 2:
        raise ValueError(f"nodes must be 2 or more, in one row, got an array {given.shape}")
    rounding = 4.0 * np.finfo(float).eps * length
    ends_fit = given[0] == 0.0 and abs(given[-1] - length) <= rounding
    if not (ends_fit and np.all(np.diff(given) > 0.0)):
        raise ValueError(
            f"nodes must rise from 0 to the length {length} [m], got {given[0]} to {given[-1]}"
        )
    return given


def from_tip(
    n_x: ArrayLike,
    n_y: ArrayLike,
    theta: ArrayLike,
    moment: ArrayLike = 0.0,
    *,
    weight_x: float = 0.0,
    weight_y: float = 0.0,
    length: float = 1.0,
    stiffness: float = 1.0,
    axial: float = np.inf,
    shear: float = np.inf,
    nodes: ArrayLike = 41,
    scheme: str = "dop853",
    slopes: bool = False,
) -> ShotRods:
    """Rods integrated backwards from a tip of known angle [rad], with a moment [N m] on it.

    The equations are those of `integrate` with s counted from the tip and the sign of m reversed.
    So the result has s from the tip, -m instead of m, and x, y of the tip from the point at s;
    slopes are derivatives by (n_x, n_y, -moment, theta).  In a rod under tension errors do not grow
    in this direction, but they do from the clamp.

    >>> back = from_tip(1.0, 2.0, 1.0)
    >>> ahead = integrate(1.0, 2.0, -back.m[-1], theta0=back.theta[-1])
    >>> bool(abs(ahead.theta[-1] - 1.0) < 1e-14), bool(abs(ahead.x[-1] - back.x[-1]) < 1e-14)
    (True, True)
    """
    root_x, root_y = np.asarray(n_x) + weight_x * length, np.asarray(n_y) + weight_y * length
    return integrate(
        root_x,
        root_y,
        -np.asarray(moment, float),
        theta0=theta,
        weight_x=-weight_x,
        weight_y=-weight_y,
        length=length,
        stiffness=stiffness,
        axial=axial,
        shear=shear,
        nodes=nodes,
        scheme=scheme,
        slopes=slopes,
    )


def runge_kutta(
    rate: Callable[[float, Array, Array], None], state: Array, s: Array, scheme: str
) -> Array:
    """States (nodes, ...) of an explicit Runge-Kutta method on the nodes s.

    `rate` takes an arc length, a state and the array into which it writes the state's derivative.
    """
    a, b = SCHEMES[scheme]
    c = a.sum(axis=1)
    path, stages = np.empty((s.size, state.size)), np.empty((b.size, state.size))
    path[0] = state.ravel()
    before, slots = [stages[:j] for j in range(b.size)], stages.reshape(-1, *state.shape)
    for i, step in enumerate(np.diff(s)):
        shares, places, here = step * a, s[i] + c * step, path[i]
        for j in range(b.size):
            at = here + shares[j, :j] @ before[j]
            rate(places[j], at.reshape(state.shape), slots[j])
        path[i + 1] = here + (step * b) @ stages
    return path.reshape(s.size, *state.shape)


def _derivative(
    state: Array,
    load: Complex,
    stiffness: float,
    strains: tuple[float, float] | None,
    slope: Array,
) -> None:
    """Write d/ds of (theta, m, x, y), in row 0 of axis 1, and of its tangents in the other rows.

    `strains` are EA and GA, or None for a rod without either strain.
    """
    turns, tangents = state[0], state.shape[1] > 1
    turn = np.exp(1j * turns[0])
    path = 1j * turn * turns
    path[0] = turn
    if strains is not None:
        axial, shear = strains
        local = load * turn.conj()
        if tangents:
            local[1:] -= 1j * local[0] * turns[1:]
        strain = (local.real / axial + 1j * (local.imag / shear)) * turn
        if tangents:
            strain[1:] += 1j * strain[0] * turns[1:]
        path += strain
    back = load.conj()
    bend = back * path[0]
    if tangents:
        bend[1:] += back[0] * path[1:]
    np.divide(state[1], stiffness, slope[0])
    slope[1], slope[2], slope[3] = bend.imag, path.real, path.imag


@dataclass(frozen=True)
class Stability:
    """Numbers of negative directions of V with the tip free and pinned, and the tip's compliance.

    free, pinned : (...) numbers of negative eigenvalues; 0 is stable
    compliance : (2, 2, ...) derivatives of the tip's position by the dead load on it [m/N]
    """

    free: Array
    pinned: Array
    compliance: Array


def stability(
    n_x: ArrayLike,
    n_y: ArrayLike,
    theta: ArrayLike,
    moment: ArrayLike = 0.0,
    *,
    weight_x: float = 0.0,
    weight_y: float = 0.0,
    length: float = 1.0,
    stiffness: float = 1.0,
    axial: float = np.inf,
    shear: float = np.inf,
    nodes: int = 201,
) -> Stability:
    r"""Negative directions of the second variation at an equilibrium that is given by its tip.

    ::

        d2V[h] = int EI h'^2 + (N_x cos(theta) + N_y sin(theta)) h^2 ds,    h(0) = 0

    With the tip free their number is that of the zeros on (0, L) of Jacobi's field, which begins at
    the tip with h = 1 and h' = 0 and obeys EI h'' = (N . t) h.  In a rod that stretches and shears
    the strains are in equilibrium for each h, so that (N . t) is replaced by
    A + (A^2 - S^2) (1/EA - 1/GA).  With the tip pinned, and C = d(x, y)/d(n_x, n_y) at constant
    clamp and constant moment of the tip::

        pinned = free - (number of negative eigenvalues of C)

    since the inertia of a bordered matrix is that of its block and of the Schur complement.

    Parameters
    ----------
    n_x, n_y, theta, moment : force [N] on the tip, its angle [rad], moment [N m] on it (...)
    weight_x, weight_y : dead load per length [N/m]
    length, stiffness, axial, shear, nodes : of `integrate` [m, N m^2, N, N, 1]

    Returns
    -------
    Stability

    Notes
    -----
    Two zeros of the field between neighbouring nodes are not found, so there must be many nodes for
    each half wave.  Exactly at a critical load the number is that below it or that above it.  Pérez
    Gámiz 2018 does not treat stability.  Inertia: E. V. Haynsworth, Linear Algebra Appl. 1 (1968)
    73-81.

    Examples
    --------
    >>> column = stability([-2.0, -3.0, -21.0, -23.0], 0.0, 0.0)     # pi^2/4, 20.19, 9 pi^2/4
    >>> column.free.tolist(), column.pinned.tolist()
    ([0, 1, 1, 2], [0, 0, 1, 1])
    """
    rods = from_tip(
        n_x,
        n_y,
        theta,
        moment,
        weight_x=weight_x,
        weight_y=weight_y,
        length=length,
        stiffness=stiffness,
        axial=axial,
        shear=shear,
        nodes=nodes,
        slopes=True,
    )
    field, end = rods.slope[:, 0, 3], rods.slope[-1]
    compliance = end[2:, :2] - end[2:, 3:] * (end[:1, :2] / end[0, 3])
    free = np.sum(np.signbit(field[1:]) != np.signbit(field[:-1]), axis=0)
    eigenvalues = np.linalg.eigvalsh(np.moveaxis(compliance, (0, 1), (-2, -1)))
    return Stability(free, free - np.sum(eigenvalues < 0.0, axis=-1), compliance)
