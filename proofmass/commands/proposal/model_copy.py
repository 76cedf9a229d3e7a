"""The copy of a model with what a case needs: sensors, and a name of its key."""

import re
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from xml.sax.saxutils import quoteattr

from proofmass.base.errors import InputError
from proofmass.base.files import read_text, write_atomically
from proofmass.commands.proposal.flat_model import flat_tree
from proofmass.commands.proposal.inspection import NAME_THE_KEY, ModelSummary

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

    A model may have keys that no element states, ``<size nkey="5"/>``: one is written then.

    Raises
    ------
    InputError
        Its keys are in an included file.
    """
    text = read_text(model)
    named, count = FIRST_KEY.subn(r'\1 name="start"', text, count=1)
    if count:
        return named
    if next(flat_tree(model).iter("key"), None) is not None:
        raise InputError(model, "", NAME_THE_KEY)
    return with_elements(model, '  <keyframe>\n    <key name="start"/>\n  </keyframe>\n')


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
    inside = "".join(f"    {one}\n" for one in new_sensors)
    return with_elements(model, f"  <sensor>\n{inside}  </sensor>\n")


def with_elements(model: Path, elements: str) -> str:
    """The model's text with more elements at its end."""
    head, end, tail = read_text(model).rpartition("</mujoco>")
    if not end:
        raise InputError(model, "", "no </mujoco> to write elements before")
    return f"{head}\n{elements}{end}{tail}"
