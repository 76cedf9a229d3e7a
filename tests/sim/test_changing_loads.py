"""Tests of loads that change along a sweep: references, both engines, and bad input.

Loads that change in time are tested in `tests/sim/test_controls_in_time.py`.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from proofmass.analytic.rods import integrate, rod_pair_driven, rod_platform_driven
from proofmass.batch.check import check
from proofmass.reference.evaluate import evaluate
from proofmass.reference.find import find_reference, reference_names
from proofmass.reference.samples import run_samples
from proofmass.run.sidecar import format_sidecar, load_case
from proofmass.run.solve import call_engine, plan_run, prescribed_run
from proofmass.sim.mujoco.linkage import Linkage
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.pymunk import loads as pymunk_loads
from tests.shipped import shipped
from tests.verdicts import all_comparisons

CASES_WITH_CHANGEABLE_LOADS = {
    "fourbar": "fourbar",
    "slider_crank": "slider_crank",
    "hacksaw": "hacksaw",
    "fivebar": "fivebar",
    "threeprr": "threeprr",
    "rod_pair_driven": "rfr2_load_path",
    "rod_platform_driven": "pfr3",
}
"""A shipped case for each reference whose loads may change along a path."""


def changeable_parameters(name: str) -> list[str]:
    """Names of the parameters of a reference that may change along a path."""
    return [key for key, p in find_reference(name).parameters.items() if p.may_change]


def test_every_reference_with_changeable_loads_has_a_case_here():
    assert {name for name in reference_names() if changeable_parameters(name)} == set(
        CASES_WITH_CHANGEABLE_LOADS
    )


@pytest.mark.parametrize("name", CASES_WITH_CHANGEABLE_LOADS)
def test_curves_under_a_changing_load_are_those_of_each_constant_load(name):
    """A reference is solved at several samples with a load that changes from sample to sample.

    At each sample its curves must equal those that it computes with the constant load of the same
    size.
    """
    case = load_case(shipped(f"{CASES_WITH_CHANGEABLE_LOADS[name]}.toml")).model_copy(
        update={"load": ()}
    )
    solve = find_reference(name).function
    x = run_samples(case, "sweep")[:: max(1, run_samples(case, "sweep").size // 6)][:5]
    state = [
        part[0] if len(case.drive) == 1 else part
        for part in prescribed_run(case, "sweep").motion(x)
    ]
    share = np.linspace(0.2, 1.3, x.size)
    parameters = dict(case.parameters)
    sizes = {key: float(parameters.get(key) or 0.7) for key in changeable_parameters(name)}
    found = solve(*state, **parameters | {key: size * share for key, size in sizes.items()})
    for k in range(x.size):
        alone = solve(*state, **parameters | {key: size * share[k] for key, size in sizes.items()})
        for key, curve in found.items():
            # in references of rods, Newton's method ends at 1e-10 of the unknowns' sizes
            np.testing.assert_allclose(curve[..., k], alone[key][..., k], rtol=1e-7, atol=1e-8)
    constant = solve(*state, **parameters | {key: size * share[0] for key, size in sizes.items()})
    assert any(not np.allclose(constant[key][..., -1], found[key][..., -1]) for key in found)


PAIR = load_case(shipped("rfr2_load_path.toml"))
PLATFORM = load_case(shipped("pfr3.toml"))


@pytest.mark.parametrize(
    ("case", "module", "places", "rates"),
    [
        (PAIR, rod_pair_driven, ("pin_x", "pin_y"), ("pin_vx", "pin_vy")),
        (PLATFORM, rod_platform_driven, ("x", "y", "phi"), ("x_rate", "y_rate", "phi_rate")),
    ],
)
def test_rates_under_a_growing_load_are_derivatives_of_the_path(case, module, places, rates):
    t = np.linspace(0.0, 1.0, 41)
    start = np.array([[drive.start] for drive in case.drive])
    half_range = np.array([[(drive.to - drive.start) / 2] for drive in case.drive])
    parameters = dict(case.parameters)
    loads = {key: parameters.get(key, 0.01) for key in changeable_parameters(case.reference)}
    growing = {key: size * t**2 for key, size in loads.items()}
    speed = {key: 2 * size * t for key, size in loads.items()}
    found = module.solve(
        start + half_range * t, half_range, **parameters | growing, load_rates=speed
    )
    without_load_rates = module.solve(start + half_range * t, half_range, **parameters | growing)
    for place, rate in zip(places, rates, strict=True):
        slope = CubicSpline(t, found[place])(t, 1)[2:-2]  # the spline's ends are of a lower order
        size = np.abs(slope).max()
        # the error of the spline is proportional to h^4
        np.testing.assert_allclose(found[rate][2:-2], slope, rtol=0, atol=2e-4 * size)
        assert (
            np.abs(without_load_rates[rate][2:-2] - slope).max() > 2e-3 * size
        )  # without the load's rate


FOUR_BAR = """
title = "Four-bar whose rocker carries a moment that grows"
source = "a test"
reference = "{reference}"

[parameters]
{parameters}

[drive]
joint = "crank"
from = 0.0
{motion}

[load]
actuator = "load"
{load}

[run.sweep]
n = 25

[channels]
holding_moment = {{ equals = "holding_moment", unit = "N m" }}
{channels}
"""
FOUR_BAR_PARAMETERS = """crank = 1.0
coupler = 2.0
rocker = 2.5
ground = 3.0
crank_mass = 1.0
coupler_mass = 2.0
rocker_mass = 2.5
gravity = 9.81
rocker_load = 1.0
"""
GROWING_LOAD = 'from = -2.0\nto = 6.0\nscales = "rocker_load"'


@pytest.fixture
def four_bar(tmp_path: Path):
    """``four_bar(reference, load, motion, channels)`` writes a sidecar of a loaded four-bar.

    Its model stands in the same folder and has a motor on the rocker, `load`.
    """
    mjcf = Path(shipped("fourbar.xml")).read_text()
    mjcf = mjcf.replace("</actuator>", '<motor name="load" joint="rocker" gear="1"/></actuator>')
    mjcf = mjcf.replace(
        "</sensor>",
        '<actuatorfrc name="load" actuator="load"/><force name="at_rocker" site="foot"/></sensor>',
    ).replace('<site name="rocker_end"', '<site name="foot"/><site name="rocker_end"')
    (tmp_path / "case.xml").write_text(mjcf)

    def written(
        reference="fourbar", load=GROWING_LOAD, motion="to = 6.283185307179586", channels=""
    ):
        file = tmp_path / "case.toml"
        numbers = FOUR_BAR_PARAMETERS if reference == "fourbar" else ""
        file.write_text(
            FOUR_BAR.format(
                reference=reference, parameters=numbers, load=load, motion=motion, channels=channels
            )
        )
        return file

    return written


@pytest.mark.parametrize("motion", ["to = 6.283185307179586", "to = 3.0\nperiod = 4.0"])
def test_a_four_bar_under_a_growing_load_agrees(four_bar, motion):
    """Both engines agree with the closed form and with the general solver under a growing load.

    The closed form finds the holding moment by virtual work, the general solver by Lagrange
    multipliers.  The part of the holding moment that the load causes must be the control times the
    part that a load of 1 N m causes.
    """
    closed = all_comparisons(four_bar(motion=motion))
    assert {c.outcome.value for c in closed} == {"agrees"}
    channels = 'load = { equals = "load", unit = "N m" }\n' + "\n".join(
        f'"at_rocker.{part}" = {{ equals = "at_rocker.{part}", unit = "N" }}' for part in "xy"
    )
    general = all_comparisons(four_bar("planar", GROWING_LOAD.split("scales")[0], motion, channels))
    assert {c.outcome.value for c in general} == {"agrees"}
    assert {c.channel for c in general} == {"holding_moment", "load", "at_rocker.x", "at_rocker.y"}
    case = load_case(four_bar(motion=motion))
    x = run_samples(case, "sweep")
    state = prescribed_run(case, "sweep").motion(x)
    control = np.interp(state[0][0], [0.0, case.drive[0].to], [-2.0, 6.0])
    asked = evaluate(case, "sweep", x, state).channels["holding_moment"]
    empty = evaluate(case, "sweep", x, state, rocker_load=0.0).channels["holding_moment"]
    unit = evaluate(
        case.model_copy(update={"load": ()}), "sweep", x, state, rocker_load=1.0
    ).channels["holding_moment"]
    plain = evaluate(
        case.model_copy(update={"load": ()}), "sweep", x, state, rocker_load=0.0
    ).channels["holding_moment"]
    np.testing.assert_allclose(asked - empty, control * (unit - plain), rtol=0, atol=1e-12)


def test_a_wrong_gear_of_a_changing_load_differs(four_bar):
    """Mutation: the motor's moment is 0.1 % larger than the sidecar's parameter says."""
    file = four_bar()
    mjcf = file.with_suffix(".xml")
    mjcf.write_text(
        mjcf.read_text().replace('joint="rocker" gear="1"', 'joint="rocker" gear="1.001"')
    )
    assert {c.outcome.value for c in all_comparisons(file)} == {"differs"}


def test_engines_that_ignore_a_changing_load_are_wrong(four_bar, monkeypatch):
    """Mutation: engines leave the control of the load at its value in the key."""
    monkeypatch.setattr(pymunk_loads, "with_controls", lambda links, loads, controls: links)
    set_up = Linkage.__init__

    def set_up_with_wrong_control(self, model, data, joints, loads=()):
        set_up(self, model, data, joints, loads)
        self.data = data
        self.controls = np.array([model.actuator_ctrladr[0]])[: len(loads)]  # that of the drive

    monkeypatch.setattr(Linkage, "__init__", set_up_with_wrong_control)
    case = load_case(four_bar())
    x = run_samples(case, "sweep")
    run = prescribed_run(case, "sweep")
    wanted = evaluate(case, "sweep", x, run.motion(x)).channels["holding_moment"]
    for engine in ("mujoco", "pymunk"):
        found = call_engine(engine, case.model_path, run).channels["holding_moment"]
        assert np.abs(found - wanted).max() > 1.0


def test_a_load_follows_a_column_of_a_csv_file(four_bar, tmp_path):
    """The control of a load is the column of a CSV file, over the time of an oscillating drive.

    The sidecar with this table is also written and read again without a change.
    """
    t = np.linspace(0.0, 4.0, 41)
    rows = "\n".join(
        f"{a!r},{1e-3 * b!r}" for a, b in zip(t.tolist(), (3 * np.sin(t)).tolist(), strict=True)
    )
    (tmp_path / "moments.csv").write_text(f"t [s],M [kN m]\n{rows}\n")
    load = 'profile = { file = "moments.csv", value = "M" }\nscales = ["rocker_load"]'
    file = four_bar(load=load, motion="to = 3.0\nperiod = 4.0")
    assert {c.outcome.value for c in all_comparisons(file)} == {"agrees"}
    case = load_case(file)
    control = prescribed_run(case, "sweep").controls(run_samples(case, "sweep"))[0][0]
    np.testing.assert_allclose(control, 3 * np.sin(run_samples(case, "sweep")), rtol=0, atol=1e-5)
    (tmp_path / "again.toml").write_text(format_sidecar(case))
    assert load_case(tmp_path / "again.toml").load == case.load


@pytest.mark.parametrize("rate", [2.0, -2.0])
@pytest.mark.parametrize("over", ["t [s]", "t [ms]", "crank [deg]", "late [s]", "lists"])
@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_a_load_follows_rows_beside_a_drive_of_constant_rate(four_bar, tmp_path, kind, over, rate):
    """The rows of a load are over time or over the drive's value; the run is a sweep or in time.

    The control is 3 sin(t) at the time t = (crank - from) / rate, and its rate 3 cos(t).
    """
    t = np.linspace(0.0, np.pi, 101)
    x = {"t [ms]": 1e3 * t, "crank [deg]": np.degrees(rate * t), "late [s]": t + 3.25}.get(over, t)
    rows = "\n".join(map("{0!r},{1!r}".format, x.tolist(), (3 * np.sin(t)).tolist()))
    (tmp_path / "moments.csv").write_text(f"{over},M [N m]\n{rows}\n")
    profile = '{ file = "moments.csv", value = "M" }'
    if over == "lists":
        profile = f"{{ time = {t.tolist()}, value = {(3 * np.sin(t)).tolist()} }}"
    file = four_bar(
        load=f'profile = {profile}\nscales = "rocker_load"',
        motion=f"to = {rate * np.pi!r}\nrate = {rate!r}",
    )
    file.write_text(file.read_text().replace("run.sweep", f"run.{kind}"))
    case = load_case(file)
    run = prescribed_run(case, kind)
    times = (run.motion(run.x)[0][0] - 0.0) / rate
    control, control_rate = (part[0] for part in run.controls(run.x))
    # a cubic spline with 31 ms between rows: h^4 / 384 of the fourth derivative, and h^3 / 24
    np.testing.assert_allclose(control, 3 * np.sin(times), rtol=0, atol=1e-7)
    np.testing.assert_allclose(control_rate, 3 * np.cos(times), rtol=0, atol=1e-4)


def test_a_load_over_the_angle_of_the_crank_agrees(four_bar, tmp_path):
    """Both engines agree with virtual work, M = M0 - load * d rocker / d crank, at constant rate.

    M0 is the holding moment without the load; the slope of the rocker is that of the closed loop's
    sensors, by central differences of a formula that is written anew here.
    """
    turn = np.linspace(0.0, 2 * np.pi, 181)
    rows = "\n".join(map("{0!r},{1!r}".format, turn.tolist(), (2 * np.cos(turn)).tolist()))
    (tmp_path / "moments.csv").write_text(f"crank [rad],M [N m]\n{rows}\n")
    load = 'profile = { file = "moments.csv", value = "M" }\nscales = "rocker_load"'
    file = four_bar(load=load)
    assert {c.outcome.value for c in all_comparisons(file)} == {"agrees"}
    case = load_case(file)
    run = prescribed_run(case, "sweep")
    found = call_engine("mujoco", case.model_path, run).channels["holding_moment"]
    plain = call_engine("mujoco", case.model_path, replace(run, loads=()))
    h = 1e-5
    slope = (rocker_angle(run.x + h) - rocker_angle(run.x - h)) / (2 * h)
    wanted = plain.channels["holding_moment"] - 2 * np.cos(run.x) * slope
    # central differences: h^2 of the third derivative and rounding / h; the spline is off by 1e-9
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-7)


def rocker_angle(crank):
    """Angle of the rocker of 2.5 m at the angle of the crank of 1 m, by the law of cosines."""
    x, y = np.cos(crank) - 3.0, np.sin(crank)
    square = x**2 + y**2
    inside = np.arccos((2.5**2 + square - 2.0**2) / (5.0 * np.sqrt(square)))
    return np.arctan2(y, x) % (2 * np.pi) - inside


def test_a_platform_under_a_growing_load_converges_with_order_2(edit):
    """The load on a platform with three rods on sliders grows from 0.5 to 1.5 times its value.

    MuJoCo's errors must fall with the square of the number of links.
    """
    file = edit(
        "pfr3.toml",
        r"\[run.sweep\]",
        '[load]\nactuator = "load"\nfrom = 0.5\nto = 1.5\nscales = ["force_x", "force_y"]\n\n'
        "[run.sweep]",
    )
    case = load_case(file)
    run = prescribed_run(case, "sweep")
    wanted = evaluate(case, "sweep", run.x, run.motion(run.x)).channels
    errors = {}
    for links in (10, 20):
        rods = tuple(replace(rod, segments=links) for rod in run.rods)
        found = call_engine("mujoco", case.model_path, replace(run, rods=rods)).channels
        errors[links] = {name: np.abs(found[name] - wanted[name]).max() for name in wanted}
    for name, coarse in errors[10].items():
        order = np.log2(coarse / errors[20][name])
        # terms of the next order, with ten links a rod, change the order by up to 0.15
        assert order == pytest.approx(2.0, abs=0.15), name
    plain = evaluate(case.model_copy(update={"load": ()}), "sweep", run.x, run.motion(run.x))
    assert np.abs(plain.channels["force1"] - wanted["force1"]).max() > 10 * errors[20]["force1"]


def test_rods_under_a_changing_load_meet_at_the_pin():
    """Both rods of a pair end at the pin without moment, under the load of each sample.

    They are integrated from their clamps by the Runge-Kutta method, without any closed form.
    """
    run = prescribed_run(PAIR, "sweep")
    theta = run.motion(run.x)[0]
    force = np.outer([0.3, -0.1], run.controls(run.x)[0][0])
    curves = rod_pair_driven.solve(
        theta, **{**PAIR.parameters, "force_x": force[0], "force_y": force[1]}
    )
    push = np.array([curves["push_x"], curves["push_y"]])
    for k, (n, x0) in enumerate(((push, -0.3), (force - push, 0.3))):
        rod = integrate(
            *n,
            -curves[f"hold{k + 1}"],
            theta0=theta[k],
            x0=x0,
            stiffness=PAIR.parameters["stiffness"],
            nodes=161,
        )
        for end, wanted in ((rod.x, curves["pin_x"]), (rod.y, curves["pin_y"]), (rod.m, 0.0)):
            # 1e-9 is the tolerance of the reference itself
            np.testing.assert_allclose(end[-1], wanted, rtol=0, atol=1e-9)
    assert force[0, -1] == pytest.approx(0.9)


BAD = {
    "no actuator": (
        'actuator = "load"',
        'actuator = "laod"',
        ["load.actuator", "did you mean 'load'?"],
    ),
    "drive": (
        'actuator = "load"',
        'actuator = "motor"',
        ["load.actuator", "'crank', which is driven"],
    ),
    "no parameter": (
        'rocker_load"',
        'rocker_laod"',
        ["load.scales", "did you mean 'rocker_load'?"],
    ),
    "a length": ('"rocker_load"', '"rocker"', ["load.scales", "those that may: rocker_load"]),
    "no scales": ("scales = .*", "", ["load.scales", "missing", "rocker_load"]),
    "equilibrium": (
        r"\[run.sweep\]",
        "[run.equilibrium]\nn = 11\n[run.sweep]",
        ["run.equilibrium", "nothing changes in an equilibrium"],
    ),
    "both": (
        "to = 6.0",
        'to = 6.0\nprofile = { file = "a.csv", value = "M" }',
        ["load", "either from"],
    ),
    "neither": ("from = -2.0\nto = 6.0", "", ["load", "either from and to, or profile"]),
    "a rate": (
        "from = -2.0\nto = 6.0",
        'profile = { file = "a.csv", rate = "M" }',
        ["load", "no rate"],
    ),
    "no file": (
        "from = -2.0\nto = 6.0",
        'profile = { file = "a.csv", value = "M" }',
        ["a.csv", "no such recorded curve"],
    ),
    "twice": (
        r"\[load\]",
        '[[load]]\nactuator = "load"\nto = 1.0\nscales = "rocker_load"\n[[load]]',
        ["twice"],
    ),
    "unknown key": ("to = 6.0", "too = 6.0", ["load", "too"]),
}


@pytest.mark.parametrize(("old", "new", "words"), BAD.values(), ids=BAD)
def test_bad_loads_are_refused_with_their_key(four_bar, old, new, words):
    file = four_bar()
    text, hits = re.subn(old, new, file.read_text(), count=1)
    assert hits
    file.write_text(text)
    result = check([file])
    assert result.exit_code == 2
    for word in words:
        assert word in str(result.errors[0])


@pytest.mark.parametrize(
    ("motor", "words"),
    [
        ('<motor name="load" joint="rocker" ctrlrange="-1 1"', ["load", "within -1 to 1"]),
        (
            '<motor name="load" joint="rocker" forcerange="-9 9"',
            ["load.actuator", "range of forces"],
        ),
        ('<position name="load" joint="rocker"', ["load.actuator", "is no motor"]),
        ('<motor name="load" joint="rocker" group="3"', ["load.actuator", "disabled"]),
    ],
)
def test_motors_whose_control_may_not_change_are_refused(four_bar, motor, words):
    file = four_bar()
    mjcf = file.with_suffix(".xml")
    text = mjcf.read_text().replace('<motor name="load" joint="rocker"', motor)
    if "group" in motor:
        text = text.replace("<option ", '<option actuatorgroupdisable="3" ')
    mjcf.write_text(text)
    result = check([file])
    assert result.exit_code == 2
    for word in words:
        assert word in str(result.errors[0])


def test_engines_refuse_friction_and_settling_with_changing_loads(edit, models):
    """Engines refuse a changing load together with dry friction or with ``settled = true``."""
    edit(
        "rfr2_load_path.toml", r"\[run.sweep\]", "[settings.mujoco]\nsettled = true\n\n[run.sweep]"
    )
    found = refusal_of(models / "rfr2_load_path.toml", "mujoco")
    assert "settled" in found
    text = (models / "rfr2_natural.xml").read_text()
    (models / "rfr2_natural.xml").write_text(
        text.replace('<joint name="motor1"/>', '<joint name="motor1" frictionloss="0.1"/>')
    )
    edit("rfr2_load_path.toml", r"settled = true", "")
    for engine in ("mujoco", "pymunk"):
        assert "frictionloss of joint 'motor1'" in refusal_of(
            models / "rfr2_load_path.toml", engine
        )


def refusal_of(file: Path, engine: str) -> str:
    """The message of the `Unsupported` with which an engine refuses a case."""
    case = load_case(file)
    with pytest.raises(Unsupported) as refused:
        call_engine(engine, case.model_path, plan_run(case, "sweep", engine))
    return str(refused.value)
