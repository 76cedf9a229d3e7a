"""A summary of the boundaries that `benchmarks.stress` found, parameter by parameter."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from proofmass.base.wording import number
from proofmass.sim.engines import format_solver
from proofmass.studies.stress.boundary import Boundary, BoundaryKind, read_boundaries
from proofmass.studies.stress.page import THEORY_SECTION, THEORY_TOLERANCE, section_of

FAR = """
## How far

This is a summary of [Where it breaks](stress.md), which `python -m benchmarks.stress` made. Each
parameter is increased or decreased until the run fails. Of {known} boundaries that theory predicts,
{near} are within {within:.0%} of the prediction. The other boundaries were found in {cases}:
"""


def far(file: Path) -> Iterator[str]:
    """The section with a row for each parameter and engine; nothing if the study was not made."""
    if not file.is_file():
        return
    found = read_boundaries(file)
    known = [one for one in found if one.theory == one.theory]
    of_cases = [one for one in found if section_of(one) != THEORY_SECTION]
    yield FAR.format(
        known=len(known),
        near=sum(abs(one.ratio - 1) <= THEORY_TOLERANCE for one in known),
        within=THEORY_TOLERANCE,
        cases=", ".join(dict.fromkeys(one.what for one in of_cases)),
    )
    yield (
        "| parameter | engine | settings | smallest | largest | no boundary | failed in silence "
        "| not known beyond |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    for parameter, engine in dict.fromkeys((parameter_of(one), one.engine) for one in of_cases):
        yield row(
            parameter,
            engine,
            [one for one in of_cases if (parameter_of(one), one.engine) == (parameter, engine)],
        )


def parameter_of(one: Boundary) -> str:
    """The parameter of a boundary, without the name of a joint."""
    return "spring in a joint" if one.parameter.startswith("spring in ") else one.parameter


def row(parameter: str, engine: str, own: Sequence[Boundary]) -> str:
    """The row of a parameter in an engine: its boundaries, and how many there are of each kind."""
    ends = sorted(one.measured for one in own if one.found)
    unit = {"times": " ×", "1": "", "share": ""}.get(own[0].unit, f" {own[0].unit}")
    cells = [f"{number(end)}{unit}" for end in (ends[0], ends[-1])] if ends else ["—", "—"]
    silent = sum(one.found and one.silent for one in own)
    return (
        f"| {parameter} | {format_solver(engine)} | {len(own)} | {' | '.join(cells)} "
        f"| {sum(one.limit == BoundaryKind.HOLDS for one in own)} "
        f"| {silent or ''} | {sum(one.unknown for one in own) or ''} |"
    )
