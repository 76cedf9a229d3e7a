"""A scene of a diet: a model, the runs that it must still do, and the changes that are allowed.

If the model has sidecars, the runs are theirs in MuJoCo, and a channel may change by a tenth of the
difference between its tolerance and its error.  Otherwise the run is a free motion from the model's
key, and a channel may change as much as by a very small change of the start pose, called a nudge.

Another option of the engine changes every channel by more than that, to a smaller or a larger
error.  So runs with other options are compared with a reference.  If there are sidecars it is
theirs, and the error may grow by a tenth of the difference between tolerance and error.  Otherwise
it is a fine solution of the same model; the error of a channel against it may be 1.1 times the
error with the model's own options, or as large as the caller allows.
"""

import tomllib
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import cast

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError, suggest_names
from proofmass.base.files import read_text
from proofmass.base.strict import Kind
from proofmass.base.wording import format_list, number
from proofmass.base.worker import call_isolated
from proofmass.batch.check import LOADING_SECONDS, load_validated
from proofmass.case.case import Case
from proofmass.reference.evaluate import reference_for
from proofmass.run.solve import plan_run
from proofmass.sim.engines import NATIVE_ENGINE
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.curves import Curves, split_channel
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Run
from proofmass.studies.bounded import call_bounded
from proofmass.studies.diet.edits import MONITORED_LISTS, EditedModel, read_model
from proofmass.studies.diet.trial import (
    FREE_MOTION,
    attempt,
    failed_outcome,
    groups,
    has_time_steps,
)
from proofmass.studies.measure import Measurement, measure
from proofmass.verdict.compare import allowed_error, mechanism_sizes
from proofmass.verdict.outcome import OUTCOME_OF_EXCEPTION, Outcome

CHANNEL_ROUNDING_SHARE = 1e-9  # of a channel's largest value; 1e7 times that of one number
NUDGE = 1e-12  # [rad or m] of every joint at the start; the changes that it causes are allowed
CHAOS_SHARE = 0.1
"""Share of a channel's largest value; if the nudge changes it by more, it is chaotic."""
MIN_RUN_SAMPLES = 10  # samples before chaos that a run must have
FREE_MOTION_SAMPLES = 501
ALLOWED_CHANGE_SHARE = 0.1
"""Share of the difference between tolerance and error by which a channel may change."""
ORIGINAL_RUN_TIMEOUT = 600.0  # s, processor time of a run of the original model
COMPILE_TIMEOUT = 120.0  # s, processor time of compiling, as a run has that states no limit
COUNTED_STEPS = 500  # steps whose iterations are counted, at most
TIMED_STEPS = 2000  # steps that are timed, at most
BRIEF_SECONDS = 0.05
"""Counted time of a run that is timed or counted [s]; it has fewer steps if they are slow."""
FINE_DIVISORS = (4, 8)
"""Divisors of the time step in fine solutions; the last one is the reference."""
FINE_SETTINGS = {"solver": "Newton", "tolerance": 1e-14, "iterations": 100}
"""Other options of these."""
ERROR_GROWTH = 0.1  # share of an error by which it may grow, if no tolerance allows more
MAX_STEPS_PER_SAMPLE = 64  # so that steps up to so many times longer can be tried
MIN_THINNED_SAMPLES = 50  # samples that must remain


@dataclass(frozen=True)
class Bound:
    """The reference that a run is compared with when the engine has other options.

    Attributes
    ----------
    run : Run
        The run, with as many samples as the comparison needs.
    allowed : dict of str to float
        The largest allowed error of each channel [its unit].
    reference : dict of str to ndarray
        The fine solution of each channel [its unit]; empty if there is a case.
    case : Case, optional
        The case whose reference is evaluated, at the state that the drives had in the run.
    """

    run: Run
    allowed: dict[str, float]
    reference: dict[str, Array] = field(default_factory=dict)
    case: Case | None = None

    def errors(self, curves: Curves) -> dict[str, float]:
        """Largest error of each channel, over the allowed one."""
        reference = (
            self.reference
            if self.case is None
            else call_bounded(
                self.case,
                cast(Kind, self.run.kind),
                reference_for,
                self.case,
                cast(Kind, self.run.kind),
                curves,
            ).channels
        )
        return {
            name: float(np.abs(curves.channels[name] - reference[name]).max()) / most
            for name, most in self.allowed.items()
        }


@dataclass(frozen=True)
class MonitoredRun:
    """A run whose channels must not change by more than is allowed.

    Attributes
    ----------
    name : str
        Case, kind of run, and setting if it has a name.
    run : Run
        The run itself.
    allowed : dict of str to ndarray
        Largest allowed change of each channel at each sample [its unit].
    before : Curves
        The curves of the original model.
    level : frozenset of str
        Channels that are known up to a constant, such as potential energies, so that their change
        since the start is used.
    bound : Bound, optional
        The reference for other options; without it the changes that are allowed for a feature are
        allowed for an option.
    """

    name: str
    run: Run
    allowed: dict[str, Array]
    before: Curves
    level: frozenset[str] = frozenset()
    bound: Bound | None = None

    @property
    def brief(self) -> Run:
        """The first samples: `COUNTED_STEPS` steps or `BRIEF_SECONDS` of counted time."""
        return self.shortened(self.run)

    def shortened(self, run: Run, most_steps: int = COUNTED_STEPS) -> Run:
        """The first samples of a run, with `most_steps` steps or `BRIEF_SECONDS` of counted time.

        There are at least two.  The run is this one, or that of its bound.
        """
        length = float(np.ptp(self.before.x)) or 1.0
        samples = max(1, round((run.x.size - 1) * length / (float(np.ptp(run.x)) or length)))
        stride = max(1, self.before.steps // samples)
        if self.before.cost > 0 and self.before.steps:
            most_steps = min(most_steps, int(BRIEF_SECONDS * self.before.steps / self.before.cost))
        return replace(run, x=run.x[: max(2, most_steps // stride)])


@dataclass(frozen=True)
class DietScene:
    """A model and the runs that it must still do.

    Attributes
    ----------
    edited : EditedModel
        The original model.
    monitored_runs : tuple of MonitoredRun
        The runs.
    read : set of str, or None
        Sensors that the sidecars read; None, without sidecars, means all.
    keys : set of str
        Keys that runs start from.
    said : tuple of str
        Sentences on what is monitored, and what options are compared with.
    """

    edited: EditedModel
    monitored_runs: tuple[MonitoredRun, ...]
    read: set[str] | None
    keys: set[str]
    said: tuple[str, ...] = ()

    @property
    def longest(self) -> MonitoredRun:
        """The run with the largest counted time, of those with time steps if there are any."""
        return max(self.monitored_runs, key=lambda w: (has_time_steps(w.run), w.before.cost))


def load_scene(
    file: Path, seconds: float, monitored: tuple[str, ...] = (), error: float | None = None
) -> DietScene:
    """The scene of a model, with the sidecars in its folder that are about it.

    Parameters
    ----------
    file : Path
        The MJCF file.
    seconds : float
        Duration of the run of a model without sidecars [s].
    monitored : tuple of str
        Names of joints, bodies, sites and sensors that are monitored; if empty, all sensors are, or
        all that moves.
    error : float, optional
        Largest allowed difference from the fine solution when the engine has other options, as a
        share of the channel's range [1]; for models without sidecars only.

    Raises
    ------
    InputError
        The model or a sidecar cannot be used, the original model does not run, or no element has a
        name that is to be monitored.
    """
    if error is not None and not 0 <= error < np.inf:
        raise InputError(
            file, "--error", f"{error:g} is no share of a range; give a number such as 1e-4"
        )
    cases = list(load_sidecars(file)) if file.is_file() else []
    if not cases:
        compile_in_worker(file)
    runs = [
        (case, kind, solver)
        for case in cases
        for kind in case.run
        for solver in mujoco_solvers(case, kind)
    ]
    edited = read_model(file, next((case.rods for case in cases), ()), not runs, monitored)
    if not runs:
        free_motion = monitor_free_motion(file, edited, seconds)
        keys = {free_motion.run.start, *(case.start for case in cases)} - {""}
        with_reference, why = with_fine_solution(file, edited, free_motion, error)
        return DietScene(
            edited,
            (with_reference,),
            monitored_sensors(edited),
            keys,
            (*describe_monitored(edited, free_motion), why),
        )
    if error is not None:
        raise InputError(
            file,
            "--error",
            "its sidecar states what an error may be; change its tolerances, or leave --error out",
        )
    monitored_runs = [
        monitor_run(case, plan_run(case, kind, solver), solver, edited)
        for case, kind, solver in runs
    ]
    named = [sensor.name for sensor in edited.spec.sensors]
    sensors = {split_channel(name, named)[0] for case in cases for name in case.channels}
    words = "Monitored: the channels of the sidecars, in their runs."
    if monitored:
        read_by = sensors_at(edited, monitored)
        monitored_runs = [
            keep_channels(w, read_by) for w in monitored_runs if channels_of_sensors(w, read_by)
        ]
        if not monitored_runs:
            known_channels = dict.fromkeys(n for w in runs for n in w[0].channels)
            raise InputError(
                file,
                "--watch",
                f"no channel of the sidecars reads {format_list(monitored)}; "
                f"{suggest_names(monitored[0], known_channels, 'their channels')}",
            )
        sensors &= read_by
        words = (
            f"Monitored: {format_list(dict.fromkeys(n for w in monitored_runs for n in w.allowed))}"
            ", in the runs of the sidecars."
        )
    return DietScene(
        edited,
        tuple(monitored_runs),
        sensors,
        {case.start for case in cases},
        (
            words,
            "Options are compared with the references of the sidecars: an error may grow by a "
            "tenth of the difference between its tolerance and itself.",
        ),
    )


def sensors_at(edited: EditedModel, monitored: Collection[str]) -> set[str]:
    """The sensors and rods with these names, and the sensors at elements with these names."""
    return {*monitored, *(s.name for s in edited.spec.sensors if s.objname in monitored)}


def monitored_sensors(edited: EditedModel) -> set[str] | None:
    """The sensors that are monitored in a model without sidecars; None if all are."""
    if not edited.monitored:
        return None
    return {
        s.name
        for s in edited.spec.sensors
        if s.name in edited.monitored or s.name in edited.added_sensors
    }


def channels_of_sensors(monitored: MonitoredRun, sensors: set[str]) -> list[str]:
    """The channels of a run that these sensors measure."""
    return [name for name in monitored.allowed if split_channel(name, sensors)[0] in sensors]


def keep_channels(monitored: MonitoredRun, sensors: set[str]) -> MonitoredRun:
    """A run of which only the channels of these sensors are monitored."""
    names = channels_of_sensors(monitored, sensors)
    run = replace(monitored.run, channels=tuple(names))
    bound = monitored.bound and replace(
        monitored.bound, run=run, allowed={n: monitored.bound.allowed[n] for n in names}
    )
    return replace(
        monitored,
        run=run,
        allowed={n: monitored.allowed[n] for n in names},
        bound=bound,
        before=replace(monitored.before, channels={n: monitored.before.channels[n] for n in names}),
    )


def describe_monitored(edited: EditedModel, monitored: MonitoredRun) -> Iterator[str]:
    """Sentences on what is monitored of a model without sidecars, and on its independent groups."""
    named = [
        f"{word} {e.name}"
        for kind, word in MONITORED_LISTS.items()
        for e in getattr(edited.spec, kind)
        if e.name in edited.monitored and e.name not in edited.added_sensors
    ]
    sensors = [s.name for s in edited.spec.sensors if s.name not in edited.added_sensors]
    if edited.monitored:
        yield f"Monitored: {format_list(named)}, and nothing else."
    elif sensors:
        yield (
            f"Monitored, since no sidecar and no --watch says what matters: all sensors of the "
            f"model, {format_list(sensors)}."
        )
    else:
        yield (
            "Monitored, since no sidecar, no sensor and no --watch says what matters: everything "
            "that moves."
        )
    if monitored.level:
        yield (
            f"{format_list(sorted(monitored.level))}: a potential energy is known up to a constant,"
            " so only its change counts; what does not move adds nothing to it."
        )
    try:
        found = call_isolated(
            groups, edited.compiled(), monitored.run, timeout=ORIGINAL_RUN_TIMEOUT
        )
    except Exception:  # without the groups there is no sentence on them
        return
    if len(found) < 2 or edited.monitored:
        return
    text = "; ".join(", ".join(group) for group in found)
    yield (
        f"{len(found)} groups of bodies move without acting on each other in this run, through "
        f"no contact, equality, tendon or actuator: {text}. All of what is monitored of them is "
        f"kept. --watch NAME, with a joint, body, site or sensor of the group that matters, "
        f"leaves the others out."
    )


def mujoco_solvers(case: Case, kind: Kind) -> list[str]:
    """The MuJoCo settings of a run, without the engine's defaults and those with flexes."""
    return [
        s
        for s in case.run[kind].solvers
        if s.partition(":")[0] == NATIVE_ENGINE
        and s != f"{NATIVE_ENGINE}:default"
        and not case.settings.get(s, {}).get("flex")
    ]


def load_sidecars(file: Path) -> Iterator[Case]:
    """The cases in the model's folder that are about it; each file is read in a worker."""
    for path in sorted(file.parent.glob("*.toml")):
        try:
            named = call_isolated(model_of_sidecar, path, timeout=LOADING_SECONDS)
        except tuple(OUTCOME_OF_EXCEPTION):  # then the sidecar counts by its own name
            named = path.stem + ".xml"
        if named == file.name:
            yield load_validated(path, strict=True)


def model_of_sidecar(path: Path) -> str:
    """The model file that a sidecar names; that of its own name if it names none or is broken."""
    own = path.stem + ".xml"
    try:
        return str(tomllib.loads(read_text(path)).get("model", own))
    except (tomllib.TOMLDecodeError, InputError, RecursionError):
        return own


def compile_in_worker(file: Path) -> None:
    """Compile a model without a sidecar in a worker, before it is compiled in this process.

    Raises
    ------
    InputError
        Compiling takes too long or too much memory.
    """
    try:
        call_isolated(accepts_model, file, timeout=COMPILE_TIMEOUT)
    except tuple(OUTCOME_OF_EXCEPTION) as error:
        raise InputError(file, "", f"cannot be compiled: {error}") from None


def accepts_model(file: Path) -> bool:
    """Whether MuJoCo compiles a model; the reason is reported where the model is read."""
    try:
        return compile_model(file) is not None
    except BadModel:
        return False


def monitor_run(case: Case, run: Run, solver: str, edited: EditedModel) -> MonitoredRun:
    """A run of a case, with the allowed changes and errors of its channels.

    A channel may change by a share of the difference between its tolerance and its error, or by
    rounding if it has no tolerance, or an error beyond it.
    """
    before = run_original(case.model_path, edited.compiled(run.rods), run)
    kind = cast(Kind, run.kind)
    reference = call_bounded(case, kind, reference_for, case, kind, before).channels
    sizes = mechanism_sizes(case, kind, before)
    allowed, largest = dict[str, Array](), dict[str, float]()
    for name, curve in before.channels.items():
        tolerance = allowed_error(case, kind, solver, name, sizes, reference[name])
        error = float(np.abs(curve - reference[name]).max())
        allowed_change, rounding = (
            ALLOWED_CHANGE_SHARE * ((tolerance or 0.0) - error),
            CHANNEL_ROUNDING_SHARE * sensor_scale(before, name),
        )
        allowed[name] = np.full(curve.size, max(allowed_change, rounding))
        # a tolerance may be smaller than that rounding, and no option may exceed a tolerance
        largest[name] = error + (
            max(allowed_change, 1e-3 * rounding)
            if tolerance is not None
            else max(ERROR_GROWTH * error, rounding)
        )
    setting = f", {solver.partition(':')[2]}" if ":" in solver else ""
    return MonitoredRun(
        f"{case.name} {run.kind}{setting}",
        run,
        allowed,
        before,
        bound=Bound(run, largest, case=case),
    )


def monitor_free_motion(file: Path, edited: EditedModel, seconds: float) -> MonitoredRun:
    """The free motion of the original model, for some seconds or until it is chaotic.

    It is chaotic from where a nudge of the start pose changes a channel by `CHAOS_SHARE` of its
    size.  A channel may change as much as by the nudge, or by rounding if that is more.
    """
    model = edited.compiled()
    names = [model.key(k).name for k in range(model.nkey)]
    start = "start" if "start" in names else next(iter(names), "")
    steps = max(1, round(seconds / model.opt.timestep))
    stride = max(1, steps // (FREE_MOTION_SAMPLES - 1))
    x = model.opt.timestep * stride * np.arange(max(2, steps // stride + 1))
    run = Run(FREE_MOTION, x, (), start=start)
    level = frozenset(
        model.sensor(s).name
        for s in range(model.nsensor)
        if model.sensor_type[s] == mujoco.mjtSensor.mjSENS_E_POTENTIAL
    )
    before, nudged = (
        with_changes_since_start(
            select_monitored(edited, run_original(file, model, run, *nudge)), level
        )
        for nudge in ((), (NUDGE,))
    )
    if not before.channels:
        raise InputError(file, "", "nothing in it moves and nothing is measured; give it a <joint>")
    grown = {
        name: np.abs(curve - nudged.channels[name]) / sensor_scale(before, name)
        for name, curve in before.channels.items()
    }
    chaotic = np.max(list(grown.values()), axis=0) > CHAOS_SHARE
    n = int(np.argmax(chaotic)) if chaotic.any() else x.size
    if n < min(MIN_RUN_SAMPLES, x.size):
        name = max(grown, key=lambda name: float(grown[name][n]))
        raise InputError(
            file,
            "",
            f"cannot be followed: {name} is lost in rounding after "
            f"{x[n]:.3g} s; give a key that starts further from a collision",
        )
    allowed = {
        name: np.maximum(CHANNEL_ROUNDING_SHARE, np.maximum.accumulate(part[:n]))
        * sensor_scale(before, name)
        for name, part in grown.items()
    }
    return MonitoredRun(
        "let go", replace(run, x=x[:n]), allowed, before, level & before.channels.keys()
    )


def select_monitored(edited: EditedModel, curves: Curves) -> Curves:
    """The curves of the monitored sensors alone."""
    if (sensors := monitored_sensors(edited)) is None:
        return curves
    return replace(
        curves,
        channels={
            name: curve
            for name, curve in curves.channels.items()
            if name.partition("[")[0] in sensors
        },
    )


def with_changes_since_start(curves: Curves, names: Collection[str]) -> Curves:
    """Curves, with the values of some channels replaced by their change since the start."""
    if not names:
        return curves
    return replace(
        curves,
        channels={
            name: curve - curve[0] if name in names else curve
            for name, curve in curves.channels.items()
        },
    )


def with_fine_solution(
    file: Path, edited: EditedModel, monitored: MonitoredRun, error: float | None = None
) -> tuple[MonitoredRun, str]:
    """A free motion with the reference for other options of the engine, and a sentence on it.

    The reference is the fine solution of the same model, with 8 times shorter steps, and
    constraints solved by Newton's method to 1e-14.  If the original model differs from it by a
    tenth of a channel's largest value, nothing is known from there on: then there is no reference,
    and the changes that are allowed for a feature are allowed for an option.  The error of a
    channel may be 1.1 times its error with the model's own options, rounding, or a share `error` of
    its range, whichever is largest.
    """
    model = edited.compiled()
    step, x = model.opt.timestep, monitored.run.x
    stride = max(1, round((x[1] - x[0]) / step))
    thin = 1
    while 2 * thin * stride <= MAX_STEPS_PER_SAMPLE and x.size // (2 * thin) >= MIN_THINNED_SAMPLES:
        thin *= 2
    run = replace(monitored.run, x=x[::thin])
    original = {name: curve[: x.size : thin] for name, curve in monitored.before.channels.items()}
    strict = {
        **FINE_SETTINGS,
        "tolerance": min(1e-14, model.opt.tolerance),
        "iterations": max(100, model.opt.iterations),
    }
    no_reference = (
        "Options may change a channel by no more than a feature may: there is no fine solution "
    )
    try:
        coarse, fine = (
            with_changes_since_start(
                select_monitored(
                    edited,
                    run_original(
                        file, model, replace(run, settings={**strict, "timestep": step / k})
                    ),
                ),
                monitored.level,
            ).channels
            for k in FINE_DIVISORS
        )
    except InputError as wrong:
        return monitored, f"{no_reference}to compare them with: {wrong.wrong}."
    sizes = {name: sensor_scale(monitored.before, name) for name in original}
    deviations = {
        name: np.abs(curve - fine[name]) / sizes[name] for name, curve in original.items()
    }
    chaotic = np.max(list(deviations.values()), axis=0) > CHAOS_SHARE
    if chaotic.any():
        k = int(np.argmax(chaotic))
        name = max(deviations, key=lambda name: float(deviations[name][k]))
        return monitored, (
            f"{no_reference}to compare them with: {name} differs from it by a tenth of its "
            f"size after {number(float(run.x[k]))} s; --seconds ends the run before that."
        )
    allowed, allowed_share = dict[str, float](), error or 0.0
    ranges = {
        name: max(
            float(np.ptp(c))
            for other, c in fine.items()
            if other.partition("[")[0] == name.partition("[")[0]
        )
        for name in original
    }
    for name, size in sizes.items():
        largest = max(
            (1 + ERROR_GROWTH) * float(deviations[name].max()),
            CHANNEL_ROUNDING_SHARE,
            allowed_share * ranges[name] / size,
        )
        if float(np.abs(coarse[name] - fine[name]).max()) / size > largest / 2:
            return monitored, (
                f"{no_reference}to compare them with: {name} still changes between steps of "
                f"{number(step / FINE_DIVISORS[0])} s and {number(step / FINE_DIVISORS[1])} s."
            )
        allowed[name] = largest * size
    return replace(monitored, bound=Bound(run, allowed, fine)), (
        f"Options are compared with the fine solution of the same model, with steps of "
        f"{number(step / FINE_DIVISORS[1])} s and constraints solved by Newton's method to 1e-14, "
        f"over the first {number(float(run.x[-1]))} s: the error of a channel may be 1.1 times "
        f"its error with the model's own options, {number(CHANNEL_ROUNDING_SHARE)} of its size"
        + (
            f" or {number(allowed_share)} of its range, whichever is most."
            if allowed_share
            else ", whichever is more; --error SHARE allows more."
        )
    )


def sensor_scale(curves: Curves, name: str) -> float:
    """Largest value of all channels of a channel's sensor; 1 if all of them are only rounding."""
    sensor = name.partition("[")[0]
    largest = max(
        float(np.abs(v).max()) for n, v in curves.channels.items() if n.partition("[")[0] == sensor
    )
    return largest if largest > CHANNEL_ROUNDING_SHARE else 1.0


def run_original(file: Path, model: mujoco.MjModel, run: Run, nudge: float = 0.0) -> Curves:
    """The curves of the original model in a run.

    Raises
    ------
    InputError
        The run fails.
    """
    found = measure(attempt, model, run, nudge, timeout=ORIGINAL_RUN_TIMEOUT)
    if not isinstance(found, Measurement):
        return found
    if found.outcome == Outcome.NO_START:
        raise InputError(file, "", found.message)
    word = failed_outcome(found)
    raise InputError(file, "", f"as it is, its run {word}: {found.message}; give a model that runs")


def channel_changes(
    monitored: MonitoredRun, curves: Curves, optional: set[str]
) -> dict[str, float]:
    """The change of each channel over the allowed one; up to 1 it counts as no change.

    The change of a channel that is missing is infinite.  If it is `optional`, the channel counts as
    constant instead.
    """
    found = {}
    curves = with_changes_since_start(curves, monitored.level)
    for name, before in monitored.before.channels.items():
        allowed, after = monitored.allowed[name], curves.channels.get(name)
        if after is None and name.partition("[")[0] in optional:
            after = np.full(allowed.size, before[0])
        found[name] = (
            np.inf
            if after is None or after.size != allowed.size
            else float((np.abs(after - before[: allowed.size]) / allowed).max())
        )
    return found


def channel_errors(monitored: MonitoredRun, curves: Curves) -> dict[str, float]:
    """The error of each channel against the reference, over the allowed error."""
    assert monitored.bound is not None
    return monitored.bound.errors(with_changes_since_start(curves, monitored.level))
