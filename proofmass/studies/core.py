"""A processor for each timed run: no two runs of any study on this machine are on the same one."""

import getpass
import os
import platform
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows, where runs are not pinned
    fcntl = None  # type: ignore[assignment]

LOOK_AGAIN = 0.005  # s


def cores() -> list[int]:
    """The processors that runs may be pinned to; none where the system cannot."""
    return sorted(os.sched_getaffinity(0)) if fcntl and hasattr(os, "sched_getaffinity") else []


@contextmanager
def own_core() -> Iterator[int | None]:
    """A processor that nobody else gets meanwhile, waited for; None where there is no pinning.

    Locks are on files, so that other processes keep away too, and go with the process that has
    them.  Who waits does so at the head of a queue, lest a study that needs no pause keeps all.
    """
    if not cores():
        yield None
        return
    with ExitStack() as held:
        with lock_file("queue").open("w") as queue:
            fcntl.flock(queue, fcntl.LOCK_EX)
            core = first_free(held)
        yield core


def first_free(held: ExitStack) -> int:
    """Wait for a processor, and keep it as long as `held`."""
    while True:
        for core in cores():
            file = lock_file(f"core-{core}").open("w")
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.close()
            else:
                held.enter_context(file)
                return core
        time.sleep(LOOK_AGAIN)


def lock_file(name: str) -> Path:
    """A file to lock, this user's own."""
    return Path(tempfile.gettempdir()) / f"proofmass-{getpass.getuser()}-{name}.lock"


@contextmanager
def pinned(core: int | None) -> Iterator[None]:
    """Keep this process on one processor for a while."""
    if core is None:
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@cache
def machine() -> str:
    """This machine's kind of processor, and how many it has."""
    name = platform.processor() or platform.machine()
    told = Path("/proc/cpuinfo")
    for line in told.read_text().splitlines() if told.exists() else ():
        if line.startswith("model name"):
            name = line.partition(":")[2].strip()
    return f"{name} x {os.cpu_count()}"
