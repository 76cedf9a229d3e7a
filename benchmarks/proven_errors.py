"""Proven errors of the references of shipped cases: a table of the package and a page.

    python -m benchmarks.proven_errors [CASE ...] [--again] [--quick]

Each run of each case is proven by ball arithmetic, see docs/proven.md; a case is a name such as
fourbar.  Runs whose inputs and values are those of the table are not proven again, unless asked.
The table, proofmass/reference/proven.json, is written after each run, so that a command that was
stopped goes on where it was; and the rows of docs/proven.md at the end.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from math import isfinite

from benchmarks import ROOT, command
from docs.make.marks import write_between
from proofmass.base.clock import processor_time
from proofmass.base.errors import InputError
from proofmass.base.files import write_atomically
from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.reference.proven import (
    TABLE_FILE,
    TABLE_FORMAT,
    ProvenRun,
    ProvenTable,
    digest_inputs,
    digest_values,
    read_proven_table,
)
from proofmass.run.sidecar import load_case
from tests.independent.balls.loops import NotProven
from tests.independent.balls.proof import prove_errors

PAGE_FILE = ROOT / "docs" / "proven.md"
ROWS_BEGIN = "<!-- python -m benchmarks.proven_errors writes from here to the next mark: {} -->"
ROWS_END = "<!-- to here: {} -->"
KINDS = ("position", "velocity", "acceleration", "moment", "force", "energy")
QUICK_CASES = ("change_point",)
PACKAGES = ("python-flint", "numpy", "scipy", "mujoco")


@dataclass(frozen=True)
class CaseRun:
    """A case and one of its runs."""

    case: Case
    kind: Kind

    @property
    def label(self) -> str:
        """The case and the run in words."""
        return f"{self.case.name} {self.kind}"


def shipped_runs(names: Sequence[str]) -> Iterator[CaseRun]:
    """The runs of all shipped cases, or of those with given names."""
    files = sorted((ROOT / "models").glob("*/*.toml"))
    unknown = set(names) - {file.stem for file in files}
    if unknown:
        raise SystemExit(f"no case {', '.join(sorted(unknown))} in models/")
    for file in files:
        if not names or file.stem in names:
            case = load_case(file)
            for kind in case.run:
                yield CaseRun(case, kind)


def prove(run: CaseRun) -> ProvenRun | str:
    """Prove the errors of a run; text: why nothing is proven."""
    case, kind = run.case, run.kind
    try:
        proof = prove_errors(case, kind)
    except NotProven as reason:
        return str(reason)
    half_width = proof.alone_within if isfinite(proof.alone_within) else 0.0
    return ProvenRun(
        digest_inputs(case, kind),
        digest_values(case, kind),
        proof.samples,
        half_width,
        proof.by_kind(case),
        proof.not_covered,
        proof.continuous,
    )


def is_known(run: CaseRun, table: ProvenTable) -> bool:
    """Whether a run is in the table with the inputs and values that it has now."""
    found, (case, kind) = table.runs.get(run.label), (run.case, run.kind)
    if found is None or found.inputs != digest_inputs(case, kind):
        return False
    return found.values == digest_values(case, kind)


def extend_table(runs: Sequence[CaseRun], table: ProvenTable, again: bool, store: bool) -> None:
    """Prove the runs that a table does not have, and add them to it."""
    for run in runs:
        if not again and is_known(run, table):
            continue
        began = processor_time()
        found = prove(run)
        table.runs.pop(run.label, None)
        table.reasons.pop(run.label, None)
        if isinstance(found, str):
            table.reasons[run.label] = found
            words = f"not proven: {found}"
        else:
            table.runs[run.label] = found
            words = format_row(found, processor_time() - began)
        print(f"{run.label:40} {words}", flush=True)
        if store:
            write_table(table)


def format_row(found: ProvenRun, seconds: float) -> str:
    """The errors of a run, and the processor time of its proof, in words."""
    errors = ", ".join(f"{kind} {format_share(error)}" for kind, error in found.errors.items())
    missing = f"; {len(found.not_covered)} channels not covered" if found.not_covered else ""
    return f"{errors}; {1e3 * seconds / found.samples:.1f} ms a sample{missing}"


def format_share(error: float) -> str:
    """An error with one digit; 0 if all values are exact."""
    return f"{error:.0e}" if error else "0"


def write_table(table: ProvenTable) -> None:
    """Write the table, with the versions of the packages here."""
    ordered = ProvenTable(
        {name: version(name) for name in PACKAGES},
        dict(sorted(table.runs.items())),
        dict(sorted(table.reasons.items())),
    )
    write_atomically(TABLE_FILE, TABLE_FORMAT.dump_json(ordered, indent=1) + b"\n")


def case_rows(table: ProvenTable) -> str:
    """A row for each proven case: the largest error of its runs, by kind."""
    heads = ["case", "runs", "samples", *KINDS, "continuous"]
    lines = [f"| {' | '.join(heads)} |", "|" + " --- |" * len(heads)]
    for case in dict.fromkeys(label.partition(" ")[0] for label in table.runs):
        own = {k.partition(" ")[2]: v for k, v in table.runs.items() if k.startswith(f"{case} ")}
        errors = [
            max((run.errors[kind] for run in own.values() if kind in run.errors), default=None)
            for kind in KINDS
        ]
        cells = ["" if one is None else format_share(one) for one in errors]
        samples = ", ".join(str(run.samples) for run in own.values())
        proven = ", ".join(kind for kind, run in own.items() if run.continuous)
        lines.append(f"| {' | '.join([case, ', '.join(own), samples, *cells, proven])} |")
    return "\n".join(lines)


def missing_rows(table: ProvenTable) -> str:
    """A row for each reason why nothing is proven, with the runs that it concerns."""
    by_reason: dict[str, list[str]] = {}
    for label, reason in table.reasons.items():
        by_reason.setdefault(reason, []).append(label)
    rows = [f"| {', '.join(runs)} | {reason} |" for reason, runs in sorted(by_reason.items())]
    return "\n".join(["| runs | why nothing is proven |", "| --- | --- |", *rows])


def write_page(table: ProvenTable) -> None:
    """Write the tables of the page between their marks."""
    text = PAGE_FILE.read_text(encoding="utf-8")
    for name, rows in (("proven", case_rows(table)), ("not proven", missing_rows(table))):
        text = write_between(text, ROWS_BEGIN.format(name), ROWS_END.format(name), rows)
    write_atomically(PAGE_FILE, text)


def main(argv: Sequence[str] | None = None) -> None:
    """Prove the runs, and write the table and the page."""
    asked = command(__doc__)
    asked.add_argument("cases", nargs="*", metavar="CASE", help="names of cases of models/")
    asked.add_argument("--again", action="store_true", help="prove runs of the table as well")
    given = asked.parse_args(argv)
    try:
        runs = list(shipped_runs(QUICK_CASES if given.quick else given.cases))
    except InputError as error:
        sys.exit(str(error))
    table = ProvenTable() if given.quick else read_proven_table()
    extend_table(runs, table, given.again, store=not given.quick)
    if not given.quick:
        write_page(table)


if __name__ == "__main__":
    main()
