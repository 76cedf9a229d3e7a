r"""Coupler points of many linkages at once, and their derivatives, in complex numbers.

::

    four-bar                                  slider-crank
              X     Q                                      _--   guide at guide_angle g,
             a  /     \  b    A, B fixed         X       _[S]    to the left of A by offset e
             /         \      A-P crank       coupler __--_--
           P            \     P-Q coupler         __---  _--
        A --------------- B   B-Q rocker       P--     _-
                              A-B ground      /      A

A design is a row of numbers under the names of its kind: the pivot A, the direction of A-B or of
the guide, the lengths, and the coupler point X in the frame of the coupler, along P-Q (or P-S) and
to the left of that.  With d = B - P the coupler of a four-bar is (x d + i C d)/|d|^2, where
x = (|d|^2 + c^2 - r^2)/2 and C = mode/2 sqrt((c + r)^2 - |d|^2) sqrt(|d|^2 - (c - r)^2).  In the
frame of its guide that of a slider-crank is sqrt(c^2 - h^2) - i h, with h = a sin(angle - g) - e.

Where a loop cannot be closed the roots are taken as zero, so that a search can pass such designs;
`CurveKind.margins` tells them apart.  A crank that turns fully stays on one branch.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from proofmass.base.arrays import Array, Complex

LEAST_TRANSMISSION_SINE = 1e-3
"""Least sine of the transmission angle in a derivative [1]; it is infinite where the sine is 0."""
MARGIN_STEP = 1e-6  # relative step for slopes of margins, which are smooth sums and square roots


class CurveKind(Protocol):
    """A kind of linkage, in one assembly mode.

    Attributes
    ----------
    title : str
    names : tuple of str
        Names of the parameters of a design.
    mode : int
        Assembly mode.
    limits : tuple of str
        What each margin is about, in words.
    """

    title: ClassVar[str]
    names: ClassVar[tuple[str, ...]]
    limits: ClassVar[tuple[str, ...]]

    @property
    def mode(self) -> int:
        """Assembly mode, 1 or -1."""

    def points(self, designs: Array, angles: Array) -> Complex:
        """Coupler points x + iy (B, N) [m] of designs (B, k) at crank angles (B, N) [rad]."""

    def slopes(self, designs: Array, angles: Array) -> tuple[Complex, Complex]:
        """Derivatives of the points by the parameters (B, N, k) and by the angles (B, N)."""

    def margins(self, designs: Array, transmission: float) -> Array:
        """Lengths (B, h) [m] that are not negative if the crank turns fully.

        The transmission angle then stays at least `transmission` [rad] from 0 and pi.
        """

    def basis(self, shapes: Array, angles: Array) -> Complex:
        """Directions of the coupler (B, N) in the frame of ground or guide, for a crank of 1 m."""

    def random_shapes(self, count: int, rng: np.random.Generator, transmission: float) -> Array:
        """Random lengths over that of the crank, whose crank turns fully."""


@dataclass(frozen=True)
class FourBarCurves:
    """Four-bars in one assembly mode: +1 open, -1 crossed."""

    mode: int
    title: ClassVar[str] = "four-bar"
    names: ClassVar[tuple[str, ...]] = (
        "pivot_x",
        "pivot_y",
        "ground_angle",
        "crank",
        "coupler",
        "rocker",
        "ground",
        "point_along",
        "point_across",
    )
    limits: ClassVar[tuple[str, ...]] = (
        "coupler and rocker may be too unlike for crank and ground in line",
        "coupler and rocker may be too short for crank and ground in one line",
    )

    def points(self, designs: Array, angles: Array) -> Complex:
        """Coupler points (B, N) [m]."""
        x, y, _, _, _, _, _, along, across = (part[:, None] for part in designs.T)
        pin, coupler, _ = self._bars(designs, angles)
        return np.asarray(x + 1j * y + pin + (along + 1j * across) * coupler)

    def slopes(self, designs: Array, angles: Array) -> tuple[Complex, Complex]:
        """Derivatives by the parameters (B, N, 9) and by the angles (B, N)."""
        _, _, g, a, c, _, d, along, across = (part[:, None] for part in designs.T)
        pin, coupler, rocker = self._bars(designs, angles)
        ground, arm = d * np.exp(1j * g), (along + 1j * across) * coupler
        sine = (coupler * rocker.conj()).imag
        sine = np.where(sine < 0, -1.0, 1.0) * np.maximum(np.abs(sine), LEAST_TRANSMISSION_SINE)

        def turn(change: Complex) -> Array:
            """Change of the coupler's angle for a change of crank + coupler - ground - rocker."""
            return (change * rocker.conj()).real / (c * sine)

        one = np.ones_like(pin)
        by_angle = 1j * pin + 1j * arm * turn(1j * pin)
        by_design = [
            one,
            1j * one,
            1j * arm * turn(-1j * ground + 0.0 * pin),
            pin / a + 1j * arm * turn(pin / a),
            1j * arm * turn(coupler),
            1j * arm * turn(-rocker),
            1j * arm * turn(-ground / d + 0.0 * pin),
            coupler,
            1j * coupler,
        ]
        return np.stack(by_design, axis=-1), by_angle

    def margins(self, designs: Array, transmission: float) -> Array:
        """|d - a| and d + a against the distances A-Q that keep the transmission angle."""
        a, c, r, d = designs[:, 3:7].T
        spread = 2.0 * c * r * np.cos(transmission)
        least = np.sqrt(np.maximum(c * c + r * r - spread, 0.0))
        return np.stack([np.abs(d - a) - least, np.sqrt(c * c + r * r + spread) - d - a], -1)

    def _bars(self, designs: Array, angles: Array) -> tuple[Complex, Complex, Complex]:
        """The crank [m], and the directions of coupler and rocker [1]."""
        _, _, g, a, c, r, d, _, _ = (part[:, None] for part in designs.T)
        pin = a * np.exp(1j * angles)
        return pin, *close_four_bar(d * np.exp(1j * g) - pin, c, r, self.mode)

    def random_shapes(self, count: int, rng: np.random.Generator, transmission: float) -> Array:
        """Coupler, rocker and ground over the crank (count, 3).

        The transmission angles with crank and ground in line are random, so that none is refused.
        """
        c, r = np.exp(rng.uniform(*SHAPE_RANGE, (2, count)))
        most = np.cos(transmission)
        cosines = np.sort(rng.uniform(-most, most, (2, count)), axis=0)
        far, near = np.sqrt(c * c + r * r - 2.0 * c * r * cosines)
        short, long = 0.5 * (far - near), 0.5 * (far + near)
        turns = rng.random(count) < GROUND_SHORTEST
        crank, ground = np.where(turns, long, short), np.where(turns, short, long)
        return np.column_stack([c, r, ground]) / crank[:, None]

    def basis(self, shapes: Array, angles: Array) -> Complex:
        """Directions of the coupler (B, N) for a crank of 1 m and a ground along x."""
        c, r, d = (part[:, None] for part in shapes.T)
        return close_four_bar(d - np.exp(1j * angles), c, r, self.mode)[0]


SHAPE_RANGE = (-1.2, 1.2)
"""Logarithms of the least and the largest coupler and rocker of random designs [1]."""
GROUND_SHORTEST = 0.25
"""Share of double cranks among random designs; the others are crank-rockers."""


def close_four_bar(to_ground: Complex, c: Array, r: Array, mode: int) -> tuple[Complex, Complex]:
    """Directions of coupler and rocker, from the vector of the crank pin to the rocker's pivot."""
    square = np.maximum(np.abs(to_ground) ** 2, np.finfo(float).tiny)
    x = 0.5 * (square + (c - r) * (c + r))
    outer, inner = (c + r) ** 2 - square, square - (c - r) ** 2
    area = 0.5 * mode * np.sqrt(np.maximum(outer, 0.0)) * np.sqrt(np.maximum(inner, 0.0))
    coupler = (x + 1j * area) * to_ground
    rocker = coupler / square - to_ground
    return unit_vectors(coupler), unit_vectors(rocker)


def unit_vectors(vectors: Complex) -> Complex:
    """Vectors over their lengths [1]."""
    return np.asarray(vectors / np.maximum(np.abs(vectors), np.finfo(float).tiny))


@dataclass(frozen=True)
class SliderCrankCurves:
    """Slider-cranks; a slider behind its crank is one ahead of it on a guide that points back."""

    mode: int = 1
    title: ClassVar[str] = "slider-crank"
    names: ClassVar[tuple[str, ...]] = (
        "pivot_x",
        "pivot_y",
        "guide_angle",
        "crank",
        "coupler",
        "offset",
        "point_along",
        "point_across",
    )
    limits: ClassVar[tuple[str, ...]] = ("the coupler may be too short for crank and offset",)

    def points(self, designs: Array, angles: Array) -> Complex:
        """Coupler points (B, N) [m]."""
        x, y, g, a, c, e, along, across = (part[:, None] for part in designs.T)
        coupler = self._coupler(angles - g, a, c, e) * np.exp(1j * g)
        return np.asarray(x + 1j * y + a * np.exp(1j * angles) + (along + 1j * across) * coupler)

    def slopes(self, designs: Array, angles: Array) -> tuple[Complex, Complex]:
        """Derivatives by the parameters (B, N, 8) and by the angles (B, N)."""
        _, _, g, a, c, e, along, across = (part[:, None] for part in designs.T)
        local = self._coupler(angles - g, a, c, e)
        coupler, pin = local * np.exp(1j * g), a * np.exp(1j * angles)
        arm = 1j * (along + 1j * across) * coupler
        run = c * np.maximum(local.real, LEAST_TRANSMISSION_SINE)
        swing = -a * np.cos(angles - g) / run
        one = np.ones_like(pin)
        by_design = [
            one,
            1j * one,
            arm * (1.0 - swing),
            pin / a - arm * np.sin(angles - g) / run,
            -arm * local.imag / run,
            arm / run,
            coupler,
            1j * coupler,
        ]
        return np.stack(by_design, axis=-1), 1j * pin + arm * swing

    def margins(self, designs: Array, transmission: float) -> Array:
        """The reach of the coupler across the guide, less crank and offset."""
        a, c, e = designs[:, 3:6].T
        return (c * np.cos(transmission) - a - np.abs(e))[:, None]

    def _coupler(self, angles: Array, a: Array | float, c: Array, e: Array) -> Complex:
        """Direction of the coupler in the frame of the guide [1]."""
        sine = np.clip((a * np.sin(angles) - e) / c, -1.0, 1.0)
        return np.asarray(np.sqrt((1.0 - sine) * (1.0 + sine)) - 1j * sine)

    def random_shapes(self, count: int, rng: np.random.Generator, transmission: float) -> Array:
        """Coupler and offset over the crank (count, 2)."""
        offset = rng.normal(0.0, 1.0, count) * np.exp(rng.uniform(-1.0, 1.0, count))
        least = (1.0 + np.abs(offset)) / np.cos(transmission)
        return np.column_stack([least * np.exp(rng.exponential(0.7, count)), offset])

    def basis(self, shapes: Array, angles: Array) -> Complex:
        """Directions of the coupler (B, N) for a crank of 1 m and a guide along x."""
        c, e = (part[:, None] for part in shapes.T)
        return self._coupler(angles, 1.0, c, e)


def assemble_designs(shapes: Array, fit: Complex) -> Array:
    """Designs (B, k) whose points are fit0 + fit1 exp(i angle) + fit2 basis.

    `shapes` are of `CurveKind.random_shapes`, and the basis is that of `CurveKind.basis`.
    """
    place, crank, arm = fit.T
    size, direction = np.abs(crank), np.angle(crank)
    arm = arm * np.exp(-1j * direction)
    return np.column_stack(
        [place.real, place.imag, direction, size, shapes * size[:, None], arm.real, arm.imag]
    )


def margin_slopes(kind: CurveKind, designs: Array, transmission: float) -> Array:
    """Derivatives of the margins by the parameters (B, h, k), by central differences."""
    count, k = designs.shape
    step = MARGIN_STEP * (1.0 + np.abs(designs))
    moves = step[:, None] * np.eye(k)
    both = np.stack([designs[:, None] + moves, designs[:, None] - moves])
    above, below = kind.margins(both.reshape(-1, k), transmission).reshape(2, count, k, -1)
    return np.asarray(((above - below) / (2.0 * step)[..., None]).swapaxes(1, 2))
