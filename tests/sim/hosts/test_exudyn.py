"""Exudyn in an interpreter of its own: order, starts, redundant constraints, what it lacks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from proofmass.run.solve import prescribed_run
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Diverged, Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.verdict.compare import compare
from tests.engines import why_not_there
from tests.shipped import shipped, shipped_case

CHAIN = """
<mujoco>
  <worldbody>
    <body name="bob">
      <joint name="socket" type="ball"/>
      <geom type="sphere" size="0.1" contype="0" conaffinity="0"/>
      <body name="tail" pos="0 0 -1">
        <joint name="pin" axis="0 1 0"/>
        <geom type="sphere" size="0.1" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <sensor><jointpos name="bend" joint="pin"/></sensor>
</mujoco>
"""


@pytest.fixture(scope="module", autouse=True)
def provided() -> None:
    """The packages of the engine."""
    if why := why_not_there("exudyn"):
        pytest.skip(why)


def simulate(name: str, **settings: object) -> Curves:
    """The run of a shipped case with settings."""
    case = shipped_case(shipped(f"{name}.toml"))
    run = replace(prescribed_run(case, "dynamics"), settings=settings)
    return engine_of("exudyn").simulate(case.model_path, run)


def error(name: str, unit: str, curves: Curves | None = None, **settings: object) -> float:
    """Largest error of the channels with a unit, as a share of the range of the reference."""
    case = shipped_case(shipped(f"{name}.toml"))
    curves = curves or simulate(name, **settings)
    found = compare(case, "dynamics", "exudyn", curves, detectable=False)
    channels = case.channels_of("dynamics")
    shares = [c.relative_to_range for c in found if channels[c.channel].si_unit == unit]
    return float(np.nanmax(shares))


@pytest.mark.parametrize("scheme", ["trapezoidal", "generalized alpha"])
def test_a_loop_is_solved_with_second_order(scheme: str) -> None:
    """Half a step has a quarter of the error."""
    coarse, fine = (
        error("fourbar_released", "rad", scheme=scheme, timestep=step) for step in (2e-3, 1e-3)
    )
    assert coarse / fine == pytest.approx(4.0, rel=0.15)


def test_a_driven_loop_begins_with_its_accelerations() -> None:
    """The undamped rule keeps an error of the start: with defaults the engine's own remains."""
    assert error("double_rocker", "rad/s^2") < 1e-5
    assert error("double_rocker", "rad/s^2", defaults=True) > 1e-4


@pytest.mark.slow
def test_redundant_constraints_are_said() -> None:
    """The six hinges in space have two equations too many."""
    curves = simulate("bricard")
    assert "redundant" in " ".join(curves.notes)
    assert curves.violation < 1e-5
    assert error("bricard", "m", curves) < 1e-4


def test_defaults_end_at_redundant_constraints() -> None:
    """The engine's own solver finds its matrix singular."""
    with pytest.raises(Diverged, match="does not converge"):
        simulate("bricard", defaults=True)


@pytest.mark.slow
def test_rule_without_damping_leaves_the_branch_at_a_change_point() -> None:
    """Constraints of velocities alone do not know the branch; those of positions do."""
    assert error("change_point", "m", scheme="generalized alpha") < 1e-10
    assert error("change_point", "m", scheme="trapezoidal") > 0.1


def test_a_joint_behind_a_ball_is_refused_by_name(tmp_path: Path) -> None:
    """The tree has hinges and slides only, and stands on the ground."""
    model = tmp_path / "chain.xml"
    model.write_text(CHAIN)
    run = Run("dynamics", np.linspace(0.0, 0.1, 11), channels=("bend",))
    with pytest.raises(Unsupported, match="'pin'"):
        engine_of("exudyn").simulate(model, run)
