"""Tests of rods that stretch and shear, in both engines: their chains, and wrong stiffnesses."""

from dataclasses import replace

import numpy as np
import pytest

from proofmass.batch.check import check
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.failures import BadRod
from proofmass.sim.protocol.run import Rod
from proofmass.sim.rods import chain
from tests.independent.rods import chain_strained
from tests.sim.rod_models import ENGINES, dead_load, equilibrium_curves, write_model
from tests.verdicts import all_comparisons

EACH_ENGINE = pytest.mark.parametrize("engine", ENGINES)
SHAPE_CHANNELS = "r.x", "r.y", "r.angle"
STRAINS = {"both": (40.0, 20.0), "axial": (40.0, None), "shear": (None, 20.0)}


def rod(n: int, strain: str = "both", scheme: str = "half", mass: float | None = None) -> Rod:
    """A rod with L = 1 m and EI = 1 N m^2, clamped at the ground, with some of the `STRAINS`."""
    ends = ("clamped", "free")
    axial, shear = STRAINS[strain]
    about = {"axial": axial, "shear": shear}
    return Rod("r", "ground", None, 1.0, 1.0, n, ends, scheme, mass, 1.0, **about)


@EACH_ENGINE
@pytest.mark.parametrize("strain", STRAINS)
@pytest.mark.parametrize("scheme", ["half", "double"])
def test_a_strained_cantilever_rests_where_its_chain_does(engine, strain, scheme, tmp_path):
    """Angles and ends of all links equal their own equilibrium, under a force and a moment."""
    file = write_model(tmp_path, actuators=dead_load("r.tip", -2.0, 5.0, 0, 0, 0, 0.3), ctrl="1")
    one = chain(rod(6, strain, scheme))
    axial, shear = (np.inf if value is None else value for value in STRAINS[strain])
    angles, ends = chain_strained.free(one.lengths, one.springs, -2 + 5j, 0.3, axial, shear)
    found = equilibrium_curves(
        engine, file, (one.rod,), SHAPE_CHANNELS, samples=13
    ).channels  # every h / 2
    tips = slice(1, None, 2) if scheme == "half" else slice(2, None, 2)
    middles = slice(2, None, 2) if scheme == "half" else slice(1, None, 2)
    at = found["r.x"] + 1j * found["r.y"]
    # both engines end where nothing moves by more than 1e-12 of the model
    np.testing.assert_allclose(at[tips], ends[: at[tips].size], rtol=0, atol=1e-11)
    np.testing.assert_allclose(at[-1], ends[-1], rtol=0, atol=1e-11)
    np.testing.assert_allclose(found["r.angle"][middles], angles[-6:], rtol=0, atol=1e-10)


@EACH_ENGINE
@pytest.mark.parametrize("strain", STRAINS)
def test_a_strained_rod_under_its_weight_converges_with_order_2(engine, strain, tmp_path):
    """The tip converges with order 2, as without slides.

    Loads on the body between two slides cancel.
    """
    file = write_model(tmp_path, gravity="0 -10 0")
    tips = []
    for n in (4, 8, 16):
        found = equilibrium_curves(
            engine, file, (rod(n, strain, mass=0.6),), SHAPE_CHANNELS
        ).channels
        tips.append(found["r.x"][-1] + 1j * found["r.y"][-1])
    first, second = np.abs(np.diff(tips))
    assert np.log2(first / second) == pytest.approx(2.0, abs=0.15)  # terms in h^4 with four links


def test_slides_alternate_and_share_mass_and_inertia(tmp_path):
    """A link with slides has the mass and inertia of the same link without them.

    The order of the two slides alternates from link to link.
    """
    file = write_model(tmp_path)
    rigid = replace(rod(4, mass=2.0), axial=None, shear=None)
    plain, strained = (compile_model(file, [one]) for one in (rigid, rod(4, mass=2.0)))
    for name in ("r.0", "r.1", "r.4"):
        parts = [strained.body(f"{name}{end}") for end in ("", ".x", ".y")]
        whole = plain.body(name)
        assert sum(part.mass[0] for part in parts) == pytest.approx(whole.mass[0], rel=1e-14, abs=0)
        assert sum(part.inertia for part in parts) == pytest.approx(whole.inertia, rel=1e-14, abs=0)
    for k, first, second in ((1, "y", "x"), (2, "x", "y")):
        behind = strained.body(f"r.{k}.{second}").parentid[0]
        assert strained.body(behind).name == f"r.{k}.{first}"
    assert strained.joint("r.1.x").stiffness[0] == pytest.approx(40.0 * 4.0)  # EA/h
    assert strained.joint("r.0.y").stiffness[0] == pytest.approx(20.0 * 8.0)  # GA over half a link


@pytest.mark.parametrize("engine", ENGINES)
def test_a_strained_rod_between_clamps_is_symmetric(engine, tmp_path):
    """An S between two clamps is symmetric about its middle, with stretch and shear."""
    far = '<site name="far" pos="0.9 0.3 0"/>'
    sensor = '<framepos name="middle" objtype="site" objname="r.middle"/>'
    # with 8 links the middle is inside a link: its site is off by half of the link's strain
    for n, off in ((8, 2e-2), (9, 1e-11)):
        clamped_rod = Rod(
            "r", "ground", "far", 1.0, 1.0, n, ("clamped", "clamped"), axial=9.0, shear=9.0
        )
        file = write_model(tmp_path, far, sensors=sensor)
        names = (*SHAPE_CHANNELS, "middle.x", "middle.y")
        found = equilibrium_curves(engine, file, (clamped_rod,), names, samples=2 * n + 1).channels
        np.testing.assert_allclose(found["r.x"] + found["r.x"][::-1], 0.9, atol=1e-11, rtol=0)
        np.testing.assert_allclose(found["r.angle"], found["r.angle"][::-1], atol=1e-10, rtol=0)
        assert found["middle.y"][0] == pytest.approx(0.15, abs=off)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (r"axial = 40.0\n", "axial = 42.0\n"),
        (r"shear = 20.0\n", "shear = 19.0\n"),
        (r"axial = 40.0\n", ""),
        (r"shear = 20.0\n", ""),
    ],
)
def test_a_wrong_axial_or_shear_stiffness_differs(old, new, edit):
    """The rod's stiffness is wrong by 5 % or missing; the reference keeps the right one."""
    edit("rod_sheared.toml", r"(?s)\[refine\].*?\n\n", "")
    edit("rod_sheared.toml", r'"mujoco", "pymunk"', '"mujoco"')
    file = edit("rod_sheared.toml", rf"(?s)(\[rod.rod\].*?){old}", rf"\1{new}")
    assert [c.outcome for c in all_comparisons(file)].count("differs") >= 2


@pytest.mark.parametrize("key", ["axial", "shear"])
@pytest.mark.parametrize("value", ["0.0", "-3.0", "nan"])
def test_invalid_strain_stiffnesses_are_refused_with_their_key(key, value, edit, models):
    good = r"[^ \n]*"
    for where, other in (("parameters", value), ("rod.rod", "40.0")):
        edit("rod_sheared.toml", rf"(?s)(\[parameters\].*?\n{key} = ){good}", rf"\g<1>{other}")
        if where == "rod.rod":
            edit("rod_sheared.toml", rf"(?s)(\[rod.rod\].*?\n{key} = ){good}", rf"\g<1>{value}")
        (error,) = check([models / "rod_sheared.toml"]).errors
        assert f"rod_sheared.toml: {where}" in str(error)
        assert key in str(error)
    one = Rod("r", "ground", None, 1.0, 1.0, 4, ("clamped", "free"), **{key: float(value)})
    with pytest.raises(BadRod, match=f"{key}.*must be positive"):
        chain(one)
