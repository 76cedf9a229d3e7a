"""Equilibria followed from the rest posture, stops switching at their exact angles.

A path gives the equilibrium at any pendulum angle: its steps are interpolated, and the result is
brought to equilibrium by Newton's method.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.balancer.equilibrium import (
    Point,
    Which,
    at_rest,
    margins,
    nearest,
    solve,
    stable_at_rest,
    tangent,
    windings,
)
from proofmass.analytic.balancer.model import Balancer
from proofmass.analytic.numerics import Array

STRIDE = 0.1  # [rad] of the pendulum between two nodes of a path, at most
NARROW = 1e-7  # [rad] a stride so short that does not get on ends at a fold
STRAY = 0.03  # [rad] that Newton may move off the tangent: more could be another branch
SURE = 1e-12  # [rad, N m] how exactly a stop's switching is met
UNREACHABLE = "the segments cannot reach the tip, or a spring not carry its preload"
UNSTABLE = "the rest posture is an unstable equilibrium"
SWITCHES = 30  # stops left and met by a path before it is given up


@dataclass(frozen=True)
class Pieces:
    """Strides of all paths, in order of design and angle; each has one set of held stops.

    Attributes
    ----------
    design : ndarray (K,)
        Which of the batch.
    start, end : Point
        Both ends of each of the K strides.
    out, into : ndarray (K, N)
        Change of the unknowns with alpha [SI] at its start and at its end.
    """

    design: Which
    start: Point
    end: Point
    out: Array
    into: Array


@dataclass(frozen=True)
class BalancerPaths:
    """Paths of a batch, as far as they could be followed.

    Attributes
    ----------
    pieces : Pieces
    switches : list of (design, joint, alpha, side)
        Joint number `joint` (from 1) of that design meets its lower (-1) or upper (+1) stop at
        alpha [rad], or leaves its stop (0).
    reach : ndarray (B,)
        Pendulum angle up to which each path is known [rad].
    why : list of str
        Why a path ended early; "" where it did not.
    """

    pieces: Pieces
    switches: list[tuple[int, int, float, int]]
    reach: Array
    why: list[str]


def follow(b: Balancer, to: float, stride: float = STRIDE) -> BalancerPaths:
    """Follow the equilibria of a batch from rest to a pendulum angle.

    Each path goes by its own strides along its tangent, corrected by Newton's method; a stride is
    halved where the correction is large, the equilibrium unstable or lost, and a path whose
    strides vanish has come to a fold, where the chain would jump.

    Parameters
    ----------
    b : Balancer
    to : float
        Last pendulum angle [rad], of either sign.
    stride : float
        Largest stride [rad].
    """
    walk = PathWalk(b, to, stride)
    while walk.going.any():
        walk.step()
    return walk.trail()


class PathWalk:
    """Where each path stands, and how far its next stride goes."""

    def __init__(self, b: Balancer, to: float, stride: float):
        self.b, self.to, self.sense, self.longest = b, to, -1.0 if to < 0 else 1.0, stride
        self.at, self.stride = at_rest(b), np.full(len(b), stride)
        self.out, self.switched = np.zeros_like(self.at.unknowns), np.zeros(len(b), int)
        self.why = np.full(len(b), UNREACHABLE, dtype=object)
        there = np.flatnonzero(np.isfinite(b.rest + b.stiffness).all(axis=-1))
        stable = stable_at_rest(b[there], self.at[there])
        self.why[there] = np.where(stable, "", UNSTABLE)
        self.going = np.array([not why and to != 0 for why in self.why])
        self.out[self.going] = tangent(b[self.going], self.at[self.going])[0]
        self.switches: list[tuple[int, int, float, int]] = []
        self.kept: list[tuple[Which, Point, Point, Array, Array]] = []

    def step(self) -> None:
        """One stride of every path that is not at its end."""
        k = np.flatnonzero(self.going)
        b, here, out = self.b[k], self.at[k], self.out[k]
        h = self.sense * np.minimum(self.stride[k], np.abs(self.to - here.alpha))
        there, moved = solve(b, here.ahead(h, out))
        into, stable = tangent(b, there)
        good = stable & (moved < STRAY)
        self.shorten(k[~good])
        over = good & (margins(b, there) < -SURE).any(axis=-1)
        free = good & ~over
        self.keep(k[free], here[free], there[free], out[free], into[free])
        self.stride[k[free]] = np.minimum(1.5 * self.stride[k[free]], self.longest)
        if over.any():
            self.switch(k[over], here[over], there[over], out[over])
        self.going[k[self.sense * (self.to - self.at.alpha[k]) <= 0]] = False

    def shorten(self, k: Which) -> None:
        """Halve the strides of some paths; end those that have come to a fold."""
        self.stride[k] /= 2
        for i in k[self.stride[k] < NARROW]:
            self.end(i, "the equilibrium ends at a fold, where the chain jumps")

    def end(self, i: int, why: str) -> None:
        """End a path before its time."""
        self.going[i] = False
        self.why[i] = f"at {np.degrees(self.at.alpha[i]):.4f} deg {why}"

    def keep(self, k: Which, here: Point, there: Point, out: Array, into: Array) -> None:
        """Keep strides that were good and stand at their ends."""
        self.kept.append((k, here, there, out, into))
        self.at.put(k, there)
        self.out[k] = into

    def switch(self, k: Which, here: Point, there: Point, out: Array) -> None:
        """Go to the first stop that is left or met within a stride, and switch it there."""
        b = self.b[k]
        event, joint = meet(b, here, there)
        into = tangent(b, event)[0]
        self.keep(k, here, event, out, into)
        row = np.arange(len(k))
        side = event.side.copy()
        side[row, joint] = np.where(side[row, joint] != 0, 0, nearest(b, event)[row, joint])
        self.at.side[k] = side
        self.out[k] = tangent(b, self.at[k])[0]
        self.switched[k] += 1
        for i, j, s in zip(k, joint, side[row, joint], strict=True):
            self.switches.append((int(i), b.stopped[j] + 1, float(self.at.alpha[i]), int(s)))
            if self.switched[i] > SWITCHES:
                self.end(i, "a joint rattles on its stop")

    def trail(self) -> BalancerPaths:
        """All that was kept, in order."""
        none = np.zeros(0, int)
        kept = [(none, self.at[none], self.at[none], self.out[none], self.out[none]), *self.kept]
        design, start, end, out, into = zip(*kept, strict=True)
        which, first, last = np.concatenate(design), Point.join(start), Point.join(end)
        order = np.lexsort((self.sense * last.alpha, which))
        order = order[(first.alpha != last.alpha)[order]]
        pieces = Pieces(
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


def meet(b: Balancer, here: Point, there: Point) -> tuple[Point, Which]:
    """The first switching of a stop between two equilibria, and its place among the stops.

    Newton's method on the margin as a function of alpha, begun at the chord's zero.
    """
    row, width = np.arange(len(b)), there.alpha - here.alpha
    old, new = np.maximum(margins(b, here), 0.0), margins(b, there)
    share = np.where(new < -SURE, old / np.where(new < -SURE, old - new, 1.0), np.inf)
    joint = share.argmin(axis=-1)
    first = share[row, joint]
    guess = here.unknowns + first[:, None] * (there.unknowns - here.unknowns)
    p = Point(here.alpha + first * width, guess, here.side)
    for _ in range(8):
        p = solve(b, p)[0]
        along = tangent(b, p)[0]
        margin = margins(b, p)[row, joint]
        if (np.abs(margin) < SURE / 10).all():
            break
        eps = 1e-6
        slope = (margins(b, p.ahead(np.full(len(b), eps), along))[row, joint] - margin) / eps
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
    theta, winding, moment, energy : ndarray (B, A, n)
        Of each segment or spring: angle from the upright, winding from rest [rad], moment [N m]
        and energy [J].
    rate : ndarray (B, A, n)
        dtheta/dalpha [1].
    force : ndarray (B, A, 2)
        Force of the chain on the pendulum's tip, in the pendulum's frame: across, to the side of
        growing alpha, and along it [N].
    side : ndarray (B, A, n)
        [1]: -1, +1 where a joint is on its lower or upper stop, else 0.
    """

    alpha: Array
    theta: Array
    winding: Array
    moment: Array
    energy: Array
    rate: Array
    force: Array
    side: Array


def along(b: Balancer, trail: BalancerPaths, alpha: Array) -> Path:
    """The path at pendulum angles of the side that the trail was followed to.

    A cubic through both ends of a stride, and Newton's method from there.
    """
    alpha = np.asarray(alpha, float)
    count, width = len(b), alpha.size
    design, angle = np.repeat(np.arange(count), width), np.tile(alpha, count)
    reach = np.where(np.isfinite(b.rest).all(axis=-1), np.abs(trail.reach), -1.0)
    known = np.abs(angle) <= np.repeat(reach, width) * (1 + 1e-15)
    each = b[design[known]]
    found, _ = solve(each, guess(trail, design[known], angle[known]))
    rates, _ = tangent(each, found)
    n, j = b.segments, list(b.stopped)
    psi = found.unknowns[:, :n]
    e = windings(each, found.alpha, psi)
    side = np.zeros((len(psi), n))
    side[:, j] = found.side

    def spread(values: Array) -> Array:
        out = np.full((count * width, values.shape[-1]), np.nan)
        out[known] = values
        return out.reshape(count, width, values.shape[-1])

    return Path(
        alpha,
        spread(psi + found.alpha[:, None]),
        spread(e),
        spread(each.moments(e)),
        spread(each.energies(e)),
        spread(1.0 + rates[:, :n]),
        spread(found.unknowns[:, n : n + 2]),
        spread(side),
    )


def guess(trail: BalancerPaths, design: NDArray[np.int_], angle: Array) -> Point:
    """Cubic Hermite interpolation (K,) of the strides that hold the angles; rest at angle 0."""
    pieces = trail.pieces
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
