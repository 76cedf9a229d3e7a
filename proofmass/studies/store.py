"""Store of finished runs: a folder with a JSON file for each run and an .npz file for its curves.

The names of the files are keys: digests of all that the result of a run depends on.  A file is
written under another name and then renamed, so that a file of the store is always complete.
"""

import io
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from proofmass.base import recorded, recording
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.files import PARTIAL_ENDING, make_folder, read_text, write_atomically
from proofmass.base.strict import Kind
from proofmass.case import drive, profile
from proofmass.case.case import Case
from proofmass.run.fingerprint import (
    bytes_of_case_model,
    digest,
    digest_recorded_files,
    digest_sources,
    package_versions,
)
from proofmass.sim.model_files import model_key
from proofmass.studies import invariants, measure, references
from proofmass.studies.bounded import call_bounded
from proofmass.studies.measure import Measurement, StudyRun
from proofmass.studies.record import Setting
from proofmass.verdict.outcome import Outcome

KEY_FIELDS = {"start", "reference", "parameters", "recording", "drive", "load", "rod"}
"""Tables and keys of a sidecar that are part of every key."""
TaskKey = tuple[int, tuple[str, ...], str]
"""Identity of a task in a process: id of the case, content of its model, run and setting."""
RunKey = tuple[str, int]
"""Key of a task and number of the repeat; 0 is the first run, which has errors."""
KEYS_PER_CALL = 32  # settings for whose keys one call of a worker compiles the models
TIMED_OUT = Outcome.TIMED_OUT
PARTIAL_FILE_SECONDS = 3600.0  # [s] since its last change, after which a partial file is deleted
RESULT_MODULES = measure, references, invariants, drive, profile, recorded, recording
"""Modules on whose code a result depends, beside those of `digest_sources`."""


class Store:
    """Finished runs in a folder, by key of the task and number of the repeat.

    Parameters
    ----------
    folder : path
        Made if it does not exist.  Workers of a cluster need it at the same path.
    """

    def __init__(self, folder: Path | str):
        self.folder = Path(folder).absolute()
        for part in (self.folder.parent, self.folder):
            make_folder(part)
        self.keys: dict[TaskKey, tuple[Case, str]] = {}
        self.known: dict[RunKey, Measurement] = {}  # read or written by this process
        for half in self.folder.glob(
            f"*{PARTIAL_ENDING}"
        ):  # left by a study that was killed while it wrote
            if time.time() - half.stat().st_mtime > PARTIAL_FILE_SECONDS:
                half.unlink()

    def key(self, task: StudyRun) -> str:
        """The key of a task; see `task_key`."""
        return self.find_keys([task])[0]

    def find_keys(self, tasks: Sequence[StudyRun]) -> list[str]:
        """The keys of tasks; those that are not known yet are computed in parallel, in batches."""
        identities = [task_identity(task) for task in tasks]
        unknown: dict[tuple[int, str], dict[TaskKey, StudyRun]] = {}
        for identity, task in zip(identities, tasks, strict=True):
            if not task.key and identity not in self.keys:
                unknown.setdefault((id(task.case), task.run), {})[identity] = task
        batches = [
            list(one.items())[k : k + KEYS_PER_CALL]
            for one in unknown.values()
            for k in range(0, len(one), KEYS_PER_CALL)
        ]
        with ThreadPoolExecutor(os.cpu_count()) as threads:
            every = list(threads.map(lambda batch: task_keys([one for _, one in batch]), batches))
        for batch, keys in zip(batches, every, strict=True):
            for (identity, task), key in zip(batch, keys, strict=True):
                self.keys[identity] = task.case, key  # keeps the case alive: its id stays unique
        return [
            task.key or self.keys[place][1] for place, task in zip(identities, tasks, strict=True)
        ]

    def load(self, key: str, repeat: int, timeout: float = 0.0) -> Measurement | None:
        """The result of a run; None if missing, or given up after less than `timeout` [s]."""
        if (key, repeat) in self.known:
            return self.known[key, repeat]
        if not (file := self.file(key, repeat)).is_file():
            return None
        record = read_json(file)
        try:
            found, given_timeout = Measurement(**record["found"]), float(record["timeout"])
        except (KeyError, TypeError, ValueError):
            raise foreign_file_error(file) from None
        for name, value in vars(Measurement()).items():
            kinds = (
                (int, float)
                if isinstance(value, float)
                else str
                if isinstance(value, str)
                else type(value)
            )
            if not isinstance(getattr(found, name), kinds):
                raise foreign_file_error(file)
        if found.outcome == TIMED_OUT and given_timeout < timeout:
            return None
        return self.remember(key, repeat, found)

    def remember(self, key: str, repeat: int, found: Measurement) -> Measurement:
        """Keep a result without its curves in memory, unless it timed out: it may be made again."""
        if found.outcome != TIMED_OUT:
            self.known[key, repeat] = replace(found, curves={})
        return found

    def value(self, name: str, make: Callable[[], Any]) -> Any:
        """A result that is no run, of JSON values: read from a file, or else made and written."""
        file = self.folder / name
        if not file.is_file():
            write_atomically(file, json.dumps(make()))
        return read_json(file)

    def curves(self, key: str) -> dict[str, Array]:
        """The curves of a task's first run: ``x``, and ``channel.NAME`` for each channel."""
        file = self.folder / f"{key}.npz"
        try:
            with np.load(file) as arrays:
                return dict(arrays)
        except FileNotFoundError:
            raise
        except (OSError, ValueError, EOFError, AttributeError, TypeError, BadZipFile):
            raise foreign_file_error(file) from None

    def records(self, case: str, run: str) -> Iterator[tuple[str, dict[str, Any]]]:
        """Key and record of every first run of a case of that name, also with earlier models."""
        for file in sorted(self.folder.glob("*.0.json")):
            record = read_json(file)
            if isinstance(record, dict) and (record.get("case"), record.get("run")) == (case, run):
                yield file.name.removesuffix(".0.json"), record

    def repeats(self, key: str) -> list[Measurement]:
        """The results of all runs of a task: the first run, then its repeats."""
        found = list[Measurement]()
        while one := self.load(key, len(found)):
            found.append(one)
        return found

    def save(
        self, key: str, repeat: int, task: StudyRun, found: Measurement, timeout: float
    ) -> None:
        """Save the result of a run: first its curves, then its record, which marks it finished."""
        if found.curves:
            packed = io.BytesIO()
            np.savez(packed, **found.curves)  # type: ignore[arg-type]  # digits do not compress
            write_atomically(self.folder / f"{key}.npz", packed.getvalue())
        record = {
            "case": task.case.name,
            "run": task.run,
            "engine": task.setting.engine,
            "parameters": task.setting.parameters,
            "repeat": repeat,
            "timeout": timeout,
            "versions": package_versions(task.setting.engine),
            "found": result_record(found),
        }
        write_atomically(self.file(key, repeat), json.dumps(record, indent=1, allow_nan=False))
        self.remember(key, repeat, found)

    def file(self, key: str, repeat: int) -> Path:
        """Path of the record of a run."""
        return self.folder / f"{key}.{repeat}.json"


def result_record(found: Measurement) -> dict[str, Any]:
    """The result of a run for its JSON file, without curves and without fields that are NaN."""
    return {
        k: v
        for k, v in asdict(replace(found, curves={})).items()
        if k != "curves" and not (isinstance(v, float) and np.isnan(v))
    }


def read_json(file: Path) -> Any:
    """Content of a JSON file that `write_atomically` wrote.

    Raises
    ------
    InputError
        The file is no JSON: something else has changed it since.
    """
    try:
        return json.loads(read_text(file))
    except (ValueError, RecursionError):
        raise foreign_file_error(file) from None


def foreign_file_error(file: Path) -> InputError:
    """The error for a file of the store that something else has changed."""
    return InputError(file, "", "not what a study wrote there; delete it, and it is made again")


def task_key(task: StudyRun) -> str:
    """SHA-256 of all that a run's result depends on: model, sidecar, parameters, versions, sources.

    The study that asks for the run, titles, views and tolerances are no part of the key.
    """
    return task_keys([task])[0]


def task_keys(tasks: Sequence[StudyRun]) -> list[str]:
    """The keys of tasks of one run of a case; one call of a worker compiles all their models."""
    case, kind = tasks[0].case, tasks[0].run
    table = case.run[kind]
    common = {
        "reference": digest_recorded_files(case),
        "sidecar": case.model_dump(mode="json", include=KEY_FIELDS),
        "channels": {n: c.model_dump() for n, c in case.channels_of(kind).items()},
        "run": (kind, table.n, table.until, table.inertia),
        "sources": digest_of_sources(),
    }
    found = call_bounded(case, kind, compile_settings, case, kind, [task.setting for task in tasks])
    return [
        digest(
            json.dumps(
                {
                    **common,
                    "model": model,
                    "rods": rods,
                    "engine": task.setting.engine,
                    "parameters": settings,
                    "versions": package_versions(task.setting.engine),
                },
                sort_keys=True,
            ).encode()
        )
        for task, (model, rods, settings) in zip(tasks, found, strict=True)
    ]


def compile_settings(
    case: Case, kind: Kind, settings: Sequence[Setting]
) -> list[tuple[str, dict[str, Any], dict[str, Any]]]:
    """For each setting of a case: digest of the compiled model, its rods, the engine's settings."""
    found = []
    for setting in settings:
        changed, run = setting.apply_to(case, kind)
        rods = {name: rod.model_dump(mode="json") for name, rod in changed.rod.items()}
        found.append((digest(bytes_of_case_model(changed)), rods, dict(run.settings)))
    return found


def task_identity(task: StudyRun) -> TaskKey:
    """Identity of a task within this process; see `TaskKey`."""
    return id(task.case), model_key(task.case.model_path), f"{task.run} {task.setting}"


@cache
def digest_of_sources() -> str:
    """Digest of the code of simulators and references, which may change within a version."""
    return digest_sources(Path(str(module.__file__)) for module in RESULT_MODULES)
