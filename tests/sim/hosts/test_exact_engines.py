"""Pinocchio and Simbody, which have exact constraints and accelerations: orders, drives, forces."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from proofmass.run.solve import prescribed_run
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Diverged, Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.verdict.compare import compare
from tests.engines import why_not_there
from tests.shipped import shipped, shipped_case

EXACT = ("pinocchio", "simbody")
FORCES = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="1e-3" gravity="0.3 0.2 -9.81"><flag contact="disable"/></option>
  <worldbody>
    <body name="arm">
      <joint name="a" axis="0 1 0" stiffness="4 -3 5" springref="0.2" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.5 0.1 0" size="0.03"/>
      <body name="end" pos="0.5 0.1 0">
        <joint name="b" axis="1 0 1" pos="0.01 0 0"/>
        <joint name="c" axis="0 0 1" type="slide" stiffness="300" damping="2"/>
        <geom type="box" size="0.05 0.1 0.02" pos="0.1 0 0"/>
        <site name="tip" pos="0.2 0 0"/>
      </body>
    </body>
    <body name="ball" pos="0 2 0">
      <joint name="socket" type="ball" damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0.1" size="0.04"/>
      <site name="rim" pos="0.3 0 0.1"/>
    </body>
    <body name="flyer" pos="0 1 1">
      <freejoint name="free"/>
      <geom type="box" size="0.1 0.2 0.3" pos="0.05 0 0"/>
      <site name="corner" pos="0.1 0.2 0.3"/>
    </body>
    <site name="post" pos="0.2 1 0.8"/>
    <site name="frame" euler="0.4 0 0.3"/>
  </worldbody>
  <tendon>
    <spatial name="cable" stiffness="60" damping="0.3" springlength="0.2 0.9">
      <site site="tip"/><site site="rim"/></spatial>
    <spatial name="bungee" stiffness="40" springlength="0.1">
      <site site="post"/><site site="corner"/></spatial>
  </tendon>
  <actuator>
    <motor name="motor" joint="a"/>
    <position name="servo" joint="b" kp="6" kv="0.2"/>
    <motor name="thrust" site="corner" gear="0.5 1 0 0 0.2 0"/>
    <motor name="wind" site="rim" refsite="frame" gear="1 0 0.5 0.1 0 0"/>
  </actuator>
  <sensor>
    <jointpos name="a" joint="a"/><jointpos name="b" joint="b"/><jointpos name="c" joint="c"/>
    <framepos name="rim" objtype="site" objname="rim"/>
    <framepos name="corner" objtype="site" objname="corner"/>
    <framelinacc name="pull" objtype="site" objname="corner"/>
  </sensor>
  <keyframe>
    <key name="start" qpos="0.3 0.1 0.02 1 0 0 0 0 1 1 0.8 0.6 0 0" ctrl="0.7 0.4 3 2"
      qvel="0.5 -1 0.1 0.3 2 -1 0.2 0.1 0 1 2 -1"/>
  </keyframe>
</mujoco>
"""
"""All joints in a tree, two joints of a link, and all forces: springs of three terms, cables that
are slack, servos, loads along the world and along their link."""
GEARED = """
<mujoco>
  <option timestep="1e-3" gravity="0 0 0"/>
  <worldbody>
    <body name="one"><joint name="one" axis="0 1 0"{armature}/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.3 0.2 0.3"/></body>
    <body name="two" pos="1 0 0"><joint name="two" axis="0 1 0"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.3 0.1 0.3"/></body>
  </worldbody>
  <equality><joint name="gear" joint1="one" joint2="two" polycoef="0 -2 0 0 0"/></equality>
  <actuator><motor name="motor" joint="two"/></actuator>
  <sensor><jointpos name="one" joint="one"/><jointpos name="two" joint="two"/></sensor>
  <keyframe><key name="start" ctrl="1.8"/></keyframe>
</mujoco>
"""
"""A moment of 1.8 N m on joint two, that has the inertia 0.1 + 2**2 (0.2 + armature) kg m^2."""


@pytest.fixture(scope="module", autouse=True)
def provided() -> None:
    """The packages of both engines."""
    for name in EXACT:
        if why := why_not_there(name):
            pytest.skip(why)


def simulate(engine: str, name: str, **settings: object) -> Curves:
    """The run of a shipped case with settings."""
    case = shipped_case(shipped(f"{name}.toml"))
    run = replace(prescribed_run(case, "dynamics"), settings=settings)
    return engine_of(engine).simulate(case.model_path, run)


def error(engine: str, name: str, **settings: object) -> float:
    """Largest error of a position, as a share of the range of the reference."""
    case = shipped_case(shipped(f"{name}.toml"))
    curves = simulate(engine, name, **settings)
    found = compare(case, "dynamics", engine, curves, detectable=False)
    units = {name: channel.si_unit for name, channel in case.channels_of("dynamics").items()}
    shares = [c.relative_to_range for c in found if units[c.channel] in ("m", "rad", "1")]
    return float(np.nanmax(shares))


def of_text(engine: str, text: str, folder: Path, channels: str, **settings: object) -> Curves:
    """The curves of a second of a model in words."""
    file = folder / "model.xml"
    file.write_text(text)
    run = Run("dynamics", np.linspace(0.0, 1.0, 51), tuple(channels.split()), settings=settings)
    return engine_of(engine).simulate(file, run)


@pytest.mark.parametrize(("name", "step"), [("fourbar_released", 2e-3), ("heavy_top", 5e-4)])
def test_steps_of_pinocchio_are_of_fourth_order(name: str, step: float) -> None:
    """Half a step has a sixteenth of the error, of a loop, and of a ball by Munthe-Kaas."""
    coarse, fine = (error("pinocchio", name, timestep=h) for h in (step, step / 2))
    assert 12 < coarse / fine < 22


@pytest.mark.parametrize("name", ["slider_crank_offset", "hacksaw_sampled", "delta"])
def test_pinocchio_closes_driven_loops_to_rounding(name: str) -> None:
    """What is driven is exact, also where its acceleration jumps, and the loops do the rest.

    So the step does not matter.
    """
    assert error("pinocchio", name, timestep=0.01) < 1e-13


@pytest.mark.slow
@pytest.mark.parametrize("engine", EXACT)
def test_a_change_point_is_passed(engine: str) -> None:
    """Simbody passes it with the accuracy of its catalog; with less it stops there."""
    assert error(engine, "change_point") < 1e-10


@pytest.mark.parametrize("name", ["fourbar_released", "euler_top"])
def test_accuracy_of_simbody_is_its_error(name: str) -> None:
    """The error falls with the accuracy that is asked for."""
    coarse, fine = (error("simbody", name, accuracy=accuracy) for accuracy in (1e-7, 1e-10))
    assert 100 < coarse / fine < 10_000


@pytest.mark.parametrize("engine", EXACT)
@pytest.mark.parametrize(
    ("name", "share"),
    [
        ("spherical_fourbar", 1e-11),  # a loop with redundant equations
        pytest.param("bricard", 3e-9, marks=pytest.mark.slow),  # another one, of six hinges
        pytest.param("andrews", 2e-10, marks=pytest.mark.slow),  # loops and a spring between points
        ("axes_controlled", 1e-6),  # motors in time: splines of Simbody swing where they bend
        ("universal_joint", 1e-10),  # two joints of a link
        ("tower_crane", 1e-8),  # a ball, with Euler angles in Simbody
    ],
)
def test_cases_agree(engine: str, name: str, share: float) -> None:
    """Cases of many features are as good as the steps and the accuracy allow."""
    assert error(engine, name) < share


def test_all_forces_agree(tmp_path: Path) -> None:
    """Forces by hand and elements of OpenSim are the same forces, to the error of the steps."""
    channels = "a b c rim.x rim.y rim.z corner.x corner.y corner.z pull.x pull.y pull.z"
    one, two = (of_text(engine, FORCES, tmp_path, channels) for engine in EXACT)
    for name in channels.split():
        difference = np.abs(one.channels[name] - two.channels[name]).max()
        assert difference < 1e-7 * np.ptp(one.channels[name]), name


@pytest.mark.parametrize(("engine", "armature"), [*((one, 0.0) for one in EXACT), (EXACT[0], 0.5)])
def test_gears_add_inertia(engine: str, armature: float, tmp_path: Path) -> None:
    """A constant moment gives the acceleration of the closed form, and the ratio is kept."""
    text = GEARED.format(armature=f' armature="{armature}"' if armature else "")
    curves = of_text(engine, text, tmp_path, "one two")
    two = 0.5 * curves.x**2 * 1.8 / (0.1 + 4 * (0.2 + armature))
    assert np.allclose(curves.channels["two"], two, atol=1e-12)
    assert np.allclose(curves.channels["one"], -2 * two, atol=1e-12)


def test_simbody_refuses_armatures_by_name(tmp_path: Path) -> None:
    """OpenSim has no element of this kind."""
    with pytest.raises(Unsupported, match="armature of joint 'one'"):
        of_text("simbody", GEARED.format(armature=' armature="0.5"'), tmp_path, "one")


def test_defaults_of_pinocchio_do_not_solve_plane_loops() -> None:
    """Without a proximal shift the equations that a plane leaves over make it singular."""
    with pytest.raises(Diverged, match="not finite"):
        simulate("pinocchio", "fourbar", defaults=True)


def test_defaults_of_simbody_are_coarser() -> None:
    """Its own accuracy is less than that of the catalog."""
    assert 1e-10 < error("simbody", "fourbar", defaults=True) < 1e-7
