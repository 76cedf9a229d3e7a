"""Settings of engines in interpreters of their own that `trade` scans and `choose` tries."""

from collections.abc import Iterator
from typing import ClassVar, get_args

from proofmass.sim.protocol.settings import ParameterValue, first_number
from proofmass.sim.protocol.tuning import Recipe, Scan, Studied, Tuning, scan_over

FEW_ITERATIONS = 50
"""Iterations that are tried beside many: five times those that games have by default, 10."""


class SteppedTuning(Tuning):
    """The step with the settings of proofmass, other schemes, fewer iterations, and defaults."""

    def variants(self) -> Iterator[tuple[str, dict[str, ParameterValue]]]:
        """Settings beside the step, with a name for each; the first have none."""
        fields = self.settings.model_fields
        yield "", {}
        if "scheme" in fields:
            for scheme in get_args(fields["scheme"].annotation):
                if scheme != fields["scheme"].default:
                    yield scheme, {"scheme": scheme}
        if "iterations" in fields:
            yield f"{FEW_ITERATIONS} iterations", {"iterations": FEW_ITERATIONS}
        yield "defaults", {"defaults": True}

    def scans(self, about: Studied) -> Iterator[Scan]:
        """Scans over the step."""
        for words, parameters in self.variants():
            name = ", ".join(filter(None, (self.title, words)))
            yield scan_over(parameters, name, "timestep", about.timesteps())

    def recipes(self, about: Studied) -> Iterator[Recipe]:
        """The same settings as functions of the step."""
        for words, parameters in self.variants():
            name = ", ".join(filter(None, (self.title, words)))

            def at_any_step(
                step: float, own: dict[str, ParameterValue] = parameters
            ) -> dict[str, ParameterValue]:
                return own

            yield Recipe(name, at_any_step, "defaults" in parameters)


class AccuracyTuning(Tuning):
    """The accuracy of an engine that chooses its own steps, which end at samples at the latest."""

    sizes: ClassVar = {**Tuning.sizes, "accuracy": first_number}
    labels: ClassVar = {"accuracy": "accuracy of a step"}

    def scans(self, about: Studied) -> Iterator[Scan]:
        """Scans over coarse and over fine accuracies.

        They are two, since coarse ones may all have steps from sample to sample, after which a
        series ends, as its errors no longer fall.
        """
        coarse, fine = (range(1, 5), range(6, 14))
        for words, exponents in (("coarse", coarse), ("fine", fine)):
            values = [10.0**-k for k in exponents]
            yield scan_over({}, f"{self.title}, {words} accuracy", "accuracy", values)
