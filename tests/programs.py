"""Programs that stand alone, such as `choose` writes, run where nothing of a test is loaded.

Each runs in a fork of one interpreter, started with -I, which has loaded the engines: that takes
longer than most of the programs.
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

from proofmass.analytic.numerics import Array

FORKS = """
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
STREAMS = (os.devnull, "stdout.txt", "stderr.txt")
"""Standard input, output and errors of a program."""


@cache
def forking() -> subprocess.Popen[str]:
    """The interpreter that programs are forks of; it ends when this process does."""
    command = [sys.executable, "-I", "-c", FORKS]
    return subprocess.Popen(command, stdin=PIPE, stdout=PIPE, text=True)


def run_alone(file: Path, *args: str) -> CompletedProcess[str]:
    """Run a program to its end in its own folder, and keep what it prints."""
    folder, process = file.parent, forking()
    assert process.stdin is not None
    assert process.stdout is not None
    asked = json.dumps([str(folder), [file.name, *args], STREAMS])
    print(asked, file=process.stdin, flush=True)
    code = int(process.stdout.readline())
    printed, errors = ((folder / name).read_text(encoding="utf-8") for name in STREAMS[1:])
    return CompletedProcess([file.name, *args], code, printed, errors)


def program_curves(text: str, folder: Path) -> dict[str, Array]:
    """The columns that a program writes in a folder, where it runs without a complaint."""
    file = folder / "run.py"
    file.write_text(text, encoding="utf-8")
    done = run_alone(file)
    assert (done.returncode, done.stderr) == (0, "")
    with (folder / "curves.csv").open(newline="", encoding="utf-8") as stream:
        head, *rows = csv.reader(stream)
    return dict(zip(head, np.array(rows, float).T, strict=True))
