"""What `proofmass explain` found of a case, for its page: what runs notice, and what none does."""

from contextlib import suppress
from dataclasses import dataclass

from proofmass.case import Case
from proofmass.coverage import Coverage, stored_coverage
from proofmass.coverage_search import Finding
from proofmass.errors import InputError
from proofmass.explain import (
    TRIED,
    cells_of,
    not_noticed,
    not_tried,
    refusals,
    told_of_reference,
)
from proofmass.wording import spoken

FIRST = 4  # groups of numbers that the first screen shows; the others open below them


@dataclass(frozen=True)
class NoticedRow:
    """A number, and the smallest change of it that a run notices, in words."""

    name: str
    change: str
    share: str
    by: str


@dataclass(frozen=True)
class NoticedPanel:
    """What is told of the coverage of a case.

    Attributes
    ----------
    unnoticed, more : tuple of str
        Groups of numbers of the model that no run notices, with the reason where one can be told.
    not_tried : str
        Why no number of the model was tried; empty if they were.
    reads, tried : str
        What the reference reads, and what was tried of the model.
    parameters, numbers : tuple of NoticedRow
        Of the reference and of the model, the most sensitive first.
    refused : tuple of str
        Numbers with which runs are refused or lost.
    """

    unnoticed: tuple[str, ...]
    more: tuple[str, ...]
    not_tried: str
    reads: str
    tried: str
    parameters: tuple[NoticedRow, ...]
    numbers: tuple[NoticedRow, ...]
    refused: tuple[str, ...]


def noticed(case: Case) -> NoticedPanel | None:
    """What was found of a case as it is now; None if `proofmass explain` was not asked of it."""
    with suppress(InputError, OSError):  # which the command says as soon as it is asked
        found = stored_coverage(case)
        return None if found is None else panel_of(case, found)
    return None


def panel_of(case: Case, found: Coverage) -> NoticedPanel:
    """The panel of a coverage."""
    lines = tuple(not_noticed(case, found))
    known = sorted(
        (one for one in found.parameters if one.noticed and not one.refused),
        key=lambda one: one.measure,
    )
    told = [one for one in found.noticed if not one.refused]
    return NoticedPanel(
        lines[:FIRST],
        lines[FIRST:],
        not_tried(case, found) if found.left_out or not found.numbers else "",
        told_of_reference(case, found),
        TRIED,
        tuple(map(row_of, known)),
        tuple(map(row_of, told)),
        tuple(sorted(refusals([one for one in found.noticed if one.refused]))),
    )


def row_of(one: Finding) -> NoticedRow:
    """The row of a number that is noticed."""
    return NoticedRow(*cells_of(one), f"{one.channel}, {one.run}, {spoken(one.solver)}")
