"""The number of files of the package that a reader passes when following a command.

    python -m benchmarks.files_passed [--quick]

The files of proofmass/ in which a function is called are counted, in the command and in all of its
workers.  A file that is only imported does not count.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from shutil import copy
from tempfile import TemporaryDirectory

from benchmarks import ROOT, command

RECORDER = """
import os, sys, threading
found = set()
def called(frame, event, _):
    code = frame.f_code
    if event == "call" and code.co_flags & 1 and code.co_filename not in found:  # 1: a function
        found.add(code.co_filename)
        with open(os.path.join({folder!r}, f"{{os.getpid()}}.txt"), "a") as file:
            print(code.co_filename, file=file)  # at once: workers are killed
threading.setprofile(called)
sys.setprofile(called)
"""
COMMANDS = {  # arguments, and the largest number of files that is intended
    "check of a four-bar": (("-m", "proofmass", "check", "models/linkages/fourbar.toml"), 42),
    "report of a four-bar": (
        ("-m", "proofmass", "report", "models/linkages/fourbar.toml", "-o", "{folder}/report"),
        68,
    ),
    "trade to its page": (
        (
            "-m",
            "proofmass",
            "trade",
            "models/linkages/pendulum.toml",
            "-o",
            "{folder}/trade",
            "--longest",
            "2",
        ),
        68,
    ),
    "check of a model without a sidecar": (("-m", "proofmass", "check", "{folder}/bare.xml"), 28),
    "a rod to its chain": (
        (
            "-c",
            "from proofmass.run.sidecar import load_case\n"
            "from proofmass.reference.case_model import compiled_model\n"
            "compiled_model(load_case('models/rods/rod_cantilever.toml'))",
        ),
        30,
    ),
}
BARE_MODEL = ROOT / "models/linkages/pendulum.xml"


def main(argv: Sequence[str] | None = None) -> None:
    given = command(__doc__).parse_args(argv)
    for name, (arguments, aim) in COMMANDS.items():
        if given.quick and name != "a rod to its chain":
            continue
        files = called_files(arguments)
        print(f"{name}: {len(files)} files, aim {aim}")
        for file in files:
            print(f"    {file}")


def called_files(arguments: Sequence[str]) -> list[str]:
    """The files of the package with a function that a command calls, below proofmass/."""
    with TemporaryDirectory() as folder:
        Path(folder, "sitecustomize.py").write_text(RECORDER.format(folder=folder))
        copy(BARE_MODEL, Path(folder, "bare.xml"))
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([folder, str(ROOT)])}
        subprocess.run(
            [sys.executable, *(word.format(folder=folder) for word in arguments)],
            cwd=ROOT,
            env=environment,
            check=True,
            stdout=subprocess.DEVNULL,
        )
        found = {
            line
            for file in Path(folder).glob("*.txt")
            for line in file.read_text().splitlines()
            if line.endswith(".py")
        }
    package = f"{ROOT / 'proofmass'}{os.sep}"
    return sorted(path.removeprefix(package) for path in found if path.startswith(package))


if __name__ == "__main__":
    main()
