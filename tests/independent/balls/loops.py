"""Mechanisms as sums of vectors in series of balls, and the proof that a pose is the only one near.

A ball is a number with a bound of its error, of python-flint: every operation keeps the exact
result inside.  A mechanism is a function of its numbers, drives and unknowns that returns `Loops`;
drives and unknowns are series in time, or in one of the unknowns.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from flint import acb, acb_series, arb, arb_mat, ctx

ctx.prec = 128  # bits of balls: errors of float64 are known to 20 digits, after cancellation too
IMAGINARY = acb(0, 1)
HALF_WIDTHS = 1e-4, 1e-6, 1e-8, 1e-10, 1e-12
"""Half widths of the boxes in which the pose shall be the only one, tried from the first on."""
NEAR = 1e-9
"""Step of Newton's method [m or rad] after which the pose is right to rounding."""
SHRINKINGS = 3
"""Steps that shrink the box: each squares the width, from 1e-4 to below 1e-30."""
ORDERS = ("", "v", "a")
RATES = ("{}", "{}_rate", "{}_acceleration")


class NotProven(Exception):
    """No box passes the test, a ball is not finite, or a part of the case is not modelled."""


class CaseNumbers(Mapping[str, Any]):
    """The parameters of a case, exact or as balls; those that are not given are 0.

    `unused` are those that are not 0 and were never asked for: a proof that does not use them is
    about another mechanism.
    """

    def __init__(self, given: Mapping[str, Any], asked: set[str] | None = None) -> None:
        self.given = dict(given)
        self.asked = {"mode"} if asked is None else asked

    def with_values(self, changed: Mapping[str, Any]) -> "CaseNumbers":
        """The numbers with others in their places, of which it is known which were asked for."""
        return CaseNumbers({**self.given, **changed}, self.asked)

    def __getitem__(self, name: str) -> Any:
        self.asked.add(name)
        return self.given.get(name, 0.0)

    def __iter__(self):
        return iter(self.given)

    def __len__(self) -> int:
        return len(self.given)

    def complex(self, along: str, across: str) -> acb:
        """Two parameters as a point of the plane."""
        return acb(arb(self[along]), arb(self[across]))

    @property
    def unused(self) -> list[str]:
        """Names of the parameters that are neither 0 nor infinite, and were not asked for."""
        return sorted(
            name
            for name, one in self.given.items()
            if name not in self.asked and isinstance(one, float | int) and one and isfinite(one)
        )


GROUND = ""
"""The name of the body on which nothing is balanced."""


@dataclass(frozen=True)
class Inertia:
    """A mass of a body: centre as a series, moment of inertia about it, angle as a series.

    `turns` is false for a body whose moment is not balanced, such as a slider that is a point.
    """

    body: str
    mass: arb
    centre: acb_series
    inertia: arb
    angle: acb_series
    turns: bool = True


@dataclass(frozen=True)
class AppliedLoad:
    """A given force, or a moment as a complex number, and the point or angle at which it works.

    `body` is empty if a reaction has the force as its given part.
    """

    value: acb
    along: acb_series
    body: str = GROUND
    is_moment: bool = False


@dataclass(frozen=True)
class DryFriction:
    """A constant friction against the change of an angle [N m] or of a length [N].

    `on` and `by` are the bodies that turn against each other.  A friction along a guide has no
    bodies, but the name of the reaction to whose given part it belongs.
    """

    largest: arb
    along: acb_series
    on: str = GROUND
    by: str = GROUND
    reaction: str = ""


@dataclass(frozen=True)
class Reaction:
    """What one body applies to another at a point: a force in the frame of an angle.

    Its curves are ``name_x`` along the frame and ``name_y`` to the left.  `along` is the part along
    the frame if it is given, None if it is unknown; `moment` is the name of a moment, if there is
    one.
    """

    name: str
    on: str
    by: str
    point: acb_series
    frame: acb_series
    along: arb | None = None
    moment: str = ""


@dataclass
class Loops:
    """What a mechanism is at given drives and unknowns.

    Attributes
    ----------
    loops, scalars : list
        Series that are zero: complex ones, and those of which only the real part counts.
    moments : dict
        Names of the holding moments or forces, and the numbers of their drives.
    channels : dict
        Names of curves: a series, the order of the derivative, and the part ("real" or "imag").
    masses : list of Inertia
    loads : list of AppliedLoad
    reactions : list of Reaction
        Empty if forces between bodies are not asked for.
    motors : dict
        Names of moments of drives, and the bodies that they turn.
    frictions : list of DryFriction
    """

    loops: list[acb_series]
    moments: dict[str, int] = field(default_factory=dict)
    channels: dict[str, tuple[acb_series, int, str]] = field(default_factory=dict)
    masses: list[Inertia] = field(default_factory=list)
    loads: list[AppliedLoad] = field(default_factory=list)
    reactions: list[Reaction] = field(default_factory=list)
    motors: dict[str, str] = field(default_factory=dict)
    frictions: list[DryFriction] = field(default_factory=list)
    scalars: list[acb_series] = field(default_factory=list)

    def terms(self, order: int) -> list[arb]:
        """The terms of one order of all that is zero: real and imaginary parts in turn."""
        parts = [part for one in self.loops for part in (one[order].real, one[order].imag)]
        return parts + [one[order].real for one in self.scalars]

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies, each once."""
        return list(dict.fromkeys(one.body for one in self.masses))

    def add_point(self, name: str, point: acb_series) -> None:
        """Add the curves of a point: name_x, name_vx, name_ax, and those of y."""
        for order, letter in enumerate(ORDERS):
            self.channels[f"{name}_{letter}x"] = point, order, "real"
            self.channels[f"{name}_{letter}y"] = point, order, "imag"

    def add_scalar(self, name: str, series: acb_series, value: str = "{}") -> None:
        """Add the curves of a length or an angle; `value` is the form of its name."""
        for order, form in enumerate((value, *RATES[1:])):
            self.channels[form.format(name)] = series, order, "real"

    def add_bar(
        self, p: CaseNumbers, name: str, start: acb_series, bar: acb_series, angle: acb_series
    ) -> None:
        """Add the mass of a uniform bar from a point on."""
        mass = arb(p[f"{name}_mass"])
        centre = start + bar * acb(0.5)
        self.masses.append(Inertia(name, mass, centre, mass * squared(bar[0]) / 12, angle))

    def add_pin(self, name: str, on: str, by: str, point: acb_series, frame: acb_series) -> None:
        """Add the force of a pin; the curves are ``name_force_x`` and ``name_force_y``."""
        self.reactions.append(Reaction(f"{name}_force", on, by, point, frame))


Form = Callable[[CaseNumbers, Sequence[acb_series], Sequence[acb_series], bool], Loops]
"""A mechanism from its numbers, drives and unknowns; if the last argument is false, only loops."""


def turn(angle: acb_series) -> acb_series:
    """A unit vector at an angle from +x."""
    return (angle * IMAGINARY).exp()


def squared(z: acb) -> arb:
    """The square of the length of a vector; ``z ** 2`` is not a number for a ball about zero."""
    return z.real * z.real + z.imag * z.imag


def dot(a: acb, b: acb) -> arb:
    """The scalar product of two vectors."""
    return a.real * b.real + a.imag * b.imag


def column(values: Iterable[arb]) -> arb_mat:
    """A matrix with one column."""
    return arb_mat([[one] for one in values])


def constants(values: Iterable[arb]) -> list[acb_series]:
    """Series that do not change."""
    return [acb_series([acb(one)]) for one in values]


def series(*orders: Sequence[arb]) -> list[acb_series]:
    """Series from their terms of order 0, 1, ..., each a list over the variables."""
    return [acb_series([acb(one) for one in terms]) for terms in zip(*orders, strict=True)]


def unit_vector(place: int, count: int) -> list[arb]:
    """1 at a place, 0 at the others."""
    return [arb(int(k == place)) for k in range(count)]


def jacobian(
    form: Form, p: CaseNumbers, drives: Sequence[acb_series], unknowns: Sequence[arb]
) -> arb_mat:
    """The derivatives of the loops by the unknowns, from terms of first order of a series."""
    count = len(unknowns)
    columns = [
        form(p, drives, series(unknowns, unit_vector(j, count)), False).terms(1)
        for j in range(count)
    ]
    return arb_mat([list(row) for row in zip(*columns, strict=True)])


def drive_slopes(
    form: Form, p: CaseNumbers, drives: Sequence[arb], unknowns: Sequence[arb]
) -> arb_mat:
    """The derivatives of the loops by the drives."""
    still, count = constants(unknowns), len(drives)
    columns = [
        form(p, series(drives, unit_vector(j, count)), still, False).terms(1) for j in range(count)
    ]
    return arb_mat([list(row) for row in zip(*columns, strict=True)])


def offsets(box: Sequence[arb], middle: Sequence[arb]) -> arb_mat:
    """The box as seen from its middle."""
    return column(one - two for one, two in zip(box, middle, strict=True))


def krawczyk_image(
    form: Form, p: CaseNumbers, drives: Sequence[arb], box: Sequence[arb]
) -> list[arb]:
    """The image K(X) = m - Y F(m, U) + (1 - Y F'(X, U)) (X - m) of a box X about m, for drives U.

    If the image is inside the box, the loops F close at exactly one pose in the box for each value
    of the drives, and these poses are in the image.  Y is about the inverse of F'.  F(m, U) is
    F(m, u) + dF/du(m, U) (U - u), with the middle u of U, whose product with Y is that of slopes.

    R. Krawczyk, Newton-Algorithmen zur Bestimmung von Nullstellen mit Fehlerschranken, Computing 4
    (1969) 187-201; R. E. Moore, A test for existence of solutions to nonlinear systems, SIAM J.
    Numer. Anal. 14 (1977) 611-615.
    """
    middle, count = [one.mid() for one in box], len(box)
    values, given = [one.mid() for one in drives], constants(drives)
    inverse = jacobian(form, p, constants(values), middle).inv().mid()
    step = inverse * column(form(p, constants(values), constants(middle), False).terms(0))
    if any(one.rad() for one in drives):
        slopes = drive_slopes(form, p, drives, middle)
        step += (inverse * slopes) * offsets(drives, values)
    unit = arb_mat(count, count, [int(i == j) for i in range(count) for j in range(count)])
    spread = (unit - inverse * jacobian(form, p, given, box)) * offsets(box, middle)
    return [middle[i] - step[i, 0] + spread[i, 0] for i in range(count)]


def prove_pose(
    form: Form, p: CaseNumbers, drives: Sequence[arb], guess: Sequence[float]
) -> tuple[list[arb], float]:
    """The only pose near a guess as balls, and the half width of the box in which it is alone.

    Raises
    ------
    NotProven
        No box of `HALF_WIDTHS` passes the test.
    """
    ctx.cap = 2
    for half_width in HALF_WIDTHS:
        box = [arb(float(one), half_width) for one in guess]
        try:
            image = krawczyk_image(form, p, drives, box)
        except (ZeroDivisionError, ValueError):  # the matrix of the box is singular
            continue
        if all(a.contains_interior(b) for a, b in zip(box, image, strict=True)):
            for _ in range(SHRINKINGS):
                smaller = krawczyk_image(form, p, drives, image)
                image = [a.intersection(b) for a, b in zip(image, smaller, strict=True)]
            return image, half_width
    raise NotProven(f"no box about {[float(one) for one in guess]} passes the test")


def approximate_pose(
    form: Form,
    p: CaseNumbers,
    drives: Sequence[arb],
    guess: Sequence[float],
    steps: int = 8,
) -> list[float]:
    """A pose by Newton's method from a guess, without proof."""
    ctx.cap = 2
    pose, given = [arb(float(one)) for one in guess], constants(drives)
    for _ in range(steps):
        residual = column(form(p, given, constants(pose), False).terms(0))
        step = jacobian(form, p, given, pose).solve(residual)
        pose = [(one - step[i, 0]).mid() for i, one in enumerate(pose)]
        if all(abs(one) < NEAR for (one,) in step.tolist()):
            break
    return [float(one) for one in pose]
