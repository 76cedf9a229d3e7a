"""Rods that are curved without loads, couples along rods, and start shapes, in both engines."""

from dataclasses import replace

import numpy as np
import pytest

from proofmass.base.errors import InputError
from proofmass.run.sidecar import load_case
from proofmass.sim.mjcf import compile_model
from proofmass.sim.mujoco.flex import cut_into_links
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.run import Rod
from tests.shipped import shipped
from tests.sim.rod_models import ENGINES, equilibrium_curves, write_model

EACH_ENGINE = pytest.mark.parametrize("engine", ENGINES)
CANTILEVER = Rod("r", "ground", None, 1.0, 2.0, 8, ("clamped", "free"))


def curves(engine, folder, rod, *parts, bodies=""):
    channels = tuple(f"r.{part}" for part in parts)
    found = equilibrium_curves(engine, write_model(folder, bodies), (rod,), channels, samples=9)
    return [found.channels[name] for name in channels]


@EACH_ENGINE
@pytest.mark.parametrize("scheme", ["half", "double"])
def test_a_curved_rod_without_load_is_an_arc_without_moments(engine, scheme, tmp_path):
    rod = replace(CANTILEVER, curvature=(0.0, 0.0, 1.5), scheme=scheme)
    angle, moment = curves(engine, tmp_path, rod, "angle", "moment")
    np.testing.assert_allclose(angle, 1.5 * np.linspace(0.0, 1.0, 9), atol=1e-10)
    np.testing.assert_allclose(moment, 0.0, atol=1e-10)


@EACH_ENGINE
def test_a_couple_bends_a_rod_by_its_sum_of_moments(engine, tmp_path):
    """m = l (L - s), so that the tip turns by l L^2/(2 EI): the chain of half links is exact."""
    angle, moment = curves(engine, tmp_path, replace(CANTILEVER, couple=0.6), "angle", "moment")
    s = np.linspace(0.0, 1.0, 9)
    np.testing.assert_allclose(angle, 0.6 / 2.0 * (s - s**2 / 2.0), atol=1e-10)
    np.testing.assert_allclose(moment, 0.6 * (1.0 - s), atol=1e-10)


@EACH_ENGINE
def test_a_couple_turns_about_the_z_axis_of_the_site_where_the_rod_begins(engine, tmp_path):
    upside_down = '<site name="back" quat="0 1 0 0"/>'
    rod = replace(CANTILEVER, couple=0.6, start="back")
    (y,) = curves(engine, tmp_path, rod, "y", bodies=upside_down)
    (up,) = curves(engine, tmp_path, replace(rod, start="ground"), "y")
    assert up[-1] > 0.05
    np.testing.assert_allclose(y, -up, atol=1e-10)


@EACH_ENGINE
def test_a_rod_starts_in_its_shape_and_may_turn_more_than_once_between_two_clamps(engine, tmp_path):
    """A loop between two clamps in line keeps its turn: the other equilibrium is less bent."""
    far = '<site name="far" pos="0.3 0 0"/>'
    s = np.linspace(0.0, 1.0, 9)[1:]
    loop = replace(
        CANTILEVER,
        end="far",
        ends=("clamped", "clamped"),
        segments=16,
        shape=tuple((2 * np.pi * s + 0.8 * np.sin(2 * np.pi * s)).tolist()),
    )
    (angle,) = curves(engine, tmp_path, loop, "angle", bodies=far)
    assert angle[-1] == pytest.approx(2 * np.pi, abs=1e-9)
    (angle,) = curves(
        engine, tmp_path, replace(loop, shape=(1.2, 0.0, -1.2, 0.0)), "angle", bodies=far
    )
    assert angle[-1] == pytest.approx(0.0, abs=1e-9)


def test_a_shape_of_one_angle_is_an_arc(tmp_path):
    file = write_model(tmp_path)
    arc = compile_model(file, (replace(CANTILEVER, turn=0.7),)).key_qpos
    np.testing.assert_allclose(
        compile_model(file, (replace(CANTILEVER, shape=(0.7,)),)).key_qpos, arc, atol=1e-14
    )


@pytest.mark.parametrize(
    ("added", "words"),
    [
        ("turn = 0.3\nshape = [0.1, 0.2]", "turn and shape are both given"),
        ("curvature = [0.1, 0.0, 1.0]", "of a rod in space"),
        ('shape = ["a"]', "shape"),
        ("couple = true", "couple"),
        ("torsion = 1.0\ncouple = 0.1", "couple is of a rod in the plane"),
    ],
)
def test_bad_keys_of_natural_rods_are_refused(added, words, tmp_path):
    text = shipped("rod_wind.toml").read_text().replace("[run.equ", f"{added}\n[run.equ")
    (tmp_path / "rod_wind.xml").write_text(shipped("rod_wind.xml").read_text())
    file = tmp_path / "rod_wind.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=r"rod\.rod") as raised:
        load_case(file)
    assert words in str(raised.value)


@pytest.mark.parametrize("changed", [{"couple": 0.1}, {"curvature": (0.0, 0.0, 1.0)}])
def test_a_flex_refuses_what_it_lacks(changed):
    with pytest.raises(Unsupported, match="a flex"):
        cut_into_links(replace(CANTILEVER, **changed))
