"""Prove the errors of the reference of a case at the samples of a run.

The error is the upper bound of the distance between the float64 value and the ball of the exact
one.  Parameters, samples and prescribed motion are float64 and count as exact.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import ROUND_CEILING, Context, Decimal
from math import inf

import numpy as np
from flint import arb

from proofmass.base.arrays import Array
from proofmass.base.strict import Kind
from proofmass.case.case import Case, Channel
from proofmass.case.drive import DriveState
from proofmass.reference.evaluate import evaluate, reference_quantities
from proofmass.reference.find import reference_class
from proofmass.reference.profiles import DRIVE_PREFIX, load_profiles
from proofmass.reference.proven import prescribed_motion
from proofmass.reference.reference_curves import ReferenceCurves
from proofmass.report.words import quantity_kind
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.compare import scale_of
from tests.independent.balls.chains import make_chain, segments_of
from tests.independent.balls.continuity import ProvenPose, is_continuous
from tests.independent.balls.free_motions import FREE_MOTIONS
from tests.independent.balls.hysteresis import ALONG_A_DRIVE
from tests.independent.balls.linkages import FORMS
from tests.independent.balls.loops import (
    CaseNumbers,
    NotProven,
    approximate_pose,
    prove_pose,
)
from tests.independent.balls.motion import balls_of_pose
from tests.independent.balls.planar_loops import planar_loops
from tests.independent.balls.rod_shapes import pinned_rod, rod_curves, rod_loads
from tests.independent.balls.rods import cantilever, is_elliptic

UPWARD = 1.0 + 1e-12
"""Factor against the rounding of the few float64 operations after the ball arithmetic."""
ONE_DIGIT = Context(prec=1, rounding=ROUND_CEILING)


@dataclass(frozen=True)
class Proof:
    """Proven errors of a run.

    Attributes
    ----------
    errors : dict of float
        Largest error of each channel, as a share of the range of its curve [1].
    alone_within : float
        Least half width of the boxes in which the poses are alone [m or rad]; infinite without
        loops.
    samples : int
        Number of samples [1].
    not_covered : tuple of str
        Channels of the run without a bound.
    continuous : bool
        Whether one branch is proven to lead from each sample to the next.
    """

    errors: dict[str, float]
    alone_within: float
    samples: int
    not_covered: tuple[str, ...]
    continuous: bool = False

    def by_kind(self, case: Case) -> dict[str, float]:
        """The largest errors of all channels of a kind, rounded up to one digit [1]."""
        found: dict[str, float] = {}
        for name, error in self.errors.items():
            kind = quantity_kind(case.channels[name].unit)
            found[kind] = max(found.get(kind, 0.0), round_up(error))
        return found


def round_up(error: float) -> float:
    """Round a number up to one digit.

    >>> round_up(5.1e-16), round_up(9.01e-16), round_up(0.0)
    (6e-16, 1e-15, 0.0)
    """
    return float(ONE_DIGIT.create_decimal(Decimal(error)))


INTEGRATED = "the reference integrates equations of motion"
SHOT = "rods that are found by shooting are not written in balls"
PAIRS = "curves of pairs of rods are not written in balls"
PLATFORMS = "rods below a platform are not written in balls"
IN_SPACE = "mechanisms in space are not written in balls"
WITHOUT_PROOF = {
    "refined": INTEGRATED,
    "rod_released": INTEGRATED,
    "slider_crank_elastic": INTEGRATED,
    "spatial": IN_SPACE,
    "spatial_rod": SHOT,
    "rod_snap": SHOT,
    **dict.fromkeys(("rod_pair", "rod_pair_driven"), PAIRS),
    **dict.fromkeys(("rod_platform", "rod_platform_driven"), PLATFORMS),
}
"""Why nothing can be proven of some references."""


@dataclass(frozen=True)
class ExactSample:
    """The balls of all curves at a sample [SI], and what is known of its pose.

    `half_width` is that of the box with one pose; `continuous` whether one branch leads to it from
    the sample before.
    """

    curves: dict[str, arb]
    half_width: float = inf
    continuous: bool = False


def prove_errors(case: Case, kind: Kind, curves: ReferenceCurves | None = None) -> Proof:
    """Prove the errors of the reference of a run, or of other curves that claim to be those.

    Raises
    ------
    NotProven
        A pose is not proven, or a part of the case is not modelled.
    """
    x, state = prescribed_motion(case, kind)
    numbers = case_numbers(case)
    samples = exact_samples(case, kind, numbers, x, state)
    given = curves or evaluate(case, kind, x, state)
    scales = scales_of_channels(case, kind, given, state)
    errors: dict[str, float] = {}
    missing, least, count, continuous = set[str](), inf, 0, True
    for k, sample in enumerate(samples):
        least, count = min(least, sample.half_width), count + 1
        continuous = continuous and sample.continuous
        for name, channel in compared_channels(case, kind).items():
            if (ball := ball_of_channel(name, channel, sample.curves)) is None:
                missing.add(name)
                continue
            error = distance(float(given.channels[name][k]), ball, channel) / scales[name]
            errors[name] = max(errors.get(name, 0.0), error * UPWARD)
    if numbers.unused:
        raise NotProven(f"parameters without a part in the proof: {', '.join(numbers.unused)}")
    if count != x.size:
        raise NotProven(f"{count} of {x.size} samples have exact values")
    return Proof(errors, least, count, tuple(sorted(missing)), continuous)


def compared_channels(case: Case, kind: Kind) -> dict[str, Channel]:
    """The channels of a run but for those that equal the prescribed motion, which is given."""
    return {
        name: channel
        for name, channel in case.channels_of(kind).items()
        if not str(channel.equals).startswith(DRIVE_PREFIX)
    }


def case_numbers(case: Case) -> CaseNumbers:
    """The parameters of a case with the defaults of its reference."""
    reference = reference_class(case)
    known = reference.parameters if reference else {}
    defaults = {n: one.default for n, one in known.items() if isinstance(one.default, float | int)}
    return CaseNumbers({**defaults, **case.parameters})


def scales_of_channels(
    case: Case, kind: Kind, curves: ReferenceCurves, state: DriveState | None
) -> dict[str, float]:
    """The scale of each channel of a run, by which its errors are divided [SI]."""
    moved = Curves(curves.x, dict(curves.channels), drive=state)
    names = case.channels_of(kind)
    return {name: scale_of(case, kind, name, moved, curves.channels[name]) for name in names}


def ball_of_channel(name: str, channel: Channel, exact: dict[str, arb]) -> arb | None:
    """The exact value of a channel [SI]; None if it is not known.

    The exact value of a channel that equals a number is that of the sensor with its name.
    """
    if isinstance(channel.equals, float):
        return exact.get(name)
    value = exact.get(channel.equals)
    if value is None:
        return None
    return value * arb(channel.scale) + arb(channel.shift) * arb(channel.factor)


def distance(value: float, ball: arb, channel: Channel) -> float:
    """Upper bound of the distance of a value from a ball; angles are taken up to whole turns.

    Raises
    ------
    NotProven
        The ball is not finite; a comparison with it would be false, and so would hide it.
    """
    gap = arb(value) - ball
    if not gap.is_finite():
        raise NotProven(f"{channel.equals}: {value} is to be compared with {ball}")
    if channel.si_unit == "rad":
        turn = 2 * arb.pi()
        gap -= turn * round(float((gap / turn).mid()))
    return float(abs(gap).upper())


def exact_samples(
    case: Case, kind: Kind, p: CaseNumbers, x: Array, state: DriveState | None
) -> Iterator[ExactSample]:
    """The exact values of a reference at each sample of a run.

    Raises
    ------
    NotProven
        The reference is not covered.
    """
    if case.recorded:
        raise NotProven("the reference is a table of recorded numbers")
    if state is None and case.reference in ("planar", "spatial"):
        raise NotProven(INTEGRATED)
    if case.reference == "balancer" and state is not None:
        return exact_chains(case, kind, p, x, state)
    if case.reference in ALONG_A_DRIVE and state is not None:
        drive = zip(*(order[0] for order in state), strict=True)
        return map(ExactSample, ALONG_A_DRIVE[case.reference](p, drive))
    if case.reference in ("rod", "rod_pinned"):
        return exact_rods(case, kind, p, x)
    if state is None and case.reference in FREE_MOTIONS:
        return map(ExactSample, FREE_MOTIONS[case.reference](p, x))
    if state is not None and (case.reference in FORMS or case.reference == "planar"):
        return exact_poses(case, kind, p, x, state)
    raise NotProven(WITHOUT_PROOF.get(case.reference, f"{case.reference} is not written in balls"))


def exact_poses(
    case: Case, kind: Kind, p: CaseNumbers, x: Array, state: DriveState
) -> Iterator[ExactSample]:
    """The exact values of a driven linkage at each sample."""
    inertia, controls = case.has_inertia(kind), controls_of_loads(case, kind, x)
    if case.reference == "planar":
        form, guess, gravity = planar_loops(case)
        known = None
    else:
        form, names = FORMS[case.reference]
        quantities = reference_quantities(case, kind, x, state, case.parameters)
        known, gravity = [quantities[name] for name in names], p["gravity"]
    before, continuous, senses = None, True, list[int]()
    for k in range(x.size):
        numbers = p.with_values(
            {
                name: arb(p[name]) * arb(float(control[k]))
                for load, control in zip(case.load, controls, strict=True)
                for name in load.scales
            }
        )
        drives = [
            (arb(float(a[k])), arb(float(b[k])), arb(float(c[k])))
            for a, b, c in zip(*state, strict=True)
        ]
        still = [one[0] for one in drives]
        if known is None:
            guess = approximate_pose(form, numbers, still, guess)
        else:
            guess = [float(np.broadcast_to(curve, x.shape)[k]) for curve in known]
        pose, half_width = prove_pose(form, numbers, still, guess)
        guess = [float(one.mid()) for one in pose]
        curves, senses = balls_of_pose(form, numbers, drives, pose, arb(gravity), inertia, senses)
        after = ProvenPose(still, pose)
        if kind == "sweep" and before is not None and continuous:
            continuous = is_continuous(form, numbers, before, after)
        before = after
        yield ExactSample(curves, half_width, kind == "sweep" and continuous)


def exact_chains(
    case: Case, kind: Kind, p: CaseNumbers, x: Array, state: DriveState
) -> Iterator[ExactSample]:
    """The exact values of a balancer at each angle of its pendulum."""
    known = reference_quantities(case, kind, x, state, case.parameters)
    count = segments_of(p)
    names = [f"theta{k + 1}" for k in range(count)], [f"deflection{k + 1}" for k in range(count)]
    if any(p[name] for name in p if "friction" in name):
        raise NotProven("joints of a balancer that stick and slip are not written in balls")
    p["target_moment"]  # scales the moment that a design aims at, which no channel has
    before: tuple[ProvenPose, frozenset[int]] | None = None
    continuous = True
    for k in range(x.size):
        angles, turned = ([float(known[name][k]) for name in group] for group in names)
        chain = make_chain(p, turned)
        stops = [float(known[f"node{joint + 1}_load"][k]) for joint in chain.stopped]
        force = [-float(known[name][k]) for name in ("force_x", "force_y")]
        drive = tuple(arb(float(order[0][k])) for order in state)
        pose, half_width = prove_pose(chain, p, [drive[0]], [*angles, *force, *stops])
        chain.check_stops(p, pose)
        curves, _ = balls_of_pose(chain, p, [drive], pose, arb(0), False)
        after = ProvenPose([drive[0]], pose), frozenset(chain.stopped)
        if before is not None and continuous:
            same = before[1] == after[1]
            continuous = same and is_continuous(chain, p, before[0], after[0])
        before = after
        yield ExactSample(curves, half_width, continuous)


def exact_rods(case: Case, kind: Kind, p: CaseNumbers, x: Array) -> Iterator[ExactSample]:
    """The exact values of a clamped rod, whose tip is free or on a pin."""
    pinned = case.reference == "rod_pinned"
    if is_elliptic(p) and not pinned:
        yield from map(ExactSample, cantilever(p, x))
        return
    known = reference_quantities(case, kind, x, None, case.parameters)
    guess = [float(known["m"][0]), *(float(known[f"force_{one}"][-1]) for one in "xy")]
    rod, pin = pinned_rod(p) if pinned else (rod_loads(p), None)
    for curves, half_width in rod_curves(rod, guess, pin, x):
        yield ExactSample(curves, half_width)


def controls_of_loads(case: Case, kind: Kind, x: Array) -> list[Array]:
    """The controls of the loads that change along a run, which count as exact.

    Raises
    ------
    NotProven
        A load acts on the model, and scales no parameter.
    """
    if any(not load.scales for load in case.load):
        raise NotProven("loads on a model are not written in balls")
    return [np.broadcast_to(profile(x)[0], x.shape) for profile in load_profiles(case, kind)]
