"""The page of a comparison of versions: what changed in which version, and the errors of each case.

It is written from ``versions.json``, so that a report can write it again.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from proofmass.base.json_values import restore_nan
from proofmass.base.wording import format_count
from proofmass.report.page import slug
from proofmass.report.study import (
    PageWriter,
    StudyPages,
    prepare_folder,
    read_results,
    require_table,
)
from proofmass.sim.engines import format_solver
from proofmass.studies.cells import CellResult
from proofmass.studies.versions.changes import VersionChange, version_of
from proofmass.studies.versions.table import (
    change_cells,
    date_lines,
    result_cell,
)

VERSIONS_TABLE = "versions.json"


@dataclass(frozen=True)
class Stage:
    """Versions in a row between two changes, and the result of one of them.

    Attributes
    ----------
    versions : str
        Such as ``3.2.0 to 3.6.0``.
    words : str
        Errors of positions, velocities and accelerations as shares of the range, or an outcome.
    state : str
        ``better``, ``worse`` or empty: beside the stage before.
    """

    versions: str
    words: str
    state: str


def write_versions(folder: Path | str, output: Path | str, home: str = "") -> StudyPages:
    """Write the page of a comparison, ``index.html``, from its file ``versions.json``.

    Raises
    ------
    InputError
        There is no such file in the folder, or something else wrote it.
    """
    file, output = require_table(folder, VERSIONS_TABLE, "versions"), Path(output)
    data = read_comparison(file)
    prepare_folder(output, (file,))
    changes: list[VersionChange] = data["changes"]
    results: list[CellResult] = data["results"]
    cases = list(dict.fromkeys(one.case for one in results))
    rows = [
        (name, slug(name), list(stages_of(name, results, changes, data["versions"])))
        for name in cases
    ]
    changed = {one.case for one in changes}
    rows.sort(key=lambda row: row[0] not in changed)
    page = PageWriter(output, home).write(
        "index.html",
        "versions.html",
        tones=(),
        engine=format_solver(data["engine"]),
        versions=data["versions"],
        dates=list(date_lines(changes)),
        changes=[change_cells(one) for one in changes],
        rows=rows,
        stages=max((len(row[2]) for row in rows), default=0),
        count=f"{format_count(len(changed), 'case')} of {len(cases)}",
        table=VERSIONS_TABLE,
    )
    return StudyPages(page, {name: f"index.html#{slug(name)}" for name in cases})


def read_comparison(file: Path) -> dict[str, Any]:
    """The content of a ``versions.json`` with its records as objects."""

    def read(data: dict[str, Any]) -> dict[str, Any]:
        records = [restore_nan(one) for one in data["changes"]]
        changes = [
            VersionChange(**{key: one[key] for key in one if key != "factor"}) for one in records
        ]
        results = [CellResult.read(one) for one in data["results"]]
        return data | {"changes": changes, "results": results}

    return read_results(file, "versions", read)


def stages_of(
    name: str,
    results: Sequence[CellResult],
    changes: Sequence[VersionChange],
    versions: Sequence[str],
) -> Iterator[Stage]:
    """The stages of a case: what it was between its changes."""
    own = {version_of(one.solver): one for one in results if one.case == name}
    starts = [versions[0], *(one.after for one in changes if one.case == name)]
    ends = [*(one.before for one in changes if one.case == name), versions[-1]]
    states = ["", *(state_of(one) for one in changes if one.case == name)]
    for first, last, state in zip(starts, ends, states, strict=True):
        shown = own.get(last) or own.get(first)
        yield Stage(first if first == last else f"{first} to {last}", result_cell(shown), state)


def state_of(change: VersionChange) -> str:
    """What a change makes of a case: ``better``, ``worse``, or ``other`` if the motion moved."""
    if change.is_other:
        return "other"
    return "worse" if change.is_worse else "better"
