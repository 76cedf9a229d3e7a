"""Drake in an interpreter of its own: order, readings, the ground, what it lacks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from proofmass.run.solve import prescribed_run
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.verdict.compare import compare
from tests.engines import why_not_there
from tests.shipped import shipped, shipped_case


@pytest.fixture(scope="module", autouse=True)
def provided() -> None:
    """The packages of the engine."""
    if why := why_not_there("drake"):
        pytest.skip(why)


def simulate(name: str, **settings: object) -> Curves:
    """The run of a shipped case with settings."""
    case = shipped_case(shipped(f"{name}.toml"))
    run = replace(prescribed_run(case, "dynamics"), settings=settings)
    return engine_of("drake").simulate(case.model_path, run)


def error(name: str, unit: str, curves: Curves | None = None, **settings: object) -> float:
    """Largest error of the channels with a unit, as a share of the range of the reference."""
    case = shipped_case(shipped(f"{name}.toml"))
    curves = curves or simulate(name, **settings)
    found = compare(case, "dynamics", "drake", curves, detectable=False)
    channels = case.channels_of("dynamics")
    shares = [c.relative_to_range for c in found if channels[c.channel].si_unit == unit]
    return float(np.nanmax(shares))


SLACK = """
<mujoco>
  <worldbody>
    <site name="hook" pos="0 0 1"/>
    <body name="bob">
      <joint name="rail" type="slide" axis="0 0 1"/>
      <geom type="sphere" size="0.1"/>
      <site name="eye"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="cord" stiffness="100" springlength="0 2">
      <site site="hook"/>
      <site site="eye"/>
    </spatial>
  </tendon>
  <sensor><jointpos name="height" joint="rail"/></sensor>
</mujoco>
"""


@pytest.mark.parametrize(("reading", "order"), [("plain", 1), ("half step", 2)])
def test_a_rate_in_the_middle_of_steps_is_of_second_order(reading: str, order: int) -> None:
    """The steps of a tree are leapfrog steps if they are read so."""
    steps = 5e-3, 2.5e-3  # two and four from sample to sample
    coarse, fine = (error("pendulum", "rad", reading=reading, timestep=step) for step in steps)
    assert coarse / fine == pytest.approx(2.0**order, rel=0.1)


def test_a_velocity_of_a_point_is_of_second_order_too() -> None:
    """It belongs to the pose in the middle of a step: the wheel's centre is beside its axis."""
    assert error("gear_pair", "m/s") < 1e-5


def test_a_loop_is_solved_with_first_order() -> None:
    """Coriolis forces are those of the rates at the beginning of a step, in whichever reading."""
    coarse, fine = (error("fourbar_released", "rad", timestep=step) for step in (2e-3, 1e-3))
    assert coarse / fine == pytest.approx(2.0, rel=0.1)


def test_a_driven_loop_begins_as_open_as_it_is_in_motion() -> None:
    """Half a step back it is open so far that the first accelerations are right."""
    assert error("fourbar", "rad/s^2") < 1e-3
    assert error("fourbar", "rad/s^2", reading="plain") > 0.1


def test_a_tree_in_continuous_time_has_the_accuracy_of_the_integrator() -> None:
    """The error is that of its tolerance, over 10 s."""
    assert error("pendulum", "rad", scheme="continuous") < 1e-7


@pytest.mark.slow
def test_a_loop_with_the_ground_is_solved() -> None:
    """Constraints with the world itself end Drake with signal 11."""
    curves = simulate("bricard")
    assert curves.violation < 1e-4
    assert error("bricard", "m", curves) < 0.05


def test_a_loop_in_continuous_time_is_refused() -> None:
    """The solver of constraints is that of discrete steps."""
    with pytest.raises(Unsupported, match="continuous"):
        simulate("fourbar", scheme="continuous")


def test_a_drive_in_continuous_time_is_refused() -> None:
    """Its torque would be constant in a step, which is of first order."""
    with pytest.raises(Unsupported, match="free trees with linear springs"):
        simulate("driven_cart", scheme="continuous")


def test_a_slack_cord_does_not_pull(tmp_path: Path) -> None:
    """The bob falls freely; in continuous time cords are refused."""
    model = tmp_path / "cord.xml"
    model.write_text(SLACK)
    run = Run("dynamics", np.linspace(0.0, 0.1, 11), channels=("height",))
    fallen = engine_of("drake").simulate(model, run).channels["height"]
    assert fallen == pytest.approx(-0.5 * 9.81 * run.x**2, abs=1e-9)
    with pytest.raises(Unsupported, match="continuous time"):
        engine_of("drake").simulate(model, replace(run, settings={"scheme": "continuous"}))


def test_dry_friction_is_a_motor_with_a_limit() -> None:
    """A turn of a pendulum is up to a step of 0.25 ms late."""
    assert error("pendulum_friction", "rad") < 1e-3
    assert error("slider_crank_released", "rad") < 1e-3


@pytest.mark.parametrize("name", ["pendulum_friction", "block_slides"])
def test_friction_in_continuous_time_is_refused(name: str) -> None:
    """The integrator has neither contacts nor motors with a limit."""
    with pytest.raises(Unsupported, match="continuous time"):
        simulate(name, scheme="continuous")


def test_dry_friction_in_a_sweep_is_refused() -> None:
    """The motor creeps while it holds: in many steps to a rest by a hundredth of the range."""
    case = shipped_case(shipped("shaft_pendulum.toml"))
    with pytest.raises(Unsupported, match="friction of joint 'pendulum' in a sweep"):
        engine_of("drake").simulate(case.model_path, prescribed_run(case, "sweep"))
