"""The order of the index: cases by their reference, what is wrong first."""

import inspect
from collections.abc import Iterable
from typing import Any

from proofmass.case import Case
from proofmass.errors import InputError
from proofmass.recorded import Recorded
from proofmass.reference import module_of

ORDER = ("bad", "open", "good")


def families(cases: Iterable[Case], cards: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Cards under the reference that their cases share.

    Returns
    -------
    list of dict
        ``name``, ``what`` (a line on the reference), ``cards`` and ``state``, the worst of them.
        Families with something wrong come first, then by name; recorded curves last.
    """
    found: dict[str, dict[str, Any]] = {}
    for case, card in zip(cases, cards, strict=True):
        recorded = case.reference.endswith(".csv")
        name = "recorded curves" if recorded else case.reference
        family = found.setdefault(name, {"name": name, "what": about(case), "cards": [],
                                         "last": recorded})
        family["cards"].append(card)
    for family in found.values():
        family["cards"].sort(key=lambda c: (ORDER.index(c["state"]), c["name"]))
        family["state"] = family["cards"][0]["state"]
    return sorted(found.values(), key=lambda f: (f["state"] != "bad", f["last"], f["name"]))


def about(case: Case) -> str:
    """A line on a reference: the first of its module's documentation."""
    try:
        truth = module_of(case)
    except InputError:
        return ""
    if isinstance(truth, Recorded):
        return "Measured, or computed by another program."
    return (inspect.getdoc(truth) or "").partition("\n\n")[0].replace("\n", " ")
