"""Tests of rods in space as chains of links: order, moments, wrong numbers, and refusals."""

from functools import cache
from shutil import copyfile
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from proofmass.analytic.rods.spatial_rod import solve
from proofmass.batch.check import check
from proofmass.sim.mjcf import compile_model
from proofmass.sim.mujoco.engine import ENGINE
from proofmass.sim.mujoco.program import write_rods
from proofmass.sim.protocol.failures import BadModel, BadRod
from proofmass.sim.protocol.run import Rod, Run
from proofmass.sim.rods import Chain, chain
from tests.shipped import shipped
from tests.verdicts import all_comparisons

LENGTH = 1.2
STIFFNESSES = {"torsion": 0.6, "stiffness_y": 0.9, "stiffness": 1.4}
NATURAL_STRAINS = (0.9, -0.6, 1.5)
TIP_FORCE = (1.0, -1.5, 2.0)
DISTRIBUTED_LOAD = (0.3, 0.5, -0.4)
SHAPE_CHANNELS = "x", "y", "z", "normal_x", "normal_y", "normal_z"
MOMENT_CHANNELS = "twist_moment", "bend_moment_y", "bend_moment"
MODEL = """<mujoco><option gravity="0 0 0"/><worldbody><site name="clamp"/></worldbody><actuator>
  <motor name="load" site="rod.tip" refsite="clamp" gear="{:g} {:g} {:g} 0 0 0"/></actuator>
  <keyframe><key name="start" ctrl="1"/></keyframe></mujoco>"""


def rod(segments: int, **others) -> Rod:
    """A rod with three different stiffnesses, naturally twisted and curved about two axes."""
    named = {**STIFFNESSES, "curvature": NATURAL_STRAINS, "load": DISTRIBUTED_LOAD, **others}
    return Rod("rod", "clamp", None, LENGTH, segments=segments, ends=("clamped", "free"), **named)


def rod_curves(tmp_path, one: Rod, force=TIP_FORCE, parts=SHAPE_CHANNELS + MOMENT_CHANNELS):
    """Curves of a rod in equilibrium, at vertices and middles of its links."""
    file = tmp_path / "rod.xml"
    file.write_text(MODEL.format(*force))
    arcs = np.linspace(0.0, LENGTH, 2 * one.segments + 1)
    return ENGINE.simulate(
        file, Run("equilibrium", arcs, tuple(f"rod.{p}" for p in parts), rods=(one,))
    )


def largest_errors(tmp_path, segments: int, **others) -> dict[str, float]:
    """The largest error of each channel of a rod's shape and moments."""
    curves = rod_curves(tmp_path, rod(segments, **others))
    exact = reference_curves(**{k: others[k] for k in ("axial", "shear") if k in others})
    every = (FINEST_SAMPLES - 1) // (curves.x.size - 1)
    return {
        name: float(np.abs(curves.channels[f"rod.{name}"] - exact[name][::every]).max())
        for name in SHAPE_CHANNELS + MOMENT_CHANNELS
    }


FINEST_SAMPLES = 33
"""Number of samples along a rod of sixteen links, among which are those of eight."""


@cache
def reference_curves(**strains: float) -> dict[str, np.ndarray]:
    """Shape and moments of the rod at these samples, by the reference."""
    return solve(
        np.linspace(0.0, LENGTH, FINEST_SAMPLES),
        length=LENGTH,
        **STIFFNESSES,
        **strains,
        **dict(zip(("twist", "curvature_y", "curvature"), NATURAL_STRAINS, strict=True)),
        **{f"force_{name}": value for name, value in zip("xyz", TIP_FORCE, strict=True)},
        **{f"weight_{name}": value for name, value in zip("xyz", DISTRIBUTED_LOAD, strict=True)},
    )


@pytest.mark.parametrize("strains", [{}, {"axial": 40.0, "shear": 25.0}])
def test_errors_fall_with_the_square_of_the_links(strains, tmp_path):
    one, two = (largest_errors(tmp_path, n, **strains) for n in (8, 16))
    for name in SHAPE_CHANNELS[:3]:
        # second order; terms of fourth order change the ratio by 14 % with eight links
        assert one[name] / two[name] == pytest.approx(4.0, rel=0.2), name
    for name in SHAPE_CHANNELS[3:] + MOMENT_CHANNELS:  # these errors alternate from link to link
        assert 2.8 < one[name] / two[name] < 6.0, name
    assert all(value < 0.05 for value in two.values())


def test_hinges_in_the_same_order_in_all_links_are_of_first_order(tmp_path, monkeypatch):
    hinges = Chain.hinges
    monkeypatch.setattr(
        Chain, "hinges", lambda self, link: tuple(sorted(hinges(self, link), key=lambda h: h.axis))
    )
    one, two = (largest_errors(tmp_path, n) for n in (8, 16))
    for name in SHAPE_CHANNELS[:3]:
        assert one[name] / two[name] < 2.6, name


def test_moments_balance_the_force_at_the_tip(tmp_path):
    """In each hinge the moment has the size of the tip's force times its lever.

    This is the equilibrium of the chain itself, exact to Newton's last step.
    """
    one = rod(9, load=(0.0, 0.0, 0.0))
    curves = rod_curves(tmp_path, one).channels
    place = np.stack([curves[f"rod.{name}"] for name in "xyz"], axis=1)
    levers = np.cross(place[-1] - place, TIP_FORCE)
    found = np.stack([curves[f"rod.{name}"] for name in MOMENT_CHANNELS], axis=1)
    sprung = np.arange(1, 2 * one.segments, 2)  # at h/2, 3h/2, ...
    np.testing.assert_allclose(
        np.linalg.norm(found[sprung], axis=1), np.linalg.norm(levers[sprung], axis=1), rtol=1e-9
    )


def test_without_loads_a_chain_keeps_its_natural_shape(tmp_path):
    """The natural shape is a helix, without moments; the key starts in it."""
    one = rod(12, load=(0.0, 0.0, 0.0), curvature=(0.9, 0.0, 1.5))
    curves = rod_curves(tmp_path, one, force=(0.0, 0.0, 0.0)).channels
    for name in MOMENT_CHANNELS:
        np.testing.assert_allclose(curves[f"rod.{name}"], 0.0, atol=1e-12)
    exact = solve(np.linspace(0.0, LENGTH, 25), length=LENGTH, twist=0.9, curvature=1.5)
    for name in SHAPE_CHANNELS[:3]:
        # links are chords of the helix, which is an error in h^2
        np.testing.assert_allclose(curves[f"rod.{name}"], exact[name], atol=5e-3)
    model = compile_model(tmp_path / "rod.xml", (one,))
    about = {hinge.name: hinge.rest for k in range(13) for hinge in chain(one).hinges(k)}
    assert model.njnt == len(about) == 36
    for name, angle in about.items():
        assert model.key_qpos[0, model.joint(name).qposadr[0]] == angle
        spring_there = model.qpos_spring[model.joint(name).qposadr[0]]
        assert spring_there == pytest.approx(angle, rel=1e-14, abs=0)  # by way of degrees
    assert sum(about.values()) == pytest.approx(LENGTH * (0.9 + 1.5))


def test_each_axis_bends_with_its_own_stiffness(tmp_path):
    """Under small loads the deflection is F L^3 / 3EI.

    A chain of n = 20 links lacks 1/(4 n^2) of it.
    """
    straight = {"curvature": (0.0, 0.0, 0.0), "load": (0.0, 0.0, 0.0)}
    for axis, stiffness in ((1, STIFFNESSES["stiffness"]), (2, STIFFNESSES["stiffness_y"])):
        force = 1e-4 * np.eye(3)[axis]
        curves = rod_curves(tmp_path, rod(20, **straight), force=force, parts=SHAPE_CHANNELS)
        deflection = curves.channels[f"rod.{'xyz'[axis]}"][-1]
        of_the_rod = 1e-4 * LENGTH**3 / 3.0 / stiffness
        # the square of the slope 1e-4 L^2/(2 EI), up to 6.4e-9
        assert deflection == pytest.approx(of_the_rod * (1.0 - 1.0 / (4 * 20**2)), rel=1e-8)


def test_a_wrong_stiffness_about_z_differs(edit):
    """A stiffness about z that is wrong by 5 % differs in `rod_bend`.

    The load of the coil hardly bends it about z.
    """
    edit("rod_bend.toml", r"(?s)\[refine\].*?\n\n", "")
    new = "stiffness = 8.75e5\nstiffness_y = 8.333e5"
    file = edit("rod_bend.toml", r"(?s)(\[rod.rod\].*?)stiffness = [^ \n]*", rf"\1{new}")
    assert "differs" in [c.outcome for c in all_comparisons(file)]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("torsion = [^ \n]*", "torsion = 0.0083"),
        ("torsion =", "stiffness_y = 0.0124\ntorsion ="),
        ("curvature = [^\n]*", "curvature = [9.93347, 0.0, 101.0]"),
        ("curvature = [^\n]*", "curvature = [11.0, 0.0, 99.0033]"),
        ("curvature = [^\n]*", "curvature = [9.93347, 2.0, 99.0033]"),
    ],
)
def test_a_wrong_number_of_the_rod_differs(old, new, edit):
    """One turn of the coil has a number that is wrong by 6 to 20 %, or by 1 or 2 per metre.

    The reference keeps the right numbers.
    """
    edit("rod_coil.toml", r"(?s)\[refine\].*?\n\n", "")
    edit("rod_coil.toml", "length = 0.1263", "length = 0.06315")
    edit("rod_coil.toml", "segments = 60", "segments = 30")
    file = edit("rod_coil.toml", rf"(?s)(\[rod.rod\].*?){old}", rf"\1{new}")
    assert "differs" in [c.outcome for c in all_comparisons(file)]


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ("torsion = 8.333e5\naxial", "stiffness_y = 1.0\naxial", "rod.rod", "stiffness_y is of"),
        ("segments", 'scheme = "double"\nsegments', "rod.rod", "torsion is of a rod in space"),
        ("segments", 'to = "clamp"\nsegments', "rod.rod", "torsion is of a rod in space"),
        ("torsion = 8.333e5\naxial", "torsion = 0\naxial", "rod.rod.torsion", "greater than 0"),
        ('"rod.x"', '"rod.angle"', "channels.rod.angle", "rod.x, .y, .z, .normal_x"),
        ("[run.equilibrium]", "[run.dynamics]\nuntil = 1.0", "run.dynamics", "twists"),
        ('["mujoco"]', '["pymunk"]', "run.equilibrium.solvers", "rod 'rod', which twists"),
    ],
)
def test_bad_rods_in_space_are_refused_with_their_key(old, new, key, words, tmp_path):
    text = shipped("rod_bend.toml").read_text(encoding="utf-8")
    text = text[: text.index("[refine]")] + text[text.index("[channels]") :]
    assert old in text
    copyfile(shipped("rod_bend.xml"), tmp_path / "rod_bend.xml")
    file = tmp_path / "rod_bend.toml"
    file.write_text(text.replace(old, new), encoding="utf-8")
    (error,) = check([file]).errors
    assert f"rod_bend.toml: {key}: " in str(error)
    assert words in str(error)


def test_a_rod_in_space_cannot_support_another_rod(tmp_path):
    other = Rod("other", "clamp", "rod.tip", 2.0, 1.0, 5, ("clamped", "pinned"))
    file = tmp_path / "rod.xml"
    file.write_text(MODEL.format(*TIP_FORCE))
    with pytest.raises(BadRod, match=r"no site 'rod\.tip'"):
        compile_model(file, (rod(5), other))


def test_a_program_has_the_rest_angles_of_its_springs(tmp_path):
    """The MJCF of a program has the rest angles of the rod's springs."""
    file = tmp_path / "rod.xml"
    file.write_text(MODEL.format(*TIP_FORCE))
    root = ElementTree.parse(file).getroot()
    root.remove(root.find("keyframe"))
    write_rods(root, file, (rod(5),))
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
    rest = model.qpos_spring[model.joint("rod.2.twist").qposadr[0]]
    assert rest == pytest.approx(NATURAL_STRAINS[0] * LENGTH / 5)


def test_channels_that_a_rod_in_space_lacks_are_refused(tmp_path):
    with pytest.raises(BadModel, match="normal_x"):
        rod_curves(tmp_path, rod(4), parts=("moment",))
