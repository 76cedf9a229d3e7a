"""Stick and slip of joints with dry friction along a path of equilibria.

An engine or a reference finds the equilibria, through the protocol `MechanismWithFriction`.

At rest the friction R of a joint lies between its two bounds, so that the pose depends on how it
was reached.  A joint sticks, and stays where it is with any R between the bounds, or it slips, and
R is the bound against its motion.  Between two events all joints keep their state; an event is a
place where a stuck joint's friction reaches its bound, or where a slipping joint stops.  Let N be
the free motions of a pose with closed loops and fixed drives, P a motion of the drives, E the rows
of the joints with friction, f the forces that the pose needs and K their derivative::

    N' f + (E N)' R = 0                        the pose is an equilibrium
    N' K (N y + P) + (E N)' R' = 0             it remains one while the drives move on
    stuck:   |R| <= bound,   E (N y + P) = 0
    slipping: R = sense bound,   sense E (N y + P) >= 0

(A. Mielke, F. Theil, On rate-independent hysteresis models, NoDEA 11 (2004) 151-189, sections 2, 3:
energetic solutions of elastic bodies with dry friction.)
"""

from dataclasses import dataclass
from itertools import product
from typing import Any, Protocol

import numpy as np

from proofmass.base.arrays import Array

MAX_FRICTION_JOINTS = 6
"""Largest number of joints with friction: at an event, up to 3^6 states are tried."""
EVENT_MARGIN = 1e-9
"""Margin beyond an event at which a state ends [1]: more than rounding of slopes."""
MAX_STATE_VIOLATION = 1e-5
"""Largest violation of a state that may be chosen [1]: the places of events are not exact."""
YIELD_SHARE = 1e-6
"""A stuck joint may begin to slip within this share of its bound."""
FRICTION_GROWTH_STEP = 1e-3
"""Growth of friction, as a share of the bounds, over which its change is evaluated."""
EVENT_RESOLUTION = 1e-13
"""Share of the way between two samples to which an event is located."""
DEAD_POINT_SHARE = 1e-6
"""Share of the largest motion: a joint that moves less is at a dead point."""
DRIVE_ROUNDING = 1e-12
"""Rounding of the values of the drives [rad or m]."""
STUCK_RANK_TOLERANCE = 1e-9
"""Share of the largest singular value below which stuck joints depend on each other."""
MAX_SLIP_EVENTS = 100
"""Largest number of events between two samples."""


NOTHING_SLIPS = (
    "dry friction of joint {} holds all that the drives leave, so that nothing slips in the whole "
    "sweep: give less friction, or a wider motion"
)


class PathEnds(ValueError):
    """The path of equilibria ends; the message says why."""


@dataclass(frozen=True)
class SlipSolution:
    """Friction and motion of the joints in one state of sticking and slipping.

    Attributes
    ----------
    friction : ndarray (joints,)
        Friction R of each joint that equilibrium requires [N m or N].
    rate : ndarray (joints,)
        Rates of the joints by the way of the drives [SI].
    fastest : float
        Largest of these rates and of those of the free motions [SI].
    growth : float
        Fastest growth of the friction of stuck joints that have reached their bounds, over the
        largest that is possible [1].
    residual : float
        Force that is left at the pose in this state, as a share of the bounds [1].
    """

    friction: Array
    rate: Array
    fastest: float
    growth: float
    residual: float


@dataclass(frozen=True)
class SlipProblem:
    """An equilibrium in coordinates of its free motions, without the forces of friction.

    The free motions are unit vectors.

    Attributes
    ----------
    force : ndarray (free,)
        N' f [SI].
    stiffness, coupling : ndarray (free, free), (free,)
        N' K N and N' K P [SI].
    turn, lead : ndarray (joints, free), (joints,)
        E N and E P: motion of the joints with the free motions and with the drives [SI].
    bound : ndarray (joints,)
        The largest friction of each joint [N m or N].
    """

    force: Array
    stiffness: Array
    coupling: Array
    turn: Array
    lead: Array
    bound: Array

    def solve_state(self, senses: Array) -> SlipSolution | None:
        """Solve for friction and motion where joints of sense 0 stick.

        None if these joints cannot all stick, or if the stiffness is singular.
        """
        stuck = senses == 0
        stuck_rows, lead, free = self.turn[stuck], self.lead[stuck], self.force.size
        _, sizes, ways = np.linalg.svd(stuck_rows)
        rank = int((sizes > STUCK_RANK_TOLERANCE * np.abs(self.turn).max(initial=0.0)).sum())
        motion = (
            -np.linalg.lstsq(stuck_rows, lead, rcond=STUCK_RANK_TOLERANCE)[0]
            if rank
            else np.zeros(free)
        )
        if np.abs(stuck_rows @ motion + lead).max(initial=0.0) > STUCK_RANK_TOLERANCE * np.abs(
            self.lead
        ).max(initial=0.0):
            return None
        free_rows = ways[rank:]
        try:
            pull = free_rows @ (self.coupling + self.stiffness @ motion)
            motion -= np.linalg.solve(free_rows @ self.stiffness @ free_rows.T, pull) @ free_rows
        except np.linalg.LinAlgError:
            return None
        needed = -self.force - self.turn.T @ (senses * self.bound)
        growth = -self.coupling - self.stiffness @ motion
        size = float((np.abs(self.turn).T @ self.bound).max(initial=0.0)) or 1.0
        fastest = np.abs(self.coupling).max(initial=0.0) + np.abs(self.stiffness).sum() * np.abs(
            motion
        ).max(initial=0.0)
        growth_step = FRICTION_GROWTH_STEP * size / (float(fastest) or 1.0)
        friction = senses * self.bound
        friction[stuck] = share_friction(stuck_rows, self.bound[stuck], needed)
        share, largest_growth = np.abs(friction) / self.bound, 0.0
        if (share[stuck] >= 1.0 - YIELD_SHARE).any():
            later = np.abs(
                share_friction(stuck_rows, self.bound[stuck], needed + growth_step * growth)
            )
            increase = later / self.bound[stuck] - share[stuck]
            largest_growth = min(
                float(increase[share[stuck] >= 1.0 - YIELD_SHARE].max()) / FRICTION_GROWTH_STEP, 1.0
            )
        # a joint at its dead point has no effect: there rounding is compared with the bounds
        size = max(size, float(self.bound.max(initial=0.0)))
        residual = np.abs(self.force + self.turn.T @ friction).max(initial=0.0) / size
        rate = self.lead + self.turn @ motion
        fastest_motion = float(np.abs(np.concatenate([rate, motion])).max(initial=0.0))
        return SlipSolution(friction, rate, fastest_motion, largest_growth, float(residual))

    def margins(self, senses: Array) -> Array:
        """Distance of each joint from the two ends of its state (2, joints), negative beyond them.

        A stuck joint's state ends at its two bounds, and the distances are shares of the bound.  A
        slipping joint's state ends where the joint stops; the distance is its rate as a share of
        that of the fastest joint or free motion.
        """
        found = self.solve_state(senses)
        return np.full((2, senses.size), -1.0) if found is None else self._margins_of(senses, found)

    def _margins_of(self, senses: Array, found: SlipSolution) -> Array:
        """`margins` of a state whose friction and motion are found."""
        share = found.friction / self.bound
        slip = senses * found.rate / (found.fastest or 1.0)
        return np.where(senses == 0, [1.0 - share, 1.0 + share], [slip, slip])

    def state_violation(self, senses: Array) -> float:
        """Largest violation of the conditions of a state [1]; infinite if it has no solution."""
        found = self.solve_state(senses)
        if found is None:
            return np.inf
        smallest_margin = self._margins_of(senses, found).min(initial=0.0)
        return float(max(-smallest_margin, found.growth, found.residual))

    def choose(self, senses: Array, may_stay: bool) -> Array:
        """Choose the next state: of all whose conditions are met the one with most stuck joints.

        Of several such states it is the one that changes fewest joints.  A joint does not begin to
        stick at its dead point, see `sticks_at_dead_point`.

        Parameters
        ----------
        senses : ndarray (joints,)
            The present state: senses of slipping joints, 0 of stuck ones [1].
        may_stay : bool
            Whether the present state may be chosen again; otherwise it has ended.

        Raises
        ------
        PathEnds
            No state meets its conditions.
        """
        options = [np.array(one) for one in product((0.0, 1.0, -1.0), repeat=senses.size)]
        if not may_stay:
            options = [
                one
                for one in options
                if not (np.array_equal(one, senses) or self.sticks_at_dead_point(senses, one))
            ]
        violations = np.array([self.state_violation(one) for one in options])
        slipping_joints = np.array([np.abs(one).sum() for one in options])
        changed_share = np.array([(one != senses).mean() for one in options])
        best = int(
            np.argmin(
                np.where(
                    violations < MAX_STATE_VIOLATION,
                    slipping_joints + 0.5 * changed_share,
                    slipping_joints.size + violations,
                )
            )
        )
        if not violations[best] < MAX_STATE_VIOLATION:
            raise PathEnds("no combination of sticking and slipping joints goes on from here")
        return options[best]

    def sticks_at_dead_point(self, senses: Array, later: Array) -> bool:
        """Whether a joint that slips would begin to stick at its dead point.

        There it does not move with the free motions that are left by the joints that stay stuck.
        Its friction has no effect on these motions, and it passes the turning point of its own
        motion without a stop.

        Parameters
        ----------
        senses, later : ndarray (joints,)
            The present and a later state: senses of slipping joints, 0 of stuck ones [1].
        """
        stuck_rows = self.turn[(senses == 0) & (later == 0)]
        held = np.linalg.pinv(stuck_rows, rcond=STUCK_RANK_TOLERANCE) @ stuck_rows
        moves = np.abs(self.turn - self.turn @ held).max(axis=1, initial=0.0)
        at_dead_point = moves < DEAD_POINT_SHARE * max(np.abs(self.turn).max(initial=0.0), 1.0)
        return bool((at_dead_point & (senses != 0) & (later == 0)).any())


def share_friction(stuck_rows: Array, bound: Array, needed: Array) -> Array:
    """Divide a force that is needed among the frictions of stuck joints (joints,).

    Of joints that depend on each other only the total effect is determined.  They share it such
    that the largest share of a bound is as small as possible.

    Parameters
    ----------
    stuck_rows : ndarray (joints, free)
        Motion of the stuck joints with the free motions [SI].
    bound : ndarray (joints,)
        Largest friction of each joint [N m or N].
    needed : ndarray (free,)
        Force on the free motions [SI].
    """
    if not stuck_rows.size:
        return np.zeros(bound.size)
    pushes = (stuck_rows * bound[:, None]).T
    smallest_shares, _, rank, _ = np.linalg.lstsq(pushes, needed, rcond=STUCK_RANK_TOLERANCE)
    if rank == 1:  # all frictions act in one direction
        along = pushes[np.abs(pushes).max(axis=1).argmax()]
        smallest_shares = np.sign(along) * (along @ smallest_shares / np.abs(along).sum())
    elif rank < bound.size:
        smallest_shares = minimize_largest_share(pushes, np.asarray(smallest_shares, float))
    return np.asarray(smallest_shares * bound)


def minimize_largest_share(matrix: Array, shares: Array) -> Array:
    """Find shares (joints,) with the same effect as given ones, whose largest is smallest."""
    from scipy.optimize import linprog  # slow to load

    n, pushed = shares.size, matrix @ shares
    scale = float(np.abs(shares).max())
    if not scale:
        return shares
    sides = np.block([[np.eye(n), -np.ones((n, 1))], [-np.eye(n), -np.ones((n, 1))]])
    found = linprog(
        np.append(np.zeros(n), 1.0),
        sides,
        np.zeros(2 * n),
        np.column_stack([matrix, np.zeros(len(matrix))]),
        pushed / scale,
        [(None, None)] * (n + 1),
    )
    rough, largest = found.x[:n], found.x[n]
    at_maximum = np.abs(rough) > (1.0 - 1e-6) * largest  # solved once more, to rounding
    columns = np.column_stack(
        [matrix[:, at_maximum] @ np.sign(rough[at_maximum]), matrix[:, ~at_maximum]]
    )
    exact = np.linalg.lstsq(columns, pushed, rcond=STUCK_RANK_TOLERANCE)[0]
    level = np.sign(rough) * exact[0]
    level[~at_maximum] = exact[1:]
    return np.asarray(level)


class MechanismWithFriction(Protocol):
    """A mechanism at rest whose free joints have dry friction; each engine implements it.

    Attributes
    ----------
    senses : ndarray (joints,)
        Senses in which the joints slip; 0 for joints that stick [1].
    is_at_start : bool
        Whether the drives have not moved yet, so that all friction is zero.
    """

    senses: Array
    is_at_start: bool

    def at(self) -> Array:
        """Values of the drives [rad or m]."""

    def kept(self) -> Any:
        """Copy the present pose, for `back`."""

    def back(self, kept: Any) -> None:
        """Return to a pose that `kept` has copied."""

    def go(self, values: Array) -> None:
        """Find the equilibrium at new values of the drives in the same state; or `PathEnds`."""

    def problem(self, way: Array) -> SlipProblem:
        """Set up the present equilibrium, with the drives about to move along a way."""

    def enter(self, senses: Array) -> None:
        """Let joints stick where they are, or slip, from now on."""


def follow_stick_slip(body: MechanismWithFriction, values: Array) -> None:
    """Follow the equilibrium to new values of the drives, through all events on the straight way.

    Raises
    ------
    PathEnds
        The path of equilibria ends, or joints stick and slip in turn without an end.
    """
    begin = body.at()
    way = values - begin
    if not np.abs(way).max(initial=0.0) > DRIVE_ROUNDING:
        body.go(values)
        return
    problem = body.problem(way)
    margins = None if body.is_at_start else problem.margins(body.senses)
    if margins is None or (margins < -EVENT_MARGIN).any():
        body.enter(problem.choose(body.senses, True))
        margins = body.problem(way).margins(body.senses)
    done = 0.0
    for _ in range(MAX_SLIP_EVENTS):
        done = go_to_event(body, begin, way, done, margins)
        if done == 1.0:
            return
        body.enter(body.problem(way).choose(body.senses, False))
        margins = body.problem(way).margins(body.senses)
    raise PathEnds("joints stick and slip in turn without an end")


def go_to_event(
    body: MechanismWithFriction, begin: Array, way: Array, done: float, margins_at_low: Array
) -> float:
    """Go to the end of a way, or to its next event, and return the share of the way.

    `margins_at_low` has the margins of the joints where the way begins.
    """
    kept, low, high, failure = body.kept(), done, 1.0, None

    def margins_at(share: float) -> Array:
        nonlocal failure
        try:
            body.go(begin + share * way)
        except PathEnds as error:  # an event may come before it
            failure = error
            return np.full((2, body.senses.size), -1.0)
        return body.problem(way).margins(body.senses)

    margins_at_high, side = margins_at(1.0), 0
    if (margins_at_high >= -EVENT_MARGIN).all():
        return 1.0
    while high - low > EVENT_RESOLUTION:
        first = np.unravel_index(margins_at_high.argmin(), margins_at_high.shape)
        near = bool(margins_at_low[first] <= EVENT_MARGIN)
        if near and low > done:
            break
        # secant method, with a bisection after several steps to one side: a margin may jump
        secant = margins_at_low[first] / (margins_at_low[first] - margins_at_high[first])
        share = 0.5 if near or abs(side) > 2 else float(secant)
        middle = low + (high - low) * min(max(share, 1e-3), 1.0 - 1e-3)
        if not low < middle < high:
            break
        body.back(kept)
        margins = margins_at(middle)
        if (margins >= -EVENT_MARGIN).all():
            low, kept, margins_at_low, side = middle, body.kept(), margins, max(side, 0) + 1
        else:
            high, margins_at_high, side = middle, margins, min(side, 0) - 1
    body.back(kept)
    if failure and margins_at_low.min() > MAX_STATE_VIOLATION:
        raise failure
    return low
