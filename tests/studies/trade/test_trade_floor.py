"""Causes of errors: each known cause is found, and none is named without evidence."""

from dataclasses import replace

import pytest

from proofmass.base.errors import InputError
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.tuning import Perturbation
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade.case_series import CaseSeries
from proofmass.studies.trade.floor_cause import (
    SIGNIFICANT_FACTOR,
    find_cause,
    halve_segments,
    halved_settings,
    improvement,
    list_perturbations,
)
from proofmass.studies.trade.series import MeasuredSeries
from proofmass.studies.trade.trade import find_leaders, halve_steps
from proofmass.studies.trade.varied import ConvergenceSeries
from tests.shipped import shipped

HARD_SOLIMP = (0.9999, 0.9999, 0.001)
FOURBAR = load_case(shipped("fourbar.toml"))
STIFF_SETTING = Setting(
    "mujoco", {"timestep": 2e-3, "integrator": "RK4", "solref": (0.032, 1.0), "solimp": HARD_SOLIMP}
)


def run_perturbations(folder, case, setting, kind="dynamics", causes=None):
    """The errors of a setting; and all its perturbations, or those of `causes`, with their rows."""
    listed = list_perturbations(case, kind, setting, folder)
    wanted = [(own, p) for own, p in listed if causes is None or p.cause in causes]
    first, *rows = Study(Store(folder)).run(
        [
            StudyRun(case, kind, setting),
            *(StudyRun(own, kind, Setting(setting.engine, p.parameters)) for own, p in wanted),
        ],
        repeats=0,
    )
    return first.errors, [(p, row) for (_, p), row in zip(wanted, rows, strict=True)]


def improvements_by_cause(errors, found, kind):
    """The improvement of an error by the perturbation of each cause."""
    return {p.cause: improvement(p, errors[kind] / row.errors[kind]) for p, row in found}


def series_of_two(**second):
    """A series of two settings: the stiff one, and the same with other parameters."""
    return ConvergenceSeries(
        "mujoco", "x", "timestep", (STIFF_SETTING, STIFF_SETTING.with_parameters(**second))
    )


def test_a_step_is_halved_and_quartered():
    """`solref` stays as it is, unless it changes with the step along the series."""
    plain, hard = series_of_two(timestep=1e-3), series_of_two(timestep=1e-3, solref=(0.016, 1.0))
    assert halved_settings("dynamics", plain, STIFF_SETTING, 1.0) == [
        STIFF_SETTING.with_parameters(timestep=1e-3),
        STIFF_SETTING.with_parameters(timestep=0.5e-3),
    ]
    assert halved_settings("dynamics", hard, STIFF_SETTING, 1.0) == [
        STIFF_SETTING.with_parameters(timestep=1e-3, solref=(0.016, 1.0)),
        STIFF_SETTING.with_parameters(timestep=0.5e-3, solref=(0.008, 1.0)),
    ]


def test_a_setting_without_a_step_halves_that_of_the_model():
    setting = Setting("mujoco", {"iterations": 3})
    series = ConvergenceSeries(
        "mujoco", "x", "iterations", (setting, setting.with_parameters(iterations=6))
    )
    assert halved_settings("dynamics", series, setting, 4e-3) == [
        setting.with_parameters(timestep=2e-3),
        setting.with_parameters(timestep=1e-3),
    ]


@pytest.mark.parametrize("kind", ["equilibrium", "sweep"])
def test_segments_of_a_rod_are_doubled_and_quadrupled(kind):
    setting = Setting("mujoco", {"segments": 10, "solver": "CG"})
    series = ConvergenceSeries(
        "mujoco", "x", "segments", (setting, setting.with_parameters(segments=20))
    )
    assert halved_settings(kind, series, setting, 1e-3) == [
        setting.with_parameters(segments=20),
        setting.with_parameters(segments=40),
    ]


def test_the_error_of_soft_loops_goes_with_solref_squared(tmp_path):
    errors, found = run_perturbations(tmp_path, FOURBAR, STIFF_SETTING)
    cause, evidence = find_cause(errors["position"], found, "position")
    assert cause == "softness of the loops"
    told = improvements_by_cause(errors, found, "position")
    # the square of the time constant, except for the share of the jolt at the start
    assert told["softness of the loops"] == pytest.approx(4.0, rel=0.1)
    assert told["softness of the loops, solimp"] == pytest.approx(2.0, rel=0.05)  # like 1 - d
    assert told["time step"] == pytest.approx(1.0, rel=0.01)
    assert "halving solref divides the error by" in evidence
    # accelerations keep the share 1 - d of those of the open loop, for any solref
    assert find_cause(errors["acceleration"], found, "acceleration")[0] == (
        "softness of the loops, solimp"
    )


def test_a_floor_of_soft_loops_changes_with_solref(tmp_path):
    softer = STIFF_SETTING.with_parameters(solref=(0.064, 1.0))
    hard, soft = (
        run_perturbations(tmp_path, FOURBAR, s, causes=())[0]["position"]
        for s in (STIFF_SETTING, softer)
    )
    assert soft / hard == pytest.approx(4.0, rel=0.1)


def test_a_wrong_reference_is_found_as_the_cause(tmp_path):
    """The crank is 0.1 % longer in the sidecar than in the MJCF.

    The second reference reads the MJCF.
    """
    wrong = FOURBAR.model_copy(update={"parameters": FOURBAR.parameters | {"crank": 1.001}})
    errors, found = run_perturbations(tmp_path, wrong, STIFF_SETTING)
    assert find_cause(errors["position"], found, "position")[0] == "the reference"


def test_a_coarse_step_is_found_with_its_order(tmp_path):
    errors, found = run_perturbations(tmp_path, FOURBAR, Setting("pymunk", {"timestep": 4e-3}))
    assert find_cause(errors["position"], found, "position")[0] == "time step"
    # second order; steps between samples are a whole number, so that 5 become 9 and not 10
    assert improvements_by_cause(errors, found, "position")["time step"] == pytest.approx(
        (9 / 5) ** 2, rel=0.05
    )


def test_halving_the_bias_or_the_step_halves_the_error_of_the_bias(tmp_path):
    """The bias is Chipmunk's default, and the steps are so small that its error is the largest.

    That error is proportional to the step and to the time constant of the bias: halving either one
    divides it by 2.
    """
    setting = Setting("pymunk", {"timestep": 1e-3, "error_bias": 0.9**60})
    brief = FOURBAR.run["dynamics"].model_copy(update={"until": 2.0, "n": 121})
    case = FOURBAR.model_copy(update={"run": {"dynamics": brief}})
    errors, found = run_perturbations(
        tmp_path, case, setting, causes=("bias of the loops", "time step")
    )
    told = improvements_by_cause(errors, found, "position")
    assert find_cause(errors["position"], found, "position")[0] in told
    assert told["bias of the loops"] == pytest.approx(2.0, rel=0.15)
    assert told["time step"] == pytest.approx(2.0, rel=0.15)


def test_a_bias_is_found_by_removing_it_with_enough_iterations(tmp_path):
    """The start of the bias is a jolt, however short its time constant.

    Without the bias 750 iterations leave the loop open.
    """
    setting = Setting("pymunk", {"timestep": 0.5e-3, "defaults": True})
    errors, found = run_perturbations(tmp_path, load_case(shipped("fivebar.toml")), setting)
    assert find_cause(errors["acceleration"], found, "acceleration")[0] == "bias of the loops"


def test_half_of_a_recorded_curve_leaves_the_error(tmp_path):
    """With every other row of the recorded curve the errors at the samples stay the same.

    Between the rows of a drive its motion is one whose second derivative is its acceleration.
    Fewer rows give another motion between the samples only.
    """
    case = load_case(shipped("hacksaw_recorded.toml"))
    setting = Setting("pymunk", {"timestep": 1e-3, "error_bias": 0.0, "iterations": 100})
    errors, found = run_perturbations(tmp_path, case, setting)
    for kind in ("position", "velocity", "acceleration"):
        assert find_cause(errors[kind], found, kind)[0] == "time step"
        told = improvements_by_cause(errors, found, kind)
        assert told["the reference"] == pytest.approx(1.0, abs=0.01)
        assert told["time step"] == pytest.approx(4.0, rel=0.02)  # second order


def test_too_few_iterations_are_found(tmp_path):
    setting = STIFF_SETTING.with_parameters(solver="PGS", iterations=1, tolerance=0.0)
    errors, found = run_perturbations(tmp_path, FOURBAR, setting)
    assert find_cause(errors["position"], found, "position")[0] == "the solver's iterations"


def test_segments_of_a_rod_are_found(tmp_path):
    case = load_case(shipped("rod_cantilever.toml"))
    errors, found = run_perturbations(
        tmp_path, case, Setting("mujoco", {"segments": 40}), "equilibrium"
    )
    assert find_cause(errors["position"], found, "position")[0] == "segments"
    assert improvements_by_cause(errors, found, "position")["segments"] == pytest.approx(
        4.0, rel=0.1
    )  # n^-2


@pytest.mark.parametrize(
    ("engine", "step"), [("mujoco", 5e-4), pytest.param("pymunk", 2.5e-4, marks=pytest.mark.slow)]
)
def test_segments_of_a_rod_in_motion_are_found(engine, step, tmp_path):
    """Half as many segments have four times the error.

    Without that perturbation the cause is unknown.
    """
    case = load_case(shipped("rod_released.toml"))
    errors, found = run_perturbations(tmp_path, case, Setting(engine, {"timestep": step}))
    cause, evidence = find_cause(errors["position"], found, "position", at_floor=True)
    assert cause == "segments"
    assert "half as many segments multiplies the error by 4.1" in evidence  # n^-2, for 20 and 10
    rest = [(p, row) for p, row in found if p.cause != "segments"]
    assert find_cause(errors["position"], rest, "position", at_floor=True)[0] == "unknown"


def segment_perturbations(case, parameters, tmp_path):
    """The perturbations of segments.

    For each: the change in words, the numbers of segments, and whether the error should get better.
    """
    found = list_perturbations(case, "dynamics", Setting("mujoco", parameters), tmp_path)
    return [
        (p.change, [rod.segments for rod in perturbed_rods(case, p)], p.better)
        for case, p in found
        if p.cause == "segments"
    ]


def perturbed_rods(case, perturbation):
    """The rods of a perturbed run."""
    return Setting("mujoco", perturbation.parameters).apply_to(case, "dynamics")[1].rods


@pytest.mark.parametrize(
    ("parameters", "numbers"),
    [({}, [10]), ({"segments": 12}, [6]), ({"segments": 7}, [3]), ({"segments": 3}, [2])],
)
def test_segments_are_halved_in_dynamics(parameters, numbers, tmp_path):
    """If the setting has no number of segments, that of the sidecar is halved."""
    case = load_case(shipped("rod_released.toml"))
    words = "fewer" if parameters.get("segments", 20) % 2 else "half as many"
    found = segment_perturbations(case, {"timestep": 1e-3, **parameters}, tmp_path)
    assert found == [(f"{words} segments", numbers, False)]


def test_each_rod_has_half_of_its_own_segments(tmp_path):
    case = load_case(shipped("rod_released.toml"))
    other = case.rod["rod"].model_copy(update={"segments": 8})
    case = case.model_copy(update={"rod": {**case.rod, "other": other}})
    # the model with the two rods is not compiled: only the perturbation is examined
    ((changed, one),) = halve_segments(case, Setting("mujoco"))
    assert [rod.segments for rod in changed.rods] == [10, 4]
    assert one.parameters == {}


def test_two_segments_and_none_are_not_halved(tmp_path):
    case = load_case(shipped("rod_released.toml"))
    assert segment_perturbations(case, {"timestep": 1e-3, "segments": 2}, tmp_path) == []
    assert segment_perturbations(FOURBAR, {"timestep": 1e-3}, tmp_path) == []


def test_samples_at_the_ends_of_links_reduce_the_error(tmp_path):
    """Ten straight links have larger errors at 41 samples than at the ends of the links.

    Between the ends the links are chords of the rod.
    """
    case = load_case(shipped("rod_cantilever.toml"))
    errors, found = run_perturbations(
        tmp_path, case, Setting("mujoco", {"segments": 10}), "equilibrium"
    )
    assert improvements_by_cause(errors, found, "position")["sampling"] >= SIGNIFICANT_FACTOR
    rest = [(p, row) for p, row in found if p.cause == "sampling"]
    assert find_cause(errors["position"], rest, "position")[0] == "sampling"


def floor_row(error, outcome="ran"):
    """A row with a velocity error, if it ran."""
    return StudyRow(
        "floor",
        "",
        "dynamics",
        "mujoco",
        "",
        "",
        0.0,
        outcome=outcome,
        errors={"velocity": error} if outcome == "ran" else {},
    )


def perturbations(setting, folder, case=FOURBAR):
    """All perturbations of a setting in dynamics."""
    return [p for _, p in list_perturbations(case, "dynamics", setting, folder)]


def perturbation_of(cause, better=True):
    """A perturbation of a cause."""
    return Perturbation(cause, f"moving {cause}", STIFF_SETTING.parameters, better)


def test_an_error_that_no_perturbation_changes_has_no_known_cause():
    found = [
        (perturbation_of("time step"), floor_row(1.0)),
        (perturbation_of("softness"), floor_row(0.99)),
    ]
    assert find_cause(1.0, found, "velocity")[0] == "unknown"
    assert find_cause(1.0, [], "velocity") == ("unknown", "")


@pytest.mark.parametrize(
    ("share", "cause"), [(0.17, "unknown"), (0.2, "softness"), (0.5, "softness")]
)
def test_a_cause_has_at_least_a_fifth_of_the_error(share, cause):
    """The error is of first order in the cause: halving the cause removes half of its share."""
    assert (
        find_cause(1.0, [(perturbation_of("softness"), floor_row(1 - share / 2))], "velocity")[0]
        == cause
    )


def test_an_error_that_grows_with_a_smaller_step_is_not_yet_rounding():
    cause, evidence = find_cause(1.0, [(perturbation_of("time step"), floor_row(4.0))], "velocity")
    assert cause == "unknown"
    assert evidence == "moving time step multiplies the error by 4.00"


def test_a_cause_that_is_only_increased_is_found_by_a_larger_error():
    assert (
        find_cause(1.0, [(perturbation_of("softness", better=False), floor_row(2.0))], "velocity")[
            0
        ]
        == "softness"
    )
    assert (
        find_cause(1.0, [(perturbation_of("softness", better=False), floor_row(0.5))], "velocity")[
            0
        ]
        == "unknown"
    )


def test_another_reference_may_change_an_error_either_way():
    for error in (2.0, 0.5):
        assert (
            find_cause(
                1.0, [(perturbation_of("reference", better=None), floor_row(error))], "velocity"
            )[0]
            == "reference"
        )


def test_of_several_causes_the_one_with_the_largest_effect_is_found():
    found = [
        (perturbation_of("one"), floor_row(1 / SIGNIFICANT_FACTOR)),
        (perturbation_of("two"), floor_row(0.5)),
    ]
    assert find_cause(1.0, found, "velocity")[0] == "two"


def test_a_failed_run_is_reported_and_shows_no_cause():
    found = [(perturbation_of("softness"), floor_row(0.0, "diverged"))]
    assert find_cause(1.0, found, "velocity") == ("unknown", "moving softness: diverged")
    assert (
        find_cause(1.0, [*found, (perturbation_of("step"), floor_row(0.5))], "velocity")[0]
        == "step"
    )
    away = [(perturbation_of("softness", better=False), floor_row(0.0, "diverged"))]
    assert find_cause(1.0, away, "velocity") == ("unknown", "moving softness: diverged")


def test_a_cause_with_two_perturbations_has_the_larger_effect():
    for found in ([0.5, 1.0], [1.0, 0.5]):
        moves = [(perturbation_of("bias"), floor_row(error)) for error in found]
        assert find_cause(1.0, moves, "velocity")[0] == "bias"


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_halving_and_removing_a_cause_give_the_same_improvement(share):
    """If the error is of first order in the cause, both changes show the same share."""
    half, whole = perturbation_of("bias"), replace(perturbation_of("bias"), whole=True)
    assert improvement(half, 1 / (1 - share / 2)) == pytest.approx(
        improvement(whole, 1 / (1 - share))
    )


def test_a_bias_of_zero_is_not_perturbed(tmp_path):
    biased = {
        p.change: p.parameters["error_bias"]
        for p in perturbations(Setting("pymunk", {"error_bias": 0.5}), tmp_path)
        if "bias" in p.cause
    }
    assert list(biased.values()) == [0.25, 0.0]
    assert not [
        p
        for p in perturbations(Setting("pymunk", {"error_bias": 0.0}), tmp_path)
        if "bias" in p.cause
    ]


def test_perturbations_stay_within_the_limits_of_mujoco(tmp_path):
    """`solimp` is at most 0.9999 and `solref` at least two steps.

    Values at these limits are changed to softer ones.
    """
    hard = STIFF_SETTING.with_parameters(solref=(4e-3, 1.0))
    found = {p.cause: p for p in perturbations(hard, tmp_path)}
    assert found["softness of the loops, solimp"].better is False
    assert found["softness of the loops"].parameters["solref"] == (8e-3, 1.0)
    soft = Setting("mujoco", {"defaults": True, "timestep": 1e-3})
    found = {p.cause: p for p in perturbations(soft, tmp_path)}
    assert found["softness of the loops, solimp"].better is True
    assert found["softness of the loops"].parameters["solref"] == (0.01, 1.0)


@pytest.mark.parametrize(
    ("name", "missing"), [("stephenson", "the reference"), ("pendulum", "softness of the loops")]
)
def test_absent_causes_are_not_perturbed(name, missing, tmp_path):
    case = load_case(shipped(f"{name}.toml"))
    setting = Setting("mujoco", {"timestep": 1e-3})
    assert missing not in {p.cause for p in perturbations(setting, tmp_path, case)}


def test_other_samples_leave_the_time_steps_unchanged(tmp_path):
    found = list_perturbations(FOURBAR, "dynamics", STIFF_SETTING, tmp_path)
    thinned = next(case for case, p in found if p.cause == "sampling")
    every, other = (STIFF_SETTING.apply_to(case, "dynamics")[1] for case in (FOURBAR, thinned))
    assert other.x == pytest.approx(every.x[::2], abs=1e-12)
    assert other.steps(2e-3)[1] == pytest.approx(every.steps(2e-3)[1])


def test_a_solver_that_mujoco_lacks_is_bad_input(tmp_path):
    with pytest.raises(InputError, match="solver: known: pgs, cg, newton, not 'Gauss'"):
        run_perturbations(tmp_path, FOURBAR, STIFF_SETTING.with_parameters(solver="Gauss"))


ERRORS_WITH_FLOOR = {
    "position": (4e-4, 2e-5, 1e-5, 1e-5, 1e-5),
    "velocity": (4e-3, 2e-4, 1e-4, 1e-4, 1e-4),
}


def series_at(
    name: str, errors: dict[str, tuple[float, ...]], engine: str = "mujoco", case=FOURBAR
) -> CaseSeries:
    """A series of five time steps, each half of the previous one, with given errors by kind."""
    steps = [4e-3 / 2**k for k in range(5)]
    settings = tuple(Setting(engine, {"timestep": step}) for step in steps)
    rows = [
        StudyRow(
            "trade",
            case.name,
            "dynamics",
            engine,
            name,
            "timestep",
            step,
            errors={kind: values[k] for kind, values in errors.items()},
        )
        for k, step in enumerate(steps)
    ]
    series = ConvergenceSeries(engine, name, "timestep", settings)
    return CaseSeries(case, "dynamics", MeasuredSeries(series, rows))


def errors_scaled_in(kind: str, by: float) -> dict[str, tuple[float, ...]]:
    """The errors with a floor, with those of one kind multiplied by a factor."""
    return {**ERRORS_WITH_FLOOR, kind: tuple(by * error for error in ERRORS_WITH_FLOOR[kind])}


def leaders_of(*every: CaseSeries) -> dict[str, str]:
    """The series of the leader that `find_leaders` finds for each series, by their names.

    The halvings of a setting are the finer steps of its own series.
    """
    settings = [setting for one in every for setting in one.at_floors()]
    for setting in settings:
        assert setting.k == 2
        setting.halved = setting.halved or two_finer_rows(setting.of, 2)
    find_leaders(settings)
    return {one.of.series.name: one.leader.of.series.name for one in settings if one.leader}


def two_finer_rows(one: CaseSeries, k: int) -> list[StudyRow]:
    """The rows after number k, whose steps are a half and a quarter of it."""
    return one.measured.rows[k + 1 : k + 3]


def test_series_with_the_same_errors_are_at_one_floor_which_is_examined_once():
    first, again = (
        series_at("Newton", ERRORS_WITH_FLOOR),
        series_at("CG", errors_scaled_in("position", 1.009)),
    )
    assert leaders_of(first, again) == {"Newton": "Newton", "CG": "Newton"}


@pytest.mark.parametrize(
    "other",
    [
        series_at("CG", errors_scaled_in("position", 1.02)),
        series_at("CG", errors_scaled_in("velocity", 0.98)),
        series_at("pymunk", ERRORS_WITH_FLOOR, "pymunk"),
        series_at("CG", ERRORS_WITH_FLOOR, case=FOURBAR.model_copy(update={"title": "another"})),
    ],
    ids=["position", "velocity", "engine", "case"],
)
def test_series_with_another_error_engine_or_case_have_own_floors(other):
    name = other.series.name
    own = leaders_of(series_at("Newton", ERRORS_WITH_FLOOR), other)
    assert own == {"Newton": "Newton", name: name}


def test_a_series_without_a_floor_of_a_kind_does_not_stand_for_one_with_it():
    """The velocity errors of the first series still fall.

    At one step they happen to equal those of the second series.
    """
    falling = {**ERRORS_WITH_FLOOR, "velocity": (1.6e-3, 4e-4, 1e-4, 2.5e-5, 6e-6)}
    found = leaders_of(series_at("Newton", falling), series_at("CG", ERRORS_WITH_FLOOR))
    assert found == {"Newton": "Newton", "CG": "CG"}


def test_a_series_that_a_halving_changes_has_no_floor():
    """Two series have the same errors, but halving the step changes those of the second."""
    first, second = series_at("Newton", ERRORS_WITH_FLOOR), series_at("CG", ERRORS_WITH_FLOOR)
    second.setting(2).halved = [
        replace(row, errors={k: 3 * v for k, v in row.errors.items()})
        for row in two_finer_rows(second, 2)
    ]
    assert leaders_of(first, second) == {"Newton": "Newton"}


def test_a_floor_is_measured_at_exactly_half_and_a_quarter_of_its_step(monkeypatch):
    """The next steps of a series may be a little shorter than half, which may change forces."""
    asked = list[StudyRun]()

    def ran(_, tasks, **__):
        asked.extend(tasks)
        return [series_at("Newton", ERRORS_WITH_FLOOR).measured.rows[0] for _ in tasks]

    monkeypatch.setattr(Study, "run", ran)
    one = series_at("Newton", ERRORS_WITH_FLOOR)
    assert len(halve_steps([one], Study(None))) == 2
    (setting,) = one.examined.values()
    step = setting.setting.parameters["timestep"]
    assert [task.setting.parameters["timestep"] for task in asked] == [step / 2, step / 4]
    assert len(setting.halved) == 2
