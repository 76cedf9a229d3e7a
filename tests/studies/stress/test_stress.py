"""Limits of cases: bisection, changed models, silent failures, tables and commands."""

import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from proofmass.base.worker import TimedOut
from proofmass.commands.cli import app
from proofmass.reference.profiles import drive_profiles
from proofmass.sim.mjcf import compile_model
from proofmass.studies import variants
from proofmass.studies.measure import observe
from proofmass.studies.record import Setting
from proofmass.studies.store import Store
from proofmass.studies.stress.boundary import (
    Boundary,
    BoundaryKind,
    Failure,
    TrialResult,
    read_boundaries,
    write_boundaries,
)
from proofmass.studies.stress.extremes import (
    list_extremes,
    search_drive_speed,
    search_limit_position,
    search_size,
    try_drive_speed,
    try_size,
)
from proofmass.studies.stress.limit_search import LimitSearch, NotApplicable, StressedCase, bisect
from proofmass.studies.stress.page import stress_figure, write_stress
from proofmass.studies.stress.stress import find_boundaries, store_trials
from proofmass.studies.study import Study
from proofmass.studies.variants import with_longer_run


@pytest.mark.parametrize(("start", "reach", "edge"), [(0.1, 1e4, 37.0), (10.0, 1e-9, 2e-5)])
def test_a_boundary_is_between_its_sides(start, reach, edge):
    up = reach > start
    holds, breaks, failure = bisect(
        lambda x: Failure("gone", BoundaryKind.UNSTABLE, True) if (x > edge) is up else None,
        start,
        reach,
    )
    assert sorted([holds, edge, breaks])[1] == edge
    assert max(breaks / holds, holds / breaks) <= 1.01
    assert failure == ("gone", "unstable", True)


def test_a_search_may_fail_at_its_start_or_hold_to_its_end():
    never = LimitSearch(
        "", "", "", "", "", 1.0, 9.0, lambda x: TrialResult(Failure("no", BoundaryKind.UNSTABLE))
    ).find()
    assert np.isnan(never.measured)
    assert np.isnan(never.ratio)
    assert never.failure == "at 1 already: no"
    always = LimitSearch(
        "", "", "", "", "", 1.0, 9.0, lambda x: TrialResult(), theory=np.inf
    ).find()
    assert (always.holds, always.measured, always.ratio) == (9.0, np.inf, 1.0)
    assert np.isnan(replace(always, theory=2.0).ratio)
    assert (
        LimitSearch("", "", "", "", "", 1.0, 0.1, lambda x: TrialResult(), theory=0.0).find().ratio
        == 1.0
    )


@pytest.mark.parametrize("name", ["fivebar", "threeprr"])
def test_the_drive_speed_is_that_of_all_drives(stressed, name, monkeypatch):
    """A motion that is played three times as fast has three times the rate at each third of x.

    The tolerance is a few roundings of the values that `InProportion` multiplies.
    """
    tried = []
    monkeypatch.setattr(
        StressedCase, "try_in_steps", lambda self, case, seconds: tried.append((case, seconds))
    )
    base = stressed(name)
    try_drive_speed(base, 3.0)
    ((case, seconds),) = tried
    assert seconds == base.seconds / 3.0
    x = np.linspace(0.0, base.seconds, 7)
    pairs = zip(
        drive_profiles(base.case, "dynamics"), drive_profiles(case, "dynamics"), strict=True
    )
    for slow, fast in pairs:
        for k, (one, other) in enumerate(zip(slow(x), fast(x / 3.0), strict=True)):
            assert_allclose(other, 3.0**k * np.asarray(one), rtol=1e-14, atol=1e-14)


def test_no_drive_speed_is_searched_if_one_drive_has_its_own_profile(stressed):
    """A profile over time would stay at its speed while the first drive became faster."""
    base = stressed("fivebar")
    first, second = base.case.drive
    follower = second.model_copy(update={"to": None, "profile": "circle"})
    mixed = base.case.model_copy(update={"drive": (first, follower)})
    with pytest.raises(NotApplicable, match="motion profile"):
        list(search_drive_speed(replace(base, case=mixed)))


def test_a_reset_by_mujoco_is_found_by_its_warning(stressed):
    """MuJoCo resets a diverged state and goes on, so only its warning shows the failure."""
    case = stressed("pendulum").case
    failure = stressed("pendulum", integrator="Euler").find_failure(
        case, timestep=1e-3, tolerance=0.0
    )
    assert failure is None
    base = stressed("fourbar", integrator="RK4")
    run = base.case.run["dynamics"].model_copy(update={"n": 3})
    far = base.case.model_copy(update={"run": {"dynamics": run}})
    failure = base.find_failure(far, timestep=3.0)
    assert failure
    assert "MuJoCo warning" in failure.message
    assert not failure.silent


def test_an_open_loop_is_a_failure_though_all_values_are_finite(stressed):
    """A constraint impedance of 0.5 leaves half of the acceleration by gravity of the open loop."""
    failure = stressed("fourbar").find_failure(
        stressed("fourbar").case, solref=(50.0, 1.0), solimp=(0.5, 0.5)
    )
    assert failure
    assert "came open" in failure.message
    assert failure.silent


def test_a_finite_run_with_a_large_error_is_a_failure(stressed):
    """The step is 0.5 s for a pendulum with a period of about 2 s, which has no loop to open."""
    pendulum = stressed("pendulum", integrator="Euler")
    run = pendulum.case.run["dynamics"].model_copy(update={"n": 21})
    coarse = pendulum.case.model_copy(update={"run": {"dynamics": run}})
    failure = pendulum.find_failure(coarse, timestep=0.5)
    assert failure
    assert failure.message.startswith("position off by")
    assert failure.silent


@pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
@pytest.mark.parametrize("factor", [3e-6, pytest.param(1e6, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("slider_crank", "dynamics"),
        ("slider_crank", "sweep"),
        ("fourbar_released", "dynamics"),
        ("balancer_sine", "sweep"),
    ],
)
def test_scaled_mechanisms_have_scaled_curves(stressed, name, kind, engine, factor):
    """Lengths and gravity are scaled, masses are not: errors are those at the original size.

    The cases have hinges and a slide, a free motion, whose reference reads the scaled model itself,
    and springs.
    """
    base = stressed(name, engine, kind)
    run = base.case.run[kind]
    brief = {"n": 11, "until": run.until and run.until / 4}
    few = base.case.model_copy(update={"run": {kind: run.model_copy(update=brief)}})
    assert try_size(replace(base, case=few), 0.0, factor).failure is None


def test_a_centre_within_a_micrometre_of_its_hinge_loses_its_weight_moment(stressed):
    """Below 2e-6 of the size MuJoCo moves the crank's centre, 0.5 m from its hinge, to the hinge.

    The crank's weight then has no moment.  The error of the holding moment is less than a tenth of
    its range, and is found by comparison with the run at the original size.
    """
    base = stressed("fourbar", "mujoco", "sweep")
    few = base.case.run["sweep"].model_copy(update={"n": 11})
    base = replace(base, case=base.case.model_copy(update={"run": {"sweep": few}}))
    smaller = next(s for s in search_size(base) if s.reach < 1)
    assert smaller.theory == pytest.approx(2e-6)
    assert smaller.trial(2.1e-6).failure is None
    failure = smaller.trial(1.9e-6).failure
    assert failure
    assert failure.message.startswith("force or torque off by 0.0")
    assert failure.limit == BoundaryKind.INACCURATE
    assert failure.silent


def test_a_size_that_mujoco_cannot_compile_is_no_limit_of_pymunk(stressed):
    """MuJoCo reads the model for both engines, so pymunk is not run at that size."""
    base = stressed("pendulum", "pymunk")
    smaller = next(s for s in search_size(base) if s.reach < 1)
    assert np.isnan(smaller.theory)
    found = smaller.find()
    assert (found.limit, found.found, found.silent) == (BoundaryKind.OURS, False, False)
    assert 10**-0.5 <= found.holds <= 1.1 * 10**-0.5
    assert np.isnan(found.measured)
    assert "MuJoCo, which reads the model for pymunk" in found.failure


def test_a_scaling_that_leaves_something_out_fails(stressed):
    """With scaled lengths and the original gravity the pendulum has another period.

    With scaled lengths and the original channels the pin of the slider-crank, but no angle of the
    pendulum, has an error.
    """
    base = stressed("pendulum")
    larger = variants.with_scaled_lengths(base.case, base.models, 4.0)
    assert base.find_failure(larger) is None
    forgotten = variants.with_model(
        larger,
        base.models,
        lambda root: variants.set_gravity(root, compile_model(larger.model_path), 0.25),
    )
    assert base.find_failure(forgotten)
    assert base.find_failure(larger.model_copy(update={"channels": base.case.channels})) is None
    crank = stressed("slider_crank")
    larger = variants.with_scaled_lengths(crank.case, crank.models, 4.0)
    assert crank.find_failure(larger.model_copy(update={"channels": crank.case.channels}))


@pytest.mark.parametrize(("engine", "factor"), [("mujoco", 1e6), ("pymunk", 1e-6)])
def test_stronger_springs_need_proportional_moments(stressed, engine, factor):
    base = stressed("balancer_sine", engine, "sweep")
    few = base.case.model_copy(
        update={"run": {"sweep": base.case.run["sweep"].model_copy(update={"n": 10})}}
    )
    assert base.find_failure(variants.with_scaled_stiffness(few, base.models, factor)) is None
    wrong = variants.with_scaled_stiffness(few, base.models, factor).model_copy(
        update={"channels": few.channels}
    )
    assert base.find_failure(wrong).message.startswith("force or torque off by")


def test_the_least_inertia_bounds_the_size(stressed):
    """The inertia of 1e-14 kg m2 times s^2 reaches MuJoCo's least, 1e-15, at s = 0.316."""
    search, skipped = list_extremes(stressed("pendulum").case, stressed("pendulum").study)
    smaller = next(
        s for s in search if s.parameter == "all lengths smaller" and s.engine == "mujoco"
    )
    assert smaller.theory == pytest.approx(10**-0.5)
    found = smaller.find()
    assert found.ratio == pytest.approx(1.0, abs=0.01)
    assert (found.limit, found.silent) == (BoundaryKind.REFUSED, False)
    assert "mjMINVAL" in found.failure
    assert "stiffness: there are no springs and no rods" in skipped
    assert {s.parameter for s in search} == {
        "time step",
        "stable time step",
        "gravity",
        "spring in pivot",
        "all lengths larger",
        "all lengths smaller",
        "steps",
        "steps until the energy is off by 1 %",
    }


@pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
def test_limit_positions_come_from_the_reference(stressed, engine):
    """The four-bar 2, 2, 2.5, 3 starts at -2 rad; its limit is arccos((4 + 9 - 4.5^2) / 12)."""
    base = stressed("triple_rocker", engine)
    case = base.case.model_copy(
        update={"run": {"sweep": base.case.run["sweep"].model_copy(update={"n": 41})}}
    )
    limit_search = next(search_limit_position(replace(base, case=case)))
    assert limit_search.parameter == "drive's way"
    assert limit_search.theory == pytest.approx(2.0 + np.arccos(-7.25 / 12), rel=1e-5)
    assert limit_search.trial(0.99 * limit_search.theory).failure is None
    assert limit_search.trial(1.01 * limit_search.theory).failure


@pytest.mark.slow
def test_a_wrong_length_moves_the_limit_position(stressed):
    """A rocker that is 2 % longer lets the crank turn 1 % further.

    The errors of angles and moments are too large before that limit position.
    """
    base = stressed("triple_rocker")

    def change(root):
        next(s for s in root.iter("site") if s.get("name") == "rocker_end").set("pos", "2.55 0 0")

    case = base.case.model_copy(
        update={"run": {"sweep": base.case.run["sweep"].model_copy(update={"n": 41})}}
    )
    wrong = variants.with_model(case, base.models, change)
    search = next(s for s in list_extremes(wrong, base.study)[0] if s.parameter == "drive's way")
    found = search.find()
    assert found.ratio < 0.99
    assert "off by" in found.failure


def test_threads_that_change_a_model_alike_share_one_file(stressed):
    """Eight threads write the same changed model at once, and no file of a thread disappears."""
    base = stressed("fourbar")
    for factor in np.linspace(2.0, 3.0, 20).tolist():
        change = partial(variants.with_scaled_last_mass, base.case, base.models)
        with ThreadPoolExecutor(8) as threads:
            assert len({case.model for case in threads.map(change, [factor] * 8)}) == 1


def test_a_longer_run_turns_further_or_moves_back_and_forth(stressed):
    turned = with_longer_run(stressed("fourbar").case, 3.0, 2 * np.pi)
    assert turned.drive[0].to == pytest.approx(6 * np.pi)
    assert turned.drive[0].rate == 1.0
    both = with_longer_run(stressed("fivebar").case, 3.0, 2 * np.pi)  # the drives keep their ratio
    assert [drive.to for drive in both.drive] == pytest.approx([6 * np.pi, 12 * np.pi])
    slid = with_longer_run(stressed("threeprr").case, 3.0, 1.0)
    assert (slid.drive[0].to, slid.drive[0].period) == (stressed("threeprr").case.drive[0].to, 2.0)
    assert slid.run["dynamics"].until == 3.0


def test_the_first_solver_of_an_engine_gives_the_setting(stressed, monkeypatch):
    """For the rod that snaps it is mujoco:settled, which falls where the plain sweep ends."""
    base, stands = stressed("rod_snap", kind="sweep"), []
    monkeypatch.setattr(
        "proofmass.studies.stress.extremes.SEARCHES", (lambda one: stands.append(one) or (),)
    )
    list_extremes(base.case, base.study)
    assert [one.setting for one in stands] == [
        Setting("mujoco", {"settled": True}),
        Setting("pymunk", {}),
    ]


def test_a_slow_reference_is_not_a_failure_of_the_engine(stressed, monkeypatch):
    base, words = stressed("pendulum"), "no answer in 60 s"

    def late(function, *arguments, **_):
        if function is observe:
            raise TimedOut(words)
        return function(*arguments)

    monkeypatch.setattr("proofmass.studies.measure.call_isolated", late)
    failure = base.find_failure(base.case)
    assert failure.message == f"no reference: {words}; the engine has its run"

    def never(function, *arguments, **_):
        raise TimedOut(words)

    monkeypatch.setattr("proofmass.studies.measure.call_isolated", never)
    failure = base.find_failure(base.case, timestep=2e-3)
    assert failure.message == f"timed out: {words}"


def test_trials_are_made_once(tmp_path):
    tried = []

    def trial(x):
        tried.append(x)
        return TrialResult(
            Failure("beyond", BoundaryKind.UNSTABLE, True) if x > 3.0 else None, x / 2
        )

    search = LimitSearch("spring", "mujoco", "Euler", "step", "s", 1.0, 100.0, trial, theory=3.0)
    study = Study(Store(tmp_path))
    first = find_boundaries([store_trials(search, study.store)], study)
    assert first[0].step == first[0].holds / 2
    count = len(tried)
    assert find_boundaries([store_trials(search, study.store)], study) == first
    assert len(tried) == count > 5
    with study.working() as working:
        find_boundaries([store_trials(replace(search, parameter="other"), study.store)], working)
    assert len(tried) == 2 * count


def test_the_table_is_complete_and_the_page_is_made_from_it(tmp_path):
    rows = [
        Boundary(
            'spring, "soft"',
            "mujoco",
            "Euler",
            "dt ω",
            "1",
            0.1,
            10.0,
            1.99,
            2.005,
            step=1.99,
            theory=2.0,
            law="2 √(1 + ζ²)",
            limit=BoundaryKind.UNSTABLE,
            failure="grew, without a word",
            silent=True,
        ),
        Boundary(
            "spring, hard",
            "mujoco",
            "discrete",
            "dt ω",
            "1",
            0.1,
            10.0,
            10.0,
            theory=np.inf,
            law="implicit",
        ),
        Boundary(
            "fourbar",
            "pymunk",
            "as in the model",
            "gravity",
            "times",
            1.0,
            1e6,
            limit=BoundaryKind.INACCURATE,
            failure="at 1 already: no",
        ),
        Boundary(
            "fourbar",
            "pymunk",
            "as in the model",
            "size",
            "times",
            1.0,
            1e-6,
            0.1,
            0.099,
            limit=BoundaryKind.REFUSED,
            failure="refused: too small",
        ),
        Boundary(
            "fourbar",
            "pymunk",
            "as in the model",
            "steps",
            "1",
            100.0,
            1e6,
            1000.0,
            1009.0,
            1e-3,
            limit=BoundaryKind.OURS,
            failure="no reference: none in 60 s; the engine has its run",
        ),
    ]
    write_boundaries(rows, tmp_path / "stress.csv")
    assert repr(read_boundaries(tmp_path / "stress.csv")) == repr(rows)
    page = write_stress(tmp_path, tmp_path).first.read_text(encoding="utf-8")
    table = (tmp_path / "stress.columns.md").read_text(encoding="utf-8")
    assert "2 of 2 boundaries that theory knows were measured within 2%" in page
    assert "1 of 1 boundaries are passed in silence" in page
    assert "unstable, <strong>in silence</strong>: grew, without a word" in page
    assert "not known beyond 1000" in page
    for limit in BoundaryKind:
        assert f"{limit}: {limit.sentence}" in table
        assert f"{limit}: {limit.sentence}" in page.replace("&#39;", "'")
    assert "fourbar" in page
    assert [row.found for row in rows] == [True, False, False, True, False]
    assert [row.unknown for row in rows] == [False, False, False, False, True]
    drawing = (tmp_path / "figures" / "fourbar-stress.svg").read_text(encoding="utf-8")
    grounds = re.findall(
        r'<pattern.*?<rect[^>]* fill="(#\w+)".*?stroke: (#\w+)', drawing, re.DOTALL
    )
    assert grounds  # of bars and the legend; each has another colour than the lines on it
    assert all(ground != lines for ground, lines in grounds)
    for some, here in ((rows[:2], False), (rows[2:], True)):
        told = [text.get_text() for text in stress_figure(some).legends[0].get_texts()]
        assert ("not known beyond" in told) == here
    assert (tmp_path / "figures" / "fourbar-stress.png").stat().st_size > 5000


@pytest.mark.parametrize("theory", [np.nan, 2.0])
def test_a_page_of_rows_that_all_fail_from_the_start(tmp_path, theory: float):
    """The figure has no bar, but its scales are those of the first values."""
    failing = Boundary("arm", "pymunk", "as in the model", "size", "times", 2.0, 9.0, theory=theory)
    write_boundaries([failing], tmp_path / "stress.csv")
    page = write_stress(tmp_path, tmp_path).first.read_text(encoding="utf-8")
    assert "arm" in page
    axes = stress_figure([failing]).axes[0]
    assert [text.get_text() for text in axes.texts].count("failed from the start") == 1
    left, right = axes.get_xlim()
    assert 0 < left < right


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.toml"], "nowhere.toml: no such file"),
        (["fourbar.xml"], "neither"),
        (["--only", "colour"], "--only colour: no such parameter"),
    ],
)
def test_bad_input_gives_a_message_of_one_line(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fourbar.txt").write_text("")
    arguments = ["fourbar.txt" if a == "fourbar.xml" else a for a in arguments]
    result = CliRunner().invoke(app, ["stress", *arguments])
    assert result.exit_code == 2
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert words in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


@pytest.mark.usefixtures("undrawn")
def test_command_writes_its_limits_and_can_be_repeated(tmp_path, monkeypatch):
    """The second time each trial is read from the file of the first time, and none is made."""
    monkeypatch.chdir(tmp_path)
    files = []
    for _ in range(2):
        result = CliRunner().invoke(app, ["stress", "--only", "crank", "-o", "out"])
        runs = (tmp_path / "out" / "runs").rglob("*.json")
        files.append({file: file.stat().st_mtime_ns for file in runs})
        assert result.exit_code == 0, result.output
        assert "law" in (tmp_path / "out" / "stress.columns.md").read_text(encoding="utf-8")
    assert [round(b.ratio, 1) for b in read_boundaries(tmp_path / "out" / "stress.csv")] == [1, 1]
    assert len(files[0]) > 2  # a bisection has more trials
    assert files[1] == files[0]
