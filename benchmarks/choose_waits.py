"""Wall times of `proofmass choose`, with an empty store and with a store that has its runs.

    python -m benchmarks.choose_waits [folder] [--only CASE ...] [--quick]

Writes docs/choose_waits.md.  For each case that is stepped in time the command is run twice, with a
store that is empty before the first run.  The output of the command is kept in the folder
(reports/choose_waits).  With --only the rows of these cases are made again, and all others kept.
"""

import re
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from benchmarks import ROOT, command, folders
from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.commands.studies import load_cases
from proofmass.studies.measure import describe_machine

ERROR = 1e-4  # of the range of the positions
FIRST_LIMIT, NEXT_LIMIT = 30.0, 3.0  # wall times [s] that a user accepts
HEAD = """# How long choose takes

`python -m benchmarks.choose_waits` made this page on {machine}. For each of the {count} cases that
are stepped in time, `proofmass choose CASE --error {error}` was run twice: *first* with an empty
store, *next* with a store that has the runs of the first time. Both are wall times of the whole
command with its start; the machine had no other work. *Settings* is the number of settings that
were measured the first time, in all engines of the case. *Found* is the engine of the cheapest
setting.

| | shortest | median | longest | cases within {first} s | within {next} s |
|---|---|---|---|---|---|
{summary}

| case | first [s] | next [s] | settings | found |
|---|---|---|---|---|
{rows}
"""


@dataclass(frozen=True)
class Waited:
    """Wall times of the two calls for a case [s], and what they printed."""

    case: str
    seconds: tuple[float, float]
    settings: str
    found: str


def main(argv: Sequence[str] | None = None) -> None:
    """Time the command for all cases, or for the pendulum."""
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "reports" / "choose_waits")
    parser.add_argument("--only", nargs="+", metavar="CASE", help="names of cases")
    given = parser.parse_args(argv)
    models = ROOT / "models"
    every = load_cases([models / "linkages" / "pendulum.toml" if given.quick else models])
    cases = [c for c in every if "dynamics" in c.run and (not given.only or c.name in given.only)]
    with folders(given.quick, given.folder) as (folder, docs):
        folder.mkdir(parents=True, exist_ok=True)
        found = []
        for case in cases:
            found.append(time_command(case, 0.1 if given.quick else ERROR, folder))
            print(row(found[-1]), flush=True)
        file = docs / "choose_waits.md"
        if given.only and file.is_file():
            new = {each.case for each in found}
            found += [each for each in rows_of(file.read_text("utf-8")) if each.case not in new]
        file.write_text(page(found), encoding="utf-8")


def rows_of(text: str) -> list[Waited]:
    """The rows of the document.

    >>> rows_of("| case | first [s] |\\n| pendulum | 2.5 | 1.2 | 33 | MuJoCo |\\n")
    [Waited(case='pendulum', seconds=(2.5, 1.2), settings='33', found='MuJoCo')]
    """
    seconds = r"([\d.e+-]+)"
    rows = re.findall(rf"^\| (\w+) \| {seconds} \| {seconds} \| (\d*) \| (\w+) \|$", text, re.M)
    return [
        Waited(case, (float(first), float(again)), settings, found)
        for case, first, again, settings, found in rows
    ]


def time_command(case: Case, error: float, folder: Path) -> Waited:
    """Run the command twice."""
    took, printed = list[float](), list[str]()
    with TemporaryDirectory() as store:
        asked = ["choose", str(case.file), "--error", f"{error:g}", "--store", store]
        for _ in range(2):
            began = time.perf_counter()
            ran = subprocess.run(
                [sys.executable, "-m", "proofmass", *asked], capture_output=True, text=True
            )
            took.append(time.perf_counter() - began)
            printed += [ran.stdout, ran.stderr]
    (folder / f"{case.name}.txt").write_text("\n".join(printed), encoding="utf-8")
    match = re.search(r"(\d+) settings\s+measured", printed[1])
    settings = match[1] if match else ""
    return Waited(case.name, (took[0], took[1]), settings, found_engine(printed[0]))


def found_engine(printed: str) -> str:
    """The engine of the setting that a call printed, from the first line with one; or "none"."""
    found = re.search(r"^\W*(MuJoCo|pymunk)\b", printed, re.MULTILINE)
    return found[1] if found else "none"


def row(each: Waited) -> str:
    """A line of the table."""
    first, again = (number(seconds, 2) for seconds in each.seconds)
    return f"| {each.case} | {first} | {again} | {each.settings} | {each.found} |"


def page(found: Sequence[Waited]) -> str:
    """The document."""
    lines = []
    for k, name in enumerate(("first", "next")):
        took = [each.seconds[k] for each in found]
        cells = [number(value, 2) + " s" for value in (min(took), median(took), max(took))]
        within = [f"{sum(value <= limit for value in took)}" for limit in (FIRST_LIMIT, NEXT_LIMIT)]
        lines.append(f"| {name} | {' | '.join([*cells, *within])} |")
    return HEAD.format(
        machine=describe_machine(),
        count=len(found),
        error=number(ERROR),
        first=number(FIRST_LIMIT),
        next=number(NEXT_LIMIT),
        summary="\n".join(lines),
        rows="\n".join(map(row, sorted(found, key=lambda each: -each.seconds[0]))),
    )


if __name__ == "__main__":
    main()
