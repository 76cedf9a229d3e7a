"""Tests of slides: driven slides in both engines against an inverse closed form, and stops."""

import numpy as np
import pytest

from proofmass.sim.mujoco import engine as with_mujoco
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk import engine as with_pymunk
from tests.shipped import shipped

HACKSAW = shipped("hacksaw.xml")
CRANK_LENGTH, COUPLER_LENGTH, OFFSET = 0.075, 0.17, 0.045
FIRST_POSITION, STROKE = -0.09, 0.13  # within the slider's limits -0.0837 and -0.2408 m


def out_and_back(t):
    """Slider position [m], velocity, acceleration: away from the crank and back in 2 pi."""
    half = STROKE / 2
    return FIRST_POSITION - half * (1 - np.cos(t)), -half * np.sin(t), -half * np.cos(t)


def crank_angle(x):
    """Crank angle [rad] of a slider position, from the triangle of crank axis and both pins."""
    reach = np.hypot(x, OFFSET)
    inner = np.arccos((CRANK_LENGTH**2 + reach**2 - COUPLER_LENGTH**2) / (2 * CRANK_LENGTH * reach))
    return np.arctan2(OFFSET, x) - inner


def run_of(kind: str, dt: float = 1e-3) -> Run:
    return Run(
        kind,
        np.linspace(0, 2 * np.pi, 201),
        ("theta2", "theta2_rate"),
        (Drive("slider", out_and_back),),
        settings={"timestep": dt},
    )


@pytest.mark.parametrize("engine", [with_mujoco, with_pymunk])
def test_sweep_of_a_driven_slide_is_the_inverse_closed_form(engine):
    curves = engine.simulate(HACKSAW, run_of("sweep"))
    truth = crank_angle(out_and_back(curves.x)[0])
    # rounding, times how fast the crank turns near the slider's limit
    np.testing.assert_allclose(curves.channels["theta2"], truth, atol=1e-11, rtol=0)


def test_a_driven_slide_is_second_order_in_pymunk():
    errors = []
    for dt in (2e-3, 1e-3):
        curves = with_pymunk.simulate(HACKSAW, run_of("dynamics", dt))
        errors.append(np.abs(curves.channels["theta2"] - crank_angle(curves.drive[0])).max())
    assert errors[1] < 1e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.2)  # terms of higher order


def test_a_driven_slide_in_mujoco_is_limited_by_soft_loops():
    curves = with_mujoco.simulate(HACKSAW, run_of("dynamics"))
    error = np.abs(curves.channels["theta2"] - crank_angle(curves.drive[0])).max()
    assert error < 1e-5  # constraint violation divided by the lever arm


SLIDES = """<mujoco><option gravity="0 -9.81 0" timestep="1e-3"><flag contact="disable"/></option>
  <worldbody><body name="base"><joint name="base" type="slide" axis="1 0 0"/>
  <inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/><body name="block">
  <joint name="drop" type="slide" axis="0 1 0" range="-0.5 0.2" limited="true"/>
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></body></worldbody>
  <sensor><jointpos name="drop" joint="drop"/></sensor></mujoco>"""


def test_a_slide_falls_freely_to_its_stop_and_rests_there(tmp_path):
    file = tmp_path / "slider.xml"
    file.write_text(SLIDES)
    curves = with_pymunk.simulate(file, Run("dynamics", np.linspace(0, 2, 201), ("drop",)))
    drop, hit = curves.channels["drop"], np.sqrt(2 * 0.5 / 9.81)
    free = curves.x < hit - 0.01
    # the error is proportional to dt^2
    np.testing.assert_allclose(drop[free], -9.81 / 2 * curves.x[free] ** 2, atol=1e-6)
    # the block enters the stop by g dt^2 over the share of a violation that a step corrects
    assert drop[-1] == pytest.approx(-0.5, abs=1e-3)


def test_a_driven_slide_leaves_the_slide_that_carries_it_at_rest(tmp_path):
    file = tmp_path / "slider.xml"
    file.write_text(SLIDES.replace("</sensor>", '<jointpos name="base" joint="base"/></sensor>'))
    run = Run(
        "dynamics",
        np.linspace(0, 1, 11),
        ("drop", "base"),
        (Drive("drop", lambda t: (t**2, 2 * t, 2 + 0 * t)),),
    )
    curves = with_pymunk.simulate(file, run)
    np.testing.assert_allclose(curves.channels["drop"], run.x**2, atol=1e-14, rtol=0)  # rounding
    np.testing.assert_allclose(curves.channels["base"], 0, atol=1e-14)


def test_a_driven_slide_carries_only_forces_along_it(tmp_path):
    """A block of 2 kg rests on an incline of 30 degrees; its centre of mass is off the guide."""
    file = tmp_path / "incline.xml"
    file.write_text("""<mujoco><option gravity="0 -9.81 0"/><worldbody><body euler="0 0 30">
      <joint name="s" type="slide" axis="1 0 0"/>
      <inertial pos=".3 .2 0" mass="2" diaginertia="1 1 1"/></body></worldbody>
      <sensor><jointactuatorfrc name="force" joint="s"/></sensor></mujoco>""")
    run = Run(
        "sweep", np.linspace(0, 1, 3), ("force",), (Drive("s", lambda x: (x, 1 + 0 * x, 0 * x)),)
    )
    force = with_pymunk.simulate(file, run).channels["force"]
    np.testing.assert_allclose(force, 2 * 9.81 * 0.5, rtol=1e-12)  # rounding
