"""What a comparison of engines at equal cost says in words, on its page and in a terminal."""

from collections.abc import Iterator
from math import isnan
from statistics import median

from proofmass.base.wording import format_count, format_list, number
from proofmass.sim.engines import format_solver
from proofmass.studies.engines.cost import RANKED_ERRORS, EngineCosts, MachineLoad
from proofmass.studies.record import format_kind
from proofmass.studies.trade.noise import Interval
from proofmass.studies.trade.words import TIME_UNITS
from proofmass.verdict.outcome import Outcome


def conclude(costs: EngineCosts) -> Iterator[str]:
    """A sentence for each error: which engine needs the least time, and which are tied."""
    kind = costs.kinds[0] if costs.kinds else ""
    for error in RANKED_ERRORS if kind else ():
        ranked = [one for one in costs.ranked(kind, error) if one.rank]
        asked = f"an error of {number(error)} of the range in {format_kind(kind)}"
        if not ranked:
            yield f"No engine reaches {asked} in more than half of the cases."
            continue
        leaders = [one.engine for one in ranked if one.rank == 1]
        others = [
            f"{format_solver(one.engine)} {number(one.ratio.stated, 2)} times as long"
            for one in ranked
            if one.rank > 1
        ][:3]
        names = format_list(map(format_solver, leaders))
        verb = "are tied: they need" if leaders[1:] else "needs"
        then = f"; then {format_list(others)}" if others else ""
        yield f"For {asked} {names} {verb} the least time{then} (medians of the cases)."


def describe_machine_load(machine: MachineLoad) -> str:
    """A sentence on the machine and its load."""
    return (
        f"{machine.name or 'An unknown processor'}. Load average {number(machine.before, 2)} at "
        f"the start of the command and {number(machine.after, 2)} at its end, "
        f"{number(machine.least, 2)} to {number(machine.most, 2)} at the timed runs, on "
        f"{format_count(machine.processors, 'processor')}."
    )


def describe_noise(costs: EngineCosts) -> str:
    """A sentence on how repeated timings differ."""
    repeated = [row for row in costs.rows if len(row.repeats) > 1]
    if not repeated:
        return "No timing was repeated, so that no noise is known."
    ratios = [max(row.repeats) / min(row.repeats) for row in repeated]
    return (
        f"Repeated timings of a setting differ by a factor of {number(median(ratios))} in the "
        f"median of {format_count(len(repeated), 'setting')}, at most {number(max(ratios))}. "
        "Engines whose times differ by less than their timings are tied, ≈."
    )


def state_word(state: str) -> str:
    """The word of the page for a state."""
    return "refused" if state == Outcome.UNSUPPORTED else state


def format_span(span: Interval) -> str:
    """A number with its interval, of which an end may be unknown.

    >>> format_span(Interval(1.0, 1.2, 1.5)), format_span(Interval(1.0, 1.0, 1.0))
    ('1.2 (1 to 1.5)', '1')
    >>> format_span(Interval(1e-3, 1e-3, float("nan")))
    '1e-3 (1e-3 to none)'
    """
    words = number(span.stated, 2)
    low, high = (number(end, 2) if end == end else "none" for end in (span.low, span.high))
    return words if low == high else f"{words} ({low} to {high})"


def format_seconds(seconds: float) -> str:
    """A time with a unit in which it is at least 1; a dash for none.

    >>> format_seconds(0.0042), format_seconds(3e-6), format_seconds(0.0)
    ('4.2 ms', '3 µs', '—')
    """
    if isnan(seconds) or not seconds:
        return "—"
    unit, factor = next(((u, f) for u, f in TIME_UNITS if seconds * f >= 1), TIME_UNITS[-1])
    return f"{number(seconds * factor, 2)} {unit}"
