"""A model comes in as a file, an MjModel or an MjSpec, and stays as it is."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.base.errors import InputError
from proofmass.screen.screen import screen_model
from proofmass.sim.model_source import (
    BINARY_ENDING,
    ModelSource,
    is_model_object,
    source_of_object,
)
from proofmass.sim.protocol.failures import BadModel

PENDULUM = """<mujoco{}><worldbody><body>
  <joint name="pin" axis="0 1 0" stiffness="3"/><geom size="0.1" pos="1 0 0"/>
  </body></worldbody></mujoco>"""


def write_binary(file: Path) -> Path:
    """An MJB of a pendulum."""
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(PENDULUM.format("")), str(file))
    return file


def test_a_binary_model_is_read(tmp_path):
    file = write_binary(tmp_path / "a.mjb")
    assert file.suffix == BINARY_ENDING
    assert ModelSource(file).read().model.joint("pin").id == 0
    assert screen_model(file).mobility.dof == 1


@pytest.mark.parametrize("damage", [b"", b"no model", None])
def test_a_damaged_binary_model_is_one_line(tmp_path, damage):
    file = write_binary(tmp_path / "a.mjb")
    file.write_bytes(file.read_bytes()[:-40] if damage is None else damage)
    with pytest.raises(BadModel) as error:
        ModelSource(file).read()
    assert str(error.value).startswith(f"a.mjb: MuJoCo {mujoco.__version__} cannot read it: ")
    assert str(error.value).endswith("an MJB is read by the version that wrote it: give the MJCF")
    assert "\n" not in str(error.value)
    file.unlink()
    with pytest.raises(BadModel, match=r"^a\.mjb: no such file, or no regular file$"):
        ModelSource(file).read()


def test_names_are_those_that_models_state():
    names = []

    def name_of(name: str) -> str:
        names.append(name)
        return name

    for stated in ("", ' model="arm"', ' model="a/b"'):
        text = PENDULUM.format(stated)
        for thing in (mujoco.MjModel.from_xml_string(text), mujoco.MjSpec.from_string(text)):
            assert is_model_object(thing)
            source = source_of_object(thing, name_of)
            assert not source.is_file
            assert source.read().model.nv == 1
    assert names == ["model", "model", "arm", "arm", "a_b", "a_b"]
    assert not is_model_object(Path("a.xml"))


def test_a_specification_keeps_its_assets_and_is_not_changed():
    """``to_xml`` would lose a mesh that is in memory only."""
    cube = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))
    spec = mujoco.MjSpec.from_string(
        '<mujoco><compiler fusestatic="true"/>'
        '<asset><mesh name="m" file="m.obj"/></asset><worldbody><body><freejoint/>'
        '<geom type="mesh" mesh="m"/><body name="still"/></body></worldbody></mujoco>',
        assets={"m.obj": cube.encode()},
    )
    before = len(spec.bodies)
    model = source_of_object(spec, str).read().model
    assert model.nmesh == 1
    assert model.body_mass.sum() == pytest.approx(1000.0)  # kg, of a cubic metre
    assert len(spec.bodies) == before


def test_a_specification_is_screened():
    spec = mujoco.MjSpec.from_string(PENDULUM.format(""))
    assert screen_model(spec).mobility.dof == 1


def test_a_specification_that_does_not_compile_is_one_line():
    spec = mujoco.MjSpec.from_string('<mujoco model="arm"><worldbody/></mujoco>')
    spec.worldbody.add_body(name="crank").add_joint(name="pin")
    with pytest.raises(InputError) as error:
        source_of_object(spec, str)
    assert str(error.value).startswith("arm: MjSpec cannot be compiled: mass and inertia of moving")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("body_mass", np.nan, "arm: body_mass has the number nan, which is too large"),
        ("jnt_stiffness", np.inf, "arm: jnt_stiffness has the number inf, which is too large"),
    ],
)
def test_a_number_of_a_model_must_be_finite(field, value, message):
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(' model="arm"'))
    getattr(model, field)[-1] = value
    with pytest.raises(BadModel) as error:
        source_of_object(model, str).read()
    assert str(error.value).startswith(message)
