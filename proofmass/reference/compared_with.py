"""What a case is compared with, in sentences: the second line of every page.

They answer four questions: what the reference is, whether it reads the model that it judges, how
exact it is itself, and by what that is confirmed.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from proofmass.analytic.protocol import Reference
from proofmass.base.errors import InputError
from proofmass.base.recording import Recorded
from proofmass.base.wording import format_list, number
from proofmass.case.case import Case
from proofmass.case.inputs import is_program
from proofmass.reference.find import load_reference
from proofmass.reference.proven import proven_errors

UNKNOWN_ERROR = "Its own error is not stated."


@dataclass(frozen=True)
class ComparedWith:
    """The reference of a case in words.

    Attributes
    ----------
    name : str
        How it finds its curves, as a noun with an article.
    of : str
        Its name in the sidecar, and what it describes.
    independent : bool
        Whether it reads no number of the model, so that it judges the model too.
    reads : str
        A sentence on what it reads.
    error : str
        A sentence on its own error and what confirms it.
    """

    name: str
    of: str
    independent: bool
    reads: str
    error: str = UNKNOWN_ERROR

    @property
    def sentence(self) -> str:
        """All in one line.

        >>> ComparedWith("the closed form", "fourbar: planar four-bar linkage", True,
        ...     "It never reads fourbar.xml, so a wrong number of the model shows.").sentence[:66]
        'Compared with the closed form (fourbar: planar four-bar linkage). '
        """
        return f"Compared with {self.name} ({self.of}). {self.reads} {self.error}"


def compared_with(case: Case, properties: Mapping[str, str] | None = None) -> ComparedWith | None:
    """What a case is compared with; None if its reference cannot be loaded, which its runs report.

    Parameters
    ----------
    case : Case
    properties : mapping of str to str, optional
        Its properties by `proofmass.reference.evaluate.properties`, if they are known.

    Examples
    --------
    >>> from proofmass import load_case
    >>> found = compared_with(load_case("models/linkages/fourbar.toml"))
    >>> found.name, found.of, found.independent
    ('the closed form', 'fourbar: planar four-bar linkage', True)
    >>> found.reads
    'It never reads fourbar.xml, so a wrong number of the model shows.'
    """
    try:
        reference = load_reference(case)
    except InputError:
        return None
    model = case.model_path.name
    if isinstance(reference, Recorded):
        return ComparedWith(
            "recorded curves",
            case.reference,
            True,
            f"Another program or a test rig made them; they never read {model}.",
            "How exact they are is not stated here.",
        )
    return ComparedWith(
        f"the {reference.method}",
        case.reference
        if reference.reads_model
        else f"{case.reference}: {describe_mechanism(reference)}",
        not reference.reads_model,
        describe_reading(case, reference),
        describe_proof(case) or describe_own_error(reference, properties or {}),
    )


def describe_mechanism(reference: type[Reference]) -> str:
    """What a reference describes: its first words, up to a colon, with a small letter."""
    words = reference.describe().partition(":")[0].removesuffix(".")
    name = words[:1].isupper() and words[1:2].isupper()  # such as an abbreviation
    return words if name else words[:1].lower() + words[1:]


def describe_reading(case: Case, reference: type[Reference]) -> str:
    """A sentence on what a reference reads of the model, and so what it can judge."""
    model = case.model_path.name
    if not reference.reads_model:
        own = f" {case.reference} is a program beside the sidecar." * is_program(case.reference)
        return f"It never reads {model}, so a wrong number of the model shows.{own}"
    constant = case.constant_channels
    but = f"; only {format_list(constant)}, which must equal a number, check the model"
    return (
        f"It reads the numbers of {model}: it checks the engine, not the model"
        f"{but if constant else ''}."
    )


def describe_proof(case: Case) -> str:
    """A sentence on the proven errors of the reference in all runs of a case; empty without any.

    It states the largest one, and the kinds of quantities that are not covered in each run.
    """
    found = {kind: dict(proven_errors(case, kind)) for kind in case.run}
    if not all(found.values()):
        return ""
    largest = max(error for errors in found.values() for error in errors.values())
    kinds = dict.fromkeys(kind for errors in found.values() for kind in errors)
    return (
        f"Its own error is at most {number(largest, 1)} of a curve's range at every sample "
        f"({format_list(kinds)}), proven by ball arithmetic."
    )


def describe_own_error(reference: type[Reference], properties: Mapping[str, str]) -> str:
    """A sentence on the error of a reference itself, and what confirms it."""
    if (own := reference.own_error) is not None:
        return (
            f"Its own error is below {number(own.error, 1)} of a curve's range, "
            f"confirmed by {own.confirmed_by}."
        )
    if second := properties.get("second formulation"):
        return f"A second formulation confirms it: {second}."
    if evidence := properties.get("self-consistent"):
        return f"How well it is known: {evidence.partition('. ')[0]}."
    return UNKNOWN_ERROR
