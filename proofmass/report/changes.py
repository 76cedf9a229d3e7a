"""What changed between two reports: outcomes, errors, and cases that are new or gone."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from proofmass.base.grouping import group_by
from proofmass.base.wording import number
from proofmass.report.record import ChannelRecord, Record
from proofmass.verdict.outcome import GOOD_OUTCOMES, Outcome

CHANGE_FACTOR = 2.0
"""Errors whose ratio is larger count as changed; on one machine a run repeats all its digits."""
ERROR_ROUNDING_SHARE = 1e-12
"""Share of the range up to which an error is rounding, which differs between compilers."""
MAX_NAMED_CHANGES = 5
"""Number of changes that the line in the terminal names."""
FAILING_OUTCOMES = tuple(str(outcome) for outcome in Outcome if outcome not in GOOD_OUTCOMES)


@dataclass(frozen=True)
class Change:
    """A difference to the last report: a case, an outcome, or an error.

    Attributes
    ----------
    case, run, solver, channel : str
        The last three are empty for a case that is new or gone.
    before, now : str
        Outcomes, or errors as shares of the range; empty if there was or is none.
    growth : float
        Ratio of the error to that of the last report [1]; infinite for a new failure, zero for a
        failure that is gone, 1 for a change that is neither better nor worse.
    """

    case: str
    run: str
    solver: str
    channel: str
    before: str
    now: str
    growth: float = 1.0

    @property
    def sentence(self) -> str:
        """The change in words."""
        if not self.run:
            return f"{self.case} is {'new' if self.now else 'gone'}"
        where = f"{self.case} {self.run} {self.solver} {self.channel}".strip()
        if self.before and self.now:
            return f"{where}: {self.before} before, {self.now} now"
        return f"{where}: {'is new, ' + self.now if self.now else 'is gone, ' + self.before}"


def find_changes(before: Record, now: Record) -> list[Change]:
    """Return the changes from one record to another, worst first.

    These are cases that are new or gone, outcomes that changed, and errors that changed by more
    than a factor of two, unless both are rounding.
    """
    names = [{c.case for c in r.comparisons} | {c.name for c in r.cases} for r in (before, now)]
    found = [Change(name, "", "", "", "there", "") for name in sorted(names[0] - names[1])]
    found += [Change(name, "", "", "", "", "there") for name in sorted(names[1] - names[0])]
    rows = [{c.key: c for c in r.comparisons} for r in (before, now)]
    for key in dict.fromkeys([*rows[0], *rows[1]]):
        pair = (rows[0].get(key), rows[1].get(key))
        there = pair[1] or pair[0]
        if there and there.case in names[0] & names[1] and (change := channel_change(there, *pair)):
            found.append(change)
    return sorted(found, key=change_order, reverse=True)


def channel_change(
    known: ChannelRecord, before: ChannelRecord | None, now: ChannelRecord | None
) -> Change | None:
    """Return the change of a channel; None if there is none.

    `known` is the record of the channel in either report.
    """
    where = (known.case, known.run, known.solver, known.channel)
    if before is None or now is None or before.outcome != now.outcome:
        growth = 1.0
        if now and now.outcome not in GOOD_OUTCOMES:
            growth = math.inf
        elif before and before.outcome not in GOOD_OUTCOMES:
            growth = 0.0
        was, is_now = (each.outcome if each else "" for each in (before, now))
        return Change(*where, was, is_now, growth)
    first, second = before.share_of_range, now.share_of_range
    if first is None or second is None or max(first, second) <= ERROR_ROUNDING_SHARE:
        return None
    growth = second / first if first else math.inf
    if 1 / CHANGE_FACTOR <= growth <= CHANGE_FACTOR:
        return None
    return Change(*where, format_error(first), format_error(second), growth)


def format_error(share: float) -> str:
    """Format an error as a share of the range."""
    return f"error {number(share)} of the range"


def change_order(change: Change) -> tuple[bool, bool, float]:
    """Return the sort key of a change: failures, cases that are gone, then growth of the error."""
    gone = not change.run and not change.now
    return change.now in FAILING_OUTCOMES, gone, change.growth


def format_changes(last: Record, found: Sequence[Change]) -> str:
    """Format the line on all changes.

    Changes of one solver in one run share a clause, those for the worse apart from the others.
    """
    start = f"since the last report ({last.made.day}): "
    if not found:
        return start + "nothing changed"
    groups = group_by(found, lambda one: (one.case, one.run, one.solver, one.growth > 1))
    words = []
    for first, *others in groups.values():
        also = f" (and {len(others)} more channel{'s' * (len(others) > 1)})" if others else ""
        words.append(f"{first.sentence}{also}")
    more = f"; and {len(words) - MAX_NAMED_CHANGES} more" if len(words) > MAX_NAMED_CHANGES else ""
    count = f"{len(found)} change{'s' * (len(found) > 1)}"
    return f"{start}{count}: {'; '.join(words[:MAX_NAMED_CHANGES])}{more}"


def changes_of_case(found: Iterable[Change], case: str) -> list[Change]:
    """Return the changes of a case."""
    return [change for change in found if change.case == case]
