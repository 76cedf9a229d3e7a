"""How far the motions of anybody's models are known: rungs of MJCF files and folders of them.

    python -m benchmarks.foreign PATH ... [-o FILE] [--quick]

For each file that MuJoCo compiles it prints what `proofmass check` says of a model without a
sidecar, and writes a table of them into FILE.  The time until which a motion is known is tried
with a method that was not asked for it: RK4 with 1/32 of the model's step, in MuJoCo alone, must
stay until then within twice what two ways may differ by.
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
from proofmass.check import FOLLOWED, OWN_TIMEOUT, SAMPLES
from proofmass.engines import engine_of
from proofmass.self_consistency import PROCESSOR, WITHIN, Rung, format_length, why_failed
from proofmass.sim.protocol import BadModel, OwnMotion
from proofmass.wording import number
from proofmass.worker import Crashed, OutOfMemory, TimedOut, isolated

FINER = 32
TRIED = 40.0
"""Wall time of the other method [s]."""
BALL = '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
COLUMNS = (
    *("model", "outcome", "known until [s]", "as it is, off by", "known to"),
    *("a disturbance grows", "stiffer moves it by", "RK4 agrees until [s]", "wall [s]"),
)
HEAD = f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|\n"


@dataclass(frozen=True)
class Told:
    """What is told of a model: cells of its row, its words, and whether RK4 agrees until T."""

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
            print("".join(table([(file.name, look(file))])))
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
        for file, told in zip(files, pool.map(look, files), strict=True):
            found.append((files[file], told))
            print(f"{found[-1][0]}: {' | '.join(told.cells)}\n    {told.words}", file=sys.stderr)
    text = "".join(table(found))
    print(text)
    if given.file:
        given.file.write_text(text, encoding="utf-8")


def table(found: Sequence[tuple[str, Told]]) -> Iterator[str]:
    """All rows, and how many there are of each kind."""
    compiled = [told for _, told in found if told.cells[0] != "does not compile"]
    asked = [told for told in compiled if told.agrees is not None]
    known = sum(told.cells[0] == "self-consistent" for told in compiled)
    yield f"{len(compiled)} of {len(found)} compile, {known} of these are self-consistent for some "
    yield f"time. RK4 agrees until then in {sum(bool(told.agrees) for told in asked)} of the "
    yield f"{len(asked)} that it could be asked of.\n\n{HEAD}"
    for name, told in found:
        yield f"| {name} | {' | '.join(told.cells)} |\n"


def look(file: Path) -> Told:
    """What is told of a model, in a worker."""
    from benchmarks.foreign import told_here  # a worker does not know this module as __main__

    began = time.perf_counter()
    try:
        return isolated(told_here, file, timeout=OWN_TIMEOUT + 2 * TRIED)
    except BadModel as error:
        return Told(("does not compile", *7 * ("",)), str(error)[:200])
    except (Crashed, TimedOut, OutOfMemory) as error:
        seconds = number(time.perf_counter() - began, 2)
        return Told((type(error).__name__, *6 * ("",), seconds), str(error))
    except Exception as error:  # a fault of ours, which must not cost the other models
        return Told((f"fault: {type(error).__name__}", *7 * ("",)), str(error))


def told_here(file: Path) -> Told:
    """What is told of a model, in this process."""
    began = time.perf_counter()
    motion = engine_of("mujoco").own_motion(file, FOLLOWED, SAMPLES, PROCESSOR)
    seconds = number(time.perf_counter() - began, 2)
    if failed := why_failed(motion):
        return Told(("diverged", *6 * ("",), seconds), failed)
    rung = Rung(motion)
    grown = number(rung.growth, 2)
    if not rung.consistent:
        return Told(("unchecked", *3 * ("",), grown, "", "", seconds), rung.words())
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
    return Told(cells, rung.words(), None if agreed is None else agreed >= rung.until)


def agrees_until(file: Path, motion: OwnMotion, rung: Rung) -> float | None:
    """Until when RK4 with a small step, in MuJoCo alone, is where the best way is [s].

    None where it takes too long.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    if model.nkey:
        key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, "start")
        mujoco.mj_resetDataKeyframe(model, data, max(0, key))
    per_sample = round(float(motion.times[1]) / model.opt.timestep) * FINER
    model.opt.timestep /= FINER
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # which counts steps
    moving = model.body_weldid[: model.nbody] > 0
    began, until = time.perf_counter(), 0.0
    for k in range(rung.last + 1):
        for _ in range(per_sample if k else 0):
            mujoco.mj_step(model, data)
            if time.perf_counter() - began > TRIED:
                return None
        mujoco.mj_kinematics(model, data)
        centres = rung.best.points[k, :, 0]
        off = np.linalg.norm(data.xipos[moving] - centres, axis=-1).max(initial=0.0)
        if not off <= 2 * WITHIN * rung.sizes[k]:
            return until
        until = float(motion.times[k])
    return until


if __name__ == "__main__":
    main()
