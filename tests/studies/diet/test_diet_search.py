"""The search of a diet: which results are stored, and which options are tried, taken and timed.

Edited models are lists of the names of their cuts, and the results of trials are given.
"""

from dataclasses import replace
from typing import ClassVar

import mujoco
import numpy as np
import pytest

from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import Run
from proofmass.studies import measure
from proofmass.studies.diet import diet
from proofmass.studies.diet.diet import reference_key, trial_name
from proofmass.studies.diet.options import Feature
from proofmass.studies.diet.scene import Bound, DietScene, MonitoredRun
from proofmass.studies.diet.table import Entry
from proofmass.studies.diet.trial import Cost, CostComparison
from proofmass.studies.store import Store
from tests.studies.test_study_verdicts import (
    ModelWithProbe,
    NamesOfRemoved,
    RecordingSearch,
    SearchByNames,
    answering_in_turn,
    diet_scene,
    feature,
    load_shipped_case,
    monitored_run_of,
    unkept_study,
)

SPHERE_MODEL = "<mujoco><worldbody><geom size='{}'/></worldbody></mujoco>"


def test_results_are_kept_for_equal_models_runs_engines_and_sources(tmp_path, monkeypatch):
    """A result is made again if something that it depends on has changed, and only then."""
    folder = tmp_path / "a" / "b"
    store = Store(folder)
    one, two, twin = (
        mujoco.MjModel.from_xml_string(SPHERE_MODEL.format(size)) for size in (1, 2, 1)
    )
    made: list[int] = []

    def once(models, runs):
        return store.value(trial_name(models, runs), lambda: made.append(len(made)) or len(made))

    asked = []
    monkeypatch.setattr(
        diet, "package_versions", lambda engine: asked.append(engine) or len(asked) > 5
    )
    assert once([one], ["run"]) == 1
    assert once([twin], ["run"]) == 1
    assert once([two], ["run"]) == 2
    assert once([one, two], ["run"]) == 3
    assert once([one], ["other run"]) == 4
    assert once([one], ["run"]) == 5  # another version of the engine
    assert set(asked) == {"mujoco"}
    monkeypatch.setattr(diet, "digest_of_sources", lambda: "others")
    assert once([one], ["run"]) == 6
    assert once([one], ["run"]) == 6
    assert len(list(folder.glob("*.json"))) == len(made) == 6


def stepped_run(**changes) -> MonitoredRun:
    """A monitored run with time steps."""
    return replace(monitored_run_of({"y": 0.5}, {"y": [0.0] * 9}), **changes)


class OptionTrials(RecordingSearch):
    """A search whose edited models are lists of cuts: one with a "bad" cut matters.

    What it is asked to time is kept in its store.
    """

    saving: ClassVar[dict[str, tuple]] = {}

    def judge_errors(self, models, edited):
        return "matters" if "bad" in " ".join(edited) else "harmless", {}, "held"

    def judge_changes(self, models, edited):
        raise AssertionError("options are held against what is true")

    def timed(self, now, edited, entry, tuned=False):
        self.store.asked.append((list(now), list(edited), entry.name, tuned))
        return replace(entry, saved=self.saving.get(entry.name, ()))


def option_search(rounds: int = 0) -> OptionTrials:
    return OptionTrials(diet_scene(stepped_run()), unkept_study(workers="workers"), rounds=rounds)


def option_maker(*names: str, asked: list | None = None):
    """A maker of options with these names for any edited model; `asked` collects the models."""

    def make(now, scene) -> list[Feature]:
        assert isinstance(scene, DietScene)
        if asked is not None:
            asked.append(list(now))
        return [feature(name, kind="option") for name in names]

    return make


def test_the_first_harmless_value_is_taken_or_the_last_one_is_listed():
    own, asked = option_search(), []
    now, found = own.changed(
        NamesOfRemoved(["old"]),
        (
            option_maker("bad 1", "one", "other"),
            option_maker("bad 2", "bad 3", asked=asked),
            option_maker(),
        ),
    )
    assert now == ["old", "one"]
    assert asked == [["old", "one"]]  # the next maker starts from the result of the one before
    assert [(before, after, e.name, e.outcome) for before, after, e in found] == [
        (["old"], ["old", "one"], "one", "harmless"),
        (["old", "one"], ["old", "one", "bad 3"], "bad 3", "matters"),
    ]
    assert [e.message for *_, e in found] == ["held"] * 2
    assert len(own.store.keys) == 4  # "other" is not tried


def test_steps_are_lengthened_until_none_is_harmless(monkeypatch):
    """After a step of factor 4 is found harmless, longer steps are tried, here factor 8.

    Another maker of options is called only once after it has found a harmless value.
    """

    def steps(now, scene):
        return [feature(name) for name in (["4", "2"] if "4" not in now else ["bad 8"])]

    monkeypatch.setattr(diet, "lengthen_step", steps)
    now, found = option_search().changed(NamesOfRemoved(), (steps,))
    assert now == ["4"]
    assert [e.name for *_, e in found] == ["4", "bad 8"]
    once = [lambda now, scene: steps(now, scene)]
    assert [e.name for *_, e in option_search().changed(NamesOfRemoved(), tuple(once))[1]] == ["4"]


def test_the_order_with_less_work_is_taken(monkeypatch):
    """Both orders start from the result of the counted options.

    Each value that is taken is timed against the model before it.
    """
    monkeypatch.setattr(diet, "COUNTED_OPTIONS", (option_maker("counted"),))
    monkeypatch.setattr(
        diet,
        "OPTION_ORDERS",
        ((option_maker("first"), option_maker("bad")), (option_maker("second"),)),
    )
    monkeypatch.setattr(diet, "TIMED_OPTIONS", (option_maker("clocked"),))
    monkeypatch.setattr(
        diet, "evaluations_per_second", lambda edited: {"first": 2.0}.get(edited[-1], 1.0)
    )
    seen = []

    def integrators(now, scene):
        seen.append((list(now), scene))
        return [now] if order == "second" else []

    monkeypatch.setattr(diet, "change_integrator", integrators)
    for order in ("second", "first"):
        own = option_search()
        now, entries = own.optioned(NamesOfRemoved(["old"]))
        assert now == ["old", "counted", order]
        assert seen.pop() == (["old", "counted"], own.scene)
        told = ["counted", order] + ["bad"] * (order == "first")
        assert [e.name for e in entries] == told  # without rounds no option is decided by time
        assert own.store.asked[:2] == [
            (["old"], ["old", "counted"], "counted", True),
            (["old", "counted"], ["old", "counted", order], order, True),
        ]


@pytest.mark.parametrize(
    ("saved", "outcome"),
    [
        ((), "no gain"),
        ((-0.1, 0.5, 0.6), "no gain"),
        ((0.0, 0.5, 0.6), "no gain"),
        ((0.1, 0.5, 0.6), "harmless"),
    ],
)
def test_a_timed_option_is_taken_if_its_whole_interval_is_a_saving(saved, outcome, monkeypatch):
    """It is taken if the lower end of the interval of the saved time is above 0.

    The next maker of options starts from the model with the value that was taken.
    """
    asked: list = []
    for name in ("COUNTED_OPTIONS", "OPTION_ORDERS"):
        monkeypatch.setattr(diet, name, ((),) * (name == "OPTION_ORDERS"))
    monkeypatch.setattr(diet, "change_integrator", lambda now, scene: [])
    monkeypatch.setattr(
        diet, "TIMED_OPTIONS", (option_maker("bad", "one", "two"), option_maker("x", asked=asked))
    )
    monkeypatch.setattr(diet, "evaluations_per_second", lambda edited: 1.0)
    own = option_search(rounds=3)
    monkeypatch.setattr(
        OptionTrials,
        "saving",
        {"one": saved, "bad": (0.1, 0.2, 0.3), "two": (0.1, 0.2, 0.3), "x": (-0.1, 0.0, 0.1)},
    )
    now, entries = own.optioned(NamesOfRemoved(["old"]))
    taken = "one" if outcome == "harmless" else "two"
    names = ["bad", "one", "x"] if taken == "one" else ["bad", "one", "two", "x"]
    assert now == ["old", taken]
    assert asked == [["old", taken]]
    assert [e.name for e in entries] == names
    assert [e.outcome for e in entries] == [
        "matters",
        outcome,
        *(["harmless"] if taken == "two" else []),
        "no gain",
    ]
    assert entries[1].saved == saved
    assert own.store.asked[:2] == [
        (["old"], ["old", "bad"], "bad", True),
        (["old"], ["old", "one"], "one", True),
    ]


def test_results_of_options_are_stored_with_their_references(monkeypatch):
    """The key of a stored result of an option contains the references of the runs."""
    bound = Bound(Run("dynamics", np.zeros(2), ()), {"y": 0.1}, {"y": np.zeros(2)})
    free, held = stepped_run(name="free"), stepped_run(name="held", bound=bound)
    for tuned, more in ((True, [None, reference_key(held)]), (False, [])):
        own = (OptionTrials if tuned else SearchByNames)(
            diet_scene(free, held), unkept_study(), rounds=0
        )
        _, found = own.tried(NamesOfRemoved(), feature("new"), tuned)
        assert found.message == ("held" if tuned else "said")
        ((_, runs),) = own.store.keys
        assert runs == [(w.name, w.run, w.allowed, w.before.channels) for w in (free, held)] + more


def test_equal_references_have_equal_keys():
    """The key is pickled, so the order of the parameters in a sidecar must make no difference."""
    run, truth = Run("dynamics", np.zeros(2), ()), {"y": np.zeros(2)}
    assert reference_key(stepped_run()) is None
    free = stepped_run(bound=Bound(run, {"y": 0.1}, truth))
    assert reference_key(free) == (run, {"y": 0.1}, truth, None)
    case = load_shipped_case("pendulum").model_copy(
        update={"reference": "one", "parameters": {"b": 1.0, "a": 2.0, "c": "word"}}
    )
    held = stepped_run(bound=Bound(run, {"y": 0.1}, case=case))
    assert reference_key(held) == (
        run,
        {"y": 0.1},
        {},
        ("one", [("a", 2.0), ("b", 1.0), ("c", "word")]),
    )


class NamedSensorModel(ModelWithProbe):
    """An edited model in which one sensor is monitored by its name."""

    monitored = ("probe",)


def test_options_are_judged_by_errors_and_may_take_three_times_as_long(monkeypatch):
    """A run with a reference is judged by errors, one without by changes, as for a feature.

    A run is given up after three times the wall time of the original (20 s), or after 30 s.
    """
    bound = Bound(
        Run("dynamics", np.zeros(1), (), settings={"own": 1}), {"y": 0.25}, {"y": np.array([3.0])}
    )
    one = replace(monitored_run_of({"y": 0.5}, {"y": [1.0]}), name="held", bound=bound)
    one = replace(one, before=replace(one.before, seconds=20.0))
    two = replace(
        monitored_run_of({"y": 0.5, "probe": 0.5}, {"y": [1.0], "probe": [1.0]}), name="moved"
    )
    for edited, shown, outcome in (
        (ModelWithProbe(), 0.0, "harmless"),
        (NamedSensorModel(), np.inf, "matters"),
    ):
        calls: list = []
        monkeypatch.setattr(
            measure,
            "call_isolated",
            answering_in_turn(
                calls,
                Curves(np.zeros(1), {"y": np.array([2.875])}),
                Curves(np.zeros(1), {"y": np.array([1.25])}),
            ),
        )
        found = RecordingSearch(diet_scene(one, two), unkept_study()).judge_errors(
            ["first", "second"], edited
        )
        assert found == (outcome, {"held": {"y": 0.5}, "moved": {"y": 0.5, "probe": shown}}, "")
        assert calls == [
            ("attempt", "first", replace(bound.run, rods=("cut",)), 60.0),
            ("attempt", "second", replace(two.run, rods=("cut",)), 30.0),
        ]


def test_a_probe_that_is_monitored_by_name_may_not_be_missing(monkeypatch):
    """A missing probe that the study has added counts as constant, and it was constant before."""
    monitored = replace(monitored_run_of({"probe": 0.5}, {"probe": [1.0]}), name="a")
    for edited, outcome in ((ModelWithProbe(), "harmless"), (NamedSensorModel(), "matters")):
        monkeypatch.setattr(
            measure, "call_isolated", answering_in_turn([], Curves(np.zeros(1), {}))
        )
        own = RecordingSearch(diet_scene(monitored), unkept_study())
        assert own.judge_changes(["model"], edited)[0] == outcome


def test_options_are_timed_in_the_run_of_their_reference(monkeypatch):
    """They are timed in 2000 steps of it, features in 2000 steps of the run of the scene."""
    x = np.arange(9001.0)
    bound = Bound(Run("dynamics", x[::2], ()), {})
    monitored = MonitoredRun(
        "a", Run("dynamics", x, ()), {}, Curves(x, {}, steps=9000), bound=bound
    )
    asked = []

    def paced(models, run, rounds, limit):
        asked.append((run.x[1], run.x.size))
        return CostComparison((Cost(2.0, 3), Cost(1.0, 2)), (0.4, 0.5, 0.6))

    monkeypatch.setattr(diet, "compare_costs_isolated", paced)
    entry = Entry("option", "name", "harmless")
    for one, tuned, wanted in (
        (monitored, True, (2.0, 1000)),
        (monitored, False, (1.0, 2000)),
        (replace(monitored, bound=None), True, (1.0, 2000)),
    ):
        RecordingSearch(diet_scene(one), unkept_study(), rounds=3).timed(
            NamesOfRemoved(), NamesOfRemoved(), entry, tuned
        )
        assert asked.pop() == wanted
    RecordingSearch(diet_scene(monitored), unkept_study(), rounds=3).timed(
        NamesOfRemoved(), NamesOfRemoved(), entry
    )
    assert asked == [(1.0, 2000)]


class TunedSearch(SearchByNames):
    """A search that changes the options to those of `lean`, and lists its calls in its store."""

    lean: ClassVar = NamesOfRemoved(["lean"])

    def optioned(self, reduced):
        self.store.asked.append(("optioned", reduced))
        return self.lean or reduced, [Entry("option", "step", "harmless")]

    def tried(self, now, feature, tuned=False):
        self.store.asked.append(("tried", feature.name, tuned))
        return super().tried(now, feature, False)

    def timed(self, now, edited, entry, tuned=False):
        self.store.asked.append(("timed", entry.name, tuned))
        return entry


def run_tuned_search(monkeypatch, kind: str = "dynamics", **options):
    monkeypatch.setattr(
        diet,
        "list_features",
        lambda reduced, scene: iter([feature("a")] if "a" not in reduced else []),
    )
    run = replace(stepped_run().run, kind=kind)
    scene = replace(diet_scene(stepped_run(run=run), edited=NamesOfRemoved()), said=("one", "two"))
    own = TunedSearch(scene, unkept_study(workers="workers"), rounds=0, **options)
    return own, own.run()


def test_options_are_changed_after_features_are_removed(monkeypatch):
    """The final model has other options, so it is compared with references, and timed likewise."""
    own, found = run_tuned_search(monkeypatch)
    assert ("optioned", ["a"]) in own.store.asked
    assert found.tuned is True
    assert found.reduced == ["lean"]
    assert own.store.asked[-3:] == [("tried", "", True), ["lean"], ("timed", "", True)]
    assert [(e.kind, e.name) for e in found.entries] == [("geom", "a"), ("option", "step")]
    said = [Entry("said", "", "said", message=words) for words in ("one", "two")]
    assert found.said == said
    assert found.table == (*said, *found.entries, found.whole)


def test_options_are_kept_without_time_steps_or_without_tuning(monkeypatch):
    monkeypatch.setattr(TunedSearch, "lean", None)
    assert run_tuned_search(monkeypatch)[1].tuned is False  # no option could be made cheaper
    for kind, tune in (("dynamics", False), ("equilibrium", True), ("sweep", True)):
        own, found = run_tuned_search(monkeypatch, kind, tune=tune)
        assert found.tuned is False
        assert found.reduced == ["a"]
        assert [e.name for e in found.entries] == ["a"]
        assert not [asked for asked in own.store.asked if asked[0] == "optioned"]
        assert own.store.asked[-1] == ("timed", "", False)
