r"""A clamped rod in space, under dead loads: it bends to two sides, twists, stretches and shears.

::

              z                      section at s: axes d1 along its normal, d2, d3 across
              |   __                 R = [d1 d2 d3]
        ######|__/  \__  d3
        ######O        \_|_ d1       n(s), m(s): force and moment that the part beyond s
             /          \|           puts on the part before
            x            o--> F, M

The equations are those of Cosserat's theory of rods, with a hat for the matrix of a cross product::

    p' = R v              n' = -w
    R' = R u^             m' = -p' x n
    v = e1 + diag(1/EA, 1/GA, 1/GA) R^T n
    u = u0 + diag(1/GJ, 1/EI_y, 1/EI_z) R^T m

Without EA and GA they are Kirchhoff's, of a rod whose sections stay normal to it and that keeps its
length.
"""

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import TURN, check_finite, check_positive
from proofmass.analytic.protocol import (
    BendingStiffness,
    ClosedForm,
    Domain,
    Force,
    Length,
    Moment,
    Quantity,
)
from proofmass.analytic.remember import reuse_nearby
from proofmass.analytic.rods.elastica import arc_lengths, check_section_stiffnesses
from proofmass.analytic.rods.shooting import runge_kutta
from proofmass.base.arrays import Array

SpatialNumbers = tuple[
    float,
    tuple[float, float, float],
    tuple[float, float],
    *tuple[tuple[float, float, float], ...],
]
"""Arguments of `spatial_load`: L [m]; GJ, EI_y, EI_z [N m^2]; EA, GA [N]; u0 [1/m]; F, M; w."""
AXES = "x", "y", "z"
STEPS_PER_TURN = 16
"""First number of steps, of order 8, for each turn of the rod without load; it is doubled until
the tip no longer moves."""
MAX_ARC_STEPS = 4096
"""Largest number of steps along the rod."""
TIP_TOLERANCE = 1e-12
"""Largest distance [L] by which the tip may move if the number of steps is doubled."""
FIRST_LOAD_INCREMENT = 0.125
"""First increment of the loads, over the whole loads."""
MAX_EXTRAPOLATION_ERROR = 0.5
"""Largest difference [EI/L] of the moment at the clamp from its extrapolation over the loads."""
MOMENT_DIFFERENCE = 1e-7
"""Differences [EI/L] of the moment at the clamp from which derivatives are computed."""
MAX_TIP_ITERATIONS = 12
"""Largest number of steps of Newton's method from a guess."""
FINAL_TOLERANCE, TIP_ROUNDING_LIMIT, SHARE_TOLERANCE = 1e-14, 1e-11, 1e-7
"""Errors of the moment at the tip, over the sum of all moments: that of a root; that below which
iterations end as soon as the error is no longer halved, by rounding; and that of an equilibrium
under a share of the loads."""
MIN_LOAD_INCREMENT = 1e-4
"""Least increment of the loads, over the whole loads."""
STABILITY_LINKS = 32
"""Parts of the rod by which its stability is determined; each can rotate about three axes."""


@dataclass(frozen=True)
class SpatialLoad:
    """A rod and its loads, in the frame of its clamp.

    Attributes
    ----------
    length : float
        L [m].
    yields, strains : ndarray (3,)
        Compliances 1/GJ, 1/EI_y, 1/EI_z [1/(N m^2)]; 1/EA, 1/GA, 1/GA [1/N].
    natural : ndarray (3,)
        u0, twist and curvatures of the rod without load [1/m].
    force, moment, weight : ndarray (3,)
        F [N] and M [N m] on the tip, w [N/m].
    """

    length: float
    yields: Array
    strains: Array
    natural: Array
    force: Array
    moment: Array
    weight: Array

    @property
    def scale(self) -> float:
        """The moment that bends the rod by a radian [N m]."""
        return float(1.0 / (self.yields.max() * self.length))


def solve(
    s: ArrayLike,
    *,
    length: float = 1.0,
    stiffness: float = 1.0,
    stiffness_y: float | None = None,
    torsion: float = 1.0,
    axial: float = np.inf,
    shear: float = np.inf,
    twist: float = 0.0,
    curvature_y: float = 0.0,
    curvature: float = 0.0,
    force_x: float = 0.0,
    force_y: float = 0.0,
    force_z: float = 0.0,
    moment_x: float = 0.0,
    moment_y: float = 0.0,
    moment_z: float = 0.0,
    weight_x: float = 0.0,
    weight_y: float = 0.0,
    weight_z: float = 0.0,
) -> dict[str, Array]:
    r"""Shape of a clamped rod in space at arc lengths `s` from the clamp.

    The clamp is at the origin, with the axes of its section along x, y and z.  Without loads the
    rod has the given twist and curvatures: it is straight, an arc, or a helix.  Its equilibrium is
    the one that is reached when all loads grow together from zero.

    Parameters
    ----------
    s : [m], in [0, length], of the rod without load  (...)
    length : L [m]
    stiffness, stiffness_y : EI [N m^2] of bending about the section's z and y axes; `stiffness_y`
        is equal to `stiffness` if it is None
    torsion : GJ [N m^2]
    axial, shear : EA, and GA with the section's area of shear [N]; infinite: without that strain
    twist, curvature_y, curvature : u0 about the section's x, y and z axes [1/m]
    force_x, force_y, force_z : F on the tip [N]
    moment_x, moment_y, moment_z : M on the tip [N m], of constant direction like the forces
    weight_x, weight_y, weight_z : w, dead load per length of rod without load [N/m]

    Returns
    -------
    dict of (...) arrays: x, y, z [m]; normal_x, normal_y, normal_z [1], the section's normal, which
    is the tangent of a rod that does not shear; twist_moment, bend_moment_y, bend_moment [N m], m
    about the section's axes; force_x, force_y, force_z [N], n.

    Raises
    ------
    ValueError
        A parameter out of its domain, an s beyond the rod, loads under which the rod buckles or
        that cannot be followed from zero.

    Notes
    -----
    The rod is solved by shooting from the clamp, whose moment is unknown, with a Runge-Kutta method
    of order 8 and so many steps that twice as many move the tip by 1e-12 L at most.  An equilibrium
    is stable if the energy of `STABILITY_LINKS` parts of the rod has no negative direction; close
    to buckling this is not exact.  Under a force across the clamp's normal the tip is that of the
    elastica within 5e-13 L up to 100 EI/L^2, and 2e-11 L at 200 EI/L^2, where the search takes half
    a minute; a force of 250 EI/L^2 is refused.
    Source: Pérez Gámiz 2018, eq. 1-23, which prints no numbers for them; in its axes the rod lies
    along z, and its eq. 22, of a rod without shear, has a shear stiffness (docs/errata.md).
    S. S. Antman, Nonlinear Problems of Elasticity, 2nd ed., Springer 2005, ch. 8.

    Examples
    --------
    A quarter of a circle, twisted by a moment about the tangent of its tip:

    >>> tip = solve(np.pi / 2, length=np.pi / 2, curvature=1.0, moment_y=0.1)
    >>> [round(float(tip[name]), 6) for name in ("x", "y", "z", "twist_moment")]
    [0.997665, 1.0, -0.057005, 0.1]
    """
    given = (
        length,
        (torsion, stiffness if stiffness_y is None else stiffness_y, stiffness),
        (axial, shear),
        (twist, curvature_y, curvature),
        (force_x, force_y, force_z),
        (moment_x, moment_y, moment_z),
        (weight_x, weight_y, weight_z),
    )
    load = spatial_load(*given)
    arc = arc_lengths(s, length)
    place, frame, moment = sample_shape(load, arc.ravel(), *find_clamp_moment(load, given))
    force = load.force + load.weight * (length - arc.ravel())[:, None]
    local = np.einsum("kij,ki->kj", frame, moment)
    columns = {
        **dict(zip(AXES, place.T, strict=True)),
        **{f"normal_{name}": frame[:, k, 0] for k, name in enumerate(AXES)},
        "twist_moment": local[:, 0],
        "bend_moment_y": local[:, 1],
        "bend_moment": local[:, 2],
        **{f"force_{name}": force[:, k] for k, name in enumerate(AXES)},
    }
    return {name: values.reshape(arc.shape) for name, values in columns.items()}


def spatial_load(
    length: float,
    stiffnesses: tuple[float, float, float],
    strains: tuple[float, float],
    natural: tuple[float, float, float],
    *loads: tuple[float, float, float],
) -> SpatialLoad:
    """The rod and its loads; ValueError for a parameter out of its domain."""
    check_positive(length=length)
    names = "torsion", "stiffness_y", "stiffness"
    check_positive("N m^2", **dict(zip(names, stiffnesses, strict=True)))
    check_finite(**dict(zip(names, stiffnesses, strict=True)))
    check_section_stiffnesses(*strains)
    check_finite(**dict(zip(("twist", "curvature_y", "curvature"), natural, strict=True)))
    for name, values in zip(("force", "moment", "weight"), loads, strict=True):
        check_finite(**{f"{name}_{part}": value for part, value in zip(AXES, values, strict=True)})
    axial, shear = strains
    return SpatialLoad(
        length,
        1.0 / np.array(stiffnesses),
        1.0 / np.array([axial, shear, shear]),
        np.array(natural, float),
        *(np.array(values, float) for values in loads),
    )


def find_clamp_moment(load: SpatialLoad, given: SpatialNumbers) -> tuple[Array, int]:
    """The moment at the clamp (3,) [N m] after all loads have grown from zero, and the steps."""
    turns = load.length * float(np.linalg.norm(load.natural)) / TURN
    steps = STEPS_PER_TURN * (1 + int(turns))
    return resolve_clamp_moment(given, cached_clamp_moment(given, steps), steps)


@lru_cache(maxsize=64)
def resolve_clamp_moment(
    given: SpatialNumbers, guess: tuple[float, ...], steps: int
) -> tuple[Array, int]:
    """The moment at the clamp (3,) [N m] that a guess leads to, and the steps that resolve the rod.

    From about 80 EI/L^2 on several equilibria have nearly the same moment at the clamp, and a step
    of the loads may lead to another one.  It is unstable, and then the loads grow once more, by
    steps to stable equilibria only.  ValueError if there is none, or if the number of steps is too
    small at its largest.
    """
    load = spatial_load(*given)
    near = solve_from_guess(load, 1.0, np.array(guess), steps)
    near = near or solve_from_guess(load, 1.0, continue_from_zero(load, steps), steps)
    found, enough = resolve_rod(load, near, steps)
    if negative_directions(load, found, enough):
        stable = continue_from_zero(load, steps, is_stable=True)
        found, enough = resolve_rod(load, solve_from_guess(load, 1.0, stable, steps), steps)
        if negative_directions(load, found, enough):
            raise ValueError(
                "no stable equilibrium of the rod is found under its whole loads: they are too "
                "large for the search"
            )
    return found, enough


def resolve_rod(
    load: SpatialLoad, near: tuple[Array, Array] | None, steps: int
) -> tuple[Array, int]:
    """The moment at the clamp (3,) [N m], and the number of steps from which the tip is the same.

    `near` are the moment and the tip with the given number of steps.
    """
    while near and steps < MAX_ARC_STEPS:
        steps *= 2
        found, tip = near
        near = solve_from_guess(load, 1.0, found, steps)
        if near and np.abs(near[1] - tip).max() <= TIP_TOLERANCE * load.length:
            return near[0], steps
    if not near:
        raise ValueError(
            f"Newton's method finds no equilibrium of the rod with {steps} steps along it"
        )
    raise ValueError(
        f"the rod is not resolved with {MAX_ARC_STEPS} steps along it: it is bent too sharply"
    )


@reuse_nearby
def cached_clamp_moment(given: SpatialNumbers, steps: int) -> tuple[float, ...]:
    """The moment at the clamp [N m] of a rod whose loads have grown from zero.

    `reuse_nearby` gives the same result for problems that differ by less than 1e-5, and Newton's
    method continues from it for each of them.  Sensitivities need many such problems.
    """
    return tuple(continue_from_zero(spatial_load(*given), steps).tolist())


def continue_from_zero(load: SpatialLoad, steps: int, is_stable: bool = False) -> Array:
    """The moment at the clamp (3,) [N m] under the whole loads, by continuation from zero loads.

    With `is_stable` the equilibria under all shares of the loads are stable.
    """
    share, step, moment, tangent = 0.0, FIRST_LOAD_INCREMENT, np.zeros(3), np.zeros(3)
    while share < 1.0:
        step = min(step, 1.0 - share)
        guess = moment + step * tangent
        near = solve_from_guess(load, share + step, guess, steps)
        if (
            near is None
            or np.abs(near[0] - guess).max() > MAX_EXTRAPOLATION_ERROR * load.scale
            or (is_stable and negative_directions(load, near[0], steps, share + step))
        ):
            step /= 2.0
            if step < MIN_LOAD_INCREMENT:
                which, why = "", ""
                if is_stable:
                    which = "stable "
                    why = ": it buckles there, or the loads are too large for the search"
                raise ValueError(
                    f"no {which}equilibrium of the rod is found beyond {share:.3g} of its loads, "
                    f"which grow together from zero{why}"
                )
            continue
        tangent, moment, share = (near[0] - moment) / step, near[0], share + step
        step *= 2.0
    return moment


def solve_from_guess(
    load: SpatialLoad, share: float, guess: Array, steps: int
) -> tuple[Array, Array] | None:
    """The moment at the clamp (3,) [N m] under a share of the loads, and the tip (3,) [m].

    They are found by Newton's method from a guess; None if the method fails.
    """
    moment, least_error = guess, np.inf
    width = MOMENT_DIFFERENCE * load.scale
    size = load.scale + share * float(
        np.abs(load.moment).max()
        + load.length * np.abs(load.force).max()
        + load.length**2 * np.abs(load.weight).max()
    )
    for _ in range(MAX_TIP_ITERATIONS):
        starts = moment[:, None] + width * np.eye(3, 4, 1)
        with np.errstate(over="ignore", invalid="ignore"):  # an error that is not finite
            state = integrate_rods(load, share, starts, steps)[-1]
        ends = state[MOMENT]
        moment_error = ends[:, 0] - share * load.moment
        error = float(np.abs(moment_error).max())
        if not np.isfinite(error):
            return None
        tolerance = FINAL_TOLERANCE if share == 1.0 else SHARE_TOLERANCE
        if error <= tolerance * size or (
            error <= TIP_ROUNDING_LIMIT * size and error >= least_error / 2.0
        ):
            return moment, state[PLACE, 0]
        least_error = min(least_error, error)
        slopes = (ends[:, 1:] - ends[:, :1]) / width
        moment = moment - np.linalg.lstsq(slopes, moment_error, rcond=None)[0]
    return None


DIRECTIONS, PLACE, MOMENT = slice(0, 9), slice(9, 12), slice(12, 15)
"""Rows of a state: d1, d2, d3 one after the other [1]; p [m]; m [N m]."""


def integrate_rods(load: SpatialLoad, share: float, starts: Array, nodes: int | Array) -> Array:
    """States (nodes, 15, rods) of rods with the moments `starts` (3, rods) [N m] at the clamp."""
    s = np.linspace(0.0, load.length, nodes + 1) if isinstance(nodes, int) else nodes
    state = np.zeros((15, starts.shape[1]))
    state[DIRECTIONS] = np.eye(3).reshape(9, 1)
    state[MOMENT] = starts
    return runge_kutta(partial(state_derivative, load, share), state, s, "dop853")


def state_derivative(load: SpatialLoad, share: float, arc: float, state: Array, out: Array) -> None:
    """Write d/ds of the states (15, rods) at an arc length [m] into `out`."""
    axes, moment = state[DIRECTIONS].reshape(3, 3, -1), state[MOMENT]
    force = share * (load.force + load.weight * (load.length - arc))
    v = load.strains[:, None] * np.einsum("jir,i->jr", axes, force)
    v[0] += 1.0
    u = load.yields[:, None] * np.einsum("jir,ir->jr", axes, moment) + load.natural[:, None]
    d1, d2, d3 = axes
    ahead = np.einsum("jr,jir->ir", v, axes)
    out[0:3] = u[2] * d2 - u[1] * d3
    out[3:6] = u[0] * d3 - u[2] * d1
    out[6:9] = u[1] * d1 - u[0] * d2
    out[PLACE] = ahead
    out[12] = force[1] * ahead[2] - force[2] * ahead[1]
    out[13] = force[2] * ahead[0] - force[0] * ahead[2]
    out[14] = force[0] * ahead[1] - force[1] * ahead[0]


def sample_shape(
    load: SpatialLoad, arc: Array, begin: Array, steps: int, share: float = 1.0
) -> tuple[Array, Array, Array]:
    """Positions (n, 3), axes (n, 3, 3) as columns, and moments (n, 3) at arc lengths (n,)."""
    nodes = np.unique(np.concatenate([np.linspace(0.0, load.length, steps + 1), arc]))
    states = integrate_rods(load, share, begin[:, None], nodes)[np.searchsorted(nodes, arc), :, 0]
    axes = states[:, DIRECTIONS].reshape(-1, 3, 3).swapaxes(1, 2)
    return states[:, PLACE], axes, states[:, MOMENT]


def negative_directions(load: SpatialLoad, begin: Array, steps: int, share: float = 1.0) -> int:
    r"""Number of directions in which the energy of `STABILITY_LINKS` parts falls at an equilibrium.

    Between two parts there are three hinges, and slides if the rod stretches or shears, each with
    a spring.  With a the axis of a hinge, b the axis of another one beyond it at r, P the tip, and
    S the integral of the positions beyond r relative to r::

        d2V/da db = -a . ((b x (P - r)) x F + (b x S) x w)     two hinges
                    -a . (b x n)                               a hinge and a slide beyond it

    A moment of constant direction has no energy; half of its term, -M . (a x b), is added on either
    side of the diagonal.  All loads are a share of those of the rod.
    """
    h = load.length / STABILITY_LINKS
    arc = h * (np.arange(STABILITY_LINKS + 1) + 0.5)
    arc[-1] = load.length
    force, moment, weight = share * load.force, share * load.moment, share * load.weight
    place, axes, _ = sample_shape(load, np.asarray(arc, float), begin, steps, share)
    tip, place, axes = place[-1], place[:-1], axes[:-1].swapaxes(1, 2)
    ahead = h * np.cumsum(place[::-1], axis=0)[::-1] - h / 2 * place
    relative_sums = ahead - (load.length - arc[:-1, None]) * place
    hinges = axes.reshape(-1, 3)
    arms, sums = np.repeat(tip - place, 3, axis=0), np.repeat(relative_sums, 3, axis=0)
    by_hinges = np.cross(np.cross(hinges, arms), force)
    by_hinges += np.cross(np.cross(hinges, sums), weight) + np.cross(hinges, moment) / 2
    beyond = force + weight * (load.length - arc[:-1, None])
    by_slides = np.cross(axes, beyond[:, None]).reshape(-1, 3)
    joint = np.arange(3 * STABILITY_LINKS) // 3
    has_slide = np.tile(load.strains > 0.0, STABILITY_LINKS)
    columns = np.concatenate([by_hinges, by_slides[has_slide]])
    joint_of_column = np.concatenate([joint, joint[has_slide]])
    earlier = np.where(joint[:, None] <= joint_of_column, -hinges @ columns.T, 0.0)
    size = joint_of_column.size
    matrix = np.zeros((size, size))
    matrix[: 3 * STABILITY_LINKS] = earlier
    matrix = np.where(matrix == 0.0, matrix.T, matrix)
    matrix = (matrix + matrix.T) / 2
    springs = np.tile(1.0 / load.yields, STABILITY_LINKS)
    with np.errstate(divide="ignore"):
        springs = np.append(springs, np.tile(1.0 / load.strains, STABILITY_LINKS)[has_slide])
    matrix[np.diag_indices(size)] += springs / h
    return int((np.linalg.eigvalsh(matrix) < 0.0).sum())


class SpatialRod(ClosedForm, function=solve):
    """A clamped rod in space under dead loads: it bends to two sides, twists, stretches, shears."""

    method = "solver of a rod in space, by shooting"
    in_space = True

    length: Length
    stiffness: BendingStiffness
    stiffness_y: BendingStiffness
    torsion: BendingStiffness
    axial: Annotated[float, Quantity("N", Domain.POSITIVE_OR_INF)]
    shear: Annotated[float, Quantity("N", Domain.POSITIVE_OR_INF)]
    twist: Annotated[float, Quantity("1/m")]
    curvature_y: Annotated[float, Quantity("1/m")]
    curvature: Annotated[float, Quantity("1/m")]
    force_x: Force
    force_y: Force
    force_z: Force
    moment_x: Moment
    moment_y: Moment
    moment_z: Moment
    weight_x: Annotated[float, Quantity("N/m")]
    weight_y: Annotated[float, Quantity("N/m")]
    weight_z: Annotated[float, Quantity("N/m")]
