"""``proofmass stress``: limits of engines by measurement, and by theory where it is known.

    study = Study(Store(folder / "runs"))
    searches = [store_trials(one, study.store) for one in list_problems()]  # with known theory
    searches += list_extremes(case, study)[0]
    with study.working() as working:
        write_boundaries(find_boundaries(searches, working), folder / "stress.csv")

Several boundaries are searched for at a time.  The result of each trial is stored, so a study that
was stopped can be continued.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from rich.table import Table

from proofmass.base.wording import number
from proofmass.studies.store import Store, digest, digest_of_sources, package_versions
from proofmass.studies.stress import problems
from proofmass.studies.stress.boundary import (
    Boundary,
    BoundaryKind,
    Failure,
    TrialResult,
)
from proofmass.studies.stress.limit_search import LimitSearch, TryValue
from proofmass.studies.study import Study


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


def cause_lines(found: Iterable[Boundary]) -> Iterator[str]:
    """Lines for standard output below the table: what breaks at stable steps, and what to do."""
    for one in found:
        if one.remedy:
            yield f"{one.what}, {one.setting}, {one.parameter}: {one.law}; to do: {one.remedy}"


@dataclass(frozen=True)
class StoredTrial:
    """A trial whose results are stored, in one file for each value."""

    trial: TryValue
    store: Store
    name: str

    def __call__(self, value: float) -> TrialResult:
        """The result for a value, read from its file or made now."""
        name = f"{digest(f'{self.name} {value!r}'.encode())}.trial.json"
        failure, step = self.store.value(name, lambda: self.trial(value))
        return TrialResult(
            Failure(failure[0], BoundaryKind(failure[1]), failure[2]) if failure else None, step
        )


def store_trials(search: LimitSearch, store: Store) -> LimitSearch:
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
    return replace(search, trial=StoredTrial(search.trial, store, name))


def find_boundaries(searches: Iterable[LimitSearch], study: Study) -> list[Boundary]:
    """Find boundaries, several at a time.

    Parameters
    ----------
    searches : iterable of LimitSearch
        The searches, from `proofmass.studies.stress.problems.list_problems` and
        `proofmass.studies.stress.extremes.list_extremes`.
    study : Study
        Has the workers, and the progress, which is called after each boundary.

    Returns
    -------
    list of Boundary
        The boundaries, in the order of `searches`.
    """
    asked = list(searches)
    found: dict[int, Boundary] = {}
    for k, boundary in study.results(LimitSearch.find, [(one,) for one in asked]):
        found[k] = boundary
        label = f"{boundary.what} {boundary.engine} {boundary.parameter}"
        study.progress(label, len(found), len(asked))
    return [found[k] for k in range(len(asked))]
