"""The page of a diet: the summary of savings, and positions of changes and savings on axes."""

from dataclasses import replace

import pytest

from proofmass.report.style import FIRST_LOOK, LABEL_COLOUR
from proofmass.studies.diet.page import (
    ZERO_PLACE,
    change_strip,
    saved_strip,
    summary_rows,
)
from proofmass.studies.diet.table import WHOLE_KIND, Entry
from proofmass.studies.diet.trial import Cost

COSTS = Cost(2e-5, 30_720), Cost(1.5e-5, 20_480)
HARMLESS_ENTRY = Entry(
    "light", "sun", "harmless", {"run": {"angle": 1e-3}}, "", COSTS, (0.2, 0.25, 0.3)
)
COLOUR_NAMES = {FIRST_LOOK.colour: "blue", LABEL_COLOUR: "grey"}


def test_summary_rows_have_the_total_savings() -> None:
    rows = summary_rows(replace(HARMLESS_ENTRY, kind=WHOLE_KIND))
    assert rows[0][:2] == ("time of a step", "20 → 15 µs")
    assert rows[1][1] == "30 → 20 KB"
    assert rows[2] == ("largest change", "1e-3 of what is allowed", "angle in run")
    assert summary_rows(HARMLESS_ENTRY) == []  # not the entry of all changes
    assert summary_rows(replace(HARMLESS_ENTRY, kind=WHOLE_KIND, costs=(), saved=())) == []


def test_changes_are_drawn_relative_to_the_allowed_ones() -> None:
    goes = change_strip(HARMLESS_ENTRY, COLOUR_NAMES)
    assert goes
    assert goes.dot == pytest.approx(100 * 6 / 18, abs=0.01)  # 1e-3 between 1e-9 and 1e9
    assert goes.band == (0.0, 50.0)
    assert (goes.css, goes.hollow) == ("blue", False)
    stays = change_strip(
        replace(HARMLESS_ENTRY, outcome="matters", moved={"run": {"angle": 1e12}}), COLOUR_NAMES
    )
    assert stays
    assert (stays.dot, stays.css) == (100.0, "grey")
    assert change_strip(replace(HARMLESS_ENTRY, outcome="needed"), COLOUR_NAMES) is None


def test_bars_of_savings_start_at_zero_and_have_an_interval() -> None:
    strip = saved_strip(HARMLESS_ENTRY, COLOUR_NAMES, 1.0, (0.5, 1.5))
    assert strip
    assert strip.bar == (ZERO_PLACE, 100.0)
    assert strip.spread == (0.5 * (ZERO_PLACE + 100.0), 100.0)
    worse = saved_strip(HARMLESS_ENTRY, COLOUR_NAMES, -0.1)
    assert worse
    assert worse.bar == (ZERO_PLACE, pytest.approx(ZERO_PLACE - 0.1 * (100 - ZERO_PLACE)))
    assert saved_strip(replace(HARMLESS_ENTRY, costs=()), COLOUR_NAMES, 1.0) is None
