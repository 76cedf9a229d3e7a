"""Dry friction in the joints of a balancer: its equilibria in the order of the angles.

In the pendulum's frame, with psi, e, D, c and A as in `proofmass.analytic.balancer.path`, the chain
is in equilibrium where::

    D^T (M(e) + R) + A^T lambda = 0,     c = 0,
    e_i as it was (stuck)  or  R_i = +-tau_i (slipping)

R_i is the friction of joint i against a growing deflection.  The module
`proofmass.analytic.friction` finds which joints stick and slip between two angles.
"""

from typing import Any, NamedTuple

import numpy as np

from proofmass.analytic.balancer.model import Balancer
from proofmass.analytic.balancer.nearby import (
    MAX_NEARBY_CORRECTION,
    BalancerNumbers,
    balancer_of,
    numbers_of,
)
from proofmass.analytic.balancer.path import Path, deflections, rest_posture
from proofmass.analytic.friction import PathEnds, SlipProblem, follow_stick_slip
from proofmass.analytic.remember import reuse_nearby
from proofmass.base.arrays import Array

MAX_SLIP_STRIDE = 0.05
"""Longest move of the pendulum in one stride [rad]."""
MAX_WAY = 0.01
"""Longest way between two places where the state of the joints is examined [rad]: a joint that
begins and ends to slip, or to stick, within it is not noticed."""
MIN_SLIP_STRIDE = 1e-4
"""Stride that is not halved any more [rad]: the path has come to a fold."""
MAX_SLIP_CORRECTION = 0.05
"""Largest correction by Newton's method [rad]: a larger one could be another branch."""
SLIP_STEP_TOLERANCE = 1e-10
"""Length of the last Newton step [rad]; the error is of the order of its square."""
MAX_SLIP_NEWTON_STEPS = 12
"""Largest number of Newton steps."""
ROW_RANK_TOLERANCE = 1e-11
"""Share of the largest singular value below which rows depend on others."""
MIN_STABLE_STIFFNESS = 1e-9
"""Smallest stiffness of a stable equilibrium, as a share of the largest."""
NEARBY_MARGIN = 1e-4
"""Largest violation of a joint's state [1] in a chain that goes through the events of another one:
where parameters differ by 1e-6, an event at another angle violates a state by some 1e-6."""
PathRows = list[tuple[Array, ...]]
"""The quantities of a path with friction, see `ChainWithFriction.values`."""
NOTHING_SLIPS = (
    "dry friction holds the whole chain: no joint slips over the angles that are asked for; give "
    "less friction, or a wider motion"
)


class ChainSlopes(NamedTuple):
    """Spring moments and derivatives of the chain at a pose.

    Attributes
    ----------
    deflection, moment, spring : ndarray (n,)
        Deflection from rest [rad], moment [N m] and stiffness [N m/rad] of each spring.
    stiffness : ndarray (n, n)
        Stiffness matrix of the chain by psi [N m/rad].
    loop : ndarray (2, n)
        Jacobian A of the loop [m].
    """

    deflection: Array
    moment: Array
    spring: Array
    stiffness: Array
    loop: Array


ChainPose = tuple[float, Array, Array]
"""Pendulum angle [rad], segments' angles (n,) [rad] and force at the tip (2,) [N]."""


class SlipEvent(NamedTuple):
    """A change of the joints between sticking and slipping: where, and the new senses [1]."""

    at: ChainPose
    senses: Array


class SlipHistory(NamedTuple):
    """How a chain with friction came to its angles.

    Attributes
    ----------
    alpha : ndarray (A,)
        The angles [rad].
    events : list of list of SlipEvent
        The events on the way to each angle.
    poses : list of ChainPose
        The pose at each angle.
    """

    alpha: Array
    events: list[list[SlipEvent]]
    poses: list[ChainPose]


class ChainWithFriction:
    """The chain of one balancer at rest, without stops and with dry friction in some joints.

    Parameters
    ----------
    b : Balancer
        A batch of one.
    friction : ndarray (n,)
        Friction tau of each joint [N m].
    """

    def __init__(self, b: Balancer, friction: Array):
        n = b.segments
        self.b, self.rubbing = b, np.flatnonzero(friction)
        self.bound, self.friction = friction[self.rubbing], np.zeros(n)
        self.turns = np.eye(n) - np.eye(n, k=-1)
        self.alpha, self.psi, self.pull = 0.0, rest_posture(b).unknowns[0, :n], np.zeros(2)
        self.senses, self.is_at_start = np.ones(self.rubbing.size), True
        self.stuck, self.fixed = self.rubbing[:0], np.zeros(0)
        self.events: list[SlipEvent] = []
        self.known, self.known_at = self._slopes(), self.kept()

    def at(self) -> Array:
        """The pendulum's angle [rad] (1,)."""
        return np.array([self.alpha])

    def kept(self) -> ChainPose:
        """Copy the pose: pendulum angle, segments' angles and force at the tip."""
        return self.alpha, self.psi, self.pull

    def back(self, kept: ChainPose) -> None:
        """Return to a pose that `kept` has copied."""
        self.alpha, self.psi, self.pull = kept

    def go(self, values: Array) -> None:
        """Follow the equilibrium to another angle in the present state of the joints.

        A stride that fails is halved.
        """
        to, longest = float(values[0]), MAX_SLIP_STRIDE
        while True:
            kept, way = self.kept(), to - self.alpha
            count = int(np.ceil(abs(way) / longest)) or 1
            try:
                self.stride(self.alpha + way / count if count > 1 else to)
            except PathEnds:
                longest = 0.5 * abs(way) / count
                if longest < MIN_SLIP_STRIDE:
                    raise
                self.back(kept)
                continue
            if count == 1:
                return
            longest = min(1.5 * longest, MAX_SLIP_STRIDE)

    def stride(self, alpha: float) -> None:
        """Find the equilibrium at an angle by Newton's method, from the end of the tangent."""
        _, matrix, alpha_derivative = self.system()
        self.move(-self.solve_linear(matrix, alpha_derivative) * (alpha - self.alpha))
        self.alpha = alpha
        if not (self.settle() < MAX_SLIP_CORRECTION and self.stable()):
            raise PathEnds(
                f"at {np.degrees(alpha):.4f} deg the equilibrium ends at a fold, where the chain "
                "jumps"
            )

    def move(self, step: Array) -> float:
        """Add a step to angles and force, and return its longest rotation [rad]."""
        n = self.psi.size
        self.psi, self.pull = self.psi + step[:n], self.pull + step[n : n + 2]
        return float(np.abs(step[:n]).max())

    def settle(self) -> float:
        """Find the equilibrium at the present angle by Newton's method from the present pose.

        Returns the length of its way [rad]; infinite if it finds none.
        """
        moved = 0.0
        for _ in range(MAX_SLIP_NEWTON_STEPS):
            residual, matrix, _ = self.system()
            size = self.move(-self.solve_linear(matrix, residual))
            moved += size
            if size < SLIP_STEP_TOLERANCE:
                return moved
        return np.inf

    def slopes(self) -> ChainSlopes:
        """Moments and stiffness at the present pose; cached until the pose changes."""
        here = self.kept()
        if any(one is not other for one, other in zip(here, self.known_at, strict=True)):
            self.known, self.known_at = self._slopes(), here
        return self.known

    def _slopes(self) -> ChainSlopes:
        b = self.b
        e = deflections(b, np.array([self.alpha]), self.psi[None])[0]
        east, north = b.length[0] * np.sin(self.psi), b.length[0] * np.cos(self.psi)
        bend = np.diag(self.pull[0] * east + self.pull[1] * north)
        spring = np.asarray(b.slopes(e[None])[0])
        stiffness = self.turns.T @ (spring[:, None] * self.turns) - bend
        return ChainSlopes(e, b.moments(e[None])[0], spring, stiffness, np.array([north, -east]))

    def system(self) -> tuple[Array, Array, Array]:
        """Residual, Newton's matrix and the residual's derivative by alpha, at the present pose."""
        n = self.psi.size
        e, moment, spring, stiffness, loop = self.slopes()
        rows = np.concatenate([loop, self.turns[self.stuck]])
        load = self.turns.T @ (moment + self.friction) + loop.T @ self.pull
        north, west = loop.sum(axis=1)
        gap = [-west, north - self.b.pendulum[0], *(e[self.stuck] - self.fixed)]
        matrix = np.zeros((n + len(rows), n + len(rows)))
        matrix[:n, :n], matrix[:n, n:], matrix[n:, :n] = stiffness, rows.T, rows
        alpha_derivative = np.zeros(len(matrix))
        alpha_derivative[0] = spring[0]
        alpha_derivative[n + 2 :] = self.stuck == 0
        return np.concatenate([load, gap]), matrix, alpha_derivative

    def solve_linear(self, matrix: Array, right: Array) -> Array:
        """Solve by the smallest solution, since the rows of stuck joints may be dependent."""
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=ROW_RANK_TOLERANCE)[0], float)

    def stable(self) -> bool:
        """Whether the energy has a minimum in the motions that stuck joints leave free."""
        _, _, _, stiffness, loop = self.slopes()
        free_motions = null_space(np.vstack([loop, self.turns[self.stuck]]))
        least = np.linalg.eigvalsh(free_motions @ stiffness @ free_motions.T).min(initial=np.inf)
        return bool(least > MIN_STABLE_STIFFNESS * np.abs(stiffness).max())

    def problem(self, way: Array) -> SlipProblem:
        """Set up the present equilibrium in coordinates of its free motions, without friction."""
        _, moment, spring, stiffness, loop = self.slopes()
        free, own, step = null_space(loop), self.rubbing, float(way[0])
        return SlipProblem(
            free @ (self.turns.T @ moment),
            free @ stiffness @ free.T,
            free[:, 0] * spring[0] * step,
            self.turns[own] @ free.T,
            (own == 0) * step,
            self.bound,
        )

    def enter(self, senses: Array) -> None:
        """Let joints stick where they are, or slip, from now on.

        The force at the tip, and the stiffness with it, are those of the new friction.
        """
        self.events.append(SlipEvent(self.kept(), senses))
        self.senses, self.is_at_start = senses, False
        self.stuck = self.rubbing[senses == 0]
        deflection, moment, _, _, loop = self.slopes()
        self.fixed = deflection[self.stuck]
        self.friction = np.zeros(self.psi.size)
        self.friction[self.rubbing] = senses * self.bound
        rows, load = np.vstack([loop, self.turns[self.stuck]]), moment + self.friction
        self.pull = self.solve_linear(rows.T, -self.turns.T @ load)[:2]

    def rub(self, way: Array) -> Array:
        """Friction of all joints (n,) while the pendulum moves along a way [N m]."""
        found = np.zeros(self.psi.size)
        if not self.is_at_start:
            rate = self.problem(way).solve_state(self.senses)
            assert rate is not None
            found[self.rubbing] = rate.friction
        return found

    def worst_margin(self, way: Array) -> float:
        """The smallest margin of a joint's state [1], see `SlipProblem.margins`."""
        return float(self.problem(way).margins(self.senses).min(initial=np.inf))

    def values(self, way: Array) -> tuple[Array, ...]:
        """The quantities of a path at the present pose, and the friction of all joints.

        The force at the tip is from then on that of this friction.
        """
        joint_friction = self.rub(way)
        deflection, moment, _, _, loop = self.slopes()
        load = self.turns.T @ (moment + joint_friction)
        self.pull = np.asarray(np.linalg.lstsq(loop.T, -load, rcond=None)[0], float)
        _, matrix, alpha_derivative = self.system()
        rate = 1.0 - self.solve_linear(matrix, alpha_derivative)[: self.psi.size]
        return self.psi + self.alpha, deflection, moment, rate, self.pull, joint_friction


def null_space(rows: Array) -> Array:
    """Basis of the null space of rows (free, n): the motions that the constraints leave free."""
    _, sizes, ways = np.linalg.svd(rows)
    return np.asarray(ways[int((sizes > ROW_RANK_TOLERANCE * sizes.max()).sum()) :])


def follow_with_friction(b: Balancer, friction: Array, alpha: Array) -> tuple[Path, Array]:
    """Find equilibria with friction at pendulum angles, in their order, and the friction there.

    Parameters
    ----------
    b : Balancer
        A batch of one, without stops.
    friction : ndarray (n,)
        Friction tau of each joint [N m].
    alpha : ndarray (A,)
        Pendulum angles [rad]; at the first one the chain is in equilibrium without friction.

    Returns
    -------
    Path
    ndarray (A, n)
        Friction R of each joint [N m].

    Raises
    ------
    ValueError
        The balancer has stops or extends; no joint slips against its friction; the path ends at a
        fold.

    Notes
    -----
    A balancer whose parameters differ little from one that is known (`nearby`) goes through the
    events of that one.  Where a slipping joint comes to rest, its deflection is stationary: another
    angle of the event, which differs as little, changes the deflection at which it sticks by the
    square of the difference.
    """
    if b.stopped:
        raise ValueError(
            f"friction and stops (preload, low, high of joint {b.stopped[0] + 1}) are not covered "
            "together; give one of the two"
        )
    if b.extension1.any() or b.extension2.any():
        raise ValueError("friction and a pendulum that extends are not covered together")
    numbers = numbers_of(b), tuple(friction.tolist()), tuple(alpha.tolist())
    known, history, rows = known_slips(*numbers)
    if known != numbers:
        again = None
        if np.array_equal(history.alpha, alpha):
            again = follow_again(ChainWithFriction(b, friction), history)
        rows = again or follow_slips(ChainWithFriction(b, friction), alpha)[1]
    theta, deflection, moment, rate, force, joint_friction = map(np.array, zip(*rows, strict=True))
    energy = b.energies(deflection[None])[0]
    side = np.zeros_like(theta)
    parts = (part[None] for part in (theta, deflection, moment, energy, rate, force, side))
    return Path(alpha, *parts), joint_friction


@reuse_nearby
def known_slips(
    chain: BalancerNumbers, friction: tuple[float, ...], alpha: tuple[float, ...]
) -> tuple[tuple[Any, ...], SlipHistory, PathRows]:
    """The way of a chain with friction, or of one nearby whose way is known, and its numbers."""
    body = ChainWithFriction(balancer_of(chain), np.array(friction))
    return (chain, friction, alpha), *follow_slips(body, np.array(alpha))


def follow_slips(chain: ChainWithFriction, alpha: Array) -> tuple[SlipHistory, PathRows]:
    """Follow a chain with friction through pendulum angles (A,) [rad]."""
    way, rows, history = np.ones(1), list[tuple[Array, ...]](), SlipHistory(alpha, [], [])
    chain.go(alpha[:1])
    has_slipped = False
    for angle in alpha:
        way = np.sign(angle - chain.at()) if angle != chain.alpha else way
        count = int(np.ceil(abs(angle - chain.alpha) / MAX_WAY)) if rows else 0
        for place in np.linspace(chain.alpha, angle, count + 1)[1:]:
            follow_stick_slip(chain, np.array([place]))
        has_slipped |= bool(chain.senses[chain.rubbing > 0].any()) and not chain.is_at_start
        history.poses.append(chain.kept())
        history.events.append(chain.events)
        chain.events = []
        rows.append(chain.values(way))
    if alpha.size > 2 and not has_slipped and (chain.rubbing > 0).any():
        raise ValueError(NOTHING_SLIPS)
    return history, rows


def follow_again(chain: ChainWithFriction, known: SlipHistory) -> PathRows | None:
    """Follow a chain through the events of one nearby; None where its events are others."""
    way, rows = np.ones(1), list[tuple[Array, ...]]()
    for pose, events in zip(known.poses, known.events, strict=True):
        before = chain.alpha
        for at, senses in events:
            chain.back(at)
            if not chain.settle() < MAX_NEARBY_CORRECTION:
                return None
            chain.enter(senses)
        chain.back(pose)
        if not chain.settle() < MAX_NEARBY_CORRECTION:
            return None
        way = np.sign(pose[0] - np.array([before])) if pose[0] != before and rows else way
        if not (chain.is_at_start or chain.worst_margin(way) >= -NEARBY_MARGIN):
            return None
        rows.append(chain.values(way))
    return rows
