"""What a file leaves open is asked once, answered by an option, or ends with exit code 2."""

from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.commands import import_table as command
from proofmass.commands.cli import app
from proofmass.tables.clean import csv_text, import_table
from proofmass.tables.decisions import Decisions, ImportQuestion

TIMES = [f"{k * 0.005:.3f}" for k in range(40)]
SQUARES = [f"{(k - 20) ** 2 / 10:.4f}" for k in range(40)]
"""A curve that goes from 40 to 0 and back, and is the slope of nothing else here."""


def rows(*columns: list[str], mark: str = ",") -> str:
    """Rows of cells."""
    return "".join(mark.join(row) + "\n" for row in zip(*columns, strict=True))


GROUPED = "t [ms];x [um]\n" + rows(
    [str(k) for k in range(1, 5)], ["1,234", "2,345", "3,456", "4,567"], mark=";"
)
TWO_TIMES = "time [s],t_motor [s],x [mm]\n" + rows(
    TIMES, [f"{1.5 * k**1.1:.4f}" for k in range(40)], SQUARES
)
WHOLE = "time,x [mm]\n" + rows([str(5 * k) for k in range(40)], SQUARES)
TWO_RUNS = "t [s],x [mm]\n" + rows(TIMES, SQUARES)
TWO_RUNS += "\nrun 2\nt [s],x [mm]\n" + rows(TIMES, SQUARES[::-1])
HALVES = "t [s],a [mm],b [mm]\n" + rows(
    TIMES,
    ["" if k % 3 == 1 else s for k, s in enumerate(SQUARES)],
    ["" if k % 3 == 2 else s for k, s in enumerate(SQUARES)],
)
CASES: dict[str, tuple[str, str, str, Callable[[str], bool]]] = {
    "decimal": (GROUPED, "--decimal ,", "--decimal .", lambda t: "1,1.234" in t),
    "time": (TWO_TIMES, "--time time", "--time t_motor", lambda t: t.startswith("time [s],t_mo")),
    "angle": (
        "t [s],theta\n" + rows(TIMES, SQUARES),
        "--unit theta=deg",
        "--unit theta=rad",
        lambda t: t.startswith("t [s],theta [deg]"),
    ),
    "small angle": (
        "t [s],theta\n" + rows(TIMES, [f"{float(s) / 40:.4f}" for s in SQUARES]),
        "--unit theta=rad",
        "--unit theta=deg",
        lambda t: t.startswith("t [s],theta [rad]"),
    ),
    "gon": (
        "t [s],theta [grad]\n" + rows(TIMES, SQUARES),
        "--unit theta=deg",
        "--unit theta=gon",
        lambda t: t.startswith("t [s],theta [deg]"),
    ),
    "whole times": (WHOLE, "--unit time=s", "--unit time=ms", lambda t: t.startswith("time [s]")),
    "times of more than a second": (
        "t,x [mm]\n" + rows([f"{16.7 * k:.1f}" for k in range(40)], SQUARES),
        "--unit t=s",
        "--unit t=ms",
        lambda t: t.startswith("t [s]"),
    ),
    "clockwise line": (
        "# angles are positive clockwise\nt [s],theta [deg]\n" + rows(TIMES, SQUARES),
        "--clockwise theta",
        "--clockwise none",
        lambda t: "0.000,-40.0000" in t,
    ),
    "tables": (TWO_RUNS, "--table 1", "--table 2", lambda t: "0.195,36.1000" in t),
    "clocks": (HALVES, "--empty keep", "--empty drop", lambda t: "0.005,,36.1000\n" in t),
}
"""A file, the option of the default, another one, and what the file of the default has."""


def run_command(file: Path, *options: str) -> tuple[int, str]:
    """Run the command in a script; its exit code, and what it prints in one line."""
    answer = CliRunner().invoke(app, ["import", str(file), *options])
    return answer.exit_code, " ".join(answer.output.split())


@pytest.mark.parametrize("name", CASES)
def test_a_script_is_told_the_options(name: str, tmp_path: Path) -> None:
    text, default, other, _ = CASES[name]
    (tmp_path / "a.txt").write_text(text, encoding="utf-8")
    code, said = run_command(tmp_path / "a.txt")
    assert code == 2
    assert default in said
    assert other in said
    assert "--yes takes the first" in said
    assert said.index(default) < said.index(other)
    assert not (tmp_path / "a.csv").exists()


@pytest.mark.parametrize("name", CASES)
def test_yes_takes_the_default_and_says_so(name: str, tmp_path: Path) -> None:
    text, default, other, right = CASES[name]
    (tmp_path / "a.txt").write_text(text, encoding="utf-8")
    code, said = run_command(tmp_path / "a.txt", "--yes")
    assert code == 0, said
    assert "the default, by --yes" in said
    assert right((tmp_path / "a.csv").read_text(encoding="utf-8"))
    code, said = run_command(tmp_path / "a.txt", *default.split())
    assert code == 0, said
    assert "by --yes" not in said
    assert right((tmp_path / "a.csv").read_text(encoding="utf-8"))
    code, said = run_command(tmp_path / "a.txt", *other.split())
    assert code == 0, said
    assert not right((tmp_path / "a.csv").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", CASES)
def test_a_person_is_asked_once(name: str, tmp_path: Path) -> None:
    text, default, _, right = CASES[name]
    (tmp_path / "a.txt").write_text(text, encoding="utf-8")
    asked: list[ImportQuestion] = []

    def answer(question: ImportQuestion) -> str:
        asked.append(question)
        return question.answers[0]

    table = import_table(tmp_path / "a.txt", Decisions(ask=answer))
    assert right(csv_text(table))
    assert [one.as_option(one.answers[0]) for one in asked] == [default]
    assert str(table.corrections[-1]).endswith(": as answered")


def test_frames_per_second_have_no_default(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("frame,x [mm]\n" + rows([str(k) for k in range(40)], SQUARES))
    code, said = run_command(tmp_path / "a.txt", "--yes")
    assert code == 2
    assert "give --fps .." in said
    assert run_command(tmp_path / "a.txt", "--fps", "200")[0] == 0
    assert "\n0.195,36.1000\n" in (tmp_path / "a.csv").read_text(encoding="utf-8")


def test_the_terminal_asks_until_an_answer_is_possible(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    given = iter(["blue", "gon"])
    monkeypatch.setattr(command.typer, "prompt", lambda *_, **__: next(given))
    question = ImportQuestion("theta", "two readings", "--unit theta={}", ("deg", "gon"), "{}")
    assert command.ask_person(question) == "gon"
    assert "? theta: two readings" in capsys.readouterr().err


def test_an_answer_that_names_nothing_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(TWO_TIMES, encoding="utf-8")
    with pytest.raises(InputError, match=r"--time: no column 'tim'; did you mean 'time'\?"):
        import_table(tmp_path / "a.txt", Decisions(time="tim"))
    with pytest.raises(InputError, match="no column 'y'"):
        import_table(tmp_path / "a.txt", Decisions(time="time", units={"y": "mm"}))
    with pytest.raises(InputError, match="x=furlong: no unit"):
        import_table(tmp_path / "a.txt", Decisions(time="time", units={"x": "furlong"}))
    with pytest.raises(InputError, match="no column 'z'"):
        import_table(tmp_path / "a.txt", Decisions(time="time", clockwise=("z",)))
    with pytest.raises(InputError, match="--encoding"):
        import_table(tmp_path / "a.txt", Decisions(encoding="klingon"))
    (tmp_path / "a.txt").write_text(TWO_RUNS, encoding="utf-8")
    with pytest.raises(InputError, match="--table: the file has 2 tables"):
        import_table(tmp_path / "a.txt", Decisions(table=3))
