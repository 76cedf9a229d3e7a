"""Choosing the cheapest good enough setting: its check, comparison with defaults, snippets."""

import tomllib
from collections.abc import Callable
from dataclasses import replace
from math import inf, nan
from pathlib import Path

import mujoco
import numpy as np
import pymunk
import pytest
from typer.testing import CliRunner

from proofmass.analytic.linkages import pendulum
from proofmass.base.worker import TimedOut
from proofmass.case.case import Case
from proofmass.commands.choose import find_solver
from proofmass.commands.cli import app
from proofmass.reference.case_model import compiled_model
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.mujoco.settings import configure
from proofmass.sim.mujoco.snippet import insert_snippet
from proofmass.sim.protocol.failures import Diverged, Unsupported
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade import verify as verify_module
from proofmass.studies.trade.choose import (
    ERROR_MARGIN,
    NoGoodSetting,
    choose,
    compare_with_defaults,
    describe_choice,
    explain_no_choice,
    find_floor,
    format_snippet,
    good_settings,
    is_default,
)
from proofmass.studies.trade.program import snippet
from proofmass.studies.trade.search import search
from proofmass.studies.trade.series import Limits
from proofmass.studies.trade.varied import list_series
from proofmass.studies.trade.verdict import Verdict
from proofmass.studies.trade.verify import (
    SAMPLE_SHIFT,
    Check,
    rerun_setting,
    run_fresh,
    run_shifted,
    shifted_error,
    state_at,
    verify,
)
from tests.shipped import shipped
from tests.studies.trade.trade_rows import example_study, series_rows, series_verdicts


@pytest.fixture
def fourbar() -> Case:
    return load_case(shipped("fourbar.toml"))


def confirm_measured_error(case: Case, kind: str, row: StudyRow, of: str, wanted: float) -> Check:
    """A check whose two runs have the measured error again."""
    return Check(row.errors[of], row.errors[of], "", Setting(row.engine, row.parameters))


def choose_in_dynamics(
    case: Case, rows: list[StudyRow], wanted: float, *kind: str, **asked: object
):
    """The choice for dynamics, by default with checks that confirm the measured errors."""
    return choose(
        case, "dynamics", rows, wanted, *kind, **{"verify": confirm_measured_error, **asked}
    )


def test_the_cheapest_good_enough_setting_is_chosen(fourbar: Case) -> None:
    """With error 100 h^2 and margin 2 the largest step with 2 * 100 h^2 <= 1e-4 is 0.5 ms."""
    rows = [*series_rows("slow", cost=1e-4), *series_rows("quick"), *series_rows("poor", order=1.0)]
    found = choose_in_dynamics(fourbar, rows, 1e-4)
    assert (found.row.series, found.row.value) == ("quick", 0.0005)
    assert ERROR_MARGIN * found.row.errors["position"] <= 1e-4 < ERROR_MARGIN * 100 * 0.001**2


@pytest.mark.parametrize(
    "changed",
    [
        {"errors": {"position": 1.0001e-4 / ERROR_MARGIN}},
        {"errors": {"position": nan}},
        {"errors": {}},
        {"errors": {"position": inf}},
        {"outcome": "diverged"},
        {"seconds": nan},
    ],
)
def test_a_setting_that_is_not_good_enough_is_not_chosen(fourbar: Case, changed: dict) -> None:
    rows = [replace(row, **changed) if row.value == 0.0005 else row for row in series_rows("quick")]
    assert choose_in_dynamics(fourbar, rows, 1e-4).row.value == 0.00025


@pytest.mark.parametrize("errors", [(2e-4, 1e-6), (1e-6, 2e-4), (nan, 1e-6), (1e-6, nan)])
def test_a_setting_that_fails_its_check_is_passed_over(fourbar: Case, errors: tuple) -> None:
    def lucky(case: Case, kind: str, row: StudyRow, of: str, wanted: float) -> Check:
        check = confirm_measured_error(case, kind, row, of, wanted)
        return replace(check, fresh=errors[0], shifted=errors[1]) if row.value == 0.0005 else check

    found = choose_in_dynamics(fourbar, series_rows("quick"), 1e-4, verify=lucky)
    assert found.row.value == 0.00025
    assert len(found.refused) == 1
    assert found.refused[0].startswith("quick, timestep 0.5 ms")


def test_only_the_given_engine_and_kind_of_error_count(fourbar: Case) -> None:
    rows, verdicts = example_study()
    both = {
        e: choose_in_dynamics(fourbar, rows, 1e-6, engine=e, verdicts=verdicts).row.engine
        for e in ("mujoco", "pymunk")
    }
    assert both == {"mujoco": "mujoco", "pymunk": "pymunk"}
    steps = [
        choose_in_dynamics(fourbar, series_rows("quick"), 1e-3, of).row.value
        for of in ("position", "velocity", "acceleration")
    ]
    # errors are 1, 10 and 100 times as large; the steps of a series go down by factors of two
    assert steps == [0.002, 0.0005, 0.000125]


def test_the_choice_is_compared_with_the_defaults(fourbar: Case) -> None:
    """Defaults with error 0.05 h are good enough at 1 ms, the tuned series, 100 h^2, at 0.5 ms.

    The margin is 2, so errors up to 5e-5 are good enough.  A step of the tuned series takes a tenth
    of the time, so twice as many of them are 5 times cheaper.
    """
    plain = series_rows("plain", order=1.0, scale=0.05, defaults=True, integrator="Euler")
    tuned = series_rows("tuned", cost=1e-6)
    assert all(map(is_default, plain))
    assert not any(map(is_default, tuned))
    found = choose_in_dynamics(fourbar, [*plain, *tuned], 1e-4)
    assert found.row.series == "tuned"
    assert found.ratio == pytest.approx(5.0, rel=0.01)
    alone = choose_in_dynamics(fourbar, plain, 1e-4)
    assert (alone.ratio, alone.defaults) == (1.0, "these are the engine's defaults, refined")


@pytest.mark.parametrize(("order", "scale"), [(1.0, 0.1), (2.0, 1600.0)])
def test_the_cost_of_coarse_defaults_is_extrapolated_by_their_order(
    fourbar: Case, order: float, scale: float
) -> None:
    """The finest defaults have error 6.25e-6 at 1/16 ms, and 1e-6 with margin 2 needs 5e-7.

    So the error must fall by 12.5: 12.5 times as many steps of first order, the root of that of
    second order.
    """
    plain = series_rows("plain", order=order, scale=scale, defaults=True)
    assert plain[-1].errors["position"] == pytest.approx(6.25e-6)
    tuned = series_rows("tuned", cost=1e-6)
    found = choose_in_dynamics(fourbar, [*plain, *tuned], 1e-6)
    cost = 12.5 ** (1 / order) * plain[-1].seconds
    assert found.ratio == pytest.approx(cost / found.row.seconds)
    assert np.isnan(
        choose_in_dynamics(fourbar, [plain[-1], *tuned], 1e-6).ratio
    )  # one row shows no order
    risen = [replace(plain[-2], errors={"position": 1e-6}), plain[-1]]
    assert np.isnan(choose_in_dynamics(fourbar, [plain[-1], *risen, *tuned], 1e-6).ratio)


def test_the_floor_of_another_series_is_no_floor_of_the_defaults(fourbar: Case) -> None:
    """The error of the finest defaults equals the floor of another series, but still falls."""
    plain = series_rows("plain", order=1.0, scale=0.1, defaults=True)
    level = plain[-1].errors["position"]
    others = series_verdicts("other", 2.0, level, "iterations")
    found = choose_in_dynamics(
        fourbar, [*plain, *series_rows("tuned", cost=1e-6)], 1e-6, verdicts=others
    )
    assert "never" not in found.defaults
    assert found.ratio > 1
    own = series_verdicts("plain", 1.0, level, "iterations")
    assert (
        "never get there"
        in choose_in_dynamics(
            fourbar, [*plain, *series_rows("tuned", cost=1e-6)], 1e-6, verdicts=own
        ).defaults
    )


def test_defaults_that_fail_their_check_are_not_compared_with(fourbar: Case) -> None:
    """The defaults at 1 ms fail their check, so those at 0.5 ms or 0.25 ms are compared with."""
    plain = series_rows("plain", order=1.0, scale=0.05, defaults=True, cost=1e-6)
    tuned = series_rows("tuned", cost=1.5e-6)

    def lucky(case: Case, kind: str, row: StudyRow, of: str, wanted: float) -> Check:
        check = confirm_measured_error(case, kind, row, of, wanted)
        return replace(check, shifted=1.0) if (row.series, row.value) == ("plain", 0.001) else check

    found = choose_in_dynamics(fourbar, [*plain, *tuned], 1e-4, verify=lucky)
    assert (found.row.series, found.row.value, found.ratio) == ("plain", 0.0005, 1.0)
    dear = [replace(row, seconds=5 * row.seconds) if row.value == 0.0005 else row for row in plain]
    found = choose_in_dynamics(fourbar, [*dear, *tuned], 1e-4, verify=lucky)
    assert found.row.series == "tuned"
    assert found.ratio == pytest.approx(dear[6].seconds / found.row.seconds)


def test_the_error_floor_or_the_needed_step_is_named(fourbar: Case) -> None:
    rows, verdicts = example_study()
    mine = [row for row in rows if row.engine == "mujoco"]
    found = choose_in_dynamics(fourbar, mine, 1e-4, verdicts=verdicts)
    assert (
        "defaults never get there: the error floor is 2e-4, softness of the loop" in found.defaults
    )
    assert found.ratio == inf
    with pytest.raises(
        NoGoodSetting,
        match=r"the best, MuJoCo RK4, solref 8 dt.* the error floor is "
        r"3e-8, cap of solimp; halving solref divides the error by 4.0",
    ):
        choose_in_dynamics(fourbar, mine, 1e-9, verdicts=verdicts)
    # error 100 h^2 in 6.28e-5 / h seconds: 0.8 * 5e-10 needs h = 2e-6 s and 31 s
    needs = "quick would need a step of about 2e-6 s and about 31 s a run, if its order 2 holds; "
    with pytest.raises(NoGoodSetting, match=needs + "proofmass choose measures finer steps"):
        choose_in_dynamics(fourbar, series_rows("quick"), 1e-9)
    with pytest.raises(NoGoodSetting, match=needs + "--longest is 30 s$"):
        choose_in_dynamics(fourbar, series_rows("quick"), 1e-9, limits=Limits(longest=30.0))
    with pytest.raises(
        NoGoodSetting, match=needs + "--longest is 33 s$"
    ):  # expected processor times have errors of a tenth
        choose_in_dynamics(fourbar, series_rows("quick"), 1e-9, limits=Limits(longest=33.0))
    with pytest.raises(NoGoodSetting, match=needs + "of --budget 60 s, 50 s are spent$"):
        choose_in_dynamics(
            fourbar, series_rows("quick"), 1e-9, limits=Limits(40.0, 60.0, 50.0, 1, short=True)
        )
    failed = [replace(row, outcome="diverged", message="open by 1 m", errors={}) for row in mine]
    with pytest.raises(
        NoGoodSetting,
        match=r"^no setting ran, of \d+: \d+ diverged; the first, "
        r"[^;]*: diverged: open by 1 m$",
    ):
        choose_in_dynamics(fourbar, failed, 1e-3)


def test_many_failures_are_summarized_in_two_sentences(fourbar: Case) -> None:
    """Each setting fails with another message, such as the time at which it failed.

    Only the counts of outcomes and the message of the first setting are stated.
    """
    failed = [
        replace(row, outcome=outcome, message=f"failed at {k} s", errors={})
        for k, (row, outcome) in enumerate(
            zip(series_rows("quick"), ["diverged"] * 4 + ["timed out"] * 99, strict=False)
        )
    ]
    with pytest.raises(NoGoodSetting) as why:
        choose_in_dynamics(fourbar, failed, 1e-3)
    first, second = str(why.value).split("; ")
    assert first == f"no setting ran, of {len(failed)}: " + ", ".join(
        f"{n} {word}"
        for n, word in sorted([(4, "diverged"), (len(failed) - 4, "timed out")], reverse=True)
    )
    assert second == "the first, quick, timestep 16 ms: diverged: failed at 0 s"
    other = [replace(row, errors={"velocity": 1.0}) for row in series_rows("quick")]
    with pytest.raises(NoGoodSetting, match="ran without position errors"):
        choose_in_dynamics(fourbar, other, 1e-3)
    with pytest.raises(NoGoodSetting, match="no setting was measured"):
        choose_in_dynamics(fourbar, [], 1e-3)


@pytest.mark.parametrize("name", ["fourbar", "hacksaw", "pendulum", "slider_crank_inclined"])
def test_the_own_settings_of_a_model_are_tried(name: str) -> None:
    """Each solver of the run except defaults, with the settings with which `check` runs it."""
    case = load_case(shipped(f"{name}.toml"))
    step = compiled_model(case).opt.timestep
    tried = [
        (s.engine, s.parameters)
        for series in list_series(case, "dynamics")
        for s in series.settings
    ]
    for solver in case.run["dynamics"].solvers:
        engine, _, variant = solver.partition(":")
        if variant != "default":
            own = {
                name: tuple(value) if isinstance(value, list) else value
                for name, value in plan_run(case, "dynamics", solver).settings.items()
            }
            assert (engine, {"timestep": step, **own}) in tried


@pytest.fixture
def stiff(models: Path, edit: Callable[..., Path]) -> Path:
    """A slider-crank with a slider of 1e-7 kg, whose loop has to be stiff to move the slider.

    The time constant of the pin acts on the combined mass of both sides, which is nearly that of
    the slider, and gravity pulls the coupler with 10 N.  The model's own settings are Euler with
    steps of 0.1 ms and a time constant of 0.2 ms.
    """
    edit("slider_crank.xml", 'mass="1.5"', 'mass="1e-7"')
    edit("slider_crank.xml", 'diaginertia="0.01 0.01 0.01"', 'diaginertia="1e-9 1e-9 1e-9"')
    edit("slider_crank.xml", "1e-3", "1e-4")
    edit("slider_crank.xml", "RK4", "Euler")
    edit("slider_crank.xml", 'solref="0.005 1"', 'solref="0.0002 1"')
    edit("slider_crank.toml", r"slider_mass = 1\.5", "slider_mass = 1e-7")
    edit("slider_crank.toml", r'"mujoco", "mujoco:default", "pymunk", "pymunk:default"', '"mujoco"')
    return edit(
        "slider_crank.toml",
        r"(?s)\[\[tolerance\]\].*",
        '[[tolerance]]\nrelative_to_range = 1e-3\nwhy = "other steps fail"\n',
    )


@pytest.mark.slow
def test_the_own_settings_of_a_stiff_model_are_chosen(stiff: Path) -> None:
    """More than ten series of other settings fail on this model."""
    folder = stiff.parent / "trade"
    rows = search(load_case(stiff), "position", 5e-3, Study(Store(folder / "runs")), repeats=0)
    assert "MuJoCo, as in the model" in {row.series for row in rows if row.outcome == "ran"}
    assert len({row.series for row in rows if row.outcome != "ran"}) > 10
    found = CliRunner().invoke(
        app, ["choose", str(stiff), "--error", "1e-2", "--store", str(folder)]
    )
    assert found.exit_code == 0, found.output


SNIPPET_PARAMETERS = [
    {
        "timestep": 1e-3 / 3,
        "integrator": "EULER",
        "solver": "cg",
        "iterations": 7,
        "tolerance": 0.0,
    },
    {"solref": (0.02 / 3, 1.0), "solimp": (0.9999, 0.9999, 0.001)},
    {"solref": (0.03,)},
    {"solimp": (0.99, 0.999)},
    {"integrator": "discrete"},
    {"defaults": True},
    {"defaults": True, "timestep": 1e-5},
]


@pytest.mark.parametrize("parameters", SNIPPET_PARAMETERS)
@pytest.mark.parametrize(
    "own",
    [
        "",
        ' solref="0.5 2"',
        ' class="soft"',
        ' class="soft" solref="0.5 2" solimp="0.8 0.9 0.002 0.4 3"',
    ],
)
def test_a_pasted_snippet_gives_the_options_of_the_setting(
    parameters: dict, own: str, tmp_path: Path
) -> None:
    """The compiled options are, to the last bit, those that `configure` writes."""
    file = tmp_path / "fourbar.xml"
    text = shipped("fourbar.xml").read_text().replace('<connect name="pin"', "<connect" + own)
    soft = (
        '<default><default class="soft"><equality solref="0.3 3" solimp="0.7 0.8 0.003"/>'
        "</default></default><worldbody>"
    )
    file.write_text(text.replace("<worldbody>", soft, 1))
    lines = snippet(Setting("mujoco", parameters), 0, file)
    merged = mujoco.MjModel.from_xml_string(insert_snippet(file, lines))
    wanted = mujoco.MjModel.from_xml_path(str(file))
    configure(wanted, {k: v for k, v in parameters.items() if k != "solver"})
    if "solver" in parameters:
        wanted.opt.solver = mujoco.mjtSolver.mjSOL_CG
    for name in ("timestep", "integrator", "solver", "iterations", "tolerance", "jacobian"):
        assert getattr(merged.opt, name) == getattr(wanted.opt, name), name
    assert np.array_equal(merged.eq_solref, wanted.eq_solref)
    assert np.array_equal(merged.eq_solimp, wanted.eq_solimp)
    wins = "class" in own or {"solref", "defaults"} & set(parameters)
    softens = {"solref", "solimp", "defaults"} & set(parameters)
    assert ("in itself" in lines) == bool(own and wins and softens)


def test_the_snippet_for_pymunk_steps_a_space() -> None:
    space = pymunk.Space()
    body = pymunk.Body(1.0, 1.0)
    pin = pymunk.PivotJoint(body, space.static_body, (0.0, 0.0))
    space.add(body, pin)
    parameters = {"timestep": 0.25, "iterations": 37, "error_bias": 0.5}
    exec(snippet(Setting("pymunk", parameters), 9), {"space": space})
    assert (space.iterations, pin.error_bias, space.current_time_step) == (37, 0.5, 0.25)
    body.velocity = 1.0, 0.0
    free = pymunk.Space()
    loose = pymunk.Body(1.0, 1.0)
    loose.velocity = 1.0, 0.0
    free.add(loose)
    exec(snippet(Setting("pymunk", parameters), 9), {"space": free})
    assert loose.position.x == pytest.approx(9 * 0.25)  # the number of steps that was asked for


def test_the_snippet_says_that_segments_belong_in_the_sidecar() -> None:
    for engine in ("mujoco", "pymunk"):
        text = snippet(Setting(engine, {"segments": 40}), 1)
        assert "every rod of the sidecar: segments = 40" in text
        assert text.startswith(("#", "<!--"))


def test_a_setting_for_which_an_engine_has_no_form_is_a_whole_table_of_the_sidecar() -> None:
    """pymunk's lines need the iterations and the bias; every parameter is there, as TOML."""
    parameters = {"defaults": True, "timestep": 5e-05, "word": 'a "b" ä', "pair": (0.02, 1.0)}
    text = snippet(Setting("pymunk", {**parameters, "segments": 8}), 9)
    assert "\n# every rod of the sidecar: segments = 8\n" in text
    assert tomllib.loads(text) == {"settings": {"pymunk": {**parameters, "pair": [0.02, 1.0]}}}


def test_a_shifted_start_of_a_free_motion_is_on_the_same_motion() -> None:
    """The start of a shifted run is the state of the closed form at that time."""
    case = load_case(shipped("pendulum.toml"))
    angle, rate = state_at(case, 0.3)
    truth = pendulum.solve(0.3, length=1.0, mass=1.0, gravity=9.81, amplitude=-np.pi / 2)
    # the start is computed by the general solver, with errors of 3e-14 a step
    assert angle == pytest.approx(truth["angle"], abs=1e-12)
    assert rate == pytest.approx(truth["rate"], abs=1e-12)


@pytest.mark.parametrize(
    "name", ["fourbar", "pendulum", pytest.param("fourbar_released", marks=pytest.mark.slow)]
)
def test_a_shifted_run_is_as_accurate_at_other_samples(name: str) -> None:
    case = load_case(shipped(f"{name}.toml"))
    case = case.model_copy(
        update={
            "run": {
                "dynamics": case.run["dynamics"].model_copy(
                    update={"n": 101, "until": None if case.drive else 1.0}
                )
            }
        }
    )
    row = StudyRow(
        "trade",
        name,
        "dynamics",
        "mujoco",
        "",
        "timestep",
        2e-3,
        {"timestep": 2e-3, "integrator": "RK4"},
    )
    curves = run_shifted(case, "dynamics", Setting("mujoco", row.parameters))
    whole, _ = run_fresh(case, "dynamics", Setting("mujoco", row.parameters), 0)
    width = whole.x[1] - whole.x[0]
    assert curves.x == pytest.approx(whole.x[:-1] + SAMPLE_SHIFT * width, abs=1e-12)
    check = verify(case, "dynamics", row, "position", 1e-6)
    assert 0 < check.fresh < 1e-6  # README: 1e-8 at 1 ms with RK4, so 16 times that
    assert 0 < check.shifted < 1e-6
    assert check.shifted != check.fresh
    assert check.used.parameters["timestep"] == whole.settings["timestep"]


def test_a_missing_shifted_start_is_explained() -> None:
    case = load_case(shipped("hacksaw_recorded.toml"))
    with pytest.raises(Unsupported, match="recorded curve"):
        run_shifted(case, "dynamics", Setting("mujoco"))
    with pytest.raises(Unsupported, match="an equilibrium has one start"):
        run_shifted(load_case(shipped("rod_cantilever.toml")), "equilibrium", Setting("mujoco"))


@pytest.mark.parametrize("name", ["rod_released", "slider_crank_elastic"])
@pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
def test_rods_in_dynamics_have_no_shifted_start(name: str, engine: str) -> None:
    """A key can start rods only in arcs, not in the shapes that they have later in the motion.

    The elastic coupler, started straight at another angle of the crank, had an error of 4.3e-2;
    from its own start it has 6.7e-4.
    """
    with pytest.raises(Unsupported, match="rods start in the arcs that the model's key gives them"):
        run_shifted(load_case(shipped(f"{name}.toml")), "dynamics", Setting(engine))


def test_rods_in_a_sweep_have_a_shifted_start() -> None:
    """In a sweep rods are in equilibrium at every sample, independent of earlier samples."""
    case = load_case(shipped("rfr2_driven.toml"))
    table = case.run["sweep"].model_copy(update={"n": 3})
    case = case.model_copy(update={"run": {"sweep": table}})
    curves = run_shifted(case, "sweep", Setting("mujoco", {"segments": 4}))
    assert all(np.isfinite(part).all() for part in curves.channels.values())


def test_a_setting_of_rods_holds_without_a_shifted_start(monkeypatch: pytest.MonkeyPatch) -> None:
    case = load_case(shipped("rod_released.toml"))
    here = Check(1e-3, np.nan, "", Setting("pymunk", {"timestep": 1e-3}))
    monkeypatch.setattr("proofmass.studies.trade.verify.run_as_program", lambda *_: here)
    row = StudyRow("choose", "rod_released", "dynamics", "pymunk", "", "timestep", 1e-3)
    check = verify(case, "dynamics", row, "position", 1e-2)
    assert check.holds(1e-2)
    assert "from a shifted start: rods start in the arcs" in check.words


def test_a_failed_run_does_not_hold(fourbar: Case) -> None:
    """With one iteration a step the loops open, and the run fails."""
    row = StudyRow(
        "trade",
        "fourbar",
        "dynamics",
        "pymunk",
        "",
        "iterations",
        1.0,
        {"timestep": 0.0174, "iterations": 1, "error_bias": 0.0},
        steps=361,
    )
    check = verify(fourbar, "dynamics", row, "position", 1e9)
    assert np.isnan([check.fresh, check.shifted]).all()
    assert not check.holds(1e9)


def test_the_printed_choice_can_be_pasted(fourbar: Case) -> None:
    """The text can be pasted as a whole: comments, then MJCF elements or Python lines."""
    rows = series_rows("tuned", integrator="RK4")
    text = format_snippet(choose_in_dynamics(fourbar, rows, 1e-4), fourbar)
    assert "position within 1e-4 of its range" in text
    merged = mujoco.MjModel.from_xml_string(insert_snippet(shipped("fourbar.xml"), text))
    assert merged.opt.timestep == 0.0005
    parameters = {"timestep": 0.01, "iterations": 10, "error_bias": 0.0}
    rows = [replace(row, engine="pymunk", parameters=parameters) for row in rows]
    exec(
        format_snippet(choose_in_dynamics(fourbar, rows, 1e-4), fourbar), {"space": pymunk.Space()}
    )


@pytest.mark.parametrize(
    ("asked", "right"),
    [
        ("pendulum.toml --error 0", "between 0 and 1, such as 1e-5"),
        ("pendulum.toml --error nan", "between 0 and 1, such as 1e-5"),
        ("pendulum.toml --error 1e-5 --budget -1", "--budget -1: give a number of seconds above 0"),
        (
            "pendulum.toml --error 1e-5 --longest nan",
            "--longest nan: give a number of seconds above",
        ),
        ("pendulum.toml --error 1e-5 --solver adams", "pendulum runs in mujoco, pymunk"),
        ("pendulum.toml --error 1e-5 --run equilibrium", "run.equilibrium: there is no such run"),
        ("pendulum.toml --error 1e-5 --drive servo", "no drive moves in time; leave it out"),
        ("fourbar.toml --error 1e-5 --drive rope", "servo, equality; pymunk has gear, motor"),
        ("fourbar.toml --error 1e-5 --drive gear --solver mujoco", "mujoco has flywheel, servo,"),
        ("pendulum.toml --error 1e-5 -o run.txt", "the name of a Python program, such as run.py"),
        ("pendulum.toml --error 1e-5 -o nowhere/run.py", "there is no folder nowhere"),
        (
            "rod_cantilever.toml --error 1e-2 -o run.py",
            "the equilibrium of rod_cantilever has no time",
        ),
        ("fourbar.toml --error 1e-5 --run sweep -o run.py", "the sweep of fourbar has no time"),
        ("nope.toml --error 1e-5", "no such file"),
        (". --error 1e-5", "the sidecar of one case"),
    ],
)
def test_bad_input_gives_a_message_of_one_line(
    asked: str, right: str, tmp_path: Path, models: Path
) -> None:
    words = asked.split()
    found = CliRunner().invoke(
        app, ["choose", str(models / words[0]), *words[1:], "--store", str(tmp_path)]
    )
    assert found.exit_code == 2
    assert right in found.stderr
    assert found.stderr.count("\n") == 1
    assert not found.stdout


def test_the_kind_of_drive_selects_the_engine(fourbar: Case) -> None:
    """This holds if only one of the case's engines has this kind of drive."""
    assert find_solver(fourbar, "dynamics", "gear", "") == "pymunk"
    assert find_solver(fourbar, "dynamics", "servo", "") == "mujoco"
    assert find_solver(fourbar, "dynamics", "servo", "mujoco") == "mujoco"
    assert find_solver(fourbar, "dynamics", "", "") == ""


def test_of_settings_with_the_same_step_fewer_iterations_come_first() -> None:
    """Of two settings with the same step the one with fewer iterations is first.

    This holds even if its processor time is a little longer.  A setting with a larger step that
    takes less time is before both.
    """
    one = series_rows("a")[0]
    rows = [
        replace(
            one, series=name, seconds=seconds, parameters={"timestep": step, "iterations": count}
        )
        for name, seconds, step, count in (
            ("many", 0.10, 1e-3, 10),
            ("few", 0.11, 1e-3, 3),
            ("coarse", 0.05, 2e-3, 30),
        )
    ]
    assert [row.series for row in good_settings(rows, "position", 1.0)] == ["coarse", "few", "many"]


@pytest.mark.slow
def test_the_command_chooses_rk4_for_the_pendulum(edit, tmp_path: Path) -> None:
    """RK4, whose error falls with h^4, is the cheapest by far; no setting reaches 1e-17.

    Rounding is larger than that.
    """
    edit("pendulum.toml", r"until = 10.0 ", "until = 1.0 ")
    file = edit("pendulum.toml", "n = 1001", "n = 21")
    asked = ["choose", str(file), "--solver", "mujoco", "--store", str(tmp_path / "study")]
    found = CliRunner().invoke(app, [*asked, "--error", "1e-6"])
    assert found.exit_code == 0, found.stderr
    merged = mujoco.MjModel.from_xml_string(insert_snippet(file.with_suffix(".xml"), found.stdout))
    assert merged.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert 1e-3 < merged.opt.timestep <= 0.05
    found = CliRunner().invoke(app, [*asked, "--error", "1e-17"])
    assert found.exit_code == 1
    assert "no measured setting has position within 1e-17" in found.stderr
    assert "of --budget 20 s and --longest 30 s a run" in found.stderr
    assert not found.stdout


def study_row(
    line: str = "",
    error: float = 1e-5,
    value: float = 1e-3,
    seconds: float = 1.0,
    engine: str = "mujoco",
    outcome: str = "ran",
    message: str = "",
    **parameters: object,
) -> StudyRow:
    """A row of a series with a position error, at a time step `value` [s]."""
    return StudyRow(
        "trade",
        "fourbar",
        "dynamics",
        engine,
        line,
        "timestep",
        value,
        {"timestep": value, **parameters},
        {"position": error},
        {},
        seconds,
        70,
        outcome=outcome,
        message=message,
    )


def floor_verdict(
    line: str, floor: float, engine: str = "mujoco", kind: str = "position"
) -> Verdict:
    """A verdict that a series has an error floor by softness."""
    return Verdict(
        "fourbar",
        "dynamics",
        engine,
        line,
        kind,
        floor=floor,
        cause="softness",
        evidence="halving it divides the error by 4",
    )


@pytest.mark.parametrize(
    ("floors", "found"),
    [
        ([floor_verdict("own", 2.0)], 0),  # the floor of its own series may be higher by any ratio
        ([floor_verdict("own", 1.2)], None),  # the floor is below 2 / 1.5
        ([floor_verdict("other", 2.8)], 0),
        ([floor_verdict("other", 3.2)], None),
        ([floor_verdict("other", 1.4)], 0),
        ([floor_verdict("other", 1.2)], None),
        ([floor_verdict("own", nan)], None),
        ([floor_verdict("own", 2.0, "pymunk")], None),
        ([floor_verdict("own", 2.0, kind="velocity")], None),
        ([floor_verdict("other", 2.0), floor_verdict("own", 9.0)], 1),
        ([floor_verdict("other", 2.8), floor_verdict("another", 1.8)], 1),
        ([floor_verdict("other", 1.4), floor_verdict("another", 2.2)], 1),
    ],
)
def test_the_floor_at_which_a_setting_is_is_found(floors: list[Verdict], found: int | None) -> None:
    assert find_floor(study_row("own", 2.0), "position", iter(floors)) == (
        None if found is None else floors[found]
    )


def test_good_settings_have_a_margin_of_two() -> None:
    rows = [
        study_row("dear", 5e-5, seconds=2.0),
        study_row("cheap", 5e-5),
        study_row("off", 5.1e-5),
        study_row("untimed", seconds=0.0),
        study_row("failed", outcome="stopped"),
    ]
    assert [row.series for row in good_settings(rows, "position", 1e-4)] == ["cheap", "dear"]
    assert good_settings(rows, "velocity", 1e-4) == []


def test_a_missing_choice_is_explained_by_the_best_setting() -> None:
    """The message names the best setting, and its error floor with the evidence."""
    rows = [
        study_row("poor", 1e-3),
        study_row("fine", 1.23e-5, 1e-4),
        study_row("none", nan),
        study_row("failed", 0.0, outcome="stopped"),
    ]
    short = (
        "no measured setting has position within 1.3e-6 of its range with a margin of 2; the "
        "best, fine, timestep 0.1 ms, is 1.2e-5 off"
    )
    none = "no convergence series still falls at its finest step, so none promises to get there"
    assert explain_no_choice(rows, "position", 1.27e-6, []) == (short, none)
    assert explain_no_choice(rows, "position", 1.27e-6, [floor_verdict("fine", 1.16e-5)]) == (
        f"{short}: the error floor is 1.2e-5, softness",
        "halving it divides the error by 4",
        none,
    )
    assert explain_no_choice([], "position", 1.0, []) == ("no setting was measured",)
    failed = [
        study_row("one", nan),
        study_row("two", outcome="diverged", message="why"),
        study_row("three", outcome="diverged"),
    ]
    assert (
        explain_no_choice(failed[1:], "velocity", 1.0, [])[1]
        == "the first, two, timestep 1 ms: diverged: why"
    )
    assert explain_no_choice(failed, "velocity", 1.0, []) == (
        "no setting ran, of 3: 2 diverged, 1 ran without velocity errors",
        "the first, one, timestep 1 ms: ran",
    )


def test_a_missing_choice_is_explained_by_the_error_of_the_drives() -> None:
    """The best setting is the one nearest to the prescribed motion, without a floor.

    The other one is nearer to the motion that its drives really had, and at an error floor there.
    """
    closest = replace(study_row("lagging", 2e-8), asked={"position": 9e-7})
    plain = replace(study_row("softer", 4e-7, 2e-3), asked={"position": 8e-7})
    short, *_ = explain_no_choice(
        [closest, plain], "position", 1e-6, [floor_verdict("lagging", 2e-8)]
    )
    assert short == (
        "no measured setting has position within 1e-6 of its range with a margin of 2; the best, "
        "softer, timestep 2 ms, is 8e-7 off, and 4e-7 off the motion that its drives really had"
    )


def test_the_cost_of_the_defaults_is_compared() -> None:
    """The chosen setting takes 0.5 s; the defaults are refined to half of 1e-4, the margin.

    The result is the sentence, and the ratio of the processor times.
    """
    tuned = study_row("tuned", seconds=0.5)

    def of(*rows: StudyRow, floors: tuple[Verdict, ...] = ()) -> tuple[str, float]:
        return compare_with_defaults([tuned, *rows], tuned, "position", 1e-4, floors)

    def plain(error: float, value: float, seconds: float = 2.0, **more) -> StudyRow:
        return study_row("plain", error, value, seconds, defaults=True, **more)

    nothing = "the defaults were not measured, or did not run"
    for row in (
        study_row(),
        plain(1e-5, 1e-3, engine="pymunk"),
        plain(nan, 1e-3),
        plain(1e-5, 1e-3, outcome="stopped"),
    ):
        assert of(row) == (nothing, pytest.approx(nan, nan_ok=True))
    assert of(plain(4e-5, 1e-3, 2.345), plain(1e-5, 5e-4, 4.0)) == (
        "4.7 times cheaper than the engine's defaults refined to the same error, "
        "2.3 s at timestep 1 ms",
        4.69,
    )
    # 3.2e-3 is 64 times half of 1e-4, which takes 8 times as many steps of second order
    coarse, fine = plain(1.28e-2, 2e-3), plain(3.2e-3, 1e-3)
    text, ratio = of(coarse, fine, plain(9e-1, 4e-3))
    assert ratio == pytest.approx(8 * 2.0 / 0.5)
    assert text == (
        "the engine's defaults are 3.2e-3 off at best, 2 s at timestep 1 ms; of order "
        "2 they would take 16 s, 32 times as long"
    )
    assert np.isnan(of(plain(1.3e-2, 2e-3), fine)[1])  # two steps show no order
    text, ratio = of(plain(1.3e-2, 2e-3), fine, plain(9e-1, 4e-3))
    order = np.log2(1.3e-2 / 3.2e-3)  # order 2.02: 7.8 times as many steps
    assert ratio == pytest.approx(64 ** (1 / order) * 4.0)
    assert text.endswith("of order 2 they would take 16 s, 31 times as long")
    # two steps that are close show no order: a phase of 10 % would make 2 of it 3
    assert of(plain(3.2e-3 * 1.1**3, 1.1e-3), coarse, fine)[1] == pytest.approx(8 * 2.0 / 0.5)
    short = "the engine's defaults are 3.2e-3 off at best, 2 s at timestep 1 ms"
    assert of(fine) == (short, pytest.approx(nan, nan_ok=True))
    flat = plain(3.2e-3 * 2**0.49, 2e-3)  # an order below one half
    assert of(flat, fine) == (short, pytest.approx(nan, nan_ok=True))
    assert of(
        coarse, fine, floors=(floor_verdict("plain", 3.2e-3), floor_verdict("other", 3.2e-3))
    ) == (
        "the engine's defaults never get there: the error floor is 3.2e-3, softness",
        inf,
    )
    more = plain(9e-1, 4e-3)
    assert of(more, coarse, fine, floors=(floor_verdict("other", 3.2e-3),))[1] == pytest.approx(32)
    near, nearer = plain(5.6e-5 * 4, 2e-3), plain(5.6e-5, 1e-3)  # 5e-5 is needed
    for floor, never in ((5.1e-5, True), (4.9e-5, False)):
        said = of(near, nearer, floors=(floor_verdict("plain", floor),))[0]
        assert ("never get there" in said) is never
    assert compare_with_defaults([fine], fine, "position", 1e-4, ()) == (
        "these are the engine's defaults, refined",
        1.0,
    )


def test_only_the_step_may_differ_from_the_defaults() -> None:
    assert is_default(study_row(defaults=True))
    assert is_default(study_row(defaults=True, integrator="Euler"))
    assert not is_default(study_row(defaults=True, integrator="RK4"))
    assert not is_default(study_row(defaults=True, iterations=3))
    assert not is_default(study_row())


def test_an_equilibrium_is_verified_with_its_snippet(fourbar: Case, monkeypatch) -> None:
    """A run without time has no program; the check has the errors of both runs."""
    used = Setting("mujoco", {"segments": 20})
    found = {rerun_setting: (1.0, used), shifted_error: 2.0}
    monkeypatch.setattr(
        verify_module,
        "call_limited",
        lambda case, kind, function, *told, least=0.0: found[function],
    )
    assert verify(fourbar, "equilibrium", study_row(), "velocity", 3.0) == Check(1.0, 2.0, "", used)
    poor = verify(fourbar, "equilibrium", study_row(), "velocity", 0.5)
    assert (poor.fresh, poor.again) == (1.0, False)
    assert poor.words == "run again with the lines below 1 off"

    def fails(error):
        def call(case, kind, function, *told, least=0.0):
            if function is rerun_setting:
                return 1.0, used
            raise error

        return call

    monkeypatch.setattr(
        verify_module, "call_limited", fails(Unsupported("an equilibrium has one start"))
    )
    check = verify(fourbar, "equilibrium", study_row(), "velocity", 1.0)
    assert (check.fresh, check.note, check.used) == (1.0, "an equilibrium has one start", used)
    assert np.isnan(check.shifted)
    assert check.holds(1.0)
    assert not check.holds(0.9)
    assert Check(1.0, 2.0, "", used).holds(2.0)
    for why in (Diverged("diverged at 3 s"), TimedOut("no answer in 60 s")):
        monkeypatch.setattr(verify_module, "call_limited", fails(why))
        check = verify(fourbar, "equilibrium", study_row(), "velocity", 1.0)
        assert (check.fresh, check.note, check.failed) == (1.0, "", str(why))
        assert check.words.endswith(f"from a shifted start: {why}")
        assert not check.holds(9.0)


def test_a_choice_is_described_with_all_its_measurements(fourbar: Case) -> None:
    rows = [study_row("lucky", 1.23e-5, 2e-3, 0.25), study_row("tuned", 2.34e-5, 1e-3, 0.512)]
    asked = []

    def check(case, kind, row, of, wanted):
        asked.append((case, kind, of))
        return Check(
            *((3.14e-5, 4.14e-4) if row.series == "lucky" else (2.22e-5, 4.56e-5)),
            "",
            Setting("mujoco", {"timestep": 1e-3}),
        )

    found = choose(fourbar, "dynamics", rows, 1.27e-4, verify=check)
    assert asked == [(fourbar, "dynamics", "position")] * 2
    assert describe_choice(found, fourbar) == [
        "fourbar, dynamics: position within 1.3e-4 of its range",
        "tuned, timestep 1 ms: 2.3e-5 off in 0.51 s, 70 steps",
        "run again with the lines below 2.2e-5 off; 4.6e-5 from a shifted start",
        "the defaults were not measured, or did not run",
        "lucky, timestep 2 ms is 1.2e-5 off, but run again with the lines below 3.1e-5 off; "
        "4.1e-4 from a shifted start",
    ]
    once = replace(found, check=replace(found.check, note="a rest -- has one"), refused=())
    assert describe_choice(once, fourbar)[2] == (
        "run again with the lines below 2.2e-5 off; from a shifted start: a rest -- has one"
    )
    chaotic = replace(once, motion="chaotic: errors are judged up to 15 s")
    assert describe_choice(chaotic, fourbar)[-1] == "chaotic: errors are judged up to 15 s"
    assert "\n  chaotic: errors are judged up to 15 s\n" in format_snippet(chaotic, fourbar)
    text = format_snippet(once, fourbar)
    assert text.startswith("<!--\n  fourbar, dynamics: position within 1.3e-4 of its range\n")
    assert "a rest - has one\n" in text  # two dashes are not allowed in a comment
    assert "\n-->\n<option" in text
    assert all(len(line) <= 94 for line in format_snippet(found, fourbar).splitlines())
    assert "4.1e-4\n    from a shifted start\n-->" in format_snippet(found, fourbar)
    planar = replace(
        once,
        row=replace(once.row, engine="pymunk"),
        check=replace(once.check, used=Setting("pymunk", {"timestep": 1e-3})),
    )
    assert format_snippet(planar, fourbar).startswith("# fourbar, dynamics: ")
    with pytest.raises(NoGoodSetting) as why:
        choose(fourbar, "dynamics", rows[:1], 1e-4, verify=check)
    assert str(why.value) == f"{describe_choice(found, fourbar)[-1]}; no setting was measured"
