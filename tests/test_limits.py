"""Sweeps that meet a limit position or hold something twice: said, and nothing lost."""

import numpy as np
import pytest

from proofmass.check import check

LIMIT = np.arccos((4 + 9 - 4.5**2) / 12)
"""Crank angle [rad] at which coupler and rocker of (2, 2, 2.5, 3) are in line: 2.219516."""


@pytest.mark.parametrize("reference", ["fourbar", "planar"])
@pytest.mark.parametrize("solver", ["mujoco", "pymunk"])
def test_a_sweep_across_a_limit_position_stops_there(solver, reference, models, edit):
    edit("triple_rocker.toml", r"from = -2.0\nto = 2.0 .*\nperiod = 8.0", "from = -2.0\nto = 2.6")
    edit("triple_rocker.toml", r'solvers = \["mujoco", .*', f'solvers = ["{solver}"]')
    if reference == "planar":
        edit("triple_rocker.toml", r'(?s)reference = "fourbar"\n.*\[drive\]',
             'reference = "planar"\n[drive]')
        edit("triple_rocker.toml", r'(?m)^("?)([\w.]+)\1 = \{ equals = "\w+"',
             r'"\2" = { equals = "\2"')
    result = check([models / "triple_rocker.toml"])
    assert result.exit_code == 2
    curves = result.curves["triple_rocker", "sweep", solver]
    assert curves.x.size == np.searchsorted(np.linspace(-2.0, 2.6, 201), LIMIT)
    kept = [c for c in result.comparisons if c.run == "sweep"]
    assert {c.outcome for c in kept} <= {"agrees", "unsupported"}
    assert "agrees" in {c.outcome for c in kept}
    said = next(str(e) for e in result.errors if "sweep ends at sample" in str(e))
    assert f"the {solver} sweep ends at sample {curves.x.size} of 201, which are kept" in said
    assert "crank = 2.2" in said
    assert "open by" in said


@pytest.mark.parametrize("solver", ["mujoco", "pymunk"])
def test_over_constrained_loops_are_named(solver, models, edit):
    """A second pin in the place of the first holds nothing that is not held."""
    edit("fourbar.xml", r'(<connect name="pin" .*/>)',
         r'\1\n    <connect name="again" site1="coupler_end" site2="rocker_end"/>')
    edit("fourbar.toml", r'solvers = \["mujoco", .*', f'solvers = ["{solver}"]')
    result = check([models / "fourbar.toml"])
    assert result.exit_code == 2
    assert any("over-constrained" in str(e) and "'again'" in str(e) for e in result.errors)
