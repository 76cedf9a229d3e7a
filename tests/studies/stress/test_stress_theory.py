"""Limits of stability: closed forms, step matrices of the engines, and measured boundaries."""

import mujoco
import numpy as np
import pymunk
import pytest

from proofmass.sim.mujoco.theory import SCHEMES, discrete_map, euler_map, explicit_euler_map
from proofmass.sim.pymunk.dampers import midpoint_dampers
from proofmass.sim.pymunk.theory import chipmunk_step, midpoint_damped_step
from proofmass.sim.stability import stability_limit
from proofmass.studies.stress import problems, theory
from proofmass.studies.stress.boundary import Boundary
from proofmass.studies.stress.limit_search import LimitSearch
from proofmass.studies.stress.problems import list_problems, step_model, wheel_model

PROBLEMS = {f"{p.what}, {p.setting}, {p.parameter}": p for p in list_problems()}
QUICK_PROBLEMS = [
    "spring on a hinge, ζ = 0.3, Euler, dt ω",
    "spring on a hinge, ζ = 1, implicitfast, dt ω",
    "spring on a hinge, ζ = 0, RK4, dt ω",
    "spring on a hinge, ζ = 0.3, discrete, dt ω",
    "spring on a hinge, ζ = 1, explicit damping, Euler, dt ω",
    "velocity servo, Euler, dt kv/I",
    "loop with refsafe off, Euler, dt/solref",
    "hung pendulum, Euler, gravity dt²/L",
    "column of 4 segments, at rest, load L²/EI",
    "four-bar 2, 2, 2.5, 3 to its limit position, sweep, crank",
]


def is_near_theory(found: Boundary) -> bool:
    """Whether a boundary is within 2 % of theory, of which bisection takes up to 0.5 %.

    The rest is due to the number of steps: an oscillation that grows slowly fails only a little
    beyond the limit.
    """
    if found.parameter in ("dt ω", "dt √(k/m)", "dt kv/I"):
        assert found.step == pytest.approx(found.holds, rel=1e-12)  # the step that the engine took
    return abs(found.ratio - 1.0) <= 0.02


@pytest.mark.parametrize("name", QUICK_PROBLEMS)
def test_boundaries_are_where_theory_says(name):
    assert is_near_theory(PROBLEMS[name].find())


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in PROBLEMS if n not in QUICK_PROBLEMS])
def test_all_other_boundaries_are_where_theory_says(name):
    assert is_near_theory(PROBLEMS[name].find())


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_wrong_stiffness_gives_another_limit(factor):
    """The limit is proportional to stiffness^-1/2, so a factor of 0.8 changes it by 12 %."""
    text = wheel_model(factor)
    found = LimitSearch(
        "",
        "mujoco",
        "",
        "",
        "1",
        0.5,
        10.0,
        lambda z: step_model("mujoco", text, z, {"integrator": "Euler"}),
        theory=2.0,
    ).find()
    assert found.ratio == pytest.approx(factor**-0.5, rel=0.01)
    assert not is_near_theory(found)


@pytest.mark.parametrize("zeta", [0.0, 0.05, 0.3, 1.0, 3.0])
def test_limits_have_closed_forms(zeta):
    """The limits are the roots of |trace| = 1 + determinant, solved by hand."""
    root = np.sqrt(1 + zeta**2)
    assert stability_limit(euler_map, zeta) == pytest.approx(2 * (zeta + root), rel=1e-6)
    assert stability_limit(explicit_euler_map, zeta) == pytest.approx(2 * (root - zeta), rel=1e-6)
    assert stability_limit(discrete_map, zeta) == np.inf
    assert stability_limit(midpoint_damped_step, zeta) == pytest.approx(2.0, rel=1e-6)


def test_chipmunk_has_no_limit_beyond_a_damping_of_a_quarter():
    """z^2 = 2 + 2 exp(2 zeta z) has a double root where u = 2 + 2 exp(-u), 4 zeta^2 = u exp(-u)."""
    u = 2.0
    for _ in range(60):
        u = 2 + 2 * np.exp(-u)
    edge = np.sqrt(u * np.exp(-u)) / 2
    assert edge == pytest.approx(0.2457, abs=1e-4)
    assert np.isfinite(stability_limit(chipmunk_step, 0.99 * edge))
    assert stability_limit(chipmunk_step, 1.01 * edge) == np.inf
    z = stability_limit(chipmunk_step, 0.1)
    assert z**2 == pytest.approx(2 + 2 * np.exp(0.2 * z), rel=1e-6)


@pytest.mark.parametrize("zeta", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("z", [0.5, 2.5])
@pytest.mark.parametrize("integrator", [one.name for one in SCHEMES])
def test_step_matrices_are_those_of_mujoco(integrator, z, zeta):
    model = mujoco.MjModel.from_xml_string(wheel_model(1.0, 2 * zeta))
    model.opt.timestep = z
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    columns = []
    for place, rate in ((1.0, 0.0), (0.0, 1.0 / z)):
        data = mujoco.MjData(model)
        data.qpos[0], data.qvel[0] = place, rate
        mujoco.mj_step(model, data)
        columns.append((data.qpos[0], z * data.qvel[0]))
    found = np.array(columns).T
    scheme = next(one for one in SCHEMES if one.name == integrator)
    assert found == pytest.approx(scheme.step(z, zeta), abs=1e-12)


@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("z", [0.5, 2.5])
@pytest.mark.parametrize("on_a_slide", [False, True])
@pytest.mark.parametrize("midpoint", [False, True])
def test_the_step_matrix_is_that_of_chipmunk(midpoint, on_a_slide, z, zeta):
    columns = []
    for place, rate in ((1.0, 0.0), (0.0, 1.0 / z)):
        space, body = pymunk.Space(), pymunk.Body(1.0, 1.0)
        spring = pymunk.DampedRotarySpring(space.static_body, body, 0.0, 1.0, 2 * zeta)
        body.angle, body.angular_velocity = place, rate
        if on_a_slide:
            body.angle, body.angular_velocity = 0.0, 0.0
            body.position, body.velocity = (place, 0.0), (rate, 0.0)
            ends = (-10.0, 0.0), (0.0, 0.0)
            spring = pymunk.DampedSpring(space.static_body, body, *ends, 10.0, 1.0, 2 * zeta)
        space.add(body, spring)
        for act in midpoint_dampers(space, z) if midpoint else ():
            act()
        space.step(z)
        turned = body.angle, z * body.angular_velocity
        columns.append((body.position.x, z * body.velocity.x) if on_a_slide else turned)
    step = midpoint_damped_step if midpoint else chipmunk_step
    assert pytest.approx(step(z, zeta), abs=1e-12) == np.array(columns).T


def test_a_row_of_masses_has_the_frequencies_of_its_compiled_model():
    """The highest frequency follows from the stiffnesses and MuJoCo's mass matrix of the joints."""
    model = mujoco.MjModel.from_xml_string(problems.chain_model(7))
    data, inertia = mujoco.MjData(model), np.zeros((7, 7))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    squares = np.linalg.eigvals(np.linalg.solve(inertia, np.diag(model.jnt_stiffness)))
    assert np.sqrt(squares.real.max()) == pytest.approx(theory.chain_frequency(7), rel=1e-12)


@pytest.mark.parametrize("segments", [2, 4, 9])
def test_henckys_load_is_the_least_eigenvalue_of_the_chain(segments):
    """The chain has half a link at its end; k (t_j - t_j-1) = P h t_j about joint j, linearized.

    The critical load is the least eigenvalue of these equations.
    """
    n, h = segments, 1.0 / segments
    bending = np.zeros((n, n))
    for joint in range(n):  # between links joint and joint + 1; link 0 is clamped
        difference = np.zeros(n)
        difference[joint] = 1.0
        if joint:
            difference[joint - 1] = -1.0
        bending += np.outer(difference, difference) / h
    lengths = np.full(n, h)
    lengths[-1] = h / 2
    loads = np.linalg.eigvals(np.linalg.solve(np.diag(lengths), bending))
    assert loads.real.min() == pytest.approx(theory.hencky_load(segments), rel=1e-12)
