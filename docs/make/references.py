"""The references that a sidecar can name, with parameters and functions: tables of docs/sidecar.md.

    python -m docs.make.references [--quick]

The tables are made from the classes of the references, and written between marks.
"""

from collections.abc import Callable, Iterable, Sequence
from inspect import getdoc

from benchmarks import ROOT, command
from docs.make.marks import write_between
from proofmass.analytic.protocol import REQUIRED, Parameter, Reference
from proofmass.reference.find import find_reference, reference_names

SIDECAR_PAGE = ROOT / "docs" / "sidecar.md"
TABLES_BEGIN = "<!-- python -m docs.make.references writes from here to the next mark: {} -->"
TABLES_END = "<!-- to here: {} -->"
LEAST_SERIES = 5
"""Parameters that differ by a number, from which on only the first and the last are listed."""
DOMAIN_PARTS = ("linkages", "planar", "spatial", "refined", "contacts", "balancer", "rods")
"""Parts of proofmass.analytic, in the order of the tables."""


def references() -> list[tuple[str, type[Reference]]]:
    """The references by name, those of a part of mathematics beside each other."""
    found = [(name, find_reference(name)) for name in reference_names()]
    return sorted(found, key=lambda one: (part_of(one[1]), one[0]))


def part_of(reference: type[Reference]) -> int:
    """The place of a reference's part in the tables; the last one for another package."""
    part = [*reference.__module__.split("."), "", "", ""][2]
    return DOMAIN_PARTS.index(part) if part in DOMAIN_PARTS else len(DOMAIN_PARTS)


def describe_parameter(parameter: Parameter) -> str:
    """A parameter with its unit, in bold if it has no default."""
    name = f"`{parameter.name}`"
    shown = f"**{name}**" if parameter.default is REQUIRED else name
    return f"{shown} [{parameter.unit}]" if parameter.unit not in ("", "1") else shown


def describe_parameters(parameters: Iterable[Parameter]) -> list[str]:
    """Parameters with their units; five or more that differ by a number at the end are one."""
    groups = dict[str, list[Parameter]]()
    for one in parameters:
        groups.setdefault(one.name.rstrip("0123456789"), []).append(one)
    found = []
    for own in groups.values():
        if len(own) < LEAST_SERIES:
            found += map(describe_parameter, own)
        else:
            found.append(f"`{own[0].name}` to {describe_parameter(own[-1])}")
    return found


def parameters_table() -> str:
    """The references with what they are, and their parameters, as Markdown."""
    rows = [["reference", "mechanism", "parameters"], 3 * ["---"]]
    for name, reference in references():
        what = (getdoc(reference) or "").partition("\n")[0].rstrip(".")
        parameters = ", ".join(describe_parameters(reference.parameters.values()))
        rows.append([f"`{name}`", what, parameters or "none: it reads the MJCF"])
    return as_table(rows)


def functions_table() -> str:
    """The functions of references that a sidecar can name, as Markdown."""
    rows = [
        [
            "reference",
            "motion profiles",
            "[paths](#paths) of",
            "functions for `marks`",
            "functions for `draw`",
        ],
        5 * ["---"],
    ]
    for name, reference in references():
        profiles, marks, charts = map(
            names_of, (reference.profiles, reference.marks, reference.charts)
        )
        coordinates = ", ".join(reference.inverse.curves) if reference.inverse else ""
        cells = [profiles, coordinates, marks, charts]
        if any(cells):
            rows.append([f"`{name}`", *cells])
    return as_table(rows)


def names_of(functions: Iterable[Callable[..., object]]) -> str:
    """The names of some functions."""
    return ", ".join(f"`{function.__name__}`" for function in functions)


def as_table(rows: Iterable[Sequence[str]]) -> str:
    """Rows of cells as Markdown."""
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def page_with_references(text: str) -> str:
    """The text of the page with the present tables."""
    for name, table in (("parameters", parameters_table()), ("functions", functions_table())):
        text = write_between(text, TABLES_BEGIN.format(name), TABLES_END.format(name), table)
    return text


def main(argv: Sequence[str] | None = None) -> None:
    """Write the tables into the page; with ``--quick`` print them."""
    if command(__doc__).parse_args(argv).quick:
        print(parameters_table(), functions_table(), sep="\n\n")
        return
    text = SIDECAR_PAGE.read_text(encoding="utf-8")
    SIDECAR_PAGE.write_text(page_with_references(text), encoding="utf-8")


if __name__ == "__main__":
    main()
