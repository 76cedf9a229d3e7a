"""Reading and writing files.

A file that cannot be read is bad input.  A file is written as a whole or not at all.
"""

import os
import stat
from pathlib import Path
from threading import get_ident

from proofmass.errors import InputError

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


def write_atomically(file: Path, content: str | bytes) -> None:
    """Write a file as a whole or not at all, at whatever moment the process ends."""
    partial = file.with_name(f"{file.name}.{os.getpid()}.{get_ident()}{PARTIAL_ENDING}")
    try:
        with partial.open("wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(partial, file)
    except OSError as error:
        partial.unlink(missing_ok=True)
        error.filename = str(file)  # name the file that the user asked for, not the partial one
        raise
