"""What all pages share: templates, versions, machine and commit, names of files, static files."""

import os
import platform
import re
import sys
from collections.abc import Iterable
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from proofmass.base.errors import InputError
from proofmass.base.files import OUTPUT_MARK, make_folder, write_output
from proofmass.base.wording import format_share, number
from proofmass.batch.check import Result
from proofmass.case.case import Case
from proofmass.report.commit import commit_of
from proofmass.report.words import SYMBOLS
from proofmass.sim.engines import (
    NoEngine,
    distribution_of_engine,
    engine_names,
    engine_of,
    hosted_names,
)


@cache
def environment() -> Environment:
    """Return the environment of the templates: autoescaped, and an unknown name is an error."""
    env = Environment(
        loader=PackageLoader("proofmass.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    env.filters["number"] = number
    env.filters["share"] = format_share
    env.globals["symbols"] = SYMBOLS
    env.globals["generator"] = OUTPUT_MARK
    return env


SLUG_DIGEST = 16  # hexadecimal digits of a digest in a `slug`, by which no two names meet
LONGEST_SLUG = 120
"""Characters of a `slug`: file systems allow names of 255, to which figures add their own words."""


def slug(name: str) -> str:
    """Return a name that is valid in file systems and links, and different for different names.

    The end of a long name is replaced by the digest of the name.

    >>> slug("left/arm"), slug("left_arm"), slug("four bär.2")
    ('left,arm', 'left_arm', 'four~20b~c3~a4r~2e2')
    >>> len(slug("long" * 1000))
    120
    """
    data = name.encode(errors="backslashreplace")
    found = re.sub(
        rb"[^A-Za-z0-9_-]",
        lambda one: b"," if one[0] == b"/" else b"~%02x" % one[0][0],
        data,
    ).decode()
    if len(found) <= LONGEST_SLUG:
        return found
    end = f"~~{sha256(data).hexdigest()[:SLUG_DIGEST]}"
    return found[: LONGEST_SLUG - len(end)] + end


def error_message(error: InputError) -> str:
    """Return the message of an input at fault, without the folders of this machine."""
    return str(error).replace(str(error.file), error.file.name)


def case_faults(case: Case, result: Result) -> list[str]:
    """Return the errors of a case's own files, among them a sweep that ended early."""
    return [error_message(e) for e in result.errors if e.file in (case.file, case.model_path)]


def packages_of(engine: str) -> list[str]:
    """Return the distributions of this interpreter that an engine's results depend on.

    There are none if it cannot be loaded.  Of an engine in another interpreter, which is not
    loaded, it is the distribution that brings it.
    """
    brought = [*filter(None, [distribution_of_engine(engine)])]
    if engine in hosted_names():
        return brought
    with suppress(NoEngine):
        return [*brought, *engine_of(engine).packages]
    return []


def read_versions() -> list[tuple[str, str]]:
    """Return the versions of all packages that the results depend on, and of Python."""
    return versions_with_engines((*engine_names(), *hosted_names()))


@cache
def versions_with_engines(engines: tuple[str, ...]) -> list[tuple[str, str]]:
    """Return `read_versions` from memory, since each page shows them."""
    found = []
    packages = [name for engine in engines for name in packages_of(engine)]
    for name in dict.fromkeys(("proofmass", *packages, "numpy", "scipy")):
        try:
            found.append((name, version(name)))
        except PackageNotFoundError:
            found.append((name, "not installed"))
    return [*found, ("python", platform.python_version())]


def report_facts() -> list[tuple[str, str]]:
    """Return versions, machine and date, without host name and paths."""
    return [
        *read_versions(),
        ("machine", f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors"),
        ("date", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"),
    ]


def case_facts(folder: Path) -> list[tuple[str, str]]:
    """Return `report_facts`, the commit of the folder of a model, and the command."""
    given = [word if not Path(word).is_absolute() else Path(word).name for word in sys.argv[1:]]
    command = ("command", " ".join([Path(sys.argv[0]).stem, *given]))
    commit = commit_of(folder)
    of_model = ("commit of the model", commit[:7])
    return [*report_facts(), *[of_model] * bool(commit), command]


UPLOT_FILES = {"uPlot.js": "uplot/static/uPlot.iife.js", "uPlot.css": "uplot/static/uPlot.min.css"}
"""Files of ``uplot-python``, which draws the curves of a page, by their names in ``static``."""


def write_static(folder: Path, names: Iterable[str]) -> None:
    """Write style sheets and scripts of all pages into the folder ``static`` beside them."""
    place = make_folder(folder / "static")
    for name in names:
        if name in UPLOT_FILES:  # located by metadata: an import of the package would load IPython
            text = Path(
                str(distribution("uplot-python").locate_file(UPLOT_FILES[name]))
            ).read_bytes()
        else:
            text = (files("proofmass.report") / "static" / name).read_bytes()
        write_output(place / name, text)
