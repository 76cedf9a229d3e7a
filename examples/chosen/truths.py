"""What the programs beside this file should write, from formulas, without proofmass and engines.

Points of linkages are complex numbers x + iy, each with its velocity and acceleration: where two
bars meet is an intersection of two circles, differentiated twice.  What is let go follows one or
two equations of motion, integrated by DOP853 at a relative tolerance of 1e-12.

    python examples/chosen/truths.py fourbar curves.csv

prints the largest error of the positions, rates, accelerations and moments in a file, each as a
share of the range of the true curve.
"""

import csv
import math
import sys
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

G = 9.81  # m/s2
Curve = np.ndarray
Curves = dict[str, Curve]
Point = tuple[Curve, Curve, Curve]
"""A complex place, its velocity and acceleration."""
KINDS = "position", "velocity", "acceleration", "force"


# ---- POINTS ----------------------------------------------------------------------------------

def fixed(z: complex, like: Curve) -> Point:
    """A point of the ground."""
    return z + 0j * like, 0j * like, 0j * like


def turned(angle: Point, z: complex) -> Point:
    """A vector that is z at angle 0, at an angle with its rate and acceleration."""
    value, rate, acceleration = angle
    arm = z * np.exp(1j * value)
    return arm, 1j * rate * arm, (1j * acceleration - rate**2) * arm


def plus(a: Point, b: Point) -> Point:
    """A vector from a point on."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Point, b: Point) -> Point:
    """The vector from b to a."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def dot(a: Curve, b: Curve) -> Curve:
    """Scalar product of vectors in the plane."""
    return (a * np.conj(b)).real


def solved(u: Curve, v: Curve, p: Curve, q: Curve) -> Curve:
    """The vector z with dot(u, z) = p and dot(v, z) = q."""
    cross = (u.conj() * v).imag
    return 1j * (q * u - p * v) / cross


def meet(a: Point, b: Point, long_a: float, long_b: float, side: int) -> Point:
    """Where bars from a and b meet: left of the way from a to b with side = 1, right with -1."""
    d = b[0] - a[0]
    far = abs(d)
    along = (long_a**2 - long_b**2 + far**2) / (2 * far)
    place = a[0] + d / far * (along + 1j * side * np.sqrt(long_a**2 - along**2))
    u, v = place - a[0], place - b[0]
    rate = solved(u, v, dot(u, a[1]), dot(v, b[1]))
    return place, rate, solved(u, v, dot(u, a[2]) - abs(rate - a[1])**2,
                               dot(v, b[2]) - abs(rate - b[1])**2)


def slid(a: Point, long: float, axis: complex, side: int) -> Point:
    """Where a bar from a meets the line through 0 along a unit vector: on its far side with 1."""
    along, across = dot(a[0], axis), dot(a[0], 1j * axis)
    place = (along + side * np.sqrt(long**2 - across**2)) * axis + 0j
    u, v = place - a[0], np.full(place.shape, 1j * axis)
    none = np.zeros(place.shape)
    rate = solved(u, v, dot(u, a[1]), none)
    return place, rate, solved(u, v, dot(u, a[2]) - abs(rate - a[1])**2, none)


def angle(z: Point) -> Point:
    """Angle of a vector, which starts within (-pi, pi], with rate and acceleration."""
    rate = z[1] / z[0]
    return np.unwrap(np.angle(z[0])), rate.imag, (z[2] / z[0] - rate**2).imag


def length(z: Point) -> Point:
    """Length of a vector, with rate and acceleration."""
    unit = z[0] / abs(z[0])
    rate = dot(unit, z[1])
    return abs(z[0]), rate, dot(unit, z[2]) + (abs(z[1])**2 - rate**2) / abs(z[0])


def named(**points: Point) -> Curves:
    """Curves of points as NAME.x, NAME_velocity.x, .. and of numbers as NAME, NAME_rate, .."""
    found: Curves = {}
    for name, parts in points.items():
        for more, part in zip(("", "_velocity", "_acceleration"), parts, strict=True):
            if np.iscomplexobj(part):
                found |= {f"{name}{more}.x": part.real, f"{name}{more}.y": part.imag}
            else:
                found[name + {"_velocity": "_rate"}.get(more, more)] = part
    return found


def turning(name: str, z: Point) -> Curves:
    """Curves of a body's direction: NAME.angle, NAME_rate.z, NAME_acceleration.z."""
    value, rate, acceleration = angle(z)
    return {f"{name}.angle": value, f"{name}_rate.z": rate, f"{name}_acceleration.z": acceleration}


def steady(t: Curve, rate: float = 1.0) -> Point:
    """An angle from 0 on at a constant rate [rad/s]."""
    return rate * t, rate + 0 * t, 0 * t


def swing(t: Curve, start: float, end: float, period: float) -> Point:
    """To and fro between two values as a cosine of time."""
    half, w = (end - start) / 2, 2 * math.pi / period
    return (start + half * (1 - np.cos(w * t)), half * w * np.sin(w * t),
            half * w**2 * np.cos(w * t))


# ---- DRIVEN LINKAGES -------------------------------------------------------------------------

def fourbar_pose(crank: Point, a: float, b: float, c: float, ground: float, side: int
                 ) -> tuple[Point, Point, Point]:
    """Pins of crank and rocker, and the foot of the rocker."""
    foot = fixed(ground, crank[0])
    pin = turned(crank, a)
    return pin, meet(pin, foot, b, c, side), foot


def of_fourbar(crank: Point, a: float = 1.0, b: float = 2.0, c: float = 2.5, ground: float = 3.0,
               side: int = 1, point: complex = 1 + 0.8j) -> Curves:
    """Coupler, rocker, pin and a point of the coupler."""
    one, two, foot = fourbar_pose(crank, a, b, c, ground, side)
    coupler = minus(two, one)
    away = tuple(part * point / b for part in coupler)
    return {**turning("coupler", coupler), **named(rocker=angle(minus(two, foot)), pin=two,
                                                   point=plus(one, away)),  # type: ignore[arg-type]
            "rocker_acceleration.z": angle(minus(two, foot))[2]}


def moment(crank: Point, *bars: tuple[float, Point, Point], inertia: float = 0.0,
           about: Point | None = None) -> Curve:
    """What a crank must give [N m] for uniform bars of masses [kg] between two points to move.

    Its power is that of the inertia and of the weight of all bars, and of an inertia [kg m2] that
    turns in its place by an angle.
    """
    power = 0.0 * crank[1] if about is None else inertia * about[1] * about[2]
    for mass, a, b in bars:
        power = power + mass / 6 * (
            2 * dot(a[2], a[1]) + dot(a[2], b[1]) + dot(b[2], a[1]) + 2 * dot(b[2], b[1]))
        power = power + mass * G / 2 * (a[1] + b[1]).imag
    return power / crank[1]


def fourbar(t: Curve) -> Curves:
    """Crank-rocker 1, 2, 2.5, 3 m, open, of bars of 1, 2, 2.5 kg; its crank at 1 rad/s."""
    crank = steady(t)
    one, two, foot = fourbar_pose(crank, 1.0, 2.0, 2.5, 3.0, 1)
    bars = (1.0, fixed(0.0, t), one), (2.0, one, two), (2.5, two, foot)
    return {**of_fourbar(crank), "holding_moment": moment(crank, *bars)}


def slider_crank(t: Curve) -> Curves:
    """Crank 1 m, coupler 2 m, guide along x; the slide's coordinate is 0 at x = 2 m.

    Crank and coupler are bars of 1 and 2 kg, the slider has 1.5 kg.
    """
    crank = steady(t)
    pin = turned(crank, 1.0)
    slider = slid(pin, 2.0, 1.0, 1)
    place, rate, acceleration = (part.real for part in slider)
    bars = (1.0, fixed(0.0, t), pin), (2.0, pin, slider), (1.5, slider, slider)
    return {**turning("coupler", minus(slider, pin)), "holding_moment": moment(crank, *bars),
            **named(slider=slider, slide=(place - 2.0, rate, acceleration))}


def swinging_block(t: Curve) -> Curves:
    """Crank 2 m, a rod of 5 m that slides through a block on (2 + cos 0.8, sin 0.8).

    Bars of 2 and 5 kg; the block turns in its place, with 0.01 kg m2.
    """
    crank = steady(t)
    pin = turned(crank, 2.0)
    rod = minus(fixed(2 + np.exp(0.8j), pin[0]), pin)
    end = plus(pin, turned(angle(rod), 5.0))
    bars = (2.0, fixed(0.0, t), pin), (5.0, pin, end)
    return {**turning("rod", rod), **named(slide=length(rod), end=end),
            "holding_moment": moment(crank, *bars, inertia=0.01, about=angle(rod))}


def fivebar_swing(t: Curve) -> Curves:
    """Cranks of 0.4 and 0.5 m, couplers of 0.9 and 0.8 m; both cranks swing in 3 s."""
    left, right = swing(t, 2.0, 1.1, 3.0), swing(t, 0.4, 1.2, 3.0)
    a = turned(left, 0.4)
    b = plus(fixed(0.6, t), turned(right, 0.5))
    return named(tip=meet(a, b, 0.9, 0.8, 1))


def jansen_pose(crank: Point) -> dict[str, Point]:
    """All pins of Jansen's leg [m]: a tenth of his holy numbers, in decimetres."""
    o = fixed(-0.38 - 0.078j, crank[0])
    p = turned(crank, 0.15)
    c = meet(o, p, 0.415, 0.50, 1)  # upper: bars b and j
    f = meet(o, p, 0.393, 0.619, -1)  # lower: bars c and k
    d = meet(o, c, 0.401, 0.558, 1)  # triangle b, d, e
    e = meet(d, f, 0.394, 0.367, -1)  # bars f and g
    g = meet(f, e, 0.49, 0.657, 1)  # triangle g, h, i: the foot
    return {"o": o, "p": p, "c": c, "f": f, "d": d, "e": e, "g": g}


def jansen(t: Curve) -> Curves:
    """Foot and upper rocker of Jansen's leg, its crank at 2 rad/s."""
    pins = jansen_pose(steady(t, 2.0))
    return named(foot=pins["g"], knee=pins["e"], upper=angle(minus(pins["c"], pins["o"])))


def quick_return(t: Curve) -> Curves:
    """Whitworth's quick return: crank 0.1 m about (0, 0.05), lever 0.2 m about 0, coupler 0.5 m.

    The crank, at 2 rad/s, carries a block along the lever; the lever's end moves a ram along x.
    """
    block = plus(fixed(0.05j, t), turned(steady(t, 2.0), 0.1))
    lever = angle(block)
    ram = slid(turned(lever, 0.2), 0.5, 1.0, 1)
    return named(lever=lever, block=length(block), ram=tuple(part.real for part in ram))


# ---- LET GO ----------------------------------------------------------------------------------

Bodies = Callable[[Point], list[tuple[float, float, Point, Point]]]
"""Mass [kg], moment of inertia [kg m2], centre and angle of each body, by the crank's angle."""


def let_go(t: Curve, start: float, bodies: Bodies,
           effort: Callable[[Point, float], Curve | float] = lambda *_: 0.0) -> Point:
    """A crank let go at rest, with all that hangs on it; `effort` is its moment beside weight.

    J(q) q'' + J'(q) q'^2 / 2 = Q(q, q'), J and J' from the points' derivatives by the angle.
    """
    def state(q: float) -> Point:
        return np.array([q]), np.ones(1), np.zeros(1)  # derivatives by the angle itself

    def accelerated(q: float, w: float) -> float:
        crank = state(q)
        inertia, change, moment = np.zeros((3, 1))
        for mass, about, centre, turn in bodies(crank):
            inertia += mass * abs(centre[1])**2 + about * turn[1]**2
            change += mass * dot(centre[1], centre[2]) + about * turn[1] * turn[2]
            moment -= mass * G * centre[1].imag
        return float(((moment + effort(crank, w) - change * w**2) / inertia)[0])

    found = solve_ivp(lambda _, y: [y[1], accelerated(*y)], (t[0], t[-1]), [start, 0.0],
                      method="DOP853", t_eval=t, rtol=1e-12, atol=1e-13)
    q, w = found.y
    return q, w, np.array([accelerated(*y) for y in found.y.T])


def bar(mass: float, one: Point, two: Point) -> tuple[float, float, Point, Point]:
    """A uniform bar between two points."""
    along = minus(two, one)
    middle = plus(one, tuple(0.5 * part for part in along))  # type: ignore[arg-type]
    return mass, mass * float(abs(along[0][0]))**2 / 12, middle, angle(along)


def fourbar_released(t: Curve) -> Curves:
    """The crank-rocker of uniform bars, 1 kg/m, let go from its pose with the crank along x."""
    def bodies(crank: Point) -> list[tuple[float, float, Point, Point]]:
        one, two, foot = fourbar_pose(crank, 1.0, 2.0, 2.5, 3.0, 1)
        origin = fixed(0, crank[0])
        return [bar(1.0, origin, one), bar(2.0, one, two), bar(2.5, foot, two)]

    return of_fourbar(let_go(t, 0.0, bodies))


def spring_slider(t: Curve) -> Curves:
    """Crank 0.3 m with a flywheel of 0.02 kg m2, coupler 0.7 m, slide of 1.5 kg on a spring of
    60 N/m that is free at 0.1 m and a damper of 2 N s/m; let go with the crank at 60 degrees."""
    start = math.pi / 3
    home = 0.3 * math.cos(start) + math.sqrt(0.49 - (0.3 * math.sin(start))**2)

    def bodies(crank: Point) -> list[tuple[float, float, Point, Point]]:
        pin = turned(crank, 0.3)
        slider = slid(pin, 0.7, 1.0, 1)
        origin, still = fixed(0, crank[0]), (crank[0] * 0, crank[1] * 0, crank[2])
        return [bar(0.6, origin, pin), (0.0, 0.02, origin, crank), bar(0.9, pin, slider),
                (1.5, 0.0, slider, still)]

    def effort(crank: Point, w: float) -> Curve:
        place, rate, _ = (part.real for part in slid(turned(crank, 0.3), 0.7, 1.0, 1))
        return -(60.0 * (place - home - 0.1) + 2.0 * rate * w) * rate

    crank = let_go(t, start, bodies, effort)
    place, rate, acceleration = (part.real for part in slid(turned(crank, 0.3), 0.7, 1.0, 1))
    return named(crank=crank, slide=(place - home, rate, acceleration))


def pendulum(t: Curve) -> Curves:
    """A point mass of 1 kg on 1 m, let go from the horizontal: Jacobi's elliptic functions."""
    k, w = math.sin(math.pi / 4), math.sqrt(G)
    sn, cn, dn, _ = ellipj(ellipk(k**2) - w * t, k**2)
    value, rate = -2 * np.arcsin(k * sn), 2 * k * w * cn
    assert np.allclose(dn**2, 1 - k**2 * sn**2)
    return {"angle": value, "rate": rate, "acceleration": -w**2 * np.sin(value),
            "kinetic": rate**2 / 2, "potential": G * (1 - np.cos(value))}


def double_pendulum(t: Curve) -> Curves:
    """Uniform bars of 0.8 m and 1 kg, 0.6 m and 0.7 kg; let go at 100 and 40 degrees from down."""
    m1, l1, m2, l2 = 1.0, 0.8, 0.7, 0.6
    a = (m1 / 3 + m2) * l1**2
    b, c = m2 * l1 * l2 / 2, m2 * l2**2 / 3

    def rates(_: float, y: Curve) -> Curve:
        p, q, u, v = y
        s, o = np.sin(p - q), b * np.cos(p - q)
        f = -b * s * v**2 - (m1 / 2 + m2) * G * l1 * np.sin(p)
        g = b * s * u**2 - m2 * G * l2 / 2 * np.sin(q)
        d = a * c - o**2
        return np.array([u, v, (c * f - o * g) / d, (a * g - o * f) / d])

    y = solve_ivp(rates, (t[0], t[-1]), [math.radians(100), math.radians(40), 0.0, 0.0],
                  method="DOP853", t_eval=t, rtol=1e-12, atol=1e-13).y
    change = rates(0.0, y)
    first, second = ((y[k], y[k + 2], change[k + 2]) for k in range(2))
    tip = plus(turned(first, -0.8j), turned(second, -0.6j))
    elbow = tuple(two - one for one, two in zip(first, second, strict=True))
    return named(shoulder=first, elbow=elbow, tip=tip)


# ---- COMPARISON ------------------------------------------------------------------------------

TRUTHS = {one.__name__: one for one in (
    fourbar, slider_crank, swinging_block, fivebar_swing, jansen, quick_return, fourbar_released,
    spring_slider, pendulum, double_pendulum)}


KNOWN: dict[tuple[str, bytes], Curves] = {}
"""True curves by case and times; what is let go takes a second to integrate."""


def read(file: str) -> tuple[Curve, Curves]:
    """Times and curves of a file that a program wrote."""
    with open(file, encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    columns = np.array(rows[1:], float).T
    return columns[0], dict(zip(rows[0][1:], columns[1:], strict=True))


def kind_of(name: str) -> str:
    """What a curve is, by its name."""
    if name.endswith("moment"):
        return "force"
    if "acceleration" in name:
        return "acceleration"
    return "velocity" if "rate" in name or "velocity" in name else "position"


def errors(case: str, file: str) -> dict[str, float]:
    """The largest error of each kind of curve, as a share of the range of the true one.

    Columns of what a drive did are left out: the true motion is the one that was asked for.
    """
    t, curves = read(file)
    if (case, t.tobytes()) not in KNOWN:
        KNOWN[case, t.tobytes()] = TRUTHS[case](t)
    true = KNOWN[case, t.tobytes()]
    found: dict[str, float] = {}
    for name, curve in curves.items():
        if " drive" in name or name in ("kinetic", "potential"):
            continue
        if np.ptp(true[name]) > 1e-9:
            off = float(abs(curve - true[name]).max() / np.ptp(true[name]))
            found[kind_of(name)] = max(off, found.get(kind_of(name), 0.0))
    return found


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in TRUTHS:
        sys.exit(f"python truths.py CASE curves.csv, with CASE one of {', '.join(TRUTHS)}")
    for what, off in errors(*sys.argv[1:]).items():
        print(f"{what} {off:.2g}")
