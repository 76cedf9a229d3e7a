"""A process that judges inputs, and the object by which a test calls and replaces it.

The product reads, compiles and runs in workers with limits of time and memory.  An input that
nevertheless crashes or hangs the process that calls `check` must not end the test.  Therefore the
judge is a process of its own with a limit of memory, in a session with its workers, and its caller
ends the session if no answer comes in time.
"""

import json
import os
import re
import resource
import select
import signal
import subprocess
import sys
import tempfile
import tomllib
import traceback
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from tests.fuzz.cases import TIMEOUT, Files, small_files, start_worker, write_files

ROOT = Path(__file__).parent.parent.parent
MARGIN_SECONDS = 15.0
"""Time beyond the stated limits of all runs [s], for the start of processes on a busy machine."""
LONGEST_WAIT = 45.0
"""Longest time to wait for stated limits [s]; an input that states longer ones is not judged."""
MAX_SIDECAR_BYTES = 20_000
"""Largest size of a sidecar whose limits are read [bytes]: the memory that `tomllib` takes grows
with the square of the length of a key."""
MEMORY_LIMIT = 6 << 30
"""Address space of a judge, and of each of its engines [bytes]."""
INPUTS_PER_JUDGE = 300
"""Inputs that a judge takes before it is replaced, since the product keeps compiled models."""


@dataclass
class Verdict:
    """The result of an input: findings by their signatures, and notes, which are no findings."""

    findings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    exit_code: int | None = None
    seconds: float = 0.0
    detail: str = ""


class Judge:
    """A process that judges one input after the other, and is started again when it fails.

    With `causes` the product also searches for the causes of differences.  The search takes
    seconds, and an error in it is only a line of a diagnosis.
    """

    def __init__(self, folder: Path, causes: bool = True):
        self.folder, self.causes, self.process, self.count = folder, causes, None, 0
        self.words = None

    def start(self) -> subprocess.Popen:
        """The running process, or a new one."""
        if self.process is None or self.count % INPUTS_PER_JUDGE == 0:
            self.close()
            self.words = tempfile.TemporaryFile()  # noqa: SIM115, closed with the process
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tests.fuzz.judge"],
                cwd=ROOT,
                start_new_session=True,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self.words,
            )
            assert self.process.stdout.readline() == b"started\n", self.said()
        return self.process

    def close(self) -> None:
        """End the process and its engines."""
        if self.process is not None:
            with suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.communicate()
            self.words.close()
            self.process = None

    def said(self) -> str:
        """The end of what the process wrote to standard error."""
        self.words.seek(0)
        return self.words.read().decode(errors="replace")[-20_000:]

    def judge(self, name: str, files: Files) -> Verdict:
        """Write an input into a folder of its own and have it judged."""
        process = self.start()
        place = self.folder / f"{os.getpid()}_{self.count}"
        self.count += 1
        write_files(files, place)
        limit, stated = time_limit(files, name)
        process.stdin.write((json.dumps([str(place), name, limit, self.causes]) + "\n").encode())
        process.stdin.flush()
        ready, _, _ = select.select([process.stdout], [], [], limit + 5)
        line = process.stdout.readline() if ready else b""
        for file in place.iterdir():
            file.unlink()
        place.rmdir()
        if line:
            return Verdict(**json.loads(line))
        if not ready:
            where = hanging_place(self.said())
            self.close()
            if not stated:
                return Verdict(notes=["stated limit too long to wait for"], seconds=limit)
            return Verdict([f"hang in {where}"], seconds=limit)
        process.wait()
        words, code = self.said(), process.returncode
        self.close()
        last = [w for w in words.splitlines() if w.strip()]
        return Verdict(
            [
                f"process died: {f'signal {-code}' if code < 0 else f'exit code {code}'}: "
                f"{last[-1][:120] if last else ''}"
            ],
            detail=words[-2000:],
        )


def time_limit(files: Files, name: str) -> tuple[float, bool]:
    """Seconds to wait for an input, and whether they cover the limits that it states.

    Reading the sidecar, checking the case, and each run have limits of their own.
    """
    total, text = TIMEOUT, files[f"{name}.toml"]
    try:
        if len(text) > MAX_SIDECAR_BYTES:
            raise ValueError("too long to parse here, where memory has no limit")
        for run in tomllib.loads(text.decode()).get("run", {}).values():
            total += float(run.get("timeout", 120.0)) * (1 + len(run.get("solvers", [])))
    except (ValueError, AttributeError, TypeError, RecursionError):
        total = 7 * TIMEOUT  # as of an unchanged small case; or the input is no case
    return min(max(total, TIMEOUT), LONGEST_WAIT) + MARGIN_SECONDS, total <= LONGEST_WAIT


def innermost_place(frames: list[tuple[str, str]]) -> str:
    """The innermost function of the product in a stack of (file, function), innermost last."""
    for file, function in reversed(frames):
        for part in ("proofmass",):
            if f"/{part}/" in file and "site-packages" not in file:
                return f"{part}/{file.split(f'/{part}/')[-1]}:{function}"
    return frames[-1][1] if frames else "?"


def hanging_place(words: str) -> str:
    """Where the main thread or a task hangs, from a dump of all stacks, innermost frame first."""
    found = [
        innermost_place(re.findall(r'File "(.*?)", line \d+ in (\S+)', block)[::-1])
        for block in re.split(r"Thread |Current thread ", words.split("Timeout (")[-1])
    ]
    inner = [f for f in found if ":" in f and "check.py:check" not in f and "isolate" not in f]
    return inner[0] if inner else "; ".join(f for f in found if f != "?")[:200]


# within the process


def check_and_judge(folder: Path, name: str, causes: bool) -> Verdict:
    """Check a folder as the command line does, and judge the result."""
    from proofmass.batch.check import check
    from proofmass.formats.terminal import as_json, failure_lines, summary_tables
    from tests.fuzz.oracle import find_false_agreements

    answer = Verdict()
    try:
        result = check([folder / f"{name}.toml"], jobs=1, causes=causes)
        answer.exit_code = result.exit_code
        as_json(result)
        list(summary_tables(result, True))
        list(failure_lines(result))
    except Exception as error:
        where = [(f.filename, f.name) for f in traceback.extract_tb(error.__traceback__)]
        answer.findings.append(f"uncaught {type(error).__name__} in {innermost_place(where)}")
        answer.detail = "".join(traceback.format_exception(error))[-3000:]
        return answer
    for error in result.errors:
        answer.detail += f"{error}\n"[:1000]
        if failed := re.match(r".* failed: (\w+): ", error.wrong):  # by the handler of last resort
            answer.findings.append(f"unforeseen {failed[1]} in a run")
        if error.wrong.startswith("cannot be read: "):
            answer.notes.append(error.wrong[:80])
        if len(str(error).splitlines()) > 2 or len(str(error)) > 1000:
            answer.notes.append(f"long message about {error.key[:30] or error.file.suffix!r}")
    failed = {(c.outcome, c.message) for c in result.comparisons if c.outcome in ("crashed",)}
    answer.notes += [f"{outcome} run: {message[:80]}" for outcome, message in sorted(failed)]
    answer.notes += sorted(
        {c.outcome for c in result.comparisons if c.outcome in ("timed out", "out of memory")}
    )
    if result.exit_code != 0:
        return answer
    counts = [c.outcome for c in result.comparisons]
    if "agrees" not in counts:
        answer.notes.append("exit code 0, nothing agrees: " + ", ".join(sorted(set(counts))))
    else:
        was = sum(c.outcome == "unchecked" for c in result.comparisons)
        answer.notes += ["green, some unchecked"] * bool(was)
    try:
        false, why = find_false_agreements(folder, name, dict(small_files(name)), result)
    except Exception as error:
        answer.notes.append(f"oracle failed: {type(error).__name__}: {str(error)[:120]}")
        answer.detail = traceback.format_exc()[-3000:]
        return answer
    answer.findings += [f"false agreement: {what}" for what in false]
    if why:
        answer.notes.append(f"unjudged: {why}")
    return answer


def main() -> None:
    """Answer requests, of one line each."""
    import faulthandler
    import importlib
    import time

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    with tempfile.TemporaryDirectory() as folder:
        start_worker(Path(folder))
    importlib.import_module(
        "proofmass.batch.check"
    ).LOADING_SECONDS = TIMEOUT  # proofmass.check is a function
    print("started", file=answers, flush=True)
    for line in sys.stdin:
        folder, name, limit, causes = json.loads(line)
        faulthandler.dump_traceback_later(limit)
        began = time.perf_counter()
        answer = check_and_judge(Path(folder), name, causes)
        faulthandler.cancel_dump_traceback_later()
        answer.seconds = time.perf_counter() - began
        answers.write(json.dumps(answer.__dict__) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
