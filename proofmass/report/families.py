"""The groups of the index: cases by their folder and their reference, failures first."""

import inspect
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from proofmass.case import Case
from proofmass.check import family_of
from proofmass.errors import InputError
from proofmass.recorded import Recorded
from proofmass.reference import module_of

ORDER = ("bad", "open", "good")
RECORDED = "recorded curves"


Card = dict[str, Any]


def families(cases: Iterable[Case], cards: Iterable[Card], paths: Iterable[Path]) -> list[Card]:
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
    for name, own in grouped(pairs, lambda case: family_of(case.file, paths)).items():
        parts = [part(*one) for one in grouped(own, reference_of).items()]
        parts.sort(key=lambda p: (p["state"] != "bad", p["name"] == RECORDED, p["name"]))
        found.append({"name": name, "parts": parts, "state": worst(parts)})
    return sorted(found, key=lambda f: (f["state"] != "bad", f["name"]))


def grouped(
    pairs: list[tuple[Case, Card]], key: Callable[[Case], str]
) -> dict[str, list[tuple[Case, Card]]]:
    """Group cases and their cards by a key of the case."""
    found: dict[str, list[tuple[Case, Card]]] = {}
    for case, card in pairs:
        found.setdefault(key(case), []).append((case, card))
    return found


def part(name: str, pairs: list[tuple[Case, Card]]) -> Card:
    """Return the part of one reference: its name, a line on it, its cards and their worst state."""
    cards = sorted((card for _, card in pairs), key=lambda c: (ORDER.index(c["state"]), c["name"]))
    return {"name": name, "what": about(pairs[0][0]), "cards": cards, "state": worst(cards)}


def worst(cards: list[Card]) -> str:
    """Return the worst state of some cards or parts."""
    return min((card["state"] for card in cards), key=ORDER.index)


def reference_of(case: Case) -> str:
    """Return the name of the part that a case belongs to: its reference, or recorded curves."""
    return RECORDED if case.recorded else case.reference


def about(case: Case) -> str:
    """Return a line on a reference: the first paragraph of its module's docstring."""
    try:
        reference = module_of(case)
    except InputError:
        return ""
    if isinstance(reference, Recorded):
        return "Measured, or computed by another program."
    return (inspect.getdoc(reference) or "").partition("\n\n")[0].replace("\n", " ")
