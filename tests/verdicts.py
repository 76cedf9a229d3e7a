"""The verdicts on a case, without detectable changes, which take longer than the runs."""

from pathlib import Path

from proofmass.check import early_end_error, run_solver
from proofmass.compare import Comparison
from proofmass.pytest_plugin import COMPARE_ONLY
from proofmass.sidecar import load_case


def verdicts(sidecar: Path) -> list[Comparison]:
    """All runs of a case held against its reference, as its pytest items do."""
    case, found = load_case(sidecar), []
    for kind, run in case.run.items():
        for solver in run.solvers:
            comparisons, curves = run_solver(case, kind, solver, COMPARE_ONLY)
            if error := early_end_error(case, kind, solver, curves):
                raise error
            found += comparisons
    return found
