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

from proofmass.base.errors import InputError
from proofmass.commands.cli import app
from proofmass.commands.command import exit_on_error
from proofmass.sim.mjcf import read_tree
from proofmass.studies.measure import Measurement
from proofmass.studies.store import Store
from tests.studies.study_tasks import own_locks  # noqa: F401, a fixture of all tests

ROOT = Path(__file__).parents[2]
UNREDUCED_MODEL = """<mujoco>
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
COMMAND_ARGUMENTS = {
    "trade": "trade case.toml",
    "stress": "stress --only kv",
    "diet": "diet fat.xml --seconds 0.1",
    "choose": "choose case.toml --error 1e-5",
}
KILLED_COMMANDS = "trade", "stress", "diet"
TABLES = {
    "trade": ("trade.csv", "floors.csv", "verdicts.json"),
    "stress": ("stress.csv",),
    "diet": ("fat.csv", "fat.xml"),
}
RUN_FOLDERS = {"choose": "trade"}  # folder of the runs, where it is not named like the command
KEPT_MESSAGES = {
    "trade": "trade keeps the runs",
    "choose": "trade keeps the runs",
    "stress": "stress keeps the runs",
    "diet": "what was tried is kept",
}
PREDICTED_TIME = re.compile(r"about \S+ s a run")
"""The predicted processor time of finer steps in verdicts: a multiple of a measured processor
time."""
VARYING_COLUMNS = "seconds", "repeats", "shared", "bytes"
"""Beginnings of the names of columns that differ from run to run: processor times, and the bytes
that an arena uses, which depend on its alignment."""
WORKER_END_SECONDS = (
    10.0  # s, within which the workers of a killed study end: the longest run takes 2 s
)
INTERRUPT_SECONDS = 60.0
"""Time in which an interrupted command must end [s].  It takes 0.4 s on a free processor, and 15 s
if ten processes share the processor."""

# Python code that is put before a command.  It makes the command write files in place and slowly,
# makes runs impossible so that only kept ones can be used, gives each series more time, or makes
# the store forget its runs.
WRITE_IN_PLACE = """
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
FORBID_RUNS = {
    "trade": """
from proofmass.studies import study
assert study.measure_task
study.measure_task = None
""",
    "stress": """
from proofmass.studies.stress import problems
assert problems.measure
problems.measure = None
""",
    "diet": """
from proofmass.studies.diet.diet import DietSearch
ran = DietSearch.judge_changes
DietSearch.judge_changes = lambda self, *what: None if self.study.workers else ran(self, *what)
""",
}  # a diet also tries the model that it has written, without workers: that trial is made
LONG_RUNS = {
    "trade": """
from importlib import import_module
options = import_module("proofmass.studies.trade.trade").trade.__kwdefaults__
assert options["budget"]
options["budget"] = 60.0
""",
}
"""By default a series ends at a run of more than 0.5 s, which depends on the load of the machine.
In these tests it ends at a run of more than 60 s."""
FORGET_RUNS = (
    "from proofmass.studies.store import Store; assert Store.load; Store.load = lambda *_: None"
)


@pytest.fixture
def make_folder(tmp_path: Path, models: Path, edit: Callable) -> Callable[[str], Path]:
    """A function that makes a folder with a short case, and a model without a sidecar."""
    edit("pendulum.toml", "until = 10.0 ", "until = 0.5 ")
    edit("pendulum.toml", "n = 1001", "n = 51")

    def make(name: str) -> Path:
        (folder := tmp_path / name).mkdir()
        for kind in ("toml", "xml"):
            (folder / f"case.{kind}").write_bytes((models / f"pendulum.{kind}").read_bytes())
        (folder / "fat.xml").write_text(UNREDUCED_MODEL)
        return folder

    return make


def start_command(
    command_name: str, folder: Path, before: str = "", more: str = ""
) -> subprocess.Popen:
    """Start a command as the shell does, in a process group of its own."""
    code = f"{LONG_RUNS.get(command_name, '')}{before}\nfrom proofmass.__main__ import main; main()"
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, "-c", code, *COMMAND_ARGUMENTS[command_name].split(), *more.split()],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, "COLUMNS": "200"},
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def run_command(command_name: str, folder: Path, before: str = "", more: str = "") -> None:
    """Run a command to its end; fail if it reports an error."""
    command = start_command(command_name, folder, before, more)
    said = command.communicate()[1]
    assert command.returncode == 0, said


def kept_records(command_name: str, folder: Path) -> dict[str, int]:
    """Names of the records that a study has kept so far, and when they were written [ns].

    Curves are written before their record; curves without a record belong to a run that will be
    made again.
    """
    there = folder / RUN_FOLDERS.get(command_name, command_name) / "runs"
    return {file.name: file.stat().st_mtime_ns for file in there.glob("*.json")}


def read_kept_files(command_name: str, folder: Path) -> None:
    """Read all files that a study has kept; an incomplete file raises an exception."""
    for file in (folder / command_name / "runs").glob("*"):
        if file.suffix == ".json":
            json.loads(file.read_text(encoding="utf-8"))
        elif file.suffix == ".npz":
            with np.load(file) as arrays:
                dict(arrays)


def reproducible_tables(command_name: str, folder: Path) -> list:
    """The tables of a study, without the values that differ from run to run."""
    found = list[object]()
    for name in TABLES[command_name]:
        text = (folder / command_name / name).read_text(encoding="utf-8")
        found.append(
            PREDICTED_TIME.sub("", text)
            if not name.endswith(".csv")
            else [
                {k: v for k, v in row.items() if not k.startswith(VARYING_COLUMNS)}
                for row in csv.DictReader(text.splitlines())
            ]
        )
    return found


def group_has_ended(group: int, within: float) -> bool:
    """Whether all processes of a group have ended within a time [s]."""
    late = time.monotonic() + within
    while time.monotonic() < late:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


def time_undisturbed_run(command_name: str, folder: Path) -> float:
    """Processor time of an undisturbed study [s]."""
    start = time.monotonic()
    run_command(command_name, folder)
    return time.monotonic() - start


def kill_command(
    command_name: str,
    folder: Path,
    moment: float,
    alone: bool,
    before: str = "",
    signal_number: signal.Signals = signal.SIGKILL,
) -> bool:
    """Start a study and kill it after `moment` seconds; return whether it was still running.

    The study is killed `alone`, or together with its workers.  Workers must end, all kept files
    must be complete, and the runs that were kept before must not be made again.
    """
    there, study = kept_records(command_name, folder), start_command(command_name, folder, before)
    with contextlib.suppress(subprocess.TimeoutExpired):
        study.wait(moment)
    if late := study.poll() is not None:
        assert study.returncode == 0, study.communicate()[1]
    else:
        (os.kill if alone else os.killpg)(study.pid, signal_number)
    try:
        study.communicate(timeout=INTERRUPT_SECONDS)
    except subprocess.TimeoutExpired:
        os.killpg(study.pid, signal.SIGKILL)
        study.communicate()
        raise
    assert group_has_ended(study.pid, WORKER_END_SECONDS), "workers did not end with their study"
    read_kept_files(command_name, folder)
    assert kept_records(command_name, folder).items() >= there.items(), "a kept run was made again"
    return not late


def assert_same_tables_after_kills(
    command_name: str,
    kills: int,
    make_folder: Callable[[str], Path],
    before: str = "",
    signal_number: signal.Signals = signal.SIGKILL,
) -> None:
    """Assert that a study that is killed repeatedly gives the tables of an undisturbed study.

    The moments are spread over the duration of an undisturbed study.  If a study ends before its
    moment, its tables are compared at once, and a new study is started in another folder.  At the
    end the study is run once more with a code that makes runs impossible: all must be kept.
    """
    whole, dice, fresh = (
        make_folder("whole"),
        random.Random(6),
        (make_folder(f"torn {k}") for k in count()),
    )
    length = time_undisturbed_run(command_name, whole)
    moments = [(k + dice.random()) / kills * length for k in range(kills)]
    dice.shuffle(moments)
    broken = next(fresh)
    for number, moment in enumerate(moments):
        while not kill_command(
            command_name, broken, moment, bool(number % 2), before, signal_number
        ):
            assert reproducible_tables(command_name, broken) == reproducible_tables(
                command_name, whole
            )
            broken, moment = next(fresh), 0.9 * moment
    run_command(command_name, broken)
    assert reproducible_tables(command_name, broken) == reproducible_tables(command_name, whole)
    run_command(command_name, broken, FORBID_RUNS[command_name])
    assert reproducible_tables(command_name, broken) == reproducible_tables(command_name, whole)


@pytest.mark.slow
@pytest.mark.parametrize("what", KILLED_COMMANDS)
def test_a_study_killed_ten_times_gives_the_same_table(what, make_folder):
    assert_same_tables_after_kills(what, 10, make_folder)


@pytest.mark.slow
@pytest.mark.parametrize("what", KILLED_COMMANDS)
def test_a_study_interrupted_ten_times_gives_the_same_table(what, make_folder):
    """In particular, a worker that the interrupt ends is not recorded as an engine that crashed."""
    assert_same_tables_after_kills(what, 10, make_folder, signal_number=signal.SIGINT)


@pytest.mark.slow
def test_files_that_are_written_in_place_are_detected(make_folder):
    with pytest.raises(json.JSONDecodeError):
        assert_same_tables_after_kills("stress", 10, make_folder, WRITE_IN_PLACE)


@pytest.mark.slow
def test_a_store_that_forgets_its_runs_is_detected(make_folder):
    with pytest.raises(AssertionError, match="made again"):
        assert_same_tables_after_kills("trade", 10, make_folder, FORGET_RUNS)


@pytest.mark.slow
@pytest.mark.parametrize("what", KILLED_COMMANDS)
def test_a_cluster_gives_the_table_that_this_machine_gives(what, make_folder, address):
    near, far = make_folder("near"), make_folder("far")
    run_command(what, near)
    run_command(what, far, more=f"--dask {address}")
    assert reproducible_tables(what, far) == reproducible_tables(what, near)


def test_the_names_that_injected_code_replaces_exist():
    code = "\n".join([*FORBID_RUNS.values(), *LONG_RUNS.values(), FORGET_RUNS])
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def kept_errors(folder: Path) -> dict[str, dict]:
    """Errors of the runs that a folder keeps, by file name.

    Runs that timed out, as happens on a busy machine, are left out; other failures are not allowed.
    """
    files = (folder / "trade" / "runs").glob("*.0.json")
    found = {file.name: json.loads(file.read_text())["found"] for file in files}
    failed = [one for one in found.values() if one["outcome"] not in ("ran", "timed out")]
    assert not failed
    return {name: one["errors"] for name, one in found.items() if one["outcome"] == "ran"}


@pytest.mark.slow
def test_choose_finds_the_same_errors_on_a_cluster_as_on_this_machine(make_folder, address):
    """The choice of settings depends on processor times; the errors of common settings do not."""
    near, far = make_folder("near"), make_folder("far")
    run_command("choose", far, more=f"--dask {address}")
    run_command("choose", far, FORBID_RUNS["trade"])
    run_command("choose", near)
    ours, theirs = kept_errors(near), kept_errors(far)
    common = ours.keys() & theirs.keys()
    assert len(common) > 3
    assert {key: ours[key] for key in common} == {key: theirs[key] for key in common}


@pytest.mark.parametrize("what", COMMAND_ARGUMENTS)
def test_an_unreachable_cluster_is_reported_in_one_line(what, make_folder, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.chdir(make_folder("here"))
    monkeypatch.setattr("proofmass.batch.pool.CONNECT_TIMEOUT", "100ms")
    answer = CliRunner().invoke(
        app, [*COMMAND_ARGUMENTS[what].split(), "--dask", "tcp://127.0.0.1:9"]
    )
    assert answer.exit_code == 2
    assert "--dask tcp://127.0.0.1:9: no scheduler answers there" in answer.stderr
    assert answer.stderr.count("\n") == 1
    assert not answer.stdout


def test_a_truncated_record_is_bad_input(tmp_path):
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
def test_an_interrupt_prints_one_line_about_what_is_kept(what, make_folder):
    study = start_command(what, folder := make_folder("here"))
    while study.poll() is None and not kept_records(what, folder):
        time.sleep(0.01)
    os.killpg(study.pid, signal.SIGINT)  # as a terminal does
    shown, said = study.communicate(timeout=INTERRUPT_SECONDS)
    assert said.strip() == f"stopped; {KEPT_MESSAGES[what]}; to go on, give the same command again"
    assert study.returncode == 130
    assert not shown
    assert group_has_ended(study.pid, WORKER_END_SECONDS)


def test_an_interrupt_while_curves_are_written_is_reported(tmp_path, monkeypatch, capsys):
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


def test_a_model_that_is_not_valid_xml_is_bad_input(tmp_path, capsys):
    """The file has a byte between two elements that XML does not allow and MuJoCo ignores."""
    file = tmp_path / "fat.xml"
    file.write_bytes(UNREDUCED_MODEL.replace("<worldbody>", "°<worldbody>").encode("latin-1"))
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
def test_an_unknown_kind_of_error_is_refused_with_a_hint(asked, words):
    """The command does not run; for a former name the message states the present one."""
    found = CliRunner().invoke(app, asked.split())
    assert found.exit_code == 2
    assert words in " ".join(found.output.replace("│", " ").split())
