"""``assert_agrees``: a check or a judgement as an assertion, whose message begins with a number."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from proofmass.batch.check import Result, check, is_checkable
from proofmass.evidence.diagnosis import find_causes, shared_causes
from proofmass.formats.terminal import failure_lines, three_digits, worst_comparison
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.judge import GIVEN_SOLVER, RUN, GivenCurves, judge, prepare
from proofmass.verdict.outcome import GOOD_OUTCOMES, Outcome

NOTHING_JUDGED = "nothing is judged: give a tolerance"


def assert_agrees(
    given: Any,
    reference: str | Path | None = None,
    *,
    fail_on: Collection[str] = (),
    **how: Any,
) -> None:
    """Assert that something agrees with its reference, in any test framework.

    Parameters
    ----------
    given : object
        What `proofmass.check` takes: paths, cases, models of MuJoCo, one or several. Or, with a
        reference or a run, what `proofmass.judge` takes.
    reference : str, path or None
        See `proofmass.judge`.
    fail_on : collection of str, optional
        Kinds of findings of a first screen that fail too, such as ``stable-step``.
    **how
        Further arguments of `proofmass.judge` or `proofmass.check`.

    Raises
    ------
    AssertionError
        Something differs, failed or is not judged. The message begins with the error as a multiple
        of what is allowed; then come the curve, the place, and the cause, if one explains it.
    InputError
        What was given cannot be judged, see `proofmass.judge`.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.linspace(0.0, 2.0, 201)
    >>> known = {"time": time, "angle": 2e-3 * np.cos(3.0 * time)}
    >>> pendulum = {"gravity": 9.0, "amplitude": 2e-3, "mass": 1.0}
    >>> assert_agrees(known, "pendulum", parameters={"length": 1.0, **pendulum}, tolerance=1e-5)
    >>> assert_agrees(known, "pendulum", parameters={"length": 1.1, **pendulum}, tolerance=1e-5)
    Traceback (most recent call last):
    AssertionError: 1.14e+04 x the allowed error: angle is off by 4.58e-04 at 1.68, allowed 4.00e-08
    judge: length is 1.1 m; with 1 m the curve agrees
    """
    __tracebackhide__ = True
    if reference is None and all_checkable(given):
        found = check(given, **{"detectable": False, **how})
        lines = [*lines_of_check(found), *lines_of_findings(found, fail_on)]
    elif reference is None:
        lines = list(lines_of_comparisons(judge(given, None, **how)))
    else:
        how.pop("detectable", None)
        lines = list(lines_of_judgement(prepare(given, reference, **how)))
    if lines:
        raise AssertionError("\n".join(lines))


def all_checkable(given: Any) -> bool:
    """Whether something, or each of several things, is what `check` takes."""
    return all(map(is_checkable, given if isinstance(given, list | tuple | set) else [given]))


def lines_of_check(result: Result) -> Iterator[str]:
    """Lines on what does not agree in a check; none if all is well."""
    if not result.exit_code:
        yield from () if result.comparisons else ("nothing is checked",)
        return
    yield from lines_of_comparisons(result.comparisons)
    yield from (f"error: {error}" for error in result.errors)
    yield from (line.plain for line in failure_lines(result))


def lines_of_findings(result: Result, kinds: Collection[str]) -> Iterator[str]:
    """Lines on the findings of first screens of some kinds."""
    for name, screen in result.screens.items():
        for finding in screen.findings:
            if finding.kind in kinds:
                yield f"{name}: {finding}"


def lines_of_judgement(given: GivenCurves) -> Iterator[str]:
    """Lines on what differs in given curves, and on the causes; none if all agree."""
    found = given.compare(detectable=False)
    yield from lines_of_comparisons(found)
    if any(c.outcome == Outcome.DIFFERS for c in found):
        diagnosis = find_causes(given.case, RUN, GIVEN_SOLVER, given.curves, thorough=False)
        yield from (cause.sentence for cause in shared_causes([diagnosis]))
        yield from diagnosis.remarks


def lines_of_comparisons(found: list[Comparison]) -> Iterator[str]:
    """A line on the worst comparison, or that nothing is judged; none if all agree."""
    if wrong := [c for c in found if c.outcome not in GOOD_OUTCOMES]:
        c, more = worst_comparison(wrong), f" ({len(wrong)} of {len(found)} curves)"
        if c.outcome != Outcome.DIFFERS:
            yield f"{c.outcome}: {c.channel or c.case}: {c.message}"
            return
        unit = f" {c.unit}" if c.unit != "1" else ""
        yield (
            f"{c.share_of_allowed:.3g} x the allowed error: {c.channel} is off by "
            f"{three_digits(c.error_max)}{unit} at {c.at:.6g}, allowed {three_digits(c.allowed)}"
            f"{unit}{more if len(found) > 1 else ''}"
        )
    elif found and not any(c.outcome in (Outcome.AGREES, Outcome.SELF_CONSISTENT) for c in found):
        yield NOTHING_JUDGED
