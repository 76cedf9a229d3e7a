"""How well the motion of a model is known that no sidecar speaks of.

The rungs, from below:

* *unchecked*: it runs, and nothing says whether its motion is what its equations ask for;
* *self-consistent until T*: two ways of solving its own equations agree until then.  The model may
  still be the wrong one: contacts and loops are as soft as its file says;
* *agrees*: an independent reference, which a sidecar names, agrees within a tolerance;
* *exact*: that reference is a closed form, or has a witness of its own.

The first two are found for a model by itself, see `proofmass.check.check_model`.  Its motion is
solved in several ways by an engine, see `proofmass.sim.protocol.OwnMotion`.  The distance of two
ways is the largest of all points of all bodies until a time; it counts as a share of the model's
size, or of the way that a point has gone until then, if that is longer.  Three things are looked
at:

steps
    The two finest steps differ by less than `WITHIN`, the last two halvings left less of the
    difference before them than 1 / `FALLS`^2, with an order of no more than `FASTEST`, and the
    first of them did not make it `JUMPS` times as large.
close
    An integrator that chooses its steps is as near to the finest steps, and to itself with a wider
    allowance.
disturbed
    A start pose that differs by 1e-9 leads to a motion that is as near.

A motion is self-consistent until the last time at which two of the three hold.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import inf, isnan, log2, nan

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import OwnMotion, OwnRun
from proofmass.wording import format_list, number

Bools = NDArray[np.bool_]
PROCESSOR = 36.0
"""Processor time of all ways to solve the motion of a model [s]."""
WITHIN = 1e-3
"""Share of the size within which two ways agree: a pixel of a picture of 1000."""
FALLS = 1.6
"""Errors of first order that contacts scatter fall by this with half the step, rather than by 2."""
JUMPS = 2.0
"""Contacts scatter differences by less; by more, finer steps lead to another motion."""
FASTEST = 2.1
"""Largest order that counts as convergence.  MuJoCo's steps are of first order, or of second from
rest; errors that fall faster show that the coarser steps led to another motion.  RK4 is of fourth
order where nothing touches; there `close` and `disturbed` decide."""
ROUNDING = 1e-9
"""Share of the size below which a difference need not fall any more."""
CHAOTIC = 1e3
"""Growth of a disturbance beyond which no step could help for long."""
BETTER = 0.1, 0.55
"""Shares of the own error that another setting must have to be named, the first if there is one."""


@dataclass(frozen=True)
class Alternative:
    """Another setting, its error at T [m], and how many times as long as the own it takes.

    That is NaN where the clock is too coarse for the own one.
    """

    name: str
    error: float
    times: float


class Rung:
    """What the ways to solve a model's own motion tell.

    Parameters
    ----------
    motion : OwnMotion
        Whose first run does not fail, see `why_failed`.
    """

    def __init__(self, motion: OwnMotion) -> None:
        self.motion = motion
        self.count = min(len(run.points) for run in motion.runs)

    def padded(self, holds: Bools) -> Bools:
        """Whether something holds, at each sample that all runs with a step have."""
        found = np.zeros(self.count, bool)
        found[: holds.size] = holds[: self.count]
        return found

    def apart(self, one: OwnRun, two: OwnRun) -> Array:
        """The largest distance of two ways until each sample that both have [m]."""
        n = min(len(one.points), len(two.points))
        return farthest(one.points[:n] - two.points[:n])

    @cached_property
    def sizes(self) -> Array:
        """What shares are of: the model's size, or the longest way until each sample [m]."""
        points = self.fine.points[: self.count]
        return np.maximum(farthest(points - points[:1]), self.motion.extent or 1e-300)

    @cached_property
    def differences(self) -> list[Array]:
        """Of each run with a step to the one with half of it."""
        return [self.apart(*pair)[: self.count] for pair in pairwise(self.motion.runs)]

    @property
    def fine(self) -> OwnRun:
        """The run with the finest step."""
        return self.motion.runs[-1]

    @cached_property
    def by_steps(self) -> Bools:
        """Whether finer steps converge, sample by sample."""
        if len(self.differences) < 3:
            return np.zeros(self.count, bool)
        first, second, last = self.differences[-3:]
        rounding = ROUNDING * self.sizes
        falls = (first >= FALLS**2 * last) & (first <= 2 ** (2 * FASTEST) * last)
        falls |= last <= rounding
        jumps = second > np.maximum(JUMPS * first, rounding)
        return (last <= WITHIN * self.sizes) & falls & ~jumps

    @cached_property
    def closely(self) -> Bools:
        """Whether the way that chooses its steps agrees with the finest, sample by sample."""
        own, other = (self.apart(self.motion.close, x) for x in (self.motion.rough, self.fine))
        n = min(own.size, other.size, self.count)
        return self.padded(np.maximum(own[:n], other[:n]) <= WITHIN * self.sizes[:n])

    @cached_property
    def parted(self) -> Array:
        """How far a disturbed start leads, until each sample [m]."""
        return self.apart(self.motion.disturbed, self.motion.runs[self.motion.compared])

    @cached_property
    def steady(self) -> Bools:
        """Whether a disturbed start leads to the same motion, sample by sample."""
        n = min(self.parted.size, self.count)
        return self.padded(self.parted[:n] <= WITHIN * self.sizes[:n])

    @cached_property
    def last(self) -> int:
        """The last sample until which two of the three hold; 0 if they never do."""
        votes = self.by_steps.astype(int) + self.closely + self.steady
        fails = np.flatnonzero(votes < 2)
        return max(0, int(fails[0]) - 1) if fails.size else len(votes) - 1

    @property
    def until(self) -> float:
        """T [s]."""
        return float(self.motion.times[self.last])

    @property
    def closely_until(self) -> float:
        """Until when the way that chooses its steps is right [s]; 0 if it never is."""
        if not self.consistent:
            return 0.0
        fails = np.flatnonzero(~self.closely[: self.last + 1])
        return float(self.motion.times[max(0, int(fails[0]) - 1) if fails.size else self.last])

    @property
    def whole_run(self) -> bool:
        """Whether T is the end."""
        return self.last == len(self.motion.times) - 1

    @property
    def consistent(self) -> bool:
        """Whether something moves, and its motion is self-consistent until some time."""
        return self.last > 0 and self.motion.dof > 0

    @cached_property
    def best(self) -> OwnRun:
        """The way that others are held against: the close one, where the steps agree with it."""
        return self.motion.close if self.closely[: self.last + 1].all() else self.fine

    @property
    def sure(self) -> bool:
        """Whether the way that chooses its steps is right until the end of what was asked."""
        return self.whole_run and self.consistent and self.best is self.motion.close

    def error(self, run: OwnRun) -> float:
        """How far a run is off the best one until T [m]; infinite where it ended before."""
        found = self.apart(run, self.best)
        return float(found[self.last]) if found.size > self.last else inf

    @property
    def known(self) -> float:
        """To what the motion is known until T [m]: what two ways differ by, or steps have to go.

        At first order at best, for a higher one that is observed may not last.
        """
        if self.best is not self.fine:
            return self.error(self.fine)
        order = log2(FALLS) if np.isnan(self.order) else self.order
        ratio = 2.0 ** min(max(order, log2(FALLS)), 1.0)
        return float(self.differences[-1][self.last]) / (ratio - 1.0) if self.differences else inf

    @property
    def order(self) -> float:
        """Order with which the last two halvings converge until T; NaN where nothing is left."""
        if len(self.differences) < 3:
            return nan
        coarse, _, fine = (float(one[self.last]) for one in self.differences[-3:])
        return log2(coarse / fine) / 2.0 if fine > ROUNDING * self.sizes[self.last] else nan

    @property
    def growth(self) -> float:
        """What a disturbance of the start has grown by at the last sample [1]."""
        return self.grown(-1)

    def grown(self, k: int) -> float:
        """What a disturbance of the start has grown by at sample k [1]."""
        begun = self.motion.disturbance * (self.motion.extent or 1.0)
        return float(self.parted[k]) / begun

    def ways(self) -> Iterator[Alternative]:
        """Other settings, the model's own first."""
        own = self.motion.runs[0]
        for run in (*self.motion.runs, *self.motion.others):
            times = run.seconds / own.seconds if own.seconds else nan
            yield Alternative(run.name, self.error(run), times)

    def better(self) -> Alternative | None:
        """The cheapest setting with a tenth of the own error, or about half; None if none has.

        The finest step, which others may be held against, is none.
        """
        own, *others = self.ways()
        for share in BETTER:
            good = [way for way in others if 0 < way.error <= share * own.error]
            if good:
                return min(good, key=lambda way: (isnan(way.times), way.times))
        return None

    @property
    def softness(self) -> float:
        """How far stiffer contacts and loops move the motion until T [m]; NaN if there are none."""
        if self.motion.stiffer is None:
            return nan
        found = self.apart(self.motion.stiffer, self.motion.runs[self.motion.compared])
        return float(found[self.last]) if found.size > self.last else nan

    def why(self) -> str:
        """Why no more is known."""
        if self.whole_run:
            return ""
        if self.last == self.count - 1:
            failed = [run for run in self.motion.runs if run.stopped and not run.late]
            if failed:
                return f"{failed[0].name} fails: {failed[0].stopped}"
            return "no more was followed in the time that there is"
        k = min(self.last + 1, self.parted.size - 1)
        growth = self.grown(k)
        if growth > CHAOTIC or self.growth > CHAOTIC:
            return (
                f"a disturbance of {number(self.motion.disturbance, 1)} has grown "
                f"{number(self.growth, 2)} times at {number(self.end, 3)} s"
            )
        if len(self.differences) < 3:
            return f"{len(self.motion.runs)} steps alone were tried"
        first, second, last = (float(one[self.last + 1]) for one in self.differences[-3:])
        if first < FALLS**2 * last or second > JUMPS * first:
            return (
                "finer steps do not converge there, though a disturbance grows "
                f"{number(growth, 2)} times only: a force jumps, or contacts chatter"
            )
        return f"the two finest steps, of {format_step(self.fine)}, differ by more"

    @property
    def end(self) -> float:
        """Time of the last sample that all runs have [s]."""
        return float(self.motion.times[self.count - 1])

    def words(self) -> str:
        """All of it in a few sentences."""
        if not self.motion.dof:
            return "nothing moves: the model has no joints"
        if not self.consistent:
            return f"no two ways of solving its motion agree at any time: {self.why()}"
        return " ".join(self.sentences())

    def sentences(self) -> Iterator[str]:
        """What is said of a self-consistent motion."""
        own, known, end = self.motion.runs[0], self.known, ", its end" if self.whole_run else ""
        error = self.error(own)
        off = f"off by {format_length(error)}" if error > known else "off by no more than that"
        yield (
            f"until {number(self.until)} s{end}, known to {format_length(known)} and {off} "
            f"as it is ({own.name})."
        )
        evidence = format_list(self.evidence())
        yield f"{evidence[0].upper()}{evidence[1:]}."
        if error > known and (way := self.better()):
            cost = "" if isnan(way.times) else f" in {number(way.times, 2)} × the time"
            yield f"{way.name}: {format_length(way.error)}{cost}."
        if self.softness > max(error, known):
            moved = format_length(self.softness)
            yield (
                f"Contacts, loops and limits 4 × as stiff move it by {moved}: "
                "their softness matters more than the step."
            )
        if not self.whole_run:
            yield f"Then {self.why()}; {self.after()}."

    def evidence(self) -> Iterator[str]:
        """What shows that the motion is known until T."""
        k = self.last
        if self.by_steps[k]:
            order = "" if np.isnan(self.order) else f" with order {number(self.order, 2)}"
            yield f"steps down to {format_step(self.fine)} converge{order}"
        if self.closely[k]:
            yield f"{self.motion.close.name} agrees with the finest"
        if self.steady[k]:
            yield f"a start that differs by {number(self.motion.disturbance)} leads there as well"

    def after(self) -> str:
        """What the two finest steps say of the end, beside positions."""
        coarse, fine = self.motion.runs[-2:]
        end = self.count - 1
        swing = float(np.ptp(fine.energy)) or 1.0
        energy = abs(fine.energy[end] - coarse.energy[end]) / swing
        parts = [f"energies at the end differ by {number(100 * energy, 2)} % of their swing"]
        for what, one, two in (
            ("penetrations", coarse.depth, fine.depth),
            ("openings of loops", coarse.gap, fine.gap),
        ):
            most = [float(np.max(each[: self.count])) for each in (one, two)]
            if max(most) > 0:
                parts.append(
                    f"largest {what} are {format_list(number(each, 2) for each in most)} m"
                )
        return ", ".join(parts)


def format_step(run: OwnRun) -> str:
    """A run's step in words."""
    return f"{number(1e3 * run.step)} ms"


def format_length(metres: float) -> str:
    """A length in words.

    >>> format_length(0.0078), format_length(2.5e-6), format_length(0.0)
    ('7.8 mm', '2.5 µm', '0 m')
    """
    for unit, size in (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6)):
        if metres >= size:
            return f"{number(metres / size, 2)} {unit}"
    return f"{number(metres / 1e-9, 2)} nm" if metres else "0 m"


def farthest(ways: Array) -> Array:
    """The longest of some vectors (samples, bodies, points, 3) until each sample."""
    lengths = np.linalg.norm(ways, axis=-1).reshape(len(ways), -1)
    return np.asarray(np.maximum.accumulate(lengths.max(axis=1, initial=0.0)))


def why_failed(motion: OwnMotion) -> str:
    """Why the model's own run fails; nothing if it came to its end, or to that of its time.

    >>> from proofmass.sim.protocol import OwnRun
    >>> none = np.zeros((1, 1, 1, 3))
    >>> run = OwnRun("Euler, 2 ms", 2e-3, 1.0, none, *3 * (np.zeros(1),), stopped="not finite")
    >>> why_failed(OwnMotion(np.arange(2.0), 1.0, (run,), run, run, 0, run, (), None, 1))
    'not finite, after 0 s'
    """
    own = motion.runs[0]
    if not own.stopped or (own.late and len(own.points) > 1):
        return ""
    return f"{own.stopped}, after {number(motion.times[max(0, len(own.points) - 1)])} s"
