"""Pages of studies: how they are written, and how the report links to them."""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from proofmass.base.errors import InputError
from proofmass.base.files import make_folder, read_bytes, read_text, write_output
from proofmass.case.case import Case
from proofmass.report.case_data import script_json
from proofmass.report.page import environment, report_facts, write_static


class StudyPages(NamedTuple):
    """The pages of a study: the first page, and links from its folder to the part on each case."""

    first: Path
    parts: dict[str, str]


T = TypeVar("T")


def require_table(folder: Path | str, name: str, command: str) -> Path:
    """Return the file of a study's table in a folder.

    Raises
    ------
    InputError
        There is no such file; the message names the command that writes it.
    """
    file = Path(folder) / name
    if not file.is_file():
        raise InputError(file, "", f"no such file; proofmass {command} writes it")
    return file


def read_results(file: Path, command: str, read: Callable[[dict[str, Any]], T]) -> T:
    """Read a file of JSON that a command wrote.

    Raises
    ------
    InputError
        Something else wrote it, so that `read` fails.
    """
    try:
        return read(json.loads(read_text(file)))
    except (ValueError, KeyError, TypeError):
        raise InputError(file, "", f"not what proofmass {command} wrote there") from None


STATIC = ("common.css", "study.css", "common.js", "study.js")
"""Files of the folder ``static`` that the pages of all studies load."""


def prepare_folder(output: Path, tables: Iterable[Path], scripts: Iterable[str] = ()) -> list[str]:
    """Make the folder of a study's pages, with copies of its tables; return their names.

    Style sheets and scripts are written as well: those of all studies, and `scripts` of this one.
    """
    make_folder(make_folder(output) / "figures")
    write_static(output, (*STATIC, *scripts))
    there = [table for table in tables if table.is_file()]
    for table in there:
        if table.parent.resolve() != output.resolve():
            write_output(output / table.name, read_bytes(table))
    return [table.name for table in there]


@dataclass(frozen=True)
class ShownStudy:
    """A study that the report links to.

    Attributes
    ----------
    title, what : str
        Title of the study, and a line on it.
    page : str
        Link to its first page, from the report's index.
    parts : dict of str to str
        Links to its parts on a case or a model, by the stems of their files.
    """

    title: str
    what: str
    page: str
    parts: dict[str, str]

    def of(self, case: Case) -> str:
        """Return the link to the part on a case or its model; empty if there is none."""
        return self.parts.get(case.name) or self.parts.get(case.model_path.stem, "")


@dataclass(frozen=True)
class PageWriter:
    """Writes the pages of a study from templates.

    Attributes
    ----------
    output : path
        Folder of the pages.
    home : str
        Link to the report that they are part of; empty if there is none.
    scripts : tuple of str
        Scripts of this study alone.
    """

    output: Path
    home: str = ""
    scripts: tuple[str, ...] = ()

    def write(self, file: str, template: str, data: Any = None, **shown: Any) -> Path:
        """Write one page; `data` is for the study's scripts, which only a page with data loads."""
        text = (
            environment()
            .get_template(template)
            .render(
                about=report_facts(),
                home=self.home,
                scripts=() if data is None else self.scripts,
                embedded=None if data is None else script_json(data),
                **shown,
            )
        )
        write_output(self.output / file, text)
        return self.output / file
