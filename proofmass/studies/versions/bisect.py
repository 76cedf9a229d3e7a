"""Find the releases in which cases changed, with few runs: nothing is looked for in equal ends.

If two versions have the same result, those between them count as the same, so that a change which a
later release takes back is missed.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from proofmass.studies.cells import CellResult, MeasuredCell, stored_cell, stored_curves
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.versions.changes import VersionChange, find_change

MakeCell = Callable[[str], MeasuredCell]
"""The cell of a case in a version."""


@dataclass
class VersionSeries:
    """The results of a case in some versions.

    Attributes
    ----------
    name : str
    cell : callable
        ``cell(version)``
    versions : tuple of str
        All versions, the oldest first.
    results : dict of int to CellResult
        Those that were measured, by the places of their versions.
    """

    name: str
    cell: MakeCell
    versions: tuple[str, ...]
    results: dict[int, CellResult] = field(default_factory=dict)

    def wanted(self, every: bool, store: Store) -> list[int]:
        """Places of versions to measure next: the ends, then the middle of what changed."""
        last = len(self.versions) - 1
        ends = list(range(last + 1)) if every else [0, last]
        if missing := [k for k in dict.fromkeys(ends) if k not in self.results]:
            return missing
        return [
            (one + two) // 2
            for one, two in self.intervals()
            if two - one > 1 and self.change(one, two, store)
        ]

    def intervals(self) -> Iterator[tuple[int, int]]:
        """Neighbours among the measured places."""
        places = sorted(self.results)
        yield from pairwise(places)

    def change(self, one: int, two: int, store: Store) -> VersionChange | None:
        """What changed between two measured places."""
        cells = self.cell(self.versions[one]), self.cell(self.versions[two])
        found = find_change(
            self.results[one], self.results[two], *(stored_curves(c, store) for c in cells)
        )
        return found and replace(found, adjacent=two - one == 1)

    def changes(self, store: Store) -> list[VersionChange]:
        """The changes between neighbours, the oldest first."""
        every = (self.change(one, two, store) for one, two in self.intervals())
        return [one for one in every if one]


def measure_versions(series: Sequence[VersionSeries], study: Study, every: bool = False) -> None:
    """Measure until each change lies between neighbours, or every version.

    The results are added to the series.  `study.progress` is called after each run.
    """
    done = 0
    while wanted := [(one, k) for one in series for k in one.wanted(every, study.store)]:
        calls = [(one.cell(one.versions[k]), study.store) for one, k in wanted]
        for place, result in study.results(stored_cell, calls):
            one, k = wanted[place]
            one.results[k] = result
            done += 1
            study.progress(f"{one.name} {one.versions[k]}", done, done + len(calls))
