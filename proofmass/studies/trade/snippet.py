"""A setting in the engine's own words, to paste: elements of an MJCF, or lines around a space."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

from proofmass.sim.mjcf import read_tree
from proofmass.sim.mujoco.settings import ENGINE_DEFAULTS, PLACES, SOFTNESS, spelled, write_options
from proofmass.sim.pymunk.dynamics import SURE
from proofmass.studies.setting import Knob, Setting

SPACE = ("timestep", "iterations", "error_bias")


def snippet(setting: Setting, steps: int, model: Path | None = None) -> str:
    """What to paste so that an engine runs with a setting.

    Parameters
    ----------
    setting : Setting
        With the knobs as used; what pymunk steps with are timestep, iterations and error_bias.
    steps : int
        Time steps of the run.
    model : path, optional
        The MJCF that it is for: equalities whose own attributes, or whose class, would win are
        named, with what to write into them.

    Returns
    -------
    str
        MJCF, right before ``</mujoco>``; or Python, where ``space`` is built and at its start.

    Examples
    --------
    >>> print(snippet(Setting("mujoco", {"timestep": 1e-3, "integrator": "rk4"}), 5000))
    <option timestep="0.001" integrator="RK4"/>
    >>> print(snippet(Setting("mujoco", {"cone": "elliptic", "refsafe": False}), 5000))
    <option cone="elliptic">
      <flag refsafe="disable"/>
    </option>
    >>> print(snippet(Setting("mujoco", {"solref": (0.008, 1.0)}), 5000))
    <default>
      <equality solref="0.008 1"/>
    </default>
    """
    if setting.engine == "pymunk":
        own = list(python(setting.knobs, steps)) if set(setting.knobs) >= set(SPACE) else []
        return "\n".join([*own, *(f"# {line}" for line in sidecar(setting.knobs, SPACE))])
    left = (f"<!-- {line} -->" for line in sidecar(setting.knobs, PLACES))
    return "\n".join([*mjcf(setting.knobs, model), *left])


def mjcf(knobs: Mapping[str, Knob], model: Path | None) -> Iterator[str]:
    """Elements that MuJoCo merges with those before them."""
    every = {**(ENGINE_DEFAULTS if knobs.get("defaults") else {}), **knobs}
    root = ElementTree.Element("mujoco")
    write_options(root, {key: every[key] for key in PLACES if key in every})
    for option in root:
        ElementTree.indent(option)
        yield ElementTree.tostring(option, encoding="unicode").replace(" />", "/>")
    loops = equalities(model) if model else [ElementTree.Element("connect")]
    softness = {key: spelled(every[key]) for key in SOFTNESS if key in every}
    if loops and softness:
        yield from ("<default>", f"  <equality {attributes(softness)}/>", "</default>")
        for loop in loops:
            if own := in_itself(loop, softness):
                yield f"<!-- {loop.tag} {loop.get('name')}: with {attributes(own)} in itself -->"


def in_itself(loop: ElementTree.Element, softness: Mapping[str, str]) -> dict[str, str]:
    """What an equality itself must say, since what it or its class says would win.

    Numbers of its own after those that are given remain.
    """
    found = {}
    for key, value in softness.items():
        if {"class", key} & loop.attrib.keys():
            given = value.split()
            found[key] = " ".join([*given, *loop.get(key, "").split()[len(given):]])
    return found


def attributes(said: Mapping[str, str]) -> str:
    """Attributes of an element."""
    return " ".join(f'{key}="{value}"' for key, value in said.items())


def equalities(model: Path) -> list[ElementTree.Element]:
    """Elements of an MJCF that hold loops together."""
    return read_tree(model).findall("./equality/*")


def sidecar(knobs: Mapping[str, Knob], but: Iterable[str]) -> Iterator[str]:
    """What no engine has words for."""
    for key in sorted(set(knobs) - {*but, "defaults"}):
        place = "every rod" if key == "segments" else "settings"
        yield f"{place} of the sidecar: {key} = {knobs[key]!r}"


def python(knobs: Mapping[str, Knob], steps: int) -> Iterator[str]:
    """Lines that step a space; the first step has no impulses to start from, so it takes more."""
    iterations = int(str(knobs["iterations"]))
    yield from (
        "for constraint in space.constraints:",
        f"    constraint.error_bias = {knobs['error_bias']!r}",
        f"space.iterations = {max(SURE, 10 * iterations)}  # there are no impulses to start from",
        f"space.step({knobs['timestep']!r})",
        f"space.iterations = {iterations}",
        f"for _ in range({steps - 1}):",
        f"    space.step({knobs['timestep']!r})")


def pasted(model: Path, lines: str) -> str:
    """The text of an MJCF with a snippet in it, and in its equalities what the snippet says."""
    root, added = read_tree(model), ElementTree.fromstring(f"<all>{lines}</all>")
    for softness in added.iterfind("./default/equality"):
        for loop in root.iterfind("./equality/*"):
            loop.attrib.update(in_itself(loop, softness.attrib))
    root.extend(added)
    return ElementTree.tostring(root, encoding="unicode")
