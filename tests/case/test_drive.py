"""Motion profiles of drives, and the refusal of runs whose drives did not follow them."""

import sys

import numpy as np
import pytest

from proofmass.case.drive import (
    TABLE_TOLERANCE,
    FunctionProfile,
    InProportion,
    Steady,
    Swing,
    check_driven,
    quintic_spline,
    table_times,
)
from proofmass.case.profile import SampledProfile
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve_here
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Diverged
from proofmass.sim.protocol.run import Drive, Run
from tests.shipped import shipped

X = np.linspace(0.0, 2.0, 21)
DRIVES = Drive("far", Steady(0.0, 5.0, True)), Drive("still", Steady(0.3, 0.0, True))
"""A drive that moves by 10 rad, and one that does not move."""


def moved(drive: int, sample: int, error: float) -> tuple[Run, Curves]:
    """A run of two drives, and its curves with an error of a drive at one sample [rad]."""
    run = Run("dynamics", X, (), DRIVES)
    value, rate, acceleration = (np.array(part) for part in run.motion(X))
    value[drive, sample] += error
    return run, Curves(X, {}, drive=(value, rate, acceleration))


@pytest.mark.parametrize("drive", [0, 1])
@pytest.mark.parametrize("error", [0.49, -0.49])
def test_a_drive_may_be_off_by_a_twentieth_of_the_largest_range(drive, error):
    """The range is 10 rad, also for the drive that does not move."""
    check_driven(*moved(drive, 7, error))


@pytest.mark.parametrize(("drive", "name"), [(0, "far"), (1, "still")])
@pytest.mark.parametrize("error", [0.51, -0.51, np.nan])
def test_a_drive_that_is_off_at_a_single_sample_has_diverged(drive, name, error):
    run, curves = moved(drive, 7, error)
    with pytest.raises(Diverged, match=rf"joint '{name}' is at .* at x = 0.7") as found:
        check_driven(run, curves)
    assert found.value.curves is curves


def test_a_run_whose_crank_stands_still_is_refused(monkeypatch):
    """Its curves agree with the reference at the state that the crank had, so that this decides."""
    case = load_case(shipped("fourbar.toml"))

    def stand_still(engine, model, run):
        still = tuple(np.full_like(part, part[0, 0]) for part in run.motion(run.x))
        return Curves(run.x, {}, drive=still)

    monkeypatch.setattr(sys.modules[solve_here.__module__], "call_engine", stand_still)
    with pytest.raises(Diverged, match="joint 'crank' is at 0 where its drive leads it to"):
        solve_here(case, "dynamics", "mujoco")


def test_a_function_for_several_drives_gives_each_drive_its_row():
    def both(x):
        return tuple(np.array([k * x, -k * x]) for k in (1.0, 2.0, 3.0))

    found = FunctionProfile(both, row=1)(X)
    assert [part.tolist() for part in found] == [(-k * X).tolist() for k in (1.0, 2.0, 3.0)]


def test_a_drive_in_proportion_breaks_where_its_leader_breaks():
    rows = SampledProfile(np.array([0.0, 0.7, 1.0]), np.ones((2, 2)), "", "")
    assert InProportion(rows, 0.0, 2.0, 0.0).breaks.tolist() == [0.0, 0.7, 1.0]
    assert InProportion(Swing(0.0, 1.0, 1.0), 0.0, 2.0, 0.0).breaks.size == 0


def test_the_error_of_a_table_is_a_share_of_the_range_of_the_profile():
    """A swing by 1 um needs as many rows as one by 1 m, since its table has the same shape."""
    small, large = (table_times([Swing(0.0, way, 2.0)], X) for way in (1e-6, 1.0))
    np.testing.assert_array_equal(small, large)
    middle, swing = 0.5 * (large[1:] + large[:-1]), Swing(0.0, 1.0, 2.0)
    error = quintic_spline(large, *swing(large))(middle) - swing(middle)[0]
    assert np.abs(error).max() <= TABLE_TOLERANCE
