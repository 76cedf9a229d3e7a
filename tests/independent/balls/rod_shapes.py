"""Shapes of clamped rods in balls, by Taylor series with a bound of what they leave out.

From the clamp on, with z = x + iy, the force N = F + w (L - s) and its strains::

    z' = (1 + A/EA + i S/GA) exp(i theta),    A + i S = N exp(-i theta)
    theta' = m/EI,                            m' = Im(conj(N) z')

The moment at the clamp and the force F at the tip are unknowns of Krawczyk's test; derivatives by
them follow from the same equations, differentiated.  A step is enclosed twice: roughly, by a box
into which the equations lead back (Picard), then by a series, whose last term is evaluated on that
box (R. E. Moore, Interval Analysis, 1966).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from flint import acb, acb_series, arb, arb_mat, ctx

from proofmass.base.arrays import Array
from tests.independent.balls.free_motions import Balls
from tests.independent.balls.loops import (
    HALF_WIDTHS,
    IMAGINARY,
    SHRINKINGS,
    CaseNumbers,
    NotProven,
    column,
    unit_vector,
)

ORDER = 30
"""Terms of a series: the balls of the shipped rods have radii below 1e-33."""
STEP = 0.025
"""Largest step, as a share of the rod's length."""
PICARD_TRIALS = 12
"""Number of boxes that are tried for a step."""
LEAST_RADIUS = arb(2) ** -100
UNKNOWNS = 3


@dataclass(frozen=True)
class RodLoads:
    """Clamped rod of length L with its compliances, load per length and loads at the tip."""

    length: arb
    flexibility: arb
    stretch: arb
    shear: arb
    weight: acb
    force: acb
    follower: acb
    moment: arb


@dataclass(frozen=True)
class RodState:
    """Place, angle and moment at a section, and their derivatives by the unknowns."""

    place: acb
    angle: arb
    moment: arb
    slopes: tuple[tuple[acb, arb, arb], ...]


def compliance(p: CaseNumbers, name: str) -> arb:
    """1 over a stiffness; 0 for an infinite one."""
    value = p[name]
    return arb(0) if value == float("inf") else 1 / arb(value)


def rod_loads(p: CaseNumbers) -> RodLoads:
    """The rod of a case."""
    if p["theta0"] or p["x0"] or p["y0"]:
        raise NotProven("a clamp that is turned or beside the origin is not written in balls")
    p["branch"]  # chooses one of the equilibria, as the reference's values do
    return RodLoads(
        arb(p["length"]),
        1 / arb(p["stiffness"]),
        compliance(p, "axial"),
        compliance(p, "shear"),
        p.complex("weight_x", "weight_y"),
        p.complex("force_x", "force_y"),
        p.complex("follower_x", "follower_y"),
        arb(p["moment"]),
    )


def pinned_rod(p: CaseNumbers) -> tuple[RodLoads, acb]:
    """The rod of a case whose tip is on a pin, and the pin; its loads are guesses, and no loads."""
    free = replace(rod_loads(p), force=acb(0), follower=acb(0), moment=arb(0))
    return free, p.complex("pin_x", "pin_y")


def real_part(one: acb_series) -> acb_series:
    """A series with the real parts of its terms."""
    return acb_series([acb(term.real) for term in one.coeffs()])


def grow(start: acb, slope: acb_series) -> acb_series:
    """A series from its first term and its derivative."""
    return slope.integral() + start


def taylor(rod: RodLoads, state: RodState, beyond: arb, force: acb, order: int) -> list[acb_series]:
    """Series of place, angle, moment and their derivatives, from a state with a length beyond it.

    Each round of the equations gives one more term.
    """
    ctx.cap = order + 1
    pull = acb_series([force + rod.weight * acb(beyond), -rod.weight])
    back = acb_series([pull[0].conjugate(), pull[1].conjugate()])
    units = (acb(0), acb(1), IMAGINARY)  # change of F with each unknown
    angle, moment = acb_series([acb(state.angle)]), acb_series([acb(state.moment)])
    turns = [acb_series([acb(one[1])]) for one in state.slopes]
    twists = [acb_series([acb(one[2])]) for one in state.slopes]
    mean, half = acb((rod.stretch + rod.shear) / 2), acb((rod.stretch - rod.shear) / 2)
    for terms in range(2, order + 2):
        ctx.cap = terms
        unit = (angle * IMAGINARY).exp()
        double = unit * unit
        bar = unit + pull * mean + back * double * half  # z', since N exp(-i theta) is A + i S
        bend = real_part((back * bar) * (-IMAGINARY))
        bars, bends = [], []
        for delta, turned in zip(units, turns, strict=True):
            moved = IMAGINARY * turned * (unit + 2 * back * double * half)
            moved = moved + delta * mean + delta.conjugate() * double * half
            bars.append(moved)
            bends.append(real_part((delta.conjugate() * bar + back * moved) * (-IMAGINARY)))
        angle, moment = (
            grow(acb(state.angle), moment * acb(rod.flexibility)),
            grow(acb(state.moment), bend),
        )
        turns = [
            grow(acb(one[1]), twist * acb(rod.flexibility))
            for one, twist in zip(state.slopes, twists, strict=True)
        ]
        twists = [grow(acb(one[2]), b) for one, b in zip(state.slopes, bends, strict=True)]
    ctx.cap = order + 1
    places = [grow(one[0], b) for one, b in zip(state.slopes, bars, strict=True)]
    return [grow(state.place, bar), angle, moment, *places, *turns, *twists]


def pack(values: Sequence[acb]) -> RodState:
    """A state from the values of the series of `taylor`."""
    place, angle, moment, *rest = values
    columns = (rest[k * UNKNOWNS : (k + 1) * UNKNOWNS] for k in range(3))
    slopes = tuple((a, b.real, c.real) for a, b, c in zip(*columns, strict=True))
    return RodState(place, angle.real, moment.real, slopes)


def unpack(state: RodState) -> list[acb]:
    """The values of a state in the order of `taylor`."""
    columns = zip(*state.slopes, strict=True)
    return [state.place, acb(state.angle), acb(state.moment), *(acb(v) for c in columns for v in c)]


def enclose(rod: RodLoads, state: RodState, beyond: arb, force: acb, step: arb) -> RodState:
    """A box that holds the states of a whole step: the equations lead from it back into it."""
    way = arb(0).union(step)
    values = unpack(state)
    box = values
    lengths = beyond - way
    for _ in range(PICARD_TRIALS):
        slopes = [one[1] for one in taylor(rod, pack(box), lengths, force, 1)]
        image = [a + b * acb(way) for a, b in zip(values, slopes, strict=True)]
        if all(contains(a, b) for a, b in zip(box, image, strict=True)):
            return pack(image)
        box = [widen(one) for one in image]
    raise NotProven("a step of the rod is too long for an enclosure")


def widen(one: acb) -> acb:
    """A ball with a tenth more radius."""
    parts = one.real, one.imag
    return acb(*(part + arb(0, float(0.1 * part.rad() + LEAST_RADIUS)) for part in parts))


def contains(outer: acb, inner: acb) -> bool:
    """Whether a ball holds another."""
    return outer.real.contains(inner.real) and outer.imag.contains(inner.imag)


def advance(rod: RodLoads, state: RodState, beyond: arb, force: acb, step: arb) -> RodState:
    """The state at the end of a step."""
    box = enclose(rod, state, beyond, force, step)
    lengths = beyond - arb(0).union(step)
    exact = taylor(rod, state, beyond, force, ORDER - 1)
    rest = taylor(rod, box, lengths, force, ORDER)
    power = acb(step**ORDER)
    found = []
    for one, last in zip(exact, rest, strict=True):
        value = sum((one[k] * acb(step) ** k for k in range(1, ORDER)), one[0])
        found.append(value + last[ORDER] * power)
    return pack(found)


def shape(rod: RodLoads, unknowns: Sequence[arb], samples: Sequence[arb]) -> list[RodState]:
    """The states at rising arc lengths, the last of which is the rod's end."""
    force = acb(unknowns[1], unknowns[2])
    slopes = tuple((acb(0), arb(0), arb(int(k == 0))) for k in range(UNKNOWNS))
    state, at, found = RodState(acb(0), arb(0), unknowns[0], slopes), arb(0), []
    for s in samples:
        parts = max(1, int(float((s - at) / (STEP * rod.length)) + 0.999))
        step = (s - at) / parts
        for _ in range(parts if s > at else 0):
            state = advance(rod, state, rod.length - at, force, step)
            at = at + step
        at = s
        found.append(state)
    return found


def end_conditions(
    rod: RodLoads, unknowns: Sequence[arb], pin: acb | None
) -> tuple[list[arb], arb_mat]:
    """What is zero at the tip, and its derivatives by the unknowns.

    The moment is that at the tip; the force is that of its loads or, with a pin, the tip is there.
    """
    end = shape(rod, unknowns, [rod.length])[0]
    force, unit = acb(unknowns[1], unknowns[2]), (IMAGINARY * acb(end.angle)).exp()
    if pin is None:
        gap = force - rod.force - rod.follower * unit
        units = (acb(0), acb(1), IMAGINARY)
        gaps = [
            one - rod.follower * unit * IMAGINARY * acb(slope[1])
            for one, slope in zip(units, end.slopes, strict=True)
        ]
    else:
        gap, gaps = end.place - pin, [slope[0] for slope in end.slopes]
    moments = [slope[2] for slope in end.slopes]
    rows = [moments, [one.real for one in gaps], [one.imag for one in gaps]]
    return [end.moment - rod.moment, gap.real, gap.imag], arb_mat(rows)


def prove_rod(rod: RodLoads, guess: Sequence[float], pin: acb | None) -> tuple[list[arb], float]:
    """Moment at the clamp and force at the tip, and the half width of the box with one solution."""
    unit = arb_mat([unit_vector(k, UNKNOWNS) for k in range(UNKNOWNS)])

    def image_of(box: Sequence[arb]) -> list[arb]:
        middle = [one.mid() for one in box]
        rest, slopes = end_conditions(rod, middle, pin)
        inverse = slopes.inv().mid()
        offsets = column(a - b for a, b in zip(box, middle, strict=True))
        spread = (unit - inverse * end_conditions(rod, box, pin)[1]) * offsets
        step = inverse * column(rest)
        return [middle[k] - step[k, 0] + spread[k, 0] for k in range(UNKNOWNS)]

    for half_width in HALF_WIDTHS:
        box = [arb(float(one), half_width) for one in guess]
        try:
            image = image_of(box)
        except (ZeroDivisionError, ValueError, NotProven):
            continue
        if all(a.contains_interior(b) for a, b in zip(box, image, strict=True)):
            for _ in range(SHRINKINGS):
                image = [a.intersection(b) for a, b in zip(image, image_of(image), strict=True)]
            return image, half_width
    raise NotProven("no box about the rod's loads passes the test")


def rod_curves(
    rod: RodLoads, guess: Sequence[float], pin: acb | None, x: Array
) -> Iterator[tuple[Balls, float]]:
    """The curves of a clamped rod along its length, and the half width of the box of its loads."""
    unknowns, half_width = prove_rod(rod, guess, pin)
    *states, tip = shape(rod, unknowns, [*(arb(float(s)) for s in x), rod.length])
    for state in states:
        curves = {
            "x": state.place.real,
            "y": state.place.imag,
            "theta": state.angle,
            "m": state.moment,
            "hold": -unknowns[0],
            "tip.x": tip.place.real,
            "tip.y": tip.place.imag,
        }
        yield curves, half_width
