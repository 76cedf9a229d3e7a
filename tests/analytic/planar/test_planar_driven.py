"""Driven linkages with other degrees of freedom in time: equations of motion, and energy."""

import mujoco
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.integrate import solve_ivp

from proofmass.analytic import planar
from proofmass.analytic.planar import read, solve
from proofmass.analytic.planar.kinematics import (
    loop_jacobian,
    nearest_pose,
    nearest_rates,
)
from proofmass.case.drive import Swing
from proofmass.reference.evaluate import evaluate
from proofmass.reference.samples import run_samples
from tests.shipped import shipped, shipped_case

GRAVITY, DRIVE_DISTANCE, BOB_INERTIA = 9.81, 0.3, 1e-9  # m/s^2, m, kg m^2
CART_MASS, BOB_MASSES, ROD_LENGTHS = 2.0, (1.0, 0.5), (0.8, 0.5)
DRIVE_FREQUENCY = 2 * np.pi / 1.5  # rad/s


def cart_profile(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The motion profile of the cart: 0.3 m and back in 1.5 s, as a swing."""
    t = np.asarray(t, float)
    half = DRIVE_DISTANCE / 2
    return (
        half * (1 - np.cos(DRIVE_FREQUENCY * t)),
        half * DRIVE_FREQUENCY * np.sin(DRIVE_FREQUENCY * t),
        half * DRIVE_FREQUENCY**2 * np.cos(DRIVE_FREQUENCY * t),
    )


def angle_accelerations(t: float, y: np.ndarray) -> np.ndarray:
    """Accelerations of the absolute angles by Lagrange's equations with the cart's acceleration."""
    a, b, u, v = y
    (m1, m2), (l1, l2), push = BOB_MASSES, ROD_LENGTHS, float(cart_profile(np.asarray(t))[2])
    mixed = m2 * l1 * l2 * np.cos(a - b)
    matrix = np.array([[(m1 + m2) * l1**2 + BOB_INERTIA, mixed], [mixed, m2 * l2**2 + BOB_INERTIA]])
    turn = m2 * l1 * l2 * np.sin(a - b)
    pull = [
        -turn * v**2 - (m1 + m2) * l1 * (GRAVITY * np.sin(a) + push * np.cos(a)),
        turn * u**2 - m2 * l2 * (GRAVITY * np.sin(b) + push * np.cos(b)),
    ]
    return np.linalg.solve(matrix, pull)


def lagrange_motion(t: np.ndarray) -> np.ndarray:
    """Absolute angles and their rates (4, n) by integration of `angle_accelerations`."""
    start = [0.4, 0.1, 0.0, 0.0]

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        return np.append(y[2:], angle_accelerations(t, y))

    return solve_ivp(slope, (0, t[-1]), start, "DOP853", t, rtol=1e-13, atol=1e-13).y


def test_a_driven_cart_with_a_double_pendulum_obeys_lagrange():
    case = shipped_case(shipped("driven_cart.toml"))
    t = run_samples(case, "dynamics")
    t = t[: t.size // 4]
    state = tuple(part[None] for part in cart_profile(t))
    found = evaluate(case, "dynamics", t, state).channels
    truth = lagrange_motion(t)
    a, b, u, v = truth
    du, dv = np.array([angle_accelerations(*one) for one in zip(t, truth.T, strict=True)]).T
    tip = cart_profile(t)[0] + 0.8 * np.sin(a) + 0.5 * np.sin(b)
    # the force on the cart: Newton's law for all three masses along the rail
    (m1, m2), (l1, l2) = BOB_MASSES, ROD_LENGTHS
    force = (CART_MASS + m1 + m2) * cart_profile(t)[2]
    force = force + (m1 + m2) * l1 * (du * np.cos(a) - u**2 * np.sin(a))
    force = force + m2 * l2 * (dv * np.cos(b) - v**2 * np.sin(b))
    wanted = {
        "upper": a,
        "lower": b - a,
        "upper_rate": u,
        "lower_rate": v - u,
        "upper_acceleration": du,
        "lower_acceleration": dv - du,
        "tip.x": tip,
        "force": force,
    }
    for name, curve in wanted.items():
        # the accuracy of both integrators, for a motion that amplifies differences tenfold
        assert np.abs(found[name] - curve).max() < 1e-10 * max(1.0, np.ptp(curve)), name


def test_a_driven_motion_is_integrated_once(monkeypatch):
    """It is that of the motion profile, and not of the drive in an engine's run.

    Another profile is integrated by itself.
    """
    calls, integrate = [], planar.free_motion
    monkeypatch.setattr(planar, "free_motion", lambda *given: calls.append(1) or integrate(*given))
    model = mujoco.MjModel.from_xml_path(str(shipped("driven_cart.xml")))
    t, swing = np.linspace(0, 0.1, 3), Swing(0.0, 0.123, 1.0)
    one = solve(*swing(t), model=model, joints=("cart",), in_time=(t, (swing,)))
    late = solve(*swing(t + 1e-9), model=model, joints=("cart",), in_time=(t, (swing,)))
    assert len(calls) == 1
    assert all((one[name] == late[name]).all() for name in one)
    wider = Swing(0.0, 0.124, 1.0)
    other = solve(*wider(t), model=model, joints=("cart",), in_time=(t, (wider,)))
    assert len(calls) == 2
    assert np.abs(other["upper"] - one["upper"]).max() > 1e-5


def test_a_pendulum_on_a_driven_cart_obeys_its_equation_of_motion():
    """theta'' = -(g sin theta + x'' cos theta) / L, where L includes the bob's inertia."""
    text = shipped("driven_cart.xml").read_text()
    inner = text[text.index('<body name="lower"') : text.index("</body>") + len("</body>")]
    text = text.replace(inner, "")
    for name in ("lower", "lower_rate", "lower_acceleration", "tip"):
        text = "\n".join(line for line in text.splitlines() if f'name="{name}"' not in line)
    model = mujoco.MjModel.from_xml_string(text.replace('qpos="0 0.4 -0.3"', 'qpos="0 0.4"'))
    t, length = np.linspace(0, 1.5, 31), 0.8 + BOB_INERTIA / 0.8

    def slope(t: float, y: np.ndarray) -> list[float]:
        push = float(cart_profile(np.asarray(t))[2])
        return [y[1], -(GRAVITY * np.sin(y[0]) + push * np.cos(y[0])) / length]

    truth = solve_ivp(slope, (0, 1.5), [0.4, 0.0], "DOP853", t, rtol=1e-13, atol=1e-13).y
    found = solve(*cart_profile(t), model=model, joints=("cart",), in_time=(t, [cart_profile]))
    assert np.abs(found["upper"] - truth[0]).max() < 1e-11
    assert np.abs(found["upper_rate"] - truth[1]).max() < 1e-10


def test_the_work_of_the_drive_is_the_gain_of_energy():
    """The integral of the crank's moment times its rate, by quadrature, is the gain of energy."""
    text = shipped("fourbar.xml").read_text()
    bob = (
        '<body name="bob" pos="2.5 0 0"><joint name="bob" pos="0 0 0"/>'
        '<inertial pos="0.4 -0.6 0" mass="1.5" diaginertia="0.05 0.05 0.05"/></body>'
    )
    text = text.replace('<site name="rocker_end"', f'{bob}<site name="rocker_end"', 1)
    text = text.replace("2.2459278597319283", "2.2459278597319283 -1.2")
    text = text.replace('<key name="crossed" qpos="0 -1.3502639 -2.2459278"/>', "")
    more = '<jointpos name="bob" joint="bob"/><e_potential name="v"/><e_kinetic name="t"/>'
    model = mujoco.MjModel.from_xml_string(text.replace("<sensor>", f"<sensor>{more}"))

    def crank_profile(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        t = np.asarray(t, float)
        return 2 * t + 0.3 * np.sin(3 * t), 2 + 0.9 * np.cos(3 * t), -2.7 * np.sin(3 * t)

    nodes, shares = leggauss(60)
    t = np.concatenate([[0.0], 0.5 * (nodes + 1), [1.0]])
    found = solve(*crank_profile(t), model=model, joints=("crank",), in_time=(t, [crank_profile]))
    energy = found["v"] + found["t"]
    power = found["holding_moment"] * crank_profile(t)[1]
    assert np.ptp(energy) > 10.0  # J
    assert energy[-1] - energy[0] == pytest.approx(0.5 * shares @ power[1:-1], abs=1e-9)
    assert np.ptp(found["bob"]) > 1.0  # rad: the bob swings


def test_nearest_rates_agree_with_loops_and_drives():
    """They change the given rates as little as possible, and not at all if those fit already."""
    m = read(mujoco.MjModel.from_xml_path(str(shipped("fivebar.xml"))), "start")[0]
    q, drives, given = nearest_pose(m, m.start), np.array([0]), np.linspace(0.5, -0.7, m.start.size)
    found = nearest_rates(m, q, given, drives, np.array([1.3]))
    rows = loop_jacobian(m, q[None])[0]
    assert found[0] == pytest.approx(1.3, abs=1e-14)
    assert np.abs(rows @ found).max() < 1e-13
    np.testing.assert_allclose(
        nearest_rates(m, q, found, drives, np.array([1.3])), found, atol=1e-14, rtol=0
    )
    held = np.vstack([rows, np.eye(q.size)[drives]])
    free = np.linalg.svd(held)[2][len(held) :]
    assert len(free) == 1
    assert np.abs(free @ (found - given)).max() < 1e-14  # no change along the free motion


def test_drives_that_determine_all_joints_need_no_profiles():
    """With and without motion profiles the poses follow from the loops at the drives' state."""
    model, t = mujoco.MjModel.from_xml_path(str(shipped("fourbar.xml"))), np.linspace(0, 1, 11)
    state = t, 1.0 + 0 * t, 0 * t
    one = solve(*state, model=model, joints=("crank",))
    two = solve(*state, model=model, joints=("crank",), in_time=(t, [cart_profile]))
    assert all((one[name] == two[name]).all() for name in one)


def test_in_a_sweep_both_pendulums_hang_below_the_cart():
    model, place = mujoco.MjModel.from_xml_path(str(shipped("driven_cart.xml"))), [0.0, 0.1, 0.5]
    found = solve(place, model=model, joints=("cart",))
    assert np.abs(found["tip.x"] - place).max() < 1e-12
    assert np.abs(found["tip.y"] + 1.3).max() < 1e-12
    assert max(np.abs(found[name]).max() for name in ("upper", "lower", "force")) < 1e-12
