"""Keys of errors in sidecars, and parameters that are written with a unit."""

import math
import tomllib

import pytest
from jsonschema import Draft202012Validator

from proofmass.base.errors import InputError
from proofmass.run.schema import sidecar_schema
from proofmass.run.sidecar import load_case
from proofmass.run.validate import validate_case
from tests.shipped import shipped

SIDECAR = """title = "t"
source = "s"
reference = "fourbar"
{first}
[run.sweep]
n = 3
solvers = ["mujoco"]
{rest}
"""
CHANNEL = '[channels]\nrocker = { equals = "rocker", unit = "rad" }\n'
DRIVE = '[drive]\njoint = "crank"\nto = 1.0\n'
FOURBAR = {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0, "mode": 1}


def key_of(text, folder):
    """The key at which a sidecar with this text is refused."""
    file = folder / "bad.toml"
    file.write_text(text)
    with pytest.raises(InputError) as error:
        load_case(file)
    return error.value.key


@pytest.mark.parametrize(
    ("table", "key"),
    [
        # a profile: a name, three columns of a recorded reference, or a table
        ("profile = 3", "drive.profile"),
        ('profile = ["a", "b", 3]', "drive.profile"),
        ('profile = { file = 3, value = "v" }', "drive.profile.file"),
        # a column of it: a name, a table, or rows
        ('profile = { file = "f.csv", value = 3 }', "drive.profile.value"),
        ('profile = { file = "f.csv", rate = { column = 3 } }', "drive.profile.rate.column"),
        ('profile = { file = "f.csv", rate = { scale = 1.0 } }', "drive.profile.rate.column"),
        ("profile = { time = [0.0, true], value = [1.0, 2.0] }", "drive.profile.time.1"),
        ("profile = { time = [0.0], value = [1.0] }", "drive.profile.time"),
        ("parameters = { float = true }", "drive.parameters.float"),
    ],
)
def test_an_error_of_a_drive_names_its_key_and_no_type(table, key, tmp_path):
    rest = f'{CHANNEL}[drive]\njoint = "crank"\n{table}'
    assert key_of(SIDECAR.format(first="", rest=rest), tmp_path) == key


@pytest.mark.parametrize(
    ("table", "key"),
    [
        ("[recording]\nx = 3", "recording.x"),
        ("[recording]\nx = { column = 3 }", "recording.x.column"),
        ("[recording.columns]\nrows = { column = 3 }", "recording.columns.rows.column"),
        ("[parameters]\nstr = [1.0]", "parameters.str"),
        ("[compare_with.int.parameters]\nfloat = true", "compare_with.int.parameters.float"),
        ('[[view]]\ntitle = "v"\nx = "x"\nmarks = { str = "a" }', "view.marks.str"),
        ('[[view]]\ntitle = "v"\nx = "x"\nmarks = 3', "view.marks"),
        (
            '[[chart]]\ntitle = "c"\ndraw = "d"\nparameters = { tuple = [true] }',
            "chart.parameters.tuple",
        ),
        ('[load]\nactuator = "a"\nprofile = { time = 3, value = [1.0, 2.0] }', "load.profile.time"),
        ("[tolerance]\nabs = true", "tolerance"),
        ('[[tolerance]]\nabs = true\nwhy = "w"', "tolerance.0.abs"),
        ("[accuracy.mujoco]\nsweep = true", "accuracy.mujoco.sweep"),
    ],
)
def test_an_error_of_another_table_names_its_key_and_no_type(table, key, tmp_path):
    """Keys that have the name of a type stay."""
    assert key_of(SIDECAR.format(first="", rest=f"{CHANNEL}{DRIVE}{table}"), tmp_path) == key


def test_an_error_of_a_channel_that_is_called_like_a_type_names_it(tmp_path):
    rest = f'{DRIVE}[channels]\nstr = {{ equals = true, unit = "rad" }}\n'
    assert key_of(SIDECAR.format(first="", rest=rest), tmp_path) == "channels.str.equals"


@pytest.fixture
def with_parameters(tmp_path):
    """A function that writes a four-bar with these lines in ``parameters``, and other tables."""
    (tmp_path / "fourbar.xml").write_bytes(shipped("fourbar.xml").read_bytes())

    def write(rest="", **changed):
        values = {name: repr(value) for name, value in FOURBAR.items()} | changed
        lines = "".join(f"{name} = {value}\n" for name, value in values.items())
        file = tmp_path / "fourbar.toml"
        file.write_text(
            SIDECAR.format(first=f"[parameters]\n{lines}", rest=f"{CHANNEL}{DRIVE}{rest}")
        )
        return file

    return write


@pytest.mark.parametrize(
    ("text", "metres"),
    [("250 mm", 0.25), ("2525 mm", 2.525), ("9 mm", 0.009), ("0.1m", 0.1), ("1e3 µm", 1e-3)],
)
def test_a_parameter_with_a_unit_is_converted_to_si(text, metres, with_parameters):
    assert load_case(with_parameters(crank=f'"{text}"')).parameters["crank"] == metres


def test_other_quantities_and_compared_parameters_are_converted_too(with_parameters):
    view = '[[view]]\ntitle = "v"\nx = "crank"\ny = "rocker"\n'
    file = with_parameters(
        rest=f'{view}[compare_with.short]\nparameters = {{ crank = "400 mm", mode = -1 }}\n',
        rocker_mass='"500 g"',
        gravity='"981 cm/s^2"',
    )
    case = load_case(file)
    assert (case.parameters["rocker_mass"], case.parameters["gravity"]) == (0.5, 9.81)
    assert case.compare_with["short"].parameters == {"crank": 0.4, "mode": -1}


def test_an_angle_may_be_in_degrees(models, edit):
    file = edit("pendulum.toml", r"(?m)^amplitude = -[\d.]+", 'amplitude = "-90 deg"')
    assert load_case(file).parameters["amplitude"] == pytest.approx(-math.pi / 2, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("250 deg", "crank is a length [m]; '250 deg' is an angle"),
        ("2 kg", "crank is a length [m]; '2 kg' is a mass"),
        ("2 Pa", "crank is a length [m]; '2 Pa' is in Pa"),
        ("mm", "crank is a length [m]; 'mm' is no finite number with a unit"),
        ("nan mm", "crank is a length [m]; 'nan mm' is no finite number with a unit"),
        ("inf mm", "crank is a length [m]; 'inf mm' is no finite number with a unit"),
        ("250", "crank is a length [m]; '250' has no unit"),
        ("250 furlongz", "crank is a length [m]; unknown unit 'furlongz'"),
        ("1e300 m", "1e+300 is too large"),
        ("-3 mm", "crank must be a positive finite length [m], got -0.003"),
    ],
)
def test_a_parameter_in_a_wrong_unit_is_refused(text, wrong, with_parameters):
    file = with_parameters(crank=f'"{text}"')
    with pytest.raises(InputError) as error:
        validate_case(load_case(file))
    assert error.value.key.startswith("parameters")
    assert error.value.wrong.startswith(wrong)


def test_a_compared_parameter_in_a_wrong_unit_is_refused_at_its_key(with_parameters):
    file = with_parameters(rest='[compare_with.short]\nparameters = { crank = "4 s" }\n')
    with pytest.raises(InputError) as error:
        load_case(file)
    assert (error.value.key, error.value.wrong) == (
        "compare_with.short.parameters.crank",
        "crank is a length [m]; '4 s' is a time",
    )


def test_a_parameter_of_a_chart_in_a_wrong_unit_is_refused_at_its_key(with_parameters):
    chart = '[[chart]]\ntitle = "{}"\ndraw = "coupler_curve"\nparameters = {{ crank = "{}" }}\n'
    file = with_parameters(rest=chart.format("a", "2 m") + chart.format("b", "4 s"))
    with pytest.raises(InputError) as error:
        load_case(file)
    assert error.value.key == "chart.1.parameters.crank"
    assert error.value.wrong == "crank is a length [m]; '4 s' is a time"


def test_a_word_of_a_parameter_that_is_no_quantity_stays():
    """The target of a balancer is a text, which its reference reads itself."""
    case = load_case(shipped("balancer4_sam.toml"))
    assert isinstance(case.parameters["target"], str)


def test_the_schema_accepts_parameters_with_a_unit(with_parameters):
    table = tomllib.loads(with_parameters(crank='"250 mm"').read_text())
    assert not list(Draft202012Validator(sidecar_schema()).iter_errors(table))
