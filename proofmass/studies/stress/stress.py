"""The study of extremes: how far each parameter can be varied, beside the theory's limits.

    store = Store(folder / "runs")
    with pool() as workers:
        problems = [cache_trials(one, store) for one in list_problems()]  # what theory knows
        found = stress(problems, workers)
        found += stress(extremes(case, store)[0], workers)
    write_boundaries(found, folder / "stress.csv")

Boundaries are looked for side by side; each trial is stored, so that a killed study goes on.
"""

import csv
import io
from collections.abc import Iterable
from concurrent.futures import Executor, as_completed
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, get_type_hints

from proofmass.errors import InputError
from proofmass.files import write_whole
from proofmass.studies.record import write_columns
from proofmass.studies.run import Progress
from proofmass.studies.store import Store, digest, once, sources, versions
from proofmass.studies.stress import problems
from proofmass.studies.stress.boundary import Boundary, BoundaryKind, Failure, TrialResult
from proofmass.studies.stress.limit_search import LimitSearch, TryValue

COLUMNS = {
    "what": "name of the sidecar, or a small model whose limit theory knows, in words",
    "engine": "name of the engine",
    "setting": "integrator, or what else is set, in words",
    "parameter": "what was varied",
    "unit": "of all values in the row; times: of what the case has",
    "start": "its first value",
    "reach": "its last value, if no run fails before",
    "holds": "the furthest value that held; empty if even `start` did not",
    "breaks": "the next that did not, at most 1 % further, 2 % if there is `again`, 10 % if "
    "`limit` is ours; empty if all held",
    "again": "the furthest beyond `breaks` that held again: some values between hold, others do "
    "not; empty if all that were tried beyond failed",
    "step": "time step that the engine took at `holds` [s]; empty if nothing was stepped in time",
    "theory": "where the boundary must be, inf or 0 for nowhere; empty if nothing is known",
    "law": "what theory says, in words",
    "limit": "what kind of limit it is; "
    + "; ".join(f"{one}: {one.sentence}" for one in BoundaryKind),
    "failure": "what went wrong there",
    "silent": "whether the engine itself said nothing",
    "measured": "root of holds times breaks, inf or 0 if there is no boundary up to `reach`; empty "
    "if `limit` is ours, or `start` did not hold",
    "ratio": "measured over theory; 1 where both say nowhere",
}


@dataclass(frozen=True)
class StoredTrial:
    """A trial whose outcomes are stored in a folder, a file each."""

    trial: TryValue
    folder: Path
    name: str

    def __call__(self, value: float) -> TrialResult:
        """The outcome for a value, found or made."""
        file = self.folder / f"{digest(f'{self.name} {value!r}'.encode())}.trial.json"
        failure, step = once(file, lambda: self.trial(value))
        return TrialResult(
            Failure(failure[0], BoundaryKind(failure[1]), failure[2]) if failure else None, step
        )


def cache_trials(search: LimitSearch, store: Store) -> LimitSearch:
    """A boundary of a small model, with its trials stored; cases store their own runs."""
    code = Path(str(problems.__file__)).read_text(encoding="utf-8")
    name = repr(
        (
            search.what,
            search.engine,
            search.setting,
            search.parameter,
            versions(search.engine),
            sources(),
            code,
        )
    )
    return replace(search, trial=StoredTrial(search.trial, store.folder, name))


def stress(
    searches: Iterable[LimitSearch], workers: Executor, progress: Progress = lambda *_: None
) -> list[Boundary]:
    """Find boundaries, side by side.

    Parameters
    ----------
    searches : iterable of LimitSearch
        From `proofmass.studies.stress.problems.list_problems` and
        `proofmass.studies.stress.extremes.extremes`.
    workers : Executor
        From `proofmass.studies.run.pool`.
    progress : callable
        Called as ``progress(label, done, total)`` after each boundary.

    Returns
    -------
    list of Boundary
        In the order of `searches`.
    """
    asked = list(searches)
    futures = {workers.submit(one.find): k for k, one in enumerate(asked)}
    found: dict[int, Boundary] = {}
    try:
        for future in as_completed(futures):
            k = futures[future]
            found[k] = future.result()
            progress(
                f"{asked[k].what} {asked[k].engine} {asked[k].parameter}", len(found), len(asked)
            )
    finally:
        for future in futures:
            future.cancel()
    return [found[k] for k in range(len(asked))]


def write_boundaries(found: Iterable[Boundary], file: Path) -> None:
    """Write a row for each boundary as CSV, and beside it ``NAME.columns.md``."""
    text = io.StringIO()
    rows = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    rows.writeheader()
    for one in found:
        cells = {**asdict(one), "measured": one.measured, "ratio": one.ratio}
        rows.writerow({key: "" if value != value else value for key, value in cells.items()})
    write_whole(file, text.getvalue())
    write_columns(file.with_suffix(".columns.md"), file.name, "boundary", COLUMNS)


def read_boundaries(file: Path) -> list[Boundary]:
    """The boundaries that `write_boundaries` wrote.

    Raises
    ------
    InputError
        A column is missing, as in the table of an earlier version.
    """
    kinds = get_type_hints(Boundary)
    with file.open(encoding="utf-8", newline="") as stream:
        reader = csv.DictReader(stream)
        for one in fields(Boundary):
            if one.name not in (reader.fieldnames or ()):
                raise InputError(
                    file,
                    "",
                    f"no column {one.name!r}: not the table that this version writes; run "
                    "proofmass stress again",
                )
        return [
            Boundary(**{f.name: parsed(cells[f.name], kinds[f.name]) for f in fields(Boundary)})
            for cells in reader
        ]


def parsed(cell: str, kind: type) -> Any:
    """A cell as what it was.

    >>> parsed("", float), parsed("True", bool), parsed("2.0", float)
    (nan, True, 2.0)
    """
    if kind is bool:
        return cell == "True"
    if kind is float:
        return float(cell or "nan")
    return kind(cell)
