"""Free motions with closed forms in balls: a pendulum, and bodies that bounce, roll, slide or hit.

A motion of phases is followed from event to event.  At a time that may belong to two phases, the
ball holds the values of both.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise

from flint import acb, arb

from proofmass.base.arrays import Array
from tests.independent.balls.loops import CaseNumbers, NotProven

Balls = dict[str, arb]
"""Exact values of curves at one sample, by name [SI]."""
NEWTON_STEPS = 60
"""Largest number of steps for an amplitude of Jacobi's functions; about six are needed."""
SMALL_STEP = arb(2) ** -110
"""Step at which the amplitude is known to the precision of the balls."""
MOST_EVENTS = 1000


def incomplete_integral(kind: str, phi: arb, m: arb) -> arb:
    """Elliptic F or E (phi, m); not a number for phi at an odd multiple of pi/2."""
    function = {"F": "elliptic_f", "E": "elliptic_e_inc"}[kind]
    return getattr(acb, function)(acb(phi), acb(m)).real


def jacobi_functions(u: arb, m: arb) -> tuple[arb, arb, arb, arb]:
    """The amplitude of Jacobi's functions, and sn, cn and dn, at u with the parameter m.

    Newton's method finds the amplitude phi.  Since dF/dphi is at least 1, the residual of
    F(phi) = u bounds its error.
    """
    phi = (u * arb.pi() / (2 * acb(m).elliptic_k().real)).mid()
    for _ in range(NEWTON_STEPS):
        slope = (1 - m * phi.sin() * phi.sin()).sqrt()
        step = ((incomplete_integral("F", phi, m) - u) * slope).mid()
        phi = (phi - step).mid()
        if abs(step) < SMALL_STEP:
            break
    rest = abs(incomplete_integral("F", phi, m) - u).upper()
    phi = (phi - rest).union(phi + rest)
    return phi, phi.sin(), phi.cos(), (1 - m * phi.sin() * phi.sin()).sqrt()


def pendulum(p: CaseNumbers, x: Array) -> Iterator[Balls]:
    """sin(angle/2) = k cd(w t); the rest from the first integral and Newton's law."""
    length, mass, gravity = (arb(p[name]) for name in ("length", "mass", "gravity"))
    half = arb(p["amplitude"]) / 2
    w, k, other = (gravity / length).sqrt(), half.sin(), half.cos()
    for t in x:
        _, sn, cn, dn = jacobi_functions(w * arb(float(t)), k * k)
        sine = k * cn / dn
        angle, rate = 2 * sine.asin(), -2 * w * k * other * sn / dn
        kinetic = mass * length * length * rate * rate / 2
        potential = 2 * mass * gravity * length * sine * sine
        yield {
            "angle": angle,
            "rate": rate,
            "acceleration": -w * w * angle.sin(),
            "kinetic": kinetic,
            "potential": potential,
            "energy": kinetic + potential,
            "tension": mass * (length * rate * rate + gravity * angle.cos()),
        }


Phase = tuple[arb, Callable[[arb], Balls]]
"""The start of a phase of a motion, and its curves from the time since then."""


def along_phases(phases: list[Phase], x: Array) -> Iterator[Balls]:
    """The curves of a motion at times: those of the phase of each time, or of both at an event."""
    ends = [start for start, _ in phases[1:]]
    for t in (arb(float(one)) for one in x):
        found: Balls = {}
        for (start, curves), end in zip(phases, [*ends, None], strict=True):
            if t < start or (end is not None and t >= end):
                continue
            here = curves(t - start)
            found = {name: ball.union(found.get(name, ball)) for name, ball in here.items()}
        yield found


def uniform(place: arb, speed: arb, acceleration: arb, t: arb) -> tuple[arb, arb, arb]:
    """Place, speed and acceleration after a time of constant acceleration."""
    return place + t * (speed + acceleration * t / 2), speed + acceleration * t, acceleration


def bouncing_ball(p: CaseNumbers, x: Array) -> Iterator[Balls]:
    """Parabolas between impacts with the floor, as many as the times need."""
    gravity, restitution = arb(p["gravity"]), arb(p["restitution"])
    height, speed, start = arb(p["height"]), arb(p["speed"]), arb(0)
    phases: list[Phase] = []
    names = "height", "velocity", "acceleration"
    for bounces in range(MOST_EVENTS):

        def curves(t: arb, h: arb = height, v: arb = speed, n: int = bounces) -> Balls:
            here = dict(zip(names, uniform(h, v, -gravity, t), strict=True))
            return here | {"bounces": arb(n)}

        phases.append((start, curves))
        impact = (speed * speed + 2 * gravity * height).sqrt()
        start = start + (speed + impact) / gravity
        height, speed = arb(0), restitution * impact
        if start > arb(float(x[-1])):
            return along_phases(phases, x)
    raise NotProven(f"more than {MOST_EVENTS} impacts")


def rolling_ball(p: CaseNumbers, x: Array) -> Iterator[Balls]:
    """Friction slows a ball that slides, until its lowest point is at rest."""
    radius, ratio = arb(p["radius"]), arb(p["inertia_ratio"])
    speed, spin = arb(p["speed"]), arb(p["spin"])
    slip = speed - radius * spin
    push = arb(p["friction"]) * arb(p["gravity"]) * (-1 if slip > 0 else 1)
    twist = -push / (ratio * radius)
    end = -slip / (push - radius * twist)

    def curves(place: arb, v: arb, angle: arb, w: arb, a: arb, b: arb, t: arb) -> Balls:
        here = dict(
            zip(("position", "velocity", "acceleration"), uniform(place, v, a, t), strict=True)
        )
        turned = dict(zip(("angle", "spin", "spin_rate"), uniform(angle, w, b, t), strict=True))
        return here | turned | {"slip": here["velocity"] - radius * turned["spin"]}

    place, rolling, _ = uniform(arb(0), speed, push, end)
    angle, turning, _ = uniform(arb(0), spin, twist, end)
    return along_phases(
        [
            (arb(0), lambda t: curves(arb(0), speed, arb(0), spin, push, twist, t)),
            (end, lambda t: curves(place, rolling, angle, turning, arb(0), arb(0), t)),
        ],
        x,
    )


def sliding_block(p: CaseNumbers, x: Array) -> Iterator[Balls]:
    """Coulomb's law on a slope: the block slides until it stops, then sticks or slides down."""
    angle, gravity = arb(p["angle"]), arb(p["gravity"])
    mass, speed = arb(p["mass"]), arb(p["speed"])
    weight, rub = gravity * angle.sin(), arb(p["friction"]) * gravity * angle.cos()
    sticks = rub >= weight
    after = arb(0) if sticks else rub - weight

    def curves(place: arb, v: arb, a: arb, t: arb) -> Balls:
        here = dict(
            zip(("position", "velocity", "acceleration"), uniform(place, v, a, t), strict=True)
        )
        normal = mass * gravity * angle.cos()
        return here | {"friction_force": mass * (a + weight), "normal_force": normal}

    if speed == 0:
        return along_phases([(arb(0), lambda t: curves(arb(0), arb(0), after, t))], x)
    before = -weight - rub if speed > 0 else -weight + rub
    first: Phase = (arb(0), lambda t: curves(arb(0), speed, before, t))
    if not speed * before < 0:
        return along_phases([first], x)
    stop = -speed / before
    place = uniform(arb(0), speed, before, stop)[0]
    return along_phases([first, (stop, lambda t: curves(place, arb(0), after, t))], x)


def ball_row(p: CaseNumbers, x: Array) -> Iterator[Balls]:
    """Balls that hit their neighbours: the next impact is that of the pair that meets first."""
    count, restitution = int(p["balls"]), arb(p["restitution"])
    diameter, now = 2 * arb(p["radius"]), arb(0)
    places = [k * (diameter + arb(p["gap"])) for k in range(count)]
    speeds = [arb(p["speed"])] + [arb(0)] * (count - 1)
    phases: list[Phase] = []
    while len(phases) < MOST_EVENTS:

        def curves(
            t: arb,
            at: tuple[arb, ...] = tuple(places),
            v: tuple[arb, ...] = tuple(speeds),
            n: int = len(phases),
        ) -> Balls:
            x_and_v = zip(at, v, strict=True)
            places = {f"x{k + 1}": a + b * t for k, (a, b) in enumerate(x_and_v)}
            return places | {f"v{k + 1}": b for k, b in enumerate(v)} | {"impacts": arb(n)}

        phases.append((now, curves))
        waits = {
            k: (places[k + 1] - places[k] - diameter) / (a - b)
            for k, (a, b) in enumerate(pairwise(speeds))
            if a - b > 0
        }
        if not waits:
            return along_phases(phases, x)
        first = min(waits, key=lambda k: float(waits[k].mid()))
        if not all(waits[first] < wait for k, wait in waits.items() if k != first):
            raise NotProven("two impacts at a time")
        wait, behind, ahead = waits[first], speeds[first], speeds[first + 1]
        now += wait
        places = [a + b * wait for a, b in zip(places, speeds, strict=True)]
        both, apart = behind + ahead, restitution * (behind - ahead)
        speeds[first], speeds[first + 1] = (both - apart) / 2, (both + apart) / 2
    raise NotProven(f"more than {MOST_EVENTS} impacts")


FREE_MOTIONS: dict[str, Callable[[CaseNumbers, Array], Iterator[Balls]]] = {
    "pendulum": pendulum,
    "bouncing_ball": bouncing_ball,
    "rolling_ball": rolling_ball,
    "sliding_block": sliding_block,
    "ball_row": ball_row,
}
"""The exact curves of references of free motions, at times."""
