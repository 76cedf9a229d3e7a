"""``proofmass stress``: limits of engines by measurement, and by theory where it is known.

    store = Store(folder / "runs")
    with pool() as workers:
        problems = [cache_trials(one, store) for one in list_problems()]  # with known theory
        found = stress(problems, workers)
        found += stress(extremes(case, store)[0], workers)
    write_boundaries(found, folder / "stress.csv")

Several boundaries are searched for at a time.  The result of each trial is stored, so a study that
was stopped can be continued.
"""

from collections.abc import Iterable
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

from rich.table import Table

from proofmass.base.wording import number
from proofmass.studies.run import Progress
from proofmass.studies.store import Store, digest, digest_of_sources, package_versions, read_or_make
from proofmass.studies.stress import problems
from proofmass.studies.stress.boundary import (
    Boundary,
    BoundaryKind,
    Failure,
    TrialResult,
)
from proofmass.studies.stress.limit_search import LimitSearch, TryValue


def result_table(found: list[Boundary]) -> Table:
    """The table for standard output: a row for each boundary, and the meaning of the limits."""
    table = Table(
        box=None,
        header_style="bold",
        pad_edge=False,
        caption_justify="left",
        caption="\n".join(
            f"{kind}: {kind.sentence}"
            for kind in BoundaryKind
            if any(one.limit == kind for one in found)
        ),
    )
    for name in (
        "what",
        "engine",
        "setting",
        "parameter",
        "boundary",
        "theory",
        "ratio",
        "how it breaks",
    ):
        right = name in ("boundary", "theory", "ratio")
        table.add_column(name, justify="right" if right else "left", no_wrap=right)
    for one in found:
        known = one.theory == one.theory
        table.add_row(
            one.what,
            one.engine,
            one.setting,
            one.parameter,
            one.describe(one.unit),
            number(one.theory) if known else "",
            number(one.ratio) if known else "",
            one.ending,
        )
    return table


@dataclass(frozen=True)
class StoredTrial:
    """A trial whose results are stored in a folder, in one file for each value."""

    trial: TryValue
    folder: Path
    name: str

    def __call__(self, value: float) -> TrialResult:
        """The result for a value, read from its file or made now."""
        file = self.folder / f"{digest(f'{self.name} {value!r}'.encode())}.trial.json"
        failure, step = read_or_make(file, lambda: self.trial(value))
        return TrialResult(
            Failure(failure[0], BoundaryKind(failure[1]), failure[2]) if failure else None, step
        )


def cache_trials(search: LimitSearch, store: Store) -> LimitSearch:
    """The search with its trials stored; for small models, since cases store their own runs."""
    code = Path(str(problems.__file__)).read_text(encoding="utf-8")
    name = repr(
        (
            search.what,
            search.engine,
            search.setting,
            search.parameter,
            package_versions(search.engine),
            digest_of_sources(),
            code,
        )
    )
    return replace(search, trial=StoredTrial(search.trial, store.folder, name))


def find_boundaries(
    searches: Iterable[LimitSearch], workers: Executor, progress: Progress = lambda *_: None
) -> list[Boundary]:
    """Find boundaries, several at a time.

    Parameters
    ----------
    searches : iterable of LimitSearch
        The searches, from `proofmass.studies.stress.problems.list_problems` and
        `proofmass.studies.stress.extremes.list_extremes`.
    workers : Executor
        The worker processes, from `proofmass.studies.run.pool`.
    progress : callable
        Called as ``progress(label, done, total)`` after each boundary.

    Returns
    -------
    list of Boundary
        The boundaries, in the order of `searches`.
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
