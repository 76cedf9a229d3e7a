"""The scripts in examples/ run alone; their numbers satisfy a law or agree with a source.

Each script runs in an empty folder, into which it must not write unless it is given the folder.
One of them is started as a process, as a user starts it.  The others run in this process, which has
already imported the packages that they need.
"""

import ast
import contextlib
import io
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import proofmass
import proofmass.batch.check
from proofmass.evidence.diagnosis import Diagnosis

EXAMPLES = Path(__file__).parent.parent / "examples"
SCRIPTS = sorted(file.stem for file in EXAMPLES.glob("*.py"))
NUMBER = r"(-?[\d.]+(?:e[+-]?\d+)?)"


def output_in_process(name: str, folder: Path, *args: str) -> str:
    """Standard output of a script that runs in this process."""
    script, output = str(EXAMPLES / f"{name}.py"), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(output):
        patch.chdir(folder)
        patch.setattr(sys, "argv", [script, *args])
        runpy.run_path(script, run_name="__main__")
    if not args:
        assert not list(folder.iterdir())
    return output.getvalue()


def output_as_process(name: str, folder: Path) -> str:
    """Standard output of a script that runs as a process of its own."""
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / f"{name}.py")],
        cwd=folder,
        text=True,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert not list(folder.iterdir())
    return done.stdout


def matched_numbers(pattern: str, text: str) -> list[tuple[float, ...]]:
    """The numbers of each match of a pattern, in which N stands for a number."""
    found = re.findall(pattern.replace("N", NUMBER), text)
    return [tuple(map(float, one if isinstance(one, tuple) else (one,))) for one in found]


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_is_short_and_imports_public_names_only(name: str) -> None:
    text = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    tree = ast.parse(text)
    assert 20 <= len(text.splitlines()) <= 60
    assert f"examples/{name}.py" in (ast.get_docstring(tree) or "")
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("proofmass"):
            assert node.module == "proofmass"
            assert {one.name for one in node.names} <= set(proofmass.__all__)
        if isinstance(node, ast.Import):
            assert not any(one.name.startswith("proofmass") for one in node.names)


def test_every_script_is_listed_in_the_readme_and_shown_in_the_docs() -> None:
    assert len(SCRIPTS) == 8
    listed = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    shown = (EXAMPLES.parent / "docs" / "examples.md").read_text(encoding="utf-8")
    for name in SCRIPTS:
        assert f"| `{name}.py` |" in listed
        assert f'--8<-- "examples/{name}.py"' in shown


def test_check_a_model_agrees_in_two_runs_of_two_engines(tmp_path: Path) -> None:
    text = output_as_process("check_a_model", tmp_path)
    assert len(re.findall(r"^\w+ +\w+ +agrees: ", text, re.MULTILINE)) == 4  # 2 runs, 2 engines
    assert "mujoco:default  is shown, not checked" in text
    assert "a rocker longer by" in text
    assert text.endswith("exit code 0\n")


def test_compare_two_engines_prints_orders_of_convergence(tmp_path: Path) -> None:
    """pymunk converges with second order; MuJoCo's error is that of its soft loop at any step."""
    text = output_in_process("compare_two_engines", tmp_path)
    orders = matched_numbers(r"pymunk +\S+ +\S+ +N +\S+", text)
    assert [order for (order,) in orders] == pytest.approx([2.0] * 2, abs=0.1)
    _, coarse, fine = matched_numbers(r"mujoco +\S+ +N +\S+ +\S+", text)
    assert fine == pytest.approx(coarse, rel=0.5)  # 0.25 if it were of second order


def test_read_curves_prints_the_swing_that_follows_from_geometry(tmp_path: Path) -> None:
    """The swing of the rocker in the run is that of the triangles of its two limit positions.

    Samples are one degree apart, so that they miss a limit position by half a degree at most and
    the swing by the share 1 - cos(0.5 deg), 4e-5.
    """
    text = output_in_process("read_curves", tmp_path, str(tmp_path))
    run, geometry = matched_numbers(r"swings by N rad", text)
    assert run[0] == pytest.approx(geometry[0], abs=1.1e-3)  # three decimals are printed
    table = (tmp_path / "fourbar.csv").read_text(encoding="utf-8").splitlines()
    assert table[0].startswith("crank,")
    assert len(table) == 362


def test_choose_a_setting_keeps_the_energy_of_a_pendulum(tmp_path: Path) -> None:
    """The energy of a released pendulum is constant as far as the error asked for allows.

    An error of 1e-3 of the angle's range, pi, changes the energy by 3e-3 of m g L at most.
    """
    text = output_in_process("choose_a_setting", tmp_path)
    ((change,),) = matched_numbers(r"the energy changes by at most N of m g L", text)
    assert 0.0 < change < 4e-3
    assert "MuJoCo" in text


def test_sweep_in_python_prints_work_equal_to_energy(tmp_path: Path) -> None:
    """The work of the drive is the change of energy; both are printed with five decimals.

    Simpson's rule with 60 intervals has a relative error of 1e-6.
    """
    found = matched_numbers(r"work N J, energy N J", output_in_process("sweep_in_python", tmp_path))
    assert len(found) == 2
    for work, energy in found:
        assert work == pytest.approx(energy, abs=1.1e-5 + 1e-6 * abs(energy))
        assert abs(energy) > 1.0


def test_balancer_prints_the_error_of_the_thesis(tmp_path: Path) -> None:
    """The error is that of the thesis, 0.0835, and the work is the energy of the springs."""
    text = output_in_process("balancer", tmp_path)
    errors = matched_numbers(r"m g r sin N m g r", text)
    assert [error for (error,) in errors] == pytest.approx([0.0835] * 2, abs=2e-4)
    found = matched_numbers(r"work N J, energy of the springs N J", text)
    assert len(found) == 2
    for work, energy in found:
        assert abs(energy) > 0.1
        assert work == pytest.approx(energy, abs=1.1e-3)  # three decimals, trapezoidal rule


def test_rods_converges_with_second_order_to_the_printed_tip(tmp_path: Path) -> None:
    """The tip converges with second order to the value that Mattiasson prints to five decimals."""
    found = matched_numbers(r"order N; limit N m, printed N m", output_in_process("rods", tmp_path))
    assert len(found) == 2
    for order, limit, there in found:
        assert order == pytest.approx(2.0, abs=0.1)
        assert limit == pytest.approx(there, abs=2e-5)


def test_recorded_curve_agrees_and_a_shifted_recording_differs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The search for causes of differences, which the script does not print, is left out."""
    monkeypatch.setattr(
        sys.modules["proofmass.batch.check"],
        "diagnose_run",
        lambda case, kind, solver, *_, **__: Diagnosis(case.name, kind, solver),
    )
    text = output_in_process("recorded_curve", tmp_path)
    assert len(re.findall(r"recording 0 mm off, \w+ +agrees: 0\.00\d mm", text)) == 2
    assert len(re.findall(r"recording 2 mm off, \w+ +differs: 2\.00\d mm", text)) == 2
