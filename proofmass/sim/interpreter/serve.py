"""The program that runs in the interpreter of an engine: ``python serve.py SCRIPT PACKAGE…``.

It loads the script of the engine, and answers requests on standard input with messages on standard
output, see `wire`.  What the engine prints goes to standard error.  It ends when standard input
closes, also in the middle of a run.

A request has the mechanism, the settings, limits of processor time [s], wall time [s] and memory
[bytes], and the numbers of the processors to use.  An answer has one of

    states      the `LinkStates` of the run, with the versions of what computed
    refused     what the engine cannot express
    error       the type and the message of an exception of the engine
"""

from __future__ import annotations

import importlib.util
import io
import os
import queue
import signal
import sys
import threading
import traceback
from importlib import metadata
from typing import Any

HERE = os.path.dirname(os.path.abspath(__file__))
PACKAGE = "proofmass_host"


def load_package() -> None:
    """Make this folder importable as a package, whatever its own name; no path is added."""
    sys.path[:] = [one for one in sys.path if os.path.abspath(one or os.getcwd()) != HERE]
    load_module(PACKAGE, os.path.join(HERE, "__init__.py"), [HERE])


def load_module(name: str, path: str, inside: Any = None) -> Any:
    """Import a file under a name."""
    spec = importlib.util.spec_from_file_location(name, path, submodule_search_locations=inside)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def load_beside(script: str, name: str) -> Any:
    """A module of a file beside a script, which is not on the path of its interpreter."""
    return load_module(name, os.path.join(os.path.dirname(script), f"{name}.py"))


def main() -> None:
    """Load the engine, say that it is there, and answer requests."""
    with open("started", "w"):  # in a folder of its own: uv has done its part
        pass
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    sys.stdout = os.fdopen(1, "w", buffering=1, closefd=False)
    load_package()
    from proofmass_host import wire

    requests: queue.SimpleQueue = queue.SimpleQueue()
    threading.Thread(target=receive_requests, args=(wire, requests), daemon=True).start()
    try:
        script = load_module("proofmass_engine", sys.argv[1])
        ready: dict[str, Any] = {
            "versions": dict(attribute_of(script, "VERSIONS")),
            "installed": {name: installed_version(name) for name in sys.argv[2:]},
        }
        attribute_of(script, "simulate")
    except BaseException as error:
        ready = {"error": describe(error, sys.argv[1])}
    wire.send(answers, ready)
    if "error" in ready:
        return
    while True:
        request = wire.unpack(requests.get())
        limit(request["seconds"], request["wall_seconds"], request["memory"])
        use_processors(request["processors"])
        answer = answer_request(script, request)
        limit(0.0, 0.0, request["memory"])
        wire.send(answers, answer)


def answer_request(script: Any, request: dict) -> dict:
    """The answer to a request, see the module."""
    from proofmass_host import LinkStates, Refused

    try:
        states = script.simulate(request["mechanism"], request["settings"])
        if not isinstance(states, LinkStates):
            raise TypeError(f"simulate returned {type(states).__name__}, not LinkStates")
        return {"states": states, "versions": dict(script.VERSIONS)}
    except Refused as error:
        return {"refused": str(error)}
    except MemoryError:
        return {"memory": True}
    except Exception as error:
        return {"error": describe(error, script.__file__)}


def describe(error: BaseException, script: str) -> str:
    """The type and the message of an exception, with the last line of the script, in a line."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == script]
    where = f" ({os.path.basename(script)}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {' '.join(str(error).split())[:400]}{where}"


def attribute_of(script: Any, name: str) -> Any:
    """An attribute of the script, which it must have."""
    if not hasattr(script, name):
        raise AttributeError(f"{os.path.basename(script.__file__)} has no {name}")
    return getattr(script, name)


def installed_version(package: str) -> str:
    """The version of a package in this interpreter; empty if it is not there."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def receive_requests(wire: Any, requests: Any) -> None:
    """Read requests until standard input closes, then end this process."""
    try:
        with io.FileIO(0, closefd=False) as stream:
            while True:
                requests.put(wire.receive_body(stream))
    finally:
        os._exit(0)


def limit(seconds: float, wall_seconds: float, memory: int) -> None:
    """Let the system end this process after two times [s], 0: never; limit its memory [bytes]."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_PROF, seconds)
        signal.setitimer(signal.ITIMER_REAL, wall_seconds)
    try:
        import resource
    except ImportError:
        return
    most = resource.getrlimit(resource.RLIMIT_DATA)[1]
    wanted = memory if most == resource.RLIM_INFINITY else min(memory, most)
    if memory:
        resource.setrlimit(resource.RLIMIT_DATA, (wanted, most))


def use_processors(numbers: list) -> None:
    """Run on some processors, those of the process that asks; on any if there are no numbers."""
    if numbers and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, numbers)


if __name__ == "__main__":
    main()
