"""Coverage of a case: which wrong numbers of its model it would notice, and from which change on.

Each number of the compiled model is changed for the engines, and the runs are compared with the
reference within the tolerances of the case.  A change is noticed if a channel differs that agreed
before, or if the run is refused or fails.  A reference that reads the model itself reads the
changed model, as it does in `proofmass check`.  Such a case notices a number only by the channels
that must equal a number.

The findings are kept in a folder, in a file for each case that is written after each group of
numbers.  `find_coverage` continues a search that was stopped; `stored_coverage` reads a complete
one.
"""

import json
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from time import monotonic

from pydantic import TypeAdapter

from proofmass.base.errors import InputError
from proofmass.base.files import read_text, write_atomically
from proofmass.base.grouping import group_by
from proofmass.base.worker import interrupt_workers
from proofmass.case.case import Case
from proofmass.evidence.coverage_search import CheckedRun, Finding, Search
from proofmass.run.fingerprint import (
    digest,
    digest_recorded_files,
    digest_sources,
    package_versions,
)
from proofmass.run.solve import with_computing_solvers
from proofmass.sim.engines import NoEngine, engine_of
from proofmass.sim.model_files import files_of_model
from proofmass.sim.numbers import NUMBER_KINDS

CASE_LETTERS = 40  # of the name of a case; with a key they fit into the 255 bytes of a file's name
FINDINGS_VERSION = 1
"""Version of the format of the files of findings."""
FOLDER_VARIABLE = "PROOFMASS_CACHE"
"""Environment variable with the folder of findings; ``~/.cache/proofmass`` if it is not set."""
SOURCE_FILES = (
    "base/recorded.py",
    "base/recording.py",
    "case/drive.py",
    "case/profile.py",
    "evidence/changed.py",
    "evidence/coverage.py",
    "evidence/coverage_search.py",
    "run/solve.py",
    "verdict/compare.py",
    "verdict/detectable.py",
    "verdict/noticed.py",
)
"""Files whose sources a finding depends on, beside those of `digest_sources`."""


@dataclass(frozen=True)
class Coverage:
    """The numbers that a case notices, and those that it does not notice.

    Attributes
    ----------
    case, key : str
        The name of the case, and a digest of all that the findings depend on.
    runs : tuple of CheckedRun
        How closely each solver of each run is checked.
    parameters, numbers : tuple of Finding
        Findings on the parameters of the reference, and on the numbers of the model.
    differing : tuple of str
        Channels that differ without a change, as ``run solver channel``; they are not used.
    reads_model : bool
        Whether the reference reads the model's own numbers.
    constant_channels : tuple of str
        Channels that must equal a number.
    left_out : str
        Why no number of the model was tried; empty if numbers were tried.
    seconds : float
        Wall time of the search [s].
    """

    case: str
    key: str
    runs: tuple[CheckedRun, ...]
    parameters: tuple[Finding, ...]
    numbers: tuple[Finding, ...]
    differing: tuple[str, ...] = ()
    reads_model: bool = False
    constant_channels: tuple[str, ...] = ()
    left_out: str = ""
    seconds: float = 0.0

    @property
    def noticed(self) -> list[Finding]:
        """The findings on noticed numbers, smallest change first, and refused changes last."""
        found = [one for one in self.numbers if one.noticed]
        return sorted(found, key=lambda one: (bool(one.refused), one.measure))

    @property
    def unnoticed(self) -> dict[str, list[Finding]]:
        """The findings on numbers that no run notices, by their kinds."""
        return group_by((one for one in self.numbers if not one.noticed), lambda one: one.kind)


def find_coverage(
    case: Case,
    jobs: int | None = None,
    progress: Callable[[str, int, int], None] = lambda *_: None,
    folder: Path | None = None,
) -> Coverage:
    """Find the numbers that a case notices; findings of an earlier call are used.

    The coverage is kept, unless one of the unchanged runs reached a limit of time or memory.

    Parameters
    ----------
    case : Case
    jobs : int, optional
        Number of runs at a time; that of the processors if not given.
    progress : callable, optional
        Called as ``progress(label, done, total)`` after each group of numbers.
    folder : Path, optional
        The folder of findings; `cache_folder` if not given.

    Returns
    -------
    Coverage

    Raises
    ------
    InputError
        The case cannot be run, or the folder has a file that proofmass did not write.
    """
    key = coverage_key(case)
    file = coverage_file(case, key, folder)
    case, recorded = with_computing_solvers(case)
    if not case.run:
        raise case.error(
            "run",
            f"{', '.join(recorded)}: no number of the model acts on curves that are recorded; a "
            "run needs an engine that computes",
        )
    stored = read_stored(file)
    if stored.coverage is not None:
        return stored.coverage
    begin = monotonic() - stored.seconds
    with interrupt_workers(), ThreadPoolExecutor(jobs or os.cpu_count() or 1) as pool:
        try:
            search = Search(case, pool)
            for done, total, label in search.run(stored.groups):
                stored.seconds = monotonic() - begin
                stored.write(file)
                progress(f"{case.name} {label}", done, total)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    found = [one for group in stored.groups.values() for one in group]
    stored.coverage = Coverage(
        case.name,
        key,
        tuple(search.checked()),
        tuple(search.parameters()),
        tuple(sorted(found, key=lambda one: list(NUMBER_KINDS).index(one.kind))),
        tuple(search.differing()),
        case.reads_model,
        case.constant_channels,
        search.left_out,
        monotonic() - begin,
    )
    if not search.limited:
        stored.write(file)
    return stored.coverage


def stored_coverage(case: Case, folder: Path | None = None) -> Coverage | None:
    """The stored coverage of a case in its present state; None if there is no complete one."""
    return read_stored(coverage_file(case, coverage_key(case), folder)).coverage


def cache_folder() -> Path:
    """The default folder of findings."""
    if given := os.environ.get(FOLDER_VARIABLE):
        return Path(given)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "proofmass"


def coverage_file(case: Case, key: str, folder: Path | None) -> Path:
    """The file of a case's findings."""
    return (
        (folder or cache_folder()) / "coverage" / f"{case.file.stem[:CASE_LETTERS]}-{key[:16]}.json"
    )


def coverage_key(case: Case) -> str:
    """SHA-256 of all that findings depend on: sidecar, model, reference, versions and sources."""
    case.require_model()
    files = set(files_of_model(case.model_path))
    engines = {engine for run in case.run.values() for engine in run.engines}
    parts = {
        "format": FINDINGS_VERSION,
        "sidecar": case.model_dump(mode="json", exclude={"file", "title", "source", "view"}),
        "model": [digest(file.read_bytes()) for file in sorted(files) if file.is_file()],
        "reference": digest_recorded_files(case),
        "versions": {engine: engine_versions(engine) for engine in sorted(engines)},
        "sources": digest_of_sources(),
    }
    return digest(json.dumps(parts, sort_keys=True).encode())


@cache
def digest_of_sources() -> str:
    """Digest of the sources that findings depend on, since these may change within a version."""
    package = Path(__file__).parents[1]
    return digest_sources(package / name for name in SOURCE_FILES)


def engine_versions(engine: str) -> dict[str, str]:
    """Versions of an engine; empty if it cannot be loaded, so that its runs fail."""
    try:
        engine_of(engine)
    except NoEngine:
        return {}
    return package_versions(engine)


@dataclass
class StoredFindings:
    """The content of a file of findings: groups by their labels, or the complete coverage."""

    format: int
    seconds: float = 0.0
    groups: dict[str, list[Finding]] = field(default_factory=dict)
    coverage: Coverage | None = None

    def write(self, file: Path) -> None:
        """Write the file."""
        file.parent.mkdir(parents=True, exist_ok=True)
        kept = replace(self, groups={}) if self.coverage else self
        write_atomically(file, STORED_FORMAT.dump_json(kept))


STORED_FORMAT = TypeAdapter(StoredFindings)
"""JSON of stored findings, in which numbers that are not finite are null."""


def read_stored(file: Path) -> StoredFindings:
    """Read a file of findings; the result is empty if there is no such file.

    Raises
    ------
    InputError
        The file was not written by proofmass, or changed since.
    """
    if not file.is_file():
        return StoredFindings(FINDINGS_VERSION)
    try:
        return STORED_FORMAT.validate_json(read_text(file))
    except ValueError:
        raise InputError(
            file, "", "not a file that proofmass explain wrote; delete it, and it is made again"
        ) from None
