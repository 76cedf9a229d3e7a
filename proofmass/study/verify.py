"""Is a measured setting good by luck?  Once more as its snippet says it, and from another start."""

import tempfile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from analytic import planar
from proofmass.case import Case
from proofmass.check import FAILURES
from proofmass.recorded import Recorded
from proofmass.reference import evaluate, module_of
from proofmass.solve import simulate
from proofmass.strict import Kind
from proofmass.study.measure import shares
from proofmass.study.setting import Knob, Setting
from proofmass.study.snippet import EQUALITY, OPTION, SPACE, pasted, snippet
from sim.mjcf import read_tree
from sim.protocol import Array, BadModel, Curves, Run, Unsupported

PART = 0.381966  # of a sample; irrational, or some steps would fall where others fell before


def again(case: Case, kind: Kind, setting: Setting, steps: int, of: str) -> tuple[float, Setting]:
    """The error of a setting that is run again, and the setting as it was used."""
    curves, used = fresh(case, kind, setting, steps)
    return error_of(setting.applied(case, kind)[0], kind, curves, of), used


def elsewhere(case: Case, kind: Kind, setting: Setting, of: str) -> float:
    """The error of a setting from a shifted start."""
    curves = shifted(case, kind, setting)
    return error_of(setting.applied(case, kind)[0], kind, curves, of)


def fresh(case: Case, kind: Kind, setting: Setting, steps: int) -> tuple[Curves, Setting]:
    """A run anew, in MuJoCo with the snippet pasted; and the setting as it was used."""
    case, run = setting.applied(case, kind)
    if setting.engine == "mujoco":
        said = {*OPTION, *EQUALITY, "defaults"}
        run = replace(run, settings={k: v for k, v in run.settings.items() if k not in said})
        text = pasted(case.model_path, snippet(setting, steps, case.model_path))
        curves = ran_text(text, case, run)
    else:
        curves = simulate(setting.engine, case.model_path, run)
    return curves, setting.but(**used(curves, setting)) if kind == "duration" else setting


def shifted(case: Case, kind: Kind, setting: Setting) -> Curves:
    """A run whose samples, and so its start, lie a part of a sample later on the same motion.

    A drive goes by its law; a free motion starts from the pose and rates that the general planar
    solver finds there.

    Raises
    ------
    Unsupported
        There is no other start; says why.
    """
    case, run = setting.applied(case, kind)
    if kind == "rest":
        raise Unsupported("a rest has one start")
    if isinstance(module_of(case), Recorded):
        raise Unsupported("the reference is a recorded curve, known at its samples only")
    later = replace(run, x=run.x[:-1] + PART * np.diff(run.x))
    if run.drives:
        return simulate(setting.engine, case.model_path, later)
    text = moved_on(case, float(later.x[0] - run.x[0]))
    return ran_text(text, case, later, setting.engine)


def error_of(case: Case, kind: Kind, curves: Curves, of: str) -> float:
    """Largest error of a kind, as a share of range; NaN where the curves have none."""
    if curves.stopped or not all(np.isfinite(part).all() for part in curves.channels.values()):
        return np.nan
    if curves.drive is None and kind == "duration" and curves.x[0] > 0.0:
        curves = from_start(case, curves)
    return shares(case, kind, curves).get(of, np.nan)


def from_start(case: Case, curves: Curves) -> Curves:
    """Curves of a free motion with the reference's own start before them.

    The general planar solver takes the first time for that of the start pose.
    """
    truth = evaluate(case, np.array([0.0, curves.x[0]]), None).channels
    return replace(curves, x=np.append(0.0, curves.x), channels={
        name: np.append(truth[name][0], values) for name, values in curves.channels.items()})


def used(curves: Curves, setting: Setting) -> dict[str, Knob]:
    """What an engine stepped with, as knobs: those that it chose itself, or fitted to the samples.
    """
    chosen = (name for name in SPACE if name == "timestep" or setting.engine != "mujoco")
    return {name: value for name in chosen
            if isinstance(value := curves.settings.get(name), (int, float))}


def ran_text(text: str, case: Case, run: Run, engine: str = "mujoco") -> Curves:
    """A run of a changed model."""
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / case.model_path.name
        model.write_text(text, encoding="utf-8")
        return simulate(engine, model, run)


def moved_on(case: Case, time: float) -> str:
    """The text of a model whose start key is where its free motion comes to after a time [s]."""
    root = read_tree(case.model_path)
    key = root.find(f"./keyframe/key[@name='{case.start}']")
    if key is None:
        raise Unsupported(f"no key {case.start!r} in the file itself")
    for name, values in zip(("qpos", "qvel"), state_at(case, time), strict=True):
        key.set(name, " ".join(map(repr, values.tolist())))
    return ElementTree.tostring(root, encoding="unicode")


def state_at(case: Case, time: float) -> tuple[Array, Array]:
    """Positions and rates of all joints of a free planar motion after a time [s]."""
    spec = mujoco.MjSpec.from_file(str(case.model_path))
    kinds = {"jointpos": mujoco.mjtSensor.mjSENS_JOINTPOS,
             "jointvel": mujoco.mjtSensor.mjSENS_JOINTVEL}
    for joint in spec.joints:
        for word, sensor in kinds.items():
            spec.add_sensor(name=f"{word} {joint.name}", type=sensor, objname=joint.name,
                            objtype=mujoco.mjtObj.mjOBJ_JOINT)
    try:
        found = planar.solve(np.array([0.0, time]), model=spec.compile(), start=case.start)
    except (TypeError, ValueError) as error:
        raise Unsupported(f"nothing tells another start of this free motion: {error}") from None
    position, rate = (np.array([found[f"{word} {joint.name}"][-1] for joint in spec.joints])
                      for word in kinds)
    return position, rate


LOST: tuple[type[Exception], ...] = (BadModel, *FAILURES)
"""What a run may raise."""
