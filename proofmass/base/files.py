"""Reading and writing files.

A file that cannot be read is bad input.  A file is written as a whole or not at all.  What a
command writes replaces only files that proofmass wrote, and never an input, see `write_output`.
"""

import os
import stat
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from secrets import token_hex
from threading import Lock

from proofmass.base.errors import InputError

MODEL_ENDING, URDF_ENDING = ".xml", ".urdf"
"""Endings of the files of models that are looked for in folders: MJCF and URDF."""
PARTIAL_ENDING = ".part"  # ending of the name of a file that is being written


def read_bytes(file: Path) -> bytes:
    """Read a file.

    Raises
    ------
    InputError
        The file does not exist, cannot be read, or is not a regular file: reading a pipe might
        never end.
    """
    try:
        mode = file.stat().st_mode
        if not stat.S_ISREG(mode):
            raise InputError(
                file, "", f"{'a folder' if stat.S_ISDIR(mode) else 'a device or pipe'}, not a file"
            )
        return file.read_bytes()
    except FileNotFoundError:
        raise InputError(file, "", "no such file") from None
    except OSError as error:
        raise InputError(file, "", f"cannot be read: {error.strerror}") from None
    except ValueError as error:  # such as a zero byte in its name
        raise InputError(file, "", f"cannot be read: {error}") from None


def read_text(file: Path) -> str:
    """Read a file in UTF-8, with or without a byte order mark.

    Raises
    ------
    InputError
        See `read_bytes`; also a file in another encoding, with the line of the first wrong byte.
    """
    data = read_bytes(file)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise InputError(
            file,
            f"line {line}",
            f"the byte 0x{data[error.start]:02x} is not UTF-8; save the file as UTF-8",
        ) from None


SETTLED_SECONDS = 10.0
"""Age of the last change [s] from which on a file that looks unchanged is unchanged: clocks of file
systems tick every few milliseconds, on FAT every two seconds."""
known_contents: dict[tuple[str, ...], str] = {}


def content_key(file: Path) -> str:
    """Return the digest of a file's content, by which caches know it; empty if it is no file.

    The file is read again only if its state changed, or changed so lately that its time of change
    would be the same after another change.
    """
    try:
        found = file.stat()
        if not stat.S_ISREG(found.st_mode):
            return ""
        numbers = found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns
        state = (str(file), *map(str, numbers))
        if state in known_contents:
            return known_contents[state]
        digest = sha256(file.read_bytes()).hexdigest()
    except (OSError, ValueError):
        return ""
    if time.time() - max(found.st_mtime, found.st_ctime) > SETTLED_SECONDS:
        known_contents[state] = digest
    return digest


def write_atomically(file: Path, content: str | bytes) -> None:
    """Write a file as a whole or not at all, at whatever moment the process ends.

    A link is replaced by the file.  Bytes of names that are not UTF-8 are written as escapes.
    """
    partial = file.with_name(f".{token_hex(8)}{PARTIAL_ENDING}")
    try:
        with partial.open("xb") as stream:  # fails where a file or a link of this name is
            stream.write(encode_text(content) if isinstance(content, str) else content)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(partial, file)
    except BaseException as error:
        partial.unlink(missing_ok=True)
        if isinstance(error, OSError):
            error.filename = str(file)  # name the file that the user asked for, not the partial one
        raise


def encode_text(text: str) -> bytes:
    """Encode a text in UTF-8; bytes that are not UTF-8, as in names of files, become escapes."""
    return text.encode(errors="backslashreplace")


def readable(name: str) -> str:
    r"""Return the name of a file as text that can be encoded: bytes that are not UTF-8 as escapes.

    >>> print(readable("caf\udce9"))
    caf\udce9
    """
    return encode_text(name).decode()


OUTPUT_MARK = "written by proofmass, which may replace this file"
"""Text in a file by which `write_output` knows a file of its own."""
MARK_PLACE = 8192  # bytes at the beginning and at the end of a file in which the mark is looked for
LIST_NAME = ".proofmass"
"""File that lists the files in its folder that `write_output` wrote and that have no mark, such as
tables."""
LISTS_IN_MEMORY = 64  # lists that are kept in memory; a report with all studies has 14 folders
LIST_HEAD = "# Files in this folder that proofmass wrote and may replace.\n"


@dataclass
class Permissions:
    """Which files may be replaced.

    Attributes
    ----------
    force : bool
        Whether files may be replaced that proofmass did not write (option ``--force``).
    inputs : set of str
        Real paths of inputs, which are never replaced.
    """

    force: bool = False
    inputs: set[str] = field(default_factory=set)


permissions = Permissions()
listing = Lock()


@contextmanager
def output_permissions(force: bool | None = None) -> Iterator[None]:
    """Limit `protect` to the context; `force` lets outputs replace files of others in it.

    By default `force` is what it was.
    """
    before = replace(permissions, inputs=set(permissions.inputs))
    if force is not None:
        permissions.force = force
    try:
        yield
    finally:
        permissions.force, permissions.inputs = before.force, before.inputs


def protect(files: Iterable[Path]) -> None:
    """Let no output replace these files, which are inputs."""
    permissions.inputs.update(os.path.realpath(file) for file in files)


def write_output(file: Path, content: str | bytes) -> None:
    """Write a file that the user asked for, as a whole or not at all.

    Raises
    ------
    InputError
        See `require_replaceable`.
    OSError
        The file cannot be written; a file that was there is unchanged.
    """
    data = encode_text(content) if isinstance(content, str) else content
    with listing:
        require_replaceable(file)
        if OUTPUT_MARK.encode() not in data:
            list_of(file.parent.absolute()).add(file.name)
    write_atomically(file, data)


def require_replaceable(file: Path) -> None:
    """Raise InputError if an output must not have this name.

    It must not be that of an input, of a folder, of a device or pipe, or of a file that proofmass
    did not write; the latter is allowed within `replace_foreign_files`.
    """
    if os.path.realpath(file) in permissions.inputs:
        raise InputError(file, "", "an input, which no output replaces; give another name")
    try:
        mode = file.lstat().st_mode
    except FileNotFoundError:
        return
    if stat.S_ISDIR(mode):
        raise InputError(file, "", "a folder; give the name of a file")
    if not (stat.S_ISREG(mode) or stat.S_ISLNK(mode)):
        raise InputError(file, "", "a device or pipe, not a file; give another name")
    if not (permissions.force or is_own(file)):
        raise InputError(
            file,
            "",
            "it is there already, and proofmass did not write it; give another name, or --force "
            "to replace it",
        )


def is_own(file: Path) -> bool:
    """Whether proofmass wrote a file: it has the mark, or is in the list of its folder."""
    return file.name in list_of(file.parent.absolute()).read() or has_mark(file)


def has_mark(file: Path) -> bool:
    """Whether a file has the mark at its beginning or end."""
    try:
        if not file.is_file():
            return False
        with file.open("rb") as stream:
            found = stream.read(MARK_PLACE)
            stream.seek(max(stream.seek(0, os.SEEK_END) - MARK_PLACE, 0))
            return OUTPUT_MARK.encode() in found or OUTPUT_MARK.encode() in stream.read(MARK_PLACE)
    except OSError:
        return False


class FileList:
    """The list of a folder, see `LIST_NAME`; it is read again after another process changed it."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / LIST_NAME
        self.names = set[str]()
        self.state: tuple[int, ...] | None = None

    def read(self) -> set[str]:
        """Return the names; none if there is no list, or if it is no regular file."""
        state = state_of(self.file)
        if state != self.state or state is None:
            self.state, self.names = state, set()
            if state is not None:
                self.names.update(read_text(self.file).splitlines())
        return self.names

    def add(self, name: str) -> None:
        """Add a name, unless it is there."""
        if name in self.read():
            return
        if self.state is None and os.path.lexists(self.file):
            raise InputError(self.file, "", "no regular file; remove it, proofmass needs its name")
        with self.file.open("ab") as stream:
            stream.write(encode_text(LIST_HEAD * (self.state is None) + f"{name}\n"))
        self.names.add(name)
        self.state = state_of(self.file)


def state_of(file: Path) -> tuple[int, ...] | None:
    """What changes when a regular file changes; None if there is none, or if it is a link."""
    with suppress(OSError):
        found = file.lstat()
        if stat.S_ISREG(found.st_mode):
            return found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns
    return None


@lru_cache(LISTS_IN_MEMORY)
def list_of(folder: Path) -> FileList:
    """Return the list of a folder, given by its absolute path."""
    return FileList(folder)


def remove_output(file: Path) -> None:
    """Remove a file if proofmass wrote it."""
    if file.is_file() and is_own(file):
        file.unlink()


def make_folder(folder: Path) -> Path:
    """Make a folder for outputs, and return it.

    Raises
    ------
    InputError
        It is a link, which in a stranger's folder may lead anywhere.
    """
    if folder.is_symlink():
        wrong = f"a link to {os.readlink(folder)}; give the folder itself, or remove the link"
        raise InputError(folder, "", wrong)
    folder.mkdir(parents=True, exist_ok=True)
    return folder
