"""A study as the report shows it: its pages, links to them, and its tables beside them."""

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from proofmass.case import Case
from proofmass.files import write_whole
from proofmass.report.case_data import embedded
from proofmass.report.page import about, environment, write_static


class Written(NamedTuple):
    """The pages of a study: the first, and links from there to what it says of each case."""

    first: Path
    parts: dict[str, str]


STATIC = ("common.css", "study.css", "common.js", "study.js")
"""What the pages of all studies load from the folder ``static`` beside them."""


def prepared(output: Path, tables: Iterable[Path], scripts: Iterable[str] = ()) -> list[str]:
    """Make the folder of a study's pages, with copies of its tables; their names there.

    Style sheets and scripts, and those of this study alone, are written beside the pages.
    """
    (output / "figures").mkdir(parents=True, exist_ok=True)
    write_static(output, (*STATIC, *scripts))
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


@dataclass(frozen=True)
class Pages:
    """Writes the pages of a study from templates, which have much in common.

    Attributes
    ----------
    output : path
        Folder of the pages.
    home : str
        Link to the report that they are part of; empty if there is none.
    scripts : tuple of str
        Of this study alone.
    """

    output: Path
    home: str = ""
    scripts: tuple[str, ...] = ()

    def write(self, file: str, template: str, data: Any = None, **shown: Any) -> Path:
        """Write one page; `data` is for its scripts, and a page without it loads none of them."""
        text = (
            environment()
            .get_template(template)
            .render(
                about=about(),
                home=self.home,
                scripts=() if data is None else self.scripts,
                embedded=None if data is None else embedded(data),
                **shown,
            )
        )
        write_whole(self.output / file, text)
        return self.output / file
