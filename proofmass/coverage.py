"""Which wrong numbers of a model a case would notice, and from which change on.

Each number of the compiled model is changed in what the engines get, and the runs are held against
the reference and the tolerances of the case.  A change is noticed where a channel differs that
agreed before, or where the run is refused or failed.  A reference that reads the model itself reads
the changed one, as it does in `proofmass check`: such a case notices a number by its laws alone.

What was found is kept in a folder, a file for each case, which is written after each group of
numbers: `coverage_of` goes on where it was stopped, `stored_coverage` reads what is there.
"""

import json
import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from time import monotonic
from typing import Any

import mujoco

from proofmass.case import Case
from proofmass.coverage_search import CheckedRun, Finding, Search
from proofmass.engines import NoEngine, engine_of
from proofmass.errors import InputError
from proofmass.files import read_text, write_whole
from proofmass.fingerprint import digest, recorded_bytes, sources_with, versions
from proofmass.reference import reads_model
from proofmass.sim.numbers import KINDS
from proofmass.solve import with_computing_solvers
from proofmass.terminal import finite
from proofmass.worker import stopping

FORMAT = 1
"""Of the files of findings."""
FOLDER = "PROOFMASS_CACHE"
"""Environment variable: the folder of what was found; ``~/.cache/proofmass`` if it is not set."""
OWN = "changed", "compare", "coverage", "coverage_search", "drive", "reference", "solve"
"""Modules of the core that a finding depends on."""


@dataclass(frozen=True)
class Coverage:
    """What a case notices, and what it does not.

    Attributes
    ----------
    case, key : str
        The case, and what the findings depend on, as a digest.
    runs : tuple of CheckedRun
    parameters, numbers : tuple of Finding
        Of the reference, and of the model.
    differing : tuple of str
        Channels that differ already, ``run solver channel``; they are asked nothing.
    reads_model : bool
        Whether the reference reads the model's own numbers.
    laws : tuple of str
        Channels that must equal a number.
    left_out : str
        Why no number of the model was tried; empty if they were.
    seconds : float
        Wall time that it took [s].
    """

    case: str
    key: str
    runs: tuple[CheckedRun, ...]
    parameters: tuple[Finding, ...]
    numbers: tuple[Finding, ...]
    differing: tuple[str, ...] = ()
    reads_model: bool = False
    laws: tuple[str, ...] = ()
    left_out: str = ""
    seconds: float = 0.0

    @property
    def noticed(self) -> list[Finding]:
        """The numbers that are noticed, the most sensitive first, refused ones last."""
        found = [one for one in self.numbers if one.noticed]
        return sorted(found, key=lambda one: (bool(one.refused), one.measure))

    @property
    def unnoticed(self) -> dict[str, list[Finding]]:
        """The numbers that no run notices, by their kinds."""
        found: dict[str, list[Finding]] = {}
        for one in self.numbers:
            if not one.noticed:
                found.setdefault(one.kind, []).append(one)
        return found


def coverage_of(
    case: Case,
    jobs: int | None = None,
    progress: Callable[[str, int, int], None] = lambda *_: None,
    folder: Path | None = None,
) -> Coverage:
    """Find out what a case notices; what was found before is not tried again.

    It is kept, unless one of the runs reached a limit of time or memory as it is.

    Parameters
    ----------
    case : Case
    jobs : int, optional
        Runs side by side; as many as there are processors when not given.
    progress : callable, optional
        Called as ``progress(label, done, total)`` after each group of numbers.
    folder : Path, optional
        Where findings are kept; `cache_folder` if not given.

    Returns
    -------
    Coverage

    Raises
    ------
    InputError
        The case cannot be run; the folder has a file that something else has written.
    """
    key = key_of(case)
    file = file_of(case, key, folder)
    case, others = with_computing_solvers(case)
    if not case.run:
        raise InputError(
            case.file,
            "run",
            f"{', '.join(others)}: no number of the model acts on curves that are recorded; a run "
            "needs an engine that computes",
        )
    kept = read_kept(file)
    if kept.coverage is not None:
        return kept.coverage
    begin = monotonic() - kept.seconds
    with stopping(), ThreadPoolExecutor(jobs or os.cpu_count() or 1) as pool:
        try:
            search = Search(case, pool)
            for done, total, label in search.run(kept.groups):
                kept.seconds = monotonic() - begin
                kept.write(file)
                progress(f"{case.name} {label}", done, total)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    found = [one for group in kept.groups.values() for one in group]
    kept.coverage = Coverage(
        case.name,
        key,
        tuple(search.checked()),
        tuple(search.parameters()),
        tuple(sorted(found, key=lambda one: list(KINDS).index(one.kind))),
        tuple(search.differing()),
        reads_model(case),
        case.laws,
        search.left_out,
        monotonic() - begin,
    )
    if not search.limited:
        kept.write(file)
    return kept.coverage


def stored_coverage(case: Case, folder: Path | None = None) -> Coverage | None:
    """What was found of a case as it is now; None if that was not asked, or not to its end."""
    return read_kept(file_of(case, key_of(case), folder)).coverage


def cache_folder() -> Path:
    """Where findings are kept."""
    if given := os.environ.get(FOLDER):
        return Path(given)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "proofmass"


def file_of(case: Case, key: str, folder: Path | None) -> Path:
    """The file of a case's findings."""
    return (folder or cache_folder()) / "coverage" / f"{case.name}-{key[:16]}.json"


def key_of(case: Case) -> str:
    """SHA-256 of all that findings depend on: sidecar, model, reference, versions, sources."""
    case.require_model()
    model = str(case.model_path)
    files = {Path(file) for file in (model, *mujoco.mju_getXMLDependencies(model))}
    engines = {solver.partition(":")[0] for run in case.run.values() for solver in run.solvers}
    parts = {
        "format": FORMAT,
        "sidecar": case.model_dump(mode="json", exclude={"file", "title", "source", "view"}),
        "model": [digest(file.read_bytes()) for file in sorted(files) if file.is_file()],
        "reference": recorded_bytes(case),
        "versions": {engine: versions_of(engine) for engine in sorted(engines)},
        "sources": own_sources(),
    }
    return digest(json.dumps(parts, sort_keys=True).encode())


@cache
def own_sources() -> str:
    """Digest of what finds and judges; a version stays while it is developed."""
    return sources_with(Path(__file__).with_name(f"{name}.py") for name in OWN)


def versions_of(engine: str) -> dict[str, str]:
    """Versions of an engine; none of one that cannot be loaded, whose runs fail."""
    try:
        engine_of(engine)
    except NoEngine:
        return {}
    return versions(engine)


@dataclass
class Kept:
    """What a file of findings holds: groups by their labels, and all of it once it is complete."""

    groups: dict[str, list[Finding]] = field(default_factory=dict)
    coverage: Coverage | None = None
    seconds: float = 0.0

    def write(self, file: Path) -> None:
        """Write the file."""
        file.parent.mkdir(parents=True, exist_ok=True)
        table = {
            "format": FORMAT,
            "seconds": self.seconds,
            "groups": {}
            if self.coverage
            else {
                label: [finite(asdict(one)) for one in found]
                for label, found in self.groups.items()
            },
            "coverage": finite(asdict(self.coverage)) if self.coverage else None,
        }
        write_whole(file, json.dumps(table, allow_nan=False))


def read_kept(file: Path) -> Kept:
    """What a file holds; nothing if it is not there.

    Raises
    ------
    InputError
        Something else has changed it.
    """
    if not file.is_file():
        return Kept()
    try:
        table = json.loads(read_text(file))
        groups = {label: list(map(finding, found)) for label, found in table["groups"].items()}
        whole = table["coverage"]
        return Kept(groups, coverage_from(whole) if whole else None, float(table["seconds"]))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(
            file, "", "not what proofmass explain wrote there; delete it, and it is made again"
        ) from None


def finding(table: dict[str, Any]) -> Finding:
    """A finding from its table."""
    values: dict[str, Any] = {k: math.nan if v is None else v for k, v in table.items()}
    return Finding(**values)


def coverage_from(table: dict[str, Any]) -> Coverage:
    """All of it from its table, as `dataclasses.asdict` makes it."""
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in table.items()}
    values["runs"] = tuple(map(checked_run, table["runs"]))
    for key in ("parameters", "numbers"):
        values[key] = tuple(map(finding, table[key]))
    return Coverage(**values)


def checked_run(table: dict[str, Any]) -> CheckedRun:
    """A run from its table."""
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in table.items()}
    return CheckedRun(**values)
