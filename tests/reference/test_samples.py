"""The samples of a run, from its sidecar."""

import numpy as np
import pytest

from proofmass.reference.find import load_reference
from proofmass.reference.samples import run_samples
from tests.reference.stubs import (
    PENDULUM,
    RECORDED,
    ROD,
    with_drives,
    with_run_table,
    with_tables,
)


def test_a_recorded_curve_is_sampled_where_it_was_recorded():
    for kind in RECORDED.run:
        times = load_reference(RECORDED).table.values("t")
        np.testing.assert_array_equal(run_samples(RECORDED, kind), times)


def test_a_free_motion_is_sampled_from_its_start_to_its_last_time():
    np.testing.assert_allclose(
        run_samples(with_run_table(PENDULUM, "dynamics", n=5, until=2.0), "dynamics"),
        [0.0, 0.5, 1.0, 1.5, 2.0],
        rtol=0,
        atol=1e-15,
    )


@pytest.mark.parametrize(
    ("drive", "kind", "until", "expected"),
    [
        # a sweep is sampled by the drive's value, dynamics by time until the drive is there
        ({"from": -2.0, "to": 1.0, "rate": 0.5}, "sweep", None, (-2.0, -0.5, 1.0)),
        ({"from": -2.0, "to": 1.0, "rate": 0.5}, "dynamics", None, (0.0, 3.0, 6.0)),
        ({"from": -2.0, "to": 0.0, "rate": 0.5}, "sweep", None, (-2.0, -1.0, 0.0)),
        ({"from": -2.0, "to": 0.0, "rate": 0.5}, "dynamics", None, (0.0, 2.0, 4.0)),
        # a drive with a period or a profile is sampled by time in both runs: over one period,
        # until the profile's last time, or until that of the run
        ({"to": 1.0, "period": 8.0}, "sweep", None, (0.0, 4.0, 8.0)),
        ({"to": 1.0, "period": 8.0}, "dynamics", 2.0, (0.0, 1.0, 2.0)),
        ({"profile": "circle", "until": 6.0}, "dynamics", None, (0.0, 3.0, 6.0)),
        ({"profile": "circle", "until": 6.0}, "sweep", 2.0, (0.0, 1.0, 2.0)),
    ],
)
def test_a_driven_run_is_sampled_by_the_drive_or_by_time(drive, kind, until, expected):
    case = with_run_table(with_drives(drive), kind, n=3, until=until)
    np.testing.assert_allclose(run_samples(case, kind), expected, rtol=0, atol=1e-15)


def test_an_equilibrium_is_sampled_along_the_shortest_rod_or_to_a_length():
    rod = ROD.rod["rod"]
    rods = {
        "long": rod.model_copy(update={"length": 3.0}),
        "short": rod.model_copy(update={"length": 2.0}),
    }
    np.testing.assert_allclose(
        run_samples(with_run_table(with_tables(ROD, rod=rods), "equilibrium", n=3), "equilibrium"),
        [0, 1, 2],
    )
    np.testing.assert_allclose(
        run_samples(with_run_table(ROD, "equilibrium", n=3, until=0.5), "equilibrium"),
        [0, 0.25, 0.5],
    )
