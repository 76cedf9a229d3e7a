"""A setting in the engine's own words, to paste, and as a program that runs without proofmass.

A program holds the model, the state it starts from, how its drives are moved, the steps and what is
recorded.  Its error is that of its own run, in an interpreter that does not import proofmass, at
the motion that was asked for.
"""

import csv
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from proofmass.case import Case
from proofmass.drive import motion_source
from proofmass.files import write_whole
from proofmass.sim.mjcf import read_tree
from proofmass.sim.mujoco.settings import ENGINE_DEFAULTS, PLACES, SOFTNESS, spelled, write_options
from proofmass.sim.protocol import Curves, Imposed, Run
from proofmass.sim.pymunk.dynamics import SURE
from proofmass.solve import engine_module
from proofmass.studies.bounded import limited
from proofmass.studies.measure import own_core, pinned, shares
from proofmass.studies.record import Knob, Setting
from proofmass.studies.store import Store, digest, read, sources, versions
from proofmass.wording import number

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


PRINTED = re.compile(r"^(\d+) steps in (\S+) s", re.MULTILINE)


@dataclass(frozen=True)
class Ran:
    """What the run of a program gave.

    Attributes
    ----------
    errors : dict of str to float
        Largest error of each kind of channel, as a share of the reference's range.
    seconds, steps : float, int
        Wall time of its loop [s], and time steps.
    failure : str
        Why there are no errors, in the program's own words.
    """

    errors: dict[str, float] = field(default_factory=dict)
    seconds: float = float("nan")
    steps: int = 0
    failure: str = ""


def imposed(case: Case, engine: str) -> Sequence[Imposed]:
    """The ways in which programs of an engine can move the drives of a case, the ideal one first.
    """
    ways: Sequence[Imposed] = engine_module(engine).IMPOSED
    return ways if case.drive else ways[:1]


def program(case: Case, setting: Setting, drive: Imposed, head: str = "") -> str:
    """Write the duration of a case with a setting as a program, in a worker.

    Raises
    ------
    Unsupported
        The engine cannot write it; says why.
    InputError, BadModel
        The case is at fault.
    """
    return str(limited(case, "duration", written, case, setting, drive, head))


def written(case: Case, setting: Setting, drive: Imposed, head: str) -> str:
    """The same, in this process."""
    case, run = setting.applied(case, "duration")
    motion = motion_source([each.law for each in run.drives], run.x)
    return str(engine_module(setting.engine).write_program(case.model_path, run, motion, head,
                                                           drive))


def tried(case: Case, setting: Setting, drive: Imposed, store: Store, timeout: float) -> Ran:
    """Run the program of a setting, or find in the store what it gave."""
    text = program(case, setting, drive)
    name = digest(json.dumps([text, case.model_dump(mode="json"), versions(setting.engine),
                              sources()], sort_keys=True).encode())
    file = store.folder / f"{name}.program.json"
    if file.is_file():
        return Ran(**{"seconds": float("nan"), **read(file)})
    with own_core() as core:
        ran = limited(case, "duration", run_program, case, setting, text, timeout, core)
    told = {key: value for key, value in asdict(ran).items() if value == value}
    if not ran.failure.startswith(LATE):
        write_whole(file, json.dumps(told))
    return ran


LATE = "no end after"


def run_program(case: Case, setting: Setting, text: str, timeout: float, core: int | None = None
                ) -> Ran:
    """Run a program in a bare interpreter, and hold its curves against the reference."""
    case, run = setting.applied(case, "duration")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.py"
        file.write_text(text, encoding="utf-8")
        try:
            with pinned(core):
                done = subprocess.run([sys.executable, "-I", file.name], cwd=folder, text=True,
                                      capture_output=True, timeout=timeout, check=False)
        except subprocess.TimeoutExpired:
            return Ran(failure=f"{LATE} {timeout:g} s")
        if done.returncode or not (printed := PRINTED.search(done.stdout)):
            said = done.stderr.strip().splitlines() or ["it ended without a word"]
            return Ran(failure=said[-1])
        curves = read_curves(Path(folder) / "curves.csv", run)
    lost = [name for name, values in curves.channels.items() if not np.isfinite(values).all()]
    if lost:
        return Ran(failure=f"{lost[0]} is not finite")
    return Ran(shares(case, "duration", curves), float(printed[2]), int(printed[1]))


def read_curves(file: Path, run: Run) -> Curves:
    """The curves that a program wrote, at the state that its drives were asked to have."""
    with file.open(encoding="utf-8", newline="") as stream:
        names = next(csv.reader(stream))
        rows = np.loadtxt(stream, delimiter=",", ndmin=2)
    if not np.allclose(rows[:, 0], run.x, rtol=0.0, atol=1e-9 * np.ptp(run.x)):
        raise ValueError("the program sampled at other times than it was asked to")
    state = run.motion(run.x) if run.drives else None
    return Curves(run.x, dict(zip(names[1:], rows[:, 1:].T, strict=True)), drive=state)


def drive_words(drive: Imposed) -> str:
    """How a drive is moved, in words.

    >>> drive_words(Imposed("flywheel")), drive_words(Imposed("servo", 0.5))
    ('a flywheel', 'a servo of gain 0.5')
    """
    article = "an" if drive.kind[0] in "aeiou" else "a"
    gain = f" of gain {number(drive.gain, 2)}" if drive.gain else ""
    return f"{article} {drive.kind}{gain}"
