"""What to use for an error of each kind, on the page of a trade study: settings to paste."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import inf, isfinite

from proofmass.engines import NoEngine, engine_of
from proofmass.outcome import Outcome
from proofmass.sim.protocol import ParameterValue
from proofmass.studies.record import NAN, Setting, StudyRow
from proofmass.studies.trade.choose import beside, enough, floor_at, would_need
from proofmass.studies.trade.noise import interval, ties
from proofmass.studies.trade.program import snippet
from proofmass.studies.trade.verdict import Verdict
from proofmass.studies.trade.words import format_floor, format_setting_briefly
from proofmass.wording import format_solver, number

ASKED = (1e-3, 1e-5, 1e-7)
"""Errors that the pages tell settings for [share of the range]."""


@dataclass(frozen=True)
class Advice:
    """The cheapest setting of one engine for an error, or the best it has.

    Attributes
    ----------
    engine, tone : str
        In words, and the class of its colour.
    place : int
        Number of the setting in its table; -1 where nothing ran.
    reached : bool
        Whether it is as close as is asked for, with margin.
    setting, error, cost, steps : str
        In words.
    more : tuple of str
        What its cost compares with, or what keeps the engine from the error.
    tied : str
        Settings that are close enough as well and that the clock does not tell from it.
    text : str
        What to paste.
    """

    engine: str
    tone: str
    place: int
    reached: bool
    setting: str = ""
    error: str = ""
    cost: str = ""
    steps: str = ""
    more: tuple[str, ...] = ()
    tied: str = ""
    text: str = ""


@dataclass(frozen=True)
class Asked:
    """An error that somebody may ask for, and what each engine has for it, the cheapest first."""

    wanted: str
    engines: tuple[Advice, ...]
    tied: bool
    """Whether the clock does not tell the first two engines apart."""


def advised(
    rows: Sequence[StudyRow], verdicts: Sequence[Verdict], kind: str, usual: float
) -> list[Asked]:
    """For each of `ASKED` what each engine has, `usual` from `noise.usual_spread`."""
    found = []
    for wanted in ASKED:
        cheapest = dict[str, StudyRow]()
        told = dict[str, Advice]()
        for engine in dict.fromkeys(row.engine for row in rows):
            own = [row for row in rows if row.engine == engine]
            able = enough(own, kind, wanted)
            if able:
                cheapest[engine] = able[0]
                told[engine] = use(rows, own, able, kind, wanted, verdicts, usual)
            else:
                told[engine] = short(rows, own, kind, wanted, verdicts)
        order = sorted(told, key=lambda name: cheapest[name].seconds if name in cheapest else inf)
        first = [interval(cheapest[name], usual) for name in order[:2] if name in cheapest]
        found.append(
            Asked(
                number(wanted),
                tuple(told[name] for name in order),
                len(first) == 2 and first[0].overlaps(first[1]),
            )
        )
    return found


def use(
    rows: Sequence[StudyRow],
    own: Sequence[StudyRow],
    able: Sequence[StudyRow],
    kind: str,
    wanted: float,
    verdicts: Iterable[Verdict],
    usual: float,
) -> Advice:
    """What to use of one engine, whose settings `able` are close enough, the cheapest first."""
    row = able[0]
    same = [format_setting_briefly(one) for one in ties(able, row, usual)]
    words = "; ".join(same[:MOST]) + (f"; and {len(same) - MOST} more" if same[MOST:] else "")
    return Advice(
        format_solver(row.engine),
        row.engine,
        place_of(rows, row),
        True,
        format_setting_briefly(row),
        number(row.reached(kind), 2),
        timed(row, usual),
        f"{row.steps} steps" if row.steps else "",
        (beside(own, row, kind, wanted, verdicts)[0],),
        words,
        pasted(row),
    )


MOST = 4  # tied settings that are named


def short(
    rows: Sequence[StudyRow],
    own: Sequence[StudyRow],
    kind: str,
    wanted: float,
    verdicts: Sequence[Verdict],
) -> Advice:
    """The best that an engine has which is not close enough, and what keeps it there."""
    ran = [r for r in own if r.outcome == Outcome.RAN and isfinite(r.errors.get(kind, NAN))]
    engine = own[0].engine
    if not ran:
        return Advice(format_solver(engine), engine, -1, False, "no setting ran")
    row = min(ran, key=lambda one: one.errors[kind])
    floor = floor_at(row, kind, verdicts)
    return Advice(
        format_solver(engine),
        engine,
        place_of(rows, row),
        False,
        format_setting_briefly(row),
        number(row.errors[kind], 2),
        f"{number(row.seconds, 2)} s" if row.seconds > 0 else "",
        f"{row.steps} steps" if row.steps else "",
        (format_floor(floor),) if floor else (would_need(ran, kind, wanted, verdicts),),
        "",
        pasted(row),
    )


def place_of(rows: Sequence[StudyRow], row: StudyRow) -> int:
    """The number of a row, which is the same object."""
    return next(k for k, one in enumerate(rows) if one is row)


def timed(row: StudyRow, usual: float) -> str:
    """Wall time with its interval.

    >>> timed(StudyRow("", "", "", "", "", "", 1.0, seconds=0.01, repeats=(0.01, 0.02)), 1.0)
    '10 ms (10 to 20)'
    """
    low, told, high = interval(row, usual)
    unit, factor = next(((u, f) for u, f in UNITS if told * f >= 1), UNITS[-1])
    words = f"{number(told * factor, 2)} {unit}"
    if not high > low:
        return words
    return f"{words} ({number(low * factor, 2)} to {number(high * factor, 2)})"


UNITS = (("s", 1.0), ("ms", 1e3), ("µs", 1e6))


def pasted(row: StudyRow) -> str:
    """What to paste for a setting: in the engine's own words, or as the sidecar has it.

    The sidecar's words stay where an engine needs settings that it chooses in the run.

    >>> print(pasted(StudyRow("", "", "", "mujoco", "", "", 1.0, {"timestep": 0.01})))
    <option timestep="0.01"/>
    >>> print(pasted(StudyRow("", "", "", "pymunk", "", "", 1.0, {"timestep": 0.01})))
    # in the sidecar
    [settings.pymunk]
    timestep = 0.01
    """
    parameters = dict(row.parameters)
    if row.step > 0 and "timestep" in parameters:
        parameters["timestep"] = row.step  # as it was taken: whole steps from sample to sample
    try:
        engine = engine_of(row.engine)
    except NoEngine:  # a table may have another machine's
        return in_sidecar(row.engine, parameters)
    own = {}
    if parameters.get("defaults"):
        fields = engine.settings.model_fields
        own = {name: fields[name].default for name in engine.chooses if name in fields}
    text = snippet(Setting(row.engine, {**own, **parameters}), row.steps)
    return text or in_sidecar(row.engine, parameters)


def in_sidecar(engine: str, parameters: dict[str, ParameterValue]) -> str:
    """Settings as TOML."""
    lines = [f"{name} = {toml(value)}" for name, value in parameters.items() if name != "segments"]
    return "\n".join(["# in the sidecar", f"[settings.{engine}]", *lines])


def toml(value: ParameterValue) -> str:
    """A value as TOML has it.

    >>> toml(True), toml((0.02, 1.0)), toml("RK4")
    ('true', '[0.02, 1.0]', '"RK4"')
    """
    return json.dumps(value)


def limited_by(
    verdicts: Iterable[Verdict], kind: str, letters: dict[tuple[str, str], str]
) -> Iterator[dict[str, str]]:
    """What limits the error of a kind, a cause each: levels, series, and the evidence of one."""
    groups = dict[str, list[Verdict]]()
    for verdict in verdicts:
        if (
            verdict.kind == kind
            and verdict.floor > 0
            and (verdict.engine, verdict.series) in letters
        ):
            groups.setdefault(verdict.cause, []).append(verdict)
    for cause, own in sorted(groups.items(), key=lambda group: -max(v.floor for v in group[1])):
        own = sorted(own, key=lambda v: v.floor)
        low, high = number(own[0].floor, 2), number(own[-1].floor, 2)
        names = ", ".join(sorted(letters[v.engine, v.series] for v in own))
        yield {
            "cause": cause,
            "level": low if low == high else f"{low} to {high}",
            "series": f"series {names}",
            "evidence": own[-1].evidence,
            "of": letters[own[-1].engine, own[-1].series],
        }
