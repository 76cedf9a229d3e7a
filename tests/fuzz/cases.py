"""Small copies of shipped cases that the fuzz tests mutate: few samples, one to four short runs.

The closed forms, the models and the channels are those of `models/`.  Samples are few, paths are
short and each run has a time limit of `TIMEOUT`.  Short paths have small ranges, of which rounding
and softness are a larger share than in the shipped cases, so tolerances relative to a range are 1e4
times wider.  This does not affect the fuzz tests, whose oracle reads the tolerance that was
allowed.
"""

import re
from functools import cache
from pathlib import Path

from tests.shipped import shipped, without_defaults

TIMEOUT = 6.0
"""Limit of each run of a small case [s]; a run without a fault takes 0.05 s.  The limit includes
the start of an engine's process, 1.5 s on an idle machine."""

Files = dict[str, bytes]

SHORTENING_EDITS = [
    (r"(?m)^n = \d+", "n = 7"),
    (r'"mujoco:default", |, "pymunk:default"', ""),
    (r"(?m)^to = 6\.28\d+", "to = 0.6"),
    (
        r"relative_to_range = (\S+)",
        lambda m: f"relative_to_range = {min(float(m[1]) * 1e4, 1e-2):g}",
    ),
]
EDITS: dict[str, list] = {
    "pendulum": [*SHORTENING_EDITS, (r"until = 10\.0", "until = 0.3")],
    "fourbar": SHORTENING_EDITS,
    "fourbar_sweep": [
        *SHORTENING_EDITS,
        (r"(?s)\[run\.dynamics\].*?\n\n", ""),
        (r'"mujoco", "pymunk"', '"mujoco"'),
        (r"(?s)\[\[tolerance\]\]\nrun = \"dynamics\".*?(\n\n|\Z)", ""),
        (r"(?s)\[\[tolerance\]\]\nrun = \"sweep\"\nsolver = \"pymunk\".*?(\n\n|\Z)", ""),
        (r"(?m)^reference", 'model = "fourbar.xml"\nreference'),
    ],
    "slider_crank": SHORTENING_EDITS,
    "hacksaw_recorded": SHORTENING_EDITS,
    "balancer_sine": [
        *SHORTENING_EDITS,
        (r"to = 1\.57\d+", "to = 0.3"),
        (r"abs = 1e-12", "abs = 1e-10"),
    ],
    "rod_cantilever": [
        *SHORTENING_EDITS,
        (r"segments = 40\n\n", "segments = 8\n\n"),
        (r"(?s)\[refine\].*?\n\n", ""),
        (r"relative_to_range = \S+", "relative_to_range = 0.02"),
    ],
    "watt": SHORTENING_EDITS,
}
SOURCE_CASES = {"fourbar_sweep": "fourbar"}
"""Cases that are made of another one, so that an input that one run refuses is tested in the other
run."""
KEPT_ROWS = {"hacksaw_recorded": slice(300, 308)}
"""Rows of the recorded curve that are kept, in addition to its comments and its header."""


@cache
def small_files(name: str) -> tuple[tuple[str, bytes], ...]:
    """The files of a small case, as pairs of name and content."""
    text = without_defaults(shipped(f"{SOURCE_CASES.get(name, name)}.toml"))
    for old, new in EDITS[name]:
        text = re.sub(old, new, text)
    text = re.sub(r"(?m)^(\[run\.\w+\])$", rf"\1\ntimeout = {TIMEOUT}", text)
    model = re.search(r'(?m)^model = "(.*)"', text)
    files = {f"{name}.toml": text.encode()}
    xml = model[1] if model else f"{name}.xml"
    files[xml] = shipped(xml).read_bytes()
    if rows := KEPT_ROWS.get(name):
        lines = shipped(f"{name}.csv").read_text(encoding="utf-8").splitlines(keepends=True)
        files[f"{name}.csv"] = "".join(lines[:3] + lines[rows]).encode()
    return tuple(files.items())


def start_worker(folder: Path) -> None:
    """Check a good case with a long time limit, so that an idle worker waits for the next one."""
    from proofmass.batch.check import check

    patient = {
        k: v.replace(f"timeout = {TIMEOUT}".encode(), b"timeout = 120")
        for k, v in small_files("pendulum")
    }
    write_files(patient, folder)
    assert check([folder / "pendulum.toml"], jobs=1, detectable=False, causes=False).exit_code == 0


def write_files(files: Files, folder: Path) -> None:
    """Write a case's files into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)
