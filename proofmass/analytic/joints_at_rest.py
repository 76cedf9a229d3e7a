r"""Which joints at rest stay at rest: dry friction and stops in one convex problem.

Joints that slip have the friction -F sign(v).  For joints at rest friction and stops only bound the
force λ, and it is the acceleration that decides::

    M a = f + Jᵀ μ + Eᵀ λ,   J a = γ        J: loops and drives, E: rows of the joints at rest

    friction   |λ| ≤ F,    a > 0 where λ = -F,   a < 0 where λ = F,   a = 0 in between
    stop        λ ≥ 0,     a > 0 where λ = 0,    a = 0 where λ > 0    (a: of the distance to it)

These are the optimality conditions of Gauss' principle of least constraint with friction,

    min ½ (a - a₀)ᵀ M (a - a₀) + Σ Fⱼ |aⱼ|     over  J a = γ,  a ≥ 0 at stops

a strictly convex problem with one solution (P. Lötstedt, Mechanical systems of rigid bodies subject
to unilateral constraints, SIAM J. Appl. Math. 42 (1982) 281-296, for constant friction bounds).
Bounds that depend on reactions are another problem, which may have no solution or several.  With
the free motions G of J, Gᵀ M G = 1, a row of E G is the motion of a joint at rest with them, and
the forces of the rows act on the free motions by (E G)ᵀ λ.  Where rows depend on each other, λ is
not unique; rows stay at rest as long as any λ is within all bounds.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from proofmass.analytic.numerics import SingularHere
from proofmass.base.arrays import Array, Mask

FREE_RANK_TOLERANCE = 1e-8
"""Share of the largest singular value below which rows of loops and drives count as dependent."""
REST_RANK_TOLERANCE = 1e-9
"""Share of the largest singular value below which rows at rest count as dependent."""
TIE_TOLERANCE = 1e-11
"""Share of its bound by which a force may exceed it: one value for staying at rest, for leaving it
and for decisions, since two different ones would let a joint stick and slip in turn for ever."""
MIN_DEPARTURE_SHARE = 1e-10
"""Share of the largest acceleration that a row that leaves rest must have.  With less, a joint
would slip with its friction spent although it does not move."""
MAX_REST_ACCELERATION_SHARE = 1e-9
"""Share of the largest acceleration that rows at rest may keep: rounding of dependent rows."""
DEAD_POINT_MOBILITY = 1e-6
"""A joint is at its dead point where the free motions move it less than this share of what they
would without loops: there its friction has no effect on the motion."""
PROGRAM_ROUNDING = 1e-7
"""Tolerance of a linear program within which a row is at its bound [1]."""
MAX_RELAXATION_SWEEPS, SWEEPS_PER_GUESS = 2000, 50
"""Sweeps of the relaxation that guesses the rows that leave rest, and their number per guess."""
MAX_LISTED_ROWS = 8
"""Largest number of rows of which all 3^n combinations are tried if the relaxation does not end."""


def free_motions(mass: Array, rows: Array) -> Array:
    """Motions (rates, free) that rows (rows, rates) leave, orthonormal with the mass matrix.

    >>> motions = free_motions(np.diag([4.0, 1.0]), np.array([[0.0, 1.0]]))
    >>> np.abs(motions).tolist()
    [[0.5], [0.0]]
    """
    root = np.linalg.inv(np.linalg.cholesky(mass))
    if not len(rows):
        return np.asarray(root.T)
    _, values, ways = np.linalg.svd(rows @ root.T)
    rank = int((values > FREE_RANK_TOLERANCE * values[0]).sum()) if values[0] > 0.0 else 0
    return np.asarray(root.T @ ways[rank:].T)


@dataclass(frozen=True)
class RestForces:
    """Forces of rows at rest, the reserve of their bounds, and the motion that would begin.

    Attributes
    ----------
    forces : ndarray (rows,)
        Forces λ whose smallest reserve is as large as possible [N m or N].
    reserve : float
        That reserve: 1 - |λ|/F for friction, and λ over its unit for stops; at most 1, negative
        where the rows cannot stay at rest [1].
    begins : ndarray (rows,)
        Signs of the motion that begins where the reserve is 0; 0 for rows that stay at rest [1].
    unique : bool
        Whether these forces are the only ones.
    """

    forces: Array
    reserve: float
    begins: Array
    unique: bool


@dataclass(frozen=True)
class RestRows:
    """Rows of joints that are at rest by friction or on stops.

    Attributes
    ----------
    motions : ndarray (rows, free)
        E G: rates of the rows for unit rates of the free motions [SI].
    bounds : ndarray (rows,)
        Largest friction, or the unit of the force of a stop [N m or N].
    one_sided : ndarray (rows,) of bool
        Whether a row is that of a stop, which can only push.
    """

    motions: Array
    bounds: Array
    one_sided: Mask

    def __getitem__(self, places: Mask) -> "RestRows":
        """Some of the rows."""
        return RestRows(self.motions[places], self.bounds[places], self.one_sided[places])

    def find_forces(self, needed: Array) -> RestForces:
        """Find the forces whose sum on the free motions is `needed` (free,).

        The sum that cannot be reached at all is left out: there the rows have no effect.
        """
        count = len(self.bounds)
        pushes = self.motions * self.bounds[:, None]
        if not pushes.any():
            return RestForces(np.zeros(count), 1.0, np.zeros(count), not count)
        left, values, right = np.linalg.svd(pushes, full_matrices=False)
        rank = int((values > REST_RANK_TOLERANCE * values[0]).sum())
        if rank == count:
            shares = left @ ((right @ needed) / values)
            margins = np.where(self.one_sided, shares, 1.0 - np.abs(shares))
            first = int(np.argmin(margins))
            begins = np.zeros(count)
            begins[first] = 1.0 if self.one_sided[first] else -np.sign(shares[first])
            return RestForces(shares * self.bounds, min(1.0, margins[first]), begins, True)
        if rank == 1 and not self.one_sided.any():
            return self._share_one_motion(pushes @ right[0], float(needed @ right[0]))
        return self._share_forces(pushes, needed)

    def _share_one_motion(self, pushes: Array, needed: float) -> RestForces:
        """`find_forces` of joints that move together: each takes the same share of its bound."""
        share = abs(needed) / np.abs(pushes).sum()
        senses = np.sign(needed) * np.sign(pushes)
        return RestForces(share * senses * self.bounds, 1.0 - share, -senses, False)

    def _share_forces(self, pushes: Array, needed: Array) -> RestForces:
        """`find_forces` of rows that depend on each other, by a linear program.

        Its solution is found once more in its basis, so that it has rounding errors only.  The dual
        of that basis is the motion that begins: against the friction that is at its bound, and away
        from the stops that do not push.
        """
        from scipy.optimize import linprog  # slow to load

        count, size, one_sided = len(pushes), float(np.abs(pushes).max()), self.one_sided
        pushes, needed = pushes / size, needed / size
        last = np.eye(count + 1)[count]
        unit = np.eye(count + 1)[:count]
        rubs = unit[~one_sided]
        sides = np.vstack([last + rubs, last - rubs, last - unit[one_sided]])
        ends = np.concatenate([np.ones(2 * len(rubs)), np.zeros(int(one_sided.sum()))])
        balance = np.column_stack([pushes.T, np.zeros(pushes.shape[1])])
        bounds = [(None, None)] * count + [(None, 1.0)]
        found = linprog(-last, sides, ends, balance, needed, bounds)
        if found.x is None:  # rounding of the balance: it is met by least squares below
            reached = pushes.T @ np.linalg.lstsq(pushes.T, needed, rcond=REST_RANK_TOLERANCE)[0]
            found = linprog(-last, sides, ends, balance, reached, bounds)
        if found.x is None:
            raise SingularHere("the forces of joints at rest cannot be found")
        shares, reserve = found.x[:count], float(found.x[count])
        at_bound = np.where(
            one_sided,
            shares < reserve + PROGRAM_ROUNDING,
            np.abs(shares) > 1.0 - reserve - PROGRAM_ROUNDING,
        )
        signs = np.sign(shares)
        rubbing, pushing = at_bound & ~one_sided, at_bound & one_sided
        friction = signs[rubbing] @ pushes[rubbing]
        by_reserve = pushes[pushing].sum(axis=0) - friction
        columns = np.column_stack([by_reserve, pushes[~at_bound].T])
        exact = np.linalg.lstsq(columns, needed - friction, rcond=REST_RANK_TOLERANCE)[0]
        if reserve < 1.0 - PROGRAM_ROUNDING:  # otherwise no force is needed
            reserve = float(exact[0])
            shares[rubbing], shares[pushing] = signs[rubbing] * (1.0 - reserve), reserve
            shares[~at_bound] = exact[1:]
        way = np.linalg.lstsq(columns.T, np.eye(len(columns.T))[0], rcond=REST_RANK_TOLERANCE)[0]
        moves = np.where(at_bound, pushes @ way, 0.0)
        moves[np.abs(moves) < REST_RANK_TOLERANCE * np.abs(moves).max(initial=0.0)] = 0.0
        return RestForces(shares * self.bounds, reserve, np.sign(moves), False)

    def decide(self, acceleration: Array) -> Array:
        """Decide which rows leave rest: signs of their accelerations (rows,), 0 if they stay.

        Parameters
        ----------
        acceleration : ndarray (rows,)
            Accelerations of the rows without their forces [SI].

        Raises
        ------
        SingularHere
            No combination meets all conditions.

        Examples
        --------
        A block of 1 kg with 3 N of friction, pushed with 2 N and with 4 N:

        >>> row = RestRows(np.ones((1, 1)), np.array([3.0]), np.array([False]))
        >>> row.decide(np.array([2.0])).tolist(), row.decide(np.array([4.0])).tolist()
        ([0.0], [1.0])
        """
        friction = np.abs(self.motions.T) @ np.where(self.one_sided, 0.0, self.bounds)
        scale = float(
            np.abs(acceleration).max(initial=0.0)
            + (np.abs(self.motions) @ friction).max(initial=0.0)
        )
        for senses in self._guess(acceleration, scale):
            if self._holds(senses, acceleration, scale):
                return senses
        raise SingularHere("no combination of joints at rest goes on from here")

    def _guess(self, acceleration: Array, scale: float) -> Iterator[Array]:
        """Iterate over senses: those of a relaxation of the forces, then all combinations."""
        matrix = self.motions @ self.motions.T
        lowest = np.where(self.one_sided, 0.0, -self.bounds)
        highest = np.where(self.one_sided, np.inf, self.bounds)
        forces, still = np.zeros(len(lowest)), MIN_DEPARTURE_SHARE * scale
        active = np.flatnonzero(np.diag(matrix) > 0.0).tolist()
        for sweep in range(1, MAX_RELAXATION_SWEEPS + 1):
            for k in active:
                change = (acceleration[k] + matrix[k] @ forces) / matrix[k, k]
                forces[k] = min(max(forces[k] - change, lowest[k]), highest[k])
            if sweep % SWEEPS_PER_GUESS == 0:
                rates = acceleration + matrix @ forces
                yield np.where(np.abs(rates) > 10.0 * still, np.sign(rates), 0.0)
        if len(forces) <= MAX_LISTED_ROWS:
            options = [np.array(one) for one in product((0.0, 1.0, -1.0), repeat=len(forces))]
            yield from sorted(options, key=np.count_nonzero)

    def _holds(self, senses: Array, acceleration: Array, scale: float) -> bool:
        """Whether rows leave rest with accelerations of these senses, and the others can stay."""
        leaves, stays = senses != 0, senses == 0
        if (self.one_sided & (senses < 0)).any():
            return False
        forces = np.where(self.one_sided, 0.0, -senses * self.bounds)
        pushed = self.motions.T @ forces
        rows = self.motions[stays]
        inverse = np.linalg.pinv(rows, rcond=REST_RANK_TOLERANCE)
        needed = -inverse @ (acceleration[stays] + rows @ pushed)
        rates = acceleration + self.motions @ (pushed + needed)
        return bool(
            (senses[leaves] * rates[leaves] > MIN_DEPARTURE_SHARE * scale).all()
            and (np.abs(rates[stays]) <= MAX_REST_ACCELERATION_SHARE * scale).all()
            and self[stays].find_forces(needed).reserve >= -TIE_TOLERANCE
        )
