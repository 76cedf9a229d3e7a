"""Each rule of an import is needed: without it a file of its shape is misread or refused."""

import importlib
from contextlib import suppress
from pathlib import Path

import pytest

from docs.make.own_data import decisions_of, outcome
from proofmass.tables.clean import import_table
from proofmass.tables.decisions import Decisions
from proofmass.tables.foreign import ForeignTable, ImportRule
from tests.tables.shapes import SHAPES

BY_NAME = {shape.name: shape for shape in SHAPES}
RULES = {
    "clean.rename": "inventor.csv",
    "clean.leave_clocks_out": "two_clocks.csv",
    "clean.unwrap_angles": "wrapped.csv",
    "clean.turn_clockwise": "clockwise.csv",
    "clean.treat_empty_cells": "dropout.csv",
    "clean.settle_units": "slope.csv",
    "clean.state_units": "modelica.csv",
    "rows.drop_timeless": "no_time.csv",
    "rows.drop_doubled": "all_doubled.csv",
    "rows.drop_extremes": "rows_of_extremes.csv",
    "rows.reverse": "reversed.csv",
    "rows.drop_events": "event.csv",
    "time_axis.join_seconds": "ros2.csv",
    "time_axis.own_block": "clocks.csv",
    "time_axis.from_epoch": "epoch_ms.csv",
    "time_axis.from_moments": "iso.csv",
    "numbers.leave_words_out": "ros1.csv",
    "numbers.cells_without_units": "timetable.csv",
    "angles.gravity_to_si": "gravity.csv",
}
"""Rules that take a table and return one, and the file of the shape that needs each."""
WORDED = {
    ImportRule.CONTAINER: "adams.res",
    ImportRule.INTERRUPTION: "repeated.csv",
    ImportRule.FRAMES: "frames.csv",
    ImportRule.GROUPS: "grouped_german.csv",
}
"""Rules whose sentences come from a container or from the layout."""


def two_clocks(path: Path) -> None:
    """A file with a time of a clock beside the time."""
    rows = [f"{k / 100:.2f},10:00:0{k % 10},{k * k}" for k in range(40)]
    path.write_text("\n".join(["t [s],taken at,x [mm]", *rows]) + "\n", encoding="utf-8")


@pytest.mark.parametrize("rule", RULES)
def test_a_file_is_misread_or_refused_without_its_rule(
    rule: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, _, name = rule.partition(".")
    file = RULES[rule]

    def unchanged(table: ForeignTable, *_: object) -> ForeignTable:
        return table

    if file == "two_clocks.csv":
        two_clocks(tmp_path / file)
        assert import_table(tmp_path / file, decisions()).names == ["t", "x"]
        monkeypatch.setattr(importlib.import_module(f"proofmass.tables.{module}"), name, unchanged)
        assert import_table(tmp_path / file, decisions()).names == ["t", "taken at", "x"]
        return
    shape = BY_NAME[file]
    assert not outcome(shape, tmp_path).startswith(("misread", "refused"))
    monkeypatch.setattr(importlib.import_module(f"proofmass.tables.{module}"), name, unchanged)
    with suppress(ArithmeticError, ValueError):  # a later rule needs what this one does
        assert outcome(shape, tmp_path).startswith(("misread", "refused"))


def decisions() -> Decisions:
    """No options, and nobody to ask."""
    return Decisions()


def test_each_rule_has_a_shape_in_which_it_says_something(tmp_path: Path) -> None:
    said: dict[ImportRule, str] = {}
    for shape in (one for one in SHAPES if not one.library):
        shape.write(tmp_path / shape.name)
        for correction in import_table(tmp_path / shape.name, decisions_of(shape)).corrections:
            said.setdefault(correction.rule, shape.name)
    assert set(ImportRule) - set(said) == {ImportRule.ANSWER}  # those are in test_questions.py
    for rule, file in WORDED.items():
        table = import_table(tmp_path / file, decisions_of(BY_NAME[file]))
        assert any(one.rule == rule for one in table.corrections)


def test_a_sentence_is_one_line_without_a_full_stop(tmp_path: Path) -> None:
    for shape in (one for one in SHAPES if not one.library):
        shape.write(tmp_path / shape.name)
        for correction in import_table(tmp_path / shape.name, decisions_of(shape)).corrections:
            assert "\n" not in str(correction)
            assert str(correction).removesuffix(" ..")[-1] not in ".;: "
