"""A study as the report shows it: its pages, links to them, and its tables beside them."""

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from proofmass.case import Case


class Written(NamedTuple):
    """The pages of a study: the first, and links from there to what it says of each case."""

    first: Path
    parts: dict[str, str]


def prepared(output: Path, tables: Iterable[Path]) -> list[str]:
    """Make the folder of a study's pages, with copies of its tables; their names there."""
    (output / "figures").mkdir(parents=True, exist_ok=True)
    there = [table for table in tables if table.is_file()]
    for table in there:
        if table.parent.resolve() != output.resolve():
            shutil.copyfile(table, output / table.name)
    return [table.name for table in there]


@dataclass(frozen=True)
class ShownStudy:
    """A study as the report shows it.

    Attributes
    ----------
    title, what : str
    page : str
        Link to its first page, from the report's index.
    parts : dict of str to str
        Links to what it says of a case or of a model, by the stems of their files.
    """

    title: str
    what: str
    page: str
    parts: dict[str, str]

    def of(self, case: Case) -> str:
        """The link to what it says of a case or of its model; empty if it says nothing."""
        return self.parts.get(case.name) or self.parts.get(case.model_path.stem, "")
