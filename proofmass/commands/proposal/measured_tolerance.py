"""Tolerances that are proposed from the measured errors of a run."""

from collections.abc import Iterator
from math import ceil, floor, inf, isfinite, log10

from proofmass.base.strict import Kind
from proofmass.base.wording import format_list
from proofmass.case.case import Tolerance
from proofmass.verdict.compare import passes_unmoved
from proofmass.verdict.comparison import Comparison

MIN_TOLERANCE_SHARE = 1e-12
"""Least tolerance that is proposed, as a share of a curve's range: the rounding of another machine,
which adds up over the steps."""
TOLERANCE_FACTOR = 3.0
"""Proposed tolerance over the measured error: other rounding, a slightly longer motion."""
FAR_OFF_TOLERANCE = 0.08
"""Tolerance, as a share of the range, for a channel that is off so far that a curve that does not
move would pass with `TOLERANCE_FACTOR` times its error: less than any such error, which is at least
0.5 / (2 * 3) of the range, as `round_up` doubles a number at most.  So the channel differs."""


def measured_tolerances(
    kind: Kind, solvers: tuple[str, ...], found: list[Comparison]
) -> Iterator[Tolerance]:
    """A tolerance of some solvers for each unit of a run, from the errors that were found."""
    off = far_off(found)
    checked = [c for c in found if isfinite(c.error_max) and c not in off]
    for unit in dict.fromkeys(c.unit for c in checked):
        left = [c for c in checked if c.unit == unit]
        rounding = unit_rounding(left)[unit]
        while left:
            error = max(c.error_max for c in left)
            allowed = round_up(max(TOLERANCE_FACTOR * error, rounding))
            is_rounding = allowed <= round_up(rounding)
            group = [
                c
                for c in left
                if c.error_max == error
                or (is_rounding and c.error_max <= rounding)
                or not passes_unmoved(allowed, curve_scale(c))
            ]
            left = [c for c in left if c not in group]
            measured = f"{error:.2g} {format_unit(unit)}".rstrip()
            at_least = f"; at least {MIN_TOLERANCE_SHARE:g} of the range, for rounding"
            yield tolerance(
                kind,
                solvers,
                group,
                found,
                abs=allowed,
                why=f"proposed: {TOLERANCE_FACTOR:g} times what was measured, {measured}"
                f"{at_least if rounding > TOLERANCE_FACTOR * error else ''}",
            )
    for unit in dict.fromkeys(c.unit for c in off):
        group = [c for c in off if c.unit == unit]
        least = min(c.error_max / curve_scale(c) for c in group)
        yield tolerance(
            kind,
            solvers,
            group,
            found,
            relative_to_range=FAR_OFF_TOLERANCE,
            why=f"proposed: less than what was measured, {least:.2g} of the range or more, which "
            "is too much for a tolerance",
        )


def tolerance(
    kind: Kind,
    solvers: tuple[str, ...],
    group: list[Comparison],
    found: list[Comparison],
    **number: object,
) -> Tolerance:
    """A tolerance for some channels of one unit; all channels of a unit are not listed."""
    unit = group[0].unit
    whole = len(group) == sum(c.unit == unit for c in found)
    channels = ("*",) if whole else tuple(c.channel for c in group)
    return Tolerance.model_validate(
        {"run": kind, "solver": solvers, "unit": (unit,), "channels": channels, **number}
    )


def far_off(found: list[Comparison]) -> list[Comparison]:
    """The channels of a run for which a tolerance would let a curve pass that does not move."""
    rounding = unit_rounding(found)
    return [
        c
        for c in found
        if isfinite(c.error_max)
        and c.error_max > rounding[c.unit]
        and passes_unmoved(round_up(TOLERANCE_FACTOR * c.error_max), curve_scale(c))
    ]


def describe_far_off(off: list[Comparison]) -> str:
    """A phrase on the channels of a run whose errors are too large for a tolerance."""
    errors = format_list(f"{c.channel} by {c.error_max / curve_scale(c):.2g}" for c in off)
    return (
        f"off by so much that {TOLERANCE_FACTOR:g} times the error would let a curve pass that "
        f"does not move, so that they differ: {errors} of its range"
    )


def unit_rounding(found: list[Comparison]) -> dict[str, float]:
    """The least tolerance for each unit: rounding of the largest range of its curves [the unit].

    The range of a curve without an error is not known, and counts as 1.
    """
    least = dict.fromkeys((c.unit for c in found), 0.0)
    for c in found:
        least[c.unit] = max(least[c.unit], MIN_TOLERANCE_SHARE * (curve_scale(c) or 1.0))
    return least


def curve_scale(c: Comparison) -> float:
    """The range of a reference curve, or its size if it is constant; 0 if the error is 0."""
    return c.error_rms / c.nrmse if c.nrmse > 0 else 0.0


def format_unit(unit: str) -> str:
    """A unit and a space; empty for a number without a unit."""
    return "" if unit == "1" else f"{unit} "


def round_up(value: float) -> float:
    """A value rounded up to one digit.

    >>> round_up(0.0123), round_up(3e-7)
    (0.02, 3e-07)
    """
    if not 0 < value < inf:
        return 1e-12
    digits = -floor(log10(value))
    return float(f"{ceil(value * 10**digits - 1e-9)}e{-digits}")
