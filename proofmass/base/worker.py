"""Workers: processes in which runs are made, with limits of processor time and memory.

A run that aborts, hangs or exhausts the memory ends its own worker and nothing else.  The limit of
time is on the processor time of the call, so that other processes do not change the answer; a call
that waits without using the processor is ended as well, see `IdleWatch`.  The same
holds for all other work that depends on a file of the user: commands read sidecars, compile models
and evaluate references in workers, within the limits that the sidecar states.  There is one
exception: a command compiles a model in its own process after a worker has compiled the same model
within these limits.  Studies do so to look up numbers of the model, and `proofmass diet` to compile
a reduced model.  Calls of `evaluate` and `compare` from Python evaluate the reference in the
calling process.

A worker is kept for the next run, since importing the engines takes longer than most runs.  A
worker that died, was killed, or broke an engine is replaced.  `multiprocessing` is not used because
it imports the caller's main script again, which fails in a short script or a notebook.
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
from pathlib import Path
from queue import Empty, LifoQueue, SimpleQueue
from typing import IO, Any, cast

try:
    import resource
except ImportError:  # Windows, where memory has no limit
    resource = None  # type: ignore[assignment]

SINGLE_THREAD = dict.fromkeys(
    (
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "OMP_NUM_THREADS",
        "BLIS_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
    ),
    "1",
)
"""Environment of a worker, which overrides the caller's: one thread for BLAS.  The last digits of
its results depend on the number of threads, and threads of parallel runs would wait for each other.
"""

LIGHT_IMPORTS = {"MUJOCO_GL": "disable", "PYDANTIC_DISABLE_PLUGINS": "__all__"}
"""Environment of commands and workers unless the caller's says otherwise: MuJoCo does not load its
renderer, and pydantic does not search all distributions for plugins.  The renderer takes a third of
the time of loading MuJoCo, and no run renders.  The search takes a tenth of the time of loading the
tables of a sidecar, and a plugin could only watch them."""

RETURN_FREED_MEMORY = {"MALLOC_MMAP_THRESHOLD_": "4194304"}
"""Environment of a worker unless the caller's says otherwise: glibc returns blocks of 4 MiB or more
to the system when they are freed.  Otherwise it keeps MuJoCo's arenas of 14 MB in a heap that
fragments: after ten minutes of runs a worker that used 0.4 GB held 6.5 GB, which `limit_memory`
counts."""

DEFAULT_ENVIRONMENT = LIGHT_IMPORTS | RETURN_FREED_MEMORY
"""What the caller's environment overrides; `SINGLE_THREAD` overrides that."""

IDLE_SHARE = 0.01
"""Share of a processor below which a call is idle.  A call that computes has less only where 100
processes share a processor."""
IDLE_PERIODS = 2
"""Idle periods after which a call is ended: one alone may be a process that Ctrl-Z had stopped."""
MIN_PERIOD, MAX_PERIOD = 3.0, 60.0  # [s]
"""Shortest and longest period: a busy system gives each process a share of the processor much
sooner, and nobody should wait for longer than needed."""
BLIND_PERIODS = 20
"""The same number for systems that do not show the processor time of a process to others."""
SIZE_BYTES = 8  # bytes before a call, which are its size
DEFAULT_MEMORY = 8.0
"""Memory [GiB] that a call may use by default; a worker with both engines loaded uses 0.2."""
GIB = 2**30
LONGEST_ALARM = 1e9  # [s], the longest alarm that can be set
KEPT_CHARACTERS = 240  # characters that are kept of what a process wrote before it died
KILLED_BY_SIGNAL = "killed by signal"  # begins the message of a `Crashed` whose process was killed
OUT_OF_MEMORY_MESSAGES = ("bad_alloc", "allocate memory")
"""Last messages of C++ and MuJoCo when memory runs out."""
BROKEN_ENGINES = set[str]()
"""Engines that cannot be called in this process any more, so that another has to be started."""


class Crashed(Exception):
    """The process ended without an answer."""


class TimedOut(Exception):
    """The call reached its limit of processor time, or waited for ever, and was killed."""


class OutOfMemory(Exception):
    """The call asked for more memory than its limit."""


class Worker:
    """A process that calls functions, one after the other."""

    def __init__(self) -> None:
        self.usable = True
        self.errors = tempfile.TemporaryFile()  # noqa: SIM115, closed with the worker
        self.process = subprocess.Popen(
            [
                sys.executable,
                "-P",
                "-W",
                "ignore",
                "-c",
                f"import sys; sys.path[:] = {import_path()}; "
                "from proofmass.base.worker import main; main()",
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            env=DEFAULT_ENVIRONMENT | dict(os.environ) | SINGLE_THREAD,
        )

    def call(self, function: Callable, args: tuple, timeout: float, memory: float) -> Any:
        """Send a call and wait for its answer: (True, result) or (False, exception)."""
        self.errors.seek(0)  # the process shares the file position, and writes from there as well
        self.errors.truncate()
        watch = IdleWatch(self.process, timeout)
        try:
            watch.start()
            to, back = cast(IO[bytes], self.process.stdin), cast(IO[bytes], self.process.stdout)
            call = pickle.dumps((function, args, timeout, memory, os.getcwd()))
            to.write(len(call).to_bytes(SIZE_BYTES) + call)
            to.flush()
            good, value, self.usable = pickle.load(back)
            return good, value
        except (EOFError, BrokenPipeError, pickle.UnpicklingError):
            self.process.wait()
            if watch.found:
                raise TimedOut(watch.found) from None
            if self.process.returncode in TIMER_CODES:
                raise TimedOut(f"no answer in {timeout:g} s of processor time") from None
            if (
                interrupted.is_set() or self.process.returncode == -signal.SIGINT
            ):  # a terminal's Ctrl-C
                raise KeyboardInterrupt from None
            words = self.describe_end()
            raise (
                out_of_memory(memory)
                if any(w in words for w in OUT_OF_MEMORY_MESSAGES)
                else Crashed(words)
            ) from None
        finally:
            watch.ended.set()

    def describe_end(self) -> str:
        """How the process ended, and the beginning of what it wrote to standard error."""
        self.errors.seek(0)
        text = self.errors.read().decode(errors="replace")
        code = self.process.returncode
        died = f"{KILLED_BY_SIGNAL} {name_signal(-code)}" if code < 0 else f"exit code {code}"
        words = " ".join(text.split())
        return died + (f": {words[:KEPT_CHARACTERS]}" if words else "")

    def close(self) -> None:
        """End the process at once."""
        self.process.kill()
        self.process.communicate()
        self.errors.close()


def name_signal(number: int) -> str:
    """The number of a signal with its name.

    >>> name_signal(11), name_signal(1000)
    ('11 (SIGSEGV)', '1000')
    """
    try:
        return f"{number} ({signal.Signals(number).name})"
    except ValueError:
        return str(number)


TIMER_CODES = {-getattr(signal, name) for name in ("SIGPROF", "SIGALRM") if hasattr(signal, name)}
"""Exit codes of a process that its own timers ended, see `set_timers`."""


class IdleWatch(threading.Thread):
    """A thread that ends the process of a call which waits without using the processor.

    It looks at the processor time of the process at the end of each period.  Where processes have
    no limit of processor time, on Windows, it ends the process after that limit of wall time.

    Attributes
    ----------
    found : str
        Why the process was ended; empty if it was not.
    ended : Event
        Set by the caller when the call has ended.
    """

    def __init__(self, process: subprocess.Popen, limit: float) -> None:
        super().__init__(daemon=True)  # since Ctrl-C may come before the end is set
        self.process, self.found, self.ended = process, "", threading.Event()
        if not hasattr(signal, "setitimer"):
            self.period, self.patience = min(limit, threading.TIMEOUT_MAX), 1
        elif processor_seconds(process.pid) is None:
            self.period, self.patience = min(limit, threading.TIMEOUT_MAX), BLIND_PERIODS
        else:
            self.period, self.patience = min(max(limit, MIN_PERIOD), MAX_PERIOD), IDLE_PERIODS

    def run(self) -> None:
        """Look at the process after each period until the call has ended."""
        used, idle, periods = processor_seconds(self.process.pid), 0, 0
        while not self.ended.wait(self.period):
            before, used = used or 0.0, processor_seconds(self.process.pid)
            is_idle = used is None or used - before < IDLE_SHARE * self.period
            idle, periods = idle + 1 if is_idle else 0, periods + 1
            if idle >= self.patience:
                self.found = f"no answer in {periods * self.period:g} s of wall time"
                if used is not None:
                    self.found += f", the last {idle * self.period:g} s without use of a processor"
                self.process.kill()
                return


def processor_seconds(process_id: int) -> float | None:
    """Processor time of a process and its children [s]; None where the system does not show it."""
    process = Path(f"/proc/{process_id}")
    try:
        state = (process / "stat").read_text("utf-8", "replace").rpartition(")")[2].split()
        children = [
            one
            for file in process.glob("task/*/children")
            for one in file.read_text("utf-8").split()
        ]
    except OSError:
        return None
    own = sum(map(int, state[11:15])) / os.sysconf("SC_CLK_TCK")  # of ended children as well
    return own + sum(processor_seconds(int(child)) or 0.0 for child in children)


def import_path() -> list[str]:
    """The folders from which a worker imports: those of this process, but the current folder.

    The current folder may be a stranger's.  The folders are no environment variable, since Python
    would run a ``sitecustomize.py`` in one of them when the worker starts.
    """
    own = str(Path(__file__).parents[1])
    return [*(folder for folder in sys.path if folder), own]


idle_workers: LifoQueue[Worker] = LifoQueue()
"""Workers that wait for a call.  The last one is used first: it has in memory what the case needs
that a study is working on, such as its compiled model."""
busy_workers: set[Worker] = set()
interrupted = threading.Event()


@contextmanager
def interrupt_workers() -> Iterator[None]:
    """Let Ctrl-C within the context interrupt the calls of all threads, also later ones."""

    def stop(*_: object) -> None:
        interrupted.set()
        for worker in list(busy_workers):
            worker.process.kill()
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():  # other threads get no signals
        yield
        return
    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        interrupted.clear()


def call_isolated(
    function: Callable, *args: object, timeout: float, memory: float = DEFAULT_MEMORY
) -> Any:
    """Call a function in another process.

    Parameters
    ----------
    function : callable
        Importable by name; arguments and result must pickle.
    *args
        Arguments of the function.
    timeout : float
        Processor time of the call after which the process is killed [s].
    memory : float
        Memory for data that the process may use [GiB]; not limited on Windows and macOS.

    Returns
    -------
    object
        The value that the function returned.

    Raises
    ------
    Crashed
        The process died; the message has what it wrote to standard error.
    TimedOut, OutOfMemory
        The call reached a limit.
    KeyboardInterrupt
        Ctrl-C reached the process, or `interrupt_workers` ended it; this does not count as a crash.
    Exception
        The exception that the function raised.
    """
    worker = take_idle_worker() or Worker()
    busy_workers.add(worker)
    try:
        if interrupted.is_set():
            raise KeyboardInterrupt
        good, value = worker.call(function, args, timeout, memory)
    except BaseException:
        worker.close()
        raise
    finally:
        busy_workers.discard(worker)
    if worker.usable:
        idle_workers.put(worker)
    else:
        worker.close()
    if not good:
        raise value
    return value


def take_idle_worker() -> Worker | None:
    """Take a worker that waits for a call, or None; workers that an interrupt ended are closed."""
    with suppress(Empty):
        while (worker := idle_workers.get_nowait()).process.poll() is not None:
            worker.close()
        return worker
    return None


@atexit.register
def close_idle_workers() -> None:
    """End the workers that wait for a call, so that none outlives this process."""
    while worker := take_idle_worker():
        worker.close()


def main() -> None:
    """Serve calls from standard input until it closes.

    What engines print to standard output goes to standard error, so that answers stay apart.
    """
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    calls: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=receive_calls, args=(calls,), daemon=True).start()
    while True:
        function, args, timeout, memory, folder = pickle.loads(calls.get())
        set_timers(timeout)
        os.chdir(folder)  # so that relative paths of the call are found
        answer = answer_call(function, args, memory)
        set_timers(0.0)
        answers.write(answer)
        answers.flush()


def receive_calls(calls: "SimpleQueue[bytes]") -> None:
    """Read calls from standard input; when it closes, the caller is gone, and this process ends.

    This is a thread, so that the process ends in the middle of a call as well.
    """
    try:
        with open(0, "rb", buffering=0) as stream:  # a buffer would be locked when Python ends
            while len(size := stream.read(SIZE_BYTES)) == SIZE_BYTES:
                call = bytearray(int.from_bytes(size))
                rest = memoryview(call)
                while rest and (count := stream.readinto(rest)):
                    rest = rest[count:]
                calls.put(bytes(call))
    finally:
        os._exit(0)


def answer_call(function: Callable, args: tuple, memory: float) -> bytes:
    """Call a function, and pack its result or its exception for the caller."""
    limit_memory(memory)
    try:
        return pack_answer(True, function(*args))
    except MemoryError:
        return pack_answer(False, out_of_memory(memory))
    except Exception as error:
        # where dask is installed, pint loads it, and exceptions would be packed with all of these
        error.__traceback__ = error.__cause__ = error.__context__ = None
        try:  # some exceptions can be packed but not unpacked
            answer = pack_answer(False, error)
            pickle.loads(answer)
            return answer
        except Exception:  # it cannot be sent
            return pack_answer(False, Crashed(f"{type(error).__name__}: {error}"))


def pack_answer(good: bool, value: Any) -> bytes:
    """Pack an answer, with whether this process can be called again."""
    return pickle.dumps((good, value, not BROKEN_ENGINES))


def out_of_memory(memory: float) -> OutOfMemory:
    """The error of a call that asked for more memory than `memory` [GiB]."""
    return OutOfMemory(f"needs more than {memory:g} GiB of memory")


def limit_memory(memory: float) -> None:
    """Limit the memory for data of this process [GiB].

    The limit is not on the address space, of which engines and BLAS reserve more than they use.
    """
    if resource is not None:
        most = resource.getrlimit(resource.RLIMIT_DATA)[1]
        wanted = int(min(memory * GIB, sys.maxsize))
        resource.setrlimit(
            resource.RLIMIT_DATA,
            (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most),
        )


def set_timers(seconds: float) -> None:
    """Make this process end itself after a processor time [s]; 0 cancels this.

    It also ends after the longest wall time that so much can take, in case its caller is gone.
    """
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_PROF, min(seconds, LONGEST_ALARM))
        signal.setitimer(signal.ITIMER_REAL, longest_wall_time(seconds))


def longest_wall_time(seconds: float) -> float:
    """The longest wall time [s] that a processor time [s] can take; 0 of 0.

    >>> longest_wall_time(10.0), longest_wall_time(0.0)
    (1000.0, 0.0)
    """
    return min(max(seconds, MIN_PERIOD) / IDLE_SHARE, LONGEST_ALARM) if seconds else 0.0
