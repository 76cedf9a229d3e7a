"""Which masses, inertias, stiffnesses and friction of the shipped models no run notices, and why.

    python -m benchmarks.coverage [--quick] [--only CASE ...]

Asks every case as `proofmass explain` does, which keeps what it finds, so that a call goes on where
another was interrupted, and writes the table of docs/coverage.md.
"""

import os
from collections.abc import Iterable, Sequence

from benchmarks import ROOT, command
from proofmass.case import Case
from proofmass.coverage import Coverage, coverage_of
from proofmass.coverage_search import Finding
from proofmass.explain import phrase, reason
from proofmass.studies.command import named
from proofmass.wording import number

MATERIAL = (
    "mass",
    "mass of a rod",
    "inertia",
    "stiffness",
    "stiffness of a rod",
    "axial stiffness of a rod",
    "shear stiffness of a rod",
    "friction",
)
"""Kinds of numbers of which none may go unnoticed without a reason."""
BEGIN = "<!-- python -m benchmarks.coverage writes from here to the next mark -->"
END = "<!-- to here -->"
HEAD = """
`python -m benchmarks.coverage` asked all {cases} cases. Of {numbers} numbers of their models
{noticed} are noticed, or the run is refused with them. Of {material} masses, inertias, stiffnesses
and coefficients of dry friction {open} are noticed by no run; {told} of these have a reason that
`proofmass explain` tells. The last column has all that are not noticed, with the reason.

| case | numbers | noticed | masses and the like | noticed | not noticed by any run |
|---|---|---|---|---|---|"""


def main(argv: Sequence[str] | None = None) -> None:
    """Ask the cases, and write the table."""
    parser = command(__doc__)
    parser.add_argument("--only", nargs="+", metavar="CASE", help="names of cases")
    given = parser.parse_args(argv)
    models = ROOT / "models"
    cases = named([models / "linkages" / "pendulum.toml" if given.quick else models])
    cases = [case for case in cases if not given.only or case.name in given.only]
    found = []
    for case in sorted(cases, key=lambda case: case.name):
        found.append((case, coverage_of(case, os.cpu_count())))
        print(row(*found[-1]), f"{found[-1][1].seconds:.0f} s", flush=True)
    if given.quick or given.only:
        print(page(found))
        return
    file = ROOT / "docs" / "coverage.md"
    before, rest = file.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    file.write_text(f"{before}{BEGIN}\n{page(found)}\n{END}{after}", encoding="utf-8")


def page(found: Sequence[tuple[Case, Coverage]]) -> str:
    """The sentences and the table."""
    every = [one for _, coverage in found for one in coverage.numbers]
    open_ = [
        (bool(reason(case, coverage, one.kind, [one])), one)
        for case, coverage in found
        for one in material(coverage.numbers)
        if not one.noticed
    ]
    head = HEAD.format(
        cases=number(len(found)),
        numbers=len(every),
        noticed=sum(one.noticed for one in every),
        material=len(material(every)),
        open=len(open_),
        told=sum(told for told, _ in open_),
    )
    return "\n".join([head, *(row(*each) for each in found)])


def row(case: Case, coverage: Coverage) -> str:
    """A row of the table."""
    some = material(coverage.numbers)
    cells = [
        case.name,
        str(len(coverage.numbers)),
        str(sum(one.noticed for one in coverage.numbers)),
        str(len(some)),
        str(sum(one.noticed for one in some)),
        coverage.left_out or "; ".join(unnoticed(case, coverage)),
    ]
    return f"| {' | '.join(cells)} |"


def unnoticed(case: Case, coverage: Coverage) -> Iterable[str]:
    """Masses and the like that no run notices, by their kinds, with the reasons."""
    for kind, some in coverage.unnoticed.items():
        if kind in MATERIAL:
            why = reason(case, coverage, kind, some)
            yield f"{phrase(kind, some)}: {why or 'no reason is known'}"


def material(some: Iterable[Finding]) -> list[Finding]:
    """Those that are masses and the like."""
    return [one for one in some if one.kind in MATERIAL]


if __name__ == "__main__":
    main()
