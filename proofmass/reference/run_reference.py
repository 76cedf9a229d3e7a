"""The reference of a run: at the motion that its drives had, and at changed parameters."""

from functools import cached_property
from typing import cast

import numpy as np

from proofmass.analytic.remember import Memory, use_memory
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.files import content_key
from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.case.drive import DriveState
from proofmass.reference.evaluate import evaluate, properties
from proofmass.reference.find import reference_class
from proofmass.reference.profiles import drive_profiles
from proofmass.reference.reference_curves import ReferenceCurves
from proofmass.sim.model_files import model_key
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import Drive, Run

Differences = list[dict[str, Array]]
"""Differences of the channels at a changed parameter, in one dict; empty without a reference."""


def changeable_parameters(case: Case) -> dict[str, float]:
    """Parameters that may change a curve that a channel equals.

    Texts, whole numbers such as a mode, and first guesses are left out.
    """
    reference = reference_class(case)
    if reference is None:
        return {}
    known = reference.parameters
    curves = {c.equals for c in case.channels.values() if isinstance(c.equals, str)}
    return {
        key: value
        for key, value in case.parameters.items()
        if not isinstance(value, str) and (key not in known or known[key].moves_any(curves))
    }


class RunReference:
    """The reference of a run, at the drives' measured motion and at changed parameters.

    At changed parameters the drives follow their motion profiles exactly.  So the changed curves
    are the same for all solvers of the run, and are evaluated once.
    """

    def __init__(self, case: Case, run: Kind, curves: Curves) -> None:
        self.case, self.run, self.x = case, run, curves.x
        self.parameters = changeable_parameters(case)
        self.largest = max(map(abs, self.parameters.values()), default=0.0) or 1.0
        self.state: DriveState | None = None
        if curves.drive is not None and case.drive:
            drives = tuple(Drive("", profile) for profile in drive_profiles(case, run))
            self.state = Run(run, self.x, (), drives).motion(self.x)
        elif curves.drive is not None:  # given curves, whose drives have no profile
            self.state = curves.drive
        self.memory: Memory = {}
        self.known: dict[tuple[str, float], dict[str, Array]] = {}
        self.as_prescribed = self.evaluated({}, more=True)
        self.unchanged = self.as_prescribed.channels

    def evaluated(self, changed: dict[str, float], more: bool = False) -> ReferenceCurves:
        """Evaluate the channels at changed parameters; empty where the reference has no solution.

        The memory keeps what searches found at neighbouring parameters.
        """
        try:
            with use_memory(self.memory, more):
                return evaluate(self.case, self.run, self.x, self.state, **changed)
        except InputError:  # the changed mechanism cannot be assembled at some sample
            return ReferenceCurves(self.x, {})

    def as_driven(self, state: DriveState | None) -> ReferenceCurves:
        """The reference at the drives' motion in a solver."""
        same = state is None or np.array_equal(state, cast(DriveState, self.state))
        if self.unchanged and same:
            return self.as_prescribed
        with use_memory(self.memory, store_results=False):
            return evaluate(self.case, self.run, self.x, state)

    @cached_property
    def properties(self) -> dict[str, str] | None:
        """The properties of the case if this is its first run, whose motion they are of."""
        if self.run == next(iter(self.case.run)):
            return properties(self.case)
        return None

    def step(self, key: str, share: float) -> float:
        """A share of a parameter, or of the largest parameter if it is 0."""
        return share * (abs(self.parameters[key]) or self.largest)

    def differences(self, key: str, share: float) -> Differences:
        """Differences of the channels at a changed parameter; empty where there is no reference."""
        if (key, share) not in self.known:
            changed = {key: self.parameters[key] + self.step(key, share)}
            self.known[key, share] = self.evaluated(changed).channels
        before, after = self.unchanged, self.known[key, share]
        return [{name: after[name] - before[name] for name in after}] if before and after else []


def reference_identity(case: Case) -> tuple[str | int, ...]:
    """A key that differs for cases with different reference curves: their tables and files."""
    asked = repr(case.model_copy(update={"settings": {}, "tolerance": ()}).model_dump())
    files = [case.file.parent / case.reference] if case.recorded or case.program else []
    return asked, *model_key(case.model_path), *map(content_key, [*case.profile_files, *files])


def shared_reference(case: Case, run: Kind, curves: Curves) -> RunReference:
    """The reference of a run, which this process keeps for the other solvers of the run.

    Workers compare the solvers of a run one by one.  The last reference is kept, by the content of
    all that it depends on, so that results do not depend on what was compared before.
    """
    key = reference_identity(case), run, curves.x.tobytes(), curves.drive is None
    if key not in shared_references:
        shared_references.clear()
        shared_references[key] = RunReference(case, run, curves)
    return shared_references[key]


shared_references = dict[tuple[object, ...], RunReference]()
"""The last reference of `shared_reference`, by its key."""
