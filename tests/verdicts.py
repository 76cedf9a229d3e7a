"""The verdicts on a case, without detectable changes, which take longer than the runs."""

from pathlib import Path

from proofmass.check import run_one, stopped
from proofmass.compare import Comparison
from proofmass.pytest_plugin import VERDICTS
from proofmass.sidecar import load_case


def verdicts(sidecar: Path) -> list[Comparison]:
    """All runs of a case held against its reference, as its pytest items do."""
    case, found = load_case(sidecar), []
    for kind, run in case.run.items():
        for solver in run.solvers:
            comparisons, curves = run_one(case, kind, solver, VERDICTS)
            if error := stopped(case, kind, solver, curves):
                raise error
            found += comparisons
    return found
