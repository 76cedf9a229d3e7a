"""The files of contrib/ in a repository of somebody else."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

ROOT = Path(__file__).parent.parent
SCRIPTS = Path(sys.executable).parent  # where the commands proofmass and pre-commit are
SHORT_RUN = (
    (r"until = 10\.0 .*", "until = 0.1"),
    ("n = 1001", "n = 11"),
    (r"solvers = .*", 'solvers = ["mujoco"]'),
    (r'(?s)\[\[tolerance\]\]\nsolver = "pymunk".*', ""),
)
WRONG = ("length = 1.0", "length = 1.01")
OF_OTHERS = {
    "README.md": "# robots\n",
    "pyproject.toml": "[project]\nname = 'robots'\n",
    "models/notes.toml": "[docs]\nreference = 'manual'\n",
    "models/common.xml": "<mujocoinclude/>\n",
}

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")


@pytest.fixture
def repository(tmp_path) -> Path:
    """A git repository with a short pendulum, and with files that proofmass does not know."""
    folder = tmp_path / "robots"
    (folder / "models").mkdir(parents=True)
    for name, text in OF_OTHERS.items():
        (folder / name).write_text(text)
    shutil.copy(ROOT / "models" / "linkages" / "pendulum.xml", folder / "models")
    shutil.copy(ROOT / "models" / "linkages" / "pendulum.toml", folder / "models")
    for pattern, text in SHORT_RUN:
        change(folder, pattern, text)
    run(folder, "git", "init", "-q")
    run(folder, "git", "add", ".")
    return folder


def change(folder: Path, pattern: str, text: str) -> None:
    """Replace a part of the sidecar of the pendulum."""
    file = folder / "models" / "pendulum.toml"
    changed, found = re.subn(pattern, text, file.read_text(encoding="utf-8"), count=1)
    assert found == 1, pattern
    file.write_text(changed, encoding="utf-8")


def run(folder: Path, *words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a program in a folder, with the commands of this environment on its path."""
    path = f"{variables.pop('first', SCRIPTS)}{os.pathsep}{SCRIPTS}{os.pathsep}{os.environ['PATH']}"
    home = {"HOME": str(folder.parent), "PRE_COMMIT_HOME": str(folder.parent / "pre-commit")}
    return subprocess.run(
        words,
        cwd=folder,
        env={**os.environ, **home, "PATH": path, **variables},
        capture_output=True,
        text=True,
        check=False,
    )


def test_pre_commit_checks_the_changed_cases(repository):
    shutil.copy(ROOT / "contrib" / "pre-commit-config.yaml", repository / ".pre-commit-config.yaml")
    run(repository, "git", "add", ".")
    good = run(repository, "pre-commit", "run")
    assert good.returncode == 0, good.stdout + good.stderr
    assert "Passed" in good.stdout
    change(repository, *WRONG)
    run(repository, "git", "add", ".")
    bad = run(repository, "pre-commit", "run")
    assert bad.returncode == 1
    assert "differs" in bad.stdout


def test_pre_commit_passes_where_others_alone_were_changed(repository):
    shutil.copy(ROOT / "contrib" / "pre-commit-config.yaml", repository / ".pre-commit-config.yaml")
    run(repository, "git", "reset", "-q")
    run(repository, "git", "add", "models/common.xml", "models/notes.toml")
    only = run(repository, "pre-commit", "run", "--verbose")
    assert only.returncode == 0, only.stdout + only.stderr
    assert "left alone, neither a sidecar nor a model" in only.stdout
    assert "common.xml" in only.stdout
    assert "pendulum" not in only.stdout


def test_the_action_writes_what_its_readers_upload(repository, tmp_path):
    """Its steps run in bash with the inputs' defaults; pip is a script that notes its arguments."""
    pip = tmp_path / "bin" / "pip"
    pip.parent.mkdir()
    pip.write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/installed\n')
    pip.chmod(0o755)
    change(repository, *WRONG)
    gh = pip.with_name("gh")
    gh.write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/commented\nexit 1\n')  # as in a fork
    gh.chmod(0o755)
    action = yaml.safe_load((ROOT / "contrib" / "github" / "action.yml").read_text())
    inputs = {f"inputs.{name}": str(one["default"]) for name, one in action["inputs"].items()}
    inputs |= {"github.event.pull_request.number": "7", "github.token": "none"}
    summary = tmp_path / "summary.md"
    codes = []
    for step in (one for one in action["runs"]["steps"] if "run" in one):
        variables = {
            name: re.sub(r"\$\{\{ ([\w.-]+) \}\}", lambda m: inputs[m[1]], text)
            for name, text in step["env"].items()
        } | {"GITHUB_STEP_SUMMARY": str(summary)}
        done = run(repository, "bash", "-ec", step["run"], first=str(pip.parent), **variables)
        codes.append(done.returncode)
    assert codes == [0, 1]
    assert (tmp_path / "commented").read_text().split()[:3] == ["pr", "comment", "7"]
    assert "❌ **pendulum** differs" in summary.read_text(encoding="utf-8")
    assert summary.read_text() == (repository / "proofmass.md").read_text()
    assert (tmp_path / "installed").read_text() == "install proofmass\n"
    (results,) = json.loads((repository / "proofmass.sarif").read_text())["runs"]
    places = {
        place["physicalLocation"]["artifactLocation"]["uri"]
        for result in results["results"]
        for place in result["locations"]
    }
    assert places
    assert all((repository / place).is_file() for place in places), "an address in the repository"
    tests = ElementTree.parse(repository / "proofmass-junit.xml").getroot()
    assert int(tests.get("failures", 0)) > 0
    assert tests.get("errors") == "0", "files of others are no errors"


def test_workflow_of_versions_fails_if_something_changed(repository):
    """Its step writes the summary and has the exit code of the comparison."""
    workflow = yaml.safe_load((ROOT / "contrib/github/versions.yml").read_text(encoding="utf-8"))
    (script,) = (
        step["run"]
        for step in workflow["jobs"]["versions"]["steps"]
        if "proofmass versions" in step.get("run", "")
    )
    fake = repository / "bin"
    fake.mkdir()
    (fake / "proofmass").write_text('#!/bin/sh\necho "$@"\necho changed in 3.7.0\nexit 1\n')
    (fake / "proofmass").chmod(0o755)
    summary = repository / "summary.md"
    made = run(
        repository,
        "bash",
        "-e",
        "-c",
        script,
        first=str(fake),
        PATHS="models",
        USED="3.6.0",
        GITHUB_STEP_SUMMARY=str(summary),
    )
    assert made.returncode == 1
    text = summary.read_text(encoding="utf-8")
    assert "versions models --engine mujoco==3.6.0 --all -o versions" in text
    assert "changed in 3.7.0" in text
