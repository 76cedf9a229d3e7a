"""Settings of pymunk as Python, to paste where ``space`` is built and at its start."""

from collections.abc import Iterator

from proofmass.sim.protocol import ParameterValues, left_to_sidecar
from proofmass.sim.pymunk.dynamics import SURE

SPACE = ("timestep", "iterations", "error_bias")


def snippet(parameters: ParameterValues, steps: int) -> str:
    """What to paste so that pymunk runs with settings, all of which must be known."""
    own = list(python(parameters, steps)) if set(parameters) >= set(SPACE) else []
    return "\n".join([*own, *(f"# {line}" for line in left_to_sidecar(parameters, SPACE))])


def python(parameters: ParameterValues, steps: int) -> Iterator[str]:
    """Lines that step a space; the first step has no impulses to start from, so it takes more."""
    iterations = int(str(parameters["iterations"]))
    yield from (
        "for constraint in space.constraints:",
        f"    constraint.error_bias = {parameters['error_bias']!r}",
        f"space.iterations = {max(SURE, 10 * iterations)}  # there are no impulses to start from",
        f"space.step({parameters['timestep']!r})",
        f"space.iterations = {iterations}",
        f"for _ in range({steps - 1}):",
        f"    space.step({parameters['timestep']!r})",
    )
