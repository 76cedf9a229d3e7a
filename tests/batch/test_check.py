"""`proofmass.check`: inputs that are found, calls of workers, outcomes, and errors.

Functions that would run in a worker process are called in this process.
"""

import json
import os
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut
from proofmass.batch import pool, work
from proofmass.batch.check import (
    LOADING_SECONDS,
    OUTCOME_OF_EXCEPTION,
    OWN_MODEL_TIMEOUT,
    Result,
    check,
    check_bare_model,
    collect_inputs,
    collect_outcomes,
    early_end_error,
    family_of,
    find_inputs,
    load_validated,
    read_isolated,
    run_solver,
    run_task,
    task_file,
    task_label,
    unique_names,
)
from proofmass.batch.work import OWN_MODEL_SECONDS, compare_and_share, run_and_compare
from proofmass.commands.cli import app
from proofmass.commands.studies import load_cases
from proofmass.reference.evaluate import evaluate
from proofmass.run import solve as solve_module
from proofmass.run import validate as validate_module
from proofmass.run.sidecar import load_case
from proofmass.sim.model_source import ModelSource
from proofmass.sim.mujoco import own_motion
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, Diverged, NotSolved, Unsupported
from proofmass.verdict.compare import compare
from proofmass.verdict.comparison import Comparison, Comparisons
from proofmass.verdict.outcome import FAILED_OUTCOMES
from proofmass.verdict.refinement import FinerRun, refined_errors
from tests.shipped import MODELS

CHECK_MODULE = sys.modules[check.__module__]  # `proofmass.check` is the function


class RecordedCalls(list):
    """A substitute for `call_isolated`: it calls a function in this process and records its limits.

    `fails` maps names of functions to errors that are raised instead of a call.
    """

    fails: dict[str, Exception]

    def __call__(self, function, *args, timeout, memory=None):
        self.append((function.__name__, timeout, memory))
        if error := self.fails.get(function.__name__):
            raise error
        return function(*args)


@pytest.fixture(autouse=True)
def workers(monkeypatch):
    found = RecordedCalls()
    found.fails = {}
    monkeypatch.setattr(CHECK_MODULE, "call_isolated", found)
    return found


@pytest.fixture
def briefly(monkeypatch):
    """Shorten the motion of models without a sidecar to a twentieth, for tests of their names."""
    monkeypatch.setattr(work, "OWN_MODEL_SECONDS", OWN_MODEL_SECONDS / 20)
    monkeypatch.setattr(work, "OWN_MODEL_SAMPLES", 6)


@pytest.fixture
def short(edit):
    """The sidecar of a pendulum that runs in MuJoCo for 0.1 s, with limits of time and memory."""
    edit("pendulum.toml", r"until = 10\.0 .*", "until = 0.1\ntimeout = 7.0\nmemory = 3.0")
    edit("pendulum.toml", "n = 1001", "n = 11")
    edit("pendulum.toml", r'(?s)\[\[tolerance\]\]\nsolver = "pymunk".*', "")
    return edit("pendulum.toml", r"solvers = .*", 'solvers = ["mujoco"]')


def key_and_message(call, *args):
    """The key and the message of the input error that a call raises."""
    with pytest.raises(InputError) as error:
        call(*args)
    return error.value.key, error.value.wrong


OF_OURS = {".toml": "reference = 'planar'\n", ".xml": "<mujoco/>"}
"""Beginnings of a sidecar and of a model."""
OF_OTHERS = {
    "pyproject.toml": "[project]\nname = 'x'\n",
    "empty.toml": "",
    "template.toml": "{{ name }}",
    "docs.toml": "[docs]\nreference = 'manual'\n",
    "pom.xml": "<?xml version='1.0'?><!-- <mujoco> --><project/>",
    "fragment.xml": "<mujocoinclude><option/></mujocoinclude>",
    "robot.xml": "<robot/>",
    "empty.xml": "",
}
FAULTY = {
    "typo.toml": "refrence = 'planar'\n",  # beside a model of its name
    "typo.xml": "<mujoco/>",
    "torn.toml": "reference = 'planar'\n[drive\n",
    "number.toml": "reference = 1\n",
    "torn.xml": "<mujoco><worldbody>",
}


def test_files_of_others_are_left_alone_in_folders_and_told(tmp_path):
    for name, text in {**OF_OTHERS, **FAULTY}.items():
        (tmp_path / name).write_text(text)
    result = check([tmp_path])
    assert {file.name for file in result.of_others} == OF_OTHERS.keys()
    faulty = FAULTY.keys() - {"typo.xml", "torn.xml"}  # their sidecars are at fault
    assert {error.file.name for error in result.errors} == faulty
    assert result.exit_code == 2
    (error,) = check([tmp_path / "pyproject.toml"]).errors  # an input in any case by its name
    assert error.file.name == "pyproject.toml"


def test_a_folder_of_others_alone_is_an_error(tmp_path):
    (tmp_path / "pyproject.toml").write_text(OF_OTHERS["pyproject.toml"])
    answer = CliRunner().invoke(app, ["check", str(tmp_path)])
    assert answer.exit_code == 2
    assert "no sidecar (.toml) and no model (.xml, .urdf) in this folder" in answer.output


def test_files_left_alone_are_told_in_one_line_and_in_json(short, tmp_path):
    folder = tmp_path / "repository"
    folder.mkdir()
    for file in (short, short.with_suffix(".xml")):
        shutil.copy(file, folder)
    for name in OF_OTHERS:
        (folder / name).write_text(OF_OTHERS[name])
    answer = CliRunner().invoke(app, ["check", str(folder), "--json"])
    assert answer.exit_code == 0
    assert "left alone, neither a sidecar nor a model: " in answer.stderr
    assert f" and {len(OF_OTHERS) - 3} more" in answer.stderr
    assert {Path(file).name for file in json.loads(answer.stdout)["of_others"]} == OF_OTHERS.keys()


def test_sidecars_and_models_are_found_below_a_path(models, tmp_path):
    (models / "pendulum.toml").unlink()
    empty = tmp_path / "empty"
    empty.mkdir()
    (models / "a.sdf").write_text("<sdf/>")
    (models / "notes.txt").write_text("")
    for name in ("alone.toml", "alone.xml"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).write_text(OF_OURS[Path(name).suffix])
        assert list(find_inputs([tmp_path / name])) == [tmp_path / name / name]
    names = [path.name for path in find_inputs([models])]
    toml = sorted(path.name for path in models.glob("*.toml"))
    assert names[: len(toml)] == toml
    models_alone = {path.stem for path in models.glob("*.xml")} - {Path(n).stem for n in toml}
    assert "pendulum" in models_alone
    assert {Path(name).stem for name in names[len(toml) :]} == models_alone
    pair = [models / "fourbar.toml", models / "pendulum.xml"]
    assert list(find_inputs(pair)) == pair
    assert list(find_inputs([models / "fourbar.xml"])) == pair[:1]
    for path, words in (
        (tmp_path / "no", "no such file or folder"),
        (empty, "no sidecar (.toml) and no model (.xml, .urdf) in this folder"),
        (
            models / "notes.txt",
            "neither a sidecar (.toml), a model (.xml, .urdf, .mjb) nor a folder",
        ),
    ):
        assert key_and_message(lambda p: list(find_inputs([p])), path) == ("", words)


def test_a_sidecar_is_validated_within_the_largest_limits_of_its_runs(short, workers, edit):
    edit(
        "pendulum.toml",
        r"\[channels\]",
        "[run.sweep]\nn = 3\nsolvers = ['mujoco']\ntimeout = 9.0\nmemory = 2.0\n[channels]",
    )
    edit(
        "pendulum.toml",
        r"\[run.dynamics\]",
        "[drive]\njoint = 'pendulum'\nto = 1.0\n[run.dynamics]",
    )
    workers.fails["validate_here"] = OSError()  # the runs will report it
    assert load_validated(short).name == "pendulum"
    assert workers == [("load_here", LOADING_SECONDS, None), ("validate_here", 9.0, 3.0)]
    workers.fails["validate_here"] = InputError(short, "channels", "bad")
    assert key_and_message(load_validated, short) == ("channels", "bad")
    for error, words in (
        (InputError(short, "key", "bad"), ("key", "bad")),
        (OSError("gone"), ("", "cannot be read: gone")),
        (OSError(), ("", "cannot be read: OSError")),
    ):
        workers.fails["load_here"] = error
        assert key_and_message(load_validated, short) == words


def test_strict_loading_reports_errors_that_runs_would_report(short, workers):
    """A command that makes no run has no other way to report these errors."""
    workers.fails["validate_here"] = MemoryError("more than 3 GiB")
    assert load_validated(short).name == "pendulum"
    assert key_and_message(load_validated, short, True) == (
        "",
        "its model or its reference: more than 3 GiB",
    )
    workers.fails["validate_here"] = InputError(short, "channels", "bad")
    assert key_and_message(load_validated, short, True) == ("channels", "bad")


def test_a_folder_is_searched_with_all_folders_below_it(tmp_path):
    """Hidden folders and links to folders are not searched.

    A link to itself and a pipe are found, and reading them is an error.
    """
    for name in ("b.toml", "a/c.xml", "a/x/d.toml", "a/x/d.xml", ".git/e.toml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(OF_OURS[Path(name).suffix])
    (tmp_path / "a" / "round").symlink_to(tmp_path)
    (tmp_path / "a" / "loop.toml").symlink_to(tmp_path / "a" / "loop.toml")
    os.mkfifo(tmp_path / "a" / "x" / "pipe.toml")
    for name in ("folder.toml", "other.xml"):
        (tmp_path / "a" / name).mkdir()
        (tmp_path / "a" / name / "not_searched.toml").write_text("")
    assert [file.relative_to(tmp_path).as_posix() for file in find_inputs([tmp_path])] == [
        "b.toml",
        "a/folder.toml",
        "a/loop.toml",
        "a/c.xml",
        "a/other.xml",
        "a/x/d.toml",
        "a/x/pipe.toml",
    ]
    for name, words in (("a/loop.toml", "Too many levels"), ("a/x/pipe.toml", "a device or pipe")):
        assert words in key_and_message(read_isolated, tmp_path / name)[1]


def test_an_unreadable_subfolder_does_not_stop_the_search(models, monkeypatch):
    locked = models / "locked"
    locked.mkdir()
    scandir = os.scandir

    def refuse(path):
        if path in (locked, str(locked)):
            raise PermissionError(13, "Permission denied", str(locked))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refuse)
    errors = []
    assert models / "fourbar.toml" in collect_inputs([models], errors)
    assert [str(error) for error in errors] == [f"{locked}: cannot be read: Permission denied"]
    assert errors[0].key == "", "the error is of the folder itself, not of a key"


def test_families_are_named_by_folders_below_the_paths(monkeypatch):
    def named(file, *paths):
        return family_of(Path(file), [Path(path) for path in paths])

    assert named("m/rods/a.toml", "m") == "rods"
    assert named("m/rods/long/a.toml", "m") == "rods/long"
    assert named("m/rods/long/a.toml", "m", "m/rods") == "long"
    assert named("m/rods/a.toml", "m/rods") == "rods"
    assert named("m/rods/a.toml", "m/rods/a.toml") == "rods"
    assert named("rods/a.toml", ".") == "rods"
    assert named("../m/a.toml", "../m") == "m"
    monkeypatch.chdir(MODELS)
    assert named("a.toml", ".") == "models"


@pytest.fixture
def twins(models, tmp_path):
    """A folder with two sidecars of the same name in two subfolders."""
    for folder in ("left", "right"):
        (tmp_path / "arms" / folder).mkdir(parents=True)
        for name in ("pendulum.toml", "pendulum.xml"):
            (tmp_path / "arms" / folder / name).write_bytes((models / name).read_bytes())
    return tmp_path / "arms"


def test_cases_with_the_same_name_are_kept_apart(twins):
    """One of the cases differs, so that the test fails if their results are exchanged."""
    wrong = twins / "right" / "pendulum.xml"
    text = wrong.read_text(encoding="utf-8")
    assert "9.81" in text
    wrong.write_text(text.replace("9.81", "9.91"), encoding="utf-8")
    result = check([twins], causes=False)
    assert not result.errors
    assert [case.name for case in result.cases] == ["left/pendulum", "right/pendulum"]
    outcomes = {(c.case, c.outcome) for c in result.comparisons}
    assert ("left/pendulum", "agrees") in outcomes
    assert ("right/pendulum", "differs") in outcomes
    assert ("left/pendulum", "differs") not in outcomes
    answer = CliRunner().invoke(app, ["list", str(twins)])
    assert answer.exit_code == 0
    assert "left/pendulum" in answer.output
    assert "right/pendulum" in answer.output
    assert [case.name for case in load_cases([twins])] == ["left/pendulum", "right/pendulum"]


def test_a_case_that_is_given_twice_is_collected_once(short, monkeypatch):
    monkeypatch.chdir(short.parent)
    again = Path("..") / short.parent.name / short.name
    assert collect_inputs([short, short.name, again], []) == [short]


def test_names_have_as_many_folders_as_make_them_unique():
    files = [Path(f"/m/{name}") for name in ("a/x/arm.toml", "b/x/arm.toml", "b/arm.toml", "y.xml")]
    assert list(unique_names(files).values()) == ["a/x/arm", "b/x/arm", "b/arm", "y"]
    assert list(unique_names([Path("/m/arm.toml"), Path("/m/x/arm.xml")]).values()) == [
        "arm",
        "x/arm",
    ]


def test_paths_may_be_given_by_an_iterator(models):
    assert check(iter([models / "pendulum.xml"])).paths == (models / "pendulum.xml",)


def test_models_with_the_same_name_and_no_sidecar_are_kept_apart(models, tmp_path, briefly):
    for name in ("a", "b"):
        (tmp_path / "robots" / name).mkdir(parents=True)
        (tmp_path / "robots" / name / "scene.xml").write_bytes(
            (models / "pendulum.xml").read_bytes()
        )
    (tmp_path / "robots" / "arm.xml").write_bytes((models / "pendulum.xml").read_bytes())
    assert [c.case for c in check([tmp_path / "robots"]).comparisons] == [
        "arm",
        "a/scene",
        "b/scene",
    ]


def test_a_model_with_the_name_of_another_case_is_named_with_its_folder(short, tmp_path, briefly):
    lone = tmp_path / "robots" / "pendulum.xml"
    lone.parent.mkdir()
    lone.write_bytes(short.with_suffix(".xml").read_bytes())
    assert {c.case for c in check([short, lone]).comparisons} == {"pendulum", "robots/pendulum"}


@pytest.mark.parametrize(("jobs", "threads"), [(3, 3), (None, 5)])
def test_parallel_runs_are_as_many_as_jobs_or_processors(jobs, threads, monkeypatch, tmp_path):
    monkeypatch.setattr(os, "cpu_count", lambda: 5)
    asked = []

    class Pool(pool.ThreadPoolExecutor):
        def __init__(self, most):
            asked.append(most)
            super().__init__(most)

    monkeypatch.setattr(pool, "ThreadPoolExecutor", Pool)
    check([tmp_path / "none"], jobs=jobs)
    assert asked == [threads]


def test_a_run_is_made_within_its_limits(short, workers, monkeypatch):
    seen = []

    def validate(case):
        seen.append(case)

    monkeypatch.setattr(validate_module, "validate_case", validate)
    case = load_validated(short)
    assert seen == [case]
    found, curves = run_solver(case, "dynamics", "mujoco")
    assert workers[-1] == ("run_and_compare", 7.0, 3.0)
    assert {c.outcome for c in found} == {"agrees"}
    assert found[0].detectable
    assert curves.x.size == 11
    compared = run_solver(
        case, "dynamics", "mujoco", compare_curves=lambda *told: Comparisons([told])
    )[0]
    assert compared[0][:3] == (case, "dynamics", "mujoco")
    assert compared[0][3].x.size == 11


@pytest.mark.parametrize("kind", OUTCOME_OF_EXCEPTION)
def test_a_failed_run_has_an_outcome_for_each_of_its_channels(kind, short, workers):
    case = load_validated(short)
    of_one_run = {
        name: case.channels[name].model_copy(update={"only": kind_of})
        for name, kind_of in (("rate", "sweep"), ("angle", "dynamics"))
    }
    case = case.model_copy(update={"channels": {**case.channels, **of_one_run}})
    workers.fails["run_and_compare"] = kind("why")
    if kind is Unsupported:
        assert key_and_message(run_solver, case, "dynamics", "mujoco") == (
            "run.dynamics.solvers",
            "mujoco cannot run pendulum.xml: why; leave it out",
        )
        return
    found, curves = run_solver(case, "dynamics", "mujoco")
    assert curves is None
    more = {
        "timed out": "; timeout in [run.dynamics] allows more",
        "out of memory": "; memory in [run.dynamics] allows more",
    }.get(OUTCOME_OF_EXCEPTION[kind], "")
    assert found == [
        Comparison(
            "pendulum",
            "mujoco",
            "dynamics",
            name,
            unit,
            outcome=OUTCOME_OF_EXCEPTION[kind],
            message="why" + more,
        )
        for name, unit in (
            ("angle", "rad"),
            ("acceleration", "rad/s^2"),
            ("kinetic", "J"),
            ("potential", "J"),
        )
    ]


@pytest.mark.parametrize(
    "error",
    [InputError(Path("a"), "", ""), MemoryError(), *(kind("") for kind in OUTCOME_OF_EXCEPTION)],
)
def test_expected_exceptions_of_a_run_are_raised_unchanged(error, short, monkeypatch):
    def fail(*_):
        raise error

    monkeypatch.setattr(solve_module, "solve_here", fail)
    with pytest.raises(type(error)) as raised:
        run_and_compare(load_validated(short), "dynamics", "mujoco", None)
    assert raised.value is error


def test_an_unexpected_exception_of_a_run_is_a_crash(short, monkeypatch):
    case = load_validated(short)
    monkeypatch.setattr(solve_module, "solve_here", lambda case, *_: {}[case.name])
    with pytest.raises(Crashed, match=r"^KeyError: 'pendulum'$"):
        run_and_compare(case, "dynamics", "mujoco", None)


def test_a_sweep_that_ends_early_says_where(short):
    case = load_validated(short)
    whole, part = Curves(np.zeros(11), {}), Curves(np.zeros(4), {}, stopped="a limit")
    assert early_end_error(case, "dynamics", "mujoco", None) is None
    assert early_end_error(case, "dynamics", "mujoco", whole) is None
    error = early_end_error(case, "dynamics", "mujoco", part)
    assert (error.file, error.key, error.wrong) == (
        short,
        "drive",
        "the mujoco dynamics ends at sample 4 of 11, which are kept: a limit",
    )


def test_a_model_without_a_sidecar_is_checked_for_self_consistency(short, workers, monkeypatch):
    monkeypatch.setattr(own_motion, "MAX_HALVINGS", own_motion.MIN_HALVINGS)
    model = short.with_suffix(".xml")
    source = ModelSource(model)
    (found,) = check_bare_model(source)
    assert workers[-1] == ("check_model_here", OWN_MODEL_TIMEOUT, None)
    assert (found.case, found.solver, found.run, found.channel, found.unit) == (
        "pendulum",
        "mujoco",
        "dynamics",
        "",
        "m",
    )
    assert found.outcome == "self-consistent"
    assert found.message.startswith("until 1 s, its end, off by no more than ")
    assert found.at == 1.0
    assert 0.0 < found.uncertainty < 1e-6  # m
    assert np.isnan(found.allowed)
    assert found.steps == 1000  # 1 s in steps of 1 ms
    assert found.seconds > 0
    for kind, outcome in OUTCOME_OF_EXCEPTION.items():
        workers.fails["check_model_here"] = kind("why")
        (found,) = check_bare_model(source)
        assert (found.outcome, found.message) == (outcome, "why")
    workers.fails["check_model_here"] = BadModel("pendulum.xml: broken")
    assert key_and_message(check_bare_model, source) == ("", "broken")


def test_a_fault_in_one_input_does_not_stop_the_check_of_others(short, workers, tmp_path, briefly):
    lone = short.with_name("fourbar.xml")
    lone.with_suffix(".toml").unlink()
    bad = tmp_path / "bad.toml"
    bad.write_text("title = 1")
    progress = []
    found = check(
        [short, tmp_path / "none", short, bad, lone],
        jobs=1,
        progress=lambda *words: progress.append(words),
    )
    assert [c.name for c in found.cases] == ["pendulum"]
    assert [(c.case, c.channel) for c in found.comparisons] == [
        *(("pendulum", name) for name in found.cases[0].channels),
        ("fourbar", ""),
    ]
    (curves,) = found.curves.items()
    assert (curves[0], curves[1].x.size) == (("pendulum", "dynamics", "mujoco"), 11)
    assert [(e.file, e.key) for e in found.errors] == [
        (tmp_path / "none", ""),
        (bad, "title"),
    ]
    assert progress == [("pendulum dynamics mujoco", 1, 2), ("fourbar.xml", 2, 2)]
    assert found.exit_code == 2


def test_an_unexpected_exception_is_an_error_of_the_file(short, workers, monkeypatch):
    """Also, an error that two runs have in common is reported once."""
    lone = short.with_name("fourbar.xml")
    lone.with_suffix(".toml").unlink()
    workers.fails["check_model_here"] = OSError("no more files")
    found = check([lone, short])
    (error,) = found.errors
    assert (error.file, error.key) == (lone, "")
    assert error.wrong == "fourbar.xml failed: OSError: no more files"
    assert {c.case for c in found.comparisons} == {"pendulum"}
    workers.fails["run_and_compare"] = Crashed("why")
    failed = check([short])
    assert ({c.outcome for c in failed.comparisons}, failed.curves) == ({"crashed"}, {})
    workers.fails["run_and_compare"] = InputError(short, "drive", "bad")
    text = short.read_text().replace('["mujoco"]', '["mujoco", "mujoco:default"]')
    short.write_text(text)
    assert [e.wrong for e in check([short]).errors] == ["bad"]


def test_a_folder_that_cannot_be_read_is_an_error(monkeypatch, tmp_path):
    def closed(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(CHECK_MODULE, "find_inputs", closed)
    (error,) = check([tmp_path]).errors
    assert (error.file, error.key, error.wrong) == (
        tmp_path,
        "",
        "cannot be read: Permission denied",
    )


def test_an_interrupt_cancels_waiting_runs(short, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    ended = []
    monkeypatch.setattr(CHECK_MODULE, "run_parts", interrupt)
    monkeypatch.setattr(
        pool.ThreadPoolExecutor,
        "shutdown",
        lambda self, wait=True, *, cancel_futures=False: ended.append((wait, cancel_futures)),
    )
    with pytest.raises(KeyboardInterrupt):
        check([short])
    assert (False, True) in ended


def test_a_run_of_a_refinement_is_compared_by_its_errors_alone(short, monkeypatch):
    case = load_validated(short)
    monkeypatch.setattr(
        CHECK_MODULE, "run_solver", lambda *task, compare_curves: (task, compare_curves)
    )
    task, compared = run_task((case, "dynamics", "mujoco"), detectable=False)
    assert task == (case, "dynamics", "mujoco")
    assert (compared.func, compared.keywords) == (compare_and_share, {"detectable": False})
    assert run_task(make_finer_run(case, 2, None)) == ((case, "dynamics", "mujoco"), refined_errors)


def make_finer_run(case, segments, add):
    return FinerRun(case, "dynamics", "mujoco", segments, SimpleNamespace(add=add))


def test_runs_of_a_refinement_are_judged_by_their_study(short):
    """The study of a refinement gives the comparisons; those of its single runs are not shown.

    A study that fails adds an error, and the studies after it go on.
    """
    case = load_validated(short)
    curves = Curves(np.zeros(4), {}, stopped="a limit")

    def add(segments, found):
        if segments == 3:
            raise Crashed("failed")
        if segments == 4:
            raise InputError(case.file, "refine.channels", "bad")
        return [f"row {segments}"], [f"order of {found[0][0]}"]

    tasks = [make_finer_run(case, n, add) for n in (2, 3, 4, 5)]
    assert task_label(tasks[0]) == "pendulum dynamics mujoco, 2 segments"
    assert task_file(tasks[0]) == short
    result = Result()
    collect_outcomes(
        tasks, {k: ([f"run {k}"], curves if k == 3 else None) for k in (3, 0, 1, 2)}, result
    )
    assert result.refined == ["row 2", "row 5"]
    assert result.comparisons == ["order of run 0", "order of run 3"]
    assert result.curves == {}
    assert [(e.key, e.wrong.partition(" ")[0]) for e in result.errors] == [
        ("refine", "failed"),
        ("refine.channels", "bad"),
        ("drive", "the"),
    ]


def test_curves_have_the_reference_that_they_were_compared_with(models, keep_solver):
    case = load_case(keep_solver("fourbar.toml", "mujoco"))
    for kind in case.run:  # drives follow their profile exactly in a sweep only
        rows, curves = run_and_compare(case, kind, "mujoco", compare)
        truth = evaluate(case, kind, curves.x, curves.drive).channels
        assert list(curves.reference) == list(case.channels)
        for c in rows:
            error = np.abs(curves.channels[c.channel] - curves.reference[c.channel])
            assert float(error.max()) / case.channels[c.channel].factor == c.error_max  # same bits
            assert curves.reference[c.channel] == pytest.approx(truth[c.channel], abs=1e-9)
        own = Curves(curves.x, curves.channels, drive=curves.drive)
        assert Comparisons(rows).join_reference(own) is own  # no reference is known


def test_each_exception_of_a_run_has_an_outcome_of_a_failure():
    """All but that a run is not supported, or its engine not to be had: then no run was made."""
    failures = {
        kind: one for kind, one in OUTCOME_OF_EXCEPTION.items() if not issubclass(kind, Unsupported)
    }
    assert set(failures.values()) == set(FAILED_OUTCOMES)
    assert {Diverged, NotSolved, Crashed, TimedOut, OutOfMemory} == set(failures)


def test_engines_that_a_command_asks_for_replace_those_of_the_sidecar(short):
    """What they cannot run is no fault of the sidecar; what no tolerance covers is measured."""
    case = load_validated(short)
    result = check([case], engines=("mujoco", "pymunk:default"), causes=False)
    assert not result.errors
    by_solver = {c.solver: c.outcome for c in result.comparisons if c.channel == "angle"}
    assert list(by_solver) == ["mujoco", "pymunk:default"]
    assert by_solver["mujoco"] == "agrees"
    assert by_solver["pymunk:default"] == "measured"
    assert result.exit_code == 0
