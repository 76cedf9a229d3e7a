"""The command line and the pytest plugin: exit codes, output, JSON, reports, pytest items."""

import json
import re
import sys
from types import ModuleType

import pytest
from typer.testing import CliRunner

from proofmass.__main__ import main
from proofmass.commands.cli import app
from proofmass.formats.terminal import COMPARISON_KEYS
from tests.shipped import with_brief_pendulum


def run_command(*args: object):
    return CliRunner().invoke(app, [str(a) for a in args])


@pytest.fixture
def models(models):
    """Copies of the models; the run of the pendulum is shortened to 1 s."""
    return with_brief_pendulum(models)


def test_exit_0_and_json_where_all_agree(models):
    answer = run_command("check", models / "pendulum.toml", "--json")
    assert answer.exit_code == 0
    found = json.loads(answer.stdout)
    assert found["errors"] == []
    assert found["exit_code"] == 0
    rows = found["comparisons"]
    assert len(rows) == 20  # five channels, four solvers
    assert all(tuple(row) == (*COMPARISON_KEYS, "grade") for row in rows)
    assert {row["outcome"] for row in rows if row["solver"] == "mujoco"} == {"agrees"}
    assert all(row["allowed"] is None for row in rows if row["solver"] == "mujoco:default")
    assert rows[0]["detectable"]["length"]["size"] > 0
    assert rows[0]["detectable"]["length"]["relative"] is True


def test_json_holds_the_errors_and_the_exit_code_as_well(models, edit):
    edit("fourbar.toml", "crank = 1.0", "crank = nan")
    answer = run_command("check", models / "fourbar.toml", models / "pendulum.toml", "--json")
    found = json.loads(answer.stdout)
    assert answer.exit_code == found["exit_code"] == 2
    assert {row["case"] for row in found["comparisons"]} == {"pendulum"}
    assert found["errors"] == [
        {
            "file": str(models / "fourbar.toml"),
            "key": "parameters.crank",
            "wrong": "Input should be a finite number, not nan",
        }
    ]


def test_exit_1_where_something_differs(models, edit, keep_solver):
    keep_solver("pendulum.toml", "mujoco")
    edit("pendulum.toml", "length = 1.0", "length = 1.001")  # the search for its cause is quick
    answer = run_command("check", models / "pendulum.toml")
    assert answer.exit_code == 1
    assert "length is 1.001 m; with 1 m all 5 curves agree" in answer.output
    assert "pendulum: 5 of 5 curves differ, in dynamics mujoco" in answer.output


def test_exit_1_where_a_run_takes_too_long(models, edit):
    edit("pendulum.toml", "n = 101", "n = 101\ntimeout = 1e-3")
    answer = run_command("check", models / "pendulum.toml", "--json")
    assert answer.exit_code == 1
    rows = json.loads(answer.stdout)["comparisons"]
    assert {row["outcome"] for row in rows} == {"timed out"}
    assert all(row["error_max"] is None for row in rows)


def test_no_argument_means_the_folder_models(models, monkeypatch):
    monkeypatch.chdir(models.parent)
    for file in models.glob("*.toml"):
        if file.stem != "pendulum":
            file.unlink()
    answer = run_command("list")
    assert answer.exit_code == 0
    assert "pendulum.xml" in answer.output
    others = sum(file.stem != "pendulum" for file in models.glob("*.xml"))
    assert answer.output.count("own motion: mujoco") == others


def test_a_folder_with_nothing_in_it_is_bad_input(tmp_path):
    for command in ("list", "check", "trade", "stress"):
        answer = run_command(command, tmp_path)
        assert answer.exit_code == 2
        assert "no sidecar (.toml) and no model (.xml, .urdf) in this folder" in answer.output


def test_a_model_in_which_nothing_moves_is_not_green(tmp_path):
    (tmp_path / "still.xml").write_text('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>')
    answer = run_command("check", tmp_path, "--json")
    assert answer.exit_code == 1
    rows = json.loads(answer.stdout)["comparisons"]
    assert [row["outcome"] for row in rows] == ["nothing moved"]


def test_report_prints_a_link_to_each_row_that_differs(models, edit, keep_solver, tmp_path):
    keep_solver("pendulum.toml", "mujoco")
    edit("pendulum.toml", "length = 1.0", "length = 1.001")  # the search for its cause is quick
    answer = run_command("report", models / "pendulum.toml", "-o", tmp_path / "pages")
    lines = [line.strip() for line in answer.output.splitlines()]
    (k,) = (k for k, line in enumerate(lines) if line.startswith("pendulum: 5 of 5 curves differ"))
    channel = lines[k].partition("; ")[2].partition(" by")[0]
    page = (tmp_path / "pages" / "pendulum.html").as_posix()
    assert re.fullmatch(rf"{re.escape(page)}#dynamics/mujoco/{channel}@[\d.]+", lines[k + 1])
    assert sum("pendulum.html#" in line for line in lines) == 1


@pytest.mark.parametrize(("options", "there"), [((), False), (("--figures",), True)])
def test_report_writes_an_index_and_a_page_a_case(models, tmp_path, options, there):
    """Option ``--figures`` adds figures for papers, as SVG and PNG files."""
    answer = run_command("report", models / "pendulum.toml", "-o", tmp_path, *options)
    assert answer.exit_code == 0
    assert {p.name for p in tmp_path.glob("*.html")} == {"index.html", "pendulum.html"}
    assert (tmp_path / "figures" / "pendulum-mechanism.svg").is_file()
    assert (tmp_path / "figures" / "pendulum-mechanism.png").is_file() == there
    assert (tmp_path / "figures" / "pendulum-dynamics-overlay.svg").is_file() == there
    assert (tmp_path / "figures" / "pendulum-dynamics-difference.png").is_file() == there
    page = (tmp_path / "pendulum.html").read_text()
    assert ("figures/pendulum-dynamics-overlay.svg" in page) == there
    assert ("figures/pendulum-mechanism.png" in page) == there


def test_sidecars_are_pytest_items(models, pytester):
    result = pytester.runpytest_inprocess(
        models / "pendulum.toml",
        f"{models / 'slider_crank.toml'}::mujoco",
        "-v",
        "-p",
        "no:cacheprovider",
    )
    result.assert_outcomes(passed=3, skipped=2)
    result.stdout.fnmatch_lines(["*slider_crank.toml::mujoco PASSED*"])


def test_an_item_fails_where_check_would_and_says_why(models, edit, pytester):
    edit("pendulum.toml", "length = 1.0", "length = 1.001")  # the search for its cause is quick
    result = pytester.runpytest_inprocess(
        f"{models / 'pendulum.toml'}::mujoco", "-p", "no:cacheprovider"
    )
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*dynamics angle: differs*allowed*"])
    assert "Traceback" not in result.stdout.str()


def test_pytest_reports_bad_input_in_one_line(models, edit, pytester):
    edit("pendulum.toml", "length = 1.0", "lenght = 1.0")
    result = pytester.runpytest_inprocess(str(models / "pendulum.toml"), "-p", "no:cacheprovider")
    result.assert_outcomes(failed=4)
    result.stdout.fnmatch_lines(["*pendulum.toml: parameters.lenght*known: length*"])


def test_an_interrupt_while_commands_are_loaded_exits_with_130(monkeypatch):
    class Loading(ModuleType):
        def __getattr__(self, name):
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "proofmass.commands.cli", Loading("proofmass.commands.cli"))
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 130


TOLERANCES_PATTERN = r"(?s)\[\[tolerance\]\].*"  # from the first tolerance to the end of a sidecar


def test_a_case_without_checks_exits_with_1(models, edit, tmp_path):
    edit("pendulum.toml", TOLERANCES_PATTERN, "")
    answer = run_command("report", models / "pendulum.toml", "-o", tmp_path)
    assert answer.exit_code == 1
    assert "pendulum unchecked: nothing of this case was checked" in answer.output
    assert "20 unchecked, 1 case(s) without any check" in answer.output
    page = (tmp_path / "pendulum.html").read_text()
    assert "✗ Nothing is checked</span>" in page
    assert "Give the case a [[tolerance]] that covers a channel" in page
    index = (tmp_path / "index.html").read_text()
    assert '<b class="bad">1</b> cases differ or failed' in index
    assert "Nothing of it was checked." in index


def test_a_case_marked_as_unchecked_exits_with_0(models, edit, tmp_path):
    edit("pendulum.toml", TOLERANCES_PATTERN, "")
    edit("pendulum.toml", "^title", "unchecked = true\ntitle")
    answer = run_command("report", models / "pendulum.toml", "-o", tmp_path)
    assert answer.exit_code == 0
    assert "20 unchecked" in answer.output
    assert "without any check" not in answer.output
    assert "Not checked, as the sidecar says" in (tmp_path / "pendulum.html").read_text()


def test_a_case_marked_as_unchecked_with_tolerances_is_bad_input(models, edit):
    edit("pendulum.toml", "^title", "unchecked = true\ntitle")
    answer = run_command("check", models / "pendulum.toml")
    assert answer.exit_code == 2
    assert "unchecked = true says that nothing is checked" in answer.output.replace("\n", " ")


def test_pytest_items_of_a_case_without_checks_fail(models, edit, pytester):
    edit("pendulum.toml", TOLERANCES_PATTERN, "")
    result = pytester.runpytest_inprocess(
        f"{models / 'pendulum.toml'}::mujoco", "-p", "no:cacheprovider"
    )
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*nothing of this case was checked*unchecked = true*"])


@pytest.mark.parametrize("name", ["check", "trade"])
def test_help_names_no_variable_of_the_program(name: str):
    """A renaming in the sources had reached the texts: ``error_console`` stood for errors."""
    text = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "200"}).output
    assert "Options" in text
    assert "_" not in text


def test_help_joins_the_lines_of_a_paragraph_and_keeps_units():
    """In 80 columns.  Rich would read a unit such as `[s]` as a tag."""
    text = CliRunner().invoke(app, ["choose", "--help"], env={"COLUMNS": "80"}).output
    assert "run as a program of its own, without proofmass, and from a shifted start, and" in text
    assert "processor time of all runs" in " ".join(text.replace("│", " ").split())
    text = CliRunner().invoke(app, ["animate", "--help"], env={"COLUMNS": "80"}).output
    assert "Playing time [s]." in text
