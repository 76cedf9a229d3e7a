"""The shipped files in `models/` by name; names are unique, so tests need not know the folders."""

import re
import tomllib
from functools import cache
from pathlib import Path

import pytest

from proofmass.case.case import Case
from proofmass.run.sidecar import format_sidecar, load_case

MODELS = Path(__file__).parent.parent / "models"
READ_CASES: dict[Path, Case] = {}
"""Shipped cases by file, including those that were read to collect the items of sidecars."""


def shipped_case(file: Path) -> Case:
    """A shipped case, which is read once in a run of the tests; no test may change it."""
    if file not in READ_CASES:
        READ_CASES[file] = load_case(file)
    return READ_CASES[file]


@cache
def shipped(name: str) -> Path:
    """The path of the file with this name below `models/`."""
    (file,) = MODELS.rglob(name)
    return file


def fewer_samples(n: int) -> int:
    """About a tenth of n samples of a sweep; reversals of up to two cycles to and fro remain.

    >>> [fewer_samples(n) for n in (97, 145, 181, 361)]
    [13, 17, 21, 37]
    """
    tenth = max((d for d in range(1, 11) if (n - 1) % (4 * d) == 0), default=0)
    return (n - 1) // tenth + 1 if tenth else n // 10


def shipped_files(pattern: str = "*.toml") -> list[Path]:
    """The files below `models/` whose names match a pattern, sorted by name."""
    return sorted(MODELS.rglob(pattern), key=lambda file: file.name)


def sidecar_parameters() -> list:
    """The shipped sidecars as parameters of a test; all but one of each reference are slow."""
    seen, found = set[str](), []
    for file in shipped_files():
        reference = tomllib.loads(file.read_text(encoding="utf-8"))["reference"]
        marks = [pytest.mark.slow] if reference in seen else []
        found.append(pytest.param(file, id=file.stem, marks=marks))
        seen.add(reference)
    return found


def with_brief_pendulum(models: Path) -> Path:
    """Shorten the run of the copied pendulum from 10 s to 1 s; return the folder of the models."""
    sidecar = models / "pendulum.toml"
    text = sidecar.read_text()
    assert "until = 10.0" in text
    assert "n = 1001" in text
    sidecar.write_text(text.replace("until = 10.0", "until = 1.0").replace("n = 1001", "n = 101"))
    return models


@cache
def all_file_contents() -> dict[str, bytes]:
    """The contents of the files below `models/`, with sidecars as `without_defaults` gives them."""
    return {
        file.name: without_defaults(file).encode() if file.suffix == ".toml" else file.read_bytes()
        for file in shipped_files("*.*")
    }


@cache
def without_defaults(file: Path) -> str:
    """The text of a sidecar in which the keys that it leaves to defaults follow its own lines."""
    text = file.read_text(encoding="utf-8")
    if re.search(r"equals = .*unit = ", text):
        return text
    head = re.split(
        r"(?m)^\[(?:run\b|channels\]|settings\b)", re.sub(r"(?m)^accuracy\..*\n", "", text)
    )[0]
    filled = format_sidecar(shipped_case(file), every=False)
    return f"{head.rstrip()}\n\n{filled[filled.index('[run.') :]}"
