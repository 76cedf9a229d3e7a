"""Comparisons of a case without detectable changes, whose search takes longer than the runs."""

from pathlib import Path

from proofmass.batch.check import early_end_error, run_solver
from proofmass.pytest_items import COMPARE_ONLY
from proofmass.run.sidecar import load_case
from proofmass.verdict.comparison import Comparison


def all_comparisons(sidecar: Path) -> list[Comparison]:
    """Compare all runs of a case with its reference, as the pytest items of its sidecar do."""
    case, found = load_case(sidecar), []
    for kind, run in case.run.items():
        for solver in run.solvers:
            comparisons, curves = run_solver(case, kind, solver, COMPARE_ONLY)
            if error := early_end_error(case, kind, solver, curves):
                raise error
            found += comparisons
    return found
