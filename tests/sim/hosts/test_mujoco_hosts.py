"""MuJoCo in interpreters of its own; MJX and MuJoCo Warp, which take long to compile, by hand."""

import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.sim.engines import engine_of
from proofmass.sim.hosts.engine import About
from proofmass.sim.mujoco.hosted import HostedMujoco
from proofmass.sim.protocol.failures import Diverged
from proofmass.sim.protocol.run import Run
from proofmass.studies.cells import Cell
from tests.engines import why_not_there
from tests.shipped import shipped, shipped_case

UNSTABLE = """<mujoco><option timestep="0.02"/><worldbody>
<body name="a"><joint name="a" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".5" contype="0" conaffinity="0"/>
</body></worldbody>
<actuator><velocity joint="a" kv="2"/></actuator>
<sensor><jointpos name="a" joint="a"/></sensor>
<keyframe><key name="start" qpos=".5"/></keyframe></mujoco>"""


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


def test_a_restart_of_mujoco_is_the_end_of_the_run(tmp_path: Path) -> None:
    """After a bad acceleration MuJoCo starts again: the run ends there, as in the product's own.

    The damping 2 N m s over the inertia of about 0.007 kg m2 allows Euler steps of 7 ms.
    """
    file = tmp_path / "unstable.xml"
    file.write_text(UNSTABLE)
    run = Run("dynamics", np.linspace(0.0, 1.0, 51), channels=("a",), start="start")
    here = HostedMujoco(
        "mujoco_c.py", (f"mujoco=={mujoco.__version__}",), title="MuJoCo", about=About("", "")
    )
    here.python = sys.executable
    ends = []
    for engine in (here, engine_of("mujoco")):
        with pytest.raises(Diverged, match="MuJoCo warning badqacc") as end:
            engine.simulate(file, run)
        ends.append(end.value.curves)
    assert 2 < len(ends[0].x) < 51
    assert np.isfinite(ends[0].channels["a"]).all()
    assert (np.diff(np.abs(ends[0].channels["a"])) != 0).any()
