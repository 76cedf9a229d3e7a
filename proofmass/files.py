"""Reading and writing files.

A file that cannot be read is bad input; a file that is written is there as a whole or not at all.
"""

import os
import stat
from pathlib import Path
from threading import get_ident

from proofmass.errors import InputError

HALF = ".part"  # the ending of a file until it is whole


def read_bytes(file: Path) -> bytes:
    """Read a file.

    Raises
    ------
    InputError
        Not there, not readable, or no regular file: a pipe would be waited for without end.
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
        See `read_bytes`; or in another encoding: the line is named.
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


def write_whole(file: Path, what: str | bytes) -> None:
    """Write a file that is there as a whole or not at all, whenever the process ends."""
    half = file.with_name(f"{file.name}.{os.getpid()}.{get_ident()}{HALF}")
    try:
        with half.open("wb") as stream:
            stream.write(what.encode() if isinstance(what, str) else what)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(half, file)
    except OSError as error:
        half.unlink(missing_ok=True)
        error.filename = str(file)  # which the user asked for, and not the half of it
        raise
