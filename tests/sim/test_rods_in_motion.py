"""Rods with mass in motion: what the verdicts on them notice."""

import pytest

from proofmass.check import check
from proofmass.compare import compare
from proofmass.sidecar import load_case
from proofmass.solve import solve


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("rod_released.toml", r"(?s)(\[rod.rod\].*stiffness = )0.25", r"\g<1>0.2525"),
        ("rod_released.toml", r"(?s)(\[rod.rod\].*mass = )0.1", r"\g<1>0.101"),
        ("rod_released.toml", r"(?s)(\[rod.rod\].*length = )1.0", r"\g<1>1.005"),
        ("rod_released.toml", "stiffness = 0.25     # N m2", "stiffness = 0.2525"),
        ("rod_released.toml", "segments = 20", 'segments = 20\nscheme = "naive"'),
        ("rod_released.xml", "0 -9.81 0", "0 9.81 0"),
        ("rod_released.xml", "0 -9.81 0", "0 -9.7 0"),
    ],
)
def test_another_rod_is_noticed(name, old, new, edit):
    """1 % of stiffness, mass or weight, 0.5 % of length, springs elsewhere, a sign."""
    sidecar = edit(name, old, new).with_suffix(".toml")
    case = load_case(sidecar)
    curves = solve(case, "dynamics", "mujoco")
    found = compare(case, "dynamics", "mujoco", curves, detectable=False)
    assert "differs" in {c.outcome for c in found}


def test_a_motion_that_is_not_resolved_is_an_error_of_its_parameters(edit):
    file = edit("rod_released.toml", "stiffness = 0.25     # N m2", "stiffness = 1e9")
    (error,) = check([file]).errors
    assert "rod_released.toml: parameters" in str(error)
    assert "too stiff to be followed so long" in str(error)
