"""The accuracy that the engines state is neither too narrow nor too wide for what they show."""

from collections import defaultdict
from collections.abc import Iterable

import pytest

from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.run.sidecar import accuracy_units, load_case
from proofmass.run.solve import solve
from proofmass.sim.engines import engine_of
from proofmass.verdict.compare import compare
from tests.shipped import shipped, shipped_case, shipped_files

MAX_FACTORS = {"sweep": 30.0, "rest": 500.0}
"""Largest ratio of a limit to the largest error of the shipped cases: of rounding, which differs
between processors; and of the rates of an equilibrium, whose rounding grows with the inverse of its
least stiffness, which a model may have a hundred times smaller than the finger."""
MAX_STEP_FACTOR = 6.0
"""The same for errors of steps, which are the same on all machines; the cases differ in them by a
factor of two to three, since another mechanism has other accelerations for the same motion."""
LARGEST_ERRORS = {
    ("mujoco", "sweep"): "change_point",
    ("mujoco", "rest"): "finger",
    ("mujoco", "position"): "threeprr",
    ("mujoco", "velocity"): "threeprr",
    ("mujoco", "acceleration"): "double_crank_crossed",
    ("mujoco", "force"): "inverted_slider_crank_classic",
    ("pymunk", "sweep"): "change_point",
    ("pymunk", "position"): "fivebar",
    ("pymunk", "velocity"): "fivebar",
    ("pymunk", "acceleration"): "inverted_slider_crank_classic",
    ("pymunk", "force"): "threeprr",
}
"""Shipped cases that show nearly the largest error of each kind."""


def is_used(case: Case, kind: Kind, engine: str, part: str, units: Iterable[str]) -> bool:
    """Whether a case without other tolerances takes an engine's own limit for a part of a run."""
    limit = engine_of(engine).accuracy[part]
    return any(
        t.relative_to_range == limit.relative_to_range and t.why == limit.why
        for t in case.tolerance
        if t.is_for(kind, engine) and t.unit == tuple(units)
    )


def shown_errors(case: Case, wanted: Iterable[tuple[str, str]]) -> dict[tuple[str, str], float]:
    """The largest error, relative to the range, of the engines and parts that a case shows.

    Only runs and parts are counted that have the engine's own limit.
    """
    found: dict[tuple[str, str], float] = defaultdict(float)
    for kind, run in case.run.items():
        for engine in set(run.solvers) & {engine for engine, _ in wanted}:
            limits = engine_of(engine).accuracy
            parts = {
                part: units
                for part, units in accuracy_units(case, kind, limits).items()
                if (engine, part) in wanted and is_used(case, kind, engine, part, units)
            }
            if not parts:
                continue
            for one in compare(case, kind, engine, solve(case, kind, engine)):
                for part, units in parts.items():
                    if units == ("*",) or case.channels_of(kind)[one.channel].unit in units:
                        shown = found[engine, part], one.relative_to_range
                        found[engine, part] = max(shown)
    return dict(found)


def check_limit(engine: str, part: str, largest: float) -> None:
    """Assert that a limit is at least the largest error, and at most a factor above."""
    limit = engine_of(engine).accuracy[part].relative_to_range
    assert largest < limit <= MAX_FACTORS.get(part, MAX_STEP_FACTOR) * largest, (limit, largest)


@pytest.mark.parametrize(("engine", "part"), LARGEST_ERRORS)
def test_a_limit_is_near_the_largest_error(engine: str, part: str):
    case = shipped_case(shipped(f"{LARGEST_ERRORS[engine, part]}.toml"))
    check_limit(engine, part, shown_errors(case, {(engine, part)})[engine, part])


def test_every_limit_of_every_engine_is_held():
    stated = {
        (engine, part) for engine in ("mujoco", "pymunk") for part in engine_of(engine).accuracy
    }
    assert stated == set(LARGEST_ERRORS)


@pytest.mark.slow
def test_limits_are_near_the_largest_errors_of_all_cases():
    largest: dict[tuple[str, str], float] = defaultdict(float)
    for file in shipped_files():
        case = load_case(file)
        for place, error in shown_errors(case, set(LARGEST_ERRORS)).items():
            largest[place] = max(largest[place], error)
    assert set(largest) == set(LARGEST_ERRORS)
    for (engine, part), error in largest.items():
        check_limit(engine, part, error)
