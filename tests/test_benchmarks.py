"""Every benchmark and maker of pages runs to its end with ``--quick`` in another folder.

Modules that cannot be run are imported by others.  Some are started in a process of their own, as a
user starts them.  The others run in
this process, which has already loaded the modules that they need.
"""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FILES = {
    file.stem: file
    for folder in ("benchmarks", "docs/make")
    for file in sorted((ROOT / folder).glob("*.py"))
    if file.stem != "__init__"
}
SOURCES = {name: file.read_text(encoding="utf-8") for name, file in FILES.items()}


def document_times():
    """The files of docs/ and their times of modification."""
    return {file.name: file.stat().st_mtime_ns for file in (ROOT / "docs").glob("*.*")}


def module_name(name):
    """The name by which Python runs a file."""
    return ".".join(FILES[name].relative_to(ROOT).with_suffix("").parts)


SLOW_BENCHMARKS = (
    "accuracy",
    "balancer_fronts",
    "choose",
    "choose_waits",
    "coverage",
    "design_balancer",
    "diagnosis",
    "diet",
    "floors",
    "kinematics",
    "model_pages",
    "pictures",
    "proposals",
    "rod_settling",
    "threads",
    "rod_solutions",
    "stress",
)
"""Benchmarks that take many seconds even with ``--quick``."""
BENCHMARKS_IN_PROCESSES = ("files_passed", "limits", "newton_raphson", "notebooks")
"""Benchmarks that run in processes of their own: they trace calls, set limits, or are short."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow) if name in SLOW_BENCHMARKS else name
        for name in SOURCES
    ],
)
def test_benchmark_runs_quickly_and_writes_no_documents(name, tmp_path, monkeypatch):
    if 'if __name__ == "__main__":' not in SOURCES[name]:  # a module that benchmarks import
        others = [text for other, text in SOURCES.items() if other != name]
        assert any(
            name in line.replace(",", " ").replace(".", " ").split()
            for text in others
            for line in text.splitlines()
            if "import" in line
        ), f"nothing imports {name}"
        return
    before = document_times()
    if name in BENCHMARKS_IN_PROCESSES:
        done = subprocess.run(
            [sys.executable, "-m", module_name(name), "--quick"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 0, done.stderr
    else:
        file = FILES[name]
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [str(file), "--quick"])
        runpy.run_path(str(file), run_name="__main__")
    assert document_times() == before
    assert {file.name for file in tmp_path.iterdir()} <= {"MUJOCO_LOG.TXT"}  # of MuJoCo
