"""Run standalone programs, such as those that `proofmass choose` writes, without test modules.

Each program runs in a fork of one interpreter, which cannot import proofmass and has loaded the
engines, since loading them takes longer than most of the programs.
"""

import csv
import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from subprocess import PIPE, CompletedProcess

import numpy as np

from proofmass.base.arrays import Array
from proofmass.studies.trade.program import BLOCK_PROOFMASS

FORKING_PROGRAM = """
import json, os, runpy, sys
import mujoco, numpy, pymunk

for line in sys.stdin:
    folder, sys.argv, streams = json.loads(line)
    if not os.fork():
        os.chdir(folder)
        for number, name in enumerate(streams):
            os.dup2(os.open(name, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o600), number)
        runpy.run_path(sys.argv[0], run_name="__main__")
        break  # the fork ends as its program does
    print(os.waitstatus_to_exitcode(os.wait()[1]), flush=True)
"""
STREAM_FILES = (os.devnull, "stdout.txt", "stderr.txt")
"""Files for the standard input, output and errors of a program."""


@cache
def forking_interpreter() -> subprocess.Popen[str]:
    """The interpreter that forks for each program; it ends when this process ends."""
    command = [sys.executable, "-I", "-c", f"{BLOCK_PROOFMASS}\n{FORKING_PROGRAM}"]
    return subprocess.Popen(command, stdin=PIPE, stdout=PIPE, text=True)


def run_standalone(file: Path, *args: str) -> CompletedProcess[str]:
    """Run a program in its own folder until it ends; the result has its exit code and output."""
    folder, process = file.parent, forking_interpreter()
    assert process.stdin is not None
    assert process.stdout is not None
    asked = json.dumps([str(folder), [file.name, *args], STREAM_FILES])
    print(asked, file=process.stdin, flush=True)
    code = int(process.stdout.readline())
    printed, errors = ((folder / name).read_text(encoding="utf-8") for name in STREAM_FILES[1:])
    return CompletedProcess([file.name, *args], code, printed, errors)


def program_curves(text: str, folder: Path) -> dict[str, Array]:
    """Run the text of a program, which must print no errors; return the columns it writes."""
    file = folder / "run.py"
    file.write_text(text, encoding="utf-8")
    done = run_standalone(file)
    assert (done.returncode, done.stderr) == (0, "")
    with (folder / "curves.csv").open(newline="", encoding="utf-8") as stream:
        head, *rows = csv.reader(stream)
    return dict(zip(head, np.array(rows, float).T, strict=True))
