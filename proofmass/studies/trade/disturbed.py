"""Effect of small disturbances on a motion: chaos, the horizon of a trajectory, and rounding.

    motion = motion_of(case, kind, store, timeout)      # of a free motion
    motion.horizon                                      # s, until which errors mean something

If the start is disturbed by 1e-9, the distance from the undisturbed motion grows in proportion to
time for a regular motion, and as exp(rate * t) for a chaotic one.  Once the distance is more than
1e-4 of the range, an error of 1e-4 means nothing for a mechanism whose start is known to 1e-9.
Errors are therefore judged only until then, the horizon.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from numpy.typing import NDArray

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.strict import Kind
from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.sim.contents import size
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.rods import chain, joint_names
from proofmass.studies.measure import (
    Measurement,
    StudyRun,
    channel_distances,
    measure,
    simulate_task,
)
from proofmass.studies.record import KIND_UNITS, NAN
from proofmass.studies.store import Store, digest, task_key
from proofmass.studies.study import Study
from proofmass.studies.trade.varied import own_settings_series
from proofmass.studies.variants import multiply_attribute, with_model

DISTURBANCE = 1e-9
"""Disturbance of the start: of all joints, and of arcs of rods with a free end [rad, or mechanism's
size].  If a joint starts at its joint limit, the rates of the joints are disturbed instead [per s]:
a disturbed value would decide whether the joint touches its limit in the first step."""
HORIZON_SHARE = 1e-4
"""Share of the range by which a disturbance may move a trajectory before its horizon: the coarsest
error for which studies look."""
LINEAR_SHARE = 1e-2
"""Share of the range up to which a disturbance counts as small, so that its growth is fitted."""
SENSITIVE_GROWTH = 100.0
"""Growth of a disturbance [1] from which a motion is called sensitive to its start."""
SUSTAINED_GROWTH = 10.0
"""Least growth [1] of a disturbance in each half of a chaotic motion; a disturbance that grows with
the cube of time grows by 8 in the second half."""
MIN_SAMPLES = 11
"""Least number of samples at which errors are judged."""
ROUNDING_ULPS = 4
"""Relative change of masses in machine epsilons, after which each step rounds differently."""
ROUNDING_CAUSE_SHARE = 0.3
"""Share of an error by which roundings must move the result for rounding to be its cause."""


@dataclass(frozen=True)
class DisturbedMotion:
    """Response of a free motion to a start that is disturbed by `DISTURBANCE`.

    Attributes
    ----------
    growth : float
        Largest distance from the undisturbed motion, as a share of its range, divided by
        `DISTURBANCE` [1].
    rate : float
        Rate of exponential growth of the distance [1/s], fitted while it is below
        `LINEAR_SHARE`; NaN if the growth is not sustained.
    horizon : float
        Time until which the distance is less than `HORIZON_SHARE` [s]; NaN if that is the whole
        run.
    until : float
        Length of the run [s].
    """

    growth: float
    rate: float
    horizon: float
    until: float

    @property
    def words(self) -> str:
        """The response in a sentence; empty if the growth is below `SENSITIVE_GROWTH`.

        >>> DisturbedMotion(1.9e7, 0.84, 15.2, 20.0).words.partition(",")[0]
        'chaotic: a start disturbed by 1e-9 moves it 1.9e7 times as far in 20 s'
        """
        if not self.growth >= SENSITIVE_GROWTH:
            return ""
        text = (
            f"a start disturbed by {number(DISTURBANCE)} moves it "
            f"{number(self.growth, 2)} times as far in {number(self.until)} s"
        )
        text = (
            f"chaotic: {text}, growing by a factor of e every {number(1 / self.rate, 2)} s"
            if self.rate > 0
            else f"sensitive to its start: {text}"
        )
        if not self.horizon > 0:
            return text
        return (
            f"{text}; by {number(HORIZON_SHARE)} of its range after {number(self.horizon)} s, so "
            f"errors are judged up to there"
        )


def disturb_motion(case: Case, kind: Kind, store: Store, timeout: float) -> DisturbedMotion | None:
    """Response of a case's free motion to a disturbance; None if it has none, or no engine runs it.

    Parameters
    ----------
    case, kind : Case, {"sweep", "dynamics", "equilibrium"}
        The case, and which of its runs.
    store : Store
        Store for the results and the changed model.
    timeout : float
        Processor time after which a run is given up [s].
    """
    if kind != "dynamics" or case.drive:
        return None
    other = with_disturbed_start(case, store.folder / "models")
    for series in own_settings_series(case, kind) if other else ():
        task = StudyRun(case, kind, series.settings[0], timed=False)
        if other and (found := stored_distances(task, other, store, timeout)):
            distance = next((found[what] for what in KIND_UNITS if what in found), None)
            if distance is not None:
                return classify_motion(found["x"], distance)
    return None


def classify_motion(x: Array, distance: Array) -> DisturbedMotion:
    """The response of a motion, from its distance (n,) to the undisturbed one at times x [s]."""
    peak = np.maximum.accumulate(distance)
    end = int(np.argmax(peak > LINEAR_SHARE)) if peak[-1] > LINEAR_SHARE else x.size - 1
    middle = end // 2
    rate = NAN
    if (
        peak[middle] >= SUSTAINED_GROWTH * DISTURBANCE
        and peak[end] >= SUSTAINED_GROWTH * peak[middle]
    ):
        fitted = slice(end // 5, end + 1)
        rate = float(np.polyfit(x[fitted], np.log(np.maximum(peak[fitted], 1e-300)), 1)[0])
    beyond = int(np.argmax(peak > HORIZON_SHARE)) if peak[-1] > HORIZON_SHARE else 0
    last = max(beyond - 1, min(MIN_SAMPLES, x.size) - 1)
    return DisturbedMotion(
        float(peak[-1]) / DISTURBANCE, rate, float(x[last]) if beyond else NAN, float(x[-1] - x[0])
    )


def end_at_horizon(case: Case, kind: Kind, motion: DisturbedMotion | None) -> Case:
    """The case with its run ended at the motion's horizon; the case itself without a horizon."""
    table = case.run[kind]
    if motion is None or not motion.horizon > 0 or not table.until or not table.n:
        return case
    samples = round(motion.horizon / table.until * (table.n - 1))
    samples += samples % 2  # even, so that every other sample includes the last one
    until = samples * table.until / (table.n - 1)
    return case.with_run(kind, n=samples + 1, until=until)


def measure_rounding(task: StudyRun, store: Store, timeout: float) -> dict[str, float]:
    """Largest change of a run by roundings, for each kind of channel, as a share of its range [1].

    Masses are changed by `ROUNDING_ULPS` roundings and the start by one, after which each step
    rounds differently.
    """
    other = with_roundings(task.case, store.folder / "models")
    found = stored_distances(task, other, store, timeout) if other else {}
    return {what: float(away.max()) for what, away in found.items() if what != "x"}


def with_disturbed_start(case: Case, folder: Path) -> Case | None:
    """The case with a disturbed start: joints or their rates, and arcs of rods with a free end.

    None if the file does not state the key of the start, if nothing can be disturbed, or if the
    disturbed model does not compile: a straight rod cannot be closed between displaced pins.
    """
    model, own = compiled_model(case), own_joint_mask(case)
    sliding = model.jnt_type[own] == mujoco.mjtJoint.mjJNT_SLIDE
    units = np.where(sliding, size(model, case.start), 1.0)
    signs = np.where(np.arange(sliding.size) % 3 == 1, -1.0, 1.0)  # not all in one direction
    turned_rods = {
        name: rod.model_copy(update={"turn": rod.turn + DISTURBANCE})
        for name, rod in case.rod.items()
        if rod.to is None
    }
    if not (own.any() or turned_rods):
        return None
    what = "qvel" if is_at_joint_limit(case) else "qpos"
    if not (
        found := with_changed_start(
            case, folder, lambda x: x + DISTURBANCE * signs * units, what=what
        )
    ):
        return None
    found = found.model_copy(update={"rod": {**case.rod, **turned_rods}})
    try:
        compiled_model(found)
    except InputError:
        return None
    return found


def with_roundings(case: Case, folder: Path) -> Case | None:
    """The case with masses and start changed by roundings; None if its file lacks the start key."""

    factor = 1.0 + ROUNDING_ULPS * np.finfo(float).eps

    def change(root: Element) -> None:
        for element in root.iter():
            for key in ("mass", "diaginertia", "fullinertia", "density"):
                multiply_attribute(element, key, factor)

    rods = {
        name: rod.model_copy(update={"mass": rod.mass and rod.mass * factor})
        for name, rod in case.rod.items()
    }
    found = with_changed_start(case, folder, lambda q: np.nextafter(q, np.inf), change)
    return found.model_copy(update={"rod": rods}) if found else None


def is_at_joint_limit(case: Case) -> bool:
    """Whether a joint is at its joint limit at the start."""
    model = compiled_model(case)
    key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, case.start)
    values = (model.key_qpos[key] if key >= 0 else model.qpos0)[model.jnt_qposadr]
    limited = model.jnt_limited.astype(bool)
    ends = model.jnt_range[limited]
    distances = np.abs(ends - values[limited, None])
    return bool((distances <= DISTURBANCE * np.maximum(np.abs(ends), 1.0)).any())


def own_joint_mask(case: Case) -> NDArray[np.bool_]:
    """Mask (njnt,) of the joints of the compiled model that belong to its file, not to its rods."""
    model = compiled_model(case)
    added = {name for rod in case.rods for name in joint_names(chain(rod))}
    return np.array([model.joint(j).name not in added for j in range(model.njnt)], bool)


def with_changed_start(
    case: Case,
    folder: Path,
    move: Callable[[Array], Array],
    change: Callable[[Element], None] = lambda _: None,
    what: str = "qpos",
) -> Case | None:
    """The case with positions (or rates, by `what`) of its own joints changed at its start.

    `move` changes them, and `change` the rest of the MJCF.  None if the file does not state the key
    of the start.
    """
    model, own = compiled_model(case), own_joint_mask(case)
    key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, case.start)
    if key < 0 or model.nq != model.njnt:
        return None
    there = False

    def change_all(root: Element) -> None:
        nonlocal there
        for element in root.iterfind("./keyframe/key"):
            if element.get("name") == case.start:
                there = True
                if own.any():
                    start = move(getattr(model, f"key_{what}")[key][own])
                    element.set(what, " ".join(map(repr, start.tolist())))
        change(root)

    found = with_model(case, folder, change_all)
    return found if there else None


def stored_distances(task: StudyRun, other: Case, store: Store, timeout: float) -> dict[str, Array]:
    """Distance (n,) of two runs with a setting by kind of channel, as shares of its range; and x.

    The runs are those of a task's case and of another case.  Neither is compared with a reference.
    Empty if either fails.
    """
    twin = replace(task, case=other)
    name = f"{task_key(task)}.{digest(task_key(twin).encode())[:16]}.parted.json"

    def made() -> dict[str, list[float]]:
        one, two = (measure(simulate_task, each, timeout=timeout) for each in (task, twin))
        if isinstance(one, Measurement) or isinstance(two, Measurement):
            return {}
        return {what: values.tolist() for what, values in largest_distances(task, one, two).items()}

    return {what: np.array(values) for what, values in store.value(name, made).items()}


def largest_distances(task: StudyRun, one: Curves, two: Curves) -> dict[str, Array]:
    """Largest distance (n,) of two runs at each sample, by kind of channel; and x."""
    found = {"x": one.x}
    for what, distance in channel_distances(task.case, task.run, one.channels, two.channels):
        found[what] = np.maximum(found.get(what, 0.0), distance)
    return found


def disturb_motions(
    cases: list[Case], kinds: list[Kind], study: Study
) -> list[DisturbedMotion | None]:
    """Call `disturb_motion` for many cases in parallel, in workers here or of a cluster."""
    with study.working() as working:
        return working.call_each(
            disturb_motion,
            [
                (case, kind, study.store, study.longest or case.run[kind].timeout)
                for case, kind in zip(cases, kinds, strict=True)
            ],
        )
