"""Finer steps than were measured: what they promise, what the store knows of them, their limits.

The errors of a line that is at no error floor fall on with the order of its last two steps.  That
tells which step would be good enough, and what it would cost.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from math import inf, isclose

from proofmass.case import Case
from proofmass.strict import Kind
from proofmass.studies.measure import Task
from proofmass.studies.row import NAN, Row
from proofmass.studies.run import row as row_of
from proofmass.studies.setting import Knob, Setting
from proofmass.studies.store import Store, key_of, versions
from proofmass.studies.trade.axes import Line, at_step, leading, lines
from proofmass.studies.trade.line import FALLS, order
from proofmass.studies.trade.verdict import Verdict
from proofmass.wording import number, spoken

SAFE = 0.8  # of the error that is needed: orders change a little
LONGEST = 30.0  # s, of a run
BUDGET = 300.0  # s, of a whole search
APART = 1.4  # times a step that the one before it must be, for an order to be told from both


@dataclass
class Limits:
    """How much time a search may take, and how much it took.

    Attributes
    ----------
    longest, budget : float
        Of a run, and of all of them together [s].
    spent : float
        What was measured took so long [s].
    settings : int
        How many were measured.
    known : int
        How many more the store knew.
    short : bool
        Whether the budget left one out.
    """

    longest: float = LONGEST
    budget: float = BUDGET
    spent: float = 0.0
    settings: int = 0
    known: int = 0
    short: bool = False

    @property
    def words(self) -> str:
        """The same in a sentence.

        >>> Limits(budget=60.0, spent=12.34, settings=3).words
        '3 settings measured in 12 s of --budget 60 s, --longest 30 s a run'
        """
        known = f"{self.known} more settings known from the store; " if self.known else ""
        return (f"{known}{self.settings} settings measured in {number(self.spent, 2)} "
                f"s of --budget {number(self.budget)} s, --longest {number(self.longest)} s a run"
                + ", which left some out" * self.short)


@dataclass(frozen=True)
class Promise:
    """The step [s] with which a line should be good enough, and what it should cost [s]."""

    row: Row
    step: float
    seconds: float
    falls: float


def promises(rows: Iterable[Row], verdicts: Iterable[Verdict], of: str, needed: float
             ) -> list[Promise]:
    """Of each line at no error floor the step that should be good enough, the cheapest first."""
    floors = {(v.engine, v.line) for v in verdicts if v.kind == of and v.floor > 0}
    found = []
    for coarse, fine in ends(row for row in rows if (row.engine, row.line) not in floors):
        pair = [(row.value, row.errors.get(of, NAN)) for row in (coarse, fine)]
        falls = order(*pair) if all(0 < error < inf for _, error in pair) else NAN
        if falls > FALLS and fine.errors[of] > needed:
            step = fine.value * (SAFE * needed / fine.errors[of]) ** (1 / falls)
            found.append(Promise(fine, step, fine.seconds * fine.value / step, falls))
    return sorted(found, key=lambda each: each.seconds)


def ends(rows: Iterable[Row]) -> Iterator[tuple[Row, Row]]:
    """The finest step of each line and the one before it that is clearly coarser, if both ran."""
    stepped = sorted((row for row in rows if row.axis == "timestep"),
                     key=lambda row: (row.engine, row.line, -row.value))
    for _, group in groupby(stepped, lambda row: (row.engine, row.line)):
        line = list(group)
        before = [row for row in line if row.value > APART * line[-1].value]
        if before and [before[-1].outcome, line[-1].outcome] == ["ran", "ran"]:
            yield before[-1], line[-1]


def scaled(row: Row, step: float) -> Setting:
    """A setting with another step; what holds loops goes with the step, as it does on its line."""
    return at_step(Setting(row.engine, dict(row.knobs, timestep=row.value)), step)


def known(case: Case, kind: Kind, rows: Iterable[Row], store: Store, only: str = ""
          ) -> Iterator[Row]:
    """Settings that the store has of a case beside those of a study, whoever asked for them; of one
    engine `only`, if that is given.

    The key of each is found anew, so that its model, sidecar, sources and versions are these.
    """
    there = {row.key for row in rows}
    own = [line for line in lines(case, kind) if line.engine == (only or line.engine)]
    for key, record in store.records(case.name, kind):
        engine, knobs = str(record.get("engine")), record.get("knobs")
        if key in there or engine not in {line.engine for line in own} or (
                not isinstance(knobs, dict) or record.get("versions") != versions(engine)):
            continue
        setting = Setting(engine, {name: tuple(value) if isinstance(value, list) else value
                                   for name, value in knobs.items()})
        task = Task(case, kind, setting, "choose", *placed(setting, own))
        if key_of(task) == key and (found := store.repeats(key)) and found[0].outcome == "ran":
            yield row_of(task, found, True, key)


def placed(setting: Setting, own: Iterable[Line]) -> tuple[str, str, float]:
    """The line that a setting is on, its axis and its value there; else a line of its own."""
    for line in own:
        first = line.settings[0]
        value = setting.knobs.get(line.axis)
        if line.engine != setting.engine or value is None or len(line.settings) < 2:
            continue
        there = (at_step(first, leading(value)) if line.scaled
                 else first.but(**{line.axis: value}))
        if same(there.knobs, setting.knobs):
            return line.name, line.axis, leading(value)
    step = setting.knobs.get("timestep", NAN)
    words = ", ".join(f"{name} {value}" for name, value in setting.knobs.items()
                      if name != "timestep")
    return f"{spoken(setting.engine)}, {words or 'as in the model'}", "timestep", leading(step)


def same(one: dict[str, Knob], other: dict[str, Knob]) -> bool:
    """Whether two settings differ by no more than rounding."""
    if one.keys() != other.keys():
        return False
    for name, value in one.items():
        parts = [v if isinstance(v, tuple) else (v,) for v in (value, other[name])]
        if len(parts[0]) != len(parts[1]) or not all(
                isclose(a, b, rel_tol=1e-9) if isinstance(a, float) and isinstance(b, (float, int))
                else a == b for a, b in zip(*parts, strict=True)):
            return False
    return True
