r"""Rods that are integrated from their tips: precurved, with couples along them, or heavy.

::

      clamp            s   <---- sigma = L - s    tip   n, m_L
     _|/________________________________________.--->
      |\  theta_0                          theta_L

    theta' = m/EI + u0,   m' = N_x sin(theta) - N_y cos(theta) - l,   N(s) = n + w (L - s)

u0 is the natural curvature of the rod, l a couple and w a dead load per length.  With the moment
M = m - l (L - s), which equals m at the tip, the couple is a natural curvature that changes along
the rod::

    theta' = M/EI + u0 + l (L - s)/EI,   M' = N_x sin(theta) - N_y cos(theta)

so that a rod with a couple has the equilibria, the energy (but for the constant l L theta_0) and
the stability of a rod whose natural curvature is linear.  A rod is determined by the wrench on its
tip and the tip's angle; these are coordinates of all equilibria of the rod, without seams.  From
the tip, errors do not grow in a pinned rod under tension.

Here all rods have the length 1 and the stiffness 1.  The steps are those of `equilibrium`: with
theta and sigma fixed, M and the position change linearly; with these fixed, theta changes.
Source: J. Pérez Gámiz, TFG, UPV/EHU Bilbao 2018, eqs 24-30 and 77, with u0 and l; its examples have
neither.
"""

from dataclasses import dataclass

import numpy as np

from proofmass.analytic.rods.equilibrium import HINGE_SHARES, SEGMENT_SHARES
from proofmass.base.arrays import Array, Complex


@dataclass(frozen=True)
class LinkRule:
    """Steps that are rigid links: the rod is replaced by a chain with springs in its hinges.

    ::

        clamp |--o----o----o----o--  tip       springs EI/h at h/2, 3h/2, ..., half links at both
                   h                           ends; loads in the middles of the links

    Attributes
    ----------
    count : int
        Number of springs.
    """

    count: int


StepRule = tuple[float, float] | int | LinkRule
"""Steps of a rod, and steps for each unit of sqrt(N + M^2/4); or their number; or links."""
FINE_STEPS = 4.0, 2.5
"""The rule of an error of 1e-11 of the length."""
ROUGH_STEPS = 1.0, 0.35
"""The rule of a search: an error of 1e-5 of the length for sqrt(N) to 6, of 1e-3 to 12."""
ZERO_VALUE = 1e-8
"""Curvature [1/L] or field [1] that counts as zero, as of a straight rod: 1000 times the error of
fine steps."""
NODE_ROUNDING = 1e-9
"""Share of a step that is rounding."""
MAX_TIP_STEPS = 300
"""Largest number of steps; rods that need more are inaccurate, which their closure shows."""


@dataclass(frozen=True)
class NaturalRods:
    """Rods (...) of unit length and stiffness: natural curvature at the tip, its slope, weight.

    Attributes
    ----------
    curvature : ndarray (...)
        Natural curvature at the tip, u0 [1/L].
    slope : ndarray (...)
        Increase of the natural curvature from the tip to the clamp, by couples, l L^2/EI [1/L].
    weight : ndarray of complex (...)
        Dead load per length, x + iy [EI/L^3].
    """

    curvature: Array
    slope: Array
    weight: Complex


@dataclass(frozen=True)
class TippedRods:
    """Clamps of rods (n,) that are integrated from their tips.

    Attributes
    ----------
    base : ndarray of complex (5, n)
        Position of the clamp from the tip [L], and its derivatives by n_x, n_y, m_L and theta_L.
    angle : ndarray (5, n)
        Tangent at the clamp [rad], and its derivatives.
    moment : ndarray (5, n)
        M at the clamp [EI/L], and its derivatives; the rod's own moment there is M + l L.
    """

    base: Complex
    angle: Array
    moment: Array


@dataclass(frozen=True)
class RodPath:
    """Rods (n,) at nodes from the tip to the clamp.

    Attributes
    ----------
    position : ndarray of complex (nodes, n)
        From the tip [L].
    angle, moment, curvature, field : ndarray (nodes, n)
        Tangent [rad]; m [EI/L]; theta' [1/L]; Jacobi field, the derivative of the tangent by that
        of the tip at a constant wrench [1].
    """

    position: Complex
    angle: Array
    moment: Array
    curvature: Array
    field: Array

    @property
    def inflections(self) -> Array:
        """Number of changes of sign of the curvature between tip and clamp (n,)."""
        return np.asarray(sign_changes(self.curvature))

    @property
    def negative(self) -> Array:
        """Number of negative directions of the rod's potential with a free tip (n,)."""
        return np.asarray(sign_changes(self.field))


def sign_changes(values: Array) -> Array:
    """Number of changes of sign (n,) along the first axis of values; zeros are passed over."""
    sign = np.where(np.abs(values) < ZERO_VALUE, 0.0, np.sign(values))
    for row in range(1, len(sign)):
        sign[row] = np.where(sign[row] == 0.0, sign[row - 1], sign[row])
    return np.asarray((sign[1:] * sign[:-1] < 0.0).sum(axis=0))


def step_count(rods: NaturalRods, force: Complex, moment: Array, rule: StepRule) -> int:
    """Number of steps that the most bent rod of a batch needs, at most `MAX_TIP_STEPS`."""
    if isinstance(rule, int):
        return rule
    if isinstance(rule, LinkRule):
        return rule.count
    bend = np.abs(moment) + np.abs(rods.curvature) + np.abs(rods.slope)
    rate = np.sqrt(np.abs(force) + np.abs(rods.weight) + bend**2 / 4.0)
    return int(min(np.ceil(rule[0] + rule[1] * np.nanmax(rate, initial=0.0)), MAX_TIP_STEPS))


class TipMarch:
    """The state of rods on their way from the tip, with derivatives if they are asked for."""

    def __init__(
        self, rods: NaturalRods, force: Complex, moment: Array, angle: Array, slopes: bool
    ):
        self.rods, self.force, self.slopes, n = rods, force, slopes, force.size
        self.angle, self.moment = np.array(angle, float), np.array(moment, float)
        self.position: Complex = np.zeros(n, complex)
        self.way = 0.0
        if slopes:
            self.turns, self.bends = np.zeros((4, n)), np.zeros((4, n))
            self.moves: Complex = np.zeros((4, n), complex)
            self.turns[3] = self.bends[2] = 1.0

    def turn(self, step: float) -> None:
        """Turn by the curvature along a step, with the moment fixed."""
        natural = self.rods.curvature + self.rods.slope * (self.way + step / 2.0)
        self.angle -= step * (self.moment + natural)
        if self.slopes:
            self.turns -= step * self.bends
        self.way += step

    def go(self, step: float, more: float | Array = 0.0) -> None:
        """Go straight ahead along a step; the moment changes by the force's lever.

        The force is that of the rod beyond, and the weight along `more` [L].
        """
        ahead: Complex = step * np.exp(1j * self.angle)  # type: ignore[assignment]
        load = np.conj(self.force + self.rods.weight * (self.way + more))
        self.position -= ahead
        bend = load * ahead
        self.moment -= bend.imag
        if self.slopes:
            self.moves -= 1j * ahead * self.turns
            self.bends -= bend.real * self.turns
            self.bends[0] -= ahead.imag
            self.bends[1] += ahead.real

    def step(self, size: float) -> None:
        """Take a step of sixth order."""
        for share, along in zip(HINGE_SHARES, SEGMENT_SHARES, strict=False):
            self.turn(share * size)
            self.go(along * size)
        self.turn(HINGE_SHARES[-1] * size)

    def link(self, size: float, more: float | Array = 0.0) -> None:
        """Go over half a link, a hinge, and half of the next link, see `LinkRule`.

        The weight of the first half is that of the whole link, whose middle lies at its tip; of
        the half link at the tip of a rod a quarter of a link lies beyond, which is `more` [L].
        """
        self.go(size / 2.0, more)
        self.turn(size)
        self.go(size / 2.0)


def march_from_tip(
    rods: NaturalRods,
    force: Complex,
    moment: Array,
    angle: Array,
    *,
    rule: StepRule = FINE_STEPS,
    length: float = 1.0,
    slopes: bool = True,
    is_tip: bool | Array = True,
) -> TippedRods:
    """Clamps of rods (n,) under a wrench on their tips, with derivatives if asked for.

    Parameters
    ----------
    rods : NaturalRods (n,) or (1,)
    force, moment, angle : on the tip, x + iy [EI/L^2], [EI/L]; the tip's tangent [rad]; (n,)
    rule : of the number of steps, such as `FINE_STEPS` and `ROUGH_STEPS`
    length : how far to go from the tip [L]
    slopes : whether to find the derivatives
    is_tip : of bool, whether the first link of a chain is the half link at the tip [1]  (n,)

    Examples
    --------
    A rod that is naturally a circle, without load:

    >>> circle = NaturalRods(np.array([2 * np.pi]), np.zeros(1), np.zeros(1, complex))
    >>> found = march_from_tip(circle, np.zeros(1, complex), np.zeros(1), np.zeros(1))
    >>> bool(abs(found.base[0, 0]) < 1e-10), round(float(found.angle[0, 0]), 9)
    (True, -6.283185307)
    """
    march = TipMarch(rods, force, moment, angle, slopes)
    count = step_count(rods, force, moment, rule)
    for k in range(count):
        if isinstance(rule, LinkRule):
            march.link(length / count, length / count / 4.0 * is_tip if k == 0 else 0.0)
        else:
            march.step(length / count)
    base: Complex = march.position[None]
    angle, bend = march.angle[None], march.moment[None]
    if slopes:
        base = np.concatenate([base, march.moves])
        angle = np.concatenate([angle, march.turns])
        bend = np.concatenate([bend, march.bends])
    return TippedRods(base, angle, bend)


def path_from_tip(
    rods: NaturalRods, force: Complex, moment: Array, angle: Array, nodes: int | Array
) -> RodPath:
    """Rods (n,) at nodes from their tips to their clamps; see `march_from_tip`.

    Nodes are a number of equally spaced ones, or rising distances from the tip [L].
    """
    march = TipMarch(rods, force, moment, angle, True)
    count = step_count(rods, force, moment, FINE_STEPS)
    places = np.linspace(0.0, 1.0, nodes) if isinstance(nodes, int) else nodes
    rows = []
    for way in np.diff(places, prepend=0.0):
        steps = int(np.ceil(count * way - NODE_ROUNDING))
        for _ in range(steps):
            march.step(way / steps)
        couple = rods.slope * march.way
        curvature = march.moment + rods.curvature + couple
        rows.append(
            (
                march.position.copy(),
                march.angle.copy(),
                march.moment + couple,
                curvature,
                march.turns[3].copy(),
            )
        )
    return RodPath(*(np.array(part) for part in zip(*rows, strict=True)))
