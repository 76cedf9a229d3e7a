"""A bad input affects no other: limits of time and memory, crashes, and errors of all kinds."""

import ctypes
import importlib
import os
import platform
import signal
import subprocess
import sys
import threading
import time
import warnings
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pymunk
import pytest

from proofmass.base import clock, worker
from proofmass.base.clock import processor_time
from proofmass.base.errors import InputError
from proofmass.base.worker import (
    Crashed,
    OutOfMemory,
    TimedOut,
    call_isolated,
    close_idle_workers,
    idle_workers,
)
from proofmass.batch.check import check
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.failures import BadModel
from tests.shipped import shipped

LARGE_MODEL = (
    '<mujoco><worldbody><replicate count="1000000" offset="1 0 0"><body><joint/>'
    '<geom size="1"/></body></replicate></worldbody></mujoco>'
)


@pytest.fixture(scope="module", autouse=True)
def new_workers():
    """Workers that were started before this file was imported do not find its functions."""
    close_idle_workers()


class Peculiar(Exception):
    """An exception that can be pickled but not unpickled."""

    def __init__(self, one: int, two: int):
        super().__init__(f"{one} and {two}")


def raise_peculiar() -> None:
    """Raise an exception that cannot be unpickled."""
    raise Peculiar(1, 2)


def fail_deeply(with_dask: bool) -> None:
    """Fail in a deep recursion; dask, if imported, makes pickle include tracebacks and contexts."""
    if with_dask:
        importlib.import_module("dask.multiprocessing")
    try:
        fail_deeply(False)
    except RecursionError:
        raise InputError(Path("deep.toml"), "", "nested too deeply") from None


def reserve_memory(gib: float) -> int:
    """Reserve memory [GiB], and return its size in bytes."""
    return np.empty(int(gib * 2**30), np.uint8).size


def speak_and_abort(words: str) -> None:
    os.write(2, words.encode())
    os.abort()


def test_a_call_has_as_much_memory_as_it_is_given():
    with pytest.raises(OutOfMemory, match=r"^needs more than 0\.5 GiB of memory$"):
        call_isolated(reserve_memory, 0.5, timeout=20, memory=0.5)
    assert call_isolated(reserve_memory, 0.5, timeout=20, memory=1.0) == 2**29


def data_size() -> int:
    """The data segment of this process [KiB], as its limit counts it: also pages never used."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(status.partition("VmData:")[2].split()[0])


def leave_holes() -> int:
    """The growth of the data segment after large blocks with small ones between are freed [KiB].

    The small blocks stay in use.
    """
    libc = ctypes.CDLL(None)
    libc.malloc.restype, libc.malloc.argtypes = ctypes.c_void_p, [ctypes.c_size_t]
    libc.free.argtypes = [ctypes.c_void_p]
    size_before = data_size()
    for _ in range(2):  # glibc takes blocks from its heap if one of their size was freed before
        large, small = [], []
        for _ in range(20):
            large.append(libc.malloc(14 << 20))
            small.append(libc.malloc(100 << 10))
        for block in large:
            libc.free(block)
    return data_size() - size_before


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the heap is that of glibc")
def test_a_worker_returns_freed_blocks_to_the_system():
    """A worker returns freed blocks to the system; an ordinary process keeps them in its heap.

    MuJoCo's arenas, which are reserved and hardly used, once made up 8 GB of a worker.
    """
    assert call_isolated(leave_holes, timeout=20) < 20 << 10
    heap = subprocess.run(
        [
            sys.executable,
            "-c",
            "from tests.base.test_worker import leave_holes; print(leave_holes())",
        ],
        capture_output=True,
        text=True,
        check=True,
        env={k: v for k, v in os.environ.items() if not k.startswith("MALLOC_")},
    )
    assert int(heap.stdout) > 200 << 10  # without a worker's environment, 20 blocks of 14 MB


def test_limits_may_be_larger_than_any_machine():
    assert call_isolated(abs, -3, timeout=1e300, memory=1e300) == 3


def test_a_crash_is_reported_with_the_output_of_the_last_call_alone():
    call_isolated(os.write, 2, b"words of an earlier call", timeout=20)
    with pytest.raises(Crashed) as crash:
        call_isolated(speak_and_abort, "Aborting: mass must be positive\n\tin body 3", timeout=20)
    assert str(crash.value) == (
        "killed by signal 6 (SIGABRT): Aborting: mass must be positive in body 3"
    )


def warn_and_abort() -> None:
    warnings.warn("a division by zero", RuntimeWarning, stacklevel=1)
    os.abort()


def test_the_report_of_a_crash_has_no_warnings_and_is_short():
    with pytest.raises(Crashed) as crash:
        call_isolated(warn_and_abort, timeout=20)
    assert str(crash.value) == "killed by signal 6 (SIGABRT)"
    words = "".join(f"{k:03d}," for k in range(200))
    with pytest.raises(Crashed) as crash:
        call_isolated(speak_and_abort, words, timeout=20)
    assert str(crash.value) == f"killed by signal 6 (SIGABRT): {words[:240]}"


def speak_bytes_and_exit(words: bytes) -> None:
    os.write(2, words)
    os._exit(1)


def test_words_that_are_not_utf_8_are_reported_as_far_as_they_can_be_read():
    with pytest.raises(Crashed, match=r"^exit code 1: Error in \ufffdlink$"):
        call_isolated(speak_bytes_and_exit, b"Error in \xfclink", timeout=20)


def speak_on_standard_output(words: str, ends: bool) -> str:
    """Write as an engine in C does, past Python."""
    os.write(1, words.encode())
    return os._exit(1) if ends else words


def test_what_an_engine_prints_is_no_part_of_an_answer_but_of_the_report_of_a_crash():
    assert call_isolated(speak_on_standard_output, "mass is 0", False, timeout=20) == "mass is 0"
    with pytest.raises(Crashed, match=r"^exit code 1: mass is 0$"):
        call_isolated(speak_on_standard_output, "mass is 0", True, timeout=20)


def test_an_exit_is_a_crash_with_the_code_of_the_exit():
    with pytest.raises(Crashed, match=r"^exit code 3$"):
        call_isolated(os._exit, 3, timeout=20)


@pytest.mark.skipif(not hasattr(worker.resource, "RLIMIT_DATA"), reason="memory has no limit")
def test_a_call_has_eight_gib_by_default():
    limit, most = call_isolated(worker.resource.getrlimit, worker.resource.RLIMIT_DATA, timeout=20)
    eight = 8 * 2**30
    assert limit == (eight if most == worker.resource.RLIM_INFINITY else min(eight, most))


def test_an_abort_of_chipmunk_is_reported_with_its_message():
    with pytest.raises(Crashed, match="Chipmunk error: Moment of Inertia must be positive"):
        call_isolated(pymunk.Body, 1.0, -1.0, timeout=20)


def test_an_exception_that_cannot_be_unpickled_is_reported():
    with pytest.raises(Crashed, match="Peculiar: 1 and 2"):
        call_isolated(raise_peculiar, timeout=20)


def test_an_exception_is_sent_without_its_traceback():
    """With dask, pickle would include the traceback of the deep recursion."""
    pytest.importorskip("dask")
    with pytest.raises(InputError, match="nested too deeply"):
        call_isolated(fail_deeply, True, timeout=20)


def test_a_worker_in_which_mujoco_is_broken_is_replaced(tmp_path):
    """After a model that is too large, MuJoCo 4.0.0 hangs at the next warning in the process."""
    large, warns = tmp_path / "large.xml", tmp_path / "warns.xml"
    large.write_text(
        '<mujoco><asset><hfield name="h" nrow="1000000" ncol="1000000" size="1 1 1 1"'
        '/></asset><worldbody><geom type="hfield" hfield="h"/></worldbody></mujoco>'
    )
    warns.write_text(
        '<mujoco><worldbody><body pos="nan 0 0"><joint/><geom size="1"/></body>'
        "</worldbody></mujoco>"
    )
    close_idle_workers()  # so that there is one worker only
    process = call_isolated(os.getpid, timeout=20)
    for file, why in ((large, "cannot compile"), (warns, "not a number")):
        with pytest.raises(BadModel, match=why):
            call_isolated(compile_model, file, timeout=20)
    assert call_isolated(os.getpid, timeout=20) != process


def test_relative_paths_start_from_the_folder_of_the_caller(tmp_path, monkeypatch):
    call_isolated(abs, 1, timeout=20)
    monkeypatch.chdir(tmp_path)
    assert call_isolated(os.getcwd, timeout=20) == str(tmp_path)


def test_modules_in_the_current_folder_are_not_imported(tmp_path, monkeypatch):
    (tmp_path / "numpy.py").write_text("raise SystemExit('a module of the user')")
    call = (
        "from proofmass.base.worker import call_isolated; print(call_isolated(abs, -3, timeout=60))"
    )
    found = subprocess.run(
        [sys.executable, "-P", "-c", call], cwd=tmp_path, text=True, capture_output=True, check=True
    )
    assert found.stdout == "3\n"


@pytest.fixture
def pendulum(edit):
    """Another case, of half a second, which agrees."""
    edit("pendulum.toml", "until = 10.0", "until = 0.5")
    return edit("pendulum.toml", "n = 1001", "n = 51")


def outcomes_of(result, name):
    """The outcomes of a case in a result."""
    return {c.outcome for c in result.comparisons if c.case == name}


def test_a_model_that_is_too_large_does_not_affect_other_cases(models, edit, keep_solver, pendulum):
    edit("fourbar.xml", r"(?s)<mujoco.*</mujoco>", LARGE_MODEL)
    keep_solver("fourbar_released.toml", "mujoco")
    edit("fourbar_released.toml", r"(?m)^(solvers = .*)", r"\1\ntimeout = 0.5")
    began = time.monotonic()
    result = check([models / "fourbar_released.toml", pendulum], detectable=False, causes=False)
    assert outcomes_of(result, "fourbar_released") == {"timed out"}
    assert "agrees" in outcomes_of(result, "pendulum")
    assert result.exit_code == 1
    assert time.monotonic() - began < 120  # without a limit it took more than ten minutes


def test_a_reference_that_takes_too_long_does_not_affect_other_cases(models, edit, pendulum):
    edit("rod_pinned.toml", r"(?m)^pin_x = .*", "pin_x = -0.8")
    edit("rod_pinned.toml", r"(?m)^solvers = .*", 'solvers = ["mujoco"]\ntimeout = 2')
    result = check([models / "rod_pinned.toml", pendulum], detectable=False, causes=False)
    assert outcomes_of(result, "rod_pinned") == {"timed out"}
    assert any("timeout in [run.equilibrium] allows more" in c.message for c in result.comparisons)
    assert "agrees" in outcomes_of(result, "pendulum")


def test_more_samples_than_memory_do_not_affect_other_cases(models, edit, keep_solver):
    keep_solver("pendulum.toml", "mujoco")
    keep_solver("slider_crank.toml", "mujoco")
    edit("pendulum.toml", "n = 1001", "n = 100000000\nmemory = 0.5")
    result = check(
        [models / "pendulum.toml", models / "slider_crank.toml"], detectable=False, causes=False
    )
    assert outcomes_of(result, "pendulum") == {"out of memory"}
    assert any("memory in [run.dynamics] allows more" in c.message for c in result.comparisons)
    assert "agrees" in outcomes_of(result, "slider_crank")
    assert result.exit_code == 1


def test_an_unexpected_exception_is_an_error_of_its_own_case(models, monkeypatch):
    module = importlib.import_module("proofmass.batch.check")

    def fail(task, *options):
        if task[0].name == "pendulum":
            raise ZeroDivisionError("by zero")
        return found(task, *options)

    found = module.run_task
    monkeypatch.setattr(module, "run_task", fail)
    result = check(
        [models / "pendulum.toml", models / "slider_crank.toml"], detectable=False, causes=False
    )
    assert "agrees" in outcomes_of(result, "slider_crank")
    assert [str(e.file.name) for e in result.errors] == ["pendulum.toml"] * len(result.errors)
    assert "ZeroDivisionError: by zero" in str(result.errors[0])
    assert result.exit_code == 2


@pytest.mark.parametrize(
    "deep",
    [  # `tomllib` takes a minute for the second one
        pytest.param("x = " + "[" * 100_000, id="arrays"),
        pytest.param("a" + ".a" * 50_000 + " = 1", id="tables"),
    ],
)
def test_a_deeply_nested_sidecar_does_not_affect_other_cases(models, deep, monkeypatch, pendulum):
    monkeypatch.setattr(importlib.import_module("proofmass.batch.check"), "LOADING_SECONDS", 5.0)
    (models / "deep.toml").write_text(deep)
    result = check([models / "deep.toml", pendulum], detectable=False, causes=False)
    assert [e.file.name for e in result.errors] == ["deep.toml"]
    assert "agrees" in outcomes_of(result, "pendulum")


def test_the_worker_that_ran_last_is_called_first():
    """Of two idle workers the one that ran last is called, since it may have stored results."""
    close_idle_workers()
    other = threading.Thread(target=call_isolated, args=(time.sleep, 0.3), kwargs={"timeout": 9})
    other.start()
    call_isolated(os.getpid, timeout=9)
    other.join()
    assert idle_workers.qsize() == 2
    assert len({call_isolated(os.getpid, timeout=9) for _ in range(4)}) == 1


@pytest.fixture
def short_periods(monkeypatch):
    """An idle call is ended after 0.2 s instead of 6."""
    monkeypatch.setattr(worker, "MIN_PERIOD", 0.1)


def compute_for_ever() -> None:
    """Compute without an end."""
    while True:
        pass


def test_a_call_that_computes_for_ever_is_told_from_a_crash():
    with pytest.raises(TimedOut, match=r"^no answer in 0\.2 s of processor time$"):
        call_isolated(compute_for_ever, timeout=0.2)
    with pytest.raises(Crashed, match="killed by signal 6"):
        call_isolated(os.abort, timeout=0.2)


def test_time_without_the_processor_does_not_count():
    """On a busy machine a call waits for the processor for longer than its limit."""
    call_isolated(abs, -3, timeout=20)
    assert call_isolated(time.sleep, 0.3, timeout=0.1) is None


@pytest.mark.parametrize("timeout", [0.1, 0.3])
def test_the_limit_is_that_of_one_call_not_of_all_calls_of_a_worker(timeout):
    """Linux counts the limit in ticks of up to 10 ms, which are no share of these limits."""
    close_idle_workers()
    with pytest.raises(TimedOut):
        call_isolated(compute_for_ever, timeout=timeout)  # a busy system may lose half of the ticks
    process = call_isolated(os.getpid, timeout=20)
    for _ in range(3):
        call_isolated(compute, 0.6 * timeout, timeout=timeout)
    assert call_isolated(os.getpid, timeout=20) == process


def compute(seconds: float) -> None:
    """Compute for a processor time [s]."""
    began = processor_time()
    while processor_time() - began < seconds:
        pass


def test_one_idle_period_does_not_end_a_call(short_periods, monkeypatch):
    """A call that Ctrl-Z stopped for a while has one idle period, at whose end it goes on."""
    used = iter([0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    monkeypatch.setattr(worker, "processor_seconds", lambda _: next(used))
    with pytest.raises(TimedOut, match=r"^no answer in 0\.\d s of wall time, the last 0\.2 s"):
        call_isolated(time.sleep, 60, timeout=0.05)
    assert not list(used)


@pytest.mark.parametrize(("limit", "period"), [(0.01, 3.0), (20.0, 20.0), (120.0, 60.0)])
def test_a_watch_looks_twice_before_it_ends_a_call(limit, period, monkeypatch):
    """After 6 s at least, and after two minutes at most; later where it cannot look."""
    process = SimpleNamespace(pid=os.getpid())
    monkeypatch.setattr(worker, "processor_seconds", lambda _: 0.0)
    watch = worker.IdleWatch(process, limit)
    assert (watch.period, watch.patience) == (period, 2)
    monkeypatch.setattr(worker, "processor_seconds", lambda _: None)
    blind = worker.IdleWatch(process, limit)
    assert (blind.period, blind.patience) == (limit, 20)


@pytest.mark.parametrize(("share", "periods"), [(0.009, 2), (0.011, 4)])
def test_a_call_with_less_than_a_hundredth_of_a_processor_is_idle(
    share, periods, short_periods, monkeypatch
):
    """With two periods of more than that, then none, it is ended after four."""
    used = iter([0.0, share, 2 * share, 3 * share, *[3 * share] * 2])
    scaled = (0.1 * seconds for seconds in used)  # of a period of 0.1 s
    monkeypatch.setattr(worker, "processor_seconds", lambda _: next(scaled))
    words = rf"^no answer in {0.1 * periods:g} s of wall time"
    with pytest.raises(TimedOut, match=words):
        call_isolated(time.sleep, 60, timeout=0.05)


COMPUTES = "import time\nwhile time.process_time() < 0.3: pass\nprint(flush=True); time.sleep(600)"


def times_with_child() -> tuple[float, float, float, float]:
    """The processor time of this process without a child, with one, after it, and by `os` [s].

    The child computes for 0.3 s; another one sleeps.
    """
    alone = worker.processor_seconds(os.getpid())
    command = [sys.executable, "-I", "-S", "-c", COMPUTES]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE) as child,
        subprocess.Popen(["sleep", "600"]) as idle,
    ):
        child.stdout.readline()
        both = worker.processor_seconds(os.getpid())
        child.kill()
        idle.kill()
    after = worker.processor_seconds(os.getpid())
    return alone, both, after, sum(os.times()[:4])


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the system has no /proc")
def test_the_processor_time_of_a_process_includes_that_of_its_children():
    """The system counts the time of a child as its parent's when the child has ended."""
    alone, both, after, stated = call_isolated(times_with_child, timeout=20)
    assert 0.25 < both - alone < 0.9
    assert after == pytest.approx(stated, abs=0.1)
    assert after >= both - 0.05
    assert call_isolated(worker.processor_seconds, 2**22 + 1, timeout=20) is None  # no such process


def remaining_time() -> tuple[float, float]:
    """Processor time and wall time after which the timers of this process end it [s]."""
    return signal.getitimer(signal.ITIMER_PROF)[0], signal.getitimer(signal.ITIMER_REAL)[0]


@pytest.mark.parametrize(("timeout", "longest"), [(20.0, 2000.0), (1.0, 300.0)])
def test_a_worker_ends_itself_after_a_hundred_times_its_limit(timeout, longest):
    processor, wall = call_isolated(remaining_time, timeout=timeout)
    assert 0.5 * timeout < processor <= timeout + 0.01  # the timer counts in ticks of 4 ms
    assert 0.5 * longest < wall <= longest


def test_a_waiting_call_ends_where_the_system_shows_no_processor_time(monkeypatch):
    monkeypatch.setattr(worker, "processor_seconds", lambda _: None)
    with pytest.raises(TimedOut, match=r"^no answer in 0\.2 s of wall time$"):
        call_isolated(time.sleep, 60, timeout=0.01)


def test_a_call_that_hangs_is_killed_and_the_next_one_is_answered(short_periods):
    with pytest.raises(TimedOut, match=r"the last 0\.2 s without use of a processor"):
        call_isolated(time.sleep, 60, timeout=0.01)
    with pytest.raises(InputError):
        call_isolated(raise_input_error, timeout=20)


def loads_windows() -> bool:
    """Whether importing MuJoCo loads GLFW, its library for windows."""
    import mujoco  # noqa: F401

    return "glfw" in sys.modules


@pytest.mark.parametrize(("value", "loads"), [(None, False), ("glfw", True)])
def test_a_worker_loads_no_library_for_windows_unless_requested(value, loads, monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    if value:
        monkeypatch.setenv("MUJOCO_GL", value)
    close_idle_workers()
    assert call_isolated(loads_windows, timeout=60) is loads
    close_idle_workers()


def raise_input_error() -> None:
    raise InputError(Path("a"), "b", "c")


def has_busy_worker(process_id: int) -> bool:
    """Whether a process has a worker that has used more processor time than loading takes.

    Without an interrupt it would compile for the two minutes of its time limit.
    """
    threads = Path(f"/proc/{process_id}/task").glob("*/children")
    workers = [worker for file in threads for worker in file.read_text().split()]
    states = [Path(f"/proc/{one}/stat").read_text().rpartition(")")[2].split() for one in workers]
    spent = [int(state[11]) + int(state[12]) for state in states]
    return max(spent, default=0) > 1.5 * os.sysconf("SC_CLK_TCK")


def test_ctrl_c_ends_a_check_whose_runs_would_go_on(models, edit):
    edit("fourbar.xml", r"(?s)<mujoco.*</mujoco>", LARGE_MODEL)
    process = subprocess.Popen(
        [sys.executable, "-m", "proofmass", "check", models / "fourbar.toml"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 20.0  # the end of waiting where there is no /proc
    while not has_busy_worker(process.pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    assert process.wait(60.0) == 130


def raise_signal(number: int, answer: signal.Handlers | None = None) -> None:
    """Send a signal to this process, also if its caller ignores that signal.

    Without an `answer`, Ctrl-C raises an exception, as in any process of Python.
    """
    signal.signal(number, signal.default_int_handler if answer is None else answer)
    signal.raise_signal(number)


def test_a_ctrl_c_that_reaches_the_worker_first_is_no_crash():
    """A terminal sends Ctrl-C to all its processes, and a worker may end before its caller."""
    with pytest.raises(KeyboardInterrupt):
        call_isolated(raise_signal, signal.SIGINT, timeout=20)
    with pytest.raises(Crashed, match=r"killed by signal 15 \(SIGTERM\)"):
        call_isolated(raise_signal, signal.SIGTERM, signal.SIG_DFL, timeout=20)


def test_an_interrupt_leaves_no_watch_that_the_process_would_wait_for(monkeypatch):
    """After Ctrl-C no watch of a call keeps the process from ending.

    Once, Ctrl-C right after the start of a timer delayed the end until the timer ran out.
    """
    begin = threading.Thread.start

    def interrupted(thread):
        begin(thread)
        if isinstance(thread, worker.IdleWatch):
            watches.append(thread)
            raise KeyboardInterrupt

    watches = list[worker.IdleWatch]()
    monkeypatch.setattr(threading.Thread, "start", interrupted)
    with pytest.raises(KeyboardInterrupt):
        call_isolated(abs, -1, timeout=600.0)
    assert len(watches) == 1
    assert watches[0].daemon
    assert watches[0].ended.is_set()


@pytest.mark.parametrize(
    "start", [["-m", "proofmass"], ["-c", "from proofmass.commands.cli import app; app()"]]
)
def test_no_module_in_a_strangers_folder_is_run(start, tmp_path):
    """Python itself would import them: as start-up module, as library, and as an engine.

    In a session of Python the first import of a library is the user's own, from the current folder.
    """
    ran = tmp_path / "ran"
    strange = tmp_path / "strange"
    strange.mkdir()
    for file in (shipped("pendulum.toml"), shipped("pendulum.xml")):
        (strange / file.name).write_bytes(file.read_bytes())
    names = ["sitecustomize", "usercustomize", "evil", *["mujoco", "pint"] * (start[0] == "-m")]
    for name in names:
        (strange / f"{name}.py").write_text(f"open({str(ran)!r}, 'a').write({name!r})")
    info = strange / "evil-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: evil\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[proofmass.engines]\nevil = evil:Engine\n")
    found = subprocess.run(
        [sys.executable, *start, "check", "pendulum.toml", "-j", "1"],
        cwd=strange,
        text=True,
        capture_output=True,
        check=False,
    )
    assert found.returncode == 0, found.stderr
    assert not ran.exists(), ran.read_text()


CALLER = """
import runpy, threading
from proofmass.base.worker import busy_workers, call_isolated
call_isolated(abs, -3, timeout=60)  # so that the worker of the next call is there
endless = "x = 0\\nwhile True: x += 1"
call = {"target": call_isolated, "args": (exec, endless), "kwargs": {"timeout": 600}}
threading.Thread(**call).start()
while not busy_workers:
    pass
print(*(worker.process.pid for worker in busy_workers), flush=True)
"""


def runs(process: int) -> bool:
    """Whether a process is there and has not ended."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state not in "ZX"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the system has no /proc")
def test_no_worker_survives_a_caller_that_is_killed():
    command = [sys.executable, "-c", CALLER]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as caller:
        assert caller.stdout
        busy = int(caller.stdout.readline())
        assert runs(busy)
        caller.kill()
    for _ in range(600):
        if not runs(busy):
            return
        time.sleep(0.1)
    raise AssertionError("the worker still runs a minute after its caller was killed")


def usual_tick() -> float:
    """The median change of the clock by which runs are timed [s]."""
    times = [processor_time()]
    while len(times) < 100:
        if (now := processor_time()) != times[-1]:
            times.append(now)
    return sorted(later - sooner for sooner, later in pairwise(times))[len(times) // 2]


def test_the_clock_of_runs_is_fine_in_a_worker_although_its_time_is_limited():
    """The processor time of the process moves in ticks of milliseconds there."""
    if clock.IS_FINE:
        assert call_isolated(usual_tick, timeout=60) < 1e-4
