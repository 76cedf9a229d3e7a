"""Predicted finer steps of series whose errors still fall, and settings from the store."""

from dataclasses import replace

import pytest

from proofmass.run.sidecar import load_case
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import Setting
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade.series import find_series, list_cached_settings, predict_steps
from proofmass.studies.trade.varied import list_series
from tests.shipped import shipped
from tests.studies.study_tasks import tasks
from tests.studies.trade.trade_rows import series_rows, series_verdicts

CASE = load_case(shipped("fourbar.toml"))
NEEDED_ERROR = 1e-9


def coarse_series(name="RK4", order=2.0, seconds=1e-5, scale=1.0, **parameters):
    """A series without its finer steps: its last step is 1 ms."""
    return series_rows(name, order=order, scale=scale, cost=seconds, **parameters)[:5]


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_the_order_predicts_the_step_that_is_good_enough(order):
    """The step is that with 0.8 of the needed error."""
    needed = 1e-8
    rows = coarse_series(order=order, scale=1e-6 / 1e-3**order)
    (found,) = predict_steps(rows, [], "position", needed)
    assert 1e-6 * (found.step / 1e-3) ** order == pytest.approx(0.8 * needed, rel=1e-6, abs=0)
    assert found.falls == pytest.approx(order)
    assert found.seconds == pytest.approx(rows[-1].seconds * rows[-1].value / found.step)
    assert found.row is rows[-1]


def test_no_step_is_predicted_at_an_error_floor():
    rows = coarse_series()
    assert predict_steps(rows, [], "position", NEEDED_ERROR)
    assert not predict_steps(
        rows, series_verdicts("RK4", 2.0, 1e-8, "softness"), "position", NEEDED_ERROR
    )
    assert not predict_steps(coarse_series(order=0.1, scale=1e-6), [], "position", NEEDED_ERROR)
    failed = [*rows[:-1], replace(rows[-1], outcome="diverged", errors={})]
    assert not predict_steps(failed, [], "position", NEEDED_ERROR)


def test_the_cheapest_prediction_is_the_first():
    dear, cheap = coarse_series("dear", seconds=1e-4), coarse_series("cheap", seconds=1e-5)
    assert [
        one.row.series for one in predict_steps(dear + cheap, [], "position", NEEDED_ERROR)
    ] == [
        "cheap",
        "dear",
    ]


def test_no_order_is_computed_from_two_nearly_equal_steps():
    """Two steps may differ by 2 % only, after a correction of a step.

    An order computed from these two would be noise of their errors.
    """
    rows = coarse_series()
    near = replace(rows[-1], value=0.98e-3, errors={"position": 0.99e-6})
    plain, with_near = (
        predict_steps(each, [], "position", NEEDED_ERROR)[0] for each in (rows, [*rows, near])
    )
    assert with_near.falls == pytest.approx(plain.falls, abs=0.1)
    assert with_near.row is near


def test_stored_settings_of_any_study_are_listed(tmp_path, models):
    """Stored settings of any study get their series; those of a changed model are left out."""
    store, own = Store(tmp_path), tasks(models)[0].case
    asked = [
        Setting("mujoco", {"timestep": 4e-4, "integrator": "RK4", "defaults": True}),
        Setting("mujoco", {"timestep": 1e-3, "integrator": "Euler", "solver": "CG"}),
    ]
    rows = Study(store).run(
        [StudyRun(own, "dynamics", setting, "choose") for setting in asked], repeats=1
    )
    found = sorted(list_cached_settings(own, "dynamics", [], store), key=lambda row: row.value)
    assert [row.series for row in found] == ["MuJoCo RK4", "MuJoCo, integrator Euler, solver CG"]
    assert [row.value for row in found] == [4e-4, 1e-3]
    assert [(row.errors, row.key, row.repeats) for row in found] == [
        (row.errors, row.key, row.repeats) for row in rows
    ]
    assert [row.key for row in list_cached_settings(own, "dynamics", rows[:1], store)] == [
        rows[1].key
    ]
    assert list(list_cached_settings(own, "dynamics", [], store, "pymunk")) == []
    file = models / "pendulum.xml"
    file.write_text(file.read_text().replace('mass="1"', 'mass="1.5"'))
    assert list(list_cached_settings(tasks(models)[0].case, "dynamics", [], store)) == []


def test_a_setting_belongs_to_the_series_with_its_ratio_of_solref():
    there = list_series(CASE, "dynamics")
    hard = next(one for one in there if one.name == "MuJoCo RK4, solref 8 steps")
    parameters = dict(hard.settings[0].parameters, timestep=1.7e-5, solref=(8 * 1.7e-5, 1.0))
    assert find_series(Setting("mujoco", parameters), there) == (hard.name, "timestep", 1.7e-5)
    parameters["solref"] = (9 * 1.7e-5, 1.0)
    assert find_series(Setting("mujoco", parameters), there)[0].startswith("MuJoCo, integrator RK4")
