"""Write the pages of studies into the folder of a report, which links to them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.report.study import ShownStudy, StudyPages
from proofmass.studies.diet.page import write_diet
from proofmass.studies.engines.page import write_engines
from proofmass.studies.stress.page import write_stress
from proofmass.studies.trade.page import write_trade
from proofmass.studies.versions.page import write_versions

PageFunction = Callable[[Path, Path, str], StudyPages]
HOME_LINK = "../index.html"


@dataclass(frozen=True)
class StudyKind:
    """A kind of study: the file that identifies its folder, and the function for its pages."""

    name: str
    table: str
    title: str
    what: str
    write: PageFunction


STUDY_KINDS = (
    StudyKind(
        "trade",
        "trade.csv",
        "What accuracy costs",
        "errors against processor time, orders, error floors and their causes",
        write_trade,
    ),
    StudyKind(
        "stress",
        "stress.csv",
        "Where it breaks",
        "boundaries found by bisection, compared with theory where there is one",
        write_stress,
    ),
    StudyKind(
        "diet",
        "diet.columns.md",
        "What a scene needs",
        "features removed one by one, what that saves and what it changes",
        write_diet,
    ),
    StudyKind(
        "engines",
        "engines.json",
        "Cases beside engines",
        "errors of each engine in each case, and where it refuses, crashes or is silently wrong",
        write_engines,
    ),
    StudyKind(
        "versions",
        "versions.json",
        "What changed between versions",
        "errors of each case in several versions of an engine, and the versions that changed them",
        write_versions,
    ),
)


def write_study_pages(folders: Iterable[Path], output: Path) -> list[ShownStudy]:
    """Write the pages of studies into the folder of a report, from the tables of the studies.

    Raises
    ------
    InputError
        A folder has no study, or two studies are of the same kind.
    """
    asked: dict[str, tuple[StudyKind, Path]] = {}
    for folder in folders:
        kind = next((k for k in STUDY_KINDS if (folder / k.table).is_file()), None)
        if kind is None:
            raise InputError(
                folder,
                "",
                "no study is there; proofmass trade, stress and diet "
                f"write {', '.join(k.table for k in STUDY_KINDS)} into theirs",
            )
        if kind.name in asked:
            raise InputError(
                folder, "", f"a second {kind.name} study; give one folder of each kind"
            )
        asked[kind.name] = kind, folder
    return [write_one_study(kind, folder, output) for kind, folder in asked.values()]


def write_one_study(kind: StudyKind, folder: Path, output: Path) -> ShownStudy:
    """Write the pages of one study; return its entry and links for the report."""
    pages = kind.write(folder, output / kind.name, HOME_LINK)
    links = {name: f"{kind.name}/{link}" for name, link in pages.parts.items()}
    return ShownStudy(kind.title, kind.what, f"{kind.name}/{pages.first.name}", links)
