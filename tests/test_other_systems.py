"""A report on a system that lacks what Windows lacks, and whose texts are not UTF-8 by default.

This imitates some differences of Windows on another system: modules and functions of POSIX that it
does not have, and an encoding of files, ASCII, that has even fewer letters than its own.  Paths
with a drive letter, the line ends that it writes, and how its processes end are not imitated.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from proofmass.base.files import read_text
from tests.shipped import shipped

WITHOUT_POSIX = """
import os, signal, sys, warnings

for name in ("fcntl", "grp", "pwd", "resource"):
    sys.modules[name] = None  # an import of it fails
for module, names in (
    (os, "fork forkpty getloadavg geteuid getuid setsid O_CLOEXEC O_NOFOLLOW"),
    (signal, "ITIMER_PROF ITIMER_REAL SIGALRM SIGPROF alarm setitimer"),
):
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
warnings.filterwarnings("error", category=EncodingWarning, module="proofmass")
"""
ASCII_LOCALE = {
    "PYTHONUTF8": "0",
    "PYTHONCOERCECLOCALE": "0",
    "PYTHONWARNDEFAULTENCODING": "1",
    "PYTHONIOENCODING": "utf-8",
    "LC_ALL": "C",
}
"""Environment in which texts are ASCII unless a program says otherwise, and an encoding that is
left to the system is an error."""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """The environment of a process without the POSIX modules; it has no home either."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text(WITHOUT_POSIX)
    own = {name: value for name, value in os.environ.items() if name != "HOME"}
    return own | ASCII_LOCALE | {"PYTHONPATH": str(tmp_path / "site")}


def run_python(environment: dict[str, str], folder: Path, *words: object):
    return subprocess.run(
        [sys.executable, *map(str, words)],
        env=environment,
        cwd=folder,
        capture_output=True,
        encoding="utf-8",
        check=False,
    )


def test_the_system_is_as_the_test_says(environment: dict[str, str], tmp_path: Path):
    script = (
        "import locale, os\n"
        "assert not hasattr(os, 'fork')\n"
        "assert locale.getpreferredencoding(False) in ('ANSI_X3.4-1968', 'US-ASCII'), 'no ASCII'\n"
        "import fcntl"
    )
    assert "import of fcntl halted" in run_python(environment, tmp_path, "-c", script).stderr


def test_a_report_needs_no_posix_module_and_no_utf_8_locale(
    environment: dict[str, str], tmp_path: Path
):
    """The letters of a title reach the pages, and line ends of Windows are read."""
    text = read_text(shipped("pendulum.toml")).rpartition("[[tolerance]]")[0]
    text = text.replace("until = 10.0 ", "until = 0.1 ").replace("n = 1001", "n = 11")
    text = re.sub(r"solvers = .*", 'solvers = ["mujoco"]', text)
    text = re.sub(r"title = .*", 'title = "振り子, Größe ½"', text)
    (tmp_path / "pendulum.toml").write_bytes(text.replace("\n", "\r\n").encode())
    model = read_text(shipped("pendulum.toml").with_suffix(".xml"))
    (tmp_path / "pendulum.xml").write_bytes(model.replace("\n", "\r\n").encode())
    command = ["-m", "proofmass", "report", "pendulum.toml", "-o", "pages", "--data"]
    done = run_python(environment, tmp_path, *command)
    assert (done.returncode, "Traceback" in done.stderr) == (0, False), done.stderr
    assert "agrees" in done.stdout
    for page in ("index.html", "pendulum.html"):
        assert "振り子, Größe ½" in (tmp_path / "pages" / page).read_text(encoding="utf-8")
    assert b"\r" not in (tmp_path / "pages" / "data" / "pendulum-dynamics.csv").read_bytes()
