"""The page of a diet: the summary of savings, and positions of changes and savings on axes."""

from dataclasses import replace

import pytest

from proofmass.report.style import FIRST_LOOK
from proofmass.studies.diet.page import (
    MUTED_COLOUR,
    ZERO_PLACE,
    change_strip,
    saved_strip,
    summary_rows,
)
from proofmass.studies.diet.table import WHOLE_KIND, Entry
from proofmass.studies.diet.trial import Cost

COSTS = Cost(2e-5, 30_720), Cost(1.5e-5, 20_480)
GOES = Entry("light", "sun", "harmless", {"run": {"angle": 1e-3}}, "", COSTS, (0.2, 0.25, 0.3))
CSS = {FIRST_LOOK.colour: "blue", MUTED_COLOUR: "grey"}


def test_what_a_diet_saves_as_a_whole_is_told_first() -> None:
    told = summary_rows(replace(GOES, kind=WHOLE_KIND))
    assert told[0][:2] == ("time of a step", "20 → 15 µs")
    assert told[1][1] == "30 → 20 KB"
    assert told[2] == ("largest change", "1e-3 of what is allowed", "angle in run")
    assert summary_rows(GOES) == []  # not the entry of all changes
    assert summary_rows(replace(GOES, kind=WHOLE_KIND, costs=(), saved=())) == []


def test_changes_stand_over_what_is_allowed() -> None:
    goes = change_strip(GOES, CSS)
    assert goes
    assert goes.dot == pytest.approx(100 * 6 / 18, abs=0.01)  # 1e-3 between 1e-9 and 1e9
    assert goes.band == (0.0, 50.0)
    assert (goes.css, goes.hollow) == ("blue", False)
    stays = change_strip(replace(GOES, outcome="matters", moved={"run": {"angle": 1e12}}), CSS)
    assert stays
    assert (stays.dot, stays.css) == (100.0, "grey")
    assert change_strip(replace(GOES, outcome="needed"), CSS) is None


def test_savings_start_at_zero_and_show_their_interval() -> None:
    strip = saved_strip(GOES, CSS, 1.0, (0.5, 1.5))
    assert strip
    assert strip.bar == (ZERO_PLACE, 100.0)
    assert strip.spread == (0.5 * (ZERO_PLACE + 100.0), 100.0)
    worse = saved_strip(GOES, CSS, -0.1)
    assert worse
    assert worse.bar == (ZERO_PLACE, pytest.approx(ZERO_PLACE - 0.1 * (100 - ZERO_PLACE)))
    assert saved_strip(replace(GOES, costs=()), CSS, 1.0) is None
