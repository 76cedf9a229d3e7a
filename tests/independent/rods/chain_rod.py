r"""Equilibria of one chain: clamped and free under dead loads, or clamped with its tip pinned.

::

    \\|                          M                \\|
    \\|----o----o----o----o----) --> F            \\|----o----o
    \\|        | | | | line                       \\|          o----o  pin (x, y)
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from proofmass.base.arrays import Array
from tests.independent.rods.chain import (
    Chain,
    carried_forces,
    energy,
    gradient,
    hessian,
    points,
    root_moment,
    tip_slopes,
)
from tests.independent.rods.chain_matrix import Bordered
from tests.independent.rods.chain_newton import follow_in_steps, newton
from tests.independent.rods.stability import curvatures

Shape = ArrayLike | Callable[[Array], Array]
ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ChainEquilibria:
    """Equilibria of a chain; NaN where none was found.

    Attributes
    ----------
    angle : ndarray (..., n)
        Tangent angles of the segments [rad].
    tip : ndarray (..., 2)
        Position of the tip [m].
    force : ndarray (..., 2)
        Force on the tip [N].
    root_moment : ndarray (...)
        Moment at the clamp [N m].
    energy : ndarray (...)
        Energy of the springs [J].
    curvatures : ndarray (..., n) or (..., n - 2)
        Curvatures of the potential along the motions that the tip allows [N m], the lowest one
        first; the equilibrium is unstable if it is negative.
    """

    angle: Array
    tip: Array
    force: Array
    root_moment: Array
    energy: Array
    curvatures: Array


def seed_angles(c: Chain, shape: Shape) -> Array:
    """Angles (..., n) of a shape, from angles or from ``theta(s)`` of the continuous rod."""
    angle = check_numbers("seed", shape(c.station) if callable(shape) else shape)
    if angle.shape[-1:] != (c.segments,):
        raise ValueError(f"seed must be angles (..., {c.segments}), got {angle.shape}")
    return angle


def check_vector(name: str, value: ArrayLike, size: int) -> Array:
    """An array (..., size) of finite numbers, or a ValueError that names it."""
    out = np.asarray(value, float)
    if out.shape[-1:] != (size,) or not np.isfinite(out).all():
        raise ValueError(f"{name} must be {size} finite numbers, got {value!r}")
    return out


def check_numbers(name: str, value: ArrayLike) -> Array:
    """An array (...) of finite numbers, or a ValueError that names it."""
    out = np.asarray(value, float)
    if not np.isfinite(out).all():
        raise ValueError(f"{name} must be finite, got {value!r}")
    return out


def free(
    c: Chain,
    clamp: ArrayLike = ORIGIN,
    *,
    force: ArrayLike = (0.0, 0.0),
    moment: ArrayLike = 0.0,
    line: ArrayLike = (0.0, 0.0),
    seed: Shape | None = None,
) -> ChainEquilibria:
    r"""Equilibrium of a clamped chain under dead loads.

    Parameters
    ----------
    c : Chain
    clamp : x0, y0 [m] and tangent angle theta0 [rad] (..., 3)
    force, moment : on the tip, F [N] (..., 2) and M [N m] (...)
    line : dead load on the chain's length [N/m] (..., 2)
    seed : angles (..., n) [rad], or theta(s) of the continuous rod, to start Newton's method from;
        without a seed the loads on the straight chain grow in steps

    Returns
    -------
    `ChainEquilibria`

    Raises
    ------
    ValueError
        A load, a clamp or a seed that is not finite.

    Notes
    -----
    The equilibrium is exact for the chain, to rounding.  Of several equilibria it is the one near
    the seed, or without a seed the one on the branch of the unloaded chain.  A straight chain under
    a load along it stays straight, stable or not.

    Examples
    --------
    An end moment of 2 pi EI/L closes every chain to a polygon.

    >>> from tests.independent.rods.chain import chain
    >>> bool(np.allclose(free(chain(8), moment=2 * np.pi).tip, 0.0))
    True
    """
    place = check_vector("clamp", clamp, 3)
    loads = (
        check_vector("force", force, 2),
        check_vector("line", line, 2),
        check_numbers("moment", moment),
    )
    batch = np.broadcast_shapes(
        place.shape[:-1],
        loads[2].shape,
        c.spring.shape[:-1],
        *(load.shape[:-1] for load in loads[:2]),
    )

    def equilibrium(part: float, start: Array) -> Array:
        pull, end = carried_forces(c, part * loads[0], part * loads[1]), part * loads[2]
        return newton(
            lambda angle: (
                gradient(c, place, angle, pull, end),
                matrix(c, angle, pull, is_pinned=False),
            ),
            start,
            c.segments,
        )

    straight = np.broadcast_to(place[..., 2:], (*batch, c.segments))
    if seed is None:
        angle = follow_in_steps(equilibrium, straight, c.segments)
    else:
        angle = equilibrium(1.0, np.broadcast_to(seed_angles(c, seed), straight.shape))
    pull = carried_forces(c, loads[0], loads[1])
    return chain_equilibria(c, place, angle, pull, loads[0], loads[2], is_pinned=False)


def pinned(
    c: Chain,
    clamp: ArrayLike,
    tip: ArrayLike,
    *,
    seed: Shape,
    moment: ArrayLike = 0.0,
    line: ArrayLike = (0.0, 0.0),
) -> ChainEquilibria:
    r"""Equilibrium of a clamped chain whose tip is pinned.

    The force on the tip is the multiplier of the tip's position.  It is also the slope of the
    energy, dU = F . dp, along equilibria.

    Parameters
    ----------
    c : Chain
    clamp : x0, y0 [m] and tangent angle theta0 [rad] (..., 3)
    tip : position of the pin [m] (..., 2)
    seed : angles (..., n) [rad], or theta(s) of the continuous rod; it determines the branch
    moment : on the tip [N m] (...)
    line : dead load on the chain's length [N/m] (..., 2)

    Returns
    -------
    `ChainEquilibria`, with the curvatures for a pinned tip

    Raises
    ------
    ValueError
        A pin that the chain does not reach, or reaches only when it is straight.

    Notes
    -----
    Pérez Gámiz 2018, annex II.1 (line 1616), has this problem for the continuous rod; it has many
    equilibria.

    Examples
    --------
    >>> from tests.independent.rods.chain import chain
    >>> half_wave = pinned(chain(20), (0, 0, 0), (0.8, 0.1), seed=lambda s: 1.2 * np.sin(4 * s))
    >>> half_wave.tip.round(12), bool((half_wave.curvatures > 0).all())
    (array([0.8, 0.1]), True)
    """
    place, pin, dead = (
        check_vector("clamp", clamp, 3),
        check_vector("tip", tip, 2),
        check_vector("line", line, 2),
    )
    end, start, n = check_numbers("moment", moment), seed_angles(c, seed), c.segments
    batch = np.broadcast_shapes(
        place.shape[:-1],
        pin.shape[:-1],
        dead.shape[:-1],
        end.shape,
        start.shape[:-1],
        c.spring.shape[:-1],
    )
    reach = c.length.sum(axis=-1)
    if not np.all(np.linalg.norm(pin - place[..., :2], axis=-1) < reach):
        raise ValueError(f"tip must be nearer to the clamp than the chain's {reach} m, got {tip!r}")

    def system(unknowns: Array) -> tuple[Array, Bordered]:
        angle, force = unknowns[..., :n], unknowns[..., n:]
        pull = carried_forces(c, force, dead)
        violation = points(c, place, angle)[..., -1, :] - pin
        residual = np.concatenate([gradient(c, place, angle, pull, end), -violation], axis=-1)
        return residual, matrix(c, angle, pull, is_pinned=True)

    start = np.broadcast_to(start, (*batch, n))
    push = gradient(c, place, start, carried_forces(c, np.zeros(2), dead), end)
    guess = np.linalg.pinv(np.swapaxes(tip_slopes(c, start), -1, -2)) @ push[..., None]
    found = newton(system, np.concatenate([start, guess[..., 0]], axis=-1), n)
    angle, force = found[..., :n], found[..., n:]
    return chain_equilibria(
        c, place, angle, carried_forces(c, force, dead), force, end, is_pinned=True
    )


def matrix(c: Chain, angle: Array, pull: Array, *, is_pinned: bool) -> Bordered:
    """Newton's matrix of one chain, with its tip pinned (`is_pinned`) or free."""
    slopes = np.swapaxes(tip_slopes(c, angle), -1, -2)[..., None, :, : 2 if is_pinned else 0]
    corner = np.zeros((*angle.shape[:-1], *2 * slopes.shape[-1:]))
    return Bordered(hessian(c, angle, pull)[..., None, :, :], -slopes, corner)


def chain_equilibria(
    c: Chain,
    clamp: Array,
    angle: Array,
    pull: Array,
    force: Array,
    moment: Array,
    *,
    is_pinned: bool,
) -> ChainEquilibria:
    """The equilibria that angles of segments and loads describe."""
    tip = points(c, clamp, angle)[..., -1, :]
    return ChainEquilibria(
        angle,
        tip,
        np.broadcast_to(force, tip.shape),
        root_moment(c, clamp, angle, pull, moment),
        energy(c, clamp, angle),
        curvatures(matrix(c, angle, pull, is_pinned=is_pinned).dense(), 2 if is_pinned else 0),
    )
