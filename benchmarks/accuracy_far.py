"""How far: the boundaries of `benchmarks.stress` in short, parameter by parameter."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from proofmass.studies.stress.boundary import Boundary, BoundaryKind, read_boundaries
from proofmass.studies.stress.page import NEAR, THEORY, subject
from proofmass.wording import format_solver, number

FAR = """
## How far

From [Where it breaks](stress.md), which `python -m benchmarks.stress` made: each parameter is
increased or decreased until the run fails. Of {known} boundaries that theory knows, {near} are
within {within:.0%} of it. In {cases}:
"""


def far(file: Path) -> Iterator[str]:
    """A row for each parameter and engine; nothing if the study was not made."""
    if not file.is_file():
        return
    found = read_boundaries(file)
    known = [one for one in found if one.theory == one.theory]
    turned = [one for one in found if subject(one) != THEORY]
    yield FAR.format(
        known=len(known),
        near=sum(abs(one.ratio - 1) <= NEAR for one in known),
        within=NEAR,
        cases=", ".join(dict.fromkeys(one.what for one in turned)),
    )
    yield (
        "| parameter | engine | settings | least | greatest | hold to the end | failed in silence "
        "| not known beyond |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    for parameter, engine in dict.fromkeys((parameter_of(one), one.engine) for one in turned):
        yield row(
            parameter,
            engine,
            [one for one in turned if (parameter_of(one), one.engine) == (parameter, engine)],
        )


def parameter_of(one: Boundary) -> str:
    """The parameter, without the name of a joint."""
    return "spring in a joint" if one.parameter.startswith("spring in ") else one.parameter


def row(parameter: str, engine: str, own: Sequence[Boundary]) -> str:
    """Where the boundaries of a parameter are."""
    ends = sorted(one.measured for one in own if one.found)
    unit = {"times": " ×", "1": "", "share": ""}.get(own[0].unit, f" {own[0].unit}")
    cells = [f"{number(end)}{unit}" for end in (ends[0], ends[-1])] if ends else ["—", "—"]
    silent = sum(one.found and one.silent for one in own)
    return (
        f"| {parameter} | {format_solver(engine)} | {len(own)} | {' | '.join(cells)} "
        f"| {sum(one.limit == BoundaryKind.HOLDS for one in own)} "
        f"| {silent or ''} | {sum(one.unknown for one in own) or ''} |"
    )
