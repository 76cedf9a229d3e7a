"""Tests of loads on rods, in both engines: distributed loads, and loads that follow the tips."""

from dataclasses import replace

import numpy as np
import pytest

from proofmass.batch.check import check
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Rod
from proofmass.sim.rods import chain
from tests.independent.rods import chain_strained
from tests.sim.rod_models import ENGINES, dead_load, equilibrium_curves, write_model
from tests.verdicts import all_comparisons

EACH_ENGINE = pytest.mark.parametrize("engine", ENGINES)
TIP_CHANNELS = "r.x", "r.y"
CANTILEVER = Rod("r", "ground", None, 1.0, 1.0, 6, ("clamped", "free"), turn=0.5)
FOLLOWER_LOAD = '<motor name="follower" site="r.tip" gear="-1 4 0 0 0 0.2"/>'


@EACH_ENGINE
@pytest.mark.parametrize("strain", [None, 30.0])
def test_a_chain_under_all_loads_equals_the_links_equilibrium(engine, strain, tmp_path):
    """Under weight, wind, dead and follower loads together, the links are in equilibrium."""
    file = write_model(
        tmp_path,
        actuators=dead_load("r.tip", 1.0, -0.5) + FOLLOWER_LOAD,
        ctrl="1 1",
        gravity="0 -10 0",
    )
    rod = replace(CANTILEVER, mass=0.2, load=(0.7, 0.4, 0.0), axial=strain)
    one = chain(rod)
    loads = {"line": 0.7 - 1.6j, "follower": -1.0 + 4.0j}
    angles, ends = chain_strained.free(
        one.lengths, one.springs, 1.0 - 0.5j, 0.2, strain or np.inf, np.inf, **loads
    )
    found = equilibrium_curves(
        engine, file, (rod,), (*TIP_CHANNELS, "r.angle"), samples=13
    ).channels
    at = found["r.x"] + 1j * found["r.y"]
    # both engines end where nothing moves by more than 1e-12 of the model
    np.testing.assert_allclose(at[1::2], ends[:-1], rtol=0, atol=1e-11)
    np.testing.assert_allclose(at[-1], ends[-1], rtol=0, atol=1e-11)
    np.testing.assert_allclose(found["r.angle"][2::2], angles[1:], rtol=0, atol=1e-10)


@EACH_ENGINE
def test_a_distributed_load_acts_as_the_same_weight(engine, tmp_path):
    """A load per length has the same effect as gravity on a mass, for a rod with a pinned end."""
    clamped_pinned = Rod(
        "r", "ground", "far", 1.0, 1.0, 8, ("clamped", "pinned"), mass=0.5, turn=1.0
    )
    far = '<site name="far" pos="0.9 0.1 0"/>'
    heavy, windy = (
        equilibrium_curves(
            engine, write_model(tmp_path, far, gravity=gravity), (rod,), TIP_CHANNELS, samples=9
        ).channels
        for gravity, rod in (
            ("6 -10 0", clamped_pinned),
            ("0 0 0", replace(clamped_pinned, load=(3.0, -5.0, 0.0))),
        )
    )
    for name in TIP_CHANNELS:
        np.testing.assert_allclose(heavy[name], windy[name], rtol=0, atol=1e-11)


def test_a_wind_out_of_the_plane_is_refused_by_pymunk(tmp_path):
    rod = replace(CANTILEVER, load=(0.0, 0.0, 1.0))
    with pytest.raises(Unsupported, match=r"the load of body 'r\.1' leaves the plane of motion"):
        equilibrium_curves("pymunk", write_model(tmp_path), (rod,), TIP_CHANNELS)


def test_a_load_in_the_frame_of_another_body_is_refused_by_pymunk(tmp_path):
    body = '<body name="b"><joint name="j"/><geom size="0.1"/><site name="moving"/></body>'
    motor = '<motor name="m" site="r.tip" refsite="moving" gear="0 1 0 0 0 0"/>'
    with pytest.raises(Unsupported, match="actuator 'm', which acts at a site whose refsite moves"):
        equilibrium_curves(
            "pymunk", write_model(tmp_path, body, motor, ctrl="1"), (CANTILEVER,), TIP_CHANNELS
        )


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("rod_wind.toml", r"load = \[4.0", "load = [4.1"),
        ("rod_wind.toml", r"load = .*\n", ""),
        ("rod_wind.toml", "mass = 1.0", "mass = 1.02"),
        ("rod_wind.xml", "0 -9.81 0", "0 -9.7 0"),
        ("rod_follower.xml", 'gear="-0.25 1', 'gear="-0.26 1'),
        ("rod_follower.xml", 'ctrl="8"', 'ctrl="8.1"'),
        ("rod_follower.xml", 'site="rod.tip"', 'site="rod.tip" refsite="clamp"'),
    ],
)
def test_a_wrong_load_of_a_rod_differs(name, old, new, edit):
    """A load that is wrong by 1 to 4 % differs in MuJoCo.

    A missing load, and a dead load instead of a follower load, differ in pymunk.
    """
    sidecar = edit(name, old, new).with_suffix(".toml")
    solver = "pymunk" if new == "" or "refsite" in new else "mujoco"
    edit(sidecar.name, '"mujoco", "pymunk"', f'"{solver}"')
    assert "differs" in {c.outcome for c in all_comparisons(sidecar)}


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("4.0", "valid tuple"),
        ("[4.0, 0.0]", "load.2"),
        ("[nan, 0.0, 0.0]", "finite"),
        ('["a", 0.0, 0.0]', "load.0"),
    ],
)
def test_invalid_loads_of_rods_are_refused_with_their_key(value, words, edit):
    file = edit("rod_wind.toml", r"(?m)^load = .*", f"load = {value}")
    (error,) = check([file]).errors
    assert "rod_wind.toml: rod.rod.load" in str(error)
    assert words in str(error)


def test_a_straight_rod_under_a_large_follower_force_is_unstable(tmp_path):
    """MuJoCo requires a positive definite stiffness.

    A follower force of 30 N along the tip leaves none.
    """
    file = write_model(
        tmp_path, actuators=FOLLOWER_LOAD.replace("-1 4 0 0 0 0.2", "-30 0 0 0 0 0"), ctrl="1"
    )
    with pytest.raises(BadModel, match="unstable equilibrium"):
        equilibrium_curves("mujoco", file, (replace(CANTILEVER, turn=0.0),), TIP_CHANNELS)
