r"""A rod as engines model it: rigid segments in a row, with hinges and springs between them.

::

    half     |--o----o----o----o--        ends of h/2, springs EI/h
    double   |o----o----o----o----        the spring at the clamp 2 EI/h
    naive    |o----o----o----o----        the spring at the clamp EI/h, as the others

theta_0 is the clamp's angle and l_0 the length of the stub that is fixed to the clamp.  The
potential under dead loads is

    V = sum k_i (theta_i - theta_{i-1})^2/2 - sum l_i G_i . u(theta_i) - M theta_n

with u(theta) = (cos theta, sin theta).  G_i is the force that segment i carries at its middle: the
sum of all dead forces beyond it.  The Hessian of V is tridiagonal, and a force on the tip enters it
as a stiffness.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from proofmass.base.arrays import Array

# lengths of the stub at the clamp and of the last segment [h], spring at the clamp [EI/h]
SCHEMES = {"half": (0.5, 0.5, 1.0), "double": (0.0, 1.0, 2.0), "naive": (0.0, 1.0, 1.0)}


@dataclass(frozen=True)
class Chain:
    """Segments and springs of one rod, or of several rods with the same number of segments.

    Attributes
    ----------
    length : ndarray (..., n + 1)
        l_i [m]; the first one is the stub that is fixed to the clamp, 0 if there is none.
    spring : ndarray (..., n)
        k_i [N m/rad] of the hinge before segment i.
    station : ndarray (..., n)
        Arc length [m] at which the continuous rod has the tangent of segment i.
    """

    length: Array
    spring: Array
    station: Array

    @property
    def segments(self) -> int:
        """n, the number of segments that can rotate."""
        return int(self.spring.shape[-1])


def chain(
    segments: int,
    *,
    length: ArrayLike = 1.0,
    stiffness: ArrayLike = 1.0,
    scheme: str = "half",
    rigid_extension: ArrayLike = 0.0,
) -> Chain:
    r"""Cut a rod into `segments` cells of length h = L/n.

    Parameters
    ----------
    segments : n, at least 2
    length, stiffness : L [m] and bending stiffness EI [N m^2] (...)
    scheme : "half", "double" or "naive", as drawn above
    rigid_extension : rigid piece beyond the rod's end [m] (...)

    Returns
    -------
    Chain

    Raises
    ------
    ValueError
        Fewer than 2 segments, an unknown scheme, a length or a stiffness that is not positive, a
        negative rigid_extension.

    Notes
    -----
    The errors of "half" and "double" are of second order in h.  Those of "naive" are of first
    order, because its rod bends over half a cell more.  Under a moment at the tip the last segment
    of "double" lags by M h/(2 EI), so a rigid_extension needs "half".  Pérez Gámiz 2018 has no
    chains; the chains are compared with its continuous rods.

    Examples
    --------
    >>> chain(2).length, chain(2).spring, chain(2).station
    (array([0.25, 0.5 , 0.25]), array([2., 2.]), array([0.5, 1. ]))
    >>> chain(2, scheme="double").length, chain(2, scheme="double").spring
    (array([0. , 0.5, 0.5]), array([4., 2.]))
    """
    if scheme not in SCHEMES:
        raise ValueError(f"scheme must be one of {tuple(SCHEMES)}, got {scheme!r}")
    if segments != int(segments) or segments < 2:
        raise ValueError(f"segments must be a whole number from 2, got {segments}")
    whole, bending, beyond = np.broadcast_arrays(
        *(np.asarray(value, float)[..., None] for value in (length, stiffness, rigid_extension))
    )
    for name, value, unit in (("length", whole, "m"), ("stiffness", bending, "N m^2")):
        if not np.all((value > 0) & np.isfinite(value)):
            raise ValueError(f"{name} must be positive and finite [{unit}], got {value[..., 0]}")
    if not np.all((beyond >= 0) & np.isfinite(beyond)):
        raise ValueError(f"rigid_extension must be zero or positive [m], got {beyond[..., 0]}")
    stub, last, first = SCHEMES[scheme]
    h = whole / segments
    full = np.ones(segments - 1)
    return Chain(
        h * np.r_[stub, full, last] + beyond * np.r_[0 * full, 0.0, 1.0],
        bending / h * np.r_[first, full],
        h * (stub - 0.5 + np.arange(1, segments + 1)),
    )


def unit(angle: Array) -> Array:
    """(cos, sin) of angles (...), in a new last axis."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def normal(angle: Array) -> Array:
    """(-sin, cos) of angles (...), in a new last axis."""
    return np.stack([-np.sin(angle), np.cos(angle)], axis=-1)


def angles_with_stub(clamp: Array, angle: Array) -> Array:
    """Angles (..., n + 1) of the stub and the segments [rad]; clamp (..., 3) is x0, y0, theta0."""
    start = np.broadcast_to(clamp[..., 2:], (*angle.shape[:-1], 1))
    return np.concatenate([start, angle], axis=-1)


def points(c: Chain, clamp: Array, angle: Array) -> Array:
    """Positions of the clamp and of the ends of all segments (..., n + 2, 2) [m], up to the tip.

    >>> points(chain(2), np.zeros(3), np.array([0.0, np.pi / 2])).round(3).tolist()
    [[0.0, 0.0], [0.25, 0.0], [0.75, 0.0], [0.75, 0.25]]
    """
    offsets = np.cumsum(c.length[..., None] * unit(angles_with_stub(clamp, angle)), axis=-2)
    return clamp[..., None, :2] + np.concatenate([0 * offsets[..., :1, :], offsets], axis=-2)


def moments(c: Chain, clamp: Array, angle: Array) -> Array:
    """Moments of the springs (..., n) [N m]; with a stub the first differs from the clamp's."""
    return c.spring * np.diff(angles_with_stub(clamp, angle), axis=-1)


def energy(c: Chain, clamp: Array, angle: Array) -> Array:
    """Energy of the springs (...) [J]."""
    return np.asarray(0.5 * (moments(c, clamp, angle) ** 2 / c.spring).sum(axis=-1))


def carried_forces(c: Chain, force: Array, line: Array) -> Array:
    """G (..., n + 1, 2) [N], the forces beyond the middles of the segments.

    The force (..., 2) [N] is on the tip; the dead load `line` (..., 2) is per length [N/m].

    >>> carried_forces(chain(2), np.array([1.0, 0.0]), np.array([0.0, -4.0]))[:, 1].tolist()
    [-3.5, -2.0, -0.5]
    """
    beyond = np.cumsum(c.length[..., ::-1], axis=-1)[..., ::-1] - 0.5 * c.length
    return force[..., None, :] + line[..., None, :] * beyond[..., None]


def potential(c: Chain, clamp: Array, angle: Array, pull: Array, moment: Array) -> Array:
    """V (...) [J] with pull G (..., n + 1, 2) [N] and tip moment M (...) [N m]."""
    work = c.length[..., 1:] * (pull[..., 1:, :] * unit(angle)).sum(axis=-1)
    return np.asarray(energy(c, clamp, angle) - work.sum(axis=-1) - moment * angle[..., -1])


def gradient(c: Chain, clamp: Array, angle: Array, pull: Array, moment: Array) -> Array:
    """dV/dtheta (..., n) [N m]."""
    before = moments(c, clamp, angle)
    after = np.concatenate(
        [before[..., 1:], np.broadcast_to(moment, before.shape[:-1])[..., None]], axis=-1
    )
    return before - after - c.length[..., 1:] * (pull[..., 1:, :] * normal(angle)).sum(axis=-1)


def hessian(c: Chain, angle: Array, pull: Array) -> Array:
    """d2V/dtheta2 (..., n, n) [N m]."""
    load_stiffness = c.length[..., 1:] * (pull[..., 1:, :] * unit(angle)).sum(axis=-1)
    after = np.concatenate([c.spring[..., 1:], 0 * c.spring[..., :1]], axis=-1)
    i = np.arange(c.segments)
    out = np.zeros((*load_stiffness.shape, i.size), load_stiffness.dtype)
    out[..., i, i] = c.spring + after + load_stiffness
    out[..., i[1:], i[:-1]] = out[..., i[:-1], i[1:]] = -c.spring[..., 1:]
    return out


def tip_slopes(c: Chain, angle: Array) -> Array:
    """d(tip)/dtheta (..., 2, n) [m]."""
    return np.swapaxes(c.length[..., 1:, None] * normal(angle), -1, -2)


def root_moment(c: Chain, clamp: Array, angle: Array, pull: Array, moment: Array) -> Array:
    """Moment of all loads about the clamp (...) [N m], ``sum l_i u_i x G_i + M``."""
    arm = unit(angles_with_stub(clamp, angle))
    lever = arm[..., 0] * pull[..., 1] - arm[..., 1] * pull[..., 0]
    return np.asarray((c.length * lever).sum(axis=-1) + moment)
