"""The store of studies and their tables: complete files, and keys that differ for other runs."""

import csv
import io
import json
import os
from dataclasses import replace

import pytest

from proofmass.base.errors import InputError
from proofmass.base.files import write_atomically
from proofmass.run.sidecar import load_case
from proofmass.studies import store as stores
from proofmass.studies.measure import Measurement, StudyRun
from proofmass.studies.record import (
    NAN,
    RUN_COLUMNS,
    Setting,
    StudyRow,
    format_table,
    read_table,
    write_table,
)
from proofmass.studies.store import Store, task_key, task_keys
from tests.shipped import shipped
from tests.studies.study_tasks import tasks

TASK = tasks()[0]
MEASUREMENT = Measurement(
    {"position": 1e-3}, {"violation": 0.0}, 0.1, 7, True, 0.25, "a processor x 2"
)
TIMED_OUT_MEASUREMENT = Measurement(outcome="timed out", message="no answer in 5 s")
ROWS = [
    StudyRow(
        "trade",
        "pendulum",
        "dynamics",
        "mujoco",
        "RK4",
        "timestep",
        1e-3,
        {"timestep": 1e-3, "integrator": "RK4", "solref": (0.02, 1.0), "defaults": True},
        {"position": 0.1 + 0.2},
        {"violation": 0.0},
        0.1,
        7,
        (0.1, 0.25),
        True,
        0.5,
        "x 2",
    ),
    StudyRow(
        "trade",
        "pendulum",
        "dynamics",
        "pymunk",
        'a, "b"',
        "iterations",
        NAN,
        {"iterations": 10, "word": "8"},
        outcome="diverged",
        message="failed at\ntime 1 s",
    ),
]


def test_a_saved_measurement_is_loaded(tmp_path):
    kept = Store(tmp_path / "new" / "store")
    assert kept.load("key", 0) is None
    kept.save("key", 0, TASK, MEASUREMENT, 5.0)
    assert Store(kept.folder).load("key", 0) == MEASUREMENT
    assert kept.load("key", 1) is None
    assert kept.load("other", 0) is None


def test_a_timed_out_run_is_repeated_only_with_a_longer_limit(tmp_path):
    kept = Store(tmp_path)
    kept.save("key", 0, TASK, TIMED_OUT_MEASUREMENT, 5.0)
    assert repr(kept.load("key", 0, timeout=5.0)) == repr(TIMED_OUT_MEASUREMENT)
    assert kept.load("key", 0, timeout=6.0) is None


@pytest.mark.parametrize(
    "record",
    [
        "[]",
        "{}",
        '{"timeout": 5}',
        '{"found": {}, "timeout": "long"}',
        "[" * 100_000,
        '{"found": {"errors": 3}, "timeout": 5}',
        '{"found": {"colour": 1}, "timeout": 5}',
    ],
)
def test_a_record_that_no_study_wrote_is_bad_input(tmp_path, record):
    kept = Store(tmp_path)
    kept.file("key", 0).write_text(record)
    with pytest.raises(InputError, match=r"key\.0\.json: not what a study wrote there; delete it"):
        kept.load("key", 0)


def test_curves_that_no_study_wrote_are_bad_input(tmp_path):
    (tmp_path / "key.npz").write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"key\.npz: not what a study wrote there; delete it"):
        Store(tmp_path).curves("key")


@pytest.mark.parametrize("when", ["fsync", "replace"])
def test_an_interrupted_write_leaves_the_old_file_or_none(tmp_path, monkeypatch, when):
    def stop(*_):
        raise KeyboardInterrupt

    kept, file = Store(tmp_path), tmp_path / "old.json"
    write_atomically(file, "old")
    monkeypatch.setattr(os, when, stop)
    with pytest.raises(KeyboardInterrupt):
        kept.save("key", 0, TASK, MEASUREMENT, 5.0)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(file, "new")
    monkeypatch.undo()
    assert kept.load("key", 0) is None
    assert [one.name for one in tmp_path.glob("*.json")] == ["old.json"]
    assert file.read_text() == "old"


def test_only_old_partial_files_are_removed(tmp_path):
    old, young = tmp_path / "a.json.1.part", tmp_path / "b.json.1.part"
    for half in (old, young):
        half.touch()
    os.utime(old, (0, 0))
    Store(tmp_path)
    assert [half.name for half in tmp_path.glob("*.part")] == [young.name]


def test_keys_ignore_the_study_titles_and_settings_of_other_runs():
    case = TASK.case
    run = case.run["dynamics"].model_copy(update={"timeout": 5.0, "solvers": ("pymunk",)})
    same = [
        replace(TASK, study="choose", series="another", varied="integrator", value=NAN),
        replace(TASK, case=case.model_copy(update={"title": "", "source": "", "tolerance": ()})),
        replace(TASK, case=case.model_copy(update={"settings": {"mujoco": {"timestep": 1.0}}})),
        replace(TASK, case=case.model_copy(update={"run": {"dynamics": run}})),
    ]
    assert {task_key(task) for task in same} == {task_key(TASK)}


def test_a_key_is_computed_once_and_again_for_a_changed_model(tmp_path, models, edit, monkeypatch):
    def count(some):
        asked.append(len(some))
        return task_keys(some)

    asked: list[int] = []
    monkeypatch.setattr(stores, "task_keys", count)
    store, own = Store(tmp_path / "store"), tasks(models)
    known = [task_keys([task])[0] for task in own]
    for _ in range(2):
        assert store.find_keys([*own, *own]) == known + known
        for task, key in zip(own, known, strict=True):
            assert store.key(replace(task, study="choose")) == key
    assert sum(asked) == len(own)
    assert max(asked) > 1
    assert store.key(replace(own[0], key="known")) == "known"
    edit("pendulum.xml", 'pos="0 -1 0" mass="1"', 'pos="0 -1.001 0" mass="1"')
    assert store.key(own[0]) == task_key(own[0]) != task_key(TASK)


def test_keys_differ_if_anything_that_affects_a_run_differs(models, edit, monkeypatch):
    def key(**changed):
        return task_key(replace(TASK, case=TASK.case.model_copy(update=changed)))

    run = TASK.case.run["dynamics"].model_copy(update={"until": 0.6})
    keys = [
        task_key(TASK),
        *(task_key(task) for task in tasks()[1:]),
        task_key(replace(TASK, setting=TASK.setting.with_parameters(tolerance=1e-6))),
        key(parameters={**TASK.case.parameters, "length": 1.001}),
        key(run={"dynamics": run}),
    ]
    edit("pendulum.xml", 'pos="0 -1 0" mass="1"', 'pos="0 -1.001 0" mass="1"')
    keys.append(task_key(tasks(models)[0]))
    monkeypatch.setattr(stores, "package_versions", lambda engine: {engine: "9.9"})
    keys.append(task_key(TASK))
    monkeypatch.undo()
    monkeypatch.setattr(stores, "digest_of_sources", lambda: "other code")
    keys.append(task_key(TASK))
    assert len(set(keys)) == len(keys)


def test_a_copied_model_with_another_comment_has_the_same_key(models, edit):
    edit("pendulum.xml", "<!--", "<!-- It swings.")
    assert task_key(tasks(models)[0]) == task_key(TASK)


def test_keys_differ_for_other_recorded_curves(models):
    def key():
        case = load_case(models / "hacksaw_recorded.toml")
        return task_key(StudyRun(case, next(iter(case.run)), Setting("mujoco")))

    before, file = key(), models / "hacksaw_recorded.csv"
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:-1], lines[-1].replace("1", "2")]) + "\n")
    assert key() != before


def test_keys_differ_for_other_rows_of_a_sampled_profile(models):
    def key():
        case = load_case(models / "hacksaw_sampled.toml")
        return task_key(StudyRun(case, "dynamics", Setting("mujoco")))

    before, file = key(), models / "hacksaw_motor.csv"
    file.write_text(file.read_text().replace("370.823233942", "370.823233943", 1))
    assert key() != before


def test_keys_differ_for_other_readings_of_a_recorded_curve(models):
    def key(recording):
        file.write_text(f"{text}\n[recording]\n{recording}\n")
        return task_key(StudyRun(load_case(file), "dynamics", Setting("mujoco")))

    file = models / "hacksaw_recorded.toml"
    text = file.read_text()
    keys = [key(""), key('x = { column = "t", shift = 1.0 }'), key("columns.r1 = { scale = 2.0 }")]
    assert len(set(keys)) == len(keys)


def test_keys_differ_for_other_loads():
    def key(*loads):
        return task_key(
            StudyRun(case.model_copy(update={"load": loads}), "dynamics", Setting("mujoco"))
        )

    case = load_case(shipped("axes_controlled.toml"))
    push, wind, lift = case.load
    stairs = push.profile.model_copy(update={"interpolation": "held"})
    keys = [
        key(push, wind, lift),
        key(push, wind),
        key(push.model_copy(update={"profile": stairs}), wind, lift),
    ]
    assert len(set(keys)) == len(keys)


def test_keys_depend_on_segments_and_too_few_are_bad_input():
    task = StudyRun(
        load_case(shipped("rod_cantilever.toml")),
        "equilibrium",
        Setting("mujoco", {"segments": 10}),
    )
    assert task_key(task) != task_key(
        replace(task, setting=task.setting.with_parameters(segments=20))
    )
    with pytest.raises(InputError, match="segments"):
        task_key(replace(task, setting=task.setting.with_parameters(segments=1)))


def test_a_table_is_read_back_and_all_its_columns_are_described(tmp_path):
    file = tmp_path / "trade.csv"
    write_table(ROWS, file)
    assert repr(read_table(file)) == repr(ROWS)  # as text, since NaN is not equal to itself
    described = (tmp_path / "trade.columns.md").read_text()
    for column in format_table(ROWS).splitlines()[0].split(","):
        assert f"| `{column.partition('.')[0]}" in described
        assert column.partition(".")[0] in RUN_COLUMNS


def test_records_and_tables_without_a_load_are_read(tmp_path):
    store, file = Store(tmp_path), tmp_path / "trade.csv"
    store.save("key", 0, TASK, replace(MEASUREMENT, load=2.5), 5.0)
    record = json.loads((tmp_path / "key.0.json").read_text())
    assert record["found"].pop("load") == 2.5
    (tmp_path / "key.0.json").write_text(json.dumps(record))
    again = Store(tmp_path).load("key", 0)
    assert repr(again) == repr(replace(MEASUREMENT, load=NAN))
    write_table([replace(row, load=2.5) for row in ROWS], file)
    cells = list(csv.DictReader(io.StringIO(file.read_text())))
    assert [row["load"] for row in cells] == ["2.5"] * len(ROWS)
    names = [name for name in cells[0] if name != "load"]
    text = io.StringIO()
    writer = csv.DictWriter(text, names, extrasaction="ignore")
    writer.writeheader()
    writer.writerows(cells)
    file.write_text(text.getvalue())
    assert repr(read_table(file)) == repr([replace(row, load=NAN) for row in ROWS])


def test_a_missing_or_different_table_is_bad_input(tmp_path):
    file = tmp_path / "trade.csv"
    with pytest.raises(InputError, match=r"trade\.csv: no table there"):
        read_table(file)
    file.write_text(format_table(ROWS).replace("engine", "solver"))
    with pytest.raises(InputError, match="not the table of a study: no column 'engine'"):
        read_table(file)
    file.write_text(format_table(ROWS).replace("series,varied", "line,axis"))
    with pytest.raises(InputError, match="no column 'series'; if an earlier version wrote it, run"):
        read_table(file)


def test_a_table_is_written_as_parquet_where_that_is_possible(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    write_table(ROWS, tmp_path / "trade.csv")
    columns = parquet.read_table(tmp_path / "trade.parquet").to_pydict()
    assert columns["error.position"] == [0.1 + 0.2, None]
    assert columns["outcome"] == ["ran", "diverged"]


def test_records_name_their_case_parameters_and_versions(tmp_path):
    Store(tmp_path).save("key", 2, TASK, MEASUREMENT, 5.0)
    record = json.loads((tmp_path / "key.2.json").read_text())
    assert record["case"] == "pendulum"
    assert record["parameters"] == TASK.setting.parameters
    assert {"mujoco", "numpy", "proofmass"} <= set(record["versions"])
