"""Defaults of a sidecar: what is filled in, what is reported, and the text with all keys."""

import re
import sys
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.batch.check import Result
from proofmass.case.case import Case
from proofmass.commands.cli import app
from proofmass.formats.terminal import failure_lines
from proofmass.report import case_figures, case_page, pages, write_report
from proofmass.run.sidecar import (
    accuracy_units,
    default_tolerances,
    fill_runs,
    find_extremes,
    format_sidecar,
    load_case,
    match_quantity,
)
from proofmass.sim.mujoco.settings import ACCURACY as MUJOCO
from proofmass.sim.pymunk.settings import ACCURACY as PYMUNK
from tests.shipped import shipped, shipped_case, sidecar_parameters

SHORT_SIDECAR = """title = "t"
source = "s"
reference = "fourbar"
{more}
[parameters]
crank = 1.0
coupler = 2.0
rocker = 2.5
ground = 3.0
mode = 1
[drive]
joint = "crank"
to = 6.0
{tables}"""


@pytest.fixture(autouse=True)
def here(monkeypatch):
    """Sidecars are read in this process, not in a worker."""
    monkeypatch.setattr(
        sys.modules["proofmass.batch.check"],
        "call_isolated",
        lambda function, *args, **limits: function(*args),
    )


def write_short_case(folder: Path, more: str = "", tables: str = "") -> Case:
    """A case of the four-bar; its sidecar has the required keys, and `more` keys and `tables`."""
    file = folder / "short.toml"
    file.write_text(SHORT_SIDECAR.format(more=more, tables=tables))
    (folder / "short.xml").write_bytes(shipped("fourbar.xml").read_bytes())
    return load_case(file)


def error_of_short_case(folder: Path, more: str = "", tables: str = "") -> str:
    """The message of the input error of such a case, without the path of its folder."""
    with pytest.raises(InputError) as error:
        write_short_case(folder, more, tables)
    return str(error.value).removeprefix(f"{folder}/")


@pytest.mark.parametrize("file", sidecar_parameters())
def test_a_shown_case_loads_to_the_same_case(file, tmp_path):
    """The case is shown with all keys, and with those only that change something."""
    again = tmp_path / file.name
    for other in file.parent.glob("*.[cx]*"):
        (tmp_path / other.name).write_bytes(other.read_bytes())
    case = shipped_case(file)
    for every in (True, False):
        again.write_text(format_sidecar(case, every), encoding="utf-8")
        assert load_case(again).model_copy(update={"file": file}) == case
        assert "accuracy" not in tomllib.loads(format_sidecar(case, every))


def test_rates_beside_springs_are_covered_by_one_default_tolerance():
    """Of the finger: MuJoCo states a limit of its own for the rates of an equilibrium."""
    case = shipped_case(shipped("finger.toml"))
    for solver in ("mujoco", "pymunk"):
        for name, channel in case.channels.items():
            hits = [t for t in case.tolerance if t.covers("sweep", solver, name, channel.unit)]
            assert len(hits) == 1, name
    why = {name: case.tolerance_for("sweep", "mujoco", name).why for name in case.channels}
    rates = {name for name, words in why.items() if words.startswith("stiffness by differences")}
    assert rates == {"proximal_rate", "distal_rate", "tip_velocity.x", "tip_velocity.y"}


def test_a_shown_case_has_the_layout_of_a_sidecar(tmp_path):
    """A channel is one line, headings are in the order of the schema, after an empty line each."""
    case = load_case(shipped("fourbar.toml"))
    odd = case.model_copy(update={"title": 'a "b" \\ \x7f\n\t é 😀', "unmatched": ("*",)})
    lines = format_sidecar(odd, every=False).splitlines()
    assert tomllib.loads("\n".join(lines))["title"] == odd.title
    at = [k for k, line in enumerate(lines) if line.startswith("[")]
    assert all(not lines[k - 1] for k in at)
    heads = list(dict.fromkeys(lines[k] for k in at))
    names = "[parameters]", "[drive]", "[run.sweep]", "[run.dynamics]", "[channels]"
    assert heads == [*names, "[[tolerance]]", *heads[6:]]
    assert '"pin.x" = {equals = "pin_x", unit = "m"}' in lines
    assert '"*" = {}' in lines
    assert 'unit = ["rad", "m"]' in lines
    assert "relative_to_range = 1e-12" in lines
    assert "timeout = 120.0" not in lines
    assert "timeout = 120.0" in format_sidecar(odd).splitlines()


def test_show_prints_all_keys_of_the_short_sidecar_of_the_four_bar():
    file = shipped("fourbar.toml")
    assert len(file.read_text(encoding="utf-8").splitlines()) <= 30
    answer = CliRunner().invoke(app, ["show", str(file)])
    assert answer.exit_code == 0
    table = tomllib.loads(answer.stdout)
    assert table["channels"]["pin_velocity.x"] == {
        "equals": "pin_vx",
        "unit": "m/s",
        "scale": 1.0,
        "shift": 0.0,
    }
    assert "only" not in table["channels"]["holding_moment"]
    assert table["drive"]["from"] == 0.0
    assert table["run"]["sweep"]["timeout"] == 120.0
    assert len(table["tolerance"]) == 10
    for name in ("no_such_file.toml", str(shipped("watt.xml").parent)):
        assert CliRunner().invoke(app, ["show", name]).exit_code == 2


def test_runs_solvers_channels_and_tolerances_are_filled_in(tmp_path):
    case = write_short_case(tmp_path)
    assert {kind: (run.n, run.solvers) for kind, run in case.run.items()} == {
        "sweep": (361, ("mujoco", "pymunk")),
        "dynamics": (361, ("mujoco", "mujoco:default", "pymunk", "pymunk:default")),
    }
    assert case.channels["rocker"].equals == "rocker_angle"
    assert case.channels["coupler_rate.z"].unit == "rad/s"
    allowed = {
        (kind, solver, name): tolerance and (tolerance.relative_to_range, tolerance.why)
        for kind, run in case.run.items()
        for solver in run.solvers
        for name in case.channels_of(kind)
        for tolerance in [case.tolerance_for(kind, solver, name)]
    }
    for engine, own in (("mujoco", MUJOCO), ("pymunk", PYMUNK)):
        assert allowed["sweep", engine, "holding_moment"] == own["sweep"]
        assert allowed["dynamics", engine, "pin.x"] == own["position"]
        assert allowed["dynamics", engine, "rocker_rate"] == own["velocity"]
        assert allowed["dynamics", engine, "point_acceleration.y"] == own["acceleration"]
    assert not any(allowed["dynamics", f"{e}:default", "pin.x"] for e in ("mujoco", "pymunk"))


def test_an_accuracy_replaces_the_engine_s_tolerance_and_keeps_its_reason(tmp_path):
    case = write_short_case(tmp_path, "accuracy.pymunk = { velocity = 7e-7, sweep = 3e-11 }")
    velocity, sweep, position = (
        case.tolerance_for(*place)
        for place in (
            ("dynamics", "pymunk", "rocker_rate"),
            ("sweep", "pymunk", "rocker"),
            ("dynamics", "pymunk", "rocker"),
        )
    )
    assert (velocity.relative_to_range, velocity.why) == (7e-7, PYMUNK["velocity"].why)
    assert (sweep.relative_to_range, position.relative_to_range) == (
        3e-11,
        PYMUNK["position"].relative_to_range,
    )
    assert case.tolerance_for("dynamics", "mujoco", "rocker_rate").relative_to_range == (
        MUJOCO["velocity"].relative_to_range
    )


def test_a_tolerance_replaces_all_defaults_of_its_run_and_engine(tmp_path):
    case = write_short_case(
        tmp_path,
        tables='[[tolerance]]\nrun = "sweep"\nsolver = "pymunk"\n'
        'channels = "pin.x"\nabs = 1.0\nwhy = "w"\n',
    )
    assert case.tolerance_for("sweep", "pymunk", "pin.x").abs == 1.0
    assert case.tolerance_for("sweep", "pymunk", "pin.y") is None
    assert (
        case.tolerance_for("sweep", "mujoco", "pin.y").relative_to_range
        == MUJOCO["sweep"].relative_to_range
    )
    assert case.tolerance_for("dynamics", "pymunk", "pin.y").relative_to_range == (
        PYMUNK["position"].relative_to_range
    )


def test_channels_that_are_not_listed_are_filled_in_by_an_asterisk_only(tmp_path):
    listed = '"pin.x" = { equals = 0.5, unit = "mm" }\nrocker = {}\n'
    assert list(write_short_case(tmp_path, tables=f"[channels]\n{listed}").channels) == [
        "pin.x",
        "rocker",
    ]
    case = write_short_case(tmp_path, tables=f'[channels]\n{listed}"*" = {{}}\n')
    assert (case.channels["pin.x"].equals, case.channels["pin.x"].unit) == (0.5, "mm")
    assert "pin.y" not in case.channels  # the sensor is listed
    assert case.channels["point.y"].equals == "point_y"
    position = case.tolerance_for("dynamics", "mujoco", "pin.x")
    assert position.unit == ("rad", "m", "mm")


def test_a_moment_without_inertia_is_a_channel_of_sweeps_alone(tmp_path):
    """The reference of the shaft knows no inertia, so that its moment is not that of dynamics."""
    assert shipped_case(shipped("shaft_pendulum.toml")).channels["holding_moment"].only == "sweep"
    (tmp_path / "shaft.xml").write_bytes(shipped("shaft_pendulum.xml").read_bytes())
    text = shipped("shaft_pendulum.toml").read_text(encoding="utf-8")
    sidecar = tmp_path / "shaft.toml"
    sidecar.write_text(text.partition("[run")[0] + "[run.dynamics]\n", encoding="utf-8")
    dynamics = load_case(sidecar)
    assert "holding_moment" not in dynamics.channels
    assert "holding_moment" in dynamics.unmatched


def test_sensors_get_the_columns_of_a_recorded_curve_with_their_names(tmp_path):
    rows = "".join(f"{k / 10},{k / 20},{k}\n" for k in range(61))
    (tmp_path / "rig.csv").write_text(f"crank [rad],rocker [rad],pin.x [mm]\n{rows}")
    (tmp_path / "short.xml").write_bytes(shipped("fourbar.xml").read_bytes())
    file = tmp_path / "short.toml"
    head = SHORT_SIDECAR.format(more="", tables="").replace('"fourbar"', '"rig.csv"')
    file.write_text(re.sub(r"(?s)\[parameters\].*\[drive\]", "[drive]", head))
    found = load_case(file)
    channels = {name: (one.equals, one.unit) for name, one in found.channels.items()}
    assert channels == {"rocker": ("rocker", "rad"), "pin.x": ("pin.x", "m")}
    assert {"coupler", "pin_velocity", "holding_moment"} <= set(found.unmatched)


def test_a_sensor_whose_unit_the_model_leaves_open_needs_one(tmp_path):
    write_short_case(tmp_path)
    model, file = tmp_path / "short.xml", tmp_path / "short.toml"
    model.write_text(model.read_text().replace("<sensor>", '<sensor><user name="odd" dim="1"/>'))
    file.write_text(file.read_text() + "[channels]\nodd = {}\n")
    with pytest.raises(InputError) as error:
        load_case(file)
    assert str(error.value) == f"{file}: channels.odd.unit: missing; the model leaves it open"


def test_a_model_of_which_no_sensor_has_the_name_of_a_quantity_is_refused(tmp_path):
    write_short_case(tmp_path)
    model = tmp_path / "short.xml"
    one = '<sensor><jointpos name="odd" joint="rocker"/></sensor>'
    model.write_text(re.sub("(?s)<sensor>.*</sensor>", one, model.read_text()))
    with pytest.raises(InputError) as error:
        load_case(tmp_path / "short.toml")
    words = "no sensor of short.xml has the name of a quantity of fourbar; "
    assert (error.value.key, error.value.wrong[: len(words)]) == ("channels", words)


def test_a_wrong_word_is_answered_with_the_words_that_are_known(tmp_path):
    words = error_of_short_case(tmp_path, tables='[channels]\n"pin.x" = { only = "dynamic" }')
    known = "'sweep', 'dynamics' or 'equilibrium'"
    assert words == f"short.toml: channels.pin.x.only: Input should be {known}"


def test_a_sensor_without_a_quantity_is_reported(tmp_path):
    write_short_case(tmp_path)
    model = tmp_path / "short.xml"
    model.write_text(model.read_text().replace('name="rocker_rate"', 'name="rate_of_the_rocker"'))
    file = tmp_path / "short.toml"
    case = load_case(file)
    assert case.unmatched == ("rate_of_the_rocker",)
    assert "rocker_rate" not in case.channels
    words = "not checked: sensors rate_of_the_rocker; no quantity of fourbar has their names"
    answer = CliRunner().invoke(app, ["show", str(file)])
    assert words in answer.stderr
    assert tomllib.loads(answer.stdout)["channels"]["*"] == {}
    file.write_text(answer.stdout)
    assert load_case(file) == case
    assert next(failure_lines(Result(cases=[case]))).plain.startswith(f"· short: {words}")


def test_a_page_lists_sensors_without_a_quantity(tmp_path, monkeypatch):
    monkeypatch.setattr(
        case_page, "call_isolated", lambda function, *args, **limits: function(*args)
    )
    monkeypatch.setattr(pages, "draw_case", lambda *_: case_figures.Drawings({}))
    case = write_short_case(tmp_path).model_copy(update={"unmatched": ("askew", "tilt")})
    page = write_report(Result(cases=[case]), tmp_path / "r").with_name("short.html")
    assert "Not checked: sensors askew, tilt.</strong>" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("more", "tables", "words"),
    [
        ("accuracy.mujocco = { sweep = 1e-9 }", "", "accuracy.mujocco.sweep: it is used by no run"),
        ("accuracy.mujoco = { speed = 1e-9 }", "", "accuracy.mujoco: unknown key 'speed'"),
        (
            "accuracy.mujoco = { sweep = -1.0 }",
            "",
            "accuracy.mujoco.sweep: Input should be greater",
        ),
        (
            "accuracy.mujoco = { sweep = 1e-9 }",
            '[[tolerance]]\nrelative_to_range = 0.5\nwhy = "w"',
            "accuracy.mujoco.sweep: it is used by no run",
        ),
        ("", '[channels]\n"*" = { unit = "m" }', 'channels."*": it stands for all sensors'),
        ("", "[channels]\nrokcer = {}", "channels.rokcer: short.xml has no sensor 'rokcer'"),
        (
            "",
            '[channels]\n"point.z" = {}',
            "channels.point.z.equals: missing; no quantity of fourbar",
        ),
        ("", "[channels]\nrocker = 5", "channels.rocker"),
        ('model = "none.xml"', "", "model: no file 'none.xml'"),
    ],
)
def test_a_fault_in_defaults_is_reported_with_its_key(more, tables, words, tmp_path):
    assert f"short.toml: {words}" in error_of_short_case(tmp_path, more, tables)


@pytest.mark.parametrize(
    ("channel", "unit", "quantity"),
    [
        ("tip.x", "m", "tip.x"),
        ("pin.y", "m", "pin_y"),
        ("coupler.angle", "rad", "coupler_angle"),
        ("pin_velocity.x", "m/s", "pin_vx"),
        ("pin_acceleration.y", "m/s^2", "pin_ay"),
        ("coupler_rate.z", "rad/s", "coupler_rate"),
        ("guide_moment.z", "N m", "guide_moment"),
        ("slider_velocity.z", "m/s", None),
        ("rocker", "rad", "rocker_angle"),
        ("rocker.tip", "rad", None),  # no "rocker.tip_angle"
        ("slide", "m", "slide"),
        ("crank", "m", None),
    ],
)
def test_a_channel_has_the_quantity_of_its_name(channel, unit, quantity):
    known = [
        "tip.x",
        "tip_x",
        "pin_y",
        "pin_vx",
        "pin_ay",
        "coupler_angle",
        "coupler_rate",
        "rocker_angle",
        "rocker.tip_angle",
        "slide",
        "slider_velocity",
        "guide_moment",
        "crank_angle",
    ]
    assert match_quantity(channel, unit, known) == quantity


def test_free_motions_rods_recorded_and_unchecked_cases_get_no_tolerance(tmp_path):
    """The engine is not the only cause of their errors, or they ask for none."""
    case = write_short_case(tmp_path).model_copy(update={"tolerance": ()})
    assert {t.solver for t in default_tolerances(case, {})} == {("mujoco",), ("pymunk",)}
    rods = shipped_case(shipped("rod_cantilever.toml")).rod
    for changed in (
        {"rod": rods},
        {"unchecked": True},
        {"reference": "rig.csv"},
        {"drive": ()},
    ):
        assert not default_tolerances(case.model_copy(update=changed), {}), changed


def test_an_equilibrium_and_a_run_without_channels_get_no_tolerance(tmp_path):
    case = write_short_case(tmp_path)
    assert accuracy_units(case, "dynamics", MUJOCO) != {}
    assert accuracy_units(case, "equilibrium", MUJOCO) == {}
    only = {name: one.model_copy(update={"only": "sweep"}) for name, one in case.channels.items()}
    still = case.model_copy(update={"channels": only})
    assert accuracy_units(still, "dynamics", MUJOCO) == {}
    assert accuracy_units(still, "sweep", MUJOCO) == {"sweep": ("*",)}


def test_a_tolerance_of_its_own_replaces_those_of_its_run_and_engine_alone(tmp_path):
    own = '[[tolerance]]\nrun = "sweep"\nsolver = "pymunk"\nabs = 1e-3\nwhy = "own"'
    case = write_short_case(tmp_path, tables=own)
    hits = [(t.run, *t.solver) for t in case.tolerance if t.why != "own"]
    assert ("sweep", "pymunk") not in hits
    assert {("sweep", "mujoco"), ("dynamics", "mujoco"), ("dynamics", "pymunk")} <= set(hits)


@pytest.mark.parametrize(
    ("table", "found"),
    [
        ({"a": 1e40, "b": -1e40, "c": 1e-40, "d": 0.0, "e": 10**40, "f": True}, []),
        ({"a": float("inf"), "b": float("nan")}, []),  # which are refused with other words
        ({"run": {"timeout": 1e300, "memory": 1e300}, "why": "1e300"}, []),
        ({"a": [0.0, 1e-300, [1e-300]]}, []),
        ({"a": {"b": -2e40}}, [(("a", "b"), "-2e+40 is too large; numbers may be up to 1e+40")]),
        (
            {"a": [1.0, 10**50]},
            [(("a", 1), "100000000... is too large; numbers may be up to 1e+40")],
        ),
        ({"a": [1.0, -2e40]}, [(("a", 1), "-2e+40 is too large; numbers may be up to 1e+40")]),
        ({"a": -9e-41}, [(("a",), "-9e-41 is too small; numbers other than 0 begin at 1e-40")]),
    ],
)
def test_numbers_near_the_limits_of_floats_are_found(table, found):
    assert list(find_extremes(table)) == found


def samples_of_pendulum(folder: Path, step: float, keys: str) -> int:
    """The number of samples of a pendulum that is released for 1 s, with this step in its model."""
    model = shipped("pendulum.xml").read_text(encoding="utf-8")
    model = re.sub('timestep="[^"]*"', f'timestep="{step!r}"', model)
    (folder / "pendulum.xml").write_text(model, encoding="utf-8")
    sidecar = shipped("pendulum.toml").read_text(encoding="utf-8")
    sidecar = re.sub(r"until = .*\nn = .*\n", f"until = 1.0\n{keys}\n", sidecar)
    (folder / "pendulum.toml").write_text(sidecar, encoding="utf-8")
    return load_case(folder / "pendulum.toml").run["dynamics"].n


@pytest.mark.parametrize("step", [1e-3, 4e-3, 2.5e-3, 1 / 360])
def test_samples_of_a_free_motion_are_whole_steps_apart(step, tmp_path):
    """With 361 samples, the default, a step of 1 ms would be shortened to 0.926 ms."""
    spacing = 1.0 / (samples_of_pendulum(tmp_path, step, "") - 1)
    steps = round(spacing / step)
    assert spacing == pytest.approx(steps * step, rel=1e-12)
    assert 1 / 720 < spacing < 1 / 180


def test_steps_that_do_not_divide_a_motion_are_hardly_shortened(tmp_path):
    spacing = 1.0 / (samples_of_pendulum(tmp_path, 3e-3, "") - 1)
    assert 0.99 < spacing / 3e-3 < 1.0
    text = (tmp_path / "pendulum.toml").read_text(encoding="utf-8")
    (tmp_path / "pendulum.toml").write_text(f"{text}\n[settings.mujoco]\ntimestep = 4e-3\n")
    assert load_case(tmp_path / "pendulum.toml").run["dynamics"].n == 251  # its step, 1 / 250 s


def test_a_number_of_samples_that_is_given_is_kept(tmp_path):
    assert samples_of_pendulum(tmp_path, 1e-3, "n = 362") == 362


FILE = Path("a.toml")  # of a sidecar that is not read
BOTH, TIMED = ["mujoco", "pymunk"], ["mujoco", "mujoco:default", "pymunk", "pymunk:default"]
FULL_RUNS = {
    "sweep": {"n": 361, "solvers": BOTH},
    "dynamics": {"n": 361, "solvers": TIMED},
    "equilibrium": {"solvers": BOTH},
}
"""The runs as docs/sidecar.md states them."""


@pytest.mark.parametrize("kind", FULL_RUNS)
def test_each_kind_of_run_gets_its_samples_and_solvers(kind):
    table = {"reference": "planar", "run": {kind: {}}}
    assert fill_runs(table, FILE) == {**table, "run": {kind: FULL_RUNS[kind]}}
    given = {kind: {"n": 7, "solvers": ["pymunk"]}}
    assert fill_runs({**table, "run": given}, FILE)["run"] == given


def test_a_drive_alone_gets_a_sweep_and_dynamics():
    table = {"reference": "planar", "drive": {"joint": "crank"}}
    runs = {kind: FULL_RUNS[kind] for kind in ("sweep", "dynamics")}
    assert fill_runs(table, FILE) == {**table, "run": runs}
    recorded = fill_runs({**table, "reference": "rig.csv"}, FILE)["run"]  # the rows are the samples
    assert recorded == {kind: {"solvers": run["solvers"]} for kind, run in runs.items()}


@pytest.mark.parametrize("more", [{}, {"run": 3}, {"run": [{}]}])
def test_runs_that_cannot_be_filled_in_are_left_to_the_case(more):
    table = {"reference": "planar", **more}
    assert fill_runs(table, FILE) == table
    odd = {"reference": "planar", "run": {"sweep": 3, "slow": {}}}
    assert fill_runs(odd, FILE)["run"] == {"sweep": 3, "slow": {}}


def test_a_motion_in_space_has_the_engines_that_can_run_it():
    asked = {"run": {"dynamics": {}}}
    in_space = fill_runs({**asked, "reference": "spatial"}, FILE)["run"]["dynamics"]["solvers"]
    assert in_space == ["mujoco", "mujoco:default"]
    planar = fill_runs({**asked, "reference": "planar"}, FILE)["run"]["dynamics"]["solvers"]
    assert planar == ["mujoco", "mujoco:default", "pymunk", "pymunk:default"]


def test_a_driven_mechanism_in_space_has_a_tolerance_for_its_turn():
    case = load_case(shipped("spherical_fourbar.toml"))
    turn = case.tolerance_for("dynamics", "mujoco", "coupler_turn.w")
    assert turn.relative_to_range == MUJOCO["position"].relative_to_range
