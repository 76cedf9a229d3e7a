"""An engine of another distribution works in all commands without a change of proofmass.

The tests write the distribution: a short module, and the metadata that pip would install.  `twin`
is pymunk under another name, `wrong` is the same with 1 % more gravity, `bare` has only what an
engine must have, `lost` has a part that cannot be imported, `broken` cannot be imported itself, and
`foreign` is no engine.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest
from typer.testing import CliRunner

from proofmass import check, load_case, solve
from proofmass.base.wording import number
from proofmass.commands.cli import app
from proofmass.report.style import solver_looks
from proofmass.sim import engines
from proofmass.sim.engines import engine_names, engine_of, format_solver
from proofmass.studies.measure import relative_errors
from proofmass.studies.record import read_table
from proofmass.studies.store import Store, package_versions
from proofmass.studies.stress import problems
from proofmass.studies.stress.boundary import read_boundaries
from proofmass.studies.trade.trade import read_verdicts
from tests.distributions import on_path, write_distribution
from tests.shipped import shipped

ENGINE_MODULE = """
from pathlib import Path
from tempfile import TemporaryDirectory

from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.part import LoadedPart
from proofmass.sim.pymunk.engine import Pymunk, PymunkSettings, simulate


class Twin(Pymunk):
    title = "Twin"


class Wrong(Twin):
    def simulate(self, model, run):
        with TemporaryDirectory() as folder:
            file = Path(folder) / "model.xml"
            file.write_text(model.read_text().replace("-9.81", "-9.9081"))
            return simulate(file, run)


class Bare(Engine):
    settings = PymunkSettings

    def simulate(self, model, run):
        return simulate(model, run)


class Lost(Twin):
    tuning = LoadedPart("twin_tuning_that_is_not_there:TUNING")


TWIN, WRONG, BARE, LOST = Twin(), Wrong(), Bare(), Lost()
"""
ENGINES = {
    "twin": "TWIN",
    "wrong": "WRONG",
    "bare": "BARE",
    "lost": "LOST",
    "broken": "twin_engine_that_is_not_there:ENGINE",
    "foreign": "Path",
}
SIDECAR = """
title = "Pendulum, let go from the horizontal"
source = "exact motion by Jacobi elliptic functions"
model = "{model}"
reference = "pendulum"
parameters = {{ length = 1.0, mass = 1.0, gravity = 9.81, amplitude = -1.5707963267948966 }}

[run.dynamics]
until = 1.0
n = 101
solvers = {solvers}

[channels]
angle = {{ equals = "angle", unit = "rad" }}
rate = {{ equals = "rate", unit = "rad/s" }}

[[tolerance]]
relative_to_range = 1e-4  # a hundredth of what 1 % of gravity changes
why = "leapfrog at 1 ms: the phase is off by (omega dt)^2 / 24 of the way"
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with the distribution, which this process and new workers have on their path."""
    folder = tmp_path_factory.mktemp("site")
    files = {"twin_engine.py": ENGINE_MODULE}
    write_distribution(folder, "twin_engine", files, engines.ENGINE_GROUP, **ENGINES)
    with on_path(folder):
        yield folder


def write_sidecar(folder: Path, *solvers: str) -> Path:
    """Write a sidecar of the shipped pendulum's model for these solvers."""
    file = folder / "twins.toml"
    model = os.path.relpath(shipped("pendulum.xml"), folder)
    file.write_text(SIDECAR.format(model=model, solvers=list(solvers)))
    return file


def invoke_command(*words: object) -> str:
    """The standard output of a command, which must end with exit code 0."""
    found = CliRunner().invoke(app, [str(word) for word in words])
    assert found.exit_code == 0, found.output
    return found.stdout


def test_engines_are_listed_without_being_imported(
    site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The default engines are asked whether they compute; engines of others are not imported."""
    entry_point = type(engines.engine_entry_points()["mujoco"])
    load, loaded = entry_point.load, []
    monkeypatch.setattr(entry_point, "load", lambda own: loaded.append(own.name) or load(own))
    engines.engine_of.cache_clear()
    others = ["bare", "broken", "foreign", "lost", "twin", "wrong"]
    assert engine_names() == ["mujoco", "pymunk", "recorded", *others]
    assert engines.own_engines() == ("mujoco", "pymunk", "recorded")  # these keep their colours
    assert not loaded
    assert engines.default_engines() == ("mujoco", "pymunk")
    assert loaded == ["mujoco", "pymunk", "recorded"]


def test_check_agrees_with_the_twin_and_not_with_the_wrong_one(site: Path, tmp_path: Path) -> None:
    result = check(
        [write_sidecar(tmp_path, "pymunk", "twin", "bare", "wrong", "broken")],
        detectable=False,
        causes=False,
    )
    assert not result.errors
    found = {c.solver: (c.outcome, c.error_max) for c in result.comparisons if c.channel == "angle"}
    assert found["twin"] == found["bare"] == found["pymunk"]
    assert found["twin"][0] == "agrees"
    assert found["wrong"][0] == "differs"
    assert found["broken"][0] == "crashed"
    message = next(c.message for c in result.comparisons if c.solver == "broken")
    assert "simulator 'broken', of twin_engine: twin_engine_that_is_not_there:ENGINE" in message
    assert "No module named" in message


def test_an_unknown_engine_is_reported_with_the_known_ones(site: Path, tmp_path: Path) -> None:
    (error,) = check([write_sidecar(tmp_path, "twim")], detectable=False, causes=False).errors
    assert error.key == "run.dynamics.solvers"
    assert error.wrong.startswith("no simulator 'twim'; did you mean 'twin'? there are: mujoco, ")


def test_an_entry_point_that_is_no_engine_is_refused(site: Path) -> None:
    with pytest.raises(engines.NoEngine, match=r"twin_engine:Path is no object of a class of"):
        engine_of("foreign")


def test_an_engine_has_its_own_name_look_and_versions(site: Path) -> None:
    assert (format_solver("twin:default"), format_solver("bare"), format_solver("adams")) == (
        "Twin default",
        "Bare",
        "adams",
    )
    chosen = solver_looks([*engine_names(), "adams"])
    assert len({look.colour + str(look.dash) for look in chosen.values()}) == len(chosen)
    assert package_versions("twin")["twin_engine"] == "1.0"
    assert (
        package_versions("bare")["adapter"] == package_versions("twin")["adapter"]
    )  # the digest of the module of both
    assert "adapter" not in package_versions("pymunk")


def test_the_report_shows_the_twin(site: Path, tmp_path: Path) -> None:
    invoke_command("report", write_sidecar(tmp_path, "pymunk", "twin"), "-o", tmp_path / "pages")
    page = (tmp_path / "pages" / "twins.html").read_text(encoding="utf-8")
    assert "Twin" in page
    assert "twin_engine" in page  # among the versions


@pytest.mark.usefixtures("undrawn")
def test_trade_varies_the_step_of_an_engine_without_a_description(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(import_module("proofmass.run.solve"), "MAX_FORCE_EVALUATIONS", 1.6e3)
    invoke_command("trade", write_sidecar(tmp_path, "bare"), "-o", tmp_path / "trade", "--jobs", 1)
    rows = read_table(tmp_path / "trade" / "trade.csv")
    assert {(row.engine, row.outcome) for row in rows} == {("bare", "ran")}
    verdict = next(
        v
        for v in read_verdicts(tmp_path / "trade" / "verdicts.json")
        if (v.series, v.kind) == ("Bare", "position")
    )
    assert verdict.reached.startswith("order 2")  # as with pymunk
    assert verdict.expected != verdict.expected  # NaN: no order follows from theory
    page = (tmp_path / "trade" / "index.html").read_text(encoding="utf-8")
    assert "Bare" in page


def test_a_part_that_cannot_be_imported_is_one_line_with_its_place(
    site: Path, tmp_path: Path
) -> None:
    file = write_sidecar(tmp_path, "lost")
    found = CliRunner().invoke(app, ["trade", str(file), "-o", str(tmp_path / "t"), "--jobs", "1"])
    assert found.exit_code == 2
    (line,) = found.output.splitlines()
    assert line.startswith(
        "error: Lost: its tuning, twin_tuning_that_is_not_there:TUNING, cannot be loaded: "
        "ModuleNotFoundError: "
    )
    assert check([file], detectable=False, causes=False).exit_code == 0  # which asks for no part


@pytest.mark.slow
def test_trade_knows_the_orders_of_the_twin(site: Path, tmp_path: Path) -> None:
    invoke_command("trade", write_sidecar(tmp_path, "twin"), "-o", tmp_path / "trade")
    found = {
        v.series: v
        for v in read_verdicts(tmp_path / "trade" / "verdicts.json")
        if v.kind == "position"
    }
    assert found["Twin, no bias"].expected == 2.0
    assert found["Twin, no bias"].observed == pytest.approx(2.0, abs=0.2)
    assert found["Twin, defaults"].expected == 1.0


def test_choose_finds_a_setting_of_an_engine_without_programs(site: Path, tmp_path: Path) -> None:
    text = invoke_command(
        "choose",
        write_sidecar(tmp_path, "bare"),
        "--error",
        1e-2,
        "--store",
        tmp_path / "store",
        "--jobs",
        1,
    )
    assert "Bare has no programs" in " ".join(text.split())


def test_the_lines_that_choose_prints_are_the_setting_that_it_measured(
    site: Path, tmp_path: Path
) -> None:
    """The setting has Chipmunk's defaults; with proofmass's choice the error is another one."""
    file = write_sidecar(tmp_path, "bare")
    words = "choose", file, "--error", 1e-3, "--store", tmp_path / "store", "--jobs", 1
    text = invoke_command(*words)
    with file.open("a") as sidecar:
        sidecar.write(f"\n{text}")
    case = load_case(file)
    (settings,) = case.settings.values()
    assert settings["defaults"] is True
    measured = [
        record["found"]["errors"]["position"]
        for _, record in Store(tmp_path / "store" / "runs").records("twins", "dynamics")
        if record["parameters"] == settings
    ]
    pasted = relative_errors(case, "dynamics", solve(case, "dynamics", "bare"))["position"]
    assert measured == [pasted]
    assert f"{number(pasted, 2)} off" in " ".join(text.replace("#", "").split())
    without = {"bare": {key: settings[key] for key in settings if key != "defaults"}}
    case = case.model_copy(update={"settings": without})
    other = relative_errors(case, "dynamics", solve(case, "dynamics", "bare"))["position"]
    assert other != pasted


@pytest.mark.slow
def test_choose_writes_a_program_of_the_twin(site: Path, tmp_path: Path) -> None:
    program = tmp_path / "run.py"
    invoke_command(
        "choose",
        write_sidecar(tmp_path, "twin"),
        "--error",
        1e-3,
        "--store",
        tmp_path / "store",
        "-o",
        program,
    )
    assert "Made by proofmass choose with pymunk" in " ".join(program.read_text().split())


@pytest.mark.usefixtures("undrawn")
def test_stress_finds_where_the_twin_breaks(site: Path, tmp_path: Path) -> None:
    invoke_command(
        "stress",
        write_sidecar(tmp_path, "twin"),
        "-o",
        tmp_path / "stress",
        "--only",
        "gravity",
        "--jobs",
        1,
    )
    (found,) = read_boundaries(tmp_path / "stress" / "stress.csv")
    assert (found.engine, found.parameter) == ("twin", "gravity")
    assert found.holds > found.start == 1.0  # it ran, and did not fail at once
    assert "Twin" in (tmp_path / "stress" / "index.html").read_text(encoding="utf-8")


def test_stress_has_the_test_problems_of_the_twin(
    site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def asked(engine: str) -> list[tuple[str, str, str, float]]:
        monkeypatch.setattr(problems, "engine_names", lambda: [engine])
        found = list(problems.list_problems())
        assert {one.engine for one in found} == {engine}
        return [(one.what, one.setting, one.parameter, one.theory) for one in found]

    assert asked("twin") == asked("pymunk")
    assert len(asked("twin")) > len(asked("bare")) > 0  # which states no time stepping scheme


def test_pytest_runs_the_twin(site: Path, tmp_path: Path) -> None:
    file = write_sidecar(tmp_path, "twin", "wrong")
    found = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:xdist", "-p", "no:cacheprovider", "-q", file],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert "1 failed, 1 passed" in found.stdout
    assert "::wrong" in found.stdout
