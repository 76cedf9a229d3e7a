"""``proofmass new NAME --from MODEL.xml``: a sidecar for a model that has none, found by measuring.

`proofmass.commands.proposal.inspection` chooses a run and a reference.  Then all runs are made in
all engines, and each is tried with changed models, see `proofmass.commands.proposal.mutant`: a
check that no change turns is not written.  Runs that an engine does not cover are left out, with
the reason as a comment.  Comments give the error of each run as well, and what the first screen
finds wrong with the model.
"""

from dataclasses import replace
from pathlib import Path

from proofmass.base.errors import InputError, model_error
from proofmass.base.files import write_atomically
from proofmass.base.strict import Kind
from proofmass.base.worker import call_isolated
from proofmass.batch.check import screen_isolated
from proofmass.commands.proposal.inspection import ModelSummary, UnnamedKey, inspect_model
from proofmass.commands.proposal.measured_runs import measure_runs
from proofmass.commands.proposal.model_copy import (
    ModelCopy,
    missing_sensors,
    with_named_key,
    with_sensors,
)
from proofmass.commands.proposal.proposal import Proposal
from proofmass.screen.finding import FindingKind, Severity
from proofmass.screen.screen import Screen
from proofmass.sim.engines import default_engines
from proofmass.sim.model_source import ModelSource
from proofmass.sim.protocol.failures import BadModel

INSPECTION_SECONDS = 60.0
"""Processor time to compile a model, and to drive its joints or to solve its motion closely [s].
Most models take a few seconds, see `benchmarks.proposals`; a motion of 1e6 turns a second takes
hours."""
COMMENTED_FINDINGS = 4
"""Largest number of findings of the first screen that are comments of a sidecar."""
SAID_BY_RUNS = FindingKind.CHANGE_POINT, FindingKind.NOTHING_MOVES
"""Findings that the sentence on the run says: it stops before a change point, and moves."""
NOTHING_MOVES = (
    "nothing moves: it starts at rest, and no force acts on its joints; give its key rates (qvel) "
    "or controls (ctrl), or write a sidecar with a [[drive]] for each degree of freedom"
)


def write_proposal(name: str, model: Path) -> tuple[list[Path], list[str]]:
    """Write a sidecar for a model to the same folder; and a copy of the model if it needs one.

    The copy has more sensors if no sensor of the model measures a position or an orientation, and a
    name of the first key if no key has one.

    Parameters
    ----------
    name : str
        Name of the case.
    model : Path
        An MJCF file; it is not changed.

    Returns
    -------
    files : list of Path
        The files that were written.
    messages : list of str
        What was found, the error of each run with the change that it notices, and which runs are
        left out.

    Raises
    ------
    InputError
        A file exists already; the model does not compile, has no joint that can be driven, no
        degree of freedom, or no named element that could be measured; nothing moves; its motion is
        not known for any time; or no change of the model turns any check.
    """
    sidecar = model.with_name(f"{name}.toml")
    if sidecar.exists():
        raise InputError(sidecar, "", "it is there already; give another name")
    copy = ModelCopy(model, model.with_name(f"{name}.xml"))
    try:
        messages = write_with_copy(name, copy, sidecar)
    except BaseException as error:
        sidecar.unlink(missing_ok=True)
        copy.remove()
        if isinstance(error, InputError) and error.file in (sidecar, *copy.written):
            raise InputError(model, error.key, error.wrong) from None  # it is there no more
        raise
    return [sidecar, *copy.written], messages


def write_with_copy(name: str, copy: ModelCopy, sidecar: Path) -> list[str]:
    """Write a sidecar, and the copy of its model if it needs one; return the messages."""
    more = list[str]()
    try:
        look = inspect_isolated(copy.present)
    except UnnamedKey:
        copy.write(with_named_key(copy.original))
        look = inspect_isolated(copy.present)
        more.append(f"Its key has no name; in {copy.file.name} it is named start.")
    if look.dof == 0:
        raise InputError(copy.original, "", "it has no degree of freedom: nothing moves")
    if not look.drive and not look.moves:
        raise InputError(copy.original, "", NOTHING_MOVES)
    new_sensors = [] if look.placed else missing_sensors(look)
    if not new_sensors and not look.sensors:
        raise InputError(
            copy.original,
            "",
            "no joint, site or loose body of it has a name, so none can be measured",
        )
    if new_sensors:
        copy.write(with_sensors(copy.present, new_sensors))
    proposal = propose_for(name, copy.present, look, sidecar)
    proposal.messages += more
    write_atomically(sidecar, proposal.text())
    return proposal.messages


def inspect_isolated(model: Path) -> ModelSummary:
    """Inspect a model in a worker."""
    try:
        found: ModelSummary = call_isolated(inspect_model, model, timeout=INSPECTION_SECONDS)
    except BadModel as error:
        raise model_error(model, error) from None
    except InputError:
        raise
    except Exception as error:  # models of others may raise anything
        words = str(error) or type(error).__name__
        raise InputError(model, "", f"its motion could not be looked at: {words}") from None
    return found


def propose_for(name: str, model: Path, look: ModelSummary, sidecar: Path) -> Proposal:
    """The proposal for a model; a free motion if nothing but the drive moves in a sweep."""
    screen = screen_isolated(ModelSource(model))
    try:
        return propose(name, model, look, sidecar, screen)
    except InputError:
        if not look.drive or look.is_determined or not look.moves:
            raise
    return propose(name, model, replace(look, drive=None), sidecar, screen)  # no equilibria


def propose(
    name: str, model: Path, look: ModelSummary, sidecar: Path, screen: Screen | None
) -> Proposal:
    """The proposal for a model, after all its runs were made and tried with mutants."""
    kinds: list[Kind] = ["dynamics"]
    if look.drive:
        kinds = ["sweep", "dynamics"] if look.is_determined else ["sweep"]
    proposal = Proposal(name, model.name, look, {kind: list(default_engines()) for kind in kinds})
    proposal.messages += [look.describe(), *describe_findings(screen)]
    measure_runs(proposal, sidecar, screen)
    return proposal


def describe_findings(screen: Screen | None) -> list[str]:
    """What the first screen finds wrong, a sentence each, the worst first."""
    found = [
        one
        for one in (screen.findings if screen else ())
        if one.severity > Severity.NOTE and one.kind not in SAID_BY_RUNS
    ]
    words = [f"First screen: {one}." for one in found[:COMMENTED_FINDINGS]]
    if more := len(found) - len(words):
        words.append(f"First screen: {more} more; `proofmass check` of the model lists them.")
    return words
