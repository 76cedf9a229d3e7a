"""The groups of the index: cases by their folder and their reference, failures first."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from proofmass.base.errors import InputError
from proofmass.base.grouping import group_by
from proofmass.base.recording import Recorded
from proofmass.batch.check import family_of
from proofmass.case.case import Case
from proofmass.reference.find import load_reference

STATES_WORST_FIRST = ("bad", "open", "good")
RECORDED_PART = "recorded curves"


Card = dict[str, Any]


def group_cards(cases: Iterable[Case], cards: Iterable[Card], paths: Iterable[Path]) -> list[Card]:
    """Group the cards of cases by folders below the given paths, and by references within.

    Returns
    -------
    list of dict
        ``name`` (the folder), ``parts`` and ``state``, the worst of the parts.  Each part has
        ``name`` (the reference), ``what`` (a line on it), ``cards`` and ``state``.  Groups with a
        failure come first, the others by name; recorded curves are last.
    """
    pairs, paths = list(zip(cases, cards, strict=True)), list(paths)
    found = []
    for name, own in group_by(pairs, lambda pair: family_of(pair[0].file, paths)).items():
        by_reference = group_by(own, lambda pair: reference_name(pair[0]))
        parts = [reference_part(*one) for one in by_reference.items()]
        parts.sort(key=lambda p: (p["state"] != "bad", p["name"] == RECORDED_PART, p["name"]))
        found.append({"name": name, "parts": parts, "state": worst_state(parts)})
    return sorted(found, key=lambda f: (f["state"] != "bad", f["name"]))


def reference_part(name: str, pairs: list[tuple[Case, Card]]) -> Card:
    """Return the part of one reference: its name, a line on it, its cards and their worst state."""
    cards = sorted(
        (card for _, card in pairs), key=lambda c: (STATES_WORST_FIRST.index(c["state"]), c["name"])
    )
    return {
        "name": name,
        "what": describe_reference(pairs[0][0]),
        "cards": cards,
        "state": worst_state(cards),
    }


def worst_state(cards: list[Card]) -> str:
    """Return the worst state of some cards or parts."""
    return min((card["state"] for card in cards), key=STATES_WORST_FIRST.index)


def reference_name(case: Case) -> str:
    """Return the name of the part that a case belongs to: its reference, or recorded curves."""
    return RECORDED_PART if case.recorded else case.reference


def describe_reference(case: Case) -> str:
    """Return a line on a reference: the first paragraph of its module's docstring."""
    try:
        reference = load_reference(case)
    except InputError:
        return ""
    if isinstance(reference, Recorded):
        return "Measured, or computed by another program."
    return reference.describe()
