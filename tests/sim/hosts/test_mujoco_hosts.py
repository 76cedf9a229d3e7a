"""MJX and MuJoCo Warp, which take long to compile: run by hand."""

import pytest

from proofmass.studies.cells import Cell
from tests.engines import why_not_there
from tests.shipped import shipped, shipped_case


def cell(name: str, engine: str):
    """The run in time of a case, if the engine can be had."""
    if why := why_not_there(engine):
        pytest.skip(why)
    return Cell(shipped_case(shipped(f"{name}.toml")), "dynamics", engine).measure()[0]


@pytest.mark.slow
def test_mjx_is_mujoco_on_a_tree() -> None:
    """In double precision, without loops, RK4 is the same to rounding; compilation is apart."""
    found, own = cell("pendulum", "mjx"), cell("pendulum", "mujoco")
    assert found.position == pytest.approx(own.position, rel=1e-3)
    assert found.compile_seconds > found.seconds
    assert "acceleration" in found.missing


@pytest.mark.slow
def test_warp_has_single_precision() -> None:
    """Its error is rounding of 24 bits, 6e-8, which adds up to less than the number of steps."""
    found = cell("fourbar_released", "mujoco_warp")
    assert 1e-7 < found.position < 2000 * 6e-8


@pytest.mark.slow
def test_mjx_has_no_drift_term() -> None:
    """Its loops are as far off as those of MuJoCo before 3.7, which left J-dot-v out."""
    found, old = cell("fourbar_released", "mjx"), cell("fourbar_released", "mujoco==3.6.0")
    assert found.position == pytest.approx(old.position, rel=0.01)
