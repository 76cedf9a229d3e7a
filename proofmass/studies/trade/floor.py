"""What an error floor is: one cause at a time is moved there, and the error says which it follows.

A cause that has a share s of the error, and is of first order, moves it by a factor 1 / (1 - s/2)
when it is halved.  The time step is no cause: a floor is what halving it leaves.  Rounding is one
where it is shown, by a disturbance of its size (`proofmass.studies.trade.disturbed`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import log
from pathlib import Path

from proofmass.case import Case
from proofmass.engines import engine_of
from proofmass.outcome import Outcome
from proofmass.sim.protocol import STEP
from proofmass.strict import Kind
from proofmass.studies.record import NAN, Setting, StudyRow
from proofmass.studies.trade.varied import ConvergenceSeries, at_step, studied
from proofmass.studies.variants import READS, movable, reread, thinned

MOVES = 1.1
"""Factor on the error from which a cause is one: a fifth of the error, if of first order."""
UNKNOWN = "unknown"
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


def halvings(run: Kind, series: ConvergenceSeries, setting: Setting, own: float) -> list[Setting]:
    """A setting of a series with half and a quarter of its step, or of its links.

    Parameters
    ----------
    run, series, setting
        Where loops get harder with the step along the series, they do so here.
    own : float
        The model's time step [s], for a setting that has none.
    """
    if run != "dynamics":
        n = int(str(setting.parameters["segments"]))
        return [setting.but(segments=2 * n), setting.but(segments=4 * n)]
    step = float(str(setting.parameters.get("timestep", own)))
    return [
        at_step(setting, step / by) if series.scaled else setting.but(timestep=step / by)
        for by in (2, 4)
    ]


def probes(
    case: Case, run: Kind, setting: Setting, folder: Path, scaled: bool = False
) -> list[Probe]:
    """All causes that can be moved in a run, each of them moved.

    Parameters
    ----------
    case, run, setting
        What is moved.
    folder : Path
        Takes the models and curves that it needs.
    scaled : bool
        Whether loops get harder with the step along the setting's series, so that the step alone
        changes how many steps their time constants have.
    """
    if run != "dynamics":
        own = (
            []
            if not case.rod
            else [
                Probe(
                    "segments",
                    "twice as many segments",
                    case,
                    setting.but(segments=2 * int(str(setting.parameters["segments"]))),
                )
            ]
        )
    else:
        causes = engine_of(setting.engine).causes(setting.parameters, studied(case), scaled)
        own = [
            Probe(
                one.cause,
                one.move,
                case,
                Setting(setting.engine, one.parameters),
                one.better,
                one.whole,
            )
            for one in causes
        ]
    return [*own, *of_reference(case, setting, folder), *of_samples(case, run, setting)]


def of_reference(case: Case, setting: Setting, folder: Path) -> Iterator[Probe]:
    """Half of a recorded curve, or the general solver as a second reference, which knows only the
    model: not the law that a drive may have from the first."""
    if case.recorded:
        yield Probe(
            "the reference",
            "every other row of the recorded curve",
            thinned(case, folder),
            setting,
            False,
        )
    elif case.reference != READS and movable(case) and not case.rod:
        yield Probe("the reference", "a second reference", reread(case), setting, None)


def of_samples(case: Case, run: Kind, setting: Setting) -> Iterator[Probe]:
    """Samples at the ends of links, or every other of those in time, which has the same steps."""
    table = case.run[run]
    if table.n is None:
        return
    if run == "equilibrium" and table.n - 1 != (
        segments := int(str(setting.parameters["segments"]))
    ):
        yield Probe(
            "sampling", "samples at the ends of links", sampled(case, run, segments + 1), setting
        )
    elif run == "dynamics" and table.n % 2:
        yield Probe(
            "sampling", "every other sample", sampled(case, run, table.n // 2 + 1), setting, None
        )


def sampled(case: Case, run: Kind, n: int) -> Case:
    """The case with another number of samples."""
    table = case.run[run].model_copy(update={"n": n})
    return case.model_copy(update={"run": {**case.run, run: table}})


def judge(
    error: float, found: Sequence[tuple[Probe, StudyRow]], kind: str, at_floor: bool = False
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
        if row.outcome != Outcome.RAN or not moved > 0:
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
    return (
        f"divides the error by {ratio:.2f}"
        if ratio > 1
        else (f"multiplies the error by {1 / ratio:.2f}")
    )
