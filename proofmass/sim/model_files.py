"""The files of a model: its own, and those that it includes or names; none is compiled."""

import os
import re
from pathlib import Path

from proofmass.base.files import content_key, read_bytes
from proofmass.base.read_once import read_once

FILE_ATTRIBUTE = re.compile(rb"\bfile\w*\s*=\s*([\"'])([^\"'\0]+)\1")
FOLDER_ATTRIBUTE = re.compile(rb"\b(?:asset|mesh|texture)dir\s*=\s*([\"'])([^\"'\0]+)\1")
MODEL_ENDINGS = (".xml", ".mjcf", ".urdf")
"""Endings of files that may name other files; meshes and pictures are not searched for names."""


def files_of_model(path: Path) -> list[Path]:
    """The file of a model, and the files that it or a file of it names: includes, meshes, others.

    A name is looked for in the folder of the model and in all folders that the model names, so that
    the list may have files that the compiler does not read.
    """
    found, waiting, folders = list[Path](), [path.absolute()], [path.absolute().parent]
    while waiting:
        file = waiting.pop()
        if file in found or not file.is_file():
            continue
        found.append(file)
        if file.suffix in MODEL_ENDINGS:
            places, names = named_in(file)
            folders += [folder / place for folder in (file.parent, folders[0]) for place in places]
            waiting += [folder / name for folder in (file.parent, *folders) for name in names]
    return found


@read_once()
def named_in(file: Path) -> tuple[list[str], list[str]]:
    """The folders and the files that a model names."""
    text = read_bytes(file)
    return tuple(  # type: ignore[return-value]
        [os.fsdecode(words[1]) for words in pattern.findall(text)]
        for pattern in (FOLDER_ATTRIBUTE, FILE_ATTRIBUTE)
    )


def model_key(path: Path) -> tuple[str, ...]:
    """The digests of the files of a model, see `files_of_model`, by which `read_once` knows it."""
    return tuple(map(content_key, files_of_model(path)))
