"""The MuJoCo engine: all kinds of runs of an MJCF with ``connect`` and ``joint`` equalities."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from textwrap import indent
from xml.etree import ElementTree

import mujoco

from proofmass.analytic.mjcf import read_compiled
from proofmass.analytic.names import equality_name, radian_hint
from proofmass.analytic.start import MAX_KEY_VIOLATION
from proofmass.analytic.support import left_out
from proofmass.sim.mjcf import (
    collected_warnings,
    compile_model,
    read_tree,
    refusal,
    warning_notes,
)
from proofmass.sim.mujoco import flex as mujoco_flex
from proofmass.sim.mujoco import tried_settings
from proofmass.sim.mujoco.dynamics import dynamics, run_passive
from proofmass.sim.mujoco.model import loop_violations, prepare_model
from proofmass.sim.mujoco.own_motion import solve_closely, solve_own_motion
from proofmass.sim.mujoco.program import IMPOSED, write_program
from proofmass.sim.mujoco.quasi_static import equilibrium, sweep
from proofmass.sim.mujoco.settings import (
    ACCURACY,
    ENGINE_DEFAULTS,
    SETTING_PLACES,
    SOFTNESS_SETTINGS,
    MujocoSettings,
    configure,
    limit_softness,
    mjcf_text,
    write_limits,
    write_options,
)
from proofmass.sim.mujoco.support import SUPPORT
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.own_equations import OwnMotion
from proofmass.sim.protocol.programs import Imposed, sidecar_instructions
from proofmass.sim.protocol.run import ChangingLoad, Drive, Run
from proofmass.sim.protocol.settings import ParameterValue, ParameterValues


def simulate(model: Path, run: Run) -> Curves:
    """Run a model in MuJoCo.

    Parameters
    ----------
    model : Path
        The MJCF file.
    run : Run
        See `proofmass.sim.protocol.run.Run`.  Its settings are those of
        `proofmass.sim.mujoco.settings.MujocoSettings`; for ``settled`` in a sweep see
        `proofmass.sim.mujoco.settling`, for ``flex`` in equilibrium `proofmass.sim.mujoco.flex`.

    Returns
    -------
    Curves
        The channels over ``run.x``, the actual drive state, the largest constraint
        violation and the cost.

    Raises
    ------
    BadModel
        The model does not compile, lacks a named element or is not assembled in its start pose, or
        MuJoCo itself refuses it, such as for options that exclude each other.
    Unsupported
        The model contains an element that this kind of run does not cover; the message names it.
    Diverged
        The run failed.
    """
    with translate_fatal_errors():
        if run.settings.get("flex"):
            return mujoco_flex.equilibrium(model, run)
        with collected_warnings() as warned:
            compiled = compile_model(model, run.rods)
            notes = left_out(read_compiled(compiled), SUPPORT)
            curves = run_compiled(*prepare_model(compiled, run), run)
        notes += warning_notes(compiled, warned)
        return replace(curves, notes=(*curves.notes, *notes))


@contextmanager
def translate_fatal_errors() -> Iterator[None]:
    """Raise MuJoCo's own fatal errors as errors of the model."""
    try:
        yield
    except mujoco.FatalError as error:
        raise refusal(error) from None


def run_compiled(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Do a run with a compiled model that has the run's settings and is in its start pose."""
    if run.kind == "passive":
        return run_passive(model, data, run)
    check_assembled(model, data, run.start)
    return {"sweep": sweep, "equilibrium": equilibrium, "dynamics": dynamics}[run.kind](
        model, data, run
    )


def check_assembled(model: mujoco.MjModel, data: mujoco.MjData, key: str) -> None:
    """Refuse a start pose whose loops are open by more than the rounding of the key explains."""
    mujoco.mj_kinematics(model, data)
    violations = loop_violations(model, data)
    if violations.size and not violations.max() <= MAX_KEY_VIOLATION * model.stat.extent:
        loops = [i for i in range(model.neq) if model.eq_type[i] == mujoco.mjtEq.mjEQ_CONNECT]
        name = equality_name(model, loops[int(violations.argmax())])
        raise BadModel(
            f"start pose of key {key!r} is not assembled: loop {name!r} is open by "
            f"{violations.max():.3g} m{radian_hint(model, key)}"
        )


def snippet(parameters: ParameterValues, model: Path | None = None) -> str:
    """MJCF to paste into a model so that MuJoCo runs with these settings.

    Comments name the equalities whose own attributes, or whose class, would override the settings,
    with the attributes to write into them; and the joints with a range.

    Examples
    --------
    >>> print(snippet({"timestep": 1e-3, "integrator": "rk4"}))
    <option timestep="0.001" integrator="RK4"/>
    >>> print(snippet({"cone": "elliptic", "refsafe": False}))
    <option cone="elliptic">
      <flag refsafe="disable"/>
    </option>
    >>> print(snippet({"solref": (0.008, 1.0)}))
    <default>
      <equality solref="0.008 1"/>
    </default>
    """
    sidecar_lines = (
        f"<!-- {line} -->" for line in sidecar_instructions(parameters, tuple(SETTING_PLACES))
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


class Mujoco(Engine):
    """MuJoCo as an engine of proofmass."""

    title = "MuJoCo"
    packages = ("mujoco",)
    settings = MujocoSettings
    native = True
    imposed = IMPOSED
    schemes = tried_settings.SCHEMES
    labels = tried_settings.LABELS
    sizes = tried_settings.SIZES
    accuracy = ACCURACY
    support = SUPPORT
    simulate = staticmethod(simulate)
    at_step = staticmethod(tried_settings.at_step)
    scans = staticmethod(tried_settings.scans)
    orders = staticmethod(tried_settings.orders)
    perturbations = staticmethod(tried_settings.perturbations)
    recipes = staticmethod(tried_settings.recipes)
    scheme_of = staticmethod(tried_settings.scheme_of)
    limit_problems = staticmethod(tried_settings.limit_problems)

    def own_motion(
        self,
        model: Path,
        until: float,
        samples: int,
        seconds: float,
        start: str = "start",
        drives: tuple[Drive, ...] = (),
        loads: tuple[ChangingLoad, ...] = (),
    ) -> OwnMotion:
        """See `proofmass.sim.mujoco.own_motion.solve_own_motion`."""
        with translate_fatal_errors(), collected_warnings() as warned:
            found = solve_own_motion(model, until, samples, seconds, start, drives, loads)
        return replace(found, notes=warning_notes(compile_model(model), warned) if warned else ())

    def solve_closely(self, model: Path, run: Run) -> Curves:
        """See `proofmass.sim.mujoco.own_motion.solve_closely`."""
        with translate_fatal_errors():
            return solve_closely(model, run)

    def snippet(self, parameters: ParameterValues, steps: int, model: Path | None = None) -> str:
        """Settings as MJCF; see `snippet`."""
        return snippet(parameters, model)

    def holding(
        self, model: Path, parameters: ParameterValues, slower: float
    ) -> dict[str, ParameterValue]:
        """Settings with a larger `impratio`; see `proofmass.sim.mujoco.contacts.creep_rate`."""
        own = float(str(parameters.get("impratio", compile_model(model).opt.impratio)))
        return {**parameters, "impratio": own * slower}

    def comment(self, text: str) -> str:
        """Text as a comment of MJCF."""
        return f"<!--\n{indent(text, '  ')}\n-->"

    def pasted(self, model: Path, parameters: ParameterValues, steps: int) -> tuple[str, set[str]]:
        """The model with the snippet in it, which states all settings but `settled` and `flex`."""
        return insert_snippet(model, snippet(parameters, model)), {*SETTING_PLACES, "defaults"}

    def write_program(
        self,
        model: Path,
        run: Run,
        motion: str,
        head: str,
        drive: Imposed,
        controls: str = "",
    ) -> str:
        """See `proofmass.sim.mujoco.program.write_program`."""
        return write_program(model, run, motion, head, drive, controls)


ENGINE = Mujoco()
