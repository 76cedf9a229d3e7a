"""Tests of changes of single numbers of a model: each acts on its number and on nothing else."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.run.sidecar import load_case
from proofmass.sim.elements import (
    NotWritten,
    Number,
    Source,
    changed_rods,
    compile_source,
    write_changes,
)
from proofmass.sim.mjcf import compile_model
from proofmass.sim.numbers import Sizes, numbers_of
from tests.shipped import shipped, sidecar_parameters

SIZES = Sizes(1.0, 1.0, 1.0)
DRAWING_FIELDS = ("geom", "bvh", "cam", "light", "stat", "vis")
CASE_NAMES = [
    "fourbar",
    "slider_crank_inclined",
    "balancer_sine_free_preload",
    "balancer_sine_nonlinear",
]
CASE_NAMES += ["pendulum", "hacksaw", "rfr2_natural", "rfr3", "andrews"]


def arrays(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """All arrays of real numbers of a compiled model, except those for drawing."""
    found = {
        name: getattr(model, name) for name in dir(model) if not name.startswith(DRAWING_FIELDS)
    }
    found["gravity"] = model.opt.gravity.copy()
    return {k: v for k, v in found.items() if isinstance(v, np.ndarray) and v.dtype.kind == "f"}


def any_number_differs(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    """Whether any number differs between two models."""
    return any((one[key] != other[key]).any() for key in one)


def source_and_numbers(name: str) -> tuple[Source, list[Number]]:
    case = load_case(shipped(f"{name}.toml"))
    source = compile_source(case.model_path, case.start, case.rods)
    return source, numbers_of(source, SIZES, [drive.joint for drive in case.drive])


@pytest.mark.parametrize("file", sidecar_parameters())
def test_a_change_by_zero_changes_nothing(file, tmp_path):
    source, numbers = source_and_numbers(file.stem)
    copy = tmp_path / source.path.name
    copy.write_text(write_changes(source, [(number, 0.0) for number in numbers]))
    again = arrays(compile_model(copy, source.rods))
    for key, values in arrays(source.full).items():
        np.testing.assert_array_equal(again[key], values, err_msg=key)
    assert len({number.name for number in numbers}) == len(numbers)


@pytest.mark.parametrize("name", CASE_NAMES)
def test_a_change_acts_on_its_number_only(name, tmp_path):
    """One number of each attribute of each tag, in the last element that has it."""
    source, numbers = source_and_numbers(name)
    last_of_each_kind = {(n.kind, n.place.tag, n.place.attribute, n.place.part): n for n in numbers}
    case = load_case(shipped(f"{name}.toml"))
    driven = [drive.joint for drive in case.drive]
    massless = {"gravity"} if source.rods else set()  # with gravity, rods need a mass
    before, full = arrays(source.bare), arrays(source.full)
    for number in last_of_each_kind.values():
        if number.place.tag == "rod" or number.kind in massless:
            continue
        file = tmp_path / source.path.name
        file.write_text(write_changes(source, [(number, 1e-3 * number.step)]))
        changed = compile_source(file, source.key, source.rods)
        after = {one.name: one.value for one in numbers_of(changed, SIZES, driven)}
        turned = number.place.attribute in ("turn", "inertia")
        for one in numbers:
            expected = one.value + (1e-3 * number.step if one == number and not turned else 0.0)
            if one.kind == "rest angle" and number.kind == "zero":
                continue  # a spring without a rest angle of its own is at rest at the joint's zero
            assert after.get(one.name, expected) == pytest.approx(expected, abs=1e-15), one.name
        assert any_number_differs(before, arrays(changed.bare)) or any_number_differs(
            full, arrays(changed.full)
        ), number


def test_changed_directions_and_inertias_have_the_stated_values(tmp_path):
    source, numbers = source_and_numbers("slider_crank_inclined")
    by_name = {number.name: number for number in numbers}

    def changed(name: str, by: float) -> mujoco.MjModel:
        file = tmp_path / "model.xml"
        file.write_text(write_changes(source, [(by_name[name], by)]))
        return compile_model(file)

    axis = changed("direction of joint slider", 0.1).jnt_axis[2]
    np.testing.assert_allclose(axis, [np.cos(0.1), np.sin(0.1), 0.0], atol=1e-15, rtol=0)
    quat = changed("direction of body slider", 0.1).body_quat[3]
    angle = (0.4636476090008061 + 0.1) / 2
    np.testing.assert_allclose(quat, [np.cos(angle), 0, 0, np.sin(angle)], atol=1e-15, rtol=0)
    inertia = changed("inertia of crank", 0.1).body_inertia[1]
    np.testing.assert_allclose(inertia, 1.1 * source.full.body_inertia[1], rtol=1e-15)


TENDONS_WITH_SPRINGS = """<mujoco><worldbody><site name="wall"/><body name="b"><joint name="j"/>
<geom size=".1"/><site name="tip" pos="1 0 0"/></body></worldbody><tendon>
<spatial name="slack" stiffness="3" springlength=".2 .5"><site site="wall"/><site site="tip"/>
</spatial><spatial name="damper" damping="2"><site site="wall"/><site site="tip"/></spatial>
</tendon></mujoco>"""


def test_a_spring_between_two_points_has_stiffness_damping_and_two_lengths(tmp_path):
    file, other = tmp_path / "sprung.xml", tmp_path / "changed.xml"
    file.write_text(TENDONS_WITH_SPRINGS)
    source = compile_source(file, "start")
    numbers = {one.name: one for one in numbers_of(source, SIZES)}
    assert "site of tip x" in numbers
    assert "spring length of tendon damper" not in numbers  # it has no spring
    for name, field, index, value in (
        ("stiffness of tendon slack", "tendon_stiffness", 0, 3.0),
        ("damping of tendon damper", "tendon_damping", 1, 2.0),
        ("damping of tendon slack", "tendon_damping", 0, 0.0),
        ("spring length of tendon slack low", "tendon_lengthspring", (0, 0), 0.2),
        ("spring length of tendon slack high", "tendon_lengthspring", (0, 1), 0.5),
    ):
        assert numbers[name].value == value
        other.write_text(write_changes(source, [(numbers[name], 0.1)]))
        before, after = arrays(source.full), arrays(compile_model(other))
        changed = [key for key in before if (before[key] != after[key]).any()]
        assert changed == [field], name
        expected = before[field].copy()
        expected[index] += 0.1
        np.testing.assert_allclose(after[field], expected, atol=1e-15, rtol=0)


MODEL_IN_DEGREES = """<mujoco><compiler autolimits="true"/>
<default><joint damping="0.5"/></default>
<worldbody><body name="b" euler="0 0 30"><joint name="j" axis="0 0 1" range="-90 45" ref="10"
springref="20" stiffness="3"/><geom type="capsule" size=".1" fromto="0 0 0 1 0 0"/></body>
</worldbody></mujoco>"""


def test_numbers_from_degrees_defaults_and_geoms_are_changed(tmp_path):
    file = tmp_path / "degrees.xml"
    file.write_text(MODEL_IN_DEGREES)
    source = compile_source(file, "start")
    numbers = {one.name: one for one in numbers_of(source, SIZES)}
    assert numbers["range of j high"].value == pytest.approx(np.pi / 4)
    assert numbers["damping of j"].value == 0.5
    other = tmp_path / "changed.xml"
    for name, field, index, by in (
        ("range of j high", "jnt_range", (0, 1), 0.1),
        ("rest angle of j", "qpos_spring", (0,), 0.1),
        ("zero of j", "qpos0", (0,), 0.1),
        ("damping of j", "dof_damping", (0,), 0.1),
        ("mass of b", "body_mass", (1,), 0.1),
    ):
        other.write_text(write_changes(source, [(numbers[name], by)]))
        model = compile_model(other)
        for key, values in arrays(source.full).items():
            if key in (
                "jnt_range",
                "qpos_spring",
                "qpos0",
                "dof_damping",
                "body_mass",
                "body_quat",
            ):
                expected = np.array(values)
                if key == field:
                    expected[index] += by
                np.testing.assert_allclose(
                    getattr(model, key), expected, atol=1e-15, err_msg=name, rtol=0
                )


MASSLESS_BODIES = """<mujoco><worldbody><body name="link" pos="1 0 0"><joint axis="0 0 1"/>
<inertial pos=".3 0 0" mass="1" diaginertia="1 1 1"/>
<body name="pin" pos="2 0 0" euler="0 0 30"><site name="at"/></body>
<body name="said" pos="2 0 0"><inertial pos=".5 0 0" mass="0" diaginertia="0 0 0"/></body>
</body></worldbody></mujoco>"""


def test_a_body_without_mass_gets_it_at_its_own_origin(tmp_path):
    """MuJoCo compiles the position of a massless body in its parent as its centre of mass."""
    file, other = tmp_path / "massless.xml", tmp_path / "changed.xml"
    file.write_text(MASSLESS_BODIES)
    source = compile_source(file, "start")
    assert source.full.body_ipos[2, 0] == 2.0
    numbers = {one.name: one for one in numbers_of(source, SIZES)}
    assert numbers["centre of mass of pin x"].value == 0.0
    other.write_text(
        write_changes(source, [(numbers["mass of pin"], 0.1), (numbers["mass of said"], 0.1)])
    )
    changed = compile_model(other)
    np.testing.assert_array_equal(changed.body_ipos[2:, 0], [0.0, 0.5])
    np.testing.assert_array_equal(changed.body_iquat[2], [1.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(changed.body_mass[2:], [0.1, 0.1])


def test_numbers_of_rods_are_keys_of_the_sidecar():
    source, numbers = source_and_numbers("rfr2_natural")
    by_name = {number.name: number for number in numbers}
    changes = [(by_name["length of left"], 0.1), (by_name["stiffness of a rod of right"], 0.01)]
    found = changed_rods(source.rods, changes)
    assert found["left"] == {"length": pytest.approx(1.1)}
    assert found["right"] == {"stiffness": pytest.approx(0.06218602640386952)}
    assert write_changes(source, changes) == write_changes(source, [])


def test_disabled_and_out_of_plane_quantities_are_not_listed(tmp_path):
    text = shipped("fourbar.xml").read_text()
    file = tmp_path / "off.xml"
    file.write_text(re.sub("<flag ", '<flag damper="disable" gravity="disable" ', text))
    kinds = {one.kind for one in numbers_of(compile_source(file, "start"), SIZES, ["crank"])}
    assert kinds.isdisjoint({"damping", "gravity", "start value"})
    assert not any(one.of.endswith(" z") for one in source_and_numbers("fourbar")[1])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<worldbody>", '<worldbody><replicate count="2"><site/></replicate>', "<replicate>"),
        ('<compiler angle="radian"/>', '<compiler angle="radian" settotalmass="3"/>', "settotalm"),
        (
            '<compiler angle="radian"/>',
            '<compiler angle="radian" inertiafromgeom="true"/>',
            "inertiaf",
        ),
    ],
)
def test_a_file_that_does_not_state_its_numbers_is_refused(old, new, words, tmp_path):
    text = shipped("fourbar.xml").read_text().replace('mass="0"', 'mass="0.1"')
    file: Path = tmp_path / "other.xml"
    file.write_text(text.replace(old, new))
    with pytest.raises(NotWritten, match=words):
        numbers_of(compile_source(file, "start"), SIZES)


def test_changes_of_numbers_in_a_frame_are_refused(tmp_path):
    text = shipped("fourbar.xml").read_text()
    file = tmp_path / "framed.xml"
    framed = text.replace('<body name="rocker"', '<frame><body name="rocker"')
    file.write_text(framed.replace("</worldbody>", "</frame></worldbody>"))
    source = compile_source(file, "start")
    numbers = {one.name: one for one in numbers_of(source, SIZES)}
    with pytest.raises(NotWritten, match="in a frame"):
        write_changes(source, [(numbers["place of rocker x"], 0.1)])
    write_changes(source, [(numbers["place of coupler x"], 0.1)])
