"""A URDF is read as what it says, and what is left out or assumed is said in words."""

import os
import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.sim.mjcf import compile_model
from proofmass.sim.model_source import ModelSource
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.urdf import mjcf_of_urdf, read_urdf

HAND_WRITTEN = """
<mujoco><compiler angle="radian" autolimits="true"/><worldbody>
  <body name="upper" pos="0 0 1">
    <joint name="shoulder" axis="0 1 0" damping="0.123456789" frictionloss="0.2" range="-1 2"/>
    <inertial pos="0 0 -0.25" mass="2" diaginertia="0.05 0.04 0.01"/>
    <body name="lower" pos="0 0 -0.333333333333">
      <joint name="elbow" axis="0 1 0"/>
      <inertial pos="0 0 -0.2" mass="1" diaginertia="0.02 0.02 0.001"/>
    </body>
  </body></worldbody></mujoco>"""
NUMBERS = "body_pos", "body_ipos", "body_mass", "body_inertia", "jnt_axis", "jnt_range"
NUMBERS += "dof_damping", "dof_frictionloss"


def link(name: str, mass: float, along: float, inertia: tuple[float, ...], more: str = "") -> str:
    """A link of an arm that hangs along z."""
    xx, yy, zz = inertia
    return f"""<link name="{name}"><inertial><origin xyz="0 0 {along}"/><mass value="{mass}"/>
      <inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>{more}</link>"""


def joint(name: str, parent: str, child: str, more: str = "", kind: str = "continuous") -> str:
    """A joint about y."""
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
      <axis xyz="0 1 0"/>{more}</joint>"""


UPPER = link("upper", 2, -0.25, (0.05, 0.04, 0.01))
LOWER = link("lower", 1, -0.2, (0.02, 0.02, 0.001))
SHOULDER = joint(
    "shoulder",
    "base",
    "upper",
    '<origin xyz="0 0 1"/><limit lower="-1" upper="2" effort="9" velocity="3"/>'
    '<dynamics damping="0.123456789" friction="0.2"/>',
    "revolute",
)
ELBOW = joint("elbow", "upper", "lower", '<origin xyz="0 0 -0.333333333333"/>')
MESH = '<collision><geometry><mesh filename="{}"/></geometry></collision>'
BASE = '<link name="base"/>'


@pytest.fixture
def write(tmp_path):
    """``write(*elements)`` writes a URDF and returns its path."""

    def of(*elements: str, name: str = "arm.urdf") -> Path:
        file = tmp_path / "pkg" / "urdf" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f'<?xml version="1.0"?>\n<robot name="arm">{"".join(elements)}</robot>')
        return file

    return of


def write_stl(file: Path) -> None:
    """A tetrahedron with edges of 1 m."""
    corners = np.vstack([np.zeros(3), np.eye(3)])
    faces = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]
    file.parent.mkdir(parents=True, exist_ok=True)
    body = b"".join(
        struct.pack("<12fH", 0, 0, 0, *np.ravel([corners[k] for k in face]), 0) for face in faces
    )
    file.write_bytes(bytes(80) + struct.pack("<I", 4) + body)


def refused(file: Path) -> str:
    """The message with which a URDF is refused."""
    with pytest.raises(BadModel) as error:
        read_urdf(file)
    return str(error.value)


def test_an_arm_has_the_numbers_of_the_same_arm_in_mjcf(write):
    """The MJCF was written by hand; the one that is made of the URDF has all their digits too."""
    by_hand = mujoco.MjModel.from_xml_string(HAND_WRITTEN)
    file = write(BASE, UPPER, LOWER, SHOULDER, ELBOW)
    found = read_urdf(file)
    text, remarks = mjcf_of_urdf(file)
    made = file.with_name("made.xml")
    made.write_text(text)
    for model in (found.model, compile_model(made)):
        for name in NUMBERS:
            there, expected = getattr(model, name), getattr(by_hand, name)
            np.testing.assert_allclose(there, expected, rtol=1e-15, atol=1e-15, err_msg=name)
    assert found.model.jnt_actfrcrange.tolist() == [[-9, 9], [0, 0]]
    assert remarks == found.remarks == ("not carried over: largest velocity of joint shoulder",)
    assert "velocity of joint shoulder." in text.partition("-->")[0]


def test_what_is_left_out_or_assumed_is_said(write):
    mimic = '<mimic joint="shoulder" multiplier="2"/>'
    box = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
    file = write(
        link("base", 1, 0, (1, 1, 1)),
        UPPER,
        f'<link name="lower">{box}</link>',
        SHOULDER.replace("</joint>", "<safety_controller/></joint>"),
        joint("elbow", "upper", "lower", mimic),
        joint("loose", "base", "tip", mimic, "floating"),
        link("tip", 1, 0, (1, 1, 1)),
        '<transmission name="t"><joint name="elbow"/></transmission><gazebo/><gazebo/>',
    )
    found = read_urdf(file)
    assert found.remarks == (
        "link 'base' and what is fixed to it stand still: nothing in the URDF joins it to the "
        "world; if it is to move, give it a joint of type floating",
        "no <inertial> in link lower: the mass is that of the geometry with 1000 kg/m³, MuJoCo's "
        "default density",
        "not carried over: largest velocity of joint shoulder",
        "not carried over: mimic of joint loose",
        "not carried over: 1 transmission, 2 gazebo elements and 1 safety controller",
    )
    assert found.model.body("lower").mass == 1000.0
    assert found.model.neq == 1  # the mimic of the elbow


def test_elements_that_mujoco_passes_over_are_said(write):
    """It reads some of its own elements in a URDF, and no other file."""
    other = write('<option timestep="0.1"/>', name="other.xml")
    own = (
        f'<include file="{other}"/><mujoco><option timestep="0.01"/><include file="{other}"/>'
        '<actuator><motor joint="shoulder"/></actuator><actuator/></mujoco>'
    )
    found = read_urdf(
        write(own, BASE, UPPER, ELBOW.replace("upper", "base").replace("lower", "upper"))
    )
    assert found.remarks == (
        "not carried over: <include> and <actuator> in <mujoco>, where MuJoCo reads none",
        "not carried over: 2 includes",
    )
    assert (found.model.opt.timestep, found.model.nu) == (0.01, 0)


def test_equal_limits_that_mujoco_ignores_are_said(write):
    limit = '<limit lower="0" upper="0" effort="1" velocity="0"/>'
    found = read_urdf(write(BASE, UPPER, joint("shoulder", "base", "upper", limit, "revolute")))
    assert found.remarks == (
        "MuJoCo warns: joint 'shoulder' has equal lower and upper limits, limit ignored",
    )


@pytest.mark.parametrize("name", ["package://pkg/m/a.stl", "../m/a.stl", "model://pkg/m/a.stl"])
def test_meshes_are_found_beside_and_above_the_file(write, tmp_path, name):
    write_stl(tmp_path / "pkg" / "m" / "a.stl")
    file = write(BASE, link("upper", 2, 0, (1, 1, 1), MESH.format(name)), SHOULDER)
    for within in (None, tmp_path, tmp_path / "pkg"):
        found = read_urdf(file, within)
        assert found.model.nmesh == 1
        assert found.remarks == ("not carried over: largest velocity of joint shoulder",)
    text, _ = mjcf_of_urdf(file)
    assert 'file="../m/a.stl"' in text
    made = file.with_name("made.xml")
    made.write_text(text)
    assert compile_model(made).nmesh == 1


def test_a_missing_mesh_is_left_out_and_said_if_the_inertia_is_given(write):
    gone = MESH.format("package://gone/a.stl") + MESH.format("package://gone/b.stl")
    moving = link("upper", 2, -0.25, (0.05, 0.04, 0.01), gone)
    still = f'<link name="base">{MESH.format("base.dae")}</link>'
    found = read_urdf(write(still, moving, SHOULDER))
    assert found.model.ngeom == 0
    assert found.model.body("upper").mass == 2.0
    assert found.remarks[:2] == (
        "'base.dae' not found beside arm.urdf; link base, whose inertia has no effect, has no "
        "contacts there",
        "'package://gone/a.stl' and 1 more not found in a folder 'gone' beside or above arm.urdf; "
        "link upper, whose inertia is given, has no contacts there",
    )
    bare = write(BASE, f'<link name="upper">{gone}</link>', SHOULDER)
    assert refused(bare) == (
        "arm.urdf: <link name='upper'>: mesh 'package://gone/a.stl': not found in a folder 'gone' "
        "beside or above arm.urdf; the link has no <inertial>, so that its mass is not known "
        "without the mesh; give the mesh or an <inertial>"
    )


def test_a_mesh_outside_the_named_folder_is_not_opened(write, tmp_path):
    """Neither by ``..``, nor by an absolute path, nor by a link."""
    secret = tmp_path / "secret.stl"
    write_stl(secret)
    (tmp_path / "pkg").mkdir()
    os.symlink(secret, tmp_path / "pkg" / "linked.stl")
    for name in ("../../secret.stl", str(secret), f"file://{secret}", "../linked.stl"):
        file = write(BASE, link("upper", 2, 0, (1, 1, 1), MESH.format(name)), SHOULDER)
        inside = read_urdf(file, tmp_path / "pkg")
        assert inside.model.nmesh == 0
        assert f"{name!r} lies outside {tmp_path / 'pkg'}; link upper" in inside.remarks[0]
        assert read_urdf(file).model.nmesh == 1  # whoever names the file allows what is above it


@pytest.mark.parametrize(
    ("ending", "content", "why"),
    [
        ("dae", b"<COLLADA/>", "MuJoCo does not read .dae"),
        ("stl", b"solid ascii", "stl_decoder"),
        ("stl", b"", "stl_decoder"),
        ("obj", b"v nan", "vertex coordinate 0 is not finite"),
    ],
)
def test_an_unreadable_mesh_is_left_out_and_said(write, ending, content, why):
    file = write(BASE, link("upper", 2, 0, (1, 1, 1), MESH.format(f"a.{ending}")), SHOULDER)
    file.with_name(f"a.{ending}").write_bytes(content)
    found = read_urdf(file)
    assert found.model.nmesh == 0
    assert found.remarks[0].startswith(f"'a.{ending}' ")
    assert why in found.remarks[0]
    assert str(file.parent) not in found.remarks[0]


CIRCLE = joint("j", "upper", "lower") + joint("k", "lower", "upper")


@pytest.mark.parametrize(
    ("elements", "message"),
    [
        ((), "arm.urdf: it has no <link>"),
        (("<link/>",), "arm.urdf: <link>: it has no name"),
        ((BASE, BASE), "arm.urdf: <link name='base'>: the name stands there twice"),
        (
            (BASE, joint("j", "base", "bass")),
            "arm.urdf: <joint name='j'>: no link 'bass' for its child; did you mean 'base'? there "
            "are: base",
        ),
        (
            (BASE, UPPER, LOWER, CIRCLE),
            "arm.urdf: <joint name='k'>: its links carry each other in a circle: upper < lower < "
            "upper; a URDF is a tree, and a loop needs an MJCF with a <connect>",
        ),
        (
            (UPPER, joint("j", "upper", "upper")),
            "arm.urdf: <joint name='j'>: its links carry each other in a circle: upper < upper; a "
            "URDF is a tree, and a loop needs an MJCF with a <connect>",
        ),
        (
            (BASE, UPPER, LOWER, SHOULDER, ELBOW, joint("k", "base", "lower")),
            "arm.urdf: <joint name='k'>: link 'lower' is carried by joint 'elbow' already; the "
            "links of a URDF form a tree, and a loop needs an MJCF with a <connect>",
        ),
        (
            (BASE, UPPER.replace('value="2"', 'value="nan"'), SHOULDER),
            "arm.urdf: <link name='upper'>: <mass value='nan'> is not a finite number",
        ),
        (
            (BASE, UPPER, SHOULDER.replace('xyz="0 0 1"', 'xyz="0 inf 1"')),
            "arm.urdf: <joint name='shoulder'>: <origin xyz='0 inf 1'> is not a finite number",
        ),
        (
            (BASE, UPPER.replace('value="2"', 'value="two"'), SHOULDER),
            "arm.urdf: <link name='upper'>: bad format in attribute 'value' of <mass>",
        ),
        (
            (BASE, UPPER, SHOULDER.replace("revolute", "screw")),
            "arm.urdf: <joint name='shoulder'>: invalid joint type in URDF joint definition",
        ),
        (
            (BASE, '<link name="upper"/>', SHOULDER),
            "arm.urdf: <link name='upper'>: it moves and has no mass or no inertia; give it an "
            "<inertial>, or make its joint fixed",
        ),
        (
            (BASE, link("upper", 1, 0, (1, 1, 3)), SHOULDER),
            "arm.urdf: <link name='upper'>: the moments of inertia are those of no body, since one "
            "exceeds the sum of the others; mend them, or add <mujoco><compiler "
            'balanceinertia="true"/></mujoco> to the URDF, by which MuJoCo makes them equal',
        ),
        (
            (BASE, link("upper", 1, 0, (1, 1, -1)), SHOULDER),
            "arm.urdf: <link name='upper'>: the moments of inertia must be positive, also about "
            "the main axes",
        ),
        (
            (BASE, UPPER, SHOULDER, "<xacro:arm/>"),
            "arm.urdf: it has macros of xacro (<xacro:arm>), which are not expanded here; write "
            "the URDF first: xacro arm.urdf > robot.urdf",
        ),
        ((BASE, "<joint>"), "arm.urdf: no valid XML: mismatched tag: line 2, column 46"),
    ],
)
def test_a_wrong_urdf_is_refused_at_its_element(write, elements, message):
    assert refused(write(*elements)) == message


def test_files_of_another_kind_are_refused(tmp_path):
    for text, message in (
        ("<sdf version='1.9'/>", "a.urdf: the root element of a URDF is <robot>, and here it is"),
        ("", "a.urdf: no valid XML: no element found: line 1, column 0"),
        ("<robot \0", "a.urdf: no valid XML: not well-formed (invalid token): line 1, column 7"),
        ("<?xml version='1.0' encoding='x'?><robot/>", "a.urdf: no valid XML: unknown encoding: x"),
        (f"<robot>{BASE}{'<a>' * 5000}{'</a>' * 5000}</robot>", "a.urdf: its elements are nested"),
    ):
        file = tmp_path / "a.urdf"
        file.write_text(text)
        assert refused(file).startswith(message)
    assert refused(tmp_path / "b.urdf") == "b.urdf: no such file"
    assert refused(tmp_path) == f"{tmp_path.name}: a folder, not a file"


def test_the_advice_on_inertia_works(write):
    """MuJoCo's own elements in a URDF are kept."""
    balanced = '<mujoco><compiler balanceinertia="true"/></mujoco>'
    found = read_urdf(write(balanced, BASE, link("upper", 1, 0, (1, 1, 3)), SHOULDER))
    assert found.model.body("upper").inertia == pytest.approx(5 / 3)


def test_two_thousand_links_are_read_or_refused(write):
    """On one base they are read; in one chain they are more than MuJoCo allows."""
    links = "".join(link(f"l{k}", 1, 0, (1, 1, 1)) for k in range(1999))
    star = "".join(joint(f"j{k}", "base", f"l{k}") for k in range(1999))
    assert read_urdf(write(BASE, links, star)).model.nbody == 2000
    chain = "".join(joint(f"j{k}", f"l{k - 1}", f"l{k}") for k in range(1, 1999))
    assert refused(write(links, chain)) == (
        "arm.urdf: <link name='l1998'>: it is the last of 1998 moving links in a chain; MuJoCo "
        "allows 1023"
    )


def test_a_source_reads_a_urdf(write):
    reading = ModelSource(write(BASE, UPPER, SHOULDER)).read()
    assert reading.model.nv == 1
    assert reading.remarks == ("not carried over: largest velocity of joint shoulder",)
