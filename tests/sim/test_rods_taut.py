"""Tests of rods that are straight or taut between their supports, in both engines."""

import numpy as np
import pytest

from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.failures import BadRod
from proofmass.sim.protocol.run import Rod
from tests.sim.rod_models import ENGINES, equilibrium_curves, write_model
from tests.verdicts import all_comparisons

FAR_SITE = '<site name="far" pos="1 0 0"/>'
END_PAIRS = [("clamped", "pinned"), ("pinned", "pinned"), ("clamped", "clamped")]


@pytest.mark.parametrize("ends", END_PAIRS)
@pytest.mark.parametrize("length", [1.0, 0.9])
def test_taut_rods_sag_equally_in_both_engines(ends, length, tmp_path):
    """Rods under a distributed load have the same shape in both engines.

    A taut rod sags less than a straight one, and rods with equal ends are symmetric.
    """
    file = write_model(tmp_path, FAR_SITE)
    rod = Rod("r", "ground", "far", length, 0.1, 8, ends, axial=40.0, load=(0.0, -3.0, 0.0))
    found = {
        engine: equilibrium_curves(engine, file, (rod,), ("r.x", "r.y"), samples=17).channels
        for engine in ENGINES
    }
    for name in ("r.x", "r.y"):
        # both engines end where nothing moves by 1e-12 of the model
        np.testing.assert_allclose(found["mujoco"][name], found["pymunk"][name], atol=1e-11, rtol=0)
    x, y = (found["mujoco"][name] for name in ("r.x", "r.y"))
    assert (x[-1], y[-1]) == pytest.approx((1.0, 0.0), abs=1e-12)
    assert -0.2 < y.min() < -0.02
    if ends[0] == ends[1]:
        np.testing.assert_allclose(y, y[::-1], atol=1e-11, rtol=0)
    assert (y.min() > -0.062) == (length < 1.0)


def test_links_start_stretched_and_straight(tmp_path):
    rod = Rod("r", "ground", "far", 0.9, 0.1, 4, ("clamped", "pinned"), axial=40.0)
    found = compile_model(write_model(tmp_path, FAR_SITE), [rod])
    values = {found.joint(j).name: v for j, v in enumerate(found.key_qpos[0])}
    stretched = [values[f"r.{k}.x"] for k in range(5)]
    # each link is stretched by a ninth of its length
    assert stretched == pytest.approx([0.0125, 0.025, 0.025, 0.025, 0.0125])
    assert [values[f"r.{k}"] for k in range(1, 5)] == [0.0] * 4


@pytest.mark.parametrize("length", [1.0, 0.9])
def test_a_straight_rod_that_does_not_stretch_is_refused(length, tmp_path):
    """Both engines would search for the axial force of a rod that cannot change its length."""
    rod = Rod("r", "ground", "far", length, 0.1, 8, ("clamped", "pinned"))
    for engine in ENGINES:
        with pytest.raises(BadRod, match=r"length.*must be longer, or stretch: axial = EA \[N\]"):
            equilibrium_curves(engine, write_model(tmp_path, FAR_SITE), (rod,), ("r.y",))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (r"axial = 50.0\nmass", "axial = 51.0\nmass"),
        ("mass = 0.098", "mass = 0.099"),
        (r"length = 0.98\nstiffness", "length = 0.981\nstiffness"),
    ],
)
def test_a_wrong_taut_rod_differs(old, new, edit):
    edit("rod_taut.toml", '"mujoco", "pymunk"', '"mujoco"')
    file = edit("rod_taut.toml", old, new)
    assert "differs" in {c.outcome for c in all_comparisons(file)}
