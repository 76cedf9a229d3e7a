"""A check as JUnit XML for continuous integration: a suite for a case, a test for a channel."""

import math
import re
from collections import Counter
from itertools import groupby
from xml.etree import ElementTree

from proofmass.base.errors import InputError
from proofmass.base.files import OUTPUT_MARK
from proofmass.base.wording import number
from proofmass.batch.check import Result
from proofmass.verdict.comparison import UNCHECKED_CASE, Comparison
from proofmass.verdict.grade import grade_of
from proofmass.verdict.outcome import UNCHECKED_OUTCOMES, Outcome

INVALID_CHARACTERS = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML does not allow."""


def as_junit(result: Result) -> bytes:
    """The XML file of a result.

    A suite has the grade of its case as a property, see `proofmass.verdict.grade`.  A channel that
    is not checked is a skipped test, one that differs or failed is a failure, and an
    input with an error is a suite of its own with an error.  A failure begins with the cause of its
    run, if one was found.  The time of a run is divided evenly among its channels, so that the sums
    are those of the runs.
    """
    root = ElementTree.Element("testsuites", name="proofmass")
    shared = Counter((c.case, c.run, c.solver) for c in result.comparisons)
    causes = {run: cause.text for cause in result.causes for run in cause.runs}
    for case, rows in groupby(result.comparisons, lambda c: c.case):
        suite = ElementTree.SubElement(root, "testsuite", name=replace_invalid(case))
        own = list(rows)
        add_grade(suite, own)
        for c in own:
            run = c.case, c.run, c.solver
            add_test(suite, c, shared[run], causes.get(run, ""))
        if case in [each.name for each in result.unchecked]:
            add_unchecked(suite, case)
    for error in result.errors:
        add_error(root, error)
    for suite in [*root]:
        set_counts(suite)
    set_totals(root)
    root.insert(0, ElementTree.Comment(f" {OUTPUT_MARK} "))
    ElementTree.indent(root)
    found: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return found + b"\n"


def replace_invalid(text: str) -> str:
    """A text in which characters that XML does not allow are replaced by "?".

    >>> replace_invalid("a\\x00b")
    'a?b'
    """
    return INVALID_CHARACTERS.sub("?", text)


def add_grade(suite: ElementTree.Element, rows: list[Comparison]) -> None:
    """Add the grade of a case, by its curves that agree, as a property of its suite."""
    if grade := grade_of(rows):
        properties = ElementTree.SubElement(suite, "properties")
        ElementTree.SubElement(properties, "property", name="grade", value=grade.label)


def add_test(suite: ElementTree.Element, c: Comparison, channels: int, cause: str = "") -> None:
    """Add the test of a channel of a solver in a run, with the cause of the run if it is known."""
    test = ElementTree.SubElement(
        suite,
        "testcase",
        classname=replace_invalid(f"{c.case}.{c.run}.{c.solver}"),
        name=replace_invalid(c.channel or "loads and steps"),
        time=format_seconds(c.seconds / channels),
    )
    if c.outcome in UNCHECKED_OUTCOMES:
        ElementTree.SubElement(test, "skipped", message=replace_invalid(skip_message(c)))
    elif c.outcome != Outcome.AGREES:
        message = replace_invalid("\n".join(filter(None, [cause, failure_message(c)])))
        ElementTree.SubElement(test, "failure", type=str(c.outcome), message=message).text = message


def skip_message(c: Comparison) -> str:
    """Why a channel is not checked."""
    why = c.message or c.outcome.sentence if isinstance(c.outcome, Outcome) else c.message
    return f"{c.outcome}: {why}"


def failure_message(c: Comparison) -> str:
    """The message of a channel that differs or failed, with its error and tolerance."""
    if c.outcome != Outcome.DIFFERS:
        return f"{c.outcome}: {c.message}"
    numbers = f"error {number(c.error_max)} {c.unit}".strip()
    return (
        f"differs: {c.message}: {numbers} at {c.at:.6g}, {number(c.allowed)} allowed, "
        f"{number(c.relative_to_range)} of the range"
    )


def add_unchecked(suite: ElementTree.Element, case: str) -> None:
    """Add the failure of a case of which nothing was checked."""
    test = ElementTree.SubElement(
        suite, "testcase", classname=replace_invalid(case), name="something is checked", time="0"
    )
    ElementTree.SubElement(
        test, "failure", type="unchecked", message=UNCHECKED_CASE
    ).text = UNCHECKED_CASE


def add_error(root: ElementTree.Element, error: InputError) -> None:
    """Add the suite of an input with an error."""
    suite = ElementTree.SubElement(root, "testsuite", name=replace_invalid(str(error.file)))
    name = replace_invalid(error.key or "is read")
    test = ElementTree.SubElement(
        suite, "testcase", classname=replace_invalid(error.file.name), name=name, time="0"
    )
    message = replace_invalid(str(error))
    ElementTree.SubElement(test, "error", type="InputError", message=message).text = message


def set_counts(suite: ElementTree.Element) -> None:
    """Write the numbers of tests, failures, errors and skipped tests into a suite."""
    suite.set("tests", str(len(suite.findall("testcase"))))
    for key, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(key, str(len(suite.findall(f"testcase/{tag}"))))
    suite.set("time", format_seconds(sum(float(test.get("time", "0")) for test in suite)))


def set_totals(root: ElementTree.Element) -> None:
    """Write the sums of all suites."""
    for key in ("tests", "failures", "errors", "skipped"):
        root.set(key, str(sum(int(suite.get(key, "0")) for suite in root)))
    root.set("time", format_seconds(sum(float(suite.get("time", "0")) for suite in root)))


def format_seconds(value: float) -> str:
    """A time [s] to the microsecond; 0 if it is not known."""
    return f"{value:.6f}" if math.isfinite(value) else "0"
