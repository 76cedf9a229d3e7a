"""Random settings beside a chosen one: is any of them as good and cheaper?

Every setting is written as a program and run in this process, which has the engines loaded; the
error is that of the curves in its file, against `examples.chosen.truths`.
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
from proofmass.case import Case
from proofmass.reference import grid
from proofmass.sim.mujoco.tried_settings import INTEGRATORS
from proofmass.sim.protocol import Imposed
from proofmass.studies.record import ParameterValue, Setting
from proofmass.studies.trade.program import PRINTED, imposed, written

MORE_STEPS = 8.0  # than the chosen setting has, at most: none of them is cheaper
LONGEST = 2.0  # times the chosen setting's wall time, after which a rival is no rival
ROUNDS = 7  # interleaved, of which the least counts
FINALISTS = 4  # the cheapest, timed once more, in pairs
SPARE = 0.1  # s of a run that are no steps: the model, the file


@dataclass(frozen=True)
class Rival:
    """A setting that is as good as the chosen one, and its wall time over that of the chosen."""

    setting: Setting
    drive: Imposed
    error: float
    ratio: float


@dataclass(frozen=True)
class Duel:
    """What random settings are beside the chosen one.

    Attributes
    ----------
    error : float
        Of the chosen one.
    tried, ran, good : int
        Settings, those that ran to their end in time, and those that were as good.
    best : Rival or None
        The cheapest that was as good.
    """

    error: float
    tried: int
    ran: int
    good: int
    best: Rival | None


class Late(BaseException):
    """A rival takes longer than the chosen setting."""


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
    """Run random settings of the chosen one's engine beside it.

    Half of them are drawn from everything, half have one to three parameters that differ.
    """
    dice = random.Random(seed)
    times = grid(case, "dynamics")
    sample = float(times[1] - times[0])
    own = prepared(case, chosen, drive)
    error, seconds = ran(own, name, of, inf)
    seconds = min(seconds, ran(own, name, of, inf)[1])
    good, done = list[tuple[Setting, Imposed, object, float]](), 0
    ways = [one for one in imposed(case, chosen.engine) if one.kind == drive.kind]
    for k in range(count):
        far = randomly(chosen.engine, sample, chosen, dice, None if k % 2 else dice.randint(1, 3))
        way = dice.choice(ways)
        rival = prepared(case, far, way)
        off, spent = ran(rival, name, of, LONGEST * seconds)
        done += spent < inf
        if off <= error:
            good.append((far, way, rival, off))
    found = len(good)
    least = [inf] * len(good)
    for _ in range(rounds):
        for k, (_, _, rival, _) in enumerate(good):
            least[k] = min(least[k], ran(rival, name, of, inf)[1])
    first = sorted(range(len(good)), key=least.__getitem__)[:FINALISTS]
    # the least of many times is too low: the first are timed anew, in pairs with the chosen one
    ratios = {k: ratio([own, good[k][2]], name, of, 3 * rounds) for k in first}
    if not ratios:
        return Duel(error, count, done, found, None)
    k = min(first, key=ratios.__getitem__)
    return Duel(error, count, done, found, Rival(good[k][0], good[k][1], good[k][3], ratios[k]))


def ratio(codes: Sequence[object], name: str, of: str, rounds: int) -> float:
    """Wall time of the second of two programs over that of the first: the median of pairs.

    Each goes first in every other pair, so that what makes the second run of a pair slower or
    faster, or the machine for a while, is in both.
    """
    found = []
    for n in range(rounds):
        spent = [ran(one, name, of, inf)[1] for one in (codes if n % 2 else codes[::-1])]
        found.append(spent[1] / spent[0] if n % 2 else spent[0] / spent[1])
    return median(found)


def randomly(
    engine: str, sample: float, chosen: Setting, dice: random.Random, turn: int | None
) -> Setting:
    """A random setting; or the chosen one with so many parameters changed."""

    def logarithmic(low: float, high: float) -> float:
        return float(low * (high / low) ** dice.random())

    base = dict(chosen.parameters)
    step = float(base["timestep"])  # type: ignore[arg-type]
    count = max(1, round(sample / step))
    most = MORE_STEPS * count if turn is None else 2 * count
    step = (
        sample / ceil(logarithmic(0.4 * count, most))
        if count > 1 or turn is None
        else (sample / dice.choice((1, 1, 2)))
    )
    if engine == "pymunk":
        iterations = round(logarithmic(1, 300))
        if turn is not None:
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
    if turn is None:
        return Setting(engine, {"timestep": step, **drawn})
    names = dice.sample(sorted(["timestep", *drawn]), min(turn, len(drawn) + 1))
    kept = {k: v for k, v in base.items() if k not in ("defaults",)}
    if "timestep" in names and isinstance(solref := kept.get("solref"), tuple):
        kept["solref"] = (float(solref[0]) * step / float(str(kept["timestep"])), *solref[1:])
    turned = {name: {"timestep": step, **drawn}[name] for name in names}
    return Setting(engine, {**kept, **turned})


def prepared(case: Case, setting: Setting, drive: Imposed) -> object:
    """The program of a setting, compiled."""
    return compile(written(case, setting, drive, ""), "rival.py", "exec")


def ran(code: object, name: str, of: str, longest: float) -> tuple[float, float]:
    """Error and wall time of a program; infinite where it fails or late."""
    said, space = io.StringIO(), dict[str, object](__name__="rival")
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "curves.csv")
        try:
            with redirect_stdout(said), alarm(longest + SPARE):
                exec(code, space)  # type: ignore[arg-type]
                space["main"](file)  # type: ignore[operator]
        except (SystemExit, Late, ValueError, ArithmeticError):
            return inf, inf
        finally:
            mujoco.set_mjcb_control(None)  # of a servo, in a program that did not come to its end
        found = PRINTED.search(said.getvalue())
        assert found
        error = truths.errors(name, file)[of]
        return (error if error == error else inf), float(found[2])


@contextmanager
def alarm(seconds: float) -> Iterator[None]:
    """Raise `Late` meanwhile, after a time of this process [s]."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise Late

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, 0 if seconds == inf else seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
