"""The four-bar with a diagonal spring: its printed equilibrium and eigenvalues.

The printed equilibrium is 3.8e-11 rad below the true one, and the printed eigenvalue is that at the
printed angle: its last two digits are wrong.
"""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.polynomial import Chebyshev

from proofmass.analytic import planar
from proofmass.sim.smooth import SmoothTerms
from tests.independent.linkages import fourbar_spring
from tests.shipped import shipped

PRINTED = json.loads((Path(__file__).parents[2] / "data" / "fourbar_spring.json").read_text())
MODEL_TEXT = shipped("fourbar_spring.xml").read_text()
UNDAMPED_TEXT = MODEL_TEXT.replace('damping="1"', "")
START = 'qpos="2.244331019 -2.244331019 2.244331019"'
REST = fourbar_spring.equilibrium()


def started(text: str, phi: float, rate: float = 0.0) -> mujoco.MjModel:
    """The model with another start [rad, rad/s]."""
    assert START in text
    phi, rate = float(phi), float(rate)
    key = f'qpos="{phi!r} {-phi!r} {phi!r}" qvel="{rate!r} {-rate!r} {rate!r}"'
    return mujoco.MjModel.from_xml_string(text.replace(START, key))


def planar_acceleration(text: str, phi: float, rate: float = 0.0) -> float:
    """The angular acceleration of B-D by the planar reference [rad/s^2]."""
    found = planar.solve([0.0, 1e-4], model=started(text, phi, rate))
    return float(found["right_acceleration"][0])


def smooth_acceleration(text: str, phi: float, rate: float = 0.0) -> float:
    """The same from the terms of MuJoCo and the rows of the loop, without their softness."""
    source = SmoothTerms(started(text, phi, rate))
    t = source.terms(np.array([phi, -phi, phi]), np.array([rate, -rate, rate]))
    rows = t.jacobian[:2]  # the third is normal to the plane
    matrix = np.block([[t.mass, rows.T], [rows, np.zeros((2, 2))]])
    return float(np.linalg.solve(matrix, np.append(t.force - t.bias, t.drift[:2]))[2])


def linearized(acceleration, text: str, phi: float) -> complex:
    """The eigenvalue [1/s] of the motion about an angle [rad], from accelerations beside it."""
    width, rate = 0.1, 0.1
    curve = Chebyshev.interpolate(
        np.vectorize(lambda x: acceleration(text, x)), 14, domain=(phi - width, phi + width)
    )
    slope = float(curve.deriv()(phi))
    drag = (acceleration(text, phi, rate) - acceleration(text, phi, -rate)) / (2 * rate)
    return complex(drag / 2, np.sqrt(-slope - drag**2 / 4))


def test_the_printed_equilibrium_is_wrong_in_its_last_digit():
    assert pytest.approx(2.234331019018, abs=1e-12) == REST
    assert 3.5e-11 < REST - PRINTED["equilibrium"] < 4.1e-11
    assert f"{REST:.11f}" == "2.23433101902"
    assert abs(fourbar_spring.moment(PRINTED["equilibrium"])) > 2e-10
    assert abs(fourbar_spring.moment(REST)) < 1e-14


def test_the_printed_eigenvalues_are_those_at_the_printed_angle():
    """Nine decimals hold at the true angle."""
    there = PRINTED["equilibrium"]
    for name, damping, print_ in (("undamped", 0.0, 1e-11), ("damped", 1.0, 1e-10)):
        printed = complex(*np.atleast_1d(PRINTED[name])) if damping else 1j * PRINTED[name]
        at_print = fourbar_spring.eigenvalue(there, damping)
        at_rest = fourbar_spring.eigenvalue(REST, damping)
        assert abs(at_print - printed) < print_
        assert 5e-11 < abs(at_rest - printed) < 2e-10
    assert fourbar_spring.eigenvalue(REST, 0.0).imag == pytest.approx(2.147676638502, abs=1e-12)
    for name in ("solution 119", "solution 121", "EoM undamped", "EoM damped"):
        damping = float(name.endswith(("121", " damped")))
        off = abs(complex(*PRINTED[name]) - fourbar_spring.eigenvalue(REST, damping))
        assert 1e-10 < off < 2e-10


@pytest.mark.parametrize("acceleration", [planar_acceleration, smooth_acceleration])
@pytest.mark.parametrize(("text", "damping"), [(UNDAMPED_TEXT, 0.0), (MODEL_TEXT, 1.0)])
def test_the_linearized_reference_has_the_eigenvalues(acceleration, text, damping):
    """They agree with the source's equation to 1e-12, and with the print as far as that holds."""
    found = linearized(acceleration, text, REST)
    assert abs(found - fourbar_spring.eigenvalue(REST, damping)) < 5e-12
    printed = complex(*PRINTED["damped"]) if damping else 1j * PRINTED["undamped"]
    assert 5e-11 < abs(found - printed) < 2e-10


def test_a_wrong_spring_changes_the_eigenvalue():
    """A mutation: the eighth digit of the stiffness."""
    text = UNDAMPED_TEXT.replace('stiffness="25"', 'stiffness="25.00001"')
    off = linearized(smooth_acceleration, text, REST) - fourbar_spring.eigenvalue(REST, 0.0)
    assert abs(off) > 1e-7


@pytest.mark.parametrize("away", [0.01, -0.2])
def test_the_reference_moves_as_the_equation_of_the_source(away):
    times = np.linspace(0.0, 10.0, 41)
    found = planar.solve(times, model=started(MODEL_TEXT, REST + away))
    angle, rate = fourbar_spring.move(REST + away, times)
    assert np.abs(found["right"] - angle).max() < 1e-11
    assert np.abs(found["left"] - angle).max() < 1e-11
    assert np.abs(found["right_rate"] - rate).max() < 1e-11


def test_small_oscillations_decay_as_the_printed_eigenvalue():
    """The mean of motions to both sides is free of the first nonlinear term."""
    times, away = np.linspace(0.0, 10.0, 101), 1e-4
    sides = [
        planar.solve(times, model=started(MODEL_TEXT, REST + side))["right"]
        for side in (away, -away)
    ]
    s = complex(*PRINTED["damped"])
    wave = away * (np.exp(s * times) * (1 + 1j * s.real / s.imag)).real
    assert np.abs(0.5 * (sides[0] - sides[1]) - wave).max() < 1e-7 * away


def test_the_path_of_equilibria_passes_the_benchmark():
    foot = np.linspace(-0.2, 0.2, 81)
    model = mujoco.MjModel.from_xml_path(str(shipped("fourbar_spring_path.xml")))
    found = planar.solve(foot, 0.1, model=model, joints=("foot",))
    assert found["right"][40] == pytest.approx(REST, abs=1e-13)
