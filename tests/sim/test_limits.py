"""Tests of sweeps that meet a limit position, and of redundant constraints.

Both are reported, and the samples before a limit position are kept.
"""

from dataclasses import replace

import numpy as np
import pytest

from proofmass.batch.check import check
from proofmass.case.drive import Steady
from proofmass.reference.mobility import mobility
from proofmass.run.sidecar import load_case
from proofmass.run.solve import call_engine
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Drive, Run
from tests.shipped import shipped

LIMIT_ANGLE = np.arccos((4 + 9 - 4.5**2) / 12)
"""Crank angle [rad] at which coupler and rocker are in line, for links of 2, 2, 2.5 and 3 m:
2.219516."""


@pytest.mark.parametrize("reference", ["fourbar", "planar"])
@pytest.mark.parametrize("solver", ["mujoco", "pymunk"])
def test_a_sweep_across_a_limit_position_stops_there(solver, reference, models, edit, keep_solver):
    edit("triple_rocker.toml", r"from = -2.0\nto = 2.0 .*\nperiod = 8.0", "from = -2.0\nto = 2.6")
    keep_solver("triple_rocker.toml", solver)
    if reference == "planar":
        edit(
            "triple_rocker.toml",
            r'(?s)reference = "fourbar"\n.*\[drive\]',
            'reference = "planar"\n[drive]',
        )
        edit(
            "triple_rocker.toml",
            r'(?m)^("?)([\w.]+)\1 = \{ ?equals = "\w+"',
            r'"\2" = { equals = "\2"',
        )
    result = check([models / "triple_rocker.toml"], detectable=False, causes=False)
    assert result.exit_code == 2
    curves = result.curves["triple_rocker", "sweep", solver]
    assert curves.x.size == np.searchsorted(np.linspace(-2.0, 2.6, 201), LIMIT_ANGLE)
    kept = [c for c in result.comparisons if c.run == "sweep"]
    assert {c.outcome for c in kept} <= {"agrees", "unsupported"}
    assert "agrees" in {c.outcome for c in kept}
    message = next(str(e) for e in result.errors if "sweep ends at sample" in str(e))
    assert f"the {solver} sweep ends at sample {curves.x.size} of 201, which are kept" in message
    assert "crank = 2.2" in message
    assert "open by" in message


@pytest.mark.parametrize("engine", ["mujoco", "pymunk"])
def test_a_sweep_that_ends_early_keeps_two_samples_or_is_an_error(engine):
    """One sample is no curve."""
    drive = Drive("crank", Steady(-2.0, 1.0, x_is_time=False))
    run = Run("sweep", np.array([-2.0, LIMIT_ANGLE - 0.01, LIMIT_ANGLE + 0.01]), (), (drive,))
    curves = call_engine(engine, shipped("triple_rocker.xml"), run)
    assert curves.x.tolist() == run.x[:2].tolist()
    assert "open by" in curves.stopped
    with pytest.raises(BadModel, match="open by"):
        call_engine(engine, shipped("triple_rocker.xml"), replace(run, x=run.x[[0, 2]]))


@pytest.mark.parametrize(
    ("name", "dof"),
    {
        "fourbar": 1,
        "fivebar": 2,
        "slider_crank": 1,
        "inverted_slider_crank": 2,  # as printed
        "inverted_slider_crank_classic": 1,
        "threeprr": 3,
        "watt": 1,
        "stephenson": 1,
        "peaucellier": 1,  # Gruebler: 3 (n - 1) - 2 p, with n links and p pairs of one freedom
        "pendulum": 1,
        "change_point": 1,
    }.items(),
)
def test_degrees_of_freedom_are_those_of_grueblers_formula(name, dof):
    """Printed degrees of freedom are those of B. Diaz Lozano 2019, lines 1180, 2320, 3023, 3450."""
    assert mobility(load_case(shipped(f"{name}.toml"))) == dof


@pytest.mark.parametrize("solver", ["mujoco", "pymunk"])
def test_redundant_constraints_are_refused_by_name(solver, models, edit, keep_solver):
    """A second pin at the place of the first adds only redundant constraints, which are named."""
    edit(
        "fourbar.xml",
        r'(<connect name="pin" .*/>)',
        r'\1\n    <connect name="again" site1="coupler_end" site2="rocker_end"/>',
    )
    keep_solver("fourbar.toml", solver)
    result = check([models / "fourbar.toml"], detectable=False, causes=False)
    assert result.exit_code == 2
    assert any("over-constrained" in str(e) and "'again'" in str(e) for e in result.errors)


REDUNDANT_FOURBAR = """title = "Four-bar with a second pin"
source = "bars of 1, 2, 2.5 and 3 m"
reference = "spatial"
model = "fourbar.xml"
[drive]
joint = "crank"
to = 3.141592653589793
[run.sweep]
n = 3
solvers = ["mujoco", "pymunk"]
[channels]
rocker = {}
"""


def test_the_spatial_reference_covers_redundant_loops_in_a_plane(models, edit):
    """With the crank at 0 and pi the crank pin is 2 and 4 m from the rocker's pivot.

    The rocker's angle then follows from the law of cosines, with a coupler of 2 m and a rocker of
    2.5 m; engines and reference differ from it by rounding.
    """
    edit(
        "fourbar.xml",
        r'(<connect name="pin" .*/>)',
        r'\1\n    <connect site1="coupler_end" site2="rocker_end"/>',
    )
    sidecar = models / "redundant.toml"
    sidecar.write_text(REDUNDANT_FOURBAR)
    result = check([sidecar], detectable=False, causes=False)
    assert result.exit_code == 0
    apart = np.array([2.0, 4.0])
    angle = np.pi - np.arccos((2.5**2 + apart**2 - 2.0**2) / (2 * 2.5 * apart))
    for solver in ("mujoco", "pymunk"):
        found = result.curves["redundant", "sweep", solver].channels["rocker"]
        np.testing.assert_allclose(found[[0, -1]], angle, rtol=1e-12)
    edit("redundant.toml", "spatial", "planar")
    (error,) = check([sidecar], detectable=False, causes=False).errors
    assert "'pin', 'coupler_end to rocker_end' give 4 equations" in str(error)
