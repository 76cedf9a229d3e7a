"""Random settings that are compared with a chosen one, in search of a cheaper one.

Every setting is written as a program and run in this process, which has the engines loaded.  The
error is that of the curves in the program's file, by the references `examples.chosen.truths`.
"""

import io
import random
import signal
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from math import ceil, inf
from pathlib import Path
from statistics import median
from types import FrameType

import mujoco

from examples.chosen import truths
from proofmass.case.case import Case
from proofmass.reference.samples import run_samples
from proofmass.sim.mujoco.tried_settings import INTEGRATORS
from proofmass.sim.protocol.programs import Imposed
from proofmass.studies.record import ParameterValue, Setting
from proofmass.studies.trade.program import STEPS_LINE, drive_ways, program_text_here

MAX_RATIO_OF_STEPS = 8.0  # to those of the chosen setting: none with more steps is cheaper
MAX_RATIO_OF_TIME = 2.0  # to the wall time of the chosen setting, after which a run is ended
ROUNDS = 7  # interleaved, of which the shortest time counts
FINALISTS = 4  # number of cheapest settings that are timed once more, in pairs
OVERHEAD = 0.1  # time [s] of a run that is not spent in steps: the model, the file


@dataclass(frozen=True)
class Rival:
    """A setting that is as good as the chosen one, and its wall time over that of the chosen."""

    setting: Setting
    drive: Imposed
    error: float
    ratio: float


@dataclass(frozen=True)
class Duel:
    """The comparison of random settings with the chosen one.

    Attributes
    ----------
    error : float
        Error of the chosen setting.
    tried, ran, good : int
        Numbers of settings: all, those that ran to their end in time, and those as good.
    best : Rival or None
        The cheapest one that was as good.
    """

    error: float
    tried: int
    ran: int
    good: int
    best: Rival | None


class Late(BaseException):
    """A random setting takes too long."""


def duel(
    case: Case,
    name: str,
    of: str,
    chosen: Setting,
    drive: Imposed,
    count: int,
    seed: int,
    rounds: int = ROUNDS,
) -> Duel:
    """Compare random settings of the same engine with the chosen one.

    Half of them are drawn from all settings, half differ in one to three parameters.
    """
    dice = random.Random(seed)
    times = run_samples(case, "dynamics")
    sample = float(times[1] - times[0])
    own = compile_program(case, chosen, drive)
    error, seconds = run_program(own, name, of, inf)
    seconds = min(seconds, run_program(own, name, of, inf)[1])
    good, done = list[tuple[Setting, Imposed, object, float]](), 0
    ways = [one for one in drive_ways(case, chosen.engine) if one.kind == drive.kind]
    for k in range(count):
        changes = None if k % 2 else dice.randint(1, 3)
        far = draw_setting(chosen.engine, sample, chosen, dice, changes)
        way = dice.choice(ways)
        rival = compile_program(case, far, way)
        off, spent = run_program(rival, name, of, MAX_RATIO_OF_TIME * seconds)
        done += spent < inf
        if off <= error:
            good.append((far, way, rival, off))
    found = len(good)
    least = [inf] * len(good)
    for _ in range(rounds):
        for k, (_, _, rival, _) in enumerate(good):
            least[k] = min(least[k], run_program(rival, name, of, inf)[1])
    first = sorted(range(len(good)), key=least.__getitem__)[:FINALISTS]
    # The least of many times is too low.  Therefore the cheapest are timed again, in pairs.
    ratios = {k: ratio([own, good[k][2]], name, of, 3 * rounds) for k in first}
    if not ratios:
        return Duel(error, count, done, found, None)
    k = min(first, key=ratios.__getitem__)
    return Duel(error, count, done, found, Rival(good[k][0], good[k][1], good[k][3], ratios[k]))


def ratio(codes: Sequence[object], name: str, of: str, rounds: int) -> float:
    """Wall time of the second of two programs over that of the first: the median of pairs.

    Each goes first in every other pair, so that both are affected alike by disturbances of the
    machine and by an advantage of the second run of a pair.
    """
    found = []
    for n in range(rounds):
        spent = [run_program(one, name, of, inf)[1] for one in (codes if n % 2 else codes[::-1])]
        found.append(spent[1] / spent[0] if n % 2 else spent[0] / spent[1])
    return median(found)


def draw_setting(
    engine: str, sample: float, chosen: Setting, dice: random.Random, changes: int | None
) -> Setting:
    """A random setting; or the chosen one with `changes` parameters changed."""

    def logarithmic(low: float, high: float) -> float:
        return float(low * (high / low) ** dice.random())

    base = dict(chosen.parameters)
    step = float(base["timestep"])  # type: ignore[arg-type]
    count = max(1, round(sample / step))
    max_count = MAX_RATIO_OF_STEPS * count if changes is None else 2 * count
    step = (
        sample / ceil(logarithmic(0.4 * count, max_count))
        if count > 1 or changes is None
        else (sample / dice.choice((1, 1, 2)))
    )
    if engine == "pymunk":
        iterations = round(logarithmic(1, 300))
        if changes is not None:
            iterations = max(1, round(int(str(base["iterations"])) * logarithmic(0.3, 1.5)))
        drawn: dict[str, ParameterValue] = {
            "iterations": iterations,
            "error_bias": 0.0 if dice.random() < 0.5 else logarithmic(1e-12, 0.9),
        }
    else:
        soft, ratio = logarithmic(1.0, 30.0), dice.choice((1.0, logarithmic(0.3, 3.0)))
        d = 1 - logarithmic(1e-4, 0.3)
        drawn = {
            "integrator": dice.choice(INTEGRATORS),
            "solref": (soft * step, ratio),
            "solimp": (d, d, 0.001),
            "solver": dice.choice(("newton", "cg", "pgs")),
            "iterations": round(logarithmic(1, 100)),
            "tolerance": dice.choice((0.0, logarithmic(1e-14, 1e-2))),
        }
    if changes is None:
        return Setting(engine, {"timestep": step, **drawn})
    names = dice.sample(sorted(["timestep", *drawn]), min(changes, len(drawn) + 1))
    kept = {k: v for k, v in base.items() if k not in ("defaults",)}
    if "timestep" in names and isinstance(solref := kept.get("solref"), tuple):
        kept["solref"] = (float(solref[0]) * step / float(str(kept["timestep"])), *solref[1:])
    changed = {name: {"timestep": step, **drawn}[name] for name in names}
    return Setting(engine, {**kept, **changed})


def compile_program(case: Case, setting: Setting, drive: Imposed) -> object:
    """The program of a setting, compiled."""
    return compile(program_text_here(case, setting, drive, ""), "rival.py", "exec")


def run_program(code: object, name: str, of: str, longest: float) -> tuple[float, float]:
    """Error and wall time of a program; infinite if it fails or takes too long."""
    output, space = io.StringIO(), dict[str, object](__name__="rival")
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "curves.csv")
        try:
            with redirect_stdout(output), alarm(longest + OVERHEAD):
                exec(code, space)  # type: ignore[arg-type]
                space["main"](file)  # type: ignore[operator]
        except (SystemExit, Late, ValueError, ArithmeticError):
            return inf, inf
        finally:
            mujoco.set_mjcb_control(None)  # set by the servo of a program that was ended
        found = STEPS_LINE.search(output.getvalue())
        assert found
        error = truths.errors(name, file)[of]
        return (error if error == error else inf), float(found[2])


@contextmanager
def alarm(seconds: float) -> Iterator[None]:
    """Raise `Late` if the context takes more than a CPU time [s] of this process."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise Late

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, 0 if seconds == inf else seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
