"""Tests of a cantilever with distributed mass, released from a small arc, in both engines."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq

from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.run import Rod, Run
from tests.sim.rod_models import ENGINES, write_model

SENSORS = (
    '<framepos name="tip" objtype="site" objname="r.tip"/>'
    '<e_kinetic name="kinetic"/><e_potential name="potential"/>'
)
TURN = 1e-3  # [rad] of the arc; terms of third order are 1e-9


def rod(n: int) -> Rod:
    """A rod with L = 1 m, EI = 1 N m^2 and a mass of 1 kg."""
    return Rod("r", "ground", None, 1.0, 1.0, n, ("clamped", "free"), mass=1.0, turn=TURN)


def mode_values(count: int) -> np.ndarray:
    """The first values of beta L of a clamped-free beam: cos(b) cosh(b) = -1, b = 1.8751, ..."""
    about = np.pi * (np.arange(count) + 0.5)
    return np.array([brentq(lambda b: np.cos(b) + 1 / np.cosh(b), a - 0.4, a + 0.4) for a in about])


def beam_tip(t: np.ndarray, count: int = 8) -> np.ndarray:
    """Deflection of an Euler-Bernoulli beam's tip, released from y = TURN s^2/2, by its modes.

    A mode phi of unit mass has q = int phi y0 = TURN phi'(L)/beta^4, since EI phi'''' = omega^2 phi
    and y0'' is constant.
    """
    b = mode_values(count)
    share = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
    end = np.cosh(b) - np.cos(b) - share * (np.sinh(b) - np.sin(b))
    slope = b * (np.sinh(b) + np.sin(b) - share * (np.cosh(b) - np.cos(b)))
    return np.asarray((TURN * slope / b**4 * end) @ np.cos(np.outer(b**2, t)))


def test_the_sum_of_modes_begins_with_the_arc():
    """The sum of modes at time zero is the deflection of the arc.

    Terms are 4/beta^3 with beta = pi (k - 1/2): the sum of those after the eleventh is
    2/(11^2 pi^3).
    """
    rest = 2.0 * TURN / (11.0**2 * np.pi**3)
    assert beam_tip(np.zeros(1), 11)[0] == pytest.approx(TURN / 2.0 - rest, abs=0.01 * rest)


def test_frequencies_of_the_chain_converge_with_order_2(tmp_path):
    """Frequencies from MuJoCo's masses and springs converge with order 2.

    Their limits are 1.8751^2 and the next two of the beam.
    """
    errors = []
    for n in (10, 20, 40):
        found = compile_model(write_model(tmp_path), [rod(n)])
        data, mass = mujoco.MjData(found), np.zeros((found.nv, found.nv))
        mujoco.mj_forward(found, data)
        for row, unit in zip(mass, np.eye(found.nv), strict=True):
            mujoco.mj_mulM(found, data, row, unit)
        squares = np.linalg.eigvals(np.linalg.solve(mass, np.diag(found.jnt_stiffness)))
        errors.append(np.sqrt(np.sort(squares.real)[:3]) / mode_values(3) ** 2 - 1.0)
    orders = np.log2(np.abs(errors[0]) / np.abs(errors[1])), np.log2(np.abs(errors[1] / errors[2]))
    np.testing.assert_allclose(orders, 2.0, atol=0.15)  # terms in h^4 in the third mode
    assert np.abs(errors[2][0]) < 1e-3


def release_errors(engine: str, folder: Path, n: int, step: float) -> tuple[float, float]:
    """Largest error of the tip over `TURN`, and largest change of energy over that at the start."""
    t, channels = np.linspace(0.0, 1.0, 21), ("tip.y", "kinetic", "potential")
    run = Run("dynamics", t, channels, settings={"timestep": step}, rods=(rod(n),))
    found = ENGINES[engine](write_model(folder, sensors=SENSORS), run).channels
    energy = found["kinetic"] + found["potential"]
    error = np.abs(found["tip.y"] - beam_tip(t)).max() / TURN
    return float(error), float(np.abs(energy / energy[0] - 1.0).max())


@pytest.mark.parametrize("engine", ENGINES)
def test_a_released_cantilever_converges_with_order_2(engine, tmp_path):
    """The tip converges to that of the beam with order 2 in the number of links.

    The change of energy falls with the time step.
    """
    (coarse, energy_change), (fine, _), (_, finer_energy_change) = (
        release_errors(engine, tmp_path, n, step) for n, step in ((4, 2e-4), (8, 2e-4), (4, 1e-4))
    )
    # higher modes lose their phase, so that their errors are smaller than h^2 predicts
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.4)
    assert energy_change < 2e-2
    assert (
        energy_change / finer_energy_change > 1.7
    )  # the engines are of first or second order in the time step
