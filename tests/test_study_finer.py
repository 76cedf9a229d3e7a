"""Finer steps than a study took: where the errors of a line fall on, its own order tells."""

from dataclasses import replace
from pathlib import Path

import pytest

from proofmass.case import load_case
from proofmass.study import finer
from proofmass.study.axes import lines
from proofmass.study.finer import Limits, known, placed, promises, promising, refined
from proofmass.study.measure import Task
from proofmass.study.run import pool, run
from proofmass.study.setting import Setting
from proofmass.study.store import Store
from tests.study_tasks import tasks
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
    for price, names in ((1e9, {"dear", "cheap"}), (1e-9, set())):
        priced = [replace(row, seconds=price) for row in good]
        found = promising(CASE, "duration", dear + cheap + priced, [], "position", NEEDED)
        assert {task.line for _, task in found} == names
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


def test_an_order_is_not_told_from_two_steps_that_are_nearly_the_same():
    """An earlier correction of a step may be 2 % from it: rounding of errors would be an order."""
    rows = coarse()
    near = replace(rows[-1], value=0.98e-3, errors={"position": 0.99e-6})
    plain, with_near = (promises(each, [], "position", NEEDED)[0] for each in (rows, [*rows, near]))
    assert with_near.falls == pytest.approx(plain.falls, abs=0.1)
    assert with_near.row is near


def test_what_the_store_knows_is_used_whoever_asked_for_it(tmp_path, models):
    """Settings that somebody measured before, on their lines; none of another model."""
    store, own = Store(tmp_path), tasks(models)[0].case
    asked = [Setting("mujoco", {"timestep": 4e-4, "integrator": "RK4", "defaults": True}),
             Setting("mujoco", {"timestep": 1e-3, "integrator": "Euler", "solver": "CG"})]
    rows = run([Task(own, "duration", setting, "choose") for setting in asked], store, repeats=1)
    found = sorted(known(own, "duration", [], store), key=lambda row: row.value)
    assert [row.line for row in found] == ["MuJoCo RK4", "MuJoCo, integrator Euler, solver CG"]
    assert [row.value for row in found] == [4e-4, 1e-3]
    assert [(row.errors, row.key, row.repeats) for row in found] == [
        (row.errors, row.key, row.repeats) for row in rows]
    assert [row.key for row in known(own, "duration", rows[:1], store)] == [rows[1].key]
    file = models / "pendulum.xml"
    file.write_text(file.read_text().replace('mass="1"', 'mass="1.5"'))
    assert list(known(tasks(models)[0].case, "duration", [], store)) == []


def test_a_setting_finds_its_line_with_what_goes_with_its_step():
    there = lines(CASE, "duration")
    hard = next(one for one in there if one.name == "MuJoCo RK4, solref 8 steps")
    knobs = dict(hard.settings[0].knobs, timestep=1.7e-5, solref=(8 * 1.7e-5, 1.0))
    assert placed(Setting("mujoco", knobs), there) == (hard.name, "timestep", 1.7e-5)
    knobs["solref"] = (9 * 1.7e-5, 1.0)
    assert placed(Setting("mujoco", knobs), there)[0].startswith("MuJoCo, integrator RK4")


def test_a_budget_ends_the_search_and_says_so(monkeypatch, tmp_path):
    asked = []

    def run(tasks, *_, timeout, **__):
        asked.append((len(tasks), timeout))
        return [replace(coarse()[0], value=t.value, line=t.line, outcome="timed out", errors={})
                for t in tasks]

    monkeypatch.setattr(finer, "run", run)
    with pool(1) as workers:
        none = Limits(longest=7.0, budget=1e-9)
        assert refined(CASE, "duration", coarse(), [], "position", NEEDED, Store(tmp_path), workers,
                       limits=none) == coarse()
        assert (none.short, none.settings, asked) == (True, 0, [])
        enough = Limits(longest=7.0, budget=100.0)
        refined(CASE, "duration", coarse(), [], "position", NEEDED, Store(tmp_path), workers,
                limits=enough)
        assert (enough.short, enough.settings, asked) == (False, 1, [(1, 7.0)])
        # 31 times as fine a step, 20 s a run: --longest decides, and nothing else
        for longest, runs in ((15.0, 1), (25.0, 2)):
            refined(CASE, "duration", coarse(seconds=1e-4), [], "position", NEEDED, Store(tmp_path),
                    workers, limits=Limits(longest, 1e9))
            assert len(asked) == runs
