"""Masses, inertias, stiffnesses and friction of the shipped models that no run notices, and why.

    python -m docs.make.coverage [--quick] [--only CASE ...]

Searches every case as `proofmass explain` does, and writes the table of docs/coverage.md.  The
search keeps its results, so that a call continues where another was interrupted.  With --only the
rows of all other cases are kept.
"""

import os
from collections.abc import Iterable, Sequence

from benchmarks import ROOT, command
from proofmass.case.case import Case
from proofmass.commands.studies import load_cases
from proofmass.evidence.coverage import Coverage, find_coverage
from proofmass.evidence.coverage_search import Finding
from proofmass.formats.explain import name_numbers, reason_not_noticed

MATERIAL_KINDS = (
    "mass",
    "mass of a rod",
    "inertia",
    "stiffness",
    "stiffness of a rod",
    "axial stiffness of a rod",
    "shear stiffness of a rod",
    "torsion stiffness of a rod",
    "stiffness of a rod about y",
    "friction",
)
"""Kinds of material properties of mechanisms, which a case should notice."""
BEGIN = "<!-- python -m docs.make.coverage writes from here to the next mark -->"
END = "<!-- to here -->"
HEAD = """
`python -m docs.make.coverage` searched {cases} of {all} cases. Their models have {numbers}
numbers. A change of {noticed} of them is noticed, or the run is refused. Of {material} masses,
inertias, stiffnesses and coefficients of dry friction (material numbers) {open} are noticed by no
run; `proofmass explain` states a reason for {told} of these. The last column has all material
numbers that are not noticed, with the reason.

| case | numbers | noticed | material numbers | noticed | no reason | not noticed by any run |
|---|---|---|---|---|---|---|"""
WIDTH = 7  # cells of a row


def main(argv: Sequence[str] | None = None) -> None:
    """Search the cases, and write the table."""
    parser = command(__doc__)
    parser.add_argument("--only", nargs="+", metavar="CASE", help="names of cases")
    given = parser.parse_args(argv)
    models = ROOT / "models"
    file = ROOT / "docs" / "coverage.md"
    before, rest = file.read_text(encoding="utf-8").split(BEGIN)
    kept, after = rest.split(END)
    cases = load_cases([models / "linkages" / "pendulum.toml" if given.quick else models])
    names = sorted(case.name for case in cases)
    rows = rows_of(kept) if given.only else {}
    for case in sorted(cases, key=lambda case: case.name):
        if not given.only or case.name in given.only:
            found = find_coverage(case, os.cpu_count())
            rows[case.name] = row(case, found)
            print(rows[case.name], f"{found.seconds:.0f} s", flush=True)
    table = page([rows[name] for name in names if name in rows], len(names))
    if given.quick:
        print(table)
        return
    file.write_text(f"{before}{BEGIN}\n{table}\n{END}{after}", encoding="utf-8")


def page(rows: Sequence[str], count: int) -> str:
    """The paragraph and the table, made of rows and of the number of all cases."""
    numbers, noticed, some, seen, unexplained = (
        sum(int(cells_of(one)[k]) for one in rows) for k in range(1, WIDTH - 1)
    )
    head = HEAD.format(
        cases=len(rows),
        all=count,
        numbers=numbers,
        noticed=noticed,
        material=some,
        open=some - seen,
        told=some - seen - unexplained,
    )
    return "\n".join([head, *rows])


def rows_of(table: str) -> dict[str, str]:
    """The rows of a table, by their cases."""
    lines = [line for line in table.splitlines() if line.startswith("| ")]
    return {cells_of(line)[0]: line for line in lines if cells_of(line)[0] != "case"}


def cells_of(row: str) -> list[str]:
    """The cells of a row."""
    return [cell.strip() for cell in row.strip("|").split("|")]


def row(case: Case, coverage: Coverage) -> str:
    """The row of a case in the table."""
    some = material(coverage.numbers)
    open_ = [one for one in some if not one.noticed]
    counts = [
        len(coverage.numbers),
        sum(one.noticed for one in coverage.numbers),
        len(some),
        len(some) - len(open_),
        sum(not reason_not_noticed(case, coverage, one.kind, [one]) for one in open_),
    ]
    words = coverage.left_out or "; ".join(unnoticed(case, coverage))
    return f"| {' | '.join([case.name, *map(str, counts), words.replace('|', '¦')])} |"


def unnoticed(case: Case, coverage: Coverage) -> Iterable[str]:
    """Material numbers that no run notices, by their kinds, with the reasons."""
    for kind, some in coverage.unnoticed.items():
        if kind in MATERIAL_KINDS:
            why = reason_not_noticed(case, coverage, kind, some)
            yield f"{name_numbers(kind, some)}: {why or 'no reason is known'}"


def material(some: Iterable[Finding]) -> list[Finding]:
    """The material ones among some numbers: masses, inertias, stiffnesses and friction."""
    return [one for one in some if one.kind in MATERIAL_KINDS]


if __name__ == "__main__":
    main()
