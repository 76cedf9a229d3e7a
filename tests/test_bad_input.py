"""Bad input: one or two lines that name file and key and what would be right; exit code 2."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from proofmass.check import check
from proofmass.cli import app

SIDECARS = {
    "not TOML": ("fourbar.toml", r"^title", "title title", ["fourbar.toml", "not TOML"]),
    "unknown key": ("fourbar.toml", r"\[drive\]", "[drive]\nspeed = 2",
                    ["drive", "'speed'", "joint, from, to, rate"]),
    "unknown table": ("fourbar.toml", r"\[drive\]", "[drvie]\n[drive]", ["'drvie'", "channels"]),
    "no reason": ("fourbar.toml", r'why = "loops', 'because = "loops',
                  ["tolerance.0", "'because'", "why"]),
    "empty reason": ("pendulum.toml", r'why = ".*"', 'why = " "', ["tolerance.0", "reason"]),
    "reason left out": ("pendulum.toml", r"why = .*", "", ["tolerance.0.why", "missing"]),
    "no such reference": ("fourbar.toml", r'reference = "fourbar"', 'reference = "fourbra"',
                          ["reference", "'fourbra'", "there are: ", "fourbar, ", "planar, "]),
    "no such curve": ("hacksaw_recorded.toml", r'"hacksaw_recorded.csv"', '"inventor.csv"',
                      ["inventor.csv", "no such recorded curve"]),
    "no such quantity": ("fourbar.toml", r'"rocker_angle"', '"rocker"',
                         ["channels.rocker.equals", "'rocker'", "rocker_angle"]),
    "no such parameter": ("fourbar.toml", r"coupler = 2.0", "copler = 2.0",
                          ["parameters.copler", "coupler"]),
    "negative length": ("fourbar.toml", r"coupler = 2.0", "coupler = -2.0",
                        ["parameters", "coupler"]),
    "lengths that cannot close": ("fourbar.toml", r"coupler = 2.0", "coupler = 0.1",
                                  ["parameters"]),
    "no such model": ("fourbar.toml", r"reference =", 'model = "forbar.xml"\nreference =',
                      ["model", "forbar.xml"]),
    "no such solver": ("fourbar.toml", r'"mujoco:default"', '"bullet"',
                       ["'bullet'", "mujoco, pymunk"]),
    "variant without settings": ("fourbar.toml", r'"mujoco:default"', '"mujoco:slow"',
                                 ['settings."mujoco:slow"']),
    "unknown setting": ("hacksaw.toml", r"timestep = 1e-4", "step = 1e-4",
                        ["'step'", "timestep"]),
    "two tolerances": ("fourbar.toml", r'solver = "mujoco"\nof_range = 1e-12',
                       'solver = "mujoco"\nof_range = 1e-12\nwhy = "a"\n[[tolerance]]\n'
                       'of_range = 1', ["2 tolerances", "exactly one"]),
    "wrong branch": ("fourbar.toml", r"mode = 1 ", "mode = -1 ", ["start", "mode +1", "-1"]),
    "NaN": ("fourbar.toml", r"crank = 1.0", "crank = nan", ["parameters.crank", "finite"]),
}
MODELS = {
    "not XML": ("fourbar.xml", r"</worldbody>", "</wordlbody>", ["fourbar.xml", "XML"]),
    "no such sensor": ("fourbar.xml", r'jointpos name="rocker"', 'jointpos name="rokcer"',
                       ["fourbar.xml", "'rocker'", "rokcer"]),
    "no such joint": ("fourbar.toml", r'joint = "crank"', 'joint = "cranck"',
                      ["fourbar.xml", "'cranck'", "crank, coupler, rocker"]),
    "no such key": ("fourbar_crossed.toml", r'start = "crossed"', 'start = "corssed"',
                    ["'corssed'", "start, crossed"]),
    "not assembled": ("fourbar.xml", r'qpos="0  1.3502630', 'qpos="0  2.3502630',
                      ["fourbar.xml", "'start'", "'pin'", "open by"]),
    "not planar": ("fourbar.xml", r'<joint name="rocker"/>',
                   '<joint name="rocker" axis="0 0.1 1"/>',
                   ["fourbar.toml", "run.duration.solvers", "pymunk", "'rocker' leaves the plane"]),
    "a freedom too many": ("fourbar.xml", r'<site name="rocker_end" pos="2.5 0 0"/>',
                           '<site name="rocker_end" pos="2.5 0 0"/><body name="bob"><joint '
                           'name="bob"/><inertial pos="0 1 0" mass="1" diaginertia="1 1 1"/>'
                           '</body>', ["run.sweep.solvers", "mujoco", "1 degree(s) of freedom"]),
    "NaN in the model": ("fourbar.xml", r'pos="0.5 0 0" mass="1"', 'pos="nan 0 0" mass="1"',
                         ["fourbar.xml"]),
}
DRIVES = {
    "a follower with a rate": ("fivebar.toml", r'joint = "right".*', 'joint = "right"\nrate = 2',
                               ["drive", "rate belongs to the first drive"]),
    "a follower without an end": ("fivebar.toml", r'(joint = "right".*\n.*\n)to = .*', r"\1",
                                  ["drive", "'right' needs from and to"]),
    "driven twice": ("fivebar.toml", r'joint = "right"', 'joint = "left"',
                     ["drive", "'left' is driven twice"]),
    "a place that is no number": ("fivebar.toml", r'(joint = "right".*)\nfrom = 0.0',
                                  r"\1\nfrom = nan", ["drive.1.from", "finite"]),
    "columns for one of two": ("hacksaw_recorded.toml", r"\[drive\](\n.*\n.*)",
                               '[[drive]]\\1\n[[drive]]\njoint = "theta1"',
                               ["drive", "'theta1' needs law = [value, rate, acceleration]"]),
    "no such law": ("fivebar_circle.toml", r'law = "circle"', 'law = "cirlce"',
                    ["drive.law", "analytic.fivebar has no function 'cirlce'"]),
    "a swing with a rate": ("triple_rocker.toml", r"period = 8.0", "period = 8.0\nrate = 1.0",
                            ["drive", "rate goes with from and to alone"]),
    "a drive too few": ("inverted_slider_crank_held.toml",
                        r'\[\[drive\]\]\njoint = "bar"[^\[]*', "",
                        ["run.sweep.solvers", "mujoco", "1 degree(s) of freedom"]),
    "zero length": ("slider_crank.toml", r"coupler = 2.0", "coupler = 0.0",
                    ["parameters", "coupler must be a positive"]),
    "a coupler too short": ("slider_crank.toml", r"coupler = 2.0", "coupler = 0.5",
                            ["parameters", "angle"]),
    "five bars that miss": ("fivebar.toml", r"left_coupler = 3.5", "left_coupler = 0.5",
                            ["parameters", "miss by", "m"]),
}
CURVES = {
    "x falls": (r"\n0\.0077[^,]*", "\n0.0001", ["line", "t does not rise"]),
    "no unit": (r"r1 \[m\]", "r1", ["column 'r1'", "name [unit]"]),
    "unknown unit": (r"r1 \[m\]", "r1 [furlong]", ["r1 [furlong]", "unknown unit"]),
    "no number": (r"\n0,0,", "\n0,zero,", ["line 4, theta2", "'zero'"]),
    "not finite": (r"\n0,0,", "\n0,nan,", ["line 4, theta2", "not finite"]),
    "wrong unit": (r"r1 \[m\]", "r1 [rad]", ["channels.r1.equals", "rad"]),
}


def messages(models: Path, name: str) -> list[str]:
    """Errors of a check of one case and of a good one beside it, which must still run."""
    case = Path(name).stem if name.endswith(".toml") else "fourbar"
    result = check([models / f"{case}.toml", models / "pendulum.toml"])
    if case != "pendulum":
        assert {c.outcome for c in result.comparisons if c.case == "pendulum"} >= {"agrees"}
    assert result.exit_code == 2
    return [str(error) for error in result.errors]


WRONG = {**SIDECARS, **MODELS, **DRIVES}


@pytest.mark.parametrize("wrong", WRONG)
def test_error_names_file_and_key(wrong, models, edit):
    name, old, new, words = WRONG[wrong]
    edit(name, "(?m)" + old, new)
    found = messages(models, name)
    assert any(all(word in line for word in words) for line in found), found
    assert all(len(line.splitlines()) <= 2 for line in found)


@pytest.mark.parametrize("wrong", CURVES)
def test_error_in_a_recorded_curve(wrong, models, edit):
    old, new, words = CURVES[wrong]
    edit("hacksaw_recorded.csv", old, new, count=1)
    found = messages(models, "hacksaw_recorded.toml")
    assert any(all(word in line for word in words) for line in found), found


def test_a_nan_in_the_model_is_named_by_pymunk_too(models, edit):
    edit("fourbar.xml", 'pos="0.5 0 0" mass="1"', 'pos="nan 0 0" mass="1"')
    edit("fourbar.toml", r'"mujoco", ("mujoco:default", )?', "")
    result = check([models / "fourbar.toml"])
    assert result.exit_code == 2
    assert "pos='nan 0 0' is not a number" in str(result.errors[0])


def test_a_pose_that_cannot_be_assembled_is_named(models, edit):
    # with a crank of 1.6 the crank pin comes 4.6 from B; coupler and rocker reach 4.5
    edit("fourbar.xml", r'name="coupler" pos="1 0 0"', 'name="coupler" pos="1.6 0 0"')
    edit("fourbar.xml", r'qpos="0  1.35026.* 2.2459.*"', 'qpos="0 1.6226 2.2160"')
    found = messages(models, "fourbar.xml")
    assert any("cannot be assembled at crank = 2." in line and "open by" in line
               for line in found), found


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
