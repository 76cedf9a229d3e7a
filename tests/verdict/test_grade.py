"""The grade of curves that agree, and the largest error that is not checked."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import pytest

from proofmass.batch.check import Result
from proofmass.formats.junit import as_junit
from proofmass.formats.terminal import as_json, failure_lines, summary_tables
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.grade import Grade, grade_of, worst_unchecked
from proofmass.verdict.outcome import Outcome


def compared(share: float, channel: str = "x", outcome: str = "agrees") -> Comparison:
    """A comparison whose largest error is this share of its range of 2 m."""
    return Comparison(
        "arm",
        "mujoco",
        "sweep",
        channel,
        "m",
        error_max=2 * share,
        error_rms=share,
        nrmse=0.5 * share,
        allowed=1.0,
        outcome=outcome,
    )


@pytest.mark.parametrize(
    ("share", "grade", "blocks"),
    [
        (0.0, Grade.ROUNDING, 5),
        (1e-11, Grade.ROUNDING, 5),
        (1.01e-11, Grade.MILLIONTH, 4),
        (1.01e-6, Grade.THOUSANDTH, 3),
        (1.01e-3, Grade.HUNDREDTH, 2),
        (0.0101, Grade.COARSE, 1),
    ],
)
def test_a_grade_begins_beyond_the_limit_of_the_one_before(share, grade, blocks):
    assert Grade.of(share) is grade
    assert grade.blocks == blocks
    assert grade.close == (share <= 1e-3)


def test_the_grade_of_a_case_is_that_of_its_worst_curve_that_agrees():
    rows = [compared(1e-15), compared(9e-2, "y"), compared(0.5, "z", "unchecked")]
    assert grade_of(rows) is Grade.COARSE
    assert grade_of(rows[:1]) is Grade.ROUNDING
    assert grade_of(rows[2:]) is None
    no_range = replace(rows[1], error_rms=float("nan"), nrmse=float("nan"))
    assert grade_of([rows[0], no_range]) is Grade.ROUNDING  # it has no share to be graded by


def test_an_error_that_is_not_checked_is_told_from_one_per_cent_on():
    rows = [compared(0.67, outcome=Outcome.DIFFERS), compared(0.0099, outcome="unchecked")]
    assert worst_unchecked(rows) is None
    rows.append(compared(0.011, "rate", "unchecked"))
    assert worst_unchecked(rows).channel == "rate"
    lines = [line.plain for line in failure_lines(Result(comparisons=rows))]
    assert "not checked: errors up to 1.1 % of its range (arm sweep mujoco rate)" in lines


def test_table_json_and_junit_have_the_grade():
    rows = [compared(5e-7), compared(2e-4, "y"), compared(0.5, "z", "differs")]
    agreeing, all_three = Result(comparisons=rows[:2]), Result(comparisons=rows)
    (table,) = summary_tables(agreeing)
    assert [str(cell) for cell in table.columns[3].cells] == ["✓ agrees to 1e-3 2/2"]
    (table,) = summary_tables(agreeing, every_channel=True)
    assert [str(cell) for cell in table.columns[3].cells] == [
        "✓ agrees to 1e-6",
        "✓ agrees to 1e-3",
    ]
    data = json.loads(as_json(all_three))
    assert data["grades"] == {"arm": "1e-3"}
    assert [row["grade"] for row in data["comparisons"]] == ["1e-6", "1e-3", None]
    (suite,) = ElementTree.fromstring(as_junit(all_three)).findall("testsuite")
    (told,) = suite.findall("properties/property")
    assert dict(told.attrib) == {"name": "grade", "value": "1e-3"}
    assert (suite.get("tests"), suite.get("failures")) == ("3", "1")
