"""pytest items from sidecars: one for each solver of a case.

``pytest models/linkages/fourbar.toml`` runs a case, and with ``::pymunk`` appended one solver.
An item fails where ``proofmass check`` would fail: it runs the same code with the same tolerances.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from proofmass.base.errors import InputError
from proofmass.base.read_once import read_once
from proofmass.batch.check import (
    diagnose_run,
    early_end_error,
    load_validated,
    read_isolated,
    run_solver,
    run_task,
)
from proofmass.batch.work import compare_and_share
from proofmass.case.case import Case
from proofmass.evidence.diagnosis import Diagnosis, shared_causes
from proofmass.verdict.comparison import UNCHECKED_CASE, Comparison
from proofmass.verdict.outcome import FAILED_OUTCOMES, GOOD_OUTCOMES, OUTCOME_OF_EXCEPTION, Outcome
from proofmass.verdict.refinement import refinement_runs

COMPARE_ONLY = partial(compare_and_share, detectable=False)
load_once = read_once()(load_validated)
"""Load and validate a case once, before its first item runs."""


class SidecarFile(pytest.File):
    """A sidecar as a pytest file; its items are its solvers."""

    def __init__(self, *, named: bool = False, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.named = named

    def collect(self) -> Iterator["SolverItem | FaultyItem"]:
        """One item for each solver, over all the runs that use it.

        A sidecar that cannot be read is an item that fails, so that all other tests still run.  If
        the user gave its name it is an error of the collection: an item may have been named too.
        """
        try:
            case = read_isolated(self.path)
        except InputError as error:
            if self.named:
                raise
            yield FaultyItem.from_parent(self, name="sidecar", error=error)
            return
        solvers = dict.fromkeys(s for run in case.run.values() for s in run.solvers)
        for solver in solvers:
            yield SolverItem.from_parent(self, name=solver, case=case)

    def repr_failure(self, excinfo: Any, style: Any = None) -> Any:
        """Show bad input as its message, without a traceback."""
        return plain_message(excinfo) or super().repr_failure(excinfo)


class SolverItem(pytest.Item):
    """All runs of one solver of one case."""

    def __init__(self, *, case: Case, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.case = case

    def runtest(self) -> None:
        """Run the solver and compare its curves.

        The item is skipped where nothing of this solver is checked.  It fails where nothing of the
        whole case is checked and the sidecar does not say so.
        """
        load_once(self.case.file)
        comparisons, causes = list[Comparison](), list[Diagnosis]()
        for kind, run in self.case.run.items():
            if self.name in run.solvers:
                found, curves = run_solver(self.case, kind, self.name, COMPARE_ONLY)
                if error := early_end_error(self.case, kind, self.name, curves):
                    raise error
                comparisons += found
                failed = found[0].outcome in FAILED_OUTCOMES
                if curves and (failed or any(c.outcome == Outcome.DIFFERS for c in found)):
                    causes.append(
                        diagnose_run(self.case, kind, self.name, curves, failed, not causes)
                    )
        for task in refinement_runs(self.case):
            if task.solver == self.name:
                comparisons += task.study.add(task.segments, run_task(task))[1]
        wrong = [c for c in comparisons if c.outcome not in GOOD_OUTCOMES]
        if wrong:
            raise Disagreement("\n".join([*cause_lines(causes), *map(curve_line, wrong)]))
        if not (self.case.tolerance or self.case.refine or self.case.unchecked):
            raise Disagreement(UNCHECKED_CASE)
        if not any(c.outcome == Outcome.AGREES for c in comparisons):
            pytest.skip("shown, not checked: no tolerance")

    def repr_failure(self, excinfo: Any, style: Any = None) -> Any:
        """Show a disagreement as its message, without a traceback."""
        return plain_message(excinfo) or super().repr_failure(excinfo)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return the file and the name of the item for pytest's reports."""
        return self.path, None, f"{self.case.name}::{self.name}"


def cause_lines(found: list[Diagnosis]) -> Iterator[str]:
    """Lines on why runs differ or failed; a cause that they share is told once."""
    for cause in shared_causes(found):
        first = cause.diagnoses[0]
        yield cause.text
        yield from (f"    {line}" for line in (*first.details, *first.remarks))
    for one in found:
        if not one.found:
            yield f"{one.run} {one.text}"


def curve_line(c: Comparison) -> str:
    """A line on a curve that differs, or a run that failed."""
    return (
        f"{c.run} {c.channel}: {c.outcome}; {c.message}; error {c.error_max:.3g} "
        f"{c.unit} at {c.at:.6g}, allowed {c.allowed:.3g}"
    )


class FaultyItem(pytest.Item):
    """A sidecar that cannot be read."""

    def __init__(self, *, error: InputError, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.error = error

    def runtest(self) -> None:
        """Fail with what is wrong."""
        raise self.error

    def repr_failure(self, excinfo: Any, style: Any = None) -> Any:
        """Show bad input as its message, without a traceback."""
        return plain_message(excinfo) or super().repr_failure(excinfo)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return the file and the name of the item for pytest's reports."""
        return self.path, None, f"{self.path.stem}::{self.name}"


class Disagreement(Exception):
    """A run whose outcome is not good, or a case without any tolerance that does not say so."""


def plain_message(excinfo: Any) -> str | None:
    """Return the message of an error that needs no traceback; None for other errors."""
    known = (InputError, Disagreement, *OUTCOME_OF_EXCEPTION)
    return str(excinfo.value) if isinstance(excinfo.value, known) else None
