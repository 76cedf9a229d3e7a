"""Shared fixtures: copies of models to change, a case of a stress study, a cluster, a browser."""

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

from proofmass.coverage import FOLDER_VARIABLE
from proofmass.files import write_atomically
from proofmass.pytest_plugin import SolverItem
from proofmass.sidecar import load_case
from proofmass.studies import measure
from proofmass.studies.record import Setting
from proofmass.studies.store import Store
from proofmass.studies.stress.limit_search import StressedCase
from proofmass.worker import NO_RENDERER, SINGLE_THREAD
from tests.long import LONG, SOME
from tests.shipped import MODELS, READ, every_file

pytest_plugins = ["pytester"]
os.environ.update(SINGLE_THREAD)  # of pytest-xdist's workers, which share the processors
os.environ.update(NO_RENDERER | os.environ)  # of processes that tests start
FOUND = TemporaryDirectory()
"""What `proofmass explain` keeps, not the user's: set before sidecars are read in workers."""
os.environ[FOLDER_VARIABLE] = FOUND.name
if sys.dont_write_bytecode:
    # PYTHONDONTWRITEBYTECODE, which many containers set, keeps files of bytecode from the sources.
    # Here they are among pytest's own: without any, each of some hundred processes that tests start
    # compiles numpy, scipy and the rest for two seconds.
    sys.dont_write_bytecode = False
    sys.pycache_prefix = str(MODELS.parent / ".pytest_cache" / "bytecode")
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix


@pytest.fixture(autouse=True, scope="session")
def processors(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Locks on processors that studies elsewhere on the machine do not hold, and fewer processors.

    Processes of pytest-xdist share them: where each takes all, a reference that two runs of a case
    are held against is evaluated in two workers.
    """
    folder = tmp_path_factory.mktemp("locks")
    share = (os.cpu_count() or 1) // int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "cpu_count", lambda: max(1, share))
        patch.setattr(measure, "lock_path", lambda name: folder / name)
        yield


LONG_AGO = 1e9
"""When files of a `SpareFolder` were written, they say [s]: clocks of files tick every few
milliseconds, in which a test may begin and write as many bytes."""


class SpareFolder:
    """A folder with all files below `models/` that goes from test to test.

    To write it for each of them would take longer than many a test: only what one changed is
    written again.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.kept = path, dict[str, tuple[int, ...]]()
        self.mend()

    def mend(self) -> None:
        """Let all files be there as they were at first, and no others."""
        self.path.mkdir(exist_ok=True)
        contents = every_file()
        there = {entry.name: entry for entry in os.scandir(self.path)}
        for name in there.keys() - contents.keys():
            is_folder = there[name].is_dir(follow_symlinks=False)
            shutil.rmtree(there[name]) if is_folder else os.unlink(there[name])
        for name, content in contents.items():
            entry = there.get(name)
            if entry is None or self.kept[name] != stamp(entry.stat(follow_symlinks=False)):
                file = self.path / name
                file.unlink(missing_ok=True)
                file.write_bytes(content)
                os.utime(file, (LONG_AGO, LONG_AGO))
                self.kept[name] = stamp(file.stat())


def stamp(found: os.stat_result) -> tuple[int, ...]:
    """What differs once a file has been written."""
    return found.st_ino, found.st_size, found.st_mtime_ns, found.st_mode


@pytest.fixture(scope="session")
def spare(tmp_path_factory: pytest.TempPathFactory) -> SpareFolder:
    """The folder that `models` gives to tests."""
    return SpareFolder(tmp_path_factory.mktemp("spare") / "models")


@pytest.fixture
def models(tmp_path: Path, spare: SpareFolder, request: pytest.FixtureRequest) -> Iterator[Path]:
    """A copy of all files below `models/`, in one folder, that a test may change.

    The sidecars leave nothing to defaults, so that a test can change any line.  A test that fails
    keeps its folder.
    """
    folder, failed = tmp_path / "models", request.session.testsfailed
    spare.path.rename(folder)
    yield folder
    if request.session.testsfailed == failed:
        folder.rename(spare.path)
    spare.mend()


@pytest.fixture
def stressed(tmp_path: Path, models: Path) -> Callable[..., StressedCase]:
    """``stressed(name, engine, kind, **parameters)``: a case in one engine, with a store."""

    def of(
        name: str, engine: str = "mujoco", kind: str = "dynamics", **parameters: object
    ) -> StressedCase:
        return StressedCase(
            load_case(models / f"{name}.toml"),
            kind,
            Setting(engine, parameters),
            Store(tmp_path / "runs"),
        )

    return of


@pytest.fixture
def edit(models: Path) -> Callable[..., Path]:
    """``edit(name, old, new)`` replaces a regular expression, which must match, in a copy."""

    def change(name: str, old: str, new: str, count: int = 0) -> Path:
        file = models / name
        text, hits = re.subn(old, new, file.read_text(), count=count)
        assert hits, f"{old!r} does not occur in {name}"
        file.write_text(text)
        return file

    return change


@pytest.fixture
def keep_solver(models: Path) -> Callable[[str, str], Path]:
    """``keep_solver(name, solver)`` leaves a sidecar one solver and the tolerances for it."""

    def keep(name: str, solver: str) -> Path:
        head, *tolerances = (models / name).read_text().split("[[tolerance]]")
        head = re.sub(r"(?m)^solvers = \[.*", f'solvers = ["{solver}"]', head)
        kept = [t for t in tolerances if "\nsolver =" not in t or f'\nsolver = "{solver}"' in t]
        (models / name).write_text("[[tolerance]]".join([head, *kept]))
        return models / name

    return keep


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages of studies beside empty figures: to draw them takes longer than a small study."""

    def empty(figure: object, stem: Path) -> None:
        for ending in (".svg", ".png"):
            write_atomically(stem.with_suffix(ending), "")

    for study in ("trade", "stress", "diet"):
        monkeypatch.setattr(f"proofmass.studies.{study}.page.save", empty)


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Of the scheduler of a Dask cluster: two workers, each a process, in a folder of their own."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as cluster:  # any port that is free
        yield cluster.scheduler_address


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """The Chromium of the system; tests are skipped where there is none."""
    from benchmarks.pictures import CHROMIUM, chromium  # loads the report, which is slow

    pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if not CHROMIUM:
        pytest.skip("there is no Chromium on this system")
    with chromium() as found:
        yield found


FIRST = ("tests/test_coverage.py", "tests/report/test_browser.py")

collect_ignore = ["data"]
"""Sidecars there are for tests, and no cases of their own."""


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect without looking for garbage among what stays, 9,000 items and all modules, nor later.

    That is a tenth of the time of collecting.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


class Collection:
    """Hooks for all files; those of this file itself are for the tests below it."""

    @pytest.hookimpl(wrapper=True)
    def pytest_collect_file(self, file_path: Path) -> Iterator[list[pytest.Collector]]:
        """Look for doctests only where there are any."""
        found = yield
        if file_path.suffix != ".py" or b">>> " in file_path.read_bytes():
            return found
        return [one for one in found if type(one).__name__ != "DoctestModule"]

    def pytest_itemcollected(self, item: pytest.Item) -> None:
        """Keep the case of a sidecar."""
        if isinstance(item, SolverItem):
            READ[item.path] = item.case


def pytest_configure(config: pytest.Config) -> None:
    """Let tests ask for cases that are read to collect their items."""
    config.pluginmanager.register(Collection())


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """One process more than there are processors: tests wait for others for a tenth of the time."""
    return (os.cpu_count() or 1) + 1


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their markers
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what takes seconds and has a faster like of it; all of both must be there.

    Files whose first test waits long for what all their tests share come first: of two processes
    none is left alone with them at the end, nor do both make it.
    """
    items.sort(key=lambda item: not item.nodeid.startswith(FIRST))
    in_order = sorted(items, key=lambda item: item.nodeid)
    names = [item.nodeid for item in in_order]

    def begin_with(start: str) -> list[pytest.Item]:
        first = bisect_left(names, start)
        return list(takewhile(lambda item: item.nodeid.startswith(start), in_order[first:]))

    left = {name: begin_with(name) for name in LONG}
    words = {f"{file}::{test}": some for file, of in SOME.items() for test, some in of.items()}
    families = {name: begin_with(f"{name}[") for name in words}
    for name, family in families.items():
        left[name] = [item for item in family if not chosen(item, words[name])]
    for item in {item for found in left.values() for item in found}:
        item.add_marker(pytest.mark.slow)
    if config.args != config.getini("testpaths"):
        return

    def runs(found: list[pytest.Item]) -> bool:
        return any(not item.get_closest_marker("slow") for item in found)

    wanted = [(like, runs(begin_with(like))) for like in LONG.values()]
    for name, family in families.items():
        wanted += [
            (f"{name}[{word}", runs([item for item in family if chosen(item, [word])]))
            for word in words[name]
        ]
    if none := [name for name, there in (*left.items(), *wanted) if not there]:
        raise pytest.UsageError("tests/long.py: there is no test\n" + "\n".join(none))


def chosen(item: pytest.Item, words: Iterable[str]) -> bool:
    """Whether the parameters of a test hold one of these words."""
    parameters = item.nodeid.partition("[")[2]
    return any(word in parameters for word in words)
