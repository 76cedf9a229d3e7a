"""Drives that follow the rows of a file, and channels compared with the prescribed motion."""

import re
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from proofmass.analytic.linkages.hacksaw import motor
from proofmass.analytic.linkages.hacksaw import solve as solve_hacksaw
from proofmass.base.errors import InputError
from proofmass.base.recorded import RecordedColumn
from proofmass.batch.check import check
from proofmass.case.case import ProfileTable
from proofmass.case.profile import SampledProfile, find_jump, make_sampled_profile
from proofmass.reference.evaluate import all_quantities, evaluate
from proofmass.reference.profiles import drive_profiles, prescribed_quantities
from proofmass.run.sidecar import format_sidecar, load_case
from proofmass.run.solve import plan_run, solve_here
from proofmass.verdict.compare import compare
from tests.shipped import shipped

ROW_TIMES = np.linspace(0.0, 2.0, 81)


def make_profile(
    folder: Path, start: float = 0.0, rows: np.ndarray | None = None, **table
) -> SampledProfile:
    """The motion profile of a file with columns t, q, w, by default of a sine and its rate."""
    if rows is None:
        rows = np.column_stack([ROW_TIMES, np.sin(3.0 * ROW_TIMES), 3.0 * np.cos(3.0 * ROW_TIMES)])
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    folder = Path(mkdtemp(dir=folder))  # since a change within a tick of a file's time is not seen
    (folder / "motor.csv").write_text("\n".join(["t [s],q [rad],w [rad/s]", *lines]) + "\n")
    return make_sampled_profile(folder, ProfileTable(file="motor.csv", **table), start, "rad")


@pytest.mark.parametrize(
    "table", [{"value": "q"}, {"rate": "w"}, {"rate": "w", "interpolation": "linear"}]
)
def test_rate_and_acceleration_are_derivatives_and_the_value_their_integral(tmp_path, table):
    profile = make_profile(tmp_path, **table)
    t, h = np.linspace(0.111, 1.8871, 57), 1e-6  # no row within h of any of them
    _, rate, acceleration = profile(t)
    ahead, behind = profile(t + h), profile(t - h)
    assert (ahead[0] - behind[0]) / (2 * h) == pytest.approx(rate, abs=1e-8)
    assert (ahead[1] - behind[1]) / (2 * h) == pytest.approx(acceleration, abs=1e-7)
    nodes, weights = np.polynomial.legendre.leggauss(4)  # exact for pieces of degree 7
    half = 0.5 * np.diff(ROW_TIMES)[:, None]
    rates = profile((ROW_TIMES[:-1, None] + half * (1.0 + nodes)).ravel())[1].reshape(half.size, -1)
    travel = np.cumsum((half * weights * rates).sum(axis=1))
    first, *ends = profile(ROW_TIMES - 1e-16)[0]
    assert np.array(ends) - first == pytest.approx(travel, abs=1e-13)


def test_a_motion_profile_goes_through_its_rows(tmp_path):
    assert make_profile(tmp_path, value="q")(ROW_TIMES)[0] == pytest.approx(
        np.sin(3.0 * ROW_TIMES), abs=1e-15
    )
    straight = make_profile(tmp_path, rate="w", interpolation="linear", start=0.5)
    rates = 3.0 * np.cos(3.0 * ROW_TIMES)
    value, rate, acceleration = straight(ROW_TIMES)
    assert rate == pytest.approx(rates, abs=1e-14)
    whole = cumulative_trapezoid(rates, ROW_TIMES, initial=0.0)  # exact for straight lines
    assert value == pytest.approx(0.5 + whole, abs=1e-14)
    assert acceleration[:-1] == pytest.approx(np.diff(rates) / np.diff(ROW_TIMES), abs=1e-12)
    curved = make_profile(tmp_path, rate="w", start=0.5)  # within 1e-6, the error of the spline
    assert curved(ROW_TIMES)[0] == pytest.approx(0.5 + np.sin(3.0 * ROW_TIMES), abs=1e-6)


def test_samples_beyond_the_rows_by_rounding_alone_are_covered(tmp_path):
    """The rows are 25 ms apart, so that a thousandth of this is 25 us."""
    profile = make_profile(tmp_path, value="q")
    for first, last, covered in (
        (-2e-5, 2.0 + 2e-5, True),
        (-3e-5, 2.0, False),
        (0.0, 2.0 + 3e-5, False),
    ):
        assert profile.covers(np.array([first, last])) == covered


def test_a_spline_is_of_fourth_order_and_states_its_error(tmp_path):
    """The error of a value falls with fourth order; the stated bound is at most ten times larger.

    The rate of a profile that is given as a rate has the same order, which is not tested here.
    """
    between = np.linspace(0.0, 2.0, 4001)
    errors = []
    for n in (41, 81):
        t = np.linspace(0.0, 2.0, n)
        rows = np.column_stack([t, np.sin(3.0 * t), 3.0 * np.cos(3.0 * t)])
        profile = make_profile(tmp_path, rows=rows, value="q")
        errors.append(float(np.abs(profile(between)[0] - np.sin(3.0 * between)).max()))
        bound = float(re.search(r"may be off by (\S+) rad", profile.words)[1])
        assert errors[-1] <= bound <= 10 * errors[-1]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)


def test_the_rows_of_the_hacksaw_give_the_motion_of_its_motor():
    """With straight lines between 1000 rows the value is within 6.3e-6 rad of the motor's 6 pi.

    The acceleration is a step function.
    """
    case = load_case(shipped("hacksaw_sampled.toml"))
    (profile,) = drive_profiles(case, "dynamics")
    t = np.linspace(0.0, profile.times[-1], 20_011)
    value, rate, acceleration = profile(t)
    wanted = motor(t)
    assert np.abs(value - wanted[0]).max() == pytest.approx(6.3e-6, rel=0.02)
    assert np.abs(rate - wanted[1]).max() < 2e-5
    assert np.abs(acceleration - wanted[2]).max() < 0.0301
    assert "steps up to 0.03 rad/s^2" in profile.words


def test_the_prescribed_motion_is_a_quantity_of_its_own():
    case = load_case(shipped("hacksaw_inventor_shaped.toml"))
    x = np.linspace(0.0, 1.0, 5)
    found = prescribed_quantities(case, "dynamics", x)
    assert list(found) == ["drive.crank", "drive.crank.rate", "drive.crank.acceleration"]
    assert np.array(list(found.values())) == pytest.approx(np.array(motor(x)))
    late = tuple(np.array([part]) for part in motor(x + 0.01))
    there = evaluate(case, "dynamics", x, late).channels
    assert there["theta2"] == pytest.approx(motor(x)[0], abs=1e-15)  # not the drive's state
    prompt = tuple(np.array([part]) for part in motor(x))
    assert there["r1"] != pytest.approx(evaluate(case, "dynamics", x, prompt).channels["r1"])


def test_the_prescribed_motion_of_a_steady_drive_depends_on_the_run(edit):
    file = edit(
        "fourbar.toml",
        r"\[channels\]",
        '[channels]\nasked = { equals = "drive.crank", unit = "rad" }',
    )
    edit("fourbar.xml", "<sensor>", '<sensor><jointpos name="asked" joint="crank"/>')
    edit("fourbar.toml", "from = 0.0", "from = 0.5")
    case = load_case(file)
    x = np.array([0.5, 1.0])
    sweep, time = (
        prescribed_quantities(case, kind, x)["drive.crank"] for kind in ("sweep", "dynamics")
    )
    assert sweep.tolist() == [0.5, 1.0]
    assert time.tolist() == [0.5 + case.drive[0].speed * t for t in x]
    known = all_quantities(
        case, "sweep", x, plan_run(case, "sweep", "mujoco").motion(x), {**case.parameters}
    )
    assert known["drive.crank"].tolist() == sweep.tolist()
    for kind in ("sweep", "dynamics"):
        found = compare(case, kind, "mujoco", solve_here(case, kind, "mujoco"), detectable=False)
        assert next(c for c in found if c.channel == "asked").relative_to_range < 1e-6


def test_the_lag_of_a_drive_is_the_error_of_its_channel():
    """The channel of a drive is compared with the prescribed motion, so that a lag is its error.

    Channels of the linkage are compared with the reference at the values that the drive had.
    """
    case = load_case(shipped("hacksaw_inventor_shaped.toml"))
    curves = solve_here(case, "dynamics", "mujoco:default")
    found = {c.channel: c for c in compare(case, "dynamics", "mujoco:default", curves)}
    assert found["theta2"].error_max == pytest.approx(0.36, abs=0.02)  # the lag [deg]
    asked = np.squeeze(plan_run(case, "dynamics", "mujoco").motion(curves.x))
    state = np.squeeze(curves.drive)
    drive_channels = ("theta2", "theta2_rate", "theta2_acceleration")
    for name, had, law in zip(drive_channels, state, asked, strict=True):
        own = np.degrees(np.abs(had - law).max())
        # the channel is a sensor's reading: both are rounded
        assert found[name].error_max == pytest.approx(own, rel=1e-9, abs=1e-9), name
    truth, other = (
        solve_hacksaw(*motion, crank=0.075, coupler=0.170, offset=0.045)
        for motion in (state, asked)
    )
    linkage = [name for name in found if not name.startswith("theta2")]
    assert len(linkage) == 9
    for name in linkage:
        unit = 1.0 if name.startswith("r1") else np.degrees(1.0)
        error, at_asked = (
            unit * np.abs(curves.channels[name] - known[name]).max() for known in (truth, other)
        )
        assert found[name].error_max == pytest.approx(error, rel=1e-9), name
        assert at_asked != pytest.approx(error, rel=1e-2), name


def test_a_sidecar_with_a_profile_is_written_and_read_again(models):
    file = models / "hacksaw_sampled.toml"
    case = load_case(file)
    given = case.drive[0].profile.model_copy(
        update={"rate": None, "value": RecordedColumn(column="w2"), "interpolation": "spline"}
    )
    by_value = case.model_copy(
        update={"drive": (case.drive[0].model_copy(update={"profile": given}),)}
    )
    for each in (case, by_value):
        for every in (True, False):
            file.write_text(format_sidecar(each, every))
            assert load_case(file) == each


BAD_PROFILES = {
    "no file": ('file = "hacksaw_motor.csv"', 'file = "motor.csv"', ["no such recorded curve"]),
    "no column": ('rate = "w2"', 'rate = "omega2"', ["no column 'omega2'", "w2"]),
    "wrong quantity": ('rate = "w2"', 'rate = "t"', ["'s'", "rad/s is needed"]),
    "both": ('rate = "w2"', 'rate = "w2", value = "t"', ["either value or rate"]),
    "neither": ('rate = "w2", ', "", ["either value or rate"]),
    "unknown key": ('rate = "w2"', 'rate = "w2", unit = "deg"', ["unknown key 'unit'", "file, "]),
    "unknown way": ('"linear"', '"quintic"', ["'spline', 'linear' or 'held'"]),
    "straight value": ('rate = "w2"', 'value = "w2"', ["rate that jumps at each of them"]),
    "too long": ('joint = "crank"', 'joint = "crank"\nuntil = 4.0', ["nothing is extrapolated"]),
}


@pytest.mark.parametrize("name", BAD_PROFILES)
def test_a_bad_profile_is_reported(name, edit):
    old, new, words = BAD_PROFILES[name]
    file = edit("hacksaw_sampled.toml", re.escape(old), new)
    (error,) = check([file], jobs=1).errors
    assert all(word in str(error) for word in words), str(error)
    assert "drive" in error.key or error.file.name in ("motor.csv", "hacksaw_motor.csv")


BAD_ROWS = {
    "falls": (r"\n0\.011661417,[^\n]*", r"\n0.000000001,0.02", ["line 7", "t does not rise"]),
    "not a number": (r"\n0\.011661417,[^\n]*", r"\n0.011661417,nan", ["line 7, w2", "not finite"]),
    "jumps": (
        r"\n2\.503(\d+),370\.\d*",
        r"\n2.503\1,100.0",
        ["w2 jumps from", "no drive has the acceleration", "several rows"],
    ),
    "another unit": (r"w2 \[deg/s\]", "w2 [m/s]", ["'m/s'", "rad/s is needed"]),
}


@pytest.mark.parametrize("name", BAD_ROWS)
def test_bad_rows_of_a_profile_are_reported_with_their_place(name, edit, models):
    old, new, words = BAD_ROWS[name]
    edit("hacksaw_motor.csv", old, new, 1)
    (error,) = check([models / "hacksaw_sampled.toml"], jobs=1).errors
    assert all(word in str(error) for word in words), str(error)


def test_a_spline_needs_four_rows_and_straight_lines_need_two(tmp_path):
    rows = np.column_stack([ROW_TIMES, ROW_TIMES, 2.0 * ROW_TIMES])
    with pytest.raises(InputError, match="3 rows; a spline needs 4"):
        make_profile(tmp_path, rows=rows[:3], rate="w")
    assert make_profile(tmp_path, rows=rows[:4], rate="w").pieces.shape == (5, 3)
    straight = make_profile(tmp_path, rows=rows[:2], rate="w", interpolation="linear")
    assert straight(ROW_TIMES[1:2])[0] == pytest.approx(ROW_TIMES[1:2] ** 2)
    with pytest.raises(InputError, match="at least two rows are needed"):
        make_profile(tmp_path, rows=rows[:1], rate="w", interpolation="linear")


def test_a_jump_of_the_angle_is_refused_and_a_wrapped_angle_recognized(tmp_path):
    def stepped(by: float) -> np.ndarray:
        return np.column_stack(
            [ROW_TIMES, ROW_TIMES + by * (ROW_TIMES > 1.01), np.ones(ROW_TIMES.size)]
        )

    with pytest.raises(InputError, match=r"line 43: q jumps .* no drive has the rate"):
        make_profile(tmp_path, rows=stepped(0.5), value="q")
    with pytest.raises(InputError, match="no drive has the rate"):  # 0.8 turns are not whole
        make_profile(tmp_path, rows=stepped(5.0), value="q")
    with pytest.raises(InputError, match="the angle is wrapped; add unwrap = true"):
        make_profile(tmp_path, rows=stepped(-2 * np.pi), value="q")
    whole = make_profile(tmp_path, rows=stepped(-2 * np.pi), value={"column": "q", "unwrap": True})
    assert whole(ROW_TIMES)[0] == pytest.approx(ROW_TIMES, abs=1e-12)


def test_a_step_of_a_millionth_of_the_range_is_no_jump():
    """Before it the curve is constant, so that any step is much steeper than what is around it."""
    rest_and_rise = np.maximum(ROW_TIMES - 1.5, 0.0) ** 3
    after = np.arange(ROW_TIMES.size) > 20
    for share, row in ((0.9e-6, None), (1.1e-6, 20)):
        step = share * np.ptp(rest_and_rise) * after
        assert find_jump(ROW_TIMES, rest_and_rise + step) == row


def test_kinks_of_a_few_rows_are_allowed(tmp_path):
    """Four rows of a trapezoidal rate are written on purpose, so their kinks are not refused."""
    rows = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 5.0], [3.0, 0.0, 5.0], [4.0, 0.0, 0.0]])
    profile = make_profile(tmp_path, rows=rows, rate="w", interpolation="linear")
    assert profile(np.array([1.0, 3.0, 4.0]))[0].tolist() == [2.5, 12.5, 15.0]


def test_a_start_value_is_allowed_with_a_rate_alone(edit, models):
    edit("hacksaw_sampled.toml", 'joint = "crank"', 'joint = "crank"\nfrom = 0.25')
    case = load_case(models / "hacksaw_sampled.toml")
    assert drive_profiles(case, "dynamics")[0](np.zeros(1))[0] == 0.25
    edit("hacksaw_sampled.toml", re.escape('rate = "w2", interpolation = "linear"'), 'value = "w2"')
    with pytest.raises(InputError, match="its value has a start"):
        load_case(models / "hacksaw_sampled.toml")


@pytest.mark.parametrize(
    ("new", "words"),
    [
        ('rate = "w2", interpolation = "held"', "'held' goes with the value of a load: no drive"),
        ('value = "w2", interpolation = "linear"', "'linear' goes with rate: a value that is"),
    ],
)
def test_interpolations_with_a_jumping_rate_are_refused(edit, models, new, words):
    edit("hacksaw_sampled.toml", re.escape('rate = "w2", interpolation = "linear"'), new)
    with pytest.raises(InputError, match=words):
        load_case(models / "hacksaw_sampled.toml")
