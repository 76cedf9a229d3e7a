"""A spring, stiffer and stiffer over 12 decades, in the joint that the drives lead last."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from proofmass.case import Case
from proofmass.reference import compiled
from proofmass.studies.reread import movable, reread
from proofmass.studies.rescaled import with_model
from proofmass.studies.stress import theory
from proofmass.studies.stress.boundary import NAN, Sought, Tried
from proofmass.studies.stress.stand import Stand, known, needs
from proofmass.studies.stress.ways import in_steps

DECADES = 1e12
BRIEF = 100  # steps of a free motion: the reference has to follow each swing of the spring


def stiffnesses(stand: Stand) -> Iterator[Sought]:
    """A stiffer and stiffer spring in the last hinge, from one that swings once in the run."""
    needs(stand.kind == "duration" and movable(stand.case) and not stand.case.rod,
          "stiffness in motion: nothing is stepped, or rods bend in it")
    free = not stand.case.drive
    needs(free or known(stand.case), "stiffness in motion: the springs move it as well")
    joint, inertia = last_hinge(stand.case)
    seconds = min(stand.seconds, BRIEF * stand.step) if free else stand.seconds
    case = brief(reread(stand.case), seconds, stand.step) if free else stand.case
    softest = inertia * (2.0 * np.pi / seconds) ** 2
    limit = NAN
    # one coordinate; in Chipmunk three of a body, which goes straight ahead during a step
    if free and compiled(case).nv == 1 and stand.setting.engine == "mujoco":
        z = theory.stiffest(integrator(stand), seconds / stand.step)
        limit = inertia * (z / stand.step) ** 2
    yield stand.sought(f"spring in {joint}", "N m/rad", softest, DECADES * softest,
                       partial(sprung, stand, case, joint), theory=limit,
                       law="" if limit != limit else "powers of the step's matrix")


def integrator(stand: Stand) -> str:
    """MuJoCo's integrator of the runs."""
    own = mujoco.mjtIntegrator(compiled(stand.case).opt.integrator).name.removeprefix("mjINT_")
    names = {name.upper(): name for name in theory.MAPS}
    return str(stand.setting.knobs.get("integrator", names[own]))


def last_hinge(case: Case) -> tuple[str, float]:
    """The last hinge that is not driven, and the inertia that it moves [kg m^2]."""
    model, driven = compiled(case), [drive.joint for drive in case.drive]
    hinges = [j for j in range(model.njnt) if model.joint(j).name not in driven
              and model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]
    needs(hinges, "stiffness in motion: no hinge but those that are driven")
    data, inertia = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_resetDataKeyframe(model, data, model.key(case.start).id)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    return str(model.joint(hinges[-1]).name), float(inertia[hinges[-1], hinges[-1]])


def brief(case: Case, seconds: float, step: float) -> Case:
    """The case with a shorter duration, looked at after every step."""
    run = case.run["duration"].model_copy(update={"n": round(seconds / step) + 1})
    return in_steps(case.model_copy(update={"run": {"duration": run}}), seconds, step)


def sprung(stand: Stand, case: Case, joint: str, stiffness: float) -> Tried:
    """Run with a spring."""
    return stand.tried(with_spring(case, stand.models, joint, stiffness))


def with_spring(case: Case, folder: Path, joint: str, stiffness: float) -> Case:
    """The case with a spring in a joint, in place of what is there."""
    def change(root: Element) -> None:
        hinge = next(one for one in root.iter("joint") if one.get("name") == joint)
        hinge.set("stiffness", repr(stiffness))
    return with_model(case, folder, change)
