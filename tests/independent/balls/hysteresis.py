"""References that follow one drive through contacts and dry friction at rest, in balls."""

from collections.abc import Callable, Iterable, Iterator

from flint import arb

from tests.independent.balls.free_motions import Balls
from tests.independent.balls.loops import CaseNumbers, NotProven

DriveSamples = Iterable[tuple[float, float, float]]
"""Value, rate and acceleration of a drive at the samples of a run."""
REST_OF_SHAFT = 1e-13
"""Rate [rad/s] below which the shaft is at rest; by rounding it has 1e-16 where it turns back."""


def spring_release(p: CaseNumbers, drive: DriveSamples) -> Iterator[Balls]:
    """Two springs, the first of which is prestressed on a contact, which it leaves."""
    k1, k2, preload = (arb(p[name]) for name in ("stiffness1", "stiffness2", "preload"))
    in_series = p["connection"] == "series"
    for place, rate, _ in drive:
        x, v = arb(float(place)), arb(float(rate))
        pull = k2 * x if in_series else k1 * x
        if not (pull < preload or pull > preload):
            raise NotProven(f"the spring leaves its contact at {x}")
        released = pull > preload
        if in_series:
            gap = (k2 * x - preload) / (k1 + k2) if released else arb(0)
            gap_rate = k2 * v / (k1 + k2) if released else arb(0)
            stretch1, stretch2, stretch2_rate = preload / k1 + gap, x - gap, v - gap_rate
            force = k2 * stretch2
        else:
            gap, gap_rate = (x - preload / k1, v) if released else (arb(0), arb(0))
            stretch1 = arb(0) if released else preload / k1 - x
            stretch2, stretch2_rate = preload / k2 + x, v
            force = k2 * stretch2 - k1 * stretch1
        yield {
            "force": force,
            "gap": gap,
            "gap_rate": gap_rate,
            "contact": arb(0) if released else preload - pull,
            "stretch1": stretch1,
            "stretch2": stretch2,
            "stretch2_rate": stretch2_rate,
            "energy": (k1 * stretch1 * stretch1 + k2 * stretch2 * stretch2) / 2,
        }


def shaft_pendulum(p: CaseNumbers, drive: DriveSamples) -> Iterator[Balls]:
    """A pendulum that sticks to a shaft, or slips where friction carries its weight."""
    length, friction = arb(p["length"]), arb(p["friction"])
    weight = arb(p["mass"]) * arb(p["gravity"]) * length
    bearing, limit = arb(p["bearing_friction"]), (friction / weight).asin()
    swing, sense, before = arb(0), 0, None
    for value, given, _ in drive:
        shaft, rate = arb(float(value)), arb(float(given))
        sense = sense if abs(rate) < REST_OF_SHAFT else 1 if rate > 0 else -1
        swing, slips = move_swing(swing + shaft - (shaft if before is None else before), limit)
        before, moment = shaft, weight * swing.sin()
        yield {
            "swing": swing,
            "slip": swing - shaft,
            "swing_rate": arb(0) if slips else rate,
            "slip_rate": -rate if slips else arb(0),
            "bob_x": length * swing.sin(),
            "bob_y": -length * swing.cos(),
            "hinge_moment": moment,
            "holding_moment": moment + sense * bearing,
        }


def move_swing(wanted: arb, limit: arb) -> tuple[arb, bool]:
    """The swing of the pendulum on the shaft, and whether it slips."""
    if abs(wanted) < limit:
        return wanted, False
    if abs(wanted) > limit:
        return (limit if wanted > 0 else -limit), True
    raise NotProven("the pendulum begins to slip at a sample")


ALONG_A_DRIVE: dict[str, Callable[[CaseNumbers, DriveSamples], Iterator[Balls]]] = {
    "spring_release": spring_release,
    "shaft_pendulum": shaft_pendulum,
}
"""The exact curves of references that depend on the way of their drive."""
