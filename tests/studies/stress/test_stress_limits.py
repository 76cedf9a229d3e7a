"""The benchmark that compares the limits of docs/stress.md with programs in bare engines."""

from dataclasses import replace

import pytest

from benchmarks import ROOT
from benchmarks.limits import (
    CONFIRMED,
    PrintedLimit,
    ProgramStudy,
    confirm,
    is_confirmed,
    kept_cells,
    printed_limits,
    rows_of,
    try_sides,
)
from benchmarks.stress import with_rows
from proofmass.studies.store import Store
from proofmass.studies.stress.boundary import Boundary, BoundaryKind, Failure, TrialResult
from proofmass.studies.stress.limit_search import LimitSearch

PAGE = """
## pendulum

| parameter | from | solver | boundary | theory | how it breaks |
|---|---|---|---|---|---|
| time step | 1e-3 | mujoco, Euler | 0.14 s |  | inaccurate, in silence: off |
| gravity | 1 | mujoco, as in the model | none to 1e6 times |  |  |
| spring in rocker | 1 | pymunk, as in the model | nowhere |  | inaccurate: at 1 already |
| steps | 1 | pymunk, as in the model | not known beyond 9 |  | ours: timed out |
| drive's way | 1 | mujoco, sweep | 3 rad |  | inaccurate: off |
| time step | 1 | mujoco, RK4 | 0.25 to 0.3 s |  | inaccurate: off |
"""


def test_only_limits_of_runs_with_time_steps_are_read():
    one, several = printed_limits(PAGE)
    assert one.again != one.again
    assert (several.value, several.again) == (0.25, 0.3)
    assert (one.case, one.engine, one.setting, one.value) == ("pendulum", "mujoco", "Euler", 0.14)


@pytest.mark.parametrize(
    ("factor", "result"),
    [(1.0, CONFIRMED), (0.95, "holds beyond it"), (1.05, "fails before it")],
)
def test_a_limit_that_is_5_percent_off_is_found(factor, result, tmp_path):
    one, _ = printed_limits(PAGE)
    (found,) = confirm([replace(one, value=factor * one.value)], ProgramStudy(Store(tmp_path)))
    assert found.result == result


@pytest.mark.parametrize(
    ("factors", "result"),
    [
        ((1.015, 1.1), "fails at its last value"),
        ((0.985, 1.015), "holds at its first value"),
        ((0.9, 0.95), "holds beyond it"),
        ((1.05, 1.1), "fails before it"),
    ],
)
def test_several_boundaries_that_are_wrong_are_found(factors, result, tmp_path):
    """The pendulum has one boundary, beyond which no value holds again."""
    one, _ = printed_limits(PAGE)
    first, last = (factor * one.value for factor in factors)
    (found,) = confirm([replace(one, value=first, again=last)], ProgramStudy(Store(tmp_path)))
    assert found.result == result


@pytest.mark.parametrize(("again", "result"), [(16.0, CONFIRMED), (15.0, "holds beyond it")])
def test_no_value_beyond_the_range_of_stress_has_to_fail(again, result):
    """Values from 3.9 to 4.3 fail, and no others."""

    def trial(x: float) -> TrialResult:
        return TrialResult(Failure("gone", BoundaryKind.UNSTABLE) if 3.9 <= x < 4.3 else None)

    search = LimitSearch("", "", "", "", "s", 1.0, 16.0, trial)
    limit = PrintedLimit("", "", "", "", 3.9, f"3.9 to {again:g} s", again)
    assert try_sides(limit, search).result == result


def test_the_rows_in_docs_are_those_of_the_printed_limits():
    """Limits of the energy, and of a drive until a rod snaps, have no program and no row."""
    stress, limits = (
        (ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("stress.md", "limits.md")
    )
    rows, printed = dict(rows_of(limits)), list(printed_limits(stress))
    there = [cells for one in printed if (cells := kept_cells(one, rows))]
    assert there == list(rows.values())
    assert {one.parameter for one in printed if one.key not in rows} == {
        "steps until the energy is off by 1 %",
        "drive's way until a rod snaps",
    }


def test_a_row_of_another_limit_is_not_kept():
    one, _ = printed_limits(PAGE)
    cells = [*one.key, "0.15 s", "holds", "off", CONFIRMED]
    with pytest.raises(SystemExit, match=r"0\.14 s, of which 0\.15 s was confirmed"):
        kept_cells(one, {one.key: cells})
    assert kept_cells(one, {}) == []
    assert not is_confirmed(one, {one.key: cells})
    assert not is_confirmed(one, {})
    cells[3] = "0.14 s"
    assert is_confirmed(one, {one.key: cells})
    assert not is_confirmed(one, {one.key: [*cells[:-1], "holds beyond it"]})


def test_new_rows_replace_only_the_rows_of_their_case():
    (row,) = (line for line in PAGE.splitlines() if line.startswith("| time step | 1e-3"))
    steps = Boundary(
        "pendulum", "mujoco", "Euler", "time step", "s", 1e-3, 1.0, 0.196, 0.2, again=0.25,
        limit=BoundaryKind.UNSTABLE, failure="gone",
    )  # fmt: skip
    new = "| time step | 1e-3 | mujoco, Euler | 0.2 to 0.25 s |  | unstable: gone |"
    assert with_rows(PAGE, "pendulum", [steps]) == PAGE.replace(row, new)
    other = PAGE.replace("pendulum", "fourbar") + PAGE
    assert with_rows(other, "pendulum", [steps]).count(new) == 1
    with pytest.raises(SystemExit, match=r"no row of pendulum for \('time step', 'mujoco, discr"):
        with_rows(PAGE, "pendulum", [replace(steps, setting="discrete")])
    (several, _) = printed_limits(with_rows(PAGE, "pendulum", [steps]))
    assert (several.value, several.again) == (0.2, 0.25)
