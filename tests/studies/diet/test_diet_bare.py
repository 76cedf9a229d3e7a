"""The model that a diet writes moves as allowed, compared in bare MuJoCo in a separate process.

`tests/studies/diet/diet_bare.py` imports nothing of proofmass: it steps the original file and the
file that a diet wrote from the same start.  Each kind of allowed difference is also exceeded on
purpose, by a mutation, which the comparison must show.
"""

import json
import subprocess
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.studies.diet.diet import Diet
from proofmass.studies.diet.edits import EditedModel, set_option, write_model
from proofmass.studies.diet.scene import load_scene
from proofmass.studies.trade.program import bare_command
from tests.studies.diet.test_diet import BALLAST, write_core_model
from tests.studies.test_study_verdicts import RecordingSearch, unkept_study

BARE_SCRIPT = Path(__file__).with_name("diet_bare.py")
FAT_FOUR_BAR = Path(__file__).parents[3] / "docs" / "fourbar_fat.xml"
DOUBLE = """<mujoco><option timestep="0.0005" integrator="RK4" tolerance="1e-14" iterations="200"/>
<worldbody>
  <body name="upper"><joint name="upper" axis="0 1 0"/><geom type="capsule" size=".02" mass="1"
    fromto="0 0 0 0 0 -.5" contype="0" conaffinity="0"/>
    <body name="lower" pos="0 0 -.5"><joint name="lower" axis="0 1 0" damping="0.01"/>
      <geom type="capsule" size=".02" mass="1" fromto="0 0 0 0 0 -.5" contype="0" conaffinity="0"/>
    </body>
  </body>
  <body name="far" pos="0 50 0">
    <joint name="far" axis="0 1 0"/><geom size=".1" pos=".2 0 0"/>
  </body>
</worldbody>
<sensor><e_potential name="potential"/><e_kinetic name="kinetic"/></sensor>
<keyframe><key name="start" qpos="1 0.3 1"/></keyframe></mujoco>"""


def compare_in_bare_mujoco(
    before: Path, after: Path, seconds: float, **more: object
) -> dict[str, dict[str, float]]:
    """The differences and errors that `tests/studies/diet/diet_bare.py` prints for two files.

    It runs with ``python -I``, so that no environment variable and no folder of this project is
    part of its path.
    """
    asked = {"files": [str(before), str(after)], "seconds": seconds, **more}
    done = subprocess.run(
        bare_command(BARE_SCRIPT, json.dumps(asked)),
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def run_diet_and_write(
    file: Path, folder: Path, seconds: float, **more: object
) -> tuple[Diet, Path]:
    """The result of a diet, and the file of the reduced model."""
    found = RecordingSearch(load_scene(file, seconds, **more), unkept_study(), rounds=0).run()  # type: ignore[arg-type]
    return found, write_edited_model(found.reduced, folder)


def write_edited_model(edited: EditedModel, folder: Path, name: str = "reduced") -> Path:
    """Write an edited model to a file in a folder."""
    write_model(edited, folder / f"{name}.xml")
    return folder / f"{name}.xml"


def changed_options(found: Diet) -> list[str]:
    """The names of the options that a diet has changed."""
    return [e.name for e in found.entries if e.kind == "option" and e.outcome == "harmless"]


def test_without_its_ballast_a_scene_moves_the_same_up_to_rounding(tmp_path):
    file = write_core_model(tmp_path, **{**BALLAST, "option": ""})
    found, reduced = run_diet_and_write(file, tmp_path, 0.3)
    assert sum(e.outcome == "harmless" for e in found.entries) >= 10
    assert changed_options(found) == []
    shown = compare_in_bare_mujoco(file, reduced, 0.3, joints=["arm", "brace"], bodies=["ball"])
    for name, part in shown.items():  # x of the ball is 0 but for rounding, hence the size 1e-3
        assert part["moved"] <= 1e-9 * max(part["size"], 1e-3), name
    assert shown["arm"]["range"] > 0.1
    # a mutation: the pin of the loop is removed as well
    wrong = write_edited_model(
        found.reduced.without(lambda d: d.drop("equalities", "pin")), tmp_path, "wrong"
    )
    assert compare_in_bare_mujoco(file, wrong, 0.3, joints=["arm"])["arm"]["moved"] > 0.01


def test_changes_that_are_too_large_show_in_bare_mujoco(tmp_path, monkeypatch):
    # a mutation of the diet itself: changes up to the whole size of a channel count as rounding
    monkeypatch.setattr("proofmass.studies.diet.scene.CHANNEL_ROUNDING_SHARE", 1.0)
    file = write_core_model(tmp_path, **{**BALLAST, "option": ""})
    _, reduced = run_diet_and_write(file, tmp_path, 0.3)
    assert compare_in_bare_mujoco(file, reduced, 0.3, joints=["arm"])["arm"]["moved"] > 0.01


@pytest.mark.slow
def test_a_fat_four_bar_reduced_to_its_crank_motion_moves_the_same(tmp_path):
    found, reduced = run_diet_and_write(FAT_FOUR_BAR, tmp_path, 1.0, monitored=("crank",))
    left = mujoco.MjModel.from_xml_path(str(reduced))
    assert [left.body(b).name for b in range(1, left.nbody)] == ["crank", "coupler", "rocker"]
    assert (left.opt.tolerance, left.opt.iterations) == (1e-8, 100)
    shown = compare_in_bare_mujoco(FAT_FOUR_BAR, reduced, 1.0, joints=["crank"])["crank"]
    # allowed: at most 1.1 times the error of the fat model against the fine solution
    assert shown["after"] <= 1.1 * shown["before"]
    assert shown["moved"] <= 1e-6 * shown["size"]
    assert shown["range"] > 0.1
    # mutations: a time step that the diet refused, and a removed pin
    longer = write_edited_model(
        found.reduced.without(partial(set_option, name="timestep", value=0.002)), tmp_path, "longer"
    )
    assert (
        compare_in_bare_mujoco(FAT_FOUR_BAR, longer, 1.0, joints=["crank"])["crank"]["after"]
        > 1.5 * shown["before"]
    )
    loose = write_edited_model(
        found.reduced.without(lambda d: d.drop("equalities", "pin")), tmp_path, "loose"
    )
    assert (
        compare_in_bare_mujoco(FAT_FOUR_BAR, loose, 1.0, joints=["crank"])["crank"]["moved"] > 0.01
    )


def test_the_time_step_is_as_long_as_the_error_allows(tmp_path):
    file = tmp_path / "double.xml"
    file.write_text(DOUBLE)
    allowed = 1e-5
    found, reduced = run_diet_and_write(
        file, tmp_path, 2.0, monitored=("upper", "lower"), error=allowed
    )
    left = mujoco.MjModel.from_xml_path(str(reduced))
    assert left.nq == 2
    assert left.opt.timestep >= 0.004
    assert left.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4  # others are of first order
    assert (left.opt.tolerance, left.opt.iterations) == (1e-8, 100)
    span = 2.0 - 2.0 % (16 * left.opt.timestep)
    shown = compare_in_bare_mujoco(
        file,
        reduced,
        span,
        joints=["upper", "lower"],
        samples=round(span / (16 * left.opt.timestep)) + 1,
    )
    for name, part in shown.items():
        assert part["after"] <= allowed * part["range"], name
    # a mutation: four times the step that was found, which has 256 times the error of RK4
    step = 4 * left.opt.timestep
    wrong = write_edited_model(
        found.reduced.without(partial(set_option, name="timestep", value=step)), tmp_path, "wrong"
    )
    worse = compare_in_bare_mujoco(
        file,
        wrong,
        span,
        joints=["upper", "lower"],
        samples=round(span / (16 * left.opt.timestep)) + 1,
    )
    assert max(part["after"] / part["range"] for part in worse.values()) > allowed


def test_without_an_allowed_error_the_time_step_is_kept(tmp_path):
    """Without --error the time step may not exceed 1.1 times the model's own error."""
    file = tmp_path / "double.xml"
    file.write_text(DOUBLE.replace('integrator="RK4"', 'integrator="implicitfast"'))
    found, reduced = run_diet_and_write(file, tmp_path, 0.5, monitored=("upper",))
    assert mujoco.MjModel.from_xml_path(str(reduced)).opt.timestep == 0.0005
    refused = [e for e in found.entries if e.name.startswith("time step")]
    assert [e.outcome for e in refused] == ["matters"]
    # implicitfast is of first order: twice the step has twice the error, and 1.1 times is allowed
    assert refused[0].worst[2] == pytest.approx(2 / 1.1, rel=0.1)
    shown = compare_in_bare_mujoco(file, reduced, 0.5, joints=["upper"])["upper"]
    assert shown["after"] <= 1.1 * shown["before"]
    assert np.isfinite(shown["before"])
    assert shown["before"] > 0
