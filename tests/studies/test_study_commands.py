"""Commands of studies give the same tables if killed, interrupted, or run on a cluster."""

import contextlib
import csv
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from contextlib import ExitStack
from itertools import count
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from proofmass.cli import app
from proofmass.command import exit_on_error
from proofmass.errors import InputError
from proofmass.sim.mjcf import read_tree
from proofmass.studies import run as runs
from proofmass.studies.measure import Measurement
from proofmass.studies.store import Store
from tests.studies.study_tasks import own_locks  # noqa: F401, a fixture of all tests

ROOT = Path(__file__).parents[2]
FAT = """<mujoco>
  <option timestep="2e-3"/>
  <worldbody>
    <light pos="0 0 3"/>
    <body>
      <joint name="pivot" axis="0 1 0"/>
      <geom size="0.05" pos="0 0 -1"/>
      <geom name="painted" size="0.02" mass="0" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <sensor><jointpos name="angle" joint="pivot"/></sensor>
  <keyframe><key name="start" qpos="1.5"/></keyframe>
</mujoco>"""
ASKED = {
    "trade": "trade case.toml",
    "stress": "stress --only kv",
    "diet": "diet fat.xml --seconds 0.1",
    "choose": "choose case.toml --error 1e-5",
}
KILLED = "trade", "stress", "diet"
TABLES = {
    "trade": ("trade.csv", "floors.csv", "verdicts.json"),
    "stress": ("stress.csv",),
    "diet": ("fat.csv", "fat.xml"),
}
FOLDERS = {"choose": "trade"}  # folder of the runs, where it is not named like the command
KEPT = {
    "trade": "trade keeps the runs",
    "choose": "trade keeps the runs",
    "stress": "stress keeps the runs",
    "diet": "what was tried is kept",
}
COSTS = re.compile(r"about \S+ s a run")
"""The predicted wall time of finer steps in verdicts: a multiple of a measured wall time."""
MEASURED = "seconds", "repeats", "shared", "bytes"
"""Beginnings of the names of columns that differ from run to run: wall times, and the bytes that
an arena uses, which depend on its alignment."""
ALIVE = 10.0  # s, within which the workers of a killed study end: the longest run takes 2 s
ANSWERED = 60.0
"""Time in which an interrupted command must end [s].  It takes 0.4 s on a free processor, and 15 s
if ten processes share the processor."""

# Python code that is put before a command.  It makes the command write files in place and slowly,
# makes runs impossible so that only kept ones can be used, gives each series more time, or makes
# the store forget its runs.
IN_PLACE = """
import os, time
def replace(half, file):
    data = open(half, "rb").read()
    with open(file, "wb") as stream:
        stream.write(data[:len(data) // 2])
        stream.flush()
        time.sleep(0.1)
        stream.write(data[len(data) // 2:])
os.replace = replace
"""
NO_RUNS = {
    "trade": "from proofmass.studies import run; assert run.measure_task; run.measure_task = None",
    "stress": """
from proofmass.studies.stress import problems
assert problems.measure
problems.measure = None
""",
    "diet": """
from proofmass.studies.diet.diet import DietSearch
ran = DietSearch.judge_changes
DietSearch.judge_changes = lambda self, *what: None if self.store.folder else ran(self, *what)
""",
}  # a diet also tries the model that it has written, without a store: that trial is skipped
UNHURRIED = {
    "trade": """
from importlib import import_module
options = import_module("proofmass.studies.trade.trade").trade.__kwdefaults__
assert options["budget"]
options["budget"] = 60.0
""",
}
"""By default a series ends at a run of more than 0.5 s, which depends on the load of the machine.
In these tests it ends at a run of more than 60 s."""
FORGETS = (
    "from proofmass.studies.store import Store; assert Store.load; Store.load = lambda *_: None"
)


@pytest.fixture
def place(tmp_path: Path, models: Path, edit: Callable) -> Callable[[str], Path]:
    """A function that makes a folder with a short case, and a model without a sidecar."""
    edit("pendulum.toml", "until = 10.0 ", "until = 0.5 ")
    edit("pendulum.toml", "n = 1001", "n = 51")

    def make(name: str) -> Path:
        (folder := tmp_path / name).mkdir()
        for kind in ("toml", "xml"):
            (folder / f"case.{kind}").write_bytes((models / f"pendulum.{kind}").read_bytes())
        (folder / "fat.xml").write_text(FAT)
        return folder

    return make


def begin(what: str, folder: Path, before: str = "", more: str = "") -> subprocess.Popen:
    """Start a command as the shell does, in a process group of its own."""
    code = f"{UNHURRIED.get(what, '')}{before}\nfrom proofmass.__main__ import main; main()"
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, "-c", code, *ASKED[what].split(), *more.split()],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, "COLUMNS": "200"},
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(what: str, folder: Path, before: str = "", more: str = "") -> None:
    """Run a command to its end; fail if it reports an error."""
    command = begin(what, folder, before, more)
    said = command.communicate()[1]
    assert command.returncode == 0, said


def kept(what: str, folder: Path) -> dict[str, int]:
    """Names of the records that a study has kept so far, and when they were written [ns].

    Curves are written before their record; curves without a record belong to a run that will be
    made again.
    """
    there = folder / FOLDERS.get(what, what) / "runs"
    return {file.name: file.stat().st_mtime_ns for file in there.glob("*.json")}


def wholes(what: str, folder: Path) -> None:
    """Read all files that a study has kept; an incomplete file raises an exception."""
    for file in (folder / what / "runs").glob("*"):
        if file.suffix == ".json":
            json.loads(file.read_text(encoding="utf-8"))
        elif file.suffix == ".npz":
            with np.load(file) as arrays:
                dict(arrays)


def told(what: str, folder: Path) -> list:
    """The tables of a study, without the values that differ from run to run."""
    found = list[object]()
    for name in TABLES[what]:
        text = (folder / what / name).read_text(encoding="utf-8")
        found.append(
            COSTS.sub("", text)
            if not name.endswith(".csv")
            else [
                {k: v for k, v in row.items() if not k.startswith(MEASURED)}
                for row in csv.DictReader(text.splitlines())
            ]
        )
    return found


def ended(group: int, within: float) -> bool:
    """Whether all processes of a group have ended within a time [s]."""
    late = time.monotonic() + within
    while time.monotonic() < late:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


def undisturbed(what: str, folder: Path) -> float:
    """Wall time of an undisturbed study [s]."""
    start = time.monotonic()
    finish(what, folder)
    return time.monotonic() - start


def killed(
    what: str,
    folder: Path,
    moment: float,
    alone: bool,
    before: str = "",
    how: signal.Signals = signal.SIGKILL,
) -> bool:
    """Start a study and kill it after `moment` seconds; return whether it was still running.

    The study is killed `alone`, or together with its workers.  Workers must end, all kept files
    must be complete, and the runs that were kept before must not be made again.
    """
    there, study = kept(what, folder), begin(what, folder, before)
    with contextlib.suppress(subprocess.TimeoutExpired):
        study.wait(moment)
    if late := study.poll() is not None:
        assert study.returncode == 0, study.communicate()[1]
    else:
        (os.kill if alone else os.killpg)(study.pid, how)
    try:
        study.communicate(timeout=ANSWERED)
    except subprocess.TimeoutExpired:
        os.killpg(study.pid, signal.SIGKILL)
        study.communicate()
        raise
    assert ended(study.pid, ALIVE), "workers did not end with their study"
    wholes(what, folder)
    assert kept(what, folder).items() >= there.items(), "a kept run was made again"
    return not late


def same_after(
    what: str,
    kills: int,
    place: Callable[[str], Path],
    before: str = "",
    how: signal.Signals = signal.SIGKILL,
) -> None:
    """Assert that a study that is killed repeatedly gives the tables of an undisturbed study.

    The moments are spread over the duration of an undisturbed study.  If a study ends before its
    moment, its tables are compared at once, and a new study is started in another folder.  At the
    end the study is run once more with a code that makes runs impossible: all must be kept.
    """
    whole, dice, fresh = place("whole"), random.Random(6), (place(f"torn {k}") for k in count())
    length = undisturbed(what, whole)
    moments = [(k + dice.random()) / kills * length for k in range(kills)]
    dice.shuffle(moments)
    broken = next(fresh)
    for number, moment in enumerate(moments):
        while not killed(what, broken, moment, bool(number % 2), before, how):
            assert told(what, broken) == told(what, whole)
            broken, moment = next(fresh), 0.9 * moment
    finish(what, broken)
    assert told(what, broken) == told(what, whole)
    finish(what, broken, NO_RUNS[what])
    assert told(what, broken) == told(what, whole)


@pytest.mark.slow
@pytest.mark.parametrize("what", KILLED)
def test_a_study_killed_ten_times_gives_the_same_table(what, place):
    same_after(what, 10, place)


@pytest.mark.slow
@pytest.mark.parametrize("what", KILLED)
def test_a_study_interrupted_ten_times_gives_the_same_table(what, place):
    """In particular, a worker that the interrupt ends is not recorded as an engine that crashed."""
    same_after(what, 10, place, how=signal.SIGINT)


@pytest.mark.slow
def test_files_written_in_place_would_be_found_out(place):
    with pytest.raises(json.JSONDecodeError):
        same_after("stress", 10, place, IN_PLACE)


@pytest.mark.slow
def test_a_store_that_forgets_would_be_found_out(place):
    with pytest.raises(AssertionError, match="made again"):
        same_after("trade", 10, place, FORGETS)


@pytest.mark.slow
@pytest.mark.parametrize("what", KILLED)
def test_a_cluster_gives_the_table_that_this_machine_gives(what, place, address):
    near, far = place("near"), place("far")
    finish(what, near)
    finish(what, far, more=f"--dask {address}")
    assert told(what, far) == told(what, near)


def test_what_code_before_a_command_replaces_is_there():
    code = "\n".join([*NO_RUNS.values(), *UNHURRIED.values(), FORGETS])
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def errors(folder: Path) -> dict[str, dict]:
    """Errors of the runs that a folder keeps, by file name.

    Runs that timed out, as happens on a busy machine, are left out; other failures are not allowed.
    """
    files = (folder / "trade" / "runs").glob("*.0.json")
    found = {file.name: json.loads(file.read_text())["found"] for file in files}
    failed = [one for one in found.values() if one["outcome"] not in ("ran", "timed out")]
    assert not failed
    return {name: one["errors"] for name, one in found.items() if one["outcome"] == "ran"}


@pytest.mark.slow
def test_choose_measures_on_a_cluster_what_it_measures_here(place, address):
    """The choice of settings depends on wall times; the errors of common settings do not."""
    near, far = place("near"), place("far")
    finish("choose", far, more=f"--dask {address}")
    finish("choose", far, NO_RUNS["trade"])
    finish("choose", near)
    ours, theirs = errors(near), errors(far)
    common = ours.keys() & theirs.keys()
    assert len(common) > 3
    assert {key: ours[key] for key in common} == {key: theirs[key] for key in common}


@pytest.mark.parametrize("what", ASKED)
def test_a_cluster_that_is_not_there_is_one_line(what, place, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.chdir(place("here"))
    monkeypatch.setattr(runs, "CONNECT_TIMEOUT", "100ms")
    answer = CliRunner().invoke(app, [*ASKED[what].split(), "--dask", "tcp://127.0.0.1:9"])
    assert answer.exit_code == 2
    assert "--dask tcp://127.0.0.1:9: no scheduler answers there" in answer.stderr
    assert answer.stderr.count("\n") == 1
    assert not answer.stdout


def test_a_file_that_something_else_cut_short_is_bad_input(tmp_path):
    Store(tmp_path).file("key", 0).write_text('{"found": {"err')
    with pytest.raises(InputError, match=r"key\.0\.json: not what a study wrote there; delete it"):
        Store(tmp_path).load("key", 0)


@pytest.mark.parametrize(
    "what",
    [
        "trade",
        *(pytest.param(other, marks=pytest.mark.slow) for other in ("stress", "diet", "choose")),
    ],
)
def test_an_interrupt_is_one_line_that_says_what_is_kept(what, place):
    study = begin(what, folder := place("here"))
    while study.poll() is None and not kept(what, folder):
        time.sleep(0.01)
    os.killpg(study.pid, signal.SIGINT)  # as a terminal does
    shown, said = study.communicate(timeout=ANSWERED)
    assert said.strip() == f"stopped; {KEPT[what]}; to go on, give the same command again"
    assert study.returncode == 130
    assert not shown
    assert ended(study.pid, ALIVE)


def test_an_interrupt_while_curves_are_packed_is_one_too(tmp_path, monkeypatch, capsys):
    begun, held = zipfile.ZipFile.open, ExitStack()

    def interrupt(packed, *args, **options):
        held.push(packed)
        held.push(begun(packed, *args, **options))
        raise KeyboardInterrupt

    monkeypatch.setattr(zipfile.ZipFile, "open", interrupt)  # closing it raises ValueError
    found = Measurement(curves={"x": np.zeros(3)})
    with held, pytest.raises(typer.Exit) as ended, exit_on_error("runs are kept"):
        Store(tmp_path).save("key", 0, None, found, 1.0)
    assert ended.value.exit_code == 130
    assert capsys.readouterr().err.startswith("stopped; runs are kept")


def test_a_model_that_cannot_be_changed_is_bad_input(tmp_path, capsys):
    """The file has a byte between two elements that XML does not allow and MuJoCo ignores."""
    file = tmp_path / "fat.xml"
    file.write_bytes(FAT.replace("<worldbody>", "°<worldbody>").encode("latin-1"))
    with pytest.raises(typer.Exit) as ended, exit_on_error("runs are kept"):
        read_tree(file)
    assert ended.value.exit_code == 2
    assert capsys.readouterr().err.startswith("error: fat.xml: to be changed it must be")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("trade case.toml --error rate", "'rate' is called 'velocity' now"),
        ("choose case.toml --error 1e-5 --of effort", "'effort' is called 'force' now"),
        ("choose case.toml --error 1e-5 --of speed", "position, velocity, acceleration, force"),
    ],
)
def test_a_kind_of_error_that_there_is_not_is_named(asked, words):
    """The command does not run; for a former name the message states the present one."""
    found = CliRunner().invoke(app, asked.split())
    assert found.exit_code == 2
    assert words in " ".join(found.output.replace("│", " ").split())
