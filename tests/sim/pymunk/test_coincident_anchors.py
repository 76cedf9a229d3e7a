"""Joints whose anchors coincide: their distance is rounding, and not the size of the mechanism."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve_here

CART, BOB, LENGTH, RADIUS, GRAVITY = 0.2, 5.0, 0.5, 0.04, 9.81  # [kg, kg, m, m, m/s^2]
START, END = (0.1, 1.0), 0.5
MODEL = f"""<mujoco><compiler angle="radian"/><option timestep="0.001" gravity="0 -{GRAVITY} 0">
<flag contact="disable"/></option><worldbody><body name="cart">
<joint name="slide" type="slide" axis="1 0 0"/><geom type="box" size=".05 .02 .02" mass="{CART}"/>
<body name="arm"><joint name="hinge"/>
<geom type="sphere" size="{RADIUS}" pos="0 -{LENGTH} 0" mass="{BOB}"/></body></body></worldbody>
<sensor><jointpos name="slide" joint="slide"/><jointpos name="hinge" joint="hinge"/></sensor>
<keyframe><key name="start" qpos="{START[0]} {START[1]}"/></keyframe></mujoco>"""
SIDECAR = f"""title = "Cart with a pendulum at its centre"
source = "equations of motion in this test"
reference = "planar"
[run.dynamics]
n = 51
until = {END}
solvers = ["pymunk"]
[settings.pymunk]
timestep = %s
[[tolerance]]
relative_to_range = 1e-1
why = "this test compares the curves itself"
"""


def exact(times: np.ndarray) -> np.ndarray:
    """Position of the cart and angle of the pendulum, by Lagrange's equations."""
    inertia = BOB * LENGTH**2 + 0.4 * BOB * RADIUS**2

    def slope(_: float, state: np.ndarray) -> list[float]:
        _, angle, speed, rate = state
        pull = BOB * LENGTH
        masses = [[CART + BOB, pull * np.cos(angle)], [pull * np.cos(angle), inertia]]
        forces = [pull * rate**2 * np.sin(angle), -pull * GRAVITY * np.sin(angle)]
        return [speed, rate, *np.linalg.solve(masses, forces)]

    found = solve_ivp(
        slope, (0.0, END), [*START, 0.0, 0.0], "DOP853", times, rtol=1e-11, atol=1e-12
    )
    return found.y[:2]


def test_a_pendulum_at_the_centre_of_a_cart_moves_as_its_equations_say(tmp_path):
    (tmp_path / "cart.xml").write_text(MODEL)
    errors = []
    for step in (1e-3, 5e-4):
        (tmp_path / "cart.toml").write_text(SIDECAR % step)
        curves = solve_here(load_case(tmp_path / "cart.toml"), "dynamics", "pymunk")
        found = np.array([curves.channels["slide"], curves.channels["hinge"]])
        errors.append(np.abs(found - exact(curves.x)).max())
    assert errors[0] < 1e-3, "of a motion of 1 rad"
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2), "an error of second order"
