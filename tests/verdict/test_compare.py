"""Tolerances, comparisons, units, recorded curves, isolated calls, scales, detectable changes."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from proofmass.base.errors import InputError
from proofmass.base.recorded import RecordedColumn, read_table
from proofmass.base.units import si_unit
from proofmass.base.worker import Crashed, call_isolated
from proofmass.batch.check import check, find_inputs
from proofmass.case.case import Tolerance, View
from proofmass.case.drive import Samples, Steady
from proofmass.formats.terminal import worst_comparison
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import evaluate, reference_for
from proofmass.reference.samples import run_samples
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.run.validate import validate_case
from proofmass.sim.contents import size
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.compare import (
    check_assembly_mode,
    compare,
    compare_channel,
    end_of_start,
    scale_of,
    start_difference,
    time_scale,
)
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import judge_error
from tests.shipped import shipped, shipped_files


def test_error_measures_of_a_known_difference():
    case = load_case(shipped("pendulum.toml"))
    x = np.linspace(0, 1, 5)
    truth = np.array([0.0, 1, 2, 3, 4])
    error = np.array([0, 0, -2e-11, 1e-11, 0])
    c = compare_channel(
        case, "dynamics", "mujoco", "angle", Curves(x, {"angle": truth + error}), truth, {}
    )
    assert c.outcome == "agrees"
    assert c.error_max == pytest.approx(2e-11, rel=1e-4, abs=0)  # rounding is 1e-16 at 2
    assert c.at == 0.5
    assert c.error_rms == pytest.approx(1e-11, rel=1e-4, abs=0)  # sqrt((4 + 1) / 5) e-11
    assert c.nrmse == pytest.approx(2.5e-12, rel=1e-4, abs=0)
    assert c.relative_to_range == pytest.approx(5e-12, rel=1e-4, abs=0)
    assert c.allowed == pytest.approx(4e-10, rel=1e-4, abs=0)
    assert c.allowed_of_range == pytest.approx(1e-10, rel=1e-4, abs=0)  # 4e-10 of a range of 4
    assert c.message.startswith("RK4 at 1 ms")  # the reason of the tolerance


PENDULUM = load_case(shipped("pendulum.toml"))


@pytest.mark.parametrize(
    ("error", "unsure", "outcome"),
    [
        (0.25, 0.25, "agrees"),  # 0.5 at most
        (0.25, 0.26, "undecided"),
        (0.75, 0.25, "undecided"),  # 0.5 at least
        (0.76, 0.25, "differs"),
    ],
)
def test_an_uncertain_error_is_undecided_if_it_may_agree_and_may_differ(error, unsure, outcome):
    """An error of 0.5 is allowed: one that is as large still agrees."""
    half = Tolerance(run="dynamics", solver="mujoco", channels="angle", abs=0.5, why="half")
    case = PENDULUM.model_copy(update={"tolerance": (half,)})
    x, truth = np.linspace(0, 1, 5), np.array([0.0, 1, 2, 3, 4])
    off = truth + error * (x == 0.5)
    curves = Curves(x, {"angle": off}, uncertainty={"angle": np.where(x == 0.5, unsure, 0.0)})
    assert compare_channel(case, "dynamics", "mujoco", "angle", curves, truth, {}).outcome == (
        outcome
    )


def with_changed_channel(case, channel: str, **changed):
    """The case with changed keys of a channel, such as its unit or its only run."""
    return case.model_copy(
        update={
            "channels": {
                **case.channels,
                channel: case.channels[channel].model_copy(update=changed),
            }
        }
    )


def test_a_comparison_in_degrees_equals_that_in_radians():
    x = np.linspace(0, 1, 5)
    truth = np.array([0.0, 1, 2, 3, 4])
    curves = Curves(x, {"angle": truth + np.array([0, 0, -2e-11, 1e-11, 0])})
    rad, deg = (
        compare_channel(case, "dynamics", "mujoco", "angle", curves, truth, {})
        for case in (PENDULUM, with_changed_channel(PENDULUM, "angle", unit="deg"))
    )
    assert (deg.unit, deg.outcome) == ("deg", "agrees")
    for name in ("error_max", "error_rms", "error_later", "allowed"):
        assert getattr(deg, name) == pytest.approx(np.rad2deg(getattr(rad, name)), rel=1e-4, abs=0)
    assert (deg.nrmse, deg.relative_to_range) == pytest.approx(
        (rad.nrmse, rad.relative_to_range), rel=1e-4, abs=0
    )
    off = Curves(x, {"angle": truth + 2 * np.pi})
    assert compare_channel(
        with_changed_channel(PENDULUM, "angle", unit="deg"),
        "dynamics",
        "mujoco",
        "angle",
        off,
        truth,
        {},
    ).message.startswith("off by 1 whole turn")


def test_a_zero_curve_has_the_scale_of_the_mechanism_if_there_is_one():
    x, zero = np.linspace(0, 4, 3), np.zeros(3)
    c = compare_channel(
        PENDULUM, "dynamics", "mujoco", "rate", Curves(x, {"rate": zero + 0.5}), zero, {}
    )
    assert c.nrmse == pytest.approx(2.0)  # 0.5 rad/s over a scale of 1 rad / 4 s, the duration
    rod = load_case(shipped("rod_cantilever.toml"))
    c = compare_channel(
        rod, "equilibrium", "mujoco", "rod.moment", Curves(x, {"rod.moment": zero + 0.5}), zero, {}
    )
    assert np.isnan(c.nrmse)


def test_the_later_error_leaves_out_the_first_tenth_of_dynamics():
    x = np.linspace(2, 12, 101)
    truth, error = np.sin(x), 1e-11 * (13 - x)
    curves = Curves(x, {"angle": truth + error})
    assert end_of_start(curves) == 3.0
    c = compare_channel(PENDULUM, "dynamics", "mujoco", "angle", curves, truth, {})
    assert c.error_later == pytest.approx(1e-10, rel=1e-4, abs=0)  # at 3; rounding is 1e-16 at 1
    assert c.relative_to_range_later == pytest.approx(c.relative_to_range / 1.1, rel=1e-4, abs=0)
    rod = load_case(shipped("rod_cantilever.toml"))
    name = next(iter(rod.channels))
    assert np.isnan(
        compare_channel(
            rod, "equilibrium", "mujoco", name, Curves(x, {name: truth}), truth, {}
        ).error_later
    )


def test_a_channel_with_nan_missing_or_without_tolerance_does_not_agree():
    x = np.linspace(0, 1, 3)
    failed = Curves(
        x, {"angle": np.array([0.0, np.nan, 5.0])}, missing={"rate": "no such sensor"}, seconds=2.0
    )
    c = compare_channel(PENDULUM, "dynamics", "mujoco", "angle", failed, x, {})
    assert (c.outcome, c.at) == ("differs", 0.5)
    assert np.isnan(c.error_max)
    for name, message in (("rate", "no such sensor"), ("kinetic", "")):
        c = compare_channel(PENDULUM, "dynamics", "mujoco", name, failed, x, {})
        assert (c.channel, c.outcome, c.message, c.seconds) == (name, "unsupported", message, 2.0)
    c = compare_channel(
        PENDULUM, "dynamics", "mujoco:default", "angle", Curves(x, {"angle": x}), x, {}
    )
    assert (c.outcome, c.error_max, c.relative_to_range) == ("unchecked", 0.0, 0.0)
    assert np.isnan(c.allowed)
    assert c.message == "no tolerance covers this channel of this solver"


@pytest.mark.parametrize(
    ("error", "allowed", "unit", "outcome", "message"),
    [
        (0.5, 0.5, "m", "agrees", "why"),
        (np.nan, 1.0, "m", "differs", "not a number somewhere on the curve"),
        (np.inf, np.inf, "m", "differs", "not a number somewhere on the curve"),
        (3.0, 2.0, "", "differs", "1.5 x the allowed error"),
        (
            1e-17,
            0.0,
            "N m",
            "differs",
            "the reference is zero and the mechanism has no size of this "
            "quantity, so relative_to_range allows nothing: give the tolerance as abs",
        ),
        (
            2 * np.pi,
            0.1,
            "rad",
            "differs",
            "off by 1 whole turn(s): count the start pose's angle anew",
        ),
        (720.0, 0.1, "deg", "differs", "off by 2 whole turn(s): count the start pose's angle anew"),
        (2 * np.pi * 1.002, 0.1, "rad", "differs", "63 x the allowed error"),
        (2 * np.pi, 0.1, "m", "differs", "62.8 x the allowed error"),
        (1e-3, 1e-4, "rad", "differs", "10 x the allowed error"),  # 0 turns do not count
    ],
)
def test_an_outcome_has_a_message_with_the_reason(error, allowed, unit, outcome, message):
    assert judge_error(error, allowed, unit, "why") == (outcome, message)


def make_comparison(
    error: float, allowed: float, outcome: str = "agrees", **more: float
) -> Comparison:
    return Comparison("", "", "", "", "", error_max=error, allowed=allowed, outcome=outcome, **more)


def test_the_worst_comparison_represents_a_solver():
    """The terminal shows the channel of a run that failed, or that is nearest to its tolerance."""
    near, far, beyond = (
        make_comparison(9.0, 10.0),
        make_comparison(1e3, 1e6),
        make_comparison(3.0, 1.0, "differs"),
    )
    failed = make_comparison(float("nan"), float("nan"), "diverged")
    unchecked = [make_comparison(9.0, float("nan"), "unchecked", nrmse=n) for n in (0.1, 30.0, 0.2)]
    for group, worst in (
        ([near, far], near),
        ([near, beyond, far], beyond),
        ([near, failed], failed),
        (unchecked, unchecked[1]),
        ([*unchecked, beyond], beyond),
    ):
        assert worst_comparison(group) is worst
        assert worst_comparison(group[::-1]) is worst


@pytest.mark.parametrize("channel", ["pin.x", "coupler.angle", "pin.y"])
def test_another_assembly_mode_is_recognized_by_a_single_channel(channel):
    """The modes of the triple rocker start 0.24, 0.34 and 0.47 of these channels' ranges apart."""
    case = load_case(shipped("triple_rocker.toml"))
    x = run_samples(case, "sweep")
    state = plan_run(case, "sweep", "mujoco").motion(x)
    own, other = (
        evaluate(case, "sweep", x, state, mode=mode).channels[channel] for mode in (1, -1)
    )
    assert 0.2 < abs(own[0] - other[0]) / np.ptp(own) < 0.5
    truth = evaluate(case, "sweep", x, state)
    check_assembly_mode(case, "sweep", Curves(x, {channel: own}, drive=state), truth)
    with pytest.raises(InputError, match=r"in mode -1, parameters\.mode says \+1"):
        check_assembly_mode(case, "sweep", Curves(x, {channel: other}, drive=state), truth)


def test_a_model_in_another_mode_is_an_error_of_the_start_pose(monkeypatch):
    case = load_case(shipped("triple_rocker.toml"))
    x = run_samples(case, "sweep")
    state = plan_run(case, "sweep", "mujoco").motion(x)
    truth, other = (evaluate(case, "sweep", x, state, mode=mode) for mode in (1, -1))
    curves = Curves(x, other.channels, drive=state)
    parameters = {k: v for k, v in case.parameters.items() if k != "mode"}
    check_assembly_mode(case.model_copy(update={"parameters": parameters}), "sweep", curves, truth)
    check_assembly_mode(
        case, "sweep", Curves(x, other.channels), truth
    )  # a free motion is not compared with other modes

    def evaluated(case, x, state, run, mode):
        if mode != -1:  # a mode without a solution at these poses is skipped
            raise InputError(case.file, "", "")
        return other

    module = sys.modules[compare.__module__]  # `proofmass.compare` is the function
    monkeypatch.setattr(module, "assembly_modes", lambda case: (1, -1))
    monkeypatch.setattr(module, "evaluate", evaluated)
    with pytest.raises(InputError, match="mode -1") as error:
        check_assembly_mode(case, "sweep", curves, truth)
    assert error.value.key == "start"


def test_start_difference_is_of_positions_at_the_first_sample():
    def of(**curves):
        x = np.zeros(2)
        return start_difference(
            load_case(shipped("fourbar.toml")),
            *(
                Curves(x, {name: np.array(values[k]) for name, values in curves.items()})
                for k in (0, 1)
            ),
        )

    assert of(rocker=([1.0, 9.0], [1.5, 3.5])) == 0.25
    assert of(rocker=([1.0, 9.0], [1.5, 3.5]), coupler_rate=([5.0, 5.0], [0.0, 1.0])) == 0.25
    assert of(rocker=([2.5, 7.0], [2.0, 2.0])) == 0.5  # a constant reference: in its unit
    assert of(rocker_rate=([5.0, 5.0], [0.0, 1.0])) == 0.0


def test_tolerance_selects_by_run_solver_unit_and_channel():
    t = Tolerance(run="sweep", solver="mujoco*", unit="m", channels=["pin.*"], abs=1, why="x")
    assert t.covers("sweep", "mujoco:fine", "pin.x", "m")
    assert not t.covers("dynamics", "mujoco", "pin.x", "m")
    assert not t.covers("sweep", "pymunk", "pin.x", "m")
    assert not t.covers("sweep", "mujoco", "pin.x", "rad")
    assert not t.covers("sweep", "mujoco", "slider", "m")


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("mm", "m", 1e-3),
        ("deg", "rad", np.pi / 180),
        ("deg/s^2", "rad/s^2", np.pi / 180),
        ("mm/s²", "m/s^2", 1e-3),
        ("in", "m", 0.0254),
        ("rev/min", "rad/s", 2 * np.pi / 60),
        ("N mm", "N m", 1e-3),
        ("m/s", "m/s", 1.0),
        ("kg mm^2", "kg m^2", 1e-6),
        ("l", "m^3", 1e-3),
        ("mV", "kg m^2/A/s^3", 1e-3),
    ],
)
def test_units_are_converted_to_si(unit, si, factor):
    assert si_unit(unit)[0] == si
    assert si_unit(unit)[1] == pytest.approx(factor, rel=1e-15, abs=0)


def test_a_curve_in_millimetres_and_degrees_is_the_curve_in_si(models, edit):
    file = models / "hacksaw_recorded.csv"
    plain = read_table(file)
    rows = [line for line in file.read_text().splitlines() if not line.startswith("#")]
    table = np.array([row.split(",") for row in rows[1:]], float)
    table[:, 4] *= 1e3
    table[:, 5] *= 180 / np.pi
    head = rows[0].replace("r1 [m]", "r1 [mm]").replace("theta1 [rad]", "theta1 [deg]")
    np.savetxt(file, table, fmt="%.17g", delimiter=",", header=head, comments="")
    other = read_table(file)
    for name in ("r1", "theta1"):
        column = RecordedColumn(column=name)
        np.testing.assert_allclose(other.curve(column), plain.curve(column), rtol=4e-16)


def test_closed_form_is_the_recorded_hacksaw_curve():
    """The closed form and the recorded curve are independent computations of one mechanism."""
    closed, recorded = (load_case(shipped(f"{n}.toml")) for n in ("hacksaw", "hacksaw_recorded"))
    x = run_samples(recorded, "sweep")
    ours = evaluate(closed, "sweep", x, plan_run(closed, "sweep", "mujoco").motion(x))
    theirs = evaluate(recorded, "sweep", x, None)
    for name in closed.channels:
        span = np.ptp(theirs.channels[name])
        error = np.abs(ours.channels[name] - theirs.channels[name]).max()
        assert error <= 1e-12 * span, name  # 100 times the rounding of two formulations


def test_recorded_drive_is_exact_at_samples_and_close_between():
    x = np.linspace(0, 3, 301)
    drive = Samples(x, np.sin(x), np.cos(x), -np.sin(x))
    np.testing.assert_array_equal(drive(x)[2], -np.sin(x))
    between = x[:-1] + 0.005
    # the error of a cubic through values and rates is h^4 / 384 times the fourth derivative, and
    # 1 % is added for rounding; the polynomials of `Samples` are of fifth degree
    np.testing.assert_allclose(
        drive(between)[0], np.sin(between), atol=0.01**4 / 384 * 1.01, rtol=0
    )


def test_steady_drive_in_time_and_in_value():
    x = np.array([0.0, 1.0])
    assert Steady(2, 3, x_is_time=True)(x)[0].tolist() == [2, 5]
    assert Steady(2, 3, x_is_time=False)(x)[0].tolist() == [0, 1]


def test_an_abort_in_a_worker_fails_its_own_call_only():
    with pytest.raises(Crashed, match="signal 6"):
        call_isolated(os.abort, timeout=20)
    assert call_isolated(abs, -3, timeout=20) == 3


def test_an_error_in_a_worker_is_raised_unchanged():
    with pytest.raises(InputError, match="a: b: c"):
        call_isolated(raise_input_error, timeout=20)


def test_idle_workers_end_with_their_parent_process():
    call = (
        "import os; from proofmass.base.worker import call_isolated;"
        "call_isolated(os.getpid, timeout=60)"
    )
    ended = subprocess.run(
        [sys.executable, "-X", "dev", "-W", "error", "-c", call],
        capture_output=True,
        text=True,
        check=True,
    )
    assert ended.stderr == ""  # Python warns of processes and files that stay open


@pytest.mark.slow
def test_a_busy_worker_without_its_parent_ends_after_its_time_limit(tmp_path):
    file = tmp_path / "pid"
    call = f"call_isolated(write_id_and_compute, {str(file)!r}, timeout=4.0)"
    asking = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "from proofmass.base.worker import call_isolated;"
            f"from tests.verdict.test_compare import write_id_and_compute; {call}",
        ]
    )
    while not (file.exists() and file.read_text().strip()) and asking.poll() is None:
        time.sleep(0.05)
    asking.kill()
    asking.wait()
    words = Path("/proc") / file.read_text().strip() / "cmdline"
    assert b"proofmass.base.worker" in words.read_bytes()
    deadline = time.monotonic() + 400.0  # 4 s of processor time, on a machine with 100 processes
    while words.exists() and words.read_bytes() and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not words.exists() or not words.read_bytes()  # ended, or a zombie


def write_id_and_compute(file: str) -> None:
    """Write the number of this process into a file, then compute without an end."""
    Path(file).write_text(str(os.getpid()))
    while True:
        pass


def raise_input_error() -> None:
    raise InputError(Path("a"), "b", "c")


def test_a_model_without_a_sidecar_is_self_consistent(models, edit):
    (models / "pendulum.toml").unlink()
    edit("pendulum.xml", 'timestep="1e-3"', 'timestep="1e-2"')
    result = check([models / "pendulum.xml"])
    assert [(c.case, c.outcome) for c in result.comparisons] == [("pendulum", "self-consistent")]
    assert result.exit_code == 0


def test_paths_may_be_folders_sidecars_or_models(models):
    assert [p.name for p in find_inputs([models / "fourbar.xml"])] == ["fourbar.toml"]
    assert {p.stem for p in find_inputs([models])} == {p.stem for p in shipped_files()}


GEAR_MODEL = """<mujoco>
  <option timestep="0.001" integrator="RK4" gravity="0 0 0"/>
  <worldbody>
    <body name="small">
      <joint name="small" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    </body>
    <body name="large" pos="2 0 0">
      <joint name="large" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/>
      <site name="hub"/>
    </body>
  </worldbody>
  <equality><joint joint1="large" joint2="small" polycoef="0 -0.5 0 0 0"/></equality>
  <sensor>
    <jointvel name="rate" joint="large"/>
    <framepos name="hub" objtype="site" objname="hub"/>
    <framelinvel name="hub_velocity" objtype="site" objname="hub"/>
  </sensor>
  <keyframe><key name="start" qpos="0 0"/></keyframe>
</mujoco>"""
GEAR_SIDECAR = """
title = "Two gears"
source = "none"
reference = "planar"
drive = { joint = "small", from = 0.0, to = 4.0, rate = 2.0 }
[run.sweep]
n = 11
solvers = ["mujoco"]
[channels]
rate = { equals = RATE, unit = "rad/s" }
"hub.x" = { equals = "hub.x", unit = "m" }
"hub_velocity.x" = { equals = "hub_velocity.x", unit = "m/s" }
[[tolerance]]
relative_to_range = 1e-12
why = "rounding"
"""


def check_gears(folder: Path, ratio: float = -0.5, rate: str = '"rate"'):
    (folder / "gears.xml").write_text(GEAR_MODEL.replace("-0.5", str(ratio)))
    (folder / "gears.toml").write_text(GEAR_SIDECAR.replace("RATE", rate))
    found = check([folder / "gears.toml"], detectable=False, causes=False)
    return {c.channel: c for c in found.comparisons}


def test_rounding_errors_of_constant_channels_agree(tmp_path):
    found = check_gears(tmp_path)
    assert {c.outcome for c in found.values()} == {"agrees"}
    assert found["rate"].allowed == pytest.approx(1e-12, rel=1e-6, abs=0)  # 1e-12 of 0.5 * 2 rad/s
    assert found["hub.x"].allowed == pytest.approx(
        2e-12, rel=1e-6, abs=0
    )  # 1e-12 of 2 m between the axes
    assert found["hub_velocity.x"].allowed == pytest.approx(
        4e-12, rel=1e-6, abs=0
    )  # 1e-12 of 2 m * 2 rad/s


@pytest.mark.parametrize("off", [1e-11, -1e-3])
def test_a_wrong_gear_ratio_is_found_by_a_constant_rate(tmp_path, off):
    found = check_gears(tmp_path, -0.5 * (1 + off), rate="-1.0")
    assert found["rate"].outcome == "differs"
    assert found["rate"].error_max == pytest.approx(abs(off), rel=1e-4)  # rounding is 1e-16
    assert found["hub.x"].outcome == "agrees"


def scale_of_values(
    channel: str, values: list[float], name: str = "fourbar", run: str = "sweep"
) -> float:
    case = load_case(shipped(f"{name}.toml"))
    x = np.linspace(0, 4, len(values))
    drive = (x[None], np.full((1, x.size), 3.0), 0 * x[None])
    return scale_of(case, run, channel, Curves(x, {}, drive=drive), np.array(values))


def test_the_scale_is_the_range_or_the_size_of_a_quantity():
    extent = size(compiled_model(load_case(shipped("fourbar.toml"))), "start")
    assert extent == 3.0  # the ground; no other point is beyond its ends
    assert scale_of_values("rocker", [5.0, 5.5]) == 0.5
    assert scale_of_values("rocker", [5.0, 5.0009]) == 1.0  # 1 rad, not the angle of 5 rad
    assert scale_of_values("rocker", [5.0, 5.0011]) == pytest.approx(1.1e-3)
    assert scale_of_values("pin.x", [90.0, 90.0]) == extent  # not the distance from the origin
    assert scale_of_values("rocker_rate", [7.0, 7.006]) == 7.006
    assert scale_of_values("rocker_rate", [7.0, 7.008]) == pytest.approx(8e-3)
    assert scale_of_values("rocker_rate", [0.0, 1e-13]) == 3.0  # the rate of the drive
    assert scale_of_values("rocker_rate", [0.0, 1e-11]) == 1e-11  # a small motion has its range
    assert scale_of_values("pin_velocity.x", [0.0, 0.0]) == 3 * extent
    assert scale_of_values("point_acceleration.x", [0.0, 0.0]) == pytest.approx(9 * extent)
    assert scale_of_values("holding_moment", [0.0, 0.0]) == pytest.approx(
        5.5 * 9 * extent**2
    )  # of 5.5 kg


def test_the_time_scale_is_of_the_fastest_drive_or_of_the_free_motion():
    def of(name: str, *rates: list[float], run: str = "sweep", extent: float = 3.0) -> float:
        x = np.array([2.0, 6.0])
        drive = (np.zeros((len(rates), 2)), np.array(rates), np.zeros((len(rates), 2)))
        return time_scale(
            load_case(shipped(f"{name}.toml")),
            run,
            Curves(x, {}, drive=drive if rates else None),
            extent,
        )

    assert of("fourbar", [1.0, -4.0]) == 0.25
    assert of("threeprr", [1.0, 2.0], [0.0, -6.0], [1.0, 1.0]) == 0.5  # sliders: 3 m / (6 m/s)
    at_rest = of("fourbar", [0.0, 1e-16], run="dynamics")
    assert at_rest == 1.0  # from the rate between the samples, 1 rad/s
    assert of("fourbar") == of("fourbar", [1.0, 1.0], extent=0) == 0.0
    assert of("pendulum", run="dynamics") == 4.0
    assert of("pendulum", run="sweep") == 0.0
    assert scale_of_values("rate", [0.0, 0.0], "pendulum", "dynamics") == 0.25  # rad/s


def test_a_quantity_without_a_size_needs_an_absolute_tolerance():
    assert scale_of_values("rod.moment", [0.0, 0.0], "rod_cantilever", "equilibrium") == 0.0
    assert (
        scale_of_values("rod.angle", [0.0, 0.0], "rod_cantilever", "equilibrium") == 1.0
    )  # 1 rad; an angle needs no time
    outcome, message = judge_error(1e-17, 0.0, "N m", "rounding")
    assert outcome == "differs"
    assert "give the tolerance as abs" in message


@pytest.mark.parametrize(
    ("name", "kind", "key", "rel"),
    [
        ("hacksaw", "dynamics", "coupler", 1e-3),
        ("fourbar", "dynamics", "ground", 1e-3),
        ("fivebar", "dynamics", "left_x", 1e-3),  # the parameter is 0: an absolute change
        (
            "rod_cantilever",
            "equilibrium",
            "length",
            0.1,
        ),  # changes of up to 2.6 % of the length, over which curves bend
    ],
)
def test_detectable_change_is_the_change_that_uses_the_tolerance_up(name, kind, key, rel):
    """A parameter changed by its detectable change gives an error equal to the tolerance."""
    case = load_case(shipped(f"{name}.toml"))
    x = run_samples(case, kind)
    state = plan_run(case, kind, "mujoco").motion(x) if case.drive else None
    truth = evaluate(case, kind, x, state)
    found = compare(case, kind, "mujoco", Curves(x, truth.channels, drive=state))
    value, checked = case.parameters[key], 0
    for c in found:
        change = c.detectable[key]
        assert change.relative is bool(value)
        if change.size < 1e-9:  # rounding would be part of the error
            continue
        by = change.size * (value or 1.0)
        off = evaluate(case, kind, x, state, **{key: value + by}).channels[c.channel]
        assert np.abs(off - truth.channels[c.channel]).max() == pytest.approx(c.allowed, rel=rel)
        checked += 1
    assert checked


def test_detectable_change_does_not_depend_on_the_unit_of_a_channel():
    x = np.linspace(0.0, 1.0, 5)
    curves = Curves(x, evaluate(PENDULUM, "dynamics", x, None).channels)

    def angle(case, solver: str = "mujoco") -> Comparison:
        return next(c for c in compare(case, "dynamics", solver, curves) if c.channel == "angle")

    rad, deg = (
        angle(PENDULUM),
        angle(with_changed_channel(PENDULUM, "angle", unit="deg", only="dynamics")),
    )
    assert set(deg.detectable) == set(rad.detectable) >= {"length", "gravity"}
    for key, change in rad.detectable.items():
        assert deg.detectable[key].size == pytest.approx(change.size, rel=1e-6, abs=0)
    assert angle(PENDULUM, "mujoco:default").detectable == {}


def test_a_view_of_the_run_that_cannot_be_drawn_is_bad_input():
    """The validation of a case looks at its views; a comparison of its curves does not."""
    case = load_case(shipped("fourbar.toml"))
    x = np.linspace(0.0, 1.0, 5)
    state = plan_run(case, "dynamics", "mujoco").motion(x)
    curves = Curves(x, evaluate(case, "sweep", x, state).channels, drive=state)
    view = View(title="two units", x="rocker", y="rocker", dashed="rocker_rate", run="dynamics")
    wrong = case.model_copy(update={"view": (view,)})
    with pytest.raises(InputError, match="one axis, but units"):
        validate_case(wrong)
    found = compare(wrong, "dynamics", "mujoco", curves, detectable=False)
    assert found == compare(case, "dynamics", "mujoco", curves, detectable=False)


def test_a_recorded_reference_ignores_the_state_of_the_drives():
    case = load_case(shipped("hacksaw_recorded.toml"))
    x = run_samples(case, "sweep")
    state = plan_run(case, "sweep", "mujoco").motion(x)
    off = tuple(part + 0.1 for part in state)
    found = reference_for(case, "sweep", Curves(x, {}, drive=off)).channels
    truth = evaluate(case, "sweep", x, None).channels
    assert all(np.array_equal(found[name], truth[name]) for name in truth)
    closed = load_case(shipped("hacksaw.toml"))
    assert not np.array_equal(
        reference_for(closed, "sweep", Curves(x, {}, drive=off)).channels["r1"],
        reference_for(closed, "sweep", Curves(x, {}, drive=state)).channels["r1"],
    )


@pytest.mark.parametrize(
    ("error", "allowed", "outcome", "share"),
    [
        (1.0, 2.0, "agrees", 0.5),
        (3.0, 2.0, "differs", 1.5),
        (1.0, 0.0, "differs", np.inf),
        (np.nan, 2.0, "differs", np.inf),
        (np.nan, np.nan, "diverged", np.inf),
        (1.0, np.nan, "unchecked", 0.0),
    ],
)
def test_an_error_is_a_share_of_what_is_allowed(error, allowed, outcome, share):
    """The share is also defined if one of the two is NaN, or if the allowed error is 0."""
    assert make_comparison(error, allowed, outcome).share_of_allowed == share
