"""Engine options in a diet: which values are tried, which are taken, and when time decides."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import pytest

from proofmass.studies.diet import diet, options
from proofmass.studies.diet.diet import DietSearch
from proofmass.studies.diet.edits import EditedModel, set_option
from proofmass.studies.diet.scene import DietScene, load_scene
from proofmass.studies.diet.trial import Cost, CostComparison
from tests.studies.diet.test_diet import write_core_model
from tests.studies.test_study_verdicts import RecordingSearch, unkept_study

PENDULUM_MODEL = """<mujoco><option timestep="{step}" integrator="{integrator}" {more}/><worldbody>
  <body name="bob" pos="0 0 1"><joint name="bob" axis="0 1 0"/>
  <geom type="capsule" size=".02" fromto="0 0 0 .4 0 0" contype="0" conaffinity="0"/></body>
  </worldbody></mujoco>"""


def write_pendulum(
    folder: Path, step: float = 1e-3, integrator: str = "RK4", more: str = ""
) -> Path:
    """Write a model of a pendulum that falls from its horizontal pose."""
    file = folder / "falling.xml"
    file.write_text(PENDULUM_MODEL.format(step=step, integrator=integrator, more=more))
    return file


def with_options(edited: EditedModel, **values: float) -> EditedModel:
    """An edited model with other values of some options."""
    for name, value in values.items():
        edited = edited.without(partial(set_option, name=name, value=value))
    return edited


def option_names(
    make_options: options.OptionMaker, edited: EditedModel, scene: DietScene
) -> list[str]:
    """The names of the values of an option that are tried."""
    return [rung.name for rung in make_options(edited, scene)]


def test_the_cheapest_value_is_tried_first(tmp_path):
    scene = load_scene(write_pendulum(tmp_path, more='tolerance="1e-14" iterations="200"'), 1.0)
    own = scene.edited
    assert option_names(options.loosen_tolerance, own, scene) == [
        "tolerance 1e-14 to 1e-8",
        "tolerance 1e-14 to 1e-10",
        "tolerance 1e-14 to 1e-12",
    ]
    assert option_names(options.limit_iterations, own, scene) == ["iterations 200 to 100"]
    assert option_names(options.limit_line_search, own, scene) == []
    assert option_names(options.limit_line_search, with_options(own, ls_iterations=60), scene) == [
        "ls_iterations 60 to 50"
    ]
    assert option_names(options.change_integrator, own, scene) == [
        "integrator RK4 to Euler",
        "integrator RK4 to implicitfast",
    ]
    euler = with_options(own, integrator=int(mujoco.mjtIntegrator.mjINT_EULER))
    assert option_names(options.change_integrator, euler, scene) == []
    assert option_names(options.change_solver, own, scene) == []  # the model has no constraints
    assert option_names(options.change_cone, own, scene) == []
    assert option_names(options.change_cone, with_options(own, cone=1), scene) == [
        "cone elliptic to pyramidal"
    ]
    assert option_names(options.change_jacobian, own, scene) == ["jacobian auto to sparse"]
    assert (options.evaluations_per_second(own), options.evaluations_per_second(euler)) == (
        4000.0,
        1000.0,
    )
    loops = load_scene(write_core_model(tmp_path), 0.1)
    assert option_names(options.change_solver, loops.edited, loops) == [
        "solver Newton to CG",
        "solver Newton to PGS",
    ]


def model_with_pasted_options(file: Path, edit: str) -> mujoco.MjModel:
    """The compiled model of a file whose options are replaced by those of an edit in MJCF."""
    tree = ElementTree.fromstring(file.read_text())
    own, new = tree.find("option"), ElementTree.fromstring(edit)
    own.attrib.update(new.attrib)
    flags = own.find("flag")
    for flag in new:
        if flags is None:
            flags = ElementTree.SubElement(own, "flag")
        flags.attrib.update(flag.attrib)
    return mujoco.MjModel.from_xml_string(ElementTree.tostring(tree, encoding="unicode"))


def test_the_mjcf_of_an_edit_sets_the_options_that_were_tried(tmp_path):
    """The MJCF of each edit sets the same options as its function `cut`."""
    more = 'tolerance="1e-14" iterations="200" ls_iterations="60" cone="elliptic"'
    more += ' noslip_iterations="3"><flag energy="enable" fwdinv="enable"/></option'
    file = write_pendulum(tmp_path, more=more)
    file.write_text(file.read_text().replace("</option/>", "</option>"))
    text = file.read_text().replace('contype="0" conaffinity="0"', "")
    file.write_text(text.replace("</worldbody>", '<geom size="1" pos="9 9 9"/></worldbody>'))
    scene = load_scene(file, 1.0)
    makers = (
        *options.COUNTED_OPTIONS,
        *options.OPTION_ORDERS[0],
        options.change_cone,
        options.change_jacobian,
        lambda edited, _: options.list_features(edited, scene),
    )
    tried = [one for make in makers for one in make(scene.edited, scene) if one.edit]
    assert {one.edit.split("=")[0] for one in tried} == {
        f"<option {name}" for name in ("tolerance", "iterations", "ls_iterations", "timestep")
    } | {f"<option {name}" for name in ("integrator", "cone", "jacobian", "noslip_iterations")} | {
        "<option><flag contact",
        "<option><flag energy",
    }
    for one in tried:
        cut, own = (
            scene.edited.without(one.cut).compiled().opt,
            model_with_pasted_options(file, one.edit).opt,
        )
        for name in OPTION_FIELDS:
            assert getattr(cut, name) == getattr(own, name), (one.edit, name)
    loops = load_scene(write_core_model(tmp_path), 0.1)
    assert [one.edit for one in options.change_solver(loops.edited, loops)] == [
        '<option solver="CG"/>',
        '<option solver="PGS"/>',
    ]


OPTION_FIELDS = (
    *("timestep", "tolerance", "iterations", "ls_iterations", "noslip_iterations"),
    *("integrator", "cone", "jacobian", "solver", "disableflags", "enableflags"),
)


def test_longer_steps_fit_between_samples(tmp_path):
    scene = load_scene(write_pendulum(tmp_path, step=1e-3), 5.0)
    width = float(scene.monitored_runs[0].bound.run.x[1])
    assert width == pytest.approx(0.04)  # 40 steps between 126 samples
    found = [rung.cut.keywords["value"] for rung in options.lengthen_step(scene.edited, scene)]
    assert found == pytest.approx([0.04, 0.02, 0.04 / 3, 0.008, 0.004, 0.002])
    longest = with_options(scene.edited, timestep=0.04)
    assert options.lengthen_step(longest, scene) == []


def test_the_order_of_options_with_less_work_is_taken(tmp_path):
    """A small allowed error gives RK4 with a longer step, a large one another integrator."""
    file = write_pendulum(tmp_path, step=1e-3)
    for error, integrator in ((1e-6, "RK4"), (0.05, "EULER")):
        scene = load_scene(file, 1.0, (), error)
        found = RecordingSearch(scene, unkept_study(), rounds=0).run()
        reduced = found.reduced.compiled()
        assert mujoco.mjtIntegrator(reduced.opt.integrator).name == f"mjINT_{integrator}"
        assert options.evaluations_per_second(found.reduced) < 4000.0
        assert found.tuned
        assert found.whole.worst[2] <= 1
    kept = RecordingSearch(scene, unkept_study(), rounds=0, tune=False).run()
    assert kept.reduced.compiled().opt.timestep == 1e-3
    assert not kept.tuned
    assert not [e for e in kept.entries if e.kind == "option"]


@pytest.mark.parametrize(
    ("saved", "outcome"),
    [((0.1, 0.2, 0.3), "harmless"), ((-0.1, 0.2, 0.3), "no gain"), ((-0.3, -0.2, -0.1), "no gain")],
)
def test_measured_time_decides_on_the_jacobian(tmp_path, monkeypatch, saved, outcome):
    """Another storage of the Jacobian changes no result, and is taken only if it saves time."""
    monkeypatch.setattr(
        diet,
        "compare_costs_isolated",
        lambda models, run, rounds, limit: CostComparison((Cost(2.0, 3), Cost(1.0, 2)), saved),
    )
    scene = load_scene(write_pendulum(tmp_path), 0.2)
    now, entries = RecordingSearch(scene, unkept_study(), rounds=9).optioned(scene.edited)
    entry = entries[-1]
    assert (entry.name, entry.outcome) == ("jacobian auto to sparse", outcome)
    assert entry.saved == saved
    sparse = int(mujoco.mjtJacobian.mjJAC_SPARSE)
    assert (now.spec.option.jacobian == sparse) == (outcome == "harmless")


def test_without_a_fine_solution_the_time_step_is_kept(tmp_path):
    """A bouncing ball differs from its fine solution long before the run ends."""
    file = tmp_path / "ball.xml"
    file.write_text("""<mujoco><option timestep="0.004" tolerance="1e-14"/><worldbody>
      <geom type="plane" size="9 9 .1"/><body pos="0 0 0.3"><freejoint/>
      <geom size=".1" solref="-20000 0"/></body></worldbody></mujoco>""")
    scene = load_scene(file, 1.0)
    assert scene.monitored_runs[0].bound is None
    assert "Options may change a channel by no more than a feature may" in scene.said[-1]
    found = RecordingSearch(scene, unkept_study(), rounds=0).run()
    assert found.reduced.compiled().opt.timestep == 0.004
    assert found.reduced.compiled().opt.tolerance == 1e-8


def test_a_bound_that_allows_anything_gives_the_longest_step(tmp_path):
    """A mutation: with a loose bound the time step is as long as the sample interval."""
    scene = load_scene(write_pendulum(tmp_path), 1.0)
    monitored = scene.monitored_runs[0]
    loose = replace(
        monitored,
        bound=replace(monitored.bound, allowed=dict.fromkeys(monitored.bound.allowed, 1e9)),
    )
    strict = RecordingSearch(scene, unkept_study(), rounds=0).run().reduced.compiled().opt.timestep
    found = (
        RecordingSearch(replace(scene, monitored_runs=(loose,)), unkept_study(), rounds=0)
        .run()
        .reduced.compiled()
    )
    assert found.opt.timestep == pytest.approx(float(monitored.bound.run.x[1]))
    assert found.opt.timestep > strict


def test_an_empty_set_of_features_is_not_tried(tmp_path, monkeypatch):
    """Several features are removed together in the first round, and in the last trial of all.

    The second round, in which no feature is harmless, tries no removal of an empty set.
    """
    asked = []
    tried = DietSearch.tried

    def noted(self, now, feature, tuned=False):
        asked.append((feature.kind, feature.name))
        return tried(self, now, feature, tuned)

    monkeypatch.setattr(DietSearch, "tried", noted)
    RecordingSearch(
        load_scene(write_pendulum(tmp_path), 0.1), unkept_study(), rounds=0, tune=False, blind=True
    ).run()
    whole = [k for k, (kind, _) in enumerate(asked) if kind == "all of these"]
    assert whole[-1] == len(asked) - 1
    assert len(whole) == 2  # the harmless features of the first round, and all changes at the end
