"""Runs happen in processes of their own, with limits of time and memory.

A run that aborts, hangs or asks for all memory costs itself only.  So does the rest of what a file
can ask for: commands read sidecars, compile models and evaluate references in workers, within the
limits that the sidecar states.  A command compiles a model itself only where a worker has compiled
the same one within these limits before: studies look up numbers of the model of their case, and
`proofmass diet` compiles what is left of its model when something is cut.  Who calls `evaluate` or
`compare` from Python has the reference in the calling process.

A worker is kept for the next run, since importing the engines takes longer than most runs; a worker
that died, was killed, or broke an engine is replaced.  `multiprocessing` is not used because it
imports the caller's main script again, which a ten-line script or a notebook does not survive.
"""

import atexit
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from queue import Empty, LifoQueue
from typing import IO, Any, cast

try:
    import resource
except ImportError:  # Windows, where memory has no limit
    resource = None  # type: ignore[assignment]

ALONE = dict.fromkeys(
    (
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "OMP_NUM_THREADS",
        "BLIS_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
    ),
    "1",
)
"""Whatever the environment says: the last digits of what BLAS solves depend on the number of its
threads, and threads of runs side by side would wait for each other."""

WITHOUT_WINDOWS = {"MUJOCO_GL": "disable"}
"""Unless the environment says otherwise: MuJoCo loads what draws in windows for a third of its
time of loading, and no run draws."""

SPARING = {"MALLOC_MMAP_THRESHOLD_": "4194304"}
"""Unless the environment says otherwise: glibc gives blocks from 4 MiB on back to the system when
they are freed.  From its heap, MuJoCo's arenas of 14 MB leave holes that nothing fills: after ten
minutes of runs a worker that used 0.4 GB had 6.5 GB of data, which `limit_data` counts."""

GRACE = 5.0  # [s] a worker outlives its time limit by, if the process that asked is gone
MEMORY = 8.0  # [GiB] of data that a call may ask for; a worker with both engines loaded has 0.2
GIB = 2**30
LONGEST = 1e9  # [s] that an alarm can be set to
WORDS = 240  # letters of what a process wrote before it died
KILLED = "killed by signal"  # words of a `Crashed` whose process aborted
FULL = ("bad_alloc", "allocate memory")  # what C++ and MuJoCo say last when there is no memory


class Crashed(Exception):
    """The process died without an answer."""


class TimedOut(Exception):
    """No answer in time; the process was killed."""


class OutOfMemory(Exception):
    """The call asked for more memory than it may have."""


class Worker:
    """A process that calls functions, one after the other."""

    def __init__(self) -> None:
        self.usable = True
        self.errors = tempfile.TemporaryFile()  # noqa: SIM115, closed with the worker
        path = os.pathsep.join(p or os.getcwd() for p in sys.path)
        self.process = subprocess.Popen(
            [
                sys.executable,
                "-P",
                "-W",
                "ignore",
                "-c",
                "from proofmass.worker import main; main()",
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            env={**WITHOUT_WINDOWS, **SPARING, **os.environ, **ALONE, "PYTHONPATH": path},
        )

    def call(self, function: Callable, args: tuple, timeout: float, memory: float) -> Any:
        """Send a call and wait for its answer: (True, result) or (False, exception)."""
        late = threading.Event()
        self.errors.seek(0)  # the process shares the place, so it writes from there as well
        self.errors.truncate()

        def give_up() -> None:
            late.set()
            self.process.kill()

        timer = threading.Timer(min(timeout, threading.TIMEOUT_MAX), give_up)
        timer.daemon = True  # Ctrl-C may come before it can be cancelled
        try:
            timer.start()
            to, back = cast(IO[bytes], self.process.stdin), cast(IO[bytes], self.process.stdout)
            to.write(pickle.dumps((function, args, timeout, memory, os.getcwd())))
            to.flush()
            good, value, self.usable = pickle.load(back)
            return good, value
        except (EOFError, BrokenPipeError, pickle.UnpicklingError):
            self.process.wait()
            if late.is_set():
                raise TimedOut(f"no answer in {timeout:g} s") from None
            if stopped.is_set() or self.process.returncode == -signal.SIGINT:  # a terminal's Ctrl-C
                raise KeyboardInterrupt from None
            words = self.last_words()
            raise (beyond(memory) if any(w in words for w in FULL) else Crashed(words)) from None
        finally:
            timer.cancel()

    def last_words(self) -> str:
        """How the process ended, and what it wrote to standard error first."""
        self.errors.seek(0)
        text = self.errors.read().decode(errors="replace")
        code = self.process.returncode
        died = f"{KILLED} {-code}" if code < 0 else f"exit code {code}"
        words = " ".join(text.split())
        return died + (f": {words[:WORDS]}" if words else "")

    def close(self) -> None:
        """End the process at once."""
        self.process.kill()
        self.process.communicate()
        self.errors.close()


idle: LifoQueue[Worker] = LifoQueue()
"""The last one comes first: it has the reference of the case that a study is at."""
busy: set[Worker] = set()
stopped = threading.Event()


@contextmanager
def stopping() -> Iterator[None]:
    """Ctrl-C meanwhile interrupts the calls of all threads, also those still to come."""

    def stop(*_: object) -> None:
        stopped.set()
        for worker in list(busy):
            worker.process.kill()
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():  # which alone gets signals
        yield
        return
    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        stopped.clear()


def isolated(function: Callable, *args: object, timeout: float, memory: float = MEMORY) -> Any:
    """Call a function in another process.

    Parameters
    ----------
    function : callable
        Importable by name; arguments and result must pickle.
    *args
        Of the function.
    timeout : float
        Time until the process is killed [s].
    memory : float
        Data that the process may have [GiB]; not limited on Windows and macOS.

    Returns
    -------
    object
        What the function returned.

    Raises
    ------
    Crashed
        The process died; with what it wrote to standard error.
    TimedOut, OutOfMemory
        The call reached a limit.
    KeyboardInterrupt
        Ctrl-C reached the process, or `stopping` ended it: that is no crash.
    Exception
        Whatever the function raised.
    """
    worker = rested() or Worker()
    busy.add(worker)
    try:
        if stopped.is_set():
            raise KeyboardInterrupt
        good, value = worker.call(function, args, timeout, memory)
    except BaseException:
        worker.close()
        raise
    finally:
        busy.discard(worker)
    if worker.usable:
        idle.put(worker)
    else:
        worker.close()
    if not good:
        raise value
    return value


def rested() -> Worker | None:
    """A worker that waits for a call, if there is one; an interrupt has ended some of them."""
    with suppress(Empty):
        while (worker := idle.get_nowait()).process.poll() is not None:
            worker.close()
        return worker
    return None


@atexit.register
def dismiss() -> None:
    """End the workers that wait for a call, lest they outlive this process for a moment."""
    while worker := rested():
        worker.close()


def main() -> None:
    """Serve calls from standard input until it closes; engines may print what they like."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while True:
        try:
            function, args, timeout, memory, folder = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        alarm(timeout + GRACE)
        os.chdir(folder)  # where relative paths of the call begin
        answer = answered(function, args, memory)
        alarm(0.0)
        answers.write(answer)
        answers.flush()


def answered(function: Callable, args: tuple, memory: float) -> bytes:
    """A call's result or exception, whatever it is, packed for the caller."""
    limit_data(memory)
    try:
        return packed(True, function(*args))
    except MemoryError:
        return packed(False, beyond(memory))
    except Exception as error:
        # where dask is installed, pint loads it, and exceptions would be packed with all of these
        error.__traceback__ = error.__cause__ = error.__context__ = None
        try:  # an exception may be packed and yet not be unpacked
            answer = packed(False, error)
            pickle.loads(answer)
            return answer
        except Exception:  # it cannot be sent
            return packed(False, Crashed(f"{type(error).__name__}: {error}"))


def packed(good: bool, value: Any) -> bytes:
    """An answer, and whether this process can be called again."""
    from proofmass.sim.protocol import BROKEN  # with NumPy, which who calls a worker may not need

    return pickle.dumps((good, value, not BROKEN))


def beyond(memory: float) -> OutOfMemory:
    """The error of a call that asked for more than `memory` [GiB]."""
    return OutOfMemory(f"needs more than {memory:g} GiB of memory")


def limit_data(memory: float) -> None:
    """Let this process have so much data [GiB].

    Address space is not what is limited: engines and BLAS reserve more of it than they use.
    """
    if resource is not None:
        most = resource.getrlimit(resource.RLIMIT_DATA)[1]
        wanted = int(min(memory * GIB, sys.maxsize))
        resource.setrlimit(
            resource.RLIMIT_DATA,
            (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most),
        )


def alarm(seconds: float) -> None:
    """End this process after a while, should nobody be left to do it; 0: do not."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, min(seconds, LONGEST))
