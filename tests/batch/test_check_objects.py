"""`proofmass.check` takes paths, cases and models of MuJoCo, one or several, mixed."""

import re
import shutil
import sys

import mujoco
import pytest

from proofmass import check, load_case
from proofmass.verdict.comparison import Comparison
from tests.shipped import shipped

CHECK_MODULE = sys.modules["proofmass.batch.check"]
PENDULUM = """<mujoco{}><option gravity="0 -9.81 0"/><worldbody><body>
  <joint name="pin"/><geom size="0.1" pos="1 0 0"/></body></worldbody></mujoco>"""
URDF = """<robot name="arm"><link name="base"/><link name="bar"><inertial><origin xyz="1 0 0"/>
  <mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="pin" type="continuous"><parent link="base"/><child link="bar"/><axis xyz="0 1 0"/>
  </joint><transmission name="t"/></robot>"""


@pytest.fixture
def case():
    """A short run of a pendulum in MuJoCo."""
    found = load_case(shipped("pendulum.toml"))
    return found.with_run("dynamics", n=3, until=0.02, solvers=("mujoco",))


@pytest.fixture
def unsolved(monkeypatch):
    """Models without a sidecar are read and screened in this process, and not solved."""

    def check_bare_model(source):
        assert source.read().model.nv == 1
        return [Comparison(source.file.stem, "mujoco", "dynamics", "", "m", outcome="unchecked")]

    monkeypatch.setattr(CHECK_MODULE, "check_bare_model", check_bare_model)


def test_objects_and_files_are_checked_together(case, tmp_path, unsolved):
    """Each has a name that no other has."""
    file = tmp_path / "arm.urdf"
    file.write_text(URDF)
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(""))
    spec = mujoco.MjSpec.from_string(PENDULUM.format(' model="arm"'))
    changed = case.model_copy(update={"title": "another"})
    found = check([case, changed, file, model, spec, model], detectable=False)
    assert not found.errors
    assert list(dict.fromkeys(c.case for c in found.comparisons)) == [
        "arm",
        "pendulum",
        "pendulum 2",
        "model",
        "arm 2",
        "model 2",
    ]
    assert [one.name for one in found.cases] == ["pendulum", "pendulum 2"]
    assert list(found.screens) == ["arm", "model", "arm 2", "model 2"]
    assert found.remarks == {"arm": ("not carried over: 1 transmission",)}
    outcomes = {c.case: c.outcome for c in found.comparisons}
    assert outcomes["pendulum"] == outcomes["pendulum 2"] == "agrees"
    assert found.paths == (file,)


def test_one_object_is_checked_alone(case):
    assert {c.case for c in check(case, detectable=False).comparisons} == {"pendulum"}
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(""))
    found = check(model)
    assert (found.exit_code, found.comparisons[0].outcome) == (0, "self-consistent")
    assert found.screens["model"].mobility.dof == 1
    model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_GRAVITY
    found = check([model])
    assert [c.outcome for c in found.comparisons] == ["nothing moved"]
    assert model.opt.gravity[1] == -9.81  # the worker's copy has none


def test_a_wrong_object_is_an_error_and_the_others_go_on(case):
    bad = case.model_copy(update={"start": "nowhere"})
    found = check([bad, case], detectable=False)
    (error,) = found.errors
    assert (error.key, "no key 'nowhere'" in error.wrong) == ("start", True)
    assert {c.case for c in found.comparisons} == {"pendulum"}
    with pytest.raises(TypeError) as raised:
        check([3])
    assert str(raised.value) == (
        "int cannot be checked; give a path, a Case, an MjModel or an MjSpec, or several of these"
    )


def test_a_folder_has_urdfs_as_it_has_models(tmp_path):
    """A sidecar stands for the URDF of its name, and nothing outside the folder is opened."""
    folder = tmp_path / "robots"
    folder.mkdir()
    (tmp_path / "m.stl").write_bytes(b"")
    mesh = '<collision><geometry><mesh filename="../m.stl"/></geometry></collision></link>'
    (folder / "arm.urdf").write_text(re.sub("</link>", mesh, URDF))
    (folder / "arm.xml").write_text(PENDULUM.format(""))
    (folder / "menu.urdf").write_text("<menu/>")
    (folder / "broken.urdf").write_text("<robot/>")
    for ending in (".toml", ".xml"):
        shutil.copy(shipped("pendulum.toml").with_suffix(ending), folder)
    (folder / "pendulum.urdf").write_text(URDF)
    text = (folder / "pendulum.toml").read_text()
    (folder / "pendulum.toml").write_text(text + "\nno toml")
    found = check(folder, detectable=False)
    assert {c.case for c in found.comparisons} == {"arm.urdf", "arm.xml"}
    assert [file.name for file in found.of_others] == ["menu.urdf"]
    assert sorted(error.file.name for error in found.errors) == ["broken.urdf", "pendulum.toml"]
    assert found.remarks["arm.urdf"][0] == (
        f"'../m.stl' lies outside {folder}; link bar, whose inertia is given, has no contacts there"
    )
