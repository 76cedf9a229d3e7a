r"""Newton's method for any planar assembly of rods, from states that need not fit together.

Unknowns of a rod are the force on its tip and, if this is clamped, the moment on it, or else its
angle; and the angle and the moment M (see `tip_wrench`) at nodes that cut the rod into equal
segments.  Each segment is integrated by itself (multiple shooting), since a rod under tension
depends on the state of its tip by a factor of e^alpha, alpha = L sqrt(R/EI), and a segment by the
root of it::

      clamp   segment 4     3     2     1    tip   n, m_L or theta_L
     _|/_________.________.____.________________.--->
              theta_3, M_3                               gap = (clamp that is reached) - (clamp)

Equations are the states at the nodes, the positions and angles of the clamps, and the balance of
the platform's free coordinates, with F and M the load, r_i the arms and w_i = (n, m_L) the
wrenches::

    sum n_i = F,    sum r_i x n_i + m_i = M

Nodes are eliminated, which leaves the first three unknowns of each rod and the platform's free
coordinates.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import TURN
from proofmass.analytic.rods.assembly import Assembly
from proofmass.analytic.rods.tip_wrench import (
    LinkRule,
    NaturalRods,
    StepRule,
    march_from_tip,
    step_count,
)
from proofmass.base.arrays import Array, Complex, Index

SEGMENTS = 4
"""Segments of a rod: a state of alpha = 12 changes by e^3 = 20 along one."""
OWN = 3 + 2 * (SEGMENTS - 1)
"""Unknowns of a rod."""
ROWS_AT_ONCE = 2000
"""Rods that are integrated in one batch: their state fits a processor's cache."""


@dataclass(frozen=True)
class RodProblem:
    """An assembly with its inputs and the dead load on its platform.

    Attributes
    ----------
    assembly : Assembly
    inputs : ndarray (k,)
        Angles that motors add to the clamps [rad], or positions along the guides [m].
    load : ndarray (3,)
        F [N] at the platform's origin and M [N m].
    """

    assembly: Assembly
    inputs: Array
    load: Array

    @property
    def angle(self) -> Array:
        """Tangents at the clamps (k,) [rad]."""
        a = self.assembly
        return np.asarray(a.angle + self.inputs if a.guide is None else a.angle)

    @property
    def clamp(self) -> Complex:
        """Positions of the clamps (k,), x + iy [m]."""
        a = self.assembly
        return np.asarray(a.clamp if a.guide is None else a.clamp + self.inputs * a.guide)

    def unit_rod(self, i: int, turned: float = 0.0) -> NaturalRods:
        """Rod i in units of its length and stiffness, in a frame that is turned [rad]."""
        a = self.assembly
        own = a.length[i] / a.stiffness[i]
        return NaturalRods(
            np.array([a.curvature[i] * a.length[i]]),
            np.array([a.couple[i] * own * a.length[i]]),
            np.array([a.weight[i] * own * a.length[i] ** 2 * np.exp(-1j * turned)]),
        )

    def units(self, i: int) -> Array:
        """Sizes (OWN,) of the unknowns of rod i in units of SI."""
        a = self.assembly
        bend = a.stiffness[i] / a.length[i]
        third = bend if a.clamped[i] else 1.0
        return np.array([*[bend / a.length[i]] * 2, third, *[1.0, bend] * (SEGMENTS - 1)])


@dataclass(frozen=True)
class RodGuess:
    """States (n,) of an assembly: unknowns of its rods, and the pose of its platform.

    Attributes
    ----------
    own : ndarray (n, k, OWN)
        n_x, n_y [N]; m_L [N m] of a clamped or theta_L [rad] of a pinned tip; theta [rad] and M
        [N m] at each node.
    pose : ndarray (n, 3)
        x, y [m], phi [rad]; phi of a pin is zero.
    """

    own: Array
    pose: Array

    def __getitem__(self, which: Index | slice | NDArray[np.bool_]) -> "RodGuess":
        return RodGuess(self.own[which], self.pose[which])

    def __len__(self) -> int:
        return len(self.pose)


def join_guesses(parts: list[RodGuess], k: int) -> RodGuess:
    """All states of the parts, of assemblies of k rods."""
    own = np.concatenate([np.empty((0, k, OWN)), *(part.own for part in parts)])
    return RodGuess(own, np.concatenate([np.empty((0, 3)), *(part.pose for part in parts)]))


@dataclass(frozen=True)
class BentRods:
    """Rods (n,) of one member of an assembly, linearized, in units of SI.

    Attributes
    ----------
    gap : ndarray (n, 3)
        Position [m] and angle [rad] of the clamp that is reached, less those of the clamp, if all
        segments fit to first order.
    slopes : ndarray (n, 3, 4)
        Its derivatives by n_x, n_y [N], m_L [N m] and theta_L [rad].
    misfit : ndarray (n, 2 SEGMENTS - 2)
        Changes of theta [rad] and M [N m] at the nodes with which segments fit to first order.
    nodes : ndarray (n, 2 SEGMENTS - 2, 4)
        Their derivatives by the same four [SI].
    clamped : bool
        Whether the tip has the angle of its attachment.
    """

    gap: Array
    slopes: Array
    misfit: Array
    nodes: Array
    clamped: bool

    @property
    def by_own(self) -> Array:
        """Derivatives (n, 3, 3) of `gap` by the first three unknowns of the rod."""
        return self.slopes[..., [0, 1, 2 if self.clamped else 3]]

    @property
    def by_tip(self) -> Array:
        """Derivatives (n, 3, 3) of `gap` by the position [m] and the angle [rad] of the tip."""
        out = np.tile(np.eye(3), (len(self.gap), 1, 1))
        out[:, :, 2] = self.slopes[..., 3]
        return out

    @property
    def by_attachment(self) -> Array:
        """Derivatives (n, 3, 3) of `gap` by the position and the angle of the attachment."""
        return self.by_tip if self.clamped else self.by_tip * [1.0, 1.0, 0.0]

    @property
    def compliance(self) -> Array:
        """Motions (n, 3, 3) of the tip by the wrench on it; NaN at a critical load."""
        return -invert(self.by_tip) @ self.slopes[..., :3]


def bend_rods(
    problem: RodProblem, i: int, own: Array, place: Complex, angle: Array, rule: StepRule
) -> BentRods:
    """Rods of member i with unknowns (n, OWN) and attachments at a place [m] and an angle [rad]."""
    order = np.argsort(np.hypot(own[:, 0], own[:, 1]))  # rods of a batch take as many steps
    parts = [
        bend_batch(problem, i, own[rows], place[rows], angle[rows], rule)
        for rows in np.array_split(order, -(-order.size // ROWS_AT_ONCE) or 1)
    ]
    back = np.argsort(order)
    gap, slopes, misfit, nodes = (
        np.concatenate([getattr(part, name) for part in parts])[back]
        for name in ("gap", "slopes", "misfit", "nodes")
    )
    return BentRods(gap, slopes, misfit, nodes, bool(problem.assembly.clamped[i]))


def bend_batch(
    problem: RodProblem, i: int, own: Array, place: Complex, angle: Array, rule: StepRule
) -> BentRods:
    """A batch of `bend_rods`."""
    a, n = problem.assembly, len(own)
    scaled = own / problem.units(i)
    force = scaled[:, 0] + 1j * scaled[:, 1]
    clamped = bool(a.clamped[i])
    tip = np.stack([angle, scaled[:, 2]] if clamped else [scaled[:, 2], np.zeros(n)], axis=-1)
    states = np.concatenate([tip, scaled[:, 3:]], axis=1).reshape(n, SEGMENTS, 2)
    base, turn, bend = march_segments(problem.unit_rod(i), force, states, rule)
    reached = np.zeros((n, 3, 5))  # value, and derivatives by n_x, n_y, m_L, theta_L
    here = np.zeros((n, 2, 5))  # of theta and M at the beginning of a segment
    here[:, 0, 4] = here[:, 1, 3] = 1.0
    nodes = []
    for j in range(SEGMENTS):
        rows = np.stack([base[j].real, base[j].imag, turn[j], bend[j]], axis=1)  # n, 4, 5
        by_state = rows[:, :, [4, 3]]  # of theta and M
        along = by_state @ here
        along[:, :, :3] += rows[:, :, :3]
        reached[:, :2] += along[:, :2]
        here = along[:, 2:]
        if j + 1 < SEGMENTS:
            here[:, :, 0] -= states[:, j + 1]
            nodes.append(here)
    reached[:, 2] = here[:, 0]
    length, unit = a.length[i], problem.units(i)
    bend_unit = a.stiffness[i] / a.length[i]
    by = np.array([unit[0], unit[0], bend_unit, 1.0])
    slopes = reached[:, :, 1:] * np.array([length, length, 1.0])[:, None] / by
    gap = reached[:, :, 0] * [length, length, 1.0]
    gap += np.stack([place.real, place.imag, 0.0 * angle], axis=-1)
    gap -= [problem.clamp[i].real, problem.clamp[i].imag, problem.angle[i]]
    gap[:, 2] -= TURN * np.round((turn[-1][:, 0] - problem.angle[i]) / TURN)  # of the last segment
    node = np.concatenate(nodes, axis=1) if nodes else np.zeros((n, 0, 5))
    size = unit[3:]
    return BentRods(gap, slopes, node[:, :, 0] * size, node[:, :, 1:] * size[:, None] / by, clamped)


def march_segments(
    rods: NaturalRods, force: Complex, states: Array, rule: StepRule
) -> tuple[Complex, Array, Array]:
    """Ends of the segments of rods (n,) whose states (n, SEGMENTS, 2) are theta and M.

    Returns positions, angles and moments (SEGMENTS, n, 5) at the ends, with derivatives by n_x,
    n_y, and by M and theta at the beginning of each segment.
    """
    n, share = force.size, 1.0 / SEGMENTS
    along = np.repeat(np.arange(SEGMENTS) * share, n)
    loads = np.tile(force, SEGMENTS) + rods.weight * along
    pieces = NaturalRods(rods.curvature + rods.slope * along, rods.slope, rods.weight)
    angle, moment = states[:, :, 0].T.ravel(), states[:, :, 1].T.ravel()
    count = -(-step_count(rods, force, states[:, 0, 1], rule) // SEGMENTS)
    march = march_from_tip(
        pieces,
        loads,
        moment,
        angle,
        rule=LinkRule(count) if isinstance(rule, LinkRule) else count,
        length=share,
        is_tip=along == 0.0,
    )
    return tuple(  # type: ignore[return-value]
        np.moveaxis(part.reshape(5, SEGMENTS, n), 0, -1)
        for part in (march.base, march.angle, march.moment)
    )


def tip_motion(arm: Complex) -> Array:
    """Motions (n, 3, 3) of an attachment with a rotated arm (n,) by those of the platform."""
    lever = np.tile(np.eye(3), (arm.size, 1, 1))
    lever[:, 0, 2], lever[:, 1, 2] = -arm.imag, arm.real
    return lever


def unbalance(problem: RodProblem, guess: RodGuess) -> Array:
    """Wrench (n, 3) of all tips on the platform's origin, less the load [N, N m]."""
    a = problem.assembly
    arm = a.arm * np.exp(1j * guess.pose[:, 2:])
    moment = arm.real * guess.own[..., 1] - arm.imag * guess.own[..., 0]
    moment = moment + np.where(a.clamped, guess.own[..., 2], 0.0)
    total = np.stack([guess.own[..., 0], guess.own[..., 1], moment], axis=-1).sum(axis=1)
    return np.asarray(total - problem.load)


@dataclass(frozen=True)
class PlatformStep:
    """Newton's step of states (n,), and what tells their stability.

    Attributes
    ----------
    own, pose : ndarray (n, k, OWN), (n, 3)
        The step of `RodGuess` [SI].
    residual : ndarray (n,)
        Largest gap of a clamp, misfit of a node and unbalance, in sizes of the rods [1].
    bordered : ndarray (n, m + p, m + p)
        Symmetric matrix [[-C, A], [A', G]] of the compliances C of all tips, the motions A of tips
        by the platform, and the stiffness G of its load, without units [1].
    """

    own: Array
    pose: Array
    residual: Array
    bordered: Array


def newton_step(problem: RodProblem, guess: RodGuess, rule: StepRule) -> PlatformStep:
    """Newton's step from states (n,) whose rods and platform need not fit.

    The first three unknowns of the rods and the platform's free coordinates are solved for
    together, since a straight rod, whose force does not move its tip, cannot be eliminated.
    """
    a, free, n = problem.assembly, problem.assembly.free, len(guess)
    place, phi = guess.pose[:, 0] + 1j * guess.pose[:, 1], guess.pose[:, 2]
    length, unit, bend = a.scale
    size, rods, motions = 3 * a.rods, [], []
    pose_units, wrench_units = np.array([length, length, 1.0]), np.array([unit, unit, bend])
    matrix, right = np.zeros((n, size + free.size, size + free.size)), np.zeros((n, size))
    worst, turning = np.zeros(n), np.zeros((n, 3, 3))
    for i in range(a.rods):
        arm, rows = a.arm[i] * np.exp(1j * phi), slice(3 * i, 3 * i + 3)
        bent = bend_rods(problem, i, guess.own[:, i], place + arm, phi + a.tip_angle[i], rule)
        motion = tip_motion(arm)
        rods.append(bent)
        motions.append(motion)
        scale = problem.units(i)[:3]
        matrix[:, rows, rows] = bent.by_own * scale / pose_units[:, None]
        by_pose = bent.by_attachment @ motion * pose_units / pose_units[:, None]
        matrix[:, rows, size:] = by_pose[..., free]
        back = motion.swapaxes(1, 2) * [1.0, 1.0, float(a.clamped[i])]
        matrix[:, size:, rows] = (back * scale / wrench_units[:, None])[:, free]
        turning[:, 2, 2] -= arm.real * guess.own[:, i, 0] + arm.imag * guess.own[:, i, 1]
        right[:, rows] = bent.gap / pose_units
        misfit = np.abs(bent.misfit / problem.units(i)[3:]).max(axis=1)
        worst = np.max([worst, np.abs(right[:, rows]).max(axis=1), misfit], axis=0)
    stiff = (turning * pose_units / wrench_units[:, None])[:, free[:, None], free]
    matrix[:, size:, size:] = stiff
    balance = (unbalance(problem, guess) / wrench_units)[:, free]
    step = -(invert(matrix) @ np.concatenate([right, balance], axis=1)[..., None])[..., 0]
    pose = np.zeros((n, 3))
    pose[:, free] = step[:, size:] * pose_units[free]
    own = np.zeros(guess.own.shape)
    for i, bent in enumerate(rods):
        own[:, i, :3] = step[:, 3 * i : 3 * i + 3] * problem.units(i)[:3]
        four = np.zeros((n, 4))
        four[:, :2], four[:, 2 if a.clamped[i] else 3] = own[:, i, :2], own[:, i, 2]
        if a.clamped[i]:
            four[:, 3] = pose[:, 2]
        own[:, i, 3:] = bent.misfit + (bent.nodes @ four[..., None])[..., 0]
    worst = np.maximum(worst, np.abs(balance).max(axis=1, initial=0.0))
    return PlatformStep(own, pose, worst, bordered_matrix(a, rods, motions, stiff))


def bordered_matrix(a: Assembly, rods: list[BentRods], motions: list[Array], stiff: Array) -> Array:
    """The matrix of `PlatformStep`, from rods, motions of tips, and the stiffness of the load."""
    length, unit, bend = a.scale
    sizes = [3 if clamped else 2 for clamped in a.clamped]
    total, n = sum(sizes), len(stiff)
    out = np.zeros((n, total + a.free.size, total + a.free.size))
    out[:, total:, total:] = stiff
    begin, wrench_units = 0, np.array([unit, unit, bend])
    pose_units = np.array([length, length, 1.0])
    for size, bent, motion in zip(sizes, rods, motions, strict=True):
        rows = slice(begin, begin + size)
        compliance = bent.compliance * wrench_units / pose_units[:, None]
        out[:, rows, rows] = -compliance[:, :size, :size]
        along = (motion * pose_units / pose_units[:, None])[:, :size][..., a.free]
        out[:, rows, total:] = along
        out[:, total:, rows] = along.swapaxes(1, 2)
        begin += size
    return out


def invert(matrix: Array) -> Array:
    """Inverses (n, p, p); NaN where a matrix is singular or not finite."""
    out = np.full_like(matrix, np.nan)
    good = np.asarray(np.isfinite(matrix).all(axis=(1, 2)))
    good[good] = np.abs(np.linalg.det(matrix[good])) > LEAST_DETERMINANT
    out[good] = np.linalg.inv(matrix[good])
    return out


LEAST_DETERMINANT = 1e-200
"""Determinant at or below which a matrix counts as singular."""
MAX_ROD_NEWTON_STEPS = 20
"""Newton steps of a start; most starts that converge take less than ten."""
FORCE_STEP = 2.0, 0.5
"""Largest step of a force or a moment, in sizes of the rod and as a share of itself."""
TIP_STEP, PLACE_STEP, PHI_STEP = 1.0, 0.25, 0.5
"""Largest step of the angle of a tip or a node [rad], and of the platform's place [L] and angle
[rad]."""


def own_share(problem: RodProblem, i: int, own: Array, move: Array) -> Array:
    """Size (n,) of a step (n, OWN) of rod i, in the largest sizes that are allowed."""
    own, move = own / problem.units(i), np.abs(move / problem.units(i))
    force = FORCE_STEP[0] + FORCE_STEP[1] * np.hypot(own[:, 0], own[:, 1])
    bend = FORCE_STEP[0] + FORCE_STEP[1] * np.abs(own)
    most = np.where(np.arange(OWN) % 2 == 1, TIP_STEP, bend)
    most[:, 0] = most[:, 1] = force
    if not problem.assembly.clamped[i]:
        most[:, 2] = TIP_STEP
    return np.asarray((move / most).max(axis=1))


def step_share(problem: RodProblem, guess: RodGuess, step: PlatformStep) -> Array:
    """Size (n,) of a step, in the largest sizes that are allowed."""
    a = problem.assembly
    rods = [own_share(problem, i, guess.own[:, i], step.own[:, i]) for i in range(a.rods)]
    place = np.hypot(step.pose[:, 0], step.pose[:, 1]) / (PLACE_STEP * a.length.min())
    return np.asarray(np.max([*rods, place, np.abs(step.pose[:, 2]) / PHI_STEP], axis=0))


def solve_guesses(
    problem: RodProblem,
    guess: RodGuess,
    rule: StepRule,
    tolerance: float,
    most_force: float = np.inf,
) -> tuple[RodGuess, NDArray[np.bool_], float]:
    """States to which Newton's method leads, whether it converged, and the least residual [1].

    Guesses are given up where a force exceeds `most_force` [EI/L^2 of the rod].
    """
    own, pose = guess.own.copy(), guess.pose.copy()
    a, active, converged = problem.assembly, np.arange(len(guess)), np.zeros(len(guess), bool)
    unit, least = a.stiffness / a.length**2, np.inf
    for _ in range(MAX_ROD_NEWTON_STEPS):
        if not active.size:
            break
        here = RodGuess(own[active], pose[active])
        step = newton_step(problem, here, rule)
        share = step_share(problem, here, step)
        least = min(least, float(np.nanmin(step.residual, initial=np.inf)))
        part = np.maximum(share, 1.0)[:, None]
        own[active] += step.own / part[..., None]
        pose[active] += step.pose / part
        converged[active] = share < tolerance
        force = np.hypot(own[active, :, 0], own[active, :, 1]) / unit
        going = np.isfinite(share) & (force.max(axis=1) < most_force)
        active = active[going & ~converged[active]]
    return RodGuess(own, pose), converged, least
