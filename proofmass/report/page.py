"""What all pages share: the templates, the record of versions and machine, and names of files."""

import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterable
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from proofmass.case import Case
from proofmass.check import Result
from proofmass.engines import NoEngine, brought_by, engine_names, engine_of
from proofmass.errors import InputError
from proofmass.files import write_whole
from proofmass.report.words import SYMBOLS
from proofmass.wording import number


@cache
def environment() -> Environment:
    """The templates, autoescaped; an unknown name in them is an error."""
    env = Environment(
        loader=PackageLoader("proofmass.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    env.filters["number"] = number
    env.globals["symbols"] = SYMBOLS
    return env


def slug(name: str) -> str:
    """A name that any file system and any link can bear, another one for each name.

    >>> slug("left/arm"), slug("left_arm"), slug("four bär.2")
    ('left,arm', 'left_arm', 'four~20b~c3~a4r~2e2')
    """
    return re.sub(
        r"[^A-Za-z0-9_-]",
        lambda found: "," if found[0] == "/" else "".join(f"~{b:02x}" for b in found[0].encode()),
        name,
    )


def complaint(error: InputError) -> str:
    """The message of an input at fault, without the folders of the machine it was made on."""
    return str(error).replace(str(error.file), error.file.name)


def faults_of(case: Case, result: Result) -> list[str]:
    """What is wrong with a case's own files, a sweep that ended early among it."""
    return [complaint(e) for e in result.errors if e.file in (case.file, case.model_path)]


def packages_of(engine: str) -> list[str]:
    """The distributions that an engine's results come from; none of one that cannot be loaded."""
    with suppress(NoEngine):
        return [*filter(None, [brought_by(engine)]), *engine_of(engine).packages]
    return []


def versions() -> list[tuple[str, str]]:
    """The versions of what the numbers come from."""
    return known_versions(tuple(engine_names()))


@cache
def known_versions(engines: tuple[str, ...]) -> list[tuple[str, str]]:
    """`versions`, read once: each page tells them."""
    found = []
    packages = [name for engine in engines for name in packages_of(engine)]
    for name in dict.fromkeys(("proofmass", *packages, "numpy", "scipy")):
        try:
            found.append((name, version(name)))
        except PackageNotFoundError:
            found.append((name, "not installed"))
    return [*found, ("python", platform.python_version())]


def about() -> list[tuple[str, str]]:
    """Versions, machine and date; no host name, no paths."""
    return [
        *versions(),
        ("machine", f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors"),
        ("date", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"),
    ]


def made_with(folder: Path) -> list[tuple[str, str]]:
    """The same as `about`, with the command and the commit of the folder of a model."""
    given = [word if not Path(word).is_absolute() else Path(word).name for word in sys.argv[1:]]
    command = ("command", " ".join([Path(sys.argv[0]).stem, *given]))
    commit, edited = known_commit(folder)
    of_model = ("commit of the model", commit[:7] + "+" * edited)
    return [*about(), *[of_model] * bool(commit), command]


def commit_of(place: Path) -> tuple[str, bool]:
    """The commit of the working tree that a path lies in, and whether files differ from it."""
    folder = place if place.is_dir() else place.parent
    try:
        commit = git(folder, "rev-parse", "--verify", "HEAD")
        return commit, bool(git(folder, "status", "--porcelain", "--untracked-files=no"))
    except (OSError, subprocess.SubprocessError):
        return "", False


def git(folder: Path, *words: str) -> str:
    """What git answers in a folder."""
    found = subprocess.run(
        ["git", "-C", str(folder), *words], capture_output=True, text=True, timeout=10, check=True
    )
    return found.stdout.strip()


known_commit = cache(commit_of)
"""The same, asked once of each place: many cases lie in one folder."""
CURVES = {"uPlot.js": "uplot/static/uPlot.iife.js", "uPlot.css": "uplot/static/uPlot.min.css"}
"""Files of the package ``uplot-python``, which draws the curves of a page, by their new names."""


def write_static(folder: Path, names: Iterable[str]) -> None:
    """Write style sheets and scripts into the folder ``static`` beside the pages, once for all."""
    (folder / "static").mkdir(parents=True, exist_ok=True)
    for name in names:
        if name in CURVES:  # found by its record: importing the package would load IPython
            text = Path(str(distribution("uplot-python").locate_file(CURVES[name]))).read_bytes()
        else:
            text = (files("proofmass.report") / "static" / name).read_bytes()
        write_whole(folder / "static" / name, text)
