"""What an error floor is: one cause at a time is moved there, and the error says which it follows.

A cause that has a share s of the error, and is of first order, moves it by a factor 1 / (1 - s/2)
when it is halved.  The time step is no cause: a floor is what halving it leaves.  Rounding is one
where it is shown, by a disturbance of its size (`proofmass.studies.trade.disturbed`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import log
from pathlib import Path
from typing import Any

from proofmass.case import Case
from proofmass.recorded import Recorded
from proofmass.reference import compiled, module_of
from proofmass.sim.mujoco.settings import ENGINE_DEFAULTS
from proofmass.sim.pymunk.dynamics import MOST
from proofmass.sim.pymunk.engine import CHIPMUNK_BIAS
from proofmass.strict import Kind
from proofmass.studies.record import NAN, Row, Setting
from proofmass.studies.trade.axes import Line, at_step
from proofmass.studies.variants import READS, movable, reread, thinned

MOVES = 1.1
"""Factor on the error from which a cause is one: a fifth of the error, if of first order."""
CAP = 0.9999  # MuJoCo takes no harder solimp
UNKNOWN = "unknown"
STEP = "time step"
IN_SOLREF = "too few steps in solref"
"""What the step alone moves on a line whose loops get harder with it."""
ROUNDING = "rounding"


@dataclass(frozen=True)
class Probe:
    """A setting with one cause moved.

    Attributes
    ----------
    cause, move : str
        What is suspected, and what is done to it, in words.
    case : Case
    setting : Setting
    better : bool or None
        Whether it was moved to where less error is expected, or away from there because it can go
        no further; None if the error may go either way.
    whole : bool
        Whether it was taken away, and not only halved.
    """

    cause: str
    move: str
    case: Case
    setting: Setting
    better: bool | None = True
    whole: bool = False


def halvings(run: Kind, line: Line, setting: Setting, own: float) -> list[Setting]:
    """A setting of a line with half and a quarter of its step, or of its links.

    Parameters
    ----------
    run, line, setting
        Where loops get harder with the step along the line, they do so here.
    own : float
        The model's time step [s], for a setting that has none.
    """
    if run != "duration":
        n = int(str(setting.knobs["segments"]))
        return [setting.but(segments=2 * n), setting.but(segments=4 * n)]
    step = float(str(setting.knobs.get("timestep", own)))
    return [at_step(setting, step / by) if line.scaled else setting.but(timestep=step / by)
            for by in (2, 4)]


def probes(case: Case, run: Kind, setting: Setting, folder: Path, scaled: bool = False
           ) -> list[Probe]:
    """All causes that can be moved in a run, each of them moved.

    Parameters
    ----------
    case, run, setting
        What is moved.
    folder : Path
        Takes the models and curves that it needs.
    scaled : bool
        Whether loops get harder with the step along the setting's line: the step alone changes how
        many steps are in `solref`.
    """
    if run != "duration":
        own = [] if not case.rod else [Probe(
            "segments", "twice as many segments", case,
            setting.but(segments=2 * int(str(setting.knobs["segments"]))))]
    else:
        own = [*(in_pymunk if setting.engine == "pymunk" else in_mujoco)(case, setting, scaled)]
    return [*own, *of_reference(case, setting, folder), *of_samples(case, run, setting)]


def in_mujoco(case: Case, setting: Setting, scaled: bool) -> Iterator[Probe]:
    """Step, softness of loops, solver."""
    model = compiled(case)
    known: dict[str, Any] = {**(ENGINE_DEFAULTS if setting.knobs.get("defaults") else {}),
                             **setting.knobs}
    step = known.get("timestep", model.opt.timestep)
    yield Probe(IN_SOLREF if scaled else STEP,
                "halving the step" + ", solref as it is" * scaled, case,
                setting.but(timestep=step / 2))
    if not model.neq:
        return
    tau, ratio = known.get("solref", model.eq_solref[0])[:2]
    safe = tau / 2 >= 2 * step  # MuJoCo itself takes no less
    yield Probe("softness of the loops", "halving solref" if safe else "doubling solref", case,
                setting.but(solref=(tau / 2 if safe else 2 * tau, ratio)), safe)
    low, high, *rest = known.get("solimp", model.eq_solimp[0])
    room = 1 - (1 - high) / 2 <= CAP
    factor = 0.5 if room else 2.0
    yield Probe("softness of the loops, solimp", f"{'halving' if room else 'doubling'} 1 - solimp",
                case, setting.but(solimp=(1 - factor * (1 - low), 1 - factor * (1 - high), *rest)),
                room)
    more = 4 * known.get("iterations", model.opt.iterations)
    yield Probe("the solver's iterations", "four times as many iterations", case,
                setting.but(iterations=more, tolerance=0.0))


def in_pymunk(case: Case, setting: Setting, scaled: bool) -> Iterator[Probe]:
    """Step, bias, iterations."""
    known: dict[str, Any] = setting.knobs
    step = known.get("timestep", compiled(case).opt.timestep)
    yield Probe(STEP, "halving the step", case, setting.but(timestep=step / 2))
    own = known.get("defaults")
    if bias := known.get("error_bias", CHIPMUNK_BIAS if own else 0.0):
        yield Probe("bias of the loops", "halving its time constant", case,
                    setting.but(error_bias=bias**2))
        kept = {k: v for k, v in known.items() if k not in ("defaults", "iterations")}
        yield Probe("bias of the loops", "taking it away, with iterations enough for that", case,
                    Setting("pymunk", {**kept, "error_bias": 0.0}), whole=True)
    more = 4 * known.get("iterations", 10 if own else MOST // 4)
    yield Probe("the solver's iterations", f"{more} iterations", case,
                setting.but(iterations=more))


def of_reference(case: Case, setting: Setting, folder: Path) -> Iterator[Probe]:
    """Half of a recorded curve, or the general solver as a second reference, which knows only the
    model: not the law that a drive may have from the first."""
    if isinstance(module_of(case), Recorded):
        yield Probe("the reference", "every other row of the recorded curve",
                    thinned(case, folder), setting, False)
    elif case.reference != READS and movable(case) and not case.rod:
        yield Probe("the reference", "a second reference", reread(case), setting, None)


def of_samples(case: Case, run: Kind, setting: Setting) -> Iterator[Probe]:
    """Samples at the ends of links, or every other of those in time, which has the same steps."""
    table = case.run[run]
    if table.n is None:
        return
    if run == "rest" and table.n - 1 != (segments := int(str(setting.knobs["segments"]))):
        yield Probe("sampling", "samples at the ends of links",
                    sampled(case, run, segments + 1), setting)
    elif run == "duration" and table.n % 2:
        yield Probe("sampling", "every other sample",
                    sampled(case, run, table.n // 2 + 1), setting, None)


def sampled(case: Case, run: Kind, n: int) -> Case:
    """The case with another number of samples."""
    table = case.run[run].model_copy(update={"n": n})
    return case.model_copy(update={"run": {**case.run, run: table}})


def judge(error: float, found: Sequence[tuple[Probe, Row]], kind: str, at_floor: bool = False
          ) -> tuple[str, str]:
    """What an error follows, and the factors that tell.

    Parameters
    ----------
    error : float
        Where causes were moved.
    found : sequence of (Probe, Row)
        All that was moved.
    kind : str
        Of error.
    at_floor : bool
        Whether the step was shown to leave it, so that it is no cause.

    Returns
    -------
    cause, evidence : str
    """
    gains: dict[str, float] = {}
    words = []
    for probe, row in found:
        moved = row.errors.get(kind, NAN)
        if row.outcome != "ran" or not moved > 0:
            words.append(f"{probe.move}: {row.outcome}")
            continue
        if not (at_floor and probe.cause == STEP):
            gains[probe.cause] = max(gain(probe, error / moved), gains.get(probe.cause, 0.0))
        words.append(f"{probe.move} {factor(error / moved)}")
    cause = max(gains, key=lambda name: gains[name], default=UNKNOWN)
    return cause if gains.get(cause, 1.0) >= MOVES else UNKNOWN, "; ".join(words)


def gain(probe: Probe, ratio: float) -> float:
    """How much better the error is, or how much worse where a cause was moved away."""
    if probe.better is None:
        return max(ratio, 1 / ratio)
    if probe.whole:  # it had a share 1 - 1/ratio, whose half would have given this
        return 2 / (1 + 1 / ratio)
    return ratio if probe.better else 1 / ratio


def factor(ratio: float) -> str:
    """What was done to an error, in words.

    >>> factor(4.0), factor(0.5), factor(1.0)
    ('divides the error by 4.00', 'multiplies the error by 2.00', 'leaves the error')
    """
    if abs(log(ratio)) < 0.005:
        return "leaves the error"
    return f"divides the error by {ratio:.2f}" if ratio > 1 else (
        f"multiplies the error by {1 / ratio:.2f}")
