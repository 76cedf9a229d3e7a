"""Orders and error floors of all series of a study, in tables, and what does not fit."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from statistics import median

from benchmarks.accuracy_places import orders_of_places
from proofmass.case import Case
from proofmass.studies.trade.orders import WITHIN, off
from proofmass.studies.trade.trade import Trade
from proofmass.studies.trade.verdict import Verdict
from proofmass.wording import number

ORDERS = """
## Orders

A convergence series varies one parameter, usually the step, from coarse to fine. Its order is that
with which its error falls before an error floor, where two refinements show the same. Of {count}
series that show an order, {near} are within {within} of the one that theory expects
(`proofmass/studies/trade/orders.py`). {mute} more show none: they come to a floor, or to an end,
in fewer refinements, or still bend.
"""
ODD = """
The others, and what their error follows where they end: each possible cause was changed there
separately. The order is that of the largest error of a run. Where that is now here and now there,
or a sum of two terms, no power of the step is to be seen in it: beside it are the medians of the
orders at all places, those that are off by a hundredth of it, from each refinement to the next.
"""
FLOORS = """
## Error floors

Where two halvings of the step each change an error of less than 1e-2 of the range by less than 5 %,
each possible cause was changed separately; the error follows what it is made of.
{without} more verdicts show none: they tell how far their series came.
"""


def family(series: str) -> str:
    """A series' name without the step that it is taken at, which differs from case to case.

    >>> family("MuJoCo RK4 at 1 ms, solref")
    'MuJoCo RK4, solref'
    """
    return re.sub(r" at [\d.e-]+ ms", "", series)


def orders(study: Trade, cases: Sequence[Case]) -> Iterator[str]:
    """Observed orders by series and kind of error, and every exception with what moves it."""
    known = [v for v in study.verdicts if v.expected == v.expected and v.observed == v.observed]
    odd = [v for v in known if off(v.observed, v.expected)]
    mute = sum(v.expected == v.expected and v.observed != v.observed for v in study.verdicts)
    yield ORDERS.format(count=len(known), near=len(known) - len(odd), within=WITHIN, mute=mute)
    yield "| series | error of | number | expected | least | median | greatest | off |"
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
    """How often an error floor of a series is what, and how high."""
    yield FLOORS.format(without=sum(bool(v.reached) for v in study.verdicts))
    yield "| series | error of | it is | number | lowest | median | highest |"
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
    told = Counter(v.cause for v in study.verdicts if v.floor > 0)
    yield "\nAll together: " + ", ".join(f"{cause} {n}" for cause, n in told.most_common()) + "."
