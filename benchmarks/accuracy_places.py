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
from proofmass.studies.measure import channel_errors, simulate
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.trade.series import MeasuredSeries, clear
from proofmass.studies.trade.varied import list_series
from proofmass.studies.trade.verdict import Verdict

COUNTS = 0.01
"""Share of the largest error from which on a place counts: elsewhere it may be rounding."""


def orders_of_places(case: Case, verdict: Verdict, rows: Sequence[StudyRow]) -> list[float]:
    """Median of the orders at all places, from each setting before a floor to the next one.

    Parameters
    ----------
    case : Case
    verdict : Verdict
        Of a convergence series of it, in one kind of error.
    rows : sequence of Row
        Those of that series.
    """
    series = next(one for one in list_series(case, verdict.run) if one.name == verdict.series)
    measured = MeasuredSeries(series, list(rows))
    errors = [
        (size, everywhere(case, verdict, series.settings[measured.place(size)]))
        for size, _ in clear(measured.points(verdict.kind))
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
        [
            errors
            for kind, errors in channel_errors(model, verdict.run, curves)
            if kind == verdict.kind
        ]
    )
