"""Finer steps than a study took: where the errors of a line fall on, its own order tells."""

from dataclasses import replace
from pathlib import Path

import pytest

from proofmass.case import load_case
from proofmass.study import finer
from proofmass.study.finer import promising, refined
from proofmass.study.run import pool
from proofmass.study.store import Store
from tests.trade_rows import line, verdict

CASE = load_case(Path(__file__).parent.parent / "models" / "fourbar.toml")
NEEDED = 1e-9
SAMPLE = 3.14159 / 180


def coarse(name="RK4", order=2.0, seconds=1e-5, scale=1.0, **knobs):
    """A line without its fine half: its last step is 1 ms."""
    return line(name, order=order, scale=scale, cost=seconds, **knobs)[:5]


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_the_step_is_good_enough_and_leads_from_sample_to_sample(order):
    needed = 1e-8
    rows = coarse(order=order, scale=1e-6 / 1e-3**order)
    (_, task), = promising(CASE, "duration", rows, [], "position", needed)
    assert 0.5 * needed < 1e-6 * (task.value / 1e-3) ** order <= needed
    number = SAMPLE / task.value
    assert round(number) % 2 == 1
    assert number == pytest.approx(round(number), rel=1e-3)
    assert task.setting.knobs["timestep"] == task.value
    assert (task.line, task.axis) == (rows[0].line, "timestep")


def test_what_holds_loops_goes_with_the_step():
    rows = [replace(row, knobs={**row.knobs, "solref": (8 * row.value, 1.0)}) for row in coarse()]
    (_, task), = promising(CASE, "duration", rows, [], "position", NEEDED)
    assert task.setting.knobs["solref"] == pytest.approx((8 * task.value, 1.0))
    assert task.setting.knobs["solref"][1] == 1.0


def test_a_line_at_its_floor_is_left_alone():
    rows = coarse()
    assert promising(CASE, "duration", rows, [], "position", NEEDED)
    assert not promising(CASE, "duration", rows, verdict("RK4", 2.0, 1e-8, "softness"), "position",
                         NEEDED)
    assert not promising(CASE, "duration", coarse(order=0.1, scale=1e-6), [], "position", NEEDED)
    lost = [*rows[:-1], replace(rows[-1], outcome="diverged", errors={})]
    assert not promising(CASE, "duration", lost, [], "position", NEEDED)


def test_only_what_promises_to_be_cheaper_is_run():
    dear, cheap = coarse("dear", seconds=1e-4), coarse("cheap", seconds=1e-5)
    good = [replace(row, errors={"position": NEEDED / 2}) for row in coarse("good", seconds=1e-4)]
    found = promising(CASE, "duration", dear + cheap, [], "position", NEEDED)
    assert {task.line for _, task in found} == {"dear", "cheap"}
    for price, lines in ((1e9, {"dear", "cheap"}), (1e-9, set())):
        priced = [replace(row, seconds=price) for row in good]
        found = promising(CASE, "duration", dear + cheap + priced, [], "position", NEEDED)
        assert {task.line for _, task in found} == lines
    assert not promising(CASE, "duration", coarse(seconds=1.0), [], "position", NEEDED), "too long"


def test_steps_are_corrected_until_they_are_good_enough(monkeypatch, tmp_path):
    # a line whose order falls from 2 to 1.5 beyond what was measured: the first step falls short
    asked = []

    def run(tasks, *_, **__):
        asked.extend(tasks)
        return [replace(coarse()[0], value=t.value, knobs=t.setting.knobs, line=t.line,
                        errors={"position": 1e-6 * (t.value / 1e-3) ** 1.5},
                        seconds=1e-5 / t.value) for t in tasks]

    monkeypatch.setattr(finer, "run", run)
    with pool(1) as workers:
        rows = refined(CASE, "duration", coarse(), [], "position", NEEDED, Store(tmp_path), workers)
        assert min(row.errors["position"] for row in rows) <= NEEDED
        assert 1 < len(asked) <= finer.ROUNDS * finer.FEW
        assert refined(CASE, "duration", coarse(), [], "position", 1.0, Store(tmp_path),
                       workers) == coarse()
