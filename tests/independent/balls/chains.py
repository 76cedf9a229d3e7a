"""Balancers in balls: a chain of segments with torsion springs and stops, at rest on a pendulum.

The chain is at rest where its energy is stationary under the loop.  Written with the force of the
pendulum on the tip and with the moments of joints on stops as unknowns, that is a balance of
moments of each segment.  The posture of the reference says which joints are on a stop; the proof
shows that they press on it, and that no other joint is beyond one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf

from flint import acb, acb_series, arb

from tests.independent.balls.loops import IMAGINARY, CaseNumbers, Loops, NotProven

ON_STOP = 1e-9
"""Distance from a stop [rad] within which a joint of the reference counts as on it."""


@dataclass(frozen=True)
class TorsionSpring:
    """M = preload + k e + A e^2 at the deflection e from rest, and the energy stored at rest."""

    preload: arb
    stiffness: arb
    quadratic: arb
    stored: arb

    def moment(self, e: acb_series) -> acb_series:
        """Its moment [N m]."""
        k, a, m = acb(self.stiffness), acb(self.quadratic), acb(self.preload)
        return e * (e * a + k) + m

    def energy(self, e: acb_series) -> acb_series:
        """Its energy [J], from the slack spring on."""
        k, a, m = acb(self.stiffness), acb(self.quadratic), acb(self.preload)
        return e * (e * (e * (a / 3) + k / 2) + m) + acb(self.stored)


def make_spring(p: CaseNumbers, number: int) -> TorsionSpring:
    """The spring of a joint, wound up to its preload: M0 = k x + A x^2 at x, k' = k + 2 A x."""
    slack, a = arb(p[f"stiffness{number}"]), arb(p[f"quadratic{number}"])
    preload = arb(p[f"preload{number}"])
    if preload == 0:
        return TorsionSpring(preload, slack, a, arb(0))
    stiff = (slack * slack + 4 * a * preload).sqrt()
    if slack + stiff == 0:  # a constant moment, whose energy has no slack state
        return TorsionSpring(preload, stiff, a, arb(0))
    x = 2 * preload / (slack + stiff)
    return TorsionSpring(preload, stiff, a, x * x * (slack / 2 + a * x / 3))


def rest_posture(p: CaseNumbers, lengths: Sequence[arb]) -> list[arb]:
    """Angles of the segments below an upright pendulum, clockwise from the upright [rad].

    The last two form a triangle with the line from their start to the tip.
    """
    first = [arb(p[name]) for name in ("rest_angle", "rest_angle2")][: len(lengths) - 2]
    x, y = arb(0), arb(p["pendulum"])
    for length, angle in zip(lengths, first, strict=False):
        x, y = x - length * angle.sin(), y - length * angle.cos()
    a, c = lengths[-2:]
    square = x * x + y * y
    distance, toward = square.sqrt(), acb(y, x).arg()
    near = ((square + a * a - c * c) / (2 * distance * a)).acos()
    far = ((square + c * c - a * a) / (2 * distance * c)).acos()
    mode = int(p["mode"])
    return [*first, toward - mode * near, toward + mode * far]


@dataclass(frozen=True)
class SpringChain:
    """The chain of a balancer whose joints `stopped` are on a stop; calling it is a `Form`.

    Unknowns: angles of the segments, force on the chain at the tip (x, y), moments of the joints on
    stops.  `rest` are the angles at rest.
    """

    lengths: tuple[arb, ...]
    rest: tuple[arb, ...]
    springs: tuple[TorsionSpring, ...]
    stopped: Mapping[int, arb]

    def __call__(
        self, p: CaseNumbers, u: Sequence[acb_series], q: Sequence[acb_series], whole: bool
    ) -> Loops:
        """The chain at the pendulum's angle u and the unknowns q."""
        n, alpha, zero = len(self.lengths), u[0], 0 * u[0]
        angles, (force_x, force_y), stops = q[:n], q[n : n + 2], q[n + 2 :]
        sides = [(one.sin() * acb(a), one.cos() * acb(a)) for a, one in self.segments(angles)]
        reach = acb(arb(p["pendulum"])) + alpha * (
            acb(arb(p["extension1"])) + alpha * acb(arb(p["extension2"]))
        )
        x = sum((side[0] for side in sides), zero) - reach * alpha.sin()
        y = sum((side[1] for side in sides), zero) - reach * alpha.cos()
        loops, e = Loops([x + IMAGINARY * y]), self.deflections(angles)
        carried = [one.moment(turned) for one, turned in zip(self.springs, e, strict=True)]
        for joint, moment in zip(self.stopped, stops, strict=True):
            carried[joint] = moment
        for side, here, beyond in zip(sides, carried, [*carried[1:], zero], strict=True):
            loops.scalars.append(here - beyond - (force_x * side[1] - force_y * side[0]))
        loops.scalars += [e[k] - acb(stop) for k, stop in self.stopped.items()]
        if whole:
            self.add_postures(loops, angles, e, sides)
            self.add_loads(loops, p, alpha, reach, (force_x, force_y), angles, e, carried)
        return loops

    def segments(self, angles: Sequence[acb_series]) -> list[tuple[arb, acb_series]]:
        """Length and angle of each segment."""
        return list(zip(self.lengths, angles, strict=True))

    def deflections(self, angles: Sequence[acb_series]) -> list[acb_series]:
        """Deflections of the joints from rest."""
        turned = [one - acb(rest) for one, rest in zip(angles, self.rest, strict=True)]
        return [turned[0], *(two - one for one, two in pairwise(turned))]

    def add_postures(
        self,
        loops: Loops,
        angles: Sequence[acb_series],
        e: Sequence[acb_series],
        sides: Sequence[tuple[acb_series, acb_series]],
    ) -> None:
        """Add angles, deflections and places of joints."""
        place = 0 * angles[0]
        for k, (angle, turned) in enumerate(zip(angles, e, strict=True)):
            loops.add_scalar(f"theta{k + 1}", angle)
            loops.add_scalar(f"deflection{k + 1}", turned)
            if k:
                loops.add_point(f"node{k + 1}", place)
            place = place + sides[k][0] + IMAGINARY * sides[k][1]

    def add_loads(
        self,
        loops: Loops,
        p: CaseNumbers,
        alpha: acb_series,
        reach: acb_series,
        force: tuple[acb_series, acb_series],
        angles: Sequence[acb_series],
        e: Sequence[acb_series],
        carried: Sequence[acb_series],
    ) -> None:
        """Add moments, forces and energies; `force` is that of the pendulum on the tip."""
        weight, sine, cosine = acb(arb(p["weight"])), alpha.sin(), alpha.cos()
        stretch = acb(arb(p["extension1"])) + 2 * alpha * acb(arb(p["extension2"]))
        turning = (force[0] * cosine - force[1] * sine) * reach
        along = force[0] * sine + force[1] * cosine
        curves = {
            "holding_moment": turning - weight * reach * sine,
            "balancing_moment": turning + along * stretch,
            "extension_force": along + weight * cosine,
            "weight_energy": weight * reach * cosine,
            "force_x": -force[0],
            "force_y": -force[1],
        }
        energies = [one.energy(turned) for one, turned in zip(self.springs, e, strict=True)]
        curves["energy"] = sum(energies, curves["weight_energy"])
        for k, (angle, turned) in enumerate(zip(angles, e, strict=True)):
            s, c = angle.sin(), angle.cos()
            curves |= {
                f"moment{k + 1}": self.springs[k].moment(turned),
                f"energy{k + 1}": energies[k],
                f"node{k + 1}_force_x": -force[0] * s - force[1] * c,
                f"node{k + 1}_force_y": force[0] * c - force[1] * s,
                f"node{k + 1}_load": carried[k],
            }
        loops.channels |= {name: (one, 0, "real") for name, one in curves.items()}

    def check_stops(self, p: CaseNumbers, pose: Sequence[arb]) -> None:
        """Raise NotProven unless joints press on their stops, and no other one is beyond one."""
        n = len(self.lengths)
        turned = [one - rest for one, rest in zip(pose, self.rest, strict=False)]
        e = [turned[0], *(two - one for one, two in pairwise(turned))]
        moments = dict(zip(self.stopped, pose[n + 2 :], strict=True))
        for k in range(n):
            low, high = stops_of(p, k + 1)
            if k not in moments:
                if not low < e[k] < high:
                    raise NotProven(f"joint {k + 1} is not between its stops")
                continue
            spring = self.springs[k].moment(acb_series([acb(self.stopped[k])]))[0].real
            of_stop = spring - moments[k]
            if not (of_stop > 0 if self.stopped[k] == arb(low) else of_stop < 0):
                raise NotProven(f"joint {k + 1} does not press on its stop")


def make_chain(p: CaseNumbers, deflections: Sequence[float]) -> SpringChain:
    """The chain of a balancer at about the given deflections from rest [rad]."""
    n = len(deflections)
    lengths = tuple(arb(p[f"length{k + 1}"]) for k in range(n))
    stopped = {
        k: arb(stop)
        for k, e in enumerate(deflections)
        for stop in stops_of(p, k + 1)
        if abs(e - stop) < ON_STOP
    }
    springs = tuple(make_spring(p, k + 1) for k in range(n))
    return SpringChain(lengths, tuple(rest_posture(p, lengths)), springs, stopped)


def stops_of(p: CaseNumbers, joint: int) -> tuple[float, float]:
    """The stops of a joint's deflection [rad]; infinite where there are none."""
    names = f"low{joint}", f"high{joint}"
    low, high = (p[name] if name in p.given else None for name in names)
    return -inf if low is None else low, inf if high is None else high


def segments_of(p: CaseNumbers) -> int:
    """Number of segments of a balancer."""
    return max(k for k in (2, 3, 4) if p.given.get(f"length{k}"))
