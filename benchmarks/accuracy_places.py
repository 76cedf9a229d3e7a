"""Orders at all places of a run, beside that of its largest error.

The largest shows another order than theory where it is now here and now there, as after a jolt, or
is the sum of two terms that fall in different orders.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import log

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.case import Case
from proofmass.studies.measure import deviations, simulate
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.trade.axes import lines
from proofmass.studies.trade.series import Track, clear
from proofmass.studies.trade.verdict import Verdict

COUNTS = 0.01
"""Share of the largest error from which on a place counts: elsewhere it may be rounding."""


def orders_of_places(case: Case, verdict: Verdict, rows: Sequence[StudyRow]) -> list[float]:
    """Median of the orders at all places, from each setting before a floor to the next one.

    Parameters
    ----------
    case : Case
    verdict : Verdict
        Of a line of it, in one kind of error.
    rows : sequence of Row
        Those of that line.
    """
    line = next(one for one in lines(case, verdict.run) if one.name == verdict.line)
    track = Track(line, list(rows))
    errors = [
        (size, everywhere(case, verdict, line.settings[track.place(size)]))
        for size, _ in clear(track.points(verdict.kind))
    ]
    return [
        float(np.median(np.log(a[both] / b[both]))) / log(coarse / fine)
        for (coarse, a), (fine, b) in pairwise(errors)
        for both in ((a > COUNTS * a.max()) & (b > COUNTS * b.max()),)
    ]


def everywhere(case: Case, verdict: Verdict, setting: Setting) -> Array:
    """Errors of one kind at all samples of all channels, as shares of the channels' ranges."""
    model, run = setting.applied(case, verdict.run)
    curves = simulate(setting.engine, model.model_path, run)
    return np.concatenate(
        [errors for kind, errors in deviations(model, verdict.run, curves) if kind == verdict.kind]
    )
