"""The lines that an import prints make a case that checks, in each role of a table.

The model is a slider-crank with a crank of 0.1 m, at 288 degrees per second, and a rod of 0.35 m.
The closed form of the slider's way is a root of squares, and the table has it to 1e-4 mm.
"""

import re
import tomllib
from math import cos, pi, sin, sqrt
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass import check
from proofmass.commands.cli import app
from proofmass.run.sidecar import load_case
from proofmass.run.solve import prescribed_run
from proofmass.tables.clean import import_table
from proofmass.tables.decisions import Decisions
from proofmass.tables.sidecar_lines import TableRole, sidecar_lines
from tests.shipped import shipped

RATE = 288.0  # [deg/s]
ROWS = 126
MODEL = """\
<mujoco model="crank">
  <compiler angle="radian"/>
  <option timestep="1e-3" integrator="RK4" tolerance="1e-10"><flag contact="disable"/></option>
  <default><equality solref="0.005 1" solimp="0.9999 0.9999 0.001"/></default>
  <worldbody>
    <body name="crank">
      <joint name="crank"/>
      <inertial pos="0.05 0 0" mass="1" diaginertia="0.001 0.001 0.001"/>
      <body name="rod" pos="0.1 0 0">
        <joint name="rod"/>
        <inertial pos="0.175 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
        <site name="end" pos="0.35 0 0"/>
      </body>
    </body>
    <body name="slider" pos="0.45 0 0">
      <joint name="slider" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.001 0.001 0.001"/>
      <site name="pin"/>
    </body>
  </worldbody>
  <equality><connect name="loop" site1="end" site2="pin"/></equality>
  <sensor><jointpos name="way" joint="slider"/></sensor>
  <keyframe><key name="start" qpos="0 0 0"/></keyframe>
</mujoco>
"""
HEAD = 'title = "Slider-crank"\nsource = "a closed form, in this test"\n'
TOLERANCE = '\n[[tolerance]]\nrelative_to_range = 1e-4\nwhy = "softness of the loop, and digits"\n'
RADIANS = RATE * pi / 180  # [rad/s]
DRIVE = f'\n[drive]\njoint = "crank"\nto = {RADIANS * 1.25!r}\nrate = {RADIANS!r}\n'


def way(angle: float) -> float:
    """The way of the slider from its start [mm]."""
    return 100 * cos(angle) + sqrt(350**2 - (100 * sin(angle)) ** 2) - 450


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """A table with a preamble, decimal commas and a wrapped angle, and the model."""
    (tmp_path / "crank.xml").write_text(MODEL, encoding="utf-8")
    rows = [
        f"{k * 0.01:.2f};{(RATE * k * 0.01 + 180) % 360 - 180:.3f};{way(RADIANS * k * 0.01):.4f}"
        for k in range(ROWS)
    ]
    text = "Rig 3\n\nTime ( s );phi ( grd );way ( mm )\n" + "\n".join(rows).replace(".", ",") + "\n"
    (tmp_path / "rig.txt").write_text(text, encoding="utf-8")
    return tmp_path / "rig.txt"


def printed_lines(table: Path, role: str) -> str:
    """What the command prints on standard output."""
    answer = CliRunner().invoke(app, ["import", str(table), "--as", role])
    assert answer.exit_code == 0, answer.output
    return answer.stdout


def outcomes(folder: Path, text: str) -> dict[str, str]:
    """The outcome of each solver in the case of a sidecar."""
    (folder / "crank.toml").write_text(text, encoding="utf-8")
    result = check(folder / "crank.toml", jobs=1)
    assert result.errors == []
    return {c.solver: c.outcome for c in result.comparisons}


def test_a_table_is_the_truth(table: Path) -> None:
    lines = printed_lines(table, "truth")
    told = tomllib.loads(lines)
    assert told["reference"] == "rig.csv"
    assert told["channels"]["way"] == {"equals": "way", "unit": "mm"}
    top, _, channels = lines.partition("\n[channels]")
    channels = channels.replace('phi = { equals = "phi", unit = "deg" }\n', "")  # no sensor has it
    run = '\n[run.dynamics]\nsolvers = ["mujoco"]\n'
    text = HEAD + top + DRIVE + run + "\n[channels]" + channels + TOLERANCE
    assert outcomes(table.parent, text) == {"mujoco": "agrees"}
    text = text.replace('unit = "mm" }', 'unit = "mm", scale = 1.1 }')
    assert outcomes(table.parent, text) == {"mujoco": "differs"}


def test_a_table_is_a_party(table: Path) -> None:
    lines = printed_lines(table, "party").replace('phi = "phi"\n', "")
    assert 'solvers = ["mujoco", "recorded:rig"]' in lines
    run = '\n[run.dynamics]\nn = 126\nsolvers = ["mujoco", "recorded:rig"]\n\n'
    channels = '\n[channels]\nway = { equals = "way" }\n'
    text = HEAD + 'reference = "planar"\n' + DRIVE + run + lines + channels + TOLERANCE
    assert outcomes(table.parent, text) == {"mujoco": "agrees", "recorded:rig": "agrees"}


def test_a_table_is_a_profile(table: Path) -> None:
    lines = printed_lines(table, "profile")
    assert tomllib.loads(lines)["drive"]["profile"] == {"file": "rig.csv", "value": "phi"}
    run = '\n[run.dynamics]\nn = 126\nsolvers = ["mujoco"]\n'
    head = HEAD + 'reference = "planar"\n'
    text = head + lines.replace("JOINT", "crank") + run + TOLERANCE
    assert outcomes(table.parent, text) == {"mujoco": "agrees"}


def test_a_table_is_a_path_with_its_loads(tmp_path: Path) -> None:
    """Places in mm with decimal commas lead the five-bar as its own path does."""
    rows = [line.split(",") for line in shipped("fivebar_path.csv").read_text().splitlines()[3:]]
    cells = "\n".join(";".join(row).replace(".", ",") for row in rows)
    text = f"t (s);P.x (mm);P.y (mm);Fx (N);Fy (N)\n{cells}\n"
    (tmp_path / "tip.txt").write_text(text, encoding="utf-8")
    lines = printed_lines(tmp_path / "tip.txt", "path")
    for placeholder, name in (("JOINT", "left"), ("JOINT_2", "right")):
        lines = lines.replace(f'"{placeholder}"', f'"{name}"')
    for part in "xy":
        lines = lines.replace('"MOTOR"', f'"load_{part}"', 1)
        lines = lines.replace('"PARAMETER"', f'"force_{part}"', 1)
    assert "until" not in lines
    modes = "parameters = { left_mode = 1, right_mode = -1 }"
    lines = lines.replace('joint = "left"', f'joint = "left"\n{modes}')
    own = shipped("fivebar_path.toml")
    head, tail = own.read_text().split("[[drive]]", 1)[0], "\n[run.sweep]\nn = 9\n"
    head = re.sub(r"(?m)^accuracy.*\n", "", head)
    (tmp_path / "fivebar_path.xml").write_text(own.with_suffix(".xml").read_text())
    (tmp_path / "led.toml").write_text(f'model = "fivebar_path.xml"\n{head}{lines}{tail}')
    x = np.linspace(0.0, 4.0, 9)
    one, two = (prescribed_run(load_case(file), "sweep") for file in (own, tmp_path / "led.toml"))
    assert two.motion(x)[0] == pytest.approx(one.motion(x)[0], abs=1e-12)
    assert two.controls(x)[0] == pytest.approx(one.controls(x)[0], abs=1e-12)


def test_a_path_without_times_needs_its_duration(tmp_path: Path) -> None:
    rows = "".join(f"{k / 10},{k * k / 100},{k}\n" for k in range(20))
    (tmp_path / "a.txt").write_text("x [m],y [m],psi [deg]\n" + rows, encoding="utf-8")
    table = import_table(tmp_path / "a.txt", Decisions())
    told = tomllib.loads("\n".join(sidecar_lines(table, "a.csv", TableRole.PATH)))
    assert told["drive"][0]["profile"] == {"path": "a.csv", "x": "x", "y": "y", "phi": "psi"}
    assert told["drive"][0]["until"] == 1.0


def test_lines_state_a_unit_where_the_file_has_none(tmp_path: Path) -> None:
    rows = "".join(f"{k / 10},{k},{k * k},\n" for k in range(20))
    (tmp_path / "a.txt").write_text("clock,x,v_x,empty\n" + rows, encoding="utf-8")
    table = import_table(tmp_path / "a.txt", Decisions(units={"clock": "s"}))
    told = tomllib.loads("\n".join(sidecar_lines(table, "a.csv", TableRole.TRUTH)))
    assert told["recording"] == {"columns": {"x": {"unit": "m"}, "v_x": {"unit": "m/s"}}}
    assert told["channels"]["v_x"] == {"equals": "v_x", "unit": "m/s"}
    told = tomllib.loads("\n".join(sidecar_lines(table, "a.csv", TableRole.PARTY)))
    assert told["settings"]["recorded:a"]["channels"]["x"] == {"column": "x", "unit": "m"}
    told = tomllib.loads("\n".join(sidecar_lines(table, "a.csv", TableRole.PROFILE)))
    assert told["drive"]["profile"]["value"] == {"column": "x", "unit": "m"}


def test_columns_with_empty_cells_are_named_and_not_used(tmp_path: Path) -> None:
    rows = "".join(f"{k / 10},{k},{k if k else ''}\n" for k in range(20))
    (tmp_path / "a.txt").write_text("t [s],x [m],v [m/s]\n" + rows, encoding="utf-8")
    table = import_table(tmp_path / "a.txt", Decisions())
    for role in TableRole:
        lines = "\n".join(sidecar_lines(table, "a.csv", role))
        tomllib.loads(lines)
        assert ("# v = " in lines) == (role in (TableRole.TRUTH, TableRole.PARTY))


def test_a_recorded_file_that_is_refused_names_the_command(table: Path) -> None:
    bad = table.with_name("rig 2.csv")
    bad.write_text(table.read_text(encoding="utf-8"), encoding="utf-8")
    text = HEAD + f'reference = "{bad.name}"\n' + DRIVE + TOLERANCE
    (table.parent / "crank.toml").write_text(text, encoding="utf-8")
    (error,) = check(table.parent / "crank.toml", jobs=1).errors
    assert "try proofmass import 'rig 2.csv'" in str(error)
    text = text.replace(bad.name, "rig.lvm")
    (table.parent / "crank.toml").write_text(text, encoding="utf-8")
    (error,) = check(table.parent / "crank.toml", jobs=1).errors
    assert "'rig.lvm' is no CSV; try proofmass import rig.lvm" in str(error)
