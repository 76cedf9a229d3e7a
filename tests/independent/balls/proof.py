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
from proofmass.reference.proven import prescribed_motion
from proofmass.reference.reference_curves import ReferenceCurves
from proofmass.report.words import quantity_kind
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.compare import scale_of
from tests.independent.balls.linkages import FORMS
from tests.independent.balls.loops import (
    CaseNumbers,
    NotProven,
    approximate_pose,
    constants,
    prove_pose,
)
from tests.independent.balls.motion import balls_of_pose
from tests.independent.balls.planar_loops import planar_loops

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
    """

    errors: dict[str, float]
    alone_within: float
    samples: int
    not_covered: tuple[str, ...]

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
WITHOUT_PROOF = {
    "refined": INTEGRATED,
    "rod_released": INTEGRATED,
    "slider_crank_elastic": INTEGRATED,
    "rocking_block": INTEGRATED,
}
"""Why nothing can be proven of some references."""
ExactSample = tuple[dict[str, arb], float]
"""The balls of all curves at a sample, and the half width of the box with one pose."""


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
    missing, least, count = set[str](), inf, 0
    for k, (exact, half_width) in enumerate(samples):
        least, count = min(least, half_width), count + 1
        for name, channel in case.channels_of(kind).items():
            if (ball := ball_of_channel(name, channel, exact)) is None:
                missing.add(name)
                continue
            error = distance(float(given.channels[name][k]), ball, channel) / scales[name]
            errors[name] = max(errors.get(name, 0.0), error * UPWARD)
    if numbers.unused:
        raise NotProven(f"parameters without a part in the proof: {', '.join(numbers.unused)}")
    if count != x.size:
        raise NotProven(f"{count} of {x.size} samples have exact values")
    return Proof(errors, least, count, tuple(sorted(missing)))


def case_numbers(case: Case) -> CaseNumbers:
    """The parameters of a case with the defaults of its reference."""
    reference = reference_class(case)
    known = reference.parameters if reference else {}
    defaults = {n: one.default for n, one in known.items() if isinstance(one.default, float)}
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
    if case.load:
        raise NotProven("loads that change")
    if state is None and case.reference in ("planar", "spatial"):
        raise NotProven(INTEGRATED)
    if state is not None and (case.reference in FORMS or case.reference == "planar"):
        return exact_poses(case, kind, p, x, state)
    raise NotProven(WITHOUT_PROOF.get(case.reference, f"no proof of {case.reference} was written"))


def exact_poses(
    case: Case, kind: Kind, p: CaseNumbers, x: Array, state: DriveState
) -> Iterator[ExactSample]:
    """The exact values of a driven linkage at each sample."""
    inertia = case.has_inertia(kind)
    if case.reference == "planar":
        form, guess, gravity = planar_loops(case)
        known = None
    else:
        form, names = FORMS[case.reference]
        quantities = reference_quantities(case, kind, x, state, case.parameters)
        known, gravity = [quantities[name] for name in names], p["gravity"]
    for k in range(x.size):
        drives = [
            (arb(float(a[k])), arb(float(b[k])), arb(float(c[k])))
            for a, b, c in zip(*state, strict=True)
        ]
        still = constants(one[0] for one in drives)
        if known is None:
            guess = approximate_pose(form, p, still, guess)
        else:
            guess = [float(np.broadcast_to(curve, x.shape)[k]) for curve in known]
        pose, half_width = prove_pose(form, p, still, guess)
        guess = [float(one.mid()) for one in pose]
        yield balls_of_pose(form, p, drives, pose, arb(gravity), inertia), half_width
