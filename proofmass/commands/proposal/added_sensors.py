"""Sensors that a copy of a model gets, so that something of it can be compared."""

from itertools import product
from pathlib import Path
from xml.sax.saxutils import quoteattr

from proofmass.base.errors import InputError
from proofmass.base.files import read_text
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
