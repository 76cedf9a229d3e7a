"""The order of convergence that theory expects of a series: how errors fall with its parameter.

Each engine states the orders of its settings.  A rod as a chain of n segments converges as n^-2,
and as n^-1 with the naive springs.
"""

from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.run.solve import describe_dynamics
from proofmass.sim.engines import engine_of
from proofmass.studies.trade.varied import ConvergenceSeries

DERIVATIVE_OF_KIND = {"position": 0, "energy": 1, "velocity": 1, "acceleration": 2, "force": 2}
ORDER_TOLERANCE = 0.2
"""Largest difference of an observed order from the expected one: a next term of the expansion that
is a tenth of the error makes second order appear as 1.9 to 2.1, and fourth order as 3.8 to 4.2."""


def expected_orders(
    case: Case, run: Kind, series: ConvergenceSeries, kind: str
) -> tuple[float, ...]:
    """Orders that a series may show in one kind of error: of each term that may be the largest.

    Empty where theory states none; order 0 is a floor from the first setting on.
    """
    if len(series.settings) < 2:  # one setting shows no order
        return ()
    if series.varied == "segments":
        return (1.0,) if any(rod.scheme == "naive" for rod in case.rod.values()) else (2.0,)
    return engine_of(series.engine).theory.orders(
        series.scan, DERIVATIVE_OF_KIND[kind], describe_dynamics(case)
    )


def nearest_order(orders: tuple[float, ...], observed: float) -> float:
    """The expected order nearest to the observed one, or the first if that is NaN; NaN without any.

    >>> nearest_order((2.0, 1.0), 1.1), nearest_order((2.0, 1.0), float("nan"))
    (1.0, 2.0)
    """
    if observed != observed:
        return orders[0] if orders else float("nan")
    return min(orders, key=lambda order: abs(order - observed), default=float("nan"))


def is_unexpected(observed: float, expected: float) -> bool:
    """Whether an observed order differs from the expected one by more than `ORDER_TOLERANCE`.

    >>> is_unexpected(1.9, 2.0), is_unexpected(1.5, 2.0), is_unexpected(float("nan"), 2.0)
    (False, True, False)
    """
    return abs(observed - expected) > ORDER_TOLERANCE
