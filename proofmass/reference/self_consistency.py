"""Self-consistency: how well the motion of a model without a sidecar is known.

There are four levels of knowledge, called rungs, from the lowest to the highest:

* *unchecked*: the model runs, and nothing shows whether its motion satisfies its equations;
* *self-consistent until T*: two ways of solving the model's own equations agree until then.  The
  model may still be wrong: contacts and loops are as soft as its file says;
* *agrees*: an independent reference, which a sidecar names, agrees within a tolerance;
* *exact*: that reference is a closed form, or is itself confirmed by a second formulation.

The first two are found for a model by itself, see `proofmass.batch.check.check_bare_model`.  Its
motion is solved in several ways by an engine, see
`proofmass.sim.protocol.own_equations.OwnMotion`.  The distance between two solutions is the largest
of all points of all bodies until a time.  It is given as a share of the model's size, or of the
longest distance that a point has moved until then, if that is longer.  There are three criteria:

steps
    The solutions with the two finest steps differ by less than `AGREEMENT_SHARE`; the last two
    halvings of the step reduced their difference at least by the factor `MIN_FALL`^2, with an order
    of at most `MAX_ORDER`; and the first of them did not make the difference larger by the factor
    `MAX_JUMP`.
close
    The solution of an integrator that chooses its steps differs by no more than `AGREEMENT_SHARE`
    from that with the finest step, and from its own with a larger error allowance.
disturbed
    A start pose that differs by 1e-9 leads to a motion that differs by no more than
    `AGREEMENT_SHARE`.

A motion is self-consistent until the last time before which two of the three criteria are met.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import inf, isfinite, isnan, log2, nan

import numpy as np
from numpy.typing import NDArray

from proofmass.base.arrays import Array
from proofmass.base.wording import format_list, number
from proofmass.sim.protocol.own_equations import STIFFENING_FACTOR, OwnMotion, OwnRun, UntriedWay

Bools = NDArray[np.bool_]
PROCESSOR_SECONDS = 36.0
"""Processor time of all solutions of a model's motion together [s].  It is counted from their steps
and evaluations, so that a verdict is the same on a slow or a busy machine."""
AGREEMENT_SHARE = 1e-3
"""Share of the size up to which two solutions agree: a pixel in a picture of 1000 pixels."""
MIN_FALL = 1.6
"""Least factor by which half the step must reduce a difference.  Errors of first order fall by 2,
but contacts scatter them."""
MAX_JUMP = 2.0
"""Factor on a difference.  Contacts scatter differences by less; if half the step makes one larger
than this, finer steps lead to another motion."""
MAX_ORDER = 2.1
"""Largest order that counts as convergence.  MuJoCo's steps are of first order, or of second from
rest; errors that fall faster show that the coarser steps led to another motion.  RK4 is of fourth
order without contacts; in that case `close` and `disturbed` decide."""
OPEN_SHARE = 1e-3
"""Largest opening of a loop in the start pose that is rounding: a share of the size [1], or an
angle [rad]."""
ROUNDING_SHARE = 1e-9
"""Share of the size below which a difference need not fall any more."""
CHAOTIC_GROWTH = 1e3
"""Growth of a disturbance beyond which a finer step does not help for long."""
BETTER_SHARES = 0.1, 0.55
"""Shares of the own error up to which another setting is recommended; the second share is used if
no setting reaches the first."""


@dataclass(frozen=True)
class Alternative:
    """Another setting, its error until T [m], and its cost over that of the model's own setting.

    The cost is the number of evaluations of the dynamics: the accelerations in a state are found
    once in a step of Euler, and four times in one of RK4.  It is NaN if the engine does not count
    them.
    """

    name: str
    error: float
    times: float


class Rung:
    """The conclusions from several solutions of a model's own motion.

    T is the time until which the motion is self-consistent.

    Parameters
    ----------
    motion : OwnMotion
        The solutions; the first run must not fail.
    """

    def __init__(self, motion: OwnMotion) -> None:
        self.motion = motion
        self.count = min(len(run.points) for run in motion.runs)

    def pad(self, holds: Bools) -> Bools:
        """A criterion at each sample that all runs with a step have; False if it is not given."""
        found = np.zeros(self.count, bool)
        found[: holds.size] = holds[: self.count]
        return found

    def apart(self, one: OwnRun, two: OwnRun) -> Array:
        """The largest distance between two solutions until each sample that both have [m]."""
        n = min(len(one.points), len(two.points))
        return largest_until(one.points[:n] - two.points[:n])

    @cached_property
    def sizes(self) -> Array:
        """The lengths that shares refer to, at each sample [m].

        Each is the model's size, or the longest distance moved until then, if that is longer.
        """
        points = self.fine.points[: self.count]
        return np.maximum(largest_until(points - points[:1]), self.motion.extent or 1e-300)

    @cached_property
    def differences(self) -> list[Array]:
        """The distance of each run with a step from the run with half that step [m]."""
        return [self.apart(*pair)[: self.count] for pair in pairwise(self.motion.runs)]

    @property
    def fine(self) -> OwnRun:
        """The run with the finest step."""
        return self.motion.runs[-1]

    @cached_property
    def steps_converge(self) -> Bools:
        """The criterion `steps` at each sample: whether finer steps converge."""
        if len(self.differences) < 3:
            return np.zeros(self.count, bool)
        return self.differences_fall & (self.differences[-1] <= AGREEMENT_SHARE * self.sizes)

    @property
    def differences_fall(self) -> Bools:
        """Whether the last three differences of steps fall as they should, at each sample."""
        first, second, last = self.differences[-3:]
        rounding = ROUNDING_SHARE * self.sizes
        falls = (first >= MIN_FALL**2 * last) & (first <= 2 ** (2 * MAX_ORDER) * last)
        falls |= last <= rounding
        jumps = second > np.maximum(MAX_JUMP * first, rounding)
        return np.asarray(falls & ~jumps)

    @cached_property
    def close_agrees(self) -> Bools:
        """The criterion `close` at each sample: whether variable and finest steps agree."""
        own, other = (self.apart(self.motion.close, x) for x in (self.motion.rough, self.fine))
        n = min(own.size, other.size, self.count)
        return self.pad(np.maximum(own[:n], other[:n]) <= AGREEMENT_SHARE * self.sizes[:n])

    @cached_property
    def disturbed_distance(self) -> Array:
        """The largest distance that a disturbed start causes until each sample [m]."""
        return self.apart(self.motion.disturbed, self.motion.runs[self.motion.compared])

    @cached_property
    def steady(self) -> Bools:
        """The criterion `disturbed` at each sample: whether a disturbed motion stays near."""
        n = min(self.disturbed_distance.size, self.count)
        return self.pad(self.disturbed_distance[:n] <= AGREEMENT_SHARE * self.sizes[:n])

    @cached_property
    def last(self) -> int:
        """The last sample until which two of the three criteria are met; 0 if they never are."""
        # Two of three, since each may fail alone: steps may converge to a wrong branch, the other
        # integrator may end early, and a disturbance may grow in a motion that is computed well.
        votes = self.steps_converge.astype(int) + self.close_agrees + self.steady
        fails = np.flatnonzero(votes < 2)
        return max(0, int(fails[0]) - 1) if fails.size else len(votes) - 1

    @property
    def until(self) -> float:
        """The time T [s]."""
        return float(self.motion.times[self.last])

    @property
    def close_agrees_until(self) -> float:
        """The time until which the integrator that chooses its steps is right [s]; 0 for never."""
        if not self.consistent:
            return 0.0
        fails = np.flatnonzero(~self.close_agrees[: self.last + 1])
        return float(self.motion.times[max(0, int(fails[0]) - 1) if fails.size else self.last])

    @property
    def whole_run(self) -> bool:
        """Whether T is the end of the run."""
        return self.last == len(self.motion.times) - 1

    @property
    def consistent(self) -> bool:
        """Whether something moves, and its motion is self-consistent until some time."""
        return self.last > 0 and self.motion.dof > 0

    @property
    def moved(self) -> float:
        """The longest distance of a point from its start until T [m]."""
        points = self.fine.points[: self.last + 1]
        return float(largest_until(points - points[:1])[-1])

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves until T by more than rounding, and than its motion is known."""
        if not self.motion.dof:
            return True
        rounding = ROUNDING_SHARE * self.motion.extent
        known = self.known if isfinite(self.known) else 0.0
        return self.consistent and self.moved <= max(rounding, known)

    @cached_property
    def best(self) -> OwnRun:
        """The solution that others are compared with: `close` if the finest steps agree with it."""
        return self.motion.close if self.close_agrees[: self.last + 1].all() else self.fine

    @property
    def is_sure(self) -> bool:
        """Whether the integrator that chooses its steps is right until the end of the run."""
        return self.whole_run and self.consistent and self.best is self.motion.close

    def error(self, run: OwnRun) -> float:
        """The largest distance of a run from the best until T [m]; infinite if it ends before."""
        found = self.apart(run, self.best)
        return float(found[self.last]) if found.size > self.last else inf

    @property
    def known(self) -> float:
        """The uncertainty of the motion until T [m].

        It is the distance of the finest step from the best solution, or if that is the finest step
        itself, the error that remains by extrapolation.  The order of the extrapolation is at most
        1, since a higher order that is observed may not continue.
        """
        if self.best is not self.fine:
            return self.error(self.fine)
        # Differences between steps then are all that is known. With order p the steps still to come
        # add up to the last difference over 2^p - 1.
        order = log2(MIN_FALL) if np.isnan(self.order) else self.order
        ratio = 2.0 ** min(max(order, log2(MIN_FALL)), 1.0)
        return float(self.differences[-1][self.last]) / (ratio - 1.0) if self.differences else inf

    @property
    def order(self) -> float:
        """Order of convergence of the last two halvings until T; NaN if only rounding is left."""
        if len(self.differences) < 3:
            return nan
        # Over two halvings, whose mean hides that a single one may meet a lucky phase.
        coarse, _, fine = (float(one[self.last]) for one in self.differences[-3:])
        return log2(coarse / fine) / 2.0 if fine > ROUNDING_SHARE * self.sizes[self.last] else nan

    @property
    def growth(self) -> float:
        """The factor by which a disturbance of the start has grown at the last sample [1]."""
        return self.growth_at(-1)

    def growth_at(self, k: int) -> float:
        """The factor by which a disturbance of the start has grown at sample k [1]."""
        begun = self.motion.disturbance * (self.motion.extent or 1.0)
        return float(self.disturbed_distance[k]) / begun

    def ways(self) -> Iterator[Alternative]:
        """All settings that were tried, the model's own first."""
        own = self.motion.runs[0]
        for run in (*self.motion.runs, *self.motion.others):
            yield Alternative(run.name, self.error(run), run.evaluations / own.evaluations)

    def better(self) -> Alternative | None:
        """The cheapest setting with a tenth of the own error, or about half of it, or None.

        A setting without any error is left out: it is the one that others are compared with.
        """
        own, *others = self.ways()
        for share in BETTER_SHARES:
            good = [way for way in others if 0 < way.error <= share * own.error]
            if good:
                return min(good, key=lambda way: (isnan(way.times), way.times, way.error))
        return None

    @property
    def softness(self) -> float:
        """The distance that stiffer constraints cause until T [m]; NaN if there are none."""
        if self.motion.stiffer is None:
            return nan
        found = self.apart(self.motion.stiffer, self.motion.runs[self.motion.compared])
        return float(found[self.last]) if found.size > self.last else nan

    def why(self) -> str:
        """Why the motion is not known beyond T; empty if T is the end of the run."""
        if self.whole_run:
            return ""
        if self.last == self.count - 1:
            failed = [run for run in self.motion.runs if run.stopped and not run.late]
            if failed:
                return f"{failed[0].name} fails: {failed[0].stopped}"
            return self.why_no_more()
        if self.growth > CHAOTIC_GROWTH:
            end = float(self.motion.times[self.disturbed_distance.size - 1])
            return (
                f"a disturbance of {number(self.motion.disturbance, 1)} has grown "
                f"{number(self.growth, 2)} times at {number(end, 3)} s"
            )
        if len(self.differences) < 3:
            return f"{len(self.motion.runs)} steps alone were tried"
        k = self.last + 1
        if self.steps_converge[k]:  # the other two ways ended before
            return self.why_no_more()
        if not self.differences_fall[k]:
            growth = self.growth_at(min(k, self.disturbed_distance.size - 1))
            return (
                "finer steps do not converge there, though a disturbance grows "
                f"{number(growth, 2)} times only: a force jumps, or contacts chatter"
            )
        return f"the two finest steps, of {format_step(self.fine)}, differ by more"

    def why_no_more(self) -> str:
        """Why all ways to solve the motion end at T, although none failed."""
        ways = (*self.motion.runs, self.motion.close, self.motion.rough, self.motion.disturbed)
        late = next((f": {way.name}: {way.stopped}" for way in ways if way.late), "")
        return f"no more was followed in the time that there is{late}"

    def words(self) -> str:
        """A summary of a few sentences."""
        if not self.motion.dof:
            return "nothing moves: the model has no joints"
        if self.at_rest:
            return (
                f"nothing moves until {number(self.until)} s: no body leaves its start by more "
                f"than {format_length(self.moved)}, so that nothing is tested; give a key with "
                "rates (qvel) or controls (ctrl), or another start pose"
            )
        if not self.consistent:
            return f"no two ways of solving its motion agree at any time: {self.why()}"
        return " ".join(self.sentences())

    def sentences(self) -> Iterator[str]:
        """The sentences on a self-consistent motion."""
        own, known, end = self.motion.runs[0], self.known, ", its end" if self.whole_run else ""
        error = self.error(own)
        off = (
            f"off by {format_length(error)}, known to {format_length(known)},"
            if error > known
            else f"off by no more than {format_length(known)}, to which it is known,"
        )
        if self.softness > max(error, known):
            off = (
                f"contacts, loops, limits and dry friction {STIFFENING_FACTOR:g} × as stiff move "
                f"it by {format_length(self.softness)}: their softness matters more than the step, "
                f"with which it is {off}"
            )
        yield f"until {number(self.until)} s{end}, {off} as it is ({own.name})."
        scale = 1.0 if own.opening_unit == "rad" else self.motion.extent
        if (opened := float(own.gap[0])) > OPEN_SHARE * scale:
            yield (
                f"Its loops are open by {number(opened)} {own.opening_unit} at the start: they "
                "close by a jerk, unless the start pose is mended."
            )
        evidence = format_list(self.evidence())
        yield f"{evidence[0].upper()}{evidence[1:]}."
        if error > known and (way := self.better()):
            cost = "" if isnan(way.times) else f" in {number(way.times, 2)} × the evaluations"
            yield f"{way.name}: {format_length(way.error)}{cost}."
        if not self.whole_run:
            yield f"Then {self.why()}; {self.describe_end()}."

    def evidence(self) -> Iterator[str]:
        """Phrases on the criteria that are met at T."""
        k = self.last
        if self.steps_converge[k]:
            order = "" if np.isnan(self.order) else f" with order {number(self.order, 2)}"
            yield f"steps down to {format_step(self.fine)} converge{order}"
        if self.close_agrees[k]:
            yield f"{self.motion.close.name} agrees with the finest"
        if self.steady[k]:
            yield f"a start that differs by {number(self.motion.disturbance)} leads there as well"

    def describe_end(self) -> str:
        """A phrase on energies, penetrations and constraint violations of the two finest steps."""
        coarse, fine = self.motion.runs[-2:]
        end = self.count - 1
        swing = float(np.ptp(fine.energy)) or 1.0
        energy = abs(fine.energy[end] - coarse.energy[end]) / swing
        parts = [f"energies at the end differ by {number(100 * energy, 2)} % of their swing"]
        for what, unit, one, two in (
            ("penetrations", "m", coarse.depth, fine.depth),
            ("constraint violations", "m or rad", coarse.gap, fine.gap),
        ):
            most = [float(np.max(each[: self.count])) for each in (one, two)]
            if max(most) > 0:
                parts.append(
                    f"largest {what} are {format_list(number(each, 2) for each in most)} {unit}"
                )
        return ", ".join(parts)


def choose_cheaper(motion: OwnMotion, ways: Sequence[UntriedWay]) -> tuple[OwnRun, ...]:
    """Solve a motion with other integrators, the cheapest way first, until none can be advised.

    No way is tried that costs as much as a known one with the first of `BETTER_SHARES` of the own
    error, nor if the own error is not known, nor when the counted time for such ways is over.
    """
    rung = Rung(motion)
    if rung.at_rest or not rung.consistent or rung.error(motion.runs[0]) <= rung.known:
        return ()
    goal = BETTER_SHARES[0] * rung.error(motion.runs[0])
    dearest = min((one.evaluations for one in motion.runs if rung.error(one) <= goal), default=inf)
    tried, spent = list[OwnRun](), 0.0
    for way in sorted(ways, key=lambda way: way.evaluations):
        if way.evaluations >= dearest or spent >= way.seconds:
            break
        run = way.solve(way.seconds - spent)
        tried.append(run)
        spent += run.work
        if rung.error(run) <= goal:
            dearest = way.evaluations
    return tuple(tried)


def format_step(run: OwnRun) -> str:
    """The step of a run as text."""
    return f"{number(1e3 * run.step)} ms"


def format_length(metres: float) -> str:
    """A length as text.

    >>> format_length(0.0078), format_length(2.5e-6), format_length(0.0)
    ('7.8 mm', '2.5 µm', '0 m')
    """
    for unit, size in (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6)):
        if metres >= size:
            return f"{number(metres / size, 2)} {unit}"
    return f"{number(metres / 1e-9, 2)} nm" if metres else "0 m"


def largest_until(ways: Array) -> Array:
    """The largest length of some vectors (samples, bodies, points, 3) until each sample."""
    lengths = np.linalg.norm(ways, axis=-1).reshape(len(ways), -1)
    return np.asarray(np.maximum.accumulate(lengths.max(axis=1, initial=0.0)))


def why_failed(motion: OwnMotion) -> str:
    """Why the model's own run fails; empty if it came to its end, or its processor time was over.

    >>> from proofmass.sim.protocol.own_equations import OwnRun
    >>> none = np.zeros((1, 1, 1, 3))
    >>> run = OwnRun("Euler, 2 ms", 2e-3, 1.0, none, *3 * (np.zeros(1),), stopped="not finite")
    >>> why_failed(OwnMotion(np.arange(2.0), 1.0, (run,), run, run, 0, run, (), None, 1))
    'not finite, after 0 s'
    """
    own = motion.failed or motion.runs[0]
    if not own.is_failure:
        return ""
    when = number(motion.times[max(0, len(own.points) - 1)])
    finer = f"; with {motion.runs[0].name} it comes to its end" if motion.failed else ""
    return f"{own.stopped}, after {when} s{finer}"
