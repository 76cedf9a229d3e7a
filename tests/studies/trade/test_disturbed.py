"""Disturbed starts: growth of the disturbance by theory, the horizon of a motion, and rounding."""

from dataclasses import replace
from math import cos, sin
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.reference.samples import run_samples
from proofmass.run.sidecar import load_case
from proofmass.studies.measure import StudyRun, simulate_task
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade import trade
from proofmass.studies.trade.disturbed import (
    DISTURBANCE,
    MIN_SAMPLES,
    ROUNDING_CAUSE_SHARE,
    DisturbedMotion,
    classify_motion,
    disturb_motion,
    end_at_horizon,
    measure_rounding,
    own_joint_mask,
    stored_distances,
    with_disturbed_start,
    with_roundings,
)
from proofmass.studies.trade.varied import list_series
from tests.shipped import shipped

ROOT = Path(__file__).parents[3]
TIMES = np.linspace(0.0, 20.0, 401)
GRAVITY, HALF_LENGTH, MOMENT_OF_INERTIA = 9.81, 0.5, 1.0 / 12.0
RK4 = Setting("mujoco", {"timestep": 1e-3, "integrator": "RK4"})


@pytest.fixture(scope="module")
def double_pendulum() -> Case:
    return load_case(ROOT / "tests" / "data" / "double_pendulum.toml")


def shortened_case(case: Case, until: float) -> Case:
    """The case with its dynamics ended earlier, and with the same distance of samples."""
    table = case.run["dynamics"]
    n = round((table.n - 1) * until / table.until) + 1
    return case.model_copy(
        update={"run": {"dynamics": table.model_copy(update={"n": n, "until": until})}}
    )


def double_pendulum_rates(_: float, y: np.ndarray) -> list[float]:
    """Rates of the state of a double pendulum, by Lagrange's equations.

    It has two uniform bars of 1 m and 1 kg; the angles are absolute, from straight down.
    """
    a, b, u, v = y
    across, upper, lower = (
        HALF_LENGTH * cos(a - b),
        MOMENT_OF_INERTIA + HALF_LENGTH**2 + 1.0,
        MOMENT_OF_INERTIA + HALF_LENGTH**2,
    )
    first = -HALF_LENGTH * v * v * sin(a - b) - 1.5 * GRAVITY * sin(a)
    second = HALF_LENGTH * u * u * sin(a - b) - HALF_LENGTH * GRAVITY * sin(b)
    whole = upper * lower - across**2
    return [
        u,
        v,
        (lower * first - across * second) / whole,
        (upper * second - across * first) / whole,
    ]


def integrated_by_scipy(until: float, upper: float = 0.0, lower: float = 0.0) -> np.ndarray:
    """Angles of the joints and position of the tip (n, 4), from a start displaced by two angles."""
    x = TIMES[until + 1e-9 >= TIMES]
    y = solve_ivp(
        double_pendulum_rates,
        (0.0, until),
        [2.0 + upper, 3.0 + upper + lower, 0.0, 0.0],
        "DOP853",
        x,
        rtol=1e-12,
        atol=1e-13,
    ).y
    return np.array(
        [y[0], y[1] - y[0], np.sin(y[0]) + np.sin(y[1]), -np.cos(y[0]) - np.cos(y[1])]
    ).T


def expected_distances(until: float) -> np.ndarray:
    """Largest distance of the disturbed motion from the plain one (n,), over the ranges."""
    plain, other = integrated_by_scipy(until), integrated_by_scipy(until, DISTURBANCE, -DISTURBANCE)
    return (np.abs(other - plain) / np.ptp(plain, axis=0)).max(axis=1)


def test_a_disturbance_grows_by_the_equations_of_motion(double_pendulum, tmp_path):
    """The reference is integrated by scipy, without an engine and without code of this package."""
    case = shortened_case(double_pendulum, 10.0)
    found = stored_distances(
        StudyRun(case, "dynamics", RK4), with_disturbed_start(case, tmp_path), Store(tmp_path), 60.0
    )
    away = expected_distances(10.0)
    # RK4 at 1 ms has an error of 1e-5 at the end, which displaces the growth by as much
    assert found["position"] == pytest.approx(away, rel=0.01, abs=1e-11)
    assert away.max() > 1e3 * DISTURBANCE


def test_a_chaotic_motion_has_a_rate_and_a_horizon(double_pendulum, tmp_path):
    motion = disturb_motion(double_pendulum, "dynamics", Store(tmp_path), 60.0)
    assert motion.words.startswith("chaotic: a start disturbed by 1e-9 moves it ")
    assert "errors are judged up to there" in motion.words
    away = np.maximum.accumulate(expected_distances(20.0))
    assert motion.horizon == TIMES[np.argmax(away > 1e-4) - 1]
    linear = np.flatnonzero(away <= 1e-2)[-1] + 2
    rate = np.polyfit(TIMES[linear // 5 : linear], np.log(away[linear // 5 : linear]), 1)[0]
    assert motion.rate == pytest.approx(rate, rel=0.2)  # RK4 has an error of 5e-3 at the end
    cut = end_at_horizon(double_pendulum, "dynamics", motion)
    assert run_samples(cut, "dynamics")[-1] == pytest.approx(motion.horizon, abs=0.051)
    assert np.allclose(np.diff(run_samples(cut, "dynamics")), 0.05)
    assert cut.run["dynamics"].n % 2 == 1


@pytest.mark.parametrize("name", ["pendulum", "fourbar_released"])
def test_a_regular_motion_has_no_horizon(name, tmp_path):
    """The phases of a disturbed pendulum and a plain one part in proportion to time, no faster."""
    case = load_case(shipped(f"{name}.toml"))
    motion = disturb_motion(case, "dynamics", Store(tmp_path), 60.0)
    assert np.isnan(motion.rate)
    assert np.isnan(motion.horizon)
    assert end_at_horizon(case, "dynamics", motion) is case
    assert "chaotic" not in motion.words


def test_a_driven_motion_is_not_disturbed(tmp_path):
    case = load_case(shipped("fourbar.toml"))
    assert disturb_motion(case, "dynamics", Store(tmp_path), 60.0) is None
    assert end_at_horizon(case, "dynamics", None) is case


@pytest.mark.parametrize("rate", [0.5, 1.0, 3.0])
def test_rate_and_horizon_are_those_of_an_exponential_growth(rate):
    x = np.linspace(0.0, 20.0, 2001)
    motion = classify_motion(x, np.minimum(1e-9 * np.exp(rate * x), 1.0))
    assert motion.rate == pytest.approx(rate, rel=0.02)
    passes = np.log(1e5) / rate
    assert (
        np.isnan(motion.horizon)
        if passes > 20.0
        else motion.horizon == pytest.approx(passes, abs=0.02)
    )


def test_the_first_fifth_of_the_growth_is_not_fitted():
    """At first a disturbance turns into the direction that grows, and may even become smaller."""
    x = np.linspace(0.0, 20.0, 2001)
    distance = np.where(x < 2.0, 1e-12, 1e-9 * np.exp(x))  # 1e-2 is passed at x = 16.1
    assert classify_motion(x, distance).rate == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("power", [0, 1, 2, 3])
def test_growth_with_a_power_of_time_is_not_chaotic(power):
    x = np.linspace(0.0, 20.0, 2001)
    motion = classify_motion(x, 1e-9 * (1.0 + 100.0 * (x / 5.0) ** power))
    assert np.isnan(motion.rate)
    assert "chaotic" not in motion.words
    assert motion.growth == pytest.approx(1.0 + 100.0 * 4.0**power)  # at the end, x = 20
    assert motion.words.startswith("sensitive to its start: ")


def test_a_horizon_leaves_a_minimum_of_samples():
    x = np.linspace(0.0, 20.0, 401)
    assert classify_motion(x, np.where(x > 0.04, 1.0, 1e-9)).horizon == x[MIN_SAMPLES - 1]
    assert np.isnan(DisturbedMotion(1.0, np.nan, np.nan, 20.0).horizon)
    assert DisturbedMotion(99.0, np.nan, np.nan, 20.0).words == ""


def test_a_disturbance_changes_the_start_and_roundings_the_last_digits(double_pendulum, tmp_path):
    own, nudged, other = map(
        compiled_model,
        (
            double_pendulum,
            with_disturbed_start(double_pendulum, tmp_path),
            with_roundings(double_pendulum, tmp_path),
        ),
    )
    assert nudged.key_qpos[0] - own.key_qpos[0] == pytest.approx(
        [DISTURBANCE, -DISTURBANCE], rel=1e-6, abs=0
    )
    assert np.array_equal(nudged.body_mass, own.body_mass)
    assert 0 < np.abs(other.body_mass[1:] / own.body_mass[1:] - 1).max() < 1e-15
    assert 0 < np.abs(other.key_qpos[0] - own.key_qpos[0]).max() < 1e-15


def test_roundings_change_a_run_by_no_more_than_their_growth(double_pendulum, tmp_path):
    """The change is at most a rounding of 1e-15 in each of 5000 steps, times a growth of 1e3.

    It is not the error of RK4.  Rounding is the cause of an error if the change by rounding is more
    than `ROUNDING_CAUSE_SHARE` of that error.
    """
    case = shortened_case(double_pendulum, 5.0)
    away = measure_rounding(StudyRun(case, "dynamics", RK4), Store(tmp_path), 60.0)["position"]
    assert 1e-16 < away < 5000 * 1e-15 * 1e3
    row = StudyRow(
        "", "", "", "mujoco", "", "", 1e-3, errors={"position": away / ROUNDING_CAUSE_SHARE * 0.99}
    )
    assert trade.judge_rounding(row, "position", {"position": away})[0] == "rounding"
    far = replace(row, errors={"position": away / ROUNDING_CAUSE_SHARE * 1.01})
    assert trade.judge_rounding(far, "position", {"position": away}) == ("unknown", "")
    assert trade.judge_rounding(row, "position", {})[0] == "unknown"


def angles_of_mujoco(until: float, integrator: int, step: float) -> np.ndarray:
    """Angles (n, 2) of the double pendulum in MuJoCo, without code of this package."""
    model = mujoco.MjModel.from_xml_path(str(ROOT / "tests" / "data" / "double_pendulum.xml"))
    model.opt.integrator, model.opt.timestep = integrator, step
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    found = [data.qpos.copy()]
    for _ in range(round(until / 0.05)):
        mujoco.mj_step(model, data, round(0.05 / step))
        found.append(data.qpos.copy())
    return np.array(found)


@pytest.mark.slow
def test_a_double_pendulum_has_no_error_floor(double_pendulum, tmp_path, monkeypatch):
    """The error of Euler is half of the range: that is no error floor, and no cause is stated.

    The errors of the study are compared with those of MuJoCo without code of this package.
    """
    monkeypatch.setattr(
        trade,
        "list_series",
        lambda case, kind: [
            series
            for series in list_series(case, kind)
            if series.name in ("MuJoCo Euler", "MuJoCo RK4")
        ],
    )
    case = shortened_case(double_pendulum, 5.0)
    study = trade.trade([case], Study(Store(tmp_path)), repeats=0)
    told = {v.series: v for v in study.verdicts if v.kind == "position"}
    assert all(np.isnan(v.floor) and not v.cause for v in study.verdicts)
    assert told["MuJoCo Euler"].reached.startswith("not yet asymptotic: ")
    assert told["MuJoCo Euler"].reached.endswith("no order is seen")
    assert told["MuJoCo RK4"].reached.startswith("order 4")
    plain = integrated_by_scipy(5.0)[:, :2]
    for name, integrator in (("MuJoCo Euler", 0), ("MuJoCo RK4", 1)):
        row = next(row for row in study.rows if row.series == name and row.value < 1e-3)
        angles = np.abs(angles_of_mujoco(5.0, integrator, row.value) - plain) / np.ptp(
            plain, axis=0
        )
        assert angles.max() <= 1.01 * row.errors["position"]  # the study also compares the tip
        assert angles.max() >= 0.2 * row.errors["position"]


@pytest.mark.slow
def test_errors_of_a_chaotic_motion_are_judged_up_to_its_horizon(
    double_pendulum, tmp_path, monkeypatch
):
    monkeypatch.setattr(
        trade,
        "list_series",
        lambda case, kind: [
            series for series in list_series(case, kind) if series.name == "MuJoCo RK4"
        ],
    )
    study = trade.trade([double_pendulum], Study(Store(tmp_path)), repeats=0)
    (case,) = study.cases
    assert all(v.motion.startswith("chaotic") and v.horizon < 15.0 for v in study.verdicts)
    assert case.run["dynamics"].until == pytest.approx(study.verdicts[0].horizon, abs=0.051)
    *_, coarse, fine = [row.errors["position"] for row in study.rows]
    assert fine < coarse / 8.0 < 0.01  # of fourth order there, and not as large as the range


def test_a_rod_is_disturbed_in_its_arc(tmp_path: Path) -> None:
    """The rod has no joint in the file, so its arc is turned further by the disturbance.

    The rod is an arc of 1 m, so its tip moves by half of the disturbance.
    """
    case = load_case(shipped("rod_released.toml"))
    other = with_disturbed_start(case, tmp_path)
    assert other.rods[0].turn == DISTURBANCE
    task = StudyRun(case, "dynamics", Setting("mujoco", {"timestep": 2e-4}))
    one, two = (simulate_task(replace(task, case=each)) for each in (case, other))
    away = two.channels["tip.y"][0] - one.channels["tip.y"][0]
    assert away == pytest.approx(DISTURBANCE / 2, rel=1e-3, abs=0)
    motion = disturb_motion(case, "dynamics", Store(tmp_path), 30.0)
    assert 0.1 < motion.growth < 10.0  # the motion is regular
    assert not motion.rate > 0


def test_joints_of_a_model_with_rods_are_disturbed_in_the_file(tmp_path: Path) -> None:
    """A hinge is turned by the disturbance, and a slide moves by it times the mechanism's size."""
    case = load_case(shipped("rfr3.toml"))
    other = with_disturbed_start(case, tmp_path)
    own = own_joint_mask(case)
    there, here = (compiled_model(each).key_qpos[0] for each in (other, case))
    assert own.sum() == 6 < own.size
    # hinges in rad, and the two slides times the size: the motors are 3^(1/2) m apart
    units = np.array([1.0, 1.0, 1.0, 3**0.5, 3**0.5, 1.0])
    # rel: the angles, up to pi, have 4e-16 of rounding, half of it by subtraction
    assert np.abs(there - here)[own] == pytest.approx(units * DISTURBANCE, rel=1e-6, abs=0)
    assert np.abs(there - here)[~own].max() > 0  # the rods are fitted to the displaced joints
    assert other.rods == case.rods


@pytest.mark.parametrize("name", ["rod_taut", "slider_crank_elastic"])
def test_a_model_that_cannot_be_disturbed_has_no_disturbed_start(name: str, tmp_path: Path) -> None:
    """Two cases have no disturbed start.

    One has no joints except those of a rod between fixed sites.  The other has a straight rod
    between pins, and the disturbance moves the pins further apart than any arc of the rod.
    """
    case = load_case(shipped(f"{name}.toml"))
    assert with_disturbed_start(case, tmp_path) is None


def test_roundings_reach_the_masses_of_rods(tmp_path: Path) -> None:
    case = load_case(shipped("rod_released.toml"))
    other = with_roundings(case, tmp_path)
    assert 0 < other.rods[0].mass / case.rods[0].mass - 1 < 1e-14


def test_rates_are_disturbed_if_a_joint_starts_at_its_joint_limit(tmp_path: Path) -> None:
    """A disturbed value would be off the joint limit, which changes the first step by a jump.

    That jump is no chaos, so the rates are disturbed instead.
    """
    case = load_case(ROOT / "models" / "spatial" / "robotiq_2f85.toml")
    other = with_disturbed_start(case, tmp_path)
    assert other is not None
    one, two = compiled_model(case), compiled_model(other)
    assert np.array_equal(one.key_qpos, two.key_qpos)
    assert np.abs(two.key_qvel - one.key_qvel).max() == DISTURBANCE
    motion = disturb_motion(case, "dynamics", Store(tmp_path / "store"), 60.0)
    assert motion is not None
    assert motion.words == ""
