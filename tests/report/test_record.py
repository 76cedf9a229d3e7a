"""The record that a report keeps for the next one, and the changes since the last report."""

import json
import platform
import socket
from dataclasses import replace
from math import inf, nan
from pathlib import Path

import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.base.files import write_output
from proofmass.batch.check import Result
from proofmass.commands import cli
from proofmass.formats.terminal import COMPARISON_KEYS
from proofmass.report import record, write_report
from proofmass.report.changes import Change, find_changes, format_changes
from proofmass.report.record import (
    KEPT_REPORTS,
    History,
    Last,
    extend_history,
    make_record,
    read_last,
    record_start,
    write_record,
)
from proofmass.run.sidecar import load_case
from proofmass.verdict.comparison import Comparison, DetectableChange
from proofmass.verdict.outcome import Outcome
from tests.shipped import MODELS, shipped

MADE = record_start(["proofmass", "report"])


def comparison_of(channel: str, share: float, case: str = "one", outcome: str = "agrees", **more):
    """A comparison whose error is that share of a range of 1."""
    return Comparison(
        case,
        "mujoco",
        "sweep",
        channel,
        "m",
        error_max=share,
        error_rms=1.0,
        nrmse=1.0,
        allowed=1e-3,
        outcome=outcome,
        **more,
    )


def record_of(*rows: Comparison, **more):
    return make_record(Result(comparisons=list(rows), **more), MADE)


def test_a_record_holds_every_key_of_the_json_and_the_share_of_the_range():
    names = set(record.ChannelRecord.model_fields)
    assert names == {*COMPARISON_KEYS, "share_of_range"}
    found = record_of(
        comparison_of("x", 0.25, detectable={"length": DetectableChange(nan)}, at=inf)
    )
    (row,) = found.comparisons
    assert row.share_of_range == 0.25
    assert (row.at, row.seconds) == (None, None)
    assert row.detectable == {"length": {"size": None, "relative": True}}


def test_a_record_is_read_as_it_was_written(tmp_path):
    case = load_case(shipped("fourbar.toml"))
    error = InputError(Path("/home/me/bad.toml"), "drive.joint", "in /home/me/bad.toml")
    first = record_of(comparison_of("x", 0.25), cases=[case], errors=[error], paths=(MODELS,))
    write_record(tmp_path, first, extend_history(History(), first))
    again = read_last(tmp_path).record
    assert again == first.model_copy(update={"history": extend_history(History(), first)})
    (kept,) = again.cases
    assert (kept.name, kept.family, kept.reference) == ("fourbar", "linkages", "fourbar")
    text = (tmp_path / "results.json").read_text()
    assert "/home/me" not in text
    assert again.errors[0].model_dump() == {
        "file": "bad.toml",
        "key": "drive.joint",
        "wrong": "in bad.toml",
    }
    assert len([line for line in text.splitlines() if '"channel":' in line]) == 1


def test_the_command_of_a_record_has_no_folders(monkeypatch):
    made = record_start(["proofmass", "report", "/home/me/models", "-o", "pages"])
    assert made.command == "proofmass report models -o pages"
    assert made.versions["proofmass"]
    assert made.versions["mujoco"]
    assert made.processors >= 1
    assert made.load_start is None or made.load_start >= 0


def test_a_record_has_no_host_name(monkeypatch):
    monkeypatch.setattr(platform, "node", lambda: "secret-host")
    monkeypatch.setattr(socket, "gethostname", lambda: "secret-host")
    made = record_start(["proofmass", "report"])
    assert "secret-host" not in made.model_dump_json()
    assert made.machine == f"{platform.system()} {platform.machine()}"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is damaged: "),
        ("[]", "is damaged: it has no format version"),
        ('{"format": 2}', "is damaged: its format version is 2, and 1 is read here"),
        ('{"format": 1}', "is damaged: made: Field required"),
        (b"\xb0", "cannot be read: the byte 0xb0 is not UTF-8"),
    ],
)
def test_a_damaged_record_is_reported_and_the_report_is_written(tmp_path, text, words):
    file = tmp_path / "results.json"
    write_output(file, text)
    wrong = read_last(tmp_path).wrong
    assert wrong.startswith(f"the record {file} {words}")
    assert wrong.endswith("; changes since the last report are not shown")
    assert "\n" not in wrong
    page = write_report(Result(comparisons=[comparison_of("x", 1.0)]), tmp_path).read_text(
        encoding="utf-8"
    )
    assert "changes since the last report are not shown" in page
    assert str(tmp_path) not in page
    assert read_last(tmp_path).record is not None  # this report has written a new record


def test_a_missing_record_is_no_error(tmp_path):
    assert read_last(tmp_path) == Last()


COMPARISONS_BEFORE = [
    comparison_of("x", 1e-6),
    comparison_of("y", 1e-6),
    comparison_of("z", 1e-14),
    comparison_of("w", 0.0),
]


@pytest.mark.parametrize(
    ("now", "growth"),
    [
        (comparison_of("x", 1.99e-6), None),
        (comparison_of("x", 2.01e-6), 2.01),
        (comparison_of("x", 0.51e-6), None),
        (comparison_of("x", 0.49e-6), 0.49),
        (comparison_of("z", 0.99e-12), None),  # both errors are rounding errors
        (comparison_of("z", 1.01e-12), 101.0),
        (comparison_of("w", 1.01e-12), inf),
        (comparison_of("x", 0.0), 0.0),
    ],
)
def test_an_error_changes_by_more_than_a_factor_of_two_above_rounding(now, growth):
    rows = [now if c.channel == now.channel else c for c in COMPARISONS_BEFORE]
    found = find_changes(record_of(*COMPARISONS_BEFORE), record_of(*rows))
    assert [c.growth for c in found] == ([] if growth is None else [pytest.approx(growth)])
    if growth is not None:
        assert found[0].channel == now.channel
        assert "of the range before, error" in found[0].sentence


def test_changed_outcomes_and_cases_are_reported():
    before = record_of(
        comparison_of("x", 1e-6),
        comparison_of("y", 1.0, outcome=Outcome.DIFFERS),
        comparison_of("x", 1e-6, "old"),
    )
    now = record_of(
        comparison_of("x", nan, outcome=Outcome.CRASHED),
        comparison_of("y", 1e-6),
        comparison_of("x", 1e-6, "new"),
    )
    assert [c.sentence for c in find_changes(before, now)] == [
        "one sweep mujoco x: agrees before, crashed now",
        "old is gone",
        "new is new",
        "one sweep mujoco y: differs before, agrees now",
    ]
    assert [c.growth for c in find_changes(before, now)] == [inf, 1.0, 1.0, 0.0]
    assert find_changes(now, now) == []


def test_a_channel_that_is_added_or_removed_is_a_change():
    found = find_changes(
        record_of(comparison_of("x", 0.1), comparison_of("y", 0.1)),
        record_of(comparison_of("x", 0.1), comparison_of("z", 0.1)),
    )
    assert sorted(c.sentence for c in found) == [
        "one sweep mujoco y: is gone, agrees",
        "one sweep mujoco z: is new, agrees",
    ]


def test_the_line_of_changes_names_the_five_worst():
    last = record_of(*(comparison_of("x", 1e-6, f"c{k}") for k in range(8)))
    assert format_changes(last, []) == f"since the last report ({MADE.day}): nothing changed"
    grown = record_of(*(comparison_of("x", 1e-6 * (k + 1), f"c{k}") for k in range(8)))
    line = format_changes(last, find_changes(last, grown))
    # c1 is twice as large, which is not more than a factor of two
    assert line.startswith(f"since the last report ({MADE.day}): 6 changes: c7 sweep mujoco x: ")
    assert line.endswith("; and 1 more")
    assert line.count(" before, ") == 5
    assert "c2" not in line
    one = format_changes(last, [Change("a", "", "", "", "", "there")])
    assert one.endswith("1 change: a is new")


def test_the_line_of_changes_groups_the_channels_of_a_run():
    last = record_of(*(comparison_of(name, 1e-6) for name in "abcde"))
    wrong = [comparison_of(name, 1.0, outcome=Outcome.DIFFERS) for name in "abc"]
    now = record_of(*wrong, comparison_of("d", 1e-5), comparison_of("e", 1e-9))
    line = format_changes(last, find_changes(last, now))
    assert line.partition("): ")[2] == (
        "5 changes: one sweep mujoco a: agrees before, differs now (and 3 more channels); "
        "one sweep mujoco e: error 1e-6 of the range before, error 1e-9 of the range now"
    )


def test_a_history_keeps_errors_of_the_last_reports_with_three_digits():
    history = History()
    for k in range(KEPT_REPORTS + 2):
        rows = [
            comparison_of("x", 1.23456 * (k + 1)),
            *([comparison_of("y", 1.0)] if k == 1 else []),
        ]
        history = extend_history(history, record_of(*rows))
    assert len(history.reports) == KEPT_REPORTS
    assert history.trend("one", "sweep", "mujoco", "x")[0] == 3.7
    assert len(history.trend("one", "sweep", "mujoco", "x")) == KEPT_REPORTS
    assert history.trend("one", "sweep", "mujoco", "y") == [None] * KEPT_REPORTS  # no longer kept
    assert set(history.errors) == {"one/sweep/mujoco/x"}
    again = extend_history(history, record_of(comparison_of("y", 0.5)))
    assert again.trend("one", "sweep", "mujoco", "y") == [None] * (KEPT_REPORTS - 1) + [0.5]
    assert again.trend("one", "sweep", "mujoco", "x")[-1] is None


def run_command(*args: object):
    return CliRunner().invoke(cli.app, [str(a) for a in args])


def test_a_report_is_compared_with_the_last_one_or_with_a_baseline(monkeypatch, tmp_path):
    found = [comparison_of("x", 1e-6), comparison_of("x", 1e-6, "two")]
    monkeypatch.setattr(
        cli, "check_with_progress", lambda *_, **__: Result(comparisons=list(found))
    )
    first = run_command("report", "-o", tmp_path / "a")
    assert first.exit_code == 0, first.output
    assert "since the last report" not in first.output
    again = run_command("report", "-o", tmp_path / "a")
    assert "): nothing changed" in again.output
    found[0] = replace(found[0], error_max=1e-3)
    worse = run_command("report", "-o", tmp_path / "a")
    assert "1 change: one sweep mujoco x: error 1e-6 of the range before" in worse.output
    other = run_command("report", "-o", tmp_path / "b", "--baseline", tmp_path / "a")
    assert "): nothing changed" in other.output
    assert len(read_last(tmp_path / "a").record.history.reports) == 3
    assert len(read_last(tmp_path / "b").record.history.reports) == 4


def test_a_missing_baseline_is_reported_before_anything_runs(monkeypatch, tmp_path):
    monkeypatch.setattr(cli, "check_with_progress", lambda *_, **__: pytest.fail("it ran"))
    answer = run_command("report", "-o", tmp_path / "a", "--baseline", tmp_path / "b")
    assert answer.exit_code == 2
    assert "results.json: no such file; proofmass report writes it" in answer.output.replace(
        "\n", ""
    )


def test_a_damaged_baseline_is_reported_before_anything_runs(monkeypatch, tmp_path):
    monkeypatch.setattr(cli, "check_with_progress", lambda *_, **__: pytest.fail("it ran"))
    (tmp_path / "b").mkdir()
    damaged = tmp_path / "b" / "results.json"
    damaged.write_text("{")
    answer = run_command("report", "-o", tmp_path / "a", "--baseline", tmp_path / "b")
    assert answer.exit_code == 2
    assert f"{damaged}:isdamaged:" in "".join(answer.output.split())
    assert damaged.read_text() == "{"


def test_a_damaged_last_record_is_reported_once_and_replaced(monkeypatch, tmp_path):
    monkeypatch.setattr(
        cli, "check_with_progress", lambda *_, **__: Result(comparisons=[comparison_of("x", 1e-6)])
    )
    write_output(tmp_path / "results.json", "{")
    answer = run_command("report", "-o", tmp_path)
    assert answer.exit_code == 0
    assert answer.output.count("changes since the last report are not shown") == 1
    assert json.loads((tmp_path / "results.json").read_text())["exit_code"] == 0
