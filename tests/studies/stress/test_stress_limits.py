"""The benchmark that holds printed limits against programs in bare engines."""

from dataclasses import replace

import pytest

from benchmarks.limits import CONFIRMED, confirm, printed_limits
from proofmass.studies.store import Store

PAGE = """
## pendulum

| parameter | from | solver | boundary | theory | how it breaks |
|---|---|---|---|---|---|
| time step | 1e-3 | mujoco, Euler | 0.14 s |  | inaccurate, in silence: off |
| gravity | 1 | mujoco, as in the model | none to 1e6 times |  |  |
| spring in rocker | 1 | pymunk, as in the model | nowhere |  | inaccurate: at 1 already |
| steps | 1 | pymunk, as in the model | not known beyond 9 |  | ours: timed out |
| drive's way | 1 | mujoco, sweep | 3 rad |  | inaccurate: off |
"""


def test_limits_of_runs_in_time_are_read_and_no_others():
    (one,) = printed_limits(PAGE)
    assert (one.case, one.engine, one.setting, one.value) == ("pendulum", "mujoco", "Euler", 0.14)


@pytest.mark.parametrize(
    ("factor", "result"),
    [(1.0, CONFIRMED), (0.95, "holds beyond it"), (1.05, "fails before it")],
)
def test_a_limit_that_is_5_percent_off_is_found(factor, result, tmp_path):
    (one,) = printed_limits(PAGE)
    (found,) = confirm([replace(one, value=factor * one.value)], Store(tmp_path))
    assert found.result == result
