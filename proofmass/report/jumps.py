"""Where curves jump: between two samples, as at a snap or a contact, without values on the way.

A step between two samples is suspected where it is much larger than those around it.  The reference
is then evaluated between the two: a jump stays a step between two of many finer samples, and what
is steep becomes many small ones.  An engine has no finer samples.  Its step is a jump where the
reference jumps as well, or does not make that step.
"""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from proofmass.analytic.numerics import TURN, Array
from proofmass.case import Case
from proofmass.compare import scale_of
from proofmass.reference import evaluate
from proofmass.sim.mjcf import NATIVE
from proofmass.sim.protocol import Curves
from proofmass.solve import plan
from proofmass.strict import Kind

SEEN = 0.02  # of the range: a line is wider than a smaller step
STEEP = 2.0  # times the steps around it; a sine of 8 samples a period makes 1.4
FINER = 32  # samples in place of one; a square root, as before a fold, makes steps of 0.18 of it
LEFT = 0.25  # of a suspected step that is still one between two of the finer samples
OWN = 0.5  # of a solver's step that the reference does not make
MOST = 32  # suspected steps that are looked at: curves with more of them are no curves


@dataclass(frozen=True)
class Jumps:
    """Where the reference or a solver jumps: numbers of the samples before a jump.

    Attributes
    ----------
    mechanism : tuple of int
        Where the mechanism itself does, and every curve with it.
    channels : dict of str to tuple of int
        Where only some curves do, by channel.
    """

    mechanism: tuple[int, ...] = ()
    channels: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def of(self, channel: str = "") -> list[int]:
        """Where a channel jumps, or without its name the mechanism."""
        return sorted({*self.mechanism, *self.channels.get(channel, ())})

    def every(self) -> list[int]:
        """Where anything jumps."""
        return sorted({*self.mechanism, *(k for found in self.channels.values() for k in found)})


def of_reference(case: Case, kind: Kind, truth: Curves, curves: Curves) -> Jumps:
    """Where the curves of the reference jump, beside those of a solver, whose drives tell rates."""
    suspected = {
        name: suspects(curve, scale_of(case, kind, name, curves, curve))
        for name, curve in truth.channels.items()
    }
    every = sorted({k for found in suspected.values() for k in found})
    if not every:
        return Jumps()
    with suppress(Exception):  # a reference that ends between two samples
        fine = finer(case, kind, truth.x, every[:MOST])
        return collected(
            case,
            kind,
            {
                name: [k for k in found if stays(truth.x, truth.channels[name], fine, name, k)]
                for name, found in suspected.items()
            },
            truth,
        )
    return Jumps()


def of_solver(case: Case, kind: Kind, curves: Curves, truth: Curves, known: Jumps) -> Jumps:
    """Where the curves of a solver jump, with the reference beside it and where that one jumps."""
    found = {}
    for name, curve in curves.channels.items():
        if name in truth.channels:
            scale = scale_of(case, kind, name, curves, truth.channels[name])
            steps, apart = np.abs(np.diff(curve)), np.abs(np.diff(curve - truth.channels[name]))
            found[name] = [
                k
                for k in suspects(curve, scale)
                if k in known.of(name) or apart[k] > OWN * steps[k]
            ]
    return collected(case, kind, found, curves)


def suspects(curve: Array, scale: float) -> list[int]:
    """Samples after which a curve makes a step that is larger than all steps around it.

    The first and the last step have none on their other side, and are no suspects.

    >>> suspects(np.array([0.0, 0.1, 0.2, 0.3, 2.0, 2.1, 2.2]), 2.2)
    [3]
    """
    steps = np.abs(np.diff(curve))
    if steps.size < 3:
        return []
    sides = np.pad(steps, 2)
    around = np.max([sides[:-4], sides[1:-3], sides[3:-1], sides[4:]], axis=0)
    found = np.flatnonzero((steps > SEEN * scale) & (steps > STEEP * around))
    return [k for k in found.tolist() if 0 < k < steps.size - 1]


def finer(case: Case, kind: Kind, x: Array, suspected: Iterable[int]) -> Curves:
    """The reference with `FINER` samples in place of each suspected step."""
    more = [np.linspace(x[k], x[k + 1], FINER + 1) for k in suspected]
    fine = np.unique(np.concatenate([x, *more]))
    run = plan(case, kind, NATIVE)
    return evaluate(case, kind, fine, run.motion(fine) if run.drives else None)


def stays(x: Array, curve: Array, fine: Curves, name: str, k: int) -> bool:
    """Whether a step of a curve is still one where there are finer samples."""
    first, last = np.searchsorted(fine.x, x[[k, k + 1]])
    steps = np.abs(np.diff(fine.channels[name][first : last + 1]))
    return bool(last - first >= FINER and steps.max() > LEFT * abs(curve[k + 1] - curve[k]))


def collected(case: Case, kind: Kind, found: Mapping[str, list[int]], curves: Curves) -> Jumps:
    """The jumps of curves; in a sweep, one of a place or an angle is one of the mechanism.

    An angle that jumps by a turn has not moved.
    """
    whole = set[int]()
    for name, places in found.items():
        unit, curve = case.channels[name].si_unit, curves.channels[name]
        if kind == "sweep" and unit in ("m", "rad"):
            for k in places:
                step = curve[k + 1] - curve[k]
                way = abs(step - TURN * round(step / TURN)) if unit == "rad" else abs(step)
                if way > LEFT * abs(step):
                    whole.add(k)
    own = {name: tuple(k for k in places if k not in whole) for name, places in found.items()}
    return Jumps(tuple(sorted(whole)), {name: places for name, places in own.items() if places})
