"""Orders of convergence at all samples of a run, to be compared with that of its largest error.

The order of the largest error differs from the theory where the largest error moves from sample to
sample, as after an impact, or where it is the sum of two terms of different orders.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import log

import numpy as np

from proofmass.base.arrays import Array
from proofmass.case.case import Case
from proofmass.studies.measure import call_engine, distances_to_reference
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.trade.series import MeasuredSeries, points_before_slowdown
from proofmass.studies.trade.varied import list_series
from proofmass.studies.trade.verdict import Verdict

SMALLEST_SHARE = 0.01
"""Smallest error that is evaluated, as a share of the largest: less may be rounding."""


def orders_of_places(case: Case, verdict: Verdict, rows: Sequence[StudyRow]) -> list[float]:
    """Medians of the orders at all places, from each setting before an error floor to the next.

    Parameters
    ----------
    case : Case
    verdict : Verdict
        Verdict of a convergence series of the case, in one kind of error.
    rows : sequence of StudyRow
        The measured settings of that series.
    """
    series = next(one for one in list_series(case, verdict.run) if one.name == verdict.series)
    measured = MeasuredSeries(series, list(rows))
    errors = [
        (size, errors_at_all_places(case, verdict, series.settings[measured.place(size)]))
        for size, _ in points_before_slowdown(measured.points(verdict.kind))
    ]
    return [
        float(np.median(np.log(a[both] / b[both]))) / log(coarse / fine)
        for (coarse, a), (fine, b) in pairwise(errors)
        for both in ((a > SMALLEST_SHARE * a.max()) & (b > SMALLEST_SHARE * b.max()),)
    ]


def errors_at_all_places(case: Case, verdict: Verdict, setting: Setting) -> Array:
    """Errors of one kind at all samples of all channels, as shares of the channels' ranges."""
    model, run = setting.apply_to(case, verdict.run)
    curves = call_engine(setting.engine, model.model_path, run)
    return np.concatenate(
        [
            errors
            for kind, errors in distances_to_reference(model, verdict.run, curves)
            if kind == verdict.kind
        ]
    )
