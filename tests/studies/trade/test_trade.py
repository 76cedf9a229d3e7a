"""Trade studies: convergence series, expected orders, error floors, failed runs, the command."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.accuracy_places import orders_of_places
from proofmass.base.errors import InputError
from proofmass.commands.cli import app
from proofmass.run.sidecar import load_case
from proofmass.run.solve import MAX_FORCE_EVALUATIONS, describe_dynamics
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import Setting, StudyRow, read_table
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade import trade
from proofmass.studies.trade.choose import is_default
from proofmass.studies.trade.orders import ORDER_TOLERANCE, expected_orders, is_unexpected
from proofmass.studies.trade.series import (
    MeasuredSeries,
    find_flat_point,
    find_least_error,
    find_slowdown,
    find_worse_pair,
    is_floor,
    observed_order,
    slowdown_error,
)
from proofmass.studies.trade.varied import (
    ConvergenceSeries,
    list_series,
    setting_size,
)
from proofmass.studies.trade.words import format_end, format_reached, format_worsened
from tests.shipped import shipped


def power_law_points(order, scale=1.0, floor=0.0, count=8):
    """Points of halved sizes whose errors are scale * size^order + floor."""
    sizes = 0.1 / 2 ** np.arange(count)
    return [(float(h), float(scale * h**order + floor)) for h in sizes]


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_the_order_of_a_power_law_is_its_power(order):
    assert observed_order(power_law_points(order)) == pytest.approx(order, abs=1e-9)


def test_an_error_floor_does_not_change_the_observed_order():
    points = power_law_points(2.0, floor=1e-5)
    assert 1.0e-5 < points[find_slowdown(points)][1] < 2e-5
    assert slowdown_error(points) == points[-1][1]
    assert observed_order(points) == pytest.approx(2.0, abs=0.15)  # with a tenth of floor: 1.87


def test_an_error_that_keeps_falling_has_no_floor():
    assert find_slowdown(power_law_points(1.0)) is None
    assert find_flat_point(power_law_points(1.0)) is None
    assert np.isnan(slowdown_error(power_law_points(1.0)))


def test_a_plateau_that_an_error_leaves_is_no_floor():
    points = [(0.4, 1e-3), (0.2, 1e-3), (0.1, 1e-3), (0.05, 1e-4), (0.025, 1e-6)]
    assert find_slowdown(points) is None
    assert find_flat_point(points) is None


def test_rounding_that_grows_may_be_a_floor_at_the_least_error():
    points = [(h, h**2 + 1e-12 / h**2) for h in (0.1 / 2**k for k in range(12))]
    assert (
        slowdown_error(points)
        == points[find_least_error(points)][1]
        == min(error for _, error in points)
    )
    assert find_flat_point(points) is None
    assert find_least_error(points[:9]) is None  # only one finer step is worse


@pytest.mark.parametrize(("share", "shown"), [(0.05, True), (0.2, False), (1.0, False)])
def test_a_floor_is_an_error_that_two_halvings_leave_unchanged(share, shown):
    """If a share s of an error still falls with first order, it changes by s / 2, then by less."""
    assert is_floor([1e-3 * (1 - share + share / by) for by in (1, 2, 4)]) is shown


@pytest.mark.parametrize(
    "errors", [(0.8, 0.8, 0.8), (0.011, 0.011, 0.011), (1e-3, 1.06e-3, 1.06e-3), (1e-3, 1e-3), ()]
)
def test_a_floor_is_asymptotic_and_measured_twice(errors):
    assert not is_floor(errors)


def test_a_finer_step_that_is_worse_is_found():
    """The first points are like those of the chain of two four-bars.

    Errors that are large at both steps are those of another motion, and do not count.
    """
    chain = [(4e-3, 0.9), (2e-3, 0.3), (1e-3, 1.9e-2), (5e-4, 6.8e-2), (2.5e-4, 4e-4)]
    assert find_worse_pair(chain) == (chain[2], chain[3])
    assert find_worse_pair([(2e-3, 0.3), (1e-3, 0.9)]) is None
    assert find_worse_pair([(2e-3, 1e-3), (1e-3, 1.4e-3)]) is None
    assert find_worse_pair(power_law_points(1.0)) is None


@pytest.mark.slow
def test_a_finer_step_through_a_flat_pose_is_worse(tmp_path):
    """The case is the shipped chain of parallelograms in pymunk; its reference is a closed form."""
    case = load_case(shipped("parallelogram_chain.toml"))
    rows = Study(Store(tmp_path)).run(
        [
            StudyRun(case, "dynamics", Setting("pymunk", {"timestep": step}))
            for step in (1e-3, 5e-4, 2.5e-4)
        ],
        repeats=0,
    )
    points = [(row.step, row.errors["position"]) for row in rows]
    assert find_worse_pair(points) == (points[1], points[2])


def measured_series(errors, seconds=0.1, outcomes=()):
    """A series of runs with velocity errors, followed by runs with other outcomes."""
    series = ConvergenceSeries(
        "mujoco",
        "x",
        "timestep",
        tuple(Setting("mujoco", {"timestep": 0.1 / 2**k}) for k in range(8)),
    )
    rows = [
        StudyRow(
            "trade",
            "",
            "dynamics",
            "mujoco",
            "x",
            "timestep",
            0.0,
            errors={"velocity": e},
            seconds=seconds,
        )
        for e in errors
    ]
    rows += [
        StudyRow("trade", "", "dynamics", "mujoco", "x", "timestep", 0.0, outcome=o)
        for o in outcomes
    ]
    return MeasuredSeries(series, rows)


def test_a_series_ends_if_errors_settle_at_its_budget_or_at_a_timeout():
    assert not measured_series([]).done(1.0)
    assert not measured_series([1e-2, 2e-3, 1e-3]).done(1.0)
    assert measured_series([1e-2, 1e-3, 1e-3, 1e-3]).done(1.0)
    assert not measured_series([1e-2, 1e-3, 1e-3]).done(1.0)
    assert not measured_series([0.8, 0.81, 0.8, 0.8]).done(1.0), "another motion is no floor"
    assert measured_series([1e-2, 2e-3, 1e-3]).done(0.05)
    assert measured_series([], outcomes=["timed out"]).done(1.0)
    assert not measured_series([], outcomes=["diverged"]).done(1.0), "a smaller step may be stable"
    assert measured_series([0.01 / 4**k for k in range(8)]).done(1.0), "there are no more settings"


def test_failed_runs_at_finer_steps_end_a_series():
    failed = measured_series([1e-2, 1e-3, 1e-4], outcomes=["diverged", "not finite"])
    points = failed.points("velocity")
    assert [error for _, error in points] == [1e-2, 1e-3, 1e-4, np.inf, np.inf]
    assert slowdown_error(points) == 1e-4
    assert find_flat_point(points) is find_least_error(points) is None, "nothing shows a floor"
    assert failed.done(1.0)
    assert np.isnan(observed_order(points))


def test_failed_or_far_off_runs_at_coarse_steps_are_no_points():
    coarse = measured_series([0.5, 3.0, 1e-2, 1e-3, 1e-4])
    coarse.rows[1] = replace(coarse.rows[1], outcome="diverged", errors={})
    assert [error for _, error in coarse.points("velocity")] == [1e-2, 1e-3, 1e-4]
    risen = measured_series(
        [1e-2, 1e-3, 7.0, 9.0]
    )  # finer steps that are far off again are not coarse
    assert [error for _, error in risen.points("velocity")] == [1e-2, 1e-3, 7.0, 9.0]
    assert slowdown_error(risen.points("velocity")) == 1e-3


def series_with_errors(errors, seconds=0.5, **kinds):
    """A series whose rows have their steps, with position `errors`, and other kinds by name."""
    measured = measured_series([])
    measured.rows = [
        StudyRow(
            "trade",
            "",
            "dynamics",
            "mujoco",
            "x",
            "timestep",
            size,
            {"timestep": size},
            {"position": e, **{k: v[n] for k, v in kinds.items()}},
            seconds=seconds,
        )
        for n, (size, e) in enumerate(zip(measured.series.sizes, errors, strict=False))
    ]
    return measured


@pytest.mark.parametrize(
    ("errors", "expected", "words"),
    [
        # first order, 8e-3 / 1e-4 = 80: a step of 25 ms / 80, and 80 times 0.5 s
        (
            (3.2e-2, 1.6e-2, 8e-3),
            1.0,
            "order 1 down to 8e-3 at timestep 25 ms; 1e-4 would need a step "
            "of about 3.1e-4 s and about 40 s a run, if that order holds",
        ),
        (
            (0.099, 0.09, 0.045),
            1.0,
            "not yet asymptotic: order 1 down to 0.045 at timestep 25 ms, of the last "
            "refinement alone; 1e-4 would need a step of about 5.6e-5 s and about 225 s a run, if "
            "that order holds",
        ),
        ((0.09, 0.045), 1.0, "not yet asymptotic: 0.045 at timestep 50 ms, and no order is seen"),
        ((0.09, 0.056), 1.0, "not yet asymptotic: 0.056 at timestep 50 ms, and no order is seen"),
        (
            (0.58, 0.5, 0.36),
            1.0,
            "not yet asymptotic: 0.36 at timestep 25 ms, and no order is seen",
        ),
        (
            (0.81, 0.8, 0.81),
            1.0,
            "not yet asymptotic: 0.81 at timestep 25 ms, and no order is seen",
        ),
        ((1e-4, 2.5e-5, 6.25e-6), 2.0, "order 2 down to 6.3e-6 at timestep 25 ms"),
        ((1e-4, 5e-5, 4.8e-5), 2.0, "no error floor is shown: 4.8e-5 at timestep 25 ms, why"),
        ((1e-4,), 2.0, ""),
    ],
)
def test_a_needed_step_is_stated_only_if_an_order_is_seen(errors, expected, words):
    assert format_reached(series_with_errors(errors), "position", expected, "why", "") == words


def test_a_constant_error_above_a_hundredth_is_not_called_a_floor():
    measured = series_with_errors([1e-3] * 3, acceleration=[0.13] * 3)
    assert format_reached(measured, "acceleration", 1.0, "", "it ends") == (
        "stays at 0.13 at timestep 25 ms; an error floor is claimed below 0.01 only; it ends"
    )
    far = series_with_errors([0.5] * 3, acceleration=[0.13] * 3)
    assert format_reached(far, "acceleration", 1.0, "", "").startswith("not yet asymptotic")


def test_a_worse_finer_step_is_described_with_both_errors():
    measured = series_with_errors([0.9, 1.9e-2, 6.8e-2, 4e-4])
    assert format_worsened(measured, "position") == (
        "finer is worse: 0.019 at timestep 50 ms, 0.068 at timestep 25 ms"
    )
    assert format_worsened(series_with_errors([0.5, 0.9, 1e-3]), "position") == ""


def test_the_reason_why_a_series_ended_is_stated():
    assert format_end(series_with_errors([1e-3, 1e-4], seconds=2.1), 2.0) == (
        "the series ends there, at a run of more than 2 s"
    )
    assert format_end(series_with_errors([1e-3, 1e-4]), 2.0) == ""
    assert (
        format_end(measured_series([1e-2], outcomes=["timed out"]), 2.0)
        == "timestep 0 ms: timed out"
    )


def test_a_slope_that_changes_is_no_order():
    slopes = 0.5 * np.arange(8)
    errors = 0.05 / 2 ** np.cumsum(slopes)
    assert np.isnan(observed_order(list(zip(0.1 / 2 ** np.arange(8), errors, strict=True))))
    assert np.isnan(observed_order(power_law_points(2.0, count=2))), (
        "one refinement shows no constant order"
    )


@pytest.mark.parametrize("name", ["fourbar", "pendulum", "rod_cantilever", "rfr2_driven"])
def test_series_go_from_coarse_to_fine_and_differ_in_one_parameter(name):
    case = load_case(shipped(f"{name}.toml"))
    found = list_series(
        case, next(k for k in ("dynamics", "equilibrium", "sweep") if k in case.run)
    )
    assert len({series.name for series in found}) == len(found)
    for series in found:
        assert np.all(np.diff(series.sizes) < 0), series.name
        for a, b in zip(series.settings, series.settings[1:], strict=False):
            changed = {k for k in a.parameters if a.parameters[k] != b.parameters[k]}
            assert changed <= {series.varied, "solref"}, series.name
            assert "solref" not in changed - {series.varied} or series.scaled


@pytest.mark.parametrize("name", ["pendulum", "fourbar"])
def test_every_integrator_of_mujoco_has_a_series_of_steps(name):
    import mujoco

    there = {name.removeprefix("mjINT_").lower() for name in mujoco.mjtIntegrator.__members__}
    listed = {
        str(series.settings[0].parameters.get("integrator", "that of the model")).lower()
        for series in list_series(load_case(shipped(f"{name}.toml")), "dynamics")
        if (series.engine, series.varied) == ("mujoco", "timestep")
    }
    assert listed == there | {"that of the model"}


def test_steps_are_halved_up_to_the_limit_of_force_evaluations():
    case = load_case(shipped("change_point.toml"))
    steps = describe_dynamics(case).timesteps(4)
    numbers = steps[0] / np.array(steps)
    assert np.array_equal(numbers, 2.0 ** np.arange(len(steps)))
    assert numbers[-1] * 362 * 4 <= MAX_FORCE_EVALUATIONS < 2.1 * numbers[-1] * 362 * 4


def test_a_rigid_sweep_has_no_convergence_series():
    assert list_series(load_case(shipped("fourbar.toml")), "sweep") == []


def test_sizes_of_solimp_and_bias_fall_with_stiffness():
    assert setting_size("mujoco", "solimp", (0.999, 0.9999, 0.001)) == pytest.approx(1e-3)
    assert setting_size("pymunk", "error_bias", np.exp(-1 / 0.25)) == pytest.approx(0.25)


PENDULUM = load_case(shipped("pendulum.toml"))
# Orders of positions and velocities.  Released from rest, semi-implicit Euler is a leapfrog method
# that is half a step early: position errors are of first order, velocity errors of second.
# Runge-Kutta is of fourth order, Chipmunk with bias 0 of second.  The error of its default bias
# falls with the step, so that Chipmunk with defaults is of first order.
ORDERS = {
    "MuJoCo Euler": (1, 2),
    "MuJoCo discrete": (1, 2),
    "MuJoCo RK4": (4, 4),
    "pymunk, no bias": (2, 2),
    "pymunk, defaults": (1, 1),
}


NEAR_FRONT = {1, 3}  # numbers of the settings that count as near the front


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory):
    """The trade study of the pendulum with a few series and settings, and its folder.

    The settings near the front are given, since otherwise they would depend on processor times.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            trade,
            "list_series",
            lambda case, kind: [
                replace(series, settings=series.settings[:5])
                for series in list_series(case, kind)
                if series.name in ORDERS
            ],
        )
        patch.setattr(trade, "find_near_front", lambda rows: [*NEAR_FRONT])
        folder = tmp_path_factory.mktemp("pendulum")
        study = trade.trade([PENDULUM], Study(Store(folder / "runs")), repeats=2)
        trade.write_study(study, folder)
    return study, folder


def test_defaults_and_settings_near_the_front_are_timed_again_and_no_others(pendulum):
    rows = pendulum[0].rows
    again = {k for k, row in enumerate(rows) if len(row.repeats) > 1}
    assert again == NEAR_FRONT.union(k for k, row in enumerate(rows) if is_default(row))
    assert again > NEAR_FRONT


@pytest.mark.parametrize("name", ORDERS)
def test_the_pendulum_shows_the_orders_of_the_integrators(pendulum, name):
    told = {v.kind: v for v in pendulum[0].verdicts if v.series == name}
    for kind, order in zip(("position", "velocity"), ORDERS[name], strict=True):
        assert told[kind].observed == pytest.approx(order, abs=ORDER_TOLERANCE)
        assert told[kind].expected == order
        assert told[kind].remark == ""


@pytest.mark.parametrize("name", ORDERS)
def test_all_samples_of_the_pendulum_show_the_orders_as_well(pendulum, name):
    rows = [row for row in pendulum[0].rows if row.series == name]
    for kind, order in zip(("position", "velocity"), ORDERS[name], strict=True):
        told = next(v for v in pendulum[0].verdicts if (v.series, v.kind) == (name, kind))
        assert orders_of_places(PENDULUM, told, rows)[-1] == pytest.approx(
            order, abs=ORDER_TOLERANCE
        )


def test_an_order_that_is_limited_by_the_reference_has_a_remark(tmp_path, edit, monkeypatch):
    """The closed form has a point mass, and this model a moment of inertia of 1e-11 kg m^2.

    The difference is a phase of 1e-10 after 10 s.  RK4 has errors of 2e-10 and 1e-11 at its two
    finest steps, 2.5 ms and 1.25 ms, so that the order falls off at the last one.
    """
    edit("pendulum.xml", '"1e-14 1e-14 1e-14"', '"1e-11 1e-11 1e-11"')
    monkeypatch.setattr(
        trade,
        "list_series",
        lambda case, kind: [
            series for series in list_series(case, kind) if series.name == "MuJoCo RK4"
        ],
    )
    monkeypatch.setattr(
        "proofmass.run.solve.MAX_FORCE_EVALUATIONS", 6e4
    )  # down to steps where it matters
    study = trade.trade(
        [load_case(tmp_path / "models" / "pendulum.toml")],
        Study(Store(tmp_path / "runs")),
        repeats=0,
    )
    told = next(v for v in study.verdicts if v.kind == "position")
    assert is_unexpected(told.observed, told.expected)
    assert told.remark.startswith("the reference: ")


def test_a_study_is_written_and_read_again(pendulum):
    study, folder = pendulum
    again = read_table(folder / "trade.csv")
    assert [row.errors for row in again] == [row.errors for row in study.rows]
    assert (folder / "floors.csv").exists() == bool(study.perturbed)
    told = trade.read_verdicts(folder / "verdicts.json")
    assert [repr(v) for v in told] == [repr(v) for v in study.verdicts]


@pytest.mark.parametrize("text", ["[{]", '[{"case": "x", "line": "x"}]', "[3]"])
def test_verdicts_of_another_version_are_bad_input(tmp_path, text):
    (tmp_path / "verdicts.json").write_text(text)
    with pytest.raises(InputError, match=r"verdicts\.json: not the verdicts that this version"):
        trade.read_verdicts(tmp_path / "verdicts.json")


def test_a_wrong_integrator_has_an_unexpected_order(pendulum):
    """The order of Euler's errors is unexpected if they are taken for those of RK4."""
    case = load_case(shipped("pendulum.toml"))
    fourth = next(series for series in list_series(case, "dynamics") if series.name == "MuJoCo RK4")
    rows = [row for row in pendulum[0].rows if row.series == "MuJoCo Euler"]
    seen = observed_order(MeasuredSeries(fourth, rows[: len(fourth.settings)]).points("position"))
    assert all(
        is_unexpected(seen, order)
        for order in expected_orders(case, "dynamics", fourth, "position")
    )


def test_failures_stay_in_the_table(tmp_path, monkeypatch):
    case = load_case(shipped("fourbar.toml"))
    series = ConvergenceSeries(
        "pymunk",
        "few",
        "iterations",
        tuple(Setting("pymunk", {"timestep": 1e-3, "iterations": n}) for n in (10, 30)),
    )
    monkeypatch.setattr(trade, "list_series", lambda *_: [series])
    study = trade.trade([case], Study(Store(tmp_path)), repeats=1)
    assert [row.outcome for row in study.rows] == ["diverged", "ran"]
    assert "loops are open" in study.rows[0].message
    assert trade.least_seconds(study.rows, "position", 1e-4) == study.rows[1].seconds


def test_a_run_that_a_case_lacks_is_bad_input():
    with pytest.raises(InputError, match="there is no such run; there are: dynamics"):
        trade.kind_to_study(load_case(shipped("pendulum.toml")), "equilibrium")


def run_trade(*args):
    """The result of the command `trade` with these arguments."""
    return CliRunner().invoke(app, ["trade", *map(str, args)])


@pytest.mark.usefixtures("undrawn")
def test_the_command_prints_a_table_and_reuses_stored_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(import_module("proofmass.run.solve"), "MAX_FORCE_EVALUATIONS", 3e3)
    monkeypatch.setattr(
        trade,
        "list_series",
        lambda case, kind: [series for series in list_series(case, kind) if series.name in ORDERS],
    )
    first = run_trade(shipped("pendulum.toml"), "-o", tmp_path, "--error", "velocity")
    assert first.exit_code == 0, first.output
    assert "MuJoCo RK4" in first.output
    assert "s for 1e-06" in first.output
    assert "a run is given up after 30 s (--longest)" in first.output
    files = {file: file.stat().st_mtime_ns for file in (tmp_path / "runs").glob("*.json")}
    before = (tmp_path / "trade.csv").read_text()
    assert run_trade(shipped("pendulum.toml"), "-o", tmp_path).exit_code == 0
    assert files == {f: f.stat().st_mtime_ns for f in (tmp_path / "runs").glob("*.json")}
    assert (tmp_path / "trade.csv").read_text() == before


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["nothing.toml"], "no such file"),
        ([shipped("pendulum.toml"), "--run", "sweep"], "no such run"),
        (
            [shipped("pendulum.toml"), "--longest", "0"],
            "--longest 0: give a number of seconds above 0",
        ),
    ],
)
def test_bad_input_gives_a_message_of_one_line(args, words, tmp_path):
    answer = run_trade(*args, "-o", tmp_path)
    assert answer.exit_code == 2
    assert words in answer.output
    assert len(answer.output.strip().splitlines()) == 1


def test_an_unknown_kind_of_run_is_reported_with_the_usage(tmp_path):
    answer = run_trade(shipped("pendulum.toml"), "--run", "motion", "-o", tmp_path)
    assert answer.exit_code == 2
    assert "Invalid value for '--run'" in answer.output
    assert "Traceback" not in answer.output


def test_a_model_without_a_sidecar_is_refused_or_skipped_in_a_folder(tmp_path, models):
    for file in models.iterdir():
        if file.stem not in ("pendulum", "fourbar"):
            file.unlink()
    (models / "pendulum.toml").unlink()
    words = "pendulum.xml: no sidecar says what is right, which a study needs; `proofmass new"
    alone = run_trade(models / "pendulum.xml", "-o", tmp_path / "trade")
    assert (alone.exit_code, words in alone.output) == (2, True)
    among = run_trade(models, "--run", "sweep", "-o", tmp_path / "trade")
    assert (among.exit_code, words in among.output) == (0, True)


def test_a_run_without_convergence_series_is_reported(tmp_path):
    answer = run_trade(shipped("fourbar.toml"), "--run", "sweep", "-o", tmp_path)
    assert answer.exit_code == 0
    assert "no convergence series in its sweep" in answer.output


@pytest.mark.usefixtures("undrawn")
def test_engines_that_a_command_asks_for_have_the_only_series(tmp_path, monkeypatch):
    """--engine replaces the engines of the sidecar."""
    monkeypatch.setattr(import_module("proofmass.run.solve"), "MAX_FORCE_EVALUATIONS", 1e3)
    answer = run_trade(shipped("pendulum.toml"), "-o", tmp_path, "--engine", "pymunk")
    assert answer.exit_code == 0, answer.output
    assert "pymunk" in answer.output
    assert "MuJoCo" not in answer.output
    wrong = run_trade(shipped("pendulum.toml"), "-o", tmp_path, "--engine", "pymunc")
    assert wrong.exit_code == 2
    assert "pymunk" in wrong.output
