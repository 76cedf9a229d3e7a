"""A setting: one engine with its knobs in one position."""

from dataclasses import dataclass, field
from typing import Any

from proofmass.case import Case
from proofmass.sim.protocol import Run
from proofmass.solve import plan
from proofmass.strict import Kind

Knob = str | float | int | bool | tuple[float, ...]


@dataclass(frozen=True)
class Setting:
    """An engine and what is set in it, in place of all that a sidecar says.

    Attributes
    ----------
    engine : str
        mujoco or pymunk.
    knobs : dict of str to Knob
        Settings of `sim.with_ENGINE`: timestep [s], integrator, solref ..; and `segments`, of all
        rods of the case.
    """

    engine: str
    knobs: dict[str, Knob] = field(default_factory=dict)

    def but(self, **knobs: Knob) -> "Setting":
        """The same with other knobs."""
        return Setting(self.engine, {**self.knobs, **knobs})

    def applied(self, case: Case, kind: Kind) -> tuple[Case, Run]:
        """The case, with its rods cut as the setting says, and what to ask of its engine."""
        knobs: dict[str, Any] = dict(self.knobs)
        if segments := knobs.pop("segments", None):
            case = case.model_copy(update={"rod": {
                name: rod.model_copy(update={"segments": segments})
                for name, rod in case.rod.items()}})
        case = case.model_copy(update={"settings": {self.engine: knobs}})
        return case, plan(case, kind, self.engine)
