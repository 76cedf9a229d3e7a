"""No verdict is green on a model that does not move, or that does not run its own time step.

The models are written here: shapes at rest, sweeps in which nothing but the drive moves, samples at
the two ends of a swing, and time steps that samples do not fit.  Each is checked by itself, with a
sidecar, or with a sidecar that ``proofmass new`` proposes.
"""

import json
from contextlib import suppress
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.batch.check import Result, check
from proofmass.commands.cli import app
from proofmass.commands.new_from_model import write_proposal
from proofmass.verdict.outcome import Outcome
from tests.shipped import shipped

CAPSULE = 'type="capsule" fromto="0 0 0 {} 0 {}" size=".02" contype="0" conaffinity="0"'
ACROSS, DOWN, UP = CAPSULE.format(0.3, 0), CAPSULE.format(0, -0.3), CAPSULE.format(0, 0.3)
HINGE, SLIDE = '<joint name="a" axis="0 1 0" {}/>', '<joint name="a" type="slide" axis="1 0 0" {}/>'
NO_GRAVITY = 'gravity="0 0 0"'


def model_of(joint: str, geom: str, option: str = "", inner: str = "", more: str = "") -> str:
    """A model of a body on a joint; `inner` is in the body, `more` beside the world."""
    return (
        f'<mujoco><option timestep=".002" {option}/><worldbody><body name="arm">{joint}'
        f'<geom {geom} mass="1"/>{inner}</body></worldbody>{more}'
        '<sensor><jointpos name="a" joint="a"/><jointvel name="a_rate" joint="a"/></sensor>'
        "</mujoco>"
    )


def actuator(text: str, ctrl: float = 0.0) -> str:
    """An actuator on the joint, and a key with its control."""
    key = f'<key name="start" qpos="0" ctrl="{ctrl}"/>'
    return f"<actuator>{text}</actuator><keyframe>{key}</keyframe>"


LINK = (
    f'<body name="fore" pos=".3 0 0"><joint name="b" axis="0 1 0"/><geom {ACROSS} mass="1"/></body>'
)
AT_REST = {
    "a pendulum that hangs": model_of(HINGE.format(""), DOWN),
    "a damped pendulum that hangs": model_of(HINGE.format('damping=".1"'), DOWN),
    "a pendulum that stands": model_of(HINGE.format(""), UP),
    "a hinge without gravity": model_of(HINGE.format(""), ACROSS, NO_GRAVITY),
    "a hinge along gravity": model_of('<joint name="a" axis="0 0 1"/>', ACROSS),
    "a balanced beam": model_of(
        HINGE.format(""), CAPSULE.replace("0 0 0", "-.3 0 0").format(0.3, 0)
    ),
    "a spring at its rest": model_of(HINGE.format('stiffness="9"'), ACROSS, NO_GRAVITY),
    "a slide across gravity": model_of(SLIDE.format(""), ACROSS),
    "a slide with a spring at rest": model_of(SLIDE.format('stiffness="50"'), ACROSS),
    "a slide without gravity": model_of(SLIDE.format(""), DOWN, NO_GRAVITY),
    "two links without gravity": model_of(HINGE.format(""), ACROSS, NO_GRAVITY, LINK),
    "two links that hang": model_of(
        HINGE.format(""),
        DOWN,
        inner=f'<body pos="0 0 -.3"><joint name="b" axis="0 1 0"/><geom {DOWN} mass="1"/></body>',
    ),
    "a motor without a control": model_of(
        HINGE.format(""), ACROSS, NO_GRAVITY, more=actuator('<motor joint="a"/>')
    ),
    "a servo at its target": model_of(
        HINGE.format(""), ACROSS, NO_GRAVITY, more=actuator('<position joint="a" kp="9"/>')
    ),
    "a servo of a slide at its target": model_of(
        SLIDE.format(""), ACROSS, more=actuator('<position joint="a" kp="9" kv="1"/>')
    ),
    "a velocity servo at rest": model_of(
        HINGE.format(""), ACROSS, NO_GRAVITY, more=actuator('<velocity joint="a" kv="1"/>')
    ),
}
WAYS = "alone", "planar", "refined"
SIDECAR = """title = "t"
source = "s"
reference = "{reference}"
[run.dynamics]
until = 0.2
n = 101
solvers = ["mujoco"]
[channels]
a = {{ equals = "{equals}", unit = "rad" }}
[[tolerance]]
abs = 1e-3
why = "w"
"""


def checked(*paths: Path) -> Result:
    """The result of a check without a search for causes."""
    return check(paths, jobs=1, causes=False, detectable=False)


def is_green(result: Result) -> bool:
    """Whether a channel agrees, a model is self-consistent, or the exit code says that all do."""
    good = {Outcome.AGREES, Outcome.SELF_CONSISTENT}
    return result.exit_code == 0 or bool(good & {c.outcome for c in result.comparisons})


@pytest.mark.parametrize(("shape", "way"), [*product(AT_REST, WAYS)])
def test_a_model_at_rest_is_never_green(shape, way, tmp_path):
    """Bare MuJoCo shows that the model stays where it is."""
    text = AT_REST[shape]
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    assert np.abs(data.qpos - model.qpos0).max() < 1e-12
    file = tmp_path / "rest.xml"
    file.write_text(text)
    if way == "alone":
        found = checked(file)
    else:
        unit = "m" if 'type="slide"' in text else "rad"
        sidecar = SIDECAR.format(reference=way, equals="a").replace('"rad"', f'"{unit}"')
        if "<key " not in text:
            sidecar = sidecar.replace("[run", 'start = ""\n[run', 1)
        file.with_suffix(".toml").write_text(sidecar)
        found = checked(file.with_suffix(".toml"))
    assert not is_green(found), [str(error) for error in found.errors]
    assert {c.outcome for c in found.comparisons} == {Outcome.NOTHING_MOVED}
    assert found.exit_code == 1
    assert all("nothing moves" in c.message for c in found.comparisons)


@pytest.mark.parametrize("shape", AT_REST)
def test_no_sidecar_is_proposed_that_is_green_on_a_model_at_rest(shape, tmp_path):
    """Either the model is refused, or what is proposed is not green."""
    file = tmp_path / "rest.xml"
    file.write_text(AT_REST[shape])
    with suppress(InputError):
        files, _ = write_proposal("proposed", file)
        assert not is_green(checked(files[0]))


ROTOR = """<mujoco><option timestep=".001" gravity="0 0 0"/><worldbody>
<body name="rotor"><joint name="rotor" {kind} axis="0 0 1" damping=".001"/>
<inertial pos="0 0 0" mass=".3" diaginertia=".002 .002 .002"/>
<body name="load"><joint name="flex" {kind} axis="0 0 1" stiffness="{stiffness}" damping=".01"/>
<inertial pos="0 0 0" mass="1" diaginertia=".02 .02 .02"/></body></body></worldbody>
<actuator><motor name="tau" joint="rotor"/></actuator>
<sensor><jointpos name="rotor" joint="rotor"/><jointpos name="flex" joint="flex"/></sensor>
<keyframe><key name="start" qpos="0 0" ctrl="{ctrl}"/></keyframe></mujoco>"""
SWEEP = """title = "t"
source = "s"
reference = "planar"
[drive]
joint = "rotor"
from = 0.0
to = 1.5
rate = 1.0
[run.sweep]
n = 31
solvers = ["mujoco"]
[[tolerance]]
abs = 1e-12
why = "w"
"""


@pytest.mark.parametrize("stiffness", [8, 80, 800, 8000])
def test_a_sweep_in_which_nothing_but_the_drive_moves_is_not_green(stiffness, tmp_path):
    """The spring stays at rest, so that any stiffness agrees."""
    (tmp_path / "motor.xml").write_text(ROTOR.format(kind="", stiffness=stiffness, ctrl=1))
    (tmp_path / "motor.toml").write_text(SWEEP)
    found = checked(tmp_path / "motor.toml")
    assert [c.outcome for c in found.comparisons] == [Outcome.NOTHING_MOVED] * 2
    assert found.exit_code == 1
    assert "nothing but the drive moves" in found.comparisons[0].message


def test_a_motor_with_a_spring_is_let_go_under_the_control_of_its_key(tmp_path):
    """The proposed motion shows the resonance at sqrt(k (1/I1 + 1/I2)) = 209.8 rad/s: a motion in
    which the stiffness matters."""
    model = tmp_path / "motor.xml"
    model.write_text(ROTOR.format(kind="", stiffness=80, ctrl=1))
    (sidecar,), _ = write_proposal("mine", model)
    found = checked(sidecar)
    (case,) = found.cases
    assert not case.drive
    assert {c.outcome for c in found.comparisons} == {Outcome.AGREES}
    twist = found.curves[case.name, "dynamics", "mujoco"].channels["flex"]
    rigid = 1.0 * 0.02 / (0.002 + 0.02) / 80  # rad, that accelerates the load with the motor
    assert np.abs(twist).max() > rigid


@pytest.mark.parametrize("name", ["fourbar", "slider_crank", "stephenson", "watt"])
@pytest.mark.parametrize("run", ["sweep", "dynamics"])
def test_two_samples_at_the_ends_of_a_swing_are_not_green(name, run, tmp_path):
    """The drive swings to and fro, and both samples have the start pose."""
    source = shipped(f"{name}.toml")
    (tmp_path / f"{name}.xml").write_text(source.with_suffix(".xml").read_text())
    text = source.read_text().split("[channels]")[0]
    lines = [line for line in text.splitlines() if not line.startswith(("rate", "accuracy"))]
    text = "\n".join(lines).replace("to = 6.283185307179586", "to = 1.0\nperiod = 2.0")
    assert "period" in text
    text = text.partition("[run")[0]
    (tmp_path / f"{name}.toml").write_text(f'{text}\n[run.{run}]\nn = 2\nsolvers = ["mujoco"]\n')
    found = checked(tmp_path / f"{name}.toml")
    assert found.comparisons, [str(error) for error in found.errors]
    assert found.exit_code == 1
    if run == "sweep":
        assert {c.outcome for c in found.comparisons} == {Outcome.NOTHING_MOVED}
        assert max(c.relative_to_range for c in found.comparisons) < 1e-9


SERVOS = """<mujoco><option timestep="{step}"/><worldbody>
<body name="a"><joint name="a" axis="0 1 0"/><geom {across} mass="2"/>
<body name="b" pos=".3 0 0"><joint name="b" axis="0 1 0"/><geom {across} mass=".5"/></body></body>
</worldbody><actuator>
<position joint="a" kp="100"/><velocity joint="a" kv="2"/>
<position joint="b" kp="100"/><velocity joint="b" kv="2"/></actuator>
<sensor><jointpos name="a" joint="a"/><jointpos name="b" joint="b"/></sensor>
<keyframe><key name="start" qpos=".5 -.3" ctrl="0 0 0 0"/></keyframe></mujoco>"""
TOO_LARGE_STEPS = 0.02, 0.025, 0.04, 0.05


def servos(folder: Path, step: float) -> Path:
    """Write the model of two links with servos, which is unstable with steps from 20 ms on."""
    model = folder / "servos.xml"
    model.write_text(SERVOS.format(step=step, across=ACROSS))
    return model


@pytest.mark.parametrize("samples", [361, 100, 70])
@pytest.mark.parametrize("step", TOO_LARGE_STEPS)
def test_a_run_with_another_step_than_the_models_is_not_green(step, samples, tmp_path):
    """The samples would make the run's step shorter, with which it may be stable."""
    model = servos(tmp_path, step)
    (tmp_path / "servos.toml").write_text(
        f'title = "t"\nsource = "s"\nreference = "planar"\n[run.dynamics]\nuntil = 1.0\n'
        f'n = {samples}\nsolvers = ["mujoco"]\n[[tolerance]]\nabs = 0.1\nwhy = "w"\n'
    )
    assert "bad" in bare_warning(model)
    found = checked(tmp_path / "servos.toml")
    assert found.comparisons, [str(error) for error in found.errors]
    assert not is_green(found)
    spacing = 1.0 / (samples - 1)
    for c in found.comparisons:
        if c.outcome == Outcome.OTHER_STEP:
            made = spacing / np.ceil(spacing / step - 1e-9)
            assert f"steps of {1e3 * made:.4g} ms instead of the {1e3 * step:.4g} ms" in c.message
            fitting = int(np.ceil(1.0 / step - 1e-9)) + 1
            assert f"run.dynamics.n = {fitting}," in c.message


@pytest.mark.parametrize(
    ("step", "until", "samples", "advice"),
    [
        (0.0042, 1.0, 51, "give run.dynamics.n = 61, or timestep = 0.004"),
        (0.0026, 1.0, 201, "give run.dynamics.n = 386, or timestep = 0.0025"),
        (0.003, 0.01, 3, "give timestep = 0.0025"),  # no whole number of steps leads to 10 ms
    ],
)
def test_a_free_motion_runs_the_whole_step(step, until, samples, advice, tmp_path):
    """Its samples can be anywhere, so that 19 of 20 parts of the step are another step."""
    servos(tmp_path, step)
    (tmp_path / "servos.toml").write_text(
        f'title = "t"\nsource = "s"\nreference = "planar"\n[run.dynamics]\nuntil = {until}\n'
        f'n = {samples}\nsolvers = ["mujoco"]\n[[tolerance]]\nrelative_to_range = 0.45\nwhy = "w"\n'
    )
    found = checked(tmp_path / "servos.toml")
    assert {c.outcome for c in found.comparisons} == {Outcome.OTHER_STEP}
    assert advice in found.comparisons[0].message


@pytest.mark.parametrize("step", TOO_LARGE_STEPS)
def test_a_proposed_case_runs_the_step_of_the_model(step, tmp_path):
    model = servos(tmp_path, step)
    assert "bad" in bare_warning(model)
    (sidecar,), _ = write_proposal("mine", model)
    found = checked(sidecar)
    assert found.exit_code == 1
    outcomes = {c.outcome for c in found.comparisons if c.solver == "mujoco"}
    assert outcomes == {Outcome.DIVERGED}
    agreeing = {c.solver for c in found.comparisons if c.outcome == Outcome.AGREES}
    assert agreeing == {"mujoco:finer", "pymunk:finer"}
    (case,) = found.cases
    assert 1.0 / (case.run["dynamics"].n - 1) == pytest.approx(step, rel=1e-12)


def bare_warning(model: Path) -> str:
    """The warning of bare MuJoCo that its own steps diverge."""
    loaded = mujoco.MjModel.from_xml_path(str(model))
    data = mujoco.MjData(loaded)
    mujoco.mj_resetDataKeyframe(loaded, data, 0)
    for _ in range(round(1.0 / loaded.opt.timestep)):
        mujoco.mj_step(loaded, data)
    for warning in (mujoco.mjtWarning.mjWARN_BADQACC, mujoco.mjtWarning.mjWARN_BADQPOS):
        if data.warning[warning].number:
            return f"bad: {warning.name}"
    return ""


@pytest.mark.parametrize(("step", "until", "samples"), [(0.002, 1.0, 501), (0.003, 1.0, 335)])
def test_a_default_number_of_samples_fits_the_step(step, until, samples, tmp_path):
    servos(tmp_path, step)
    (tmp_path / "servos.toml").write_text(
        f'title = "t"\nsource = "s"\nreference = "planar"\n[run.dynamics]\nuntil = {until}\n'
        'solvers = ["mujoco"]\n[[tolerance]]\nrelative_to_range = 0.4\nwhy = "w"\n'
    )
    found = checked(tmp_path / "servos.toml")
    assert found.cases[0].run["dynamics"].n == samples
    assert {c.outcome for c in found.comparisons} == {Outcome.AGREES}
    (curves,) = found.curves.values()
    assert curves.asked_step == step
    assert 0.99 * step < curves.made_step <= step * (1 + 1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("abs = 0.1", "abs = 1e30", ["tolerance.0", "a curve that does not move would pass"]),
        ("abs = 0.1", "abs = 0.9", ["tolerance.0", "a curve that does not move would pass"]),
        ("abs = 0.1", "relative_to_range = 1000", ["tolerance.0.relative_to_range", "at most 0.5"]),
        ("abs = 0.1", "abs = true", ["tolerance.0.abs", "must be a number, not true"]),
        ("until = 1.0", 'until = "1.0"', ["run.dynamics.until", "quotation marks"]),
        ("n = 501", "n = 501.0", ["run.dynamics.n", "must be a whole number, not 501.0"]),
        ("[run", "unchecked = 0\n[run", ["unchecked", "must be true or false, not 0"]),
    ],
)
def test_a_tolerance_that_passes_anything_and_a_wrong_type_are_bad_input(old, new, words, tmp_path):
    """With a tolerance of 0.1 rad the same case agrees."""
    servos(tmp_path, 0.002)
    text = (
        'title = "t"\nsource = "s"\nreference = "planar"\n[run.dynamics]\nuntil = 1.0\n'
        'n = 501\nsolvers = ["mujoco"]\n[[tolerance]]\nabs = 0.1\nwhy = "w"\n'
    )
    sidecar = tmp_path / "servos.toml"
    sidecar.write_text(text)
    assert {c.outcome for c in checked(sidecar).comparisons} == {Outcome.AGREES}
    sidecar.write_text(text.replace(old, new, 1))
    found = checked(sidecar)
    assert found.exit_code == 2
    assert not found.comparisons
    (error,) = found.errors
    assert all(word in str(error) for word in words), error


def test_every_output_says_that_nothing_moved(tmp_path):
    """Terminal, JSON, JUnit, SARIF, pytest and the pages of a report: none of them is green."""
    (tmp_path / "motor.xml").write_text(ROTOR.format(kind="", stiffness=80, ctrl=1))
    (tmp_path / "motor.toml").write_text(SWEEP)
    (tmp_path / "still.xml").write_text(AT_REST["a slide without gravity"])
    run = CliRunner().invoke
    files = [str(tmp_path / "motor.toml"), str(tmp_path / "still.xml")]
    machine = ["--junit", str(tmp_path / "junit.xml"), "--sarif", str(tmp_path / "found.sarif")]
    shown = run(app, ["check", *files, *machine], env={"COLUMNS": "400"})
    assert shown.exit_code == 1
    assert "✗ motor sweep mujoco nothing moved: nothing but the drive moves" in shown.output
    assert "✗ still dynamics mujoco nothing moved: nothing moves until 1 s" in shown.output
    assert "3 nothing moved" in shown.output
    assert "✓" not in shown.output
    stored = json.loads(run(app, ["check", *files, "--json"]).stdout)
    assert stored["exit_code"] == 1
    assert {c["outcome"] for c in stored["comparisons"]} == {"nothing moved"}
    failures = ElementTree.parse(tmp_path / "junit.xml").findall(".//failure")
    assert [one.get("type") for one in failures] == ["nothing moved"] * 3
    (sarif,) = json.loads((tmp_path / "found.sarif").read_text())["runs"]
    assert {one["ruleId"] for one in sarif["results"]} == {"nothing-moved"}
    report = run(app, ["report", files[0], "-o", str(tmp_path / "report")])
    assert report.exit_code == 1
    page = (tmp_path / "report" / "motor.html").read_text()
    assert "✗ Nothing moved: 2 of 2 checked curves" in page
    assert "✓ Agrees" not in page
    assert "<p>Nothing but the drive moves: no checked channel leaves its start" in page
    index = (tmp_path / "report" / "index.html").read_text()
    assert "nothing moved" in index


def test_an_item_of_pytest_fails_where_nothing_moved(pytester):
    (pytester.path / "motor.xml").write_text(ROTOR.format(kind="", stiffness=80, ctrl=1))
    (pytester.path / "motor.toml").write_text(SWEEP)
    result = pytester.runpytest_inprocess(pytester.path / "motor.toml", "-p", "no:cacheprovider")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*nothing moved; nothing but the drive moves*"])


BEYOND_ITS_STOP = f"""<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
<body><joint name="a" axis="0 1 0" range="-30 30" damping=".05"/><geom {ACROSS} mass="1"/>
<body pos=".3 0 0"><joint name="b" axis="0 1 0"/><geom {ACROSS} mass=".5"/></body></body>
</worldbody><actuator><position joint="a" kp="400"/></actuator>
<keyframe><key name="start" qpos="0 .2" ctrl="2"/></keyframe></mujoco>"""


def test_a_channel_that_is_far_off_differs_in_a_proposed_case(tmp_path):
    """A servo presses a joint beyond its soft stop, where the reference has a rigid one."""
    model = tmp_path / "stop.xml"
    model.write_text(BEYOND_ITS_STOP)
    (sidecar, _), messages = write_proposal("mine", model)
    found = checked(sidecar)
    outcomes = {c.channel: c.outcome for c in found.comparisons if c.solver == "mujoco"}
    assert outcomes["a"] == Outcome.DIFFERS
    assert set(outcomes.values()) <= {Outcome.DIFFERS, Outcome.AGREES}
    assert found.exit_code == 1
    assert any("so that they differ: a by" in message for message in messages)
