"""How studies decide: perturbed causes, expected orders, boundaries, failures, removed features."""

from contextlib import contextmanager
from dataclasses import replace
from math import inf, isnan, nan
from pathlib import Path
from typing import ClassVar

import mujoco
import numpy as np
import pytest

from proofmass.base.errors import InputError
from proofmass.base.worker import Crashed, TimedOut
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run, starts_with_jolt
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, Diverged, NotSolved, Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.sim.protocol.tuning import Perturbation
from proofmass.studies import measure
from proofmass.studies.diet import diet, scene
from proofmass.studies.diet.edits import read_model
from proofmass.studies.diet.options import DRAWN_GEOM, Feature
from proofmass.studies.diet.scene import DietScene, MonitoredRun
from proofmass.studies.diet.scene import channel_changes as moved_over
from proofmass.studies.diet.table import Entry
from proofmass.studies.diet.trial import Cost, CostComparison
from proofmass.studies.measure import Measurement, StudyRun
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.store import Store
from proofmass.studies.stress import limit_search
from proofmass.studies.stress.boundary import (
    Boundary,
    BoundaryKind,
    Failure,
    TrialResult,
    is_engine_warning,
)
from proofmass.studies.stress.limit_search import (
    LimitSearch,
    NotApplicable,
    StressedCase,
    bisect,
    find_failure,
    measure_untimed,
    reference_follows_masses,
    require,
)
from proofmass.studies.study import Study
from proofmass.studies.trade.floor_cause import (
    find_cause,
    format_factor,
    improvement,
    list_perturbations,
)
from proofmass.studies.trade.orders import expected_orders, is_unexpected, nearest_order
from proofmass.studies.trade.series import (
    MeasuredSeries,
    find_flat_point,
    find_slowdown,
    observed_order,
    points_before_slowdown,
    slowdown_error,
)
from proofmass.studies.trade.varied import ConvergenceSeries
from proofmass.studies.trade.verdict import pareto_front
from tests.shipped import shipped


def load_shipped_case(name: str):
    """The shipped case with this name."""
    return load_case(shipped(f"{name}.toml"))


FOURBAR = load_shipped_case("fourbar")  # timestep 1e-3, solref 0.005 1, solimp 0.9999 0.9999 0.001
DEFAULT_BIAS = (
    0.9**60
)  # Chipmunk's default: share of a constraint violation that is left after a second
DEFAULT_ITERATIONS = 3000  # number of iterations in pymunk if the setting does not state it
UNSTABLE_FAILURE = Failure("gone", BoundaryKind.UNSTABLE, True)


def engine_perturbations(name: str, setting: Setting, folder: Path, run: str = "dynamics"):
    """Perturbations of the engine's parameters in a run of a shipped case.

    For each: cause, change in words, parameters, whether the error should get better, and whether
    the cause is removed entirely.
    """
    case = load_shipped_case(name)
    found = [
        (own, p)
        for own, p in list_perturbations(case, run, setting, folder)
        if p.cause not in ("the reference", "sampling")
    ]
    assert all(own == case for own, _ in found)
    return [(p.cause, p.change, p.parameters, p.better, p.whole) for _, p in found]


@pytest.mark.parametrize(
    ("parameters", "step", "bias", "iterations"),
    [
        ({}, 1e-3, 0.0, DEFAULT_ITERATIONS),
        ({"defaults": True}, 1e-3, DEFAULT_BIAS, 10),
        ({"defaults": True, "timestep": 0.5, "error_bias": 0.0}, 0.5, 0.0, 10),
        ({"error_bias": 0.5, "iterations": 7}, 1e-3, 0.5, 7),
    ],
)
def test_each_possible_cause_is_perturbed_in_pymunk(parameters, step, bias, iterations, tmp_path):
    kept = {k: v for k, v in parameters.items() if k == "timestep"}
    more = 4 * iterations if iterations < DEFAULT_ITERATIONS else DEFAULT_ITERATIONS
    assert engine_perturbations("fourbar", Setting("pymunk", parameters), tmp_path) == [
        ("time step", "halving the step", {**parameters, "timestep": step / 2}, True, False),
        *(
            [
                (
                    "bias of the loops",
                    "halving its time constant",
                    {**parameters, "error_bias": bias**2},
                    True,
                    False,
                ),
                (
                    "bias of the loops",
                    "taking it away, with iterations enough for that",
                    {**kept, "error_bias": 0.0},
                    True,
                    True,
                ),
            ]
            if bias
            else []
        ),
        (
            "the solver's iterations",
            f"{more} iterations",
            {**parameters, "iterations": more},
            True,
            False,
        ),
    ]


@pytest.mark.parametrize(
    ("parameters", "step", "solref", "closer", "solimp", "harder"),
    [
        (
            {},
            1e-3,
            0.0025,
            True,
            (0.9998, 0.9998),
            False,
        ),  # values of the model, whose solimp is at its cap
        (
            {"timestep": 2e-3},
            2e-3,
            0.01,
            False,
            (0.9998, 0.9998),
            False,
        ),  # half of solref is less than two steps
        ({"timestep": 1.25e-3}, 1.25e-3, 0.0025, True, (0.9998, 0.9998), False),  # two steps
        ({"defaults": True}, 2e-3, 0.01, True, (0.95, 0.975), True),  # defaults: 0.02, 0.9 and 0.95
        (
            {"solref": (0.5, 0.7), "solimp": (0.8, 0.9998, 0.1), "iterations": 5},
            1e-3,
            0.25,
            True,
            (0.9, 0.9999),
            True,
        ),  # half of 1 - solimp is just at the cap
        ({"solimp": (0.8, 0.9999, 0.1)}, 1e-3, 0.0025, True, (0.6, 0.9998), False),
    ],
)
def test_each_possible_cause_is_perturbed_in_mujoco(
    parameters, step, solref, closer, solimp, harder, tmp_path
):
    found = engine_perturbations("fourbar", Setting("mujoco", parameters), tmp_path)
    assert [cause for cause, *_ in found] == [
        "time step",
        "softness of the loops",
        "softness of the loops, solimp",
        "the solver's iterations",
    ]
    ratio = parameters.get("solref", (0.0, 1.0))[1]
    rest = parameters.get("solimp", (0.9, 0.95, 0.001, 0.5, 2.0))[2:]
    iterations = 4 * parameters.get("iterations", 100)
    for (_, words, setting, better, whole), (move, more, way) in zip(
        found,
        [
            ("halving the step", {"timestep": step / 2}, True),
            (f"{'halving' if closer else 'doubling'} solref", {"solref": (solref, ratio)}, closer),
            (
                f"{'halving' if harder else 'doubling'} 1 - solimp",
                {"solimp": (*solimp, *rest)},
                harder,
            ),
            ("four times as many iterations", {"iterations": iterations, "tolerance": 0.0}, True),
        ],
        strict=True,
    ):
        assert (words, better, whole) == (move, way, False)
        assert setting.keys() == {**parameters, **more}.keys()
        for name, value in {**parameters, **more}.items():
            assert setting[name] == pytest.approx(value, rel=0, abs=2e-15)  # 1 - (1 - d) is rounded


def test_only_present_causes_are_perturbed_without_loops_and_in_rods(tmp_path):
    assert [
        cause for cause, *_ in engine_perturbations("pendulum", Setting("mujoco"), tmp_path)
    ] == ["time step"]
    assert engine_perturbations(
        "rod_cantilever", Setting("mujoco", {"segments": 40}), tmp_path, "equilibrium"
    ) == [("segments", "twice as many segments", {"segments": 80}, True, False)]
    assert engine_perturbations("fourbar", Setting("mujoco"), tmp_path, "sweep") == []


def test_the_reference_is_perturbed_if_there_is_a_second_one(tmp_path):
    def of(name: str, run: str = "dynamics"):
        setting = Setting("mujoco", {"segments": 40, "timestep": 1e-3})
        found = [
            (case, p)
            for case, p in list_perturbations(load_shipped_case(name), run, setting, tmp_path)
            if p.cause == "the reference"
        ]
        assert all(p.parameters == setting.parameters for _, p in found)
        return found

    ((case, solver),) = of("fourbar")
    assert (solver.change, solver.better, case.reference) == (
        "a second reference",
        None,
        "planar",
    )
    ((case, half),) = of("hacksaw_recorded")
    assert (half.change, half.better) == ("every other row of the recorded curve", False)
    assert case.reference.startswith(str(tmp_path))
    for name, run in (
        ("stephenson", "dynamics"),
        ("hacksaw", "dynamics"),
        ("rod_cantilever", "equilibrium"),
    ):  # the reference is the planar solver, has its own motion profile, or has rods
        assert of(name, run) == []


def test_samples_are_thinned_or_moved_to_the_ends_of_links(tmp_path):
    def of(name: str, run: str = "dynamics", n: int | None = None, segments: int = 40):
        case = load_shipped_case(name)
        case = case.with_run(run, n=n) if n else case
        setting = Setting("mujoco", {"segments": segments, "timestep": 1e-3})
        found = [
            (own, p)
            for own, p in list_perturbations(case, run, setting, tmp_path)
            if p.cause == "sampling"
        ]
        assert all(p.parameters == setting.parameters for _, p in found)
        assert all(own.run.keys() == case.run.keys() for own, _ in found)
        return [(p.change, own.run[run].n, p.better) for own, p in found]

    for n in (361, 363):
        assert of("fourbar", n=n) == [("every other sample", n // 2 + 1, None)]
    assert of("fourbar", n=360) == []  # the last sample would be left out
    assert of("fourbar", "sweep", n=361) == []
    assert of("hacksaw_recorded") == []
    assert of("rod_cantilever", "equilibrium", n=41) == []  # at the ends of its 40 links already
    assert of("rod_cantilever", "equilibrium", n=41, segments=20) == [
        ("samples at the ends of links", 21, True)
    ]


def floor_row(error: float, outcome: str = "ran") -> StudyRow:
    """A row with a velocity error."""
    return StudyRow(
        "floor", "", "dynamics", "mujoco", "", "", 0.0, {}, {"velocity": error}, outcome=outcome
    )


def perturbation_and_row(cause: str, error: float, better: bool | None = True, **more):
    """A perturbation of a cause, and a row with the velocity error that it leaves."""
    return Perturbation(cause, f"moving {cause}", {}, better), floor_row(error, **more)


def test_the_cause_is_the_perturbation_with_the_largest_effect():
    found = [
        perturbation_and_row("one", 0.5),
        perturbation_and_row("two", 1.0),
        perturbation_and_row("three", 0.4, outcome="diverged"),
        perturbation_and_row("four", 0.0),
    ]
    assert find_cause(1.0, found, "velocity") == (
        "one",
        (
            "moving one divides the error by 2.00; moving two leaves the error; "
            "moving three: diverged; moving four: ran"
        ),
    )
    failed = [
        perturbation_and_row("one", 0.0, outcome="diverged"),
        perturbation_and_row("two", 0.0, outcome="diverged"),
    ]
    for nothing in (find_cause(1.0, found, "position"), find_cause(1.0, failed, "velocity")):
        assert nothing[0] == "unknown"
    assert (
        find_cause(1.0, [perturbation_and_row("one", 1 / 1.11)], "velocity")[0] == "one"
    )  # its share is just a fifth
    assert find_cause(1.0, [perturbation_and_row("one", 1 / 1.09)], "velocity")[0] == "unknown"
    for worse in (1.09, 1.11, 9.0):  # not "rounding", which was not perturbed
        assert (
            find_cause(1.0, [perturbation_and_row("time step", worse)], "velocity")[0] == "unknown"
        )


def test_the_time_step_is_no_cause_of_a_floor():
    found = [perturbation_and_row("time step", 0.5), perturbation_and_row("one", 1 / 1.2)]
    assert find_cause(1.0, found, "velocity")[0] == "time step"
    assert find_cause(1.0, found, "velocity", at_floor=True)[0] == "one"
    assert find_cause(1.0, found[:1], "velocity", at_floor=True)[0] == "unknown"
    steps = perturbation_and_row("too few steps in solref", 0.5)
    assert (
        find_cause(1.0, [steps, *found], "velocity", at_floor=True)[0] == "too few steps in solref"
    )


def test_the_improvement_is_the_factor_on_the_error():
    def of(better: bool | None, ratio: float, whole: bool = False) -> float:
        return improvement(Perturbation("", "", {}, better, whole), ratio)

    assert (of(True, 4.0), of(True, 0.25), of(False, 4.0), of(False, 0.25)) == (4, 0.25, 0.25, 4)
    assert (of(None, 4.0), of(None, 0.25)) == (4.0, 4.0)
    assert of(True, 2.0, whole=True) == pytest.approx(1 / (1 - 0.5 / 2))  # its share was 1/2
    assert [format_factor(r) for r in (1.004, 1.006, 0.5)] == [
        "leaves the error",
        "divides the error by 1.01",
        "multiplies the error by 2.00",
    ]


def halved_series(
    engine: str, axis: str, scaled: bool = False, count: int = 2, **parameters
) -> ConvergenceSeries:
    """A series of `count` settings whose parameter `axis` is halved from each to the next.

    If it is `scaled`, `solref` is halved as well.
    """
    return ConvergenceSeries(
        engine,
        "",
        axis,
        tuple(
            Setting(
                engine,
                {
                    axis: 0.1 / 2**k,
                    **({"solref": (1.0 / 2**k, 1.0)} if scaled else {}),
                    **parameters,
                },
            )
            for k in range(count)
        ),
    )


# The orders that the engines derive.  The four-bar starts in motion under gravity, the hacksaw at
# rest without gravity.
@pytest.mark.parametrize(
    ("name", "of", "wanted"),
    [
        ("fourbar", halved_series("mujoco", "timestep", count=1, integrator="RK4"), ((), (), ())),
        ("fourbar", halved_series("mujoco", "iterations"), ((), (), ())),
        ("fourbar", halved_series("mujoco", "solimp"), ((1,), (1,), (1,))),
        ("fourbar", halved_series("mujoco", "solref"), ((2,), (1, 2), (0, 2))),
        ("hacksaw", halved_series("mujoco", "solref"), ((2,), (2,), (2,))),
        ("fourbar", halved_series("pymunk", "error_bias"), ((1,), (1,), (0, 1))),
        ("fourbar_released", halved_series("pymunk", "error_bias"), ((1, 2), (1, 2), (0, 1, 2))),
        ("fourbar", halved_series("pymunk", "timestep"), ((2,), (2,), (2,))),
        ("fourbar", halved_series("pymunk", "timestep", defaults=True), ((1,), (1,), (0, 1))),
        ("pendulum", halved_series("mujoco", "timestep", integrator="RK4"), ((4,), (4,), (4,))),
        (
            "pendulum",
            halved_series("mujoco", "timestep", True, integrator="RK4"),
            ((4,), (4,), (4,)),
        ),
        ("fourbar", halved_series("mujoco", "timestep", integrator="RK4"), ((4,), (4,), (4,))),
        (
            "fourbar",
            halved_series("mujoco", "timestep", True, integrator="RK4"),
            ((2,), (1, 2), (0, 2)),
        ),
        ("fourbar", halved_series("mujoco", "timestep", integrator="Euler"), ((1,), (1,), (1,))),
        ("pendulum", halved_series("mujoco", "timestep", integrator="Euler"), ((1,), (1, 2), (1,))),
        (
            "hacksaw_recorded",
            halved_series("mujoco", "timestep", integrator="Euler"),
            ((1,), (1, 2), (1,)),
        ),
        (
            "fourbar",
            halved_series("mujoco", "timestep", True, integrator="Euler"),
            ((2,), (1,), (0, 1, 2)),
        ),
        (
            "hacksaw",
            halved_series("mujoco", "timestep", True, integrator="Euler"),
            ((2,), (1,), (1, 2)),
        ),
        (
            "fourbar_released",
            halved_series("mujoco", "timestep", True, integrator="Euler"),
            ((1, 2), (1, 2), (0, 1, 2)),
        ),
    ],
)
def test_orders_are_those_of_the_theory(name, of, wanted):
    assert tuple(
        set(expected_orders(load_shipped_case(name), "dynamics", of, kind))
        for kind in ("position", "velocity", "acceleration")
    ) == tuple(map(set, wanted))


def test_rods_energies_and_forces_have_expected_orders():
    rod, segments = load_shipped_case("rod_cantilever"), halved_series("mujoco", "segments")
    assert expected_orders(rod, "equilibrium", segments, "position") == (2.0,)
    naive = {name: table.model_copy(update={"scheme": "naive"}) for name, table in rod.rod.items()}
    assert expected_orders(
        rod.model_copy(update={"rod": naive}), "equilibrium", segments, "position"
    ) == (1.0,)
    softer = halved_series("mujoco", "solref")
    for kind, alike in (("energy", "velocity"), ("force", "acceleration")):
        assert expected_orders(FOURBAR, "dynamics", softer, kind) == expected_orders(
            FOURBAR, "dynamics", softer, alike
        )
    assert (
        expected_orders(FOURBAR, "dynamics", softer, "velocity")[0] == 1.0
    )  # the first order is stated if none was observed


def test_a_jolt_is_a_start_in_motion_or_under_gravity():
    assert starts_with_jolt(load_shipped_case("change_point"))  # in motion, without gravity
    assert starts_with_jolt(load_shipped_case("pendulum"))  # at rest, under gravity
    assert not starts_with_jolt(load_shipped_case("hacksaw"))  # at rest, without gravity


@pytest.mark.parametrize(
    ("motion", "jolt"),
    [((2.0, 0.0, 0.0), False), ((0.0, -1.0, 0.0), True), ((0.0, 0.0, -1.0), True)],
)
def test_a_drive_starts_with_a_jolt_if_it_has_a_rate_or_an_acceleration(motion, jolt, monkeypatch):
    """One of two drives is sufficient; this case has no gravity."""
    moving, resting = (lambda x: tuple(part + 0 * x for part in motion)), lambda x: 3 * (0 * x,)
    own = starts_with_jolt.__globals__  # `proofmass.solve` is a function
    monkeypatch.setitem(own, "drive_profiles", lambda *_: (resting, moving))
    assert starts_with_jolt(load_shipped_case("hacksaw")) == jolt


def test_an_order_is_unexpected_if_it_is_off_by_more_than_0_2():
    assert [is_unexpected(2.0 + by, 2.0) for by in (-0.21, -0.19, 0.19, 0.21, nan)] == [
        True,
        False,
        False,
        True,
        False,
    ]
    assert nearest_order((2.0, 1.0), 1.4) == nearest_order((1.0, 2.0), nan) == 1.0
    assert nearest_order((2.0, 1.0), 1.6) == nearest_order((1.0, 2.0), 1.6) == 2.0
    assert isnan(nearest_order((), nan))
    assert isnan(nearest_order((), 1.0))


def test_bisection_strides_by_at_most_four_and_then_halves():
    """Values go from `start` to `reach` itself, each by a factor of at most 4; then bisection."""

    def tried(start: float, reach: float, edge: float = inf, **how):
        seen = []

        def trial(x: float) -> Failure | None:
            seen.append(x)
            return UNSTABLE_FAILURE if x >= edge else None

        return seen, bisect(trial, start, reach, **how)

    for start, reach in ((2.0, 32.0), (32.0, 2.0)):
        assert tried(start, reach)[0] == pytest.approx([start, 8.0, reach])
    assert tried(2.0, 8.0)[0] == pytest.approx([2.0, 8.0])
    assert tried(2.0, 9.0)[0] == pytest.approx([2.0, 18**0.5, 9.0])
    seen, (holds, breaks, failure) = tried(1.0, 16.0, edge=9.0, within=0.5)
    assert seen == pytest.approx([1.0, 4.0, 16.0, 8.0, 128**0.5])
    assert (holds, breaks) == pytest.approx((8.0, 128**0.5))  # a factor within 1.5
    assert failure == UNSTABLE_FAILURE


def test_a_limit_of_proofmass_itself_is_bisected_to_a_tenth():
    """The limit of proofmass itself is no property of an engine: a tenth is close enough.

    A boundary of the engine before that limit is bisected to 1 % as usual.
    """

    def ours(x: float) -> Failure | None:
        return Failure("late", BoundaryKind.OURS) if x >= 9.0 else None

    holds, breaks, failure = bisect(ours, 1.0, 16.0)
    assert holds < 9.0 <= breaks
    assert 1.01 < breaks / holds <= 1.1
    assert failure.limit == BoundaryKind.OURS
    holds, breaks, failure = bisect(
        lambda x: UNSTABLE_FAILURE if 5.0 <= x < 9.0 else ours(x), 1.0, 16.0
    )
    assert holds < 5.0 <= breaks <= 1.01 * holds
    assert failure == UNSTABLE_FAILURE


def test_bisection_is_fine_if_theory_has_a_boundary():
    """The reference ends at 9, where theory has a boundary; the engine fails from 8.9 on.

    Without the theory bisection would end at a tenth, and the failure at 8.9 would be missed.
    """

    def trial(x: float) -> TrialResult:
        late = Failure("no reference", BoundaryKind.OURS)
        return TrialResult(late if x >= 9.0 else UNSTABLE_FAILURE if x >= 8.9 else None)

    plain = LimitSearch("", "", "", "", "", 1.0, 16.0, trial)
    assert plain.find().unknown  # 8.72 holds, 9.51 is not known: within a tenth
    found = replace(plain, theory=9.0).find()
    assert found.limit == UNSTABLE_FAILURE.limit
    assert found.holds < 8.9 <= found.breaks <= 1.01 * found.holds
    assert replace(plain, theory=np.inf).find().unknown


def test_a_boundary_has_the_fields_of_its_search_and_the_failure():
    sought = LimitSearch(
        "what",
        "mujoco",
        "RK4",
        "parameter",
        "m",
        1.0,
        16.0,
        lambda x: TrialResult(UNSTABLE_FAILURE if x >= 9.0 else None, x / 2),
        9.0,
        "law",
    )
    found = sought.find(0.5)
    assert (
        found.what,
        found.engine,
        found.setting,
        found.parameter,
        found.unit,
        found.start,
        found.reach,
        found.theory,
        found.law,
    ) == ("what", "mujoco", "RK4", "parameter", "m", 1.0, 16.0, 9.0, "law")
    assert (found.holds, found.breaks) == pytest.approx((8.0, 128**0.5))
    assert (found.failure, found.limit, found.silent) == UNSTABLE_FAILURE
    assert found.step == found.holds / 2
    assert found.found
    assert not found.unknown
    assert found.measured == pytest.approx(8.0 * 2**0.25)
    assert found.ratio == pytest.approx(8.0 * 2**0.25 / 9.0)
    whole = LimitSearch("", "", "", "", "", 1.0, 2.0, lambda x: TrialResult()).find()
    assert (whole.failure, whole.silent, whole.found, whole.limit) == ("", False, False, "holds")
    assert isnan(whole.step)


def test_a_limit_of_proofmass_itself_is_no_boundary():
    place = ("", "", "", "", "", 1.0, 9.0)
    ours = Boundary(
        *place, 2.0, 3.0, theory=2.5, limit=BoundaryKind.OURS, failure="no reference: at 3"
    )
    assert (ours.found, ours.unknown, ours.ending) == (False, True, "ours: no reference: at 3")
    assert isnan(ours.measured)
    assert isnan(ours.ratio)
    assert Boundary(*place, 2.0, 3.0, limit=BoundaryKind.UNSTABLE).found
    assert isnan(Boundary(*place, 2.0, 3.0, theory=0.0).ratio)
    assert isnan(Boundary(*place, 2.0, 3.0, theory=inf).ratio)
    assert Boundary("", "", "", "", "", 9.0, 1.0, 1.0).measured == 0.0


def test_a_message_is_an_engine_warning_only_if_it_starts_as_one():
    assert is_engine_warning("MuJoCo warning badqacc")
    assert not is_engine_warning("no MuJoCo warning")


def test_the_pareto_front_has_only_settings_that_ran():
    def of(value, seconds, error, kind="velocity", outcome="ran"):
        return StudyRow(
            "", "", "", "", "", "", value, errors={kind: error}, seconds=seconds, outcome=outcome
        )

    rows = [
        of(1, 2.0, 0.1),
        of(2, 1.0, 0.2),
        of(3, 3.0, 0.2),
        of(4, 0.5, 0.01, outcome="stopped"),
        of(5, 0.1, 0.01, "position"),
        of(6, 0.0, 0.01),
        of(7, 9.0, 0.0),
        of(8, nan, 0.0),
        of(9, 0.1, nan),
        of(10, 0.1, -1.0),
    ]
    assert [found.value for found in pareto_front(rows, "velocity")] == [2, 1, 7]
    assert pareto_front([], "velocity") == []


def points_of_halved_sizes(*errors: float) -> list[tuple[float, float]]:
    """Points with these errors, at sizes each of which is half of the previous one."""
    return [(2.0**-k, error) for k, error in enumerate(errors)]


def points_of_orders(*slopes: float) -> list[tuple[float, float]]:
    """Points whose errors fall with these orders from each refinement to the next."""
    return points_of_halved_sizes(*(2.0 ** -sum(slopes[:k]) for k in range(len(slopes) + 1)))


@pytest.mark.parametrize(
    ("points", "first", "least", "before"),
    [
        (points_of_halved_sizes(1.0), None, nan, 1),
        (
            points_of_halved_sizes(1.0, 1.0),
            None,
            nan,
            0,
        ),  # these may become a plateau with one more point
        (points_of_halved_sizes(1.0, 1.0, 1.0), 0, 1.0, 0),
        (points_of_halved_sizes(1.0, 0.7, 0.5), None, nan, 0),  # order 1/2: the error falls
        (points_of_halved_sizes(1.0, 0.7, 0.51), 0, 0.51, 0),
        (points_of_halved_sizes(1.0, 1.0, 0.9, 0.3), None, nan, 4),
        (points_of_halved_sizes(100.0, 11.0, 1.0, 1.1, 1.0), 2, 1.0, 2),
        (
            points_of_halved_sizes(100.0, 10.0, 1.0, 1.1, 1.0),
            2,
            1.0,
            1,
        ),  # 10 times the least error is near it
        (
            points_of_halved_sizes(100.0, 11.0, 1.1, 1.0),
            None,
            nan,
            2,
        ),  # one refinement without a fall
        (points_of_halved_sizes(100.0, 9.0, 1.1, 1.0), None, nan, 1),
        (points_of_halved_sizes(100.0, 10.5, 1.0, 1.1), None, nan, 2),
        (points_of_halved_sizes(100.0, 11.0, 1.0, 2.0, inf, inf), 2, 1.0, 2),
        (points_of_halved_sizes(100.0, 11.0, 2.0, 1.0, inf, inf), 2, 1.0, 2),
        (points_of_halved_sizes(inf, 4.0, 1.0), None, nan, 2),
    ],
)
def test_the_slowdown_of_an_error_and_the_points_before_it_are_found(points, first, least, before):
    assert find_slowdown(points) == first
    assert slowdown_error(points) == pytest.approx(least, nan_ok=True)
    assert points_before_slowdown(points) == [p for p in points if p[1] < inf][:before]


@pytest.mark.parametrize(
    ("errors", "place"),
    [
        ((0.8, 0.81, 0.8, 0.8), None),  # the error of another motion
        ((0.011, 0.011, 0.011), None),
        ((9e-3, 9e-3, 9e-3), 0),
        ((1e-3, 1e-3), 0),  # the series ends there
        ((1e-3,), None),
        ((1e-3, 0.94e-3), None),
        ((1e-3, 0.96e-3), 0),
        ((4e-3, 1e-3, 1e-3, 1e-3, 1e-3), 2),  # of several flat points, the last with two after it
        ((1e-3, 1e-3, 1e-4, 1e-5), None),
        ((1e-3, 1e-3, inf), None),
    ],
)
def test_a_possible_floor_is_asymptotic_and_flat_to_the_end(errors, place):
    assert find_flat_point(points_of_halved_sizes(*errors)) == place


@pytest.mark.parametrize(
    ("slopes", "seen"),
    [
        ((2.0, 2.0, 1.0, 1.0), 1.0),  # the finest two orders
        ((1.0, 1.0, 2.0, 1.0), 1.0),
        ((1.92, 2.08), 2.0),
        ((1.85, 2.15), nan),  # they differ by more than a twentieth of their sum
        ((0.7, 0.78), 0.74),
        ((0.7, 0.82), nan),
        ((2.0,), nan),
    ],
)
def test_an_observed_order_needs_two_successive_equal_orders(slopes, seen):
    assert observed_order(points_of_orders(*slopes)) == pytest.approx(seen, nan_ok=True)


def measured_series(*rows: StudyRow) -> MeasuredSeries:
    """A series of four steps with these rows."""
    return MeasuredSeries(halved_series("mujoco", "timestep", count=4), list(rows))


def study_row(outcome: str = "ran", seconds: float = 0.1, **errors: float) -> StudyRow:
    """A row with an outcome, a processor time [s], and errors by kind."""
    return StudyRow(
        "trade",
        "",
        "dynamics",
        "mujoco",
        "",
        "timestep",
        0.0,
        {},
        errors,
        seconds=seconds,
        outcome=outcome,
    )


@pytest.mark.parametrize("failed", ["diverged", "not finite", "crashed", "no reference"])
def test_failed_settings_are_points_with_an_infinite_error(failed):
    measured = measured_series(
        study_row(velocity=0.05),
        study_row("stopped", velocity=0.04),
        study_row(failed),
        study_row(velocity=0.0),
    )
    assert measured.points("velocity") == [(0.1, 0.05), (0.025, inf)]
    assert [measured.place(size) for size in measured.series.sizes] == [0, 1, 2, 3]
    coarse = measured_series(
        study_row(velocity=0.1),
        study_row("diverged"),
        study_row(velocity=0.09),
        study_row(velocity=9.0),
    )
    assert coarse.points("velocity") == [(0.025, 0.09), (0.0125, 9.0)]
    assert measured_series(
        study_row(velocity=0.1), study_row("crashed"), study_row(velocity=0.2)
    ).points("velocity") == [
        (0.1, 0.1),
        (0.025, 0.2),
    ]
    assert measured_series(study_row(velocity=0.1)).points("position") == []


def test_a_series_continues_until_no_kind_of_error_falls():
    one, two = study_row(velocity=1e-3, position=1e-3), study_row(velocity=1e-3, position=1e-6)
    assert not measured_series(one, one).done(1.0)
    assert measured_series(one, one, one).done(1.0)
    assert not measured_series(one, one, two).done(1.0)  # position errors still fall
    assert measured_series(one, one, two).kinds == ["velocity", "position"]
    assert measured_series(one, two, two, two).done(1.0)  # no more settings
    far, jolt = study_row(velocity=0.5, position=0.8), study_row(velocity=0.5, position=1e-3)
    assert not measured_series(far, far, far).done(
        1.0
    )  # the error of another motion, which may become right at a smaller step
    assert measured_series(jolt, jolt, jolt).done(1.0)  # positions are accurate, velocities are not
    assert not measured_series().done(1.0)
    assert not measured_series(
        study_row("diverged"), study_row("diverged"), study_row("diverged")
    ).done(1.0)
    assert not measured_series(study_row(seconds=1.0)).done(1.0)
    assert measured_series(study_row(seconds=1.1)).done(1.0)
    assert measured_series(study_row("unsupported")).done(1.0)
    assert measured_series(study_row("timed out")).done(1.0)


INACCURATE, UNSTABLE, OURS = BoundaryKind.INACCURATE, BoundaryKind.UNSTABLE, BoundaryKind.OURS


@pytest.mark.parametrize(
    ("found", "message", "limit", "silent"),
    [
        (Measurement({"position": 0.1, "force": 0.1, "velocity": 9.0}), None, None, False),
        (Measurement(), None, None, False),
        (Measurement({"position": 0.111}), "position off by 0.11 of its range", INACCURATE, True),
        (
            Measurement({"force": 0.222}),
            "force or torque off by 0.22 of its range",
            INACCURATE,
            True,
        ),
        (Measurement({"position": nan}), "position off by nan of its range", INACCURATE, True),
        (
            Measurement(outcome="diverged", message="MuJoCo warning x"),
            "diverged: MuJoCo warning x",
            UNSTABLE,
            False,
        ),
        (Measurement(outcome="diverged", message="open"), "diverged: open", UNSTABLE, True),
        (Measurement(outcome="not finite", message="x at 3"), "not finite: x at 3", UNSTABLE, True),
        (Measurement(outcome="stopped", message="x"), "stopped: x", UNSTABLE, False),
        (
            Measurement(outcome="crashed", message="killed by signal 6: x"),
            "crashed: killed by signal 6: x",
            UNSTABLE,
            False,
        ),
        (
            Measurement(outcome="crashed", message="ValueError: x"),
            "crashed: ValueError: x",
            OURS,
            False,
        ),
        (Measurement(outcome="refused", message="x"), "refused: x", BoundaryKind.REFUSED, False),
        *(
            (Measurement(outcome=word, message="x"), f"{word}: x", OURS, False)
            for word in (
                "not solved",
                "no start",
                "no reference",
                "timed out",
                "out of memory",
                "unsupported",
            )
        ),
    ],
)
def test_a_failure_has_its_kind_and_whether_the_engine_warned(found, message, limit, silent):
    assert find_failure(found, "sweep") == (
        None if message is None else Failure(message, limit, silent)
    )


def test_only_positions_are_judged_in_dynamics():
    """In dynamics the error of a moment exceeds a tenth long before the motion is wrong."""
    found = Measurement({"position": 0.05, "force": 0.5})
    assert find_failure(found, "dynamics") is None
    assert find_failure(found, "sweep").message.startswith("force or torque off by 0.5")


def test_every_kind_of_limit_has_its_sentence():
    assert len({limit.sentence for limit in BoundaryKind}) == len(BoundaryKind) == 5


def raising(error: Exception):
    """A function that raises an exception, whatever its arguments are."""

    def call(*_, **__):
        raise error

    return call


def test_an_untimed_run_gives_its_measurement_or_an_outcome(monkeypatch):
    task = StudyRun(FOURBAR, "sweep", Setting("mujoco"))
    calls = []

    def answer(function, *args, timeout, memory):
        calls.append((function.__name__, args, timeout))
        return Measurement(steps=7)

    monkeypatch.setattr(measure, "call_isolated", answer)
    assert measure_untimed(task, 5.0) == Measurement(steps=7)
    assert calls == [("observe", (task, False, None), 5.0)]
    for error, outcome in (
        (Diverged("why"), "diverged"),
        (Crashed("why"), "crashed"),
        (BadModel("why"), "no start"),
        (Unsupported("why"), "unsupported"),
        (NotSolved("why"), "not solved"),
    ):
        monkeypatch.setattr(measure, "call_isolated", raising(error))
        assert measure_untimed(task, 5.0) == Measurement(outcome=outcome, message="why")


@pytest.mark.parametrize("engine_too", [True, False])
def test_a_timeout_is_attributed_to_the_engine_or_the_reference(engine_too, monkeypatch):
    task, calls = StudyRun(FOURBAR, "sweep", Setting("pymunk", {"iterations": 7})), []

    def late(function, *args, timeout, memory):
        calls.append((function.__name__, args, timeout))
        if engine_too or function.__name__ == "observe":
            raise TimedOut("late")

    monkeypatch.setattr(measure, "call_isolated", late)
    assert measure_untimed(task, 5.0) == (
        Measurement(outcome="timed out", message="late")
        if engine_too
        else Measurement(outcome="no reference", message="late; the engine has its run")
    )
    assert calls[1] == ("simulate_task", (task,), 60.0)
    monkeypatch.setattr(
        measure, "call_engine", lambda engine, model, run: (engine, model, run.kind, run.settings)
    )
    assert measure.simulate_task(task) == ("pymunk", FOURBAR.model_path, "sweep", {"iterations": 7})


def test_a_stressed_case_varies_a_parameter(tmp_path, monkeypatch):
    asked = []

    def found(study, task, make):
        asked.append((task, study.store, study.limit(task), make))
        return Measurement({"position": 0.5})

    monkeypatch.setattr(Study, "measure_one", found)
    own = StressedCase(
        FOURBAR,
        "dynamics",
        Setting("mujoco", {"integrator": "RK4", "timestep": 0.5}),
        Study(Store(tmp_path), longest=9.0),
    )
    assert own.find_failure(FOURBAR, timestep=0.25) == Failure(
        "position off by 0.5 of its range", INACCURATE, True
    )
    setting = Setting("mujoco", {"integrator": "RK4", "timestep": 0.25})
    assert asked == [
        (
            StudyRun(FOURBAR, "dynamics", setting, "stress", timed=False),
            own.study.store,
            9.0,
            limit_search.measure_untimed,
        )
    ]
    monkeypatch.setattr(Study, "measure_one", raising(InputError(Path("x"), "key", "why")))
    for compiles, outcome, limit in (
        (True, "no start", OURS),
        (False, "refused", BoundaryKind.REFUSED),
    ):
        monkeypatch.setattr(limit_search, "can_compile", lambda case, answer=compiles: answer)
        assert own.run(FOURBAR) == Measurement(outcome=outcome, message="why")
        assert own.find_failure(FOURBAR) == Failure(f"{outcome}: why", limit)
        planar = replace(own, setting=Setting("pymunk"))
        assert planar.find_failure(FOURBAR) == Failure("no start: why", OURS)

    def trial(parameters, x):
        return TrialResult(Failure(f"{parameters} {x}", UNSTABLE))

    assert [
        (
            s.what,
            s.engine,
            s.setting,
            s.parameter,
            s.unit,
            s.start,
            s.reach,
            s.trial(3.0).failure.message,
        )
        for s in own.search_schemes(
            "step",
            "s",
            1.0,
            2.0,
            trial,
            [one for one in own.engine.theory.schemes if one.name in ("Euler", "RK4")],
        )
    ] == [
        ("fourbar", "mujoco", words, "step", "s", 1.0, 2.0, f"{{'integrator': '{words}'}} 3.0")
        for words in ("Euler", "RK4")
    ]
    planar = StressedCase(FOURBAR, "dynamics", Setting("pymunk"), Study(Store(tmp_path)))
    (one,) = planar.search_schemes("step", "s", 1.0, 2.0, trial, ("Euler", "RK4"))
    assert (
        one.engine,
        one.setting,
        one.parameter,
        one.unit,
        one.start,
        one.reach,
        one.trial(3.0).failure.message,
    ) == ("pymunk", "as in the model", "step", "s", 1.0, 2.0, "{} 3.0")
    more = own.search("k", "m", 1.0, 2.0, raising(KeyError()), theory=7.0, law="law")
    assert (more.setting, more.theory, more.law) == ("RK4", 7.0, "law")
    assert planar.search("k", "m", 1.0, 2.0, raising(KeyError()), "words").setting == "words"


def test_a_run_is_looked_for_in_the_store_first(tmp_path, monkeypatch):
    task = StudyRun(FOURBAR, "sweep", Setting("mujoco"))
    study = Study(Store(tmp_path), longest=5.0)

    def make(task: StudyRun, timeout: float) -> Measurement:
        return Measurement(steps=int(timeout))

    assert study.measure_one(task, make).steps == 5
    assert study.measure_one(task, raising(KeyError())).steps == 5
    with pytest.raises(KeyError):
        study.measure_one(replace(task, run="dynamics"), raising(KeyError()))


def test_requirements_of_an_extreme_are_checked():
    require([1], "why")
    with pytest.raises(NotApplicable, match=r"^why$"):
        require([], "why")
    assert reference_follows_masses(FOURBAR)  # it has as many drives as degrees of freedom
    assert reference_follows_masses(
        load_shipped_case("fourbar_released")
    )  # the reference reads the model
    assert not reference_follows_masses(load_shipped_case("pendulum"))
    assert not reference_follows_masses(FOURBAR.model_copy(update={"drive": FOURBAR.drive * 2}))


def monitored_run_of(allowed: dict[str, float], before: dict[str, list[float]]) -> MonitoredRun:
    """A monitored run with allowed changes and original curves of its channels."""
    x = np.arange(len(next(iter(before.values()))))
    return MonitoredRun(
        "",
        Run("dynamics", x, ()),
        {n: np.full(x.size, a) for n, a in allowed.items()},
        Curves(x, {n: np.array(values) for n, values in before.items()}),
    )


def test_channel_changes_are_ratios_to_the_allowed_changes():
    monitored = monitored_run_of(
        {"one": 0.5, "two[0]": 2.0, "still": 1.0},
        {"one": [1.0, 2.0], "two[0]": [0.0, 4.0], "still": [3.0, 3.0]},
    )

    def of(optional: str = "", **after: list[float]):
        channels = {n.replace("two", "two[0]"): np.array(v) for n, v in after.items()}
        return moved_over(monitored, Curves(np.zeros(2), channels), {optional})

    assert of(one=[1.0, 1.5], two=[1.0, 0.0], still=[3.0, 3.0]) == {
        "one": 1.0,
        "two[0]": 2.0,
        "still": 0.0,
    }
    gone = of(one=[1.0, 2.0])
    assert gone == {"one": 0.0, "two[0]": inf, "still": inf}
    assert of("still", one=[1.0, 2.0])["still"] == 0.0  # it was constant before as well
    assert of("two", one=[1.0, 2.0])["two[0]"] == 2.0  # it was not constant before
    assert of(one=[1.0])["one"] == inf  # the run ended early
    longer = MonitoredRun("", monitored.run, {"one": np.full(1, 0.5)}, monitored.before)
    assert scene.channel_changes(
        replace(longer, before=Curves(np.zeros(2), {"one": np.array([1.0, 9.0])})),
        Curves(np.zeros(1), {"one": np.array([1.25])}),
        set(),
    ) == {"one": 0.5}


def test_the_scale_of_a_channel_is_that_of_its_sensor():
    curves = Curves(
        np.zeros(2),
        {
            "a[0]": np.array([1.0, -3.0]),
            "a[1]": np.array([2.0, 0.0]),
            "b": np.array([9.0, 0.0]),
            "c": np.array([1e-9, -1e-9]),
        },
    )
    assert [scene.sensor_scale(curves, name) for name in curves.channels] == [3.0, 3.0, 9.0, 1.0]


def test_a_scene_leaves_out_default_settings_and_flexes():
    run = FOURBAR.run["sweep"].model_copy(
        update={
            "solvers": (
                "mujoco",
                "mujoco:default",
                "mujoco:flex",
                "mujoco:fine",
                "pymunk",
                "mujoco2",
            )
        }
    )
    case = FOURBAR.model_copy(
        update={
            "run": {"sweep": run},
            "settings": {"mujoco:flex": {"flex": True}, "mujoco:fine": {}},
        }
    )
    assert scene.mujoco_solvers(case, "sweep") == ["mujoco", "mujoco:fine"]


def test_a_channel_may_change_by_a_tenth_of_tolerance_minus_error(monkeypatch):
    """The allowed change is a tenth of the tolerance minus the error.

    It is a rounding share of the channel's largest value if the channel has no tolerance, or if its
    error is beyond the tolerance.
    """
    case, edited = (
        load_shipped_case("pendulum"),
        read_model(load_shipped_case("pendulum").model_path),
    )
    x = np.linspace(0.0, 1.0, 3)
    truth = {name: np.array([0.0, 1.0, 2.0]) for name in case.channels}
    off = {"angle": 5e-11, "rate": 9.0, "acceleration": 0.0, "kinetic": 0.0, "potential": 0.0}
    curves = Curves(x, {name: truth[name] + np.array([0.0, off[name], 0.0]) for name in truth})
    asked = []

    def done(file, model, run):
        asked.append((file, model.nq, run.kind))
        return curves

    monkeypatch.setattr(scene, "run_original", done)
    monkeypatch.setattr(scene, "call_bounded", lambda case, kind, function, *told: function(*told))
    monkeypatch.setattr(
        scene,
        "reference_for",
        lambda *told: Curves(x, truth if told == (case, "dynamics", curves) else {}),
    )
    run = plan_run(case, "dynamics", "mujoco")
    monitored = scene.monitor_run(case, run, "mujoco", edited)
    assert asked == [(case.model_path, 1, "dynamics")]
    assert (monitored.name, monitored.run, monitored.before) == ("pendulum dynamics", run, curves)
    # The tolerance is 1e-10 of a range of 2.  Allowed is a tenth of the tolerance minus the error,
    # or 1e-9 of the largest value.
    wanted = {"angle": 2e-9, "rate": 1e-8, "acceleration": 2e-9, "kinetic": 2e-9, "potential": 2e-9}
    for name, most in wanted.items():
        assert monitored.allowed[name] == pytest.approx(np.full(3, most), rel=1e-9, abs=0)
    loose = scene.monitor_run(case, run, "pymunk:fine", edited)
    assert loose.name == "pendulum dynamics, fine"
    assert loose.allowed["angle"] == pytest.approx(
        np.full(3, 2e-9), rel=1e-6, abs=0
    )  # no tolerance applies
    soft = scene.monitor_run(case, run, "pymunk", edited)  # relative_to_range = 1e-4
    assert soft.allowed["angle"] == pytest.approx(
        np.full(3, 0.1 * (2e-4 - 5e-11)), rel=1e-12, abs=0
    )
    assert soft.allowed["rate"] == pytest.approx(np.full(3, 1e-8), rel=1e-6, abs=0)


def entry(outcome: str, **more):
    """An entry of the table of a diet."""
    return Entry("kind", "name", outcome, **more)


def diet_scene(*monitored_runs: MonitoredRun, edited: object = "whole") -> DietScene:
    """The scene of a model with these runs."""
    return DietScene(edited, monitored_runs, None, set())


def answering_in_turn(calls: list, *answers):
    """A stand-in for `call_isolated` that records its calls in `calls`.

    It returns the answers in order, or raises those that are exceptions.
    """
    queue = list(answers)

    def call(function, *args, timeout, memory=None):
        calls.append((function.__name__, *args, timeout))
        if isinstance(answer := queue.pop(0), Exception):
            raise answer
        return answer

    return call


class ModelWithProbe:
    """A stand-in for an edited model with a probe, which adds a rod to those of a run."""

    added_sensors: ClassVar = {"probe"}
    monitored = ()

    def segmented(self, rods):
        return (*rods, "cut")


@pytest.mark.parametrize(
    ("value", "outcome"), [(1.5, "harmless"), (1.6, "matters"), (nan, "matters")]
)
def test_a_feature_matters_if_a_channel_changes_more_than_allowed(value, outcome, monkeypatch):
    quick, slow = (replace(monitored_run_of({"y": 0.5}, {"y": [1.0]}), name=name) for name in "ab")
    slow = replace(slow, before=replace(slow.before, seconds=2.0))
    calls: list = []
    monkeypatch.setattr(
        measure,
        "call_isolated",
        answering_in_turn(
            calls,
            Curves(np.zeros(1), {"y": np.array([1.0])}),
            Curves(np.zeros(1), {"y": np.array([value])}),
        ),
    )
    found = RecordingSearch(diet_scene(quick, slow), unkept_study()).judge_changes(
        ["one", "two"], ModelWithProbe()
    )
    assert found[0] == outcome
    assert found[1] == {"a": {"y": 0.0}, "b": {"y": pytest.approx((value - 1) / 0.5, nan_ok=True)}}
    assert found[2] == ""
    assert calls == [
        ("attempt", "one", replace(quick.run, rods=("cut",)), 30.0),
        ("attempt", "two", replace(slow.run, rods=("cut",)), 40.0),
    ]


def test_a_feature_whose_removal_fails_has_the_outcome_of_the_failure(monkeypatch):
    monitored = replace(monitored_run_of({"probe": 0.5}, {"probe": [1.0]}), name="a")
    gone = Curves(np.zeros(1), {})
    for error, outcome in (
        (BadModel("why"), "needed"),
        (Diverged("why"), "diverged"),
        (TimedOut("why"), "timed out"),
    ):
        monkeypatch.setattr(measure, "call_isolated", answering_in_turn([], gone, error))
        assert RecordingSearch(diet_scene(monitored, monitored), unkept_study()).judge_changes(
            [1, 2], ModelWithProbe()
        ) == (
            outcome,
            {"a": {"probe": 0.0}},
            "why",
        )  # the probe is missing in the first run and was constant before: a change of 0


class NamesOfRemoved(list):
    """A stand-in for an edited model: the list of the names of removed features."""

    def without(self, cut):
        edited = NamesOfRemoved(self)
        cut(edited)
        return edited

    def compiled(self, rods):
        if "fatal" in self:
            raise mujoco.FatalError("Error:  two\n words")
        return "model", *self, *rods

    def segmented(self, rods):
        return (*rods, "cut")


def feature(name: str, *parts: Feature, kind: str = "geom") -> Feature:
    """A feature whose removal adds its name to a model; that of "wrong" raises an exception."""

    def cut(edited):
        if name == "wrong":
            raise ValueError("Error: it is named")
        edited.append(name)

    return Feature(kind, name, cut, parts)


class RecordingStore:
    """A store that keeps no results, and records the keys that it is asked for."""

    def __init__(self):
        self.asked, self.models, self.keys = [], [], []


def unkept_study(**how) -> Study:
    """A study that keeps no results."""
    return Study(RecordingStore(), **how)


class RecordingSearch(diet.DietSearch):
    """A search that records what its results depend on, and makes all of them."""

    @property
    def store(self) -> RecordingStore:
        return self.study.store

    def once(self, models, runs, make):
        self.store.keys.append((models, runs))
        return make()


class SearchByNames(RecordingSearch):
    """A search that judges by names: a model is harmless if no removed feature is called "bad"."""

    def judge_changes(self, models, edited):
        self.store.asked.append(list(edited))
        self.store.models.append(models)
        return "matters" if "bad" in " ".join(edited) else "harmless", {"a": {"y": 0.5}}, "said"


def search(scene: DietScene, study: Study | None = None, **how) -> SearchByNames:
    """A search that judges by names and times nothing."""
    return SearchByNames(scene, study or unkept_study(workers="workers"), rounds=0, **how)


def test_a_feature_is_tried_without_the_features_removed_before():
    monitored = monitored_run_of({"y": 0.5}, {"y": [1.0]})
    monitored = replace(monitored, name="a", run=replace(monitored.run, rods=("rod",)))
    said: list[tuple] = []
    own = search(
        diet_scene(monitored, monitored),
        unkept_study(progress=lambda *told: said.append(told)),
    )
    edited, found = own.tried(NamesOfRemoved(["old"]), feature("new"))
    assert edited == ["old", "new"]
    assert found == Entry("geom", "new", "harmless", {"a": {"y": 0.5}}, "said")
    assert said == [("geom new", 0, 0)]
    assert own.store.models == [[("model", "old", "new", "rod")] * 2]
    assert own.store.keys == [
        (
            [("model", "old", "new", "rod")] * 2,
            [("a", monitored.run, monitored.allowed, monitored.before.channels)] * 2,
        )
    ]
    for name, words in (("wrong", "it is named"), ("fatal", "two words")):
        now = NamesOfRemoved(["old"])
        edited, found = own.tried(now, feature(name))
        assert edited is now
        assert found == Entry("geom", name, "needed", message=words)


def test_parts_are_tried_if_the_whole_cannot_be_removed():
    own = search(diet_scene())
    both = feature("bad", feature("bad one"), feature("two"), feature("three", feature("four")))
    found = own.try_with_parts(NamesOfRemoved(), both)
    assert [(f.name, e.outcome) for f, e in found] == [
        ("bad one", "matters"),
        ("two", "harmless"),
        ("three", "harmless"),
    ]
    assert own.try_with_parts(NamesOfRemoved(), feature("bad"))[0][1].outcome == "matters"
    assert [
        f.name for f, _ in own.try_with_parts(NamesOfRemoved(), feature("all", feature("part")))
    ] == ["all"]


def test_geoms_that_are_only_drawn_are_harmless_if_nothing_is_drawn():
    for blind, outcome in ((False, "drawn"), (True, "harmless")):
        own = search(diet_scene(), blind=blind)
        assert (
            own.try_with_parts(NamesOfRemoved(), feature("x", kind=DRAWN_GEOM))[0][1].outcome
            == outcome
        )
        assert (
            own.try_with_parts(NamesOfRemoved(), feature("bad", kind=DRAWN_GEOM))[0][1].outcome
            == "matters"
        )


def test_features_with_a_final_outcome_are_not_tried_again():
    own = search(diet_scene())
    for outcome, tried in (("matters", 0), ("drawn", 0), ("harmless", 1), ("needed", 1)):
        own.found = {("geom", "x"): entry(outcome)}
        assert len(own.try_with_parts(NamesOfRemoved(), feature("x"))) == tried
        assert len(own.try_with_parts(NamesOfRemoved(), feature("other"))) == 1


def test_as_many_features_as_possible_are_removed_together(monkeypatch):
    own = search(diet_scene())
    a, b, c = feature("a"), feature("b"), feature("c")
    assert own.together(NamesOfRemoved(["old"]), [a, b]) == ["old", "a", "b"]
    assert own.store.asked == [["old", "a", "b"]]
    monkeypatch.setattr(
        SearchByNames,
        "judge_changes",
        lambda self, models, edited: (
            "matters" if {"a", "b"} <= set(edited) else "harmless",
            {},
            "",
        ),
    )
    assert own.together(NamesOfRemoved(["old"]), [a, b, c]) == ["old", "a", "c"]


def test_a_diet_repeats_until_no_feature_can_be_removed(monkeypatch):
    """The second feature appears after the first was removed; one that matters is tried once."""

    def there(reduced, scene):
        yield feature("bad")
        if "a" not in reduced:
            yield feature("a")
        elif "b" not in reduced:
            yield feature("b")

    monkeypatch.setattr(diet, "list_features", there)
    own = search(diet_scene(edited=NamesOfRemoved()))
    found = own.run()
    assert found.reduced == ["a", "b"]
    assert [(e.name, e.outcome) for e in found.entries] == [
        ("bad", "matters"),
        ("a", "harmless"),
        ("b", "harmless"),
    ]
    assert found.whole == Entry("all of these", "", "harmless", {"a": {"y": 0.5}}, "said")
    assert own.store.asked[:5] == [["bad"], ["a"], ["a"], ["a", "b"], ["a", "b"]]
    assert ["bad"] not in own.store.asked[1:]


def test_the_models_before_and_after_a_removal_are_timed(monkeypatch):
    own = search(diet_scene(edited=NamesOfRemoved(["all"])))
    monkeypatch.setattr(
        SearchByNames, "timed", lambda self, now, edited, entry, tuned=False: (now, edited)
    )
    assert own.try_with_parts(NamesOfRemoved(["old"]), feature("new"))[0][1] == (
        ["old"],
        ["old", "new"],
    )

    def none(reduced, scene):
        assert scene is own.scene
        return iter(())

    monkeypatch.setattr(diet, "list_features", none)
    assert own.run().whole == (["all"], ["all"])


def test_a_search_without_workers_opens_a_pool_while_it_runs(monkeypatch):
    @contextmanager
    def opened():
        yield "workers"

    monkeypatch.setattr("proofmass.studies.study.pool", opened)
    monkeypatch.setattr(diet, "list_features", lambda reduced, scene: iter(()))
    seen = []
    monkeypatch.setattr(
        SearchByNames,
        "tried",
        lambda self, now, feature, tuned: seen.append(self.study.workers) or (now, entry("needed")),
    )
    assert (
        search(diet_scene(edited=NamesOfRemoved()), unkept_study()).run().whole.outcome == "needed"
    )
    assert set(seen) == {"workers"}


def test_costs_of_a_step_are_compared_with_and_without_a_feature(monkeypatch):
    long, short = (monitored_run_of({"y": 0.5}, {"y": [0.0] * 9}) for _ in range(2))
    long = replace(
        long,
        run=replace(long.run, rods=("rod",)),
        before=replace(long.before, seconds=40.0, steps=9 * 250),
    )
    asked = []

    def raced(models, run, rounds, limit):
        asked.append((models, run.x.size, run.rods, rounds, limit))
        return CostComparison((Cost(2.0, 3), Cost(1.0, 2)), (0.4, 0.5, 0.6))

    monkeypatch.setattr(diet, "compare_costs_isolated", raced)
    own = RecordingSearch(diet_scene(short, long), unkept_study(), rounds=3)
    now, edited = NamesOfRemoved(["old"]), NamesOfRemoved(["old", "new"])
    for outcome in ("harmless", "drawn", "matters"):
        assert own.timed(now, edited, entry(outcome)) == entry(
            outcome, costs=(Cost(2.0, 3), Cost(1.0, 2)), saved=(0.4, 0.5, 0.6)
        )
    assert own.timed(now, edited, entry("needed")) == entry("needed")
    assert replace(own, rounds=0).timed(now, edited, entry("drawn")) == entry("drawn")
    models = ("model", "old", "rod"), ("model", "old", "new", "rod")
    # The run is cut to two samples, the least number.  The limit of processor time is 20 times
    # that of the original run, for each of the 3 rounds.
    assert asked == [(models, 2, ("rod", "cut"), 3, 3 * 20 * 40.0)] * 3
    kept_as, (run, rounds) = own.store.keys[0]
    assert (tuple(kept_as), run.x.size, rounds) == (models, 2, 3)
    quick = RecordingSearch(diet_scene(short), unkept_study(), rounds=1)
    quick.timed(now, edited, entry("drawn"))
    assert asked[-1][-1] == 20 * 30.0


def test_combined_features_are_removed_as_one():
    whole = diet.combine_features([feature("a"), feature("b")])
    edited = NamesOfRemoved()
    whole.cut(edited)
    assert (whole.kind, whole.name, edited) == ("all of these", "", ["a", "b"])


BOB_MODEL = """<mujoco><option timestep="{step}"/><worldbody><body><joint name="hinge"/>
  <geom size=".1" pos="0 1 0"/></body></worldbody><keyframe>{keys}</keyframe></mujoco>"""


def write_bob(
    folder: Path, step: float = 0.01, keys: str = '<key name="first"/><key name="start"/>'
):
    """Write the model of a pendulum without a sidecar; its path."""
    file = folder / "bob.xml"
    file.write_text(BOB_MODEL.format(step=step, keys=keys))
    return file


def release_bob(file: Path, seconds: float, monkeypatch, nudge_change=None, **channels):
    """The monitored free motion of a model, and the runs that were made for it.

    Runs are replaced by constant `channels`; `nudge_change(x)` is added to them in the nudged run.
    """
    asked = []

    def run_constant(file, model, run, nudge=0.0):
        asked.append((file, model.nq, run, nudge))
        more = (
            (np.zeros(run.x.size) if nudge_change is None else nudge_change(run.x))
            if nudge
            else 0.0
        )
        return Curves(
            run.x, {name: values + np.zeros(run.x.size) + more for name, values in channels.items()}
        )

    monkeypatch.setattr(scene, "run_original", run_constant)
    return scene.monitor_free_motion(file, read_model(file, probing=True), seconds), asked


@pytest.mark.parametrize(
    ("seconds", "step", "stride", "n"),
    [
        (1.0, 0.01, 1, 101),
        (0.03, 0.01, 1, 4),
        (0.001, 0.01, 1, 2),
        (4.99, 0.01, 1, 500),
        (5.0, 0.01, 1, 501),
        (10.0, 0.01, 2, 501),
        (10.01, 0.01, 2, 501),
        (12.0, 0.01, 2, 601),
    ],
)
def test_a_free_motion_has_about_500_samples(seconds, step, stride, n, tmp_path, monkeypatch):
    file = write_bob(tmp_path, step)
    monitored, asked = release_bob(file, seconds, monkeypatch, hinge=2.0)
    assert monitored.name == "let go"
    assert [(f, nq, nudge) for f, nq, _, nudge in asked] == [(file, 1, 0.0), (file, 1, 1e-12)]
    run = asked[0][2]
    assert (run.kind, run.start, run.channels, run.drives) == ("passive", "start", (), ())
    assert run.x == pytest.approx(step * stride * np.arange(n), abs=1e-12)
    assert monitored.run.x.tolist() == run.x.tolist()
    assert monitored.before.channels["hinge"].tolist() == [2.0] * n
    assert monitored.allowed["hinge"] == pytest.approx(
        np.full(n, 2e-9), rel=1e-6, abs=0
    )  # 1e-9 of it: rounding


@pytest.mark.parametrize(
    ("keys", "start"),
    [
        ('<key name="first"/><key name="second"/>', "first"),
        ("", ""),
        ('<key name="first"/><key name="start"/>', "start"),
    ],
)
def test_a_free_motion_starts_from_the_key_start_or_the_first_key(
    keys, start, tmp_path, monkeypatch
):
    assert (
        release_bob(write_bob(tmp_path, keys=keys), 1.0, monkeypatch, hinge=1.0)[0].run.start
        == start
    )


def test_a_free_motion_ends_when_a_nudge_has_grown_to_a_tenth_of_it(tmp_path, monkeypatch):
    """The allowed change of a channel is the largest change by the nudge up to that sample."""
    monitored, _ = release_bob(
        write_bob(tmp_path),
        1.0,
        monkeypatch,
        lambda x: np.where(x > 0.505, 0.201, np.where(x > 0.305, -1e-3, 2e-3) * (x > 0.2)),
        hinge=2.0,
        other=9.0,
    )
    assert monitored.run.x.size == 51
    allowed = monitored.allowed["hinge"]
    assert allowed[:20] == pytest.approx(np.full(20, 2e-9), rel=1e-6, abs=0)
    assert allowed[25:] == pytest.approx(np.full(26, 2e-3))
    whole, _ = release_bob(
        write_bob(tmp_path), 1.0, monkeypatch, lambda x: 0.199 * (x > 0.5), hinge=2.0
    )
    assert whole.run.x.size == 101


def test_a_free_motion_that_is_chaotic_at_once_or_empty_is_bad_input(tmp_path, monkeypatch):
    file = write_bob(tmp_path)
    with pytest.raises(InputError) as error:
        release_bob(file, 1.0, monkeypatch, lambda x: 1.0 * (x > 0.085), hinge=2.0, other=1.0)
    assert (error.value.file, error.value.key, error.value.wrong) == (
        file,
        "",
        (
            "cannot be followed: other is lost in rounding after 0.09 s; give a key that starts "
            "further from a collision"
        ),
    )
    late, _ = release_bob(file, 1.0, monkeypatch, lambda x: 1.0 * (x > 0.095), hinge=2.0)
    assert late.run.x.size == 10
    assert release_bob(file, 0.02, monkeypatch, lambda x: 0.0 * x, hinge=2.0)[0].run.x.size == 3
    with pytest.raises(InputError) as error:
        release_bob(file, 1.0, monkeypatch)
    assert error.value.wrong == ("nothing in it moves and nothing is measured; give it a <joint>")


def test_an_original_model_that_does_not_run_is_bad_input(monkeypatch):
    calls: list = []
    monkeypatch.setattr(
        measure,
        "call_isolated",
        answering_in_turn(calls, "curves", Diverged("why"), BadModel("broken")),
    )
    file = Path("scene.xml")
    assert scene.run_original(file, "model", "run", 0.5) == "curves"
    assert calls == [("attempt", "model", "run", 0.5, 600.0)]
    for wrong in ("as it is, its run diverged: why; give a model that runs", "broken"):
        with pytest.raises(InputError) as error:
            scene.run_original(file, "model", "run")
        assert (error.value.file, error.value.key, error.value.wrong) == (file, "", wrong)
    assert calls[1][3] == 0.0


def test_a_scene_has_the_runs_of_the_sidecars_of_its_model(models, monkeypatch):
    asked = []

    def monitored_run(case, run, solver, edited):
        asked.append((case.name, run.kind, solver, edited.file, edited.added_sensors))
        return replace(monitored_run_of({"y": 1.0}, {"y": [0.0]}), name=case.name)

    monkeypatch.setattr(scene, "monitor_run", monitored_run)
    monkeypatch.setattr(
        scene,
        "monitor_free_motion",
        lambda file, edited, seconds: replace(
            monitored_run_of({"y": 1.0}, {"y": [0.0]}),
            run=Run("passive", np.zeros(1), (), start="key"),
            name=f"{seconds} s of {file.name}, {sorted(edited.added_sensors)}",
        ),
    )
    monkeypatch.setattr(
        scene, "with_fine_solution", lambda file, edited, monitored, error: (monitored, "")
    )
    file = models / "pendulum.xml"
    file.write_text(file.read_text().replace("<keyframe>", '<keyframe>\n    <key name="other"/>'))
    (models / "broken.toml").write_text("model =")
    (models / "latin.toml").write_bytes(b"title = '\xb0'")
    other = (
        (models / "pendulum.toml")
        .read_text()
        .replace("\n[", '\nmodel = "pendulum.xml"\nstart = "other"\n[', 1)
    )
    (models / "another.toml").write_text(other)
    found = scene.load_scene(file, 3.0)
    assert [w.name for w in found.monitored_runs] == ["another", "pendulum"]
    assert asked == [(name, "dynamics", "mujoco", file, set()) for name in ("another", "pendulum")]
    assert found.read == {"angle", "rate", "acceleration", "kinetic", "potential"}
    assert found.keys == {"start", "other"}
    (models / "another.toml").unlink()
    (models / "pendulum.toml").write_text(
        (models / "pendulum.toml")
        .read_text()
        .replace(
            'solvers = ["mujoco", "mujoco:default", "pymunk", "pymunk:default"]',
            'solvers = ["pymunk"]',
        )
        .replace(
            '[[tolerance]]\nsolver = "mujoco"\n',
            '[[tolerance]]\nsolver = "pymunk"\nchannels = "rate"\n',
        )
        .replace(
            'solver = "pymunk"\nrelative_to_range = 1e-4',
            'channels = "angle"\nrelative_to_range = 1e-4',
        )
    )
    loose = scene.load_scene(file, 3.0)
    assert [w.name for w in loose.monitored_runs] == ["3.0 s of pendulum.xml, []"]
    assert (loose.read, loose.keys) == (None, {"key", "start"})
    lone = scene.load_scene(write_bob(models), 3.0)
    assert lone.keys == {"key"}
    assert lone.monitored_runs[0].name.startswith("3.0 s of bob.xml, ['")  # the sensors are added
    with pytest.raises(InputError, match="no such model"):
        scene.load_scene(models / "none.xml", 3.0)


def test_brief_runs_are_short_and_a_scene_is_timed_by_its_longest_run():
    monitored = monitored_run_of({"y": 1.0}, {"y": [0.0] * 2000})
    for steps, n in ((2000, 500), (2000 * 250, 2), (2000 * 600, 2), (0, 500)):
        assert replace(monitored, before=replace(monitored.before, steps=steps)).brief.x.size == n
    rest = replace(
        monitored,
        run=replace(monitored.run, kind="equilibrium"),
        before=replace(monitored.before, seconds=9.0),
    )
    assert diet_scene(rest, monitored).longest is monitored
    assert diet_scene(monitored, rest).longest is monitored
