"""A check as Markdown: failures first, first screens, and no markup of a stranger."""

from pathlib import Path

import pytest

from proofmass.base.errors import InputError
from proofmass.batch.check import Result
from proofmass.formats.markdown import LONGEST, as_markdown
from proofmass.screen.screen import Screen, screen_model
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import Outcome

CASES = Path(__file__).parents[1] / "data" / "screen"


def comparison(case, outcome, channel="angle", **more):
    numbers = {"error_max": 0.2, "allowed": 0.1} | more
    return Comparison(case, "mujoco", "dynamics", channel, "rad", outcome=outcome, **numbers)


@pytest.fixture(scope="module")
def screens():
    return {name: screen_model(CASES / f"{name}.xml") for name in ("pd954", "hold565")}


def test_the_headline_counts_cases_and_failures_come_first(screens):
    rows = [
        comparison("good", Outcome.AGREES, error_max=0.01),
        comparison("bad", Outcome.AGREES, "place", error_max=0.01),
        comparison("bad", Outcome.DIFFERS),
        comparison("pd954", Outcome.DIVERGED, "", message="badqacc"),
    ]
    error = InputError(Path("a.toml"), "drive", "no such joint")
    text = as_markdown(Result(comparisons=rows, screens=screens, errors=[error]))
    lines = [line for line in text.splitlines() if line]
    assert lines[1] == (
        "### proofmass: 1 agrees, 1 differs, 1 diverged, 2 with a fault at the start, "
        "1 with bad input"
    )
    assert lines[2] == "❌ **a.toml**, drive: no such joint"
    assert lines[3] == (
        "❌ **bad** differs (dynamics mujoco): angle is off by 0.2 rad, where 0.1 rad are allowed"
    )
    assert "- diverged: badqacc" in lines
    fault = screens["pd954"].findings[0]
    assert any(line.startswith("- ❌ the step of 20 ms is") for line in lines)
    assert f"`{fault.remedy.split()[0]}`" in text


def test_a_name_calls_nobody_and_is_no_element():
    name = "<img src=x> @team **[a](b)`"
    text = as_markdown(Result(comparisons=[comparison(name, Outcome.DIFFERS)]))
    [line] = [line for line in text.splitlines() if line.startswith("❌")]
    assert line.startswith(r"❌ **\<img src=x\> \@team \*\*\[a\](b)\`** differs")


def test_a_long_result_is_cut_between_models_and_says_so(screens):
    many = {f"m{k}": screens["pd954"] for k in range(300)}
    text = as_markdown(Result(screens=many))
    assert len(text) < LONGEST + 100
    shown = text.count("\n**m")
    assert text.rstrip().endswith(f"… {300 - shown} more: see the log of the check.")


def test_a_model_without_a_finding_is_named():
    text = as_markdown(Result(screens={"calm": Screen(Path("calm.xml"))}))
    assert "**calm**: nothing is known of its motion" in text
