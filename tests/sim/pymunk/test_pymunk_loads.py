"""Tests of constant loads in pymunk: motors on undriven joints, with a control in the start key."""

import numpy as np
import pytest

from proofmass.sim.mujoco import engine as with_mujoco
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk import engine as with_pymunk

CRANK, ROD = 1.0, 2.5
TURNING_CRANK = Drive("crank", lambda x: (x, 1 + 0 * x, 0 * x))


def bar(length: float, mass: float) -> str:
    """The MJCF of the inertia of a uniform bar along x, from length [m] and mass [kg]."""
    turn = mass * length**2 / 12
    return (
        f'<inertial pos="{length / 2} 0 0" mass="{mass}" diaginertia="{turn / 100} {turn} {turn}"/>'
    )


def model_text(bodies: str, more: str, qpos: str, ctrl: str) -> str:
    return f"""<mujoco><compiler angle="radian"/>
      <option gravity="0 0 0" integrator="RK4" timestep="1e-3"><flag contact="disable"/></option>
      <worldbody>{bodies}</worldbody>{more}
      <keyframe><key name="start" qpos="{qpos}" ctrl="{ctrl}"/></keyframe></mujoco>"""


def slider_crank_text(ctrl: str, motors: str) -> str:
    return model_text(
        f"""<body><joint name="crank"/>{bar(CRANK, 1)}<site name="a" pos="{CRANK} 0 0"/>
      </body><body><joint name="slider" type="slide" axis="1 0 0"/>
        <inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/>
        <body><joint name="rod"/><inertial pos="-1.25 0 0" mass="2" diaginertia=".01 1 1"/>
          <site name="b" pos="{-ROD} 0 0"/></body></body>""",
        f"""<equality><connect site1="a" site2="b"/></equality>
      <actuator><motor name="hold" joint="crank"/>{motors}</actuator>
      <sensor><actuatorfrc name="hold" actuator="hold"/><actuatorfrc name="load" actuator="load"/>
      </sensor>""",
        "0.5 3.3312 -0.1929",
        ctrl,
    )


def rod_angle(x):
    return np.arcsin(-CRANK / ROD * np.sin(x))


def slider_place(x):
    return CRANK * np.cos(x) + ROD * np.cos(rod_angle(x))


def derivative(function, x):
    return np.imag(function(x + 1e-30j)) / 1e-30


@pytest.mark.parametrize(
    ("motor", "ctrl", "force"),
    [
        ('<motor name="load" joint="slider"/>', "7 30", 30),
        (
            '<motor name="load" joint="slider" gear="2" ctrlrange="-9 9" ctrllimited="true"/>',
            "7 30",
            18,
        ),
        (
            '<motor name="load" joint="slider" gear="2" forcerange="-3 5" forcelimited="true"/>',
            "7 -30",
            -6,
        ),
    ],
)
def test_the_crank_balances_a_force_on_the_slider(motor, ctrl, force, tmp_path):
    """The holding moment is M = -F dx/dtheta; the control of the crank's motor has no effect."""
    file = tmp_path / "load.xml"
    file.write_text(slider_crank_text(ctrl, motor))
    run = Run("sweep", np.linspace(0.5, 6.5, 41), ("hold", "load"), (TURNING_CRANK,))
    got = with_pymunk.simulate(file, run).channels
    # rounding of impulses
    np.testing.assert_allclose(
        got["hold"], -force * derivative(slider_place, run.x), atol=1e-10, rtol=0
    )
    np.testing.assert_array_equal(got["load"], force / (2 if "gear" in motor else 1))


def test_the_crank_balances_a_moment_between_slider_and_rod(tmp_path):
    """A moment m on the hinge between two moving links gives the moment M = -m dphi/dtheta."""
    file = tmp_path / "load.xml"
    file.write_text(slider_crank_text("0 4", '<motor name="load" joint="rod"/>'))
    run = Run("sweep", np.linspace(0.5, 6.5, 41), ("hold",), (TURNING_CRANK,))
    got = with_pymunk.simulate(file, run).channels["hold"]
    np.testing.assert_allclose(got, -4 * derivative(rod_angle, run.x), atol=1e-10, rtol=0)


def test_the_boom_balances_a_force_in_the_cylinder(tmp_path):
    """A force F on the slide between two moving links gives the moment M = -F ds/dtheta.

    Centres of mass of both links are off the axis of the slide.
    """
    file = tmp_path / "load.xml"
    file.write_text(
        model_text(
            f"""<body><joint/>
        <inertial pos=".4 .2 0" mass="2" diaginertia=".1 .2 .2"/>
        <body><joint name="stroke" type="slide" axis="1 0 0"/><site name="eye"/>
          <inertial pos="-.1 .1 0" mass=".5" diaginertia=".01 .01 .01"/></body></body>
      <body pos="1 0 0"><joint name="crank"/>{bar(1.5, 3)}
        <site name="lug" pos="1.5 0 0"/></body>""",
            """<equality><connect site1="eye" site2="lug"/></equality>
      <actuator><motor name="load" joint="stroke"/></actuator>
      <sensor><jointactuatorfrc name="hold" joint="crank"/></sensor>""",
            ".98279 1.80278 1.5708",
            "50",
        )
    )
    run = Run("sweep", np.linspace(1.5708, 2.5, 21), ("hold",), (TURNING_CRANK,))
    got = with_pymunk.simulate(file, run).channels["hold"]
    stroke = derivative(lambda x: np.sqrt(1 + 1.5**2 + 3 * np.cos(x)), run.x)
    np.testing.assert_allclose(
        got, -50 * stroke, atol=1e-9, rtol=0
    )  # rounding times the transmission


def test_a_pushed_block_and_a_turned_wheel_accelerate_evenly(tmp_path):
    file = tmp_path / "load.xml"
    file.write_text(
        model_text(
            """<body><joint name="s" type="slide" axis="1 0 0"/>
        <inertial pos="0 .3 0" mass="2" diaginertia=".1 .1 .1"/></body>
      <body><joint name="h" axis="0 0 -1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 .5"/>
      </body>""",
            """<actuator><motor joint="s"/><motor joint="h"/></actuator>
      <sensor><jointpos name="s" joint="s"/><jointpos name="h" joint="h"/></sensor>""",
            "0 0",
            "3 -2",
        )
    )
    run = Run("dynamics", np.linspace(0, 1, 11), ("s", "h"))
    got = with_pymunk.simulate(file, run).channels
    np.testing.assert_allclose(got["s"], 1.5 * run.x**2 / 2, atol=1e-12, rtol=0)  # leapfrog: exact
    np.testing.assert_allclose(got["h"], -4 * run.x**2 / 2, atol=1e-12, rtol=0)


def test_loads_between_free_links_act_as_in_mujoco(tmp_path):
    """A moment acts between two arms, and a force drives a block along the second arm."""
    file = tmp_path / "load.xml"
    file.write_text(
        model_text(
            f"""<body><joint name="a"/>{bar(1, 2)}
      <body pos="1 0 0"><joint name="b"/>{bar(0.8, 1)}
      <body pos=".2 .1 0"><joint name="c" type="slide" axis="1 0 0"/>
        <inertial pos=".1 .05 0" mass=".5" diaginertia=".01 .02 .02"/></body></body></body>""",
            """<actuator><motor joint="b"/><motor joint="c"/></actuator>
      <sensor><jointpos name="a" joint="a"/><jointpos name="b" joint="b"/>
      <jointpos name="c" joint="c"/></sensor>""",
            "0 0.5 0",
            "1.5 -2",
        )
    )
    errors = []
    for dt in (2e-3, 1e-3):
        run = Run("dynamics", np.linspace(0, 1, 51), ("a", "b", "c"), settings={"timestep": dt})
        ours, truth = (engine.simulate(file, run).channels for engine in (with_pymunk, with_mujoco))
        errors.append([np.abs(ours[name] - truth[name]).max() for name in run.channels])
    assert np.all(np.log2(np.divide(*errors)) > 1.8), errors
    assert max(errors[1]) < 1e-4  # leapfrog at 5 m/s: (rate dt)^2
