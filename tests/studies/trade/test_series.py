"""Convergence series: their ends, error floors and predictions, and settings from the store."""

from dataclasses import replace
from math import inf, isnan, nan

import pytest

from proofmass.outcome import Outcome
from proofmass.sidecar import load_case
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
from tests.shipped import shipped

CASE = load_case(shipped("fourbar.toml"))


def steps(
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


def refined(*errors: float) -> list[tuple[float, float]]:
    """Points with these errors, at sizes each of which is half of the previous one."""
    return [(2.0**-k, error) for k, error in enumerate(errors)]


def falling(*slopes: float) -> list[tuple[float, float]]:
    """Points whose errors fall from 1e-2 with these orders, one for each refinement."""
    return refined(*(1e-2 * 2.0 ** -sum(slopes[:k]) for k in range(len(slopes) + 1)))


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
    return MeasuredSeries(steps(), rows)


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
def test_an_error_is_settled_that_two_refinements_left_or_made_worse(errors, settled):
    assert measured_series(velocity=errors).settled("velocity") is settled


@pytest.mark.parametrize(
    ("places", "settled"),
    [((0.05, 0.02, 0.005), True), ((0.05, 0.02, 0.01), False), ((0.002, 0.005, 0.02), False)],
)
def test_rates_that_stay_far_off_are_settled_where_the_last_places_are_right(places, settled):
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
def test_an_error_rises_that_two_refinements_made_worse(errors, rises):
    assert is_rising(refined(*errors)) is rises


def test_a_hundredth_of_the_range_is_no_floor():
    """Only smaller errors are asymptotic.

    At 1 % the next term of an error, which goes with its square, is 1 % of the error.
    """
    assert find_flat_point(refined(0.0098, 0.01)) is None
    assert find_flat_point(refined(0.01, 0.0098)) is None
    assert find_flat_point(refined(0.0099, 0.0098)) == 0
    assert not is_floor([0.01, 0.01, 0.01])
    assert not is_floor([0.0102, 0.0099, 0.0098]), "the first error is not asymptotic"
    assert find_least_error(refined(0.01, 0.02, 0.04)) is None
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
    assert find_least_error(refined(*errors)) == place


def test_an_end_that_falls_with_the_order_one_half_still_falls():
    """Half of the error at a quarter of the step is order 0.5, which is not below the limit 0.5."""
    points = [(1.0, 1e-3), (0.25, 0.5e-3)]
    assert convergence_order(*points) == 0.5
    assert points_before_slowdown(points) == points


@pytest.mark.parametrize(
    ("points", "seen"),
    [
        (falling(2.0, 2.0), 2.0),
        (falling(2.0, 2.1), 2.05),  # the observed order, not that of the last refinement alone
        (falling(2.0, 2.0, 1.0), 1.0),  # the last refinement shows another order
        (falling(2.0, 2.0, 1.75), 1.75),  # off by more than a tenth
        (falling(1.0, 1.0, 0.85), 0.85),  # off by more than a tenth of first order
        (falling(2.0), 2.0),  # the only refinement
        (falling(0.03), nan),
        (falling(2.0, 0.03), nan),  # the last refinement does not reduce the error
        (refined(1e-2, 2.5e-3, inf), nan),  # a finer run failed
        (refined(0.2, 0.05), nan),
        (refined(0.8, 0.2), nan),  # starts from the error of another motion
        (refined(1e-3), nan),
        ([], nan),
    ],
)
def test_the_order_with_which_a_line_ends(points, seen):
    assert final_order(points) == pytest.approx(seen, nan_ok=True)


def test_of_several_finer_steps_that_are_worse_that_of_the_largest_factor_is_told():
    points = refined(1e-2, 2e-2, 1e-4, 1e-3)
    assert find_worse_pair(points) == (points[2], points[3])


def row(
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


def test_a_line_s_ends_are_its_finest_step_and_the_next_that_is_clearly_coarser():
    """Both must have run; the outcomes of other steps do not matter.

    Two steps that differ by a tenth only show no order.
    """
    rows = [row(8.0), row(4.0, "diverged"), row(2.0), row(1.1, "diverged"), row(1.0)]
    assert list(final_pairs(rows[::-1])) == [(rows[2], rows[4])]
    other = [replace(each, series="other") for each in rows]
    abroad = [replace(each, engine="pymunk") for each in rows]
    found = list(final_pairs([*rows, *abroad, *other]))
    assert len(found) == 3
    assert all((part[2], part[4]) in found for part in (rows, other, abroad))
    assert list(final_pairs(replace(each, varied="iterations") for each in rows)) == []
    assert list(final_pairs([row(2.0, "diverged"), row(1.0)])) == []
    assert list(final_pairs([row(2.0), row(1.0, "diverged")])) == []
    assert list(final_pairs([row(1.3), row(1.0)])) == []


def test_a_floor_in_another_kind_of_error_leaves_the_promise_of_this_one():
    rows = [row(2.0, velocity=4e-3, position=4e-3), row(1.0, velocity=1e-3, position=1e-3)]
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
def test_what_shows_no_order_or_is_good_enough_promises_nothing(coarse, fine, needed):
    assert predict_steps([row(2.0, **coarse), row(1.0, **fine)], [], "velocity", needed) == []


def test_the_price_of_a_promise_is_that_of_its_steps():
    """From an error of 1e-3 to 0.8 of 1e-5 the step is shorter by the root of 125.

    The errors are of second order, and the wall time is longer by the same factor.
    """
    (found,) = predict_steps(
        [row(2.0, velocity=4e-3), row(1.0, velocity=1e-3)], [], "velocity", 1e-5
    )
    assert found.falls == pytest.approx(2.0)
    assert found.step == pytest.approx(125**-0.5)
    assert found.seconds == pytest.approx(125**0.5)


def test_a_setting_with_another_step_keeps_how_many_steps_its_loops_take():
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
def test_settings_are_the_same_that_differ_by_rounding_only(one, other, alike):
    assert are_same_parameters(one, other) is alike
    assert are_same_parameters(other, one) is alike


def test_a_setting_is_on_the_first_line_whose_other_parameters_are_its_own():
    own = [
        steps("pymunk"),
        ConvergenceSeries("mujoco", "alone", "timestep", (Setting("mujoco", {"timestep": 1e-3}),)),
        steps(name="RK4", integrator="RK4"),
        steps(name="Euler"),
        steps(name="again"),
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


def test_a_setting_of_a_line_whose_loops_go_with_the_step_has_theirs():
    hard = steps(name="hard", per=8.0)
    on = Setting("mujoco", {"timestep": 1e-3, "solref": (8e-3, 1.0)})
    assert find_series(on, [hard]) == ("hard", "timestep", 1e-3)
    off = on.with_parameters(solref=(0.8, 1.0))  # that of the series' first setting
    assert find_series(off, [hard]) == ("MuJoCo, solref (0.8, 1.0)", "timestep", 1e-3)


def test_a_setting_is_placed_by_the_parameter_that_its_line_varies():
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
    assert find_series(on, [steps(), softer]) == ("softer", "solref", 0.003)
    of_two = replace(softer, settings=softer.settings[:2])
    assert find_series(on, [steps(), of_two]) == ("softer", "solref", 0.003)


@pytest.fixture
def store(tmp_path, monkeypatch) -> Store:
    """A store whose keys are readable, with two series for the four-bar's dynamics."""
    monkeypatch.setattr(series, "task_key", key)
    monkeypatch.setattr(
        series,
        "list_series",
        lambda case, kind: {
            ("fourbar", "dynamics"): [steps("pymunk"), steps(name="RK4", integrator="RK4")]
        }[case.name, kind],
    )
    return Store(tmp_path)


def key(task: StudyRun) -> str:
    """A key of a task that is readable."""
    return f"{task.case.name} {task.run} {task.setting}".replace("/", " ")


def save(store: Store, setting: Setting, case=CASE, run="dynamics", **found) -> str:
    """Save a measurement of a setting; return its key."""
    task = StudyRun(case, run, setting)
    store.save(key(task), 0, task, Measurement({"velocity": 1e-3}, seconds=2.0, **found), 5.0)
    return key(task)


FINE = Setting("mujoco", {"timestep": 3e-4, "integrator": "RK4", "solref": (0.02, 1.0)})


def test_settings_that_a_store_knows_are_rows_of_those_who_choose(store):
    """The rows have the results of the runs of any study, and the names of their series."""
    own = save(store, Setting("mujoco", {"timestep": 3e-4, "integrator": "RK4"}))
    other = save(store, FINE)
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
    assert found[other].parameters == FINE.parameters, "the tuple, which the file has as a list"
    assert found[other].series == "MuJoCo, integrator RK4, solref (0.02, 1.0)"


def test_repeats_that_a_store_knows_are_timings(store):
    task = StudyRun(CASE, "dynamics", FINE)
    for repeat, seconds in enumerate((0.09, 0.04, 0.03)):
        store.save(key(task), repeat, task, Measurement({"velocity": 1e-3}, seconds=seconds), 5.0)
    (row,) = list_cached_settings(CASE, "dynamics", [], store)
    assert (row.seconds, row.repeats) == (0.03, (0.09, 0.04, 0.03))


def test_what_a_store_knows_beside_is_told_once_and_of_the_engine_that_is_asked_for(store):
    mujoco, pymunk = save(store, FINE), save(store, Setting("pymunk", {"timestep": 1e-3}))
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


def test_what_is_not_of_this_case_or_these_versions_is_not_known(store, monkeypatch):
    other = CASE.model_copy(update={"file": CASE.file.with_name("other.toml")})
    save(store, FINE, case=other)
    save(store, FINE, run="sweep")
    save(store, FINE.with_parameters(integrator="Euler"), outcome=Outcome.DIVERGED)
    save(store, Setting("pymunk", {"timestep": 1e-3}))
    no_parameters = save(store, FINE.with_parameters(timestep=1e-4))
    file = store.file(no_parameters, 0)
    file.write_text(file.read_text().replace('"parameters": {', '"parameters": 3, "were": {'))
    good = save(store, FINE)
    now = series.package_versions
    monkeypatch.setattr(
        series,
        "package_versions",
        lambda engine: now(engine) if engine == "mujoco" else {"pymunk": "0"},
    )
    assert [row.key for row in list_cached_settings(CASE, "dynamics", [], store)] == [good]
    monkeypatch.setattr(series, "task_key", lambda task: "changed since")
    assert list(list_cached_settings(CASE, "dynamics", [], store)) == []


def test_an_engine_without_a_line_of_the_case_is_not_asked(store, monkeypatch):
    """An engine may exist in another installation only."""
    save(store, FINE)
    monkeypatch.setattr(series, "list_series", lambda case, kind: [steps("pymunk")])
    assert list(list_cached_settings(CASE, "dynamics", [], store)) == []
