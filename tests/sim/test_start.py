"""One start for all: pose and rates at the first sample where drives leave degrees of freedom."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.optimize import root

from proofmass.analytic import planar, spatial
from proofmass.analytic.numerics import CannotAssemble
from proofmass.case.drive import Steady
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Drive, Run

OUT_OF_REACH = 12, 21
"""Mechanisms whose loops cannot be closed on the way to the first value of the drive."""
WITHIN_REACH = sorted({*range(30)} - {*OUT_OF_REACH})
DIFFERENCE = 1e-6
"""Distance [rad or m] of differences, whose errors are its square and 1e-16 over it."""
POSE_TOLERANCE, RATE_TOLERANCE = 1e-8, 1e-8
"""Errors of the conditions by differences [rad or m, per s]."""
STEP = 1e-6
"""Time step [s] of the runs.  pymunk keeps a constraint violation of half the squared move in a
step; its rates are the mean of two steps, from places with a rounding of 1e-16 m."""
TIMES = STEP * np.arange(3.0)
POSE_ROUNDING, RATE_ROUNDING = 1e-13, {"mujoco": 1e-12, "pymunk": 3e-8, "spatial": 1e-12}
"""Differences from `planar` [rad or m, per s].  pymunk's: 1e-16 m over a step is 1e-10, times the
condition of the loops of up to 100; the last digit of it depends on the processor."""


@dataclass(frozen=True)
class Sample:
    """A random mechanism: its MJCF, key, and the first value and rate of its drive."""

    text: str
    key: np.ndarray
    speed: np.ndarray
    value: float
    rate: float

    @property
    def profile(self) -> Steady:
        """The motion of the drive."""
        return Steady(self.value, self.rate, x_is_time=True)


def random_mechanism(seed: int) -> Sample:
    """A chain with or without a loop, of 3 to 6 joints, whose first joint is driven.

    The loop pins the end of the chain to the ground or to a slider.  A pendulum hangs on the second
    link.  In the key the loop is closed, or open by up to 1e-4 m.
    """
    dice = np.random.default_rng(seed)
    count, loop = int(dice.integers(3, 6)), ("pin", "slider", "")[seed % 3]
    lengths, angles = dice.uniform(0.2, 0.6, count), dice.uniform(-1.2, 1.2, count)
    signs = dice.choice([-1.0, 1.0], count)
    end = complex((lengths * np.exp(1j * np.cumsum(signs * angles))).sum())
    end += 1e-4 * complex(*dice.uniform(-1.0, 1.0, 2)) * (seed % 2)
    body = '<site name="end" pos="LAST 0 0"/>'.replace("LAST", repr(float(lengths[-1])))
    hanging = f'<body pos="0.1 0 0"><joint name="bob" damping="0.01"/>{inertia(dice)}</body>'
    for k in reversed(range(count)):
        place = float(lengths[k - 1]) if k else 0.0
        body = (
            f'<body pos="{place!r} 0 0"><joint name="j{k}" axis="0 0 {signs[k]}"/>{inertia(dice)}'
            f"{body}{hanging if k == 1 else ''}</body>"
        )
    key = [*angles, dice.uniform(-1.0, 1.0)]
    other = ""
    if loop == "slider":
        way, rail = float(dice.uniform(-0.3, 0.3)), complex(np.exp(1j * dice.uniform(-1.0, 1.0)))
        foot = end - way * rail
        other = (
            f'<body pos="{foot.real!r} {foot.imag!r} 0"><joint name="slide" type="slide" '
            f'axis="{rail.real!r} {rail.imag!r} 0"/>{inertia(dice)}<site name="pin"/></body>'
        )
        key.append(way)
    elif loop:
        other = f'<site name="pin" pos="{end.real!r} {end.imag!r} 0"/>'
    equality = '<equality><connect site1="end" site2="pin"/></equality>' if loop else ""
    names = [*(f"j{k}" for k in range(count)), "bob", *["slide"][: loop == "slider"]]
    sensors = "".join(
        f'<jointpos name="{one}" joint="{one}"/><jointvel name="{one}_rate" joint="{one}"/>'
        for one in names
    )
    speed = dice.uniform(-1.0, 1.0, len(key))
    text = (
        '<mujoco><compiler angle="radian"/><option gravity="0 -9.81 0"><flag contact="disable"/>'
        f"</option><worldbody>{body}{other}</worldbody>{equality}<sensor>{sensors}</sensor>"
        f'<keyframe><key name="start" qpos="{numbers(key)}" qvel="{numbers(speed)}"/></keyframe>'
        "</mujoco>"
    )
    value = float(angles[0] + dice.uniform(-0.4, 0.4))
    return Sample(text, np.array(key), speed, value, float(dice.uniform(-6.0, 6.0)))


def inertia(dice: np.random.Generator) -> str:
    """The MJCF of a random inertia."""
    mass, turn = dice.uniform(0.2, 1.0), dice.uniform(0.002, 0.01)
    return f'<inertial pos="0.15 0.02 0" mass="{mass}" diaginertia="{turn} {turn} {turn}"/>'


def numbers(values: object) -> str:
    """Numbers with all their digits, for MJCF."""
    return " ".join(repr(float(value)) for value in np.asarray(values))


def true_start(sample: Sample) -> tuple[np.ndarray, np.ndarray]:
    """Pose and rates by Lagrange's conditions of the least distance, with bare MuJoCo's sites.

    The unknowns are the pose and the multipliers.  The drive goes to its first value in steps.
    """
    model = mujoco.MjModel.from_xml_string(sample.text)
    data = mujoco.MjData(model)

    def held(q: np.ndarray) -> np.ndarray:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        apart = data.site("end").xpos - data.site("pin").xpos if model.neq else np.zeros(0)
        return np.append(apart[:2], q[0])

    def rows(q: np.ndarray) -> np.ndarray:
        moves = DIFFERENCE * np.eye(q.size)
        return np.array([(held(q + m) - held(q - m)) / (2 * DIFFERENCE) for m in moves]).T

    def conditions(unknown: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        q, pull = np.split(unknown, [sample.key.size])
        return np.concatenate([q - sample.key + rows(q).T @ pull, held(q) - wanted])

    count = held(sample.key).size
    unknown, last = np.append(sample.key, np.zeros(count)), np.eye(count)[-1]
    for value in np.linspace(sample.key[0], sample.value, 11)[1:]:
        unknown = root(conditions, unknown, args=(value * last,), tol=1e-13).x
    assert np.abs(conditions(unknown, sample.value * last)).max() < POSE_TOLERANCE / 10
    q = unknown[: sample.key.size]
    matrix = rows(q)
    lacking = sample.rate * last - matrix @ sample.speed
    return q, sample.speed + np.linalg.pinv(matrix) @ lacking


def first_sample(curves: dict[str, np.ndarray], names: list[str]) -> np.ndarray:
    """Values of channels at the first sample."""
    return np.array([curves[name][0] for name in names])


def references(sample: Sample) -> dict[str, Callable[[], dict[str, np.ndarray]]]:
    """The motions of both general references."""
    model = mujoco.MjModel.from_xml_string(sample.text)
    driven = {"model": model, "joints": ("j0",), "in_time": (TIMES, (sample.profile,))}
    return {
        name: partial(one.solve, *sample.profile(TIMES), **driven)
        for name, one in {"planar": planar, "spatial": spatial}.items()
    }


def engines(sample: Sample, file: Path) -> dict[str, Callable[[], dict[str, np.ndarray]]]:
    """The motions of both engines."""
    file.write_text(sample.text)
    model = mujoco.MjModel.from_xml_string(sample.text)
    channels = tuple(model.sensor(s).name for s in range(model.nsensor))
    drives, settings = (Drive("j0", sample.profile),), {"timestep": STEP}
    run = Run("dynamics", TIMES, channels, drives, settings=settings)
    return {
        name: lambda name=name: engine_of(name).simulate(file, run).channels
        for name in ("mujoco", "pymunk")
    }


@pytest.mark.parametrize("seed", WITHIN_REACH)
def test_all_engines_and_references_start_alike(tmp_path: Path, seed: int):
    """The drive begins elsewhere than in the key, which also has rates of its own."""
    sample = random_mechanism(seed)
    solvers = references(sample) | engines(sample, tmp_path / "model.xml")
    found = {name: solve() for name, solve in solvers.items()}
    poses = [name for name in found["mujoco"] if not name.endswith("_rate")]
    rates = [f"{name}_rate" for name in poses]
    q, v = true_start(sample)
    scale = max(1.0, np.abs(v).max())
    for name, curves in found.items():
        pose, speed = first_sample(curves, poses), first_sample(curves, rates)
        assert np.abs(pose - q).max() < POSE_TOLERANCE, name
        rounding = RATE_ROUNDING.get(name, 0.0)
        assert np.abs(speed - v).max() < (RATE_TOLERANCE + rounding) * scale, name
    for name, rounding in RATE_ROUNDING.items():
        apart = np.abs(first_sample(found[name], poses) - first_sample(found["planar"], poses))
        kept = 4 * (scale * STEP) ** 2 if name == "pymunk" else 0.0  # see STEP
        assert apart.max() < POSE_ROUNDING + kept, name
        apart = np.abs(first_sample(found[name], rates) - first_sample(found["planar"], rates))
        assert apart.max() < rounding * scale, name


@pytest.mark.parametrize("seed", OUT_OF_REACH)
def test_all_refuse_a_start_that_the_loops_do_not_allow(tmp_path: Path, seed: int):
    sample = random_mechanism(seed)
    for solve in references(sample).values():
        with pytest.raises(CannotAssemble):
            solve()
    for solve in engines(sample, tmp_path / "model.xml").values():
        with pytest.raises(BadModel, match=f"j0 = {sample.value:.6g}"):
            solve()


FOUR_BAR = """<mujoco><option timestep="0.002"><flag contact="disable"/></option><worldbody>
<body><joint name="crank" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0.1 0 0" size=".01"/>
 <body pos="0.1 0 0"><joint name="coupler" axis="0 1 0"/><site name="a" pos="0.3 0 0"/>
  <geom type="capsule" fromto="0 0 0 0.3 0 0" size=".01"/></body></body>
<body pos="0.3 0 0"><joint name="rocker" axis="0 1 0"/><site name="b" pos="0.25 0 0"/>
 <geom type="capsule" fromto="0 0 0 0.25 0 0" size=".01"/></body>
</worldbody><equality><connect site1="a" site2="b"/></equality>
<sensor><jointpos name="crank" joint="crank"/><jointpos name="rocker" joint="rocker"/></sensor>
<keyframe><key name="start" qpos="-1.0471975511965976 0.471236417256804 -1.5543932228659467"/>
</keyframe></mujoco>"""


def test_a_key_with_an_angle_off_by_a_hundredth_starts_alike_in_both_references():
    """The coupler's angle is 0.01 rad too large, so that its loop is open by 3 mm."""
    model = mujoco.MjModel.from_xml_string(FOUR_BAR)
    t = np.array([0.0, 0.1])
    one, other = (reference.solve(t, model=model) for reference in (planar, spatial))
    for name in ("crank", "rocker"):
        assert abs(one[name][0] - model.key("start").qpos[0 if name == "crank" else 2]) > 1e-4
        np.testing.assert_allclose(one[name], other[name], rtol=0, atol=1e-10)
