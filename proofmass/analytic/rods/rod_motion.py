r"""Motion in time of a slender rod that bends in a plane: a Kirchhoff rod with mass along it.

The rod keeps its length, and its sections stay normal to it and have no rotary inertia of their
own.  Position z = x + iy and angle theta of the tangent over the arc length s and the time t are::

    z(s, t) = z0(t) + int_0^s exp(i theta) ds,         theta(s, t) = theta0 + sum_k a_k(t) phi_k(s)
    T = 1/2 int rho |z_t|^2 ds + 1/2 m |z_t(L)|^2,     V = 1/2 int EI theta_s^2 ds - weight

z0 is the beginning of the rod, at rest or with a prescribed motion, and m is the mass of a slider
at the tip, on a guide along x.  phi_k are Legendre polynomials P_k(2 s/L - 1), or, if the rod is
clamped, P_k + P_(k-1), which are zero at the beginning.  The moment on a free or a pinned end is
zero as a natural boundary condition of the energy.  With z_t = z0_t + sum_k J_k a_k',
J_k = int i exp(i theta) phi_k ds, Lagrange's equations are::

    M a'' + K a = -int rho Re(conj(J) (b - g)) ds + (force of the guide) Im J(L)
    M = int rho Re(conj(J) J^T) ds,    K = int EI phi_s phi_s^T ds
    b = z0_tt - int exp(i theta) theta_t^2 ds

All integrals are sums over Gauss's nodes; the integral up to a node is that of the polynomial
through the values at all nodes.  The equations with these sums follow from a Lagrangian as well, so
for every number of polynomials energy is conserved to the accuracy of the integration in time.
That is Gauss's collocation of eighth order, which is stable for every step, since the highest
frequency of the polynomials grows with the fourth power of their number.  The guide constrains the
accelerations; at each sample positions and velocities are projected on it, by the change that is
least in the norm of M.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike
from scipy.linalg.lapack import dgetrf, dgetrs

from proofmass.analytic.remember import reuse_nearby
from proofmass.base.arrays import Array, Complex

POLYNOMIAL_COUNTS = 10, 16, 22
"""Numbers of polynomials, which are tried in this order until the motion no longer changes."""
POSITION_TOLERANCE = 2e-5
"""Largest change [L] of a position from one number of polynomials to the next, for which the motion
of the latter is accepted."""
RESOLVED_MODES = 4
"""Number of modes of small motions whose phases change by no more than a radian in a time step."""
MAX_TIME_STEPS = 1e5
"""Largest number of steps in time, a minute of computing for each number of polynomials."""
MAX_STEP_HALVINGS = 6
"""Largest number of times that a step is halved in which the rod turns too far."""
MAX_STEP_ITERATIONS = 30
"""Largest number of Newton's iterations of a step in time."""
CHANGE_TOLERANCE, ROUNDING_LIMIT = 1e-14, 1e-9
"""Change of a coefficient [rad] in an iteration at which the iterations end, and at which they end
if the change is more than half of the one before."""


def collocation(stages: int) -> tuple[Array, Array, Array]:
    """Nodes, weights and matrix of Gauss's collocation with `stages` stages, for a step of 1."""
    x, weights = legendre.leggauss(stages)
    fit = np.linalg.inv(legendre.legvander(x, stages - 1))
    lift = np.array([legendre.legint(row, lbnd=-1, scl=0.5) for row in fit.T])
    return 0.5 * (x + 1.0), 0.5 * weights, legendre.legval(x, lift.T).T


COLLOCATION_NODES, WEIGHTS, FIRST_INTEGRALS = collocation(4)
# Second integrals of values at the nodes, up to each node and up to the end of the step:
SECOND_INTEGRALS, SECOND_WEIGHTS = FIRST_INTEGRALS @ FIRST_INTEGRALS, WEIGHTS @ FIRST_INTEGRALS


class RodBasis(NamedTuple):
    """Polynomials at Gauss's nodes, for a rod of length 1.

    Attributes
    ----------
    phi : ndarray (count, nodes)
        Values of the polynomials [1].
    bend : ndarray (count, count)
        Integrals of products of their slopes [1].
    upto : ndarray (nodes, nodes)
        Weights of the nodes in the integral up to each node [1].
    half, whole : ndarray (nodes,)
        Weights of the nodes in the integral up to the middle, and up to the end [1].
    ends : ndarray (3, count)
        Values of the polynomials at the middle, at the tip and at the beginning [1].
    slope : ndarray (count,)
        Slopes of the polynomials at the beginning [1].
    """

    phi: Array
    bend: Array
    upto: Array
    half: Array
    whole: Array
    ends: Array
    slope: Array


@lru_cache
def basis(count: int, clamped: bool) -> RodBasis:
    """The first `count` polynomials; for a clamped rod they are zero at its beginning.

    >>> basis(4, clamped=True).phi.shape
    (4, 18)
    """
    x, weights = legendre.leggauss(2 * count + 10)
    rows = np.eye(count + 1)
    rows = rows[1:] + rows[:-1] if clamped else rows[:-1]
    slopes = np.array([2.0 * legendre.legval(x, legendre.legder(row)) for row in rows])
    nodes = np.eye(x.size)
    # coefficients of the polynomial through values at the nodes; Gauss's rule gives them exactly
    fit = (np.arange(x.size)[:, None] + 0.5) * legendre.legvander(x, x.size - 1).T * weights
    lift = np.array([legendre.legint(row, lbnd=-1, scl=0.5) for row in nodes]).T @ fit
    return RodBasis(
        np.asarray(legendre.legval(x, rows.T), float),
        (slopes * weights / 2.0) @ slopes.T,
        np.asarray(legendre.legval(x, lift).T, float),
        np.asarray(legendre.legval(0.0, lift), float),
        weights / 2.0,
        np.stack([legendre.legval(at, rows.T) for at in (0.0, 1.0, -1.0)]),
        np.array([2.0 * legendre.legval(-1.0, legendre.legder(row)) for row in rows]),
    )


MotionOfBase = Callable[[ArrayLike], tuple[Complex, Complex, Complex]]


@dataclass(frozen=True)
class MovingRod:
    """A rod with mass in motion in a plane.

    Attributes
    ----------
    length, stiffness, mass : float
        Length [m], EI [N m^2], and mass of the whole rod [kg].
    clamped : bool
        Whether its tangent is fixed at its beginning, at the angle `theta0`; else it is pinned.
    gravity : complex
        Acceleration of gravity, g_x + i g_y [m/s^2].
    theta0 : float
        Angle from which bending is measured [rad].
    begin : callable, optional
        Function of time that returns z0, its velocity and its acceleration [m, m/s, m/s^2]; None:
        z0 = 0.
    slider : float, optional
        Mass of a slider at the tip, on the x axis [kg]; None: the tip is free.

    Examples
    --------
    Frequencies of a clamped beam, (beta L)^2 = 3.516, 22.03, ...:

    >>> rod = MovingRod(1.0, 1.0, 1.0)
    >>> [round(float(w), 3) for w in rod.frequencies(10)[:2]]
    [3.516, 22.034]
    """

    length: float
    stiffness: float
    mass: float
    clamped: bool = True
    gravity: complex = 0.0
    theta0: float = 0.0
    begin: MotionOfBase | None = None
    slider: float | None = None

    def base(self, t: ArrayLike) -> tuple[Complex, Complex, Complex]:
        """Position, velocity and acceleration (...) of the beginning [m, m/s, m/s^2]."""
        none = np.zeros(np.shape(t), complex)
        return self.begin(t) if self.begin else (none, none, none)

    def terms(self, t: ArrayLike, a: Array, rate: Array) -> tuple[Array, Array, Complex, Complex]:
        """Mass matrix, generalized force, and J and b of the tip, at any number of times.

        Parameters
        ----------
        t : float or ndarray (...)
            Time [s].
        a, rate : ndarray (..., count)
            Coefficients and their rates [rad, rad/s].

        Returns
        -------
        mass : ndarray (..., count, count)
            M [kg m^2].
        force : ndarray (..., count)
            Generalized force without the force of the guide [N m].
        tip : ndarray (..., count)
            J at the tip [m].
        ahead : ndarray (...)
            b at the tip [m/s^2].
        """
        form, size = basis(a.shape[-1], self.clamped), self.length
        along = size * np.exp(1j * (self.theta0 + a @ form.phi))
        inward = along * (rate @ form.phi) ** 2
        # real and imaginary parts of J in one real array: real products take half the time
        turned = np.concatenate(
            [-along.imag[..., None, :] * form.phi, along.real[..., None, :] * form.phi], axis=-2
        )
        parts = turned @ form.upto.T
        count = a.shape[-1]
        moves = np.concatenate([parts[..., :count, :], parts[..., count:, :]], axis=-1)
        start = np.asarray(self.base(t)[2])
        b_minus_g = start[..., None] - inward @ form.upto.T - self.gravity
        weighed = self.mass * np.concatenate([form.whole, form.whole]) * moves
        mass = weighed @ np.swapaxes(moves, -1, -2)
        b_minus_g_parts = np.concatenate([b_minus_g.real, b_minus_g.imag], axis=-1)
        force = (
            -self.stiffness / size * (a @ form.bend)
            - (weighed @ b_minus_g_parts[..., None])[..., 0]
        )
        ends = turned @ form.whole
        tip, ahead = ends[..., :count] + 1j * ends[..., count:], start - inward @ form.whole
        if self.slider is not None:
            mass = mass + self.slider * (tip[..., None] * tip.conj()[..., None, :]).real
            force = force - self.slider * (tip * np.conj(ahead - self.gravity)[..., None]).real
        return mass, force, tip, ahead

    def accelerations(self, t: ArrayLike, a: Array, rate: Array) -> tuple[Array, Array]:
        """Second derivatives (..., count) [rad/s^2], and the force (...) of the guide [N]."""
        mass, force, tip, ahead = self.terms(t, a, rate)
        free = np.asarray(np.linalg.solve(mass, force[..., None])[..., 0], float)
        if self.slider is None:
            return free, np.zeros(ahead.shape)
        across = tip.imag
        given = np.linalg.solve(mass, across[..., None])[..., 0]
        guide = -(ahead.imag + (across * free).sum(-1)) / (across * given).sum(-1)
        return free + guide[..., None] * given, guide

    def on_guide(self, t: float, a: Array, rate: Array) -> tuple[Array, Array]:
        """Coefficients and rates (count,) nearest to these with the tip on the guide [rad, rad/s].

        Without a guide they are not changed.
        """
        if self.slider is None:
            return a, rate
        form, (place, velocity, _) = basis(a.size, self.clamped), self.base(t)
        for _ in range(4):
            mass, _, tip, _ = self.terms(t, a, rate)
            given = np.linalg.solve(mass, tip.imag)
            given /= tip.imag @ given
            along = self.length * np.exp(1j * (self.theta0 + a @ form.phi))
            a = a - given * (place + form.whole @ along).imag
        return a, rate - given * (velocity + tip @ rate).imag

    def integrate(self, t: Array, a: Array, rate: Array, step: float) -> tuple[Array, Array]:
        """Coefficients and their rates (times, count) from those at the first time [rad, rad/s].

        Parameters
        ----------
        t : ndarray (times,)
            Rising times [s].
        a, rate : ndarray (count,)
            Coefficients and rates at the first time [rad, rad/s].
        step : float
            Longest step [s].

        Raises
        ------
        ValueError
            A step has no solution, because the rod turns too far in it.
        """
        state = self.on_guide(t[0], a, rate)
        found = [state]
        for begin, end in pairwise(t.tolist()):
            count = int(np.ceil((end - begin) / step))
            for at in np.linspace(begin, end, count + 1)[:-1].tolist():
                state = self.advance(at, *state, (end - begin) / count)
            state = self.on_guide(end, *state)
            found.append(state)
        return np.array([one for one, _ in found]), np.array([one for _, one in found])

    def advance(
        self, t: float, a: Array, rate: Array, h: float, halvings: int = 0
    ) -> tuple[Array, Array]:
        """The result of `stepped` [rad, rad/s]; a step of `h` [s] without solution is halved."""
        try:
            return self.stepped(t, a, rate, h)
        except ArithmeticError:
            if halvings == MAX_STEP_HALVINGS:
                raise ValueError(f"the motion cannot be followed beyond {t:.6g} s") from None
        state = self.advance(t, a, rate, h / 2.0, halvings + 1)
        return self.advance(t + h / 2.0, *state, h / 2.0, halvings + 1)

    def stepped(self, t: float, a: Array, rate: Array, h: float) -> tuple[Array, Array]:
        """Coefficients and rates (count,) after a step of `h` [s], by collocation [rad, rad/s].

        The accelerations at Gauss's stages are found by Newton's method, whose matrix has the mass
        matrix of the beginning of the step and the stiffness of bending.

        Raises
        ------
        ArithmeticError
            Newton's method does not converge, because the rod turns too far in the step.
        """
        count, stages = a.size, COLLOCATION_NODES.size
        mass, _, tip, _ = self.terms(t, a, rate)
        spring = self.stiffness / self.length * basis(count, self.clamped).bend
        constraints = 0 if self.slider is None else 1
        matrix = np.zeros((stages, count + constraints, stages, count + constraints))
        twice = h**2 * SECOND_INTEGRALS
        matrix[:, :count, :, :count] = np.einsum("ij,kl->ikjl", np.eye(stages), mass)
        matrix[:, :count, :, :count] += np.einsum("ij,kl->ikjl", twice, spring)
        if constraints:
            for i in range(stages):
                matrix[i, :count, i, count], matrix[i, count, i, :count] = -tip.imag, tip.imag
        factors, pivots, _ = dgetrf(matrix.reshape(stages * (count + constraints), -1))
        second, guide = np.zeros((stages, count)), np.zeros(stages)
        times, before = t + h * COLLOCATION_NODES, np.inf
        for _ in range(MAX_STEP_ITERATIONS):
            places = a + h * COLLOCATION_NODES[:, None] * rate + twice @ second
            mass, force, tip, ahead = self.terms(times, places, rate + h * FIRST_INTEGRALS @ second)
            residual = force - (mass @ second[..., None])[..., 0]
            if constraints:
                residual += guide[:, None] * tip.imag
                guide_residual = -(ahead.imag + (tip.imag * second).sum(-1))
                residual = np.column_stack([residual, guide_residual])
            change = dgetrs(factors, pivots, residual.ravel())[0].reshape(stages, -1)
            second = second + change[:, :count]
            guide = guide + change[:, count:].sum(-1)
            size = np.abs(twice @ change[:, :count]).max()
            if not size < 1e3:  # NaN, or divergence
                raise ArithmeticError("no solution of a step")
            if not size > CHANGE_TOLERANCE or (size < ROUNDING_LIMIT and size > 0.5 * before):
                break
            before = size
        else:
            raise ArithmeticError("no solution of a step")
        return a + h * rate + h**2 * SECOND_WEIGHTS @ second, rate + h * WEIGHTS @ second

    def frequencies(self, count: int) -> Array:
        """Angular frequencies (count,) of small motions about the straight rod, rising [rad/s].

        They are those without gravity and with the beginning at rest; a guide constrains the tip.
        """
        resting = replace(self, gravity=0.0, theta0=0.0, begin=None)
        zero = np.zeros(count)
        mass = resting.terms(0.0, zero, zero)[0]
        spring = self.stiffness / self.length * basis(count, self.clamped).bend
        if self.slider is not None:  # motions whose tip stays on the guide
            across = np.linalg.svd(resting.terms(0.0, zero, zero)[2].imag[None])[2][1:]
            mass, spring = across @ mass @ across.T, across @ spring @ across.T
        squares = np.linalg.eigvals(np.linalg.solve(mass, spring)).real
        return np.asarray(np.sqrt(np.sort(np.maximum(squares, 0.0))))

    def curves(self, t: Array, a: Array, rate: Array) -> dict[str, Array]:
        """Quantities over time, from coefficients and rates (times, count) [SI].

        Positions, velocities, angles and rates of middle and tip; energies; force and moment on the
        beginning of the rod, with the inertia of the rod and of the slider.
        """
        form, size = basis(a.shape[1], self.clamped), self.length
        z0, v0, a0 = (np.broadcast_to(c, t.shape) for c in self.base(t))
        second, guide = self.accelerations(t, a, rate)
        along = size * np.exp(1j * (self.theta0 + a @ form.phi))
        spin, spun = rate @ form.phi, second @ form.phi
        move, turn = 1j * along * spin, along * (1j * spun - spin**2)

        def of(weights: Array) -> tuple[Complex, Complex, Complex]:
            at = weights.T
            return z0 + along @ at, v0 + move @ at, a0 + turn @ at

        z, v = z0[:, None] + along @ form.upto.T, v0[:, None] + move @ form.upto.T
        changed = a0[:, None] + turn @ form.upto.T
        density = self.mass * form.whole
        kinetic = 0.5 * np.abs(v) ** 2 @ density
        strain = 0.5 * self.stiffness / size * np.einsum("tj,jk,tk->t", a, form.bend, a)
        potential = strain - (np.conj(self.gravity) * z).real @ density
        force = (changed - self.gravity) @ density
        tip, speed, onward = of(form.whole)
        if self.slider is not None:
            kinetic = kinetic + 0.5 * self.slider * np.abs(speed) ** 2
            potential = potential - self.slider * (np.conj(self.gravity) * tip).real
            force = force + self.slider * (onward - self.gravity) - 1j * guide
        found: dict[str, Array] = {}
        for name, (place, velocity, _), ends in (
            ("middle", of(form.half), form.ends[0]),
            ("tip", (tip, speed, onward), form.ends[1]),
        ):
            found |= {
                f"{name}_x": place.real,
                f"{name}_y": place.imag,
                f"{name}_vx": velocity.real,
                f"{name}_vy": velocity.imag,
                f"{name}_angle": self.theta0 + a @ ends,
                f"{name}_rate": rate @ ends,
            }
        return found | {
            "kinetic": kinetic,
            "strain": strain,
            "potential": potential,
            "energy": kinetic + potential,
            "force_x": force.real,
            "force_y": force.imag,
            "guide_force": guide,
            "begin_angle": self.theta0 + a @ form.ends[2],
            "moment": -self.stiffness / size * (a @ form.slope),
        }


RodStart = tuple[MovingRod, Callable[[int], tuple[Array, Array]]]
"""A rod, and a function that returns the coefficients and rates of a number of polynomials at the
start of its motion."""


class ResolvedMotion(NamedTuple):
    """A motion with as many polynomials as it needs.

    Attributes
    ----------
    asked : tuple
        Numbers of the problem, and its times.
    polynomials : int
        Number of polynomials.
    curves : dict of str to ndarray (times,)
        Quantities over time [SI].
    """

    asked: tuple[Any, ...]
    polynomials: int
    curves: dict[str, Array]


def resolved_motion(
    begins: Callable[..., RodStart], problem: tuple[float, ...], times: tuple[float, ...]
) -> dict[str, Array]:
    """Curves of a motion with as many polynomials as it, or a problem near it, needs.

    Parameters
    ----------
    begins : callable
        Function of the numbers of a problem that returns the rod and its start.
    problem : tuple of float
        Numbers of the problem [SI].
    times : tuple of float
        Rising times, from that of the start on [s].

    Raises
    ------
    ValueError
        The motion still changes with the largest number of polynomials, or lasts too long.
    """
    near = find_resolved_motion(begins, problem, times)
    if near.asked == (problem, times):
        return dict(near.curves)
    rod, start = begins(*problem)
    return motion_curves(rod, np.array(times), *start(near.polynomials))


def motion_curves(rod: MovingRod, t: Array, a: Array, rate: Array) -> dict[str, Array]:
    """Curves of a motion from coefficients and rates (count,) at the first of its times."""
    return rod.curves(t, *rod.integrate(t, a, rate, longest_step(rod)))


def longest_step(rod: MovingRod) -> float:
    """Longest step in time [s] of the motion of a rod."""
    return 1.0 / float(rod.frequencies(RESOLVED_MODES + 4)[RESOLVED_MODES - 1])


@reuse_nearby
def find_resolved_motion(
    begins: Callable[..., RodStart], problem: tuple[float, ...], times: tuple[float, ...]
) -> ResolvedMotion:
    """The motion with as many polynomials as it needs.

    Their number is the first of `POLYNOMIAL_COUNTS` at which no position changes by more than
    `POSITION_TOLERANCE`.
    """
    before: Array | None = None
    (rod, start), t = begins(*problem), np.array(times)
    steps = (t[-1] - t[0]) / longest_step(rod)
    if steps > MAX_TIME_STEPS:
        raise ValueError(
            f"the rod is too stiff to be followed so long: {steps:.1g} steps in time; at most "
            f"{MAX_TIME_STEPS:g} are possible"
        )
    for count in POLYNOMIAL_COUNTS:
        found = motion_curves(rod, t, *start(count))
        places = np.stack([found[f"{at}_{axis}"] for at in ("middle", "tip") for axis in "xy"])
        if before is not None:
            change = float(np.abs(places - before).max()) / rod.length
            if change < POSITION_TOLERANCE:
                return ResolvedMotion((problem, times), count, found)
        before = places
    raise ValueError(
        f"the motion of the rod is not resolved: positions change by {change:.1g} of its length "
        f"from {POLYNOMIAL_COUNTS[-2]} to {POLYNOMIAL_COUNTS[-1]} polynomials; take a stiffer "
        "rod, or end sooner"
    )
