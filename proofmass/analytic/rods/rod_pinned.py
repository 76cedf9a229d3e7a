"""A rod from a clamp to a pin at a given position: its force and moment by shooting.

A first guess of the force and the moment determines which equilibrium Newton's method finds.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic import newton_raphson
from proofmass.analytic.chart import Chart, ChartLine, ChartRegion, Field, Panel
from proofmass.analytic.newton_raphson import NewtonLog, System
from proofmass.analytic.numerics import TURN, check_finite, check_number, check_positive
from proofmass.analytic.protocol import (
    Angle,
    BendingStiffness,
    ClosedForm,
    Domain,
    GuessedForce,
    GuessedMoment,
    Length,
    Position,
    Quantity,
)
from proofmass.analytic.remember import reuse_nearby
from proofmass.analytic.rods.elastica import (
    arc_lengths,
    bounds_in_range,
    check_section_stiffnesses,
    check_stiffness,
    modulus,
    of_load,
    tip,
)
from proofmass.analytic.rods.equilibrium import integrate_to_tip, solve_linear
from proofmass.analytic.rods.shooting import ShotRods, integrate
from proofmass.base.arrays import Array

NAMES = ("n_x", "n_y", "m_0")
"""Names of the unknowns of shooting."""
NODES, NODES_PER_RADIAN = 81, 4.0
"""Number of nodes of a rod, and least number for each unit of L sqrt(R/EI) of one with more load.

The error of the eighth order is then that of rounding.
"""


@dataclass(frozen=True)
class ShootingResult:
    """The last iterate of Newton's method, and all iterates before it.

    Attributes
    ----------
    rod : ShotRods
        The rod of the last iterate.
    residual : float
        Largest of the errors of its tip in x and y over L, and the moment at its tip over EI/L [1].
    converged : bool
        Whether the residual is within the tolerance.
    log : NewtonLog
        All iterates (n_x, n_y, m0) [N, N m] from the guess on, and f and its Jacobian at each
        one before the last.
    """

    rod: ShotRods
    residual: float
    converged: bool
    log: NewtonLog

    @property
    def unknowns(self) -> Array:
        """The last iterate, (n_x, n_y, m0) [N, N m]."""
        return self.log.root

    @property
    def iterations(self) -> int:
        """Number of steps."""
        return self.log.iterations


def pinned(
    x: float,
    y: float,
    guess: ArrayLike,
    *,
    theta0: float = 0.0,
    length: float = 1.0,
    stiffness: float = 1.0,
    weight_x: float = 0.0,
    weight_y: float = 0.0,
    axial: float = np.inf,
    shear: float = np.inf,
    nodes: int = NODES,
    scheme: str = "dop853",
    exact: bool = True,
    tolerance: float = 1e-12,
) -> ShootingResult:
    r"""Force and clamp moment that bring the moment-free tip of a rod to (x, y).

    ::

        f(n_x, n_y, m0) = [x(L) - x, y(L) - y, m(L)] = 0

    by Newton's method.  A step is halved as long as it would increase the largest |f| [m, N m].
    The guess determines which of the many equilibria is found.

    Parameters
    ----------
    x, y : the pin, from the clamp [m]
    guess : first (n_x, n_y, m0) [N, N m]
    theta0, length, stiffness : clamp's tangent [rad], L [m], EI [N m^2]
    weight_x, weight_y, axial, shear : of `integrate` [N/m, N/m, N, N]
    nodes, scheme : of `integrate`
    exact : whether the Jacobian is that of the variational equations; otherwise it is computed by
        forward differences as in the source
    tolerance : largest |f| of a root, over L and EI/L [1]

    Raises
    ------
    ValueError
        A pin as far away as the length of a rod that does not stretch, or farther; or a parameter
        out of its domain.

    Notes
    -----
    Source: Pérez Gámiz 2018, sec. 11.4.1 and annex II lines 1616-1957: RK4 with 61 nodes, forward
    differences of 1e-10, tolerance 1e-7.  Steps below 1e-3 of the tolerance are not halved, and the
    iteration ends when |f| no longer changes.  The source calls the problem both direct (line 370)
    and inverse (annex).

    Examples
    --------
    >>> found = pinned(0.8, 0.1, (0.1, 0.1, 0.1), stiffness=0.16493361431, nodes=121)
    >>> found.unknowns.round(6).tolist(), found.converged
    ([-3.230877, -1.163408, -0.607639], True)
    """
    check_positive(length=length)
    check_stiffness(stiffness)
    check_section_stiffnesses(axial, shear)
    check_number(x=x, y=y, theta0=theta0)
    check_finite(guess=guess)
    if np.shape(guess) != (3,):
        raise ValueError(f"guess must be n_x, n_y and m0, (3,), got an array {np.shape(guess)}")
    if np.isinf(axial) and np.isinf(shear) and not np.hypot(x, y) < length:
        raise ValueError(
            f"length must reach beyond the pin, {np.hypot(x, y):.6g} m away, got {length}"
        )
    shoot = partial(
        integrate,
        theta0=theta0,
        length=length,
        stiffness=stiffness,
        weight_x=weight_x,
        weight_y=weight_y,
        axial=axial,
        shear=shear,
        nodes=nodes,
        scheme=scheme,
    )
    target = np.array([x, y, 0.0])

    @lru_cache(1)  # the Jacobian of the next step is needed at the end of the last one
    def shot(*unknowns: float) -> ShotRods:
        return shoot(*unknowns, slopes=exact)

    def miss(unknowns: Array) -> Array:
        rod = shot(*unknowns.tolist())
        return np.array([rod.x[-1], rod.y[-1], rod.m[-1]]) - target

    def system(unknowns: Array) -> tuple[Array, Array]:
        return miss(unknowns), shot(*unknowns.tolist()).slope[-1][[2, 3, 1], :3]

    force, moment = stiffness / length**2, stiffness / length
    sizes, units = np.array([length, length, moment]), np.array([force, force, moment])
    jacobians = system if exact else forward_differences(miss)
    with np.errstate(over="ignore", invalid="ignore"):  # of a guess that leads nowhere
        log, size = newton(miss, jacobians, guess, tolerance, sizes, units)
        return ShootingResult(shot(*log.root.tolist()), size, size <= tolerance, log)


def forward_differences(miss: Callable[[Array], Array], step: float = 1e-10) -> System:
    """A function that returns the residual and its Jacobian by forward differences."""

    def system(x: Array) -> tuple[Array, Array]:
        f = miss(x)
        return f, np.column_stack([(miss(x + step * unit) - f) / step for unit in np.eye(x.size)])

    return system


def newton(
    miss: Callable[[Array], Array],
    system: System,
    guess: ArrayLike,
    tolerance: float,
    sizes: Array | float = 1.0,
    units: Array | float = 1.0,
    max_iterations: int = 200,
) -> tuple[NewtonLog, float]:
    """The source's iteration: its log, and the largest residual over its size at the last iterate.

    The iteration ends at a residual within the tolerance or without change, both over the `sizes`,
    and at a singular Jacobian.  Steps over their `units` below 1e-3 of it are not halved.
    """
    iterates = [np.array(guess, float)]
    values, jacobians = list[Array](), list[Array]()
    f, jacobian = system(iterates[0])
    error = float(np.abs(f / sizes).max())
    while len(values) < max_iterations and error > tolerance and np.isfinite(error):
        x = iterates[-1]
        step = solve_linear(jacobian[None], f[None])[0]
        if not np.isfinite(step).all():
            break
        new = miss(x - step)
        while not np.abs(new).max() <= np.abs(f).max() and (
            np.abs(step / units).max() > 1e-3 * tolerance
        ):
            step = 0.5 * step
            new = miss(x - step)
        iterates.append(x - step)
        values.append(f)
        jacobians.append(jacobian)
        new_error = float(np.abs(new / sizes).max())
        is_unchanged, error = abs(new_error - error) <= tolerance, new_error
        if is_unchanged:
            break
        f, jacobian = system(iterates[-1])
    kept = np.reshape(values, (-1, f.size)), np.reshape(jacobians, (-1, *jacobian.shape))
    return NewtonLog(np.array(iterates), *kept, NAMES), error


def solve(
    s: ArrayLike,
    *,
    pin_x: float,
    pin_y: float,
    force_x: float,
    force_y: float,
    moment: float,
    length: float = 1.0,
    stiffness: float = 1.0,
    theta0: float = 0.0,
    weight_x: float = 0.0,
    weight_y: float = 0.0,
    axial: float = np.inf,
    shear: float = np.inf,
) -> dict[str, Array]:
    r"""Shape of a rod clamped at the origin with its tip on a fixed pin, at arc lengths `s`.

    ::

        | __                          EI theta' = m,    m(L) = 0
        |=  `-._      .-o pin         m' = n_x sin(theta) - n_y cos(theta)
        |       `-..-'

    A rod with weight, or with strains of its sections, obeys the equations of
    `proofmass.analytic.rods.cantilever.solve`.  A rod that stretches may be straight between its
    supports, or taut.

    Parameters
    ----------
    s : [m], in [0, length]  (...)
    pin_x, pin_y : from the clamp [m]
    force_x, force_y : first guess of the pin's force on the tip [N]; together with `moment` it
        selects one of the equilibria
    moment : first guess of the moment at the clamp [N m]
    length, stiffness, theta0 : L [m], EI [N m^2], tangent at the clamp [rad]
    weight_x, weight_y : dead load per length of rod [N/m]
    axial, shear : EA, and GA with the section's area of shear [N]; infinite: without that strain

    Returns
    -------
    dict of (...) arrays: x, y [m], theta [rad], m [N m]; force_x, force_y [N] of the pin on the
    tip; and hold [N m], the moment on the clamp that keeps it at rest.

    Raises
    ------
    ValueError
        A parameter out of its domain, a pin out of reach, or a guess from which Newton's method
        finds no equilibrium.

    Notes
    -----
    The error is below 1e-10 L for rods of few half waves.  Source: Pérez Gámiz 2018, sec. 11.4.1
    and annex II lines 1616-1957, which prints no results.

    Examples
    --------
    >>> tip = solve(1.0, pin_x=0.8, pin_y=0.1, force_x=-20.0, force_y=-7.0, moment=-3.7)
    >>> [round(float(tip[name]), 6) for name in ("x", "y", "theta")]
    [0.8, 0.1, 1.254165]
    """
    check_number(pin_x=pin_x, pin_y=pin_y, force_x=force_x, force_y=force_y, moment=moment)
    check_number(theta0=theta0, weight_x=weight_x, weight_y=weight_y)
    check_positive(length=length)
    check_stiffness(stiffness)
    check_section_stiffnesses(axial, shear)
    arc = arc_lengths(s, length)
    arguments: dict[str, Any] = {
        "weight_x": weight_x,
        "weight_y": weight_y,
        "length": length,
        "stiffness": stiffness,
        "axial": axial,
        "shear": shear,
        "theta0": theta0,
    }
    near = find_unknowns(pin_x, pin_y, (force_x, force_y, moment), tuple(arguments.items()))
    load = abs(complex(*near[:2])) + abs(complex(weight_x, weight_y)) * length
    count = max(NODES, 1 + int(np.ceil(NODES_PER_RADIAN * length * np.sqrt(load / stiffness))))
    found = equilibrium_from(pin_x, pin_y, near, **arguments, nodes=count)
    n = complex(*found.unknowns[:2])
    if weight_x or weight_y or np.isfinite(axial) or np.isfinite(shear):
        nodes = np.unique(np.append(found.rod.s, arc))
        rod = integrate(*found.unknowns, **arguments, nodes=nodes)
        indices = np.searchsorted(nodes, arc)
        x, y, theta, m = (curve[indices] for curve in (rod.x, rod.y, rod.theta, rod.m))
    else:
        place, theta = (
            part[0] for part in integrate_to_tip(theta0, found.unknowns[2], n, arc, stiffness)
        )
        x, y, m = place.real, place.imag, found.unknowns[2] + (np.conj(n) * place).imag
    return {
        "x": x,
        "y": y,
        "theta": theta,
        "m": m,
        "force_x": np.full(arc.shape, n.real),
        "force_y": np.full(arc.shape, n.imag),
        "hold": np.full(arc.shape, -found.unknowns[2]),
    }


@reuse_nearby
def find_unknowns(
    pin_x: float, pin_y: float, guess: tuple[float, ...], arguments: tuple[tuple[str, Any], ...]
) -> tuple[float, ...]:
    """The force and the moment (n_x, n_y, m0) [N, N m] that Newton's method finds from a guess.

    `reuse_nearby` gives the same result for problems that differ by less than 1e-5, and Newton's
    method continues from it for each of them.  Sensitivities need many such problems.
    """
    return tuple(equilibrium_from(pin_x, pin_y, guess, **dict(arguments)).unknowns.tolist())


def equilibrium_from(x: float, y: float, guess: ArrayLike, **arguments: Any) -> ShootingResult:
    """The converged result of `pinned`; ValueError if Newton's method does not converge."""
    found = pinned(x, y, guess, **arguments)
    if not found.converged:
        given = ", ".join(f"{value:g}" for value in np.asarray(guess, float))
        raise ValueError(
            f"force_x, force_y, moment = {given} lead to no equilibrium; give a nearer guess"
        )
    return found


SOURCE_ARGUMENTS: dict[str, Any] = {"nodes": 61, "scheme": "rk4", "exact": False, "tolerance": 1e-7}
"""Arguments of `pinned` for shooting as in annex II of Pérez Gámiz 2018."""


def shooting_course(
    *,
    pin_x: float,
    pin_y: float,
    force_x: float,
    force_y: float,
    moment: float,
    length: float = 1.0,
    stiffness: float = 1.0,
    theta0: float = 0.0,
) -> Chart:
    """Force and clamp moment over the iterations of shooting, from the first guess on.

    Parameters
    ----------
    pin_x, pin_y, force_x, force_y, moment : of `solve` [m, N, N m]
    length, stiffness, theta0 : of `solve` [m, N m^2, rad]

    Returns
    -------
    Chart
        A panel for each unknown, a line for each method of shooting.

    Raises
    ------
    ValueError
        As `solve`.

    Notes
    -----
    Source: Pérez Gámiz 2018, annex II lines 1725-1745, three plots without numbers.

    Examples
    --------
    >>> chart = shooting_course(pin_x=0.8, pin_y=0.1, force_x=-20.0, force_y=-7.0, moment=-3.7)
    >>> [panel.title for panel in chart.panels]
    ['n_x [N]', 'n_y [N]', 'm_0 [N m]']
    """
    logs = shooting_logs(pin_x, pin_y, (force_x, force_y, moment), theta0, length, stiffness)
    return Chart(
        ("iteration", ""),
        ("value", ""),
        tuple(
            Panel(
                tuple(
                    ChartLine(np.arange(log.iterations + 1.0), log.iterates[:, k], label)
                    for label, log in logs.items()
                ),
                title=f"{name} [{unit}]",
            )
            for k, (name, unit) in enumerate(zip(NAMES, ("N", "N", "N m"), strict=True))
        ),
        "Force of the pin on the tip and moment at the clamp from the first guess on. A step is "
        "halved as long as it would increase the largest residual. The document's way is "
        "Runge-Kutta's method with 61 nodes and forward differences.",
    )


def shooting_convergence(
    *,
    pin_x: float,
    pin_y: float,
    force_x: float,
    force_y: float,
    moment: float,
    length: float = 1.0,
    stiffness: float = 1.0,
    theta0: float = 0.0,
) -> Chart:
    """Steps and residuals over the iterations of shooting.

    Parameters
    ----------
    pin_x, pin_y, force_x, force_y, moment : of `solve` [m, N, N m]
    length, stiffness, theta0 : of `solve` [m, N m^2, rad]

    Returns
    -------
    Chart
        A panel for each method of shooting.

    Raises
    ------
    ValueError
        As `solve`.

    Examples
    --------
    >>> chart = shooting_convergence(
    ...     pin_x=0.8, pin_y=0.1, force_x=-20.0, force_y=-7.0, moment=-3.7
    ... )
    >>> [panel.title for panel in chart.panels]
    ['exact Jacobian: 3 iterations', "the document's way: 2 iterations"]
    """
    logs = shooting_logs(pin_x, pin_y, (force_x, force_y, moment), theta0, length, stiffness)
    return newton_raphson.convergence_chart(
        {f"{label}: {log.iterations} iterations": log for label, log in logs.items()},
        "Size of the step of each unknown, of the whole step, and of the residual before the step. "
        "Near the root each step is about the square of the one before: its exponent doubles.",
    )


def shooting_logs(
    x: float, y: float, guess: ArrayLike, theta0: float, length: float, stiffness: float
) -> dict[str, NewtonLog]:
    """Logs of shooting with an exact Jacobian and as in the source, by their labels."""
    methods = {"exact Jacobian": dict[str, Any](), "the document's way": SOURCE_ARGUMENTS}
    logs = dict[str, NewtonLog]()
    for label, arguments in methods.items():
        found = pinned(x, y, guess, theta0=theta0, length=length, stiffness=stiffness, **arguments)
        if not found.converged:
            raise ValueError(
                f"{label}: force_x, force_y, moment lead to no equilibrium; give a nearer guess"
            )
        logs[label] = found.log
    return logs


DRAWN_MODULI = (0.25, 0.5, 0.75)
"""Relative moduli of the lines of a chart."""
MAX_INFLECTIONS = 3
"""Largest number of inflections that charts show."""
MODULUS_MARGIN = 1e-4
"""Least distance of a relative modulus from 0, where the rod has no moment at its clamp, and 1."""
MAX_LOAD = 1e3
"""Largest load [EI/L^2] that charts show, since the load has no bound at k_rel = +-1."""
MODULUS_BISECTIONS = 60
"""Bisections of an interval that contains a relative modulus with a given load."""


def moduli(
    *,
    pin_x: float,
    pin_y: float,
    force_x: float,
    force_y: float,
    moment: float,
    length: float = 1.0,
    stiffness: float = 1.0,
    theta0: float = 0.0,
) -> Chart:
    r"""Chart of the moduli k that exist for each direction of the load, and the rod's own.

    ::

        k_min = |cos(psi/2)|,  k_rel = sign(k) (|k| - k_min)/(1 - k_min)

    Parameters
    ----------
    pin_x, pin_y, force_x, force_y, moment : of `solve` [m, N, N m]
    length, stiffness, theta0 : of `solve` [m, N m^2, rad]

    Returns
    -------
    Chart
        Two panels over psi [rad]: k, and k_rel.

    Raises
    ------
    ValueError
        As `solve`; a rod without an inflection.

    Notes
    -----
    Source: Pérez Gámiz 2018, figure 8; its line 451 swaps the valid and the invalid moduli.

    Examples
    --------
    >>> chart = moduli(pin_x=0.8, pin_y=0.1, force_x=-20.0, force_y=-7.0, moment=-3.7)
    >>> [len(panel.regions) for panel in chart.panels]
    [2, 2]
    """
    psi = np.linspace(0.0, TURN, 361)
    least = bounds_in_range(psi)[0]
    own = find_load_parameters(pin_x, pin_y, (force_x, force_y, moment), theta0, length, stiffness)
    label = "there is a rod"
    inner = psi[1:-1]
    lines, level = [], []
    for share in DRAWN_MODULI:
        for sign in (1, -1):
            k, _ = modulus(inner, np.full(inner.shape, sign * share))
            lines.append(ChartLine(inner, k, f"k_rel = ±{share:g}"))
            level.append(
                ChartLine(inner, np.full(inner.shape, sign * share), f"k_rel = ±{share:g}")
            )
    own_psi = np.array([own[0]])
    panels = (
        Panel(
            (
                *lines,
                ChartLine(own_psi, np.array([modulus(own[0], own[1])[0]]), "this rod", points=True),
            ),
            title="k: none below |cos(psi/2)|",
            regions=tuple(
                ChartRegion(
                    (
                        np.stack(
                            [np.append(psi, psi[::-1]), sign * np.append(least, np.ones(psi.size))],
                            axis=1,
                        ),
                    ),
                    label,
                )
                for sign in (1.0, -1.0)
            ),
        ),
        Panel(
            (*level, ChartLine(own_psi, np.array([own[1]]), "this rod", points=True)),
            title="k_rel: all of (-1, 0) and (0, 1)",
            regions=tuple(
                ChartRegion(
                    (np.array([[0.0, 0.0], [TURN, 0.0], [TURN, sign], [0.0, sign]]),), label
                )
                for sign in (1.0, -1.0)
            ),
        ),
    )
    return Chart(
        ("direction psi of the load", "rad"),
        ("k, k_rel", ""),
        panels,
        "A rod that is clamped and ends in a moment-free tip is a piece of an elastica of modulus "
        "k, positive where it bends to the left at the clamp. For a load in the direction psi from "
        f"the clamp's tangent |k| is at least |cos(psi/2)|. This rod: psi = "
        f"{np.degrees(own[0]):.4g}°, k_rel = {own[1]:.4g}, {own[2]:g} inflections.",
    )


def loads(
    *,
    pin_x: float,
    pin_y: float,
    force_x: float,
    force_y: float,
    moment: float,
    length: float = 1.0,
    stiffness: float = 1.0,
    theta0: float = 0.0,
    nodes: int = 121,
) -> Chart:
    """Chart of the load R over its direction psi and k_rel, for each number of inflections.

    Parameters
    ----------
    pin_x, pin_y, force_x, force_y, moment : of `solve` [m, N, N m]
    length, stiffness, theta0 : of `solve` [m, N m^2, rad]
    nodes : along each axis, 5 to 401

    Returns
    -------
    Chart
        A panel for each number of inflections: log10 of R L^2/EI.

    Raises
    ------
    ValueError
        As `solve`; a rod without an inflection; nodes out of their range.

    Notes
    -----
    Source: Pérez Gámiz 2018, figure 9, a surface without numbers.

    Examples
    --------
    >>> chart = loads(pin_x=0.8, pin_y=0.1, force_x=-20.0, force_y=-7.0, moment=-3.7, nodes=5)
    >>> [panel.title for panel in chart.panels]
    ['1 inflection, the tip', '2 inflections', '3 inflections']
    """
    if not 5 <= nodes <= 401:
        raise ValueError(f"nodes must lie within [5, 401], got {nodes}")
    own = find_load_parameters(pin_x, pin_y, (force_x, force_y, moment), theta0, length, stiffness)
    psi = np.linspace(0.0, TURN, nodes + 2)[1:-1]
    k_rel = keep_from_ends(np.linspace(-1.0, 1.0, 2 * nodes))
    lines = np.insert(k_rel, nodes, 0.0)  # NaN at k_rel = 0 divides the surface
    panels = []
    for mode in range(1, MAX_INFLECTIONS + 1):
        log = np.log10(np.clip(tip(psi[:, None], k_rel, mode)["R"], 1.0 / MAX_LOAD, MAX_LOAD))
        found = (
            (ChartLine(np.array([own[0]]), np.array([own[1]]), "this rod", points=True),)
            if own[2] == mode
            else ()
        )
        panels.append(
            Panel(
                found,
                Field(psi, lines, np.insert(log, nodes, np.nan, axis=1), "log10(R L²/EI)", ""),
                format_inflections(mode),
            )
        )
    return Chart(
        ("direction psi of the load", "rad"),
        ("k_rel", ""),
        tuple(panels),
        "One load R for each direction psi and relative modulus k_rel, but several moduli for one "
        "load. R has no bound at k_rel = ±1; at k_rel = 0 the clamp carries no moment, and the "
        "surface of one number of inflections goes on in that of the next with the other sign.",
    )


def loads_of_direction(
    *,
    pin_x: float,
    pin_y: float,
    force_x: float,
    force_y: float,
    moment: float,
    length: float = 1.0,
    stiffness: float = 1.0,
    theta0: float = 0.0,
) -> Chart:
    """Chart of the load R over k_rel in the rod's own direction, with all rods of its load.

    Parameters
    ----------
    pin_x, pin_y, force_x, force_y, moment : of `solve` [m, N, N m]
    length, stiffness, theta0 : of `solve` [m, N m^2, rad]

    Returns
    -------
    Chart
        A line for each number of inflections, and the rods of this load.

    Raises
    ------
    ValueError
        As `solve`; a rod without an inflection.

    Notes
    -----
    Rods of the load are found between neighbours of 1200 moduli, by bisection to the last digit.
    Source: Pérez Gámiz 2018, figure 10.

    Examples
    --------
    >>> chart = loads_of_direction(pin_x=0.8, pin_y=0.1, force_x=-20.0, force_y=-7.0, moment=-3.7)
    >>> chart.caption.split(":")[0]
    '3 rods with up to 3 inflections carry this load in this direction'
    """
    psi, k, mode = find_load_parameters(
        pin_x, pin_y, (force_x, force_y, moment), theta0, length, stiffness
    )
    own = float(tip(psi, k, mode)["R"])
    k_rel = keep_from_ends(np.linspace(-1.0, 1.0, 1200))
    lines, same = [], []
    for number in range(1, MAX_INFLECTIONS + 1):
        R = tip(psi, k_rel, number)["R"]
        seen = np.where(4.0 * own > R, R, np.nan)
        lines.append(
            ChartLine(
                np.insert(k_rel, 600, 0.0), np.insert(seen, 600, np.nan), format_inflections(number)
            )
        )
        same.append(rods_of_load(psi, k_rel, R, number, own))
    found = np.concatenate(same)
    every = ChartLine(found, np.full(found.size, own), "rods of this load", False, points=True)
    this = ChartLine(np.array([k]), np.array([own]), "this rod", points=True)
    return Chart(
        ("k_rel", ""),
        ("R L²/EI", ""),
        (Panel((*lines, every, this), title=f"psi = {np.degrees(psi):.4g}°"),),
        f"{found.size} rods with up to {MAX_INFLECTIONS} inflections carry this load in this "
        f"direction: R = {own:.5g} EI/L². A load has several relative moduli k_rel, a modulus "
        "one load of each number of inflections.",
    )


def find_load_parameters(
    x: float, y: float, guess: ArrayLike, theta0: float, length: float, stiffness: float
) -> tuple[float, float, float]:
    """psi [rad], k_rel [1] and number of inflections of the rod that is found from a guess."""
    found = equilibrium_from(x, y, guess, theta0=theta0, length=length, stiffness=stiffness)
    psi, k_rel, mode = of_load(*found.unknowns, theta0=theta0, length=length, stiffness=stiffness)
    return float(psi), float(k_rel), float(mode)


def keep_from_ends(k_rel: Array) -> Array:
    """Relative moduli, moved away from 0 and from +-1 by `MODULUS_MARGIN` if they are nearer."""
    away = np.clip(np.abs(k_rel), MODULUS_MARGIN, 1.0 - MODULUS_MARGIN)
    return np.asarray(np.where(k_rel < 0.0, -away, away))


def rods_of_load(psi: float, k_rel: Array, size: Array, mode: int, load: float) -> Array:
    """Relative moduli at which R is equal to a load [EI/L^2], between given ones of one sign."""
    over = size > load
    at = np.flatnonzero((over[:-1] != over[1:]) & (k_rel[:-1] * k_rel[1:] > 0.0))
    low, high, before = k_rel[at], k_rel[at + 1], over[at]
    for _ in range(MODULUS_BISECTIONS if at.size else 0):
        middle = 0.5 * (low + high)
        above = tip(psi, middle, mode)["R"] > load
        same = above == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.asarray(low)


def format_inflections(mode: int) -> str:
    """A label with the number of inflections."""
    return "1 inflection, the tip" if mode == 1 else f"{mode} inflections"


class PinnedRod(ClosedForm, function=solve):
    """A rod from a clamp to a pin at a given position: its force and moment by shooting."""

    method = "solver of a rod between a clamp and a pin, by shooting"
    charts = (
        loads,
        loads_of_direction,
        moduli,
        shooting_convergence,
        shooting_course,
    )

    pin_x: Position
    pin_y: Position
    force_x: GuessedForce
    force_y: GuessedForce
    moment: GuessedMoment
    length: Length
    stiffness: BendingStiffness
    theta0: Angle
    weight_x: Annotated[float, Quantity("N/m")]
    weight_y: Annotated[float, Quantity("N/m")]
    axial: Annotated[float, Quantity("N", Domain.POSITIVE_OR_INF)]
    shear: Annotated[float, Quantity("N", Domain.POSITIVE_OR_INF)]
