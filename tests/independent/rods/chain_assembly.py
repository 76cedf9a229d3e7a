"""Equilibria of chains whose tips are pinned to one rigid platform: 2RFR, 3RFR, 3PFR."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.rods.assembly import Assembly
from proofmass.base.arrays import Array
from tests.independent.rods.chain import (
    Chain,
    carried_forces,
    energy,
    gradient,
    points,
    root_moment,
)
from tests.independent.rods.chain_closure import (
    NO_LOAD,
    chains,
    clamps,
    fit_pose,
    matrix,
    split_unknowns,
    system,
)
from tests.independent.rods.chain_matrix import Bordered
from tests.independent.rods.chain_newton import newton
from tests.independent.rods.chain_rod import check_numbers, check_vector
from tests.independent.rods.stability import curvatures

Seed = ArrayLike | Sequence[Callable[[Array], Array]]


@dataclass(frozen=True)
class AssemblyEquilibria:
    """Equilibria of an assembly of k chains with n segments each; NaN where none was found.

    Attributes
    ----------
    pose : ndarray (..., 2) or (..., 3)
        Pin x, y [m], or platform x, y [m] and phi [rad].
    angle : ndarray (..., k, n)
        Tangent angles of the segments [rad].
    force : ndarray (..., k, 2)
        Forces on the tips [N]; their sum is the external force.
    root_moment : ndarray (..., k)
        Moments at the clamps [N m], with the opposite sign those of the motors.
    energy : ndarray (...)
        Energy of the springs [J].
    potential : ndarray (...)
        Energy of the springs less the work of the load, U - F.P - M phi [J].
    matrix : Bordered
        Newton's matrix, of angles, pose and tip forces.
    """

    pose: Array
    angle: Array
    force: Array
    root_moment: Array
    energy: Array
    potential: Array
    matrix: Bordered

    @cached_property
    def curvatures(self) -> Array:
        """Curvatures of the potential along motions with closed loops (..., kn + f - 2k).

        The lowest one is the first; the equilibrium is unstable if it is negative.
        """
        return curvatures(self.matrix.dense(), 2 * self.force.shape[-2])

    @cached_property
    def stiffness(self) -> Array:
        """d(F, M)/d(pose) with fixed clamps (..., f, f) [N/m, N, N m].

        It is the inverse of d(pose)/d(F, M), a part of the inverse of Newton's matrix.
        """
        first, f = self.angle.shape[-2] * self.angle.shape[-1], self.pose.shape[-1]
        load = np.eye(self.matrix.border.shape[-1] + first)[first : first + f]
        moved = [
            self.matrix.solve(np.broadcast_to(one, (*self.pose.shape[:-1], one.size)))
            for one in load
        ]
        return np.asarray(np.linalg.inv(np.stack(moved, axis=-1)[..., first : first + f, :]))


def settle(
    a: Assembly,
    inputs: ArrayLike,
    *,
    seed: Seed,
    segments: int = 20,
    force: ArrayLike = (0.0, 0.0),
    moment: ArrayLike = 0.0,
    scheme: str = "half",
) -> AssemblyEquilibria:
    r"""Equilibrium of an assembly of chains near a seed.

    ::

        O1 |--o--o--o--.                      F
                        `o--o--( P --- ) --->        all tips on one platform or pin
        O2 |--o--o--o--o---´

    Parameters
    ----------
    a : Assembly
    inputs : turns [rad] or slides [m] of the clamps (..., k)
    seed : angles (..., k, n) [rad], or theta_i(s) of the k continuous rods over the arc length
    segments : n, the number of segments of each chain
    force, moment : dead load F [N] (..., 2), M [N m] (...) at the platform's origin
    scheme : scheme of `chain`

    Returns
    -------
    `AssemblyEquilibria`

    Raises
    ------
    ValueError
        Fewer than two segments, an unknown scheme, a load or a seed that is not finite, a moment
        on a pin, a seed of the wrong shape.

    Notes
    -----
    The equilibrium is exact for the chains, to rounding; with "half" and "double" its difference
    from the continuous rods is of order h^2.  The seed determines which equilibrium is found,
    stable or unstable.  Forces have the signs of Pérez Gámiz 2018, eqs 92 and 109; its eqs 104 and
    113 have -F as the sum of the tips' forces.

    Examples
    --------
    Two rods that lean towards each other are symmetric without a load:

    >>> from proofmass.analytic.rods.assembly import assembly
    >>> a = assembly([[-0.3, 0.0], [0.3, 0.0]], angle=np.radians([60.0, 120.0]))
    >>> arcs = [lambda s: np.pi / 3 + 0.3 * s, lambda s: 2 * np.pi / 3 - 0.3 * s]
    >>> found = settle(a, [0.0, 0.0], seed=arcs)
    >>> abs(found.pose[0]) < 1e-12, bool(found.curvatures[0] > 0)
    (np.True_, True)
    """
    c = chains(a, segments, scheme)
    place, load = clamps(a, check_vector("inputs", inputs, a.rods)), loads(a, force, moment)
    angle = seed_angles(a, c, seed)
    batch = np.broadcast_shapes(place.shape[:-2], load.shape[:-1], angle.shape[:-2])
    start = starting_unknowns(a, c, place, load, np.broadcast_to(angle, (*batch, a.rods, segments)))
    found = newton(lambda z: system(a, c, place, load, z), start, a.rods * segments)
    return assembly_equilibria(a, c, place, load, found)


def starting_unknowns(a: Assembly, c: Chain, place: Array, load: Array, angle: Array) -> Array:
    """Start of Newton's method: given angles, with the best pose and tip forces for them."""
    batch = angle.shape[:-2]
    pose = fit_pose(a, points(c, place, angle)[..., -1, :])
    rods = gradient(c, place, angle, carried_forces(c, NO_LOAD, NO_LOAD), np.zeros(()))
    push = np.concatenate([rods.reshape(*batch, -1), np.broadcast_to(-load, pose.shape)], axis=-1)
    closures = -matrix(a, c, angle, pose, np.zeros((*batch, a.rods, 2))).dense()
    first = push.shape[-1]
    tips = np.linalg.pinv(closures[..., :first, first:]) @ push[..., None]
    return np.concatenate([angle.reshape(*batch, -1), pose, tips[..., 0]], axis=-1)


def loads(a: Assembly, force: ArrayLike, moment: ArrayLike) -> Array:
    """The load F and, on a platform, M (..., f)."""
    push, turn = check_vector("force", force, 2), check_numbers("moment", moment)
    if a.dof == 2 and turn.any():
        raise ValueError(f"moment must be 0 on a pin, got {moment!r}")
    batch = np.broadcast_shapes(push.shape[:-1], turn.shape)
    both = [np.broadcast_to(push, (*batch, 2)), np.broadcast_to(turn, batch)[..., None]]
    return np.concatenate(both, axis=-1)[..., : a.dof]


def seed_angles(a: Assembly, c: Chain, seed: Seed) -> Array:
    """Angles (..., k, n) of a seed."""
    if isinstance(seed, Sequence) and all(callable(shape) for shape in seed):
        seed = [shape(s) for shape, s in zip(seed, c.station, strict=True)]
    angle = check_numbers("seed", np.asarray(seed, float))
    if angle.shape[-2:] != (a.rods, c.segments):
        raise ValueError(f"seed must be angles (..., {a.rods}, {c.segments}), got {angle.shape}")
    return angle


def assembly_equilibria(
    a: Assembly, c: Chain, place: Array, load: Array, unknowns: Array
) -> AssemblyEquilibria:
    """The equilibria that a vector of unknowns describes."""
    angle, pose, force = split_unknowns(a, c, unknowns)
    root = root_moment(c, place, angle, carried_forces(c, force, NO_LOAD), np.zeros(()))
    stored = energy(c, place, angle).sum(axis=-1)
    return AssemblyEquilibria(
        pose,
        angle,
        force,
        root,
        stored,
        stored - (load * pose).sum(axis=-1),
        matrix(a, c, angle, pose, force),
    )
