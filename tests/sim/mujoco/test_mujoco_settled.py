"""Tests of the linkage balancer in MuJoCo: sweeps in equilibrium, and settling by time steps.

S. van Nes, The use of a rigid linkage balancer with torsion springs to realize nonlinear
moment-angle characteristics, MSc thesis TU Delft 2022.074, tables M.1, M.2 and M.6.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import root

from proofmass.sim.mujoco import settling
from proofmass.sim.mujoco.engine import simulate
from proofmass.sim.mujoco.model import load
from proofmass.sim.mujoco.quasi_static import sweep
from proofmass.sim.mujoco.settling import settled_sweep
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, NotSolved
from proofmass.sim.protocol.run import Drive, Run

PENDULUM_DRIVE = Drive("pendulum", lambda x: (x, np.ones_like(x), np.zeros_like(x)))
STIFF_LIMIT = 'solreflimit="0.002 1" solimplimit="0.9999 0.9999 0.001"'
MODEL = """<mujoco><compiler angle="radian"/>
  <option gravity="0 0 0" timestep="1e-3" integrator="implicitfast" tolerance="0">
    <flag contact="disable"/></option>
  <default><joint axis="0 0 -1" {limit}/><equality solref="0.002 1" solimp="0.9999 0.9999 0.001"/>
  </default><worldbody>
    <body><joint name="pendulum"/>{mass}<site name="tip" pos="0 1 0"/></body>{arm}</worldbody>
  <equality><connect site1="tip" site2="end"/></equality>
  <actuator><motor name="hold" joint="pendulum"/></actuator>
  <sensor><actuatorfrc name="hold" actuator="hold"/>{sensors}</sensor>
  <keyframe><key name="start"/></keyframe></mujoco>"""
LIGHT_INERTIA = '<inertial pos="0 0 0" mass="1e-3" diaginertia="1e-6 1e-6 1e-6"/>'

LINEAR = {"lengths": (0.3394, 0.4573, 0.4752), "k": (1.2701, 0.8473, 4.1078), "first": (0.6641,)}
PRELOADED = {"lengths": (0.4764, 0.4975, 0.4986), "k": (0.9341, 0.1211, 0.0927), "preload": 0.3983}
QUADRATIC = {"lengths": (0.3334, 0.4987, 0.482), "k": (1.5601,) * 3, "square": -0.6047}
CONTACT = {"lengths": (0.4029, 0.4568, 0.4343), "k": (0.8971, 0.089, 0.3411), "high": 0.8693}
FOUR_SEGMENTS = {"lengths": (0.3, 0.3, 0.35, 0.3), "k": (1.2, 0.6, 0.4, 0.3), "first": (0.3, 0.1)}
MOMENTS = [  # at 10, 20, ... 90 degrees, from the tables' parameters by a minimum of energy
    (LINEAR, "0.172048 0.337469 0.494344 0.639681 0.768529 0.872421 0.939433 0.974829 1.027206"),
    (PRELOADED, "0.163031 0.326062 0.489094 0.652125 0.786675 0.860044 0.924901 0.980266 1.028843"),
    (QUADRATIC, "0.182371 0.351288 0.505149 0.642404 0.761397 0.860177 0.936272 0.986410 1.006150"),
    (CONTACT, "0.037889 0.084999 0.142124 0.209025 0.353097 0.509670 0.666243 0.822817 0.979390"),
]


def start_angles(lengths: tuple[float, ...], first: tuple[float, ...]) -> np.ndarray:
    """Angles of the segments from the upright, elbow up, when the pendulum of 1 m is upright."""
    start = np.array(lengths[:-2]) @ _unit(first)
    way, (a, b) = np.array([0, 1]) - start, lengths[-2:]
    far, base = np.hypot(*way), np.arctan2(*way)
    inner = np.arccos((far**2 + a**2 - b**2) / (2 * far * a))
    outer = np.arccos((far**2 + b**2 - a**2) / (2 * far * b))
    return np.array([*first, base - inner, base + outer])


def _unit(angle) -> np.ndarray:
    return np.column_stack([np.sin(angle), np.cos(angle)])


def balancer(lengths, k, first=(0.0,), preload=0.0, square=0.0, high=4.0, limit=STIFF_LIMIT) -> str:
    """The MJCF of a balancer; every segment is a body that is not rotated in the start pose."""
    along = [
        f'pos="{x!r} {y!r} 0"'
        for x, y in (np.array(lengths)[:, None] * _unit(start_angles(lengths, first))).tolist()
    ]
    arm = f'<site name="end" {along[-1]}/>'
    for i in reversed(range(len(k))):
        on_stop = f'springref="{-preload / k[1]}" range="{0 if preload else -9} {high}"'
        arm = (
            f'<body {along[i - 1] if i else ""}><joint name="s{i + 1}" stiffness="{k[i]} '
            f'{square}" {on_stop if i == 1 else ""}/>{LIGHT_INERTIA}{arm}</body>'
        )
    sensors = "".join(
        f'<jointpos name="s{i + 1}" joint="s{i + 1}"/><jointvel name="v{i + 1}" joint="s{i + 1}"/>'
        for i in range(len(k))
    )
    return MODEL.format(limit=limit, mass=LIGHT_INERTIA, arm=arm, sensors=sensors)


@pytest.fixture
def write_balancer(tmp_path: Path):
    """Write a balancer's MJCF and return its path."""

    def write(**parameters) -> Path:
        path = tmp_path / "balancer.xml"
        path.write_text(balancer(**parameters))
        return path

    return write


def balancer_sweep(degrees, *channels: str) -> Run:
    """A sweep of the pendulum, with its holding moment and deflections of springs."""
    return Run("sweep", np.radians(degrees), ("hold", "s1", "s2", *channels), (PENDULUM_DRIVE,))


@pytest.mark.parametrize(("parameters", "moments"), MOMENTS)
def test_sweeps_have_the_moments_of_tabulated_balancers(parameters, moments, write_balancer):
    """The springs are linear, preloaded on a stop, quadratic, and against an upper stop.

    The holding moment is also that of spring 1.
    """
    curves = simulate(write_balancer(**parameters), balancer_sweep(np.arange(0, 91, 5)))
    truth = [float(m) for m in moments.split()]
    # 5e-7: digits of the reference
    np.testing.assert_allclose(curves.channels["hold"][2::2], truth, atol=5e-7)
    spring = parameters["k"][0] * curves.channels["s1"]
    spring += parameters.get("square", 0) * curves.channels["s1"] ** 2
    np.testing.assert_allclose(curves.channels["hold"], spring, atol=1e-13, rtol=0)  # rounding


def test_swapped_segments_have_other_moments(write_balancer):
    swapped = LINEAR | {"lengths": (0.3394, 0.4752, 0.4573)}
    curves = simulate(write_balancer(**swapped), balancer_sweep(np.arange(0, 91, 10)))
    truth = [float(m) for m in MOMENTS[0][1].split()]
    assert np.abs(curves.channels["hold"][1:] - truth).max() > 1e-3


@pytest.mark.parametrize(
    "p", [LINEAR, QUADRATIC, FOUR_SEGMENTS], ids=["three", "quadratic", "four"]
)
def test_sweeps_satisfy_free_body_equilibrium(p, write_balancer):
    """Equilibrium of each segment as a free body has the same angles.

    Moments of neighbouring springs differ by the moment of the pin's force on the segment between
    them.  Scipy solves these equations and those of the loop, starting from the engine's pose.
    """
    bar, k, square = np.array(p["lengths"]), np.array(p["k"]), p.get("square", 0.0)
    rest = start_angles(p["lengths"], p.get("first", (0.0,)))
    names = [f"s{i + 1}" for i in range(bar.size)]
    curves = simulate(write_balancer(**p), balancer_sweep(np.arange(0, 91, 10), *names[2:]))

    def moments(theta):
        deflection = np.diff(theta - rest, prepend=0.0)
        return np.append(k * deflection + square * deflection**2, 0.0)

    def open_(unknown, angle):
        theta, (east, north) = unknown[:-2], unknown[-2:]
        s, c = np.sin(theta), np.cos(theta)
        return [
            *(-np.diff(moments(theta)) - bar * (east * c - north * s)),
            bar @ s - np.sin(angle),
            bar @ c - np.cos(angle),
        ]

    for j, angle in enumerate(curves.x):
        theta = rest + np.cumsum([curves.channels[n][j] for n in names])
        truth = root(open_, [*theta, 0.0, 0.0], args=(angle,), tol=1e-15).x[:-2]
        np.testing.assert_allclose(theta, truth, atol=1e-12, rtol=0)  # rounding over the softness
        assert curves.channels["hold"][j] == pytest.approx(moments(truth)[0], abs=1e-12)


def test_a_preload_is_released_at_the_angle_of_the_closed_form(write_balancer):
    """While joint 2 is on its stop, the pin pulls along the last segment.

    The moment on joint 2 is M2 = k1 alpha (1 - l1 / r); the joint leaves its stop where M2 is equal
    to the preload.
    """
    released_at = np.degrees(0.3983 / (0.9341 * (1 - 0.4764)))
    assert released_at == pytest.approx(46.6595, abs=5e-5)  # degrees, four decimals
    curves = simulate(
        write_balancer(**PRELOADED),
        balancer_sweep([0.0, 30.0, released_at - 1e-7, released_at + 1e-7, 60.0]),
    )
    deflection, hold = curves.channels["s2"], curves.channels["hold"]
    np.testing.assert_allclose(hold[:3], 0.9341 * curves.x[:3], atol=1e-15, rtol=0)
    assert np.abs(deflection[:3]).max() < 1e-15
    assert 0 < deflection[3] < 1e-7


def test_an_unstable_equilibrium_at_the_start_is_an_error(write_balancer):
    """Table M.6: springs of -0.2665 + 0.3146 e N m/rad push away from their zero."""
    unstable = {"lengths": (0.4594, 0.3341, 0.3787), "k": (-0.2665,) * 3, "square": 0.3146}
    with pytest.raises(BadModel, match="unstable equilibrium when pendulum = 0"):
        simulate(write_balancer(**unstable), balancer_sweep(np.arange(0, 91, 10)))


def settled_curves(path: Path, run: Run) -> Curves:
    model, data = load(path, run)
    return settled_sweep(model, data, run)


@pytest.mark.parametrize(
    "p", [LINEAR, PRELOADED, CONTACT, FOUR_SEGMENTS], ids=["three", "preload", "contact", "four"]
)
def test_the_engine_settles_in_the_equilibria_of_the_sweep(p, write_balancer):
    run = balancer_sweep(np.arange(0, 91, 15))
    exact, soft = simulate(write_balancer(**p), run), settled_curves(write_balancer(**p), run)
    # the tolerances are for soft constraints, see `proofmass.sim.mujoco.settling`
    for name, size in (("hold", 1e-6), ("s1", 1e-6), ("s2", 3e-6)):
        np.testing.assert_allclose(soft.channels[name], exact.channels[name], atol=size)


def test_the_depth_in_a_stop_grows_with_force_and_solref_squared(write_balancer):
    """A preloaded joint enters its stop by (1 - d) F T^2 / m.

    T is the time constant of ``solreflimit`` and d the impedance of ``solimplimit``.
    """
    run = balancer_sweep(np.arange(0, 31, 30))
    depths = []
    for time, d in ((0.002, 0.9999), (0.004, 0.9999), (0.002, 0.999)):
        limit = f'solreflimit="{time} 1" solimplimit="{d} {d} 0.001"'
        depths.append(-settled_curves(write_balancer(**PRELOADED, limit=limit), run).channels["s2"])
    np.testing.assert_allclose(depths[1], 4 * depths[0], rtol=1e-2)
    np.testing.assert_allclose(depths[2], 10 * depths[0], rtol=1e-2)
    push = 0.3983 - 0.9341 * (1 - 0.4764) * run.x  # the pin's force carries a part of the preload
    assert depths[0][1] / depths[0][0] == pytest.approx(push[1] / push[0], rel=1e-2)


def test_the_setting_settled_gives_equilibria_without_rates(write_balancer):
    run = replace(balancer_sweep([0.0, 5.0], "v1"), settings={})
    model, data = load(write_balancer(**LINEAR), run)
    curves = sweep(model, data, replace(run, settings={"settled": True}))
    assert "at rest" in curves.missing["v1"]
    assert curves.derivatives == 0
    # the reference is computed at this motion of the drive
    for part, prescribed in zip(curves.drive, run.motion(run.x), strict=True):
        np.testing.assert_array_equal(part, prescribed)
    assert curves.steps > 100  # time steps of the engine, not poses


def test_an_engine_that_does_not_come_to_rest_is_an_error(write_balancer, monkeypatch):
    monkeypatch.setattr(settling, "MAX_SETTLING_STEPS", 200)
    with pytest.raises(
        NotSolved, match=r"not at rest after 150 steps at pendulum = 0.17.*moves at"
    ):
        settled_curves(write_balancer(**LINEAR), balancer_sweep([0.0, 10.0]))
