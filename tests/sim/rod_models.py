"""Small models with rods for the tests, and equilibrium runs of them in both engines."""

import json
from functools import partial
from pathlib import Path

import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.mujoco import engine as with_mujoco
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import Drive, Rod, Run
from proofmass.sim.pymunk import engine as with_pymunk
from tests.shipped import shipped

ENGINES = {"mujoco": with_mujoco.simulate, "pymunk": with_pymunk.simulate}
FIGURES = json.loads((Path(__file__).parents[1] / "data" / "rod_in_engines.json").read_text())
PAIR_MODEL = shipped("rfr2_natural.xml")
CLAMP_ANGLES = np.radians([40.0, 60.0])
STEEL_STIFFNESS = 210e9 * np.pi * 0.0015**4 / 64  # bending stiffness EI [N m2] of the pair's rods
MODEL = """<mujoco><compiler angle="radian"/><option gravity="{gravity}"><flag contact="disable"/>
  </option><worldbody><site name="ground"/>{bodies}</worldbody><actuator>{actuators}</actuator>
  <sensor>{sensors}</sensor><keyframe><key name="start" ctrl="{ctrl}"/></keyframe></mujoco>"""


def write_model(
    folder: Path,
    bodies: str = "",
    actuators: str = "",
    sensors: str = "",
    ctrl: str = "",
    gravity: str = "0 0 0",
) -> Path:
    """Write an MJCF with these elements and return its path."""
    file = folder / "model.xml"
    file.write_text(
        MODEL.format(
            bodies=bodies, actuators=actuators, sensors=sensors, ctrl=ctrl, gravity=gravity
        )
    )
    return file


def dead_load(site: str, *gear: float) -> str:
    """The MJCF of a motor that applies a dead load: force and moment in world axes, at a site."""
    row = " ".join(map(str, [*gear, *[0.0] * (6 - len(gear))]))
    return f'<motor name="pull" site="{site}" refsite="ground" gear="{row}"/>'


def equilibrium_curves(
    engine: str,
    file: Path,
    rods: tuple[Rod, ...],
    channels: tuple[str, ...],
    drives: tuple[Drive, ...] = (),
    samples: int = 2,
) -> Curves:
    """Curves of an equilibrium run, at `samples` evenly spaced places along the first rod."""
    s = np.linspace(0.0, rods[0].length, samples)
    return ENGINES[engine](file, Run("equilibrium", s, channels, drives, rods=rods))


def constant_profile(value: float, x: Array) -> tuple[Array, Array, Array]:
    """A motion profile that keeps a joint at a value."""
    return np.full(x.shape, value), 0 * x, 0 * x


def rod_pair(name: str, segments: int, scheme: str = "half") -> tuple[Rod, Rod]:
    """The two rods of the pair, with the turns that lead to one of its equilibria."""
    left, right = np.radians(FIGURES["pair"][name]["turns"])
    dimensions = 1.0, STEEL_STIFFNESS, segments
    return (
        Rod("left", "clamp1", None, *dimensions, ("clamped", "free"), scheme, turn=left),
        Rod("right", "clamp2", "left.tip", *dimensions, ("clamped", "pinned"), scheme, turn=right),
    )


def fixed_motors() -> tuple[Drive, Drive]:
    """The drives that keep the pair's two motors at the angles of the clamps."""
    one, two = (
        Drive(f"motor{k}", partial(constant_profile, angle))
        for k, angle in enumerate(CLAMP_ANGLES, 1)
    )
    return one, two
