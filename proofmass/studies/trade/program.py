"""Write a setting as a snippet to paste, or as a program that runs without proofmass.

A program contains the model, its start state, the motion of its drives, the time steps and the
recorded channels.  To measure its error, an interpreter that does not import proofmass runs it, and
its curves are compared with the reference at the prescribed motion.
"""

import csv
import json
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from proofmass.base.errors import InputError
from proofmass.base.files import write_atomically
from proofmass.base.wording import number
from proofmass.base.worker import TIMER_CODES
from proofmass.case.case import Case
from proofmass.case.drive import motion_source
from proofmass.case.profile import controls_source
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.curves import Curves, drive_columns
from proofmass.sim.protocol.programs import Imposed, sidecar_table
from proofmass.sim.protocol.run import Run
from proofmass.studies.bounded import call_limited
from proofmass.studies.measure import StudyRun, pin_process, relative_errors, reserve_processor
from proofmass.studies.record import Setting
from proofmass.studies.store import Store, digest, digest_of_sources, package_versions, read_json
from proofmass.studies.study import with_references


def snippet(setting: Setting, steps: int, model: Path | None = None) -> str:
    """Text to paste so that an engine runs with a setting.

    Parameters
    ----------
    setting : Setting
        With the parameters as used, those that its engine chooses by itself included.
    steps : int
        Time steps of the run.
    model : path, optional
        The MJCF for which it is meant.  The text then names equalities whose own attributes, or
        those of their class, would override it, with the values to write into them.

    Returns
    -------
    str
        In the form of the engine, such as MJCF or Python, or else a table of the sidecar.
    """
    text = engine_of(setting.engine).programs.write_snippet(setting.parameters, steps, model)
    return text or sidecar_table(setting.engine, setting.parameters)


STEPS_LINE = re.compile(r"^(\d+) steps in (\S+) s", re.MULTILINE)


@dataclass(frozen=True)
class ProgramRun:
    """The result of running a program.

    Attributes
    ----------
    errors : dict of str to float
        Largest error of each kind of channel, as a share of the reference's range [1], with the
        reference at the prescribed motion.
    seconds, steps : float, int
        Processor time of the program's loop [s], and number of time steps.
    failure : str
        Why there are no errors: the last line that the program wrote, or what is wrong with it.
    driven : dict of str to float
        As `errors` [1], with the reference at the motion that the program's drives really had;
        equal to `errors` without drives, empty if the reference does not cover that motion.
    """

    errors: dict[str, float] = field(default_factory=dict)
    seconds: float = float("nan")
    steps: int = 0
    failure: str = ""
    driven: dict[str, float] = field(default_factory=dict)


def drive_ways(case: Case, engine: str) -> Sequence[Imposed]:
    """The ways in which an engine's programs can move a case's drives, the ideal one first."""
    ways = engine_of(engine).programs.imposed
    return ways if case.drive else ways[:1]


def program_text(case: Case, setting: Setting, drive: Imposed, docstring: str = "") -> str:
    """Write the dynamics run of a case with a setting as a program, in a worker.

    Raises
    ------
    Unsupported
        The engine cannot write the program; the message says why.
    InputError, BadModel
        The case or its model has an error.
    """
    return str(call_limited(case, "dynamics", program_text_here, case, setting, drive, docstring))


def program_text_here(case: Case, setting: Setting, drive: Imposed, docstring: str) -> str:
    """The text of `program_text`, written in this process."""
    case, run = setting.apply_to(case, "dynamics")
    motion = motion_source([each.profile for each in run.drives], run.x)
    given = {}
    if run.loads:
        given = {"controls": controls_source([each.profile for each in run.loads], run.x)}
    programs = engine_of(setting.engine).programs
    return programs.write_program(case.model_path, run, motion, docstring, drive, **given)


def run_stored_program(
    case: Case, setting: Setting, drive: Imposed, store: Store, timeout: float
) -> ProgramRun:
    """Run the program of a setting, or read its result from the store."""
    text = program_text(case, setting, drive)
    name = digest(
        json.dumps(
            [
                text,
                case.model_dump(mode="json"),
                package_versions(setting.engine),
                digest_of_sources(),
            ],
            sort_keys=True,
        ).encode()
    )
    file = store.folder / f"{name}.program.json"
    if file.is_file():
        return ProgramRun(**{"seconds": float("nan"), **read_json(file)})
    with reserve_processor() as core:
        (task,) = with_references([StudyRun(case, "dynamics", setting)], store)
        ran = call_limited(
            case, "dynamics", run_program, case, setting, text, timeout, core, task.reference
        )
    known = {key: value for key, value in asdict(ran).items() if value == value}
    if not ran.failure.startswith(TIMED_OUT_PREFIX):
        write_atomically(file, json.dumps(known))
    return ran


TIMED_OUT_PREFIX = "no end after"  # begin of the failure of a program that took too long


def run_program(
    case: Case,
    setting: Setting,
    text: str,
    timeout: float,
    core: int | None = None,
    reference: Path | None = None,
) -> ProgramRun:
    """Run a program in a bare interpreter, and compare its curves with the reference.

    The reference at the prescribed motion is kept in the file `reference`.
    """
    case, run = setting.apply_to(case, "dynamics")
    try:
        curves, seconds, steps = run_bare_program(text, run, timeout, core)
    except NoCurves as why:
        return ProgramRun(failure=str(why))
    at_prescribed_motion = replace(curves, drive=run.motion(run.x)) if run.drives else curves
    errors = relative_errors(case, "dynamics", at_prescribed_motion, reference)
    driven = errors
    if run.drives:
        try:
            driven = relative_errors(case, "dynamics", curves)
        except InputError:  # the reference covers the motion that was asked for, and not this one
            driven = {}
    return ProgramRun(errors, seconds, steps, driven=driven)


class NoCurves(Exception):
    """A program has no curves; the message is the last line that it wrote, or what is wrong."""


BLOCK_PROOFMASS = "import sys; sys.modules['proofmass'] = None"
"""Statement after which `import proofmass` fails; ``-I`` still finds what is installed."""
RUN_FILE = "import runpy; del sys.argv[0]; runpy.run_path(sys.argv[0], run_name='__main__')"


LIMIT_PROCESSOR = "import signal; signal.setitimer(signal.ITIMER_PROF, {:g})"
"""Statement after which the interpreter is ended by a signal after a processor time [s]."""
MAX_WAITING_RATIO = 100.0
"""Ratio of the processor time of a program to its limit of processor time after which it is
ended."""


def bare_command(
    file: Path | str, *arguments: str, processor_seconds: float | None = None
) -> list[str]:
    """The command that runs a program in an interpreter that cannot import proofmass.

    `processor_seconds` limits its processor time [s], where the system can.

    >>> bare_command("run.py", "curves.csv")[4:]
    ['run.py', 'curves.csv']
    """
    before = BLOCK_PROOFMASS
    if processor_seconds and hasattr(signal, "setitimer"):
        before += f"; {LIMIT_PROCESSOR.format(processor_seconds)}"
    return [sys.executable, "-I", "-c", f"{before}; {RUN_FILE}", str(file), *arguments]


def run_bare_program(
    text: str, run: Run, timeout: float, core: int | None = None
) -> tuple[Curves, float, int]:
    """Run a program in a bare interpreter: its curves, processor time of its loop [s], number of
    steps.

    The interpreter cannot import proofmass.

    Raises
    ------
    NoCurves
        The program failed, took too long, or wrote values that are not finite.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.py"
        file.write_text(text, encoding="utf-8")
        try:
            with pin_process(core):
                process = subprocess.run(
                    bare_command(file.name, processor_seconds=timeout),
                    cwd=folder,
                    text=True,
                    capture_output=True,
                    timeout=MAX_WAITING_RATIO * timeout,
                    check=False,
                )
        except subprocess.TimeoutExpired:
            raise NoCurves(
                f"{TIMED_OUT_PREFIX} {MAX_WAITING_RATIO * timeout:g} s of processor time"
            ) from None
        if process.returncode in TIMER_CODES:
            raise NoCurves(f"{TIMED_OUT_PREFIX} {timeout:g} s of processor time")
        if process.returncode or not (printed := STEPS_LINE.search(process.stdout)):
            raise NoCurves(
                (process.stderr.strip().splitlines() or ["it ended without a message"])[-1]
            )
        curves = read_curves(Path(folder) / "curves.csv", run)
    for name, values in curves.channels.items():
        if not np.isfinite(values).all():
            raise NoCurves(f"{name} is not finite")
    return curves, float(printed[2]), int(printed[1])


def read_curves(file: Path, run: Run) -> Curves:
    """The curves that a program wrote, with the state that its drives really had."""
    with file.open(encoding="utf-8", newline="") as stream:
        names = next(csv.reader(stream))
        rows = np.loadtxt(stream, delimiter=",", ndmin=2)
    if not np.allclose(rows[:, 0], run.x, rtol=0.0, atol=1e-9 * np.ptp(run.x)):
        raise ValueError("the program sampled at other times than it was asked to")
    found = dict(zip(names[1:], rows[:, 1:].T, strict=True))
    drives = [[found.pop(name) for name in drive_columns(each.joint)] for each in run.drives]
    value, rate, acceleration = np.array(drives).reshape(-1, 3, len(rows)).swapaxes(0, 1)
    return Curves(run.x, found, drive=(value, rate, acceleration) if drives else None)


def describe_drive(drive: Imposed) -> str:
    """Describe how a drive is moved.

    >>> describe_drive(Imposed("flywheel")), describe_drive(Imposed("servo", 0.5))
    ('a flywheel', 'a servo of gain 0.5')
    """
    article = "an" if drive.kind[0] in "aeiou" else "a"
    gain = f" of gain {number(drive.gain, 2)}" if drive.gain else ""
    return f"{article} {drive.kind}{gain}"
