"""Engines at equal cost: convergence series of several engines in several cases, and their ranks.

    costs = measure_costs(cases, study)      # cases whose solvers are the engines
    write_costs(costs, folder)               # cost.csv: all settings; cost.json: ranks and machine

The settings of an engine are its convergence series, as `proofmass trade` has them: each is run
for its error, those near the front of error and time several times more for their times.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from math import isnan
from pathlib import Path
from statistics import mode
from typing import Any

from proofmass.base.files import read_text, write_output
from proofmass.base.json_values import replace_nonfinite
from proofmass.base.wording import number
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut, call_isolated
from proofmass.case.case import Case
from proofmass.reference.samples import run_samples
from proofmass.run.fingerprint import digest
from proofmass.sim.engines import engine_of, format_solver
from proofmass.sim.hosts.engine import HostedEngine
from proofmass.sim.hosts.process import measure_start
from proofmass.sim.protocol.failures import Unavailable
from proofmass.studies import DEFAULT_LONGEST_RUN
from proofmass.studies.engines.ranking import (
    CaseStanding,
    ComparedCase,
    EngineStanding,
    rank_case,
    rank_engines,
)
from proofmass.studies.measure import load_average
from proofmass.studies.record import KIND_UNITS, NAN, StudyRow, write_table
from proofmass.studies.study import Study
from proofmass.studies.trade.noise import count_processors, explain_busy_machine, usual_spread
from proofmass.studies.trade.trade import FRONT_REPEATS, SERIES_BUDGET, measure_series
from proofmass.studies.trade.words import format_setting_briefly

COST_TABLE, COST_ROWS = "cost.json", "cost.csv"
RANKED_ERRORS = (1e-3, 1e-6)
"""Errors for which engines are ranked, as shares of the range of the reference [1]: what a drawing
shows, and what a second engine or a measurement could still tell apart."""
START_TIMEOUT = 120.0
"""Processor time in which an engine must start [s]; the slowest here imports for 3 s."""


@dataclass(frozen=True)
class MachineLoad:
    """The machine that measured.

    Attributes
    ----------
    name : str
        Its processor, and how many it has.
    processors : int
    before, after : float
        Load average at the start and the end of the command, as numbers of processes [1].
    least, most : float
        Smallest and largest load average at the timed runs, those of earlier calls included
        [1].
    """

    name: str
    processors: int
    before: float
    after: float
    least: float
    most: float


@dataclass(frozen=True)
class ComparedEngine:
    """What the comparison tells of an engine beside its times.

    Attributes
    ----------
    engine, title : str
    settings, series : int
        Numbers of its settings and of its convergence series, in all cases.
    start : float
        Processor time in which its interpreter starts and imports it [s]; NaN if it runs here.
    compile : float
        Largest processor time of compilation before a run [s].
    reading : str
        How velocities are read, see `proofmass.sim.hosts.engine.SteppedSettings`; empty of an
        engine that has them at the samples.
    solves, practice : str
        What the engine says of itself, see `proofmass.sim.hosts.engine.About`.
    """

    engine: str
    title: str
    settings: int
    series: int
    start: float
    compile: float
    reading: str
    solves: str = ""
    practice: str = ""


@dataclass(frozen=True)
class EngineCosts:
    """A comparison of engines at equal cost.

    Attributes
    ----------
    cases : list of ComparedCase
    engines : list of ComparedEngine
    machine : MachineLoad
    budget : float
        Processor time of a run after which a series ends [s].
    """

    cases: list[ComparedCase]
    engines: list[ComparedEngine]
    machine: MachineLoad
    budget: float = SERIES_BUDGET

    @property
    def rows(self) -> list[StudyRow]:
        """All settings of all cases."""
        return [row for case in self.cases for row in case.rows]

    @property
    def spread(self) -> float:
        """Usual ratio of the longest to the shortest timing of a setting [1]."""
        return usual_spread(self.rows)

    @property
    def kinds(self) -> list[str]:
        """Kinds of errors that some setting has."""
        return [kind for kind in KIND_UNITS if any(kind in row.errors for row in self.rows)]

    @property
    def busy(self) -> list[str]:
        """Sentences on why times are uncertain."""
        return explain_busy_machine(self.rows)

    def standings(self, kind: str, error: float) -> list[CaseStanding]:
        """Where all engines stand in all cases, case by case."""
        return [
            one
            for case in self.cases
            for one in rank_case(case, kind, error, self.spread, self.budget)
        ]

    def ranked(self, kind: str, error: float) -> list[EngineStanding]:
        """Where all engines stand over all cases."""
        return rank_engines(self.standings(kind, error))


def measure_costs(
    cases: Iterable[Case],
    study: Study,
    *,
    budget: float = SERIES_BUDGET,
    repeats: int = FRONT_REPEATS,
) -> EngineCosts:
    """Measure errors and times of all settings of the engines of some cases.

    Parameters
    ----------
    cases : iterable of Case
        Their solvers are the engines; cases without a run in time are left out.
    study : Study
        Where runs are kept and who makes them.
    budget : float
        Processor time of a run after which a series ends [s].
    repeats : int
        Number of repeats, for times, of each setting near the front.
    """
    before = load_average()
    cases = [case for case in cases if "dynamics" in case.run]
    with study.working() as working:
        study = replace(working, longest=study.longest or DEFAULT_LONGEST_RUN)
        measured = measure_series(cases, study, "dynamics", budget, repeats)
        found = [
            ComparedCase(
                case.name,
                simulated_time(case),
                tuple(row for row in measured.rows if row.case == case.name),
                motion.words if motion else "",
            )
            for case, motion in zip(measured.cases, measured.motions, strict=True)
        ]
        engines = list(dict.fromkeys(row.engine for row in measured.rows))
        starts = study.call_each(start_of, [(engine, study.store.folder) for engine in engines])
    about = [
        compare_engine(engine, start, [row for row in measured.rows if row.engine == engine])
        for engine, start in zip(engines, starts, strict=True)
    ]
    return EngineCosts(found, about, machine_load(measured.rows, before), budget)


def simulated_time(case: Case) -> float:
    """Time from the first to the last sample of a run in time [s]."""
    times = run_samples(case, "dynamics")
    return float(times[-1] - times[0])


def machine_load(rows: Sequence[StudyRow], before: float) -> MachineLoad:
    """The machine of timed runs, with the load now and `before` [processes]."""
    loads = [row.load for row in rows if not isnan(row.load)]
    name = next((row.machine for row in rows if row.machine), "")
    return MachineLoad(
        name,
        count_processors(name),
        before,
        load_average(),
        min(loads, default=NAN),
        max(loads, default=NAN),
    )


def start_of(engine: str, folder: Path) -> float:
    """Processor time in which an engine's interpreter starts [s], kept in a file; NaN without one.

    An engine that cannot be had, or does not start, has none: its runs say why.
    """
    hosted = engine_of(engine)
    if not isinstance(hosted, HostedEngine):
        return NAN
    key = digest(json.dumps([engine, hosted.versions()], sort_keys=True).encode())
    file = folder / f"{key}.start.json"
    if not file.is_file():
        try:
            seconds = call_isolated(
                measure_start,
                hosted.script,
                hosted.requires,
                hosted.python,
                timeout=START_TIMEOUT,
            )
        except (Unavailable, Crashed, TimedOut, OutOfMemory):
            return NAN
        write_output(file, json.dumps(seconds))
    return float(json.loads(read_text(file)))


def compare_engine(engine: str, start: float, rows: Sequence[StudyRow]) -> ComparedEngine:
    """What is told of an engine, from all its rows."""
    about = getattr(engine_of(engine), "about", None)
    return ComparedEngine(
        engine,
        format_solver(engine),
        len(rows),
        len({(row.case, row.series) for row in rows}),
        start,
        max((row.compile_seconds for row in rows), default=0.0),
        describe_readings(rows),
        getattr(about, "solves", ""),
        getattr(about, "practice", ""),
    )


def describe_readings(rows: Sequence[StudyRow]) -> str:
    """How velocities are read with the settings of an engine: of most series, and of others."""
    readings = {row.series: reading_of(row) for row in rows}
    if not any(readings.values()):
        return ""
    most = mode(readings.values())
    others = dict.fromkeys(
        format_setting_briefly(row).rpartition(", ")[0] or "at the step of the model"
        for row in rows
        if readings[row.series] != most
    )
    return most + (f"; plain: {', '.join(others)}" if others else "")


def reading_of(row: StudyRow) -> str:
    """How velocities are read with a setting; empty of an engine with one way."""
    parameters = {k: v for k, v in row.parameters.items() if k != "segments"}
    own = engine_of(row.engine).settings.read(parameters)
    reading = str(getattr(own, "reading", ""))
    return "plain" if reading and getattr(own, "defaults", False) else reading


def write_costs(costs: EngineCosts, folder: Path) -> None:
    """Write ``cost.csv`` with all settings, and ``cost.json`` with the ranks."""
    write_table(costs.rows, folder / COST_ROWS)
    text = json.dumps(replace_nonfinite(cost_record(costs)), indent=1, allow_nan=False)
    write_output(folder / COST_TABLE, text)


def cost_record(costs: EngineCosts) -> dict[str, Any]:
    """What ``cost.json`` has: all but the settings; an interval is a list of three numbers."""
    return {
        "machine": asdict(costs.machine),
        "busy": costs.busy,
        "budget": costs.budget,
        "spread": costs.spread,
        "cases": [
            {"case": one.case, "duration": one.duration, "motion": one.motion}
            for one in costs.cases
        ],
        "engines": [asdict(one) for one in costs.engines],
        "ranks": {
            kind: {
                number(error): {
                    "engines": [asdict(one) for one in costs.ranked(kind, error)],
                    "cases": [asdict(one) for one in costs.standings(kind, error)],
                }
                for error in RANKED_ERRORS
            }
            for kind in costs.kinds
        },
    }
