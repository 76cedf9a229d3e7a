"""Integration of a rod by a chain of high order: against an adaptive integrator, and its order."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.analytic.rods import equilibrium
from proofmass.analytic.rods.equilibrium import HINGE_SHARES, SEGMENT_SHARES, integrate_to_tip

ROD = {"angle": 0.4, "moment": 3.0, "force": 80.0 - 50.0j, "length": 1.3, "stiffness": 2.0}


@pytest.mark.parametrize("seed", range(4))
def test_rod_against_an_adaptive_integrator(seed):
    rng = np.random.default_rng(seed)
    angle, moment, force = rng.uniform(-3, 3), rng.normal(0, 4), 12 * rng.normal(size=2)

    def slope(_, y):
        return [
            np.cos(y[2]),
            np.sin(y[2]),
            y[3] / 2,
            force[0] * np.sin(y[2]) - force[1] * np.cos(y[2]),
        ]

    wanted = solve_ivp(slope, (0, 1.3), [0, 0, angle, moment], "DOP853", rtol=3e-14, atol=1e-14)
    z, theta = integrate_to_tip(angle, moment, force @ [1, 1j], 1.3, 2.0)
    x, y, turned, _ = wanted.y[:, -1]
    # ten times the error that `integrate_to_tip` states, and the same times the curvature
    assert abs(z[0] - (x + 1j * y)) <= 1e-10
    assert abs(theta[0] - turned) <= 1e-9


def test_the_chain_is_of_sixth_order(monkeypatch):
    """The chain is of sixth order; its coefficients have fifteen digits."""
    tips = []
    for count in (300, 24, 48):
        monkeypatch.setattr(equilibrium, "count_steps", lambda *_, count=count: count)
        tips.append(integrate_to_tip(**ROD)[0][0])
    errors = np.abs(np.array(tips[1:]) - tips[0])
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6.0, abs=0.2)  # errors 1e-10, 2e-12
    assert sum(HINGE_SHARES) == sum(SEGMENT_SHARES) == pytest.approx(1.0, abs=1e-15)


def test_a_rod_without_force_is_an_arc_of_a_circle():
    """Without a force the rod is an arc of a circle, with the derivatives of the arc."""
    z, theta = integrate_to_tip(0.3, 2.0, 0.0, 1.5, 4.0)
    bend, start = 2.0 / 4.0, np.exp(0.3j)
    assert abs(z[0] - start * np.expm1(1j * bend * 1.5) / (1j * bend)) <= 1e-12  # rounding
    assert theta[:2] == pytest.approx([0.3 + bend * 1.5, 1.5 / 4.0], abs=1e-14)
