"""The first screen of a model: what it is, what is wrong with it, which steps it bears.

All follows from the start pose at rest: the key ``start``, else the first key, else the initial
pose, with the controls of the key.  What is claimed of a run is confirmed by a run of a second.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from proofmass.base.wording import number
from proofmass.screen.change_points import COORDINATES_OF_A_WAY, judge_change_points
from proofmass.screen.contact_creep import judge_contact_creep
from proofmass.screen.creep import judge_creep
from proofmass.screen.energy import judge_energy
from proofmass.screen.finding import FindingKind, ModelFinding, Severity
from proofmass.screen.gimbal import judge_gimbals
from proofmass.screen.linear import LinearMotion, VibrationMode
from proofmass.screen.loops import judge_closing, judge_openings
from proofmass.screen.mobility import Mobility, find_mobility, judge_mobility
from proofmass.screen.pins import judge_free_ends, judge_pins
from proofmass.screen.pose import RestPose
from proofmass.screen.rest import find_rest
from proofmass.screen.servos import judge_servos
from proofmass.screen.short_run import run_as_it_is, start_key, start_of
from proofmass.screen.soft_loops import judge_soft_loops, judge_stops
from proofmass.screen.start_checks import judge_sensors, judge_start
from proofmass.screen.steps import StableSteps, find_stable_steps, judge_steps
from proofmass.sim.mjcf import collected_warnings
from proofmass.sim.model_source import ModelSource, source_of_object

LINEARISED_UP_TO = 300
"""Coordinates up to which a motion is linearised; 300 take about 10 s."""
AT_REST = 1e-6
"""Largest acceleration of an equilibrium [SI]."""
LEAST_GROWTH = 1e-2
"""Least rate of a growing mode that is told [1/s]."""
STILL = 1e-12
"""Largest motion of a model that stands still [rad or m]."""
FIRST_STEPS = 20
"""Steps in which a model that moves at all has left its start."""
NO_JOINT = ModelFinding(
    FindingKind.NOTHING_MOVES, Severity.FAULT, "no joint: nothing can move", "give bodies joints"
)
NOT_FINITE = ModelFinding(
    FindingKind.NOT_FINITE,
    Severity.FAULT,
    "positions or accelerations of the start are not finite",
    "check the key, masses and inertias",
)
STANDS_STILL = ModelFinding(
    FindingKind.NOTHING_MOVES,
    Severity.WARNING,
    "nothing moves from this start",
    "give a key with another pose, velocities (qvel) or controls (ctrl)",
)


@dataclass(frozen=True)
class Screen:
    """What a first screen finds.

    Attributes
    ----------
    file : Path or None
        The file of the model; None for one that was compiled before.
    mobility : Mobility or None
        None for a model without joints, or whose start is not finite.
    modes : tuple of VibrationMode
        Of the motion about the start pose, the fastest first.
    steps : StableSteps or None
        None if the motion was not linearised.
    findings : tuple of ModelFinding
        The worst first.
    """

    file: Path | None
    mobility: Mobility | None = None
    modes: tuple[VibrationMode, ...] = ()
    steps: StableSteps | None = None
    findings: tuple[ModelFinding, ...] = ()

    @property
    def name(self) -> str:
        """The name of its file, or ``model``."""
        return self.file.name if self.file else "model"


def screen_model(model: mujoco.MjModel | mujoco.MjSpec | Path | str) -> Screen:
    r"""Say what a model is, what is wrong with it at its start, and which time steps it bears.

    Parameters
    ----------
    model : MjModel, MjSpec or path
        A model, which stays as it is, or a file: an MJCF, a URDF or an MJB.

    Returns
    -------
    Screen

    Raises
    ------
    BadModel
        The file cannot be read or compiled.

    Examples
    --------
    A velocity servo with the gain 2 N m s/rad on a wheel with the inertia 0.01 kg m^2, whose
    largest stable step with Euler is 2 I / kv = 10 ms:

    >>> found = screen_model(mujoco.MjModel.from_xml_string('''
    ...     <mujoco><option gravity="0 0 0" timestep="0.015"/>
    ...     <worldbody><body><joint name="wheel"/>
    ...     <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody>
    ...     <actuator><velocity name="servo" joint="wheel" kv="2" ctrlrange="-1 1"/></actuator>
    ...     <keyframe><key ctrl="1"/></keyframe></mujoco>'''))
    >>> print(found.findings[0].text.replace(": ", ":\n"))
    the step of 15 ms is 1.5 times the largest stable one, 10 ms (Euler):
    the model blows up at joint wheel, by the damping of actuator servo
    >>> found.mobility.dof
    1
    """
    if isinstance(model, Path | str):
        return screen_source(ModelSource(Path(model)))
    if isinstance(model, mujoco.MjSpec):
        return screen_source(source_of_object(model, str))
    return screen_compiled(model, None)


def screen_source(source: ModelSource) -> Screen:
    """Do what `screen_model` does with a model in any form."""
    return screen_compiled(source.read().model, source.file if source.is_file else None)


def screen_compiled(model: mujoco.MjModel, file: Path | None) -> Screen:
    """Do what `screen_model` does with a compiled model, and the file that it is from."""
    with collected_warnings():
        key = start_key(model)
        data = start_of(model, key)
        if not model.nv:
            return Screen(file, findings=(NO_JOINT,))
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qacc).all()):
            return Screen(file, findings=(NOT_FINITE,))
        return screen_motion(model, file, key, data)


def screen_motion(
    model: mujoco.MjModel, file: Path | None, key: int, data: mujoco.MjData
) -> Screen:
    """Screen a model with joints from a start state."""
    pose = RestPose(model, data.qpos, data.ctrl, data.act)
    findings = [*judge_openings(pose), *judge_start(model, data), *judge_stops(model, data)]
    start = pose.qpos.copy()
    left = pose.close()
    findings += judge_closing(pose, left, -pose.change_to(start))
    mobility = find_mobility(pose)
    findings += judge_mobility(pose, mobility)
    findings += [*judge_pins(pose), *judge_free_ends(pose)]
    if mobility.has_one_way and model.nv <= COORDINATES_OF_A_WAY:
        findings += judge_change_points(pose)
    modes: tuple[VibrationMode, ...] = ()
    steps: StableSteps | None = None
    if model.nv <= LINEARISED_UP_TO:
        motion = LinearMotion(pose)
        modes = tuple(motion.modes())
        rest = find_rest(pose)
        steps = find_stable_steps(model, key, pose, motion)
        findings += judge_modes(modes, data)
        findings += judge_steps(model, key, steps)
        findings += judge_soft_loops(model, key, motion, rest)
        findings += judge_creep(model, key, data, motion)
        findings += judge_servos(model, key, pose, rest) if rest else []
    findings += [*judge_contact_creep(model, key), *judge_energy(model, key)]
    findings += judge_gimbals(model, key)
    later, moved = run_as_it_is(model, key, FIRST_STEPS)
    stands = np.abs(moved).max() < STILL
    findings += [STANDS_STILL] if stands else judge_sensors(model, data, later)
    ordered = sorted(findings, key=lambda finding: -finding.severity)
    return Screen(file, mobility, modes, steps, tuple(ordered))


def judge_modes(modes: tuple[VibrationMode, ...], data: mujoco.MjData) -> Iterator[ModelFinding]:
    """An equilibrium that the model leaves by itself."""
    growth = max((mode.rate.real for mode in modes), default=0.0)
    if growth > LEAST_GROWTH and np.abs(data.qacc).max() < AT_REST:
        yield ModelFinding(
            FindingKind.UNSTABLE_REST,
            Severity.WARNING,
            "the start is an unstable equilibrium, which the model leaves with a time constant of "
            f"{number(1.0 / growth)} s: rounding decides the motion",
            "start beside it, or with a velocity",
            value=1.0 / growth,
        )
