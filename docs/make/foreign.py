"""Verdicts of models without a sidecar, for MJCF files of other projects and folders of them.

    python -m docs.make.foreign PATH ... [-o FILE] [--quick]

For each file that MuJoCo compiles, the verdict of `proofmass check` is printed, and a table of all
files is written into FILE.  The time until which a motion is self-consistent is checked by another
method: RK4 with 1/32 of the model's step, in MuJoCo alone.  Until this time it must stay within
twice the distance that is allowed between two ways.
"""

import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks import command
from proofmass.base.wording import number
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut, call_isolated
from proofmass.batch.check import OWN_MODEL_TIMEOUT
from proofmass.batch.work import OWN_MODEL_SAMPLES, OWN_MODEL_SECONDS
from proofmass.reference.self_consistency import (
    AGREEMENT_SHARE,
    PROCESSOR_SECONDS,
    Rung,
    format_length,
    why_failed,
)
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.own_equations import OwnMotion

STEP_RATIO = 32  # the model's step over that of the other method
TIME_LIMIT = 40.0
"""Wall time of the other method [s]."""
BALL = '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
COLUMNS = (
    *("model", "outcome", "known until [s]", "own error", "uncertainty"),
    *("growth of a disturbance", "change if stiffer", "RK4 agrees until [s]", "wall [s]"),
)
HEAD = f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|\n"


@dataclass(frozen=True)
class Report:
    """The verdict of a model: cells of its row, a sentence, and whether RK4 agrees until T."""

    cells: tuple[str, ...]
    words: str
    agrees: bool | None = None


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("paths", type=Path, nargs="*")
    parser.add_argument("-o", dest="file", type=Path, help="where the table is written")
    given = parser.parse_args(argv)
    if given.quick:
        with TemporaryDirectory() as folder:
            file = Path(folder) / "ball.xml"
            file.write_text(BALL)
            print("".join(table([(file.name, report_in_worker(file))])))
        return
    files = {
        file: str(file.relative_to(path)) if path.is_dir() else file.stem
        for path in given.paths
        for file in (sorted(path.rglob("*.xml")) if path.is_dir() else [path])
    }
    if not files:
        parser.error("give MJCF files, or folders of them")
    with ThreadPoolExecutor(2) as pool:
        found = []
        for file, report in zip(files, pool.map(report_in_worker, files), strict=True):
            found.append((files[file], report))
            line = f"{files[file]}: {' | '.join(report.cells)}"
            print(f"{line}\n    {report.words}", file=sys.stderr)
    text = "".join(table(found))
    print(text)
    if given.file:
        given.file.write_text(text, encoding="utf-8")


def table(found: Sequence[tuple[str, Report]]) -> Iterator[str]:
    """The table with a row for each model, below the numbers of models of each kind."""
    compiled = [report for _, report in found if report.cells[0] != "does not compile"]
    answered = [report for report in compiled if report.agrees is not None]
    known = sum(report.cells[0] == "self-consistent" for report in compiled)
    agreeing = sum(bool(report.agrees) for report in answered)
    yield f"{len(compiled)} of {len(found)} files compile, and {known} of these are "
    yield f"self-consistent for some time. RK4 agrees until then in {agreeing} of the "
    yield f"{len(answered)} models for which it gave an answer in time.\n\n{HEAD}"
    for name, report in found:
        yield f"| {name} | {' | '.join(report.cells)} |\n"


def report_in_worker(file: Path) -> Report:
    """The verdict of a model, computed in a worker."""
    from docs.make.foreign import report_here  # a worker does not know this module as __main__

    began = time.perf_counter()
    try:
        return call_isolated(report_here, file, timeout=OWN_MODEL_TIMEOUT + 2 * TIME_LIMIT)
    except BadModel as error:
        return Report(("does not compile", *7 * ("",)), str(error)[:200])
    except (Crashed, TimedOut, OutOfMemory) as error:
        seconds = number(time.perf_counter() - began, 2)
        return Report((type(error).__name__, *6 * ("",), seconds), str(error))
    except Exception as error:  # a fault of proofmass must not end the run
        return Report((f"fault: {type(error).__name__}", *7 * ("",)), str(error))


def report_here(file: Path) -> Report:
    """The verdict of a model, computed in this process."""
    began = time.perf_counter()
    motion = engine_of("mujoco").own_equations.solve_motion(
        file, OWN_MODEL_SECONDS, OWN_MODEL_SAMPLES, PROCESSOR_SECONDS
    )
    seconds = number(time.perf_counter() - began, 2)
    if failed := why_failed(motion):
        return Report(("diverged", *6 * ("",), seconds), failed)
    rung = Rung(motion)
    grown = number(rung.growth, 2)
    if not rung.consistent:
        return Report(("unchecked", *3 * ("",), grown, "", "", seconds), rung.words())
    agreed = agrees_until(file, motion, rung) if motion.dof else None
    cells = (
        "self-consistent",
        number(rung.until, 3),
        format_length(rung.error(motion.runs[0])),
        format_length(rung.known),
        grown,
        "" if np.isnan(rung.softness) else format_length(rung.softness),
        "" if agreed is None else number(agreed, 3),
        seconds,
    )
    return Report(cells, rung.words(), None if agreed is None else agreed >= rung.until)


def agrees_until(file: Path, motion: OwnMotion, rung: Rung) -> float | None:
    """Time [s] until which RK4 with a small step, in MuJoCo alone, agrees with the best way.

    None if RK4 takes too long.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    if model.nkey:
        key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, "start")
        mujoco.mj_resetDataKeyframe(model, data, max(0, key))
    per_sample = round(float(motion.times[1]) / model.opt.timestep) * STEP_RATIO
    model.opt.timestep /= STEP_RATIO
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    # Sleep depends on the number of steps.
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    moving = model.body_weldid[: model.nbody] > 0
    began, until = time.perf_counter(), 0.0
    for k in range(rung.last + 1):
        for _ in range(per_sample if k else 0):
            mujoco.mj_step(model, data)
            if time.perf_counter() - began > TIME_LIMIT:
                return None
        mujoco.mj_kinematics(model, data)
        centres = rung.best.points[k, :, 0]
        off = np.linalg.norm(data.xipos[moving] - centres, axis=-1).max(initial=0.0)
        if not off <= 2 * AGREEMENT_SHARE * rung.sizes[k]:
            return until
        until = float(motion.times[k])
    return until


if __name__ == "__main__":
    main()
