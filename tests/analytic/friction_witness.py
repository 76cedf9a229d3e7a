"""Motions with dry friction and stops from event to event, without proofmass.

Equations of motion by hand, `solve_ivp` with its own events, and decisions by trying all patterns.
"""

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

TOLERANCE = 1e-13
LONGEST = 0.01
"""Longest step [s]: no event of the mechanisms of the tests is shorter."""


@dataclass
class Chain:
    """Bars in the x-y plane, each on a hinge at the end of the one before, perhaps on a slide.

    Lengths, centres, masses and inertias are those of the bars; springs, dampers, frictions, stops
    (joint, side, value, restitution) and poses are those of the joints, the slide along x first.
    `ratio` is the damping ratio of the stops in the model.
    """

    slide: float
    length: np.ndarray
    centre: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    friction: np.ndarray
    start: np.ndarray
    rate: np.ndarray
    stops: list[tuple[int, float, float, float]] = field(default_factory=list)
    gravity: float = 9.81
    ratio: float = 1.0

    @property
    def has_slide(self) -> bool:
        return self.slide > 0

    def terms(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mass matrix, and the force without friction less what the rates need."""
        first, n, joints = int(self.has_slide), self.length.size, q.size
        angle, spin = np.cumsum(q[first:]), np.cumsum(v[first:])
        mass, force = np.zeros((joints, joints)), -self.stiffness * q - self.damping * v
        if self.has_slide:
            mass[0, 0] += self.slide
        pins, pull, place, change = [], 0j, complex(q[0] if first else 0.0), 0j
        for b in range(n):
            along = np.exp(1j * angle[b])
            pins.append(place)
            centre = place + self.centre[b] * along
            pull = change - spin[b] ** 2 * self.centre[b] * along
            row = np.zeros(joints, complex)
            turn = np.zeros(joints)
            if first:
                row[0] = 1.0
            for j in range(b + 1):
                row[first + j], turn[first + j] = 1j * (centre - pins[j]), 1.0
            mass += self.mass[b] * (np.outer(row.conj(), row)).real
            mass += self.inertia[b] * np.outer(turn, turn)
            force += (row.conj() * self.mass[b] * (-1j * self.gravity - pull)).real
            place, change = (
                place + self.length[b] * along,
                change - spin[b] ** 2 * self.length[b] * along,
            )
        return mass, force


@dataclass
class Motion:
    """Events (time, joint), and the end."""

    events: list[tuple[float, int]]
    q: np.ndarray
    v: np.ndarray


def follow(chain: Chain, until: float) -> Motion:
    """The motion of a chain until a time [s]."""
    n, events = chain.start.size, []
    q, v, t = chain.start.astype(float), chain.rate.astype(float), 0.0
    senses = decide(chain, q, v, np.sign(v))
    while t < until:
        conditions = list(make_conditions(chain, senses))
        found = solve_ivp(
            slope_in_phase(chain, senses),
            (t, until),
            np.concatenate([q, v]),
            "DOP853",
            rtol=TOLERANCE,
            atol=TOLERANCE,
            max_step=LONGEST,
            events=[one for _, _, one in conditions],
        )
        t, q, v = float(found.t[-1]), found.y[:n, -1].copy(), found.y[n:, -1].copy()
        hit = [k for k, times in enumerate(found.t_events) if len(times)]
        if not hit:
            return Motion(events, q, v)
        kind, joint, _ = conditions[hit[0]]
        events.append((t, joint))
        if kind == "impact":
            _, _, value, restitution = next(one for one in chain.stops if one[0] == joint)
            inverse = np.linalg.inv(chain.terms(q, v)[0])[joint]
            v -= inverse * (1.0 + restitution) * v[joint] / inverse[joint]
            q[joint] = value
            senses = decide(chain, q, v, np.sign(np.where(np.abs(v) < 1e-12, 0.0, v)))
        elif kind == "halt":
            v[joint], still = 0.0, senses.copy()
            still[joint] = 0.0
            senses = decide(chain, q, v, still)
        else:
            force = accelerations(chain, q, v, senses)[1][joint]
            senses = senses.copy()
            senses[joint] = -np.sign(force)
    return Motion(events, q, v)


def slope_in_phase(chain: Chain, senses: np.ndarray):
    """The time derivative of (q, v) where all joints keep their senses."""
    n = senses.size
    return lambda _, y: np.concatenate([y[n:], accelerations(chain, y[:n], y[n:], senses)[0]])


def bounds(chain: Chain, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest force on the joints at rest: at a stop it is unlimited on one side."""
    low, high = -chain.friction.copy(), chain.friction.copy()
    for joint, side, value, _ in chain.stops:
        if abs(q[joint] - value) < 1e-9:
            (low if side > 0 else high)[joint] = -side * np.inf
    return low, high


def accelerations(chain, q, v, senses) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations, and forces of friction and stops, where joints of sense 0 are at rest."""
    mass, force = chain.terms(q, v)
    slips, own = senses != 0, -senses * chain.friction
    a = np.zeros(q.size)
    a[slips] = np.linalg.solve(mass[np.ix_(slips, slips)], (force + own)[slips])
    return a, np.where(slips, own, mass @ a - force)


def decide(chain, q, v, given) -> np.ndarray:
    """The senses after an event; those that are zero are found by trying all patterns."""
    still, (low, high) = np.flatnonzero(given == 0), bounds(chain, q)
    for pattern in sorted(product((0.0, 1.0, -1.0), repeat=still.size), key=np.count_nonzero):
        senses = given.copy()
        senses[still] = pattern
        a, force = accelerations(chain, q, v, senses)
        slips = senses[still] != 0
        forward = (senses[still] * a[still])[slips] > 1e-9
        within = (force[still] >= low[still] - 1e-9) & (force[still] <= high[still] + 1e-9)
        if forward.all() and within[~slips].all() and may_leave(chain, q, senses, still):
            return senses
    raise AssertionError("no pattern")


def may_leave(chain, q, senses, still) -> bool:
    """Whether no joint leaves rest through its stop."""
    return not any(
        joint in still and abs(q[joint] - value) < 1e-9 and senses[joint] == side
        for joint, side, value, _ in chain.stops
    )


def make_conditions(chain: Chain, senses: np.ndarray):
    """Kinds of events with their joints and functions that fall through zero."""
    n = senses.size

    def condition(kind, joint, function):
        function.terminal, function.direction = True, -1
        return kind, joint, function

    for j in np.flatnonzero(senses != 0).tolist():
        yield condition("halt", j, lambda t, y, j=j: senses[j] * y[n + j])
    for j in np.flatnonzero(senses == 0).tolist():

        def reserve(t, y, j=j):
            force = accelerations(chain, y[:n], y[n:], senses)[1][j]
            low, high = bounds(chain, y[:n])
            return min(force - low[j], high[j] - force)

        yield condition("slip", j, reserve)
    for joint, side, value, _ in chain.stops:
        if senses[joint] == side:
            yield condition("impact", joint, lambda t, y, j=joint, s=side, x=value: s * (x - y[j]))


def chain_model(chain: Chain) -> str:
    """The MJCF of a chain."""
    first = int(chain.has_slide)
    names = [f"j{k}" for k in range(chain.start.size)]

    def joint(k: int, kind: str, axis: str) -> str:
        found = f'<joint name="{names[k]}" type="{kind}" axis="{axis}"'
        found += f' stiffness="{chain.stiffness[k]!r}" damping="{chain.damping[k]!r}"'
        found += f' frictionloss="{chain.friction[k]!r}"'
        for one, side, value, _ in chain.stops:
            if one == k:
                ends = (-9.0, value) if side > 0 else (value, 9.0)
                found += f' range="{ends[0]!r} {ends[1]!r}" solreflimit="0.01 {chain.ratio!r}"'
        return found + "/>"

    text = ""
    for b in reversed(range(chain.length.size)):
        place = f'pos="{chain.length[b - 1]!r} 0 0"' if b else ""
        own = f'<inertial pos="{chain.centre[b]!r} 0 0" mass="{chain.mass[b]!r}"'
        own += ' diaginertia="' + " ".join([repr(float(chain.inertia[b]))] * 3) + '"/>'
        text = f"<body {place}>{joint(first + b, 'hinge', '0 0 1')}{own}{text}</body>"
    if first:
        own = f'<inertial pos="0 0 0" mass="{chain.slide!r}" diaginertia="1 1 1"/>'
        text = f"<body>{joint(0, 'slide', '1 0 0')}{own}{text}</body>"
    sensors = "".join(
        f'<jointpos name="{n}" joint="{n}"/><jointvel name="{n}_rate" joint="{n}"/>' for n in names
    )
    pose, rate = (" ".join(map(repr, x.tolist())) for x in (chain.start, chain.rate))
    text = f"""<mujoco><compiler angle="radian" autolimits="true"/>
      <option gravity="0 {-chain.gravity} 0"><flag contact="disable"/></option><worldbody>{text}
      </worldbody><sensor>{sensors}<e_potential name="potential"/>
      <e_kinetic name="kinetic"/></sensor>
      <keyframe><key name="start" qpos="{pose}" qvel="{rate}"/></keyframe></mujoco>"""
    return text.replace("np.float64(", "").replace(")", "")


def random_chain(seed: int, stops: bool = False, damped: bool = True) -> Chain:
    """A chain of two to four joints, all with dry friction of the order of the other forces."""
    random = np.random.default_rng(seed)
    bars, slide = int(random.integers(1, 4)), bool(random.integers(0, 2))
    joints = bars + slide if bars + slide > 1 else 2
    bars = joints - slide
    length, mass = random.uniform(0.2, 0.5, bars), random.uniform(0.3, 1.5, bars)
    friction = 10.0 ** random.uniform(-1.6, 0.4, joints)
    stiffness, damping = random.uniform(0, 6, joints), 0.05 * random.uniform(0, 1, joints) * damped
    if slide:
        friction[0], stiffness[0] = random.uniform(0.5, 5.0), random.uniform(20, 200)
    start, rate = random.uniform(-1.5, 1.5, joints), random.uniform(-2, 2, joints)
    rate[random.uniform(size=joints) < 0.4] = 0.0
    if slide:
        start[0] *= 0.2
    found = Chain(
        float(slide) * random.uniform(0.5, 2.0),
        length,
        length * random.uniform(0.3, 0.7, bars),
        mass,
        mass * length**2 / 10,
        stiffness,
        damping,
        friction,
        start,
        rate,
    )
    if stops:
        joint = joints - 1
        found.stops = [(joint, 1.0, float(start[joint] + random.uniform(0.1, 0.6)), np.nan)]
    return found


def brent(function, low, high) -> float:
    """A root to rounding."""
    return float(brentq(function, low, high, xtol=1e-15, rtol=1e-15))
