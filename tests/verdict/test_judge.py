"""Arrays from anywhere are judged as an engine's curves are, without a sidecar."""

import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from proofmass import InputError, compare, evaluate, judge, load_case
from proofmass.analytic.linkages import fourbar
from proofmass.analytic.protocol import ClosedForm
from proofmass.reference.find import find_reference
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.given_columns import GivenColumn
from tests.shipped import shipped, shipped_files

TIME = np.linspace(0.0, 2.0, 201)
ANGLE, RATE = 0.3 + 2.0 * TIME, 2.0
LENGTHS = {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0}
TRUE = fourbar.solve(ANGLE, RATE, 0.0, **LENGTHS)
COLUMNS = {"time": TIME, "theta": ANGLE, "rocker_angle": TRUE["rocker_angle"]}
HOW = {"reference": "fourbar", "parameters": LENGTHS, "drive": "theta", "tolerance": 1e-9}


def message(curves, **how):
    """The message with which something is refused."""
    with pytest.raises(InputError) as error:
        judge(curves, **{**HOW, **how})
    return str(error.value)


def test_right_curves_agree_and_wrong_ones_differ():
    """The curve is off by 0.01 rad at one sample, and the comparison has that number and place."""
    (found,) = judge(COLUMNS, **HOW)
    assert (found.channel, found.outcome, found.case) == ("rocker_angle", "agrees", "fourbar")
    assert found.detectable["rocker"].size < 1e-7
    wrong = TRUE["rocker_angle"].copy()
    wrong[77] += 0.01
    (found,) = judge({**COLUMNS, "rocker_angle": wrong}, **HOW)
    assert found.outcome == "differs"
    assert found.error_max == pytest.approx(0.01)
    assert found.at == TIME[77]
    assert found.allowed == pytest.approx(1e-9 * np.ptp(TRUE["rocker_angle"]))


def test_a_verdict_is_that_of_a_sidecar():
    """The curves of an engine, given as arrays, have the errors of a comparison by the sidecar."""
    case = load_case(shipped("pendulum.toml"))
    x = np.linspace(0.0, 10.0, 11)
    curves = Curves(
        x, {n: y + 1e-3 for n, y in evaluate(case, "dynamics", x, None).channels.items()}
    )
    by_sidecar = compare(case, "dynamics", "mujoco", curves, detectable=False)
    by_arrays = judge(curves, "pendulum", parameters=case.parameters, detectable=False)
    assert [c.channel for c in by_arrays] == [c.channel for c in by_sidecar]
    for one, other in zip(by_arrays, by_sidecar, strict=True):
        assert one.error_max == other.error_max
        assert (one.outcome, other.outcome) == ("unchecked", "differs")


def test_units_are_those_of_names_and_of_the_call():
    """Degrees in the name of a column, milliseconds in the call, and a tolerance in degrees."""
    columns = {
        "clock": 1e3 * TIME,
        "theta [deg]": np.degrees(ANGLE),
        "rocker_angle [deg]": np.degrees(TRUE["rocker_angle"]) + 0.01,
    }
    how = {**HOW, "x": "clock", "units": {"clock": "ms"}}
    for tolerance, outcome in (("0.02 deg", "agrees"), ({"rocker_angle": "1e-4 rad"}, "differs")):
        (found,) = judge(columns, **{**how, "tolerance": tolerance})
        assert (found.outcome, found.unit) == (outcome, "deg")
        assert found.error_max == pytest.approx(0.01)
        assert found.at <= 2.0


def test_a_data_frame_is_read_by_its_columns_and_its_index():
    """Neither pandas nor polars is needed: what is read is ``columns``, ``[name]``, ``index``."""

    class Frame(SimpleNamespace):
        def __getitem__(self, name):
            return COLUMNS[name]

    frame = Frame(columns=list(COLUMNS))
    assert judge(frame, **HOW)[0].outcome == "agrees"
    frame.columns = ["theta", "rocker_angle"]
    frame.index = TIME
    assert judge(frame, **HOW)[0].outcome == "agrees"


def test_a_csv_file_is_read_by_its_headers(tmp_path):
    """Columns of words are left out; a wrong cell is named with its line."""
    file = tmp_path / "rig.csv"
    rows = [
        f"{t},{np.degrees(a)},on,{y}"
        for t, a, y in zip(TIME, ANGLE, TRUE["rocker_angle"], strict=True)
    ]
    head = "time [s],theta [deg],state,rocker_angle [rad]"
    file.write_text("\n".join([head, *rows]))
    for path in (file, str(file)):
        assert judge(path, **HOW)[0].outcome == "agrees"
    file.write_text("\n".join([head, *rows[:9], "0.09,much,on,1", *rows[10:]]))
    assert message(file).startswith(f"{file}: line 11, theta: 'much' is no number")
    file.unlink()
    assert message(file) == f"{file}: no such recorded curve"


def test_a_wrapped_angle_is_refused():
    wrapped = np.degrees(5.0 * TIME) % 360.0
    assert message({**COLUMNS, "theta [deg]": wrapped}, drive="theta") == (
        "judge: theta: it jumps from 358.099 to 0.963411 deg: the angle is wrapped; unwrap it, as "
        "numpy.unwrap does"
    )


def test_an_angle_that_is_wrapped_after_its_first_value_is_refused():
    wrapped = np.r_[359.5, np.degrees(5.0 * TIME)[1:] % 360.0]
    assert "it jumps from 359.5 to " in message({**COLUMNS, "theta [deg]": wrapped}, drive="theta")


def test_a_column_may_equal_a_quantity_of_another_name():
    columns = {"t": TIME, "theta": ANGLE, "b": 90 - np.degrees(TRUE["rocker_angle"])}
    table = {"equals": "rocker_angle", "scale": -1, "shift": 90, "unit": "deg"}
    assert judge(columns, **HOW, equals={"b": table})[0].outcome == "agrees"
    assert judge(columns, **HOW, equals={"b": "rocker_angle"})[0].outcome == "differs"


def test_the_drive_has_the_parts_that_curves_need():
    """A rate as a column, a number or an array; what is not given is not made up."""
    columns = {**COLUMNS, "w": np.full(TIME.shape, RATE), "rocker_rate": TRUE["rocker_rate"]}
    columns["rocker_acceleration"] = TRUE["rocker_acceleration"]
    for drive in (("theta", "w", 0.0), (ANGLE, RATE, np.zeros(201)), [("theta", "w", 0.0)]):
        found = judge(columns, **{**HOW, "drive": drive})
        assert [c.outcome for c in found] == ["agrees"] * 3
    assert message(columns) == (
        "judge: drive.drive: channel 'rocker_rate' depends on its rate, which is not given; give "
        "(value, rate, acceleration)"
    )
    assert message(columns, drive=("theta", "w")).startswith(
        "judge: drive.drive: channel 'rocker_acceleration' depends on its acceleration, which is"
    )
    case = load_case(shipped("fourbar.toml"))
    state = tuple(np.array([part]) for part in (ANGLE, np.full(201, RATE), np.zeros(201)))
    reference = evaluate(case, "dynamics", TIME, state)
    parameters = {k: v for k, v in case.parameters.items() if not isinstance(v, str)}
    given = replace(reference, drive=state)
    found = judge(given, "fourbar", parameters=parameters, equals={"rocker": "rocker_angle"})
    assert found[0].error_max == 0.0


def test_a_reference_that_reads_the_model_gets_it(tmp_path):
    """The planar solver has the rocker's angle of the model, which the closed form has too."""
    model = shipped("fourbar.toml").with_suffix(".xml")
    columns = {"time": TIME, "a": ANGLE, "rocker": TRUE["rocker_angle"]}
    how = {"drive": {"crank": "a"}, "model": model, "tolerance": 1e-9}
    (found,) = judge(columns, "planar", **how)
    assert (found.channel, found.outcome, found.unit) == ("rocker", "agrees", "rad")
    wrong = {**columns, "rocker": 1.01 * TRUE["rocker_angle"]}
    assert judge(wrong, "planar", **how)[0].outcome == "differs"
    with pytest.raises(InputError) as error:
        judge(columns, "planar", **how, units={"rocker": "mm"})
    assert str(error.value) == (
        "judge: rocker: its unit 'mm' measures another quantity than the sensor, which delivers rad"
    )
    for wrong in (tmp_path / "none.xml", tmp_path / "robot.urdf", tmp_path):
        with pytest.raises(InputError) as error:
            judge(columns, "planar", **{**how, "model": wrong})
        assert str(error.value) == f"judge: model: {str(wrong)!r} is no MJCF, a file NAME.xml"
    with pytest.raises(InputError) as error:
        judge(columns, "planar")
    assert str(error.value) == (
        "judge: model: missing: planar reads an MJCF; give model='NAME.xml'"
    )


def test_a_program_and_recorded_curves_are_references(tmp_path):
    program = tmp_path / "yoke.py"
    program.write_text(
        "import numpy as np\nfrom proofmass.analytic.protocol import Length, Reference\n"
        "class Yoke(Reference):\n    crank: Length\n    def solve(self, motion, ask):\n"
        "        return {'slider': self.crank * np.cos(motion.drive[0])}\n"
    )
    columns = {"time": TIME, "a": ANGLE, "slider": 0.2 * np.cos(ANGLE)}
    how = {"parameters": {"crank": "200 mm"}, "drive": "a", "tolerance": 1e-12}
    (found,) = judge(columns, program, **how)
    assert (found.case, found.outcome) == ("yoke", "agrees")
    rows = "\n".join(f"{t},{y}" for t, y in zip(TIME, columns["slider"], strict=True))
    rig = tmp_path / "rig.csv"
    rig.write_text(f"time [s],slider [m]\n{rows}\n")
    for factor, outcome in ((1.0, "agrees"), (1.01, "differs")):
        given = {"time": TIME, "slider": factor * columns["slider"]}
        (found,) = judge(given, rig, tolerance=1e-3, detectable=False)
        assert found.outcome == outcome


@pytest.mark.parametrize(
    ("change", "how", "words"),
    [
        ({"rocker_angle": [1.0, 2.0]}, {}, "rocker_angle: it has 2 values, and time has 201"),
        (
            {"rocker_angle": np.where(TIME == 1.0, np.nan, 1.0)},
            {},
            "rocker_angle: value 100 is nan, no finite number",
        ),
        (
            {"rocker_angle": ["a"] * 201},
            {},
            "rocker_angle: could not convert string to float: 'a'",
        ),
        (
            {"rocker_angle": np.zeros((201, 2))},
            {},
            "rocker_angle: it must be an array (n,), and has the shape (201, 2)",
        ),
        ({"time": TIME[::-1]}, {}, "time: it does not rise: 2 then 1.99, values 0 and 1"),
        ({}, {"x": "clock"}, "x: there is no column 'clock'; there are: time, theta, rocker_angle"),
        (
            {},
            {"units": {"rocker_angle": "degr"}},
            "rocker_angle: unknown unit 'degr'; write it as in mm, deg, rad/s^2, N m, rev/min; 1 "
            "for a number without a unit",
        ),
        (
            {},
            {"units": {"rocker_angle": "mm"}},
            "rocker_angle: its unit 'mm' is a length, and rocker_angle of fourbar is an angle or a",
        ),
        (
            {"pin_vx": TRUE["pin_vx"]},
            {"units": {"pin_vx": "N"}, "drive": ("theta", RATE)},
            "pin_vx: its unit 'N' is a force, and pin_vx of fourbar is a speed",
        ),
        (
            {"pin_vx": TRUE["pin_vx"]},
            {"drive": ("theta", RATE), "tolerance": {"pin_vx": "1 mm"}},
            "tolerance.pin_vx: a speed [m/s]; '1 mm' is a length",
        ),
        (
            {},
            {"units": {"rocker": "deg"}},
            "units.rocker: there is no column 'rocker'; did you mean 'rocker_angle'? there are: "
            "time, theta, rocker_angle",
        ),
        (
            {},
            {"units": {"time": "mm"}},
            "time: its unit is 'mm', and it must be a time, such as s",
        ),
        ({}, {"drive": "phi"}, "drive.drive.value: there is no column 'phi'; there are: theta, "),
        ({}, {"drive": ("theta", [1.0, 2.0])}, "drive.drive.rate: it has 2 values, and there are "),
        ({}, {"drive": ("theta", 1, 2, 3)}, "drive.drive: give (value, rate, acceleration)"),
        (
            {},
            {"equals": {"rocker": "rocker_angle"}},
            "equals.rocker: there is no column 'rocker'; did you mean 'rocker_angle'? there are: ",
        ),
        (
            {},
            {"equals": {"rocker_angle": "rocker"}},
            "equals.rocker_angle: fourbar has no quantity 'rocker'; did you mean 'rocker_ra",
        ),
        (
            {},
            {"equals": {"rocker_angle": {"equals": "rocker_angle", "factor": 2}}},
            "channels.rocker_angle: unknown key 'factor'; known: equals, unit, scale, shift, only",
        ),
        ({}, {"parameters": {"crank": 1.0}}, "parameters: missing: coupler [m], rocker [m], "),
        (
            {},
            {"parameters": {**LENGTHS, "cranks": 1.0}},
            "parameters.cranks: reference fourbar has no such parameter; did you mean 'crank'? ",
        ),
        (
            {},
            {"parameters": {**LENGTHS, "crank": "1 deg"}},
            "parameters.crank: crank is a length [m]; '1 deg' is an angle",
        ),
        ({}, {"reference": "fivebars"}, "reference: no reference 'fivebars'; did you mean "),
        ({}, {"tolerance": 0.6}, "tolerance: 0.6 of the range lets a curve pass that does not"),
        ({}, {"tolerance": -1.0}, "tolerance: Input should be greater than 0, not -1.0"),
        ({}, {"tolerance": "0.1"}, ""),
        (
            {},
            {"tolerance": {"rocker": 1e-3}},
            "tolerance.rocker: no such column is compared; did you mean 'rocker_angle'? there are",
        ),
        (
            {},
            {"tolerance": "9 rad"},
            "tolerance.0: it allows 9 for channel 'rocker_angle', whose reference has a scale of ",
        ),
        (
            {"rocker_angle": np.degrees(ANGLE)},
            {"units": {"rocker_angle": "deg"}, "tolerance": "1 mm"},
            "tolerance: an angle [rad]; '1 mm' is a length",
        ),
        ({}, {"drive": ("theta", "rocker_angle")}, "equals: no column has the name of a quantity"),
        ({}, {"step": 0.1}, "step: it is of a run; leave it out for arrays"),
    ],
)
def test_what_is_wrong_is_named(change, how, words):
    if words:
        assert message({**COLUMNS, **change}, **how).startswith(f"judge: {words}")
    else:  # a number as a text is SI
        assert judge(COLUMNS, **{**HOW, **how})[0].allowed == 0.1


def test_a_constant_reference_needs_an_absolute_tolerance():
    columns = {**COLUMNS, "theta": np.full(201, 0.3), "rocker_angle": np.full(201, 2.0)}
    assert message(columns) == (
        "judge: tolerance: the reference of 'rocker_angle' is constant, so that a share of its "
        "range means nothing; give it an absolute one, as in tolerance={'*': 1e-3, "
        "'rocker_angle': '0.1 mm'}"
    )
    true = fourbar.solve(0.3, 0.0, 0.0, **LENGTHS)["rocker_angle"]
    columns["rocker_angle"] = np.full(201, true)
    tolerance = {"*": 1e-3, "rocker_angle": "1e-6"}
    assert judge(columns, **{**HOW, "tolerance": tolerance})[0].outcome == "nothing moved"
    assert judge(columns, **{**HOW, "tolerance": "1e-6"})[0].outcome == "nothing moved"


def test_time_is_not_taken_for_the_angle_of_a_drive():
    """A driven mechanism needs its drive, and a free one has none."""
    assert message(COLUMNS, drive=None) == (
        "judge: drive: missing: fourbar is driven; give the motion of its drive, such as "
        "drive=('angle', 'rate', 'acceleration'), names of columns"
    )
    pendulum = {"length": 1.0, "mass": 1.0, "gravity": 9.81, "amplitude": 0.1}
    assert message({**COLUMNS, "angle": TIME}, reference="pendulum", parameters=pendulum) == (
        "judge: drive: pendulum has no drive; leave it out"
    )


def test_closed_forms_are_driven_where_their_cases_have_a_drive():
    """The law by which `judge` asks for a drive holds for all shipped sidecars of motions."""
    seen = set()
    for file in shipped_files():
        table = tomllib.loads(file.read_text())
        name, moves = table["reference"], "equilibrium" not in table.get("run", {})
        if moves and "." not in name and issubclass(reference := find_reference(name), ClosedForm):
            assert reference.is_driven() == ("drive" in table), file
            seen.add(reference.is_driven())
    assert seen == {True, False}


def test_what_has_no_curves_is_refused():
    with pytest.raises(TypeError, match=r"^int has no curves; give Curves, a mapping of names"):
        judge(3, **HOW)
    with pytest.raises(TypeError, match="arrays need a reference"):
        judge(COLUMNS, None)


def test_a_column_is_converted_as_sidecars_convert():
    assert GivenColumn("x", "mm", np.array([9.0])).in_si.tolist() == [0.009]
