"""Bad input gives one or two lines that name file, key and what is right, and exit code 2."""

import re
from pathlib import Path

import mujoco
import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.batch.check import check, load_validated
from proofmass.commands.cli import app
from proofmass.commands.command import find_sidecar
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run, solve, solve_here
from proofmass.sim.mujoco.model import translate_fatal_errors
from proofmass.sim.protocol.failures import BadModel

SIDECAR_FAULTS = {
    "not TOML": ("fourbar.toml", r"^title", "title title", ["fourbar.toml", "not TOML"]),
    "unknown key": (
        "fourbar.toml",
        r"\[drive\]",
        "[drive]\nspeed = 2",
        ["drive", "'speed'", "joint, from, to, rate"],
    ),
    "unknown table": ("fourbar.toml", r"\[drive\]", "[drvie]\n[drive]", ["'drvie'", "channels"]),
    "no reason": (
        "fourbar.toml",
        r'why = "loops',
        'because = "loops',
        ["tolerance.0", "'because'", "why"],
    ),
    "empty reason": ("pendulum.toml", r'why = ".*"', 'why = " "', ["tolerance.0", "reason"]),
    "reason left out": ("pendulum.toml", r"why = .*", "", ["tolerance.0.why", "missing"]),
    "no such reference": (
        "fourbar.toml",
        r'reference = "fourbar"',
        'reference = "fourbra"',
        ["reference", "'fourbra'", "there are: ", "fourbar, ", "planar, "],
    ),
    "no such curve": (
        "hacksaw_recorded.toml",
        r'"hacksaw_recorded.csv"',
        '"inventor.csv"',
        ["hacksaw_recorded.toml: reference", "'inventor.csv'", "no such recorded curve"],
    ),
    "no such curve, and n": (
        "hacksaw_recorded.toml",
        r'(?s)"hacksaw_recorded.csv"(.*?)sweep\]',
        r'"inventor.csv"\1sweep]\nn = 5',
        ["reference", "no such recorded curve"],
    ),
    "no such quantity": (
        "fourbar.toml",
        r'"rocker_angle"',
        '"rocker"',
        ["channels.rocker.equals", "'rocker'", "rocker_angle"],
    ),
    "no such parameter": (
        "fourbar.toml",
        r"coupler = 2.0",
        "copler = 2.0",
        ["parameters.copler", "coupler"],
    ),
    "former name of a run": (
        "fourbar.toml",
        r"reference =",
        "run.duration = {}\nreference =",
        ["run: unknown run 'duration'", "'duration' is called 'dynamics' now"],
    ),
    "former name of a key": (
        "hacksaw.toml",
        r"relative_to_range = ",
        "of_range = ",
        ["tolerance.0", "'of_range' is called 'relative_to_range' now"],
    ),
    "former name of a key of refine": (
        "rod_cantilever.toml",
        r"(?m)^within = ",
        "wall = 1e-9\nwithin = ",
        ["refine", "'wall' is called 'error_floor' now"],
    ),
    "negative length": (
        "fourbar.toml",
        r"coupler = 2.0",
        "coupler = -2.0",
        ["parameters", "coupler"],
    ),
    "lengths that cannot close": (
        "fourbar.toml",
        r"coupler = 2.0",
        "coupler = 0.1",
        # the crank, at 0, leaves 2 m between the circles; coupler and rocker reach from 2.4 m
        ["parameters", "loop cannot close at angle 0 rad", "coupler and rocker miss by 0.4 m"],
    ),
    "no such model": (
        "fourbar.toml",
        r"reference =",
        'model = "forbar.xml"\nreference =',
        ["model", "forbar.xml"],
    ),
    "no such solver": (
        "fourbar.toml",
        r'"mujoco:default"',
        '"havok"',
        ["'havok'", "mujoco, pymunk", "bullet"],
    ),
    "variant without settings": (
        "fourbar.toml",
        r'"mujoco:default"',
        '"mujoco:slow"',
        ['settings."mujoco:slow"'],
    ),
    "unknown setting": ("hacksaw.toml", r"timestep = 1e-4", "step = 1e-4", ["'step'", "timestep"]),
    "two tolerances": (
        "fourbar.toml",
        r'solver = "mujoco"\nrelative_to_range = 1e-12',
        'solver = "mujoco"\nrelative_to_range = 1e-12\nwhy = "a"\n'
        "[[tolerance]]\nrelative_to_range = 0.1",
        ["2 tolerances", "exactly one"],
    ),
    "wrong branch": ("fourbar.toml", r"mode = 1 ", "mode = -1 ", ["start", "mode +1", "-1"]),
    "NaN": ("fourbar.toml", r"crank = 1.0", "crank = nan", ["parameters.crank", "finite"]),
}
MODEL_FAULTS = {
    "not XML": ("fourbar.xml", r"</worldbody>", "</wordlbody>", ["fourbar.xml", "XML"]),
    "no such sensor": (
        "fourbar.xml",
        r'jointpos name="rocker"',
        'jointpos name="rokcer"',
        ["fourbar.xml", "'rocker'", "rokcer"],
    ),
    "no such joint": (
        "fourbar.toml",
        r'joint = "crank"',
        'joint = "cranck"',
        ["fourbar.xml", "'cranck'", "crank, coupler, rocker"],
    ),
    "no such key": (
        "fourbar_crossed.toml",
        r'start = "crossed"',
        'start = "corssed"',
        ["'corssed'", "start, crossed"],
    ),
    "not assembled": (
        "fourbar.xml",
        r'qpos="0  1.3502630',
        'qpos="0  2.3502630',
        ["fourbar.xml", "'start'", "'pin'", "open by"],
    ),
    "start pose in degrees": (
        "fourbar.xml",
        r'qpos="0  1.3502630',
        'qpos="0  77.3502630',
        ["fourbar.xml", "open by", "qpos of a key is in rad", "'coupler' is 77.3"],
    ),
    "not planar": (
        "fourbar.xml",
        r'<joint name="rocker"/>',
        '<joint name="rocker" axis="0 0.1 1"/>',
        ["fourbar.toml", "run.dynamics.solvers", "pymunk", "'rocker' leaves the plane"],
    ),
    "a freedom too many": (
        "fourbar.xml",
        r'<site name="rocker_end" pos="2.5 0 0"/>',
        '<site name="rocker_end" pos="2.5 0 0"/><body name="bob"><joint '
        'name="bob"/><inertial pos="0 1 0" mass="1" diaginertia="1 1 1"/>'
        "</body>",
        ["run.sweep.solvers", "mujoco", "1 degree(s) of freedom"],
    ),
    "NaN in the model": (
        "fourbar.xml",
        r'pos="0.5 0 0" mass="1"',
        'pos="nan 0 0" mass="1"',
        ["fourbar.xml", "pos='nan 0 0' is not a number"],
    ),
}
DRIVE_FAULTS = {
    "a follower with a rate": (
        "fivebar.toml",
        r'joint = "right".*',
        'joint = "right"\nrate = 2',
        ["drive", "rate belongs to the first drive"],
    ),
    "a follower without an end": (
        "fivebar.toml",
        r'(joint = "right".*\n.*\n)to = .*',
        r"\1",
        ["drive", "'right' needs from and to"],
    ),
    "driven twice": (
        "fivebar.toml",
        r'joint = "right"',
        'joint = "left"',
        ["drive", "'left' is driven twice"],
    ),
    "a place that is no number": (
        "fivebar.toml",
        r'(joint = "right".*)\nfrom = 0.0',
        r"\1\nfrom = nan",
        ["drive.1.from", "finite"],
    ),
    "columns for one of two": (
        "hacksaw_recorded.toml",
        r"\[drive\](\n.*\n.*)",
        '[[drive]]\\1\n[[drive]]\njoint = "theta1"',
        ["drive", "'theta1' needs profile = [value, rate, acceleration]"],
    ),
    "former name of a function": (
        "balancer_sine.toml",
        'marks = "events"',
        'marks = "marks"',
        ["view.0.marks", "'marks' is called 'events' now; there are: events"],
    ),
    "former name of a quantity": (
        "balancer_sine.toml",
        'equals = "deflection1"',
        'equals = "winding1"',
        ["channels.deflection1.equals", "'winding1' is called 'deflection1' now"],
    ),
    "former name of a parameter": (
        "rfr3.toml",
        r"\[parameters\]\n",
        "[parameters]\nprolongation = 0.1\n",
        ["parameters", "'prolongation' is called 'rigid_extension' now"],
    ),
    "no such law": (
        "fivebar_circle.toml",
        r'profile = "circle"',
        'profile = "cirlce"',
        [
            "drive.0.profile",
            "reference fivebar has no motion profile 'cirlce'; did you mean 'circle'?",
        ],
    ),
    "a swing with a rate": (
        "triple_rocker.toml",
        r"period = 8.0",
        "period = 8.0\nrate = 1.0",
        ["drive", "rate goes with from and to alone"],
    ),
    "a drive too few": (
        "inverted_slider_crank_held.toml",
        r'\[\[drive\]\]\njoint = "bar"[^\[]*',
        "",
        ["run.sweep.solvers", "mujoco", "1 degree(s) of freedom"],
    ),
    "one column": (
        "hacksaw_recorded.toml",
        r"profile = .*",
        'profile = ["omega2"]',
        ["drive.profile", "['omega2']", "name of a function", "three columns"],
    ),
    "no such parameter of a law": (
        "fivebar_circle.toml",
        "left_crank = 4.0 +# m",
        "lft_crank = 4",
        ["fivebar_circle.toml: drive.parameters", "lft_crank"],
    ),
    "a law's parameter left out": (
        "fivebar_circle.toml",
        r"radius = 1.5.*",
        "",
        ["drive.parameters", "'radius'"],
    ),
    "a law that cannot be": (
        "fivebar_circle.toml",
        "radius = 1.5",
        "radius = 99.0",
        ["drive.parameters", "tip out of reach", "left crank and coupler miss by"],
    ),
    "no such parameter of the motor": (
        "hacksaw.toml",
        r"^parameters = \{",
        "parameters = { sped = 1.0, ",
        ["drive.parameters.sped", "known: "],
    ),
    "zero length": (
        "slider_crank.toml",
        r"coupler = 2.0",
        "coupler = 0.0",
        ["parameters", "coupler must be a positive"],
    ),
    "a coupler too short": (
        "slider_crank.toml",
        r"coupler = 2.0",
        "coupler = 0.5",
        ["parameters", "angle"],
    ),
    "five bars that miss": (
        "fivebar.toml",
        r"left_coupler = 3.5",
        "left_coupler = 0.5",
        ["parameters", "miss by", "m"],
    ),
}
JOINT_LIMIT_FAULTS = {
    "a crank": (
        "fourbar",
        "crank",
        "-0.01 0.01",
        ["drive: joint 'crank'", "6.28319 rad", "fourbar.xml", "-0.01 to 0.01 rad"],
    ),
    "a swing": (
        "triple_rocker",
        "crank",
        "-1.5 2",
        ["drive: joint 'crank'", "to -2 rad", "-1.5 to 2 rad"],
    ),
    "a slider": ("threeprr", "slider_2", "0 1", ["drive.1: joint 'slider_2'", "1.1 m", "0 to 1 m"]),
    "a balancer": (
        "balancer_sine",
        "pendulum",
        "-0.01 0.01",
        ["drive: joint 'pendulum'", "1.5708 rad", "-0.01 to 0.01 rad"],
    ),
    "a law": ("hacksaw", "crank", "-1 18", ["drive: joint 'crank'", "-1 to 18 rad"]),
    "a rest": (
        "rfr2_natural",
        "motor1",
        "5 6",
        ["drive.0: joint 'motor1'", "0.698132 rad", "5 to 6 rad"],
    ),
    "a settled rod": (
        "rod_snap",
        "motor",
        "-1 2",
        ["drive: joint 'motor'", "-1.39626 rad", "-1 to 2 rad"],
    ),
}
EXTREME_NUMBERS = {
    "a gear of 0": (
        "fourbar.xml",
        '(<motor name="motor" joint="crank")',
        r'\1 gear="0 1 0 0 0 0"',
        [
            "fourbar.toml: channels.holding_moment: the gear of actuator 'motor' is 0",
            "give another",
        ],
    ),
    "n of 23 digits": (
        "fourbar.toml",
        r"n = \d+",
        f"n = {10**22}",
        ["fourbar.toml: run.sweep.n: ", "less than or equal to 100000000"],
    ),
    "segments of 23 digits": (
        "rod_cantilever.toml",
        r"segments = 40$",
        f"segments = {10**22}",
        ["rod_cantilever.toml: rod.rod.segments: ", "equal to 100000"],
    ),
    "refined into 23 digits": (
        "rod_cantilever.toml",
        r"segments = \[10,",
        f"segments = [{10**22},",
        ["rod_cantilever.toml: refine.segments.0: ", "equal to 100000"],
    ),
    "a rate of 1e308": (
        "fourbar.toml",
        r"rate = 1.0  ",
        "rate = 1e308",
        ["fourbar.toml: drive.rate: 1e+308 is too large; numbers may be up to 1e+40"],
    ),
    "1e308 samples": (
        "pendulum.toml",
        r"n = 1001",
        "n = 1e308",
        ["pendulum.toml: run.dynamics.n: 1e+308 is too large"],
    ),
    "3e39 samples": (
        "pendulum.toml",
        r"n = 1001",
        "n = 3e39",
        ["pendulum.toml: run.dynamics.n: must be a whole number, not 3e+39"],
    ),
    "51 digits": (
        "fourbar.toml",
        r"crank = 1.0 ",
        f"crank = {10**50} ",
        ["fourbar.toml: parameters.crank: 100000000... is too large"],
    ),
    "a duration of 1e-308": (
        "pendulum.toml",
        r"until = 10\.0",
        "until = 1e-308",
        ["pendulum.toml: run.dynamics.until: 1e-308 is too small", "begin at 1e-40"],
    ),
    "a time step of 0": (
        "fourbar.xml",
        'timestep="1e-3"',
        'timestep="0"',
        ["fourbar.xml: <option>: timestep 0 is not positive"],
    ),
    "a height field": (
        "fourbar.xml",
        "<worldbody>",
        '<asset><hfield name="h" nrow="1000000" '
        'ncol="1000000" size="1 1 1 1"/></asset><worldbody><geom type="hfield" '
        'hfield="h"/>',
        ["fourbar.xml: MuJoCo cannot compile it", '"Caught an unknown exception!"', "height field"],
    ),
}
CURVE_FAULTS = {
    "x falls": (r"\n0\.0077[^,]*", "\n0.0001", ["line", "t does not rise"]),
    "no unit": (r"r1 \[m\]", "r1", ["column 'r1'", "r1 [unit]"]),
    "unknown unit": (r"r1 \[m\]", "r1 [furlog]", ["column 'r1'", "unknown unit 'furlog'"]),
    "no number": (r"\n0,0,", "\n0,zero,", ["line 4, theta2", "'zero'"]),
    "not finite": (r"\n0,0,", "\n0,nan,", ["line 4, theta2", "not finite"]),
    "wrong unit": (r"r1 \[m\]", "r1 [rad]", ["channels.r1.equals", "rad"]),
}


def error_messages(models: Path, name: str) -> list[str]:
    """The errors of a check of one faulty case together with a good one, which must still run.

    The runs of both cases are short and have few samples: the faults do not depend on the duration
    or on the number of samples.
    """
    case = Path(name).stem if name.endswith(".toml") else "fourbar"
    sidecar = models / f"{case}.toml"
    brief = re.sub(r"(?m)^until = .*", "until = 0.1", sidecar.read_text())
    sidecar.write_text(re.sub(r"(?m)^n = \d{3}\b", "n = 37", brief))
    good = models / "pendulum.toml"
    if case != "pendulum":
        good.write_text(
            good.read_text().replace("until = 10.0", "until = 0.1").replace("n = 1001", "n = 11")
        )
    result = check([models / f"{case}.toml", good], detectable=False, causes=False)
    if case != "pendulum":
        assert {c.outcome for c in result.comparisons if c.case == "pendulum"} >= {"agrees"}
    assert result.exit_code == 2
    return [str(error) for error in result.errors]


FAULTS = {**SIDECAR_FAULTS, **MODEL_FAULTS, **DRIVE_FAULTS}


@pytest.mark.parametrize("wrong", FAULTS)
def test_error_names_file_and_key(wrong, models, edit):
    name, old, new, words = FAULTS[wrong]
    edit(name, "(?m)" + old, new)
    found = error_messages(models, name)
    assert any(all(word in line for word in words) for line in found), found
    assert all(len(line.splitlines()) <= 2 for line in found)
    assert len(found) == len(set(found))


@pytest.mark.parametrize("wrong", JOINT_LIMIT_FAULTS)
def test_a_drive_beyond_its_joint_limits_is_refused_before_any_run(wrong, models, edit):
    name, joint, limits, words = JOINT_LIMIT_FAULTS[wrong]
    edit(f"{name}.xml", f'<joint name="{joint}"', f'<joint name="{joint}" range="{limits}"')
    case = load_case(models / f"{name}.toml")
    for kind, run in case.run.items():
        for solver in run.solvers:
            with pytest.raises(InputError) as caught:
                plan_run(case, kind, solver)
            assert str(caught.value).startswith(str(case.file))
            assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize("header", ["[drive]", "[[drive]]"])
def test_the_key_of_an_only_drive_has_no_number_in_any_error(header, models, edit):
    """A table and a list of one table have the same keys, on reading and on validation."""
    edit("triple_rocker.toml", r"\[+drive\]+", header)
    edit("triple_rocker.toml", r'joint = "crank"', 'joint = "crnak"')
    (unknown,) = error_messages(models, "triple_rocker.toml")
    assert "triple_rocker.toml: drive.joint: " in unknown
    edit("triple_rocker.toml", r"period = .*", 'period = "slow"')
    (wrong,) = error_messages(models, "triple_rocker.toml")
    assert "triple_rocker.toml: drive.period: " in wrong


def test_a_drive_beyond_its_joint_limits_is_one_error_for_all_solvers(models, edit):
    edit("fourbar.xml", '<joint name="crank"', '<joint name="crank" range="-0.01 0.01"')
    found = error_messages(models, "fourbar.xml")
    assert len(found) == 1
    assert "wider range" in found[0]


def test_a_drive_may_pass_its_joint_limit_by_rounding_alone(models, edit):
    """The crank turns to 2 pi; its range ends 1e-9 rad before that, or is 2 pi with 13 digits."""
    for end, refused in (("6.283185306", True), ("6.2831853071796", False)):
        edit(
            "fourbar.xml",
            '<joint name="crank"( range="[^"]*")?',
            f'<joint name="crank" range="0 {end}"',
        )
        case = load_case(models / "fourbar.toml")
        if refused:
            with pytest.raises(InputError, match="beyond its range"):
                plan_run(case, "sweep", "mujoco")
        else:
            assert plan_run(case, "sweep", "mujoco").kind == "sweep"


def test_a_profile_beyond_its_joint_limits_between_samples_is_refused(models, edit):
    edit("triple_rocker.xml", '<joint name="crank"', '<joint name="crank" range="-2 1.9"')
    edit("triple_rocker.toml", r"n = \d+", "n = 4")  # samples at -2, 1, 1 and -2 rad
    with pytest.raises(InputError, match="to 2 rad, beyond its range"):
        plan_run(load_case(models / "triple_rocker.toml"), "dynamics", "mujoco")


@pytest.mark.parametrize(
    "joint", ['range="0 6.283185307179586"', 'range="-0.01 0.01" limited="false"']
)
def test_a_drive_within_its_active_joint_limits_is_accepted(joint, models, edit):
    edit("fourbar.xml", '<joint name="crank"', f'<joint name="crank" {joint}')
    case = load_case(models / "fourbar.toml")
    assert [plan_run(case, kind, "mujoco").kind for kind in case.run] == ["sweep", "dynamics"]


def test_joint_limits_that_a_flag_disables_do_not_restrict_a_drive(models, edit):
    edit("fourbar.xml", '<joint name="crank"', '<joint name="crank" range="-0.01 0.01"')
    edit("fourbar.xml", "<flag ", '<flag limit="disable" ')
    result = check([models / "fourbar.toml"], detectable=False, causes=False)
    assert not result.errors
    assert {c.outcome for c in result.comparisons} == {"agrees", "unchecked", "unsupported"}


@pytest.mark.parametrize("wrong", EXTREME_NUMBERS)
def test_an_extreme_number_is_refused_before_any_run(wrong, models, edit):
    name, old, new, words = EXTREME_NUMBERS[wrong]
    edit(name, "(?m)" + old, new, count=1)
    with pytest.raises(InputError) as caught:
        load_validated((models / name).with_suffix(".toml"))
    assert str(caught.value).startswith(str(models / words[0]))
    assert all(word in str(caught.value) for word in words[1:]), caught.value


@pytest.mark.parametrize("solver", ["mujoco", "pymunk"])
@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("pendulum.toml", "until = 10.0", "until = 1e23", "1e+23 s from sample to sample are "),
        ("pendulum.xml", 'timestep="1e-3"', 'timestep="1e-320"', " are inf time steps of "),
    ],
)
def test_a_run_of_too_many_time_steps_is_refused(name, old, new, words, solver, models, edit):
    edit(name, old, new)
    edit("pendulum.toml", r"n = \d+", "n = 2")
    with pytest.raises(InputError) as caught:
        solve_here(load_case(models / "pendulum.toml"), "dynamics", solver)
    assert words in str(caught.value)
    assert "give a longer step or a shorter run" in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new"),
    [('<joint name="pivot"', '<joint name="pivot" armature="-2"')],
)
def test_a_body_at_which_chipmunk_would_abort_is_refused(old, new, models, edit):
    edit("pendulum.xml", old, new)
    with pytest.raises(InputError, match=r"pendulum\.xml: body 'bob': mass .* must be positive"):
        solve(load_case(models / "pendulum.toml"), "dynamics", "pymunk")


@pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
@pytest.mark.parametrize(
    ("old", "new", "element"),
    [
        ('mass="1" ', 'mass="1.2e308" ', "<inertial>: mass='1.2e308'"),
        ('qpos="[^"]*"', 'qpos="1e308"', "<key name='start'>: qpos='1e308'"),
        ('<joint name="pivot"', r'\g<0> stiffness="1e99"', "<joint name='pivot'>: .*='1e99'"),
    ],
)
def test_a_number_of_the_model_near_the_limits_of_floats_is_named(
    old, new, element, engine, models, edit
):
    edit("pendulum.xml", old, new)
    with pytest.raises(InputError, match=rf"pendulum\.xml: {element}.* is too large"):
        solve(load_case(models / "pendulum.toml"), "dynamics", engine)


def test_discrete_inverse_dynamics_has_no_effect_on_a_sweep(models, edit):
    """With RK4 bare MuJoCo aborts where it is enabled."""
    known = solve_here(load_case(models / "fourbar.toml"), "sweep", "mujoco")
    edit("fourbar.xml", "<flag ", '<flag invdiscrete="enable" ')
    found = solve_here(load_case(models / "fourbar.toml"), "sweep", "mujoco")
    assert known.channels.keys() == found.channels.keys()
    assert all((known.channels[name] == found.channels[name]).all() for name in known.channels)


def test_a_model_that_mujoco_refuses_to_run_is_bad_input():
    with pytest.raises(BadModel, match="mj_x: not supported by RK4"), translate_fatal_errors():
        raise mujoco.FatalError("mj_x: not supported by RK4")


@pytest.mark.parametrize("solver", ["mujoco", "pymunk"])
def test_both_engines_refuse_a_gear_of_0(solver, models, edit):
    edit("fourbar.xml", '<motor name="motor" joint="crank"', r'\g<0> gear="0"')
    with pytest.raises(InputError, match="the gear of actuator 'motor' is 0"):
        solve_here(load_case(models / "fourbar.toml"), "sweep", solver)


@pytest.mark.parametrize("wrong", CURVE_FAULTS)
def test_faults_of_a_recorded_curve_are_reported(wrong, models, edit):
    old, new, words = CURVE_FAULTS[wrong]
    edit("hacksaw_recorded.csv", old, new, count=1)
    found = error_messages(models, "hacksaw_recorded.toml")
    assert any(all(word in line for word in words) for line in found), found


def test_pymunk_names_a_nan_in_the_model(models, edit, keep_solver):
    edit("fourbar.xml", 'pos="0.5 0 0" mass="1"', 'pos="nan 0 0" mass="1"')
    keep_solver("fourbar.toml", "pymunk")
    result = check([models / "fourbar.toml"], detectable=False, causes=False)
    assert result.exit_code == 2
    assert "pos='nan 0 0' is not a number" in str(result.errors[0])


def test_a_pose_that_cannot_be_assembled_is_named(models, edit):
    # a crank of 1.6 m moves the crank pin to 4.6 m from B; coupler and rocker reach 4.5 m
    edit("fourbar.xml", r'name="coupler" pos="1 0 0"', 'name="coupler" pos="1.6 0 0"')
    edit("fourbar.xml", r'qpos="0  1.35026.* 2.2459.*"', 'qpos="0 1.6226 2.2160"')
    found = error_messages(models, "fourbar.xml")
    assert any(
        "cannot be assembled at crank = 2." in line and "open by" in line for line in found
    ), found


def test_command_line_exits_2_without_a_traceback(models, edit):
    edit("fourbar.toml", r"\[drive\]", "[drive]\nspeed = 2")
    answer = CliRunner().invoke(app, ["check", str(models / "fourbar.toml")])
    assert answer.exit_code == 2
    assert "Traceback" not in answer.output
    assert "unknown key 'speed'" in answer.output


def test_a_missing_path_is_named():
    answer = CliRunner().invoke(app, ["check", "no/such/folder"])
    assert answer.exit_code == 2
    assert "no/such/folder: no such file or folder" in answer.output.replace("\n", "")


def test_a_model_that_the_planar_reference_does_not_cover_is_bad_input(models, edit):
    edit(
        "watt.xml",
        "</mujoco>",
        '<tendon><fixed name="rope" armature="1"><joint joint="crank" coef="1"/></fixed></tendon>'
        "</mujoco>",
    )
    [error] = check([models / "watt.toml"]).errors
    assert error.file == models / "watt.xml"
    assert error.wrong == ("the reference 'planar' does not cover it: armature of tendon 'rope'")


def test_an_unknown_key_lists_keys_of_sidecars_alone(models, edit):
    """A sidecar with one of the fields that only a loaded case has is refused as well."""
    with pytest.raises(InputError, match="unknown key 'titel'; did you mean 'title'") as found:
        load_case(edit("fourbar.toml", "(?m)^title", "titel"))
    known = found.value.wrong.partition("known: ")[2].split(", ")
    assert {"title", "drive", "unchecked"} <= set(known)
    fields = {"file", "unmatched", "called", "reads_model"}
    assert not fields & set(known)
    for field in sorted(fields):
        with pytest.raises(InputError) as found:
            load_case(edit("slider_crank.toml", r"\A.*\n", f'{field} = "x"\n', count=1))
        assert (found.value.key, found.value.wrong) == (field, "unknown key: no sidecar has it")


def test_a_file_that_does_not_exist_is_said_not_to_exist(tmp_path):
    with pytest.raises(InputError, match=r"arm\.xml: no such file; give a sidecar, NAME\.toml"):
        find_sidecar(tmp_path / "arm.xml")
