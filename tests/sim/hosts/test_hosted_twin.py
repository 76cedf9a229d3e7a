"""An engine that another distribution brings as a script: in check, engines and versions."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass.batch.check import check
from proofmass.commands.cli import app
from proofmass.report.page import read_versions
from proofmass.sim.engines import HOSTED_GROUP
from tests.distributions import on_path, write_distribution
from tests.shipped import shipped

SCRIPT = Path(__file__).parent / "pendulum_host.py"
MODULE = f"""
import sys

from proofmass.sim.hosts.engine import About, HostedEngine, SteppedSettings


class SwingSettings(SteppedSettings):
    fails: str = ""


SWING = HostedEngine(
    {str(SCRIPT)!r},
    ("numpy=={np.__version__}",),
    title="Swing",
    about=About("one hinge, semi-implicit Euler", "MIT"),
    settings=SwingSettings,
    lacks=("ball joint", "free joint"),
    python={sys.executable!r},
)
"""


@pytest.fixture(scope="module", autouse=True)
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The distribution on the path of this process and of new workers."""
    folder = tmp_path_factory.mktemp("site")
    files = {"swing_engine.py": MODULE}
    write_distribution(folder, "swing_engine", files, HOSTED_GROUP, swing="SWING")
    with on_path(folder):
        yield


def test_check_measures_it_and_records_versions() -> None:
    """Its curves are compared, no tolerance judges them, and what computed is recorded."""
    result = check([shipped("pendulum.toml")], engines=("swing", "mujoco"), causes=False)
    assert not result.errors
    assert {c.outcome for c in result.comparisons if c.solver == "swing"} == {"measured"}
    assert {c.outcome for c in result.comparisons if c.solver == "mujoco"} == {"agrees"}
    assert all(c.relative_to_range < 1e-4 for c in result.comparisons)
    assert result.versions == {"swing": {"swing": "1.0"}}
    assert result.exit_code == 0


def test_what_it_refuses_is_unsupported() -> None:
    """By its script, and by what it says that it lacks: a case in space."""
    cases = [shipped("fourbar_released.toml"), shipped("euler_top.toml")]
    result = check(cases, engines=("swing",), causes=False)
    said = {c.case: c.message for c in result.comparisons}
    assert said["fourbar_released"] == "more than one joint"
    assert "free joint" in said["euler_top"]
    assert {c.outcome for c in result.comparisons} == {"unsupported"}
    assert not result.errors


def test_a_sidecar_may_name_it(tmp_path: Path) -> None:
    """With settings of its own; a setting that makes it die costs its run alone."""
    text = shipped("pendulum.toml").read_text(encoding="utf-8")
    model = shipped("pendulum.xml").read_text(encoding="utf-8")
    head, _, rest = text.partition("solvers =")
    _, _, tail = rest.partition("\n")
    file = tmp_path / "pendulum.toml"
    file.with_suffix(".xml").write_text(model)
    named = f'{head}solvers = ["mujoco", "pymunk", "swing"]\n{tail}'
    file.write_text(f'{named}\n[settings.swing]\nfails = "dies"\n')
    result = check([file], causes=False)
    assert not result.errors
    found = {c.solver: c for c in result.comparisons}
    assert found["mujoco"].outcome == "agrees"
    assert found["swing"].outcome == "crashed"
    assert "SIGABRT" in found["swing"].message
    file.write_text(file.read_text().replace('"dies"', "3"))
    (error,) = check([file], causes=False).errors
    assert error.key == "settings.swing.fails"


def test_commands_list_and_run_it(tmp_path: Path) -> None:
    """The list of engines has it, the versions of pages, and a table of cases beside engines."""
    assert ("swing_engine", "1.0") in read_versions()
    shown = json.loads(CliRunner().invoke(app, ["engines", "--json"]).stdout)
    (entry,) = (one for one in shown if one["name"] == "swing")
    assert entry["version"] == np.__version__
    assert entry["lacks"] == "ball joint, free joint"
    words = ["engines", str(shipped("pendulum.toml")), "--engine", "swing", "-o", str(tmp_path)]
    made = CliRunner().invoke(app, words)
    assert made.exit_code == 0, made.output
    assert "Swing" in made.stdout
    assert "1 of 1" in made.stdout


def test_version_that_its_interpreter_has_not_is_unavailable(tmp_path: Path) -> None:
    """A name is no version: the comparison says that one of both cannot be had."""
    pins = ["--engine", f"swing=={np.__version__}", "--engine", "swing==1.1"]
    words = ["versions", str(shipped("pendulum.toml")), *pins, "-o", str(tmp_path)]
    made = CliRunner().invoke(app, words)
    assert made.exit_code == 1, made.output
    assert "unavailable" in made.stdout
    assert f"1 case of 1 changed between Swing {np.__version__} and 1.1" in made.stdout
