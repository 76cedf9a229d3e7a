"""Unknown names, patterns and units of a sidecar are reported before anything runs."""

import re
import subprocess
import sys
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from proofmass.base.errors import InputError
from proofmass.base.units import (
    SI_POWERS,
    parse_unit,
    same_quantity,
    si_unit,
    unit_powers,
    unit_registry,
)
from proofmass.batch.check import check
from proofmass.case.case import Case, Tolerance
from proofmass.reference.evaluate import evaluate
from proofmass.report.data import plotted_run
from proofmass.report.figures import draw_overlay
from proofmass.report.style import solver_looks
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run, solve
from proofmass.run.validate import validate_case
from proofmass.verdict.compare import compare
from tests.report.test_report import curves_with_error, result_with_errors
from tests.shipped import MODELS, shipped, shipped_case, shipped_files, sidecar_parameters

FOURBAR = load_case(shipped("fourbar.toml"))
SWEEP_TOLERANCE_SOLVER = r'(run = "sweep"\nsolver = )"mujoco"'
WRONG_SIDECARS = {
    "solver of a tolerance": (
        "fourbar",
        SWEEP_TOLERANCE_SOLVER,
        r'\1"mujco"',
        ["tolerance.0.solver", "'mujco'", "did you mean 'mujoco'?"],
    ),
    "one of several solvers": (
        "fourbar",
        SWEEP_TOLERANCE_SOLVER,
        r'\1["mujoco", "pymnuk"]\n#',
        ["tolerance.0.solver", "'pymnuk'", "did you mean 'pymunk'?"],
    ),
    "channels of a tolerance": (
        "fourbar",
        SWEEP_TOLERANCE_SOLVER,
        r'\1"mujoco"\nchannels = ["roker"]',
        ["tolerance.0.channels", "'roker'", "did you mean 'rocker'?"],
    ),
    "unit of a tolerance": (
        "fourbar",
        SWEEP_TOLERANCE_SOLVER,
        r'\1"mujoco"\nunit = "radd"',
        ["tolerance.0.unit", "'radd'", "did you mean 'rad'?"],
    ),
    "run of a tolerance": (
        "fourbar_released",
        r'run = "dynamics"',
        'run = "sweep"',
        ["tolerance.0.run", "no run.sweep", "there are: dynamics"],
    ),
    "nothing covered": (
        "fourbar",
        SWEEP_TOLERANCE_SOLVER,
        r'\1"mujoco"\nunit = "m"\nchannels = "rocker"',
        ["tolerance.0", "covers nothing"],
    ),
    "settings": (
        "hacksaw",
        r"\[settings.pymunk\]",
        "[settings.pymunkk]",
        ['settings."pymunkk"', "did you mean 'pymunk'?"],
    ),
    "solver of a run": (
        "fourbar",
        r'"mujoco", "mujoco:default"',
        '"mujoco", "mujco:default"',
        ["run.dynamics.solvers", "'mujco'", "did you mean 'mujoco'?"],
    ),
    "channels of refine": (
        "rod_cantilever",
        r'"rod.angle"\] ',
        '"rod.angel"] ',
        ["refine.channels", "'rod.angel'", "did you mean 'rod.angle'?"],
    ),
    "only": (
        "fourbar_released",
        r'unit = "m" }',
        'unit = "m", only = "sweep" }',
        ["only", "no run.sweep"],
    ),
    "x of a view": (
        "balancer_sine",
        r'x = "pendulum"',
        'x = "pendelum"',
        ["view.0.x", "'pendelum'", "did you mean 'pendulum'?"],
    ),
    "y of a view": (
        "balancer_sine",
        r'y = "holding_moment"',
        'y = "holding_momnet"',
        ["view.0.y", "did you mean 'holding_moment'?"],
    ),
    "dashed of a view": (
        "balancer_sine",
        r'dashed = "target"',
        'dashed = "traget"',
        ["view.0.dashed", "did you mean 'target'?"],
    ),
    "stack of a view": (
        "balancer_sine",
        r'stack = \["energy1"',
        'stack = ["enregy1"',
        ["view.1.stack", "did you mean 'energy1'?"],
    ),
    "equals": (
        "fourbar",
        '"rocker_angle"',
        '"rocker_angel"',
        ["channels.rocker.equals", "did you mean 'rocker_angle'?"],
    ),
    "sensor": (
        "fourbar",
        r"rocker = \{",
        "rokcer = {",
        ["fourbar.toml: channels.rokcer", "fourbar.xml", "did you mean 'rocker'?"],
    ),
    "part of a sensor": ("fourbar", '"pin.x"', '"pin.u"', ["channels.pin.u", "pin.x, .y or .z"]),
    "part of a rod": (
        "rod_cantilever",
        '"rod.moment" =',
        '"rod.momnet" =',
        ["channels.rod.momnet", ".moment"],
    ),
    "joint": (
        "fourbar",
        'joint = "crank"',
        'joint = "cranc"',
        ["drive.joint", "did you mean 'crank'?"],
    ),
    "key": (
        "fourbar_crossed",
        'start = "crossed"',
        'start = "crosed"',
        ["start", "did you mean 'crossed'?"],
    ),
    "reference": (
        "fourbar",
        'reference = "fourbar"',
        'reference = "forbar"',
        ["reference", "did you mean 'fourbar'?"],
    ),
    "parameter": (
        "fourbar",
        "coupler = 2.0",
        "copler = 2.0",
        ["parameters.copler", "did you mean 'coupler'?"],
    ),
    "key of a table": (
        "fourbar",
        r"\[drive\]",
        "[drive]\nrat = 1.0",
        ["unknown key 'rat'", "did you mean 'rate'?"],
    ),
    "no unit at all": (
        "fourbar",
        r'(rocker_angle", unit = )"rad"',
        r'\1"banana"',
        ["channels.rocker.unit", "unknown unit 'banana'", "mm, deg"],
    ),
    "mass of an angle": (
        "fourbar",
        r'(rocker_angle", unit = )"rad"',
        r'\1"kg"',
        ["channels.rocker.unit", "'kg'", "delivers rad"],
    ),
    "frequency of a rate": (
        "fourbar",
        r'(rocker_rate", unit = )"rad/s"',
        r'\1"Hz"',
        ["channels.rocker_rate.unit", "'Hz'", "delivers rad/s"],
    ),
    "rate of an acceleration": (
        "fourbar",
        r'(point_ax", unit = )"m/s\^2"',
        r'\1"m/s"',
        ["channels.point_acceleration.x.unit", "delivers m/s^2"],
    ),
    "force of a hinge": (
        "fourbar",
        r'(?s)"N m"(.*)"N m"(.*)"N m"',
        r'"N"\1"N"\2"N"',
        ["channels.holding_moment.unit", "delivers N m"],
    ),
    "moment of a rod": (
        "rod_cantilever",
        r'(?s)"N m" \}(.*)"N m"\]',
        r'"N" }\1"N"]',
        ["channels.rod.moment.unit", "delivers N m"],
    ),
    "unit of a view": (
        "balancer_sine",
        'unit = "J"\\n$',
        'unit = "banana"\n',
        ["view.1.unit", "unknown unit 'banana'"],
    ),
}


@pytest.mark.parametrize("wrong", WRONG_SIDECARS)
def test_unknown_names_and_units_are_reported_before_anything_runs(
    wrong, models, edit, monkeypatch
):
    name, old, new, words = WRONG_SIDECARS[wrong]
    edit(f"{name}.toml", old, new, count=1)
    monkeypatch.setattr(
        sys.modules["proofmass.batch.check"],
        "run_task",
        lambda *_: pytest.fail("a run was started"),
    )
    result = check([models / f"{name}.toml"])
    assert result.exit_code == 2
    (error,) = map(str, result.errors)  # reported once
    assert all(word in error for word in [f"{name}.toml", *words]), error


@given(
    key=st.sampled_from(["solver", "unit", "channels"]),
    pattern=st.text(st.sampled_from("abcdmojunkrp.*?[]:/ "), min_size=1, max_size=8),
)
def test_a_tolerance_loads_if_and_only_if_its_pattern_matches_a_name(key, pattern):
    case = FOURBAR
    names = {
        "solver": [s for run in case.run.values() for s in run.solvers],
        "unit": [c.unit for c in case.channels.values()],
        "channels": [*case.channels],
    }[key]
    tolerance = {"abs": 1.0, "why": "x", key: pattern}
    table = case.model_dump(by_alias=True) | {"tolerance": [tolerance]}
    matches = any(fnmatchcase(name, pattern) for name in names)
    if key == "unit" and pattern != "*":  # a unit has no wildcards
        matches = pattern in names
    if matches:
        assert Case(**table).tolerance == (Tolerance(**tolerance),)
    else:
        with pytest.raises(ValueError, match=re.escape(f"tolerance.0.{key}: {pattern!r} matches")):
            Case(**table)


TURN = 2.0 * np.pi  # rad
POUND_FORCE = 0.45359237 * 9.80665  # N; pound and standard gravity by definition
SI_UNITS_BY_DEFINITION = {
    "mm": ("m", 1e-3),
    "km": ("m", 1e3),
    "um": ("m", 1e-6),
    "in": ("m", 0.0254),
    "ft": ("m", 0.3048),
    "deg": ("rad", TURN / 360.0),
    "rev": ("rad", TURN),
    "mrad": ("rad", 1e-3),
    "arcmin": ("rad", TURN / 21600.0),
    "ms": ("s", 1e-3),
    "min": ("s", 60.0),
    "kN": ("N", 1e3),
    "mJ": ("J", 1e-3),
    "g": ("kg", 1e-3),
    "lbf": ("N", POUND_FORCE),
    "N mm": ("N m", 1e-3),
    "deg/s^2": ("rad/s^2", TURN / 360.0),
    "°": ("rad", TURN / 360.0),
    "°/s": ("rad/s", TURN / 360.0),
    "rev/min": ("rad/s", TURN / 60.0),
    "mm/s": ("m/s", 1e-3),
    "kg mm^2": ("kg m^2", 1e-6),
}
"""SI unit and factor of units, by the definitions of the SI and of the international foot."""


@pytest.mark.parametrize("unit", SI_UNITS_BY_DEFINITION)
def test_units_are_converted_to_si_by_their_definitions(unit):
    """The SI unit measures the same quantity, and its own factor is 1."""
    si, factor = SI_UNITS_BY_DEFINITION[unit]
    found = si_unit(unit)
    assert unit_powers(found[0]) == unit_powers(si)
    assert found[1] == pytest.approx(factor, rel=1e-15, abs=0)  # a few roundings
    assert same_quantity(unit, si)
    assert si_unit(found[0]) == (found[0], 1.0)


@pytest.mark.parametrize("unit", ["m/s2", "-", "", "2 m", "degC", "banana"])
def test_unknown_units_are_refused(unit):
    with pytest.raises(ValueError, match="unknown unit"):
        si_unit(unit)


@pytest.mark.parametrize("unit", SI_POWERS)
def test_the_powers_of_an_si_unit_are_those_of_its_definition(unit):
    """The table, which avoids the import of pint, has the powers that pint finds."""
    base = dict(unit_registry().get_base_units(parse_unit(unit))[1]._units)
    words = ("meter", "kilogram", "second", "radian")
    assert SI_POWERS[unit] == tuple(base.pop(word, 0) for word in words)
    assert not base


def test_an_angle_is_not_dimensionless():
    assert not same_quantity("rad", "1")
    assert not same_quantity("Hz", "rad/s")
    assert same_quantity("rpm", "deg/s")
    assert unit_powers("N m") == (2, 1, -2, 0)
    assert unit_powers("deg") == (0, 0, 0, 1)


LEVER_ACROSS_X = """<mujoco><worldbody>
<body name="lever"><joint name="pin" axis="1 0 0"/><geom size=".1" pos="0 .5 0" mass="1"/>
<site name="end" pos="0 .5 0" {turn}/></body></worldbody>
<sensor><jointpos name="pin" joint="pin"/>
<framexaxis name="camber" objtype="site" objname="end"/></sensor></mujoco>"""


def lever_across_x(folder: Path, turn: str, channels: str) -> Path:
    """The sidecar of a lever that moves in the plane of y and z."""
    (folder / "lever.xml").write_text(LEVER_ACROSS_X.format(turn=turn))
    sidecar = folder / "lever.toml"
    sidecar.write_text(
        'title = "t"\nsource = "s"\nreference = "planar"\n'
        '[drive]\njoint = "pin"\nfrom = 0.0\nto = 1.0\nrate = 1.0\n' + channels
    )
    return sidecar


def test_an_axis_that_is_normal_to_the_plane_has_no_angle(tmp_path):
    """Its components in the plane are rounding, and so would be their arctangent."""
    with pytest.raises(InputError, match="x axis is normal to the plane of motion"):
        validate_case(load_case(lever_across_x(tmp_path, "", '[channels]\n"camber.angle" = {}\n')))
    case = load_case(lever_across_x(tmp_path, "", ""))
    assert (list(case.channels), case.unmatched) == (["pin"], ("camber",))


def test_a_view_of_an_axis_that_is_normal_to_the_plane_is_refused(tmp_path):
    """The planar reference has the arctangent of rounding as a quantity of that name."""
    view = '[[view]]\ntitle = "v"\nx = "pin"\ny = "camber.angle"\nunit = "rad"\n'
    with pytest.raises(InputError, match=r"view\.y: 'camber\.angle': the x axis is normal to"):
        validate_case(load_case(lever_across_x(tmp_path, "", view)))


def test_an_axis_in_the_plane_has_an_angle(tmp_path):
    case = load_case(lever_across_x(tmp_path, 'zaxis="1 0 0"', ""))
    assert list(case.channels) == ["pin", "camber.angle"]


def test_shipped_models_are_valid_xml():
    """MuJoCo accepts "--" in a comment, which XML does not allow."""
    for file in shipped_files("*.xml"):
        ElementTree.parse(file)


def test_every_sensor_of_a_shipped_model_is_read_by_a_sidecar():
    """A shipped model has only what its cases need; `proofmass diet` would remove other sensors."""
    read: dict[Path, set[str]] = {}
    for file in shipped_files():
        case = shipped_case(file)
        read.setdefault(case.model_path, set()).update(n.partition(".")[0] for n in case.channels)
    for model, names in read.items():
        sensors = ElementTree.parse(model).getroot().iterfind("sensor/*")
        assert [s.get("name") for s in sensors if s.get("name") not in names] == [], model.name


@pytest.mark.parametrize("file", sidecar_parameters())
def test_shipped_cases_are_valid(file):
    validate_case(shipped_case(file))


def test_cases_in_si_units_do_not_import_pint():
    """The import of pint takes longer than that of everything else."""
    line = (
        "import sys; from proofmass.run.sidecar import load_case\n"
        "from proofmass.run.validate import validate_case\n"
        "validate_case(load_case('models/linkages/hacksaw_recorded.toml'))\n"
        "sys.exit('pint' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", line], check=True, cwd=MODELS.parent)


def edit_units(models: Path, edit) -> Path:
    """The four-bar with an angle in degrees, a rate in rev/min and a length in millimetres."""
    edit("fourbar.toml", r'(rocker_angle", unit = )"rad"', r'\1"deg", shift = 10.0')
    edit("fourbar.toml", r'(rocker_rate", unit = )"rad/s"', r'\1"rev/min"')
    edit("fourbar.toml", r'(pin_x", unit = )"m"', r'\1"mm"')
    text = (models / "fourbar.toml").read_text()
    (models / "fourbar.toml").write_text(
        text.partition("[[tolerance]]")[0]
        + """
[[tolerance]]
abs = 1e-3
why = "in the channel's unit"
"""
    )
    return models / "fourbar.toml"


def test_a_channel_in_another_unit_is_compared_in_it(models, edit):
    before = {c.channel: c for c in compare_sweep(load_case(shipped("fourbar.toml")), 0.01)}
    case = load_case(edit_units(models, edit))
    after = {c.channel: c for c in compare_sweep(case, 0.01)}
    for name, unit, factor in (
        ("rocker", "deg", 180 / np.pi),
        ("pin.x", "mm", 1e3),
        ("rocker_rate", "rev/min", 30 / np.pi),
    ):
        c, known = after[name], before[name]
        assert c.unit == unit
        assert c.error_max == pytest.approx(known.error_max * factor, rel=1e-9)
        assert c.nrmse == pytest.approx(known.nrmse, rel=1e-9)
        assert c.allowed == 1e-3
        # the detectable change is the tolerance over the slope of the closed form, in any unit
        for p, notice in known.detectable.items():
            assert c.detectable[p].size == pytest.approx(
                notice.size * 1e-3 / factor / known.allowed, rel=1e-6, abs=0
            )
    x = np.linspace(0, 2 * np.pi, 37)
    truth = evaluate(case, "sweep", x, plan_run(case, "sweep", "mujoco").motion(x)).channels
    plain = evaluate(
        load_case(shipped("fourbar.toml")), "sweep", x, plan_run(case, "sweep", "mujoco").motion(x)
    ).channels
    assert truth["rocker"] - plain["rocker"] == pytest.approx(np.radians(10.0))  # the shift [deg]


def compare_sweep(case: Case, error_share: float):
    """Compare curves of a sweep that are off by a share of their range."""
    return compare(case, "sweep", "mujoco", curves_with_error(case, "sweep", error_share))


def test_a_simulator_agrees_in_degrees(models, edit):
    edit("fourbar.toml", r'(rocker_angle", unit = )"rad"', r'\1"deg"')
    edit("fourbar.toml", r'unit = \["rad", "m"\]', 'unit = ["rad", "m", "deg"]')
    case = load_case(models / "fourbar.toml")
    curves = solve(case, "sweep", "mujoco")
    found = {c.channel: c for c in compare(case, "sweep", "mujoco", curves, detectable=False)}
    assert {c.outcome for c in found.values()} == {"agrees"}
    # the rocker swings between the poses with crank and coupler in line, 2 - 1 and 2 + 1 long
    inner, outer = (np.degrees(np.arccos((2.5**2 + 3**2 - r**2) / 15)) for r in (1, 3))
    assert found["rocker"].allowed == pytest.approx(1e-12 * (outer - inner), rel=1e-3, abs=0)


def test_a_figure_is_in_the_unit_of_the_channel(models, edit):
    case = load_case(edit_units(models, edit))
    view = plotted_run(result_with_errors(case, sweep=0.01), case, "sweep")
    ax = Figure().subplots()
    draw_overlay(ax, view, "pin.x", solver_looks(["mujoco"]))
    assert ax.get_ylabel() == "[mm]"
    span = 1e3 * np.ptp(view.longest.channels["pin.x"])
    assert np.ptp(ax.lines[0].get_ydata()) == pytest.approx(span, rel=1e-12)
    assert view.error("mujoco", "pin.x").max() == pytest.approx(0.01 * span, rel=0.02)


def test_a_whole_turn_is_recognized_in_degrees(models, edit):
    edit("fourbar.toml", r'(rocker_angle", unit = )"rad"', r'\1"deg"')
    edit("fourbar.toml", r'unit = \["rad", "m"\]', 'unit = ["rad", "m", "deg"]')
    case = load_case(models / "fourbar.toml")
    curves = curves_with_error(case, "sweep", 0.0)
    turned = dict(curves.channels, rocker=curves.channels["rocker"] + 2 * np.pi)
    (c,) = (
        c
        for c in compare(case, "sweep", "mujoco", replace(curves, channels=turned))
        if c.channel == "rocker"
    )
    assert "1 whole turn(s)" in c.message


def test_a_recorded_curve_is_converted_to_the_unit_of_the_channel(models, edit):
    edit("hacksaw_recorded.toml", r'("theta1", unit = )"rad"', r'\1"deg"')
    edit("hacksaw_recorded.toml", r'unit = \["rad", "m"\]', 'unit = ["rad", "m", "deg"]')
    case = load_case(models / "hacksaw_recorded.toml")
    validate_case(case)
    assert {
        c.outcome for c in compare(case, "sweep", "mujoco", solve(case, "sweep", "mujoco"))
    } == {"agrees"}
    edit("hacksaw_recorded.toml", r'("theta3", unit = )"rad"', r'\1"mm"')
    edit("hacksaw_recorded.toml", '"rad", "m", "deg"', '"m", "deg", "mm"')
    with pytest.raises(InputError, match=r"theta3.*another quantity"):
        validate_case(load_case(models / "hacksaw_recorded.toml"))
