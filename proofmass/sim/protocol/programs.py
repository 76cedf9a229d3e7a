"""Programs that need an engine only, and settings as text to paste."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from proofmass.sim.protocol.settings import ParameterValues


@dataclass(frozen=True)
class Imposed:
    """How a written program imposes the motion of its drives.

    Attributes
    ----------
    kind : str
        A word that the engine defines; see its `write_program`.
    gain : float
        Stiffness of the drive relative to the value that the time step suggests [1]; 0 if there is
        no choice.
    """

    kind: str
    gain: float = 0.0


def sidecar_instructions(parameters: ParameterValues, but: Sequence[str] = ()) -> Iterator[str]:
    """Settings, except those named in `but`, as sentences that tell what the sidecar must state."""
    for key in sorted(set(parameters) - {*but, "defaults"}):
        place = "every rod" if key == "segments" else "settings"
        yield f"{place} of the sidecar: {key} = {parameters[key]!r}"
