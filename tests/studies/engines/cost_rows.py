"""A made-up comparison of engines at equal cost whose errors and processor times are formulas."""

from dataclasses import replace

from proofmass.studies.engines.cost import ComparedEngine, EngineCosts, MachineLoad
from proofmass.studies.engines.ranking import ComparedCase
from proofmass.studies.record import StudyRow
from tests.studies.trade.trade_rows import SPAN, series_rows


def timed(engine: str, cost: float, **more: object) -> list[StudyRow]:
    """Rows of second order whose timings differ by 2 %, measured on a loaded machine."""
    rows = series_rows(engine, engine, 2.0, 100.0, cost=cost)
    return [
        replace(
            row,
            repeats=(row.seconds, 1.02 * row.seconds),
            machine="Processor x 2",
            load=4.0,
            **more,  # type: ignore[arg-type]
        )
        for row in rows
    ]


def compared(*rows: list[StudyRow]) -> EngineCosts:
    """A comparison of engines in a case."""
    refused = StudyRow("trade", "fourbar", "dynamics", "box2d", "Box2D", "timestep", 1e-3)
    refused = replace(refused, outcome="unsupported", message="link <b> & its ball joint")
    every = tuple(row for own in [*rows, [refused]] for row in own)
    engines = [
        ComparedEngine("mujoco", "MuJoCo", 9, 1, float("nan"), 0.0, ""),
        ComparedEngine("drake", "Drake", 9, 1, 1.5, 0.25, "half step", "loops as springs", "none"),
        ComparedEngine("box2d", "Box2D", 1, 1, 0.3, 0.0, "half step"),
    ]
    machine = MachineLoad("Processor x 2", 2, 1.5, 3.5, 4.0, 4.0)
    return EngineCosts([ComparedCase("fourbar", SPAN, every)], engines, machine, 0.5)
