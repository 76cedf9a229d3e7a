"""Mutants of a model, with which a proposed check is tried before it is written.

A mutant is the model with one number changed, a length, a mass, a stiffness or a gain.  An engine
runs the mutant, and its curves are compared, within the proposed tolerances, with the reference of
the model as it is.  The mutant turns the check if a curve differs that agreed before.

References that read the model are evaluated once, for the model as it is: this is the check of an
engine that takes a wrong number, not that of a wrong number in the file, which would be wrong in
both.  Files that MuJoCo's elements do not stand in one by one have gravity changed alone.
"""

import tempfile
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from mujoco import mjtJoint

from proofmass.base.errors import InputError
from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.commands.proposal.flat_model import flat_tree
from proofmass.evidence.changed import model_source, numbers_of_case, with_changed_model
from proofmass.reference.case_model import compiled_model
from proofmass.reference.run_reference import shared_reference
from proofmass.run.solve import solve_here
from proofmass.sim.contents import SCALAR_JOINT_UNITS
from proofmass.sim.elements import NotWritten, Number, Place, Source
from proofmass.sim.numbers import element_name
from proofmass.sim.protocol.failures import BadModel
from proofmass.verdict.compare import compare
from proofmass.verdict.outcome import OUTCOME_OF_EXCEPTION, Outcome

MUTANT_SHARES = 0.01, 0.1
"""Changes of a number that are tried [1]: a tolerance that lets 10 % of every number pass checks
nothing that a person would want to know."""
CAREFUL_SHARE = 0.001
"""The change that is tried at last if the model failed with others [1]: near a change point a
mechanism bears little more."""
MUTATED_KINDS = (
    *("length", "place", "coupling", "stiffness", "gain", "load", "gear", "mass", "gravity"),
    *("anchor", "site", "start rate", "start value", "centre of mass", "inertia", "damping"),
    *("armature", "friction", "spring length", "rest angle", "axis"),
)
"""Kinds of numbers that are changed, those that are noticed most often first."""
FAILURES_OF_MUTANTS: tuple[type[Exception], ...] = (InputError, BadModel, *OUTCOME_OF_EXCEPTION)
"""Exceptions of a run of a mutant that gives no curves."""
FLAT_NAME = "model.xml"
"""Name of the one file that a model with included files becomes."""


@dataclass(frozen=True)
class Mutant:
    """A changed model: by which share a number was changed, its name, and the case with it."""

    share: float
    number: str
    case: Case

    @property
    def words(self) -> str:
        """What was changed."""
        return f"{self.number} larger by {100 * self.share:g} %"


@dataclass(frozen=True)
class MutantTrial:
    """What the mutants of a model did to a check.

    Attributes
    ----------
    tried : tuple of str
        The changes that were tried, by size; the last one turned the check if `differing` is not 0.
    differing, agreeing : int
        Number of curves that differ with the last change, and of those that agreed without one.
    number : str
        Name of the number whose change turned the check.
    """

    tried: tuple[str, ...]
    differing: int
    agreeing: int
    number: str = ""

    @property
    def turned(self) -> bool:
        """Whether a mutant turned the check."""
        return self.differing > 0

    def describe(self) -> str:
        """A phrase on the change that turned the check, or on those that did not.

        >>> MutantTrial(("mass of arm larger by 1 %",), 2, 3).describe()
        'tried: mass of arm larger by 1 %: 2 of 3 curves differ'
        """
        if self.turned:
            curves = "curves differ" if self.agreeing > 1 else "curve differs"
            return f"tried: {self.tried[-1]}: {self.differing} of {self.agreeing} {curves}"
        if not self.tried:
            return "the file has no number that could be changed, so that no check can be tried"
        return (
            f"{len(self.tried)} changes of its numbers were tried, such as {self.tried[-1]}, and "
            "no curve differs"
        )


def try_mutants(
    case: Case, kind: Kind, solver: str, agreeing: Collection[str], first: str
) -> MutantTrial:
    """Try mutants of a case's model until one turns the check of a solver.

    Parameters
    ----------
    case, kind, solver
        The case with its tolerances, the kind of run, and the solver.
    agreeing : collection of str
        The channels that agree without a change.
    first : str
        Name of the number that turned another check; it is changed first.
    """
    tried, failed = list[str](), set[str]()
    with tempfile.TemporaryDirectory() as folder:
        for mutant in mutants_of(case, Path(folder), first):
            if mutant.share == CAREFUL_SHARE and mutant.number not in failed:
                continue
            differing = differing_channels(case, mutant.case, kind, solver, agreeing)
            if differing is None:
                failed.add(mutant.number)
            elif differing:
                tried.append(mutant.words)
                return MutantTrial(tuple(tried), len(differing), len(agreeing), mutant.number)
            elif mutant.share != CAREFUL_SHARE:
                tried.append(mutant.words)
    return MutantTrial(tuple(tried), 0, len(agreeing))


def differing_channels(
    case: Case, mutant: Case, kind: Kind, solver: str, agreeing: Collection[str]
) -> list[str] | None:
    """The channels of a mutant that differ from the reference of the case, and agreed before.

    None if the mutant gives no curves: that it fails is no merit of the tolerances.
    """
    try:
        curves = solve_here(mutant, kind, solver)
        if curves.stopped:
            return None
        found = compare(case, kind, solver, curves, False, shared_reference(case, kind, curves))
    except FAILURES_OF_MUTANTS:
        return None
    return [
        c.channel
        for c in found
        if c.channel in agreeing and c.outcome == Outcome.DIFFERS and isfinite(c.error_max)
    ]


def mutants_of(case: Case, folder: Path, first: str) -> Iterator[Mutant]:
    """The mutants of a case's model, written to a folder one by one."""
    tree = flat_tree(case.model_path)
    flat = with_file(case, folder / "flat", tostring(tree, encoding="unicode"))
    try:
        numbers = [*numbers_of_case(flat), *numbers_of_loose_bodies(model_source(flat))]
    except (NotWritten, InputError):
        yield from gravity_mutants(case, tree, folder)
        return
    chosen = most_important(case, numbers)
    place = folder / "changed"
    place.mkdir()
    for share in (*MUTANT_SHARES, CAREFUL_SHARE):
        for number in sorted(chosen, key=lambda number: number.name != first):
            try:
                changed = with_changed_model(flat, [(number, share * number.value)], place)
            except (NotWritten, BadModel):  # an element in a frame, or one that is not written
                continue
            yield Mutant(share, number.name, changed)


def numbers_of_loose_bodies(source: Source) -> Iterator[Number]:
    """The velocities of the start key that are not 0, of balls and free joints [rad/s or m/s]."""
    model, key = source.bare, source.start
    if key < 0:
        return
    for dof in np.flatnonzero(model.key_qvel[key]).tolist():
        joint = int(model.dof_jntid[dof])
        if mjtJoint(int(model.jnt_type[joint])) in SCALAR_JOINT_UNITS:
            continue
        body = element_name(model, "body", int(model.jnt_bodyid[joint]))
        part = dof - int(model.jnt_dofadr[joint]) + 1
        value, place = float(model.key_qvel[key, dof]), Place("key", key, "qvel", dof)
        yield Number("start rate", f"{body}, qvel {part}", value, "1", value, place)


def most_important(case: Case, numbers: list[Number]) -> list[Number]:
    """The most important number of each kind that is changed."""
    moving = np.flatnonzero(compiled_model(case).body_weldid).tolist()
    return [
        max(some, key=lambda number: importance(case, number, moving))
        for kind in MUTATED_KINDS
        if (some := [number for number in numbers if number.kind == kind and number.value])
    ]


def importance(case: Case, number: Number, moving: Collection[int]) -> tuple[bool, float]:
    """The order of the numbers of a kind: places within the mechanism first, then by size.

    The place of a body on the ground moves the mechanism as a whole.
    """
    inside = number.place.tag != "body" or (
        int(compiled_model(case).body_parentid[number.place.index]) in moving
    )
    return inside, abs(number.value)


def gravity_mutants(case: Case, tree: Element, folder: Path) -> Iterator[Mutant]:
    """The model with larger gravity; a later ``<option>`` of a file replaces an earlier one."""
    option = compiled_model(case).opt
    if not option.gravity.any():
        return
    for share in MUTANT_SHARES:
        gravity = " ".join(repr(float(part)) for part in (1.0 + share) * option.gravity)
        added = SubElement(tree, "option", gravity=gravity)
        text = tostring(tree, encoding="unicode")
        tree.remove(added)
        place = folder / f"gravity{share:g}"
        yield Mutant(share, "gravity", with_file(case, place, text))


def with_file(case: Case, folder: Path, text: str) -> Case:
    """The case with another model, which is written into a new folder."""
    folder.mkdir()
    (folder / FLAT_NAME).write_text(text, encoding="utf-8")
    return case.model_copy(update={"file": folder / case.file.name, "model": FLAT_NAME})
