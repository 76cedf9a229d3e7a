"""All equilibria of rods on a common platform: the direct problem, without a first guess."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.numerics import TURN, Array
from proofmass.analytic.rods.assembly import Assembly
from proofmass.analytic.rods.elliptic import relative
from proofmass.analytic.rods.search_boxes import proven
from proofmass.analytic.rods.search_lattice import starts
from proofmass.analytic.rods.search_newton import FURTHEST, negative, solve, turned
from proofmass.analytic.rods.search_sheet import rods
from proofmass.analytic.rods.search_tight import drawn
from proofmass.analytic.rods.state import State, state

SAME = 1e-6  # of length, load and moment: what is nearer is one equilibrium
POSES = 2000
LATTICE = 20.0  # alpha up to which the lattice of poses is searched
OVERLAP = 12.0  # alpha from which on loads are drawn as well, if they may exceed that


@dataclass(frozen=True)
class Solutions:
    """Equilibria (n,) of one assembly of k rods, the lowest potential first.

    Attributes
    ----------
    state : State (n,)
        Poses, loads and clamp moments.
    modes : ndarray (n, k)
        Inflections of each rod, its tip included.
    psi, k_rel : ndarray (n, k)
        Direction of its load from the clamp's tangent [rad] and relative modulus, as in `tip`.
    potential : ndarray (n,)
        V = sum U_i - F.P - M phi [J].
    negative : ndarray (n,)
        Directions in which V falls: 0 is stable.
    alpha, complement : ndarray (n, k)
        L sqrt(R/EI) of each rod, and k' = sqrt(1 - k^2) of its modulus, which has digits left where
        k_rel is 1 in double precision, for alpha beyond about 18.
    up_to : float
        The largest alpha that was searched: the count holds up to there.
    bound : float
        alpha that no rod of any equilibrium with these modes exceeds, by `search_boxes.proven`; inf
        where there is no proof.
    """

    state: State
    modes: NDArray[np.int_]
    psi: Array
    k_rel: Array
    potential: Array
    negative: NDArray[np.int_]
    alpha: Array
    complement: Array
    up_to: float
    bound: float

    @property
    def bounded(self) -> bool:
        """Whether no equilibrium can have larger loads than were searched."""
        return bool(self.up_to >= self.bound)

    def __len__(self) -> int:
        return self.potential.size


def solutions(
    a: Assembly, *, inputs: ArrayLike = 0.0, load: ArrayLike = 0.0,
    modes: int | Sequence[int] = 1, most_load: float | None = None, poses: int = POSES,
) -> Solutions:
    r"""All equilibria whose rods have no more inflections than asked for.

    ::

         O1 |/______.  P  .______\| O2      all rods with a pinned tip are one smooth sheet, by
                     `o.-'                  (alpha, gamma): the load on and the turn of the tip,
                      |                     R = alpha^2 EI/L^2, k = cos(gamma/2)
                      v F

        2 k equations O_i + tip_i = P + Rot(phi) r_i,  p of balance,  2 k + p unknowns

    Triangles of that sheet tell, for any pose, all rods that reach it.  From a lattice of poses
    each choice of one rod for each clamp is followed by Newton's method if its first step is short.
    Where loads may exceed alpha = 20, straight rods with loops are drawn at random for a start.

    Parameters
    ----------
    a : Assembly, of k rods without rigid ends
    inputs : of the motors [rad] or along the guides [m], (k,)
    load : dead force [N] on the platform at its origin, and moment [N m] if it is no pin, (p,)
    modes : largest mode of each rod, or of all
    most_load : largest alpha = L sqrt(R/EI) of any rod, within [1, 340]; where none is given the
        bound that `search_boxes` proves, or 20 if there is none
    poses : least number of poses of the lattice

    Returns
    -------
    Solutions

    Raises
    ------
    ValueError
        A mode, a load or a number out of its domain; rods with rigid ends.

    Notes
    -----
    Closed and balanced to 1e-12 of L and EI/L^2 at small loads.  Modes meet without a crack, so a
    rod with m0 = 0 is found; platforms are never mirrored, since pins belong to a pose.  A rod
    that is exactly straight, or without any load, is a boundary of the chart and is not found.

    Loads are bounded by proof wherever stretched rods cannot hold the platform tight against each
    other; `bound` says where, and `bounded` whether the search went so far.  For Table 8 it is
    alpha = 52 for modes to 1 and 104 for modes to 2, for the program's 3PFR 18 and 36.

    Completeness below the bound is tested, not proven.  Up to alpha = 20 counts are the same for
    lattices of 1500, 2000, 6000 and 10,000 poses and for a mesh of 0.05 L instead of 0.08 L, and of
    20,000 random starts without lattice or mesh none finds another: 34 for Table 7 and modes up to
    3 (all there are up to the bound), 10 for Table 8 and 56 for the program's 3PFR and modes up to
    2.  With 500 poses one of the 34 and two of the 56 are missed.  Beyond, starts are drawn at
    random (`search_tight`), which finds 57 more and one more; ten times as many starts from another
    seed find the same.

    `State.energy`, `State.shape` and `closure` integrate from the clamp, and an error grows by up
    to e^alpha: of what has an alpha beyond 25 they say little.  Poses, loads, moments, potential
    and stability are of the closed form, and have their digits.

    Source: Pérez Gámiz 2018, eqs 103-105 and 113-115 and text lines 1149-1161, searches a grid of
    (psi, k_rel), 42 n^3 nodes of the 3PFR in 985 to 17,241 s (Table 2), for given modes.  Departs
    from it in chart, elimination and closure, which accepts mirrored platforms; its Table 7 (two
    solutions) and Table 8 (two) are incomplete.

    Examples
    --------
    >>> from proofmass.analytic.rods.assembly import assembly
    >>> pair = assembly([[-0.3, 0.0], [0.3, 0.0]], stiffness=0.052186)
    >>> found = solutions(pair, inputs=np.radians([40.0, 60.0]), load=[0.3, -0.1])
    >>> found.state.pose.round(3).tolist()
    [[0.622, -0.242], [0.293, -0.341], [-0.081, -0.246]]
    >>> found.bounded, round(found.up_to)
    (True, 9)
    """
    given = state(a, inputs=inputs, load=load)
    upto = checked(given, modes, most_load, poses)
    bound = proven(given, upto)
    cap = bound if np.isfinite(bound) else LATTICE
    cap = cap if most_load is None else min(most_load, bound)
    batches = list(starts(given, upto, min(cap, LATTICE), poses))
    if cap > LATTICE:
        batches.append(drawn(given, upto, OVERLAP, cap))
    found = [solve(given, *start) for start in batches]
    chart, pose = (np.concatenate(part, axis=-1) for part in zip(*found, strict=True))
    pose[2] = (pose[2] + np.pi) % TURN - np.pi
    sheet = rods(chart[:, 0], chart[:, 1])
    within = (sheet.waves < np.array(upto)[:, None]) & (chart[:, 0] <= cap)
    kept = distinct(given, chart, pose, np.flatnonzero(within.all(axis=0)))
    return described(given, chart[..., kept], pose[:, kept], cap, bound)


def checked(s: State, modes: int | Sequence[int], most_load: float | None,
            poses: int) -> list[int]:
    """The largest mode of each rod; ValueError for what cannot be searched."""
    upto = np.broadcast_to(modes, s.assembly.rods) if np.size(modes) in (
        1, s.assembly.rods) else np.zeros(1)
    if not (np.all(upto >= 1) and np.all(upto == np.rint(upto))):
        raise ValueError(f"modes must be 1, 2 .. for all or for each of {s.assembly.rods} rods, "
                         f"got {modes!r}")
    if most_load is not None and not 1.0 <= most_load <= FURTHEST:
        raise ValueError(f"most_load must lie within [1, {FURTHEST:g}], got {most_load}")
    if not 1 <= poses <= 1_000_000:
        raise ValueError(f"poses must lie within [1, 1000000], got {poses}")
    if s.assembly.prolongation.any():
        raise ValueError("rods must have no rigid ends: their tips would carry a moment, got "
                         f"prolongation {s.assembly.prolongation.tolist()}")
    if s.vector.ndim != 1:
        raise ValueError(f"inputs and load must be those of one problem, got {s.vector.shape}")
    return [int(mode) for mode in upto]


def distinct(s: State, chart: Array, pose: Array, which: NDArray[np.intp]) -> NDArray[np.intp]:
    """One of each group of arrivals that are the same in tips, loads and clamp moments."""
    found = rods(*np.moveaxis(chart[..., which], 1, 0))
    size = 1.0 + np.abs(found.force)
    say = np.concatenate([found.tip.real, found.tip.imag, found.force.real / size,
                          found.force.imag / size, found.moment / size]).T
    _, first = np.unique((say / SAME).round(), axis=0, return_index=True)
    apart: list[int] = []
    for i in first:  # neighbours that rounding has told apart
        if not apart or np.abs(say[apart] - say[i]).max(axis=1).min() > SAME:
            apart.append(int(i))
    return which[apart]


def described(s: State, chart: Array, pose: Array, up_to: float, bound: float) -> Solutions:
    """Equilibria in the document's terms."""
    a, found = s.assembly, rods(chart[:, 0], chart[:, 1])
    force = turned(s, found)[1].T
    energy = ((a.stiffness / a.length)[:, None] * found.energy).sum(axis=0)
    potential = energy - s.load @ pose[: a.freedoms]
    order = np.argsort(potential)
    states = state(a, inputs=s.inputs, load=s.load, pose=pose[: a.freedoms].T,
                   moment=(a.stiffness / a.length) * found.moment.T,
                   force=np.stack([force.real, force.imag], axis=-1))
    psi = -np.angle(found.delta) % TURN
    k = np.copysign(np.tanh(chart[:, 1]), found.moment)
    return Solutions(states[order], (np.floor(found.waves).astype(int) + 1).T[order],
                     psi.T[order], relative(psi, k).T[order], potential[order],
                     negative(s, chart, pose)[order],
                     chart[:, 0].T[order], (1.0 / np.cosh(chart[:, 1])).T[order], up_to, bound)
