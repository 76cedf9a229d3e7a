"""Shared fixtures, and hooks that order, mark and check the tests.

Fixtures: a copy of the models that a test may edit, a case of a stress study, a Dask cluster, a
browser.
"""

import gc
import os
import re
import shutil
import sys
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from proofmass.base.files import write_atomically
from proofmass.base.worker import LIGHT_IMPORTS, SINGLE_THREAD
from proofmass.evidence.coverage import FOLDER_VARIABLE
from proofmass.pytest_items import SolverItem
from proofmass.run.sidecar import load_case
from proofmass.studies import locks
from proofmass.studies.record import Setting
from proofmass.studies.store import Store
from proofmass.studies.stress.limit_search import SEARCH_RUN_TIMEOUT, StressedCase
from proofmass.studies.study import Study
from tests.long import DEFAULT_PARAMETERS, FASTER_TESTS
from tests.shipped import MODELS, READ_CASES, all_file_contents

pytest_plugins = ["pytester"]
os.environ.update(SINGLE_THREAD)  # for the processes of pytest-xdist, which share the processors
os.environ.update(LIGHT_IMPORTS | os.environ)  # for processes that tests start
COVERAGE_FOLDER = TemporaryDirectory()
"""The folder for stored findings of `proofmass explain`, instead of the user's cache.

The variable that names it is set before sidecars are read in workers.
"""
os.environ[FOLDER_VARIABLE] = COVERAGE_FOLDER.name
if sys.dont_write_bytecode:
    # Many containers set PYTHONDONTWRITEBYTECODE, which prevents bytecode files beside the sources.
    # Here they are written into pytest's own folder instead: without bytecode files, each of about
    # a hundred processes that tests start compiles numpy, scipy and the other modules for 2 s.
    sys.dont_write_bytecode = False
    sys.pycache_prefix = str(MODELS.parent / ".pytest_cache" / "bytecode")
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix


@pytest.fixture(autouse=True, scope="session")
def processors(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Let studies lock files in a folder of this process, and use its share of the processors.

    With the usual lock files, tests would wait for studies elsewhere on the machine.  The processes
    of pytest-xdist share the processors: if each process used all of them, two runs of a case would
    go to two workers, and each worker would evaluate the reference that both are compared with.
    """
    folder = tmp_path_factory.mktemp("locks")
    share = (os.cpu_count() or 1) // int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "cpu_count", lambda: max(1, share))
        patch.setattr(locks, "lock_folder", lambda: folder)
        yield


LONG_AGO = 1e9
"""Time of modification that files of a `SpareFolder` get [s since 1970].

Clocks of file systems tick every few milliseconds.  With the present time, a test that writes a
file of the same size within one tick would leave no trace.
"""


class SpareFolder:
    """A folder with copies of all files below `models/` that one test passes on to the next.

    Writing all files for each test would take longer than many tests do, so only the files that a
    test changed are written again.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.kept = path, dict[str, tuple[int, ...]]()
        self.restore()

    def restore(self) -> None:
        """Write missing and changed files again, and remove all other files."""
        self.path.mkdir(exist_ok=True)
        contents = all_file_contents()
        there = {entry.name: entry for entry in os.scandir(self.path)}
        for name in there.keys() - contents.keys():
            is_folder = there[name].is_dir(follow_symlinks=False)
            shutil.rmtree(there[name]) if is_folder else os.unlink(there[name])
        for name, content in contents.items():
            entry = there.get(name)
            if entry is None or self.kept[name] != file_stamp(entry.stat(follow_symlinks=False)):
                file = self.path / name
                file.unlink(missing_ok=True)
                file.write_bytes(content)
                os.utime(file, (LONG_AGO, LONG_AGO))
                self.kept[name] = file_stamp(file.stat())


def file_stamp(status: os.stat_result) -> tuple[int, ...]:
    """Properties of a file of which at least one differs after the file is written."""
    return status.st_ino, status.st_size, status.st_mtime_ns, status.st_mode


@pytest.fixture(scope="session")
def spare(tmp_path_factory: pytest.TempPathFactory) -> SpareFolder:
    """The folder that the fixture `models` lends to tests."""
    return SpareFolder(tmp_path_factory.mktemp("spare") / "models")


@pytest.fixture
def models(tmp_path: Path, spare: SpareFolder, request: pytest.FixtureRequest) -> Iterator[Path]:
    """A folder with copies of all files below `models/`, which a test may change.

    The sidecars state all keys instead of leaving some to defaults, so that a test can change any
    line.  The folder of a failed test is kept.
    """
    folder, failed = tmp_path / "models", request.session.testsfailed
    spare.path.rename(folder)
    yield folder
    if request.session.testsfailed == failed:
        folder.rename(spare.path)
    spare.restore()


@pytest.fixture
def stressed(tmp_path: Path, models: Path) -> Callable[..., StressedCase]:
    """``stressed(name, engine, kind, **parameters)`` makes a stress case in one engine."""

    def make_case(
        name: str, engine: str = "mujoco", kind: str = "dynamics", **parameters: object
    ) -> StressedCase:
        return StressedCase(
            load_case(models / f"{name}.toml"),
            kind,
            Setting(engine, parameters),
            Study(Store(tmp_path / "runs"), longest=SEARCH_RUN_TIMEOUT),
        )

    return make_case


@pytest.fixture
def edit(models: Path) -> Callable[..., Path]:
    """``edit(name, old, new)`` replaces a regular expression in a copied file; it must match."""

    def change(name: str, old: str, new: str, count: int = 0) -> Path:
        file = models / name
        text, hits = re.subn(old, new, file.read_text(), count=count)
        assert hits, f"{old!r} does not occur in {name}"
        file.write_text(text)
        return file

    return change


@pytest.fixture
def keep_solver(models: Path) -> Callable[[str, str], Path]:
    """``keep_solver(name, solver)`` removes other solvers and their tolerances from a sidecar."""

    def keep(name: str, solver: str) -> Path:
        head, *tolerances = (models / name).read_text().split("[[tolerance]]")
        head = re.sub(r"(?m)^solvers = \[.*", f'solvers = ["{solver}"]', head)
        kept = [t for t in tolerances if "\nsolver =" not in t or f'\nsolver = "{solver}"' in t]
        (models / name).write_text("[[tolerance]]".join([head, *kept]))
        return models / name

    return keep


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write empty figures for pages of studies, since drawing takes longer than a small study."""

    def empty(figure: object, stem: Path) -> None:
        for ending in (".svg", ".png"):
            write_atomically(stem.with_suffix(ending), "")

    for study in ("trade", "stress", "diet"):
        monkeypatch.setattr(f"proofmass.studies.{study}.page.save", empty)


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Address of the scheduler of a local Dask cluster; its two workers are processes."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as cluster:  # :0 is any free port
        yield cluster.scheduler_address


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """The Chromium of the system; tests that need it are skipped if there is none."""
    from docs.make.pictures import CHROMIUM, chromium  # loads the report: slow

    pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if not CHROMIUM:
        pytest.skip("there is no Chromium on this system")
    with chromium() as found:
        yield found


FIRST_FILES = ("tests/evidence/test_coverage.py", "tests/report/test_browser.py")

collect_ignore = ["data"]
"""Folders that are not collected: the sidecars in `data` are input of tests, not cases to check."""


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Disable garbage collection while tests are collected, and exempt all objects from it later.

    The 9,000 items and all modules stay until the end.  Searching them for garbage takes a tenth of
    the time of collecting tests.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


class Collection:
    """Hooks for files of all folders; other hooks of this file are for tests below its folder."""

    @pytest.hookimpl(wrapper=True)
    def pytest_collect_file(self, file_path: Path) -> Iterator[list[pytest.Collector]]:
        """Collect doctests only from files that contain a prompt ``>>>``."""
        found = yield
        if file_path.suffix != ".py" or b">>> " in file_path.read_bytes():
            return found
        return [one for one in found if type(one).__name__ != "DoctestModule"]

    def pytest_itemcollected(self, item: pytest.Item) -> None:
        """Keep the case that was read to collect the items of a sidecar."""
        if isinstance(item, SolverItem):
            READ_CASES[item.path] = item.case


def pytest_configure(config: pytest.Config) -> None:
    """Register the hooks of `Collection`, so that tests can use cases read for their items."""
    config.pluginmanager.register(Collection())


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Start one process more than processors, since tests wait a tenth of their time for others."""
    return (os.cpu_count() or 1) + 1


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their markers
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the slow tests that `tests/long.py` names, and put some files first.

    If all tests are collected, each row of `tests/long.py` must match a slow test and a faster
    counterpart that runs by default.

    The tests of a file in `FIRST_FILES` share a fixture that takes long, for which their first test
    waits.  Since they come first, no process is left alone with them at the end, and no two
    processes make the fixture.
    """
    items.sort(key=lambda item: not item.nodeid.startswith(FIRST_FILES))
    in_order = sorted(items, key=lambda item: item.nodeid)
    names = [item.nodeid for item in in_order]

    def items_beginning_with(start: str) -> list[pytest.Item]:
        first = bisect_left(names, start)
        return list(takewhile(lambda item: item.nodeid.startswith(start), in_order[first:]))

    slow_items = {name: items_beginning_with(name) for name in FASTER_TESTS}
    words = {
        f"{file}::{test}": some
        for file, of in DEFAULT_PARAMETERS.items()
        for test, some in of.items()
    }
    families = {name: items_beginning_with(f"{name}[") for name in words}
    for name, family in families.items():
        slow_items[name] = [item for item in family if not has_any_word(item, words[name])]
    for item in {item for found in slow_items.values() for item in found}:
        item.add_marker(pytest.mark.slow)
    if config.args != config.getini("testpaths"):
        return

    def any_runs_by_default(found: list[pytest.Item]) -> bool:
        return any(not item.get_closest_marker("slow") for item in found)

    fast_items = [
        (like, any_runs_by_default(items_beginning_with(like))) for like in FASTER_TESTS.values()
    ]
    for name, family in families.items():
        fast_items += [
            (
                f"{name}[{word}",
                any_runs_by_default([item for item in family if has_any_word(item, [word])]),
            )
            for word in words[name]
        ]
    if unmatched := [name for name, there in (*slow_items.items(), *fast_items) if not there]:
        raise pytest.UsageError("tests/long.py: there is no test\n" + "\n".join(unmatched))


def has_any_word(item: pytest.Item, words: Iterable[str]) -> bool:
    """Whether the parameters in the name of a test contain one of these words."""
    parameters = item.nodeid.partition("[")[2]
    return any(word in parameters for word in words)
