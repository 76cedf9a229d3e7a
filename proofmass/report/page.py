"""What all pages share: the templates, the record of versions and machine, and names of files."""

import os
import platform
import re
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version

from jinja2 import Environment, PackageLoader, StrictUndefined

from proofmass.engines import NoEngine, brought_by, engine_names, engine_of
from proofmass.errors import InputError
from proofmass.report.words import SYMBOLS
from proofmass.wording import number


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
    """A name that any file system and any link can bear.

    >>> slug("four bar/ö")
    'four_bar__'
    """
    return re.sub(r"[^A-Za-z0-9_-]", "_", name)


def complaint(error: InputError) -> str:
    """The message of an input at fault, without the folders of the machine it was made on."""
    return str(error).replace(str(error.file), error.file.name)


def packages_of(engine: str) -> list[str]:
    """The distributions that an engine's results come from; none of one that cannot be loaded."""
    with suppress(NoEngine):
        return [*filter(None, [brought_by(engine)]), *engine_of(engine).packages]
    return []


def about() -> list[tuple[str, str]]:
    """Versions, machine and date; no host name, no paths."""
    found = []
    engines = [name for engine in engine_names() for name in packages_of(engine)]
    for name in dict.fromkeys(("proofmass", *engines, "numpy", "scipy")):
        try:
            found.append((name, version(name)))
        except PackageNotFoundError:
            found.append((name, "not installed"))
    return [
        *found,
        ("python", platform.python_version()),
        ("machine", f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors"),
        ("date", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"),
    ]
