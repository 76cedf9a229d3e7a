"""Locks between the processes of one user: locked files in a folder that only this user can enter.

A lock ends with the process that has it.  Lock files in a folder that others can write to could be
held for ever by anybody, or be links to files of the user.
"""

import os
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from threading import Event, Thread
from typing import IO

from proofmass.base.errors import InputError

try:
    import fcntl
except ImportError:  # Windows, where runs are not pinned
    fcntl = None  # type: ignore[assignment]

HAS_LOCKS = fcntl is not None
ANNOUNCE_SECONDS = 10.0  # s of waiting after which a line tells who has the locks


def lock_folder() -> Path:
    """Make and return the folder of the lock files of this user.

    It is ``proofmass`` in ``XDG_RUNTIME_DIR`` if that belongs to the user, else ``proofmass-UID``
    in the folder for temporary files.

    Raises
    ------
    InputError
        Somebody else has made it.
    """
    user = os.getuid()  # a number, since not every user has an account with a name
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and is_private(Path(runtime), user):
        folder = Path(runtime) / "proofmass"
    else:
        folder = Path(tempfile.gettempdir()) / f"proofmass-{user}"
    with suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    if not is_private(folder, user):
        raise InputError(
            folder,
            "",
            "not a folder that you alone can enter, so others could hold its locks; remove it, or "
            "set XDG_RUNTIME_DIR to a folder with mode 0700",
        )
    return folder


def is_private(folder: Path, user: int) -> bool:
    """Whether a path is a folder, and no link to one, that one user alone can enter."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return (
        stat.S_ISDIR(found.st_mode)
        and found.st_uid == user
        and not found.st_mode & (stat.S_IRWXG | stat.S_IRWXO)
    )


def open_lock(name: str) -> IO[bytes]:
    """Open a lock file, which is made if needed, without changing it; a link is an error."""
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
    return os.fdopen(os.open(lock_folder() / name, flags, 0o600), "r+b", buffering=0)


@contextmanager
def wait_for_lock(name: str) -> Iterator[None]:
    """Wait for a lock and hold it within the context."""
    with open_lock(name) as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def try_lock(name: str) -> IO[bytes] | None:
    """Take a lock until the file is closed; None if another has it."""
    file = open_lock(name)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        return None
    file.truncate(0)
    file.write(b"%d\n" % os.getpid())
    return file


def holder(name: str) -> int | None:
    """Return the number of the other process that has a lock; None if none is known to have it."""
    try:
        with open_lock(name) as file:
            process = int(file.read() or 0)
        os.kill(process or os.getpid(), 0)  # raises an error if there is no such process
    except (OSError, ValueError):
        return None
    return process if process not in (0, os.getpid()) else None


@contextmanager
def announce_waiting(describe: Callable[[], str]) -> Iterator[None]:
    """Print a line on standard error if the context takes long; each line is printed once.

    `describe` makes the line, which is empty if there is nothing to tell.
    """
    done = Event()

    def tell() -> None:
        while not done.wait(ANNOUNCE_SECONDS):
            if line := describe():
                print_once(line)

    Thread(target=tell, daemon=True).start()
    try:
        yield
    finally:
        done.set()


@cache
def print_once(line: str) -> None:
    """Print a line on standard error, unless this process has printed it before."""
    print(line, file=sys.stderr)
