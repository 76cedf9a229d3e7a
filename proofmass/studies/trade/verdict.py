"""Verdicts on convergence series: order, error floor or how far they came; and the Pareto front."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from proofmass.base.front import nondominated_points
from proofmass.studies.record import NAN, StudyRow
from proofmass.verdict.outcome import Outcome


@dataclass(frozen=True)
class Verdict:
    """Verdict on one series of one run, for one kind of error.

    Attributes
    ----------
    case, run, engine, series : str
        The series and its run, as in `StudyRow`.
    kind : str
        The kind of error, such as position.
    observed, expected : float
        Order of convergence [1]: observed before an error floor, and expected by theory; NaN where
        there is none.
    floor : float
        Error floor, as a share of the reference's range [1]: an asymptotic error that two halvings
        of the step leave unchanged and that another cause changes; NaN if none was shown.
    cause, evidence : str
        Cause of the floor, and the factors that show it.
    remark : str
        Cause that changes the error, if the observed order is not the expected one.
    reached : str
        How far the series came if no floor was shown, and what it would need for 1e-4.
    worse : str
        A finer setting that is worse than the coarser one before it.
    motion : str
        Response of a free motion to a disturbed start, if it is chaotic or sensitive.
    horizon : float
        Time until which the errors are judged [s]; NaN if that is the whole run.
    """

    case: str
    run: str
    engine: str
    series: str
    kind: str
    observed: float = NAN
    expected: float = NAN
    floor: float = NAN
    cause: str = ""
    evidence: str = ""
    remark: str = ""
    reached: str = ""
    worse: str = ""
    motion: str = ""
    horizon: float = NAN


def pareto_front(rows: Iterable[StudyRow], kind: str) -> list[StudyRow]:
    """The Pareto front: settings that no other beats in both processor time and error; cheapest
    first.

    >>> rows = [StudyRow("", "", "", "", "", "", v, errors={"velocity": e}, seconds=s)
    ...         for v, e, s in ((1, 0.1, 1.0), (2, 0.2, 2.0), (3, 0.01, 3.0))]
    >>> [row.value for row in pareto_front(rows, "velocity")]
    [1, 3]
    """
    found = comparable_settings(rows, kind)
    costs_and_errors = np.array([(row.seconds, row.errors[kind]) for row in found]).reshape(-1, 2)
    return [found[k] for k in nondominated_points(costs_and_errors)]


def comparable_settings(rows: Iterable[StudyRow], kind: str) -> list[StudyRow]:
    """Settings that can be on a front: they ran, and have an error of that kind and a processor
    time."""
    return [
        row
        for row in rows
        if row.outcome == Outcome.RAN and row.errors.get(kind, NAN) >= 0 and row.seconds > 0
    ]
