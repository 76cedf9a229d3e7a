"""Verify a setting: run it again as a program or with its snippet, and from a shifted start.

A setting that was good by chance only, such as at the samples of one run, fails here.
"""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast
from xml.etree import ElementTree

import mujoco
import numpy as np

from proofmass.analytic import planar
from proofmass.base.arrays import Array
from proofmass.base.strict import Kind
from proofmass.base.wording import number
from proofmass.base.worker import TimedOut
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import evaluate
from proofmass.reference.profiles import control_profiles
from proofmass.run.solve import call_engine
from proofmass.sim.engines import engine_of
from proofmass.sim.mjcf import read_spec, read_tree
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.programs import Imposed
from proofmass.sim.protocol.run import Run
from proofmass.studies import DEFAULT_LONGEST_RUN
from proofmass.studies.bounded import call_limited
from proofmass.studies.measure import REFERENCE_TIMEOUT, StudyRun, relative_errors
from proofmass.studies.record import NAN, ParameterValue, Setting, StudyRow
from proofmass.studies.store import Store, task_key
from proofmass.studies.study import Study
from proofmass.studies.trade.program import (
    ProgramRun,
    describe_drive,
    drive_ways,
    run_stored_program,
)
from proofmass.verdict.outcome import OUTCOME_OF_EXCEPTION

RUN_ERRORS: tuple[type[Exception], ...] = (BadModel, *OUTCOME_OF_EXCEPTION)
"""Exceptions that a run may raise."""
SAMPLE_SHIFT = 0.381966
"""Shift of samples, over their distance; irrational, so that no steps coincide."""


@dataclass(frozen=True)
class Check:
    """The result of running a setting again: as a program, and from a shifted start.

    Attributes
    ----------
    fresh, shifted : float
        Errors of the run as a program and of that from a shifted start, as shares of the
        reference's range [1]; NaN for a run without a result.
    note : str
        Reason why there is no shifted start.
    used : Setting
        The setting as used, with the parameters that the engine chose by itself.
    ran : ProgramRun or None
        The result of the program; None if there is no program, and the setting was run with its
        snippet instead.
    drive : Imposed or None
        How the program moves its drives.
    others : tuple of (Imposed, ProgramRun)
        Each other way to move the drives, with its best gain and the result.
    reason : str
        Reason why there is no program.
    again : bool
        Whether the setting was run from a shifted start, which needs a first run that is good
        enough.
    failed : str
        Reason why the run from the shifted start has no result.
    """

    fresh: float
    shifted: float
    note: str
    used: Setting
    ran: ProgramRun | None = None
    drive: Imposed | None = None
    others: tuple[tuple[Imposed, ProgramRun], ...] = ()
    reason: str = ""
    again: bool = True
    failed: str = ""

    def holds(self, wanted: float) -> bool:
        """Whether the errors of both runs are small enough; the second one if it is possible."""
        return self.fresh <= wanted and (bool(self.note) or self.shifted <= wanted)

    @property
    def words(self) -> str:
        """Describe the results of both runs."""
        how = f", its drive moved by {describe_drive(self.drive)}" if self.drive else ""
        if self.ran is None:
            first = f"run again with the lines below {number(self.fresh, 2)} off"
            first += f" (no program: {self.reason})" if self.reason else ""
        elif self.ran.failure:
            first = f"as a program{how}: {self.ran.failure}"
        else:
            first = (
                f"as a program that runs by itself{how}: {number(self.fresh, 2)} off in "
                f"{number(self.ran.seconds, 2)} s"
            )
        if self.note:
            return f"{first}; from a shifted start: {self.note}"
        if self.failed:
            return f"{first}; from a shifted start: {self.failed}"
        if not self.again:
            return first
        return f"{first}; {number(self.shifted, 2)} from a shifted start"

    def describe_other_drives(self, error_kind: str, wanted: float) -> list[str]:
        """Sentences on the results of other ways to move the drives."""
        texts = []
        for drive, ran in self.others:
            if ran.failure:
                texts.append(f"its drive moved by {describe_drive(drive)} instead: {ran.failure}")
                continue
            error = ran.errors.get(error_kind, NAN)
            verdict = "" if error <= wanted else ", not good enough"
            texts.append(
                f"its drive moved by {describe_drive(drive)} instead: {number(error, 2)} off "
                f"in {number(ran.seconds, 2)} s{verdict}"
            )
        return texts


def verify(
    case: Case,
    kind: Kind,
    row: StudyRow,
    error_kind: str,
    wanted: float,
    study: Study | None = None,
    drive: str = "",
    compare: bool = False,
) -> Check:
    """Run a setting again, as a program and from a shifted start; errors of failed runs are NaN.

    Parameters
    ----------
    case, kind : Case, {"sweep", "dynamics", "equilibrium"}
        The case, and which of its runs.
    row : StudyRow
        A setting of that run, as it was measured.
    error_kind : str
        Kind of error, such as position.
    wanted : float
        Largest error that is good enough, as a share of the reference's range [1].
    study : Study, optional
        Where results are kept, and the processor time after which a program is ended; results are
        not kept if it is not given.
    drive : str, optional
        How the program moves its drives, in the engine's words; the ideal way if not given.
    compare : bool
        Whether other ways to move the drives are tried as well, if the first is good enough.
    """
    setting = Setting(row.engine, row.parameters)
    check = Check(NAN, NAN, "", setting)
    try:
        if kind == "dynamics":
            check = run_as_program(case, setting, row, error_kind, study, drive)
        else:
            error, used = call_limited(
                case, kind, rerun_setting, case, kind, setting, row.steps, error_kind
            )
            check = Check(error, NAN, "", used)
    except Unsupported as error:
        check = replace(check, note=str(error))
    except RUN_ERRORS:
        pass
    if check.fresh <= wanted:
        shifted, note, failed = stored_shifted_error(case, kind, check.used, error_kind, study)
        check = replace(check, shifted=shifted, note=note, failed=failed)
    else:
        check = replace(check, again=False)
    if compare and check.drive and check.holds(wanted) and not drive:
        others = try_other_drives(case, check, error_kind, study)
        check = replace(check, others=tuple(others))
    return check


def stored_shifted_error(
    case: Case, kind: Kind, setting: Setting, error_kind: str, study: Study | None
) -> tuple[float, str, str]:
    """Error from a shifted start, reason why there is no such start, reason why its run failed.

    The results are read from the store if they are there.  A run that took too long is not stored,
    since another call may allow more time.
    """
    min_timeout = REFERENCE_TIMEOUT if kind == "dynamics" and not case.drive else 0.0

    def make() -> tuple[float | None, str, str]:
        try:
            error = float(
                call_limited(
                    case, kind, shifted_error, case, kind, setting, error_kind, least=min_timeout
                )
            )
            return (error, "", "") if error == error else (None, "", "not finite")
        except Unsupported as error:
            return None, str(error), ""
        except TimedOut:
            raise
        except RUN_ERRORS as error:
            return None, "", str(error)

    try:
        if study is None:
            found, note, failed = make()
        else:
            key = task_key(StudyRun(case, kind, setting))
            found, note, failed = study.store.value(f"{key}.{error_kind}.shifted.json", make)
    except TimedOut as error:
        return NAN, "", str(error)
    return (NAN if found is None else found), note, failed


def run_as_program(
    case: Case,
    setting: Setting,
    row: StudyRow,
    error_kind: str,
    study: Study | None,
    drive: str = "",
) -> Check:
    """Run a setting as a program, with the gain of its drive that gives the least error."""
    ways = drive_ways(case, setting.engine)
    known = list(dict.fromkeys(one.kind for one in ways))
    if drive and drive not in known:
        raise ValueError(f"--drive {drive}: {setting.engine} has {', '.join(known)}")
    ways = [one for one in ways if one.kind == (drive or known[0])]
    used = setting_as_used(case, setting)
    try:
        ran = [run_with_drive(case, used, one, study) for one in ways]
    except Unsupported as error:
        error_again, used = call_limited(
            case, "dynamics", rerun_setting, case, "dynamics", setting, row.steps, error_kind
        )
        return Check(error_again, NAN, "", used, reason=str(error))
    best = min(range(len(ran)), key=lambda k: error_or_inf(ran[k], error_kind))
    return Check(
        ran[best].errors.get(error_kind, NAN),
        NAN,
        "",
        used,
        ran[best],
        ways[best] if case.drive else None,
    )


def try_other_drives(
    case: Case, check: Check, error_kind: str, study: Study | None
) -> list[tuple[Imposed, ProgramRun]]:
    """For each other way to move the drives the best gain, and the result of its program."""
    found: dict[str, tuple[Imposed, ProgramRun]] = {}
    for one in drive_ways(case, check.used.engine):
        if check.drive and one.kind == check.drive.kind:
            continue
        try:
            ran = run_with_drive(case, check.used, one, study)
        except Unsupported as error:
            ran = ProgramRun(failure=str(error))
        if one.kind not in found or error_or_inf(ran, error_kind) < error_or_inf(
            found[one.kind][1], error_kind
        ):
            found[one.kind] = one, ran
    return list(found.values())


def run_with_drive(case: Case, setting: Setting, drive: Imposed, study: Study | None) -> ProgramRun:
    """Run the program of a setting, with a store in a temporary folder if there is no study."""
    if study is not None:
        longest = study.longest or DEFAULT_LONGEST_RUN
        return run_stored_program(case, setting, drive, study.store, longest)
    with tempfile.TemporaryDirectory() as folder:
        return run_stored_program(case, setting, drive, Store(Path(folder)), DEFAULT_LONGEST_RUN)


def error_or_inf(ran: ProgramRun, error_kind: str) -> float:
    """The error of a program; infinite if it has none."""
    error = ran.errors.get(error_kind, NAN)
    return error if error == error else np.inf


def setting_as_used(case: Case, setting: Setting) -> Setting:
    """A setting with the step that is really taken, and what its engine chooses by itself."""
    return cast(Setting, call_limited(case, "dynamics", setting_as_used_here, case, setting))


def setting_as_used_here(case: Case, setting: Setting) -> Setting:
    """The result of `setting_as_used`, computed in this process."""
    changed, run = setting.apply_to(case, "dynamics")
    if engine_of(setting.engine).chooses == ("timestep",):  # it is known without a run
        step = float(str(setting.parameters.get("timestep", compiled_model(changed).opt.timestep)))
        return setting.with_parameters(timestep=run.steps(step)[1])
    return setting.with_parameters(
        **chosen_parameters(call_engine(setting.engine, changed.model_path, run), setting)
    )


def rerun_setting(
    case: Case, kind: Kind, setting: Setting, steps: int, error_kind: str
) -> tuple[float, Setting]:
    """Run a setting again: its error, and the setting as it was used."""
    curves, used = run_fresh(case, kind, setting, steps)
    return largest_error(setting.apply_to(case, kind)[0], kind, curves, error_kind), used


def shifted_error(case: Case, kind: Kind, setting: Setting, error_kind: str) -> float:
    """Run a setting from a shifted start: its error."""
    curves = run_shifted(case, kind, setting)
    return largest_error(setting.apply_to(case, kind)[0], kind, curves, error_kind)


def run_fresh(case: Case, kind: Kind, setting: Setting, steps: int) -> tuple[Curves, Setting]:
    """Run a setting again, with its snippet in the model if it is MJCF: curves, setting as used."""
    case, run = setting.apply_to(case, kind)
    pasted_model = engine_of(setting.engine).programs.insert_snippet(
        case.model_path, setting.parameters, steps
    )
    if pasted_model:
        text, stated = pasted_model
        run = replace(run, settings={k: v for k, v in run.settings.items() if k not in stated})
        curves = run_model_text(text, case, run, setting.engine)
    else:
        curves = call_engine(setting.engine, case.model_path, run)
    return curves, setting.with_parameters(
        **chosen_parameters(curves, setting)
    ) if kind == "dynamics" else setting


def run_shifted(case: Case, kind: Kind, setting: Setting) -> Curves:
    """Run a setting with all samples, also the start, moved by a part of a sample on the motion.

    A driven motion follows its motion profile; a free motion starts from the pose and rates that
    the general planar solver finds there.  Neither gives the shapes of rods in dynamics, since a
    key can only start them in an arc.

    Raises
    ------
    Unsupported
        There is no other start; the message says why.
    """
    case, run = setting.apply_to(case, kind)
    if kind == "equilibrium":
        raise Unsupported("an equilibrium has one start")
    if case.rod and kind == "dynamics":
        raise Unsupported(
            "rods start in the arcs that the model's key gives them, not with the bends and rates "
            "that this motion has at a later time"
        )
    if case.recorded:
        raise Unsupported("the reference is a recorded curve, known at its samples only")
    later = replace(run, x=run.x[:-1] + SAMPLE_SHIFT * np.diff(run.x))
    if run.drives:
        return call_engine(setting.engine, case.model_path, later)
    text = model_text_at(case, float(later.x[0] - run.x[0]))
    return run_model_text(text, case, later, setting.engine)


def largest_error(case: Case, kind: Kind, curves: Curves, error_kind: str) -> float:
    """Largest error of a kind, as a share of the range [1]; NaN if the curves have none."""
    if curves.stopped or not all(np.isfinite(part).all() for part in curves.channels.values()):
        return np.nan
    if curves.drive is None and kind == "dynamics" and curves.x[0] > 0.0:
        curves = with_reference_start(case, kind, curves)
    return relative_errors(case, kind, curves).get(error_kind, np.nan)


def with_reference_start(case: Case, kind: Kind, curves: Curves) -> Curves:
    """Curves of a free motion that starts later, with the reference's start at time 0 before them.

    The general planar solver takes the first time of the curves as that of the start pose.
    """
    reference = evaluate(case, kind, np.array([0.0, curves.x[0]]), None).channels
    return replace(
        curves,
        x=np.append(0.0, curves.x),
        channels={
            name: np.append(reference[name][0], values) for name, values in curves.channels.items()
        },
    )


def chosen_parameters(curves: Curves, setting: Setting) -> dict[str, ParameterValue]:
    """Parameters that an engine chose itself or fitted to the samples in a run."""
    return {
        name: value
        for name in engine_of(setting.engine).chooses
        if isinstance(value := curves.settings.get(name), (int, float))
    }


def run_model_text(text: str, case: Case, run: Run, engine: str) -> Curves:
    """Run a changed model, given as the text of its MJCF."""
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / case.model_path.name
        model.write_text(text, encoding="utf-8")
        return call_engine(engine, model, run)


def model_text_at(case: Case, time: float) -> str:
    """Text of the model with its start key moved to the state of its free motion at a time [s]."""
    root = read_tree(case.model_path)
    key = root.find(f"./keyframe/key[@name='{case.start}']")
    if key is None:
        raise Unsupported(f"no key {case.start!r} in the file itself")
    for name, values in zip(("qpos", "qvel"), state_at(case, time), strict=True):
        key.set(name, " ".join(map(repr, values.tolist())))
    return ElementTree.tostring(root, encoding="unicode")


def state_at(case: Case, time: float) -> tuple[Array, Array]:
    """Positions and rates of all joints of a free planar motion at a time [s]."""
    spec = read_spec(case.model_path)
    kinds = {
        "jointpos": mujoco.mjtSensor.mjSENS_JOINTPOS,
        "jointvel": mujoco.mjtSensor.mjSENS_JOINTVEL,
    }
    for joint in spec.joints:
        if joint.type in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            raise Unsupported(
                f"the joint {joint.name!r} moves in space; "
                "a shifted start is known for planar motions only"
            )
        for word, sensor in kinds.items():
            spec.add_sensor(
                name=f"{word} {joint.name}",
                type=sensor,
                objname=joint.name,
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
            )
    try:
        found = planar.solve(
            np.array([0.0, time]),
            model=spec.compile(),
            start=case.start,
            control_profiles=control_profiles(case, "dynamics"),
        )
    except (TypeError, ValueError) as error:
        raise Unsupported(f"no other start of this free motion is known: {error}") from None
    position, rate = (
        np.array([found[f"{word} {joint.name}"][-1] for joint in spec.joints]) for word in kinds
    )
    return position, rate
