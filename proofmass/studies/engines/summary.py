"""What a table of cases and engines says of each engine, in sentences from its rows."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isnan
from statistics import median

from proofmass.base.grouping import group_by
from proofmass.base.wording import number
from proofmass.sim.engines import engine_of, format_solver
from proofmass.studies.cells import SILENT_SHARE, CellResult
from proofmass.verdict.outcome import NOT_RUN_OUTCOMES, Outcome

NAMED = 4
"""Cases that a sentence names; of more, it gives their number."""


@dataclass(frozen=True)
class EngineSummary:
    """What a table says of an engine.

    Attributes
    ----------
    solver, title : str
    solves, licence, practice, trap : str
        What the engine says of itself, see `proofmass.sim.hosts.engine.About`; empty of others.
    filled, of : int
        Cells with curves that were compared, and all its cells.
    middle : float
        Median of the largest errors of positions, as shares of the range [1].
    seconds : float
        Median of the processor time of the steps of a run [s], with the time steps of the models.
    sentences : tuple of str
        Where it is good and where it breaks.
    versions : str
        What computed.
    """

    solver: str
    title: str
    solves: str
    licence: str
    practice: str
    trap: str
    filled: int
    of: int
    middle: float
    seconds: float
    sentences: tuple[str, ...]
    versions: str


def summarize_engine(solver: str, results: Sequence[CellResult]) -> EngineSummary:
    """What the results of an engine say of it."""
    own = [one for one in results if one.solver == solver]
    filled = [one for one in own if one.is_filled]
    errors = [one.position for one in filled if not isnan(one.position)]
    about = getattr(engine_of(solver), "about", None)
    versions = next((one.versions for one in filled if one.versions), {})
    return EngineSummary(
        solver,
        format_solver(solver),
        getattr(about, "solves", ""),
        getattr(about, "licence", ""),
        getattr(about, "practice", ""),
        getattr(about, "trap", ""),
        len(filled),
        len(own),
        median(errors) if errors else float("nan"),
        median([one.seconds for one in filled]) if filled else float("nan"),
        tuple(sentences_on(own, filled)),
        ", ".join(f"{name} {version}" for name, version in versions.items()),
    )


def sentences_on(own: Sequence[CellResult], filled: Sequence[CellResult]) -> Iterator[str]:
    """Sentences on the results of an engine: its best and worst runs, and those that it lost."""
    ranked = sorted((one for one in filled if not isnan(one.position)), key=lambda r: r.position)
    good = [one for one in ranked if not one.is_silently_wrong]
    if good:
        best, worst = good[0], good[-1]
        yield f"Best: {best.case}, {number(best.position)} of the range in position."
        if good[1:]:
            yield f"Largest error: {worst.case}, {number(worst.position)}."
    if silent := [one for one in ranked if one.is_silently_wrong]:
        places = ", ".join(f"{one.case} by {number(one.position)} of the range" for one in silent)
        yield f"Silently wrong, by more than {SILENT_SHARE:.0%} and without a word: {places}."
    compiled = [one.compile_seconds for one in filled if one.compile_seconds]
    if compiled:
        yield (
            f"Compiles for {number(median(compiled))} s of processor time before a run, in the "
            f"median; the steps then take {number(median([one.seconds for one in filled]))} s."
        )
    lost = [one for one in own if not one.is_filled and one.outcome not in NOT_RUN_OUTCOMES]
    for outcome, some in group_by(lost, lambda one: one.outcome).items():
        for words, same in group_by(some, lambda one: one.message.partition(" (t =")[0]).items():
            yield f"{str(outcome).capitalize()}: {name_cases(same)}: {words}"
    refused = [one for one in own if one.outcome in NOT_RUN_OUTCOMES]
    for words, same in sorted(
        group_by(refused, lambda one: one.message).items(), key=lambda pair: -len(pair[1])
    ):
        word = "Unavailable" if same[0].outcome == Outcome.UNAVAILABLE else "Refused"
        yield f"{word}: {name_cases(same)}: {words}"


def name_cases(results: Sequence[CellResult]) -> str:
    """The cases of some results, and how many more there are."""
    names = list(dict.fromkeys(one.case for one in results))
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more
