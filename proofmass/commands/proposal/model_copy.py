"""The copy of a model with what a case needs: sensors, and a name of its key."""

import re
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from xml.sax.saxutils import quoteattr

from proofmass.base.errors import InputError
from proofmass.base.files import read_text, write_atomically
from proofmass.commands.proposal.inspection import ModelSummary

SENSOR_TEMPLATES = {
    "jointpos": ("{}", "<jointpos name={new} joint={name}/>"),
    "jointvel": ("{}_rate", "<jointvel name={new} joint={name}/>"),
    "framepos": ("{}", '<framepos name={new} objtype="site" objname={name}/>'),
    "framelinvel": ("{}_velocity", '<framelinvel name={new} objtype="site" objname={name}/>'),
    "body": ("{}_place", '<framepos name={new} objtype="body" objname={name}/>'),
    "quat": ("{}_turn", '<framequat name={new} objtype="body" objname={name}/>'),
    "linear": ("{}_velocity", '<framelinvel name={new} objtype="body" objname={name}/>'),
    "angular": ("{}_rate", '<frameangvel name={new} objtype="body" objname={name}/>'),
}
"""The name of a new sensor by that of its element, and its MJCF, for each quantity."""


FIRST_KEY = re.compile(r"(<keyframe\b.*?<key)(?=[\s/])", re.DOTALL)
"""The text of a model up to its first key."""


@dataclass
class ModelCopy:
    """A model, and its copy, which is written if the model lacks something.

    Attributes
    ----------
    original, file : Path
        The file of the model, and that of the copy, which is in the same folder.
    written : list of Path
        The file of the copy, if it was written.
    """

    original: Path
    file: Path
    written: list[Path] = field(default_factory=list)

    @property
    def present(self) -> Path:
        """The file of the copy if it was written, and otherwise that of the model."""
        return self.file if self.written else self.original

    def write(self, text: str) -> None:
        """Write the copy.

        Raises
        ------
        InputError
            There was such a file before.
        """
        if not self.written and self.file.exists():
            raise InputError(self.file, "", "it is there already; give another name")
        self.written = [self.file]
        write_atomically(self.file, text)

    def remove(self) -> None:
        """Remove the copy, if it was written."""
        for file in self.written:
            file.unlink(missing_ok=True)


def with_named_key(model: Path) -> str:
    """The model's text with the name ``start`` of its first key.

    Raises
    ------
    InputError
        No key is in this file.
    """
    text = read_text(model)
    named, count = FIRST_KEY.subn(r'\1 name="start"', text, count=1)
    if not count:
        raise InputError(model, "", 'its key has no name; write <key name="start" …/>')
    return named


def missing_sensors(look: ModelSummary) -> list[str]:
    """The MJCF of sensors for all joints, sites and loose bodies that have a name.

    Sensors whose name is that of a sensor of the model, or of another new one, are left out.
    """
    asked = [
        *product(look.joints, ("jointpos", "jointvel")),
        *product(look.sites, ("framepos", "framelinvel")),
        *product(look.bodies, ("body", "quat", "linear", "angular")),
    ]
    found = dict[str, str]()
    for name, quantity in asked:
        new, element = SENSOR_TEMPLATES[quantity]
        words = element.format(new=quoteattr(new.format(name)), name=quoteattr(name))
        found.setdefault(new.format(name), words)
    return [words for name, words in found.items() if name not in look.sensors]


def with_sensors(model: Path, new_sensors: list[str]) -> str:
    """The model's text with more sensors."""
    text = read_text(model)
    head, end, tail = text.rpartition("</mujoco>")
    if not end:
        raise InputError(model, "", "no </mujoco> to write sensors before")
    inside = "\n".join(f"    {one}" for one in new_sensors)
    return f"{head}\n  <sensor>\n{inside}\n  </sensor>\n{end}{tail}"
