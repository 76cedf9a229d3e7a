"""Convergence series: their ends, error floors and predictions, and settings from the store."""

from dataclasses import replace
from math import inf, isnan, nan

import pytest

from proofmass.run.sidecar import load_case
from proofmass.studies.measure import Measurement, StudyRun
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.store import Store
from proofmass.studies.trade import series
from proofmass.studies.trade.series import (
    MeasuredSeries,
    are_same_parameters,
    convergence_order,
    final_order,
    final_pairs,
    find_flat_point,
    find_least_error,
    find_series,
    find_worse_pair,
    is_floor,
    is_rising,
    list_cached_settings,
    points_before_slowdown,
    predict_steps,
    setting_at_step,
)
from proofmass.studies.trade.varied import ConvergenceSeries
from proofmass.studies.trade.verdict import Verdict
from proofmass.verdict.outcome import Outcome
from tests.shipped import shipped

CASE = load_case(shipped("fourbar.toml"))


def series_of_steps(
    engine: str = "mujoco", name: str = "plain", per: float = 0.0, **parameters
) -> ConvergenceSeries:
    """A series of four time steps; `solref` is `per` steps if that is given."""
    return ConvergenceSeries(
        engine,
        name,
        "timestep",
        tuple(
            Setting(
                engine,
                {
                    "timestep": 0.1 / 2**k,
                    **parameters,
                    **({"solref": (per * 0.1 / 2**k, 1.0)} if per else {}),
                },
            )
            for k in range(4)
        ),
    )


def points_of_halved_sizes(*errors: float) -> list[tuple[float, float]]:
    """Points with these errors, at sizes each of which is half of the previous one."""
    return [(2.0**-k, error) for k, error in enumerate(errors)]


def points_of_orders(*slopes: float) -> list[tuple[float, float]]:
    """Points whose errors fall from 1e-2 with these orders, one for each refinement."""
    return points_of_halved_sizes(*(1e-2 * 2.0 ** -sum(slopes[:k]) for k in range(len(slopes) + 1)))


def measured_series(**kinds: tuple[float, ...]) -> MeasuredSeries:
    """A series whose runs have these errors, by kind; an infinite error is a failed run."""
    rows = []
    for each in zip(*kinds.values(), strict=True):
        failed = inf in each
        rows.append(
            StudyRow(
                "trade",
                "",
                "dynamics",
                "mujoco",
                "",
                "timestep",
                0.0,
                {},
                {} if failed else dict(zip(kinds, each, strict=True)),
                outcome=Outcome.DIVERGED if failed else Outcome.RAN,
            )
        )
    return MeasuredSeries(series_of_steps(), rows)


@pytest.mark.parametrize(
    ("errors", "settled"),
    [
        ((0.05, 0.0105, 0.0101, 0.0097), True),  # the last error is below 1/100
        ((0.0104, 0.0102, 0.01), False),  # 1/100 itself is not asymptotic
        ((1e-3, inf, inf), True),  # finer runs fail after a small error
        ((1e-3, 2e-3, inf), True),
        ((0.05, 1e-3, inf, inf), True),
        ((0.05, 0.02, inf, inf), False),
        ((1e-3, 1e-3), False),  # only one refinement
        ((1e-3, 2e-3, 1.9e-3), False),
    ],
)  # the last case: worse, then nearly unchanged, so neither twice
def test_an_error_is_settled_if_two_refinements_do_not_reduce_it(errors, settled):
    assert measured_series(velocity=errors).settled("velocity") is settled


@pytest.mark.parametrize(
    ("places", "settled"),
    [((0.05, 0.02, 0.005), True), ((0.05, 0.02, 0.01), False), ((0.002, 0.005, 0.02), False)],
)
def test_large_errors_of_rates_are_settled_if_positions_are_accurate(places, settled):
    """A jolt at the start may cause large errors of rates for any step."""
    assert measured_series(velocity=(0.5, 0.5, 0.5), position=places).settled("velocity") is settled


@pytest.mark.parametrize(
    ("errors", "rises"),
    [
        ((1e-3, 2e-3, 4e-3), True),
        ((1e-3, 1.5e-3, 2e-3), True),
        ((1e-3, 1.06e-3, 1.13e-3), True),
        ((1e-3, 0.97e-3, 0.95e-3), False),
        ((1e-3, 1.04e-3, 1.08e-3), False),  # by less than 5 %
        ((1e-3, 2e-3, 1.9e-3), False),
        ((1e-3, 2e-3), False),
        ((inf, inf, inf), False),
        ((1e-3, inf, inf), True),
        ((9.0, 1e-3, 2e-3, 4e-3), True),
    ],
)
def test_an_error_rises_if_two_refinements_make_it_worse(errors, rises):
    assert is_rising(points_of_halved_sizes(*errors)) is rises


def test_a_hundredth_of_the_range_is_no_floor():
    """Only smaller errors are asymptotic.

    At 1 % the next term of an error, which goes with its square, is 1 % of the error.
    """
    assert find_flat_point(points_of_halved_sizes(0.0098, 0.01)) is None
    assert find_flat_point(points_of_halved_sizes(0.01, 0.0098)) is None
    assert find_flat_point(points_of_halved_sizes(0.0099, 0.0098)) == 0
    assert not is_floor([0.01, 0.01, 0.01])
    assert not is_floor([0.0102, 0.0099, 0.0098]), "the first error is not asymptotic"
    assert find_least_error(points_of_halved_sizes(0.01, 0.02, 0.04)) is None
    assert find_flat_point([]) is None


def test_no_error_at_all_is_no_error_floor():
    assert not is_floor([0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("errors", "place"),
    [
        ((1e-8, 1e-10, 4e-10, 2e-9), 1),
        ((1e-10, 4e-10), None),
        ((), None),
        ((1e-3, 1.5e-3, 1.6e-3), 0),
        ((1e-10, 1.02e-10, 5e-10, 1e-9), None),  # the next error is nearly as small
        ((1e-10, 5e-10, 1e-9, inf), None),
    ],
)
def test_the_least_error_may_be_a_floor_if_two_finer_ones_or_more_are_worse(errors, place):
    assert find_least_error(points_of_halved_sizes(*errors)) == place


def test_an_error_of_order_one_half_still_falls():
    """Half of the error at a quarter of the step is order 0.5, which is not below the limit 0.5."""
    points = [(1.0, 1e-3), (0.25, 0.5e-3)]
    assert convergence_order(*points) == 0.5
    assert points_before_slowdown(points) == points


@pytest.mark.parametrize(
    ("points", "seen"),
    [
        (
            points_of_orders(2.0, 2.1),
            2.05,
        ),  # the observed order, not that of the last refinement alone
        (points_of_orders(2.0, 2.0, 1.0), 1.0),  # the last refinement shows another order
        (points_of_orders(2.0, 2.0, 1.75), 1.75),  # off by more than a tenth
        (points_of_orders(1.0, 1.0, 0.85), 0.85),  # off by more than a tenth of first order
        (points_of_orders(2.0), nan),  # two points show no order
        (points_of_orders(0.03), nan),
        (points_of_orders(2.0, 0.03), nan),  # the last refinement does not reduce the error
        (points_of_halved_sizes(1e-2, 2.5e-3, inf), nan),  # a finer run failed
        (points_of_halved_sizes(0.2, 0.05), nan),
        (points_of_halved_sizes(0.8, 0.2), nan),  # starts from the error of another motion
        (points_of_halved_sizes(1e-3), nan),
        ([], nan),
    ],
)
def test_the_final_order_of_a_series_is_found(points, seen):
    assert final_order(points) == pytest.approx(seen, nan_ok=True)


def test_of_several_worse_finer_steps_the_worst_is_found():
    points = points_of_halved_sizes(1e-2, 2e-2, 1e-4, 1e-3)
    assert find_worse_pair(points) == (points[2], points[3])


def study_row(
    value: float,
    outcome: str = Outcome.RAN,
    name: str = "plain",
    engine: str = "mujoco",
    axis: str = "timestep",
    **errors: float,
) -> StudyRow:
    """A row of a series at a value of its varied parameter, with errors by kind."""
    return StudyRow(
        "trade",
        "fourbar",
        "dynamics",
        engine,
        name,
        axis,
        value,
        {"timestep": value},
        errors,
        seconds=1.0,
        outcome=outcome,
    )


def test_final_pairs_have_the_finest_and_a_clearly_coarser_step():
    """Both must have run; the outcomes of other steps do not matter.

    Two steps that differ by a tenth only show no order.
    """
    rows = [
        study_row(8.0),
        study_row(4.0, "diverged"),
        study_row(2.0),
        study_row(1.1, "diverged"),
        study_row(1.0),
    ]
    assert list(final_pairs(rows[::-1])) == [(rows[2], rows[4])]
    other = [replace(each, series="other") for each in rows]
    abroad = [replace(each, engine="pymunk") for each in rows]
    found = list(final_pairs([*rows, *abroad, *other]))
    assert len(found) == 3
    assert all((part[2], part[4]) in found for part in (rows, other, abroad))
    assert list(final_pairs(replace(each, varied="iterations") for each in rows)) == []
    assert list(final_pairs([study_row(2.0, "diverged"), study_row(1.0)])) == []
    assert list(final_pairs([study_row(2.0), study_row(1.0, "diverged")])) == []
    assert list(final_pairs([study_row(1.3), study_row(1.0)])) == []


def test_a_floor_of_one_kind_of_error_leaves_predictions_of_another():
    rows = [
        study_row(4.0, velocity=16e-3, position=16e-3),
        study_row(2.0, velocity=4e-3, position=4e-3),
        study_row(1.0, velocity=1e-3, position=1e-3),
    ]
    assert predict_steps(rows[1:], [], "position", 1e-5) == []  # two steps show no order
    at = Verdict("fourbar", "dynamics", "mujoco", "plain", "position", floor=1e-3)
    assert predict_steps(rows, [at], "position", 1e-5) == []
    assert len(predict_steps(rows, [at], "velocity", 1e-5)) == 1
    none = replace(at, floor=nan)
    assert len(predict_steps(rows, [none], "position", 1e-5)) == 1


@pytest.mark.parametrize(
    ("coarse", "fine", "needed"),
    [
        ({}, {}, 1e-5),  # no errors of this kind
        ({"velocity": 4e-3}, {}, 1e-5),
        ({"velocity": inf}, {"velocity": 1e-3}, 1e-5),
        ({"velocity": 1e-3}, {"velocity": 0.0}, 1e-5),
        ({"velocity": 0.0}, {"velocity": 1e-3}, 1e-5),
        ({"velocity": 4e-3}, {"velocity": 1e-3}, 1e-3),  # good enough already
        ({"velocity": 4e-3}, {"velocity": 1e-3}, 2e-3),
        ({"velocity": 1.1e-3}, {"velocity": 1e-3}, 1e-5),
    ],
)  # the error of the last case hardly falls
def test_no_step_is_predicted_without_an_order_or_if_good_enough(coarse, fine, needed):
    assert (
        predict_steps(
            [study_row(4.0, **coarse), study_row(2.0, **coarse), study_row(1.0, **fine)],
            [],
            "velocity",
            needed,
        )
        == []
    )


def test_a_predicted_cost_is_proportional_to_the_steps():
    """From an error of 1e-3 to 0.8 of 1e-5 the step is shorter by the root of 125.

    The errors are of second order, and the processor time is longer by the same factor.
    """
    (found,) = predict_steps(
        [study_row(step, velocity=1e-3 * step**2) for step in (4.0, 2.0, 1.0)],
        [],
        "velocity",
        1e-5,
    )
    assert found.falls == pytest.approx(2.0)
    assert found.step == pytest.approx(125**-0.5)
    assert found.seconds == pytest.approx(125**0.5)


def test_a_setting_at_another_step_keeps_the_ratio_of_solref_to_step():
    parameters = {"integrator": "RK4", "solref": (8e-3, 1.0)}
    coarse = StudyRow("trade", "", "dynamics", "mujoco", "", "timestep", 1e-3, parameters)
    found = setting_at_step(coarse, 2.5e-4)
    assert found.engine == "mujoco"
    assert found.parameters == {"integrator": "RK4", "timestep": 2.5e-4, "solref": (2e-3, 1.0)}
    assert coarse.parameters == parameters, "the parameters of the row must not change"


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [
        ({}, {}, True),
        ({"a": 1.0}, {"b": 1.0}, False),
        ({"a": 1.0}, {}, False),
        ({"a": 1.0}, {"a": 1.0 + 1e-12}, True),
        ({"a": 1.0}, {"a": 1.0 + 1e-6}, False),
        ({"a": 1e-9}, {"a": 2e-9}, False),  # also for small numbers
        ({"a": 1.0}, {"a": 1}, True),
        ({"a": 1}, {"a": 1}, True),
        ({"a": 1}, {"a": 2}, False),
        ({"a": 1.0}, {"a": "1.0"}, False),
        ({"a": "RK4"}, {"a": "RK4"}, True),
        ({"a": "RK4"}, {"a": "Euler"}, False),
        ({"a": (0.02, 1.0)}, {"a": (0.02 * (1 + 1e-12), 1.0)}, True),
        ({"a": (0.02, 1.0)}, {"a": (0.02, 1.1)}, False),
        ({"a": (0.02, 1.0)}, {"a": (0.02,)}, False),
        ({"a": 1.0, "b": 2.0}, {"a": 1.0, "b": 3.0}, False),
        ({"a": 3.0, "b": 2.0}, {"a": 1.0, "b": 2.0}, False),
    ],
)
def test_settings_that_differ_by_rounding_only_are_the_same(one, other, alike):
    assert are_same_parameters(one, other) is alike
    assert are_same_parameters(other, one) is alike


def test_a_setting_belongs_to_the_first_series_with_its_parameters():
    own = [
        series_of_steps("pymunk"),
        ConvergenceSeries("mujoco", "alone", "timestep", (Setting("mujoco", {"timestep": 1e-3}),)),
        series_of_steps(name="RK4", integrator="RK4"),
        series_of_steps(name="Euler"),
        series_of_steps(name="again"),
    ]

    def at(engine: str = "mujoco", **parameters) -> tuple[str, str, float]:
        return find_series(Setting(engine, parameters), own)

    assert at(timestep=1e-3) == ("Euler", "timestep", 1e-3)
    assert at(timestep=1e-3, integrator="RK4") == ("RK4", "timestep", 1e-3)
    assert at("pymunk", timestep=1e-3) == ("plain", "timestep", 1e-3)
    assert at(timestep=1e-3, solver="CG", integrator="RK4") == (
        "MuJoCo, solver CG, integrator RK4",
        "timestep",
        1e-3,
    )
    name, axis, value = at(solver="CG")
    assert (name, axis) == ("MuJoCo, solver CG", "timestep")
    assert isnan(value), "the setting does not state the model's step"
    assert find_series(Setting("pymunk", {"timestep": 0.5}), []) == (
        "pymunk, as in the model",
        "timestep",
        0.5,
    )


def test_a_setting_of_a_scaled_series_has_its_ratio_of_solref_to_step():
    hard = series_of_steps(name="hard", per=8.0)
    on = Setting("mujoco", {"timestep": 1e-3, "solref": (8e-3, 1.0)})
    assert find_series(on, [hard]) == ("hard", "timestep", 1e-3)
    off = on.with_parameters(solref=(0.8, 1.0))  # that of the series' first setting
    assert find_series(off, [hard]) == ("MuJoCo, solref (0.8, 1.0)", "timestep", 1e-3)


def test_a_setting_is_placed_by_the_varied_parameter_of_its_series():
    """The value of a parameter with several numbers is its first number."""
    softer = ConvergenceSeries(
        "mujoco",
        "softer",
        "solref",
        tuple(
            Setting("mujoco", {"timestep": 1e-3, "solref": (0.02 / 2**k, 1.0)}) for k in range(3)
        ),
    )
    on = Setting("mujoco", {"timestep": 1e-3, "solref": (0.003, 1.0)})
    assert find_series(on, [series_of_steps(), softer]) == ("softer", "solref", 0.003)
    of_two = replace(softer, settings=softer.settings[:2])
    assert find_series(on, [series_of_steps(), of_two]) == ("softer", "solref", 0.003)


@pytest.fixture
def store(tmp_path, monkeypatch) -> Store:
    """A store whose keys are readable, with two series for the four-bar's dynamics."""
    monkeypatch.setattr(series, "task_key", readable_key)
    monkeypatch.setattr(
        series,
        "list_series",
        lambda case, kind: {
            ("fourbar", "dynamics"): [
                series_of_steps("pymunk"),
                series_of_steps(name="RK4", integrator="RK4"),
            ]
        }[case.name, kind],
    )
    return Store(tmp_path)


def readable_key(task: StudyRun) -> str:
    """A key of a task that is readable."""
    return f"{task.case.name} {task.run} {task.setting}".replace("/", " ")


def save_run(store: Store, setting: Setting, case=CASE, run="dynamics", **found) -> str:
    """Save a measurement of a setting; return its key."""
    task = StudyRun(case, run, setting)
    store.save(
        readable_key(task), 0, task, Measurement({"velocity": 1e-3}, seconds=2.0, **found), 5.0
    )
    return readable_key(task)


FINE_SETTING = Setting("mujoco", {"timestep": 3e-4, "integrator": "RK4", "solref": (0.02, 1.0)})


def test_stored_settings_are_rows_of_the_study_choose(store):
    """The rows have the results of the runs of any study, and the names of their series."""
    own = save_run(store, Setting("mujoco", {"timestep": 3e-4, "integrator": "RK4"}))
    other = save_run(store, FINE_SETTING)
    found = {row.key: row for row in list_cached_settings(CASE, "dynamics", [], store)}
    assert set(found) == {own, other}
    assert found[own] == StudyRow(
        "choose",
        "fourbar",
        "dynamics",
        "mujoco",
        "RK4",
        "timestep",
        3e-4,
        {"timestep": 3e-4, "integrator": "RK4"},
        {"velocity": 1e-3},
        seconds=2.0,
        repeats=(2.0,),
        key=own,
        shared=found[own].shared,
        step=found[own].step,
    )
    assert found[other].parameters == FINE_SETTING.parameters, (
        "the tuple, which the file has as a list"
    )
    assert found[other].series == "MuJoCo, integrator RK4, solref (0.02, 1.0)"


def test_stored_repeats_are_timings(store):
    task = StudyRun(CASE, "dynamics", FINE_SETTING)
    for repeat, seconds in enumerate((0.09, 0.04, 0.03)):
        store.save(
            readable_key(task), repeat, task, Measurement({"velocity": 1e-3}, seconds=seconds), 5.0
        )
    (row,) = list_cached_settings(CASE, "dynamics", [], store)
    assert (row.seconds, row.repeats) == (0.03, (0.09, 0.04, 0.03))


def test_stored_settings_are_listed_once_and_for_the_given_engine(store):
    mujoco, pymunk = (
        save_run(store, FINE_SETTING),
        save_run(store, Setting("pymunk", {"timestep": 1e-3})),
    )
    first, second = sorted(
        list_cached_settings(CASE, "dynamics", [], store), key=lambda row: row.engine
    )
    assert (first.key, second.key) == (mujoco, pymunk)
    assert [row.key for row in list_cached_settings(CASE, "dynamics", [first], store)] == [pymunk]
    assert [row.key for row in list_cached_settings(CASE, "dynamics", [], store, "mujoco")] == [
        mujoco
    ]
    assert [row.key for row in list_cached_settings(CASE, "dynamics", [], store, "pymunk")] == [
        pymunk
    ]


def test_stored_runs_of_other_cases_or_versions_are_left_out(store, monkeypatch):
    other = CASE.model_copy(update={"file": CASE.file.with_name("other.toml")})
    save_run(store, FINE_SETTING, case=other)
    save_run(store, FINE_SETTING, run="sweep")
    save_run(store, FINE_SETTING.with_parameters(integrator="Euler"), outcome=Outcome.DIVERGED)
    save_run(store, Setting("pymunk", {"timestep": 1e-3}))
    no_parameters = save_run(store, FINE_SETTING.with_parameters(timestep=1e-4))
    file = store.file(no_parameters, 0)
    file.write_text(file.read_text().replace('"parameters": {', '"parameters": 3, "were": {'))
    good = save_run(store, FINE_SETTING)
    now = series.package_versions
    monkeypatch.setattr(
        series,
        "package_versions",
        lambda engine: now(engine) if engine == "mujoco" else {"pymunk": "0"},
    )
    assert [row.key for row in list_cached_settings(CASE, "dynamics", [], store)] == [good]
    monkeypatch.setattr(series, "task_key", lambda task: "changed since")
    assert list(list_cached_settings(CASE, "dynamics", [], store)) == []


def test_stored_runs_of_an_engine_without_a_series_are_left_out(store, monkeypatch):
    """An engine may exist in another installation only."""
    save_run(store, FINE_SETTING)
    monkeypatch.setattr(series, "list_series", lambda case, kind: [series_of_steps("pymunk")])
    assert list(list_cached_settings(CASE, "dynamics", [], store)) == []
