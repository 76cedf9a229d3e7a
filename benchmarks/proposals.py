"""What ``proofmass new --from`` writes for many models, and whether each check can fail.

    python -m benchmarks.proposals PATH ... [-o FILE] [--quick]

The folders are copied to a temporary one.  There, ``proofmass new`` runs for each MJCF file with a
world that MuJoCo compiles, one after the other, with a limit of processor time, and then
a check of what it wrote.  The table in FILE has for each kind of answer the number of
models, and an example.  Two numbers must be 0: tracebacks, and cases with a run that agrees
although no change of the model turned its check.
"""

import os
import re
import resource
import shutil
import statistics
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks import ROOT, command
from benchmarks.screens import find_models
from proofmass.base.grouping import group_by
from proofmass.batch.check import Result, check
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.failures import BadModel

PROCESSOR_LIMIT = 300
"""Processor time of each process of a command [s]; `proofmass new` should need 60 in all."""
NAME = "proposal_of_benchmark"
REASONS = {
    "no degree of freedom|no joint": "no joint, or no degree of freedom",
    "nothing moves": "nothing moves",
    "key has no name": "its key has no name",
    "so none can be measured": "nothing has a name",
    "fails with its own step": "it fails with every step",
    "agree at any time|not known|does not cover": "its motion is not known",
    "changes of its numbers|could be changed": "no change turns a check",
    "cannot run": "no engine covers it",
    "could not be looked at": "it takes too long to look at",
}
"""Kinds of refusals, by words of their messages."""


@dataclass(frozen=True)
class ProposalOutcome:
    """What became of a model.

    Attributes
    ----------
    file : str
    kind : str
        ``written`` with its reference, or the kind of its refusal.
    words : str
        The last line of its messages.
    seconds : float
        Processor time of `proofmass new` [s].
    traceback, tried, left : bool
        Whether there was a traceback, whether a change turned the check of each solver whose curves
        agree, and whether a refusal left a file.
    checked : str
        Outcome of `proofmass check`: ``agrees``, ``differs``, ``bad input``; empty if refused.
    """

    file: str
    kind: str
    words: str
    seconds: float
    traceback: bool
    tried: bool
    left: bool
    checked: str = ""


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("paths", type=Path, nargs="*", default=[ROOT / "models"])
    parser.add_argument("-o", dest="file", type=Path, help="where the table is written")
    given = parser.parse_args(argv)
    found = list[ProposalOutcome]()
    with TemporaryDirectory() as folder:
        for number, path in enumerate(given.paths):
            copy = Path(folder) / str(number)
            shutil.copytree(path, copy, ignore=shutil.ignore_patterns("*.py", "*.toml"))
            files = filter(compiles, sorted(find_models([copy])))
            for file in islice(files, 1) if given.quick else files:
                found.append(propose_for(file, str(file.relative_to(copy))))
                print(format_line(found[-1]), file=sys.stderr, flush=True)
    text = "\n".join(table(found)) + "\n"
    print(text)
    if given.file and not given.quick:
        given.file.write_text(text, encoding="utf-8")


def compiles(file: Path) -> bool:
    """Whether MuJoCo compiles a file."""
    try:
        compile_model(file)
    except BadModel:
        return False
    return True


def propose_for(file: Path, name: str) -> ProposalOutcome:
    """Run ``proofmass new`` for a model, and check what it writes."""
    begin = children_seconds()
    done = run_limited("new", NAME, "--from", file.name, folder=file.parent)
    seconds = children_seconds() - begin
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    sidecar = file.with_name(f"{NAME}.toml")
    traceback = "Traceback" in done.stderr
    outcome = ProposalOutcome(
        name,
        refusal(done.stderr),
        lines[-1] if lines else f"exit code {done.returncode}",
        seconds,
        traceback or done.returncode not in (0, 2),
        False,
        any(file.parent.glob(f"{NAME}.*")) and done.returncode != 0,
    )
    if sidecar.exists() and not done.returncode:
        text = sidecar.read_text(encoding="utf-8")
        checked = check([sidecar], jobs=1, detectable=False, causes=False)
        words = {0: "agrees", 1: "differs", 2: "bad input"}
        outcome = ProposalOutcome(
            name,
            "written, " + re.findall('reference = "(.*?)"', text)[0],
            lines[0],
            seconds,
            traceback,
            all_tried(text, checked),
            False,
            words[checked.exit_code],
        )
    for rest in file.parent.glob(f"{NAME}.*"):
        rest.unlink()
    return outcome


def all_tried(sidecar: str, checked: Result) -> bool:
    """Whether a change turned the check of each solver whose curves all agree in a run."""
    runs = group_by(checked.comparisons, lambda c: (c.run, c.solver))
    green = [run for run, some in runs.items() if all(c.outcome == "agrees" for c in some)]
    lines = [line for line in sidecar.splitlines() if "tried: " in line]
    return all(any(f"# {run}, {solver}: " in line for line in lines) for run, solver in green)


def run_limited(*words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command of proofmass in a folder, with a limit of processor time."""
    return subprocess.run(
        [sys.executable, "-m", "proofmass", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        env={**os.environ, "NO_COLOR": "1", "COLUMNS": "200", "PYTHONPATH": str(ROOT)},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, 2 * (PROCESSOR_LIMIT,)),
        check=False,
    )


def children_seconds() -> float:
    """Processor time of all processes that this one started and that ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def refusal(words: str) -> str:
    """The kind of a refusal."""
    flat = " ".join(words.split())
    return next((kind for part, kind in REASONS.items() if re.search(part, flat)), "other")


def format_line(one: ProposalOutcome) -> str:
    """A line on a model."""
    faults = {"traceback": one.traceback, "file left": one.left}
    faults["not tried"] = bool(one.checked) and not one.tried
    marks = "".join(f" {fault.upper()}" for fault, there in faults.items() if there)
    return f"{one.file}: {one.kind} {one.checked} ({one.seconds:.1f} s){marks} {one.words[:300]}"


def table(found: Sequence[ProposalOutcome]) -> Iterator[str]:
    """The table of all kinds of answers, below the numbers that must be 0."""
    seconds = [one.seconds for one in found] or [0.0]
    written = [one for one in found if one.checked]
    empty = [one for one in written if not one.tried]
    yield (
        f"{len(found)} models: {len(written)} cases written, {len(found) - len(written)} refused; "
        f"{sum(one.traceback for one in found)} tracebacks, "
        f"{sum(one.left for one in found)} refusals that left a file, "
        f"{len(empty)} with a run that agrees though no change turned its check. Processor time of "
        f"a model: median {statistics.median(seconds):.1f} s, largest {max(seconds):.1f} s."
    )
    yield ""
    yield "| answer | models | of these agree | differ | largest processor time [s] | such as |"
    yield "|---|---|---|---|---|---|"
    for kind, some in sorted(group_by(found, lambda one: one.kind).items(), reverse=True):
        outcomes = [one.checked for one in some]
        yield (
            f"| {kind} | {len(some)} | {outcomes.count('agrees') or ''} | "
            f"{outcomes.count('differs') or ''} | {max(one.seconds for one in some):.1f} | "
            f"`{some[0].file}` |"
        )


if __name__ == "__main__":
    main()
