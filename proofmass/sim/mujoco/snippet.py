"""Settings of MuJoCo as MJCF to paste into a model."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

from proofmass.sim.mjcf import compile_model, read_tree
from proofmass.sim.mujoco.settings import (
    ENGINE_DEFAULTS,
    SETTING_PLACES,
    SOFTNESS_SETTINGS,
    configure,
    limit_softness,
    mjcf_text,
    write_limits,
    write_options,
)
from proofmass.sim.protocol.programs import sidecar_instructions
from proofmass.sim.protocol.settings import ParameterValues


def write_snippet(parameters: ParameterValues, model: Path | None = None) -> str:
    """MJCF to paste into a model so that MuJoCo runs with these settings.

    Comments name the equalities whose own attributes, or whose class, would override the settings,
    with the attributes to write into them; and the joints with a range.

    Examples
    --------
    >>> print(write_snippet({"timestep": 1e-3, "integrator": "rk4"}))
    <option timestep="0.001" integrator="RK4"/>
    >>> print(write_snippet({"cone": "elliptic", "refsafe": False}))
    <option cone="elliptic">
      <flag refsafe="disable"/>
    </option>
    >>> print(write_snippet({"solref": (0.008, 1.0)}))
    <default>
      <equality solref="0.008 1"/>
    </default>
    """
    sidecar_lines = (
        f"<!-- {line} -->"
        for line in sidecar_instructions(parameters, (*SETTING_PLACES, "defaults"))
    )
    return "\n".join([*settings_as_mjcf(parameters, model), *sidecar_lines])


def settings_as_mjcf(parameters: ParameterValues, model: Path | None) -> Iterator[str]:
    """Lines of MJCF that state settings; MuJoCo merges them with the elements before them."""
    settings = {**(ENGINE_DEFAULTS if parameters.get("defaults") else {}), **parameters}
    root = ElementTree.Element("mujoco")
    write_options(root, {key: settings[key] for key in SETTING_PLACES if key in settings})
    for option in root:
        ElementTree.indent(option)
        yield ElementTree.tostring(option, encoding="unicode").replace(" />", "/>")
    loops = equality_elements(model) if model else [ElementTree.Element("connect")]
    softness = {key: mjcf_text(settings[key]) for key in SOFTNESS_SETTINGS if key in settings}
    stops = limit_attributes(model, softness) if model else {}
    if (loops or stops) and softness:
        yield from ("<default>", f"  <equality {to_attributes(softness)}/>", "</default>")
        for loop in loops:
            if own := own_softness(loop, softness):
                yield f"<!-- {loop.tag} {loop.get('name')}: with {to_attributes(own)} in itself -->"
    for name, own in stops.items():
        yield f"<!-- joint {name}: with {to_attributes(own)} in itself -->"


def own_softness(loop: ElementTree.Element, softness: Mapping[str, str]) -> dict[str, str]:
    """Attributes that an equality itself must have, since its own or its class's would override.

    If the equality has more numbers in an attribute than are given, the further ones remain.
    """
    found = {}
    for key, value in softness.items():
        if {"class", key} & loop.attrib.keys():
            given = value.split()
            found[key] = " ".join([*given, *loop.get(key, "").split()[len(given) :]])
    return found


def limit_attributes(model: Path, softness: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Attributes of joints with a range, by name, that make their limits as soft as loops.

    The limits keep their damping ratios.  If a joint has more numbers in an attribute than are
    given, the further ones remain.
    """
    if not softness or not any(joint.get("range") for joint in read_tree(model).iter("joint")):
        return {}
    compiled = compile_model(model)
    configure(compiled, softness)
    return limit_softness(compiled, softness)


def to_attributes(values: Mapping[str, str]) -> str:
    """Attributes as MJCF text."""
    return " ".join(f'{key}="{value}"' for key, value in values.items())


def equality_elements(model: Path) -> list[ElementTree.Element]:
    """The equality elements of an MJCF, which close its loops."""
    return read_tree(model).findall("./equality/*")


def insert_snippet(model: Path, lines: str) -> str:
    """The text of an MJCF with a snippet in it, whose softness equalities and limits also get."""
    root, added = read_tree(model), ElementTree.fromstring(f"<all>{lines}</all>")
    for softness in added.iterfind("./default/equality"):
        for loop in root.iterfind("./equality/*"):
            loop.attrib.update(own_softness(loop, softness.attrib))
    said = next(added.iterfind("./default/equality"), None)
    write_limits(root, limit_attributes(model, said.attrib if said is not None else {}))
    root.extend(added)
    return ElementTree.tostring(root, encoding="unicode")
