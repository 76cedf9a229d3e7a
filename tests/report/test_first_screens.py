"""The index shows what the first screens of models without a sidecar found."""

import re
from html import unescape
from pathlib import Path

import pytest

from proofmass.batch.check import Result, check
from proofmass.report import write_report
from proofmass.screen.screen import screen_model
from proofmass.verdict.comparison import Comparison

CASES = Path(__file__).parents[1] / "data" / "screen"


@pytest.fixture(scope="module")
def index(tmp_path_factory):
    """The text of the index of a report on two models, one of which explodes."""
    folder = tmp_path_factory.mktemp("screens")
    result = check([CASES / "pd954.xml", CASES / "hold565.xml"])
    assert isinstance(result, Result)
    write_report(result, folder)
    return (folder / "index.html").read_text(encoding="utf-8")


def listed(page, severity):
    """The findings of a severity as text."""
    items = re.findall(rf'<li class="is-{severity}">(.*?)</li>', page, re.DOTALL)
    return [unescape(re.sub("<[^>]+>", " ", item)) for item in items]


def test_each_fault_stands_on_the_index_with_its_remedy(index):
    faults = listed(index, "fault")
    for name in ("pd954", "hold565"):
        for finding in screen_model(CASES / f"{name}.xml").findings:
            assert any(finding.text in text and finding.remedy in text for text in faults)
    assert len(faults) == 3  # a step, and two joints that creep


def test_the_index_says_what_the_models_are(index):
    assert unescape(index).count("2 bodies, 2 joints, 2 degrees of freedom") == 2


def test_the_index_says_what_reading_a_model_left_out(tmp_path):
    remark = "not carried over: 2 transmissions & <blink>"
    found = Comparison("arm", "mujoco", "dynamics", "", "m", outcome="self-consistent")
    write_report(Result(comparisons=[found], remarks={"arm": (remark,)}), tmp_path)
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "<blink>" not in page
    assert remark in unescape(page)
