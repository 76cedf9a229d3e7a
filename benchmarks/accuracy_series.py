"""Tables of the orders and error floors of all series of a study, and of the exceptions."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from statistics import median

from benchmarks.accuracy_places import orders_of_places
from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.studies.trade.orders import ORDER_TOLERANCE, is_unexpected
from proofmass.studies.trade.trade import Trade
from proofmass.studies.trade.verdict import Verdict

ORDERS = """
## Orders

A convergence series varies one parameter, usually the step, from coarse to fine. Its order is the
power of the parameter with which the error falls before an error floor, where two refinements show
the same power. Of {count} series that show an order, {near} are within {within} of the order that
theory expects (`proofmass/studies/trade/orders.py`). {mute} more show none: they reach a floor or
end after fewer refinements, or their order still changes from one refinement to the next.
"""
ODD = """
The table lists the other series, and the cause that their error follows at the end of the series,
where each possible cause was changed separately. The observed order is that of the largest error of
a run. If the largest error occurs at changing samples, or is a sum of two terms, it is no power of
the step. Therefore the column *at all places* has, from each refinement to the next, the median of
the orders at all samples whose error is at least a hundredth of the largest.
"""
FLOORS = """
## Error floors

An error of less than 1e-2 of the range is at a floor if two halvings of the step each change it by
less than 5 %. Each possible cause was then changed separately; the cause of the floor is the one
that the error follows.
{without} more verdicts state no floor, but the smallest error that their series reached.
"""


def family(series: str) -> str:
    """The name of a series without its time step, which differs from case to case.

    >>> family("MuJoCo RK4 at 1 ms, solref")
    'MuJoCo RK4, solref'
    """
    return re.sub(r" at [\d.e-]+ ms", "", series)


def orders(study: Trade, cases: Sequence[Case]) -> Iterator[str]:
    """Observed orders by series and kind of error, and every exception with its cause."""
    known = [v for v in study.verdicts if v.expected == v.expected and v.observed == v.observed]
    odd = [v for v in known if is_unexpected(v.observed, v.expected)]
    mute = sum(v.expected == v.expected and v.observed != v.observed for v in study.verdicts)
    yield ORDERS.format(
        count=len(known), near=len(known) - len(odd), within=ORDER_TOLERANCE, mute=mute
    )
    yield "| series | error of | number | expected | smallest | median | largest | other order |"
    yield "|---|---|---|---|---|---|---|---|"
    groups: dict[tuple[str, str, float], list[Verdict]] = {}
    for v in known:
        groups.setdefault((family(v.series), v.kind, v.expected), []).append(v)
    for (series, kind, expected), own in sorted(groups.items()):
        seen = sorted(v.observed for v in own)
        yield (
            f"| {series} | {kind} | {len(own)} | {number(expected)} | {number(seen[0])} "
            f"| {number(median(seen))} | {number(seen[-1])} "
            f"| {sum(v in odd for v in own) or ''} |"
        )
    if odd:
        yield ODD
        yield "| case | series | error of | expected | observed | at all places | it follows |"
        yield "|---|---|---|---|---|---|---|"
        named = {case.name: case for case in cases}
        for v in odd:
            own = [row for row in study.rows if (row.case, row.series) == (v.case, v.series)]
            places = ", ".join(f"{p:.2f}" for p in orders_of_places(named[v.case], v, own))
            yield (
                f"| {v.case} | {v.series} | {v.kind} | {number(v.expected)} "
                f"| {number(v.observed)} | {places} | {v.remark.partition(': ')[0]} |"
            )


def causes(study: Trade) -> Iterator[str]:
    """How often an error floor of each series has each cause, and how high it is."""
    yield FLOORS.format(without=sum(bool(v.reached) for v in study.verdicts))
    yield "| series | error of | cause | number | lowest | median | highest |"
    yield "|---|---|---|---|---|---|---|"
    groups: dict[tuple[str, str, str], list[float]] = {}
    for v in study.verdicts:
        if v.floor > 0:
            groups.setdefault((family(v.series), v.kind, v.cause), []).append(v.floor)
    for (series, kind, cause), floors in sorted(groups.items()):
        yield (
            f"| {series} | {kind} | {cause} | {len(floors)} | {number(min(floors), 2)} "
            f"| {number(median(floors), 2)} | {number(max(floors), 2)} |"
        )
    counts = Counter(v.cause for v in study.verdicts if v.floor > 0)
    told = ", ".join(f"{cause} {count}" for cause, count in counts.most_common())
    yield f"\nNumber of floors by cause: {told}."
