r"""Static equilibrium of a balancer's chain, and the path of equilibria from the rest posture.

The equations are written in the pendulum's frame.  With psi the segments' angles from the pendulum,
e = D psi + alpha (1, 0, ..) - e0 the deflections and c(psi) = sum l_i u(psi_i) - (0, r) the loop,
where r may change with alpha, the energy is stationary under loop and stops::

    D^T M(e) + A^T lambda - S^T mu = 0,     c = 0,     e_j = bound_j or mu_j = 0

A = dc/dpsi; S selects the joints with stops.  lambda is the force of the chain on the pendulum's
tip, mu_j the moment of a stop on its joint, positive if it winds the joint up.  Newton's matrix is

    [ D^T M' D - diag(l_i lambda.u(psi_i))   A^T   -S^T ]
    [ A                                       0      0  ]
    [ -S or 0                                 0    0 or 1 ]

In these coordinates the matrix is regular for a chain stretched between its ends, and singular at a
fold of the path.

A path follows the equilibria from the rest posture; stops switch at their exact angles.  For the
equilibrium at any pendulum angle the path's strides are interpolated, and Newton's method starts
from the result.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.balancer.model import Balancer
from proofmass.base.arrays import Array

Indices = NDArray[Any]
PATH_STEP_TOLERANCE = 1e-9
"""Length of the last Newton step [rad]; the error is of the order of its square."""
MAX_NEWTON_STEPS = 12
"""Largest number of Newton steps."""
MAX_STRIDE = 0.1
"""Largest stride of the pendulum between two nodes of a path [rad]."""
MIN_PATH_STRIDE = 1e-7
"""Stride that is not halved any more [rad]: the path has come to a fold."""
MAX_CORRECTION = 0.03
"""Largest correction by Newton's method [rad]: a larger one could be another branch."""
MAX_BACKWARD_ERROR = 0.1
"""Largest error [rad] of the tangent at the end of a stride where the stride begins: with a larger
one, next to a fold, the interpolation of the stride is no start for Newton's method."""
SWITCH_TOLERANCE = 1e-12
"""Tolerance of the margin at which a stop switches [rad, N m]."""
UNREACHABLE = "the segments cannot reach the tip, or a spring not carry or release its preload"
UNSTABLE = "the rest posture is an unstable equilibrium"
MAX_SWITCHES = 30
"""Largest number of stops that a path leaves or meets before it is given up."""


@dataclass(frozen=True)
class Point:
    """Equilibria, one for each of a batch.

    Attributes
    ----------
    alpha : ndarray (B,)
        Pendulum angle, clockwise from the upright [rad].
    unknowns : ndarray (B, n + 2 + s)
        psi [rad], lambda [N] and mu [N m]; s is the number of joints with stops.
    side : ndarray (B, s)
        [1]: -1 where the joint is on its lower stop, +1 on its upper one, 0 between them.
    """

    alpha: Array
    unknowns: Array
    side: Array

    def __getitem__(self, which: Indices) -> "Point":
        return Point(self.alpha[which], self.unknowns[which], self.side[which])

    def put(self, which: Indices, other: "Point") -> None:
        """Replace some of the batch."""
        self.alpha[which], self.unknowns[which] = other.alpha, other.unknowns
        self.side[which] = other.side

    def ahead(self, way: Array, along: Array) -> "Point":
        """Extrapolate by steps `way` (B,) of alpha, with derivatives `along` of the unknowns."""
        return Point(self.alpha + way, self.unknowns + way[:, None] * along, self.side)

    @staticmethod
    def join(points: Sequence["Point"]) -> "Point":
        """Join several batches to one."""
        alpha, unknowns, side = zip(*((p.alpha, p.unknowns, p.side) for p in points), strict=True)
        return Point(np.concatenate(alpha), np.concatenate(unknowns), np.concatenate(side))


def subset(b: Balancer, which: NDArray[np.int_]) -> Balancer:
    """Select balancers by rising numbers; if these are all, the batch itself without a copy."""
    return b if which.size == len(b) else b[which]


def deflections(b: Balancer, alpha: Array, psi: Array) -> Array:
    """Deflections (B, n) of all springs from rest [rad]."""
    rotation = psi - b.rest
    e = rotation.copy()
    e[..., 1:] -= rotation[..., :-1]
    e[..., 0] += alpha
    return np.asarray(e)


def stop_deflections(b: Balancer, side: Array) -> Array:
    """Deflection of each joint that is on a stop (B, s) [rad]; 0 for a joint between its stops."""
    j = list(b.stopped)
    with np.errstate(invalid="ignore"):
        return np.where(side < 0, b.low[:, j], np.where(side > 0, b.high[:, j], 0.0))


def system(b: Balancer, p: Point) -> tuple[Array, Array]:
    """Residual (B, N) and Newton's matrix (B, N, N) of the equilibrium."""
    n, j = b.segments, list(b.stopped)
    psi, force, stop = p.unknowns[:, :n], p.unknowns[:, n : n + 2], p.unknowns[:, n + 2 :]
    e = deflections(b, p.alpha, psi)
    moment, slope = b.moments(e), b.slopes(e)
    east, north = b.length * np.sin(psi), b.length * np.cos(psi)
    held = (p.side != 0).astype(float)
    load = moment.copy()
    load[:, j] -= stop
    # differences of moments, and sums of stiffnesses, of each joint and the next one
    joint_residual, joint_stiffness = load.copy(), slope.copy()
    joint_residual[:, :-1] -= load[:, 1:]
    joint_stiffness[:, :-1] += slope[:, 1:]
    residual = np.concatenate(
        [
            joint_residual + force[:, :1] * north - force[:, 1:] * east,
            np.stack([east.sum(-1), north.sum(-1) - b.reach(p.alpha)], axis=-1),
            np.where(held > 0, stop_deflections(b, p.side) - e[:, j], stop) if j else stop,
        ],
        axis=-1,
    )
    matrix = np.zeros((*residual.shape, residual.shape[-1]))
    i = np.arange(n)
    matrix[:, i, i] = joint_stiffness - force[:, :1] * east - force[:, 1:] * north
    matrix[:, i[1:], i[:-1]] = matrix[:, i[:-1], i[1:]] = -slope[:, 1:]
    matrix[:, n, i] = matrix[:, i, n] = north
    matrix[:, n + 1, i] = matrix[:, i, n + 1] = -east
    for k, joint in enumerate(j):
        row = n + 2 + k
        matrix[:, joint, row], matrix[:, joint - 1, row] = -1.0, 1.0
        matrix[:, row, joint], matrix[:, row, joint - 1] = -held[:, k], held[:, k]
        matrix[:, row, row] = 1.0 - held[:, k]
    return residual, matrix


def find_equilibria(b: Balancer, p: Point) -> tuple[Point, Array]:
    """Find equilibria by Newton's method from `p` at the same angles and stops.

    The array has the lengths of the moves of the segments (B,) [rad], NaN where it failed.
    """
    unknowns, moved = p.unknowns.copy(), np.zeros(len(b))
    active = np.arange(len(b))
    for _ in range(MAX_NEWTON_STEPS):
        residual, matrix = system(
            subset(b, active), Point(p.alpha[active], unknowns[active], p.side[active])
        )
        step = -solve_linear(matrix, residual)
        unknowns[active] += step
        size = np.abs(step[:, : b.segments]).max(axis=-1)
        moved[active] += size
        active = active[~(size < PATH_STEP_TOLERANCE)]
        if not active.size:
            break
        active = active[moved[active] < 2.0]
    moved[active] = np.nan
    moved[~(moved < 2.0)] = np.nan
    return Point(p.alpha, unknowns, p.side), moved


def tangent(b: Balancer, p: Point) -> tuple[Array, Indices]:
    """Derivatives of the unknowns by alpha (B, N), and whether the equilibrium is stable (B,).

    An equilibrium on the path is stable while the determinant of Newton's matrix has the sign that
    it has at a minimum of the energy: that of (-1)^(number of joints on stops).
    """
    _, matrix = system(b, p)
    residual_by_alpha = np.zeros_like(p.unknowns)  # derivative of the residual by alpha
    e = deflections(b, p.alpha, p.unknowns[:, : b.segments])
    residual_by_alpha[:, 0] = b.slopes(e)[:, 0]
    residual_by_alpha[:, b.segments + 1] = -b.stretch(p.alpha)
    with np.errstate(invalid="ignore"):  # an equilibrium that was not found (NaN) is not stable
        sign = np.linalg.slogdet(matrix)[0] * (-1.0) ** (p.side != 0).sum(axis=-1)
    return -solve_linear(matrix, residual_by_alpha), np.asarray(sign > 0)


def solve_linear(matrix: Array, right: Array) -> Array:
    """Solve ``matrix x = right`` for each of a batch; NaN where a matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])
    except np.linalg.LinAlgError:
        out = np.full_like(right, np.nan)
        for k in np.flatnonzero(np.linalg.det(matrix) != 0.0):
            out[k] = np.linalg.solve(matrix[k], right[k])
        return out


def stable_at_rest(b: Balancer, p: Point) -> Indices:
    """Whether the rest posture is a minimum of the energy (B,), by the inertia of the matrix."""
    _, matrix = system(b, p)
    held = (p.side != 0).sum(axis=-1)
    return np.asarray((np.linalg.eigvalsh(matrix) < 0).sum(axis=-1) == 2 + held)


def rest_posture(b: Balancer) -> Point:
    """The rest posture: pendulum upright, deflections zero, preloads carried by their stops.

    If joint 3 leaves its stop whatever its spring's moment (`Balancer.loose`), a force along the
    pendulum carries its preload.
    """
    j, n = list(b.stopped), b.segments
    low, high = b.low[:, j] == 0, b.high[:, j] == 0
    side = np.where(low, -1, np.where(high, 1, 0))
    unknowns = np.concatenate([b.rest, np.zeros((len(b), 2)), b.preload[:, j]], axis=-1)
    if n - 1 in j:
        free = (b.loose != 0) & (side[:, -1] != 0)
        east = b.length[free, -1] * np.sin(b.rest[free, -1])
        unknowns[free, n + 1] = b.preload[free, -1] / east
        unknowns[free, -1] = side[free, -1] = 0
    return Point(np.zeros(len(b)), unknowns, side)


def is_wound_at_rest(b: Balancer, p: Point) -> Indices:
    """Whether a spring without a stop has a moment in the rest posture (B,): it is none then."""
    has_moment = b.preload != 0.0
    has_moment[:, list(b.stopped)] &= p.side == 0
    return np.asarray(has_moment.any(axis=-1) & (b.loose == 0))


def switching_margins(b: Balancer, p: Point) -> Array:
    """Margin of each joint with stops (B, s) before it switches; negative beyond that.

    For a joint between its stops it is the distance to the nearer one [rad], for a joint on a stop
    the moment with which the stop pushes [N m].
    """
    j, n = list(b.stopped), b.segments
    e, push = deflections(b, p.alpha, p.unknowns[:, :n])[:, j], p.unknowns[:, n + 2 :]
    way = np.minimum(e - b.low[:, j], b.high[:, j] - e)
    return np.where(p.side == 0, way, -p.side * push)


def margin_rates(b: Balancer, p: Point, along: Array) -> Array:
    """Derivatives (B, s) of `switching_margins` by alpha, from those of the unknowns."""
    j, n = list(b.stopped), b.segments
    turning = np.diff(along[:, :n], axis=-1, prepend=0.0)[:, j]
    held = p.side != 0
    return np.where(held, -p.side * along[:, n + 2 :], -nearest_stops(b, p) * turning)


def hides_switch(b: Balancer, here: Point, there: Point, out: Array, into: Array) -> Indices:
    """Whether a joint may have switched twice within strides (B,), so that they are too long.

    The margin of such a joint is below zero at the end although it does not fall all the way, or it
    is below zero in between: the cubic through its values and slopes at both ends has a minimum
    there.
    """
    width = (there.alpha - here.alpha)[:, None]
    first, last = switching_margins(b, here), switching_margins(b, there)
    begins, ends = margin_rates(b, here, out) * width, margin_rates(b, there, into) * width
    beyond = last < -SWITCH_TOLERANCE
    turns_back = beyond & (np.maximum(begins, ends) > SWITCH_TOLERANCE)
    dips = ~beyond & (begins < 0.0) & (ends > 0.0)
    square, cube = 3.0 * (last - first) - 2.0 * begins - ends, begins + ends - 2.0 * (last - first)
    with np.errstate(all="ignore"):  # where the margin does not dip, or no equilibrium was found
        at = -begins / (square + np.sqrt(square**2 - 3.0 * cube * begins))
        least = first + at * (begins + at * (square + at * cube))
    return np.asarray((turns_back | dips & (least < -SWITCH_TOLERANCE)).any(axis=-1))


def nearest_stops(b: Balancer, p: Point) -> Array:
    """The nearer stop of each joint with stops (B, s): -1 the lower one, +1 the upper one."""
    j = list(b.stopped)
    e = deflections(b, p.alpha, p.unknowns[:, : b.segments])[:, j]
    return np.where(e - b.low[:, j] <= b.high[:, j] - e, -1, 1)


@dataclass(frozen=True)
class Strides:
    """Strides of all paths, ordered by design and angle; stops do not switch within a stride.

    Attributes
    ----------
    design : ndarray (K,)
        Number in the batch.
    start, end : Point
        Both ends of each of the K strides.
    out, into : ndarray (K, N)
        Derivatives of the unknowns by alpha [SI] at the start and at the end.
    """

    design: Indices
    start: Point
    end: Point
    out: Array
    into: Array


@dataclass(frozen=True)
class BalancerPaths:
    """Paths of a batch, as far as they could be followed.

    Attributes
    ----------
    pieces : Strides
        Strides of the paths.
    switches : list of (design, joint, alpha, side)
        Joint number `joint` (from 1) of that design meets its lower (-1) or upper (+1) stop at
        alpha [rad], or leaves its stop (0).
    reach : ndarray (B,)
        Pendulum angle up to which each path is known [rad].
    why : list of str
        Reason why a path ended early; "" if it did not.
    """

    pieces: Strides
    switches: list[tuple[int, int, float, int]]
    reach: Array
    why: list[str]


def follow(b: Balancer, to: float, stride: float = MAX_STRIDE) -> BalancerPaths:
    """Follow the equilibria of a batch from rest to a pendulum angle.

    Each path has strides of its own along its tangent, corrected by Newton's method.  A stride is
    halved if the correction is large, if the equilibrium is unstable or not found, if the tangent
    at its end does not lead back, or if a joint may have switched twice in it.  A path whose
    strides vanish has come to a fold, where the chain would jump.

    Parameters
    ----------
    b : Balancer
    to : float
        Last pendulum angle [rad], of either sign.
    stride : float
        Largest stride [rad].
    """
    follower = PathFollower(b, to, stride)
    while follower.is_going.any():
        follower.step()
    return follower.paths()


class PathFollower:
    """Follows the paths of a batch: their present points, tangents and strides."""

    def __init__(self, b: Balancer, to: float, stride: float):
        self.b, self.to, self.sense, self.longest = b, to, -1.0 if to < 0 else 1.0, stride
        self.at, self.stride = rest_posture(b), np.full(len(b), stride)
        self.out, self.switched = np.zeros_like(self.at.unknowns), np.zeros(len(b), int)
        self.why = np.full(len(b), UNREACHABLE, dtype=object)
        there = np.flatnonzero(np.isfinite(b.rest + b.stiffness).all(axis=-1))
        if (wound := there[is_wound_at_rest(b[there], self.at[there])]).size:
            self.at.put(wound, find_equilibria(b[wound], self.at[wound])[0])
        stable = stable_at_rest(b[there], self.at[there])
        self.why[there] = np.where(stable, "", UNSTABLE)
        self.is_going = np.array([not why and to != 0 for why in self.why])
        self.out[self.is_going] = tangent(b[self.is_going], self.at[self.is_going])[0]
        self.switches: list[tuple[int, int, float, int]] = []
        self.kept: list[tuple[Indices, Point, Point, Array, Array]] = []

    def step(self) -> None:
        """Take one stride of every path that has not ended."""
        k = np.flatnonzero(self.is_going)
        b, here, out = subset(self.b, k), self.at[k], self.out[k]
        alpha_step = self.sense * np.minimum(self.stride[k], np.abs(self.to - here.alpha))
        there, moved = find_equilibria(b, here.ahead(alpha_step, out))
        into, stable = tangent(b, there)
        backward = there.ahead(here.alpha - there.alpha, into).unknowns - here.unknowns
        accepted = (
            stable
            & (moved < MAX_CORRECTION)
            & (np.abs(backward[:, : b.segments]).max(axis=-1) < MAX_BACKWARD_ERROR)
            & ~hides_switch(b, here, there, out, into)
        )
        self.shorten(k[~accepted])
        switches_stop = accepted & (switching_margins(b, there) < -SWITCH_TOLERANCE).any(axis=-1)
        free = accepted & ~switches_stop
        self.keep(k[free], here[free], there[free], out[free], into[free])
        self.stride[k[free]] = np.minimum(1.5 * self.stride[k[free]], self.longest)
        if switches_stop.any():
            self.switch(
                k[switches_stop], here[switches_stop], there[switches_stop], out[switches_stop]
            )
        self.is_going[k[self.sense * (self.to - self.at.alpha[k]) <= 0]] = False

    def shorten(self, k: Indices) -> None:
        """Halve the strides of some paths; end those that have come to a fold."""
        self.stride[k] /= 2
        for i in k[self.stride[k] < MIN_PATH_STRIDE]:
            self.end(i, "the equilibrium ends at a fold, where the chain jumps")

    def end(self, i: int, why: str) -> None:
        """End a path early."""
        self.is_going[i] = False
        self.why[i] = f"at {np.degrees(self.at.alpha[i]):.4f} deg {why}"

    def keep(self, k: Indices, here: Point, there: Point, out: Array, into: Array) -> None:
        """Record strides that were good, and make their ends the present points."""
        self.kept.append((k, here, there, out, into))
        self.at.put(k, there)
        self.out[k] = into

    def switch(self, k: Indices, here: Point, there: Point, out: Array) -> None:
        """Go to the point in a stride at which the first stop is left or met, and switch it."""
        b = self.b[k]
        event, joint = find_first_switch(b, here, there)
        into = tangent(b, event)[0]
        self.keep(k, here, event, out, into)
        row = np.arange(len(k))
        side = event.side.copy()
        side[row, joint] = np.where(side[row, joint] != 0, 0, nearest_stops(b, event)[row, joint])
        self.at.side[k] = side
        self.out[k] = tangent(b, self.at[k])[0]
        self.switched[k] += 1
        for i, j, s in zip(k, joint, side[row, joint], strict=True):
            self.switches.append((int(i), b.stopped[j] + 1, float(self.at.alpha[i]), int(s)))
            if self.switched[i] > MAX_SWITCHES:
                self.end(i, "a joint rattles on its stop")

    def paths(self) -> BalancerPaths:
        """Collect the recorded strides in order of design and angle."""
        none = np.zeros(0, int)
        kept = [(none, self.at[none], self.at[none], self.out[none], self.out[none]), *self.kept]
        design, start, end, out, into = zip(*kept, strict=True)
        which, first, last = np.concatenate(design), Point.join(start), Point.join(end)
        order = np.lexsort((self.sense * last.alpha, which))
        order = order[(first.alpha != last.alpha)[order]]
        pieces = Strides(
            which[order],
            first[order],
            last[order],
            np.concatenate(out)[order],
            np.concatenate(into)[order],
        )
        return BalancerPaths(
            pieces,
            sorted(self.switches, key=lambda s: (s[0], self.sense * s[2])),
            self.at.alpha,
            list(self.why),
        )


def find_first_switch(b: Balancer, here: Point, there: Point) -> tuple[Point, Indices]:
    """Find the first switching of a stop between two equilibria, and its index in `b.stopped`.

    Newton's method is applied to the margin as a function of alpha, from the zero of its chord.
    """
    row, width = np.arange(len(b)), there.alpha - here.alpha
    old, new = np.maximum(switching_margins(b, here), 0.0), switching_margins(b, there)
    share = np.where(
        new < -SWITCH_TOLERANCE, old / np.where(new < -SWITCH_TOLERANCE, old - new, 1.0), np.inf
    )
    joint = share.argmin(axis=-1)
    first = share[row, joint]
    guess = here.unknowns + first[:, None] * (there.unknowns - here.unknowns)
    p = Point(here.alpha + first * width, guess, here.side)
    for _ in range(8):
        p = find_equilibria(b, p)[0]
        along = tangent(b, p)[0]
        margin = switching_margins(b, p)[row, joint]
        if (np.abs(margin) < SWITCH_TOLERANCE / 10).all():
            break
        slope = margin_rates(b, p, along)[row, joint]
        move = np.where(slope != 0, -margin / np.where(slope != 0, slope, 1.0), 0.0)
        low, high = np.minimum(here.alpha, there.alpha), np.maximum(here.alpha, there.alpha)
        p = p.ahead(np.clip(p.alpha + move, low, high) - p.alpha, along)
    return p, joint


@dataclass(frozen=True)
class Path:
    """Equilibria (B, A) of a batch at A pendulum angles; NaN beyond a path's end.

    Attributes
    ----------
    alpha : ndarray (A,)
        Pendulum angle, clockwise from the upright [rad].
    theta, deflection, moment, energy : ndarray (B, A, n)
        Angle of each segment from the upright [rad]; deflection from rest [rad], moment [N m] and
        energy [J] of each spring.
    rate : ndarray (B, A, n)
        dtheta/dalpha [1].
    force : ndarray (B, A, 2)
        Force of the chain on the pendulum's tip, in the pendulum's frame: across, to the side of
        growing alpha, and along it [N].
    side : ndarray (B, A, n)
        -1 or +1 where a joint is on its lower or upper stop, else 0 [1].
    """

    alpha: Array
    theta: Array
    deflection: Array
    moment: Array
    energy: Array
    rate: Array
    force: Array
    side: Array


def balancing_moment(b: Balancer, path: Path) -> Array:
    """Balancing moment dV*/dalpha (B, A) [N m]: M1, less f dr/dalpha if the pendulum extends."""
    stretch = b.stretch(path.alpha[:, None]).T
    return np.asarray(path.moment[..., 0] - path.force[..., 1] * stretch)


@dataclass(frozen=True)
class PathEquilibria:
    """Equilibria of a batch at pendulum angles, as Newton's method found them from its paths.

    Attributes
    ----------
    alpha : ndarray (A,)
        Pendulum angles [rad].
    reached : ndarray (B A,)
        Whether the path of each balancer reaches each angle [1].
    each : Balancer
        The balancer of each of the K angles that are reached.
    point : Point
        The K equilibria.
    moved : ndarray (K,)
        Lengths of the moves of the segments by Newton's method [rad]; NaN where it failed.
    rates : ndarray (K, N)
        Derivatives of the unknowns by alpha [SI].
    stable : ndarray (K,)
        Whether the equilibria are stable [1].
    """

    alpha: Array
    reached: Indices
    each: Balancer
    point: Point
    moved: Array
    rates: Array
    stable: Indices


def along(b: Balancer, paths: BalancerPaths, alpha: Array) -> Path:
    """Find the equilibria at pendulum angles on the side to which the paths were followed.

    Newton's method starts from a cubic interpolation of the strides.
    """
    return as_path(equilibria_along(b, paths, np.asarray(alpha, float)))


def equilibria_along(b: Balancer, paths: BalancerPaths, alpha: Array) -> PathEquilibria:
    """The equilibria that Newton's method finds from the paths; see `along`."""
    count, width = len(b), alpha.size
    design, angle = np.repeat(np.arange(count), width), np.tile(alpha, count)
    reach = np.where(np.isfinite(b.rest).all(axis=-1), np.abs(paths.reach), -1.0)
    reached = np.abs(angle) <= np.repeat(reach, width) * (1 + 1e-15)
    each = b[design[reached]]
    start = interpolate_strides(paths, design[reached], angle[reached])
    point, moved = find_equilibria(each, start)
    return PathEquilibria(alpha, reached, each, point, moved, *tangent(each, point))


def as_path(found: PathEquilibria) -> Path:
    """The quantities of equilibria; NaN beyond the end of a path."""
    each, alpha, point = found.each, found.alpha, found.point
    n, j = each.segments, list(each.stopped)
    psi = point.unknowns[:, :n]
    e = deflections(each, point.alpha, psi)
    side = np.zeros((len(psi), n))
    side[:, j] = point.side

    def spread(values: Array) -> Array:
        out = np.full((found.reached.size, values.shape[-1]), np.nan)
        out[found.reached] = values
        return out.reshape(-1, alpha.size, values.shape[-1])

    return Path(
        alpha,
        spread(psi + point.alpha[:, None]),
        spread(e),
        spread(each.moments(e)),
        spread(each.energies(e)),
        spread(1.0 + found.rates[:, :n]),
        spread(point.unknowns[:, n : n + 2]),
        spread(side),
    )


def interpolate_strides(paths: BalancerPaths, design: NDArray[np.int_], angle: Array) -> Point:
    """Interpolate strides at angles (K,) of designs (K,) by cubic Hermite polynomials."""
    pieces = paths.pieces
    sense = np.sign(pieces.end.alpha.sum()) or 1.0
    key = 10.0 * pieces.design + sense * pieces.end.alpha
    k = np.minimum(np.searchsorted(key, 10.0 * design + sense * angle), len(key) - 1)
    start, end = pieces.start[k], pieces.end[k]
    width = end.alpha - start.alpha
    t = ((angle - start.alpha) / width)[:, None]
    out, into = pieces.out[k] * width[:, None], pieces.into[k] * width[:, None]
    gap = end.unknowns - start.unknowns
    curve = start.unknowns + t * (out + t * (3 * gap - 2 * out - into + t * (out + into - 2 * gap)))
    return Point(angle, curve, start.side)
