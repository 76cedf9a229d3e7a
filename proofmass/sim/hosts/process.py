"""Start the interpreter of an engine by uv, keep it, and ask it for runs.

An interpreter is a child of the process that makes a run, which is a worker with limits of its own.
It is kept for the next run of the same engine and version, gets the limits of the worker, and ends
with it.  An engine that dies or hangs costs its own run: the next one starts another interpreter.
"""

import atexit
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from math import nan
from pathlib import Path
from typing import Any, cast

try:
    import resource
except ImportError:  # Windows, where memory has no limit
    resource = None  # type: ignore[assignment]

from proofmass.base.worker import (
    DEFAULT_ENVIRONMENT,
    SINGLE_THREAD,
    Crashed,
    OutOfMemory,
    TimedOut,
    longest_wall_time,
    name_signal,
)
from proofmass.sim import interpreter
from proofmass.sim.interpreter import wire
from proofmass.sim.interpreter.mechanism import LinkStates, NeutralMechanism
from proofmass.sim.protocol.failures import Unavailable, Unsupported

SERVE = Path(interpreter.__file__).parent / "serve.py"
MISSING_MODULE = re.compile(r"No module named '[\w.]+'")
"""What Python says of a module that is not there."""
STARTED_MARK = "started"
"""File that an interpreter writes into its folder when it runs: uv has got the packages."""
LONGEST_END = 10.0
"""Wall time in which an interpreter whose output is closed may still end by itself [s]."""
SAID_CHARACTERS = 240
"""Characters that are kept of what an interpreter wrote before it died."""
ENDED_BY_SIGNAL = 128
"""uv ends with this number plus that of the signal which ended the interpreter."""
FALLBACK_SECONDS, FALLBACK_MEMORY = 3600.0, 8 * 2**30
"""Limits of a run in a process without limits of its own [s, bytes]."""


@cache
def find_uv() -> str:
    """The program uv: that of the search path, or that of the package of this name.

    Raises
    ------
    Unavailable
        There is none.
    """
    if found := shutil.which("uv"):
        return found
    if find_spec("uv"):
        import uv

        return str(uv.find_uv_bin())
    raise Unavailable("uv is not installed, which starts engines of other versions: pip install uv")


def start_command(requires: Sequence[str], python: str = "") -> list[str]:
    """The command that starts an interpreter with packages, before its own arguments.

    It has neither the packages nor the configuration of the current folder.
    """
    if python:
        if not shutil.which(python):
            raise Unavailable(f"there is no interpreter {python}")
        return [python, "-I"]
    packages = [part for one in requires for part in ("--with", one)]
    flags = ["--isolated", "--no-project", "--quiet", "--python", sys.executable]
    return [find_uv(), "run", *flags, *packages, "python", "-I"]


def provide(requires: Sequence[str], python: str = "") -> str:
    """Let uv fetch packages, so that runs need not wait for it.

    Returns
    -------
    str
        Why they cannot be had; empty if they are there.
    """
    try:
        said = start_once(start_command(requires, python))
    except Unavailable as error:
        return str(error)
    return "" if said is None else explain_uv(said, requires)


def is_fetched(requires: Sequence[str], python: str = "") -> str:
    """Whether packages are there already, in words: nothing is fetched."""
    try:
        command = start_command(requires, python)
    except Unavailable as error:
        return str(error)
    if python:
        return f"runs in {python}"
    command.insert(command.index("--quiet"), "--offline")
    return "fetched" if start_once(command) is None else "uv fetches it"


def start_once(command: Sequence[str]) -> str | None:
    """Start an interpreter that does nothing; returns what was said if it does not start."""
    with tempfile.TemporaryDirectory() as nowhere:
        made = subprocess.run(
            [*command, "-c", ""], capture_output=True, text=True, cwd=nowhere, check=False
        )
    return made.stderr if made.returncode else None


def explain_uv(text: str, requires: Sequence[str]) -> str:
    """What uv says of packages that cannot be had, in a line."""
    words = " ".join(re.sub(r"[╰╭│─▶×]|-->|├|└", " ", text).split())
    named = ", ".join(requires)
    if "no wheels with a matching" in words or "no wheels are available" in words:
        return f"{named} has no wheel for this Python or system: {words[:SAID_CHARACTERS]}"
    if "no version of" in words or "was not found in the package registry" in words:
        return f"{named} is not in the package index: {words[:SAID_CHARACTERS]}"
    return f"{named} cannot be had: {words[:SAID_CHARACTERS] or 'uv does not say why'}"


PACKAGE_NAME = re.compile(r"[A-Za-z0-9._-]+")
"""The name of a package at the beginning of a requirement."""


def other_packages(requires: Sequence[str], installed: dict[str, str]) -> str:
    """Which packages an interpreter has in other versions than required, or not at all, in words.

    >>> other_packages(("a==1.0", "b[x]==2.0"), {"a": "1.0", "b": ""})
    'no b, and not b 2.0'
    """
    for one in requires:
        name, version = PACKAGE_NAME.match(one)[0], one.partition("==")[2]  # type: ignore[index]
        if installed.get(name) != version:
            there = f"{name} {installed[name]}" if installed.get(name) else f"no {name}"
            return f"{there}, and not {name} {version}"
    return ""


def advise(words: str) -> str:
    """The words of an error; of a module that is not there with what to do."""
    missing = MISSING_MODULE.search(words)
    return f"{missing[0]}: add its package to what the engine requires" if missing else words


class Host:
    """An interpreter with an engine.

    Parameters
    ----------
    script : Path
        The script of the engine.
    requires : sequence of str
        Packages, such as ``drake==1.51.1``.
    python : str
        An interpreter that has them already; empty: uv makes one.

    Raises
    ------
    Unavailable
        There is no uv, or it cannot get a package.
    Crashed
        The engine cannot be imported.
    """

    def __init__(self, script: Path, requires: Sequence[str], python: str = "") -> None:
        names = [PACKAGE_NAME.match(one)[0] for one in requires]  # type: ignore[index]
        command = [*start_command(requires, python), str(SERVE), str(script), *names]
        self.errors, self.words = tempfile.TemporaryFile(), ""  # noqa: SIM115, closed with the host
        self.folder, self.started = tempfile.TemporaryDirectory(), False
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            cwd=self.folder.name,
            env=DEFAULT_ENVIRONMENT | dict(os.environ) | SINGLE_THREAD,
        )
        try:
            ready = self.receive()
        except Crashed:
            if not python and not self.started:
                raise Unavailable(explain_uv(self.words, requires)) from None
            raise
        if "error" in ready:
            self.close()
            raise Crashed(f"{script.stem} cannot be loaded: {advise(ready['error'])}")
        self.versions: dict[str, str] = ready["versions"]
        # uv gives what it was asked for
        if python and (wrong := other_packages(requires, ready["installed"])):
            self.close()
            raise Unavailable(f"{python} has {wrong}")

    @property
    def alive(self) -> bool:
        """Whether the interpreter waits for a request."""
        return self.process.poll() is None

    def run(self, mechanism: NeutralMechanism, settings: dict[str, object]) -> LinkStates:
        """The states of a run.

        Raises
        ------
        Unsupported
            The engine refuses something of the mechanism.
        Crashed, TimedOut, OutOfMemory
            The interpreter died, or the engine raised an exception.
        """
        seconds, memory = remaining_limits()
        self.errors.seek(0)
        self.errors.truncate()
        request = {
            "mechanism": mechanism,
            "settings": settings,
            "seconds": seconds,
            "wall_seconds": longest_wall_time(seconds),
            "memory": memory,
            "processors": own_processors(),
        }
        try:
            to = cast(Any, self.process.stdin)
            wire.send(to, request)
        except BrokenPipeError:
            raise self.death(seconds) from None
        answer = self.receive(seconds)
        if "refused" in answer:
            raise Unsupported(answer["refused"])
        if "memory" in answer:
            raise OutOfMemory(f"needs more than {memory / 2**30:g} GiB of memory")
        if "error" in answer:
            raise Crashed(answer["error"])
        self.versions = answer["versions"]
        return cast(LinkStates, answer["states"])

    def receive(self, seconds: float = 0.0) -> Any:
        """The next message; raises what `death` makes if there is none."""
        try:
            return wire.receive(cast(Any, self.process.stdout))
        except (EOFError, ValueError, KeyError, OSError):
            raise self.death(seconds) from None

    def death(self, seconds: float) -> Exception:
        """The exception that says how the interpreter ended.

        It may still be about to end with its own exit code, when its output is closed already: to
        close its input then would make it end otherwise.
        """
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(LONGEST_END)
        self.close()
        code = self.process.returncode
        number = -code if code < 0 else code - ENDED_BY_SIGNAL
        if number in (signal.SIGPROF, signal.SIGALRM):
            return TimedOut(f"no answer in {seconds:.3g} s of processor time")
        how = f"killed by signal {name_signal(number)}" if number > 0 else f"exit code {code}"
        said = " ".join(self.words.split())
        if MISSING_MODULE.search(said):
            return Crashed(advise(said))
        words = said if len(said) <= SAID_CHARACTERS else f"… {said[-SAID_CHARACTERS:]}"
        return Crashed(f"the interpreter of the engine ended: {how}" + (words and f": {words}"))

    def close(self) -> None:
        """End the interpreter, which ends when its standard input closes; `words` are its last."""
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                with suppress(BrokenPipeError):
                    stream.close()
        try:
            self.process.wait(1.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        if not self.errors.closed:
            self.errors.seek(0)
            self.words = self.errors.read().decode(errors="replace")
            self.errors.close()
        self.started = self.started or Path(self.folder.name, STARTED_MARK).exists()
        self.folder.cleanup()


def remaining_limits() -> tuple[float, int]:
    """Processor time that this process has left [s], and the memory it may use [bytes]."""
    seconds, memory = 0.0, FALLBACK_MEMORY
    if hasattr(signal, "getitimer"):
        seconds = signal.getitimer(signal.ITIMER_PROF)[0]
    if resource is not None:
        own = resource.getrlimit(resource.RLIMIT_DATA)[0]
        memory = FALLBACK_MEMORY if own == resource.RLIM_INFINITY else own
    return seconds or FALLBACK_SECONDS, memory


def own_processors() -> list[int]:
    """Processors that this process may use, which its interpreters use as well; empty: all."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []


def measure_start(script: Path, requires: Sequence[str], python: str = "") -> float:
    """Processor time in which an interpreter starts and imports its engine [s].

    That of uv is part of it.  No other child of this process may end meanwhile; NaN where the
    system does not count the processor time of children.

    Raises
    ------
    Unavailable, Crashed
        See `Host`.
    """
    if resource is None:
        return nan
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    Host(script, requires, python).close()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


_hosts: dict[tuple[str, ...], Host] = {}
"""The interpreters of this process, by script, packages and given interpreter."""


def host_of(script: Path, requires: Sequence[str], python: str = "") -> Host:
    """The interpreter of an engine, started if none waits."""
    key = (str(script), *requires, python)
    found = _hosts.get(key)
    if found is None or not found.alive:
        found = _hosts[key] = Host(script, requires, python)
    return found


@atexit.register
def close_hosts() -> None:
    """End all interpreters of this process."""
    for host in _hosts.values():
        host.close()
