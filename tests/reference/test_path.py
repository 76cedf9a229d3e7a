"""Paths of one's own: drives by the inverse problem of a reference, and paths that are refused."""

import json
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from docs.make.paths import PATHS, path_text
from proofmass.analytic.inverse import PathMotion
from proofmass.analytic.linkages import fivebar, threeprr
from proofmass.analytic.rods import rod_pair_driven
from proofmass.batch.check import check
from proofmass.case.drive import motion_source, quintic_spline
from proofmass.commands.cli import app
from proofmass.reference.evaluate import all_quantities
from proofmass.reference.profiles import drive_profiles, load_profiles
from proofmass.run.sidecar import load_case
from proofmass.run.solve import prescribed_run, solve_here
from proofmass.verdict.compare import compare
from tests.shipped import MODELS, shipped, shipped_case

ROOT = Path(__file__).parents[2]
FIGURES = json.loads((ROOT / "tests/data/rod_assemblies.json").read_text())["trajectories"]
CASES = [Path(file).stem for file in PATHS]
LINKAGES = ["fivebar_path", "threeprr_path"]


def motion_of(name: str, x: np.ndarray) -> list[np.ndarray]:
    """Values, rates and accelerations (drives, n) of the drives of a shipped case."""
    profiles = drive_profiles(shipped_case(shipped(f"{name}.toml")), "sweep")
    return [np.array(part) for part in zip(*(one(x) for one in profiles), strict=True)]


def rows_of(name: str) -> np.ndarray:
    """The columns of the file of a shipped path, in its own units."""
    text = shipped(f"{name}.csv").read_text().splitlines()
    return np.array([[float(cell) for cell in line.split(",")] for line in text[3:]]).T


def times_of(name: str) -> np.ndarray:
    """The times of the rows of a shipped path [s]."""
    rows = shipped_case(shipped(f"{name}.toml")).leader
    return np.linspace(0.0, rows.until or 4.0, 101)


@pytest.mark.parametrize("file", PATHS)
def test_files_of_shipped_paths_are_their_closed_forms(file):
    assert (MODELS / file).read_text() == path_text(file)


def test_crank_pins_of_the_five_bar_stay_a_coupler_from_the_rows():
    """The rows, in mm, and the crank pins of the drives are as far apart as couplers are long."""
    left, right = motion_of("fivebar_path", times_of("fivebar_path"))[0]
    _, x, y, *_ = rows_of("fivebar_path")
    tip = 1e-3 * (x + 1j * y)
    for angle, base in ((left, -3.0), (right, 3.0)):
        assert np.abs(base + 4.0 * np.exp(1j * angle) - tip) == pytest.approx(5.0, abs=1e-13)


def test_legs_of_the_robot_are_as_long_as_drawn_at_every_row():
    sliders = motion_of("threeprr_path", times_of("threeprr_path"))[0]
    x, y, phi, *_ = rows_of("threeprr_path")
    for k, (corner, start, guide) in enumerate(
        [(0.0, 0.0, 1.0), (1.0, 3.0, -1.0), (np.exp(1j * np.pi / 3), 2.5 + 2.8j, -1j)]
    ):
        pin = x + 1j * y + corner * np.exp(1j * np.radians(phi))
        assert np.abs(pin - start - guide * sliders[k]) == pytest.approx(1.0, abs=1e-13)


def test_motors_of_the_pair_are_those_of_the_sources_line():
    """At every fifth of the 0.5 m the angles are those that independent shooting found."""
    angles = np.degrees(motion_of("rfr2_line", times_of("rfr2_line"))[0])
    for row in FIGURES["line"]:
        k = round(-row["dx"] / 0.005)
        assert angles[:, k] == pytest.approx(row["inputs_deg"], abs=6e-5)  # 1e-7 m of P


def test_the_pin_is_where_a_turned_motor_leads_it_in_the_source():
    case = shipped_case(shipped("rfr2_motor_line.toml"))
    profiles = drive_profiles(case, "sweep")
    x = -0.5622717 + np.array([0.0, *(row["turn"] for row in FIGURES["motor"])])
    state = tuple(np.array(part) for part in zip(*(one(x) for one in profiles), strict=True))
    known = all_quantities(case, "sweep", x, state, case.parameters)
    for k, row in enumerate(FIGURES["motor"], 1):
        assert [known["pin_x"][k], known["pin_y"][k]] == pytest.approx(row["pose"], abs=2e-6)


@pytest.mark.parametrize("name", CASES)
def test_rates_and_accelerations_are_derivatives(name):
    """They are those of the values between rows, to the error of differences of fourth order."""
    end, h = times_of(name)[-1], 1e-3 * times_of(name)[-1]
    t = end * np.array([0.1037, 0.3141, 0.5213, 0.8319])
    value, rate, acceleration = motion_of(name, t)
    stencil = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}
    found = [motion_of(name, t + k * h) for k in stencil]
    for part, exact in ((0, rate), (1, acceleration)):
        slope = sum(w * one[part] for w, one in zip(stencil.values(), found, strict=True)) / h
        scale = np.abs(exact).max()
        assert slope == pytest.approx(exact, abs=2e-4 * scale)  # h is a tenth of a row's interval
    assert np.ptp(value) > 0.0


@pytest.mark.parametrize(("module", "name"), [(fivebar, "fivebar"), (threeprr, "threeprr")])
def test_drives_between_the_rows_are_the_inverse_solution(module, name):
    """The drives are the inverse problem of the spline through the rows, at any time."""
    from scipy.interpolate import CubicSpline

    case, times = shipped_case(shipped(f"{name}_path.toml")), times_of(f"{name}_path")
    rows = rows_of(f"{name}_path")
    places = 1e-3 * rows[1:3] if name == "fivebar" else rows[:3] * [[1.0], [1.0], [np.pi / 180]]
    spline, t = CubicSpline(times, places, axis=1), np.linspace(0.0, times[-1], 977)
    given = {**case.parameters, **case.drive[0].parameters}
    names = module.follow_path.__kwdefaults__ or {}
    takes = set(names) | set(module.follow_path.__annotations__) - {"motion", "return"}
    solution = module.follow_path(
        PathMotion(t, spline(t), spline(t, 1), spline(t, 2)),
        **{key: value for key, value in given.items() if key in takes},
    )
    found = motion_of(f"{name}_path", t)
    for part, exact in zip(found, solution, strict=True):
        assert np.abs(part - exact).max() <= 1e-12 * np.abs(exact).max()  # rounding


def test_rates_of_rods_are_derivatives_of_their_inputs_along_a_bent_path():
    """Angles, rates and accelerations of the pair satisfy polynomials of fifth degree.

    Between two places those through all three agree with the solution half way, which differences
    of the angles alone would need a twentieth of the step for.
    """
    case = shipped_case(shipped("rfr2_line.toml"))
    names = ("theta1", "theta2")
    given = {**case.parameters, **{key: case.drive[0].parameters[key] for key in names}}

    def solve(t):
        turn = np.exp(2j * np.pi * t)
        motion = [0.05 * (turn - 1.0), 0.05 * 2j * np.pi * turn, -0.05 * (2 * np.pi) ** 2 * turn]
        parts = [np.array([one.real, one.imag]) for one in motion]
        parts[0] += [[0.2927527499], [-0.3407610093]]
        load = 0.1 * t  # N, which grows along the path
        return rod_pair_driven.follow_path(
            PathMotion(t, *parts, {"force_x": np.full(t.size, 0.1)}), **given, force_x=load
        )

    t = np.linspace(0.0, 1.0, 161)
    every = solve(t)
    for k in (0, 1):
        spline = quintic_spline(t[::2], *(part[k, ::2] for part in every))
        assert np.abs(spline(t[1::2]) - every[0][k, 1::2]).max() < 1e-9
    guess = {key: value for key, value in given.items() if key not in names}
    growth = {"force_x": np.full(t.size, 0.1)}
    pin = rod_pair_driven.solve(*every, **guess, force_x=0.1 * t, load_rates=growth)
    speed = 0.05 * 2j * np.pi * np.exp(2j * np.pi * t)  # of the pin, which the motors and load move
    assert np.abs(pin["pin_vx"] + 1j * pin["pin_vy"] - speed).max() < 1e-9
    wrong = quintic_spline(t[::2], every[0][0, ::2], every[1][0, ::2], 0.0 * every[2][0, ::2])
    assert np.abs(wrong(t[1::2]) - every[0][0, 1::2]).max() > 1e-6


def test_loads_of_a_file_without_times_are_at_its_rows():
    case = shipped_case(shipped("threeprr_path.toml"))
    loads, times = load_profiles(case, "sweep"), times_of("threeprr_path")
    found = np.array([one(times)[0] for one in loads])
    assert found == pytest.approx(rows_of("threeprr_path")[3:], abs=1e-14)
    assert loads[2].words.startswith(
        "value M of threeprr_path.csv at the rows of the path, a cubic"
    )


def test_a_load_changes_the_motors_that_hold_the_platform_in_its_place():
    case = shipped_case(shipped("rfr3_path.toml"))
    still = case.model_copy(update={"load": (), "channels": case.channels})
    x = times_of("rfr3_path")
    loaded, constant = (
        np.array([one(x)[0] for one in drive_profiles(each, "sweep")]) for each in (case, still)
    )
    change = np.abs(loaded - constant)
    assert change[:, [0, 50, 100]].max() < 1e-6  # where the load is that of the constant 0.5 N
    assert change[:, [25, 75]].min() > 1e-4


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("fivebar_path", 'name="left_tip" pos="5 0 0"', 'name="left_tip" pos="5.001 0 0"'),
        ("threeprr_path", 'name="slider_3" pos="2.5 2.8 0"', 'name="slider_3" pos="2.501 2.8 0"'),
        ("rfr2_line", 'name="motor2" pos="0.3 0 0"', 'name="motor2" pos="0.31 0 0"'),
        ("pfr3_line", 'gear="0.3 -0.2', 'gear="0.36 -0.2'),
        ("rfr3_path", 'gear="0 0.5', 'gear="0 0.52'),
    ],
)
def test_a_wrong_model_leaves_the_path(name, old, new, models, edit):
    """A wrong number in the model turns the verdict of every case with a path."""
    case = load_case(models / f"{name}.toml")
    edit(case.model, re.escape(old), new)
    run = case.run["sweep"].model_copy(update={"n": 5})
    case = case.model_copy(update={"run": {"sweep": run}})
    found = compare(case, "sweep", "mujoco", solve_here(case, "sweep", "mujoco"), detectable=False)
    assert "differs" in {one.outcome for one in found}


HEADER = "x [m],y [m]"
FAULTS = {
    "out of reach": (
        lambda k: (2.0 + 0.1 * k, 6.0),
        HEADER,
        "line 19: behind row 18 of 101, x = 3.725 m, y = 6 m: tip out of reach at (3.725, 6) m: "
        "the circles of left crank and coupler miss by 0.012526 m; keep the first 18 rows, up to "
        "0.34 s, or move the path",
    ),
    "through a singular pose": (
        lambda k: (0.5, 6.0 - 0.12 * k),
        HEADER,
        "line 24: row 23 of 101, x = 0.5 m, y = 3.36 m: before it the path passes a singular pose",
    ),
    "never there": (lambda k: (20.0 + k, 6.0), HEADER, "begin the path elsewhere"),
    "a jump": (
        lambda k: (2.0 - 0.01 * k + 0.5 * (k > 50), 6.0),
        HEADER,
        "line 53: x jumps from 1.5 to 1.99 m in 0.02 s",
    ),
    "no motion": (lambda k: (2.0, 6.0), HEADER, "all rows are at the same place"),
    "no units": (lambda k: (2.0 - 0.01 * k, 6.0), "x,y", "has no unit in its header"),
    "another quantity": (lambda k: (2.0, 6.0), "x [m],y [kg]", "is in 'kg', where m is needed"),
    "no column": (lambda k: (2.0, 6.0), "x [m],z [m]", "y is missing: path.csv has no column 'y'"),
    "no number": (lambda k: ("two", 6.0), HEADER, "line 2, x: 'two' is no number"),
    "times that fall": (lambda k: (-0.1 * k, 6.0), "t [s],y [m]", "t does not rise"),
}


@pytest.fixture
def led(models: Path):
    """``led(rows, header, **keys)`` writes a path of the five-bar and returns its sidecar."""

    def write(place, header=HEADER, count=101, drive="", until="until = 2.0", more=""):
        rows = [",".join(map(str, place(k))) for k in range(count)]
        (models / "path.csv").write_text("\n".join([header, *rows]) + "\n")
        text = (models / "fivebar_path.toml").read_text()
        head = text[: text.index("[[drive]]")]
        tables = f"""[[drive]]
joint = "left"
profile = {{ path = "path.csv"{drive} }}
{until}
parameters = {{ left_mode = 1, right_mode = -1{more} }}

[[drive]]
joint = "right"

[run.sweep]
n = 5
solvers = ["mujoco"]

[channels]
"tip.x" = {{ equals = "tip_x", unit = "m" }}

[[tolerance]]
abs = 1e-9
why = "rounding"
"""
        file = models / "led.toml"
        file.write_text('model = "fivebar_path.xml"\n' + head + tables)
        return file

    return write


def bad_input(file: Path) -> str:
    """What the command prints for bad input, which must end with exit code 2."""
    answer = CliRunner().invoke(app, ["check", str(file), "--jobs", "1"])
    assert answer.exit_code == 2, answer.output
    assert "Traceback" not in answer.output
    return " ".join(answer.output.split())


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_path_is_named_by_its_row_and_place(fault, led):
    place, header, words = FAULTS[fault]
    assert words in bad_input(led(place, header))


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"until": ""}, "the rows of path.csv have no times: give until"),
        ({"count": 3}, "3 rows; a path needs 4"),
        ({"drive": ", phi = 0.0"}, "phi: leave it out; the reference leads along x, y"),
        ({"drive": ', x = "u"'}, "x is missing: path.csv has no column 'u'"),
        ({"drive": ', xx = "u"'}, "unknown key 'xx'"),
        ({"more": ", lft_mode = 1"}, "parameters.lft_mode: the inverse problem of fivebar has no"),
        ({"more": ", mode = 1"}, "has no such parameter"),
        ({"until": "until = 2.0\nfrom = 1.0"}, "from goes with to or with a rate; a path has"),
    ],
)
def test_a_bad_key_of_a_path_is_named(keys, words, led):
    assert words in bad_input(led(lambda k: (2.0 - 0.01 * k, 6.0), **keys))


def test_a_path_in_another_assembly_mode_says_which_parameter_is_wrong(led):
    file = led(lambda k: (2.0 - 0.01 * k, 6.0))
    file.write_text(file.read_text().replace("mode = 1   ", "mode = -1   ", 1))
    assert "led.toml: parameters: the direct problem is elsewhere than the path" in bad_input(file)


def test_a_reference_without_an_inverse_problem_lists_those_that_have_one(led):
    file = led(lambda k: (2.0 - 0.01 * k, 6.0))
    text = re.sub(r"(?s)\[parameters\].*?(?=\[\[drive)", "", file.read_text())
    file.write_text(text.replace('reference = "fivebar"', 'reference = "planar"'))
    words = bad_input(file)
    assert "reference 'planar' has no inverse problem" in words
    for name in ("fivebar", "threeprr", "rod_pair_driven", "rod_platform_driven"):
        assert name in words


def test_coordinates_may_be_columns_with_units_or_numbers(led):
    """Millimetres under another name and a constant lead along the same line."""
    plain = led(lambda k: (2.0 - 0.01 * k, 6.0))
    t = np.linspace(0.0, 2.0, 21)
    one = [drive(t)[0] for drive in drive_profiles(load_case(plain), "sweep")]
    file = led(
        lambda k: (0.02 * k, 2000.0 - 10.0 * k),
        "t [s],along [mm]",
        drive=', x = "along", y = 6.0',
        until="",
    )
    two = [drive(t)[0] for drive in drive_profiles(load_case(file), "sweep")]
    assert np.array(two) == pytest.approx(np.array(one), abs=1e-13)
    assert prescribed_run(load_case(file), "sweep").x[-1] == 2.0


def test_a_line_at_constant_speed_has_no_acceleration(led):
    """Rows with rounded digits are a straight line, and the tip has no acceleration at any time."""
    file = led(lambda k: (f"{2.0 - 0.02 * k + 1e-10 * (-1) ** k:.12f}", 6.0))
    case = load_case(file)
    run = prescribed_run(case, "sweep")
    x = np.linspace(0.0, 2.0, 333)
    known = all_quantities(case, "sweep", x, run.motion(x), case.parameters)
    assert known["tip_vx"] == pytest.approx(-1.0, abs=1e-9)
    assert np.abs([known["tip_ax"], known["tip_ay"], known["tip_vy"]]).max() < 1e-12


def test_cranks_go_on_through_a_turn(led):
    """The angle of a crank is continuous where the tip passes the half-line left of its base."""
    turn = 2.0 * np.pi / 100.0
    file = led(lambda k: (-3.0 + 4.5 * np.cos(turn * k), 4.5 * np.sin(turn * k)))
    file.write_text(file.read_text().replace("right_x = 3.0 ", "right_x = -2.9 "))
    case = load_case(file)
    x = np.linspace(0.0, 2.0, 41)
    whole = drive_profiles(case, "sweep")[0](x)[0]
    assert np.ptp(whole) == pytest.approx(2.0 * np.pi, abs=1e-9)
    single = np.concatenate([drive_profiles(case, "sweep")[0](x[k : k + 1])[0] for k in range(41)])
    assert single == pytest.approx(whole, abs=1e-12)


def test_rods_that_cannot_be_led_say_where_and_by_how_much(models):
    """The line of the source leaves the workspace of three rods on motors, which are taut there."""
    table = (models / "pfr3_line.csv").read_text().splitlines()[3:]
    first = [float(cell) for cell in table[0].split(",")]
    start = 0.0164836451, 0.0206022059, 1.2027380807
    rows = [
        [float(cell) - a + b for cell, a, b in zip(line.split(","), first, start, strict=True)]
        for line in table
    ]
    text = "\n".join(["x [m],y [m],phi [rad]", *(",".join(map(repr, row)) for row in rows)])
    (models / "away.csv").write_text(text + "\n")
    file = models / "rfr3_path.toml"
    sidecar = re.sub(r"(?s)\[load\].*?(?=\[run)", "", file.read_text())
    file.write_text(sidecar.replace("rfr3_path.csv", "away.csv"))
    words = bad_input(file)
    assert "away.csv: line " in words
    assert re.search(r"rod 2 is too short by [\d.e-]+ m; keep the first \d+ rows", words)


def test_a_pin_that_motors_cannot_hold_is_refused(models):
    """Below the circles of the source is a fold, beyond which the pin is not stable.

    The inverse problem has a solution there, as the pin is given; the direct problem ends.
    """
    rows = [f"{0.2927527 + 0.0015 * k},{-0.340761 - 0.0015 * k}" for k in range(101)]
    (models / "fold.csv").write_text("\n".join(["x [m],y [m]", *rows]) + "\n")
    file = models / "rfr2_line.toml"
    file.write_text(file.read_text().replace("rfr2_line.csv", "fold.csv"))
    words = bad_input(file)
    assert re.search(r"fold.csv: line \d+: row \d+ of 101, x = 0.3\d+ m", words)
    assert "before it the path passes a singular pose" in words


@pytest.mark.parametrize("name", CASES)
def test_drives_of_a_path_go_to_other_processes_and_into_programs(name):
    """A pickled run has the same motion, and so has the table of a written program."""
    run = prescribed_run(shipped_case(shipped(f"{name}.toml")), "sweep")
    again = pickle.loads(pickle.dumps(run))
    assert np.array_equal(again.motion(run.x)[0], run.motion(run.x)[0])
    names: dict = {"np": np}
    exec(motion_source([one.profile for one in run.drives], run.x), names)
    t = np.linspace(run.x[0], run.x[-1], 57)
    assert names["motion"](t)[0] == pytest.approx(run.motion(t)[0], abs=1e-9)


def test_an_equilibrium_run_of_a_path_is_refused(models):
    file = models / "rfr3_path.toml"
    text = re.sub(r"(?s)\[load\].*?(?=\[run)", "", file.read_text())
    file.write_text(text.replace("[run.sweep]", "[run.equilibrium]"))
    assert "run.equilibrium: its drives stand still" in bad_input(file)


def test_an_equilibrium_run_of_a_motion_profile_is_refused(models):
    """It would hold the drives where none of the profile's places need be."""
    file = models / "rfr2_circles.toml"
    file.write_text(file.read_text().replace("[run.sweep]", "[run.equilibrium]"))
    assert "the profile of 'motor1' moves it" in bad_input(file)


GANTRY = '''
from proofmass.analytic.inverse import InverseProblem
from proofmass.analytic.protocol import Length, Reference


def lead(motion, *, drum):
    return tuple(part / drum for part in (motion.place, motion.rate, motion.acceleration))


class Gantry(Reference):
    """A trolley on two crossed slides, each wound by a drum."""

    inverse = InverseProblem({"x": "trolley_x", "y": "trolley_y"}, lead)
    drum: Length

    def solve(self, motion, ask):
        (along, across), *_ = motion.drive
        return {"trolley_x": self.drum * along, "trolley_y": self.drum * across}
'''
GANTRY_MODEL = """<mujoco model="gantry"><compiler angle="radian"/><option gravity="0 0 0"/>
<worldbody><body name="bridge"><joint name="along" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body name="trolley"><joint name="across" type="slide" axis="0 1 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><site name="hook"/></body></body></worldbody>
<sensor><framepos name="hook" objtype="site" objname="hook"/></sensor></mujoco>"""
GANTRY_SIDECAR = """title = "Gantry along a path"
source = "closed form"
model = "gantry.xml"
reference = "gantry.py"
parameters = { drum = 1.0 }

[[drive]]
joint = "along"
profile = { path = "path.csv" }
until = 3.0

[[drive]]
joint = "across"

[run.sweep]
n = 13
solvers = ["mujoco", "pymunk"]

[channels]
"hook.x" = { equals = "trolley_x", unit = "m" }
"hook.y" = { equals = "trolley_y", unit = "m" }

[[tolerance]]
abs = 1e-9
why = "rounding"
"""


@pytest.fixture
def gantry(tmp_path: Path) -> Path:
    """A sidecar with a reference of somebody's own that solves an inverse problem."""
    (tmp_path / "gantry.py").write_text(GANTRY)
    (tmp_path / "gantry.xml").write_text(GANTRY_MODEL)
    rows = [f"{np.cos(u)!r},{np.sin(2 * u)!r}" for u in np.linspace(0.0, 2.0, 41).tolist()]
    text = "\n".join(["x [m],y [m]", *rows]).replace("np.float64(", "").replace(")", "")
    (tmp_path / "path.csv").write_text(text + "\n")
    file = tmp_path / "gantry.toml"
    file.write_text(GANTRY_SIDECAR)
    return file


def test_a_reference_of_ones_own_leads_a_path_in_both_engines(gantry):
    report = check([gantry], jobs=1)
    assert {one.outcome for one in report.comparisons} == {"agrees"}, report.errors
    assert {one.solver for one in report.comparisons} == {"mujoco", "pymunk"}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("part / drum", "part / drum / 1.001", "the direct problem is elsewhere than the path"),
        ("part / drum", "part[:1] / drum", "moves (1,) drives, and the case has 2"),
        ("part / drum", "part / dram", "NameError"),
        ('"x": "trolley_x"', '"r": "trolley_x"', "a path has no coordinate 'r'"),
    ],
)
def test_a_wrong_inverse_problem_of_ones_own_is_refused(old, new, words, gantry):
    program = gantry.with_suffix(".py")
    program.write_text(program.read_text().replace(old, new))
    assert words in bad_input(gantry)
