"""Programs that need an engine only, and settings as text to paste."""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import indent
from typing import ClassVar

from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.part import EnginePart
from proofmass.sim.protocol.run import Run
from proofmass.sim.protocol.settings import ParameterValue, ParameterValues


@dataclass(frozen=True)
class Imposed:
    """How a written program imposes the motion of its drives.

    Attributes
    ----------
    kind : str
        A word that the engine defines; see its `Programs.write_program`.
    gain : float
        Stiffness of the drive relative to the value that the time step suggests [1]; 0 if there is
        no choice.
    """

    kind: str
    gain: float = 0.0


def sidecar_instructions(parameters: ParameterValues, but: Sequence[str]) -> Iterator[str]:
    """Settings, except those named in `but`, as sentences that tell what the sidecar must state."""
    for key in sorted(set(parameters) - set(but)):
        place = "every rod" if key == "segments" else "settings"
        yield f"{place} of the sidecar: {key} = {toml_value(parameters[key])}"


def sidecar_table(engine: str, parameters: ParameterValues) -> str:
    """All settings of an engine as a table of the sidecar; the segments of rods as a comment.

    >>> print(sidecar_table("pymunk", {"defaults": True, "timestep": 0.01, "segments": 8}))
    # in the sidecar
    # every rod of the sidecar: segments = 8
    [settings.pymunk]
    defaults = true
    timestep = 0.01
    """
    own = {key: value for key, value in parameters.items() if key != "segments"}
    rods = (f"# {line}" for line in sidecar_instructions(parameters, tuple(own)))
    lines = (f"{toml_key(key)} = {toml_value(value)}" for key, value in own.items())
    return "\n".join(["# in the sidecar", *rods, f"[settings.{toml_key(engine)}]", *lines])


def toml_key(key: str) -> str:
    """A key of TOML, in quotation marks where it needs them.

    >>> toml_key("my-engine"), toml_key("my.engine")
    ('my-engine', '"my.engine"')
    """
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else toml_value(key)


def toml_value(value: ParameterValue) -> str:
    """A value in TOML, in which numbers, texts, truth values and lists are those of JSON."""
    return json.dumps(value, ensure_ascii=False)


class Programs(EnginePart):
    """Settings as text to paste, and programs; by default a table of a sidecar, and no program.

    Attributes
    ----------
    imposed : sequence of Imposed
        Ways in which programs can impose a motion, the ideal way first.
    """

    imposed: ClassVar[Sequence[Imposed]] = (Imposed("ideal drive"),)

    def write_snippet(
        self, parameters: ParameterValues, steps: int, model: Path | None = None
    ) -> str:
        """Text to paste so that the engine runs with these settings, for so many steps.

        It is empty if the engine has no form of its own for them, and a table of the sidecar is
        written instead.
        """
        return ""

    def write_comment(self, text: str) -> str:
        """Text as a comment before a snippet."""
        return indent(text, "# ")

    def insert_snippet(
        self, model: Path, parameters: ParameterValues, steps: int
    ) -> tuple[str, set[str]] | None:
        """The text of an MJCF with a snippet in it, and the names of the settings that it states.

        The result is None if the engine's snippets are no part of an MJCF.
        """
        return None

    def write_program(
        self,
        path: Path,
        run: Run,
        motion: str,
        head: str,
        drive: Imposed,
        controls: str = "",
    ) -> str:
        """A dynamics run as a program that needs the engine only.

        Parameters
        ----------
        path : Path
            The MJCF file.
        run : Run
            A dynamics run, with the settings for the program.
        motion : str
            Source of ``motion(t)``: values [rad or m], rates and accelerations (drives, n) of the
            drives at times (n,) [s]; empty for a free motion.
        head : str
            Docstring of the program.
        drive : Imposed
            How the program moves the driven joints, one of `imposed`.
        controls : str, optional
            Source of ``controls(t)``: controls (loads, n) of the loads of the run at times (n,)
            [s].

        Returns
        -------
        str
            Python source: ``python run.py [FILE]`` writes the curves as CSV.

        Raises
        ------
        Unsupported
            The program cannot be written; the message says why.
        """
        raise Unsupported(f"{self.title} has no programs")
